"""The procedural world: determinism, labels, truth of joints, styles, splits."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest

from mam_pipeline.errors import ConfigError
from mam_pipeline.types import CollisionShape, FloatArray, joint_motion
from mam_world import CATEGORIES, Style, WorldObject, collide, make_object, shapes
from mam_world.fuse_style import FEWEST, MOST
from mam_world.kit import Builder
from mam_world.object import generator
from mam_world.splits import (
    SPLITS,
    TEST_ONLY,
    VALIDATION_ONLY,
    benchmark,
    iterate,
    split_of,
)
from mam_world.style import draw_style
from mam_world.surround import swept_boxes

NAMES = list(CATEGORIES)


def _depth(points: FloatArray, piece: CollisionShape) -> FloatArray:
    """How deep (n, 3) points lie inside a convex piece; negative outside."""
    local = (points - piece.pose[:3, 3]) @ piece.pose[:3, :3]
    if piece.kind == "box":
        return (piece.size / 2 - np.abs(local)).min(axis=1)
    if piece.kind == "sphere":
        return piece.size[0] - np.linalg.norm(local, axis=1)
    if piece.kind == "cylinder":
        across = piece.size[0] - np.linalg.norm(local[:, :2], axis=1)
        return np.minimum(across, piece.size[1] / 2 - np.abs(local[:, 2]))
    t = piece.vertices[piece.faces]
    normal = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
    length = np.linalg.norm(normal, axis=1)
    keep = length > 1e-14
    normal = normal[keep] / length[keep][:, None]
    return -(points @ normal.T - np.einsum("ij,ij->i", t[keep, 0], normal)).max(axis=1)


def _deepest(points: FloatArray, pieces: Sequence[CollisionShape]) -> FloatArray:
    out: FloatArray = np.zeros(len(points), dtype=np.float64)
    for piece in pieces:
        out = np.maximum(out, _depth(points, piece))
    return out


def _moving(made: WorldObject, child: int) -> set[int]:
    links = {child}
    for joint in made.articulation.joints:  # parents come first
        if joint.parent in links:
            links.add(joint.child)
    return links


def _surface(made: WorldObject, links: set[int], count: int) -> FloatArray:
    mesh = made.articulation.mesh
    t = mesh.vertices[mesh.faces[np.isin(made.articulation.face_link, list(links))]]
    area = np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1)
    rng = np.random.default_rng(0)
    face = rng.choice(len(t), count, p=area / area.sum())
    u = rng.random((count, 2))
    u[u.sum(axis=1) > 1] = 1 - u[u.sum(axis=1) > 1]
    return t[face, 0] + u[:, :1] * (t[face, 1] - t[face, 0]) + u[:, 1:] * (t[face, 2] - t[face, 0])


@pytest.mark.parametrize("name", NAMES)
def test_every_category_is_sound(name: str) -> None:
    for seed in np.random.default_rng(7).integers(0, 100_000, 2):
        made = make_object(name, int(seed), replace(draw_style(generator(name, seed)), fused=False))
        truth = made.articulation
        assert len(truth.joints) == len(truth.links) - 1 >= 1
        assert (truth.face_link >= 0).all()
        assert sum(len(link.faces) for link in truth.links) == len(truth.mesh.faces)
        assert np.isfinite(truth.mesh.vertices).all()
        known = {0}
        for joint in truth.joints:
            assert joint.parent in known, "joints come parents first"
            known.add(joint.child)
            assert np.linalg.norm(joint.axis) == pytest.approx(1.0)
            assert joint.lower - 1e-9 <= 0 <= joint.upper + 1e-9, "the source's pose is allowed"
            assert joint.lower < joint.upper
        moved = {j.name for j in truth.joints}
        assert all(g.joint in moved for g in truth.grasps)
        assert set(made.collision) == {link.name for link in truth.links}
        assert all(made.collision[link.name] for link in truth.links)
        assert len(made.static_face_link) == len(made.static.faces)


@pytest.mark.parametrize("name", NAMES)
def test_no_joint_runs_into_the_rest(name: str, made: WorldObject | None = None) -> None:
    """Sampled surface of what moves against the exact convex pieces of what does not."""
    made = made or make_object(name, 3, Style())
    names = [link.name for link in made.articulation.links]
    allowed = 0.005 * made.articulation.mesh.diagonal
    for joint in made.articulation.joints:
        moving = _moving(made, joint.child)
        rest = [p for k, n in enumerate(names) if k not in moving for p in made.collision[n]]
        points = _surface(made, moving, 400)
        before = _deepest(points, rest)
        low, high = joint.lower, joint.upper
        if not np.isfinite(low + high):
            low, high = 0.0, 2 * np.pi
        for value in np.linspace(low, high, 4):
            m = joint_motion(joint.type, joint.axis, joint.origin, value)
            deeper = _deepest(points @ m[:3, :3].T + m[:3, 3], rest) - before
            share = float((deeper > allowed).mean())
            assert share < 0.01, f"{joint.name} at {value:.2f}: {deeper.max():.4f} m deep"


def _digest(seed: int) -> str:
    """Of every byte of one object of every category: exact mesh, file, materials, collision."""
    total = sha256()
    for name in CATEGORIES:
        drawn = draw_style(generator(name, seed, stream=1))
        style = replace(drawn, fused=False, textures=name in ("safe", "desk", "oven"))
        made = make_object(name, seed, style)
        for mesh in (made.articulation.mesh, made.static):
            total.update(mesh.vertices.tobytes() + mesh.faces.tobytes())
            total.update(repr(mesh.group_names).encode())
            for material in mesh.materials:
                total.update(repr(material.base_color).encode() + (material.image or b""))
        for joint in made.articulation.joints:
            total.update(repr(joint).encode())
        total.update(repr(sorted(made.collision.items())).encode())
    return total.hexdigest()


@pytest.mark.slow
def test_same_seed_same_bytes_in_every_process() -> None:
    """All categories, once here and once in a process whose sets and dicts hash otherwise."""
    here = _digest(11)
    code = f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r}); import test_world as t"
    out = subprocess.run(
        [sys.executable, "-c", f"{code}; print(t._digest(11))"],
        env={**os.environ, "PYTHONHASHSEED": "4711"}, capture_output=True, text=True, check=True,
    )  # fmt: skip
    assert out.stdout.strip() == here
    one, other = make_object("safe", 11).articulation, make_object("safe", 12).articulation
    assert one.mesh.vertices.tobytes() != other.mesh.vertices.tobytes()


def test_file_transform_and_truth_lie_on_each_other() -> None:
    style = Style(yaw=0.7, tilt=0.05, tilt_towards=1.0, y_up=True, unit="inch", double_sided=True,
                  unshared=True)  # fmt: skip
    made = make_object("chest_of_drawers", 5, style)
    back = made.truth()
    np.testing.assert_allclose(back.mesh.bounds, made.articulation.mesh.bounds, atol=1e-6)
    assert len(made.static.faces) == 2 * len(made.articulation.mesh.faces)
    assert len(made.static.vertices) == 3 * len(made.static.faces)
    scale = np.cbrt(np.linalg.det(made.static_T_asset[:3, :3]))
    assert scale == pytest.approx(1 / 0.0254)


def test_front_faces_minus_x_and_drawers_open_that_way() -> None:
    made = make_object("chest_of_drawers", 2, Style())
    for joint in made.articulation.joints:
        np.testing.assert_allclose(joint.axis, [-1, 0, 0], atol=1e-9)
        assert joint.type == "prismatic" and joint.closed == 0 and joint.open == joint.upper


def test_partly_open_source_shifts_the_limits_only() -> None:
    shut = make_object("cabinet_two_door", 4, Style())
    ajar = make_object("cabinet_two_door", 4, Style(ajar=1.0))
    for a, b in zip(shut.articulation.joints, ajar.articulation.joints):
        assert b.closed < 0 < b.open
        assert b.upper - b.lower == pytest.approx(a.upper - a.lower)
        np.testing.assert_allclose(b.axis, a.axis)
    q = {j.name: j.closed for j in ajar.articulation.joints}
    poses = ajar.articulation.link_poses(q)
    link = ajar.articulation.face_link
    mesh = ajar.articulation.mesh
    for k in range(len(poses)):
        used = np.unique(mesh.faces[link == k])
        back = mesh.vertices[used] @ poses[k][:3, :3].T + poses[k][:3, 3]
        np.testing.assert_allclose(back, shut.articulation.mesh.vertices[used], atol=1e-9)


@pytest.mark.parametrize("switch", [
    {"double_sided": True}, {"unshared": True}, {"components": "split"}, {"components": "welded"},
    {"sheets": True}, {"open_shells": True}, {"drawer_boxes": False}, {"fasteners": True},
    {"tessellation": "coarse"}, {"tessellation": "dense"}, {"nodes": "object"}, {"textures": True},
    {"setting": "board"}, {"decoys": 3},
])  # fmt: skip
def test_each_switch_changes_the_file_and_keeps_the_joints(switch: dict) -> None:
    name = "oven" if "tessellation" in switch else "nightstand"
    plain = make_object(name, 0, Style())
    other = make_object(name, 0, replace(Style(), **switch))
    assert [j.name for j in plain.articulation.joints] == [
        j.name for j in other.articulation.joints
    ]
    a, b = plain.static, other.static
    same = len(a.faces) == len(b.faces) and len(a.vertices) == len(b.vertices)
    assert not same or a.materials != b.materials or a.group_names != b.group_names
    assert len(other.static_face_link) == len(b.faces)
    assert set(other.static_face_link) == set(plain.static_face_link)


def test_gap_zero_lets_neighbours_touch() -> None:
    for gap in (0.0, 0.005):
        made = make_object("chest_of_drawers", 2, Style(gap=gap))
        mesh, link = made.articulation.mesh, made.articulation.face_link
        fronts = [mesh.vertices[np.unique(mesh.faces[link == k])] for k in (1, 2)]
        low = sorted(fronts, key=lambda v: v[:, 2].min())
        between = low[1][:, 2].min() - low[0][:, 2].max()
        assert (between > 0.003) == (gap > 0)


def test_fused_is_closed_and_labelled() -> None:
    style = Style(fused=True, fuse_resolution=64, fuse_noise=0.001)
    made = make_object("safe", 1, style)
    mesh = made.static
    edges = np.sort(
        np.concatenate([mesh.faces[:, [0, 1]], mesh.faces[:, [1, 2]], mesh.faces[:, [2, 0]]]), 1
    )
    _, count = np.unique(edges, axis=0, return_counts=True)
    assert (count % 2 == 0).all(), "watertight"
    assert set(made.static_face_link) == set(range(len(made.articulation.links)))
    np.testing.assert_allclose(
        mesh.bounds, made.articulation.mesh.bounds, atol=0.03 * mesh.diagonal
    )


@pytest.mark.parametrize(("name", "resolution"), [("pen", 96), ("toaster", 192)])
def test_fused_meshes_have_the_face_count_of_scans(name: str, resolution: int) -> None:
    style = Style(fused=True, fuse_resolution=resolution)
    assert FEWEST <= len(make_object(name, 801274, style).static.faces) <= MOST


@pytest.mark.parametrize("setting", ["board", "table", "wall", "corner", "niche"])
def test_settings_belong_to_the_base_and_stay_clear(setting: str) -> None:
    for name in ("cabinet_two_door", "station_lever", "box_with_lid"):
        plain = make_object(name, 5, Style())
        made = make_object(name, 5, Style(setting=setting, decoys=4))  # type: ignore[arg-type]
        assert [j.name for j in made.articulation.joints] == [
            j.name for j in plain.articulation.joints
        ]
        mesh, link = made.articulation.mesh, made.articulation.face_link
        assert len(mesh.faces[link == 0]) > (plain.articulation.face_link == 0).sum()
        assert (link > 0).sum() == (plain.articulation.face_link > 0).sum()
        assert mesh.bounds[0][2] == pytest.approx(0.0, abs=1e-6)
        test_no_joint_runs_into_the_rest(name, made)


def test_swept_boxes_hold_every_pose() -> None:
    b = Builder(generator("robot_arm", 3), Style())
    CATEGORIES["robot_arm"].builder()(b)
    boxes = swept_boxes(b)
    low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
    made = make_object("robot_arm", 3, Style()).articulation
    rng = np.random.default_rng(0)
    moving = made.mesh.faces[made.face_link > 0]
    links = made.face_link[made.face_link > 0]
    for _ in range(20):
        q = {j.name: rng.uniform(max(j.lower, -3.2), min(j.upper, 3.2)) for j in made.joints}
        pose = made.link_poses(q)[links]
        points = made.mesh.vertices[moving[:, 0]]
        points = np.einsum("nij,nj->ni", pose[:, :3, :3], points) + pose[:, :3, 3]
        assert (points >= low - 1e-6).all() and (points <= high + 1e-6).all()


def test_overlapping_boxes_grow_by_no_more_than_asked() -> None:
    plain = make_object("box_cabinet", 1, Style())
    other = make_object("box_cabinet", 1, Style(overlap=0.005))
    grown = np.abs(other.static.vertices - plain.static.vertices)
    assert 0 < grown.max() <= 0.005 * plain.static.diagonal + 1e-9
    assert (other.static.faces == plain.static.faces).all()


def test_shapes_are_closed_and_outward() -> None:
    square = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]])
    cases = {
        "box": (shapes.box((0, 0, 0), (1, 2, 3)), 6.0),
        "prism": (shapes.extrude(square, 2.0), 6.0),
        "cylinder": (shapes.revolve([[0, 0], [1, 0], [1, 2], [0, 2]], 256), 2 * np.pi),
        "tube": (shapes.revolve([[1, 0], [2, 0], [2, 1], [1, 1]], 256, loop=True), 3 * np.pi),
    }
    for name, (shape, volume) in cases.items():
        a, b, c = (shape.vertices[shape.faces[:, k]] for k in range(3))
        found = float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6
        assert found == pytest.approx(volume, rel=2e-3), name


def test_bodies_of_extruded_shapes_fill_them() -> None:
    angle = np.linspace(0, np.pi, 9)
    arch = [(-0.2, 0), *zip(-0.1 * np.cos(angle), 0.1 * np.sin(angle)), (0.2, 0), (0.2, 0.2),
            (-0.2, 0.2)]  # fmt: skip
    ell = [(0, 0), (0.2, 0), (0.2, 0.1), (0.1, 0.1), (0.1, 0.2), (0, 0.2)]
    turned = (np.array(ell) @ [[0.8, 0.6], [-0.6, 0.8]]).tolist()
    for outline in (arch, arch[::-1], ell, turned, [(0, 0), (1, 0), (0, 1)]):
        pieces = collide.prism(outline, 0.5)
        found = sum(float(_volume(p)) for p in pieces)
        assert found == pytest.approx(0.5 * abs(shapes.signed_area(np.array(outline))), rel=1e-3)
        for piece in pieces:
            assert (_depth(piece.vertices, piece) > -1e-9).all(), "convex"


def test_bodies_of_turned_shapes_are_few_and_without_wafers() -> None:
    knob = collide.solid([[0.042, 0], [0.042, 0.004], [0.035, 0.005], [0.03, 0.02]])
    assert [p.kind for p in knob] == ["cylinder", "convex"]
    assert np.ptp(knob[1].vertices[:, 2]) == pytest.approx(0.016)
    ball = collide.solid([[0.1 * np.cos(t), 0.1 * np.sin(t)] for t in np.linspace(-1.4, 1.4, 8)])
    assert len(ball) == 1, "one convex stretch is one piece"
    waist = collide.solid([[0.1, 0], [0.05, 0.1], [0.1, 0.2]])
    assert len(waist) == 2


@pytest.mark.parametrize("name", ["door_double", "window_casement", "cabinet_two_door"])
def test_leaves_that_meet_swing_clear_of_each_other(name: str) -> None:
    pairs = 0
    for seed in range(6):
        made = make_object(name, seed, Style())
        leaves = [j for j in made.articulation.joints if j.parent == 0 and j.type == "revolute"]
        names = [link.name for link in made.articulation.links]
        for joint, other in itertools.permutations(leaves, 2):
            pairs += 1
            points = _surface(made, {joint.child}, 3000)
            for value in np.linspace(0.005, 0.25, 20):
                m = joint_motion(joint.type, joint.axis, joint.origin, value)
                deep = _deepest(points @ m[:3, :3].T + m[:3, 3], made.collision[names[other.child]])
                assert deep.max() < 2e-5, f"seed {seed}: {joint.name} at {value:.3f}"
    assert pairs


def _volume(piece: CollisionShape) -> float:
    a, b, c = (piece.vertices[piece.faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6


def test_splits_do_not_meet() -> None:
    pairs = {s: set(iterate(s, 300)) for s in SPLITS}
    assert not pairs["train"] & pairs["test"] and not pairs["train"] & pairs["validation"]
    assert not pairs["validation"] & pairs["test"]
    for split, members in pairs.items():
        assert len(members) == 300
        assert all(split_of(*pair) == split for pair in members)
    assert not {n for n, _ in pairs["train"]} & (TEST_ONLY | VALIDATION_ONLY)
    assert set(CATEGORIES) >= TEST_ONLY | VALIDATION_ONLY
    assert {n for n, _ in pairs["test"]} >= TEST_ONLY


def test_benchmark_yields_objects_of_the_split() -> None:
    for made in benchmark("test", 3):
        assert split_of(made.category, made.seed) == "test"


def test_errors_name_the_way_out() -> None:
    with pytest.raises(ConfigError, match="no category named 'sefe'; did you mean 'safe'"):
        make_object("sefe", 0)
    with pytest.raises(ConfigError, match="no split named 'tset'; did you mean 'test'"):
        next(iterate("tset"))
