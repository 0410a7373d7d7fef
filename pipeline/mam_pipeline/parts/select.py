"""Choosing the parts: the best set of candidates that share no primitive."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.parts.graph import Graph, tight_box
from mam_pipeline.parts.groups import Masks
from mam_pipeline.types import FloatArray

LIKELY = 0.5  # from here on a primitive is taken to move
FAINT = 0.3  # bonds below this say nothing of where a primitive belongs
ALIKE = 0.15  # how far the logarithms of the extents of twins may differ
EVEN = 5e-3  # added to extents (of the diagonal) before they are compared
# share of the surface that stays in the base at least: a chandelier's 0.04 is the least of 111 real
# objects, 0.10 of 1 200 generated ones
LEAST_BASE = 0.03
SPANS = 0.75  # of the box around two parts: what covers so much of it spans both
SLIVERS = 0.03  # of a surface beyond its box on any side: ragged cuts
MOST_OF_IT = 0.5  # of a part's surface: what spans is no more than the rest
BESIDE = 0.2  # of their extent: two that overlap no more stand side by side
SIMILAR = 0.3  # the same for the extents of two leaves whose outlines are ragged
# two hinged bodies on the floor: of those of 201 kinds the base is never smaller than 0.6 parts
BULKIER = 2.0
ON_FLOOR = 0.05
GROUND = 0.005  # of the diagonal: what lies flatter on the floor is the floor, not a body
ONE_SIDED = 0.5  # length of a surface's mean normal: of all sides of a body it is 0, of one face 1
LITTLE_LESS = 0.95  # share of a body's surface without its smallest pieces
MOST_OF_REST = 0.8
APART = 0.02  # of the diagonal: what is farther from a part does not hang on it
TRIFLE = 0.2  # of a part's surface: so small is a knob that was left out, and goes with its leaf


def select_groups(masks: Masks, value: FloatArray, threshold: float, sweeps: int = 3) -> list[int]:
    """Indices of a set of disjoint candidates with the largest total of value - threshold.

    Greedy by value, then exchanges: one chosen candidate for the free ones that its removal
    allows, or several chosen for one that overlaps them, as long as the total rises. (Weighted
    set packing is NP-hard; at these sizes the exchanges reach the optimum nearly always.)

    Args:
        masks: (C, P). value: (C,) predicted overlap with a true part, 0..1.
        threshold: value below which a candidate is worth less than leaving it in the base.
    """
    gain = value - threshold
    order = [int(c) for c in np.argsort(-gain, kind="stable") if gain[c] > 0]
    if not order:
        return []
    clash = masks.astype(np.float32) @ masks.T.astype(np.float32) > 0
    chosen = _fill([], order, clash)
    for _ in range(sweeps):
        improved = False
        for c in order:
            if c in chosen:
                trial = _fill([k for k in chosen if k != c], [k for k in order if k != c], clash)
            else:
                trial = _fill([k for k in chosen if not clash[c, k]] + [c], order, clash)
            if gain[trial].sum() > gain[chosen].sum() + 1e-9:
                chosen, improved = trial, True
        if not improved:
            break
    return sorted(chosen, key=lambda c: -value[c])


def completed(
    graph: Graph, parts: Masks, same: FloatArray, move: FloatArray, left: Masks | None = None
) -> Masks:
    """Parts (K, P) with the primitives that were left in the base and belong to them.

    A front without its handle overlaps the true part well, so its score hardly asks for the
    handle; the bonds do. A primitive that is likely to move, and is no part of its own, joins the
    part that it is bound to most, if it is bound to no still one as much; the strongest bond first.
    What moves with it as one body joins as well. LEAST_BASE of the surface stays, if so much was
    left, and so do fronts with handles, which are parts of their own, and what is no trifle beside
    the part and was nearly made one itself (the panes that stay beside a leaf) or stands apart from
    it (the racks behind an oven's door).

    Args:
        same: (E,), move: (P,) probabilities of the bonds and of moving. left: (L, P) what is too
            unsure to be a part of its own.
    """
    owner = np.where(parts.any(axis=0), np.argmax(parts, axis=0), -1)
    one, other = graph.pairs[:, 0], graph.pairs[:, 1]
    a, b = np.concatenate([one, other]), np.concatenate([other, one])
    bond = np.concatenate([same, same])
    alone: NDArray[np.bool_] = np.zeros(graph.count, dtype=bool)
    together: NDArray[np.bool_] = np.eye(graph.count, dtype=bool)
    if graph.rigid is not None and graph.fronts is not None:
        alone |= graph.rigid[graph.fronts].any(axis=0)
        together |= graph.rigid.T.astype(int) @ graph.rigid.astype(int) > 0
    area = together @ graph.area
    apart = np.concatenate([graph.gap, graph.gap]) > APART
    stays = np.zeros((graph.count, len(parts)), dtype=bool)
    for mask in () if left is None else left:
        stays |= mask[:, None] & (mask @ graph.area > TRIFLE * (parts @ graph.area))
    spare = LEAST_BASE if graph.area[owner < 0].sum() >= LEAST_BASE else 0.0
    while True:
        still = np.full(graph.count, FAINT)
        base = (owner[b] < 0) & (move[b] < LIKELY)
        np.maximum.at(still, a[base], bond[base])
        joins = (owner[a] < 0) & (owner[b] >= 0) & (move[a] > LIKELY) & (bond > still[a])
        joins &= ~(apart & (graph.area[a] > TRIFLE * (parts @ graph.area)[owner[b]]))
        joins &= ~alone[a] & ~stays[a, owner[b]] & (area[a] <= graph.area[owner < 0].sum() - spare)
        if not joins.any():
            return np.arange(len(parts))[:, None] == owner[None]
        best = int(np.argmax(np.where(joins, bond, -1.0)))
        owner[together[a[best]]] = owner[b[best]]


def without_spanning(graph: Graph, parts: Masks) -> Masks:
    """Parts (K, P) without what spans two of them that are alike without it: their common frame.

    A frame that lies flush with its leaves is bound to them as they are to each other, and goes
    with one of them. A primitive as wide and high as both together belongs to neither.
    """
    if len(parts) < 2:
        return parts
    parts = parts.copy()
    single = [_extent(graph, one) for one in np.eye(graph.count, dtype=bool)]
    for k in range(len(parts)):
        for m in range(k):
            low, high = _extent(graph, parts[k] | parts[m])
            wide = np.argsort(high - low)[1:]
            cover = np.array([np.minimum(e, high) - np.maximum(s, low) for s, e in single])
            spans = np.maximum(cover, 0.0)[:, wide].prod(axis=1) > SPANS * (high - low)[wide].prod()
            rest = parts[[k, m]] & ~spans
            kept = (rest @ graph.area) / (parts[[k, m]] @ graph.area)
            if kept.min() == 1.0 or kept.min() < MOST_OF_IT:
                continue
            (start, end), (start_m, end_m) = (_extent(graph, r) for r in rest)
            size, other = end - start + EVEN, end_m - start_m + EVEN
            both = np.minimum(end, end_m) - np.maximum(start, start_m)
            beside = (both < BESIDE * np.minimum(size, other))[wide].any()
            if beside and (np.abs(np.log(size / other))[wide] < SIMILAR).all():
                parts[[k, m]] = rest
    return parts


def _extent(graph: Graph, mask: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """Corners (3,), (3,) of the box around all but SLIVERS of the surface on every side."""
    own = mask[graph.probe.owner]
    if not own.any():  # no surface to speak of
        return np.full(3, np.inf), np.full(3, -np.inf)
    points, weight = graph.probe.points[own], graph.probe.weight[own]
    order = np.argsort(points, axis=0)
    share = np.cumsum(weight[order], axis=0) / max(float(weight.sum()), 1e-12)
    last = len(points) - 1
    rows = [np.minimum((share < s).sum(axis=0), last) for s in (SLIVERS, 1.0 - SLIVERS)]
    low, high = (np.take_along_axis(points, order, axis=0)[r, range(3)] for r in rows)
    return low, high


def lighter(graph: Graph, masks: Masks, value: FloatArray, chosen: int) -> int:
    """The candidate that moves, where a hinge joins two bodies that both rest on the floor.

    A case that lies open rests on its lid as well as on itself; what is bulkier stays. The other
    body is the best candidate (C, P) with most of what `chosen` leaves; without one, or where
    `chosen` is not BULKIER, it is `chosen` itself.
    """
    rest = ~masks[chosen]
    probe = graph.probe
    bodies = [graph.bulk(m, LITTLE_LESS)[probe.owner] for m in (masks[chosen], rest)]
    if max(probe.points[b][:, 2].min() for b in bodies) > ON_FLOOR:
        return chosen
    if min(np.ptp(probe.points[b][:, 2]) for b in bodies) < GROUND:
        return chosen
    open_side = [probe.weight[b] @ probe.normals[b] / probe.weight[b].sum() for b in bodies]
    if max(np.linalg.norm(side) for side in open_side) > ONE_SIDED:
        return chosen  # one face of a body is none
    size = [np.prod(tight_box(probe.points[b])[1] + EVEN) for b in bodies]
    most = masks @ graph.area > MOST_OF_REST * float(rest @ graph.area)
    options = most & ~(masks & masks[chosen]).any(axis=1)
    if size[0] < BULKIER * size[1] or not options.any():
        return chosen
    return int(np.argmax(np.where(options, value, -1.0)))


def nearest(graph: Graph, masks: Masks, part: NDArray[np.bool_], chosen: list[int]) -> int:
    """The candidate (C, P) with most surface in common with a part (P,) that is not yet chosen."""
    shared, either = (masks & part) @ graph.area, (masks | part) @ graph.area
    free = ~np.isin(np.arange(len(masks)), chosen)
    return int(np.argmax(np.where(free, shared / np.maximum(either, 1e-12), -1.0)))


def with_sure(
    graph: Graph, masks: Masks, value: FloatArray, sure: NDArray[np.bool_], chosen: list[int]
) -> list[int]:
    """The chosen candidates, and what shares nothing with them and is as good as certain.

    Args:
        masks: (C, P). value: (C,). sure: (C,) which are. chosen: indices.
    """
    out = list(chosen)
    while True:
        taken = masks[out].any(axis=0)
        options = sure & ~(masks & taken).any(axis=1)
        options &= (masks | taken) @ graph.area <= 1.0 - LEAST_BASE
        if not options.any():
            return out
        out.append(int(np.argmax(np.where(options, value, -1.0))))


def with_twins(graph: Graph, masks: Masks, value: FloatArray, chosen: list[int]) -> list[int]:
    """The chosen candidates, and those of bodies (`Graph.rigid`) with the handle of a chosen one.

    Two fronts with the same handle both move. Handles are compared, not fronts, since a front's
    outline is ragged where its gap has closed. The best candidate is added that has the body and
    shares no primitive with what was chosen, as long as LEAST_BASE stays.

    Args:
        masks: (C, P). value: (C,). chosen: indices.
    """
    if graph.rigid is None or graph.fronts is None or graph.fronts.sum() < 2:
        return chosen
    bodies, out = graph.rigid[graph.fronts], list(chosen)
    largest = np.argmax(bodies * graph.area, axis=1)
    handles = bodies & (np.arange(graph.count) != largest[:, None])
    handles = np.where(handles.any(axis=1, keepdims=True), handles, bodies)
    extent = [graph.high[h].max(axis=0) - graph.low[h].min(axis=0) for h in handles]
    size = np.sort(extent, axis=1) + EVEN
    taken = masks[out].any(axis=0)
    has = (bodies & taken).any(axis=1)
    for k in np.flatnonzero(~has):
        like = np.abs(np.log(size / size[k])).max(axis=1) < ALIKE
        options = (masks & bodies[k]).any(axis=1) & ~(masks & taken).any(axis=1)
        options &= (masks | taken) @ graph.area <= 1.0 - LEAST_BASE
        if (like & has).any() and options.any():
            out.append(int(np.argmax(np.where(options, value, -1.0))))
            taken |= masks[out[-1]]
    return out


def _fill(start: list[int], order: list[int], clash: Masks) -> list[int]:
    """Add candidates in order wherever nothing clashes."""
    out = list(start)
    blocked: Masks = np.zeros(len(clash), dtype=bool)
    for c in out:
        blocked |= clash[c]
    for c in order:
        if not blocked[c]:
            out.append(c)
            blocked |= clash[c]
    return out
