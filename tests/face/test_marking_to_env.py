"""A person's whole way: mark a photo in a real browser, save, make-env on the saved hints.

The page is driven through Chromium's DevTools protocol: real mouse events at real places.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import time
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from mam_pipeline.asset.card import Asset
from mam_pipeline.hints import load_hints
from mam_sim.cli import main

connect = pytest.importorskip("websockets.sync.client", reason="no websockets package").connect
ROOT = Path(__file__).resolve().parents[2]
CHROMIUM = next(
    (p for n in ("chromium", "chromium-browser", "google-chrome") if (p := shutil.which(n))), None
)
pytestmark = [
    pytest.mark.sim,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed"),
]


class Page:
    """One page of a headless browser: evaluate, move, press and release."""

    def __init__(self, socket: Any) -> None:
        self.socket, self.number = socket, 0

    def call(self, method: str, **params: Any) -> dict[str, Any]:
        self.number += 1
        self.socket.send(json.dumps({"id": self.number, "method": method, "params": params}))
        while True:
            answer = json.loads(self.socket.recv(timeout=120))
            if answer.get("id") == self.number:
                return dict(answer.get("result", {}))

    def js(self, code: str) -> Any:
        done = self.call("Runtime.evaluate", expression=code, returnByValue=True)
        return done["result"].get("value")

    def wait(self, code: str, seconds: float = 120) -> None:
        end = time.monotonic() + seconds
        while not self.js(code):
            assert time.monotonic() < end, f"never true: {code}; {self.js('document.title')}"
            time.sleep(0.2)

    def mouse(self, kind: str, x: float, y: float) -> None:
        self.call(
            "Input.dispatchMouseEvent", type=kind, x=x, y=y, button="left", clickCount=1,
            buttons=0 if kind == "mouseReleased" else 1,
        )  # fmt: skip

    def drag(self, start: list[float], end: list[float]) -> None:
        self.mouse("mousePressed", *start)
        for share in (0.3, 0.7, 1.0):
            self.mouse("mouseMoved", *(a + share * (b - a) for a, b in zip(start, end)))
        self.mouse("mouseReleased", *end)

    def click(self, name: str) -> None:
        place = self.js(
            f"(() => {{ const r = document.getElementById('{name}').getBoundingClientRect();"
            " return [r.left + r.width / 2, r.top + r.height / 2]; })()"
        )
        self.drag(place, place)

    def on_screen(self, code: str) -> list[float]:
        """Window coordinates of a point of the photo that `code` gives in photo pixels."""
        return list(
            self.js(
                "(() => { const r = view.getBoundingClientRect(), p = " + code + ";"
                " return [r.left + p[0] * zoom, r.top + p[1] * zoom]; })()"
            )
        )


@pytest.fixture
def photo(tmp_path: Path) -> Path:
    return Path(shutil.copy(ROOT / "examples" / "nightstand.jpg", tmp_path))


@pytest.fixture
def hints(photo: Path) -> Path:
    return photo.with_name("nightstand-hints.yaml")


@pytest.fixture
def page(photo: Path, tmp_path: Path) -> Iterator[Page]:
    """The photo's page of a running `mam-sim studio`, in a running browser."""
    verb = subprocess.Popen(
        [sys.executable, "-m", "mam_sim.cli", "studio", str(photo), "--no-open"],
        stderr=subprocess.PIPE, text=True, cwd=tmp_path,
    )  # fmt: skip
    browser = subprocess.Popen(
        [str(CHROMIUM), "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run",
         "--disable-dev-shm-usage", "--remote-debugging-port=0", "--remote-allow-origins=*",
         "--window-size=1400,1000", f"--user-data-dir={tmp_path / 'profile'}", "about:blank"],
        stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        url = first(verb, r"photo: (http://127\.0\.0\.1:\d+/)")
        port = first(browser, r"ws://127\.0\.0\.1:(\d+)/")
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/json/list", timeout=60) as answer:
            target = next(t for t in json.loads(answer.read()) if t["type"] == "page")
        with connect(target["webSocketDebuggerUrl"], max_size=None, open_timeout=60) as socket:
            shown = Page(socket)
            shown.call("Page.navigate", url=url)
            shown.wait("typeof state !== 'undefined' && state !== null")
            yield shown
    finally:
        for process in (browser, verb):
            process.terminate()
            process.wait(timeout=60)


def first(process: subprocess.Popen[str], pattern: str) -> str:
    """What the first line of stderr that matches says."""
    assert process.stderr is not None
    for line in process.stderr:
        if match := re.search(pattern, line):
            return match[1]
    raise AssertionError(f"the process ended without saying {pattern}")


def test_what_is_marked_in_the_browser_becomes_the_asset(
    page: Page, photo: Path, hints: Path, tmp_path: Path
) -> None:
    before = page.js("JSON.parse(JSON.stringify(state))")
    assert [p["kind"] for p in before["panels"]] == ["drawer"] * 3
    start = page.on_screen("state.front[0]")
    page.drag(start, [start[0] + 5, start[1] + 3])  # a corner
    line = (
        "toPhoto(state.front)(0.3 * state.panels[0].rect[0] + 0.7 * state.panels[0].rect[2],"
        " state.panels[0].rect[3] + {})"
    )
    page.drag(page.on_screen(line.format("0")), page.on_screen(line.format("-0.06")))
    inside = page.on_screen(
        "toPhoto(state.front)(0.8 * state.panels[2].rect[0] + 0.2 * state.panels[2].rect[2],"
        " 0.2 * state.panels[2].rect[1] + 0.8 * state.panels[2].rect[3])"
    )
    page.drag(inside, inside)  # select the lowest panel and label it
    page.js("$('kind').value = 'door'; $('kind').onchange()")
    page.js("$('hinge').value = 'right'; $('hinge').onchange()")
    page.click("save")
    page.wait("$('status').textContent.startsWith('saved')")
    after = page.js("JSON.parse(JSON.stringify(state))")
    zoom = page.js("zoom")
    page.call("Browser.close")  # it keeps both cores busy

    marked = load_hints(hints)
    moved = [b - a for a, b in zip(before["front"][0], after["front"][0])]
    assert moved == pytest.approx([5 / zoom, 3 / zoom], abs=1.5 / zoom)
    assert list(marked.photo_front[:2]) == pytest.approx(after["front"][0], abs=0.01)
    shift = after["panels"][0]["rect"][3] - before["panels"][0]["rect"][3]
    assert shift == pytest.approx(-0.06, abs=0.01)
    assert [p.kind for p in marked.parts[1:]] == ["drawer", "drawer", "door"]

    out = tmp_path / "asset"
    assert main(["make-env", str(photo), "--hints", str(hints), "--out", str(out), "--quiet"]) == 0
    card = Asset.load(out).card
    assert [p.kind for p in card.parts if p.kind != "body"] == ["drawer", "drawer", "door"]
    assert sorted(j.subtype for j in card.joints) == ["hinge", "slide", "slide"]
    assert card.checks["environment"]["ok"] and card.checks["executability"]["passed"]
