"""Reading files of strangers in a process of its own, which has limits.

Their readers are large libraries that were not made for hostile files: one may crash them, take all
memory, or keep them busy for hours. Here it costs a child process. It is a copy of this process, so
that a small file takes milliseconds more, and nothing is imported twice.
"""

from __future__ import annotations

import os
import pickle
import resource
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TypeVar

from mam_pipeline.errors import InputError, MamSimError
from mam_pipeline.guarded import Limits, watched

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
        work: gives something that can be pickled. file: what it reads, for errors.
        kind: of the file, in a word: USD. instead: what to do where it cannot be read.

    Raises:
        InputError: the work crashed, took too long or too much, or raised what is no error of ours.
        MamSimError: what the work raised.
    """
    bounds = BOUNDS
    with tempfile.TemporaryFile() as log, open(os.memfd_create("found"), "w+b") as found:
        ending = watched(
            lambda: _answer(work, found, bounds), Limits(bounds.seconds, bounds.memory), log
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
