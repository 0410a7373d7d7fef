"""What can be plugged in from outside, for `mam-sim doctor`: found, version, licence, how."""

from __future__ import annotations

import os
import socket
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from urllib.parse import urlparse

from mam_pipeline.models import consent, settings
from mam_pipeline.optional import has, install_command
from mam_pipeline.registry import Registry
from mam_pipeline.secrets import bare_url


@dataclass(frozen=True)
class Found:
    """Whether a model can be used, and its version as far as it tells."""

    ok: bool
    text: str


@dataclass(frozen=True)
class Model:
    """One model outside mam-sim.

    Attributes:
        flag: how it is chosen. variable: of the runner or server.
        look: looks for it; a server is only knocked at, nothing is sent.
        licence: what binds who uses it. page: of the set-up. commands: to get it.
    """

    name: str
    flag: str
    variable: str
    look: Callable[[], Found]
    licence: str
    page: str
    commands: tuple[str, ...]


def models() -> tuple[Model, ...]:
    """The language model, and what other packages list in the entry-point group `mam_sim.models`.

    Raises:
        BackendError: a package's list cannot be imported.
    """
    lists = Registry("list of models", {}, "mam_sim.models")
    return (*(model for name in lists.targets() for model in lists.load(name)), ENDPOINT)


def _endpoint() -> Found:
    if not has("openai"):
        return Found(False, "the openai package is not installed")
    package = f"openai {metadata.version('openai')}"
    url = settings.text("OPENAI_BASE_URL")
    if not url and not os.environ.get("OPENAI_API_KEY"):
        return Found(False, f"{package}; neither OPENAI_API_KEY nor OPENAI_BASE_URL is set")
    model = settings.text("MAM_SIM_VLM_MODEL", "gpt-4o")
    if url and not knock(url):
        return Found(False, f"{package}, {model}: {bare_url(url)} does not answer")
    offer = consent.model_offer()
    who = f"{model} at {bare_url(url) or 'api.openai.com'}" if offer is None else offer.who
    if consent.allowed(who, "MAM_SIM_ALLOW_MODEL"):
        auto = "auto asks it"
    else:
        auto = "auto does not ask it" if consent.forbidden(who) else "auto asks you first"
    return Found(True, f"{package}, {who}; {auto}")


def knock(url: str) -> bool:
    """Whether something listens at a URL's host and port."""
    place = urlparse(url)
    port = place.port or (443 if place.scheme == "https" else 80)
    try:
        with socket.create_connection((place.hostname or "", port), timeout=2):
            return True
    except OSError:
        return False


ENDPOINT = Model(
    "vision-language model", "--reasoner vlm", "OPENAI_BASE_URL", _endpoint, "the endpoint's terms",
    "docs/guides/foundation-models.md",
    (
        install_command("openai"),
        "export OPENAI_API_KEY=...   or   --vlm-url http://localhost:11434/v1 --vlm-model NAME",
    ),
)  # fmt: skip
