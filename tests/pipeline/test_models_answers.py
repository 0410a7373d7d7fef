"""What the words of an answer mean: ranges, lines by pieces, nodes of the file."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trimesh

from mam_pipeline.models import motion_check, questions
from mam_pipeline.models.answers import Answered, tree_of, unblocked, with_ranges
from mam_pipeline.models.questions import Group, Mount, MountedPart, MountedParts, Mounting
from mam_pipeline.types import Articulation, Joint, Link, Mesh, Primitives, RangeBasis

Boxes = tuple[Mesh, Primitives]
DEPTH = 0.4  # of the body, along the way a drawer in it slides


def _made(boxes: Boxes, kind: str, **mount: Any) -> Answered:
    """The body, a part of some kind before it, and the knob on that, as they are answered."""
    named = {"parent": "body", "confidence": 1.0, "second_best": "fixed", "name": kind}
    still = {**named, "name": "grip", "parent": kind, "motion": "fixed", "axis": "x",
             "side": "middle", "opens": "either"}  # fmt: skip
    groups = [
        Group(name=name, kind=name, is_base=i == 0, pieces=[i], confidence=1.0)
        for i, name in enumerate(("body", kind, "grip"))
    ]
    mounts = [Mount.model_validate({**named, **mount}), Mount.model_validate(still)]
    made = tree_of(groups, Mounting(mounts=mounts), np.arange(3), *boxes, {})
    return with_ranges(made, *boxes)


HINGE = {"motion": "hinge", "axis": "z", "side": "-y", "opens": "-x"}
SPIN = {"motion": "spin", "axis": "x", "side": "middle", "opens": "either"}
SLIDE = {"motion": "slide", "axis": "x", "side": "middle", "opens": "-x"}
ENDLESS = (-np.inf, np.inf)


@pytest.mark.parametrize(
    ("kind", "mount", "limits"),
    [
        ("door", HINGE, None),  # as it is measured
        ("door", {**HINGE, "upper": 60}, (0.0, np.pi / 3)),
        ("door", {**HINGE, "lower": -90, "upper": 90}, (-np.pi / 2, np.pi / 2)),
        ("door", {**HINGE, "usual": True}, (0.0, np.radians(100.0))),
        ("wheel", SPIN, ENDLESS),
        ("wheel", {**SPIN, "endless": False}, None),
        ("burner_knob", SPIN, ENDLESS),
        ("burner_knob", {**SPIN, "upper": 90}, (0.0, np.pi / 2)),
        ("stool", SPIN, None),  # the table says nothing of what it turns
        ("stool", {**SPIN, "endless": True}, ENDLESS),
        ("drawer", {**SLIDE, "endless": True}, None),  # no slide is
        ("drawer", {**SLIDE, "upper": 50}, (0.0, 0.01)),  # of the 2 cm that it is thick
        ("drawer", {**SLIDE, "upper": 50, "of": "carrier"}, (0.0, DEPTH / 2)),
        ("drawer", {**SLIDE, "upper": 50, "of": "object"}, (0.0, 0.3)),  # it is 60 cm high
        ("drawer", {**SLIDE, "usual": True}, (0.0, 0.775 * DEPTH)),
    ],
)
def test_a_range_is_as_answered(
    boxes: Boxes, kind: str, mount: dict[str, Any], limits: tuple[float, float] | None
) -> None:
    node = _made(boxes, kind, **mount).tree.nodes[1]
    assert node.limits == (limits if limits is None else pytest.approx(limits))
    assert ("whatever overlaps" in str(node.evidence.get("range"))) == bool(mount.get("usual"))


@pytest.mark.parametrize(
    ("mount", "axis", "origin"),
    [
        ({**HINGE, "through": [2]}, (0, 0, 1), (-0.245, 0.18, 0.3)),
        ({**HINGE, "axis": "other", "through": [1, 2]}, (-0.03, 0.18, 0), (-0.215, 0, 0.3)),
        ({**HINGE, "axis": "other", "along": 1, "side": "+y"}, (0, 0, 1), (-0.215, 0.23, 0.3)),
        ({**HINGE, "axis": "other", "along": 1, "side": "middle"}, (0, 0, 1), (-0.215, 0, 0.3)),
    ],
)
def test_a_line_runs_by_the_pieces_that_are_named(
    boxes: Boxes, mount: dict[str, Any], axis: tuple[float, ...], origin: tuple[float, ...]
) -> None:
    (line,) = _made(boxes, "door", **mount).tree.nodes[1].candidates
    assert abs(line.axis @ np.array(axis)) == pytest.approx(np.linalg.norm(axis))
    off = np.cross(line.origin - np.array(origin), line.axis)
    assert np.linalg.norm(off) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        ({"through": [0, 9]}, "runs by pieces [9], which are not shown"),
        ({"through": [0, 0]}, "one piece or two different ones"),
        ({"through": [0], "along": 1}, "through or along, not both"),
        ({"lower": 10, "upper": 10}, "upper of door must be above its lower"),
    ],
)
def test_details_that_contradict_themselves_are_named(words: dict[str, Any], fault: str) -> None:
    door = MountedPart.model_validate({"name": "door", "pieces": [1], **HINGE, **words})
    said = questions.faults_of_parts(MountedParts(base="body", parts=[door]), {0, 1})
    assert fault in said


def test_a_node_of_the_file_stands_for_its_pieces() -> None:
    nodes = {"Door L": (1, 2, 3)}
    parts = [
        MountedPart.model_validate({"name": "door", "nodes": ["Door L"], **HINGE}),
        MountedPart.model_validate({"name": "lock", "pieces": [3], **SPIN}),
    ]
    answer = MountedParts(base="body", parts=parts)
    assert [p.pieces for p in answer.with_nodes(nodes).parts] == [[1, 2], [3]]
    assert questions.faults_of_nodes(answer, nodes) == ""
    assert "names no nodes ['Door L']" in questions.faults_of_nodes(answer, {"Door R": (1,)})
    assert "door has no pieces" in questions.faults_of_parts(answer, {0, 1, 2, 3})


def test_an_endpoint_of_strict_schemas_may_repeat_what_stays() -> None:
    door = {"parent": "body", "confidence": 1.0, "second_best": "fixed", "name": "door", **HINGE}
    words = {**dict.fromkeys(questions.Details.model_fields), "name": "door", "ok": False,
             "parent": "body", "line": None, **HINGE, "upper": 60}  # fmt: skip
    mounts = {"door": Mount.model_validate(door)}
    check = questions.MotionCheck.model_validate({"joints": [words], "transfers": []})
    assert not check.only_numbers and check.beside(mounts).only_numbers
    words["side"] = "+y"
    check = questions.MotionCheck.model_validate({"joints": [words], "transfers": []})
    assert check.beside(mounts).joints[0].model_dump(exclude_none=True) == {
        "name": "door", "ok": False, "side": "+y", "upper": 60.0,
    }  # fmt: skip


def test_what_may_be_left_out_stands_last_in_the_schema() -> None:
    part = questions.schema_of(MountedParts)["$defs"]["MountedPart"]["properties"]
    assert list(part)[:3] == ["name", "kind", "pieces"] and list(part)[-1] == "usual"


@pytest.fixture
def swung(boxes: Boxes) -> Articulation:
    """A door that something blocks after a few degrees, and its knob."""
    mesh, primitives = boxes
    links = tuple(
        Link(name, name, np.flatnonzero(primitives.labels == i))
        for i, name in enumerate(("body", "door", "knob"))
    )
    door = Joint(
        "door_joint", "revolute", "hinge", 0, 1, np.array([0.0, 0.0, 1.0]),
        np.array([-0.215, -0.23, 0.3]), 0.0, 0.1, basis=RangeBasis("collision", 0.06),
    )  # fmt: skip
    knob = replace(
        door, name="knob_joint", type="continuous", subtype="spin", parent=1, child=2,
        axis=np.array([1.0, 0.0, 0.0]), origin=np.array([-0.245, 0.18, 0.3]),
        basis=RangeBasis("endless"),
    )  # fmt: skip
    return Articulation(mesh, links, (door, knob))


def test_the_usual_range_is_offered_where_an_overlap_blocks(swung: Articulation) -> None:
    door, knob = swung.joints
    assert "as usual for a door it goes 100 deg (usual: true" in motion_check.verdict(swung, door)
    assert "usual: true" not in motion_check.verdict(swung, knob)
    free = replace(door, upper=1.5, basis=RangeBasis("collision", 0.9))
    assert "usual: true" not in motion_check.verdict(swung, free)
    taken = replace(door, upper=1.7, basis=RangeBasis("given"))
    said = motion_check.verdict(swung, taken, 0, "as usual for a door, as answered")
    assert said == "door, on body: turns about z, 0..97 degrees; as usual for a door, as answered"


def test_what_turns_and_has_ends_is_measured_like_a_hinge(boxes: Boxes) -> None:
    node = _made(boxes, "tap_handle", **{**SPIN, "endless": False}).tree.nodes[1]
    assert node.subtype == "hinge" and {c.subtype for c in node.candidates} == {"hinge"}
    assert _made(boxes, "tap_handle", **SPIN).tree.nodes[1].subtype == "spin"


@pytest.mark.parametrize("grown", [False, True])
def test_a_hinge_line_beside_what_it_joins_gives_way_to_one_on_both(grown: bool) -> None:
    """A handle on a spindle near its middle, said to turn at its end; at a plate that reaches
    there, it does."""
    plate, spindle, handle, block = (
        trimesh.creation.box(bounds=b)
        for b in (
            [[0.0, -0.3, -0.3], [0.03, 0.3, 0.3]],
            [[-0.05, 0.04, -0.01], [0.0, 0.06, 0.01]],
            [[-0.07, -0.1, -0.012], [-0.05, 0.15, 0.012]],
            [[-0.07, 0.15, -0.012], [0.0, 0.2, 0.012]],
        )
    )
    body = [plate, block] if grown else [plate]
    whole: Any = trimesh.util.concatenate([*body, spindle, handle])
    count = 12 * len(body)
    labels = (np.arange(len(whole.faces)) >= count).astype(np.int64)
    mesh, primitives = Mesh(whole.vertices, whole.faces), Primitives(labels)
    groups = [
        Group(name=name, kind=kind, is_base=not i, pieces=[i], confidence=1.0)
        for i, (name, kind) in enumerate((("body", "body"), ("latch", "lever")))
    ]
    mount = Mount.model_validate(
        {"name": "latch", "parent": "body", "motion": "hinge", "confidence": 1.0,
         "second_best": "spin", "axis": "x", "side": "+y", "opens": "either"}
    )  # fmt: skip
    made = tree_of(groups, Mounting(mounts=[mount]), np.arange(2), mesh, primitives, {})
    node = unblocked(made, mesh, primitives).tree.nodes[1]
    line = node.candidates[0]
    assert line.subtype == "hinge" and abs(line.axis[0]) > 0.99
    if grown:
        assert line.origin[1] == pytest.approx(0.15, abs=0.01) and "physics" not in node.evidence
    else:
        assert 0.03 < line.origin[1] < 0.07 and "beside what it joins" in node.evidence["physics"]


def test_a_verdict_has_no_empty_reasons(swung: Articulation) -> None:
    hidden = replace(swung.joints[0], basis=RangeBasis("", after_another=True))
    said = motion_check.verdict(swung, hidden)
    assert said == ("door, on body: turns about z, 0..6 degrees; only after another part has moved")


def test_a_part_that_is_hidden_shines_through(monkeypatch: pytest.MonkeyPatch) -> None:
    """A ball within a closed box is orange in no pixel, and makes some of the grey ones warmer."""
    shell, ball = trimesh.creation.box((1, 1, 1)), trimesh.creation.icosphere(radius=0.3)
    whole: Any = trimesh.util.concatenate([shell, ball])
    links = (
        Link("body", "body", np.arange(12)),
        Link("ball", "ball", np.arange(12, len(whole.faces))),
    )
    turn = Joint("ball_joint", "continuous", "spin", 0, 1, np.array([0, 0, 1.0]), np.zeros(3),
                 -np.inf, np.inf)  # fmt: skip
    made = Articulation(Mesh(whole.vertices, whole.faces), links, (turn,))
    monkeypatch.setattr(motion_check, "SHOW", replace(motion_check.SHOW, size=64, first_look=16))
    (sheet,) = motion_check.motion_sheets(made)
    warm = (sheet[..., 0].astype(int) - sheet[..., 2] > 30).mean()
    monkeypatch.setattr(motion_check, "SHOW", replace(motion_check.SHOW, through=0.0))
    (sheet,) = motion_check.motion_sheets(made)
    assert warm > (sheet[..., 0].astype(int) - sheet[..., 2] > 30).mean() + 0.02


def test_many_joints_are_shown_larger(swung: Articulation, monkeypatch: pytest.MonkeyPatch) -> None:
    for few, sheets in ((2, [(128, 96)]), (1, [(64, 96), (64, 96)])):
        small = replace(motion_check.SHOW, size=32, first_look=16, a_sheet=2, few=few)
        monkeypatch.setattr(motion_check, "SHOW", small)
        assert [s.shape[:2] for s in motion_check.motion_sheets(swung)] == sheets
