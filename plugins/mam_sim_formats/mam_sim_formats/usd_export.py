"""Export of an asset folder to USD with physics schemas (usd-core, an optional dependency)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from mam_pipeline import folders
from mam_pipeline.asset.card import Asset, CardPart
from mam_pipeline.errors import InputError
from mam_pipeline.folders import Scratch
from mam_pipeline.formats.mesh_files import read_file
from mam_pipeline.formats.soup import join
from mam_pipeline.formats.urdf.geometry import (
    existing,
    origin_of,
    read_triangles,
    shape_triangles,
)
from mam_pipeline.formats.urdf.tree import MOVING, UrdfTree
from mam_pipeline.optional import require
from mam_pipeline.types import FloatArray, Material, Mesh


def export_usd(asset: Asset, path: str | Path | None = None) -> Path:
    """Write object.usd (binary; textures in `usd/`); returns its path.

    Metres, Z up, one rigid body per link with mass properties, convex collision pieces, and
    revolute or prismatic joints with limits, damping and friction attributes; the base is fixed to
    the world and is the articulation root. Friction and damping of joints, and what they follow,
    are written as Newton's and as PhysX's schemas have it. A path that ends in .usdz packs
    everything into one file.

    Raises:
        MissingExtra: usd-core is not installed.
        InputError: a slide follows a hinge, or the other way round.
    """
    require("USD export", "pxr")
    target = Path(path) if path is not None else asset.folder / "object.usd"
    with folders.new_entries(target.parent, target.name) as work:
        if target.suffix == ".usdz":
            _pack(asset, work / target.name)
        else:
            _Exporter(asset, work / target.name).write()
    return target


def _pack(asset: Asset, target: Path) -> None:
    """One file with the stage and its textures."""
    from pxr import UsdUtils

    with Scratch() as folder:
        stage = Path(folder) / "object.usdc"
        _Exporter(asset, stage).write()
        if not UsdUtils.CreateNewUsdzPackage(str(stage), str(target)):
            raise InputError(f"USD could not pack {target}; is the folder writable?")


class _Exporter:
    """One stage under construction."""

    def __init__(self, asset: Asset, target: Path) -> None:
        from pxr import Usd, UsdGeom, UsdPhysics

        self.asset, self.target = asset, target
        tree = UrdfTree.read(asset.urdf_path)
        self.robot, self.frames = tree.robot, tree.frames
        self.cards = {j.name: j for j in asset.card.joints}
        self.parts = {part.link: part for part in asset.card.parts}
        self.stage = Usd.Stage.CreateNew(str(target))
        UsdGeom.SetStageUpAxis(self.stage, UsdGeom.Tokens.z)
        UsdGeom.SetStageMetersPerUnit(self.stage, 1.0)
        UsdPhysics.SetStageKilogramsPerUnit(self.stage, 1.0)
        self.root = UsdGeom.Xform.Define(self.stage, "/object")
        self.stage.SetDefaultPrim(self.root.GetPrim())
        UsdGeom.Scope.Define(self.stage, "/object/joints")

    def write(self) -> None:
        from pxr import UsdPhysics

        moved = {j.child for j in self.robot.joints}
        for link in self.robot.links:
            self._link(link)
        for link in self.robot.links:
            if link.name not in moved:
                fixed = UsdPhysics.FixedJoint.Define(self.stage, "/object/joints/world")
                fixed.CreateBody1Rel().SetTargets([f"/object/{link.name}"])
                UsdPhysics.ArticulationRootAPI.Apply(self.root.GetPrim())
        for joint in self.robot.joints:
            self._joint(joint)
        self.stage.GetRootLayer().Save()

    def _link(self, link: Any) -> None:
        from pxr import Gf, UsdGeom, UsdPhysics

        prim = UsdGeom.Xform.Define(self.stage, f"/object/{link.name}")
        _place(prim, self.frames[link.name])
        UsdPhysics.RigidBodyAPI.Apply(prim.GetPrim())
        if link.inertial is not None and link.inertial.mass:
            api = UsdPhysics.MassAPI.Apply(prim.GetPrim())
            origin = origin_of(link.inertial)
            turned = origin[:3, :3] @ link.inertial.inertia @ origin[:3, :3].T
            values, vectors = np.linalg.eigh(turned)
            if np.linalg.det(vectors) < 0:
                vectors[:, 0] *= -1.0
            api.CreateMassAttr(float(link.inertial.mass))
            api.CreateCenterOfMassAttr(Gf.Vec3f(*map(float, origin[:3, 3])))
            api.CreateDiagonalInertiaAttr(Gf.Vec3f(*map(float, values)))
            api.CreatePrincipalAxesAttr(_quaternion(vectors))
        for i, shape in enumerate(link.visuals):
            self._visual(f"/object/{link.name}/visual_{i}", shape, f"{link.name}_{i}")
        for i, shape in enumerate(link.collisions):
            self._collision(f"/object/{link.name}/collision_{i}", shape)
        part = self.parts.get(link.name)
        if part is not None and link.collisions:
            self._contact(f"/object/{link.name}", part)

    def _contact(self, path: str, part: CardPart) -> None:
        """Friction and restitution of a link's collision pieces, as a physics material."""
        from pxr import UsdPhysics, UsdShade

        made = UsdShade.Material.Define(self.stage, f"{path}/contact")
        api = UsdPhysics.MaterialAPI.Apply(made.GetPrim())
        api.CreateStaticFrictionAttr(part.friction)
        api.CreateDynamicFrictionAttr(part.friction)
        api.CreateRestitutionAttr(part.restitution)
        binding = UsdShade.MaterialBindingAPI.Apply(self.stage.GetPrimAtPath(path))
        binding.Bind(made, materialPurpose="physics")

    def _surface(self, shape: Any) -> Mesh | None:
        """A visual in its link's frame; None for one without a surface."""
        told, place = shape.geometry.mesh, origin_of(shape)
        if told is not None:
            file = existing(told.filename, self.asset.urdf_path)
            content = read_file(file, self.asset.urdf_path.parent)
            scale = np.ones(3) if told.scale is None else np.broadcast_to(told.scale, 3)
            place = place @ np.diag([*scale, 1.0])
            return join(content.pieces, content.materials).transformed(place)
        found = shape_triangles(shape.geometry, self.asset.urdf_path.parent)
        if found is None:
            return None
        color = getattr(shape.material, "color", None)
        look = Material()
        if color is not None:
            r, g, b, a = (float(c) for c in color.rgba)
            look = Material("color", (r, g, b, a))
        return Mesh(*found, materials=(look,)).transformed(place)

    def _visual(self, path: str, shape: Any, name: str) -> None:
        from pxr import Sdf, UsdGeom, UsdShade

        mesh = self._surface(shape)
        if mesh is None:
            return
        assert mesh.face_material is not None
        for k in np.unique(mesh.face_material):
            part = mesh.submesh(mesh.face_material == k)
            prim = UsdGeom.Mesh.Define(self.stage, f"{path}_{k}")
            _fill(prim, part.vertices, part.faces)
            if part.uv is not None:
                st = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(
                    "st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex
                )
                # glTF counts v downwards, USD upwards
                st.Set([(float(u), 1.0 - float(v)) for u, v in part.uv])
            UsdShade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(
                self._material(f"{path}_{k}_material", mesh.materials[k], f"{name}_{k}")
            )

    def _material(self, path: str, material: Material, name: str) -> Any:
        from pxr import Gf, Sdf, UsdShade

        made = UsdShade.Material.Define(self.stage, path)
        shader = UsdShade.Shader.Define(self.stage, f"{path}/surface")
        shader.CreateIdAttr("UsdPreviewSurface")
        color = shader.CreateInput("diffuseColor", Sdf.ValueTypeNames.Color3f)
        color.Set(Gf.Vec3f(*material.base_color[:3]))
        shader.CreateInput("roughness", Sdf.ValueTypeNames.Float).Set(material.roughness)
        shader.CreateInput("metallic", Sdf.ValueTypeNames.Float).Set(material.metallic)
        if material.image is not None:
            folder = self.target.parent / "usd"
            folder.mkdir(exist_ok=True)
            picture = f"{name}.{'jpg' if material.image_format == 'jpeg' else 'png'}"
            (folder / picture).write_bytes(material.image)
            reader = UsdShade.Shader.Define(self.stage, f"{path}/st")
            reader.CreateIdAttr("UsdPrimvarReader_float2")
            reader.CreateInput("varname", Sdf.ValueTypeNames.String).Set("st")
            image = UsdShade.Shader.Define(self.stage, f"{path}/image")
            image.CreateIdAttr("UsdUVTexture")
            image.CreateInput("file", Sdf.ValueTypeNames.Asset).Set(f"./usd/{picture}")
            st = reader.CreateOutput("result", Sdf.ValueTypeNames.Float2)
            image.CreateInput("st", Sdf.ValueTypeNames.Float2).ConnectToSource(st)
            color.ConnectToSource(image.CreateOutput("rgb", Sdf.ValueTypeNames.Float3))
        output = shader.CreateOutput("surface", Sdf.ValueTypeNames.Token)
        made.CreateSurfaceOutput().ConnectToSource(output)
        return made

    def _collision(self, path: str, shape: Any) -> None:
        from pxr import UsdGeom, UsdPhysics

        g = shape.geometry
        origin = origin_of(shape)
        if g.box is not None:
            prim: Any = UsdGeom.Cube.Define(self.stage, path)
            prim.CreateSizeAttr(1.0)
            _place(prim, origin, np.asarray(g.box.size, dtype=float))
        elif g.cylinder is not None:
            prim = UsdGeom.Cylinder.Define(self.stage, path)
            prim.CreateRadiusAttr(float(g.cylinder.radius))
            prim.CreateHeightAttr(float(g.cylinder.length))
            prim.CreateAxisAttr("Z")
            _place(prim, origin)
        elif g.sphere is not None:
            prim = UsdGeom.Sphere.Define(self.stage, path)
            prim.CreateRadiusAttr(float(g.sphere.radius))
            _place(prim, origin)
        elif g.mesh is None:
            return
        else:
            prim = UsdGeom.Mesh.Define(self.stage, path)
            vertices, faces = read_triangles(existing(g.mesh.filename, self.asset.urdf_path))
            scale = 1.0 if g.mesh.scale is None else np.broadcast_to(g.mesh.scale, 3)
            _fill(prim, vertices * scale, faces)
            _place(prim, origin)
            api = UsdPhysics.MeshCollisionAPI.Apply(prim.GetPrim())
            api.CreateApproximationAttr("convexHull")
        UsdPhysics.CollisionAPI.Apply(prim.GetPrim())
        prim.CreatePurposeAttr("guide")  # drawn only on demand

    def _joint(self, joint: Any) -> None:
        from pxr import Gf, UsdPhysics

        path = f"/object/joints/{joint.name}"
        moves = joint.type in MOVING  # planar and floating joints count as fixed
        kinds = {"prismatic": UsdPhysics.PrismaticJoint, "fixed": UsdPhysics.FixedJoint}
        kind = kinds.get(joint.type if moves else "fixed", UsdPhysics.RevoluteJoint)
        made = kind.Define(self.stage, path)
        made.CreateBody0Rel().SetTargets([f"/object/{joint.parent}"])
        made.CreateBody1Rel().SetTargets([f"/object/{joint.child}"])
        made.CreateCollisionEnabledAttr(False)
        origin = origin_of(joint)
        # the joint frame's x is the axis, in both bodies
        turn = _frame_of(np.asarray(joint.axis, dtype=float)) if moves else np.eye(3)
        made.CreateLocalPos0Attr(Gf.Vec3f(*map(float, origin[:3, 3])))
        made.CreateLocalRot0Attr(_quaternion(origin[:3, :3] @ turn))
        made.CreateLocalPos1Attr(Gf.Vec3f(0.0, 0.0, 0.0))
        made.CreateLocalRot1Attr(_quaternion(turn))
        if not moves:
            return
        made.CreateAxisAttr("X")
        slides = joint.type == "prismatic"
        unit = 1.0 if slides else 180.0 / np.pi  # USD counts revolute limits in degrees
        if joint.type != "continuous" and joint.limit is not None:
            made.CreateLowerLimitAttr(float(joint.limit.lower) * unit)
            made.CreateUpperLimitAttr(float(joint.limit.upper) * unit)
        card = self.cards.get(joint.name)
        if card is not None:
            way = "linear" if slides else "angular"
            drive = UsdPhysics.DriveAPI.Apply(made.GetPrim(), way)
            drive.CreateStiffnessAttr(0.0)
            drive.CreateDampingAttr(0.0)
            # UsdPhysics knows no friction of a joint; Newton and PhysX do, each in its own words
            damping, friction = float(card.damping) / unit, float(card.friction)
            numbers = {"newton:damping": damping, "newton:friction": friction}
            _apply(made, "NewtonJointAPI", numbers)
            words = ("staticFrictionEffort", "dynamicFrictionEffort", "viscousFrictionCoefficient")
            names = [f"physxJointAxis:{way}:{word}" for word in words]
            numbers = dict(zip(names, (friction, friction, damping)))
            _apply(made, f"PhysxJointAxisAPI:{way}", numbers)
        if joint.mimic is not None:
            self._couple(made, joint, unit)

    def _couple(self, made: Any, joint: Any, unit: float) -> None:
        """What a mimic joint follows, for Newton and for PhysX; offsets in degrees or metres."""
        leader = next(j for j in self.robot.joints if j.name == joint.mimic.joint)
        if (leader.type == "prismatic") != (joint.type == "prismatic"):
            raise InputError(
                f"{self.asset.card.name}: joint {joint.name!r} follows {leader.name!r}, and USD "
                "couples no slide with a hinge; take <mimic> out of the URDF to export it"
            )
        multiplier = float(joint.mimic.multiplier)
        offset = float(joint.mimic.offset) * unit
        leads = f"/object/joints/{leader.name}"
        numbers = {"newton:mimicCoef0": offset, "newton:mimicCoef1": multiplier}
        _apply(made, "NewtonMimicAPI", numbers)
        made.GetPrim().CreateRelationship("newton:mimicJoint").SetTargets([leads])
        # PhysX: own value + gearing * leader's value + offset = 0
        name = "physxMimicJoint:rotX"
        numbers = {f"{name}:gearing": -multiplier, f"{name}:offset": -offset}
        _apply(made, "PhysxMimicJointAPI:rotX", numbers)
        made.GetPrim().CreateRelationship(f"{name}:referenceJoint").SetTargets([leads])


def _apply(made: Any, schema: str, numbers: Mapping[str, float]) -> None:
    """Put a schema that usd-core does not know on a prim, with its numbers."""
    from pxr import Sdf

    made.GetPrim().AddAppliedSchema(schema)
    for name, value in numbers.items():
        made.GetPrim().CreateAttribute(name, Sdf.ValueTypeNames.Float, False).Set(value)


def _place(prim: Any, matrix: FloatArray, scale: FloatArray | None = None) -> None:
    from pxr import Gf, UsdGeom

    api = UsdGeom.Xformable(prim)
    api.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(*map(float, matrix[:3, 3])))
    x, y, z, w = Rotation.from_matrix(matrix[:3, :3]).as_quat()
    api.AddOrientOp(UsdGeom.XformOp.PrecisionDouble).Set(
        Gf.Quatd(float(w), Gf.Vec3d(float(x), float(y), float(z)))
    )
    if scale is not None:
        api.AddScaleOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(*map(float, scale)))


def _fill(prim: Any, vertices: FloatArray, faces: Any) -> None:
    """Points, triangles, a normal per triangle, and the box that USD calls extent."""
    from pxr import Gf, UsdGeom, Vt

    corners = np.asarray(vertices, dtype=float)[np.asarray(faces)]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    # a triangle without area has no normal, and USD wants one
    normals = np.where(length > 0, normals / np.maximum(length, 1e-300), [0.0, 0.0, 1.0])
    prim.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(np.asarray(vertices, dtype=np.float32)))
    prim.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(normals.astype(np.float32)))
    prim.SetNormalsInterpolation(UsdGeom.Tokens.uniform)
    low, high = np.min(vertices, axis=0), np.max(vertices, axis=0)
    prim.CreateExtentAttr([Gf.Vec3f(*map(float, low)), Gf.Vec3f(*map(float, high))])
    prim.CreateFaceVertexCountsAttr([3] * len(faces))
    prim.CreateFaceVertexIndicesAttr([int(i) for i in np.asarray(faces).reshape(-1)])
    prim.CreateSubdivisionSchemeAttr("none")
    prim.CreateDoubleSidedAttr(True)


def _quaternion(turn: FloatArray) -> Any:
    from pxr import Gf

    x, y, z, w = Rotation.from_matrix(turn).as_quat()
    return Gf.Quatf(float(w), float(x), float(y), float(z))


def _frame_of(axis: FloatArray) -> FloatArray:
    """(3, 3) right-handed frame whose x is the axis."""
    x = axis / np.linalg.norm(axis)
    y = np.cross(x, np.eye(3)[int(np.argmin(np.abs(x)))])
    y /= np.linalg.norm(y)
    return np.stack([x, y, np.cross(x, y)], axis=1)
