"""Trains the front network on painted, rendered and real fronts.

    python -m mam_training.photo.train_front configs/train/photo_front.yaml

Every front is painted once (`mam_world.photos.painted_front`) and seen once; a share of them are
fronts of rendered photos, which are seen several times, each time cut out otherwise, and so are
those of real photos that were marked by eye (`real_photos`), of which nothing is said around the
front. From nothing it takes some 5 minutes on a GPU with 15 cores that paint, on one core an
estimated 5 hours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional as f

from mam_pipeline.photo.front_network import KINDS, MAPS, SHAPES, WEIGHTS
from mam_pipeline.photo.network import STRIDE, nearest_shape
from mam_training import manifest
from mam_training.command import configured
from mam_training.photo.network_model import Network, NetworkTraining, save, trained
from mam_training.photo.real_photos import REAL, marked_in, toned
from mam_training.photo.real_photos import front_lesson as real_front
from mam_world.photos.painted_front import PaintedFront, paint_front
from mam_world.photos.synthetic_photo import LEVELS, synthesise
from mam_world.photos.truth import PanelTruth

Array = NDArray[np.float32]
PHOTO_WIDTH = 560  # pixels of a rendered photo
RENDERED_LONG, RENDERED_MARGIN = 430, 50  # pixels of its front's long side, and around it
UNKNOWN = -100  # in place of an index of KINDS: nobody says what is there
SOME = {"panel": len(KINDS), "door": len(KINDS) + 1}
"""Codes beside the indices of KINDS: it opens, and is of any kind, or a door of any hinge."""
UNMARKED = -1.0  # in place of a share of a handle: nobody says whether one is there


@dataclass(frozen=True)
class FrontTraining(NetworkTraining):
    """What the front network is trained on, and where it goes."""

    start: str = "2526952"
    count: int = 3_200
    """Fronts that are seen."""
    batch: int = 16
    rate: float = 5e-4
    slower: float = 0.3
    real: float = 0.6
    rendered: int = 80
    """Rendered photos."""
    first: int = 100_000
    """Their first seed."""
    share: float = 0.2
    """Of the fronts that come from rendered photos."""
    out: Path = Path("build/weights/photo/front")
    """Folder that the weights and their manifest are written to."""


class Lesson(NamedTuple):
    """A front as the network sees it (h, w, 3) uint8, and the maps it should give."""

    picture: NDArray[np.uint8]
    lines: Array  # (2, h / 4, w / 4): upright, level
    handle: Array  # (h / 4, w / 4), or UNMARKED
    kind: NDArray[np.int64]  # (h / 4, w / 4) index of KINDS, one of SOME, or UNKNOWN
    reach: Array  # (4, h / 4, w / 4) to the left, top, right, bottom side, shares of w + h


def lesson_of(front: PaintedFront, rng: np.random.Generator, whole: bool = True) -> Lesson:
    """Cut the front out, as well or badly as a fitted box does, and draw its maps.

    Args:
        whole: whether the truth holds around the front, too.
    """
    corners = front.corners
    size = corners[2] - corners[0]
    off = rng.normal(0, 0.006, (4, 2))
    if rng.random() < 0.3:  # a box too large or too small
        off += rng.normal(0.0, 0.035, (1, 2)) + np.array(
            [[-1, -1], [1, -1], [1, 1], [-1, 1]]
        ) * rng.normal(0.0, 0.025, (1, 2))
    quad = (corners + off * size).astype(np.float32)
    h, w = nearest_shape(SHAPES, float(size[1] * np.exp(rng.normal(0, 0.08))), float(size[0]))
    target = np.array([[0, 0], [w, 0], [w, h], [0, h]], np.float32)
    m = cv2.getPerspectiveTransform(quad, target)
    picture = cv2.warpPerspective(
        front.picture, m, (w, h), flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REPLICATE
    )
    flip = rng.random() < 0.5
    if flip:
        picture = picture[:, ::-1]
    boxes, kinds, handles = [], [], []

    def seen(rect: tuple[float, float, float, float]) -> Array:
        p = corners[0] + np.array([[rect[0], rect[1]], [rect[2], rect[3]]]) * size
        q = cv2.perspectiveTransform(p[None].astype(np.float32), m)[0].ravel()
        return np.array([w - q[2], q[1], w - q[0], q[3]] if flip else q, np.float32)

    for panel in front.panels:
        boxes.append(seen(panel.rect))
        kinds.append(_code(panel, flip, whole))
        handles += [seen(k) for k in panel.handles]
    unmarked = [] if handles or whole else boxes  # nobody marked any handle on this front
    lesson = _drawn(np.ascontiguousarray(picture, np.uint8), boxes, kinds, handles, unmarked)
    return lesson if whole else _around_unknown(lesson, seen((0.0, 0.0, 1.0, 1.0)))


def _code(panel: PanelTruth, flip: bool, whole: bool) -> int:
    """The index of KINDS of a panel, or one of SOME."""
    if panel.kind in ("drawer", "panel"):
        return KINDS.index("drawer") if panel.kind == "drawer" else SOME["panel"]
    if panel.hinge_side is None and not whole:
        return SOME["door"]
    hinge = panel.hinge_side or "left"
    if flip:
        hinge = {"left": "right", "right": "left"}.get(hinge, hinge)
    return KINDS.index(f"door {hinge}")


def _around_unknown(lesson: Lesson, front: Array) -> Lesson:
    """The lesson, with nothing said of what lies around the front x0, y0, x1, y1."""
    h, w = lesson.kind.shape
    x0, y0, x1, y1 = front / STRIDE
    y, x = (np.arange(n, dtype=np.float32) + 0.5 for n in (h, w))
    rows, columns = (y > y0 - 1) & (y < y1 + 1), (x > x0 - 1) & (x < x1 + 1)
    inside = rows[:, None] & columns[None]
    return lesson._replace(kind=np.where(inside, lesson.kind, UNKNOWN))


def _drawn(
    picture: NDArray[np.uint8], boxes: list[Array], kinds: list[int], handles: list[Array],
    unmarked: list[Array],
) -> Lesson:  # fmt: skip
    h, w = (n // STRIDE for n in picture.shape[:2])
    y, x = (np.arange(n, dtype=np.float32) + 0.5 for n in (h, w))
    lines, handle = np.zeros((2, h, w), np.float32), np.zeros((h, w), np.float32)
    kind, reach = np.zeros((h, w), np.int64), np.zeros((4, h, w), np.float32)
    for box, k in zip(boxes, kinds):
        x0, y0, x1, y1 = box / STRIDE
        rows, columns = (y > y0) & (y < y1), (x > x0) & (x < x1)
        inside = rows[:, None] & columns[None]
        kind[inside] = k
        far = np.stack(
            np.broadcast_arrays(x[None] - x0, y[:, None] - y0, x1 - x[None], y1 - y[:, None])
        )
        reach[:, inside] = far[:, inside] / (h + w)
        for at in (x0, x1):
            near = np.clip(1.6 - np.abs(x - at), 0, 1)
            lines[0] = np.maximum(lines[0], near[None] * rows[:, None])
        for at in (y0, y1):
            near = np.clip(1.6 - np.abs(y - at), 0, 1)
            lines[1] = np.maximum(lines[1], near[:, None] * columns[None])
    for box in unmarked:
        x0, y0, x1, y1 = box / STRIDE
        handle[((y > y0) & (y < y1))[:, None] & ((x > x0) & (x < x1))[None]] = UNMARKED
    for box in handles:
        x0, y0, x1, y1 = box / STRIDE
        cover_x = np.clip(np.minimum(x + 0.5, x1) - np.maximum(x - 0.5, x0), 0, 1)
        cover_y = np.clip(np.minimum(y + 0.5, y1) - np.maximum(y - 0.5, y0), 0, 1)
        cover_x = cover_x / max(float(cover_x.max()), 1e-3)  # thin ones count as a whole cell
        cover_y = cover_y / max(float(cover_y.max()), 1e-3)
        handle = np.maximum(handle, cover_y[:, None] * cover_x[None])
    return Lesson(picture, lines, handle, kind, reach)


def front_lesson(
    config: FrontTraining, rendered: list[PaintedFront], real: list[PaintedFront], number: int
) -> Lesson:
    """The front of a number as a lesson."""
    rng = np.random.default_rng([config.seed, number])
    if real and rng.random() < config.real:
        front = real[int(rng.integers(len(real)))]
        front = replace(front, picture=toned(front.picture, rng))
        return lesson_of(front, rng, whole=False)
    if rng.random() < config.share and rendered:
        front = rendered[int(rng.integers(len(rendered)))]
    else:
        front = paint_front(rng)
    return lesson_of(front, rng)


def rendered_front(seed: int) -> PaintedFront:
    """The front of a rendered photo, seen straight on with some room around it."""
    picture, truth = synthesise(seed, LEVELS[seed % len(LEVELS)], PHOTO_WIDTH)
    w, _, h = truth.size
    w, h = RENDERED_LONG * w / max(w, h), RENDERED_LONG * h / max(w, h)
    m = RENDERED_MARGIN
    corners = np.array([[m, m], [m + w, m], [m + w, m + h], [m, m + h]])
    matrix = cv2.getPerspectiveTransform(truth.front.astype(np.float32), corners.astype(np.float32))
    size = (int(w + 2 * m), int(h + 2 * m))
    seen = cv2.warpPerspective(
        picture, matrix, size, flags=cv2.INTER_AREA, borderMode=cv2.BORDER_REPLICATE
    )
    return PaintedFront(np.asarray(seen, np.uint8), corners, truth.panels)


def loss_of(
    out: Tensor, lines: Tensor, handle: Tensor, kind: Tensor, reach: Tensor
) -> dict[str, Tensor]:
    """Losses of raw maps (`front_network.MAPS`) by name: seams, handle, kind, reach."""
    upright, level, touched, kinds, far = out.split(list(MAPS.values()), dim=1)
    ends = torch.cat([upright, level], 1)
    weight = (1.0 + 2.0 * lines) * (kind != UNKNOWN)[:, None]
    seams = (f.binary_cross_entropy_with_logits(ends, lines, reduction="none") * weight).mean()
    said = (kind != UNKNOWN) & (handle != UNMARKED)
    grip = f.binary_cross_entropy_with_logits(touched[:, 0], handle.clamp(min=0), reduction="none")
    grip = (grip * (1.0 + 4.0 * handle) * said).mean()
    inside = kind > 0
    share = f.softplus(far) + 1e-3
    low = torch.minimum(share, reach)
    common = (low[:, 0] + low[:, 2]) * (low[:, 1] + low[:, 3])
    mine = (share[:, 0] + share[:, 2]) * (share[:, 1] + share[:, 3])
    true = (reach[:, 0] + reach[:, 2]) * (reach[:, 1] + reach[:, 3])
    iou = common / (mine + true - common + 1e-6)
    return {
        "seams": 3.0 * seams,
        "handle": 4.0 * grip,
        "kind": 0.7 * _kind_loss(kinds, kind),
        "reach": -0.5 * ((iou + 1e-4).log() * inside).sum() / inside.sum().clamp(min=1),
    }


def _kind_loss(kinds: Tensor, kind: Tensor) -> Tensor:
    """Minus the logarithm of the share of all kinds that may be true."""
    allowed = torch.eye(len(KINDS), device=kinds.device)
    some = torch.ones(len(SOME), len(KINDS), device=kinds.device)
    some[:, KINDS.index("none")] = 0
    some[1, KINDS.index("drawer")] = 0
    allowed = torch.cat([allowed, some])
    said = kind != UNKNOWN
    may = allowed[kind.clamp(min=0)].permute(0, 3, 1, 2)
    likely = torch.logsumexp(f.log_softmax(kinds, dim=1) + may.log(), dim=1)
    return -(likely * said).sum() / said.sum().clamp(min=1)


def train(config: FrontTraining) -> Network:
    """The network, trained."""
    rendered = [rendered_front(config.first + k) for k in range(config.rendered)]
    real = real_fronts(config)
    lesson = partial(front_lesson, config, rendered, real)
    return trained(config, sum(MAPS.values()), lesson, loss_of, WEIGHTS)


def real_fronts(config: FrontTraining) -> list[PaintedFront]:
    """Those of real photos whose panels are known; none where no lesson is to be of them."""
    if not config.real:
        return []
    marked = marked_in(config.labels, config.photos)
    return [real_front(mark, picture) for mark, picture in marked if mark.panels is not None]


def main(argv: Sequence[str] | None = None) -> None:
    """Train and save."""
    config = configured(FrontTraining(), argv)
    save(train(config), config.out / WEIGHTS.name)
    manifest.write(
        config.out,
        "python -m mam_training.photo.train_front configs/train/photo_front.yaml",
        config,
        {"fronts": config.seed, "photos": config.first},
        data_of(config),
        [manifest.GENERATED, "imagenet", *([REAL] if config.real else [])],
    )


def data_of(config: FrontTraining) -> dict[str, Any]:
    """How many fronts were seen, and a digest of the first painted, and of the real ones."""
    first = [paint_front(np.random.default_rng([config.seed, k])).picture for k in range(20)]
    first += [rendered_front(config.first + k).picture for k in range(min(config.rendered, 5))]
    real = real_fronts(config)
    first += [front.picture for front in real]
    return {
        "fronts": config.count,
        "rendered": config.rendered,
        "real": len(real),
        "sha256": manifest.data_digest(p.tobytes() for p in first),
    }


if __name__ == "__main__":
    main()
