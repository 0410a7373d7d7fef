"""Joints where nothing moves, and true joints that are withheld: what the bar of abstention does.

    python benchmarks/false_joints.py --out docs/results/false_joints.json

Generated objects of test seeds: those in which nothing moves (of kinds that the bar was fitted on,
and of kinds that it was not), and one of every kind with joints. The engine runs once on each and
withholds nothing; the bar is applied to what it found.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from common import save

from mam_pipeline.metrics import reliability
from mam_pipeline.parts.abstain import Bar, load_bar
from mam_training.parts.fit_abstention import REAL, collect, handed_over, read
from mam_world.registry import CATEGORIES, motionless
from mam_world.splits import MOTIONLESS_TEST_ONLY

BARS = (0.02, 0.04, 0.07, 0.1, 0.2, 0.3, 0.5, 0.7)


@dataclass(frozen=True)
class Settings:
    """What is measured.

    Attributes:
        motionless: objects of every kind in which nothing moves. movable: of every `step`-th kind
            with joints. start: first seed that is looked at; test seeds end in 9.
        most: objects in all, the first of a mixed order.
        log: JSON lines of the engine's answers, which are read again. out: JSON file.
    """

    motionless: int = 9
    movable: int = 1
    step: int = 3
    start: int = 509
    most: int | None = None
    log: Path = Path("build/false_joints.jsonl")
    out: Path | None = None


def planned(settings: Settings) -> list[tuple[str, int]]:
    """Objects of both sorts, mixed."""
    pairs = [
        (name, seed)
        for names, count in (
            (list(motionless()), settings.motionless),
            (list(CATEGORIES)[:: settings.step], settings.movable),
        )
        for name in names for seed in handed_over(name, settings.start, count, (9,))
    ]  # fmt: skip
    order = np.random.default_rng(0).permutation(len(pairs))
    return [pairs[i] for i in order]


def sums(rows: Sequence[dict[str, Any]], bar: Bar) -> dict[str, Any]:
    """Counts over some objects, with and without the bar."""
    parts = [(r, p) for r in rows for p in r["parts"]]
    kept = [
        (r, p) for r in rows
        for p, stays in zip(r["parts"], bar.keeps([bar.chance(p["signs"]) for p in r["parts"]]))
        if stays
    ]  # fmt: skip
    return {
        "objects": len(rows),
        "with a joint, nothing withheld": sum(bool(r["parts"]) for r in rows),
        "with a joint": len({(r["category"], r["seed"]) for r, _ in kept}),
        "true joints": sum(r["true"] for r in rows),
        "true parts found, nothing withheld": sum(p["iou"] >= REAL for _, p in parts),
        "true parts found": sum(p["iou"] >= REAL for _, p in kept),
        "false parts, nothing withheld": sum(p["iou"] < REAL for _, p in parts),
        "false parts": sum(p["iou"] < REAL for _, p in kept),
    }


def _other_bars(rows: Sequence[dict[str, Any]], bar: Bar) -> dict[str, Any]:
    """What higher and lower bars would do."""
    still = [r for r in rows if not r["true"]]
    moving = [r for r in rows if r["true"]]
    out = {}
    for least in BARS:
        other = replace(bar, least=least, others=min(bar.others, least))
        out[f"{least:g}"] = {
            "motionless objects with a joint": sums(still, other)["with a joint"],
            "true parts found": sums(moving, other)["true parts found"],
        }
    return out


def main(settings: Settings) -> None:
    """Collect, count, save."""
    bar = load_bar()
    settings.log.parent.mkdir(parents=True, exist_ok=True)
    pairs = planned(settings)[: settings.most]
    collect(settings.log, pairs)
    wanted = set(pairs)
    rows = [r for r in read(settings.log) if (r["category"], r["seed"]) in wanted]
    still = [r for r in rows if not r["true"]]
    chance = np.array([bar.chance(p["signs"]) for r in rows for p in r["parts"]])
    real = np.array([float(p["iou"] >= REAL) for r in rows for p in r["parts"]])
    error, bins = reliability(chance, real)
    found = {
        "nothing moves, kinds fitted on": sums(
            [r for r in still if r["category"] not in MOTIONLESS_TEST_ONLY], bar
        ),
        "nothing moves, other kinds": sums(
            [r for r in still if r["category"] in MOTIONLESS_TEST_ONLY], bar
        ),
        "with joints": sums([r for r in rows if r["true"]], bar),
    }
    kinds = {
        name: sums([r for r in still if r["category"] == name], bar)["with a joint"]
        for name in motionless()
    }
    result = {
        "bar": bar.least, "groups": found, "other bars": _other_bars(rows, bar),
        "motionless kinds with a joint": kinds,
        "expected calibration error": round(error, 3), "reliability": bins,
    }  # fmt: skip
    print(json.dumps(result, indent=1))
    save(settings.out, [result])


if __name__ == "__main__":
    tyro.cli(main, config=(tyro.conf.OmitArgPrefixes,))
