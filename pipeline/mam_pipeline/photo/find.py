"""Find the object in a photo: mask, box, which face is the front, and what is on it."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from mam_pipeline.errors import ConfigError
from mam_pipeline.hints import HintBox, Hints
from mam_pipeline.photo.camera import apply_homography, quad_homography
from mam_pipeline.photo.complete import virtual_grasp
from mam_pipeline.photo.cuboid import (
    WEAK_MASK,
    Cuboid,
    Evidence,
    fit_cuboids,
    hold_of_length,
)  # fmt: skip
from mam_pipeline.photo.front import FrontReading, read_front
from mam_pipeline.photo.handles import Blob
from mam_pipeline.photo.image import Photo
from mam_pipeline.photo.lines import Segments, edge_maps, find_segments, on_mask
from mam_pipeline.photo.mask import ObjectMask, find_masks
from mam_pipeline.photo.measure import quad_area, rectify, side_share
from mam_pipeline.photo.options import PhotoOptions
from mam_pipeline.photo.panel import Panel
from mam_pipeline.photo.quad import aspect_of_quad

Array = NDArray[np.float64]
NO_BOX_COST = 0.95
WHOLE = "whole picture"
LINES = "lines alone"
LINES_COST = 0.12  # handicap of a box that no mask supports
LINES_NEED = 0.3  # cost of the best masked box from which lines alone are tried too
LINES_MOST = 0.42  # worse ones, before the handicap, follow the clutter: measured, never right
OPEN_SHARE = 0.15
OPEN_COST = 0.3
NEAR_COST = 0.3  # boxes this much worse than the best are read too
HANDLE_GAIN = 0.05  # cost that each panel with a handle makes up for
SURE_COST = 0.22  # no other mask needs to be tried
SEEN_SHARE = 0.06  # of the visible area: a depth seen more obliquely is not seen
HELD = 0.03  # rise of the cost with a wrong depth from which the depth counts as measured


class Fit(NamedTuple):
    """A box, the mask it was fitted to, and all that it was fitted to."""

    cuboid: Cuboid
    mask: ObjectMask
    evidence: Evidence

    @property
    def value(self) -> float:
        """Cost with the handicap of a mask that is the whole picture."""
        return self.cuboid.cost + _whole_cost(self.mask)


@dataclass(frozen=True)
class Found:
    """Everything that was found in one photo, in its small pixels.

    Attributes:
        quad: (4, 2) front corners TL, TR, BR, BL of the body without legs.
        shape: (width, depth, height) of the body in an arbitrary unit.
        legs: height of the legs over the body's height.
        side_share: share of the visible area that is not the front.
        depth_hold: how firmly the picture holds the depth (cuboid.hold_of_length).
        cost: of the fitted box; 0 where the user gave the front.
        margin: by how much the next-best, different box is worse; 0.5 where there is none.
        face: which face of the fitted box is the front: front, left or right.
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
    margin: float = 0.5
    depth_hold: float = 0.0
    face: str = "front"

    @property
    def depth_from(self) -> str:
        """observed; inferred where a side is seen that does not tell how deep it is; assumed."""
        if self.front_given or self.side_share < SEEN_SHARE:
            return "assumed"
        return "observed" if self.depth_hold >= HELD else "inferred"


def find_object(photo: Photo, options: PhotoOptions) -> Found:
    """Run mask, segments, box and front; `options` in pixels of the file are scaled here."""
    if options.hints is not None and options.hints.photo_front:
        return found_in_hints(photo, options.hints)
    if options.front is not None:
        box = None if options.bbox is None else _scaled(options.bbox, photo.scale)
        return _from_front(photo, find_masks(photo, options.mask, box)[0], options)
    return _best_object(photo, fit_photo(photo, options), options)


def found_in_hints(photo: Photo, hints: Hints) -> Found:
    """What a person marked on the photo: corners, panels with kinds and handles, in metres.

    Raises:
        ConfigError: the hints lack the body's box.
    """
    body = next((p for p in hints.parts if p.kind == "body" and p.box is not None), None)
    if body is None or body.box is None:
        raise ConfigError("annotated hints need a part of kind body with a box (metres)")
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
    mask = ObjectMask(np.ones(photo.small.shape[:2]), "user", 1.0)
    reading = FrontReading(image, tuple(virtual_grasp(p) for p in panels), 1.0)
    return Found(
        mask, quad, (w, d, h), reading, 0.0, 1.0, [quad], legs=base / h, front_given=True
    )  # fmt: skip


def _scaled(values: tuple[float, ...], scale: float) -> tuple[float, ...]:
    return tuple(v * scale for v in values)


def fit_photo(photo: Photo, options: PhotoOptions) -> list[Fit]:
    """Boxes fitted to every mask of the photo, best first."""
    box = None if options.bbox is None else _scaled(options.bbox, photo.scale)
    lines = find_segments(photo.small)
    fits: list[Fit] = []
    for mask in find_masks(photo, options.mask, box):
        on = on_mask(lines, mask.mask)
        segments = Segments(lines.ends[on], lines.length[on])
        weight = 1.0 if mask.trust > 0.5 else WEAK_MASK
        maps = edge_maps(segments, photo.size)
        evidence = Evidence(mask.mask, weight, lines, on.astype(float), maps, photo.focal)
        fits += [Fit(c, mask, evidence) for c in fit_cuboids(evidence, keep=2)]
        if min(f.cuboid.cost for f in fits) < SURE_COST:
            break
    unsure = min(f.cuboid.cost for f in fits) > LINES_NEED
    if box is None and fits[0].mask.trust < 1.0 and unsure:
        fits += _fit_lines(photo, lines)
    return sorted(fits, key=lambda f: f.value)


def _fit_lines(photo: Photo, lines: Segments) -> list[Fit]:
    """Boxes that the lines alone suggest: where an object fills the picture, masks mislead."""
    everywhere = np.ones(photo.small.shape[:2])
    maps = edge_maps(lines, photo.size)
    evidence = Evidence(everywhere, 0.0, lines, np.ones(len(lines.length)), maps, photo.focal)
    mask = ObjectMask(everywhere, LINES, 0.3)
    good = [c for c in fit_cuboids(evidence, keep=2) if c.own < LINES_MOST]
    return [Fit(replace(c, cost=c.own + LINES_COST), mask, evidence) for c in good]


def _best_object(photo: Photo, fits: list[Fit], options: PhotoOptions) -> Found:
    """Of the best distinct boxes, the one whose front shows most panels with handles.

    Part of an object often fits as well as the whole; the whole explains more handles.
    """
    limit = fits[0].value + NEAR_COST
    chosen: list[Fit] = []
    for fit in fits:
        other = all(_hull_iou(fit.cuboid, c.cuboid) < 0.9 for c in chosen)
        if fit.value < limit and other and len(chosen) < 3:
            chosen.append(fit)
    ranked: list[tuple[float, int, Found]] = []
    for i, fit in enumerate(chosen):
        found = _best_front(photo, fit.mask, fit.cuboid, options)
        shown = [p for p in found.reading.movable if any(b.score > 0.6 for b in p.handles)]
        larger = any(_encloses(fit.cuboid, c.cuboid) for c in chosen) and fit.mask.method != WHOLE
        value = fit.value - HANDLE_GAIN * min(len(shown), 9) - 0.1 * larger
        ranked.append((value, i, found))
    ranked.sort(key=lambda x: x[:2])
    value, i, found = ranked[0]
    margin = 0.5 if len(ranked) < 2 else ranked[1][0] - value
    depth = 2 if found.face == "front" else 0
    hold = hold_of_length(chosen[i].evidence, chosen[i].cuboid, depth)
    return replace(found, margin=min(margin, 0.5), depth_hold=hold)


def _hull_iou(a: Cuboid, b: Cuboid) -> float:
    p, q = (cv2.convexHull(c.corners.astype(np.float32)) for c in (a, b))
    common = float(cv2.intersectConvexConvex(p, q)[0])
    return common / max(cv2.contourArea(p) + cv2.contourArea(q) - common, 1.0)


def _whole_cost(mask: ObjectMask) -> float:
    """Handicap of the whole picture as a mask: any box that fills the picture fits it."""
    return 0.08 if mask.method == WHOLE else 0.0


def _encloses(outer: Cuboid, inner: Cuboid, factor: float = 1.5) -> bool:
    """Whether one box's outline is over `factor` times the other's and contains 9/10 of it."""
    a = cv2.convexHull(outer.corners.astype(np.float32))
    b = cv2.convexHull(inner.corners.astype(np.float32))
    big, small = cv2.contourArea(a), cv2.contourArea(b)
    return big > factor * small and cv2.intersectConvexConvex(a, b)[0] > 0.9 * small


def _best_front(photo: Photo, mask: ObjectMask, cuboid: Cuboid, options: PhotoOptions) -> Found:
    """Read every visible upright face of a box and keep the one that looks like a front."""
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
    quad, h, legs = _without_legs(mask, cuboid.quad(face), h)
    image = rectify(photo, quad, w / h)
    reading = read_front(image, options.layout, options.category)
    others = [(f, cuboid.quad(f)) for f in cuboid.visible if f not in (face, "bottom")]
    turn = {"front": {}, "right": {"front": "left"}, "left": {"front": "right"}}[face]
    renamed = tuple((turn.get(f, f), q) for f, q in others if face == "front" or f != "top")
    bulge = _outside_share(mask, cuboid)
    return Found(
        mask, quad, (w, d, h), reading, cuboid.cost, side_share(cuboid, face),
        [cuboid.quad(f) for f in cuboid.visible],
        tuple((f, q) for f, q in renamed if _thickness(q) > 0.03 * max(photo.size)), legs,
        not_a_box=cuboid.cost > NO_BOX_COST,
        open_object=bulge > OPEN_SHARE and cuboid.cost > OPEN_COST,
        why=f"{bulge:.0%} of it lies outside the box" if bulge > OPEN_SHARE
        else f"the best box explains it badly, cost {cuboid.cost:.2f}",
        face=face,
    )  # fmt: skip


def _thickness(quad: Array) -> float:
    """Area over longest side, pixels: slivers make no texture."""
    return quad_area(quad) / float(np.linalg.norm(np.roll(quad, -1, axis=0) - quad, axis=1).max())


def _without_legs(mask: ObjectMask, quad: Array, height: float) -> tuple[Array, float, float]:
    """Cut legs off a front: (quad, body height, legs over body height).

    Legs are rows at the bottom of the rectified front that the mask covers by less than 60 %.
    """
    if mask.method in (WHOLE, LINES):
        return quad, height, 0.0
    rows, columns = 200, 160
    flat = cv2.warpPerspective(
        mask.mask.astype(np.float32), quad_homography(quad, columns, rows), (columns, rows)
    )
    cover = flat.mean(axis=1)
    if np.median(cover) < 0.75:
        return quad, height, 0.0
    solid = np.flatnonzero(cover > 0.6)
    cut = (rows - 1 - int(solid.max())) / rows if len(solid) else 0.0
    if not 0.04 < cut < 0.5:
        return quad, height, 0.0
    back = np.linalg.inv(quad_homography(quad, 1.0, 1.0))
    low = apply_homography(back, np.array([[1.0, 1 - cut], [0.0, 1 - cut]]))
    return np.vstack([quad[:2], low]), height * (1 - cut), cut / (1 - cut)


def _outside_share(mask: ObjectMask, cuboid: Cuboid) -> float:
    """Share of the mask in one compact blob outside the box: an open door or a pulled drawer."""
    if mask.method in (WHOLE, LINES, "grabcut"):
        return 0.0
    h, w = mask.mask.shape
    hull = cv2.convexHull(np.clip(cuboid.corners, -4000, 4000).astype(np.int32))
    box = np.zeros((h, w), np.uint8)
    cv2.fillConvexPoly(box, hull, 1)
    rest = ((mask.mask > 0.5) & (box == 0)).astype(np.uint8)
    n = max(5, round(0.03 * max(h, w)))
    rest = cv2.morphologyEx(rest, cv2.MORPH_OPEN, np.ones((n, n), np.uint8))
    count, _, stats, _ = cv2.connectedComponentsWithStats(rest)
    largest = int(stats[1:, cv2.CC_STAT_AREA].max()) if count > 1 else 0
    return largest / max(float((mask.mask > 0.5).sum()), 1.0)


def _from_front(photo: Photo, mask: ObjectMask, options: PhotoOptions) -> Found:
    quad = np.array(options.front) * photo.scale
    ratio = aspect_of_quad(quad, photo.size)
    if options.width and options.height:
        ratio = options.width / options.height
    image = rectify(photo, quad, ratio)
    reading = read_front(image, options.layout, options.category)
    return Found(
        mask, quad, (ratio, 0.6, 1.0), reading, 0.0, 0.0, [quad], front_given=True
    )  # fmt: skip
