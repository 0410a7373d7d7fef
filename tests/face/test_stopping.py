"""A command that is told to stop says so, whatever a library makes of it."""

from __future__ import annotations

import subprocess
import sys
import time
from pathlib import Path

TOLD_WHILE_IMPORTING = """
import os, signal, sys, time
from mam_sim.stopping import Stopped, stoppable
try:
    with stoppable():
        try:
            os.kill(os.getpid(), signal.SIGTERM)
            time.sleep(5)
        except BaseException as stop:
            raise ImportError("initialization failed") from stop
except Stopped as stop:
    sys.exit(stop.status)
"""


def test_a_stop_that_a_library_takes_for_a_failure_of_its_own_is_a_stop() -> None:
    ended = subprocess.run(
        [sys.executable, "-c", TOLD_WHILE_IMPORTING], capture_output=True, timeout=60, check=False
    )
    assert (ended.returncode, ended.stderr) == (143, b"")


GOES_ON_WRITING = """
import os, signal, sys, time
from pathlib import Path
from mam_pipeline.folders import work_folder
from mam_sim.stopping import stoppable, watch_over
watch_over()
with stoppable(), work_folder(Path(sys.argv[1])) as work:
    try:
        os.kill(os.getpid(), signal.SIGTERM)
    except BaseException:
        pass
    number = 0
    while True:
        work.mkdir(exist_ok=True)
        (work / str(number)).write_bytes(b"")
        number += 1
        time.sleep(0.0002)
"""


def test_a_library_that_goes_on_writing_after_the_stop_leaves_nothing(tmp_path: Path) -> None:
    """What it writes while it is swept up is swept up once it is ended."""
    command = [sys.executable, "-c", GOES_ON_WRITING, str(tmp_path / "out")]
    ended = subprocess.run(command, capture_output=True, timeout=60, check=False)
    assert (ended.returncode, ended.stderr) == (143, b"")
    until = time.monotonic() + 20
    while list(tmp_path.iterdir()) and time.monotonic() < until:
        time.sleep(0.02)
    assert list(tmp_path.iterdir()) == []
