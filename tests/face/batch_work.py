"""Work of a batch that is quick or misbehaves, importable by the processes that do it."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

from mam_pipeline.errors import NotPhysicalError
from mam_sim.batch.record import Record, Target
from mam_sim.batch.work import Job, Work


@dataclass(frozen=True)
class Quick(Work):
    """What an object's file says happens to it; `log` gets its name when it was made."""

    log: str = ""
    seconds: float = 0.0

    def warm(self) -> None:
        pass

    def digest(self) -> str:
        return "quick"

    def make(self, job: Job, target: Target, out: Path) -> Record:
        word = job.item.path.read_text().split()[0]
        if word == "hang":
            time.sleep(600)
        if word == "eat":
            eaten = b"x" * 2**29
            time.sleep(600 + len(eaten))
        if word == "crash":
            os.write(2, b"a word before the end\n")
            os.kill(os.getpid(), signal.SIGSEGV)
        if word in ("killed", "killed-once") and not Path(f"{self.log}.{word}").exists():
            if word == "killed-once":
                Path(f"{self.log}.{word}").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        if word == "refuse":
            raise NotPhysicalError("a link without surface")
        if word == "break":
            raise ZeroDivisionError("a bug")
        time.sleep(self.seconds)
        out.mkdir(parents=True, exist_ok=True)
        (out / "asset.json").write_text("{}")
        with open(self.log, "a") as stream:
            stream.write(job.item.name + "\n")
        return job.record("passes", joints=("door",), types=("revolute",), confidences=(0.9,))
