"""A dead-man key: the arm may move only as long as a key of the terminal is held down."""

from __future__ import annotations

import os
import select
import sys
import termios
import time
import tty
from collections.abc import Callable
from contextlib import suppress
from types import TracebackType
from typing import Self

from mam_pipeline.errors import ConfigError

FIRST = 0.8
"""Seconds after which a terminal has repeated a key that stays down for the first time."""
REPEAT = 0.25
"""Seconds between two repetitions at most."""


class HeldKey:
    """Any key of a terminal, as seen by its repetitions; a context manager.

    A terminal tells no key's release, only that repetitions stay out: `down` is false `REPEAT`
    seconds after it (`FIRST` after a single press).
    """

    def __init__(
        self, terminal: int | None = None, clock: Callable[[], float] = time.monotonic
    ) -> None:
        """`terminal`: its file descriptor; default: standard input.

        Raises:
            ConfigError: it is no terminal.
        """
        self._clock = clock
        self._fd = -1 if terminal is None else terminal
        if terminal is None:
            with suppress(OSError, ValueError, AttributeError):  # there may be no standard input
                self._fd = sys.stdin.fileno()
        if self._fd < 0 or not os.isatty(self._fd):
            raise ConfigError(
                "the key that must be held down needs a terminal; --hold-key never does without it"
            )
        self._until, self._last = -1.0, -1.0

    def __enter__(self) -> Self:
        """Take keys as they come, unseen."""
        self._before = termios.tcgetattr(self._fd)
        tty.setcbreak(self._fd)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Give the terminal back as it was, without the keys pressed meanwhile."""
        termios.tcsetattr(self._fd, termios.TCSAFLUSH, self._before)

    def down(self) -> bool:
        """Whether the key is held down now."""
        now = self._clock()
        if self._pressed():
            repeated = self._last >= 0 and now - self._last <= FIRST
            self._until = now + (REPEAT if repeated else FIRST)
            self._last = now
        return now <= self._until

    def wait(self) -> None:
        """Return when a key is pressed."""
        self._until = self._last = -1.0
        termios.tcflush(self._fd, termios.TCIFLUSH)  # one pressed before is none
        while not self.down():
            select.select([self._fd], [], [], 0.1)

    def _pressed(self) -> bool:
        """Whether keys have come since the last time."""
        found = False
        while select.select([self._fd], [], [], 0.0)[0]:
            if not os.read(self._fd, 1024):  # the terminal is gone
                return False
            found = True
        return found
