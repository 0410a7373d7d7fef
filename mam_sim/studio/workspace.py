"""What the page's panels share: the open object, what is selected, and how it is drawn."""

from __future__ import annotations

import inspect
import threading
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import dataclass, field
from functools import wraps
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.errors import ConfigError, MamSimError
from mam_pipeline.geometry.sampling import face_geometry
from mam_pipeline.geometry.sweep import SweepScene
from mam_pipeline.joints.estimate import faces_around
from mam_pipeline.render.mesh_pictures import posed
from mam_pipeline.render.tracer import Tracer
from mam_pipeline.types import FloatArray, Joint, JointCandidate, Mesh
from mam_sim.studio import words
from mam_sim.studio.scene import Scene, Show
from mam_sim.studio.session import Change, Session
from mam_sim.studio.state import State

if TYPE_CHECKING:
    import viser


Picks = Literal["pieces", "areas", "brush"]


class Panel(Protocol):
    """A part of the page that shows something of the open object."""

    def refresh(self) -> None:
        """Draw again what depends on the object, its state or the selection."""


class Pointing(Protocol):
    """What waits for a place of the view, in the stead of the selection."""

    def over(self, client: Any, at: tuple[float, float] | None) -> None:
        """The pointer of a window rests at a place, 0..1 from the upper left; None: on no place."""

    def click(self, event: Any) -> None:
        """A place was clicked."""

    def end(self) -> None:
        """Wait no more."""


@dataclass
class Workspace:
    """The state of the page; one for all windows that show it.

    Attributes:
        server: of the page. scene: its three-dimensional view.
        session: the open object; None while the first one is read.
        selected: pieces (primitives), and brushed: faces that are to become pieces of their own.
        part: name of the chosen part. over: of the one under the pointer in the view.
        show, axes, sizes, contacts: how the object is drawn. hulls: collision pieces by link name.
        picks: what a click takes: pieces, areas (faces up to the next sharp edge) or, by brush,
            faces within `brush` of the pointer, diagonals.
        face: last one that was clicked; seen_along: (3,) the ray to it, and
            at: (3,) where it was clicked, metres, both as with the object at rest.
        bad: links that run into something, drawn red. panels: told of every change.
        doing: what is being computed, in words; tell: shows it on the page.
        cancelled: set where the person wants none of it.
        pointing: what clicks on the view are meant for, where not for the selection.
        ask: says on the page what it waits for; "" nothing.
    """

    server: viser.ViserServer
    scene: Scene
    session: Session | None = None
    selected: set[int] = field(default_factory=set)
    brushed: set[int] = field(default_factory=set)
    part: str = ""
    over: str = ""
    picks: Picks = "pieces"
    brush: float = 0.03
    face: int | None = None
    seen_along: FloatArray = field(default_factory=lambda: np.zeros(3))
    at: FloatArray = field(default_factory=lambda: np.zeros(3))
    show: Show = "as it is"
    axes: bool = True
    sizes: bool = False
    contacts: bool = False
    hulls: dict[str, Sequence[Mesh]] = field(default_factory=dict)
    bad: tuple[int, ...] = ()
    panels: list[Panel] = field(default_factory=list)
    doing: str = ""
    tell: Callable[[str], None] = lambda _text: None
    cancelled: threading.Event = field(default_factory=threading.Event)
    pointing: Pointing | None = None
    ask: Callable[[str], None] = lambda _text: None
    lock: threading.RLock = field(default_factory=threading.RLock)
    _called: tuple[State | None, dict[str, str]] = field(default=(None, {}), repr=False)

    @property
    def open(self) -> Session:
        """The open object.

        Raises:
            MamSimError: none is open yet.
        """
        if self.session is None:
            raise MamSimError("the object is still being read")
        return self.session

    @property
    def state(self) -> State:
        """Tree and joints of the open object."""
        return self.open.state

    def joint(self) -> Joint | None:
        """The joint of the chosen part; None for the base or a part that does not move."""
        articulation = self.state.articulation
        for joint in articulation.joints:
            if articulation.links[joint.child].name == self.part and joint.type != "fixed":
                return joint
        return None

    def members(self) -> list[int]:
        """Pieces of the chosen part."""
        nodes = [n for n in self.state.tree.nodes if n.name == self.part]
        return [*nodes[0].primitives] if nodes else []

    def select_nothing(self) -> None:
        """Forget the selection; nothing is drawn."""
        self.selected, self.brushed = set(), set()

    def chosen_faces(self) -> NDArray[np.bool_]:
        """(F,) which faces are selected, by piece or by brush."""
        chosen = np.isin(self.open.primitives.labels, sorted(self.selected))
        chosen[sorted(self.brushed)] = True
        return chosen

    def line(self, joint: Joint | JointCandidate, link: int) -> str:
        """Where the line of a joint runs on a link, as seen from the front."""
        turn, shown = self.state.turn, self.state.articulation
        corners = shown.mesh.faces[shown.links[link].faces]
        seen = shown.mesh.vertices[np.unique(corners)] @ turn.T
        box = np.stack([seen.min(axis=0), seen.max(axis=0)])
        return words.line(joint.subtype, turn @ joint.axis, turn @ joint.origin, box)

    def size(self) -> FloatArray:
        """(3,) depth, width and height of the object, metres."""
        return np.asarray(np.ptp(self.state.articulation.mesh.vertices @ self.state.turn.T, axis=0))

    def put(self, session: Session) -> None:
        """Open another object."""
        with self.lock:
            self.end_pointing()
            self.session, self.part, self.over = session, "", ""
            session.checkpoint = self.check
            self.select_nothing()
            self.face = None
            self.hulls, self.bad = {}, ()
            self.scene.values = {}
            self.refresh()
            self.look_at_the_front()

    def drop(self) -> None:
        """Show nothing: the next object could not be opened."""
        with self.lock:
            self.end_pointing()
            self.session, self.part = None, ""
            self.select_nothing()
            self.scene.clear()

    def called(self, name: str) -> str:
        """What people call a part."""
        return self._callings().get(name, name)

    def names(self) -> list[str]:
        """Of all parts, kind by kind, from the upper left."""
        return list(self._callings())

    def _callings(self) -> dict[str, str]:
        state = self.state
        if self._called[0] is not state:
            mesh, links = state.articulation.mesh, list(state.articulation.links)
            links += [part.link for part in state.articulation.dormant]
            middles = mesh.vertices[mesh.faces].mean(axis=1) @ state.turn.T
            parts = {k.name: (k.kind, middles[k.faces].mean(axis=0)) for k in links if len(k.faces)}
            self._called = state, words.callings(parts)
        return self._called[1]

    @contextmanager
    def busy(self, what: str) -> Iterator[None]:
        """Show on the page what is being computed, until it is done or cancelled."""
        self.cancelled.clear()
        self.doing = what
        self.tell(what)
        try:
            yield
        finally:
            self.doing = ""
            self.tell("")

    def check(self) -> None:
        """Go on, or not.

        Raises:
            MamSimError: the person has cancelled.
        """
        if self.cancelled.is_set():
            raise MamSimError("cancelled: nothing was changed")

    def cancel(self) -> None:
        """End what is being computed, or what waits for a click; else choose nothing."""
        if self.doing:
            self.cancelled.set()
            self.tell("Cancelling")
        elif self.pointing is not None:
            with self.lock:
                self.end_pointing()
        elif self.session is not None:
            with self.lock:
                self.select_nothing()
                self.choose("")

    def end_pointing(self) -> None:
        """Clicks select again."""
        if self.pointing is not None:
            self.pointing.end()

    def edit(self, change: Change) -> None:
        """Change the hints and draw what comes of it; the collision pieces are then out of date."""
        of = self.called(self.part) if self.part else "it"
        with self.busy(f"Working out how {of} moves"):
            self.open.edit(change)
        self.after_edit()

    def stand(self, **said: Any) -> None:
        """Say how the object stands, as `Session.stand`, and look at its front again."""
        with self.busy("Working out how it stands"):
            self.open.stand(**said)
        self.face = None
        self.after_edit()
        self.look_at_the_front()

    def look_at_the_front(self) -> None:
        """Floor and light round the object, and every camera before its front."""
        self.scene.floor()
        self.scene.light()
        self.scene.view(self.server.initial_camera)
        for client in self.server.get_clients().values():
            self.scene.view(client.camera)

    def after_edit(self) -> None:
        """Draw the state after an edit, an undo or a redo."""
        self.hulls, self.bad = {}, ()
        self.select_nothing()
        if self.part not in {n.name for n in self.state.tree.nodes}:
            self.part = ""
        self.refresh()

    def refresh(self) -> None:
        """Draw everything again."""
        with self.server.atomic():
            articulation, labels = self.state.articulation, self.open.primitives.labels
            self.scene.turn = self.state.turn
            self.scene.show(articulation, labels, self.show, self.hulls)
            self.mark()
            for panel in self.panels:
                panel.refresh()

    def mark(self) -> None:
        """Draw axes, sizes and selection again; the surfaces stay."""
        self.scene.axes(self.axes, self.part, self.called)
        self.scene.sizes(self.sizes)
        self.scene.contacts(self._touching() if self.contacts else np.zeros((0, 3)))
        if self.bad:
            self.scene.redden(self.bad)
        else:
            self.scene.select(self.chosen_faces())

    def _touching(self) -> FloatArray:
        """(n, 3) where the chosen part, or every one that moves, touches what it does not carry."""
        tree, shown = self.state.tree, self.state.articulation
        found: list[FloatArray] = [np.zeros((0, 3))]
        for joint in shown.joints:
            name = shown.links[joint.child].name
            if joint.type == "fixed" or self.part not in ("", name, tree.nodes[0].name):
                continue
            index = [n.name for n in tree.nodes].index(name)
            around = faces_around(tree, self.open.primitives, index)
            scene = SweepScene(self.open.mesh, around.moving, around.static)
            found.append(scene.contact(limit=400).points)
        return np.concatenate(found)

    def choose(self, part: str) -> None:
        """Make a part the one that is spoken of."""
        self.part = part
        self.mark()
        for panel in self.panels:
            panel.refresh()

    def clicked(self, face: int, at: FloatArray, along: FloatArray) -> None:
        """Remember a click.

        Args:
            at: (3,) on the object as posed. along: (3,) the ray to it.
        """
        shown = self.state.articulation
        pose = shown.link_poses(self.scene.values)[int(shown.face_link[face])]
        self.face, self.seen_along = face, along @ pose[:3, :3]
        self.at = (at - pose[:3, 3]) @ pose[:3, :3]

    def face_normal(self) -> FloatArray:
        """(3,) unit normal of the clicked face at rest, towards who clicked.

        Raises:
            ConfigError: none was clicked.
        """
        if self.face is None:
            raise ConfigError("click on the face first")
        mesh = self.state.articulation.mesh
        normal = face_geometry(mesh.vertices, mesh.faces[[self.face]])[0][0]
        return np.asarray(-normal if normal @ self.seen_along > 0 else normal)

    def tracer(self) -> tuple[Mesh, Tracer]:
        """The object as posed on the screen, and rays into it."""
        mesh = posed(self.state.articulation, self.scene.values)
        return mesh, Tracer(mesh.vertices, mesh.faces)

    def guarded(self, work: Callable[..., Any], alone: bool = True) -> Callable[[Any], None]:
        """A callback that says what went wrong where it was asked for.

        Args:
            work: what to do; it may take the event. alone: while no other callback runs.
        """
        wants_event = bool(inspect.signature(work).parameters)

        @wraps(work)
        def run(event: Any) -> None:
            with self.lock if alone else nullcontext():
                try:
                    work(event) if wants_event else work()
                except MamSimError as error:
                    self.say(event, "Not possible", str(error), "orange")
                except Exception as error:
                    traceback.print_exc()
                    self.say(event, "Something broke", f"{error!r}; nothing was changed", "red")

        return run

    def say(self, event: Any, title: str, body: str, color: Any = "gray") -> None:
        """A notice in the window where something happened, else in all."""
        client = getattr(event, "client", None)
        clients = [client] if client is not None else self.server.get_clients().values()
        for each in clients:
            each.add_notification(title, body, color=color, auto_close_seconds=6.0)
