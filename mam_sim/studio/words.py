"""What the engine found, in words for people: joints, ranges, evidence, verdicts."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from mam_pipeline.asset.origins import motion_origin, percent, range_origin
from mam_pipeline.check.report import REASONS
from mam_pipeline.types import (
    FAR_ENOUGH,
    MOVES,
    NEEDS_REVIEW,
    DormantPart,
    FloatArray,
    Joint,
    JointCandidate,
    JointSubtype,
)
from mam_sim.facts import span

MOTIONS: dict[JointSubtype, str] = {
    "hinge": "swings like a door or a lid",
    "spin": "turns like a knob or a wheel",
    "slide": "slides",
    "fixed": "does not move",
}


ALONG = {1: ("left", "right"), 2: ("upper", "lower")}  # the side of a higher and a lower Y, Z


def callings(parts: Mapping[str, tuple[str, FloatArray]]) -> dict[str, str]:
    """What people call each part: "door" where it is the only one, else "left door", "drawer 3".

    A name that a person gave stays. Parts of a kind stand beside each other, from the upper left.

    Args:
        parts: kind and middle (3,) by name, as seen from the front (which faces -X; left is +Y).
    """
    out: dict[str, str] = {}
    for kind in dict.fromkeys(kind for kind, _ in parts.values()):
        same = [n for n in parts if parts[n][0] == kind]
        middles = np.stack([parts[n][1] for n in same])
        wide, high = np.ptp(middles[:, 1:], axis=0)
        rows = np.round(middles[:, 2] / max(0.25 * high, 0.2 * wide, 1e-9))
        same = [same[k] for k in np.lexsort((-middles[:, 1], -rows))]
        counted = [n for n in same if re.fullmatch(rf"{re.escape(kind)}(_\d+)?", n)]
        sides = ALONG[1 if wide >= high else 2]
        for name in same:
            number = counted.index(name) if name in counted else -1
            if number < 0:
                out[name] = name.replace("_", " ")
            elif len(counted) == 1:
                out[name] = kind
            elif len(counted) == 2 and max(wide, high) > 1e-6:
                out[name] = f"{sides[number]} {kind}"
            else:
                out[name] = f"{kind} {number + 1}"
    return out


def needs_review(joint: Joint) -> bool:
    """Whether a person should look at a joint: the engine is not sure, and nobody said so."""
    return joint.confidence < NEEDS_REVIEW and joint.provenance != "user"


def sureness(joint: Joint, source: str) -> str:
    """How sure a joint is, in a few words.

    Args:
        source: kind of what the object is made from.
    """
    if joint.type == "fixed":
        return "does not move"
    origin = motion_origin(joint, source)
    if origin.kind != "inferred":
        return str(origin).partition(":")[0]
    more = "; needs review" if needs_review(joint) else ""
    return f"inferred, {percent(joint.confidence)}{more}"


def kept_value(joint: Joint, shown: float) -> float:
    """The reverse of `facts.shown_value`: metres or radians."""
    return shown / 100 if joint.type == "prismatic" else float(np.radians(shown))


def line(subtype: str, axis: FloatArray, origin: FloatArray, box: FloatArray) -> str:
    """Where a line runs on a part, as seen from the front (which faces -X; left is +Y).

    Args:
        axis, origin: of the line. box: (2, 3) lower and upper corner of the part.
    """
    along = int(np.argmax(np.abs(axis)))
    if subtype == "slide":
        signs = {0: ("back", "out to the front"), 1: ("to the right", "to the left"),
                 2: ("down", "up")}  # fmt: skip
        low, high = signs[along]
        towards = low if (axis[along] > 0) == (along == 0) else high
        return f"slide {towards}"
    ways = ("front to back", "left to right", "upright")
    places = (("front", "back"), ("right", "left"), ("bottom", "top"))
    near = []
    for k in range(3):
        size = box[1, k] - box[0, k]
        if k == along or size < 0.15 * float(np.ptp(box, axis=0).max()):
            continue
        share = (origin[k] - box[0, k]) / max(size, 1e-9)
        if share < 0.3 or share > 0.7:
            near.append(places[k][int(share > 0.5)])
    place = f"at its {' and '.join(near)}" if near else "through its middle"
    return f"{subtype} {place}, {ways[along]}"


def chance(c: JointCandidate) -> str:
    """The probability of a way of moving."""
    sure = (c.kind_probability or 0.0) * (c.within_kind or 0.0)
    return "under 1 %" if sure < 0.01 else percent(sure)


def dormant_text(part: DormantPart) -> str:
    """A paragraph on what may move and is kept still."""
    joint, link = part.joint, part.link
    return (
        f"*{link.name}* ({link.kind}) is dormant: it may be one that {MOTIONS[joint.subtype]}, "
        f"{percent(joint.confidence)} sure; {joint.dormant}."
    )


def joint_text(joint: Joint, part: str, name: str, runs: str, source: str) -> str:
    """A paragraph of Markdown on a joint: what, how sure, why this range.

    Args:
        part: as people call it. name: of its link.
        runs: where its line runs, as `line` says it. source: kind of what the object is made from.
    """
    if joint.type == "fixed":
        return f"**{part}** ({name}) does not move against what it hangs on."
    where = runs.partition(" ")[2]
    rows = [f"**{part}** ({name}) {MOTIONS[joint.subtype]}, {where}."]
    rows.append(f"{span(joint)}; {range_origin(joint, source)}.")
    look = needs_review(joint)
    origin = str(motion_origin(joint, source))
    rows.append(f"{origin[0].upper()}{origin[1:]}.{' Please look at it.' if look else ''}")
    if joint.basis.share < MOVES:
        rows.append(f"It is stuck after {percent(joint.basis.share)} of the usual way.")
    elif joint.basis.of_part < FAR_ENOUGH:
        rows.append(f"It goes only {percent(joint.basis.of_part)} of its own length.")
    if joint.basis.after_another:
        rows.append("Another part must be opened first.")
    return "\n\n".join(rows)


def dialogue_text(evidence: Mapping[str, Any], said: Collection[str]) -> str:
    """What a language model was asked and what it answered, as Markdown; "" where none was.

    Args:
        evidence: of the base. said: parts on which the person has spoken since.
    """
    rows = []
    for turn in evidence.get("dialogue", ()):
        rows.append("\n".join(f"> {line}" for line in str(turn["question"]).splitlines()))
        parts = turn.get("parts", ())
        for part in parts:
            pieces = ", ".join(map(str, part["pieces"]))
            base = ", does not move" if part.get("is_base") else ""
            rows.append(
                f"- **{part['name']}** ({part['kind']}{base}): pieces {pieces}; "
                f"{percent(part['confidence'])} sure"
            )
        for mount in (*turn.get("mounts", ()), *(p for p in parts if "motion" in p)):
            over = "; *you said otherwise*" if mount["name"] in said else ""
            rows.append(
                f"- **{mount['name']}** hangs on {mount['parent'] or turn['base']}: "
                f"{mount['motion']}, axis "
                f"{mount['axis']}, side {mount['side']}, {percent(mount['confidence'])} sure; "
                f"else {mount['second_best']}{over}"
            )
        for joint in turn.get("joints", ()):
            change = ", ".join(f"{k} {v}" for k, v in joint.items() if k not in ("name", "ok"))
            rows.append(f"- **{joint['name']}**: {'right' if joint['ok'] else change or 'wrong'}")
        for transfer in turn.get("transfers", ()):
            pieces = ", ".join(map(str, transfer["pieces"]))
            rows.append(f"- pieces {pieces} belong to **{transfer['to']}**")
    return "\n\n".join(rows)


def verdict_text(
    passed: bool, driven: bool, reasons: list[str], joints: list[str], still: list[str]
) -> str:
    """The check's verdict, each reason in words.

    Args:
        joints: a sentence for each joint that fails. still: for each that it has put to sleep.
    """
    asleep = "".join(f"\n\n{row}. *wake* in the tree lets it move." for row in still)
    if passed:
        more = "" if driven else " No simulator is installed: nothing was driven."
        return f"**The check passes.**{more}{asleep}"
    rows = [f"- {REASONS.get(code, code)}" for code in reasons]
    return "**The check fails:**\n\n" + "\n".join([*rows, *(f"- {j}" for j in joints)]) + asleep
