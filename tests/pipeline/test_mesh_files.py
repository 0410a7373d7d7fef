"""Mesh files keep their faces, texture coordinates and image bytes; bad files get one sentence."""

from __future__ import annotations

import base64
import json
from io import BytesIO
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
import trimesh
from PIL import Image

from mam_pipeline.errors import ConfigError, InputError
from mam_pipeline.formats.mesh_files import load_mesh, save_glb, save_obj
from mam_pipeline.types import Material, Mesh


def png(color: tuple[int, int, int], kind: str = "PNG") -> bytes:
    buffer = BytesIO()
    Image.new("RGB", (4, 4), color).save(buffer, format=kind)
    return buffer.getvalue()


def textured_box() -> Mesh:
    """Two boxes, two groups, two textures, UVs that no short decimal can hold."""
    one = trimesh.creation.box(extents=[0.4, 0.5, 0.8])
    two = trimesh.creation.box(extents=[0.1, 0.2, 0.1])
    two.apply_translation([-0.3, 0, 0.1])
    vertices = np.concatenate([one.vertices, two.vertices])
    faces = np.concatenate([one.faces, two.faces + len(one.vertices)])
    uv = np.random.default_rng(0).random((len(vertices), 2)).astype(np.float32)
    return Mesh(
        vertices=vertices,
        faces=faces,
        materials=(
            Material("wood", (1, 1, 1, 1), png((200, 100, 10)), "png"),
            Material("steel", (0.5, 0.25, 0.75, 1), png((9, 8, 7), "JPEG"), "jpeg", 0.5, 0.25),
        ),
        face_material=np.repeat([0, 1], [12, 12]),
        uv=uv,
        face_group=np.repeat([0, 1], [12, 12]),
        group_names=("body", "knob"),
    )


def corners(mesh: Mesh) -> np.ndarray:
    return mesh.vertices[mesh.faces]


def test_glb_round_trip_keeps_uv_bits_and_image_bytes(tmp_path: Path) -> None:
    mesh = textured_box()
    save_glb(mesh, tmp_path / "a.glb")
    loaded = load_mesh(tmp_path / "a.glb")
    back = loaded.mesh
    assert back.uv is not None and mesh.uv is not None
    np.testing.assert_array_equal(back.uv[back.faces], mesh.uv[mesh.faces])
    assert [m.image for m in back.materials[:2]] == [m.image for m in mesh.materials]
    assert back.materials[1].base_color == (0.5, 0.25, 0.75, 1.0)
    assert back.group_names == ("body", "knob")
    shift = np.array([0.5 * (back.bounds - mesh.bounds).sum(axis=0)[0], 0, 0.4])
    np.testing.assert_allclose(corners(back), corners(mesh) + shift, atol=1e-7)
    assert loaded.metres_per_unit == 1.0 and loaded.metres_per_unit_source == "read from the file"


def test_obj_round_trip_keeps_uv_bits_and_image_bytes(tmp_path: Path) -> None:
    mesh = textured_box()
    save_obj(mesh, tmp_path / "a.obj")
    back = load_mesh(tmp_path / "a.obj", up="z").mesh
    assert back.uv is not None and mesh.uv is not None
    np.testing.assert_array_equal(back.uv[back.faces], mesh.uv[mesh.faces])
    assert {m.image for m in back.materials} == {m.image for m in mesh.materials}
    assert back.group_names == ("body", "knob")


def test_vertex_colours_survive_in_glb_and_ply(tmp_path: Path) -> None:
    box = trimesh.creation.box()
    colors = np.random.default_rng(1).integers(0, 255, (8, 4), dtype=np.uint8)
    mesh = Mesh(box.vertices, box.faces, colors=colors)
    save_glb(mesh, tmp_path / "a.glb")
    back = load_mesh(tmp_path / "a.glb").mesh
    assert back.colors is not None
    np.testing.assert_array_equal(back.colors[back.faces], colors[mesh.faces])
    box.visual.vertex_colors = colors
    box.export(tmp_path / "a.ply")
    back = load_mesh(tmp_path / "a.ply").mesh
    assert back.colors is not None
    np.testing.assert_array_equal(back.colors[back.faces], colors[mesh.faces])


@pytest.mark.parametrize("suffix", ["glb", "obj", "ply", "stl", "off", "dae", "gltf"])
def test_every_format_gives_the_same_box_standing_on_the_floor(tmp_path: Path, suffix: str) -> None:
    box = trimesh.creation.box(extents=[0.3, 0.5, 0.9])
    file = tmp_path / f"box.{suffix}"
    if suffix == "gltf":
        for name, data in trimesh.exchange.gltf.export_gltf(trimesh.Scene(box)).items():
            (tmp_path / name.replace("model.gltf", "box.gltf")).write_bytes(data)
    else:
        box.export(file)
    loaded = load_mesh(file, up="z")
    low, high = loaded.mesh.bounds
    np.testing.assert_allclose(low, [-0.15, -0.25, 0.0], atol=1e-6)
    np.testing.assert_allclose(high, [0.15, 0.25, 0.9], atol=1e-6)
    assert len(loaded.mesh.faces) == 12
    source = cast(trimesh.Trimesh, trimesh.load(file, process=False, force="mesh")).vertices
    m = loaded.source_to_asset
    moved = source @ m[:3, :3].T + m[:3, 3]
    target = box.triangles.reshape(-1, 3) + np.array([0, 0, 0.45])
    np.testing.assert_allclose(moved.min(0), target.min(0), atol=1e-6)
    np.testing.assert_allclose(moved.max(0), target.max(0), atol=1e-6)


def test_gltf_is_y_up_and_nodes_carry_their_transforms(tmp_path: Path) -> None:
    box = trimesh.creation.box(extents=[1, 2, 3])
    scene = trimesh.Scene()
    scene.add_geometry(box, node_name="a", transform=trimesh.transformations.scale_matrix(0.1))
    scene.export(tmp_path / "a.glb")
    loaded = load_mesh(tmp_path / "a.glb")
    np.testing.assert_allclose(np.ptp(loaded.mesh.bounds, axis=0), [0.1, 0.3, 0.2], atol=1e-7)


def test_nothing_is_welded(tmp_path: Path) -> None:
    box = trimesh.creation.box()
    soup = trimesh.Trimesh(
        box.triangles.reshape(-1, 3), np.arange(36).reshape(-1, 3), process=False
    )
    soup.export(tmp_path / "a.glb")
    assert len(load_mesh(tmp_path / "a.glb").mesh.vertices) == 36


@pytest.mark.parametrize(
    ("size", "unit", "word"),
    [(0.8, 1.0, "plausible"), (800.0, 0.001, "millimetres"), (180.0, 0.001, "millimetres")],
)
def test_scale_is_guessed_from_the_size_and_said_so(
    tmp_path: Path, size: float, unit: float, word: str
) -> None:
    trimesh.creation.box(extents=[size / 2, size / 2, size]).export(tmp_path / "a.stl")
    loaded = load_mesh(tmp_path / "a.stl")
    assert loaded.metres_per_unit == unit
    assert word in loaded.metres_per_unit_source
    assert word in loaded.decisions[1].told()


def test_height_and_scale_settle_the_size(tmp_path: Path) -> None:
    trimesh.creation.box(extents=[1, 1, 4]).export(tmp_path / "a.stl")
    assert load_mesh(tmp_path / "a.stl", height=2.0).mesh.bounds[1, 2] == pytest.approx(2.0)
    assert load_mesh(tmp_path / "a.stl", scale=0.1).metres_per_unit == 0.1
    with pytest.raises(ConfigError, match="not both"):
        load_mesh(tmp_path / "a.stl", height=2.0, scale=0.1)
    with pytest.raises(ConfigError, match="positive"):
        load_mesh(tmp_path / "a.stl", height=-2.0)


def test_up_axis_is_seen_from_where_the_floor_is(tmp_path: Path) -> None:
    legs = [trimesh.creation.box(extents=[0.05, 0.05, 0.7]) for _ in range(4)]
    for leg, (x, y) in zip(legs, [(-0.4, -0.3), (0.4, -0.3), (-0.4, 0.3), (0.4, 0.3)]):
        leg.apply_translation([x, y, 0.35])
    top = trimesh.creation.box(extents=[0.9, 0.7, 0.03])
    top.apply_translation([0, 0, 0.715])
    table: Any = trimesh.util.concatenate([*legs, top])
    table.export(tmp_path / "z.obj")
    table.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, [1, 0, 0]))
    table.export(tmp_path / "y.stl")
    for name in ("z.obj", "y.stl"):
        height = load_mesh(tmp_path / name).mesh.bounds[1, 2]
        assert height == pytest.approx(0.73, abs=1e-6), name


def flat_sheet() -> trimesh.Trimesh:
    return trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], process=False)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("none.glb", None, "no file at"),
        ("empty.glb", b"", "is empty"),
        ("text.glb", b"hello, I am a letter", "not a glTF file"),
        ("letter.txt", b"hello", "not a mesh file"),
        ("page.obj", b"<html>\n</html>\n", "has no faces"),
        ("bad.obj", b"v 0 0 zero\n", "line 1: not valid OBJ"),
        ("far.obj", b"v 0 0 0\nf 1 2 3\n", "line 2: not valid OBJ"),
        ("bad.stl", b"solid nothing", "has no faces"),
        (
            "long.obj",
            b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 " + b"9" * 22 + b" 3\n",
            "line 4: not valid OBJ",
        ),
        ("huge.obj", b"v 1e12 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\n", "absurdly large"),
        ("nan.obj", b"v nan 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\n", "not finite"),
        ("line.obj", b"v 0 0 0\nv 1 1 1\nv 2 2 2\nf 1 2 3\n", "lie on one line"),
        ("dot.obj", b"v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n", "no extent"),
        ("flat.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "is flat"),
        ("cut.glb", b"glTF\x02\0\0\0\xff\xff\0\0", "cut short"),
    ],
)
def test_bad_files_get_one_sentence(
    tmp_path: Path, name: str, content: bytes | None, words: str
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=words) as error:
        load_mesh(tmp_path / name)
    assert "\n" not in str(error.value)


def gltf_with(buffer: dict[str, object]) -> bytes:
    accessor = {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"}
    return json.dumps(
        {
            "asset": {"version": "2.0"},
            "nodes": [{"mesh": 0}],
            "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
            "accessors": [accessor],
            "bufferViews": [{"buffer": 0, "byteLength": 36}],
            "buffers": [buffer],
        }
    ).encode()


def test_gltf_reaches_no_file_outside_its_folder(tmp_path: Path) -> None:
    inner = tmp_path / "inner"
    inner.mkdir()
    (tmp_path / "secret.bin").write_bytes(bytes(36))
    for uri in ("../secret.bin", "%2e%2e/secret.bin", str(tmp_path / "secret.bin")):
        (inner / "a.gltf").write_bytes(gltf_with({"uri": uri, "byteLength": 36}))
        with pytest.raises(InputError, match="outside its folder"):
            load_mesh(inner / "a.gltf")


def test_gltf_with_a_short_buffer_is_refused(tmp_path: Path) -> None:
    data = "data:application/octet-stream;base64," + base64.b64encode(bytes(12)).decode()
    (tmp_path / "a.gltf").write_bytes(gltf_with({"uri": data, "byteLength": 36}))
    with pytest.raises(InputError, match="cut short"):
        load_mesh(tmp_path / "a.gltf")


def test_a_ply_whose_texture_is_missing_says_so_and_shows_no_stack_trace(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    data = trimesh.exchange.ply.export_ply(trimesh.creation.box())
    file = tmp_path / "a.ply"
    file.write_bytes(data.replace(b"comment", b"comment TextureFile wood.png\ncomment", 1))
    assert any("'wood.png', which was not found" in note for note in load_mesh(file).notes)
    assert not caplog.records and "Traceback" not in capfd.readouterr().err
