"""A sound URDF, and a broken one for every reason that `mam-sim mend` repairs, in pairs.

    python tests/pipeline/fault_cases.py FOLDER

writes them all: NAME_fail has the fault, NAME_pass is what it was made from.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh

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
  velocity="1"/><dynamics damping="0.2"/></joint>
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


def coarse_ball(folder: Path) -> None:
    """A door knob of 42 points and 80 faces."""
    trimesh.creation.icosphere(1, 0.02).export(folder / "knob.obj")


def cone(folder: Path) -> None:
    """A door knob on a face of forty corners."""
    trimesh.creation.cone(0.02, 0.03, sections=40).export(folder / "knob.obj")


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


def glb(folder: Path) -> None:
    trimesh.load(folder / "door.obj").export(folder / "door.glb")


def two_objects(folder: Path) -> None:
    """The door's upper and lower half as two objects of its file."""
    for name, low in (("lower", -0.2), ("upper", 0.0)):
        half = trimesh.creation.box(bounds=np.array([[-0.02, 0, low], [0, 0.4, low + 0.2]]))
        half.export(folder / f"{name}.obj")
    text, count = "", 0
    for name in ("lower", "upper"):
        lines = (folder / f"{name}.obj").read_text().splitlines()
        text += f"o {name}\n"
        for line in lines:
            if line.startswith("v "):
                text += line + "\n"
            elif line.startswith("f "):
                corners = [int(word.split("/")[0]) + count for word in line.split()[1:]]
                text += f"f {' '.join(map(str, corners))}\n"
        count += sum(line.startswith("v ") for line in lines)
        (folder / f"{name}.obj").unlink()
    (folder / "door.obj").write_text(text)


def corner(folder: Path) -> None:
    """The body as a back and a side, whose hull fills the corner between them."""
    walls = [
        trimesh.creation.box(bounds=np.array(b))
        for b in (
            [[0.15, -0.19, -0.2], [0.2, 0.2, 0.2]],
            [[-0.2, -0.2, -0.19], [0.16, -0.15, 0.19]],
        )
    ]
    trimesh.util.concatenate(walls).export(folder / "body.obj")


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
KNOB = ("(?=<collision><geometry><mesh filename=\"door)",
        '<collision><origin xyz="-0.03 0.35 0"/><geometry><mesh filename="knob.obj"/></geometry>'
        '</collision>')  # fmt: skip
PIECE = """<collision><origin xyz="-0.01 0.2 0"/><geometry><box size="0.02 0.4 0.4"/></geometry>
</collision>"""
Files = Callable[[Path], None] | None
"""What is done to the meshes."""
FAIL: dict[str, tuple[str, list[tuple[str, str]], Files]] = {
    "a_link_name_twice": ("bad_tree", [("(?=</robot>)", '<link name="body"/>')], None),
    "a_joint_end_that_nothing_has": ("bad_tree", [('<child link="door"', '<child link="Door "')],
                                       None),
    "two_roots": ("bad_tree", [("(?=</robot>)", '<link name="loose"/>')], None),
    "a_name_that_is_none": ("name_invalid", [("door\"", '2nd door"')], None),
    "a_package": ("mesh_path", [('name="door.obj', 'name="package://parts/door.obj')], None),
    "another_case": ("mesh_missing", [("door.obj", "Door.OBJ")], None),
    "another_folder": ("mesh_missing", [], moved("door.obj", "meshes/door.obj")),
    "another_format": ("mesh_missing", [("door.obj", "door.dae")], None),
    "no_collision_mesh": ("mesh_missing", [(r'(<collision>.{10}<mesh filename=")door', r"\1hull")],
                          None),
    "a_picture_elsewhere": ("texture_missing", [], picture),
    "a_corner_that_is_no_number": ("not_finite", [], nan),
    "limits_that_are_no_number": ("not_finite", [('upper="1.5"', 'upper="nan"')], None),
    "a_mirrored_mesh": ("negative_scale", [('door.obj"', 'door.obj" scale="-1 1 1"')], flipped),
    "a_type_of_another_format": ("bad_joint", [("revolute", "hinge")], None),
    "a_zero_axis": ("bad_joint", [
        ("0 0 1", "0 0 0"), ('xyz="-0.2 -0.2 0"', 'xyz="-0.2 -0.2 0" rpy="0 -1.5707963 0"'),
        ('<geometry><mesh filename="door',
         '<origin rpy="0 1.5707963 0"/><geometry><mesh filename="door'),
    ], None),
    "commas": ("bad_joint", [('"0 0 1"', '"0, 0, 1"')], None),
    "a_scale_of_one_number": ("bad_joint", [('door.obj"', 'door.obj" scale="1"')], None),
    "negative_damping": ("bad_joint", [('damping="0.2"', 'damping="-0.2"')], None),
    "follows_nobody": ("bad_joint", [MIMIC], None),
    "a_long_axis": ("axis_length", [("0 0 1", "0 0 2")], None),
    "degrees": ("limits_degrees", [('upper="1.5"', 'upper="90"')], None),
    "limits_exchanged": ("bad_limits", [('lower="0" upper="1.5"', 'lower="1.5" upper="0"')], None),
    "no_range_of_a_hinge": ("bad_limits", [('upper="1.5"', 'upper="0"')], None),
    "no_limits_of_a_slide": ("bad_limits", [SLIDE, ('lower="0" upper="0.2"', "")], None),
    "no_effort": ("effort_missing", [('effort="10"', "")], None),
    "no_mass": ("bad_inertia", [('<mass value="2"/>', '<mass value="0"/>')], None),
    "an_impossible_inertia": ("bad_inertia", [('izz="0.03"', 'izz="3"')], None),
    "no_inertial": ("no_inertia", [("<inertial><origin.*?</inertial>", "")], None),
    "a_turned_inertial": (
        "inertial_turned", [('rpy="0 0 0"/><mass', 'rpy="0 0 0.7"/><mass')], None,
    ),
    "no_collision_shape": ("no_collision", [(r"(door.obj\S+\s*)<collision>.*?</collision>", r"\1")],
                           None),
    "a_fine_hull": ("hull_points", [KNOB], ball),
    "a_hull_of_many_faces": ("hull_faces", [KNOB], coarse_ball),
    "a_face_of_many_corners": ("face_points", [KNOB], cone),
    "joint_friction": ("friction_refused", [('damping="0.2"', 'damping="0.2" friction="0.5"')],
                       None),
    "a_safety_controller": ("tag_refused", [("<dynamics", '<safety_controller k_velocity="1"/>'
                                             "<dynamics")], None),
    "another_mesh_format": ("mesh_format", [("door.obj", "door.glb")], glb),
    "two_objects_in_a_file": ("several_objects", [], two_objects),
    "a_hull_over_a_corner": ("concave_collision", [], corner),
    "seventy_pieces": ("hull_count", [(
        r'<collision><geometry><mesh filename="door.obj"/></geometry></collision>',
        PIECE * 70,
    )], None),
    "no_inertial_for_gazebo": (
        "inertial_missing", [("<inertial><origin.*?</inertial>", "")], None,
    ),
    "an_inertia_that_mujoco_refuses": (
        "inertia_impossible", [('izz="0.03"', 'izz="0.09"')], None,
    ),
    "no_friction": ("no_friction", [("<dynamics.*?/>", "")], None),
    "the_wrong_sign": ("penetration", [("0 0 1", "0 0 -1")], None),
    "parent_and_child_exchanged": ("exchanged", [
        ('<parent link="body"/><child link="door"/>', '<parent link="door"/><child link="body"/>'),
        ('<origin xyz="-0.2 -0.2 0"/><axis xyz="0 0 1"', '<axis xyz="0 0 -1"'),
        ('body.obj"/></geometry>', 'body.obj"/></geometry><origin xyz="0.2 0.2 0"/>'),
    ], None),
    "an_endless_door": (
        "penetration", [("revolute", "continuous"), ('lower="0" upper="1.5" ', "")], None,
    ),
    "too_far": ("penetration", [('upper="1.5"', 'upper="5.5"')], None),
    "a_slide_that_leaves_its_guide": ("detached", [
        SLIDE, ('upper="0.2"', 'upper="0.34"'),
        (r"(body.obj\S+\s*)<collision>.*?</collision>", r"\1"),
    ], hollow),
    "a_lid_that_falls": ("sags", [
        ("0 0 1", "0 -1 0"), ("-0.2 -0.2 0", "-0.2 -0.2 -0.2"), ("-0.01 0.2 0", "-0.01 0.2 0.2"),
        ('<geometry><mesh filename="door', '<origin xyz="0 0 0.2"/><geometry><mesh filename="door'),
        ('damping="0.2"', 'damping="0.2" friction="0.01"'),
    ], None),
    "a_hull_over_a_hollow": ("cavity_filled", [SLIDE], hollow),
}  # fmt: skip
"""Name -> the reason, what is replaced in the text, and what is done to the meshes."""


def write(name: str, folder: Path) -> Path:
    """The file that has a fault, with its meshes."""
    _, changes, files = FAIL[name]
    urdf = case(folder, *changes)
    if files is not None:
        files(folder)
    return urdf


if __name__ == "__main__":
    place = Path(sys.argv[1])
    place.mkdir(parents=True, exist_ok=True)
    for key in FAIL:
        write(key, place / f"{key}_fail")
        case(place / f"{key}_pass")
