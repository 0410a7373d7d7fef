"""Stand-ins that speak the protocols of external models, for the tests of their adapters."""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from mam_pipeline.types import Mesh, Primitives

Answer = Callable[[str, bytes], tuple[int, str, bytes]]


@pytest.fixture
def boxes() -> tuple[Mesh, Primitives]:
    """A body, a door before it and a knob on the door: three primitives."""
    places = (
        ((0.4, 0.5, 0.6), (0, 0, 0.3)),
        ((0.02, 0.46, 0.5), (-0.215, 0, 0.3)),
        ((0.04, 0.05, 0.05), (-0.245, 0.18, 0.3)),
    )
    parts = [
        trimesh.creation.box(size, trimesh.transformations.translation_matrix(at))
        .subdivide()
        .subdivide()
        for size, at in places
    ]
    labels = np.concatenate([np.full(len(p.faces), i) for i, p in enumerate(parts)])
    joined: Any = trimesh.util.concatenate(parts)
    return Mesh(joined.vertices, joined.faces), Primitives(labels)


@pytest.fixture
def serve() -> Iterator[Callable[[Answer], str]]:
    """Start a loopback server that answers every request with a function of path and body."""
    running = []

    def start(answer: Answer) -> str:
        class Handler(BaseHTTPRequestHandler):
            def _do(self) -> None:
                length = int(self.headers.get("Content-Length") or 0)
                status, kind, body = answer(self.path, self.rfile.read(length))
                try:
                    self.send_response(status)
                    self.send_header("Content-Type", kind)
                    self.send_header("Content-Length", str(len(body)))
                    self.end_headers()
                    self.wfile.write(body)
                except (BrokenPipeError, ConnectionResetError):
                    pass  # the client did not wait

            do_GET = do_POST = _do

            def log_message(self, *_: Any) -> None:
                pass

        server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        server.daemon_threads = True
        threading.Thread(target=server.serve_forever, daemon=True).start()
        running.append(server)
        return f"http://127.0.0.1:{server.server_port}"

    yield start
    for server in running:
        server.shutdown()
        server.server_close()


@pytest.fixture
def script(tmp_path: Path) -> Callable[[str], str]:
    """A command whose Python code finds its folders in `inbox` and `out`."""

    def write(code: str) -> str:
        path = tmp_path / "runner.py"
        path.write_text(
            "import json, pathlib, sys, time\n"
            "import numpy as np\n"
            "out = pathlib.Path(sys.argv[sys.argv.index('--output') + 1])\n"
            "inbox = pathlib.Path(sys.argv[sys.argv.index('--input') + 1])\n" + code
        )
        return f"{sys.executable} {path}"

    return write


class Endpoint:
    """Answers chat completions from a list (the last one for ever); remembers what was asked."""

    def __init__(self, answers: list[tuple[int, str]]) -> None:
        self.answers = answers
        self.asked: list[Any] = []

    def __call__(self, path: str, body: bytes) -> tuple[int, str, bytes]:
        assert path.endswith("/chat/completions")
        self.asked.append(json.loads(body))
        status, text = self.answers[min(len(self.asked), len(self.answers)) - 1]
        if status != 200:
            return status, "application/json", json.dumps({"error": {"message": text}}).encode()
        choice = {
            "index": 0,
            "finish_reason": "stop",
            "message": {"role": "assistant", "content": text},
        }
        usage = {"prompt_tokens": 1000, "completion_tokens": 100, "total_tokens": 1100}
        head = {"id": "x", "object": "chat.completion", "created": 0, "model": "m"}
        made = json.dumps({**head, "choices": [choice], "usage": usage})
        return 200, "application/json", made.encode()


@pytest.fixture
def endpoint(
    serve: Callable[[Answer], str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> Callable[[list[tuple[int, str]]], Endpoint]:
    """Start an OpenAI-compatible endpoint with given answers; the environment points to it."""

    def start(answers: list[tuple[int, str]]) -> Endpoint:
        pytest.importorskip("openai", reason="the vlm extra is not installed")
        made = Endpoint(answers)
        monkeypatch.setenv("OPENAI_BASE_URL", serve(made) + "/v1")
        monkeypatch.setenv("OPENAI_API_KEY", "sk-secret-of-the-user")
        monkeypatch.setenv("MAM_SIM_VLM_CACHE", str(tmp_path / "answers"))
        monkeypatch.setenv("MAM_SIM_VLM_MODEL", "gpt-4o")
        return made

    return start


@pytest.fixture
def grouping() -> dict[str, Any]:
    """A right answer to the first question about `boxes`."""
    body = {"name": "body", "kind": "body", "is_base": True, "pieces": [0], "confidence": 0.9}
    door = {"name": "door", "kind": "door", "is_base": False, "pieces": [1, 2], "confidence": 0.8}
    return {"parts": [body, door]}


@pytest.fixture
def mounting() -> dict[str, Any]:
    """A right answer to the second question about `boxes`."""
    door = {
        "name": "door", "parent": "body", "motion": "hinge", "confidence": 0.9,
        "second_best": "slide", "axis": "z", "side": "-y", "opens": "-x",
    }  # fmt: skip
    return {"mounts": [door]}
