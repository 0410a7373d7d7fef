"""Handles on a front: where the network sees them."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mam_pipeline.photo.front_network import FrontMaps

HALF = 0.5  # probability from which a place is part of a handle
FAINT = 0.12  # the greatest probability of a patch that may be one where like panels have theirs


@dataclass(frozen=True)
class Blob:
    """A handle or what may be one: box (x0, y0, x1, y1) in front pixels, and its probability.

    `provenance`: observed | inferred (like panels show it) | assumed | user.
    """

    box: tuple[float, float, float, float]
    score: float
    provenance: str = "observed"

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


def _patches(above: NDArray[np.bool_]) -> list[NDArray[np.bool_]]:
    count, labels = cv2.connectedComponents(above.astype(np.uint8), connectivity=8)
    return [labels == k for k in range(1, count)]
