"""Export of an asset folder to MuJoCo's MJCF, through MuJoCo's own reader of URDF (MjSpec)."""

from __future__ import annotations

import shutil
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image
from scipy.spatial.transform import Rotation

from mam_pipeline import folders
from mam_pipeline.asset.card import Asset
from mam_pipeline.asset.dynamics import catch_pull, rubbing
from mam_pipeline.asset.visuals import by_material, free_name
from mam_pipeline.errors import InputError
from mam_pipeline.formats.mesh_files import read_file, save_obj
from mam_pipeline.formats.obj_write import write_obj_part
from mam_pipeline.formats.soup import join
from mam_pipeline.formats.urdf.admit import admitted
from mam_pipeline.formats.urdf.geometry import existing, read_triangles
from mam_pipeline.formats.urdf.tree import MOVING
from mam_pipeline.formats.urdf.write import numbers
from mam_pipeline.geometry.shading import corner_normals
from mam_pipeline.optional import require
from mam_pipeline.types import FloatArray, Material, Mesh


@dataclass(frozen=True)
class MjcfSettings:
    """What an export says besides what the asset does.

    Attributes:
        visual_group, collision_group: of geoms, as in MuJoCo's own models: its viewer shows the
            first and hides the second.
        timestep: seconds; MuJoCo's default.
        offscreen: pixels, width and height of the largest picture that `mujoco.Renderer` draws.
        impedance: of the friction of a joint with a catch (MuJoCo's own is 0.9 to 0.95): softer
            friction creeps, and what creeps out of its catch comes loose below the force that
            starts it.
    """

    visual_group: int = 2
    collision_group: int = 3
    timestep: float = 0.002
    offscreen: tuple[int, int] = (1920, 1080)
    impedance: float = 0.999


SETTINGS = MjcfSettings()


def export_mjcf(asset: Asset, path: str | Path | None = None) -> Path:
    """Write object.xml and its meshes (folder `mjcf/` beside it); returns the XML's path.

    Bodies, masses, joint frames, ranges, damping and friction are those of the URDF, read by
    MuJoCo. Added are materials with their textures (PNG, the one format of MuJoCo), geom groups,
    lights, a sky, a camera, keyframes `closed` and `open`, and contact excludes between parent and
    child, which SAPIEN leaves out too. The base is fixed. Bodies on springs have `gravcomp`.
    What keeps a joint closed besides friction is an actuator that nothing controls, its force a
    line of the joint's value: MuJoCo's own springs only pull harder on the way.

    Args:
        asset: the folder. path: of the XML; default ASSET/object.xml.

    Raises:
        MissingExtra: mujoco is not installed. InputError: MuJoCo refuses the asset.
    """
    require("MJCF export", "mujoco")
    target = Path(path) if path is not None else asset.folder / "object.xml"
    with folders.new_entries(target.parent, target.name) as work:
        try:
            text = _exported(asset, work)
        except (ValueError, RuntimeError) as error:  # what its reader or its compiler says
            said = " ".join(str(error).split())
            raise InputError(f"MuJoCo does not take {asset.urdf_path}: {said}") from error
        (work / target.name).write_text(text, encoding="utf-8")
    return target


def _exported(asset: Asset, work: Path) -> str:
    """Write the meshes of an export into the folder `work`; returns the XML."""
    import mujoco

    files = _Files(asset.urdf_path.parent, work / "mjcf")
    files.folder.mkdir()
    with _warnings_as_python():
        spec = mujoco.MjSpec.from_string(files.flattened(asset.urdf_path))
    spec.modelfiledir = str(work.resolve())
    spec.meshdir = spec.texturedir = files.folder.name
    spec.option.timestep = SETTINGS.timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    files.dress(spec, {part.link: part.friction for part in asset.card.parts})
    for joint in spec.joints:
        # MuJoCo's own filter leaves out parents that are fixed to the world
        child = joint.parent
        spec.add_exclude(bodyname1=child.parent.name, bodyname2=child.name)
    _catches(spec, asset)
    _balances(spec, asset)
    _light(spec, asset)
    _keys(spec, asset)
    with _warnings_as_python():
        model = spec.compile()  # what MuJoCo refuses is refused here, not by the file's reader
    return _exact(spec.to_xml(), model)


@contextmanager
def _warnings_as_python() -> Iterator[None]:
    """MuJoCo's warnings as Python's; by itself it writes a log file into the working folder."""
    import mujoco

    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda text: warnings.warn(f"MuJoCo: {text}", stacklevel=2))
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


def _exact(text: str, model: Any) -> str:
    """The XML with the kinematics and masses of the model in full; `to_xml` prints six digits."""
    root = ET.fromstring(text)
    for element in root.iter("body"):
        body = model.body(element.get("name"))
        element.set("pos", numbers(body.pos))
        element.set("quat", numbers(body.quat))
        inertial = element.find("inertial")
        if inertial is not None:
            inertial.set("mass", numbers(body.mass))
            inertial.set("pos", numbers(body.ipos))
            inertial.set("quat", numbers(body.iquat))
            inertial.set("diaginertia", numbers(body.inertia))
    for element in root.findall("worldbody//joint"):
        joint = model.joint(element.get("name"))
        element.set("axis", numbers(joint.axis))
        element.set("damping", numbers(model.dof_damping[joint.dofadr]))
        element.set("frictionloss", numbers(model.dof_frictionloss[joint.dofadr]))
        if element.get("range") is not None:
            element.set("range", numbers(joint.range))
    for element in root.findall("actuator/general"):
        own = model.actuator(element.get("name"))
        element.set("biasprm", numbers(own.biasprm[:3]))
        element.set("forcerange", numbers(own.forcerange))
    for element, data in zip(root.findall("equality/joint"), model.eq_data):
        element.set("polycoef", numbers(data[:5]))
    for element in root.findall("keyframe/key"):
        element.set("qpos", numbers(model.key(element.get("name")).qpos))
    ET.indent(root, " ")
    return ET.tostring(root, encoding="unicode") + "\n"


@dataclass
class _Files:
    """Mesh and texture files of one export, and what they look like.

    Attributes:
        source: the URDF's folder. folder: where the files go.
        materials: by name of a visual mesh.
    """

    source: Path
    folder: Path
    materials: dict[str, Material] = field(default_factory=dict)
    taken: set[str] = field(default_factory=set)
    pictures: dict[bytes, str] = field(default_factory=dict)

    def flattened(self, urdf: Path) -> str:
        """The URDF with its meshes copied into one folder, each of one object and one material."""
        robot = admitted(urdf)
        for joint in robot.findall("joint"):
            if joint.get("type") not in MOVING:  # planar and floating joints count as fixed
                joint.set("type", "fixed")
        for link in robot.findall("link"):
            for kind in ("visual", "collision"):
                for i, element in enumerate(link.findall(kind)):
                    element.set("name", f"{link.get('name')}_{kind}_{i}")
                    mesh = element.find("geometry/mesh")
                    if mesh is None:
                        continue
                    file = existing(mesh.get("filename") or "", urdf)
                    if kind == "visual":
                        self._visual(link, element, file)
                    else:
                        name = free_name(file.stem, self.taken)
                        place = self.folder / f"{name}.obj"
                        if file.suffix.lower() == ".obj":
                            shutil.copyfile(file, place)
                        else:  # of a file from elsewhere
                            save_obj(Mesh(*read_triangles(file)), place)
                        mesh.set("filename", place.name)
        options = ET.Element("mujoco")
        ET.SubElement(options, "compiler", fusestatic="false", discardvisual="false",
                      balanceinertia="false", strippath="false")  # fmt: skip
        robot.insert(0, options)
        return ET.tostring(robot, encoding="unicode")

    def _visual(self, link: ET.Element, element: ET.Element, file: Path) -> None:
        """Write a visual's pieces; every further one gets an element of its own."""
        content = read_file(file, self.source)
        place = list(link).index(element)
        whole = join(content.pieces, content.materials)
        for k, part in enumerate(by_material(whole)):
            name = free_name(file.stem if k == 0 else f"{file.stem}_{k}", self.taken)
            self.materials[name] = part.materials[0]
            # the picture is named in the XML, so the OBJ needs its coordinates alone
            # without normals of the file's, MuJoCo rounds the edges of boxes off
            write_obj_part(
                part, self.folder / f"{name}.obj", textured=part.uv is not None,
                normals=corner_normals(part),
            )  # fmt: skip
            (self.folder / f"{name}.mtl").unlink()
            own = element
            if k > 0:
                own = ET.fromstring(ET.tostring(element))
                own.set("name", f"{element.get('name')}_{k}")
                link.insert(place + k, own)
            mesh = own.find("geometry/mesh")
            assert mesh is not None
            mesh.set("filename", f"{name}.obj")

    def dress(self, spec: Any, friction: Mapping[str, float]) -> None:
        """Give visual geoms their group and material, collision geoms group and friction.

        Args:
            friction: Coulomb's coefficient by link.
        """
        import mujoco

        for geom in spec.geoms:
            shown = geom.contype == 0 and geom.conaffinity == 0
            geom.group = SETTINGS.visual_group if shown else SETTINGS.collision_group
            if not shown:
                _, turning, rolling = geom.friction
                geom.friction = [friction.get(geom.parent.name, geom.friction[0]), turning, rolling]
                continue
            geom.mass = 0.0
            material = self.materials.get(geom.meshname)
            if material is None:
                continue
            # open surfaces and flat sheets have no volume
            spec.mesh(geom.meshname).inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
            look = spec.add_material(name=geom.meshname, rgba=list(material.base_color))
            look.metallic, look.roughness = material.metallic, material.roughness
            look.specular = 0.5 * (1.0 - material.roughness)
            if material.image is not None:
                textures = list(look.textures)
                textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = self._picture(spec, material.image)
                look.textures = textures
            geom.material = geom.meshname

    def _picture(self, spec: Any, image: bytes) -> str:
        """Name of the texture that shows an image file, made once per image."""
        import mujoco

        if image not in self.pictures:
            name = f"texture_{len(self.pictures):02d}"
            png = image
            if not image.startswith(b"\x89PNG"):
                buffer = BytesIO()
                Image.open(BytesIO(image)).convert("RGB").save(buffer, format="PNG")
                png = buffer.getvalue()
            (self.folder / f"{name}.png").write_bytes(png)
            kind = mujoco.mjtTexture.mjTEXTURE_2D
            spec.add_texture(name=name, type=kind, file=f"{name}.png")
            self.pictures[image] = name
        return self.pictures[image]


def _catches(spec: Any, asset: Asset) -> None:
    """An actuator without gain for each catch: its bias falls to nothing on the catch's width."""
    import mujoco

    moving = {joint.name: joint for joint in spec.joints}
    for joint in asset.card.joints:
        if joint.catch is None or joint.catch.force == 0.0 or joint.name not in moving:
            continue
        impedance = list(moving[joint.name].solimp_friction)
        moving[joint.name].solimp_friction = [
            SETTINGS.impedance,
            SETTINGS.impedance,
            *impedance[2:],
        ]
        pull = catch_pull(joint, joint.closed)
        slope = joint.catch.force / joint.catch.width
        made = spec.add_actuator(name=f"{joint.name}_catch", target=joint.name)
        made.trntype = mujoco.mjtTrn.mjTRN_JOINT
        made.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        made.gainprm = [0.0] * len(made.gainprm)
        made.biasprm = [pull - slope * joint.closed, slope, *[0.0] * (len(made.biasprm) - 2)]
        made.forcelimited, made.forcerange = True, [min(pull, 0.0), max(pull, 0.0)]


def _balances(spec: Any, asset: Asset) -> None:
    """Where springs carry a part its bodies are compensated, and only what rubs is left."""
    moving = {joint.name: joint for joint in spec.joints}
    for joint in asset.card.joints:
        if joint.balance is None or joint.name not in moving:
            continue
        moving[joint.name].frictionloss = rubbing(joint)[0]
        carried = [moving[joint.name].parent]
        for body in carried:
            body.gravcomp = 1.0
            carried.extend(body.bodies)


def _light(spec: Any, asset: Asset) -> None:
    """Light over the viewer's shoulder, a sky, and a camera that sees the front from the right."""
    import mujoco

    low, high = np.asarray(asset.card.bounds, dtype=float)
    middle, size = (low + high) / 2, float(np.linalg.norm(high - low))
    spec.visual.headlight.ambient = [0.35, 0.35, 0.35]
    spec.visual.headlight.diffuse = [0.35, 0.35, 0.35]
    spec.visual.global_.offwidth, spec.visual.global_.offheight = SETTINGS.offscreen
    sky = spec.add_texture(name="sky", type=mujoco.mjtTexture.mjTEXTURE_SKYBOX)
    sky.builtin, sky.width, sky.height = mujoco.mjtBuiltin.mjBUILTIN_GRADIENT, 256, 1536
    sky.rgb1, sky.rgb2 = [0.75, 0.83, 0.92], [0.95, 0.95, 0.95]
    sun = np.array([-1.0, -0.6, 1.8])
    light = spec.worldbody.add_light(name="sun", pos=middle + 2 * size * sun, dir=-sun)
    light.type, light.diffuse = 1, [0.6, 0.6, 0.6]  # 1: directional
    # the object fills the default field of view of 45 degrees
    eye = middle + size * np.array([-1.35, -0.9, 0.7])
    spec.worldbody.add_camera(name="front", pos=eye, quat=_look(eye, middle))


def _look(eye: FloatArray, at: FloatArray) -> FloatArray:
    """(4,) quaternion, w first, of a camera that looks along its -z with y up."""
    back = (eye - at) / np.linalg.norm(eye - at)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    turn = np.stack([right, np.cross(back, right), back], axis=1)
    return np.asarray(Rotation.from_matrix(turn).as_quat()[[3, 0, 1, 2]])


def _keys(spec: Any, asset: Asset) -> None:
    cards = {j.name: j for j in asset.card.joints}
    if spec.joints and all(j.name in cards for j in spec.joints):
        for name in ("closed", "open"):
            spec.add_key(name=name, qpos=[getattr(cards[j.name], name) for j in spec.joints])
