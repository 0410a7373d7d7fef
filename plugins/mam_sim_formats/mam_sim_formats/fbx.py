"""FBX reading through Open Asset Import (assimp): triangles by node, materials and textures."""

from __future__ import annotations

import re
import struct
from pathlib import Path
from typing import Any

import numpy as np

from mam_pipeline.errors import InputError
from mam_pipeline.formats.pictures import Pictures, model_door
from mam_pipeline.formats.soup import Budget, FileContent, Piece
from mam_pipeline.types import FloatArray, IntArray, Material

_DIFFUSE, _BASE_COLOR = 1, 12  # assimp's numbers of texture kinds


def read_fbx(path: Path, root: Path | None = None) -> FileContent:
    """Read every triangle of an FBX file, Y up as assimp turns it, in the file's unit.

    Skins stand in the pose in which they were bound.

    Args:
        path: the file. root: folder whose files it may name; default: its own.

    Raises:
        InputError: it cannot be read.
    """
    import assimp_py

    flags = assimp_py.Process_Triangulate | assimp_py.Process_SortByPType
    try:
        scene = assimp_py.import_file(str(path), flags)
    except Exception as error:
        raise InputError(f"{path} cannot be read as FBX ({error}); export it as GLB") from error
    budget = Budget(path)
    pictures = Pictures(path, budget, model_door(path, root))
    materials = [_material(m, pictures) for m in scene.materials] or [Material()]
    pieces: list[Piece] = []
    names: dict[str, int] = {}
    left = [(scene.root_node, np.eye(4))]
    while left:
        node, parent = left.pop()
        world = parent @ np.array(node.transformation, dtype=np.float64)
        if node.mesh_indices:
            names[node.name] = names.get(node.name, 0) + 1
            again = names[node.name] - 1
            group = f"{node.name}.{again:03d}" if again else node.name
            for index in node.mesh_indices:
                piece = _piece(scene.meshes[index], world, group, len(materials), budget)
                if piece is not None:
                    pieces.append(piece)
        left += [(child, world) for child in reversed(node.children)]
    unit = _number(path, "UnitScaleFactor")
    metres = 0.01 * unit if unit is not None and unit > 0 else None
    return FileContent(tuple(pieces), tuple(materials), "y", metres, pictures.notes())


def _piece(
    mesh: Any, world: FloatArray, group: str, materials: int, budget: Budget
) -> Piece | None:
    if mesh.num_indices != 3 * mesh.num_faces or not mesh.num_faces:  # points or lines
        return None
    budget.triangles(mesh.num_vertices, mesh.num_faces)
    points = np.array(mesh.vertices, dtype=np.float64).reshape(-1, 3)
    faces: IntArray = np.array(mesh.indices, dtype=np.int64).reshape(-1, 3)
    if np.linalg.det(world[:3, :3]) < 0:
        faces = faces[:, ::-1]
    uv = colors = None
    if mesh.texcoords and mesh.texcoords[0] is not None:
        found = np.array(mesh.texcoords[0], dtype=np.float32).reshape(len(points), -1)[:, :2]
        uv = np.stack([found[:, 0], 1.0 - found[:, 1]], axis=1)
    if mesh.colors and mesh.colors[0] is not None:
        shares = np.array(mesh.colors[0], dtype=np.float64).reshape(len(points), -1)
        colors = np.full((len(points), 4), 255, np.uint8)
        colors[:, : shares.shape[1]] = np.clip(np.round(shares * 255.0), 0, 255)
    vertices = points @ world[:3, :3].T + world[:3, 3]
    return Piece(vertices, faces, group, min(mesh.material_index, materials - 1), uv, colors)


def _material(told: dict[str, Any], pictures: Pictures) -> Material:
    textures = told.get("TEXTURES", {})
    names = [*textures.get(_BASE_COLOR, ()), *textures.get(_DIFFUSE, ())]
    picture = None
    for name in names:
        if name.startswith("*"):
            pictures.unread.append("a texture inside the FBX (save it beside, not embedded)")
        elif picture is None:
            picture = pictures.named(name)
    r, g, b = (float(c) for c in (told.get("COLOR_DIFFUSE") or (0.7, 0.7, 0.7))[:3])
    if picture is not None:
        r = g = b = 1.0
    opacity = float(told.get("OPACITY", 1.0))
    return Material(
        str(told.get("NAME") or "material"),
        (r, g, b, opacity if 0.0 < opacity <= 1.0 else 1.0),
        None if picture is None else picture.data,
        None if picture is None else picture.kind,
    )


def _number(path: Path, name: str) -> float | None:
    """A number of the file's global settings, which the importer does not hand on."""
    data = path.read_bytes()
    at = data.find(name.encode())
    if at < 0:
        return None
    after = data[at + len(name) : at + len(name) + 200]
    text = re.match(rb'"\s*,\s*"[^"]*"\s*,\s*"[^"]*"\s*,\s*"[^"]*"\s*,\s*([-+0-9.eE]+)', after)
    if text is not None:
        return float(text.group(1))
    offset = 0
    while offset < len(after) and after[offset : offset + 1] == b"S":
        offset += 5 + struct.unpack_from("<I", after, offset + 1)[0]
    if after[offset : offset + 1] == b"D" and offset + 9 <= len(after):
        return float(struct.unpack_from("<d", after, offset + 1)[0])
    return None
