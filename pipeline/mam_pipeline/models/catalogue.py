"""What can be plugged in from outside, for `mam-sim doctor`: found, version, licence, how."""

from __future__ import annotations

import os
import shutil
import socket
import subprocess
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from urllib.parse import urlparse

from mam_pipeline.models import consent, settings
from mam_pipeline.models.hosted import SERVICES
from mam_pipeline.models.space import SpaceReconstructor
from mam_pipeline.optional import has, install_command
from mam_pipeline.secrets import bare_url

RUNNERS = Path(__file__).resolve().parent / "runners"


@dataclass(frozen=True)
class Model:
    """One model outside mam-sim.

    Attributes:
        flag: how it is chosen. variable: of the runner or server. home: of its checkout.
        licence: what binds who uses it. page: of the set-up. commands: to get it.
    """

    name: str
    flag: str
    variable: str
    home: str
    licence: str
    page: str
    commands: tuple[str, ...]


@dataclass(frozen=True)
class Found:
    """Whether a model can be used, and its version as far as it tells."""

    ok: bool
    text: str


TENCENT = "Tencent Hunyuan community licence: not in the EU, the UK and South Korea"
MODELS = (
    Model(
        "P3-SAM", "--segmenter p3sam", "MAM_SIM_P3SAM", "P3SAM_HOME",
        "Tencent Hunyuan 3D-Part licence: not in the EU, the UK and South Korea",
        "docs/guides/foundation-models.md",
        (
            "git clone https://github.com/Tencent-Hunyuan/Hunyuan3D-Part",
            "export P3SAM_HOME=$PWD/Hunyuan3D-Part",
            f'export MAM_SIM_P3SAM="<its python> {RUNNERS / "p3sam.py"}"',
        ),
    ),
    Model(
        "SP4D", "--prior sp4d", "MAM_SIM_SP4D", "SP4D_HOME",
        "Stability AI Community License: free below US$ 1 M of yearly revenue",
        "docs/guides/foundation-models.md",
        (
            "git clone -b sp4d https://github.com/Stability-AI/generative-models",
            "export SP4D_HOME=$PWD/generative-models",
            f'export MAM_SIM_SP4D="<its python> {RUNNERS / "sp4d.py"}"',
        ),
    ),
    Model(
        "Hunyuan3D", "--reconstructor hunyuan3d, --retexture", "MAM_SIM_HUNYUAN3D", "",
        f"{TENCENT}, outputs included", "docs/guides/foundation-models.md",
        (
            "git clone https://github.com/Tencent-Hunyuan/Hunyuan3D-2",
            "python api_server.py --port 8081 --enable_tex   (in its environment)",
            "export MAM_SIM_HUNYUAN3D=http://localhost:8081",
        ),
    ),
    Model(
        "TripoSR", "--reconstructor triposr", "MAM_SIM_TRIPOSR", "TRIPOSR_HOME", "MIT",
        "docs/guides/foundation-models.md",
        (
            "git clone https://github.com/VAST-AI-Research/TripoSR",
            "export TRIPOSR_HOME=$PWD/TripoSR",
            f'export MAM_SIM_TRIPOSR="<its python> {RUNNERS / "tripo.py"} triposr"',
        ),
    ),
    Model(
        "TripoSG", "--reconstructor triposg", "MAM_SIM_TRIPOSG", "TRIPOSG_HOME",
        "MIT; its default matting (RMBG-1.4) has BRIA's terms, our runner uses rembg",
        "docs/guides/foundation-models.md",
        (
            "git clone https://github.com/VAST-AI-Research/TripoSG",
            "export TRIPOSG_HOME=$PWD/TripoSG",
            f'export MAM_SIM_TRIPOSG="<its python> {RUNNERS / "tripo.py"} triposg"',
        ),
    ),
)  # fmt: skip
HOSTED = tuple(
    Model(
        service.title, f"--reconstructor {service.name}", service.key, "", service.licence,
        "docs/guides/foundation-models.md", (f"export {service.key}=...   (from {service.page})",),
    )
    for service in SERVICES
)  # fmt: skip
SPACE = Model(
    "Gradio Space", "--reconstructor space", "MAM_SIM_SPACE", "", "the Space's and its model's",
    "docs/guides/foundation-models.md",
    (install_command("gradio_client"), "export MAM_SIM_SPACE=OWNER/NAME   (or a URL)"),
)  # fmt: skip
ENDPOINT = Model(
    "vision-language model", "--reasoner vlm", "OPENAI_BASE_URL", "", "the endpoint's terms",
    "docs/guides/foundation-models.md",
    (
        install_command("openai"),
        "export OPENAI_API_KEY=...   or   --vlm-url http://localhost:11434/v1 --vlm-model NAME",
    ),
)  # fmt: skip


def find(model: Model) -> Found:
    """Look for a model's runner or server; a server is only knocked at, nothing is sent."""
    if model is ENDPOINT:
        return _endpoint()
    if model in HOSTED:
        there = bool(settings.text(model.variable))
        return Found(there, f"{model.variable} is {'set' if there else 'not set'}")
    if model is SPACE:
        state = SpaceReconstructor.available()
        return Found(state.ok, state.version if state.ok else state.why)
    runner = settings.runner(model.variable)
    if runner is None:
        return Found(False, f"not set up ({model.variable} is not set)")
    if runner.url is not None:
        answers = _knock(runner.url)
        return Found(
            answers, f"{bare_url(runner.url)} {'answers' if answers else 'does not answer'}"
        )
    if shutil.which(runner.command[0]) is None:
        return Found(False, f"{model.variable} names {runner.command[0]!r}: no such executable")
    missing = [a for a in runner.command[1:] if a.endswith(".py") and not Path(a).is_file()]
    if missing:
        return Found(False, f"{model.variable} names {missing[0]}: no such file")
    if model.home and not Path(os.environ.get(model.home, "")).is_dir():
        return Found(False, f"{model.home} names no folder")
    return Found(True, f"set up, {_commit(os.environ.get(model.home, ''))}")


def _endpoint() -> Found:
    if not has("openai"):
        return Found(False, "the openai package is not installed")
    package = f"openai {metadata.version('openai')}"
    url = settings.text("OPENAI_BASE_URL")
    if not url and not os.environ.get("OPENAI_API_KEY"):
        return Found(False, f"{package}; neither OPENAI_API_KEY nor OPENAI_BASE_URL is set")
    model = settings.text("MAM_SIM_VLM_MODEL", "gpt-4o")
    if url and not _knock(url):
        return Found(False, f"{package}, {model}: {bare_url(url)} does not answer")
    offer = consent.model_offer()
    who = f"{model} at {bare_url(url) or 'api.openai.com'}" if offer is None else offer.who
    if consent.allowed(who, "MAM_SIM_ALLOW_MODEL"):
        auto = "auto asks it"
    else:
        auto = "auto does not ask it" if consent.forbidden(who) else "auto asks you first"
    return Found(True, f"{package}, {who}; {auto}")


def _knock(url: str) -> bool:
    """Whether something listens at a URL's host and port."""
    place = urlparse(url)
    port = place.port or (443 if place.scheme == "https" else 80)
    try:
        with socket.create_connection((place.hostname or "", port), timeout=2):
            return True
    except OSError:
        return False


def _commit(folder: str) -> str:
    """The checkout's commit, as far as git can tell."""
    if not folder or shutil.which("git") is None:
        return "version unknown"
    command = ["git", "-C", folder, "rev-parse", "--short", "HEAD"]
    done = subprocess.run(command, capture_output=True, text=True)
    return f"commit {done.stdout.strip()}" if done.returncode == 0 else "version unknown"
