"""Whether one input gives the same files on one thread and on two, idle and under load.

    python benchmarks/same_answer.py FILE.glb ... [--load 4] [--out same.json]

Every file of the assets is compared byte for byte; only recorded seconds are left out (`seconds`
in asset.json and in report.html).
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from hashlib import sha256
from pathlib import Path
from typing import Any

import tyro
from common import save
from tyro.conf import Positional

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
SECONDS = re.compile(r"seconds: \{[^}]*\}")


@contextmanager
def busy(processes: int) -> Iterator[None]:
    """A machine on which others compute."""
    command = [sys.executable, "-c", "while True: pass"]
    others = [subprocess.Popen(command) for _ in range(processes)]
    try:
        yield
    finally:
        for other in others:
            other.kill()
            other.wait()


def made(source: Path, folder: Path, threads: int) -> dict[str, str]:
    """Make an asset; digests of its files, without recorded seconds."""
    around = {**os.environ, **dict.fromkeys(THREADS, str(threads))}
    out = folder / source.stem
    words = [sys.executable, "-m", "mam_sim.cli", "articulate", str(source), "--out", str(out)]
    done = subprocess.run([*words, "--quiet"], env=around, stderr=subprocess.PIPE, text=True)
    assert (out / "asset.json").is_file(), done.stderr
    return {str(p.relative_to(out)): digest(p) for p in sorted(out.rglob("*")) if p.is_file()}


def digest(file: Path) -> str:
    data = file.read_bytes()
    if file.name == "asset.json":
        data = json.dumps({**json.loads(data), "seconds": {}}).encode()
    elif file.suffix == ".html":
        data = SECONDS.sub("", data.decode()).encode()
    return sha256(data).hexdigest()


def main(sources: Positional[tuple[Path, ...]], load: int = 4, out: Path | None = None) -> None:
    """Make every asset three times and compare.

    Args:
        sources: meshes, photos or URDFs.
        load: processes that keep the machine busy in the third run.
        out: JSON file for the files that differ.
    """
    rows: list[dict[str, Any]] = []
    for source in sources:
        found = {}
        for name, threads, others in (("one", 1, 0), ("two", 2, 0), ("busy", 2, load)):
            with tempfile.TemporaryDirectory() as folder, busy(others):
                found[name] = made(source, Path(folder), threads)
        names = sorted(set().union(*found.values()))
        differ = [n for n in names if len({files.get(n) for files in found.values()}) > 1]
        rows.append({"source": source.name, "files": len(names), "differ": differ})
        print(rows[-1], flush=True)
    save(out, rows)
    raise SystemExit(1 if any(row["differ"] for row in rows) else 0)


if __name__ == "__main__":
    tyro.cli(main)
