"""MJCF of others as a URDF: bodies, hinges and slides, shapes, masses and limits as they are.

MuJoCo compiles the file, so that defaults, includes and computed inertias mean what they do there.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from mam_pipeline.errors import InputError
from mam_pipeline.formats.apart import apart
from mam_pipeline.formats.door import is_file
from mam_pipeline.formats.mjcf_files import files_of_mjcf
from mam_pipeline.optional import require
from mam_pipeline.types import FloatArray

EFFORT, VELOCITY = 100.0, 10.0
"""N or Nm, and m/s or rad/s, of joints: MJCF limits neither."""
TINY = 1e-3
"""Kilograms of a link between two joints of one body."""


def urdf_of_mjcf(path: Path, out: Path) -> Path:
    """Write a URDF of the file's name and its meshes into the folder `out`.

    Ball and free joints become fixed: a URDF has none that a robot could be asked to move.

    Args:
        path: the MJCF file.

    Raises:
        MissingExtra: MuJoCo is not installed.
        InputError: MuJoCo cannot compile the file, or not within limits, or it names files outside
            its folder.
    """
    require("MJCF", "mujoco")
    import mujoco  # noqa: F401 - once, and not in every child

    if not is_file(path):
        raise InputError(f"no MJCF at {path}")
    files_of_mjcf(path)
    return apart(lambda: _compiled(path, out), path, "MJCF", "simplify it, or give a URDF")


def _compiled(path: Path, out: Path) -> Path:
    import mujoco

    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise InputError(f"{path} is no MJCF that MuJoCo can read: {error}") from error
    out.mkdir(parents=True, exist_ok=True)
    robot = ET.Element("robot", name=path.stem)
    ends: dict[int, tuple[str, FloatArray]] = {}  # by body: its link, and its frame's place there
    for body in range(model.nbody):
        ends[body] = _body(robot, model, body, ends, out)
    _couple(robot, model)
    urdf = out / f"{path.stem}.urdf"
    ET.ElementTree(robot).write(urdf, encoding="utf-8", xml_declaration=True)
    return urdf


def _body(
    robot: ET.Element, model: Any, body: int, ends: dict[int, tuple[str, FloatArray]], out: Path
) -> tuple[str, FloatArray]:
    """Add a body's links and joints; the name of its link and the (3,) place of its frame."""
    name, place = _name(model, "BODY", body), np.zeros(3)
    if body:
        parent, offset = ends[int(model.body_parentid[body])]
        pose = offset + model.body_pos[body], _rotation(model.body_quat[body])
        first = int(model.body_jntadr[body])
        moving = [j for j in range(first, first + int(model.body_jntnum[body]))
                  if int(model.jnt_type[j]) >= 2]  # fmt: skip
        for k, joint in enumerate(moving):
            last = k == len(moving) - 1
            child = name if last else f"{name}_{k}"
            anchor = model.jnt_pos[joint]
            where = pose[0] + pose[1].apply(anchor - (np.zeros(3) if k == 0 else -place))
            _joint(robot, model, joint, (parent, child), (where, pose[1]))
            parent, pose, place = child, (np.zeros(3), Rotation.identity()), -anchor
            if not last:
                _inertial(ET.SubElement(robot, "link", name=child), TINY, np.full(3, TINY * 1e-3))
        if not moving:
            _fixed(robot, f"{name}_fixed", (parent, name), pose)
    link = ET.SubElement(robot, "link", name=name)
    if model.body_mass[body] > 0:
        frame = place + model.body_ipos[body], _rotation(model.body_iquat[body])
        _inertial(link, float(model.body_mass[body]), model.body_inertia[body], frame)
    first = int(model.body_geomadr[body])
    geoms = range(first, first + int(model.body_geomnum[body]))
    felt = [g for g in geoms if model.geom_contype[g] or model.geom_conaffinity[g]]
    seen = [g for g in geoms if g not in felt] or felt
    for tag, some in (("visual", seen), ("collision", felt)):
        for geom in some:
            _shapes(link, tag, model, geom, place, out)
    return name, place


def _joint(
    robot: ET.Element, model: Any, joint: int, ends: tuple[str, str],
    pose: tuple[FloatArray, Rotation],
) -> None:  # fmt: skip
    slide, limited = int(model.jnt_type[joint]) == 2, bool(model.jnt_limited[joint])
    kind = "prismatic" if slide else "revolute" if limited else "continuous"
    element = _between(robot, _name(model, "JOINT", joint), kind, ends, pose)
    ET.SubElement(element, "axis", xyz=_words(model.jnt_axis[joint]))
    limit = {"effort": f"{EFFORT:g}", "velocity": f"{VELOCITY:g}"}
    if limited:
        zero = model.qpos0[model.jnt_qposadr[joint]]
        low, high = model.jnt_range[joint] - zero
        limit |= {"lower": f"{low:.9g}", "upper": f"{high:.9g}"}
    if limited or not slide:  # a slide without limits is left without: the check says so
        ET.SubElement(element, "limit", limit)
    dof = int(model.jnt_dofadr[joint])
    values = {"damping": model.dof_damping[dof], "friction": model.dof_frictionloss[dof]}
    words = {k: f"{float(np.ravel(v)[0]):.9g}" for k, v in values.items()}
    ET.SubElement(element, "dynamics", words)


def _fixed(
    robot: ET.Element, name: str, ends: tuple[str, str], pose: tuple[FloatArray, Rotation]
) -> None:
    _between(robot, name, "fixed", ends, pose)


def _between(
    robot: ET.Element, name: str, kind: str, ends: tuple[str, str],
    pose: tuple[FloatArray, Rotation],
) -> ET.Element:  # fmt: skip
    element = ET.SubElement(robot, "joint", name=name, type=kind)
    _origin(element, *pose)
    ET.SubElement(element, "parent", link=ends[0])
    ET.SubElement(element, "child", link=ends[1])
    return element


def _couple(robot: ET.Element, model: Any) -> None:
    """Joints that an equality ties to another, where the tie is linear."""
    import mujoco

    joints = {e.get("name"): e for e in robot.iter("joint")}
    for i in range(model.neq):
        rule = model.eq_data[i]
        tied = int(model.eq_type[i]) == int(mujoco.mjtEq.mjEQ_JOINT) and model.eq_obj2id[i] >= 0
        follower = joints.get(_name(model, "JOINT", int(model.eq_obj1id[i]))) if tied else None
        if follower is not None and not np.any(rule[2:5]):
            ET.SubElement(
                follower, "mimic", joint=_name(model, "JOINT", int(model.eq_obj2id[i])),
                multiplier=f"{rule[1]:.9g}", offset=f"{rule[0]:.9g}",
            )  # fmt: skip


def _shapes(
    link: ET.Element, tag: str, model: Any, geom: int, place: FloatArray, out: Path
) -> None:
    """A geom as one element, or as three for a capsule; planes are floors and left out."""
    import mujoco

    kinds = mujoco.mjtGeom
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    at, turn = place + model.geom_pos[geom], _rotation(model.geom_quat[geom])
    shapes: list[tuple[str, dict[str, str], FloatArray]] = []
    if kind == kinds.mjGEOM_BOX:
        shapes = [("box", {"size": _words(2 * size)}, at)]
    elif kind == kinds.mjGEOM_SPHERE:
        shapes = [("sphere", {"radius": f"{size[0]:.9g}"}, at)]
    elif kind in (kinds.mjGEOM_CYLINDER, kinds.mjGEOM_CAPSULE):
        shapes = [("cylinder", {"radius": f"{size[0]:.9g}", "length": f"{2 * size[1]:.9g}"}, at)]
        if kind == kinds.mjGEOM_CAPSULE:
            for sign in (-1.0, 1.0):
                end = at + turn.apply([0.0, 0.0, sign * size[1]])
                shapes.append(("sphere", {"radius": f"{size[0]:.9g}"}, end))
    elif kind == kinds.mjGEOM_ELLIPSOID:
        ball = trimesh.creation.icosphere(subdivisions=2)
        ball.apply_scale(size)
        shapes = [("mesh", {"filename": _mesh(ball, f"geom_{geom}", out)}, at)]
    elif kind == kinds.mjGEOM_MESH:
        which = int(model.geom_dataid[geom])
        v, f = model.mesh_vertadr[which], model.mesh_faceadr[which]
        made = trimesh.Trimesh(
            model.mesh_vert[v : v + model.mesh_vertnum[which]],
            model.mesh_face[f : f + model.mesh_facenum[which]], process=False,
        )  # fmt: skip
        shapes = [("mesh", {"filename": _mesh(made, f"mesh_{which}", out)}, at)]
    for shape, words, where in shapes:
        element = ET.SubElement(link, tag)
        _origin(element, where, turn)
        ET.SubElement(ET.SubElement(element, "geometry"), shape, words)


def _mesh(mesh: trimesh.Trimesh, name: str, out: Path) -> str:
    file = out / f"{name}.stl"
    if not file.is_file():
        mesh.export(file)
    return file.name


def _inertial(
    link: ET.Element, mass: float, inertia: FloatArray,
    frame: tuple[FloatArray, Rotation] | None = None,
) -> None:  # fmt: skip
    element = ET.SubElement(link, "inertial")
    if frame is not None:
        _origin(element, *frame)
    ET.SubElement(element, "mass", value=f"{mass:.9g}")
    words = {f"i{a}{a}": f"{v:.9g}" for a, v in zip("xyz", inertia)}
    ET.SubElement(element, "inertia", {**words, "ixy": "0", "ixz": "0", "iyz": "0"})


def _origin(element: ET.Element, at: FloatArray, turn: Rotation) -> None:
    angles = turn.as_euler("xyz")
    ET.SubElement(element, "origin", xyz=_words(at), rpy=_words(angles))


def _rotation(quaternion: FloatArray) -> Rotation:
    return Rotation.from_quat(np.roll(quaternion, -1))  # MuJoCo has w first


def _name(model: Any, kind: str, index: int) -> str:
    import mujoco

    found = mujoco.mj_id2name(model, getattr(mujoco.mjtObj, f"mjOBJ_{kind}"), index)
    return found or f"{kind.lower()}_{index}"


def _words(values: FloatArray) -> str:
    return " ".join(f"{float(v):.9g}" for v in values)
