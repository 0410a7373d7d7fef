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
from typing import TYPE_CHECKING, Any

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
        clear: evidence of the corners alone from which an object is looked at by itself.
        again: share of the panels that must be found again where the front is shown differently.
        doubt: the corners' spread, over the front's side, at which the box's evidence is 1/e.
        cost: of the fitted box, at which it is, too: what network and outline say against it.
        seen: score from which a handle counts as seen.
        bare: share of the evidence that is left where no panel shows a handle.
        places: agreement of the votes for a panel's place at which hardly any panel is right, and
            from which nearly all are. shares: the probabilities there.
    """

    again: float = 0.75
    doubt: float = 0.1
    cost: float = 1.0
    clear: float = 0.39
    seen: float = 0.35
    bare: float = 0.8
    places: tuple[float, float] = (0.15, 0.45)
    shares: tuple[float, float] = (0.05, 0.98)


RULES = EvidenceRules()


def evidence(found: Found, agree: float = 1.0) -> dict[str, float]:
    """Topic to the evidence that it is right, 0..1.

    For the box, how sure the network is of its front's corners, and how well a box fits what is
    seen. For panels, that times the weakest panel's: how well its place agrees with what votes for
    it (`tiling`) times how sure its kind is; where every panel shows a handle, or none shows any,
    no handle lies where a panel was missed and the front reads the same again; else 0. For handles,
    that times the weakest handle's score.

    Args:
        agree: whether the front reads the same when shown differently (`agreement`).
    """
    panels = found.reading.movable
    scores = [
        max((b.score for b in p.handles if b.provenance == "observed"), default=0.0) for p in panels
    ]
    box = box_evidence(found)
    bare = max(scores, default=0.0) == 0.0
    witnessed = bool(scores) and (bare or min(scores) > RULES.seen) and found.reading.missed < HALF
    if not witnessed or agree < RULES.again:
        return {"cuboid": box, "panels": 0.0, "handles": 0.0}
    seen = box * min(p.confidence * p.kind_confidence for p in panels)
    sure = RULES.bare if bare else 1.0
    return {"cuboid": box, "panels": seen * sure, "handles": seen * (sure if bare else min(scores))}


def panel_probability(panel: Panel, all_right: float = 1.0, panels: int = 1) -> float:
    """0..1 that a panel is one, and of that kind.

    The first from how well the votes for its place agree (`EvidenceRules.places`); what nobody said
    is no surer than it must be for all panels to be right as often as they are.

    Args:
        all_right: how often all panels of such a front are right (`right_share`). panels: of it.
    """
    place = np.interp(panel.confidence, RULES.places, RULES.shares)
    most = 1.0 if panel.told else all_right ** (1 / max(panels, 1))
    return min(float(place) * panel.kind_confidence, most)


def right_share(topic: str, word: str) -> float:
    """How often a topic was right where it was called high, medium or low (Laplace's rule); 1 for
    another word: somebody said it."""
    row = _kept()[topic]["record"].get(word)
    return 1.0 if row is None else float((row["right"] + 1) / (row["called"] + 2))


def box_evidence(found: Found) -> float:
    """Evidence 0..1 that the box is right; 1 where the user gave its front."""
    if found.front_given:
        return 1.0
    return fit_evidence(found.doubt, found.cost)


def fit_evidence(doubt: float, cost: float) -> float:
    """Evidence 0..1 that a fitted box is right: of its front's corners' doubt, and its cost."""
    return corner_evidence(doubt) * float(np.exp(-cost / RULES.cost))


def corner_evidence(doubt: float) -> float:
    """Evidence 0..1 of the front's corners alone, which are this uncertain (`Found`)."""
    return float(np.exp(-doubt / RULES.doubt))


@lru_cache(maxsize=1)
def _kept() -> dict[str, Any]:
    topics: dict[str, Any] = json.loads(KEPT.read_text(encoding="utf-8"))["topics"]
    return topics


def limits() -> dict[str, tuple[float, float]]:
    """Topic to the evidence from which it is high, and from which it is medium."""
    return {k: (v["high"], v["medium"]) for k, v in _kept().items()}


def words(found: Found, agree: float = 1.0) -> dict[str, str]:
    """Topic to high | medium | low."""
    out = {}
    for topic, value in evidence(found, agree).items():
        high, medium = limits()[topic]
        out[topic] = "high" if value >= high else "medium" if value >= medium else "low"
    return out
