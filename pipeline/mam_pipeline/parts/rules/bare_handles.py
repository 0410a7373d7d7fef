"""Bare handles: bars on two feet, or before a board, by which it is pulled; they are no part alone.

Where a board lies flush with what is beside it, its bonds say that it stays, and only its handle
seems to move. A lever, which turns, is held at one end; a button has its face on the board.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.parts.graph import Graph
from mam_pipeline.parts.groups import Masks, with_rigid
from mam_pipeline.parts.select import SELECTION
from mam_pipeline.types import FloatArray


@dataclass(frozen=True)
class HandleThresholds:
    """When a part is a handle that stands on, or before, a board; lengths in bounding-box diagonals
    unless said otherwise.

    Attributes:
        board_thickness: thickness of a board over its width, at most.
        length: length of a handle over its width, at least.
        area: share of the board's face that a handle covers at most.
        before: farther before it a bar is no board's.
        overhang: how far a handle may reach over the board's edge.
        foot: share of a handle's height over the board: what is lower is a foot.
        floats: what stands farther off has no feet.
        obstacle: from here on something else stands before the board.
        clutter: share of the board's surface: with so much of other things before it, it is no
            front.
        good: expected overlap from which a part is left as it is.
        still: a board that moves with less probability is no front.
        fewest: samples of a handle, at least.
    """

    board_thickness: float = 0.2
    length: float = 2.0
    area: float = 0.25
    before: float = 0.05
    overhang: float = 0.02
    foot: float = 0.3
    floats: float = 0.004
    obstacle: float = 0.01
    clutter: float = 0.05
    good: float = 0.8
    still: float = 0.05
    fewest: int = 8


HANDLE = HandleThresholds()


def with_boards(graph: Graph, parts: Masks, move: FloatArray, value: FloatArray) -> Masks:
    """Parts (K, P); those that are a handle alone get their board, and its other face.

    Args:
        move: (P,) probability that a primitive moves. value: (K,) expected overlap of the parts
            with true ones; from HANDLE.good on they are left as they are.
    """
    parts = parts.copy()
    for k in np.flatnonzero(value < HANDLE.good):
        taken = parts.any(axis=0)
        boards = [
            (gap, b)
            for b in np.flatnonzero(~taken & (move > HANDLE.still))
            if (gap := _gap_of_handle(graph, parts[k], int(b))) is not None
        ]
        if boards:
            _, board = min(boards)
            with_it, _ = with_rigid(graph, parts[k] | (np.arange(graph.count) == board))
            with_it &= ~taken | parts[k]
            if graph.area[~taken & ~with_it].sum() >= SELECTION.least_base:
                parts[k] = with_it
    return parts


def _gap_of_handle(graph: Graph, handle: NDArray[np.bool_], board: int) -> float | None:
    """How far a handle (P,) stands before a board; None if it is none of this board."""
    probe = graph.probe
    own, other = handle[probe.owner], ~handle[probe.owner] & (probe.owner != board)
    low, high = graph.low[board], graph.high[board]
    thin = int(np.argmin(high - low))
    wide = [k for k in range(3) if k != thin]
    if (
        own.sum() < HANDLE.fewest
        or (high - low)[thin] > HANDLE.board_thickness * (high - low)[wide].min()
    ):
        return None
    points = probe.points[own]
    start, end = points.min(axis=0), points.max(axis=0)
    side = 1.0 if (start + end)[thin] > (low + high)[thin] else -1.0
    face = high[thin] if side > 0 else -low[thin]
    height = side * points[:, thin] - face
    beyond = (start[wide] < low[wide] - HANDLE.overhang) | (
        end[wide] > high[wide] + HANDLE.overhang
    )
    if height.max() <= 0 or not -HANDLE.overhang < height.min() < HANDLE.before or beyond.any():
        return None
    length, width = np.sort((end - start)[wide])[::-1]
    if length < HANDLE.length * width or length * width > HANDLE.area * np.prod((high - low)[wide]):
        return None
    along = wide[int(np.argmax((end - start)[wide]))]
    third = np.floor(3 * (points[:, along] - start[along]) / max(length, 1e-9)).clip(0, 2)
    feet = [bool((height[third == t] < HANDLE.foot * height.max()).any()) for t in range(3)]
    if height.min() < HANDLE.floats and feet not in ([True, False, True], [False, False, False]):
        return None
    around = probe.points[other]
    before = side * around[:, thin] - face > HANDLE.obstacle
    before &= (
        (around[:, wide] > low[wide] + HANDLE.overhang)
        & (around[:, wide] < high[wide] - HANDLE.overhang)
    ).all(1)
    if probe.weight[other][before].sum() > HANDLE.clutter * graph.area[board]:
        return None
    return max(float(height.min()), 0.0)
