"""USD articulations as URDF: our exports come back, and a stage by hand is where it should be."""

from __future__ import annotations

import re
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yourdfpy
from mam_sim_formats.usd_export import export_usd
from scipy.spatial.transform import Rotation

from mam_pipeline.asset.card import Asset
from mam_pipeline.asset.writer import write_asset
from mam_pipeline.errors import InputError
from mam_pipeline.formats import articulations
from mam_pipeline.formats.articulations import converted
from mam_pipeline.mend import mend
from mam_pipeline.optional import MissingExtra
from mam_sim.cli import main
from tests.pipeline.test_asset_exports import chain

pytest.importorskip("pxr")
pytest.importorskip("mam_sim_formats", reason="the package that reads USD is not installed")


def loaded(urdf: Path, **load: bool) -> Any:
    return yourdfpy.URDF.load(str(urdf), build_scene_graph=True, **load)


def read(stage: Path, out: Path) -> tuple[Any, tuple[str, ...]]:
    found = converted(stage, out)
    assert found is not None and found.kind == "USD"
    return loaded(found.urdf, load_meshes=True, load_collision_meshes=True,
                  build_collision_scene_graph=True), found.left  # fmt: skip


@pytest.fixture(scope="module")
def asset(tmp_path_factory: pytest.TempPathFactory) -> Asset:
    return write_asset(chain(), tmp_path_factory.mktemp("usd") / "a", name="a")


@pytest.mark.parametrize("suffix", [".usda", ".usdc", ".usdz"])
def test_what_we_export_comes_back(asset: Asset, tmp_path: Path, suffix: str) -> None:
    stage = export_usd(asset, tmp_path / "usd" / f"object{suffix}")
    back, left = read(stage, tmp_path / "out")
    own = loaded(asset.urdf_path, load_meshes=True)
    assert left == () and set(back.link_map) == set(own.link_map)
    assert set(back.joint_map) == set(own.joint_map)
    for name, joint in own.joint_map.items():
        other = back.joint_map[name]
        assert (other.type, other.parent, other.child) == (joint.type, joint.parent, joint.child)
        np.testing.assert_allclose(other.axis, joint.axis, atol=1e-5)
        np.testing.assert_allclose(other.origin, joint.origin, atol=1e-5)
        for key in ("lower", "upper") if joint.type != "continuous" else ():
            assert getattr(other.limit, key) == pytest.approx(getattr(joint.limit, key), abs=1e-5)
    cards = {j.name: j for j in asset.card.joints}
    for name in ("hinge", "slide"):
        told = back.joint_map[name].dynamics
        assert float(told.damping) == pytest.approx(cards[name].damping, rel=1e-5)
        assert float(told.friction) == pytest.approx(cards[name].friction, rel=1e-5)
    for name, link in own.link_map.items():
        body, other = link.inertial, back.link_map[name].inertial
        assert other.mass == pytest.approx(body.mass, rel=1e-5)
        np.testing.assert_allclose(other.origin, body.origin, atol=1e-5)
        np.testing.assert_allclose(other.inertia, body.inertia, atol=1e-5)
        assert len(back.link_map[name].collisions) == len(link.collisions)
    for share in (0.0, 0.4, 1.0):
        values = {"hinge": 1.4 * share, "slide": 0.3 * share, "spin": 2.0 * share}
        for robot in (own, back):
            robot.update_cfg(values)
        for name in own.link_map:
            np.testing.assert_allclose(back.get_transform(name), own.get_transform(name), atol=1e-5)
        np.testing.assert_allclose(back.scene.bounds, own.scene.bounds, atol=1e-5)


def test_what_follows_another_joint_does_so_again(asset: Asset, tmp_path: Path) -> None:
    shutil.copytree(asset.folder, tmp_path / "a")
    coupled = Asset(tmp_path / "a", asset.card)
    text = coupled.urdf_path.read_text()
    mimic = '<mimic joint="hinge" multiplier="-2.5" offset="0.25"/>'
    coupled.urdf_path.write_text(re.sub(r'(<joint name="spin"[^>]*>)', rf"\1{mimic}", text))
    back, _ = read(export_usd(coupled, tmp_path / "usd" / "object.usdc"), tmp_path / "out")
    rule = back.joint_map["spin"].mimic
    assert (rule.joint, rule.multiplier, rule.offset) == ("hinge", -2.5, pytest.approx(0.25))


STAGE = """#usda 1.0
(
    metersPerUnit = 0.01
    upAxis = "Y"
)
class Xform "handle"
{
    def Sphere "ball" {
        double radius = 1
    }
}
def Xform "desk" (prepend apiSchemas = ["PhysicsArticulationRootAPI"])
{
    def Cube "case" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsCollisionAPI"])
    {
        double size = 1
        float3 xformOp:scale = (40, 60, 80)
        double3 xformOp:translate = (0, 30, 0)
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    }
    def Xform "drawer" (
        prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"]
    )
    {
        float physics:mass = 2
        point3f physics:centerOfMass = (1, 2, 3)
        float3 physics:diagonalInertia = (10000, 20000, 25000)
        quatf physics:principalAxes = (0, 1, 0, 0)
        double3 xformOp:translate = (37, 40, 0)
        double xformOp:rotateY = 90
        uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:rotateY"]
        def Capsule "front" (prepend apiSchemas = ["PhysicsCollisionAPI"])
        {
            uniform token axis = "X"
            double radius = 2
            double height = 30
            color3f[] primvars:displayColor = [(1, 0, 0)]
        }
        def "handle" (instanceable = true
            references = </handle>)
        {
            double3 xformOp:translate = (0, 0, 5)
            uniform token[] xformOpOrder = ["xformOp:translate"]
        }
    }
    def PhysicsPrismaticJoint "slide"
    {
        uniform token physics:axis = "Y"
        rel physics:body0 = </desk/case>
        rel physics:body1 = </desk/drawer>
        point3f physics:localPos0 = (0.5, 0.25, 0)
        quatf physics:localRot0 = (0.70710678, 0, 0, -0.70710678)
        point3f physics:localPos1 = (0, 5, 0)
        quatf physics:localRot1 = (0.5, -0.5, -0.5, -0.5)
        float physics:lowerLimit = -3
        float physics:upperLimit = 17
    }
    def PhysicsFixedJoint "floor" {
        rel physics:body1 = </desk/case>
    }
    def Xform "lid" (prepend apiSchemas = ["PhysicsRigidBodyAPI", "PhysicsMassAPI"])
    {
        float physics:mass = 1
        float3 physics:diagonalInertia = (100, 200, 250)
        def Sphere "board" (prepend apiSchemas = ["PhysicsCollisionAPI"]) {
            double radius = 5
        }
    }
    def PhysicsRevoluteJoint "hinge"
    {
        rel physics:body0 = </desk/lid>
        rel physics:body1 = </desk/case>
        uniform token physics:axis = "Z"
        point3f physics:localPos0 = (5, 0, 0)
        point3f physics:localPos1 = (-0.5, 0.5, 0)
        float physics:lowerLimit = -90
        float physics:upperLimit = 30
    }
}
"""


def test_a_stage_in_centimetres_with_y_up_and_turned_bodies(tmp_path: Path) -> None:
    """The stage's x, y, z are x, z, -y of the URDF. At 0 the drawer stands 20 cm in x and 15 in y
    from the middle of the case, which is at a height of 30, less the 5 of its own frame."""
    (tmp_path / "desk.usda").write_text(STAGE)
    robot, left = read(tmp_path / "desk.usda", tmp_path / "out")
    assert left == () and set(robot.joint_map) == {"floor", "slide", "hinge"}
    slide, hinge = robot.joint_map["slide"], robot.joint_map["hinge"]
    assert (slide.type, slide.parent, slide.child) == ("prismatic", "case", "drawer")
    assert (slide.limit.lower, slide.limit.upper) == pytest.approx((-0.03, 0.17))
    # the joint's y is +x of the case, which is -z of the drawer (rotated 90 degrees about y)
    case = robot.get_transform("case")
    np.testing.assert_allclose(case[:3, 3], [0, 0, 0.3], atol=1e-6)
    for value in (0.0, 0.1):
        robot.update_cfg({"slide": value, "hinge": 0.0})
        drawer = robot.get_transform("drawer")
        np.testing.assert_allclose(drawer[:3, 3], [0.2 + value, 0, 0.45], atol=1e-6)
    drawn = drawer[:3, :3] @ slide.axis
    np.testing.assert_allclose(drawn, [1, 0, 0], atol=1e-6)
    # the lid is held by its edge at the case's upper edge, and parent and child were exchanged
    assert (hinge.parent, hinge.child) == ("case", "lid")
    assert (hinge.limit.lower, hinge.limit.upper) == pytest.approx((-np.pi / 2, np.pi / 6))
    robot.update_cfg({"slide": 0.0, "hinge": np.pi / 6})
    (board,) = robot.link_map["lid"].collisions
    middle = (robot.get_transform("lid") @ board.origin)[:3, 3]
    turned = Rotation.from_euler("y", 30, degrees=True).apply([-0.05, 0, 0])
    np.testing.assert_allclose(middle - turned, [-0.2, 0, 0.6], atol=1e-6)


def test_masses_shapes_colours_and_instances_of_that_stage(tmp_path: Path) -> None:
    (tmp_path / "desk.usda").write_text(STAGE)
    robot, _ = read(tmp_path / "desk.usda", tmp_path / "out")
    case, drawer = robot.link_map["case"], robot.link_map["drawer"]
    np.testing.assert_allclose(case.collisions[0].geometry.box.size, [0.4, 0.6, 0.8])
    # no mass is given: 1000 kg per cubic metre of its collider
    assert case.inertial.mass == pytest.approx(192.0, rel=1e-5)
    assert case.inertial.inertia[0, 0] == pytest.approx(192.0 / 12 * (0.6**2 + 0.8**2), rel=1e-4)
    assert drawer.inertial.mass == pytest.approx(2.0)
    # the link's frame lies 5 cm above the body's, where the joint is
    np.testing.assert_allclose(drawer.inertial.origin[:3, 3], [0.01, -0.03, 0.03], atol=1e-7)
    np.testing.assert_allclose(np.diag(drawer.inertial.inertia), [1.0, 2.0, 2.5], rtol=1e-5)
    lid = robot.link_map["lid"].inertial
    np.testing.assert_allclose(lid.inertia, np.diag([0.01, 0.02, 0.025]), atol=1e-7)
    rod, *ends = drawer.collisions
    assert rod.geometry.cylinder.length == pytest.approx(0.3)
    np.testing.assert_allclose(np.abs(rod.origin[:3, 2]), [1, 0, 0], atol=1e-6)
    assert [e.geometry.sphere.radius for e in ends] == pytest.approx([0.02, 0.02])
    np.testing.assert_allclose(np.ptp([e.origin[0, 3] for e in ends]), 0.3, atol=1e-6)
    files = [tmp_path / "out" / v.geometry.mesh.filename for v in drawer.visuals]
    assert len(files) == 2
    assert any("Kd 1 0 0" in f.with_suffix(".mtl").read_text() for f in files)
    handle = next(f for f in files if "Kd 1 0 0" not in f.with_suffix(".mtl").read_text())
    points = np.array([r.split()[1:4] for r in handle.read_text().splitlines() if r[:2] == "v "])
    np.testing.assert_allclose(points.astype(float).max(axis=0), [0.01, -0.04, 0.06], atol=1e-3)


def test_what_a_urdf_cannot_hold_is_said(tmp_path: Path) -> None:
    more = """def PhysicsFixedJoint "brace"
    {
      rel physics:body0 = </desk/lid>
      rel physics:body1 = </desk/drawer>
    }
    def Xform "lamp" (prepend apiSchemas = ["PhysicsRigidBodyAPI"])
    {
      double3 xformOp:translate = (0, 100, 0)
      uniform token[] xformOpOrder = ["xformOp:translate"]
    }
    def PhysicsSphericalJoint "neck"
    {
      rel physics:body0 = </desk/case>
      rel physics:body1 = </lamp>
    }
    def Xform "rug" (prepend apiSchemas = ["PhysicsRigidBodyAPI"]) {}"""
    (tmp_path / "desk.usda").write_text(STAGE + more)
    robot, left = read(tmp_path / "desk.usda", tmp_path / "out")
    assert left == (
        "joint slide, which closes a loop", "the motion of joint neck (spherical)",
    )  # fmt: skip
    assert robot.joint_map["neck"].type == robot.joint_map["rug_fixed"].type == "fixed"


def test_what_is_no_articulation_or_leads_outside_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mesh = tmp_path / "mesh.usda"
    mesh.write_text('#usda 1.0\ndef Sphere "ball" {}\n')
    assert main(["mend", str(mesh), "--out", str(tmp_path / "out")]) == 2
    assert "no joints between rigid bodies" in capsys.readouterr().out
    inner = tmp_path / "inner"
    inner.mkdir()
    outside = inner / "desk.usda"
    outside.write_text(STAGE + 'def "more" (references = @../mesh.usda@</ball>) {}')
    with pytest.raises(InputError, match="outside its folder"):
        converted(outside, tmp_path / "none")
    outside.write_text(STAGE.replace("def Xform", "def Xform Xform", 1))
    with pytest.raises(InputError, match="cannot be read as USD"):
        converted(outside, tmp_path / "none")


def test_without_the_package_the_way_to_it_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "desk.usda").write_text(STAGE)
    monkeypatch.setattr(articulations.Registry, "targets", lambda _: {})
    with pytest.raises(MissingExtra, match=r"pip install \./plugins/mam_sim_formats"):
        converted(tmp_path / "desk.usda", tmp_path / "out")


@pytest.mark.sim
def test_mend_takes_it_from_there(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "desk.usda").write_text(STAGE)
    main(["mend", str(tmp_path / "desk.usda"), "--out", str(tmp_path / "out")])
    lines = capsys.readouterr().out.splitlines()
    assert lines[1].strip() == (
        "file_format: desk.usda: USD -> desk.urdf (composed by USD: the same bodies, joints, "
        "shapes and masses)"
    )
    assert (tmp_path / "out" / "desk.urdf").is_file()


@pytest.mark.sim
def test_what_a_stage_lacks_is_mended_and_goes_back_to_usd(tmp_path: Path) -> None:
    """A drawer in centimetres without limits and without a mass, both ways of the format."""
    text = re.sub(r"float physics:(lower|upper)Limit = (-3|17)\n", "", STAGE)
    text = re.sub(r"float physics:mass = 2\n|float3 physics:diagonalInertia = \(10.*\n", "", text)
    assert text.count("Limit = ") == 2 and text.count("physics:mass") == 1
    (tmp_path / "desk.usda").write_text(text)
    found = mend(tmp_path / "desk.usda", tmp_path / "out")
    reasons = {(c.reason, c.where) for c in found.changes}
    assert ("bad_limits", "slide") in reasons and found.asset, found
    asset = Asset.load(tmp_path / "out")
    again, left = read(export_usd(asset, tmp_path / "usd" / "object.usda"), tmp_path / "back")
    slide, own = again.joint_map["slide"], loaded(asset.urdf_path).joint_map["slide"]
    assert left == () and again.link_map["drawer"].inertial.mass > 0
    assert 0.02 < own.limit.upper - own.limit.lower < 1.0  # metres, not centimetres
    assert (slide.limit.lower, slide.limit.upper) == pytest.approx(
        (own.limit.lower, own.limit.upper), abs=1e-5
    )
