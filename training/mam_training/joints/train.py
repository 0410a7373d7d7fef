"""Trains the joint ranker on generated objects and packs its weights.

    python -m mam_training.joints.train configs/train/joints.yaml

Measures the features of objects of the training split, of more of kinds that stand in homes, a
share of them modelled loosely or built of blocks, and of fused ones (of the validation split a
tenth as many, categories included that are never trained on), fits small boosted trees, sets the
temperatures on the validation split, prints its figures and writes weights and manifest.
"""

from __future__ import annotations

import json
import lzma
import sys
import warnings
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import lightgbm as lgb
import numpy as np
from scipy.optimize import minimize_scalar

from mam_pipeline.joints.features import LINE_NAMES, PART_NAMES, SLIDE_NAMES
from mam_pipeline.joints.ranker import FILE, Bag, kind_features, model_rows, softmax
from mam_pipeline.types import FloatArray
from mam_pipeline.weights import standing_in
from mam_training import manifest
from mam_training.command import configured
from mam_training.joints.examples import Example, cached_examples
from mam_training.parts.recipe import blocky, jobs, loose
from mam_training.parts.train import lean

COMMON = {"verbosity": -1, "num_threads": 1, "seed": 0, "deterministic": True,
          "force_row_wise": True, "feature_fraction": 0.4, "bagging_fraction": 0.7,
          "bagging_freq": 1, "min_data_in_leaf": 20, "lambda_l2": 5.0, "max_bin": 63}  # fmt: skip
RANK = {**COMMON, "objective": "lambdarank", "num_leaves": 15, "learning_rate": 0.06,
        "lambdarank_truncation_level": 5, "label_gain": [0, 1, 3]}  # fmt: skip
KIND = {**COMMON, "objective": "binary", "num_leaves": 11, "learning_rate": 0.05,
        "feature_fraction": 0.3}  # fmt: skip
BINARY = {**COMMON, "objective": "binary", "num_leaves": 7, "learning_rate": 0.05}
REACH = {**COMMON, "objective": "l1", "num_leaves": 7, "learning_rate": 0.05}
FOLDS = 3
BAGS = 3
ROUNDS = {"line": 442, "slide": 272, "moves": 595, "slides": 595}


def weights(data: Sequence[Example]) -> FloatArray:
    """(n,) weight of each example: categories with many joints count less than in proportion."""
    count = Counter(e.category for e in data)
    w = np.array([count[e.category] ** -0.5 for e in data])
    return np.asarray(w / max(w.mean(), 1e-12))


def rows_of(example: Example, revolute: bool) -> tuple[FloatArray, FloatArray]:
    """Model rows (n, d) and grades (n,) of one part's lines or slides."""
    keep = [i for i, h in enumerate(example.hypotheses) if h.revolute == revolute]
    names = LINE_NAMES if revolute else SLIDE_NAMES
    rows = np.array([example.hypotheses[i].features for i in keep]).reshape(-1, len(names))
    return model_rows(example.part, rows, names), example.grade[keep].astype(np.float64)


def bagged(parameters: dict[str, Any], data: lgb.Dataset, rounds: int, bags: int = BAGS) -> Bag:
    """`bags` boosters that differ in their draws of rows and columns."""
    data.params = dict(parameters)
    draws = [{**parameters, "bagging_seed": k, "feature_fraction_seed": k} for k in range(bags)]
    return Bag([lgb.train(draw, data, rounds) for draw in draws])


def fit_ranker(data: Sequence[Example], revolute: bool, rounds: int, bags: int = BAGS) -> Bag:
    """Listwise ranker over the hypotheses of every moving part of the right kind."""
    chosen = [e for e in data if e.kind == (2 if revolute else 1) and e.grade.max(initial=0) > 0]
    pairs = [rows_of(e, revolute) for e in chosen]
    x = np.concatenate([p[0] for p in pairs])
    y = np.concatenate([p[1] for p in pairs])
    group = [len(p[1]) for p in pairs]
    data_set = lgb.Dataset(x, y, group=group, weight=np.repeat(weights(chosen), group))
    return bagged(RANK, data_set, rounds, bags)


def kind_rows(data: Sequence[Example], line: Bag, slide: Bag) -> FloatArray:
    """Rows (n, d) of the models of kind, from the scores of two rankers."""
    found = []
    for revolute, booster in ((True, line), (False, slide)):
        rows = [rows_of(e, revolute)[0] for e in data]
        cuts = np.cumsum([len(r) for r in rows])[:-1]
        scores = np.asarray(booster.predict(np.concatenate(rows), num_threads=1))
        found.append(np.split(scores, cuts))
    return np.array([
        kind_features(e.part, e.hypotheses, a, b) for e, a, b in zip(data, *found)
    ])  # fmt: skip


def fit_kinds(data: Sequence[Example]) -> tuple[Bag, Bag]:
    """Does it move; does it slide. On out-of-fold scores, as the rankers will be met in use."""
    names = sorted({e.name for e in data})
    fold = {n: i % FOLDS for i, n in enumerate(np.random.default_rng(0).permutation(names))}
    xs: list[FloatArray] = []
    order: list[Example] = []
    for k in range(FOLDS):
        inside = [e for e in data if fold[e.name] != k]
        left = [e for e in data if fold[e.name] == k]
        if not left:
            continue
        lines, slides = fit_ranker(inside, True, 80, 1), fit_ranker(inside, False, 60, 1)
        xs.append(kind_rows(left, lines, slides))
        order += left
    x = np.concatenate(xs)
    kind = np.array([e.kind for e in order])
    moves = bagged(
        KIND, lgb.Dataset(x, (kind > 0).astype(float), weight=weights(order)), ROUNDS["moves"]
    )
    moving = np.flatnonzero(kind > 0)
    few = [order[i] for i in moving]
    target = (kind[moving] == 1).astype(float)
    slide = bagged(KIND, lgb.Dataset(x[moving], target, weight=weights(few)), ROUNDS["slides"])
    return moves, slide


def fit_side(data: Sequence[Example], revolute: bool, rounds: int) -> Bag | None:
    """Is the hypothesis's positive side the opening side? On hypotheses near the truth."""
    x, y = [], []
    for e in data:
        for h, opens in zip(e.hypotheses, e.opens):
            if h.revolute == revolute and opens != 0:
                x.append(np.concatenate([h.features, e.part]))
                y.append(float(opens > 0))
    if len(y) < 100 or min(np.mean(y), 1 - np.mean(y)) < 0.005:
        return None
    return bagged(BINARY, lgb.Dataset(np.array(x), np.array(y)), rounds)


def fit_reach(data: Sequence[Example], revolute: bool, column: int, rounds: int) -> Bag | None:
    """Travel from rest to open (column 0) or to closed (1), on the part's right hypotheses."""
    x, y = [], []
    for e in data:
        if not np.isfinite(e.reach).all():
            continue
        for h, grade in zip(e.hypotheses, e.grade):
            if h.revolute == revolute and grade == 2:
                x.append(np.concatenate([h.features, e.part]))
                y.append(min(float(e.reach[column]), 6.0))
    if len(y) < 100:
        return None
    return bagged(REACH, lgb.Dataset(np.array(x), np.array(y)), rounds, 1)


def fit_endless(data: Sequence[Example], rounds: int) -> Bag | None:
    """Is a revolute joint endless? On the part's right lines."""
    x, y = [], []
    for e in data:
        for h, grade in zip(e.hypotheses, e.grade):
            if h.revolute and grade == 2:
                x.append(np.concatenate([h.features, e.part]))
                y.append(float(not np.isfinite(e.reach).all()))
    if len(y) < 100 or not 0.0 < float(np.mean(y)) < 1.0:
        return None
    return bagged(BINARY, lgb.Dataset(np.array(x), np.array(y)), rounds)


def temperature(cases: Iterable[tuple[FloatArray, FloatArray]]) -> float:
    """Softmax temperature of least log loss over (scores (n,), right (n,) 0/1)."""
    cases = list(cases)

    def loss(log_t: float) -> float:
        t = float(np.exp(log_t))
        return -float(np.mean([np.log(softmax(s, t)[r > 0].sum() + 1e-9) for s, r in cases]))

    return float(np.exp(minimize_scalar(loss, bounds=(-3.0, 3.0), method="bounded").x))


def _binary_temperature(booster: Bag, x: FloatArray, y: FloatArray) -> float:
    """The same for a binary booster's margins."""
    raw = np.asarray(booster.predict(x, raw_score=True, num_threads=1))
    return temperature((np.array([0.0, m]), np.array([1.0 - t, t])) for m, t in zip(raw, y))


def _texts(bag: Bag | None) -> list[str] | None:
    """The boosters of a bag in LightGBM's text format, without what only tells their history."""
    return None if bag is None else [lean(b.model_to_string()) for b in bag.boosters]


def fit(train: Sequence[Example], check: Sequence[Example]) -> dict[str, Any]:
    """Fit everything; `check` (held-back objects) sets the temperatures."""
    line = fit_ranker(train, True, ROUNDS["line"])
    slide = fit_ranker(train, False, ROUNDS["slide"])
    moves, slides = fit_kinds(train)
    out: dict[str, Any] = {
        "line": _texts(line), "slide": _texts(slide), "moves": _texts(moves),
        "slides": _texts(slides),
        "line_names": list(LINE_NAMES), "slide_names": list(SLIDE_NAMES),
        "part_names": list(PART_NAMES),
    }  # fmt: skip
    for name, booster, revolute in (("line", line, True), ("slide", slide, False)):
        cases = [rows_of(e, revolute) for e in check if e.kind == (2 if revolute else 1)]
        out[f"{name}_temperature"] = temperature(
            (np.asarray(booster.predict(x, num_threads=1)), y) for x, y in cases if y.max() > 0
        )
        side = fit_side(train, revolute, 60)
        out[f"{name}_side"] = _texts(side)
        for column, word in enumerate(("open", "back")):
            reach = fit_reach(train, revolute, column, 80)
            out[f"{name}_{word}"] = _texts(reach)
    endless = fit_endless(train, 60)
    out["endless"] = _texts(endless)
    x, kind = kind_rows(check, line, slide), np.array([e.kind for e in check])
    out["moves_temperature"] = _binary_temperature(moves, x, (kind > 0).astype(float))
    out["slides_temperature"] = _binary_temperature(
        slides, x[kind > 0], (kind[kind > 0] == 1).astype(float)
    )
    return out


def report(data: Sequence[Example]) -> dict[str, float]:
    """Figures of the packaged model on examples: shares right, given the part."""
    from mam_pipeline.joints.ranker import rank

    hit: dict[str, list[float]] = {}

    def note(key: str, value: float) -> None:
        hit.setdefault(key, []).append(float(value))

    for e in data:
        ranking = rank(e.part, e.hypotheses, fused=e.fused)
        note("kind incl. fixed", int(np.argmax(ranking.kind)) == e.kind)
        if e.kind == 0:
            continue
        note("type, given it moves", 1 + int(np.argmax(ranking.kind[1:])) == e.kind)
        revolute = e.kind == 2
        _, grade = rows_of(e, revolute)
        opens = e.opens[[h.revolute == revolute for h in e.hypotheses]]
        p = ranking.line if revolute else ranking.slide
        word = e.subtype
        note(f"{word} possible", grade.max(initial=0) > 0)
        best = int(np.argmax(p))
        note(f"{word} right", grade[best] > 0)
        if opens[best] != 0:
            side = (ranking.line_side if revolute else ranking.slide_side)[best]
            note(f"{word} opening side", opens[best] * side > 0)
    return {k: round(float(np.mean(v)), 3) for k, v in sorted(hit.items())} | {"parts": len(data)}


@dataclass(frozen=True)
class JointTraining:
    """What the joint ranker is trained on, and where it goes."""

    objects: int = 9400
    """Objects of the training split, half of them of abstract kinds."""
    household: int = 4500
    """More objects of kinds that stand in homes."""
    fused: int = 700
    """Fused objects."""
    loose: float = 0.5
    """Share of those that are not fused that is modelled loosely."""
    blocks: float = 0.3
    """Share of those that are not fused that is built of blocks."""
    cache: Path = Path("build/joint_examples")
    """Folder that keeps measured examples."""
    out: Path = Path("build/weights/joints")
    """Folder that the weights and their manifest are written to."""


def collect(config: JointTraining, split: str, part: int) -> list[Example]:
    """Examples of a split, of one in `part` of the objects that the config names."""
    out: list[Example] = []
    count = config.objects // part
    wanted = jobs(
        split, count - count // 2, count // 2, config.fused // part, config.household // part
    )
    for n, (kind, seed, fused) in enumerate(wanted):
        try:
            job = kind, seed, fused
            manner = loose(*job, config.loose), blocky(*job, config.blocks)
            out += cached_examples(*job, config.cache, *manner)
        except Exception as error:  # one bad object must not end an hour of work
            print(f"skipped {kind} {seed}: {error!r}", file=sys.stderr)
        if n % 50 == 0:
            print(f"{split}: {n} objects, {len(out)} parts", file=sys.stderr)
    return out


def main(argv: Sequence[str] | None = None) -> None:
    """Command line; see the module's text."""
    config = configured(JointTraining(), argv)
    warnings.filterwarnings("ignore")
    train, check = (collect(config, s, part) for s, part in (("train", 1), ("validation", 10)))
    packed = fit(train, check)
    config.out.mkdir(parents=True, exist_ok=True)
    (config.out / FILE).write_bytes(lzma.compress(json.dumps(packed).encode()))
    manifest.write(
        config.out, "python -m mam_training.joints.train configs/train/joints.yaml", config,
        {"lightgbm": int(str(COMMON["seed"]))},
        {"parts": len(train), "validation parts": len(check),
         "sha256": manifest.data_digest(e.name.encode() + e.part.tobytes() for e in train)},
        [manifest.GENERATED],
    )  # fmt: skip
    with standing_in(config.out.parent):
        print(json.dumps({"train": len(train), "validation": report(check)}, indent=1))


if __name__ == "__main__":
    main()
