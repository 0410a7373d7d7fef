"""OperateJoint among others' tools: gymnasium's checker, SB3's vectors, ManiSkill's own matrix."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium.utils.env_checker import check_env

import mam_envs
from mam_envs.config import RandomisationConfig
from mam_envs.robots import robot_spec
from mam_envs.robots.so101 import SO101
from mam_envs.scene import vulkan
from mam_envs.scene.looks import Looks
from mam_pipeline.errors import ConfigError, MamSimError
from mam_policies.expert import Expert, run_episode

needs_vulkan = pytest.mark.skipif(not vulkan.vulkan_ok(), reason="no Vulkan device to render with")
SMALL = {"cameras": {"front": {"width": 32, "height": 24}}, "wall": False}
PANDA_MODES = (
    "pd_joint_delta_pos", "pd_joint_pos", "pd_ee_delta_pos", "pd_ee_delta_pose", "pd_ee_pose",
    "pd_joint_target_delta_pos", "pd_ee_target_delta_pos", "pd_ee_target_delta_pose",
    "pd_joint_vel", "pd_joint_pos_vel", "pd_joint_delta_pos_vel",
)  # fmt: skip


def numpy_env(asset: Path, **kwargs: Any) -> Any:
    return gym.make(mam_envs.NUMPY_ID, asset=asset, control_mode="pd_joint_delta_pos", **kwargs)


def test_gymnasium_accepts_the_raw_environment(drawer: Path) -> None:
    made = numpy_env(drawer)
    assert made.unwrapped.spec is not None  # the checker's determinism tests need it
    check_env(made.unwrapped, skip_render_check=True)
    made.close()


def test_one_environment_has_a_time_limit(drawer: Path) -> None:
    made = numpy_env(drawer, max_episode_steps=2)
    obs, info = made.reset(seed=0)
    assert obs.dtype == np.float32 and obs.ndim == 1 and isinstance(info, dict)
    made.step(made.action_space.sample())
    _, reward, terminated, truncated, _ = made.step(made.action_space.sample())
    assert isinstance(reward, float) and truncated is True and terminated is False
    made.close()


def test_the_return_rises_with_success_under_plain_sb3(drawer: Path) -> None:
    from stable_baselines3.common.monitor import Monitor

    from mam_policies.expert import Expert

    made: Any = Monitor(
        gym.make(mam_envs.NUMPY_ID, asset=drawer, control_mode="pd_joint_pos", max_episode_steps=90)
    )
    returns = {}
    for short in (False, True):  # the same motion, but the hand stops just before success
        made.reset(seed=0)
        expert = Expert(made.unwrapped.inner)
        expert.reset()
        action, done = expert.act(), False
        while not done:
            _, _, terminated, truncated, info = made.step(action)
            done = terminated or truncated
            if not (short and info["progress"] > 0.6):
                action = expert.act()
        assert bool(info["is_success"]) is not short
        returns[short] = info["episode"]["r"]
    assert returns[False] > 1.1 * returns[True]
    made.close()


def test_brute_force_ends_an_episode(drawer: Path) -> None:
    made = mam_envs.make(
        drawer, control_mode="pd_joint_pos", success={"part_force": 1.0, "link_force": None}
    )
    made.reset(seed=0)
    expert = Expert(made)
    expert.reset()
    for _ in range(200):
        _, _, terminated, _, info = made.step(expert.act())
        if bool(terminated):
            break
    assert bool(info["fail"]) and not bool(info["success"])
    assert 1.0 < float(info["part_force"]) < 60.0 and float(info["link_force"]) > 1.0
    made.close()


@pytest.mark.parametrize("robot", ["panda", "so100", "fetch"])
def test_what_bears_on_a_finger_is_felt_whole(drawer: Path, robot: str) -> None:
    made = mam_envs.make(drawer, robot_uids=robot)
    made.reset(seed=0)
    base: Any = made.unwrapped
    probe = base._probe
    for name in base.robot_spec.finger_links:
        for push in 3.0 * np.eye(3):
            for _ in range(300):
                base._before_simulation_step()
                base.agent.robot.links_map[name]._objs[0].add_force_torque(push, [0, 0, 0], "force")
                base.scene.step()
            probe.clear()
            probe._feel(torch.ones(1))
            assert np.allclose(probe._felt()[0], push, atol=0.05), (name, push)
    made.close()


@pytest.mark.parametrize("robot", ["panda", "fetch"])
def test_grasp_point_and_tool_are_where_links_carry_them(drawer: Path, robot: str) -> None:
    made = mam_envs.make(drawer, robot_uids=robot)
    made.reset(seed=0)
    base: Any = made.unwrapped
    spec, item = base.robot_spec, base.layout(0)
    base.object.set_qpos(torch.full_like(base.object.get_qpos(), 0.1))
    tip = base.agent.robot.links_map[spec.tip].pose.to_transformation_matrix()[0].numpy()
    tool = base.tool_pose().to_transformation_matrix()[0].numpy()
    assert np.allclose(tool, tip @ spec.chain.tool, atol=1e-6)
    moved = item.model.motion(item.goals[0].joint, np.array([0.1]), {})[0]
    point = (base._world_asset[0] @ moved @ np.append(item.handles[0], 1.0))[:3]
    assert np.allclose(base.handle_position()[0], point, atol=1e-5)
    made.close()


def test_a_pull_by_friction_alone_is_felt(drawer: Path, tmp_path: Path) -> None:
    own = tmp_path / "drawer"
    shutil.copytree(drawer, own)
    card = json.loads((own / "asset.json").read_text())
    card["joints"][0] |= {"friction": 20.0, "friction_range": [20.0, 20.0]}
    (own / "asset.json").write_text(json.dumps(card))
    made = mam_envs.make(own, control_mode="pd_joint_pos", randomisation={"yaw": 0.0})
    made.reset(seed=0)
    expert = Expert(made.unwrapped)
    expert.reset()
    felt = []  # the drawer comes out towards -x and drags the hand towards +x
    for _ in range(200):
        _, _, terminated, _, info = made.step(expert.act())
        state = made.unwrapped.planner_state()
        assert np.linalg.norm(state.force) == pytest.approx(float(info["part_force"]), rel=1e-4)
        if expert.phase == "follow" and 0.05 < state.q < 0.15:
            felt.append(state.force)
        if bool(terminated):
            break
    assert bool(info["success"]) and len(felt) > 5
    pull = np.median(felt, axis=0)
    assert 18.0 < pull[0] < 24.0 and np.abs(pull[1:]).max() < 8.0
    made.close()


def _maker(asset: str) -> Callable[[], Any]:
    def make() -> Any:
        torch.set_num_threads(1)
        import mam_envs as envs

        return gym.make(envs.NUMPY_ID, asset=asset, control_mode="pd_joint_delta_pos")

    return make


def test_sb3_takes_it_without_a_wrapper(drawer: Path) -> None:
    from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

    vector: Any = VecMonitor(DummyVecEnv([_maker(str(drawer))]), info_keywords=("is_success",))
    vector.seed(0)
    assert vector.reset().dtype == np.float32
    _, reward, _, _ = vector.step(np.stack([vector.action_space.sample()]))
    assert np.isfinite(reward).all()
    vector.close()


@pytest.mark.slow
def test_sb3_runs_different_assets_in_different_processes(drawer: Path, door: Path) -> None:
    # slow: every worker imports the simulator
    from stable_baselines3.common.vec_env import SubprocVecEnv

    vector: Any = SubprocVecEnv([_maker(str(drawer)), _maker(str(door))], start_method="forkserver")
    vector.seed(3)
    first = vector.reset()
    assert first.shape[0] == 2 and not np.array_equal(first[0], first[1])
    for _ in range(3):
        obs, reward, _, _ = vector.step(np.zeros((2, *vector.action_space.shape), np.float32))
    assert np.isfinite(obs).all() and np.isfinite(reward).all()
    vector.close()


@pytest.mark.parametrize("mode", PANDA_MODES)
def test_control_modes(drawer: Path, mode: str) -> None:
    made = mam_envs.make(drawer, control_mode=mode)
    made.reset(seed=0)
    made.action_space.seed(0)
    for _ in range(3):
        obs, reward, *_ = made.step(made.action_space.sample())
    assert torch.isfinite(obs).all() and torch.isfinite(reward).all()
    made.close()


@pytest.mark.parametrize("mode", ["none", "sparse", "dense", "normalized_dense"])
def test_reward_modes(drawer: Path, mode: str) -> None:
    made = mam_envs.make(drawer, reward_mode=mode)
    made.reset(seed=0)
    made.action_space.seed(0)
    rewards = torch.stack([made.step(made.action_space.sample())[1] for _ in range(4)])
    assert torch.isfinite(rewards).all()
    if mode in ("none", "sparse"):
        assert (rewards == 0).all()  # nothing was opened
    else:
        assert (rewards > 0).all() and (mode == "dense" or (rewards < 1).all())
    made.close()


@pytest.mark.parametrize("mode", ["state", "state_dict", "none"])
def test_observation_modes_without_pictures(drawer: Path, mode: str) -> None:
    made = mam_envs.make(drawer, obs_mode=mode)
    obs, _ = made.reset(seed=0)
    if mode == "state":
        assert obs.shape == made.observation_space.shape
    elif mode == "state_dict":
        assert set(obs) == {"agent", "extra"} and "privileged" in obs["extra"]
    else:
        assert not obs
    made.close()


@pytest.mark.display
@needs_vulkan
@pytest.mark.parametrize(
    ("mode", "names"),
    [
        ("rgb", {"rgb"}),
        ("depth", {"depth"}),
        ("rgbd", {"rgb", "depth"}),
        ("segmentation", {"segmentation"}),
        ("rgb+depth+segmentation", {"rgb", "depth", "segmentation"}),
    ],
)
def test_camera_modes(drawer: Path, mode: str, names: set[str]) -> None:
    made = mam_envs.make(drawer, obs_mode=mode, scene=SMALL)
    obs, _ = made.reset(seed=0)
    assert set(obs["sensor_data"]["front"]) == names
    for name in names:
        assert obs["sensor_data"]["front"][name].shape[:3] == (1, 24, 32)
    assert "privileged" not in obs["extra"]
    made.close()


@pytest.mark.display
@needs_vulkan
def test_pointcloud(drawer: Path) -> None:
    made = mam_envs.make(drawer, obs_mode="pointcloud", scene=SMALL)
    obs, _ = made.reset(seed=0)
    cloud = obs["pointcloud"]
    assert cloud["xyzw"].shape == (1, 24 * 32, 4) and cloud["rgb"].shape == (1, 24 * 32, 3)
    base = made.unwrapped
    drawer_id = base.targets[0].per_scene_id[0]
    on_part = cloud["xyzw"][0][cloud["segmentation"][0, :, 0] == drawer_id]
    low, high = base.layout().model.bounds()
    # points on the part lie inside the object's box, shifted and turned by the randomisation
    assert len(on_part) > 5
    where = on_part[:, :3].numpy()
    assert (where > low - 0.1).all() and (where < high + 0.1).all()
    assert "privileged" not in obs["extra"]
    made.close()


@pytest.mark.display
@needs_vulkan
def test_gymnasium_takes_the_point_cloud(drawer: Path) -> None:
    made = numpy_env(drawer, obs_mode="pointcloud", scene=SMALL)  # gym.make looks at the spaces
    obs, _ = made.reset(seed=0)
    assert made.observation_space.contains(obs) and "sensor_data" not in obs
    assert obs["pointcloud"]["xyzw"].shape == (24 * 32, 4)
    assert (obs["pointcloud"]["xyzw"][:, 3] == 1).any()  # it shows something
    made.close()


@pytest.mark.display
@needs_vulkan
def test_a_background_changes_the_picture(drawer: Path, tmp_path: Path) -> None:
    import cv2

    picture = tmp_path / "kitchen.png"
    cv2.imwrite(str(picture), np.full((40, 60, 3), (0, 0, 255), np.uint8))
    made = mam_envs.make(drawer, obs_mode="rgb", scene={**SMALL, "background": str(picture)})
    obs, _ = made.reset(seed=0)
    rgb = obs["sensor_data"]["front"]["rgb"][0].numpy()
    red = (rgb == [255, 0, 0]).all(axis=-1)
    assert 0.1 < red.mean() < 0.95  # the world is replaced, robot and object are not
    made.close()

    with pytest.raises(ConfigError, match="background picture"):
        made = mam_envs.make(
            drawer, obs_mode="rgb", scene={**SMALL, "background": str(tmp_path / "none.png")}
        )
        made.reset(seed=0)


def _picture(made: Any, **reset: Any) -> np.ndarray:
    obs, _ = made.reset(**reset)
    return np.asarray(obs["sensor_data"]["front"]["rgb"][0].numpy())


@pytest.mark.display
@needs_vulkan
def test_looks_change_at_every_reset_and_a_seed_repeats_them(drawer: Path) -> None:
    still = {"position": 0.0, "yaw": 0.0, "robot_qpos": 0.0}
    chance = {**still, "colour": 1.0, "camera": 0.05, "noise": 9.0}
    made = mam_envs.make(drawer, obs_mode="rgb", scene=SMALL, randomisation=chance)
    first = _picture(made, seed=1)
    scene = made.unwrapped.scene
    second = _picture(made)
    assert made.unwrapped.scene is scene  # nothing was rebuilt
    assert not np.array_equal(first, second)
    assert np.array_equal(first, _picture(made, seed=1))
    made.close()

    made = mam_envs.make(drawer, obs_mode="rgb", scene=SMALL, randomisation=still)
    made.reset(seed=0)
    base = made.unwrapped
    for one in (
        {"colour": 1.0}, {"light": (0.5, 1.5)}, {"light_colour": 0.5}, {"light_turn": 20.0},
        {"camera": 0.05}, {"camera_turn": 3.0}, {"fov": 5.0}, {"scenery": 1.0}, {"noise": 9.0},
        {"blur": 2.0}, {"backgrounds": 1.0},
    ):  # fmt: skip
        config = RandomisationConfig(**one)
        assert config.seen
        base._looks = Looks(base.scene, base.objects, config)
        seen = []
        for seed in (1, 2, 1):
            base._looks.draw(np.random.RandomState(seed))
            seen.append(base.get_obs()["sensor_data"]["front"]["rgb"][0].numpy())
        assert np.array_equal(seen[0], seen[2]) and not np.array_equal(seen[0], seen[1]), one
    assert not RandomisationConfig().seen
    made.close()


def test_states_are_put_back(drawer: Path) -> None:
    made = mam_envs.make(drawer, control_mode="pd_joint_delta_pos")
    made.reset(seed=0)
    base = made.unwrapped
    made.action_space.seed(0)
    made.step(made.action_space.sample())
    kept, flat = base.get_state_dict(), base.get_state().clone()
    assert set(kept["articulations"]) == {"panda", "object"}
    for _ in range(5):
        made.step(made.action_space.sample())
    assert not torch.allclose(base.get_state(), flat)
    base.set_state(flat)
    torch.testing.assert_close(base.get_state(), flat, atol=1e-5, rtol=1e-5)
    base.set_state_dict(kept)
    torch.testing.assert_close(base.get_state(), flat, atol=1e-5, rtol=1e-5)
    made.close()


def test_two_environments_agree_on_a_seed(drawer: Path) -> None:
    rolls = []
    for _ in range(2):
        made = mam_envs.make(drawer, control_mode="pd_joint_delta_pos")
        obs, _ = made.reset(seed=11)
        made.action_space.seed(11)
        steps = [obs, *(made.step(made.action_space.sample())[0] for _ in range(40))]
        rolls.append(torch.stack(steps))
        made.close()
    assert torch.equal(rolls[0], rolls[1])  # bit for bit


@pytest.mark.parametrize("robot", ["so100", "so101", "panda_wristcam"])
def test_other_robots(drawer: Path, robot: str) -> None:
    made = mam_envs.make(drawer, robot_uids=robot, control_mode="pd_joint_pos")
    made.reset(seed=0)
    base = made.unwrapped
    now = base.planner_state()
    for _ in range(3):
        obs, *_ = made.step(base.robot_spec.action(now.arm, base.robot_spec.opened))
    assert torch.isfinite(obs).all()
    made.close()


@pytest.mark.parametrize("mode", ["pos", "delta_pos", "target_delta_pos"])
def test_the_gripper_goes_where_it_is_told_in_every_control_mode(drawer: Path, mode: str) -> None:
    made = mam_envs.make(drawer, robot_uids="so101", control_mode=f"pd_joint_{mode}")
    made.reset(seed=0)
    base = made.unwrapped
    still = base.planner_state().arm if mode == "pos" else np.zeros(5)
    for command in (base.robot_spec.opened, base.robot_spec.shut):
        for _ in range(20):
            made.step(base.robot_spec.action(still, command))
        at = float(base.agent.robot.get_qpos()[0, -1])
        assert abs(at - command) < 0.02
    made.close()


def test_a_small_arm_opens_a_drawer_by_changes_of_its_joints(drawer: Path) -> None:
    made = mam_envs.make(drawer, robot_uids="so101", control_mode="pd_joint_delta_pos")
    assert run_episode(made, Expert(made), seed=0).success
    made.close()


def test_an_arm_whose_package_is_missing_says_what_to_install() -> None:
    with pytest.raises(ConfigError, match=r"no-such-package, not installed; pip install 'mam-sim"):
        _ = replace(SO101, package="no-such-package").path


def test_fetch_stands_on_the_floor(door: Path) -> None:
    try:
        made = mam_envs.make(door, robot_uids="fetch", control_mode="pd_joint_pos")
    except MamSimError as error:
        pytest.fail(f"fetch refuses a door of 0.4 m: {error}")
    made.reset(seed=0)
    assert made.unwrapped.layout().placement.base_height == 0.0
    made.close()


def test_robots_that_are_not_bundled_say_how_to_get_them() -> None:
    try:
        spec = robot_spec("xarm6")
    except ConfigError as error:
        assert "mani_skill.utils.download_asset xarm6_robotiq" in str(error)
    else:
        assert spec.path.is_file()
    mine = replace(SO101, uid="mine", package="", urdf="mine/arm.urdf")
    with pytest.raises(
        ConfigError, match=r"'mine' is not installed; .* at .*robots.mine.arm\.urdf"
    ):
        _ = mine.path


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"arm": ("panda_joint1", "panda_joint9")}, "arm: no joint named 'panda_joint9'; did you"),
        ({"tip": "panda_hand_tpc"}, "tip: no link named 'panda_hand_tpc'; did you mean"),
        ({"arm": ("panda_finger_joint1",)}, "arm: joint 'panda_finger_joint1' does not move"),
        ({"rest": {"panda_joint2": -4.0}}, "rest: joint 'panda_joint1' needs a value in -2.897"),
        ({"tool_closing": (0, 1, 1)}, "unit vectors at a right angle"),
        ({"urdf": "none/none.urdf"}, "is not installed"),
    ],
)
def test_a_wrong_robot_specification_is_named(change: dict[str, Any], reason: str) -> None:
    with pytest.raises(ConfigError, match=reason):
        replace(robot_spec("panda"), **change).check()
