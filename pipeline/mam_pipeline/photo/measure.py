"""From a fitted box and options to metres: which face is the front, depth, scale, textures."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mam_pipeline.photo.camera import quad_homography
from mam_pipeline.photo.cuboid import Cuboid
from mam_pipeline.photo.image import Photo
from mam_pipeline.photo.options import PhotoOptions

Array = NDArray[np.float64]
FRONT_SIDE = 640
TEXTURE_SIDE = 1024
# usual height (with legs) and depth, metres: used only where the photo and the user say nothing
DEFAULTS = {
    "nightstand": (0.55, 0.40), "drawer_unit": (0.90, 0.45), "cabinet": (0.85, 0.42),
    "sideboard": (0.75, 0.42), "wardrobe": (1.90, 0.58), "fridge": (1.70, 0.66),
    "microwave": (0.29, 0.37), "oven": (0.60, 0.55), "dishwasher": (0.82, 0.58),
    "washing_machine": (0.85, 0.58),
}  # fmt: skip


@dataclass(frozen=True)
class Sizes:
    """Width, depth, height in metres, and where depth and scale come from."""

    width: float
    depth: float
    height: float
    depth_from: str  # observed | inferred | assumed | user
    scale_from: str  # assumed | user


def rectify(photo: Photo, quad: Array, ratio: float, side: int = FRONT_SIDE) -> NDArray[np.uint8]:
    """Warp a face (quad in small pixels, `ratio` width over height) to a rectangle."""
    k = photo.rgb.shape[1] / photo.size[0]
    long = min(side, max(96, round(1.3 * k * _longest(quad))))
    w, h = (long, long / ratio) if ratio >= 1 else (long * ratio, long)
    size = (max(40, round(w)), max(40, round(h)))
    matrix = quad_homography(quad * k, *size)
    shrink = k * _longest(quad) / long
    source: Any = photo.rgb
    if shrink > 1.6:  # avoid aliasing of fine patterns
        source = cv2.GaussianBlur(source, (0, 0), 0.35 * shrink)
    return cv2.warpPerspective(
        source, matrix, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    ).astype(np.uint8)


def _longest(quad: Array) -> float:
    return float(np.linalg.norm(np.roll(quad, -1, axis=0) - quad, axis=1).max())


def jpeg(image: NDArray[np.uint8]) -> bytes:
    """Encode RGB as JPEG."""
    return cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 90])[1].tobytes()


def quad_area(quad: Array) -> float:
    """Area of a (4, 2) quadrilateral."""
    x, y = quad.T
    return 0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1)))


def side_share(cuboid: Cuboid, front: str) -> float:
    """Share of the visible faces' area that is not the front: what depth is measured from."""
    areas = {f: quad_area(cuboid.quad(f)) for f in cuboid.visible}
    total = sum(areas.values())
    return 1 - areas.get(front, 0.0) / max(total, 1e-9)


def guess_category(width: float, height: float, kinds: list[str], given: str | None = None) -> str:
    """A furniture category from proportions and what the front holds; only its size is used."""
    if given:
        return given
    ratio = width / height
    drawers, doors = kinds.count("drawer"), kinds.count("door")
    if ratio < 0.62 and doors and drawers == 0:
        return "wardrobe" if doors > 2 else "fridge"
    if ratio < 0.55:
        return "drawer_unit" if drawers else "wardrobe"
    if ratio > 1.6:
        return "sideboard"
    if drawers + doors <= 2 or (drawers <= 3 and doors == 0 and 0.7 < ratio < 1.3):
        return "nightstand" if ratio < 1.35 else "cabinet"
    return "drawer_unit" if doors == 0 else "cabinet"


def settle_sizes(
    shape: tuple[float, float, float],
    depth_from: str,
    category: str,
    options: PhotoOptions,
    legs: float = 0.0,
) -> Sizes:
    """Scale a shape (width, depth, height of the body, any unit; `legs` share of body height).

    Args:
        depth_from: observed, as the shape has it; inferred, half way (in logs) between that and the
            category's usual depth; assumed, the usual one.
    """
    w, d, h = shape
    tall, deep = DEFAULTS[category]
    full = h * (1 + legs)
    scale_from = "user"
    if options.height:
        k = options.height / full
    elif options.width:
        k = options.width / w
    elif options.depth and depth_from != "assumed":
        k = options.depth / d
    else:
        k, scale_from = tall / full, "assumed"
    depth = d * k
    usual = deep if scale_from == "assumed" else deep / tall * full * k
    usual = min(usual, 1.2 * max(w, h) * k)
    if options.depth:
        depth, depth_from = options.depth, "user"
    elif depth_from == "assumed" or not 0.12 * min(w, h) < d < 2.2 * max(w, h):
        depth, depth_from = usual, "assumed"
    elif depth_from == "inferred":
        depth = float(np.sqrt(depth * usual))
    return Sizes(w * k, depth, h * k, depth_from, scale_from)
