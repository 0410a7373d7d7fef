"""Stock `lerobot-train` on one of our datasets, as a process that can be killed and goes on."""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from mam_pipeline import folder_data, folders
from mam_pipeline.claims import not_a_link
from mam_pipeline.edited import STRICT, Index, validated
from mam_pipeline.guarded import Limits, guarded
from mam_pipeline.optional import require
from mam_policies.lerobot.dataset import IMAGES, REPO_ID
from mam_policies.run import TrainingError


@dataclass(frozen=True)
class LeRobotTraining:
    """What lerobot-train is asked for.

    Attributes:
        policy: the argument that names the policy, such as --policy.type=act.
        steps, batch, seed: of its training.
        cameras: see pictures and motors; else motors and the privileged state.
        download: let it fetch files from the Hub.
        more: further arguments, as they are.
    """

    policy: str
    steps: int
    batch: int
    seed: int
    cameras: bool
    download: bool
    more: tuple[str, ...] = ()


RESUMED = "resumed.json"
"""Beside a checkpoint's train_config.json: what of it training goes on with."""


@dataclass(frozen=True)
class _Step:
    """training_step.json: steps that are done, and since LeRobot 0.6 by how many and how large."""

    __pydantic_config__ = STRICT
    step: Index
    num_processes: Index | None = None
    batch_size: Index | None = None


def train_policy(
    dataset: Path,
    config: LeRobotTraining,
    folder: Path,
    update: Callable[[float, str], None] = lambda *_: None,
) -> Path:
    """Run `lerobot-train`, or let it go on from its last checkpoint; returns its policy folder.

    Raises:
        InputError: the checkpoint to go on from wishes something that no policy folder may.
        TrainingError: it ended with an error; the last words are in the message.
    """
    require("LeRobot's training", "lerobot")
    last = folder / "checkpoints" / "last"
    policy = last / "pretrained_model"
    step = last / "training_state" / "training_step.json"
    for place in (folder, folder / "checkpoints"):
        not_a_link(place)  # it is written to, and old checkpoints in it are deleted
    resumes = step.is_file()
    if resumes:
        done: _Step = validated(_Step, folder_data.read(folder, str(step.relative_to(folder))))
        kept = folder_data.training_settings(policy)
        if done.step >= config.steps:
            return policy
    features = folder_data.dataset_folder(dataset).features
    command = [sys.executable, "-m", "lerobot.scripts.lerobot_train"]
    arguments = training_arguments(dataset, features, config, folder)
    if resumes:
        kept["policy"]["push_to_hub"] = False
        folders.write_text(policy / RESUMED, json.dumps(kept))
        command += [f"--config_path={policy / RESUMED}", "--resume=true"]
        arguments = [a for a in arguments if not a.startswith("--policy.")]
    else:
        shutil.rmtree(folder, ignore_errors=True)
    command += arguments
    folder.parent.mkdir(parents=True, exist_ok=True)
    said: list[str] = []
    around = {k: v for k, v in os.environ.items() if k != "HF_HUB_OFFLINE" or not config.download}
    watched = guarded(command, Limits(math.inf, math.inf))  # it ends with us, however we end
    with subprocess.Popen(
        watched, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace",
        env=around,
    ) as process:  # fmt: skip
        try:
            for line in process.stdout or ():
                said = [*said[-30:], line.rstrip()]
                found = re.search(r"step:([\d.]+)([KM]?) .*loss:([\d.]+)", line)
                if found:
                    size = {"": 1, "K": 1e3, "M": 1e6}[found[2]]
                    share = float(found[1]) * size / config.steps
                    update(min(share, 1.0), f"loss {found[3]}")
                    _keep_last(folder / "checkpoints")
        except BaseException:  # stopped: waiting for its end would take hours
            process.terminate()
            raise
    _keep_last(folder / "checkpoints")
    if process.returncode != 0 or not policy.is_dir():
        words = next((s for s in reversed(said) if s.strip()), "it said nothing")
        raise TrainingError(f"lerobot-train ended with status {process.returncode}: {words}")
    return policy


def _keep_last(checkpoints: Path) -> None:
    """Delete what is older than the checkpoint to go on from: one may take gigabytes."""
    last = checkpoints / "last"
    newest = int(last.resolve().name) if last.exists() else 0
    for folder in checkpoints.glob("[0-9]*"):
        if int(folder.name) < newest:
            shutil.rmtree(folder, ignore_errors=True)


def training_arguments(
    dataset: Path, features: Mapping[str, Any], config: LeRobotTraining, folder: Path
) -> list[str]:
    """Arguments of lerobot-train for a dataset with these features."""
    seen: dict[str, dict[str, Any]] = {}
    for name, feature in features.items():
        shape = list(feature.shape)
        if name == "observation.state":
            seen[name] = {"type": "STATE", "shape": shape}
        elif name.startswith(IMAGES) and config.cameras:
            seen[name] = {"type": "VISUAL", "shape": [shape[2], shape[0], shape[1]]}
        elif name == "observation.environment_state" and not config.cameras:
            seen[name] = {"type": "ENV", "shape": shape}
    out = [
        config.policy, f"--policy.input_features={json.dumps(seen)}", "--policy.push_to_hub=false",
        f"--dataset.repo_id={REPO_ID}", f"--dataset.root={dataset}", f"--output_dir={folder}",
        f"--steps={config.steps}", f"--batch_size={config.batch}", f"--seed={config.seed}",
        f"--save_freq={max(config.steps // 10, 1)}", f"--log_freq={max(config.steps // 200, 1)}",
        "--wandb.enable=false",
    ]  # fmt: skip
    if not torch.cuda.is_available():
        out += ["--policy.device=cpu", "--num_workers=0"]
    return [*out, *config.more]
