"""Cut a front into rows and cells that the user named: exact search over candidate lines."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import groupby

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.photo.handles import Blob
from mam_pipeline.photo.options import Layout, Rows
from mam_pipeline.photo.tiling import SeamMaps

Array = NDArray[np.float64]
Cell = tuple[str, tuple[int, int, int, int]]
Placed = tuple[str, Sequence[float] | Array]  # kind, rectangle
Numbered = tuple[int, Sequence[float] | Array]
OVERLAP = 0.3  # of a panel: so far may two rows or columns run into each other
MARGIN = 0.3  # the outermost panels begin within this share of the front


def cells_of_layout(seams: SeamMaps, blobs: list[Blob], layout: Layout) -> list[Cell]:
    """(kind, (x0, y0, x1, y1)) of every cell of a layout, column by column, rows from the top."""
    w, h = int(seams.xs[-1]), int(seams.ys[-1])
    knobs = [b.center for b in blobs if b.score > 0.5]
    xs = [0, w]
    if len(layout.columns) > 1:
        wide = np.array([max(sum(n for _, n in row) for row in rows) for rows in layout.columns])
        xs = split(_profile(seams.vertical, 0), wide.astype(float), [x for x, _ in knobs])
    out: list[Cell] = []
    for rows, x0, x1 in zip(layout.columns, xs[:-1], xs[1:]):
        inside = [(x - x0, y) for x, y in knobs if x0 < x < x1]
        cells = _cells_of_rows(seams.horizontal[:, x0:x1], seams.vertical[:, x0:x1], inside, rows)
        out += [(kind, (a + x0, y0, b + x0, y1)) for kind, (a, y0, b, y1) in cells]
    return [(k, (max(a, 0), max(c, 0), min(b, w), min(d, h))) for k, (a, c, b, d) in out]


def kinds_of(rows: Rows) -> list[list[str]]:
    """The kind of every cell, row by row."""
    return [[kind for kind, n in row for _ in range(n)] for row in rows]


def _cells_of_rows(
    horizontal: Array, vertical: Array, knobs: list[tuple[float, float]], rows: Rows
) -> list[Cell]:
    """The cells of rows in a window of the front, given the lines and handles in it."""
    kinds = kinds_of(rows)
    doors = [any(k.startswith("door") for k in r) and "drawer" not in r for r in kinds]
    tall = np.where(doors, 1.6, 1.0)
    ys = split(_profile(horizontal, 1), tall, [y for _, y in knobs])
    out: list[Cell] = []
    for row, y0, y1 in zip(kinds, ys[:-1], ys[1:]):
        inside = [x for x, y in knobs if y0 < y < y1]
        xs = split(_profile(vertical[y0:y1], 0), np.ones(len(row)), inside)
        out += [(kind, (a, y0, b, y1)) for kind, a, b in zip(row, xs[:-1], xs[1:])]
    return out


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


def arranged(rectangles: Sequence[Sequence[float] | Array]) -> list[list[list[int]]]:
    """Numbers of rectangles (x0, y0, x1, y1) by column from the left, row from above, and place.

    Empty where they lie neither in rows nor in columns of rows.
    """
    numbered = list(enumerate(rectangles))
    rows = _rows(numbered)
    if rows or not numbered:
        return [rows] if rows else []
    columns = [_rows(column) for column in _apart(numbered, 0)]
    return columns if len(columns) > 1 and all(columns) else []


def layout_text(panels: Sequence[Placed]) -> str:
    """Kinds and rectangles (u0, v0, u1, v1; 0..1 of the front) as `--layout` takes them.

    Empty where the panels lie neither in rows nor in columns of rows.
    """
    columns = arranged([rectangle for _, rectangle in panels])
    kinds = [[[panels[i][0] for i in row] for row in rows] for rows in columns]
    return " | ".join(map(_rows_text, kinds))


def _apart(numbered: Sequence[Numbered], axis: int) -> list[list[Numbered]]:
    """Panels in groups between which a straight line leads all along the front.

    Args:
        axis: 0 for groups from the left, 1 for groups from above.
    """
    out: list[list[Numbered]] = []
    reach = -np.inf
    for panel in sorted(numbered, key=lambda p: p[1][axis] + p[1][axis + 2]):
        low, high = panel[1][axis], panel[1][axis + 2]
        if low > reach - OVERLAP * (high - low):
            out.append([])
        out[-1].append(panel)
        reach = max(reach, high)
    return out


def _rows(numbered: Sequence[Numbered]) -> list[list[int]]:
    """Numbers of the panels of each row, from the left; empty where they lie in no rows."""
    rows = _apart(numbered, 1)
    if any(len(_apart(row, 0)) != len(row) for row in rows):
        return []
    return [[i for i, _ in sorted(row, key=lambda p: p[1][0])] for row in rows]


def _rows_text(rows: Sequence[Sequence[str]]) -> str:
    """Rows of kinds as "2 drawers / 2 doors"."""
    said = [", ".join(_counted(k, len(list(run))) for k, run in groupby(row)) for row in rows]
    if len(said) > 1 and set(said) == {"drawer"}:
        return f"{len(said)} drawers"
    if len(rows) == 1 and len(set(rows[0])) == 1:
        return ", ".join(rows[0])  # "3 drawers" alone would be a stack
    return " / ".join(said)


def _counted(kind: str, count: int) -> str:
    """door-left, 2 -> 2 doors-left."""
    name, dash, side = kind.partition("-")
    many = "s" if name in ("drawer", "door") else ""
    return kind if count == 1 else f"{count} {name}{many}{dash}{side}"
