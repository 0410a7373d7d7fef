"""SIGTERM and SIGHUP end a verb as Ctrl-C does: by an exception, and nothing half-made stays."""

from __future__ import annotations

import mmap
import os
import select
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from types import FrameType

from mam_pipeline import folders
from mam_pipeline.guarded import kill_family

GRACE = 1.2
"""Seconds in which the exception must have ended the process; then it is ended."""
LATER = 0.2
"""Seconds more after which a process that does not even end itself is killed."""
BOARD = 1 << 18
"""Bytes for the names of what is under construction."""


class Stopped(BaseException):
    """The process was told to stop; no `except Exception` on the way keeps it."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.status = 128 + number


@contextmanager
def stoppable() -> Iterator[None]:
    """Within it, a signal to stop raises `Stopped`; what is under construction is gone afterwards.

    A library may swallow the exception, or may be busy in C for long, or wait for its own
    processes: what is left after `GRACE` seconds is removed, and the process ended.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    timers: list[threading.Timer] = []
    told: list[Stopped] = []

    def stop(number: int, _frame: FrameType | None) -> None:
        if not timers:
            timers.append(threading.Timer(GRACE, _end, [128 + number]))
            timers[0].daemon = True
            timers[0].start()
            told.append(Stopped(number))
            raise told[0]

    wanted = [n for n in (signal.SIGTERM, signal.SIGHUP) if signal.getsignal(n) != signal.SIG_IGN]
    before = {n: signal.signal(n, stop) for n in wanted}  # nohup ignores SIGHUP, and so do we
    try:
        yield
    except Exception as error:
        if told:  # a library took the exception for a failure of its own, as while it is imported
            raise told[0] from error
        raise
    finally:
        folders.clean_up()
        for timer in timers:
            timer.cancel()
        for number, handler in before.items():
            signal.signal(number, handler)


def _end(status: int) -> None:
    folders.clean_up()
    os._exit(status)


def watch_over() -> None:
    """Fork a process that kills this one where it is told to stop and does not end by itself.

    Native code may be busy for long and let no other thread run: then no handler of Python's runs
    either. The signal is written to a pipe all the same, by Python's handler in C. The watcher
    reads it, waits, kills this process and its children, and removes what they had under
    construction: also where the process ended in time, as what it wrote while it swept is left.
    It ends with this process.
    """
    told, tell = os.pipe()
    os.set_blocking(tell, False)
    verb, handle = os.getpid(), os.pidfd_open(os.getpid())
    board = folders.Board(mmap.mmap(-1, BOARD), verb)
    between = os.fork()
    if between == 0:  # the watcher is nobody's child: none waits for it, and it may kill all
        if os.fork() == 0:
            with suppress(BaseException):
                _watch(told, handle, board)
        os._exit(0)
    os.waitpid(between, 0)
    os.close(told)
    os.close(handle)
    folders.show_on(board)
    signal.set_wakeup_fd(tell, warn_on_full_buffer=False)
    os.register_at_fork(after_in_child=_alone)  # a child's signals are not this process's


def _alone() -> None:
    signal.set_wakeup_fd(-1)


def _watch(told: int, handle: int, board: folders.Board) -> None:
    os.setsid()
    for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGINT):
        signal.signal(number, signal.SIG_IGN)
    nothing = os.open(os.devnull, os.O_RDWR)
    for stream in range(3):
        os.dup2(nothing, stream)
    low, high = sorted((told, handle))
    os.closerange(3, low)
    os.closerange(low + 1, high)
    os.closerange(high + 1, os.sysconf("SC_OPEN_MAX"))
    asked = [told, handle]
    while True:
        ready, _, _ = select.select(asked, [], [])
        if handle in ready:
            return
        numbers = os.read(told, mmap.PAGESIZE)
        if not numbers:  # the pipe is closed
            asked = [handle]
        if {signal.SIGTERM, signal.SIGHUP} & set(numbers):
            break
    if not select.select([handle], [], [], GRACE + LATER)[0]:
        kill_family(board.owner)
        select.select([handle], [], [])  # until it writes no more
    folders.remove(board.read())
