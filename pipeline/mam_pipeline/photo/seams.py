"""Where panels may end: graded, oriented seam maps of the rectified front and candidate lines."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Seams:
    """Seam evidence on a front of (h, w) pixels.

    Attributes:
        vertical, horizontal: (h, w) 0..1 evidence for a vertical / horizontal line at a pixel.
        xs, ys: candidate line positions, pixels, the borders 0 and w (h) included.
    """

    vertical: Array
    horizontal: Array
    xs: NDArray[np.int64]
    ys: NDArray[np.int64]
    calm: Array  # (h, w) 1 on plain surfaces, 0 inside fabrics and ornaments

    def support_x(self) -> Array:
        """(len(xs), h + 1) cumulative support down each candidate column."""
        best = _widen(self.vertical, 2, axis=1)
        columns = best[:, np.clip(self.xs, 0, best.shape[1] - 1)].T
        return np.concatenate([np.zeros((len(columns), 1)), np.cumsum(columns, axis=1)], axis=1)

    def support_y(self) -> Array:
        """(len(ys), w + 1) cumulative support along each candidate row."""
        best = _widen(self.horizontal, 2, axis=0)
        rows = best[np.clip(self.ys, 0, best.shape[0] - 1)]
        return np.concatenate([np.zeros((len(rows), 1)), np.cumsum(rows, axis=1)], axis=1)


def _widen(response: Array, reach: int, axis: int) -> Array:
    return ndimage.maximum_filter1d(response, 2 * reach + 1, axis=axis)


def seam_response(lab: Array, axis: int) -> tuple[Array, Array]:
    """Evidence 0..1 for lines across `axis` (1: vertical lines), from steps and dark grooves.

    Also the same before it is cut off at 1, up to 4: where two lines are close the stronger shows.
    """
    along = 1 - axis
    soft = ndimage.gaussian_filter1d(lab, 1.0, axis=axis)
    soft = ndimage.uniform_filter1d(soft, 5, axis=along)
    step = np.abs(ndimage.correlate1d(soft, [-1, -1, 0, 1, 1], axis=axis)).max(axis=2) / 2
    light = soft[..., 0]
    groove = np.zeros_like(light)
    for reach in (3, 5):
        before, after = np.roll(light, reach, axis), np.roll(light, -reach, axis)
        groove = np.maximum(groove, np.minimum(before, after) - light)
        groove = np.maximum(groove, 0.7 * (light - np.maximum(before, after)))
    other = np.abs(ndimage.correlate1d(soft, [-1, -1, 0, 1, 1], axis=along)).max(axis=2) / 2
    other = ndimage.uniform_filter1d(other, 5, axis=axis)
    value = np.maximum(step, 1.6 * groove) - 0.5 * other
    noise = np.percentile(value[value > 0], 70) if (value > 0).any() else 0.0
    level = np.clip(1.5 * noise + 1.5, 2.6, 10.0)  # what grain and noise reach is no seam
    strength = np.clip((value - 0.35 * level) / (0.65 * level), 0.0, 4.0)
    graded = np.minimum(strength, 1.0)
    # a seam goes on: bridge short breaks, drop short bits
    graded = ndimage.grey_closing(graded, size=(1, 13) if along == 1 else (13, 1))
    return ndimage.uniform_filter1d(graded, 9, axis=along), strength


def calm_share(vertical: Array, horizontal: Array) -> Array:
    """1 on plain surfaces, towards 0 inside fabrics, weaves and ornaments.

    There lines of both directions are dense; a seam is alone on at least one side.
    """
    side = max(vertical.shape)
    both = np.minimum(_widen(vertical, 2, 1), _widen(horizontal, 2, 0))
    n = max(9, round(0.05 * side))
    density = ndimage.uniform_filter(both, n)
    # the calmest window that touches the pixel decides, so that a weave's own frame survives
    density = ndimage.minimum_filter(density, max(3, n // 2))
    return np.clip(1.0 - (density - 0.22) / 0.25, 0.0, 1.0)


def line_response(rgb: NDArray[np.uint8]) -> tuple[Array, Array]:
    """Vertical and horizontal evidence from straight segments, which do not depend on contrast."""
    h, w = rgb.shape[:2]
    grey = cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY)
    grey = cv2.createCLAHE(2.0, (6, 6)).apply(grey)
    found = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD).detect(grey)[0]
    out = [np.zeros((h, w), np.float32), np.zeros((h, w), np.float32)]
    ends = np.zeros((0, 4)) if found is None else found.reshape(-1, 4)
    length = np.hypot(ends[:, 2] - ends[:, 0], ends[:, 3] - ends[:, 1])
    for k in np.argsort(length, kind="stable"):  # the longest last: it is drawn over the others
        x0, y0, x1, y1 = (float(v) for v in ends[k])
        if length[k] < 0.03 * max(h, w):
            continue
        slope = min(abs(x1 - x0), abs(y1 - y0)) / float(length[k])
        if slope > 0.045:
            continue
        canvas = out[0] if abs(y1 - y0) > abs(x1 - x0) else out[1]
        value = min(0.95, 0.35 + 2.2 * float(length[k]) / max(h, w))
        cv2.line(canvas, (round(x0), round(y0)), (round(x1), round(y1)), value, 1)
    return out[0].astype(np.float64), out[1].astype(np.float64)


def candidates(
    response: Array, strength: Array, axis: int, keep: int = 18
) -> NDArray[np.int64]:
    """Positions along `axis` of lines with long support somewhere, borders included."""
    size = response.shape[axis]
    along = 1 - axis
    wide = _widen(response, 1, axis=axis)
    length = response.shape[along]
    score = np.zeros(size)
    power = np.zeros(size)
    for share, weight in ((1.0, 1.2), (0.5, 1.0), (0.3, 0.9), (0.18, 0.75)):
        n = max(5, int(share * length))
        run = ndimage.uniform_filter1d(wide, n, axis=along, mode="constant")
        score = np.maximum(score, weight * run.max(axis=along))
        run = ndimage.uniform_filter1d(strength, n, axis=along, mode="constant")
        power = np.maximum(power, weight * run.max(axis=along))
    # a wide moulding answers with a plateau: its middle stands for it, not each of its pixels
    score = ndimage.gaussian_filter1d(score, 0.8)
    order_by = score + 0.3 * ndimage.gaussian_filter1d(power, 1.0)
    apart = max(5, round(0.013 * max(response.shape)))
    margin = max(3, round(0.012 * size))
    order_by[:margin] = order_by[size - margin :] = 0.0
    chosen: list[int] = []
    for i in np.argsort(-order_by, kind="stable"):
        if score[i] <= 0.4 or len(chosen) == keep or order_by[i] == 0.0:
            break
        if all(abs(int(i) - c) >= apart for c in chosen):
            chosen.append(int(i))
    return np.array([0, *sorted(chosen), size], dtype=np.int64)


def find_seams(rgb: NDArray[np.uint8]) -> Seams:
    """Seam maps and candidate lines of a rectified front (h, w, 3)."""
    lab = cv2.cvtColor(rgb.astype(np.float32) / 255.0, cv2.COLOR_RGB2LAB).astype(np.float64)
    (vertical, strong_v), (horizontal, strong_h) = seam_response(lab, 1), seam_response(lab, 0)
    lines_v, lines_h = line_response(rgb)
    calm = calm_share(vertical, horizontal)
    vertical = np.maximum(vertical, lines_v) * calm
    horizontal = np.maximum(horizontal, lines_h) * calm
    xs = candidates(vertical, strong_v * calm, 1)
    ys = candidates(horizontal, strong_h * calm, 0)
    return Seams(vertical, horizontal, xs, ys, calm)
