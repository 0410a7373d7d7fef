"""How much sooner one object would be made if its parts were worked on side by side.

    python benchmarks/side_by_side.py FILE ... --out FILE.json

What is done once per part, joint or sampling is timed call by call, in processor seconds, while the
object is made. Of the calls of one kind the longest share that a core would get is the least time
they can take together; a bare fork is paid for each core beyond the first. So the gain is an upper
bound for an idle machine, and can be measured on a busy one.
"""

from __future__ import annotations

import importlib
import os
import resource
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import tyro
from common import save
from tyro.conf import Positional

KINDS = {
    "group features, by sampling": "mam_pipeline.parts.embedded:measured",
    "candidates of a joint, by part": "mam_pipeline.parts.joint_view:rank_hypotheses",
    "joint and limits, by part": "mam_pipeline.joints.estimate:JointEstimator._estimate",
    "collision pieces, by link": "mam_pipeline.asset.collision:_link_shapes",
    "check: sweep, by joint": "mam_pipeline.check.check:_tested",
    "check: drive, by joint": "mam_pipeline.check.drive:_Driver._reach",
    "check: hold, by joint": "mam_pipeline.check.drive:_Driver._hold",
}


def timed(place: str, calls: list[float]) -> None:
    """Note the processor seconds of every call of a function."""
    module, _, path = place.partition(":")
    owner: Any = importlib.import_module(module)
    *above, name = path.split(".")
    for part in above:
        owner = getattr(owner, part)
    real: Callable[..., Any] = getattr(owner, name)

    def around(*args: Any, **kwargs: Any) -> Any:
        began = time.process_time()
        try:
            return real(*args, **kwargs)
        finally:
            calls.append(time.process_time() - began)

    setattr(owner, name, around)


def fork_seconds() -> float:
    """What a forked process costs before its work; the pages that its work copies come on top."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    began = time.process_time()
    child = os.fork()
    if child == 0:
        os._exit(0)
    os.waitpid(child, 0)
    here = time.process_time() - began
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return here + after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def longest(calls: list[float], cores: int) -> float:
    """Seconds of the core that has most to do, each call going to the idlest, longest first."""
    busy = [0.0] * cores
    for seconds in sorted(calls, reverse=True):
        busy[busy.index(min(busy))] += seconds
    return max(busy)


def main(sources: Positional[tuple[Path, ...]], cores: int = 2, out: Path | None = None) -> None:
    """Measure and print.

    Args:
        sources: meshes. cores: that work side by side. out: JSON file for the figures.
    """
    from mam_pipeline.formats.mesh_files import files_kept
    from mam_pipeline.make_config import MakeConfig
    from mam_pipeline.run import make_asset

    calls: dict[str, list[float]] = defaultdict(list)
    with tempfile.TemporaryDirectory() as folder:
        make_asset(sources[0], Path(folder) / "first", MakeConfig())  # loads what is loaded once
    for kind, place in KINDS.items():
        timed(place, calls[kind])
    rows: list[dict[str, Any]] = []
    for source in sources:
        for kind in KINDS:
            calls[kind].clear()
        importlib.import_module("mam_pipeline.joints.estimate")._REMEMBERED.clear()
        with tempfile.TemporaryDirectory() as folder, files_kept():
            began = time.process_time()
            asset = make_asset(source, Path(folder) / "asset", MakeConfig())
            whole = time.process_time() - began
        fork = fork_seconds()
        row: dict[str, Any] = {"source": source.name, "joints": len(asset.card.joints),
                               "seconds": whole, "fork": fork, "kinds": {}}  # fmt: skip
        saved = 0.0
        for kind in KINDS:
            own = list(calls[kind])
            gain = max(0.0, sum(own) - longest(own, cores) - (cores - 1) * fork)
            row["kinds"][kind] = {"calls": len(own), "seconds": sum(own), "saved": gain}
            saved += gain
        row["sooner"] = saved / whole
        rows.append(row)
        print(f"\n{source.name}: {whole:.2f} s, {row['joints']} joints, a fork {fork:.3f} s; "
              f"at best {saved:.2f} s ({100 * row['sooner']:.0f} %) sooner")  # fmt: skip
        for kind, found in row["kinds"].items():
            print(f"  {kind:<32} {found['calls']:3} calls {found['seconds']:6.2f} s   "
                  f"saves {found['saved']:.2f} s")  # fmt: skip
    save(out, {"cores": cores, "objects": rows})
    print(f"\nmean: {100 * sum(r['sooner'] for r in rows) / len(rows):.0f} % sooner at best")


if __name__ == "__main__":
    tyro.cli(main)
