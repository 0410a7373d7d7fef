"""What `mam-sim articulate` spends its time on, stage by stage, against the number of faces.

    python benchmarks/articulate_stages.py [FILE ...] [--sizes 0 100000 1000000] [--out FILE.json]

Every file runs in a fresh process, as the command does, from the first import to the report.
Without files, one procedural object is taken as it is (size 0) and with its triangles cut ever
finer: same surface, same parts. Processor seconds are told beside the clock's, since a busy machine
slows only the clock; the last column is the ratio of processor seconds to the first file's.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import tyro
from common import save
from engine_scaling import refined


def one(source: Path) -> dict[str, Any]:
    """Articulate one file in this process; seconds by stage, (processor, clock)."""
    from mam_sim import lean

    lean.install()
    marks = [("imports", 0.0, 0.0)]
    began = time.perf_counter()

    def mark(stage: str) -> None:
        marks.append((stage, time.process_time(), time.perf_counter() - began))

    from mam_pipeline.errors import MamSimError
    from mam_pipeline.formats.mesh_files import files_kept
    from mam_pipeline.make_config import MakeConfig
    from mam_pipeline.run import make_asset
    from mam_sim.report import write_report
    from mam_sim.verbs import articulate  # noqa: F401

    said = ""
    with tempfile.TemporaryDirectory() as folder, files_kept():
        try:
            asset = make_asset(source, Path(folder) / "asset", MakeConfig(), mark)
            mark("report")
            write_report(asset)
            said = f"{len(asset.card.joints)} joints"
        except MamSimError as error:
            said = str(error)
    mark("end")
    stages: dict[str, list[float]] = {}
    for (name, cpu, wall), (_, cpu_end, wall_end) in pairwise(marks):
        spent = stages.setdefault(name, [0.0, 0.0])
        spent[0] += cpu_end - cpu
        spent[1] += wall_end - wall
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {"stages": stages, "peak_mb": round(peak), "said": said}


def measured(source: Path) -> dict[str, Any]:
    """`one` in a process of its own."""
    command = [sys.executable, __file__, "--single", str(source)]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode:
        return {"stages": {}, "peak_mb": 0, "said": done.stderr.strip().splitlines()[-1]}
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def generated(size: int, category: str, seed: int, folder: Path) -> Path:
    """A procedural object as a GLB of about so many faces."""
    from mam_pipeline.formats.mesh_files import save_glb
    from mam_world import make_object
    from mam_world.style import Style

    mesh = make_object(category, seed, replace(Style(), gap=0.002)).truth().mesh
    mesh = mesh if size <= len(mesh.faces) else refined(mesh, size)
    path = folder / f"{category}_{len(mesh.faces)}.glb"
    save_glb(mesh, path)
    return path


def main(
    files: tyro.conf.Positional[tuple[Path, ...]] = (),
    sizes: tuple[int, ...] = (0, 30_000, 100_000, 300_000, 1_000_000),
    category: str = "cabinet_two_door",
    seed: int = 9,
    single: Path | None = None,
    out: Path | None = None,
) -> None:
    """Measure and print.

    Args:
        files: meshes to articulate; without them, generated ones.
        sizes: faces of generated meshes.
        category: of the generated object.
        seed: of the generated object.
        single: one file, in this process (for the script's own use).
        out: JSON file for the figures.
    """
    if single is not None:
        print(json.dumps(one(single)))
        return
    rows: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as folder:
        sources = list(files) or [generated(n, category, seed, Path(folder)) for n in sizes]
        first = 0.0
        for source in sources:
            found = measured(source)
            rows[source.stem] = found
            total = [sum(s[k] for s in found["stages"].values()) for k in (0, 1)]
            first = first or total[0]
            print(f"\n{source.name}: {found['said']}; {found['peak_mb']} MB")
            for stage, (cpu, wall) in found["stages"].items():
                share = 100.0 * cpu / max(total[0], 1e-9)
                print(f"  {stage:<8} {cpu:7.2f} s of processor {wall:7.2f} s  {share:5.1f} %")
            times = total[0] / max(first, 1e-9)
            print(f"  {'all':<8} {total[0]:7.2f} s of processor {total[1]:7.2f} s  {times:5.2f} x")
    save(out, rows)


if __name__ == "__main__":
    tyro.cli(main)
