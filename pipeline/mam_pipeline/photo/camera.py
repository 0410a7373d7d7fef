"""A pinhole camera and the pose of a box before it: every projection of the photo stage.

Axes: the asset frame (X into the object, so the front face looks towards -X; Z up; the viewer's
right is -Y) and OpenCV's camera frame (x right, y down, z forward). Pixels: x right, y down, the
centre of the first pixel at (0.5, 0.5). Angles are radians.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]
# camera axes (rows) in the asset frame when the camera looks straight at the front
LOOK = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
# corners of a box in units of (depth, width, height) / 2; index = 4 * back + 2 * right + top
CORNERS = np.array([[x, -y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=float)
# faces as corner indices TL, TR, BR, BL seen from outside, and outward normals
FACES = {
    "front": (1, 3, 2, 0),
    "right": (3, 7, 6, 2),
    "left": (5, 1, 0, 4),
    "top": (5, 7, 3, 1),
    "back": (7, 5, 4, 6),
    "bottom": (0, 2, 6, 4),
}
NORMALS = {
    "front": (-1.0, 0, 0),
    "right": (0, -1.0, 0),
    "left": (0, 1.0, 0),
    "top": (0, 0, 1.0),
    "back": (1.0, 0, 0),
    "bottom": (0, 0, -1.0),
}
EDGES = np.array(
    [[0, 1], [2, 3], [4, 5], [6, 7], [0, 2], [1, 3], [4, 6], [5, 7], [0, 4], [1, 5], [2, 6], [3, 7]]
)  # four along Z, four along Y, four along X
EDGE_FACES = (
    ("front", "left"), ("front", "right"), ("back", "left"), ("back", "right"),
    ("front", "bottom"), ("front", "top"), ("back", "bottom"), ("back", "top"),
    ("left", "bottom"), ("left", "top"), ("right", "bottom"), ("right", "top"),
)  # fmt: skip


def rotation(yaw: ArrayLike, pitch: ArrayLike, roll: ArrayLike) -> Array:
    """(..., 3, 3) camera_R_asset.

    Yaw > 0 shows the object's right side, pitch > 0 looks down on it, roll turns the picture.
    """
    yaw, pitch, roll = np.broadcast_arrays(
        np.asarray(yaw, float), np.asarray(pitch, float), np.asarray(roll, float)
    )
    zero, one = np.zeros_like(yaw), np.ones_like(yaw)

    def stack(rows: list[list[Array]]) -> Array:
        return np.stack([np.stack(r, axis=-1) for r in rows], axis=-2)

    c, s = np.cos(yaw), np.sin(yaw)
    turn = stack([[c, s, zero], [-s, c, zero], [zero, zero, one]])  # about asset Z
    c, s = np.cos(pitch), np.sin(pitch)
    tilt = stack([[one, zero, zero], [zero, c, -s], [zero, s, c]])  # about camera x
    c, s = np.cos(roll), np.sin(roll)
    spin = stack([[c, -s, zero], [s, c, zero], [zero, zero, one]])  # about camera z
    return spin @ tilt @ LOOK @ turn


@dataclass(frozen=True)
class Camera:
    """Pinhole camera: focal length and principal point in pixels, camera_T_asset."""

    width: int
    height: int
    focal: float
    rotation: Array
    translation: Array

    @property
    def center(self) -> Array:
        """(2,) principal point, pixels."""
        return np.array([self.width / 2, self.height / 2])

    def project(self, points: ArrayLike) -> Array:
        """(..., 3) asset points to (..., 2) pixels."""
        q = np.asarray(points, float) @ self.rotation.T + self.translation
        return q[..., :2] / np.maximum(q[..., 2:], 1e-6) * self.focal + self.center

    def rays(self, pixels: Array) -> tuple[Array, Array]:
        """Camera centre (3,) and unit directions (n, 3) in the asset frame."""
        d = np.column_stack([(pixels - self.center) / self.focal, np.ones(len(pixels))])
        d = d @ self.rotation
        return -self.rotation.T @ self.translation, d / np.linalg.norm(d, axis=1)[:, None]


def quad_homography(quad: ArrayLike, width: float, height: float) -> Array:
    """(3, 3) homography from pixels to a `width` x `height` rectangle; quad is TL, TR, BR, BL."""
    import cv2

    target = np.array([[0, 0], [width, 0], [width, height], [0, height]], dtype=np.float32)
    return cv2.getPerspectiveTransform(np.asarray(quad, dtype=np.float32), target).astype(float)


def apply_homography(matrix: ArrayLike, points: ArrayLike) -> Array:
    """(n, 2) points through a (3, 3) homography."""
    p = np.asarray(points, float)
    q = np.column_stack([p, np.ones(len(p))]) @ np.asarray(matrix, float).T
    return q[:, :2] / q[:, 2:]
