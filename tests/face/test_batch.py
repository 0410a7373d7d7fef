"""A batch: nothing done twice, nothing lost, and one object's end is not the others'."""

from __future__ import annotations

import csv
import importlib
import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path
from typing import Any

import pytest

from mam_pipeline.errors import ConfigError, InputError
from mam_pipeline.guarded import Limits
from mam_sim.batch.inputs import content_digest, find_inputs
from mam_sim.batch.pages import write_pages
from mam_sim.batch.record import Record, Target
from mam_sim.batch.run import Pace, held, plan, run
from mam_sim.cli import main

HERE = Path(__file__).resolve().parent
DRIVER = """
import sys
from mam_sim.batch.inputs import find_inputs
from mam_sim.batch.record import Target
from mam_sim.batch.run import plan, run
from mam_pipeline.guarded import Limits
from batch_work import Quick
folder, out, log = sys.argv[1:4]
target = Target(out)
target.prepare()
todo = plan(find_inputs([folder]), Quick(log=log, seconds=0.15), target, Limits())
print(len(todo.done), flush=True)
for _ in run(todo.left, 2):
    pass
"""


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A kind of work that the processes of a batch can import as this one does."""
    monkeypatch.syspath_prepend(str(HERE))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
    return importlib.import_module("batch_work").Quick


def _inputs(folder: Path, words: list[str]) -> Path:
    folder.mkdir()
    for i, word in enumerate(words):
        (folder / f"{word}_{i}.glb").write_text(f"{word} {i}")
    return folder


def test_a_guard_or_a_crash_ends_one_object_with_its_reason(tmp_path: Path, quick: Any) -> None:
    words = ["fine", "hang", "eat", "crash", "refuse", "break", "fine"]
    folder, log = _inputs(tmp_path / "in", words), tmp_path / "log"
    target, limits = Target(str(tmp_path / "out")), Limits(seconds=12.0, memory=0.5)
    target.prepare()
    work = quick(log=str(log))
    todo = plan(find_inputs([str(folder)]), work, target, limits)
    found = {r.name.split("_")[0]: r for r in run(todo.left, 2)}
    assert {k: r.status for k, r in found.items()} == {
        "fine": "passes", "hang": "timeout", "eat": "memory", "crash": "crash",
        "refuse": "bad input", "break": "error",
    }  # fmt: skip
    assert found["hang"].reason == "it took longer than 12 s" and found["hang"].limit == 12.0
    assert found["eat"].reason == "it took more than 0.5 GB of memory"
    assert "Segmentation fault" in found["crash"].reason
    assert found["crash"].log == "a word before the end\n"
    assert found["break"].reason == "ZeroDivisionError: a bug"
    assert len(log.read_text().split()) == 2

    again = plan(find_inputs([str(folder)]), work, target, limits)
    assert not again.left and {r.status for r in again.done} == {r.status for r in found.values()}
    wider = plan(find_inputs([str(folder)]), work, target, Limits(seconds=15.0, memory=0.5))
    assert [j.item.label for j in wider.left] == ["hang_1"]  # a limit is no part of the result
    retried = plan(find_inputs([str(folder)]), work, target, limits, retry=True)
    assert len(retried.left) == 5


def test_what_is_killed_is_made_once_more_alone_and_its_row_says_so(
    tmp_path: Path, quick: Any
) -> None:
    folder, log = _inputs(tmp_path / "in", ["killed", "fine", "killed-once"]), tmp_path / "log"
    target = Target(str(tmp_path / "out"))
    target.prepare()
    todo = plan(find_inputs([str(folder)]), quick(log=str(log)), target, Limits())
    found = {r.name.split("_")[0]: r for r in run(todo.left, 2)}
    assert {k: (r.status, r.tries) for k, r in found.items()} == {
        "killed": ("crash", 2), "fine": ("passes", 1), "killed-once": ("passes", 2),
    }  # fmt: skip
    assert found["killed"].reason.endswith("so it was when it was tried once more, alone")
    assert target.records() == {r.name: r for r in found.values()}


HOSTILE: dict[str, Any] = {
    "nothing.txt": b"absent.glb\n", "itself.txt": b"itself.txt\n", "one.txt": b"two.txt",
    "two.txt": b"one.txt", "binary.txt": bytes(range(128, 256)), "nul.txt": b"a\0b.glb\n",
    "long.txt": b"x" * 5000, "pattern.txt": b"*.nothing", "empty.txt": b"# empty\n",
    "break_1.glb": b"break", "refuse_1.glb": b"refuse", "crash_1.glb": b"crash",
}  # fmt: skip


def _hostile(folder: Path, sound: int, each: int) -> list[str]:
    """Sound inputs and bad ones; their words for a batch."""
    words = []
    for i in range(sound):
        (folder / f"fine_{i}.glb").write_text(f"fine {i}")
        words.append(f"fine_{i}.glb")
    os.symlink("nowhere", folder / "link.glb")
    os.mkfifo(folder / "pipe.glb")
    (folder / "folder").mkdir()
    name = os.fsdecode(b"\xff\xfe.glb")
    (folder / name).write_text("fine too")
    words += ["link.glb", "pipe.glb", "folder", name, "gone.glb"]
    for k in range(each):
        for place, content in HOSTILE.items():
            file = folder / (f"{k}{place}" if place.endswith(".glb") else place)
            file.write_bytes(content + b" %d" % k if place.endswith(".glb") else content)
            words.append(file.name)
    return [str(folder / w) for w in dict.fromkeys(words) if w != "empty.txt"]


@pytest.mark.parametrize(
    "sound, each, rows", [(4, 1, 20), pytest.param(20, 3, 42, marks=pytest.mark.slow)]
)
def test_a_batch_with_hostile_inputs_ends_with_a_row_for_each(
    tmp_path: Path, quick: Any, sound: int, each: int, rows: int
) -> None:
    (tmp_path / "in").mkdir()
    words = _hostile(tmp_path / "in", sound, each)
    target = Target(str(tmp_path / "out"))
    target.prepare()
    todo = plan(find_inputs(words), quick(log=str(tmp_path / "log")), target, Limits())
    write_pages(list(run(todo.left, 2)), target, report=False)
    with (tmp_path / "out" / "manifest.csv").open(encoding="utf-8") as stream:
        found = list(csv.DictReader(stream))
    assert len(words) == len(found) == rows
    status = Counter(row["status"] for row in found)
    assert status["passes"] == sound + 1  # a name that is no text is as good as any
    assert all(row["reason"] for row in found if row["status"] != "passes")
    assert "\\udcff\\udcfe.glb" in {row["source"].rpartition("/")[2] for row in found}


@pytest.mark.parametrize("change", [
    {"status": "banana"}, {"status": None}, {"seconds": "x"}, {"seconds": float("nan")},
    {"joints": 5}, {"joints": [["a"]]}, {"confidences": ["a"]}, {"check": None},
    {"backends": [1]}, {"name": "../../x"}, {"name": 5}, {"status": "timeout", "limit": "x"},
])  # fmt: skip
def test_a_record_that_is_none_is_made_again(tmp_path: Path, change: dict[str, Any]) -> None:
    target = Target(str(tmp_path / "out"))
    target.prepare()
    target.save(Record("a-1", "a.glb", "1", "k", "passes"))
    file = tmp_path / "out" / "records" / "a-1.json"
    assert set(target.records()) == {"a-1"}
    file.write_text(json.dumps({**json.loads(file.read_text()), **change}))
    assert target.records() == {}


def test_a_record_is_an_ordinary_file_and_a_batch_writes_through_no_link(
    tmp_path: Path, quick: Any
) -> None:
    theirs, source = tmp_path / "theirs", _inputs(tmp_path / "in", ["fine"])
    (theirs / "empty").mkdir(parents=True)
    (theirs / "lock").write_text("mine")
    target = Target(str(tmp_path / "out"))
    target.prepare()
    (item,) = find_inputs([str(source)])
    record = tmp_path / "out" / "records" / f"{item.name}.json"
    asset = tmp_path / "out" / "assets" / item.name
    os.mkfifo(record)
    assert target.records() == {}
    record.unlink()
    record.mkdir()
    asset.symlink_to(theirs / "empty")
    todo = plan([item], quick(log=str(tmp_path / "log")), target, Limits())
    (row,) = run(todo.left)
    assert row.status == "error" and "record cannot be written" in row.reason
    assert not list((theirs / "empty").iterdir())
    record.rmdir()
    (row,) = run(todo.left)
    assert row.status == "error" and "is a link, and nothing is written through one" in row.reason

    (tmp_path / "out" / ".lock").symlink_to(theirs / "lock")
    with pytest.raises(ConfigError, match="is a link"), held(target):
        pass
    assert (theirs / "lock").read_text() == "mine"
    for part in ("assets", "records", "pictures"):
        other = Target(str(tmp_path / part))
        (tmp_path / part).mkdir()
        (tmp_path / part / part).symlink_to(theirs)
        with pytest.raises(ConfigError, match=f"{part} is a link"):
            other.prepare()


@pytest.mark.parametrize("address", ["nosuch://x", "://x", "zip://x", "abfs://x", " "])
def test_an_address_that_nobody_serves_is_refused_in_a_sentence(
    address: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "a.glb").write_text("fine")
    assert main(["batch", str(tmp_path / "a.glb"), "--out", address]) == 2
    assert f"--out {address}" in capsys.readouterr().err


def test_killed_in_the_middle_nothing_is_done_twice_and_nothing_lost(
    tmp_path: Path, quick: Any
) -> None:
    folder, log, out = _inputs(tmp_path / "in", ["fine"] * 16), tmp_path / "log", tmp_path / "out"
    command = [sys.executable, "-c", DRIVER, str(folder), str(out), str(log)]
    first = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    while len(list((out / "records").glob("*.json"))) < 4:
        assert first.poll() is None
        time.sleep(0.02)
    first.send_signal(signal.SIGKILL)
    first.wait()
    time.sleep(0.3)  # its children are gone with it
    records = set((out / "records").glob("*.json"))
    time.sleep(0.5)
    assert set((out / "records").glob("*.json")) == records and len(records) < 16
    second = subprocess.run(command, capture_output=True, text=True, check=True)
    assert int(second.stdout) == len(records)
    made = Counter(log.read_text().split())
    assert len(made) == 16
    finished = {p.stem for p in records}
    assert all(count == 1 for name, count in made.items() if name in finished)


def test_a_name_is_of_the_content_and_textures_are_no_inputs(tmp_path: Path) -> None:
    scan = tmp_path / "scans" / "chair"
    scan.mkdir(parents=True)
    (scan / "a.obj").write_text("mtllib a.mtl\nv 0 0 0\n")
    (scan / "a.mtl").write_text("newmtl x\nmap_Kd wood.png\n")
    (scan / "wood.png").write_bytes(b"1")
    robot = tmp_path / "scans" / "robot"
    robot.mkdir()
    (robot / "r.urdf").write_text('<robot><mesh filename="m.stl"/></robot>')
    (robot / "m.stl").write_bytes(b"1")
    (tmp_path / "scans" / "photo.jpg").write_bytes(b"1")
    found = find_inputs([str(tmp_path / "scans")])
    assert sorted(i.label for i in found) == ["chair-a", "photo", "robot-r"]
    assert [i.name for i in find_inputs([str(scan / "a.obj")] * 2)] == [
        f"a-{content_digest(scan / 'a.obj')[:8]}"
    ]
    before = content_digest(scan / "a.obj"), content_digest(robot / "r.urdf")
    (scan / "wood.png").write_bytes(b"2")
    (robot / "m.stl").write_bytes(b"2")
    assert content_digest(scan / "a.obj") != before[0]
    assert content_digest(robot / "r.urdf") != before[1]

    (tmp_path / "list.txt").write_text("# mine\nscans/photo.jpg\nscans/*/a.obj\n")
    assert [i.label for i in find_inputs([str(tmp_path / "list.txt")])] == ["photo", "chair-a"]
    with pytest.raises(InputError, match="no file fits"):
        find_inputs([str(tmp_path / "*.glb")])
    with pytest.raises(InputError, match="no such file or folder"):
        find_inputs([str(tmp_path / "gone.glb")])


def test_the_manifest_says_all_and_the_gallery_shows_it(tmp_path: Path) -> None:
    import pyarrow.parquet as pq

    target = Target(str(tmp_path))
    target.prepare()
    made = Record("a-1", "a.glb", "1", "k", "passes", joints=("j", "k"), types=("revolute",) * 2,
                  confidences=(0.5, 0.9), seconds=1.5, backends={"prior": "embedded"})  # fmt: skip
    refused = Record("b-2", "b.glb", "2", "l", "nothing moves", reason="a <solid> block")
    write_pages([refused, made], target, report=False)
    rows = list(csv.DictReader((tmp_path / "manifest.csv").open()))
    assert [r["name"] for r in rows] == ["a-1", "b-2"] and rows[0]["joints"] == "j k"
    table = pq.read_table(tmp_path / "manifest.parquet").to_pylist()
    assert table[0]["confidences"] == [0.5, 0.9] and table[0]["backends"] == "prior=embedded"
    page = (tmp_path / "index.html").read_text()
    assert "assets/a-1/asset.json" in page and "a &lt;solid&gt; block" in page


def test_records_survive_any_file_system_and_a_cut_file_is_none(tmp_path: Path) -> None:
    import fsspec

    target = Target("memory://batch-test")
    target.prepare()
    record = Record("a-1", "a.glb", "1", "k", "passes", confidences=(0.5,))
    target.save(record)
    asset = tmp_path / "asset"
    (asset / "visual").mkdir(parents=True)
    (asset / "visual" / "a.obj").write_text("v")
    target.put(asset, "a-1")
    assert target.records() == {"a-1": record} and target.names("assets") == {"a-1"}
    assert fsspec.filesystem("memory").exists("/batch-test/assets/a-1/visual/a.obj")
    target.write("records/b-2.json", b'{"name": "b-2", "sour')
    assert target.records() == {"a-1": record} and target.record("b-2") is None


def test_two_batches_do_not_write_to_one_folder(tmp_path: Path) -> None:
    target = Target(str(tmp_path))
    with held(target), pytest.raises(ConfigError, match="another batch writes to"), held(target):
        pass


def test_pace_says_how_many_a_minute_and_how_long(monkeypatch: pytest.MonkeyPatch) -> None:
    now = iter([0.0, 6.0, 12.0])
    monkeypatch.setattr(time, "monotonic", lambda: next(now))
    pace = Pace(left=702)
    assert pace.line() == ""
    pace.tick()
    pace.tick()
    assert pace.line() == "10.0 a minute, 1 h 10 min left"


def test_what_cannot_be_is_said_at_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = _inputs(tmp_path / "in", ["fine"])
    assert main(["batch", "--out", str(tmp_path / "out")]) == 2
    assert main(["batch", str(source), "--out", str(tmp_path / "out"), "--jobs", "0"]) == 2
    assert main(["batch", str(source), "--out", str(tmp_path / "out"), "--time-limit", "0"]) == 2
    assert "--time-limit must be a number above 0" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


@pytest.mark.slow
def test_a_mesh_becomes_an_asset_and_is_not_made_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    from mam_world import make_object
    from mam_world.dataset import write_dataset

    assert make_object("box_slider", 3)
    write_dataset("box_slider", 1, 3, tmp_path / "gen", False, False, 1)
    (tmp_path / "gen" / "junk.glb").write_text("junk")
    command = ["batch", str(tmp_path / "gen" / "*" / "static.glb"), str(tmp_path / "gen/junk.glb"),
               "--out", str(tmp_path / "out"), "--json"]  # fmt: skip
    assert main(command) == 1
    first = json.loads(capsys.readouterr().out)
    assert first["counts"] == {"passes": 1, "bad input": 1}
    made = next(o for o in first["objects"] if o["status"] == "passes")
    assert made["name"].startswith("box_slider_000003-static-") and made["joints"]
    card = tmp_path / "out" / "assets" / made["name"] / "asset.json"
    written = card.stat().st_mtime_ns
    assert (tmp_path / "out" / "pictures" / f"{made['name']}.jpg").is_file()
    assert main(command) == 1
    assert json.loads(capsys.readouterr().out) == first and card.stat().st_mtime_ns == written


def test_a_folder_that_is_no_batch_is_left_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    theirs, source = tmp_path / "theirs", tmp_path / "a.urdf"
    (theirs / "records").mkdir(parents=True)
    (theirs / "batch.yaml").write_text("queue: mine")
    source.write_text("<robot/>")
    assert main(["batch", str(source), "--out", str(theirs), "--quiet"]) == 2
    assert "is not empty and holds no batch" in capsys.readouterr().err
    assert {p.name for p in theirs.iterdir()} == {"records", "batch.yaml"}
