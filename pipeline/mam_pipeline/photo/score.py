"""Places on a photo, compared: the overlap of quadrilaterals, and which of them are the same."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment
from shapely.geometry import Polygon

from mam_pipeline.photo.camera import apply_homography, quad_homography

Array = NDArray[np.float64]
Rect = tuple[float, float, float, float]
"""u0, v0, u1, v1 in front coordinates: 0..1 of the front, u to the viewer's right, v downwards."""


def polygon_iou(a: Array, b: Array) -> float:
    """IoU of two convex quadrilaterals (4, 2); 0 where the sides of one cross."""
    one, two = Polygon(a), Polygon(b)
    if not (one.is_valid and two.is_valid):
        return 0.0
    common = one.intersection(two).area
    return float(common / max(one.area + two.area - common, 1e-12))


def rect_quad(rect: Rect, front: Array) -> Array:
    """(4, 2) pixels of a front-coordinate rectangle on a front quad."""
    u0, v0, u1, v1 = rect
    back = np.linalg.inv(quad_homography(front, 1.0, 1.0))
    return apply_homography(back, [(u0, v0), (u1, v0), (u1, v1), (u0, v1)])


def match(iou: Array, threshold: float) -> list[tuple[int, int]]:
    """One-to-one (truth, found) pairs of greatest total IoU, of at least `threshold`."""
    if iou.size == 0:
        return []
    rows, columns = linear_sum_assignment(-np.where(iou >= threshold, iou, 0.0))
    return [(int(r), int(c)) for r, c in zip(rows, columns) if iou[r, c] >= threshold]
