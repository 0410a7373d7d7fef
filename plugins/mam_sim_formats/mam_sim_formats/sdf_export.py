"""Export of an asset folder to SDF, Gazebo's format, as a model folder."""

from __future__ import annotations

import shutil
import xml.etree.ElementTree as ET
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mam_pipeline import folders
from mam_pipeline.asset.card import Asset, CardPart
from mam_pipeline.formats.files import files_of
from mam_pipeline.formats.urdf.geometry import existing, mesh_scale, origin_of
from mam_pipeline.formats.urdf.tree import MOVING, UrdfTree
from mam_pipeline.formats.urdf.write import numbers
from mam_pipeline.types import FloatArray

VERSION, WITH_MIMIC = "1.9", "1.11"
"""Of SDF: what Gazebo Fortress and later read, and the first one with couplings of joints."""
RESERVED = "world"
"""What SDF calls the world; no link may have that name."""
TENSOR = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}


def export_sdf(asset: Asset, path: str | Path | None = None) -> Path:
    """Write object.sdf, model.config and the meshes (folder `sdf/` beside them); returns the SDF.

    Links stand in the model's frame at q = 0, joints in that of their child, as in the URDF. The
    base is fixed to the world. Mesh names are relative to the file.

    Args:
        asset: the folder. path: of the SDF; default ASSET/object.sdf.

    Raises:
        InputError: the URDF cannot be read, or names a file that does not exist.
    """
    target = Path(path) if path is not None else asset.folder / "object.sdf"
    tree = UrdfTree.read(asset.urdf_path)
    moving = [j for j in tree.robot.joints if j.type in MOVING]
    version = WITH_MIMIC if any(j.mimic is not None for j in moving) else VERSION
    root = ET.Element("sdf", version=version)
    model = ET.SubElement(root, "model", name=asset.card.name)
    parts = {part.link: part for part in asset.card.parts}
    names = {link.name: _free(link.name, tree.frames) for link in tree.robot.links}
    for link in tree.robot.links:
        if link.name in tree.frames:
            element = ET.SubElement(model, "link", name=names[link.name])
            _link(element, link, tree.frames[link.name], asset.urdf_path, parts.get(link.name))
    base = ET.SubElement(model, "joint", name="world_fixed", type="fixed")
    _words(base, parent=RESERVED, child=names[tree.root])
    for joint in tree.robot.joints:
        if joint.child in tree.frames:
            _joint(model, joint, (names[joint.parent], names[joint.child]))
    with folders.new_entries(target.parent, target.name) as work:
        for file in files_of(asset.urdf_path)[1:]:
            place = work / "sdf" / file.resolve().relative_to(asset.folder.resolve())
            place.parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(file, place)
        _save(root, work / target.name)
        config = ET.Element("model")
        _words(config, name=asset.card.name, version="1.0")
        ET.SubElement(config, "sdf", version=version).text = target.name
        _save(config, work / "model.config")
    return target


def _free(name: str, taken: Collection[str]) -> str:
    """The name of a link; another where SDF keeps it for the world."""
    new = name
    while new == RESERVED or (new != name and new in taken):
        new += "_link"
    return new


def _save(root: ET.Element, file: Path) -> None:
    ET.indent(root, " ")
    ET.ElementTree(root).write(file, encoding="utf-8", xml_declaration=True)


def _words(element: ET.Element, **values: object) -> None:
    """A child with a text for each value."""
    for tag, value in values.items():
        ET.SubElement(element, tag).text = str(value)


def _pose(element: ET.Element, frame: FloatArray) -> None:
    """The pose of a link in the model, or of what belongs to a link in it."""
    angles = Rotation.from_matrix(frame[:3, :3]).as_euler("xyz", suppress_warnings=True)
    _words(element, pose=numbers([*frame[:3, 3], *angles]))


def _link(
    element: ET.Element, link: Any, frame: FloatArray, urdf: Path, part: CardPart | None
) -> None:
    _pose(element, frame)
    own = link.inertial
    if own is not None and own.mass and own.inertia is not None:
        inertial = ET.SubElement(element, "inertial")
        _pose(inertial, origin_of(own))
        _words(inertial, mass=numbers([own.mass]))
        tensor = ET.SubElement(inertial, "inertia")
        _words(tensor, **{key: numbers([own.inertia[at]]) for key, at in TENSOR.items()})
    for tag, shapes in (("visual", link.visuals), ("collision", link.collisions)):
        for i, shape in enumerate(shapes):
            made = ET.SubElement(element, tag, name=f"{link.name}_{tag}_{i}")
            _pose(made, origin_of(shape))
            _geometry(ET.SubElement(made, "geometry"), shape.geometry, urdf)
            color = getattr(getattr(shape, "material", None), "color", None)
            if tag == "visual" and color is not None and shape.geometry.mesh is None:
                rgba = numbers(np.asarray(color.rgba, dtype=float))
                _words(ET.SubElement(made, "material"), ambient=rgba, diffuse=rgba)
            if tag == "collision" and part is not None:
                _contact(made, part)


def _geometry(element: ET.Element, geometry: Any, urdf: Path) -> None:
    if geometry.box is not None:
        _words(ET.SubElement(element, "box"), size=numbers(np.asarray(geometry.box.size)))
    elif geometry.sphere is not None:
        _words(ET.SubElement(element, "sphere"), radius=numbers([geometry.sphere.radius]))
    elif geometry.cylinder is not None:
        own = geometry.cylinder
        sizes = {"radius": numbers([own.radius]), "length": numbers([own.length])}
        _words(ET.SubElement(element, "cylinder"), **sizes)
    else:
        file = existing(geometry.mesh.filename, urdf).resolve()
        place = file.relative_to(urdf.parent.resolve()).as_posix()
        scale = numbers(mesh_scale(geometry.mesh))
        _words(ET.SubElement(element, "mesh"), uri=f"sdf/{place}", scale=scale)


def _contact(collision: ET.Element, part: CardPart) -> None:
    """Friction and bounce of a collision shape."""
    surface = ET.SubElement(collision, "surface")
    bounce = ET.SubElement(surface, "bounce")
    _words(bounce, restitution_coefficient=numbers([part.restitution]))
    rows = ET.SubElement(ET.SubElement(surface, "friction"), "ode")
    _words(rows, mu=numbers([part.friction]), mu2=numbers([part.friction]))


def _joint(model: ET.Element, joint: Any, ends: tuple[str, str]) -> None:
    kind = joint.type if joint.type in MOVING else "fixed"
    element = ET.SubElement(model, "joint", name=joint.name, type=kind)
    _words(element, parent=ends[0], child=ends[1])
    if kind == "fixed":
        return
    axis = ET.SubElement(element, "axis")
    _words(axis, xyz=numbers(np.array([1.0, 0, 0]) if joint.axis is None else joint.axis))
    own, limit = joint.limit, ET.SubElement(axis, "limit")
    keys = (
        ["effort", "velocity"] if kind == "continuous" else ["lower", "upper", "effort", "velocity"]
    )
    given = {} if own is None else {key: getattr(own, key) for key in keys}
    _words(limit, **{k: numbers([float(v)]) for k, v in given.items() if v is not None})
    if joint.dynamics is not None:
        told = {"damping": joint.dynamics.damping, "friction": joint.dynamics.friction}
        values: Mapping[str, str] = {k: numbers([float(v or 0.0)]) for k, v in told.items()}
        _words(ET.SubElement(axis, "dynamics"), **values)
    if joint.mimic is not None:
        rule = ET.SubElement(axis, "mimic", joint=joint.mimic.joint)
        factor = 1.0 if joint.mimic.multiplier is None else float(joint.mimic.multiplier)
        offset = float(joint.mimic.offset or 0.0)
        _words(rule, multiplier=numbers([factor]), offset=numbers([offset]), reference="0")
