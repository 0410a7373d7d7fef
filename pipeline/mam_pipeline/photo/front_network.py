"""A network's view of a front: where panels end, what each place belongs to, where handles sit.

The network (`network`, 5 million weights) was trained on painted, rendered and real fronts
(`mam_training.photo.train_front`). Every place of a panel also says how far the panel's sides are,
as in FCOS (Tian et al., 2019): `tiling` counts these votes.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.photo.network import load_network, nearest_shape, sigmoid, softmax

Array = NDArray[np.float32]
WEIGHTS = Path(__file__).parent / "weights" / "front" / "network.npz"
SHAPES = ((192, 448), (256, 384), (320, 320), (384, 256), (448, 192))
"""(height, width) that a front is squeezed to: the nearest in proportion."""
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
    raw = load_network(WEIGHTS)(image, nearest_shape(SHAPES, *image.shape[:2]))
    upright, level, handle, kind, reach = np.split(raw, np.cumsum(list(MAPS.values()))[:-1])
    return FrontMaps(
        sigmoid(upright[0]), sigmoid(level[0]), sigmoid(handle[0]), softmax(kind),
        np.asarray((np.logaddexp(0, reach) + LEAST_REACH) * sum(raw.shape[1:]), np.float32),
        image.shape[0], image.shape[1],
    )  # fmt: skip
