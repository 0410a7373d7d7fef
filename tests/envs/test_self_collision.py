"""An arm that would run into itself is no way for a planner, where the simulator stops it too."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mam_envs.object_model import ObjectModel
from mam_envs.placement.arm_path import free
from mam_envs.placement.settings import PLACEMENT
from mam_envs.robots import RobotSpec, robot_spec
from mam_envs.robots.self_collision import SelfCollision, self_collision
from mam_pipeline.asset.card import Asset

FOLDED = np.array([0.0, -0.5, 0.0, -3.05, 0.0, 0.6, 0.785])
"""The Panda's hand at its own base."""


def touches(robot: RobotSpec, arm: np.ndarray) -> bool:
    found = self_collision(robot, PLACEMENT.arm_room * robot.reach)
    return found.touches(robot.link_poses(arm[None], robot.opened))


@pytest.mark.parametrize("name", ["panda", "so100", "so101", "fetch"])
def test_a_robot_at_rest_keeps_clear_of_itself(name: str) -> None:
    assert not touches(robot_spec(name), robot_spec(name).rest_arm)


def test_pairs_that_the_srdf_takes_out_do_not_count() -> None:
    pairs = {frozenset(pair) for pair in self_collision(robot_spec("panda"), 0.01).pairs}
    assert frozenset(("panda_link0", "panda_link6")) in pairs
    assert frozenset(("panda_link5", "panda_link7")) not in pairs  # its SRDF says so
    assert frozenset(("panda_link6", "panda_hand")) not in pairs  # one joint between them


def test_links_must_keep_room() -> None:
    robot = robot_spec("panda")
    rng = np.random.default_rng(0)
    low, high = robot.chain.limits.T
    poses = [robot.link_poses(a[None], robot.opened) for a in rng.uniform(low, high, (60, 7))]
    near, far = (SelfCollision(robot, room) for room in (0.0, 0.05))
    hits = np.array([[s.touches(p) for p in poses] for s in (near, far)])
    assert 0 < hits[0].sum() < hits[1].sum() and not (hits[0] & ~hits[1]).any()


def test_a_posture_that_folds_into_itself_is_not_free(drawer: Path) -> None:
    model, robot = ObjectModel.load(Asset.load(drawer)), robot_spec("panda")
    away = np.eye(4)
    away[0, 3] = 5.0  # of the object
    for arm, clear in ((robot.rest_arm, True), (FOLDED, False)):
        assert free(model, robot, arm, 0.04, away, np.eye(4), {}, (), -9.0, 0.0) == clear
    assert touches(robot, FOLDED)


@pytest.mark.sim
def test_the_simulator_stops_the_arm_where_this_says_so(drawer: Path) -> None:
    import sapien
    import torch

    import mam_envs

    robot = robot_spec("panda")
    env = mam_envs.make(drawer, control_mode="pd_joint_pos", obs_mode="none", reward_mode="none")
    env.reset(seed=0)
    scene, arm = env.unwrapped.scene, env.unwrapped.agent.robot
    arm.set_pose(sapien.Pose([0.0, 0.0, 5.0]))  # away from all else
    near = self_collision(robot, PLACEMENT.arm_room * robot.reach)
    low, high = robot.chain.limits.T
    stopped = 0
    for posture in [FOLDED, robot.rest_arm, *np.random.default_rng(1).uniform(low, high, (60, 7))]:
        q = torch.tensor([[*posture, 0.04, 0.04]], dtype=torch.float32)
        arm.set_qpos(q), arm.set_qvel(torch.zeros_like(q))
        scene.step()
        touch = any(min(p.separation for p in c.points) < 0.0 for c in scene.get_contacts()
                    if all("panda" in b.entity.name for b in c.bodies))  # fmt: skip
        assert near.touches(robot.link_poses(posture[None], 0.04)) or not touch
        stopped += touch
    env.close()
    assert stopped > 2
