"""Surfaces of URDF links: meshes, boxes, cylinders and spheres as triangles in the link frame."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from mam_pipeline.errors import InputError
from mam_pipeline.types import FloatArray, IntArray

Soup = tuple[FloatArray, IntArray]


def geometry_soup(geometry: Any, folder: Path) -> Soup | None:
    """Triangles of one yourdfpy Geometry, metres, before the visual's own origin is applied.

    Args:
        geometry: a `yourdfpy.Geometry`.
        folder: the URDF's folder, against which mesh names are resolved.

    Returns:
        (V, 3) vertices and (F, 3) faces; None, with a warning, for a mesh that cannot be read.
    """
    if geometry.box is not None:
        return _plain(trimesh.creation.box(extents=geometry.box.size))
    if geometry.cylinder is not None:
        c = geometry.cylinder
        return _plain(trimesh.creation.cylinder(radius=c.radius, height=c.length, sections=32))
    if geometry.sphere is not None:
        return _plain(trimesh.creation.icosphere(subdivisions=3, radius=geometry.sphere.radius))
    if geometry.mesh is None:
        return None
    path = resolve(geometry.mesh.filename, folder)
    if path is None:
        warnings.warn(f"{folder}: mesh {geometry.mesh.filename!r} is missing", stacklevel=2)
        return None
    try:
        vertices, faces = read_triangles(path)
    except Exception as error:  # any reader of any format may fail in its own way
        warnings.warn(f"{path}: cannot be read ({error})", stacklevel=2)
        return None
    if geometry.mesh.scale is not None:
        scale = np.broadcast_to(np.asarray(geometry.mesh.scale, dtype=np.float64), (3,))
        vertices = vertices * scale
        if np.prod(scale) < 0:
            faces = faces[:, ::-1]
    return vertices, faces


def resolve(name: str, folder: Path) -> Path | None:
    """Find a mesh named in a URDF: relative, absolute, file:// or package://; None if absent."""
    bare = name.split("://", 1)[1] if "://" in name else name
    if name.startswith("package://"):
        tail = Path(*Path(bare).parts[1:])
        roots = [folder, *folder.parents][:6]
        options = [root / part for root in roots for part in (Path(bare), tail)]
    else:
        options = [Path(bare), folder / bare] if Path(bare).is_absolute() else [folder / bare]
    return next((p for p in options if p.is_file()), None)


def read_triangles(path: Path) -> Soup:
    """All triangles of a mesh file with its scene's transforms applied; nothing is welded.

    Raises:
        InputError: the file holds no triangles.
    """
    scene = trimesh.load_scene(path, process=False, skip_materials=True)
    soups: list[Soup] = []
    for node in sorted(scene.graph.nodes_geometry):
        transform, name = scene.graph[node]
        part = scene.geometry[name]
        if isinstance(part, trimesh.Trimesh) and len(part.faces):
            vertices = trimesh.transform_points(part.vertices, transform)
            flip = np.linalg.det(transform[:3, :3]) < 0
            faces = np.asarray(part.faces, dtype=np.int64)
            soups.append((vertices, faces[:, ::-1] if flip else faces))
    if not soups:
        raise InputError(f"{path} holds no triangles")
    return concatenate(soups)


def concatenate(soups: list[Soup]) -> Soup:
    """Join triangle lists; no vertex is shared between them."""
    offset, vertices, faces = 0, [], []
    for v, f in soups:
        vertices.append(v)
        faces.append(f + offset)
        offset += len(v)
    return np.concatenate(vertices), np.concatenate(faces)


def _plain(mesh: trimesh.Trimesh) -> Soup:
    return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)
