"""A command that is told to stop says so, whatever a library makes of it."""

from __future__ import annotations

import subprocess
import sys

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
