"""What the scheduler of `mam-sim batch` costs for many objects: real queue, recorded times.

    python benchmarks/batch_schedule.py BATCH --sizes 1000 10000 --out FILE.json

BATCH is a folder that `mam-sim batch` wrote. Its objects' seconds, in turn, divided by --faster,
are slept by servers in place of making objects. Processor time is then the scheduler's alone; time
over what the sleeps take with all processes always busy is the scheduler's and that of a busy
machine. The manifest and the gallery are written once beside.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from unittest.mock import patch

import tyro
from common import save
from tyro.conf import Positional

from mam_pipeline import forkserver
from mam_sim.batch.pages import write_pages
from mam_sim.batch.record import Record, Target


@dataclass(frozen=True)
class Sleep:
    """An object that takes so many seconds."""

    seconds: float
    limits: forkserver.Limits = field(default_factory=forkserver.Limits)

    def warm(self) -> None:
        """Nothing."""

    def run(self) -> None:
        """Take them."""
        time.sleep(self.seconds)


def asleep(_server: forkserver.ForkServer, task: Sleep) -> forkserver.Ending:
    """A server that sleeps."""
    task.run()
    return forkserver.Ending("done")


def one(records: list[Record], size: int, jobs: int, faster: float) -> dict[str, Any]:
    """So many objects: seconds, and those of processes that are always busy."""
    tasks = [Sleep(records[i % len(records)].seconds / faster) for i in range(size)]
    least = sum(t.seconds for t in tasks) / jobs
    began, used = time.monotonic(), time.process_time()
    with patch.object(forkserver.ForkServer, "run", asleep):
        done = sum(1 for _ in forkserver.run_all(tasks, jobs))
    seconds = time.monotonic() - began
    some = [replace(records[i % len(records)], name=f"object-{i}") for i in range(size)]
    with tempfile.TemporaryDirectory() as folder:
        target = Target(folder)
        target.prepare()
        at = time.process_time()
        write_pages(some, target, False)
        pages = time.process_time() - at
    return {
        "objects": done, "seconds": round(seconds, 2), "least": round(least, 2),
        "over": round(seconds / least - 1.0, 4),
        "cpu ms an object": round(1000 * (at - used) / size, 3), "pages": round(pages, 2),
    }  # fmt: skip


def main(
    batch: Positional[Path],
    /,
    sizes: tuple[int, ...] = (1000, 10_000),
    jobs: int = 100,
    faster: float = 100.0,
    out: Path | None = None,
) -> None:
    """Sleep and print.

    Args:
        batch: folder of a batch. sizes: objects. jobs: processes. faster: than recorded.
        out: JSON file for the figures.
    """
    records = sorted(Target(str(batch)).records().values(), key=lambda r: r.name)
    rows = []
    for size in sizes:
        rows.append(one(records, size, jobs, faster))
        print(rows[-1], flush=True)
    save(out, rows)


if __name__ == "__main__":
    tyro.cli(main)
