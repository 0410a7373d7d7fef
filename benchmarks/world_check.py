"""Measures the procedural world: executability of its own truth, category by category.

    python benchmarks/world_check.py results.jsonl --count 2000 [--only safe oven] [--no-drive]
    python benchmarks/world_check.py results.jsonl                     (the table of what is there)

Objects are drawn round after round over all categories with fresh seeds and the styles that belong
to them; each is written as an asset folder to a temporary directory and checked by `mam-sim
check`'s own function. One JSON line per object; run again with the same file, it goes on where it
stopped, so a long measurement may be cut into pieces.
"""

from __future__ import annotations

import json
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from common import save
from tyro.conf import Positional

from mam_pipeline.asset.writer import write_asset
from mam_pipeline.check import check
from mam_world import CATEGORIES, make_object


def main(
    results: Positional[Path],
    /,
    count: int = 0,
    seed: int = 0,
    seeds: tuple[int, ...] = (),
    only: tuple[str, ...] = (),
    drive: bool = True,
    minutes: float = 1e9,
    out: Path | None = None,
) -> None:
    """Check objects until `count` are in the file or `minutes` have passed.

    Args:
        results: file of JSON lines, gone on with where it exists.
        count: objects in all. seed: which fresh seeds are drawn. seeds: these seeds instead.
        only: these categories. drive: in the simulator too.
        out: JSON file for all rows.
    """
    names = list(only or CATEGORIES)
    plan = product(names, seeds) if seeds else rounds(names, count, seed)
    measure(results, plan, drive, minutes)
    print(table(results))
    save(out, read(results))


def product(names: list[str], seeds: tuple[int, ...]) -> Iterator[tuple[str, int]]:
    """Every category with every seed."""
    return ((name, seed) for seed in seeds for name in names)


def rounds(names: list[str], count: int, seed: int) -> Iterator[tuple[str, int]]:
    """`count` pairs (category, random seed): one of every category before the second of any."""
    rng = np.random.default_rng(seed)
    for k in range(count):
        yield names[k % len(names)], int(rng.integers(1_000_000))


def measure(results: Path, plan: Iterator[tuple[str, int]], drive: bool, minutes: float) -> None:
    """Append one line for every planned object that the file does not hold yet."""
    rows = read(results)
    known = {(r["category"], r["seed"]) for r in rows}
    end = time.monotonic() + 60 * minutes
    with results.open("a", encoding="utf-8") as file:
        for name, seed in plan:
            if time.monotonic() > end:
                return
            if (name, seed) in known:
                continue
            file.write(json.dumps(check_one(name, seed, drive)) + "\n")
            file.flush()


def check_one(name: str, seed: int, drive: bool) -> dict[str, Any]:
    """Build and check one object; an exception is a failure like any other."""
    row: dict[str, Any] = {"category": name, "seed": seed, "passed": False, "drive": drive}
    began = time.process_time()
    try:
        made = make_object(name, seed)
        row["build_s"] = round(time.process_time() - began, 4)
        row["joints"] = len(made.articulation.joints)
        row["style"] = {k: v for k, v in vars(made.style).items() if isinstance(v, bool | str)}
        with tempfile.TemporaryDirectory() as folder:
            target = Path(folder) / "a"
            write_asset(made.articulation, target, name="a", collision=made.collision)
            report = check.check_asset(target, drive=drive)
    except Exception as error:  # whatever it is, it counts
        row["reasons"] = [f"{type(error).__name__}: {error}"[:200]]
        row["all_s"] = round(time.process_time() - began, 3)
        return row
    row["passed"] = report.passed
    row["all_s"] = round(time.process_time() - began, 3)
    row["reasons"] = [f"{f.code} {f.where}: {f.message}" for f in report.findings if not f.warning]
    for joint in report.joints:
        for reason in joint.reasons:
            row["reasons"].append(
                f"{reason} {joint.name} depth {joint.penetration:.4f} at "
                f"{joint.penetration_at:.3f} gap {joint.gap} line {joint.line_gap} "
                f"filled {joint.filled:.3f} reached {joint.reached} hold {joint.hold_drift} "
                f"return {joint.return_error}"
            )
    return row


def read(results: Path) -> list[dict[str, Any]]:
    """The rows of a results file; none if it does not exist."""
    if not results.exists():
        return []
    return [json.loads(line) for line in results.read_text(encoding="utf-8").splitlines()]


def table(results: Path) -> str:
    """Failures by category and reason, then the totals."""
    rows = read(results)
    bad: dict[str, list[dict[str, Any]]] = defaultdict(list)
    kinds: Counter[str] = Counter()
    for row in rows:
        if not row["passed"]:
            bad[row["category"]].append(row)
            kinds.update({r.split()[0] for r in row["reasons"]})
    tried = Counter(row["category"] for row in rows)
    lines = []
    for name in sorted(bad):
        lines.append(f"{name}: {len(bad[name])} of {tried[name]} fail")
        lines += [f"    seed {r['seed']}: {reason}" for r in bad[name] for reason in r["reasons"]]
    good = sum(row["passed"] for row in rows)
    share = good / max(len(rows), 1)
    spent = sum(row["all_s"] for row in rows)
    lines.append(f"{good} of {len(rows)} objects of {len(tried)} categories pass ({share:.2%}); "
                 f"failing objects by reason: {dict(kinds)}; {spent:.0f} s of CPU")  # fmt: skip
    return "\n".join(lines)


if __name__ == "__main__":
    tyro.cli(main)
