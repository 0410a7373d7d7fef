"""Fits the chance that a part is real, and the bar below which it is withheld.

Runs the engine on generated objects, with joints and without any, whose seeds the network of
mobility was not trained on, and on objects of other sources, each with a network that was trained
without that source. A row is kept for every part that was found: its signs
(`mam_pipeline.parts.abstain`) and whether it is a true part (IoU of 0.5 or more of the surface). A
logistic function is fitted to the rows, with every object of equal weight; in the record each
chance is that of a function that was fitted without the kind of object, or without its source.
Where the bar lies is a setting.

    python -m mam_training.parts.fit_abstention configs/train/abstention.yaml
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import count as count_from
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import optimize
from scipy.special import expit

from mam_pipeline.geometry.sampling import face_geometry
from mam_pipeline.ground_truth import GroundTruth, list_objects, read_object
from mam_pipeline.make_config import EngineConfig
from mam_pipeline.metrics import reliability, rigid_parts
from mam_pipeline.parts.abstain import SIGNS, Bar
from mam_pipeline.parts.embedded import decide, sampled_views, tree_of
from mam_pipeline.parts.mobility_network import MobilityNetwork, load_mobility, read_mobility
from mam_pipeline.parts.scores import load_scores
from mam_pipeline.rules import ALL_RULES
from mam_pipeline.segment.topology import without_repeats
from mam_pipeline.stages import Stages
from mam_pipeline.types import KinematicTree, Mesh, Primitives
from mam_training import manifest
from mam_training.command import configured
from mam_training.sources import GENERATED, OTHERS
from mam_world.object import generator
from mam_world.registry import CATEGORIES, motionless
from mam_world.splits import MOTIONLESS_TEST_ONLY, TEST_ONLY, VALIDATION_ONLY
from mam_world.style import draw_style
from mam_world.truth import generated_truth

Array = NDArray[np.float64]
# signs whose direction is known beforehand: few objects must not turn it round
KNOWN = {"value": 1, "confidence": 1, "sure": 1, "stays": -1, "free": 1, "alike": 1, "best": 1,
         "moving": 1}  # fmt: skip
PULL = 1.0  # strength of the pull of weights towards zero, in parts
REAL = 0.5  # IoU with a true part from which a part is real


@dataclass(frozen=True)
class AbstentionTraining:
    """What the chance is fitted on, and where it goes."""

    motionless: int = 8
    """Objects of every kind in which nothing moves."""
    movable: int = 1
    """Objects of every kind with joints."""
    start: int = 300
    """First seed that is looked at; of ten in a row the one for validation is."""
    others: tuple[Path, ...] = OTHERS
    """Folders of URDF objects of other sources."""
    most_of_each: int = 60
    """Objects of each of them, the first of a mixed order."""
    networks: Path = Path("build/network")
    """Folder of the networks that were trained without them: `without_NAME.npz`."""
    least: float = 0.4
    """Chance that the likeliest part of an object must have."""
    fused_least: float = 0.2
    """The same of a fused mesh. Chances are fitted on authored ones; true parts of fused ones get
    lower ones."""
    others_least: float = 0.02
    """Chance that further parts of an object need once one part has reached the bar."""
    cache: Path = Path("build/abstention.jsonl")
    """Rows that were collected, which are read again."""
    most: int | None = 300
    """Generated objects in all, the first of a mixed order; None: all."""
    out: Path = Path("build/weights/parts/abstention")
    """Folder that the fit and its manifest are written to."""


def collect(path: Path, pairs: Sequence[tuple[str, int]]) -> None:
    """Append a row per generated object that the file does not hold yet."""
    have = {(r["category"], r.get("seed")) for r in read(path)}
    with path.open("a", encoding="utf-8") as file:
        for name, seed in pairs:
            if (name, seed) not in have:
                row = {"category": name, "seed": seed, **observed(generated_truth(name, seed))}
                file.write(json.dumps(row) + "\n")
                file.flush()


def collect_source(path: Path, folder: Path, most: int, network: MobilityNetwork) -> list[str]:
    """The same of objects of a folder of URDFs; all of a folder count as one kind.

    Returns:
        Their names.
    """
    found = list_objects(folder)
    order = np.random.default_rng(0).permutation(len(found))[:most]
    have = {r["name"] for r in read(path) if r["category"] == folder.name}
    with path.open("a", encoding="utf-8") as file:
        for k in order:
            name, kind, urdf = found[k]
            if name not in have:
                seen = observed(read_object(urdf, name, kind), network)
                file.write(json.dumps({"category": folder.name, "name": name, **seen}) + "\n")
                file.flush()
    return [found[k][0] for k in order]


def observed(truth: GroundTruth, network: MobilityNetwork | None = None) -> dict[str, Any]:
    """What the engine finds in one object when it withholds nothing."""
    tree, primitives = found_in(truth.mesh, network)
    parts = rows_of(tree, primitives, truth)
    true = sum(joint.type != "fixed" for joint in truth.joints)
    return {"true": true, "parts": parts}


def found_in(
    mesh: Mesh, network: MobilityNetwork | None = None
) -> tuple[KinematicTree, Primitives]:
    """The parts that the engine finds, the unlikely ones too; by one sampling, not four, which
    costs a third of the time and tells the same within noise."""
    config = EngineConfig(rules=ALL_RULES.without("abstain"))
    stages = Stages(config)
    primitives = stages.segment(mesh)
    prior = stages.observe(mesh, primitives)
    once, bare = without_repeats(mesh, primitives)
    views = sampled_views(once, bare, prior, config.seed, config.rules, 1)
    scores = load_scores("fused" if bare.is_fused else "authored")
    masks, choice = decide(views, scores, config.rules)
    asked = network or load_mobility()
    tree = tree_of(views[0], masks, choice, once, bare, config.seed, config.rules, mobility=asked)
    return tree, primitives


def rows_of(
    tree: KinematicTree, primitives: Primitives, truth: GroundTruth
) -> list[dict[str, Any]]:
    """Signs, confidence and truth of every part that was found."""
    label = rigid_parts(truth.truth_articulation())[0][truth.face_link]
    area = face_geometry(truth.mesh.vertices, truth.mesh.faces)[1]
    out = []
    for node in tree.nodes[1:]:
        mine = np.isin(primitives.labels, node.primitives)
        best = 0.0
        for k in range(1, int(label.max()) + 1):
            both = area[mine & (label == k)].sum()
            best = max(best, float(both / max(area[mine | (label == k)].sum(), 1e-15)))
        out.append({
            "signs": node.evidence["signs"], "confidence": round(node.confidence, 4),
            "iou": round(best, 3), "subtype": node.subtype,
        })  # fmt: skip
    return out


def read(path: Path) -> list[dict[str, Any]]:
    """Rows of a file, none if it does not exist."""
    if not path.is_file():
        return []
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines() if line]


def fitted(rows: Sequence[dict[str, Any]]) -> tuple[float, Array]:
    """Bias and weights of a logistic function with bounded signs, each object of equal weight."""
    x, y, weight, _ = table(rows)

    def cost(w: Array) -> float:
        z = w[0] + x @ w[1:]
        return float(weight @ (np.logaddexp(0, z) - y * z) + 0.5 * PULL * (w[1:] ** 2).sum())

    bounds: list[tuple[float | None, float | None]] = [(None, None)]
    bounds += [{1: (0.0, None), -1: (None, 0.0)}.get(KNOWN.get(n, 0), (None, None)) for n in SIGNS]
    w = np.asarray(optimize.minimize(cost, np.zeros(x.shape[1] + 1), bounds=bounds).x)
    return float(w[0]), w[1:]


def table(rows: Sequence[dict[str, Any]]) -> tuple[Array, Array, Array, NDArray[np.int64]]:
    """Signs (n, k), whether real (n,), weights (n,) and the object (n,) of all parts."""
    parts = [(i, p) for i, r in enumerate(rows) for p in r["parts"]]
    x = np.array([[p["signs"][n] for n in SIGNS] for _, p in parts]).reshape(-1, len(SIGNS))
    y = np.array([float(p["iou"] >= REAL) for _, p in parts])
    weight = np.array([1.0 / len(rows[i]["parts"]) for i, _ in parts])
    return x, y, weight, np.array([i for i, _ in parts], dtype=np.int64)


def crossed(rows: Sequence[dict[str, Any]], folds: int = 5) -> Array:
    """(n,) chance of every part by a function that was fitted without its kind or source."""
    kinds = sorted({r["category"] for r in rows if "seed" in r})
    fold = {kind: i % folds for i, kind in enumerate(kinds)}
    sources = sorted({r["category"] for r in rows if "seed" not in r})
    fold |= {source: folds + i for i, source in enumerate(sources)}
    folds += len(sources)
    x, _, _, owner = table(rows)
    out = np.zeros(len(x))
    of = np.array([fold[rows[i]["category"]] for i in owner])
    for k in range(folds):
        bias, weights = fitted([r for r in rows if fold[r["category"]] != k])
        out[of == k] = expit(bias + x[of == k] @ weights)
    return out


def record(rows: Sequence[dict[str, Any]], chance: Array, bar: Bar) -> dict[str, Any]:
    """What the bar does to these objects."""
    _, real, _, owner = table(rows)
    still = {i for i, r in enumerate(rows) if not r["true"]}
    kept = np.concatenate([
        np.array(bar.keeps(list(chance[owner == i])), dtype=bool) for i in range(len(rows))
    ])  # fmt: skip
    of_still = np.isin(owner, sorted(still))
    true = real.astype(bool)
    error, bins = reliability(chance, real)
    return {
        "motionless_objects": len(still),
        "with_a_part_before": len({int(i) for i in owner[of_still]}),
        "with_a_part_after": len({int(i) for i in owner[of_still & kept]}),
        "real_parts_found": int(true.sum()),
        "real_parts_kept": int((true & kept).sum()),
        "false_parts_of_movable_objects": int((~true & ~of_still).sum()),
        "of_them_kept": int((~true & ~of_still & kept).sum()),
        "expected_calibration_error": round(error, 3),
        "reliability": bins,
    }


def planned(config: AbstentionTraining) -> list[tuple[str, int]]:
    """Objects of both sorts, mixed, so that a run that is cut short has some of each."""
    held = TEST_ONLY | VALIDATION_ONLY | MOTIONLESS_TEST_ONLY
    pairs = [
        (name, seed)
        for names, count in ((motionless(), config.motionless), (CATEGORIES, config.movable))
        for name in names if name not in held
        for seed in handed_over(name, config.start, count, (8,))
    ]  # fmt: skip
    order = np.random.default_rng(config.start).permutation(len(pairs))
    return [pairs[i] for i in order]


def handed_over(name: str, start: int, count: int, digits: Sequence[int]) -> list[int]:
    """The first seeds from `start` whose file has separate pieces in no dense tessellation: what
    is one surface is judged by other scores, and is never withheld.

    Args:
        digits: last digits of the seeds that are looked at.
    """
    out: list[int] = []
    for seed in count_from(start):
        if len(out) == count:
            return out
        style = draw_style(generator(name, seed, stream=1))
        if seed % 10 in digits and not style.fused and style.tessellation != "dense":
            out.append(seed)
    raise AssertionError("unreachable")


def main(argv: Sequence[str] | None = None) -> None:
    """Collect, fit, keep."""
    config = configured(AbstentionTraining(), argv)
    config.cache.parent.mkdir(parents=True, exist_ok=True)
    pairs = planned(config)[: config.most]
    collect(config.cache, pairs)
    wanted: set[tuple[str, int | str]] = set(pairs)
    for folder in config.others:
        network = read_mobility(config.networks / f"without_{folder.name}.npz")
        names = collect_source(config.cache, folder, config.most_of_each, network)
        wanted |= {(folder.name, name) for name in names}
    rows = [
        row for row in read(config.cache)
        if (row["category"], row.get("seed", row.get("name"))) in wanted and row["parts"]
    ]  # fmt: skip
    chance = crossed(rows)
    bias, weights = fitted(rows)
    named = {n: round(float(w), 4) for n, w in zip(SIGNS, weights)}
    bar = Bar(round(bias, 4), named, config.least, config.fused_least, config.others_least)
    kept: dict[str, Any] = {**asdict(bar), "record": record(rows, chance, bar)}
    config.out.mkdir(parents=True, exist_ok=True)
    (config.out / "abstention.json").write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    manifest.write(
        config.out,
        "python -m mam_training.parts.fit_abstention configs/train/abstention.yaml",
        config,
        {"first seed": config.start},
        {"objects": len(rows), "of other sources": sum("seed" not in r for r in rows),
         "kinds without joints": len(motionless()),
         "sha256": manifest.data_digest(json.dumps(r, sort_keys=True).encode() for r in rows)},
        [GENERATED, *(folder.name for folder in config.others)],
    )  # fmt: skip
    print(json.dumps({**asdict(config), **kept["record"]}, indent=1, default=str))


if __name__ == "__main__":
    main()
