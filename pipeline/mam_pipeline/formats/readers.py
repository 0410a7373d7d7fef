"""Which reader reads which mesh files: one table, by suffix, to which other packages add."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from mmap import ACCESS_READ, mmap
from pathlib import Path

from mam_pipeline.errors import InputError
from mam_pipeline.formats.apart import apart
from mam_pipeline.formats.door import is_file
from mam_pipeline.formats.soup import LIMITS, FileContent, checked
from mam_pipeline.formats.suffixes import ELSEWHERE, READER, mesh_suffixes
from mam_pipeline.optional import not_installed
from mam_pipeline.registry import Registry, resolve


@dataclass(frozen=True)
class Reader:
    """How one kind of file is read.

    Attributes:
        function: "module:name" of `read(path, root)`, which gives a FileContent; root is the
            folder whose files the file may name.
        apart: whether a file is read in a process of its own. Not where our own code counts all
            that a file claims before it does any work, and the file is small: a URDF may name a
            hundred meshes, and a process costs 30 ms.
    """

    function: str
    apart: Callable[[Path], bool] = lambda _: True


LARGE = 64 << 20
"""Bytes of a file that may keep a reader busy for long, or take gigabytes."""


def _large(file: Path) -> bool:
    return file.stat().st_size > LARGE


def _packed(file: Path) -> bool:
    """Whether a glTF file holds what native code unpacks (Draco, meshopt, Basis), or is large."""
    if _large(file):
        return True
    with file.open("rb") as stream, mmap(stream.fileno(), 0, access=ACCESS_READ) as data:
        return any(data.find(word) >= 0 for word in (b"_draco_", b"_meshopt_", b"_basisu"))


_FORMATS = "mam_pipeline.formats"
_GLTF = Reader(f"{_FORMATS}.gltf:read_gltf", _packed)
_PLAIN = Reader(f"{_FORMATS}.plain:read_plain", _large)
BUILTIN: Mapping[str, Reader] = {
    ".glb": _GLTF,
    ".gltf": _GLTF,
    ".obj": Reader(f"{_FORMATS}.obj:read_obj", _large),
    ".dae": Reader(f"{_FORMATS}.collada:read_collada", _large),
    **{suffix: _PLAIN for suffix in (".ply", ".stl", ".off")},
}


def reader_of(suffix: str) -> Reader | None:
    """Who reads files of a suffix; another package's reader always works in a process of its own.

    None where nobody does.
    """
    added = Registry("reader", {}, READER).targets()
    target = {f".{name.lower()}": target for name, target in added.items()}.get(suffix)
    return BUILTIN.get(suffix) or (None if target is None else Reader(target))


def read_mesh(file: Path, root: Path | None = None) -> FileContent:
    """What is in a mesh file, in its own frame and unit.

    Args:
        root: folder whose files it may name; default: its own.

    Raises:
        InputError: no such file, no mesh, or reading it takes too much.
        BackendError: the package that reads such files is not installed, or broken.
    """
    if not is_file(file):
        what = "no mesh file" if file.exists() else "no file"
        raise InputError(f"{what} at {file}; one is needed ({', '.join(mesh_suffixes())})")
    suffix = file.suffix.lower()
    reader = reader_of(suffix)
    if reader is None and suffix in ELSEWHERE:
        way = ELSEWHERE[suffix].format(file=file, stem=file.stem)
        raise not_installed(f"{file.name}: the reader of {suffix}", way=way)
    if reader is None:
        raise InputError(f"{file} is not a mesh file known here ({', '.join(mesh_suffixes())})")
    size = file.stat().st_size
    if size == 0:
        raise InputError(f"{file} is empty")
    if size > LIMITS.bytes:
        raise InputError(f"{file} has {size >> 20} MiB; the most is {LIMITS.bytes >> 20} MiB")
    read = resolve(reader.function, f"the reader of {suffix}")
    if not reader.apart(file):
        return _sound(read, file, root)
    return apart(partial(_sound, read, file, root), file, file.suffix[1:].upper())


def _sound(
    read: Callable[[Path, Path | None], FileContent], file: Path, root: Path | None
) -> FileContent:
    """What a reader finds, where it is a surface that can be worked with.

    Raises:
        InputError: it is none. MissingExtra: a library that the reader needs is not installed.
    """
    try:
        content = read(file, root)
    except ModuleNotFoundError as error:
        raise not_installed(f"{file.name}: {error.name}, which reads {file.suffix},") from error
    count = sum(len(p.faces) for p in content.pieces)
    if count == 0:
        raise InputError(f"{file} has no faces: a surface is needed, not points or lines")
    if count > LIMITS.faces:
        raise InputError(f"{file} has {count} faces; simplify it to {LIMITS.faces} or fewer")
    return checked(content, file)
