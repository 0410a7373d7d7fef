"""What the user says about external models: flags for one run, else the environment's variables."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path

from mam_pipeline.errors import ConfigError
from mam_pipeline.secrets import Secret, bare_url


@dataclass(frozen=True)
class ModelConfig:
    """Models outside mam-sim; what is given here goes before the MAM_SIM_ variables."""

    questions: Path | None = None
    """Folder where `--reasoner file` writes its questions and finds the answers."""
    wait: float | None = None
    """Seconds that `--reasoner file` waits for an answer (0: end with status 3)."""
    vlm_model: str | None = None
    """Name of the vision-language model of `--reasoner vlm` (gpt-4o)."""
    vlm_url: str | None = None
    """OpenAI-compatible endpoint of `--reasoner vlm`; the key stays in OPENAI_API_KEY."""
    vlm_images: int | None = None
    """Most pictures that the endpoint takes in one question (16); more are combined."""
    max_cost: float | None = None
    """US dollars that this run may spend on questions and hosted meshes (1.00)."""
    allow_upload: bool = False
    """Send the photo to the hosted reconstructor that is named, without asking."""
    hosted_model: str | None = None
    """Model of the hosted reconstructor, as its service names it."""
    space: str | None = None
    """Gradio Space of `--reconstructor space`: owner/name, or a URL."""
    space_api: str | None = None
    """Endpoint of the Space that makes a mesh of a picture, where several do."""
    prior_file: Path | None = None
    """Folder with the masks.npz of `--prior file`."""
    timeout: float | None = None
    """Seconds that one call of a model may take (900)."""

    def settings(self) -> dict[str, str]:
        """What was given, by the name of its environment variable."""
        table = {
            "MAM_SIM_QUESTIONS": self.questions,
            "MAM_SIM_WAIT": self.wait,
            "MAM_SIM_VLM_MODEL": self.vlm_model,
            "OPENAI_BASE_URL": self.vlm_url,
            "MAM_SIM_VLM_IMAGES": self.vlm_images,
            "MAM_SIM_MAX_COST": self.max_cost,
            "MAM_SIM_ALLOW_UPLOAD": "1" if self.allow_upload else None,
            "MAM_SIM_HOSTED_MODEL": self.hosted_model,
            "MAM_SIM_SPACE": self.space,
            "MAM_SIM_SPACE_API": self.space_api,
            "MAM_SIM_PRIOR_FILE": self.prior_file,
            "MAM_SIM_TIMEOUT": self.timeout,
        }
        return {name: str(value) for name, value in table.items() if value is not None}


_GIVEN: ContextVar[Mapping[str, str] | None] = ContextVar("mam_sim_settings", default=None)
SUBJECT = "MAM_SIM_SUBJECT"


@contextmanager
def given(values: Mapping[str, str | None]) -> Iterator[None]:
    """Settings that go before the environment's while the block runs; None leaves one as it is."""
    known = {name: value for name, value in values.items() if value is not None}
    token = _GIVEN.set({**(_GIVEN.get() or {}), **known})
    try:
        yield
    finally:
        _GIVEN.reset(token)


def text(variable: str, default: str = "") -> str:
    """A setting: what was `given`, or the environment's."""
    said = ((_GIVEN.get() or {}).get(variable) or os.environ.get(variable, "")).strip()
    bare_url(said)  # what a URL holds of secrets is masked from now on
    return said or default


def secret(variable: str) -> Secret:
    """A key that was set."""
    return Secret(text(variable))


def content_digest(place: Path | None, name: str) -> str:
    """SHA-256 of all files of a name in a folder that was set (of this subject's, if one is)."""
    digest = hashlib.sha256()
    for file in [] if place is None else sorted((place / text(SUBJECT)).rglob(name)):
        digest.update(file.read_bytes())
    return digest.hexdigest()


def number(variable: str, default: float) -> float:
    """A number that was set, not negative.

    Raises:
        ConfigError: it is set to something else.
    """
    said = text(variable)
    if not said:
        return default
    try:
        value = float(said)
    except ValueError:
        value = -1.0
    if value < 0:
        raise ConfigError(f"{variable} must be a number that is not negative, got {said!r}")
    return value


def folder(variable: str, default: Path | None = None) -> Path | None:
    """A folder that was set."""
    said = text(variable)
    return Path(said).expanduser() if said else default
