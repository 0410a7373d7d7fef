"""Trains the reasoner on procedural objects: `python -m mam_pipeline.reason.train --count N`.

Recipe: N objects of the world's training split, in every style, through the real segmenter and
probing; (1) pair and primitive models, cross-fitted in folds by object; (2) candidates from the
cross-fitted scores, and a model of their overlap with true parts; (3) the same again with what
the first look says of rivals and twins, also cross-fitted; (4) the type of parts. Every example is
seen twice, with and without a kinematic prior. The threshold is chosen, and the confidence
calibrated, on the validation split, which has categories of its own.
"""

from __future__ import annotations

import argparse
import gzip
import json
import sys
import time
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import lightgbm
import numpy as np
from scipy.optimize import linear_sum_assignment

from mam_pipeline.reason.corpus import (
    Example,
    abstract_example,
    abstract_kinds,
    load_example,
    save_example,
    world_example,
)
from mam_pipeline.reason.features import Table, pair_features, primitive_features
from mam_pipeline.reason.group_features import group_features, with_rivals
from mam_pipeline.reason.groups import Masks, enumerate_groups
from mam_pipeline.reason.scores import MODELS, LearnedScores
from mam_pipeline.reason.select import select_groups
from mam_pipeline.types import FloatArray
from mam_pipeline.world.splits import iterate

FOLDS = 2
KEEP = 60  # candidates of one object that train the group models
# cases and mechanisms vary most, so they come most often
MIX = tuple(
    f"abstract_{k}"
    for k in [
        "case",
        "mechanism",
        "case",
        "lidded",
        "mechanism",
        "case",
        "console",
        "doorway",
        "mechanism",
        "case",
        "vehicle",
        "mechanism",
        "case",
        "console",
        "doorway",
        "lidded",
    ]
)
COMMON: dict[str, Any] = {
    "learning_rate": 0.08, "num_leaves": 31, "min_data_in_leaf": 40, "feature_fraction": 0.5,
    "bagging_fraction": 0.7, "bagging_freq": 1, "lambda_l2": 5.0, "verbose": -1, "num_threads": 1,
    "seed": 7, "deterministic": True, "force_row_wise": True, "max_bin": 127,
}  # fmt: skip


@dataclass
class Rows:
    """Training rows of one model, with the fold of every row."""

    names: tuple[str, ...]
    values: list[np.ndarray]
    labels: list[np.ndarray]
    weights: list[np.ndarray]
    folds: list[np.ndarray]

    @classmethod
    def empty(cls) -> Rows:
        """No rows yet."""
        return cls((), [], [], [], [])

    def add(self, features: Table, label: FloatArray, weight: FloatArray, fold: int) -> None:
        """Append the rows of one object."""
        self.names = features.names
        self.values.append(features.values)
        self.labels.append(np.asarray(label, dtype=np.float32))
        self.weights.append(np.asarray(weight, dtype=np.float32))
        self.folds.append(np.full(len(label), fold))

    def fit(self, rounds: int, leave: int | None = None, **parameters: Any) -> lightgbm.Booster:
        """Train on all folds but `leave`."""
        keep = np.ones(sum(map(len, self.labels)), dtype=bool)
        if leave is not None:
            keep = np.concatenate(self.folds) != leave
        data = lightgbm.Dataset(
            np.concatenate(self.values)[keep],
            np.concatenate(self.labels)[keep],
            weight=np.concatenate(self.weights)[keep],
            feature_name=list(self.names),
            free_raw_data=True,
        )
        return lightgbm.train(COMMON | parameters, data, num_boost_round=rounds)


def fold_of(name: str) -> int:
    """The cross-fitting fold of an object."""
    return zlib.crc32(name.encode()) % FOLDS


def jobs(split: str, world: int, abstract: int) -> list[tuple[str, int]]:
    """(kind, seed) of a split's objects: the world's categories, and the abstract kinds."""
    out = list(iterate(split, world)) if world else []
    kinds = list(abstract_kinds())
    first = 0 if split == "train" else 1_000_000
    made = dict.fromkeys(kinds, 0)
    for n in range(abstract):
        kind = MIX[n % len(MIX)]
        step = 2 * made[kind] if kind == kinds[0] else 10 * made[kind] + 2 * kinds.index(kind) - 1
        out.append((kind, first + step))
        made[kind] += 1
    return out


def gather(pairs: list[tuple[str, int]], cache: Path) -> list[Path]:
    """Make the examples, or find them in the cache; an object that fails is skipped."""
    out, started = [], time.time()
    for kind, seed in pairs:
        path = cache / f"{kind}_{seed:06d}.ex"
        if not path.exists():
            try:
                example = abstract_example if kind.startswith("abstract") else world_example
                save_example(example(kind, seed), path)
            except Exception as error:  # one bad object must not end an hour of work
                print(f"skipped {path.stem}: {error!r}", file=sys.stderr)
                continue
        out.append(path)
    print(f"{len(out)} examples, {time.time() - started:.0f} s", file=sys.stderr)
    return out


def fit_bonds(paths: list[Path]) -> tuple[dict[str, list[lightgbm.Booster]], dict[str, Any]]:
    """Pair and primitive models: per fold (trained on the others) and on everything."""
    same, move = Rows.empty(), Rows.empty()
    for path in paths:
        example = load_example(path)
        graph, link, purity = example.graph, example.link, example.purity
        moving = (example.subtype[link] >= 0).astype(float)
        pair_label = (link[graph.pairs[:, 0]] == link[graph.pairs[:, 1]]).astype(float)
        trust = purity[graph.pairs].min(axis=1)
        priors = (example.prior(), None) if fold_of(example.name + "?") == 0 else (example.prior(),)
        for prior in priors:
            unary = primitive_features(graph, prior)
            pairs = pair_features(graph, unary, prior)
            n, e = max(graph.count, 1), max(len(graph.pairs), 1)
            move.add(unary, moving, purity * np.sqrt(20 / n), fold_of(example.name))
            if len(graph.pairs):
                same.add(pairs, pair_label, trust * np.sqrt(60 / e), fold_of(example.name))
    folds: dict[str, list[lightgbm.Booster]] = {"same": [], "move": []}
    for k in range(FOLDS):
        folds["same"].append(same.fit(150, k, objective="binary"))
        folds["move"].append(move.fit(150, k, objective="binary"))
    final = {
        "same": same.fit(150, objective="binary"),
        "move": move.fit(150, objective="binary"),
    }
    return folds, final


@dataclass
class Look:
    """Candidates of one example with their features and their true overlap."""

    example: str
    fold: int
    prior: bool
    masks: Masks
    features: Table
    overlap: FloatArray
    subtype: np.ndarray
    truth: int


def look(example: Example, same: Any, move: Any, with_prior: bool) -> Look:
    """Enumerate and measure the candidates of one example under given bond models."""
    prior = example.prior() if with_prior else None
    unary = primitive_features(example.graph, prior)
    pairs = pair_features(example.graph, unary, prior)
    s = same.predict(pairs.values, num_threads=1) if len(pairs.values) else np.zeros(0)
    m = move.predict(unary.values, num_threads=1)
    masks = enumerate_groups(example.graph, s, m)
    features = group_features(example.graph, masks, s, m, prior)
    overlap = example.part_overlap(masks)
    visible = (example.overlap.sum(axis=0) > 0) & (example.subtype >= 0)
    return Look(
        example.name, fold_of(example.name), with_prior, masks, features, overlap,
        example.subtype, int(visible.sum()),
    )  # fmt: skip


def fit_groups(looks: list[Look]) -> tuple[dict[str, Any], list[np.ndarray]]:
    """Value, revise and type models on all looks; the cross-fitted revised values of each."""
    value, kind = Rows.empty(), Rows.empty()
    rng = np.random.default_rng(0)
    for item in looks:
        target = item.overlap.max(axis=1)
        keep = _sample(target, rng)
        weight = np.full(len(keep), np.sqrt(KEEP / max(len(keep), 1)))
        value.add(_rows(item.features, keep), target[keep], weight, item.fold)
        good = np.flatnonzero(target > 0.6)
        if len(good):
            label = item.subtype[item.overlap[good].argmax(axis=1)]
            weight = target[good] * np.sqrt(10 / len(good))
            kind.add(_rows(item.features, good), label, weight, item.fold)
    loss: dict[str, Any] = {"objective": "cross_entropy"}
    first = [value.fit(200, k, **loss) for k in range(FOLDS)]
    revise = Rows.empty()
    widened = []
    for item in looks:
        guess: Any = first[item.fold].predict(item.features.values, num_threads=1)
        wide = with_rivals(item.features, item.masks, guess)
        widened.append(wide)
        target = item.overlap.max(axis=1)
        keep = _sample(target, rng)
        weight = np.full(len(keep), np.sqrt(KEEP / max(len(keep), 1)))
        revise.add(_rows(wide, keep), target[keep], weight, item.fold)
    second = [revise.fit(150, k, **loss) for k in range(FOLDS)]
    revised: list[Any] = [
        second[item.fold].predict(wide.values, num_threads=1) for item, wide in zip(looks, widened)
    ]
    final = {
        "value": value.fit(200, **loss),
        "revise": revise.fit(150, **loss),
        "subtype": kind.fit(80, objective="multiclass", num_class=3),
    }
    return final, revised


def _sample(target: FloatArray, rng: np.random.Generator) -> np.ndarray:
    """All candidates that overlap a true part well, and a draw of the others."""
    good = np.flatnonzero(target > 0.3)
    bad = np.flatnonzero(target <= 0.3)
    room = max(KEEP - len(good), len(good), 20)
    if len(bad) > room:
        bad = rng.choice(bad, room, replace=False)
    return np.sort(np.concatenate([good, bad]))


def _rows(features: Table, keep: np.ndarray) -> Table:
    return Table(features.names, features.values[keep])


def outcome(item: Look, value: FloatArray, threshold: float) -> tuple[float, float]:
    """(mIoU, count right) of one look under a threshold (design section 6)."""
    chosen = select_groups(item.masks, value, threshold)
    number = max(len(chosen), item.truth)
    if number == 0:
        return 1.0, 1.0
    table = item.overlap[chosen][:, item.subtype >= 0]
    rows, columns = linear_sum_assignment(-table)
    return float(table[rows, columns].sum() / number), float(len(chosen) == item.truth)


def sweep(looks: list[Look], values: list[np.ndarray]) -> dict[float, tuple[float, float]]:
    """Mean (mIoU, count accuracy) for a range of thresholds."""
    out = {}
    for threshold in np.round(np.arange(0.3, 0.9, 0.05), 2):
        pairs = [outcome(i, v, float(threshold)) for i, v in zip(looks, values)]
        mean = np.mean(pairs, axis=0)
        out[float(threshold)] = (float(mean[0]), float(mean[1]))
    return out


def calibrate(
    looks: list[Look], values: list[np.ndarray], threshold: float
) -> list[tuple[float, float]]:
    """Isotonic curve from a chosen candidate's value to the odds of an overlap above one half."""
    from sklearn.isotonic import IsotonicRegression

    x, y = [], []
    for item, value in zip(looks, values):
        for c in select_groups(item.masks, value, threshold):
            x.append(value[c])
            y.append(float(item.overlap[c].max() > 0.5))
    curve = IsotonicRegression(out_of_bounds="clip", y_min=0.02, y_max=0.98).fit(x, y)
    grid = np.linspace(0, 1, 21)
    return [(float(a), float(b)) for a, b in zip(grid, curve.predict(grid))]


def save(models: dict[str, Any], settings: dict[str, Any], out: Path) -> None:
    """Write the weights as package data."""
    out.mkdir(parents=True, exist_ok=True)
    for name in MODELS:
        text = models[name].model_to_string().encode("utf-8")
        with gzip.GzipFile(out / f"{name}.txt.gz", "wb", mtime=0) as stream:
            stream.write(text)
    (out / "settings.json").write_text(json.dumps(settings, indent=1), encoding="utf-8")


def main(arguments: list[str] | None = None) -> None:
    """Make the corpus, train, choose the threshold on validation, write the weights."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--count", type=int, default=650, help="objects of the world")
    parser.add_argument("--abstract", type=int, default=250, help="abstract objects")
    parser.add_argument("--validation", type=int, default=150, help="of either sort")
    parser.add_argument("--cache", type=Path, required=True, help="folder for examples")
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "weights")
    options = parser.parse_args(arguments)
    train = gather(jobs("train", options.count, options.abstract), options.cache)
    held_out = jobs("validation", min(options.validation, options.count), options.validation)
    validation = gather(held_out, options.cache)
    folds, models = fit_bonds(train)
    print("pair and primitive models are trained", file=sys.stderr, flush=True)
    looks = []
    for n, path in enumerate(train):
        example = load_example(path)
        k = fold_of(example.name)
        for with_prior in (True, False) if n % 4 == 0 else (True,):
            looks.append(look(example, folds["same"][k], folds["move"][k], with_prior))
    print(f"{len(looks)} looks", file=sys.stderr, flush=True)
    final, _ = fit_groups(looks)
    models |= final
    scores = LearnedScores(models, {"threshold": 0.5, "calibration": [(0, 0), (1, 1)]})
    settings: dict[str, Any] = {"objects": len(train), "recipe": __doc__.splitlines()[0]}
    for with_prior in (False, True):
        held = [
            look(load_example(p), models["same"], models["move"], with_prior) for p in validation
        ]
        values = [
            scores.revise(with_rivals(i.features, i.masks, scores.value(i.features))) for i in held
        ]
        table = sweep(held, values)
        best = max(table, key=lambda t: sum(table[t]))
        print(f"validation, prior {with_prior}: {table}", file=sys.stderr)
        settings |= {"threshold": best, "calibration": calibrate(held, values, best)}
        settings[f"validation_{'with' if with_prior else 'without'}_prior"] = table[best]
    save(models, settings, options.out)
    print(json.dumps({k: v for k, v in settings.items() if k != "calibration"}))


if __name__ == "__main__":
    main()
