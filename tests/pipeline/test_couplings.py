"""Mimic joints of a URDF: read, written, checked, and exported with their coupling."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from mam_pipeline.asset.card import Asset
from mam_pipeline.asset.read import read_asset
from mam_pipeline.asset.writer import write_asset
from mam_pipeline.check.lint import lint
from mam_pipeline.errors import InputError
from mam_pipeline.formats.urdf.read import read_urdf
from mam_pipeline.formats.urdf.tree import coupling_note
from mam_pipeline.types import Coupling, coupled


def wardrobe(folder: Path, *joints: tuple[str, str]) -> Path:
    """A carcass with one door for each joint, of whose element the second text is a part."""
    robot = '<robot name="wardrobe"><link name="body">'
    for place, size in (("0.2 0 0.5", "0.02 1 1"), ("0 0 0.01", "0.38 1 0.02")):
        shape = f'<geometry><box size="{size}"/></geometry>'
        robot += f'<visual><origin xyz="{place}"/>{shape}</visual>'
    robot += "</link>"
    for k, (name, more) in enumerate(joints):
        robot += (
            f'<link name="door_{k}"><visual><origin xyz="0 0.12 0"/><geometry>'
            '<box size="0.02 0.2 0.9"/></geometry></visual></link>'
            f'<joint name="{name}" type="revolute"><origin xyz="-0.2 {0.25 * k - 0.5} 0.5"/>'
            f'<parent link="body"/><child link="door_{k}"/><axis xyz="0 0 1"/>'
            f'<limit lower="-3" upper="3" effort="5" velocity="2"/>{more}</joint>'
        )
    file = folder / "wardrobe.urdf"
    file.write_text(robot + "</robot>")
    return file


def two_doors(folder: Path) -> Path:
    mimic = '<mimic joint="left" multiplier="-0.5" offset="0.1"/>'
    return wardrobe(folder, ("left", ""), ("right", mimic))


def test_one_value_moves_all_of_a_group() -> None:
    follow = {"a": None, "b": Coupling("a", -2.0, 0.1), "c": Coupling("a", 3.0), "d": None}
    found = coupled({"a": 0.2, "d": 1.0}, follow)
    assert found == pytest.approx({"a": 0.2, "b": -0.3, "c": 0.6, "d": 1.0})
    assert coupled({"b": -0.3}, follow)["a"] == pytest.approx(0.2)
    assert coupled({"a": 0.7, "b": -0.3}, follow)["c"] == pytest.approx(0.6)
    assert coupled({"d": 1.0}, follow) == {"d": 1.0}


def test_a_chain_of_mimics_follows_its_head(tmp_path: Path) -> None:
    middle = '<mimic joint="left" multiplier="2" offset="0.1"/>'
    last = '<mimic joint="middle" multiplier="-3" offset="0.5"/>'
    made = read_urdf(wardrobe(tmp_path, ("left", ""), ("middle", middle), ("last", last)))
    found = {j.name: j.coupling for j in made.joints}
    assert found["left"] is None and found["middle"] == Coupling("left", 2.0, 0.1)
    last_one = found["last"]
    assert last_one is not None and last_one.joint == "left"
    assert (last_one.multiplier, last_one.offset) == pytest.approx((-6.0, 0.2))


def test_an_asset_keeps_a_coupling(tmp_path: Path) -> None:
    source = two_doors(tmp_path)
    made = read_urdf(source)
    assert coupling_note(source, made) == ""
    asset = write_asset(made, tmp_path / "asset", name="a")
    wanted = Coupling("left", -0.5, 0.1)
    assert {j.name: j.coupling for j in Asset.load(asset.folder).card.joints}["right"] == wanted
    assert {j.name: j.coupling for j in read_urdf(asset.urdf_path).joints}["right"] == wanted
    assert {j.name: j.coupling for j in read_asset(asset).joints}["right"] == wanted


def test_a_leader_without_a_surface_is_said(tmp_path: Path) -> None:
    source = two_doors(tmp_path)
    root = ET.fromstring(source.read_text())
    for visual in root.findall("link[@name='door_0']/visual"):
        root.find("link[@name='door_0']").remove(visual)  # type: ignore[union-attr]
    source.write_text(ET.tostring(root, encoding="unicode"))
    made = read_urdf(source)
    assert [j.coupling for j in made.joints] == [None]
    assert coupling_note(source, made).startswith("the coupling of right is not kept")


@pytest.mark.parametrize(
    ("mimic", "said"),
    [
        ('<mimic joint="middle"/>', "it follows the joint 'middle', which does not exist"),
        ('<mimic joint="right"/>', "it follows itself"),
        ('<mimic joint="left" multiplier="much"/>', "'much' is not a number"),
    ],
)
def test_a_wrong_mimic_fails_the_lint(tmp_path: Path, mimic: str, said: str) -> None:
    found = lint(wardrobe(tmp_path, ("left", ""), ("right", mimic)))
    assert [f.message for f in found if f.code == "bad_joint"] == [said]


def test_mujoco_ties_coupled_joints(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco", reason="the mujoco extra is not installed")
    from mam_sim_formats.mjcf_export import export_mjcf

    asset = write_asset(read_urdf(two_doors(tmp_path)), tmp_path / "asset", name="a")
    model = mujoco.MjModel.from_xml_path(str(export_mjcf(asset)))
    data = mujoco.MjData(model)
    model.opt.gravity[:] = 0.0
    data.joint("left").qpos, data.joint("right").qpos = 0.0, 0.1
    data.joint("left").qfrc_applied = 2.0
    for _ in range(500):
        mujoco.mj_step(model, data)
    left, right = float(data.joint("left").qpos[0]), float(data.joint("right").qpos[0])
    assert abs(left) > 0.2
    assert right == pytest.approx(-0.5 * left + 0.1, abs=0.02)


def test_usd_names_what_a_joint_follows(tmp_path: Path) -> None:
    usd = pytest.importorskip("pxr.Usd", reason="the usd extra is not installed")
    from mam_sim_formats.usd_export import export_usd

    asset = write_asset(read_urdf(two_doors(tmp_path)), tmp_path / "asset", name="a")
    stage = usd.Stage.Open(str(export_usd(asset)))
    joint = stage.GetPrimAtPath("/object/joints/right")
    schemas = joint.GetPrimTypeInfo().GetAppliedAPISchemas()
    assert "NewtonMimicAPI" in schemas and "PhysxMimicJointAPI:rotX" in schemas
    target = joint.GetRelationship("newton:mimicJoint").GetTargets()
    assert [str(t) for t in target] == ["/object/joints/left"]
    np.testing.assert_allclose(joint.GetAttribute("newton:mimicCoef1").Get(), -0.5)


@pytest.mark.sim
def test_the_check_drives_coupled_joints_together(tmp_path: Path) -> None:
    pytest.importorskip("sapien", reason="the sim extra is not installed")
    from mam_pipeline.check.drive import drive_urdf

    made = read_urdf(two_doors(tmp_path))
    asset = write_asset(made, tmp_path / "asset", name="a")
    follow = {j.name: j.coupling for j in made.joints if j.coupling is not None}
    found = drive_urdf(asset.urdf_path, {}, couplings=follow)
    assert not found.exploded and found.joints["left"].reached > 0.99


def test_usdz_is_one_file(tmp_path: Path) -> None:
    usd = pytest.importorskip("pxr.Usd", reason="the usd extra is not installed")
    from mam_sim_formats.usd_export import export_usd

    asset = write_asset(read_urdf(two_doors(tmp_path)), tmp_path / "asset", name="a")
    packed = export_usd(asset, tmp_path / "there" / "object.usdz")
    assert [f.name for f in packed.parent.iterdir()] == ["object.usdz"]
    assert usd.Stage.Open(str(packed)).GetPrimAtPath("/object/joints/right")


def test_usd_couples_no_slide_with_a_hinge(tmp_path: Path) -> None:
    pytest.importorskip("pxr.Usd", reason="the usd extra is not installed")
    from mam_sim_formats.usd_export import export_usd

    source = two_doors(tmp_path)
    text = source.read_text()
    source.write_text(text.replace('name="right" type="revolute"', 'name="right" type="prismatic"'))
    asset = write_asset(read_urdf(source), tmp_path / "asset", name="a")
    with pytest.raises(InputError, match="USD couples no slide with a hinge"):
        export_usd(asset)
