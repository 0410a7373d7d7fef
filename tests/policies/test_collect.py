"""Collected demonstrations reload offline, resume, and survive a kill."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest

from mam_pipeline.errors import InputError
from mam_policies.collect import CollectConfig, collect
from mam_policies.lerobot_dataset import load_dataset


def test_data_reload_and_resume(drawer: Path, tmp_path: Path) -> None:
    out = tmp_path / "demos"
    first = collect(CollectConfig(asset=str(drawer), episodes=2), out)
    assert first.episodes == 2 and first.resumed == 0

    # a killed run: the third attempt's frames are there, its outcome is not
    before = (out / "attempts" / "000001.npz").read_bytes()
    (out / "attempts" / f"{first.attempts:06d}.npz").write_bytes(b"half")
    said: list[str] = []
    more = collect(
        CollectConfig(asset=str(drawer), episodes=3), out, lambda *row: said.append(row[2])
    )
    assert more.episodes == 3 and more.resumed == first.attempts
    assert (out / "attempts" / "000001.npz").read_bytes() == before
    assert said[-1].startswith("writing")

    data = load_dataset(more.dataset)
    assert data.num_episodes == 3 and data.fps == 20
    names = data.features["action"]["names"]
    assert names[0] == "panda_joint1.rad" and names[-1] == "panda_finger_joint1.m"
    frame = data[0]
    assert frame["observation.state"].shape == (9,)
    assert frame["task"] == "open the drawer part 1 of box drawer"
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
        collect(CollectConfig(asset=str(drawer), episodes=3, seed=5), out)


def test_a_foreign_folder_is_left_alone(drawer: Path, tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("mine")
    with pytest.raises(InputError, match="is not empty"):
        collect(CollectConfig(asset=str(drawer), episodes=1), tmp_path)
    assert (tmp_path / "thesis.txt").read_text() == "mine"
