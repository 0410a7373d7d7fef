"""What every verb shares on the screen: results on stdout, progress on stderr, --quiet, --json."""

from __future__ import annotations

import json
import shlex
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    SpinnerColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from mam_pipeline.secrets import masked

STAGES = {
    "read": "reading the mesh",
    "photo": "reconstructing the photo",
    "segment": "cutting it into primitives",
    "prior": "probing what may move",
    "reason": "finding parts and joint types",
    "joints": "estimating joints and limits",
    "asset": "writing the asset (collision, inertia, URDF)",
    "check": "checking physical executability",
    "environment": "starting the environment",
    "report": "drawing the report",
}


class Screen:
    """Prints results to stdout and progress to stderr."""

    def __init__(self, quiet: bool = False) -> None:
        self.out = Console(file=sys.stdout, highlight=False, soft_wrap=True)
        self.err = Console(file=sys.stderr, highlight=False)
        self.quiet = quiet

    def say(self, text: str = "") -> None:
        """A line of result."""
        if not self.quiet:
            self.out.print(masked(text), markup=False)

    def next(self, *words: str) -> None:
        """The last line of a verb: what to type next.

        Args:
            words: of the command, after `mam-sim`.
        """
        self.say(f"next:   mam-sim {shlex.join(words)}")

    def table(self, table: Any) -> None:
        """A table of rich."""
        if not self.quiet:
            self.out.print(table)

    def json(self, value: Any) -> None:
        """The result as JSON on stdout."""
        sys.stdout.write(masked(json.dumps(value, indent=1, default=str)) + "\n")

    @contextmanager
    def stages(self, names: list[str]) -> Iterator[StageBar]:
        """A bar over named stages; call the value with a stage's name when it starts."""
        columns = (SpinnerColumn(), BarColumn(24), TextColumn("{task.description}"))
        with Progress(
            *columns,
            TimeElapsedColumn(),
            console=self.err,
            transient=True,
            disable=self.quiet,
        ) as progress:
            yield StageBar(progress, names)


class StageBar:
    """Moves the bar to a stage."""

    def __init__(self, progress: Progress, names: list[str]) -> None:
        self._progress, self._names = progress, names
        self._task = progress.add_task("", total=len(names))

    def __call__(self, name: str) -> None:
        done = self._names.index(name) if name in self._names else 0
        text = f"{done + 1}/{len(self._names)} {STAGES.get(name, name)}"
        self._progress.update(self._task, completed=done, description=text)
        if not self._progress.console.is_terminal and not self._progress.disable:
            self._progress.console.print(f"[{text}]", markup=False)


@contextmanager
def counting_bar(screen: Screen, total: int, done: int) -> Iterator[Callable[[str, str], None]]:
    """A bar over many things; call the value with (what was done last, pace) after each.

    Where standard error is no terminal, each is a line.
    """
    columns = (BarColumn(24), MofNCompleteColumn(), TextColumn("{task.fields[pace]}"))
    with Progress(
        *columns, TextColumn("{task.description}"), console=screen.err, transient=True,
        disable=screen.quiet,
    ) as progress:  # fmt: skip
        line = progress.add_task("", total=total, completed=done, pace="")

        def tell(last: str, pace: str) -> None:
            progress.update(line, advance=1, description=last, pace=pace)
            if not screen.err.is_terminal and not screen.quiet:
                count = f"{int(progress.tasks[0].completed)}/{total}"
                screen.err.print(f"[{count}] {last} ({pace})", markup=False, soft_wrap=True)

        yield tell


class PhaseBar:
    """A progress bar over named phases; call it with (phase, share of it that is done, words).

    Where standard error is no terminal, the start of a phase is a line, and so is every minute.
    """

    def __init__(self, screen: Screen, clock: Callable[[], float] = time.monotonic) -> None:
        columns = (TextColumn("{task.description}"), BarColumn(24), TimeElapsedColumn())
        self.progress = Progress(
            *columns,
            TimeRemainingColumn(),
            TextColumn("{task.fields[words]}"),
            console=screen.err,
            transient=True,
            disable=screen.quiet or not screen.err.is_terminal,
        )
        self.tasks: dict[str, Any] = {}
        self._lines = None if screen.quiet or screen.err.is_terminal else MinuteLines(screen, clock)

    def __enter__(self) -> Any:
        self.progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.progress.stop()

    def __call__(self, phase: str, share: float, words: str) -> None:
        if phase not in self.tasks:
            self.tasks[phase] = self.progress.add_task(phase, total=1.0, words="")
        self.progress.update(self.tasks[phase], completed=share, words=words)
        if self._lines is not None:
            self._lines(phase, share, words)


@dataclass
class Mark:
    """Where a phase stood at some time, seconds of the clock."""

    share: float
    at: float


class MinuteLines:
    """Progress in lines: one where a phase begins, and one a minute with the time that is left."""

    EVERY = 60.0
    """Seconds between two lines of a phase."""

    def __init__(self, screen: Screen, clock: Callable[[], float]) -> None:
        self._screen, self._clock = screen, clock
        self._began: dict[str, Mark] = {}
        self._last = 0.0

    def __call__(self, phase: str, share: float, words: str) -> None:
        """Say how far a phase is, where a minute is over since the last line."""
        now = self._clock()
        first = self._began.setdefault(phase, Mark(share, now))
        begins = first.at == now
        if not begins and now - self._last < self.EVERY:
            return
        self._last = now
        left = ""
        if share > first.share and not begins:
            seconds = (now - first.at) * (1 - share) / (share - first.share)
            left = f", {duration(seconds)} left"
        text = f"[{phase} {100 * share:.0f} %{left}] {words}".rstrip()
        self._screen.err.print(text, markup=False, soft_wrap=True)


def duration(seconds: float) -> str:
    """A time for people: "1 h 20 min", "12 min", "under a minute"."""
    hours, minutes = divmod(round(seconds / 60), 60)
    if hours:
        return f"{hours} h {minutes} min"
    return f"{minutes} min" if minutes else "under a minute"
