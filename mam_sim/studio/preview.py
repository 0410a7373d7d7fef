"""The other ways in which a part may move, played one after the other; nothing is changed by it."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np

from mam_pipeline.types import JointCandidate
from mam_sim.studio import words
from mam_sim.studio.parts import Parts
from mam_sim.studio.scene import merged_bounds
from mam_sim.studio.workspace import Workspace

SECONDS, PICTURES = 1.6, 16  # for one way there and back; pictures a second


class Preview:
    """A button that plays the ways of the chosen part, and says which is played."""

    def __init__(self, work: Workspace, parts: Parts) -> None:
        """Build the button."""
        self.work, self.parts = work, parts
        gui: Any = work.server.gui
        self.button = gui.add_button("Play the other lines", color="gray", icon="player-play")
        self.told = gui.add_markdown("")
        self.button.on_click(work.guarded(self._play, alone=False))
        self._playing = threading.Lock()

    def show(self, on: bool) -> None:
        """Whether there is a part whose ways can be played."""
        self.button.visible = self.told.visible = on

    def _play(self) -> None:
        work, state, part = self.work, self.work.state, self.work.part
        joint, ways = work.joint(), work.open.ways(part)
        if joint is None or not self._playing.acquire(blocking=False):
            return
        try:
            with work.lock:
                before = dict(work.scene.values)
                self.parts.pose(dict.fromkeys(before, 0.0))
            carried = state.articulation.carried_links(joint)
            size = np.ptp(merged_bounds(state.articulation, joint.child), axis=0)
            for number, way in enumerate(ways, 1):
                runs = work.line(way, joint.child)
                self.told.content = f"**{number}.** {runs}, {words.chance(way)}"
                begun = time.monotonic()
                while (share := (time.monotonic() - begun) / SECONDS) < 1:
                    with work.lock:
                        if work.state is not state or work.part != part:
                            return  # the person has gone on
                        value = np.sin(np.pi * share) * reach(way, float(np.abs(way.axis) @ size))
                        work.scene.preview(carried, way, float(value))
                    time.sleep(1 / PICTURES)
        finally:
            with work.lock:
                self.told.content = ""
                work.scene.preview((), None, 0.0)
                if work.state is state:
                    self.parts.pose(before)
            self._playing.release()


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
