"""Elements of a URDF that is made from another format: joints, inertials and places."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
from scipy.spatial.transform import Rotation

from mam_pipeline.types import FloatArray

EFFORT, VELOCITY = 100.0, 10.0
"""N or Nm, and m/s or rad/s, of joints: URDF asks for both, and other formats limit neither."""


def between(
    robot: ET.Element, name: str, kind: str, ends: tuple[str, str],
    pose: tuple[FloatArray, Rotation],
) -> ET.Element:  # fmt: skip
    """Add a joint of a kind from parent to child, at a pose in the parent's frame."""
    element = ET.SubElement(robot, "joint", name=name, type=kind)
    origin(element, *pose)
    ET.SubElement(element, "parent", link=ends[0])
    ET.SubElement(element, "child", link=ends[1])
    return element


def moves(element: ET.Element, axis: FloatArray, limits: tuple[float, float] | None) -> None:
    """Give a joint its axis and its limits; a slide without any goes without: the check says so."""
    ET.SubElement(element, "axis", xyz=words(axis))
    limit = {"effort": f"{EFFORT:g}", "velocity": f"{VELOCITY:g}"}
    if limits is not None:
        limit |= {"lower": f"{limits[0]:.9g}", "upper": f"{limits[1]:.9g}"}
    if limits is not None or element.get("type") != "prismatic":
        ET.SubElement(element, "limit", limit)


def follows(element: ET.Element, leader: str, multiplier: float, offset: float) -> None:
    """Couple a joint to another one."""
    rule = {"multiplier": f"{multiplier:.9g}", "offset": f"{offset:.9g}"}
    ET.SubElement(element, "mimic", {"joint": leader, **rule})


def inertial(
    link: ET.Element, mass: float, moments: FloatArray | None,
    frame: tuple[FloatArray, Rotation] | None = None,
) -> None:  # fmt: skip
    """Add a mass in kilograms, with its principal moments in a frame where they are known."""
    element = ET.SubElement(link, "inertial")
    at, turn = frame or (np.zeros(3), Rotation.identity())
    origin(element, at, Rotation.identity())  # several simulators ignore how it is turned
    ET.SubElement(element, "mass", value=words(mass))
    if moments is not None:
        tensor = turn.as_matrix() @ np.diag(moments) @ turn.as_matrix().T
        pairs = ((i, j) for i in range(3) for j in range(i, 3))
        values = {f"i{'xyz'[i]}{'xyz'[j]}": words(tensor[i, j]) for i, j in pairs}
        ET.SubElement(element, "inertia", values)


def shape(
    link: ET.Element, tag: str, kind: str, size: dict[str, str], at: FloatArray, turn: Rotation
) -> None:
    """Add a visual or a collision: a box, a sphere, a cylinder or a mesh."""
    element = ET.SubElement(link, tag)
    origin(element, at, turn)
    ET.SubElement(ET.SubElement(element, "geometry"), kind, size)


def round_solid(
    link: ET.Element, tag: str, radius: float, length: float, at: FloatArray, turn: Rotation,
    capsule: bool,
) -> None:  # fmt: skip
    """Add a cylinder along z; as a capsule, with a ball at each end, since URDF has no capsules."""
    size = {"radius": f"{radius:.9g}"}
    shape(link, tag, "cylinder", {**size, "length": f"{length:.9g}"}, at, turn)
    for sign in (-0.5, 0.5) if capsule else ():
        shape(link, tag, "sphere", size, at + turn.apply([0.0, 0.0, sign * length]), turn)


def origin(element: ET.Element, at: FloatArray, turn: Rotation) -> None:
    """Add a place; any angles of a gimbal lock will do."""
    angles = turn.as_euler("xyz", suppress_warnings=True)
    ET.SubElement(element, "origin", xyz=words(at), rpy=words(angles))


def words(values: FloatArray | float) -> str:
    """Numbers with nine digits."""
    return " ".join(f"{float(v) + 0.0:.9g}" for v in np.ravel(values))
