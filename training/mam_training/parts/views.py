"""Examples as the reasoner's models meet them in training: feature rows, candidates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import lightgbm
import numpy as np
from scipy.optimize import linear_sum_assignment

from mam_pipeline.parts.features import Table, pair_features, primitive_features
from mam_pipeline.parts.group_features import joined, measured
from mam_pipeline.parts.groups import Masks, enumerate_groups, expand_groups
from mam_pipeline.parts.network import Network, Reading, read
from mam_pipeline.types import FloatArray
from mam_training.parts.corpus import load_example
from mam_training.parts.recipe import fold_of

KEEP = 60  # candidates of one object that train the group models
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
        """Train on all folds but `leave`; a model that ranks does so within every object."""
        sizes = [len(f) for f in self.folds if leave is None or f[0] != leave]
        keep = np.ones(sum(map(len, self.labels)), dtype=bool)
        if leave is not None:
            keep = np.concatenate(self.folds) != leave
        data = lightgbm.Dataset(
            np.concatenate(self.values)[keep],
            np.concatenate(self.labels)[keep],
            weight=np.concatenate(self.weights)[keep],
            group=sizes if parameters.get("objective") == "lambdarank" else None,
            feature_name=list(self.names),
            free_raw_data=True,
        )
        return lightgbm.train(COMMON | parameters, data, num_boost_round=rounds)


@dataclass
class Candidates:
    """Candidates of one example with their features and their true overlap.

    Attributes:
        path, fold, prior: which example, its cross-fitting fold, whether seen with a prior.
        masks, features: (C, P) candidates and what the group models see of them.
        reading: what bond models and networks say. overlap: (C, L) with the true links.
        subtype: (L,). truth: number of movable links that own a primitive.
    """

    path: Path
    fold: int
    prior: bool
    masks: Masks
    features: Table
    reading: Reading
    overlap: FloatArray
    subtype: np.ndarray
    truth: int


def candidates_of(
    path: Path, same: Any, move: Any, networks: Sequence[Network], with_prior: bool
) -> Candidates:
    """Enumerate and measure the first candidates of one example under given models."""
    example = load_example(path)
    prior = example.prior() if with_prior else None
    unary = primitive_features(example.graph, prior)
    pairs = pair_features(example.graph, unary, prior)
    s = same.predict(pairs.values, num_threads=1) if len(pairs.values) else np.zeros(0)
    m = move.predict(unary.values, num_threads=1)
    reading = read(networks, example.graph, unary, pairs, s, m)
    masks = enumerate_groups(example.graph, reading.same, reading.move)
    features = measured(example.graph, masks, reading, prior)
    return Candidates(
        path, fold_of(example.name), with_prior, masks, features, reading,
        example.part_overlap(masks), example.subtype, len(example.movable),
    )  # fmt: skip


def widen(item: Candidates, value: Any) -> None:
    """Add the groups beside the best ones, as the reasoner does."""
    example = load_example(item.path)
    prior = example.prior() if item.prior else None
    guess = value.predict(item.features.values, num_threads=1)
    more = expand_groups(example.graph, item.masks, guess, item.reading.same)
    if len(more):
        extra = measured(example.graph, more, item.reading, prior)
        item.masks = np.concatenate([item.masks, more])
        item.features = joined(item.features, extra, item.masks)
        item.overlap = example.part_overlap(item.masks)


def add_overlaps(rows: Rows, item: Candidates, features: Table, rng: np.random.Generator) -> None:
    """Append a draw of candidates with their true overlap."""
    target = item.overlap.max(axis=1, initial=0.0)
    keep = _sample(target, rng)
    weight = np.full(len(keep), np.sqrt(KEEP / max(len(keep), 1)))
    rows.add(some_rows(features, keep), target[keep], weight, item.fold)


def _sample(target: FloatArray, rng: np.random.Generator) -> np.ndarray:
    """All candidates that overlap a true part well, and a draw of the others."""
    good = np.flatnonzero(target > 0.3)
    bad = np.flatnonzero(target <= 0.3)
    room = max(KEEP - len(good), len(good), 20)
    if len(bad) > room:
        bad = rng.choice(bad, room, replace=False)
    return np.sort(np.concatenate([good, bad]))


def some_rows(features: Table, keep: np.ndarray) -> Table:
    """The rows `keep` of a table."""
    return Table(features.names, features.values[keep])


def outcome(item: Candidates, chosen: list[int]) -> tuple[float, float]:
    """(mIoU, count right) of one set of candidates (design section 6)."""
    number = max(len(chosen), item.truth)
    if number == 0:
        return 1.0, 1.0
    table = item.overlap[chosen][:, item.subtype >= 0]
    rows, columns = linear_sum_assignment(-table)
    return float(table[rows, columns].sum() / number), float(len(chosen) == item.truth)
