"""Each value of an asset says where it comes from, in the same words everywhere."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from mam_pipeline.asset.card import Asset, CardJoint
from mam_pipeline.asset.origins import (
    RANGES,
    friction_origin,
    mass_origin,
    motion_origin,
    range_origin,
    size_origin,
)
from mam_pipeline.types import Joint, Provenance, RangeBasis, RangeRule


def joint(provenance: Provenance, rule: RangeRule = "", assumed: str = "") -> Joint:
    evidence = {"limits": {"assumed": assumed}} if assumed else {}
    return Joint("j", "prismatic", "slide", 0, 1, np.array([1.0, 0, 0]), np.zeros(3), 0.0, 0.3,
                 confidence=0.979, basis=RangeBasis(rule), provenance=provenance,
                 evidence=evidence)  # fmt: skip


@pytest.mark.parametrize(("provenance", "source", "words"), [
    ("user", "photo", "said by you"),
    ("observed", "photo", "inferred from the photo, 98 % sure"),  # by our reader, not the user
    ("inferred", "mesh", "inferred, 98 % sure"),
    ("observed", "mesh", "read from the file"),  # an animation
    ("inferred", "urdf", "read from the file"),
    ("assumed", "photo", "assumed"),
    ("model", "photo", "inferred by a language model, 98 % sure"),
    ("model", "mesh", "inferred by a language model, 98 % sure"),
])  # fmt: skip
def test_who_says_that_a_part_moves(provenance: Provenance, source: str, words: str) -> None:
    assert str(motion_origin(joint(provenance), source)) == words


@pytest.mark.parametrize(("given", "source", "words"), [
    (joint("inferred", "depth", "assumed: 0.8 of its own depth"), "mesh",
     "assumed: 0.8 of its own depth"),
    (joint("user", "collision"), "mesh", "measured: until it meets something"),
    (joint("user", "given"), "mesh", "said by you"),
    (joint("observed", "given"), "photo", "inferred from the photo, 98 % sure"),
    (joint("inferred"), "urdf", "read from the file"),
])  # fmt: skip
def test_why_a_range_is_what_it_is(given: Joint, source: str, words: str) -> None:
    assert str(range_origin(given, source)) == words


def test_sizes_masses_and_friction() -> None:
    assert str(size_origin("assumed")) == "assumed: as large as such things are"
    assert str(size_origin("assumed: mm, for 500 units would be 0.5 m")).startswith("assumed: mm, ")
    assert str(size_origin("said by you")) == str(size_origin("user")) == "said by you"
    assert str(size_origin("read from the file")) == "read from the file"
    assert str(mass_origin("steel")) == "assumed: steel" and mass_origin("").kind == "read"
    assert friction_origin((1.0, 2.0)).kind == "assumed" and friction_origin((0, 0)).kind == "read"
    assert all(": " in origin.text for origin in RANGES.values())


def test_the_card_on_disk_says_it_too(tmp_path: Path) -> None:
    from mam_world.dataset import write_dataset

    write_dataset("station_button", 1, 0, tmp_path)
    asset = Asset.load(tmp_path / "station_button_000000")
    row = json.loads((asset.folder / "asset.json").read_text())["joints"][0]
    assert row["origins"]["motion"] == row["origins"]["range"] == "read from the file"
    assert isinstance(asset.card.joints[0], CardJoint) and asset.card.size is not None
