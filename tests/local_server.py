"""A loopback server for stand-ins that speak the real protocol."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any


class Replies(BaseHTTPRequestHandler):
    """Answers GET and POST alike by `reply`."""

    def reply(self, body: bytes) -> tuple[int, str, bytes]:
        """Status, content type and body of the answer to a request with some body."""
        return 404, "text/plain", body[:0]

    def _do(self) -> None:
        length = int(self.headers.get("Content-Length") or 0)
        status, kind, body = self.reply(self.rfile.read(length))
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
        """Stay quiet."""


@contextmanager
def served(handler: Callable[..., BaseHTTPRequestHandler]) -> Iterator[str]:
    """The address of a server that runs meanwhile."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    yield f"http://127.0.0.1:{server.server_port}"
    server.shutdown()
    server.server_close()
