"""The table of kinds: what kinds of parts and of objects there are, and the words for them.

A kind proposes and weighs, it never forbids: it says which parts such a thing usually moves, how,
on which side, in what number and how often, and how large such a thing is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import prod
from typing import Any, Literal, get_args

from mam_pipeline.evidence.spec import Moves
from mam_pipeline.evidence.words import words_of
from mam_pipeline.package_data import table

Line = Literal["", "upright", "level"]
Side = Literal["left", "right", "top", "bottom", "front", "back", "middle"]
Range = tuple[float, float, float]
Words = Mapping[str, tuple[str, frozenset[str]]]
"""Normalised word -> (kind, languages that have it)."""


@dataclass(frozen=True)
class PartKind:
    """How parts of a kind usually move.

    Attributes:
        kind: its name. moves: how, "fixed" or "with" its neighbour.
        sure: share of the things of that name that move at all.
        line: how its axis usually lies, "" where it may lie in any way.
        side: where a hinge sits, or to which side a slide goes; empty where any will do.
        travel: degrees of a hinge, share of the body's depth of a slide; None where it has no ends.
        mirrored: two of them side by side open away from each other.
        opposite: its handle lies far from its hinge.
        place: its word also says where another part is.
    """

    kind: str
    moves: Moves
    sure: float
    line: Line = ""
    side: tuple[Side, ...] = ()
    travel: tuple[float, float] | None = None
    mirrored: bool = False
    opposite: bool = False
    place: bool = False

    def __post_init__(self) -> None:
        _check(self.kind, self.moves in get_args(Moves) and self.moves != "", "moves", self.moves)
        _check(self.kind, 0.0 <= self.sure <= 1.0, "sure", self.sure)
        _check_motion(self.kind, self.line, self.side, self.travel)


@dataclass(frozen=True)
class UsualPart:
    """A part that a kind of object has and moves.

    Attributes:
        kind: of `PartKind`. moves, line, side, travel: as in `PartKind`, for this object.
        least, most: how many of them move where any does.
        often: share of such objects in which any of them moves.
    """

    kind: str
    moves: Moves
    line: Line
    side: tuple[Side, ...]
    travel: tuple[float, float] | None
    least: int
    most: int
    often: float

    def __post_init__(self) -> None:
        _check(self.kind, self.moves in ("hinge", "spin", "slide"), "moves", self.moves)
        _check(self.kind, 1 <= self.least <= self.most, "number", (self.least, self.most))
        _check(self.kind, 0.0 < self.often <= 1.0, "often", self.often)
        _check_motion(self.kind, self.line, self.side, self.travel)


@dataclass(frozen=True)
class ObjectKind:
    """What the world knows of a kind of object.

    Attributes:
        kind: its name. parts: that such a thing may move, the most usual first.
        still: kinds of parts that never move in it.
        size: lowest, usual and highest largest side, metres.
        mass: the same of the whole, kilograms; None where it is not known.
        material: of `asset/matter.yaml`; "" where it is not known. machine: the body has a motor,
            a tank or a weight inside that is not seen.
    """

    kind: str
    parts: tuple[UsualPart, ...]
    still: tuple[str, ...]
    size: Range
    mass: Range | None
    material: str = ""
    machine: bool = False

    def __post_init__(self) -> None:
        for name, values in (("size", self.size), ("mass", self.mass)):
            ordered = values is None or 0.0 < values[0] <= values[1] <= values[2]
            _check(self.kind, ordered, name, values)

    @property
    def moves(self) -> float:
        """Share of such objects in which anything moves."""
        return 1.0 - prod(1.0 - part.often for part in self.parts)

    def part(self, kind: str) -> UsualPart | None:
        """The usual part of a kind; None where such a thing has none that moves."""
        return next((p for p in self.parts if p.kind == kind), None)


@dataclass(frozen=True)
class Kinds:
    """The whole table: kinds by name, and the words for them."""

    parts: Mapping[str, PartKind]
    objects: Mapping[str, ObjectKind]
    part_words: Words
    object_words: Words

    def __post_init__(self) -> None:
        for thing in self.objects.values():
            for name in (*(p.kind for p in thing.parts), *thing.still):
                _check(thing.kind, name in self.parts, "part", name)
        for kinds, words in ((self.parts, self.part_words), (self.objects, self.object_words)):
            named = {kind for kind, _ in words.values()}
            for kind in kinds:
                _check(kind, kind in named, "words", "none")
            for kind in named:
                _check(kind, kind in kinds, "kind of its words", "unknown")


@lru_cache(maxsize=1)
def kinds() -> Kinds:
    """The embedded table.

    Raises:
        ValueError: the table contradicts itself.
    """
    data = table("mam_pipeline.evidence", "kinds.yaml")
    parts = {name: _part(name, row) for name, row in data["parts"].items()}
    return Kinds(
        parts,
        {name: _object(name, data, parts) for name in data["kinds"]},
        index_of(data["part_words"]), index_of(data["kind_words"]),
    )  # fmt: skip


def usual_size(kind: str) -> Range | None:
    """Lowest, usual and highest largest side of a kind of object, metres; None if unknown."""
    known = kinds().objects.get(kind)
    return None if known is None else known.size


def index_of(words: Mapping[str, Mapping[str, str]]) -> dict[str, Any]:
    """Normalised word -> (kind, languages).

    Args:
        words: by kind and language, parted by blanks.

    Raises:
        ValueError: two kinds have one word.
    """
    out: dict[str, tuple[str, frozenset[str]]] = {}
    for kind, languages in words.items():
        for language, spelled in languages.items():
            for word in spelled.split():
                key = "".join(words_of(word))
                owner, known = out.setdefault(key, (kind, frozenset()))
                _check(kind, owner == kind, f"word, which {owner!r} has too", word)
                out[key] = (kind, known | {language})
    return out


def _part(name: str, row: Mapping[str, Any]) -> PartKind:
    return PartKind(
        name, row["moves"], float(row["sure"]), row.get("line", ""), tuple(row.get("side", ())),
        _pair(row.get("travel")), row.get("pairs") == "mirror", row.get("handle") == "opposite",
        bool(row.get("place", False)),
    )  # fmt: skip


def _object(name: str, data: Mapping[str, Any], parts: Mapping[str, PartKind]) -> ObjectKind:
    row = _inherited(name, data)
    found = []
    for kind, told in row.get("parts", {}).items():
        if told is None:
            continue
        if kind not in parts:
            raise ValueError(f"kinds.yaml: {name!r} has an unknown part {kind!r}")
        found.append(_usual(parts[kind], told))
    found.sort(key=lambda p: -p.often)
    mass = row.get("mass")
    return ObjectKind(
        name, tuple(found), tuple(row.get("still", ())), _range(row["size"]),
        None if mass is None else _range(mass), row.get("material", ""),
        bool(row.get("machine", False)),
    )  # fmt: skip


def _usual(part: PartKind, told: Sequence[float] | Mapping[str, Any]) -> UsualPart:
    """A part as it is in one kind of object."""
    row = _row(told)
    moves = row.get("moves", part.moves)
    same = moves == part.moves
    return UsualPart(
        part.kind, moves, row.get("line", part.line if same else ""),
        tuple(row.get("side", part.side if same else ())),
        _pair(row.get("travel", part.travel if same else None)),
        int(row["n"][0]), int(row["n"][1]), float(row["often"]),
    )  # fmt: skip


def _inherited(name: str, data: Mapping[str, Any], depth: int = 0) -> dict[str, Any]:
    """A row with all that it takes from the kinds that it is like."""
    row = data["kinds"].get(name) or data["families"].get(name)
    if row is None or depth > len(data["families"]):
        raise ValueError(f"kinds.yaml: {name!r} is no kind that another can be like")
    if "like" not in row:
        return dict(row)
    above = _inherited(row["like"], data, depth + 1)
    parts = dict(above.get("parts", {}))
    for kind, told in row.get("parts", {}).items():
        parts[kind] = None if told is None else {**_row(parts.get(kind)), **_row(told)}
    return {**above, **row, "parts": parts}


def _row(told: Sequence[float] | Mapping[str, Any] | None) -> dict[str, Any]:
    """What is said of a part, by name; a list is [least, most, often]."""
    if told is None or isinstance(told, Mapping):
        return dict(told or {})
    return {"n": told[:2], "often": told[2]}


def _pair(values: Sequence[float] | None) -> tuple[float, float] | None:
    return None if values is None else (float(values[0]), float(values[1]))


def _range(values: Sequence[float]) -> Range:
    low, usual, high = (float(v) for v in values)
    return low, usual, high


def _check_motion(
    kind: str, line: str, side: Sequence[str], travel: tuple[float, float] | None
) -> None:
    _check(kind, line in get_args(Line), "line", line)
    _check(kind, set(side) <= set(get_args(Side)), "side", side)
    _check(kind, travel is None or 0.0 < travel[0] <= travel[1], "travel", travel)


def _check(kind: str, right: bool, what: str, value: object) -> None:
    if not right:
        raise ValueError(f"kinds.yaml: {kind!r} has a wrong {what}: {value!r}")
