"""Trains the photo stage's handle classifier on synthetic photos with exact truth.

Writes pipeline/mam_pipeline/photo/handle_model.txt (LightGBM, text). The photos are those of
`bench-photo` with seeds from 100 on, so that the benchmark's own seeds (0 on) stay unseen.

Usage: python benchmarks/photo_handles.py [--first 100] [--count 60] [--out FILE]
"""

from __future__ import annotations

import argparse
from pathlib import Path

import lightgbm
import numpy as np
from numpy.typing import NDArray

from mam_pipeline.photo.camera import apply_homography, quad_homography
from mam_pipeline.photo.handles import Blob, find_blobs
from mam_pipeline.photo.image import make_photo
from mam_pipeline.photo.measure import rectify
from mam_pipeline.photo.score import rect_quad
from mam_pipeline.photo.seams import find_seams
from mam_pipeline.photo.synthetic import LEVELS, synthesise

Array = NDArray[np.float64]
MODEL = Path(__file__).parent.parent / "pipeline/mam_pipeline/photo/handle_model.txt"
PARAMS = {
    "objective": "binary", "num_leaves": 15, "learning_rate": 0.05, "min_data_in_leaf": 40,
    "feature_fraction": 0.6, "bagging_fraction": 0.7, "bagging_freq": 1, "lambda_l2": 5,
    "verbose": -1, "num_threads": 1, "seed": 0,
}  # fmt: skip


def label(blob: Blob, handles: list[Array]) -> int:
    """1 a handle, 0 none, -1 a part of one (left out of training)."""
    best = 0
    (cx, cy), (w, h) = blob.center, blob.size
    for quad in handles:
        low, high = quad.min(axis=0), quad.max(axis=0)
        grow = np.maximum(3, 0.2 * (high - low))
        if not ((np.array([cx, cy]) > low - grow) & (np.array([cx, cy]) < high + grow)).all():
            continue
        ratio = max(w, h) / max(float((high - low).max()), 1.0)
        common = np.clip(np.minimum(blob.box[2:], high) - np.maximum(blob.box[:2], low), 0, None)
        overlap = common.prod() / max(w * h + (high - low).prod() - common.prod(), 1.0)
        if 0.5 < ratio < 2.2 and overlap > 0.2:
            return 1
        if 0.33 < ratio < 3:
            best = -1
    return best


def samples(seed: int, level: str) -> tuple[Array, Array]:
    """Candidate features and labels of one photo, its front slightly misplaced on purpose."""
    image, truth = synthesise(seed, level)
    photo = make_photo(image)
    rng = np.random.default_rng(seed)
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
    blobs = find_blobs(front, find_seams(front), keep=400, separate=False)
    if not blobs:
        return np.zeros((0, 28)), np.zeros(0)
    y = np.array([label(b, handles) for b in blobs])
    return np.array([b.features for b in blobs])[y >= 0], y[y >= 0]


def main() -> None:
    """Train and save."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--first", type=int, default=100)
    parser.add_argument("--count", type=int, default=60)
    parser.add_argument("--out", type=Path, default=MODEL)
    args = parser.parse_args()
    seeds = range(args.first, args.first + args.count)
    data = [samples(seed, level) for seed in seeds for level in LEVELS]
    x = np.concatenate([a for a, _ in data])
    y = np.concatenate([b for _, b in data])
    model = lightgbm.train(PARAMS, lightgbm.Dataset(x, y), 150)
    model.save_model(str(args.out))
    print(f"{len(y)} candidates, {y.mean():.1%} handles -> {args.out}")


if __name__ == "__main__":
    main()
