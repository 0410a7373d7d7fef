"""How far joints go where nothing ends their way, in closed form: fronts, drawers, lids, twins."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from mam_pipeline.geometry.paths import PartPaths
from mam_pipeline.joints.closing import closing_of
from mam_pipeline.joints.estimate import JointEstimator
from mam_pipeline.joints.limits import Limits, Surroundings, depth_behind, embedded_limits
from mam_pipeline.joints.twins import with_alike_ranges
from mam_pipeline.types import (
    FloatArray,
    IntArray,
    Joint,
    JointCandidate,
    JointSubtype,
    KinematicTree,
    Mesh,
    PartNode,
    Primitives,
    RangeBasis,
    UsualTravel,
)

OUT = np.array([-1.0, 0.0, 0.0])
Pieces = list[tuple[int, trimesh.Trimesh]]


def block(low: tuple[float, ...], high: tuple[float, ...]) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[low, high])


def assembled(pieces: Pieces) -> tuple[Mesh, IntArray]:
    """A mesh of (part, shape) pieces, and the part of every face."""
    whole = trimesh.util.concatenate([shape for _, shape in pieces])
    owner = np.concatenate([np.full(len(shape.faces), part) for part, shape in pieces])
    assert isinstance(whole, trimesh.Trimesh)
    return Mesh(whole.vertices, whole.faces), owner


def limits_of(
    pieces: Pieces, subtype: JointSubtype, axis: FloatArray, origin: FloatArray | None = None,
    usual: UsualTravel | None = None,
) -> Limits:  # fmt: skip
    mesh, owner = assembled(pieces)
    around = Surroundings.of(mesh, np.flatnonzero(owner == 1), np.flatnonzero(owner == 0))
    origin = np.zeros(3) if origin is None else origin
    return embedded_limits(around, subtype, axis, origin, usual=usual)


def hollow(d: float, w: float, h: float, t: float) -> Pieces:
    """Five boards, open towards -X, as part 0."""
    return [
        (0, block((0, 0, 0), (d, t, h))), (0, block((0, w - t, 0), (d, w, h))),
        (0, block((0, t, 0), (d, w - t, t))), (0, block((0, t, h - t), (d, w - t, h))),
        (0, block((d - t, t, t), (d, w - t, h - t))),
    ]  # fmt: skip


FRONT = (1, block((-0.02, 0.02, 0.02), (0.0, 0.38, 0.28)))


@pytest.mark.parametrize("body, depth", [
    ([(0, block((0, 0, 0), (0.6, 0.4, 0.3)))], 0.6), (hollow(0.6, 0.4, 0.3, 0.018), 0.582)
])  # fmt: skip
def test_a_bare_front_comes_out_by_a_share_of_the_depth_behind_it(
    body: Pieces, depth: float
) -> None:
    usual = UsualTravel(open=0.9, back=0.0, endless=0.0)  # of its own thickness
    found = limits_of([*body, FRONT], "slide", OUT, usual=usual)
    assert found.upper == pytest.approx(0.8 * depth, abs=1e-3)
    assert found.rule == "depth" and found.lower == 0.0
    assert found.evidence["assumed"] == "assumed: 0.8 of the depth behind it"


def test_a_drawer_with_a_box_comes_out_by_a_share_of_its_own_depth() -> None:
    box = (1, block((0.0, 0.025, 0.025), (0.4, 0.375, 0.275)))
    found = limits_of([*hollow(0.6, 0.4, 0.3, 0.018), FRONT, box], "slide", OUT)
    assert found.upper == pytest.approx(0.8 * 0.42, abs=1e-3)
    assert found.evidence["assumed"] == "assumed: 0.8 of its own depth"


def test_no_depth_is_behind_a_button_nor_behind_what_goes_inwards() -> None:
    body = (0, block((0, 0, 0), (0.6, 0.4, 0.3)))
    button = (1, block((-0.01, 0.1, 0.1), (0.0, 0.13, 0.13)))
    for part, axis in ((button, OUT), (FRONT, -OUT)):
        mesh, owner = assembled([body, part])
        moving, static = np.flatnonzero(owner == 1), np.flatnonzero(owner == 0)
        assert depth_behind(mesh, moving, static, axis) == 0.0


@pytest.mark.parametrize("angle", [60.0, 110.0])
def test_a_lid_that_stands_open_closes(angle: float) -> None:
    origin = np.array([0.4, 0.0, 0.202])
    lid = block((0.0, 0.0, 0.202), (0.4, 0.3, 0.222))
    lid.apply_transform(trimesh.transformations.rotation_matrix(
        np.radians(angle), [0.0, 1.0, 0.0], origin
    ))  # fmt: skip
    pieces = [*((0, b) for _, b in hollow(0.4, 0.3, 0.2, 0.02)), (1, lid)]
    usual = UsualTravel(open=0.3, back=0.6, endless=0.0)
    found = limits_of(pieces, "hinge", np.array([0.0, 1.0, 0.0]), origin, usual)
    assert np.degrees(found.lower) == pytest.approx(-angle, abs=4.0)
    assert found.closed == found.lower


def three_drawers() -> tuple[JointEstimator, KinematicTree, list[Joint]]:
    """Three equal drawers side by side; the middle one has been given a short way."""
    pieces: Pieces = [(0, block((0.5, 0, 0), (0.52, 0.9, 0.3)))]
    pieces += [
        (k + 1, block((0.0, 0.3 * k + 0.01, 0.0), (0.45, 0.3 * k + 0.29, 0.3))) for k in range(3)
    ]
    mesh, owner = assembled(pieces)
    nodes = [PartNode("base", "body", (0,), -1, "fixed")]
    nodes += [PartNode(f"drawer_{k}", "drawer", (k + 1,), 0, "slide") for k in range(3)]
    joints = [
        Joint(
            f"drawer_{k}_joint", "prismatic", "slide", 0, k + 1, OUT, np.zeros(3), 0.0, way,
            0.0, way, basis=RangeBasis(rule),  # type: ignore[arg-type]
        )
        for k, (way, rule) in enumerate([(0.36, "depth"), (0.03, "contact_loss"), (0.36, "depth")])
    ]  # fmt: skip
    estimator = JointEstimator(mesh, Primitives(owner))
    return estimator, KinematicTree(tuple(nodes)), joints


def test_twins_go_as_far_as_the_farthest_of_them_whose_way_is_free() -> None:
    estimator, tree, joints = three_drawers()
    found = with_alike_ranges(estimator, tree, joints)
    assert [j.upper for j in found] == pytest.approx([0.36, 0.36, 0.36])
    assert [j.basis.rule for j in found] == ["depth", "twin", "depth"]
    given = [joints[0], replace(joints[1], basis=RangeBasis("given")), joints[2]]
    assert with_alike_ranges(estimator, tree, given)[1].upper == 0.03


def test_a_twin_whose_way_is_not_free_keeps_its_own() -> None:
    estimator, tree, joints = three_drawers()
    inwards = [replace(j, axis=-OUT) for j in joints]  # the back wall stands 5 cm behind
    assert with_alike_ranges(estimator, tree, inwards)[1].upper == 0.03


@pytest.mark.parametrize("sides, round_", [(24, True), (8, True), (4, False)])
def test_a_wheel_turns_in_itself_about_its_axle_alone_and_a_square_does_not(
    sides: int, round_: bool
) -> None:
    wheel = trimesh.creation.cylinder(0.3, 0.2, sections=sides)
    mesh, owner = assembled([(0, block((-1.0, -1.0, 0.05), (1.0, 1.0, 1.0))), (1, wheel)])
    paths = PartPaths(mesh, np.flatnonzero(owner == 1), np.flatnonzero(owner == 0))
    axle = np.array([0.0, 0.0, 1.0])
    assert paths.turns_in_itself(axle, np.zeros(3)) == round_
    assert not paths.turns_in_itself(axle, np.array([0.1, 0.0, 0.0]))
    assert not paths.turns_in_itself(OUT, np.zeros(3))


def open_lid(degrees: float, thick: float, sunk: float) -> tuple[Mesh, IntArray, FloatArray]:
    """A base with a plate that turned by some degrees about its back edge; the line (3,).

    Args:
        sunk: how deep the plate would lie in the base when it is turned back.
    """
    plate = block((-0.2, 0, -sunk), (0.2, 0.3, thick - sunk))
    turn = trimesh.transformations.rotation_matrix(np.radians(degrees), [1, 0, 0])
    plate.apply_transform(turn)
    line = np.array([0.0, -0.15, 0.1])
    plate.apply_translation(line)
    return *assembled([(0, block((-0.2, -0.15, 0), (0.2, 0.2, 0.1))), (1, plate)]), line


@pytest.mark.parametrize("degrees, sunk", [(110, 0.0), (110, 0.01), (60, 0.01)])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_lid_that_stands_open_closes_until_it_lies_on_its_body(
    degrees: float, sunk: float, sign: float
) -> None:
    mesh, owner, line = open_lid(degrees, 0.02, sunk)
    lid, body = np.flatnonzero(owner == 1), np.flatnonzero(owner == 0)
    axis = sign * np.array([1.0, 0, 0])
    found = closing_of(mesh, lid, body, JointCandidate("hinge", axis, line))
    assert found is not None
    assert np.degrees(found.way) == pytest.approx(degrees, abs=0.1)
    np.testing.assert_allclose(found.line.axis, [1, 0, 0], atol=1e-9)  # positive opens
    away = sunk / (2 * np.sin(np.radians(degrees / 2)))
    assert np.linalg.norm((found.line.origin - line)[1:]) == pytest.approx(away, abs=1e-6)
    around = Surroundings.of(mesh, lid, body)
    limits = embedded_limits(
        around, "hinge", found.line.axis, found.line.origin, closing=found.way
    )  # fmt: skip
    assert np.degrees(limits.lower) == pytest.approx(-degrees, rel=0.05)
    assert limits.closed == limits.lower


def test_a_closed_lid_and_an_upright_flap_do_not_stand_open() -> None:
    mesh, owner, line = open_lid(0, 0.02, 0.0)
    lid, body = np.flatnonzero(owner == 1), np.flatnonzero(owner == 0)
    assert closing_of(mesh, lid, body, JointCandidate("hinge", np.array([1.0, 0, 0]), line)) is None
    mesh, owner = assembled([(0, block((-0.2, 0, 0), (0.2, 0.3, 0.4))),
                             (1, block((-0.2, -0.02, 0), (0.2, 0, 0.35)))])  # fmt: skip
    lid, body = np.flatnonzero(owner == 1), np.flatnonzero(owner == 0)
    front = JointCandidate("hinge", np.array([1.0, 0, 0]), np.array([0.0, 0, 0]))
    assert closing_of(mesh, lid, body, front) is None


def chest(inside: float, over: float) -> tuple[KinematicTree, Mesh, Primitives]:
    """A box with a lid that reaches `over` beyond its edges, hinged `inside` of its back edge."""
    mesh, owner = assembled([
        (0, block((-0.3, -0.2, 0), (0.3, 0.2, 0.3))),
        (1, block((-0.3 - over, -0.2 - over, 0.3), (0.3 + over, 0.2 + over, 0.45))),
    ])  # fmt: skip
    line = JointCandidate("hinge", np.array([1.0, 0, 0]), np.array([0.0, 0.2 - inside, 0.3]))
    lid = PartNode("lid", "lid", (1,), 0, "hinge", candidates=(replace(line, axis=-line.axis),))
    tree = KinematicTree((PartNode("base", "body", (0,), -1, "fixed"), lid))
    return tree, mesh, Primitives(owner)


@pytest.mark.parametrize("over", [0.0, 0.03])
def test_a_lid_whose_line_would_jam_it_hinges_at_the_edge_that_it_lies_on(over: float) -> None:
    tree, mesh, primitives = chest(0.015, over)
    found = JointEstimator(mesh, primitives).estimate(tree, 1)
    assert found is not None and found.limits.rule == "usual"
    assert np.degrees(found.limits.upper) == pytest.approx(90, abs=1)
    np.testing.assert_allclose(found.chosen.origin[1:], [0.2, 0.3], atol=1e-3)


def test_a_line_that_is_far_from_the_edge_or_that_a_person_gave_stays() -> None:
    tree, mesh, primitives = chest(0.05, 0.0)
    far = JointEstimator(mesh, primitives).estimate(tree, 1)
    assert far is not None and far.chosen.origin[1] == pytest.approx(0.15)
    assert far.limits.upper < np.pi / 4
    tree, mesh, primitives = chest(0.015, 0.0)
    told = replace(tree, nodes=(tree.nodes[0], replace(tree.nodes[1], provenance="user")))
    found = JointEstimator(mesh, primitives).estimate(told, 1)
    assert found is not None and found.chosen.origin[1] == pytest.approx(0.185)
