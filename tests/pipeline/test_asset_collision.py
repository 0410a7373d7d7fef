"""Collision pieces cover the surface, keep cavities free, and are simple where parts are simple."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from mam_pipeline.asset.clearance import keep_apart
from mam_pipeline.asset.collision import _Space, _with_plates, collision_shapes, outside
from mam_pipeline.asset.decompose import half
from mam_pipeline.asset.shapes import MAX_HULL_POINTS
from mam_pipeline.geometry.sampling import sample_surface
from mam_pipeline.geometry.surface import Component, triangle_areas
from mam_pipeline.types import Articulation, CollisionShape, Joint, Link, Mesh


def single(solid: trimesh.Trimesh) -> Articulation:
    mesh = Mesh(solid.vertices, solid.faces)
    return Articulation(mesh, (Link("a", "body", np.arange(len(solid.faces))),), ())


def as_mesh(shape: CollisionShape) -> trimesh.Trimesh:
    if shape.kind == "box":
        return trimesh.creation.box(shape.size, transform=shape.pose)
    if shape.kind == "cylinder":
        return trimesh.creation.cylinder(shape.size[0], shape.size[1], 48, transform=shape.pose)
    return trimesh.Trimesh(shape.vertices, shape.faces)


def open_box(wall: float = 0.02) -> trimesh.Trimesh:
    outer = trimesh.creation.box(bounds=np.array([[0, 0, 0], [0.6, 0.4, 0.5]]))
    ends = np.array([[wall, wall, wall], [0.6 - wall, 0.4 - wall, 0.6]])
    inner = trimesh.creation.box(bounds=ends)
    return trimesh.boolean.difference([outer, inner], engine="manifold")


def test_no_thin_piece_closes_the_openings_of_a_frame() -> None:
    """A drawer's opening stays free for what lies in the drawer, as the front is a skin or not."""
    frame = trimesh.creation.box(bounds=[[0.0, 0.0, 0.0], [0.001, 0.4, 0.55]])
    rows = ((0.02, 0.17), (0.19, 0.34), (0.36, 0.53))
    holes = [trimesh.creation.box(bounds=[[-1, 0.02, a], [1, 0.38, b]]) for a, b in rows]
    drawers = [
        trimesh.creation.box(bounds=[[0.0, 0.03, a + 0.01], [0.35, 0.37, b - 0.01]])
        for a, b in rows
    ]
    frame = trimesh.boolean.difference([frame, *holes], engine="manifold")
    whole: Any = trimesh.util.concatenate([frame, *drawers])
    ends = np.cumsum([len(frame.faces), *(len(d.faces) for d in drawers)])
    names = ("body", "drawer_0", "drawer_1", "drawer_2")
    links = tuple(
        Link(name, name[:6], np.arange(end - size, end))
        for name, end, size in zip(names, ends, np.diff([0, *ends]))
    )
    axis = np.array([-1.0, 0.0, 0.0])
    joints = tuple(
        Joint(f"j{k}", "prismatic", "slide", 0, k, axis, np.zeros(3), 0.0, 0.25) for k in (1, 2, 3)
    )
    made = Articulation(Mesh(whole.vertices, whole.faces), links, joints)
    pieces = collision_shapes(made)["body"]
    middles = np.array([[0.0005, 0.2, 0.5 * (a + b)] for a, b in rows])
    assert pieces and all((outside(piece, middles) > 0.005).all() for piece in pieces)
    bars = np.array([[0.0005, 0.2, z] for z in (0.01, 0.18, 0.35, 0.54)])
    assert (np.min([outside(piece, bars) for piece in pieces], axis=0) < 0.005).all()


def test_a_turned_box_is_one_box() -> None:
    turn = trimesh.transformations.rotation_matrix(0.5, [1, 2, 3])
    (shape,) = collision_shapes(single(trimesh.creation.box([0.2, 0.3, 0.5], transform=turn)))["a"]
    assert shape.kind == "box"
    assert np.sort(shape.size) == pytest.approx([0.2, 0.3, 0.5], abs=1e-6)
    assert np.linalg.det(shape.pose[:3, :3]) == pytest.approx(1.0)


def test_cylinders_and_balls_are_such_and_an_egg_is_a_small_hull() -> None:
    (shape,) = collision_shapes(single(trimesh.creation.cylinder(0.1, 0.4, 48)))["a"]
    assert shape.kind == "cylinder"
    assert shape.size[:2] == pytest.approx([0.1, 0.4], rel=0.02)
    ball = trimesh.creation.icosphere(4, 0.1)
    (shape,) = collision_shapes(single(ball))["a"]
    assert shape.kind == "sphere" and shape.size[0] == pytest.approx(0.1, rel=0.02)
    ball.vertices *= [1.0, 1.2, 0.9]
    shape = max(collision_shapes(single(ball))["a"], key=lambda s: len(s.faces))
    assert shape.kind == "convex" and len(shape.vertices) <= MAX_HULL_POINTS
    assert len(shape.faces) <= 64


def test_a_sheet_gets_a_thickness() -> None:
    sheet = trimesh.Trimesh(
        [[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], [[0, 1, 2], [0, 2, 3]], process=False
    )
    (shape,) = collision_shapes(single(sheet))["a"]
    assert shape.kind == "box" and shape.size.min() >= 0.001


def test_a_flat_triangle_does_not_stand_out_of_itself() -> None:
    corners = np.array([[0.0, 0, 0], [0, 0, 0.9], [0.5, 0, 0.9], [0.5, 0, 0.0]])
    sheet = trimesh.Trimesh(corners[:3], [[0, 1, 2]])
    (shape,) = collision_shapes(single(sheet))["a"]
    assert shape.kind == "convex"
    reach = np.abs(as_mesh(shape).bounds - sheet.bounds).max()
    assert reach < 0.0011
    whole = trimesh.Trimesh(corners, [[0, 1, 2], [0, 2, 3]])
    (shape,) = collision_shapes(single(whole))["a"]
    assert shape.kind == "box"


def test_an_open_box_keeps_its_cavity() -> None:
    solid = open_box()
    shapes = collision_shapes(single(solid))["a"]
    assert 5 <= len(shapes) <= 8
    volume = sum(as_mesh(s).volume for s in shapes)
    assert volume == pytest.approx(solid.volume, rel=0.15)
    inside = np.random.default_rng(0).uniform([0.03, 0.03, 0.03], [0.57, 0.37, 0.5], (500, 3))
    for shape in shapes:
        assert not as_mesh(shape).contains(inside).any()


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_pieces_cover_the_surface(turn: float) -> None:
    solid: Any = trimesh.util.concatenate([open_box(), trimesh.creation.torus(0.15, 0.03, 24, 12)])
    solid.apply_transform(trimesh.transformations.rotation_matrix(turn, [0, 0, 1]))
    articulation = single(solid)
    pieces = collision_shapes(articulation)["a"]
    assert len(pieces) <= 32
    points = sample_surface(articulation.mesh.vertices, articulation.mesh.faces, 2000).points
    distance = np.full(len(points), np.inf)
    for shape in pieces:
        body = as_mesh(shape)
        near = np.abs(trimesh.proximity.closest_point(body, points)[1])
        near[body.contains(points)] = 0.0
        distance = np.minimum(distance, near)
    assert (distance < 0.01 * articulation.mesh.diagonal).mean() >= 0.98


def test_the_same_input_gives_the_same_pieces() -> None:
    one, two = (collision_shapes(single(open_box()))["a"] for _ in range(2))
    assert len(one) == len(two)
    for a, b in zip(one, two):
        np.testing.assert_array_equal(a.pose, b.pose)
        np.testing.assert_array_equal(a.vertices, b.vertices)


def test_a_bent_tube_is_covered() -> None:
    """A tube's hull is mostly empty space, and its bend fits no box: plates finish what is bare."""
    turn = np.linspace(0.0, np.pi, 25)
    ring = np.linspace(0.0, 2 * np.pi, 13)[:-1]
    x = (0.3 + 0.03 * np.cos(ring)[None]) * np.cos(turn)[:, None]
    z = (0.3 + 0.03 * np.cos(ring)[None]) * np.sin(turn)[:, None]
    y = np.broadcast_to(0.03 * np.sin(ring)[None], x.shape)
    index = np.arange(x.size).reshape(x.shape)
    a, b = index[:-1], np.roll(index, -1, axis=1)[:-1]
    c, d = index[1:], np.roll(index, -1, axis=1)[1:]
    faces = np.concatenate([np.stack([a, b, c], -1), np.stack([b, d, c], -1)]).reshape(-1, 3)
    vertices = np.stack([x, y, z], -1).reshape(-1, 3)
    mesh = Mesh(vertices, faces)
    whole = Articulation(mesh, (Link("tube", "tube", np.arange(len(faces))),), ())
    shapes = collision_shapes(whole)["tube"]
    assert 3 <= len(shapes) <= 32
    points = sample_surface(vertices, faces, 1000).points
    near = np.min([outside(s, points) for s in shapes], axis=0) < 0.01 * mesh.diagonal
    assert near.mean() > 0.98


def test_unconnected_neighbours_do_not_overlap() -> None:
    """Two drawers' hulls meet between them; a knob's piece is planed off at the carcass."""
    blocks = [
        trimesh.creation.box(bounds=np.array(b))
        for b in ([[0, 0, 0], [1, 1, 0.1]], [[0, 0, 0.2], [1, 1, 0.4]], [[0, 0, 0.4], [1, 1, 0.6]])
    ]
    whole: Any = trimesh.util.concatenate(blocks)
    links = tuple(Link(f"l{i}", "part", np.arange(12 * i, 12 * i + 12)) for i in range(3))
    axis = np.array([1.0, 0, 0])
    joints = tuple(
        Joint(f"j{i}", "prismatic", "slide", 0, i, axis, np.zeros(3), 0.0, 0.5) for i in (1, 2)
    )
    found = Articulation(Mesh(whole.vertices, whole.faces), links, joints)
    fat = {
        "l0": [CollisionShape("box", pose=_at(0.5, 0.5, 0.05), size=np.array([1, 1, 0.1]))],
        "l1": [CollisionShape("box", pose=_at(0.5, 0.5, 0.305), size=np.array([1, 1, 0.21]))],
        "l2": [CollisionShape("box", pose=_at(0.5, 0.5, 0.495), size=np.array([1, 1, 0.21]))],
    }
    apart = keep_apart(found, fat)
    assert apart["l0"][0] is fat["l0"][0]
    below, above = apart["l1"][0], apart["l2"][0]
    assert below.kind == above.kind == "box"
    top, bottom = (s.pose[2, 3] + k * s.size[2] / 2 for s, k in ((below, 1), (above, -1)))
    assert 0.0 < bottom - top < 0.002
    assert below.size[2] > 0.185 and above.size[2] > 0.185


def test_a_planed_hull_does_not_grow_again() -> None:
    """A many-cornered piece is simplified after it was cut: never beyond the cut."""
    ball = trimesh.creation.icosphere(3, radius=0.5)
    box = trimesh.creation.box(bounds=np.array([[-0.5, -0.5, 0.45], [0.5, 0.5, 0.6]]))
    floor = trimesh.creation.box(bounds=np.array([[-1, -1, -1], [1, 1, -0.9]]))
    whole: Any = trimesh.util.concatenate([floor, ball, box])
    ends = np.cumsum([12, len(ball.faces), 12])
    links = tuple(
        Link(f"l{i}", "part", np.arange(end - n, end))
        for i, (end, n) in enumerate(zip(ends, (12, len(ball.faces), 12)))
    )
    joints = tuple(
        Joint(f"j{i}", "prismatic", "slide", 0, i, np.array([1.0, 0, 0]), np.zeros(3), 0.0, 0.5)
        for i in (1, 2)
    )
    found = Articulation(Mesh(whole.vertices, whole.faces), links, joints)
    hull = CollisionShape("convex", vertices=ball.vertices, faces=ball.faces)
    lid = CollisionShape("box", pose=_at(0, 0, 0.525), size=np.array([1, 1, 0.15]))
    apart = keep_apart(found, {"l0": [], "l1": [hull], "l2": [lid]})
    cut, other = apart["l1"][0], apart["l2"][0]
    assert cut.vertices[:, 2].max() < other.pose[2, 3] - other.size[2] / 2
    assert 0.4 < cut.vertices[:, 2].max() < 0.5


def _at(*xyz: float) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = xyz
    return pose


def test_a_plate_does_not_stand_out_of_its_link() -> None:
    """A square sheet that is bare along its diagonal: a box about the band passes its corners."""
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
    sheet = Component(corners, np.array([[0, 1, 2], [0, 2, 3]]), np.arange(2), closed=False)
    space = _Space([sheet], 0.01, 1.5, np.zeros((0, 3)))
    covers = []
    for triangle in ([[0.2, 0], [1, 0], [1, 0.8]], [[0, 0.2], [0, 1], [0.8, 1]]):
        foot = np.pad(np.array(triangle), ((0, 0), (0, 1)))
        up = np.array([0, 0, 0.01])
        solid = trimesh.PointCloud(np.concatenate([foot - up, foot + up])).convex_hull
        covers.append(CollisionShape("convex", vertices=solid.vertices, faces=solid.faces))
    shapes = _with_plates([sheet], covers, np.zeros((0, 3)), space, 0.0, 32)
    points = sample_surface(corners, sheet.faces, 2000, 3).points
    covered = np.min([outside(s, points) for s in shapes], axis=0) < 0.02
    assert len(shapes) > 2 and covered.mean() > 0.9
    for shape in shapes:
        low, high = as_mesh(shape).bounds
        assert (low > -0.015).all() and (high < [1.015, 1.015, 0.015]).all()


@pytest.mark.parametrize("seed", range(5))
def test_no_half_of_a_surface_leaves_it(seed: int) -> None:
    """However near to the plane vertices lie, a cut edge ends within its triangle."""
    rng = np.random.default_rng(seed)
    vertices, faces = rng.normal(size=(60, 3)), rng.integers(0, 60, (100, 3))
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    near = rng.random(60) < 0.6
    away = rng.normal(size=60) * 10.0 ** rng.integers(-12, -7, 60)
    onto = vertices @ direction - 0.1 - away
    vertices[near] -= np.outer(onto, direction)[near]
    area = 0.0
    for side in (1.0, -1.0):
        points, cut = half(vertices, faces, side * direction, side * 0.1)
        assert (points.min(axis=0) >= vertices.min(axis=0) - 1e-9).all()
        assert (points.max(axis=0) <= vertices.max(axis=0) + 1e-9).all()
        assert (points[cut] @ (side * direction) >= side * 0.1 - 1e-9).all()
        area += float(triangle_areas(points[cut]).sum())
    assert area == pytest.approx(float(triangle_areas(vertices[faces]).sum()), rel=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_no_piece_leaves_its_part(seed: int) -> None:
    """Boards whose faces lie beside each other by rounding alone."""
    rng = np.random.default_rng(seed)
    turn = trimesh.transformations.random_rotation_matrix(rng.random(3))
    boards = [
        trimesh.creation.box(
            bounds=np.sort(rng.random((2, 3)).round(1) + np.array([[0.0], [0.05]]), axis=0)
        )
        for _ in range(6)
    ]
    whole: Any = trimesh.util.concatenate(boards).apply_transform(turn)
    whole.vertices += rng.normal(size=whole.vertices.shape) * 10.0 ** rng.integers(-10, -7)
    body = single(whole)
    planes = ConvexHull(whole.vertices).equations
    for shape in collision_shapes(body)["a"]:
        beyond = as_mesh(shape).vertices @ planes[:, :3].T + planes[:, 3]
        assert beyond.max() < 0.01 * body.mesh.diagonal
