"""The hints file: what a person (or the photo reconstructor) knows about the parts.

One schema for both. Written by the reconstructor, read by the engine, edited by a person:

    schema: 1
    up: z                                   # optional: y | z
    photo_front: [x, y, x, y, x, y, x, y]   # optional: front corners TL, TR, BR, BL on the photo
    merge: [[1, 2, 3], [7, 8]]              # primitives that are one part
    fixed: [4]                              # primitives that must not move
    parts:
      - name: drawer_0
        kind: drawer
        primitives: [3, 4]                  # any of: primitives, nodes (source node names),
        nodes: [drawer_0_front]             #         box (whatever lies inside)
        box: {center: [x, y, z], size: [x, y, z]}       # metres, asset frame
        parent: body                        # default: the base
        joint: {subtype: slide, axis: [-1, 0, 0], origin: [0, 0, 0], lower: 0, upper: 0.3,
                hinge_side: left}           # every key optional; subtype fixed forbids motion
        handle: {center: [...], size: [...]}
        confidence: 0.9
        provenance: observed                # observed | inferred | assumed | user
"""

from __future__ import annotations

import dataclasses
import difflib
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from mam_pipeline import folders
from mam_pipeline.errors import ConfigError

SUBTYPES = ("fixed", "hinge", "spin", "slide")
SIDES = ("left", "right", "top", "bottom")
PROVENANCES = ("observed", "inferred", "assumed", "user")


@dataclass(frozen=True)
class HintBox:
    """Axis-aligned box, metres, asset frame."""

    center: tuple[float, float, float]
    size: tuple[float, float, float]


@dataclass(frozen=True)
class HintJoint:
    """What is known of a joint; None leaves it to the engine. Sides as seen from the front."""

    subtype: str | None = None
    axis: tuple[float, float, float] | None = None
    origin: tuple[float, float, float] | None = None
    lower: float | None = None
    upper: float | None = None
    hinge_side: str | None = None


@dataclass(frozen=True)
class HintPart:
    """One part: how to find its faces, and what is known of it."""

    name: str
    kind: str = "part"
    primitives: tuple[int, ...] = ()
    nodes: tuple[str, ...] = ()
    box: HintBox | None = None
    parent: str | None = None
    joint: HintJoint | None = None
    handle: HintBox | None = None
    confidence: float = 1.0
    provenance: str = "user"


@dataclass(frozen=True)
class Hints:
    """The whole file; an empty one says nothing."""

    schema: int = 1
    up: str | None = None
    merge: tuple[tuple[int, ...], ...] = ()
    fixed: tuple[int, ...] = ()
    parts: tuple[HintPart, ...] = field(default_factory=tuple)
    photo_front: tuple[float, ...] = ()  # pixels of the upright photo; written by annotate

    @property
    def empty(self) -> bool:
        return not (self.merge or self.fixed or self.parts)


def load_hints(path: str | Path) -> Hints:
    """Read a hints file.

    Raises:
        ConfigError: missing, not YAML, or a key or value that the schema does not know.
    """
    file = Path(path)
    if not file.is_file():
        raise ConfigError(f"no hints file at {file}")
    try:
        data = yaml.safe_load(file.read_text(encoding="utf-8"))
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        first = str(error).splitlines()[0]
        raise ConfigError(f"{file} is not YAML: {first}") from error
    return parse_hints(data or {}, str(file))


def parse_hints(data: Any, where: str = "hints") -> Hints:
    """Build Hints from plain YAML data; errors name the place and the nearest key."""
    top = _fields(Hints, data, where)
    if top.get("schema", 1) != 1:
        raise ConfigError(f"{where}: schema {top['schema']!r} is unknown; this is schema 1")
    parts = []
    for i, raw in enumerate(_sequence(top.get("parts", ()), f"{where}: parts")):
        at = f"{where}: parts[{i}]"
        part = _fields(HintPart, raw, at)
        if "name" not in part:
            raise ConfigError(f"{at} has no name")
        for key in ("box", "handle"):
            if part.get(key) is not None:
                box = _fields(HintBox, part[key], f"{at}.{key}")
                part[key] = HintBox(
                    _vector(box.get("center"), f"{at}.{key}.center"),
                    _vector(box.get("size"), f"{at}.{key}.size"),
                )
        if part.get("joint") is not None:
            part["joint"] = _joint(part["joint"], f"{at}.joint")
        part["primitives"] = _integers(part.get("primitives", ()), f"{at}.primitives")
        part["nodes"] = tuple(str(n) for n in _sequence(part.get("nodes", ()), f"{at}.nodes"))
        _choice(part.get("provenance", "user"), PROVENANCES, f"{at}.provenance")
        part["confidence"] = _number(part.get("confidence", 1.0), f"{at}.confidence")
        parts.append(HintPart(**part))
    merge = _sequence(top.get("merge", ()), f"{where}: merge")
    return Hints(
        up=top.get("up"),
        merge=tuple(_integers(m, f"{where}: merge") for m in merge),
        fixed=_integers(top.get("fixed", ()), f"{where}: fixed"),
        parts=tuple(parts),
        photo_front=_corners(top.get("photo_front", ()), f"{where}: photo_front"),
    )


def save_hints(hints: Hints, path: str | Path) -> None:
    """Write a hints file that `load_hints` reads back to an equal value."""

    def plain(value: Any) -> Any:
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            pairs = {f.name: getattr(value, f.name) for f in dataclasses.fields(value)}
            return {k: plain(v) for k, v in pairs.items() if v is not None and v != ()}
        if isinstance(value, tuple):
            return [plain(v) for v in value]
        return value

    text = yaml.safe_dump(plain(hints), sort_keys=False, default_flow_style=None)
    folders.write_text(Path(path), text)


def _joint(raw: Any, at: str) -> HintJoint:
    joint = _fields(HintJoint, raw, at)
    if joint.get("subtype") is not None:
        _choice(joint["subtype"], SUBTYPES, f"{at}.subtype")
    if joint.get("hinge_side") is not None:
        _choice(joint["hinge_side"], SIDES, f"{at}.hinge_side")
    for key in ("axis", "origin"):
        if joint.get(key) is not None:
            joint[key] = _vector(joint[key], f"{at}.{key}")
    for key in ("lower", "upper"):
        if joint.get(key) is not None:
            joint[key] = _number(joint[key], f"{at}.{key}")
    if joint.get("axis") is not None and sum(x * x for x in joint["axis"]) < 1e-12:
        raise ConfigError(f"{at}.axis has zero length")
    return HintJoint(**joint)


def _fields(cls: type, data: Any, where: str) -> dict[str, Any]:
    if not isinstance(data, dict):
        raise ConfigError(f"{where}: expected a mapping, got {type(data).__name__}")
    known = [f.name for f in dataclasses.fields(cls)]
    for key in data:
        if key not in known:
            near = difflib.get_close_matches(str(key), known, n=1)
            hint = f"; did you mean {near[0]!r}?" if near else f"; known: {', '.join(known)}"
            raise ConfigError(f"{where}: unknown key {key!r}{hint}")
    return dict(data)


def _sequence(value: Any, where: str) -> Sequence[Any]:
    if not isinstance(value, list | tuple):
        raise ConfigError(f"{where}: expected a list, got {type(value).__name__}")
    return value


def _integers(value: Any, where: str) -> tuple[int, ...]:
    items = _sequence(value, where)
    if any(isinstance(v, bool) or not isinstance(v, int) or v < 0 for v in items):
        raise ConfigError(f"{where}: expected non-negative integers, got {list(items)!r}")
    return tuple(items)


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ConfigError(f"{where}: expected a number, got {value!r}")
    return float(value)


def _vector(value: Any, where: str) -> tuple[float, float, float]:
    items = [_number(v, where) for v in _sequence(value, where)]
    if len(items) != 3:
        raise ConfigError(f"{where}: expected three numbers, got {len(items)}")
    return (items[0], items[1], items[2])


def _corners(value: Any, where: str) -> tuple[float, ...]:
    items = tuple(_number(v, where) for v in _sequence(value, where))
    if len(items) not in (0, 8):
        raise ConfigError(f"{where}: expected eight numbers, got {len(items)}")
    return items


def _choice(value: Any, allowed: Sequence[str], where: str) -> None:
    if value not in allowed:
        raise ConfigError(f"{where}: {value!r} is not one of {', '.join(allowed)}")
