"""What a photo shows, what it measures by that, and what is said where it is not to be believed."""

from __future__ import annotations

import io
import pickle
import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from mam_pipeline.errors import NotThisKind
from mam_pipeline.photo import category
from mam_pipeline.photo.agreement import shared
from mam_pipeline.photo.category import Looks, front_kinds, look, things_of
from mam_pipeline.photo.confidence import (
    TOPICS,
    evidence,
    limits,
    panel_probability,
    right_share,
)
from mam_pipeline.photo.efficientnet import read_checkpoint, weights
from mam_pipeline.photo.find import Found, sizes_of
from mam_pipeline.photo.front import FrontReading
from mam_pipeline.photo.handles import Blob
from mam_pipeline.photo.image import read_photo
from mam_pipeline.photo.layout import cells_of_layout, layout_text
from mam_pipeline.photo.measure import USUAL, usual_size
from mam_pipeline.photo.opened import RULES
from mam_pipeline.photo.options import CATEGORY_NAMES, PhotoOptions, parse_layout, parse_options
from mam_pipeline.photo.panel import Panel
from mam_pipeline.photo.tiling import SeamMaps
from mam_pipeline.photo.verdict import (
    doubt_about,
    fills_the_picture,
    judge,
    may_be_a_room_door,
    opened_in,
    seen_as,
    stop_if_no_box,
    stop_if_out_of_scope,
)

ROOT = Path(__file__).resolve().parents[2]
CHEST = Looks({"chest of drawers": 0.9, "wardrobe": 0.1})


def two_drawers(width: float = 1.0) -> Found:
    """A front of two drawers, 200 pixels high, in a picture of 400 x 300."""
    w = round(200 * width)
    image = np.full((200, w, 3), 180, np.uint8)
    panels = []
    for y in (1.0, 101.0):
        knob = Blob((w / 2, y + 40, w / 2 + 9, y + 49), 0.9)
        panels.append(Panel((2.0, y, w - 2.0, y + 98), "drawer", None, (knob,)))
    quad = np.array([[50.0, 40], [50 + w, 40], [50 + w, 240], [50, 240]])
    reading = FrontReading(image, tuple(panels), 0.9)
    return Found((400, 300), quad, (width, 0.5, 1.0), reading, 0.1, 0.3, [quad], depth_hold=1.0)


def why(found: Found, looks: Looks | None = CHEST, opened: float = 0.0, **other: str) -> str:
    """Why a reading is doubted; empty where it is not."""
    words = {"cuboid": "high", "panels": "high", "handles": "high", **other}
    doubt = doubt_about(found, words, PhotoOptions(), looks, opened)
    return "" if doubt is None else doubt.why


def test_the_kinds_name_every_class_once_and_known_sizes() -> None:
    numbers = [k for members in category.kinds().values() for k in members]
    assert len(numbers) == len(set(numbers)) and len(category.class_names()) == 1000
    for shares in category.categories().values():
        assert set(shares) <= set(USUAL) and sum(shares.values()) == pytest.approx(1)
    assert set(USUAL) == set(CATEGORY_NAMES)


def test_a_chest_is_known_and_a_face_is_not() -> None:
    assert look(read_photo(ROOT / "examples" / "nightstand.jpg").small).in_scope > 0.9
    from sklearn.datasets import load_sample_image

    flower = look(np.asarray(load_sample_image("flower.jpg")))
    assert flower.in_scope < 0.05
    with pytest.raises(NotThisKind, match=r"flower.jpg .*--bbox.*--category"):
        stop_if_out_of_scope(flower, PhotoOptions(), "flower.jpg")
    stop_if_out_of_scope(flower, PhotoOptions(accept_low_confidence=True), "flower.jpg")


def test_a_stranger_is_called_by_its_name() -> None:
    with pytest.raises(NotThisKind, match=r"x.jpg looks like an oven glove \(0\.90\)"):
        stop_if_out_of_scope(Looks({"oven glove": 0.9, "desk": 0.1}), PhotoOptions(), "x.jpg")


def test_kinds_of_which_none_is_likely_are_named_together() -> None:
    parts = {"seat": 0.3, "table": 0.25, "wardrobe": 0.19, "window": 0.16, "room": 0.1}
    name, p = Looks(parts).stranger
    assert name == "room" and p == pytest.approx(0.81)
    assert Looks({"seat": 0.8, "room": 0.2}).stranger == ("seat", 0.8)


def test_nobody_looks_where_the_user_says_what_it_is() -> None:
    photo = read_photo(ROOT / "examples" / "nightstand.jpg")
    assert seen_as(photo, PhotoOptions(category="fridge")) is None


def with_first_panel(found: Found, **other: Any) -> Found:
    """The same with another first panel."""
    first, *rest = found.reading.panels
    panels = (replace(first, **other), *rest)
    return replace(found, reading=replace(found.reading, panels=panels))


def test_a_reading_is_believed_as_far_as_its_weakest_panel() -> None:
    found = two_drawers()
    assert evidence(found)["panels"] == pytest.approx(evidence(found)["cuboid"] * 0.5 * 0.5)
    weak = with_first_panel(found, confidence=0.2)
    assert evidence(weak)["panels"] == pytest.approx(0.4 * evidence(found)["panels"])
    beside = replace(found, reading=replace(found.reading, missed=0.8))
    assert evidence(beside)["panels"] == 0.0  # a handle where a panel was missed
    assert evidence(found, agree=0.5)["panels"] == 0.0
    assert evidence(with_first_panel(found, handles=()))["panels"] == 0.0  # one has none
    assert all(high >= medium > 0 for high, medium in limits().values())


def test_furniture_without_any_handle_can_be_believed() -> None:
    found = two_drawers()
    panels = tuple(replace(p, handles=()) for p in found.reading.panels)
    bare = replace(found, reading=replace(found.reading, panels=panels))
    assert 0 < evidence(bare)["panels"] < evidence(found)["panels"]


def test_a_probability_rises_with_the_votes() -> None:
    sure, unsure = (Panel((0, 0, 9, 9), "drawer", None, (), p, 1.0) for p in (0.6, 0.2))
    assert panel_probability(sure) > 0.9 > 0.5 > panel_probability(unsure)


def test_no_panel_of_a_doubtful_front_is_sure() -> None:
    sure = Panel((0, 0, 9, 9), "drawer", None, (), 0.6, 1.0)
    alone, one_of_four = (panel_probability(sure, 0.3, n) for n in (1, 4))
    assert alone == pytest.approx(0.3) and one_of_four == pytest.approx(0.3**0.25)
    assert panel_probability(replace(sure, told=True), 0.3) == panel_probability(sure) > 0.9
    for topic in TOPICS:
        shares = [right_share(topic, word) for word in ("low", "medium", "high", "given")]
        assert shares == sorted(shares) and shares[0] < 0.8 and shares[-1] == 1.0


def test_the_checkpoint_holds_tensors_and_nothing_else() -> None:
    assert weights()["_fc.weight"].shape == (1000, 1280)
    bad = io.BytesIO(b"".join(map(pickle.dumps, (1, 1001, {}, print))))
    with pytest.raises(pickle.UnpicklingError, match="holds no"):
        read_checkpoint(bad)


@pytest.mark.parametrize(
    ("shape", "what", "low", "high"),
    [((1.7, 1.0), "microwave", 0.25, 0.35), ((0.4, 1.0), "fridge", 1.5, 1.9)],
)
def test_a_thing_is_as_large_as_its_kind(
    shape: tuple[float, float], what: str, low: float, high: float
) -> None:
    usual = usual_size(*shape, None, {what: 0.9, "cabinet": 0.1})
    assert usual.category == what and low < usual.scale < high


def test_doubt_about_the_kind_is_doubt_about_the_size() -> None:
    sure = usual_size(1.0, 1.0, None, {"washing_machine": 1.0})
    unsure = usual_size(1.0, 1.0, None, {"washing_machine": 0.5, "safe": 0.5})
    assert sure.spread < 0.06 < unsure.spread


LAYOUTS = [
    "door-left, door-right / drawer", "2 doors-left / door-bottom",
    "3 drawers", "2 drawers / 2 doors", "drawer, drawer", "door, drawer / open", "door | 4 drawers",
    "4 drawers | 2 doors / drawer", "drawer / door | 3 drawers | drawer / door",
]  # fmt: skip


@pytest.mark.parametrize("text", LAYOUTS)
def test_a_layout_is_said_as_it_is_typed(text: str) -> None:
    columns = parse_layout(text).columns
    panels = []
    for c, rows in enumerate(columns):
        for i, row in enumerate(rows):
            cells = [kind for kind, n in row for _ in range(n)]
            for k, kind in enumerate(cells):
                u = [(c + q / len(cells)) / len(columns) for q in (k, k + 1)]
                panels.append((kind, (u[0], i / len(rows), u[1], (i + 1) / len(rows))))
    assert parse_layout(layout_text(panels)) == parse_layout(text)


def test_a_pinwheel_cannot_be_said() -> None:
    assert layout_text([("door", (0, 0, 0.6, 0.4)), ("door", (0.6, 0, 1, 0.6)),
                        ("door", (0.4, 0.6, 1, 1)), ("door", (0, 0.4, 0.4, 1))]) == ""  # fmt: skip


def test_columns_are_cut_at_their_lines_and_then_into_rows() -> None:
    vertical, horizontal = np.zeros((400, 600)), np.zeros((400, 600))
    vertical[:, 200], horizontal[200, 200:] = 1.0, 1.0
    lines = SeamMaps(vertical, horizontal, np.array([0, 200, 600]), np.array([0, 200, 400]))
    cells = cells_of_layout(lines, [], parse_layout("door | 2 drawers"))
    want = [("door", (0, 0, 200, 400)), ("drawer", (200, 0, 600, 200)),
            ("drawer", (200, 200, 600, 400))]  # fmt: skip
    for (kind, box), (truth, corners) in zip(cells, want, strict=True):
        assert kind == truth and np.allclose(box, corners, atol=8)


def test_panels_are_never_surer_than_their_box() -> None:
    found = replace(two_drawers(), doubt=0.25)
    judged = judge(found, parse_options({"layout": "2 drawers"}), CHEST)
    assert judged.words["cuboid"] == judged.words["panels"] == "low"


def test_what_a_person_types_is_given_and_never_high() -> None:
    options = parse_options({"layout": "2 drawers", "front": [50, 40, 250, 40, 250, 240, 50, 240]})
    judged = judge(replace(two_drawers(), front_given=True), options, None)
    assert judged.words["cuboid"] == judged.words["panels"] == "given"
    assert judged.words["handles"] != "high" and judged.doubt is None


def test_the_line_that_is_offered_can_be_typed() -> None:
    found = replace(two_drawers(), scale=2.0)
    doubt = doubt_about(found, {"cuboid": "low", "panels": "low"}, PhotoOptions(), None)
    assert doubt is not None
    said = doubt.told("my photo.jpg", {"height": 0.5}, Path("made here")).splitlines()
    line = next(x for x in said if "make-env" in x)
    assert shlex.split(line)[:3] == ["mam-sim", "make-env", "my photo.jpg"]
    from mam_sim.cli import verb_class
    from mam_sim.options import parse

    options = parse(verb_class("make-env"), "mam-sim make-env", shlex.split(line)[2:])
    given = parse_options(options.pipeline.photo.given())  # type: ignore[attr-defined]
    assert given.front == ((25, 20), (125, 20), (125, 120), (25, 120))
    assert given.layout == parse_layout("2 drawers")
    assert options.pipeline.height == 0.5  # type: ignore[attr-defined]
    assert options.out == Path("made here")  # type: ignore[attr-defined]
    assert any(x.strip() == "mam-sim studio 'my photo.jpg'" for x in said)
    assert any("stands open in the photo, close it" in x for x in said)
    typed = doubt_about(found, {"cuboid": "high", "panels": "low"}, given, None)
    assert typed is not None and not typed.notes  # somebody has said what each panel is


def test_another_face_of_a_doubted_box_is_offered() -> None:
    side = np.array([[250.0, 40], [300, 50], [300, 230], [250, 240]])
    found = replace(two_drawers(), other_faces=(("right", side),))
    words = {"cuboid": "low", "panels": "low"}
    doubt = doubt_about(found, words, PhotoOptions(), None)
    assert doubt is not None
    ((told, options),) = doubt.others.items()
    assert "to the right" in told and options == {"front": "250,40,300,50,300,230,250,240"}


@pytest.mark.parametrize(
    "pixels", [["--bbox", "1,2,30,40"], ["--bbox=1,2,30,40"], ["--bbox", "1", "2", "30", "40"]]
)
def test_pixels_take_commas_and_spaces(pixels: list[str]) -> None:
    from mam_sim.cli import verb_class
    from mam_sim.options import parse

    options = parse(verb_class("make-env"), "mam-sim make-env", ["a.jpg", *pixels])
    assert options.pipeline.photo.bbox == (1, 2, 30, 40)  # type: ignore[attr-defined]


def test_a_sure_reading_goes_through() -> None:
    assert why(two_drawers()) == ""


def test_doubt_about_what_it_is_is_asked_by_its_likeliest_name() -> None:
    looks = Looks({"window": 0.6, "refrigerator": 0.4})
    assert "a window (0.60) or a refrigerator" in why(two_drawers(), looks)
    doubt = doubt_about(two_drawers(), {"cuboid": "high", "panels": "high"}, PhotoOptions(), looks)
    assert doubt is not None and doubt.options["category"] == "fridge"
    assert "control panel" in " ".join(doubt.notes)


def test_what_it_is_asked_to_be_is_what_the_draft_is() -> None:
    looks = Looks({"printer": 0.5, "chest of drawers": 0.3, "desk": 0.2})
    found = two_drawers()
    found = replace(found, reading=replace(found.reading, panels=found.reading.panels * 2))
    doubt = doubt_about(found, {"cuboid": "high", "panels": "high"}, PhotoOptions(), looks)
    assert doubt is not None
    assert doubt.options["category"] == sizes_of(found, PhotoOptions(), looks).category
    shares = looks.categories()
    assert doubt.options["category"] != max(shares, key=lambda name: shares[name])  # a nightstand


def test_what_stands_open_is_called_open() -> None:
    assert "stand open (0.90)" in why(two_drawers(), opened=0.9)
    unlike = Looks({"window": 0.6, "refrigerator": 0.4})
    assert "refrigerator (0.40), and a drawer or door" in why(two_drawers(), unlike, opened=0.9)
    assert "stand open" not in why(two_drawers(), cuboid="low", opened=0.2)


def test_what_is_no_box_may_be_an_open_one() -> None:
    blurred = replace(two_drawers(), doubt=0.5)
    with pytest.raises(NotThisKind, match=r"stand open \(0\.90\): close it, or if it is one, mark"):
        stop_if_no_box(blurred, PhotoOptions(), "x.jpg", 0.9)
    with pytest.raises(NotThisKind, match="of its side\\); if it is one, mark"):
        stop_if_no_box(blurred, PhotoOptions(), "x.jpg", 0.1)


def test_closed_pictures_are_called_closed_and_nobody_looks_where_panels_are_told() -> None:
    for path in sorted((ROOT / "examples").glob("*.jpg")):
        photo = read_photo(path)
        looks = seen_as(photo, PhotoOptions())
        assert looks is not None and 0.0 < looks.opened < RULES.likely
        assert opened_in(photo, PhotoOptions(category="fridge"), None) == looks.opened
    assert opened_in(photo, parse_options({"layout": "2 drawers"}), Looks({}, 0.9)) == 0.0


def test_the_kind_of_object_decides_kinds_of_panels() -> None:
    fridge, chest = front_kinds({"refrigerator": 1.0}), front_kinds({"filingcabinet": 1.0})
    assert fridge["door left"] > 2 * fridge["drawer"] and chest["drawer"] > 9 * chest["door left"]
    assert front_kinds({}) == pytest.approx(dict.fromkeys(front_kinds({}), 1.0))
    flap = front_kinds({"dishwasher": 1.0})
    assert max(flap, key=lambda kind: flap[kind]) == "door bottom"
    half = front_kinds({"refrigerator": 0.5})
    assert 1 < half["door left"] < fridge["door left"]


def test_proportions_say_which_things_are_likely() -> None:
    looks = Looks({"dishwasher": 0.6, "refrigerator": 0.3, "sofa": 0.1})
    tall, low = (things_of(looks, PhotoOptions(), ratio) for ratio in (0.4, 0.72))
    assert tall["refrigerator"] > 0.8 and tall["dishwasher"] < 0.02
    assert low["dishwasher"] > 0.8
    assert sum(tall.values()) == pytest.approx(sum(low.values())) == pytest.approx(0.9)
    told = things_of(looks, PhotoOptions(category="dishwasher"), 0.4)
    assert told == {"dishwasher": 1.0}, "what a person says stands"


def test_tall_doors_without_sides_may_be_of_a_room() -> None:
    found = two_drawers(0.5)
    pair = tuple(Panel((x, 2.0, x + 46, 198.0), "door", "left") for x in (2.0, 52.0))
    found = replace(found, reading=replace(found.reading, panels=pair), side_share=0.0)
    one = replace(found, reading=replace(found.reading, panels=pair[:1]))
    assert may_be_a_room_door(found, PhotoOptions()) and may_be_a_room_door(one, PhotoOptions())
    assert not may_be_a_room_door(found, PhotoOptions(category="wardrobe"))
    assert not may_be_a_room_door(replace(found, side_share=0.3), PhotoOptions())
    assert not may_be_a_room_door(found, PhotoOptions(), Looks({"refrigerator": 1.0}))
    assert "door of a room" in why(found)


def test_an_object_cut_off_all_round_is_refused() -> None:
    found = two_drawers()
    assert not fills_the_picture(found)
    cut = replace(found, faces=[np.array([[-3.0, 1], [402, 0], [399, 299], [1, 301]])])
    assert fills_the_picture(cut)
    assert "cut off by the picture's edges" in why(cut)


def test_readings_share_panels_of_one_kind() -> None:
    a = list(two_drawers().reading.panels)
    assert shared(a, a) == 1.0 and shared(a, a[:1]) == pytest.approx(2 / 3)
    assert shared(a, [replace(p, kind="door") for p in a]) == 0.0
    assert shared([], []) == 1.0 and shared(a, []) == 0.0


def test_a_picture_of_noise_is_out_of_scope_from_the_command_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from mam_sim.cli import main

    rng = np.random.default_rng(0)
    photo = tmp_path / "noise.png"
    cv2.imwrite(str(photo), rng.integers(0, 255, (200, 260, 3)).astype(np.uint8))
    assert main(["make-env", str(photo), "--out", str(tmp_path / "asset"), "--quiet"]) == 4
    assert str(photo) in capsys.readouterr().err and not (tmp_path / "asset").exists()
