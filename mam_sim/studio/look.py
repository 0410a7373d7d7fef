"""The panel for looking: how the surface is drawn, and what was found."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mam_pipeline.formats.suffixes import PHOTOS
from mam_sim.studio.scene import SHOWS
from mam_sim.studio.thumbnails import thumbnail
from mam_sim.studio.words import dialogue_text, dormant_text, joint_text
from mam_sim.studio.workspace import Workspace

PHOTO = 480  # pixels of its longer side
HELP = "*Drag turns the view, the wheel goes closer; ? shows all keys.*"


class Look:
    """How the object is drawn, and what was found."""

    def __init__(self, work: Workspace) -> None:
        self.work = work
        gui: Any = work.server.gui
        self.show = gui.add_dropdown("Show", SHOWS, hint="Colours by part, or by piece")
        self.axes = gui.add_checkbox("Axes and ranges", True)
        self.sizes = gui.add_checkbox("Sizes", False)
        self.contacts = gui.add_checkbox("Contacts", False, hint="Where parts touch, when closed")
        gui.add_markdown(HELP)
        with gui.add_folder("What was found"):
            self.thought = gui.add_markdown("")
        self.photo = gui.add_folder("The photo", visible=False)
        with self.photo:
            self.picture = gui.add_image(np.zeros((1, 1, 3), np.uint8))
        self._pictured: Path | None = None
        self.asked = gui.add_folder(
            "Asked of a language model", expand_by_default=False, visible=False
        )
        with self.asked:
            gui.add_markdown("*Where it is wrong: what you put right outranks it.*")
            self.dialogue = gui.add_markdown("")
        self.show.on_update(work.guarded(self._redraw))
        self.axes.on_update(work.guarded(self._remark))
        self.sizes.on_update(work.guarded(self._remark))
        self.contacts.on_update(work.guarded(self._remark))

    def refresh(self) -> None:
        """Sentences on the joints that there are now."""
        self._show_photo(self.work.open.place.source)
        self.thought.content = "\n\n".join(self._sentences())
        state = self.work.state
        told = dialogue_text(state.tree.nodes[0].evidence, {p.name for p in state.hints.parts})
        self.dialogue.content, self.asked.visible = told, bool(told)

    def _show_photo(self, source: Path | None) -> None:
        """The photo that an object was made from, beside it."""
        if source is None or source.suffix.lower() not in PHOTOS:
            self.photo.visible = False
            return
        if source != self._pictured:
            self.picture.image = thumbnail(source, PHOTO)
            self._pictured = source
        self.photo.visible = True

    def _sentences(self) -> list[str]:
        work = self.work
        articulation = work.state.articulation
        depth, width, height = work.size()
        rows = [f"{width:.2f} m wide, {depth:.2f} m deep, {height:.2f} m high."]
        for joint in articulation.joints:
            link = articulation.links[joint.child]
            if work.part in ("", link.name):
                runs = work.line(joint, joint.child)
                called = work.called(link.name)
                rows.append(joint_text(joint, called, link.name, runs, work.open.made_from))
        for part in articulation.dormant:
            if work.part in ("", part.link.name):
                rows.append(dormant_text(part))
        return rows

    def _redraw(self) -> None:
        self.work.show = self.show.value
        if self.work.show == "collision" and not self.work.hulls:
            self.work.say(None, "No collision pieces yet", "Make and check the asset first.")
        self.work.refresh()

    def _remark(self) -> None:
        self.work.axes, self.work.sizes = self.axes.value, self.sizes.value
        self.work.contacts = self.contacts.value
        self.work.mark()
