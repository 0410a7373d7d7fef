"""The surfaces of a twin: the photo's faces without what is modelled, and without background."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from mam_pipeline.photo.camera import quad_homography
from mam_pipeline.photo.image import Photo
from mam_pipeline.photo.measure import rectify

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
Box = tuple[float, float, float, float]


@dataclass(frozen=True)
class TextureLimits:
    """How handles and background are taken out of a face's picture.

    Attributes:
        room: of a handle's narrow side: so far around it its shadow and rim go too.
        least_room: pixels, at the least.
        reach: pixels around from which a handle's place is painted over (Telea, 2004).
        rim: of the picture's narrow side: so far in a strip of background may reach.
        same: CIELAB units up to which a place is background as what lies beside it outside.
        apart: CIELAB units from which what lies further in is the object.
    """

    room: float = 0.35
    least_room: float = 3.0
    reach: float = 4.0
    rim: float = 0.04
    same: float = 12.0
    apart: float = 20.0


LIMITS = TextureLimits()
SIDES = ("top", "right", "bottom", "left")
"""Of a picture, in the order in which turning it to the left brings them to its top."""


def without(image: Picture, boxes: Sequence[Box]) -> Picture:
    """A picture (h, w, 3) in which boxes (x0, y0, x1, y1; 0..1) are painted over."""
    h, w = image.shape[:2]
    mask = np.zeros((h, w), np.uint8)
    for u0, v0, u1, v1 in boxes:
        room = max(LIMITS.room * min((u1 - u0) * w, (v1 - v0) * h), LIMITS.least_room)
        low = np.floor([u0 * w - room, v0 * h - room]).astype(int)
        high = np.ceil([u1 * w + room, v1 * h + room]).astype(int)
        mask[max(low[1], 0) : high[1], max(low[0], 0) : high[0]] = 255
    if not mask.any() or mask.all():
        return image
    return np.asarray(cv2.inpaint(image, mask, LIMITS.reach, cv2.INPAINT_TELEA), np.uint8)


def color_of(image: Picture, box: Box) -> tuple[float, float, float]:
    """The colour (0..1) of a handle on a front (h, w, 3): of what differs from around it.

    Args:
        box: x0, y0, x1, y1, pixels.
    """
    h, w = image.shape[:2]
    x0, y0, x1, y1 = (round(v) for v in box)
    x0, y0, x1, y1 = max(x0, 0), max(y0, 0), min(max(x1, x0 + 1), w), min(max(y1, y0 + 1), h)
    inside = image[y0:y1, x0:x1].reshape(-1, 3).astype(float)
    room = max(3, min(x1 - x0, y1 - y0) // 2)
    ring = image[max(y0 - room, 0) : y1 + room, max(x0 - room, 0) : x1 + room]
    behind = np.median(ring.reshape(-1, 3), axis=0)
    away = np.abs(inside - behind).sum(axis=1)
    mean = np.median(inside[away >= np.median(away)], axis=0) / 255.0
    return float(mean[0]), float(mean[1]), float(mean[2])


def without_background(
    photo: Photo, quad: Array, ratio: float, side: int, joined: Collection[str] = ()
) -> Picture:
    """A face of the object as `rectify` has it, without strips of background along its sides.

    The fitted box is often a little larger than the object. What goes on across the side of the
    face and ends within `rim` is background; it is painted like the first pixels of the object.

    Args:
        joined: sides (top, right, bottom, left) at which another face goes on: nothing is done.
    """
    image = rectify(photo, quad, ratio, side)
    h, w = image.shape[:2]
    rim = round(LIMITS.rim * min(h, w))
    if rim < 2:
        return image
    k = photo.rgb.shape[1] / photo.size[0]
    shift = np.array([[1.0, 0, rim], [0, 1, rim], [0, 0, 1]])
    wider = shift @ quad_homography(quad * k, w, h)
    size = (w + 2 * rim, h + 2 * rim)
    around = cv2.warpPerspective(photo.rgb, wider, size, borderMode=cv2.BORDER_REPLICATE)
    ones = np.ones(photo.rgb.shape[:2], np.uint8)
    known = cv2.warpPerspective(ones, wider, size, flags=cv2.INTER_NEAREST)
    lab = cv2.cvtColor(np.ascontiguousarray(around), cv2.COLOR_RGB2LAB).astype(np.float64)
    for turn, name in enumerate(SIDES):
        if name in joined:
            continue
        seen, shown = np.rot90(lab, turn), np.rot90(known, turn)
        along = slice(rim, seen.shape[1] - rim)
        if shown[:rim, along].mean() < 1.0:  # the picture ends there
            continue
        depth = _background(seen[: 4 * rim, along], rim)
        turned = np.ascontiguousarray(np.rot90(image, turn))
        rows = np.maximum(np.arange(rim)[:, None], np.minimum(depth, rim)[None])
        turned[:rim] = turned[rows, np.arange(turned.shape[1])[None]]
        image = np.ascontiguousarray(np.rot90(turned, -turn))
    return image


def _background(lab: Array, rim: int) -> NDArray[np.int64]:
    """How many pixels of every column, from the face's side inwards, are background.

    Args:
        lab: (4 rim, n, 3) CIELAB, the side of the face after the first `rim` rows.
    """
    behind = np.median(lab[:rim], axis=0)
    away = np.linalg.norm(lab[rim:] - behind, axis=2)
    inside = away[: rim + 1] > LIMITS.same
    depth = np.where(inside.any(axis=0), inside.argmax(axis=0), 0)
    columns = np.arange(len(depth))
    further = np.stack([away[np.minimum(depth + j, len(away) - 1), columns] for j in range(2, rim)])
    depth = np.where(np.median(further, axis=0) > LIMITS.apart, depth, 0) if rim > 2 else 0 * depth
    even = ndimage.median_filter(depth, 2 * rim + 1, mode="nearest")
    return np.where(even > 0, even + 1, 0).astype(np.int64)
