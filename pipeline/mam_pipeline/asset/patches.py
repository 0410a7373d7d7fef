"""Plates over surface that no collision piece covers: bent tubes, thin frames, dropped pieces.

A decomposition ends when its budget is spent, and pieces that fill a moving part's path are taken
away. What is left bare is covered by flat boxes around patches of the surface itself: large ones
where the surface is flat, split where a box would hold free space or stand in a moving part's way.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.geometry.boxes import Box, aligned_box, least_rectangle, minimal_box
from mam_pipeline.types import FloatArray

FEWEST = 3
"""Smaller patches, of the surface samples of a link, are left bare."""
_WASTE = 0.25
"""Share of a plate that may be free space."""


def plates(
    points: FloatArray,
    normals: FloatArray,
    good: Callable[[Box], bool],
    empty: Callable[[FloatArray], NDArray[np.bool_]],
    budget: int,
) -> list[Box]:
    """Boxes around bare surface points, the largest patches first.

    Args:
        points, normals: (n, 3) samples of the bare surface.
        good: whether a box may stand where it is.
        empty: tells which of (n, 3) points lie in free space. budget: the most boxes.
    """
    counter = itertools.count()
    heap: list[tuple[int, int, FloatArray]] = []
    facing = np.abs(normals).argmax(axis=1)
    for axis in range(3):
        group = points[facing == axis]
        if len(group):
            heapq.heappush(heap, (-len(group), next(counter), group))
    out: list[Box] = []
    while heap and len(out) < budget:
        group = heapq.heappop(heap)[2]
        if len(group) < FEWEST:
            break
        box = _snug(group)
        if good(box) and float(empty(_grid(box)).mean()) <= _WASTE:
            out.append(box)
            continue
        for half in _halves(group, box):
            if len(half) < len(group):
                heapq.heappush(heap, (-len(half), next(counter), half))
    return out


def _snug(points: FloatArray) -> Box:
    """A box about points (n, 3); one about a flat patch stands out nowhere beside it."""
    box = minimal_box(points, 8)
    thin = int(box.half.argmin())
    if box.half[thin] > 0.1 * np.median(box.half):
        return box
    normal = box.axes[thin]
    snug = aligned_box(points, least_rectangle(points, normal))
    upright = aligned_box(points, np.eye(3))
    if np.abs(normal).max() > 0.999 and _area(upright) < 1.1 * _area(snug):
        return upright  # few points of an upright patch seem to be of a tilted one
    return snug


def _area(box: Box) -> float:
    """Of the largest side, a quarter."""
    a, b = np.sort(box.half)[1:]
    return float(a * b)


def _halves(points: FloatArray, box: Box) -> Sequence[FloatArray]:
    """Points split across the box's longest side: at the widest gap near its middle, else there."""
    height = (points - box.center) @ box.axes[int(box.half.argmax())]
    order = np.argsort(height, kind="stable")
    gaps = np.diff(height[order])
    n = len(points)
    inner = slice(n // 4, max(n - n // 4 - 1, n // 4 + 1))
    cut = n // 4 + int(gaps[inner].argmax()) + 1 if n > 3 else n // 2
    if n <= 3 or gaps[cut - 1] < 4.0 * (np.ptp(height) / n):
        cut = int(np.searchsorted(height[order], 0.0))
    cut = min(max(cut, 1), n - 1)
    return points[order[:cut]], points[order[cut:]]


def _grid(box: Box) -> FloatArray:
    """(75, 3) points spread in a box."""
    along = np.linspace(-0.85, 0.85, 5)
    order = np.argsort(box.half)
    sides = [along, along, along]
    sides[int(order[0])] = np.array([-0.5, 0.0, 0.5])
    local = np.stack(np.meshgrid(*sides, indexing="ij"), axis=-1).reshape(-1, 3)
    return np.asarray(box.center + (local * box.half) @ box.axes)
