"""Cut the rectified front into panels: the best guillotine partition by exact dynamic programming.

Every region between two candidate columns and two candidate rows is valued once: as a leaf
(panel, frame strip) or as the best cut into two. V(region) = max(leaf, V(a) + V(b) + cut).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.photo.handles import Blob
from mam_pipeline.photo.mouldings import moulding_credit
from mam_pipeline.photo.seams import Seams

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Leaf:
    """A region of the partition in front pixels (x0, y0, x1, y1); `kind` panel | frame."""

    box: tuple[int, int, int, int]
    kind: str
    sides: tuple[float, float, float, float]  # seam support left, top, right, bottom
    handles: tuple[int, ...] = ()


@dataclass(frozen=True)
class Partition:
    """The best partition and its value per leaf against not cutting at all."""

    leaves: tuple[Leaf, ...]
    value: float


@dataclass(frozen=True)
class Weights:
    """Values of the partition's terms, tuned on the synthetic benchmark."""

    needed: float = 0.8
    gain: float = 1.0
    cut: float = 0.2
    one_handle: float = 0.55
    no_handle: float = -0.16
    many_handles: float = -0.25
    frame: float = -0.06
    lost_handle: float = -0.45
    thin: float = 0.075
    moulding: float = 1.0
    whole: float = -0.3  # a front frame around one panel is likelier than a moulding of it


class _Regions:
    """Seam support and handle counts of every region spanned by candidate lines."""

    def __init__(self, seams: Seams, blobs: list[Blob], weights: Weights) -> None:
        self.xs, self.ys = seams.xs, seams.ys
        self.w, self.h = int(seams.xs[-1]), int(seams.ys[-1])
        self.weights = weights
        sx, sy = seams.support_x(), seams.support_y()
        # mean support of column i between rows j0..j1, and of row j between columns i0..i1
        span_y = np.maximum(self.ys[None, :] - self.ys[:, None], 1)
        span_x = np.maximum(self.xs[None, :] - self.xs[:, None], 1)
        self.column = (sx[:, self.ys][:, None, :] - sx[:, self.ys][:, :, None]) / span_y[None]
        self.row = (sy[:, self.xs][:, None, :] - sy[:, self.xs][:, :, None]) / span_x[None]
        self.column[[0, -1]] = 0.85  # the outline is known
        self.row[[0, -1]] = 0.85
        self.leaf, self.kind = self._leaves(blobs)

    def _leaves(self, blobs: list[Blob]) -> tuple[Array, NDArray[np.int8]]:
        """Leaf value and kind (1 panel, 0 frame) for all (i0, i1, j0, j1)."""
        k = self.weights
        xs, ys = self.xs.astype(float), self.ys.astype(float)
        expected: Array = np.zeros((len(xs), len(xs), len(ys), len(ys)))  # handles
        none: Array = np.ones_like(expected)
        single: Array = np.zeros_like(expected)
        for b in (b for b in blobs if b.score > 0.15):
            x, y = b.center
            inside_x = (xs[:, None] < x) & (xs[None, :] > x)
            inside_y = (ys[:, None] < y) & (ys[None, :] > y)
            inside = inside_x[:, :, None, None] & inside_y[None, None]
            p = b.score
            single = np.where(inside, single * (1 - p) + none * p, single)
            none = np.where(inside, none * (1 - p), none)
            expected += inside * p
        width = xs[None, :] - xs[:, None]
        height = ys[None, :] - ys[:, None]
        w4, h4 = width[:, :, None, None], height[None, None]
        # a symmetric pair on a wide panel counts like one handle
        pair = self._pairs(blobs, xs, ys)
        one = np.maximum(single, pair)
        many = np.clip(1 - none - one, 0, 1)
        panel = (
            one * k.one_handle + none * k.no_handle + many * k.many_handles * (1 + 0.3 * expected)
        )
        across = self.row.transpose(1, 2, 0)  # (i0, i1, j)
        side = 0.25 * (
            self.column[:, None] + self.column[None, :]
            + across[:, :, :, None] + across[:, :, None, :]
        )  # fmt: skip
        panel = panel + 0.5 * (side - 0.8)
        panel = panel + (1 - many) * self._mouldings()  # one panel has one handle or a pair
        small = (np.minimum(w4 / self.w, 1e9) < 0.1) | (h4 / self.h < 0.05)
        panel = panel - 0.6 * small
        ratio = np.abs(np.log(np.maximum(w4, 1) / np.maximum(h4, 1)))
        panel = panel - 0.3 * np.clip(ratio - np.log(6.0), 0, None)
        unit = min(self.w, self.h)
        thin = np.minimum(w4, h4) < k.thin * unit * 1.6
        frame = np.where(thin, k.frame + k.lost_handle * expected, -9.0)
        frame = frame - 0.25 * np.clip(np.minimum(w4, h4) / (k.thin * unit) - 1.0, 0, None)
        bad = (w4 <= 0) | (h4 <= 0)
        leaf = np.where(bad, -99.0, np.maximum(panel, frame))
        return leaf, (panel >= frame).astype(np.int8)

    def _mouldings(self) -> Array:
        """Credit of every region for the lines of a moulding within it."""
        k = self.weights
        credit = moulding_credit(
            self.xs, self.ys, self.column, self.row, lambda s, share: _cut_value(s, share, k)
        )
        left, right = np.arange(len(self.xs)) == 0, np.arange(len(self.xs)) == len(self.xs) - 1
        top, bottom = np.arange(len(self.ys)) == 0, np.arange(len(self.ys)) == len(self.ys) - 1
        touched = (left[:, None].astype(int) + right[None])[:, :, None, None] + (
            top[:, None].astype(int) + bottom[None]
        )
        return k.moulding * credit + k.whole * ((touched >= 4) & (credit > 0))

    def _pairs(self, blobs: list[Blob], xs: Array, ys: Array) -> Array:
        """Probability that a region holds exactly a mirror-symmetric pair of like handles."""
        out: Array = np.zeros((len(xs), len(xs), len(ys), len(ys)))
        strong = [b for b in blobs if b.score > 0.35][:24]
        for a in range(len(strong)):
            for b in range(a + 1, len(strong)):
                p, q = strong[a], strong[b]
                if abs(p.center[1] - q.center[1]) > 0.02 * self.h + 2:
                    continue
                if np.abs(np.log(np.array(p.size) / np.array(q.size))).max() > 0.4:
                    continue
                mid = (p.center[0] + q.center[0]) / 2
                low, high = min(p.center[0], q.center[0]), max(p.center[0], q.center[0])
                middle = (xs[:, None] + xs[None, :]) / 2
                width = xs[None, :] - xs[:, None]
                ok = (np.abs(middle - mid) < 0.05 * np.maximum(width, 1)) & (xs[:, None] < low)
                ok &= (xs[None, :] > high) & (high - low > 0.3 * width)
                y = p.center[1]
                okay = ok[:, :, None, None] & ((ys[:, None] < y) & (ys[None, :] > y))[None, None]
                out = np.where(okay, np.maximum(out, p.score * q.score), out)
        return out


def _cut_value(support: Array, share: Array, k: Weights) -> Array:
    return k.gain * share * (support - k.needed) / (1 - k.needed) - k.cut


def _best_cuts(r: _Regions, k: Weights) -> tuple[Array, NDArray[np.int16]]:
    """Value of every region, and its best cut: 0 none, +i at column i, -j at row j."""
    nx, ny = len(r.xs), len(r.ys)
    value = r.leaf.copy()
    choice = np.zeros(value.shape, np.int16)
    for dx in range(1, nx):
        for dy in range(1, ny):
            if dx == 1 and dy == 1:
                continue
            i0 = np.arange(nx - dx)[:, None]
            j0 = np.arange(ny - dy)[None, :]
            i1, j1 = i0 + dx, j0 + dy
            best = value[i0, i1, j0, j1]
            pick = np.zeros(best.shape, np.int16)
            share_y = (r.ys[j1] - r.ys[j0]) / r.h
            share_x = (r.xs[i1] - r.xs[i0]) / r.w
            for c in range(1, dx):
                i = i0 + c
                cut = _cut_value(r.column[i, j0, j1], share_y, k)
                v = value[i0, i, j0, j1] + value[i, i1, j0, j1] + cut
                better = v > best
                best, pick = np.where(better, v, best), np.where(better, i, pick)
            for c in range(1, dy):
                j = j0 + c
                cut = _cut_value(r.row[j, i0, i1], share_x, k)
                v = value[i0, i1, j0, j] + value[i0, i1, j, j1] + cut
                better = v > best
                best, pick = np.where(better, v, best), np.where(better, -j, pick)
            value[i0, i1, j0, j1] = best
            choice[i0, i1, j0, j1] = pick
    return value, choice


def best_partition(seams: Seams, blobs: list[Blob], weights: Weights | None = None) -> Partition:
    """The guillotine partition of highest value."""
    k = weights or Weights()
    r = _Regions(seams, blobs, k)
    value, choice = _best_cuts(r, k)
    leaves: list[Leaf] = []
    stack = [(0, len(r.xs) - 1, 0, len(r.ys) - 1)]
    while stack:
        i0, i1, j0, j1 = stack.pop()
        c = int(choice[i0, i1, j0, j1])
        if c > 0:
            stack += [(i0, c, j0, j1), (c, i1, j0, j1)]
        elif c < 0:
            stack += [(i0, i1, j0, -c), (i0, i1, -c, j1)]
        else:
            leaves.append(_make_leaf(r, blobs, i0, i1, j0, j1))
    return Partition(tuple(leaves), float(value[0, -1, 0, -1]))


def _make_leaf(r: _Regions, blobs: list[Blob], i0: int, i1: int, j0: int, j1: int) -> Leaf:
    box = (int(r.xs[i0]), int(r.ys[j0]), int(r.xs[i1]), int(r.ys[j1]))
    inside = tuple(
        n for n, b in enumerate(blobs)
        if box[0] < b.center[0] < box[2] and box[1] < b.center[1] < box[3]
    )  # fmt: skip
    sides = (r.column[i0, j0, j1], r.row[j0, i0, i1], r.column[i1, j0, j1], r.row[j1, i0, i1])
    kind = "panel" if r.kind[i0, i1, j0, j1] else "frame"
    return Leaf(box, kind, tuple(float(s) for s in sides), inside)  # type: ignore[arg-type]
