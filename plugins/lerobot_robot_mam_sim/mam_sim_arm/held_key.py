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
from typing import Protocol, Self

from mam_pipeline.errors import ConfigError

FIRST = 0.8
"""Seconds after which a terminal has repeated a key that stays down for the first time."""
REPEAT = 0.25
"""Seconds between two repetitions at most."""


class Key(Protocol):
    """What lets an arm move. `person`: whether somebody holds it, who can be asked."""

    person: bool

    def __enter__(self) -> Self: ...
    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...
    def down(self, only: str = "") -> bool:
        """Whether a key is held down now; `only`: one of these."""
        ...

    def wait(self) -> str:
        """Return the key that is pressed next."""
        ...


class NoKey:
    """Always allowed, and nobody there: simulated arms, and `--hold-key never`."""

    person = False

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        return None

    def down(self, only: str = "") -> bool:
        """Always."""
        return True

    def wait(self) -> str:
        """Nobody presses."""
        return ""


class HeldKey:
    """Any key of a terminal, as seen by its repetitions; a context manager.

    A terminal tells no key's release, only that repetitions stay out: `down` is false `REPEAT`
    seconds after it (`FIRST` after a single press).
    """

    person = True

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
        self._until, self._last, self._key = -1.0, -1.0, ""

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

    def down(self, only: str = "") -> bool:
        """Whether a key is held down now; `only`: one of these."""
        now, key = self._clock(), self._pressed()
        if key:
            repeated = self._last >= 0 and now - self._last <= FIRST and key == self._key
            self._until = now + (REPEAT if repeated else FIRST)
            self._last, self._key = now, key
        return now <= self._until and (not only or self._key in only)

    def wait(self) -> str:
        """Return the key that is pressed next; one pressed before is none."""
        self._until = self._last = -1.0
        termios.tcflush(self._fd, termios.TCIFLUSH)
        while not self.down():
            select.select([self._fd], [], [], 0.1)
        return self._key

    def _pressed(self) -> str:
        """The last key that has come since the last time."""
        found = b""
        while select.select([self._fd], [], [], 0.0)[0]:
            read = os.read(self._fd, 1024)
            if not read:  # the terminal is gone
                return ""
            found = read
        return found[-1:].decode("latin-1")


def key_for(hold: str, robot: str) -> Key:
    """The key of a robot's type: "real" asks for one unless it is simulated, or "always", "never".

    Raises:
        ConfigError: one is needed, and there is no terminal.
    """
    held = hold == "always" or (hold == "real" and robot != "mam_sim")
    return HeldKey() if held else NoKey()
