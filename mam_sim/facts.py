"""What an asset's card says, in words for people: report and shared page show the same of it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from mam_pipeline.asset.card import AssetCard, CardJoint, CardPart
from mam_pipeline.asset.dynamics import rubbing
from mam_pipeline.asset.origins import (
    SAID,
    assumed,
    friction_origin,
    mass_origin,
    motion_origin,
    range_origin,
    size_origin,
)
from mam_pipeline.check.report import REASONS
from mam_pipeline.thresholds import HANDLING
from mam_pipeline.types import Joint
from mam_sim.console import STAGES

AnyJoint = CardJoint | Joint
NESTED = "write"
"""A time of `seconds` that another one, of the stage `asset`, holds already."""


@dataclass(frozen=True)
class Fact:
    """A value with its unit, and where it comes from; both for people."""

    value: str
    origin: str = ""


@dataclass(frozen=True)
class JointFacts:
    """A joint as a table shows it.

    Attributes:
        joint: of the card. kind: of its part. span: its range. mass: of its part. force: that moves
            it against friction. catch: what keeps it closed besides. handling: what the simulator
            measured of it, in words; "" where nothing was driven. motion: who says that it moves
            so.
    """

    joint: CardJoint
    kind: str
    span: Fact
    mass: Fact
    force: Fact
    catch: Fact
    handling: str
    motion: str


@dataclass(frozen=True)
class StageTime:
    """A stage of the pipeline on the timeline.

    Attributes:
        words: what it did. seconds: it took. share: of all stages, 0..1.
    """

    words: str
    seconds: float
    share: float


def joint_facts(card: AssetCard, joints: Sequence[CardJoint]) -> list[JointFacts]:
    """Some joints of a card as a table shows them."""
    parts, check = {part.link: part for part in card.parts}, card.checks.get("executability")
    driven = _rows(check.get("measured")) if isinstance(check, Mapping) else ()
    measured = {str(row.get("joint")): row for row in driven}
    return [
        _facts(joint, parts.get(joint.child), measured.get(joint.name, {}), card.made_from)
        for joint in joints
    ]


def _facts(
    joint: CardJoint, part: CardPart | None, measured: Mapping[str, Any], source: str
) -> JointFacts:
    slides = joint.type == "prismatic"
    mass = Fact("")
    if part is not None and part.mass > 0:
        value = _between(part.mass, part.mass_range, "kg")
        mass = Fact(value, str(mass_origin(part.material)))
    force = Fact("")
    if joint.friction > 0:
        value = _between(*rubbing(joint), "N" if slides else "N m")
        if joint.balance is not None:
            value += f"; its weight is carried by {joint.balance.name or 'springs'}"
        force = Fact(value, str(friction_origin(joint.friction_range)))
    way = Fact(span(joint), str(range_origin(joint, source)))
    kind, motion = "" if part is None else part.kind, str(motion_origin(joint, source))
    handling = _handling(measured, slides)
    return JointFacts(joint, kind, way, mass, force, catch_fact(joint), handling, motion)


def catch_fact(joint: AnyJoint) -> Fact:
    """What keeps a joint closed besides friction."""
    catch = joint.catch
    if catch is None or catch.force == 0:
        return Fact("")
    pulls = _between(catch.force, catch.force_range, "N" if joint.type == "prismatic" else "N m")
    width = f"{shown_value(joint, catch.width):.2g} {unit(joint)}"
    origin = assumed(catch.source) if catch.source else SAID
    return Fact(f"{catch.name or 'catch'} {pulls} on the first {width}", str(origin))


def _handling(row: Mapping[str, Any], slides: bool) -> str:
    """How a joint handles in the simulator: what starts it, when it stays, how fast it falls."""

    def told(key: str, unit: str) -> str:
        value = row.get(key)
        return f"{value:.2g} {unit}" if isinstance(value, int | float) else ""

    starts, fast = told("breakaway", "N" if slides else "N m"), row.get("let_go")
    closed, half = (
        f"{words} or more" if words == f"{HANDLING.tilt:.2g} °" else words
        for words in (told("tilt_closed", "°"), told("tilt_half", "°"))
    )
    words = [
        f"starts at {starts}" if starts else "",
        f"stays up to a tilt of {closed} closed and {half} half-open" if closed and half else "",
        f"let go half-open: {told('let_go', 'm/s' if slides else 'rad/s')}" if fast else "",
    ]
    return ", ".join(word for word in words if word)


def shown_value(joint: AnyJoint, value: float) -> float:
    """A joint value as people read it: centimetres or degrees."""
    return 100 * value if joint.type == "prismatic" else math.degrees(value)


def unit(joint: AnyJoint) -> str:
    """Of `shown_value`."""
    return "cm" if joint.type == "prismatic" else "°"


def span(joint: AnyJoint) -> str:
    """The range of a joint."""
    low, high = joint.lower, joint.upper
    if low is None or high is None or not (math.isfinite(low) and math.isfinite(high)):
        return "turns freely"
    return f"{shown_value(joint, low):.3g} to {shown_value(joint, high):.3g} {unit(joint)}"


def _between(value: float, ends: tuple[float, float], unit: str) -> str:
    """A value with the range that it may be in: "3.2 kg (2.5 to 4.2)"."""
    more = f" ({ends[0]:.2g} to {ends[1]:.2g})" if ends[1] > ends[0] else ""
    return f"{value:.2g} {unit}{more}"


def size_fact(card: AssetCard) -> Fact:
    """How large the object is."""
    if card.size is None:
        return Fact("")
    depth, width, height = card.size
    text = f"{width:.2f} m wide, {depth:.2f} m deep, {height:.2f} m high"
    return Fact(text, f"scale {size_origin(card.metres_per_unit_source)}")


def mass_fact(card: AssetCard) -> Fact:
    """What the object weighs in all."""
    low, high = (sum(part.mass_range[k] for part in card.parts) for k in (0, 1))
    total = sum(part.mass for part in card.parts)
    guessed = any(part.material for part in card.parts)
    origin = "assumed: by the materials of its parts" if guessed else str(mass_origin(""))
    return Fact(_between(total, (low, high), "kg"), origin) if total > 0 else Fact("")


def verdict(card: AssetCard) -> str:
    """What the check said, in a sentence."""
    found = card.checks.get("executability")
    if card.executable is None or not isinstance(found, Mapping):
        return "It was not checked."
    if not card.executable:
        return "It fails the check."
    driven = "" if found.get("driven") else " No simulator was installed: nothing was driven."
    return f"It passes the check.{driven}"


def check_sentences(card: AssetCard) -> list[str]:
    """Why an asset fails its check: the place, then the reason in words."""
    found = card.checks.get("executability")
    if not isinstance(found, Mapping) or card.executable is not False:
        return []
    known = {joint.name: joint for joint in card.joints}
    out, told = [], set[str]()
    for row in _rows(found.get("joints")):
        codes = [str(code) for code in row.get("reasons", ())]
        joint, at = known.get(str(row.get("joint"))), row.get("at")
        place = str(row.get("joint"))
        if joint is not None and isinstance(at, int | float):
            place += f" at {shown_value(joint, at):.3g} {unit(joint)}"
        out.append(f"{place}: {'; '.join(REASONS.get(code, code) for code in codes)}.")
        told |= set(codes)
    for row in _rows(found.get("findings")):
        out.append(f"{row.get('where')}: {row.get('message')}.")
        told.add(str(row.get("code")))
    return out + [f"{REASONS.get(c, c)}." for c in card.check_reasons if c not in told]


def robot_sentences(card: AssetCard) -> list[str]:
    """What the arm of the environment can operate, and why not the rest."""
    tried = card.checks.get("environment")
    if not isinstance(tried, Mapping):
        return []
    robot = tried.get("robot", "the arm")
    return [
        f"{robot} can operate {row.get('joint')}."
        if row.get("ok")
        else f"{robot} cannot operate {row.get('joint')}: {row.get('why')}."
        for row in _rows(tried.get("joints"))
    ]


def attempt_sentence(card: AssetCard) -> str:
    """What came of the arm's attempt that was filmed; "" where none was made."""
    tried = card.checks.get("attempt")
    if not isinstance(tried, Mapping):
        return ""
    part = next((j.child for j in card.joints if j.name == tried.get("joint")), tried.get("joint"))
    count = tried.get("attempts")
    end = f"succeeds at attempt {count}" if tried.get("ok") else f"fails: {tried.get('why')}"
    if count and not tried.get("ok"):
        end = f"fails {count} times; the last time: {tried.get('why')}"
    return f"Robot {tried.get('robot')}, task {tried.get('task')}, {part}: {end}."


def attempt_ok(card: AssetCard) -> bool:
    """Whether the attempt that was filmed succeeded."""
    tried = card.checks.get("attempt")
    return isinstance(tried, Mapping) and tried.get("ok") is True


def timeline(card: AssetCard) -> list[StageTime]:
    """The stages in their order, with the time each took."""
    found = {k: v for k, v in card.seconds.items() if not (k == NESTED and "asset" in card.seconds)}
    total = sum(found.values())
    if total <= 0:
        return []
    return [StageTime(STAGES.get(k, k), v, v / total) for k, v in found.items()]


def _rows(value: Any) -> Iterator[Mapping[str, Any]]:
    """Rows of a list that a person may have edited; what is no row is passed over."""
    yield from (row for row in value if isinstance(row, Mapping)) if isinstance(value, list) else ()
