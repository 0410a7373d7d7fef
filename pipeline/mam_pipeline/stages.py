"""The engine: its stages one by one, computed or found on disk.

Mesh -> primitives -> prior -> parts -> joints. `articulate_mesh` runs them in memory; `Stages`
keeps what they leave in a `StageStore`, which decides when a result is used again.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

from mam_pipeline import backends, config_file
from mam_pipeline.backends import KinematicPrior, Maker, Reconstruction
from mam_pipeline.digests import array_digest, file_digest, mesh_digest, text_digest
from mam_pipeline.dormant import woken
from mam_pipeline.evidence.spec import NOTHING, Informed, KinematicSpec, stated_groups
from mam_pipeline.hints import Hints
from mam_pipeline.make_config import DEFAULT, EngineConfig
from mam_pipeline.parts.cut import with_cuts, with_cuts_in_tree
from mam_pipeline.parts.hints import along_nodes, apply_hints
from mam_pipeline.rules import Ruled
from mam_pipeline.stage_artefacts import (
    PHOTO,
    PRIMITIVES,
    PRIOR,
    Codec,
    articulation_codec,
    tree_codec,
)
from mam_pipeline.stage_store import StageStore
from mam_pipeline.types import (
    Articulation,
    KinematicTree,
    Mesh,
    PartNode,
    Primitives,
)

T = TypeVar("T")
OnStage = Callable[[str], None]
FOLDERS = {
    "reconstructor": "0_photo", "segmenter": "1_primitives", "prior": "2_prior",
    "reasoner": "3_parts", "solver": "4_joints",
}  # fmt: skip


@dataclass(frozen=True)
class EngineRun:
    """All that one run of the engine produced, stage by stage, with what it used.

    Attributes:
        used: backend by role. seconds: by stage. notes: on what may move and became no part.
    """

    primitives: Primitives
    prior: KinematicPrior | None
    tree: KinematicTree
    articulation: Articulation
    used: dict[str, str] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


def articulate_mesh(
    mesh: Mesh,
    hints: Hints | None = None,
    config: EngineConfig = DEFAULT,
    on_stage: OnStage | None = None,
    spec: KinematicSpec = NOTHING,
) -> EngineRun:
    """Run the engine in memory on a mesh in the asset frame (metres, Z up).

    Args:
        hints: obeyed. spec: what else is known beside geometry; it weighs.

    Raises:
        ConfigError: a hint that cannot be obeyed.
        BackendError: a backend named in the config cannot run.
    """
    return Stages(config, on_stage).articulate(mesh, hints, spec)


class Stages:
    """The stages one by one.

    Attributes:
        makers: who made each stage's result, by role, now or in a former run.
        seconds: what was computed took, by stage.
    """

    def __init__(
        self,
        config: EngineConfig = DEFAULT,
        on_stage: OnStage | None = None,
        store: StageStore | None = None,
    ) -> None:
        """Prepare.

        Args:
            config: backends, seed and rules. on_stage: told the name of a stage as it begins.
            store: where results are kept and found; without it all is computed.
        """
        self.config = config
        self.makers: dict[str, Maker] = {}
        self.seconds: dict[str, float] = {}
        self.tell = on_stage or (lambda _name: None)
        self._store = store
        self._digests: dict[str, str] = {}  # of the results, by role

    def articulate(
        self, mesh: Mesh, hints: Hints | None = None, spec: KinematicSpec = NOTHING
    ) -> EngineRun:
        """From a mesh (metres, Z up) to joints."""
        from mam_pipeline.parts.rules.fittings import carried_notes
        from mam_pipeline.parts.said import said_notes

        primitives = along_nodes(self.segment(mesh), mesh, hints, stated_groups(spec))
        prior = self.observe(mesh, primitives, hints)
        tree = self.reason(mesh, primitives, prior, hints, spec)
        primitives = with_cuts(primitives, hints)
        articulation = self.solve(mesh, primitives, tree, hints)
        used = {role: maker.name for role, maker in self.makers.items()}
        notes = (*carried_notes(tree), *said_notes(tree))
        return EngineRun(primitives, prior, tree, articulation, used, self.seconds, notes)

    def reconstruct(
        self, photo: Path, options: Mapping[str, Any], name: str = "auto"
    ) -> Reconstruction:
        """Photo to mesh."""
        files = {k: v for k, v in options.items() if isinstance(v, Path)}
        plain = {k: v for k, v in options.items() if k not in files}
        return self._stage(
            "reconstructor", name, "photo", PHOTO,
            lambda backend: backend.reconstruct(photo, options),
            lambda: {k: file_digest(v) for k, v in {"photo": photo, **files}.items()},
            {"options": config_file.plain(plain)},
        )  # fmt: skip

    def segment(self, mesh: Mesh) -> Primitives:
        """Faces to primitives (paper 3.2)."""
        return self._stage(
            "segmenter", self.config.segmenter, "segment", PRIMITIVES,
            lambda backend: backend.segment(mesh, seed=self.config.seed),
            lambda: {"mesh": mesh_digest(mesh)},
        )  # fmt: skip

    def observe(
        self, mesh: Mesh, primitives: Primitives, hints: Hints | None = None
    ) -> KinematicPrior | None:
        """Primitives to kinematic priors; None when hints settle every part anyway."""

        def observed(backend: Any) -> KinematicPrior | None:
            found = None if backend is None else backend.observe(
                mesh, primitives, seed=self.config.seed
            )  # fmt: skip
            return None if self.makers["prior"].name == "none" else found

        prior = self._stage(
            "prior", "hints" if _settled(hints) else self.config.prior, "prior", PRIOR, observed,
            lambda: {"mesh": mesh_digest(mesh), "primitives": array_digest(primitives.labels)},
        )  # fmt: skip
        if self._store is not None and prior is not None and len(prior.masks):
            from mam_pipeline.prior.masks import save_masks

            save_masks(prior, mesh, self._store.folder / FOLDERS["prior"] / "masks.npz")
        return prior

    def reason(
        self,
        mesh: Mesh,
        primitives: Primitives,
        prior: KinematicPrior | None,
        hints: Hints | None = None,
        spec: KinematicSpec = NOTHING,
    ) -> KinematicTree:
        """Primitives and priors to parts, tree and joint subtypes.

        Hints have the last word; what else is known is given to a reasoner that listens. Waking
        dormant parts is no part of the stage: it computes nothing again.

        Args:
            primitives: without the hints' cuts; the tree is of those with them.
        """
        cut = with_cuts(primitives, hints)
        said = {} if spec.empty else {"spec": text_digest(repr(spec))}

        def reasoned(backend: Any) -> KinematicTree:
            if backend is None:
                whole = PartNode("body", "body", tuple(range(primitives.count)), -1, "fixed")
                tree = KinematicTree((whole,))
            else:
                if isinstance(backend, Informed) and not spec.empty:
                    backend = backend.with_spec(spec)
                tree = backend.reason(mesh, primitives, prior, seed=self.config.seed)
            tree = with_cuts_in_tree(tree, primitives, cut)
            return tree if hints is None else apply_hints(tree, cut, mesh, hints)

        found = self._stage(
            "reasoner", "hints" if _settled(hints) else self.config.reasoner, "reason",
            tree_codec(cut.count), reasoned,
            lambda: self._inputs(mesh, hints, "segmenter", "prior") | said,
        )  # fmt: skip
        return woken(found, hints.accept if hints else ())

    def solve(
        self, mesh: Mesh, primitives: Primitives, tree: KinematicTree, hints: Hints | None = None
    ) -> Articulation:
        """Tree to joints with axes, origins and limits (paper 3.3, 3.4).

        Args:
            hints: those that the tree was made with.
        """
        names = " ".join(sorted(node.name for node in tree.nodes if node.dormant))
        return self._stage(
            "solver", self.config.solver, "joints", articulation_codec(mesh),
            lambda backend: backend.solve(mesh, primitives, tree, seed=self.config.seed),
            lambda: self._inputs(mesh, hints, "segmenter", "reasoner") | {"dormant": names},
        )  # fmt: skip

    def _inputs(self, mesh: Mesh, hints: Hints | None, *roles: str) -> dict[str, str]:
        """Digests of the mesh, the hints and what the stages of some roles made."""
        said = replace(hints or Hints(), accept=())
        digests = {"mesh": mesh_digest(mesh), "hints": text_digest(repr(said))}
        return digests | {role: self._digests[role] for role in roles}

    def _stage(
        self, role: str, name: str, stage: str, codec: Codec[T], compute: Callable[[Any], T],
        inputs: Callable[[], Mapping[str, str]], more: Mapping[str, Any] | None = None,
    ) -> T:  # fmt: skip
        """Compute the result of one stage, or take it from the store.

        Args:
            role, name: of the backend; "hints" where none is needed: it is None then.
            stage: its name for those who listen. compute: makes the result with the backend.
            inputs: digests of what goes in. more: settings beside seed and rules.
        """
        chosen = name if name == "hints" else backends.resolved(role, name)
        self.makers[role] = Maker(name) if name == "hints" else backends.maker(role, chosen)

        def made() -> T:
            with self.timed(stage):
                backend = None if chosen == "hints" else backends.load(role, chosen)[1]
                if isinstance(backend, Ruled):
                    backend = backend.with_rules(self.config.rules)
                return compute(backend)

        if self._store is None:
            return made()
        how = {"seed": self.config.seed, "rules": asdict(self.config.rules), **(more or {})}
        kept = self._store.stage(FOLDERS[role], self.makers[role], how, inputs(), codec, made)
        self.makers[role], self._digests[role] = kept.maker, kept.digest
        return kept.value

    @contextmanager
    def timed(self, stage: str) -> Iterator[None]:
        """Tell the listener that a stage begins, and note its seconds."""
        self.tell(stage)
        began = time.perf_counter()
        yield
        self.seconds[stage] = round(time.perf_counter() - began, 3)


def _settled(hints: Hints | None) -> bool:
    """Hints that place every part themselves (a photo's) need no reasoning about parts."""
    return hints is not None and bool(hints.parts) and all(p.nodes for p in hints.parts)
