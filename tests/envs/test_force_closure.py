"""Grips and thin walls in closed form: rays on boxes, friction cones, sheets that cut a hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from mam_envs.convex import ConvexPiece
from mam_envs.grasping.force_closure import first_hit, hits, pull_capacity
from mam_envs.grasping.limits import LIMITS
from mam_envs.object_model import ObjectModel
from mam_envs.robots import robot_spec
from mam_pipeline.asset.card import Asset


def planes_of(mesh: trimesh.Trimesh) -> np.ndarray:
    on = mesh.triangles[:, 0]
    return np.unique(np.c_[mesh.face_normals, -(mesh.face_normals * on).sum(axis=1)], axis=0)


def test_rays_enter_a_box_where_they_should() -> None:
    box = trimesh.creation.box((0.2, 0.4, 0.6))
    piece = ConvexPiece(planes_of(box), np.asarray(box.vertices))
    origins = np.array([[-1.0, 0.1, 0.2], [-1.0, 0.3, 0.0], [1.0, 0.0, 0.0]])
    far, normal = hits(piece, origins, np.tile([1.0, 0.0, 0.0], (3, 1)))
    np.testing.assert_allclose(far, [0.9, np.inf, np.inf])
    np.testing.assert_allclose(normal[0], [-1.0, 0.0, 0.0])
    assert piece.thickness == pytest.approx(0.2)


def test_a_bar_bears_the_friction_of_both_fingers(drawer: Path) -> None:
    model, robot = ObjectModel.load(Asset.load(drawer)), robot_spec("panda")
    pull = np.array([-1.0, 0.0, 0.0])
    moving, q = ("part_1",), {"joint_1": 0.0}
    tool = np.eye(4)
    tool[:3, 3] = [-0.22, 0.0, 0.2]  # on the bar
    approach, closing = np.array([1.0, 0, 0]), np.array([0, 0, 1.0])
    tool[:3, :3] = np.stack([np.cross(closing, approach), closing, approach], axis=1)
    # level faces: the pull is carried by friction alone, at each finger
    share = pull_capacity(model, robot, tool, 0.04, pull, moving, q)
    assert share == pytest.approx(2 * LIMITS.friction, abs=0.21)
    tool[:3, 3] = [-0.5, 0.0, 0.2]  # in the air
    assert pull_capacity(model, robot, tool, 0.04, pull, moving, q) == 0.0
    # from above, closing along the pull: the finger behind carries it without slipping
    tool[:3, 3] = [-0.22, 0.0, 0.2]
    approach, closing = np.array([0, 0, -1.0]), np.array([1.0, 0, 0])
    tool[:3, :3] = np.stack([np.cross(closing, approach), closing, approach], axis=1)
    assert pull_capacity(model, robot, tool, 0.04, pull, moving, q) >= 10.0
    ahead, normal = first_hit(model, np.array([[-0.5, 0.0, 0.2]]), -pull[None], moving, q)
    assert ahead[0] == pytest.approx(0.5 - 0.226) and normal[0, 0] == pytest.approx(-1.0)


def test_thin_walls_are_no_less_solid(drawer: Path) -> None:
    model = ObjectModel.load(Asset.load(drawer), scale=0.4)  # boards of 6 mm
    inside = np.array([[-0.072 + 0.003, 0.0, 0.08]])  # the middle of the drawer's front
    assert model.depth(inside, {})[0] == pytest.approx(0.003, abs=1e-6)
    assert model.runs_into(inside, {}, slack=0.003)  # never 3 mm deep, and yet right through
    assert not model.runs_into(inside + np.array([0.0024, 0.0, 0.0]), {}, slack=0.003)
    assert not model.runs_into(inside, {}, slack=0.003, skip=("part_1",))
    cube = trimesh.creation.box((0.02, 0.02, 0.02))
    hull = ConvexPiece.of(np.asarray(cube.vertices))
    assert hull is not None
    pose = np.eye(4)
    pose[:3, 3] = inside[0]
    assert model.cuts_into([hull], pose, {}, slack=0.0015)
    pose[0, 3] -= 0.2
    assert not model.cuts_into([hull], pose, {}, slack=0.0015)


def test_shapes_go_through_each_other_where_edges_enter() -> None:
    box = np.asarray(trimesh.creation.box((2.0, 2.0, 0.2)).vertices)
    board = ConvexPiece.of(box)
    rod = ConvexPiece.of(np.asarray(trimesh.creation.box((0.2, 0.2, 3.0)).vertices))
    assert board is not None and rod is not None
    assert ConvexPiece.of(box * [1.0, 1.0, 0.0]) is None  # flat
    through = np.eye(4)  # no corner of either lies in the other
    assert board.cuts(rod, through, 0.01) and rod.cuts(board, through, 0.01)
    inside = ConvexPiece.of(0.1 * box)
    assert inside is not None and board.cuts(inside, through, 0.0)
    beside = np.eye(4)
    beside[0, 3] = 1.12  # 2 cm away
    assert not board.cuts(rod, beside, 0.0)
    assert board.cuts(rod, beside, -0.03) and not board.cuts(rod, beside, -0.01)
    beside[0, 3] = 1.095  # 5 mm deep
    assert board.cuts(rod, beside, 0.003) and not board.cuts(rod, beside, 0.007)
    turned = board.moved(trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0)))
    assert turned.box[1] == pytest.approx([1.0, 0.1, 1.0])
    assert turned.cuts(rod, beside, 0.003)
