"""Sampling, boxes, frames and the sweep test against shapes whose answers are known exactly."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mam_pipeline.geometry.boxes import aligned_box, minimal_box
from mam_pipeline.geometry.frames import estimate_frame
from mam_pipeline.geometry.hinge_line import HingeBodies
from mam_pipeline.geometry.paths import PartPaths, Rule
from mam_pipeline.geometry.raycast import RayScene
from mam_pipeline.geometry.rows import row_keys
from mam_pipeline.geometry.sampling import sample_surface, thin_out
from mam_pipeline.geometry.sweep import SweepScene
from mam_pipeline.types import FloatArray, IntArray, Mesh

CORNERS = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)], dtype=float)
QUADS = np.array(
    [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
)
BOX_FACES = np.concatenate([QUADS[:, [0, 1, 2]], QUADS[:, [0, 2, 3]]])


def boxes(*bounds: tuple[tuple[float, ...], tuple[float, ...]]) -> tuple[Mesh, IntArray]:
    """A mesh of boxes given by (low, high), and the box every face belongs to."""
    vertices = [np.array(a) + CORNERS * (np.array(b) - np.array(a)) for a, b in bounds]
    faces = [BOX_FACES + 8 * i for i in range(len(bounds))]
    owner = np.repeat(np.arange(len(bounds)), len(BOX_FACES))
    return Mesh(np.concatenate(vertices), np.concatenate(faces)), owner


def cabinet() -> tuple[Mesh, IntArray]:
    """A carcass of five boards (open towards -X) and a door (piece 5) between its sides."""
    t, d, w, h = 0.02, 0.4, 0.5, 0.6
    return boxes(
        ((0, 0, 0), (d, t, h)), ((0, w - t, 0), (d, w, h)), ((0, t, 0), (d, w - t, t)),
        ((0, t, h - t), (d, w - t, h)), ((d - t, t, t), (d, w - t, h - t)),
        ((0, 0.022, 0.022), (0.02, 0.478, 0.578)),
    )  # fmt: skip


def split(owner: IntArray, part: int) -> tuple[IntArray, IntArray]:
    return np.flatnonzero(owner == part), np.flatnonzero(owner != part)


def test_samples_lie_on_their_faces_and_follow_the_area() -> None:
    mesh, _ = boxes(((0, 0, 0), (1, 2, 3)))
    found = sample_surface(mesh.vertices, mesh.faces, 4400, seed=1)
    corner = mesh.vertices[mesh.faces[found.faces, 0]]
    assert np.abs(((found.points - corner) * found.normals).sum(axis=1)).max() < 1e-12
    assert found.area == pytest.approx(22.0)
    side = np.abs(found.normals[:, 2]) > 0.5  # top and bottom: 4 of 22
    assert side.mean() == pytest.approx(4 / 22, abs=1e-3)
    again = sample_surface(mesh.vertices, mesh.faces, 4400, seed=1)
    assert np.array_equal(found.points, again.points)


def test_sampling_nothing_gives_nothing() -> None:
    mesh, _ = boxes(((0, 0, 0), (1, 1, 1)))
    assert len(sample_surface(mesh.vertices, mesh.faces[:0], 10).points) == 0
    assert len(thin_out(5, 10)) == 5 and len(thin_out(100, 10)) == 10


@pytest.mark.parametrize("seed", range(4))
def test_minimal_box_of_a_turned_box(seed: int) -> None:
    turn = Rotation.random(random_state=seed).as_matrix()
    points = (CORNERS * [3.0, 2.0, 0.5]) @ turn.T
    box = minimal_box(points)
    assert np.sort(2 * box.half) == pytest.approx([0.5, 2.0, 3.0], rel=1e-6)
    assert np.abs(box.local(points)).max() == pytest.approx(1.0)
    assert aligned_box(points, np.eye(3)).volume >= box.volume


@pytest.mark.parametrize("angles", [(0, 0, 0), (0, 0, 25), (3, -2, 40), (0, 5, 0)])
def test_frame_follows_the_object(angles: tuple[float, float, float]) -> None:
    mesh, _ = cabinet()
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    frame = estimate_frame(mesh.transformed(turn))
    best = np.abs(frame.axes @ turn[:3, :3]).max(axis=1)
    assert np.degrees(np.arccos(np.clip(best, 0, 1))).max() < 0.2
    assert np.linalg.det(frame.axes) == pytest.approx(1.0)


def test_ray_scene_answers_in_the_callers_units() -> None:
    mesh, _ = boxes(((1000, 0, 0), (1002, 2, 2)))
    scene = RayScene(mesh.vertices, mesh.faces)
    hits = scene.first_hits(np.array([[990.0, 1, 1]]), np.array([[5.0, 0, 0]]))
    assert hits.t[0] == pytest.approx(2.0, abs=1e-4)
    assert scene.distance(np.array([[998.0, 1, 1]]))[0] == pytest.approx(2.0, abs=1e-3)
    assert scene.signed_distance(np.array([[1001.0, 1, 1]]))[0] == pytest.approx(-1.0, abs=1e-3)
    empty = RayScene(mesh.vertices, mesh.faces[:0])
    assert not np.isfinite(empty.distance(np.zeros((2, 3)))).any()


def test_a_point_is_enclosed_by_closed_shells_only() -> None:
    mesh, _ = boxes(((0, 0, 0), (1, 1, 1)), ((3, 0, 0), (4, 1, 1)))
    points = np.array([[0.3, 0.4, 0.6], [3.9, 0.1, 0.2], [2.0, 0.5, 0.5], [0.5, 0.5, 1.5]])
    scene = RayScene(mesh.vertices, mesh.faces)
    assert scene.encloses(points).tolist() == [True, True, False, False]
    lidless = RayScene(mesh.vertices, mesh.faces[2:])  # no floor
    assert lidless.encloses(points).tolist() == [False, True, False, False]
    assert not RayScene(mesh.vertices, mesh.faces[:0]).encloses(points).any()


def test_bodies_that_run_into_each_other_at_rest_block_only_what_comes_after() -> None:
    """A drawer whose sides are sunk in the boards beside it comes out, and is stopped going in."""
    mesh, owner = boxes(
        ((0, 0, 0), (1, 0.1, 1)), ((0, 0.9, 0), (1, 1, 1)), ((1.1, 0, 0), (1.2, 1, 1)),
        ((0, 0.08, 0.2), (1, 0.92, 0.8)),
    )  # fmt: skip
    scene = SweepScene(mesh, *split(owner, 3))
    out = scene.sweep("prismatic", (-1, 0, 0), (0, 0, 0), np.array([0.5, 1.0]))
    inwards = scene.sweep("prismatic", (1, 0, 0), (0, 0, 0), np.array([0.05, 0.5]))
    assert out.blocked.max() < 0.01
    assert inwards.blocked[0] < 0.01 and inwards.blocked[1] > 0.2
    caged, whole = boxes(((0, 0, 0), (1, 1, 1)), ((0.2, 0.2, 0.2), (0.8, 0.8, 0.8)))
    held = SweepScene(caged, *split(whole, 1))
    assert held.sweep("prismatic", (1, 0, 0), (0, 0, 0), np.array([1.0])).blocked[0] > 0.5


def test_a_door_swings_out_but_not_in() -> None:
    mesh, owner = cabinet()
    scene = SweepScene(mesh, *split(owner, 5))
    angles = np.deg2rad([30.0, 60.0, 90.0, 120.0])
    free = scene.sweep("revolute", (0, 0, 1), (0, 0.022, 0), angles)
    assert free.blocked.max() == 0.0 and free.depth.max() < 0.001
    inward = scene.sweep("revolute", (0, 0, 1), (0, 0.022, 0), -angles)
    assert inward.blocked[-1] > 0.5


def test_a_slide_stops_where_the_gap_ends() -> None:
    mesh, owner = boxes(((0, 0, 0), (1, 1, 1)), ((1.2, 0, 0), (1.4, 1, 1)))
    scene = SweepScene(mesh, *split(owner, 0))
    values = np.linspace(0, 0.5, 51)[1:]
    found = scene.sweep("prismatic", (1, 0, 0), (0, 0, 0), values)
    assert values[np.argmax(found.blocked > 0.02)] == pytest.approx(0.2, abs=0.03)
    assert found.depth[-1] == pytest.approx(0.3, abs=0.01)
    assert scene.sweep("prismatic", (-1, 0, 0), (0, 0, 0), values).blocked.max() == 0.0


def test_touching_faces_block_only_motion_into_them() -> None:
    mesh, owner = boxes(((0, 0, 0), (1, 1, 1)), ((1, 0, 0), (2, 1, 1)))
    scene = SweepScene(mesh, *split(owner, 0))
    values = np.array([0.05, 0.1])
    assert scene.rest_gap == pytest.approx(0.0, abs=1e-6)
    assert scene.sweep("prismatic", (0, 1, 0), (0, 0, 0), values).blocked.max() == 0.0
    assert scene.sweep("prismatic", (-1, 0, 0), (0, 0, 0), values).blocked.max() == 0.0
    assert scene.sweep("prismatic", (1, 0, 0), (0, 0, 0), values).blocked.min() > 0.1


def test_thin_obstacles_are_found_from_their_own_side() -> None:
    """A needle that no sample of the part would meet still blocks it."""
    mesh, owner = boxes(((0, 0, 0), (1, 1, 1)), ((1.1, 0.5, 0.5), (3.0, 0.501, 0.501)))
    scene = SweepScene(mesh, *split(owner, 0), samples=50)
    found = scene.sweep("prismatic", (1, 0, 0), (0, 0, 0), np.array([0.05, 0.5]))
    assert found.depth[0] == 0.0 and found.depth[1] > 0.3


def test_contact_set_and_its_loss() -> None:
    mesh, owner = boxes(((0, 0, 0), (1, 1, 0.2)), ((0, 0, -0.2), (1, 1, -0.001)))
    scene = SweepScene(mesh, *split(owner, 0))
    found = scene.contact()
    assert found.gap == pytest.approx(0.001, abs=1e-5)
    assert np.abs(found.points[:, 2]).max() < 0.01
    swept = scene.sweep("prismatic", (1, 0, 0), (0, 0, 0), np.array([0.2, 0.5, 1.1]), contact=True)
    assert swept.contact[0] > swept.contact[1] > swept.contact[2] == 0.0
    assert swept.gap[0] < 0.002 and swept.gap[2] > 0.05


def scaled(mesh: Mesh, factor: float) -> Mesh:
    matrix: FloatArray = np.diag([factor, factor, factor, 1.0])
    return mesh.transformed(matrix)


def test_sweeps_do_not_depend_on_scale() -> None:
    mesh, owner = cabinet()
    angles = np.deg2rad([30.0, 60.0, 90.0])
    a = SweepScene(mesh, *split(owner, 5)).sweep("revolute", (0, 1, 0), (0, 0, 0.022), angles)
    big = SweepScene(scaled(mesh, 250.0), *split(owner, 5))
    b = big.sweep("revolute", (0, 1, 0), (0, 0, 5.5), angles)
    assert a.blocked == pytest.approx(b.blocked, abs=0.01)
    assert a.depth * 250 == pytest.approx(b.depth, rel=0.05, abs=0.1)


@pytest.mark.parametrize("kind", ["edges", "rounded", "wide"])
def test_row_keys_answer_as_sorting_whole_rows(kind: str) -> None:
    rng = np.random.default_rng(3)
    rows = {
        "edges": rng.integers(0, 40, (500, 2)),
        "rounded": np.round(rng.normal(size=(500, 3)), 1),
        "wide": rng.choice(rng.integers(-(2**62), 2**62, 30), (500, 4)),
    }[kind]
    wanted = np.unique(rows, axis=0, return_index=True, return_inverse=True, return_counts=True)
    found = np.unique(row_keys(rows), return_index=True, return_inverse=True, return_counts=True)
    for a, b in zip(wanted[1:], found[1:]):
        np.testing.assert_array_equal(a.reshape(-1), b)


def test_a_small_obstacle_is_judged_by_dense_samples() -> None:
    # a drawer front of 1 x 1 with a rod of 1 % of its area in the way of its edge
    mesh, owner = boxes(((0, 0, 0), (0.05, 1, 1)), ((0.5, 0.96, 0.0), (0.6, 1.06, 0.4)))
    paths = PartPaths(mesh, np.flatnonzero(owner == 0), np.flatnonzero(owner == 1))
    axis, origin = np.array([1.0, 0, 0]), np.zeros(3)
    rule = Rule(0.005 * mesh.diagonal, 0.004)
    free, found = paths.free_range("prismatic", axis, origin, 1.0, rule)
    assert found.value is not None and 0.44 < free < 0.47  # the front's far face is at 0.05
    again, _ = paths.dense.free_range("prismatic", axis, origin, 1.0, rule)
    assert abs(again - free) < 0.02


def test_a_hinge_line_stays_on_both_bodies_or_is_told_how_far_it_strays() -> None:
    mesh, owner = boxes(((0, 0, 0), (0.4, 1, 1)), ((-0.02, 0, 0), (0, 1, 1)))
    bodies = HingeBodies(mesh, np.flatnonzero(owner == 1), np.flatnonzero(owner == 0))
    up = np.array([0.0, 0, 1])
    assert bodies.line_gap(up, np.array([0.0, 0, 0])) < 1e-6  # the common edge
    away = bodies.line_gap(up, np.array([-0.2, -0.3, 0]))
    assert away == pytest.approx(np.hypot(0.2, 0.3) / mesh.diagonal, rel=0.02)


def test_a_spindle_inside_a_leaf_lies_on_it() -> None:
    mesh, owner = boxes(((0, 0, 0), (1, 0.2, 1)), ((0.1, -0.1, 0.45), (0.4, 0.3, 0.55)))
    bodies = HingeBodies(mesh, np.flatnonzero(owner == 1), np.flatnonzero(owner == 0))
    line = np.array([0, 1.0, 0]), np.array([0.15, 0, 0.5])
    assert bodies.line_gap(*line) > 0.02
    assert bodies.line_gap(*line, bodies.encloses) == 0.0


def test_a_line_through_one_knuckle_beside_a_lid_does_not_run_askew() -> None:
    mesh, owner = boxes(
        ((-0.4, 0, 0), (0.02, 1, 0.99)),
        ((-0.4, 0, 1), (0, 1, 1.05)),
        ((0, 0.35, 0.98), (0.02, 0.65, 1.0)),
    )
    bodies = HingeBodies(mesh, np.flatnonzero(owner > 0), np.flatnonzero(owner == 0))
    gap = bodies.line_gap(np.array([0, 1.0, 0]), np.array([0.02, 0, 1.0]))
    assert gap < 0.011 / mesh.diagonal
