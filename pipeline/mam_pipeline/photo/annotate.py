"""The annotation page's server: a person marks front, panels and handles; hints are saved.

Loopback only. State in the page's words: corners in pixels of the upright photo, rectangles in
front coordinates (0..1, u to the right, v down), sizes in metres.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np

from mam_pipeline.errors import ConfigError, MamSimError
from mam_pipeline.hints import save_hints
from mam_pipeline.photo.build import BodySpec, CellSpec, HandleSpec, build_object
from mam_pipeline.photo.find import Found, find_object
from mam_pipeline.photo.image import Photo, read_photo
from mam_pipeline.photo.measure import jpeg
from mam_pipeline.photo.options import PhotoOptions, parse_options
from mam_pipeline.photo.reconstruct import sizes_of

KINDS = ("drawer", "door", "open", "fixed")
HOSTS = ("127.0.0.1", "localhost")
MAX_BODY = 1_000_000


class Annotation:
    """One photo being annotated: what was found, and saving what the person made of it."""

    def __init__(self, path: Path, out: Path, options: Mapping[str, Any] | None = None) -> None:
        self.path, self.out = path, out
        self.options = parse_options(options or {})
        self.photo: Photo = read_photo(path)
        self.saved = 0

    def state(self, front: Sequence[float] | None = None) -> dict[str, Any]:
        """What is on the photo; with `front` (8 pixels) the corners are taken as given."""
        options = self.options
        if front is not None:
            options = parse_options({"front": list(front)})
            options = replace(self.options, front=options.front)
        found = find_object(self.photo, options)
        sizes, _ = sizes_of(found, self.options)
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
        """Write the hints file from a page's state; returns the next command.

        Raises:
            ConfigError: numbers are missing, or corners or rectangles that cannot be.
        """
        spec, front = spec_of_state(state)
        _, hints = build_object(spec)
        save_hints(replace(hints, photo_front=front), self.out)
        self.saved += 1
        return f"mam-sim make-env {self.path} --hints {self.out}"


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
    try:
        front = parse_options({"front": [v for p in state["front"] for v in p]}).front
        width, height, depth = (float(state[k]) for k in ("width", "height", "depth"))
        legs = float(state.get("legs", 0.0))
        rows = [
            (str(p["kind"]), str(p.get("hinge", "left")), _unit_rect(p["rect"]), p["handles"])
            for p in state["panels"]
        ]
        marks = [[_unit_rect(k) for k in handles] for *_, handles in rows]
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigError(f"the annotation is incomplete: {error!r}") from error
    for name, value in (("width", width), ("height", height), ("depth", depth)):
        if not 0.02 <= value <= 20:
            raise ConfigError(f"{name} must be metres between 0.02 and 20, got {value}")
    numbers: dict[str, int] = {}
    cells = []
    for (kind, hinge, rect, _), handles in zip(rows, marks):
        if kind not in KINDS:
            raise ConfigError(f"{kind!r} is not one of {', '.join(KINDS)}")
        n = numbers.get(kind, 0)
        numbers[kind] = n + 1

        def metric(r: tuple[float, ...]) -> tuple[float, float, float, float]:
            return r[0] * width, (1 - r[3]) * height, r[2] * width, (1 - r[1]) * height

        specs = tuple(HandleSpec(metric(k), True, "user") for k in handles)
        side = hinge if kind == "door" else None
        cells.append(CellSpec(f"{kind}_{n}", kind, metric(rect), side, specs, 1.0, "user"))
    assert front is not None  # parse_options checked it
    corners = tuple(float(v) for p in front for v in p)
    return BodySpec(width, depth, height, tuple(cells), max(0.0, legs)), corners


def _unit_rect(value: Sequence[float]) -> tuple[float, float, float, float]:
    u0, v0, u1, v1 = (float(v) for v in value)
    if not (u0 < u1 and v0 < v1):
        raise ConfigError("a rectangle has no area")
    low, high = np.clip([u0, v0], 0, 1), np.clip([u1, v1], 0, 1)
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


def make_server(annotation: Annotation, port: int = 0) -> ThreadingHTTPServer:
    """A server on 127.0.0.1 (port 0: any free one); call `serve_forever` on it."""

    class Handler(BaseHTTPRequestHandler):
        """Serves the page, the photo and the state; takes new corners and the saved state."""

        def log_message(self, format: str, *args: Any) -> None:
            """Stay quiet."""

        def _local(self) -> bool:
            host = (self.headers.get("Host") or "").rsplit(":", 1)[0]
            origin = self.headers.get("Origin")
            same = origin is None or origin.split("//")[-1].rsplit(":", 1)[0] in HOSTS
            if host in HOSTS and same:
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
                page = resources.files("mam_pipeline.photo").joinpath("annotate.html").read_bytes()
                self._send(200, page, "text/html; charset=utf-8")
            elif path == "/photo.jpg":
                self._send(200, jpeg(annotation.photo.rgb), "image/jpeg")
            elif path == "/state":
                self._answer(lambda _: annotation.state(), {})
            else:
                self._send(404, b"not found", "text/plain")

        def do_POST(self) -> None:
            """New corners (read the front again) or the finished state (save)."""
            if not self._local():
                return
            length = int(self.headers.get("Content-Length") or 0)
            if length > MAX_BODY:
                self._json({"error": "too large"}, 413)
                return
            try:
                data = json.loads(self.rfile.read(length) or b"{}")
            except ValueError:
                self._json({"error": "not JSON"}, 400)
                return
            if self.path == "/detect":
                self._answer(lambda d: annotation.state([v for p in d["front"] for v in p]), data)
            elif self.path == "/save":
                self._answer(lambda d: {"next": annotation.save(d)}, data)
            else:
                self._send(404, b"not found", "text/plain")

        def _answer(self, make: Any, data: Any) -> None:
            try:
                self._json(make(data))
            except MamSimError as error:
                self._json({"error": str(error)}, 400)
            except (KeyError, TypeError) as error:
                self._json({"error": f"the request is incomplete: {error!r}"}, 400)

    return ThreadingHTTPServer(("127.0.0.1", port), Handler)


__all__ = ["Annotation", "PhotoOptions", "make_server", "spec_of_state"]
