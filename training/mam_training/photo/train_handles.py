"""Trains the photo stage's handle classifiers on synthetic photos with exact truth.

Writes, into pipeline/mam_pipeline/photo/weights/handles, handle_model.txt (a patch alone: 32
numbers) and handle_context.txt (its place between the nearest lines too: 43 numbers), both LightGBM
as text. The photos are those of `bench-photo` with seeds from 100 on, so that the benchmark's own
seeds (0 on) stay unseen, small and large by turns; each front is also read mirrored, darker or
lighter, smaller and noisier.

    python -m mam_training.photo.train_handles configs/train/photo_handles.yaml
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import lightgbm
import numpy as np
from numpy.typing import NDArray

import mam_pipeline.photo
from mam_pipeline.photo.camera import apply_homography, quad_homography
from mam_pipeline.photo.handles import BASIC, COUNT, handle_candidates
from mam_pipeline.photo.image import make_photo
from mam_pipeline.photo.measure import rectify
from mam_pipeline.photo.score import rect_quad
from mam_pipeline.photo.seams import find_seams
from mam_pipeline.photo.truth import PhotoTruth
from mam_training import manifest
from mam_training.command import configured
from mam_world.photos.synthetic_photo import LEVELS, synthesise

Array = NDArray[np.float64]
WEIGHTS = Path(mam_pipeline.photo.__file__).parent / "weights" / "handles"
COLUMNS = {"handle_model.txt": list(BASIC), "handle_context.txt": list(range(COUNT))}
VARIANTS = 2  # readings of each photo
WIDTHS = (480, 640)  # pixels, by turns
PARAMS = {
    "objective": "binary", "num_leaves": 15, "learning_rate": 0.05, "min_data_in_leaf": 30,
    "feature_fraction": 0.6, "bagging_fraction": 0.7, "bagging_freq": 1, "lambda_l2": 5,
    "verbose": -1, "num_threads": 1, "seed": 0, "deterministic": True, "force_col_wise": True,
}  # fmt: skip


def label(box: Array, handles: list[Array]) -> int:
    """1 a handle, 0 none, -1 a part of one (left out of training)."""
    best = 0
    center, (w, h) = (box[:2] + box[2:]) / 2, box[2:] - box[:2]
    for quad in handles:
        low, high = quad.min(axis=0), quad.max(axis=0)
        grow = np.maximum(3, 0.2 * (high - low))
        if not ((center > low - grow) & (center < high + grow)).all():
            continue
        ratio = max(w, h) / max(float((high - low).max()), 1.0)
        common = np.clip(np.minimum(box[2:], high) - np.maximum(box[:2], low), 0, None)
        overlap = common.prod() / max(w * h + (high - low).prod() - common.prod(), 1.0)
        if 0.5 < ratio < 2.2 and overlap > 0.2:
            return 1
        if 0.33 < ratio < 3:
            best = -1
    return best


def samples(
    image: NDArray[np.uint8], truth: PhotoTruth, seed: int, variant: int
) -> tuple[Array, Array]:
    """Candidate features (n, COUNT) and labels of one photo, its front misplaced a little."""
    photo = make_photo(image)
    rng = np.random.default_rng([seed, variant] if variant else seed)
    quad = truth.front * photo.scale
    quad = quad + rng.normal(0, 0.008 * np.linalg.norm(quad[0] - quad[2]), (4, 2))
    w, _, h = truth.size
    front = rectify(photo, quad, w / h * float(np.exp(rng.normal(0, 0.03))))
    matrix = quad_homography(quad, front.shape[1], front.shape[0])
    handles = [
        apply_homography(matrix, rect_quad(k, truth.front) * photo.scale)
        for p in truth.panels
        for k in p.handles
    ]
    if variant:
        front, handles = varied(front, handles, rng)
    boxes, table = handle_candidates(front, find_seams(front))
    y = np.array([label(b, handles) for b in boxes], dtype=float)
    return table[y >= 0], y[y >= 0]


def varied(
    front: NDArray[np.uint8], handles: list[Array], rng: np.random.Generator
) -> tuple[NDArray[np.uint8], list[Array]]:
    """Another exposure, mirrored half the time, smaller, with noise."""
    gamma = float(np.exp(rng.normal(0, 0.35)))
    image = (255 * (front / 255.0) ** gamma).astype(np.uint8)
    if rng.random() < 0.5:
        image = np.ascontiguousarray(image[:, ::-1])
        handles = [np.stack([image.shape[1] - q[:, 0], q[:, 1]], 1) for q in handles]
    k = float(rng.uniform(0.7, 1.0))
    small = cv2.resize(image, None, fx=k, fy=k, interpolation=cv2.INTER_AREA)
    noisy = small + rng.normal(0, rng.uniform(0, 3), small.shape)
    return np.clip(noisy, 0, 255).astype(np.uint8), [q * k for q in handles]


def collect(first: int, count: int) -> tuple[Array, Array, Array]:
    """Features (n, COUNT), labels and weights of the candidates of `count` photos per level."""
    data = []
    for seed in range(first, first + count):
        for level in LEVELS:
            image, truth = synthesise(seed, level, WIDTHS[seed % len(WIDTHS)])
            data += [samples(image, truth, seed, variant) for variant in range(VARIANTS)]
        print(f"photo {seed}", flush=True)
    data = [d for d in data if len(d[1])]
    x = np.concatenate([a for a, _ in data])
    y = np.concatenate([b for _, b in data])
    # a pattern with hundreds of candidates is still one photo
    weight = np.concatenate([np.full(len(b), len(b) ** -0.5) for _, b in data])
    return x, y, weight


@dataclass(frozen=True)
class HandleTraining:
    """What the handle classifiers are trained on, and where they go."""

    first: int = 100
    """First seed of the synthetic photos."""
    count: int = 60
    """Seeds; each makes one photo of every level of clutter."""
    rounds: int = 200
    """Trees of either model."""
    cache: Path | None = None
    """A file that keeps the samples, which are read again if it is there."""
    out: Path = WEIGHTS
    """Folder that the weights and their manifest are written to."""


def main(argv: Sequence[str] | None = None) -> None:
    """Train and save."""
    config = configured(HandleTraining(), argv)
    if config.cache is not None and config.cache.is_file():
        kept = np.load(config.cache)
        x, y, weight = kept["x"], kept["y"], kept["weight"]
    else:
        x, y, weight = collect(config.first, config.count)
        if config.cache is not None:
            np.savez_compressed(config.cache, x=x, y=y, weight=weight)
    config.out.mkdir(parents=True, exist_ok=True)
    for name, columns in COLUMNS.items():
        table = lightgbm.Dataset(x[:, columns], y, weight=weight / weight.mean())
        booster = lightgbm.train(PARAMS, table, config.rounds)
        booster.save_model(str(config.out / name))
        print(f"{len(y)} candidates, {y.mean():.1%} handles -> {config.out / name}")
    manifest.write(
        config.out,
        "python -m mam_training.photo.train_handles configs/train/photo_handles.yaml",
        config,
        {"lightgbm": int(str(PARAMS["seed"])), "first photo": config.first},
        {"photos": config.count * len(LEVELS), "candidates": len(y),
         "sha256": manifest.data_digest([x.tobytes(), y.tobytes(), weight.tobytes()])},
    )  # fmt: skip


if __name__ == "__main__":
    main()
