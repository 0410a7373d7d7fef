"""Task texts read like language, and tell parts of one kind apart by their place."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from mam_envs.object_model import ObjectModel
from mam_pipeline.asset.card import Asset
from mam_policies.task_words import COLUMNS, ROWS, _groups, _place, part_words


def test_two_drawers_are_told_apart(drawer: Path, two_drawers: Path) -> None:
    alone = ObjectModel.load(Asset.load(drawer))
    assert part_words(alone, "joint_1") == "drawer"
    both = ObjectModel.load(Asset.load(two_drawers))
    assert part_words(both, "joint_1") == "bottom drawer"
    assert part_words(both, "joint_2") == "top drawer"


def test_rows_and_columns() -> None:
    spans = np.array([[0.0, 1.0], [0.1, 1.1], [2.0, 3.0]])
    assert _groups(spans, falling=True) == [1, 1, 0]
    assert _place(1, 3, ROWS, "from the top") == "middle"
    assert _place(1, 4, ROWS, "from the top") == "second from the top"
    assert _place(3, 4, COLUMNS, "from the left") == "right"
