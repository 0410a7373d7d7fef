"""Shared by all tests: no network, two tiers by folder, and where the real objects may lie."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest

from tests.local_server import Replies, served

os.environ.setdefault("HF_HUB_OFFLINE", "1")
os.environ.setdefault("OMP_NUM_THREADS", "1")  # more wait for each other beside a second worker

SCHEDULED = os.sched_getscheduler(0), os.sched_getparam(0)
"""How this process is scheduled before any test."""
Answer = Callable[[str, bytes], tuple[int, str, bytes]]
ROOT = Path(__file__).resolve().parent.parent
FOLDER_MARKS = {"envs": "sim", "policies": "sim", "conformance": "sim", "training": "slow"}
"""What every test of a folder needs; `make test-fast` leaves `sim` and `slow` out."""


def _folder(path: Path) -> str:
    """The first folder below tests/ on the way to a file."""
    return path.relative_to(ROOT / "tests").parts[0]


def pytest_ignore_collect(collection_path: Path, config: pytest.Config) -> bool | None:
    """Do not even import what is left out: it imports the simulator or torch."""
    if not collection_path.is_relative_to(ROOT / "tests") or collection_path == ROOT / "tests":
        return None
    mark = FOLDER_MARKS.get(_folder(collection_path))
    return True if mark and f"not {mark}" in config.option.markexpr else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark every test by its folder, and by the real objects that it asks for.

    Files with slow tests come first, so that no process has the last one alone.
    """
    for item in items:
        mark = FOLDER_MARKS.get(_folder(item.path))
        if mark:
            item.add_marker(getattr(pytest.mark, mark))
        if {"bench_dev", "bench_photos"} & set(getattr(item, "fixturenames", ())):
            item.add_marker(pytest.mark.bench_data)
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture(autouse=True)
def scheduled_as_before() -> Iterator[None]:
    """A test that leaves its process a real-time one fails, and the process is as it was.

    A video encoder does that as root. All later tests of the process would then take the processors
    from whatever they wait for: a browser, a process that is stopped, a thread of a library.
    """
    yield
    after = os.sched_getscheduler(0)
    os.sched_setscheduler(0, *SCHEDULED)
    assert after == SCHEDULED[0], "it was made real-time; see dataset.same_scheduling"


@pytest.fixture(scope="session")
def bench_dev() -> Path:
    """The folder of real articulated objects with ground truth; skips where it is absent."""
    folder = ROOT.parent / "shared" / "bench" / "dev"
    if not folder.is_dir():
        pytest.skip("the real benchmark objects are not on this machine (../shared/bench/dev)")
    return folder


@pytest.fixture(scope="session")
def bench_photos() -> Path:
    """The folder of real photos; skips where it is absent."""
    folder = ROOT.parent / "shared" / "bench" / "photos"
    if not folder.is_dir():
        pytest.skip("the real photos are not on this machine (../shared/bench/photos)")
    return folder


@pytest.fixture(scope="session", autouse=True)
def _placements(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Places for robots are remembered among the tests of a run, not in the user's folder."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MAM_SIM_PLACEMENTS", str(tmp_path_factory.getbasetemp() / "placements"))
        yield


@pytest.fixture
def serve() -> Iterator[Callable[[Answer], str]]:
    """Start a loopback server that answers every request with a function of path and body."""

    def start(answer: Answer) -> str:
        class Handler(Replies):
            def reply(self, body: bytes) -> tuple[int, str, bytes]:
                return answer(self.path, body)

        return running.enter_context(served(Handler))

    with ExitStack() as running:
        yield start


class Endpoint:
    """Answers chat completions from a list (the last one for ever); remembers what was asked."""

    def __init__(self, answers: list[tuple[int, str]]) -> None:
        self.answers = answers
        self.asked: list[Any] = []

    def __call__(self, path: str, body: bytes) -> tuple[int, str, bytes]:
        if path.endswith("/models"):
            return 404, "application/json", b"{}"
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
