"""From an input file to an asset folder on disk: stages kept, reused, and open to a person's edits.

Each stage leaves `stages/<n>_<name>/` with its artefact and a stage.json that holds the key it was
made under (stage version, backend, config, seed, digests of what went in) and the artefact's own
digest. A stage with the same key is reused; an artefact that a person has edited is kept, and what
follows it is computed again because its digest is part of the next keys.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal

import numpy as np

from mam_pipeline import backends, config_file, stage_files
from mam_pipeline.asset.card import Asset
from mam_pipeline.engine import Engine, EngineConfig, OnStage, front_yaw, moved
from mam_pipeline.errors import ConfigError, InputError
from mam_pipeline.hints import Hints, load_hints, save_hints
from mam_pipeline.models import settings
from mam_pipeline.models.ledger import one_ledger
from mam_pipeline.models.settings import ModelConfig
from mam_pipeline.parts.hints import along_nodes
from mam_pipeline.photo.options import PhotoConfig
from mam_pipeline.types import Articulation, FloatArray, Mesh

MESH_SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl", ".dae", ".off")
PHOTO_SUFFIXES = (".jpg", ".jpeg", ".png", ".webp", ".bmp", ".tif", ".tiff", ".gif", ".heic")
STAGE_VERSION = 18


@dataclass(frozen=True)
class MakeConfig:
    """Everything that decides what an asset becomes; saved with it as stages/config.yaml."""

    up: Literal["auto", "y", "z"] = "auto"
    """Up axis of the source."""
    height: float | None = None
    """Height of the object, metres."""
    scale: float | None = None
    """Metres per unit of the source; give this or the height."""
    hints: Path | None = None
    """YAML file with what you know about the parts."""
    visuals: Literal["obj", "glb"] = "obj"
    """Format of the visual meshes: OBJ is read by every simulator, GLB is one file per link."""
    interiors: bool = True
    """Give drawers boxes and cut meshes caps where the source has none."""
    reconstructor: str = "auto"
    """Backend that makes a mesh of a photo."""
    retexture: Mapping[str, str] = field(default_factory=dict)
    """New appearance of parts by Hunyuan3D-Paint, their triangles unchanged: PART PICTURE, or PART
    and words, of which an image endpoint first makes a picture."""
    engine: EngineConfig = field(default_factory=EngineConfig)
    photo: PhotoConfig = field(default_factory=PhotoConfig)
    models: ModelConfig = field(default_factory=ModelConfig)

    def check(self) -> None:
        """Raise ConfigError where a length is no positive number, or two contradict each other."""
        for name in ("height", "scale"):
            _positive(name, getattr(self, name))
        for name in ("width", "depth"):
            _positive(name, getattr(self.photo, name))
        if self.height is not None and self.scale is not None:
            raise ConfigError("give --height or --scale, not both")


def _positive(name: str, value: float | None) -> None:
    if value is not None and not (np.isfinite(value) and value > 0):
        raise ConfigError(f"--{name} must be a positive number, got {value}")


@dataclass(frozen=True)
class Source:
    """The input as the engine takes it, whatever kind of file it was."""

    kind: str
    mesh: Mesh
    source_to_asset: FloatArray
    metres_per_unit: float
    metres_per_unit_source: str
    hints: Hints | None = None
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
        ("mesh", MESH_SUFFIXES),
        ("photo", PHOTO_SUFFIXES),
        ("urdf", (".urdf", ".xml")),
    ):
        if suffix in suffixes:
            return kind
    known = ", ".join((*PHOTO_SUFFIXES[:3], *MESH_SUFFIXES, ".urdf"))
    raise InputError(f"{path.name}: cannot read files of type {suffix or 'none'!r}; known: {known}")


def make_asset(
    source: Path, out: Path, config: MakeConfig, on_stage: OnStage | None = None
) -> Asset:
    """Turn a photo, mesh or URDF into an asset folder at `out`, all or nothing.

    Raises:
        MamSimError: one of its subclasses; `out` is then as it was before.
    """
    kind = kind_of(source)
    config.check()
    with settings.given(config.models.settings()), one_ledger():
        return _make_asset(source, out.resolve(), kind, config, on_stage)


def _make_asset(
    source: Path, out: Path, kind: str, config: MakeConfig, on_stage: OnStage | None
) -> Asset:
    from mam_pipeline.asset.interiors import add_interiors
    from mam_pipeline.asset.writer import replace_folder, write_asset
    from mam_pipeline.check.shorten import written_and_checked
    from mam_pipeline.models.retexture import repainted

    refuse_foreign(out)
    given = None if config.hints is None else load_hints(config.hints)
    tell = on_stage or (lambda _name: None)
    work = out.parent / f".{out.name}.partial-{os.getpid()}"
    shutil.rmtree(work, ignore_errors=True)
    stages = work / "stages"
    stages.mkdir(parents=True)
    try:
        if (out / "stages").is_dir():
            shutil.copytree(out / "stages", stages, dirs_exist_ok=True)
        started = time.perf_counter()
        tell("read" if kind != "photo" else "photo")
        read = _read(source, kind, config, stages)
        hints = given if given is not None else read.hints
        seconds = {"read": round(time.perf_counter() - started, 3)}
        if read.articulation is not None:
            articulation, used, told = read.articulation, {"articulation": "urdf"}, []
        else:
            articulation, used, more, told = _engine(read, hints, config, stages, tell)
            seconds |= more
        yaw = front_yaw(articulation) if kind == "mesh" else np.eye(4)
        articulation = moved(articulation, yaw)
        tell("asset")
        if config.retexture:
            articulation, used["retexturer"] = repainted(articulation, config.retexture)
        assumed: list[str] = []
        if config.interiors and read.shell:
            articulation, assumed = add_interiors(articulation)
        write = partial(
            write_asset,
            out=work / "asset",
            name=out.name,
            source={"path": source.name, "sha256": file_digest(source), "kind": kind},
            source_to_asset=yaw @ read.source_to_asset,
            metres_per_unit=read.metres_per_unit,
            metres_per_unit_source=read.metres_per_unit_source,
            backends=used,
            seconds=seconds,
            notes=[n for n in (read.summary, *read.notes, *told, *assumed) if n],
            visuals=config.visuals,
        )
        asset = written_and_checked(articulation, write, kind != "urdf", lambda: tell("check"))
        (stages / "frame.json").write_text(json.dumps({"asset_T_engine": yaw.tolist()}))
        (stages / "config.json").unlink(missing_ok=True)
        config_file.save({"pipeline": config}, stages / "config.yaml")
        stages.rename(work / "asset" / "stages")
        replace_folder(work / "asset", out)
    finally:
        shutil.rmtree(work, ignore_errors=True)
    return Asset(out, asset.card)


def refuse_foreign(out: Path) -> None:
    """Raise ConfigError where `out` exists and is not an asset of ours: it is never overwritten."""
    if out.exists() and not (out / "asset.json").is_file() and not _empty(out):
        raise ConfigError(f"{out} exists and is no asset folder; name another --out")


def file_digest(path: Path) -> str:
    """SHA-256 of a file, hex."""
    with path.open("rb") as handle:
        return hashlib.file_digest(handle, "sha256").hexdigest()


def _empty(folder: Path) -> bool:
    return folder.is_dir() and not any(folder.iterdir())


def _read(source: Path, kind: str, config: MakeConfig, stages: Path) -> Source:
    if kind == "mesh":
        from mam_pipeline.formats.mesh_files import load_mesh

        got = load_mesh(source, up=config.up, height=config.height, scale=config.scale)
        return Source(
            kind, got.mesh, got.source_to_asset, got.metres_per_unit, got.metres_per_unit_source,
            shell=True,
        )  # fmt: skip
    if kind == "urdf":
        from mam_pipeline.formats.urdf.read import read_urdf

        made = read_urdf(source)
        return Source(kind, made.mesh, np.eye(4), 1.0, "urdf", articulation=made)
    return _read_photo(source, config, stages)


def _read_photo(source: Path, config: MakeConfig, stages: Path) -> Source:
    from PIL import Image

    name, reconstructor = backends.load("reconstructor", config.reconstructor)
    options = config.photo.given()
    if config.height is not None:
        options["height"] = config.height
    if config.hints is not None and load_hints(config.hints).photo_front:
        options["hints"] = config.hints  # marked by hand on the photo: build exactly that
    made = reconstructor.reconstruct(source, options)
    folder = stages / "0_photo"
    folder.mkdir(exist_ok=True)
    save_hints(made.hints, folder / "hints.yaml")
    for label, picture in made.pictures.items():
        Image.fromarray(picture).save(folder / f"{label}.png")
    report = {"backend": name, "confidence": dict(made.confidence), "summary": made.summary}
    report |= {"assumed": list(made.assumed), "details": dict(made.details)}
    (folder / "report.json").write_text(json.dumps(report, indent=1, default=str))
    scale_from = "assumed" if "scale" in made.assumed else "user"
    return Source(
        "photo", made.mesh, np.eye(4), 1.0, scale_from, hints=made.hints, summary=made.summary,
        shell=name != "embedded",  # its parts are built hollow
    )  # fmt: skip


def _engine(
    read: Source, hints: Hints | None, config: MakeConfig, stages: Path, tell: OnStage
) -> tuple[Articulation, dict[str, str], dict[str, float], list[str]]:
    """Run or reuse segment, prior, reason and joints.

    Returns:
        The articulation, what was used, the seconds, and notes on what became no part.
    """
    from mam_pipeline.parts.rules.fittings import carried_notes
    from mam_pipeline.parts.tree import left_out_note

    engine = Engine(config.engine, tell)
    keeper = _Keeper(stages)
    mesh = read.mesh
    stage_files.save_geometry(mesh, stages / "0_mesh")
    names = config.engine
    seed, rules = names.seed, repr(names.rules)
    mesh_key = stage_files.mesh_digest(mesh)
    hints_key = stage_files.text_digest(repr(hints))

    primitives, key = keeper.run(
        "1_primitives",
        [mesh_key, names.segmenter, seed, rules],
        lambda: engine.segment(mesh),
        stage_files.PRIMITIVES,
    )
    primitives = along_nodes(primitives, mesh, hints)
    prior, key_prior = keeper.run(
        "2_prior",
        [key, names.prior, settings.identity("prior", names.prior), seed, hints_key],
        lambda: engine.observe(mesh, primitives, hints),
        stage_files.PRIOR,
    )
    if prior is not None and len(prior.masks):
        from mam_pipeline.prior.masks import save_masks

        save_masks(prior, mesh, stages / "2_prior" / "masks.npz")
    tree, key = keeper.run(
        "3_parts",
        [
            *(key, key_prior, names.reasoner, settings.identity("reasoner", names.reasoner)),
            *(seed, hints_key, rules),
        ],
        lambda: engine.reason(mesh, primitives, prior, hints),
        stage_files.TREE,
    )
    codec = stage_files.articulation_codec(mesh, primitives, tree)
    articulation, _ = keeper.run(
        "4_joints",
        [key, names.solver, seed, rules],
        lambda: engine.solve(mesh, primitives, tree),
        codec,
    )
    used = {**keeper.reused, **engine.used}
    return articulation, used, engine.seconds, [left_out_note(tree), *carried_notes(tree)]


class _Keeper:
    """Runs a stage, or takes its artefact from disk when the key allows."""

    def __init__(self, stages: Path) -> None:
        self.stages = stages
        self.reused: dict[str, str] = {}

    def run(
        self,
        name: str,
        inputs: list[Any],
        compute: Callable[[], Any],
        codec: stage_files.Codec,
    ) -> tuple[Any, str]:
        folder = self.stages / name
        artefact, note = folder / codec.filename, folder / "stage.json"
        key = stage_files.text_digest(json.dumps([STAGE_VERSION, name, *inputs], default=str))
        if artefact.is_file() and note.is_file():
            made = json.loads(note.read_text())
            if made.get("key") == key:
                digest = file_digest(artefact)
                self.reused[name] = "edited" if digest != made.get("digest") else "reused"
                return codec.load(artefact), digest
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        value = compute()
        codec.save(value, artefact)
        digest = file_digest(artefact)
        note.write_text(json.dumps({"key": key, "digest": digest, "inputs": inputs}, default=str))
        return value, digest
