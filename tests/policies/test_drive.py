"""Fetch drives to an object, stands, and operates it; its way there touches nothing."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import h5py
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import mam_envs
from mam_envs.grasping.candidates import PlacementError
from mam_envs.placement.drive import (
    begin_at,
    carried,
    drive_is_clear,
    in_plane,
    planar,
    way_between,
    wrapped,
)
from mam_envs.robots import robot_spec
from mam_envs.tasks import episode_steps
from mam_pipeline.errors import ConfigError
from mam_policies.collect import collect
from mam_policies.collection import CollectConfig
from mam_policies.expert import Expert, ExpertConfig, run_episode
from mam_policies.expert.drive import Driver

PERIOD = 0.05  # seconds of a control step


@pytest.mark.parametrize("turn", [0.0, 1.0, 3.0])
def test_a_driver_arrives_gently(turn: float) -> None:
    config, stand = ExpertConfig(), planar(0.4, -0.3, 0.5)
    base, driver, before = planar(-0.9, 0.2, turn), Driver(stand, config, PERIOD), np.zeros(2)
    for _ in range(config.longest_drive):
        speeds = driver.speeds(base)
        if speeds is None:
            break
        change = np.abs(np.subtract(speeds, before))
        assert change[0] <= config.drive_ease * PERIOD + 1e-9
        assert change[1] <= config.turn_ease * PERIOD + 1e-9
        assert abs(speeds[0]) <= config.drive_speed and abs(speeds[1]) <= config.turn_speed
        base = base @ planar(speeds[0] * PERIOD, 0.0, speeds[1] * PERIOD)
        before[:] = speeds
    else:
        pytest.fail("it never arrived")
    (x, y, yaw), (to_x, to_y, to_yaw) = in_plane(base), in_plane(stand)
    assert np.hypot(x - to_x, y - to_y) < 0.03 and abs(wrapped(yaw - to_yaw)) < 0.05


def test_the_way_turns_then_goes_straight_then_turns() -> None:
    start, stand = planar(-1.0, 0.0, 0.3), planar(0.0, 1.0, -0.2)
    way = np.array([in_plane(pose) for pose in way_between(start, stand)])
    np.testing.assert_allclose(way[0], (-1.0, 0.0, 0.3), atol=1e-9)
    np.testing.assert_allclose(way[-1], (0.0, 1.0, -0.2), atol=1e-9)
    moved = np.linalg.norm(np.diff(way[:, :2], axis=0), axis=1) > 1e-9
    turned = np.abs(np.diff(way[:, 2])) > 1e-9
    assert not (moved & turned).any()  # one or the other
    assert np.allclose(way[1:][moved, 2], np.pi / 4)


def test_it_begins_away_and_stands_to_a_displaced_object_as_to_the_nominal_one(door: Path) -> None:
    made = mam_envs.make(door, robot_uids="fetch", control_mode="pd_joint_pos")
    env = made.unwrapped
    layout, chance = env.layout(), env.config.randomisation
    for seed in range(3):
        made.reset(seed=seed)
        now = env.planner_state()
        handle = now.world_asset[:3, :3] @ layout.handles[0] + now.world_asset[:3, 3]
        away = float(np.linalg.norm(now.base[:2, 3] - handle[:2]))
        assert chance.away[0] - 0.01 < away < chance.away[1] + 0.01
        stand = layout.stand(now.world_asset)
        relative = np.linalg.inv(now.world_asset) @ stand
        nominal = np.linalg.inv(layout.world_asset) @ layout.placement.base
        np.testing.assert_allclose(relative, nominal, atol=1e-6)
        calm = np.zeros(7)
        assert drive_is_clear(layout.model, now.robot, now.base, stand, now.world_asset, {}, calm)
    through = carried(stand, stand, planar(0.6, 0.0, 0.0))  # behind the door: through the object
    assert not drive_is_clear(layout.model, now.robot, now.base, through, now.world_asset, {}, calm)
    first = now.base
    made.reset(seed=2)
    assert np.array_equal(env.planner_state().base, first)  # the seed decides
    made.close()


def test_a_drive_that_runs_into_the_object_is_refused(door: Path) -> None:
    with pytest.raises(PlacementError, match="on its way to the handle a fetch"):
        made = mam_envs.make(
            door, robot_uids="fetch", control_mode="pd_joint_pos",
            randomisation={"away": (0.2, 0.25), "away_turn": 0.0},
        )  # fmt: skip
        made.reset(seed=0)


def test_shares_of_the_start_reach_both_ends() -> None:
    from mam_envs.config import RandomisationConfig

    chance, robot, stand = RandomisationConfig(), robot_spec("fetch"), planar(-0.6, 0.0, 0.0)
    handle = np.zeros(3)
    near = begin_at(robot, stand, handle, chance, np.array([0.0, 0.5, 0.5]))
    np.testing.assert_allclose(in_plane(near), (-chance.away[0], 0.0, 0.0), atol=1e-9)
    far = begin_at(robot, stand, handle, chance, np.array([1.0, 0.5, 1.0]))
    expected = (-chance.away[1], 0.0, np.deg2rad(chance.away_turn))
    np.testing.assert_allclose(in_plane(far), expected, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["drawer", "door"])
def test_fetch_drives_there_and_opens(kind: str, request: pytest.FixtureRequest) -> None:
    made = mam_envs.make(
        request.getfixturevalue(kind), robot_uids="fetch", control_mode="pd_joint_pos"
    )
    env, expert, good = made.unwrapped, Expert(made), 0
    for seed in (0, 1, 2):
        made.reset(seed=seed)
        expert.reset()
        begun, stood, driven, touched = env.planner_state(), None, 0, 0.0
        for _ in range(episode_steps("open", robot="fetch")):
            action = expert.act()
            if expert.phase == "drive":
                driven += 1
                touched = max(touched, float(env._probe.link_force[0]))
            elif stood is None:
                stood = env.planner_state().base
            *_, info = made.step(action)
            if bool(info["success"][0]):
                break
        assert driven > 20 and touched == 0.0  # nothing was touched, the ground neither
        stand = begun.layout.stand(begun.world_asset)
        assert stood is not None and np.linalg.norm(stood[:2, 3] - stand[:2, 3]) < 0.03
        left = env.planner_state().base
        assert np.linalg.norm(left[:2, 3] - stood[:2, 3]) < 0.03  # stands while the arm works
        good += bool(info["success"][0])
    assert good >= 2
    made.close()


@pytest.mark.slow
def test_fetch_drives_under_changes_of_joints(drawer: Path) -> None:
    made = mam_envs.make(drawer, robot_uids="fetch", control_mode="pd_joint_delta_pos")
    assert made.action_space.shape == (13,)
    assert run_episode(made, Expert(made), seed=0).success
    made.close()


@pytest.mark.slow
@pytest.mark.parametrize("mode", ["pd_joint_pos", "pd_joint_delta_pos"])
def test_gymnasium_accepts_fetch(drawer: Path, mode: str) -> None:
    made = gym.make(mam_envs.NUMPY_ID, asset=drawer, robot_uids="fetch", control_mode=mode)
    check_env(made.unwrapped, skip_render_check=True)
    made.close()


@pytest.mark.slow
def test_demonstrations_hold_the_drive(drawer: Path, tmp_path: Path) -> None:
    settings = CollectConfig(episodes=1, robot="fetch")
    made = collect(drawer, settings, tmp_path / "demos")
    assert made.episodes == 1
    with h5py.File(made.h5) as file:
        actions = np.asarray(file["traj_0/actions"])
    assert actions.shape[1] == 13 and np.abs(actions[:, -2]).max() > 0.3


def test_put_in_is_refused_as_the_cube_lies_in_the_way(tray: Path) -> None:
    with pytest.raises(ConfigError, match="put_in is not for fetch"):
        mam_envs.make(tray, task="put_in", robot_uids="fetch", control_mode="pd_joint_pos")


def test_a_drive_names_joints_of_the_urdf() -> None:
    fetch = robot_spec("fetch")
    assert fetch.drive is not None
    wrong = replace(fetch.drive, held=("torso_lift",))
    with pytest.raises(ConfigError, match=r"drive: no joint named 'torso_lift'"):
        replace(fetch, drive=wrong).check()
