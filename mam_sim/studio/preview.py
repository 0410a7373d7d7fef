"""Another way in which a part may move, played while the pointer is on it; it changes nothing."""

from __future__ import annotations

import threading
import time

import numpy as np

from mam_pipeline.types import JointCandidate
from mam_sim.studio.parts import Parts
from mam_sim.studio.scene import merged_bounds
from mam_sim.studio.workspace import Workspace

SECONDS, PICTURES = 1.6, 16  # for one way there and back; pictures a second


class Preview:
    """Plays one of the ways of the chosen part, again and again, until another is wanted."""

    def __init__(self, work: Workspace, parts: Parts) -> None:
        self.work, self.parts = work, parts
        self._wanted, self._playing = 0, threading.Lock()

    def want(self, number: int) -> None:
        """Play a way by its number in the list, from 1; 0 plays none, and all is as it was."""
        self._wanted = number
        if number:
            threading.Thread(target=self._play, daemon=True).start()

    def _play(self) -> None:
        work = self.work
        while self._wanted and self._playing.acquire(blocking=False):
            try:
                self._until_another_is_wanted(self._wanted)
            finally:
                with work.lock:
                    work.scene.preview((), None, 0.0)
                self._playing.release()

    def _until_another_is_wanted(self, number: int) -> None:
        work = self.work
        with work.lock:
            joint = None if work.session is None else work.joint()
            ways = [] if joint is None else work.open.ways(work.part)
            if joint is None or number > len(ways):
                self._wanted = 0
                return
            state, part, way = work.state, work.part, ways[number - 1]
            self.parts.leave_off()
            carried = state.articulation.carried_links(joint)
            size = np.ptp(merged_bounds(state.articulation, joint.child), axis=0)
        far, begun = reach(way, float(np.abs(way.axis) @ size)), time.monotonic()
        while self._wanted == number:
            with work.lock:
                if work.session is None or work.state is not state or work.part != part:
                    self._wanted = 0  # the person has gone on
                    return
                share = (time.monotonic() - begun) / SECONDS
                work.scene.preview(carried, way, float(np.sin(np.pi * share) ** 2 * far))
            time.sleep(1 / PICTURES)


def reach(way: JointCandidate, length: float) -> float:
    """How far a way is played: as such parts usually go; radians or metres.

    Args:
        length: of the part along the axis, metres.
    """
    slides = way.subtype == "slide"
    usual = way.travel.open if way.travel is not None else 0.0
    if slides:
        return (usual or 0.5) * length
    return float(np.clip(usual or 1.4, 0.5, 1.6))
