"""Sets the limits of the photo stage's confidence on photos whose truth is known.

The box: on the photos that its network is trained on, each read by a network that was trained
without its fold (`train_box --fold`), which happens here where it has not been. Panels and handles:
on real photos that no network has seen, every closed one as it is and in five changed ways
(`marked_photos`), an open one once.

Collects (evidence, right or wrong) into a JSON-lines file, resuming it. The limits of "high" and
"medium" are the least evidence above which the shares of `GOAL` are right. Right means: cuboid, the
front's IoU with the truth is 0.75 or more; panels, as many as in truth and all matched at IoU 0.5;
handles, the kinds, hinges and handles of all panels are right too.

    python -m mam_training.photo.fit_confidence configs/train/photo_confidence.yaml
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from mam_sim_bench.photo_outcome import compared, load_truth
from numpy.typing import NDArray

from mam_pipeline.photo.box_network import WEIGHTS, look_at_photo
from mam_pipeline.photo.confidence import TOPICS, evidence, fit_evidence
from mam_pipeline.photo.cuboid import fit_cuboid
from mam_pipeline.photo.find import doubt_of, evidence_of, find_object
from mam_pipeline.photo.image import make_photo, read_photo
from mam_pipeline.photo.options import PhotoOptions
from mam_pipeline.photo.score import polygon_iou
from mam_pipeline.photo.verdict import read_again, seen_as
from mam_training import manifest
from mam_training.command import configured
from mam_training.photo.marked_photos import views
from mam_training.photo.network_model import save
from mam_training.photo.real_photos import REAL, marked_in
from mam_training.photo.train_box import BoxTraining, train

Array = NDArray[np.float64]
FRONT = "front of a fold"
"""View of a photo that is read by the box network that did not see it."""
SAME = 0.75  # IoU with the true front from which a box is right
GOAL = {"cuboid": (0.97, 0.9), "panels": (1.0, 0.99), "handles": (0.97, 0.9)}
"""Share of what is called high, and at least medium, that is right. Nothing is made of panels that
are not at least medium: theirs, whose evidence has the box's in it, is the share that decides how
much is silently wrong, and photos of other people are harder than these."""


def collect(config: ConfidenceTraining) -> None:
    """Append a row per view of a photo, and per real front of a fold, that the cache has not."""
    cv2.setNumThreads(1)
    have = {(r["photo"], r["view"]) for r in read(config.cache)}
    with config.cache.open("a", encoding="utf-8") as file:
        for mark, picture in marked_in(config.labels, config.corpus):
            if not mark.whole or (mark.id, FRONT) in have:
                continue
            photo = make_photo(picture)
            maps = look_at_photo(photo.small, box_without(mark.fold, config))
            box = fit_cuboid(evidence_of(photo, maps, (0, 0, *photo.size)))
            quad = box.quad("front")
            front = np.array(mark.front) * photo.size
            row = {
                "photo": mark.id, "view": FRONT,
                "x": {"cuboid": fit_evidence(doubt_of(maps, quad), box.cost)},
                "right": {"cuboid": polygon_iou(quad, front) >= SAME},
            }  # fmt: skip
            file.write(json.dumps(row) + "\n")
            file.flush()
        sets = ((config.photos, config.truth), (config.hard_photos, config.hard_truth))
        for marked in chain(*(views(folder, truth) for folder, truth in sets)):
            if (marked.photo, marked.view) in have:
                continue
            photo, options = make_photo(marked.image), PhotoOptions()
            found = find_object(photo, options, seen_as(photo, options))
            made = compared(found, marked.panels, photo.scale)
            right = {
                "cuboid": polygon_iou(found.quad / photo.scale, marked.front) >= SAME,
                "panels": made != "wrong",
                "handles": made == "right",
            }
            x = evidence(found, read_again(found, options))
            row = {"photo": marked.photo, "view": marked.view, "x": x, "right": right}
            file.write(json.dumps(row) + "\n")
            file.flush()
        for folder, truth in sets:  # of an open object nothing that is read is right
            for name in (n for n, t in load_truth(truth).items() if t.get("scope") == "open"):
                if (name, "open") in have:
                    continue
                photo, options = read_photo(folder / name), PhotoOptions()
                found = find_object(photo, options, seen_as(photo, options))
                x = evidence(found, read_again(found, options))
                right = dict.fromkeys(TOPICS, False)
                row = {"photo": name, "view": "open", "x": x, "right": right}
                file.write(json.dumps(row) + "\n")


def box_without(fold: int, config: ConfidenceTraining) -> Path:
    """Weights of a box network that has not seen a fold's photos; trained where there are none."""
    folder = config.folds / str(fold)
    weights = folder / WEIGHTS.name
    if not weights.is_file():
        recipe = BoxTraining(photos=config.corpus, labels=config.labels, fold=fold, out=folder)
        save(train(recipe), weights)
    return weights


def read(path: Path) -> list[dict[str, Any]]:
    """Rows of a file, none if it does not exist."""
    if not path.is_file():
        return []
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines() if line]


def limit(evidence: Array, right: Array, goal: float) -> float:
    """The least evidence above which the share of right ones reaches a goal; 1 where none does."""
    for t in np.unique(evidence[evidence > 0]):
        if right[evidence >= t].mean() >= goal:
            return float(t)
    return 1.0


def fit(rows: list[dict[str, Any]]) -> dict[str, Any]:
    """Limits and their record, by topic."""
    out: dict[str, Any] = {}
    for topic in TOPICS:
        some = [r for r in rows if (r["view"] == FRONT) == (topic == "cuboid")]
        x = np.array([r["x"][topic] for r in some])
        y = np.array([float(r["right"][topic]) for r in some])
        limits = {
            word: round(limit(x, y, goal) - 5e-4, 3)
            for word, goal in zip(("high", "medium"), GOAL[topic])
        }
        above = {"high": x >= limits["high"], "medium": x >= limits["medium"]}
        above["low"] = ~above["medium"]
        called = {
            word: {"called": int(k.sum()), "right": int(y[k].sum())} for word, k in above.items()
        }
        out[topic] = {**limits, "record": {"views": len(some), "right": int(y.sum()), **called}}
    return out


@dataclass(frozen=True)
class ConfidenceTraining:
    """What the confidence is fitted on, and where it goes."""

    photos: Path = Path("../shared/bench/photos")
    """Folder of the photos."""
    truth: Path = Path("benchmarks/photo_truth.yaml")
    """What they show."""
    hard_photos: Path = Path("../shared/bench/photos2")
    """Folder of photos that were read wrong."""
    hard_truth: Path = Path("benchmarks/photo_truth_hard.yaml")
    """What they show."""
    corpus: Path = Path("../shared/corpus/photos")
    """Folder of the photos whose fronts were marked for training, as ID.jpg."""
    labels: Path = Path("labels/photos.jsonl")
    """What was marked on them (`real_photos`)."""
    folds: Path = Path("build/weights/photo/box_folds")
    """Folder of the box networks that did not see a fold of these, as FOLD/network.npz; those that
    are not there are trained, in 20 to 45 minutes each on one core."""
    cache: Path = Path("build/photo_confidence.jsonl")
    """Rows that were collected, which are read again."""
    out: Path = Path("build/weights/photo/confidence")
    """Folder that the fit and its manifest are written to."""


def main(argv: Sequence[str] | None = None) -> None:
    """Collect, fit, keep."""
    config = configured(ConfidenceTraining(), argv)
    config.cache.parent.mkdir(parents=True, exist_ok=True)
    collect(config)
    rows = read(config.cache)
    kept: dict[str, Any] = {"views": len(rows), "goal": GOAL, "topics": fit(rows)}
    config.out.mkdir(parents=True, exist_ok=True)
    text = json.dumps(kept, indent=1) + "\n"
    (config.out / "confidence.json").write_text(text, encoding="utf-8")
    manifest.write(
        config.out,
        "python -m mam_training.photo.fit_confidence configs/train/photo_confidence.yaml",
        config,
        {"views": 7},
        {"views": len(rows),
         "sha256": manifest.data_digest(json.dumps(r, sort_keys=True).encode() for r in rows)},
        [REAL, config.photos.name, config.hard_photos.name],
    )  # fmt: skip
    for topic, made in kept["topics"].items():
        print(topic, "high from", made["high"], "medium from", made["medium"], made["record"])


if __name__ == "__main__":
    main()
