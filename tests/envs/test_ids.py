"""An asset bound to an id is taken by code that knows nothing of mam-sim, in any process."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import mam_envs
from mam_envs import ids
from mam_pipeline.errors import ConfigError
from mam_sim.cli import main
from tests.envs.box_assets import write_asset


@pytest.fixture(autouse=True)
def _own_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A file of ids of its own, and a registry that is left as it was."""
    monkeypatch.setenv(ids.VARIABLE, str(tmp_path / "ids.json"))
    before = dict(gym.registry)
    yield
    gym.registry.clear()
    gym.registry.update(before)


PPO = """
import sys
import gymnasium as gym
import torch
import mani_skill.envs
from mani_skill.utils import gym_utils
from mani_skill.utils.wrappers.flatten import FlattenActionSpaceWrapper
from mani_skill.vector.wrappers.gymnasium import ManiSkillVectorEnv

env_kwargs = dict(obs_mode="state", control_mode="pd_joint_delta_pos", sim_backend="physx_cpu")
envs = gym.make(sys.argv[1], num_envs=1, reconfiguration_freq=None, **env_kwargs)
if isinstance(envs.action_space, gym.spaces.Dict):
    envs = FlattenActionSpaceWrapper(envs)
envs = ManiSkillVectorEnv(envs, 1, ignore_terminations=False, record_metrics=True)
assert isinstance(envs.single_action_space, gym.spaces.Box)
assert gym_utils.find_max_episode_steps_value(envs._env) == 7
obs, _ = envs.reset(seed=1)
space = envs.single_action_space
low, high = torch.from_numpy(space.low), torch.from_numpy(space.high)
assert (low == -1).all() and (high == 1).all()
for _ in range(7):
    obs, reward, terminations, truncations, infos = envs.step(torch.zeros(1, *low.shape))
assert truncations.all() and infos["_final_info"].all()
assert infos["final_info"]["episode"]["episode_len"].item() == 7
assert infos["final_observation"].shape == obs.shape == (1, *envs.single_observation_space.shape)
"""
"""What ManiSkill's examples/baselines/ppo/ppo.py does with its --env-id; the script is not in the
package. It asks for physx_cuda; here it is the CPU and one environment, without pictures."""


def test_maniskills_ppo_takes_a_registered_asset_by_its_id(
    drawer: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["register", str(drawer), "--id", "Drawer-v1", "--max-steps", "7", "--json"]
    assert main(words) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["id"] == "mam_envs:Drawer-v1" and told["assets"] == [str(drawer)]
    script = tmp_path / "ppo.py"
    script.write_text(PPO)
    ran = subprocess.run([sys.executable, script, told["id"]], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr[-2000:]


def test_sb3_and_gymnasiums_vectors_take_the_numpy_twin(drawer: Path) -> None:
    from stable_baselines3.common.env_util import make_vec_env

    name = mam_envs.register(drawer, id="Drawer-v1", control_mode="pd_joint_delta_pos")
    assert name == "mam_envs:Drawer-v1"
    vector = make_vec_env("mam_envs:DrawerNumpy-v1", n_envs=2, env_kwargs={"render_mode": None})
    assert np.asarray(vector.reset()).dtype == np.float32
    _, rewards, _, _ = vector.step(np.zeros((2, *(vector.action_space.shape or ())), np.float32))
    assert rewards.shape == (2,) and np.isfinite(rewards).all()
    vector.close()
    made = gym.make_vec("mam_envs:DrawerNumpy-v1", num_envs=2, vectorization_mode="sync")
    obs, _ = made.reset(seed=3)
    assert obs.shape[0] == 2 and not np.array_equal(obs[0], obs[1])
    made.close()


def test_of_a_folder_one_is_drawn_for_every_episode(tmp_path: Path) -> None:
    folder = tmp_path / "assets"
    for kind in ("drawer", "door"):
        write_asset(folder / kind, kind)
    mam_envs.register(folder, id="Furniture-v1")
    made: Any = gym.make("Furniture-v1", reconfiguration_freq=None)  # as ppo.py passes it
    seen = set()
    for seed in range(8):
        made.reset(seed=seed)
        seen.add(made.unwrapped.layout().model.asset.folder.name)
    assert seen == {"drawer", "door"}
    made.close()


def test_an_id_is_a_name_and_a_version_that_is_not_ours(
    drawer: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for wrong in ("Drawer", "drawer v1", "a/b-v1", "OperateJoint-v1", "OperateJointNumpy-v2"):
        with pytest.raises(ConfigError, match="id"):
            mam_envs.register(drawer, id=wrong)
        assert main(["register", str(drawer), "--id", wrong]) == 2
    assert "as Nightstand-v1" in capsys.readouterr().err
    assert not ids._file().exists()


def test_a_file_of_ids_that_cannot_be_read_is_a_warning(tmp_path: Path) -> None:
    ids.remember("Drawer-v1", {"asset": "nowhere"}, 50)
    ids.bind_remembered()
    assert gym.spec("Drawer-v1").kwargs == {"asset": "nowhere"}
    assert gym.spec("DrawerNumpy-v1").max_episode_steps == 50
    for wrong in ("no", "[]", '{"Drawer-v1": 3}', '{"OperateJoint-v1": {}}'):
        ids._file().write_text(wrong)
        with pytest.warns(UserWarning, match="is no file of environment ids"):
            ids.bind_remembered()
        with pytest.raises(ConfigError, match="delete it"):
            ids.remember("Door-v1", {}, 50)


@pytest.mark.parametrize(
    ("arguments", "steps"),
    [({}, 200), ({"task": "put_in"}, 400), ({"joint": ["a", "b"]}, 400)],
)
def test_an_episode_is_as_long_as_its_task_needs(
    drawer: Path, arguments: dict[str, Any], steps: int
) -> None:
    mam_envs.register(drawer, id="Timed-v1", **arguments)
    assert gym.spec("Timed-v1").max_episode_steps == steps
    mam_envs.register(drawer, id="Timed-v1", max_episode_steps=7, **arguments)
    assert gym.spec("Timed-v1").max_episode_steps == 7
