"""Reading files of strangers in a process of its own, which has limits.

Their readers are large libraries that were not made for hostile files: one may crash them, take all
memory, or keep them busy for hours. Here it costs a child process (`mam_pipeline.forkserver`): half
a second for the first file, milliseconds for the next.
"""

from __future__ import annotations

import os
import pickle
import resource
import sys
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TypeVar

from mam_pipeline.errors import InputError, MamSimError
from mam_pipeline.forkserver import in_child
from mam_pipeline.guarded import Limits

T = TypeVar("T")


@dataclass(frozen=True)
class Bounds:
    """What reading one file may take.

    Attributes:
        seconds: of time. memory: gigabytes. answer: bytes of what was found.
    """

    seconds: float = 300.0
    memory: float = 8.0
    answer: int = 4 << 30


BOUNDS = Bounds()


def apart(work: Callable[[], T], file: Path, kind: str, instead: str = "export it as GLB") -> T:
    """Do some work on a file in a child process; what it gives, or its error, comes back.

    Args:
        work: can be pickled, and gives something that can. file: what it reads, for errors.
        kind: of the file, in a word: USD. instead: what to do where it cannot be read.

    Raises:
        InputError: the work crashed, took too long or too much, or raised what is no error of ours.
        MamSimError: what the work raised.
    """
    bounds = BOUNDS
    with open(os.memfd_create("found"), "w+b") as found:
        handle = f"/proc/{os.getpid()}/fd/{found.fileno()}"
        ending = in_child(
            _Reading(pickle.dumps(work), tuple(sys.path), os.getcwd(), handle, bounds)
        )
        if ending.how == "timeout":
            raise InputError(f"{file} took more than {bounds.seconds:.0f} s to read; simplify it")
        if ending.how == "memory" or "MemoryError" in ending.log:
            raise InputError(f"{file} takes more than {bounds.memory:g} GB to read; simplify it")
        if ending.how != "done":
            lines = ending.log.strip().splitlines()
            why = lines[-1][:200] if lines else ending.why
            raise InputError(f"{file} cannot be read as {kind} ({why}); {instead}")
        found.seek(0)
        answer = pickle.load(found)  # written by our own process
    if isinstance(answer, MamSimError):
        raise answer
    result: T = answer
    return result


@dataclass(frozen=True)
class _Reading:
    """What the child does.

    Attributes:
        work: pickled. path: `sys.path` of whoever asks.
        folder: its working folder. found: the file for the answer. bounds: of the work.
    """

    work: bytes
    path: tuple[str, ...]
    folder: str
    found: str
    bounds: Bounds

    @property
    def limits(self) -> Limits:
        return Limits(self.bounds.seconds, self.bounds.memory)

    def warm(self) -> None:
        """Import the function's module; the libraries of its format are the child's."""
        sys.path[:] = self.path
        with suppress(Exception):  # the child says what is wrong
            pickle.loads(self.work)

    def run(self) -> None:
        """Do the work, in the child."""
        os.chdir(self.folder)
        with open(self.found, "wb") as found:
            _answer(pickle.loads(self.work), found, self.bounds)


def _answer(work: Callable[[], object], found: IO[bytes], bounds: Bounds) -> None:
    """Write what the work gives, or our error about it."""
    page, size = (
        resource.getpagesize(),
        int(Path("/proc/self/statm").read_text(encoding="utf-8").split()[5]),
    )
    most = size * page + int(bounds.memory * 2**30)
    for kind, limit in ((resource.RLIMIT_DATA, most), (resource.RLIMIT_FSIZE, bounds.answer)):
        hard = resource.getrlimit(kind)[1]
        limit = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
        resource.setrlimit(kind, (limit, hard))
    answer: object
    try:
        answer = work()
    except MamSimError as error:
        answer = error
    pickle.dump(answer, found, protocol=pickle.HIGHEST_PROTOCOL)
    found.flush()
