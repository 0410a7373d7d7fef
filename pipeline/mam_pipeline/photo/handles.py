"""Handle candidates on a rectified front: compact patches that differ from their surroundings."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mam_pipeline.photo.seams import Seams

Array = NDArray[np.float64]
LEVELS = (7.0, 11.0, 17.0, 26.0, 38.0)
MOST = 250  # patches at one level: more are grain or ornament, in which no handle can be told
FAINT = (2.5, 4.0, 6.5)  # levels of the smoothed contrast, in units of its noise


@dataclass(frozen=True)
class Blob:
    """A handle candidate: box (x0, y0, x1, y1) in front pixels, features, probability."""

    box: tuple[float, float, float, float]
    score: float
    features: tuple[float, ...] = ()
    provenance: str = "observed"

    @property
    def center(self) -> tuple[float, float]:
        """Middle of the box, front pixels."""
        return (self.box[0] + self.box[2]) / 2, (self.box[1] + self.box[3]) / 2

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, front pixels."""
        return self.box[2] - self.box[0], self.box[3] - self.box[1]


def contrast_maps(rgb: NDArray[np.uint8]) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """(h, w) Lab distance of each pixel to the median of its surroundings, and of lightness alone.

    The second is signed: a bright bar and the dark shadow that it casts are two things. Then both
    again, smoothed: there a handle of its panel's own colour rises above the noise.
    """
    side = max(rgb.shape[:2])
    window = max(9, round(0.075 * side)) | 1
    lab8 = cv2.cvtColor(cv2.GaussianBlur(rgb, (0, 0), 0.9), cv2.COLOR_RGB2LAB)
    base = cv2.medianBlur(lab8, window).astype(np.float64)
    difference = (lab8.astype(np.float64) - base) * [100 / 255, 1.0, 1.0]
    blurred = cv2.GaussianBlur(difference, (0, 0), max(1.2, 0.003 * side))
    smooth = np.asarray(blurred, dtype=np.float64)
    return (
        (np.linalg.norm(difference, axis=2), difference[..., 0]),
        (np.asarray(np.linalg.norm(smooth, axis=2)), smooth[..., 0]),
    )


def _binaries(
    rgb_maps: tuple[tuple[Array, Array], tuple[Array, Array]], seams: Seams
) -> Iterator[NDArray[np.uint8]]:
    """Pictures whose connected patches are candidates: clear ones, faint ones, bars."""
    (contrast, lightness), (smooth, smooth_light) = rgb_maps
    side = max(contrast.shape)
    lines = long_lines(seams)
    noise, rest = float(np.median(contrast)), max(float(np.median(smooth)), 0.3)
    levels = [(contrast, lightness, k, 3) for k in LEVELS if k >= 2.0 * noise]
    levels += [(smooth, smooth_light, k * rest, 5) for k in FAINT]
    for value, light, level, gap in levels:
        above = value > level
        bright, dark = above & (light > 0.3 * value), above & (light < -0.3 * value)
        yield from (_patches(k & ~lines, gap) for k in (above, bright, dark))
        for sign in (bright, dark):
            yield from _bars(sign, side)


def long_lines(seams: Seams, share: float = 0.42) -> NDArray[np.bool_]:
    """Pixels of seam lines that run over at least `share` of the front: never part of a handle."""
    out = np.zeros(seams.vertical.shape, bool)
    for response, along in ((seams.vertical, 0), (seams.horizontal, 1)):
        n = max(9, int(share * response.shape[along]))
        strong = response > 0.5
        shape = (n, 1) if along == 0 else (1, n)
        kept = cv2.morphologyEx(strong.astype(np.uint8), cv2.MORPH_OPEN, np.ones(shape, np.uint8))
        out |= kept > 0
    return out


def find_blobs(rgb: NDArray[np.uint8], seams: Seams, keep: int = 60) -> list[Blob]:
    """Handle candidates that do not overlap, most likely first."""
    boxes, table = handle_candidates(rgb, seams, MOST)
    if not len(boxes):
        return []
    score = handle_probability(table)
    out: list[Blob] = []
    for i in np.argsort(-score, kind="stable"):
        if all(_overlap(boxes[i], b.box) < 0.3 for b in out):
            x0, y0, x1, y1 = (float(v) for v in boxes[i])
            out.append(Blob((x0, y0, x1, y1), float(score[i]), tuple(table[i])))
        if len(out) == keep:
            break
    return out


def handle_candidates(
    rgb: NDArray[np.uint8], seams: Seams, most: int | None = None
) -> tuple[Array, Array]:
    """Boxes (n, 4) of all patches that may be handles, and their features (n, COUNT).

    Args:
        most: levels with more patches than these are left out.
    """
    h, w = rgb.shape[:2]
    side = max(h, w)
    maps = contrast_maps(rgb)
    contrast, smooth = maps[0][0], maps[1][0]
    noise, rest = float(np.median(contrast)), max(float(np.median(smooth)), 0.3)
    lab = cv2.cvtColor(rgb.astype(np.float32) / 255.0, cv2.COLOR_RGB2LAB).astype(np.float64)
    found: dict[tuple[int, int, int, int], Array] = {}
    for binary in _binaries(maps, seams):
        count, labels, stats, _ = cv2.connectedComponentsWithStats(binary, connectivity=8)
        if most is not None and count > most:
            continue
        for k in range(1, count):
            x, y, bw, bh, area = (int(v) for v in stats[k])
            box = (x, y, x + bw, y + bh)
            if box in found or not _plausible(bw, bh, area, side, w, h, x, y):
                continue
            part = labels[y : y + bh, x : x + bw] == k
            row = [features(box, part, contrast, lab, seams, noise), context(box, lab, seams)]
            found[box] = np.concatenate([*row, faintness(box, part, smooth, rest)])
    if not found:
        return np.zeros((0, 4)), np.zeros((0, COUNT))
    boxes = np.array(list(found), dtype=float)
    table = np.stack(list(found.values()))
    table, faint = table[:, :34], table[:, 34:]
    more = [repetition(table, boxes, side), crowding(boxes, side), faint]
    return boxes, np.column_stack([table, *more])


def _patches(above: NDArray[np.bool_], gap: int) -> NDArray[np.uint8]:
    """Compact patches: breaks of up to `gap` pixels closed, single pixels dropped."""
    near = np.ones((gap, gap), np.uint8)
    closed = cv2.morphologyEx(above.astype(np.uint8), cv2.MORPH_CLOSE, near)
    return np.asarray(cv2.morphologyEx(closed, cv2.MORPH_OPEN, np.ones((2, 2), np.uint8)), np.uint8)


def _bars(above: NDArray[np.bool_], side: int) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """Long bars, horizontal and vertical: whatever is three pixels thick and long enough.

    Seams are thinner, and what crosses a bar (its posts, a shadow, a seam) is cut off.
    """
    n = max(9, round(0.07 * side))
    closed = cv2.morphologyEx(above.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))
    flat = cv2.morphologyEx(closed, cv2.MORPH_OPEN, np.ones((3, n), np.uint8))
    tall = cv2.morphologyEx(closed, cv2.MORPH_OPEN, np.ones((n, 3), np.uint8))
    return np.asarray(flat, np.uint8), np.asarray(tall, np.uint8)


def _plausible(bw: int, bh: int, area: int, side: int, w: int, h: int, x: int, y: int) -> bool:
    thin, long = min(bw, bh), max(bw, bh)
    return (
        thin >= max(3, 0.005 * side)
        and thin <= 0.13 * side
        and 0.011 * side <= long <= (0.9 if bw > bh else 0.75) * side
        and (long <= 0.3 * side or long / thin > 6)
        and area >= 0.22 * bw * bh
        and x > 2 and y > 2 and x + bw < w - 2 and y + bh < h - 2
    )  # fmt: skip


def features(
    box: tuple[int, int, int, int],
    part: NDArray[np.bool_],
    contrast: Array,
    lab: Array,
    seams: Seams,
    noise: float,
) -> Array:
    """Numbers that tell a handle from texture; all relative to the front's size or noise."""
    x0, y0, x1, y1 = box
    h, w = contrast.shape
    side = max(h, w)
    bw, bh = x1 - x0, y1 - y0
    pad = max(4, round(0.35 * min(max(bw, bh), 0.12 * side)))
    a0, b0, a1, b1 = max(0, x0 - pad), max(0, y0 - pad), min(w, x1 + pad), min(h, y1 + pad)
    ring = np.ones((b1 - b0, a1 - a0), bool)
    ring[max(0, y0 - b0 - 2) : y1 - b0 + 2, max(0, x0 - a0 - 2) : x1 - a0 + 2] = False
    around = contrast[b0:b1, a0:a1]
    inside = contrast[y0:y1, x0:x1][part]
    outside = around[ring] if ring.any() else np.array([noise])
    color = lab[y0:y1, x0:x1][part]
    color_out = lab[b0:b1, a0:a1][ring] if ring.any() else lab[b0:b1, a0:a1].reshape(-1, 3)
    delta = np.median(color, axis=0) - np.median(color_out, axis=0)
    mirrored = part[:, ::-1]
    symmetric = (part & mirrored).sum() / max((part | mirrored).sum(), 1)
    upright = (part & part[::-1]).sum() / max((part | part[::-1]).sum(), 1)
    return np.array(
        [
            bw / side, bh / side, np.log(bw / bh), part.mean(),
            inside.mean(), np.percentile(inside, 90), outside.mean(), np.percentile(outside, 90),
            inside.mean() / (outside.mean() + noise + 0.5),
            (outside > 0.5 * inside.mean()).mean(),
            delta[0], np.hypot(delta[1], delta[2]), np.std(color[:, 0]), np.std(color_out[:, 0]),
            symmetric, upright,
            seams.vertical[y0:y1, x0:x1].mean(), seams.horizontal[y0:y1, x0:x1].mean(),
            *_ends(contrast, box), 1.0 - seams.calm[y0:y1, x0:x1].mean(),
            min(x0, w - x1) / side, noise,
        ]
    )  # fmt: skip


def faintness(
    box: tuple[int, int, int, int], part: NDArray[np.bool_], smooth: Array, rest: float
) -> Array:
    """(4,) the smoothed contrast within a candidate and around it, in units of its noise."""
    x0, y0, x1, y1 = box
    pad = max(6, round(0.4 * min(x1 - x0, y1 - y0)))
    around = smooth[max(0, y0 - pad) : y1 + pad, max(0, x0 - pad) : x1 + pad]
    mine = smooth[y0:y1, x0:x1][part]
    beyond = (around.sum() - mine.sum()) / max(around.size - mine.size, 1)
    return np.array(
        [mine.mean() / rest, np.percentile(mine, 90) / rest, beyond / rest,
         mine.mean() / (beyond + 0.5 * rest)]
    )  # fmt: skip


def context(box: tuple[int, int, int, int], lab: Array, seams: Seams) -> Array:
    """(11,) where a candidate sits between the nearest lines, and whether its flanks agree.

    A drawer's handle lies midway between two upright lines, a door's close to one; what parts
    two surfaces of different colour is no handle.
    """
    x0, y0, x1, y1 = box
    h, w = seams.vertical.shape
    side = max(h, w)
    grow = round(0.03 * side)
    rows = slice(max(0, min(y0, (y0 + y1) // 2 - grow)), max(y1, (y0 + y1) // 2 + grow))
    columns = slice(max(0, min(x0, (x0 + x1) // 2 - grow)), max(x1, (x0 + x1) // 2 + grow))
    upright = seams.vertical[rows].mean(axis=0)
    level = seams.horizontal[:, columns].mean(axis=1)
    gap = 4 + round(0.15 * min(x1 - x0, y1 - y0))
    left, right = _to_line(upright, x0 - gap, -1), _to_line(upright, x1 + gap, 1)
    up, down = _to_line(level, y0 - gap, -1), _to_line(level, y1 + gap, 1)
    bw, bh = x1 - x0, y1 - y0
    pad = max(3, round(0.02 * side))
    flanks = []
    for one, two in (
        (lab[max(0, y0 - pad) : max(1, y0 - 1), x0:x1], lab[y1 + 1 : y1 + pad, x0:x1]),
        (lab[y0:y1, max(0, x0 - pad) : max(1, x0 - 1)], lab[y0:y1, x1 + 1 : x1 + pad]),
    ):
        if one.size and two.size:
            means = one.reshape(-1, 3).mean(axis=0) - two.reshape(-1, 3).mean(axis=0)
            flanks.append(float(np.linalg.norm(means)))
        else:
            flanks.append(0.0)
    return np.array(
        [
            left / side, right / side, up / side, down / side,
            abs(left - right) / (left + right + 1), abs(up - down) / (up + down + 1),
            min(left, right) / side, bw / (left + right + bw), bh / (up + down + bh), *flanks,
        ]
    )  # fmt: skip


def _to_line(profile: Array, start: int, step: int) -> int:
    """Pixels from `start` to the next line of a seam profile, or to the border."""
    ahead = profile[: max(start, 0) + 1][::-1] if step < 0 else profile[start:]
    hits = np.flatnonzero(ahead > 0.45)
    return int(hits[0]) if len(hits) else len(ahead)


def _ends(contrast: Array, box: tuple[int, int, int, int]) -> tuple[float, float]:
    """Contrast just beyond the two ends of the long side: a seam goes on, a handle stops."""
    x0, y0, x1, y1 = box
    reach = max(4, round(0.25 * max(x1 - x0, y1 - y0)))
    if x1 - x0 >= y1 - y0:
        a, b = (
            contrast[y0:y1, max(0, x0 - reach) : max(1, x0 - 1)],
            contrast[y0:y1, x1 + 1 : x1 + reach],
        )
    else:
        a, b = (
            contrast[max(0, y0 - reach) : max(1, y0 - 1), x0:x1],
            contrast[y1 + 1 : y1 + reach, x0:x1],
        )
    means = sorted(float(np.percentile(v, 85)) if v.size else 0.0 for v in (a, b))
    return means[0], means[1]


def repetition(table: Array, boxes: Array, side: int) -> Array:
    """(n, 3) how many like candidates share the row, the column, and the whole front."""
    size = np.stack([boxes[:, 2] - boxes[:, 0], boxes[:, 3] - boxes[:, 1]], 1).astype(float)
    center = (boxes[:, :2] + boxes[:, 2:]) / 2.0
    ratio = np.abs(np.log(size[:, None] / size[None])).max(axis=2)
    color = np.abs(table[:, None, [10, 11]] - table[None, :, [10, 11]]).max(axis=2)
    like = (ratio < 0.3) & (color < 10)
    distance = np.abs(center[:, None] - center[None])
    apart = distance.max(axis=2) > 0.04 * side
    row = (like & apart & (distance[..., 1] < 0.012 * side)).sum(axis=1)
    column = (like & apart & (distance[..., 0] < 0.012 * side)).sum(axis=1)
    return np.stack([row, column, (like & apart).sum(axis=1)], axis=1).astype(float)


def crowding(boxes: Array, side: int) -> Array:
    """(n, 2) how many separate candidates lie nearby: a few handles, but many bits of pattern."""
    center = (boxes[:, :2] + boxes[:, 2:]) / 2.0
    half = (boxes[:, 2:] - boxes[:, :2]) / 2.0
    gap = np.abs(center[:, None] - center[None]) - half[:, None] - half[None]
    gap = gap.max(axis=2)  # > 0: the boxes do not touch
    return np.stack(
        [((gap > 0) & (gap < reach * side)).sum(axis=1) for reach in (0.04, 0.1)], axis=1
    ).astype(float)


COUNT = 43  # columns of a candidate's table
BASIC = (*range(23), *range(34, COUNT))  # columns of shape, contrast, repetition and crowding
CONTEXT_SHARE = (0.35, 0.85)  # of compact patches, of long bars
BAR = np.log(4.0)  # log of length over thickness from which a patch is a bar
BUSY = 20  # column of `features`: share of ornament or weave under the patch


@lru_cache(maxsize=2)
def _model(name: str) -> Any:
    """Boosted trees trained on synthetic photos only (mam_training.photo.train_handles)."""
    import lightgbm

    return lightgbm.Booster(model_file=str(Path(__file__).parent / "weights" / "handles" / name))


def handle_probability(table: Array) -> Array:
    """(n,) probability that a candidate is a handle, from its features.

    The log-odds of two models are averaged: one knows the patch alone, one also its place between
    the nearest lines. Where they disagree (a bright spot of an ornament in a handle's place) the
    probability is low: measured, fewer false handles at like recall.
    """
    odds = []
    for name, columns in (("handle_model.txt", BASIC), ("handle_context.txt", range(COUNT))):
        p = np.asarray(_model(name).predict(table[:, list(columns)], num_threads=1), float)
        p = np.clip(p, 1e-4, 1 - 1e-4)
        odds.append(np.log(p / (1 - p)))
    share = np.where(np.abs(table[:, 2]) > BAR, CONTEXT_SHARE[1], CONTEXT_SHARE[0])
    mixed = (1 - share) * odds[0] + share * odds[1]
    p = np.asarray(1 / (1 + np.exp(-mixed)), dtype=np.float64)
    return p * (1.0 - 0.8 * table[:, BUSY])  # in ornament a bright bit is a bit of ornament


def _overlap(a: tuple[float, ...], b: tuple[float, ...]) -> float:
    w = min(a[2], b[2]) - max(a[0], b[0])
    h = min(a[3], b[3]) - max(a[1], b[1])
    if w <= 0 or h <= 0:
        return 0.0
    smaller = min((a[2] - a[0]) * (a[3] - a[1]), (b[2] - b[0]) * (b[3] - b[1]))
    return w * h / max(smaller, 1e-9)
