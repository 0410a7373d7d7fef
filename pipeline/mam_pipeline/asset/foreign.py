"""A URDF that our writer did not write, as an asset that robots can be given: its file and a card.

Collision shapes, masses, limits and friction are the file's. The card says what our writer would
have said beside them: joints, and where to grasp.
"""

from __future__ import annotations

import shutil
import xml.etree.ElementTree as ET
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from mam_pipeline.asset.card import Asset, AssetCard, CardGrasp, CardJoint, CardPart
from mam_pipeline.asset.grasps import find_grasps
from mam_pipeline.errors import InputError
from mam_pipeline.formats.files import files_of
from mam_pipeline.formats.urdf.admit import admitted
from mam_pipeline.formats.urdf.read import read_bodies, read_urdf
from mam_pipeline.geometry.sampling import sample_surface
from mam_pipeline.types import FloatArray, Mesh


@dataclass(frozen=True)
class Upright:
    """How the true object's file is laid on an asset whose source has Y up.

    Attributes:
        least: cosine between the asset's up and the source's +Y from which Y is up there.
        points: of each surface that are compared.
    """

    least: float = 0.999
    points: int = 2000

    @property
    def y_up_T_z_up(self) -> FloatArray:
        """(4, 4) coordinates of an object with Z up to those with Y up, by glTF's rule."""
        return np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])


UPRIGHT = Upright()


def foreign_card(urdf: Path, **more: Any) -> AssetCard:
    """The card of a URDF: what it says itself, and where its parts can be grasped.

    Args:
        urdf: in the folder that the card is for. more: further fields of the card.

    Raises:
        InputError: it is no URDF that can be read, or nothing moves in it.
    """
    articulation = read_urdf(urdf)
    root = admitted(urdf)
    elements = {e.get("name"): e for e in root.findall("joint")}
    known = {j.name for j in articulation.joints if j.coupling is None}
    joints = []
    for joint in articulation.joints:
        element = elements.get(joint.name)
        if element is None:
            raise InputError(f"{urdf}: joint {joint.name!r} has no element of its name")
        finite = np.isfinite([joint.lower, joint.upper])
        follows = joint.coupling
        joints.append(
            CardJoint(
                name=joint.name,
                type=str(element.get("type")),  # type: ignore[arg-type]
                subtype="slide" if joint.type == "prismatic" else "hinge",
                axis=joint.axis.tolist(),
                origin=joint.origin.tolist(),
                lower=float(joint.lower) if finite[0] else None,
                upper=float(joint.upper) if finite[1] else None,
                closed=joint.closed,
                open=joint.open,
                friction=_number(element, "dynamics", "friction"),
                damping=_number(element, "dynamics", "damping"),
                provenance="user",
                parent=_word(element, "parent", "link"),
                child=_word(element, "child", "link"),
                coupling=follows if follows is not None and follows.joint in known else None,
            )
        )
    grasps = []
    for grasp in find_grasps(articulation):
        data = asdict(grasp)
        data |= {k: data[k].tolist() for k in ("position", "approach", "closing")}
        grasps.append(CardGrasp(**data))
    links = {e.get("name"): e for e in root.findall("link")}
    parts = []
    for link in articulation.links:
        body = links[link.name].find("inertial")
        mass = 0.0 if body is None else _number(body, "mass", "value")
        parts.append(CardPart(link.name, link.name, link.kind, mass=mass))
    card = AssetCard(
        name=urdf.stem,
        urdf=urdf.name,
        bounds=articulation.mesh.bounds.tolist(),
        parts=parts,
        joints=joints,
        grasps=grasps,
        notes=["joints, masses, friction and collision shapes are those of a URDF from elsewhere"],
    )
    return replace(card, **more)


def _word(element: ET.Element, tag: str, key: str) -> str:
    found = element.find(tag)
    return "" if found is None else str(found.get(key))


def _number(element: ET.Element, tag: str, key: str) -> float:
    """A number that is at least 0; 0 for none."""
    try:
        value = float(_word(element, tag, key))
    except ValueError:
        return 0.0
    return value if 0.0 <= value < np.inf else 0.0


def foreign_asset(urdf: Path, out: Path) -> Asset:
    """Copy a URDF and its files into the folder `out`, with a card.

    Raises:
        InputError: see foreign_card.
    """
    card = foreign_card(urdf)
    shutil.rmtree(out, ignore_errors=True)
    for file in files_of(urdf):
        place = out / file.resolve().relative_to(urdf.parent.resolve())
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(file, place)
    card.save(out)
    return Asset.load(out)


def true_asset(urdf: Path, asset: Asset, out: Path) -> Asset:
    """The true object of an asset as an asset folder `out` in the same frame and size.

    Args:
        urdf: an asset's own whose card says that it was made from the same file; or it stands as
            the file did that the asset was made from. Where Y was up in that file, as in glTF, it
            may also have Z up, as URDFs have, turned by glTF's own rule.

    Raises:
        InputError: see foreign_asset.
    """
    made = foreign_asset(urdf, out)
    place = _standing(made, asset, _own_card(urdf))
    scale = float(np.cbrt(np.linalg.det(place[:3, :3])))
    tree = ET.parse(made.urdf_path)
    root = tree.getroot()
    links = [str(link.get("name")) for link in root.findall("link")]
    children = {str(c.get("link")) for c in root.iter("child")}
    old, new = next(name for name in links if name not in children), "asset_frame"
    while new in links:
        new += "_"
    link = ET.SubElement(root, "link", name=new)
    inertial = ET.SubElement(link, "inertial")
    ET.SubElement(inertial, "mass", value="1")
    ET.SubElement(
        inertial, "inertia", ixx="0.01", iyy="0.01", izz="0.01", ixy="0", ixz="0", iyz="0"
    )
    joint = ET.SubElement(root, "joint", name=f"{new}_joint", type="fixed")
    angles = Rotation.from_matrix(place[:3, :3] / scale).as_euler("xyz")
    words = {"xyz": place[:3, 3] / scale, "rpy": angles}
    ET.SubElement(joint, "origin", {k: " ".join(f"{x:.9g}" for x in v) for k, v in words.items()})
    ET.SubElement(joint, "parent", link=new)
    ET.SubElement(joint, "child", link=old)
    tree.write(made.urdf_path, encoding="utf-8", xml_declaration=True)
    card = replace(made.card, grasps=[], metres_per_unit=scale)
    card.save(out)
    return Asset(out, card)


def _own_card(urdf: Path) -> AssetCard | None:
    """The card beside a URDF that is an asset's own; None for any other URDF."""
    try:
        asset = Asset.load(urdf.parent)
    except InputError:
        return None
    return asset.card if asset.card.urdf == urdf.name else None


def _standing(true: Asset, asset: Asset, known: AssetCard | None) -> FloatArray:
    """(4, 4) coordinates of the true object's URDF to the asset's frame, scale included.

    A card of the true object that was made from the same file says it exactly. Else two readings
    are possible where Y was up in the asset's source: the URDF has Y up, too, or Z. That one holds
    by which the two surfaces lie nearer to each other.

    Args:
        true: the copy of the URDF, with the card that we made. known: its own card, or None.
    """
    place: FloatArray = np.array(asset.card.source_to_asset, dtype=np.float64)
    if known is not None and known.source.get("sha256"):
        own = np.array(known.source_to_asset, dtype=np.float64)
        if known.source["sha256"] == asset.card.source.get("sha256") and np.linalg.det(own) > 0:
            return place @ np.linalg.inv(own)
    up = place[2, :3] / np.linalg.norm(place[2, :3])  # the asset's, in the source's axes
    if up[1] < UPRIGHT.least:
        return place
    real, made = (read_bodies(a.urdf_path).mesh for a in (true, asset))
    surface = cKDTree(_points(made))

    def apart(way: FloatArray) -> float:
        return float(surface.query(_points(real.transformed(way)))[0].mean())

    return min((place, place @ UPRIGHT.y_up_T_z_up), key=apart)


def _points(mesh: Mesh) -> FloatArray:
    """(N, 3) points of a surface, evenly spread."""
    return sample_surface(mesh.vertices, mesh.faces, UPRIGHT.points).points
