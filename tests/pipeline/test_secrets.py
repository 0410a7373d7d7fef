"""No key or password is printed or written, also where an endpoint repeats it in its error."""

from __future__ import annotations

import base64
import json
import logging
import pickle
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import pytest
from mam_sim_models import external
from mam_sim_models.hosted import SERVICES
from mam_sim_models.hosted_task import HostedTask
from mam_sim_models.image_to_mesh import HunyuanReconstructor, ask_server

from mam_pipeline import config_file
from mam_pipeline.errors import BackendError
from mam_pipeline.make_config import MakeConfig
from mam_pipeline.models import consent, photo_reader, settings
from mam_pipeline.models.catalogue import ENDPOINT
from mam_pipeline.models.retexture import imagined
from mam_pipeline.models.settings import ModelConfig
from mam_pipeline.models.transports import OpenAITransport, Question
from mam_pipeline.models.vlm import VlmReasoner
from mam_pipeline.secrets import VARIABLES, Secret, bare_url, masked
from mam_world.dataset import write_dataset

KEYS = {name: f"canary-Qx{n}-vZ7/kW+pL{n}" for n, name in enumerate(VARIABLES)}
LOGIN, QUERY = "canary-user:canary-pass", "canary-query"
ASKED: list[str] = []
STATUS = 400
WAYS: dict[str, Callable[[str], str]] = {
    "whole": str, "capitals": str.upper, "cut": lambda k: k[: len(k) // 2],
    "cut in front": lambda k: k[len(k) // 2 :], "over lines": "\n    ".join,
    "in JSON over lines": "\\n".join, "percent": lambda k: "".join(f"%{ord(c):02x}" for c in k),
    "twice percent": lambda k: "".join(f"%25{ord(c):02X}" for c in k),
    "JSON": lambda k: "".join(f"\\u{ord(c):04x}" for c in k),
    "HTML": lambda k: "".join(f"&#{ord(c)};" for c in k),
    "HTML's other": lambda k: "".join(f"&#x{ord(c):x};" for c in k),
    "base64": lambda k: base64.b64encode(k.encode()).decode(),
}  # fmt: skip
"""How an endpoint may write a key that it repeats."""
QUESTION = Question("q", "system", "text", lambda: (), {"type": "object"})


@pytest.fixture
def echo(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[str]:
    """An endpoint whose every error repeats all that it was sent; the user's keys are canaries."""

    class Handler(BaseHTTPRequestHandler):
        def _do(self) -> None:
            self.rfile.read(int(self.headers.get("Content-Length") or 0))
            said = f"wrong: {self.path} {dict(self.headers)} {KEYS} {LOGIN} {QUERY} "
            said += " ".join(write(KEYS["OPENAI_API_KEY"]) for write in WAYS.values())
            ASKED.append(self.path)
            answer: dict[str, Any] = {"error": {"message": said}}
            if STATUS == 200:
                told = {"role": "assistant", "content": json.dumps({"name": said})}
                choice = {"index": 0, "finish_reason": "stop", "message": told}
                answer = {"id": said, "object": "x", "model": said, "choices": [choice]}
            answer |= {"message": said, "text": said, "detail": said}
            body = json.dumps(answer).encode()
            self.send_response(STATUS)
            self.send_header("Content-Type", "application/json")
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        do_GET = do_POST = _do

        def log_message(self, format: str, *args: Any) -> None: ...

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    for name, value in KEYS.items():
        monkeypatch.setenv(name, value)
    address = f"127.0.0.1:{server.server_port}"
    monkeypatch.setenv("OPENAI_BASE_URL", f"http://{LOGIN}@{address}/v1?key={QUERY}")
    monkeypatch.setenv("MAM_SIM_HUNYUAN3D", f"http://{LOGIN}@{address}/?key={QUERY}")
    monkeypatch.setenv("MAM_SIM_P3SAM", f"http://{LOGIN}@{address}/run?token={QUERY}")
    monkeypatch.setenv("MAM_SIM_SPACE", f"http://{LOGIN}@{address}/?key={QUERY}")
    monkeypatch.setenv("MAM_SIM_VLM_CACHE", str(tmp_path / "answers"))
    monkeypatch.setenv("MAM_SIM_MESH_CACHE", str(tmp_path / "meshes"))
    monkeypatch.setenv("MAM_SIM_ALLOW_UPLOAD", "1")
    monkeypatch.setenv("MAM_SIM_TIMEOUT", "10")
    yield f"http://{address}"
    server.shutdown()
    server.server_close()


def _runner(folder: Path) -> None:
    (folder / "in").mkdir()
    external.call("MAM_SIM_P3SAM", "segment", {}, folder / "in", folder / "out")


def _space(_folder: Path) -> None:
    pytest.importorskip("gradio_client", reason="the extra of Spaces is not installed")
    from mam_sim_models.space import ask_space

    ask_space(settings.text("MAM_SIM_SPACE"), b"png", 0)


def _server(_folder: Path) -> None:
    found = external.runner(HunyuanReconstructor.variable)
    assert found is not None and found.url is not None
    ask_server(found.url, {})


ADAPTERS: dict[str, Callable[[Path], Any]] = {
    "vlm": lambda _: OpenAITransport().ask(QUESTION),
    "photo reader": lambda _: photo_reader.transport("vlm").ask(QUESTION),
    "retexture by words": lambda _: imagined("oak"),
    "server": _server,
    "runner": _runner,
    "space": _space,
}


def clean(*texts: str) -> None:
    """Fail where a canary is in a text, or the user's key in any way of writing it."""
    for text in texts:
        assert "canary" not in text.lower()
        for way, write in WAYS.items():
            assert write(KEYS["OPENAI_API_KEY"]) not in text, way


@pytest.mark.parametrize("way", WAYS)
def test_a_key_is_masked_however_it_is_written(way: str) -> None:
    key = Secret("sk-Qw7/eRt9+uIopAs").reveal()
    said = masked(f"wrong key: {WAYS[way](key)}, see the manual")
    assert said.startswith("wrong key: ***") and said.endswith(", see the manual")
    assert len(said) < 48


@pytest.mark.parametrize("status", [400, 200])
def test_the_command_line_shows_and_writes_no_key(
    status: int, echo: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What an endpoint repeats, in an error or as its answer: all that is printed and written."""
    monkeypatch.setattr(f"{__name__}.STATUS", status)
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    write_dataset("box_slider", 1, 3, tmp_path / "made", False, False, 1)
    mesh = next((tmp_path / "made").rglob("*.glb"))
    done = subprocess.run(
        [sys.executable, "-m", "mam_sim.cli", "articulate", str(mesh), "--reasoner", "vlm",
         "--vlm-url", f"http://{LOGIN}@{echo.removeprefix('http://')}/v1?key={QUERY}",
         "--yes", "--out", str(tmp_path / "out")],
        capture_output=True, text=True, timeout=300, cwd=tmp_path,
    )  # fmt: skip
    assert ASKED and "Traceback" not in done.stderr
    assert "***" in done.stderr + done.stdout or status == 200
    clean(done.stdout, done.stderr)
    clean(*(f.read_bytes().decode("latin-1") for f in tmp_path.rglob("*") if f.is_file()))


@pytest.mark.parametrize("name", [*ADAPTERS, *(s.name for s in SERVICES)])
def test_a_key_that_is_repeated_in_an_error_is_masked(
    name: str, echo: str, tmp_path: Path,
    capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture,
) -> None:  # fmt: skip
    caplog.set_level(logging.INFO)
    if name in ADAPTERS:
        ask = ADAPTERS[name]
    else:
        service = replace(next(s for s in SERVICES if s.name == name), base=echo)

        def ask(_: Path) -> Any:
            consent.need(service.offer())
            return HostedTask(service).mesh(b"png", 0)

    with pytest.raises(BackendError) as caught:
        ask(tmp_path)
    said = capfd.readouterr()
    clean(str(caught.value), said.out, said.err)
    kept = [f for f in tmp_path.rglob("*") if f.is_file()]
    clean(*(f.read_bytes().decode("latin-1") for f in kept))


def test_what_is_kept_and_shown_of_settings_is_bare(echo: str, tmp_path: Path) -> None:
    url = f"https://{LOGIN}@host:8443/v1?api-version=2&key={QUERY}#canary-part"
    config = MakeConfig(what=KEYS["OPENAI_API_KEY"], models=ModelConfig(vlm_url=url, space=url))
    config_file.save({"pipeline": config}, tmp_path / "config.yaml")
    text = (tmp_path / "config.yaml").read_text()
    clean(text, VlmReasoner.options(), ENDPOINT.look().text)
    assert "https://host:8443/v1?api-version=2" in text
    clean(
        str(HunyuanReconstructor.available()), str(external.availability("MAM_SIM_P3SAM", "", ""))
    )


def test_a_secret_never_shows() -> None:
    secret = Secret("canary-of-its-own/+")
    clean(str(secret), repr(secret), f"{secret:>30}", str([secret]), json.dumps(str(secret)))
    with pytest.raises(TypeError):
        pickle.dumps(secret)
    assert secret.reveal() == "canary-of-its-own/+" and not Secret("")
    clean(masked("x canary-of-its-own/+ canary-of-its-own%2F%2B"), str(BackendError(secret)))
    clean(str(BackendError(f"it said {secret.reveal()}")))


@pytest.mark.parametrize(
    "text", ["a note: no URL", "owner/name", "http://host:1/v1", "", "see x://y"]
)
def test_other_texts_stay_as_they_are(text: str) -> None:
    assert bare_url(text) == text


@pytest.mark.parametrize(
    "text",
    [
        "canary:canary-w1@host:1/v1?key=canary-w1b",
        "  http://canary:canary-w2@host:1/v1",
        "http://canary:canary w3@host:1/v1",
        "http://canary:canary/w4@host:1/v1#canary-w4b",
    ],
)
def test_a_login_in_a_badly_written_url_is_left_out_too(text: str) -> None:
    assert bare_url(text).removeprefix("http://") == "host:1/v1"
