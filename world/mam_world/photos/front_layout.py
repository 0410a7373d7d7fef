"""Random ways to divide a front, from the kinds that furniture and appliances have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

Box = Sequence[float]  # x0, y0, x1, y1 in pixels


@dataclass(frozen=True)
class FrontCell:
    """A rectangle of a front, in pixels, and what fills it."""

    kind: str  # drawer | door | open | fixed | control
    rect: tuple[float, float, float, float]  # pixels
    hinge: str | None = None


def random_cells(
    rng: np.random.Generator, area: tuple[float, float, float, float]
) -> list[FrontCell]:
    """A random way to divide the front, from the kinds that furniture and appliances have."""
    x0, y0, x1, y1 = area
    w, h = x1 - x0, y1 - y0
    pick = rng.random()
    if pick < 0.16:
        return _appliance(rng, area)
    if pick < 0.36:
        rows = int(rng.integers(1, 7)) if h > 0.5 * w else int(rng.integers(1, 4))
        columns = int(np.clip(round(w / h * rng.uniform(0.4, 2.2)), 1, 4))
        return _grid(rng, area, rows, columns, "drawer")
    if pick < 0.55:
        return _doors(rng, area, int(np.clip(round(w / h * rng.uniform(0.9, 3.0)), 1, 6)))
    if pick < 0.72:  # drawers over or under doors
        share = float(rng.uniform(0.15, 0.45))
        n = int(np.clip(round(w / h * rng.uniform(0.9, 2.5)), 1, 5))
        up = rng.random() < 0.75
        cut = y0 + share * h if up else y1 - share * h
        first, second = (x0, y0, x1, cut), (x0, cut, x1, y1)
        drawers, doors = (first, second) if up else (second, first)
        m = n if rng.random() < 0.6 else int(rng.integers(1, n + 1))
        rows = 1 if rng.random() < 0.8 else 2
        return [*_grid(rng, drawers, rows, m, "drawer"), *_doors(rng, doors, n)]
    return _guillotine(rng, area, 0)


def _guillotine(
    rng: np.random.Generator, area: tuple[float, float, float, float], depth: int
) -> list[FrontCell]:
    x0, y0, x1, y1 = area
    w, h = x1 - x0, y1 - y0
    stop = depth >= 3 or min(w, h) < 70 or (depth > 0 and rng.random() < 0.3)
    if stop:
        kind = rng.random()
        if kind < 0.1:
            return [FrontCell("open", area)]
        if kind < 0.15:
            return [FrontCell("fixed", area)]
        if kind < 0.6 and h < 1.6 * w:
            rows = int(np.clip(round(h / 70 * rng.uniform(0.5, 1.4)), 1, 6))
            return _grid(rng, area, rows, 1, "drawer")
        return _doors(rng, area, 1 if w < 0.9 * h or rng.random() < 0.3 else 2)
    share = float(rng.choice([0.5, 1 / 3, rng.uniform(0.25, 0.75)]))
    if w > h * rng.uniform(0.7, 1.4):
        cut = x0 + share * w
        parts = [(x0, y0, cut, y1), (cut, y0, x1, y1)]
    else:
        cut = y0 + share * h
        parts = [(x0, y0, x1, cut), (x0, cut, x1, y1)]
    return [c for part in parts for c in _guillotine(rng, part, depth + 1)]


def _grid(
    rng: np.random.Generator, area: Box, rows: int, columns: int, kind: str
) -> list[FrontCell]:
    x0, y0, x1, y1 = area

    def split(n: int) -> NDArray[np.float64]:
        parts = np.ones(n) if rng.random() < 0.55 else rng.uniform(0.6, 1.6, n)
        if n > 2 and rng.random() < 0.3:
            parts = np.sort(parts)
        return np.concatenate([[0.0], np.cumsum(parts / parts.sum())])

    xs, ys = x0 + split(columns) * (x1 - x0), y0 + split(rows) * (y1 - y0)
    out = []
    for j in range(rows):
        merged = columns == 2 and rng.random() < 0.12
        for i in range(1 if merged else columns):
            right = xs[-1] if merged else xs[i + 1]
            kind_here = "open" if rng.random() < 0.03 else kind
            out.append(FrontCell(kind_here, (xs[i], ys[j], right, ys[j + 1])))
    return out


def _doors(rng: np.random.Generator, area: Box, n: int) -> list[FrontCell]:
    x0, y0, x1, y1 = area
    xs = np.linspace(x0, x1, n + 1)
    first = int(rng.integers(0, 2))
    out = []
    flap = (x1 - x0) / n > 1.3 * (y1 - y0) and rng.random() < 0.5
    for i in range(n):
        hinge = ("left", "right")[(i + (first if n % 2 else 0)) % 2]
        if flap:
            hinge = str(rng.choice(["bottom", "top"]))
        kind = "door" if rng.random() > 0.03 else "open"
        out.append(FrontCell(kind, (xs[i], y0, xs[i + 1], y1), hinge))
    return out


def _appliance(rng: np.random.Generator, area: Box) -> list[FrontCell]:
    x0, y0, x1, y1 = area
    side = str(rng.choice(["left", "right"]))
    pick = rng.random()
    if pick < 0.4:  # refrigerators
        v = y0 + float(rng.choice([rng.uniform(0.22, 0.42), rng.uniform(0.55, 0.75)])) * (y1 - y0)
        if x1 - x0 > 0.5 * (y1 - y0):
            middle = x0 + float(rng.choice([0.5, 0.42])) * (x1 - x0)
            upper = [FrontCell("door", (x0, y0, middle, v), "left"),
                     FrontCell("door", (middle, y0, x1, v), "right")]  # fmt: skip
            if rng.random() < 0.4:
                return [replace(c, rect=(c.rect[0], y0, c.rect[2], y1)) for c in upper]
            return [*upper, FrontCell("drawer", (x0, v, x1, y1))]
        return [FrontCell("door", (x0, y0, x1, v), side), FrontCell("door", (x0, v, x1, y1), side)]
    if pick < 0.6:  # microwaves
        u = x0 + float(rng.uniform(0.65, 0.85)) * (x1 - x0)
        return [FrontCell("door", (x0, y0, u, y1), "left"), FrontCell("control", (u, y0, x1, y1))]
    v = y0 + float(rng.uniform(0.08, 0.22)) * (y1 - y0)
    low = [FrontCell("door", (x0, v, x1, y1), "bottom")]
    if pick > 0.85:  # a range with a drawer below
        z = y1 - float(rng.uniform(0.12, 0.25)) * (y1 - y0)
        low = [FrontCell("door", (x0, v, x1, z), "bottom"), FrontCell("drawer", (x0, z, x1, y1))]
    return [FrontCell("control", (x0, y0, x1, v)), *low]
