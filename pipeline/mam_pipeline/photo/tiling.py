"""Cut a front into panels: the tiling that agrees best with what every place of it votes for.

Each place says how probable it is that it belongs to a panel and where that panel's sides are
(`front_network`). A panel is worth what the places within it say of it: how well it overlaps with
what they vote for. Whatever else there is (frame, shelf, controls) is worth what the places deny.
Of all ways to cut the front from edge to edge, again and again, the best is found exactly:
V(region) = max(panel, rest, V(a) + V(b)).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mam_pipeline.photo.front_network import FrontMaps

Array = NDArray[np.float64]
Index = NDArray[np.int64]
STEP = 2  # every second place votes
LINES = 18  # candidate lines per direction, at most
LEAST_LINE = 0.25  # probability along a part of the front from which a line is a candidate
POOR = 0.2  # overlap that is worth nothing
SIDES = 0.3  # weight of lines along a panel's sides
EACH = 0.004  # of the front: what a panel costs
SMALL = 0.03  # of the front's longer side: no panel is narrower


@dataclass(frozen=True)
class Tile:
    """A panel on the front, or a region without one: box (x0, y0, x1, y1) in front pixels.

    Attributes:
        panel: whether something opens here.
        agreement: mean of probability times overlap of the places within.
    """

    box: tuple[int, int, int, int]
    panel: bool
    agreement: float


@dataclass(frozen=True)
class SeamMaps:
    """Where panels end on a front of (h, w) pixels.

    Attributes:
        vertical, horizontal: (h, w) probability of an upright or a level line at a pixel.
        xs, ys: candidate lines, pixels, the borders 0 and w (h) included.
    """

    vertical: Array
    horizontal: Array
    xs: Index
    ys: Index


def seams_of(maps: FrontMaps) -> SeamMaps:
    """Lines of a front, as large as its picture."""
    size = (maps.width, maps.height)
    vertical, horizontal = (
        np.asarray(cv2.resize(m, size, interpolation=cv2.INTER_LINEAR), np.float64)
        for m in (maps.upright, maps.level)
    )
    return SeamMaps(vertical, horizontal, _candidates(vertical, 1), _candidates(horizontal, 0))


def _candidates(response: Array, axis: int) -> Index:
    """Positions across `axis` of lines that go on over a good part of the front."""
    size, along = response.shape[axis], response.shape[1 - axis]
    score = np.zeros(size)
    for share, weight in ((1.0, 1.2), (0.5, 1.0), (0.25, 0.9), (0.12, 0.8)):
        n = max(5, int(share * along))
        run = ndimage.uniform_filter1d(response, n, axis=1 - axis, mode="constant")
        score = np.maximum(score, weight * run.max(axis=1 - axis))
    score = ndimage.gaussian_filter1d(score, 1.0)
    margin = max(3, round(0.012 * size))
    score[:margin] = score[size - margin :] = 0.0
    apart = max(5, round(0.013 * max(response.shape)))
    chosen: list[int] = []
    for i in np.argsort(-score, kind="stable"):
        if score[i] <= LEAST_LINE or len(chosen) == LINES:
            break
        if all(abs(int(i) - c) >= apart for c in chosen):
            chosen.append(int(i))
    return np.array([0, *sorted(chosen), size], dtype=np.int64)


def best_tiling(maps: FrontMaps, seams: SeamMaps) -> list[Tile]:
    """The regions of the best tiling."""
    xs, ys = seams.xs, seams.ys
    panel, rest, support = _values(maps, seams)
    share = _spans(xs)[:, :, None, None] * _spans(ys)[None, None]
    area = float(xs[-1] * ys[-1])
    narrow = np.minimum(_spans(xs)[:, :, None, None], _spans(ys)[None, None])
    value = panel + SIDES * share / area * (support - 0.5) - EACH
    value = np.where(narrow < SMALL * max(xs[-1], ys[-1]), -9.0, value)
    choice = _best_cuts(np.maximum(value, rest))
    out = []
    stack = [(0, len(xs) - 1, 0, len(ys) - 1)]
    while stack:
        i0, i1, j0, j1 = stack.pop()
        c = int(choice[i0, i1, j0, j1])
        if c > 0:
            stack += [(i0, c, j0, j1), (c, i1, j0, j1)]
        elif c < 0:
            stack += [(i0, i1, j0, -c), (i0, i1, -c, j1)]
        else:
            box = (int(xs[i0]), int(ys[j0]), int(xs[i1]), int(ys[j1]))
            opens = bool(value[i0, i1, j0, j1] > rest[i0, i1, j0, j1])
            mean = float(panel[i0, i1, j0, j1] * area / share[i0, i1, j0, j1])
            out.append(Tile(box, opens, mean))
    return out


def _spans(lines: Index) -> Array:
    return np.asarray(lines[None, :] - lines[:, None], np.float64)


def _values(maps: FrontMaps, seams: SeamMaps) -> tuple[Array, Array, Array]:
    """What every region (i0, i1, j0, j1) is worth as a panel and as anything else, as shares of
    the front, and the mean line support of its four sides."""
    xs, ys = seams.xs.astype(float), seams.ys.astype(float)
    h, w = maps.handle.shape
    row, column = np.mgrid[STEP // 2 : h : STEP, STEP // 2 : w : STEP].reshape(2, -1)
    to_x, to_y = xs[-1] / w, ys[-1] / h
    x, y = (column + 0.5) * to_x, (row + 0.5) * to_y
    left, up, right, down = maps.reach[:, row, column].astype(float)
    belongs = 1.0 - maps.kind[0, row, column].astype(float)
    voted_x = _common(xs, x - left * to_x, x + right * to_x)
    voted_y = _common(ys, y - up * to_y, y + down * to_y)
    area = (left + right) * (up + down) * to_x * to_y
    in_x, in_y = _within(xs, x), _within(ys, y)
    shape = (len(xs), len(xs), len(ys), len(ys))
    panel, rest = np.full(shape, -9.0), np.full(shape, -9.0)
    for i0 in range(len(xs)):
        for i1 in range(i0 + 1, len(xs)):
            here = np.flatnonzero(in_x[i0, i1])
            common = voted_x[i0, i1, here] * voted_y[:, :, here]
            mine = (xs[i1] - xs[i0]) * _spans(seams.ys)[:, :, None]
            overlap = common / (area[here] + mine - common + 1e-9)
            good = np.clip((overlap - POOR) / (1 - POOR), -1.0, 1.0)
            inside = in_y[:, :, here]
            panel[i0, i1] = (inside * belongs[here] * good).sum(axis=-1) / len(x)
            rest[i0, i1] = (inside * (1 - belongs[here])).sum(axis=-1) / len(x)
    return panel, rest, _side_support(seams)


def _common(lines: Array, low: Array, high: Array) -> Array:
    """(n, n, votes) length that the spans of lines share with each vote's span."""
    ends = np.minimum(lines[None, :, None], high) - np.maximum(lines[:, None, None], low)
    return np.clip(ends, 0.0, None)


def _within(lines: Array, at: Array) -> NDArray[np.bool_]:
    return (at >= lines[:, None, None]) & (at < lines[None, :, None])


def _side_support(seams: SeamMaps) -> Array:
    """(nx, nx, ny, ny) mean probability of a line along the sides of every region."""
    xs, ys = seams.xs, seams.ys
    h, w = seams.vertical.shape
    wide = ndimage.maximum_filter1d(seams.vertical, 5, axis=1)[:, np.minimum(xs, w - 1)].T
    high = ndimage.maximum_filter1d(seams.horizontal, 5, axis=0)[np.minimum(ys, h - 1)]
    down, across = (np.pad(np.cumsum(m, axis=1), ((0, 0), (1, 0))) for m in (wide, high))
    column = (down[:, ys][:, None, :] - down[:, ys][:, :, None]) / np.maximum(_spans(ys), 1)
    row = (across[:, xs][:, None, :] - across[:, xs][:, :, None]) / np.maximum(_spans(xs), 1)
    level = row.transpose(1, 2, 0)  # (i0, i1, j)
    sides = column[:, None] + column[None] + level[:, :, :, None] + level[:, :, None, :]
    return np.asarray(0.25 * sides, np.float64)


def _best_cuts(value: Array) -> NDArray[np.int16]:
    """The best cut of every region: 0 none, +i at column i, -j at row j."""
    nx, _, ny, _ = value.shape
    best, choice = value.copy(), np.zeros(value.shape, np.int16)
    for dx in range(1, nx):
        for dy in range(1, ny):
            i0, j0 = np.arange(nx - dx)[:, None], np.arange(ny - dy)[None, :]
            i1, j1 = i0 + dx, j0 + dy
            top = best[i0, i1, j0, j1]
            pick = np.zeros(top.shape, np.int16)
            for c in [*range(1, dx), *range(-1, -dy, -1)]:
                if c > 0:
                    parts = best[i0, i0 + c, j0, j1] + best[i0 + c, i1, j0, j1]
                else:
                    parts = best[i0, i1, j0, j0 - c] + best[i0, i1, j0 - c, j1]
                better = parts > top + 1e-9
                top = np.where(better, parts, top)
                pick = np.where(better, i0 + c if c > 0 else c - j0, pick).astype(np.int16)
            best[i0, i1, j0, j1], choice[i0, i1, j0, j1] = top, pick
    return choice
