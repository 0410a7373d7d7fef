"""Hand-set first guesses, by which the first network's training groups are drawn up.

Containment and shared motion bind, big enclosing bodies stay, thin visible panels, round things in
contact and small bodies on large ones move.
"""

from __future__ import annotations

import numpy as np

from mam_pipeline.parts.features import Table
from mam_pipeline.types import FloatArray


def same_part(pairs: Table) -> FloatArray:
    """(E,) how surely the two primitives of a pair are one rigid body, 0..1."""
    c = pairs.column
    bond = np.nan_to_num(c("affinity"), nan=0.3)
    score = (
        -0.4 + 2.0 * c("inside") + 1.5 * bond + 0.8 * c("touch_b")
        - 20 * np.maximum(c("gap") - 0.01, 0)
        - 1.5 * (c("b_area") > 0.1) + 0.8 * (c("area_ratio") < -2.5) - 1.5 * (c("a_area") > 0.4)
    )  # fmt: skip
    return 1 / (1 + np.exp(-2 * score))


def may_move(unary: Table) -> FloatArray:
    """(P,) how surely a primitive belongs to a moving part, 0..1."""
    c = unary.column
    box = c("span_z") * c("span_small") * c("span_big")
    score = (
        0.6 - 3.0 * box - 1.0 * (c("rank") == 0) + 0.8 * c("see_side") + 0.5 * (c("thin") < 0.2)
        + 0.8 * (c("revolve") > 0.85) - 0.8 * (c("low") < 0.02)
    )  # fmt: skip
    return 1 / (1 + np.exp(-2 * score))
