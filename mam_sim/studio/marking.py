"""The photo's page of the studio: a person drags front, panels and handles; hints are saved.

Loopback only. State in the page's words: corners in pixels of the upright photo, rectangles in
front coordinates (0..1, u to the right, v down), sizes in metres.
"""

from __future__ import annotations

import json
import shlex
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from mam_pipeline.edited import STRICT, Document, Finite, Range, validated
from mam_pipeline.errors import ConfigError, MamSimError
from mam_pipeline.hints import load_hints, save_hints
from mam_pipeline.local_page import HOST, is_own
from mam_pipeline.photo.build import BodySpec, CellSpec, HandleSpec, build_object
from mam_pipeline.photo.find import Found, check_near, find_object, sizes_of
from mam_pipeline.photo.image import Photo, read_photo
from mam_pipeline.photo.measure import jpeg
from mam_pipeline.photo.options import parse_options
from mam_pipeline.photo.verdict import seen_as

Metres = Annotated[float, Range(0.02, 20)]
MAX_BODY = 1_000_000
"""Bytes of a request."""
PATIENCE = 10.0
"""Seconds in which a request must have arrived."""
MOST_PANELS = 200
Unit = Annotated[float, Range(-1, 2)]
Rect = tuple[Unit, Unit, Unit, Unit]
Corner = tuple[Finite, Finite]
Corners = tuple[Corner, Corner, Corner, Corner]
MORE: dict[str, Any] = {**STRICT, "extra": "ignore"}


@dataclass(frozen=True)
class PanelState:
    """A panel as the page says it, in front coordinates."""

    __pydantic_config__ = STRICT
    kind: Literal["drawer", "door", "open", "fixed"]
    rect: Rect
    hinge: Literal["left", "right", "top", "bottom"] = "left"
    handles: Annotated[tuple[Rect, ...], Field(max_length=MOST_PANELS)] = ()


@dataclass(frozen=True)
class PageState:
    """What the page sends to be saved; it sends back what it was told as well."""

    __pydantic_config__ = MORE
    front: Corners
    width: Metres
    height: Metres
    depth: Metres
    panels: Annotated[tuple[PanelState, ...], Field(max_length=MOST_PANELS)]
    legs: Annotated[float, Range(0, 20)] = 0.0


@dataclass(frozen=True)
class FrontState:
    """What the page sends to have the front read again."""

    __pydantic_config__ = MORE
    front: Corners


class Marking:
    """One photo being marked: what was found, and saving what the person made of it."""

    def __init__(
        self, path: Path, out: Path, options: Mapping[str, Any] | None = None,
        saved: Callable[[], None] = lambda: None,
    ) -> None:  # fmt: skip
        """Read the photo.

        Args:
            out: the hints file; what it says is shown where it marks this photo.
            options: photo options as typed. saved: called after each saving.
        """
        self.path, self.out, self._tell = path, out, saved
        self.options = parse_options(options or {})
        self.photo: Photo = read_photo(path)
        self.looks = seen_as(self.photo, self.options)

    def state(self, front: Sequence[float] | None = None) -> dict[str, Any]:
        """What is on the photo; with `front` (8 pixels) the corners are taken as given."""
        options = self.options
        if front is not None:
            check_near(self.photo, front)
            options = replace(options, front=parse_options({"front": list(front)}).front)
        elif self.out.is_file() and (saved := load_hints(self.out)).photo_front:
            options = replace(options, hints=saved)
        found = find_object(self.photo, options, self.looks)
        sizes = sizes_of(found, options, self.looks)
        return {
            "name": self.path.name,
            "size": [round(v / self.photo.scale) for v in self.photo.size],
            "front": np.round(found.quad / self.photo.scale, 1).tolist(),
            "panels": _panels(found),
            "width": round(sizes.width, 3),
            "height": round(sizes.height, 3),
            "depth": round(sizes.depth, 3),
            "legs": round(found.legs * sizes.height, 3),
            "out": str(self.out),
        }

    def save(self, state: Mapping[str, Any]) -> str:
        """Write the hints file from a page's state; returns what happens next.

        Raises:
            ConfigError: numbers are missing, or corners or rectangles that cannot be.
        """
        spec, front = spec_of_state(state)
        check_near(self.photo, front)
        _, hints = build_object(spec)
        save_hints(replace(hints, photo_front=front), self.out)
        self._tell()
        return f"mam-sim make-env {shlex.join([str(self.path), '--hints', str(self.out)])}"


def _panels(found: Found) -> list[dict[str, Any]]:
    h, w = found.reading.image.shape[:2]

    def unit(b: tuple[float, float, float, float]) -> list[float]:
        return [round(float(v), 4) for v in (b[0] / w, b[1] / h, b[2] / w, b[3] / h)]

    return [
        {
            "kind": p.kind,
            "hinge": p.hinge_side or "left",
            "rect": unit(p.box),
            "handles": [unit(b.box) for b in p.handles if b.provenance != "assumed"][:1],
        }
        for p in found.reading.panels
    ]


def spec_of_state(state: Mapping[str, Any]) -> tuple[BodySpec, tuple[float, ...]]:
    """The body to build and the front corners (8 pixels) from a page's state."""
    page: PageState = validated(PageState, Document(dict(state), "the marked photo"))
    front = parse_options({"front": [v for corner in page.front for v in corner]}).front
    width, height, depth = page.width, page.height, page.depth
    rows = [(p.kind, p.hinge, _unit_rect(p.rect)) for p in page.panels]
    marks = [[_unit_rect(k) for k in p.handles] for p in page.panels]
    numbers: dict[str, int] = {}
    cells = []
    for (kind, hinge, rect), handles in zip(rows, marks):
        n = numbers.get(kind, 0)
        numbers[kind] = n + 1

        def metric(r: tuple[float, ...]) -> tuple[float, float, float, float]:
            return r[0] * width, (1 - r[3]) * height, r[2] * width, (1 - r[1]) * height

        specs = tuple(HandleSpec(metric(k), True, "user") for k in handles)
        side = hinge if kind == "door" else None
        cells.append(CellSpec(f"{kind}_{n}", kind, metric(rect), side, specs, 1.0, "user"))
    assert front is not None  # parse_options checked it
    corners = tuple(float(v) for p in front for v in p)
    return BodySpec(width, depth, height, tuple(cells), page.legs), corners


def _unit_rect(value: Sequence[float]) -> tuple[float, float, float, float]:
    u0, v0, u1, v1 = (float(v) for v in value)
    if not (u0 < u1 and v0 < v1):
        raise ConfigError("a rectangle has no area")
    low, high = np.clip([u0, v0], 0, 1), np.clip([u1, v1], 0, 1)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def make_server(marking: Marking) -> ThreadingHTTPServer:
    """A server on 127.0.0.1, at any free port; call `serve_forever` on it."""

    class Handler(BaseHTTPRequestHandler):
        """Serves the page, the photo and the state; takes new corners and the saved state."""

        timeout = PATIENCE  # of the socket: a request that never ends ends here

        def log_message(self, format: str, *args: Any) -> None:
            """Stay quiet."""

        def _local(self) -> bool:
            """Whether the page of this very server asks; others have been answered then."""
            port = self.connection.getsockname()[1]
            if is_own(self.headers.get_all("Host"), self.headers.get_all("Origin"), port):
                return True
            self._send(403, b"only the local page may talk to this server", "text/plain")
            return False

        def _send(self, code: int, body: bytes, kind: str) -> None:
            self.send_response(code)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body)

        def _json(self, value: Any, code: int = 200) -> None:
            self._send(code, json.dumps(value).encode(), "application/json")

        def do_GET(self) -> None:
            """Page, photo or state."""
            if not self._local():
                return
            path = self.path.partition("?")[0]
            if path == "/":
                page = resources.files("mam_sim.studio").joinpath("marking.html").read_bytes()
                self._send(200, page, "text/html; charset=utf-8")
            elif path == "/photo.jpg":
                self._send(200, jpeg(marking.photo.rgb), "image/jpeg")
            elif path == "/state":
                self._answer(lambda _: marking.state(), {})
            else:
                self._send(404, b"not found", "text/plain")

        def do_POST(self) -> None:
            """New corners (read the front again) or the finished state (save)."""
            if not self._local():
                return
            data = self._body()
            if data is None:
                return
            if self.path == "/detect":
                self._answer(self._front, data)
            elif self.path == "/save":
                self._answer(lambda d: {"next": marking.save(d)}, data)
            else:
                self._send(404, b"not found", "text/plain")

        def _body(self) -> dict[str, Any] | None:
            """What was sent; None where it cannot be used, which has been answered then."""
            said = self.headers.get("Content-Length") or ""
            if not (said.isascii() and said.isdigit()):
                self._json({"error": "Content-Length must say how many bytes follow"}, 411)
            elif len(said) > 9 or int(said) > MAX_BODY:
                self._json({"error": f"more than {MAX_BODY} bytes"}, 413)
            else:
                try:
                    data = json.loads(self.rfile.read(int(said)) or b"{}")
                    if isinstance(data, dict):
                        return data
                    self._json({"error": "the request must hold names and values"}, 400)
                except (ValueError, RecursionError):
                    self._json({"error": "not JSON"}, 400)
            self.close_connection = True
            return None

        def _front(self, data: dict[str, Any]) -> dict[str, Any]:
            page: FrontState = validated(FrontState, Document(data, "the request"))
            return marking.state([v for corner in page.front for v in corner])

        def _answer(self, make: Any, data: Any) -> None:
            try:
                self._json(make(data))
            except MamSimError as error:
                self._json({"error": str(error)}, 400)
            except (KeyError, TypeError) as error:
                self._json({"error": f"the request is incomplete: {error!r}"}, 400)

    return ThreadingHTTPServer((HOST, 0), Handler)


class MarkingPage:
    """The page of one photo, served in a thread of its own.

    Attributes:
        url: where it is. marking: what it shows and saves.
    """

    def __init__(self, marking: Marking) -> None:
        """Serve it."""
        self.marking = marking
        self._server = make_server(marking)
        self.url = f"http://{HOST}:{self._server.server_address[1]}/"
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def stop(self) -> None:
        """End the server."""
        self._server.shutdown()
        self._server.server_close()
