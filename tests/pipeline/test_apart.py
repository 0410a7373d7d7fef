"""Readers in a process of their own: limits, no trace of them afterwards, and what comes back."""

from __future__ import annotations

import contextlib
import importlib
import os
import signal
import subprocess
import sys
import threading
import time
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from mam_pipeline.errors import ConfigError, InputError
from mam_pipeline.formats import apart
from mam_pipeline.guarded import Limits, family, guarded

FILE = Path("some.fbx")
WORK = """
import os, signal, subprocess, sys, threading, time
from mam_pipeline.errors import ConfigError
HELD = threading.Lock()
def wrong():
    raise ConfigError("this is wrong")
def killed():
    os.kill(os.getpid(), signal.SIGKILL)
def failing():
    return 1 // 0
def waiting():
    with HELD:
        return 1
def greedy(note):
    code = f"open({str(note)!r}, 'w').write(str(__import__('os').getpid()))\\n"
    code += "held = b'x' * (600 << 20)\\nimport time\\ntime.sleep(60)"
    with subprocess.Popen([sys.executable, "-c", code], start_new_session=True):
        while not note.exists():
            time.sleep(0.05)
        held = b"x" * (600 << 20)
        time.sleep(60)
        assert held
def endless(note):
    with subprocess.Popen(["sleep", "600"]):
        note.write_text(str(os.getpid()))
        time.sleep(600)
"""


@pytest.fixture
def work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Any:
    """Somebody's module of readers, which only this process's `sys.path` finds."""
    name = f"readers_{os.getpid()}_{len(sys.modules)}"
    (tmp_path / f"{name}.py").write_text(WORK)
    monkeypatch.syspath_prepend(tmp_path)
    return importlib.import_module(name)


def gone(pid: int, within: float = 3.0) -> bool:
    """Whether a process has ended (one that nobody has waited for counts as ended)."""
    until = time.monotonic() + within
    while time.monotonic() < until:
        try:
            state = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0]
        except OSError:
            return True
        if state == "Z":
            return True
        time.sleep(0.02)
    return False


def small(**bounds: float) -> apart.Bounds:
    return apart.Bounds(**{"seconds": 20.0, "memory": 4.0, **bounds})  # type: ignore[arg-type]


def test_what_is_found_and_our_own_errors_come_back(
    work: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert apart.apart(partial(dict, a=[1, 2]), FILE, "FBX") == {"a": [1, 2]}
    with pytest.raises(ConfigError, match="this is wrong"):
        apart.apart(work.wrong, FILE, "FBX")
    (tmp_path / "here.txt").write_text("found")
    monkeypatch.chdir(tmp_path)  # after the server was started elsewhere
    assert apart.apart(partial(Path("here.txt").read_text, "utf-8"), FILE, "FBX") == "found"


def test_a_process_that_is_forked_asks_a_server_of_its_own() -> None:
    assert apart.apart(partial(int, "1"), FILE, "FBX") == 1
    child = os.fork()
    if child == 0:
        code = 1
        with contextlib.suppress(BaseException):
            code = apart.apart(partial(int, "7"), FILE, "FBX")
        os._exit(code)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 7
    assert apart.apart(partial(int, "2"), FILE, "FBX") == 2


def test_nothing_is_imported_from_the_folder_in_which_one_works(tmp_path: Path) -> None:
    (tmp_path / "queue.py").write_text("open('ran', 'w').close()")  # a stranger's
    code = "from functools import partial\nfrom pathlib import Path\n"
    code += "from mam_pipeline.formats.apart import apart\n"
    code += "assert apart(partial(int, '1'), Path('a.fbx'), 'FBX') == 1"
    subprocess.run([sys.executable, "-P", "-c", code], cwd=tmp_path, check=True, timeout=60)
    assert not (tmp_path / "ran").exists()


def test_a_thread_that_ends_takes_no_server_with_it() -> None:
    found = []
    for number in range(3):
        work = partial(apart.apart, partial(int, number), FILE, "FBX")
        thread = threading.Thread(target=lambda work=work: found.append(work()))  # type: ignore[misc]
        thread.start()
        thread.join()
        time.sleep(0.2)
    assert found == [0, 1, 2]


def test_what_a_thread_of_this_process_holds_stops_no_reader(work: Any) -> None:
    """OpenUSD's own threads hold locks: a child that is forked while they do hung for ever."""
    with work.HELD:
        assert apart.apart(work.waiting, FILE, "FBX") == 1


def test_a_reader_that_hangs_is_stopped(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(apart, "BOUNDS", small(seconds=0.3))
    began = time.monotonic()
    with pytest.raises(InputError, match=r"some.fbx took more than 0 s to read"):
        apart.apart(partial(time.sleep, 60), FILE, "FBX")
    assert time.monotonic() - began < 5.0


@pytest.mark.parametrize("how", ["killed", "failing"])
def test_a_reader_that_crashes_is_one_sentence(work: Any, how: str) -> None:
    with pytest.raises(InputError, match=r"some.fbx cannot be read as FBX \(.+\); export it"):
        apart.apart(getattr(work, how), FILE, "FBX")


def test_the_memory_of_what_a_reader_starts_counts(
    work: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each of the two stays below the limit; together they do not."""
    monkeypatch.setattr(apart, "BOUNDS", small(memory=1.1, seconds=60.0))
    note = tmp_path / "pid"
    with pytest.raises(InputError, match="takes more than"):
        apart.apart(partial(work.greedy, note), FILE, "FBX")
    assert gone(int(note.read_text()))


PARENT = """
import sys
from functools import partial
from pathlib import Path
from mam_pipeline.formats.apart import apart
from importlib import import_module
sys.path.insert(0, sys.argv[2])
apart(partial(import_module(sys.argv[3]).endless, Path(sys.argv[1])), Path("a.fbx"), "FBX")
"""


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM])
def test_a_reader_ends_with_whoever_asked(
    work: Any, tmp_path: Path, number: signal.Signals
) -> None:
    note = tmp_path / "pid"
    code = "from mam_sim.stopping import stoppable\nwith stoppable():\n"
    code += "".join(f"    {line}\n" for line in PARENT.splitlines())
    words = [str(note), str(tmp_path), work.__name__]
    with subprocess.Popen([sys.executable, "-c", code, *words]) as parent:
        until = time.monotonic() + 60
        while not (note.exists() and note.read_text()) and time.monotonic() < until:
            time.sleep(0.02)
        members = family(parent.pid)
        assert int(note.read_text()) in members
        parent.send_signal(number)
        assert gone(parent.pid)
    assert all(gone(m) for m in members)  # also what the reader itself had started


def test_a_program_that_is_not_ours_ends_with_us_and_all_that_it_started(tmp_path: Path) -> None:
    note = tmp_path / "pid"
    shell = f"setsid sleep 600 & echo $! > {note}; exec sleep 600"
    code = (
        "import subprocess, sys\nfrom mam_pipeline.guarded import Limits, guarded\n"
        f"subprocess.run(guarded(['sh', '-c', {shell!r}], Limits(600, 4)))"
    )
    with subprocess.Popen([sys.executable, "-c", code]) as parent:
        until = time.monotonic() + 60
        while not (note.exists() and note.read_text().strip()) and time.monotonic() < until:
            time.sleep(0.02)
        members = family(parent.pid)
        assert len(members) >= 4  # ours, the watcher, the program, and what it started
        parent.kill()
    assert all(gone(m) for m in [*members, int(note.read_text())])


@pytest.mark.parametrize(
    ("command", "status"), [("exit 3", 3), ("kill -9 $$", 137), ("sleep 60", 124)]
)
def test_a_program_that_is_not_ours_ends_as_it_would_alone(command: str, status: int) -> None:
    done = subprocess.run(guarded(["sh", "-c", f"echo out; {command}"], Limits(2.0, 4.0)),
                          capture_output=True, text=True, timeout=30)  # fmt: skip
    assert (done.returncode, done.stdout) == (status, "out\n")
    assert ("it took longer than 2 s" in done.stderr) == (status == 124)


def test_children_of_the_dead_are_found() -> None:
    with subprocess.Popen(["sleep", "60"]) as child:
        assert child.pid in family(os.getpid())
        child.kill()
    with contextlib.suppress(ProcessLookupError):
        assert family(child.pid) == [child.pid]


@pytest.mark.parametrize("suffix", ["stl", "obj"])
def test_a_file_of_a_gigabyte_of_nothing_is_refused_at_once(tmp_path: Path, suffix: str) -> None:
    from mam_pipeline.formats.readers import read_mesh

    file = tmp_path / f"a.{suffix}"
    file.touch()
    os.truncate(file, 1 << 30)
    began = time.monotonic()
    with pytest.raises(InputError):
        read_mesh(file)
    assert time.monotonic() - began < 5
