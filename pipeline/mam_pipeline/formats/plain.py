"""PLY, STL and OFF reading through trimesh, unprocessed."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from mam_pipeline.errors import InputError
from mam_pipeline.formats.door_resolver import DoorResolver
from mam_pipeline.formats.headers import check_header
from mam_pipeline.formats.soup import Budget, FileContent, Piece
from mam_pipeline.types import IntArray, Material


def read_plain(file: Path, root: Path | None = None) -> FileContent:
    """Read every triangle of a PLY, STL or OFF file in its own frame and unit.

    Args:
        file: the file. root: folder whose files it may name; default: its own.

    Raises:
        InputError: it cannot be read, or claims more than it holds.
    """
    check_header(file)
    try:
        resolver = DoorResolver(file, root)
        with _silent(trimesh.util.log):  # what is missing is told in our words
            scene = trimesh.load_scene(file, process=False, resolver=resolver)
        return replace(_pieces_of(scene, file), notes=tuple(resolver.left_out))
    except InputError:
        raise
    except Exception as error:  # each reader fails in its own way
        what = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"{file} cannot be read as {file.suffix[1:].upper()} ({what})") from error


@contextmanager
def _silent(logger: logging.Logger) -> Iterator[None]:
    """Without what a library logs."""
    before, logger.disabled = logger.disabled, True
    try:
        yield
    finally:
        logger.disabled = before


def _pieces_of(scene: trimesh.Scene, file: Path) -> FileContent:
    budget = Budget(file)
    pieces: list[Piece] = []
    materials: list[Material] = []
    for node in sorted(scene.graph.nodes_geometry):
        transform, name = scene.graph[node]
        part = scene.geometry[name]
        if not isinstance(part, trimesh.Trimesh) or not len(part.faces):
            continue
        faces: IntArray = np.asarray(part.faces, dtype=np.int64)
        budget.triangles(len(part.vertices), len(faces))
        if np.linalg.det(transform[:3, :3]) < 0:
            faces = faces[:, ::-1]
        vertices = trimesh.transform_points(part.vertices, transform)
        material, uv, colors = _trimesh_appearance(part)
        pieces.append(Piece(vertices, faces, str(name), len(materials), uv, colors))
        materials.append(material)
    return FileContent(tuple(pieces), tuple(materials))


def _trimesh_appearance(part: trimesh.Trimesh) -> tuple[Material, Any, Any]:
    """(Material, uv, colours) of a trimesh geometry; textures are encoded as PNG without loss."""
    visual: Any = part.visual
    if visual.kind == "vertex":
        return Material(), None, np.asarray(visual.vertex_colors, dtype=np.uint8)
    if visual.kind != "texture":
        return Material(), None, None
    simple = visual.material
    simple = simple.to_simple() if hasattr(simple, "to_simple") else simple
    color = np.asarray(getattr(simple, "diffuse", (178, 178, 178, 255)), dtype=float) / 255.0
    image = getattr(simple, "image", None)
    data = None
    if image is not None and visual.uv is not None:
        buffer = BytesIO()
        image.save(buffer, format="PNG")
        data = buffer.getvalue()
    uv = None
    if visual.uv is not None and len(visual.uv) == len(part.vertices):
        flipped = [visual.uv[:, 0], 1.0 - visual.uv[:, 1]]
        uv = np.stack(flipped, axis=1).astype(np.float32)
    name = str(getattr(simple, "name", "") or "material")
    rgba = tuple(float(c) for c in color[:4])
    return Material(name, rgba, data, None if data is None else "png"), uv, None  # type: ignore[arg-type]
