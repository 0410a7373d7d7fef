"""A model's answer about a photo: asked by file, checked, challenged, and turned into options."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from mam_pipeline.errors import BackendError, HintNeeded, NotThisKind
from mam_pipeline.models import photo_reader
from mam_pipeline.models.photo_reader import PhotoReading, faults, read_by_model
from mam_pipeline.models.settings import given
from mam_pipeline.photo.options import parse_options

GOOD: dict[str, Any] = {
    "in_scope": True, "what": "a small cabinet", "category": "cabinet",
    "front": [[100, 200], [900, 200], [900, 800], [100, 800]],
    "rows": [["drawer"], ["door", "door"]],
}  # fmt: skip


@pytest.fixture
def photo(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(photo_reader, "contradiction", lambda *_: "")
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
        options = read_by_model(photo, "file", {"layout": "3 drawers"})
    assert options["category"] == "cabinet" and options["layout"] == "3 drawers"  # the user's
    assert options["front"] == [40, 40, 360, 40, 360, 160, 40, 160]
    parse_options(options)


def test_a_faulty_answer_is_asked_again(photo: Path, tmp_path: Path) -> None:
    folder = tmp_path / "questions"
    bad = {**GOOD, "front": GOOD["front"][::-1]}
    answered(folder, "photo", bad)
    answered(folder, "photo-2", GOOD)
    with given({"MAM_SIM_QUESTIONS": str(folder)}):
        assert read_by_model(photo, "file", {})["layout"] == "drawer / door, door"
        answered(folder, "photo-2", bad)
        answered(folder, "photo-3", bad)
        with pytest.raises(BackendError, match="front must be four corners"):
            read_by_model(photo, "file", {})


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


def test_a_front_far_from_the_measured_one_is_challenged() -> None:
    from mam_pipeline.photo.image import read_photo

    root = Path(__file__).resolve().parents[2]
    photo = read_photo(root / "examples" / "nightstand.jpg")
    off = PhotoReading(**{**GOOD, "front": [[0, 0], [50, 0], [50, 50], [0, 50]]})
    said = photo_reader.contradiction(off, photo, {})
    assert said.startswith("the lines in the photo fit a box")
    corners = json.loads(said[said.index("[[") :])
    assert photo_reader.contradiction(PhotoReading(**{**GOOD, "front": corners}), photo, {}) == ""
