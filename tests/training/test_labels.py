"""Labels by eye: what is answered comes back as parts and lines of the object's own mesh."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
import trimesh

from mam_pipeline.errors import ConfigError, InputError
from mam_pipeline.weights import standing_in
from mam_training.labels.__main__ import dataset
from mam_training.labels.ask import ask_all, items_of, label_file, pack, unpack
from mam_training.labels.dataset import (
    agreement,
    agreement_table,
    labels_in,
    seen_by_weights,
    write_dataset,
)
from mam_training.labels.label import Label, faces_of, runs_of
from mam_world.ground_truth import list_objects, read_object

LABELS = Path(__file__).resolve().parents[2] / "labels"
PARTS = {"base": "body", "parts": [{
    "name": "door", "kind": "door", "pieces": [], "motion": "hinge", "axis": "z", "side": "-y",
    "opens": "-x",
}]}  # fmt: skip


@pytest.fixture
def corpus(tmp_path: Path) -> Path:
    """A corpus of one cabinet with a door in front of it."""
    folder = tmp_path / "corpus"
    (folder / "files").mkdir(parents=True)
    scene = trimesh.Scene()
    for size, at in (((0.4, 0.5, 0.6), (0, 0, 0.3)), ((0.02, 0.46, 0.5), (-0.215, 0, 0.3))):
        box = trimesh.creation.box(size, trimesh.transformations.translation_matrix(at))
        box.apply_transform(trimesh.transformations.rotation_matrix(-np.pi / 2, (1, 0, 0)))
        scene.add_geometry(box)
    scene.export(folder / "files" / "a__cabinet.glb")
    (folder / "MANIFEST.csv").write_text("id,category,repo\na__cabinet,cabinet,Some One/Kit\n")
    return folder


def _labelled(corpus: Path, work: Path, out: Path, side: str = "-y") -> Path:
    items = items_of(corpus, ["a__cabinet"])
    folder = work / "a__cabinet"
    assert ask_all(items, work, "a test", out) == 3
    with np.load(folder / "pieces.npz") as data:
        labels = data["labels"]
    answer = json.loads(json.dumps(PARTS))
    answer["parts"][0].update(pieces=[int(labels[-1])], side=side)
    (folder / "1_parts" / "answer.json").write_text(json.dumps(answer))
    assert ask_all(items, work, "a test", out) == 3
    (folder / "3_motion" / "answer.json").write_text('{"joints": []}')
    assert ask_all(items, work, "a test", out) == 0
    return label_file(out, items[0])


def test_runs_of_faces() -> None:
    assert runs_of(np.array([0, 1, 2, 7, 9, 10])) == "0+3 4 1+2"
    assert faces_of("0+3 4 1+2").tolist() == [0, 1, 2, 7, 9, 10]
    assert faces_of(runs_of(np.zeros(0, dtype=np.int64))).tolist() == []
    with pytest.raises(ValueError, match="no run of faces"):
        faces_of("3-4")


def test_a_label_is_asked_for_and_becomes_ground_truth(corpus: Path, tmp_path: Path) -> None:
    file = _labelled(corpus, tmp_path / "work", tmp_path / "labels")
    assert file == tmp_path / "labels" / "some_one_kit" / "a__cabinet.json"
    label = Label.load(file)
    door = label.parts[0]
    assert (door.motion, door.parent, label.base) == ("hinge", "body", "body")
    assert len(faces_of(door.faces)) == 12 and abs(door.axis[2]) == 1.0
    assert door.origin[1] == pytest.approx(-0.23, abs=0.03)
    assert write_dataset([file], corpus, tmp_path / "set") == 1
    name, category, urdf = list_objects(tmp_path / "set")[0]
    truth = read_object(urdf, name, category)
    assert category == "cabinet" and len(truth.joints) == 1
    assert np.abs(truth.joints[0].axis) == pytest.approx([0, 0, 1], abs=1e-6)
    assert truth.joints[0].origin[1] == pytest.approx(door.origin[1], abs=1e-5)
    assert np.bincount(truth.face_link).tolist() == [12, 12]


def test_two_labels_agree_in_part_and_differ_in_line(corpus: Path, tmp_path: Path) -> None:
    one, other = (
        Label.load(_labelled(corpus, tmp_path / f"work{side}", tmp_path / f"labels{side}", side))
        for side in ("-y", "+y")
    )
    found = agreement(one, other, corpus)
    assert found.miou == 1.0 and found.type_error == 0.0 and found.axis == 0.0
    assert found.pivot == pytest.approx(0.46 / np.linalg.norm((0.425, 0.5, 0.6)), abs=0.06)
    assert "| mean of 1 | 1.00 |" in agreement_table([(one, other)], corpus)


def test_a_coarse_piece_is_cut_and_asked_about_anew(
    corpus: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    items, folder = items_of(corpus, ["a__cabinet"]), tmp_path / "a__cabinet"
    assert ask_all(items, tmp_path, "a test", tmp_path / "labels") == 3
    (folder / "1_parts" / "answer.json").write_text("{}")
    (folder / "notes.json").write_text('{"split": [0]}')
    assert ask_all(items, tmp_path, "a test", tmp_path / "labels") == 3
    assert not (folder / "1_parts" / "answer.json").exists()
    with np.load(folder / "pieces.npz") as data:
        assert np.bincount(data["labels"]).tolist() == [2, 12, 2, 2, 2, 2, 2]  # a box's six sides
    said = capsys.readouterr().out
    assert "1 earlier answer no longer fits, as other pieces are cut" in said
    assert (folder / "before_1" / "1_parts" / "answer.json").read_text() == "{}"
    for split, why in (([99], "no piece 99"), ([0, 2], "piece 2 cannot be cut")):
        (folder / "notes.json").write_text(json.dumps({"split": split}))
        assert ask_all(items, tmp_path, "a test", tmp_path / "labels") == 2
        assert why in capsys.readouterr().out
    assert (folder / "1_parts" / "question.md").is_file()  # what was asked last still stands


def test_an_object_that_takes_too_long_is_left_out_and_said(
    corpus: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    items = items_of(corpus, ["a__cabinet"])
    assert ask_all(items, tmp_path, "a test", tmp_path / "labels", seconds=0.01) == 2
    assert "took more than 0.01 s" in capsys.readouterr().out
    assert ask_all(items, tmp_path, "a test", tmp_path / "labels", seconds=600) == 3


def test_kept_answers_are_put_back_and_give_the_same_label(corpus: Path, tmp_path: Path) -> None:
    first = Label.load(_labelled(corpus, tmp_path / "work", tmp_path / "labels"))
    archive = tmp_path / "answers.zip"
    assert pack(tmp_path / "work", archive, "a test") == 1
    with zipfile.ZipFile(archive, "a") as more:
        more.writestr("../stranger.npz", b"")
        more.writestr("a__cabinet/1_parts/run.py", b"")
    assert unpack(archive, tmp_path / "again", ["a__cabinet"]) == 1
    assert sorted(p.name for p in (tmp_path / "again").rglob("*.*")) == [
        "answer.json", "answer.json", "pieces.npz", "subject.txt", "subject.txt"
    ]  # fmt: skip
    items = items_of(corpus, ["a__cabinet"])
    assert ask_all(items, tmp_path / "again", "a test", tmp_path / "replayed") == 0
    assert Label.load(label_file(tmp_path / "replayed", items[0])) == first
    with pytest.raises(InputError, match="is there already"):
        unpack(archive, tmp_path / "again", [])
    with pytest.raises(ConfigError, match="did you mean 'a__cabinet'"):
        unpack(archive, tmp_path / "other", ["a__cabinett"])


def test_objects_that_weights_were_trained_on_are_left_out(corpus: Path, tmp_path: Path) -> None:
    labels = tmp_path / "labels"
    file = _labelled(corpus, tmp_path / "work", labels)
    seen = seen_by_weights()
    assert len(seen) == 131 and file.stem == "a__cabinet" not in seen
    assert dataset(tmp_path / "one", corpus, labels, unseen=True) == 0
    assert (tmp_path / "one" / "a__cabinet" / "object.urdf").is_file()
    with pytest.raises(InputError, match="no labelled object is left"):
        dataset(tmp_path / "none", corpus, labels, seen=True)
    known = {
        Label.load(label).id for label in labels_in(LABELS) if not Label.load(label).out_of_scope
    }
    assert seen < known


def test_weights_that_do_not_name_their_labels_are_refused(tmp_path: Path) -> None:
    (tmp_path / "parts" / "abstention").mkdir(parents=True)
    manifest = tmp_path / "parts" / "abstention" / "manifest.json"
    manifest.write_text('{"trained_on": ["labels"], "data": {"objects": 3}}')
    with standing_in(tmp_path), pytest.raises(ConfigError, match="does not name the labels"):
        seen_by_weights()


def test_notes_say_why_no_label_is_possible(
    corpus: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "work" / "a__cabinet"
    folder.mkdir(parents=True)
    (folder / "notes.json").write_text('{"out_of_scope": "one fused piece"}')
    items = items_of(corpus, ["a__cabinet"])
    assert ask_all(items, tmp_path / "work", "a test", tmp_path / "labels") == 0
    assert capsys.readouterr().out.startswith("a__cabinet: out of scope: one fused piece: ")
    label = Label.load(labels_in(tmp_path / "labels")[0])
    assert label.out_of_scope == "one fused piece" and not label.nothing_moves
    with pytest.raises(ConfigError, match="did you mean 'a__cabinet'"):
        items_of(corpus, ["a__cabinett"])
