"""Trains the reasoner on procedural objects.

    python -m mam_training.parts.train configs/train/parts.yaml

Recipe: objects of the world's training split in every style, abstract ones, and both as fused
meshes, through the real segmenter and probing; (0) a graph network for each fold, from the other
folds (`parts.train_network`); (1) pair and primitive models, cross-fitted in the same folds by kind
of object, so that what comes after learns how such answers err on kinds they never saw; (2)
candidates from the cross-fitted scores, and a model of their overlap with true parts; (3) the same
again with more candidates beside the best and with what the first answer says of rivals and twins;
(4) the type of parts; (5) the rank of whole sets of candidates beside others of their object, from
the examples of all members. Some examples are seen a second time without a kinematic prior. In use
networks are asked that know all kinds, each from one half of the objects. The confidence is
calibrated on the validation split, which has categories of its own. All of it is done twice: on
authored meshes, and on the fused ones whose cuts part what moves. There the networks go on from the
first, the folds are by object, and their networks are those that are asked in use.
"""

from __future__ import annotations

import gzip
import json
import sys
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import lightgbm
import numpy as np

from mam_pipeline import folders
from mam_pipeline.parts.configurations import enumerate_sets, set_features
from mam_pipeline.parts.embedded import View, decide
from mam_pipeline.parts.features import Table, pair_features, primitive_features
from mam_pipeline.parts.group_features import with_rivals
from mam_pipeline.parts.network import Network
from mam_pipeline.parts.scores import Scores
from mam_pipeline.parts.select import select_groups
from mam_pipeline.types import FloatArray
from mam_training import manifest
from mam_training.command import configured
from mam_training.parts.corpus import FUSED, load_example
from mam_training.parts.recipe import FOLDS, fold_of, gather, jobs
from mam_training.parts.views import (
    COMMON,
    Candidates,
    Rows,
    add_overlaps,
    candidates_of,
    outcome,
    some_rows,
    widen,
)

OVERLAP: dict[str, Any] = {"objective": "cross_entropy"}
TYPES: dict[str, Any] = {"objective": "multiclass", "num_class": 3}
WORTH = np.array([2 / 3, 1 / 3])  # of mIoU and of the right count, in a set's score
LEVELS = 30  # grades of that score, for ranking
RANKS: dict[str, Any] = {
    "objective": "lambdarank", "label_gain": list(range(LEVELS + 1)),
    "lambdarank_truncation_level": 15,
}  # fmt: skip
SETS, ROUNDS = 28, 250  # sets of one example that train the set model, and its trees
# weight of what the parts promise by themselves, beside the rank of a set, which leaves parts out:
# most objects have one. Most of all among fused pieces. And the confidence that a part needs: on
# 220 authored examples of held-back kinds and seeds 0.35 is best, among fused ones none
AUTHORED_SETTINGS = {"promise": 0.5, "least": 0.35}
FUSED_SETTINGS = {"promise": 1.5}
HISTORY = ("split_gain=", "internal_", "leaf_weight=", "leaf_count=", "tree_sizes=")
PARTED = 0.6  # fused examples whose primitives hold the parts worse teach what cannot be seen


def fit_bonds(paths: list[Path]) -> tuple[dict[str, list[lightgbm.Booster]], dict[str, Any]]:
    """Pair and primitive models: per fold (trained on the others) and on everything."""
    same, move = Rows.empty(), Rows.empty()
    for path in paths:
        example = load_example(path)
        graph, link, purity = example.graph, example.link, example.purity
        moving = (example.subtype[link] >= 0).astype(float)
        pair_label = (link[graph.pairs[:, 0]] == link[graph.pairs[:, 1]]).astype(float)
        trust = purity[graph.pairs].min(axis=1)
        blind = zlib.crc32(path.stem.encode()) % 2  # every second is also seen without a prior
        for prior in (example.prior(), None)[: 1 + blind]:
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


def fit_first(seen: list[Candidates]) -> tuple[Any, list[Any]]:
    """The model of a candidate's overlap, on its own: on everything, and per fold."""
    rows, rng = Rows.empty(), np.random.default_rng(0)
    for item in seen:
        add_overlaps(rows, item, item.features, rng)
    return rows.fit(200, **OVERLAP), [rows.fit(200, k, **OVERLAP) for k in range(FOLDS)]


def fit_groups(seen: list[Candidates], first: list[Any]) -> tuple[dict[str, Any], list[Guess]]:
    """Revise and type models on widened candidates, and their cross-fitted answers for each."""
    kind, revise = Rows.empty(), Rows.empty()
    rng = np.random.default_rng(1)
    wide = []
    for item in seen:
        guess = first[item.fold].predict(item.features.values, num_threads=1)
        wide.append(with_rivals(item.features, item.masks, guess))
        add_overlaps(revise, item, wide[-1], rng)
        target = item.overlap.max(axis=1)
        good = np.flatnonzero(target > 0.6)
        if len(good):
            label = item.subtype[item.overlap[good].argmax(axis=1)]
            weight = target[good] * np.sqrt(10 / len(good))
            kind.add(some_rows(item.features, good), label, weight, item.fold)
    second = [revise.fit(150, k, **OVERLAP) for k in range(FOLDS)]
    types = [kind.fit(80, k, **TYPES) for k in range(FOLDS)]
    guesses = [
        Guess(
            np.asarray(second[item.fold].predict(w.values, num_threads=1)),
            np.asarray(types[item.fold].predict(item.features.values, num_threads=1)),
        )
        for item, w in zip(seen, wide)
    ]
    return {"revise": revise.fit(150, **OVERLAP), "subtype": kind.fit(80, **TYPES)}, guesses


@dataclass(frozen=True)
class Guess:
    """What the group models say of the candidates of one example."""

    value: FloatArray
    odds: FloatArray


@dataclass(frozen=True)
class Options:
    """The sets of candidates of one example.

    Attributes:
        fold, truth: of the example. features: (M, .) of the sets. result: (M, 2) their mIoU and
            whether the count is right. plain: what candidates above a threshold would reach.
    """

    fold: int
    truth: int
    features: Table
    result: FloatArray
    plain: tuple[float, float]


def options_of(seen: list[Candidates], guesses: list[Guess]) -> list[Options]:
    """The sets that every example offers; those with nothing to choose from are left out."""
    out = []
    for item, guess in zip(seen, guesses):
        if item.truth == 0 or len(item.masks) == 0:
            continue
        graph = load_example(item.path).graph
        sets = enumerate_sets(item.masks, item.features, guess.value)
        features = set_features(
            graph, item.masks, item.features, guess.value, guess.odds, sets,
            item.reading.same, item.reading.move,
        )  # fmt: skip
        result = np.array([outcome(item, chosen) for chosen in sets.rows()])
        plain = outcome(item, select_groups(item.masks, guess.value, 0.6))
        out.append(Options(item.fold, item.truth, features, result, plain))
    return out


def _sets(tried: list[Options], seed: int) -> Rows:
    """Training rows of the set model: a draw of every example's sets, graded by their score."""
    rows, rng = Rows.empty(), np.random.default_rng(seed)
    for item in tried:
        score = item.result @ WORTH
        keep = rng.permutation(len(score))[:SETS]
        keep = np.unique(np.append(keep, score.argmax()))
        grade = np.round(score[keep] * LEVELS)
        weight = np.full(len(keep), np.sqrt(item.truth))  # with more parts, more can go wrong
        rows.add(some_rows(item.features, keep), grade, weight, item.fold)
    return rows


def fit_choice(tried: list[Options], number: int) -> list[lightgbm.Booster]:
    """Models that rank the sets of one object by their score, each from a draw of its own.

    Only the order within an object counts; a model of the score itself must also learn which
    objects are hard. How well the first draw's models choose in the fold that they never saw is
    printed.
    """
    draws = [_sets(tried, seed) for seed in range(number)]
    held = [draws[0].fit(ROUNDS, k, **RANKS) for k in range(FOLDS)]
    report = []
    for item in tried:
        best = int(np.argmax(held[item.fold].predict(item.features.values, num_threads=1)))
        oracle = int(np.argmax(item.result @ WORTH))
        report.append([*item.result[best], *item.plain, *item.result[oracle]])
    names = "chosen, by threshold, best of the sets"
    print(f"cross-fitted (mIoU, count): {names}: {np.mean(report, axis=0).round(3)}",
          file=sys.stderr, flush=True)  # fmt: skip
    return [rows.fit(ROUNDS, **RANKS) for rows in draws]


def calibrate(answers: list[tuple[Candidates, FloatArray, list[int]]]) -> list[tuple[float, float]]:
    """Isotonic curve from a chosen candidate's value to the odds of an overlap above one half."""
    from sklearn.isotonic import IsotonicRegression

    x, y = [], []
    for item, value, chosen in answers:
        x += [value[c] for c in chosen]
        y += [float(item.overlap[c].max() > 0.5) for c in chosen]
    curve = IsotonicRegression(out_of_bounds="clip", y_min=0.02, y_max=0.98).fit(x, y)
    grid = np.linspace(0, 1, 21)
    return [(float(a), float(b)) for a, b in zip(grid, curve.predict(grid))]


def validate(
    paths: list[Path],
    members: list[dict[str, Any]],
    networks: Sequence[Network],
    with_prior: bool,
    chosen: Mapping[str, float],
) -> list[tuple[Candidates, FloatArray, list[int]]]:
    """What the finished models choose on examples that they have not seen."""
    settings = {"calibration": [(0, 0), (1, 1)], "promise": chosen["promise"]}
    scores = Scores(members, settings, networks)
    out = []
    for path in paths:
        example = load_example(path)
        item = candidates_of(path, members[-1]["same"], members[-1]["move"], (), with_prior)
        view = View(example.graph, example.prior() if with_prior else None)
        item.masks, choice = decide([view], scores)
        item.overlap = example.part_overlap(item.masks)
        out.append((item, choice.value, list(choice.chosen)))
    return out


def fit_member(
    train: list[Path], networks: Sequence[Network]
) -> tuple[dict[str, Any], list[Options]]:
    """The models of one member, trained on examples, and the sets they leave to choose from.

    Args:
        networks: one for each fold, trained on the other folds.
    """
    folds, models = fit_bonds(train)
    print("pair and primitive models are trained", file=sys.stderr, flush=True)
    seen = []
    for n, path in enumerate(train):
        k = fold_of(path.stem)
        for with_prior in (True, False) if n % 4 == 0 else (True,):
            models_of_fold = folds["same"][k], folds["move"][k], networks[k : k + 1]
            seen.append(candidates_of(path, *models_of_fold, with_prior))
    print(f"{len(seen)} examples are seen", file=sys.stderr, flush=True)
    models["value"], first = fit_first(seen)
    for item in seen:
        widen(item, first[item.fold])
    print("candidates are widened", file=sys.stderr, flush=True)
    final, guesses = fit_groups(seen, first)
    return models | final, options_of(seen, guesses)


def lean(text: str) -> str:
    """LightGBM's text format without the lines that only say how trees came about.

    Predictions stay the same; sizes of trees would no longer be true, and may be left out too.
    """
    return "\n".join(line for line in text.split("\n") if not line.startswith(HISTORY))


def finish(
    members: list[dict[str, Any]], networks: list[dict[str, Any]], held: list[Path],
    sizes: list[int], out: Path, chosen: Mapping[str, float],
) -> None:  # fmt: skip
    """Score the members together on held-back examples, calibrate, write the weights."""
    settings: dict[str, Any] = {
        "objects": sizes, "members": [str(k) for k in range(len(members))],
        "networks": [f"network_{k}" for k in range(len(networks))], **chosen,
    }  # fmt: skip
    for with_prior in (False, True):
        answers = validate(held, members, [Network(w) for w in networks], with_prior, chosen)
        result = np.array([outcome(item, chosen) for item, _, chosen in answers])
        fused = np.array([item.path.stem.endswith(FUSED) for item, _, _ in answers])
        settings |= {"calibration": calibrate(answers)}
        tag = f"validation_{'with' if with_prior else 'without'}_prior"
        for name, rows in (("", ~fused), ("_fused", fused)):
            settings[tag + name] = result[rows].mean(axis=0).round(4).tolist() if rows.any() else []
    with folders.new_folder(out) as work:
        write_models(work, settings, members, networks)
    print(json.dumps({k: v for k, v in settings.items() if k != "calibration"}))


def write_models(
    out: Path, settings: dict[str, Any], members: list[dict[str, Any]],
    networks: list[dict[str, Any]],
) -> None:  # fmt: skip
    """Write settings, networks and members as `mam_pipeline.parts.scores` reads them."""
    for name, weights in zip(settings["networks"], networks):
        np.savez_compressed(out / f"{name}.npz", **weights)
    for member, models in zip(settings["members"], members):
        for name in models:
            text = lean(models[name].model_to_string()).encode("utf-8")
            with gzip.GzipFile(out / f"{member}_{name}.txt.gz", "wb", mtime=0) as stream:
                stream.write(text)
    (out / "settings.json").write_text(json.dumps(settings, indent=1), encoding="utf-8")


@dataclass(frozen=True)
class PartsTraining:
    """What the part models are trained on, and where they go."""

    count: int = 9800
    """Objects of the world."""
    household: int = 5000
    """More objects of kinds that stand in homes."""
    abstract: int = 17400
    """Abstract objects."""
    fused: int = 5400
    """Fused objects of either sort."""
    validation: int = 100
    """Held-back objects of each sort."""
    loose: float = 0.5
    """Share of those that are not fused that is modelled loosely."""
    blocks: float = 0.4
    """Share of those that are not fused that is built of blocks."""
    members: int = 4
    """Sets of models whose mean is taken, on authored meshes; on fused ones two at most."""
    device: str = "cpu"
    """Where the networks are trained: cpu or cuda."""
    cache: Path = Path("build/part_examples")
    """Folder that keeps measured examples."""
    out: Path = Path("build/weights/parts")
    """Folder that gets the weights and a manifest, in authored/ and fused/."""


def main(argv: Sequence[str] | None = None) -> None:
    """Make the corpus, train the networks and the members on draws of it, write the weights."""
    from mam_training.parts import train_network as lessons

    config = configured(PartsTraining(), argv)
    wanted = jobs("train", config.count, config.abstract, config.fused, config.household)
    train = gather(wanted, config.cache, config.loose, config.blocks)
    few = config.validation
    held = gather(jobs("validation", few, few, few), config.cache)
    (plain, fused), (held, held_fused) = apart(train), apart(held)
    learn = partial(lessons.train, device=config.device)
    guides = [learn(plain, lessons.WARY, fold=k) for k in range(FOLDS)]
    asked = [learn(half, lessons.LONG, seed=k) for k, half in enumerate(_halves(plain))]
    authored = config.out / "authored"
    fit_members(plain, held, guides, asked, config.members, authored, AUTHORED_SETTINGS)
    _told(authored, config, plain)
    fused = [p for p in fused if load_example(p).bound >= PARTED]
    tuned = [
        learn(fused, lessons.TUNING, k, k, asked[k % len(asked)], guides) for k in range(FOLDS)
    ]
    few = min(2, config.members)  # there are too few fused ones for more draws that differ
    fit_members(fused, held_fused, tuned, tuned, few, config.out / "fused", FUSED_SETTINGS)
    _told(config.out / "fused", config, fused)


def _told(folder: Path, config: PartsTraining, examples: list[Path]) -> None:
    """Write the manifest of one folder of weights."""
    manifest.write(
        folder, "python -m mam_training.parts.train configs/train/parts.yaml", config,
        {"draws": 0, "networks": len(_halves([])), "lightgbm": int(COMMON["seed"])},
        {"examples": len(examples),
         "sha256": manifest.data_digest(p.name.encode() + p.read_bytes() for p in examples)},
        [manifest.GENERATED],
    )  # fmt: skip


def _halves(paths: list[Path]) -> list[list[Path]]:
    """The examples in two, so that what is trained on either errs in its own way."""
    return [[p for p in paths if zlib.crc32(p.stem.encode()) % 2 != k] for k in range(2)]


def apart(paths: list[Path]) -> tuple[list[Path], list[Path]]:
    """Examples of authored meshes, and of fused ones.

    An authored mesh that is one surface, or a fused one that is several, meets the other weights in
    use, and has other features: it is left out.
    """
    plain: list[Path] = []
    fused: list[Path] = []
    for path in paths:
        cut, made = load_example(path).graph.is_fused, path.stem.endswith(FUSED)
        if cut == made:
            (fused if cut else plain).append(path)
    return plain, fused


def fit_members(
    train: list[Path], held: list[Path], guides: list[dict[str, Any]],
    asked: list[dict[str, Any]], number: int, out: Path, chosen: Mapping[str, float],
) -> None:  # fmt: skip
    """Train members on draws of the examples, score them together and write the weights.

    Args:
        guides: one network for each fold, whose views the members learn to read.
        asked: the networks that are asked in use.
    """
    members, sizes, tried = [], [], []
    for member in range(number):
        draw = draw_of(train, member, number)
        models, options = fit_member(draw, [Network(weights) for weights in guides])
        members.append(models)
        sizes.append(len(draw))
        tried += options
    # from the examples of all members: half of them are too few
    for models, choose in zip(members, fit_choice(tried, number)):
        models["choose"] = choose
    finish(members, asked, held, sizes, out, chosen)


def draw_of(train: list[Path], member: int, number: int) -> list[Path]:
    """The examples of one of several members, who share them out."""
    order = np.random.default_rng(0).permutation(len(train))
    return [train[k] for k in np.array_split(order, number)[member]]


if __name__ == "__main__":
    main()
