"""How far to trust a reading: probabilities that box, panels and handles are right, as words.

Each probability is a logistic function of a few numbers that the reading itself yields. Weights
and the limits of "high" and "medium" stand in confidence.json; mam_training.photo.fit_confidence
fits them on rendered photos with exact truth (no real photo is used) and keeps the count of
photos and what came out beside them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from mam_pipeline.photo.find import Found

Array = NDArray[np.float64]
WORDS = ("high", "medium", "low")
TOPICS = ("cuboid", "panels", "handles")


@dataclass(frozen=True)
class Scale:
    """Weights of one topic: p = sigmoid(bias + weights . x); limits of the words."""

    bias: float
    weights: Mapping[str, float]
    high: float
    medium: float

    def probability(self, values: Mapping[str, float]) -> float:
        """0..1 that the topic is right."""
        z = self.bias + sum(w * values[name] for name, w in self.weights.items())
        return float(1.0 / (1.0 + np.exp(-np.clip(z, -30, 30))))

    def word(self, p: float) -> str:
        """high | medium | low."""
        return "high" if p >= self.high else "medium" if p >= self.medium else "low"


def features(found: Found) -> dict[str, float]:
    """The numbers that the probabilities are made of, all about 0..1."""
    panels = found.reading.movable
    seen = [max((b.score for b in p.handles if b.provenance == "observed"), default=0.0)
            for p in panels]  # fmt: skip
    details = found.reading.details
    return {
        "cost": min(found.cost, 1.5),
        "margin": min(found.margin, 0.5),
        "trust": found.mask.trust,
        "support": details.get("support", 0.0),
        "weakest": details.get("weakest", 0.0),
        "seen": float(np.mean([s > 0.35 for s in seen])) if seen else 0.0,
        "score": float(np.mean(seen)) if seen else 0.0,
        "shape": float(np.mean([p.kind_confidence for p in panels])) if panels else 0.0,
        "alike": _alike(found),
        "single": float(len(panels) == 1),
        "none": float(not panels),
    }


def _alike(found: Found) -> float:
    """Share of panels that have a twin of like size: real fronts repeat, wrong cuts do not."""
    boxes = np.array([p.box for p in found.reading.movable]).reshape(-1, 4)
    if len(boxes) < 2:
        return 0.0
    size = np.stack([boxes[:, 2] - boxes[:, 0], boxes[:, 3] - boxes[:, 1]], 1)
    off = np.abs(np.log(size[:, None] / size[None])).max(axis=2)
    np.fill_diagonal(off, 9.0)
    return float((off.min(axis=1) < 0.12).mean())


KEPT = Path(__file__).parent / "weights" / "confidence" / "confidence.json"


@lru_cache(maxsize=1)
def scales() -> dict[str, Scale]:
    """The fitted weights by topic; empty before the first fit."""
    if not KEPT.is_file():
        return {}
    kept = json.loads(KEPT.read_text(encoding="utf-8"))
    return {
        k: Scale(v["bias"], v["weights"], v["high"], v["medium"]) for k, v in kept["topics"].items()
    }


def probabilities(found: Found) -> dict[str, float]:
    """Topic to the probability that it is right; empty before the first fit."""
    values = features(found)
    return {topic: round(scale.probability(values), 3) for topic, scale in scales().items()}


def words(found: Found) -> dict[str, str]:
    """Topic to high | medium | low; empty before the first fit."""
    return {topic: scales()[topic].word(p) for topic, p in probabilities(found).items()}
