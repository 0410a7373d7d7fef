"""The whole vision-language path with answers that were given by a look at the pictures alone.

`<object>/` in answers.zip holds what was asked, what was answered, the pieces that were shown and a
small copy of the pictures; the other archives hold answers and pieces alone. The objects themselves
are not ours to keep (answers.md).
"""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from mam_sim_bench.metrics import score
from pydantic import BaseModel

from mam_pipeline.make_config import EngineConfig
from mam_pipeline.models import photo_reader, questions, settings
from mam_pipeline.stages import Stages
from mam_pipeline.types import KinematicTree, Primitives
from mam_world.ground_truth import GroundTruth, list_objects, read_object

ARCHIVE = Path(__file__).resolve().parent / "answers.zip"
with zipfile.ZipFile(ARCHIVE) as archive:
    OBJECTS = json.loads(archive.read("about.json"))["objects"]
LATER = (
    "answers_dev2.zip",
    "answers_kitchen.zip",
    "answers_kitchen_2.zip",
    "answers_kitchen_6.zip",
)
"""Archives of answers to the questions of today, looks at the motion included."""
FEW = ("furniture_sim__microwave0", "iai_maps__apt_cabinet10", "metaworld__coffeemachine")


@pytest.fixture(scope="module")
def answers(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The archive as the folder that the file reasoner reads."""
    folder = tmp_path_factory.mktemp("answers")
    with zipfile.ZipFile(ARCHIVE) as archive:
        archive.extractall(folder)
    return folder


def _replayed(
    name: str, dataset: Path, answers: Path
) -> tuple[Stages, GroundTruth, Primitives, KinematicTree]:
    urdf = {n: (kind, path) for n, kind, path in list_objects(dataset)}
    if name not in urdf:
        pytest.skip(f"{name} is not among the real objects on this machine")
    truth = read_object(urdf[name][1], name, urdf[name][0])
    with np.load(answers / name / "pieces.npz") as data:
        primitives = Primitives(data["labels"].astype(np.int64))
    engine = Stages(EngineConfig("geometric", "embedded", "file", "embedded"))
    given = {"MAM_SIM_QUESTIONS": str(answers), settings.SUBJECT: name}
    with settings.given({**given, "MAM_SIM_VLM_SIMPLE": "0", "MAM_SIM_VLM_ROUNDS": "0"}):
        prior = engine.observe(truth.mesh, primitives)
        return engine, truth, primitives, engine.reason(truth.mesh, primitives, prior)


@pytest.mark.parametrize("name", OBJECTS)
def test_answers_fit_the_schema_of_today(name: str, answers: Path) -> None:
    first = (answers / name / "1_grouping" / "answer.json").read_text()
    grouping = questions.Grouping.model_validate_json(first)
    ids = {p for part in grouping.parts for p in part.pieces}
    assert questions.faults_of_grouping(grouping, ids) == ""
    second = (answers / name / "2_tree" / "answer.json").read_text()
    mounting = questions.Mounting.model_validate_json(second)
    names = [p.name for p in sorted(grouping.parts, key=lambda p: not p.is_base)]
    assert questions.faults_of_mounting(mounting, names, names[0]) == ""


@pytest.mark.parametrize("file", LATER)
def test_answers_of_later_archives_fit_the_questions_of_today(file: str, tmp_path: Path) -> None:
    shapes: dict[str, type[BaseModel]] = {
        "1_parts": questions.MountedParts, "1_grouping": questions.Grouping,
        "2_tree": questions.Mounting, "motion": questions.MotionCheck,
    }  # fmt: skip
    with zipfile.ZipFile(ARCHIVE.with_name(file)) as archive:
        about = json.loads(archive.read("about.json"))
        archive.extractall(tmp_path)
    assert "blind" in about["by"]
    assert sorted(p.name for p in tmp_path.iterdir() if p.is_dir()) == about["objects"]
    for name in about["objects"]:
        with np.load(tmp_path / name / "pieces.npz") as data:
            ids = set(data["labels"].tolist())
        answers = sorted((tmp_path / name).glob("*/answer.json"))
        assert answers
        for place in answers:
            kind = next(k for k in shapes if k in place.parent.name)
            answer = shapes[kind].model_validate_json(place.read_text())
            assert (place.parent / "subject.txt").read_text().strip()
            if isinstance(answer, questions.MountedParts):
                assert questions.faults_of_parts(answer, ids) == ""
            if isinstance(answer, questions.Grouping):
                assert {p for part in answer.parts for p in part.pieces} <= ids


def test_the_same_kitchen_was_answered_with_fewer_pictures() -> None:
    about = {}
    for file in ("answers_kitchen.zip", "answers_kitchen_6.zip", "answers_kitchen_2.zip"):
        with zipfile.ZipFile(ARCHIVE.with_name(file)) as archive:
            about[file] = json.loads(archive.read("about.json"))
    many, some, few = about.values()
    assert many["objects"] == some["objects"] == few["objects"]
    assert (some["pictures"], few["pictures"]) == (6, 2)
    assert many["pictures"] > 6


def test_answers_about_photos_fit_the_question_of_today() -> None:
    with zipfile.ZipFile(ARCHIVE.with_name("answers_photos.zip")) as archive:
        about = json.loads(archive.read("about.json"))
        names = [n for n in archive.namelist() if n.endswith("answer.json")]
        read = [photo_reader.PhotoReading.model_validate_json(archive.read(n)) for n in names]
        digests = [archive.read(f"{name}/photo/subject.txt") for name in about["objects"]]
    assert "language model" in about["by"] and len(set(digests)) == len(about["objects"]) == 60
    assert [photo_reader.faults(answer) for answer in read] == [""] * len(read)
    assert sum(not answer.in_scope for answer in read) == 26
    assert sum(answer.opened for answer in read) == 8


@pytest.mark.bench_data
@pytest.mark.parametrize("name", FEW)
def test_recorded_answers_are_replayed(name: str, bench_dev: Path, answers: Path) -> None:
    engine, truth, primitives, tree = _replayed(name, bench_dev, answers)
    answer = json.loads((answers / name / "1_grouping" / "answer.json").read_text())
    assert sorted(n.name for n in tree.nodes) == sorted(p["name"] for p in answer["parts"])
    used = sorted(p for node in tree.nodes for p in node.primitives)
    assert used == list(range(primitives.count))
    found = score(engine.solve(truth.mesh, primitives, tree), truth)
    assert found.miou > 0.9 and found.type_error == 0.0 and found.axis < 0.1


@pytest.mark.bench_data
@pytest.mark.slow
@pytest.mark.parametrize("name", [n for n in OBJECTS if n not in FEW])
def test_every_recorded_answer_is_about_the_pieces_that_were_shown(
    name: str, bench_dev: Path, answers: Path
) -> None:
    _, _, primitives, tree = _replayed(name, bench_dev, answers)
    assert sorted(p for node in tree.nodes for p in node.primitives) == list(
        range(primitives.count)
    )
