"""From an input file to an asset folder: the stages in order, computed or found on disk.

A photo is reconstructed, a mesh is read; then the engine's stages run (`stages`), the object is
turned to the front, gets interiors, and is written and checked. `make_asset` is the whole way.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from mam_pipeline import backends, config_file, folders
from mam_pipeline.asset.card import Asset
from mam_pipeline.backends import Maker
from mam_pipeline.claims import ASSET, claim_folder
from mam_pipeline.digests import file_digest
from mam_pipeline.errors import ConfigError, HintNeeded, InputError
from mam_pipeline.evidence.spec import NOTHING, KinematicSpec
from mam_pipeline.formats.door import outside_allowed
from mam_pipeline.formats.placement import Decision
from mam_pipeline.formats.suffixes import PHOTOS, mesh_suffixes
from mam_pipeline.geometry.front import front_of, moved
from mam_pipeline.geometry.stand_in import restored, stand_in
from mam_pipeline.hints import Hints, load_hints
from mam_pipeline.lengths import ask_unusual
from mam_pipeline.make_config import MakeConfig
from mam_pipeline.models import settings
from mam_pipeline.models.ledger import one_ledger
from mam_pipeline.stage_artefacts import (
    save_geometry,
)
from mam_pipeline.stage_store import StageStore, copy_stages
from mam_pipeline.stages import OnStage, Stages
from mam_pipeline.types import (
    Articulation,
    FloatArray,
    Mesh,
)


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
    thing: str = ""  # the kind of object, by the table of kinds
    unconfirmed: str = ""  # what is doubted of a photo, and the line that settles it


def kind_of(path: Path) -> str:
    """photo | mesh | urdf, by suffix.

    Raises:
        InputError: no such file, or a suffix that none of the three has.
    """
    if path.is_dir() and (path / "asset.json").is_file():
        raise InputError(f"{path} is an asset already; try: mam-sim check {path}")
    if not path.is_file():
        if re.match(r"(https?|s3|gs|ftp):/", str(path)):
            address = str(path).replace(":/", "://", 1)
            raise InputError(f"{address} is an address; download the file first and name it here")
        raise InputError(f"no such file: {path}")
    suffix = path.suffix.lower()
    for kind, suffixes in (
        ("mesh", mesh_suffixes()),
        ("photo", PHOTOS),
        ("urdf", (".urdf", ".xml")),
    ):
        if suffix in suffixes:
            return kind
    known = ", ".join((*PHOTOS[:3], *mesh_suffixes(), ".urdf"))
    if suffix in (".zip", ".gz", ".tar", ".7z", ".rar"):
        raise InputError(f"{path.name} is an archive; unpack it and name the model in it")
    raise InputError(f"{path.name}: cannot read files of type {suffix or 'none'!r}; known: {known}")


def make_asset(
    source: Path, out: Path, config: MakeConfig, on_stage: OnStage | None = None
) -> Asset:
    """Turn a photo, mesh or URDF into an asset folder at `out`, all or nothing.

    Raises:
        HintNeeded: what was read on a photo is doubted. A draft of it is at `out` (`draft`), unless
            that holds an asset that is none.
        MamSimError: another of its subclasses; `out` is then as it was before.
    """
    kind = kind_of(source)
    config.check()
    if kind == "urdf" and config.accept:
        raise ConfigError("--accept wakes dormant joints, and a URDF has none")
    claim_folder(out, ASSET)
    named, out = out, out.resolve()
    given = None if config.hints is None else load_hints(config.hints)
    placed_as = standing(config, given)
    with settings.given(config.models.settings()), one_ledger(), folders.work_folder(out) as work:
        (work / "stages").mkdir()
        copy_stages(out / "stages", work / "stages")
        store = StageStore(work / "stages", out / "stages")
        stages = Stages(config.engine, on_stage, store)
        with outside_allowed(config.allow_outside):
            read = read_source(source, kind, placed_as, stages, named)
        asks = bool(read.unconfirmed) and not config.photo.accept_low_confidence
        if asks and (out / "asset.json").is_file() and not Asset.card_of(out).card.unconfirmed:
            raise HintNeeded(read.unconfirmed)
        if read.articulation is None:
            hints = given if given is not None else read.hints
            if config.accept:
                hints = hints or Hints()
                hints = replace(hints, accept=(*hints.accept, *config.accept))
            articulation, notes = _articulated(read, hints, stages, store)
            accepted = hints.accept if hints is not None else ()
        else:
            articulation, notes, accepted = read.articulation, [], ()
            stages.makers["articulation"] = Maker("urdf")
        yaw, placed = turned_to_front(articulation, read, placed_as)
        (store.folder / "frame.json").write_text(json.dumps({"asset_T_engine": yaw.tolist()}))
        stages.tell("asset")
        articulation, assumed = _finished(moved(articulation, yaw), read, config, stages)
        asset = _written(
            articulation, work, out, source, read, config, stages,
            yaw @ read.source_to_asset, placed,
            [read.summary, *read.notes, *store.notes, *notes, *assumed], accepted,
        )  # fmt: skip
    if asks:
        raise HintNeeded(read.unconfirmed, draft=out)
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
    placed: tuple[Decision, ...], notes: list[str], accepted: tuple[str, ...],
) -> Asset:  # fmt: skip
    """Write and check the asset in the work folder, and put it in its place.

    Args:
        accepted: names of dormant parts that move after all.
    """
    from mam_pipeline.asset.read import read_asset
    from mam_pipeline.asset.writer import write_asset
    from mam_pipeline.check.correct import written_and_checked

    write = partial(
        write_asset,
        out=work / "asset",
        name=out.name,
        source={
            "path": folders.as_text(source.name),
            "sha256": file_digest(source),
            "kind": read.kind,
        },
        source_to_asset=source_to_asset,
        metres_per_unit=read.metres_per_unit,
        metres_per_unit_source=read.metres_per_unit_source,
        placement=[asdict(decision) for decision in placed],
        backends={role: asdict(maker) for role, maker in stages.makers.items()},
        seconds=stages.seconds,
        notes=[note for note in notes if note],
        visuals=config.visuals,
        thing=read.thing,
        unconfirmed=read.unconfirmed,
    )
    asset, _ = written_and_checked(
        articulation, write, read.kind != "urdf", lambda: stages.tell("check"), accepted
    )
    (work / "stages" / "config.json").unlink(missing_ok=True)
    config_file.save({"pipeline": config}, work / "stages" / "config.yaml")
    (work / "stages").rename(work / "asset" / "stages")
    read_asset(Asset.load(work / "asset"))  # before anything is replaced: what was made can be read
    folders.put_in_place(work / "asset", out)
    return asset


def read_source(
    source: Path, kind: str, config: MakeConfig, stages: Stages, out: Path | None = None
) -> Source:
    """The source as the engine takes it; a photo is reconstructed first.

    Args:
        source: the file. kind: photo | mesh | urdf, as `kind_of` says.
        config: up axis, scale and the photo's settings. stages: reconstructs a photo.
        out: the folder that the user wants, for the line that settles a doubt.
    """
    if kind == "photo":
        return _read_photo(source, config, stages, out)
    with stages.timed("read"):
        if kind == "urdf":
            from mam_pipeline.formats.urdf.read import read_urdf
            from mam_pipeline.formats.urdf.tree import coupling_note

            made = read_urdf(source)
            note = coupling_note(source, made)
            notes = (note,) if note else ()
            return Source(kind, made.mesh, np.eye(4), 1.0, "urdf", articulation=made, notes=notes)
        from mam_pipeline.evidence.read import kind_named, spec_of, usual_size
        from mam_pipeline.formats.mesh_files import files_kept, load_mesh

        usual = usual_size(source, config.what, config.names)
        with files_kept():  # its nodes come with its surfaces
            got = load_mesh(
                source, up=config.up, height=config.height, scale=config.scale, usual=usual
            )
            given = {"height": config.height, "scale": config.scale}
            named = kind_named(source, config.what, config.names)
            _size_asked(got.mesh, given, config, named, usual)
            spec = spec_of(
                got.mesh, source, got.source_to_asset, config.what, use_names=config.names
            )
        return Source(
            kind, got.mesh, got.source_to_asset, got.metres_per_unit, got.metres_per_unit_source,
            spec=spec, decisions=got.decisions, notes=(*got.notes, *spec.notes), shell=True,
            thing=spec.objects[0].word if spec.objects else "",
        )  # fmt: skip


def _size_asked(
    mesh: Mesh, given: Mapping[str, float | None], config: MakeConfig, name: str,
    usual: Sequence[float] | None,
) -> None:  # fmt: skip
    """Ask about a size that the user gave, where such things are not of it."""
    said = {flag: value for flag, value in given.items() if value is not None}
    if said and not config.yes:
        ask_unusual(float(np.ptp(mesh.vertices, axis=0).max()), said, name, usual)


def _read_photo(source: Path, config: MakeConfig, stages: Stages, out: Path | None) -> Source:
    from mam_pipeline.evidence.read import CERTAINTIES, kind_named, named_size

    options = config.photo.given()
    if named := kind_named(source, config.what, config.names):
        options["things"] = {named: 1.0 if config.what else CERTAINTIES.file}
    if config.height is not None:
        options["height"] = config.height
    agreed: tuple[str, ...] = ()
    seen: tuple[str, ...] = ()
    if config.hints is not None and load_hints(config.hints).photo_front:
        options["hints"] = config.hints  # marked by hand on the photo: build exactly that
    elif config.photo.reader not in ("auto", "embedded"):
        from mam_pipeline.models.photo_reader import read_by_model

        boxes = backends.resolved("reconstructor", config.reconstructor) == "embedded"
        read = read_by_model(source, config.photo.reader, options, boxes_only=boxes)
        options, agreed = read.options, read.notes
        by_model = options.get("by_model", {})
        seen = (read.what, *(str(options[k]) for k in ("category",) if k in by_model))
        stages.makers["reader"] = backends.maker("reasoner", config.photo.reader)
    made = stages.reconstruct(source, options, config.reconstructor)
    given = {name: options.get(name) for name in ("height", "width", "depth")}
    said = (config.photo.category, config.what, options.get("category"))
    thing, usual = named_size(next((str(w) for w in said if w), "").replace("_", " "))
    _size_asked(made.mesh, given, config, thing, usual)
    scale_from = "assumed" if "scale" in made.assumed else "user"
    shell = stages.makers["reconstructor"].name != "embedded"  # whose parts are built hollow
    spec = NOTHING
    if shell:
        from mam_pipeline.evidence.read import spec_of

        typed = named_size((config.photo.category or "").replace("_", " "))[0]
        spec = spec_of(made.mesh, what=config.what or typed or None, use_names=False, seen=seen)
    asked = ""
    if made.doubt is not None and config.hints is None:  # hints are a person's word
        asked = made.doubt.told(source, options, out)
        still = all(part.kind == "body" for part in made.hints.parts)
        if still and not config.photo.accept_low_confidence:
            shown = {k: v for k, v in made.pictures.items() if k != "a_photo"}
            raise HintNeeded(asked, shown)  # a draft of which nothing moves shows nothing
    return Source(
        "photo", made.mesh, np.eye(4), 1.0, scale_from, hints=made.hints, summary=made.summary,
        spec=spec, notes=(*agreed, *_sureness(made.confidence), *spec.notes),
        shell=shell, thing=thing, unconfirmed=asked,
    )  # fmt: skip


def _sureness(words: Mapping[str, str]) -> tuple[str, ...]:
    """How sure a photo's reading is, quantity by quantity, where its reconstructor says so."""
    said = ", ".join(
        f"{'box' if name == 'cuboid' else name} {word}" for name, word in words.items()
    )
    return (f"how sure: {said}",) if said else ()
