"""Trains the box network on painted photos with exact truth, and on real ones.

    python -m mam_training.photo.train_box configs/train/photo_box.yaml

Every photo is painted once (`mam_world.photos.painted_photo`) and seen once. Of real photos whose
front was marked by eye (`real_photos`), each time another window is seen; of their box only the
front's corners are known. From nothing it takes some 8 minutes on a GPU with 11 cores that paint,
on one core an estimated 6 hours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional as f

from mam_pipeline.photo.box_network import CORNERS, MAPS, SEEN, SHAPES, WEIGHTS
from mam_pipeline.photo.network import STRIDE, nearest_shape
from mam_training import manifest
from mam_training.command import configured
from mam_training.photo.network_model import Network, NetworkTraining, save, trained
from mam_training.photo.real_photos import (
    IGNORED,
    REAL,
    MarkedPhoto,
    marked_in,
    photo_lesson,
    toned,
)
from mam_world.photos.painted_photo import PaintedPhoto, paint_photo

Array = NDArray[np.float32]
FLIPPED = (2, 3, 0, 1, 6, 7, 4, 5)
"""Corner that each corner becomes in a mirror."""
SPREADS = (-6.0, 1.0)
"""Logarithms of the least and the greatest spread, over the mean of height and width."""
UNKNOWN = -100  # in place of an index of SEEN: nobody says what is there


@dataclass(frozen=True)
class BoxTraining(NetworkTraining):
    """What the box network is trained on, and where it goes."""

    start: str = "2526952"
    count: int = 1_600
    batch: int = 16
    rate: float = 4e-4
    slower: float = 0.3
    real: float = 0.6
    fold: int = -1
    """Of `real_photos.FOLDS`, whose real photos are left out; -1: all are lessons. With the others
    the confidence is fitted (`fit_confidence`)."""
    out: Path = Path("build/weights/photo/box")
    """Folder that the weights and their manifest are written to."""


class Lesson(NamedTuple):
    """A photo as the network sees it (h, w, 3) uint8, and what it should answer.

    `seen` (h / 4, w / 4) is the index of SEEN or UNKNOWN, `corners` (16,) are places, x then y of
    each; NaN where nobody knows them.
    """

    picture: NDArray[np.uint8]
    seen: NDArray[np.int64]
    corners: Array


def lesson_of(photo: PaintedPhoto, rng: np.random.Generator) -> Lesson:
    """Squeeze a photo to a shape of the network, every second one mirrored."""
    height, width = photo.picture.shape[:2]
    h, w = nearest_shape(SHAPES, height, width)
    picture = cv2.resize(photo.picture, (w, h), interpolation=cv2.INTER_AREA)
    small = (w // STRIDE, h // STRIDE)
    seen = cv2.resize(photo.seen, small, interpolation=cv2.INTER_NEAREST).astype(np.int64)
    seen = np.where(seen == IGNORED, UNKNOWN, seen)
    corners = photo.corners * [small[0] / width, small[1] / height]
    if rng.random() < 0.5:
        picture, seen = picture[:, ::-1], seen[:, ::-1]
        corners = (corners * [-1, 1] + [small[0], 0])[list(FLIPPED)]
        left, right = SEEN.index("left"), SEEN.index("right")
        seen = np.where(seen == left, right, np.where(seen == right, left, seen))
    return Lesson(
        np.ascontiguousarray(picture, np.uint8), np.ascontiguousarray(seen),
        corners.astype(np.float32).ravel(),
    )  # fmt: skip


Real = list[tuple[MarkedPhoto, NDArray[np.uint8]]]


def box_lesson(config: BoxTraining, real: Real, number: int) -> Lesson:
    """The photo of a number as a lesson."""
    rng = np.random.default_rng([config.seed, number])
    if real and rng.random() < config.real:
        mark, picture = real[int(rng.integers(len(real)))]
        return lesson_of(photo_lesson(mark, toned(picture, rng), rng), rng)
    return lesson_of(paint_photo(rng), rng)


def loss_of(out: Tensor, seen: Tensor, corners: Tensor) -> dict[str, Tensor]:
    """Losses of raw maps (`box_network.MAPS`) by name: seen, corner."""
    faces, way, spread = out.split(list(MAPS.values()), dim=1)
    n, _, h, w = out.shape
    unit = (h + w) / 2
    y, x = torch.meshgrid(
        torch.arange(h, device=out.device) + 0.5, torch.arange(w, device=out.device) + 0.5,
        indexing="ij",
    )  # fmt: skip
    here = torch.stack([x, y]).repeat(CORNERS, 1, 1)
    known = corners.view(n, CORNERS, 2).isfinite().all(dim=2)[:, :, None, None]
    true = (corners.nan_to_num()[:, :, None, None] - here) / unit
    off = (way - true).abs().view(n, CORNERS, 2, h, w).sum(dim=2)
    log_b = spread.clamp(*SPREADS)
    likely = off / log_b.exp() + 2 * log_b
    inside = (seen > 0)[:, None] & known
    corner = (likely * inside).sum() / inside.sum().clamp(min=1)
    shown = f.cross_entropy(faces, seen, ignore_index=UNKNOWN)
    return {"seen": shown, "corner": 0.3 * corner}


def train(config: BoxTraining) -> Network:
    """The network, trained."""
    lesson = partial(box_lesson, config, real_photos(config))
    return trained(config, sum(MAPS.values()), lesson, loss_of, WEIGHTS)


def real_photos(config: BoxTraining) -> Real:
    """Those that were marked, without those of the fold; none where no lesson is to be of them."""
    if not config.real:
        return []
    marked = marked_in(config.labels, config.photos)
    return [one for one in marked if one[0].whole and one[0].fold != config.fold]


def main(argv: Sequence[str] | None = None) -> None:
    """Train and save."""
    config = configured(BoxTraining(), argv)
    save(train(config), config.out / WEIGHTS.name)
    manifest.write(
        config.out,
        "python -m mam_training.photo.train_box configs/train/photo_box.yaml",
        config,
        {"photos": config.seed},
        data_of(config),
        [manifest.GENERATED, "imagenet", *([REAL] if config.real else [])],
    )


def data_of(config: BoxTraining) -> dict[str, Any]:
    """How many photos were seen, and a digest of the first painted, and of the real ones."""
    first = [paint_photo(np.random.default_rng([config.seed, k])).picture for k in range(20)]
    real = real_photos(config)
    first += [picture for _, picture in real]
    return {
        "photos": config.count,
        "real": len(real),
        "sha256": manifest.data_digest(p.tobytes() for p in first),
    }


if __name__ == "__main__":
    main()
