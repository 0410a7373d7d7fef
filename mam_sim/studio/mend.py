"""The panel for putting right: parts from pieces, and how each part moves."""

from __future__ import annotations

import threading
from collections.abc import Callable
from html import escape
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mam_pipeline.errors import ConfigError
from mam_pipeline.geometry.sampling import unit as unit_vector
from mam_pipeline.hints import Hints
from mam_pipeline.types import FloatArray, Joint, KinematicTree
from mam_sim.facts import shown_value
from mam_sim.studio import edits, words
from mam_sim.studio.from_mesh import FromMesh
from mam_sim.studio.parts import Parts
from mam_sim.studio.picking import snapped, snaps
from mam_sim.studio.session import Session
from mam_sim.studio.stand import Stand
from mam_sim.studio.workspace import Picks, Workspace

KINDS = ("door", "drawer", "lid", "knob", "handle", "wheel", "lever", "button", "panel", "other")
MOTIONS = ("hinge", "spin", "slide", "fixed")
NONE = "(none)"
FROM_MESH, POINTING = "Take the axis from the mesh", "Take no more axes (Esc)"
SLIDES, ASK_FACE = "It slides out of the clicked face", "Click a face to slide out of"
UNCHOSEN = "No part is chosen: click one in the tree or on the object, or press its digit."
WAY = '<div class="way" data-key="way {k}" data-over="way {k}">{k}. {runs}<span>{sure}</span></div>'
NOW = '<div class="way now">now: {runs}</div>'
LINES = '<div class="way about">Other lines: the pointer on one plays it, a click takes it.</div>'
EMPTY = "Nothing is selected: click on the object; with Shift, one more, or drag a box."
PICKS: dict[str, Picks] = {
    "whole pieces": "pieces", "faces up to an edge": "areas", "faces under a brush": "brush",
}  # fmt: skip


class Mend:
    """Edits of the open object; each is one step that can be undone."""

    def __init__(self, work: Workspace, parts: Parts) -> None:
        self.work, self.parts = work, parts
        gui: Any = work.server.gui
        on = work.guarded
        self.about = gui.add_folder("Chosen part")
        with self.about:
            self.part = gui.add_markdown("")
            self.wake = self._button("Wake it: it moves", lambda: self.awake(self._named()), True)
            self.motion = gui.add_dropdown("Moves", MOTIONS)
            self.ways = gui.add_html("")
            self.low = gui.add_number("From", 0.0, step=0.5)
            self.high = gui.add_number("To", 0.0, step=0.5)
            self.from_mesh = FromMesh(work, parts, self._take_line, self._fill)
            self.take = self._button(FROM_MESH, self.point)
            self.clicked = self._button(SLIDES, self._from_click)
            self._turn = self._button("Other direction", self.flip)
            self.name = gui.add_text("Name", "")
            self.kind = gui.add_text("Kind", "")
            self.parent = gui.add_dropdown("Hangs on", (NONE,))
            self._merging = self._button("Merge with the other part", self._merge)
            self._of_part = [
                self.take, self.clicked, self._turn, self._merging,
                self._button("Select its pieces", self._select),
                self._button("As the engine says", self._reset),
            ]  # fmt: skip
        with gui.add_folder("Selection"):
            self.picks = gui.add_dropdown(
                "Select", tuple(PICKS), hint="Faces become a piece of their own"
            )
            self.brush = gui.add_slider("Brush (%)", 0.5, 20, 0.5, 3, visible=False)
            self.selection = gui.add_markdown("")
            self.new_kind = gui.add_dropdown("New part is a", KINDS)
            make = self._button("Make a part of them", self.make, main=True)
            self.target = gui.add_dropdown("Other part", (NONE,))
            self._of_selection = [
                make,
                self._button("Add to the other part", self._add),
                self._button("They do not move", self._fix),
            ]
        with gui.add_folder("Axis by hand", expand_by_default=False):
            gui.add_markdown("*The blue arrow is the axis; it snaps to edges, faces and circles.*")
            self.hand = gui.add_checkbox("Show the handles", False)
            self.snap = gui.add_checkbox("Snap", True)
            self.snapped = gui.add_markdown("")
            self._taking = self._button("Take this axis", self._take_axis)
        self.stand = Stand(work)
        self._gizmo: Any = None
        for handle, change in (
            (self.name, self._rename), (self.kind, self._rekind),
            (self.parent, self._hang), (self.motion, self.move),
            (self.low, self._lower), (self.high, self._upper),
        ):  # fmt: skip
            handle.on_update(self._typed(change))
        self.hand.on_update(on(self._handles))
        self.picks.on_update(on(self._pick_by))
        self.brush.on_update(on(self._pick_by))

    def _button(self, label: str, work: Any, main: bool = False) -> Any:
        button = self.work.server.gui.add_button(label, color=None if main else "gray")
        button.on_click(self.work.guarded(work))
        return button

    def _typed(self, change: Callable[[Any], None]) -> Callable[[Any], None]:
        """A callback for what a person typed or chose, which is taken before anything is redrawn.

        What `refresh` fills in has no client, and changes nothing.
        """

        def run(event: Any) -> None:
            if event.client is None:
                return
            said = event.target.value
            self.work.guarded(lambda: change(said))(event)
            with self.work.lock:
                self.refresh()

        return run

    def refresh(self) -> None:
        """Fill in the chosen part and the selection."""
        self._fill()
        self.stand.refresh()

    def _fill(self) -> None:
        work, nodes = self.work, self.work.state.tree.nodes
        chosen = sorted(work.selected)
        shown = ", ".join(map(str, chosen[:12])) + (" …" if len(chosen) > 12 else "")
        numbers = "number" if len(chosen) == 1 else "numbers"
        rows = [f"{_count(len(chosen), 'piece')} selected ({numbers} {shown})"] if chosen else []
        rows += [f"{_count(len(work.brushed), 'face')} selected"] if work.brushed else []
        self.selection.content = ", and ".join(rows) or EMPTY
        for button in self._of_selection:
            button.disabled = not rows or bool(work.open.why_fixed)
        self._taking.disabled = self._gizmo is None
        names = [n.name for n in nodes]
        _options(self.target, names, self.target.value)
        node = next((n for n in nodes[1:] if n.name == work.part), None)
        about = (self.name, self.kind, self.parent, self.motion, self.low, self.high)
        for handle in about:
            handle.disabled = bool(work.open.why_fixed)
        for handle in (*about, self.ways, *self._of_part):
            handle.visible = node is not None
        self.wake.visible = node is not None and bool(node.dormant)
        joint = work.joint()
        for handle in self._of_part:
            handle.disabled = bool(work.open.why_fixed)
        self.take.disabled |= joint is None
        self.clicked.disabled |= work.face is None or joint is None
        self._turn.disabled |= joint is None
        self._merging.disabled |= self.target.value == work.part
        self.part.content = UNCHOSEN if node is None else f"**{work.called(node.name)}**"
        if node is None:
            self.name.value, self.kind.value = "", ""
            self._fill_ways(None)
            return
        self.name.value, self.kind.value = node.name, node.kind
        _options(self.parent, [n for n in names if n != node.name], nodes[node.parent].name)
        self.motion.value = node.subtype
        self.clicked.visible = node.subtype == "slide"
        for button, label in (
            (self.take, FROM_MESH if work.pointing is None else POINTING),
            (self.clicked, ASK_FACE if work.face is None else SLIDES),
        ):  # fmt: skip
            if button.label != label:
                button.label = label
        self._fill_ways(joint)
        free = joint is None or not np.isfinite([joint.lower, joint.upper]).all()
        self.low.disabled = self.high.disabled = free or bool(work.open.why_fixed)
        if joint is not None and not free:
            self.low.value = round(shown_value(joint, joint.lower), 2)
            self.high.value = round(shown_value(joint, joint.upper), 2)

    def _fill_ways(self, joint: Joint | None) -> None:
        """The other lines; where they are not known yet, they are added when they are."""
        work, part, state = self.work, self.work.part, self.work.state
        if joint is None:
            self.ways.content = ""
            return
        rows = [NOW.format(runs=escape(work.line(joint, joint.child)))]
        known = work.open.knows_ways(part)
        rows += [
            WAY.format(k=k, runs=escape(work.line(c, joint.child)), sure=words.chance(c))
            for k, c in enumerate(work.open.ways(part) if known else (), 1)
        ]
        if len(rows) > 1:
            rows.insert(1, LINES)
        content = "".join(rows)
        if self.ways.content != content:
            self.ways.content = content
        if known:
            return

        def look(session: Session = work.open) -> None:
            session.ways(part)
            with work.lock:
                if work.session is session and work.state is state and work.part == part:
                    self._fill_ways(joint)

        threading.Thread(target=look, daemon=True).start()

    def _pick_by(self) -> None:
        """What a click takes from now on."""
        self.work.picks = PICKS[self.picks.value]
        self.work.brush = self.brush.value / 100
        self.work.scene.paint(self.work.picks == "brush")
        self.brush.visible = self.work.picks == "brush"

    def _with_selection(self, change: Callable[[Hints, KinematicTree, list[int]], Hints]) -> None:
        """An edit of the selected pieces; selected faces are cut off and become pieces."""
        primitives = self.work.open.primitives
        faces = np.flatnonzero(self.work.chosen_faces())
        if not len(faces):
            raise ConfigError("nothing is selected: click on the object first")

        def changed(hints: Hints, tree: KinematicTree) -> Hints:
            cut, pieces = edits.cut_off(hints, primitives, faces)
            return change(cut, tree, pieces)

        self.work.edit(changed)

    def make(self) -> None:
        """The selection becomes a part of its own."""
        work = self.work
        kind = "part" if self.new_kind.value == "other" else self.new_kind.value
        subtype = work.open.best_subtype(work.chosen_faces())
        name = edits.free_name(kind, work.state.tree)
        self._with_selection(lambda h, t, p: edits.make_part(h, t, p, kind, subtype))
        work.choose(name)

    def _add(self) -> None:
        target = self.target.value
        self._with_selection(lambda h, t, p: edits.add_to(h, t, target, p))
        self.work.choose(target)

    def _fix(self) -> None:
        self._with_selection(lambda h, _t, p: edits.do_not_move(h, p))

    def _select(self) -> None:
        self.work.select_nothing()
        self.work.selected = set(self.work.members())
        self.work.choose(self.work.part)

    def _merge(self) -> None:
        kept, other = self._named(), self.target.value
        self.work.edit(lambda h, t: edits.merge(h, t, kept, other))

    def _rename(self, new: str) -> None:
        old = self._named()
        if new.strip() and new != old:
            self.work.edit(lambda h, t: edits.rename(h, t, old, new))
            self.work.choose(edits.link_name(new))

    def _rekind(self, kind: str) -> None:
        name = self._named()
        self.work.edit(lambda h, t: edits.set_kind(h, t, name, kind))

    def _hang(self, parent: str) -> None:
        name = self._named()
        self.work.edit(lambda h, t: edits.set_parent(h, t, name, parent))

    def move(self, subtype: str) -> None:
        """The chosen part moves in another way."""
        name = self._named()
        self.work.edit(lambda h, t: edits.set_subtype(h, t, name, subtype))

    def take_line(self, number: int) -> None:
        """The chosen part moves as the list of lines says, which begins with 1."""
        name = self._named()
        ways = self.work.open.ways(name)
        if number > len(ways):
            raise ConfigError(f"{self.work.called(name)} has {len(ways)} other lines")
        c = ways[number - 1]
        self.work.edit(lambda h, t: edits.set_line(h, t, name, c.subtype, c.axis, c.origin))
        self._open_it()

    def _from_click(self) -> None:
        """The way to slide from the last click on the part: out of that face."""
        work, name = self.work, self._named()
        subtype, normal = self._joint().subtype, work.face_normal()
        work.edit(lambda h, t: edits.set_line(h, t, name, subtype, normal, work.at))
        self._open_it()

    def point(self) -> None:
        """Wait for a line of the mesh, or wait no more."""
        if self.work.pointing is None:
            self._joint()
        self.from_mesh.toggle()

    def _take_line(self, axis: FloatArray, origin: FloatArray) -> None:
        """The chosen part turns about a line of the mesh, or slides along it.

        Args:
            axis, origin: (3,) of the line, at rest; which way it opens is not known yet.
        """
        work, name, joint = self.work, self._named(), self._joint()
        at = joint.origin if joint.subtype == "slide" else origin
        along = work.open.opening(name, joint.subtype, axis, at)
        work.edit(lambda h, t: edits.set_line(h, t, name, joint.subtype, along, at))

    def _lower(self, value: float) -> None:
        joint = self._joint()
        self._limits(joint, words.kept_value(joint, value), joint.upper)

    def _upper(self, value: float) -> None:
        joint = self._joint()
        self._limits(joint, joint.lower, words.kept_value(joint, value))

    def turn_to(self, axis: int) -> None:
        """The chosen part moves along or about an axis; asked again, on the next line along it.

        Args:
            axis: 0 to the front, 1 to the left, 2 upwards, as the object stands.
        """
        work, name, joint = self.work, self._named(), self._joint()
        along = work.state.turn.T[:, axis]
        near = 0.03 * work.state.articulation.mesh.diagonal
        lines = [c for c in work.open.ways(name)
                 if (c.subtype == "slide") == (joint.subtype == "slide")
                 and abs(float(c.axis @ along)) > 0.9]  # fmt: skip
        apart = [np.linalg.norm(np.cross(c.origin - joint.origin, c.axis)) for c in lines]
        here = [k for k, c in enumerate(lines)
                if apart[k] < near and abs(float(c.axis @ joint.axis)) > 0.9]  # fmt: skip
        if lines:
            line = lines[(here[0] + 1) % len(lines) if here else 0]
            axis_of, origin = line.axis, line.origin
        else:
            axis_of = work.open.opening(name, joint.subtype, along, joint.origin)
            origin = joint.origin
        work.edit(lambda h, t: edits.set_line(h, t, name, joint.subtype, axis_of, origin))
        self._open_it()

    def next_motion(self) -> None:
        """The chosen part moves in the next way: hinge, spin, slide."""
        nodes = {n.name: n for n in self.work.state.tree.nodes}
        ways = MOTIONS[:-1]
        now = nodes[self._named()].subtype
        self.move(ways[(ways.index(now) + 1) % len(ways)] if now in ways else ways[0])

    def still(self) -> None:
        """The chosen part does not move any more."""
        self._named()
        self.move("fixed")

    def _limits(self, joint: Joint, low: float, high: float) -> None:
        name = self._named()
        self.work.edit(lambda h, t: edits.set_limits(h, t, name, joint, low, high))
        self._open_it()

    def flip(self) -> None:
        """Positive motion the other way."""
        name, joint = self._named(), self._joint()
        self.work.edit(lambda h, t: edits.flip(h, t, name, joint))
        self._open_it()

    def awake(self, name: str) -> None:
        """A dormant part moves."""
        self.work.choose(name)
        self.work.edit(lambda h, t: edits.wake(h, t, name))
        self._open_it()

    def _reset(self) -> None:
        name = self._named()
        self.work.edit(lambda h, t: edits.as_the_engine_says(h, t, name))

    def _open_it(self) -> None:
        """Move the chosen part to its end, to show what was changed."""
        joint = self.work.joint()
        if joint is not None and np.isfinite([joint.lower, joint.upper]).all():
            far = joint.upper if abs(joint.upper) >= abs(joint.lower) else joint.lower
            self.parts.pose({joint.name: far})

    def _handles(self) -> None:
        if self._gizmo is not None:
            self._gizmo.remove()
            self._gizmo = None
        if not self.hand.value:
            return
        joint = self._joint()
        size = self.work.state.articulation.mesh.diagonal
        self.parts.pose({joint.name: 0.0})
        turn = Rotation.align_vectors([joint.axis], [[0, 0, 1.0]])[0].as_quat()
        scene = self.work.server.scene
        self._gizmo = scene.add_transform_controls(
            "/axis", scale=0.25 * size, depth_test=False, wxyz=np.roll(turn, 1),
            position=joint.origin,
        )  # fmt: skip
        scene.add_arrows(
            "/axis/arrow", np.array([[[0, 0, -0.35 * size], [0, 0, 0.35 * size]]]), (40, 90, 230),
            shaft_radius=0.005 * size, head_radius=0.014 * size, head_length=0.04 * size,
        )  # fmt: skip
        self._choices = snaps(
            self.work.open.mesh, self.work.state.articulation.links[joint.child].faces
        )
        self._gizmo.on_drag_end(self.work.guarded(self._dropped))

    def _dropped(self, _event: Any) -> None:
        """Snap the axis where it was left."""
        if self._gizmo is None or not self.snap.value:
            return
        axis, origin = self._axis()
        size = self.work.state.articulation.mesh.diagonal
        found = snapped(axis, origin, self._choices, size)
        self.snapped.content = f"Snapped to a {found.what}." if found else "Snapped to nothing."
        if found is not None:
            turn = Rotation.align_vectors([found.axis], [[0, 0, 1.0]])[0].as_quat()
            self._gizmo.wxyz = np.roll(turn, 1)
            self._gizmo.position = found.origin

    def _take_axis(self) -> None:
        if self._gizmo is None:
            raise ConfigError("show the handles first")
        name, joint = self._named(), self._joint()
        axis, origin = self._axis()
        self.hand.value = False
        self._handles()
        self.work.edit(lambda h, t: edits.set_line(h, t, name, joint.subtype, axis, origin))
        self._open_it()

    def _axis(self) -> tuple[Any, Any]:
        turn = Rotation.from_quat(np.roll(self._gizmo.wxyz, -1))
        return unit_vector(turn.apply([0, 0, 1.0])), np.asarray(self._gizmo.position)

    def _named(self) -> str:
        if not self.work.part or self.work.part == self.work.state.tree.nodes[0].name:
            raise ConfigError("choose a part first: click on it, or take it from the list")
        return self.work.part

    def _joint(self) -> Joint:
        self._named()
        joint = self.work.joint()
        if joint is None:
            raise ConfigError(f"{self.work.part} does not move; say first how it moves")
        return joint


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"


def _options(handle: Any, options: list[str], value: str) -> None:
    """New options of a dropdown, with one of them chosen."""
    if list(handle.options) != options:
        handle.options = tuple(options)
    wanted = value if value in options else options[0]
    if handle.value != wanted:
        handle.value = wanted
