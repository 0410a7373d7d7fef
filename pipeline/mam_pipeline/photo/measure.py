"""From a fitted box and options to metres: which face is the front, depth, scale, textures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
# usual (height with legs, width, depth) in metres, each with its spread: the standard deviation of
# the logarithm. They count only where the photo and the user say nothing.
USUAL = {
    "nightstand": ((0.55, 0.15), (0.47, 0.20), (0.40, 0.15)),
    "drawer_unit": ((0.95, 0.25), (0.75, 0.35), (0.45, 0.15)),
    "file_cabinet": ((1.00, 0.25), (0.43, 0.15), (0.58, 0.12)),
    "cabinet": ((0.85, 0.20), (0.85, 0.30), (0.42, 0.20)),
    "sideboard": ((0.78, 0.15), (1.45, 0.20), (0.42, 0.12)),
    "wardrobe": ((1.95, 0.10), (1.10, 0.40), (0.58, 0.10)),
    "bookcase": ((1.50, 0.35), (0.80, 0.30), (0.32, 0.15)),
    "desk": ((0.75, 0.06), (1.20, 0.20), (0.60, 0.15)),
    "safe": ((0.45, 0.40), (0.40, 0.30), (0.40, 0.30)),
    "fridge": ((1.72, 0.12), (0.65, 0.18), (0.66, 0.10)),
    "microwave": ((0.29, 0.12), (0.49, 0.12), (0.38, 0.15)),
    "oven": ((0.80, 0.20), (0.62, 0.12), (0.58, 0.10)),
    "dishwasher": ((0.83, 0.05), (0.60, 0.06), (0.58, 0.08)),
    "washing_machine": ((0.85, 0.05), (0.60, 0.06), (0.58, 0.12)),
}

FURNITURE = {
    "nightstand": 0.2, "drawer_unit": 0.2, "cabinet": 0.3, "sideboard": 0.1, "wardrobe": 0.2,
}  # fmt: skip


@dataclass(frozen=True)
class Sizes:
    """Width, depth, height in metres, and where depth and scale come from.

    Attributes:
        depth_from: observed | inferred | assumed | user.
        scale_from: assumed | user.
        category: whose usual size fills what is unknown.
        spread: standard deviation of the logarithm of the scale; 0 where the user gave it.
    """

    width: float
    depth: float
    height: float
    depth_from: str
    scale_from: str
    category: str = "cabinet"
    spread: float = 0.0


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


@dataclass(frozen=True)
class UsualSize:
    """What a thing of some proportions usually measures.

    Attributes:
        category: the likeliest.
        scale: metres per unit of the shape. spread: standard deviation of its logarithm.
        depth: usual depth, metres.
    """

    category: str
    scale: float
    spread: float
    depth: float


def usual_size(
    width: float,
    height: float,
    depth: float | None,
    categories: Mapping[str, float],
    kinds: Sequence[str] = (),
) -> UsualSize:
    """The size of a thing, by what it may be.

    For each category the scale is that which brings the shape nearest to the usual sizes, each
    weighed by its spread; a category counts by its probability and by how well the shape fits.

    Args:
        width, height, depth: of the whole thing, any unit; depth None where it is not seen.
        categories: category to its probability.
        kinds: of the panels on the front.
    """
    shape = np.log([height, width] if depth is None else [height, width, depth])
    rows = []
    for category, p in categories.items():
        fit, k, sure = _fits(shape, category)
        rows.append((p * fit * _fits_panels(category, kinds), k, sure, category))
    weight = np.array([r[0] for r in rows]) + 1e-12
    weight /= weight.sum()
    scales, own = (np.array([r[n] for r in rows]) for n in (1, 2))
    mean = float(weight @ scales)
    spread = float(np.sqrt(weight @ (own**2 + (scales - mean) ** 2)))
    deep = float(np.exp(weight @ np.log([USUAL[r[3]][2][0] for r in rows])))
    return UsualSize(rows[int(weight.argmax())][3], float(np.exp(mean)), spread, deep)


def by_proportions(ratio: float, categories: Mapping[str, float]) -> dict[str, float]:
    """Categories to their probabilities, given a front's width over its height; the same sum."""
    shape = np.log([1.0, ratio])
    fits = {k: p * _fits(shape, k)[0] for k, p in categories.items()}
    share = sum(categories.values()) / max(sum(fits.values()), 1e-12)
    return {k: fit * share for k, fit in fits.items()}


def _fits(shape: Array, category: str) -> tuple[float, float, float]:
    """How well a shape suits a category, the logarithm of its scale then, and how sure that is.

    Args:
        shape: logarithms of height, width and, where it is seen, depth, any unit.
    """
    usual = np.array(USUAL[category])[: len(shape)]
    precision = usual[:, 1] ** -2.0
    away = np.log(usual[:, 0]) - shape
    k = float((precision * away).sum() / precision.sum())
    misfit = float((precision * (away - k) ** 2).sum())
    own = float(precision.sum() ** -0.5)
    return float(np.exp(-0.5 * misfit) / np.prod(usual[:, 1]) * own), k, own


def _fits_panels(category: str, kinds: Sequence[str]) -> float:
    """How well what the front holds suits a category, 0..1."""
    drawers, doors = kinds.count("drawer"), kinds.count("door")
    if category == "nightstand":
        return 1.0 if drawers + doors <= 3 else 0.1
    if category in ("drawer_unit", "file_cabinet"):
        return 1.0 if drawers >= 3 and doors == 0 else 0.3
    if category in ("cabinet", "sideboard"):
        return 1.0 if doors or drawers < 3 else 0.5
    if category == "wardrobe":
        return 1.0 if doors else 0.2
    return 1.0 if drawers + doors <= 4 else 0.3


def settle_sizes(
    shape: tuple[float, float, float],
    depth_from: str,
    categories: Mapping[str, float],
    options: PhotoOptions,
    legs: float = 0.0,
    kinds: Sequence[str] = (),
) -> Sizes:
    """Scale a shape (width, depth, height of the body, any unit; `legs` share of body height).

    Args:
        depth_from: observed, as the shape has it; inferred, half way (in logs) between that and the
            usual depth; assumed, the usual one.
        categories: what it may be, with probabilities (`usual_size`). kinds: of its panels.
    """
    w, d, h = shape
    full = h * (1 + legs)
    usual = usual_size(w, full, d if depth_from == "observed" else None, categories, kinds)
    scale_from, spread = "user", 0.0
    if options.height:
        k = options.height / full
    elif options.width:
        k = options.width / w
    elif options.depth and depth_from != "assumed":
        k = options.depth / d
    else:
        k, scale_from, spread = usual.scale, "assumed", usual.spread
    depth = d * k
    deep = min(usual.depth * k / usual.scale, 1.2 * max(w, h) * k)
    if options.depth:
        depth, depth_from = options.depth, "user"
    elif depth_from == "assumed" or not 0.12 * min(w, h) < d < 2.2 * max(w, h):
        depth, depth_from = deep, "assumed"
    elif depth_from == "inferred":
        depth = float(np.sqrt(depth * deep))
    return Sizes(w * k, depth, h * k, depth_from, scale_from, usual.category, spread)
