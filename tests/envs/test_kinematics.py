"""Kinematic trees and inverse kinematics against closed forms and their own forward kinematics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mam_envs.kinematics import KinematicModel, rotation_vector
from mam_envs.robots import robot_spec
from mam_pipeline.errors import ConfigError, InputError


def test_slide_and_hinge_move_as_stated(drawer: Path, door: Path) -> None:
    slide = KinematicModel.load(drawer / "object.urdf").link_poses({"joint_1": 0.1})
    np.testing.assert_allclose(slide["part_1"][0, :3, 3], [-0.1, 0, 0.2], atol=1e-9)
    swing = KinematicModel.load(door / "object.urdf").link_poses({"joint_1": np.pi / 2})["part_1"]
    # a door hinged at +y swings its free edge (-y) to -x
    free_edge = swing[0, :3, :3] @ [0, -0.36, 0] + swing[0, :3, 3]
    np.testing.assert_allclose(free_edge, [-0.182 - 0.36, 0.18, 0.2], atol=1e-9)


def test_scale_scales_lengths_only(drawer: Path) -> None:
    model = KinematicModel.load(drawer / "object.urdf", scale=0.5)
    assert model.joint("joint_1").upper == pytest.approx(0.125)
    np.testing.assert_allclose(model.link_poses({})["part_1"][0, :3, 3], [0, 0, 0.1])


@pytest.mark.parametrize("uid", ["panda", "so100", "fetch"])
def test_jacobian_is_the_derivative(uid: str) -> None:
    chain = robot_spec(uid).chain
    rng = np.random.default_rng(1)
    q = rng.uniform(chain.limits[:, 0] * 0.9, chain.limits[:, 1] * 0.9, (4, len(chain.active)))
    rotation, position, jacobian = chain.forward(q)
    for k in range(q.shape[1]):
        moved = q.copy()
        moved[:, k] += 1e-6
        r, p, _ = chain.forward(moved)
        np.testing.assert_allclose((p - position) / 1e-6, jacobian[:, :3, k], atol=1e-5)
        turned = rotation_vector(r, rotation) / 1e-6
        np.testing.assert_allclose(turned, jacobian[:, 3:, k], atol=1e-4)


def test_solutions_reach_and_stay_inside_the_limits() -> None:
    chain = robot_spec("panda").chain
    rng = np.random.default_rng(2)
    q = rng.uniform(chain.limits[:, 0], chain.limits[:, 1], (60, 7))
    rotation, position, _ = chain.forward(q)
    target = np.tile(np.eye(4), (60, 1, 1))
    target[:, :3, :3], target[:, :3, 3] = rotation, position
    found = chain.solve(target, q + rng.normal(0, 0.15, q.shape), iterations=50)
    assert found.good(1e-3, 1e-2).mean() > 0.95
    assert (found.q >= chain.limits[:, 0]).all() and (found.q <= chain.limits[:, 1]).all()


def test_half_a_turn_has_a_rotation_vector() -> None:
    half = np.diag([1.0, -1.0, -1.0])[None]
    np.testing.assert_allclose(np.abs(rotation_vector(half, np.eye(3)[None])), [[np.pi, 0, 0]])


def test_bad_files_and_names_say_what_is_wrong(tmp_path: Path) -> None:
    (tmp_path / "x.urdf").write_text("no xml")
    with pytest.raises(InputError, match="is not well-formed XML"):
        KinematicModel.load(tmp_path / "x.urdf")
    with pytest.raises(ConfigError, match="no robot named 'pandra'; did you mean 'panda'"):
        robot_spec("pandra")
