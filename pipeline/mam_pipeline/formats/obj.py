"""Wavefront OBJ and MTL reading that keeps objects, texture files and coordinates."""

from __future__ import annotations

import os
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.errors import InputError
from mam_pipeline.formats.door import Door
from mam_pipeline.formats.pictures import (
    Picture,
    Pictures,
    find,
    model_door,
    readable,
)
from mam_pipeline.formats.soup import LIMITS, Budget, FileContent, Piece, fans, paired
from mam_pipeline.types import FloatArray, IntArray, Material

_NO_SURFACE = {
    "p": "points", "l": "lines", "curv": "curves", "curv2": "curves", "surf": "curved surfaces",
}  # fmt: skip
_BLOCK = 1 << 16  # lines that are parsed together


def read_obj(path: Path, root: Path | None = None) -> FileContent:
    """Read the polygons of an OBJ file, fans of triangles, with the materials of its MTL files.

    A vertex is made for every distinct pair of position and texture coordinate; V is flipped to
    the glTF convention. Names may be of any encoding and hold spaces.

    Args:
        path: the file. root: folder whose files it may name; default: its own.

    Raises:
        InputError: a line is malformed or a face names a vertex that does not exist.
    """
    state = _State(path, Budget(path), model_door(path, root))
    for number, line in _lines(path):
        key = line[:2]
        if key in ("v ", "f "):
            rows = state.v if key == "v " else state.f
            rows.add(number, line[2:])
            continue
        words = line.split()
        if not words or words[0][0] == "#":
            continue
        try:
            state.line(words, number, line)
        except (ValueError, IndexError) as error:
            raise _malformed(path, number, line) from error
    return state.content()


def _malformed(path: Path, number: int, line: str) -> InputError:
    shown = line.strip() if len(line) < 80 else f"{line.strip()[:77]}..."
    return InputError(f"{path}, line {number}: not valid OBJ ({shown!r})")


def _lines(path: Path) -> Iterator[tuple[int, str]]:
    """Lines of a text file with their numbers, one at a time; a backslash at the end joins two."""
    held = ""
    with path.open(encoding=_encoding(path), errors="surrogateescape") as file:
        whole = partial(file.readline, LIMITS.line + 1)  # a file may be one line without an end
        for number, line in enumerate(iter(whole, ""), start=1):
            if len(held) + len(line) > LIMITS.line:
                raise InputError(f"{path}, line {number}: longer than {LIMITS.line >> 20} MiB")
            if line.endswith("\\\n"):
                held += line[:-2] + " "
                continue
            yield number, held + line
            held = ""
    if held:
        yield number, held


def _encoding(path: Path) -> str:
    """UTF-16 says so by its first bytes; all else is ASCII with names in some encoding."""
    with path.open("rb") as file:
        head = file.read(2)
    return "utf-16" if head in (b"\xff\xfe", b"\xfe\xff") else "utf-8-sig"


class _Numbers:
    """Lines of numbers, parsed a block at a time."""

    def __init__(self, path: Path, key: str, least: int, budget: Budget) -> None:
        self.path, self.key, self.least, self.budget = path, key, least, budget
        self.count = 0
        self.arrays: list[FloatArray] = []
        self._rows: list[str] = []
        self._at: list[int] = []

    def add(self, number: int, rest: str) -> None:
        """A line without its first word."""
        self._rows.append(rest)
        self._at.append(number)
        self.count += 1
        if len(self._rows) >= _BLOCK:
            self.flush()

    def flush(self) -> None:
        rows, at = self._rows, self._at
        self._rows, self._at = [], []
        if rows:
            self.budget.triangles(len(rows), 0)
            self.arrays.append(self._parsed(rows, at))

    def _parsed(self, rows: list[str], at: list[int]) -> FloatArray:
        """(n, k) numbers; lines of several lengths keep what all of them have, 6 at most."""
        flat = _numbers(" ".join(rows), np.float64)
        width = len(flat) // len(rows)
        even = width >= self.least and width * len(rows) == len(flat)
        if even and all(len(row.split()) == width for row in rows):
            return flat.reshape(-1, width)
        found = []
        for number, row in zip(at, rows):
            try:
                numbers = [float(w) for w in row.partition("#")[0].split()[:6]]
                if self.key == "vt":  # a strip of texture has no second number
                    numbers = [*numbers, 0.0][: max(len(numbers), 2)]
                if len(numbers) < self.least:
                    raise ValueError("too few numbers")
            except ValueError as error:
                raise _malformed(self.path, number, f"{self.key} {row}") from error
            found.append(numbers)
        least = min(map(len, found))
        return np.array([numbers[:least] for numbers in found])

    def table(self, width: int) -> FloatArray:
        """All rows, cut to one width."""
        self.flush()
        if not self.arrays:
            return np.zeros((0, width))
        return np.concatenate([a[:, :width] for a in self.arrays])


@dataclass
class _Faces:
    """Faces as triangles, parsed a block at a time.

    Attributes:
        corners: blocks of (F, 3, 2) indices of position and texture coordinate, -1 for none.
        runs: blocks of (F,) indices of the group and material that each belongs to.
    """

    path: Path
    budget: Budget
    state: _State
    corners: list[IntArray] = field(default_factory=list)
    runs: list[IntArray] = field(default_factory=list)
    _rows: list[tuple[int, str, int, int, int]] = field(default_factory=list)

    def add(self, number: int, rest: str) -> None:
        """A line without its first word; it may name the vertices that came before it."""
        state = self.state
        self._rows.append((number, rest, state.v.count, state.vt.count, state.run))
        if len(self._rows) >= _BLOCK:
            self.flush()

    def flush(self) -> None:
        rows, self._rows = self._rows, []
        if not rows:
            return
        words = [row[1].partition("#")[0].split() for row in rows]
        counts = np.array(list(map(len, words)), dtype=np.int64)
        index = self._parsed([corner for row in words for corner in row], counts, rows)
        seen: IntArray = np.array([row[2:4] for row in rows], dtype=np.int64)
        seen = np.repeat(seen, counts, axis=0)
        # 1 is the first, -1 the last so far; 0 stands for no texture coordinate
        index = np.where(index > 0, index - 1, seen + index)
        missing = index[:, 1] == seen[:, 1]
        index[missing, 1] = -1
        bad = (index[:, 0] < 0) | (index[:, 0] >= seen[:, 0])
        bad |= (index[:, 1] < -1) | (index[:, 1] >= np.maximum(seen[:, 1], 0))
        if bad.any():
            row = rows[int(np.repeat(np.arange(len(rows)), counts)[int(np.argmax(bad))])]
            raise _malformed(self.path, row[0], f"f {row[1]}")
        triangles, polygon = fans(counts)
        self.budget.triangles(0, len(triangles))
        self.corners.append(index[triangles])
        self.runs.append(np.array([row[4] for row in rows], dtype=np.int64)[polygon])

    def _parsed(
        self, flat: list[str], counts: IntArray, rows: list[tuple[int, str, int, int, int]]
    ) -> IntArray:
        """(n, 2) numbers of position and texture coordinate as they stand in the file."""
        slashes = {corner.count("/") for corner in flat}
        text = " ".join(flat)
        between = text.count("//")
        if slashes <= {0, 1, 2} and len(slashes) == 1 and between in (0, len(flat)):
            width = slashes.pop() + 1 - (1 if between else 0)
            numbers = _numbers(text.replace("//", " ").replace("/", " "), np.int64)
            if len(numbers) == width * len(flat):
                table = numbers.reshape(-1, width)
                textured = width > 1 and not between
                second = table[:, 1] if textured else np.zeros(len(flat), np.int64)
                return np.stack([table[:, 0], second], axis=1)
        out = []
        for row, count in zip(rows, counts):
            try:
                for corner in row[1].partition("#")[0].split()[:count]:
                    p, _, rest = corner.partition("/")
                    t = rest.partition("/")[0]
                    out.append((np.int64(int(p)), np.int64(int(t) if t else 0)))
            except (ValueError, OverflowError) as error:
                raise _malformed(self.path, row[0], f"f {row[1]}") from error
        return np.array(out, dtype=np.int64).reshape(-1, 2)


def _numbers(text: str, dtype: Any) -> NDArray[Any]:
    """Numbers between blanks; fewer than there are where one of them is none."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        plain = text.encode("ascii", "replace").decode("ascii")
        return np.fromstring(plain, dtype, sep=" ")


@dataclass
class _State:
    """What has been read so far of one OBJ file."""

    path: Path
    budget: Budget
    door: Door
    v: _Numbers = field(init=False)
    vt: _Numbers = field(init=False)
    f: _Faces = field(init=False)
    group: str = "mesh"
    material: int = -1
    materials: list[Material] = field(default_factory=list)
    names: dict[str, int] = field(default_factory=dict)
    library: dict[str, Material] = field(default_factory=dict)
    libraries: set[str] = field(default_factory=set)
    missing: list[str] = field(default_factory=list)
    dropped: Counter[str] = field(default_factory=Counter)
    pictures: Pictures = field(init=False)
    runs: dict[tuple[str, int], int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.pictures = Pictures(self.path, self.budget, self.door)
        self.v = _Numbers(self.path, "v", 3, self.budget)
        self.vt = _Numbers(self.path, "vt", 1, self.budget)
        self.f = _Faces(self.path, self.budget, self)

    @property
    def run(self) -> int:
        """Index of the group and material that faces now belong to."""
        if self.material < 0:
            self.material = self.named("default")
        return self.runs.setdefault((self.group, self.material), len(self.runs))

    def line(self, words: list[str], number: int, raw: str) -> None:
        key = words[0]
        if key in ("v", "vt", "f"):
            rows = self.f if key == "f" else self.v if key == "v" else self.vt
            rows.add(number, " ".join(words[1:]))
        elif key in ("o", "g"):
            self.group = readable(" ".join(words[1:])) or "mesh"
        elif key == "usemtl":
            self.material = self.named(" ".join(words[1:]))
        elif key == "mtllib":
            self.read_libraries(raw.split(None, 1)[1].strip())
        elif key in _NO_SURFACE:
            self.dropped[_NO_SURFACE[key]] += 1

    def read_libraries(self, told: str) -> None:
        """One library whose name may hold spaces, or several."""
        names = [told] if find(told, self.path, self.door) is not None else told.split()
        for name in names:
            if name in self.libraries:
                continue
            self.libraries.add(name)
            file = find(name, self.path, self.door)
            if file is None:
                self.missing.append(readable(name))
            else:
                self.library.update(_read_mtl(file, self.pictures))

    def named(self, name: str) -> int:
        if name not in self.names:
            self.names[name] = len(self.materials)
            self.materials.append(
                self.library.get(name, Material(name=readable(name) or "default"))
            )
        return self.names[name]

    def content(self) -> FileContent:
        self.f.flush()
        table = self.v.table(6)
        points, uvs = table[:, :3], self.vt.table(2)
        if uvs.shape[1] == 1:
            uvs = np.pad(uvs, ((0, 0), (0, 1)))
        colored = table.shape[1] == 6
        pieces = []
        runs = np.concatenate(self.f.runs) if self.f.runs else np.zeros(0, dtype=np.int64)
        blocks = self.f.corners or [np.zeros((0, 3, 2), dtype=np.int64)]
        corners: IntArray = np.concatenate(blocks)
        order = np.argsort(runs, kind="stable")
        ends = np.cumsum(np.bincount(runs, minlength=len(self.runs)))
        for (group, material), rows in zip(self.runs, np.split(order, ends[:-1])):
            if not len(rows):
                continue
            pairs, faces = paired(corners[rows].reshape(-1, 2))
            uv = colors = None
            if len(uvs) and (pairs[:, 1] >= 0).any():
                uv = _flip(np.vstack([uvs, [0.0, 1.0]])[pairs[:, 1]])  # the last for those without
            if colored:
                colors = _rgba(table[pairs[:, 0], 3:])
            pieces.append(Piece(points[pairs[:, 0]], faces, group, material, uv, colors))
        notes = self.pictures.notes()
        if self.missing:
            notes += (f"material files not found: {', '.join(self.missing)}; the colours are lost",)
        if self.dropped:
            notes += (f"not taken over: {', '.join(sorted(self.dropped))}",)
        return FileContent(tuple(pieces), tuple(self.materials) or (Material(),), notes=notes)


def _rest(line: str) -> str:
    """A line without its first word."""
    words = line.split(None, 1)
    return words[1].strip() if len(words) > 1 else ""


def _read_mtl(file: Path, pictures: Pictures) -> dict[str, Material]:
    """Materials of a library by name."""
    out: dict[str, dict[str, str]] = {}
    current: dict[str, str] = {}
    data = pictures.budget.read(file)
    text = data.decode(_encoding(file), "surrogateescape")
    for line in text.splitlines():
        key, _, _ = line.strip().partition(" ")
        key = key.split("\t")[0].lower()
        if key == "newmtl":
            current = out.setdefault(" ".join(line.split()[1:]), {})
        elif key in ("kd", "d", "tr", "pm", "pr", "map_kd"):
            current[key] = _rest(line)
    return {name: _material(name, raw, file, pictures) for name, raw in out.items()}


def _material(name: str, raw: dict[str, str], file: Path, pictures: Pictures) -> Material:
    def numbers(key: str, *default: float) -> list[float]:
        try:
            found = [float(w) for w in raw[key].split()[: len(default)]]
        except (KeyError, ValueError):
            found = []
        return found if len(found) == len(default) else list(default)

    (alpha,) = numbers("d", 1.0 - numbers("tr", 0.0)[0])
    r, g, b = numbers("kd", *([1.0] * 3 if "kd" not in raw else [0.7] * 3))
    picture = _picture(raw["map_kd"], file, pictures) if "map_kd" in raw else None
    if picture is not None and max(r, g, b) == 0.0:  # exporters write black under a texture
        r = g = b = 1.0
    return Material(
        readable(name) or "default",
        (r, g, b, alpha),
        None if picture is None else picture.data,
        None if picture is None else picture.kind,
        numbers("pm", 0.0)[0],
        numbers("pr", 0.8)[0],
    )


def _picture(told: str, file: Path, pictures: Pictures) -> Picture | None:
    """The texture of a map_Kd line; options such as "-s 1 1 1" come before its name."""
    words = told.split()
    names = [" ".join(words[i:]) for i in range(len(words))] if told[:1] == "-" else [told]
    for name in names:
        beside = os.path.join(os.path.relpath(file.parent, pictures.by.parent), name)
        for option in (name, beside):
            if find(option, pictures.by, pictures.door) is not None:
                return pictures.named(option)
    return pictures.named(names[-1]) if names else None


def _flip(uv: NDArray[np.float64]) -> NDArray[np.float32]:
    return np.stack([uv[:, 0], 1.0 - uv[:, 1]], axis=1).astype(np.float32)


def _rgba(rgb: NDArray[np.float64]) -> NDArray[np.uint8]:
    scale = 255.0 if rgb.max() <= 1.0 else 1.0
    out = np.full((len(rgb), 4), 255, np.uint8)
    out[:, :3] = np.clip(np.round(rgb * scale), 0, 255)
    return out
