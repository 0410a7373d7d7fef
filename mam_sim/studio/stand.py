"""The panel for how the object stands: its size by typing one length, up and front by a face."""

from __future__ import annotations

from typing import Any

from mam_pipeline.errors import ConfigError
from mam_sim.studio.workspace import Workspace

SIDES = ("depth", "width", "height")
HELP = "*Click a face of the object, then say what it is.*"


class Stand:
    """Says how the object stands; each word is a step that can be undone."""

    def __init__(self, work: Workspace) -> None:
        """Build the panel."""
        self.work = work
        gui: Any = work.server.gui
        with gui.add_folder("How it stands", expand_by_default=False):
            self.side = gui.add_dropdown("Known length", SIDES, initial_value="height")
            self.length = gui.add_number("Metres", 1.0, min=0.0, step=0.01)
            gui.add_button("Set the size", color="gray").on_click(work.guarded(self._size))
            gui.add_markdown(HELP)
            self.of_face = [
                gui.add_button(f"The clicked face is {what}", color="gray", disabled=True)
                for what in ("the front", "on top")
            ]
        for button, say in zip(self.of_face, (self._front, self._up)):
            button.on_click(work.guarded(say))
        self.side.on_update(work.guarded(self._fill))

    def refresh(self) -> None:
        """Fill in the length that is asked about; what needs a clicked face waits for one."""
        self._fill()
        for button in self.of_face:
            button.disabled = self.work.face is None

    def _fill(self) -> None:
        self.length.value = round(float(self.work.size()[SIDES.index(self.side.value)]), 4)

    def _size(self) -> None:
        now = float(self.work.size()[SIDES.index(self.side.value)])
        if not self.length.value > 0:
            raise ConfigError("type a length above zero, in metres")
        self.work.stand(size=float(self.length.value) / now)

    def _front(self) -> None:
        self.work.stand(front=self.work.face_normal())

    def _up(self) -> None:
        self.work.stand(up=self.work.face_normal())
