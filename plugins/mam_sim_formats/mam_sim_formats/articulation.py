"""USD articulations as URDF: rigid bodies, joints, shapes and masses as UsdPhysics has them.

OpenUSD finds the bodies, the frames of the joints in them, and their masses. A joint is at 0 where
its two frames lie on each other, whatever pose the stage shows, and so it is in the URDF.
"""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ET
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

from mam_pipeline.asset.visuals import Pictures, by_material, free_name
from mam_pipeline.errors import InputError
from mam_pipeline.formats.obj_write import write_obj_part
from mam_pipeline.formats.soup import FileContent, checked, join
from mam_pipeline.formats.urdf import elements
from mam_pipeline.formats.urdf.bounds import check_bounds
from mam_pipeline.types import FloatArray, Mesh
from mam_sim_formats.usd import StageReader, failures_said

WORLD = ""
"""Path of the body that joints without one are fixed to, as OpenUSD has it."""


@dataclass(frozen=True)
class Near:
    """What counts as equal, and as no limit.

    Attributes:
        same: by which frames (metres, radians) and scales (share) may differ.
        quaternion: by which the length of one may differ from 1.
        endless: limits beyond are none, in the unit of the stage or degrees.
    """

    same: float = 1e-6
    quaternion: float = 1e-3
    endless: float = 1e30


NEAR = Near()


def urdf_of_usd(path: Path, out: Path) -> tuple[Path, tuple[str, ...]]:
    """Write a URDF of the file's name and its meshes into the folder `out`.

    Returns:
        The URDF, and what was not taken over, in words.

    Raises:
        InputError: it cannot be read, composes layers from outside its folder, or has no joint.
    """
    with failures_said(path):
        return _Converter(path, out).urdf()


@dataclass(frozen=True)
class _Tie:
    """A joint on its way from the world outwards.

    Attributes:
        desc: what OpenUSD says of it; None for a body that nothing holds.
        child: path of the body. turned: whether the file has parent and child the other way round.
    """

    desc: Any
    child: str
    turned: bool


class _Converter(StageReader):
    def __init__(self, path: Path, out: Path) -> None:
        super().__init__(path)
        from pxr import Sdf, UsdGeom, UsdPhysics

        self.out, self.robot = out, ET.Element("robot", name=path.stem)
        self.unit = float(UsdGeom.GetStageMetersPerUnit(self.stage))
        self.kilo = float(UsdPhysics.GetStageKilogramsPerUnit(self.stage))
        if not (0.0 < self.unit < np.inf and 0.0 < self.kilo < np.inf):
            raise InputError(f"{path} has no unit: metersPerUnit or kilogramsPerUnit is not > 0")
        load = getattr(UsdPhysics, "UsdPhysicsLoadStageFromPrimRange", None)  # its newer name
        found = (load or UsdPhysics.LoadUsdPhysicsFromRange)(self.stage, [Sdf.Path("/")])
        things = sorted((d for _, some in found.values() for d in some if d.isValid), key=_path)
        bodies = [d for d in things if isinstance(d, UsdPhysics.RigidBodyDesc)]
        self.poses = {_path(d): _pose(d.position, d.rotation) for d in bodies}
        self.held = {_path(d) for d in bodies if d.kinematicBody or not d.rigidBodyEnabled}
        self.closed = frozenset(self.poses)
        self.poses[WORLD] = np.eye(4)
        joints = [d for d in things if isinstance(d, UsdPhysics.JointDesc) and d.jointEnabled]
        ends = [(d, str(d.body0), str(d.body1)) for d in joints]
        self.joints = [d for d, a, b in ends if a != b and {a, b} <= self.poses.keys()]
        self.places: dict[str, FloatArray] = {}  # by body: its link's frame, in its own
        self.names: dict[str, str] = {}
        self.taken: dict[str, set[str]] = {"link": set(), "joint": set(), "mesh": set()}
        self.made: dict[str, ET.Element] = {}  # by path: the joint of the URDF
        self.textures = Pictures(out / "meshes")

    def urdf(self) -> tuple[Path, tuple[str, ...]]:
        if not self.joints:
            raise InputError(
                f"{self.path} has no joints between rigid bodies (UsdPhysics); of a mesh, "
                "mam-sim articulate makes an articulated asset"
            )
        (self.out / "meshes").mkdir(parents=True, exist_ok=True)
        turn = np.eye(4)
        if str(self.stage.GetMetadata("upAxis")) == "Y":  # the world's link has Z up
            turn[:3, :3] = Rotation.from_euler("x", -90, degrees=True).as_matrix()
        world = self._link(WORLD, turn)
        ties, left = self._tree(), [WORLD]
        for parent in left:  # which grows
            for tie in ties[parent]:
                if tie.child not in self.names:
                    self._joint(parent, tie)
                    left.append(tie.child)
        for path, element in self.made.items():
            self._couple(path, element)
        self._simplify(world)
        check_bounds(self.robot, self.path)
        file = self.out / f"{self.path.stem}.urdf"
        ET.ElementTree(self.robot).write(file, encoding="utf-8", xml_declaration=True)
        return file, tuple(sorted(self.dropped))

    def _tree(self) -> dict[str, list[_Tie]]:
        """By body: the joints at it; what closes a loop is left out, and what is loose is fixed."""
        from pxr import UsdPhysics

        group = {body: body for body in self.poses}

        def top(body: str) -> str:
            while group[body] != body:
                group[body] = body = group[group[body]]
            return body

        sides: dict[str, list[_Tie]] = defaultdict(list)
        moved = set()
        for desc in sorted(self.joints, key=lambda d: d.excludeFromArticulation):
            first, second = str(desc.body0), str(desc.body1)
            if top(first) == top(second):
                self.dropped[f"joint {desc.primPath.name}, which closes a loop"] += 1
                continue
            group[top(second)] = top(first)
            moved.add(second)
            sides[first].append(_Tie(desc, second, turned=False))
            sides[second].append(_Tie(desc, first, turned=True))

        def free(body: str) -> tuple[bool, bool, bool]:
            root = self.stage.GetPrimAtPath(body).HasAPI(UsdPhysics.ArticulationRootAPI)
            return body not in self.held, not root, body in moved

        for body in sorted(set(self.poses) - {WORLD}, key=lambda b: (free(b), b)):
            if top(body) != top(WORLD):
                group[top(body)] = top(WORLD)
                sides[WORLD].append(_Tie(None, body, turned=False))
        return sides

    def _joint(self, parent: str, tie: _Tie) -> None:
        """Add a joint and the link that it moves, whose origin lies on its axis."""
        desc, child = tie.desc, tie.child
        above, below, kind = self.poses[child], np.eye(4), "fixed"
        if desc is not None:
            kind = type(desc).__name__.removesuffix("JointDesc").lower()
        if kind != "fixed" or parent != WORLD:  # else it is held where it stands
            frames = (
                _pose(desc.localPose0Position, desc.localPose0Orientation),
                _pose(desc.localPose1Position, desc.localPose1Orientation),
            )
            above, below = frames[::-1] if tie.turned else frames
        place, turn = np.eye(4), np.eye(4)
        place[:3, 3], turn[:3, :3] = below[:3, 3], below[:3, :3]
        at = np.linalg.inv(self.places[parent]) @ above @ turn.T
        self._link(child, place)
        name = f"{self.names[child]}_fixed" if desc is None else desc.primPath.name
        slide, limits = kind == "prismatic", None
        if kind == "revolute" or slide:
            low, high = desc.limit.lower, desc.limit.upper
            if desc.limit.enabled and max(abs(low), abs(high)) < NEAR.endless:
                limits = (low * self._value(slide), high * self._value(slide))
            kind = "continuous" if limits is None and not slide else kind
        elif kind != "fixed":
            self.dropped[f"the motion of joint {name} ({kind})"] += 1
            kind = "fixed"
        at[:3, 3] *= self.unit
        ends = self.names[parent], self.names[child]
        name = free_name(name, self.taken["joint"])
        element = elements.between(self.robot, name, kind, ends, _split(at))
        if kind != "fixed":
            axis = turn[:3, "XYZ".index(str(desc.axis))] * (-1.0 if tie.turned else 1.0)
            elements.moves(element, axis, limits)
            self._resist(element, desc, slide)
            self.made[str(desc.primPath)] = element

    def _value(self, slide: bool) -> float:
        """Metres or radians of one unit of a joint's value."""
        return self.unit if slide else np.pi / 180.0

    def _resist(self, element: ET.Element, desc: Any, slide: bool) -> None:
        """Damping and friction, as a drive without a spring, Newton or PhysX has them."""
        prim, way = self.stage.GetPrimAtPath(desc.primPath), "linear" if slide else "angular"
        force = self.kilo * self.unit * (1.0 if slide else self.unit)  # N or Nm
        idle = desc.drive.enabled and desc.drive.stiffness == 0.0
        damping = _first(prim, "newton:damping") or (desc.drive.damping if idle else 0.0)
        friction = _first(prim, "newton:friction", f"physxJointAxis:{way}:dynamicFrictionEffort")
        rows = {"damping": damping * force / self._value(slide), "friction": friction * force}
        if any(rows.values()):
            words = {k: elements.words(v) for k, v in rows.items()}
            ET.SubElement(element, "dynamics", words)

    def _couple(self, path: str, element: ET.Element) -> None:
        """What a joint follows, as Newton or PhysX has it; slides follow slides, hinges hinges."""
        prim = self.stage.GetPrimAtPath(path)
        rules = [("newton:mimicJoint", "newton:mimicCoef1", "newton:mimicCoef0", 1.0)]
        for p in (f"physxMimicJoint:rot{axis}" for axis in "XYZ"):
            rules.append((f"{p}:referenceJoint", f"{p}:gearing", f"{p}:offset", -1.0))
        for leads, ratio, offset, sign in rules:
            there = prim.HasRelationship(leads)
            targets = prim.GetRelationship(leads).GetTargets() if there else []
            leader = self.made.get(str(targets[0])) if targets else None
            if leader is None:
                continue
            kinds = [e.get("type") == "prismatic" for e in (leader, element)]
            if kinds[0] == kinds[1]:
                unit = self._value(kinds[0])
                values = sign * _first(prim, ratio), sign * _first(prim, offset) * unit
                elements.follows(element, leader.get("name") or "", *values)
                return
            self.dropped[f"the coupling of joint {prim.GetName()}"] += 1

    def _simplify(self, world: ET.Element) -> None:
        """Without the world's link, where it shows nothing and one body is fixed in its frame."""
        held = self.robot.findall(f"joint/parent[@link='{world.get('name')}']/..")
        if len(world) or len(held) != 1 or held[0].get("type") != "fixed":
            return
        pose = " ".join(v for e in held[0].iter("origin") for v in e.attrib.values())
        if np.allclose([float(w) for w in pose.split()], 0.0, atol=NEAR.same):
            self.robot.remove(world)
            self.robot.remove(held[0])

    def _link(self, path: str, place: FloatArray) -> ET.Element:
        """Add a body as a link whose frame lies at `place` in the body's."""
        self.places[path] = place
        name = free_name(Path(path).name[:60] or "world", self.taken["link"])
        self.names[path] = name
        link = ET.SubElement(self.robot, "link", name=name)
        prim = self.stage.GetPrimAtPath(path or "/")
        into = np.diag([*[self.unit] * 3, 1.0]) @ np.linalg.inv(self.poses[path] @ place)
        solids = list(self._colliders(prim))
        if path:
            self._mass(link, prim, place, bool(solids))
        self.pieces = []
        self._walk(prim, into, 0)
        mesh = self._drawn()
        for part in () if mesh is None else by_material(mesh):
            self._mesh_shape(link, "visual", part)
        for solid in solids:
            self._collision(link, solid, into)
        if link.find("visual") is None:
            for element in [copy.deepcopy(e) for e in link.findall("collision")]:
                element.tag = "visual"
                link.append(element)
        return link

    def _drawn(self) -> Mesh | None:
        """What was drawn since `pieces` was emptied."""
        some = tuple(p for p in self.pieces if len(p.faces))
        content = checked(FileContent(some, tuple(self.materials)), self.path)
        return join(content.pieces, content.materials) if some else None

    def _mesh_shape(self, link: ET.Element, tag: str, mesh: Mesh) -> None:
        name = free_name(f"{link.get('name')}_{tag}", self.taken["mesh"])
        picture = self.textures.file_of(mesh.materials[0]) if tag == "visual" else ""
        file = self.out / "meshes" / f"{name}.obj"
        write_obj_part(mesh, file, picture, textured=bool(picture))
        size = {"filename": f"meshes/{name}.obj"}
        elements.shape(link, tag, "mesh", size, np.zeros(3), Rotation.identity())

    def _colliders(self, root: Any) -> Iterator[Any]:
        """Prims with a surface that collides, below a body and no other; above them may stand one
        that says so for all."""
        from pxr import Usd, UsdGeom, UsdPhysics

        solid: dict[str, bool] = {}
        walk = iter(Usd.PrimRange(root, Usd.TraverseInstanceProxies()))
        for prim in walk:
            path = str(prim.GetPath())
            if prim != root and path in self.closed:
                walk.PruneChildren()
                continue
            solid[path] = solid.get(str(prim.GetPath().GetParentPath()), False)
            if prim.HasAPI(UsdPhysics.CollisionAPI):
                solid[path] = bool(UsdPhysics.CollisionAPI(prim).GetCollisionEnabledAttr().Get())
            if solid[path] and prim.IsA(UsdGeom.Gprim):
                yield prim

    def _collision(self, link: ET.Element, prim: Any, into: FloatArray) -> None:
        """A collider as one of URDF's shapes, or as a mesh where it is none of these."""
        frame, kind = into @ self._world(prim), str(prim.GetTypeName())
        scale = np.linalg.norm(frame[:3, :3], axis=0)
        turn = frame[:3, :3] / np.where(scale > 0, scale, 1.0)
        k = "XYZ".index(str(prim.GetAttribute("axis").Get() or "Z")) if kind in _ROUND else 2
        across = scale if kind == "Sphere" else np.delete(scale, k)
        even = kind == "Cube" or np.ptp(across) < NEAR.same * scale.max()
        if kind in (*_ROUND, "Cube", "Sphere") and even and np.allclose(turn.T @ turn, np.eye(3)):
            if np.linalg.det(turn) < 0:  # such solids are their own mirror images
                turn[:, 0] *= -1.0
            at, rotation = frame[:3, 3], Rotation.from_matrix(np.roll(turn, 2 - k, axis=1))
            size = {n: float(prim.GetAttribute(n).Get(self.time)) for n in _SIZES[kind]}
            if kind == "Cube":
                box = {"size": elements.words(size["size"] * scale)}
                elements.shape(link, "collision", "box", box, at, rotation)
            elif kind == "Sphere":
                ball = {"radius": elements.words(size["radius"] * scale[0])}
                elements.shape(link, "collision", "sphere", ball, at, rotation)
            else:
                sizes = size["radius"] * across[0], size["height"] * scale[k]
                elements.round_solid(link, "collision", *sizes, at, rotation, kind == "Capsule")
            return
        self.pieces = []
        self._surface(prim, into)
        mesh = self._drawn()
        if mesh is not None:
            self._mesh_shape(link, "collision", mesh)

    def _mass(self, link: ET.Element, prim: Any, place: FloatArray, solid: bool) -> None:
        """Add what OpenUSD makes of masses, densities and colliders."""
        from pxr import UsdPhysics

        body = UsdPhysics.RigidBodyAPI(prim)
        into = np.asarray(np.linalg.inv(self.poses[str(prim.GetPath())]), np.float64)
        found = body.ComputeMassProperties(lambda part: self._volume(part, into))
        mass, moments, centre, axes = found
        if not 0.0 < mass < np.inf:
            return
        own = UsdPhysics.MassAPI(prim)
        given = any(own.GetDiagonalInertiaAttr().Get() or ())
        if given:  # without axes of their own, they are those of the body
            axes = own.GetPrincipalAxesAttr().Get()
        known = np.array(moments) * self.kilo * self.unit**2 if given or solid else None
        turn = _pose(centre, axes)[:3, :3]
        at = (np.array(centre) - place[:3, 3]) * self.unit
        elements.inertial(link, mass * self.kilo, known, (at, Rotation.from_matrix(turn)))

    def _volume(self, prim: Any, into: FloatArray) -> Any:
        """Volume, centre and moments of a collider's hull in its body's frame."""
        from pxr import Gf, Usd, UsdPhysics

        found = UsdPhysics.RigidBodyAPI.MassInformation()
        found.volume, found.inertia = 0.0, Gf.Matrix3f(0.0)
        found.centerOfMass = found.localPos = Gf.Vec3f(0.0)
        found.localRot = Gf.Quatf(1.0)
        self.pieces = []
        for part in Usd.PrimRange(prim, Usd.TraverseInstanceProxies()):
            self._surface(part, into)
        try:
            hull = trimesh.Trimesh(np.vstack([p.vertices for p in self.pieces])).convex_hull
        except Exception:  # nothing, or a flat one
            return found
        found.volume, found.inertia = float(hull.volume), Gf.Matrix3f(*hull.moment_inertia.flat)
        found.centerOfMass = Gf.Vec3f(*map(float, hull.center_mass))
        return found


_ROUND = ("Cylinder", "Capsule")
_SIZES = {"Cube": ("size",), "Sphere": ("radius",), **dict.fromkeys(_ROUND, ("radius", "height"))}


def _path(desc: Any) -> str:
    return str(desc.primPath)


def _pose(at: Any, turn: Any) -> FloatArray:
    """(4, 4) of a position and a quaternion; one that is none turns nothing."""
    out, q = np.eye(4), np.array([*turn.GetImaginary(), turn.GetReal()], dtype=float)
    if abs(np.linalg.norm(q) - 1.0) < NEAR.quaternion:
        out[:3, :3] = Rotation.from_quat(q).as_matrix()
    out[:3, 3] = at
    return out


def _split(matrix: FloatArray) -> tuple[FloatArray, Rotation]:
    return matrix[:3, 3], Rotation.from_matrix(matrix[:3, :3])


def _first(prim: Any, *names: str) -> float:
    """The first of some numbers that a prim has, 0 for none."""
    values = [prim.GetAttribute(n).Get() for n in names if prim.HasAttribute(n)]
    return next((float(v) for v in values if isinstance(v, int | float)), 0.0)
