"""What belongs to a chosen part: primitives that it lacks, and those that span two parts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.parts.graph import Graph
from mam_pipeline.parts.groups import Masks
from mam_pipeline.parts.select import EVEN, LEAST_BASE
from mam_pipeline.types import FloatArray

LIKELY = 0.5  # from here on a primitive is taken to move
FAINT = 0.3  # bonds below this say nothing of where a primitive belongs
SPANS = 0.75  # of the box around two parts: what covers so much of it spans both
SLIVERS = 0.03  # of a surface beyond its box on any side: ragged cuts
MOST_OF_IT = 0.5  # of a part's surface: what spans is no more than the rest
BESIDE = 0.2  # of their extent: two that overlap no more stand side by side
SIMILAR = 0.3  # the same for the extents of two panels whose outlines are ragged
APART = 0.02  # of the diagonal: what is farther from a part does not hang on it
TRIFLE = 0.2  # of a part's surface: so small is a knob that was left out, and goes with its panel

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
