"""Reading fronts: what the network sees, the tiling of its votes, repeated handles."""

from __future__ import annotations

import itertools

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from mam_pipeline.photo.confidence import panel_probability
from mam_pipeline.photo.front import Told, panel_of, read_front, with_own_handles
from mam_pipeline.photo.front_network import FrontMaps
from mam_pipeline.photo.handles import Blob, handles_seen
from mam_pipeline.photo.options import Layout, parse_layout
from mam_pipeline.photo.panel import Panel
from mam_pipeline.photo.repeat import handles_by_repetition
from mam_pipeline.photo.tiling import Tile, best_tiling, seams_of
from mam_pipeline.photo.verdict import layout_as_read
from mam_world.photos.painted_front import paint_front


def drawn_front(columns: list[int], rows: list[int]) -> NDArray[np.uint8]:
    """A white chest with dark joints and a knob in the middle of every cell."""
    image = np.full((480, 640, 3), 215, np.uint8)
    xs, ys = [0, *columns, 640], [0, *rows, 480]
    for x in xs:
        cv2.line(image, (x, 0), (x, 480), (70, 70, 70), 4)
    for y in ys:
        cv2.line(image, (0, y), (640, y), (70, 70, 70), 4)
    for x0, x1 in itertools.pairwise(xs):
        for y0, y1 in itertools.pairwise(ys):
            centre = ((x0 + x1) // 2, (y0 + y1) // 2)
            cv2.circle(image, (centre[0] + 2, centre[1] + 5), 12, (140, 140, 140), -1)
            cv2.circle(image, centre, 11, (60, 55, 50), -1)
    return np.asarray(cv2.GaussianBlur(image, (0, 0), 1.0), np.uint8)


def test_drawers_of_a_drawn_chest_are_read_with_their_knobs() -> None:
    reading = read_front(drawn_front([320], [160, 320]))
    assert [p.kind for p in reading.movable] == ["drawer"] * 6
    corners = {(x, y) for x in (0, 320) for y in (0, 160, 320)}
    for panel in reading.movable:
        x0, y0, x1, y1 = panel.box
        assert min(abs(x0 - a) + abs(y0 - b) for a, b in corners) <= 16
        assert abs(x1 - x0 - 320) <= 16 and abs(y1 - y0 - 160) <= 16
        (knob,) = panel.handles
        assert knob.provenance == "observed"
        assert np.abs(np.array(knob.center) - [(x0 + x1) / 2, (y0 + y1) / 2]).max() <= 16
    assert reading.confidence > 0.7


def voted(boxes: list[tuple[int, int, int, int]], h: int = 40, w: int = 60) -> FrontMaps:
    """What a network would say that sees these panels (x0, y0, x1, y1 in places) exactly."""
    y, x = np.mgrid[0:h, 0:w] + 0.5
    kind, reach = np.zeros((6, h, w), np.float32), np.full((4, h, w), 1.0, np.float32)
    kind[0] = 1.0
    upright, level = np.zeros((2, h, w), np.float32)
    for x0, y0, x1, y1 in boxes:
        inside = (x > x0) & (x < x1) & (y > y0) & (y < y1)
        kind[0, inside], kind[2, inside] = 0.0, 1.0
        reach[:, inside] = np.stack([x - x0, y - y0, x1 - x, y1 - y])[:, inside]
        for at in (x0, x1):
            upright[y0:y1, min(at, w - 1)] = 1.0
        for at in (y0, y1):
            level[min(at, h - 1), x0:x1] = 1.0
    return FrontMaps(upright, level, np.zeros((h, w), np.float32), kind, reach, 400, 600)


def test_the_tiling_follows_the_votes_and_leaves_the_rest() -> None:
    maps = voted([(2, 2, 30, 20), (2, 20, 30, 38), (30, 2, 44, 38)])
    tiles = best_tiling(maps, seams_of(maps))
    panels = sorted(t.box for t in tiles if t.panel)
    want = [(20, 20, 300, 200), (20, 200, 300, 380), (300, 20, 440, 380)]
    assert np.allclose(panels, want, atol=12)
    assert all(t.agreement > 0.8 for t in tiles if t.panel)
    rest = [t for t in tiles if not t.panel]
    assert any(t.box[0] > 420 and t.box[2] == 600 for t in rest)  # the right quarter is none
    assert maps.kind_shares((20, 20, 300, 200))["door left"] > 0.99


def test_a_front_without_votes_has_no_panel() -> None:
    maps = voted([])
    assert not any(t.panel for t in best_tiling(maps, seams_of(maps)))


def test_a_faint_patch_is_kept_with_its_own_size() -> None:
    maps = voted([])
    maps.handle[10:14, 10:14] = 0.9
    maps.handle[10:14, 40:44] = 0.3
    sure, faint = handles_seen(maps)
    assert (sure.score, faint.score) == pytest.approx((0.9, 0.3), abs=0.02)
    assert np.allclose(sure.box, (100, 100, 140, 140), atol=8)
    assert np.allclose(faint.box, (400, 100, 440, 140), atol=8)


def test_painted_fronts_are_the_same_again_and_hold_their_panels() -> None:
    one, two = (paint_front(np.random.default_rng(3)) for _ in range(2))
    assert np.array_equal(one.picture, two.picture) and one.panels == two.panels
    for seed in range(6):
        front = paint_front(np.random.default_rng(seed))
        for panel in front.panels:
            u0, v0, u1, v1 = panel.rect
            assert -0.01 < u0 < u1 < 1.01 and -0.01 < v0 < v1 < 1.01
            for handle in panel.handles:
                middle = (handle[0] + handle[2]) / 2, (handle[1] + handle[3]) / 2
                assert u0 < middle[0] < u1 and v0 - 0.02 < middle[1] < v1


def blob(x: float, y: float, score: float, w: float = 10, h: float = 10) -> Blob:
    return Blob((x - w / 2, y - h / 2, x + w / 2, y + h / 2), score)


def test_faint_patches_at_one_place_outvote_a_strong_one_elsewhere() -> None:
    boxes = [(0.0, 100.0 * k, 200.0, 100.0 * k + 90) for k in range(3)]
    blobs = [blob(100, 100 * k + 45, 0.3) for k in range(3)] + [blob(30, 20, 0.4)]
    chosen = handles_by_repetition(boxes, blobs)
    assert {k: b.center for k, b in chosen.items()} == {
        k: (100.0, 100.0 * k + 45) for k in range(3)
    }
    assert all(b.score > 0.5 for b in chosen.values())


def test_doors_that_mirror_each_other_share_their_handles() -> None:
    boxes = [(0.0, 0.0, 100.0, 300.0), (110.0, 0.0, 210.0, 300.0)]
    blobs = [blob(92, 150, 0.5, 6, 60), blob(118, 152, 0.3, 6, 64), blob(40, 40, 0.45)]
    chosen = handles_by_repetition(boxes, blobs)
    assert chosen[0].center == (92, 150) and chosen[1].center == (118, 152)


def test_one_panel_alone_repeats_nothing() -> None:
    assert handles_by_repetition([(0.0, 0.0, 100.0, 100.0)], [blob(50, 50, 0.9)]) == {}


def test_handles_stay_within_their_panel() -> None:
    pair = Blob((80, 40, 130, 60), 0.9)  # two knobs on either side of the seam, seen as one
    left = with_own_handles(Panel((0, 0, 100, 200), "door", "left", (pair,)))
    right = with_own_handles(Panel((104, 0, 204, 200), "door", "right", (pair,)))
    assert left.handles[0].box == pytest.approx((80, 40, 98.5, 60))
    assert right.handles[0].box == pytest.approx((105.5, 40, 130, 60))
    lost = with_own_handles(Panel((0, 0, 100, 200), "door", "left", (Blob((99, 40, 120, 60), 1),)))
    assert [b.provenance for b in lost.handles] == ["assumed"]  # a virtual grasp line instead


def test_a_layout_that_is_as_read_moves_no_panel() -> None:
    image = drawn_front([320], [160, 320])
    read = read_front(image)
    text = layout_as_read(read)
    assert text
    kept = read_front(image, parse_layout(text))
    assert [(p.box, p.kind, p.hinge_side) for p in kept.panels] == [
        (p.box, p.kind, p.hinge_side) for p in read.panels
    ]
    assert [p.handles for p in kept.panels] == [p.handles for p in read.panels]


def test_what_a_layout_says_otherwise_is_changed_in_its_place() -> None:
    image = drawn_front([320], [160, 320])
    read = read_front(image)
    columns = parse_layout(layout_as_read(read)).columns
    doors = Layout(
        tuple(tuple(tuple(("door-right", n) for _, n in row) for row in rows) for rows in columns)
    )
    changed = read_front(image, doors)
    assert [p.box for p in changed.panels] == [p.box for p in read.panels]
    assert all((p.kind, p.hinge_side) == ("door", "right") for p in changed.panels)


@pytest.mark.parametrize(("side", "seen"), [("left", 9), ("right", 0), ("top", 9)])
def test_what_lies_at_a_hinge_that_is_told_is_no_handle(side: str, seen: int) -> None:
    image = np.full((480, 640, 3), 215, np.uint8)
    for x in (0, 213, 426):
        for y in (0, 160, 320):
            cv2.rectangle(image, (x, y), (x + 213, y + 160), (70, 70, 70), 4)
            cv2.circle(image, (x + 180, y + 80), 11, (60, 55, 50), -1)
    layout = parse_layout(" / ".join([", ".join([f"door-{side}"] * 3)] * 3))
    reading = read_front(np.asarray(cv2.GaussianBlur(image, (0, 0), 1.0), np.uint8), layout)
    observed = [b for p in reading.panels for b in p.handles if b.provenance == "observed"]
    assert len(reading.panels) == 9 and len(observed) == seen


@pytest.mark.parametrize(
    ("left", "knobs", "side", "kept"),
    [
        (0.6, {60: 0.9}, "right", [60]),  # it opens by its knob, so its hinge is opposite
        (0.99, {60: 0.6}, "left", []),  # sure of its hinge: what lies there is none
        (0.99, {60: 0.8, 240: 0.7}, "left", [240]),
    ],
)
def test_a_door_is_hinged_away_from_its_handle(
    left: float, knobs: dict[int, float], side: str, kept: list[int]
) -> None:
    maps = voted([(0, 0, 30, 40)])
    maps.kind[2, :, :30], maps.kind[3, :, :30] = left, 1.0 - left
    blobs = [Blob((x - 5.0, 195.0, x + 5.0, 205.0), score) for x, score in knobs.items()]
    tile = Tile((0, 0, 300, 400), True, 0.9)
    panel = panel_of(tile, sorted(blobs, key=lambda b: -b.score), maps)
    assert (panel.kind, panel.hinge_side) == ("door", side)
    assert [b.center[0] for b in panel.handles] == kept


def test_kinds_that_are_typed_stay_where_panels_are_alike() -> None:
    kinds = [p.kind for p in read_front(drawn_front([320], [160, 320]), parse_layout(
        "drawer, door-left / door-right, drawer / drawer, control panel")).panels]  # fmt: skip
    assert sorted(kinds) == ["door", "door", "drawer", "drawer", "drawer", "fixed"]


def test_kinds_that_a_model_says_are_believed_less_than_a_persons() -> None:
    layout = parse_layout("drawer, door-left / door-right, drawer / drawer, control panel")
    image = drawn_front([320], [160, 320])
    person, model = read_front(image, layout).panels, read_front(image, layout, sure=0.85).panels
    assert [(p.kind, p.box, p.hinge_side) for p in person] == [
        (p.kind, p.box, p.hinge_side) for p in model
    ]
    assert {p.provenance for p in person} == {"user"} and {p.provenance for p in model} == {"model"}
    assert all(panel_probability(p) == pytest.approx(0.98 * 0.85) for p in model)


def test_a_handle_that_a_model_sees_goes_before_what_only_looks_like_one() -> None:
    image = np.full((480, 640, 3), 215, np.uint8)
    for x in (0, 320):
        cv2.rectangle(image, (x, 0), (x + 320, 480), (70, 70, 70), 4)
        cv2.circle(image, (x + 290, 100), 11, (60, 55, 50), -1)
    blurred = np.asarray(cv2.GaussianBlur(image, (0, 0), 1.0), np.uint8)
    layout = parse_layout("door-left, door-left")

    def read(*boxes: tuple[float, float, float, float]) -> list[Blob]:
        reading = read_front(blurred, layout, sure=0.85, handles=Told(boxes, 0.85))
        return [p.handles[0] for p in sorted(reading.panels, key=lambda p: p.box[0])]

    alone = read()
    assert [b.provenance for b in alone] == ["observed", "observed"]
    near, elsewhere = read((270, 85, 300, 125), (560, 300, 600, 330))
    assert near.box == alone[0].box and near.told  # in its measured place
    assert elsewhere.provenance == "model" and elsewhere.center == pytest.approx((580, 315), abs=1)
    hinge, whole = read((10, 300, 40, 330), (330, 10, 630, 470))
    assert [b.box for b in (hinge, whole)] == [b.box for b in alone]  # neither can be a handle
