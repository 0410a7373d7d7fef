"""Corners of rectangles, and the true proportions of one from its picture.

The proportions are those of Zhang and He, whiteboard scanning, 2003.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def corners_of(box: Sequence[float]) -> Array:
    """(4, 2) corners TL, TR, BR, BL of a box x0, y0, x1, y1."""
    x0, y0, x1, y1 = box
    return np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], dtype=float)


def upright(quad: Array) -> Array:
    """(4, 2) corners of the box around a quad."""
    return corners_of([*quad.min(axis=0), *quad.max(axis=0)])


def aspect_of_quad(quad: Array, size: tuple[int, int]) -> float:
    """Width over height of a rectangle seen as `quad` (TL, TR, BR, BL) in a picture of `size`.

    Uses the whiteboard formula when perspective suffices, else the mean side lengths.
    """
    plain = _side_ratio(quad)
    center = np.array(size) / 2
    diagonal = float(np.hypot(*size))
    m1, m2, m4, m3 = (np.append((p - center) / diagonal, 1.0) for p in quad)
    k2 = np.cross(m1, m4) @ m3 / (np.cross(m2, m4) @ m3 + 1e-12)
    k3 = np.cross(m1, m4) @ m2 / (np.cross(m3, m4) @ m2 + 1e-12)
    n2, n3 = k2 * m2 - m1, k3 * m3 - m1
    if abs(n2[2] * n3[2]) < 1e-3:
        focal2 = 1.0  # weak perspective: a usual lens
    else:
        focal2 = -(n2[0] * n3[0] + n2[1] * n3[1]) / (n2[2] * n3[2])
    if not 0.25 < focal2 < 12.0:
        focal2 = 1.0
    weight = np.array([1 / focal2, 1 / focal2, 1.0])
    ratio = float(np.sqrt((weight * n2 * n2).sum() / max((weight * n3 * n3).sum(), 1e-12)))
    if not 0.5 * plain < ratio < 2.5 * plain:
        return plain
    return ratio


def _side_ratio(quad: Array) -> float:
    s = np.linalg.norm(np.roll(quad, -1, axis=0) - quad, axis=1)
    return float((s[0] + s[2]) / max(s[1] + s[3], 1e-9))
