"""The panel for looking: how the surface is drawn, a slider for every joint, what was thought."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from mam_pipeline.formats.suffixes import PHOTOS
from mam_pipeline.types import Joint
from mam_sim.studio.scene import SHOWS, all_at
from mam_sim.studio.thumbnails import thumbnail
from mam_sim.studio.words import (
    dialogue_text,
    dormant_text,
    joint_text,
    kept_value,
    shown_value,
    span,
    unit,
)
from mam_sim.studio.workspace import Workspace

PHOTO = 480  # pixels of its longer side
HELP = "*Drag turns the view, the right button moves it, the wheel goes closer.*"


class Look:
    """Drawing and moving; sliders are made anew for every set of joints."""

    def __init__(self, work: Workspace) -> None:
        self.work = work
        gui: Any = work.server.gui
        self.show = gui.add_dropdown("Show", SHOWS, hint="Colours by part, or by piece")
        self.axes = gui.add_checkbox("Axes and ranges", True)
        self.sizes = gui.add_checkbox("Sizes", False)
        self.contacts = gui.add_checkbox("Contacts", False, hint="Where parts touch, when closed")
        gui.add_markdown(HELP)
        self.photo = gui.add_image(np.zeros((1, 1, 3), np.uint8), label="The photo", visible=False)
        self._pictured: Path | None = None
        self.sliders = gui.add_folder("Move")
        self.thought = gui.add_folder("What was found")
        self.asked = gui.add_folder(
            "Asked of a language model", expand_by_default=False, visible=False
        )
        with self.asked:
            gui.add_markdown("*Where it is wrong: what you put right outranks it.*")
            self.dialogue = gui.add_markdown("")
        self._made: list[Any] = []
        self.show.on_update(work.guarded(self._redraw))
        self.axes.on_update(work.guarded(self._remark))
        self.sizes.on_update(work.guarded(self._remark))
        self.contacts.on_update(work.guarded(self._remark))

    def refresh(self) -> None:
        """Sliders and sentences for the joints that there are now."""
        self._show_photo(self.work.open.place.source)
        for handle in self._made:
            handle.remove()
        gui, joints = self.work.server.gui, self._moving()
        self._made, self._joint_sliders = [], dict[str, Any]()
        with self.sliders:
            if not joints:
                self._made.append(gui.add_markdown("Nothing moves yet."))
                self.all = None
            else:
                self.all = gui.add_slider("All (%)", 0, 100, 1, 0)
                self.all.on_update(self.work.guarded(self._move_all))
                self._made.append(self.all)
            for joint in joints:
                self._made.append(self._slider(joint))
        with self.thought:
            for text in self._sentences():
                self._made.append(gui.add_markdown(text))
        state = self.work.state
        told = dialogue_text(state.tree.nodes[0].evidence, {p.name for p in state.hints.parts})
        self.dialogue.content, self.asked.visible = told, bool(told)

    def _show_photo(self, source: Path | None) -> None:
        """The photo that an object was made from, beside it."""
        if source is None or source.suffix.lower() not in PHOTOS:
            self.photo.visible = False
            return
        if source != self._pictured:
            self.photo.image = thumbnail(source, PHOTO)
            self._pictured = source
        self.photo.visible = True

    def _slider(self, joint: Joint) -> Any:
        low, high = _ends(joint)
        now = float(np.clip(shown_value(joint, self.work.scene.values[joint.name]), low, high))
        step = 0.1 if joint.type == "prismatic" else 0.5
        name = self.work.state.articulation.links[joint.child].name
        slider = self.work.server.gui.add_slider(
            f"{name} ({unit(joint)})", low, max(high, low + step), step, now, hint=span(joint)
        )

        def move(event: Any) -> None:
            if event.client is not None:  # a person's hand, not `pose`
                self.work.scene.pose({joint.name: kept_value(joint, float(slider.value))})

        slider.on_update(self.work.guarded(move))
        self._joint_sliders[joint.name] = slider
        return slider

    def _move_all(self) -> None:
        assert self.all is not None
        values = all_at(self.work.state.articulation, self.all.value / 100)
        self.pose(values)

    def pose(self, values: dict[str, float]) -> None:
        """Move joints, their sliders too."""
        self.work.scene.pose(values)
        for joint in self._moving():
            if joint.name in values:
                low, high = _ends(joint)
                shown = float(np.clip(shown_value(joint, values[joint.name]), low, high))
                self._joint_sliders[joint.name].value = shown

    def _moving(self) -> list[Joint]:
        return [j for j in self.work.state.articulation.joints if j.type != "fixed"]

    def _sentences(self) -> list[str]:
        work = self.work
        articulation = work.state.articulation
        depth, width, height = work.size()
        rows = [f"{width:.2f} m wide, {depth:.2f} m deep, {height:.2f} m high."]
        for joint in articulation.joints:
            link = articulation.links[joint.child]
            if work.part in ("", link.name):
                runs = work.line(joint, joint.child)
                rows.append(joint_text(joint, link.name, link.kind, runs, work.open.made_from))
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


def _ends(joint: Joint) -> tuple[float, float]:
    """Of a joint's slider; a free one makes one turn."""
    if not np.isfinite([joint.lower, joint.upper]).all():
        return -180.0, 180.0
    low, high = shown_value(joint, joint.lower), shown_value(joint, joint.upper)
    return float(np.ceil(10 * low - 1e-6) / 10), float(np.floor(10 * high + 1e-6) / 10)
