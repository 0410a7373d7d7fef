"""What `mam-sim doctor` lists of this package: models, licences, and how to get them."""

from __future__ import annotations

import os
import shutil
import subprocess
from functools import partial
from pathlib import Path

from mam_pipeline.models import settings
from mam_pipeline.models.catalogue import Found, Model, knock
from mam_pipeline.secrets import bare_url
from mam_sim_models import external
from mam_sim_models.hosted import SERVICES
from mam_sim_models.image_to_mesh import TENCENT
from mam_sim_models.space import SpaceReconstructor

RUNNERS = Path(__file__).resolve().parent / "runners"
PAGE = "docs/guides/foundation-models.md"


def _runner(variable: str, home: str) -> Found:
    """The runner or server that a variable names; `home`: variable of its checkout, or ""."""
    runner = external.runner(variable)
    if runner is None:
        return Found(False, f"not set up ({variable} is not set)")
    if runner.url is not None:
        answers = knock(runner.url)
        return Found(
            answers, f"{bare_url(runner.url)} {'answers' if answers else 'does not answer'}"
        )
    if shutil.which(runner.command[0]) is None:
        return Found(False, f"{variable} names {runner.command[0]!r}: no such executable")
    missing = [a for a in runner.command[1:] if a.endswith(".py") and not Path(a).is_file()]
    if missing:
        return Found(False, f"{variable} names {missing[0]}: no such file")
    if home and not Path(os.environ.get(home, "")).is_dir():
        return Found(False, f"{home} names no folder")
    return Found(True, f"set up, {_commit(os.environ.get(home, ''))}")


def _key(variable: str) -> Found:
    there = bool(settings.text(variable))
    return Found(there, f"{variable} is {'set' if there else 'not set'}")


def _space() -> Found:
    state = SpaceReconstructor.available()
    return Found(state.ok, state.version if state.ok else state.why)


def _commit(folder: str) -> str:
    """The checkout's commit, as far as git can tell."""
    if not folder or shutil.which("git") is None:
        return "version unknown"
    command = ["git", "-C", folder, "rev-parse", "--short", "HEAD"]
    done = subprocess.run(command, capture_output=True, text=True)
    return f"commit {done.stdout.strip()}" if done.returncode == 0 else "version unknown"


def _checkout(name: str, runner: str, flag: str, licence: str, repository: str) -> Model:
    """A model that one of our runners runs in a checkout of its own."""
    variable = f"MAM_SIM_{name.upper().replace('-', '')}"
    home = f"{name.upper().replace('-', '')}_HOME"
    return Model(
        name, flag, variable, partial(_runner, variable, home), licence, PAGE,
        (
            f"git clone {repository}",
            f"export {home}=$PWD/{repository.rpartition('/')[2]}",
            f'export {variable}="<its python> {RUNNERS / runner}"',
        ),
    )  # fmt: skip


MODELS = (
    _checkout(
        "P3-SAM", "p3sam.py", "--segmenter p3sam",
        "Tencent Hunyuan 3D-Part licence: not in the EU, the UK and South Korea",
        "https://github.com/Tencent-Hunyuan/Hunyuan3D-Part",
    ),
    _checkout(
        "SP4D", "sp4d.py", "--prior sp4d",
        "Stability AI Community License: free below US$ 1 M of yearly revenue",
        "-b sp4d https://github.com/Stability-AI/generative-models",
    ),
    Model(
        "Hunyuan3D", "--reconstructor hunyuan3d, --retexture", "MAM_SIM_HUNYUAN3D",
        partial(_runner, "MAM_SIM_HUNYUAN3D", ""), TENCENT, PAGE,
        (
            "git clone https://github.com/Tencent-Hunyuan/Hunyuan3D-2",
            "python api_server.py --port 8081 --enable_tex   (in its environment)",
            "export MAM_SIM_HUNYUAN3D=http://localhost:8081",
        ),
    ),
    _checkout(
        "TripoSR", "tripo.py triposr", "--reconstructor triposr", "MIT",
        "https://github.com/VAST-AI-Research/TripoSR",
    ),
    _checkout(
        "TripoSG", "tripo.py triposg", "--reconstructor triposg",
        "MIT; its default matting (RMBG-1.4) has BRIA's terms, our runner uses rembg",
        "https://github.com/VAST-AI-Research/TripoSG",
    ),
    *(
        Model(
            service.title, f"--reconstructor {service.name}", service.key,
            partial(_key, service.key), service.licence, PAGE,
            (f"export {service.key}=...   (from {service.page})",),
        )
        for service in SERVICES
    ),
    Model(
        "Gradio Space", "--reconstructor space", "MAM_SIM_SPACE", _space,
        "the Space's and its model's", PAGE,
        ("export MAM_SIM_SPACE=OWNER/NAME   (or a URL)",),
    ),
)  # fmt: skip
