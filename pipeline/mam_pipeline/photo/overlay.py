"""Pictures that show what was found: the box and panels over the photo, and the marked front."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from mam_pipeline.photo.camera import apply_homography, quad_homography
from mam_pipeline.photo.front import FrontReading
from mam_pipeline.photo.image import Photo
from mam_pipeline.photo.quad import corners_of

Array = NDArray[np.float64]
COLORS = {
    "drawer": (40, 200, 60), "door": (40, 120, 255), "open": (160, 160, 160),
    "fixed": (230, 200, 40),
}  # fmt: skip
BOX = (255, 60, 40)
HANDLE = (255, 0, 255)


def _lines(
    image: NDArray[np.uint8], points: Array, color: tuple[int, int, int], width: int
) -> None:
    near = np.clip(points, -4000, 4000)
    cv2.polylines(image, [np.round(near * 16).astype(np.int32)], True, color, width, cv2.LINE_AA, 4)


def draw_overlay(
    photo: Photo,
    faces: list[Array],
    quad: Array | None,
    reading: FrontReading | None,
    title: str = "",
) -> NDArray[np.uint8]:
    """The photo with box (red), drawers (green), doors (blue), open cells, handles (magenta)."""
    image = photo.small.copy()
    for face in faces:
        _lines(image, face, BOX, 2)
    if quad is not None and reading is not None:
        h, w = reading.image.shape[:2]
        back = np.linalg.inv(quad_homography(quad, w, h))
        for panel in reading.panels:
            x0, y0, x1, y1 = panel.box
            inner = (x0 + 2, y0 + 2, x1 - 2, y1 - 2)
            _lines(image, apply_homography(back, corners_of(inner)), COLORS[panel.kind], 2)
            for handle in panel.handles:
                thick = 2 if handle.provenance == "observed" else 1
                _lines(image, apply_homography(back, corners_of(handle.box)), HANDLE, thick)
    return _captioned(image, title)


def draw_front(reading: FrontReading) -> NDArray[np.uint8]:
    """The rectified front with panels, kinds, hinge sides and handles."""
    image = reading.image.copy()
    for panel in reading.panels:
        x0, y0, x1, y1 = panel.box
        _lines(image, corners_of((x0 + 2, y0 + 2, x1 - 2, y1 - 2)), COLORS[panel.kind], 2)
        word = panel.kind + (f" {panel.hinge_side}" if panel.hinge_side else "")
        label = f"{word} {panel.confidence:.2f}"
        cv2.putText(image, label, (int(x0) + 6, int(y0) + 18), 0, 0.42, (0, 0, 0), 3, cv2.LINE_AA)
        color = (255, 255, 255)
        cv2.putText(image, label, (int(x0) + 6, int(y0) + 18), 0, 0.42, color, 1, cv2.LINE_AA)
        for handle in panel.handles:
            _lines(
                image, corners_of(handle.box), HANDLE, 2 if handle.provenance == "observed" else 1
            )
    return image


def _captioned(image: NDArray[np.uint8], title: str) -> NDArray[np.uint8]:
    if not title:
        return image
    bar = np.full((26, image.shape[1], 3), 30, np.uint8)
    cv2.putText(bar, title, (6, 18), 0, 0.45, (255, 255, 255), 1, cv2.LINE_AA)
    return np.vstack([image, bar])
