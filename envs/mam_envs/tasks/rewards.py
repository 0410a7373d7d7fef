"""Dense reward as named terms times scales of the same names; the terms are logged under them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import torch

from mam_pipeline.errors import ConfigError


def scaled(terms: Mapping[str, torch.Tensor], scales: Any) -> dict[str, torch.Tensor]:
    """Terms times their scales, in the order of the scales' dataclass.

    Raises:
        ConfigError: a scale without a term (unless it is 0) or a term without a scale.
    """
    factors = {f.name: float(getattr(scales, f.name)) for f in fields(scales)}
    for name in terms:
        if name not in factors:
            raise ConfigError(f"{type(scales).__name__} has no scale for the reward term {name!r}")
    for name, factor in factors.items():
        if name not in terms and factor:
            raise ConfigError(f"the task has no reward term {name!r}; set its scale to 0")
    return {name: terms[name] * factor for name, factor in factors.items() if name in terms}


def largest(scales: Any) -> float:
    """What one step can bring at most: the sum of the positive scales (1 if there are none)."""
    best = sum(max(0.0, float(getattr(scales, f.name))) for f in fields(scales))
    return best if best > 0 else 1.0
