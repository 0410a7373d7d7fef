"""Whether something stands open in a photo: fitted on labels, and only on the photos they label."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from mam_pipeline.digests import file_digest
from mam_pipeline.errors import InputError
from mam_training import manifest
from mam_training.photo.fit_opened import OpenedTraining, fit, in_folds, main

DIMENSIONS = 6


@pytest.fixture
def config(tmp_path: Path) -> OpenedTraining:
    """Four pictures of stripes and four of plain boxes; one more, of which nobody is sure."""
    rng = np.random.default_rng(0)
    with (tmp_path / "labels.csv").open("w", newline="") as stream:
        table = csv.writer(stream)
        table.writerow(("id", "sha256", "opened"))
        for k, opened in enumerate(["yes", "no"] * 4 + ["unsure"]):
            picture = rng.integers(120, 140, (200, 150, 3)).astype(np.uint8)
            if opened == "yes":
                picture[::10] = rng.integers(0, 255, (20, 150, 3))
            cv2.imwrite(str(tmp_path / f"{k}.jpg"), picture)
            table.writerow((k, file_digest(tmp_path / f"{k}.jpg"), opened))
    return OpenedTraining(
        photos=tmp_path, labels=tmp_path / "labels.csv", folds=2, out=tmp_path / "out"
    )


def typed(config: OpenedTraining) -> list[str]:
    return [f"--{name}={getattr(config, name)}" for name in ("photos", "labels", "folds", "out")]


def test_it_is_made_by_one_command(config: OpenedTraining) -> None:
    main(typed(config))
    kept = json.loads((config.out / "opened.json").read_text())
    assert len(kept["weights"]) == 1280
    assert (kept["in_folds"]["open"], kept["in_folds"]["closed"]) == (4, 4)
    assert manifest.faults(config.out) == []


def test_another_photo_than_was_labelled_is_refused(config: OpenedTraining) -> None:
    (config.photos / "3.jpg").write_bytes((config.photos / "2.jpg").read_bytes())
    with pytest.raises(InputError, match=r"3\.jpg is not the photo that .*labels\.csv labels"):
        main(typed(config))
    assert not config.out.exists()


def test_what_tells_them_apart_is_found_and_measured_on_what_is_left_out() -> None:
    rng = np.random.default_rng(1)
    opened = np.arange(40) % 2 == 0
    x = rng.normal(size=(40, DIMENSIONS)) + 3.0 * opened[:, None] * np.eye(DIMENSIONS)[0]
    config = replace(OpenedTraining(), strength=1.0, folds=4)
    weights, bias = fit(x, opened, config)
    assert int(np.argmax(np.abs(weights))) == 0
    assert ((x @ weights + bias > 0) == opened).mean() > 0.9
    assert in_folds(x, opened, config)["area_under_curve"] > 0.9
    by_chance = in_folds(rng.normal(size=(40, DIMENSIONS)), opened, config)
    assert by_chance["area_under_curve"] < 0.9
