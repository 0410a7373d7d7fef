"""Which candidates are chosen beside those of the best set."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mam_pipeline.parts.graph import Graph
from mam_pipeline.parts.groups import Masks
from mam_pipeline.parts.select import SELECTION
from mam_pipeline.types import FloatArray


@dataclass(frozen=True)
class ChoiceThresholds:
    """Candidates beside the best set.

    Attributes:
        same_size: how far the logarithms of the extents of two handles may differ.
    """

    same_size: float = 0.15


CHOICE = ChoiceThresholds()


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
