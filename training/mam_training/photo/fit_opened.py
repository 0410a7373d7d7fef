"""Fits how likely a drawer or door stands open in a photo, on photos that were labelled by eye.

A logistic regression on what the ImageNet network makes of the whole picture: open fridges,
wardrobes and drawers show what no closed front does. `labels/photos_opened.csv` says of each photo
yes, no or unsure (left out). What is kept beside the weights is measured in folds by photo.

    python -m mam_training.photo.fit_opened configs/train/photo_opened.yaml
"""

from __future__ import annotations

import csv
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.digests import file_digest
from mam_pipeline.errors import InputError
from mam_pipeline.photo.category import described
from mam_pipeline.photo.image import read_photo
from mam_pipeline.photo.opened import NAME, RULES
from mam_training import manifest
from mam_training.command import configured
from mam_training.photo.real_photos import REAL

Array = NDArray[np.float64]


@dataclass(frozen=True)
class OpenedTraining:
    """What it is fitted on, and where it goes."""

    photos: Path = Path("../shared/corpus/photos")
    """Folder of the photos, as ID.jpg."""
    labels: Path = Path("labels/photos_opened.csv")
    """Columns id, sha256 and opened."""
    strength: float = 0.01
    """Inverse strength of the regularisation (C of scikit-learn), on standardised features."""
    folds: int = 10
    """For what is kept as measured."""
    seed: int = 0
    """Of the folds."""
    out: Path = Path("build/weights/photo/opened")
    """Folder that the fit and its manifest are written to."""


def labelled(config: OpenedTraining) -> Iterator[tuple[Path, bool]]:
    """Photos that somebody was sure of, and whether something stands open.

    Raises:
        InputError: a photo is another one than was labelled.
    """
    with config.labels.open(newline="", encoding="utf-8") as stream:
        for row in csv.DictReader(stream):
            path = config.photos / f"{row['id']}.jpg"
            if not path.is_file() or file_digest(path) != row["sha256"]:
                raise InputError(f"{path} is not the photo that {config.labels} labels")
            if row["opened"] != "unsure":
                yield path, row["opened"] == "yes"


def fit(x: Array, y: NDArray[np.bool_], config: OpenedTraining) -> tuple[Array, float]:
    """Weights (k,) and bias on the features x (n, k) as they are."""
    from sklearn.linear_model import LogisticRegression

    mean, spread = x.mean(axis=0), np.maximum(x.std(axis=0), 1e-9)
    found = LogisticRegression(C=config.strength, max_iter=5000).fit((x - mean) / spread, y)
    weights = found.coef_[0] / spread
    return weights, float(found.intercept_[0] - weights @ mean)


def in_folds(x: Array, y: NDArray[np.bool_], config: OpenedTraining) -> dict[str, Any]:
    """What photos that a fit did not see are taken for."""
    from sklearn.metrics import roc_auc_score
    from sklearn.model_selection import StratifiedKFold

    value = np.zeros(len(y))
    folds = StratifiedKFold(config.folds, shuffle=True, random_state=config.seed)
    for seen, left in folds.split(x, y):
        weights, bias = fit(x[seen], y[seen], config)
        value[left] = 1.0 / (1.0 + np.exp(-(x[left] @ weights + bias)))
    called = value > RULES.likely
    return {
        "open": int(y.sum()),
        "of_these_called_open": int((called & y).sum()),
        "closed": int((~y).sum()),
        "of_those_called_open": int((called & ~y).sum()),
        "area_under_curve": round(float(roc_auc_score(y, value)), 3),
    }


def main(argv: Sequence[str] | None = None) -> None:
    """Look, fit, keep."""
    config = configured(OpenedTraining(), argv)
    told = dict(labelled(config))
    rows = []
    for path in told:
        rows.append(described(read_photo(path).small).mean(axis=0))
        if len(rows) % 50 == 0:
            print(f"{len(rows)} of {len(told)} photos are looked at", flush=True)
    x = np.array(rows, float)
    y = np.array(list(told.values()))
    weights, bias = fit(x, y, config)
    kept = {
        "bias": round(bias, 6),
        "weights": [round(float(v), 6) for v in weights],
        "in_folds": in_folds(x, y, config),
    }
    config.out.mkdir(parents=True, exist_ok=True)
    (config.out / NAME).write_text(json.dumps(kept) + "\n", encoding="utf-8")
    said = (f"{path.stem} {opened}".encode() for path, opened in told.items())
    manifest.write(
        config.out,
        "python -m mam_training.photo.fit_opened configs/train/photo_opened.yaml",
        config,
        {"folds": config.seed},
        {"photos": len(y), "sha256": manifest.data_digest(said)},
        [REAL],
    )
    print(kept["in_folds"])


if __name__ == "__main__":
    main()
