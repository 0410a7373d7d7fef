"""A process that has imported everything once, and forks a child for every task.

What a task does to its process (memory that is not given back, a crash in native code, an
endless loop) ends with the child. The server watches it (`mam_pipeline.guarded`): it kills the
child that exceeds its time or memory, and also when whoever asked is gone. Requests and replies are
pickles on the server's standard input and output.

The process of whoever asks is not forked itself: it may have threads, of which a child has none.
Locks that these held stay locked in the child, and a library that waits for them waits for ever.
"""

from __future__ import annotations

import gc
import os
import pickle
import queue
import select
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import replace
from typing import Protocol, TypeVar

from mam_pipeline.guarded import Ending, Limits, adopt_orphans, last_words, watched

T = TypeVar("T", bound="Task")
ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""A process per core serves many tasks better than threads do, and threads survive no fork."""
_SERVE = "import sys; sys.path[:] = {path!r}; from {name} import main; main(int(sys.argv[1]))"


class Task(Protocol):
    """What a child does; it is pickled, and says what it found in files."""

    @property
    def limits(self) -> Limits: ...

    def warm(self) -> None:
        """Import and read what such tasks need, in the server; there is nothing to do twice."""

    def run(self) -> None:
        """Do it, in the child."""


class ForkServer:
    """The server as those see it who ask: one task at a time, started at the first."""

    def __init__(self, grace: float = 5.0) -> None:
        """`grace`: seconds in which it ends its child and itself when nobody asks any more."""
        self.grace = grace
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
        request = pickle.dumps(task)
        server = self._started()
        assert server.stdin is not None and server.stdout is not None
        try:
            server.stdin.write(request)
            server.stdin.flush()
            ending: Ending = pickle.load(server.stdout)
            return ending
        except (EOFError, BrokenPipeError, ValueError, pickle.UnpicklingError):
            if self.closed:
                raise KeyboardInterrupt from None
            self._process = None  # the next task gets a new one
            status = server.wait()
            why = f"the server of its process ended with status {status}"
            return Ending("killed" if status < 0 else "crash", why, last_words(self._words))

    def close(self) -> None:
        """End the server and the child at work, with all that the child has started."""
        self.closed = True
        with self._lock:
            if self._process is None:
                return
            assert self._process.stdin is not None
            with suppress(BrokenPipeError):
                self._process.stdin.close()
            try:
                self._process.wait(self.grace)
            except subprocess.TimeoutExpired:
                self._process.kill()
                self._process.wait()

    def _started(self) -> subprocess.Popen[bytes]:
        with self._lock:
            if self.closed:
                raise KeyboardInterrupt
            if self._process is None:
                self._process = subprocess.Popen(
                    [
                        *(sys.executable, "-P", "-c", _SERVE.format(path=sys.path, name=__name__)),
                        str(os.getpid()),
                    ],
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


_IDLE: list[ForkServer] = []
"""Servers of this process that wait for a task."""
os.register_at_fork(after_in_child=_IDLE.clear)  # they are its parent's


def in_child(task: Task) -> Ending:
    """Have a task done by a server of this process, which stays for the next one.

    Threads may do so at once; each gets a server of its own.
    """
    server = _IDLE.pop() if _IDLE else ForkServer()
    try:
        ending = server.run(task)
    except BaseException:  # its reply is still to come
        server.close()
        raise
    _IDLE.append(server)
    return ending


def on_this_process(task: Task) -> Ending:
    """Have a task done, as a worker of Ray does; once more where somebody else killed it."""
    ending = in_child(task)
    return ending if ending.how != "killed" else _second(in_child(task))


def main(parent: int) -> None:
    """Serve until standard input ends, or the process that started this one."""
    asker = os.pidfd_open(parent)  # of the process: the thread that started this one may end
    if os.getppid() != parent:
        return
    adopt_orphans()
    askers = (sys.stdin.fileno(), asker)
    replies = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what libraries print is no reply
    modules = 0
    while True:
        if asker in select.select(askers, [], [])[0]:
            return
        try:
            task = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        task.warm()
        if len(sys.modules) > modules:
            modules = len(sys.modules)
            gc.collect()
            gc.freeze()  # children share these pages as long as nobody walks through them
        with tempfile.TemporaryFile() as log:
            ending = watched(task.run, task.limits, log, askers)
        pickle.dump(ending, replies)
        replies.flush()
