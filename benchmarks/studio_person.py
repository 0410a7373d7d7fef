"""A scripted person who knows the truth and puts an object right through the studio's page alone.

It decides what is to be done; `studio_hands.py` does it with clicks. It never calls an edit.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from mam_sim_bench.metrics import nearest_face
from numpy.typing import NDArray
from studio_hands import SIDES, Hands, until

from mam_pipeline.geometry.sampling import face_geometry
from mam_pipeline.types import IntArray, Joint, JointCandidate, PartNode
from mam_sim.studio.lines import mesh_lines
from mam_sim.studio.page import Page
from mam_sim.studio.parts import PLAYING
from mam_sim.studio.picking import area_around, primitives_in_box
from mam_sim.studio.session import Session
from mam_world.ground_truth import GroundTruth

TURNED, APART = np.radians(10), 0.03  # an axis within this is right: radians, diagonals
WORTH = 0.01  # share of a part's surface below which a person does not miss a piece
SHARED = 0.15  # share of a part, and of a piece, that is worth a cut
ALONG = (0.5, 0.25, 0.75)  # shares of a line's segment at which it is pointed at
SHORT = 0.5  # a range that covers less of the true one than this is set


class Person(Hands):
    """Puts one object right in a window, and counts what it takes."""

    def __init__(self, page: Page, window: Any, truth: GroundTruth, session: Session) -> None:
        """Sit down before the page, which shows the object; the truth is in the page's frame."""
        super().__init__(page, window, session)
        self.truth, self.unseen = truth, set[int]()
        self.link = owners(truth, session)
        self.count()

    def count(self) -> None:
        """True link and surface (square metres) of every piece; anew where pieces were cut."""
        labels, links = self.session.primitives.labels, len(self.truth.links)
        votes = np.zeros((self.session.primitives.count, links))
        np.add.at(votes, (labels, self.link), self.face_area + 1e-12)
        self.owner, self.area = votes.argmax(axis=1), votes.sum(axis=1)

    def put_right(self) -> None:
        """Parts first, then how each moves."""
        self.tab("Put right")
        moving = [j for j in self.truth.joints if j.type != "fixed"]
        for joint in moving:
            self.split(joint)
        names = {j.child: self.part(j) for j in moving}
        for joint in moving:
            self.take_out(names[joint.child], joint)
        names = {link: name for link, name in names.items() if self.node(name) is not None}
        for node in list(self.session.state.tree.nodes[1:]):
            moves = node.subtype != "fixed" and not node.dormant
            if moves and node.name not in names.values():
                self.choose(node.name)
                self.shortcut("r")
        for joint in moving:
            name = names.get(joint.child)
            if name is not None:
                self.hang(name, names.get(joint.parent, self.session.state.tree.nodes[0].name))
                self.line(name, joint)
                self.range(name, joint)

    def split(self, joint: Joint) -> None:
        """Cut a part's faces off the pieces that it shares with another."""
        labels, own = self.session.primitives.labels, self.link == joint.child
        whole = self.face_area[own].sum()
        for piece in np.unique(labels[own]):
            inside = labels == piece
            share = self.face_area[inside & own].sum()
            if share < SHARED * whole or share > (1 - SHARED) * self.face_area[inside].sum():
                continue
            areas = self.areas(inside, own)
            left = {*range(areas.max(initial=-1) + 1)}
            views = [self.camera(), *map(self.seen_from, SIDES)]
            if not any(self.places(view, left, areas) for view in views):
                continue
            self.pick("Select", "faces up to an edge")
            self.clear()
            for side in [None, *SIDES]:
                if side is not None:
                    if not self.places(self.seen_from(side), left, areas):
                        continue
                    self.turn(side)
                for area, at in self.places(self.camera(), left, areas).items():
                    if self.click_area(at):
                        left.discard(area)
                if not left:
                    break
            if self.page.work.brushed:
                self.press("Make a part of them")
                self.count()
            self.pick("Select", "whole pieces")

    def areas(self, inside: NDArray[np.bool_], own: NDArray[np.bool_]) -> IntArray:
        """(F,) number of each area of a piece that is mostly of a part, -1 elsewhere."""
        out, free, count = np.full(len(inside), -1), inside & own, 0
        faces = np.flatnonzero(inside)
        with self.looking():
            while free.any():
                area = area_around(self.session.mesh, faces, int(np.argmax(free)))
                free[area] = False
                if self.face_area[area[own[area]]].sum() > 0.5 * self.face_area[area].sum():
                    out[area], count = count, count + 1
        return out

    def part(self, joint: Joint) -> str:
        """One true part, of its own pieces; returns its name, "" where none was seen."""
        wanted = self.pieces(joint)
        inside = [n for n in self.session.state.tree.nodes[1:] if self.mostly(n, wanted)]
        inside.sort(key=lambda n: -self.weight(set(n.primitives) & wanted))
        if not inside:
            if not wanted or not self.select(wanted):
                return ""
            self.press("Make a part of them")
            return str(self.session.state.tree.nodes[-1].name)
        name = inside[0].name
        for other in inside[1:]:
            self.choose(name)
            self.pick("Other part", other.name)
            self.press("Merge with the other part")
        node = self.node(name)
        missing = wanted - set(node.primitives if node else ())
        if self.weight(missing) > WORTH * self.weight(wanted) and self.select(missing):
            self.pick("Other part", name)
            self.press("Add to the other part")
        return name

    def take_out(self, name: str, joint: Joint) -> None:
        """Pieces that are none of a part's."""
        node, wanted = self.node(name), self.pieces(joint)
        extra = set(node.primitives) - wanted if node else set()
        if self.weight(extra) > WORTH * self.weight(wanted) and self.select(extra):
            self.press("They do not move")

    def hang(self, name: str, parent: str) -> None:
        """What a part hangs on."""
        node, nodes = self.node(name), self.session.state.tree.nodes
        if node is not None and nodes[node.parent].name != parent:
            self.choose(name)
            self.pick("Hangs on", parent)

    def line(self, name: str, joint: Joint) -> None:
        """How a part moves: the first line of the list that fits, else by a click on it."""
        if self.right(name, joint):
            return
        self.choose(name)
        node = self.node(name)
        if node is not None and node.dormant:
            self.shortcut("w")
            if self.right(name, joint):
                return
        slides = joint.type == "prismatic"
        found = self.joint(name)
        if found is not None and self.from_list(name, joint):
            return
        if found is None or (found.type == "prismatic") != slides:
            self.pick("Moves", "slide" if slides else "hinge")
            if self.right(name, joint) or self.from_list(name, joint):
                return
        if self.out_of_face(name, joint) if slides else self.about_line(name, joint):
            return
        found = self.joint(name)
        if found is not None and float(found.axis @ joint.axis) < 0 and _bounded(joint):
            self.shortcut("f")

    def from_list(self, name: str, joint: Joint) -> bool:
        """Take the first line of the list that fits; whether one does."""
        for k, c in enumerate(self.session.ways(name)):
            if self.fits(c, joint):
                self.settled()
                self.take_line(k + 1)
                return True
        return False

    def out_of_face(self, name: str, joint: Joint) -> bool:
        """Let a part slide out of a face that is clicked; whether it is right then."""
        shown = self.session.state.articulation
        index = [link.name for link in shown.links].index(name)
        faces, mesh = shown.links[index].faces, self.session.mesh
        cosine = face_geometry(mesh.vertices, mesh.faces[faces])[0] @ joint.axis
        best = int(np.argmax(cosine))
        middle = mesh.vertices[mesh.faces[faces[best]]].mean(axis=0)
        if cosine[best] <= np.cos(TURNED) or not self.point_at(middle):
            return False
        self.choose(name)
        self.press("It slides out of the clicked face")
        return self.right(name, joint)

    def about_line(self, name: str, joint: Joint) -> bool:
        """Let a part turn about a line of the mesh that is pointed at; whether it is right then."""
        shown = self.session.state.articulation
        lines = mesh_lines(shown.mesh, np.array(shown.face_link))
        ways = [JointCandidate("hinge", *line) for line in zip(lines.axis, lines.origin)]
        fitting = [k for k, way in enumerate(ways) if self.fits(way, joint)]
        ends = lines.ends[np.isin(lines.line, fitting)]
        along = np.array(ALONG)[:, None, None]
        places = ((1 - along) * ends[:, 0] + along * ends[:, 1]).reshape(-1, 3)
        found = self.where(lines, fitting, places)
        if found is None:
            return False
        at, clicks = found
        self.press("Take the axis from the mesh", edit=False)
        for _ in range(clicks):
            self.take_at(at)
        self.press("Done", edit=False)
        return self.right(name, joint)

    def range(self, name: str, joint: Joint) -> None:
        """The true range, where the found one covers too little of it."""
        found = self.joint(name)
        if found is None or not _bounded(joint) or not _bounded(found):
            return
        same = float(found.axis @ joint.axis) >= 0
        low, high = (joint.lower, joint.upper) if same else (-joint.upper, -joint.lower)
        low, high = min(low, 0.0), max(high, 0.0)
        if _both(found.lower, found.upper, low, high) >= SHORT * (high - low):
            return
        self.choose(name)
        if _both(-found.upper, -found.lower, low, high) >= SHORT * (high - low):
            self.shortcut("f")
            return
        factor = 100.0 if found.type == "prismatic" else np.degrees(1.0)
        for label, now, value in (("From", found.lower, low), ("To", found.upper, high)):
            if abs(now - value) > 0.02 * (high - low):
                self.type_in(label, f"{factor * value + 0.0:.1f}")

    def right(self, name: str, joint: Joint) -> bool:
        """Whether a part moves as it truly does."""
        found = self.joint(name)
        return found is not None and self.fits(found, joint)

    def fits(self, found: Joint | JointCandidate, joint: Joint) -> bool:
        """Whether a joint or candidate is the true one; its direction is not asked."""
        slides = found.subtype == "slide"
        if slides != (joint.type == "prismatic"):
            return False
        if abs(float(found.axis @ joint.axis)) < np.cos(TURNED):
            return False
        off = np.cross(found.origin - joint.origin, joint.axis)
        return slides or float(np.linalg.norm(off)) < APART * self.session.mesh.diagonal

    def joint(self, name: str) -> Joint | None:
        """The joint of a part that moves."""
        shown = self.session.state.articulation
        moving = (j for j in shown.joints if j.type != "fixed")
        return next((j for j in moving if shown.links[j.child].name == name), None)

    def node(self, name: str) -> PartNode | None:
        """A part of the tree."""
        return next((n for n in self.session.state.tree.nodes if n.name == name), None)

    def pieces(self, joint: Joint) -> set[int]:
        """Pieces that are mostly of a true part."""
        return set(np.flatnonzero(self.owner == joint.child).tolist())

    def mostly(self, node: PartNode, wanted: set[int]) -> bool:
        """Whether more than half of a part's surface is wanted."""
        own = set(node.primitives)
        return self.weight(own & wanted) > 0.5 * self.weight(own)

    def weight(self, pieces: Iterable[int]) -> float:
        """Surface of pieces, square metres."""
        return float(self.area[sorted(pieces)].sum())

    def select(self, pieces: set[int]) -> bool:
        """Select every piece that is seen from some side, opened or closed; whether any was."""
        self.fresh, whole, left = True, self.weight(pieces), set(pieces)
        for opened in (False, True):
            if opened and not self.all_to(100):
                break
            for side in [None, *SIDES]:
                if self.weight(left) <= WORTH * whole:
                    return True
                if side is not None:
                    if not self.places(self.seen_from(side), left):
                        continue
                    self.turn(side)
                self.boxed(left)
                for piece, at in self.places(self.camera(), left).items():
                    if piece in left and self.click(at, piece, more=not self.fresh):
                        left.discard(piece)
        self.unseen |= left
        return not self.fresh

    def boxed(self, left: set[int]) -> None:
        """Drag a box round pieces, where it takes no other and spares clicks."""
        camera = self.camera()
        seen = self.places(camera, left)
        if len(seen) < 3:
            return
        mesh, tracer = self.page.work.tracer()
        labels = self.session.primitives.labels
        own = np.isin(labels, list(seen))
        at = camera.screen(mesh.vertices[mesh.faces[own]].reshape(-1, 3))
        low, high = np.nanmin(at, axis=0) - 0.012, np.nanmax(at, axis=0) + 0.012
        if low.min() < 0.01 or high.max() > 0.99:
            return
        found = set(primitives_in_box(mesh, labels, tracer, camera, low, high))
        if len(found & left) < 3 or not found <= left | (set() if self.fresh else self.shown()):
            return
        if self.fresh:
            self.clear()
        self.acts.drags += 1
        self.acts.steps.append("box")
        before = self.shown()
        self.window.keyboard.down("Shift")
        self.window.mouse.move(*self.pixel(low))
        self.window.mouse.down()
        self.window.mouse.move(*self.pixel((low + high) / 2))
        self.window.mouse.move(*self.pixel(high))
        self.window.mouse.up()
        self.window.keyboard.up("Shift")
        until(lambda: self.shown() != before, 20.0, fail=False)
        left -= self.shown()
        self.fresh = False

    def choose(self, name: str) -> None:
        """Choose a part: by its digit, else by a click in the tree."""
        if self.page.work.part == name or self.node(name) is None:
            return
        number = [row.name for row in self.page.parts.rows].index(name)
        if 0 < number <= PLAYING.digits:
            self.shortcut(str(number), edit=False)
            if until(lambda: self.page.work.part == name, 2.0, fail=False):
                return
        self.acts.clicks += 1
        self.window.locator(f'.part[title^="{name} "]').click()
        until(lambda: self.page.work.part == name, 20.0)

    def make(self, patience: float) -> bool:
        """Make and check the asset; whether it is made, and the check passes."""
        self.tab("Try")
        self.settled()  # what was edited last is drawn: nothing moves under the pointer
        trying = self.page.trying
        self.acts.clicks += 1
        trying.verdict.content = ""
        self.window.get_by_role("button", name="Make and check the asset").click()
        until(lambda: trying.verdict.content.startswith(("**The check", "**It was not")), patience)
        return bool(trying.verdict.content.startswith("**The check passes"))


def owners(truth: GroundTruth, session: Session) -> IntArray:
    """The true link of every face (F,)."""
    middles = session.mesh.vertices[session.mesh.faces].mean(axis=1)
    return truth.face_link[nearest_face(truth.mesh, middles)]


def _both(a: float, b: float, low: float, high: float) -> float:
    """How much of low to high lies in a to b."""
    return max(0.0, min(high, b) - max(low, a))


def _bounded(joint: Joint) -> bool:
    return bool(np.isfinite([joint.lower, joint.upper]).all())
