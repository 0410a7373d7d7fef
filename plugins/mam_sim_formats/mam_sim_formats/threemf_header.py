"""What a 3MF file would unpack to and draw, counted before its library expands anything.

Components may name others that name others: forty objects that each hold the one before twice draw
a billion meshes.
"""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from posixpath import basename
from typing import IO
from xml.parsers import expat

from mam_pipeline.errors import InputError
from mam_pipeline.formats.soup import LIMITS, Budget

_PRODUCTION = "http://schemas.microsoft.com/3dmanufacturing/production/2015/06"
_BLOCK = 1 << 20
Key = tuple[str, str]
"""The part of the archive in which an object stands, and its number there."""


def check_3mf(path: Path) -> None:
    """Refuse an archive that unpacks to more, or draws more, than may be read.

    Raises:
        InputError: it does, or it is no archive of well-formed XML.
    """
    try:
        with zipfile.ZipFile(path) as archive:
            entries = archive.infolist()
            Budget(path).nodes(len(entries))
            size = sum(entry.file_size for entry in entries)
            if size > LIMITS.bytes:
                most = LIMITS.bytes >> 20
                raise InputError(f"{path} unpacks to {size >> 20} MiB; the most is {most} MiB")
            found = _Scan(path)
            for name in _models(archive):
                found.read(name, archive.open(name))
    except (zipfile.BadZipFile, EOFError, OSError, ValueError) as error:
        raise InputError(f"{path} is not a 3MF file: it is no ZIP archive") from error
    except (NotImplementedError, RuntimeError) as error:
        raise InputError(f"{path} cannot be read as 3MF ({error}); export it again") from error
    found.check()


def _models(archive: zipfile.ZipFile) -> Iterator[str]:
    """The parts that hold objects, whatever they are called."""
    for entry in archive.infolist():
        if entry.is_dir() or basename(entry.filename) == "[Content_Types].xml":
            continue
        with archive.open(entry) as stream:
            head = stream.read(1 << 12).lower()
        if entry.filename.lower().endswith(".model") or b"<model" in head.replace(b"\0", b""):
            yield entry.filename


@dataclass
class _Scan:
    """The objects of a file.

    Attributes:
        inside: components of each object. faces, vertices, components: in all, each once.
        items: what is built. counts: how many objects are drawn for one.
    """

    path: Path
    inside: dict[Key, list[Key]] = field(default_factory=dict)
    faces: int = 0
    vertices: int = 0
    components: int = 0
    items: list[Key] = field(default_factory=list)
    counts: dict[Key, int] = field(default_factory=dict)

    def read(self, name: str, stream: IO[bytes]) -> None:
        """Take in one part of the archive.

        Raises:
            InputError: it is not well-formed, or holds too much.
        """
        part, at = f"/{name}", [("", "")]
        budget = Budget(self.path)

        def start(tag: str, attributes: dict[str, str]) -> None:
            kind = tag.rpartition(" ")[2]
            if kind == "vertex":
                self.vertices += 1
            elif kind == "triangle":
                self.faces += 1
            elif kind in ("component", "item"):
                other = attributes.get(f"{_PRODUCTION} path", part)
                key = other, attributes.get("objectid", "")
                if kind == "item":
                    self.items.append(key)
                else:
                    self.components += 1
                    self.inside.setdefault(at[0], []).append(key)
            elif kind == "object":
                at[0] = part, attributes.get("id", "")
                self.inside.setdefault(at[0], [])

        def refuse(*_: object) -> None:
            raise InputError(f"{self.path}: a DOCTYPE or entity is declared; remove it")

        parser = expat.ParserCreate(namespace_separator=" ")
        parser.StartElementHandler = start
        parser.StartDoctypeDeclHandler = refuse
        with stream:
            try:
                while block := stream.read(_BLOCK):
                    parser.Parse(block, False)
                    budget.nodes(len(self.items) + len(self.inside) + self.components)
                    Budget(self.path).triangles(self.vertices, self.faces)
                parser.Parse(b"", True)
            except expat.ExpatError as error:
                raise InputError(f"{self.path}: {name} is not well-formed XML: {error}") from error

    def check(self) -> None:
        """Raise InputError where all that is drawn is too much, or an object holds itself."""
        budget = Budget(self.path)
        budget.nodes(sum(self._drawn(key, ()) for key in self.items))
        for key in self.inside:  # the library counts through those, too, that are not built
            budget.nodes(self._drawn(key, ()))

    def _drawn(self, key: Key, above: tuple[Key, ...]) -> int:
        """How many objects are drawn for one."""
        if key in above or len(above) > LIMITS.deep:
            what = f"object {key[1]} holds itself, or components are nested"
            raise InputError(f"{self.path}: {what} more than {LIMITS.deep} deep")
        if key not in self.counts:
            inner = self.inside.get(key, ())
            self.counts[key] = 1 + sum(self._drawn(k, (*above, key)) for k in inner)
        return self.counts[key]
