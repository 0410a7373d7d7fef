"""What every reader of a URDF relies on: a small tree of links, and numbers that are numbers."""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from pathlib import Path

from mam_pipeline.errors import InputError
from mam_pipeline.thresholds import MAX_LINKS, MAX_SHAPES

_NUMBERS = {
    ("origin", "xyz"): (3,), ("origin", "rpy"): (3,), ("axis", "xyz"): (3,),
    ("box", "size"): (3,), ("mesh", "scale"): (1, 3), ("color", "rgba"): (4,),
    ("sphere", "radius"): (1,), ("cylinder", "radius"): (1,), ("cylinder", "length"): (1,),
    ("capsule", "radius"): (1,), ("capsule", "length"): (1,),
    ("limit", "lower"): (1,), ("limit", "upper"): (1,), ("limit", "effort"): (1,),
    ("limit", "velocity"): (1,), ("dynamics", "damping"): (1,), ("dynamics", "friction"): (1,),
    ("mass", "value"): (1,), ("mimic", "multiplier"): (1,), ("mimic", "offset"): (1,),
    **{("inertia", k): (1,) for k in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")},
}  # fmt: skip
"""How many numbers an attribute of an element holds."""
_ENDLESS = {("limit", key) for key in ("lower", "upper", "effort", "velocity")}
"""Attributes that may be infinite."""
_SHAPES = ("visual", "collision")
_SIZES = ("box", "sphere", "cylinder", "capsule")
_LONGEST = 1e6
"""Metres; nothing that a robot works with is larger, and squares of it are still exact."""


def check_bounds(root: ET.Element, path: Path) -> None:
    """Refuse a URDF that no reader could follow, or not in bounded time.

    Args:
        root: its <robot> element. path: named in errors.

    Raises:
        InputError: more links or shapes than are read, joints that form no tree, or an attribute
            that does not hold its numbers.
    """
    links = {link.get("name") or "" for link in root.findall("link")}
    if len(links) > MAX_LINKS:
        raise InputError(f"{path} has {len(links)} links; the most is {MAX_LINKS}")
    shapes = sum(1 for link in root.findall("link") for e in link if e.tag in _SHAPES)
    if shapes > MAX_SHAPES:
        raise InputError(f"{path} has {shapes} shapes; the most is {MAX_SHAPES}")
    _check_tree(root, links, path)
    for element in root.iter():
        for key, text in element.attrib.items():
            counts = _NUMBERS.get((str(element.tag), key))
            if counts is not None and text.strip():
                _check_numbers(text, counts, str(element.tag), key, path)


def _check_tree(root: ET.Element, links: set[str], path: Path) -> None:
    """Every joint holds a link that exists and that no other joint holds; no link holds itself."""
    parents: dict[str, str] = {}
    for joint in root.findall("joint"):
        name = joint.get("name") or ""
        ends = []
        for key in ("parent", "child"):
            found = joint.find(key)
            ends.append("" if found is None else found.get("link") or "")
            if ends[-1] not in links:
                raise InputError(
                    f"{path}: the {key} of joint {name!r} is link {ends[-1]!r}, which is missing"
                )
        if ends[1] in parents:
            raise InputError(f"{path}: link {ends[1]!r} is the child of two joints; one holds it")
        parents[ends[1]] = ends[0]
    settled: set[str] = set()
    for start in parents:
        way: list[str] = []
        at = start
        while at in parents and at not in settled:
            settled.add(at)
            way.append(at)
            at = parents[at]
        if at in way:
            raise InputError(f"{path}: the joints above link {at!r} form a loop")


def _check_numbers(text: str, counts: tuple[int, ...], tag: str, key: str, path: Path) -> None:
    said = f"{path}: {key}={text[:40]!r} of <{tag}>"
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        raise InputError(f"{said} is no number") from None
    if len(values) not in counts:
        wanted = " or ".join(map(str, counts))
        raise InputError(f"{said} should be {wanted} number{'s' if counts[-1] > 1 else ''}")
    finite = all(map(math.isfinite, values))
    if not finite and ((tag, key) not in _ENDLESS or any(map(math.isnan, values))):
        raise InputError(f"{said} is not finite")
    if finite and tag in (*_SIZES, "origin", "mesh") and max(map(abs, values)) > _LONGEST:
        raise InputError(f"{said} is absurdly large")
    if tag in _SIZES and min(values) < 0.0:
        raise InputError(f"{said} is negative")
