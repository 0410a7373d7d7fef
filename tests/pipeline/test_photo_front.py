"""Reading fronts drawn for the purpose: mouldings, long bars, repeated handles."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from mam_pipeline.photo.complete import fix_controls
from mam_pipeline.photo.front import with_own_handles
from mam_pipeline.photo.handles import COUNT, Blob, handle_candidates
from mam_pipeline.photo.mouldings import moulding_credit, spans
from mam_pipeline.photo.panel import Panel
from mam_pipeline.photo.repeat import handles_by_repetition
from mam_pipeline.photo.seams import candidates, find_seams


def test_spans_pair_lines_at_even_margins() -> None:
    lines = np.array([0, 30, 100, 170, 200])
    assert [0, 1, 3, 4] in spans(lines, 200.0).tolist()
    assert [0, 1, 2, 4] not in spans(lines, 200.0).tolist()


def test_a_moulding_is_credited_to_its_panel() -> None:
    xs = ys = np.array([0, 20, 180, 200])
    column, row = np.zeros((4, 4, 4)), np.zeros((4, 4, 4))
    column[1:3], row[1:3] = 1.0, 1.0
    credit = moulding_credit(xs, ys, column, row, lambda s, share: share * s - 0.2)
    assert credit[0, 3, 0, 3] == pytest.approx(4 * 0.8)  # each line in full, less four cuts
    assert credit[0, 2, 0, 2] == 0.0  # no inner rectangle at even margins
    column[1, 1, 2] = column[1, 0, 3] = row[1, 1, 2] = row[1, 0, 3] = 0.1
    column[2, 1, 2] = 0.5
    assert moulding_credit(xs, ys, column, row, lambda s, share: s)[0, 3, 0, 3] == 0.0


def test_a_wide_line_is_one_candidate() -> None:
    response = np.zeros((100, 300))
    response[:, 140:160] = 1.0
    strength = response.copy()
    strength[:, 150] = 3.0
    found = candidates(response, strength, axis=1)
    assert found[0] == 0 and found[-1] == 300 and 150 in found
    assert np.diff(found).min() >= 4 and len(found) <= 8


def front() -> np.ndarray:
    """Two shaker doors side by side, each with a rail of its own."""
    image = np.full((400, 400, 3), 190, np.uint8)
    for x in (10, 205):
        cv2.rectangle(image, (x, 10), (x + 184, 389), (60, 60, 60), 2)
        cv2.rectangle(image, (x + 36, 46), (x + 148, 353), (130, 130, 130), 2)
    return image


def test_seam_lines_of_a_drawn_front_are_candidates() -> None:
    seams = find_seams(front())
    for x in (46, 199, 241):
        assert np.abs(seams.xs - x).min() <= 4
    for y in (46, 353):
        assert np.abs(seams.ys - y).min() <= 4


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


def test_a_handle_of_its_panels_own_colour_is_a_candidate() -> None:
    rng = np.random.default_rng(0)
    picture = np.full((300, 400, 3), 150.0) + rng.normal(0, 4.0, (300, 400, 3))
    picture[146:154, 160:240] += 9.0  # about two deviations of the noise
    image = np.clip(picture, 0, 255).astype(np.uint8)
    boxes, table = handle_candidates(image, find_seams(image))
    assert table.shape == (len(boxes), COUNT)
    off = np.abs(boxes - [160, 146, 240, 154])
    assert off.max(axis=1).min() <= 8


def test_knobs_beside_a_microwaves_door_do_not_open() -> None:
    door = Panel((0, 0, 300, 200), "door", "left", (blob(280, 100, 0.9, 10, 120),))
    column = [
        Panel((310, 0, 400, 100), "drawer", None, (blob(355, 50, 0.8),)),
        Panel((310, 100, 400, 200), "drawer", None, (blob(355, 150, 0.8),)),
    ]
    fixed = fix_controls([door, *column], [], (400, 200))
    assert [p.kind for p in fixed] == ["door", "fixed", "fixed"]
    drawers = [Panel(p.box, p.kind, None, (blob(355, 50, 0.8, 10, 115),)) for p in column]
    kept = fix_controls([door, *drawers], [], (400, 200))
    assert [p.kind for p in kept] == ["door", "drawer", "drawer"]  # they carry the door's handle


def test_three_knobs_in_a_row_are_controls_and_two_are_handles() -> None:
    strip = Panel((0, 0, 300, 60), "drawer", None, ())
    door = Panel((0, 60, 300, 400), "door", "bottom", ())
    knobs = [blob(x, 30, 0.5) for x in (60, 150, 240)]
    over = fix_controls([strip, door], knobs, (300, 400))
    assert [p.kind for p in over] == ["fixed", "door"]
    assert fix_controls([strip, door], knobs[:2], (300, 400))[0].kind == "drawer"
