"""Policies: files, intervals, cloning that learns and resumes, reinforcement learning that runs."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
import torch

from mam_pipeline.errors import ConfigError, InputError
from mam_policies.algorithms.bc import BcConfig, BehaviourCloning, entries, fit
from mam_policies.algorithms.ppo import Ppo, PpoConfig
from mam_policies.algorithms.sb3_env import Plain
from mam_policies.demonstrations import Demonstration
from mam_policies.expert import Expert
from mam_policies.lerobot.robot_interface import Faults, RobotInterface
from mam_policies.mlp import MlpActor, MlpPolicy
from mam_policies.run import EnvChoice, RunInfo
from mam_policies.wilson import wilson
from mam_sim.cli import main as mam_sim


def _policy(**more: object) -> MlpPolicy:
    torch.manual_seed(0)
    policy = MlpPolicy(6, 3, 2, chunk=4, hidden=(16,), horizon=50, **more)  # type: ignore[arg-type]
    policy.mean.copy_(torch.arange(6.0))
    policy.scale.copy_(torch.tensor([0.5, 2.0, 3.0]))
    return policy.eval()


@pytest.mark.parametrize("inputs", [None, (0, 1, 4)])
def test_policy_survives_its_file(tmp_path: Path, inputs: tuple[int, ...] | None) -> None:
    policy = _policy(inputs=inputs)
    policy.save(tmp_path)
    again = MlpPolicy.load(tmp_path)
    obs, step = torch.randn(5, 6), torch.arange(5)
    assert torch.equal(policy.actions(obs, step), again.actions(obs, step))
    assert again.sizes == policy.sizes


def test_policy_sees_only_its_inputs() -> None:
    policy = _policy(inputs=(0, 1, 4))
    obs = torch.randn(1, 6)
    other = obs.clone()
    other[:, [2, 3, 5]] += 9.0
    step = torch.zeros(1)
    assert torch.equal(policy.actions(obs, step), policy.actions(other, step))


def test_entries_leave_out_speed_touch_and_the_world() -> None:
    rows = [
        ("agent/qpos", 0, 2, False),
        ("agent/qvel", 2, 4, False),
        ("extra/privileged/joint_value", 4, 5, True),
        ("extra/privileged/touching", 5, 6, True),
    ]
    assert entries(rows, False) is None
    assert entries(rows, True) == (0, 1, 4)
    rows += [
        ("extra/tcp_pose", 6, 13, False),
        ("extra/privileged/grasp_offset", 13, 16, True),
    ]
    assert entries(rows, False, 1) == (1, 5, 13, 14, 15)  # the gripper, touch and the way left
    assert entries(rows, True, 1) == (1, 13, 14, 15)


def test_file_of_another_kind_is_named(tmp_path: Path) -> None:
    (tmp_path / "policy.safetensors").write_bytes(b"not a policy")
    with pytest.raises(InputError, match="no file of weights"):
        MlpPolicy.load(tmp_path)
    with pytest.raises(InputError, match="no run"):
        RunInfo.load(tmp_path)


def test_actor_averages_overlapping_chunks() -> None:
    policy = _policy()
    actor = MlpActor(policy, decay=0.5)
    first, second = np.zeros(6, np.float32), np.ones(6, np.float32)
    actor.act(first)
    got = actor.act(second)
    with torch.no_grad():
        a = policy.actions(torch.tensor(first)[None], torch.tensor([0]))[0, 1].numpy()
        b = policy.actions(torch.tensor(second)[None], torch.tensor([1]))[0, 0].numpy()
    assert np.allclose(got, (0.5 * a + b) / 1.5, atol=1e-6)


def test_wilson_interval_is_the_closed_form() -> None:
    z, n, k = 1.959964, 20, 17
    low, high = wilson(k, n)
    for p in (low, high):  # the ends solve (p - k/n)^2 = z^2 p (1 - p) / n
        assert (p - k / n) ** 2 == pytest.approx(z * z * p * (1 - p) / n, rel=1e-6)
    assert wilson(0, 0) == (0.0, 1.0)
    assert wilson(20, 20)[1] == pytest.approx(1.0) and wilson(0, 20)[0] == pytest.approx(0.0)


def _toy(seed: int = 0) -> list[Demonstration]:
    rng = np.random.default_rng(seed)
    demos = []
    for _ in range(4):
        obs = rng.normal(size=(30, 6)).astype(np.float32)
        actions = np.concatenate([obs[:, :2] + 0.1 * obs[:, 2:4], obs[:, 4:5]], axis=1)
        demos.append(Demonstration(obs, actions.astype(np.float32)))
    return demos


def test_training_that_was_cut_off_ends_the_same(tmp_path: Path) -> None:
    config = BcConfig(epochs=50, chunk=1, hidden=(16,), batch=32)
    whole, cut = MlpPolicy(6, 3, 2, 1, (16,), 50), MlpPolicy(6, 3, 2, 1, (16,), 50)
    loss = fit(whole, _toy(), config, tmp_path / "a")

    class Stop(Exception):
        pass

    def stop(_phase: str, share: float, _words: str) -> None:
        if share > 0.7:
            raise Stop

    with pytest.raises(Stop):
        fit(cut, _toy(), config, tmp_path / "b", stop)
    again = MlpPolicy(6, 3, 2, 1, (16,), 50)
    assert fit(again, _toy(), config, tmp_path / "b") == pytest.approx(loss, rel=1e-6)
    for a, b in zip(whole.parameters(), again.parameters()):
        assert torch.allclose(a, b, atol=1e-7)


class Steps(gym.Env):
    """A reward of 0.5 a step; success in the third."""

    observation_space = gym.spaces.Box(-1, 1, (2,), np.float32)
    action_space = gym.spaces.Box(-1, 1, (1,), np.float32)

    def reset(self, *, seed: int | None = None, options: object = None) -> tuple:
        self.count = 0
        return np.zeros((1, 2)), {}

    def step(self, action: object) -> tuple:
        self.count += 1
        return np.zeros((1, 2)), 0.5, False, self.count >= 3, {"success": self.count >= 3}


def test_success_is_worth_more_than_waiting() -> None:
    """It ends an episode and counts as if it lasted; the time limit is then no truncation."""
    env = Plain(Steps(), gamma=0.98)
    env.reset()
    rows = [env.step(np.zeros(1)) for _ in range(3)]
    assert [r[1] for r in rows] == pytest.approx([0.5, 0.5, 0.5 / 0.02])
    assert [r[2] for r in rows] == [False, False, True] and not rows[-1][3]


@pytest.mark.slow  # trains a policy in the simulator
def test_cloning_a_drawer_learns(run_folder: Path) -> None:
    from mam_policies.evaluate import evaluate_run

    info = RunInfo.load(run_folder)
    assert info.results["demonstrations"] == 30
    found = evaluate_run(run_folder, 4)
    assert found.successes >= 2


@pytest.mark.slow  # runs the simulator for some hundred steps
def test_ppo_runs_and_goes_further(drawer: Path, tmp_path: Path) -> None:
    """From the clone of one demonstration; a longer wish goes on from the last checkpoint."""
    choice = EnvChoice((str(drawer),), control_mode=Ppo.control_mode, max_steps=100)
    config = PpoConfig(steps=128, rollout=128, save_every=128, episodes=1)
    told: list[int] = []
    Ppo().train(choice, config, tmp_path, on_checkpoint=lambda n, _: told.append(n))
    first = Ppo().train(choice, replace(config, steps=256), tmp_path)
    more = Ppo().train(choice, replace(config, steps=384), tmp_path)
    assert told == [0] and first.results["steps"] == 256 and more.results["steps"] == 384
    policy = MlpPolicy.load(tmp_path)
    assert policy.squash == "clip" and list((tmp_path / "tensorboard").rglob("events*"))
    with pytest.raises(ConfigError, match="other settings"):
        Ppo().train(choice, replace(config, seed=3), tmp_path)


@pytest.mark.slow  # runs the simulator for some hundred steps
def test_a_dagger_round_is_labelled_by_the_plan(drawer: Path, tmp_path: Path) -> None:
    """The untrained policy soon leaves the plan; what it saw is kept with the plan's targets."""
    choice = EnvChoice((str(drawer),), max_steps=80)
    config = BcConfig(episodes=1, epochs=2, rounds=1, round_episodes=2)
    info = BehaviourCloning().train(choice, config, tmp_path)
    assert len(info.results["rounds"]) == 1
    files = sorted(tmp_path.glob("round_1/*.npz"))
    assert len(files) == 2
    with np.load(files[0]) as data:
        obs, labels = data["obs"], data["actions"]
    assert len(obs) == len(labels) and not np.allclose(labels[:, :7], obs[:, :7], atol=1e-3)
    env = choice.make()
    env.reset(seed=100_000)
    expert = Expert(env, attempts=1)
    expert.reset()
    off = np.abs(labels[:, None, :7] - expert.plan.arm[None]).max(axis=2)
    assert off.min(axis=1).max() < 1e-6  # a row of the plan each
    assert off[0].argmin() == 0 and (np.diff(off.argmin(axis=1)) >= 0).all()  # in its order
    env.close()
    at = [f.stat().st_mtime_ns for f in files]
    again = BehaviourCloning().train(choice, config, tmp_path)
    assert [f.stat().st_mtime_ns for f in files] == at
    assert again.results == info.results


def test_more_demonstrations_are_learned_anew(tmp_path: Path) -> None:
    """A finished training is not taken for that of more data."""
    config = BcConfig(epochs=25, chunk=1, hidden=(8,), batch=32)
    policy = MlpPolicy(6, 3, 2, 1, (8,), 50)
    few = fit(policy, _toy()[:2], config, tmp_path)
    assert fit(policy, _toy()[:2], config, tmp_path) == few
    assert fit(policy, _toy(), config, tmp_path) != few


@pytest.mark.slow  # builds an environment
def test_a_camera_on_the_hand_shares_the_arm_s_error(drawer: Path) -> None:
    """What the policy computes from the reported state is the true way from hand to handle."""
    choice = EnvChoice((str(drawer),), max_steps=60)
    for eye in (True, False):
        interface = RobotInterface(choice, faults=Faults(calibration=0.03, eye_in_hand=eye), seed=4)
        state = interface.reset(7)
        base = interface.env.unwrapped
        arm = [interface.joints.index(n) for n in interface.spec.arm]
        turn, place, _ = interface.spec.chain.forward(state[arm][None].astype(float))
        told = turn[0].T @ (state[len(interface.joints) :][:3] - place[0])
        tool = base.tool_pose().to_transformation_matrix()[0].numpy()
        true = tool[:3, :3].T @ (base.handle_position()[0].numpy() - tool[:3, 3])
        assert np.allclose(told, true, atol=1e-4) == eye
        interface.close()


@pytest.mark.slow  # trains for a moment in the simulator
def test_own_code_with_sb3_alone(drawer: Path, tmp_path: Path) -> None:
    """examples/own_sb3.py trains without us; its zip is tried by eval, behind the flag."""
    out, result = tmp_path / "mine.zip", tmp_path / "found.json"
    example = Path(__file__).parents[2] / "examples" / "own_sb3.py"
    assert "mam_policies" not in example.read_text()
    command = [sys.executable, str(example), str(drawer), "--steps", "128", "--rollout", "64"]
    subprocess.run([*command, "--out", str(out)], check=True, stdout=subprocess.DEVNULL)
    arguments = ["eval", str(out), "--asset", str(drawer), "--episodes", "1", "--quiet"]
    assert mam_sim(arguments) != 0 and not result.exists()
    assert mam_sim([*arguments, "--trust", "--out", str(result)]) == 0
    assert json.loads(result.read_text())["results"][0]["episodes"] == 1
