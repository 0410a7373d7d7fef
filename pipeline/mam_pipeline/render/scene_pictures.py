"""A lit picture of coloured triangles, with shadows: what a camera without a driver sees."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.render.tracer import Tracer, camera_rays
from mam_pipeline.types import FloatArray, IntArray

LAMP = np.array([-0.5, -0.35, 0.9]) / np.linalg.norm([-0.5, -0.35, 0.9])
"""Unit vector towards the light."""
BACKGROUND = 0.96


def render_scene(
    vertices: FloatArray,
    faces: IntArray,
    face_colors: FloatArray,
    eye: FloatArray,
    target: FloatArray,
    size: tuple[int, int],
    fov: float = 50.0,
) -> NDArray[np.uint8]:
    """Lambert light from one lamp, with a shadow ray for each pixel.

    Args:
        vertices, faces: (V, 3), (F, 3), metres, Z up.
        face_colors: (F, 3), 0..1.
        eye, target: (3,) camera position and the point in the middle of the picture.
        size: width, height in pixels.
        fov: of the picture's width, degrees.

    Returns:
        (H, W, 3) RGB.
    """
    width, height = size
    forward = (target - eye) / np.linalg.norm(target - eye)
    half = float(np.tan(np.radians(fov) / 2)) / width
    tracer = Tracer(vertices, faces)
    seen = tracer.cast(eye, camera_rays(forward, half, width, height))
    start = seen.at + 2e-3 * seen.normal
    dark = tracer.blocked(start, np.broadcast_to(LAMP, start.shape))
    light = 0.45 + 0.55 * np.clip(seen.normal @ LAMP, 0, 1) * np.where(dark, 0.15, 1.0)
    image = np.full((height * width, 3), BACKGROUND)
    image[seen.hit] = np.clip(face_colors[seen.face] * light[:, None], 0, 1)
    return (255 * image.reshape(height, width, 3)).astype(np.uint8)
