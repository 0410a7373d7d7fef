"""What is each hand rule of the engine worth on real objects that its models never saw?

    python benchmarks/rule_ablation.py ../shared/bench/kitchen --logs build/rules

Runs `mam-sim bench` on folders of objects with all rules, then with each rule off, and writes
docs/results/rule_ablation.json. Where no object's score changed the rule did nothing there. Of an
object in which nothing moves `miou` is 1 where nothing was found to move and 0 elsewhere; of the
others `executable` is 1 where the asset passes the check. Runs
that are in --logs are not run again, so the work can be cut short and shared out (--only).
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import code_state
import numpy as np
import results_page
import tyro
from common import machine
from compare_bench import METRICS, interval
from tyro.conf import Positional

from mam_pipeline.rules import Rules

NAME = "rule_ablation"
SHOWN = ("miou", "count", "type_error", "axis", "motion", "limits", "executable")
FUSED_ONLY = (
    "closed_fronts", "handle_on_panel", "two_sided_sheet", "through_sheet", "same_handle",
    "sunken_slide",
)  # fmt: skip
"""Rules for objects of one surface; the others do nothing there that they do not do elsewhere."""

TABLE = {
    "title": "What each hand rule of the engine is worth",
    "columns": {"objects": "d", "changed": "d", **dict.fromkeys(SHOWN, "s")},
    "paths": [*results_page.load("engine")["paths"], "benchmarks/rule_ablation.py"],
}
"""The table without its rows."""

Scores = Mapping[str, Mapping[str, Any]]


def bench(source: Path, flags: Sequence[str], jobs: int, log: Path) -> Scores:
    """Scores by object of a run of the bench, which goes on where it was cut short."""
    words = [str(source), *flags, "--jobs", str(jobs), "--out", str(log), "--quiet"]
    subprocess.run(
        [sys.executable, "-m", "mam_sim.cli", "bench", *words],
        check=True, stdout=subprocess.DEVNULL,
    )  # fmt: skip
    out = {}
    for row in json.loads(log.read_text(encoding="utf-8"))["objects"]:
        passes = float(row["executable"]) if row["scores"]["true_parts"] else None
        out[f"{source.name}/{row['id']}"] = {**row["scores"], "executable": passes}
    return out


def gains(base: Scores, off: Scores) -> dict[str, Any]:
    """What the rule gains: of how many objects it changed the scores, mean and 95 % interval."""
    changed = [n for n in off if any(off[n][m] != base[n][m] for m in SHOWN)]
    out: dict[str, Any] = {"objects": len(off), "changed": len(changed)}
    for metric in SHOWN:
        sign = 1.0 if METRICS.get(metric, True) else -1.0
        pairs = [(base[n][metric], off[n][metric]) for n in off if n in base]
        difference = np.array([sign * (a - b) for a, b in pairs if a is not None and b is not None])
        low, high = interval(difference)
        mean = float(difference.mean()) if len(difference) else 0.0
        out[metric] = f"{mean:+.3f} [{low:+.3f}, {high:+.3f}]" if len(changed) else None
    return out


def main(
    sources: Positional[tuple[Path, ...]], logs: Path = Path("build/rules"),
    only: tuple[str, ...] = (), jobs: int = 1, fused: bool = False,
) -> None:  # fmt: skip
    """Measure and write the table.

    Args:
        sources: folders of objects with truth, that no model of the engine was trained on.
        logs: folder of the runs. only: rules. jobs: processes.
        fused: each object as one surface, with the rules that are for these.
    """
    logs.mkdir(parents=True, exist_ok=True)
    flags = ("--fuse",) if fused else ()
    names = FUSED_ONLY if fused else [r for r in Rules.names() if r not in FUSED_ONLY]

    def run(rule: str) -> Scores:
        off = (f"--no-{rule.replace('_', '-')}",) if rule else ()
        found: dict[str, Mapping[str, Any]] = {}
        for source in sources:
            log = logs / f"{source.name}{'_fused' * fused}_{rule or 'all'}.json"
            found |= bench(source, [*flags, *off], jobs, log)
        return found

    base = run("")
    words = " ".join([*(s.name for s in sources), *flags])
    for rule in names:
        if only and rule not in only:
            continue
        values = gains(base, run(rule))
        name = f"{rule}{'_fused' * fused}"
        row = {
            "id": name, "name": f"`{rule}`{', each object fused' * fused}", "values": values,
            "command": f"python benchmarks/rule_ablation.py {words}",
            "commit": code_state.head(), "machine": machine(),
        }  # fmt: skip
        print(rule, values, flush=True)
        results_page.put(NAME, [row], TABLE)


if __name__ == "__main__":
    tyro.cli(main)
