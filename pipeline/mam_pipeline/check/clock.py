"""A limit on the wall-clock time of a check, also where a stranger's file keeps a parser busy."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType


class OutOfTime(BaseException):
    """The time is up; no `except Exception` on the way may mistake it for something else."""


class Clock:
    """Counts down from `seconds`."""

    def __init__(self, seconds: float) -> None:
        self._end = time.monotonic() + seconds

    @property
    def left(self) -> float:
        """Seconds left; negative once they are over."""
        return self._end - time.monotonic()

    def look(self) -> None:
        """Raise OutOfTime if nothing is left."""
        if self.left <= 0:
            raise OutOfTime


@contextmanager
def limited(seconds: float) -> Iterator[Clock]:
    """Run a block for at most `seconds`: OutOfTime is raised inside it then.

    In the main thread an alarm interrupts any Python code, in others `Clock.look` must be called;
    a single call into C is not interrupted, but ends with the sizes that the lint allows.
    """
    clock = Clock(seconds)
    if threading.current_thread() is not threading.main_thread() or not hasattr(signal, "SIGALRM"):
        yield clock
        return

    def ring(_number: int, _frame: FrameType | None) -> None:
        raise OutOfTime

    before = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, max(seconds, 1e-3))
    try:
        yield clock
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
