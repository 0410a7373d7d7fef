"""LeRobot's training goes on from no checkpoint that names a program to run."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from mam_pipeline.errors import InputError
from mam_pipeline.folder_data import training_settings
from mam_policies.lerobot.training import LeRobotTraining, train_policy
from tests.pipeline.test_folder_data import BEFORE, written


@pytest.mark.parametrize("kind", ["act", "diffusion", "smolvla"])
def test_what_lerobot_writes_of_a_policy_is_admitted(kind: str, tmp_path: Path) -> None:
    draccus = pytest.importorskip("draccus")
    from lerobot.policies.factory import make_policy_config

    config = make_policy_config(kind, device="cpu", push_to_hub=False)
    steps = {"optimizer": config.get_optimizer_preset(), "scheduler": config.get_scheduler_preset()}
    told = {**draccus.encode(config), "type": kind}
    rest = {
        name: None if step is None else {**draccus.encode(step), "type": step.type}
        for name, step in steps.items()
    }
    folder = written(tmp_path / "policy", config=told, train_config={"policy": told, **rest})
    assert training_settings(folder)["policy"] == told


def test_a_checkpoint_that_names_a_program(tmp_path: Path) -> None:
    canary = tmp_path / "canary"
    program = [sys.executable, "-c", f"open({str(canary)!r}, 'w')"]
    step = {"class": "subprocess.Popen", "config": {"args": program}}
    last = tmp_path / "out" / "checkpoints" / "last"
    (last / "training_state").mkdir(parents=True)
    (last / "training_state" / "training_step.json").write_text(json.dumps({"step": 1}))
    before = {**BEFORE, "steps": [step]}
    written(last / "pretrained_model", policy_preprocessor=before)
    config = LeRobotTraining("--policy.type=act", 2, 1, 0, False, False)
    with pytest.raises(InputError, match=r"subprocess\.Popen") as refused:
        train_policy(tmp_path / "data", config, tmp_path / "out")
    assert refused.value.exit_code == 2 and not canary.exists()
