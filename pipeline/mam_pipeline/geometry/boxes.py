"""Boxes around point sets: along given axes, and of least volume."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from mam_pipeline.geometry.sampling import unit
from mam_pipeline.types import FloatArray


@dataclass(frozen=True)
class Box:
    """An oriented box: `center` (3,), `axes` (3, 3) unit rows, `half` (3,) half extents."""

    center: FloatArray
    axes: FloatArray
    half: FloatArray

    @property
    def volume(self) -> float:
        """Product of the full extents."""
        return float(np.prod(2.0 * self.half))

    def local(self, points: FloatArray) -> FloatArray:
        """Coordinates (n, 3) of points in multiples of the half extents: the box is [-1, 1]."""
        safe = np.maximum(self.half, 1e-9 * max(float(self.half.max()), 1e-12))
        return np.asarray((points - self.center) @ self.axes.T / safe)


def aligned_box(points: FloatArray, axes: FloatArray) -> Box:
    """Box of points (n, 3) along the given unit rows (3, 3)."""
    local = points @ axes.T
    low, high = local.min(axis=0), local.max(axis=0)
    return Box((0.5 * (low + high)) @ axes, np.array(axes), 0.5 * (high - low))


def minimal_box(points: FloatArray, directions: int = 40) -> Box:
    """Box of (nearly) least volume: one side on a hull facet, the other two by least rectangle.

    Flat or degenerate sets fall back to their principal axes.

    Args:
        points: (n, 3). directions: how many of the largest hull facets to try.
    """
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        return aligned_box(points, principal_axes(points)[0])
    corners = points[hull.vertices]
    tri = points[hull.simplices]
    areas = 0.5 * np.linalg.norm(np.cross(tri[:, 1] - tri[:, 0], tri[:, 2] - tri[:, 0]), axis=1)
    normals = hull.equations[:, :3] * np.where(hull.equations[:, 2:3] < 0, -1.0, 1.0)
    keys, inverse = np.unique(np.round(normals * 25).astype(int), axis=0, return_inverse=True)
    mass = np.bincount(inverse.reshape(-1), areas, minlength=len(keys))
    best: Box | None = None
    for group in np.argsort(-mass)[:directions]:
        members = np.flatnonzero(inverse.reshape(-1) == group)
        normal = unit(normals[members[np.argmax(areas[members])]])
        box = aligned_box(corners, least_rectangle(corners, normal))
        if best is None or box.volume < best.volume * (1 - 1e-9):
            best = box
    assert best is not None
    return best


def least_rectangle(points: FloatArray, normal: FloatArray) -> FloatArray:
    """Axes (3, 3) with `normal` last whose other two bound the projection by least area."""
    helper = np.eye(3)[int(np.argmin(np.abs(normal)))]
    u = unit(np.cross(normal, helper))
    v = np.cross(normal, u)
    flat = np.stack([points @ u, points @ v], axis=1)
    try:
        ring = flat[ConvexHull(flat).vertices]
    except (QhullError, ValueError):
        return np.stack([u, v, normal])
    edges = np.roll(ring, -1, axis=0) - ring
    angle = np.mod(np.arctan2(edges[:, 1], edges[:, 0]), np.pi / 2)
    angle = angle[np.unique(np.round(angle, 4), return_index=True)[1]]
    along = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    across = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    a, b = ring @ along.T, ring @ across.T
    k = int(np.argmin(np.ptp(a, axis=0) * np.ptp(b, axis=0)))
    x = along[k, 0] * u + along[k, 1] * v
    return np.stack([x, np.cross(normal, x), normal])


def principal_axes(points: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Principal directions (3, 3) of points (n, 3), largest variance first; the variances."""
    if len(points) < 2:
        return np.eye(3), np.zeros(3)
    values, vectors = np.linalg.eigh(np.cov(points.T))
    rows = vectors[:, ::-1].T.copy()
    if np.linalg.det(rows) < 0:
        rows[2] *= -1.0
    return rows, values[::-1].copy()


def angle_between(a: FloatArray, b: FloatArray) -> float:
    """Folded angle in [0, pi / 2] between two directions (3,), radians."""
    return float(np.arccos(np.clip(abs(float(unit(a) @ unit(b))), 0.0, 1.0)))
