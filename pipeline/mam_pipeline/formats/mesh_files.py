"""Reading mesh files into the asset frame, and writing them, with appearance untouched.

A loaded mesh is in metres, Z up, its floor at z = 0 and its middle over the origin; where the
front is, only the articulation can tell (see `mam_pipeline.geometry.front`).
"""

from __future__ import annotations

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

import numpy as np
import trimesh

from mam_pipeline.errors import ConfigError, InputError
from mam_pipeline.formats.apart import read_apart
from mam_pipeline.formats.collada import read_collada
from mam_pipeline.formats.door import is_file
from mam_pipeline.formats.door_resolver import DoorResolver
from mam_pipeline.formats.gltf import read_gltf
from mam_pipeline.formats.gltf_write import write_glb
from mam_pipeline.formats.headers import check_header
from mam_pipeline.formats.obj import read_obj, write_obj
from mam_pipeline.formats.placement import Decision, choose_unit, choose_up
from mam_pipeline.formats.soup import LIMITS, Budget, FileContent, Piece, checked, join
from mam_pipeline.formats.suffixes import MESHES, STEP, USD
from mam_pipeline.formats.threemf import read_3mf
from mam_pipeline.types import Axis, FloatArray, IntArray, Material, Mesh, readonly

_KEPT: ContextVar[dict[tuple[int, ...], FileContent] | None] = ContextVar("kept", default=None)


@dataclass(frozen=True)
class LoadedMesh:
    """A mesh in the asset frame, and how it came there.

    Attributes:
        mesh: metres, Z up, floor at z = 0, centred over the origin.
        source_to_asset: (4, 4) similarity, file coordinates to asset frame, scale included.
        metres_per_unit: the scale alone.
        metres_per_unit_source: who said so: a flag, the format, or an assumption.
        notes: assumptions in words, and what is not taken over, for the card and the report.
        decisions: on the up axis and the unit, with what else they might be.
    """

    mesh: Mesh
    source_to_asset: FloatArray
    metres_per_unit: float
    metres_per_unit_source: str
    notes: tuple[str, ...] = ()
    decisions: tuple[Decision, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(
            self, "source_to_asset", readonly(self.source_to_asset, np.float64, (4, 4))
        )


def load_mesh(
    path: str | Path,
    *,
    up: Literal["auto", Axis] = "auto",
    height: float | None = None,
    scale: float | None = None,
    usual: float | None = None,
) -> LoadedMesh:
    """Read a mesh file (see `MESHES`) into the asset frame.

    Vertices are neither welded nor reordered, texture coordinates and image bytes stay as they
    are; per-node groups become `Mesh.face_group`.

    Args:
        path: the file.
        up: which axis of the file points up; "auto" takes the format's word or looks at the shape.
        height: metres from floor to top after loading; settles the scale.
        scale: metres per unit of the file; settles the scale.
        usual: largest side of such an object, metres, where its kind is known.

    Raises:
        InputError: missing, empty, of another kind than its name says, not finite, without faces,
            flat, or absurdly large.
        ConfigError: both `height` and `scale`, or one that is not positive.
    """
    file = Path(path).expanduser()
    for name, value in (("height", height), ("scale", scale)):
        if value is not None and not (np.isfinite(value) and value > 0):
            raise ConfigError(f"--{name} must be a positive number of metres, not {value}")
    if height is not None and scale is not None:
        raise ConfigError("give either --height or --scale, not both")
    content = read_file(file)
    mesh = join(content.pieces, content.materials)
    check_surface(mesh, file)
    turn, upward = choose_up(mesh, content.up, up, file.suffix.lower())
    turned = mesh.transformed(_matrix(turn))
    low, high = turned.bounds
    unit, source, length = choose_unit(
        high - low, content.metres_per_unit, height, scale, file.suffix.lower(), usual
    )
    matrix = _matrix(turn * unit)
    middle = (low + high) / 2 * unit
    matrix[:3, 3] = [-middle[0], -middle[1], -low[2] * unit]
    placed = mesh.transformed(matrix)
    return LoadedMesh(placed, matrix, unit, source, content.notes, (upward, length))


@contextmanager
def files_kept() -> Iterator[None]:
    """Keep what is read in memory, for those who read the same files again and again.

    A file is known by its place on the disk, its time and its size; what it names must not change.
    """
    token = _KEPT.set({})
    try:
        yield
    finally:
        _KEPT.reset(token)


def read_file(file: Path, root: Path | None = None) -> FileContent:
    """Read a mesh file as it is, in its own frame and unit; see `load_mesh` for the errors.

    Args:
        root: folder whose files it may name; default: its own.
    """
    kept = _KEPT.get()
    if kept is None or not is_file(file):
        return _read_file(file, root)
    at = file.stat()
    key = (at.st_dev, at.st_ino, at.st_mtime_ns, at.st_size)
    if key not in kept:
        kept[key] = _read_file(file, root)
    return kept[key]


def _read_file(file: Path, root: Path | None) -> FileContent:
    suffix = file.suffix.lower()
    if not file.exists():
        raise InputError(f"no file at {file}")
    if file.is_dir():
        raise InputError(f"{file} is a folder; a mesh file is needed ({', '.join(MESHES)})")
    if suffix not in MESHES:
        raise InputError(f"{file} is not a mesh file known here ({', '.join(MESHES)})")
    size = file.stat().st_size
    if size == 0:
        raise InputError(f"{file} is empty")
    if size > LIMITS.bytes:
        raise InputError(f"{file} has {size >> 20} MiB; the most is {LIMITS.bytes >> 20} MiB")
    if suffix in (".glb", ".gltf"):
        content = read_gltf(file, root)
    elif suffix == ".obj":
        content = read_obj(file, root)
    elif suffix == ".dae":
        content = read_collada(file, root)
    elif suffix == ".3mf":
        content = read_3mf(file)
    elif suffix in (*USD, *STEP, ".fbx"):
        kind = "usd" if suffix in USD else "step" if suffix in STEP else "fbx"
        content = read_apart(kind, file, root)
    else:
        content = _read_other(file, root)
    count = sum(len(p.faces) for p in content.pieces)
    if count == 0:
        raise InputError(f"{file} has no faces: a surface is needed, not points or lines")
    if count > LIMITS.faces:
        raise InputError(f"{file} has {count} faces; simplify it to {LIMITS.faces} or fewer")
    return checked(content, file)


def save_glb(mesh: Mesh, path: str | Path, up: Literal["y", "z"] = "y") -> None:
    """Write binary glTF (Y up as its specification asks; "z" for URDF visuals); see `write_glb`."""
    write_glb(mesh, Path(path), up)


def save_obj(mesh: Mesh, path: str | Path) -> None:
    """Write OBJ, MTL and texture files, in the mesh's own frame; see `write_obj`."""
    write_obj(mesh, Path(path))


def _read_other(file: Path, root: Path | None) -> FileContent:
    """PLY, STL and OFF through trimesh, unprocessed."""
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


def check_surface(mesh: Mesh, file: Path) -> None:
    """Refuse what no later stage could work with, in one sentence.

    Raises:
        InputError: vertices that are not finite or absurdly far, no extent, or a flat surface.
    """
    points = mesh.vertices[np.unique(mesh.faces)]
    bad = int((~np.isfinite(points)).any(axis=1).sum())
    if bad:
        raise InputError(f"{file} has {bad} vertices that are not finite numbers (NaN or infinite)")
    size = np.abs(points).max()
    if size > 1e7:
        raise InputError(f"{file} is absurdly large: a coordinate is {size:.3g} units")
    centred = points - points.mean(axis=0)
    spread = np.sqrt(np.maximum(np.linalg.eigvalsh(centred.T @ centred / len(centred)), 0.0))
    if spread[-1] <= 1e-9 * max(size, 1e-30) or spread[-1] == 0.0:
        raise InputError(f"{file} has no extent: all its vertices are at one point")
    if spread[1] <= 1e-6 * spread[-1]:
        raise InputError(f"{file} has no surface: all its vertices lie on one line")
    if spread[0] <= 1e-6 * spread[-1]:
        raise InputError(f"{file} is flat: all its vertices lie in one plane, so nothing can move")


def _matrix(linear: FloatArray) -> FloatArray:
    out = np.eye(4)
    out[:3, :3] = linear
    return out


__all__ = ["LoadedMesh", "load_mesh", "read_file", "save_glb", "save_obj"]
