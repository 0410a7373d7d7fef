"""MJCF of others as a URDF: bodies, hinges and slides, shapes, masses and limits as they are.

MuJoCo compiles the file, so that defaults, includes and computed inertias mean what they do there.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from mam_pipeline.errors import InputError
from mam_pipeline.formats.apart import apart
from mam_pipeline.formats.door import is_file
from mam_pipeline.formats.mjcf_files import files_of_mjcf
from mam_pipeline.formats.urdf.bounds import check_bounds
from mam_pipeline.formats.urdf.elements import (
    between,
    follows,
    inertial,
    moves,
    round_solid,
    shape,
    words,
)
from mam_pipeline.optional import require
from mam_pipeline.types import FloatArray

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
    if not is_file(path):
        raise InputError(f"no MJCF at {path}")
    files_of_mjcf(path)
    return apart(partial(_compiled, path, out), path, "MJCF", "simplify it, or give a URDF")


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
    check_bounds(robot, path)
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
                inertial(ET.SubElement(robot, "link", name=child), TINY, np.full(3, TINY * 1e-3))
        if not moving:
            between(robot, f"{name}_fixed", "fixed", (parent, name), pose)
    link = ET.SubElement(robot, "link", name=name)
    if model.body_mass[body] > 0:
        frame = place + model.body_ipos[body], _rotation(model.body_iquat[body])
        inertial(link, float(model.body_mass[body]), model.body_inertia[body], frame)
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
    element = between(robot, _name(model, "JOINT", joint), kind, ends, pose)
    low, high = model.jnt_range[joint] - model.qpos0[model.jnt_qposadr[joint]]
    moves(element, model.jnt_axis[joint], (low, high) if limited else None)
    dof = int(model.jnt_dofadr[joint])
    values = {"damping": model.dof_damping[dof], "friction": model.dof_frictionloss[dof]}
    ET.SubElement(element, "dynamics", {k: words(np.ravel(v)[0]) for k, v in values.items()})


def _couple(robot: ET.Element, model: Any) -> None:
    """Joints that an equality ties to another, where the tie is linear."""
    import mujoco

    joints = {e.get("name"): e for e in robot.iter("joint")}
    for i in range(model.neq):
        rule = model.eq_data[i]
        tied = int(model.eq_type[i]) == int(mujoco.mjtEq.mjEQ_JOINT) and model.eq_obj2id[i] >= 0
        follower = joints.get(_name(model, "JOINT", int(model.eq_obj1id[i]))) if tied else None
        if follower is not None and not np.any(rule[2:5]):
            follows(follower, _name(model, "JOINT", int(model.eq_obj2id[i])), rule[1], rule[0])


def _shapes(
    link: ET.Element, tag: str, model: Any, geom: int, place: FloatArray, out: Path
) -> None:
    """A geom as one element, or as three for a capsule; planes are floors and left out."""
    import mujoco

    kinds = mujoco.mjtGeom
    kind, size = int(model.geom_type[geom]), model.geom_size[geom]
    at, turn = place + model.geom_pos[geom], _rotation(model.geom_quat[geom])
    if kind == kinds.mjGEOM_BOX:
        shape(link, tag, "box", {"size": words(2 * size)}, at, turn)
    elif kind == kinds.mjGEOM_SPHERE:
        shape(link, tag, "sphere", {"radius": words(size[0])}, at, turn)
    elif kind in (kinds.mjGEOM_CYLINDER, kinds.mjGEOM_CAPSULE):
        capsule = kind == kinds.mjGEOM_CAPSULE
        round_solid(link, tag, size[0], 2 * size[1], at, turn, capsule)
    elif kind == kinds.mjGEOM_ELLIPSOID:
        ball = trimesh.creation.icosphere(subdivisions=2)
        ball.apply_scale(size)
        shape(link, tag, "mesh", {"filename": _mesh(ball, f"geom_{geom}", out)}, at, turn)
    elif kind == kinds.mjGEOM_MESH:
        which = int(model.geom_dataid[geom])
        v, f = model.mesh_vertadr[which], model.mesh_faceadr[which]
        made = trimesh.Trimesh(
            model.mesh_vert[v : v + model.mesh_vertnum[which]],
            model.mesh_face[f : f + model.mesh_facenum[which]], process=False,
        )  # fmt: skip
        shape(link, tag, "mesh", {"filename": _mesh(made, f"mesh_{which}", out)}, at, turn)


def _mesh(mesh: trimesh.Trimesh, name: str, out: Path) -> str:
    file = out / f"{name}.stl"
    if not file.is_file():
        mesh.export(file)
    return file.name


def _rotation(quaternion: FloatArray) -> Rotation:
    return Rotation.from_quat(np.roll(quaternion, -1))  # MuJoCo has w first


def _name(model: Any, kind: str, index: int) -> str:
    import mujoco

    found = mujoco.mj_id2name(model, getattr(mujoco.mjtObj, f"mjOBJ_{kind}"), index)
    return found or f"{kind.lower()}_{index}"
