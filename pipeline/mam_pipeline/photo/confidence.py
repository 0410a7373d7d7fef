"""How far to trust a reading: the evidence that box, panels and handles are right, as words.

The evidence of each is a number of 0..1 that the reading itself yields. The limits of "high" and
"medium" stand in confidence.json: mam_training.photo.fit_confidence sets them on marked real
photos, and keeps beside them how many readings were called so and how many of these were right.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mam_pipeline.photo.handles import HALF
from mam_pipeline.photo.panel import Panel

if TYPE_CHECKING:
    from mam_pipeline.photo.find import Found

TOPICS = ("cuboid", "panels", "handles")
KEPT = Path(__file__).parent / "weights" / "confidence" / "confidence.json"


@dataclass(frozen=True)
class EvidenceRules:
    """What makes evidence, and what a panel's probability is; chosen on the marked photos.

    Attributes:
        again: share of the panels that must be found again where the front is shown differently.
        doubt: the corners' spread, over the front's side, at which the box's evidence is 1/e.
        seen: score from which a handle counts as seen.
        bare: share of the evidence that is left where no panel shows a handle.
        places: agreement of the votes for a panel's place at which hardly any panel is right, and
            from which nearly all are. shares: the probabilities there.
    """

    again: float = 0.75
    doubt: float = 0.1
    seen: float = 0.35
    bare: float = 0.8
    places: tuple[float, float] = (0.15, 0.45)
    shares: tuple[float, float] = (0.05, 0.98)


RULES = EvidenceRules()


def evidence(found: Found, agree: float = 1.0) -> dict[str, float]:
    """Topic to the evidence that it is right, 0..1.

    For the box, how sure the network is of its front's corners. For panels, that times the weakest
    panel's: how well its place agrees with what votes for it (`tiling`) times how sure its kind
    is; where every panel shows a handle, or none shows any, no handle lies where a panel was
    missed and the front reads the same again; else 0. For handles, that times the weakest handle's
    score.

    Args:
        agree: whether the front reads the same when shown differently (`agreement`).
    """
    panels = found.reading.movable
    scores = [
        max((b.score for b in p.handles if b.provenance == "observed"), default=0.0) for p in panels
    ]
    box = box_evidence(found.doubt)
    bare = max(scores, default=0.0) == 0.0
    witnessed = bool(scores) and (bare or min(scores) > RULES.seen) and found.reading.missed < HALF
    if not witnessed or agree < RULES.again:
        return {"cuboid": box, "panels": 0.0, "handles": 0.0}
    seen = box * min(p.confidence * p.kind_confidence for p in panels)
    sure = RULES.bare if bare else 1.0
    return {"cuboid": box, "panels": seen * sure, "handles": seen * (sure if bare else min(scores))}


def panel_probability(panel: Panel) -> float:
    """0..1 that a panel is one, and of that kind.

    The first from how well the votes for its place agree (`EvidenceRules.places`).
    """
    place = np.interp(panel.confidence, RULES.places, RULES.shares)
    return float(place) * panel.kind_confidence


def box_evidence(doubt: float) -> float:
    """Evidence 0..1 that a box is right whose front's corners are this uncertain (`Found`)."""
    return float(np.exp(-doubt / RULES.doubt))


@lru_cache(maxsize=1)
def limits() -> dict[str, tuple[float, float]]:
    """Topic to the evidence from which it is high, and from which it is medium."""
    kept = json.loads(KEPT.read_text(encoding="utf-8"))
    return {k: (v["high"], v["medium"]) for k, v in kept["topics"].items()}


def words(found: Found, agree: float = 1.0) -> dict[str, str]:
    """Topic to high | medium | low."""
    out = {}
    for topic, value in evidence(found, agree).items():
        high, medium = limits()[topic]
        out[topic] = "high" if value >= high else "medium" if value >= medium else "low"
    return out
