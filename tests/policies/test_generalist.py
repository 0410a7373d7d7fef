"""One policy over several objects, by the commands that the tutorial gives, in small."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from mam_policies.mlp import MlpPolicy
from mam_policies.run import RunInfo
from mam_sim.cli import main
from tests.envs.box_assets import write_asset

pytestmark = pytest.mark.slow  # the simulator runs


def test_a_policy_over_several_objects_is_tried_on_one_that_it_has_not_seen(
    drawer: Path, two_drawers: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, run = tmp_path / "objects", tmp_path / "run"
    folder.mkdir()
    for name, source in (("a", drawer), ("b", two_drawers)):
        (folder / name).symlink_to(source)
    write_asset(folder / "c", "drawer")
    command = ["train", str(folder), "--split", "0.67", "--env.observation.articulation"]
    small = ["--episodes", "2", "--epochs", "1", "--rounds", "1", "--round-episodes", "1"]
    assert main([*command, *small, "--test", "0", "--out", str(run)]) == 0
    split = json.loads((run / "split.json").read_text())
    assert len(split["train"]) == 2 and len(split["held_out"]) == 1
    rows = {name: start for name, start, *_ in RunInfo.load(run).observation}
    marks = MlpPolicy.load(run).marks
    assert marks == [start for name, start in rows.items() if "posture_" in name] != []
    capsys.readouterr()
    assert main(["eval", str(run), "--held-out", "--episodes", "1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [r["asset"] for r in found["results"]] == [Path(split["held_out"][0]).name]
    assert found["total"]["episodes"] == 1
