"""The pictures that go with a question: every piece is shown, tagged and can be read."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trimesh
from PIL import Image, ImageDraw, ImageFont

from mam_pipeline.models import album
from mam_pipeline.render import orbit_views as views
from mam_pipeline.render import pictures
from mam_pipeline.types import Mesh, Primitives

Boxes = tuple[Mesh, Primitives]


@pytest.fixture(scope="module")
def crowd() -> Boxes:
    """A closed box with a ball inside and thirty small studs on its front."""
    shell = trimesh.creation.box((0.4, 1.0, 1.0))
    ball = trimesh.creation.icosphere(subdivisions=2, radius=0.12)
    studs = [
        trimesh.creation.box(
            (0.02, 0.05, 0.05), trimesh.transformations.translation_matrix((-0.21, y, z))
        )
        for y in np.linspace(-0.3, 0.3, 6)
        for z in np.linspace(-0.25, 0.25, 5)
    ]
    parts = [shell, ball, *studs]
    labels = np.concatenate([np.full(len(p.faces), i) for i, p in enumerate(parts)])
    joined: Any = trimesh.util.concatenate(parts)
    return Mesh(joined.vertices, joined.faces), Primitives(labels)


def test_cameras_stand_where_they_say() -> None:
    marker = trimesh.creation.box((0.1, 0.1, 0.1))
    mesh = Mesh(marker.vertices, marker.faces)
    for azimuth, place in ((0, (-1, 0)), (90, (0, -1)), (180, (1, 0)), (-90, (0, 1))):
        view = views.look(mesh, [(azimuth, 0)], 16)[0]
        eye = -view.camera_T_asset[:3, :3].T @ view.camera_T_asset[:3, 3]
        np.testing.assert_allclose(eye[:2] / np.linalg.norm(eye), place, atol=1e-6)
    assert album.direction_name(view.azimuth, 0) == "from +y"


def test_tight_views_are_filled(boxes: Boxes) -> None:
    mesh, _ = boxes
    for view in views.look(mesh, size=128, tight=True):
        rows, columns = np.nonzero(view.faces >= 0)
        assert max(np.ptp(rows), np.ptp(columns)) > 0.85 * 128
        assert min(rows.min(), columns.min()) >= 1 and max(rows.max(), columns.max()) <= 126


def test_edges_outline_every_side_of_a_box() -> None:
    solid = trimesh.creation.box((1, 1, 1)).subdivide()
    view = views.look(Mesh(solid.vertices, solid.faces), [(-35, 25)], 128)[0]
    inside = np.zeros_like(view.edges)
    inside[2:-2, 2:-2] = (view.faces >= 0)[2:-2, 2:-2]
    share = view.edges[inside].mean()
    assert 0.01 < share < 0.08  # the outline and the three creases, no triangle's diagonal


def test_every_piece_is_shown_the_hidden_ones_inside(crowd: Boxes) -> None:
    made = album.cast(*crowd)
    assert made.ids == list(range(32)) and made.hidden == (1,)
    labels = [name for name, _ in album.of_pieces(made, None)]
    outside = [f"view_{i}" for i in range(10)]
    assert labels == ["object", *outside, "close_0", "inside", "apart"]
    assert made.crowds == ((4, tuple(range(2, 32))),)  # the studs, seen from the front
    seen = np.unique([i for v in made.inside for i in np.unique(v.ids(made.labels))])
    assert seen.tolist() == [-1, 1]
    assert "1: x " in album.facts(made, made.labels)


def test_specks_are_asked_about_through_their_neighbour(boxes: Boxes) -> None:
    mesh, primitives = boxes
    speck = trimesh.creation.icosphere(subdivisions=0, radius=1e-4).apply_translation(
        (-0.22, -0.2, 0.3)
    )
    vertices = np.concatenate([mesh.vertices, speck.vertices])
    faces = np.concatenate([mesh.faces, speck.faces + len(mesh.vertices)])
    labels = np.concatenate([primitives.labels, np.full(len(speck.faces), 3)])
    made = album.cast(Mesh(vertices, faces), Primitives(labels))
    assert made.ids == [0, 1, 2] and made.stands_for[3] == 1


def test_too_many_pieces_are_cut_to_a_readable_number(
    crowd: Boxes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(album, "ALBUM", replace(album.ALBUM, most_ids=10))
    made = album.cast(*crowd)
    assert len(made.ids) == 10 and set(made.stands_for) == set(made.ids)


def test_pieces_apart_keep_their_shape_and_order(crowd: Boxes) -> None:
    mesh, primitives = crowd
    loose = pictures.exploded(mesh, primitives.labels)
    before, after = mesh.vertices[mesh.faces], loose.vertices[loose.faces]
    for label in (1, 5):
        shift = (after - before)[primitives.labels == label].reshape(-1, 3)
        np.testing.assert_allclose(shift, np.broadcast_to(shift[0], shift.shape), atol=1e-12)
    ends = [after[primitives.labels == k].reshape(-1, 3) for k in (2, 3)]
    assert ends[0][:, 2].max() < ends[1][:, 2].min()


def test_tags_do_not_cover_each_other_or_what_they_name(crowd: Boxes) -> None:
    image = Image.new("RGB", (200, 200), "white")
    ids = np.full((200, 200), -1)
    taken: list[pictures.Box] = []
    font = ImageFont.load_default(size=12)
    for tag in range(12):  # all of them want the same place
        pictures.place(ImageDraw.Draw(image), font, str(tag), (100, 100, 3.0), taken, ids)
    assert len(taken) == 12
    for i, one in enumerate(taken):
        assert min(one) >= 0 and max(one) < 200
        assert not (one[0] <= 100 <= one[2] and one[1] <= 100 <= one[3])
        assert not any(pictures.overlap(one, other) for other in taken[:i])
    roomy: list[pictures.Box] = []
    pictures.place(ImageDraw.Draw(image), font, "7", (50, 50, 40.0), roomy, ids)
    assert roomy[0][0] < 50 < roomy[0][2]


def test_coinciding_faces_make_no_speckled_outline() -> None:
    noise = np.random.default_rng(0).integers(0, 2, (64, 64))
    assert pictures._outline(noise).mean() < 0.02
    halves = np.repeat([[0, 1]], 64, axis=0).repeat(32, axis=1)
    assert pictures._outline(halves).sum() == 64


def test_sheets_hold_pictures_of_any_size() -> None:
    one = np.zeros((10, 10, 3), dtype=np.uint8)
    two = np.zeros((20, 40, 3), dtype=np.uint8)
    assert pictures.sheet([one, two], 2).shape == (20, 80, 3)
    assert max(pictures.sheet([two] * 4, 2, limit=30).shape) == 30
    colors = pictures.distinct_colors(90).astype(int)
    gap = np.abs(colors[:, None] - colors[None]).sum(axis=2) + 999 * np.eye(90, dtype=int)
    assert gap.min() >= 20 and gap[:20, :20].min() >= 60
    np.testing.assert_array_equal(pictures.distinct_colors(5), colors[:5])
