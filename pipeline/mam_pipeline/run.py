"""From an input file to an asset folder: the stages in order, computed or found on disk.

A photo is reconstructed, a mesh is read; then mesh -> primitives -> prior -> parts -> joints, the
object is turned to the front, gets interiors, and is written and checked. `make_asset` is the whole
way; `articulate_mesh` is the engine alone, in memory. What a stage leaves in `stages/`, and when it
is used again, is the business of `stage_store`.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np

from mam_pipeline import backends, config_file, folders
from mam_pipeline.asset.card import Asset
from mam_pipeline.backends import KinematicPrior, Maker, Reconstruction
from mam_pipeline.digests import array_digest, file_digest, mesh_digest, text_digest
from mam_pipeline.edited import Length, Positive, Seed, check_ranges
from mam_pipeline.errors import ConfigError, InputError, NotPhysicalError
from mam_pipeline.evidence.spec import NOTHING, Informed, KinematicSpec, stated_groups
from mam_pipeline.formats.door import outside_allowed
from mam_pipeline.formats.placement import Decision
from mam_pipeline.formats.suffixes import MESHES, PHOTOS
from mam_pipeline.geometry.front import front_of, moved
from mam_pipeline.geometry.stand_in import restored, stand_in
from mam_pipeline.hints import Hints, load_hints
from mam_pipeline.models import settings
from mam_pipeline.models.ledger import one_ledger
from mam_pipeline.models.settings import ModelConfig
from mam_pipeline.parts.cut import with_cuts, with_cuts_in_tree
from mam_pipeline.parts.hints import along_nodes, apply_hints
from mam_pipeline.photo.options import PhotoConfig
from mam_pipeline.rules import ALL_RULES, Ruled, Rules
from mam_pipeline.stage_artefacts import (
    PHOTO,
    PRIMITIVES,
    PRIOR,
    Codec,
    articulation_codec,
    save_geometry,
    tree_codec,
)
from mam_pipeline.stage_store import StageStore, copy_stages
from mam_pipeline.types import (
    Articulation,
    Axis,
    FloatArray,
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
class EngineConfig:
    """Which backend plays each role ("auto" takes the best one available and says which)."""

    segmenter: str = "auto"
    """Cuts the mesh into primitives: geometric, p3sam."""
    prior: str = "auto"
    """Probes which primitives may move: embedded, sp4d, file, none."""
    reasoner: str = "auto"
    """Finds parts, tree and joint types: embedded, vlm, file."""
    solver: str = "auto"
    """Estimates joints: embedded, or the paper's init, lm, nelder-mead."""
    seed: Seed = 0
    """Seed of everything random."""
    rules: Rules = ALL_RULES
    """Hand rules that are followed."""

    def check(self) -> None:
        """Raise ConfigError where a role has no backend of the name."""
        for role in ("segmenter", "prior", "reasoner", "solver"):
            backends.check_name(role, getattr(self, role))


@dataclass(frozen=True)
class MakeConfig:
    """Everything that decides what an asset becomes; saved with it as stages/config.yaml."""

    up: Literal["auto", Axis] = "auto"
    """Up axis of the source."""
    facing: Literal["auto", Axis] = "auto"
    """Direction of the source's axes in which its front looks."""
    height: Length | None = None
    """Height of the object, metres."""
    scale: Positive | None = None
    """Metres per unit of the source; give this or the height."""
    hints: Path | None = None
    """YAML file with what you know about the parts."""
    allow_outside: bool = False
    """Let a mesh or URDF of your own name files outside its folder (textures, meshes)."""
    what: str | None = None
    """What the object is, in your words: "toaster oven", "cabinet with 2 doors and 3 drawers"."""
    names: bool = True
    """Weigh the names, copies and animations in the file, and the file's own name."""
    visuals: Literal["obj", "glb"] = "obj"
    """Format of the visual meshes: OBJ is read by every simulator, GLB is one file per link."""
    interiors: bool = True
    """Give drawers boxes and cut meshes caps where the source has none."""
    reconstructor: str = "auto"
    """Makes a mesh of a photo: embedded; hunyuan3d, triposr, triposg; fal, tripo, meshy, space."""
    retexture: Mapping[str, str] = field(default_factory=dict)
    """New appearance of parts by Hunyuan3D-Paint, their triangles unchanged: PART PICTURE, or PART
    and words, of which an image endpoint first makes a picture."""
    engine: EngineConfig = field(default_factory=EngineConfig)
    photo: PhotoConfig = field(default_factory=PhotoConfig)
    models: ModelConfig = field(default_factory=ModelConfig)

    @property
    def engine_used(self) -> EngineConfig:
        """The engine's settings, which keep the unlikely where low confidence is accepted."""
        if not self.photo.accept_low_confidence:
            return self.engine
        return replace(self.engine, rules=self.engine.rules.without("abstain"))

    def check(self) -> None:
        """Raise ConfigError for a length that is no positive number or an unknown backend."""
        check_ranges(self, flag=True)
        backends.check_name("reconstructor", self.reconstructor)
        self.engine.check()
        if self.height is not None and self.scale is not None:
            raise ConfigError("give --height or --scale, not both")


@dataclass(frozen=True)
class Source:
    """The input as the engine takes it, whatever kind of file it was."""

    kind: str
    mesh: Mesh
    source_to_asset: FloatArray
    metres_per_unit: float
    metres_per_unit_source: str
    hints: Hints | None = None
    spec: KinematicSpec = NOTHING
    decisions: tuple[Decision, ...] = ()
    articulation: Articulation | None = None
    summary: str = ""
    notes: tuple[str, ...] = ()
    shell: bool = False  # perhaps one closed skin: what is cut out of it needs an inside


def kind_of(path: Path) -> str:
    """photo | mesh | urdf, by suffix.

    Raises:
        InputError: no such file, or a suffix that none of the three has.
    """
    if path.is_dir() and (path / "asset.json").is_file():
        raise InputError(f"{path} is an asset already; try: mam-sim check {path}")
    if not path.is_file():
        raise InputError(f"no such file: {path}")
    suffix = path.suffix.lower()
    for kind, suffixes in (
        ("mesh", MESHES),
        ("photo", PHOTOS),
        ("urdf", (".urdf", ".xml")),
    ):
        if suffix in suffixes:
            return kind
    known = ", ".join((*PHOTOS[:3], *MESHES, ".urdf"))
    raise InputError(f"{path.name}: cannot read files of type {suffix or 'none'!r}; known: {known}")


def make_asset(
    source: Path, out: Path, config: MakeConfig, on_stage: OnStage | None = None
) -> Asset:
    """Turn a photo, mesh or URDF into an asset folder at `out`, all or nothing.

    Raises:
        MamSimError: one of its subclasses; `out` is then as it was before.
    """
    kind, out = kind_of(source), out.resolve()
    config.check()
    refuse_foreign(out)
    given = None if config.hints is None else load_hints(config.hints)
    placed_as = standing(config, given)
    with settings.given(config.models.settings()), one_ledger(), folders.work_folder(out) as work:
        (work / "stages").mkdir()
        copy_stages(out / "stages", work / "stages")
        store = StageStore(work / "stages", out / "stages")
        stages = Stages(config.engine_used, on_stage, store)
        with outside_allowed(config.allow_outside):
            read = read_source(source, kind, placed_as, stages)
        if read.articulation is None:
            hints = given if given is not None else read.hints
            articulation, notes = _articulated(read, hints, stages, store)
        else:
            articulation, notes = read.articulation, []
            stages.makers["articulation"] = Maker("urdf")
        yaw, placed = turned_to_front(articulation, read, placed_as)
        (store.folder / "frame.json").write_text(json.dumps({"asset_T_engine": yaw.tolist()}))
        stages.tell("asset")
        articulation, assumed = _finished(moved(articulation, yaw), read, config, stages)
        asset = _written(
            articulation, work, out, source, read, config, stages,
            yaw @ read.source_to_asset, placed,
            [read.summary, *read.notes, *store.notes, *notes, *assumed],
        )  # fmt: skip
    return Asset(out, asset.card)


def standing(config: MakeConfig, hints: Hints | None) -> MakeConfig:
    """The settings, with the hints' up, front and height where no flag says them."""
    if hints is None:
        return config
    sized = config.height is not None or config.scale is not None
    return replace(
        config,
        up=hints.up if hints.up and config.up == "auto" else config.up,
        facing=hints.facing if hints.facing and config.facing == "auto" else config.facing,
        height=config.height if sized else hints.height,
    )


def turned_to_front(
    articulation: Articulation, read: Source, config: MakeConfig
) -> tuple[FloatArray, tuple[Decision, ...]]:
    """(4, 4) rotation that turns the front towards -X, and all decisions on how it stands."""
    if read.kind != "mesh":
        return np.eye(4), read.decisions
    given = None
    if config.facing != "auto":
        letter, sign = config.facing[-1], -1.0 if config.facing.startswith("-") else 1.0
        file_axis = sign * np.eye(3)["xyz".index(letter)]
        given = read.source_to_asset[:3, :3] @ file_axis / read.metres_per_unit
        if np.linalg.norm(given[:2]) < 0.5:
            raise ConfigError(f"--facing {config.facing} points up or down; name a level axis")
    # +Z of a Y-up file and -Y of a Z-up one are this direction of the engine's frame
    found = front_of(articulation, (0.0, -1.0, 0.0), given)
    towards = np.linalg.inv(found.yaw @ read.source_to_asset)[:3, :3] @ (-1.0, 0.0, 0.0)
    axis = int(np.argmax(np.abs(towards)))
    name = f"{'-' if towards[axis] < 0 else '+'}{'xyz'[axis]} of the file"
    decision = Decision("front", name, found.why, found.runner_up, found.confidence)
    return found.yaw, (*read.decisions, decision)


def _articulated(
    read: Source, hints: Hints | None, stages: Stages, store: StageStore
) -> tuple[Articulation, list[str]]:
    """Parts and joints of a mesh, found on a lighter one where it is heavy; notes for the card."""
    made = stand_in(read.mesh)
    if made is not None:
        save_geometry(made.mesh, store.folder / "0_mesh")
        run = stages.articulate(made.mesh, hints, read.spec)
        whole = restored(run.articulation, read.mesh, made)
        if whole is not None:
            light, heavy = len(made.mesh.faces), len(read.mesh.faces)
            note = f"parts and joints were found on a copy of {light} of the {heavy} faces"
            return whole, [note, *run.notes]
    save_geometry(read.mesh, store.folder / "0_mesh")
    run = stages.articulate(read.mesh, hints, read.spec)
    return run.articulation, list(run.notes)


def _finished(
    articulation: Articulation, read: Source, config: MakeConfig, stages: Stages
) -> tuple[Articulation, list[str]]:
    """Repainted, and with interiors where the source has none; notes on what was assumed."""
    from mam_pipeline.asset.interiors import add_interiors
    from mam_pipeline.models.retexture import repainted

    if config.retexture:
        articulation, name = repainted(articulation, config.retexture)
        stages.makers["retexturer"] = backends.maker("retexturer", name)
    if config.interiors and read.shell:
        return add_interiors(articulation)
    return articulation, []


def _written(
    articulation: Articulation, work: Path, out: Path, source: Path, read: Source,
    config: MakeConfig, stages: Stages, source_to_asset: FloatArray,
    placed: tuple[Decision, ...], notes: list[str],
) -> Asset:  # fmt: skip
    """Write and check the asset in the work folder, and put it in its place."""
    from mam_pipeline.asset.read import read_asset
    from mam_pipeline.asset.writer import write_asset
    from mam_pipeline.check.shorten import written_and_checked

    write = partial(
        write_asset,
        out=work / "asset",
        name=out.name,
        source={"path": source.name, "sha256": file_digest(source), "kind": read.kind},
        source_to_asset=source_to_asset,
        metres_per_unit=read.metres_per_unit,
        metres_per_unit_source=read.metres_per_unit_source,
        placement=[asdict(decision) for decision in placed],
        backends={role: asdict(maker) for role, maker in stages.makers.items()},
        seconds=stages.seconds,
        notes=[note for note in notes if note],
        visuals=config.visuals,
    )
    asset = written_and_checked(
        articulation, write, read.kind != "urdf", lambda: stages.tell("check")
    )
    (work / "stages" / "config.json").unlink(missing_ok=True)
    config_file.save({"pipeline": config}, work / "stages" / "config.yaml")
    (work / "stages").rename(work / "asset" / "stages")
    read_asset(Asset.load(work / "asset"))  # before anything is replaced: what was made can be read
    folders.put_in_place(work / "asset", out)
    return asset


def refuse_foreign(out: Path) -> None:
    """Raise ConfigError where `out` exists and is not an asset of ours: it is never overwritten."""
    if out.exists() and not (out / "asset.json").is_file() and not _empty(out):
        raise ConfigError(f"{out} exists and is no asset folder; name another --out")


def _empty(folder: Path) -> bool:
    return folder.is_dir() and not any(folder.iterdir())


def read_source(source: Path, kind: str, config: MakeConfig, stages: Stages) -> Source:
    """The source as the engine takes it; a photo is reconstructed first.

    Args:
        source: the file. kind: photo | mesh | urdf, as `kind_of` says.
        config: up axis, scale and the photo's settings. stages: reconstructs a photo.
    """
    if kind == "photo":
        return _read_photo(source, config, stages)
    with stages.timed("read"):
        if kind == "urdf":
            from mam_pipeline.formats.urdf.read import read_urdf
            from mam_pipeline.formats.urdf.tree import coupling_note

            made = read_urdf(source)
            note = coupling_note(source, made)
            notes = (note,) if note else ()
            return Source(kind, made.mesh, np.eye(4), 1.0, "urdf", articulation=made, notes=notes)
        from mam_pipeline.evidence.read import spec_of, usual_size
        from mam_pipeline.formats.mesh_files import load_mesh

        usual = usual_size(source, config.what, config.names)
        got = load_mesh(
            source, up=config.up, height=config.height, scale=config.scale, usual=usual
        )  # fmt: skip
        spec = spec_of(
            got.mesh, source, got.source_to_asset, config.what, use_names=config.names
        )  # fmt: skip
        return Source(
            kind, got.mesh, got.source_to_asset, got.metres_per_unit, got.metres_per_unit_source,
            spec=spec, decisions=got.decisions, notes=(*got.notes, *spec.notes), shell=True,
        )  # fmt: skip


def _read_photo(source: Path, config: MakeConfig, stages: Stages) -> Source:
    options = config.photo.given()
    if config.height is not None:
        options["height"] = config.height
    if config.hints is not None and load_hints(config.hints).photo_front:
        options["hints"] = config.hints  # marked by hand on the photo: build exactly that
    elif config.photo.reader != "auto":
        from mam_pipeline.models.photo_reader import read_by_model

        options = read_by_model(source, config.photo.reader, options)
    made = stages.reconstruct(source, options, config.reconstructor)
    scale_from = "assumed" if "scale" in made.assumed else "user"
    shell = stages.makers["reconstructor"].name != "embedded"  # whose parts are built hollow
    spec = NOTHING
    if shell:
        from mam_pipeline.evidence.read import object_of, spec_of
        from mam_pipeline.evidence.spec import Said

        category = str(options.get("category", "")).replace("_", " ")
        known = bool(category) and object_of(category, Said("user", category)) is not None
        word = config.what or (category if known else None)
        spec = spec_of(made.mesh, what=word, use_names=False)
    return Source(
        "photo", made.mesh, np.eye(4), 1.0, scale_from, hints=made.hints, summary=made.summary,
        spec=spec, notes=spec.notes, shell=shell,
    )  # fmt: skip


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
    config: EngineConfig = EngineConfig(),
    on_stage: OnStage | None = None,
    spec: KinematicSpec = NOTHING,
) -> EngineRun:
    """Run the engine in memory on a mesh in the asset frame (metres, Z up).

    Args:
        hints: obeyed. spec: what else is known beside geometry; it weighs.

    Raises:
        NotPhysicalError: nothing movable was found.
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
        config: EngineConfig = EngineConfig(),
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
        from mam_pipeline.parts.tree import left_out_note

        primitives = along_nodes(self.segment(mesh), mesh, hints, stated_groups(spec))
        prior = self.observe(mesh, primitives, hints)
        tree = self.reason(mesh, primitives, prior, hints, spec)
        primitives = with_cuts(primitives, hints)
        articulation = self.solve(mesh, primitives, tree, hints)
        used = {role: maker.name for role, maker in self.makers.items()}
        notes = (left_out_note(tree), *carried_notes(tree), *said_notes(tree))
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

        Hints have the last word; what else is known is given to a reasoner that listens.

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

        return self._stage(
            "reasoner", "hints" if _settled(hints) else self.config.reasoner, "reason",
            tree_codec(cut.count), reasoned,
            lambda: self._inputs(mesh, hints, "segmenter", "prior") | said,
        )  # fmt: skip

    def solve(
        self, mesh: Mesh, primitives: Primitives, tree: KinematicTree, hints: Hints | None = None
    ) -> Articulation:
        """Tree to joints with axes, origins and limits (paper 3.3, 3.4).

        Args:
            hints: those that the tree was made with.
        """
        if all(node.subtype == "fixed" for node in tree.nodes):
            why = str(tree.nodes[0].evidence.get("nothing_movable", "every part is fixed"))
            raise NotPhysicalError(
                f"nothing movable was found in this mesh ({why}); "
                "a hints file can name a part: --hints FILE"
            )
        return self._stage(
            "solver", self.config.solver, "joints", articulation_codec(mesh),
            lambda backend: backend.solve(mesh, primitives, tree, seed=self.config.seed),
            lambda: self._inputs(mesh, hints, "segmenter", "reasoner"),
        )  # fmt: skip

    def _inputs(self, mesh: Mesh, hints: Hints | None, *roles: str) -> dict[str, str]:
        """Digests of the mesh, the hints and what the stages of some roles made."""
        digests = {"mesh": mesh_digest(mesh), "hints": text_digest(repr(hints))}
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
