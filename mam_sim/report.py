"""report.html: one page, offline, that shows every stage of an asset in pictures and figures."""

from __future__ import annotations

import base64
import html
import io
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.asset.card import Asset, CardJoint
from mam_pipeline.formats.urdf_input import read_asset
from mam_pipeline.types import Articulation, FloatArray, Mesh

Picture = NDArray[np.uint8]
SIZE = (420, 360)


def write_report(asset: Asset) -> Path:
    """Draw report.html into the asset folder; returns its path."""
    sections = [
        _head(asset),
        _photo(asset),
        _stage_pictures(asset),
        _masks(asset),
        _joint_table(asset),
        _motion(asset),
        _checks(asset),
        _provenance(asset),
    ]
    path = asset.folder / "report.html"
    body = "\n".join(s for s in sections if s)
    title = html.escape(asset.card.name)
    path.write_text(_PAGE.replace("{title}", title).replace("{body}", body), encoding="utf-8")
    return path


def _head(asset: Asset) -> str:
    card = asset.card
    notes = "".join(f"<p class=note>{html.escape(n)}</p>" for n in card.notes)
    source = html.escape(str(card.source.get("path", "")))
    kind = html.escape(str(card.source.get("kind", "")))
    count = len(card.joints)
    word = "joint" if count == 1 else "joints"
    return (
        f"<h1>{html.escape(card.name)}</h1><p>{count} {word} from {kind} <code>{source}</code>, "
        f"scale {html.escape(card.metres_per_unit_source)}</p>{notes}"
    )


def _photo(asset: Asset) -> str:
    folder = asset.folder / "stages" / "0_photo"
    shown = [p for n in ("a_photo", "overlay") for p in folder.glob(f"{n}.*")]
    if not shown:
        return ""
    opened = _png(_views(asset, 1.0, views=((-35.0, 20.0),))[0])
    figures = "".join(_figure(_data(p.read_bytes()), p.stem.removeprefix("a_")) for p in shown)
    figures += _figure(opened, "opened")  # beside the photo; what was read on the front comes after
    front = folder / "front.png"
    figures += _figure(_data(front.read_bytes()), "front") if front.is_file() else ""
    return f"<h2>Photo and twin</h2><div class=row>{figures}</div>"


def _stage_pictures(asset: Asset) -> str:
    from mam_pipeline.render.mesh_pictures import render_mesh
    from mam_pipeline.stage_files import PRIMITIVES, load_geometry

    figures = []
    look: dict[str, Any] = {"size": SIZE, "azimuth": -35.0, "elevation": 22.0}
    articulation = read_asset(asset)
    figures.append(_figure(_png(render_mesh(articulation.mesh, **look)), "as read"))
    stages = asset.folder / "stages"
    kept = stages / "1_primitives" / PRIMITIVES.filename
    if kept.is_file():
        labels = PRIMITIVES.load(kept).labels
        count = int(labels.max()) + 1
        colors = palette(count)[labels]
        turned = load_geometry(stages / "0_mesh").transformed(_engine_to_asset(asset))
        figures.append(
            _figure(_png(render_mesh(turned, face_colors=colors, **look)), f"{count} primitives")
        )
    colors = link_colors(len(articulation.links))[articulation.face_link]
    picture = render_mesh(articulation.mesh, face_colors=colors, **look)
    figures.append(_figure(_png(picture), f"{len(articulation.links)} links"))
    return f"<h2>Stages</h2><div class=row>{''.join(figures)}</div>"


def _masks(asset: Asset) -> str:
    """The kinematic masks, whichever prior made them."""
    from mam_pipeline.prior.masks import load_masks, mask_sheet

    file = asset.folder / "stages" / "2_prior" / "masks.npz"
    if not file.is_file():
        return ""
    label = "grey: held fast; pale: tied to nothing; one colour: found to move together"
    picture = _figure(_png(mask_sheet(load_masks(file))), label)
    return f"<h2>Kinematic masks</h2><div class=row>{picture}</div>"


def _engine_to_asset(asset: Asset) -> FloatArray:
    """(4, 4) turn about Z between the engine's frame, in which stages are kept, and the asset's."""
    kept = json.loads((asset.folder / "stages" / "frame.json").read_text())
    return np.asarray(kept["asset_T_engine"])


def _joint_table(asset: Asset) -> str:
    rows = "".join(_joint_row(j) for j in asset.card.joints)
    head = "<tr><th>joint<th>type<th>range<th>axis<th>confidence<th>evidence</tr>"
    return f"<h2>Joints</h2><table>{head}{rows}</table>"


def _joint_row(joint: CardJoint) -> str:
    factor, unit = (1.0, "m") if joint.type == "prismatic" else (180 / np.pi, "°")
    if joint.lower is None or joint.upper is None:
        span = "unlimited"
    else:
        span = f"{joint.lower * factor:.3g} … {joint.upper * factor:.3g} {unit}"
    axis = ", ".join(f"{v:.2f}" for v in joint.axis)
    review = f" <b>{joint.review}</b>" if joint.review else ""
    evidence = html.escape(_short(joint.evidence))
    curve = _curve(joint.evidence)
    return (
        f"<tr><td>{html.escape(joint.name)}<td>{joint.type} ({joint.subtype})<td>{span}"
        f"<td>{axis}<td>{joint.confidence:.2f}{review}"
        f"<td><details><summary>shown</summary><pre>{evidence}</pre>{curve}</details></tr>"
    )


def _short(evidence: dict[str, Any]) -> str:
    import yaml

    from mam_pipeline.stage_files import plain

    text = yaml.safe_dump(plain(evidence), default_flow_style=None, sort_keys=False, width=100)
    return text if len(text) < 4000 else text[:4000] + "\n... (asset.json has all of it)"


def _curve(evidence: dict[str, Any]) -> str:
    """Small line drawings of every list of numbers in the evidence (losses, penetration)."""
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
        label = f"{html.escape(str(name))}: {y.min():.3g} to {y.max():.3g}"
        out.append(
            "<figure><svg width=204 height=54>"
            f"<polyline fill=none stroke='#2a6' points='{points}'/>"
            f"</svg><figcaption>{label}</figcaption></figure>"
        )
    return "".join(out)


def _motion(asset: Asset) -> str:
    figures = []
    for fraction, label in ((0.0, "closed"), (0.5, "half open"), (1.0, "open")):
        for picture in _views(asset, fraction, views=((-35.0, 22.0),)):
            figures.append(_figure(_png(picture), label))
    return f"<h2>Motion</h2><div class=row>{''.join(figures)}</div>"


def _views(asset: Asset, fraction: float, views: Sequence[tuple[float, float]]) -> list[Picture]:
    """Pictures with every joint at `fraction` of its way from closed to open."""
    from mam_pipeline.render.mesh_pictures import render_mesh

    articulation = read_asset(asset)
    q = {}
    for joint in articulation.joints:
        goal = joint.open if np.isfinite(joint.open) else np.pi / 2
        q[joint.name] = joint.closed + fraction * (goal - joint.closed)
    mesh = posed_mesh(articulation, q)
    return [render_mesh(mesh, size=SIZE, azimuth=a, elevation=e) for a, e in views]


def _checks(asset: Asset) -> str:
    checks = asset.card.checks
    if not checks:
        return ""
    return f"<h2>Checks</h2><pre>{html.escape(_short(checks))}</pre>"


def _provenance(asset: Asset) -> str:
    card = asset.card
    text = _short({"backends": card.backends, "seconds": card.seconds, "source": card.source})
    return f"<h2>How it was made</h2><pre>{html.escape(text)}</pre>"


def posed_mesh(articulation: Articulation, q: dict[str, float]) -> Mesh:
    """The articulation's mesh with every link moved to joint values `q`; vertices are unshared
    between links."""
    from dataclasses import replace

    mesh = articulation.mesh
    poses = articulation.link_poses(q)
    corner_link = np.repeat(articulation.face_link, 3)
    corners = mesh.faces.reshape(-1)
    points = np.einsum("nij,nj->ni", poses[corner_link, :3, :3], mesh.vertices[corners])
    points += poses[corner_link, :3, 3]
    return replace(
        mesh,
        vertices=points,
        faces=np.arange(len(corners)).reshape(-1, 3),
        uv=None if mesh.uv is None else mesh.uv[corners],
        colors=None if mesh.colors is None else mesh.colors[corners],
    )


def palette(count: int) -> NDArray[np.uint8]:
    """(count, 3) well-separated RGB colours, the same on every run."""
    import colorsys

    hues = (np.arange(count) * 0.61803398875) % 1.0
    rows = [colorsys.hsv_to_rgb(h, 0.55 + 0.3 * (i % 2), 0.95) for i, h in enumerate(hues)]
    return (np.asarray(rows).reshape(-1, 3) * 255).astype(np.uint8)


def link_colors(count: int) -> NDArray[np.uint8]:
    """Grey for the base, bright colours for the rest."""
    return np.concatenate([np.full((1, 3), 190, dtype=np.uint8), palette(max(count - 1, 1))])


def _png(picture: Picture) -> str:
    from PIL import Image

    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, format="PNG")
    return _data(buffer.getvalue())


def _data(picture: bytes) -> str:
    kind = "png" if picture[:4] == b"\x89PNG" else "jpeg"
    return f"data:image/{kind};base64," + base64.b64encode(picture).decode()


def _figure(source: str, label: str) -> str:
    text = html.escape(label)
    return f'<figure><img src="{source}" alt="{text}"><figcaption>{text}</figcaption></figure>'


_PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>{title}</title><style>
body{font:15px/1.5 system-ui,sans-serif;max-width:1320px;margin:2rem auto;padding:0 1rem;color:#222}
h1{margin-bottom:0}h2{margin-top:2rem;border-bottom:1px solid #ddd}.note{color:#666;margin:.2rem 0}
.row{display:flex;flex-wrap:wrap;gap:12px}figure{margin:0;text-align:center;color:#555}
img{max-width:420px;max-height:420px;border:1px solid #e4e4e4;border-radius:6px}
table{border-collapse:collapse}td,th{padding:4px 12px;text-align:left;border-bottom:1px solid #eee;
vertical-align:top}pre{background:#f6f6f6;padding:8px;overflow:auto;max-width:1200px}
</style>{body}</html>
"""
