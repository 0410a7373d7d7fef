"""The door: which files may be opened on behalf of a file that names others.

A URDF names meshes and pictures, an OBJ its MTL, an MTL its pictures, a glTF or DAE file its
buffers and pictures. A stranger wrote those names. All readers ask here, and get files of one
folder alone, whatever the name is (relative, absolute, file://, package://) and whatever links lie
on the way; `survey` asks for every name that a loader which is not ours would follow.
"""

from __future__ import annotations

import html
import json
import os
import re
import stat
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path
from urllib.parse import unquote

from mam_pipeline.errors import InputError
from mam_pipeline.formats.suffixes import PHOTOS

_ALLOWED: ContextVar[bool] = ContextVar("allowed", default=False)
_TEXTURES = re.compile(rb"^[ \t]*(?:map_\w+|bump|disp|decal|refl|norm)[ \t]+(.+)$", re.I | re.M)
_LIBRARIES = re.compile(rb"^[ \t]*mtllib[ \t]+(.+)$", re.I | re.M)
_PLY_TEXTURES = re.compile(rb"^comment[ \t]+TextureFile[ \t]+(.+)$", re.I | re.M)
_DAE_IMAGES = re.compile(rb"<(?:\w+:)?(?:init_from|ref)\b[^>]*>(?:<!\[CDATA\[)?([^<\]]+)", re.I)
MOST_BYTES = 1 << 30
"""Longer files are not looked through; no reader opens them either."""


class Outside(InputError):
    """A name leads out of the folder in which the file that holds it lies."""


@contextmanager
def outside_allowed(yes: bool = True) -> Iterator[None]:
    """Let files name others outside their folder; for the user's own and for installed robots."""
    token = _ALLOWED.set(yes or _ALLOWED.get())
    try:
        yield
    finally:
        _ALLOWED.reset(token)


@dataclass(frozen=True)
class Door:
    """Opens files of one folder.

    Attributes:
        root: the folder; what leads out of it is refused, unless `outside_allowed` holds.
        advice: what the user can do where that happens.
    """

    root: Path
    advice: str = (
        "copy it into the folder, or, if the file is your own, add --allow-outside to check, "
        "view, articulate, make-env or mend"
    )

    def find(self, name: str, by: Path, folder: Path | None = None) -> Path | None:
        """The ordinary file that `name` means in the file `by`; None where there is none.

        Args:
            folder: against which a relative name is meant; default: that of `by`.

        Raises:
            Outside: it leads out of the folder.
            InputError: something is there that is no ordinary file (a pipe, a folder).
        """
        outside = False
        for option in self._options(name, by.parent if folder is None else folder):
            if not self.holds(option):
                outside = True
                continue
            mode = _mode(option)
            if mode is None:
                continue
            if not stat.S_ISREG(mode):
                raise InputError(f"{by} names {name!r}, which is no ordinary file")
            return option
        if outside:
            raise Outside(
                f"{by} names {name!r}, which lies outside its folder and is not opened; "
                f"{self.advice}"
            )
        return None

    def may_write(self, path: Path) -> Path:
        """The path itself, where writing to it touches nothing outside the folder.

        Raises:
            Outside: a link leads out of the folder.
        """
        if not self.holds(path):
            raise Outside(f"{path} is a link out of {self.root}; nothing is written through it")
        return path

    def holds(self, path: Path) -> bool:
        """Whether a path may be opened: links and dots followed, it lies in the folder."""
        if _ALLOWED.get():
            return True
        root = os.path.realpath(self.root)
        return os.path.commonpath([root, os.path.realpath(path)]) == root

    def _options(self, name: str, folder: Path) -> list[Path]:
        """Where a name may lead, the most likely first."""
        scheme, mark, bare = name.partition("://")
        if not mark:
            return [folder / name]
        if scheme.lower() == "file":
            return [Path(bare) if bare.startswith("/") else folder / bare]
        parts = [p for p in bare.split("/") if p]
        roots = [folder]
        if _ALLOWED.get():  # a package's files lie beside the folder that holds its URDF
            roots = [folder, *folder.parents][:6]
        return [root.joinpath(*p) for root in roots for p in (parts, parts[1:]) if p]


def is_file(path: Path) -> bool:
    """Whether an ordinary file lies at a path, links followed; a name that cannot be is none."""
    mode = _mode(path)
    return mode is not None and stat.S_ISREG(mode)


@dataclass(frozen=True)
class WalkLimits:
    """How far folders are looked through.

    Attributes:
        entries: of all folders together. deep: folders that may stand above another.
    """

    entries: int = 200_000
    deep: int = 100


WALK = WalkLimits()


def entries(folder: Path, pattern: str = "*") -> list[Path]:
    """Ordinary files and folders in a folder, in order, each once whatever links lead to it.

    Args:
        pattern: of their names.

    Raises:
        InputError: there are too many.
    """
    found: dict[str, Path] = {}
    with os.scandir(folder) as rows:
        for number, row in enumerate(rows):
            if number >= WALK.entries:
                raise InputError(f"{folder} holds more than {WALK.entries} entries; name a part")
            path = folder / row.name
            if fnmatchcase(row.name, pattern) and (is_file(path) or path.is_dir()):
                real = os.path.realpath(path)
                found[real] = min(path, found.get(real, path))
    return sorted(found.values())


def _mode(path: Path) -> int | None:
    try:
        return path.stat().st_mode
    except (OSError, ValueError):  # absent, a loop of links, a name that is too long or holds NUL
        return None


@dataclass
class Survey:
    """Every file that is opened when a loader reads a mesh: none may lie outside the folder.

    Attributes:
        seen: files that were looked through.
    """

    door: Door
    seen: set[Path] = field(default_factory=set)

    def mesh(self, file: Path) -> None:
        """Look at the names in a mesh file, and in the files that it names.

        Raises:
            InputError: one of them leads out of the folder, or is no ordinary file.
        """
        if file in self.seen or file.stat().st_size > MOST_BYTES:
            return
        self.seen.add(file)
        for name in named_by(file):
            found = self._picture(name, file)
            if found is not None and found.suffix.lower() != ".obj":
                self.mesh(found)

    def _picture(self, name: str, by: Path) -> Path | None:
        """A named file; what an artist's own disk had, and this one has not, does no harm."""
        path = by.parent / name
        if _mode(path) is None and not self.door.holds(path):
            return None
        return self.door.find(name, by)


def named_by(file: Path) -> list[str]:
    """Names of the files that a mesh file says belong to it: materials, pictures, buffers."""
    names = _NAMES.get(file.suffix.lower())
    return [] if names is None else names(file)


def lost_names(file: Path) -> list[str]:
    """Names of materials and pictures in a mesh file of which no file has the exact name.

    Of an MTL line with options, such as "-s 1 1 1 wood.png", the last word counts.
    """
    suffix, out = file.suffix.lower(), []
    names = _lines(_TEXTURES, file.read_bytes()) if suffix == ".mtl" else named_by(file)
    for name in names:
        words = name.split() if suffix == ".mtl" and name.startswith("-") else [name]
        told = words[-1] if words else ""
        drawn = suffix != ".dae" or Path(told).suffix.lower() in (*PHOTOS, ".tga", ".dds")
        if told and drawn and not is_file(file.parent / told):
            out.append(told)
    return list(dict.fromkeys(out))


def _obj_names(file: Path) -> list[str]:
    return _lines(_LIBRARIES, file.read_bytes())


def _mtl_names(file: Path) -> list[str]:
    """File names in an MTL; options such as "-s 1 1 1" may stand before one."""
    out: list[str] = []
    for line in _lines(_TEXTURES, file.read_bytes()):
        words = line.split()
        out += dict.fromkeys(" ".join(words[i:]) for i in range(len(words)))
    return out


def _ply_names(file: Path) -> list[str]:
    with file.open("rb") as stream:
        return _lines(_PLY_TEXTURES, stream.read(1 << 16).partition(b"end_header")[0])


def _dae_names(file: Path) -> list[str]:
    names = [html.unescape(n) for n in _lines(_DAE_IMAGES, file.read_bytes())]
    return [unquote(n.removeprefix("file://")) for n in names if not n.startswith("#")]


def _gltf_names(file: Path) -> list[str]:
    """URIs of a glTF file's buffers and pictures; a file that is none has no names."""
    with file.open("rb") as stream:
        head = stream.read(20)
        if head[:4] == b"glTF" and len(head) == 20:
            text = stream.read(struct.unpack_from("<I", head, 12)[0])
        else:
            text = head + stream.read()
    try:
        doc = json.loads(text)
        rows = [*doc.get("buffers", ()), *doc.get("images", ())]
        uris = [row.get("uri") for row in rows]
    except (ValueError, AttributeError, TypeError, RecursionError):
        return []
    return [unquote(u) for u in uris if isinstance(u, str) and not u.startswith("data:")]


def _lines(pattern: re.Pattern[bytes], data: bytes) -> list[str]:
    return [m.decode("utf-8", "replace").strip() for m in pattern.findall(data)]


_NAMES: dict[str, Callable[[Path], list[str]]] = {
    ".obj": _obj_names, ".mtl": _mtl_names, ".ply": _ply_names, ".dae": _dae_names,
    ".gltf": _gltf_names, ".glb": _gltf_names,
}  # fmt: skip
