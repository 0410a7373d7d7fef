"""Policies: files, intervals, cloning that learns and resumes, reinforcement learning that runs."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch

from mam_pipeline.errors import InputError
from mam_policies.bc import BcConfig, Demonstration, fit, positions
from mam_policies.evaluate import wilson
from mam_policies.run import Actor, EnvChoice, MlpPolicy, RunInfo


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


def test_positions_leave_out_speed_and_touch() -> None:
    rows = [
        ("agent/qpos", 0, 2, False),
        ("agent/qvel", 2, 4, False),
        ("extra/privileged/joint_value", 4, 5, True),
        ("extra/privileged/touching", 5, 6, True),
    ]
    assert positions(rows) == (0, 1, 4)


def test_file_of_another_kind_is_named(tmp_path: Path) -> None:
    (tmp_path / "policy.safetensors").write_bytes(b"not a policy")
    with pytest.raises(InputError, match="not a policy of mam-sim"):
        MlpPolicy.load(tmp_path)
    with pytest.raises(InputError, match="no run"):
        RunInfo.load(tmp_path)


def test_actor_averages_overlapping_chunks() -> None:
    policy = _policy()
    actor = Actor(policy, decay=0.5)
    first, second = np.zeros(6, np.float32), np.ones(6, np.float32)
    actor.act(first)
    got = actor.act(second)
    with torch.no_grad():
        a = policy.actions(torch.tensor(first)[None], torch.tensor([0]))[0, 1].numpy()
        b = policy.actions(torch.tensor(second)[None], torch.tensor([1]))[0, 0].numpy()
    assert np.allclose(got, (0.5 * a + b) / 1.5, atol=1e-6)


def test_wilson_interval_is_the_closed_form() -> None:
    z, n, k = 1.959964, 20, 17
    low, high = wilson(k, n, z)
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


@pytest.mark.slow  # trains a policy in the simulator
def test_cloning_a_drawer_learns(run_folder: Path) -> None:
    from mam_policies.evaluate import evaluate_run

    info = RunInfo.load(run_folder)
    assert info.results["demonstrations"] == 30
    found = evaluate_run(run_folder, 4)
    assert found.successes >= 2
    assert found.low <= found.rate <= found.high + 1e-9


@pytest.mark.slow  # starts a training process and kills it
def test_killed_cloning_keeps_its_demonstrations(drawer: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    arguments = [str(drawer), "--out", str(out), "--episodes", "3", "--epochs", "2"]
    command = [sys.executable, "-m", "mam_sim.cli", "train", *arguments, "--test", "0", "--quiet"]
    process = subprocess.Popen(command)
    deadline = time.monotonic() + 120
    while not list(out.glob("demos/0*[0-9].npz")) and time.monotonic() < deadline:
        time.sleep(0.1)
    process.send_signal(signal.SIGKILL)
    process.wait()
    kept = {p: p.stat().st_mtime_ns for p in out.glob("demos/0*[0-9].npz")}
    assert kept and not (out / "run.json").exists()
    assert subprocess.run(command, check=False).returncode == 0
    assert all(p.stat().st_mtime_ns == at for p, at in kept.items())
    assert json.loads((out / "run.json").read_text())["results"]["demonstrations"] == 3


@pytest.mark.slow  # runs the simulator for some hundred steps
def test_ppo_runs_and_goes_on(drawer: Path, tmp_path: Path) -> None:
    from mam_policies.rl import CONTROL_MODE, RlConfig, train_rl

    choice = EnvChoice((str(drawer),), control_mode=CONTROL_MODE, max_steps=60)
    config = RlConfig("ppo", 256, curriculum=False, save_every=128)
    train_rl(choice, config, tmp_path)
    first = torch.load(tmp_path / "checkpoint" / "last.pt", weights_only=True)["steps"]
    info = train_rl(choice, RlConfig("ppo", first + 1, curriculum=False, save_every=128), tmp_path)
    assert info.results["steps"] > first
    assert MlpPolicy.load(tmp_path).squash == "clip"
