"""How far to trust a reading: the evidence that box, panels and handles are right, as words.

The evidence of each is a number of 0..1 that the reading itself yields. The limits of "high" and
"medium" stand in confidence.json: mam_training.photo.fit_confidence sets them on marked real
photos, and keeps beside them how many readings were called so and how many of these were right.
"""

from __future__ import annotations

import json
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from mam_pipeline.photo.handles import HALF
from mam_pipeline.photo.panel import Panel

if TYPE_CHECKING:
    from mam_pipeline.photo.find import Found

TOPICS = ("cuboid", "panels", "handles")
AGAIN = 0.75  # of the panels must be found again where the front is shown differently
DOUBT = 0.1  # of the front's side: the corners' spread at which the evidence falls to 1/e
PLACES = (0.15, 0.45)  # agreement of the votes for a panel's place
BARE = 0.8  # of the evidence is left where no panel shows a handle
SEEN = 0.35  # score from which a handle counts as seen
KEPT = Path(__file__).parent / "weights" / "confidence" / "confidence.json"


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
    witnessed = bool(scores) and (bare or min(scores) > SEEN) and found.reading.missed < HALF
    if not witnessed or agree < AGAIN:
        return {"cuboid": box, "panels": 0.0, "handles": 0.0}
    seen = box * min(p.confidence * p.kind_confidence for p in panels)
    sure = BARE if bare else 1.0
    return {"cuboid": box, "panels": seen * sure, "handles": seen * (sure if bare else min(scores))}


def panel_probability(panel: Panel) -> float:
    """0..1 that a panel is one, and of that kind.

    On marked photos nearly all panels are right whose votes agree by PLACES[1] or more, and none by
    PLACES[0] or less.
    """
    place = np.interp(panel.confidence, PLACES, (0.05, 0.98))
    return float(place) * panel.kind_confidence


def box_evidence(doubt: float) -> float:
    """Evidence 0..1 that a box is right whose front's corners are this uncertain (`Found`)."""
    return float(np.exp(-doubt / DOUBT))


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
