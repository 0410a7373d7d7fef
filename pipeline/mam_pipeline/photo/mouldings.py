"""Frames within a panel: mouldings, shaker rails and inlays draw lines that part nothing.

A panel with a moulding shows a second rectangle inside its own, at like margins left and right
and at like margins above and below. A region that holds such a rectangle is credited with what
cutting along its lines would earn, so that the cut no longer pays by itself; what then decides is
the handle (outside the inner rectangle, on the rail) and how few parts explain the front.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
MARGINS = (0.012, 0.28)  # of a moulding: least over the front's side, most over the region's
EVEN = 0.25  # relative difference of two margins that are alike
LIKE = (0.4, 2.5)  # margin left and right over margin above and below
SEEN = 0.7  # least mean support of the four lines
MANY = 400  # spans per direction; a busier front has no mouldings but a pattern


def spans(lines: NDArray[np.int64], side: float) -> NDArray[np.int64]:
    """(k, 4) indices (outer, inner, inner, outer) of line pairs with even margins."""
    n = len(lines)
    out = []
    for i0 in range(n - 3):
        for i1 in range(i0 + 3, n):
            whole = float(lines[i1] - lines[i0])
            for a in range(i0 + 1, i1 - 1):
                left = float(lines[a] - lines[i0])
                if not MARGINS[0] * side <= left <= MARGINS[1] * whole:
                    continue
                right = lines[i1] - lines[a + 1 : i1].astype(float)
                even = np.abs(right - left) <= np.maximum(
                    EVEN * np.maximum(left, right), 0.012 * side
                )
                out += [(i0, a, a + 1 + int(k), i1) for k in np.flatnonzero(even)]
    return np.array(out[:MANY], dtype=np.int64).reshape(-1, 4)


def moulding_credit(
    xs: NDArray[np.int64],
    ys: NDArray[np.int64],
    column: Array,
    row: Array,
    cut: Callable[[Array, Array], Array],
) -> Array:
    """(nx, nx, ny, ny) what the lines of the best inner rectangle of every region would earn.

    Args:
        xs, ys: candidate lines, pixels.
        column: (nx, ny, ny) support of a column between two rows; row: (ny, nx, nx) likewise.
        cut: value of cuts from their support and their share of the front.
    """
    w, h = float(xs[-1]), float(ys[-1])
    credit: Array = np.zeros((len(xs), len(xs), len(ys), len(ys)))
    across, down = spans(xs, max(w, h)), spans(ys, max(w, h))
    if not len(across) or not len(down):
        return credit
    i0, a, b, i1 = (v[:, None] for v in across.T)
    j0, c, d, j1 = (v[None, :] for v in down.T)
    margin = ((xs[a] - xs[i0]) + (xs[i1] - xs[b])) / np.maximum(
        (ys[c] - ys[j0]) + (ys[j1] - ys[d]), 1
    )
    support = (column[a, c, d] + column[b, c, d] + row[c, a, b] + row[d, a, b]) / 4
    ok = (margin > LIKE[0]) & (margin < LIKE[1]) & (support > SEEN)
    p, q = np.nonzero(ok)
    i0, a, b, i1 = across[p].T
    j0, c, d, j1 = down[q].T
    long_y, short_y = (ys[j1] - ys[j0]) / h, (ys[d] - ys[c]) / h
    long_x, short_x = (xs[i1] - xs[i0]) / w, (xs[b] - xs[a]) / w
    value = np.zeros(len(p))
    for line in (a, b):
        inner, outer = cut(column[line, c, d], short_y), cut(column[line, j0, j1], long_y)
        value += np.maximum(inner, outer)
    for line in (c, d):
        inner, outer = cut(row[line, a, b], short_x), cut(row[line, i0, i1], long_x)
        value += np.maximum(inner, outer)
    for _ in range(2):  # a raised field within a frame
        total = value + credit[a, b, c, d]
        np.maximum.at(credit, (i0, i1, j0, j1), total)
    return np.maximum(credit, 0.0)
