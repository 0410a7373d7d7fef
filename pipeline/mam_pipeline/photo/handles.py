"""Handles on a front: where the network sees them, and where a language model does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from mam_pipeline.photo.front_network import FrontMaps

HALF = 0.5  # probability from which a place is part of a handle
Box = tuple[float, float, float, float]
FAINT = 0.12  # the greatest probability of a patch that may be one where like panels have theirs


@dataclass(frozen=True)
class Blob:
    """A handle or what may be one: box (x0, y0, x1, y1) in front pixels, and its probability.

    `provenance`: observed | inferred (like panels show it) | model | assumed | user.
    `told`: whether a language model sees one here, be it measured or not.
    """

    box: Box
    score: float
    provenance: str = "observed"
    told: bool = False

    @property
    def center(self) -> tuple[float, float]:
        """Middle of the box, front pixels."""
        return (self.box[0] + self.box[2]) / 2, (self.box[1] + self.box[3]) / 2

    @property
    def size(self) -> tuple[float, float]:
        """Width and height, front pixels."""
        return self.box[2] - self.box[0], self.box[3] - self.box[1]


def handles_seen(maps: FrontMaps) -> list[Blob]:
    """Patches of a front that look like handles, most likely first.

    A sure patch is as large as the places of at least HALF; a faint one, whose greatest
    probability is less, as the places of at least half of that.
    """
    fine = np.asarray(
        cv2.resize(maps.handle, (maps.width, maps.height), interpolation=cv2.INTER_LINEAR),
        np.float64,
    )
    out: list[Blob] = []
    for region in _patches(fine > FAINT):
        peak = float(fine[region].max())
        for part in _patches(region & (fine > (HALF if peak > HALF else peak / 2))):
            y, x = np.nonzero(part)
            box = (float(x.min()), float(y.min()), x.max() + 1.0, y.max() + 1.0)
            out.append(Blob(box, float(fine[part].max())))
    return sorted(out, key=lambda b: -b.score)


@dataclass(frozen=True)
class ToldRules:
    """When a patch is the handle that a language model sees; its boxes are some percent off.

    Attributes:
        off: share of the front's longer side that a patch may lie outside the told box.
        sizes: factor between both sizes up to which they may be one thing.
        panel: share of a panel's width or height that no handle exceeds in both directions.
    """

    off: float = 0.04
    sizes: float = 4.0
    panel: float = 0.5

    def same(self, blob: Blob, box: Box, side: float) -> bool:
        """Whether a patch lies in a told box, or hardly outside it, and is of its size.

        Args:
            side: the front's longer side, pixels.
        """
        (x, y), room = blob.center, self.off * side
        ratio = max(blob.size) / max(box[2] - box[0], box[3] - box[1], 1.0)
        inside = box[0] - room < x < box[2] + room and box[1] - room < y < box[3] + room
        return inside and 1 / self.sizes < ratio < self.sizes

    def fits(self, blob: Blob, panel: Box) -> bool:
        """Whether a told handle is small enough for its panel."""
        shares = (blob.size[0] / (panel[2] - panel[0]), blob.size[1] / (panel[3] - panel[1]))
        return min(shares) < self.panel


TOLD = ToldRules()


def with_told(blobs: Sequence[Blob], told: Sequence[Box], sure: float, side: float) -> list[Blob]:
    """The patches with the handles that a language model sees.

    A patch that lies in a told box is that handle, in its own measured place; where none does, the
    told box is taken.

    Args:
        told: boxes (x0, y0, x1, y1), front pixels. sure: how far the model is believed, 0..1.
        side: the front's longer side, pixels.
    """
    left, out = list(blobs), list[Blob]()
    for box in told:
        near = [b for b in left if TOLD.same(b, box, side)]
        if near:
            best = max(near, key=lambda b: b.score)
            left.remove(best)
            out.append(replace(best, score=max(best.score, sure), told=True))
        else:
            out.append(Blob(box, sure, "model", told=True))
    return sorted([*out, *left], key=lambda b: -b.score)


def _patches(above: NDArray[np.bool_]) -> list[NDArray[np.bool_]]:
    count, labels = cv2.connectedComponents(above.astype(np.uint8), connectivity=8)
    return [labels == k for k in range(1, count)]
