"""A ready URDF, ours or a stranger's, as an Articulation with names, textures and limits kept."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mam_pipeline.asset.card import Asset
from mam_pipeline.errors import InputError
from mam_pipeline.formats.mesh_files import read_file
from mam_pipeline.formats.soup import Piece, join
from mam_pipeline.formats.urdf_mesh import geometry_soup, resolve
from mam_pipeline.ground_truth import carrier, parse_urdf, rest_frames, truth_joint
from mam_pipeline.types import Articulation, FloatArray, Grasp, Joint, Link, Material


def read_urdf(path: str | Path) -> Articulation:
    """Read a URDF with its visuals at rest (q = 0), in the frame of its root link, metres.

    Links joined by fixed joints become one; a link without a surface hands its motion to the body
    behind it. Collision shapes and inertia are made anew by the writer.

    Raises:
        InputError: no URDF, a mesh that is missing or unreadable, no surface, no joint that moves.
    """
    file = Path(path)
    robot = parse_urdf(file)
    frames = rest_frames(robot, file)
    inbound = {j.child: j for j in robot.joints}
    group = {name: carrier(name, inbound) for name in frames}
    pieces: list[Piece] = []
    materials: list[Material] = []
    owner: list[str] = []
    for link in robot.links:
        if link.name not in frames:
            continue
        for piece in _pieces(link, file, frames[link.name], materials):
            pieces.append(piece)
            owner.append(group[link.name])
    if not pieces:
        raise InputError(f"{file} shows no surface: none of its links has a readable visual")
    base = next(name for name in frames if name not in inbound)
    bodies = [base] + [n for n in frames if group[n] == n and n in owner and n != base]
    if len(bodies) < 2:
        raise InputError(f"{file} has no joint that moves a body with a surface")
    index = {name: i for i, name in enumerate(bodies)}
    mesh = join(pieces, materials)
    labels = np.concatenate([np.full(len(p.faces), index[o]) for p, o in zip(pieces, owner)])
    links = tuple(Link(n, "body", np.flatnonzero(labels == i)) for n, i in index.items())
    joints = tuple(
        _bounded(replace(truth_joint(n, index, inbound, group, frames), name=inbound[n].name))
        for n in bodies[1:]
    )
    return Articulation(mesh, links, joints)


def read_asset(asset: Asset) -> Articulation:
    """An asset folder of ours as an Articulation: geometry from the URDF, the rest from the card.

    Face order is by link, not that of the source mesh; what is fixed to a link is part of it.
    """
    bare = read_urdf(asset.urdf_path)
    index = {link.name: i for i, link in enumerate(bare.links)}
    kinds = {part.link: part.kind for part in asset.card.parts}
    fixed = {card.child: card for card in asset.card.joints if card.type == "fixed"}
    joints = []
    for card in asset.card.joints:
        if card.child in fixed:
            continue
        parent = index[carrier(card.parent, fixed)]
        fields = {**vars(card), "parent": parent, "child": index[card.child]}
        fields["lower"] = -np.inf if card.lower is None else card.lower
        fields["upper"] = np.inf if card.upper is None else card.upper
        joints.append(Joint(**fields))
    links = tuple(replace(link, kind=kinds.get(link.name, link.kind)) for link in bare.links)
    grasps = tuple(Grasp(**vars(g)) for g in asset.card.grasps)
    return Articulation(bare.mesh, links, tuple(joints), grasps)


def _pieces(link: Any, file: Path, frame: FloatArray, materials: list[Material]) -> list[Piece]:
    """A link's visual surface (its collision surface if it has no visual) in the root frame."""
    out: list[Piece] = []
    for shapes in (link.visuals, link.collisions):
        for shape in shapes:
            placed = frame if shape.origin is None else frame @ np.asarray(shape.origin)
            out += _shape_pieces(shape, file, placed, materials, f"{link.name}")
        if out:
            break
    return out


def _shape_pieces(
    shape: Any, file: Path, frame: FloatArray, materials: list[Material], name: str
) -> list[Piece]:
    start = len(materials)
    geometry = shape.geometry
    if geometry.mesh is None:
        soup = geometry_soup(geometry, file.parent)
        if soup is None:
            return []
        materials.append(Material(base_color=_color(shape)))
        found: tuple[Piece, ...] = (Piece(soup[0], soup[1], name),)
        scale = np.ones(3)
    else:
        target = resolve(geometry.mesh.filename, file.parent)
        if target is None:
            raise InputError(f"{file} names a mesh that does not exist: {geometry.mesh.filename}")
        content = read_file(target)
        materials.extend(content.materials)
        found = content.pieces
        given = geometry.mesh.scale
        scale = np.ones(3) if given is None else np.broadcast_to(np.asarray(given, float), (3,))
    mirrored = np.prod(scale) < 0
    return [
        replace(
            piece,
            vertices=(piece.vertices * scale) @ frame[:3, :3].T + frame[:3, 3],
            faces=piece.faces[:, ::-1] if mirrored else piece.faces,
            group=name,
            material=piece.material + start,
        )
        for piece in found
    ]


def _color(shape: Any) -> tuple[float, float, float, float]:
    color = getattr(getattr(shape, "material", None), "color", None)
    if color is None or color.rgba is None:
        return (0.7, 0.7, 0.7, 1.0)
    r, g, b, a = (float(v) for v in color.rgba)
    return (r, g, b, a)


def _bounded(joint: Joint) -> Joint:
    """Closed and open ends by the usual reading: the end nearer to the rest pose is closed."""
    if not np.isfinite(joint.upper - joint.lower):
        return replace(joint, closed=0.0, open=np.pi / 2)
    near_lower = abs(joint.lower) <= abs(joint.upper)
    closed, opened = (
        (joint.lower, joint.upper) if near_lower else (joint.upper, joint.lower)
    )
    return replace(joint, closed=closed, open=opened)
