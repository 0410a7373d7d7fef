"""The asset folder: complete, movable, the same kinematics and appearance as what went in."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yourdfpy

from mam_pipeline.asset.card import Asset
from mam_pipeline.asset.writer import write_asset
from mam_pipeline.errors import NotPhysicalError
from mam_pipeline.formats.gltf import read_gltf
from mam_pipeline.types import Articulation, Joint, Link, Material, Mesh

PNG = b"\x89PNG\r\n\x1a\n not really, but bytes are bytes"


def box(low: list[float], high: list[float]) -> trimesh.Trimesh:
    return trimesh.creation.box(bounds=[low, high])


def cabinet(**changes: float) -> Articulation:
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
    whole = trimesh.util.concatenate([trimesh.util.concatenate(s) for s in solids])
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


def test_texture_bytes_and_uvs_are_the_source_s(tmp_path: Path) -> None:
    truth = cabinet()
    asset = write_asset(truth, tmp_path / "a", name="a")
    assert truth.mesh.uv is not None
    expected = np.concatenate([truth.mesh.uv[truth.mesh.faces[link.faces]] for link in truth.links])
    found = []
    for file in sorted((asset.folder / "visual").iterdir()):
        for piece in read_gltf(file).pieces:
            assert piece.uv is not None
            found.append(piece.uv[piece.faces])
        assert read_gltf(file).materials[0].image == PNG
    got = np.concatenate(found).reshape(-1, 6)
    order = [np.lexsort(x.T) for x in (got, expected.reshape(-1, 6))]
    np.testing.assert_array_equal(got[order[0]], expected.reshape(-1, 6)[order[1]])


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


def test_inertia_is_possible_and_mass_is_that_of_boards(tmp_path: Path) -> None:
    asset = write_asset(cabinet(), tmp_path / "a", name="a")
    robot = yourdfpy.URDF.load(str(asset.urdf_path), load_meshes=False).robot
    for link in robot.links:
        values = np.linalg.eigvalsh(link.inertial.inertia)
        assert values[0] > 0 and values[0] + values[1] > values[2]
    door = robot.link_map["door"] if hasattr(robot, "link_map") else robot.links[1]
    board = 720 * 0.019 * 0.6 * 0.5
    assert door.inertial.mass == pytest.approx(board, rel=0.05)


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


def test_sapien_loads_it_without_a_graphics_driver(tmp_path: Path) -> None:
    from mam_pipeline.check.simulate import load_physics, physics_scene

    asset = write_asset(cabinet(), tmp_path / "a", name="a")
    scene = physics_scene()
    built = load_physics(scene, asset.urdf_path)
    assert [j.name for j in built.active_joints] == ["door_hinge", "drawer_slide"]
    masses = {link.name: link.mass for link in built.links}
    for part in asset.card.parts:
        assert masses[part.link] == pytest.approx(part.mass, rel=1e-5)
