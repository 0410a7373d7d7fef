"""The axis of a joint taken from the mesh: by pointing at an edge or a rim, also a hidden one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mam_pipeline.errors import ConfigError
from mam_pipeline.render.tracer import Tracer
from mam_pipeline.types import Articulation, FloatArray, IntArray
from mam_sim.studio.lines import LineHit, Lines, lines_near, mesh_lines, posed_lines
from mam_sim.studio.parts import Parts
from mam_sim.studio.picking import Camera
from mam_sim.studio.pointer import camera_of
from mam_sim.studio.workspace import Workspace

ASK = (
    "Axis of the {part}: point at an edge or a round rim. A click takes its line, another click at "
    "the same place the next one behind it."
)
NOTHING = "no straight edge and no round rim is near the pointer: point closer to one"


@dataclass(frozen=True)
class Drawing:
    """How a line under the pointer is drawn.

    Attributes:
        color: of the line. hidden: of one that a surface hides, which is dashed.
        wide, thin: pixels of the edge, and of the axis that goes on beyond it.
        beyond: diagonals by which it goes on. dash: diagonals from one dash to the next.
        before_eye: metres before the camera at which it is drawn, over everything else.
        above: of its name over the pointer, shares of the view's height.
        same: shares of the view within which a second click is at the same place.
    """

    color: tuple[int, int, int] = (214, 40, 140)
    hidden: tuple[int, int, int] = (150, 60, 200)
    wide: float = 5.0
    thin: float = 1.5
    beyond: float = 0.12
    dash: float = 0.02
    before_eye: float = 0.1
    above: float = 0.03
    same: float = 0.012


DRAWING = Drawing()


@dataclass
class _Place:
    """A place of a window's view that was pointed at, with the lines there.

    Attributes:
        at: (2,) 0..1 from the upper left. rest: the object's lines; now: as it was posed then.
        next: which of the hits a click takes.
    """

    camera: Camera
    at: FloatArray
    rest: Lines
    now: Lines
    hits: list[LineHit]
    next: int = 0

    def holds(self, camera: Camera, at: FloatArray) -> bool:
        """Whether a pointer is still there, and sees what it saw."""
        return (
            bool(np.abs(at - self.at).max() < DRAWING.same)
            and np.allclose(camera.position, self.camera.position)
            and np.allclose(camera.rotation, self.camera.rotation)
            and camera.aspect == self.camera.aspect
        )

    @property
    def hit(self) -> LineHit | None:
        """The line that a click takes."""
        return self.hits[self.next % len(self.hits)] if self.hits else None


@dataclass
class FromMesh:
    """Waits for a line to be pointed at, shows it, and gives it to `take` when it is clicked.

    Attributes:
        take: what is done with a line: unit axis and a point on it, (3,) each, at rest.
        told: of the beginning and the end.
    """

    work: Workspace
    parts: Parts
    take: Callable[[FloatArray, FloatArray], None]
    told: Callable[[], None]
    _lines: tuple[Any, IntArray, Lines] | None = field(default=None, repr=False)
    _tracer: tuple[Any, dict[str, float], Tracer] | None = field(default=None, repr=False)
    _place: _Place | None = field(default=None, repr=False)
    _drawn: list[Any] = field(default_factory=list, repr=False)

    def toggle(self) -> None:
        """Begin to wait for a line; asked again, end."""
        if self.work.pointing is not None:
            self.end()
            return
        with self.work.busy("Looking for edges and rims"):
            lines = self.lines()
            self._rays()  # so that the pointer need not wait for them
        if not len(lines.axis):
            raise ConfigError("this object has no straight edge and no round rim: place the axis "
                              "by hand")  # fmt: skip
        self.work.pointing = self
        self.work.ask(self._asked())
        self.told()

    def end(self) -> None:
        """Wait no more."""
        self.work.pointing, self._place = None, None
        self._erase()
        self.work.ask("")
        self.told()

    def over(self, client: Any, at: tuple[float, float] | None) -> None:
        """Show the line near the pointer."""
        if at is None:
            self._erase()
            return
        place = self._at(client, np.asarray(at))
        self._draw(client, place)
        told = self._name(place)
        self.work.ask(f"{told[0].upper()}{told[1:]}." if place.hit else self._asked())

    def click(self, event: Any) -> None:
        """Take the line near the click."""
        place = self._at(event.client, np.asarray(event.screen_pos, dtype=np.float64))
        if place.hit is None:
            raise ConfigError(NOTHING)
        line, told = place.hit.line, self._name(place, short=True)
        self.parts.leave_off()
        self.take(place.rest.axis[line], place.rest.origin[line])
        place.next += 1
        self.parts.show_motion()
        self._draw(event.client, place)
        following = f" Another click here: {self._name(place, short=True)}."
        self.work.ask(f"Taken: {told}.{following if len(place.hits) > 1 else ''}")

    def lines(self) -> Lines:
        """Those of the open object at rest; remembered as long as its parts stay the same."""
        shown = self.work.state.articulation
        owner = _owners(shown)
        if self._lines is None or self._lines[0] is not shown.mesh or not np.array_equal(
            self._lines[1], owner
        ):  # fmt: skip
            self._lines = shown.mesh, owner, mesh_lines(shown.mesh, owner)
        return self._lines[2]

    def _at(self, client: Any, at: FloatArray) -> _Place:
        """What is at a place of the view; the same as before where nothing has changed."""
        camera = camera_of(client)
        rest, place = self.lines(), self._place
        if place is not None and place.rest is rest and place.holds(camera, at):
            return place
        self.parts.leave_off()
        shown = self.work.state.articulation
        poses = shown.link_poses(self.work.scene.values)
        asleep = [poses[shown.face_link[part.link.faces[0]]] for part in shown.dormant]
        now = posed_lines(rest, np.stack([*poses, *asleep]))
        ray = camera.rays(at[None])[0]
        hits = lines_near(now, self._rays(), camera.position, ray, shown.mesh.diagonal)
        self._place = _Place(camera, at, rest, now, hits)
        return self._place

    def _rays(self) -> Tracer:
        """Rays into the object as posed on the screen; remembered while it stays so."""
        shown, values = self.work.state.articulation, self.work.scene.values
        known = self._tracer
        if known is not None and known[0] is shown and known[1] == values:
            return known[2]
        tracer = self.work.tracer()[1]
        tracer.cast(np.zeros(3), np.ones((1, 3)))  # the first ray waits for its tree of boxes
        self._tracer = shown, dict(values), tracer
        return tracer

    def _asked(self) -> str:
        return ASK.format(part=self.work.called(self.work.part))

    def _name(self, place: _Place, short: bool = False) -> str:
        """What the line at a place is called, how long it is, and how many more there are."""
        if place.hit is None:
            return NOTHING
        k, shown = place.hit.line, self.work.state.articulation
        links = [*shown.links, *(part.link for part in shown.dormant)]
        part = self.work.called(links[int(place.now.owner[k])].name)
        size = 100 * float(place.now.length[k])
        what = f"middle of a rim of the {part}, {size:.1f} cm across" if place.now.round[k] else (
            f"edge of the {part}, {size:.1f} cm")  # fmt: skip
        what += ", hidden" if place.hit.hidden else ""
        others = len(place.hits) - 1
        return what if short or not others else f"{what}; {others} more here"

    def _draw(self, client: Any, place: _Place) -> None:
        """Draw the line at a place before all surfaces, in the window of who points."""
        self._erase()
        if place.hit is None:
            return
        lines, k = place.now, place.hit.line
        size = self.work.state.articulation.mesh.diagonal
        color = DRAWING.hidden if place.hit.hidden else DRAWING.color
        ends = lines.ends[lines.line == k]
        reach = 0.5 * lines.length[k] * (not lines.round[k]) + DRAWING.beyond * size
        axis = lines.origin[k] + np.outer([-reach, reach], lines.axis[k])[None]
        if place.hit.hidden:
            ends = _dashed(ends, DRAWING.dash * size)
        eye, scene = place.camera.position, client.scene
        # shrunk towards the eye, it covers the same pixels, and nothing stands before it
        shrink = DRAWING.before_eye / max(float(np.linalg.norm(lines.origin[k] - eye)), 1e-9)
        for name, points, width in (("edge", ends, DRAWING.wide), ("axis", axis, DRAWING.thin)):
            self._drawn.append(scene.add_line_segments(
                f"/pointed/{name}", eye + shrink * (points - eye), color, thickness=width,
                thickness_units="screen",
            ))  # fmt: skip
        ray = place.camera.rays((place.at - [0.0, DRAWING.above])[None])[0]
        self._drawn.append(scene.add_label(
            "/pointed/name", self._name(place, short=True), anchor="bottom-center",
            position=eye + DRAWING.before_eye * ray,
        ))  # fmt: skip

    def _erase(self) -> None:
        for node in self._drawn:
            node.remove()
        self._drawn = []


def _owners(shown: Articulation) -> IntArray:
    """(F,) row of the link that has each face; dormant parts count on after the links."""
    owner = np.array(shown.face_link)
    for k, part in enumerate(shown.dormant):
        owner[part.link.faces] = len(shown.links) + k
    return owner


def _dashed(ends: FloatArray, dash: float) -> FloatArray:
    """(d, 2, 3) every second piece of segments (m, 2, 3)."""
    out = []
    for start, end in ends:
        pieces = 2 * int(np.linalg.norm(end - start) / (2 * dash)) + 1
        at = start + np.linspace(0, 1, pieces + 1)[:, None] * (end - start)
        out.append(np.stack([at[:-1:2], at[1::2]], axis=1))
    return np.concatenate(out)
