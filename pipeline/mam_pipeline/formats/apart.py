"""Readers that run in a process of their own: native importers of CAD, USD and FBX files.

They are large libraries that were not made for files of strangers: a broken file may crash them or
keep them busy for hours. Here it costs a process, which ends after a time.

    python -m mam_pipeline.formats.apart KIND FILE OUT ROOT OUTSIDE
"""

from __future__ import annotations

import os
import pickle
import resource
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from mam_pipeline.errors import InputError, MamSimError
from mam_pipeline.formats.door import may_leave, outside_allowed
from mam_pipeline.formats.soup import FileContent

READERS = {
    "fbx": "mam_pipeline.formats.fbx:read_fbx",
    "step": "mam_pipeline.formats.step:read_step",
    "usd": "mam_pipeline.formats.usd:read_usd",
}


@dataclass(frozen=True)
class Bounds:
    """What a reader may take.

    Attributes:
        seconds: of time. bytes: of memory.
    """

    seconds: float = 300.0
    bytes: int = 8 << 30


BOUNDS = Bounds()


def read_apart(kind: str, file: Path, root: Path | None = None) -> FileContent:
    """What one of `READERS` finds in a file.

    Args:
        kind: of `READERS`. file: what is read. root: folder whose files it may name.

    Raises:
        InputError: the file cannot be read, or the reader crashed or took too long.
        MissingExtra: the package that reads such files is not installed.
    """
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "content.pickle"
        more = ["" if root is None else str(root.resolve()), "yes" if may_leave() else ""]
        command = [sys.executable, "-m", __name__, kind, str(file.resolve()), str(out), *more]
        path = os.pathsep.join(p for p in sys.path if p)
        try:
            done = subprocess.run(
                command, capture_output=True, text=True, errors="replace",
                timeout=BOUNDS.seconds, env={**os.environ, "PYTHONPATH": path},
            )  # fmt: skip
        except subprocess.TimeoutExpired as error:
            raise InputError(
                f"{file} took more than {BOUNDS.seconds:.0f} s to read; simplify it"
            ) from error
        if not out.is_file():
            lines = done.stderr.strip().splitlines()
            why = lines[-1][:200] if lines else f"exit status {done.returncode}"
            raise InputError(f"{file} cannot be read as {kind.upper()} ({why}); export it as GLB")
        answer = pickle.loads(out.read_bytes())  # written by our own process
    if isinstance(answer, MamSimError):
        raise answer
    content: FileContent = answer
    return content


def main(kind: str, file: str, out: str, root: str, outside: str) -> int:
    """Read one file and leave what was found, or our error about it, in `out`."""
    resource.setrlimit(resource.RLIMIT_DATA, (BOUNDS.bytes, BOUNDS.bytes))
    module, _, name = READERS[kind].partition(":")
    answer: object
    try:
        with outside_allowed(bool(outside)):
            read = getattr(import_module(module), name)
            answer = read(Path(file), Path(root) if root else None)
    except MamSimError as error:
        answer = error
    Path(out).write_bytes(pickle.dumps(answer))
    return 0


if __name__ == "__main__":
    raise SystemExit(main(*sys.argv[1:]))
