"""What is too unlikely to be a part stays still and is told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from mam_pipeline.errors import NotPhysicalError
from mam_pipeline.make_config import MakeConfig
from mam_pipeline.parts.abstain import SIGNS, Bar, load_bar, withheld, without
from mam_pipeline.parts.tree import left_out_note
from mam_pipeline.stages import Stages
from mam_pipeline.types import KinematicTree, Mesh, PartNode, Primitives

BAR = Bar(0.0, {"value": 1.0}, 0.5, 0.3, 0.2)


def _tree(*values: float) -> tuple[KinematicTree, dict[str, dict[str, float]]]:
    nodes = [PartNode("base", "body", (0,), -1, "fixed")]
    nodes += [
        PartNode(f"p{k}", "door", (k,), 0, "hinge", confidence=0.5)
        for k in range(1, len(values) + 1)
    ]
    signs = {f"p{k}": {"value": v} for k, v in enumerate(values, start=1)}
    return KinematicTree(tuple(nodes)), signs


def test_one_part_above_the_bar_lets_others_be_parts_that_are_less_likely() -> None:
    tree, signs = _tree(2.0, -1.0, -3.0)
    found = withheld(tree, signs, BAR)
    assert [n.name for n in found.nodes] == ["base", "p1", "p2"]
    assert found.nodes[0].primitives == (0, 3)
    assert "hinge of primitives 3" in left_out_note(found)


def test_with_no_part_above_the_bar_nothing_moves() -> None:
    tree, signs = _tree(-0.5, -1.0)
    found = withheld(tree, signs, BAR)
    assert len(found.nodes) == 1
    mesh = Mesh(np.eye(3), np.array([[0, 1, 2]] * 3))
    with pytest.raises(NotPhysicalError, match=r"chance of 0\.38; --accept-low-confidence"):
        Stages().solve(mesh, Primitives(np.arange(3)), found)


def test_what_an_animation_shows_is_kept_and_names_raise_the_chance() -> None:
    tree, signs = _tree(-3.0, -3.0)
    shown = replace(tree.nodes[1], provenance="observed")
    found = withheld(replace(tree, nodes=(tree.nodes[0], shown, tree.nodes[2])), signs, BAR)
    assert [n.name for n in found.nodes] == ["base", "p1"]
    named = replace(tree.nodes[1], evidence={"said": {"odds": 4.0}})
    found = withheld(replace(tree, nodes=(tree.nodes[0], named, tree.nodes[2])), signs, BAR)
    assert [n.name for n in found.nodes] == ["base", "p1"]


def test_as_many_parts_as_a_person_counted_are_kept() -> None:
    tree, signs = _tree(-1.0, -3.0, -2.0)
    assert [n.name for n in withheld(tree, signs, BAR, told=2).nodes] == ["base", "p1", "p3"]


def test_what_hangs_on_a_withheld_part_hangs_on_its_host() -> None:
    tree, _ = _tree(1.0, 1.0)
    nodes = (*tree.nodes[:2], replace(tree.nodes[2], parent=1))
    found = without(replace(tree, nodes=nodes), [1])
    assert [(n.name, n.parent) for n in found.nodes] == [("base", -1), ("p2", 0)]


def test_without_a_bar_only_the_signs_are_noted() -> None:
    tree, signs = _tree(-3.0)
    assert len(withheld(tree, signs).nodes) == 2


def test_low_confidence_is_accepted_for_batches() -> None:
    config = MakeConfig()
    assert config.engine_used.rules.abstain
    accepting = replace(config, photo=replace(config.photo, accept_low_confidence=True))
    assert not accepting.engine_used.rules.abstain


def test_the_fitted_bar_knows_its_signs() -> None:
    bar = load_bar()
    assert set(bar.weights) == set(SIGNS)
    assert 0.0 < bar.others < bar.fused < bar.least < 1.0
