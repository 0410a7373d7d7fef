"""What a command costs before its work: processor seconds of commands beside those of the work.

    python benchmarks/startup.py MESH --out FILE.json

Prints each command's seconds, those of the same work in a process that has done it once, and the
ratio. `mam-sim batch` pays what comes before the work once for many objects.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import tyro
from common import save
from tyro.conf import Positional


def of_command(*words: str) -> float:
    """Processor seconds of `mam-sim WORDS`, children included."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    env = {**os.environ, "OMP_NUM_THREADS": "1"}
    subprocess.run([sys.executable, "-m", "mam_sim.cli", *words], capture_output=True, env=env)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def of_work(work: Callable[[int], object]) -> float:
    """Processor seconds of a second call in this process."""
    work(0)
    began = time.process_time()
    work(1)
    return time.process_time() - began


def main(mesh: Positional[Path], /, out: Path | None = None) -> None:
    """Measure and print."""
    from mam_pipeline.check.check import check_asset
    from mam_pipeline.make_config import MakeConfig
    from mam_pipeline.run import make_asset

    rows: list[dict[str, Any]] = []
    for words in (["--help"], ["train", "--help"], ["articulate", "--help"], ["batch", "--help"]):
        seconds = min(of_command(*words) for _ in range(2))
        rows.append({"command": " ".join(words), "seconds": seconds})
    with tempfile.TemporaryDirectory() as scratch:
        asset = Path(scratch) / "asset"
        command = of_command("articulate", str(mesh), "--out", str(asset))
        from mam_sim.report import write_report

        work = of_work(
            lambda k: write_report(make_asset(mesh, Path(scratch) / f"{k}", MakeConfig()))
        )
        rows.append({"command": "articulate", "seconds": command, "work": work})
        command = of_command("check", str(asset))
        rows.append(
            {"command": "check", "seconds": command, "work": of_work(lambda _: check_asset(asset))}
        )
    for row in rows:
        line = f"{row['command']:<20} {row['seconds']:6.2f} s"
        if "work" in row:
            line += f"   work {row['work']:6.2f} s   ratio {row['seconds'] / row['work']:.1f}"
        print(line, flush=True)
    save(out, rows)


if __name__ == "__main__":
    tyro.cli(main)
