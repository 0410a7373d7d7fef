"""The benchmark: reading URDF datasets, running, resuming and the table."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from mam_sim_bench import runner
from mam_sim_bench.bench import Bench
from mam_sim_bench.config import BenchConfig
from mam_sim_bench.metrics import FoundJoint, score
from mam_sim_bench.runner import Record, Task, find_tasks, record_from, run_bench
from mam_sim_bench.table import (
    PAPER,
    as_json,
    by_category,
    calibration,
    intervals,
    models_of,
    motionless_line,
    review_line,
    seen_line,
    summarise,
)

from mam_pipeline import config_file
from mam_pipeline.errors import ConfigError, InputError
from mam_pipeline.types import DormantPart, Primitives
from mam_sim.cli import main
from mam_sim.options import parse
from mam_world.ground_truth import list_objects, read_object
from mam_world.splits import split_of
from mam_world.truth import generated_truth

DEV = Path(__file__).resolve().parents[2].parent / "shared" / "bench" / "dev"

URDF = """<robot name="t">
 <link name="world"/>
 <link name="body"><visual><geometry><box size="1 1 1"/></geometry></visual></link>
 <link name="dummy"/>
 <link name="door"><visual><origin xyz="0.5 0 0"/><geometry><box size="1 0.02 1"/></geometry>
  </visual></link>
 <link name="knob"><collision><geometry><cylinder radius="0.05" length="0.1"/></geometry>
  </collision></link>
 <link name="lost"><visual><geometry><mesh filename="none.stl"/></geometry></visual></link>
 <joint name="a" type="fixed"><parent link="world"/><child link="body"/>
  <origin xyz="0 0 1"/></joint>
 <joint name="b" type="prismatic"><parent link="body"/><child link="dummy"/>
  <axis xyz="0 1 0"/><limit lower="0" upper="0.02" effort="1" velocity="1"/>
  <mimic joint="c"/></joint>
 <joint name="c" type="revolute"><parent link="dummy"/><child link="door"/>
  <origin xyz="-0.5 -0.52 0"/><axis xyz="0 0 -2"/>
  <limit lower="0" upper="1.5" effort="1" velocity="1"/></joint>
 <joint name="d" type="fixed"><parent link="door"/><child link="knob"/>
  <origin xyz="0.9 -0.1 0"/></joint>
 <joint name="e" type="floating"><parent link="body"/><child link="lost"/></joint>
</robot>"""


@pytest.fixture
def dataset(tmp_path: Path) -> Path:
    folder = tmp_path / "set" / "thing"
    folder.mkdir(parents=True)
    (folder / "object.urdf").write_text(URDF)
    (tmp_path / "set" / "MANIFEST.csv").write_text("id,category\nthing,Cabinet\n")
    return tmp_path / "set"


@pytest.mark.filterwarnings("ignore")
def test_a_urdf_becomes_one_mesh_and_its_joint(dataset: Path) -> None:
    truth = read_object(dataset / "thing" / "object.urdf")
    assert len(truth.links) == 2 and len(truth.joints) == 1
    joint = truth.joints[0]
    assert (joint.type, joint.parent, joint.child) == ("revolute", 0, 1)
    assert np.allclose(joint.axis, [0, 0, -1]) and np.allclose(joint.origin, [-0.5, -0.52, 1])
    assert (joint.lower, joint.upper) == (0, 1.5)
    low, high = truth.mesh.bounds
    assert np.allclose(low[2], 0.5) and np.allclose(high[2], 1.5)
    # the knob is fixed to the door and shows its collision shape
    door = truth.mesh.submesh(truth.face_link == 1)
    assert np.allclose(door.bounds[0], [-0.5, -0.67, 0.5], atol=0.003)


@pytest.mark.filterwarnings("ignore")
def test_faces_are_shuffled_the_same_way_each_time(dataset: Path) -> None:
    a = read_object(dataset / "thing" / "object.urdf")
    b = read_object(dataset / "thing" / "object.urdf")
    assert (a.mesh.faces == b.mesh.faces).all()
    assert (np.diff(a.face_link) != 0).sum() > 2


@pytest.mark.filterwarnings("ignore")
def test_no_name_is_shown_unless_it_is_asked_for(dataset: Path) -> None:
    hidden = read_object(dataset / "thing" / "object.urdf")
    assert hidden.mesh.face_group is not None
    assert hidden.mesh.group_names == ("mesh",) and not hidden.mesh.face_group.any()
    (task,) = find_tasks(str(dataset))
    shown = task.load(named=True)
    assert shown.mesh.group_names == ("body", "door", "knob")
    assert (shown.mesh.faces == hidden.mesh.faces).all()
    assert shown.mesh.face_group is not None
    door = shown.mesh.submesh(shown.mesh.face_group == 1)
    assert np.allclose(door.bounds, [[-0.5, -0.53, 0.5], [0.5, -0.51, 1.5]])


def test_a_result_says_whether_a_model_was_trained_on_its_objects(dataset: Path) -> None:
    truth = read_object(dataset / "thing" / "object.urdf")
    scores = score(truth.truth_articulation(), truth)
    rooms = ("parts/abstention", "parts/authored")
    record = Record("a", "b", "k", "ok", "", scores, 1.0, {}, 1, 1, None, weights=rooms)
    models = models_of([record], str(dataset))
    assert [w["room"] for w in models["weights"]] == list(rooms) and models["unseen"] is True
    assert seen_line(models, str(dataset)) == "models: none was trained on set"
    (source,) = models["weights"][0]["trained_on"]
    models = models_of([record], f"somewhere/{source}")
    assert models["unseen"] is False
    assert seen_line(models, source).startswith("models: parts/abstention were trained on")
    assert models_of([record], "generated:test")["unseen"] is None


def test_listing(dataset: Path, tmp_path: Path) -> None:
    assert list_objects(dataset)[0][:2] == ("thing", "Cabinet")
    with pytest.raises(InputError, match="no dataset folder"):
        list_objects(tmp_path / "nothing")
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="no URDF object"):
        list_objects(tmp_path / "empty")
    with pytest.raises(ConfigError, match="no object 'other'"):
        find_tasks(str(dataset), ["other"])


@pytest.mark.filterwarnings("ignore")
def test_a_failing_engine_is_a_record_and_is_reused(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []

    def broken(*_args: object, **_kwargs: object) -> None:
        calls.append(1)
        raise ValueError("boom")

    monkeypatch.setattr(runner, "articulate_mesh", broken)
    tasks = find_tasks(str(dataset))
    config = BenchConfig(execute=False)
    log = tmp_path / "log.jsonl"
    (first,) = run_bench(tasks, config, log)
    assert first.status == "error" and "boom" in first.why and first.scores.miou == 0
    log.write_text(log.read_text() + '{"id": "cut sho')  # killed while writing
    (again,) = run_bench(tasks, config, log)
    assert calls == [1] and again == first
    run_bench(tasks, BenchConfig(execute=False, fuse=True), log)
    assert calls == [1, 1]
    assert record_from(json.loads(json.dumps(asdict(first)))) == first
    data = as_json([first], "set", config)
    assert json.dumps(data, allow_nan=False) and data["total"]["miou"] == 0
    assert summarise("x", [first]).pivot == 0.5 and by_category([first])[0].name == "Cabinet"
    assert PAPER[0].miou == 0.86


def test_wrong_joints_that_nobody_is_sent_to_are_counted(dataset: Path) -> None:
    (task,) = find_tasks(str(dataset))
    truth = task.load()
    answer = truth.truth_articulation()
    records = []
    for confidence, axis in [(0.9, None), (0.3, None), (0.9, (0, 1, 0)), (0.3, (0, 1, 0))]:
        joint = replace(answer.joints[0], confidence=confidence)
        joint = joint if axis is None else replace(joint, axis=np.array(axis, dtype=float))
        scores = score(replace(answer, joints=(joint,)), truth)
        key = f"{confidence}{axis}"
        records.append(Record("a", "b", key, "ok", "", scores, 1.0, {}, 1, 1, None))
    row = summarise("x", records)
    assert (row.flagged_wrong, row.flagged_right) == (0.5, 0.5)
    assert review_line(records[:3]) == (
        "needs review: of 3 joints found, 0 of 1 wrong ones and 1 of 2 right ones"
    )
    assert record_from(json.loads(json.dumps(asdict(records[3])))) == records[3]


def _records(dataset: Path) -> list[Record]:
    """The object found rightly at two seeds, and a motionless one that got a joint."""
    truth = read_object(dataset / "thing" / "object.urdf")
    right = score(truth.truth_articulation(), truth)
    false = replace(right, true_parts=0, miou=0.0, count=0.0, pivot=None)
    made = [("a", right), ("a", right), ("rock", false)]
    return [Record(name, "c", "k", "ok", "", scores, 1.0, {}, 0, 0, None) for name, scores in made]


@pytest.mark.filterwarnings("ignore")
def test_intervals_are_over_objects_and_false_joints_are_counted(dataset: Path) -> None:
    records = _records(dataset)
    low, high = intervals(records)
    assert low.miou == pytest.approx(0.0) and high.miou == pytest.approx(1.0)
    assert low.pivot == high.pivot == pytest.approx(0.0)  # the rock has none
    assert low.executable is None
    assert motionless_line(records) == "false joints: 1 of 1 objects in which nothing moves"
    assert motionless_line(records[:2]) == ""
    assert as_json(records, "set", BenchConfig())["interval"][1]["miou"] == pytest.approx(1.0)


@pytest.mark.filterwarnings("ignore")
def test_confidence_is_compared_with_how_often_it_is_right(dataset: Path) -> None:
    records = _records(dataset)[:1]
    found = (FoundJoint(0.95, True), FoundJoint(0.95, True), FoundJoint(0.25, True))
    said = calibration([replace(records[0], scores=replace(records[0].scores, found=found))])
    assert said["joints"] == 3
    assert said["error"] == pytest.approx((2 * 0.05 + 0.75) / 3, abs=1e-4)
    assert (said["true"], said["wrong"], said["unmarked"], said["unmarked_sure"]) == (1, 0, 0, 0)
    assert calibration([])["error"] == 0.0 and calibration([])["bins"] == []


@pytest.mark.filterwarnings("ignore")
def test_a_wrong_joint_that_nobody_is_sent_to_is_counted_apart(dataset: Path) -> None:
    records = _records(dataset)[:1]
    found = (
        FoundJoint(0.9, False), FoundJoint(0.75, False), FoundJoint(0.3, False),
        FoundJoint(0.95, False, short=True), FoundJoint(0.95, True),
    )  # fmt: skip
    said = calibration([replace(records[0], scores=replace(records[0].scores, found=found))])
    assert (said["wrong"], said["unmarked"], said["unmarked_sure"]) == (4, 2, 1)


def test_seeds_are_runs_that_differ_in_the_seed_alone() -> None:
    first = BenchConfig(seeds=3, counts=True)
    assert [c.engine.seed for c in first.seeded()] == [0, 1, 2]
    assert all(c.seeds == 1 and c.counts for c in first.seeded())
    assert first.told() == ", with counts"


@pytest.mark.filterwarnings("ignore")
def test_the_engine_is_told_how_many_parts_of_each_kind_there_are(dataset: Path) -> None:
    truth = read_object(dataset / "thing" / "object.urdf")
    told = runner._spec(truth, BenchConfig(counts=True)).counts
    assert [(c.kind, c.count, c.said.origin) for c in told] == [("door", 1, "user")]


def test_motionless_objects_are_a_dataset() -> None:
    tasks = find_tasks("generated:motionless", limit=3)
    assert len(tasks) == 3
    truth = tasks[0].load()
    assert not [joint for joint in truth.joints if joint.type != "fixed"]


def test_kinds_that_were_held_back_are_a_dataset() -> None:
    tasks = find_tasks("generated:unseen", limit=28)
    assert len({t.category for t in tasks}) == 14 and len({t.id for t in tasks}) == 28
    assert {split_of(t.category, t.seed) for t in tasks} == {"test"}
    assert {split_of(t.category, 0) for t in tasks} == {"test"}  # no seed of theirs is trained on
    assert models_of([], "generated:unseen")["unseen"] is True


def test_generated_truth_scores_itself() -> None:
    (task,) = find_tasks("generated:validation", limit=1)
    truth = task.load()
    assert score(truth.truth_articulation(), truth).miou > 0.8
    assert truth.mesh.group_names == ("mesh",)


def test_a_true_part_that_is_dormant_is_counted_as_such(monkeypatch: pytest.MonkeyPatch) -> None:
    truth = generated_truth("cabinet_one_door", 3)
    whole = truth.truth_articulation()
    (joint,) = (j for j in whole.joints if j.type != "fixed")
    door, rest = whole.links[joint.child], [j for j in whole.joints if j is not joint]
    host = whole.links[joint.parent]
    links = list(whole.links)
    links[joint.parent] = replace(host, faces=np.concatenate([host.faces, door.faces]))
    if joint.child != len(links) - 1:
        pytest.fail("the door is not the last link, so the others would be numbered anew")
    asleep = replace(
        whole, links=tuple(links[:-1]), joints=tuple(rest),
        dormant=(DormantPart(door, replace(joint, child=-1)),),
    )  # fmt: skip
    for found, counts in ((whole, (1, 0)), (asleep, (0, 1))):
        run = SimpleNamespace(
            articulation=found, seconds={}, used={},
            primitives=Primitives(np.zeros(len(truth.mesh.faces), dtype=np.int64)),
        )  # fmt: skip
        monkeypatch.setattr(runner, "articulate_mesh", lambda *_, run=run, **__: run)
        record = runner.run_task(
            Task("cabinet_one_door_3", "cabinet_one_door", "generated:test", 3),
            BenchConfig(execute=False),
        )
        assert (record.awake, record.dormant) == counts and record.scores.true_parts == 1


@pytest.mark.bench_data
@pytest.mark.skipif(not DEV.is_dir(), reason="../shared/bench/dev is not there")
def test_dev_objects_read_and_primitives_bound() -> None:
    from mam_pipeline.segment.geometric import GeometricSegmenter

    for name in ("metaworld__laptop", "iai_maps__apt_cabinet2", "calvin__table_D"):
        truth = read_object(DEV / name / "object.urdf", name)
        labels = GeometricSegmenter().segment(truth.mesh).labels
        assert runner.grouping_bound(truth.mesh, labels, truth) > 0.8


@pytest.mark.filterwarnings("ignore")
def test_the_verb_writes_the_figures_and_the_settings_beside_them(
    dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_args: object, **_kwargs: object) -> None:
        raise ValueError("boom")

    monkeypatch.setattr(runner, "articulate_mesh", broken)
    out = tmp_path / "found.json"
    args = [str(dataset), "--out", str(out), "--no-exec", "--prior", "none", "--quiet"]
    assert main(["bench", *args]) == 0
    data = json.loads(out.read_text())
    assert data["objects"][0]["status"] == "error"
    settings = config_file.read(out.with_suffix(".yaml"))
    assert settings == data["config"] and settings["bench"]["engine"]["prior"] == "none"
    again = parse(Bench, "mam-sim bench", ["x", "--config", str(out.with_suffix(".yaml"))])
    assert config_file.plain(again.bench) == settings["bench"]  # type: ignore[attr-defined]
