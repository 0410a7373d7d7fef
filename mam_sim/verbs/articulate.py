"""`mam-sim articulate`: a photo, mesh or URDF to an asset folder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import tyro

from mam_pipeline.asset.card import Asset
from mam_pipeline.engine import EngineConfig
from mam_pipeline.errors import ConfigError, MamSimError
from mam_pipeline.models.ledger import Ledger, one_ledger
from mam_pipeline.models.settings import given
from mam_pipeline.run import MakeConfig, kind_of, make_asset
from mam_sim.console import Screen
from mam_sim.verbs.flags import ModelFlags


@dataclass(frozen=True)
class EngineFlags:
    """Backends by role; "auto" takes the best one available and says which."""

    segmenter: str = "auto"
    prior: str = "auto"
    reasoner: str = "auto"
    solver: str = "auto"
    reconstructor: str = "auto"
    seed: int = 0
    retexture: dict[str, str] = field(default_factory=dict)
    """New appearance of parts by Hunyuan3D-Paint, their triangles unchanged: PART PICTURE, or PART
    and words, of which an image endpoint first makes a picture."""


@dataclass(frozen=True)
class ScaleFlags:
    """How the source's coordinates become metres with Z up."""

    up: Literal["auto", "y", "z"] = "auto"
    """The source's up axis."""
    height: float | None = None
    """Height of the object in metres."""
    scale: float | None = None
    """Metres per unit of the source."""


@dataclass(frozen=True)
class PhotoFlags:
    """Help for a photo, each optional."""

    bbox: tuple[int, int, int, int] | None = None
    """x0 y0 x1 y1 of the object, pixels."""
    mask: Path | None = None
    """A mask picture: white where the object is."""
    front: tuple[float, float, float, float, float, float, float, float] | None = None
    """Corners of the front, x y each: top left, top right, bottom right, bottom left."""
    layout: str | None = None
    """What the front holds, row by row: "3 drawers", "2x3 drawers", "2 drawers / 2 doors"."""
    width: float | None = None
    """Width in metres."""
    depth: float | None = None
    """Depth in metres."""
    category: str | None = None
    """What it is: cabinet, fridge, microwave, oven, washing machine ..."""
    accept_low_confidence: bool = False
    """Go on where confidence is low (for batches)."""


def articulate(
    source: Annotated[Path, tyro.conf.Positional],
    /,
    out: Path,
    hints: Path | None = None,
    interiors: bool = True,
    engine: Annotated[EngineFlags, tyro.conf.OmitArgPrefixes] = EngineFlags(),
    size: Annotated[ScaleFlags, tyro.conf.OmitArgPrefixes] = ScaleFlags(),
    photo: Annotated[PhotoFlags, tyro.conf.OmitArgPrefixes] = PhotoFlags(),
    models: Annotated[ModelFlags, tyro.conf.OmitArgPrefixes] = ModelFlags(),  # noqa: B008
    quiet: bool = False,
    json: bool = False,
) -> int:
    """Make an articulated, simulation-ready asset folder from a photo, a mesh or a URDF.

    Args:
        source: the photo (jpg, png ...), mesh (glb, gltf, obj, ply, stl, dae) or URDF.
        out: the asset folder to write.
        hints: YAML file with what you know about the parts.
        interiors: give drawers boxes and cut meshes caps where the source has none.
        engine: backends.
        size: scale and up axis.
        photo: help for a photo.
        models: models outside mam-sim.
        quiet: print nothing but errors.
        json: print the asset card as JSON.
    """
    screen = Screen(quiet or json)
    names = ["read", "segment", "prior", "reason", "joints", "asset", "check", "report"]
    with screen.stages(names) as bar:
        config = make_config(hints, interiors, engine, size, photo)
        with given(models.settings()), one_ledger() as ledger:
            asset = build(source, out, config, bar)
        bar("report")
        from mam_sim.report import write_report

        write_report(asset)
    if json:
        screen.json(asdict(asset.card))
    describe(screen, asset)
    tell_cost(screen, ledger)
    screen.say(f"report: {asset.folder / 'report.html'}")
    screen.say(f"next:   mam-sim make-env {source} --out {out}")
    return 0


def make_config(
    hints: Path | None, interiors: bool, engine: EngineFlags, size: ScaleFlags, photo: PhotoFlags
) -> MakeConfig:
    """The pipeline's config from the flags.

    Raises:
        ConfigError: a size that is no positive number.
    """
    for name, value in (
        *(("--height", size.height), ("--scale", size.scale)),
        *(("--width", photo.width), ("--depth", photo.depth)),
    ):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise ConfigError(f"{name} must be a positive number, got {value}")
    if size.height is not None and size.scale is not None:
        raise ConfigError("give --height or --scale, not both")
    options: dict[str, Any] = {k: v for k, v in vars(photo).items() if v is not None}
    if size.height is not None:
        options["height"] = size.height
    chosen = EngineConfig(
        engine.segmenter, engine.prior, engine.reasoner, engine.solver, engine.seed
    )
    return MakeConfig(
        up=size.up,
        height=size.height,
        scale=size.scale,
        hints=hints,
        engine=chosen,
        reconstructor=engine.reconstructor,
        photo=options,
        interiors=interiors,
        retexture=dict(engine.retexture),
    )


def tell_cost(screen: Screen, ledger: Ledger) -> None:
    """Say what asking a model cost, where one was asked."""
    if ledger.summary():
        screen.say(f"asked:  {ledger.summary()}")


def build(source: Path, out: Path, config: MakeConfig, bar: Any) -> Asset:
    """make_asset, with the pictures of a refused photo written beside `out`."""
    kind_of(source)
    try:
        return make_asset(source, out, config, bar)
    except MamSimError as error:
        pictures: Mapping[str, Any] = getattr(error, "pictures", {})
        if not pictures:
            raise
        from PIL import Image

        written = []
        out.parent.mkdir(parents=True, exist_ok=True)
        for label, picture in pictures.items():
            path = out.parent / f"{out.name}-{label}.png"
            Image.fromarray(np.asarray(picture)).save(path)
            written.append(str(path))
        raise type(error)(f"{error}\n  see {', '.join(written)}") from error


def describe(screen: Screen, asset: Asset) -> None:
    """Print what was found: one line per joint."""
    card = asset.card
    for note in card.notes:
        screen.say(note)
    count = len(card.joints)
    screen.say(f"{card.name}: {count} joint{'s' if count != 1 else ''}")
    for joint in card.joints:
        unit = "m" if joint.type == "prismatic" else "deg"
        factor = 1.0 if unit == "m" else 180 / np.pi
        if joint.lower is None or joint.upper is None:
            span = "without limits"
        else:
            span = f"{joint.lower * factor:.3g} to {joint.upper * factor:.3g} {unit}"
        screen.say(
            f"  {joint.name:<24} {joint.type:<10} {joint.subtype:<6} {span:<22} "
            f"confidence {joint.confidence:.2f}   {joint.review}".rstrip()
        )
    if card.metres_per_unit_source == "assumed":
        low, high = card.bounds if card.bounds else ([0, 0, 0], [0, 0, 0])
        tall = high[2] - low[2]
        screen.say(f"scale ASSUMED: {tall:.2f} m high; fix it with --height")
    screen.say(f"asset:  {asset.folder}")
    verdict = card.checks["executability"]
    if verdict["passed"]:
        screen.say("check:  passes")
    else:
        reasons = ", ".join(verdict["reasons"])
        screen.say(f"check:  FAILS ({reasons}); see: mam-sim check {asset.folder}")
