"""eval over folders of assets: what is refused is a row, and the total says how many."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from mam_pipeline.asset.listing import asset_folders
from mam_pipeline.errors import ConfigError, InputError
from mam_sim.asset_list import split
from mam_sim.cli import main
from mam_sim.rank.run import subjects
from tests.envs.box_assets import without_range


def test_folders_stand_for_the_assets_in_them(drawer: Path, door: Path, tmp_path: Path) -> None:
    for source, name in ((drawer, "b"), (door, "a")):
        shutil.copytree(source, tmp_path / name)
    (tmp_path / "notes").mkdir()
    found = asset_folders([tmp_path, tmp_path / "b"])
    assert [f.name for f in found] == ["a", "b"]
    with pytest.raises(InputError):
        asset_folders([tmp_path / "notes"])


def test_a_batch_stands_for_its_assets(drawer: Path, door: Path, tmp_path: Path) -> None:
    """OUT of `mam-sim batch` is what rank, train, eval, register and view take."""
    batch = tmp_path / "batch"
    for source, name in ((drawer, "b"), (door, "a")):
        shutil.copytree(source, batch / "assets" / name)
    (batch / "records").mkdir()
    with pytest.raises(InputError):
        asset_folders([batch])  # a folder that is no batch of ours is not searched
    (batch / "batch.yaml").write_text("pipeline: {}\n")
    assert [f.name for f in asset_folders([batch])] == ["a", "b"]
    assert [f.name for f in subjects([batch])] == ["a", "b"]


def test_a_split_keeps_some_of_each() -> None:
    folders = [Path(str(i)) for i in range(10)]
    train, test = split(folders, 0.8, seed=0)
    assert len(train) == 8 and set(train) | set(test) == set(folders) and not set(train) & set(test)
    assert split(folders, 0.8, seed=0) == (train, test)
    assert [len(part) for part in split(folders[:2], 0.99, seed=0)] == [1, 1]
    with pytest.raises(ConfigError, match="at least two"):
        split(folders[:1], 0.5, seed=0)


def test_refused_assets_are_rows(
    drawer: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(drawer, tmp_path / "good")
    without_range(shutil.copytree(drawer, tmp_path / "still"))
    command = ["eval", "--expert", "--episodes", "1", "--json"]
    assert main([*command, "--asset", str(tmp_path)]) == 0
    found = json.loads(capsys.readouterr().out)
    assert "no range" in found["results"][1]["refused"]
    assert found["total"]["successes"] == 1 and found["total"]["refused"] == 1
    assert main([*command, "--asset", str(tmp_path / "still")]) == 1
    assert "no range" in capsys.readouterr().err
