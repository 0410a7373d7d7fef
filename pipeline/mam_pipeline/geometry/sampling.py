"""Surface sampling: area-weighted, seeded, with the face every point came from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mam_pipeline.types import FloatArray, IntArray

SEED_STEP = 1000  # between the seeds of several samplings of one thing


@dataclass(frozen=True)
class SurfaceSamples:
    """Points on a triangle surface.

    Attributes:
        points: (n, 3) positions, the frame and unit of the vertices.
        normals: (n, 3) unit normals of the faces as wound (zero for degenerate faces).
        faces: (n,) index of the face of every point (into the array that was sampled).
        area: total area that was sampled; every point stands for area / n.
    """

    points: FloatArray
    normals: FloatArray
    faces: IntArray
    area: float


def face_geometry(vertices: FloatArray, faces: IntArray) -> tuple[FloatArray, FloatArray]:
    """Return unit normals (F, 3) and areas (F,) of triangles; degenerate ones have normal 0."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    length = np.linalg.norm(cross, axis=1)
    return cross / np.maximum(length, 1e-300)[:, None], 0.5 * length


def sample_surface(
    vertices: FloatArray, faces: IntArray, count: int, seed: int = 0
) -> SurfaceSamples:
    """Draw `count` points, stratified over the area and hence evenly spread.

    Stratification (one draw in each of `count` equal slices of the cumulative area) keeps the
    share of every face within one sample of its area share: less noise at the same cost.

    Args:
        vertices: (V, 3). faces: (F, 3). count: how many. seed: of the random generator.
    """
    normals, areas = face_geometry(vertices, faces)
    total = float(areas.sum())
    if count <= 0 or total <= 0.0:
        empty = np.zeros((0, 3))
        return SurfaceSamples(empty, empty, np.zeros(0, dtype=np.int64), total)
    rng = np.random.default_rng(seed)
    slices = (np.arange(count) + rng.random(count)) * (total / count)
    index = np.minimum(np.searchsorted(np.cumsum(areas), slices, side="right"), len(faces) - 1)
    u, w = rng.random(count), rng.random(count)
    flip = u + w > 1.0
    u[flip], w[flip] = 1.0 - u[flip], 1.0 - w[flip]
    a, b, c = (vertices[faces[index, k]] for k in range(3))
    points = a + u[:, None] * (b - a) + w[:, None] * (c - a)
    return SurfaceSamples(points, normals[index], index.astype(np.int64), total)


def thin_out(count: int, keep: int, seed: int = 0) -> IntArray:
    """Indices of at most `keep` of `count` items, sorted, without repetition."""
    if count <= keep:
        return np.arange(count, dtype=np.int64)
    rng = np.random.default_rng(seed)
    return np.sort(rng.choice(count, size=keep, replace=False)).astype(np.int64)


def unit(vector: ArrayLike) -> FloatArray:
    """Return (..., 3) scaled to length one; a zero vector stays zero."""
    v = np.asarray(vector, dtype=np.float64)
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-300)
