"""One policy over several objects, by the commands that the tutorial gives, in small."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mam_policies.mlp import MlpPolicy
from mam_policies.run import RunInfo
from mam_sim.cli import main
from tests.envs.box_assets import without_range, write_asset

pytestmark = pytest.mark.slow  # the simulator runs


def test_policies_that_come_with_mam_sim_open_what_they_have_not_seen(
    drawer: Path,
    door: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["eval", "generalist-drawer"]) == 2
    assert "generalist-drawer has no asset of its own; add --asset" in capsys.readouterr().err
    command = ["eval", "generalist-drawer", "--asset", str(drawer), "--episodes", "5", "--json"]
    assert main(command) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["run"] == "generalist-drawer" and found["total"]["successes"] >= 1
    assert main(["eval", "generalist-drawer", "--asset", str(door)]) == 2
    assert "has no drawer that moves, which generalist-drawer is for" in capsys.readouterr().err
    doors = ["eval", "generalist-door", "--asset", str(door), "--episodes", "5", "--json"]
    assert main(doors) == 0
    assert json.loads(capsys.readouterr().out)["total"]["successes"] >= 1
    (tmp_path / "generalist-drawer").mkdir()  # a folder of that name is meant, where there is one
    assert main(command) == 2
    assert "no run.json in generalist-drawer" in capsys.readouterr().err


def test_a_policy_over_several_objects_is_tried_on_one_that_it_has_not_seen(
    drawer: Path, two_drawers: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, run = tmp_path / "objects", tmp_path / "run"
    folder.mkdir()
    for name, source in (("a", drawer), ("b", two_drawers)):
        (folder / name).symlink_to(source)
    write_asset(folder / "c", "drawer")
    without_range(write_asset(folder / "d", "drawer"))  # refused, and counted
    command = ["train", str(folder), "--split", "0.5", "--env.observation.articulation"]
    small = ["--episodes", "2", "--epochs", "1", "--rounds", "1", "--round-episodes", "1"]
    assert main([*command, *small, "--test", "0", "--out", str(run)]) == 0
    split = json.loads((run / "split.json").read_text())
    # the split is made before anything is refused, so that no object is missing
    assert len(split["train"]) + len(split["refused"]) + len(split["held_out"]) == 4
    refused = [Path(f).name for key in ("refused", "held_out") for f in split[key]]
    assert "d" in refused and "d" not in {Path(f).name for f in split["train"]}
    rows = {name: start for name, start, *_ in RunInfo.load(run).observation}
    marks = MlpPolicy.load(run).marks
    assert marks == [start for name, start in rows.items() if "posture_" in name] != []
    capsys.readouterr()
    assert main(["eval", str(run), "--held-out", "--episodes", "1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    held_out = [Path(f).name for f in split["held_out"]]
    assert [r["asset"] for r in found["results"]] == held_out
    assert found["total"]["refused"] == ("d" in held_out)
    assert found["total"]["episodes"] == len(held_out) - ("d" in held_out)
