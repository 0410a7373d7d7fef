"""Assets bound to environment ids, so that code which knows nothing of mam-sim takes them by name.

`register` binds an id in this process. `remember` writes it down, too: whatever imports mam_envs
finds it from then on, as gymnasium does for an id "mam_envs:Nightstand-v1".
"""

from __future__ import annotations

import json
import os
import re
import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import gymnasium as gym
from gymnasium.envs.registration import WrapperSpec

from mam_pipeline import folders
from mam_pipeline.errors import ConfigError

VARIABLE = "MAM_SIM_ENVIRONMENTS"
"""Environment variable that names the file of ids."""
DEFAULT = "~/.config/mam-sim/environments.json"
MAX_EPISODE_STEPS = 200
OURS = "OperateJoint"
"""The name of the environment in which nothing is bound."""


def register(
    asset: str | Path | Sequence[str | Path],
    id: str,
    max_episode_steps: int | None = None,
    **arguments: Any,
) -> str:
    """Bind an asset to an environment id in this process, for gym.make and all that calls it.

    Beside `Nightstand-v1` (ManiSkill's batched tensors), `NightstandNumpy-v1` gives NumPy
    arrays without a batch, as gymnasium's and Stable-Baselines3's tools take them.

    Args:
        asset: asset folder, or a folder that holds some, or a list: of several, one is drawn for
            every episode.
        id: as Nightstand-v1. max_episode_steps: default: the task's.
        arguments: of OperateJoint-v1 (joint, task, robot_uids, config ...).

    Returns:
        The id by which code in other processes finds it, once `remember` wrote it down.

    Raises:
        InputError: no asset there. ConfigError: an id that gymnasium does not take.
    """
    from mam_envs.tasks import episode_steps
    from mam_pipeline.asset.listing import asset_folders

    check_id(id)
    steps = max_episode_steps or episode_steps(
        arguments.get("task"), arguments.get("joint"), arguments.get("robot_uids", "panda")
    )
    given = [asset] if isinstance(asset, str | Path) else list(asset)
    found = [str(folder) for folder in asset_folders([Path(p) for p in given])]
    bind(id, {"asset": found[0] if len(found) == 1 else found, **arguments}, steps)
    return f"mam_envs:{id}"


def remember(id: str, arguments: Mapping[str, Any], max_episode_steps: int) -> Path:
    """Write an id down in the user's file of ids, over one of the same name; returns the file."""
    check_id(id)
    file = _file()
    entries = {**_entries(file), id: {**arguments, "max_episode_steps": max_episode_steps}}
    file.parent.mkdir(parents=True, exist_ok=True)
    folders.write_text(file, json.dumps(entries, indent=1) + "\n")
    return file


def bind_remembered() -> None:
    """Bind what the user's file of ids holds; what cannot be read there is a warning."""
    try:
        entries = _entries(_file())
    except ConfigError as error:
        warnings.warn(str(error), stacklevel=2)
        return
    for name, arguments in entries.items():
        bind(name, arguments)


def bind(
    name: str, arguments: Mapping[str, Any], max_episode_steps: int = MAX_EPISODE_STEPS
) -> None:
    """Tell gymnasium of an id and of its NumPy twin; no simulator is loaded."""
    given = dict(arguments)
    steps = int(given.pop("max_episode_steps", max_episode_steps))
    limit = WrapperSpec(
        "BatchedTimeLimit",
        entry_point="mam_envs.time_limit:BatchedTimeLimit",
        kwargs={"max_episode_steps": steps},
    )
    twin = numpy_id(name)
    for each in (name, twin):
        gym.registry.pop(each, None)  # said anew, it takes the place of what was bound
    gym.register(
        name,
        entry_point="mam_envs.env:OperateJointEnv",
        max_episode_steps=steps,
        disable_env_checker=True,
        additional_wrappers=(limit,),
        kwargs=given,
    )
    gym.register(
        twin, entry_point="mam_envs.numpy_env:SingleEnv", max_episode_steps=steps, kwargs=given
    )


def numpy_id(name: str) -> str:
    """The id of the NumPy twin: Nightstand-v1 has NightstandNumpy-v1."""
    stem, _, version = name.rpartition("-v")
    return f"{stem}Numpy-v{version}"


def check_id(name: str) -> None:
    """Raise ConfigError where gymnasium would not take it, or where it is ours."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*-v\d+", name):
        raise ConfigError(
            f"an environment id is a name and a version, as Nightstand-v1; not {name!r}"
        )
    if name.startswith(OURS):
        raise ConfigError(
            f"ids that begin with {OURS} are mam-sim's own; take another than {name!r}"
        )


def _file() -> Path:
    return Path(os.environ.get(VARIABLE) or DEFAULT).expanduser()


def _entries(file: Path) -> dict[str, dict[str, Any]]:
    """What a file of ids holds; {} where there is none.

    Raises:
        ConfigError: it is no such file.
    """
    if not file.is_file():
        return {}
    try:
        found = json.loads(file.read_text(encoding="utf-8"))
        for name, arguments in found.items():
            check_id(name)
            int(arguments.get("max_episode_steps", 1))
    except (OSError, ValueError, AttributeError, TypeError, ConfigError) as error:
        raise ConfigError(f"{file} is no file of environment ids ({error}); delete it") from error
    return dict(found)
