"""Find the object in a photo: its box, and what is on its front."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from mam_pipeline.errors import ConfigError
from mam_pipeline.hints import HintBox, Hints
from mam_pipeline.photo.box_network import SEEN, BoxMaps, look_at_photo
from mam_pipeline.photo.camera import FACES, apply_homography, quad_homography
from mam_pipeline.photo.category import Looks, front_kinds, things_of
from mam_pipeline.photo.complete import virtual_grasp
from mam_pipeline.photo.cuboid import Evidence, fit_cuboid, hold_of_length
from mam_pipeline.photo.front import FrontReading, Told, read_front
from mam_pipeline.photo.handles import Blob, Box
from mam_pipeline.photo.image import Photo
from mam_pipeline.photo.lines import Segments, edge_maps, find_segments, on_mask
from mam_pipeline.photo.mask import plain_backdrop, told_mask
from mam_pipeline.photo.measure import (
    FURNITURE,
    Sizes,
    quad_area,
    rectify,
    settle_sizes,
    side_share,
)  # fmt: skip
from mam_pipeline.photo.options import PhotoOptions
from mam_pipeline.photo.panel import Panel
from mam_pipeline.photo.quad import aspect_of_quad

Array = NDArray[np.float64]
Window = tuple[int, int, int, int]  # x0, y0, x1, y1 in small pixels
ROOM = 0.08  # of the side of what the user points at: around it more of the photo is looked at
LEAST_WINDOW = 400  # pixels
NEAR = 1.0
"""Corners lie at most so many widths or heights of the photo outside it."""
SEEN_SHARE = 0.06  # of the visible area: a depth seen more obliquely is not seen
HELD = 0.03  # rise of the cost with a wrong depth from which the depth counts as measured
THIN = 0.03  # of the photo's side: thinner slivers make no texture
LEAST_LEGS, DEEPEST_LEGS = 0.04, 1.0  # of the body's height
SLENDER, GONE = 0.5, 0.02  # of a row below the body that is covered where legs are, and below them


@dataclass(frozen=True)
class Found:
    """Everything that was found in one photo, in its small pixels.

    Attributes:
        picture: (width, height) of the photo.
        quad: (4, 2) front corners TL, TR, BR, BL of the body without legs.
        front_given: whether somebody says the front, a person or a language model.
        shape: (width, depth, height) of the body in an arbitrary unit.
        legs: height of the legs over the body's height.
        side_share: share of the visible area that is not the front.
        depth_hold: how firmly the picture holds the depth (cuboid.hold_of_length).
        cost: of the fitted box; 0 where the user gave the front.
        doubt: how far off the network takes the front's corners to be, over the front's mean
            side; 0 where the user gave the front.
        scale: small pixels per pixel of the file.
    """

    picture: tuple[int, int]
    quad: Array
    shape: tuple[float, float, float]
    reading: FrontReading
    cost: float
    side_share: float
    faces: list[Array] = field(default_factory=list)
    other_faces: tuple[tuple[str, Array], ...] = ()
    legs: float = 0.0
    front_given: bool = False
    depth_hold: float = 0.0
    doubt: float = 0.0
    scale: float = 1.0

    @property
    def depth_from(self) -> str:
        """observed; inferred where a side is seen that does not tell how deep it is; assumed."""
        if self.side_share < SEEN_SHARE:
            return "assumed"
        return "observed" if self.depth_hold >= HELD else "inferred"


def check_near(photo: Photo, corners: Sequence[float]) -> None:
    """Raise ConfigError for corners x, y, x, y ... in pixels of the file that lie far from it."""
    size = [v / photo.scale for v in photo.size]
    for k, value in enumerate(corners):
        side = size[k % 2]
        if not -NEAR * side <= value <= (1 + NEAR) * side:
            where = f"{size[0]:.0f} x {size[1]:.0f}"
            raise ConfigError(f"a corner lies at {value:.4g}, far from the photo ({where})")


def find_object(photo: Photo, options: PhotoOptions, looks: Looks | None = None) -> Found:
    """Box, front and what is on it; `options` in pixels of the file are scaled here.

    Args:
        looks: what the photo looks like: what it may be decides which panels are likely.

    Raises:
        ConfigError: corners of the front that lie far from the photo.
    """
    if options.hints is not None and options.hints.photo_front:
        check_near(photo, options.hints.photo_front)
        return found_in_hints(photo, options.hints)
    if options.front is None:
        return _in_box(photo, options, looks)
    check_near(photo, [v for corner in options.front for v in corner])
    found = _in_box(photo, options, looks)
    printed = np.round(
        found.quad / photo.scale
    )  # in whole pixels, as the line that is offered has it
    if np.array_equal(printed, np.round(options.front)):  # what was found is confirmed
        return replace(found, front_given=True, doubt=0.0)
    return _from_front(photo, options, looks)


def _in_box(photo: Photo, options: PhotoOptions, looks: Looks | None) -> Found:
    told = told_mask(photo, options.mask)
    window = _window(photo, options, told)
    maps = look_at_photo(cut(photo.small, window))
    evidence = evidence_of(photo, maps, window)
    cuboid = fit_cuboid(evidence)
    quad = cuboid.quad("front")
    w, d, h = cuboid.extents
    reading = _read(photo, quad, w / h, options, looks)
    others = [(f, cuboid.quad(f)) for f in cuboid.visible if f not in ("front", "bottom")]
    return Found(
        photo.size, quad, (w, d, h), reading, cuboid.cost, side_share(cuboid, "front"),
        [cuboid.quad(f) for f in cuboid.visible],
        tuple((f, q) for f, q in others if _thickness(q) > THIN * max(photo.size)),
        legs_below(photo, told, quad),
        depth_hold=hold_of_length(evidence, cuboid, 2),
        doubt=doubt_of(maps, quad), scale=photo.scale,
    )  # fmt: skip


def _read(
    photo: Photo, quad: Array, ratio: float, options: PhotoOptions, looks: Looks | None
) -> FrontReading:
    """What is on a front (its quad in small pixels, `ratio` width over height)."""
    image = rectify(photo, quad, ratio)
    boxes = flattened(np.array(options.handles).reshape(-1, 4) * photo.scale, quad, image)
    handles = Told(tuple(boxes), options.sure("handles"))
    sure = options.sure("layout")
    kinds = front_kinds(things_of(looks, options, ratio))
    return read_front(image, options.layout, options.category, kinds, sure, handles)


def flattened(boxes: Array, quad: Array, image: NDArray[np.uint8]) -> list[Box]:
    """Boxes (n, 4) on the photo, small pixels, as upright ones in pixels of a front's picture.

    Args:
        quad: (4, 2) of the front, small pixels. image: the rectified front.
    """
    flat = quad_homography(quad, image.shape[1], image.shape[0])
    out = []
    for x0, y0, x1, y1 in boxes:
        on = apply_homography(flat, [(x0, y0), (x1, y0), (x1, y1), (x0, y1)])
        (a, b), (c, d) = on.min(axis=0).tolist(), on.max(axis=0).tolist()
        out.append((a, b, c, d))
    return out


def doubt_of(maps: BoxMaps, quad: Array | None = None) -> float:
    """How far off the network takes the front's corners to be, over the front's mean side.

    Args:
        quad: (4, 2) of the front; the network's own without it.
    """
    front = list(FACES["front"])
    side = np.sqrt(max(quad_area(maps.corners[front] if quad is None else quad), 1.0))
    return float(maps.spread[front].mean() / side)


def around(corners: Array, size: tuple[int, int]) -> Window:
    """The window around points (n, 2), with some room, within a picture of (width, height)."""
    low, high = corners.min(axis=0), corners.max(axis=0)
    room = ROOM * (high - low)
    x0, y0 = np.floor(np.clip(low - room, 0, size)).astype(int)
    x1, y1 = np.ceil(np.clip(high + room, 0, size)).astype(int)
    return int(x0), int(y0), int(x1), int(y1)


def _window(photo: Photo, options: PhotoOptions, told: Array | None) -> Window:
    """What of the photo is looked at: all, or what the user points at with some room.

    Raises:
        ConfigError: it lies outside the photo or is tiny.
    """
    width, height = photo.size
    if options.bbox is not None:
        low, high = np.array(options.bbox).reshape(2, 2) * photo.scale
    elif told is not None:
        ys, xs = np.nonzero(told > 0.5)
        low, high = np.array([xs.min(), ys.min()]), np.array([xs.max(), ys.max()]) + 1.0
    else:
        return 0, 0, width, height
    inside = np.clip(high, 0, [width, height]) - np.clip(low, 0, [width, height])
    if inside.min() <= 0 or inside.prod() < LEAST_WINDOW:
        raise ConfigError("the bounding box lies outside the picture or is tiny")
    return around(np.stack([low, high]), photo.size)


def cut(image: NDArray[np.uint8], window: Window) -> NDArray[np.uint8]:
    """The part of a picture that a window shows."""
    x0, y0, x1, y1 = window
    return np.ascontiguousarray(image[y0:y1, x0:x1])


def evidence_of(photo: Photo, maps: BoxMaps, window: Window) -> Evidence:
    """What the box is fitted to: the network's view of a window, and the lines on the object."""
    x0, y0, x1, y1 = window
    width, height = photo.size
    body = cv2.resize(1 - maps.seen[0] - maps.seen[SEEN.index("opened")], (x1 - x0, y1 - y0))
    outline = np.zeros((height, width))
    outline[y0:y1, x0:x1] = body > min(0.5, float(body.max()) * 0.9)
    lines = find_segments(photo.small)
    on = on_mask(lines, outline)
    segments = Segments(lines.ends[on], lines.length[on])
    corners = maps.corners + np.array([x0, y0])
    maps_of_lines = edge_maps(segments, photo.size)
    return Evidence(outline, corners, maps.spread, segments, maps_of_lines, photo.focal)


def found_in_hints(photo: Photo, hints: Hints) -> Found:
    """What a person marked on the photo: corners, panels with kinds and handles, in metres.

    Raises:
        ConfigError: the hints lack the body's box.
    """
    body = next((p for p in hints.parts if p.kind == "body" and p.box is not None), None)
    if body is None or body.box is None:
        raise ConfigError("hints with photo_front need a part of kind body with a box (metres)")
    d, w, h = body.box.size
    base = body.box.center[2] - h / 2
    quad = np.array(hints.photo_front).reshape(4, 2) * photo.scale
    image = rectify(photo, quad, w / h)
    k = image.shape[0] / h

    def rect(box: HintBox) -> tuple[float, float, float, float]:
        _, y, z = box.center
        _, sy, sz = box.size
        s, t = w / 2 - y, base + h - z  # from the left edge, from the top
        return (s - sy / 2) * k, (t - sz / 2) * k, (s + sy / 2) * k, (t + sz / 2) * k

    panels = []
    for part in hints.parts:
        if part.kind not in ("drawer", "door", "open", "fixed") or part.box is None:
            continue
        side = part.joint.hinge_side if part.joint is not None else None
        handles = () if part.handle is None else (Blob(rect(part.handle), 1.0, "user"),)
        side = (side or "left") if part.kind == "door" else None
        panels.append(Panel(rect(part.box), part.kind, side, handles, 1.0, 1.0, "user"))
    reading = FrontReading(image, tuple(virtual_grasp(p) for p in panels), 1.0)
    return Found(
        photo.size, quad, (w, d, h), reading, 0.0, 1.0, [quad], legs=base / h, front_given=True
    )  # fmt: skip


def _thickness(quad: Array) -> float:
    """Area over longest side, pixels."""
    return quad_area(quad) / float(np.linalg.norm(np.roll(quad, -1, axis=0) - quad, axis=1).max())


def legs_below(photo: Photo, told: Array | None, quad: Array) -> float:
    """Height of the legs over the body's, where a mask or a plain backdrop shows them; else 0.

    Legs cover little of the rows below the front, in the front's plane; their end is where nothing
    is covered. What covers most of these rows is a plinth or a shadow.
    """
    mask = told if told is not None else plain_backdrop(photo.small)
    if mask is None:
        return 0.0
    rows, columns = 200, 100
    matrix = quad_homography(quad, columns, rows)
    deep = round(rows * (1 + DEEPEST_LEGS))
    clean = cv2.morphologyEx(mask.astype(np.float32), cv2.MORPH_OPEN, np.ones((5, 5), np.uint8))
    flat = cv2.warpPerspective(clean, matrix, (columns, deep))
    cover = flat[rows:].mean(axis=1)
    gone = np.flatnonzero(cover < GONE)
    end = int(gone[0]) if len(gone) else 0
    legs = end / rows
    slender = end > 0 and float(np.median(cover[:end])) < SLENDER
    return legs if legs > LEAST_LEGS and slender else 0.0


def _from_front(photo: Photo, options: PhotoOptions, looks: Looks | None) -> Found:
    quad = np.array(options.front) * photo.scale
    ratio = aspect_of_quad(quad, photo.size)
    if options.width and options.height:
        ratio = options.width / options.height
    reading = _read(photo, quad, ratio, options, looks)
    return Found(
        photo.size, quad, (ratio, 0.6, 1.0), reading, 0.0, 0.0, [quad], front_given=True
    )  # fmt: skip


def sizes_of(found: Found, options: PhotoOptions, looks: Looks | None = None) -> Sizes:
    """Metric sizes; what is unknown is as usual for what the photo looks like."""
    w, d, h = found.shape
    if options.hints is not None and options.hints.photo_front:
        return Sizes(w, d, h, "user", "user", options.category or "cabinet")
    if options.category is not None:
        categories = {options.category: 1.0}
    else:
        categories = {} if looks is None else looks.categories()
    kinds = [p.kind for p in found.reading.panels]
    return settle_sizes(
        found.shape, found.depth_from, categories or FURNITURE, options, found.legs, kinds
    )
