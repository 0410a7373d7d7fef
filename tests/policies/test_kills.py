"""kill -9 in the middle of collect, train and export; the same command goes on to the same end."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
import torch

from mam_policies.algorithms import algorithm
from mam_policies.algorithms.bc import BcConfig, BehaviourCloning
from mam_policies.algorithms.sb3_checkpoint import load_checkpoint
from mam_policies.mlp import MlpPolicy
from mam_policies.run import EnvChoice, RunInfo

pytestmark = pytest.mark.slow  # each starts processes with a simulator and kills them


def kill_when(
    command: list[str], ready: Callable[[], object], number: int = signal.SIGKILL
) -> None:
    """Start a command and send it a signal as soon as `ready()` is true."""
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    deadline = time.monotonic() + 300
    while not ready():
        assert process.poll() is None, "it ended before it could be killed"
        assert time.monotonic() < deadline, "it never came so far"
        time.sleep(0.02)
    process.send_signal(number)
    process.wait()


def mam_sim(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "mam_sim.cli", *arguments]


def same_weights(a: Path, b: Path) -> bool:
    one, two = MlpPolicy.load(a).state_dict(), MlpPolicy.load(b).state_dict()
    return all(torch.equal(one[k], two[k]) for k in one)


def test_killed_cloning_ends_the_same(drawer: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    command = mam_sim(
        "train", str(drawer), "--out", str(out), "--episodes", "3", "--epochs", "60",
        "--test", "0", "--quiet",
    )  # fmt: skip
    kill_when(command, lambda: list(out.glob("demos/0*[0-9].npz")))
    kept = {p: p.stat().st_mtime_ns for p in out.glob("demos/0*[0-9].npz")}
    assert kept and not (out / "run.json").exists()
    kill_when(command, (out / "checkpoint" / "last.pt").exists)  # now in the midst of training
    info = RunInfo.load(out) if (out / "run.json").exists() else None
    assert subprocess.run(command, check=False).returncode == 0
    assert all(p.stat().st_mtime_ns == at for p, at in kept.items())
    info = info or RunInfo.load(out)
    assert info.results["demonstrations"] == 3

    torch.set_num_threads(1)
    straight = tmp_path / "straight"
    (straight / "demos").mkdir(parents=True)
    (straight / "settings.txt").write_bytes((out / "settings.txt").read_bytes())
    for file in out.glob("demos/*.npz"):
        (straight / "demos" / file.name).write_bytes(file.read_bytes())
    BehaviourCloning().train(info.env, BcConfig(episodes=3, epochs=60), straight)
    assert same_weights(out, straight)


SHORT = {"episodes": 0, "steps": 256, "curriculum": False, "save_every": 64}
RL = """
import sys
from pathlib import Path
from mam_policies.algorithms import algorithm
from mam_policies.run import EnvChoice
learner = algorithm("{algo}")
choice = EnvChoice((sys.argv[1],), control_mode=learner.control_mode, max_steps=30)
learner.train(choice, learner.Config(**{settings}), Path(sys.argv[2]))
"""


@pytest.mark.parametrize("algo", ["ppo", "sac"])
def test_killed_reinforcement_learning_ends_the_same(
    algo: str, drawer: Path, tmp_path: Path
) -> None:
    """A killed run and one that was not end with the same weights, bit for bit."""
    out, straight = tmp_path / "run", tmp_path / "straight"
    settings = SHORT | ({"rollout": 64} if algo == "ppo" else {})
    code = RL.format(algo=algo, settings=settings)
    command = [sys.executable, "-c", code, str(drawer), str(out)]
    kill_when(command, (out / "checkpoint" / "last.pt").exists)
    saved = load_checkpoint(out / "checkpoint")
    assert saved is not None and 64 <= saved["steps"] < 256 and not (out / "run.json").exists()

    torch.set_num_threads(1)
    learner = algorithm(algo)
    choice = EnvChoice((str(drawer),), control_mode=learner.control_mode, max_steps=30)
    config = learner.Config(**settings)
    first = learner.train(choice, config, out)
    second = learner.train(choice, config, straight)
    assert first.results["steps"] == second.results["steps"]
    assert first.results["curve"] == second.results["curve"]
    assert same_weights(out, straight)


def test_killed_collection_goes_on(drawer: Path, tmp_path: Path) -> None:
    out = tmp_path / "demos"
    command = mam_sim("collect", str(drawer), "--out", str(out), "--episodes", "3", "--quiet")
    kill_when(command, (out / "attempts" / "000000.json").exists)
    kept = {p.name: p.read_bytes() for p in sorted((out / "attempts").glob("0*.json"))}
    assert kept and not (out / "demos.h5").exists()
    assert subprocess.run(command, check=False).returncode == 0
    assert all((out / "attempts" / name).read_bytes() == text for name, text in kept.items())
    assert (out / "demos.h5").is_file() and (out / "lerobot" / "meta" / "info.json").is_file()


def test_killed_export_leaves_nothing_half(run_folder: Path, tmp_path: Path) -> None:
    pytest.importorskip("lerobot_policy_mam_sim", reason="scripts/setup.sh installs the plug-ins")
    out = tmp_path / "policy"
    command = mam_sim("export", str(run_folder), "--out", str(out), "--quiet")
    kill_when(command, lambda: list(tmp_path.glob(".policy.partial-*/model.safetensors")))
    assert not out.exists()
    assert subprocess.run(command, check=False).returncode == 0
    for name in ("config.json", "model.safetensors", "README.md", "joint_mapping.yaml"):
        assert (out / name).is_file()
    assert not list(tmp_path.glob(".policy.*"))


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_stopped_make_env_leaves_the_old_asset(
    drawer: Path, tmp_path: Path, number: signal.Signals
) -> None:
    command = mam_sim("articulate", str(drawer / "object.urdf"), "--out", str(tmp_path / "env"))
    assert subprocess.run(command, check=False).returncode in (0, 1)
    before = {p: p.read_bytes() for p in (tmp_path / "env").rglob("*") if p.is_file()}
    kill_when(command, lambda: list(tmp_path.glob(".env.partial-*")), number)
    assert {p: p.read_bytes() for p in (tmp_path / "env").rglob("*") if p.is_file()} == before
    if number == signal.SIGTERM:
        until = time.monotonic() + 10  # native code that was busy is ended, and then swept after
        while len(list(tmp_path.iterdir())) > 1 and time.monotonic() < until:
            time.sleep(0.02)
        assert [p.name for p in tmp_path.iterdir()] == ["env"]
    assert subprocess.run(command, check=False).returncode in (0, 1)
    assert [p.name for p in tmp_path.iterdir()] == ["env"]
