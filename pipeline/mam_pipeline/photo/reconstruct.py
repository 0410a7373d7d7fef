"""The embedded reconstructor: a photo of a closed box-like object to a textured mesh of parts."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from importlib import resources
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mam_pipeline.backends import Availability, Reconstruction
from mam_pipeline.errors import HintNeeded, NotThisKind
from mam_pipeline.photo import confidence
from mam_pipeline.photo.build import BodySpec, CellSpec, HandleSpec, build_object
from mam_pipeline.photo.find import Found, find_object
from mam_pipeline.photo.front import FrontReading
from mam_pipeline.photo.image import Photo, read_photo
from mam_pipeline.photo.measure import (
    TEXTURE_SIDE,
    Sizes,
    guess_category,
    jpeg,
    rectify,
    settle_sizes,
)  # fmt: skip
from mam_pipeline.photo.options import PhotoOptions, parse_options
from mam_pipeline.photo.overlay import draw_front, draw_overlay
from mam_pipeline.photo.panel import Panel

Array = NDArray[np.float64]
VERSION = "1"


@dataclass(frozen=True)
class Judgement:
    """Confidence words for cuboid, panels, handles, scale, and the hint that would help most."""

    words: Mapping[str, str]
    hint: str


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
            HintNeeded: confidence is low and `accept_low_confidence` is not set; carries
                `pictures` (overlay, front) for the caller to save.
            NotThisKind: nothing in the picture looks like a closed box; carries `pictures`.
        """
        settings = parse_options(options)
        picture = read_photo(Path(photo))
        return reconstruct_photo(picture, settings, Path(photo).name)


def reconstruct_photo(
    photo: Photo, options: PhotoOptions | None = None, name: str = "photo"
) -> Reconstruction:
    """Reconstruct from a decoded photo; see `EmbeddedReconstructor.reconstruct`."""
    options = options or PhotoOptions()
    cv2.setNumThreads(1)
    found = find_object(photo, options)
    judged = judge(found, options)
    pictures = {
        "overlay": draw_overlay(photo, found.faces, found.quad, found.reading),
        "front": draw_front(found.reading),
    }
    _stop_if_unsure(found, judged, options, name, pictures)
    sizes, category = sizes_of(found, options)
    mesh, hints = build_object(body_of(photo, found, sizes))
    corners = tuple(float(v) for v in (found.quad / photo.scale).round(2).reshape(-1))
    hints = replace(hints, photo_front=corners)
    assumed = tuple(
        n for n, source in (("depth", sizes.depth_from), ("scale", sizes.scale_from))
        if source == "assumed"
    )  # fmt: skip
    details = {
        "mask": found.mask.method, "category": category, "depth": sizes.depth_from,
        "scale": sizes.scale_from, "size": (sizes.width, sizes.depth, sizes.height),
        "legs": found.legs, "cost": found.cost, "hint": judged.hint,
        "front_quad": (np.asarray(found.quad) / photo.scale).round(1).tolist(),
        "panels": [_panel_row(p, found.reading) for p in found.reading.panels],
    }  # fmt: skip
    pictures["a_photo"] = photo.small
    return Reconstruction(
        mesh, hints, judged.words, summarise(found.reading, sizes), assumed, pictures, details
    )


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


def sizes_of(found: Found, options: PhotoOptions) -> tuple[Sizes, str]:
    """Metric sizes and the category whose usual size fills what is unknown."""
    w, d, h = found.shape
    if options.hints is not None and options.hints.photo_front:
        return Sizes(w, d, h, "user", "user"), options.category or "cabinet"
    kinds = [p.kind for p in found.reading.panels]
    category = guess_category(w, h * (1 + found.legs), kinds, options.category)
    return settle_sizes((w, d, h), found.depth_from, category, options, found.legs), category


def body_of(photo: Photo, found: Found, sizes: Sizes) -> BodySpec:
    """What to build, in metres: cells from the reading, textures from the visible faces."""
    reading = found.reading
    h, w = reading.image.shape[:2]
    kx, ky = sizes.width / w, sizes.height / h
    numbers: dict[str, int] = {}
    cells = []
    for panel in reading.panels:
        n = numbers.get(panel.kind, 0)
        numbers[panel.kind] = n + 1

        def metric(b: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
            return b[0] * kx, (h - b[3]) * ky, b[2] * kx, (h - b[1]) * ky

        handles = tuple(
            HandleSpec(metric(x.box), x.provenance != "assumed", x.provenance)
            for x in panel.handles
        )
        cells.append(
            CellSpec(
                f"{panel.kind}_{n}", panel.kind, metric(panel.box), panel.hinge_side, handles,
                panel.confidence * panel.kind_confidence, panel.provenance,
            )
        )  # fmt: skip
    textures = [("front", jpeg(rectify(photo, found.quad, w / h, TEXTURE_SIDE)))]
    for face, quad in found.other_faces:
        ratio = (
            sizes.depth / sizes.height if face in ("left", "right") else sizes.width / sizes.depth
        )
        textures.append((face, jpeg(rectify(photo, quad, ratio, TEXTURE_SIDE // 2))))
    have = {f for f, _ in textures}
    for face, twin in (("left", "right"), ("right", "left")):
        if face not in have and twin in have:  # the hidden side is assumed to mirror the seen one
            data = dict(textures)[twin]
            image = np.asarray(cv2.imdecode(np.frombuffer(data, np.uint8), 1))
            textures.append((face, jpeg(np.ascontiguousarray(image[:, ::-1, ::-1]))))
    color = np.median(reading.image.reshape(-1, 3), axis=0) / 255.0
    return BodySpec(
        sizes.width, sizes.depth, sizes.height, tuple(cells), found.legs * sizes.height,
        color=(float(color[0]), float(color[1]), float(color[2])), textures=tuple(textures),
    )  # fmt: skip


def judge(found: Found, options: PhotoOptions) -> Judgement:
    """Turn what was found into words; what the user gave is high.

    The words are those fitted by mam_training.photo.fit_confidence; without such a fit, limits set
    by hand. A box that explains the photo badly stays low whatever was fitted: renders hold no
    open doors and no rooms, real photos do.
    """
    by_hand = {
        "cuboid": _word(-found.cost, -0.30, -0.62),
        "panels": _word(found.reading.confidence, 0.8, 0.5),
        "handles": _handle_word(found.reading),
    }
    words = {**by_hand, **confidence.words(found)}
    if by_hand["cuboid"] == "low":
        words["cuboid"] = "low"
    if found.front_given:
        words["cuboid"] = "high"
    if options.layout or options.hints:
        words["panels"] = "high"
    words["scale"] = "high" if options.height or options.width or options.depth else "low"
    hint = "--layout" if words["panels"] == "low" and words["cuboid"] != "low" else "--front"
    if words["cuboid"] == "low" and found.mask.trust < 0.5 and options.bbox is None:
        hint = "--bbox"
    return Judgement(words, hint)


def _word(value: float, high: float, medium: float) -> str:
    return "high" if value >= high else "medium" if value >= medium else "low"


def _handle_word(reading: FrontReading) -> str:
    panels = reading.movable
    seen = [b.score for p in panels for b in p.handles if b.provenance == "observed"]
    if not panels or not seen:
        return "low"
    share = sum(any(b.provenance == "observed" for b in p.handles) for p in panels) / len(panels)
    return _word(share * float(np.mean(seen)), 0.75, 0.4)


EXAMPLES = {
    "--bbox": "--bbox x0,y0,x1,y1 (pixels around the object)",
    "--front": "--front x,y,x,y,x,y,x,y (corners of its front: top left, top right, bottom right, "
    "bottom left), or mark them with: mam-sim annotate",
    "--layout": '--layout "2 drawers / 2 doors"',
}


def _stop_if_unsure(
    found: Found, judged: Judgement, options: PhotoOptions, name: str, pictures: dict[str, Any]
) -> None:
    error: HintNeeded | NotThisKind | None = None
    if found.not_a_box and not (options.front or options.accept_low_confidence):
        error = NotThisKind(
            f"{name} does not look like a closed, box-like object ({found.why}); "
            f"if it is one, add {EXAMPLES['--front']}"
        )
    elif options.accept_low_confidence:
        return
    elif found.open_object:
        error = HintNeeded(
            f"the object in {name} looks open ({found.why}); photograph it closed, "
            f"or give {EXAMPLES['--front']}"
        )
    elif judged.words["cuboid"] == "low":
        error = HintNeeded(
            f"the box around the object in {name} is uncertain; add {EXAMPLES[judged.hint]}, "
            "or --accept-low-confidence"
        )
    elif not found.reading.movable:
        error = HintNeeded(
            f"no drawer or door was found on the front in {name}; add {EXAMPLES['--layout']}"
        )
    elif judged.words["panels"] == "low":
        error = HintNeeded(
            f"the panels on the front in {name} are uncertain; add {EXAMPLES['--layout']}, "
            "or --accept-low-confidence"
        )
    if error is not None:
        error.pictures = pictures  # type: ignore[union-attr]
        raise error


def summarise(reading: FrontReading, sizes: Sizes) -> str:
    """One line: "found 3 drawers, 3 handles; depth measured; scale ASSUMED 0.72 m high"."""
    counts = []
    for kind in ("drawer", "door", "open"):
        n = sum(p.kind == kind for p in reading.panels)
        word = {"open": "open compartment"}.get(kind, kind)
        if n:
            counts.append(f"{n} {word}{'s' if n > 1 else ''}")
    seen = sum(b.provenance == "observed" for p in reading.movable for b in p.handles)
    more = sum(b.provenance != "observed" for p in reading.movable for b in p.handles)
    handles = f"{seen} handle{'s' if seen != 1 else ''}" + (f" (+{more} inferred)" if more else "")
    depth = {
        "observed": "depth measured", "inferred": "depth INFERRED", "assumed": "depth ASSUMED",
        "user": "depth given",
    }  # fmt: skip
    scale = f"scale {'ASSUMED' if sizes.scale_from == 'assumed' else 'given'}"
    return (
        f"found {', '.join([*(counts or ['no panels']), handles])}; {depth[sizes.depth_from]} "
        f"{sizes.depth:.2f} m; {scale} {sizes.width:.2f} m wide, {sizes.height:.2f} m high"
    )
