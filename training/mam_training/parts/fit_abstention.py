"""Fits the chance that a part is real, below which it is dormant, and the chance that its joint is
right, which is what the engine says of a joint, on labels by eye of real objects.

Runs the engine on every labelled object, names withheld. A row is kept for every part that was
found: its signs (`mam_pipeline.parts.abstain`) and whether it is a labelled part (IoU of 0.5 or
more of the surface), and whether its joint is right. A logistic function of the signs is fitted to
the rows, with every object of equal weight, and one of the chance of part and line to the joints of
the parts above the bar. In the record each chance is that of functions that were fitted without
the object's repository. Where the bar lies is a setting.

Objects that no weights were trained on are for judging the engine: `--seen` leaves them out.

    python -m mam_training.labels dataset build/labels --corpus ../shared/corpus/meshes --seen
    python -m mam_training.parts.fit_abstention configs/train/abstention.yaml
"""

from __future__ import annotations

import csv
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mam_sim_bench.metrics import reliability, rigid_parts, score
from numpy.typing import NDArray
from scipy import optimize
from scipy.special import expit, logit

from mam_pipeline.dormant import awake
from mam_pipeline.errors import InputError
from mam_pipeline.geometry.sampling import face_geometry
from mam_pipeline.make_config import EngineConfig
from mam_pipeline.parts.abstain import SIGNS, Bar
from mam_pipeline.parts.embedded import decide, sampled_views, tree_of
from mam_pipeline.parts.scores import load_scores
from mam_pipeline.rules import ALL_RULES
from mam_pipeline.segment.topology import without_repeats
from mam_pipeline.stages import Stages
from mam_pipeline.types import NEEDS_REVIEW, Articulation, KinematicTree, Mesh, Primitives
from mam_training import manifest
from mam_training.command import configured
from mam_world.ground_truth import GroundTruth, list_objects, read_object

Array = NDArray[np.float64]
# signs whose direction is known beforehand: few objects must not turn it round
KNOWN = {"value": 1, "confidence": 1, "sure": 1, "stays": -1, "free": 1, "alike": 1, "best": 1}
PULL = 1.0  # strength of the pull of weights towards zero, in parts
REAL = 0.5  # IoU with a true part from which a part is real


@dataclass(frozen=True)
class AbstentionTraining:
    """What the chance is fitted on, and where it goes."""

    labels: Path = Path("build/labels")
    """Dataset of the labelled objects, with the repository of each in its MANIFEST.csv."""
    least: float = 0.2
    """Chance that a part must have to move."""
    without: str = ""
    """Repository that is left out, to judge its objects; empty: none."""
    cache: Path = Path("build/abstention.jsonl")
    """Rows that were collected, which are read again."""
    out: Path = Path("build/weights/parts/abstention")
    """Folder that the fit and its manifest are written to."""


def repositories(folder: Path) -> dict[str, str]:
    """The repository of every labelled object, by its id.

    Raises:
        InputError: the folder is no dataset of labels.
    """
    file = folder / "MANIFEST.csv"
    if not file.is_file():
        raise InputError(f"{folder} is no dataset of labels: {file} does not exist")
    with file.open(newline="", encoding="utf-8") as stream:
        return {row["id"]: row["repo"] for row in csv.DictReader(stream)}


def collect(path: Path, folder: Path) -> None:
    """Append a row per object of the dataset that the file does not hold yet."""
    have, of = {r["name"] for r in read(path)}, repositories(folder)
    with path.open("a", encoding="utf-8") as file:
        for name, kind, urdf in list_objects(folder):
            if name not in have:
                row = {"name": name, "repo": of[name], **observed(read_object(urdf, name, kind))}
                file.write(json.dumps(row) + "\n")
                file.flush()


def observed(truth: GroundTruth) -> dict[str, Any]:
    """What the engine finds in one object when it withholds nothing."""
    tree, primitives, articulation = found_in(truth.mesh)
    parts = rows_of(tree, primitives, articulation, truth)
    true = sum(joint.type != "fixed" for joint in truth.joints)
    return {"true": true, "parts": parts}


def found_in(mesh: Mesh) -> tuple[KinematicTree, Primitives, Articulation]:
    """The parts and joints that the engine finds, the unlikely ones too; by one sampling, not
    four, which costs a third of the time and tells the same within noise."""
    config = EngineConfig(rules=ALL_RULES.without("abstain"))
    stages = Stages(config)
    primitives = stages.segment(mesh)
    prior = stages.observe(mesh, primitives)
    once, bare = without_repeats(mesh, primitives)
    views = sampled_views(once, bare, prior, config.seed, config.rules, 1)
    scores = load_scores("fused" if bare.is_fused else "authored")
    masks, choice = decide(views, scores, config.rules)
    tree = tree_of(views[0], masks, choice, once, bare, config.seed, config.rules)
    return tree, primitives, stages.solve(mesh, primitives, tree)


def rows_of(
    tree: KinematicTree, primitives: Primitives, articulation: Articulation, truth: GroundTruth
) -> list[dict[str, Any]]:
    """Signs, confidence and truth of every part that is awake without the bar, and whether its
    joint is right (`mam_sim_bench.metrics.FoundJoint`)."""
    moving = rigid_parts(articulation)[1]
    right = {j.name: f.right for j, f in zip(moving, score(articulation, truth).found)}
    label = rigid_parts(truth.truth_articulation())[0][truth.face_link]
    area = face_geometry(truth.mesh.vertices, truth.mesh.faces)[1]
    out = []
    for node in awake(tree).nodes[1:]:
        mine = np.isin(primitives.labels, node.primitives)
        best = 0.0
        for k in range(1, int(label.max()) + 1):
            both = area[mine & (label == k)].sum()
            best = max(best, float(both / max(area[mine | (label == k)].sum(), 1e-15)))
        out.append({
            "signs": node.evidence["signs"], "confidence": round(node.confidence, 4),
            "iou": round(best, 3), "subtype": node.subtype,
            "right": right.get(f"{node.name}_joint", False),
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


def crossed(rows: Sequence[dict[str, Any]]) -> Array:
    """(n,) chance of every part by a function that was fitted without its repository."""
    x, _, _, owner = table(rows)
    out = np.zeros(len(x))
    of = np.array([rows[i]["repo"] for i in owner])
    for repository in sorted(set(of)):
        bias, weights = fitted([r for r in rows if r["repo"] != repository])
        out[of == repository] = expit(bias + x[of == repository] @ weights)
    return out


def joints_of(rows: Sequence[dict[str, Any]]) -> tuple[Array, Array]:
    """How sure the line of every part is (n,), and whether its joint is right (n,)."""
    parts = [p for r in rows for p in r["parts"]]
    return np.array([p["signs"]["sure"] for p in parts]), np.array(
        [float(p["right"]) for p in parts]
    )


def fitted_line(rows: Sequence[dict[str, Any]], chance: Array, least: float) -> tuple[float, float]:
    """`Bar.line` of the parts that move, each of equal weight.

    Args:
        chance: (n,) of every part, by a function that did not see its repository.
    """
    sure, right = joints_of(rows)
    awake = chance >= least
    z, y = _odds(chance * sure)[awake], right[awake]

    def cost(w: Array) -> float:
        odds = w[0] + w[1] * z
        return float((np.logaddexp(0, odds) - y * odds).sum())

    bias, weight = optimize.minimize(cost, [0.0, 1.0], bounds=[(None, None), (0.0, None)]).x
    return round(float(bias), 4), round(float(weight), 4)


def crossed_line(rows: Sequence[dict[str, Any]], least: float) -> Array:
    """(n,) chance that every joint is right, by functions that did not see its repository."""
    x, _, _, owner = table(rows)
    sure, out = joints_of(rows)[0], np.zeros(len(x))
    of = np.array([rows[i]["repo"] for i in owner])
    for repository in sorted(set(of)):
        others, left = [r for r in rows if r["repo"] != repository], of == repository
        bias, weights = fitted(others)
        start, slope = fitted_line(others, crossed(others), least)
        chance = expit(bias + x[left] @ weights)
        out[left] = expit(start + slope * _odds(chance * sure[left]))
    return out


def _odds(chance: Array) -> Array:
    return np.asarray(logit(np.clip(chance, 0.01, 0.99)))


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
    right = joints_of(rows)[1][kept]
    said = crossed_line(rows, bar.least)[kept]
    of_joints, joint_bins = reliability(said, right)
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
        "joints": len(right),
        "right_joints": int(right.sum()),
        "wrong_joints_without_review": int(((said >= NEEDS_REVIEW) & (right == 0)).sum()),
        "joint_calibration_error": round(of_joints, 3),
        "joint_reliability": joint_bins,
    }


def main(argv: Sequence[str] | None = None) -> None:
    """Collect, fit, keep."""
    config = configured(AbstentionTraining(), argv)
    config.cache.parent.mkdir(parents=True, exist_ok=True)
    collect(config.cache, config.labels)
    wanted = {n: r for n, r in repositories(config.labels).items() if r != config.without}
    seen = sorted(
        (r for r in read(config.cache) if r["name"] in wanted), key=lambda r: str(r["name"])
    )
    rows = [r for r in seen if r["parts"]]
    chance = crossed(rows)
    bias, weights = fitted(rows)
    named = {n: round(float(w), 4) for n, w in zip(SIGNS, weights)}
    bar = Bar(round(bias, 4), named, config.least, fitted_line(rows, chance, config.least))
    kept: dict[str, Any] = {**asdict(bar), "record": record(rows, chance, bar)}
    config.out.mkdir(parents=True, exist_ok=True)
    (config.out / "abstention.json").write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")
    manifest.write(
        config.out,
        "python -m mam_training.parts.fit_abstention configs/train/abstention.yaml",
        config,
        {"samplings": EngineConfig().seed},
        {"objects": len(rows), "repositories": len({r["repo"] for r in rows}),
         "sha256": manifest.data_digest(json.dumps(r, sort_keys=True).encode() for r in rows),
         "ids": [r["name"] for r in seen]},
        ["labels"],
    )  # fmt: skip
    print(json.dumps({**asdict(config), **kept["record"]}, indent=1, default=str))


if __name__ == "__main__":
    main()
