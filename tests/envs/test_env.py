"""OperateJoint-v1: resets, idle steps, success by contact only, seeding, gymnasium's rules."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium.utils import RecordConstructorArgs
from gymnasium.utils.env_checker import check_env
from mani_skill.utils.wrappers.gymnasium import CPUGymWrapper
from sapien.wrapper.urdf_loader import URDFLoader

import mam_envs
from mam_envs.grasping.candidates import PlacementError
from mam_envs.scene import vulkan
from mam_pipeline.errors import BackendError, ConfigError, InputError


@pytest.fixture(scope="module")
def env(drawer: Path) -> Iterator[Any]:
    made = gym.make(mam_envs.ENV_ID, asset=drawer, control_mode="pd_joint_pos", reward_mode="dense")
    yield made
    made.close()


def hold(env: Any) -> np.ndarray:
    """The action that keeps the arm where it is."""
    base = env.unwrapped
    return base.robot_spec.action(base.planner_state().arm, base.robot_spec.opened)


def test_reset_is_sane_and_idle_steps_move_nothing(env: Any) -> None:
    for seed in range(3):
        _, info = env.reset(seed=seed)
        base = env.unwrapped
        assert not bool(info["success"][0]) and float(info["open_fraction"][0]) == 0.0
        assert float(base.agent.robot.get_qvel().abs().max()) == 0.0
        action = hold(env)
        for _ in range(20):
            _, _, _, _, info = env.step(action)
        assert abs(float(info["open_fraction"][0])) < 0.01
        assert float(info["contact_force"][0]) == 0.0


def test_the_state_vector_is_described(env: Any) -> None:
    obs, _ = env.reset(seed=0)
    layout = env.unwrapped.observation_layout()
    assert layout[-1][2] == obs.shape[1]
    start, stop = next(r[1:3] for r in layout if r[0].endswith("handle_position"))
    want = env.unwrapped.handle_position()[0]
    torch.testing.assert_close(obs[0, start:stop], want)
    hidden = [r[3] for r in layout]
    assert hidden == sorted(hidden)  # privileged entries come last


def test_what_opens_by_itself_is_no_success(env: Any) -> None:
    env.reset(seed=0)
    base = env.unwrapped
    action = hold(env)
    q = base.object.get_qpos()
    for value in np.linspace(0.02, 0.24, 12):
        base.object.set_qpos(torch.full_like(q, float(value)))
        base.object.set_qvel(torch.zeros_like(q))
        _, _, _, _, info = env.step(action)
    assert float(info["progress"][0]) > 1.0
    assert not bool(info["by_contact"][0]) and not bool(info["success"][0])
    assert float(info["reward/untouched_motion"][0]) < 0


def test_reward_is_the_sum_of_its_named_terms(env: Any) -> None:
    env.reset(seed=0)
    env.action_space.seed(0)
    for _ in range(5):
        _, reward, _, _, info = env.step(env.action_space.sample())
        terms = sum(v for k, v in info.items() if k.startswith("reward/"))
        torch.testing.assert_close(reward, terms)


def test_same_seed_same_trajectory(env: Any) -> None:
    def roll() -> list[torch.Tensor]:
        obs, _ = env.reset(seed=7)
        env.action_space.seed(7)
        return [obs, *(env.step(env.action_space.sample())[0] for _ in range(30))]

    first, second = roll(), roll()
    for a, b in zip(first, second):
        assert torch.equal(a, b)
    other, _ = env.reset(seed=8)
    assert not torch.equal(first[0], other)


def test_randomised_dynamics_reach_the_simulator(drawer: Path) -> None:
    made = mam_envs.make(
        drawer, randomisation={"mass": [2.0, 2.0], "friction": [3.0, 3.0], "start": [0.1, 0.3]}
    )
    _, info = made.reset(seed=0)
    base = made.unwrapped
    part = base.objects[0].links_map["part_1"]._objs[0]
    assert part.mass == pytest.approx(2.0)
    assert base.objects[0].active_joints[0]._objs[0].force_limit == pytest.approx(0.3)
    assert 0.1 <= float(info["open_fraction"][0]) <= 0.3
    made.close()


def test_an_asset_says_between_what_its_friction_and_masses_are_drawn(
    drawer: Path, tmp_path: Path
) -> None:
    own = tmp_path / "drawer"
    shutil.copytree(drawer, own)
    card = json.loads((own / "asset.json").read_text())
    card["joints"][0]["friction_range"] = [0.2, 0.8]
    moved = next(p for p in card["parts"] if p["link"] == "part_1")
    moved |= {"mass": 1.0, "mass_range": [2.0, 4.0]}
    (own / "asset.json").write_text(json.dumps(card))
    made = mam_envs.make(own, randomisation={"spread": True, "friction": [2.0, 2.0]})
    limits, masses = [], []
    for seed in range(6):
        made.reset(seed=seed)
        thing = made.unwrapped.objects[0]
        limits.append(float(thing.active_joints[0]._objs[0].force_limit))
        masses.append(float(thing.links_map["part_1"]._objs[0].mass))
    assert all(0.4 <= f <= 1.6 for f in limits) and all(2.0 <= m <= 4.0 for m in masses)
    assert len({round(f, 6) for f in limits}) == len({round(m, 6) for m in masses}) == 6
    made.close()


def test_a_catch_holds_up_to_its_force_and_pulls_what_is_ajar_closed(
    drawer: Path, tmp_path: Path
) -> None:
    own = tmp_path / "drawer"
    shutil.copytree(drawer, own)
    card = json.loads((own / "asset.json").read_text())
    card["joints"][0]["catch"] = {"force": 8.0, "width": 0.02}
    (own / "asset.json").write_text(json.dumps(card))
    made = mam_envs.make(own)
    base = made.unwrapped
    ends = {}
    for start, push in ((0.0, 7.0), (0.0, 9.0), (0.01, 0.0), (0.05, 0.0)):
        made.reset(seed=0)
        base.object.set_qpos(torch.full_like(base.object.get_qpos(), start))
        link = base.targets[0]._objs[0]
        for _ in range(100):
            base._before_simulation_step()
            link.add_force_torque([-push, 0, 0], [0, 0, 0], "force")
            base.scene.step()
        ends[start, push] = float(base.object.get_qpos()[0, 0])
    made.close()
    assert abs(ends[0.0, 7.0]) < 1e-3 < 0.1 < ends[0.0, 9.0]
    assert abs(ends[0.01, 0.0]) < 1e-3 and ends[0.05, 0.0] == pytest.approx(0.05, abs=1e-3)


def test_what_springs_carry_weighs_nothing_and_only_rubs(drawer: Path, tmp_path: Path) -> None:
    own = tmp_path / "drawer"
    shutil.copytree(drawer, own)
    card = json.loads((own / "asset.json").read_text())
    joint = card["joints"][0]
    joint |= {"friction": 9.0, "friction_range": [8.0, 12.0], "balance": {"friction": 6.0}}
    (own / "asset.json").write_text(json.dumps(card))
    made = mam_envs.make(own)
    made.reset(seed=0)
    links, joints = made.unwrapped.objects[0].links_map, made.unwrapped.objects[0].joints_map
    assert links[joint["child"]]._objs[0].disable_gravity
    assert not links[joint["parent"]]._objs[0].disable_gravity
    low, high = made.unwrapped.config.randomisation.friction
    limit = joints[joint["name"]]._objs[0].force_limit
    assert 3.0 * low - 1e-3 <= limit <= 3.0 * high + 1e-3
    made.close()


def test_a_part_feels_as_its_asset_says(drawer: Path, tmp_path: Path) -> None:
    own = tmp_path / "drawer"
    shutil.copytree(drawer, own)
    card = json.loads((own / "asset.json").read_text())
    part = next(p for p in card["parts"] if p["link"] == "part_1")
    part |= {"friction": 0.7, "restitution": 0.1}
    (own / "asset.json").write_text(json.dumps(card))
    made = mam_envs.make(own)
    made.reset(seed=0)
    links = made.unwrapped.objects[0].links_map
    for name, friction, restitution in (("part_1", 0.7, 0.1), ("base", 0.4, 0.3)):
        for shape in links[name]._objs[0].collision_shapes:
            material = shape.physical_material
            assert material.static_friction == pytest.approx(friction)
            assert material.dynamic_friction == pytest.approx(friction)
            assert material.restitution == pytest.approx(restitution)
    made.close()


class Recorded(CPUGymWrapper, RecordConstructorArgs):
    """CPUGymWrapper with what it lacks: arguments that gymnasium can make it from again."""

    def __init__(self, env: Any) -> None:
        RecordConstructorArgs.__init__(self)
        CPUGymWrapper.__init__(self, env)


def test_gymnasium_and_sb3_accept_it(drawer: Path) -> None:
    from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

    made = Recorded(mam_envs.make(drawer, control_mode="pd_joint_delta_pos"))
    check_env(made, skip_render_check=True)
    vector = VecMonitor(DummyVecEnv([lambda: made]), info_keywords=("success",))
    vector.reset()
    for _ in range(3):
        obs, reward, _, _ = vector.step(np.stack([vector.action_space.sample()]))
    assert np.asarray(obs).dtype == np.float32 and np.isfinite(reward).all()
    vector.close()


def test_what_gymnasium_refuses_is_in_maniskill(drawer: Path) -> None:
    """CPUGymWrapper cannot be made again, around any environment; PickCube does not get so far."""
    ours = CPUGymWrapper(mam_envs.make(drawer, control_mode="pd_joint_delta_pos"))
    check_env(ours, skip_render_check=True, skip_close_check=True)
    theirs = CPUGymWrapper(gym.make("PickCube-v1", obs_mode="state"))
    with pytest.raises(AssertionError, match="random number generator"):
        check_env(theirs, skip_render_check=True, skip_close_check=True)
    assert ours.spec and theirs.spec
    with pytest.raises(ValueError, match=r"^CPUGymWrapper wrapper .*cannot be recreated"):
        ours.spec.make()
    with pytest.raises(ValueError, match=r"^TimeLimitWrapper wrapper .*cannot be recreated"):
        theirs.spec.make()
    ours.close()
    theirs.close()


@pytest.mark.parametrize("limit", [None, 2])
def test_an_environment_is_made_again_from_its_spec(drawer: Path, limit: int | None) -> None:
    first = mam_envs.make(drawer, max_episode_steps=limit)
    again: Any = gym.make(first.spec)
    expected = limit or mam_envs.MAX_EPISODE_STEPS
    assert again.get_wrapper_attr("_max_episode_steps") == expected
    assert again.spec == first.spec and again.spec.kwargs["asset"] == drawer
    first.close()
    again.close()


def test_make_vec_and_time_limit(drawer: Path) -> None:
    vector = gym.make_vec(mam_envs.VECTOR_ID, num_envs=1, asset=drawer, max_episode_steps=3)
    vector.reset(seed=0)
    for _ in range(3):
        _, _, _, truncated, _ = vector.step(np.zeros(vector.action_space.shape, np.float32))
    assert bool(np.asarray(truncated).all())
    vector.close()


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a GPU for it")
def test_several_environments_want_a_gpu_or_processes(drawer: Path) -> None:
    with pytest.raises(BackendError, match=r"needs CUDA.*vectorization_mode"):
        mam_envs.make(drawer, num_envs=2)
    many = gym.make_vec(
        mam_envs.NUMPY_ID, num_envs=2, vectorization_mode="async", asset=str(drawer)
    )
    obs, _ = many.reset(seed=0)
    assert obs.shape[0] == 2 and not np.array_equal(obs[0], obs[1])
    obs, reward, *_ = many.step(np.zeros(many.action_space.shape, np.float32))
    assert reward.shape == (2,)
    many.close()


def test_episodes_are_recorded(drawer: Path, tmp_path: Path) -> None:
    import h5py
    from mani_skill.utils.wrappers.record import RecordEpisode

    made = RecordEpisode(
        mam_envs.make(drawer, control_mode="pd_joint_delta_pos"),
        str(tmp_path), save_video=False, source_type="test", source_desc="test",
    )  # fmt: skip
    made.reset(seed=0)
    for _ in range(4):
        made.step(made.action_space.sample())
    made.close()
    file = next(tmp_path.glob("*.h5"))
    with h5py.File(file) as data:
        assert data["traj_0/actions"].shape[0] == 4


def test_several_assets_take_turns(drawer: Path, door: Path) -> None:
    made = mam_envs.make([drawer, door])
    seen = set()
    for seed in range(6):
        made.reset(seed=seed)
        seen.add(made.unwrapped.layout().model.asset.card.name)
    assert seen == {"box_drawer", "box_door"}
    made.close()


def test_errors_say_what_to_do(drawer: Path, tmp_path: Path, monkeypatch: Any) -> None:
    with pytest.raises(InputError, match=r"no asset\.json"):
        mam_envs.make(tmp_path)
    with pytest.raises(ConfigError, match="did you mean 'joint_1'"):
        mam_envs.make(drawer, joint="joint_9")
    with pytest.raises(PlacementError, match=r"reach|stand"):
        mam_envs.make(drawer, scale=5.0)
    # what `prepare` then changes in SAPIEN's loader is put back after the test
    monkeypatch.setattr(URDFLoader, "_build_link", URDFLoader._build_link)
    monkeypatch.setattr(URDFLoader, "_mam_visual_free", False, raising=False)
    monkeypatch.setattr(vulkan, "vulkan_ok", lambda: False)
    with pytest.raises(BackendError, match="no Vulkan device"):
        mam_envs.make(drawer, obs_mode="rgb")


@pytest.mark.display
@pytest.mark.skipif(not vulkan.vulkan_ok(), reason="no Vulkan device to render with")
def test_cameras_see_the_scene(drawer: Path) -> None:
    made = mam_envs.make(
        drawer, obs_mode="rgb+depth+segmentation",
        scene={"cameras": {"front": {"width": 64, "height": 48}}, "wall": False},
    )  # fmt: skip
    obs, _ = made.reset(seed=0)
    data = obs["sensor_data"]["front"]
    assert data["rgb"].shape == (1, 48, 64, 3) and float(data["rgb"].float().std()) > 5
    assert len(torch.unique(data["segmentation"])) > 3
    assert "privileged" not in obs["extra"]
    made.close()
