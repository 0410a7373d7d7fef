"""Joints of a door, a drawer and a wheel whose axes are known exactly; limits; invariance."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from mam_sim_paper.solver import paper_limits
from scipy.spatial.transform import Rotation

from mam_pipeline import backends
from mam_pipeline.geometry.boxes import angle_between
from mam_pipeline.geometry.frames import estimate_frame
from mam_pipeline.geometry.sweep import SweepScene
from mam_pipeline.joints.candidates import kind_probabilities, rank_hypotheses
from mam_pipeline.joints.estimate import (
    JointEstimator,
    agreement,
    choose_candidates,
    faces_around,
    topological_order,
)
from mam_pipeline.joints.limits import Surroundings, embedded_limits
from mam_pipeline.joints.solver import EmbeddedSolver
from mam_pipeline.joints.straight import straightened
from mam_pipeline.parts.settle import settled
from mam_pipeline.rules import ALL_RULES
from mam_pipeline.types import (
    Articulation,
    FloatArray,
    IntArray,
    Joint,
    JointCandidate,
    JointSubtype,
    KinematicTree,
    Mesh,
    PartNode,
    Primitives,
)


def assemble(pieces: list[tuple[int, trimesh.Trimesh]]) -> tuple[Mesh, IntArray]:
    """A mesh of (part, shape) pieces, and the part of every face."""
    vertices, faces, owner, count = [], [], [], 0
    for part, shape in pieces:
        vertices.append(shape.vertices)
        faces.append(shape.faces + count)
        owner += [part] * len(shape.faces)
        count += len(shape.vertices)
    return Mesh(np.concatenate(vertices), np.concatenate(faces)), np.array(owner)


def block(low: tuple[float, ...], high: tuple[float, ...]) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[low, high])


def carcass(d: float, w: float, h: float, t: float = 0.018) -> list[tuple[int, trimesh.Trimesh]]:
    """Five boards, open towards -X, as part 0."""
    return [
        (0, block((0, 0, 0), (d, t, h))), (0, block((0, w - t, 0), (d, w, h))),
        (0, block((0, t, 0), (d, w - t, t))), (0, block((0, t, h - t), (d, w - t, h))),
        (0, block((d - t, t, t), (d, w - t, h - t))),
    ]  # fmt: skip


def door_cabinet() -> tuple[Mesh, IntArray]:
    """A door on the front, hinged at y = 0, with a bar handle at the other side."""
    return assemble([
        *carcass(0.4, 0.5, 0.8),
        (1, block((-0.02, 0, 0), (-0.001, 0.5, 0.8))),
        (1, block((-0.05, 0.45, 0.3), (-0.02, 0.465, 0.5))),
    ])  # fmt: skip


def drawer_cabinet() -> tuple[Mesh, IntArray]:
    """A box drawer with front and handle that slides towards -X."""
    g, t = 0.003, 0.012
    low, high = 0.018 + g, 0.482 - g
    return assemble([
        *carcass(0.45, 0.5, 0.3),
        (1, block((-0.02, 0, 0), (-0.001, 0.5, 0.3))),
        (1, block((-0.001, low, 0.03), (0.4, low + t, 0.2))),
        (1, block((-0.001, high - t, 0.03), (0.4, high, 0.2))),
        (1, block((-0.001, low + t, 0.03), (0.4, high - t, 0.03 + t))),
        (1, block((0.4 - t, low + t, 0.03 + t), (0.4, high - t, 0.2))),
        (1, block((-0.05, 0.2, 0.15), (-0.02, 0.3, 0.165))),
    ])  # fmt: skip


def cart() -> tuple[Mesh, IntArray]:
    """A body with a stub axle along Y and a round wheel on it."""
    wheel = trimesh.creation.cylinder(0.1, 0.04, sections=40)
    wheel.apply_transform(trimesh.geometry.align_vectors((0, 0, 1), (0, 1, 0)))
    wheel.apply_translation((0.3, -0.05, 0.1))
    return assemble([
        (0, block((0, 0, 0.08), (0.6, 0.4, 0.3))), (0, block((0.29, -0.03, 0.09), (0.31, 0, 0.11))),
        (1, wheel),
    ])  # fmt: skip


def tree(subtype: JointSubtype, **more: object) -> KinematicTree:
    base = PartNode("base", "body", (0,), -1, "fixed")
    return KinematicTree((base, PartNode("part", "part", (1,), 0, subtype, **more)))  # type: ignore[arg-type]


def solve(made: tuple[Mesh, IntArray], subtype: JointSubtype, **more: object) -> Joint:
    mesh, owner = made
    found = EmbeddedSolver().solve(mesh, Primitives(owner), tree(subtype, **more))
    assert isinstance(found, Articulation) and len(found.joints) == 1
    return found.joints[0]


def line_distance(joint: Joint, point: FloatArray) -> float:
    v = np.asarray(point) - joint.origin
    return float(np.linalg.norm(v - (v @ joint.axis) * joint.axis))


def test_a_door_turns_about_the_edge_away_from_its_handle() -> None:
    joint = solve(door_cabinet(), "hinge")
    assert (joint.name, joint.type, joint.parent, joint.child) == ("part_joint", "revolute", 0, 1)
    assert angle_between(joint.axis, np.array([0, 0, 1.0])) < 0.02
    assert line_distance(joint, np.array([-0.01, 0.0, 0.4])) < 0.04
    far = np.array([-0.01, 0.5, 0.4]) - joint.origin
    assert np.cross(joint.axis, far)[0] < 0  # positive q opens towards -X
    assert joint.lower == pytest.approx(0.0, abs=0.02)
    assert np.deg2rad(60) < joint.upper < np.deg2rad(185)
    assert joint.open == pytest.approx(joint.upper)


def test_doubled_faces_change_no_joint() -> None:
    mesh, owner = door_cabinet()
    plain = solve((mesh, owner), "hinge")
    faces = np.concatenate([mesh.faces, mesh.faces[:, ::-1]])
    doubled = Mesh(mesh.vertices, faces), np.concatenate([owner, owner])
    again = solve(doubled, "hinge")
    assert again.axis == pytest.approx(plain.axis, abs=1e-9)
    assert again.origin == pytest.approx(plain.origin, abs=1e-9)
    assert (again.lower, again.upper) == pytest.approx((plain.lower, plain.upper))
    found = EmbeddedSolver().solve(doubled[0], Primitives(doubled[1]), tree("hinge"))
    assert found.mesh is doubled[0] and (found.face_link == doubled[1]).all()


def test_a_drawer_slides_out_of_its_cabinet() -> None:
    joint = solve(drawer_cabinet(), "slide")
    assert joint.type == "prismatic"
    assert joint.axis == pytest.approx([-1, 0, 0], abs=0.02)
    assert 0.15 < joint.upper < 0.45 and joint.lower == pytest.approx(0.0, abs=0.01)


def test_a_line_off_the_bodies_gives_way_to_a_parallel_one_first() -> None:
    ranked = tuple(
        JointCandidate("hinge", np.array(a), np.array(o), float(np.log(p)))
        for a, o, p in (
            ((0, 0, -1.0), (-0.3, -0.3, 0.4), 0.8),
            ((0, 1.0, 0), (-0.001, 0.25, 0.8), 0.1),
            ((0, 0, -1.0), (-0.001, 0.0, 0.4), 0.08),
            ((0, 1.0, 0), (-0.001, 0.25, 0.8), 0.01),
        )
    )
    joint = solve(door_cabinet(), "hinge", candidates=ranked)
    assert joint.origin == pytest.approx([-0.001, 0, 0.4])
    kept = solve(door_cabinet(), "hinge", candidates=ranked[::3])
    assert kept.axis == pytest.approx([0, 0, -1])  # the other is on both, but far less probable


def test_lines_that_mean_the_same_joint_are_sure_together() -> None:
    """A door's edge is several lines, of its boards and of its gap; none has the odds alone."""
    z, x = np.array([0, 0, 1.0]), np.array([1.0, 0, 0])

    def line(axis: FloatArray, at: float, p: float) -> JointCandidate:
        return JointCandidate("hinge", axis, np.array([0, at, 7 * at]), within_kind=p)

    best = line(z, 0.0, 0.4)
    lines = [best, line(-z, 0.01, 0.3), line(z, 0.5, 0.2), line(x, 0.0, 0.1)]
    assert agreement(best, lines, 0.02) == pytest.approx(0.7)
    assert agreement(lines[2], lines, 0.02) == pytest.approx(0.2)
    slides = [replace(c, subtype="slide") for c in lines]
    assert agreement(slides[0], slides, 0.02) == pytest.approx(0.9)
    assert agreement(JointCandidate("hinge", z, np.zeros(3)), lines, 0.02) == 1.0


def test_a_wheel_spins_without_end() -> None:
    joint = solve(cart(), "spin")
    assert joint.type == "continuous" and not np.isfinite(joint.upper)
    assert angle_between(joint.axis, np.array([0, 1.0, 0])) < 0.02
    assert line_distance(joint, np.array([0.3, 0, 0.1])) < 0.01


@pytest.mark.parametrize("name", ["init", "lm", "nelder-mead"])
@pytest.mark.parametrize("subtype", ["slide", "spin"])
def test_the_papers_solvers_run_and_keep_evidence(name: str, subtype: JointSubtype) -> None:
    mesh, owner = drawer_cabinet() if subtype == "slide" else cart()
    _, solver = backends.load("solver", name)
    joint = solver.solve(mesh, Primitives(owner), tree(subtype)).joints[0]
    assert np.linalg.norm(joint.axis) == pytest.approx(1.0)
    assert joint.evidence["contact"]["points"] > 0
    if name != "init":
        note = joint.evidence["optimisation"]
        assert note["loss_after"] <= note["loss_before"] and len(note["curve"]) > 1
        assert note["accepted"] or note["why"]


def test_evidence_is_plain_json_and_the_answer_repeats() -> None:
    one, two = solve(door_cabinet(), "hinge"), solve(door_cabinet(), "hinge")
    text = json.dumps(dict(one.evidence), allow_nan=False)
    assert text == json.dumps(dict(two.evidence), allow_nan=False)
    assert {"candidates", "contact", "limits"} <= set(one.evidence)
    assert np.array_equal(one.axis, two.axis) and one.upper == two.upper


@pytest.mark.parametrize("seed", range(3))
def test_joints_turn_and_scale_with_the_object(seed: int) -> None:
    rng = np.random.default_rng(seed)
    for made, subtype in ((door_cabinet(), "hinge"), (cart(), "spin"), (drawer_cabinet(), "slide")):
        mesh, owner = made
        before = solve(made, subtype)  # type: ignore[arg-type]
        turn = np.eye(4)
        scale = float(rng.uniform(0.1, 20))
        turn[:3, :3] = scale * Rotation.from_euler("z", rng.uniform(0, 360), True).as_matrix()
        turn[:3, 3] = rng.uniform(-5, 5, 3)
        after = solve((mesh.transformed(turn), owner), subtype)  # type: ignore[arg-type]
        axis = turn[:3, :3] @ before.axis / scale
        assert np.degrees(angle_between(after.axis, axis)) < 2.0
        if subtype != "slide":
            there = turn[:3, :3] @ before.origin + turn[:3, 3]
            assert line_distance(after, there) < 0.01 * mesh.diagonal * scale


def test_a_persons_joint_is_obeyed() -> None:
    wish = JointCandidate("hinge", np.array([0, 1.0, 0]), np.array([0, 0, 0.8]))
    joint = solve(door_cabinet(), "hinge", candidates=(wish,), provenance="user", limits=(0.0, 0.5))
    assert joint.axis == pytest.approx([0, 1, 0]) and joint.origin == pytest.approx([0, 0, 0.8])
    assert (joint.lower, joint.upper, joint.open) == (0.0, 0.5, 0.5)


@pytest.mark.parametrize("angles", [(0, 0, 30.0), (4.0, -3.0, 0)])
def test_an_object_that_stands_askew_keeps_its_joints_and_its_own_frame(
    angles: tuple[float, ...],
) -> None:
    mesh, owner = door_cabinet()
    before = solve((mesh, owner), "hinge")
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    askew = mesh.transformed(turn), owner
    after = solve(askew, "hinge")
    assert after.axis == pytest.approx(turn[:3, :3] @ before.axis, abs=1e-4)
    assert after.origin == pytest.approx(turn[:3, :3] @ before.origin, abs=1e-3 * mesh.diagonal)
    assert (after.lower, after.upper) == pytest.approx((before.lower, before.upper), abs=0.02)
    chosen = after.evidence["candidates"][0]
    assert np.abs(np.dot(chosen["axis"], after.axis)) == pytest.approx(1, abs=1e-4)
    wish = JointCandidate("hinge", turn[:3, 1], turn[:3, 2] * 0.8)
    joint = solve(askew, "hinge", candidates=(wish,), provenance="user", limits=(0.0, 0.5))
    assert joint.axis == pytest.approx(wish.axis) and joint.origin == pytest.approx(wish.origin)


def test_only_what_stands_clearly_askew_is_straightened() -> None:
    mesh, _ = door_cabinet()
    for angle, wanted in ((0.0, False), (2.0, False), (30.0, True), (-50.0, True)):
        turn = np.eye(4)
        turn[:3, :3] = Rotation.from_euler("z", angle, degrees=True).as_matrix()
        turned = mesh.transformed(turn)
        straight, frame, rotation = straightened(turned)
        assert (rotation is not None) == wanted
        if rotation is None:
            assert straight is turned
            continue
        assert straight.diagonal == pytest.approx(mesh.diagonal)
        assert straight.diagonal < 0.99 * turned.diagonal
        assert frame.axes == pytest.approx(np.eye(3), abs=1e-6)
        assert straight.vertices @ rotation == pytest.approx(turned.vertices)


def test_fixed_parts_stay_fixed() -> None:
    assert solve(door_cabinet(), "fixed").type == "fixed"


def test_order_puts_parents_first_and_refuses_loops() -> None:
    base = PartNode("base", "body", (0,), -1, "fixed")
    a = PartNode("a", "p", (1,), 2, "hinge")
    b = PartNode("b", "p", (2,), 0, "hinge")
    assert topological_order(KinematicTree((base, a, b))) == [2, 1]
    loop = KinematicTree((base, a, PartNode("b", "p", (2,), 1, "hinge")))
    with pytest.raises(ValueError, match="loop"):
        topological_order(loop)


def test_limits_stop_at_an_obstacle() -> None:
    mesh, owner = assemble([
        *[(0, s) for _, s in carcass(0.4, 0.5, 0.8)],
        (1, block((-0.02, 0, 0), (-0.001, 0.5, 0.8))),
        (0, block((-0.5, -0.3, 0), (-0.4, 0.5, 0.8))),
    ])  # fmt: skip
    scene = SweepScene(mesh, np.flatnonzero(owner == 1), np.flatnonzero(owner == 0))
    axis, origin = np.array([0, 0, 1.0]), np.array([-0.001, 0, 0])
    exact = np.arcsin(0.399 / np.hypot(0.5, 0.019)) - np.arctan2(0.019, 0.5)
    around = Surroundings.of(mesh, np.flatnonzero(owner == 1), np.flatnonzero(owner == 0))
    found = embedded_limits(around, "hinge", axis, origin)
    assert found.upper == pytest.approx(exact, abs=np.deg2rad(3))
    paper = paper_limits(scene, "hinge", axis, origin)
    assert paper.upper == pytest.approx(exact, abs=np.deg2rad(5))


def test_slides_end_where_contact_is_lost() -> None:
    mesh, owner = assemble([
        (0, block((0, 0, 0), (1, 0.2, 0.1))), (1, block((0, 0, 0.1005), (0.3, 0.2, 0.2))),
    ])  # fmt: skip
    scene = SweepScene(mesh, np.flatnonzero(owner == 1), np.flatnonzero(owner == 0))
    found = paper_limits(scene, "slide", np.array([-1.0, 0, 0]), np.zeros(3))
    assert found.upper == pytest.approx(0.3, abs=0.04)


@pytest.mark.parametrize("fused", [False, True])
def test_parts_that_a_person_named_are_judged_as_fused_where_they_are(fused: bool) -> None:
    mesh, owner = door_cabinet()
    merges = np.array([[0, 1]]) if fused else np.zeros((0, 2), dtype=np.int64)
    nodes = PartNode("base", "body", (0,), -1, "fixed"), PartNode("door", "door", (1,), 0, "hinge")
    frame = estimate_frame(mesh)
    faces = faces_around(KinematicTree(nodes), Primitives(owner, merges), 1)
    found = [c.score for c in choose_candidates(mesh, frame, nodes[1], faces, 0)]
    both = [
        [c.score for c in rank_hypotheses(mesh, faces.moving, faces.static, frame=frame,
                                          top=1000, fused=k) if c.subtype in ("hinge", "spin")]
        for k in (False, True)
    ]  # fmt: skip
    assert both[0] != both[1]
    assert found == pytest.approx(both[fused])


def test_hypotheses_carry_probabilities() -> None:
    mesh, owner = door_cabinet()
    found = rank_hypotheses(mesh, np.flatnonzero(owner == 1), np.flatnonzero(owner == 0), top=10000)
    p = [c.evidence["probability"] for c in found]
    assert sum(p) == pytest.approx(1.0, abs=1e-6) and p == sorted(p, reverse=True)
    kinds = kind_probabilities(found)
    assert sum(kinds.values()) == pytest.approx(1.0, abs=1e-6)
    assert kinds["revolute"] == max(kinds.values())
    few = rank_hypotheses(mesh, np.flatnonzero(owner == 1), np.flatnonzero(owner == 0), top=3)
    assert len(few) == 3 and any(c.subtype == "fixed" for c in few)


@pytest.mark.parametrize("subtype", ["slide", "hinge", "spin"])
def test_a_part_with_nothing_near_it_is_no_error(subtype: JointSubtype) -> None:
    far = assemble([(0, block((0, 0, 0), (1, 1, 1))), (1, block((3, 3, 3), (3.1, 3.1, 3.1)))])
    joint = solve(far, subtype)
    assert (joint.type == "prismatic") == (subtype == "slide") and np.isfinite(joint.axis).all()
    mesh, owner = far
    best = rank_hypotheses(mesh, np.flatnonzero(owner == 1), np.flatnonzero(owner == 0))[0]
    assert best.subtype == "fixed"


def test_the_solver_finds_what_the_parts_stage_has_asked() -> None:
    mesh, owner = drawer_cabinet()
    first, second = (JointEstimator(mesh, Primitives(owner)) for _ in range(2))
    assert first.estimate(tree("slide"), 1) is second.estimate(tree("slide"), 1)


@pytest.mark.parametrize("confidence, asleep", [(0.3, True), (0.9, False)])
def test_a_doubtful_part_that_is_stuck_is_dormant(confidence: float, asleep: bool) -> None:
    """A block between two walls, 5 mm from each, that is to slide through one of them."""
    mesh, owner = assemble([
        (0, block((-0.3, 0, 0), (-0.2, 0.5, 0.5))), (0, block((0.2, 0, 0), (0.3, 0.5, 0.5))),
        (1, block((-0.195, 0, 0), (0.195, 0.5, 0.5))),
    ])  # fmt: skip
    out = JointCandidate("slide", np.array([-1.0, 0, 0]), np.zeros(3))
    part = PartNode("p", "drawer", (1,), 0, "slide", confidence=confidence, candidates=(out,))
    given = KinematicTree((PartNode("base", "body", (0,), -1, "fixed"), part))
    own = Primitives(owner.astype(np.int64))
    node = settled(given, mesh, own, {}).nodes[1]
    assert ("stuck" in node.dormant) == asleep
    assert not settled(given, mesh, own, {}, rules=ALL_RULES.without("abstain")).nodes[1].dormant
