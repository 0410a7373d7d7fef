"""The networks of the photo stage in NumPy: a backbone, and a decoder to the maps of an answer.

The backbone is an EfficientNet-Lite2 (Tan and Le, 2019) that began as ImageNet trained it; its maps
meet from the coarsest to the finest. `mam_training.photo.network_model` is the same in PyTorch.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mam_pipeline.photo.efficientnet import Layers, feature_maps

Array = NDArray[np.float32]
STRIDE = 4
TAPS = {0: 16, 3: 24, 6: 48, 14: 120, 20: 352}
"""Block of EfficientNet-Lite2 to the channels of its map; strides 2, 4, 8, 16, 32."""
CHANNELS = 64


def nearest_shape(
    shapes: Sequence[tuple[int, int]], height: float, width: float
) -> tuple[int, int]:
    """The (height, width) of `shapes` nearest in proportion."""
    wanted = np.log(width / height)
    return min(shapes, key=lambda s: abs(float(np.log(s[1] / s[0]) - wanted)))


@dataclass(frozen=True)
class Network:
    """A backbone and its decoder, by their weights."""

    weights: dict[str, Array]
    backbone: Layers

    def __call__(self, image: NDArray[np.uint8], shape: tuple[int, int]) -> Array:
        """(answers, h, w) raw values, h and w a quarter of `shape`.

        Args:
            image: (height, width, 3) RGB, which is squeezed into `shape` (height, width).
        """
        h, w = shape
        picture = cv2.resize(image, (w, h), interpolation=cv2.INTER_AREA)
        maps = feature_maps(np.asarray(picture, np.uint8), TAPS, self.backbone)
        fine, *rest = [self._pointwise(m, f"enter.{k}") for k, m in enumerate(maps)]
        _, high, wide = rest[-1].shape
        x = self._mixed(rest[-1] + self._places(high, wide, float(np.log(w / h))), 0)
        for k, m in enumerate(rest[-2::-1], 1):
            x = self._mixed(m + x.repeat(2, axis=1).repeat(2, axis=2), k)
        c, high, wide = x.shape
        x = x + fine.reshape(c, high, 2, wide, 2).mean(axis=(2, 4))
        return self._pointwise(np.maximum(x, 0), "leave")

    def _places(self, h: int, w: int, aspect: float) -> Array:
        """(c, h, w) what each place adds by where it lies."""
        y, x = np.meshgrid(np.linspace(-1, 1, h), np.linspace(-1, 1, w), indexing="ij")
        where = np.stack([x, y, np.full((h, w), aspect)]).astype(np.float32)
        return np.asarray(np.einsum("ck,khw->chw", self.weights["place"], where), np.float32)

    def _pointwise(self, x: Array, at: str) -> Array:
        kernel = self.weights[f"{at}.weight"][:, :, 0, 0]
        out = kernel @ x.reshape(len(x), -1) + self.weights[f"{at}.bias"][:, None]
        return np.asarray(out.reshape(-1, *x.shape[1:]), np.float32)

    def _mixed(self, x: Array, number: int) -> Array:
        """A 5 x 5 neighbourhood, the row and the column of each place, mixed into its channels."""
        at = f"mixers.{number}."
        kernel, bias = self.weights[f"{at}near.weight"], self.weights[f"{at}near.bias"]
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
        y = self._pointwise(np.concatenate([x, near, *lines]), f"{at}mix")
        return x + self._pointwise(np.maximum(y, 0), f"{at}back")


@lru_cache(maxsize=4)
def load_network(path: Path) -> Network:
    """The network whose weights a file holds."""
    with np.load(path) as kept:
        all_of = {name: kept[name].astype(np.float32) for name in kept.files}
    at = "backbone.layers."
    names = {n.removeprefix(at).rpartition("_")[0] for n in all_of if n.startswith(at)}
    backbone = {n: (all_of[f"{at}{n}_kernel"], all_of[f"{at}{n}_bias"]) for n in names}
    decoder = {n.removeprefix("decoder."): v for n, v in all_of.items() if n.startswith("decoder.")}
    return Network(decoder, backbone)


def sigmoid(x: Array) -> Array:
    """1 / (1 + exp(-x))."""
    return np.asarray(1.0 / (1.0 + np.exp(-x)), np.float32)


def softmax(x: Array) -> Array:
    """Over the first axis."""
    e = np.exp(x - x.max(axis=0))
    return np.asarray(e / e.sum(axis=0), np.float32)
