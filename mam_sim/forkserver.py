"""A process that has imported everything once, and forks a child for every task.

What a task does to its process (memory that is not given back, a crash in native code, an
endless loop) ends with the child. The server watches it: it kills the child that exceeds its time
or memory, and also when whoever asked is gone. Requests and replies are pickles on the server's
standard input and output.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import os
import pickle
import queue
import select
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, replace
from typing import IO, Protocol, TypeVar

from mam_pipeline.errors import disk_error, disk_is_full

T = TypeVar("T", bound="Task")
LOOK = 0.1  # seconds between two looks at a child
SHOWN = 2000  # characters of a crashed child's last words
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""A process per core serves many tasks better than threads do, and threads survive no fork."""
_PR_SET_PDEATHSIG = 1
_NO_ROOM = 74
"""Exit status of a child whose disk is full; its last line says where (EX_IOERR of sysexits.h)."""
_SERVE = "from mam_sim.forkserver import main; main()"


@dataclass(frozen=True)
class Ending:
    """How a child ended.

    Attributes:
        how: done | timeout | memory | disk | crash | killed (by somebody else). why: in a sentence.
        log: its last words. limit: what it exceeded, seconds or megabytes.
        tries: how often it was begun.
    """

    how: str
    why: str = ""
    log: str = ""
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    peak_mb: float = 0.0
    limit: float = 0.0
    tries: int = 1


@dataclass(frozen=True)
class Limits:
    """Guards of one task. They end it with a reason, and are no part of what its result is.

    Attributes:
        seconds: on the clock. memory: resident, gigabytes.
    """

    seconds: float = 1800.0
    memory: float = 8.0


class Task(Protocol):
    """What a child does; it is pickled, and says what it found in files."""

    @property
    def limits(self) -> Limits: ...

    def warm(self) -> None:
        """Import and read what such tasks need; done once, in the server."""

    def run(self) -> None:
        """Do it, in the child."""


class ForkServer:
    """The server as those see it who ask: one task at a time, started at the first."""

    def __init__(self) -> None:
        self._process: subprocess.Popen[bytes] | None = None
        self._lock = threading.Lock()
        # what the server says when it dies
        self._words = tempfile.TemporaryFile()  # noqa: SIM115 - it lives as long as the server
        self.closed = False

    def run(self, task: Task) -> Ending:
        """Have a child do a task; never raises for what goes wrong in the child.

        Raises:
            KeyboardInterrupt: the server was closed meanwhile.
        """
        server = self._started()
        assert server.stdin is not None and server.stdout is not None
        try:
            pickle.dump(task, server.stdin)
            server.stdin.flush()
            ending: Ending = pickle.load(server.stdout)
            return ending
        except (EOFError, BrokenPipeError, pickle.UnpicklingError):
            if self.closed:
                raise KeyboardInterrupt from None
            self._process = None  # the next task gets a new one
            status = server.wait()
            why = f"the server of its process ended with status {status}"
            return Ending("killed" if status < 0 else "crash", why, _last_words(self._words))

    def close(self) -> None:
        """End the server and the child at work."""
        self.closed = True
        with self._lock:
            if self._process is not None:
                self._process.kill()
                self._process.wait()

    def _started(self) -> subprocess.Popen[bytes]:
        with self._lock:
            if self.closed:
                raise KeyboardInterrupt
            if self._process is None:
                self._process = subprocess.Popen(
                    [sys.executable, "-c", _SERVE],
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=self._words,
                    env={**os.environ, **{k: os.environ.get(k, "1") for k in ONE_THREAD}},
                    start_new_session=True,  # Ctrl-C is for whoever asked
                )
            return self._process


def run_all(tasks: Sequence[T], processes: int) -> Iterator[tuple[T, Ending]]:
    """Do tasks on this machine, so many at once; each comes with its ending when it is done.

    What was killed by somebody else, as the system does where memory runs out, is begun once more
    when all others are done, alone.
    """
    again = []
    for task, ending in _all_once(tasks, processes):
        if ending.how == "killed":
            again.append(task)
        else:
            yield task, ending
    for task in again:
        yield from ((t, _second(ending)) for t, ending in _all_once([task], 1))


def _second(ending: Ending) -> Ending:
    """How a task ended that was begun once more, alone."""
    if ending.how != "killed":
        return replace(ending, tries=2)
    why = f"{ending.why}, and so it was when it was tried once more, alone"
    return replace(ending, how="crash", why=why, tries=2)


def _all_once(tasks: Sequence[T], processes: int) -> Iterator[tuple[T, Ending]]:
    """Do every task once."""
    servers = [ForkServer() for _ in range(max(1, min(processes, len(tasks))))]
    idle: queue.LifoQueue[ForkServer] = queue.LifoQueue()
    for server in servers:
        idle.put(server)

    def done(task: T) -> tuple[T, Ending]:
        server = idle.get()
        try:
            return task, server.run(task)
        finally:
            idle.put(server)

    pool = ThreadPoolExecutor(len(servers))
    try:
        for future in as_completed([pool.submit(done, task) for task in tasks]):
            yield future.result()
    finally:
        for server in servers:
            server.close()
        pool.shutdown(cancel_futures=True)


_OWN: list[ForkServer] = []


def on_this_process(task: Task) -> Ending:
    """Have a task done by the one server of this process, as a worker of Ray does."""
    if not _OWN:
        _OWN.append(ForkServer())
    ending = _OWN[0].run(task)
    return ending if ending.how != "killed" else _second(_OWN[0].run(task))


def main() -> None:
    """Serve until standard input ends."""
    replies = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print is no reply
    warmed: set[type] = set()
    while True:
        try:
            task = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        if type(task) not in warmed:
            task.warm()
            warmed.add(type(task))
            gc.collect()
            gc.freeze()  # children share these pages as long as nobody walks through them
        pickle.dump(_watched(task), replies)
        replies.flush()


def _watched(task: Task) -> Ending:
    """Fork a child for the task, and wait for its end or end it."""
    limits, began = task.limits, time.perf_counter()
    with tempfile.TemporaryFile() as log:
        child = os.fork()
        if child == 0:
            _child(task, log)
        how, why, limit = "done", "", 0.0
        handle = os.pidfd_open(child)
        try:
            while True:
                ready, _, _ = select.select([handle, sys.stdin.fileno()], [], [], LOOK)
                if handle in ready:
                    break
                if ready:  # whoever asked is gone
                    _kill(child)
                    sys.exit(0)
                megabytes = _resident(child)
                if time.perf_counter() - began > limits.seconds:
                    how, limit = "timeout", limits.seconds
                    why = f"it took longer than {limits.seconds:g} s"
                elif megabytes > 1024 * limits.memory:
                    how, limit = "memory", 1024 * limits.memory
                    why = f"it took more than {limits.memory:g} GB of memory"
                if how != "done":
                    _kill(child)
                    break
        finally:
            os.close(handle)
        _, status, used = os.wait4(child, 0)
        with contextlib.suppress(ProcessLookupError, PermissionError):
            os.killpg(child, signal.SIGKILL)  # whatever it left running
        code = os.waitstatus_to_exitcode(status)
        if how == "done" and code != 0:
            how = "killed" if code == -signal.SIGKILL else "crash"
            name = signal.strsignal(-code) if code < 0 else f"exit status {code}"
            why = f"its process crashed: {name}"
        text = ""
        if how in ("crash", "killed"):
            text = _last_words(log)
        if code == _NO_ROOM:
            how, why, text = "disk", text.splitlines()[-1], ""
    return Ending(
        how, why, text, round(time.perf_counter() - began, 2),
        round(used.ru_utime + used.ru_stime, 2), round(used.ru_maxrss / 1024, 1), limit,
    )  # fmt: skip


def _child(task: Task, log: IO[bytes]) -> None:
    """Do the task in a session of its own; never returns."""
    code = 1
    try:
        os.setsid()
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        os.dup2(log.fileno(), 1)
        os.dup2(log.fileno(), 2)
        task.run()
        code = 0
    except BaseException as error:
        import traceback

        traceback.print_exc()
        if isinstance(error, OSError) and disk_is_full(error):
            print(disk_error(error), file=sys.stderr)
            code = _NO_ROOM
    finally:
        with contextlib.suppress(Exception):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def _last_words(log: IO[bytes]) -> str:
    log.seek(0)
    return log.read().decode("utf-8", "replace")[-SHOWN:]


def _kill(child: int) -> None:
    """Kill a child and all that it started."""
    for kill in (os.killpg, os.kill):
        with contextlib.suppress(ProcessLookupError, PermissionError):
            kill(child, signal.SIGKILL)


def _resident(process: int) -> float:
    """Megabytes of memory that a process holds; 0 when it is gone."""
    try:
        with open(f"/proc/{process}/statm") as stream:
            return int(stream.read().split()[1]) * os.sysconf("SC_PAGESIZE") / 2**20
    except (OSError, IndexError):
        return 0.0


if __name__ == "__main__":
    main()
