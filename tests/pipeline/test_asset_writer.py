"""The asset folder: complete, movable, the same kinematics and appearance as what went in."""

from __future__ import annotations

import re
import shutil
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
import trimesh
import yourdfpy
from PIL import Image

from mam_pipeline.asset.card import Asset, CardJoint
from mam_pipeline.asset.inertia import link_inertials
from mam_pipeline.asset.read import read_asset
from mam_pipeline.asset.visuals import baked
from mam_pipeline.asset.writer import write_asset
from mam_pipeline.errors import InputError, NotPhysicalError
from mam_pipeline.formats.mesh_files import load_mesh, read_file, save_glb, save_obj
from mam_pipeline.types import Articulation, Joint, Link, Material, Mesh, RangeBasis


def _png() -> bytes:
    out = BytesIO()
    Image.new("RGB", (2, 2), "tan").save(out, format="PNG")
    return out.getvalue()


PNG = _png()


def box(low: list[float], high: list[float]) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[low, high])


def cabinet(**changes: Any) -> Articulation:
    """A carcass of five boards, a door hinged on its left, and a drawer with a bar handle."""
    carcass = [
        box([0, -0.3, 0], [0.4, -0.28, 0.8]),
        box([0, 0.28, 0], [0.4, 0.3, 0.8]),
        box([0.38, -0.28, 0.02], [0.4, 0.28, 0.78]),
        box([0, -0.28, 0], [0.4, 0.28, 0.02]),
        box([0, -0.28, 0.78], [0.4, 0.28, 0.8]),
    ]
    door = [
        box([-0.02, -0.3, 0.0], [-0.001, 0.3, 0.5]),
        box([-0.05, 0.24, 0.2], [-0.03, 0.26, 0.3]),
    ]
    door += [
        box([-0.03, 0.24, 0.2], [-0.02, 0.26, 0.22]),
        box([-0.03, 0.24, 0.28], [-0.02, 0.26, 0.3]),
    ]
    drawer = [
        box([-0.02, -0.3, 0.51], [-0.001, 0.3, 0.79]),
        box([0, -0.27, 0.55], [0.35, -0.255, 0.7]),
        box([0, 0.255, 0.55], [0.35, 0.27, 0.7]),
        box([0, -0.27, 0.54], [0.35, 0.27, 0.55]),
        box([0.335, -0.255, 0.55], [0.35, 0.255, 0.7]),
        box([-0.05, -0.06, 0.65], [-0.02, -0.05, 0.66]),
        box([-0.05, 0.05, 0.65], [-0.02, 0.06, 0.66]),
        box([-0.06, -0.06, 0.65], [-0.05, 0.06, 0.66]),
    ]
    solids = [carcass, door, drawer]
    whole: Any = trimesh.util.concatenate([trimesh.util.concatenate(s) for s in solids])
    counts = [12 * len(s) for s in solids]
    label = np.repeat([0, 1, 2], counts)
    uv = np.random.default_rng(3).random((len(whole.vertices), 2)).astype(np.float32)
    image = Material("wood", (1, 1, 1, 1), PNG, "png")
    mesh = Mesh(whole.vertices, whole.faces, (image,), uv=uv)
    names = ("body", "door", "drawer")
    links = tuple(Link(n, n, np.flatnonzero(label == i)) for i, n in enumerate(names))
    z = np.array([0.0, 0, 1])
    hinge = Joint("door_hinge", "revolute", "hinge", 0, 1, z, np.array([-0.001, -0.3, 0.25]),
                  0.0, 1.5, 0.0, 1.5)  # fmt: skip
    slide = Joint("drawer_slide", "prismatic", "slide", 0, 2, np.array([-1.0, 0, 0]),
                  np.array([0.15, 0, 0.65]), 0.0, 0.25, 0.0, 0.25)  # fmt: skip
    return Articulation(mesh, links, (replace(hinge, **changes), slide))


def test_same_forward_kinematics_read_by_yourdfpy(tmp_path: Path) -> None:
    truth = cabinet()
    asset = write_asset(truth, tmp_path / "a", name="a")
    robot = yourdfpy.URDF.load(str(asset.urdf_path))
    values = {"door_hinge": 0.7, "drawer_slide": 0.2}
    robot.update_cfg(values)
    poses = truth.link_poses(values)
    scene = robot.scene
    for i, link in enumerate(truth.links):
        expected = truth.mesh.submesh(link.faces).transformed(poses[i]).bounds
        corners = []
        for node in scene.graph.nodes_geometry:
            matrix, name = scene.graph[node]
            if link.name in scene.graph.transforms.parents.get(node, "") or _under(
                scene, node, link.name
            ):
                corners.append(trimesh.transform_points(scene.geometry[name].vertices, matrix))
        points = np.concatenate(corners)
        np.testing.assert_allclose([points.min(0), points.max(0)], expected, atol=1e-6)


def _under(scene: trimesh.Scene, node: str, link: str) -> bool:
    parents = scene.graph.transforms.parents
    while node in parents:
        node = parents[node]
        if node in ("body", "door", "drawer"):
            return node == link
    return False


@pytest.mark.parametrize("format", ["obj", "glb"])
def test_texture_bytes_and_uvs_are_the_source_s(
    tmp_path: Path, format: Literal["obj", "glb"]
) -> None:
    truth = cabinet()
    asset = write_asset(truth, tmp_path / "a", name="a", visuals=format)
    assert truth.mesh.uv is not None
    expected = np.concatenate([truth.mesh.uv[truth.mesh.faces[link.faces]] for link in truth.links])
    found = []
    for file in sorted((asset.folder / "visual").glob(f"*.{format}")):
        for piece in read_file(file).pieces:
            assert piece.uv is not None
            found.append(piece.uv[piece.faces])
        assert read_file(file).materials[0].image == PNG
    got = np.concatenate(found).reshape(-1, 6)
    order = [np.lexsort(x.T) for x in (got, expected.reshape(-1, 6))]
    np.testing.assert_array_equal(got[order[0]], expected.reshape(-1, 6)[order[1]])


def test_what_is_fixed_to_a_link_is_read_back_as_part_of_it(tmp_path: Path) -> None:
    whole = cabinet()
    door, drawer = whole.joints
    stiff = replace(door, type="fixed", subtype="fixed", lower=0.0, upper=0.0, open=0.0)
    hung = replace(whole, joints=(stiff, replace(drawer, parent=1)))
    asset = write_asset(hung, tmp_path / "a", name="a")
    found = read_asset(asset)
    assert [link.name for link in found.links] == ["body", "drawer"]
    assert [(j.name, j.parent, j.child) for j in found.joints] == [("drawer_slide", 0, 1)]
    assert len(found.links[0].faces) == len(whole.links[0].faces) + len(whole.links[1].faces)


def two_materials_and_colours(kind: str) -> Articulation:
    """The cabinet with two pictures and a plain colour, or with a colour at every vertex."""
    truth = cabinet()
    random = np.random.default_rng(5)
    other = b"\xff\xd8\xff\xe0 as good as a JPEG"
    materials = (
        truth.mesh.materials[0],
        Material("steel", (0.5, 0.5, 0.5, 1), other, "jpeg"),
        Material("plain", (0.2, 0.4, 0.6, 1.0)),
    )
    which = np.repeat(random.integers(0, 3, len(truth.mesh.faces) // 12), 12)
    if kind == "colours":
        colors = random.integers(0, 256, (len(truth.mesh.vertices), 4)).astype(np.uint8)
        mesh = replace(truth.mesh, uv=None, materials=(Material("m"),), colors=colors)
    else:
        mesh = replace(truth.mesh, materials=materials, face_material=which)
    return replace(truth, mesh=mesh)


@pytest.mark.parametrize("format", ["obj", "glb"])
@pytest.mark.parametrize("kind", ["obj", "glb", "colours"])
def test_appearance_of_a_file_comes_through_unchanged(
    tmp_path: Path, kind: str, format: Literal["obj", "glb"]
) -> None:
    """Face by face: corner positions find the source's UVs, image bytes and colours again.

    OBJ has no vertex colours that readers agree on: there they are texels of a picture.
    """
    made = two_materials_and_colours(kind)
    file = tmp_path / ("source.obj" if kind == "obj" else "source.glb")
    (save_obj if kind == "obj" else save_glb)(made.mesh, file)
    source = load_mesh(file, up="z" if kind == "obj" else "y", scale=1.0).mesh
    centre = {tuple(c): i for i, c in enumerate(_middles(source).round(5).tolist())}
    near = _middles(made.mesh) + source.bounds[0] - made.mesh.bounds[0]
    index = [_find(centre, c) for c in near.round(5).tolist()]
    links = tuple(replace(k, faces=np.sort(np.array(index)[k.faces])) for k in made.links)
    made_again = replace(made, mesh=source, links=links)
    asset = write_asset(made_again, tmp_path / "a", name="a", visuals=format)
    for i, link in enumerate(links):
        origin = next((np.array(j.origin) for j in made.joints if j.child == i), np.zeros(3))
        files = sorted((asset.folder / "visual").glob(f"*{link.name}*.{format}"))
        seen = 0
        for visual in files:
            content = read_file(visual)
            for piece in content.pieces:
                middles = piece.vertices[piece.faces].mean(axis=1) + origin
                for face, middle in enumerate(middles.round(5).tolist()):
                    at = _find(centre, middle)
                    seen += 1
                    corners, old = piece.faces[face], source.faces[at]
                    if kind == "colours":
                        assert source.colors is not None
                        colours = piece.colors
                        if format == "obj":
                            colours = _texels(content.materials[piece.material], piece.uv)
                        assert colours is not None
                        np.testing.assert_array_equal(colours[corners], source.colors[old])
                        continue
                    assert source.face_material is not None
                    was = source.materials[source.face_material[at]]
                    now = content.materials[piece.material]
                    assert now.image == was.image
                    np.testing.assert_allclose(now.base_color, was.base_color, atol=1e-6)
                    if was.image is not None:
                        assert piece.uv is not None and source.uv is not None
                        np.testing.assert_array_equal(piece.uv[corners], source.uv[old])
        assert seen == len(link.faces)


def _texels(material: Material, uv: np.ndarray | None) -> np.ndarray:
    """(V, 4) colour of the texel that each texture coordinate lies in."""
    assert material.image is not None and uv is not None
    picture = np.array(Image.open(BytesIO(material.image)).convert("RGBA"))
    size = np.array(picture.shape[1::-1])
    at = np.floor(uv * size).astype(int)
    np.testing.assert_allclose(uv * size, at + 0.5, atol=1e-3)  # centres: exact when sampled
    return picture[at[:, 1], at[:, 0]]


def test_baked_colours_are_interpolated_as_vertex_colours_are() -> None:
    """Bilinear samples inside every face against the barycentric mean of its corners."""
    random = np.random.default_rng(0)
    soup = random.random((45, 3))
    colors = random.integers(0, 256, (45, 4)).astype(np.uint8)
    out = baked(Mesh(soup, np.arange(45).reshape(-1, 3), colors=colors))
    assert out.uv is not None and out.materials[0].image is not None
    picture = np.array(Image.open(BytesIO(out.materials[0].image)), dtype=float)
    size = np.array(picture.shape[1::-1])
    weights = random.dirichlet([1, 1, 1], 20)
    for face in out.faces:
        at = weights @ out.uv[face] * size - 0.5
        low = np.floor(at).astype(int)
        s, t = (at - low).T[:, :, None]
        x, y = low.T
        right, down = np.minimum(x + 1, size[0] - 1), np.minimum(y + 1, size[1] - 1)
        top = (1 - s) * picture[y, x] + s * picture[y, right]
        bottom = (1 - s) * picture[down, x] + s * picture[down, right]
        wanted = weights @ colors[face].astype(float)
        # extrapolated texels beyond an edge are clipped to 0 .. 255
        assert np.abs((1 - t) * top + t * bottom - wanted).mean() < 4.0


def _middles(mesh: Mesh) -> np.ndarray:
    return mesh.vertices[mesh.faces].mean(axis=1)


def _find(known: dict[tuple[float, ...], int], middle: list[float]) -> int:
    spots = np.array(list(known))
    return list(known.values())[int(((spots - middle) ** 2).sum(axis=1).argmin())]


def test_a_file_has_one_object_one_material_and_a_plain_name(tmp_path: Path) -> None:
    made = two_materials_and_colours("obj")
    names = ("3rd body", "door", "handle door")
    links = tuple(replace(link, name=n) for link, n in zip(made.links, names))
    asset = write_asset(replace(made, links=links), tmp_path / "a", name="7 cabinet")
    files = sorted((asset.folder / "visual").glob("*.obj"))
    assert len(files) >= 9  # three materials on three links
    for file in files:
        assert re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", file.stem)
        words = [line.split() for line in file.read_text().splitlines()]
        assert [w[1] for w in words if w[0] == "o"] == [file.stem]
        assert [w[1] for w in words if w[0] == "usemtl"] == [file.stem]
    pictures = sorted(p.name for p in (asset.folder / "visual").iterdir() if p.suffix in
                      (".png", ".jpg"))  # fmt: skip
    assert pictures == ["texture_00.png", "texture_01.jpg"]  # each once
    robot = yourdfpy.URDF.load(str(asset.urdf_path), load_meshes=False).robot
    assert robot.name == "object_7_cabinet" and robot.links[0].name == "link_3rd_body"


def test_a_folder_of_schema_1_is_read(tmp_path: Path) -> None:
    asset = write_asset(cabinet(), tmp_path / "a", name="a", visuals="glb")
    card = asset.folder / "asset.json"
    card.write_text(card.read_text().replace('"schema": 2', '"schema": 1'))
    back = Asset.load(asset.folder)
    assert back.card.schema == 1 and len(read_asset(back).mesh.faces) == len(cabinet().mesh.faces)
    card.write_text(card.read_text().replace('"schema": 1', '"schema": 3'))
    with pytest.raises(InputError, match="schema 3, and this version reads 1 and 2"):
        Asset.load(asset.folder)


def test_folder_can_move_and_card_reads_back(tmp_path: Path) -> None:
    asset = write_asset(
        cabinet(), tmp_path / "a", name="my cabinet", source={"kind": "mesh"}, notes=["hello"]
    )
    shutil.move(asset.folder, tmp_path / "elsewhere")
    back = Asset.load(tmp_path / "elsewhere")
    assert back.card.name == "my cabinet" and back.card.notes == ["hello"]
    assert [j.name for j in back.card.joints] == ["door_hinge", "drawer_slide"]
    assert str(tmp_path) not in back.urdf_path.read_text()
    assert {g.joint for g in back.card.grasps} == {"door_hinge", "drawer_slide"}
    assert back.card.parts[1].handles == ["handle_door"]


@pytest.mark.parametrize(
    ("confidence", "basis", "said"),
    [
        (0.9, RangeBasis(), ""), (0.5, RangeBasis(), "needs review"),
        (0.9, RangeBasis(share=0.04), "needs review: stuck after 4 % of the usual way"),
        (0.9, RangeBasis(of_part=0.1), "needs review: goes only 10 % of its own length"),
        (0.9, RangeBasis(of_part=0.5).cut(0.26), "needs review: goes only 13 % of its own length"),
    ],
)  # fmt: skip
def test_a_joint_says_why_somebody_should_look_at_it(
    confidence: float, basis: RangeBasis, said: str
) -> None:
    joint = CardJoint(
        "j", "revolute", "hinge", "base", "door", [0, 0, 1], [0, 0, 0], 0.0, 0.06,
        confidence=confidence, basis=basis,
    )  # fmt: skip
    assert joint.review == said


def test_inertia_is_possible_and_mass_is_that_of_boards(tmp_path: Path) -> None:
    asset = write_asset(cabinet(), tmp_path / "a", name="a")
    robot = yourdfpy.URDF.load(str(asset.urdf_path), load_meshes=False).robot
    for link in robot.links:
        values = np.linalg.eigvalsh(link.inertial.inertia)
        assert values[0] > 0 and values[0] + values[1] > values[2]
    door = robot.link_map["door"] if hasattr(robot, "link_map") else robot.links[1]
    board = 680 * 0.019 * 0.6 * 0.5
    assert door.inertial.mass == pytest.approx(board, rel=0.05)


@pytest.mark.parametrize("open_end", [False, True])
def test_both_faces_of_a_board_are_one_board(open_end: bool) -> None:
    """A box of 12 mm walls weighs the same whether its surface is closed or its rim is open."""
    outer = box([0, 0, 0], [0.4, 0.3, 0.1])
    inner = box([0.012, 0.012, 0.012], [0.388, 0.288, 0.088])
    inner.invert()
    shell: Any = trimesh.util.concatenate([outer, inner])
    faces = shell.faces
    if open_end:  # the outer face at x = 0 is missing, as where a front is a part of its own
        faces = faces[~np.isclose(shell.vertices[faces][:, :, 0], 0.0).all(axis=1)]
    moving = Joint("j", "prismatic", "slide", 0, 1, np.array([-1.0, 0, 0]), np.zeros(3), 0, 0.1)
    base = box([0.5, 0, 0], [0.6, 0.3, 0.1])
    vertices = np.concatenate([base.vertices, shell.vertices])
    mesh = Mesh(vertices, np.concatenate([base.faces, faces + len(base.vertices)]))
    links = (
        Link("body", "body", np.arange(12)),
        Link("drawer", "drawer", np.arange(12, 12 + len(faces))),
    )
    found = link_inertials(Articulation(mesh, links, (moving,)))[1]
    volume = 0.4 * 0.3 * 0.1 - 0.376 * 0.276 * 0.076
    # edges are counted in both walls, and the face that is missing leaves its board half a board
    assert found.mass == pytest.approx(680 * volume, rel=0.12)


def test_sheet_metal_is_hollow_and_a_casting_is_not() -> None:
    """A fridge door of 40 mm is two sheets; a zinc bar of 8 mm is solid."""
    door, bar = box([0, 0, 0], [0.04, 0.6, 1.0]), box([-0.03, 0.5, 0.4], [-0.022, 0.508, 0.6])
    whole: Any = trimesh.util.concatenate([door, bar])
    links = (Link("d", "door", np.arange(12)), Link("h", "handle", np.arange(12, 24)))
    fixed = Joint("j", "fixed", "fixed", 0, 1, np.array([0, 0, 1.0]), np.zeros(3), 0, 0)
    made = Articulation(Mesh(whole.vertices, whole.faces), links, (fixed,))
    metal, zinc = link_inertials(made, "canister")  # steel, of no usual mass
    assert metal.mass == pytest.approx(7850 * 0.0008 * door.area, rel=0.01)
    assert zinc.mass == pytest.approx(6600 * bar.volume, rel=0.01)
    assert "zinc casting, 6600 kg/m3" in zinc.material


def test_a_second_write_replaces_and_leaves_nothing_behind(tmp_path: Path) -> None:
    for _ in range(2):
        write_asset(cabinet(), tmp_path / "a", name="a")
    assert [p.name for p in tmp_path.iterdir()] == ["a"]


def test_a_failed_write_leaves_the_old_asset(tmp_path: Path) -> None:
    write_asset(cabinet(), tmp_path / "a", name="a")
    with pytest.raises(NotPhysicalError, match="door_hinge"):
        write_asset(cabinet(lower=float("nan")), tmp_path / "a", name="b")
    assert Asset.load(tmp_path / "a").card.name == "a"
    assert [p.name for p in tmp_path.iterdir()] == ["a"]


@pytest.mark.sim
def test_sapien_loads_it_without_a_graphics_driver(tmp_path: Path) -> None:
    from mam_pipeline.check.simulate import load_physics, physics_scene

    asset = write_asset(cabinet(), tmp_path / "a", name="a")
    scene = physics_scene()
    built = load_physics(scene, asset.urdf_path)
    assert [j.name for j in built.active_joints] == ["door_hinge", "drawer_slide"]
    masses = {link.name: link.mass for link in built.links}
    for part in asset.card.parts:
        assert masses[part.link] == pytest.approx(part.mass, rel=1e-5)
