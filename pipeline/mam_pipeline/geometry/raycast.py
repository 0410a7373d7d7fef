"""A thin, NumPy-in NumPy-out wrapper of Open3D's ray-casting scene in normalised units.

Open3D computes in single precision, so every scene is centred and divided by a length before it is
built; all methods take and return the caller's frame and unit.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import open3d as o3d
from numpy.typing import NDArray

from mam_pipeline.types import FloatArray, IntArray

_tensor: Any = o3d.core.Tensor  # its stubs know no NumPy
# six directions at right angles, askew, so that they pass few edges
_AROUND = np.array([[6, 2, 3], [-3, 6, 2], [-2, -3, 6], [-6, -2, -3], [3, -6, -2], [2, 3, -6]]) / 7
_THREADS = 1  # runs are parallel over processes; one thread each is the fastest in total


@dataclass(frozen=True)
class Hits:
    """First hits of n rays: `t` (n,) in multiples of the ray's direction (inf = none), unit
    `normals` (n, 3) as wound, `faces` (n,) index of the triangle or -1."""

    t: FloatArray
    normals: FloatArray
    faces: IntArray


@dataclass(frozen=True)
class Closest:
    """Closest surface points of n queries: `points` (n, 3), `normals` (n, 3), `distance` (n,)."""

    points: FloatArray
    normals: FloatArray
    distance: FloatArray
    faces: IntArray


class RayScene:
    """Triangles ready for rays and distance queries."""

    def __init__(self, vertices: FloatArray, faces: IntArray) -> None:
        """Build from vertices (V, 3) and faces (F, 3); an empty face list is allowed.

        `bounds` (2, 3) holds the box of the triangles.
        """
        self.empty = len(faces) == 0
        used, inverse = np.unique(faces.reshape(-1), return_inverse=True)
        points = vertices[used] if len(used) else np.zeros((1, 3))
        low, high = points.min(axis=0), points.max(axis=0)
        self.bounds = np.stack([low, high])
        self._center = 0.5 * (low + high)
        self._unit = max(float(np.linalg.norm(high - low)), 1e-12)
        self._scene = o3d.t.geometry.RaycastingScene()
        if not self.empty:
            self._scene.add_triangles(
                _tensor(((points - self._center) / self._unit).astype(np.float32)),
                _tensor(inverse.reshape(-1, 3).astype(np.uint32)),
            )

    def first_hits(self, origins: FloatArray, directions: FloatArray) -> Hits:
        """Cast rays from (n, 3) along (n, 3); `t` counts in multiples of `directions`."""
        n = len(origins)
        if self.empty or n == 0:
            nothing = np.full(n, -1, dtype=np.int64)
            return Hits(np.full(n, np.inf), np.zeros((n, 3)), nothing)
        rays = np.empty((n, 6), dtype=np.float32)
        rays[:, :3] = (origins - self._center) / self._unit
        rays[:, 3:] = directions / self._unit
        answer = self._scene.cast_rays(_tensor(rays), nthreads=_THREADS)
        faces = answer["primitive_ids"].numpy().astype(np.int64)
        t = answer["t_hit"].numpy().astype(np.float64)
        faces[~np.isfinite(t)] = -1
        return Hits(t, answer["primitive_normals"].numpy().astype(np.float64), faces)

    def distance(self, points: FloatArray) -> FloatArray:
        """Unsigned distance (n,) of points (n, 3) to the triangles; inf for an empty scene."""
        if self.empty or len(points) == 0:
            return np.full(len(points), np.inf)
        query = ((points - self._center) / self._unit).astype(np.float32)
        found = self._scene.compute_distance(_tensor(query), nthreads=_THREADS)
        return found.numpy().astype(np.float64) * self._unit

    def signed_distance(self, points: FloatArray) -> FloatArray:
        """Distance (n,), negative inside (parity of rays): meaningful for closed surfaces only."""
        if self.empty or len(points) == 0:
            return np.full(len(points), np.inf)
        query = ((points - self._center) / self._unit).astype(np.float32)
        found = self._scene.compute_signed_distance(_tensor(query), nthreads=_THREADS, nsamples=3)
        return found.numpy().astype(np.float64) * self._unit

    def encloses(self, points: FloatArray) -> NDArray[np.bool_]:
        """Mask (n,) of points inside closed shells: crossed an odd number of times by every ray.

        Points in the opening of an open surface, or between sheets, are not.
        """
        n = len(points)
        if self.empty or n == 0:
            return np.zeros(n, dtype=np.bool_)
        rays = np.empty((n, len(_AROUND), 6), dtype=np.float32)
        rays[:, :, :3] = ((points - self._center) / self._unit)[:, None]
        rays[:, :, 3:] = _AROUND
        flat = _tensor(rays.reshape(-1, 6))
        crossed = self._scene.count_intersections(flat, nthreads=_THREADS).numpy()
        return np.asarray((crossed.reshape(n, -1) % 2 == 1).all(axis=1), dtype=np.bool_)

    def closest(self, points: FloatArray) -> Closest:
        """Closest points on the triangles (not on vertices) of queries (n, 3)."""
        n = len(points)
        if self.empty or n == 0:
            zero = np.zeros((n, 3))
            return Closest(zero, zero, np.full(n, np.inf), np.full(n, -1, dtype=np.int64))
        query = ((points - self._center) / self._unit).astype(np.float32)
        answer = self._scene.compute_closest_points(_tensor(query), nthreads=_THREADS)
        found = answer["points"].numpy().astype(np.float64)
        distance = np.linalg.norm(found - query, axis=1) * self._unit
        return Closest(
            found * self._unit + self._center,
            answer["primitive_normals"].numpy().astype(np.float64),
            distance,
            answer["primitive_ids"].numpy().astype(np.int64),
        )


def faces_near(
    vertices: FloatArray, faces: IntArray, low: FloatArray, high: FloatArray
) -> NDArray[np.bool_]:
    """Mask (F,) of the triangles whose own box touches the box from `low` (3,) to `high` (3,)."""
    corners = vertices[faces]
    below = (corners.min(axis=1) <= high).all(axis=1)
    above = (corners.max(axis=1) >= low).all(axis=1)
    return np.asarray(below & above, dtype=np.bool_)
