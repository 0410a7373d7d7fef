"""The panel for asking a language model, or whoever answers in a folder, about the open object."""

from __future__ import annotations

import threading
from typing import Any

from mam_pipeline.models import consent
from mam_sim.studio.proposal import Answerer, Proposal, Stopped, answerer, ask
from mam_sim.studio.workspace import Workspace

HELP = "*Pictures of the object are sent only when you click. The answer is a proposal.*"
RIGHT = "**It is right as it stands**, says the answer; there is nothing to take."


class Ask:
    """Asks in the background; what is answered is shown, and taken or left by a click."""

    def __init__(self, work: Workspace) -> None:
        self.work = work
        gui: Any = work.server.gui
        gui.add_markdown(HELP)
        self.who = gui.add_markdown("")
        self.allow = gui.add_button("It may be asked, now and later", color="gray")
        self.whole = gui.add_button("Ask about the object", icon="message-question")
        self.one = gui.add_button("Ask about the chosen part", icon="message-question")
        self.stop = gui.add_button("Stop asking", color="gray", visible=False)
        self.doing = gui.add_markdown("")
        self.folder = gui.add_folder("The proposal", visible=False)
        with self.folder:
            self.take = gui.add_button("Accept", icon="check")
            self.leave = gui.add_button("Reject", color="gray", icon="x")
            self.told = gui.add_markdown("")
        self.allow.on_click(work.guarded(self._allow))
        self.whole.on_click(work.guarded(lambda event: self._ask(event, ""), alone=False))
        self.one.on_click(work.guarded(lambda event: self._ask(event, work.part), alone=False))
        self.stop.on_click(work.guarded(lambda: self._stop.set(), alone=False))
        self.take.on_click(work.guarded(self._take))
        self.leave.on_click(work.guarded(self._drop))
        self.proposal: Proposal | None = None
        self._asking, self._stop = threading.Lock(), threading.Event()
        self._pictures: list[Any] = []

    def refresh(self) -> None:
        """Who would be asked and what about; a proposal about what has changed since is gone."""
        work, who = self.work, self._answerer()
        joint, fixed = work.joint(), work.open.why_fixed
        self.who.content = fixed or f"{who.told}."
        self.allow.visible = not fixed and who.ready and not who.allowed
        busy = self._asking.locked()
        self.whole.disabled = busy or bool(fixed) or not who.allowed
        self.one.disabled = self.whole.disabled or joint is None
        self.one.label = f"Ask about {work.part if joint else 'the chosen part'}"
        self.stop.visible = busy
        if self.proposal is not None and self.proposal.state is not work.state:
            self._drop()

    def _answerer(self) -> Answerer:
        return answerer(self.work.open.place.config)

    def _allow(self) -> None:
        consent.remember(self._answerer().who)
        self.refresh()

    def _ask(self, event: Any, part: str) -> None:
        if not self._asking.acquire(blocking=False):
            return
        work, self._stop = self.work, threading.Event()
        session, state = work.open, work.state
        try:
            with work.lock:
                self._drop()
                self.refresh()
            found = ask(session, part, self._tell, self._stop)
        except Stopped as stopped:
            work.say(event, "Stopped", str(stopped))
            return
        finally:
            self._asking.release()
            with work.lock:
                self.doing.content = ""
                self.refresh()
        pictures = found.pictures()
        with work.lock:
            if work.state is state:
                self._show(found, pictures)
            else:
                work.say(event, "Answered too late", "The object was edited meanwhile.")

    def _tell(self, text: str) -> None:
        self.doing.content = f"*{text}*"

    def _show(self, found: Proposal, pictures: list[tuple[str, Any]]) -> None:
        self.proposal, self.folder.visible = found, True
        self.take.visible = found.changes
        rows = [found.talk, f"*{found.cost}*" if found.cost else ""]
        self.told.content = "\n\n".join(r for r in ("" if found.changes else RIGHT, *rows) if r)
        with self.folder:
            for name, picture in pictures:
                self._pictures.append(self.work.server.gui.add_image(picture, label=name))

    def _take(self) -> None:
        if self.proposal is not None:
            self.work.edit(self.proposal.taken)  # the state is another then: the proposal goes

    def _drop(self) -> None:
        self.proposal, self.folder.visible = None, False
        for picture in self._pictures:
            picture.remove()
        self._pictures = []
