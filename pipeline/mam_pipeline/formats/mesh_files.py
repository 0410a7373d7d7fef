"""Reading mesh files into the asset frame, and writing them, with appearance untouched.

A loaded mesh is in metres, Z up, its floor at z = 0 and its middle over the origin; where the
front is, only the articulation can tell (see `mam_pipeline.geometry.front`).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from mam_pipeline.errors import ConfigError, InputError
from mam_pipeline.formats.door import is_file
from mam_pipeline.formats.gltf_write import write_glb
from mam_pipeline.formats.obj_write import write_obj
from mam_pipeline.formats.placement import Decision, choose_unit, choose_up
from mam_pipeline.formats.readers import read_mesh
from mam_pipeline.formats.soup import FileContent, join
from mam_pipeline.types import Axis, FloatArray, Mesh, readonly

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
    usual: tuple[float, float, float] | None = None,
) -> LoadedMesh:
    """Read a mesh file (see `mesh_suffixes`) into the asset frame.

    Vertices are neither welded nor reordered, texture coordinates and image bytes stay as they
    are; per-node groups become `Mesh.face_group`.

    Args:
        path: the file.
        up: which axis of the file points up; "auto" takes the format's word or looks at the shape.
        height: metres from floor to top after loading; settles the scale.
        scale: metres per unit of the file; settles the scale.
        usual: lowest, usual and highest largest side of such an object, metres, where its kind is
            known.

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
    kept = _KEPT.get()
    token = _KEPT.set({} if kept is None else kept)
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
        return read_mesh(file, root)
    at = file.stat()
    key = (at.st_dev, at.st_ino, at.st_mtime_ns, at.st_size)
    if key not in kept:
        kept[key] = read_mesh(file, root)
    return kept[key]


def save_glb(mesh: Mesh, path: str | Path, up: Literal["y", "z"] = "y") -> None:
    """Write binary glTF (Y up as its specification asks; "z" for URDF visuals); see `write_glb`."""
    write_glb(mesh, Path(path), up)


def save_obj(mesh: Mesh, path: str | Path) -> None:
    """Write OBJ, MTL and texture files, in the mesh's own frame; see `write_obj`."""
    write_obj(mesh, Path(path))


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
