"""The photo reconstructor on synthetic pictures with exact truth, and the geometry it rests on."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mam_sim_bench.photo_scores import handle_hits, score_image, yolo_items
from numpy.typing import NDArray

from mam_pipeline.backends import load
from mam_pipeline.hints import load_hints, save_hints
from mam_pipeline.photo.build import BodySpec, CellSpec, HandleSpec, build_object
from mam_pipeline.photo.camera import (
    CORNERS,
    FACES,
    NORMALS,
    Camera,
    apply_homography,
    quad_homography,
    rotation,
)  # fmt: skip
from mam_pipeline.photo.find import find_object
from mam_pipeline.photo.image import make_photo
from mam_pipeline.photo.layout import split
from mam_pipeline.photo.lines import find_segments
from mam_pipeline.photo.measure import settle_sizes
from mam_pipeline.photo.options import PhotoOptions, parse_options
from mam_pipeline.photo.quad import aspect_of_quad
from mam_pipeline.photo.reconstruct import reconstruct_photo
from mam_pipeline.photo.score import polygon_iou
from mam_pipeline.photo.verdict import layout_as_read
from mam_world.photos.synthetic_photo import synthesise

ROOT = Path(__file__).resolve().parents[2]
SQUARE = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
HALF = np.array([0.5, 0.0])


def test_faces_look_outwards_and_read_from_the_viewers_left() -> None:
    for name, corners in FACES.items():
        tl, tr, _, bl = CORNERS[list(corners)]
        outward = np.cross(tr - tl, tl - bl)
        assert np.allclose(outward / np.linalg.norm(outward), NORMALS[name])


def test_yaw_shows_the_right_side_and_pitch_the_top() -> None:
    turn = rotation(0.4, 0.3, 0.0)
    assert (turn @ np.array(NORMALS["right"]))[2] < 0  # towards the camera
    assert (turn @ np.array(NORMALS["left"]))[2] > 0
    assert (turn @ np.array(NORMALS["top"]))[2] < 0
    assert np.allclose(turn @ turn.T, np.eye(3)) and np.linalg.det(turn) > 0


def test_rays_go_through_their_pixels() -> None:
    camera = Camera(400, 300, 350.0, rotation(0.3, 0.2, 0.05), np.array([0.1, 0.2, 3.0]))
    pixels = np.array([[10.0, 20.0], [200.0, 150.0], [390.0, 290.0]])
    origin, direction = camera.rays(pixels)
    assert np.allclose(camera.project(origin + 2.5 * direction), pixels)


@pytest.mark.parametrize("aspect", [0.5, 1.0, 1.8])
def test_aspect_of_a_rectangle_seen_obliquely(aspect: float) -> None:
    camera = Camera(800, 600, 700.0, rotation(0.6, 0.35, 0.0), np.array([0.05, 0.02, 2.2]))
    half = np.array([0.0, aspect / 2, 0.5])
    quad = camera.project(CORNERS[list(FACES["front"])] * half)
    assert aspect_of_quad(quad, (800, 600)) == pytest.approx(aspect, rel=0.01)


def test_aspect_without_perspective_is_that_of_the_sides() -> None:
    assert aspect_of_quad(SQUARE * [300, 150] + 100, (800, 600)) == pytest.approx(2.0, rel=1e-6)


def test_homography_round_trip() -> None:
    quad = np.array([[10, 20], [300, 40], [280, 250], [30, 220]], dtype=float)
    matrix = quad_homography(quad, 1, 1)
    assert np.allclose(apply_homography(matrix, quad), SQUARE, atol=1e-5)


def test_polygon_iou_closed_forms() -> None:
    assert polygon_iou(SQUARE, SQUARE) == pytest.approx(1)
    assert polygon_iou(SQUARE, SQUARE + HALF) == pytest.approx(1 / 3)
    assert polygon_iou(SQUARE, SQUARE[::-1] + HALF) == pytest.approx(1 / 3)
    assert polygon_iou(SQUARE, SQUARE + 3) == 0


def test_handles_are_hit_when_the_centre_lies_inside() -> None:
    truth = [SQUARE * 20 + 100]
    assert handle_hits(truth, [SQUARE * 18 + 102]) == (1, 1)
    assert handle_hits(truth, [SQUARE * 18 + 140]) == (0, 0)
    assert handle_hits(truth, [SQUARE * 200 + 10]) == (0, 0)  # ten times the size


def test_split_follows_lines_within_the_named_count() -> None:
    support = np.zeros(300)
    support[[100, 200]] = 1.0
    assert np.allclose(split(support, np.ones(3), []), [0, 100, 200, 300], atol=3)
    assert len(split(np.zeros(300), np.ones(4), [])) == 5


CABINET = {"cabinet": 1.0}


def test_scale_and_depth_rules() -> None:
    seen = settle_sizes((1.0, 0.5, 1.0), "observed", CABINET, PhotoOptions(height=0.8))
    assert (seen.width, seen.depth, seen.height) == pytest.approx((0.8, 0.4, 0.8))
    assert (seen.depth_from, seen.scale_from) == ("observed", "user")
    frontal = settle_sizes((1.0, 1.9, 1.0), "assumed", CABINET, PhotoOptions())
    assert frontal.depth_from == frontal.scale_from == "assumed"
    assert frontal.depth == pytest.approx(0.42) and frontal.height == pytest.approx(0.85)
    loose = settle_sizes((1.0, 1.0, 1.0), "inferred", CABINET, PhotoOptions())
    assert loose.depth_from == "inferred" and 0.42 < loose.depth < 0.85
    tall = PhotoOptions(height=1.2)
    legged = settle_sizes((1.0, 0.5, 1.0), "observed", CABINET, tall, legs=0.2)
    assert legged.height == pytest.approx(1.0)  # the user measures with the legs


@pytest.mark.parametrize(("seed", "depth"), [(30, "observed"), (8, "assumed")])
def test_depth_is_measured_only_where_the_picture_holds_it(seed: int, depth: str) -> None:
    image, truth = synthesise(seed, "clean")
    found = find_object(make_photo(image), PhotoOptions())
    assert found.depth_from == depth
    off = abs(found.shape[1] / found.shape[2] / (truth.size[1] / truth.size[2]) - 1)
    assert off < 0.05 or depth != "observed"


def test_an_edge_of_hue_alone_is_a_segment() -> None:
    image: NDArray[Any] = np.full((240, 240, 3), (150, 120, 120), np.uint8)
    image[60:180, 60:180] = (104, 138, 120)  # as light as its surroundings
    image = np.clip(image + np.random.default_rng(0).normal(0, 4, image.shape), 0, 255)
    found = find_segments(image.astype(np.uint8))
    upright = np.abs(found.direction[:, 1]) > 0.99
    near = np.abs(found.middle[:, 0] - 60) < 3
    assert found.length[upright & near].sum() > 60


def spec() -> BodySpec:
    bar = HandleSpec((0.2, 0.5, 0.4, 0.52))
    return BodySpec(
        0.6, 0.4, 0.7,
        (
            CellSpec("drawer_0", "drawer", (0.02, 0.4, 0.58, 0.66), None, (bar,)),
            CellSpec("door_0", "door", (0.02, 0.02, 0.30, 0.38), "left"),
            CellSpec("open_0", "open", (0.32, 0.02, 0.58, 0.38)),
        ),
        legs=0.1,
    )  # fmt: skip


def test_built_object_is_metric_grounded_and_faces_minus_x() -> None:
    mesh, hints = build_object(spec())
    low, high = mesh.bounds
    assert low[2] == pytest.approx(0) and high[2] == pytest.approx(0.8)
    assert np.ptp(mesh.bounds[:, 1]) == pytest.approx(0.6)
    assert low[0] == pytest.approx(-0.2 - 0.036)  # the handle stands proud of the front
    names = {part.name for part in hints.parts}
    assert names == {"body", "drawer_0", "door_0"}
    assert all(node in mesh.group_names for part in hints.parts for node in part.nodes)


def test_opening_never_moves_a_panel_into_the_body() -> None:
    mesh, hints = build_object(spec())
    door = next(p for p in hints.parts if p.kind == "door")
    assert door.joint is not None and door.joint.axis == (0.0, 0.0, -1.0)
    assert door.box is not None and door.joint.origin is not None
    # the hinge lies on the front edge of the door's left side (viewer's left is +Y)
    assert door.joint.origin[0] == pytest.approx(-0.2)
    assert door.joint.origin[1] == pytest.approx(door.box.center[1] + door.box.size[1] / 2)
    drawer = next(p for p in hints.parts if p.kind == "drawer")
    assert drawer.joint is not None and drawer.joint.axis == (-1.0, 0.0, 0.0)
    assert drawer.joint.upper is not None and 0.1 < drawer.joint.upper < 0.4
    boxes = _group_boxes(mesh)
    for moving in (n for p in hints.parts[1:] for n in p.nodes):
        for fixed in (n for n in boxes if n.startswith(("carcass", "leg"))):
            for a in boxes[moving]:
                for b in boxes[fixed]:
                    depth = np.minimum(a[1], b[1]) - np.maximum(a[0], b[0])
                    assert depth.min() < 1e-9, (moving, fixed)


@pytest.mark.parametrize(("scale", "room"), [(1.0, 0.012), (0.3, 0.018)])
def test_a_drawers_box_is_near_the_walls_that_guide_it(scale: float, room: float) -> None:
    """By 12 mm in furniture, by a share of the diagonal in what is small; 2 % would be a gap."""
    size = w, d, h = 0.5 * scale, 0.45 * scale, 0.6 * scale
    cell = CellSpec("drawer_0", "drawer", (0.0, 0.0, w, h))
    boxes = _group_boxes(build_object(BodySpec(w, d, h, (cell,)))[0])
    wall, box = (np.array(boxes[name]) for name in ("carcass_left", "drawer_0_box"))
    outside = float(wall[:, 1, 1].max() - box[:, 1, 1].max())  # the viewer's left is +y
    expected = room * (1.0 if scale == 1.0 else float(np.linalg.norm(size)))
    inside = float(np.ptp(wall[0, :, 1]))
    assert outside == pytest.approx(max(expected + 0.0015, inside + 0.5 * expected), abs=1e-6)
    assert outside - inside < 0.02 * float(np.linalg.norm(size))


def _group_boxes(mesh) -> dict[str, list[np.ndarray]]:  # type: ignore[no-untyped-def]
    out: dict[str, list[np.ndarray]] = {}
    for k in range(0, len(mesh.faces), 12):  # every box has twelve triangles
        points = mesh.vertices[mesh.faces[k : k + 12].reshape(-1)]
        name = mesh.group_names[mesh.face_group[k]]
        out.setdefault(name, []).append(np.stack([points.min(0), points.max(0)]))
    return out


@lru_cache(maxsize=1)
def nightstand():  # type: ignore[no-untyped-def]
    _, backend = load("reconstructor", "embedded")
    return backend.reconstruct(ROOT / "examples" / "nightstand.jpg", {"height": 0.55})


def test_the_example_is_measured() -> None:
    made = nightstand()
    low, high = made.mesh.bounds
    width, height = high[1] - low[1], high[2] - low[2]
    assert height == pytest.approx(0.55, rel=0.01)
    assert width == pytest.approx(0.45, rel=0.05)
    assert made.details["size"][1] == pytest.approx(0.40, rel=0.15)
    assert [p.kind for p in made.hints.parts] == ["body", "drawer", "drawer", "drawer"]
    assert made.confidence["cuboid"] == "high" and made.assumed == ()
    assert "3 drawers" in made.summary and "depth inferred from the photo" in made.summary
    assert made.pictures["overlay"].dtype == np.uint8 and made.pictures["front"].ndim == 3
    assert any(m.image_format == "jpeg" for m in made.mesh.materials)
    assert made.mesh.uv is not None and made.mesh.uv.min() >= 0 and made.mesh.uv.max() <= 1


def test_hints_round_trip_and_rebuild_the_same_object(tmp_path: Path) -> None:
    made = nightstand()
    file = tmp_path / "hints.yaml"
    save_hints(made.hints, file)
    again = load_hints(file)
    assert [p.name for p in again.parts] == [p.name for p in made.hints.parts]
    _, backend = load("reconstructor", "embedded")
    rebuilt = backend.reconstruct(ROOT / "examples" / "nightstand.jpg", {"hints": file})
    assert np.allclose(rebuilt.details["size"], made.details["size"], rtol=1e-3)
    for a, b in zip(made.hints.parts, rebuilt.hints.parts):
        assert a.kind == b.kind and a.box is not None and b.box is not None
        assert np.allclose(a.box.size, b.box.size, atol=0.006)
        assert np.allclose(a.box.center, b.box.center, atol=0.006)


def test_corners_and_layout_are_obeyed() -> None:
    image, truth = synthesise(2, "clean")
    corners = truth.front.reshape(-1).tolist()
    options = parse_options({"front": corners, "layout": "4x2 drawers", "width": 1.0})
    made = reconstruct_photo(make_photo(image), options)
    assert sum(p.kind == "drawer" for p in made.hints.parts) == 8
    assert all(p.provenance == "user" for p in made.hints.parts[1:])
    w, _, h = truth.size
    assert made.details["size"][2] == pytest.approx(h / w, rel=0.06)


def test_corners_and_layout_as_read_change_nothing() -> None:
    image, _ = synthesise(6, "clean", 480)
    photo = make_photo(image)
    found = find_object(photo, PhotoOptions())
    corners = (found.quad / photo.scale).round().astype(int).reshape(-1).tolist()
    typed = parse_options({"front": corners, "layout": layout_as_read(found.reading)})
    again = find_object(photo, typed)
    assert np.array_equal(again.quad, found.quad) and again.shape == found.shape
    assert again.depth_from == found.depth_from and again.front_given
    boxes = [[p.box for p in f.reading.panels] for f in (found, again)]
    assert boxes[0] == boxes[1]


@pytest.mark.parametrize("seed", [0, 6, 12])
def test_clean_synthetic_photos(seed: int) -> None:
    image, truth = synthesise(seed, "clean", 600)
    score = score_image(image, truth)
    assert score.front_iou > 0.85
    assert score.aspect_error < 0.08
    assert 2 * score.matched50 >= score.panels


def test_the_same_photo_gives_the_same_answer() -> None:
    image, _ = synthesise(6, "clean", 480)
    a, b = (
        reconstruct_photo(make_photo(image), PhotoOptions(accept_low_confidence=True)) for _ in "ab"
    )
    assert a.hints == b.hints and np.array_equal(a.mesh.vertices, b.mesh.vertices)


def test_synthetic_truth_is_consistent() -> None:
    image, truth = synthesise(3, "clutter", 320)
    assert image.shape[1] == 320 and image.dtype == np.uint8
    assert all(0 <= v <= 1.05 for p in truth.panels for v in p.rect)
    again, _ = synthesise(3, "clutter", 320)
    assert np.array_equal(image, again)


def test_yolo_folders(tmp_path: Path) -> None:
    from mam_pipeline.errors import InputError

    with pytest.raises(InputError, match="no photo with a YOLO label"):
        list(yolo_items(tmp_path))
    (tmp_path / "images").mkdir()
    (tmp_path / "labels").mkdir()
    cv2.imwrite(str(tmp_path / "images" / "a.png"), np.zeros((60, 60, 3), np.uint8))
    label = tmp_path / "labels" / "a.txt"
    label.write_text("1 0.5 0.5 0.1 0.2\n0 0.5 0.5 1 1\n")
    ((path, boxes),) = yolo_items(tmp_path)
    assert path.name == "a.png" and [n for n, _ in boxes] == ["handle", "door"]
    assert np.allclose(boxes[0][1][0], [0.45, 0.4])
    label.write_text("handle 1 2\n")
    with pytest.raises(InputError, match="line 1"):
        list(yolo_items(tmp_path))
