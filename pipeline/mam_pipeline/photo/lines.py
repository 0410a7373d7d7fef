"""Straight line segments of a photo and distance maps to them by orientation."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Array = NDArray[np.float64]
BINS = 12
HUE_GAIN = 2.5  # contrast of the colour channels against lightness


@dataclass(frozen=True)
class Segments:
    """(n, 4) x0, y0, x1, y1 in pixels, with (n,) lengths; longest first."""

    ends: Array
    length: Array

    @property
    def middle(self) -> Array:
        """(n, 2) midpoints."""
        return (self.ends[:, :2] + self.ends[:, 2:]) / 2

    @property
    def direction(self) -> Array:
        """(n, 2) unit directions."""
        return (self.ends[:, 2:] - self.ends[:, :2]) / self.length[:, None]


def _clear(grey: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.asarray(cv2.createCLAHE(1.5, (8, 8)).apply(grey), np.uint8)


def _lsd(grey: NDArray[np.uint8]) -> Array:
    found = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD).detect(grey)[0]
    return np.zeros((0, 4)) if found is None else found.reshape(-1, 4).astype(np.float64)


def find_segments(rgb: NDArray[np.uint8], keep: int = 240) -> Segments:
    """The `keep` longest LSD segments of a photo: of its lightness, and of its colours.

    Colours are looked at in half the size, where the grain of a photo is gone: an object often
    differs from its wall in hue alone.
    """
    half = cv2.resize(rgb, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    lab = cv2.cvtColor(half, cv2.COLOR_RGB2LAB).astype(np.float32)
    hues = np.clip((lab[..., 1:] - 128) * HUE_GAIN + 128, 0, 255).astype(np.uint8)
    ends = np.vstack(
        [
            _lsd(_clear(lab[..., 0].astype(np.uint8))) * 2 + 0.5,
            *(_lsd(np.ascontiguousarray(hues[..., i])) * 2 + 0.5 for i in range(2)),
        ]
    )
    length = np.hypot(ends[:, 2] - ends[:, 0], ends[:, 3] - ends[:, 1])
    good = length > 0.012 * max(rgb.shape[:2])
    ends, length = ends[good], length[good]
    order = np.argsort(-length, kind="stable")[:keep]
    return Segments(ends[order], length[order])


def on_mask(segments: Segments, mask: Array) -> NDArray[np.bool_]:
    """(n,) whether a segment's middle lies on the dilated mask (h, w)."""
    if not len(segments.length):
        return np.zeros(0, bool)
    reach = max(1, round(0.01 * max(mask.shape)))
    wide = ndimage.binary_dilation(mask[::2, ::2] > 0.5, iterations=reach)
    x = np.clip(segments.middle[:, 0] / 2, 0, wide.shape[1] - 1).astype(int)
    y = np.clip(segments.middle[:, 1] / 2, 0, wide.shape[0] - 1).astype(int)
    return wide[y, x]


@dataclass(frozen=True)
class EdgeMaps:
    """(BINS, h, w) clipped distances to segments of like orientation, 0 (on one) .. 1 (far)."""

    maps: NDArray[np.float32]
    scale: float

    def look_up(self, points: Array, angle: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Distance 0..1 at (..., 2) pixels for line angle (...), and which are in the picture."""
        _, h, w = self.maps.shape
        x = np.floor(points[..., 0] * self.scale).astype(np.int64)
        y = np.floor(points[..., 1] * self.scale).astype(np.int64)
        inside = (x >= 0) & (y >= 0) & (x < w) & (y < h)
        k = np.round(angle / np.pi * BINS).astype(np.int64) % BINS
        value = self.maps[k, np.clip(y, 0, h - 1), np.clip(x, 0, w - 1)]
        return value.astype(np.float64), inside


def edge_maps(segments: Segments, size: tuple[int, int], side: int = 400) -> EdgeMaps:
    """Build orientation-wise distance maps at a reduced size."""
    scale = side / max(size)
    w, h = max(8, round(size[0] * scale)), max(8, round(size[1] * scale))
    reach = 0.022 * side
    angle = np.arctan2(segments.direction[:, 1], segments.direction[:, 0]) % np.pi
    maps = np.ones((BINS, h, w), dtype=np.float32)
    for k in range(BINS):
        off = np.abs((angle - k * np.pi / BINS + np.pi / 2) % np.pi - np.pi / 2)
        canvas = np.full((h, w), 255, np.uint8)
        for x0, y0, x1, y1 in segments.ends[off < 0.95 * np.pi / BINS] * scale * 16:
            cv2.line(canvas, (int(x0), int(y0)), (int(x1), int(y1)), 0, 1, cv2.LINE_8, 4)
        if (canvas == 0).any():
            distance = cv2.distanceTransform(canvas, cv2.DIST_L2, 3)
            maps[k] = np.minimum(distance / reach, 1.0)
    return EdgeMaps(maps, scale)
