"""What a profile says of a URDF is what its simulator does, and what is mended for it is."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pytest
import trimesh

from mam_pipeline.asset.writer import write_asset
from mam_pipeline.check.check import check_asset, check_profile
from mam_pipeline.check.profiles import PROFILES, ProfileName
from mam_pipeline.errors import ConfigError, InputError
from mam_pipeline.mend import Order, mend
from mam_pipeline.types import Articulation, Joint, Link, Mesh
from tests.conformance.bullet import empty_world

GOOD = """<robot name="r">
 <link name="body"><visual><geometry><mesh filename="box.obj"/></geometry></visual>
  <collision><geometry><mesh filename="box.obj"/></geometry></collision>
  <inertial><mass value="2"/>
   <inertia ixx="0.02" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.02"/></inertial></link>
 <link name="door"><visual><geometry><mesh filename="box.obj"/></geometry></visual>
  <collision><geometry><mesh filename="box.obj"/></geometry></collision>
  <inertial><origin xyz="0 0 0" rpy="0 0 0"/><mass value="1"/>
   <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.015" iyz="0" izz="0.02"/></inertial></link>
 <joint name="hinge" type="revolute"><parent link="body"/><child link="door"/>
  <axis xyz="0 0 1"/><limit lower="0" upper="1.5" effort="10" velocity="1"/>
  <dynamics damping="0.1"/></joint>
</robot>"""


def written(folder: Path, *changes: tuple[str, str]) -> Path:
    """GOOD with regular expressions replaced, beside its mesh."""
    text = GOOD
    for pattern, new in changes:
        text, count = re.subn(pattern, new, text)
        assert count, pattern
    trimesh.creation.box((0.2, 0.2, 0.2)).export(folder / "box.obj")
    (folder / "r.urdf").write_text(text)
    return folder / "r.urdf"


def test_every_name_of_the_command_line_has_a_profile() -> None:
    assert set(get_args(ProfileName)) == set(PROFILES)


@pytest.mark.parametrize("name", list(PROFILES))
def test_a_sound_urdf_passes_every_profile(tmp_path: Path, name: str) -> None:
    report = check_profile(written(tmp_path), name)
    assert report.passed and report.reasons == (), report.findings


TURNED = (r'rpy="0 0 0"/><mass value="1"', 'rpy="0 0 0.7"/><mass value="1"')
HEAVY = ('izz="0.02"/></inertial></link>\n <joint', 'izz="0.09"/></inertial></link>\n <joint')
MIMIC = ("</joint>\n</robot>", """</joint><link name="flap"><collision><geometry>
<box size="1 1 1"/></geometry></collision><inertial><mass value="1"/><inertia ixx="1" ixy="0"
ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link><joint name="second" type="revolute"><parent
link="door"/><child link="flap"/><axis xyz="0 0 1"/><limit lower="0" upper="1" effort="1"
velocity="1"/><mimic joint="hinge"/></joint></robot>""")  # fmt: skip


@pytest.mark.parametrize(
    ("change", "code", "names"),
    [
        (("door", "2nd door"), "name_invalid", {"isaac", "newton"}),
        (TURNED, "inertial_turned", {"isaac", "newton"}),
        ((' effort="10" velocity="1"', ""), "effort_missing",
         {"mujoco", "pybullet", "isaac", "newton", "gazebo"}),
        (MIMIC, "mimic_ignored", {"pybullet", "gazebo"}),
        ((r'box.obj"/></geom', r'box.obj" scale="-1 1 1"/></geom'), "negative_scale",
         set(PROFILES)),
        (("revolute", "floating"), "joint_type", set(PROFILES)),
    ],
)  # fmt: skip
def test_a_fault_is_told_to_those_whom_it_concerns(
    tmp_path: Path, change: tuple[str, str], code: str, names: set[str]
) -> None:
    urdf = written(tmp_path, change)
    assert {n for n in PROFILES if code in check_profile(urdf, n).reasons} == names


def test_hulls_that_are_too_many_or_too_fine_are_told(tmp_path: Path) -> None:
    many = '<collision><geometry><box size="1 1 1"/></geometry></collision>' * 65
    urdf = written(tmp_path, ('<link name="door">', f'<link name="door">{many}'))
    assert check_profile(urdf, "isaac").reasons == ("hull_count",)
    trimesh.creation.icosphere(2, 0.1).export(tmp_path / "box.obj")
    codes = {f.code for f in check_profile(urdf, "isaac").findings}
    assert codes == {"hull_count", "hull_points"}


def test_a_cabinet_in_one_concave_mesh_is_told(tmp_path: Path) -> None:
    urdf = written(tmp_path)
    trimesh.creation.annulus(0.08, 0.1, 0.2).export(tmp_path / "box.obj")
    found = check_profile(urdf, "sapien").findings
    assert {f.code for f in found if f.warning} >= {"concave_collision"}


def test_pybullet_refuses_what_its_profile_names(tmp_path: Path) -> None:
    pybullet = empty_world()
    urdf = written(tmp_path, (r"box\.obj", "box.glb"))
    trimesh.creation.box((0.2, 0.2, 0.2)).export(tmp_path / "box.glb")
    assert "mesh_format" in check_profile(urdf, "pybullet").reasons
    assert "mesh_format" not in check_profile(urdf, "sapien").reasons
    with pytest.raises(pybullet.error):
        pybullet.loadURDF(str(urdf))


def test_mujoco_refuses_an_impossible_inertia_and_takes_the_mended_file(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    urdf = written(tmp_path, HEAVY)
    with pytest.raises(ValueError, match="inertia must satisfy"):
        mujoco.MjModel.from_xml_path(str(urdf))
    found = mend(urdf, tmp_path / "out", Order(("bad_inertia",), "mujoco", drive=False))
    assert check_profile(found.urdf, "mujoco").passed
    model = mujoco.MjModel.from_xml_path(found.urdf)
    assert model.njnt == 1 and urdf.read_text().count("0.09") == 1  # the source is not touched


def test_a_turned_inertial_frame_goes_into_the_tensor(tmp_path: Path) -> None:
    yourdfpy: Any = pytest.importorskip("yourdfpy")
    urdf = written(tmp_path, TURNED)
    found = mend(urdf, tmp_path / "out", Order(("inertial_turned",), "newton", drive=False))
    assert check_profile(found.urdf, "newton").passed
    tensors = []
    for file in (urdf, found.urdf):
        link = yourdfpy.URDF.load(str(file), load_meshes=False).robot.links[1]
        turn = link.inertial.origin[:3, :3]
        tensors.append(turn @ link.inertial.inertia @ turn.T)
    np.testing.assert_allclose(tensors[0], tensors[1], atol=1e-12)


def test_names_are_mended_everywhere(tmp_path: Path) -> None:
    urdf = written(tmp_path, MIMIC, ("door", "2nd door"), ("hinge", "hinge-1"))
    found = mend(urdf, tmp_path / "out", Order(("name_invalid",), "isaac", drive=False))
    assert check_profile(found.urdf, "isaac").passed
    text = Path(found.urdf).read_text()
    assert '<child link="link_2nd_door"' in text and '<parent link="link_2nd_door"' in text
    assert '<mimic joint="hinge_1"' in text and '<joint name="hinge_1"' in text


def test_sapien_inverts_the_coupling_of_siblings(tmp_path: Path) -> None:
    aside = ('link="door"/><child link="flap"/>', 'link="body"/><child link="flap"/>')
    twice = ('<mimic joint="hinge"/>', '<mimic joint="hinge" multiplier="2"/>')
    for changes, codes in (((MIMIC,), []), ((MIMIC, aside), []), ((MIMIC, twice), []),
                           ((MIMIC, aside, twice), ["mimic_ignored"])):  # fmt: skip
        report = check_profile(written(tmp_path, *changes), "sapien")
        assert [f.code for f in report.findings] == codes


def test_an_unknown_profile_names_those_that_exist(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="no profile named 'mujocoo'; did you mean 'mujoco'"):
        check_profile(written(tmp_path), "mujocoo")


def test_the_verb_takes_a_profile(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from mam_sim.cli import main

    urdf = str(written(tmp_path, (' effort="10" velocity="1"', "")))
    assert main(["check", urdf, "--profile", "mujoco"]) == 1
    assert "effort_missing: hinge" in capsys.readouterr().out


MJCF = """<mujoco><compiler meshdir="."/><asset><mesh name="box" file="box.obj"/></asset><worldbody>
<body name="case"><geom type="mesh" mesh="box"/><body name="door" pos="0.3 0 0">
<joint name="slide" type="slide" axis="1 0 0"{range}/><geom type="mesh" mesh="box"/></body></body>
</worldbody></mujoco>"""


def mjcf(folder: Path, old: str = "", new: str = "", limits: str = ' range="0 0.2"') -> Path:
    trimesh.creation.box((0.2, 0.2, 0.2)).export(folder / "box.obj")
    file = folder / "scene.xml"
    file.write_text(MJCF.format(range=limits).replace(old, new) if old else
                    MJCF.format(range=limits))  # fmt: skip
    return file


def test_an_mjcf_is_looked_at_as_it_is(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    file = mjcf(tmp_path)
    for name in ("mujoco", "isaac", "newton"):
        assert not check_profile(file, name).reasons
    assert check_profile(file, "pybullet").reasons == ("file_format",)
    endless = check_profile(mjcf(tmp_path, limits=""), "mujoco")
    assert endless.passed and [f.code for f in endless.findings] == ["bad_limits"]
    assert check_profile(mjcf(tmp_path, '"door"', '"2nd"'), "isaac").reasons == ("name_invalid",)
    assert check_profile(mjcf(tmp_path, "<geom", "<gem"), "mujoco").reasons == ("file_unreadable",)
    with pytest.raises(InputError, match="add --profile"):
        check_asset(file)


def test_an_mjcf_opens_nothing_outside_its_folder(tmp_path: Path) -> None:
    inner = tmp_path / "inner"
    inner.mkdir()
    mjcf(tmp_path).rename(tmp_path / "outer.xml")
    for old, new in (
        ("box.obj", "../box.obj"),
        ('meshdir="."', 'meshdir=".."'),
        ("<asset>", '<include file="../outer.xml"/><asset>'),
    ):
        assert "mesh_outside" in check_profile(mjcf(inner, old, new), "mujoco").reasons
    (inner / "more.xml").write_text('<mujoco><asset><mesh file="../box.obj"/></asset></mujoco>')
    file = mjcf(inner, "<asset>", '<include file="more.xml"/><asset>')
    assert "mesh_outside" in check_profile(file, "mujoco").reasons


def test_a_usd_file_is_looked_at_as_it_is(tmp_path: Path) -> None:
    pytest.importorskip("pxr")
    from mam_sim_formats.usd_export import export_usd

    solids = [trimesh.creation.box((0.2, 0.2, 0.2)), trimesh.creation.box((0.02, 0.2, 0.2))]
    solids[1].apply_translation([-0.12, 0, 0])
    whole: Any = trimesh.util.concatenate(solids)
    links = tuple(Link(n, n, np.arange(12) + 12 * i) for i, n in enumerate(("case", "door")))
    hinge = Joint("hinge", "revolute", "hinge", 0, 1, np.array([0, 0, 1.0]),
                  np.array([-0.11, 0.1, 0]), 0, 1.5, 0, 1.5)  # fmt: skip
    thing = Articulation(Mesh(whole.vertices, whole.faces), links, (hinge,))
    file = export_usd(write_asset(thing, tmp_path / "a", name="a"), tmp_path / "object.usda")
    for name in ("isaac", "newton"):
        assert not check_profile(file, name).reasons
    assert check_profile(file, "gazebo").reasons == ("file_format",)
    text = file.read_text()
    for pattern, new, code in (
        (r"metersPerUnit = 1", "", "usd_metadata"),
        ("PhysicsArticulationRootAPI", "PhysicsMeshCollisionAPI", "articulation_root"),
        (r"physics:upperLimit = \S+", "physics:upperLimit = -1", "bad_limits"),
    ):
        changed, count = re.subn(pattern, new, text)
        assert count
        (tmp_path / "changed.usda").write_text(changed)
        assert code in check_profile(tmp_path / "changed.usda", "isaac").reasons
    (tmp_path / "broken.usda").write_text("#usda 1.0\n(")
    assert check_profile(tmp_path / "broken.usda", "isaac").reasons == ("file_unreadable",)


@pytest.mark.parametrize("name", ["", "friction", "safety_controller", "coulomb_window", "inertia"])
def test_drake_in_strict_mode_refuses_what_its_profile_names(tmp_path: Path, name: str) -> None:
    parsing: Any = pytest.importorskip("pydrake.multibody.parsing")
    from pydrake.multibody.plant import MultibodyPlant

    change = {
        "": [],
        "friction": [('damping="0.1"', 'damping="0.1" friction="1"')],
        "safety_controller": [("<dynamics", '<safety_controller k_velocity="1"/><dynamics')],
        "coulomb_window": [('damping="0.1"', 'damping="0.1" coulomb_window="1"')],
        "inertia": [HEAVY],
    }[name]
    urdf = written(tmp_path, *change)

    def strict(file: str | Path) -> None:
        plant = MultibodyPlant(0.001)
        parser = parsing.Parser(plant)
        parser.SetStrictParsing()
        parser.AddModels(str(file))

    assert check_profile(urdf, "drake").passed == (not name)
    if name:
        with pytest.raises(RuntimeError):
            strict(urdf)
    found = mend(urdf, tmp_path / "out", Order(profile="drake", drive=False))
    assert check_profile(found.urdf, "drake").passed
    strict(found.urdf)
