"""Whether a front reads the same when it is shown differently: the best witness of a right reading.

A reading that follows the object's seams survives a mirror and a coarser, differently lit picture;
one that follows reflections, grain or chance does not.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from mam_pipeline.photo.front import FrontReading, read_front
from mam_pipeline.photo.panel import Panel
from mam_pipeline.photo.score import match

SAME = 0.7  # IoU from which two panels are one
COARSER = 0.8
DARKER = 1.25  # exponent on the brightness


MIRROR = {"door left": "door right", "door right": "door left"}


def agreement(reading: FrontReading, category: str | None) -> float:
    """0..1: the lesser share of panels that two other looks at the same front find again."""
    image = reading.image
    h, w = image.shape[:2]
    flipped = {MIRROR.get(kind, kind): odds for kind, odds in reading.kinds.items()}
    mirrored = read_front(np.ascontiguousarray(image[:, ::-1]), None, category, flipped).movable
    turned = [replace(p, box=(w - p.box[2], p.box[1], w - p.box[0], p.box[3])) for p in mirrored]
    size = (max(40, round(w * COARSER)), max(40, round(h * COARSER)))
    small = cv2.resize(_darker(image), size, interpolation=cv2.INTER_AREA)
    k = np.array([w / size[0], h / size[1]] * 2)
    coarse = read_front(np.asarray(small, np.uint8), None, category, reading.kinds).movable
    coarse_back = [replace(p, box=tuple(np.array(p.box) * k)) for p in coarse]
    own = list(reading.movable)
    return min(shared(own, turned), shared(own, coarse_back))


def _darker(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.asarray(255 * (image / 255.0) ** DARKER, np.uint8)


def shared(a: list[Panel], b: list[Panel]) -> float:
    """Panels of one kind that two readings have in common, over the mean of their numbers."""
    if not a or not b:
        return float(len(a) == len(b))
    p, q = (np.array([x.box for x in panels]) for panels in (a, b))
    low = np.maximum(p[:, None, :2], q[None, :, :2])
    high = np.minimum(p[:, None, 2:], q[None, :, 2:])
    common = np.prod(np.clip(high - low, 0, None), axis=2)
    area = [np.prod(x[:, 2:] - x[:, :2], axis=1) for x in (p, q)]
    iou = common / (area[0][:, None] + area[1][None] - common)
    pairs = match(iou, SAME)
    return 2 * sum(a[i].kind == b[j].kind for i, j in pairs) / (len(a) + len(b))
