"""The panel for reviewing a folder: what is next, and a decision on each object."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from functools import partial
from html import escape
from statistics import median
from typing import Any

from mam_sim.studio.ahead import AHEAD, Ahead
from mam_sim.studio.place import Place
from mam_sim.studio.review import DECISIONS, Decision, Review
from mam_sim.studio.thumbnails import Thumbnails
from mam_sim.studio.workspace import Workspace

KEYS: dict[Decision, Any] = {"accept": "enter", "mend": "M", "reject": "delete"}
HELP = "*Keys: Enter accepts, M marks to be mended, Delete rejects, N goes on.*"
SHOWN = 12  # rows of the list
OPEN = "#e66e1433"  # behind the row of the open object
MADE = "made; nothing is doubted"
HEAD = (
    '<div style="padding:.2em .75em;font-size:.875em">'
    "{done} of {count} decided, the most doubtful first.{each}</div>"
)
ROW = (
    '<div class="object" data-key="object {row}" style="display:flex;gap:.6em;align-items:center;'
    'padding:.2em .75em;background:{shade};font-size:.875em;overflow-wrap:anywhere;cursor:pointer">'
    '<img src="{picture}" alt="" style="width:3em;height:3em;object-fit:contain;flex:none">'
    "<span><b>{name}</b><br>{told}</span></div>"
)


class Queue:
    """Decisions on the objects of a folder, one after the other, and the next ones made meanwhile.

    Attributes:
        path: of the open object, below the folder.
    """

    def __init__(
        self, work: Workspace, review: Review, go_to: Callable[[int], None],
        place: Callable[[int], Place],
    ) -> None:  # fmt: skip
        """Build the panel.

        Args:
            review: of the folder. go_to: opens an object of it. place: where its files are.
        """
        self.work, self.review, self.place = work, review, place
        self._open, self._opening = go_to, threading.Lock()
        self._wanted, self._leaving = "", False  # path to open next; whether the object goes away
        self.path = review.entries[0].path
        self.ahead = Ahead(lambda *made: work.guarded(partial(self._made, *made))(None))
        self._failed: dict[str, str] = {}
        self._shown: list[str] = []  # paths of the rows of the list
        gui: Any = work.server.gui
        self.progress = gui.add_progress_bar(0)
        self.list = gui.add_html("")
        self.thumbnails = Thumbnails(review.folder, self.refresh)
        self.note = gui.add_text("Note", "")
        self.buttons = gui.add_button_group("Decide", DECISIONS)
        self.buttons.on_click(work.guarded(self._clicked))
        gui.add_markdown(HELP)
        self.names = gui.add_dropdown("Go to", tuple(e.path for e in review.entries))
        self.names.on_update(self._chosen)
        gui.add_button("Next").on_click(work.guarded(self._next, alone=False))
        for decision, key in KEYS.items():
            gui.add_command(decision, hotkey=key).on_trigger(self._key(decision))
        gui.add_command("next object", hotkey="N").on_trigger(work.guarded(self._next, alone=False))
        for row in range(SHOWN):
            self._command(f"Go to object {row + 1} of the list", f"object {row}", row)
        self._began = time.monotonic()

    def opened(self, index: int, error: str = "") -> None:
        """An object was opened: its time begins, and the next ones are made.

        Args:
            error: why it could not be, in words; "" where it could.
        """
        self._began, self._leaving = time.monotonic(), False
        entry = self.review.entries[index]
        self.path, self.note.value = entry.path, entry.note
        if error:
            self._failed[entry.path] = error
        self.refresh()
        self._make_ahead()

    def refresh(self) -> None:
        """The list around the open object, and how far one is."""
        entries, index = self.review.entries, self.review.index(self.path)
        self.progress.value = 100 * self.review.done / len(entries)
        first = max(0, min(index - SHOWN // 3, len(entries) - SHOWN))
        rows = [HEAD.format(done=self.review.done, count=len(entries), each=self._each())]
        shown = entries[first : first + SHOWN]
        self._shown = [entry.path for entry in shown]
        for k, entry in enumerate(shown, first):
            told = entry.decision or self._failed.get(entry.path, "") or entry.why or MADE
            rows.append(ROW.format(
                row=k - first, picture=self.thumbnails.url(entry.path), name=escape(entry.path),
                told=escape(told), shade=OPEN if k == index else "transparent",
            ))  # fmt: skip
        self.list.content = "".join(rows)
        paths = tuple(entry.path for entry in entries)
        if self.names.options != paths:
            self.names.options = paths
        if self.names.value != entries[index].path:
            self.names.value = entries[index].path
        self.thumbnails.want(self._shown)

    def _each(self) -> str:
        spent = [e.seconds for e in self.review.entries if e.decision]
        return f" {median(spent):.0f} s an object." if spent else ""

    def _make_ahead(self) -> None:
        """Make the next objects that nobody has made, in the order of doubt known so far."""
        wanted = [
            i for i, e in enumerate(self.review.entries)
            if not e.decision and e.path not in (self.path, *self._failed) and self._unmade(e.path)
        ]  # fmt: skip
        self.ahead.want([self.place(i) for i in wanted[: AHEAD.objects]])

    def _unmade(self, path: str) -> bool:
        return (self.review.folder / path).is_file()

    def _made(self, place: Place, error: str) -> None:
        """An object was made in the background: it takes its place in the list."""
        assert place.source is not None
        path = place.source.name
        if error:
            self._failed[path] = error
        elif any(e.path == path for e in self.review.entries):
            self.review.look_again(path)
            self.path = self.review.entries[self.review.index(self.path)].path
        self.refresh()
        self._make_ahead()

    def _key(self, decision: Decision) -> Callable[[Any], None]:
        def decide(event: Any) -> None:
            self._decide(event, decision)

        return self.work.guarded(decide, alone=False)

    def _clicked(self, event: Any) -> None:
        self._decide(event, self.buttons.value)

    def _decide(self, event: Any, decision: Decision) -> None:
        if self._leaving:
            return  # the object that is meant is not on the screen yet
        session, index = self.work.session, self.review.index(self.path)
        if session is not None and decision == "accept" and session.place.source is not None:
            edited = session.unsaved
            if edited:
                session.save()
            if edited or not (session.place.asset / "asset.json").is_file():
                self.ahead.make(session.place)
        elif session is not None and session.unsaved and decision == "mend":
            session.save()
        spent = time.monotonic() - self._began
        self.review.decide(index, decision, self.note.value, spent)
        self.refresh()  # at once: the next object takes seconds to open
        self.work.say(event, decision, self.review.entries[index].path, "green")
        self._next()

    def _next(self) -> None:
        index = self.review.next_from(self.review.index(self.path))
        if index is None:
            self.refresh()
            self.work.say(None, "All decided", f"See {self.review.folder / 'review.csv'}", "green")
        else:
            self.go(index)

    def go(self, index: int) -> None:
        """Open an object; while one is being opened, the last that was asked for comes after it."""
        self._wanted = self.review.entries[index].path
        while self._wanted and self._opening.acquire(blocking=False):
            try:
                path, self._wanted, self._leaving = self._wanted, "", True
                self._open(self.review.index(path))
            finally:
                self._leaving = False
                self._opening.release()

    def _command(self, label: str, key: Any, row: int) -> None:
        def go() -> None:
            if row < len(self._shown):
                self.go(self.review.index(self._shown[row]))

        command = self.work.server.gui.add_command(label, hotkey=key)
        command.on_trigger(self.work.guarded(go, alone=False))

    def _chosen(self, event: Any) -> None:
        if event.client is not None:  # a person's choice, not ours
            index = self.review.index(self.names.value)
            self.work.guarded(lambda: self.go(index), alone=False)(event)
