"""The tree of parts above the tabs: how each one moves, how sure that is, and its slider."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass
from html import escape
from typing import Any

import numpy as np

from mam_pipeline.render.mesh_pictures import palette
from mam_pipeline.types import Articulation, Joint
from mam_sim.facts import shown_value, span, unit
from mam_sim.studio import words
from mam_sim.studio.scene import all_at
from mam_sim.studio.words import kept_value
from mam_sim.studio.workspace import Workspace


@dataclass(frozen=True)
class Playing:
    """How parts are shown and played.

    Attributes:
        digits: parts that have a key. seconds: for closed, open and closed again.
        pictures: a second.
    """

    digits: int = 9
    seconds: float = 3.0
    pictures: int = 20


PLAYING = Playing()
ICON = (
    '<svg viewBox="0 0 16 16" width="16" height="16" fill="none" stroke="currentColor" '
    'stroke-width="1.6" aria-hidden="true"><path d="{path}"/></svg>'
)
PATHS = {
    "hinge": "M3 2v12M3 3q10 0 10 10M10.500 10.500L13 13.500l2.500-3",
    "spin": "M13 8a5 5 0 1 1-1.500-3.500M12 1.500v3.500h-3.500",
    "slide": "M2 8h12M5 5L2 8l3 3M11 5l3 3l-3 3",
    "fixed": "M4 4h8v8H4z",
}  # of a 16 by 16 picture
ROW = (
    '<div class="part{more}" data-key="{key}" data-over="part {number}" title="{title}" '
    'style="padding-left:{indent}em">'
    '<kbd>{digit}</kbd><i style="background:rgb({color})"></i>{icon}<b>{called}</b>'
    "<span>{sure}</span></div>"
)
WAKE = '<button data-key="wake {number}" title="It moves, as the engine found it">wake</button>'


@dataclass(frozen=True)
class Part:
    """A row of the tree.

    Attributes:
        name: of the link. depth: how many parts it hangs on. joint: None for the base.
        link: its index; -1 for a dormant part, which is none.
    """

    name: str
    kind: str
    depth: int
    joint: Joint | None
    link: int

    @property
    def moves(self) -> bool:
        """Whether it has a slider."""
        return self.joint is not None and self.link >= 0 and self.joint.type != "fixed"


def tree_of(articulation: Articulation, names: list[str]) -> list[Part]:
    """The parts in the order of the tree: each below what it hangs on, dormant ones too.

    Args:
        names: in the order of parts that hang on the same one.
    """
    found = [(articulation.links[j.child], j, j.child) for j in articulation.joints]
    found += [(part.link, part.joint, -1) for part in articulation.dormant]
    order = {name: k for k, name in enumerate(names)}
    found.sort(key=lambda row: order.get(row[0].name, len(names)))

    def below(link: int, depth: int) -> Iterator[Part]:
        for own, joint, index in found:
            if joint.parent == link:
                yield Part(own.name, own.kind, depth, joint, index)
                if index >= 0:
                    yield from below(index, depth + 1)

    base = articulation.links[0]
    return [Part(base.name, base.kind, 0, None, 0), *below(0, 1)]


class Parts:
    """Rows and sliders; those of joints that stay the same stay on the page.

    Attributes:
        rows: of the tree, the base first; the digit of a part is its place in it.
        all: the slider that moves everything; None where nothing moves.
    """

    def __init__(self, work: Workspace) -> None:
        """Build the folder; it is filled when an object is open."""
        self.work = work
        self._folder = work.server.gui.add_folder("Parts")
        self.rows: list[Part] = []
        self.all: Any = None
        self._built: Any = None
        self._made: list[Any] = []
        self._texts: list[Any] = []
        self._sliders: dict[str, Any] = {}
        self._play = threading.Lock()
        self._stop = threading.Event()
        self._before: dict[str, float] = {}  # where the joints were before what plays

    def refresh(self) -> None:
        """Rows and sliders of the parts that there are now."""
        self.rows = tree_of(self.work.state.articulation, self.work.names())
        built = [(r.joint.name, r.joint.type, _ends(r.joint)) if r.moves and r.joint else r.name
                 for r in self.rows]  # fmt: skip
        if built != self._built:
            self._built = built
            self._build()
        colors = palette(np.arange(len(self.work.state.articulation.links)))
        for number, (row, text) in enumerate(zip(self.rows, self._texts)):
            content = self._row(number, row, colors)
            if text.content != content:
                text.content = content

    def pose(self, values: dict[str, float]) -> None:
        """Move joints, their sliders too."""
        self.work.scene.pose(values)
        for row in self.rows:
            if row.moves and row.joint is not None and row.joint.name in values:
                self._sliders[row.joint.name].value = _shown(row.joint, values[row.joint.name])

    def play(self) -> None:
        """Open and close the chosen part, or all; asked again while it plays, it stops."""
        if self._play.acquire(blocking=False):
            self._play_once()
        else:
            self._stop.set()

    def _play_once(self) -> None:
        """Open and close; who has `_play` gives it back here."""
        work = self.work
        try:
            self._stop.clear()
            joint, state = work.joint(), work.state
            self._before = before = dict(work.scene.values)
            begun = time.monotonic()
            while (share := (time.monotonic() - begun) / PLAYING.seconds) < 1:
                with work.lock:
                    if work.session is None or work.state is not state or self._stop.is_set():
                        return
                    values = all_at(state.articulation, float(np.sin(np.pi * share)))
                    self.pose(values if joint is None else {joint.name: values[joint.name]})
                if self._stop.wait(1 / PLAYING.pictures):
                    return  # left where it was stopped
            with work.lock:
                if work.session is not None and work.state is state:
                    self.pose(before)
        finally:
            self._before = {}
            self._play.release()

    def show_motion(self) -> None:
        """Open and close the chosen part once, as it moves now."""

        def instead() -> None:
            self._play.acquire()  # until what plays has stopped
            self._play_once()

        self._stop.set()
        threading.Thread(target=instead, daemon=True).start()

    def leave_off(self) -> None:
        """Play no more; all is as it was before."""
        self._stop.set()
        if self._before:
            self.pose({k: v for k, v in self._before.items() if k in self.work.scene.values})

    def stop(self) -> None:
        """Play no more; all is left where it is."""
        self._stop.set()

    def _build(self) -> None:
        for handle in self._made:
            handle.remove()
        gui: Any = self.work.server.gui
        self._made, self._texts, self._sliders, self.all = [], [], {}, None
        with self._folder:
            if any(row.moves for row in self.rows):
                self.all = gui.add_slider("All (%)", 0, 100, 1, 0)
                self.all.on_update(self.work.guarded(self._move_all))
                self._made.append(self.all)
            for row in self.rows:
                self._texts.append(gui.add_html(""))
                if row.moves and row.joint is not None:
                    self._made.append(self._slider(row.joint))
        self._made += self._texts

    def _slider(self, joint: Joint) -> Any:
        low, high = _ends(joint)
        step = 0.1 if joint.type == "prismatic" else 0.5
        now = _shown(joint, self.work.scene.values[joint.name])
        name = self.work.state.articulation.links[joint.child].name
        slider = self.work.server.gui.add_slider(
            f"{name} ({unit(joint)})", low, max(high, low + step), step, now,
            hint=span(joint),
        )  # fmt: skip

        def move(event: Any) -> None:
            if event.client is not None:  # a person's hand, not `pose`
                self._stop.set()
                self.work.scene.pose({joint.name: kept_value(joint, float(slider.value))})

        slider.on_update(self.work.guarded(move))
        self._sliders[joint.name] = slider
        return slider

    def _move_all(self, event: Any) -> None:
        if event.client is not None:
            self._stop.set()
        self.pose(all_at(self.work.state.articulation, self.all.value / 100))

    def _row(self, number: int, row: Part, colors: Any) -> str:
        """A row in HTML."""
        work, dormant = self.work, row.link < 0
        sure, motion, more = "", "does not move", ""
        if row.joint is not None:
            sure = words.sureness(row.joint, work.open.made_from)
            motion = f"{words.MOTIONS[row.joint.subtype]}; {span(row.joint)}"
            more = " review" if words.needs_review(row.joint) and not dormant else ""
        if dormant:
            more, sure = " dormant", f"may move {WAKE.format(number=number)}"
        return ROW.format(
            more=more + (" chosen" if row.name == work.part else "")
            + (" over" if row.name == work.over else ""),
            key=key_of(number), number=number, digit=number if 0 < number <= PLAYING.digits else "",
            indent=0.4 + 0.9 * row.depth, sure=sure, called=escape(work.called(row.name)),
            title=escape(f"{row.name} ({row.kind}) {motion}"),
            icon=ICON.format(path=PATHS[row.joint.subtype if row.joint else "fixed"]),
            color="150,150,150" if dormant else ",".join(map(str, colors[row.link])),
        )  # fmt: skip


def key_of(number: int) -> str:
    """The key that chooses a row: its digit; beyond these, one that only a click on it presses."""
    return str(number) if number <= PLAYING.digits else f"part {number}"


def _ends(joint: Joint) -> tuple[float, float]:
    """Of a joint's slider; a free one makes one turn."""
    if not np.isfinite([joint.lower, joint.upper]).all():
        return -180.0, 180.0
    low, high = shown_value(joint, joint.lower), shown_value(joint, joint.upper)
    return float(np.ceil(10 * low - 1e-6) / 10), float(np.floor(10 * high + 1e-6) / 10)


def _shown(joint: Joint, value: float) -> float:
    return float(np.clip(shown_value(joint, value), *_ends(joint)))
