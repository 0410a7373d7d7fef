"""A stable-baselines3 zip from elsewhere, behind a flag: such files hold pickles, which run code.

Our own runs are safetensors and need no trust. A user's own training leaves a zip; with
trust given, it is tried on our assets like any policy.
"""

from __future__ import annotations

import json
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from mam_pipeline.errors import ConfigError, InputError
from mam_pipeline.optional import require
from mam_policies.run import flat

ALGORITHMS = ("PPO", "SAC", "TD3", "DDPG", "A2C", "DQN")


def algorithm_of(file: Path) -> str:
    """Which algorithm wrote a zip, from its plain text alone; nothing is unpickled.

    Raises:
        InputError: it is no zip of stable-baselines3.
    """
    try:
        with zipfile.ZipFile(file) as archive:
            data = json.loads(archive.read("data"))
    except (OSError, KeyError, ValueError, zipfile.BadZipFile) as error:
        raise InputError(f"{file} is no zip of stable-baselines3: {error}") from error
    text = json.dumps(data)
    if "log_ent_coef" in data or "ent_coef_optimizer" in text:
        return "SAC"
    if "n_epochs" in data:
        return "PPO"
    found = [name for name in ALGORITHMS if f"stable_baselines3.{name.lower()}." in text]
    if not found:
        raise InputError(f"{file} does not say which algorithm wrote it")
    return found[0]


def load_sb3(file: Path, trust: bool) -> Callable[[Any], Any]:
    """The policy in a zip as a function from our observation to an action.

    Raises:
        ConfigError: without `trust`. InputError: no such zip.
    """
    if not trust:
        raise ConfigError(
            f"{file} is a zip of stable-baselines3, which executes code when it is loaded; "
            "add --trust if you know where it comes from"
        )
    require("a policy of Stable-Baselines3", "stable_baselines3")
    import stable_baselines3 as sb3

    model = getattr(sb3, algorithm_of(file)).load(file, device="cpu")

    def act(obs: Any) -> Any:
        state = flat(obs["state"] if isinstance(obs, dict) else obs)
        return np.asarray(model.predict(state, deterministic=True)[0], dtype=np.float32)

    return act
