"""A network's view of a front: where panels end, what each place belongs to, where handles sit.

EfficientNet-Lite2 as ImageNet trained it (Tan and Le, 2019), and a decoder of 0.27 million weights
that was trained on painted and rendered fronts only (`mam_training.photo.train_front`), both in
NumPy. Every place of a panel also says how far the panel's sides are, as in FCOS (Tian et al.,
2019): `tiling` counts these votes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mam_pipeline.photo.efficientnet import feature_maps

Array = NDArray[np.float32]
WEIGHTS = Path(__file__).parent / "weights" / "front" / "network.npz"
SHAPES = ((192, 448), (256, 384), (320, 320), (384, 256), (448, 192))
"""(height, width) that a front is squeezed to: the nearest in proportion."""
STRIDE = 4
TAPS = {0: 16, 3: 24, 6: 48, 14: 120, 20: 352}
"""Block of EfficientNet-Lite2 to the channels of its map; strides 2, 4, 8, 16, 32."""
CHANNELS = 64
MAPS = {"upright": 1, "level": 1, "handle": 1, "kind": 6, "reach": 4}
KINDS = ("none", "drawer", "door left", "door right", "door bottom", "door top")
LEAST_REACH = 1e-3


@dataclass(frozen=True)
class FrontMaps:
    """What the network sees on a front, at h x w places spread evenly over it.

    Attributes:
        upright, level: (h, w) probability that a panel ends here at an upright or a level line.
        handle: (h, w) probability of a handle.
        kind: (6, h, w) probabilities of KINDS: nothing that opens, drawer, door and its hinge.
        reach: (4, h, w) distance to the panel's left, top, right and bottom side, in places.
        height, width: of the front's picture, pixels.
    """

    upright: Array
    level: Array
    handle: Array
    kind: Array
    reach: Array
    height: int
    width: int

    def kind_shares(self, box: tuple[float, float, float, float]) -> dict[str, float]:
        """What a rectangle (x0, y0, x1, y1) of front pixels is if it opens: KINDS to shares."""
        h, w = self.handle.shape
        x = (np.arange(w) + 0.5) * self.width / w
        y = (np.arange(h) + 0.5) * self.height / h
        rows, columns = (y > box[1]) & (y < box[3]), (x > box[0]) & (x < box[2])
        inside = self.kind[1:, rows][:, :, columns]
        mean = inside.mean(axis=(1, 2)) + 1e-6 if inside.size else np.ones(len(KINDS) - 1)
        return dict(zip(KINDS[1:], (mean / mean.sum()).tolist()))


def look_at_front(image: NDArray[np.uint8]) -> FrontMaps:
    """Maps of a rectified front (height, width, 3), RGB."""
    h, w = shape_for(*image.shape[:2])
    picture = cv2.resize(image, (w, h), interpolation=cv2.INTER_AREA)
    raw = _decoded(feature_maps(np.asarray(picture, np.uint8), TAPS), float(np.log(w / h)))
    upright, level, handle, kind, reach = np.split(raw, np.cumsum(list(MAPS.values()))[:-1])
    e = np.exp(kind - kind.max(axis=0))
    return FrontMaps(
        _sigmoid(upright[0]), _sigmoid(level[0]), _sigmoid(handle[0]), e / e.sum(axis=0),
        np.asarray((np.logaddexp(0, reach) + LEAST_REACH) * sum(raw.shape[1:]), np.float32),
        image.shape[0], image.shape[1],
    )  # fmt: skip


def shape_for(height: float, width: float) -> tuple[int, int]:
    """The shape of SHAPES nearest in proportion to a front."""
    wanted = np.log(width / height)
    return min(SHAPES, key=lambda s: abs(float(np.log(s[1] / s[0]) - wanted)))


def _sigmoid(x: Array) -> Array:
    return np.asarray(1.0 / (1.0 + np.exp(-x)), np.float32)


@lru_cache(maxsize=1)
def _weights() -> dict[str, Array]:
    with np.load(WEIGHTS) as kept:
        return {name: kept[name].astype(np.float32) for name in kept.files}


def _decoded(maps: list[Array], aspect: float) -> Array:
    """(sum of MAPS, h, w) raw values: the maps meet from the coarsest to the finest."""
    fine, *rest = [_pointwise(m, f"enter.{k}") for k, m in enumerate(maps)]
    x = _mixed(rest[-1] + _places(rest[-1].shape[1], rest[-1].shape[2], aspect), 0)
    for k, m in enumerate(rest[-2::-1], 1):
        x = _mixed(m + x.repeat(2, axis=1).repeat(2, axis=2), k)
    c, h, w = x.shape
    x = x + fine.reshape(c, h, 2, w, 2).mean(axis=(2, 4))
    return _pointwise(np.maximum(x, 0), "leave")


def _places(h: int, w: int, aspect: float) -> Array:
    """(c, h, w) what each place adds by where it lies."""
    y, x = np.meshgrid(np.linspace(-1, 1, h), np.linspace(-1, 1, w), indexing="ij")
    where = np.stack([x, y, np.full((h, w), aspect)]).astype(np.float32)
    return np.asarray(np.einsum("ck,khw->chw", _weights()["place"], where), np.float32)


def _pointwise(x: Array, at: str) -> Array:
    kernel = _weights()[f"{at}.weight"][:, :, 0, 0]
    out = kernel @ x.reshape(len(x), -1) + _weights()[f"{at}.bias"][:, None]
    return np.asarray(out.reshape(-1, *x.shape[1:]), np.float32)


def _mixed(x: Array, number: int) -> Array:
    """A 5 x 5 neighbourhood, the row and the column of each place, mixed into its channels."""
    at = f"mixers.{number}."
    kernel, bias = _weights()[f"{at}near.weight"], _weights()[f"{at}near.bias"]
    h, w = x.shape[1:]
    padded = np.pad(x, ((0, 0), (2, 2), (2, 2)))
    near = np.zeros_like(x) + bias[:, None, None]
    for i in range(5):
        for j in range(5):
            near += kernel[:, 0, i, j, None, None] * padded[:, i : i + h, j : j + w]
    lines = [
        np.broadcast_to(k, x.shape)
        for k in (
            x.mean(2, keepdims=True), x.max(2, keepdims=True),
            x.mean(1, keepdims=True), x.max(1, keepdims=True),
        )
    ]  # fmt: skip
    y = _pointwise(np.concatenate([x, near, *lines]), f"{at}mix")
    return x + _pointwise(np.maximum(y, 0), f"{at}back")
