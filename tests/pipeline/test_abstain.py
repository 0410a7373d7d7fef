"""What is too unlikely to be a part is dormant."""

from __future__ import annotations

from dataclasses import replace

import pytest
from scipy.special import expit, logit

from mam_pipeline.dormant import awake, woken
from mam_pipeline.joints.solver import confidence_of
from mam_pipeline.parts.abstain import SIGNS, Bar, load_bar, withheld
from mam_pipeline.types import KinematicTree, PartNode

BAR = Bar(0.0, {"value": 1.0}, 0.2, (-0.5, 1.0))


def _tree(*values: float) -> tuple[KinematicTree, dict[str, dict[str, float]]]:
    nodes = [PartNode("base", "body", (0,), -1, "fixed")]
    nodes += [
        PartNode(f"p{k}", "door", (k,), 0, "hinge", confidence=0.5)
        for k in range(1, len(values) + 1)
    ]
    signs = {f"p{k}": {"value": v, "free": 1.0, "sure": 0.9} for k, v in enumerate(values, start=1)}
    return KinematicTree(tuple(nodes)), signs


def test_parts_below_the_bar_are_dormant_and_say_why() -> None:
    tree, signs = _tree(2.0, -1.0, -3.0)
    found = withheld(tree, signs, BAR)
    assert [n.name for n in awake(found).nodes] == ["base", "p1", "p2"]
    assert found.nodes[3].dormant == "its chance is 0.05, and 0.20 is needed"
    assert found.nodes[3].confidence == 0.047


def test_what_an_animation_shows_is_kept_and_names_raise_the_chance() -> None:
    tree, signs = _tree(-3.0, -3.0)
    shown = replace(tree.nodes[1], provenance="observed")
    found = withheld(replace(tree, nodes=(tree.nodes[0], shown, tree.nodes[2])), signs, BAR)
    assert [n.name for n in awake(found).nodes] == ["base", "p1"]
    named = replace(tree.nodes[1], evidence={"said": {"odds": 4.0}})
    found = withheld(replace(tree, nodes=(tree.nodes[0], named, tree.nodes[2])), signs, BAR)
    assert [n.name for n in awake(found).nodes] == ["base", "p1"]


def test_as_many_parts_as_a_person_counted_are_kept() -> None:
    tree, signs = _tree(-1.0, -3.0, -2.0)
    found = withheld(tree, signs, BAR, told=2)
    assert [n.name for n in awake(found).nodes] == ["base", "p1", "p3"]


def test_no_more_parts_than_a_person_counted_are_kept() -> None:
    tree, signs = _tree(3.0, 2.0, 1.0)
    found = withheld(tree, signs, BAR, told=1)
    assert [n.name for n in awake(found).nodes] == ["base", "p1"]
    assert found.nodes[2].dormant.startswith("1 were told")


def test_a_stated_part_needs_no_score_but_must_be_free_to_move() -> None:
    tree, signs = _tree(-3.0, -3.0)
    stated = [replace(n, evidence={"said": {"chance": 0.9}}) for n in tree.nodes[1:]]
    signs["p2"]["free"] = 0.0
    found = withheld(replace(tree, nodes=(tree.nodes[0], *stated)), signs, BAR)
    assert [n.name for n in awake(found).nodes] == ["base", "p1"]
    assert found.nodes[1].evidence["chance"] == 0.9


def test_without_a_bar_only_the_signs_are_noted() -> None:
    tree, signs = _tree(-3.0)
    assert not withheld(tree, signs).nodes[1].dormant


def test_the_fitted_bar_knows_its_signs() -> None:
    bar = load_bar()
    assert set(bar.weights) == set(SIGNS)
    assert 0.0 < bar.least < 1.0


def test_a_joint_is_as_sure_as_real_objects_taught() -> None:
    tree, signs = _tree(2.0, -3.0)
    found = withheld(tree, signs, BAR)
    moves, asleep = found.nodes[1:]
    chance = expit(2.0)
    assert moves.confidence == pytest.approx(chance)
    said = expit(-0.5 + logit(0.9 * chance))
    assert confidence_of(moves, 0.9) == pytest.approx(said, abs=1e-3)
    # whose word stands, and what sleeps, is told as it is
    user = replace(moves, provenance="user", confidence=1.0)
    assert confidence_of(user, 1.0) == 1.0
    assert confidence_of(asleep, 0.9) == pytest.approx(0.9 * asleep.confidence)
    accepted = woken(found, ["p2"]).nodes[2]
    assert confidence_of(accepted, 0.9) == 0.9


def test_the_fitted_map_of_confidence_is_monotone() -> None:
    bar = load_bar()
    said = [bar.right(chance, 0.9) for chance in (0.2, 0.5, 0.8, 0.99)]
    assert said == sorted(said) and said[0] < 0.4 and said[-1] > 0.7
