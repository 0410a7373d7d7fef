"""A viser server that this machine's own page alone can talk to."""

from __future__ import annotations

import functools
import gzip
import http
import io
import os
import sys
import threading
import warnings
from collections.abc import Callable
from contextlib import redirect_stdout
from typing import TYPE_CHECKING, Any

from mam_pipeline.errors import InputError
from mam_pipeline.local_page import HOST, is_own
from mam_pipeline.optional import require

if TYPE_CHECKING:
    import viser

LIGHT = """
{
  const probe = document.createElement("canvas").getContext("webgl2");
  const info = probe?.getExtension("WEBGL_debug_renderer_info");
  const drawnBy = info ? probe.getParameter(info.UNMASKED_RENDERER_WEBGL) : "";
  probe?.getExtension("WEBGL_lose_context")?.loseContext();
  if (/swiftshader|llvmpipe|softpipe|software|basic render/i.test(drawnBy)) {
    const plain = HTMLCanvasElement.prototype.getContext;
    HTMLCanvasElement.prototype.getContext = function (kind, options) {
      return plain.call(this, kind, { ...options, antialias: false });
    };
    Object.defineProperty(window, "devicePixelRatio", { value: 1 });
    const close = ".mantine-Notification-closeButton";
    setTimeout(() => document.querySelectorAll(close).forEach((b) => b.click()), 10000);
  }
}
"""
"""Where the processor draws, smooth edges and the pixels of a fine screen would take most of the
frames a second: both are left out. Viser's notice about such drawing would stay for good."""
KEYS = """
{
  const page = document.documentElement;
  const letter = /^(Key.|Digit.|Space)$/;
  const press = (keys) => {
    const held = keys.split("+"), key = held.pop(), has = (name) => held.includes(name);
    page.dispatchEvent(new KeyboardEvent("keydown", {
      key, ctrlKey: has("ctrl"), shiftKey: has("shift"), bubbles: true,
    }));
  };
  page.addEventListener("keydown", (e) => /^Key[WASDQE]$/.test(e.code) && e.stopPropagation());
  addEventListener("keydown", (e) => {
    if (e.repeat && letter.test(e.code)) e.stopImmediatePropagation();
    else if (e.key === "?" && e.shiftKey && !e.target.closest?.("input, textarea")) press("?");
  }, true);
  const ready = setInterval(() => {
    if (!document.querySelector(".part")) return;
    clearInterval(ready);
    const large = matchMedia("(min-width: 2400px)");
    const fit = () => press(large.matches ? "large window" : "small window");
    if (large.matches) fit();
    large.addEventListener("change", fit);
  }, 200);
  addEventListener("click", (e) => {
    if (e.detail && e.target.closest?.("button, [role=tab]")) document.activeElement?.blur();
    const acts = e.target.closest?.("[data-key]:not([disabled])");
    if (acts) press(acts.dataset.key);
  }, true);
}
"""
"""Letters are keys of the studio, not of viser's camera; held ones act once. A click on what has a
`data-key` is the press of that key. A button that was clicked does not keep the space bar. Viser
takes the panel's width in pixels, so a window says by a key of its own whether it is large."""
POINTER = """
{
  let wanted = "", said = "", timer = 0;
  const write = () => {
    const field = document.querySelector("div:has(> .pointer) + div input");
    if (!field || wanted === said) return;
    said = wanted;
    Object.getOwnPropertyDescriptor(HTMLInputElement.prototype, "value").set.call(field, said);
    field.dispatchEvent(new Event("input", { bubbles: true }));
  };
  const rests = (what) => {
    if (what === wanted) return;
    wanted = what;
    clearTimeout(timer);
    timer = setTimeout(write, 120);
  };
  addEventListener("pointermove", (e) => {
    const row = e.target.closest?.("[data-over]"), view = e.target.tagName === "CANVAS";
    if (!view || e.buttons) return rests(row && !e.buttons ? row.dataset.over : "");
    const box = e.target.getBoundingClientRect();
    const share = (at, low, size) => Math.min(Math.max((at - low) / size, 0), 1).toFixed(4);
    rests(`at ${share(e.clientX, box.left, box.width)} ${share(e.clientY, box.top, box.height)}`);
  }, true);
  document.documentElement.addEventListener("pointerleave", () => rests(""));
}
"""
"""What the pointer rests on, a tenth of a second long, is written into a field of the page that
nobody sees (`hover.Hover`): a row that has `data-over`, or a place in the view."""
LOST = """
addEventListener("webglcontextlost", () => {
  const last = Number(sessionStorage.getItem("lost") ?? 0);
  sessionStorage.setItem("lost", Date.now());
  if (Date.now() - last > 20000) setTimeout(() => location.reload(), 500);
}, true);
"""
"""A view whose drawing process ended (a driver that was reset, a laptop that slept) stays as it is,
or white, for good. The page is loaded again; what was edited is the server's. Not more often than
every 20 s, where drawing fails each time."""
STYLE = """
@media (min-width: 1800px) { html { font-size: 115% !important; } }
@media (min-width: 2400px) { html { font-size: 140% !important; } }
.mantine-Notification-root { pointer-events: none; }
.mantine-Notification-closeButton { pointer-events: auto; }
:has(> [data-dock-tab]:nth-of-type(5)) > [data-dock-tab] { padding: 0 .25em !important; }
.object:hover { background: #e66e1418 !important; }
.head { padding: .4em .75em .1em; overflow-wrap: anywhere; }
.bar { display: flex; flex-wrap: wrap; gap: .35em; padding: .2em .75em .4em; }
.bar button, .busy button, .part button {
  font: inherit; font-size: .85em; padding: .15em .6em; border: 1px solid #8886; cursor: pointer;
  border-radius: .3em; background: none; color: inherit;
}
.bar button[disabled] { opacity: .4; cursor: not-allowed; }
.busy { display: flex; gap: .5em; align-items: center; padding: .2em .75em; font-size: .9em; }
.busy span { flex: 1; }
.asked { background: #d6288c18; align-items: start; }
.busy i {
  width: 1em; height: 1em; border: .15em solid #8886; border-top-color: #e66e14;
  border-radius: 50%; animation: round .8s linear infinite;
}
@keyframes round { to { transform: rotate(1turn); } }
.part {
  display: flex; gap: .4em; align-items: center; padding: .15em .75em .15em 0; cursor: pointer;
  font-size: .9em; line-height: 1.4;
}
div:has(> div > .part) { max-height: 45vh; overflow-y: auto; }
.part:hover, .part.over, .way:hover { background: #e66e1418; }
div:has(> .pointer), div:has(> .pointer) + div { display: none; }
.way { display: flex; gap: .6em; padding: .15em .75em; cursor: pointer; font-size: .9em; }
.way.now, .way.about { cursor: default; background: none; }
.way.now { font-weight: 600; }
.way.about { opacity: .75; }
.way span { margin-left: auto; opacity: .75; white-space: nowrap; }
.part.chosen { background: #e66e1433; }
.part kbd { width: .8em; opacity: .6; font-size: .8em; text-align: center; }
.part i { width: .7em; height: .7em; border-radius: 50%; flex: none; }
.part b { font-weight: 600; overflow-wrap: anywhere; min-width: 5em; }
.part svg { flex: none; }
div:has(> .part) + div > .mantine-Flex-root > :first-child { width: 2.2em !important; }
div:has(> .part) + div > .mantine-Flex-root > :first-child label { display: none; }
.part span { margin-left: auto; opacity: .75; text-align: right; }
.part.review span { color: #b8360b; opacity: 1; font-weight: 600; }
.part.dormant b, .part.dormant svg { opacity: .5; font-weight: 400; }
.keys { border-collapse: collapse; }
.keys { font-size: .85em; line-height: 1.3; }
.keys td { padding: .1em 1em .1em 0; }
.keys kbd, .bar kbd { border: 1px solid #8886; border-radius: .25em; padding: 0 .35em; }
"""
"""Of the page's own parts. Notices lie over the view; a click is meant for what is under them."""


def start(port: int, label: str) -> viser.ViserServer:
    """Listen on the loopback address.

    Viser answers whoever connects, and any page in the browser may connect to the loopback address;
    so requests of other pages, or for other names, are refused before viser sees them.

    Args:
        port: of the server; 0 takes any free one. label: title of the page's panel.

    Raises:
        InputError: the port is taken or impossible. MissingExtra: viser is not installed.
    """
    require("the studio", "viser")
    import viser
    import websockets.asyncio.server as websockets_server

    wanted = _checked_port(port)
    warnings.filterwarnings("ignore", module=r"viser\.infra")  # of values in a wrong message
    serve = websockets_server.serve

    @functools.wraps(serve)
    def guarded(handler: Any, *args: Any, process_request: Callable[..., Any], **more: Any) -> Any:
        def answer(connection: Any, request: Any) -> Any:
            said = request.headers
            if is_own(said.get_all("Host"), said.get_all("Origin"), connection.local_address[1]):
                return _with_script(process_request(connection, request))
            return connection.respond(http.HTTPStatus.FORBIDDEN, "only the local page may ask\n")

        return serve(_patient(handler), *args, process_request=answer, **more)

    with _PATCHING, redirect_stdout(io.StringIO()):  # it greets on stdout, where results go
        websockets_server.serve = guarded  # type: ignore[assignment,misc]
        try:
            server = viser.ViserServer(host=HOST, port=wanted, label=label, verbose=False)
        finally:
            websockets_server.serve = serve  # type: ignore[misc]
    return server


def _patient(handler: Callable[[Any], Any]) -> Callable[[Any], Any]:
    """Viser's handler, which ends a connection that sends what is no message of the page."""

    @functools.wraps(handler)
    async def handle(connection: Any) -> None:
        try:
            await handler(connection)
        except Exception as error:  # each wrong message fails at another place of viser
            if os.environ.get("MAM_SIM_DEBUG"):
                raise
            why = f"something that is no message ({type(error).__name__})"
            print(f"the page sent {why}; its connection was closed", file=sys.stderr)

    return handle


def _with_script(response: Any) -> Any:
    """The page, with our scripts and `STYLE` before all else; other answers as they are."""
    if response is None or response.headers.get("Content-Type") != "text/html":
        return response
    packed = response.headers.get("Content-Encoding") == "gzip"
    body = gzip.decompress(response.body) if packed else response.body
    head = f"<head><script>{LIGHT}{KEYS}{POINTER}{LOST}</script><style>{STYLE}</style>"
    body = body.replace(b"<head>", head.encode(), 1)
    response.body = gzip.compress(body, 1) if packed else body
    del response.headers["Content-Length"]
    response.headers["Content-Length"] = str(len(response.body))
    return response


_PATCHING = threading.Lock()


def _checked_port(port: int) -> int:
    """The port, or a free one for 0.

    Raises:
        InputError: it is no port.
    """
    import socket

    try:
        with socket.socket() as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind((HOST, port))
            return int(probe.getsockname()[1])
    except (OSError, OverflowError) as error:
        raise InputError(f"cannot listen on port {port} of {HOST}: {error}") from error
