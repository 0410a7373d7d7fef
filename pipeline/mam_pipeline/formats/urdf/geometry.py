"""Surfaces of URDF links: meshes, boxes, cylinders and spheres as triangles."""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from mam_pipeline.errors import InputError
from mam_pipeline.formats.door import Door
from mam_pipeline.formats.door_resolver import DoorResolver
from mam_pipeline.formats.headers import check_header
from mam_pipeline.formats.mesh_files import read_file
from mam_pipeline.geometry.surface import Triangles, concatenate
from mam_pipeline.types import FloatArray


def link_triangles(link: Any, folder: Path) -> Triangles | None:
    """A link's visual surface in the link frame, or its collision surface if it has no visual.

    Args:
        link: a `yourdfpy.Link`. folder: the URDF's, against which mesh names are resolved.

    Returns:
        None where there is neither.
    """
    for shapes in (link.visuals, link.collisions):
        found = []
        for shape in shapes:
            own = shape_triangles(shape.geometry, folder)
            if own is not None:
                origin = origin_of(shape)
                found.append((own[0] @ origin[:3, :3].T + origin[:3, 3], own[1]))
        if found:
            return concatenate(found)
    return None


def shape_triangles(
    geometry: Any, folder: Path, sections: int = 32, subdivisions: int = 3
) -> Triangles | None:
    """Triangles of one shape in its own frame; the `origin` beside it is not applied.

    Args:
        geometry: a `yourdfpy.Geometry`. folder: the URDF's.
        sections: of a cylinder. subdivisions: of the icosahedron that stands for a sphere.

    Returns:
        None for an empty element and, with a warning, for a mesh that cannot be read.
    """
    if geometry.mesh is not None:
        return _mesh_triangles(geometry.mesh, folder)
    if geometry.box is not None:
        return _plain(trimesh.creation.box(extents=geometry.box.size))
    if geometry.cylinder is not None:
        c = geometry.cylinder
        return _plain(trimesh.creation.cylinder(c.radius, c.length, sections=sections))
    if geometry.sphere is not None:
        return _plain(trimesh.creation.icosphere(subdivisions, geometry.sphere.radius))
    return None


def origin_of(element: Any) -> FloatArray:
    """(4, 4) `origin` of a shape, inertial or joint element; identity where it has none."""
    return np.eye(4) if element.origin is None else np.asarray(element.origin)


def mesh_scale(mesh: Any) -> FloatArray:
    """(3,) factors of a URDF's mesh element; ones where none are given."""
    given = 1.0 if mesh.scale is None else np.asarray(mesh.scale, dtype=np.float64)
    return np.broadcast_to(given, (3,))


def resolve(name: str, folder: Path) -> Path | None:
    """The mesh that a URDF in `folder` names, through the door; None if it is absent.

    Raises:
        InputError: it leads out of the folder, or is no ordinary file.
    """
    return Door(folder).find(name, folder, folder)


def existing(name: str, urdf: Path) -> Path:
    """The mesh that a URDF names.

    Raises:
        InputError: it is absent, leads out of the folder, or is no ordinary file.
    """
    found = Door(urdf.parent).find(name, urdf)
    if found is None:
        raise InputError(f"{urdf} names a mesh that does not exist: {name}")
    return found


def read_triangles(path: Path) -> Triangles:
    """All triangles of a mesh file with its scene's transforms applied; nothing is welded.

    Raises:
        InputError: the file holds no triangles.
    """
    if path.suffix.lower() in (".glb", ".gltf"):
        return concatenate([(p.vertices, p.faces) for p in read_file(path).pieces])
    check_header(path)
    scene = trimesh.load_scene(
        path, process=False, skip_materials=True, resolver=DoorResolver(path)
    )
    found: list[Triangles] = []
    for node in sorted(scene.graph.nodes_geometry):
        transform, name = scene.graph[node]
        part = scene.geometry[name]
        if isinstance(part, trimesh.Trimesh) and len(part.faces):
            vertices = trimesh.transform_points(part.vertices, transform)
            flip = np.linalg.det(transform[:3, :3]) < 0
            faces = np.asarray(part.faces, dtype=np.int64)
            found.append((vertices, faces[:, ::-1] if flip else faces))
    if not found:
        raise InputError(f"{path} holds no triangles")
    return concatenate(found)


def _mesh_triangles(mesh: Any, folder: Path) -> Triangles | None:
    path = resolve(mesh.filename, folder)
    if path is None:
        warnings.warn(f"{folder}: mesh {mesh.filename!r} is missing", stacklevel=4)
        return None
    try:
        vertices, faces = read_triangles(path)
    except Exception as error:  # any reader of any format may fail in its own way
        warnings.warn(f"{path}: cannot be read ({error})", stacklevel=4)
        return None
    if mesh.scale is None:
        return vertices, faces
    scale = mesh_scale(mesh)
    return vertices * scale, faces[:, ::-1] if np.prod(scale) < 0 else faces


def _plain(mesh: trimesh.Trimesh) -> Triangles:
    return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)
