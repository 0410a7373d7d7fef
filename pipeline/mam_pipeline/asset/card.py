"""asset.json: the card of an asset folder (schema 2), read and written as dataclasses."""

from __future__ import annotations

import json
import math
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from mam_pipeline import folders
from mam_pipeline.errors import InputError
from mam_pipeline.formats.door import Door
from mam_pipeline.formats.suffixes import MESHES, PHOTOS
from mam_pipeline.formats.urdf.admit import admitted
from mam_pipeline.types import MOVES, NEEDS_REVIEW, Coupling, Provenance, RangeBasis

SCHEMA = 2
"""Schema 1 differs in its visuals alone (GLB files), so its cards are read as they are."""
READABLE = (1, 2)


@dataclass(frozen=True)
class CardPart:
    """A link: its kind, source primitives, mass (kg), handle visuals, and assumed material."""

    link: str
    name: str
    kind: str
    primitives: list[int] = field(default_factory=list)
    mass: float = 0.0
    handles: list[str] = field(default_factory=list)
    material: str = ""


@dataclass(frozen=True)
class CardJoint:
    """A joint in the asset frame at q = 0; infinite limits are stored as null."""

    name: str
    type: str
    subtype: str
    parent: str
    child: str
    axis: list[float]
    origin: list[float]
    lower: float | None
    upper: float | None
    closed: float = 0.0
    open: float = 0.0
    damping: float = 0.0
    friction: float = 0.0
    effort: float = 100.0
    velocity: float = 2.0
    confidence: float = 1.0
    evidence: dict[str, Any] = field(default_factory=dict)
    basis: RangeBasis = field(default_factory=RangeBasis)
    provenance: Provenance = "inferred"
    coupling: Coupling | None = None

    @property
    def review(self) -> str:
        """Why somebody should look at the joint, in words; empty if nobody need."""
        if self.basis.share < MOVES:
            return f"needs review: stuck after {100 * self.basis.share:.0f} % of the usual way"
        unsure = self.confidence < NEEDS_REVIEW and self.provenance != "user"
        return "needs review" if unsure else ""


@dataclass(frozen=True)
class CardGrasp:
    """Where to take hold of a link at q = 0, asset frame (see mam_pipeline.types.Grasp)."""

    joint: str
    link: str
    kind: str
    position: list[float]
    approach: list[float]
    closing: list[float]
    width: float
    depth: float = 0.02
    confidence: float = 1.0
    provenance: str = "inferred"


@dataclass(frozen=True)
class AssetCard:
    """Everything that asset.json says; paths are relative to the folder."""

    name: str
    urdf: str = "object.urdf"
    schema: int = SCHEMA
    source: dict[str, Any] = field(default_factory=dict)
    source_to_asset: list[list[float]] = field(default_factory=lambda: np.eye(4).tolist())
    metres_per_unit: float = 1.0
    metres_per_unit_source: str = "assumed"
    placement: list[dict[str, Any]] = field(default_factory=list)
    bounds: list[list[float]] = field(default_factory=list)
    parts: list[CardPart] = field(default_factory=list)
    joints: list[CardJoint] = field(default_factory=list)
    grasps: list[CardGrasp] = field(default_factory=list)
    backends: dict[str, Any] = field(default_factory=dict)
    checks: dict[str, Any] = field(default_factory=dict)
    seconds: dict[str, float] = field(default_factory=dict)
    exports: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def save(self, folder: Path) -> None:
        """Write asset.json into `folder` (UTF-8, no NaN)."""
        text = json.dumps(_plain(asdict(self)), indent=1, allow_nan=False, sort_keys=False)
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
        for kind, suffixes in (("mesh", MESHES), ("photo", PHOTOS)):
            if folder.is_file() and folder.suffix.lower() in suffixes:
                raise InputError(f"{path} is a {kind}, not an asset; run: mam-sim make-env {path}")
        door = Door(folder)
        if door.find(file.name, file) is None:
            raise InputError(f"no asset.json in {folder}; make one with: mam-sim make-env INPUT")
        try:
            data = json.loads(file.read_text(encoding="utf-8"))
            if data.get("schema") not in READABLE:
                found = data.get("schema")
                raise InputError(
                    f"{file} has schema {found!r}, and this version reads 1 and 2; make it again "
                    "with: mam-sim make-env INPUT"
                )
            data["parts"] = [CardPart(**p) for p in data.get("parts", [])]
            data["joints"] = [_joint(j) for j in data.get("joints", [])]
            data["grasps"] = [CardGrasp(**g) for g in data.get("grasps", [])]
            asset = Asset(folder.resolve(), AssetCard(**data))
        except (json.JSONDecodeError, TypeError, AttributeError) as error:
            raise InputError(f"{file} is not a valid asset card: {error}") from error
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
    for joint in card.joints:
        element = joints.get(joint.name)
        if element is None:
            yield f"joint {joint.name!r} of asset.json is not in the URDF"
            continue
        said = {"type": element.get("type")}
        for key in ("parent", "child"):
            end = element.find(key)
            said[key] = None if end is None else end.get("link")
        for key, value in said.items():
            if getattr(joint, key) != value:
                told = f"its {key} is {getattr(joint, key)!r} in asset.json and {value!r} in"
                yield f"joint {joint.name!r}: {told} the URDF"
    named = {joint.name for joint in card.joints}
    for i, grasp in enumerate(card.grasps):
        for key, known in (("joint", named), ("link", links)):
            if getattr(grasp, key) not in known:
                yield f"grasp {i} of asset.json is of {key} {getattr(grasp, key)!r}, which is none"


def _joint(row: dict[str, Any]) -> CardJoint:
    read: dict[str, Any] = {"basis": RangeBasis(**row.get("basis", {}))}
    if row.get("coupling") is not None:
        read["coupling"] = Coupling(**row["coupling"])
    return CardJoint(**{**row, **read})


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
