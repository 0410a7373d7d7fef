"""How likely a drawer or door stands open in a photo, by what the ImageNet network makes of it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

NAME = "opened.json"
KEPT = Path(__file__).parent / "weights" / "opened" / NAME


@dataclass(frozen=True)
class OpenedRules:
    """When a photo is said to show something that stands open.

    Attributes:
        likely: from this probability on.
    """

    likely: float = 0.5


RULES = OpenedRules()


def stands_open(described: NDArray[np.float32]) -> float:
    """0..1 that something stands open in a picture.

    A logistic regression; mam_training.photo.fit_opened fits it on photos labelled by eye.

    Args:
        described: (n, 1280) descriptions of views of the picture (`category.described`).
    """
    weights, bias = _fitted()
    return float(1.0 / (1.0 + np.exp(-(described.mean(axis=0) @ weights + bias))))


@lru_cache(maxsize=1)
def _fitted() -> tuple[NDArray[np.float64], float]:
    kept = json.loads(KEPT.read_text(encoding="utf-8"))
    return np.array(kept["weights"]), float(kept["bias"])
