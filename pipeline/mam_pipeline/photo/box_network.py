"""A network's view of a photo: which places show which face of the object, and where its box ends.

Every place of the object says where the eight corners of its box are and how sure it is of each
(a Laplace distribution); the places are counted together. The network (`network`) was trained on
painted and real photos (`mam_training.photo.train_box`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.photo.network import STRIDE, load_network, nearest_shape, softmax

Array = NDArray[np.float32]
WEIGHTS = Path(__file__).parent / "weights" / "box" / "network.npz"
SHAPES = ((288, 384), (320, 320), (384, 288), (256, 416), (416, 256))
"""(height, width) that a photo is squeezed to: the nearest in proportion."""
SEEN = ("other", "front", "left", "right", "top", "bottom", "opened")
"""What a place shows: a face of the object's box, or what stands out of an open one."""
CORNERS = 8
MAPS = {"seen": len(SEEN), "corner": 2 * CORNERS, "spread": CORNERS}
SUREST = 0.25  # of the places are counted
LEAST_SPREAD = 1e-3


@dataclass(frozen=True)
class BoxMaps:
    """What the network sees in a photo.

    Attributes:
        seen: (7, h, w) probabilities of SEEN at places spread evenly over the photo.
        corners: (8, 2) pixels of the photo, in the order of camera.CORNERS.
        spread: (8,) pixels, how far off a corner may be (of a Laplace distribution).
    """

    seen: Array
    corners: NDArray[np.float64]
    spread: NDArray[np.float64]


def look_at_photo(image: NDArray[np.uint8], weights: Path = WEIGHTS) -> BoxMaps:
    """Box of the main object of a photo (height, width, 3), RGB, by a network's weights."""
    height, width = image.shape[:2]
    shape = nearest_shape(SHAPES, height, width)
    raw = load_network(weights)(image, shape)
    seen, corner, spread = np.split(raw, np.cumsum(list(MAPS.values()))[:-1])
    seen = softmax(seen)
    at, off = counted(1 - seen[0], corner, spread)
    scale = np.array([width / shape[1], height / shape[0]]) * STRIDE
    return BoxMaps(seen, at * scale, off * float(scale.mean()))


def counted(
    body: Array, corner: Array, spread: Array
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Where the places say together that the corners are.

    Args:
        body: (h, w) probability that a place shows the object.
        corner: (16, h, w) raw: the way to each corner, x then y, over the mean of h and w.
        spread: (8, h, w) raw: logarithm of its spread, likewise.

    Returns:
        (8, 2) corners and (8,) spreads, in places.
    """
    h, w = body.shape
    unit = (h + w) / 2
    inside = body.ravel() > min(0.5, float(body.max()) * 0.9)
    y, x = np.mgrid[0:h, 0:w].reshape(2, -1)[:, inside] + 0.5
    way = corner.reshape(CORNERS, 2, -1)[:, :, inside] * unit
    points = way + np.stack([x, y])
    b = np.exp(spread.reshape(CORNERS, -1)[:, inside].astype(np.float64)) * unit
    at, off = np.empty((CORNERS, 2)), np.empty(CORNERS)
    most = max(1, int(SUREST * b.shape[1]))
    for k in range(CORNERS):
        best = np.argsort(b[k], kind="stable")[:most]
        weight = body.ravel()[inside][best] / np.maximum(b[k, best], LEAST_SPREAD)
        at[k] = [_weighted_median(points[k, i, best], weight) for i in (0, 1)]
        off[k] = float(np.median(b[k, best]))
    return at, off


def _weighted_median(values: NDArray[np.float64], weight: NDArray[np.float64]) -> float:
    order = np.argsort(values, kind="stable")
    total = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(total, total[-1] / 2)])
