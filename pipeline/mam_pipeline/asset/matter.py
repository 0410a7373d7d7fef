"""What parts are made of, what their joints feel like, and what such a thing weighs.

`matter.yaml` has materials and bearings with their sources; the table of kinds says what an object
is made of and what it weighs at its size.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, TypeVar

import numpy as np

from mam_pipeline.evidence.kinds import ObjectKind, Range, kinds
from mam_pipeline.holding import Catch
from mam_pipeline.package_data import table
from mam_pipeline.types import Inertial


@dataclass(frozen=True)
class Material:
    """What a part is made of.

    Attributes:
        density: kg/m3.
        wall: thickness of a housing's wall, and of a sheet without a back, metres.
        solid: pieces up to this thick are solid, thicker ones hollow, metres.
        friction: Coulomb's coefficient of contacts. restitution: share of the speed after a hit.
        spread: factor by which a mass may be smaller or larger.
        source: where the density comes from.
    """

    name: str
    density: float
    wall: float
    solid: float
    friction: float
    restitution: float
    spread: float
    source: str

    @property
    def words(self) -> str:
        """The assumption in words, for the card."""
        return (
            f"{self.name}, {self.density:.0f} kg/m3, solid up to {1e3 * self.solid:g} mm, "
            f"else walls of {1e3 * self.wall:g} mm"
        )


@dataclass(frozen=True)
class Bearing:
    """What a joint's friction is made of, gravity's load aside.

    Attributes:
        force: N; of a hinge, at its farthest edge. share: of the weight that is carried.
        torque: N m, of what fingers turn; 0 where the force says it.
        spread: factors on the friction, from the easiest to the stiffest that are usual.
        source: where the figures come from.
    """

    name: str
    force: float
    share: float
    torque: float
    spread: tuple[float, float]
    source: str

    def friction(self, weight: float, arm: float, slides: bool) -> float:
        """Friction of a joint, N of a slide and N m of a hinge.

        Args:
            weight: that the joint carries, N. arm: of the farthest point, metres.
            slides: the joint is a slide.
        """
        force = self.force + self.share * weight
        if slides:
            return force or self.torque / arm
        return self.torque or force * arm


@dataclass(frozen=True)
class CatchKind:
    """What keeps parts of a kind closed besides friction.

    Attributes:
        things, parts: kinds of objects, and of their parts, that have it.
        force: N; of a hinge, at its farthest edge. spread: factors on it, as of a bearing.
        width: of the way on which it pulls, degrees of a hinge and metres of a slide.
        source: where the figures come from.
    """

    name: str
    things: tuple[str, ...]
    parts: tuple[str, ...]
    force: float
    spread: tuple[float, float]
    width: float
    source: str

    def on(self, arm: float, slides: bool) -> Catch:
        """The catch of a joint.

        Args:
            arm: of the farthest point, metres. slides: the joint is a slide.
        """
        force = self.force * (1.0 if slides else arm)
        low, high = self.spread
        width = self.width if slides else math.radians(self.width)
        return Catch(self.name, force, (low * force, high * force), width, self.source)


@dataclass(frozen=True)
class BalanceKind:
    """Springs or weights that carry parts of a kind.

    Attributes:
        things, parts: kinds of objects, and of their parts, that have them.
        joints: types of the parts' joints.
        source: who says so.
    """

    name: str
    things: tuple[str, ...]
    parts: tuple[str, ...]
    joints: tuple[str, ...]
    source: str


@dataclass(frozen=True)
class MassRule:
    """How far what a thing weighs is believed.

    Attributes:
        spread: factor on the usual mass of such a thing at its size, down and up; nine of ten of
            the products that set the table of kinds are within it (benchmarks/masses.yaml).
        size: a thing beyond its kind's sizes by this factor is a model of one, and weighs anything.
    """

    spread: float = 1.4
    size: float = 1.3


RULE = MassRule()
BOARD = "particle board"
"""Of what a thing is that nobody knows."""


OfParts = TypeVar("OfParts", CatchKind, BalanceKind)


@dataclass(frozen=True)
class _Table:
    materials: dict[str, Material]
    parts: dict[str, str]
    bearings: dict[str, Bearing]
    joints: dict[str, str]
    catches: tuple[CatchKind, ...]
    balances: tuple[BalanceKind, ...]
    others: dict[str, str]


@lru_cache(maxsize=1)
def _read() -> _Table:
    data: dict[str, Any] = table("mam_pipeline.asset", "matter.yaml")
    materials = {name: Material(name, **row) for name, row in data["materials"].items()}
    parts = {part: name for name, kind in data["parts"].items() for part in kind}
    bearings: dict[str, Bearing] = {}
    joints: dict[str, str] = {}
    for name, row in data["bearings"].items():
        low, high = row["spread"]
        bearings[name] = Bearing(
            name, row.get("force", 0.0), row.get("share", 0.0), row.get("torque", 0.0),
            (low, high), row["source"],
        )  # fmt: skip
        joints |= dict.fromkeys(row["parts"], name)
    catches = tuple(
        CatchKind(
            name, tuple(row["things"]), tuple(row["parts"]), row["force"],
            (row["spread"][0], row["spread"][1]), row["width"], row["source"],
        )
        for name, row in data["catches"].items()
    )  # fmt: skip
    balances = tuple(
        BalanceKind(
            name, tuple(row["things"]), tuple(row["parts"]), tuple(row["joints"]), row["source"]
        )
        for name, row in data["balances"].items()
    )
    return _Table(materials, parts, bearings, joints, catches, balances, data["others"])


def material_of(part: str, thing: str = "") -> Material:
    """What a part is assumed to be made of.

    Args:
        part: its kind. thing: the kind of object, "" where nobody says.
    """
    found, known = _read(), kinds().objects.get(thing)
    whole = known.material if known is not None and known.material else BOARD
    return found.materials[found.parts.get(part.lower(), whole)]


def made_alike() -> frozenset[str]:
    """Kinds of parts that are of one material whatever the object is."""
    return frozenset(_read().parts)


def bearing_of(part: str, type_: str) -> Bearing:
    """The bearing of a moving part of a kind; of an unknown one, by its joint's type."""
    found = _read()
    return found.bearings[found.joints.get(part.lower(), found.others[type_])]


def catch_of(part: str, thing: str) -> CatchKind | None:
    """What keeps a part of an object closed; None where nothing but friction does."""
    return _first(_read().catches, part, thing)


def balance_of(part: str, thing: str, type_: str) -> BalanceKind | None:
    """What carries a part of an object, if it weighs on its joint; None where friction does."""
    return _first([b for b in _read().balances if type_ in b.joints], part, thing)


def _first(kinds: Sequence[OfParts], part: str, thing: str) -> OfParts | None:
    return next((k for k in kinds if thing in k.things and part.lower() in k.parts), None)


def materials() -> list[Material]:
    """All that are known."""
    return list(_read().materials.values())


def bearings() -> list[tuple[Bearing, list[str]]]:
    """All that are known, each with the kinds of parts that have it."""
    found = _read()
    return [
        (b, [k for k, n in found.joints.items() if n == b.name]) for b in found.bearings.values()
    ]


def usual_mass(thing: ObjectKind, size: float) -> Range | None:
    """Lowest, usual and highest mass of a thing of a kind at a size, kg; None if unknown.

    Args:
        size: its largest side, metres.
    """
    if thing.mass is None:
        return None
    low, _, high = thing.size
    if not low / RULE.size <= size <= high * RULE.size:
        return None
    usual = float(np.exp(np.interp(np.log(size), np.log(thing.size), np.log(thing.mass))))
    least, most = max(thing.mass[0], usual / RULE.spread), min(thing.mass[2], usual * RULE.spread)
    return least, usual, most


def weighted(bodies: Sequence[Inertial], thing: str, size: float) -> list[Inertial]:
    """Links that together weigh what such a thing of this size does.

    Of furniture and vessels the surfaces and the kind are believed alike, within what the kind
    allows, and the walls become thicker or thinner everywhere. Of a machine the surfaces say
    little, for it is full: it weighs what its kind does, and what its walls lack is in link 0.

    Args:
        bodies: by their surfaces. thing: kind of object, "" where nobody says. size: largest side.
    """
    known = kinds().objects.get(thing)
    bounds = None if known is None else usual_mass(known, size)
    if known is None or bounds is None:
        return list(bodies)
    total = sum(body.mass for body in bodies)
    least, usual, most = bounds
    wanted = usual if known.machine else float(np.clip(np.sqrt(total * usual), least, most))
    low, high = (f"{float(f'{x:.2g}'):g}" for x in (least, most))  # 120, not 1.2e+02
    why = f"; such a {thing} of this size weighs {low} to {high} kg"
    spread = (least / wanted, most / wanted)
    factors = np.full(len(bodies), wanted / total)
    if known.machine and total < wanted:
        factors[:] = 1.0
        factors[0] = 1.0 + (wanted - total) / bodies[0].mass
    return [_scaled(body, float(f), why, spread) for body, f in zip(bodies, factors)]


def _scaled(body: Inertial, factor: float, why: str, spread: tuple[float, float]) -> Inertial:
    """A body that weighs `factor` times as much, and may weigh `spread` times that."""
    mass = body.mass * factor
    material = body.material if abs(factor - 1.0) < 1e-9 else body.material + why
    between = (mass * spread[0], mass * spread[1])
    return replace(
        body, mass=mass, inertia=body.inertia * factor, material=material, mass_range=between
    )  # fmt: skip
