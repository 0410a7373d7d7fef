"""The pieces a mesh file is made of, before they are joined into one Mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.types import FloatArray, IntArray, Material, Mesh


@dataclass(frozen=True)
class Piece:
    """One run of triangles with one material, in the file's own world frame and unit.

    Attributes:
        vertices: (V, 3). faces: (F, 3).
        group: name of the source's node or object.
        material: index into the file's materials.
        uv: (V, 2) float32, glTF convention, or None. colors: (V, 4) uint8, or None.
    """

    vertices: FloatArray
    faces: IntArray
    group: str = "mesh"
    material: int = 0
    uv: NDArray[np.float32] | None = None
    colors: NDArray[np.uint8] | None = None


@dataclass(frozen=True)
class FileContent:
    """All pieces of a file, its materials, and what the format itself says of unit and up axis."""

    pieces: tuple[Piece, ...]
    materials: tuple[Material, ...] = (Material(),)
    up: str | None = None
    metres_per_unit: float | None = None
    notes: tuple[str, ...] = field(default_factory=tuple)


def join(pieces: Sequence[Piece], materials: Sequence[Material]) -> Mesh:
    """Join pieces into one Mesh; nothing is welded, order and coordinates are the source's."""
    offset = 0
    faces, names = [], list(dict.fromkeys(p.group for p in pieces))
    for piece in pieces:
        faces.append(piece.faces + offset)
        offset += len(piece.vertices)
    uv = colors = None
    if any(p.uv is not None for p in pieces):
        uv = np.concatenate(
            [np.zeros((len(p.vertices), 2), np.float32) if p.uv is None else p.uv for p in pieces]
        )
    if any(p.colors is not None for p in pieces):
        white = np.full((1, 4), 255, np.uint8)
        colors = np.concatenate(
            [np.repeat(white, len(p.vertices), 0) if p.colors is None else p.colors for p in pieces]
        )
    counts = [len(p.faces) for p in pieces]
    return Mesh(
        vertices=np.concatenate([p.vertices for p in pieces]),
        faces=np.concatenate(faces),
        materials=tuple(materials) or (Material(),),
        face_material=np.repeat([p.material for p in pieces], counts),
        uv=uv,
        colors=colors,
        face_group=np.repeat([names.index(p.group) for p in pieces], counts),
        group_names=tuple(names),
    )
