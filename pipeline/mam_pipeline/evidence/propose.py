"""What the file's structure and the object's kind propose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mam_pipeline.evidence.kinds import kinds
from mam_pipeline.evidence.spec import CERTAIN, KinematicSpec, PartStatement, movable_kind
from mam_pipeline.types import JointSubtype


@dataclass(frozen=True)
class Meant:
    """How often a source means what it says, 0..1.

    Attributes:
        node: names of nodes and groups. material: names of materials. shown: animations.
        shape: an origin on an edge of a nameless node's box.
    """

    node: float = 0.95
    material: float = 0.75
    shown: float = 0.98
    shape: float = 1.0


MEANT = Meant()


def chance_of(part: PartStatement) -> float:
    """That a stated part moves by itself, by its statement alone."""
    meant = {
        "material": MEANT.material, "animation": MEANT.shown, "hierarchy": MEANT.shape,
    }.get(part.said.origin, MEANT.node)  # fmt: skip
    return float(np.clip(meant * part.chance, 0.0, 1.0)) if part.movable else 0.0


@dataclass(frozen=True)
class Expected:
    """What the object's kind, and a person's counts, let one expect.

    Attributes:
        moves: chance that anything moves. often: chance that anything moves so, by subtype.
        number: usual number of moving parts by subtype.
        told: how many of each kind a person said there are; empty where nobody did.
        certainty: of the word for the object, 0..1.
    """

    moves: float
    often: Mapping[JointSubtype, float]
    number: Mapping[JointSubtype, float]
    told: Mapping[str, int]
    certainty: float

    def share(self, subtype: JointSubtype) -> float:
        """How usual it is beside the others that a part moves so; they sum to 1."""
        total = sum(self.often.values())
        return self.often.get(subtype, 0.0) / total if total else 1.0 / 3.0


def expected_of(spec: KinematicSpec) -> Expected | None:
    """What may be expected of the object; None where nobody says what it is or counts."""
    told = {c.kind: c.count for c in spec.counts if c.said.certainty >= CERTAIN}
    number: dict[JointSubtype, float] = {"hinge": 0.0, "spin": 0.0, "slide": 0.0}
    if told:
        for kind, count in told.items():
            subtype = movable_kind(kinds().parts[kind].moves)
            if subtype is not None:
                number[subtype] += count
        return Expected(1.0 if sum(told.values()) else 0.0, dict(number), number, told, CERTAIN)
    if not spec.objects:
        return None
    first = spec.objects[0]
    thing = kinds().objects[first.word]
    none = dict.fromkeys(number, 1.0)
    for part in thing.parts:
        subtype = movable_kind(part.moves)
        assert subtype is not None
        number[subtype] += part.often * float(np.sqrt(part.least * part.most))
        none[subtype] *= 1.0 - part.often
    often = {subtype: 1.0 - share for subtype, share in none.items()}
    return Expected(thing.moves, often, number, {}, first.said.certainty)
