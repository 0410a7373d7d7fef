"""Is one run of the benchmark equal to another within noise?

    mam-sim bench DATASET --no-exec --out BEFORE.json     (old code)
    mam-sim bench DATASET --no-exec --out AFTER.json      (new code)
    python benchmarks/compare_bench.py BEFORE.json AFTER.json

Prints every metric before and after over the objects that both runs hold, the mean of the paired
differences with a 95 % bootstrap interval over objects, and the objects whose answer changed.
With `--tolerance T` it exits with 1 when a metric is worse by more than T and its interval
excludes zero.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray

# metric, and whether more is better
METRICS = {
    "miou": True, "count": True, "type_error": False, "axis": False, "pivot": False,
    "axis_signed": False, "motion": False, "limits": True,
}  # fmt: skip
HEAD = f"{'metric':<12} {'n':>4} {'before':>8} {'after':>8} {'change':>8}   95 % interval"


@dataclass(frozen=True)
class Change:
    """A metric's paired difference.

    Attributes:
        objects: that have the metric in both runs. before, after: means over them.
        low, high: 95 % bootstrap interval of the mean difference, after minus before.
        worse: whether it got worse and the interval excludes zero.
    """

    metric: str
    objects: int
    before: float
    after: float
    low: float
    high: float

    @property
    def worse(self) -> bool:
        return self.high < 0 if METRICS[self.metric] else self.low > 0

    def line(self) -> str:
        """A row under HEAD."""
        return (
            f"{self.metric:<12} {self.objects:>4} {self.before:>8.4f} {self.after:>8.4f} "
            f"{self.after - self.before:>+8.4f}   [{self.low:+.4f}, {self.high:+.4f}]"
            f"{'  worse' if self.worse else ''}"
        )


def scores_of(file: Path) -> dict[str, Mapping[str, Any]]:
    """Scores by object of a bench result (JSON), or of its log (JSON lines)."""
    text = file.read_text(encoding="utf-8")
    if file.suffix == ".jsonl":
        objects = [json.loads(line) for line in text.splitlines() if line]
    else:
        objects = json.loads(text)["objects"]
    return {o["id"]: o["scores"] for o in objects if o["scores"]}


def interval(difference: NDArray[np.float64], draws: int = 10_000) -> tuple[float, float]:
    """95 % bootstrap interval of the mean of (n,) paired differences, seed fixed."""
    if not len(difference):
        return 0.0, 0.0
    rng = np.random.default_rng(0)
    means = difference[rng.integers(len(difference), size=(draws, len(difference)))].mean(axis=1)
    low, high = np.quantile(means, (0.025, 0.975))
    return float(low), float(high)


def compared(
    before: Mapping[str, Mapping[str, Any]], after: Mapping[str, Mapping[str, Any]]
) -> list[Change]:
    """Every metric over the objects that both runs hold."""
    common = [k for k in before if k in after]
    out = []
    for metric in METRICS:
        pairs = np.array([
            (before[k][metric], after[k][metric]) for k in common
            if before[k][metric] is not None and after[k][metric] is not None
        ], dtype=np.float64).reshape(-1, 2)  # fmt: skip
        if len(pairs):
            mean = pairs.mean(axis=0)
            ends = interval(pairs[:, 1] - pairs[:, 0])
            out.append(Change(metric, len(pairs), float(mean[0]), float(mean[1]), *ends))
    return out


def changed(
    before: Mapping[str, Mapping[str, Any]],
    after: Mapping[str, Mapping[str, Any]],
    least: float = 1e-6,
) -> dict[str, dict[str, tuple[float | None, float | None]]]:
    """What differs, by object and metric: (before, after)."""
    out: dict[str, dict[str, tuple[float | None, float | None]]] = {}
    for name in before:
        if name not in after:
            continue
        for metric in (*METRICS, "predicted_parts"):
            a, b = before[name][metric], after[name][metric]
            same = a is None and b is None
            if not same and (a is None or b is None or abs(a - b) > least):
                out.setdefault(name, {})[metric] = (a, b)
    return out


def main(
    before: tyro.conf.Positional[Path],
    after: tyro.conf.Positional[Path],
    /,
    tolerance: float | None = None,
) -> None:
    """Compare two results of `mam-sim bench`.

    Args:
        before, after: results (--out FILE.json) or their logs (.jsonl).
        tolerance: exit with 1 when a metric is worse by more than this beyond noise.
    """
    a, b = scores_of(before), scores_of(after)
    rows = compared(a, b)
    print(HEAD)
    for row in rows:
        print(row.line())
    difference = changed(a, b)
    print(f"\n{len(difference)} of {len([k for k in a if k in b])} objects changed")
    for name, metrics in sorted(difference.items()):
        said = ", ".join(f"{m} {_text(x)} -> {_text(y)}" for m, (x, y) in metrics.items())
        print(f"  {name}: {said}")
    for name in sorted(set(a) ^ set(b)):
        print(f"  {name}: only in {before if name in a else after}")
    if tolerance is not None and any(
        r.worse and abs(r.after - r.before) > tolerance for r in rows
    ):  # fmt: skip
        sys.exit(1)


def _text(value: float | None) -> str:
    return "none" if value is None else f"{value:.3f}"


if __name__ == "__main__":
    tyro.cli(main)
