"""Files of strangers cost bounded work: one sentence, within a second, whatever they claim."""

from __future__ import annotations

import base64
import json
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mam_pipeline.errors import InputError
from mam_pipeline.formats.mesh_files import read_file
from mam_pipeline.formats.urdf.read import read_urdf
from mam_pipeline.thresholds import MAX_LINKS

CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32)
FACES = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.uint32)


def gltf(**changes: Any) -> str:
    """A tetrahedron as glTF; `changes` replace entries of the document."""
    data = CORNERS.tobytes() + FACES.tobytes()
    primitive = {"attributes": {"POSITION": 0}, "indices": 1}
    doc: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [primitive]}],
        "buffers": [{
            "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode(),
            "byteLength": len(data),
        }],
        "bufferViews": [
            {"buffer": 0, "byteLength": 48}, {"buffer": 0, "byteOffset": 48, "byteLength": 48},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5125, "count": 12, "type": "SCALAR"},
        ],
    }  # fmt: skip
    return json.dumps(doc | changes)


def diamonds(count: int) -> list[dict[str, Any]]:
    """Nodes of which each has the next one twice: 2^count ways lead to the last."""
    return [{"children": [i + 1, i + 1]} for i in range(count)] + [{"mesh": 0}]


def accessors(**first: Any) -> list[dict[str, Any]]:
    """The accessors of `gltf`, those of the positions changed."""
    found: list[dict[str, Any]] = json.loads(gltf())["accessors"]
    return [found[0] | first, found[1]]


def collada(unit: str = "1", nodes: str = "", scene: str = "") -> str:
    return f"""<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><unit meter="{unit}"/><up_axis>Z_UP</up_axis></asset>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array id="pa" count="12">0 0 0 1 0 0 0 1 0 0 0 1</float_array>
<technique_common><accessor source="#pa" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/>
<p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles></mesh></geometry></library_geometries>
<library_nodes>{nodes}</library_nodes>
<library_visual_scenes><visual_scene id="s">{scene}<node><instance_geometry url="#g"/></node>
</visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def chained(count: int) -> str:
    """COLLADA nodes of which each instances the next one twice."""
    rows = [
        f'<node id="n{i}"><instance_node url="#n{i + 1}"/><instance_node url="#n{i + 1}"/></node>'
        for i in range(count)
    ]
    return "".join(rows) + f'<node id="n{count}"><instance_geometry url="#g"/></node>'


SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 1\n"
PLY = """ply
format ascii 1.0
element vertex {vertices}
property float x
property float y
property float z
element face {faces}
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
0 0 1
3 0 2 1
3 0 1 3
"""
HOSTILE: dict[str, tuple[Callable[[], str], str]] = {
    "diamond.gltf": (lambda: gltf(nodes=diamonds(40)), "reached twice"),
    "loop.gltf": (lambda: gltf(nodes=[{"children": [1]}, {"children": [0]}]), "reached twice"),
    "below.gltf": (lambda: gltf(nodes=[{"children": [-1]}, {"mesh": 0}]), "no entry -1"),
    "huge.gltf": (lambda: gltf(accessors=accessors(count=10**12)), "cut short"),
    "empty.gltf": (
        lambda: gltf(accessors=[accessors()[0] | {"bufferView": None}, accessors()[1]]),
        "not valid glTF",
    ),
    "nowhere.gltf": (
        lambda: gltf(accessors=[{"componentType": 5126, "count": 10**12, "type": "VEC3"}]),
        "has no data",
    ),
    "before.gltf": (lambda: gltf(accessors=accessors(byteOffset=-4)), "out of place"),
    "flat.gltf": (lambda: gltf(accessors=accessors(type="VEC2")), "is of type 'VEC2'"),
    "many.gltf": (
        lambda: gltf(
            scenes=[{"nodes": list(range(100_001))}], nodes=[{"mesh": 0}] * 100_001
        ),
        "simplify it",
    ),
    "short.obj": (lambda: SQUARE + "v 1 2\nf 1 2 3\n", "line 5"),
    "index.obj": (lambda: SQUARE + "f 1 2 9\n", "line 5"),
    "short_mtl.obj": (lambda: SQUARE + "mtllib\nf 1 2 3\n", "line 5"),
    "few.ply": (lambda: PLY.format(vertices=4, faces=4), "cut short"),
    "many.ply": (lambda: PLY.format(vertices=10**12, faces=2), "cut short"),
    "below.ply": (lambda: PLY.format(vertices=-4, faces=2), "no element"),
    "text.ply": (lambda: PLY.format(vertices="four", faces=2), "no element"),
    "many.stl": (lambda: "solid\n" + "vertex\n" * 9_100_000, "simplify it"),
    "many.off": (lambda: "OFF\n4000000000 1 0\n0 0 0\n", "simplify it"),
    "unit_text.dae": (lambda: collada("centimetre"), "no length"),
    "unit_zero.dae": (lambda: collada("0"), "no length"),
    "unit_nan.dae": (lambda: collada("nan"), "no length"),
    "diamond.dae": (
        lambda: collada(nodes=chained(40), scene='<node><instance_node url="#n0"/></node>'),
        "simplify it",
    ),
    "loop.dae": (
        lambda: collada(nodes='<node id="a"><instance_node url="#a"/></node>',
                        scene='<node><instance_node url="#a"/></node>'),
        "draws itself",
    ),
    "entities.dae": (
        lambda: '<!DOCTYPE a [<!ENTITY b "c">]>' + collada(), "DOCTYPE or entity"
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_mesh_is_refused_in_a_sentence_at_once(tmp_path: Path, name: str) -> None:
    text, said = HOSTILE[name]
    file = tmp_path / name
    file.write_text(text())
    began = time.process_time()
    with pytest.raises(InputError, match=said) as caught:
        read_file(file)
    assert time.process_time() - began < 5.0
    assert str(file) in str(caught.value) and "\n" not in str(caught.value)


def test_the_files_that_the_hostile_ones_are_made_of_can_be_read(tmp_path: Path) -> None:
    good = {"a.gltf": gltf(), "a.dae": collada("0.01"), "a.ply": PLY.format(vertices=4, faces=2)}
    for name, text in good.items():
        (tmp_path / name).write_text(text)
        content = read_file(tmp_path / name)
        assert sum(len(p.faces) for p in content.pieces) in (2, 4)
    assert read_file(tmp_path / "a.dae").metres_per_unit == 0.01


def test_texture_coordinates_of_an_obj_may_be_mixed_and_short(tmp_path: Path) -> None:
    file = tmp_path / "a.obj"
    file.write_text(SQUARE + "vt 0.5\nvt 0.25 0.75\nf 1/1 2/2 3\nf 1 3 4\n")
    (piece,) = read_file(file).pieces
    assert piece.uv is not None
    found = {tuple(np.round(row, 6)) for row in piece.uv.tolist()}
    assert found == {(0.5, 1.0), (0.25, 0.25), (0.0, 0.0)}


def test_colours_and_pictures_of_a_file_are_made_sound(tmp_path: Path) -> None:
    (tmp_path / "a.mtl").write_text("newmtl m\nKd nan 7 -1\nd inf\nPm 9\nmap_Kd a.png\n")
    (tmp_path / "a.png").write_bytes(b"\x89PNG\r\n\x1a\n and no more")
    (tmp_path / "a.obj").write_text("mtllib a.mtl\nusemtl m\n" + SQUARE + "f 1 2 3\nf 1 3 4\n")
    (material,) = read_file(tmp_path / "a.obj").materials
    assert material.base_color == (0.7, 1.0, 0.0, 1.0)
    assert material.metallic == 1.0 and material.image is None


BOX = '<visual><geometry><box size="1 1 1"/></geometry></visual>'
JOINT = """<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/>
<axis xyz="0 0 1"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint>"""


def urdf(*joints: tuple[str, str, str, str], shape: str = BOX, links: int = 3) -> str:
    rows = [f'<link name="l{i}">{shape}</link>' for i in range(links)]
    return f'<robot name="r">{"".join(rows)}{"".join(JOINT.format(*j) for j in joints)}</robot>'


TWO = (("a", "revolute", "l0", "l1"), ("b", "revolute", "l0", "l2"))
HOSTILE_URDF = {
    "links": (
        urdf(*((f"j{i}", "revolute", "l0", f"l{i}") for i in range(1, 2000)), links=2000),
        f"the most is {MAX_LINKS}",
    ),
    "diamonds": (
        urdf(*((f"j{i}{s}", "fixed", f"l{i}", f"l{i + 1}") for i in range(40) for s in "ab"),
             links=41),
        "child of two joints",
    ),
    "loop": (
        urdf(("a", "revolute", "l0", "l1"), ("b", "fixed", "l2", "l3"), ("c", "fixed", "l3", "l2"),
             links=4),
        "form a loop",
    ),
    "missing": (urdf(("a", "revolute", "l0", "door")), "'door', which is missing"),
    "box": (urdf(*TWO, shape=BOX.replace("1 1 1", "1")), "should be 3 numbers"),
    "huge": (urdf(*TWO, shape=BOX.replace("1 1 1", "1 1e300 1")), "absurdly large"),
    "text": (urdf(*TWO, shape=BOX.replace("1 1 1", "1 1 wide")), "is no number"),
    "scale": (
        urdf(*TWO, shape=BOX.replace('<box size="1 1 1"/>', '<mesh filename="a" scale="1 2"/>')),
        "should be 1 or 3 numbers",
    ),
    "radius": (
        urdf(*TWO, shape=BOX.replace('<box size="1 1 1"/>', '<sphere radius="-1"/>')),
        "is negative",
    ),
    "limit": (urdf(*TWO).replace('upper="1"', 'upper="nan"'), "is not finite"),
    "point": (urdf(*TWO, shape=BOX.replace("1 1 1", "0 0 0")), "no extent"),
    "flat": (urdf(*TWO, shape=BOX.replace("1 1 1", "1 1 0")), "is flat"),
    "entities": ('<!DOCTYPE a [<!ENTITY b "c">]>' + urdf(*TWO), "DOCTYPE or entity"),
}  # fmt: skip


@pytest.mark.parametrize("name", HOSTILE_URDF)
def test_a_hostile_urdf_is_refused_in_a_sentence_at_once(tmp_path: Path, name: str) -> None:
    text, said = HOSTILE_URDF[name]
    file = tmp_path / "a.urdf"
    file.write_text(text)
    began = time.process_time()
    with pytest.raises(InputError, match=said) as caught:
        read_urdf(file)
    assert time.process_time() - began < 2.0
    assert str(file) in str(caught.value) and "\n" not in str(caught.value)


def test_a_mesh_that_many_links_show_is_read_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.obj").write_text(SQUARE + "f 1 2 3\nf 1 3 4\n")
    shape = BOX.replace('<box size="1 1 1"/>', '<mesh filename="a.obj" scale="2"/>')
    (tmp_path / "a.urdf").write_text(urdf(*TWO, shape=shape))
    read: list[Path] = []

    def counted(file: Path, root: Path) -> Any:
        read.append(file)
        return read_file(file, root)

    monkeypatch.setattr("mam_pipeline.formats.urdf.read.read_file", counted)
    articulation = read_urdf(tmp_path / "a.urdf")
    assert len(read) == 1 and len(articulation.mesh.faces) == 6
    assert np.isclose(np.ptp(articulation.mesh.vertices[:, 0]), 2.0)  # one number scales all axes


def test_a_hinge_of_a_hundred_turns_turns_without_end(tmp_path: Path) -> None:
    """Its way would be cut into as many steps as it has degrees."""
    (tmp_path / "a.urdf").write_text(urdf(*TWO).replace('upper="1"', 'upper="1e30"', 1))
    one, other = read_urdf(tmp_path / "a.urdf").joints
    assert (one.type, one.upper) == ("continuous", np.inf)
    assert (other.type, other.upper) == ("revolute", 1.0)
