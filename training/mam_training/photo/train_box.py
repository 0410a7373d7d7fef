"""Trains the box network on painted photos with exact truth.

    python -m mam_training.photo.train_box configs/train/photo_box.yaml

Every photo is painted once (`mam_world.photos.painted_photo`) and seen once. On a GPU with 11
cores that paint it takes some 8 minutes, on one core an estimated 6 hours.
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
from mam_world.photos.painted_photo import PaintedPhoto, paint_photo

Array = NDArray[np.float32]
FLIPPED = (2, 3, 0, 1, 6, 7, 4, 5)
"""Corner that each corner becomes in a mirror."""
SPREADS = (-6.0, 1.0)
"""Logarithms of the least and the greatest spread, over the mean of height and width."""


@dataclass(frozen=True)
class BoxTraining(NetworkTraining):
    """What the box network is trained on, and where it goes."""

    out: Path = Path("build/weights/photo/box")
    """Folder that the weights and their manifest are written to."""


class Lesson(NamedTuple):
    """A photo as the network sees it (h, w, 3) uint8, and what it should answer.

    `seen` (h / 4, w / 4) is the index of SEEN, `corners` (16,) are places, x then y of each.
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


def painted_lesson(config: BoxTraining, number: int) -> Lesson:
    """The photo of a number as a lesson."""
    rng = np.random.default_rng([config.seed, number])
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
    true = (corners[:, :, None, None] - here) / unit
    off = (way - true).abs().view(n, CORNERS, 2, h, w).sum(dim=2)
    log_b = spread.clamp(*SPREADS)
    likely = off / log_b.exp() + 2 * log_b
    inside = (seen > 0)[:, None]
    corner = (likely * inside).sum() / (CORNERS * inside.sum()).clamp(min=1)
    return {"seen": f.cross_entropy(faces, seen), "corner": 0.3 * corner}


def train(config: BoxTraining) -> Network:
    """The network, trained."""
    return trained(config, sum(MAPS.values()), partial(painted_lesson, config), loss_of)


def main(argv: Sequence[str] | None = None) -> None:
    """Train and save."""
    config = configured(BoxTraining(), argv)
    torch.set_num_threads(1)
    save(train(config), config.out / WEIGHTS.name)
    manifest.write(
        config.out,
        "python -m mam_training.photo.train_box configs/train/photo_box.yaml",
        config,
        {"photos": config.seed},
        data_of(config),
        [manifest.GENERATED, "imagenet"],
    )


def data_of(config: BoxTraining) -> dict[str, Any]:
    """How many photos were seen, and a digest of the first ones."""
    first = [paint_photo(np.random.default_rng([config.seed, k])).picture for k in range(20)]
    return {
        "photos": config.count,
        "sha256": manifest.data_digest(p.tobytes() for p in first),
    }


if __name__ == "__main__":
    main()
