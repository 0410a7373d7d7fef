"""Repairs of what a joint does on its way: ranges that run into something or out of their guide."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from functools import partial

import numpy as np

from mam_pipeline.check.correct import KEPT
from mam_pipeline.check.model import CheckModel
from mam_pipeline.check.report import JointReport
from mam_pipeline.check.sweep import share_in_guide
from mam_pipeline.geometry.motion import Motion
from mam_pipeline.joints.limits import Surroundings
from mam_pipeline.mend.bodies import rebuild
from mam_pipeline.mend.joints import around_of
from mam_pipeline.mend.work import SHAPES, Work, attribute, child, pose_of, set_pose
from mam_pipeline.thresholds import THRESHOLDS
from mam_pipeline.types import Joint


@dataclass(frozen=True)
class MotionRules:
    """When a range is changed.

    Attributes:
        least: share of a range that must be left; a joint that is cut to less is another one.
        wrong: a way whose free share is below this, where the other way is free, has a wrong sign.
        free: share of the other way that must be free for that.
        turn: radians that an endless hinge must have free to get limits.
    """

    least: float = 0.25
    wrong: float = 0.25
    free: float = 0.9
    turn: float = 0.5


RULES = MotionRules()


def _failing(work: Work, *reasons: str) -> list[tuple[CheckModel, Joint, JointReport]]:
    model = work.model()
    if model is None or work.report is None:
        return []
    named = {j.name: j for j in model.articulation.joints}
    return [(model, named[r.name], r) for r in work.report.joints
            if r.name in named and set(reasons) & set(r.reasons)]  # fmt: skip


def _ends(work: Work, reason: str, joint: Joint, lower: float, upper: float, why: str) -> None:
    limit = child(work.joints[joint.name], "limit")
    limit.set("lower", f"{lower:.6g}")
    limit.set("upper", f"{upper:.6g}")
    before, after = (f"{a:.4g} .. {b:.4g}" for a, b in ((joint.lower, joint.upper), (lower, upper)))
    work.change(reason, joint.name, before, after, why)


def turn_round(work: Work, reason: str = "exchanged") -> None:
    """The body holds its part again, and all stands where it stood.

    The part, which was the root, gets the joint's frame: so the line stays, and the value is that
    of before with the axis turned about.
    """
    for _model, joint, _report in _failing(work, reason):
        element = work.joints[joint.name]
        old, new = (attribute(element, end, "link") for end in ("parent", "child"))
        held = {attribute(j, "child", "link") for j in work.joints.values()}
        if old in held or element.find("mimic") is not None:
            continue
        back = np.linalg.inv(pose_of(element))
        hung = [j for j in work.joints.values() if attribute(j, "parent", "link") == old]
        parts = [e for tag in (*SHAPES, "inertial") for e in work.links[old].findall(tag)]
        for other in (*parts, *(j for j in hung if j is not element)):
            set_pose(other, back @ pose_of(other))
        set_pose(element, np.eye(4))
        axis = child(element, "axis")
        told = [float(w) for w in (axis.get("xyz") or "1 0 0").split()]
        axis.set("xyz", " ".join(f"{-v + 0.0:g}" for v in told))
        child(element, "parent").set("link", new)
        child(element, "child").set("link", old)
        why = f"{new} is the larger and around it or far larger; all stands where it stood"
        work.change(reason, joint.name, f"{new} hangs on {old}", f"{old} hangs on {new}", why)


def _free(around: Surroundings, joint: Joint, end: float) -> float:
    """How far towards `end` (signed) nothing is in the way."""
    motion: Motion = "prismatic" if joint.type == "prismatic" else "revolute"
    return around.free(motion, joint.axis, joint.origin, end)[0] if end else 0.0


def clear_way(work: Work, reason: str = "penetration") -> None:
    """Ranges that end before the part runs into something, or that open the other way."""
    for model, joint, _report in _failing(work, reason):
        if joint.coupling is not None:
            continue
        around = around_of(model, joint)
        if around is None:
            continue
        free = partial(_free, around, joint)
        if joint.type == "continuous":
            low, high = free(-np.pi), free(np.pi)
            if RULES.turn <= high - low < 2.0 * np.pi:
                work.joints[joint.name].set("type", "revolute")
                why = "no whole turn is free: what stops it on either side is its limit"
                _ends(work, reason, joint, low, high, why)
            continue
        low, high = free(joint.lower), free(joint.upper)
        span = joint.upper - joint.lower
        share = (high - low) / span
        if share < RULES.wrong and min(abs(joint.lower), abs(joint.upper)) < 0.05 * span:
            other_low, other_high = free(-joint.upper), free(-joint.lower)
            if (other_high - other_low) / span >= RULES.free:
                why = "the sign: this way it runs into something at once, the other way it is free"
                _ends(work, reason, joint, -joint.upper, -joint.lower, why)
                continue
        if joint.lower <= 0.0 <= joint.upper and RULES.least <= share < 1.0:
            why = f"{share:.0%} of its range is free; beyond it the part is inside another"
            _ends(work, reason, joint, low, high, why)


def in_guide(work: Work, reason: str = "detached") -> None:
    """Slides that end before they lose contact or leave their channel."""
    for model, joint, _report in _failing(work, reason):
        if joint.coupling is not None or not joint.lower <= 0.0 <= joint.upper:
            continue
        low = share_in_guide(model, joint, RULES.least)
        if low > RULES.least:
            why = f"beyond {low:.0%} of its range it has left what it slides in"
            _ends(work, reason, joint, low * joint.lower, low * joint.upper, why)


def pieces(work: Work, reason: str = "cavity_filled") -> None:
    """Convex pieces that leave hollows open, where a hull fills them or two overlap at rest."""
    rebuild(work, reason, why="made anew from what is seen, so that hollows stay open")


def driven_way(work: Work, reason: str = "frozen") -> None:
    """Ranges that end where the simulator could drive the part."""
    for _model, joint, report in _failing(work, reason, "no_return"):
        share = KEPT * min(report.reached or 0.0, 1.0)
        free = joint.coupling is None and joint.lower <= 0.0 <= joint.upper
        if joint.type != "continuous" and free and RULES.least <= share < KEPT:
            why = f"a drive comes to {share / KEPT:.0%} of it, where its pieces wedge"
            _ends(work, reason, joint, share * joint.lower, share * joint.upper, why)


def exclusions(work: Work, reason: str = "frozen") -> None:
    """Pairs of bodies that simulators must not let collide, named in an SRDF file.

    Those whose pieces overlap at rest, and a part and its body with a link between them that has no
    shape or is fixed: parent and child are left out by simulators themselves, these are not.
    SAPIEN takes the reason `Default` alone.
    """
    model = work.model()
    if model is None:
        return
    joints, links = model.articulation.joints, model.articulation.links
    known = {(j.parent, j.child) for j in joints}
    whys = {}
    for pair in _hung_through(work):
        whys[pair] = "one hangs on the other through a link without a shape, or a fixed one"
    for i in range(len(links)):
        for k in range(i + 1, len(links)):
            if (i, k) not in known and _overlap(model, i, k):
                why = "their pieces are inside each other at rest, and would push the joints"
                whys.setdefault((links[i].name, links[k].name), why)
    root = ET.Element("robot", name=str(work.root.get("name")))
    if work.srdf.is_file():
        root = ET.fromstring(work.srdf.read_bytes())
    told = {frozenset((e.get("link1"), e.get("link2"))) for e in root.iter("disable_collisions")}
    left = {pair: why for pair, why in whys.items() if frozenset(pair) not in told}
    for (a, b), why in left.items():
        ET.SubElement(root, "disable_collisions", link1=a, link2=b, reason="Default")
        work.change(reason, f"{a}, {b}", "collide", "named in the SRDF as not colliding", why)
    if left:
        ET.indent(root, " ")
        work.srdf.write_text(ET.tostring(root, encoding="unicode") + "\n", encoding="utf-8")


def _hung_through(work: Work) -> list[tuple[str, str]]:
    """Links with collision shapes of which one hangs on the other, but not as its child."""
    up = {attribute(j, "child", "link"): (attribute(j, "parent", "link"), j.get("type") == "fixed")
          for j in work.joints.values()}  # fmt: skip
    shown = {n for n, link in work.links.items() if any(link.find(t) is not None for t in SHAPES)}
    solid = {n for n, link in work.links.items() if link.find("collision") is not None}
    pairs = []
    for name in work.links:
        at, moved, seen, steps = name, False, False, 0
        while at in up and steps < len(up):
            above, fixed = up[at]
            seen |= moved and at in shown
            if seen and not fixed:
                break  # the body ends here: what is above holds that body
            moved, at, steps = moved or not fixed, above, steps + 1
            if moved and steps > 1 and {name, at} <= solid:
                pairs.append((at, name))
    return pairs


def _overlap(model: CheckModel, i: int, k: int) -> bool:
    """Whether points of a piece of one body lie deep in a piece of the other, at rest."""
    deep = THRESHOLDS.penetration_share * model.articulation.mesh.diagonal
    for a in model.hulls[i]:
        for b in model.hulls[k]:
            far = np.maximum(a.points.min(0) - b.points.max(0), b.points.min(0) - a.points.max(0))
            if far.max() > -deep:
                continue
            middle = [(p.points.mean(0) + p.points) / 2 for p in (a, b)]
            points = np.concatenate([a.points, b.points, *middle])
            if (np.minimum(a.depth(points), b.depth(points)) > deep).any():
                return True
    return False
