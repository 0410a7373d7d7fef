"""Stock LeRobot, offline, on our exports: reload, train, evaluate, record, replay, same actions."""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
import torch

os.environ["HF_HUB_OFFLINE"] = "1"  # before LeRobot is imported
pytest.importorskip("lerobot_policy_mam_sim", reason="scripts/setup.sh installs the plug-ins")
pytest.importorskip("lerobot_robot_mam_sim", reason="scripts/setup.sh installs the plug-ins")

from mam_policies.lerobot.export_readme import rolls_out
from mam_sim.cli import main as mam_sim
from tests.policies.lerobot_commands import run_readme

pytestmark = pytest.mark.slow  # each starts the simulator or LeRobot's training

SEED = 50_000_017


def _load(folder: Path):  # type: ignore[no-untyped-def]
    """Policy and processors, as lerobot-record loads them."""
    from lerobot.configs.policies import PreTrainedConfig
    from lerobot.policies.factory import get_policy_class, make_pre_post_processors

    config = PreTrainedConfig.from_pretrained(folder)
    policy = get_policy_class(config.type).from_pretrained(folder, config=config)
    return policy, *make_pre_post_processors(config, str(folder))


def test_stock_runtime_sends_our_actions(run_folder: Path, exported: Path, drawer: Path) -> None:
    """LeRobot's predict_action on motor values against our Actor on the simulator's observation."""
    try:
        from lerobot.common.control_utils import predict_action
    except ImportError:  # LeRobot 0.4
        from lerobot.utils.control_utils import predict_action

    from mam_policies.lerobot.robot_interface import RobotInterface
    from mam_policies.mlp import MlpActor, MlpPolicy
    from mam_policies.run import EnvChoice, flat

    policy, before, after = _load(exported)
    actor = MlpActor(MlpPolicy.load(run_folder))
    interface = RobotInterface(EnvChoice((str(drawer),), max_steps=120))
    low, high = interface.spec.grip
    state = interface.reset(SEED)
    policy.reset()
    for _ in range(70):
        ours = actor.act(flat(interface.env.unwrapped.get_obs())).astype(float)
        ours[-1] = low + (np.clip(ours[-1], -1, 1) + 1) / 2 * (high - low)  # metres
        theirs = predict_action(
            {"observation.state": state}, policy, torch.device("cpu"), before, after, False
        )[0].numpy()
        assert np.abs(theirs - ours).max() < 2e-4  # radians and metres
        state = interface.step(theirs)
        if interface.outcome.success:
            break
    interface.close()


def test_units_of_the_mapping_reach_the_motors(exported: Path) -> None:
    """The same policy for an arm that counts backwards in degrees from another zero."""
    from mam_policies.lerobot.policy import PERCEIVED, Converter

    policy, *_ = _load(exported)
    plan = policy.config.plan
    state = np.array([[*np.linspace(-0.4, 0.4, len(plan.joints)), 0.6, 0, 0.3, 0.0, 0.0]])
    expected = policy.converter.act(state)[0]
    scale, offset = -np.pi / 180, 0.3
    for i in plan.arm:
        plan.scale[i], plan.offset[i] = scale, offset
    other = state.copy()
    other[:, plan.arm] = (state[:, plan.arm] - offset) / scale
    got = Converter(plan, policy.net).act(other)[0]
    assert np.allclose(got[:-1] * scale + offset, expected[:-1], atol=1e-5)
    assert np.isclose(got[-1], expected[-1], atol=1e-6) and len(PERCEIVED) == 5


def test_changes_of_targets_become_absolute_targets(drawer: Path) -> None:
    """A policy of reinforcement learning: the targets sent are those of the simulator's drives."""
    from mam_policies.lerobot.export import deployment
    from mam_policies.lerobot.policy import PERCEIVED, Converter
    from mam_policies.lerobot.robot_interface import mapping_of
    from mam_policies.mlp import MlpActor, MlpPolicy
    from mam_policies.run import EnvChoice, RunInfo, describe_env, flat

    choice = EnvChoice((str(drawer),), control_mode="pd_joint_target_delta_pos")
    env = choice.make()
    sizes = describe_env(env)
    width = sizes["observation"][-1][2]
    torch.manual_seed(1)
    policy = MlpPolicy(
        width, 8, 7, hidden=(8,), timed=False, relative=False, squash="clip",
        inputs=(*range(9), *range(18, 25)),  # positions, targets
    )  # fmt: skip
    info = RunInfo("ppo", choice, **sizes)
    base = env.unwrapped
    converter = Converter(deployment(base, info, mapping_of(base, None)), policy)
    actor = MlpActor(policy)
    obs, _ = env.reset(seed=3)
    for _ in range(15):
        q = flat(obs)[:9]
        target = converter.act(np.concatenate([q, np.zeros(len(PERCEIVED))])[None])[0]
        obs, *_ = env.step(actor.act(obs))
        drives = base.agent.controller.controllers
        assert np.allclose(target[:-1], flat(drives["arm"]._target_qpos), atol=1e-5)
        assert np.isclose(target[-1], flat(drives["gripper"]._target_qpos)[0], atol=1e-6)
    env.close()


def test_so100_speaks_degrees_and_percent(drawer: Path) -> None:
    from mam_policies.lerobot.joint_mapping import JointMapping, MotorMap
    from mam_policies.lerobot.robot_interface import RobotInterface
    from mam_policies.run import EnvChoice

    arm = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")
    motors = [MotorMap(n, n, "degrees", -np.pi / 180, 0.1) for n in arm]
    motors.append(MotorMap("gripper", "gripper", "percent", 0.02, -1.1))
    mapping = JointMapping("so101_follower", tuple(motors))
    interface = RobotInterface(EnvChoice((str(drawer),), robot="so100"), mapping)
    state = interface.reset(0)
    assert interface.state_names[:6] == [f"{n}.pos" for n in (*arm, "gripper")]
    goal = state[:6] + np.array([5.0, 0, 0, 0, 0, 10.0])
    for _ in range(12):
        state = interface.step(goal)
    interface.close()
    assert np.allclose(state[:5], goal[:5], atol=0.5)  # degrees
    assert np.isclose(state[5], goal[5], atol=2.0)  # percent


def test_missing_perception_is_explained(exported: Path) -> None:
    policy, *_ = _load(exported)
    motors = len(policy.config.plan.joints)
    with pytest.raises(ValueError, match=r"handle_x\.pos.*--policy\.fixed"):
        policy.select_action({"observation.state": torch.zeros(1, motors)})
    names = policy.config.state_names[motors:]
    policy.config.fixed = dict.fromkeys(names, 0.1)
    assert policy.select_action({"observation.state": torch.zeros(1, motors)}).shape == (1, 8)


def test_a_folder_with_older_names_of_what_is_perceived_still_acts(
    exported: Path, tmp_path: Path
) -> None:
    """The state is read by order, and --policy.fixed by the names that the folder itself has."""
    shutil.copytree(exported, tmp_path / "older")
    file = tmp_path / "older" / "config.json"
    config = json.loads(file.read_text())
    older = ["handle.x", "handle.y", "handle.z", "joint.value", "touch"]
    config["state_names"][-5:] = older
    config["fixed"] = dict.fromkeys(older, 0.1)
    file.write_text(json.dumps(config))
    (policy, *_), (now, *_) = _load(file.parent), _load(exported)
    state = torch.full((1, len(config["state_names"])), 0.1)
    expected = now.select_action({"observation.state": state})
    for seen in (state, state[:, :-5]):
        policy.reset()
        assert torch.equal(policy.select_action({"observation.state": seen}), expected)


def test_readme_commands_have_only_settings_that_exist(exported: Path) -> None:
    from lerobot_policy_mam_sim import MamSimEnvConfig
    from lerobot_robot_mam_sim import MamSimRobotConfig

    text = (exported / "README.md").read_text()
    for group, config in (("robot", MamSimRobotConfig), ("env", MamSimEnvConfig)):
        used = set(re.findall(rf"--{group}\.(\w+)", text))
        known = {f.name for f in fields(config)} | {"type", "discover_packages_path"}
        assert {"type", "asset"} < used <= known
    example = re.search(r"--policy\.fixed='(.*?)'", text)
    states = json.loads((exported / "config.json").read_text())["state_names"]
    assert example and set(json.loads(example[1])) < set(states)
    assert "`touch.pos`" in text and "not used" in text  # the policy sees positions only


FAULTS = (
    "--robot.latency_steps=1", "--robot.joint_noise=0.001", "--robot.handle_noise=0.002",
    "--robot.calibration_error=0.002", "--robot.max_relative_target=0.3",
)  # fmt: skip


def test_readmes_policy_runs_headless_and_the_data_reload(
    exported: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By lerobot-rollout or lerobot-record, whichever runs policies in the installed LeRobot."""
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    verb, count = ("rollout", 2) if rolls_out() else ("record", 1)
    short = (f"--dataset.num_episodes={count}", "--dataset.episode_time_s=4")
    run_readme(monkeypatch, exported, verb, tmp_path, f"--robot.seed={SEED}", *FAULTS, *short)
    episodes = [json.loads(row) for row in (tmp_path / "episodes.jsonl").read_text().splitlines()]
    assert [e["seed"] for e in episodes] == [SEED, SEED + 1][:count]
    assert all(e["steps"] > 3 for e in episodes)
    data = LeRobotDataset("local/recorded", root=tmp_path / "recorded")
    assert data.num_episodes == count and data.fps == 20
    names = data.features["observation.state"]["names"]
    assert names[0] == "panda_joint1.pos" and names[-1] == "touch.pos"


def test_what_is_perceived_follows_from_what_the_simulator_knows(
    exported: Path, drawer: Path
) -> None:
    """lerobot-eval gives motors and environment_state, in which handle, value and touch are."""
    from lerobot_policy_mam_sim.environment import MamSimGym

    from mam_policies.lerobot.policy import PERCEIVED, perceived_in

    policy, *_ = _load(exported)
    made = MamSimGym(str(drawer))
    seen, _ = made.reset(seed=SEED)
    whole = made.interface.state()
    assert np.array_equal(seen["agent_pos"], whole[: -len(PERCEIVED)])
    hidden = seen["environment_state"][None]
    found = perceived_in(policy.config.plan, hidden)[0]
    assert np.allclose(found, whole[-len(PERCEIVED) :], atol=1e-5)
    named = {f"observation.{k}": torch.from_numpy(seen[v][None]) for k, v in
             (("state", "agent_pos"), ("environment_state", "environment_state"))}  # fmt: skip
    policy.reset()
    given = policy.select_action(named)
    policy.reset()
    told = policy.select_action({"observation.state": torch.from_numpy(whole[None])})
    assert torch.allclose(given, told, atol=1e-5)
    with pytest.raises(ValueError, match="has 3 entries; in training it had 12"):
        perceived_in(policy.config.plan, hidden[:, :3])
    made.close()


def test_eval_runs_our_environment(
    exported: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    run_readme(
        monkeypatch, exported, "eval", tmp_path, "--env.episode_length=90",
        "--eval.n_episodes=1", "--output_dir=eval", f"--seed={SEED}",
    )  # fmt: skip
    found = json.loads((tmp_path / "eval" / "eval_info.json").read_text())
    assert found["overall"]["n_episodes"] == 1 and found["overall"]["avg_sum_reward"] > 0


def test_replay_of_the_best_trajectory(
    run_folder: Path, exported: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From its own start the demonstration succeeds again, through LeRobot too."""
    from mam_policies.lerobot.replay import best_demonstration, measure

    assert len(measure(run_folder, 2).each) == 2
    _, seed, demo = best_demonstration(run_folder)
    fast = (f"--robot.seed={seed}", "--dataset.fps=200")
    run_readme(monkeypatch, exported, "replay", tmp_path, *fast)
    episode = json.loads((tmp_path / "episodes.jsonl").read_text())
    assert episode["success"] and episode["steps"] == len(demo.actions)


def test_a_video_leaves_the_process_scheduled_as_it_was(tmp_path: Path) -> None:
    """As root the AV1 encoder makes its caller a real-time process, and all that this starts."""
    from mam_policies.collection import Names, Track
    from mam_policies.lerobot.dataset import write_dataset

    before = os.sched_getscheduler(0)
    rows = np.zeros((4, 1), np.float32)
    picture: np.ndarray = np.zeros((4, 64, 64, 3), np.uint8)
    track = Track(rows, rows, rows, {"hand": picture}, True, "open")
    write_dataset([(track, rows[:, 0])], Names(("a",), ("b",), ("c",)), "arm", tmp_path / "data")
    assert list((tmp_path / "data").rglob("*.mp4"))
    assert os.sched_getscheduler(0) == before


def test_dataset_export_and_a_few_steps_of_training(
    drawer: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from lerobot.datasets.lerobot_dataset import LeRobotDataset

    from mam_policies.collect import collect
    from mam_policies.collection import CollectConfig
    from mam_policies.lerobot.export import export_dataset

    collect(drawer, CollectConfig(episodes=1), tmp_path / "demos")
    out = tmp_path / "out"
    export_dataset(tmp_path / "demos", out)
    data = LeRobotDataset("local/mam_sim", root=out / "dataset")
    assert data.features["action"]["names"][0] == "panda_joint1.pos"
    run_readme(
        monkeypatch, out, "train", tmp_path, "--policy.dim_model=32", "--policy.n_heads=2",
        "--policy.dim_feedforward=32", "--policy.n_encoder_layers=1", "--policy.chunk_size=8",
        "--policy.n_action_steps=8", "--steps=3", "--batch_size=4", "--save_freq=3",
    )  # fmt: skip
    saved = tmp_path / "act" / "checkpoints" / "000003" / "pretrained_model"
    policy, *_ = _load(saved)
    assert policy.config.type == "act"
    text = (out / "README.md").read_text()
    assert "no real arm can run it" in text

    # the page's own lines evaluate it, on what it was trained on
    run_readme(
        monkeypatch, out, "eval", tmp_path, "--policy.device=cpu", "--env.episode_length=5",
        "--eval.n_episodes=1", "--output_dir=eval",
    )  # fmt: skip
    found = json.loads((tmp_path / "eval" / "eval_info.json").read_text())
    assert found["overall"]["n_episodes"] == 1
    line = next(row for row in text.splitlines() if row.startswith("mam-sim eval "))
    words = [*shlex.split(line)[1:], "--episodes", "1", "--out", "eval.json", "--quiet"]
    assert mam_sim(words) == 0
    assert json.loads((tmp_path / "eval.json").read_text())["total"]["episodes"] == 1
    assert mam_sim([*words[:2], "--episodes", "1"]) == 2  # on what is it to be tried?
