"""MJCF and USD are the same object as the URDF: poses, masses, and the same fall and friction."""

from __future__ import annotations

import shutil
import xml.etree.ElementTree as ET
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
import trimesh
from mam_sim_formats.mjcf_export import _warnings_as_python, export_mjcf
from mam_sim_formats.sdf_export import export_sdf
from mam_sim_formats.usd_export import export_usd
from PIL import Image
from scipy.spatial.transform import Rotation

from mam_pipeline.asset.card import Asset
from mam_pipeline.asset.exporters import export_asset
from mam_pipeline.asset.writer import write_asset
from mam_pipeline.check.other_files import file_findings
from mam_pipeline.errors import InputError
from mam_pipeline.optional import MissingExtra
from mam_pipeline.types import Articulation, Joint, Link, Material, Mesh

VALUES = {"hinge": 0.7, "slide": 0.11, "spin": 2.0}


def chain() -> Articulation:
    """A base, a lid on a tilted hinge, a slide on the base, and a knob on the lid."""
    solids = [
        trimesh.creation.box(bounds=[[0, -0.3, 0], [0.5, 0.3, 0.4]]),
        trimesh.creation.box(bounds=[[0, -0.3, 0.41], [0.5, 0.3, 0.43]]),
        trimesh.creation.box(bounds=[[-0.03, -0.2, 0.1], [-0.01, 0.2, 0.3]]),
        trimesh.creation.cylinder(0.02, sections=24, segment=[[0.1, 0, 0.431], [0.1, 0, 0.461]]),
    ]  # fmt: skip
    whole: Any = trimesh.util.concatenate(solids)
    label = np.repeat(np.arange(4), [len(s.faces) for s in solids])
    names = ("base", "lid", "tray", "knob")
    links = tuple(Link(n, n, np.flatnonzero(label == i)) for i, n in enumerate(names))
    tilted = np.array([0.1, 1.0, 0.05]) / np.linalg.norm([0.1, 1.0, 0.05])
    hinge_at, knob_at = np.array([0.5, 0, 0.42]), np.array([0.1, 0, 0.44])
    x, z, inf = np.array([1.0, 0, 0]), np.array([0, 0, 1.0]), np.inf
    joints = (
        Joint("hinge", "revolute", "hinge", 0, 1, tilted, hinge_at, -0.1, 1.4, 0, 1.4),
        Joint("slide", "prismatic", "slide", 0, 2, -x, np.zeros(3), 0, 0.3, 0, 0.3),
        Joint("spin", "continuous", "spin", 1, 3, z, knob_at, -inf, inf),
    )
    return Articulation(Mesh(whole.vertices, whole.faces), links, joints)


@pytest.fixture(scope="module")
def asset(tmp_path_factory: pytest.TempPathFactory) -> Asset:
    return write_asset(chain(), tmp_path_factory.mktemp("export") / "a", name="a")


def expected() -> dict[str, np.ndarray]:
    """World pose of every link frame at VALUES."""
    truth = chain()
    poses = truth.link_poses(VALUES)
    out = {}
    for i, link in enumerate(truth.links):
        joint = truth.joint_of(i)
        frame = np.eye(4)
        frame[:3, 3] = 0.0 if joint is None else joint.origin
        out[link.name] = poses[i] @ frame
    return out


def test_mjcf_has_the_same_poses_and_masses(asset: Asset) -> None:
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(export_mjcf(asset)))
    data = mujoco.MjData(model)
    for name, value in VALUES.items():
        data.joint(name).qpos[0] = value
    mujoco.mj_kinematics(model, data)
    for name, pose in expected().items():
        np.testing.assert_allclose(data.body(name).xpos, pose[:3, 3], atol=1e-6)
        np.testing.assert_allclose(data.body(name).xmat.reshape(3, 3), pose[:3, :3], atol=1e-6)
    for part in asset.card.parts:
        assert model.body(part.link).mass[0] == pytest.approx(part.mass, rel=1e-6)
    assert model.joint("slide").range.tolist() == [0.0, 0.3]
    assert model.joint("hinge").range.tolist() == [-0.1, 1.4]
    for joint in asset.card.joints:
        dof = model.joint(joint.name).dofadr[0]
        assert model.dof_damping[dof] == pytest.approx(joint.damping, rel=1e-9)
        assert model.dof_frictionloss[dof] == pytest.approx(joint.friction, rel=1e-9)
    for key in ("closed", "open"):
        wanted = {j.name: getattr(j, key) for j in asset.card.joints}
        data.qpos[:] = model.key(key).qpos
        assert {n: data.joint(n).qpos[0] for n in wanted} == pytest.approx(wanted)


def test_mjcf_can_be_drawn_before_a_sky(asset: Asset, tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(export_mjcf(asset, tmp_path / "object.xml")))
    assert model.vis.global_.offheight >= 600 and model.vis.global_.offwidth >= 800
    assert mujoco.mjtTexture.mjTEXTURE_SKYBOX in model.tex_type and model.nlight


def test_sdf_has_the_same_poses_masses_and_joints(asset: Asset, tmp_path: Path) -> None:
    """Poses by what SDF says: links in the model's frame, axes in that of the child."""
    file = export_sdf(asset, tmp_path / "object.sdf")
    (model,) = ET.parse(file).getroot()
    assert ET.parse(tmp_path / "model.config").findtext("sdf") == "object.sdf"
    at_rest, poses = {}, {"base": np.eye(4)}
    for link in model.findall("link"):
        at_rest[link.get("name")] = _sdf_pose(link)
        for uri in link.iter("uri"):
            assert (tmp_path / str(uri.text)).is_file()
    joints = {j.get("name"): j for j in model.findall("joint")}
    fixed = joints.pop("world_fixed")
    assert (fixed.findtext("parent"), fixed.findtext("child")) == ("world", "base")
    for name, joint in joints.items():
        parent, child = str(joint.findtext("parent")), str(joint.findtext("child"))
        axis = np.array(str(joint.findtext("axis/xyz")).split(), float)
        motion = np.eye(4)
        if joint.get("type") == "prismatic":
            motion[:3, 3] = VALUES[str(name)] * axis
        else:
            motion[:3, :3] = Rotation.from_rotvec(VALUES[str(name)] * axis).as_matrix()
        between = np.linalg.inv(at_rest[parent]) @ at_rest[child]
        poses[child] = poses[parent] @ between @ motion  # the chain names parents first
    for link_name, pose in expected().items():
        np.testing.assert_allclose(poses[link_name], pose, atol=1e-6)
    for part in asset.card.parts:
        link = next(e for e in model.findall("link") if e.get("name") == part.link)
        assert float(str(link.findtext("inertial/mass"))) == pytest.approx(part.mass)
        mu = [float(str(e.text)) for e in link.iter("mu")]
        assert mu and mu == pytest.approx([part.friction] * len(mu))
    for card in asset.card.joints:
        own = joints[card.name].find("axis")
        assert own is not None
        ends = [own.findtext("limit/lower"), own.findtext("limit/upper")]
        assert [e and float(e) for e in ends] == [card.lower, card.upper]
        assert float(str(own.findtext("dynamics/friction"))) == pytest.approx(card.friction)
        assert float(str(own.findtext("dynamics/damping"))) == pytest.approx(card.damping)


def test_a_link_of_a_urdf_that_is_called_world_has_another_name_in_sdf(tmp_path: Path) -> None:
    """SDF keeps the name for the world itself, and its parser refuses such a link."""
    made = chain()
    links = (replace(made.links[0], name="world"), *made.links[1:])
    asset = write_asset(replace(made, links=links), tmp_path / "a", name="a")
    (model,) = ET.parse(export_sdf(asset, tmp_path / "sdf" / "object.sdf")).getroot()
    assert {link.get("name") for link in model.findall("link")} == {
        "world_link", "lid", "tray", "knob",
    }  # fmt: skip
    ends = {j.get("name"): (j.findtext("parent"), j.findtext("child")) for j in model.iter("joint")}
    assert ends["world_fixed"] == ("world", "world_link") and ends["hinge"][0] == "world_link"


def _sdf_pose(element: ET.Element) -> np.ndarray:
    values = np.array(str(element.findtext("pose")).split(), float)
    pose = np.eye(4)
    pose[:3, 3] = values[:3]
    pose[:3, :3] = Rotation.from_euler("xyz", values[3:]).as_matrix()
    return pose


@pytest.mark.parametrize("suffix", [".stl", ".dae", ".glb"])
def test_mjcf_collides_with_meshes_of_other_formats(tmp_path: Path, suffix: str) -> None:
    """As assets have them that `mam-sim mend` made of files from elsewhere."""
    mujoco = pytest.importorskip("mujoco")
    asset = write_asset(chain(), tmp_path / "a", name="a")
    text, ball = asset.urdf_path.read_text(), trimesh.creation.icosphere(2, 0.05)
    ball.export(tmp_path / "a" / f"ball{suffix}")
    shape = f'<collision><geometry><mesh filename="ball{suffix}"/></geometry></collision>'
    asset.urdf_path.write_text(text.replace("</inertial>", f"</inertial>{shape}", 1))
    model = mujoco.MjModel.from_xml_path(str(export_mjcf(asset, tmp_path / "x" / "object.xml")))
    first = model.mesh("ball")
    assert model.mesh_vertnum[first.id] >= len(ball.vertices)


@pytest.mark.parametrize("format", ["obj", "glb"])
def test_mjcf_shows_every_face_and_texture(tmp_path: Path, format: Literal["obj", "glb"]) -> None:
    """A flat sheet, a JPEG and three materials on one link come through, from either format."""
    mujoco = pytest.importorskip("mujoco")
    made = chain()
    sheet = np.array([[0, -0.3, 0.5], [0.5, -0.3, 0.5], [0.5, 0.3, 0.5], [0, 0.3, 0.5]])
    count = len(made.mesh.faces)
    vertices = np.concatenate([made.mesh.vertices, sheet])
    faces = np.concatenate([made.mesh.faces, np.array([[0, 1, 2], [0, 2, 3]]) + len(vertices) - 4])
    picture = BytesIO()
    Image.new("RGB", (8, 8), (200, 30, 30)).save(picture, format="JPEG")
    materials = (
        Material("plain", (0.2, 0.5, 0.2, 1.0)),
        Material("photo", (1, 1, 1, 1), picture.getvalue(), "jpeg"),
        Material("blue", (0.1, 0.1, 0.9, 1.0)),
    )
    which = np.zeros(len(faces), int)
    which[count:], which[:6] = 1, 2
    uv = np.full((len(vertices), 2), 0.5, np.float32)
    mesh = Mesh(vertices, faces, materials, which, uv=uv)
    base = replace(made.links[0], faces=np.append(made.links[0].faces, [count, count + 1]))
    links = (base, *made.links[1:])
    asset = write_asset(replace(made, mesh=mesh, links=links), tmp_path / "a", name="a",
                        visuals=format)  # fmt: skip
    model = mujoco.MjModel.from_xml_path(str(export_mjcf(asset, tmp_path / "m" / "object.xml")))
    shown = np.flatnonzero(model.geom_group == 2)
    assert (model.geom_contype[shown] == 0).all() and (model.geom_conaffinity[shown] == 0).all()
    assert model.mesh_facenum[model.geom_dataid[shown]].sum() == len(faces)
    assert set(np.flatnonzero(model.geom_contype)) == set(np.flatnonzero(model.geom_group == 3))
    assert (model.tex_type == mujoco.mjtTexture.mjTEXTURE_2D).sum() == 1  # the sky is none
    assert model.ncam == 1 and model.nlight == 1
    textured = [g for g in shown if model.mat_texid[model.geom_matid[g]].max() >= 0]
    assert len(textured) == 1 and model.mesh_facenum[model.geom_dataid[textured[0]]] == 2
    rgb = model.mat_rgba[model.geom_matid[shown], :3].astype(float)
    colours = {tuple(row) for row in rgb.round(2).tolist()}
    assert colours == {(0.2, 0.5, 0.2), (1.0, 1.0, 1.0), (0.1, 0.1, 0.9)}


def test_usd_has_the_same_poses_and_masses(asset: Asset) -> None:
    usd = pytest.importorskip("pxr.Usd")
    from pxr import Gf, UsdGeom, UsdPhysics

    stage = usd.Stage.Open(str(export_usd(asset)))
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    cache = UsdGeom.XformCache()
    found: dict[str, np.ndarray] = {"base": np.eye(4)}

    def local(joint: UsdPhysics.Joint, side: str) -> np.ndarray:
        get = joint.GetPrim().GetAttribute
        turn = Gf.Rotation(Gf.Quatd(get(f"physics:localRot{side}").Get()))
        matrix = Gf.Matrix4d(turn, Gf.Vec3d(get(f"physics:localPos{side}").Get()))
        return np.array(matrix).T

    for name in ("hinge", "slide", "spin"):
        joint = UsdPhysics.Joint(stage.GetPrimAtPath(f"/object/joints/{name}"))
        parent, child = (r.GetTargets()[0].name for r in (joint.GetBody0Rel(), joint.GetBody1Rel()))
        motion = np.eye(4)
        value = VALUES[name]
        if name == "slide":
            motion[0, 3] = value
        else:
            c, s = np.cos(value), np.sin(value)
            motion[1:3, 1:3] = [[c, -s], [s, c]]
        found[child] = found[parent] @ local(joint, "0") @ motion @ np.linalg.inv(local(joint, "1"))
    for name, pose in expected().items():
        np.testing.assert_allclose(found[name], pose, atol=1e-6)
        prim = stage.GetPrimAtPath(f"/object/{name}")
        mass = UsdPhysics.MassAPI(prim).GetMassAttr().Get()
        part = next(p for p in asset.card.parts if p.link == name)
        assert mass == pytest.approx(part.mass, rel=1e-6)
        rest = np.array(cache.GetLocalToWorldTransform(prim)).T
        joint_origin = next((j.origin for j in asset.card.joints if j.child == name), [0, 0, 0])
        np.testing.assert_allclose(rest[:3, 3], joint_origin, atol=1e-9)


@pytest.mark.sim
def test_usd_has_what_validators_ask_for(asset: Asset, tmp_path: Path) -> None:
    """Normals, extents, types of prims, one articulation root, friction where Newton reads it."""
    usd = pytest.importorskip("pxr.Usd")
    from pxr import UsdGeom, UsdPhysics

    stage = usd.Stage.Open(str(export_usd(asset, tmp_path / "object.usd")))
    prims = list(stage.Traverse())
    assert all(p.GetTypeName() for p in prims)
    assert sum(p.HasAPI(UsdPhysics.ArticulationRootAPI) for p in prims) == 1
    meshes = [UsdGeom.Mesh(p) for p in prims if p.IsA(UsdGeom.Mesh)]
    assert meshes
    for mesh in meshes:
        points = np.array(mesh.GetPointsAttr().Get())
        np.testing.assert_allclose(mesh.GetExtentAttr().Get(), [points.min(0), points.max(0)])
        normals = np.array(mesh.GetNormalsAttr().Get())
        assert len(normals) == len(mesh.GetFaceVertexCountsAttr().Get())
        np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-5)
    for joint in asset.card.joints:
        prim = stage.GetPrimAtPath(f"/object/joints/{joint.name}")
        assert prim.GetAttribute("newton:friction").Get() == pytest.approx(joint.friction)


def test_a_lid_behaves_alike_in_sapien_and_mujoco(asset: Asset) -> None:
    """Held by its friction in both; falls in both, alike, once friction is taken away."""
    mujoco = pytest.importorskip("mujoco")
    from mam_pipeline.asset.dynamics import set_joint_friction
    from mam_pipeline.check.simulate import load_physics, physics_scene

    card = next(j for j in asset.card.joints if j.name == "hinge")
    ends: dict[str, list[float]] = {"sapien": [], "mujoco": []}
    for friction in (card.friction, 0.0):
        scene = physics_scene(1 / 500)
        robot = load_physics(scene, asset.urdf_path)
        for joint in robot.active_joints:
            own = next(j for j in asset.card.joints if j.name == joint.name)
            hold = friction if joint.name == "hinge" else own.friction
            set_joint_friction(joint, own.type, hold, own.damping)
        names = [j.name for j in robot.active_joints]
        robot.set_qpos(
            np.array([VALUES["hinge"] if n == "hinge" else 0.0 for n in names], np.float32)
        )
        for _ in range(200):
            scene.step()
        ends["sapien"].append(float(robot.get_qpos()[names.index("hinge")]))

        model = mujoco.MjModel.from_xml_path(str(export_mjcf(asset)))
        model.dof_frictionloss[model.joint("hinge").dofadr[0]] = friction
        data = mujoco.MjData(model)
        data.joint("hinge").qpos[0] = VALUES["hinge"]
        for _ in range(200):
            mujoco.mj_step(model, data)
        ends["mujoco"].append(float(data.joint("hinge").qpos[0]))
    for held, fallen in ends.values():
        assert held == pytest.approx(VALUES["hinge"], abs=0.02)
        assert fallen < 0.6
    assert ends["sapien"][1] == pytest.approx(ends["mujoco"][1], abs=0.05)


def test_mujoco_warns_in_python_and_writes_no_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mujoco = pytest.importorskip("mujoco", reason="the mujoco extra is not installed")
    monkeypatch.chdir(tmp_path)
    mass = '<mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>'
    link = f"<inertial>{mass}</inertial></link>"
    urdf = (
        f'<robot name="r"><link name="a">{link}<link name="b">{link}<joint name="j" '
        'type="floating"><parent link="a"/><child link="b"/><mimic joint="j"/></joint></robot>'
    )
    with pytest.warns(UserWarning, match="mimic"), _warnings_as_python():
        mujoco.MjSpec.from_string(urdf)
    assert not list(tmp_path.iterdir())


@pytest.fixture
def floating(asset: Asset, tmp_path: Path) -> Asset:
    """The asset with a joint below the top level that its URDF calls floating."""
    shutil.copytree(asset.folder, tmp_path / "f")
    file = tmp_path / "f" / "object.urdf"
    text = file.read_text()
    assert text.count('type="continuous"') == 1
    file.write_text(text.replace('type="continuous"', 'type="floating"'))
    return Asset(tmp_path / "f", asset.card)


def test_a_floating_joint_is_fixed_in_both_exports(floating: Asset, tmp_path: Path) -> None:
    """As it is wherever else a URDF is read; MuJoCo alone would refuse it below the top level."""
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(export_mjcf(floating, tmp_path / "m" / "object.xml")))
    assert model.njnt == 2 and model.nbody == 5
    pytest.importorskip("pxr")
    from pxr import Usd, UsdPhysics

    stage = Usd.Stage.Open(str(export_usd(floating, tmp_path / "u" / "object.usd")))
    kinds = [UsdPhysics.FixedJoint(p) for p in stage.Traverse() if p.IsA(UsdPhysics.FixedJoint)]
    assert len(kinds) == 2


def test_what_mujoco_refuses_is_a_sentence_and_leaves_the_old_export(
    asset: Asset, tmp_path: Path
) -> None:
    mujoco = pytest.importorskip("mujoco")
    shutil.copytree(asset.folder, tmp_path / "a")
    broken = Asset.load(tmp_path / "a")
    target = tmp_path / "out" / "object.xml"
    export_mjcf(broken, target)
    before = {p: p.read_bytes() for p in target.parent.rglob("*") if p.is_file()}
    text = broken.urdf_path.read_text()
    broken.urdf_path.write_text(text.replace('mass value="', 'mass value="-'))
    with pytest.raises(InputError, match="MuJoCo does not take") as caught:
        export_mjcf(broken, target)
    assert "\n" not in str(caught.value)
    assert {p: p.read_bytes() for p in target.parent.rglob("*") if p.is_file()} == before
    assert mujoco.MjModel.from_xml_path(str(target)).nbody == 5


def test_usd_shows_boxes_and_moved_and_scaled_meshes(asset: Asset, tmp_path: Path) -> None:
    """As an asset has them whose URDF was edited by hand."""
    usd, geom = pytest.importorskip("pxr.Usd"), pytest.importorskip("pxr.UsdGeom")
    trimesh.creation.box().export(tmp_path / "unit.obj")
    (tmp_path / "a.urdf").write_text(
        """<robot name="r"><link name="base"><visual><origin xyz="1 0 0"/><geometry>
        <box size="1 2 4"/></geometry><material name="m"><color rgba="1 0 0 1"/></material>
        </visual><visual><origin xyz="0 0 10"/><geometry><mesh filename="unit.obj" scale="2 2 2"/>
        </geometry></visual></link></robot>"""
    )
    card = replace(asset.card, urdf="a.urdf", joints=[], parts=[], grasps=[])
    out = export_usd(Asset(tmp_path, card), tmp_path / "out" / "object.usd")
    stage, cache = usd.Stage.Open(str(out)), geom.BBoxCache(usd.TimeCode.Default(), ["default"])
    box = cache.ComputeWorldBound(stage.GetPseudoRoot()).ComputeAlignedRange()
    np.testing.assert_allclose([*box.GetMin()], [-1, -1, -2], atol=1e-6)
    np.testing.assert_allclose([*box.GetMax()], [1.5, 1, 11], atol=1e-6)


def test_without_the_package_of_exporters_the_way_to_it_is_said(
    asset: Asset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = export_asset(asset, "sdf", tmp_path / "object.sdf")
    monkeypatch.setattr("mam_pipeline.registry.installed", lambda _group: ())
    with pytest.raises(MissingExtra, match=r"MJCF export.*pip install \./plugins/mam_sim_formats"):
        export_asset(asset, "mjcf", tmp_path / "object.xml")
    assert made.is_file() and not (tmp_path / "object.xml").exists()
    (tmp_path / "other.xml").write_text("<mujoco/>")
    with pytest.raises(MissingExtra, match=r"checking MJCF.*pip install \./plugins"):
        file_findings(tmp_path / "other.xml", "mujoco")
