"""Every reason that is mended has a pair: one file that has it, and one that is left as it is."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from mam_pipeline.check.check import check_asset, check_profile
from mam_pipeline.check.report import REASONS
from mam_pipeline.mend import REPAIRS, Order, mend

pytestmark = pytest.mark.sim

DOOR = """<link name="door"><visual><geometry><mesh filename="door.obj"/></geometry></visual>
  <collision><geometry><mesh filename="door.obj"/></geometry></collision>
  <inertial><origin xyz="-0.01 0.2 0" rpy="0 0 0"/><mass value="2"/>
   <inertia ixx="0.05" ixy="0" ixz="0" iyy="0.03" iyz="0" izz="0.03"/></inertial></link>"""
PASS = f"""<robot name="r"><!-- an owner's remark -->
 <link name="body"><visual><geometry><mesh filename="body.obj"/></geometry></visual>
  <collision><geometry><mesh filename="body.obj"/></geometry></collision>
  <inertial><mass value="20"/>
   <inertia ixx="0.5" ixy="0" ixz="0" iyy="0.5" iyz="0" izz="0.5"/></inertial></link>
 {DOOR}
 <joint name="hinge" type="revolute"><parent link="body"/><child link="door"/>
  <origin xyz="-0.2 -0.2 0"/><axis xyz="0 0 1"/><limit lower="0" upper="1.5" effort="10"
  velocity="1"/><dynamics damping="0.2" friction="0.5"/></joint>
</robot>"""
"""A box with a door before it: nothing is to be mended."""


def case(folder: Path, *changes: tuple[str, str]) -> Path:
    """PASS with regular expressions replaced, beside its meshes."""
    folder.mkdir(exist_ok=True)
    text = PASS
    for pattern, new in changes:
        text, count = re.subn(pattern, new, text, flags=re.DOTALL)
        assert count, pattern
    trimesh.creation.box((0.4, 0.4, 0.4)).export(folder / "body.obj")
    door = trimesh.creation.box(bounds=np.array([[-0.02, 0, -0.2], [0, 0.4, 0.2]]))
    door.export(folder / "door.obj")
    (folder / "r.urdf").write_text(text)
    return folder / "r.urdf"


def flipped(folder: Path) -> None:
    file = folder / "door.obj"
    file.write_text(
        re.sub(r"^v (\S+)", lambda m: f"v {-float(m[1])}", file.read_text(), flags=re.M)
    )


def ball(folder: Path) -> None:
    """Three hundred points for a door knob, collision alone."""
    trimesh.creation.icosphere(3, 0.02).export(folder / "knob.obj")


def hollow(folder: Path) -> None:
    """The body as a case without a front, in one mesh that collides as its hull."""
    walls = [
        trimesh.creation.box(bounds=np.array(b))
        for b in (
            [[-0.2, -0.2, -0.2], [0.2, -0.19, 0.2]], [[-0.2, 0.19, -0.2], [0.2, 0.2, 0.2]],
            [[-0.2, -0.19, -0.2], [0.2, 0.19, -0.19]], [[-0.2, -0.19, 0.19], [0.2, 0.19, 0.2]],
            [[0.19, -0.19, -0.19], [0.2, 0.19, 0.19]],
        )
    ]  # fmt: skip
    trimesh.util.concatenate(walls).export(folder / "body.obj")
    tray = trimesh.creation.box(bounds=np.array([[0, 0.012, -0.188], [0.3, 0.388, 0.188]]))
    tray.export(folder / "door.obj")


def moved(old: str, new: str) -> Callable[[Path], None]:
    def rename(folder: Path) -> None:
        target = folder / new
        target.parent.mkdir(exist_ok=True)
        (folder / old).rename(target)

    return rename


def picture(folder: Path) -> None:
    from PIL import Image

    (folder / "textures").mkdir()
    Image.new("RGB", (4, 4), (200, 30, 30)).save(folder / "textures" / "Wood.png")
    (folder / "door.mtl").write_text("newmtl m\nKd 1 1 1\nmap_Kd C:\\work\\wood.png\n")
    file = folder / "door.obj"
    file.write_text("mtllib door.mtl\nusemtl m\n" + file.read_text())


def nan(folder: Path) -> None:
    file = folder / "door.obj"
    file.write_text(file.read_text() + "v nan 0 0\nf 1 2 9\n")


SLIDE = (r'type="revolute"(.*)<axis xyz="0 0 1"/><limit lower="0" upper="1.5"',
         r'type="prismatic"\1<axis xyz="-1 0 0"/><limit lower="0" upper="0.2"')  # fmt: skip
MIMIC = ("</robot>", """<link name="flap"><visual><geometry><box size="0.1 0.1 0.1"/></geometry>
</visual><collision><geometry><box size="0.1 0.1 0.1"/></geometry></collision><inertial>
<mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="flap" type="revolute"><parent link="body"/><child link="flap"/><origin xyz="0 0 0.25"/>
<axis xyz="0 0 1"/><limit lower="0" upper="1" effort="1" velocity="1"/><dynamics damping="1"/>
<mimic joint="nobody"/></joint></robot>""")  # fmt: skip
Files = Callable[[Path], None] | None
FAIL: dict[str, tuple[str, list[tuple[str, str]], Files]] = {
    "a link's name twice": ("bad_tree", [("(?=</robot>)", '<link name="body"/>')], None),
    "a joint's end that nothing has": ("bad_tree", [('<child link="door"', '<child link="Door "')],
                                       None),
    "two roots": ("bad_tree", [("(?=</robot>)", '<link name="loose"/>')], None),
    "a name that is none": ("name_invalid", [("door\"", '2nd door"')], None),
    "a package": ("mesh_path", [('name="door.obj', 'name="package://parts/door.obj')], None),
    "another case": ("mesh_missing", [("door.obj", "Door.OBJ")], None),
    "another folder": ("mesh_missing", [], moved("door.obj", "meshes/door.obj")),
    "another format": ("mesh_missing", [("door.obj", "door.dae")], None),
    "no collision mesh": ("mesh_missing", [(r'(<collision>.{10}<mesh filename=")door', r"\1hull")],
                          None),
    "a picture elsewhere": ("texture_missing", [], picture),
    "a corner that is no number": ("not_finite", [], nan),
    "limits that are no number": ("not_finite", [('upper="1.5"', 'upper="nan"')], None),
    "a mirrored mesh": ("negative_scale", [('door.obj"', 'door.obj" scale="-1 1 1"')], flipped),
    "a type of another format": ("bad_joint", [("revolute", "hinge")], None),
    "a zero axis": ("bad_joint", [
        ("0 0 1", "0 0 0"), ('xyz="-0.2 -0.2 0"', 'xyz="-0.2 -0.2 0" rpy="0 -1.5707963 0"'),
        ('<geometry><mesh filename="door',
         '<origin rpy="0 1.5707963 0"/><geometry><mesh filename="door'),
    ], None),
    "commas": ("bad_joint", [('"0 0 1"', '"0, 0, 1"')], None),
    "negative damping": ("bad_joint", [('damping="0.2"', 'damping="-0.2"')], None),
    "follows nobody": ("bad_joint", [MIMIC], None),
    "a long axis": ("axis_length", [("0 0 1", "0 0 2")], None),
    "degrees": ("limits_degrees", [('upper="1.5"', 'upper="90"')], None),
    "limits exchanged": ("bad_limits", [('lower="0" upper="1.5"', 'lower="1.5" upper="0"')], None),
    "no range of a hinge": ("bad_limits", [('upper="1.5"', 'upper="0"')], None),
    "no limits of a slide": ("bad_limits", [SLIDE, ('lower="0" upper="0.2"', "")], None),
    "no effort": ("effort_missing", [('effort="10"', "")], None),
    "no mass": ("bad_inertia", [('<mass value="2"/>', '<mass value="0"/>')], None),
    "an impossible inertia": ("bad_inertia", [('izz="0.03"', 'izz="3"')], None),
    "no inertial": ("no_inertia", [("<inertial><origin.*?</inertial>", "")], None),
    "a turned inertial": (
        "inertial_turned", [('rpy="0 0 0"/><mass', 'rpy="0 0 0.7"/><mass')], None,
    ),
    "no collision shape": ("no_collision", [(r"(door.obj\S+\s*)<collision>.*?</collision>", r"\1")],
                           None),
    "a fine hull": ("hull_points", [("(?=<collision><geometry><mesh filename=\"door)",
        '<collision><origin xyz="-0.03 0.35 0"/><geometry><mesh filename="knob.obj"/></geometry>'
        '</collision>')], ball),
    "no friction": ("no_friction", [("<dynamics.*?/>", "")], None),
    "the wrong sign": ("penetration", [("0 0 1", "0 0 -1")], None),
    "too far": ("penetration", [('upper="1.5"', 'upper="5.5"')], None),
    "a slide that leaves its guide": ("detached", [
        SLIDE, ('upper="0.2"', 'upper="0.34"'),
        (r"(body.obj\S+\s*)<collision>.*?</collision>", r"\1"),
    ], hollow),
    "a lid that falls": ("sags", [
        ("0 0 1", "0 -1 0"), ("-0.2 -0.2 0", "-0.2 -0.2 -0.2"), ("-0.01 0.2 0", "-0.01 0.2 0.2"),
        ('<geometry><mesh filename="door', '<origin xyz="0 0 0.2"/><geometry><mesh filename="door'),
        ('friction="0.5"', 'friction="0.01"'),
    ], None),
    "a hull over a hollow": ("cavity_filled", [SLIDE], hollow),
}  # fmt: skip


def codes(urdf: Path) -> set[str]:
    """Reasons of the check, and of the profiles; warnings too."""
    names = ("isaac", "mujoco")
    found = {f.code for n in names for f in check_profile(urdf, n).findings}
    report = check_asset(urdf)
    return found | {f.code for f in report.findings} | set(report.reasons)


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> set[str]:
    """What is said of the file with nothing wrong."""
    return codes(case(tmp_path_factory.mktemp("sound")))


@pytest.mark.parametrize("name", list(FAIL))
def test_what_fails_is_refused_for_its_reason_and_mended(tmp_path: Path, name: str) -> None:
    reason, changes, files = FAIL[name]
    urdf = case(tmp_path / "fail", *changes)
    if files is not None:
        files(tmp_path / "fail")
    before = urdf.read_bytes()
    assert reason in codes(urdf)
    found = mend(urdf, tmp_path / "out", Order(only=(reason,)))
    assert {c.reason for c in found.changes} == {reason}
    assert reason not in codes(tmp_path / "out" / "r.urdf"), found
    assert found.passed, found.left
    assert urdf.read_bytes() == before


def test_every_kind_of_repair_that_a_file_can_ask_for_has_a_pair() -> None:
    pairs = {reason for reason, _, _ in FAIL.values()}
    rest = {"mesh_outside", "mesh_format", "several_objects", "concave_collision", "hull_count",
            "inertial_missing", "inertia_impossible", "collision_off", "exploded", "drift",
            "frozen", "no_return"}  # fmt: skip
    assert pairs | rest == set(REPAIRS) and set(REPAIRS) <= set(REASONS)


def test_what_passes_is_left_byte_for_byte(tmp_path: Path, sound: set[str]) -> None:
    urdf = case(tmp_path / "pass")
    found = mend(urdf, tmp_path / "out")
    assert not sound and found.changes == () and found.before and found.passed
    for file in (tmp_path / "pass").iterdir():
        assert (tmp_path / "out" / file.name).read_bytes() == file.read_bytes()
    kept = json.loads((tmp_path / "out" / "mend.json").read_text())
    assert kept["changes"] == [] and kept["source"] == str(urdf)
    assert {p.name for p in (tmp_path / "out").iterdir()} == {
        "r.urdf",
        "body.obj",
        "door.obj",
        "mend.json",
    }
