"""What belongs to a chosen part: primitives that it lacks, and those that span two parts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.parts.graph import Graph
from mam_pipeline.parts.groups import Masks
from mam_pipeline.parts.select import SELECTION
from mam_pipeline.types import FloatArray


@dataclass(frozen=True)
class ExtentThresholds:
    """What joins a part, and what spans two parts.

    Attributes:
        likely: probability from which a primitive is taken to move.
        faint: bonds below this say nothing of where a primitive belongs.
        spans: share of the box around two parts: what covers so much of it spans both.
        slivers: share of a surface beyond its box on any side; cuts are ragged.
        most_of_part: share of a part's surface that is left without what spans, at least.
        beside: share of their extent: two parts that overlap no more stand side by side.
        similar: how far the logarithms of the extents of two panels with ragged outlines may
            differ.
        apart: diagonals: what is farther from a part does not hang on it.
        minor: share of a part's surface: so small is a knob that was left out, and goes with its
            panel.
    """

    likely: float = 0.5
    faint: float = 0.3
    spans: float = 0.75
    slivers: float = 0.03
    most_of_part: float = 0.5
    beside: float = 0.2
    similar: float = 0.3
    apart: float = 0.02
    minor: float = 0.2


EXTENT = ExtentThresholds()


def completed(
    graph: Graph, parts: Masks, same: FloatArray, move: FloatArray, left: Masks | None = None
) -> Masks:
    """Parts (K, P) with the primitives that were left in the base and belong to them.

    A front without its handle overlaps the true part well, so its score hardly asks for the
    handle; the bonds do. A primitive that is likely to move, and is no part of its own, joins the
    part that it is bound to most, if it is bound to no still one as much; the strongest bond first.
    What moves with it as one body joins as well. The least base stays, if so much was left, and so
    do fronts with handles, which are parts of their own, and what is not minor beside the part and
    was nearly made one itself (the panes that stay beside a panel) or stands apart from it (the
    racks behind an oven's door).

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
    apart = np.concatenate([graph.gap, graph.gap]) > EXTENT.apart
    stays = np.zeros((graph.count, len(parts)), dtype=bool)
    for mask in () if left is None else left:
        stays |= mask[:, None] & (mask @ graph.area > EXTENT.minor * (parts @ graph.area))
    spare = SELECTION.least_base if graph.area[owner < 0].sum() >= SELECTION.least_base else 0.0
    while True:
        still = np.full(graph.count, EXTENT.faint)
        base = (owner[b] < 0) & (move[b] < EXTENT.likely)
        np.maximum.at(still, a[base], bond[base])
        joins = (owner[a] < 0) & (owner[b] >= 0) & (move[a] > EXTENT.likely) & (bond > still[a])
        joins &= ~(apart & (graph.area[a] > EXTENT.minor * (parts @ graph.area)[owner[b]]))
        joins &= ~alone[a] & ~stays[a, owner[b]] & (area[a] <= graph.area[owner < 0].sum() - spare)
        if not joins.any():
            return np.arange(len(parts))[:, None] == owner[None]
        best = int(np.argmax(np.where(joins, bond, -1.0)))
        owner[together[a[best]]] = owner[b[best]]


def without_spanning(graph: Graph, parts: Masks) -> Masks:
    """Parts (K, P) without what spans two of them that are alike without it: their common frame.

    A frame that lies flush with its panels is bound to them as they are to each other, and goes
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
            spans = (
                np.maximum(cover, 0.0)[:, wide].prod(axis=1)
                > EXTENT.spans * (high - low)[wide].prod()
            )
            rest = parts[[k, m]] & ~spans
            kept = (rest @ graph.area) / (parts[[k, m]] @ graph.area)
            if kept.min() == 1.0 or kept.min() < EXTENT.most_of_part:
                continue
            (start, end), (start_m, end_m) = (_extent(graph, r) for r in rest)
            size, other = end - start + SELECTION.even, end_m - start_m + SELECTION.even
            both = np.minimum(end, end_m) - np.maximum(start, start_m)
            beside = (both < EXTENT.beside * np.minimum(size, other))[wide].any()
            if beside and (np.abs(np.log(size / other))[wide] < EXTENT.similar).all():
                parts[[k, m]] = rest
    return parts


def _extent(graph: Graph, mask: NDArray[np.bool_]) -> tuple[FloatArray, FloatArray]:
    """Corners (3,), (3,) of the box around all but slivers of the surface on every side."""
    own = mask[graph.probe.owner]
    if not own.any():  # no surface to speak of
        return np.full(3, np.inf), np.full(3, -np.inf)
    points, weight = graph.probe.points[own], graph.probe.weight[own]
    order = np.argsort(points, axis=0)
    share = np.cumsum(weight[order], axis=0) / max(float(weight.sum()), 1e-12)
    last = len(points) - 1
    rows = [
        np.minimum((share < s).sum(axis=0), last) for s in (EXTENT.slivers, 1.0 - EXTENT.slivers)
    ]
    low, high = (np.take_along_axis(points, order, axis=0)[r, range(3)] for r in rows)
    return low, high
