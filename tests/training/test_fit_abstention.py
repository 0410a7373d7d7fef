"""The chances that are fitted on labels: that a part is real, and that its joint is right."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mam_pipeline.parts.abstain import SIGNS, Bar
from mam_training.parts.fit_abstention import crossed, crossed_line, fitted_line, record


def objects(count: int, seed: int = 0) -> list[dict[str, Any]]:
    """Objects with one part each, real by the odds of one sign; of real ones the line is right as
    often as half of what it is said to be."""
    rng = np.random.default_rng(seed)
    out = []
    for k in range(count):
        odds, sure = rng.uniform(-3, 3), rng.uniform(0.2, 1.0)
        real = rng.random() < 1 / (1 + np.exp(-odds))
        right = bool(real and rng.random() < 0.5 * sure)
        signs = {**dict.fromkeys(SIGNS, 0.0), "value": odds, "sure": sure}
        part = {"signs": signs, "iou": float(real), "right": right}
        out.append({"name": str(k), "repo": str(k % 5), "true": 1, "parts": [part]})
    return out


def test_a_joint_is_said_to_be_right_as_often_as_it_was() -> None:
    rows = objects(3000)
    chance = crossed(rows)
    said = crossed_line(rows, 0.2)
    awake = chance >= 0.2
    right = np.array([float(r["parts"][0]["right"]) for r in rows])
    assert said[awake].mean() == pytest.approx(right[awake].mean(), abs=0.02)
    assert said[awake].max() < 0.7 and chance.max() > 0.9
    found = record(rows, chance, Bar(0.0, {}, 0.2, fitted_line(rows, chance, 0.2)))
    assert found["joint_calibration_error"] < 0.06 and found["joints"] == awake.sum()


def test_a_line_that_was_never_right_is_never_likely() -> None:
    rows = objects(200)
    for row in rows:
        row["parts"][0]["right"] = False
    bias, weight = fitted_line(rows, np.full(200, 0.9), 0.2)
    assert bias < -3 and weight >= 0.0
