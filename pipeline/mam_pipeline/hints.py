"""The hints file: what a person (or the photo reconstructor) knows about the parts.

One schema for both. Written by the reconstructor, read by the engine, edited by a person:

    schema: 1
    up: z                                   # optional: axis of the file: x, -x, y, -y, z, -z
    facing: -y                              # optional: axis of the file in which its front looks
    height: 0.72                            # optional: metres, floor to top
    photo_front: [x, y, x, y, x, y, x, y]   # optional: front corners TL, TR, BR, BL on the photo
    cut: [[310, 311, 315]]                  # faces of a primitive that become one of their own
    merge: [[1, 2, 3], [7, 8]]              # primitives that are one part
    fixed: [4]                              # primitives that must not move
    accept: [lid_0]                         # dormant parts that move after all; or [all]
    parts:
      - name: drawer_0                      # alone, of a part that was found: it moves
        kind: drawer
        primitives: [3, 4]                  # any of: primitives, nodes (source node names),
        nodes: [drawer_0_front]             #         box (whatever lies inside)
        box: {center: [x, y, z], size: [x, y, z]}       # metres, asset frame
        parent: body                        # default: the base
        joint: {subtype: slide, axis: [-1, 0, 0], origin: [0, 0, 0], lower: 0, upper: 0.3,
                hinge_side: left,           # every key optional; subtype fixed forbids motion
                travel: given}              # whence lower and upper: given | usual | depth
        handle: {center: [...], size: [...]}
        confidence: 0.9
        provenance: observed                # observed | inferred | model | assumed | user
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import yaml
from pydantic import Field

from mam_pipeline import folders
from mam_pipeline.edited import (
    STRICT,
    Direction,
    Document,
    Finite,
    Index,
    Length,
    Share,
    Size,
    Vector,
    Word,
    Wrong,
    no_cycle,
    no_doubles,
    read_yaml,
    validated,
)
from mam_pipeline.errors import ConfigError
from mam_pipeline.types import Axis, JointSubtype, Provenance

MOST_PARTS = 300
"""As many as a URDF may have links."""


@dataclass(frozen=True)
class HintLimits:
    """What a hints file can hold.

    Attributes:
        bytes: of the file; half a million faces to cut fit in.
    """

    bytes: int = 4 << 20


LIMITS = HintLimits()


@dataclass(frozen=True)
class PhotoTravel:
    """How far what was read on a photo goes, where nothing tells it.

    Attributes:
        drawer: a drawer's way, as a share of the depth inside the body.
    """

    drawer: float = 0.75


TRAVEL = PhotoTravel()


@dataclass(frozen=True)
class HintBox:
    """Axis-aligned box, metres, asset frame."""

    __pydantic_config__ = STRICT
    center: Vector
    size: Size


@dataclass(frozen=True)
class HintJoint:
    """What is known of a joint; None leaves it to the engine. Sides as seen from the front.

    `travel`: where lower and upper come from: given by a person, as far as such parts usually go,
    or the assumed share (`TRAVEL.drawer`) of the depth inside the object.
    """

    __pydantic_config__ = STRICT
    subtype: JointSubtype | None = None
    axis: Direction | None = None
    origin: Vector | None = None
    lower: Finite | None = None
    upper: Finite | None = None
    hinge_side: Literal["left", "right", "top", "bottom"] | None = None
    travel: Literal["given", "usual", "depth"] = "given"


@dataclass(frozen=True)
class HintPart:
    """One part: how to find its faces, and what is known of it."""

    __pydantic_config__ = STRICT
    name: Word
    kind: Word = "part"
    primitives: tuple[Index, ...] = ()
    nodes: tuple[str, ...] = ()
    box: HintBox | None = None
    parent: Word | None = None
    joint: HintJoint | None = None
    handle: HintBox | None = None
    confidence: Share = 1.0
    provenance: Provenance = "user"


@dataclass(frozen=True)
class Hints:
    """The whole file; an empty one says nothing. `source` is where it comes from, for errors."""

    __pydantic_config__ = STRICT
    schema: Literal[1] = 1
    up: Axis | None = None
    facing: Axis | None = None
    height: Length | None = None
    cut: tuple[tuple[Index, ...], ...] = ()
    merge: tuple[tuple[Index, ...], ...] = ()
    fixed: tuple[Index, ...] = ()
    accept: tuple[Word, ...] = ()
    parts: Annotated[tuple[HintPart, ...], Field(max_length=MOST_PARTS)] = ()
    photo_front: tuple[Finite, ...] = ()  # pixels of the upright photo; written by the studio
    source: str = field(default="", compare=False, repr=False)

    @property
    def empty(self) -> bool:
        return not (self.cut or self.merge or self.fixed or self.parts)


def load_hints(path: str | Path, shown: str | Path | None = None) -> Hints:
    """Read a hints file.

    Args:
        shown: the file as the person knows it, where it is read from a copy.

    Raises:
        ConfigError: missing, not YAML, or a key or value that the schema does not know.
    """
    file = Path(path)
    if not file.is_file():
        raise ConfigError(f"no hints file at {shown or file}")
    if file.stat().st_size > LIMITS.bytes:
        most = LIMITS.bytes >> 20
        raise ConfigError(f"{shown or file} is larger than {most} MiB; name fewer faces to cut")
    return _hints(read_yaml(file, shown))


def parse_hints(data: Any, source: str = "hints") -> Hints:
    """Hints from what a YAML file holds.

    Args:
        source: where the data is from, for errors.

    Raises:
        ConfigError: a key or value that the schema does not know.
    """
    return _hints(Document(data, source))


def _hints(document: Document) -> Hints:
    if document.values is None:
        document = replace(document, values={})
    hints = validated(Hints, document)
    try:
        _consistent(hints)
    except Wrong as wrong:
        raise document.wrong(wrong.place, str(wrong)) from wrong
    return replace(hints, source=document.source)


def _consistent(hints: Hints) -> None:
    """Raise `Wrong` for what no single value tells."""
    names = [part.name for part in hints.parts]
    no_doubles(names, ("parts",), "part")
    no_cycle({part.name: part.parent for part in hints.parts}, ("parts",))
    owner: dict[int, str] = {}
    for i, part in enumerate(hints.parts):
        for primitive in part.primitives:
            if owner.setdefault(primitive, part.name) != part.name:
                text = f"names primitive {primitive}, which is in {owner[primitive]!r} already"
                raise Wrong(("parts", i, "primitives"), text)
        lower, upper = (part.joint.lower, part.joint.upper) if part.joint else (None, None)
        if lower is not None and upper is not None and upper <= lower:
            raise Wrong(("parts", i, "joint"), f"has upper {upper:g}, which is not above {lower:g}")
    if len(hints.photo_front) not in (0, 8):
        text = f"must be eight numbers, not {len(hints.photo_front)}"
        raise Wrong(("photo_front",), text)


def save_hints(hints: Hints, path: str | Path) -> None:
    """Write a hints file that `load_hints` reads back to an equal value."""

    def plain(value: Any) -> Any:
        if dataclasses.is_dataclass(value) and not isinstance(value, type):
            fields = [f.name for f in dataclasses.fields(value) if f.repr]
            pairs = {name: getattr(value, name) for name in fields}
            return {k: plain(v) for k, v in pairs.items() if v is not None and v != ()}
        if isinstance(value, tuple):
            return [plain(v) for v in value]
        return value

    text = yaml.safe_dump(plain(hints), sort_keys=False, default_flow_style=None)
    folders.write_text(Path(path), text)
