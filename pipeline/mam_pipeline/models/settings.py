"""What the user says about external models, read from the environment in one place."""

from __future__ import annotations

import os
import shlex
from dataclasses import dataclass
from pathlib import Path

from mam_pipeline.errors import ConfigError

DOCS = {
    "MAM_SIM_P3SAM": "command or http(s) URL of a P3-SAM runner (docs/models.md)",
    "MAM_SIM_SP4D": "command or http(s) URL of an SP4D runner (docs/models.md)",
    "MAM_SIM_PRIOR_FILE": "folder with kinematic masks written by anybody (docs/models.md)",
    "MAM_SIM_HUNYUAN3D": "http(s) URL of a Hunyuan3D-2 or 2.1 server (docs/models.md)",
    "MAM_SIM_TRIPOSR": "command or http(s) URL of a TripoSR runner (docs/models.md)",
    "MAM_SIM_TRIPOSG": "command or http(s) URL of a TripoSG runner (docs/models.md)",
    "MAM_SIM_TIMEOUT": "seconds that one call of an external model may take (default 900)",
    "MAM_SIM_VLM_MODEL": "name of the vision-language model (default gpt-4o)",
    "MAM_SIM_VLM_IMAGES": "most images that the endpoint takes in one question (default 12)",
    "MAM_SIM_MAX_COST": "US dollars that one run may spend on questions (default 1.00)",
    "MAM_SIM_VLM_CACHE": "folder of answers, by content (default ~/.cache/mam-sim/answers)",
    "MAM_SIM_QUESTIONS": "folder for the file reasoner's questions and answers",
    "MAM_SIM_WAIT": "seconds that the file reasoner waits for an answer (default 0)",
}


@dataclass(frozen=True)
class Runner:
    """Where a model answers: a URL, or a command to which arguments are appended."""

    url: str | None = None
    command: tuple[str, ...] = ()


def runner(variable: str) -> Runner | None:
    """The runner named in an environment variable; None where it is not set."""
    value = os.environ.get(variable, "").strip()
    if not value:
        return None
    if value.startswith(("http://", "https://")):
        return Runner(url=value.rstrip("/"))
    return Runner(command=tuple(shlex.split(value)))


def number(variable: str, default: float) -> float:
    """A positive number from the environment.

    Raises:
        ConfigError: it is set to something else.
    """
    text = os.environ.get(variable, "").strip()
    if not text:
        return default
    try:
        value = float(text)
    except ValueError:
        value = -1.0
    if value < 0:
        raise ConfigError(f"{variable} must be a number that is not negative, got {text!r}")
    return value


def folder(variable: str, default: Path | None = None) -> Path | None:
    """A folder from the environment."""
    text = os.environ.get(variable, "").strip()
    return Path(text).expanduser() if text else default
