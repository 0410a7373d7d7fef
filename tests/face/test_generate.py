"""Data sets of the world and mam-sim generate: folders, manifest, the same bytes again."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from mam_pipeline.errors import ConfigError
from mam_sim.cli import main
from mam_world.dataset import write_dataset


def _bytes(folder: Path) -> dict[str, bytes]:
    return {
        str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()
    }  # fmt: skip


def test_same_seed_same_files(tmp_path: Path) -> None:
    for name in ("a", "b"):
        write_dataset("station_button", 2, 5, tmp_path / name, textures=True)
    first = _bytes(tmp_path / "a")
    assert first == _bytes(tmp_path / "b")
    with (tmp_path / "a" / "MANIFEST.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [r["name"] for r in rows] == ["station_button_000005", "station_button_000006"]
    for row in rows:
        assert f"{row['name']}/static.glb" in first and f"{row['name']}/asset.json" in first
        assert row["split"] == "train" and int(row["joints"]) == 1


@pytest.mark.slow  # a fresh process imports everything again
def test_two_processes_write_what_one_writes(tmp_path: Path) -> None:
    for jobs in (1, 2):
        write_dataset("box_chest", 3, 0, tmp_path / str(jobs), textures=False, jobs=jobs)
    assert _bytes(tmp_path / "1") == _bytes(tmp_path / "2")


def test_wrong_options_are_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="did you mean 'safe'"):
        write_dataset("sefe", 1, 0, tmp_path)
    with pytest.raises(ConfigError, match="--jobs must be at least 1"):
        write_dataset("safe", 1, 0, tmp_path, jobs=0)
    with pytest.raises(ConfigError, match="count must be at least 1"):
        write_dataset("safe", 0, 0, tmp_path)


def test_the_verb_writes_and_names_the_next_command(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["generate", "--category", "safe"]) == 2
    assert "say where to write" in capsys.readouterr().err
    assert main(["generate", "--category", "station_button", "--out", str(tmp_path / "a")]) == 0
    told = capsys.readouterr()
    assert told.out.strip() == f"wrote: {tmp_path / 'a'}" and "next: mam-sim check" in told.err
    assert (tmp_path / "a" / "station_button_000000" / "object.urdf").is_file()
