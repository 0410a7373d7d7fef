"""Cameras all around an object, cast on the CPU: which face each pixel shows, how lit, where edges.

What is painted over the faces is the business of `pictures`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.geometry.raycast import Hits, RayScene
from mam_pipeline.types import FloatArray, IntArray, Mesh

FOV = np.radians(35.0)
CORNERS = ((-35.0, 22.0), (35.0, 22.0), (145.0, 22.0), (-145.0, 22.0))
SIDES = ((0.0, 4.0), (90.0, 4.0), (180.0, 4.0), (-90.0, 4.0))
AROUND = (*CORNERS, *SIDES, (-30.0, 68.0), (30.0, -45.0))
CREASE = np.cos(np.radians(35.0))  # faces of one smooth surface meet at less than this
STEP = 0.004  # a surface that leaves its neighbour's plane by this share of the diagonal ends there


@dataclass(frozen=True)
class View:
    """One camera and what it sees.

    Attributes:
        azimuth, elevation: degrees; azimuth 0 looks along +X, 90 along +Y.
        camera_T_asset: (4, 4), OpenCV axes.
        faces: (H, W) index of the visible face, -1 background.
        shade: (H, W) 0..1, cosine to the camera.
        edges: (H, W) outlines and creases.
        window: x and y of the middle and half the side of the picture, on the image plane at 1.
    """

    azimuth: float
    elevation: float
    camera_T_asset: FloatArray
    faces: IntArray
    shade: FloatArray
    edges: NDArray[np.bool_]
    window: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def pixels(self, points: FloatArray) -> FloatArray:
        """(n, 2) where points (n, 3) lie in the picture, x to the right and y down."""
        seen = points @ self.camera_T_asset[:3, :3].T + self.camera_T_asset[:3, 3]
        flat = seen[:, :2] / np.maximum(seen[:, 2:], 1e-9)
        x, y, half = self.window
        return np.asarray(((flat - (x, y)) / half + 1.0) / 2.0 * len(self.faces))

    def ids(self, labels: IntArray) -> IntArray:
        """(H, W) label of the visible face, -1 background."""
        return np.where(self.faces >= 0, labels[np.maximum(self.faces, 0)], -1)


def look(
    mesh: Mesh,
    directions: Sequence[tuple[float, float]] = AROUND,
    size: int = 512,
    distance: float | None = None,
    fov: float = FOV,
    tight: bool = False,
    only: NDArray[np.bool_] | None = None,
    focus: NDArray[np.bool_] | None = None,
    around: FloatArray | None = None,
) -> list[View]:
    """Cast one view per (azimuth, elevation) in degrees; the whole object is in the picture.

    Args:
        distance: of the camera from the box centre in diagonals; default: as near as fits.
        tight: zoom so that the object fills each picture.
        only: (F,) faces to show; the camera stays that of the whole object.
        focus: (F,) faces to zoom on, with their surroundings.
        around: (n, 3) points that set the camera and the zoom in the place of the mesh's own.
    """
    kept = np.arange(len(mesh.faces)) if only is None else np.flatnonzero(only)
    scene = RayScene(mesh.vertices, mesh.faces[kept])
    box = mesh.bounds if around is None else np.stack([around.min(axis=0), around.max(axis=0)])
    centre, diagonal = box.mean(axis=0), float(np.linalg.norm(box[1] - box[0]))
    away = diagonal * (0.52 / np.tan(fov / 2) + 0.1 if distance is None else distance)
    near = mesh.faces if focus is None else mesh.faces[focus]
    points, margin = mesh.vertices[np.unique(near)], 1.06 if focus is None else 1.5
    points = points if around is None else around
    grid = (np.arange(size) + 0.5) / size * 2 - 1
    out = []
    for azimuth, elevation in directions:
        pose = camera_pose(centre, away, azimuth, elevation)
        middle: FloatArray = np.zeros(2)
        half = float(np.tan(fov / 2))
        if tight or focus is not None:
            middle, half = _window(points, pose, margin)
        x, y = np.meshgrid(middle[0] + grid * half, middle[1] + grid * half)
        rays = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)
        rays = rays / np.linalg.norm(rays, axis=1, keepdims=True) @ pose[:3, :3]
        eye = -pose[:3, :3].T @ pose[:3, 3]
        hits = scene.first_hits(np.broadcast_to(eye, rays.shape), rays)
        shade = np.abs(np.einsum("ij,ij->i", hits.normals, rays)).reshape(size, size)
        faces = np.where(hits.faces >= 0, kept[hits.faces], -1) if len(kept) else hits.faces
        edges = _edges(hits, rays, diagonal, size)
        seen = faces.reshape(size, size)
        window = float(middle[0]), float(middle[1]), half
        out.append(View(azimuth, elevation, pose, seen, shade, edges, window))
    return out


def camera_pose(target: FloatArray, away: float, azimuth: float, elevation: float) -> FloatArray:
    """`camera_T_asset` (4, 4), OpenCV axes, of a camera that looks at `target` from `away` m."""
    a, e = np.radians(azimuth), np.radians(elevation)
    back = np.array([-np.cos(e) * np.cos(a), -np.cos(e) * np.sin(a), np.sin(e)])
    forward = -back
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    out = np.eye(4)
    out[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    out[:3, 3] = -out[:3, :3] @ (target + back * away)
    return out


def _window(points: FloatArray, pose: FloatArray, margin: float) -> tuple[FloatArray, float]:
    """Middle (2,) and half side of the square, on the image plane at 1, that holds all points."""
    seen = points @ pose[:3, :3].T + pose[:3, 3]
    flat = seen[:, :2] / np.maximum(seen[:, 2:], 1e-9)
    low, high = flat.min(axis=0), flat.max(axis=0)
    return (low + high) / 2, float((high - low).max()) / 2 * margin


def _edges(hits: Hits, rays: FloatArray, diagonal: float, size: int) -> NDArray[np.bool_]:
    """(size, size) pixels where the surface ends or turns sharply against its right or lower."""
    there = (hits.faces >= 0).reshape(size, size)
    normal = hits.normals.reshape(size, size, 3)
    depth = np.where(there, hits.t.reshape(size, size), 0.0)
    point = rays.reshape(size, size, 3) * depth[..., None]
    out = np.zeros((size, size), dtype=bool)
    for axis in (0, 1):
        a = tuple(slice(None, -1) if k == axis else slice(None) for k in (0, 1))
        b = tuple(slice(1, None) if k == axis else slice(None) for k in (0, 1))
        gap = np.abs(np.einsum("ijk,ijk->ij", point[b] - point[a], normal[a]))
        turn = np.abs(np.einsum("ijk,ijk->ij", normal[a], normal[b]))
        cut = there[a] & there[b] & ((gap > STEP * diagonal) | (turn < CREASE))
        out[a] |= cut | (there[a] != there[b])
    return out
