"""The benchmark's table: means over objects, per category and in total, beside the paper's row."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from mam_pipeline.config_file import plain
from mam_pipeline.weights import learned
from mam_sim_bench.config import BenchConfig
from mam_sim_bench.metrics import reliability
from mam_sim_bench.runner import GENERATED, UNSEEN, Record


@dataclass(frozen=True)
class Row:
    """Means over objects; `pivot` over those with a rotary joint, `executable` over those tested.

    Attributes:
        type_error_joints: type error over all joints, as against the mean over objects.
        median_seconds: of the engine per object.
        flagged_wrong, flagged_right: share of the joints found, the wrong and the right ones, that
            are marked "needs review".
    """

    name: str
    objects: int
    miou: float
    count: float
    type_error: float
    axis: float
    pivot: float | None
    executable: float | None
    axis_signed: float | None = None
    motion: float | None = None
    limits: float | None = None
    bound: float | None = None
    type_error_joints: float | None = None
    median_seconds: float | None = None
    flagged_wrong: float | None = None
    flagged_right: float | None = None


# the tables of the paper (4.2 and the ablations); what is not printed there stays empty
PAPER = (
    Row("paper", 0, 0.86, 0.92, 0.08, 0.12, 0.10, 0.87),
    Row("paper, no kinematic prior", 0, 0.68, 0.81, np.nan, np.nan, None, None),
    Row("paper, no optimisation", 0, np.nan, np.nan, np.nan, 0.23, 0.27, 0.65),
)


def summarise(name: str, records: Sequence[Record]) -> Row:
    """Means over some records."""
    scores = [r.scores for r in records]
    found = [j for s in scores for j in s.found]

    def mean(values: Sequence[float | None]) -> float | None:
        known = [v for v in values if v is not None]
        return float(np.mean(known)) if known else None

    return Row(
        name=name,
        objects=len(records),
        miou=float(np.mean([s.miou for s in scores])),
        count=float(np.mean([s.count for s in scores])),
        type_error=float(np.mean([s.type_error for s in scores])),
        axis=float(np.mean([s.axis for s in scores])),
        pivot=mean([s.pivot for s in scores]),
        executable=mean([None if r.executable is None else float(r.executable) for r in records]),
        axis_signed=mean([s.axis_signed for s in scores]),
        motion=mean([s.motion for s in scores]),
        limits=mean([s.limits for s in scores]),
        bound=mean([r.bound for r in records]),
        type_error_joints=mean([j.type_error for s in scores for j in s.joints]),
        median_seconds=float(np.median([r.seconds for r in records])),
        flagged_wrong=mean([float(j.flagged) for j in found if not j.right]),
        flagged_right=mean([float(j.flagged) for j in found if j.right]),
    )


SURE = 0.8  # confidence from which a joint is said to be nearly certain

METRICS = ("miou", "count", "type_error", "axis", "pivot", "executable", "axis_signed", "motion",
           "limits")  # fmt: skip


def intervals(records: Sequence[Record], draws: int = 1000) -> tuple[Row, Row]:
    """The 2.5 and 97.5 % quantiles of the means over bootstrap samples of the objects.

    Args:
        records: one or several of each object (seeds), which are drawn together.
    """
    known = [
        [getattr(r if m == "executable" else r.scores, m) for m in METRICS] for r in records
    ]  # fmt: skip
    values = np.array([[np.nan if v is None else float(v) for v in row] for row in known])
    ids = sorted({r.id for r in records})
    at = {name: k for k, name in enumerate(ids)}
    owner = np.array([at[r.id] for r in records])
    total, number = np.zeros((len(ids), len(METRICS))), np.zeros((len(ids), len(METRICS)))
    np.add.at(total, owner, np.nan_to_num(values))
    np.add.at(number, owner, ~np.isnan(values))
    drawn = np.random.default_rng(0).integers(len(ids), size=(draws, len(ids)))
    of = number[drawn].sum(axis=1)
    means = total[drawn].sum(axis=1) / np.maximum(of, 1)
    low, high = {}, {}
    for k, metric in enumerate(METRICS):
        measured = means[of[:, k] > 0, k]
        ends = np.quantile(measured, (0.025, 0.975)).tolist() if len(measured) else (None, None)
        low[metric], high[metric] = ends
    return Row("95 % from", 0, **low), Row("to", 0, **high)


def by_category(records: Sequence[Record]) -> list[Row]:
    """One row per category, sorted by name."""
    names = sorted({r.category for r in records})
    return [summarise(n, [r for r in records if r.category == n]) for n in names]


def rows_table(rows: Sequence[Row], title: str) -> Table:
    """A rich table of rows."""
    table = Table(title=title, title_justify="left")
    table.add_column("", no_wrap=True)
    heads = "n mIoU count type axis pivot exec signed motion limits bound s"
    for head in heads.split():
        table.add_column(head, justify="right", no_wrap=True)
    for r in rows:
        values = [r.miou, r.count, r.type_error, r.axis, r.pivot, r.executable]
        values += [r.axis_signed, r.motion, r.limits, r.bound]
        cells = [_number(v) for v in values]
        seconds = "" if r.median_seconds is None else f"{r.median_seconds:.1f}"
        table.add_row(r.name, str(r.objects or ""), *cells, seconds)
    return table


def objects_table(records: Sequence[Record]) -> Table:
    """A rich table with one line per object, the worst first."""
    table = Table(title="objects", title_justify="left")
    table.add_column("object", no_wrap=True)
    for head in ("mIoU", "parts", "type", "axis", "pivot", "exec", "bound", "K", "s"):
        table.add_column(head, justify="right", no_wrap=True)
    table.add_column("why", no_wrap=True)
    for r in sorted(records, key=lambda r: (r.scores.miou, r.id)):
        s = r.scores
        runs = "" if r.executable is None else ("yes" if r.executable else "no")
        why = r.why if r.status != "ok" else " ".join(r.reasons)
        table.add_row(
            r.id, _number(s.miou), f"{s.predicted_parts}/{s.true_parts}", _number(s.type_error),
            _number(s.axis), _number(s.pivot), runs, _number(r.bound), str(r.primitives),
            f"{r.seconds:.1f}", why[:40],
        )  # fmt: skip
    return table


def review_line(records: Sequence[Record]) -> str:
    """How many of the joints found are wrong, and how many of either sort say "needs review"."""
    found = [j for r in records for j in r.scores.found]
    told = []
    for name, some in (("wrong", [j for j in found if not j.right]),
                       ("right", [j for j in found if j.right])):  # fmt: skip
        told.append(f"{sum(j.flagged for j in some)} of {len(some)} {name} ones")
    return f"needs review: of {len(found)} joints found, {' and '.join(told)}"


def motionless_line(records: Sequence[Record]) -> str:
    """How many objects in which nothing moves got a joint; empty where there are none."""
    still = [r for r in records if r.scores.true_parts == 0]
    wrong = sum(r.scores.predicted_parts > 0 for r in still)
    return f"false joints: {wrong} of {len(still)} objects in which nothing moves" if still else ""


def calibration(records: Sequence[Record]) -> dict[str, Any]:
    """How far the confidence of a joint is the chance that it is right.

    Returns:
        joints; error: expected calibration error; bins: mean confidence, share that is right and
        number of the joints between every two tenths; true: joints of the truth; wrong; unmarked:
        wrong ones without "needs review"; unmarked_sure: those of them at `SURE` or more.
    """
    found = [j for r in records for j in r.scores.found]
    error, bins = reliability(
        np.array([j.confidence for j in found]), np.array([float(j.right) for j in found])
    )
    wrong = [j for j in found if not j.right]
    return {
        "joints": len(found), "error": round(error, 4), "bins": bins,
        "true": sum(r.scores.true_parts for r in records), "wrong": len(wrong),
        "unmarked": sum(not j.flagged for j in wrong),
        "unmarked_sure": sum(not j.flagged and j.confidence >= SURE for j in wrong),
    }  # fmt: skip


def calibration_line(records: Sequence[Record]) -> str:
    """The same in words."""
    said = calibration(records)
    bins = ", ".join(f"{a:.2f}: {b:.2f} of {n}" for a, b, n in said["bins"])
    return f"confidence of a joint: share that is right: {bins}; calibration error {said['error']}"


def models_of(records: Sequence[Record], dataset: str) -> dict[str, Any]:
    """The weights that some records came from, and what they were trained on.

    Returns:
        weights: one entry per room; unseen: whether none of them was trained on the dataset, by
        the name of its folder; of generated objects, whether their kinds were held back; None where
        some were not.
    """
    found = learned(sorted({room for r in records for room in r.weights}))
    name = Path(dataset).resolve().name
    generated = dataset.startswith(GENERATED)
    return {
        "weights": [asdict(one) for one in found],
        "unseen": (True if dataset == GENERATED + UNSEEN else None)
        if generated
        else all(name not in one.trained_on for one in found),
    }


def seen_line(models: Mapping[str, Any], dataset: str) -> str:
    """What `models_of` says, in words; empty for generated objects."""
    if models["unseen"] is None:
        return ""
    name = Path(dataset).resolve().name
    seen = [w["room"] for w in models["weights"] if name in w["trained_on"]]
    if seen:
        return f"models: {', '.join(seen)} were trained on {name}: these figures are too good"
    return f"models: none was trained on {name}"


def as_json(records: Sequence[Record], dataset: str, config: BenchConfig) -> dict[str, Any]:
    """Everything as plain data; numbers the paper does not print are null."""
    return {
        "dataset": dataset,
        "models": models_of(records, dataset),
        "config": {"bench": plain(config)},
        "total": _plain(summarise("total", records)) if records else None,
        "interval": [_plain(r) for r in intervals(records)] if records else None,
        "calibration": calibration(records),
        "paper": [_plain(r) for r in PAPER],
        "categories": [_plain(r) for r in by_category(records)],
        "objects": [asdict(r) for r in records],
    }


def _number(value: float | None) -> str:
    return "" if value is None or np.isnan(value) else f"{value:.3f}"


def _plain(row: Row) -> dict[str, Any]:
    data = asdict(row)
    return {k: None if isinstance(v, float) and np.isnan(v) else v for k, v in data.items()}
