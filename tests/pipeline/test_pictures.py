"""Textures are found the way exporters scatter them, and never outside the model's folder tree."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path

import pytest
from PIL import Image

from mam_pipeline.formats.mesh_files import load_mesh, read_file
from mam_pipeline.formats.pictures import find, model_door

OBJ = "mtllib {mtl}\nusemtl wood\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n" + "".join(
    f"f {a} {b} {c}\n" for a, b, c in ((1, 3, 2), (1, 2, 4), (1, 4, 3), (2, 3, 4))
)
DAE = """<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="0.01" name="centimeter"/><up_axis>Z_UP</up_axis></asset>
{images}
<library_effects><effect id="e"><profile_COMMON>
{params}<technique sid="t"><lambert><diffuse>{diffuse}</diffuse></lambert></technique>
</profile_COMMON></effect></library_effects>
<library_materials><material id="m" name="wood"><instance_effect url="#e"/></material>
</library_materials>
<library_geometries><geometry id="g" name="g"><mesh>
<source id="p"><float_array id="pa" count="12">0 0 0 10 0 0 0 20 0 0 0 30</float_array>
<technique_common><accessor source="#pa" count="4" stride="3">
<param name="X" type="float"/><param name="Y" type="float"/><param name="Z" type="float"/>
</accessor></technique_common></source>
<source id="t"><float_array id="ta" count="6">0 0 1 0 0 1</float_array>
<technique_common><accessor source="#ta" count="3" stride="2">
<param name="S" type="float"/><param name="T" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="4" material="wood"><input semantic="VERTEX" source="#v" offset="0"/>
<input semantic="TEXCOORD" source="#t" offset="1" set="0"/>
<p>0 0 2 1 1 2 0 0 1 1 3 2 0 0 3 1 2 2 1 0 2 1 3 2</p></triangles>
</mesh></geometry></library_geometries>
{library}
<library_visual_scenes><visual_scene id="s">
{nodes}
</visual_scene></library_visual_scenes><scene><instance_visual_scene url="#s"/></scene>
</COLLADA>"""
BIND = (
    "<bind_material><technique_common><instance_material symbol='wood' target='#m'/>"
    "</technique_common></bind_material>"
)
NODES = f"""<node id="n0" name="box"><translate>1 2 3</translate>
<node id="n1" name="lid"><matrix>0 -1 0 5 1 0 0 0 0 0 1 0 0 0 0 1</matrix>
<instance_geometry url="#g">{BIND}</instance_geometry></node>
<instance_geometry url="#g">{BIND}</instance_geometry></node>"""


def png(path: Path, color: tuple[int, int, int] = (1, 2, 3)) -> bytes:
    path.parent.mkdir(parents=True, exist_ok=True)
    buffer = BytesIO()
    Image.new("RGB", (2, 2), color).save(buffer, format="PNG")
    path.write_bytes(buffer.getvalue())
    return buffer.getvalue()


def dae(name: str | None, nodes: str = NODES, library: str = "") -> str:
    """A Collada file of two tetrahedra, textured by a picture of that name."""
    if name is None:
        return DAE.format(
            images="", params="", diffuse="<color>1 0 0 1</color>", nodes=nodes, library=library
        )
    return DAE.format(
        images=f'<library_images><image id="i"><init_from>{name}</init_from></image>'
        "</library_images>",
        params='<newparam sid="f"><surface type="2D"><init_from>i</init_from></surface></newparam>'
        '<newparam sid="a"><sampler2D><source>f</source></sampler2D></newparam>',
        diffuse='<texture texture="a" texcoord="UVMap"/>',
        nodes=nodes,
        library=library,
    )


@pytest.mark.parametrize(
    ("name", "where"),
    [
        ("wood.png", "model/meshes/wood.png"),
        ("../materials/textures/wood.png", "model/materials/textures/wood.png"),
        ("wood.png", "model/materials/textures/wood.png"),
        ("wood.png", "model/wood.png"),
        ("wood.png", "model/textures/wood.png"),
        ("wood.png", "model/meshes/textures/wood.png"),
        ("WOOD.PNG", "model/meshes/Wood.png"),
        ("Textures/wood.png", "model/meshes/textures/wood.png"),
        ("dark%20wood.png", "model/meshes/dark wood.png"),
        ("dark%20wood.png", "model/meshes/dark%20wood.png"),
        ("tex\\wood.png", "model/meshes/tex/wood.png"),
        ("C:\\Users\\me\\tex\\wood.png", "model/meshes/tex/wood.png"),
        ("file:///C:/Users/me/Desktop/wood.png", "model/meshes/wood.png"),
        ("file:///home/me/wood.png", "model/textures/wood.png"),
        ("/home/me/maps/wood.png", "model/maps/wood.png"),
        ("./wood.png", "model/meshes/wood.png"),
        ("Holz%C3%BC.png", "model/meshes/Holzü.png"),
    ],
)
def test_a_picture_is_found(tmp_path: Path, name: str, where: str) -> None:
    png(tmp_path / where)
    by = tmp_path / "model" / "meshes" / "a.dae"
    by.parent.mkdir(parents=True, exist_ok=True)
    assert find(name, by, model_door(by)) == (tmp_path / where).resolve()


@pytest.mark.parametrize(
    "name", ["../../secret.png", "/etc/hostname", "%2e%2e/%2e%2e/secret.png", "link.png", "a\0b"]
)
def test_no_picture_outside_the_tree_is_opened(tmp_path: Path, name: str) -> None:
    secret = tmp_path / "secret.png"
    png(secret)
    folder = tmp_path / "model" / "meshes"
    folder.mkdir(parents=True)
    (folder / "link.png").symlink_to(secret)
    assert find(name, folder / "a.dae", model_door(folder / "a.dae")) is None


def test_a_collada_texture_one_folder_up_is_taken_as_it_is(tmp_path: Path) -> None:
    data = png(tmp_path / "materials" / "textures" / "wood.png")
    file = tmp_path / "meshes" / "a.dae"
    file.parent.mkdir()
    file.write_text(dae("../materials/textures/wood.png"))
    loaded = load_mesh(file)
    assert data in [m.image for m in loaded.mesh.materials]
    assert not any("texture" in note for note in loaded.notes)


def test_a_missing_texture_is_named(tmp_path: Path) -> None:
    file = tmp_path / "a.dae"
    file.write_text(dae("../textures/wood.png"))
    (note,) = [n for n in load_mesh(file).notes if "texture" in n]
    assert note.startswith("textures not found: wood.png; put them beside a.dae")


def test_a_broken_texture_is_named(tmp_path: Path) -> None:
    (tmp_path / "wood.tga").write_bytes(b"no picture at all")
    file = tmp_path / "a.dae"
    file.write_text(dae("wood.tga"))
    (note,) = [n for n in load_mesh(file).notes if "texture" in n]
    assert note.startswith("textures left out, they cannot be read: wood.tga (")


def test_the_only_colour_picture_of_a_gazebo_model_is_taken(tmp_path: Path) -> None:
    folder = tmp_path / "materials" / "textures"
    data = png(folder / "Bin_Diffuse.png")
    png(folder / "Bin_Spec.png")
    file = tmp_path / "meshes" / "bin.dae"
    file.parent.mkdir()
    file.write_text(dae(None))
    content = read_file(file)
    assert {content.materials[p.material].image for p in content.pieces} == {data}
    assert content.notes == ("the file names no texture; Bin_Diffuse.png beside it is taken",)
    png(folder / "Lid_Diffuse.png")
    assert {m.image for m in read_file(file).materials} == {None}


@pytest.mark.parametrize(
    ("mtl", "line", "picture"),
    [
        ("a.mtl", "map_Kd wood.png", "wood.png"),
        ("my materials.mtl", "map_Kd dark wood.png", "dark wood.png"),
        ("mats/a.mtl", "map_Kd -s 1 1 1 -o 0 0 0 wood.png", "mats/wood.png"),
        ("a.mtl", "map_kd tex\\wood.png", "tex/wood.png"),
        ("a.mtl", "map_Kd \tC:\\x\\wood.png", "textures/wood.png"),
    ],
)
def test_obj_materials_are_found(tmp_path: Path, mtl: str, line: str, picture: str) -> None:
    data = png(tmp_path / picture)
    library = tmp_path / mtl
    library.parent.mkdir(exist_ok=True)
    library.write_text(f"newmtl wood\nKd 0 0 0\n{line}\n")
    (tmp_path / "a.obj").write_text(OBJ.format(mtl=mtl))
    content = read_file(tmp_path / "a.obj")
    assert content.materials[0].image == data
    assert content.materials[0].base_color == (1.0, 1.0, 1.0, 1.0)
    assert content.notes == ()


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "gb18030", "cp1252"])
def test_obj_names_in_any_encoding(tmp_path: Path, encoding: str) -> None:
    name = "Schublade groß" if encoding == "cp1252" else "抽屉 1"
    data = png(tmp_path / f"{name}.png")
    text = "# x\n" + OBJ.format(mtl="a.mtl").replace("usemtl wood", f"g {name}\nusemtl {name}")
    (tmp_path / "a.obj").write_bytes(text.encode(encoding))
    (tmp_path / "a.mtl").write_bytes(f"newmtl {name}\nmap_Kd {name}.png\n".encode(encoding))
    content = read_file(tmp_path / "a.obj")
    assert content.materials[0].image == data
    assert {p.group for p in content.pieces} == {name}


def test_obj_says_what_it_misses(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text(OBJ.format(mtl="gone.mtl") + "l 1 2\np 1\n")
    notes = read_file(tmp_path / "a.obj").notes
    assert notes == (
        "material files not found: gone.mtl; the colours are lost",
        "not taken over: lines, points",
    )


def test_several_material_libraries_on_a_line(tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_text("newmtl steel\nKd 0 1 0\n")
    (tmp_path / "b.mtl").write_text("newmtl wood\nKd 1 0 0\nd 0.5\n")
    (tmp_path / "a.obj").write_text(OBJ.format(mtl="a.mtl b.mtl"))
    assert read_file(tmp_path / "a.obj").materials[0].base_color == (1.0, 0.0, 0.0, 0.5)
