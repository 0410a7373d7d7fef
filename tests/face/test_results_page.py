"""Result tables say on which code and by which models they were measured."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "benchmarks"))

import code_state  # noqa: E402 - benchmarks/ is no package
import engine_table  # noqa: E402
import results_page  # noqa: E402
from code_state import State  # noqa: E402
from mam_sim_bench.metrics import score  # noqa: E402
from mam_sim_bench.runner import Record  # noqa: E402

from mam_world.truth import generated_truth  # noqa: E402

TABLES = sorted(
    file.stem for file in results_page.RESULTS.glob("*.json")
    if "columns" in json.loads(file.read_text(encoding="utf-8"))
)  # fmt: skip


def git(folder: Path, *words: str) -> str:
    """What a git command prints."""
    who = ("-c", "user.name=a", "-c", "user.email=a@b")
    done = subprocess.run(["git", *who, *words], cwd=folder, check=True, capture_output=True)
    return done.stdout.decode().strip()


def commit(folder: Path, **files: str) -> str:
    """Write files (`engine_py` is engine.py), commit them, and give the commit."""
    for name, text in files.items():
        (folder / name.replace("_", ".")).write_text(text)
    git(folder, "add", "-A")
    git(folder, "commit", "-qm", "area: change")
    return git(folder, "rev-parse", "--short", "HEAD")


@pytest.fixture
def history(tmp_path: Path) -> tuple[Path, str]:
    """A repository, and the commit of a measurement."""
    folder = tmp_path / "repository"
    folder.mkdir()
    git(folder, "init", "-q")
    return folder, commit(folder, engine_py="x = 1\n", table_json="{}")


@pytest.fixture(autouse=True)
def fresh() -> None:
    """What was told of a commit before the history went on is forgotten."""
    code_state.state_of.cache_clear()


def test_a_row_of_changed_code_is_older(history: tuple[Path, str]) -> None:
    folder, measured = history
    paths = ("engine.py",)
    assert code_state.state_of(measured, paths, folder) is State.PRESENT
    commit(folder, table_json='{"row": 1}')  # the row itself is recorded: no figure needs it
    code_state.state_of.cache_clear()
    assert code_state.state_of(measured, paths, folder) is State.PRESENT
    commit(folder, engine_py='"""It counts."""\nx = 1  # one\n')
    code_state.state_of.cache_clear()
    assert code_state.state_of(measured, paths, folder) is State.PRESENT
    (folder / "engine.py").write_text("x = 2\n")  # not committed yet
    code_state.state_of.cache_clear()
    assert code_state.state_of(measured, paths, folder) is State.OLDER


def test_other_files_than_code_count_to_the_byte(history: tuple[Path, str]) -> None:
    folder, measured = history
    commit(folder, table_json="{ }")
    assert code_state.state_of(measured, (".",), folder) is State.OLDER
    assert code_state.state_of(measured, (".", ":!table.json"), folder) is State.PRESENT


def test_a_commit_that_the_history_lacks_is_unknown(history: tuple[Path, str]) -> None:
    folder, _ = history
    git(folder, "checkout", "-q", "-b", "aside")
    aside = commit(folder, engine_py="x = 3\n")
    git(folder, "checkout", "-q", "-")
    assert code_state.state_of(aside, ("engine.py",), folder) is State.UNKNOWN
    code_state.state_of.cache_clear()
    assert code_state.state_of("0123abc", ("engine.py",), folder) is State.UNKNOWN


def test_a_shallow_clone_and_no_clone_say_so(history: tuple[Path, str], tmp_path: Path) -> None:
    folder, measured = history
    commit(folder, engine_py="x = 2\n")
    git(tmp_path, "clone", "-q", "--depth", "1", f"file://{folder}", "shallow")
    assert code_state.state_of(measured, ("engine.py",), tmp_path / "shallow") is State.UNTOLD
    (tmp_path / "unpacked").mkdir()
    assert code_state.state_of(measured, ("x",), tmp_path / "unpacked") is State.UNTOLD


ROW: dict[str, Any] = {
    "id": "a", "name": "three doors", "values": {"mIoU": 0.5}, "command": "c", "machine": "m",
    "commit": "abc1234", "readme": True,
    "models": {"unseen": True, "trained_on": {"joints": "generated", "parts": "dev, generated"}},
}  # fmt: skip
PRINTED = {"id": "p", "name": "paper", "values": {"mIoU": 0.86}, "command": "printed",
           "machine": "", "commit": None, "readme": True}  # fmt: skip


def write_table(folder: Path, *rows: dict[str, Any]) -> str:
    """A table `t` with these rows, and a README that shows it."""
    table = {"title": "t", "columns": {"mIoU": ".2f"}, "paths": ["engine.py"], "rows": rows}
    (folder / "t.json").write_text(json.dumps(table))
    return "<!-- results: t -->\n<!-- end of results -->\n"


@pytest.mark.parametrize(
    ("found", "wrong", "sentence"),
    [
        (State.OLDER, True, "its code changed since abc1234; measure it"),
        (State.UNKNOWN, True, "this history has no commit abc1234; measure it"),
        (State.UNTOLD, False, "not compared, this clone lacks commit abc1234"),
    ],
)
def test_the_readme_may_show_no_row_of_other_code(
    found: State, wrong: bool, sentence: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(results_page, "RESULTS", tmp_path)
    text = results_page.readme(write_table(tmp_path, ROW, PRINTED))
    assert "| three doors | never saw these | 0.50 |\n| paper |  | 0.86 |" in text
    monkeypatch.setattr(results_page, "state_of", lambda *_: State.PRESENT)
    assert list(results_page.faults(text)) == []
    assert [w for w, _ in results_page.faults(text.replace("0.50", "0.60"))] == [True]
    monkeypatch.setattr(results_page, "state_of", lambda *_: found)
    ((is_wrong, said),) = results_page.faults(text)
    assert is_wrong is wrong and sentence in said and "'three doors'" in said


def test_the_site_marks_rows_of_other_code(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(results_page, "RESULTS", tmp_path)
    monkeypatch.setattr(results_page, "state_of", lambda *_: State.OLDER)
    seen = {**ROW, "id": "b", "name": "again", "models": {**ROW["models"], "unseen": False}}
    write_table(tmp_path, ROW, seen, PRINTED)
    table = results_page.load("t")
    assert results_page.figures(table).splitlines()[2:] == [
        "| three doors · *older code* | never saw these | 0.50 |",
        "| again · *older code* | seen in training | 0.50 |",
        "| paper |  | 0.86 |",
    ]
    assert "| `abc1234` older code | m | dev, generated |" in results_page.origins(table)


@pytest.mark.parametrize("name", TABLES)
def test_every_row_says_its_origin(name: str) -> None:
    table = results_page.load(name)
    for row in table["rows"]:
        assert row["command"] and set(row["values"]) <= set(table["columns"]), row["id"]
        paths = row.get("paths", table["paths"])
        assert paths and not any("docs" in path for path in paths)


@pytest.mark.parametrize("name", TABLES)
def test_what_rows_depend_on_is_there(name: str) -> None:
    for path in results_page.load(name)["paths"]:
        assert (ROOT / path.removeprefix(":!")).exists(), path


@pytest.fixture
def dataset_records() -> list[Record]:
    """A box with a door that was found, one without that got a joint, and one that got none."""
    truth = generated_truth("cabinet_one_door", 3)
    right = truth.truth_articulation()
    still = replace(truth, links=truth.links[:1], joints=(), face_link=truth.face_link * 0)
    pairs = [(right, truth), (right, still), (None, still)]
    return [
        Record(str(k), "box", "k", "ok", "", score(found, true), 1.0, {}, 1, 1, None, 1, 0)
        for k, (found, true) in enumerate(pairs)
    ]


WANTED = engine_table.Wanted("dev", "objects", "dev", ("--named",), readme=True)


def found(unseen: bool, command: str) -> engine_table.Measured:
    """A run without objects."""
    return engine_table.Measured((), {"unseen": unseen, "weights": []}, command)


def test_a_source_that_was_seen_is_measured_by_models_that_did_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "dev").mkdir()
    monkeypatch.setattr(engine_table, "shipped_saw", lambda source: source == "dev")
    assert list(engine_table.attempts(WANTED, None)) == [("--named", "--no-abstain")]
    first, _ = engine_table.attempts(WANTED, tmp_path)
    assert first == ("--named", "--weights", str(tmp_path / "dev"))
    assert list(engine_table.attempts(replace(WANTED, shipped=True), tmp_path)) == [("--named",)]
    monkeypatch.setattr(engine_table, "shipped_saw", lambda source: False)
    assert next(engine_table.attempts(WANTED, tmp_path)) == ("--named",)


def test_a_row_is_only_written_for_what_it_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "dev").mkdir()
    runs: list[bool] = []

    def measure(*_: object) -> engine_table.Measured:
        return found(runs.pop(0), "mam-sim bench DEV")

    monkeypatch.setattr(engine_table, "measure", measure)
    monkeypatch.setattr(
        engine_table, "row_of", lambda wanted, got, commit: {"id": wanted.id, "name": ""}
    )
    monkeypatch.setattr(engine_table, "shipped_saw", lambda source: False)
    for seen_by_run, shipped, row in [
        ([True], False, "dev"), ([False, False], False, None),
        ([False], True, "dev"), ([True], True, None),
    ]:  # fmt: skip
        runs[:] = seen_by_run
        wanted = replace(WANTED, shipped=shipped)
        rows = engine_table.rows_of(wanted, [tmp_path], None, 1, tmp_path)
        assert {file: made and made["id"] for file, made in rows.items()} == {
            "engine": row, "confidence": row,
        }  # fmt: skip
        assert runs == []


def test_a_row_counts_objects_that_move_and_those_that_do_not(
    dataset_records: list[Record],
) -> None:
    models = {"unseen": False, "weights": [{"room": "joints", "trained_on": ["generated", "dev"]}]}
    got = engine_table.Measured(tuple(dataset_records), models, "mam-sim bench DEV")
    row = engine_table.row_of(WANTED, got, "abc1234")
    assert row["name"] == "1 objects" and row["values"]["false joints"] == "1 of 2"
    assert row["values"]["mIoU"] == 1.0 and row["commit"] == "abc1234" and row["readme"]
    assert row["values"]["true parts"] == "1 of 1, 0 dormant"
    assert row["models"] == {"unseen": False, "trained_on": {"joints": "generated, dev"}}
    told = engine_table.confidence_row_of(row, got.records)
    assert told["name"] == "1 objects, and 2 in which nothing moves" and "readme" not in told
    assert told["values"]["joints"] == "2" and told["values"]["0.8 to 1"] == "1 of 2"
    assert told["values"]["wrong, no review"] == "1 of 1"
    assert told["values"]["true joints"] == "1 of 1"


def test_generated_kinds_that_were_held_back_are_a_source_of_the_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[str] = []

    def bench(words: list[str], **_: object) -> None:
        asked.extend(words)
        out = Path(words[words.index("--out") + 1])
        out.write_text(json.dumps({"objects": [], "models": {"unseen": True, "weights": []}}))

    monkeypatch.setattr(engine_table.subprocess, "run", bench)
    monkeypatch.setattr(engine_table.code_state, "head", lambda: "abc1234")
    monkeypatch.setattr(engine_table, "row_of", lambda wanted, got, commit: {"name": got.command})
    (wanted,) = [w for w in engine_table.wanted_rows() if w.source == "generated:unseen"]
    rows = engine_table.rows_of(wanted, [tmp_path], None, 1, tmp_path)
    assert rows["engine"] == {"name": "mam-sim bench generated:unseen --limit 56"}
    assert "generated:unseen" in asked and not wanted.readme


def test_rows_keep_the_order_of_the_table() -> None:
    table = {"rows": [{"id": "paper"}, {"id": "dev"}]}
    engine_table.put(table, {"id": "kitchen"}, "kitchen")
    assert [row["id"] for row in table["rows"]] == ["kitchen", "dev", "paper"]
    engine_table.put(table, None, "dev")
    assert [row["id"] for row in table["rows"]] == ["kitchen", "paper"]


def test_rows_of_an_older_rule_stand_apart(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(results_page, "state_of", lambda *_: State.OLDER)
    monkeypatch.setattr(results_page, "is_ancestor", lambda rule, commit, root: commit == "new")
    table = {"paths": ["engine.py"], "rule": {"since": "rule", "name": "before limits"}}
    assert results_page.before_rule(table, {**ROW, "commit": "old"})
    assert not results_page.before_rule(table, {**ROW, "commit": "new"})
    assert not results_page.before_rule(table, PRINTED)
    assert not results_page.before_rule({"paths": ["engine.py"]}, {**ROW, "commit": "old"})


def test_the_command_of_a_row_names_no_folder_of_a_machine(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def bench(words: list[str], **_: object) -> None:
        out = Path(words[words.index("--out") + 1])
        out.write_text(json.dumps({"objects": [], "models": {"unseen": True, "weights": []}}))

    monkeypatch.setattr(engine_table.subprocess, "run", bench)
    flags = ("--named", "--weights", str(tmp_path / "left_out" / "dev"))
    got = engine_table.measure(tmp_path / "dev", flags, 1, tmp_path / "run.json")
    assert got.command == "mam-sim bench DEV --named --weights LEFT_OUT/dev"
