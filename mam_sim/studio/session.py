"""One object in the studio: what the engine found, what a person said, and the joints of both.

There is no browser in here. Hints are the whole state: each edit makes new ones, from which tree
and joints are computed again in memory. `articulate --hints` gets the same from the saved file.
"""

from __future__ import annotations

import tempfile
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from mam_pipeline import config_file
from mam_pipeline.asset.card import Asset
from mam_pipeline.asset.read import read_asset
from mam_pipeline.digests import file_digest
from mam_pipeline.errors import ConfigError
from mam_pipeline.evidence.spec import stated_groups
from mam_pipeline.formats.door import outside_allowed
from mam_pipeline.hints import Hints, load_hints, save_hints
from mam_pipeline.joints.candidates import rank_hypotheses
from mam_pipeline.joints.estimate import faces_around, same_joint
from mam_pipeline.models.settings import given
from mam_pipeline.parts.hints import along_nodes, apply_hints
from mam_pipeline.run import MakeConfig, Stages, kind_of, make_asset, read_source
from mam_pipeline.stage_store import StageStore, copy_stages
from mam_pipeline.types import (
    Articulation,
    JointCandidate,
    KinematicTree,
    Link,
    PartNode,
    Primitives,
)
from mam_sim.studio.edits import explicit, with_living_parents

Tell = Callable[[str], None]
Change = Callable[[Hints, KinematicTree], Hints]
SHOWN = 6  # ways of moving that a person is offered


@dataclass(frozen=True)
class State:
    """What a person said, and the tree and the joints that come of it."""

    hints: Hints
    tree: KinematicTree
    articulation: Articulation


@dataclass(frozen=True)
class Place:
    """Where an object comes from and where its results go.

    Attributes:
        source: photo, mesh or URDF; None for an asset whose source is not at hand.
        asset: the asset that was opened or is to be written. hints: the hints file.
        config: how the asset is made.
    """

    source: Path | None
    asset: Path
    hints: Path
    config: MakeConfig


def place_of(given: Path, config: MakeConfig, out: Path | None = None) -> Place:
    """Where an input's files are.

    Args:
        given: photo, mesh, URDF or asset folder. config: of the command line; an asset's own
            settings are used for an asset. out: the asset to write.

    Raises:
        InputError: there is no such input.
    """
    if not (given / "asset.json").is_file():
        kind_of(given)
        hints = config.hints or given.with_name(f"{given.stem}-hints.yaml")
        return Place(given, out or Path(f"{given.stem}-asset"), hints, config)
    asset = Asset.load(given)
    kept = asset.folder / "stages" / "config.yaml"
    if kept.is_file():
        config = config_file.fill(MakeConfig(), config_file.read(kept)["pipeline"], kept)
    source = _source_of(asset)
    hints = config.hints or asset.folder.with_name(f"{asset.card.name}-hints.yaml")
    return Place(source, out or asset.folder, hints, config)


def _source_of(asset: Asset) -> Path | None:
    """The file that an asset was made from, beside it or here, unchanged; None if there is none."""
    name = Path(str(asset.card.source.get("path", ""))).name
    for folder in (asset.folder.parent, Path.cwd()):
        file = folder / name
        if name and file.is_file() and file_digest(file) == asset.card.source.get("sha256"):
            return file
    return None


class Session:
    """One open object.

    Attributes:
        place: files. why_fixed: why nothing can be edited; empty where it can.
        primitives: of the faces of `mesh`; one for all where there is no engine's work to show.
    """

    def __init__(self, place: Place, tell: Tell = lambda _text: None) -> None:
        """Open an object: read it, and run the engine where the result is not on disk.

        Raises:
            MamSimError: the input cannot be read.
        """
        self.place, self.why_fixed = place, ""
        self._tell = tell
        self._thinking = threading.Lock()
        self._history: list[State] = []
        self._at = 0
        self._saved: Hints | None = None
        kind = "asset" if place.source is None else kind_of(place.source)
        if place.source is not None and kind in ("mesh", "photo"):
            with given(place.config.models.settings()):
                self._open(place.source, kind)
            return
        if place.source is None:
            self.why_fixed = (
                "This asset can be looked at only: its source was not found beside it. "
                "Open the source itself to put parts right."
            )
            self._look_at(read_asset(Asset.load(place.asset)))
        else:
            from mam_pipeline.formats.urdf.read import read_urdf

            self.why_fixed = "A URDF has its joints already; it can be looked at and checked."
            self._look_at(read_urdf(place.source))

    def _open(self, source: Path, kind: str) -> None:
        """Run the engine, or take from a copy of the asset's stages what is still true."""
        self._copy = tempfile.TemporaryDirectory()  # lives as long as the session
        stages = Path(self._copy.name) / "stages"
        stages.mkdir()
        copy_stages(self.place.asset / "stages", stages)
        self._stages = Stages(self.place.config.engine_used, self._tell, StageStore(stages))
        with outside_allowed(self.place.config.allow_outside):
            read = read_source(source, kind, self.place.config, self._stages)
        hints = read.hints
        if self.place.hints.is_file():
            hints = self._saved = load_hints(self.place.hints)
        self.mesh = read.mesh
        self._cut = self._stages.segment(read.mesh)
        self._spec = read.spec
        groups = stated_groups(read.spec)
        self.primitives = along_nodes(self._cut, read.mesh, hints, groups)
        unhinted = along_nodes(self._cut, read.mesh, None, groups)
        self._cut_by_hints = self.primitives.count != unhinted.count
        self._prior = self._stages.observe(self.mesh, self.primitives, hints)
        tree = self._stages.reason(self.mesh, self.primitives, self._prior, hints, read.spec)
        self._history = [self._solved(self._stages, tree, hints)]

    def _look_at(self, articulation: Articulation) -> None:
        """An articulation as it is: a link is a primitive."""
        self.mesh, self.primitives = articulation.mesh, Primitives(articulation.face_link)
        above = {j.child: j for j in articulation.joints}
        nodes = tuple(
            PartNode(
                link.name, link.kind, (i,), above[i].parent if i in above else -1,
                above[i].subtype if i in above else "fixed",
            )
            for i, link in enumerate(articulation.links)
        )  # fmt: skip
        self._history = [State(Hints(), KinematicTree(nodes), articulation)]

    @property
    def state(self) -> State:
        """What is on the screen."""
        return self._history[self._at]

    @property
    def name(self) -> str:
        """Of the object, for people."""
        return (self.place.source or self.place.asset).stem

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
            raise ConfigError(
                f"{self.place.hints} names nodes that cut primitives in two: edit the file by hand"
            )
        hints = explicit(now.hints, self.primitives, self.mesh)
        hints = with_living_parents(change(hints, now.tree), now.tree)
        if hints == now.hints:
            return now
        made = self._state(hints)
        self._history = [*self._history[: self._at + 1], made]
        self._at += 1
        return made

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
        save_hints(self.state.hints, self.place.hints)
        self._saved = self.state.hints
        return self.place.hints

    def make(self, tell: Tell = lambda _text: None) -> Asset:
        """Save, then write and check the asset exactly as `articulate --hints` does.

        Raises:
            MamSimError: as `make_asset`.
        """
        place = self.place
        if place.source is None:
            raise ConfigError(self.why_fixed)
        config = place.config
        if self.unsaved:
            self.save()
        if not self.why_fixed and place.hints.is_file():
            config = replace(config, hints=place.hints)
        return make_asset(place.source, place.asset, config, tell)

    def best_subtype(self, primitives: Iterable[int]) -> str:
        """How faces would move if they were a part of their own: slide, hinge or spin."""
        chosen = np.isin(self.primitives.labels, sorted(primitives))
        ranked = self._ranked(np.flatnonzero(chosen), np.flatnonzero(~chosen))
        return next((c.subtype for c in ranked if c.subtype != "fixed"), "hinge")

    def ways(self, name: str) -> list[JointCandidate]:
        """Other ways in which a part may move, most probable first, no two of them alike."""
        tree = self.state.tree
        index = next((i for i, n in enumerate(tree.nodes) if n.name == name), 0)
        if self.why_fixed or index == 0:
            return []
        # what moves with the part moves with it: faces around it are those of the tree
        around = faces_around(tree, self.primitives, index)
        near = 0.03 * self.mesh.diagonal
        found: list[JointCandidate] = []
        for c in self._ranked(around.moving, around.static):
            alike = (same_joint(c, o, near) and _way(c) == _way(o) for o in found)
            if c.subtype != "fixed" and not any(alike):
                found.append(c)
            if len(found) == SHOWN:
                break
        return found

    def link_of_face(self, face: int) -> Link:
        """Whose face it is."""
        articulation = self.state.articulation
        return articulation.links[int(articulation.face_link[face])]

    def _ranked(self, part: np.ndarray, rest: np.ndarray) -> list[JointCandidate]:
        """Ranked hypotheses for faces, in the frame of the mesh."""
        if not len(part) or not len(rest):
            return []
        fused = self.primitives.is_fused
        return rank_hypotheses(self.mesh, part, rest, fused=fused, top=60)

    @cached_property
    def _engine_says(self) -> KinematicTree:
        """The engine's own tree, without any word of a person's; edits in `stages/` are none."""
        prior = self._stages.observe(self.mesh, self.primitives)
        return self._fresh.reason(self.mesh, self.primitives, prior, spec=self._spec)

    def prepare(self) -> None:
        """Do now what the first edit would have to wait for."""
        with self._thinking, given(self.place.config.models.settings()):
            _ = self._engine_says

    def _state(self, hints: Hints) -> State:
        """Tree and joints that hints make; estimates that nothing touched are remembered."""
        self.prepare()
        tree = apply_hints(self._engine_says, self.primitives, self.mesh, hints)
        return self._solved(self._fresh, tree, hints)

    def _solved(self, stages: Stages, tree: KinematicTree, hints: Hints | None) -> State:
        """A tree with its joints; none where nothing moves."""
        said = hints or Hints()
        if any(node.subtype != "fixed" for node in tree.nodes):
            return State(said, tree, stages.solve(self.mesh, self.primitives, tree, hints))
        return State(said, tree, Articulation(self.mesh, tuple(
            Link(n.name, n.kind, np.flatnonzero(np.isin(self.primitives.labels, n.primitives)),
                 n.primitives)
            for n in tree.nodes
        ), ()))  # fmt: skip

    @cached_property
    def _fresh(self) -> Stages:
        """Stages without a store: estimates are remembered in memory."""
        return Stages(self.place.config.engine_used)


def _way(c: JointCandidate) -> str:
    return "slide" if c.subtype == "slide" else "turn"
