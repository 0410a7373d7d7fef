"""The photo's page of the studio, in a real headless Chromium where there is one."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mam_pipeline.errors import ConfigError
from mam_pipeline.hints import load_hints
from mam_sim.studio import marking as module
from mam_sim.studio.marking import Marking, make_server, spec_of_state

ROOT = Path(__file__).resolve().parents[2]
CHROMIUM = next(
    (p for n in ("chromium", "chromium-browser", "google-chrome") if (p := shutil.which(n))), None
)
STATE: dict[str, Any] = {
    "front": [[100, 100], [300, 110], [290, 400], [105, 390]],
    "panels": [
        {"kind": "drawer", "hinge": "left", "rect": [0.05, 0.05, 0.95, 0.4],
         "handles": [[0.4, 0.2, 0.6, 0.23]]},
        {"kind": "door", "hinge": "right", "rect": [0.05, 0.45, 0.95, 0.95], "handles": []},
    ],
    "width": 0.6, "height": 0.8, "depth": 0.4, "legs": 0.1,
}  # fmt: skip


@pytest.fixture(scope="module")
def marking(tmp_path_factory: pytest.TempPathFactory) -> Marking:
    out = tmp_path_factory.mktemp("marking") / "hints.yaml"
    return Marking(ROOT / "examples" / "nightstand.jpg", out)


@pytest.fixture(scope="module")
def address(marking: Marking) -> Iterator[str]:
    server = make_server(marking)
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    yield f"http://127.0.0.1:{server.server_address[1]}"
    server.shutdown()
    server.server_close()


def post(url: str, body: object, **headers: str) -> tuple[int, dict]:
    request = urllib.request.Request(url, json.dumps(body).encode(), headers)
    try:
        with urllib.request.urlopen(request, timeout=60) as answer:
            return answer.status, json.loads(answer.read())
    except urllib.error.HTTPError as error:
        text = error.read()
        return error.code, json.loads(text) if text.startswith(b"{") else {"error": text.decode()}


def test_saving_writes_hints_that_load(marking: Marking, address: str) -> None:
    code, answer = post(f"{address}/save", STATE)
    assert code == 200 and "--hints" in answer["next"]
    hints = load_hints(marking.out)
    assert hints.photo_front == (100, 100, 300, 110, 290, 400, 105, 390)
    body, drawer, door = hints.parts
    assert body.box is not None and body.box.size == (0.4, 0.6, 0.8)
    assert body.box.center[2] == pytest.approx(0.1 + 0.4)
    assert drawer.kind == "drawer" and drawer.provenance == "user" and drawer.handle is not None
    assert door.joint is not None and door.joint.hinge_side == "right"


def test_bad_states_are_explained(address: str) -> None:
    for change, word in (
        ({"width": 90}, "width"), ({"front": [[0, 0]] * 4}, "front"),
        ({"panels": [{"kind": "lid", "rect": [0, 0, 1, 1], "handles": []}]}, "lid"),
        ({"panels": [{"kind": "door", "rect": [1, 0, 0, 1], "handles": []}]}, "no area"),
        ({"panels": [{}]}, "panels[0] has no kind"),
        ({"width": float("nan")}, "width must be a finite number"),
        ({"front": [[-1e9, -1e9], [1e9, -1e9], [1e9, 1e9], [-1e9, 1e9]]}, "far from the photo"),
        ({"panels": [STATE["panels"][1]] * 999}, "panels must be a list of 200, not of"),
    ):  # fmt: skip
        code, answer = post(f"{address}/save", {**STATE, **change})
        assert code == 400 and word in answer["error"]
    far = {"front": [[-1e9, -1e9], [1e9, 0], [1e9, 1e9], [0, 9]]}
    code, answer = post(f"{address}/detect", far)
    assert code == 400 and "far from the photo" in answer["error"]
    with pytest.raises(ConfigError, match="there is no front"):
        spec_of_state({})


def test_strangers_are_turned_away(address: str) -> None:
    assert post(f"{address}/save", STATE, Host="evil.example")[0] == 403
    assert post(f"{address}/save", STATE, Origin="http://evil.example")[0] == 403
    assert post(f"{address}/save", STATE, Origin="http://127.0.0.1:1")[0] == 403
    assert post(f"{address}/save", STATE, Host="127.0.0.1")[0] == 403
    assert post(f"{address}/save", STATE, Origin=address)[0] == 200
    assert post(f"{address}/nothing", STATE)[0] == 404


@pytest.mark.parametrize(
    ("length", "body", "answer"),
    [
        ("-1", b"", b"411"), ("x", b"", b"411"), ("", b"", b"411"), ("9" * 30, b"", b"413"),
        ("1000001", b"", b"413"), ("3", b"[1]", b"400"), ("4", b"{\"a:", b"400"),
        ("20000", b"[" * 20000, b"400"), ("50", b"{}", b""),
    ],
)  # fmt: skip
def test_no_request_holds_the_server(
    marking: Marking, length: str, body: bytes, answer: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "PATIENCE", 0.5)
    server = make_server(marking)
    port = server.server_address[1]
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        with socket.create_connection(("127.0.0.1", port), timeout=20) as line:
            head = f"POST /save HTTP/1.0\r\nHost: 127.0.0.1:{port}\r\n"
            line.sendall(f"{head}Content-Length: {length}\r\n\r\n".encode() + body)
            assert answer in line.makefile("rb").readline()  # nothing: the rest never came
    finally:
        server.shutdown()
        server.server_close()


def test_the_page_needs_nothing_from_elsewhere(address: str) -> None:
    with urllib.request.urlopen(f"{address}/", timeout=10) as answer:
        page = answer.read().decode()
    assert "http://" not in page and "https://" not in page and "<canvas" in page
    with urllib.request.urlopen(f"{address}/photo.jpg", timeout=10) as answer:
        assert answer.read(2) == b"\xff\xd8"


def test_what_was_saved_is_shown_again(marking: Marking, address: str) -> None:
    assert post(f"{address}/save", STATE)[0] == 200
    again = Marking(marking.path, marking.out).state()
    assert again["front"] == STATE["front"] and again["width"] == STATE["width"]
    assert [p["kind"] for p in again["panels"]] == ["drawer", "door"]
    for panel, was in zip(again["panels"], STATE["panels"], strict=True):
        assert panel["rect"] == pytest.approx(was["rect"], abs=0.01)


def test_a_saved_marking_makes_the_open_object_again(tmp_path: Path) -> None:
    pytest.importorskip("viser", reason="the studio's page needs the extra studio")
    from mam_pipeline.make_config import MakeConfig
    from mam_sim.studio.page import Page
    from mam_sim.studio.place import place_of
    from tests.face.studio_window import until

    photo = Path(shutil.copy(ROOT / "examples" / "nightstand.jpg", tmp_path))
    page = Page()
    try:
        page.open(place_of(photo, MakeConfig(), tmp_path / "asset"))
        assert page.photo is not None and page.photo.url in page.head.content
        with urllib.request.urlopen(f"{page.photo.url}state", timeout=60) as answer:
            state = json.loads(answer.read())
        first = page.work.open
        state["panels"][-1] |= {"kind": "door", "hinge": "right"}
        assert post(f"{page.photo.url}save", state)[0] == 200
        until(lambda: page.work.session not in (None, first))
        kinds = [n.kind for n in page.work.state.tree.nodes]
        assert kinds.count("door") == 1 and kinds.count("drawer") == 2
        assert not page.work.open.unsaved
    finally:
        page.stop()


@pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed")
def test_the_page_drags_labels_and_saves_in_a_browser(
    marking: Marking, address: str, tmp_path: Path
) -> None:
    marking.out.unlink(missing_ok=True)
    before = marking.state()
    done = subprocess.run(
        [
            str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run",
            "--disable-dev-shm-usage", f"--user-data-dir={tmp_path}", "--timeout=90000",
            "--virtual-time-budget=60000", "--dump-dom", f"{address}/?selftest",
        ],
        capture_output=True, encoding="utf-8", timeout=180, check=False,
    )  # fmt: skip
    assert "<title>self-test passed</title>" in done.stdout, done.stdout[-600:] + done.stderr[-600:]
    hints = load_hints(marking.out)
    assert hints.photo_front[0] == pytest.approx(before["front"][0][0] + 6, abs=3.0)
    assert hints.photo_front[1] == pytest.approx(before["front"][0][1] + 4, abs=3.0)
    door = next(p for p in hints.parts if p.kind == "door")
    assert door.joint is not None and door.joint.hinge_side == "right" and door.handle is not None
