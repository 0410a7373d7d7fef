"""Inputs of a batch: files, folders, patterns and lists to named files with their digests."""

from __future__ import annotations

import fnmatch
import hashlib
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from mam_pipeline.digests import file_digest
from mam_pipeline.errors import InputError, disk_error
from mam_pipeline.formats.door import WALK
from mam_pipeline.formats.files import files_of
from mam_pipeline.formats.suffixes import PHOTOS, mesh_suffixes

LISTS = (".txt", ".lst")
SIMULATED = (".urdf",)
USUAL = ("object", "mobility", "model", "robot", "scene")
"""Names of files that say nothing: their folder's name says what they are."""


@dataclass(frozen=True)
class Input:
    """One object to make.

    Attributes:
        path: of the file, absolute. label: what it is called within what the user named.
        sha256: of it and the files that it names, hex.
        fault: why nothing can be made of it, in a sentence; "" where that is not known yet.
    """

    path: Path
    label: str
    sha256: str
    fault: str = ""

    @property
    def name(self) -> str:
        """Of its folder: the same for the same content, whatever else is in the batch."""
        label = re.sub(r"[^\w.-]+", "_", self.label).strip("._") or "object"
        return f"{label[:80]}-{self.sha256[:8]}"


@dataclass
class _Seen:
    """What has been looked through: a folder or a list is read once, whatever links lead to it."""

    folders: set[Path] = field(default_factory=set)
    lists: set[Path] = field(default_factory=set)
    entries: int = 0

    def entries_of(self, folder: Path, deep: int) -> list[Path]:
        """What lies in a folder, in order; nothing where it was looked through before.

        Raises:
            InputError: there is too much in all.
        """
        real = folder.resolve()
        if real in self.folders:
            return []
        self.folders.add(real)
        inside = []
        with os.scandir(folder) as rows:
            for row in rows:
                self.entries += 1
                if self.entries > WALK.entries or deep > WALK.deep:
                    most = f"{WALK.entries} entries, or {WALK.deep} levels"
                    raise InputError(f"{folder} leads to more than {most}; name a smaller folder")
                inside.append(folder / row.name)
        return sorted(inside)


def telling_name(path: Path) -> str:
    """What a file is called: its stem, or its folder's name where that says nothing."""
    return path.parent.name if path.suffix and path.stem in USUAL else path.stem


def find_inputs(words: Sequence[str]) -> list[Input]:
    """Files that are meant, each content and label once, in the order of the words.

    Args:
        words: files; folders, of which every mesh, photo and URDF below is taken (pictures beside
            meshes are their textures, meshes beside a URDF its own, and assets are passed over);
            patterns with * or **; lists (.txt) with one of these a line. What stands for nothing
            is an input with a fault, beside others.

    Raises:
        InputError: none of the words stands for anything.
    """
    found: dict[str, Input] = {}
    for word in words:
        for path, label, fault in _paths([word], Path(), (), _Seen()):
            item = _input(path, label, fault)
            found.setdefault(item.name, item)
    faults = [item.fault for item in found.values()]
    if all(faults):
        raise InputError(faults[0] if faults else "the lists that were named hold no inputs")
    return list(found.values())


def _input(path: Path, label: str, fault: str) -> Input:
    """An input with its digest, or with what keeps it from being read."""
    if not fault:
        try:
            return Input(path.resolve(), label, content_digest(path))
        except OSError as error:
            fault = str(disk_error(error))
        except (InputError, ValueError, RecursionError, MemoryError) as error:
            fault = f"{path} cannot be read: {error}"
    digest = hashlib.sha256(f"{path} {fault}".encode("utf-8", "backslashreplace")).hexdigest()
    return Input(path.absolute(), label, digest, fault)


def _paths(
    words: Sequence[str], base: Path, within: tuple[Path, ...], seen: _Seen
) -> Iterator[tuple[Path, str, str]]:
    """(path, label, fault) of what the words stand for; within: lists that are being read."""
    for word in words:
        path = base / word
        try:
            yield from _of_word(word, path, within, seen)
        except InputError as error:
            yield path, path.stem, str(error)
        except OSError as error:
            yield path, path.stem, str(disk_error(error))


def _of_word(
    word: str, path: Path, within: tuple[Path, ...], seen: _Seen
) -> Iterator[tuple[Path, str, str]]:
    """What one word stands for.

    Raises:
        InputError: nothing, or a list that cannot be read.
    """
    if path.is_dir():
        some = [(p, _label(p, path), "") for p in sorted(_walk(path, _Seen()))]
        if not some:
            raise InputError(f"no mesh, photo or URDF in {path} (assets are passed over)")
        yield from some
    elif path.is_file() and path.suffix.lower() in LISTS:
        own = path.resolve()
        if own in within:
            raise InputError(f"the list {path} names itself")
        if own in seen.lists:
            return
        seen.lists.add(own)
        yield from _paths(_lines(path), path.parent, (*within, own), seen)
    elif path.is_file():
        yield path, path.stem, ""
    elif any(c in word for c in "*?["):
        fixed = Path(*[p for p in _before_pattern(path)])
        files = sorted(_fitting(fixed, path.parts[len(fixed.parts) :]))
        if not files:
            raise InputError(f"no file fits {word!r}")
        yield from ((p, _label(p, fixed), "") for p in files)
    elif path.exists():
        raise InputError(f"{path} is no ordinary file")
    else:
        raise InputError(f"no such file or folder: {path}")


def _lines(path: Path) -> list[str]:
    """The words of a list, without comments."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"the list {path} is not text in UTF-8") from None
    lines = [line.strip() for line in text.splitlines()]
    return [line for line in lines if line and not line.startswith("#")]


def _before_pattern(path: Path) -> Iterator[str]:
    for part in path.parts[:-1]:
        if any(c in part for c in "*?["):
            return
        yield part


def _fitting(folder: Path, pattern: tuple[str, ...]) -> Iterator[Path]:
    """Files below a folder that fit a pattern, each folder looked through once."""
    if not folder.is_dir():
        return
    levels = WALK.deep + 1 if "**" in pattern else len(pattern)
    seen, left = _Seen(), [(folder, 1)]
    while left:
        at, deep = left.pop()
        for entry in seen.entries_of(at, deep):
            if entry.name.startswith(".") and not pattern[-1].startswith("."):
                continue
            if entry.is_dir():
                left += [(entry, deep + 1)] if deep < levels else []
            elif entry.is_file() and _fits(entry.relative_to(folder).parts, pattern):
                yield entry


def _fits(parts: Sequence[str], pattern: Sequence[str]) -> bool:
    """Whether a path fits a pattern, of which ** stands for any folders."""

    def reached(steps: set[int]) -> set[int]:
        for i in range(len(pattern)):
            steps |= {i + 1} if i in steps and pattern[i] == "**" else set()
        return steps

    at = reached({0})
    for part in parts:
        inside = [i for i in at if i < len(pattern)]
        stay = {i for i in inside if pattern[i] == "**"}
        at = reached(stay | {i + 1 for i in inside if fnmatch.fnmatchcase(part, pattern[i])})
    return len(pattern) in at


def _label(path: Path, base: Path) -> str:
    return "-".join(path.relative_to(base).with_suffix("").parts)


def _walk(folder: Path, seen: _Seen, pictures: bool = True, deep: int = 1) -> Iterator[Path]:
    if (folder / "asset.json").is_file():
        return
    inside = [p for p in seen.entries_of(folder, deep) if not p.name.startswith(".")]
    files = [p for p in inside if p.is_file()]
    urdfs = [p for p in files if p.suffix.lower() in SIMULATED]
    if urdfs:
        yield from urdfs
        return
    meshes = [p for p in files if p.suffix.lower() in mesh_suffixes()]
    yield from meshes
    pictures = pictures and not meshes
    if pictures:
        yield from (p for p in files if p.suffix.lower() in PHOTOS)
    for inner in inside:
        if inner.is_dir():
            yield from _walk(inner, seen, pictures, deep + 1)


def content_digest(path: Path) -> str:
    """SHA-256 of a file and of those that it names (materials, pictures, a URDF's meshes), hex."""
    digest = hashlib.sha256()
    for file in files_of(path):
        digest.update(file_digest(file).encode())
    return digest.hexdigest()
