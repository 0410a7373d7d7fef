"""What glTF files of the world use, each against its encoder or the specification's arithmetic."""

from __future__ import annotations

import base64
import json
import zlib
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image
from scipy.spatial.transform import Rotation

from mam_pipeline.errors import InputError
from mam_pipeline.formats.gltf import read_gltf
from mam_pipeline.formats.soup import FileContent
from mam_pipeline.optional import has
from mam_pipeline.types import FloatArray
from tests.pipeline.gltf_builder import Gltf

BOX = trimesh.creation.box(extents=[0.4, 0.6, 1.0]).subdivide()
POINTS = np.asarray(BOX.vertices, np.float32)
FACES = np.asarray(BOX.faces, np.uint16)
UV = np.random.default_rng(3).random((len(POINTS), 2)).astype(np.float32)


def plain(file: Gltf, points: np.ndarray = POINTS, **attributes: int) -> dict[str, Any]:
    """A primitive of the box's triangles."""
    return {
        "attributes": {"POSITION": file.add(points), **attributes},
        "indices": file.add(FACES.reshape(-1)),
    }


def corners(content: FileContent) -> FloatArray:
    return np.concatenate([p.vertices[p.faces] for p in content.pieces])


def picture(kind: str, color: tuple[int, int, int] = (200, 40, 40)) -> bytes:
    buffer = BytesIO()
    Image.new("RGB", (8, 4), color).save(buffer, format=kind, lossless=True)
    return buffer.getvalue()


def textured(file: Gltf, texture: dict[str, Any], images: list[dict[str, Any]]) -> None:
    file.doc["materials"] = [{"pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    file.doc["textures"] = [texture]
    file.doc["images"] = images
    primitive = {**plain(file, TEXCOORD_0=file.add(UV)), "material": 0}
    file.node(mesh=file.mesh(primitive))


def test_draco_gives_back_what_was_packed(tmp_path: Path) -> None:
    import DracoPy

    packed = DracoPy.encode(
        POINTS, FACES.astype(np.uint32), quantization_bits=16, preserve_order=True,
        tex_coord=UV.astype(float), create_metadata=False,
    )  # fmt: skip
    identity = {
        {0: "POSITION", 3: "TEXCOORD_0"}[a["attribute_type"]]: a["unique_id"]
        for a in DracoPy.decode(packed).attributes
    }
    file = Gltf()
    primitive = {
        "attributes": {
            "POSITION": file.accessor(POINTS, None), "TEXCOORD_0": file.accessor(UV, None),
        },
        "indices": file.accessor(FACES.reshape(-1), None),
        "extensions": {
            "KHR_draco_mesh_compression": {"bufferView": file.view(packed), "attributes": identity}
        },
    }  # fmt: skip
    file.doc["extensionsRequired"] = ["KHR_draco_mesh_compression"]
    file.node(mesh=file.mesh(primitive))
    found = read_gltf(file.save(tmp_path / "a.gltf"))
    np.testing.assert_allclose(corners(found), POINTS[FACES], atol=2e-5)
    (piece,) = found.pieces
    assert piece.uv is not None
    np.testing.assert_allclose(piece.uv[piece.faces], UV[FACES], atol=1e-6)


def test_broken_draco_is_one_sentence(tmp_path: Path) -> None:
    file = Gltf()
    told = {"bufferView": file.view(b"DRACO" + bytes(40)), "attributes": {"POSITION": 0}}
    primitive = {
        "attributes": {"POSITION": file.accessor(POINTS, None)},
        "extensions": {"KHR_draco_mesh_compression": told},
    }
    file.node(mesh=file.mesh(primitive))
    with pytest.raises(InputError, match="Draco data cannot be unpacked"):
        read_gltf(file.save(tmp_path / "a.gltf"))


@pytest.mark.skipif(not has("meshopt"), reason="needs the extra formats")
def test_meshopt_gives_back_what_was_packed(tmp_path: Path) -> None:
    import meshopt

    def packed(file: Gltf, rows: np.ndarray, mode: str, raw: np.ndarray, **told: Any) -> int:
        data = meshopt.encode_gltf_buffer(rows, mode)  # type: ignore[arg-type]
        view = file.view(b"")
        own = file.doc["bufferViews"][view]
        stride = raw.nbytes // len(raw)
        own["byteLength"], own["buffer"] = raw.nbytes, 1
        start = file.view(data)
        where = file.doc["bufferViews"].pop(start)
        own["extensions"] = {
            "EXT_meshopt_compression": {
                **where, "byteStride": stride, "count": len(raw), "mode": mode, **told,
            }
        }  # fmt: skip
        return file.accessor(raw, view)

    exact = Gltf()
    indices = FACES.reshape(-1)
    primitive = {
        "attributes": {"POSITION": packed(exact, POINTS, "ATTRIBUTES", POINTS)},
        "indices": packed(exact, indices, "TRIANGLES", indices),
    }
    exact.node(mesh=exact.mesh(primitive))
    exact.save(tmp_path / "a.gltf")
    exact.doc["buffers"].append({"byteLength": 1 << 16})
    (tmp_path / "a.gltf").write_text(json.dumps(exact.doc))
    found = corners(read_gltf(tmp_path / "a.gltf"))
    # the codec keeps triangles, but may begin each at another corner
    assert {frozenset(map(tuple, t)) for t in found.round(6)} == {
        frozenset(map(tuple, t)) for t in POINTS[FACES].astype(float).round(6)
    }
    filtered = Gltf()
    rows = meshopt.encode_filter_exp(POINTS, 16)
    primitive = {
        "attributes": {
            "POSITION": packed(filtered, rows, "ATTRIBUTES", POINTS, filter="EXPONENTIAL")
        },
        "indices": filtered.add(indices),
    }
    filtered.node(mesh=filtered.mesh(primitive))
    filtered.save(tmp_path / "b.gltf")
    filtered.doc["buffers"].append({"byteLength": 1 << 16})
    (tmp_path / "b.gltf").write_text(json.dumps(filtered.doc))
    np.testing.assert_allclose(corners(read_gltf(tmp_path / "b.gltf")), POINTS[FACES], atol=1e-4)


def test_instances_stand_where_nodes_would(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    moves = rng.normal(size=(3, 3)).astype(np.float32)
    turns = Rotation.random(3, random_state=2).as_quat().astype(np.float32)
    scales = rng.uniform(0.5, 2.0, (3, 3)).astype(np.float32)
    one, many = Gltf(), Gltf()
    frame: dict[str, Any] = {
        "translation": [1, 2, 3],
        "rotation": [0, 0, 0.6, 0.8],
        "scale": [1, 1, 2],
    }
    told = {"TRANSLATION": one.add(moves), "ROTATION": one.add(turns), "SCALE": one.add(scales)}
    one.node(
        mesh=one.mesh(plain(one)), name="leg", **frame,
        extensions={"EXT_mesh_gpu_instancing": {"attributes": told}},
    )  # fmt: skip
    mesh = many.mesh(plain(many))
    children = [
        many.node(False, mesh=mesh, translation=t.tolist(), rotation=r.tolist(), scale=s.tolist())
        for t, r, s in zip(moves, turns, scales)
    ]
    many.node(children=children, **frame)
    found = read_gltf(one.save(tmp_path / "one.gltf"))
    wanted = read_gltf(many.save(tmp_path / "many.gltf"))
    np.testing.assert_allclose(corners(found), corners(wanted), atol=1e-5)
    assert [p.group for p in found.pieces] == ["leg", "leg.001", "leg.002"]


def test_too_many_instances_are_refused_before_they_are_drawn(tmp_path: Path) -> None:
    file = Gltf()
    count = 120_000
    file.doc["bufferViews"].append({"buffer": 0, "byteOffset": 0, "byteLength": 12 * count})
    file.blob += bytes(12 * count)
    moves = file.accessor(np.zeros((count, 3), np.float32), 0)
    told = {"attributes": {"TRANSLATION": moves}}
    file.node(mesh=file.mesh(plain(file)), extensions={"EXT_mesh_gpu_instancing": told})
    with pytest.raises(InputError, match="nodes"):
        read_gltf(file.save(tmp_path / "a.gltf"))


@pytest.mark.parametrize("based", [True, False])
def test_sparse_accessors_replace_rows(tmp_path: Path, based: bool) -> None:
    file = Gltf()
    rows = np.array([1, 5, 7], np.uint16)
    values = np.array([[9, 0, 0], [0, 9, 0], [0, 0, 9]], np.float32)
    sparse = {
        "count": 3,
        "indices": {"bufferView": file.view(rows.tobytes()), "componentType": 5123},
        "values": {"bufferView": file.view(values.tobytes())},
    }
    view = file.view(POINTS.tobytes()) if based else None
    position = file.accessor(POINTS, view, sparse=sparse)
    primitive = {"attributes": {"POSITION": position}, "indices": file.add(FACES.reshape(-1))}
    file.node(mesh=file.mesh(primitive))
    wanted = POINTS.copy() if based else np.zeros_like(POINTS)
    wanted[rows] = values
    np.testing.assert_allclose(corners(read_gltf(file.save(tmp_path / "a.gltf"))), wanted[FACES])


def test_one_scene_is_read_and_the_others_are_named(tmp_path: Path) -> None:
    file = Gltf()
    mesh = file.mesh(plain(file))
    file.node(mesh=mesh, name="a")
    other = file.node(False, mesh=mesh, name="b", translation=[9, 0, 0])
    file.doc["scenes"].append({"nodes": [other], "name": "closed"})
    found = read_gltf(file.save(tmp_path / "a.gltf"))
    assert [p.group for p in found.pieces] == ["a"]
    assert found.notes == ("of 2 scenes number 0 is read, not: closed",)
    file.doc["scene"] = 1
    assert [p.group for p in read_gltf(file.save(tmp_path / "b.gltf")).pieces] == ["b"]


def test_a_skin_stands_in_the_pose_of_its_joints(tmp_path: Path) -> None:
    file = Gltf()
    rng = np.random.default_rng(5)
    joints = rng.integers(0, 2, (len(POINTS), 4)).astype(np.uint8)
    weights = rng.random((len(POINTS), 4)).astype(np.float32)
    weights /= weights.sum(axis=1, keepdims=True)
    binds = [np.eye(4), np.eye(4)]
    binds[1][:3, 3] = [0, -0.5, 0]
    inverse = np.stack([b.T.reshape(-1) for b in binds]).astype(np.float32)
    primitive = plain(file, JOINTS_0=file.add(joints), WEIGHTS_0=file.add(weights))
    turn = [0.0, 0.0, float(np.sin(0.4)), float(np.cos(0.4))]
    tip = file.node(False, translation=[0, 0.5, 0], rotation=turn)
    root = file.node(translation=[0.1, 0.2, 0.3], scale=[2, 2, 2], children=[tip])
    file.doc["skins"] = [{"joints": [root, tip], "inverseBindMatrices": file.add(inverse)}]
    file.node(mesh=file.mesh(primitive), skin=0, translation=[100, 0, 0])  # does not count
    found = corners(read_gltf(file.save(tmp_path / "a.gltf")))
    upper = np.diag([2.0, 2.0, 2.0, 1.0])
    upper[:3, 3] = [0.1, 0.2, 0.3]
    lower = np.eye(4)
    lower[:3, :3] = Rotation.from_quat(turn).as_matrix()
    lower[:3, 3] = [0, 0.5, 0]
    bones = [upper @ binds[0], upper @ lower @ binds[1]]
    wanted = np.array(
        [
            sum(w * (bones[j] @ [*p, 1.0])[:3] for j, w in zip(js, ws))
            for p, js, ws in zip(POINTS, joints, weights)
        ]
    )
    np.testing.assert_allclose(found, wanted[FACES], atol=1e-5)


def test_morph_targets_stand_at_their_weights(tmp_path: Path) -> None:
    file = Gltf()
    push = np.random.default_rng(2).normal(size=POINTS.shape).astype(np.float32)
    primitive = {**plain(file), "targets": [{"POSITION": file.add(push)}, {}]}
    mesh = file.mesh(primitive, weights=[0.25, 1.0])
    file.node(mesh=mesh)
    file.node(mesh=mesh, weights=[0.5, 0.0])
    found = corners(read_gltf(file.save(tmp_path / "a.gltf")))
    wanted = [(POINTS + w * push)[FACES] for w in (0.25, 0.5)]
    np.testing.assert_allclose(found, np.concatenate(wanted), atol=1e-6)


def test_quantised_positions_and_colours_are_shares(tmp_path: Path) -> None:
    file = Gltf()
    points = np.round(POINTS / 0.6 * 32767).astype(np.int16)
    points = np.pad(points, ((0, 0), (0, 1)))  # a row begins at a multiple of four bytes
    view = file.view(points.tobytes(), byteStride=8)
    position = file.accessor(points[:, :3], view, normalized=True)
    colors = np.random.default_rng(0).integers(0, 65535, (len(POINTS), 3)).astype(np.uint16)
    paint = file.view(np.pad(colors, ((0, 0), (0, 1))).tobytes(), byteStride=8)
    attributes = {
        "POSITION": position, "COLOR_0": file.accessor(colors, paint, normalized=True),
    }  # fmt: skip
    primitive = {"attributes": attributes, "indices": file.add(FACES.reshape(-1))}
    file.doc["extensionsRequired"] = ["KHR_mesh_quantization"]
    file.node(mesh=file.mesh(primitive), scale=[0.6, 0.6, 0.6])
    found = read_gltf(file.save(tmp_path / "a.gltf"))
    np.testing.assert_allclose(corners(found), POINTS[FACES], atol=2e-5)
    assert found.notes == ()
    painted = found.pieces[0].colors
    assert painted is not None
    np.testing.assert_array_equal(painted[:, :3], np.round(colors / 65535 * 255).astype(np.uint8))


def test_texture_transforms_turn_against_the_clock(tmp_path: Path) -> None:
    file = Gltf()
    textured(file, {"source": 0}, [{"bufferView": file.view(picture("PNG"))}])
    told = {"offset": [0.5, 0.25], "rotation": np.pi / 6, "scale": [2.0, 3.0]}
    file.doc["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["extensions"] = {
        "KHR_texture_transform": told
    }
    (piece,) = read_gltf(file.save(tmp_path / "a.gltf")).pieces
    u, v = 2.0 * UV[:, 0].astype(float), 3.0 * UV[:, 1].astype(float)
    c, s = np.cos(np.pi / 6), np.sin(np.pi / 6)
    wanted = np.stack([0.5 + c * u + s * v, 0.25 - s * u + c * v], axis=1)
    assert piece.uv is not None
    np.testing.assert_allclose(piece.uv, wanted, atol=1e-5)


@pytest.mark.parametrize(
    ("kind", "extension"), [("WEBP", "EXT_texture_webp"), ("TGA", ""), ("BMP", "")]
)
def test_other_pictures_become_png_without_loss(tmp_path: Path, kind: str, extension: str) -> None:
    file = Gltf()
    texture: dict[str, Any] = {"source": 0}
    if extension:
        texture = {"extensions": {extension: {"source": 0}}}
    textured(file, texture, [{"bufferView": file.view(picture(kind))}])
    found = read_gltf(file.save(tmp_path / "a.gltf"))
    material = found.materials[0]
    assert material.image is not None and material.image_format == "png"
    assert Image.open(BytesIO(material.image)).getpixel((0, 0)) == (200, 40, 40)
    assert found.notes == ()


# 8 x 8 texels, (200, 40, 40) on the left and (40, 40, 200) on the right
KTX2 = {
    "etc1s": "c-mX-9TK5nWU!l;ONxsD2pEBw1BzjQ5ea7iu?`SV0b&&(-T_t91*M%BAv6;MD$rqoiEA({W@KVuW=6Kd9?tp"
    "?1oA){=&bUh%#ze12B*a0%wmPmyv(xHqT<9H1tUE}1CTjP47xydoJeLfFksp(a=-<`cyy4}Ko!htNMW~N5QezZqmem*"
    "s{zc^WR_+DQY%)iTE&zA(>2M9VFrT$h~*%|sKx?vaf3pU7vljIs8t*c6Bq$|IVCm",
    "uastc": "c-mX-9TK5nWU!l;ONxsD2pEBw1BzjQ5sE<|1Bi8icnXw82M3_E0~!re%fz6;u#Az3fti_sK>)6+9?tp?1oA)"
    "{=&bUh%#ze12B*a0%wmPmyv(xHqT<9H1tUE}0|o{bkS?G$aY@#v_9u?P^^3Ez{<JqxV}|ny$O8c2UmxW",
}


@pytest.mark.skipif(not has("opengl_basisu"), reason="needs the extra formats")
@pytest.mark.parametrize("codec", sorted(KTX2))
def test_basis_textures_are_read(tmp_path: Path, codec: str) -> None:
    file = Gltf()
    view = file.view(zlib.decompress(base64.b85decode(KTX2[codec])))
    texture = {"extensions": {"KHR_texture_basisu": {"source": 0}}}
    textured(file, texture, [{"bufferView": view, "mimeType": "image/ktx2"}])
    found = read_gltf(file.save(tmp_path / "a.gltf"))
    assert found.materials[0].image is not None
    image = Image.open(BytesIO(found.materials[0].image))
    assert image.size == (8, 8)
    np.testing.assert_allclose(np.asarray(image.getpixel((0, 0))), (200, 40, 40), atol=3)
    np.testing.assert_allclose(np.asarray(image.getpixel((7, 7))), (40, 40, 200), atol=3)


def test_a_png_beside_another_format_is_taken_as_it_is(tmp_path: Path) -> None:
    file = Gltf()
    png = picture("PNG")
    texture = {"source": 1, "extensions": {"EXT_texture_webp": {"source": 0}}}
    images = [{"bufferView": file.view(picture("WEBP"))}, {"bufferView": file.view(png)}]
    textured(file, texture, images)
    assert read_gltf(file.save(tmp_path / "a.gltf")).materials[0].image == png


def test_what_is_not_taken_over_is_said(tmp_path: Path) -> None:
    file = Gltf()
    textured(file, {"source": 0}, [{"uri": "wood%20dark.png"}])
    file.doc["materials"][0]["normalTexture"] = {"index": 0}
    line = {**plain(file), "mode": 1}
    file.doc["meshes"][0]["primitives"].append(line)
    file.doc["extensionsRequired"] = ["ACME_glow"]
    found = read_gltf(file.save(tmp_path / "a.gltf"))
    said = "\n".join(found.notes)
    assert "textures not found: wood dark.png" in said
    assert "not taken over: normal maps, points and lines" in said
    assert "needs ACME_glow" in said
    assert found.materials[0].image is None


@pytest.mark.parametrize("binary", [True, False])
def test_gltf_1_is_refused_with_the_way_out(tmp_path: Path, binary: bool) -> None:
    path = tmp_path / ("old.glb" if binary else "old.gltf")
    data = b"glTF\x01\0\0\0\x14\0\0\0\0\0\0\0\0\0\0\0"
    path.write_bytes(data if binary else b'{"meshes": {"m": {}}, "asset": {"version": "1.0"}}')
    with pytest.raises(InputError, match=r"is glTF 1(\.0)?, and 2\.0 is read.*gltf-pipeline"):
        read_gltf(path)


def test_opaque_materials_ignore_alpha(tmp_path: Path) -> None:
    file = Gltf()
    file.node(mesh=file.mesh({**plain(file), "material": 0}))
    file.doc["materials"] = [{"pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 0.2]}}]
    assert read_gltf(file.save(tmp_path / "a.gltf")).materials[0].base_color[3] == 1.0
    file.doc["materials"][0]["alphaMode"] = "BLEND"
    assert read_gltf(file.save(tmp_path / "b.gltf")).materials[0].base_color[3] == 0.2
