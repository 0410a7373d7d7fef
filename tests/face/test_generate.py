"""mam-sim generate: folders, manifest, the same bytes again, and sentences for wrong options."""

from __future__ import annotations

import csv
from pathlib import Path

import pytest

from mam_pipeline.errors import ConfigError
from mam_sim.verbs.generate import generate


def _bytes(folder: Path) -> dict[str, bytes]:
    return {
        str(p.relative_to(folder)): p.read_bytes() for p in folder.rglob("*") if p.is_file()
    }  # fmt: skip


def test_same_seed_same_files(tmp_path: Path) -> None:
    for name in ("a", "b"):
        code = generate("station_button", 2, 5, tmp_path / name, textures=True, quiet=True)
        assert code == 0
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
        generate("box_chest", 3, 0, tmp_path / str(jobs), textures=False, jobs=jobs, quiet=True)
    assert _bytes(tmp_path / "1") == _bytes(tmp_path / "2")


def test_wrong_options_are_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="did you mean 'safe'"):
        generate("sefe", out=tmp_path)
    with pytest.raises(ConfigError, match="say where to write"):
        generate("safe")
    with pytest.raises(ConfigError, match="--jobs must be at least 1"):
        generate("safe", out=tmp_path, jobs=0)
    with pytest.raises(ConfigError, match="count must be at least 1"):
        generate("safe", count=0, out=tmp_path)
