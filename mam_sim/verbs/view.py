"""`mam-sim view`: pictures and a film of an asset moving its joints; needs no display driver."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import tyro

from mam_pipeline.types import Articulation, FloatArray, Joint, Mesh


def view(
    asset: Annotated[Path, tyro.conf.Positional],
    /,
    out: Path | None = None,
    size: int = 360,
    frames: int = 24,
    azimuth: float = -35.0,
    elevation: float = 25.0,
    quiet: bool = False,
) -> int:
    """Draw an asset closed and open, and every joint moving, into one folder.

    Args:
        asset: asset folder or URDF.
        out: where closed.png, open.png and moving.gif go; default ASSET/view.
        size: pixels along each side.
        frames: of the film, over one opening and closing.
        azimuth: degrees from the front towards the viewer's right.
        elevation: degrees above the horizon.
        quiet: print nothing but the folder.
    """
    from PIL import Image

    from mam_pipeline.render.mesh_pictures import posed, render_mesh

    articulation, folder = _read(asset)
    target = out or folder / "view"
    target.mkdir(parents=True, exist_ok=True)

    def at(share: float) -> Mesh:
        return posed(articulation, {j.name: _value(j, share) for j in articulation.joints})

    ends = np.stack([at(s).bounds for s in (0.0, 0.5, 1.0)])
    frame = np.stack([ends[:, 0].min(axis=0), ends[:, 1].max(axis=0)])

    def draw(share: float) -> Image.Image:
        mesh = _framed(at(share), frame)
        return Image.fromarray(render_mesh(mesh, (size, size), azimuth, elevation))

    draw(0.0).save(target / "closed.png")
    draw(1.0).save(target / "open.png")
    shares = 0.5 - 0.5 * np.cos(np.linspace(0.0, 2.0 * np.pi, frames, endpoint=False))
    film = [draw(float(s)) for s in shares]
    film[0].save(target / "moving.gif", save_all=True, append_images=film[1:], duration=60, loop=0)
    print(target)
    if not quiet:
        names = ", ".join(j.name for j in articulation.joints)
        print(f"closed.png, open.png, moving.gif; joints: {names}", file=sys.stderr)
        print(f"next: mam-sim check {asset}", file=sys.stderr)
    return 0


def _framed(mesh: Mesh, bounds: FloatArray) -> Mesh:
    """The mesh with two faces of no area at the corners of `bounds`, so that the camera stays."""
    corners = np.repeat(bounds, 3, axis=0)
    count = len(mesh.vertices)
    assert mesh.face_material is not None and mesh.face_group is not None
    return replace(
        mesh,
        vertices=np.concatenate([mesh.vertices, corners]),
        faces=np.concatenate([mesh.faces, count + np.arange(6).reshape(2, 3)]),
        face_material=np.concatenate([mesh.face_material, [0, 0]]),
        face_group=np.concatenate([mesh.face_group, [0, 0]]),
        uv=None if mesh.uv is None else np.concatenate([mesh.uv, np.zeros((6, 2), np.float32)]),
        colors=None
        if mesh.colors is None
        else np.concatenate([mesh.colors, np.zeros((6, 4), np.uint8)]),
    )


def _read(path: Path) -> tuple[Articulation, Path]:
    from mam_pipeline.asset.card import Asset
    from mam_pipeline.formats.urdf_input import read_asset, read_urdf

    if path.suffix.lower() in (".urdf", ".xml"):
        return read_urdf(path), path.parent
    asset = Asset.load(path)
    return read_asset(asset), asset.folder


def _value(joint: Joint, share: float) -> float:
    """Joint value a share of the way from closed to open; free joints make a full turn."""
    if joint.type == "fixed":
        return 0.0
    if not np.isfinite([joint.lower, joint.upper]).all():
        return 2.0 * np.pi * share
    closed, opened = joint.closed, joint.open
    if abs(opened - closed) < 1e-9:
        closed, opened = (joint.lower, joint.upper)
        if abs(joint.lower) > abs(joint.upper):
            closed, opened = opened, closed
    return closed + (opened - closed) * share
