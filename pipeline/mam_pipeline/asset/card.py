"""asset.json: the card of an asset folder (schema 2), read and written as dataclasses."""

from __future__ import annotations

import json
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from mam_pipeline import folders
from mam_pipeline.asset.origins import friction_origin, motion_origin, range_origin
from mam_pipeline.claims import instead
from mam_pipeline.edited import (
    STRICT,
    Finite,
    Index,
    NotNegative,
    Positive,
    Share,
    Text,
    Word,
    Wrong,
    no_doubles,
    read_json,
    shown,
    validated,
)
from mam_pipeline.errors import InputError
from mam_pipeline.formats.door import Door
from mam_pipeline.formats.suffixes import PHOTOS, mesh_suffixes
from mam_pipeline.formats.urdf.admit import admitted
from mam_pipeline.holding import Balance, Catch, wrong_of
from mam_pipeline.thresholds import MAX_LINKS
from mam_pipeline.types import (
    NEEDS_REVIEW,
    Coupling,
    GraspKind,
    JointSubtype,
    JointType,
    Provenance,
    RangeBasis,
)

SCHEMA: Literal[2] = 2
"""Schema 1 differs in its visuals alone (GLB files), so its cards are read as they are."""
READABLE = (1, 2)
MOST_GRASPS = 20_000
Triple = Annotated[list[Finite], Field(min_length=3, max_length=3)]
Row = Annotated[list[Finite], Field(min_length=4, max_length=4)]


@dataclass(frozen=True)
class CardPart:
    """A link: its kind, source primitives, mass and the range it may be in (kg), handle visuals,
    assumed material, and how its surface feels in contacts (Coulomb's coefficient, bounce)."""

    __pydantic_config__ = STRICT
    link: Word
    name: Word
    kind: Word
    primitives: list[Index] = field(default_factory=list)
    mass: NotNegative = 0.0
    mass_range: tuple[NotNegative, NotNegative] = (0.0, 0.0)
    handles: list[Word] = field(default_factory=list)
    material: Text = ""
    friction: NotNegative = 0.4
    restitution: Share = 0.3


@dataclass(frozen=True)
class CardJoint:
    """A joint in the asset frame at q = 0; infinite limits are stored as null.

    `origins` says in words where motion, range and friction come from; `AssetCard.save` writes it.
    """

    __pydantic_config__ = STRICT
    name: Word
    type: JointType
    subtype: JointSubtype
    parent: Word
    child: Word
    axis: Triple
    origin: Triple
    lower: Finite | None
    upper: Finite | None
    closed: Finite = 0.0
    open: Finite = 0.0
    damping: NotNegative = 0.0
    friction: NotNegative = 0.0
    friction_range: tuple[NotNegative, NotNegative] = (0.0, 0.0)
    catch: Catch | None = None
    balance: Balance | None = None
    effort: NotNegative = 100.0
    velocity: NotNegative = 2.0
    confidence: Share = 1.0
    evidence: dict[str, Any] = field(default_factory=dict)
    basis: RangeBasis = field(default_factory=RangeBasis)
    provenance: Provenance = "inferred"
    coupling: Coupling | None = None
    dormant: Text = ""
    origins: dict[str, str] = field(default_factory=dict)

    @property
    def review(self) -> str:
        """Why somebody should look at the joint, in words; empty if nobody need."""
        if self.dormant:
            return f"dormant: {self.dormant}"
        if self.basis.short:
            return f"needs review: {self.basis.short}"
        unsure = self.confidence < NEEDS_REVIEW and self.provenance != "user"
        return "needs review" if unsure else ""


@dataclass(frozen=True)
class CardGrasp:
    """Where to take hold of a link at q = 0, asset frame (see mam_pipeline.types.Grasp)."""

    __pydantic_config__ = STRICT
    joint: Word
    link: Word
    kind: GraspKind
    position: Triple
    approach: Triple
    closing: Triple
    width: NotNegative
    depth: NotNegative = 0.02
    confidence: Share = 1.0
    provenance: Provenance = "inferred"


@dataclass(frozen=True)
class AssetCard:
    """Everything that asset.json says; paths are relative to the folder.

    Attributes:
        joints: as the URDF has them. dormant: joints that may be and are fixed in the URDF, as they
            would be if they were woken; the field is optional in a file.
        unconfirmed: what is doubted of the photo that a draft was made from, and the line that
            settles it; empty for what is no draft.
    """

    __pydantic_config__ = STRICT
    name: Word
    urdf: Word = "object.urdf"
    schema: Literal[1, 2] = SCHEMA
    source: dict[str, Any] = field(default_factory=dict)
    source_to_asset: Annotated[list[Row], Field(min_length=4, max_length=4)] = field(
        default_factory=lambda: np.eye(4).tolist()
    )
    metres_per_unit: Positive = 1.0
    metres_per_unit_source: Text = "assumed"
    placement: list[dict[str, Any]] = field(default_factory=list)
    bounds: Annotated[list[Triple], Field(max_length=2)] = field(default_factory=list)
    parts: Annotated[list[CardPart], Field(max_length=MAX_LINKS)] = field(default_factory=list)
    joints: Annotated[list[CardJoint], Field(max_length=MAX_LINKS)] = field(default_factory=list)
    dormant: Annotated[list[CardJoint], Field(max_length=MAX_LINKS)] = field(default_factory=list)
    grasps: Annotated[list[CardGrasp], Field(max_length=MOST_GRASPS)] = field(default_factory=list)
    backends: dict[str, Any] = field(default_factory=dict)
    checks: dict[str, Any] = field(default_factory=dict)
    seconds: dict[str, Finite] = field(default_factory=dict)
    exports: dict[str, str] = field(default_factory=dict)
    notes: list[Text] = field(default_factory=list)
    unconfirmed: Text = ""

    @property
    def draft(self) -> str:
        """One line for those who use the asset, where it is a draft; else empty."""
        why = self.unconfirmed.partition("\n")[0]
        return f"{self.name} is a draft that nobody has confirmed: {why}" if why else ""

    @property
    def movable(self) -> list[CardJoint]:
        """The joints that move."""
        return [joint for joint in self.joints if joint.type != "fixed"]

    @property
    def likeliest(self) -> list[CardJoint]:
        """The dormant joints, likeliest first."""
        return sorted(self.dormant, key=lambda joint: -joint.confidence)

    @property
    def executable(self) -> bool | None:
        """What the check said when the asset was made; None where nobody checked."""
        found = self.checks.get("executability")
        passed = found.get("passed") if isinstance(found, dict) else None
        return passed if isinstance(passed, bool) else None

    @property
    def check_reasons(self) -> tuple[str, ...]:
        """Reason codes of the check that the asset was made with."""
        found = self.checks.get("executability")
        reasons = found.get("reasons") if isinstance(found, dict) else None
        return tuple(r for r in reasons if isinstance(r, str)) if isinstance(reasons, list) else ()

    @property
    def made_from(self) -> str:
        """Kind of the source: photo, mesh, urdf or generated."""
        return str(self.source.get("kind", "urdf"))

    @property
    def size(self) -> tuple[float, float, float] | None:
        """Depth (X), width (Y) and height (Z), metres; None for a card without bounds."""
        if len(self.bounds) != 2:
            return None
        x, y, z = (high - low for low, high in zip(*self.bounds))
        return x, y, z

    def _told(self, joint: CardJoint) -> CardJoint:
        """A joint with its origins in words."""
        origins = {
            "motion": str(motion_origin(joint, self.made_from)),
            "range": str(range_origin(joint, self.made_from)),
            "friction": str(friction_origin(joint.friction_range)),
        }
        return replace(joint, origins={} if joint.type == "fixed" else origins)

    def save(self, folder: Path) -> None:
        """Write asset.json into `folder` (UTF-8, no NaN)."""
        told = replace(
            self,
            joints=[self._told(j) for j in self.joints],
            dormant=[self._told(j) for j in self.dormant],
        )
        text = json.dumps(_plain(asdict(told)), indent=1, allow_nan=False, sort_keys=False)
        folders.write_text(folder / "asset.json", text + "\n")


@dataclass(frozen=True)
class Asset:
    """An asset folder on disk with its card."""

    folder: Path
    card: AssetCard

    @property
    def urdf_path(self) -> Path:
        return self.folder / self.card.urdf

    def noted(self, **checks: Any) -> Asset:
        """With more among the card's checks, on disk too."""
        card = replace(self.card, checks={**self.card.checks, **checks})
        card.save(self.folder)
        return Asset(self.folder, card)

    @staticmethod
    def load(path: str | Path) -> Asset:
        """Open an asset folder (or its asset.json): every verb and the environment come here.

        Raises:
            InputError: the folder or card is missing, malformed or of another schema; the URDF is
                none, names files outside the folder, or is another than that of the card; or the
                path is a mesh or a photo.
        """
        asset = Asset.card_of(path)
        for why in unlike(asset.card, admitted(asset.urdf_path)):
            raise InputError(f"{asset.folder}: {why}")
        return asset

    @staticmethod
    def card_of(path: str | Path) -> Asset:
        """Read the card alone; the URDF is looked at by `load`.

        Raises:
            InputError: the folder or card is missing, malformed or of another schema, the URDF
                lies outside the folder, or the path is a mesh or a photo.
        """
        folder = Path(path)
        if folder.name == "asset.json":
            folder = folder.parent
        file = folder / "asset.json"
        for kind, suffixes in (("mesh", mesh_suffixes()), ("photo", PHOTOS)):
            if folder.is_file() and folder.suffix.lower() in suffixes:
                raise InputError(f"{path} is a {kind}, not an asset; run: mam-sim make-env {path}")
        door = Door(folder)
        if door.find(file.name, file) is None:
            raise InputError(
                f"no asset.json in {folder}{instead(folder)}; make one with: mam-sim make-env INPUT"
            )
        document = read_json(file)
        if isinstance(document.values, dict) and document.values.get("schema") not in READABLE:
            raise InputError(
                f"{file} has schema {shown(document.values.get('schema'))}, and this version reads "
                "1 and 2; make it again with: mam-sim make-env INPUT"
            )
        card: AssetCard = validated(AssetCard, document)
        try:
            _consistent(card)
        except Wrong as wrong:
            raise document.wrong(wrong.place, str(wrong)) from wrong
        asset = Asset(folder.resolve(), card)
        if door.find(asset.card.urdf, file) is None:
            raise InputError(f"{folder} names {asset.card.urdf}, which does not exist")
        return asset


def unlike(card: AssetCard, robot: ET.Element) -> Iterator[str]:
    """Sentences on what a card says of its URDF and the URDF does not have.

    Args:
        robot: root element of the URDF.
    """
    links = {e.get("name") for e in robot.findall("link")}
    joints = {e.get("name"): e for e in robot.findall("joint")}
    for part in card.parts:
        if part.link not in links:
            yield f"part {part.name!r} of asset.json is link {part.link!r}, which the URDF lacks"
    for joint in (*card.joints, *card.dormant):
        element = joints.get(joint.name)
        if element is None:
            yield f"joint {joint.name!r} of asset.json is not in the URDF"
            continue
        said = {"type": element.get("type")}
        for key in ("parent", "child"):
            end = element.find(key)
            said[key] = None if end is None else end.get("link")
        for key, value in said.items():
            own = "fixed" if key == "type" and joint.dormant else getattr(joint, key)
            if own != value:
                told = f"its {key} is {own!r} in asset.json and {value!r} in"
                yield f"joint {joint.name!r}: {told} the URDF"
    named = {joint.name for joint in card.joints}
    for i, grasp in enumerate(card.grasps):
        for key, known in (("joint", named), ("link", links)):
            if getattr(grasp, key) not in known:
                yield f"grasp {i} of asset.json is of {key} {getattr(grasp, key)!r}, which is none"


def _consistent(card: AssetCard) -> None:
    """Raise `Wrong` for what no single value tells."""
    no_doubles([part.link for part in card.parts], ("parts",), "link")
    no_doubles([joint.name for joint in (*card.joints, *card.dormant)], ("joints",), "joint")
    for i, joint in enumerate(card.dormant):
        if not joint.dormant:
            raise Wrong(("dormant", i, "dormant"), "must say why the joint is dormant")
    if len(card.bounds) == 1:
        raise Wrong(("bounds",), "must be a lower and an upper corner")
    leaders = {joint.name for joint in card.joints if joint.coupling is None}
    for place, rows in (("joints", card.joints), ("dormant", card.dormant)):
        for i, joint in enumerate(rows):
            bad = wrong_of(joint)
            if bad is not None:
                raise Wrong((place, i, *bad[0]), bad[1])
    for i, joint in enumerate(card.joints):
        if joint.coupling is not None and joint.coupling.joint not in leaders:
            text = f"must name a joint that follows none, not {joint.coupling.joint!r}"
            raise Wrong(("joints", i, "coupling", "joint"), text)
        if joint.type == "fixed":
            continue
        if sum(v * v for v in joint.axis) < 1e-12:
            raise Wrong(("joints", i, "axis"), "must not have zero length")
        if None not in (joint.lower, joint.upper) and not joint.lower <= joint.upper:  # type: ignore[operator]
            raise Wrong(("joints", i, "upper"), f"must not be below lower, {joint.lower:g}")


def _plain(value: Any) -> Any:
    """Turn numpy values and non-finite floats into what JSON can hold."""
    if isinstance(value, dict):
        return {str(k): _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
