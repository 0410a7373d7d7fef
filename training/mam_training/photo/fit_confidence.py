"""Fits the photo stage's confidence on rendered photos with exact truth.

Collects (features, right or wrong) of every photo into a JSON-lines file, resuming it, then fits
one logistic function per topic and sets the limit of "high" so that, in cross-validation, at least
98 % of what is called high is right on the clean and 92 % on the clutter level (a little above
what is promised: 97 and 90). Right means: cuboid, the front's IoU with the truth is 0.8 or more;
panels, as many as in truth and all matched at IoU 0.5; handles, at least three in four of the
truth's hit and three in four of those named right. None of the seeds is one of the handle model's
(100 on). Measure a fit with `bench-photo --seed 8` or more.

    python -m mam_training.photo.fit_confidence configs/train/photo_confidence.yaml
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import optimize

import mam_pipeline.photo
from mam_pipeline.photo.confidence import TOPICS, features
from mam_pipeline.photo.evaluate import score_found
from mam_pipeline.photo.find import find_object
from mam_pipeline.photo.image import make_photo
from mam_pipeline.photo.options import PhotoOptions
from mam_training import manifest
from mam_training.command import configured
from mam_world.photos.synthetic_photo import LEVELS, synthesise

Array = NDArray[np.float64]
WEIGHTS = Path(mam_pipeline.photo.__file__).parent / "weights" / "confidence"
USED = {
    "cuboid": ("cost", "margin", "trust", "seen"),
    "panels": ("cost", "support", "weakest", "seen", "score", "alike", "single", "none"),
    "handles": ("cost", "seen", "score", "alike", "single", "none"),
}
# signs that are known beforehand: few photos must not turn them round
SIGN = {"cost": -1, "none": -1, "single": 0}
GOAL = {"clean": 0.98, "medium": 0.95, "clutter": 0.92}
PRIOR = 0.5  # strength of the pull of weights towards zero, in photos


def collect(path: Path, first: int, count: int, width: int) -> None:
    """Append a row per photo that the file does not hold yet."""
    cv2.setNumThreads(1)
    have = {(r["level"], r["seed"]) for r in read(path)}
    with path.open("a", encoding="utf-8") as file:
        for seed in range(first, first + count):
            for level in LEVELS:
                if (level, seed) in have:
                    continue
                image, truth = synthesise(seed, level, width)
                photo = make_photo(image)
                found = find_object(photo, PhotoOptions())
                s = score_found(found, photo, truth)
                right = {
                    "cuboid": s.front_iou >= 0.8,
                    "panels": s.matched50 == s.panels == s.found,
                    "handles": s.handles_hit >= 0.75 * s.handles
                    and s.handles_right >= 0.75 * s.handles_found
                    and s.handles_found > 0,
                }
                row = {"level": level, "seed": seed, "x": features(found), "right": right}
                file.write(json.dumps(row) + "\n")
                file.flush()


def read(path: Path) -> list[dict[str, Any]]:
    """Rows of a file, none if it does not exist."""
    if not path.is_file():
        return []
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines() if line]


def logistic(x: Array, y: Array, signs: list[int]) -> Array:
    """Bias and weights of a logistic fit with a Gaussian prior and bounded signs."""

    def cost(w: Array) -> float:
        z = w[0] + x @ w[1:]
        fit = np.logaddexp(0, z) - y * z
        return float(fit.sum() + 0.5 * PRIOR * (w[1:] ** 2).sum() / 4)

    bounds: list[tuple[float | None, float | None]] = [(None, None)]
    bounds += [(0, None) if s > 0 else (None, 0) if s < 0 else (None, None) for s in signs]
    return np.asarray(optimize.minimize(cost, np.zeros(x.shape[1] + 1), bounds=bounds).x)


def limit(p: Array, y: Array, level: NDArray[Any]) -> float:
    """The least limit above which every level reaches its goal; 0.999 where none does."""
    for t in np.unique(np.round(p, 3)):
        high = p >= t
        reached = all(
            not (high & (level == k)).any() or y[high & (level == k)].mean() >= goal
            for k, goal in GOAL.items()
        )
        if reached:
            return float(t)
    return 0.999


def fit(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Weights, limits and their record, by topic."""
    level = np.array([r["level"] for r in rows])
    fold = np.array([r["seed"] % 5 for r in rows])
    out: dict[str, Any] = {}
    for topic in TOPICS:
        names = USED[topic]
        signs = [SIGN.get(n, 1) for n in names]
        x = np.array([[r["x"][n] for n in names] for r in rows])
        y = np.array([float(r["right"][topic]) for r in rows])
        p = np.zeros(len(rows))
        for k in range(5):
            w = logistic(x[fold != k], y[fold != k], signs)
            p[fold == k] = 1 / (1 + np.exp(-(w[0] + x[fold == k] @ w[1:])))
        high = limit(p, y, level)
        w = logistic(x, y, signs)
        record = {
            k: {
                "photos": int((level == k).sum()),
                "high": int(((p >= high) & (level == k)).sum()),
                "right": int(y[(p >= high) & (level == k)].sum()),
            }
            for k in LEVELS
        }
        out[topic] = {
            "bias": round(float(w[0]), 4),
            "weights": {n: round(float(v), 4) for n, v in zip(names, w[1:])},
            "high": round(high, 3), "medium": round(min(0.5, 0.6 * high), 3), "record": record,
        }  # fmt: skip
    return out


@dataclass(frozen=True)
class ConfidenceTraining:
    """What the confidence is fitted on, and where it goes."""

    seeds: tuple[tuple[int, int], ...] = ((2000, 16), (0, 8))
    """Runs of seeds (first, how many); each seed makes one photo of every level of clutter."""
    width: int = 720
    """Pixels of the rendered photos."""
    cache: Path = Path("build/photo_confidence.jsonl")
    """Rows that were collected, which are read again."""
    out: Path = WEIGHTS
    """Folder that the fit and its manifest are written to."""


def main(argv: Sequence[str] | None = None) -> None:
    """Collect, fit, keep."""
    config = configured(ConfidenceTraining(), argv)
    config.cache.parent.mkdir(parents=True, exist_ok=True)
    for first, count in config.seeds:
        collect(config.cache, first, count, config.width)
    wanted = {s for first, count in config.seeds for s in range(first, first + count)}
    rows = [r for r in read(config.cache) if r["seed"] in wanted]
    kept: dict[str, Any] = {"photos": len(rows), "goal": GOAL, "topics": fit(rows)}
    config.out.mkdir(parents=True, exist_ok=True)
    text = json.dumps(kept, indent=1) + "\n"
    (config.out / "confidence.json").write_text(text, encoding="utf-8")
    manifest.write(
        config.out,
        "python -m mam_training.photo.fit_confidence configs/train/photo_confidence.yaml",
        config,
        {"first photo": config.seeds[0][0]},
        {"photos": len(rows),
         "sha256": manifest.data_digest(json.dumps(r, sort_keys=True).encode() for r in rows)},
    )  # fmt: skip
    for topic, made in kept["topics"].items():
        print(topic, "high from", made["high"], made["record"])


if __name__ == "__main__":
    main()
