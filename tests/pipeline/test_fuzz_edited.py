"""Every file that a person edits, with any values: a result or an error of ours (see test_fuzz)."""

from __future__ import annotations

import json
import random
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from mam_pipeline import config_file
from mam_pipeline.asset.card import Asset
from mam_pipeline.asset.writer import write_asset
from mam_pipeline.hints import load_hints
from mam_pipeline.make_config import MakeConfig
from mam_pipeline.stage_artefacts import articulation_codec, tree_codec
from mam_pipeline.types import KinematicTree, PartNode
from tests.pipeline.test_fuzz import changed, ours, replaced, two_parts, usual


@pytest.fixture(scope="module")
def asset(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_asset(two_parts(), tmp_path_factory.mktemp("fuzz_asset") / "a", name="a").folder


HINTS = {
    "schema": 1, "up": "z", "merge": [[0, 1]], "fixed": [2],
    "parts": [{
        "name": "door", "kind": "door", "primitives": [3], "nodes": ["a"], "parent": "body",
        "box": {"center": [0, 0, 0], "size": [1, 1, 1]},
        "joint": {"subtype": "hinge", "axis": [0, 0, 1], "origin": [0, 0, 0], "lower": 0.0,
                  "upper": 1.0, "hinge_side": "left"},
        "handle": {"center": [0, 0, 0], "size": [1, 1, 1]}, "confidence": 0.9,
        "provenance": "user",
    }],
}  # fmt: skip


def edited(file: Path, data: Any, rng: random.Random) -> None:
    """Write plain data as YAML, changed in its values or in its bytes."""
    text = yaml.safe_dump(replaced(data, rng) if rng.random() < 0.6 else data, sort_keys=False)
    file.write_bytes(changed(text.encode(), rng) if rng.random() < 0.6 else text.encode())


@usual
@given(seed=st.integers(0, 2**32))
def test_hints_of_any_values(seed: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    file = tmp_path_factory.getbasetemp() / "hints.yaml"
    edited(file, HINTS, random.Random(seed))
    ours(lambda: load_hints(file))


@usual
@given(seed=st.integers(0, 2**32))
def test_a_configuration_of_any_values(seed: int, tmp_path_factory: pytest.TempPathFactory) -> None:
    file = tmp_path_factory.getbasetemp() / "config.yaml"
    edited(file, config_file.plain(MakeConfig()), random.Random(seed))
    ours(lambda: config_file.fill(MakeConfig(), config_file.read(file), file).check())


@usual
@given(seed=st.integers(0, 2**32))
def test_parts_and_joints_of_any_values(
    seed: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder, rng = tmp_path_factory.getbasetemp() / "fuzz_stages", random.Random(seed)
    folder.mkdir(exist_ok=True)
    nodes = (PartNode("body", "body", (0,), -1, "fixed"), PartNode("d", "door", (1,), 0, "hinge"))
    truth = two_parts()
    trees, joints = tree_codec(2), articulation_codec(truth.mesh)
    trees.save(KinematicTree(nodes), folder / trees.filename)
    joints.save(truth, folder / joints.filename)
    codecs: tuple[Any, ...] = (trees, joints)
    for codec in codecs:
        file = folder / codec.filename
        edited(file, yaml.safe_load(file.read_text()), rng)
        ours(partial(codec.load, file, file))


@usual
@given(seed=st.integers(0, 2**32))
def test_an_asset_card_of_any_values(seed: int, asset: Path) -> None:
    rng, card = random.Random(seed), asset / "asset.json"
    before = card.read_bytes()
    try:
        if rng.random() < 0.5:
            card.write_bytes(changed(before, rng))
        else:
            card.write_text(json.dumps(replaced(json.loads(before), rng)))
        ours(lambda: Asset.load(asset))
    finally:
        card.write_bytes(before)
