"""A picture behind robot and object: what cameras see elsewhere is replaced by it."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from mam_pipeline.errors import ConfigError


def put_background(
    picture: str | Path,
    data: dict[str, Any],
    sensors: Mapping[str, Any],
    foreground: torch.Tensor,
) -> None:
    """Replace what is neither robot nor object by a picture, in place.

    Args:
        data: observations by camera; those with `rgb` (b, H, W, 3) uint8 are changed.
        sensors: ManiSkill's cameras of the same names.
        foreground: (n,) per-scene ids of the bodies that stay.

    Raises:
        ConfigError: the picture cannot be read.
    """
    import cv2

    image = cv2.imread(str(picture))
    if image is None:
        raise ConfigError(f"background picture {picture} cannot be read")
    for name, sensor in sensors.items():
        if "rgb" not in data.get(name, {}):
            continue
        rgb = data[name]["rgb"]
        mask = sensor.get_obs(rgb=False, depth=False, position=False, segmentation=True)
        keep = torch.isin(mask["segmentation"], foreground.to(rgb.device))
        size = (rgb.shape[2], rgb.shape[1])
        fitted = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
        behind = np.ascontiguousarray(cv2.cvtColor(fitted, cv2.COLOR_BGR2RGB))
        shown = torch.from_numpy(behind).to(rgb.device)[None].expand_as(rgb)
        data[name]["rgb"] = torch.where(keep, rgb, shown)
