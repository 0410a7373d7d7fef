"""From a run to a calibrated arm, by the commands, on the simulated robot with faults."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("lerobot_robot_mam_sim", reason="scripts/setup.sh installs the plug-ins")
pytestmark = pytest.mark.slow  # trains a policy, and moves an arm through many poses

from mam_sim_arm.held_key import NoKey  # noqa: E402
from mam_sim_arm.pilot import open_pilot, plan_space  # noqa: E402
from mam_sim_arm.setup import Twin, write_setup  # noqa: E402

from mam_pipeline.errors import MamSimError  # noqa: E402
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
    assert main(["calibrate", *words, "--yes", "--json", "--poses", "16", "--share", "1"]) == 0
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
    assert main(hold) == 1
    told = capsys.readouterr()
    assert "let go" in told.err and "holds, with torque on" in told.err + told.out
    stopped = json.loads((setup / "episodes.jsonl").read_text().splitlines()[-1])
    assert not stopped["success"] and stopped["steps"] < 60
    assert main(["park", *words, "--yes"]) == 0


@pytest.mark.parametrize(
    ("fault", "words"),
    [
        (
            "dead_motor",
            "does not follow its target|outside the planned workspace|did not move, though",
        ),
        ("wrong_sign", "is wrong: run `mam-sim calibrate`"),
        # it may grip again, and may look for the handle elsewhere
        ("slipped_gripper", "handle slipped|outside the planned workspace|^(no )?success$"),
        ("moved_object", "the object has moved by"),
        ("hidden_tag", "tag_1"),
        ("lost_camera", "no picture from the camera"),
        ("frozen_camera", "stands still"),
        ("lost_arm", "no motor answers"),
    ],
)
def test_a_fault_stops_the_arm_with_what_to_do(
    run_folder: Path, fault: str, words: str, tmp_path: Path
) -> None:
    twin, setup = Twin.load(run_folder), tmp_path / "arm"
    write_setup(twin, setup)
    wire, path = tmp_path / "wire.jsonl", twin.layout.placement.path
    begins = {"hidden_tag": 0, "dead_motor": 5, "slipped_gripper": 50}
    changes: dict[str, Any] = {
        "fault": fault,
        "wire": str(wire),
        "fault_step": begins.get(fault, 20),
    }
    if fault == "dead_motor":
        changes["fault_joint"] = "panda_joint2"  # without it no handle is reached
    ended = ""
    with open_pilot(run_folder, setup, nominal=True, **changes) as pilot:
        try:
            seen = pilot.find()
            plan_space(pilot, twin, seen, np.concatenate([path.approach, path.follow]))
            with pilot.arm.moving():
                found = pilot.run(seen, 150)
            begin, goal = float(seen.value or 0.0), pilot.converter.plan.goal
            truth = (float(pilot.arm._robot._state[-2]) - begin) / (
                goal - begin
            )  # the joint's value
            assert found.opened <= truth + 0.1 and (truth > 0.9 or not found.success)
            ended = found.stopped or ("success" if found.success else "no success")
        except MamSimError as error:
            ended = str(error)
    assert re.search(words, ended, re.IGNORECASE), ended
    rows = [json.loads(line) for line in wire.read_text().splitlines()]
    assert rows[-1] == {"kind": "disconnect", "torque": True}
    sent = np.array([list(r["targets"].values()) for r in rows if r["kind"] == "action"])
    if fault in ("hidden_tag", "wrong_sign"):  # found before anything moves
        assert not len(sent) and {r["kind"] for r in rows} == {"connect", "disconnect"}
    elif fault in ("lost_camera", "lost_arm"):  # nothing more than tries to hold
        assert len(sent) <= 20 + 1 + 6


def test_looking_sends_nothing(run_folder: Path, tmp_path: Path) -> None:
    setup, wire = tmp_path / "arm", tmp_path / "wire.jsonl"
    words = [str(run_folder), "--setup", str(setup)]
    assert main(["calibrate", *words, "--init"]) == 0
    with (setup / "robot.yaml").open("a") as file:
        file.write(f"wire: {wire}\n")
    for verb in (["perceive"], ["deploy", "--dry-run"]):
        wire.unlink(missing_ok=True)
        assert main([verb[0], *words, "--nominal", *verb[1:]]) == 0
        kinds = [json.loads(line)["kind"] for line in wire.read_text().splitlines()]
        assert kinds == ["connect", "disconnect"]


class _Held(NoKey):
    """A key that is held down for a second, and then q."""

    person = True

    def __init__(self) -> None:
        self.steps = 0

    def down(self, only: str = "") -> bool:
        self.steps += 1
        return self.steps <= 20

    def wait(self) -> str:
        return "q"


def _last(capsys: pytest.CaptureFixture[str]) -> str:
    return capsys.readouterr().out
