"""What a leaf carries because its own joint is unclear."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mam_pipeline.joints.fittings import carried, carried_notes, is_minor, moves_if_above
from mam_pipeline.types import Joint, JointSubtype, KinematicTree, PartNode, Provenance


def node(name: str, kind: str, primitive: int, parent: int, **more: Any) -> PartNode:
    return PartNode(name, kind, (primitive,), parent, more.pop("subtype", "hinge"), **more)


def joint(child: int, parent: int, confidence: float) -> Joint:
    axis, origin = np.array([0, 0, 1.0]), np.zeros(3)
    return Joint(f"j{child}", "revolute", "hinge", parent, child, axis, origin, 0, 1,
                 confidence=confidence)  # fmt: skip


@pytest.mark.parametrize(
    ("leaf", "subtype", "kind", "share", "least"),
    [
        ("door", "hinge", "lever", 0.01, 0.9),
        ("door", "spin", "knob", 0.01, 0.7),
        ("door", "slide", "button", 0.01, 0.0),  # a button in a door
        ("door", "hinge", "lever", 0.1, 0.0),  # a large lever: of these some do turn
        ("door", "hinge", "lever", 0.3, 0.0),
        ("door", "hinge", "door", 0.5, 0.5),  # a pane
        ("panel", "hinge", "lid", 0.5, 0.5),
        ("panel", "slide", "panel", 0.5, 0.0),  # a leaf beside one that has the frame
        ("door", "hinge", "door", 1.5, 0.0),
        ("lever", "spin", "knob", 0.01, 0.0),
        ("wheel", "spin", "knob", 0.5, 0.0),
    ],
)
def test_only_small_fittings_and_panes_of_leaves_are_doubted(
    leaf: str, subtype: JointSubtype, kind: str, share: float, least: float
) -> None:
    assert moves_if_above(subtype, kind, leaf, share) == least


@pytest.mark.parametrize(
    ("confidence", "provenance", "stays"),
    [(0.6, "inferred", False), (0.71, "inferred", True), (0.1, "user", True),
     (0.1, "observed", True)],
)  # fmt: skip
def test_an_unclear_lever_becomes_its_doors(
    confidence: float, provenance: Provenance, stays: bool
) -> None:
    doubt = {"moves_if_above": 0.7}
    lever = node("lever_0", "lever", 2, 1, provenance=provenance, evidence=doubt)
    nodes = (
        node("base", "body", 0, -1, subtype="fixed"), node("door_0", "door", 1, 0), lever,
        node("drawer_0", "drawer", 3, 0, subtype="slide"), node("knob_0", "knob", 4, 3),
    )  # fmt: skip
    joints = {1: joint(1, 0, 0.9), 2: joint(2, 1, confidence), 3: joint(3, 0, 0.9),
              4: joint(4, 3, 0.9)}  # fmt: skip
    given = KinematicTree(nodes)
    tree, left = carried(given, joints)
    if stays:
        assert tree is given and all(left[k] is joints[k] for k in joints)
        assert carried_notes(left.values()) == []
        return
    assert [n.name for n in tree.nodes] == ["base", "door_0", "drawer_0", "knob_0"]
    assert tree.nodes[1].primitives == (1, 2)
    assert [n.parent for n in tree.nodes] == [-1, 0, 0, 2]
    assert {k: (j.parent, j.child) for k, j in left.items()} == {1: (0, 1), 2: (0, 2), 3: (2, 3)}
    (said,) = left[1].evidence["carries"]
    assert said["name"] == "lever_0" and said["confidence"] == 0.6
    (note,) = carried_notes(left.values())
    assert note.startswith("door_0: carries lever_0 (primitives 2)") and "hints" in note


def test_small_parts_are_minor_unless_three_are_alike() -> None:
    assert is_minor(0.2, [1.0, 0.2]) and is_minor(0.2, [1.0, 0.2, 0.2])
    assert not is_minor(0.2, [1.0, 0.2, 0.21, 0.19])
    assert not is_minor(0.4, [1.0, 0.4]) and not is_minor(1.0, [1.0])


def test_an_unclear_small_part_stays_in_the_base() -> None:
    doubt = {"moves_if_above": 0.4}
    lid, lamp = node("lid_0", "lid", 1, 0), node("knob_0", "knob", 2, 0, evidence=doubt)
    given = KinematicTree((node("base", "body", 0, -1, subtype="fixed"), lid, lamp))
    joints = {1: joint(1, 0, 0.9), 2: joint(2, 0, 0.3)}
    tree, left = carried(given, joints)
    assert [n.primitives for n in tree.nodes] == [(0, 2), (1,)]
    (note,) = carried_notes(left.values())
    assert note.startswith("base: carries knob_0")
    alone = KinematicTree((given.nodes[0], lamp))  # it is all there is
    tree, left = carried(alone, {1: joint(1, 0, 0.3)})
    assert tree is alone and list(left) == [1]


def test_what_carries_others_is_kept() -> None:
    door = node("door_0", "door", 1, 0)
    lever = node("lever_0", "lever", 2, 1, evidence={"moves_if_above": 0.7})
    nodes = (node("base", "body", 0, -1, subtype="fixed"), door, lever, node("b", "knob", 3, 2))
    joints = {1: joint(1, 0, 0.9), 2: joint(2, 1, 0.1), 3: joint(3, 2, 0.9)}
    given = KinematicTree(nodes)
    tree, left = carried(given, joints)
    assert tree is given and all(left[k] is joints[k] for k in joints)
