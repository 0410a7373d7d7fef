"""The URDF of an asset: link frames at the joints, axes as the asset's, paths relative."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from mam_pipeline.types import Articulation, CollisionShape, FloatArray, Inertial, Joint


def link_origins(articulation: Articulation) -> FloatArray:
    """(L, 3) origin of every link frame in the asset frame at rest; axes are the asset's."""
    out = np.zeros((len(articulation.links), 3))
    for joint in articulation.joints:
        out[joint.child] = joint.origin
    return out


def urdf_text(
    articulation: Articulation,
    inertials: Sequence[Inertial],
    visuals: Mapping[str, Sequence[tuple[str, str]]],
    collisions: Mapping[str, Sequence[tuple[CollisionShape, str]]],
    name: str,
) -> str:
    """Build the XML.

    No `<material>` is written: the meshes carry their own, and SAPIEN's loader would need a
    graphics driver merely to parse one.

    Args:
        articulation: asset frame, valid names.
        inertials: per link.
        visuals: per link name, (visual name, mesh path); vertices are in the link frame.
        collisions: per link name, (piece in the asset frame, mesh path or "" for primitives).
        name: of the robot.
    """
    robot = ET.Element("robot", {"name": name, "xmlns:drake": "http://drake.mit.edu"})
    origins = link_origins(articulation)
    for i, link in enumerate(articulation.links):
        element = ET.SubElement(robot, "link", name=link.name)
        _inertial(element, inertials[i], origins[i])
        for visual_name, path in visuals.get(link.name, ()):
            visual = ET.SubElement(element, "visual", name=visual_name)
            ET.SubElement(visual, "origin", xyz="0 0 0", rpy="0 0 0")
            ET.SubElement(ET.SubElement(visual, "geometry"), "mesh", filename=path)
        for shape, path in collisions.get(link.name, ()):
            piece = collision_element(element, shape, path, origins[i])
            _drake_friction(piece, inertials[i].friction)
    for joint in articulation.joints:
        _joint(robot, articulation, joint, origins)
    for link, body in zip(articulation.links, inertials):
        contact = ET.SubElement(robot, "gazebo", reference=link.name)
        for name in ("mu1", "mu2"):
            ET.SubElement(contact, name).text = numbers([body.friction])
    ET.indent(robot, " ")
    return '<?xml version="1.0"?>\n' + ET.tostring(robot, encoding="unicode") + "\n"


def numbers(values: Sequence[float] | FloatArray) -> str:
    """Numbers with the digits that give the same float64 back."""
    return " ".join(repr(float(v) + 0.0) for v in np.asarray(values).reshape(-1))


def _inertial(element: ET.Element, body: Inertial, origin: FloatArray) -> None:
    inertial = ET.SubElement(element, "inertial")
    ET.SubElement(inertial, "origin", xyz=numbers(body.center - origin), rpy="0 0 0")
    ET.SubElement(inertial, "mass", value=numbers([body.mass]))
    m = body.inertia
    entries = {"ixx": m[0, 0], "ixy": m[0, 1], "ixz": m[0, 2]}
    entries |= {"iyy": m[1, 1], "iyz": m[1, 2], "izz": m[2, 2]}
    ET.SubElement(inertial, "inertia", {k: numbers([v]) for k, v in entries.items()})


def collision_element(
    element: ET.Element, shape: CollisionShape, path: str, origin: FloatArray
) -> ET.Element:
    """Add a piece to a link whose frame stands unturned at `origin` in that of the piece.

    Args:
        path: of the mesh file of a convex piece, which is in the link frame; else "".
    """
    collision = ET.SubElement(element, "collision")
    xyz, rpy = shape.pose[:3, 3] - origin, np.zeros(3)
    if shape.kind == "convex":
        xyz = np.zeros(3)  # the file is in the link frame
    elif not np.allclose(shape.pose[:3, :3], np.eye(3), atol=1e-12):
        turn = Rotation.from_matrix(shape.pose[:3, :3])
        rpy = turn.as_euler("xyz", suppress_warnings=True)  # any angles of a gimbal lock will do
    ET.SubElement(collision, "origin", xyz=numbers(xyz), rpy=numbers(rpy))
    geometry = ET.SubElement(collision, "geometry")
    if shape.kind == "box":
        ET.SubElement(geometry, "box", size=numbers(shape.size))
    elif shape.kind == "cylinder":
        radius, length = numbers(shape.size[:1]), numbers(shape.size[1:2])
        ET.SubElement(geometry, "cylinder", radius=radius, length=length)
    elif shape.kind == "sphere":
        ET.SubElement(geometry, "sphere", radius=numbers(shape.size[:1]))
    else:
        ET.SubElement(geometry, "mesh", filename=path)
    return collision


def hull_text(shape: CollisionShape, origin: FloatArray) -> str:
    """The OBJ file of a convex piece in the frame of a link that stands at `origin`."""
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in (shape.vertices - origin).tolist()]
    lines += [f"f {a} {b} {c}" for a, b, c in (shape.faces + 1).tolist()]
    return "\n".join(lines) + "\n"


def _drake_friction(collision: ET.Element, friction: float) -> None:
    """Contact friction of a piece as Drake reads it; other readers skip the element."""
    contact = ET.SubElement(collision, "drake:proximity_properties")
    for name in ("drake:mu_static", "drake:mu_dynamic"):
        ET.SubElement(contact, name, value=numbers([friction]))


def _joint(
    robot: ET.Element, articulation: Articulation, joint: Joint, origins: FloatArray
) -> None:
    element = ET.SubElement(robot, "joint", name=joint.name, type=joint.type)
    ET.SubElement(element, "parent", link=articulation.links[joint.parent].name)
    ET.SubElement(element, "child", link=articulation.links[joint.child].name)
    offset = origins[joint.child] - origins[joint.parent]
    ET.SubElement(element, "origin", xyz=numbers(offset), rpy="0 0 0")
    if joint.type == "fixed":
        return
    ET.SubElement(element, "axis", xyz=numbers(joint.axis))
    limit = {"effort": numbers([joint.effort]), "velocity": numbers([joint.velocity])}
    if joint.type != "continuous":
        limit = {"lower": numbers([joint.lower]), "upper": numbers([joint.upper]), **limit}
    ET.SubElement(element, "limit", limit)
    if joint.coupling is not None:
        follows = joint.coupling
        factors = {"multiplier": follows.multiplier, "offset": follows.offset}
        given = {k: numbers([v]) for k, v in factors.items()}
        ET.SubElement(element, "mimic", {"joint": follows.joint, **given})
    dynamics = {"damping": numbers([joint.damping]), "friction": numbers([joint.friction])}
    ET.SubElement(element, "dynamics", dynamics)
