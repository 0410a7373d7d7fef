"""A picture behind robot and object: what cameras see elsewhere is replaced by it."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from mam_pipeline.errors import ConfigError

Picture = NDArray[np.uint8]
SIDE = 192  # pixels of a random pattern


@lru_cache(maxsize=8)
def read_background(picture: str | Path) -> Picture:
    """(h, w, 3) RGB of a picture file.

    Raises:
        ConfigError: it cannot be read.
    """
    import cv2

    image = cv2.imread(str(picture))
    if image is None:
        raise ConfigError(f"background picture {picture} cannot be read")
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2RGB), dtype=np.uint8)


def random_pattern(rng: np.random.Generator) -> Picture:
    """(SIDE, SIDE, 3) colours that run into each other, and before them bars, frames, discs, lines,
    polygons and rows of alike panels, few or many."""
    import cv2

    image = np.full((SIDE, SIDE, 3), rng.uniform(0, 255, 3))
    for cells in (2, 4, 8, 16, 32, 64):
        size = rng.uniform(0, 90) * rng.uniform(0.3, 1) ** np.log2(cells)
        noise = rng.normal(0, size, (cells, cells, 3))
        noise = np.where(rng.uniform() < 0.5, noise, noise.mean(axis=2, keepdims=True))
        image += cv2.resize(noise, (SIDE, SIDE), interpolation=cv2.INTER_CUBIC)
    for _ in range(rng.integers(0, rng.choice((3, 10, 40)))):
        colour, at = rng.uniform(0, 255, 3).tolist(), rng.integers(0, SIDE, (5, 2))
        size, line = rng.integers(3, SIDE // 2, 2), int(rng.integers(1, 5))
        a, b = at[0].tolist(), (at[0] + size).tolist()
        match rng.integers(6):
            case 0:
                cv2.rectangle(image, a, b, colour, -1)
            case 1:
                cv2.rectangle(image, a, b, colour, line)
            case 2:
                cv2.circle(image, a, int(size[0] // 2), colour, int(rng.choice((-1, line))))
            case 3:
                cv2.line(image, a, at[1].tolist(), colour, line)
            case 4:
                cv2.fillPoly(image, [at[: rng.integers(3, 6)].astype(np.int32)], colour)
            case _:
                for i, j in np.ndindex(*rng.integers(1, 5, 2)):
                    corner = at[0] + (size + line) * (i, j)
                    cv2.rectangle(image, corner.tolist(), (corner + size).tolist(), colour, -1)
    return np.clip(image, 0, 255).astype(np.uint8)


def kept_of(sensor: Any, foreground: torch.Tensor) -> torch.Tensor:
    """(b, H, W, 1) where a ManiSkill camera, which has just taken a picture, sees the bodies of ids
    (n,)."""
    mask = sensor.get_obs(rgb=False, depth=False, position=False, segmentation=True)
    return torch.isin(mask["segmentation"], foreground)


def put_background(
    picture: Picture,
    data: dict[str, Any],
    sensors: Mapping[str, Any],
    foreground: torch.Tensor,
) -> None:
    """Replace what is neither robot nor object by a picture (h, w, 3), in place.

    Args:
        data: observations by camera; those with `rgb` (b, H, W, 3) uint8 are changed.
        sensors: ManiSkill's cameras of the same names.
        foreground: (n,) per-scene ids of the bodies that stay.
    """
    import cv2

    for name, sensor in sensors.items():
        if "rgb" not in data.get(name, {}):
            continue
        rgb = data[name]["rgb"]
        keep = kept_of(sensor, foreground.to(rgb.device))
        size = (rgb.shape[2], rgb.shape[1])
        behind = np.ascontiguousarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA))
        shown = torch.from_numpy(behind).to(rgb.device)[None].expand_as(rgb)
        data[name]["rgb"] = torch.where(keep, rgb, shown)
