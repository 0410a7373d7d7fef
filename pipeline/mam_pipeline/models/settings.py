"""What the user says about external models: flags for one run, else the environment's variables."""

from __future__ import annotations

import hashlib
import os
import shlex
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path

from mam_pipeline.errors import ConfigError
from mam_pipeline.secrets import Secret, bare_url

DOCS = {
    "MAM_SIM_P3SAM": "command or http(s) URL of a P3-SAM runner",
    "MAM_SIM_SP4D": "command or http(s) URL of an SP4D runner",
    "MAM_SIM_PRIOR_FILE": "folder with kinematic masks written by anybody",
    "MAM_SIM_HUNYUAN3D": "http(s) URL of a Hunyuan3D-2 or 2.1 server",
    "MAM_SIM_HUNYUAN3D_TEXTURE": "0 for a server of 2.0 that was started without --enable_tex",
    "MAM_SIM_TRIPOSR": "command or http(s) URL of a TripoSR runner",
    "MAM_SIM_TRIPOSG": "command or http(s) URL of a TripoSG runner",
    "FAL_KEY": "key of fal.ai, for --reconstructor fal",
    "TRIPO_API_KEY": "key of Tripo, for --reconstructor tripo",
    "MESHY_API_KEY": "key of Meshy, for --reconstructor meshy",
    "MAM_SIM_SPACE": "Gradio Space (owner/name or URL) of --reconstructor space",
    "MAM_SIM_SPACE_API": "its endpoint that makes a mesh of a picture, where several do",
    "HF_TOKEN": "token of Hugging Face, for a Space that is private or has a quota",
    "MAM_SIM_HOSTED_MODEL": "model of the hosted reconstructor, as its service names it",
    "MAM_SIM_HOSTED_PRICE": "US dollars of one mesh, where we do not know them",
    "MAM_SIM_ALLOW_UPLOAD": "1: photos may be sent to the hosted reconstructor that is named",
    "MAM_SIM_ALLOW_MODEL": "1: `auto` asks the language model that is configured, without asking",
    "MAM_SIM_MESH_CACHE": "folder of meshes that were paid (default ~/.cache/mam-sim/meshes)",
    "MAM_SIM_TIMEOUT": "seconds that one call of an external model may take (default 900)",
    "MAM_SIM_VLM_MODEL": "name of the vision-language model (default gpt-4o)",
    "MAM_SIM_VLM_IMAGES": "most images that the endpoint takes in one question (default 16)",
    "MAM_SIM_VLM_SIMPLE": "pieces up to which parts and motions are one question (default 24)",
    "MAM_SIM_VLM_ROUNDS": "looks at the moving object, 0 to 2 (default 2)",
    "MAM_SIM_VLM_PRICE": "US dollars per million tokens in,out where we do not know them",
    "MAM_SIM_IMAGE_MODEL": "model that makes a picture of words for --retexture",
    "MAM_SIM_MAX_COST": "US dollars that one run may spend on models (default 1.00)",
    "MAM_SIM_VLM_CACHE": "folder of answers, by content (default ~/.cache/mam-sim/answers)",
    "MAM_SIM_QUESTIONS": "folder for the file reasoner's questions and answers",
    "MAM_SIM_WAIT": "seconds that the file reasoner waits for an answer (default 0)",
}


@dataclass(frozen=True)
class Runner:
    """Where a model answers: a URL, or a command to which arguments are appended."""

    url: str | None = None
    command: tuple[str, ...] = ()


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


def runner(variable: str) -> Runner | None:
    """The runner that was set; None where none was."""
    value = text(variable)
    if not value:
        return None
    if value.startswith(("http://", "https://")):
        return Runner(url=value.rstrip("/"))
    return Runner(command=tuple(shlex.split(value)))


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
