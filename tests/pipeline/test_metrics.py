"""The metrics pinned on closed-form cases, the parallel-hinge case included."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trimesh
from mam_sim_bench.metrics import limit_iou, pivot_distance, score

from mam_pipeline.types import NEEDS_REVIEW, Articulation, Joint, JointType, Link, Mesh
from mam_world.ground_truth import GroundTruth


def cabinet(
    door_type: JointType = "revolute", lower: float = 0.0, upper: float = 1.5
) -> GroundTruth:
    """A 1 m box with a door (1 x 0.02 x 1 m) in front, hinged on the vertical edge x = -0.5."""
    body = trimesh.creation.box(extents=(1, 1, 1))
    door = trimesh.creation.box(extents=(1, 0.02, 1))
    door.apply_translation((0, -0.52, 0))
    vertices = np.concatenate([body.vertices, door.vertices])
    faces = np.concatenate([body.faces, door.faces + len(body.vertices)])
    labels = np.repeat([0, 1], [len(body.faces), len(door.faces)])
    joint = Joint(
        "hinge",
        door_type,
        "hinge",
        0,
        1,
        np.array([0, 0, 1.0]),
        np.array([-0.5, -0.52, 0]),
        lower,
        upper,
    )
    links = (Link("base", "body", np.arange(12)), Link("door", "door", np.arange(12, 24)))
    return GroundTruth("cabinet", "test", Mesh(vertices, faces), labels, links, (joint,))


def changed(truth: GroundTruth, **values: Any) -> Articulation:
    """The truth as an answer, with some values of its one joint replaced."""
    answer = truth.truth_articulation()
    return replace(answer, joints=(replace(answer.joints[0], **values),))


def test_the_truth_scores_perfectly_against_itself() -> None:
    truth = cabinet()
    s = score(truth.truth_articulation(), truth)
    assert s.miou == pytest.approx(1.0, abs=0.005) and s.count == 1 and s.type_error == 0
    assert s.axis == 0 and s.pivot == pytest.approx(0) and s.motion == pytest.approx(0)
    assert s.limits == pytest.approx(1) and s.axis_signed == pytest.approx(0, abs=1e-6)


def test_a_hinge_shifted_sideways_is_not_free() -> None:
    # the line-to-line formula of several published evaluators gives 0 here
    z = np.array([0.0, 0.0, 1.0])
    assert pivot_distance(z, np.zeros(3), z, np.array([0.5, 0.0, 0.0]), (-1, 1)) == pytest.approx(
        0.5
    )
    truth = cabinet()
    s = score(changed(truth, origin=[0.0, -0.52, 0.0]), truth)
    assert s.axis == 0 and s.pivot == pytest.approx(0.5 / truth.mesh.diagonal)


def test_a_nearly_parallel_shifted_hinge_is_not_free_either() -> None:
    z = np.array([0.0, 0.0, 1.0])
    tilted = np.array([1e-3, 0.0, 1.0]) / np.linalg.norm([1e-3, 0.0, 1.0])
    gap = pivot_distance(z, np.zeros(3), tilted, np.array([0.5, 0.0, 0.0]), (-1, 1))
    assert gap == pytest.approx(0.5, abs=1e-3)


def test_moving_the_origin_along_the_axis_changes_nothing() -> None:
    truth = cabinet()
    s = score(changed(truth, origin=[-0.5, -0.52, 7.0]), truth)
    assert s.pivot == pytest.approx(0, abs=1e-9) and s.motion == pytest.approx(0, abs=1e-9)


def test_axis_is_folded_and_the_signed_form_is_not() -> None:
    truth = cabinet()
    s = score(changed(truth, axis=[0, 0, -1]), truth)
    assert s.axis == pytest.approx(0) and s.axis_signed == pytest.approx(np.pi)
    assert s.limits == 0 and s.motion == pytest.approx(0, abs=1e-9)
    # the same joint written the other way round is perfect in every form
    s = score(changed(truth, axis=[0, 0, -1], lower=-1.5, upper=0.0), truth)
    assert s.axis_signed == pytest.approx(0, abs=1e-6) and s.limits == pytest.approx(1)


@pytest.mark.parametrize("angle", [0.2, 0.7, 1.4])
def test_axis_error_is_the_angle(angle: float) -> None:
    truth = cabinet()
    s = score(changed(truth, axis=[np.sin(angle), 0, np.cos(angle)]), truth)
    assert s.axis == pytest.approx(angle)


def test_nothing_found_costs_the_penalties() -> None:
    truth = cabinet()
    s = score(None, truth)
    assert (s.miou, s.count, s.type_error, s.limits) == (0, 0, 1, 0)
    assert s.axis == pytest.approx(np.pi / 2) and s.pivot == 0.5
    assert s.axis_signed == pytest.approx(np.pi) and s.motion > 0.1


def test_types() -> None:
    truth = cabinet()
    assert score(changed(truth, type="continuous"), truth).type_error == 0
    s = score(changed(truth, type="prismatic"), truth)
    assert s.type_error == 1 and s.pivot == 0.5 and s.limits == 0


def test_slides_have_no_pivot() -> None:
    truth = cabinet("prismatic", 0.0, 0.3)
    assert score(truth.truth_articulation(), truth).pivot is None
    assert score(None, truth).pivot is None


def test_motion_of_a_slide_is_half_its_range_when_missed() -> None:
    truth = cabinet("prismatic", 0.0, 0.3)
    assert score(None, truth).motion == pytest.approx(0.15 / truth.mesh.diagonal)
    s = score(changed(truth, axis=[1, 0, 0]), truth)  # square to the truth: sqrt(2) times as far
    assert s.motion == pytest.approx(0.15 * np.sqrt(2) / truth.mesh.diagonal)


@pytest.mark.parametrize(
    ("changes", "right"),
    [
        ({}, True),
        ({"type": "continuous"}, True),
        ({"type": "prismatic"}, False),
        ({"axis": [np.sin(0.09), 0, np.cos(0.09)]}, True),
        ({"axis": [np.sin(0.12), 0, np.cos(0.12)]}, False),
        ({"origin": [-0.43, -0.52, 0.0]}, True),  # 0.07 m of a diagonal of 1.74 m
        ({"origin": [-0.40, -0.52, 0.0]}, False),
    ],
)
def test_a_joint_is_right_in_every_respect_or_not_at_all(
    changes: dict[str, Any], right: bool
) -> None:
    truth = cabinet()
    (found,) = score(changed(truth, confidence=0.4, **changes), truth).found
    assert found.right is right and found.flagged and found.confidence == 0.4
    (found,) = score(changed(truth, confidence=NEEDS_REVIEW, **changes), truth).found
    assert not found.flagged


def test_surplus_parts_lower_miou_and_count() -> None:
    truth = cabinet()
    answer = truth.truth_articulation()
    extra = Joint("j2", "revolute", "hinge", 0, 2, np.eye(3)[2], np.zeros(3), 0, 1)
    links = (
        Link("base", "body", np.arange(2, 12)),
        answer.links[1],
        Link("more", "part", np.arange(2)),
    )
    s = score(replace(answer, links=links, joints=(*answer.joints, extra)), truth)
    assert s.miou == pytest.approx(0.5, abs=0.005) and s.count == 0 and s.type_error == 0
    assert [j.right for j in s.found] == [True, False]


def test_iou_is_of_area() -> None:
    truth = cabinet()
    answer = truth.truth_articulation()
    # one of the two large sides of the door goes to the base
    normals = np.cross(
        *np.diff(truth.mesh.vertices[truth.mesh.faces[12:]], axis=1).transpose(1, 0, 2)
    )
    back = 12 + np.flatnonzero(normals[:, 1] > 0.5)
    front = np.setdiff1d(np.arange(12, 24), back)
    links = (
        Link("base", "body", np.concatenate([np.arange(12), back])),
        Link("door", "door", front),
    )
    s = score(replace(answer, links=links), truth)
    assert s.miou == pytest.approx((1 + 4 * 0.02) / (2 + 4 * 0.02), abs=0.01)


def test_fixed_links_belong_to_their_parent() -> None:
    truth = cabinet()
    answer = truth.truth_articulation()
    links = (
        answer.links[0],
        Link("door", "door", np.arange(14, 24)),
        Link("handle", "handle", np.arange(12, 14)),
    )
    fixed = Joint("glue", "fixed", "fixed", 1, 2, np.eye(3)[0], np.zeros(3), 0, 0)
    s = score(replace(answer, links=links, joints=(*answer.joints, fixed)), truth)
    assert s.miou == pytest.approx(1, abs=0.005) and s.count == 1


def test_a_tiny_part_is_still_seen() -> None:
    truth = cabinet()
    vertices = truth.mesh.vertices.copy()
    vertices[8:] = (vertices[8:] - [0, -0.52, 0]) * 0.002 + [0, -0.52, 0]
    small = replace(truth, mesh=Mesh(vertices, truth.mesh.faces))
    s = score(small.truth_articulation(), small)
    assert s.miou == pytest.approx(1, abs=0.01)


def test_another_mesh_is_scored_by_its_nearest_face() -> None:
    truth = cabinet()
    mesh = trimesh.Trimesh(truth.mesh.vertices, truth.mesh.faces, process=False)
    vertices, faces, index = trimesh.remesh.subdivide(
        mesh.vertices, mesh.faces, face_index=None, return_index=True
    )
    label = np.zeros(len(faces), dtype=int)
    for source, children in index.items():
        label[children] = truth.face_link[source]
    links = tuple(Link(f"l{i}", "part", np.flatnonzero(label == i)) for i in range(2))
    s = score(Articulation(Mesh(vertices, faces), links, truth.joints), truth)
    assert s.miou == pytest.approx(1, abs=0.005)


def test_ranges() -> None:
    joint = cabinet().joints[0]
    assert limit_iou(joint, replace(joint, upper=0.75)) == pytest.approx(0.5)
    assert limit_iou(joint, replace(joint, lower=-1.5, upper=0.0)) == 0
    free = replace(joint, type="continuous")
    assert limit_iou(free, replace(free, lower=-np.inf, upper=np.inf)) == pytest.approx(1)
    assert limit_iou(joint, free) == pytest.approx(1.5 / (2 * np.pi))


def test_scores_do_not_depend_on_the_unit() -> None:
    truth = cabinet()
    wrong = changed(truth, origin=[0.1, -0.4, 0.0], axis=[0.6, 0, 0.8])
    large = replace(
        truth,
        mesh=truth.mesh.transformed(np.diag([100.0, 100, 100, 1])),
        joints=(replace(truth.joints[0], origin=truth.joints[0].origin * 100),),
    )
    bigger = replace(
        wrong,
        mesh=large.mesh,
        joints=(replace(wrong.joints[0], origin=wrong.joints[0].origin * 100),),
    )
    a, b = score(wrong, truth), score(bigger, large)
    assert a.pivot == pytest.approx(b.pivot) and a.motion == pytest.approx(b.motion, rel=1e-3)
    assert a.miou == pytest.approx(b.miou, abs=0.01)
