"""One object in the studio: what the engine found, what a person said, and the joints of both.

There is no browser in here. Hints are the whole state: each edit makes new ones, from which tree
and joints are computed again in memory. `articulate --hints` gets the same from the saved file.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mam_pipeline.asset.card import Asset, AssetCard
from mam_pipeline.asset.read import read_asset
from mam_pipeline.claims import HINTS, claim_file
from mam_pipeline.dormant import ALL, index_of, woken
from mam_pipeline.errors import ConfigError
from mam_pipeline.evidence.spec import stated_groups
from mam_pipeline.folders import Scratch
from mam_pipeline.formats.door import outside_allowed
from mam_pipeline.geometry.stand_in import stand_in
from mam_pipeline.hints import Hints, load_hints, save_hints
from mam_pipeline.joints.candidates import rank_hypotheses
from mam_pipeline.joints.estimate import PartFaces, faces_around, same_joint
from mam_pipeline.models.settings import given
from mam_pipeline.parts.cut import with_cuts, with_cuts_in_tree
from mam_pipeline.parts.hints import along_nodes, apply_hints
from mam_pipeline.run import Source, kind_of, read_source, standing, turned_to_front
from mam_pipeline.stage_store import StageStore, copy_stages
from mam_pipeline.stages import Stages
from mam_pipeline.types import (
    Articulation,
    Axis,
    FloatArray,
    IntArray,
    JointCandidate,
    KinematicTree,
    Link,
    Mesh,
    Primitives,
)
from mam_sim.studio import edits
from mam_sim.studio.edits import explicit, with_living_parents
from mam_sim.studio.place import Place, make, yielding
from mam_sim.studio.state import Ground, State, Words, as_checked, as_it_is, words_of

Tell = Callable[[str], None]
Change = Callable[[Hints, KinematicTree], Hints]
SHOWN = 6  # ways of moving that a person is offered


class Session:
    """One open object.

    Attributes:
        place: files. why_fixed: why nothing can be edited; empty where it can.
        checkpoint: asked between the steps of an edit; what it raises ends it.
    """

    def __init__(self, place: Place, tell: Tell = lambda _text: None) -> None:
        """Open an object: read it, and run the engine where the result is not on disk.

        Raises:
            MamSimError: the input cannot be read.
        """
        self.place, self.why_fixed = place, ""
        self._tell = tell
        self.checkpoint: Callable[[], None] = lambda: None
        self._thinking, self._ranking = threading.Lock(), threading.Lock()
        self._history: list[State] = []
        self._engine_trees: list[tuple[Ground, KinematicTree]] = []
        self._rankings: dict[tuple[int, bytes, bytes], list[JointCandidate]] = {}
        self._at = 0
        self._words: Words = {}
        self._saved: Hints | None = None
        kind = "asset" if place.source is None else kind_of(place.source)
        self.made_from = kind if place.source else Asset.card_of(place.asset).card.made_from
        if place.source is not None and kind in ("mesh", "photo"):
            with given(place.config.models.settings()):
                self._open(place.source, kind)
            return
        if place.source is None:
            self.why_fixed = (
                "This asset can be looked at only: its source was not found beside it. "
                "Open the source itself to put parts right."
            )
            self._history = [as_it_is(read_asset(Asset.load(place.asset)))]
        else:
            from mam_pipeline.formats.urdf.read import read_urdf

            self.why_fixed = "A URDF has its joints already; it can be looked at and checked."
            self._history = [as_it_is(read_urdf(place.source))]

    def _open(self, source: Path, kind: str) -> None:
        """Run the engine, or take from a copy of the asset's stages what is still true."""
        self._copy = Scratch()  # lives as long as the session
        stages = Path(self._copy.name) / "stages"
        stages.mkdir()
        copy_stages(self.place.asset / "stages", stages)
        self._stages = Stages(self.place.config.engine, self._tell, StageStore(stages))
        hints = None
        if self.place.hints.is_file():
            hints = self._saved = load_hints(self.place.hints)
        read = self._read(source, hints)
        hints = read.hints if hints is None else hints
        if self.place.config.accept:
            hints = hints or Hints()
            hints = replace(hints, accept=(*hints.accept, *self.place.config.accept))
        ground = self._ground(read, hints)
        self._cut_by_hints = self._split_by(ground, hints)
        prior = self._stages.observe(ground.mesh, ground.primitives, hints)
        tree = self._stages.reason(ground.mesh, ground.primitives, prior, hints, read.spec)
        if hints is None and "reason" in self._stages.seconds:  # nobody has edited it
            self._engine_trees.append((ground, tree))
        self._history = [self._solved(self._stages, ground, tree, hints)]
        if "joints" not in self._stages.seconds and (self.place.asset / "asset.json").is_file():
            self._checked(self.state, Asset.card_of(self.place.asset).card)

    def _read(self, source: Path, hints: Hints | None) -> Source:
        """The source, standing as the hints say."""
        with outside_allowed(self.place.config.allow_outside):
            config = standing(yielding(self.place.config, hints), hints)
            if hints is not None and hints.photo_front:  # marked by hand on the photo
                config = replace(config, hints=self.place.hints)
            return read_source(source, kind_of(source), config, self._stages)

    def _ground(self, read: Source, hints: Hints | None) -> Ground:
        """What the engine works on: as `make_asset`, on a lighter mesh where it is heavy."""
        light = stand_in(read.mesh)
        mesh = read.mesh if light is None else light.mesh
        cut = self._stages.segment(mesh)
        return Ground(read, mesh, cut, along_nodes(cut, mesh, hints, stated_groups(read.spec)))

    def _split_by(self, ground: Ground, hints: Hints | None) -> bool:
        """Whether the nodes that hints name cut primitives in two."""
        groups = stated_groups(ground.read.spec)
        unhinted = along_nodes(ground.cut, ground.mesh, None, groups)
        return ground.primitives.count != unhinted.count

    @property
    def state(self) -> State:
        """What is on the screen."""
        return self._history[self._at]

    @property
    def mesh(self) -> Mesh:
        """What is shown and worked on, metres, Z up."""
        return self.state.ground.mesh

    @property
    def primitives(self) -> Primitives:
        """Of the faces of `mesh`; a link is one where there is no engine's work to show."""
        return self.state.primitives

    @property
    def faces_in_file(self) -> int:
        """Of the source; `mesh` has fewer where it is heavy."""
        return len(self.state.ground.read.mesh.faces)

    @property
    def name(self) -> str:
        """Of the object, for people."""
        return (self.place.source or self.place.asset).stem

    @property
    def why_asked(self) -> str:
        """What is doubted of a photo, and what settles it; "" where nothing is."""
        return self.state.ground.read.unconfirmed

    @property
    def unsaved(self) -> bool:
        """Whether the hints file lacks what was said."""
        kept = self._history[0].hints if self._saved is None else self._saved
        return self.state.hints != kept

    @property
    def can_undo(self) -> bool:
        """Whether there is an edit to take back."""
        return self._at > 0

    @property
    def can_redo(self) -> bool:
        """Whether an edit was taken back."""
        return self._at + 1 < len(self._history)

    def edit(self, change: Change) -> State:
        """Apply a change of the hints; a change that cannot be changes nothing.

        Raises:
            ConfigError: what was asked for cannot be, in one sentence.
        """
        if self.why_fixed:
            raise ConfigError(self.why_fixed)
        now = self.state
        if self._cut_by_hints:
            raise ConfigError(self._cannot_cut)
        hints = explicit(now.hints, self.primitives, self.mesh)
        hints = with_living_parents(change(hints, now.tree), now.tree)
        return now if hints == now.hints else self._add(self._state(now.ground, hints))

    def stand(
        self, up: ArrayLike | None = None, front: ArrayLike | None = None, size: float = 1.0
    ) -> State:
        """Say how the object stands; what was said of its parts stays with them.

        Args:
            up, front: (3,) direction in the engine's frame that is to point up, or to the front.
            size: factor on all lengths.

        Raises:
            ConfigError: a photo, whose front and up are known, or a direction that cannot be.
        """
        now, source = self.state, self.place.source
        if self.why_fixed or source is None:
            raise ConfigError(self.why_fixed)
        read = now.ground.read
        if self._cut_by_hints:
            raise ConfigError(self._cannot_cut)
        if read.kind == "photo" and (up is not None or front is not None):
            raise ConfigError("a photo's object stands as it is seen on the photo")
        hints = explicit(now.hints, self.primitives, self.mesh)
        if front is not None:
            flat = np.asarray(front, dtype=np.float64) * (1, 1, 0)
            if np.linalg.norm(flat) < 0.5:
                raise ConfigError("this face looks up or down: the front is one of the sides")
            hints = replace(hints, facing=_file_axis(read, flat))
            turn = self._turn(now.articulation, read, hints)
            return self._add(replace(now, hints=hints, turn=turn))
        hints = replace(hints, height=float(np.ptp(read.mesh.vertices[:, 2])) * size)
        if up is not None:
            hints = replace(hints, up=_file_axis(read, up), facing=None)
            axis = int(np.argmax(np.abs(np.asarray(up))))
            hints = replace(hints, height=float(np.ptp(read.mesh.vertices[:, axis])))
        with given(self.place.config.models.settings()):
            ground = self._ground(self._read(source, hints), None)
        change = ground.read.source_to_asset @ np.linalg.inv(read.source_to_asset)
        if read.kind == "photo":  # its frame begins at the floor
            change = np.diag([size, size, size, 1.0])
        same = _renumbered(now.primitives, with_cuts(ground.primitives, hints))
        return self._add(self._state(ground, edits.moved(hints, change, same)))

    def _add(self, made: State) -> State:
        """A new state after the one that is shown."""
        self.checkpoint()
        self._history = [*self._history[: self._at + 1], made]
        self._at += 1
        return made

    @property
    def _cannot_cut(self) -> str:
        return f"{self.place.hints} names nodes that cut primitives in two: edit the file by hand"

    def undo(self) -> State:
        """Take the last edit back."""
        self._at = max(self._at - 1, 0)
        return self.state

    def redo(self) -> State:
        """Do again what was taken back."""
        self._at = min(self._at + 1, len(self._history) - 1)
        return self.state

    def save(self) -> Path:
        """Write the hints file; returns its path."""
        if self.why_fixed:
            raise ConfigError(self.why_fixed)
        try:
            load_hints(self.place.hints)  # an earlier one, which this takes the place of
        except ConfigError:
            claim_file(self.place.hints, HINTS, flag="--hints")
        save_hints(self.state.hints, self.place.hints)
        self._saved = self.state.hints
        return self.place.hints

    def make(self, tell: Tell = lambda _text: None) -> Asset:
        """Save, then write and check the asset exactly as `articulate --hints` does.

        Raises:
            MamSimError: as `make_asset`.
        """
        if self.unsaved:
            self.save()
        of = self.state
        asset = make(self.place, tell)
        self._checked(of, asset.card)
        return asset

    def _checked(self, of: State, card: AssetCard) -> None:
        """Take the check's word on the joints of the state that an asset was made of."""
        self._words = words_of(of.found, card)
        self._history = [as_checked(state, self._words) for state in self._history]

    def best_subtype(self, chosen: NDArray[np.bool_]) -> str:
        """How faces (F,) would move if they were a part of their own: slide, hinge or spin."""
        ranked = self._ranked(np.flatnonzero(chosen), np.flatnonzero(~chosen))
        return next((c.subtype for c in ranked if c.subtype != "fixed"), "hinge")

    def knows_ways(self, name: str) -> bool:
        """Whether `ways` answers at once."""
        around = self._around(name)
        return around is None or self._ranking_key(around.moving, around.static) in self._rankings

    def _around(self, name: str) -> PartFaces | None:
        """What moves with a part, by the tree, and what stands still; None for the base."""
        tree = self.state.tree
        index = next((i for i, n in enumerate(tree.nodes) if n.name == name), 0)
        fixed = self.why_fixed or index == 0
        return None if fixed else faces_around(tree, self.primitives, index)

    def ways(self, name: str) -> list[JointCandidate]:
        """Other ways in which a part may move, most probable first, no two of them alike."""
        around = self._around(name)
        if around is None:
            return []
        near = 0.03 * self.mesh.diagonal
        found: list[JointCandidate] = []
        for c in self._ranked(around.moving, around.static):
            alike = (same_joint(c, o, near) and _way(c) == _way(o) for o in found)
            if c.subtype != "fixed" and not any(alike):
                found.append(c)
            if len(found) == SHOWN:
                break
        return found

    def opening(self, name: str, subtype: str, axis: ArrayLike, origin: ArrayLike) -> FloatArray:
        """A line's axis (3,), turned so that positive motion opens, as the engine guesses.

        Args:
            axis, origin: of the line, in the engine's frame.
        """
        tree, line, at = self.state.tree, np.asarray(axis), np.asarray(origin)
        around = faces_around(tree, self.primitives, [n.name for n in tree.nodes].index(name))
        alike = [
            c for c in self._ranked(around.moving, around.static)
            if (c.subtype == "slide") == (subtype == "slide") and c.subtype != "fixed"
            and abs(float(c.axis @ line)) > np.cos(np.radians(30))
        ]  # fmt: skip
        if not alike:
            return line
        near = min(alike, key=lambda c: float(np.linalg.norm(np.cross(at - c.origin, line))))
        if subtype == "slide":
            near = alike[0]
        return line * (np.sign(near.axis @ line) or 1.0)

    def link_of_face(self, face: int) -> Link:
        """Whose face it is: a link's, or a dormant part's."""
        articulation = self.state.articulation
        for part in articulation.dormant:
            if face in part.link.faces:
                return part.link
        return articulation.links[int(articulation.face_link[face])]

    def faces_of(self, name: str) -> IntArray:
        """Faces of a part, dormant or not; none where there is no such part."""
        articulation = self.state.articulation
        links = [*articulation.links, *(part.link for part in articulation.dormant)]
        none = np.zeros(0, dtype=np.int64)
        return next((link.faces for link in links if link.name == name), none)

    def _ranked(self, part: np.ndarray, rest: np.ndarray) -> list[JointCandidate]:
        """Ranked hypotheses for faces, in the frame of the mesh; remembered."""
        if not len(part) or not len(rest):
            return []
        key = self._ranking_key(part, rest)
        with self._ranking:
            if key not in self._rankings:
                fused = self.primitives.is_fused
                self._rankings[key] = rank_hypotheses(self.mesh, part, rest, fused=fused, top=60)
            return self._rankings[key]

    def _ranking_key(self, part: np.ndarray, rest: np.ndarray) -> tuple[int, bytes, bytes]:
        return id(self.state.ground), part.tobytes(), rest.tobytes()

    def _engine_says(self, ground: Ground) -> KinematicTree:
        """The engine's own tree, without any word of a person's; edits in `stages/` are none."""
        known = next((tree for g, tree in self._engine_trees if g is ground), None)
        if known is None:
            prior = self._stages.observe(ground.mesh, ground.primitives)
            spec = ground.read.spec
            known = self._fresh.reason(ground.mesh, ground.primitives, prior, spec=spec)
            self._engine_trees.append((ground, known))
        return known

    def prepare(self) -> None:
        """Do now what the first edit would have to wait for."""
        if not self.why_fixed:
            with self._thinking, given(self.place.config.models.settings()):
                self._engine_says(self.state.ground)

    def _state(self, ground: Ground, hints: Hints) -> State:
        """Tree and joints that hints make; estimates that nothing touched are remembered."""
        with self._thinking, given(self.place.config.models.settings()):
            tree = self._engine_says(ground)
        cut = with_cuts(ground.primitives, hints)
        tree = with_cuts_in_tree(tree, ground.primitives, cut)
        tree = apply_hints(tree, cut, ground.mesh, hints)
        there = (a for a in hints.accept if a == ALL or index_of(tree, a) is not None)
        hints = replace(hints, accept=tuple(there))  # others were made into something else
        tree = woken(tree, hints.accept)
        return self._solved(self._fresh, ground, tree, hints)

    def _solved(
        self, stages: Stages, ground: Ground, tree: KinematicTree, hints: Hints | None
    ) -> State:
        """A tree with its joints."""
        said, primitives = hints or Hints(), with_cuts(ground.primitives, hints)
        made = stages.solve(ground.mesh, primitives, tree, hints)
        turn = self._turn(made, ground.read, hints)
        state = State(said, tree, made, tree, made, ground, primitives, turn)
        return as_checked(state, self._words)

    def _turn(self, made: Articulation, read: Source, hints: Hints | None) -> FloatArray:
        """(3, 3) rotation that brings the front to -X."""
        config = standing(yielding(self.place.config, hints), hints)
        return turned_to_front(made, read, config)[0][:3, :3]

    @cached_property
    def _fresh(self) -> Stages:
        """Stages without a store: estimates are remembered in memory."""
        return Stages(self.place.config.engine, lambda _stage: self.checkpoint())


def _file_axis(read: Source, direction: ArrayLike) -> Axis:
    """The axis of the file that is nearest to a direction (3,) in the engine's frame."""
    own = np.linalg.inv(read.source_to_asset[:3, :3]) @ np.asarray(direction, dtype=np.float64)
    axis = int(np.argmax(np.abs(own)))
    names: tuple[Axis, ...] = ("-x", "-y", "-z") if own[axis] < 0 else ("x", "y", "z")
    return names[axis]


def _renumbered(old: Primitives, new: Primitives) -> dict[int, int]:
    """For every primitive of the old cut, the one of the new that has most of its faces."""
    if len(old.labels) != len(new.labels):
        raise ConfigError(
            "its pieces have changed: say first how it stands, then which parts it has"
        )
    pairs, count = np.unique(
        np.stack([old.labels, new.labels], axis=1), axis=0, return_counts=True
    )  # fmt: skip
    return {int(pairs[k, 0]): int(pairs[k, 1]) for k in np.argsort(count, kind="stable")}


def _way(c: JointCandidate) -> str:
    return "slide" if c.subtype == "slide" else "turn"
