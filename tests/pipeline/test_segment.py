"""Primitives: whole shells of authored soups, creases of fused surfaces, invariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.cluster.hierarchy import is_valid_linkage

from mam_pipeline.errors import InputError
from mam_pipeline.geometry.fuse import fuse_mesh
from mam_pipeline.geometry.sampling import face_geometry
from mam_pipeline.segment import fronts as fronts_module
from mam_pipeline.segment.fronts import divide
from mam_pipeline.segment.geometric import GeometricSegmenter
from mam_pipeline.segment.topology import solids, topology, weld, without_repeats
from mam_pipeline.types import IntArray, Mesh, Primitives


def boxes(*items: tuple[tuple[float, ...], tuple[float, ...]]) -> tuple[Mesh, IntArray]:
    """A mesh of boxes (centre, size) and the box of every face."""
    vertices, faces, owner = [], [], []
    for k, (centre, size) in enumerate(items):
        box = trimesh.creation.box(extents=size)
        faces.append(box.faces + 8 * k)
        vertices.append(box.vertices + np.array(centre))
        owner += [k] * 12
    return Mesh(np.concatenate(vertices), np.concatenate(faces)), np.array(owner)


CABINET = boxes(
    ((0, 0, 0), (1, 1, 1)),
    ((-0.26, -0.52, 0), (0.47, 0.02, 0.95)),
    ((0.26, -0.52, 0), (0.47, 0.02, 0.95)),
    ((-0.1, -0.55, 0), (0.05, 0.04, 0.2)),
)


def same(a: NDArray[np.int64], b: NDArray[np.int64]) -> bool:
    """Whether two labellings are the same partition."""
    pairs = np.unique(np.stack([a, b]), axis=1).shape[1]
    return pairs == len(np.unique(a)) == len(np.unique(b))


def test_boxes_that_touch_stay_apart() -> None:
    mesh, owner = CABINET
    assert same(GeometricSegmenter().segment(mesh).labels, owner)


def test_bodies_that_share_corners_and_a_face_stay_apart() -> None:
    mesh, owner = boxes(
        ((0, 0, 0), (1, 1, 1)),
        ((-0.25, -0.51, 0), (0.5, 0.02, 1)),  # two doors, flush with each other and with the body
        ((0.25, -0.51, 0), (0.5, 0.02, 1)),
    )
    found = GeometricSegmenter().segment(mesh)
    assert same(found.labels, owner) and found.method == "geometric"
    order = np.random.default_rng(0).permutation(len(owner))
    shuffled = Mesh(mesh.vertices, mesh.faces[order])
    assert same(GeometricSegmenter().segment(shuffled).labels, owner[order])
    twice = Mesh(mesh.vertices, np.concatenate([mesh.faces, mesh.faces[:, ::-1]]))
    assert same(GeometricSegmenter().segment(twice).labels, np.tile(owner, 2))


def test_closed_shells_are_told_by_the_vertices_of_the_file() -> None:
    mesh, owner = CABINET
    assert same(solids(mesh.faces), owner)
    assert (solids(mesh.faces[1:])[:11] == -1).all()  # a body with a hole
    assert (solids(mesh.faces[1:])[11:] >= 0).all()
    flag = np.array([[0, 1, 2], [0, 2, 3], [2, 1, 0], [3, 2, 0]])  # both sides of a quad
    assert (solids(flag) == -1).all()


def test_a_convex_body_that_is_nearly_everything_is_not_cut() -> None:
    mesh, owner = boxes(((0, 0, 0), (1, 0.05, 2)), ((0.4, -0.06, 0), (0.1, 0.02, 0.02)))
    assert same(GeometricSegmenter().segment(mesh).labels, owner)


def test_unshared_vertices_and_double_sides_change_nothing() -> None:
    mesh, owner = CABINET
    corners = mesh.vertices[mesh.faces].reshape(-1, 3)
    soup = np.arange(len(corners)).reshape(-1, 3)
    both = Mesh(corners, np.concatenate([soup, soup[:, ::-1]]))
    assert same(GeometricSegmenter().segment(both).labels, np.tile(owner, 2))


def test_every_face_gets_a_label_degenerate_ones_too() -> None:
    mesh, _ = CABINET
    faces = np.concatenate([mesh.faces, [[8, 8, 9], [0, 1, 0]]])
    got = GeometricSegmenter().segment(Mesh(mesh.vertices, faces))
    assert len(got.labels) == len(faces) and got.labels.min() == 0
    assert set(got.labels) == set(range(got.count))


@pytest.mark.parametrize("case", ["turn", "scale", "shuffle"])
def test_invariance(case: str) -> None:
    mesh, _ = CABINET
    first = GeometricSegmenter().segment(mesh).labels
    order: IntArray = np.arange(len(mesh.faces), dtype=np.int64)
    matrix = np.eye(4)
    if case == "turn":
        matrix = trimesh.transformations.euler_matrix(0.3, -0.8, 1.1)
    elif case == "scale":
        matrix = np.diag([250.0, 250.0, 250.0, 1.0])
    else:
        order = np.random.default_rng(1).permutation(len(order))
    other = Mesh(mesh.transformed(matrix).vertices, mesh.faces[order])
    assert same(GeometricSegmenter().segment(other).labels, first[order])


def test_specks_join_what_they_sit_on() -> None:
    mesh, owner = boxes(
        ((0, 0, 0), (1, 1, 1)), ((2, 0, 0), (1, 1, 1)), ((0.51, 0, 0), (0.02, 0.02, 0.02))
    )
    labels = GeometricSegmenter().segment(mesh).labels
    assert labels.max() == 1
    assert len(set(labels[owner != 1])) == 1


def test_a_fused_surface_splits_along_its_creases() -> None:
    mesh, _ = boxes(((0, 0, 0), (1, 1, 1)), ((0, -0.6, 0), (0.5, 0.2, 0.5)))
    fused = fuse_mesh(mesh, 48)
    got = GeometricSegmenter().segment(fused)
    assert 5 < got.count <= 60 and len(got.labels) == len(fused.faces)
    front = fused.vertices[fused.faces].mean(axis=1)[:, 1] < -0.54
    inside = np.bincount(got.labels, weights=front) / np.bincount(got.labels)
    # the knob can be put together from primitives that hold hardly anything else
    assert ((inside < 0.1) | (inside > 0.8)).mean() > 0.9
    assert is_valid_tree(got.merges, got.count)
    assert GeometricSegmenter(clear=0.002).segment(fused).count > got.count


def test_a_finely_cut_piece_beside_others_is_cut_along_its_creases_only() -> None:
    mesh, owner = CABINET
    drum = trimesh.creation.cylinder(1.0, 1.0, sections=48)
    vertices, faces = drum.vertices + np.array([3.0, 0, 0]), drum.faces
    for _ in range(3):
        vertices, faces = trimesh.remesh.subdivide(vertices, faces)
    both = np.concatenate([mesh.faces, faces + len(mesh.vertices)])
    fine = Mesh(np.concatenate([mesh.vertices, vertices]), both)
    labels = GeometricSegmenter().segment(fine).labels
    up = face_geometry(fine.vertices, fine.faces)[0][len(owner) :, 2].round()
    assert same(labels, np.concatenate([owner, 10 + up.astype(int)]))  # a wall and two lids


def test_loose_triangles_on_a_skin_cost_no_primitive() -> None:
    mesh, _ = boxes(((0, 0, 0), (1, 1, 1)), ((0, -0.6, 0), (0.5, 0.2, 0.5)))
    skin = fuse_mesh(mesh, 48)
    # flaps on some edges: those have three faces then, and the flap is a surface of its own
    some = skin.faces[:: len(skin.faces) // 30]
    tips = skin.vertices[some].mean(axis=1) + 0.004
    flaps = np.column_stack([some[:, :2], len(skin.vertices) + np.arange(len(some))])
    torn = Mesh(np.concatenate([skin.vertices, tips]), np.concatenate([skin.faces, flaps]))
    clean, got = GeometricSegmenter().segment(skin), GeometricSegmenter().segment(torn)
    assert len(got.labels) == len(torn.faces) and got.count == clean.count
    assert len(got.merges) == got.count - 1 and is_valid_tree(got.merges, got.count)
    assert got.labels.max() == got.count - 1
    area = np.bincount(got.labels, face_geometry(torn.vertices, torn.faces)[1])
    assert area.min() > 1e-4 * area.sum()


def is_valid_tree(merges: IntArray, count: int) -> bool:
    """Every node is merged at most once and only after it exists."""
    used: set[int] = set()
    for row, pair in enumerate(merges.tolist()):
        if any(node in used or node >= count + row for node in pair):
            return False
        used.update(pair)
    if len(merges) == count - 1:
        full = np.zeros((len(merges), 4))
        full[:, :2] = merges
        size = dict.fromkeys(range(count), 1)
        for row, (a, b) in enumerate(merges.tolist()):
            size[count + row] = size[a] + size[b]
            full[row, 2:] = row, size[count + row]
        return bool(is_valid_linkage(full))
    return True


def test_welding_uses_two_grids() -> None:
    points = np.array([[0.1, 0.2, 0.3]]) + np.linspace(0, 1e-8, 50)[:, None]
    assert weld(points, 1e-5).max() == 0
    assert weld(np.array([[0, 0, 0], [1e-3, 0, 0.0]]), 1e-5).max() == 1


def test_repeated_faces_have_one_keeper() -> None:
    mesh, _ = CABINET
    doubled = Mesh(mesh.vertices, np.concatenate([mesh.faces, mesh.faces[:, [2, 1, 0]]]))
    topo = topology(doubled)
    assert topo.kept.sum() == len(mesh.faces)
    assert (topo.twin[len(mesh.faces) :] == np.arange(len(mesh.faces))).all()


def test_only_copies_within_a_primitive_are_left_out() -> None:
    mesh, _ = CABINET
    labels = np.arange(len(mesh.faces)) % 3
    assert without_repeats(mesh, Primitives(labels))[0] is mesh
    doubled = Mesh(mesh.vertices, np.concatenate([mesh.faces, mesh.faces[:, [2, 1, 0]]]))
    once, few = without_repeats(doubled, Primitives(np.concatenate([labels, labels])))
    assert np.array_equal(once.vertices[once.faces], mesh.vertices[mesh.faces])
    assert np.array_equal(few.labels, labels)
    other, _ = without_repeats(doubled, Primitives(np.concatenate([labels, (labels + 1) % 3])))
    assert len(other.faces) == 2 * len(mesh.faces)


def test_an_empty_mesh_is_refused() -> None:
    with pytest.raises(InputError, match="no faces"):
        GeometricSegmenter().segment(Mesh(np.zeros((0, 3)), np.zeros((0, 3), dtype=int)))
    with pytest.raises(InputError, match="no face with an area"):
        GeometricSegmenter().segment(Mesh(np.zeros((3, 3)), np.array([[0, 1, 2]])))


CASE = (0, 0, 0), (1.2, 0.8, 1.0)  # its front is at y = -0.4
Item = tuple[tuple[float, ...], tuple[float, ...]]


def knob(x: float, z: float, wide: float = 0.05, high: float = 0.05) -> Item:
    return (x, -0.42, z), (wide, 0.1, high)


def fronts_of(*items: Item, floating: int = 0) -> tuple[Mesh, Primitives, list[IntArray]]:
    """A skin, its primitives and the faces of every front that its handles tell.

    Args:
        floating: how many of the items no surface joins to the others.
    """
    skin = fuse_mesh(boxes(*items)[0], 96)
    got = GeometricSegmenter().segment(skin)
    assert len(got.merges) == got.count - 1 - floating
    assert floating or is_valid_tree(got.merges, got.count)
    assert got.fronts is not None and (got.fronts.sum(axis=0) <= 1).all()
    return skin, got, [np.flatnonzero(row[got.labels]) for row in got.fronts]


def span(skin: Mesh, faces: IntArray, axis: int) -> tuple[float, float]:
    points = skin.vertices[skin.faces[faces]].reshape(-1, 3)[:, axis]
    return float(points.min()), float(points.max())


def test_two_knobs_beside_the_middle_make_a_pair_of_leaves() -> None:
    skin, _, fronts = fronts_of(CASE, knob(-0.08, 0.1), knob(0.08, 0.1))
    assert len(fronts) == 2
    (_, left), (right, _) = sorted(span(skin, faces, 0) for faces in fronts)
    assert abs(left) < 0.05 and abs(right) < 0.05
    for faces in fronts:  # each has its knob
        assert span(skin, faces, 1)[0] < -0.44


def test_handles_above_each_other_make_a_stack() -> None:
    edges = np.array([-0.5, -0.1, 0.25, 0.5])  # uneven: every handle is in the middle of its front
    bars = [knob(0.0, z, wide=0.3) for z in (edges[:-1] + edges[1:]) / 2]
    skin, _, fronts = fronts_of(CASE, *bars)
    spans = sorted(span(skin, faces, 2) for faces in fronts)
    assert len(spans) == 3
    np.testing.assert_allclose([low for low, _ in spans[1:]], edges[1:-1], atol=0.05)
    np.testing.assert_allclose([high for _, high in spans[:-1]], edges[1:-1], atol=0.05)


def test_handles_that_float_before_their_fronts_tell_as_well() -> None:
    bars: list[Item] = [((0.0, -0.47, z), (0.4, 0.03, 0.04)) for z in (-0.25, 0.25)]
    skin, got, fronts = fronts_of(CASE, *bars, floating=2)
    assert got.is_fused and len(fronts) == 2
    lower, upper = sorted(span(skin, faces, 2) for faces in fronts)
    assert abs(lower[1]) < 0.05 and abs(upper[0]) < 0.05
    for faces in fronts:
        assert span(skin, faces, 1)[0] < -0.47  # the bar is its own
    far: list[Item] = [((0.0, -0.6, z), (0.4, 0.03, 0.04)) for z in (-0.25, 0.25)]
    assert not fronts_of(CASE, *far, floating=2)[2]


def test_handles_of_an_eighth_of_the_flat_tell_fronts() -> None:
    bars = [knob(0.0, z, wide=0.45, high=0.15) for z in (-0.25, 0.25)]
    skin, _, fronts = fronts_of(CASE, *bars)
    lower, upper = sorted(span(skin, faces, 2) for faces in fronts)
    assert abs(lower[1]) < 0.05 and abs(upper[0]) < 0.05


def test_a_primitive_is_of_the_front_that_has_most_of_it() -> None:
    topo = topology(CABINET[0])
    label = np.repeat([0, 1, 2, 3], 12)
    body = np.full(48, -1)
    body[:12], body[12:24] = 0, 1  # two fronts of one flat, and a panel whose faces are of both
    body[24:36] = np.where(topo.normals[24:36, 1] < -0.9, 0, 1)
    told = fronts_module.fronts(topo, label, body)
    assert told.sum(axis=0).tolist() == [1, 1, 1, 0]


def test_handles_at_even_distances_are_on_fronts_of_one_height() -> None:
    at = np.array([-0.34, -0.11, 0.12, 0.35])  # of four fronts of 0.23 above a plinth
    skin, _, fronts = fronts_of(CASE, *(knob(0.0, z, wide=0.3) for z in at))
    heights = [float(np.ptp(span(skin, faces, 2))) for faces in fronts]
    assert len(fronts) == 4 and max(heights) < 1.5 * min(heights)


def test_a_front_that_has_grown_into_the_body_is_cut_out_of_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    items = [CASE, *(knob(0.0, z, wide=0.3) for z in (-0.25, 0.25))]
    skin = fuse_mesh(boxes(*items)[0], 96)
    topo = topology(skin)
    whole = GeometricSegmenter().segment(skin)
    middle = skin.vertices[skin.faces].mean(axis=1)
    lower = (middle[:, 1] < -0.39) & (middle[:, 2] < 0)
    label = whole.labels.copy()
    grown = int(np.bincount(label[middle[:, 2] < -0.49]).argmax())
    label[lower & np.isin(label, np.flatnonzero(whole.fronts.any(axis=0)))] = grown
    label = np.unique(label, return_inverse=True)[1]
    told = []
    for share in (0.6, 0.0):
        changed = replace(fronts_module.FRONTS, carved=share)
        monkeypatch.setattr(fronts_module, "FRONTS", changed)
        out, _, body = divide(topo, label, int(label.max()) + 1)
        told.append(len(fronts_module.fronts(topo, out, body)))
    assert told == [2, 0]


def test_a_drawer_above_two_leaves() -> None:
    knobs = [knob(0.0, 0.35), knob(-0.08, 0.0), knob(0.08, 0.0)]
    skin, _, fronts = fronts_of(CASE, *knobs)
    assert len(fronts) == 3
    wide = [faces for faces in fronts if np.ptp(span(skin, faces, 0)) > 1.0]
    assert len(wide) == 1 and span(skin, wide[0], 2)[0] > 0.1


def test_a_lever_on_the_middle_of_a_ring_parts_both_faces_of_the_leaves() -> None:
    bars: list[Item] = [((x, 0, 0), (0.1, 0.1, 1.2)) for x in (-0.5, 0.5)]
    bars += [((0, 0, 0), (0.2, 0.1, 1.2))]
    bars += [((0, 0, z), (1.0, 0.1, 0.1)) for z in (-0.55, 0.55)]
    bars += [((x, 0, 0), (0.5, 0.03, 1.2)) for x in (-0.25, 0.25)]  # panes
    lever = (0.02, -0.08, 0.0), (0.04, 0.1, 0.16)
    skin, got, _ = fronts_of(*bars, lever)
    middle = skin.vertices[skin.faces].mean(axis=1)
    normals = face_geometry(skin.vertices, skin.faces)[0]
    for side in (-1.0, 1.0):
        on = (normals[:, 1] * side > 0.9) & (middle[:, 1] * side > 0.04)
        left, right = (set(got.labels[on & (middle[:, 0] * s > 0.12)]) for s in (-1, 1))
        assert left and right and not left & right


@pytest.mark.parametrize(
    "items",
    [
        [knob(0.4, 0.0, wide=0.15), *(knob(-0.55, z, 0.04, 0.1) for z in (-0.4, 0.0, 0.4))],
        [knob(-0.3, 0.0), knob(0.3, 0.0)],
        [knob(x, 0.4) for x in (-0.4, -0.2, 0.0, 0.2, 0.4)],
        [knob(0.0, 0.3, wide=0.6), knob(0.0, -0.2)],
        [((0, -0.405, z), (0.5, 0.05, 0.3)) for z in (-0.25, 0.25)],
    ],
    ids=["hinges and a lever", "one wide drawer", "switches", "unlike", "mouldings"],
)
def test_other_things_on_a_flat_cut_nothing(items: list[Item]) -> None:
    _, _, fronts = fronts_of(CASE, *items)
    assert not fronts


@pytest.mark.parametrize("knobs", [[], [knob(-0.08, 0.1), knob(0.08, 0.1)]], ids=["none", "pair"])
def test_a_small_surface_beside_a_skin_stays_out_of_its_tree(knobs: list[Item]) -> None:
    skin = fuse_mesh(boxes(CASE, *knobs)[0], 96)
    crumb, _ = boxes(((0.0, 0.0, 0.7), (0.1, 0.1, 0.1)), ((0.3, 0.0, 0.7), (0.07, 0.07, 0.07)))
    both = np.concatenate([skin.faces, crumb.faces + len(skin.vertices)])
    got = GeometricSegmenter().segment(Mesh(np.concatenate([skin.vertices, crumb.vertices]), both))
    apart = set(got.labels[len(skin.faces) :])
    assert len(apart) == 2 and not apart & set(got.labels[: len(skin.faces)])
    assert len(got.merges) == got.count - 3 and is_valid_tree(got.merges, got.count)
    assert not apart & set(got.merges.ravel().tolist())
    assert len(got.fronts) == len(knobs)
