"""Whether a reading of a photo is to be believed, and the one step that helps where it is not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.doubt import Doubt, marking_line
from mam_pipeline.errors import NotThisKind
from mam_pipeline.photo import confidence
from mam_pipeline.photo import opened as opened_in_photos
from mam_pipeline.photo.agreement import agreement
from mam_pipeline.photo.box_network import look_at_photo
from mam_pipeline.photo.category import LIKELY, Looks, look
from mam_pipeline.photo.find import Found, around, cut, doubt_of, sizes_of
from mam_pipeline.photo.front import FrontReading
from mam_pipeline.photo.image import Photo
from mam_pipeline.photo.layout import layout_text
from mam_pipeline.photo.options import PhotoOptions

APPLIANCES = ("refrigerator", "microwave", "oven", "dishwasher", "washing machine", "safe")
ORDER = ("low", "medium", "high", "given")
CLOSED = "If a drawer or door stands open in the photo, close it and take another."
CONTROLS = ("microwave", "oven", "dishwasher", "washing_machine", "fridge")


@dataclass(frozen=True)
class DoubtRules:
    """When a person is asked; chosen on the marked photos.

    Attributes:
        other_face: share of what is seen of the box beside its front from which the front may be
            another face.
        out, sure: probability that it is in scope below which nothing is made, and below which a
            person is asked what it is.
        border: of the picture's side: nearer to its edge an object is cut off there.
        tall: width over height of the doors of a room is less.
        no_box: of the front's side: where its corners are more doubtful, there is no box.
    """

    other_face: float = 0.25
    out: float = 0.2
    sure: float = 0.6
    border: float = 0.01
    tall: float = 0.85
    no_box: float = 0.3


RULES = DoubtRules()


@dataclass(frozen=True)
class Judgement:
    """Confidence words for cuboid, panels, handles, scale, and what the photo looks like.

    `doubt`: why nobody should rely on it as it is; None where one can.
    """

    words: Mapping[str, str]
    looks: Looks | None = None
    doubt: Doubt | None = None


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
    if looks.in_scope >= RULES.sure:
        return looks
    best = max(looks, _closer(picture), key=lambda seen: seen.in_scope)
    return replace(best, opened=looks.opened)


def opened_in(photo: Photo, options: PhotoOptions, looks: Looks | None) -> float:
    """0..1 that a drawer or door stands open; 0 where the user says what is on the front.

    Args:
        looks: what the photo looks like, if anybody looked (`seen_as`).
    """
    if options.layout is not None or options.hints is not None:
        return 0.0
    return (looks or look(photo.small)).opened


def _closer(picture: NDArray[np.uint8]) -> Looks:
    """What the object in a picture looks like without its surroundings, if its box is clear."""
    maps = look_at_photo(picture)
    height, width = picture.shape[:2]
    x0, y0, x1, y1 = window = around(maps.corners, (width, height))
    clear = confidence.corner_evidence(doubt_of(maps)) >= confidence.RULES.clear
    return look(cut(picture, window) if clear and min(x1 - x0, y1 - y0) >= 8 else picture)


def stop_if_out_of_scope(looks: Looks | None, options: PhotoOptions, path: str) -> None:
    """Raise NotThisKind for a photo that shows something else than box furniture."""
    if looks is None or looks.in_scope >= RULES.out:
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


def judge(
    found: Found, options: PhotoOptions, looks: Looks | None = None, opened: float = 0.0
) -> Judgement:
    """Turn what was found into words.

    What the user says is `given`, which is no measure of how well it was found; what a language
    model says is high where our own reading bears it out, else medium. Panels are never surer than
    the box that they lie on, and handles never surer than the panels.
    """
    words = confidence.words(found, read_again(found, options))
    if found.front_given:
        words["cuboid"] = options.word("front")
    words["panels"] = min(words["panels"], words["cuboid"], key=ORDER.index)
    if options.layout or options.hints:
        words["handles"] = min(words["handles"], "medium", key=ORDER.index)
        words["panels"] = "low" if words["cuboid"] == "low" else options.word("layout")
    if "handles" in options.by_model:
        words["handles"] = options.word("handles")
    if options.hints:
        words["handles"] = "given"
    words["handles"] = min(words["handles"], words["panels"], key=ORDER.index)
    words["scale"] = "given" if options.height or options.width or options.depth else "low"
    return Judgement(words, looks, doubt_about(found, words, options, looks, opened))


def read_again(found: Found, options: PhotoOptions) -> float:
    """How well the front reads the same again, 0..1; 1 where the user says what is on it."""
    if options.layout or options.hints or not found.reading.movable:
        return 1.0
    return agreement(found.reading, options.category)


def stop_if_no_box(found: Found, options: PhotoOptions, path: str, opened: float = 0.0) -> None:
    """Raise NotThisKind where nothing in the photo looks like a closed box.

    Args:
        opened: how likely something stands open (`opened_in`).
    """
    if found.doubt > RULES.no_box and not options.accept_low_confidence:
        close = f"{_stands_open(opened)}, or " if opened > opened_in_photos.RULES.likely else ""
        raise NotThisKind(
            f"{path} does not look like a closed, box-like object (the corners of its front are "
            f"uncertain by {found.doubt:.0%} of its side); {close}if it is one, mark its front:\n"
            f"{marking_line(path)}"
        )


def _stands_open(opened: float) -> str:
    return f"a drawer or door seems to stand open ({opened:.2f}): close it"


def doubt_about(
    found: Found,
    words: Mapping[str, str],
    options: PhotoOptions,
    looks: Looks | None,
    opened: float = 0.0,
) -> Doubt | None:
    """Why the reading cannot be relied on as it is; None where it can.

    Args:
        opened: how likely something stands open (`opened_in`).
    """
    if options.hints is not None:
        return None
    of_box = words["cuboid"] == "low" or (not found.front_given and fills_the_picture(found))
    of_thing = looks is not None and looks.in_scope < RULES.sure
    unlike = of_thing and not (found.front_given or options.layout)
    of_room = may_be_a_room_door(found, options, looks)
    stands_open = opened > opened_in_photos.RULES.likely and options.layout is None
    told = f"{_stands_open(opened)}, or say what each panel is"
    if unlike:
        assert looks is not None
        few = [f"{_a(k)} ({p:.2f})" for k, p in list(looks.kinds.items())[:2]]
        why = f"what it shows is uncertain: {' or '.join(few)}"
    elif of_room:
        why = "it may show a door of a room or a passage, which has no box behind it"
    elif stands_open:
        why = told
    elif not found.front_given and fills_the_picture(found):
        why = "the object is cut off by the picture's edges on all sides"
    elif of_box:
        why = "the box around the object is uncertain"
    elif not found.reading.movable:
        why = "no drawer or door was found on its front"
    elif words["panels"] == "low":
        why = "the panels on its front are uncertain"
    else:
        return None
    if stands_open and why != told:
        why += f", and {told}"
    return _settled_by(found, why, options, looks, of_box, of_thing or of_room)


def _settled_by(
    found: Found, why: str, options: PhotoOptions, looks: Looks | None, box: bool, thing: bool
) -> Doubt:
    """The doubt with the options that settle it; `box`, `thing`: whether they are doubted."""
    text = layout_as_read(found.reading)
    said, others = {}, {}
    if box and not found.front_given:
        said["front"] = _corners(found, found.quad)
        middle = found.quad[:, 0].mean()
        for face, quad in found.other_faces:
            if face in ("left", "right") and found.side_share > RULES.other_face:
                side = "left" if quad[:, 0].mean() < middle else "right"
                words = f"If its front is the face to the {side} of that one"
                others[words] = {"front": _corners(found, quad)}
    likely = sizes_of(found, options, looks).category  # as the draft is made
    if thing and options.category is None:
        said["category"] = likely
    if text and not options.layout:
        said["layout"] = text
    controls = (options.category or likely) in CONTROLS
    notes = ('A control panel is typed as such: "door-left, control panel".',) if controls else ()
    return Doubt(why, text, said, others, notes if options.layout else (CLOSED, *notes))


def _corners(found: Found, quad: NDArray[np.float64]) -> str:
    """Corners in whole pixels of the file, as `--front` takes them."""
    return ",".join(map(str, (quad / found.scale).round().astype(int).reshape(-1)))


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
    if w / h > RULES.tall or found.depth_from == "observed" or not 1 <= len(panels) <= 2:
        return False
    height = found.reading.image.shape[0]
    return all(p.kind == "door" and p.box[3] - p.box[1] > 0.7 * height for p in panels)


def fills_the_picture(found: Found) -> bool:
    """Whether the box touches the picture's edge on all four sides."""
    width, height = found.picture
    corners = np.vstack(found.faces)
    edge = RULES.border * max(width, height)
    low, high = corners.min(axis=0), corners.max(axis=0)
    return bool((low < edge).all() and high[0] > width - edge and high[1] > height - edge)


def layout_as_read(reading: FrontReading) -> str:
    """The layout of a front as `--layout` takes it; empty where it cannot be said so."""
    names = [f"{p.kind}-{p.hinge_side}" if p.hinge_side else p.kind for p in reading.panels]
    return layout_text(list(zip(names, [p.box for p in reading.panels], strict=True)))
