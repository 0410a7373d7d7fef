"""The studio's page: panels on a viser server, and clicks on the object."""

from __future__ import annotations

import io
import threading
from contextlib import redirect_stdout, suppress
from dataclasses import replace
from functools import partial
from html import escape
from typing import Any

from mam_pipeline.errors import HintNeeded, MamSimError, NotThisKind
from mam_pipeline.formats.suffixes import PHOTOS
from mam_pipeline.make_config import MakeConfig
from mam_sim.console import STAGES
from mam_sim.studio import server as studio_server
from mam_sim.studio.ask import Ask
from mam_sim.studio.hover import Hover
from mam_sim.studio.keys import Keys
from mam_sim.studio.look import Look
from mam_sim.studio.marking import Marking, MarkingPage
from mam_sim.studio.mend import Mend
from mam_sim.studio.parts import Parts
from mam_sim.studio.place import Place, place_of
from mam_sim.studio.pointer import Pointer
from mam_sim.studio.preview import Preview
from mam_sim.studio.queue import Queue
from mam_sim.studio.review import Review, asset_of
from mam_sim.studio.scene import Scene
from mam_sim.studio.session import Session
from mam_sim.studio.trying import Trying
from mam_sim.studio.workspace import Workspace

ORANGE = (230, 110, 20)
HEAD = '<div class="head">{text}</div><div class="bar">{buttons}</div>'
BUSY = '<div class="busy"><i></i><span>{text} …</span>{button}</div>'
ASKED = """<div class="busy asked"><span>{text}</span>
<button data-key="escape" title="Esc">Done</button></div>"""
CANCEL = '<button data-key="escape" title="Esc">Cancel</button>'


class Page:
    """The page of one object, or of a queue of them.

    Attributes:
        url: where it is. parts, look, mend, trying: its panels.
        photo: page of the open object's photo, where there is one.
    """

    def __init__(self, port: int = 0, queue: bool = False) -> None:
        """Serve an empty page.

        Args:
            port: to listen on; 0 takes any free one. queue: whether a folder is to be reviewed.

        Raises:
            InputError: the port is taken. MissingExtra: viser is not installed.
        """
        self.server = studio_server.start(port, "mam-sim studio")
        gui: Any = self.server.gui
        gui.configure_theme(
            control_width="medium", show_logo=False, show_share_button=False, brand_color=ORANGE
        )
        gui.main_panel.dock_right()
        self.server.scene.set_up_direction("+z")
        self.server.scene.configure_default_lights(False)  # `Scene.light` has its own
        self.server.scene.configure_environment_map(None)  # would halve the frames a second
        self.work = Workspace(self.server, Scene(self.server.scene))
        self.head = gui.add_html(HEAD.format(text="Reading …", buttons=""))
        self.busy = gui.add_html("", visible=False)
        self.asked = gui.add_html("", visible=False)
        self.work.tell, self.work.ask = self._tell, self._ask
        self._queue: Queue | None = None
        self.url = f"http://{studio_server.HOST}:{self.server.get_port()}/"
        self.photo: MarkingPage | None = None
        self._build(queue)

    def open(self, place: Place) -> None:
        """Read an object, saying how far it is, and show it; of a photo, its page as well.

        Raises:
            MamSimError: it cannot be read, and is no photo on which a person might mark it.
        """

        def tell(stage: str) -> None:
            if not read.is_set():
                self._tell(f"{STAGES.get(stage, stage)}: {name}")

        read = threading.Event()  # what is prepared after it is of no concern to the person
        name = (place.source or place.asset).name
        try:
            self._show_photo(place)
            session = Session(place, tell)
        except MamSimError as error:
            self._failed(name, error)
            if self.photo is None or not isinstance(error, HintNeeded | NotThisKind):
                raise
            self.work.drop()
            return
        finally:
            read.set()
            self._tell("")
        self.put(session)
        if self.photo is None:  # whose page reads it at the same time
            threading.Thread(target=session.prepare, daemon=True).start()

    def _show_photo(self, place: Place) -> None:
        """Serve the page on which a photo is marked; saving there opens the object again."""
        if self.photo is not None and self.photo.marking.path == place.source:
            return  # saved there: its page stays where it is
        if self.photo is not None:
            self.photo.stop()
            self.photo = None
        if place.source is None or place.source.suffix.lower() not in PHOTOS:
            return
        again = partial(threading.Thread, target=self._open_again, args=(place,), daemon=True)
        options = place.config.photo.given()
        marking = Marking(place.source, place.hints, options, lambda: again().start())
        self.photo = MarkingPage(marking)

    def _open_again(self, place: Place) -> None:
        with self.work.lock, suppress(MamSimError):  # the line on top says what was wrong
            self.open(place)

    @property
    def _photo_link(self) -> str:
        """HTML, beginning with a space; "" where there is no photo."""
        if self.photo is None:
            return ""
        return f' · <a href="{self.photo.url}" target="_blank">Put it right on the photo</a>'

    def put(self, session: Session) -> None:
        """Show an open object."""
        self.work.put(session)

    def review(self, review: Review, config: MakeConfig) -> None:
        """Show the objects of a folder one by one, and go on where the last review stopped.

        The page was made with `queue`.

        Args:
            review: of the folder. config: with which assets are made.
        """

        def place(index: int) -> Place:
            given = review.folder / review.entries[index].path
            out = None if given.is_dir() else asset_of(given)
            return place_of(given, replace(config, hints=None), out)

        def go_to(index: int) -> None:
            name, why = review.entries[index].path, ""
            try:
                self.open(place(index))
            except MamSimError as error:
                self.work.drop()
                self._failed(name, error)
                why = f"cannot be opened: {error}"
            queue.opened(review.index(name), why)

        with self._front:
            self._queue = queue = Queue(self.work, review, go_to, place)
        self.work.panels.append(queue)
        first = review.next_from(-1)
        queue.go(0 if first is None else first)

    def stop(self) -> None:
        """End the servers, and what is made in the background."""
        if self._queue is not None:
            self._queue.ahead.stop()
        if self.photo is not None:
            self.photo.stop()
        with redirect_stdout(io.StringIO()):  # it takes leave on stdout
            self.server.stop()

    def refresh(self) -> None:
        """The lines on top: what is open, whether it is saved, and what can be done with it."""
        session = self.work.open
        count = sum(j.type != "fixed" for j in session.state.articulation.joints)
        saved = "not saved" if session.unsaved else "saved" if session.can_undo else ""
        shown, whole = len(session.mesh.faces), session.faces_in_file
        light = f"shown with {shown:,} of {whole:,} triangles" if shown < whole else ""
        rows = [f"<b>{escape(session.name)}</b>", f"{count} joint{'' if count == 1 else 's'}"]
        rows += [row for row in (saved, light) if row]
        text = " · ".join(rows) + self._photo_link
        self.head.content = HEAD.format(text=text, buttons=self._keys.buttons())

    def _failed(self, name: str, error: MamSimError) -> None:
        text = f"<b>{escape(name)}</b> cannot be opened: {escape(str(error))}{self._photo_link}"
        self.head.content = HEAD.format(text=text, buttons="")

    def _tell(self, doing: str) -> None:
        """What is being computed, with a button where it can be cancelled; else nothing."""
        self.busy.visible = bool(doing)
        self.busy.content = BUSY.format(
            text=escape(doing), button=CANCEL if self.work.doing else ""
        )

    def _ask(self, what: str) -> None:
        """What the page waits for, with a button that ends it; else nothing."""
        self.asked.visible = bool(what)
        self.asked.content = ASKED.format(text=escape(what))

    def _build(self, queue: bool) -> None:
        """The panels; they are filled when an object is open."""
        gui: Any = self.server.gui
        work = self.work
        self.parts = Parts(work)
        tabs = gui.add_tab_group()
        if queue:  # the tab that is open at first
            self._front = tabs.add_tab("Queue", icon="list-check")
        with tabs.add_tab("Look", icon="eye"):
            self.look = Look(work)
        with tabs.add_tab("Put right", icon="tool"):
            self.mend = Mend(work, self.parts)
        with tabs.add_tab("Try", icon="player-play"):
            self.trying = Trying(work, self.parts)
        with tabs.add_tab("Ask", icon="message-question"):
            self.ask = Ask(work)
        self._keys = Keys(work, self.parts, self.mend)
        work.panels = [
            self.parts, self._keys, self, self.look, self.mend, self.trying, self.ask
        ]  # fmt: skip
        Pointer(work)
        Hover(work, self.parts, Preview(work, self.parts))
