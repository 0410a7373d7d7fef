"""Objects of a review that are made in the background, each in a process with limits."""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from mam_pipeline.errors import MamSimError
from mam_pipeline.folders import Scratch
from mam_pipeline.forkserver import ForkServer
from mam_pipeline.guarded import Limits
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


@dataclass(frozen=True)
class Making:
    """What the process does: an asset, and a file with what went wrong."""

    place: Place
    told: Path
    limits: Limits = field(default_factory=Limits)

    def warm(self) -> None:
        """Nothing more than what is imported here."""

    def run(self) -> None:
        """Make it, in the child."""
        os.nice(AHEAD.nice)
        try:
            make(self.place)
        except (MamSimError, OSError) as error:
            self.told.write_text(str(error), encoding="utf-8")


class Ahead:
    """Makes one object after the other."""

    def __init__(self, done: Callable[[Place, str], None]) -> None:
        """Start nothing yet.

        Args:
            done: told of each object that was made, and what went wrong ("" for nothing).
        """
        self._done = done
        self._server, self._pool = ForkServer(), ThreadPoolExecutor(1)
        self._waiting: set[Path] = set()

    def want(self, places: Sequence[Place]) -> None:
        """Say what to make, the first most urgent; what waits already is not asked for again."""
        for place in places:
            if place.asset not in self._waiting:
                self.make(place)

    def make(self, place: Place) -> None:
        """Make an object after those that wait, also where it was made or waits already."""
        self._waiting.add(place.asset)
        self._pool.submit(self._make, place)

    def stop(self) -> None:
        """End what is being made."""
        self._pool.shutdown(wait=False, cancel_futures=True)
        self._server.close()

    def _make(self, place: Place) -> None:
        with Scratch() as folder:
            told = Path(folder) / "told.txt"
            try:
                ending = self._server.run(Making(place, told))
            except KeyboardInterrupt:  # stopped
                return
            error = told.read_text(encoding="utf-8") if told.is_file() else ending.why
        self._waiting.discard(place.asset)
        self._done(place, error)
