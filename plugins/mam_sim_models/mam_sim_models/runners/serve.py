"""Puts a runner behind HTTP: `serve.py --port 8090 COMMAND ...` on the machine with the GPU.

POST /TASK with the input folder as a zip is answered with the output folder as a zip; COMMAND is
called with --task TASK --input DIR --output DIR, one request after the other. Anybody who reaches
the port can use it: it listens on this machine alone unless --host says otherwise.
"""

from __future__ import annotations

import argparse
import io
import os
import re
import signal
import subprocess
import sys
import tempfile
import threading
import zipfile
from collections.abc import Sequence
from contextlib import suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

MOST = 1 << 30  # bytes that come in, packed or unpacked
WITH_US = """
import ctypes, os, signal, sys
ctypes.CDLL(None).prctl(1, signal.SIGKILL)  # PR_SET_PDEATHSIG: it ends with the server
try:
    os.execvp(sys.argv[1], sys.argv[1:])
except OSError as error:
    sys.exit(f"{sys.argv[1]} cannot be started: {error}")
"""
TAIL = 1500  # letters of what a failed command said


class Refused(Exception):
    """A request that is not served: status and reason."""

    def __init__(self, status: int, why: str) -> None:
        super().__init__(why)
        self.status = status


class Handler(BaseHTTPRequestHandler):
    """One request."""

    command_line: Sequence[str] = ()
    time_limit = 3600.0
    one_at_a_time = threading.Lock()

    def do_POST(self) -> None:
        """Run the command on what was sent."""
        try:
            status, kind, body = 200, "application/zip", self._answer()
        except Refused as refusal:
            status, kind, body = refusal.status, "text/plain; charset=utf-8", str(refusal).encode()
        self.send_response(status)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def _answer(self) -> bytes:
        task = self.path.strip("/")
        length = int(self.headers.get("Content-Length") or 0)
        if length > MOST:
            raise Refused(413, f"more than {MOST >> 20} MiB")
        data = self.rfile.read(length)
        if not re.fullmatch(r"[a-z_]{1,40}", task):
            raise Refused(404, "the path must be the name of a task")
        with tempfile.TemporaryDirectory(prefix="mam-serve-") as scratch:
            inbox, outbox = Path(scratch, "in"), Path(scratch, "out")
            inbox.mkdir()
            outbox.mkdir()
            unpack(data, inbox)
            folders = ["--input", str(inbox), "--output", str(outbox)]
            with self.one_at_a_time:
                self._run([*self.command_line, "--task", task, *folders])
            return packed(outbox)

    def _run(self, command: list[str]) -> None:
        try:
            running = subprocess.Popen(
                [sys.executable, "-c", WITH_US, *command], stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, errors="replace",
                start_new_session=True,
            )  # fmt: skip
            _, said = running.communicate(timeout=self.time_limit)
        except subprocess.TimeoutExpired as late:
            raise Refused(504, f"no end within {self.time_limit:g} s") from late
        except OSError as error:
            raise Refused(500, f"{command[0]} cannot be started: {error}") from error
        finally:
            with suppress(ProcessLookupError, UnboundLocalError):
                os.killpg(running.pid, signal.SIGKILL)  # and what it left running
        if running.returncode:
            raise Refused(
                500, f"status {running.returncode}: {said.strip()[-TAIL:] or 'it said nothing'}"
            )


def unpack(data: bytes, folder: Path) -> None:
    """A zip into a folder; raises Refused where it is none, too large, or leads outside."""
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            if sum(entry.file_size for entry in archive.infolist()) > MOST:
                raise Refused(413, f"more than {MOST >> 20} MiB")
            for entry in archive.infolist():
                if not (folder / entry.filename).resolve().is_relative_to(folder.resolve()):
                    raise Refused(400, "a path leads outside the folder")
            archive.extractall(folder)
    except (zipfile.BadZipFile, OSError, RuntimeError, NotImplementedError) as error:
        raise Refused(400, f"the body is no zip: {error}") from error


def packed(folder: Path) -> bytes:
    """All files of a folder as a zip."""
    body = io.BytesIO()
    with zipfile.ZipFile(body, "w", zipfile.ZIP_DEFLATED) as archive:
        for file in sorted(p for p in folder.rglob("*") if p.is_file()):
            archive.write(file, file.relative_to(folder).as_posix())
    return body.getvalue()


def main() -> None:
    """Serve until stopped."""
    parser = argparse.ArgumentParser(description="Put a runner behind HTTP.")
    parser.add_argument("--host", default="127.0.0.1")
    parser.add_argument("--port", type=int, default=8090)
    parser.add_argument("--time-limit", type=float, default=3600, help="seconds of one request")
    parser.add_argument("command", nargs=argparse.REMAINDER, help="the runner and its arguments")
    args = parser.parse_args()
    if not args.command:
        parser.error("name the runner's command")
    Handler.command_line, Handler.time_limit = args.command, args.time_limit
    server = ThreadingHTTPServer((args.host, args.port), Handler)
    print(f"serving at http://{args.host}:{server.server_port}", file=sys.stderr, flush=True)
    with suppress(KeyboardInterrupt):
        server.serve_forever()


if __name__ == "__main__":
    main()
