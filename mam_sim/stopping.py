"""SIGTERM and SIGHUP end a verb as Ctrl-C does: by an exception, and nothing half-made stays."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from mam_pipeline import folders

GRACE = 1.5
"""Seconds in which the exception must have ended the process; then it is ended."""


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

    def stop(number: int, _frame: FrameType | None) -> None:
        if not timers:
            timers.append(threading.Timer(GRACE, _end, [128 + number]))
            timers[0].daemon = True
            timers[0].start()
            raise Stopped(number)

    wanted = [n for n in (signal.SIGTERM, signal.SIGHUP) if signal.getsignal(n) != signal.SIG_IGN]
    before = {n: signal.signal(n, stop) for n in wanted}  # nohup ignores SIGHUP, and so do we
    try:
        yield
    finally:
        folders.clean_up()
        for timer in timers:
            timer.cancel()
        for number, handler in before.items():
            signal.signal(number, handler)


def _end(status: int) -> None:
    folders.clean_up()
    os._exit(status)
