"""Handles by repetition: panels of one make carry like handles at like places.

A faint patch that several like panels show at the same place (or mirrored) is a handle; a strong
one that only one of them shows is a knot, a logo or a reflection.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.photo.handles import Blob

Array = NDArray[np.float64]
Box = tuple[float, float, float, float]
LIKE = 0.14  # relative size difference of panels of one make
NEAR = 0.06  # of the panel: how far apart like handles may sit
SIZES = 0.5  # log ratio of like handles' sizes
LEAST = 0.05  # score of a patch that is considered at all
SURE = 0.5  # of the joint evidence


def handles_by_repetition(boxes: Sequence[Box], blobs: Sequence[Blob]) -> dict[int, Blob]:
    """Index of a panel to the handle that it and its like panels show; panels without are absent.

    Args:
        boxes: panels (x0, y0, x1, y1), front pixels.
        blobs: handle candidates of the whole front with their probabilities; what a language model
            alone sees repeats nothing.
    """
    out: dict[int, Blob] = {}
    seen = [b for b in blobs if b.score > LEAST and b.provenance != "model"]
    inside = [[b for b in seen if _within(b, box)] for box in boxes]
    for group in _groups(boxes):
        if len(group) < 2:
            continue
        best: tuple[float, dict[int, Blob]] = (0.0, {})
        for i in group:
            for model in inside[i]:
                found = {
                    j: match
                    for j in group
                    if (match := _match(model, boxes[i], boxes[j], inside[j])) is not None
                }
                value = sum(b.score for b in found.values())
                if len(found) >= 2 and value > best[0]:
                    best = value, found
        alone = sum(max((b.score for b in inside[j]), default=0.0) for j in group)
        joint = 1.0 - float(np.prod([1.0 - b.score for b in best[1].values()] or [1.0]))
        often = 2 * len(best[1]) >= len(group)
        if joint > SURE and often and best[0] > 0.55 * alone:
            out |= {j: replace(b, score=max(b.score, 0.9 * joint)) for j, b in best[1].items()}
    return out


def _groups(boxes: Sequence[Box]) -> list[list[int]]:
    left = list(range(len(boxes)))
    out = []
    while left:
        first = left.pop(0)
        same = [j for j in left if _like(boxes[first], boxes[j])]
        left = [j for j in left if j not in same]
        out.append([first, *same])
    return out


def _like(a: Box, b: Box) -> bool:
    return all(
        abs((a[k + 2] - a[k]) - (b[k + 2] - b[k])) < LIKE * max(a[k + 2] - a[k], b[k + 2] - b[k])
        for k in (0, 1)
    )


def _within(blob: Blob, box: Box) -> bool:
    x, y = blob.center
    return box[0] < x < box[2] and box[1] < y < box[3]


def _spot(blob: Blob, box: Box) -> Array:
    """(2,) distance to the nearer upright edge and from the top, shares of the panel."""
    x, y = blob.center
    u = (x - box[0]) / (box[2] - box[0])
    return np.array([min(u, 1 - u), (y - box[1]) / (box[3] - box[1])])


def _match(model: Blob, home: Box, box: Box, blobs: Sequence[Blob]) -> Blob | None:
    """The likeliest patch in `box` that sits and looks as `model` does at home."""
    spot = _spot(model, home)
    size = np.log(model.size)
    near = [
        b for b in blobs
        if np.abs(_spot(b, box) - spot).max() < NEAR
        and np.abs(np.log(b.size) - size).max() < SIZES
    ]  # fmt: skip
    return max(near, key=lambda b: b.score) if near else None
