"""Cut a front into rows and cells that the user named: exact search over candidate lines."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.photo.handles import Blob
from mam_pipeline.photo.options import Layout
from mam_pipeline.photo.seams import Seams

Array = NDArray[np.float64]
Cell = tuple[str, tuple[int, int, int, int]]
SAME_ROW = 0.03  # of the height: middles of panels in one row are nearer
MARGIN = 0.3  # the outermost panels begin within this share of the front


def cells_of_layout(seams: Seams, blobs: list[Blob], layout: Layout) -> list[Cell]:
    """(kind, (x0, y0, x1, y1)) of every cell of a layout, rows from the top."""
    w, h = int(seams.xs[-1]), int(seams.ys[-1])
    rows = [[kind for kind, n in row for _ in range(n)] for row in layout]
    marks = [b.center[1] for b in blobs if b.score > 0.5]
    support_y = _profile(seams.horizontal, 1)
    tall = np.array([1.6 if "door" in r and "drawer" not in r else 1.0 for r in rows])
    ys = split(support_y, tall, marks)
    out: list[Cell] = []
    for row, y0, y1 in zip(rows, ys[:-1], ys[1:]):
        support = _profile(seams.vertical[y0:y1], 0)
        inside = [b.center[0] for b in blobs if b.score > 0.5 and y0 < b.center[1] < y1]
        wide = np.ones(len(row))
        xs = split(support, wide, inside)
        out += [(kind, (a, y0, b, y1)) for kind, a, b in zip(row, xs[:-1], xs[1:])]
    return [(k, (max(a, 0), max(c, 0), min(b, w), min(d, h))) for k, (a, c, b, d) in out]


def _profile(response: Array, axis: int) -> Array:
    """Mean line support at each position across `axis`, tolerant to a pixel or two."""
    mean = response.mean(axis=axis)
    padded = np.pad(mean, 2)
    return np.max([padded[k : k + len(mean)] for k in range(5)], axis=0)


def split(support: Array, shares: Array, marks: list[float]) -> list[int]:
    """Boundaries of len(shares) cells along one direction.

    Maximises line support at the boundaries, near-proportional sizes, and one handle row or
    column (`marks`) inside each cell.
    """
    n, size = len(shares), len(support)
    step = max(1, size // 160)
    grid = np.arange(0, size + 1, step)
    gain = np.array([support[max(0, g - step) : g + step + 1].max(initial=0.0) for g in grid])
    edge = np.minimum(grid, size - grid) < 0.012 * size
    gain = np.where(edge, 0.55, gain)
    ideal = shares / shares.sum() * size
    points = np.sort(np.array(marks))
    count = np.searchsorted(points, grid)
    best = np.full((n + 1, len(grid)), -np.inf)
    back = np.zeros((n + 1, len(grid)), int)
    best[0] = np.where(grid < MARGIN * size, gain - 0.6 * grid / size, -np.inf)
    length = grid[None, :] - grid[:, None]
    has = np.minimum(count[None, :] - count[:, None], 1)
    for k in range(n):
        regular = np.log(np.maximum(length, 1) / ideal[k])
        value = gain[None, :] - 0.5 * np.clip(regular**2, 0, 4) + (0.35 * has if marks else 0.0)
        value = np.where(length > 0.15 * ideal[k], value, -np.inf)
        total = best[k][:, None] + value
        back[k + 1] = total.argmax(axis=0)
        best[k + 1] = total.max(axis=0)
    last = best[n] - 0.6 * (size - grid) / size
    last = np.where(grid > (1 - MARGIN) * size, last, -np.inf)
    at = int(last.argmax())
    path = [at]
    for k in range(n, 0, -1):
        at = int(back[k, at])
        path.append(at)
    return [int(grid[i]) for i in reversed(path)]


def rows_text(panels: Sequence[tuple[str, Sequence[float] | Array]]) -> str:
    """Kinds and rectangles (u0, v0, u1, v1; 0..1 of the front) as "2 drawers / 2 doors".

    Empty where the panels do not lie in rows.
    """
    rows: list[list[tuple[str, Sequence[float] | Array]]] = []
    for panel in sorted(panels, key=lambda p: p[1][1] + p[1][3]):
        middle = (panel[1][1] + panel[1][3]) / 2
        if rows and abs((rows[-1][0][1][1] + rows[-1][0][1][3]) / 2 - middle) < SAME_ROW:
            rows[-1].append(panel)
        else:
            rows.append([panel])
    lows = [min(box[1] for _, box in row) for row in rows]
    highs = [max(box[3] for _, box in row) for row in rows]
    if any(low < high - SAME_ROW for low, high in zip(lows[1:], highs)):
        return ""
    said = []
    for row in rows:
        kinds = [kind for kind, _ in sorted(row, key=lambda p: p[1][0])]
        cells = []
        for kind, run in groupby(kinds):
            n = len(list(run))
            many = "s" if n > 1 and kind in ("drawer", "door") else ""
            cells.append(kind if n == 1 else f"{n} {kind}{many}")
        said.append(", ".join(cells))
    if len(said) > 1 and set(said) == {"drawer"}:
        return f"{len(said)} drawers"
    if len(rows) == 1 and len(rows[0]) > 1 and "," not in said[0]:
        said = [", ".join([rows[0][0][0]] * len(rows[0]))]  # "3 drawers" alone would be a stack
    return " / ".join(said)
