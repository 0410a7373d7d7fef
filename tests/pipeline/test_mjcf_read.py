"""MJCF of others as a URDF: the same masses, limits and forward kinematics as in MuJoCo."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mam_pipeline.errors import InputError
from mam_pipeline.formats.mjcf_files import files_of_mjcf, is_mjcf

mujoco = pytest.importorskip("mujoco")

from mam_pipeline.formats.mjcf import urdf_of_mjcf  # noqa: E402 - after the skip

CABINET = """
<mujoco model="cabinet"><compiler angle="degree" meshdir="meshes"/>
 <asset><mesh name="knob" file="knob.stl"/></asset>
 <worldbody><body name="cabinet" pos="0.1 0.2 0.3" euler="0 0 30">
  <geom type="box" size="0.2 0.2 0.2"/>
  <body name="door" pos="-0.2 0 0" euler="10 0 0">
   <joint name="hinge" axis="0 0 1" pos="0 0.2 0" range="0 90" damping="0.3" frictionloss="0.1"/>
   <joint name="slide" type="slide" axis="1 0 0" pos="0.1 0 0.1" range="-0.1 0.2"/>
   <geom type="capsule" size="0.01 0.1" mass="1.5"/>
   <geom type="ellipsoid" size="0.01 0.02 0.03" mass="0.5"/>
   <body name="knob" pos="0 -0.1 0"><joint name="turn" axis="1 0 0"/>
    <geom type="mesh" mesh="knob" mass="0.2"/></body>
  </body></body></worldbody>
 <equality><joint joint1="slide" joint2="hinge" polycoef="0 0.1 0 0 0"/></equality>
</mujoco>"""


@pytest.fixture
def cabinet(tmp_path: Path) -> Path:
    import trimesh

    (tmp_path / "meshes").mkdir()
    trimesh.creation.box((0.02, 0.03, 0.04)).export(tmp_path / "meshes" / "knob.stl")
    (tmp_path / "cabinet.xml").write_text(CABINET)
    return tmp_path / "cabinet.xml"


def test_a_urdf_moves_as_mujoco_does(cabinet: Path, tmp_path: Path) -> None:
    import yourdfpy

    urdf = urdf_of_mjcf(cabinet, tmp_path / "out")
    robot = yourdfpy.URDF.load(str(urdf), load_meshes=False)
    assert {j.name: j.type for j in robot.robot.joints if j.type != "fixed"} == {
        "hinge": "revolute", "slide": "prismatic", "turn": "continuous",
    }  # fmt: skip
    limit = robot.joint_map["hinge"].limit
    assert limit is not None and limit.upper == pytest.approx(np.pi / 2)
    assert robot.joint_map["slide"].mimic.multiplier == pytest.approx(0.1)
    masses = {k.name: k.inertial.mass for k in robot.robot.links if k.inertial is not None}
    assert masses["door"] == pytest.approx(2.0) and masses["knob"] == pytest.approx(0.2)
    model = mujoco.MjModel.from_xml_path(str(cabinet))
    data = mujoco.MjData(model)
    data.qpos[:] = 0.7, 0.07, 0.4
    mujoco.mj_forward(model, data)
    robot.update_cfg({"hinge": 0.7, "turn": 0.4})
    for body in ("door", "knob"):
        index = model.body(body).id
        frame = robot.get_transform(body)
        inertial = robot.link_map[body].inertial.origin
        np.testing.assert_allclose((frame @ inertial)[:3, 3], data.xipos[index], atol=1e-6)
        turn = data.xmat[index].reshape(3, 3)
        np.testing.assert_allclose(frame[:3, :3], turn, atol=1e-6)


def test_what_leads_outside_or_is_no_model_is_said(cabinet: Path, tmp_path: Path) -> None:
    assert is_mjcf(cabinet) and {f.name for f in files_of_mjcf(cabinet)} == {
        "cabinet.xml", "knob.stl",
    }  # fmt: skip
    inner = tmp_path / "inner"
    inner.mkdir()
    outside = inner / "outside.xml"
    outside.write_text(CABINET.replace("knob.stl", "../../meshes/knob.stl"))
    with pytest.raises(InputError, match="outside its folder"):
        urdf_of_mjcf(outside, tmp_path / "none")
    broken = tmp_path / "broken.xml"
    broken.write_text(CABINET.replace("ellipsoid", "banana"))
    with pytest.raises(InputError, match="MuJoCo"):
        urdf_of_mjcf(broken, tmp_path / "none")


ENDLESS = {
    "replicate": '<worldbody><replicate count="1e9"><geom size="1"/></replicate></worldbody>',
    "nested": '<worldbody><replicate count="1000"><replicate count="1000"><geom size="1"/>'
    "</replicate></replicate></worldbody>",
    "flexcomp": '<worldbody><flexcomp name="a" type="grid" count="9999 9999 9"/></worldbody>',
    "texture": '<asset><texture type="2d" builtin="flat" width="99999" height="99999"/></asset>',
    "hfield": '<asset><hfield name="a" nrow="99999" ncol="99999" size="1 1 1 1"/></asset>',
}


@pytest.mark.parametrize("kind", ENDLESS)
def test_absurd_counts_are_refused_before_any_work(kind: str, tmp_path: Path) -> None:
    from mam_pipeline.check.other_files import file_findings

    file = tmp_path / "a.xml"
    file.write_text(f"<mujoco>{ENDLESS[kind]}</mujoco>")
    with pytest.raises(InputError, match="the most is"):
        urdf_of_mjcf(file, tmp_path / "out")
    (finding,) = file_findings(file, "mujoco")
    assert finding.code == "file_unreadable" and "the most is" in finding.message


def test_a_compile_that_takes_long_stops_at_its_limit(
    cabinet: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from mam_pipeline.formats import apart

    monkeypatch.setattr(apart, "BOUNDS", apart.Bounds(seconds=0.01))
    with pytest.raises(InputError, match="took more than"):
        urdf_of_mjcf(cabinet, tmp_path / "out")
