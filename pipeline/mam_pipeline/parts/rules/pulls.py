"""Pulls: bars on two feet, or before a board, by which the board is pulled; they are no part alone.

Where a board lies flush with what is beside it, its bonds say that it stays, and only its handle
seems to move. A lever, which turns, is held at one end; a button has its face on the board.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.parts.graph import Graph
from mam_pipeline.parts.groups import Masks, with_rigid
from mam_pipeline.parts.select import LEAST_BASE
from mam_pipeline.types import FloatArray

THIN = 0.2  # thickness of a board over its width
LONG = 2.0  # length of a pull over its width
SMALL = 0.25  # of the board's face: a pull covers no more
CLOSE = 0.05  # of the diagonal: farther before it a bar is no board's
OVER = 0.02  # of the diagonal: a pull may reach this far over the board's edge
FOOT = 0.3  # of a pull's height over the board: what is lower is a foot
FLOATS = 0.004  # of the diagonal: what stands farther off has no feet
BEFORE = 0.01  # of the diagonal: from here on something stands before the board
CLUTTER = 0.05  # of the board's surface: so much of other things before it is no front
CLEAR = 0.8  # expected overlap
STILL = 0.05  # a board that moves with less probability is no front
FEWEST = 8  # samples


def with_boards(graph: Graph, parts: Masks, move: FloatArray, value: FloatArray) -> Masks:
    """Parts (K, P); those that are a pull alone get the board that they are on, and its other face.

    Args:
        move: (P,) probability that a primitive moves. value: (K,) expected overlap of the parts
            with true ones; from CLEAR on they are left as they are.
    """
    parts = parts.copy()
    for k in np.flatnonzero(value < CLEAR):
        taken = parts.any(axis=0)
        boards = [
            (gap, b)
            for b in np.flatnonzero(~taken & (move > STILL))
            if (gap := _gap_of_pull(graph, parts[k], int(b))) is not None
        ]
        if boards:
            _, board = min(boards)
            with_it, _ = with_rigid(graph, parts[k] | (np.arange(graph.count) == board))
            with_it &= ~taken | parts[k]
            if graph.area[~taken & ~with_it].sum() >= LEAST_BASE:
                parts[k] = with_it
    return parts


def _gap_of_pull(graph: Graph, pull: NDArray[np.bool_], board: int) -> float | None:
    """How far a pull (P,) stands before a board; None if it is none of this board."""
    probe = graph.probe
    own, other = pull[probe.owner], ~pull[probe.owner] & (probe.owner != board)
    low, high = graph.low[board], graph.high[board]
    thin = int(np.argmin(high - low))
    wide = [k for k in range(3) if k != thin]
    if own.sum() < FEWEST or (high - low)[thin] > THIN * (high - low)[wide].min():
        return None
    points = probe.points[own]
    start, end = points.min(axis=0), points.max(axis=0)
    side = 1.0 if (start + end)[thin] > (low + high)[thin] else -1.0
    face = high[thin] if side > 0 else -low[thin]
    height = side * points[:, thin] - face
    beyond = (start[wide] < low[wide] - OVER) | (end[wide] > high[wide] + OVER)
    if height.max() <= 0 or not -OVER < height.min() < CLOSE or beyond.any():
        return None
    length, width = np.sort((end - start)[wide])[::-1]
    if length < LONG * width or length * width > SMALL * np.prod((high - low)[wide]):
        return None
    along = wide[int(np.argmax((end - start)[wide]))]
    third = np.floor(3 * (points[:, along] - start[along]) / max(length, 1e-9)).clip(0, 2)
    feet = [bool((height[third == t] < FOOT * height.max()).any()) for t in range(3)]
    if height.min() < FLOATS and feet not in ([True, False, True], [False, False, False]):
        return None
    around = probe.points[other]
    before = side * around[:, thin] - face > BEFORE
    before &= ((around[:, wide] > low[wide] + OVER) & (around[:, wide] < high[wide] - OVER)).all(1)
    if probe.weight[other][before].sum() > CLUTTER * graph.area[board]:
        return None
    return max(float(height.min()), 0.0)
