"""A ready URDF, ours or a stranger's, as an Articulation with names, textures and limits kept."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mam_pipeline.errors import InputError
from mam_pipeline.formats.mesh_files import check_surface, read_file
from mam_pipeline.formats.soup import Budget, FileContent, Piece, join
from mam_pipeline.formats.urdf.geometry import existing, mesh_scale, origin_of, shape_triangles
from mam_pipeline.formats.urdf.tree import UrdfTree
from mam_pipeline.types import Articulation, FloatArray, Joint, Link, Material


def read_urdf(path: str | Path) -> Articulation:
    """Read a URDF with its visuals at rest (q = 0), in the frame of its root link, metres.

    Links joined by fixed joints become one; a link without a surface hands its motion to the body
    behind it. Collision shapes and inertia are made anew by the writer.

    Raises:
        InputError: no URDF, a mesh that is missing or unreadable, no surface, no joint that moves.
    """
    found = read_bodies(path)
    if not found.joints:
        raise InputError(f"{path} has no joint that moves a body with a surface")
    return found


def read_bodies(path: str | Path) -> Articulation:
    """As `read_urdf`, also where no joint moves. Groups of the mesh's faces are the URDF's links.

    Raises:
        InputError: no URDF, a mesh that is missing or unreadable, no surface.
    """
    tree = UrdfTree.read(path)
    pieces: list[Piece] = []
    materials: list[Material] = []
    owner: list[str] = []
    files: dict[Path, FileContent] = {}
    budget = Budget(tree.path)
    for link in tree.robot.links:
        if link.name not in tree.frames:
            continue
        for piece in _pieces(link, tree.path, tree.frames[link.name], materials, files):
            budget.triangles(len(piece.vertices), len(piece.faces))
            pieces.append(piece)
            owner.append(tree.carrier(link.name))
    if not pieces:
        raise InputError(f"{tree.path} shows no surface: none of its links has a readable visual")
    bodies = tree.bodies(owner)
    mesh = join(pieces, materials)
    check_surface(mesh, tree.path)
    labels = np.concatenate([np.full(len(p.faces), bodies[o]) for p, o in zip(pieces, owner)])
    links = tuple(Link(n, "body", np.flatnonzero(labels == i)) for n, i in bodies.items())
    joints = tuple(_bounded(tree.joint(n, bodies)) for n in list(bodies)[1:])
    return Articulation(mesh, links, joints)


def _pieces(
    link: Any, file: Path, frame: FloatArray, materials: list[Material],
    files: dict[Path, FileContent],
) -> list[Piece]:  # fmt: skip
    """A link's visual surface (its collision surface if it has no visual) in the root frame.

    `files` remembers what was read: a mesh that many links show is read once.
    """
    out: list[Piece] = []
    for shapes in (link.visuals, link.collisions):
        for shape in shapes:
            out += _shape_pieces(shape, file, frame @ origin_of(shape), materials, link.name, files)
        if out:
            break
    return out


def _shape_pieces(
    shape: Any, file: Path, frame: FloatArray, materials: list[Material], name: str,
    files: dict[Path, FileContent],
) -> list[Piece]:  # fmt: skip
    start = len(materials)
    geometry = shape.geometry
    if geometry.mesh is None:
        own = shape_triangles(geometry, file.parent)
        if own is None:
            return []
        materials.append(Material(base_color=_color(shape)))
        found: tuple[Piece, ...] = (Piece(own[0], own[1], name),)
        scale: FloatArray = np.ones(3)
    else:
        target = existing(geometry.mesh.filename, file)
        if target not in files:
            files[target] = read_file(target, file.parent)
        content = files[target]
        materials.extend(content.materials)
        found = content.pieces
        scale = mesh_scale(geometry.mesh)
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
    closed, opened = (joint.lower, joint.upper) if near_lower else (joint.upper, joint.lower)
    return replace(joint, closed=closed, open=opened)
