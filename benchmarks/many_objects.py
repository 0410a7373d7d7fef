"""`mam-sim batch` on many generated meshes, killed in the middle, beside a shell loop.

    python benchmarks/many_objects.py FOLDER --count 1000 --loop 30 --out FILE.json
    python benchmarks/many_objects.py FOLDER --count 200 --ray 3 --out FILE.json

FOLDER gets the meshes and the batch. At half of the objects the batch is killed by SIGKILL (with
--ray: one node of a local cluster of so many nodes is), and the same command runs again. What had
a record then must not be touched again, and every input must have one at the end. The shell loop
is `mam-sim articulate FILE --out DIR` once for each of some of the same meshes, one at a time.
"""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil
import tyro
from common import save
from tyro.conf import Positional

ENV = {**os.environ, "OMP_NUM_THREADS": "1"}
LOOK = 5.0
"""Seconds between two looks at the memory."""


def meshes(folder: Path, count: int, faces: int) -> Path:
    """So many generated objects of at most so many faces as GLB files, where they are not there."""
    from mam_pipeline.formats.mesh_files import save_glb
    from mam_world.splits import iterate
    from mam_world.truth import generated_truth

    folder.mkdir(parents=True, exist_ok=True)
    there = {p.stem for p in folder.glob("*.glb")}
    for category, seed in iterate("test"):
        if len(there) >= count:
            break
        if f"{category}_{seed}" not in there:
            mesh = generated_truth(category, seed).mesh
            if len(mesh.faces) <= faces:
                save_glb(mesh, folder / f"{category}_{seed}.glb")
                there.add(f"{category}_{seed}")
    return folder


@dataclass
class Watch:
    """Memory of a process and all below it, looked at every few seconds.

    Attributes:
        rows: (seconds, objects done, megabytes of the command and its servers, of all).
    """

    process: psutil.Process
    records: Path
    rows: list[tuple[float, int, float, float]] = field(default_factory=list)

    def look(self) -> None:
        """Until the process ends; memory that processes share is counted once."""
        began = time.monotonic()
        while self.process.is_running() and self.process.status() != psutil.STATUS_ZOMBIE:
            try:
                below = self.process.children(recursive=True)
                lasting = [self.process, *self.process.children()]
                sizes = {p.pid: p.memory_full_info().pss / 2**20 for p in [*lasting, *below]}
            except psutil.Error:
                continue
            done = len(list(self.records.glob("*.json")))
            steady = sum(sizes[p.pid] for p in lasting)
            self.rows.append((time.monotonic() - began, done, steady, sum(sizes.values())))
            time.sleep(LOOK)


def batch(command: list[str], out: Path, until: int | None) -> dict[str, Any]:
    """Run the batch to its end, or kill it when so many objects have a record."""
    records, began = out / "records", time.monotonic()
    before = len(list(records.glob("*.json")))
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    process = subprocess.Popen(command, env=ENV, stdout=subprocess.DEVNULL)
    watch = Watch(psutil.Process(process.pid), records)
    thread = threading.Thread(target=watch.look)
    thread.start()
    while process.poll() is None:
        if until is not None and len(list(records.glob("*.json"))) >= until:
            process.send_signal(signal.SIGKILL)
        time.sleep(0.5)
    thread.join()
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    done, seconds = len(list(records.glob("*.json"))) - before, time.monotonic() - began
    return {
        "objects": done,
        "seconds": round(seconds, 1),
        "a minute": round(60 * done / seconds, 2),
        "own cpu": round(spent.ru_utime + spent.ru_stime - used.ru_utime - used.ru_stime, 1),
        "memory": [[round(v, 1) for v in row] for row in watch.rows],
    }


def on_cluster(folder: Path, out: Path, nodes: int, until: int) -> dict[str, Any]:
    """The batch on a local Ray cluster of so many nodes; one is killed at `until` objects."""
    import ray
    from ray.cluster_utils import Cluster

    from mam_pipeline.guarded import Limits
    from mam_pipeline.make_config import MakeConfig
    from mam_sim.batch.inputs import find_inputs
    from mam_sim.batch.record import Target
    from mam_sim.batch.run import plan, run
    from mam_sim.batch.work import Work

    os.environ.update(ENV)
    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 0})
    workers = [cluster.add_node(num_cpus=1) for _ in range(nodes)]
    target = Target(str(out))
    target.prepare()
    todo = plan(find_inputs([str(folder)]), Work(MakeConfig()), target, Limits())
    seen, began, killed = Counter[str](), time.monotonic(), 0
    try:
        for record in run(todo.left, ray_address=cluster.address):
            seen[record.name] += 1
            if not killed and len(seen) >= until:
                cluster.remove_node(workers.pop(), allow_graceful=False)
                killed = len(seen)
    finally:
        ray.shutdown()
        cluster.shutdown()
    seconds = time.monotonic() - began
    return {
        "objects": len(seen), "seconds": round(seconds, 1), "node killed at": killed,
        "a minute": round(60 * len(seen) / seconds, 2),
        "came twice": sum(seen.values()) - len(seen),
    }  # fmt: skip


def loop(files: list[Path], out: Path) -> dict[str, Any]:
    """The same by a command for each object."""
    out.mkdir(parents=True, exist_ok=True)
    used, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    for file in files:
        words = ["-m", "mam_sim.cli", "articulate", str(file), "--out", str(out / file.stem)]
        subprocess.run([sys.executable, *words, "--quiet"], env=ENV, capture_output=True)
    spent, seconds = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic() - began
    cpu = spent.ru_utime + spent.ru_stime - used.ru_utime - used.ru_stime
    return {
        "objects": len(files), "seconds": round(seconds, 1),
        "a minute": round(60 * len(files) / seconds, 2),
        "cpu an object": round(cpu / len(files), 2),
    }  # fmt: skip


def told(out: Path) -> dict[str, Any]:
    """What the records say together."""
    from mam_sim.batch.record import Target

    found = list(Target(str(out)).records().values())
    return {
        "records": len(found),
        "status": dict(Counter(r.status for r in found)),
        "cpu an object": round(sum(r.cpu_seconds for r in found) / max(len(found), 1), 2),
        "peak_mb": max(r.peak_mb for r in found),
    }


def main(
    folder: Positional[Path],
    /,
    count: int = 1000,
    faces: int = 1500,
    jobs: int = 2,
    loop_count: int = 30,
    ray: int = 0,
    out: Path | None = None,
) -> None:
    """Make, kill, go on, count and print.

    Args:
        folder: for the meshes and the batch; a batch that is there must be of an earlier run.
        count: objects. faces: at most, of one. jobs: processes of the batch.
        loop_count: objects of the shell loop.
        ray: nodes of a local Ray cluster instead of processes; 0: none.
        out: JSON file for all figures.
    """
    source, made = meshes(folder / "meshes", count, faces), folder / "batch"
    result: dict[str, Any] = {"count": count, "load before": os.getloadavg()}
    if ray:
        result["ray"] = on_cluster(source, made, ray, count // 2)
        print(result["ray"], flush=True)
    else:
        words = [sys.executable, "-m", "mam_sim.cli", "batch", str(source), "--out", str(made),
                 "--jobs", str(jobs), "--quiet"]  # fmt: skip
        result["killed"] = batch(words, made, count // 2)
        kept = {p.name: p.stat().st_mtime_ns for p in (made / "records").glob("*.json")}
        result["again"] = batch(words, made, None)
        now = {p.name: p.stat().st_mtime_ns for p in (made / "records").glob("*.json")}
        result["done twice"] = sum(now.get(name) != when for name, when in kept.items())
    result["batch"] = told(made)
    done = {Path(r.source).stem for r in _records(made)}
    result["lost"] = len({p.stem for p in source.iterdir()} - done)
    left = [p.name for p in (made / "assets").iterdir() if p.name.startswith(".")]
    result["half-made"] = len(left)
    files = sorted(source.iterdir())[:: max(1, count // max(loop_count, 1))][:loop_count]
    if files and not ray:
        result["loop"] = loop(files, folder / "loop")
        again = {p.stem for p in files}
        mine = [r for r in _records(made) if Path(r.source).stem in again]
        result["same in batch"] = round(sum(r.cpu_seconds for r in mine) / len(mine), 2)
    for key, value in result.items():
        shown = {k: v for k, v in value.items() if k != "memory"} if isinstance(value, dict) else 0
        print(f"{key}: {shown or value}", flush=True)
    save(out, result)


def _records(made: Path) -> list[Any]:
    from mam_sim.batch.record import Target

    return list(Target(str(made)).records().values())


if __name__ == "__main__":
    tyro.cli(main)
