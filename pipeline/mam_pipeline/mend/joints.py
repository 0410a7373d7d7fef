"""Repairs of single joints: types, axes, limits, couplings, friction, effort."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np

from mam_pipeline.asset.dynamics import with_dynamics
from mam_pipeline.check.lint import KNOWN, in_degrees
from mam_pipeline.check.model import CheckModel
from mam_pipeline.check.profiles import (
    DEFAULT_EFFORT,
    DEFAULT_VELOCITY,
    PROFILES,
    refused_tags,
)
from mam_pipeline.formats.urdf.write import numbers
from mam_pipeline.joints.limits import Surroundings, embedded_limits
from mam_pipeline.mend.bodies import body_inertials
from mam_pipeline.mend.work import SHAPES, Work, attribute, child, number, short
from mam_pipeline.types import Joint

TYPES = {
    "hinge": "revolute", "rotary": "revolute", "rotational": "revolute", "rotation": "revolute",
    "slider": "prismatic", "slide": "prismatic", "linear": "prismatic", "translation": "prismatic",
    "rigid": "fixed", "static": "fixed", "weld": "fixed",
}  # fmt: skip
"""Types of other formats, by URDF's name for them."""


def joint(work: Work, reason: str = "bad_joint") -> None:
    """Types, numbers, axes and couplings that no reader takes."""
    _numbers(work)
    for name, element in work.joints.items():
        _type(work, name, element)
        _mimic(work, name, element)
        axis = element.find("axis")
        if axis is not None and element.get("type") != "fixed":
            told = _vector(axis.get("xyz") or "1 0 0")
            if told is not None and np.linalg.norm(told) < 1e-3:
                axis.set("xyz", "1 0 0")
                why = "loaders that take a zero axis take x, which is also the format's default"
                work.change(reason, name, f"axis {short(told)}", "axis 1 0 0", why)
        for key in ("damping", "friction"):
            value = number(attribute(element, "dynamics", key))
            if value is not None and value < 0:
                child(element, "dynamics").set(key, repr(-value))
                why = "what resists motion is not negative"
                work.change(reason, name, f"{key} {value:g}", f"{-value:g}", why)


def _numbers(work: Work) -> None:
    """Rows of numbers with blanks between them, and scales of three."""
    for element in work.root.iter():
        if element.tag == "mesh" and number(element.get("scale")) is not None:
            told = str(element.get("scale")).strip()
            element.set("scale", f"{told} {told} {told}")
            why = "some loaders take three numbers alone"
            work.change("bad_joint", f"scale of {element.get('filename')}", told,
                        element.get("scale"), why)  # fmt: skip
        for key in ("xyz", "rpy", "size", "scale", "rgba"):
            told = element.get(key) or ""
            plain = told.replace(",", " ").strip("[]() ")
            if told != plain and ("," in told or told[:1] in "[(") and _vector(plain) is not None:
                element.set(key, plain)
                why = "numbers of a URDF have blanks between them"
                work.change("bad_joint", f"{element.tag} {key}", told, plain, why)


def _type(work: Work, name: str, element: ET.Element) -> None:
    told = element.get("type") or ""
    plain = told.strip().lower()
    plain = TYPES.get(plain, plain)
    why = "URDF's name for it"
    if plain in ("floating", "planar"):
        parent = work.links.get(attribute(element, "parent", "link"))
        if (
            parent is not None
            and parent.find("visual") is None
            and parent.find("collision") is None
        ):
            plain, why = (
                "fixed",
                "its parent is an empty root; a simulator frees the base by itself",
            )
    if plain != told and plain in KNOWN:
        element.set("type", plain)
        work.change("bad_joint", name, f"type {told!r}", plain, why)


def _mimic(work: Work, name: str, element: ET.Element) -> None:
    mimic = element.find("mimic")
    if mimic is None:
        return
    told = mimic.get("joint") or ""
    alike = {n.strip().casefold(): n for n in work.joints}
    found = alike.get(told.strip().casefold())
    if found is not None and found not in (told, name):
        mimic.set("joint", found)
        work.change("bad_joint", name, f"follows {told!r}", found, "no other joint is meant")
    elif found in (None, name):
        element.remove(mimic)
        why = "there is no such joint, so nothing can be followed; it moves by itself now"
        why = "no joint can follow itself; it moves by itself now" if found else why
        work.change("bad_joint", name, f"follows {told!r}", "follows none", why)


def unit_axes(work: Work, reason: str = "axis_length") -> None:
    """Axes of length 1."""
    for name, element in work.moving():
        told = _vector(attribute(element, "axis", "xyz"))
        length = 0.0 if told is None else float(np.linalg.norm(told))
        if told is not None and length > 1e-3 and abs(length - 1.0) > 1e-3:
            child(element, "axis").set("xyz", numbers(told / length))
            after = short(told / length)
            why = "an axis is a direction; some loaders take its length for a scale of the motion"
            work.change(reason, name, short(told), after, why)


def finite(work: Work, reason: str = "not_finite") -> None:
    """Numbers of limits, dynamics and inertia that are NaN, or endless where none may be."""
    for name, element in work.moving():
        limit = element.find("limit")
        ends = [] if limit is None else [limit.get(k) for k in ("lower", "upper")]
        if limit is not None and any(e and number(e) is None for e in ends):
            told = " .. ".join(map(str, ends))
            if element.get("type") == "revolute" and "nan" not in told.lower():
                element.set("type", "continuous")
                why = "what turns without end is continuous"
                work.change(reason, name, told, "continuous", why)
            else:
                _found(work, reason, name, element, told)
        for tag, keys in (("dynamics", ("damping", "friction")), ("limit", ("effort", "velocity"))):
            for key in keys:
                told = attribute(element, tag, key)
                if told and number(told) is None:
                    child(element, tag).attrib.pop(key)
                    work.change(reason, name, f"{key} {told}", "none", "no number")


def degrees(work: Work, reason: str = "limits_degrees") -> None:
    """Limits of turning joints in radians."""
    for name, element in work.moving():
        lower, upper = (number(attribute(element, "limit", k)) or 0.0 for k in ("lower", "upper"))
        if element.get("type") == "revolute" and in_degrees(lower, upper):
            ends = (math.radians(lower), math.radians(upper))
            _set(child(element, "limit"), *ends)
            why = f"a range of {(upper - lower) / math.tau:.0f} turns is one in degrees"
            work.change(reason, name, _range(lower, upper), _range(*ends), why)


def limits(work: Work, reason: str = "bad_limits") -> None:
    """Limits the right way round, and a range where there is none.

    A range that nobody wrote is what the part can do without running into anything, as far as such
    joints usually go. A slide without one that hangs on nothing is the free base of a robot.
    """
    missing = []
    for name, element in work.moving():
        if element.get("type") == "continuous":
            continue
        limit = child(element, "limit")
        told = [number(limit.get(k)) for k in ("lower", "upper")]
        lower, upper = (0.0 if v is None else v for v in told)
        if upper < lower:
            _set(limit, upper, lower)
            why = "the lower end is the lower number"
            work.change(reason, name, _range(lower, upper), _range(upper, lower), why)
        elif upper - lower < 1e-6:
            missing.append((name, element, told))
    for name, element, told in missing:
        if told == [None, None] and element.get("type") == "revolute":
            element.set("type", "continuous")
            why = "a turning joint without limits has none, as loaders have it"
            work.change(reason, name, "no limits", "continuous", why)
        elif told == [None, None] and not _on_something(work, element):
            element.set("type", "fixed")
            why = "nothing is there to slide on: it frees the base, which a simulator does itself"
            work.change(reason, name, "a slide without limits", "fixed", why)
        else:
            before = "none" if told == [None, None] else _range(*(v or 0.0 for v in told))
            _found(work, reason, name, element, before)


def _on_something(work: Work, element: ET.Element) -> bool:
    """Whether anything between a joint and the root has a shape."""
    up = {attribute(j, "child", "link"): attribute(j, "parent", "link")
          for j in work.joints.values()}  # fmt: skip
    at = attribute(element, "parent", "link")
    for _ in range(len(up) + 1):
        link = work.links.get(at)
        if link is not None and any(link.find(tag) is not None for tag in SHAPES):
            return True
        if at not in up:
            break
        at = up[at]
    return False


def _found(work: Work, reason: str, name: str, element: ET.Element, before: str) -> None:
    """Measure a range by moving the part among all that stands still."""
    limit = child(element, "limit")
    kept = dict(limit.attrib)
    _set(limit, 0.0, 1.0)  # the model reads no empty range
    work.touch()
    model = work.model()
    joint = None if model is None else next(
        (j for j in model.articulation.joints if j.name == name), None)  # fmt: skip
    if model is None or joint is None:
        limit.attrib = kept
        return
    around = around_of(model, joint)
    if around is None:
        limit.attrib = kept
        return
    ways = [embedded_limits(around, joint.subtype, sign * joint.axis, joint.origin)
            for sign in (1.0, -1.0)]  # fmt: skip
    best = 0 if ways[0].upper >= 0.98 * ways[1].upper else 1
    ends = (0.0, ways[0].upper) if best == 0 else (-ways[1].upper, 0.0)
    _set(limit, *ends)
    why = "measured: as far as such joints go without running into anything"
    work.change(reason, name, before, _range(*ends), why)


def around_of(model: CheckModel, joint: Joint) -> Surroundings | None:
    """What a joint's part may run into; None where nothing stands still."""
    articulation = model.articulation
    part = np.concatenate([articulation.links[i].faces for i in articulation.carried_links(joint)])
    static = np.setdiff1d(np.arange(len(articulation.mesh.faces)), part)
    if not len(part) or not len(static):
        return None
    return Surroundings.of(articulation.mesh, part, static)


def effort(work: Work, reason: str = "effort_missing") -> None:
    """Effort and velocity that are positive."""
    for name, element in work.moving():
        for key, value in (("effort", DEFAULT_EFFORT), ("velocity", DEFAULT_VELOCITY)):
            told = number(attribute(element, "limit", key))
            if told is None or told <= 0:
                child(element, "limit").set(key, repr(value))
                before = f"{key} {'none' if told is None else f'{told:g}'}"
                why = "without it a drive gets no force, or the file is refused"
                work.change(reason, name, before, f"{value:g}", why)


def friction(work: Work, reason: str = "no_friction") -> None:
    """Friction that holds the part where it is left, and damping that brings it to rest."""
    model = work.model()
    if model is None:
        return
    bare = replace(
        model.articulation,
        joints=tuple(replace(j, friction=0.0, damping=0.0) for j in model.articulation.joints),
    )
    wanted = set(model.friction)
    if reason == "sags" and work.report is not None:
        wanted = {j.name for j in work.report.joints if "sags" in j.reasons}
    for joint in with_dynamics(bare, body_inertials(work, model)).joints:
        element = work.joints.get(joint.name)
        had = model.friction.get(joint.name, (0.0, 0.0))
        if element is None or joint.type == "fixed" or joint.name not in wanted:
            continue
        if (reason == "no_friction" and any(had)) or had[0] >= joint.friction:
            continue
        damping = max(had[1], joint.damping)
        dynamics = child(element, "dynamics")
        dynamics.set("friction", f"{joint.friction:.4g}")
        dynamics.set("damping", f"{damping:.4g}")
        unit, per = ("N", "m") if joint.type == "prismatic" else ("N m", "rad")
        why = "by its weight and kind: a hand moves it, and it stays where it is left"
        before = f"friction {had[0]:.3g}, damping {had[1]:.3g}"
        after = f"{joint.friction:.3g} {unit}, {damping:.3g} {unit} s/{per}"
        work.change(reason, joint.name, before, after, why)


def strict(work: Work, reason: str = "friction_refused") -> None:
    """Take away what a parser in strict mode refuses: joint friction, or tags that it has not."""
    for name, element in work.moving():
        dynamics = element.find("dynamics")
        keys = (
            ["friction"]
            if reason == "friction_refused"
            else refused_tags(element, PROFILES["drake"])
        )
        for key in keys:
            before = f"<{key}>"
            for own in element.findall(key):
                element.remove(own)
            if dynamics is not None and key in dynamics.attrib:
                before = f"{key} {dynamics.attrib.pop(key)}"
            elif key == "friction":
                continue
            why = "Drake in strict mode refuses the file because of it, and ignores it otherwise"
            work.change(reason, name, before, "none", why)


def _set(limit: ET.Element, lower: float, upper: float) -> None:
    limit.set("lower", repr(float(lower)))
    limit.set("upper", repr(float(upper)))


def _range(lower: float, upper: float) -> str:
    return f"{lower:.4g} .. {upper:.4g}"


def _vector(text: str) -> np.ndarray | None:
    try:
        values = np.array([float(w) for w in text.split()])
    except ValueError:
        return None
    return values if len(values) in (1, 3, 4) and np.isfinite(values).all() else None
