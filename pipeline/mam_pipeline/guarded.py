"""Child processes with limits, which end with whoever asked for them.

A child may take so many seconds, and so much memory together with all that it starts. It is
killed, with its children, at a limit, when its parent fails or is told to stop, and also when its
parent is killed itself.

    python -m mam_pipeline.guarded PARENT SECONDS GIGABYTES COMMAND...

runs a program that is not ours in this way.
"""

from __future__ import annotations

import contextlib
import ctypes
import os
import resource
import select
import signal
import sys
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from mam_pipeline.errors import disk_error, disk_is_full

MIB = 2**20


@dataclass(frozen=True)
class Watching:
    """How children are watched.

    Attributes:
        look: seconds between two looks at a child's memory. shown: characters of its last words.
        no_room: exit status where the disk is full; the last line says where (EX_IOERR of
            sysexits.h).
        parent_death, subreaper: numbers of prctl(2) for the signal at the parent's death, and for
            taking over the orphans among one's descendants.
    """

    look: float = 0.1
    shown: int = 2000
    no_room: int = 74
    parent_death: int = 1
    subreaper: int = 36


WATCHING = Watching()


@dataclass(frozen=True)
class Ending:
    """How a child ended.

    Attributes:
        how: done | timeout | memory | disk | crash | killed (by somebody else). why: in a sentence.
        log: its last words. limit: what it exceeded, seconds or megabytes.
        tries: how often it was begun. status: what it ended with.
    """

    how: str
    why: str = ""
    log: str = ""
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    peak_mb: float = 0.0
    limit: float = 0.0
    tries: int = 1
    status: int = 0


@dataclass(frozen=True)
class Limits:
    """Guards of one task. They end it with a reason, and are no part of what its result is.

    Attributes:
        seconds: on the clock. memory: resident, of the child and all that it starts, gigabytes.
    """

    seconds: float = 1800.0
    memory: float = 8.0


def watched(
    work: Callable[[], None], limits: Limits, log: IO[bytes], askers: Sequence[int] = ()
) -> Ending:
    """Fork a child that does some work, and wait for its end or end it.

    Args:
        log: an open file; what the child prints goes there.
        askers: handles that can be read when whoever asked is gone; then all of it ends. This
            process has no other children then, and what the child leaves behind ends with it.
    """
    began, parent = time.perf_counter(), os.getpid()
    child = os.fork()
    if child == 0:
        _child(work, log, parent)
    how, why, limit = "done", "", 0.0
    handle = os.pidfd_open(child)
    try:
        while True:
            left = max(0.0, began + limits.seconds - time.perf_counter())
            ready, _, _ = select.select([handle, *askers], [], [], min(WATCHING.look, left))
            if handle in ready:
                break
            if ready:  # whoever asked is gone
                raise SystemExit(0)
            if time.perf_counter() - began >= limits.seconds:
                how, limit = "timeout", limits.seconds
                why = f"it took longer than {limits.seconds:g} s"
            elif resident(family(child)) > 1024 * limits.memory:
                how, limit = "memory", 1024 * limits.memory
                why = f"it took more than {limits.memory:g} GB of memory"
            if how != "done":
                break
    finally:
        os.close(handle)
        kill_family(child)  # and whatever it left running
        _, status, used = os.wait4(child, 0)
        if askers:
            _end_orphans()
    code = os.waitstatus_to_exitcode(status)
    if how == "done" and code != 0:
        how = "killed" if code == -signal.SIGKILL else "crash"
        name = signal.strsignal(-code) if code < 0 else f"exit status {code}"
        why = f"its process crashed: {name}"
    text = last_words(log) if how in ("crash", "killed") else ""
    if code == WATCHING.no_room:
        how, why, text = "disk", text.splitlines()[-1], ""
    return Ending(
        how, why, text, round(time.perf_counter() - began, 2),
        round(used.ru_utime + used.ru_stime, 2), round(used.ru_maxrss / 1024, 1), limit,
        status=code,
    )  # fmt: skip


def _end_orphans() -> None:
    """End what a child left with another parent than its own (`adopt_orphans`)."""
    for orphan in _children(os.getpid()):
        kill_family(orphan)
        with contextlib.suppress(ChildProcessError):
            os.waitpid(orphan, 0)


def _child(work: Callable[[], None], log: IO[bytes], parent: int) -> None:
    """Do the work in a session of its own; never returns."""
    code = 1
    try:
        for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
            signal.signal(number, signal.SIG_DFL)
        signal.set_wakeup_fd(-1)
        os.setsid()
        end_with(parent)
        resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(log.fileno(), 1)
        os.dup2(log.fileno(), 2)
        work()
        code = 0
    except BaseException as error:
        traceback.print_exc()
        if isinstance(error, OSError) and disk_is_full(error):
            print(disk_error(error), file=sys.stderr)
            code = WATCHING.no_room
    finally:
        with contextlib.suppress(Exception):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def last_words(log: IO[bytes]) -> str:
    """The end of what a child printed."""
    log.seek(0)
    return log.read().decode("utf-8", "replace")[-WATCHING.shown :]


def end_with(parent: int) -> None:
    """Have the kernel kill this process when its parent dies; ends it where that has happened."""
    ctypes.CDLL(None).prctl(WATCHING.parent_death, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)


def adopt_orphans() -> None:
    """Make this process the parent of all descendants whose own is gone."""
    ctypes.CDLL(None).prctl(WATCHING.subreaper, 1)


def family(process: int) -> list[int]:
    """A process and all that descend from it, the eldest first."""
    out = [process]
    for member in out:
        out += _children(member)
    return out


def _children(process: int) -> list[int]:
    found: list[int] = []
    with contextlib.suppress(OSError):  # it is gone
        for thread in os.listdir(f"/proc/{process}/task"):
            text = Path(f"/proc/{process}/task/{thread}/children").read_text(encoding="utf-8")
            found += [int(word) for word in text.split()]
    return found


def kill_family(process: int) -> None:
    """Kill a process, its session and all that descend from it."""
    while True:
        members = family(process)
        for kill in (os.killpg, os.kill):
            for member in members:
                with contextlib.suppress(ProcessLookupError, PermissionError):
                    kill(member, signal.SIGKILL)
        if not set(family(process)) - set(members):  # none was born meanwhile
            return


def resident(processes: Sequence[int]) -> float:
    """Megabytes of memory that processes hold.

    One that has been started and runs nothing of its own yet (vfork) lies in its parent's memory,
    which counts once.

    Args:
        processes: parents before their children.
    """
    sizes: dict[int, str] = {}
    total = 0
    for process in processes:
        with contextlib.suppress(OSError, IndexError):  # it is gone
            size = Path(f"/proc/{process}/statm").read_text(encoding="utf-8")
            parent = int(
                Path(f"/proc/{process}/stat")
                .read_text(encoding="utf-8")
                .rpartition(")")[2]
                .split()[1]
            )
            sizes[process] = size
            if size != sizes.get(parent):
                total += int(size.split()[1])
    return total * os.sysconf("SC_PAGESIZE") / MIB


def guarded(command: Sequence[str], limits: Limits) -> list[str]:
    """A command that runs another one, which ends with this process or at a limit."""
    own = [sys.executable, "-P", "-m", __name__, str(os.getpid())]
    return [*own, f"{limits.seconds:g}", f"{limits.memory:g}", *command]


def main(parent: str, seconds: str, memory: str, *command: str) -> int:
    """Run a command in a child that is watched; returns its status.

    It reads and writes what this process does, and is told no signal: it is killed.
    """
    handle = os.pidfd_open(int(parent))
    if os.getppid() != int(parent):
        return 1
    adopt_orphans()
    streams = [os.dup(n) for n in (0, 1, 2)]

    def replace() -> None:
        for number, stream in enumerate(streams):
            os.dup2(stream, number)
        os.execvp(command[0], list(command))

    def stop(*_: object) -> None:
        raise SystemExit(128 + signal.SIGTERM)  # `watched` kills on its way out

    signal.signal(signal.SIGTERM, stop)
    with open(os.devnull, "r+b") as log:
        ending = watched(replace, Limits(float(seconds), float(memory)), log, (handle,))
    if ending.how in ("timeout", "memory"):
        print(ending.why, file=sys.stderr)
        return 124 if ending.how == "timeout" else 137
    return ending.status if ending.status >= 0 else 128 - ending.status


if __name__ == "__main__":
    raise SystemExit(main(*sys.argv[1:]))
