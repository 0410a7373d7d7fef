"""A run: the folder that training leaves and evaluation reads. Weights are safetensors, no code.

run.json             algorithm, environment, sizes, names of the inputs, versions, results
policy.safetensors   weights and observation statistics
checkpoint/          what a killed run goes on from
"""

from __future__ import annotations

import gc
import json
import math
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from mam_envs.config import EnvConfig
from mam_pipeline import config_file, folder_data, folders
from mam_pipeline.claims import RUN, RUN_BEGUN, claim_folder, instead
from mam_pipeline.edited import (
    STRICT,
    Document,
    Index,
    Range,
    Word,
    check_ranges,
    shown,
    validated,
)
from mam_pipeline.errors import ConfigError, MamSimError
from mam_policies.settings import ALGORITHMS

ENV_ID = "mam_envs:OperateJoint-v1"
SCHEMA = 1
MOST_ASSETS = 10_000


@dataclass(frozen=True)
class EnvChoice:
    """Which environment a policy lives in; everything that gym.make needs.

    Attributes:
        assets: asset folders (one or several; several are drawn anew at every reset).
        config: settings of success, reward, randomisation and scene.
    """

    assets: tuple[str, ...]
    joint: str | None = None
    task: str | None = None
    robot: str = "panda"
    control_mode: str = "pd_joint_pos"
    max_steps: Annotated[int, Range(1, 100_000)] = 200
    config: EnvConfig = field(default_factory=EnvConfig)

    def make(self, **more: Any) -> Any:
        """The gym environment (one sub-scene, flat state observations unless told otherwise)."""
        import mam_envs  # noqa: F401 - registers the environment

        arguments: dict[str, Any] = {
            "asset": list(self.assets) if len(self.assets) > 1 else self.assets[0],
            "joint": self.joint,
            "task": self.task,
            "robot_uids": self.robot,
            "control_mode": self.control_mode,
            "config": self.config,
            "obs_mode": "state",
            "max_episode_steps": self.max_steps,
        }
        return gym.make(ENV_ID, **{**arguments, **more})


Entry = tuple[Word, Index, Index, bool]
"""Rows of the flat observation: name, start, stop, and whether only the simulator knows it."""


@dataclass(frozen=True)
class _RunFile:
    """run.json as it must be, before the names in it are looked up."""

    __pydantic_config__ = STRICT
    schema: Literal[1]
    algo: Word
    env: dict[str, Any]
    observation: Annotated[list[Entry], Field(max_length=1000)]
    action_dim: Annotated[int, Range(1, 1000)]
    arm_joints: Annotated[int, Range(1, 100)]
    config: dict[str, Any] = field(default_factory=dict)
    results: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class RunInfo:
    """run.json as data."""

    algo: str
    env: EnvChoice
    observation: list[Entry]
    action_dim: int
    arm_joints: int
    config: dict[str, Any] = field(default_factory=dict)
    results: dict[str, Any] = field(default_factory=dict)
    schema: int = SCHEMA

    def save(self, folder: Path) -> None:
        """Write run.json, all or nothing; a picture that its cameras see is kept beside it."""
        data = asdict(self)
        scene = data["env"]["config"]["scene"]
        if scene["background"] is not None:
            picture = Path(scene["background"])
            scene["background"] = f"background{picture.suffix.lower()}"
            if picture.resolve() != (folder / scene["background"]).resolve():
                shutil.copyfile(picture, folder / scene["background"])
        text = json.dumps(finite(data), indent=1, default=str, allow_nan=False)
        folders.write_text(folder / "run.json", text + "\n")

    @staticmethod
    def load(folder: str | Path) -> RunInfo:
        """Read a run folder; nothing in it is imported, and names are those of our tables.

        Raises:
            InputError: no run there, of another schema, or with something that no run has.
            ConfigError: an algorithm, robot, task or setting that is not known here.
        """
        where = Path(folder)
        missing = f"no run.json in {folder}{instead(where)}; make one with: mam-sim train"
        document = folder_data.read(where, "run.json", missing)
        told: _RunFile = validated(_RunFile, document)
        ALGORITHMS.check(told.algo)
        task = told.env.get("task")
        if task is not None and not isinstance(task, str):
            raise document.wrong(("env", "task"), f"must be text, not {shown(task)}")
        start = EnvChoice((), config=task_settings(task))
        choice = config_file.fill(start, told.env, document.source)
        _check_choice(choice, document)
        for i, (_, first, last, _) in enumerate(told.observation):
            if last < first:
                raise document.wrong(("observation", i), "must not end before it begins")
        if choice.config.scene.background is not None:
            picture = folder_data.file_of(where, choice.config.scene.background)
            scene = replace(choice.config.scene, background=str(picture))
            choice = replace(choice, config=replace(choice.config, scene=scene))
        return RunInfo(**{**vars(told), "env": choice})


@dataclass(frozen=True)
class _Split:
    """split.json: asset folders that were trained on, refused, and held out."""

    __pydantic_config__ = STRICT
    train: list[str]
    held_out: Annotated[list[str], Field(max_length=MOST_ASSETS)]
    refused: list[str] = field(default_factory=list)


def held_out(run: Path) -> tuple[str, ...]:
    """Asset folders that a run did not see.

    Raises:
        InputError: it held none out, or its split.json is none.
    """
    missing = f"{run} held no assets out; train it with --split"
    split: _Split = validated(_Split, folder_data.read(run, "split.json", missing))
    return tuple(split.held_out)


def finite(value: Any) -> Any:
    """Plain data in which a number that is none (a loss that diverged) is None."""
    if isinstance(value, dict):
        return {key: finite(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _check_choice(choice: EnvChoice, document: Document) -> None:
    """Raise InputError or ConfigError where an environment has a name or number that cannot be."""
    from mam_envs.robots import ROBOTS

    ROBOTS.check(choice.robot)
    check_ranges(choice, f"{document.source}: env.")
    if not 1 <= len(choice.assets) <= MOST_ASSETS:
        raise document.wrong(("env", "assets"), f"must be 1 to {MOST_ASSETS} asset folders")
    for i, name in enumerate(choice.assets):
        if not name or "\0" in name or len(name) > 4096 or _is_no_folder(name):
            text = f"must name an asset folder, which {shown(name)} is not"
            raise document.wrong(("env", "assets", i), text)
    if not re.fullmatch(r"pd_[a-z_]{1,60}", choice.control_mode):
        said = shown(choice.control_mode)
        raise document.wrong(("env", "control_mode"), f"must be pd_joint_pos or alike, not {said}")


def _is_no_folder(name: str) -> bool:
    """Whether something else than a folder (a device, a pipe, a file) has that name."""
    return os.path.exists(name) and not os.path.isdir(name)


def task_settings(task: str | None) -> EnvConfig:
    """Defaults of the environment; a task may have settings of its own."""
    if task is None:
        return EnvConfig()
    from mam_envs.tasks import task_class

    return task_class([task]).defaults()


def refuse_foreign(out: Path) -> None:
    """Refuse a folder that holds something else than a run.

    Raises:
        ConfigError: it does, or `out` is a file.
    """
    folders.sweep(out / "settings.txt")  # a run that was killed as it began leaves no claim
    claim_folder(out, RUN, RUN_BEGUN)


def claim(out: Path, choice: EnvChoice, settings: str) -> None:
    """Make the run folder and write down whose it is; runs of two settings are not mixed.

    Raises:
        ConfigError: the folder belongs to another run.
    """
    refuse_foreign(out)
    out.mkdir(parents=True, exist_ok=True)
    mine = f"{json.dumps(asdict(choice), sort_keys=True, default=str)} {settings}"
    note = out / "settings.txt"
    if note.is_file() and note.read_text(encoding="utf-8") != mine:
        raise ConfigError(f"{out} holds a run with other settings; name another --out")
    folders.write_text(note, mine)


@contextmanager
def few_objects() -> Iterator[None]:
    """Make rebuilding a scene cheaper: ManiSkill collects garbage each time, and walks through
    every object that the libraries have made unless they are set aside first."""
    gc.collect()
    gc.freeze()
    try:
        yield
    finally:
        gc.unfreeze()


def flat(obs: Any) -> NDArray[np.float32]:
    """A batched flat observation as (n,) float32."""
    return np.asarray(obs, dtype=np.float32).reshape(-1)


def describe_env(env: Any) -> dict[str, Any]:
    """Sizes of an environment for RunInfo: observation rows, action and arm dimensions."""
    base = env.unwrapped
    return {
        "observation": base.observation_layout(),
        "action_dim": int(np.prod(env.action_space.shape)),
        "arm_joints": len(base.robot_spec.arm),
    }


class TrainingError(MamSimError):
    """Training cannot go on: the expert fails, or nothing was learned."""

    exit_code = 1
