"""What belongs to a chosen part: primitives that it lacks."""

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
    """What joins a part.

    Attributes:
        likely: probability from which a primitive is taken to move.
        faint: bonds below this say nothing of where a primitive belongs.
        apart: diagonals: what is farther from a part does not hang on it.
        minor: share of a part's surface: so small is a knob that was left out, and goes with its
            panel.
    """

    likely: float = 0.5
    faint: float = 0.3
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
