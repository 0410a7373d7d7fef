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
NOTICES = """
.mantine-Notification-root { pointer-events: none; }
.mantine-Notification-closeButton { pointer-events: auto; }
"""
"""Notices lie over the view; a click is meant for what is under them."""


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
    """The page, with `LIGHT` and `NOTICES` before all else; other answers as they are."""
    if response is None or response.headers.get("Content-Type") != "text/html":
        return response
    packed = response.headers.get("Content-Encoding") == "gzip"
    body = gzip.decompress(response.body) if packed else response.body
    head = f"<head><script>{LIGHT}</script><style>{NOTICES}</style>"
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
