"""What is written appears whole or not at all, and what dead processes left is swept."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from mam_pipeline import folders

DEAD = 2**22 + 1
"""No process of Linux has this number."""


def test_a_folder_takes_its_place_when_it_is_whole(tmp_path: Path) -> None:
    out = tmp_path / "deep" / "out"
    with pytest.raises(KeyboardInterrupt), folders.new_folder(out) as work:
        (work / "half").write_text("x")
        raise KeyboardInterrupt
    assert not list(tmp_path.iterdir())  # the folder above it is gone too
    with folders.new_folder(out) as work:
        (work / "whole").write_text("y")
    with pytest.raises(KeyboardInterrupt), folders.new_folder(out) as work:
        (work / "half").write_text("x")
        raise KeyboardInterrupt
    assert {p.name for p in out.iterdir()} == {"whole"}
    assert {p.name for p in out.parent.iterdir()} == {"out"}


def test_a_file_takes_its_place_when_it_is_whole(tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    folders.write_text(file, "old")
    with pytest.raises(ValueError), folders.new_file(file) as part:
        assert part.suffix == ".json"
        part.write_text("half")
        raise ValueError
    assert file.read_text() == "old" and {p.name for p in tmp_path.iterdir()} == {"a.json"}


@pytest.mark.parametrize("name", ["out", "out.npz", "b" * 240, "a[1]*"])
def test_what_the_dead_left_is_swept_and_what_they_moved_aside_comes_back(
    tmp_path: Path, name: str
) -> None:
    out = tmp_path / name
    stem = folders._stem(out)
    # numbers are used again: a folder is alive where it is locked, whoever has its number now
    for left in (
        f".{stem}.partial-{DEAD}", f".{stem}.partial-{os.getppid()}-0a", f".{stem}.old-{DEAD}-ff",
        ".other.partial-1",
    ):  # fmt: skip
        (tmp_path / left).mkdir()
        (tmp_path / left / "kept").write_text(left)
    (tmp_path / f".{stem}.partial-{DEAD}x{out.suffix}").write_text("somebody else's")
    alive = tmp_path / f".{stem}.partial-{DEAD}-ab"
    alive.mkdir()
    with _locked_by_another(alive):
        folders.sweep(out)
        remaining = {p.name for p in tmp_path.iterdir()}
    theirs = f".{stem}.partial-{DEAD}x{out.suffix}"
    assert remaining == {name, ".other.partial-1", alive.name, theirs}
    assert (out / "kept").read_text() == f".{stem}.old-{DEAD}-ff"
    folders.sweep_inside(tmp_path)
    assert {p.name for p in tmp_path.iterdir()} == {name, theirs}


@contextmanager
def _locked_by_another(folder: Path) -> Iterator[None]:
    """Hold a folder as a process that makes it does."""
    code = f"import fcntl, os; fcntl.flock(os.open({str(folder)!r}, 0), 2); print(flush=True)"
    hold = [sys.executable, "-c", f"{code}; input()"]
    with subprocess.Popen(hold, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        yield
        process.kill()


def test_a_file_that_is_older_than_the_process_of_its_number_is_swept(tmp_path: Path) -> None:
    mine = tmp_path / f".a.npz.partial-{os.getpid()}-0a.npz"
    for path in (mine, tmp_path / ".a.npz.partial-1-0b.npz"):  # the first process is older
        path.write_text("half")
    folders.sweep(tmp_path / "a.npz")
    assert len(list(tmp_path.iterdir())) == 2  # both may be being written
    before = time.time
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(time, "time", lambda: before() + 10**9)
        folders.sweep(tmp_path / "a.npz")
    assert not list(tmp_path.iterdir())


def test_two_processes_of_one_number_build_the_same_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As two containers that share a disk do: neither takes the other's."""
    monkeypatch.setattr(os, "getpid", lambda: 7)
    with folders.work_folder(tmp_path / "out") as first:
        (first / "kept").touch()
        monkeypatch.setattr(folders, "_building", set())  # that of another process
        with folders.work_folder(tmp_path / "out"):
            assert (first / "kept").is_file()
        assert (first / "kept").is_file()


def test_a_name_that_is_as_long_as_names_can_be(tmp_path: Path) -> None:
    out = tmp_path / ("n" * 255)
    with folders.new_folder(out) as work:
        (work / "whole").write_text("y")
    assert [p.name for p in tmp_path.iterdir()] == [out.name]


def test_a_replacement_that_fails_leaves_what_was_there(tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "old").write_text("x")
    with pytest.raises(OSError):
        folders.put_in_place(tmp_path / "missing", out)
    assert (out / "old").is_file() and [p.name for p in tmp_path.iterdir()] == ["out"]


STOPPED = """
import os, signal, sys
from pathlib import Path
from mam_pipeline import folders
from mam_sim import stopping
stopping.GRACE = 0.5
try:
    with stopping.stoppable(), folders.work_folder(Path(sys.argv[1])) as work:
        (work / "half").write_text("x")
        if sys.argv[2] == "swallowed":
            try:
                os.kill(os.getpid(), signal.SIGTERM)
            except BaseException:
                pass
            import time
            time.sleep(20)
        os.kill(os.getpid(), signal.SIGTERM)
except stopping.Stopped as stop:
    raise SystemExit(stop.status)
"""


@pytest.mark.parametrize("how", ["raised", "swallowed"])
def test_a_process_that_is_told_to_stop_leaves_nothing(tmp_path: Path, how: str) -> None:
    out = tmp_path / "out"
    done = subprocess.run([sys.executable, "-c", STOPPED, str(out), how], timeout=15, check=False)
    assert done.returncode == 143 and not list(tmp_path.iterdir())


BUSY = """
import ctypes, sys
from pathlib import Path
from mam_pipeline import folders
from mam_sim.stopping import stoppable, watch_over
watch_over()
with stoppable(), folders.work_folder(Path(sys.argv[1])) as work, folders.Scratch() as scratch:
    Path(sys.argv[2]).write_text(scratch)
    ctypes.PyDLL(None).sleep(60)
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP])
def test_native_code_that_lets_nothing_else_run_is_ended_all_the_same(
    tmp_path: Path, number: signal.Signals
) -> None:
    note, out = tmp_path / "note", tmp_path / "made" / "out"
    before = signal.signal(number, signal.SIG_DFL)  # nohup, say, has SIGHUP ignored
    try:
        process = subprocess.Popen([sys.executable, "-c", BUSY, str(out), str(note)])
    finally:
        signal.signal(number, before)
    with process:
        scratch = _written(note)
        assert scratch.is_dir() and list(out.parent.iterdir())
        process.send_signal(number)
        process.wait(timeout=20)  # 1.4 s, and more on a busy machine
    until = time.monotonic() + 5
    while scratch.exists() and time.monotonic() < until:
        time.sleep(0.02)
    assert not scratch.exists() and not list(tmp_path.rglob("*partial*"))


def test_what_a_killed_process_left_goes_with_the_next_scratch_folder(tmp_path: Path) -> None:
    note = tmp_path / "note"
    mine = folders.Scratch()
    with subprocess.Popen([sys.executable, "-c", BUSY, str(tmp_path / "o"), str(note)]) as process:
        scratch = _written(note)
        folders.Scratch().cleanup()
        assert scratch.is_dir()  # its owner lives
        process.kill()
        process.wait(timeout=10)
    with folders.Scratch():
        assert not scratch.exists() and Path(mine.name).is_dir()
    mine.cleanup()


def _written(note: Path) -> Path:
    until = time.monotonic() + 30
    while not (note.exists() and note.read_text()) and time.monotonic() < until:
        time.sleep(0.02)
    return Path(note.read_text())
