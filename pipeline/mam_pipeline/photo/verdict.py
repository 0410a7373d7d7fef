"""Whether a reading of a photo is to be believed, and the one step that helps where it is not."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.errors import HintNeeded, NotThisKind
from mam_pipeline.photo import confidence
from mam_pipeline.photo.agreement import agreement
from mam_pipeline.photo.box_network import look_at_photo
from mam_pipeline.photo.category import LIKELY, Looks, look
from mam_pipeline.photo.find import Found, around, cut, doubt_of
from mam_pipeline.photo.front import FrontReading
from mam_pipeline.photo.image import Photo
from mam_pipeline.photo.layout import layout_text
from mam_pipeline.photo.options import PhotoOptions

OUT = 0.2  # of the probability that it is in scope: below, nothing is made
SURE = 0.6  # below, the user is asked what it is
BORDER = 0.01  # of the picture's side: nearer to its edge an object is cut off there
TALL = 0.85  # width over height of the doors of a room is less
APPLIANCES = ("refrigerator", "microwave", "oven", "dishwasher", "washing machine", "safe")
NO_BOX = 0.3  # of the front's side: where its corners are more doubtful, there is no box
ORDER = ("low", "medium", "high")


@dataclass(frozen=True)
class Judgement:
    """Confidence words for cuboid, panels, handles, scale, and what the photo looks like."""

    words: Mapping[str, str]
    looks: Looks | None = None


def seen_as(photo: Photo, options: PhotoOptions) -> Looks | None:
    """What the photo, or the user's box in it, looks like.

    None where the user says what it is, or gives a mask: what a thing is cut out of is part of its
    looks.
    """
    if options.category is not None or options.hints is not None or options.mask is not None:
        return None
    picture = photo.small
    if options.bbox is not None:
        x0, y0, x1, y1 = (round(v * photo.scale) for v in options.bbox)
        cut = picture[max(y0, 0) : y1, max(x0, 0) : x1]
        if min(cut.shape[:2]) < 8:  # it lies outside the picture, as the masks will say
            return None
        picture = np.ascontiguousarray(cut)
    looks = look(picture)
    if looks.in_scope >= SURE:
        return looks
    return max(looks, _closer(picture), key=lambda seen: seen.in_scope)


def _closer(picture: NDArray[np.uint8]) -> Looks:
    """What the object in a picture looks like without its surroundings, if its box is clear."""
    maps = look_at_photo(picture)
    height, width = picture.shape[:2]
    x0, y0, x1, y1 = window = around(maps.corners, (width, height))
    clear = confidence.box_evidence(doubt_of(maps)) >= confidence.limits()["cuboid"][1]
    return look(cut(picture, window) if clear and min(x1 - x0, y1 - y0) >= 8 else picture)


def stop_if_out_of_scope(looks: Looks | None, options: PhotoOptions, path: str) -> None:
    """Raise NotThisKind for a photo that shows something else than box furniture."""
    if looks is None or looks.in_scope >= OUT:
        return
    if options.front or options.layout or options.accept_low_confidence:  # the user sees a front
        return
    kind, p = looks.stranger
    if p >= LIKELY:
        said = f"{path} looks like {_a(kind)} ({p:.2f})"
    else:
        said = f"{path} shows no piece of furniture that can be read; it is nearest to {_a(kind)}"
    raise NotThisKind(
        f"{said}: mam-sim reads the closed fronts of cabinets, chests of drawers, wardrobes and "
        "kitchen appliances. Other things it makes from a mesh (mam-sim make-env thing.glb) or "
        "with an image-to-mesh model (--reconstructor; mam-sim doctor lists them). "
        "If there is such a front in the photo, draw a box round it with --bbox x0,y0,x1,y1, "
        "or say what it is, as in --category cabinet"
    )


def _a(kind: str) -> str:
    mass = ("food or plant", "landscape")
    return kind if kind in mass else f"a{'n' if kind[0] in 'aeiou' else ''} {kind}"


def judge(found: Found, options: PhotoOptions, looks: Looks | None = None) -> Judgement:
    """Turn what was found into words; what the user gave is high.

    Panels are never surer than the box that they lie on.
    """
    words = confidence.words(found, read_again(found, options))
    if found.front_given:
        words["cuboid"] = "high"
    if options.layout or options.hints:
        words["panels"] = "high"
    words["panels"] = min(words["panels"], words["cuboid"], key=ORDER.index)
    words["scale"] = "high" if options.height or options.width or options.depth else "low"
    return Judgement(words, looks)


def read_again(found: Found, options: PhotoOptions) -> float:
    """How well the front reads the same again, 0..1; 1 where the user says what is on it."""
    if options.layout or options.hints or not found.reading.movable:
        return 1.0
    return agreement(found.reading, options.category)


def stop_if_unsure(
    found: Found, judged: Judgement, options: PhotoOptions, path: str, scale: float
) -> None:
    """Raise where nothing can be relied on; the message ends with lines that can be typed.

    Args:
        path: of the photo, as the user wrote it. scale: small pixels per pixel of the file.

    Raises:
        HintNeeded, NotThisKind: see `EmbeddedReconstructor.reconstruct`.
    """
    if options.accept_low_confidence:
        return
    looks = judged.looks
    if found.doubt > NO_BOX:
        raise NotThisKind(
            f"{path} does not look like a closed, box-like object (the corners of its front are "
            f"uncertain by {found.doubt:.0%} of its side); if it is one, mark its front:\n"
            f"{_annotate(path)}"
        )
    if looks is not None and looks.in_scope < SURE and not (found.front_given or options.layout):
        few = [f"{_a(k)} ({p:.2f})" for k, p in list(looks.kinds.items())[:2]]
        why = f"what {path} shows is uncertain: {' or '.join(few)}"
    elif may_be_a_room_door(found, options, looks):
        why = f"{path} may show a door of a room or a passage, which has no box behind it"
    elif not found.front_given and fills_the_picture(found):
        why = f"the object in {path} is cut off by the picture's edges on all sides"
    elif judged.words["cuboid"] == "low":
        why = f"the box around the object in {path} is uncertain"
    elif not found.reading.movable:
        why = f"no drawer or door was found on the front in {path}"
    elif judged.words["panels"] == "low":
        why = f"the panels on the front in {path} are uncertain"
    else:
        return
    raise HintNeeded(f"{why}.\n{next_step(found, judged, options, path, scale)}")


def may_be_a_room_door(found: Found, options: PhotoOptions, looks: Looks | None = None) -> bool:
    """One or two doors as high as a tall front whose sides are not seen.

    A door of a room, or a passage in a wall, looks so; an appliance that is known does not count.
    """
    if options.category is not None or options.layout is not None:
        return False
    if looks is not None and sum(looks.kinds.get(kind, 0.0) for kind in APPLIANCES) > 0.5:
        return False
    w, _, h = found.shape
    panels = found.reading.movable
    if w / h > TALL or found.depth_from == "observed" or not 1 <= len(panels) <= 2:
        return False
    height = found.reading.image.shape[0]
    return all(p.kind == "door" and p.box[3] - p.box[1] > 0.7 * height for p in panels)


def fills_the_picture(found: Found) -> bool:
    """Whether the box touches the picture's edge on all four sides."""
    width, height = found.picture
    corners = np.vstack(found.faces)
    edge = BORDER * max(width, height)
    low, high = corners.min(axis=0), corners.max(axis=0)
    return bool((low < edge).all() and high[0] > width - edge and high[1] > height - edge)


def next_step(
    found: Found, judged: Judgement, options: PhotoOptions, path: str, scale: float
) -> str:
    """What was read, the line that says so, to be corrected and typed, and the page to click on."""
    words = ["mam-sim", "make-env", path]
    text = layout_as_read(found.reading)
    lines = [f"Read: {text}." if text else "What was read cannot be said in rows or columns."]
    unsure_box = judged.words["cuboid"] == "low" or fills_the_picture(found)
    if unsure_box and not found.front_given:
        corners = (found.quad / scale).round().astype(int).reshape(-1)
        words += ["--front", ",".join(map(str, corners))]
    doubted = judged.looks is not None and judged.looks.in_scope < SURE
    if doubted or may_be_a_room_door(found, options, judged.looks):
        words += ["--category", "cabinet"]
    if text and not options.layout:
        words += ["--layout", text]
    if text:
        lines += ["Put this right where it is wrong, and type:", f"  {shlex.join(words)}"]
    lines += ["Or put it right by clicks:", _annotate(path)]
    return "\n".join(lines)


def layout_as_read(reading: FrontReading) -> str:
    """The layout of a front as `--layout` takes it; empty where it cannot be said so."""
    height, width = reading.image.shape[:2]
    size = np.array([width, height] * 2)
    return layout_text([(p.kind, np.array(p.box) / size) for p in reading.panels])


def _annotate(path: str) -> str:
    return f"  {shlex.join(['mam-sim', 'annotate', path])}"
