"""The panel for reviewing a folder: what is next, and a decision on each object."""

from __future__ import annotations

import time
from collections.abc import Callable
from html import escape
from typing import Any

from mam_sim.studio.review import DECISIONS, Decision, Review
from mam_sim.studio.thumbnails import Thumbnails
from mam_sim.studio.workspace import Workspace

KEYS: dict[Decision, Any] = {"accept": "A", "mend": "M", "reject": "R"}
SHOWN = 12  # rows of the list
OPEN = "#e66e1433"  # behind the row of the open object
HEAD = (
    '<div style="padding:.2em .75em;font-size:.875em">'
    "{done} of {count} decided, the most doubtful first.</div>"
)
ROW = (
    '<div style="display:flex;gap:.6em;align-items:center;padding:.2em .75em;'
    'background:{shade};font-size:.875em;overflow-wrap:anywhere">'
    '<img src="{picture}" alt="" style="width:3em;height:3em;object-fit:contain;flex:none">'
    "<span><b>{name}</b><br>{told}</span></div>"
)


class Queue:
    """Decisions on the objects of a folder, one after the other.

    Attributes:
        index: of the open object.
    """

    def __init__(self, work: Workspace, review: Review, go_to: Callable[[int], None]) -> None:
        """Build the panel.

        Args:
            review: of the folder. go_to: opens an object of it.
        """
        self.work, self.review, self.go_to, self.index = work, review, go_to, 0
        gui: Any = work.server.gui
        self.progress = gui.add_progress_bar(0)
        self.list = gui.add_html("")
        self.thumbnails = Thumbnails(review.folder, self.refresh)
        self.note = gui.add_text("Note", "")
        self.buttons = gui.add_button_group("Decide", DECISIONS)
        self.buttons.on_click(work.guarded(self._clicked))
        gui.add_markdown("*Keys: A accepts, M marks to be mended, R rejects, N goes on.*")
        self.names = gui.add_dropdown("Go to", tuple(e.path for e in review.entries))
        self.names.on_update(self._chosen)
        gui.add_button("Next").on_click(work.guarded(self._next, alone=False))
        for decision, key in KEYS.items():
            gui.add_command(decision, hotkey=key).on_trigger(self._key(decision))
        gui.add_command("next object", hotkey="N").on_trigger(work.guarded(self._next, alone=False))
        self._began = time.monotonic()

    def opened(self, index: int) -> None:
        """An object was opened: its time begins."""
        self.index, self._began = index, time.monotonic()
        entry = self.review.entries[index]
        self.note.value = entry.note
        if self.names.value != entry.path:
            self.names.value = entry.path
        self.refresh()

    def refresh(self) -> None:
        """The list around the open object, and how far one is."""
        entries = self.review.entries
        self.progress.value = 100 * self.review.done / len(entries)
        first = max(0, min(self.index - SHOWN // 3, len(entries) - SHOWN))
        rows = [HEAD.format(done=self.review.done, count=len(entries))]
        shown = entries[first : first + SHOWN]
        for k, entry in enumerate(shown, first):
            rows.append(ROW.format(
                picture=self.thumbnails.url(entry.path), name=escape(entry.path),
                told=escape(entry.decision or entry.why),
                shade=OPEN if k == self.index else "transparent",
            ))  # fmt: skip
        self.list.content = "".join(rows)
        self.thumbnails.want([entry.path for entry in shown])

    def _key(self, decision: Decision) -> Callable[[Any], None]:
        def decide(event: Any) -> None:
            self._decide(event, decision)

        return self.work.guarded(decide, alone=False)

    def _clicked(self, event: Any) -> None:
        self._decide(event, self.buttons.value)

    def _decide(self, event: Any, decision: Decision) -> None:
        session = self.work.session
        if session is not None and session.unsaved and decision != "reject":
            session.save()
        spent = time.monotonic() - self._began
        self.review.decide(self.index, decision, self.note.value, spent)
        self.work.say(event, decision, self.review.entries[self.index].path, "green")
        self._next()

    def _next(self) -> None:
        index = self.review.next_from(self.index)
        if index is None:
            self.refresh()
            self.work.say(None, "All decided", f"See {self.review.folder / 'review.csv'}", "green")
        else:
            self.go_to(index)

    def _chosen(self, event: Any) -> None:
        if event.client is not None:  # a person's choice, not ours
            paths = [e.path for e in self.review.entries]
            self.work.guarded(lambda: self.go_to(paths.index(self.names.value)))(event)
