"""What the pointer rests on: a part, in the tree or in the view, or another way in which it moves.

Viser tells the server of clicks alone. The page's script (`server.POINTER`) writes what is under
the pointer into a field that nobody sees, and its value comes here.
"""

from __future__ import annotations

import re
from typing import Any

import numpy as np

from mam_sim.studio.parts import Parts
from mam_sim.studio.picking import face_under
from mam_sim.studio.pointer import camera_of
from mam_sim.studio.preview import Preview
from mam_sim.studio.workspace import Workspace

SAID = re.compile(r"(?P<what>part|way) (?P<number>\d{1,5})|at (?P<x>[01]\.\d+) (?P<y>[01]\.\d+)")


class Hover:
    """Colours and names the part under the pointer; plays the way under it."""

    def __init__(self, work: Workspace, parts: Parts, preview: Preview) -> None:
        """Build the field that the page's script fills in."""
        self.work, self.parts, self.preview = work, parts, preview
        gui: Any = work.server.gui
        gui.add_html('<i class="pointer"></i>')
        self._said = gui.add_text("Pointer", "")
        self._said.on_update(work.guarded(self._moved))

    def _moved(self, event: Any) -> None:
        work, said = self.work, SAID.fullmatch(self._said.value)
        if event.client is None or work.session is None:
            return
        number = int(said["number"]) if said is not None and said["what"] else 0
        self.preview.want(number if said is not None and said["what"] == "way" else 0)
        in_tree = said is not None and said["what"] == "part" and number < len(self.parts.rows)
        name = self.parts.rows[number].name if in_tree else ""
        # the row under the pointer is not drawn anew: a click on it would be lost
        work.over = ""
        at = (float(said["x"]), float(said["y"])) if said is not None and said["x"] else None
        if work.pointing is not None:
            work.pointing.over(event.client, at)
        elif at is not None and work.picks != "brush":
            work.over = name = self._under(event.client, at)
        work.scene.point_out(work.open.faces_of(name), work.called(name))
        self.parts.refresh()

    def _under(self, client: Any, at: tuple[float, float]) -> str:
        """Name of the part at a place of the view, 0..1 from the upper left; "" for none."""
        camera = camera_of(client)
        found = face_under(self.work.tracer()[1], camera.position, camera.rays(np.asarray([at]))[0])
        return "" if found is None else self.work.open.link_of_face(found[0]).name
