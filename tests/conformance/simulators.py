"""What each simulator makes of an asset folder: links, joints, appearance, masses, kinematics."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mam_pipeline.asset.card import Asset
from mam_pipeline.formats.mesh_files import read_file
from tests.conformance.bullet import empty_world

SCRIPTS = Path(__file__).resolve().parents[2] / "benchmarks"
Values = Mapping[str, float]
Box = np.ndarray


@dataclass
class Opened:
    """An asset as one simulator has it; None where the simulator cannot say.

    Attributes:
        joints: names of those that move. visuals: number of visual shapes.
        textured: visual shapes that show a picture. faces: triangles of the visual shapes.
        masses: kg by link. limits: lower and upper by joint, radians or metres.
        poses: per configuration, (4, 4) link frame in the asset frame by link name.
        visual_boxes, collision_boxes: (2, 3) at rest in the asset frame, metres, by link name.
        version: of a simulator that ran in another interpreter.
    """

    links: set[str]
    joints: set[str]
    visuals: int | None = None
    textured: int | None = None
    faces: int | None = None
    masses: dict[str, float] = field(default_factory=dict)
    limits: dict[str, tuple[float, float]] = field(default_factory=dict)
    poses: list[dict[str, np.ndarray]] = field(default_factory=list)
    visual_boxes: dict[str, Box] | None = None
    collision_boxes: dict[str, Box] | None = None
    version: str = ""


class Missing(Exception):
    """The simulator, or a driver that it needs, is not here."""


def configurations(asset: Asset, count: int = 5, seed: int = 0) -> list[dict[str, float]]:
    """Rest first, then random values within the limits."""
    random = np.random.default_rng(seed)
    out = [{j.name: 0.0 for j in asset.card.joints if j.type != "fixed"}]
    while len(out) < count:
        values = {}
        for joint in asset.card.joints:
            if joint.type != "fixed":
                low = -np.pi if joint.lower is None else joint.lower
                high = np.pi if joint.upper is None else joint.upper
                values[joint.name] = float(random.uniform(low, high))
        out.append(values)
    return out


def card(asset: Asset) -> Opened:
    """What the card and the files say, by closed forms: the reference."""
    out = Opened({p.link for p in asset.card.parts}, set())
    out.masses = {p.link: p.mass for p in asset.card.parts}
    for joint in asset.card.joints:
        if joint.type != "fixed":
            out.joints.add(joint.name)
        if joint.lower is not None and joint.upper is not None and joint.type != "fixed":
            out.limits[joint.name] = (joint.lower, joint.upper)
    out.poses = [_card_poses(asset, v) for v in configurations(asset)]
    out.visuals = out.textured = out.faces = 0
    out.visual_boxes = {}
    for link, frame, file in _mesh_visuals(asset):
        content = read_file(file)
        out.visuals += 1
        out.faces += sum(len(p.faces) for p in content.pieces)
        out.textured += any(content.materials[p.material].image for p in content.pieces)
        points = np.concatenate([p.vertices[p.faces.reshape(-1)] for p in content.pieces])
        _grow(out.visual_boxes, link, _moved(out.poses[0][link] @ frame, points))
    out.collision_boxes = yourdfpy(asset).collision_boxes  # its frames are tested for themselves
    return out


def _card_poses(asset: Asset, values: Values) -> dict[str, np.ndarray]:
    moved = {p.link: np.eye(4) for p in asset.card.parts}  # displacement of the rest pose
    out = {p.link: np.eye(4) for p in asset.card.parts}
    for joint in asset.card.joints:  # parents come first
        motion, q = np.eye(4), values.get(joint.name, 0.0)
        axis, origin = np.array(joint.axis), np.array(joint.origin)
        if joint.type == "prismatic":
            motion[:3, 3] = q * axis
        else:
            motion[:3, :3] = Rotation.from_rotvec(q * axis).as_matrix()
            motion[:3, 3] = origin - motion[:3, :3] @ origin
        moved[joint.child] = moved[joint.parent] @ motion
        frame = np.eye(4)
        frame[:3, 3] = origin
        out[joint.child] = moved[joint.child] @ frame
    return out


def yourdfpy(asset: Asset) -> Opened:
    """The URDF as yourdfpy and trimesh load it."""
    import yourdfpy as library

    robot = library.URDF.load(
        str(asset.urdf_path), load_collision_meshes=True, build_collision_scene_graph=True
    )
    out = Opened({k.name for k in robot.robot.links}, set(robot.actuated_joint_names))
    out.masses = {k.name: float(k.inertial.mass) for k in robot.robot.links}
    for joint in robot.robot.joints:
        if joint.type in ("revolute", "prismatic"):
            out.limits[joint.name] = (joint.limit.lower, joint.limit.upper)
    for values in configurations(asset):
        robot.update_cfg(dict(values))
        out.poses.append({n: robot.get_transform(n) for n in out.links})
    robot.update_cfg(configurations(asset)[0])
    parts = [(n, robot.scene.geometry[g], m) for n, m, g in _nodes(robot.scene)]
    out.visuals, out.faces = len(parts), sum(len(g.faces) for _, g, _ in parts)
    out.textured = sum(
        getattr(getattr(g.visual, "material", None), "image", None) is not None for _, g, _ in parts
    )
    out.visual_boxes = _scene_boxes(robot.scene, out.links)
    out.collision_boxes = _scene_boxes(robot.collision_scene, out.links)
    return out


def _nodes(scene: Any) -> list[tuple[str, np.ndarray, str]]:
    return [(n, *scene.graph[n]) for n in scene.graph.nodes_geometry]


def _scene_boxes(scene: Any, links: set[str]) -> dict[str, Box]:
    boxes: dict[str, Box] = {}
    parents = scene.graph.transforms.parents
    for node, matrix, name in _nodes(scene):
        at = node
        while at not in links:
            at = parents[at]
        _grow(boxes, at, _moved(matrix, scene.geometry[name].vertices))
    return boxes


def sapien(asset: Asset) -> Opened:
    """The URDF as SAPIEN's loader builds it, visuals included (needs a Vulkan driver)."""
    import sapien as library

    try:
        scene = library.Scene()
    except RuntimeError as error:
        raise Missing("SAPIEN shows nothing without a Vulkan driver") from error
    loader = scene.create_urdf_loader()
    loader.fix_root_link = True
    robot = loader.load(str(asset.urdf_path))
    active = robot.active_joints
    out = Opened({k.name for k in robot.links}, {j.name for j in active})
    out.masses = {k.name: float(k.mass) for k in robot.links}
    for joint in active:
        low, high = joint.limits[0]
        if np.isfinite([low, high]).all():
            out.limits[joint.name] = (float(low), float(high))
    for values in reversed(configurations(asset)):  # rest comes last and stays
        robot.set_qpos(np.array([values[j.name] for j in active], np.float32))
        poses = {k.name: k.entity_pose.to_transformation_matrix() for k in robot.links}
        out.poses.insert(0, poses)
    out.visuals = out.textured = out.faces = 0
    out.visual_boxes, out.collision_boxes = {}, {}
    for link in robot.links:
        frame = out.poses[0][link.name].astype(float)
        body = link.entity.find_component_by_type(library.render.RenderBodyComponent)
        for shape in body.render_shapes if body is not None else ():
            out.visuals += 1
            place = frame @ shape.local_pose.to_transformation_matrix()
            out.textured += any(p.material.base_color_texture is not None for p in shape.parts)
            for part in shape.parts:
                out.faces += len(part.triangles)
                points = part.vertices[part.triangles.reshape(-1)] * shape.scale
                _grow(out.visual_boxes, link.name, _moved(place, points))
        for shape in link.collision_shapes:
            place = frame @ shape.local_pose.to_transformation_matrix()
            points = _sapien_points(shape)
            if points is not None:
                _grow(out.collision_boxes, link.name, _moved(place, points))
    return out


def _sapien_points(shape: Any) -> np.ndarray | None:
    if hasattr(shape, "vertices"):
        return np.asarray(shape.vertices * shape.scale)
    if hasattr(shape, "half_size"):
        return _corners(np.asarray(shape.half_size))
    if hasattr(shape, "half_length"):  # along the shape's x
        return _rings(shape.radius, shape.half_length)[:, [2, 0, 1]]
    return None


def mujoco(asset: Asset) -> Opened:
    """The exported MJCF, compiled by MuJoCo."""
    import mujoco as library
    from mam_sim_formats.mjcf_export import export_mjcf

    file = export_mjcf(asset, asset.folder.parent / f"{asset.folder.name}_mjcf" / "object.xml")
    model = library.MjModel.from_xml_path(str(file))
    data = library.MjData(model)
    names = [model.body(i).name for i in range(1, model.nbody)]
    joints = [model.joint(i) for i in range(model.njnt)]
    out = Opened(set(names), {j.name for j in joints})
    out.masses = {n: float(model.body(n).mass[0]) for n in names}
    out.limits = {
        j.name: (float(j.range[0]), float(j.range[1])) for j in joints
        if model.jnt_limited[j.id]
    }  # fmt: skip
    for values in reversed(configurations(asset)):
        for name, value in values.items():
            data.joint(name).qpos[0] = value
        library.mj_kinematics(model, data)
        out.poses.insert(
            0, {n: _pose(data.body(n).xpos, data.body(n).xmat.reshape(3, 3)) for n in names}
        )
    out.visuals = out.textured = out.faces = 0
    out.visual_boxes, out.collision_boxes = {}, {}
    for g in range(model.ngeom):
        shown, link = model.geom_group[g] == 2, model.body(model.geom_bodyid[g]).name
        place = _pose(data.geom_xpos[g], data.geom_xmat[g].reshape(3, 3))
        mesh, size = int(model.geom_dataid[g]), model.geom_size[g]
        if mesh >= 0:
            start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
            points = model.mesh_vert[start : start + count]
        elif model.geom_type[g] == library.mjtGeom.mjGEOM_CYLINDER:
            points = _rings(size[0], size[1])
        else:
            ball = model.geom_type[g] == library.mjtGeom.mjGEOM_SPHERE
            points = _corners(np.full(3, size[0]) if ball else size)
        _grow(out.visual_boxes if shown else out.collision_boxes, link, _moved(place, points))
        if shown:
            out.visuals += 1
            out.faces += int(model.mesh_facenum[mesh])
            material = model.geom_matid[g]
            out.textured += material >= 0 and bool((model.mat_texid[material] >= 0).any())
    return out


def pybullet(asset: Asset) -> Opened:
    """The URDF as PyBullet loads it; its axis-aligned boxes carry a margin and are left out."""
    library = empty_world()
    flags = library.URDF_USE_INERTIA_FROM_FILE | library.URDF_USE_MATERIAL_COLORS_FROM_MTL
    try:
        body = library.loadURDF(str(asset.urdf_path), useFixedBase=True, flags=flags)
    except library.error as error:
        raise AssertionError(f"PyBullet refuses the file: {error}") from error
    base = library.getBodyInfo(body)[0].decode()
    infos = [library.getJointInfo(body, i) for i in range(library.getNumJoints(body))]
    names = {-1: base, **{i[0]: i[12].decode() for i in infos}}
    moving = [i for i in infos if i[2] != library.JOINT_FIXED]
    out = Opened(set(names.values()), {i[1].decode() for i in moving})
    # a fixed base is told to have no mass
    free = library.loadURDF(str(asset.urdf_path), flags=flags)
    out.masses = {n: library.getDynamicsInfo(free, k)[0] for k, n in names.items()}
    library.removeBody(free)
    for info in moving:
        if info[8] <= info[9]:
            out.limits[info[1].decode()] = (info[8], info[9])
    # the base's frame is where its centre of mass is; its place is told by the inertial frame
    position, turn = library.getDynamicsInfo(body, -1)[3:5]
    inertial = _pose(position, Rotation.from_quat(turn).as_matrix())
    for values in configurations(asset):
        for info in moving:
            library.resetJointState(body, info[0], values[info[1].decode()])
        position, turn = library.getBasePositionAndOrientation(body)
        root = _pose(position, Rotation.from_quat(turn).as_matrix()) @ np.linalg.inv(inertial)
        poses = {base: root}
        for info in infos:
            state = library.getLinkState(body, info[0], computeForwardKinematics=True)
            frame = _pose(state[4], Rotation.from_quat(state[5]).as_matrix())
            poses[names[info[0]]] = frame
        # the world's origin is the base's centre of mass, not its link frame
        home = np.linalg.inv(root)
        out.poses.append({n: home @ p for n, p in poses.items()})
    shapes = library.getVisualShapeData(body, library.VISUAL_SHAPE_DATA_TEXTURE_UNIQUE_IDS)
    out.visuals = len(shapes)
    out.textured = sum(s[8] >= 0 for s in shapes)
    return out


def usd(asset: Asset) -> Opened:
    """The exported USD, read back with usd-core."""
    from mam_sim_formats.usd_export import export_usd

    file = export_usd(asset, asset.folder.parent / f"{asset.folder.name}_usd" / "object.usd")
    return _read_usd(file, asset)


def converter(asset: Asset) -> Opened:
    """The URDF through urdf-usd-converter, named by URDF_USD_CONVERTER or found on the path.

    It lives in an environment of its own: its usd-exchange and our usd-core both hold `pxr`.
    """
    tool = os.environ.get("URDF_USD_CONVERTER") or shutil.which("urdf_usd_converter")
    if not tool:
        raise Missing("urdf_usd_converter is not on the path (URDF_USD_CONVERTER names it)")
    out = asset.folder.parent / f"{asset.folder.name}_converted"
    shutil.rmtree(out, ignore_errors=True)
    clean = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(
        [tool, str(asset.urdf_path), str(out)], capture_output=True, text=True, env=clean
    )
    assert done.returncode == 0, done.stderr[-2000:]
    (file,) = [p for p in out.iterdir() if p.suffix in (".usda", ".usdc", ".usd")]
    return _read_usd(file, asset)


def drake(asset: Asset) -> Opened:
    """The URDF as Drake's parser takes it."""
    return _opened_by("pydrake", "open_in_drake.py", asset.urdf_path, asset)


def drake_sdf(asset: Asset) -> Opened:
    """The exported SDF as Drake takes it: its parser is Gazebo's, libsdformat."""
    from mam_sim_formats.sdf_export import export_sdf

    file = export_sdf(asset, asset.folder.parent / f"{asset.folder.name}_sdf" / "object.sdf")
    return _opened_by("pydrake", "open_in_drake.py", file, asset)


def newton(asset: Asset) -> Opened:
    """The exported USD as Newton builds it on a CPU."""
    from mam_sim_formats.usd_export import export_usd

    file = export_usd(asset, asset.folder.parent / f"{asset.folder.name}_newton" / "object.usd")
    return _opened_by("newton", "open_in_newton.py", file, asset)


def _opened_by(module: str, script: str, file: Path, asset: Asset) -> Opened:
    """What a script of benchmarks/ says in an interpreter that has a module: the one that
    SIMULATOR_PYTHON names, or this one."""
    python = os.environ.get("SIMULATOR_PYTHON") or sys.executable
    clean = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    known = subprocess.run([python, "-c", f"import {module}"], capture_output=True, env=clean)
    if known.returncode != 0:
        raise Missing(f"{python} has no {module} (SIMULATOR_PYTHON names an interpreter)")
    command = [python, str(SCRIPTS / script), str(file), "--json"]
    values = json.dumps(configurations(asset))
    done = subprocess.run(command, input=values, capture_output=True, text=True, env=clean)
    assert done.returncode == 0, done.stderr[-2000:]
    said = json.loads(done.stdout.splitlines()[-1])
    poses = [{k: np.array(v) for k, v in row.items()} for row in said.pop("poses")]
    limits = {k: tuple(v) for k, v in said.pop("limits").items()}
    links, joints = set(said.pop("links")), set(said.pop("joints"))
    return Opened(links, joints, poses=poses, limits=limits, **said)


def _read_usd(file: Path, asset: Asset) -> Opened:
    from pxr import Usd, UsdGeom, UsdPhysics, UsdShade

    stage = Usd.Stage.Open(str(file))
    cache = UsdGeom.XformCache()
    prims = list(Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()))
    bodies = [p for p in prims if p.HasAPI(UsdPhysics.RigidBodyAPI)]
    out = Opened({p.GetName() for p in bodies}, set())
    for prim in bodies:
        out.masses[prim.GetName()] = float(UsdPhysics.MassAPI(prim).GetMassAttr().Get())
    for prim in prims:
        slides = prim.IsA(UsdPhysics.PrismaticJoint)
        if slides or prim.IsA(UsdPhysics.RevoluteJoint):
            joint = (UsdPhysics.PrismaticJoint if slides else UsdPhysics.RevoluteJoint)(prim)
            low, high = joint.GetLowerLimitAttr().Get(), joint.GetUpperLimitAttr().Get()
            out.joints.add(prim.GetName())
            unit = 1.0 if slides else np.pi / 180
            if np.isfinite([low, high]).all() and abs(low) < 1e30:
                out.limits[prim.GetName()] = (low * unit, high * unit)
    out.poses = [
        {p.GetName(): np.array(cache.GetLocalToWorldTransform(p)).T for p in bodies}
    ]  # a file has the rest pose only; its joint frames are tested with the exports
    out.visuals = out.textured = out.faces = 0
    out.visual_boxes, out.collision_boxes = {}, {}
    for prim in prims:
        owner = prim
        while owner and not owner.HasAPI(UsdPhysics.RigidBodyAPI):
            owner = owner.GetParent()
        if not owner or not prim.IsA(UsdGeom.Gprim):
            continue
        collides = prim.HasAPI(UsdPhysics.CollisionAPI)
        if prim.IsA(UsdGeom.Mesh):
            mesh = UsdGeom.Mesh(prim)
            points = np.array(mesh.GetPointsAttr().Get(), dtype=float)
            place = np.array(cache.GetLocalToWorldTransform(prim)).T
            boxes = out.collision_boxes if collides else out.visual_boxes
            _grow(boxes, owner.GetName(), _moved(place, points))
            if not collides:
                out.visuals += 1
                out.faces += int(sum(n - 2 for n in mesh.GetFaceVertexCountsAttr().Get()))
                material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
                out.textured += bool(material) and any(
                    UsdShade.Shader(s).GetIdAttr().Get() == "UsdUVTexture"
                    for s in Usd.PrimRange(material.GetPrim(), Usd.TraverseInstanceProxies())
                    if s.IsA(UsdShade.Shader)
                )
    out.collision_boxes = None  # primitives have no points; visual meshes do
    return out


READERS: dict[str, Callable[[Asset], Opened]] = {
    "SAPIEN": sapien,
    "MuJoCo (MJCF)": mujoco,
    "PyBullet": pybullet,
    "yourdfpy": yourdfpy,
    "USD export": usd,
    "urdf-usd-converter": converter,
    "Drake": drake,
    "Drake (SDF)": drake_sdf,
    "Newton (USD)": newton,
}


def _mesh_visuals(asset: Asset) -> list[tuple[str, np.ndarray, Path]]:
    """(link, visual frame in the link, mesh file) for every visual of the URDF."""
    import yourdfpy as library

    robot = library.URDF.load(
        str(asset.urdf_path), load_meshes=False, build_scene_graph=False
    ).robot
    out = []
    for link in robot.links:
        for visual in link.visuals:
            frame = np.eye(4) if visual.origin is None else visual.origin
            out.append((link.name, frame, asset.folder / visual.geometry.mesh.filename))
    return out


def _pose(position: Any, turn: np.ndarray) -> np.ndarray:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = turn, position
    return out


def _moved(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    return np.asarray(points, dtype=float) @ matrix[:3, :3].T + matrix[:3, 3]


def _grow(boxes: dict[str, Box], link: str, points: np.ndarray) -> None:
    low, high = points.min(axis=0), points.max(axis=0)
    if link in boxes:
        low, high = np.minimum(low, boxes[link][0]), np.maximum(high, boxes[link][1])
    boxes[link] = np.stack([low, high])


def _corners(half: np.ndarray) -> np.ndarray:
    signs = np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T
    return np.asarray(signs * half)


def _rings(radius: float, half: float) -> np.ndarray:
    """Both rims of a cylinder along z."""
    turn = np.linspace(0, 2 * np.pi, 256)
    rim = radius * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    return np.concatenate([np.c_[rim, np.full(len(rim), z)] for z in (-half, half)])
