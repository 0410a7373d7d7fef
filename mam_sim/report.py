"""report.html: one page, offline: an asset to turn and open, and pictures of every stage."""

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
from mam_pipeline.asset.card import Asset, CardJoint
from mam_pipeline.asset.read import read_asset
from mam_pipeline.geometry.stand_in import lightened
from mam_pipeline.render.mesh_pictures import DORMANT, palette, render_mesh
from mam_pipeline.render.motion import motion_pictures
from mam_pipeline.types import Articulation, FloatArray
from mam_sim import viewer

SIZE = (420, 360)
CAMERA: dict[str, Any] = {"size": SIZE, "azimuth": -35.0, "elevation": 22.0}
LONGEST = 4000  # characters of evidence that a page shows; asset.json has all of it


@dataclass(frozen=True)
class Figure:
    """A picture as a data URL, and the words below it."""

    source: str
    label: str


def write_report(asset: Asset) -> Path:
    """Draw report.html into the asset folder; returns its path."""
    card, articulation = asset.card, read_asset(asset)
    turning = viewer.page(lightened(articulation), card.name)
    film = asset.folder / "demo.mp4"
    motion = motion_pictures(articulation, [0.0, 0.5, 1.0], **CAMERA)
    pictures = [
        ("Photo and twin", _photo(asset, motion[-1])),
        ("Stages", _stages(asset, articulation)),
        ("Kinematic masks", _masks(asset)),
        ("Motion", [_figure(p, n) for p, n in zip(motion, ("closed", "half open", "open"))]),
    ]
    environment = Environment(
        loader=PackageLoader("mam_sim"), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    page = environment.get_template("report.html.j2").render(
        card=card,
        pictures=[(title, figures) for title, figures in pictures if figures],
        turning=turning,
        film="" if not film.is_file() else _film(film.read_bytes()),
        joints=[_row(j) for j in card.joints],
        dormant=[_row(j) for j in card.likeliest],
        checks=_text(card.checks) if card.checks else "",
        provenance=_text(
            {"backends": card.backends, "seconds": card.seconds, "source": card.source}
        ),
    )
    path = asset.folder / "report.html"
    folders.write_text(path, page)
    return path


def _photo(asset: Asset, opened: NDArray[np.uint8]) -> list[Figure]:
    """The photo, what was read on it, and the asset beside it."""
    folder = asset.folder / "stages" / "0_photo"
    shown = [p for n in ("a_photo", "overlay") for p in folder.glob(f"{n}.*")]
    if not shown:
        return []
    front = folder / "front.png"
    figures = [Figure(_data(p.read_bytes()), p.stem.removeprefix("a_")) for p in shown]
    figures.append(_figure(opened, "opened"))
    return figures + ([Figure(_data(front.read_bytes()), "front")] if front.is_file() else [])


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
    label = "grey: held fast; pale: tied to nothing; one colour: found to move together"
    return [_figure(mask_sheet(load_masks(file)), label)]


def _engine_to_asset(asset: Asset) -> FloatArray:
    """(4, 4) turn about Z between the engine's frame, in which stages are kept, and the asset's."""
    kept = json.loads((asset.folder / "stages" / "frame.json").read_text())
    return np.asarray(kept["asset_T_engine"])


def _row(joint: CardJoint) -> dict[str, Any]:
    """A joint as the table shows it."""
    factor, unit = (1.0, "m") if joint.type == "prismatic" else (180 / np.pi, "°")
    span = "unlimited"
    if joint.lower is not None and joint.upper is not None:
        span = f"{joint.lower * factor:.3g} … {joint.upper * factor:.3g} {unit}"
    return {
        "joint": joint,
        "range": span,
        "axis": ", ".join(f"{v:.2f}" for v in joint.axis),
        "evidence": _text(joint.evidence),
        "curves": _curves(joint.evidence),
    }


def _text(values: dict[str, Any]) -> str:
    """Values as YAML for people, cut where there are very many."""
    import yaml

    from mam_pipeline.stage_artefacts import plain

    text = yaml.safe_dump(plain(values), default_flow_style=None, sort_keys=False, width=100)
    return text if len(text) < LONGEST else text[:LONGEST] + "\n... (asset.json has all of it)"


def _curves(evidence: dict[str, Any]) -> list[dict[str, str]]:
    """A line of 200 x 50 pixels for every list of numbers in the evidence (losses, penetration)."""
    out = []
    for name, values in evidence.items():
        if not isinstance(values, list) or len(values) < 4:
            continue
        if not all(isinstance(v, int | float) for v in values):
            continue
        y = np.asarray(values, dtype=float)
        span = max(float(y.max() - y.min()), 1e-12)
        points = " ".join(
            f"{200 * i / (len(y) - 1):.1f},{50 - 46 * (v - y.min()) / span:.1f}"
            for i, v in enumerate(y)
        )
        out.append({"points": points, "label": f"{name}: {y.min():.3g} to {y.max():.3g}"})
    return out


def _figure(picture: NDArray[np.uint8], label: str) -> Figure:
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, format="PNG")
    return Figure(_data(buffer.getvalue()), label)


def picture_url(picture: NDArray[np.uint8]) -> str:
    """(H, W, 3) picture as a data URL."""
    return _figure(picture, "").source


def _film(film: bytes) -> str:
    return "data:video/mp4;base64," + base64.b64encode(film).decode()


def _data(picture: bytes) -> str:
    kind = "png" if picture[:4] == b"\x89PNG" else "jpeg"
    return f"data:image/{kind};base64," + base64.b64encode(picture).decode()
