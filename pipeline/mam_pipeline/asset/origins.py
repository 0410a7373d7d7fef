"""Where a value of an asset comes from: measured, read, said, inferred or assumed, in words.

Card, report, shared page, studio and terminal take their words from here.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, Protocol

from mam_pipeline.hints import TRAVEL
from mam_pipeline.types import Provenance, RangeBasis, RangeRule

SourceKind = Literal["photo", "mesh", "urdf", "generated"]
"""What an asset was made from; of a URDF and of a generated object the file has the joints."""


class Moves(Protocol):
    """What is asked of a joint, be it one of the engine's or one of a card."""

    @property
    def confidence(self) -> float: ...
    @property
    def evidence(self) -> Mapping[str, Any]: ...
    @property
    def basis(self) -> RangeBasis: ...
    @property
    def provenance(self) -> Provenance: ...


@dataclass(frozen=True)
class Origin:
    """Where one value comes from.

    Attributes:
        kind: measured on the shape; read from the file; said by the user; inferred by a model,
            with its chance; assumed, with the rule.
        text: for people, beginning with the kind: "assumed: 0.8 of its own depth".
    """

    kind: Literal["measured", "read", "said", "inferred", "assumed"]
    text: str

    def __str__(self) -> str:
        return self.text


def measured(how: str) -> Origin:
    """What was measured on the shape."""
    return Origin("measured", f"measured: {how}")


def assumed(rule: str) -> Origin:
    """What follows from a rule; "" where the rule has no words."""
    return Origin("assumed", f"assumed: {rule}" if rule else "assumed")


READ, SAID = Origin("read", "read from the file"), Origin("said", "said by you")
RANGES: dict[RangeRule, Origin] = {
    "usual": assumed("as far as such parts usually go"),
    "depth": assumed(f"{TRAVEL.drawer:g} of the depth inside"),
    "twin": assumed("as far as its twin"),
    "drawer_box": assumed("as deep as its assumed box"),
    "collision": measured("until it meets something"),
    "contact_loss": measured("until it would fall out"),
    "endless": measured("nothing stops it all the way round"),
    "token": measured("almost nothing is free: something is in its way"),
    "paper": measured("by the paper's rule"),
}
"""Of a range by what ended it; `given` depends on who gave it."""


def percent(share: float) -> str:
    """0.873 -> 87 %; never 100 % of what is less."""
    return f"{min(round(100 * share), 99) if share < 1 else 100} %"


def motion_origin(joint: Moves, source: str) -> Origin:
    """Who says that a part moves, and so.

    Args:
        source: kind of what the asset was made from.
    """
    if joint.provenance == "user":
        return SAID
    if source in ("urdf", "generated"):
        return READ
    if joint.provenance == "observed" and source != "photo":  # an animation in a mesh file
        return READ
    if joint.provenance == "assumed":
        return assumed("")
    if joint.provenance == "model":
        return Origin("inferred", f"inferred by a language model, {percent(joint.confidence)} sure")
    where = " from the photo" if source == "photo" else ""
    return Origin("inferred", f"inferred{where}, {percent(joint.confidence)} sure")


def range_origin(joint: Moves, source: str) -> Origin:
    """Why a range is what it is.

    Args:
        source: kind of what the asset was made from.
    """
    rule = joint.basis.rule
    if rule not in RANGES:
        return motion_origin(joint, source)
    limits = joint.evidence.get("limits")
    exact = str(limits.get("assumed", "")) if isinstance(limits, Mapping) else ""
    if rule in ("depth", "twin") and exact:
        return assumed(exact.removeprefix("assumed: "))
    return RANGES[rule]


def size_origin(scale: str) -> Origin:
    """Who says how large the object is.

    Args:
        scale: `metres_per_unit_source` of the card.
    """
    if scale.startswith("assumed"):
        return assumed(scale.removeprefix("assumed").strip(" :") or "as large as such things are")
    return SAID if scale in ("user", SAID.text) else READ


def mass_origin(material: str) -> Origin:
    """Who says what a part weighs.

    Args:
        material: of the card; "" where none was assumed.
    """
    return assumed(material) if material else READ


def friction_origin(spread: tuple[float, float]) -> Origin:
    """Who says how much friction a joint has.

    Args:
        spread: `friction_range` of the card; (0, 0) where no bearing was assumed.
    """
    return assumed("what such bearings have") if any(spread) else READ
