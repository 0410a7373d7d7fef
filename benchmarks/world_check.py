"""Measures the procedural world: executability of its own truth, category by category.

    python benchmarks/world_check.py --seeds 2 [--only safe oven] [--no-drive]

Every object is written as an asset folder to a temporary directory and checked by `mam-sim check`'s
own function. Prints one line per category with the reasons of what failed, then the totals.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from collections import Counter
from pathlib import Path

from mam_pipeline.asset.writer import write_asset
from mam_pipeline.check.check import check_asset
from mam_pipeline.world import CATEGORIES, make_object


def main() -> None:
    """Check `seeds` objects of every category."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--start", type=int, default=0)
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--no-drive", action="store_true")
    args = parser.parse_args()
    passed = total = 0
    reasons: Counter[str] = Counter()
    for name in args.only or list(CATEGORIES):
        bad, built, began = [], 0.0, time.process_time()
        for seed in range(args.start, args.start + args.seeds):
            with tempfile.TemporaryDirectory() as folder:
                start = time.process_time()
                made = make_object(name, seed)
                built += time.process_time() - start
                write_asset(made.articulation, Path(folder) / "a", name="a",
                            collision=made.collision)  # fmt: skip
                report = check_asset(Path(folder) / "a", drive=not args.no_drive)
            total += 1
            passed += report.passed
            if not report.passed:
                reasons.update(report.reasons)
                bad.append(
                    (
                        seed,
                        [f"{f.code} {f.where}" for f in report.findings if not f.warning][:2]
                        + [
                            f"{j.name} {r} at {j.penetration_at} {j.penetration} gap {j.gap}"
                            for j in report.joints
                            for r in j.reasons
                        ][:2],
                    )
                )
        spent = time.process_time() - began
        print(
            f"{name:<24} {args.seeds - len(bad)}/{args.seeds}"
            f"  build {1e3 * built / args.seeds:.0f} ms  all {spent / args.seeds:.1f} s",
            *bad[:3],
            flush=True,
        )
    print(f"{passed} of {total} pass; reasons: {dict(reasons)}")


if __name__ == "__main__":
    main()
