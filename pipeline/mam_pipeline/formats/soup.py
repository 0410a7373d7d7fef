"""The pieces a mesh file is made of, before they are joined into one Mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mam_pipeline.errors import InputError
from mam_pipeline.formats.nodes import Scene
from mam_pipeline.thresholds import MAX_FACES
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
    """All pieces of a file, its materials, what the format itself says of unit and up axis, and the
    file's nodes where the reader keeps them."""

    pieces: tuple[Piece, ...]
    materials: tuple[Material, ...] = (Material(),)
    up: str | None = None
    metres_per_unit: float | None = None
    notes: tuple[str, ...] = field(default_factory=tuple)
    scene: Scene | None = None


@dataclass(frozen=True)
class Limits:
    """What one mesh file may hold, with all that it names.

    Attributes:
        bytes: of the file and the files that it names. nodes: of a scene.
        deep: nodes that may stand above another.
        faces, vertices: of all that is drawn; what is drawn twice counts twice.
        pixels: of all textures together.
        line: bytes of a line of text.
    """

    bytes: int = 1 << 30
    nodes: int = 100_000
    deep: int = 200
    faces: int = MAX_FACES
    vertices: int = 12_000_000
    pixels: int = 16384 * 16384
    line: int = 16 << 20


LIMITS = Limits()


class Budget:
    """Counts what reading one file has taken so far; every method raises InputError at a limit."""

    def __init__(self, file: Path, limits: Limits = LIMITS) -> None:
        self.file, self.limits = file, limits
        self._bytes = self._faces = self._vertices = 0

    def read(self, other: Path) -> bytes:
        """The bytes of a file that this one names."""
        self._bytes += other.stat().st_size
        self._under(self._bytes, self.limits.bytes, "bytes in the files that it names")
        return other.read_bytes()

    def nodes(self, count: int) -> None:
        """So many nodes are in the scene."""
        self._under(count, self.limits.nodes, "nodes")

    def triangles(self, vertices: int, faces: int) -> None:
        """So many more are drawn."""
        self._vertices += vertices
        self._faces += faces
        self._under(self._faces, self.limits.faces, "faces")
        self._under(self._vertices, self.limits.vertices, "vertices")

    def _under(self, count: int, most: int, what: str) -> None:
        if count > most:
            raise InputError(f"{self.file} has {count} {what}; simplify it to {most} or fewer")


def checked(content: FileContent, file: Path) -> FileContent:
    """What a reader found, fit for use: the last door of every format.

    Colours become finite shares, texture coordinates that are not finite become 0, and a texture
    that cannot be decoded is left out.

    Raises:
        InputError: a face names a vertex or a material that does not exist, or arrays do not fit.
    """
    decoder = _Decoder()
    materials = tuple(_sound(m, decoder) for m in content.materials)
    return replace(
        content,
        materials=materials,
        pieces=tuple(_fitting(p, len(materials), file) for p in content.pieces),
    )


def _fitting(piece: Piece, materials: int, file: Path) -> Piece:
    count, faces = len(piece.vertices), np.asarray(piece.faces)
    if len(faces) and not (faces.min() >= 0 and faces.max() < count):
        raise InputError(f"{file} is broken: a face names a vertex that does not exist")
    if not 0 <= piece.material < materials:
        raise InputError(f"{file} is broken: it names material {piece.material} of {materials}")
    for what, array in (("texture coordinates", piece.uv), ("colours", piece.colors)):
        if array is not None and len(array) != count:
            raise InputError(f"{file} is broken: {len(array)} {what} for {count} vertices")
    if piece.uv is None or np.isfinite(piece.uv).all():
        return piece
    return replace(piece, uv=np.nan_to_num(piece.uv, nan=0.0, posinf=0.0, neginf=0.0))


def _sound(material: Material, decoder: _Decoder) -> Material:
    """The material with numbers that are shares, without a picture that cannot be decoded."""

    def share(value: float, default: float) -> float:
        return min(max(float(value), 0.0), 1.0) if np.isfinite(value) else default

    given = (*material.base_color, 1.0, 1.0, 1.0, 1.0)[:4]
    r, g, b, a = (share(c, d) for c, d in zip(given, (0.7, 0.7, 0.7, 1.0)))
    image = material.image if material.image and decoder.reads(material.image) else None
    return replace(
        material,
        base_color=(r, g, b, a),
        image=image,
        image_format=None if image is None else material.image_format,
        metallic=share(material.metallic, 0.0),
        roughness=share(material.roughness, 0.8),
    )


class _Decoder:
    """Which pictures of one file can be read to their end; each is tried once."""

    known: ClassVar[dict[bytes, int]] = {}
    """By digest: pixels of a picture, 0 where it cannot be read. Parts of one object share theirs,
    and an asset is read many times."""

    def __init__(self) -> None:
        self._left = LIMITS.pixels
        self._seen: dict[bytes, bool] = {}

    def reads(self, image: bytes) -> bool:
        """Whether a picture can be read, and all so far are not too many pixels."""
        key = sha256(image).digest()
        if key not in self._seen:
            pixels = self.known[key] if key in self.known else self._decoded(image)
            self._left -= pixels
            self._seen[key] = pixels > 0 and self._left >= 0
            if self._left >= 0:
                self.known[key] = pixels
        return self._seen[key]

    def _decoded(self, image: bytes) -> int:
        try:
            with Image.open(BytesIO(image), formats=("PNG", "JPEG")) as picture:
                pixels = picture.width * picture.height
                if pixels <= self._left:
                    picture.load()
        except Exception:  # every decoder fails in its own way
            return 0
        return pixels


def paired(keys: IntArray) -> tuple[IntArray, IntArray]:
    """A vertex for every distinct row of indices.

    Args:
        keys: (3 F, K) indices of every corner: of its position, texture coordinate ...

    Returns:
        (V, K) rows, and (F, 3) faces that index them.
    """
    keys = np.asarray(keys, dtype=np.int64)
    packed = keys[:, 0]
    for column in keys.T[1:]:
        low = int(column.min(initial=0))
        packed = packed * (int(column.max(initial=0)) - low + 1) + (column - low)
    _, first, inverse = np.unique(packed, return_index=True, return_inverse=True)
    return keys[first], inverse.reshape(-1, 3)


def fans(counts: IntArray) -> tuple[IntArray, NDArray[np.int64]]:
    """Polygons of some numbers of corners as fans of triangles.

    Returns:
        (F, 3) indices into the corners, and (F,) the polygon of each triangle.
    """
    start = np.cumsum(counts) - counts
    pieces = np.maximum(counts - 2, 0)
    polygon = np.repeat(np.arange(len(counts)), pieces)
    step = np.arange(pieces.sum()) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    first = start[polygon]
    return np.stack([first, first + step + 1, first + step + 2], axis=1), polygon


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
