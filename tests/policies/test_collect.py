"""Collected demonstrations reload offline, resume, and survive a kill."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from pathlib import Path

import h5py
import numpy as np
import pytest

from mam_envs.config import EnvConfig
from mam_envs.scene.vulkan import vulkan_ok
from mam_pipeline.errors import ConfigError, InputError
from mam_policies.collect import _Claim, collect
from mam_policies.collection import CollectConfig
from mam_policies.lerobot.dataset import load_dataset
from mam_policies.run import refuse_foreign
from mam_sim.cli import main


def test_data_reload_and_resume(drawer: Path, tmp_path: Path) -> None:
    out = tmp_path / "demos"
    first = collect(drawer, CollectConfig(episodes=2), out)
    assert first.episodes == 2 and first.resumed == 0

    # a killed run: the third attempt's frames are there, its outcome is not
    before = (out / "attempts" / "000001.npz").read_bytes()
    (out / "attempts" / f"{first.attempts:06d}.npz").write_bytes(b"half")
    said: list[str] = []
    more = collect(drawer, CollectConfig(episodes=3), out, lambda *row: said.append(row[2]))
    assert more.episodes == 3 and more.resumed == first.attempts
    assert (out / "attempts" / "000001.npz").read_bytes() == before
    assert said[-1].startswith("writing")

    data = load_dataset(more.dataset)
    assert data.num_episodes == 3 and data.fps == 20
    names = data.features["action"]["names"]
    assert names[0] == "panda_joint1.rad" and names[-1] == "panda_finger_joint1.m"
    frame = data[0]
    assert frame["observation.state"].shape == (9,)
    assert frame["task"] == "open the drawer"
    last = data[len(data) - 1]
    assert bool(last["next.success"]) and bool(last["next.done"])

    listing = json.loads((out / "demos.json").read_text())
    assert listing["env_info"]["env_id"] == "mam_envs:OperateJoint-v1"
    with h5py.File(more.h5) as file:
        assert set(file) == {"traj_0", "traj_1", "traj_2"}
        steps = listing["episodes"][0]["elapsed_steps"]
        assert file["traj_0/actions"].shape == (steps, 8)
        assert file["traj_0/obs"].shape[0] == steps + 1
        assert file["traj_0/env_states/articulations/object"].shape[0] == steps + 1
        assert np.asarray(file["traj_0/success"])[-1]

    with pytest.raises(InputError, match="another --out"):
        collect(drawer, CollectConfig(episodes=3, seed=5), out)


def test_a_foreign_folder_is_left_alone(drawer: Path, tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(ConfigError, match="is not empty"):
        collect(drawer, CollectConfig(episodes=1), tmp_path)
    assert (tmp_path / "thesis.txt").read_text() == "mine"


@pytest.mark.slow
def test_kill_9_loses_at_most_the_running_attempt(drawer: Path, tmp_path: Path) -> None:
    # slow: a second process imports the simulator
    out = tmp_path / "demos"
    command = [sys.executable, "-m", "mam_sim.cli", "collect", str(drawer), "--out", str(out)]
    running = subprocess.Popen([*command, "--episodes", "50", "--quiet"])
    attempts = out / "attempts"
    until = time.monotonic() + 600
    while len(list(attempts.glob("0*.json"))) < 2:
        assert running.poll() is None and time.monotonic() < until
        time.sleep(0.05)
    running.kill()  # SIGKILL
    running.wait()
    finished = sorted(attempts.glob("0*.json"))
    before = [f.read_bytes() for f in finished]
    wanted = 1 + sum(json.loads(text)["success"] for text in before)
    more = collect(drawer, CollectConfig(episodes=wanted), out)
    assert more.resumed == len(finished) and more.episodes == wanted
    assert [f.read_bytes() for f in finished] == before
    assert load_dataset(more.dataset).num_episodes == wanted


@pytest.mark.display
@pytest.mark.slow
@pytest.mark.skipif(not vulkan_ok(), reason="no Vulkan device to render with")
def test_videos_go_into_the_dataset(drawer: Path, tmp_path: Path) -> None:
    # slow: every control step is rendered on the CPU
    world = {"cameras": {"front": {"width": 32, "height": 24}}, "wall": False}
    config = CollectConfig(episodes=1, cameras=True)
    settings = EnvConfig.make({"scene": world})
    made = collect(drawer, config, tmp_path / "demos", env_config=settings)
    data = load_dataset(made.dataset)
    assert data.features["observation.images.front"]["shape"] == (24, 32, 3)
    assert data[len(data) // 2]["observation.images.front"].shape == (3, 24, 32)


def test_a_folder_is_claimed_only_when_asset_joint_and_robot_are_right(
    drawer: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "demos"
    for wrong in (["--joint", "doors"], ["--task", "dance"], ["--robot", "xarm6_robotiq"]):
        status = main(["collect", str(drawer), "--out", str(out), "--quiet", *wrong])
        if wrong[1] == "xarm6_robotiq" and status == 0:  # its files have been downloaded here
            continue
        assert status == 2 and not list(tmp_path.iterdir()), wrong
    assert capsys.readouterr().err.count("mam-sim: ") >= 2


def test_a_collection_that_was_killed_as_it_began_can_begin_again(
    drawer: Path, tmp_path: Path
) -> None:
    out = tmp_path / "demos"
    (out / "attempts").mkdir(parents=True)
    (out / ".collect.json.partial-4194305.json").write_text("half")
    claim = _Claim(out, {"asset": "a"})
    claim.check()
    claim.write()
    assert {p.name for p in out.iterdir()} == {"attempts", "collect.json"}
    claim.give_back()
    assert not list(out.iterdir())  # it was there before, and stays


def test_training_refuses_a_foreign_folder_and_leaves_none_of_its_own(
    drawer: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    theirs = tmp_path / "theirs"
    theirs.mkdir()
    (theirs / "thesis.tex").write_text("mine")
    assert main(["train", str(drawer), "--out", str(theirs), "--quiet"]) == 2
    assert "is not empty and holds no run" in capsys.readouterr().err
    assert [p.name for p in theirs.iterdir()] == ["thesis.tex"]
    for algo in ("bc", "ppo"):
        words = ["train", str(drawer), "--algo", algo, "--joint", "doors", "--quiet"]
        assert main([*words, "--out", str(tmp_path / algo)]) == 2
        assert not (tmp_path / algo).exists()
    begun = tmp_path / "begun"
    begun.mkdir()
    (begun / ".settings.txt.partial-4194305.txt").write_text("half")
    refuse_foreign(begun)
    assert not list(begun.iterdir())


def test_what_collect_can_be_told_needs_no_torch() -> None:
    code = "import sys, mam_sim.verbs.collect; print('torch' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
