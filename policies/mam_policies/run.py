"""A run: the folder that training leaves and evaluation reads. Weights are safetensors, no code.

run.json             algorithm, environment, sizes, names of the inputs, versions, results
policy.safetensors   weights and observation statistics
checkpoint/          what a killed run goes on from
"""

from __future__ import annotations

import gc
import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from mam_envs.config import EnvConfig
from mam_pipeline import config_file, folders
from mam_pipeline.errors import ConfigError, InputError, MamSimError

ENV_ID = "mam_envs:OperateJoint-v1"
SCHEMA = 1


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
    max_steps: int = 200
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


@dataclass(frozen=True)
class RunInfo:
    """run.json as data."""

    algo: str
    env: EnvChoice
    observation: list[tuple[str, int, int, bool]]
    action_dim: int
    arm_joints: int
    config: dict[str, Any] = field(default_factory=dict)
    results: dict[str, Any] = field(default_factory=dict)
    schema: int = SCHEMA

    def save(self, folder: Path) -> None:
        """Write run.json, all or nothing."""
        text = json.dumps(asdict(self), indent=1, default=str)
        folders.write_text(folder / "run.json", text + "\n")

    @staticmethod
    def load(folder: str | Path) -> RunInfo:
        """Read a run folder.

        Raises:
            InputError: no run there, or of another schema.
        """
        file = Path(folder) / "run.json"
        if not file.is_file():
            raise InputError(f"{folder} is no run (no run.json); make one with: mam-sim train")
        try:
            data = json.loads(file.read_text())
            if data.get("schema") != SCHEMA:
                raise InputError(f"{file} has schema {data.get('schema')!r}; this is {SCHEMA}")
            start = EnvChoice((), config=task_settings(data["env"].get("task")))
            data["env"] = config_file.fill(start, data["env"], file)
            data["observation"] = [tuple(row) for row in data["observation"]]
            return RunInfo(**data)
        except (ValueError, TypeError, KeyError) as error:
            raise InputError(f"{file} is not a run of mam-sim: {error}") from error


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
    ours = ("settings.txt", "run.json", "demos", "data")
    if out.is_dir() and any(out.iterdir()) and not any((out / n).exists() for n in ours):
        raise ConfigError(f"{out} is not empty and holds no run; name another --out")
    if out.exists() and not out.is_dir():
        raise ConfigError(f"{out} is a file; --out names a folder")


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
