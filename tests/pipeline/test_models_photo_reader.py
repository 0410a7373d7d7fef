"""A model's answer about a photo: asked by file, checked, challenged, and turned into options."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from mam_pipeline.asset.origins import motion_origin
from mam_pipeline.asset.read import read_asset
from mam_pipeline.errors import BackendError, HintNeeded, NotThisKind
from mam_pipeline.hints import load_hints
from mam_pipeline.make_config import MakeConfig
from mam_pipeline.models import photo_reader
from mam_pipeline.models.photo_reader import Own, PhotoReading, faults, read_by_model
from mam_pipeline.models.settings import given
from mam_pipeline.photo.image import read_photo
from mam_pipeline.photo.options import PhotoConfig, PhotoOptions, parse_options
from mam_pipeline.photo.score import rect_quad
from mam_pipeline.run import make_asset
from mam_sim.console import Screen
from mam_sim.report import write_report
from mam_sim.studio.words import sureness
from mam_sim.verbs.articulate import describe

GOOD: dict[str, Any] = {
    "in_scope": True, "what": "a small cabinet", "category": "cabinet",
    "front": [[100, 200], [900, 200], [900, 800], [100, 800]],
    "rows": [["drawer"], ["door", "door"]],
}  # fmt: skip


@pytest.fixture
def photo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(photo_reader, "contradiction", lambda *_: "")
    monkeypatch.setattr(photo_reader, "alike", lambda *_: False)  # a grey picture has no front
    monkeypatch.setattr(photo_reader, "beside", lambda *_: ({"category": 0.85, "layout": 0.85}, ()))
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), np.full((200, 400, 3), 128, np.uint8))
    return path


def answered(folder: Path, turn: str, answer: dict[str, Any]) -> None:
    place = folder / turn
    place.mkdir(parents=True, exist_ok=True)
    (place / "answer.json").write_text(json.dumps(answer))


def test_the_question_is_put_once_and_its_answer_becomes_options(
    photo: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "questions"
    with given({"MAM_SIM_QUESTIONS": str(folder)}):
        with pytest.raises(HintNeeded, match="question"):
            read_by_model(photo, "file", {})
        assert (folder / "photo" / "photo.png").is_file()
        assert (
            "category" in json.loads((folder / "photo" / "schema.json").read_text())["properties"]
        )
        answered(folder, "photo", GOOD)
        options = read_by_model(photo, "file", {"layout": "3 drawers"}).options
    assert options["category"] == "cabinet" and options["layout"] == "3 drawers"  # the user's
    assert options["by_model"] == {"category": 0.85}
    assert options["front"] == [40, 40, 360, 40, 360, 160, 40, 160]
    parse_options(options)


def test_a_faulty_answer_is_asked_again(photo: Path, tmp_path: Path) -> None:
    folder = tmp_path / "questions"
    bad = {**GOOD, "front": GOOD["front"][::-1]}
    answered(folder, "photo", bad)
    answered(folder, "photo-2", GOOD)
    with given({"MAM_SIM_QUESTIONS": str(folder)}):
        assert read_by_model(photo, "file", {}).options["layout"] == "drawer / door, door"
        answered(folder, "photo-2", bad)
        answered(folder, "photo-3", bad)
        with pytest.raises(BackendError, match="front must be four corners") as failed:
            read_by_model(photo, "file", {})
    assert "without a model: --reader embedded" in str(failed.value)


def test_what_is_out_of_scope_is_named(photo: Path, tmp_path: Path) -> None:
    answered(tmp_path / "q", "photo", {"in_scope": False, "what": "a room door"})
    with given({"MAM_SIM_QUESTIONS": str(tmp_path / "q")}), pytest.raises(NotThisKind) as refused:
        read_by_model(photo, "file", {})
    assert "shows a room door" in str(refused.value)


@pytest.mark.parametrize(
    ("change", "fault"),
    [
        ({"category": "spaceship"}, "category must be one of"),
        ({"front": [[0, 0]]}, "four corners"),
        ({"front": [[0, 0], [9000, 0], [9000, 900], [0, 900]]}, "lie in the picture"),
        ({"rows": [["door"] * 61]}, "between 1 and 60 panels"),
    ],
)
def test_faults_are_told(change: dict[str, Any], fault: str) -> None:
    assert fault in faults(PhotoReading(**{**GOOD, **change}))
    assert faults(PhotoReading(**GOOD)) == ""


@pytest.fixture(scope="module")
def nightstand() -> Own:
    root = Path(__file__).resolve().parents[2]
    return Own(read_photo(root / "examples" / "nightstand.jpg"), PhotoOptions())


def thousandths(own: Own, off: float = 0.0) -> Any:
    """The measured front as an answer gives it, moved by some thousandths."""
    return (own.found.quad / np.array(own.photo.size) * 1000 + off).round().tolist()


def test_a_front_far_from_the_measured_one_is_challenged(nightstand: Own) -> None:
    off = PhotoReading(**{**GOOD, "front": [[0, 0], [50, 0], [50, 50], [0, 50]]})
    said = photo_reader.contradiction(off, nightstand, {})
    assert said.startswith("the lines in the photo fit a box")
    corners = json.loads(said[said.index("[[") :])
    same = PhotoReading(**{**GOOD, "front": corners})
    assert photo_reader.contradiction(same, nightstand, {}) == ""


def test_what_both_read_alike_is_of_high_confidence_and_the_rest_is_told(nightstand: Own) -> None:
    three = {**GOOD, "front": thousandths(nightstand, 8.0), "rows": [["drawer"]] * 3}
    seen = sum(len(p.handles) for p in nightstand.found.reading.movable)
    sure, notes = photo_reader.beside(PhotoReading(**three, handles=seen), nightstand, {}, "vlm")
    assert sure == {"category": 0.85, "front": 0.95, "layout": 0.95, "handles": 0.95}
    assert notes == ("the vlm reader and this program agree on box, panels, handles",)
    other = {**three, "rows": [["door-left"]], "height": 0.6}
    sure, notes = photo_reader.beside(PhotoReading(**other), nightstand, {}, "vlm")
    assert sure == {"category": 0.85, "front": 0.95, "layout": 0.85}
    assert "differ on panels: it reads door-left, this program 3 drawers" in notes[1]
    assert "0.6 m high" in notes[2]
    assert photo_reader.beside(
        PhotoReading(**other), nightstand, {"front": 1, "layout": 1, "height": 1}, "vlm"
    ) == ({"category": 0.85}, ())


def boxes(own: Own, off: float = 0.0) -> list[list[float]]:
    """The measured handles as an answer gives them, moved by some thousandths."""
    size = np.array(own.found.reading.image.shape[1::-1] * 2)
    return [
        [round(float(v)) for v in (*quad.min(axis=0), *quad.max(axis=0))]
        for p in own.found.reading.movable for b in p.handles
        for quad in [
            rect_quad(tuple(np.array(b.box) / size), own.found.quad)
            / np.array(own.photo.size) * 1000 + off
        ]
    ]  # fmt: skip


def test_handles_are_held_against_the_measured_ones(nightstand: Own) -> None:
    three = {**GOOD, "front": thousandths(nightstand), "rows": [["drawer"]] * 3}
    near = PhotoReading(**three, handle_boxes=boxes(nightstand, 10.0))
    sure, notes = photo_reader.beside(near, nightstand, {}, "vlm")
    assert near.handles_seen == 3 and sure["handles"] == 0.95 and "handles" in notes[0]
    far = PhotoReading(**three, handles=3, handle_boxes=boxes(nightstand, 150.0))
    sure, notes = photo_reader.beside(far, nightstand, {}, "vlm")
    assert sure["handles"] == 0.85 and "it reads 3, this program 3, 0 of them in these" in notes[1]


def test_a_handle_off_the_front_is_left_out_and_a_box_without_area_is_none(
    photo: Path, tmp_path: Path
) -> None:
    handles = [[450, 300, 550, 330], [5, 5, 20, 20], [600, 600, 600, 700]]
    answered(tmp_path / "q", "photo", {**GOOD, "handles": 2, "handle_boxes": handles})
    with given({"MAM_SIM_QUESTIONS": str(tmp_path / "q")}):
        read = read_by_model(photo, "file", {})
    assert read.options["handles"] == [[180, 60, 220, 66]]
    assert any("2 of the 3 handles" in note for note in read.notes)
    assert parse_options(read.options).handles == ((180, 60, 220, 66),)


def test_what_the_user_says_that_it_is_outranks_the_models_category(
    photo: Path, tmp_path: Path
) -> None:
    answered(tmp_path / "q", "photo", {**GOOD, "category": "fridge"})
    with given({"MAM_SIM_QUESTIONS": str(tmp_path / "q")}):
        assert "category" not in read_by_model(photo, "file", {"things": {"wardrobe": 1.0}}).options
        same = read_by_model(photo, "file", {"things": {"refrigerator": 1.0}}).options
        by_file = read_by_model(photo, "file", {"things": {"wardrobe": 0.7}}).options
    assert same["category"] == by_file["category"] == "fridge"


def test_an_endpoint_reads_a_photo_and_the_measured_corners_are_taken(
    nightstand: Own, endpoint: Callable[[list[tuple[int, str]]], Any], tmp_path: Path
) -> None:
    answer = {**GOOD, "category": "nightstand", "front": thousandths(nightstand, 8.0),
              "rows": [["drawer"], ["drawer"], ["drawer"]], "handles": 3,
              "handle_boxes": boxes(nightstand, 5.0)}  # fmt: skip
    stand = endpoint([(200, json.dumps(answer))])
    photo = Path(__file__).resolve().parents[2] / "examples" / "nightstand.jpg"
    config = replace(MakeConfig(), photo=replace(MakeConfig().photo, reader="vlm"))
    asset = make_asset(photo, tmp_path / "made", config)
    assert len(stand.asked) == 1
    assert [j.subtype for j in asset.card.joints] == ["slide"] * 3
    assert any("agree on box, panels, handles" in note for note in asset.card.notes)
    assert any("box high, panels high, handles high" in note for note in asset.card.notes)
    assert asset.card.backends["reader"]["name"] == "vlm"
    schema = stand.asked[0]["response_format"]["json_schema"]["schema"]
    assert "handle_boxes" in schema["properties"]


def test_nothing_that_a_model_says_of_a_photo_is_told_as_the_users(
    nightstand: Own, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    photo = Path(__file__).resolve().parents[2] / "examples" / "nightstand.jpg"
    said = {"category": "nightstand", "front": thousandths(nightstand, 8.0),
            "rows": [["drawer"], ["drawer"], ["door-left"]]}  # fmt: skip
    answered(tmp_path / "q", "photo", {**GOOD, **said})
    config = MakeConfig(photo=PhotoConfig(reader="file"))
    with given({"MAM_SIM_QUESTIONS": str(tmp_path / "q")}):
        asset = make_asset(photo, tmp_path / "made", config)
    by_model = "inferred by a language model, 83 % sure"
    assert [j.provenance for j in asset.card.joints] == ["model"] * 3
    joints = json.loads((asset.folder / "asset.json").read_text())["joints"]
    assert [j["origins"]["motion"] for j in joints] == [by_model] * 3
    describe(Screen(False), asset)
    page = write_report(asset).read_text(encoding="utf-8")
    shown = capsys.readouterr().out + page + (asset.folder / "asset.json").read_text()
    assert shown.count(by_model) >= 9 and "said by you" not in shown
    articulation = read_asset(asset)
    assert all("83 %" in sureness(j, "photo") for j in articulation.joints)
    assert not any(p.provenance == "user" for p in load_hints(
        asset.folder / "stages" / "0_photo" / "hints.yaml").parts)  # fmt: skip
    typed = replace(config.photo, layout="2 drawers / door-left")
    with given({"MAM_SIM_QUESTIONS": str(tmp_path / "q")}):
        own = make_asset(photo, tmp_path / "own", replace(config, photo=typed))
    assert {str(motion_origin(j, "photo")) for j in own.card.joints} == {"said by you"}


def test_an_open_object_is_asked_to_be_closed(photo: Path, tmp_path: Path) -> None:
    answered(tmp_path / "q", "photo", {**GOOD, "opened": True})
    with given({"MAM_SIM_QUESTIONS": str(tmp_path / "q")}):
        with pytest.raises(HintNeeded, match="stands open, as the file reader says"):
            read_by_model(photo, "file", {})
        assert read_by_model(photo, "file", {"layout": "door"}).options["layout"] == "door"


def test_an_open_object_is_not_measured_against_the_answer(tmp_path: Path) -> None:
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), np.full((200, 400, 3), 128, np.uint8))
    own = Own(read_photo(path), PhotoOptions())
    answer = PhotoReading.model_validate({**GOOD, "opened": True})
    assert photo_reader.contradiction(answer, own, {}) == ""
    assert "found" not in vars(own)
