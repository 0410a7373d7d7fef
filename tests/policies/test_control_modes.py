"""Demonstrations in ManiSkill's relative control modes, as its baselines read and replay them."""

from __future__ import annotations

import json
from pathlib import Path

import gymnasium as gym
import h5py
import numpy as np
import pytest

from mam_pipeline.errors import ConfigError
from mam_policies.collect import collect
from mam_policies.collection import CollectConfig


@pytest.mark.parametrize("mode", ["pd_joint_delta_pos", "pd_ee_delta_pose"])
def test_actions_lie_in_plus_minus_one_and_repeat_the_episode(
    drawer: Path, tmp_path: Path, mode: str
) -> None:
    made = collect(drawer, CollectConfig(episodes=1, control_mode=mode), tmp_path / "demos")
    listing = json.loads((tmp_path / "demos" / "demos.json").read_text())
    info, episode = listing["env_info"], listing["episodes"][0]
    assert info["env_kwargs"]["control_mode"] == episode["control_mode"] == mode
    with h5py.File(made.h5) as file:
        actions, obs = file["traj_0/actions"][:], file["traj_0/obs"][:]
    assert np.abs(actions).max() <= 1.0 and len(obs) == len(actions) + 1
    # as mani_skill.trajectory.replay_trajectory does
    env = gym.make(
        info["env_id"], max_episode_steps=info["max_episode_steps"], **info["env_kwargs"]
    )
    space = env.unwrapped.get_wrapper_attr("single_action_space")
    assert (space.low == -1).all() and (space.high == 1).all()
    env.reset(**episode["reset_kwargs"])
    won = [bool(env.step(action)[4]["success"][0]) for action in actions]
    assert any(won)
    env.close()


def test_a_mode_that_the_expert_or_the_arm_has_not_is_named(drawer: Path, tmp_path: Path) -> None:
    for robot, mode in (("panda", "pd_joint_vel"), ("so101", "pd_ee_delta_pose")):
        config = CollectConfig(episodes=1, robot=robot, control_mode=mode)
        with pytest.raises(ConfigError, match=mode):
            collect(drawer, config, tmp_path / robot)
        assert not (tmp_path / robot).exists()
