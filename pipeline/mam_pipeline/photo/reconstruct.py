"""The embedded reconstructor: a photo of a closed box-like object to a textured mesh of parts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mam_pipeline.backends import Availability, Reconstruction
from mam_pipeline.errors import NotThisKind
from mam_pipeline.photo.build import BodySpec, CellSpec, HandleSpec, build_object
from mam_pipeline.photo.confidence import panel_probability, right_share
from mam_pipeline.photo.find import Found, find_object, sizes_of
from mam_pipeline.photo.front import FrontReading
from mam_pipeline.photo.image import Photo, read_photo
from mam_pipeline.photo.measure import TEXTURE_SIDE, Sizes, jpeg
from mam_pipeline.photo.options import PhotoOptions, parse_options
from mam_pipeline.photo.overlay import draw_front, draw_overlay
from mam_pipeline.photo.panel import Panel
from mam_pipeline.photo.texture import color_of, without, without_background
from mam_pipeline.photo.verdict import (
    Judgement,
    judge,
    opened_in,
    seen_as,
    stop_if_no_box,
    stop_if_out_of_scope,
)  # fmt: skip

Array = NDArray[np.float64]
VERSION = "1"


class EmbeddedReconstructor:
    """Single-view metrology on a CPU: no weights, no network, the photo is the texture."""

    @classmethod
    def available(cls) -> Availability:
        """Always available; OpenCV and SciPy are dependencies of the package."""
        return Availability(True, version=VERSION, licence="Apache-2.0")

    @classmethod
    def weights(cls) -> list[Traversable]:
        """What was learned of handles, and how sure its answers are."""
        return [resources.files("mam_pipeline.photo") / "weights"]

    def reconstruct(self, photo: Path, options: Mapping[str, Any]) -> Reconstruction:
        """Reconstruct the object in a photo.

        Args:
            photo: a picture file.
            options: see `PhotoOptions`; unknown keys are errors.

        Raises:
            InputError: the file is no usable picture.
            ConfigError: an option cannot be used.
            NotThisKind: the photo shows another kind of thing, or nothing in it looks like a
                closed box; carries `pictures` where a box was tried.
        """
        settings = parse_options(options)
        picture = read_photo(Path(photo))
        return reconstruct_photo(picture, settings, str(photo))


def reconstruct_photo(
    photo: Photo, options: PhotoOptions | None = None, name: str = "photo"
) -> Reconstruction:
    """Reconstruct from a decoded photo; see `EmbeddedReconstructor.reconstruct`."""
    options = options or PhotoOptions()
    found, judged, pictures = read_object(photo, options, name)
    sizes = sizes_of(found, options, judged.looks)
    all_right = right_share("panels", judged.words["panels"])
    mesh, hints = build_object(body_of(photo, found, sizes, all_right))
    corners = tuple(float(v) for v in (found.quad / photo.scale).round(2).reshape(-1))
    hints = replace(hints, photo_front=corners)
    assumed = tuple(
        n for n, source in (("depth", sizes.depth_from), ("scale", sizes.scale_from))
        if source == "assumed"
    )  # fmt: skip
    details = {
        "category": sizes.category, "depth": sizes.depth_from,
        "scale": sizes.scale_from, "size": (sizes.width, sizes.depth, sizes.height),
        "scale_spread": round(sizes.spread, 3), "legs": found.legs, "cost": found.cost,
        "doubt": round(found.doubt, 4),
        "looks": {} if judged.looks is None else
        {k: round(p, 3) for k, p in list(judged.looks.kinds.items())[:5]},
        "front_quad": (np.asarray(found.quad) / photo.scale).round(1).tolist(),
        "panels": [_panel_row(p, found.reading) for p in found.reading.panels],
    }  # fmt: skip
    pictures["a_photo"] = photo.small
    return Reconstruction(
        mesh, hints, judged.words, summarise(found.reading, sizes), assumed, pictures, details,
        judged.doubt,
    )  # fmt: skip


def read_object(
    photo: Photo, options: PhotoOptions, name: str = "photo"
) -> tuple[Found, Judgement, dict[str, NDArray[np.uint8]]]:
    """What is on a photo, how sure that is, and pictures of it: overlay and front.

    Raises:
        NotThisKind: see `EmbeddedReconstructor.reconstruct`.
    """
    cv2.setNumThreads(1)
    looks = seen_as(photo, options)
    stop_if_out_of_scope(looks, options, name)
    found = find_object(photo, options, looks)
    opened = opened_in(photo, options, looks)
    judged = judge(found, options, looks, opened)
    pictures = {
        "overlay": draw_overlay(photo, found.faces, found.quad, found.reading),
        "front": draw_front(found.reading),
    }
    try:
        stop_if_no_box(found, options, name, opened)
    except NotThisKind as error:
        error.pictures = dict(pictures)
        raise
    return found, judged, pictures


def _panel_row(p: Panel, reading: FrontReading) -> dict[str, Any]:
    h, w = reading.image.shape[:2]
    scale = np.array([w, h, w, h], float)
    return {
        "kind": p.kind, "rect": (np.array(p.box) / scale).round(4).tolist(),
        "hinge_side": p.hinge_side, "confidence": round(p.confidence, 3),
        "handles": [
            {"rect": (np.array(b.box) / scale).round(4).tolist(), "provenance": b.provenance}
            for b in p.handles
        ],
    }  # fmt: skip


def body_of(
    photo: Photo, found: Found, sizes: Sizes, all_right: float = 1.0, digits: int = 4
) -> BodySpec:
    """What to build, in metres: cells from the reading, textures from the visible faces.

    Other processors and numbers of threads give other last digits, and of twin drawers these would
    decide which one gets the lower number.

    Args:
        all_right: how often all panels of such a front are right. digits: of a metre that are
            kept.
    """
    reading = found.reading
    h, w = reading.image.shape[:2]
    kx, ky = sizes.width / w, sizes.height / h
    numbers: dict[str, int] = {}
    cells = []
    for panel in reading.panels:
        n = numbers.get(panel.kind, 0)
        numbers[panel.kind] = n + 1

        def metric(b: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
            x0, y0, x1, y1 = (
                round(v, digits) for v in (b[0] * kx, (h - b[3]) * ky, b[2] * kx, (h - b[1]) * ky)
            )
            return x0, y0, x1, y1

        handles = tuple(
            HandleSpec(
                metric(x.box), x.provenance != "assumed", x.provenance,
                color_of(reading.image, x.box),
            )
            for x in panel.handles
        )  # fmt: skip
        cells.append(
            CellSpec(
                f"{panel.kind}_{n}", panel.kind, metric(panel.box), panel.hinge_side, handles,
                panel_probability(panel, all_right, len(reading.movable)), panel.provenance,
            )
        )  # fmt: skip
    others = {face for face, _ in found.other_faces}
    front = without_background(photo, found.quad, w / h, TEXTURE_SIDE, others)
    modelled = [
        (b.box[0] / w, b.box[1] / h, b.box[2] / w, b.box[3] / h)
        for p in reading.panels for b in p.handles if b.provenance != "assumed"
    ]  # fmt: skip
    textures = [("front", jpeg(without(front, modelled)))]
    for face, quad in found.other_faces:
        ratio = (
            sizes.depth / sizes.height if face in ("left", "right") else sizes.width / sizes.depth
        )
        joined = {{"left": "right", "right": "left", "top": "bottom"}[face], *others - {face}}
        textures.append(
            (face, jpeg(without_background(photo, quad, ratio, TEXTURE_SIDE // 2, joined)))
        )
    have = {f for f, _ in textures}
    for face, twin in (("left", "right"), ("right", "left")):
        if face not in have and twin in have:  # the hidden side is assumed to mirror the seen one
            data = dict(textures)[twin]
            image = np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), 1))
            textures.append((face, jpeg(np.ascontiguousarray(image[:, ::-1, ::-1]))))
    color = np.median(reading.image.reshape(-1, 3), axis=0) / 255.0
    width, depth, height, legs = (
        round(v, digits)
        for v in (sizes.width, sizes.depth, sizes.height, found.legs * sizes.height)
    )
    return BodySpec(
        width, depth, height, tuple(cells), legs,
        color=(float(color[0]), float(color[1]), float(color[2])), textures=tuple(textures),
    )  # fmt: skip


def summarise(reading: FrontReading, sizes: Sizes) -> str:
    """One line: what was found, how large its body is, and who says so of depth and scale."""
    counts = []
    for kind in ("drawer", "door", "open"):
        n = sum(p.kind == kind for p in reading.panels)
        word = {"open": "open compartment"}.get(kind, kind)
        if n:
            counts.append(f"{n} {word}{'s' if n > 1 else ''}")
    seen = sum(b.provenance == "observed" for p in reading.movable for b in p.handles)
    more = sum(b.provenance != "observed" for p in reading.movable for b in p.handles)
    handles = f"{seen} handle{'s' if seen != 1 else ''}" + (f" (+{more} assumed)" if more else "")
    depth = {
        "observed": "inferred from the photo", "user": "said by you",
        "assumed": "assumed: as usual",
        "inferred": "assumed: between that of the photo and the usual one",
    }  # fmt: skip
    scale = "said by you"
    if sizes.scale_from == "assumed":
        usual, off = sizes.category.replace("_", " "), f"{100 * np.expm1(sizes.spread):.0f} %"
        scale = f"assumed: that of a usual {usual}, give or take {off}"
    return (
        f"found {', '.join([*(counts or ['no panels']), handles])}; body {sizes.width:.2f} m wide, "
        f"{sizes.height:.2f} m high, {sizes.depth:.2f} m deep; depth {depth[sizes.depth_from]}; "
        f"scale {scale}"
    )
