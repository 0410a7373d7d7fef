"""Hand-set scores: what the reasoner goes by when no learned model is at hand.

The rules of the study behind this engine, on the same features as the models: containment and
shared motion bind, big enclosing bodies stay, thin visible panels, round things in contact and
small bodies on large ones move.
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


def part_value(groups: Table) -> FloatArray:
    """(C,) expected overlap of a candidate with a true part, 0..1."""
    c = groups.column
    box = c("span_z") * c("span_small") * c("span_big")
    score = (
        -0.3 + 1.5 * (c("move") - 0.5) + 0.8 * (np.nan_to_num(c("inner_mean"), nan=0.6) - 0.5)
        - 1.2 * np.maximum(c("cut_high"), 0) - 2.0 * box - 2.0 * (c("hanging_share") > 0.01)
        + 1.5 * (np.nan_to_num(c("proud")) > 0.002) * (c("thin") < 0.3)
        + 0.8 * (c("revolve") > 0.88)
        + 0.8 * c("see_side") - 1.5 * (c("area") < 0.004) - 0.8 * (c("slim") < 0.15)
        + 0.4 * (c("touches_lead") > 0)
    )  # fmt: skip
    return 1 / (1 + np.exp(-2 * score))


def subtype_odds(groups: Table) -> FloatArray:
    """(C, 3) odds of hinge, spin and slide."""
    c = groups.column
    flat = c("thin") < 0.25
    offset = np.maximum(np.nan_to_num(c("proud_off_a")), np.nan_to_num(c("proud_off_b")))
    hinge = 0.4 + 1.0 * (flat & (offset > 0.4)) + 0.4 * (flat & (c("extent_z") > 0.3))
    spin = 0.1 + 1.5 * (c("revolve") > 0.85) * (c("size0") < 0.6)
    slide = 0.4 + 0.8 * (~flat) + 0.8 * (flat & (offset < 0.25) & (np.nan_to_num(c("proud")) > 0))
    odds = np.exp(np.stack([hinge, spin, slide], axis=1))
    out: FloatArray = odds / odds.sum(axis=1, keepdims=True)
    return out
