"""The kinematic specification: a typed, partly filled statement of what is known of an object.

Whatever knows something beside geometry says it here: a person (hints, `--what`), names in the
file, its node hierarchy, its animation. Every statement says where it comes from and how certain it
is. A person's are obeyed; the others weigh against what geometry and physics say.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal, Protocol, Self, runtime_checkable

import numpy as np

from mam_pipeline.hints import Hints
from mam_pipeline.types import FloatArray, JointSubtype, Mesh, readonly

Origin = Literal[
    "user", "name", "material", "file name", "animation", "hierarchy", "language model"
]
Moves = Literal["fixed", "hinge", "spin", "slide", "with", ""]
CERTAIN = 1.0
"""Certainty of what a person said."""


@dataclass(frozen=True)
class Said:
    """Who says something: `detail` is the word, node or file; `certainty` 0..1, 1 is obeyed."""

    origin: Origin
    detail: str = ""
    certainty: float = CERTAIN


@dataclass(frozen=True)
class ObjectWord:
    """What the whole thing is.

    Attributes:
        word: its kind in the table. kinds: of the parts that such a thing may move, the most
            usual first.
    """

    word: str
    kinds: tuple[str, ...]
    said: Said


@dataclass(frozen=True)
class PartStatement:
    """One part, as far as it is known.

    Attributes:
        name: as it stands in the source. kind: of part, in the table of kinds.
        moves: how; "fixed" stands still, "with" goes along with its neighbour, "" unknown.
        groups: names of `Mesh.group_names` whose faces it has.
        materials: names of materials whose faces it has, where no group says.
        line: "upright" or "level" where the hinge of such a part usually lies so; else "".
        side: on which the hinge of such a part usually sits, or to which it slides.
        travel: how far such a part usually goes: degrees, or share of the body's depth.
        chance: that such a part moves by itself, where the source means what it says, 0..1.
        axis, origin: of the joint, in the frame of the mesh; None where nobody says.
        limits: (lower, upper), rad or m, infinite for endless; None where nobody says.
    """

    name: str
    kind: str
    moves: Moves
    said: Said
    groups: tuple[str, ...] = ()
    materials: tuple[str, ...] = ()
    line: str = ""
    side: tuple[str, ...] = ()
    travel: tuple[float, float] | None = None
    chance: float = 0.0
    axis: FloatArray | None = None
    origin: FloatArray | None = None
    limits: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        for name in ("axis", "origin"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, readonly(value, np.float64, (3,)))

    @property
    def movable(self) -> bool:
        """Whether it is said to move by itself."""
        return self.moves in ("hinge", "spin", "slide")

    def faces(self, mesh: Mesh) -> np.ndarray:
        """(F,) mask of its faces."""
        assert mesh.face_group is not None and mesh.face_material is not None
        if self.groups:
            chosen = [k for k, name in enumerate(mesh.group_names) if name in self.groups]
            return np.isin(mesh.face_group, chosen)
        wanted = [k for k, m in enumerate(mesh.materials) if m.name in self.materials]
        return np.isin(mesh.face_material, wanted)


@dataclass(frozen=True)
class KindCount:
    """How many parts of a kind there are, as somebody said."""

    kind: str
    count: int
    said: Said


@dataclass(frozen=True)
class KinematicSpec:
    """All that is known; an empty one says nothing.

    Attributes:
        hints: what a person (or the photo reconstructor) says of single parts; obeyed.
        objects: what the thing is, the most certain first. parts: what is said of its parts.
        counts: how many of a kind. alike: names of groups that are copies of one mesh.
        notes: what was read and what was not, in words.
    """

    hints: Hints | None = None
    objects: tuple[ObjectWord, ...] = ()
    parts: tuple[PartStatement, ...] = ()
    counts: tuple[KindCount, ...] = ()
    alike: tuple[tuple[str, ...], ...] = ()
    notes: tuple[str, ...] = field(default_factory=tuple)

    @property
    def empty(self) -> bool:
        """Whether nothing is said beside the hints."""
        return not (self.objects or self.parts or self.counts or self.alike)


NOTHING = KinematicSpec()


@runtime_checkable
class Informed(Protocol):
    """A backend that listens to what is known beside geometry."""

    def with_spec(self, spec: KinematicSpec) -> Self:
        """The same backend with this knowledge."""
        ...


def stated_groups(spec: KinematicSpec) -> frozenset[str]:
    """Groups whose border is a border of parts."""
    return frozenset(g for p in spec.parts if p.movable for g in p.groups)


def movable_kind(moves: str) -> JointSubtype | None:
    """The subtype, where a statement says one."""
    table: dict[str, JointSubtype] = {"hinge": "hinge", "spin": "spin", "slide": "slide"}
    return table.get(moves)


def told(parts: Sequence[PartStatement]) -> str:
    """A sentence on statements, for the card and the screen; empty for none."""
    by: dict[tuple[str, str], list[str]] = {}
    for part in parts:
        if part.movable:
            by.setdefault((part.said.origin, part.kind), []).append(part.name)
    words = []
    for (origin, kind), names in by.items():
        first = ", ".join([*names[:4], *(["…"] if len(names) > 4 else [])])
        words.append(f"{len(names)} × {kind or 'part'} by {origin} ({first})")
    return f"the file says: {'; '.join(words)}" if words else ""
