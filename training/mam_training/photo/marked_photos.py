"""Photos whose truth a person marked, each seen in several ways: mirrored, warped, hidden ...

Confidence is fitted on them; no other weight ever sees them.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from mam_sim_bench.photo_outcome import Mark, load_truth, marks_of
from numpy.typing import NDArray

Array = NDArray[np.float64]
OTHER_SIDE = {"left": "right", "right": "left"}


@dataclass(frozen=True)
class Marked:
    """A picture (h, w, 3) RGB with its front (4, 2) and panels, in its pixels."""

    photo: str
    view: str
    image: NDArray[np.uint8]
    front: Array
    panels: tuple[Mark, ...]


def views(folder: Path, truth: Path, seed: int = 7) -> Iterator[Marked]:
    """Every closed photo of a truth file as it is, and changed in five ways and packed as JPEG."""
    rng = np.random.default_rng(seed)
    told = {n: t for n, t in load_truth(truth).items() if t.get("scope") == "closed"}
    photos = {n: np.asarray(cv2.imread(str(folder / n)), np.uint8) for n in told}
    for name, image in photos.items():
        yield _marked(name, "as it is", image, np.eye(3), told[name])
        for view, picture, moved in _changed(image, list(photos.values()), rng):
            quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(45, 90))]
            packed = cv2.imencode(".jpg", picture, quality)[1]
            seen = np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), np.uint8)
            yield _marked(name, view, seen, moved, told[name])


def _marked(
    name: str, view: str, bgr: NDArray[np.uint8], moved: Array, truth: Mapping[str, Any]
) -> Marked:
    def to(points: Any) -> Array:
        return cv2.perspectiveTransform(np.array(points, float).reshape(1, -1, 2), moved)[0]

    flipped = view == "mirror"
    panels = [
        Mark(
            m.kind,
            OTHER_SIDE.get(m.hinge, m.hinge) if flipped and m.hinge else m.hinge,
            to(m.quad),
            tuple(to(handle) for handle in m.handles),
        )
        for m in marks_of(truth)
    ]
    front = to(truth["front"])
    front = front[[1, 0, 3, 2]] if flipped else front
    image = np.ascontiguousarray(bgr[..., ::-1])
    return Marked(name, view, image, front, tuple(panels))


def _changed(
    image: NDArray[np.uint8], others: list[NDArray[np.uint8]], rng: np.random.Generator
) -> Iterator[tuple[str, NDArray[np.uint8], Array]]:
    """(view, picture, homography from the photo to it)."""
    h, w = image.shape[:2]
    mirror = np.array([[-1, 0, w - 1], [0, 1, 0], [0, 0, 1]], float)
    yield "mirror", np.ascontiguousarray(image[:, ::-1]), mirror
    square = np.array([[0, 0], [w, 0], [w, h], [0, h]], np.float32)
    bent = square + rng.uniform(-0.09, 0.09, (4, 2)).astype(np.float32) * w
    warp = cv2.getPerspectiveTransform(square, bent).astype(float)
    yield "warp", _warped(image, warp), warp
    c = int(0.05 * w)
    yield "cut", image[c : h - c, c : w - c].copy(), np.array([[1, 0, -c], [0, 1, -c], [0, 0, 1.0]])
    curve, cast = rng.choice([0.5, 1.8]), rng.uniform(0.75, 1.2, 3)
    soft = cv2.GaussianBlur(image, (0, 0), 1.2)
    toned = np.clip(255 * (soft / 255.0) ** curve * cast, 0, 255).astype(np.uint8)
    yield "tone", toned, np.eye(3)
    yield "hidden", _hidden(image, others[int(rng.integers(len(others)))], rng), np.eye(3)


def _warped(image: NDArray[np.uint8], matrix: Array) -> NDArray[np.uint8]:
    h, w = image.shape[:2]
    moved = cv2.warpPerspective(image, matrix, (w, h), borderMode=cv2.BORDER_REFLECT)
    return np.asarray(moved, np.uint8)


def _hidden(
    image: NDArray[np.uint8], other: NDArray[np.uint8], rng: np.random.Generator
) -> NDArray[np.uint8]:
    """The picture with an ellipse of another photo before its lower half."""
    out = image.copy()
    h, w = image.shape[:2]
    a, b = int(0.3 * w), int(0.22 * h)
    x, y = int(rng.uniform(0.1, 0.6) * w), int(rng.uniform(0.4, 0.75) * h)
    shape = np.zeros((b, a), np.uint8)
    cv2.ellipse(shape, (a // 2, b // 2), (a // 2 - 2, b // 2 - 2), 0, 0, 360, 1, -1)
    patch = np.asarray(cv2.resize(other[-2 * b :, :a], (a, b)), np.uint8)
    spot = out[y : y + b, x : x + a]
    inside = shape[: spot.shape[0], : spot.shape[1]] > 0
    spot[inside] = patch[: spot.shape[0], : spot.shape[1]][inside]
    return out
