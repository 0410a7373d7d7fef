"""Convex shapes, and whether two of them go through each other."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from mam_pipeline.types import FloatArray

THIN_SHARE = 0.25
"""Share of a shape's thickness that nothing may dip into; what runs through a thin wall is never
deep in it."""


@dataclass(frozen=True, eq=False)
class ConvexPiece:
    """A convex shape: `planes` (M, 4) rows (normal, offset), inside where normal . x + offset <= 0;
    `points` (V, 3) its corners, metres."""

    planes: FloatArray
    points: FloatArray

    @staticmethod
    def of(points: FloatArray) -> ConvexPiece | None:
        """The hull of points (N, 3), or None where they are flat."""
        try:
            hull = ConvexHull(points)
        except QhullError:
            return None
        planes = np.unique(np.round(hull.equations, 7), axis=0)
        return ConvexPiece(planes, np.asarray(points)[hull.vertices])

    @cached_property
    def thickness(self) -> float:
        """Least distance (m) between a face and the corner farthest from it."""
        return float(-(self.points @ self.planes[:, :3].T + self.planes[:, 3]).min(axis=0).max())

    @cached_property
    def box(self) -> FloatArray:
        """(2, 3) lowest and highest coordinates."""
        return np.stack([self.points.min(axis=0), self.points.max(axis=0)])

    @cached_property
    def edges(self) -> FloatArray:
        """(E, 2, 3) its edges; faces of more than three corners have diagonals among them."""
        sides = ConvexHull(self.points).simplices[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
        return np.asarray(self.points[np.unique(np.sort(sides, axis=1), axis=0)])

    def moved(self, pose: FloatArray) -> ConvexPiece:
        """The same shape carried by a rigid motion (4, 4)."""
        turn, shift = pose[:3, :3], pose[:3, 3]
        normals = self.planes[:, :3] @ turn.T
        offsets = self.planes[:, 3] - normals @ shift
        return ConvexPiece(np.c_[normals, offsets], self.points @ turn.T + shift)

    def cuts(self, other: ConvexPiece, pose: FloatArray, slack: float) -> bool:
        """Whether another shape, moved by `pose` (4, 4), goes deeper than `slack` (m) into it, or
        than a share of the thinner one's thickness; a negative slack is a distance to be kept.

        Shapes go through each other where an edge of one enters the other.
        """
        depth = min(slack, THIN_SHARE * self.thickness, THIN_SHARE * other.thickness)
        theirs = other.edges @ pose[:3, :3].T + pose[:3, 3]
        low, high = theirs.min(axis=(0, 1)), theirs.max(axis=(0, 1))
        room = max(0.0, -depth)
        if (low > self.box[1] + room).any() or (high < self.box[0] - room).any():
            return False
        if _enter(theirs, self.planes, depth):
            return True
        mine = (self.edges - pose[:3, 3]) @ pose[:3, :3]
        return _enter(mine, other.planes, depth)


def _enter(edges: FloatArray, planes: FloatArray, depth: float) -> bool:
    """Whether any segment (E, 2, 3) has a point deeper than `depth` inside all planes (M, 4)."""
    height = edges @ planes[:, :3].T + planes[:, 3] + depth
    begin, end = height[:, 0], height[:, 1]
    with np.errstate(divide="ignore", invalid="ignore"):
        at = begin / (begin - end)
    enter = np.where(begin > 0, np.where(end > 0, np.inf, at), 0.0).max(axis=1)
    leave = np.where((end > 0) & (begin <= 0), at, 1.0).min(axis=1)
    return bool((enter < leave).any())
