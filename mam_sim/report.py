"""report.html: one page, offline: what was found, how sure, and pictures of every joint."""

from __future__ import annotations

import base64
import io
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined
from numpy.typing import NDArray

from mam_pipeline import folders
from mam_pipeline.asset.card import Asset, AssetCard
from mam_pipeline.asset.read import read_asset
from mam_pipeline.geometry.stand_in import lightened
from mam_pipeline.render.mesh_pictures import DORMANT, palette, render_mesh
from mam_pipeline.render.motion import joint_pictures, motion_pictures
from mam_pipeline.types import Articulation, FloatArray
from mam_sim import facts, viewer

CAMERA: dict[str, Any] = {"size": (420, 360), "azimuth": -35.0, "elevation": 22.0}


@dataclass(frozen=True)
class ReportLimits:
    """What keeps a page small.

    Attributes:
        pictured: joints of which there are pictures; the surest ones.
        photo: pixels along the longer side of a photo on the shared page.
        film: bytes of a film; a larger one is left out.
    """

    pictured: int = 12
    photo: int = 640
    film: int = 4_000_000


LIMITS = ReportLimits()


@dataclass(frozen=True)
class Figure:
    """A picture as a data URL, and the words below it."""

    source: str
    label: str


def write_report(asset: Asset) -> Path:
    """Draw report.html into the asset folder; returns its path."""
    card, articulation = asset.card, read_asset(asset)
    stages = [*_photo(asset)[1:], *_stages(asset, articulation), *_masks(asset)]
    environment = Environment(
        loader=PackageLoader("mam_sim"), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    page = environment.get_template("report.html.j2").render(
        card=card,
        size=facts.size_fact(card),
        mass=facts.mass_fact(card),
        whole=_whole(asset, articulation),
        turning=viewer.page(lightened(articulation), card.name),
        film=film_url(asset.folder),
        attempt=facts.attempt_sentence(card),
        joints=facts.joint_facts(card, card.movable),
        pictured=_pictured(card, articulation),
        dormant=facts.joint_facts(card, card.likeliest),
        verdict=facts.verdict(card),
        reasons=facts.check_sentences(card),
        robot=facts.robot_sentences(card),
        timeline=facts.timeline(card),
        stages=stages,
    )
    path = asset.folder / "report.html"
    folders.write_text(path, page)
    return path


def _whole(asset: Asset, articulation: Articulation) -> list[Figure]:
    """The photo, where there was one, and the asset closed and open."""
    closed, opened = motion_pictures(articulation, [0.0, 1.0], **CAMERA)
    return [*_photo(asset)[:1], _figure(closed, "closed"), _figure(opened, "open")]


def _pictured(card: AssetCard, articulation: Articulation) -> dict[str, list[Figure]]:
    """The surest joints closed and open, by name."""
    surest = sorted(card.movable, key=lambda j: -j.confidence)[: LIMITS.pictured]
    known = {j.name: j for j in articulation.joints}
    return {
        j.name: [
            _figure(picture, f"{j.child}, {state}")
            for picture, state in zip(
                joint_pictures(articulation, known[j.name], **CAMERA), ("closed", "open")
            )
        ]
        for j in surest
        if j.name in known
    }


def _photo(asset: Asset) -> list[Figure]:
    """The photo, and what was read on it."""
    folder = asset.folder / "stages" / "0_photo"
    words = {"a_photo": "the photo", "overlay": "what was read on it", "front": "its front"}
    return [
        Figure(_data(path.read_bytes()), label)
        for name, label in words.items()
        for path in folder.glob(f"{name}.*")
        if path.suffix in (".png", ".jpg", ".jpeg")
    ]


def photo_url(folder: Path) -> str:
    """The photo that the asset of a folder was made from, as a data URL; "" where there is none.

    Raises:
        InputError: it lies outside the folder, or is no picture.
    """
    from PIL import Image

    from mam_pipeline.formats.door import Door
    from mam_pipeline.photo.image import read_photo

    file = Door(folder).find("stages/0_photo/a_photo.png", folder / "asset.json")
    if file is None:
        return ""
    picture = Image.fromarray(read_photo(file).small)
    picture.thumbnail((LIMITS.photo, LIMITS.photo))
    buffer = io.BytesIO()
    picture.save(buffer, format="JPEG", quality=85)
    return _data(buffer.getvalue())


def _stages(asset: Asset, articulation: Articulation) -> list[Figure]:
    """The mesh as it was read, its primitives, and its links."""
    from mam_pipeline.stage_artefacts import PRIMITIVES, load_geometry

    figures = [_figure(render_mesh(articulation.mesh, **CAMERA), "as read")]
    stages = asset.folder / "stages"
    kept = stages / "1_primitives" / PRIMITIVES.filename
    if kept.is_file():
        labels = PRIMITIVES.load(kept, kept).labels
        turned = load_geometry(stages / "0_mesh").transformed(_engine_to_asset(asset))
        picture = render_mesh(turned, face_colors=palette(labels + 1), **CAMERA)
        figures.append(_figure(picture, f"{int(labels.max()) + 1} primitives"))
    colors = palette(articulation.face_link)
    for part in articulation.dormant:
        colors[part.link.faces] = DORMANT
    picture = render_mesh(articulation.mesh, face_colors=colors, **CAMERA)
    asleep = len(articulation.dormant)
    label = f"{len(articulation.links)} links" + (
        f"; dark grey: {asleep} dormant" if asleep else ""
    )
    return [*figures, _figure(picture, label)]


def _masks(asset: Asset) -> list[Figure]:
    """The kinematic masks, whichever prior made them."""
    from mam_pipeline.prior.masks import load_masks, mask_sheet

    file = asset.folder / "stages" / "2_prior" / "masks.npz"
    if not file.is_file():
        return []
    label = "Kinematic masks; grey: held fast; pale: tied to nothing; one colour: move together"
    return [_figure(mask_sheet(load_masks(file)), label)]


def _engine_to_asset(asset: Asset) -> FloatArray:
    """(4, 4) turn about Z between the engine's frame, in which stages are kept, and the asset's."""
    kept = json.loads((asset.folder / "stages" / "frame.json").read_text(encoding="utf-8"))
    return np.asarray(kept["asset_T_engine"])


def _figure(picture: NDArray[np.uint8], label: str) -> Figure:
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, format="PNG")
    return Figure(_data(buffer.getvalue()), label)


def picture_url(picture: NDArray[np.uint8]) -> str:
    """(H, W, 3) picture as a data URL."""
    return _figure(picture, "").source


def film_url(folder: Path) -> str:
    """The film of the arm's attempt at an asset, as a data URL; "" where there is none of ours.

    Raises:
        InputError: it lies outside the folder.
    """
    from mam_pipeline.claims import FILM, is_ours
    from mam_pipeline.formats.door import Door

    file = Door(folder).find("demo.mp4", folder / "asset.json")
    if file is None or file.stat().st_size > LIMITS.film or not is_ours(file, FILM):
        return ""
    return "data:video/mp4;base64," + base64.b64encode(file.read_bytes()).decode()


def _data(picture: bytes) -> str:
    kind = "png" if picture[:4] == b"\x89PNG" else "jpeg"
    return f"data:image/{kind};base64," + base64.b64encode(picture).decode()
