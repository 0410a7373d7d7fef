"""Learned meshes: splitting along planes, alignment to the photo's box, cutting along panels."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from mam_sim_models.fused import BODY, align_to_box, cut_from_photo, cut_panels
from mam_sim_models.split import split_mesh

from mam_pipeline.errors import ConfigError
from mam_pipeline.geometry.fuse import fuse_mesh
from mam_pipeline.hints import Hints
from mam_pipeline.parts.hints import along_nodes, part_primitives
from mam_pipeline.photo.build import BodySpec, CellSpec, HandleSpec, build_object
from mam_pipeline.types import Mesh, Primitives

QUARTER = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # a turn about Z


def cabinet() -> tuple[Mesh, Hints]:
    """A built cabinet: two drawers over a door, on legs; known to the millimetre."""
    cells = (
        CellSpec("drawer_0", "drawer", (0.03, 0.50, 0.30, 0.68), None,
                 (HandleSpec((0.12, 0.58, 0.21, 0.60)),)),
        CellSpec("drawer_1", "drawer", (0.31, 0.50, 0.57, 0.68), None,
                 (HandleSpec((0.40, 0.58, 0.49, 0.60)),)),
        CellSpec("door_0", "door", (0.03, 0.03, 0.57, 0.48), "left",
                 (HandleSpec((0.52, 0.22, 0.54, 0.30)),)),
    )  # fmt: skip
    return build_object(BodySpec(0.6, 0.4, 0.7, cells, legs=0.1))


def area(mesh: Mesh, faces: np.ndarray) -> float:
    c = mesh.vertices[mesh.faces[faces]]
    return float(np.linalg.norm(np.cross(c[:, 1] - c[:, 0], c[:, 2] - c[:, 0]), axis=1).sum() / 2)


def open_edges(mesh: Mesh) -> int:
    _, index = np.unique(np.round(mesh.vertices, 7), axis=0, return_inverse=True)
    f = index.reshape(-1)[mesh.faces]
    f = f[(f[:, 0] != f[:, 1]) & (f[:, 1] != f[:, 2]) & (f[:, 0] != f[:, 2])]
    edges = np.sort(np.concatenate([f[:, [0, 1]], f[:, [1, 2]], f[:, [2, 0]]]), axis=1)
    _, count = np.unique(edges, axis=0, return_counts=True)
    return int((count == 1).sum())


@pytest.fixture(scope="module")
def fused() -> tuple[Mesh, Hints]:
    mesh, hints = cabinet()
    return fuse_mesh(mesh, resolution=72), hints


def test_a_split_keeps_area_texture_and_closedness(fused: tuple[Mesh, Hints]) -> None:
    mesh, _ = fused
    every = np.ones(len(mesh.faces), bool)
    cut = split_mesh(mesh, 2, 0.4123, every)
    z = cut.vertices[cut.faces][:, :, 2]
    assert not ((z.min(axis=1) < 0.4123 - 1e-5) & (z.max(axis=1) > 0.4123 + 1e-5)).any()
    assert area(cut, np.arange(len(cut.faces))) == pytest.approx(
        area(mesh, np.arange(len(mesh.faces))), rel=1e-9
    )
    assert open_edges(mesh) == open_edges(cut) == 0


def test_a_partial_split_opens_no_crack(fused: tuple[Mesh, Hints]) -> None:
    mesh, _ = fused
    front = mesh.vertices[mesh.faces][:, :, 0].min(axis=1) < -0.15
    cut = split_mesh(mesh, 1, 0.0371, front)
    assert len(cut.faces) > len(mesh.faces) and open_edges(cut) == 0


def test_texture_coordinates_follow_the_cut() -> None:
    mesh, _ = cabinet()
    uv = mesh.vertices[:, [1, 2]].astype(np.float32)  # a texture that says where it is
    mesh = Mesh(mesh.vertices, mesh.faces, mesh.materials, mesh.face_material, uv)
    cut = split_mesh(mesh, 2, 0.333, np.ones(len(mesh.faces), bool))
    assert cut.uv is not None and len(cut.vertices) > len(mesh.vertices)
    assert np.allclose(cut.uv, cut.vertices[:, [1, 2]], atol=1e-5)
    assert cut.face_material is not None and len(cut.face_material) == len(cut.faces)


@pytest.mark.parametrize(("yaw", "scale"), [(0.0, 1.0), (12.0, 0.4), (-25.0, 3.0)])
def test_alignment_undoes_a_models_frame(
    fused: tuple[Mesh, Hints], yaw: float, scale: float
) -> None:
    mesh, hints = fused
    angle = np.deg2rad(yaw) + np.pi / 2  # the front looks towards -Y, as glTF's +Z does
    c, s = scale * np.cos(angle), scale * np.sin(angle)
    strange = np.array([[c, -s, 0, 0.3], [s, c, 0, -2], [0, 0, scale, 5], [0, 0, 0, 1.0]])
    back = align_to_box(mesh.transformed(strange), hints)
    assert np.allclose(back.bounds[1] - back.bounds[0], mesh.bounds[1] - mesh.bounds[0], rtol=0.03)
    handles = back.vertices[back.vertices[:, 0] < back.bounds[0, 0] + 0.01]
    assert len(handles) and (handles[:, 2] > 0.25).all()  # the handles are what is foremost


def test_panels_are_cut_out_with_their_handles(fused: tuple[Mesh, Hints]) -> None:
    mesh, hints = fused
    mesh = align_to_box(mesh, hints, forward=0.0)
    cut, named = cut_panels(mesh, hints)
    assert cut.group_names == (BODY, "drawer_0_skin", "drawer_1_skin", "door_0_skin")
    assert [p.nodes for p in named.parts] == [(n,) for n in cut.group_names]
    assert cut.face_group is not None
    assert area(cut, np.arange(len(cut.faces))) == pytest.approx(
        area(mesh, np.arange(len(mesh.faces))), rel=1e-9
    )
    for number, part in enumerate(named.parts[1:], start=1):
        faces = np.flatnonzero(cut.face_group == number)
        points = cut.vertices[cut.faces[faces]].reshape(-1, 3)
        truth = next(p for p in hints.parts if p.name == part.name)
        assert truth.box is not None and part.box is not None and part.joint is not None
        low, high = points.min(axis=0), points.max(axis=0)
        center, half = np.array(truth.box.center), np.array(truth.box.size) / 2
        assert np.allclose([low[1], low[2]], (center - half)[1:], atol=0.02)
        assert np.allclose([high[1], high[2]], (center + half)[1:], atol=0.02)
        assert low[0] < -0.2 - 0.02  # the handle came along
        assert truth.joint is not None and truth.joint.origin is not None
        assert part.joint.origin is not None
        assert np.allclose(part.joint.origin, truth.joint.origin, atol=0.02)


def test_a_photo_without_panels_only_aligns(fused: tuple[Mesh, Hints]) -> None:
    mesh, hints = fused
    whole, named = cut_from_photo(mesh, Hints(parts=hints.parts[:1]))
    assert len(whole.faces) == len(mesh.faces) and whole.group_names == (BODY,)
    assert [p.nodes for p in named.parts] == [(BODY,)]


def test_hints_without_a_body_are_refused(fused: tuple[Mesh, Hints]) -> None:
    with pytest.raises(ConfigError, match="no box of the body"):
        align_to_box(fused[0], Hints())


def test_a_panel_cut_out_of_a_flat_face_becomes_a_primitive() -> None:
    _, hints = cabinet()
    plain = trimesh.creation.box((0.5, 0.75, 1.0)).subdivide()  # no groove, another scale
    cut, named = cut_from_photo(Mesh(plain.vertices @ QUARTER, plain.faces), hints)
    whole = Primitives(np.zeros(len(cut.faces), dtype=np.int64))
    divided = along_nodes(whole, cut, named)
    assert divided.count == 4
    for number, part in enumerate(named.parts[1:], start=1):
        mine = part_primitives(part, divided, cut)
        assert np.array_equal(np.isin(divided.labels, mine), cut.face_group == number)
    assert along_nodes(divided, cut, named) is divided
    assert along_nodes(whole, cut, Hints()) is whole
