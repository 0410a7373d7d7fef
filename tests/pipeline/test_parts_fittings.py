"""What a panel carries because its own joint is unclear."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from mam_pipeline.parts.rules.fittings import carried, carried_notes, is_fitting, is_minor
from mam_pipeline.types import JointSubtype, KinematicTree, PartNode, Provenance


def node(name: str, kind: str, primitive: int, parent: int, **more: Any) -> PartNode:
    return PartNode(name, kind, (primitive,), parent, more.pop("subtype", "hinge"), **more)


@pytest.mark.parametrize(
    ("host", "subtype", "share", "yes"),
    [
        ("door", "hinge", 0.01, True),
        ("door", "spin", 0.01, True),
        ("door", "slide", 0.01, False),  # a button in a door
        ("door", "hinge", 0.1, False),
        ("lever", "spin", 0.01, False),
    ],
)
def test_a_small_part_that_turns_on_a_panel_is_a_lever_or_a_knob(
    host: str, subtype: JointSubtype, share: float, yes: bool
) -> None:
    assert is_fitting(subtype, host, share) == yes


@pytest.mark.parametrize(
    ("confidence", "provenance", "stays"),
    [(0.6, "inferred", False), (0.71, "inferred", True), (0.1, "user", True),
     (0.1, "observed", True)],
)  # fmt: skip
def test_an_unclear_lever_becomes_its_doors(
    confidence: float, provenance: Provenance, stays: bool
) -> None:
    lever = node("lever_0", "lever", 2, 1, provenance=provenance)
    nodes = (
        node("base", "body", 0, -1, subtype="fixed"), node("door_0", "door", 1, 0), lever,
        node("drawer_0", "drawer", 3, 0, subtype="slide"), node("knob_0", "knob", 4, 3),
    )  # fmt: skip
    given = KinematicTree(nodes)
    tree = carried(given, {1: 0.9, 2: confidence, 3: 0.9, 4: 0.9}, {2: 0.7})
    if stays:
        assert tree is given and carried_notes(tree) == []
        return
    assert [n.name for n in tree.nodes] == ["base", "door_0", "drawer_0", "knob_0"]
    assert tree.nodes[1].primitives == (1, 2)
    assert [n.parent for n in tree.nodes] == [-1, 0, 0, 2]
    (note,) = carried_notes(tree)
    assert note.startswith("door_0: carries lever_0 (primitives 2)") and "hints" in note
    without = replace(tree.nodes[1], primitives=(1,))  # a person took it out again
    assert carried_notes(replace(tree, nodes=(tree.nodes[0], without))) == []


def test_nothing_is_added_to_what_a_person_made_a_part() -> None:
    door, lever = node("door_0", "door", 1, 0, provenance="user"), node("lever_0", "lever", 2, 1)
    given = KinematicTree((node("base", "body", 0, -1, subtype="fixed"), door, lever))
    assert carried(given, {1: 0.9, 2: 0.1}, {2: 0.7}) is given


def test_small_parts_are_minor_unless_three_are_alike() -> None:
    assert is_minor(0.2, [1.0, 0.2]) and is_minor(0.2, [1.0, 0.2, 0.2])
    assert not is_minor(0.2, [1.0, 0.2, 0.21, 0.19])
    assert not is_minor(0.4, [1.0, 0.4]) and not is_minor(1.0, [1.0])


def test_an_unclear_small_part_stays_in_the_base() -> None:
    lid, lamp = node("lid_0", "lid", 1, 0), node("knob_0", "knob", 2, 0)
    given = KinematicTree((node("base", "body", 0, -1, subtype="fixed"), lid, lamp))
    tree = carried(given, {1: 0.9, 2: 0.3}, {2: 0.4})
    assert [n.primitives for n in tree.nodes] == [(0, 2), (1,)]
    (note,) = carried_notes(tree)
    assert note.startswith("base: carries knob_0")
    alone = KinematicTree((given.nodes[0], lamp))  # it is all there is
    assert carried(alone, {1: 0.3}, {1: 0.4}) is alone


def test_what_carries_others_is_kept() -> None:
    nodes = (
        node("base", "body", 0, -1, subtype="fixed"), node("door_0", "door", 1, 0),
        node("lever_0", "lever", 2, 1), node("b", "knob", 3, 2),
    )  # fmt: skip
    given = KinematicTree(nodes)
    assert carried(given, {1: 0.9, 2: 0.1, 3: 0.9}, {2: 0.7}) is given
