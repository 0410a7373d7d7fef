"""Which candidates are chosen beside, or instead of, those of the best set."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.parts.graph import Graph, tight_box
from mam_pipeline.parts.groups import Masks
from mam_pipeline.parts.select import SELECTION
from mam_pipeline.types import FloatArray


@dataclass(frozen=True)
class ChoiceThresholds:
    """Candidates beside the best set, and which of two bodies on the floor moves.

    Attributes:
        same_size: how far the logarithms of the extents of two handles may differ.
        bulkier: volume of one body over the other's from which the other moves; of those of 201
            kinds the base is never smaller than 0.6 parts.
        on_floor: diagonals over the floor that a body resting on it begins, at most.
        ground: diagonals: what lies flatter on the floor is the floor, not a body.
        one_sided: length of a surface's mean normal: of all sides of a body it is 0, of one face 1.
        body: share of a body's surface without its smallest pieces.
        rest: share of what one body leaves that the other must have.
    """

    same_size: float = 0.15
    bulkier: float = 2.0
    on_floor: float = 0.05
    ground: float = 0.005
    one_sided: float = 0.5
    body: float = 0.95
    rest: float = 0.8


CHOICE = ChoiceThresholds()


def lighter(graph: Graph, masks: Masks, value: FloatArray, chosen: int) -> int:
    """The candidate that moves, where a hinge joins two bodies that both rest on the floor.

    A case that lies open rests on its lid as well as on itself; what is bulkier stays. The other
    body is the best candidate (C, P) with most of what `chosen` leaves; without one, or where
    `chosen` is not CHOICE.bulkier, it is `chosen` itself.
    """
    rest = ~masks[chosen]
    probe = graph.probe
    bodies = [graph.bulk(m, CHOICE.body)[probe.owner] for m in (masks[chosen], rest)]
    if max(probe.points[b][:, 2].min() for b in bodies) > CHOICE.on_floor:
        return chosen
    if min(np.ptp(probe.points[b][:, 2]) for b in bodies) < CHOICE.ground:
        return chosen
    open_side = [probe.weight[b] @ probe.normals[b] / probe.weight[b].sum() for b in bodies]
    if max(np.linalg.norm(side) for side in open_side) > CHOICE.one_sided:
        return chosen  # one face of a body is none
    size = [np.prod(tight_box(probe.points[b])[1] + SELECTION.even) for b in bodies]
    most = masks @ graph.area > CHOICE.rest * float(rest @ graph.area)
    options = most & ~(masks & masks[chosen]).any(axis=1)
    if size[0] < CHOICE.bulkier * size[1] or not options.any():
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
        options &= (masks | taken) @ graph.area <= 1.0 - SELECTION.least_base
        if not options.any():
            return out
        out.append(int(np.argmax(np.where(options, value, -1.0))))


def with_twins(graph: Graph, masks: Masks, value: FloatArray, chosen: list[int]) -> list[int]:
    """The chosen candidates, and those of bodies (`Graph.rigid`) with the handle of a chosen one.

    Two fronts with the same handle both move. Handles are compared, not fronts, since a front's
    outline is ragged where its gap has closed. The best candidate is added that has the body and
    shares no primitive with what was chosen, as long as SELECTION.least_base stays.

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
    size = np.sort(extent, axis=1) + SELECTION.even
    taken = masks[out].any(axis=0)
    has = (bodies & taken).any(axis=1)
    for k in np.flatnonzero(~has):
        like = np.abs(np.log(size / size[k])).max(axis=1) < CHOICE.same_size
        options = (masks & bodies[k]).any(axis=1) & ~(masks & taken).any(axis=1)
        options &= (masks | taken) @ graph.area <= 1.0 - SELECTION.least_base
        if (like & has).any() and options.any():
            out.append(int(np.argmax(np.where(options, value, -1.0))))
            taken |= masks[out[-1]]
    return out


def nearest(graph: Graph, masks: Masks, part: NDArray[np.bool_], chosen: list[int]) -> int:
    """The candidate (C, P) with most surface in common with a part (P,) that is not yet chosen."""
    shared, either = (masks & part) @ graph.area, (masks | part) @ graph.area
    free = ~np.isin(np.arange(len(masks)), chosen)
    return int(np.argmax(np.where(free, shared / np.maximum(either, 1e-12), -1.0)))
