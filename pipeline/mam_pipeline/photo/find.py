"""Find the object in a photo: mask, box, which face is the front, and what is on it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.photo.cuboid import WEAK_MASK, Cuboid, Evidence, fit_cuboids
from mam_pipeline.photo.front import FrontReading, read_front
from mam_pipeline.photo.image import Photo
from mam_pipeline.photo.lines import Segments, edge_maps, find_segments
from mam_pipeline.photo.mask import ObjectMask, find_masks
from mam_pipeline.photo.measure import guess_category, quad_area, rectify, side_share
from mam_pipeline.photo.options import PhotoOptions
from mam_pipeline.photo.quad import aspect_of_quad

Array = NDArray[np.float64]
NO_BOX_COST = 0.95
SURE_COST = 0.22  # no other mask needs to be tried


@dataclass(frozen=True)
class Found:
    """Everything that was found in one photo, in its small pixels.

    Attributes:
        quad: (4, 2) front corners TL, TR, BR, BL of the body without legs.
        shape: (width, depth, height) of the body in an arbitrary unit.
        legs: height of the legs over the body's height.
        side_share: share of the visible area that is not the front.
        cost: of the fitted box; 0 where the user gave the front.
    """

    mask: ObjectMask
    quad: Array
    shape: tuple[float, float, float]
    reading: FrontReading
    cost: float
    side_share: float
    faces: list[Array] = field(default_factory=list)
    other_faces: tuple[tuple[str, Array], ...] = ()
    legs: float = 0.0
    front_given: bool = False
    not_a_box: bool = False
    open_object: bool = False
    why: str = ""


def find_object(photo: Photo, options: PhotoOptions) -> Found:
    """Run mask, segments, box and front; `options` in pixels of the file are scaled here."""
    if options.front is not None:
        box = None if options.bbox is None else _scaled(options.bbox, photo.scale)
        return _from_front(photo, find_masks(photo, options.mask, box)[0], options)
    mask, _, cuboids = fit_photo(photo, options)
    return _best_front(photo, mask, cuboids, options)


def _scaled(values: tuple[float, ...], scale: float) -> tuple[float, ...]:
    return tuple(v * scale for v in values)


def fit_photo(photo: Photo, options: PhotoOptions) -> tuple[ObjectMask, Segments, list[Cuboid]]:
    """The mask whose box explains the picture best, its segments, and boxes best first."""
    box = None if options.bbox is None else _scaled(options.bbox, photo.scale)
    masks = find_masks(photo, options.mask, box)
    best: tuple[ObjectMask, Segments, list[Cuboid]] | None = None
    context = find_segments(photo.small, None)
    for mask in masks:
        segments = find_segments(photo.small, mask.mask)
        maps = edge_maps(segments, photo.size)
        weight = 1.0 if mask.trust > 0.5 else WEAK_MASK
        evidence = Evidence(mask.mask, weight, segments, maps, photo.focal, context)
        cuboids = fit_cuboids(evidence, keep=2)
        if best is None or cuboids[0].cost < best[2][0].cost:
            best = mask, segments, cuboids
        if cuboids[0].cost < SURE_COST:
            break
    assert best is not None  # there is always one mask
    return best


def _best_front(
    photo: Photo, mask: ObjectMask, cuboids: list[Cuboid], options: PhotoOptions
) -> Found:
    """Read every visible upright face of the best box and keep the one that looks like a front."""
    cuboid = cuboids[0]
    best: tuple[float, Found] | None = None
    total = sum(quad_area(cuboid.quad(f)) for f in cuboid.visible)
    for face in cuboid.visible:
        if face not in ("front", "left", "right"):
            continue
        area = quad_area(cuboid.quad(face)) / max(total, 1e-9)
        if area < 0.18:
            continue
        found = _read_face(photo, mask, cuboid, face, options)
        panels = found.reading.movable
        handles = sum(any(b.provenance == "observed" for b in p.handles) for p in panels)
        score = 1.2 * area + 0.25 * min(handles, 4) + 0.3 * found.reading.confidence
        if best is None or score > best[0]:
            best = (score, found)
    assert best is not None  # one upright face always covers enough
    return best[1]


def _read_face(
    photo: Photo, mask: ObjectMask, cuboid: Cuboid, face: str, options: PhotoOptions
) -> Found:
    w, d, h = cuboid.extents
    if face != "front":
        w, d = d, w
    quad = cuboid.quad(face)
    image = rectify(photo, quad, w / h)
    category = guess_category(w, h, [], options.category)
    tall = 0.85 if options.height is None else options.height
    reading = read_front(image, options.layout, category, tall / image.shape[0])
    others = [(f, cuboid.quad(f)) for f in cuboid.visible if f != face and f != "bottom"]
    turn = {"front": {}, "right": {"front": "left"}, "left": {"front": "right"}}[face]
    renamed = tuple((turn.get(f, f), q) for f, q in others if face == "front" or f != "top")
    return Found(
        mask, quad, (w, d, h), reading, cuboid.cost, side_share(cuboid, face),
        [cuboid.quad(f) for f in cuboid.visible], renamed,
        not_a_box=cuboid.cost > NO_BOX_COST, why=f"cost {cuboid.cost:.2f}",
    )  # fmt: skip


def _from_front(photo: Photo, mask: ObjectMask, options: PhotoOptions) -> Found:
    quad = np.array(options.front) * photo.scale
    ratio = aspect_of_quad(quad, photo.size)
    if options.width and options.height:
        ratio = options.width / options.height
    image = rectify(photo, quad, ratio)
    reading = read_front(
        image, options.layout, options.category, (options.height or 0.85) / image.shape[0]
    )
    return Found(
        mask, quad, (ratio, 0.6, 1.0), reading, 0.0, 0.0, [quad], front_given=True
    )  # fmt: skip
