"""Hints: a person's word outranks the reasoner's."""

from __future__ import annotations

import numpy as np
import pytest

from mam_pipeline.errors import ConfigError
from mam_pipeline.hints import HintBox, HintJoint, HintPart, Hints
from mam_pipeline.parts.hints import apply_hints
from mam_pipeline.types import KinematicTree, Mesh, PartNode, Primitives


def scene() -> tuple[Mesh, Primitives, KinematicTree]:
    """Four unit triangles in a row, one primitive each; 1 and 2 are one door."""
    vertices = np.concatenate([[[k, 0, 0], [k + 0.5, 0, 0], [k, 0, 0.5]] for k in range(4)])
    mesh = Mesh(
        vertices,
        np.arange(12).reshape(4, 3),
        face_group=np.array([0, 1, 1, 2]),
        group_names=("box", "front", "knob"),
    )
    base = PartNode("base", "body", (0, 3), -1, "fixed")
    door = PartNode("door_0", "door", (1, 2), 0, "hinge", confidence=0.6)
    return mesh, Primitives(np.arange(4)), KinematicTree((base, door))


def apply(hints: Hints) -> dict[str, PartNode]:
    mesh, primitives, tree = scene()
    out = apply_hints(tree, primitives, mesh, hints)
    assert sorted(p for n in out.nodes for p in n.primitives) == [0, 1, 2, 3]
    return {n.name: n for n in out.nodes}


def test_no_hints_no_change() -> None:
    mesh, primitives, tree = scene()
    assert apply_hints(tree, primitives, mesh, Hints()) is tree


def test_merge_joins_the_part_that_owns_most() -> None:
    assert apply(Hints(merge=((1, 2, 3),)))["door_0"].primitives == (1, 2, 3)


def test_fixed_goes_back_to_the_base_and_empty_parts_disappear() -> None:
    nodes = apply(Hints(fixed=(1, 2)))
    assert list(nodes) == ["base"]


def test_a_part_by_box_node_or_index() -> None:
    box = HintBox((3.25, 0, 0.25), (0.6, 0.1, 0.6))
    for part in (
        HintPart("dial", "knob", box=box),
        HintPart("dial", "knob", nodes=("knob",)),
        HintPart("dial", "knob", primitives=(3,)),
    ):
        node = apply(Hints(parts=(part,)))["dial"]
        assert node.primitives == (3,) and node.subtype == "spin" and node.provenance == "user"


def test_axis_limits_and_parent_are_taken_over() -> None:
    joint = HintJoint("slide", axis=(-2, 0, 0), origin=(1, 2, 3), lower=0.0, upper=0.3)
    part = HintPart("tray", "drawer", primitives=(3,), parent="door_0", joint=joint)
    mesh, primitives, tree = scene()
    out = apply_hints(tree, primitives, mesh, Hints(parts=(part,)))
    node = out.nodes[2]
    assert out.nodes[node.parent].name == "door_0"
    assert node.limits == (0.0, 0.3)
    assert node.candidates[0].axis == pytest.approx([-1, 0, 0])
    assert node.candidates[0].origin == pytest.approx([1, 2, 3])


def test_a_forbidden_motion_and_a_hinge_side() -> None:
    still = HintPart("door_0", primitives=(1, 2), joint=HintJoint("fixed"))
    assert list(apply(Hints(parts=(still,)))) == ["base"]
    left = HintPart("flap", "door", primitives=(3,), joint=HintJoint("hinge", hinge_side="top"))
    candidate = apply(Hints(parts=(left,)))["flap"].candidates[0]
    assert abs(candidate.axis[1]) == 1 and candidate.origin[2] == pytest.approx(0.5)


def test_a_hinted_name_replaces_the_old_part() -> None:
    nodes = apply(Hints(parts=(HintPart("door_0", "lid", primitives=(1, 2, 3)),)))
    assert nodes["door_0"].primitives == (1, 2, 3) and nodes["door_0"].kind == "lid"


@pytest.mark.parametrize(
    ("hints", "text"),
    [
        (Hints(fixed=(9,)), "no primitive 9"),
        (Hints(parts=(HintPart("x", nodes=("frnt",)),)), "did you mean 'front'"),
        (Hints(parts=(HintPart("x"),)), "has no primitive"),
        (Hints(parts=(HintPart("x", primitives=(3,), parent="dor_0"),)), "did you mean 'door_0'"),
    ],
)
def test_errors_name_the_way_out(hints: Hints, text: str) -> None:
    mesh, primitives, tree = scene()
    with pytest.raises(ConfigError, match=text):
        apply_hints(tree, primitives, mesh, hints)
