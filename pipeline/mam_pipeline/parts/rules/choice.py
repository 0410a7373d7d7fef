"""Which candidates are chosen beside, or instead of, those of the best set."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.parts.graph import Graph, tight_box
from mam_pipeline.parts.groups import Masks
from mam_pipeline.parts.select import EVEN, LEAST_BASE
from mam_pipeline.types import FloatArray

ALIKE = 0.15  # how far the logarithms of the extents of twins may differ
# two hinged bodies on the floor: of those of 201 kinds the base is never smaller than 0.6 parts
BULKIER = 2.0
ON_FLOOR = 0.05
GROUND = 0.005  # of the diagonal: what lies flatter on the floor is the floor, not a body
ONE_SIDED = 0.5  # length of a surface's mean normal: of all sides of a body it is 0, of one face 1
LITTLE_LESS = 0.95  # share of a body's surface without its smallest pieces
MOST_OF_REST = 0.8

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


def nearest(graph: Graph, masks: Masks, part: NDArray[np.bool_], chosen: list[int]) -> int:
    """The candidate (C, P) with most surface in common with a part (P,) that is not yet chosen."""
    shared, either = (masks & part) @ graph.area, (masks | part) @ graph.area
    free = ~np.isin(np.arange(len(masks)), chosen)
    return int(np.argmax(np.where(free, shared / np.maximum(either, 1e-12), -1.0)))
