"""Objects of a review that are made in the background, in a process that yields to the page."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from mam_sim.studio.place import Place, make


@dataclass(frozen=True)
class AheadSettings:
    """How much is made in the background.

    Attributes:
        objects: that are wanted beside the open one. nice: how far the process yields, 0..19.
    """

    objects: int = 2
    nice: int = 10


AHEAD = AheadSettings()


class Ahead:
    """Makes one object after the other."""

    def __init__(self, done: Callable[[Place, str], None]) -> None:
        """Start nothing yet.

        Args:
            done: told of each object that was made, and what went wrong ("" for nothing).
        """
        self._done = done
        self._pool: Any = None
        self._waiting: set[Path] = set()

    def want(self, places: Sequence[Place]) -> None:
        """Say what to make, the first most urgent; what waits already is not asked for again."""
        for place in places:
            if place.asset not in self._waiting:
                self.make(place)

    def make(self, place: Place) -> None:
        """Make an object after those that wait, also where it was made or waits already."""
        self._waiting.add(place.asset)
        if self._pool is None:  # fresh: threads of the ray caster do not survive a fork
            context = multiprocessing.get_context("spawn")
            self._pool = context.Pool(1, os.nice, (AHEAD.nice,))
        end = partial(self._end, place)
        self._pool.apply_async(make, (place,), callback=end, error_callback=end)

    def stop(self) -> None:
        """End what is being made."""
        if self._pool is not None:
            self._pool.terminate()

    def _end(self, place: Place, found: Any) -> None:
        self._waiting.discard(place.asset)
        self._done(place, str(found) if isinstance(found, BaseException) else "")
