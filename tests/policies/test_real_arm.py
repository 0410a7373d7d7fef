"""From a run to a calibrated arm, by the commands, on the simulated robot with faults."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

pytest.importorskip("lerobot_robot_mam_sim", reason="scripts/setup.sh installs the plug-ins")
pytestmark = pytest.mark.slow  # trains a policy, and moves an arm through many poses

from mam_sim.cli import main  # noqa: E402


def test_calibrate_perceive_deploy(
    run_folder: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    setup = tmp_path / "arm"
    words = [str(run_folder), "--setup", str(setup)]
    assert main(["perceive", *words]) == 2 and "--init" not in capsys.readouterr().out
    assert main(["calibrate", *words, "--init"]) == 0
    robot = setup / "robot.yaml"
    text = robot.read_text()
    for name, value in (("calibration", 0.05), ("camera", 0.02)):
        text = text.replace(f"{name}_error: 0.0", f"{name}_error: {value}")
    robot.write_text(text)
    assert main(["calibrate", *words]) == 2  # nobody is there to answer
    assert "--yes" in capsys.readouterr().err
    assert main(["calibrate", *words, "--yes", "--json"]) == 0
    found = json.loads(_last(capsys))
    assert found["residual_px"] < 1.0 and 0.005 < found["camera_moved_m"] < 0.06
    assert main(["perceive", *words, "--json"]) == 0
    seen = json.loads(_last(capsys))
    assert seen["source"] == "tag" and abs(seen["value"]) < 0.01 and seen["tags"] == [0, 1]
    assert (setup / "perceived.png").is_file()
    assert main(["deploy", *words, "--yes", "--json"]) == 0
    result = json.loads(_last(capsys))
    assert result["rehearsal"]["success"] and result["episodes"][0]["success"]
    assert json.loads((setup / "episodes.jsonl").read_text().splitlines()[-1])["success"]

    hold = ["deploy", *words, "--yes", "--hold-key", "always"]
    assert main(hold) == 2 and "needs a terminal" in capsys.readouterr().err
    monkeypatch.setattr("mam_sim_arm.held_key.HeldKey", _Held)
    assert main(hold) == 1 and "let go" in capsys.readouterr().err
    stopped = json.loads((setup / "episodes.jsonl").read_text().splitlines()[-1])
    assert not stopped["success"] and stopped["steps"] < 60


class _Held:
    """A key that is held down for a second."""

    def __enter__(self) -> _Held:
        self.steps = 0
        return self

    def __exit__(self, *_: object) -> None:
        return None

    def wait(self) -> None:
        return None

    def down(self) -> bool:
        self.steps += 1
        return self.steps <= 20


def _last(capsys: pytest.CaptureFixture[str]) -> str:
    return capsys.readouterr().out
