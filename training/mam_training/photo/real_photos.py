"""Real photos whose fronts were marked by eye, as lessons for the networks of the photo stage.

An answer to the reader's own question (`mam_pipeline.models.photo_reader`) has the corners of the
front, but only the order of its panels. Boxes that others drew round doors, drawers and handles say
where these are. Where such boxes fill a rectangle, they are a front themselves, in a kitchen, too;
it is not known then what kind of panel each is, unless its handle tells. All become marks once, in
a file that lessons are made from:

    python -m mam_training.photo.real_photos PHOTOS labels/photos.jsonl ANSWERS ... --by NAME

PHOTOS has ID.jpg and boxes.csv, ANSWERS ID/photo/answer.json. Panels are left out where the boxes
and the answer do not fit together, and so is what stands open; it is counted why.
"""

from __future__ import annotations

import csv
import json
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tyro
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from tyro.conf import Positional

from mam_pipeline.digests import file_digest
from mam_pipeline.errors import InputError
from mam_pipeline.models.photo_reader import PhotoReading, front_of
from mam_pipeline.photo.camera import FACES, apply_homography, quad_homography
from mam_pipeline.photo.front import read_front
from mam_pipeline.photo.image import Photo, read_photo
from mam_pipeline.photo.measure import quad_area, rectify
from mam_pipeline.photo.options import parse_layout
from mam_pipeline.photo.quad import aspect_of_quad, corners_of, upright
from mam_pipeline.photo.score import match, polygon_iou, rect_quad
from mam_world.photos.painted_front import PaintedFront
from mam_world.photos.painted_photo import PaintedPhoto
from mam_world.photos.truth import PanelTruth

Array = NDArray[np.float64]
Rect = tuple[float, float, float, float]
REAL = "corpus photos, labelled by eye"
"""In `trained_on` of a manifest."""
FOLDS = 3
"""Of photos: a network that has not seen a fold says how far such networks are to be trusted."""
IGNORED = 255
"""In `PaintedPhoto.seen`: nobody says what is seen there."""


@dataclass(frozen=True)
class MarkRules:
    """When boxes of others and an answer say the same, and what a lesson shows.

    Attributes:
        same: IoU with its box from which a panel is that one. near: from which the place that the
            layout gives stays, because seams are finer than boxes.
        straight: area of a front over that of its upright box from which it is seen straight on:
            there boxes say where panels are.
        beside: of the front's sides: what lies farther away is surely something else.
        around: of the front's sides: room that is shown around it.
        front: pixels of the long side of a front that is shown straight on. margin: around it.
        gap: of the lesser side of two boxes: nearer ones touch. along: share of their sides that
            lies side by side then.
        filled: least and greatest share of a rectangle that its boxes fill.
        least: pixels of its lesser side. longest: its greater side over its lesser one.
        upright: height of a handle over its width from which it is a door's. level: width over
            height from which it is a drawer's.
        edge: share of a panel's width from its side: a handle there is a door's.
    """

    same: float = 0.5
    near: float = 0.7
    straight: float = 0.9
    beside: float = 0.7
    around: tuple[float, float] = (0.05, 1.5)
    front: int = 430
    margin: int = 50
    gap: float = 0.15
    along: float = 0.7
    filled: tuple[float, float] = (0.82, 1.06)
    least: int = 110
    longest: float = 3.5
    upright: float = 1.5
    level: float = 1.5
    edge: float = 0.3


RULES = MarkRules()


@dataclass(frozen=True)
class MarkedPhoto:
    """What is known of the front of one photo.

    Attributes:
        front: four corners TL, TR, BR, BL, shares of the picture's width and height.
        panels: those that move, in front coordinates 0..1; None where they are not known. A kind
            is drawer, door or panel (one of both); a door's hinge may be None.
        whole: whether the front is that of the object that the photo shows.
    """

    id: str
    sha256: str
    by: str
    front: tuple[tuple[float, float], ...]
    panels: tuple[PanelTruth, ...] | None
    whole: bool = True

    @property
    def fold(self) -> int:
        """Which of FOLDS it is in."""
        return int(self.id, 16) % FOLDS

    @staticmethod
    def load(row: Mapping[str, Any]) -> MarkedPhoto:
        """From a line of the file."""
        panels = None
        if row["panels"] is not None:
            panels = tuple(
                PanelTruth(
                    p["kind"], tuple(p["rect"]), p["hinge_side"], tuple(map(tuple, p["handles"]))
                )
                for p in row["panels"]
            )
        front = tuple((float(x), float(y)) for x, y in row["front"])
        return MarkedPhoto(row["id"], row["sha256"], row["by"], front, panels, row["whole"])


def marked_in(labels: Path, photos: Path) -> Iterator[tuple[MarkedPhoto, NDArray[np.uint8]]]:
    """Every mark with its picture (h, w, 3) RGB.

    Raises:
        InputError: a photo is missing, or is another one than was marked.
    """
    for line in labels.read_text(encoding="utf-8").splitlines():
        mark = MarkedPhoto.load(json.loads(line))
        path = photos / f"{mark.id}.jpg"
        if not path.is_file() or file_digest(path) != mark.sha256:
            raise InputError(f"{path} is not the photo that {labels} marks")
        yield mark, read_photo(path).rgb


def front_lesson(mark: MarkedPhoto, picture: NDArray[np.uint8]) -> PaintedFront:
    """The front seen straight on, with some room around it."""
    assert mark.panels is not None
    h, w = picture.shape[:2]
    quad = np.array(mark.front) * (w, h)
    ratio = aspect_of_quad(quad, (w, h))
    wide, high = RULES.front * min(ratio, 1.0), RULES.front * min(1 / ratio, 1.0)
    m = RULES.margin
    corners = corners_of((m, m, m + wide, m + high))
    size = (round(wide + 2 * m), round(high + 2 * m))
    matrix = cv2.getPerspectiveTransform(quad.astype(np.float32), corners.astype(np.float32))
    shrink = float(np.sqrt(quad_area(quad) / (wide * high)))
    if shrink > 1.6:
        picture = np.asarray(cv2.GaussianBlur(picture, (0, 0), 0.35 * shrink), np.uint8)
    seen = cv2.warpPerspective(
        picture, matrix, size, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    return PaintedFront(np.asarray(seen, np.uint8), corners, mark.panels)


def photo_lesson(
    mark: MarkedPhoto, picture: NDArray[np.uint8], rng: np.random.Generator
) -> PaintedPhoto:
    """A window of the photo around the front; what is beside the front is mostly unknown."""
    h, w = picture.shape[:2]
    quad = np.array(mark.front) * (w, h)
    low, high = quad.min(axis=0), quad.max(axis=0)
    least, most = np.log(RULES.around)
    room = np.exp(rng.uniform(least, most, (2, 2))) * (high - low)
    x0, y0 = np.clip(low - room[0], 0, None).astype(int)
    x1, y1 = np.clip(high + room[1], None, (w, h)).astype(int)
    seen = np.full((h, w), IGNORED, np.uint8)
    away = RULES.beside * (high - low)
    (a, b), (c, d) = (low - away).round().astype(int), (high + away).round().astype(int)
    other = np.ones((h, w), bool)
    other[max(b, 0) : max(d, 0), max(a, 0) : max(c, 0)] = False
    seen[other] = 0
    cv2.fillConvexPoly(seen, quad.round().astype(np.int32), 1)
    corners = np.full((8, 2), np.nan)
    corners[list(FACES["front"])] = quad - (x0, y0)
    return PaintedPhoto(
        np.ascontiguousarray(picture[y0:y1, x0:x1]), corners,
        np.ascontiguousarray(seen[y0:y1, x0:x1]),
    )  # fmt: skip


def toned(picture: NDArray[np.uint8], rng: np.random.Generator) -> NDArray[np.uint8]:
    """In another light, a little blurred, packed again."""
    light = np.exp(rng.normal(0.0, 0.25))
    tint = rng.uniform(0.85, 1.15, 3)
    out = np.clip(255 * (picture / 255.0) ** light * tint, 0, 255).astype(np.uint8)
    if rng.random() < 0.3:
        out = np.asarray(cv2.GaussianBlur(out, (0, 0), rng.uniform(0.4, 1.2)), np.uint8)
    packed = cv2.imencode(".jpg", out, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(50, 95))])[1]
    return np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), np.uint8)


Boxes = Mapping[str, Sequence[Array]]
HANDLE = "handle"
FRIDGE = "refrigerator door"
PANELS = (FRIDGE, "cabinet door or drawer")
BY_BOXES = "boxes of others"


def boxes_of(file: Path) -> dict[str, dict[str, list[Array]]]:
    """Photo to class to boxes (4, 2), shares of the picture's width and height."""
    out: dict[str, dict[str, list[Array]]] = {}
    with file.open(encoding="utf-8") as rows:
        for row in csv.DictReader(rows):
            x, y, w, h = (float(row[k]) for k in ("x_center", "y_center", "width", "height"))
            box = corners_of((x - w / 2, y - h / 2, x + w / 2, y + h / 2))
            out.setdefault(row["id"], {}).setdefault(row["class"], []).append(box)
    return out


def panels_of(answer: PhotoReading, photo: Photo, boxes: Boxes) -> tuple[PanelTruth, ...]:
    """Where the panels of an answer are.

    Raises:
        InputError: the boxes and the answer do not fit together, in a few words.
    """
    quad = front_of(answer, photo)
    image = rectify(photo, quad, aspect_of_quad(quad, photo.size))
    h, w = image.shape[:2]
    flat = quad_homography(quad, w, h)
    if not answer.layout:
        raise InputError("no layout")
    reading = read_front(image, parse_layout(answer.layout), sure=1.0)
    shown = [
        upright(rect_quad(tuple(np.array(p.box) / (w, h, w, h)), quad)) for p in reading.movable
    ]
    doors = _on([b for name in PANELS for b in boxes.get(name, ())], photo, quad)
    if not shown or not doors:
        raise InputError("no panel or no box")
    iou = np.array([[polygon_iou(box, one) for one in shown] for box in doors])
    pairs = {panel: box for box, panel in match(iou, RULES.same)}
    if len(pairs) < len(doors):
        raise InputError("a box is no panel")
    missing = [k for k in range(len(shown)) if k not in pairs]
    straight = quad_area(quad) / quad_area(upright(quad)) >= RULES.straight
    worst = min(iou[box, panel] for panel, box in pairs.items())
    if not straight and worst < RULES.near:
        raise InputError("seen at an angle, and a panel is not where its box is")
    if missing and (worst < RULES.near or len(missing) > len(pairs)):
        raise InputError("panels without boxes")
    grips = [apply_homography(flat, b) for b in _on(boxes.get(HANDLE, ()), photo, quad)]
    told = np.array(answer.handle_boxes, float).reshape(-1, 4)
    for box in told:
        corners = apply_homography(flat, corners_of(box.tolist()) * photo.size / 1000.0)
        if all(polygon_iou(upright(corners), upright(g)) < 0.05 for g in grips):
            grips.append(corners)
    out = []
    for k, panel in enumerate(reading.movable):
        x0, y0, x1, y1 = panel.box
        if straight and k in pairs and iou[pairs[k], k] < RULES.near:
            on = apply_homography(flat, doors[pairs[k]])
            (x0, y0), (x1, y1) = on.min(axis=0).tolist(), on.max(axis=0).tolist()
        mine = [g for g in grips if x0 <= g[:, 0].mean() <= x1 and y0 <= g[:, 1].mean() <= y1]
        rects = tuple(_rect(g.min(axis=0), g.max(axis=0), w, h) for g in mine)
        rect = _rect(np.array([x0, y0]), np.array([x1, y1]), w, h)
        out.append(PanelTruth(panel.kind, rect, panel.hinge_side, rects))
    return tuple(out)


def fronts_of(boxes: Boxes, size: tuple[int, int]) -> Iterator[tuple[Rect, list[PanelTruth]]]:
    """Rectangles (pixels) that boxes of one class fill together, and these as panels."""
    handles = [box * size for box in boxes.get(HANDLE, ())]
    for name in PANELS:
        some = [box * size for box in boxes.get(name, ())]
        touch = np.array([[_touch(a, b) for b in some] for a in some], bool)
        count, group = connected_components(touch) if some else (0, ())
        for g in range(count):
            mine = [box for box, of in zip(some, group, strict=True) if of == g]
            low = np.min([box[0] for box in mine], axis=0)
            high = np.max([box[2] for box in mine], axis=0)
            w, h = (high - low).tolist()
            filled = sum(quad_area(box) for box in mine) / max(w * h, 1.0)
            sound = min(w, h) >= RULES.least and max(w, h) <= RULES.longest * min(w, h)
            sound = sound and len(mine) > 1
            if not sound or not RULES.filled[0] <= filled <= RULES.filled[1]:
                continue
            panels = [_panel_of(box, handles, name == FRIDGE, low, w, h) for box in mine]
            yield (*low.tolist(), *high.tolist()), panels


def _touch(a: Array, b: Array) -> bool:
    """Whether two upright boxes lie side by side, or one above the other."""
    gap = np.maximum(a[0], b[0]) - np.minimum(a[2], b[2])
    sides = np.minimum(a[2] - a[0], b[2] - b[0])
    near = np.abs(gap) < RULES.gap * sides.min()
    along = -gap > RULES.along * sides
    return bool((near[0] and along[1]) or (near[1] and along[0]))


def _panel_of(
    box: Array, handles: Sequence[Array], fridge: bool, low: Array, w: float, h: float
) -> PanelTruth:
    """A box as a panel of a front: what its handle tells of its kind and its hinge."""
    (x0, y0), (x1, y1) = box[0], box[2]
    mine = [g for g in handles if x0 <= g[:, 0].mean() <= x1 and y0 <= g[:, 1].mean() <= y1]
    kind, hinge = "door" if fridge else "panel", None
    if len(mine) == 1:
        across, high = mine[0][2] - mine[0][0]
        where = (mine[0][:, 0].mean() - x0) / (x1 - x0)
        at_edge = min(where, 1 - where) < RULES.edge
        if at_edge and (fridge or high > RULES.upright * across):
            kind, hinge = "door", "right" if where < 0.5 else "left"
        elif not fridge and not at_edge and across > RULES.level * high and x1 - x0 > y1 - y0:
            kind = "drawer"
    size = np.array([w, h])
    rects = tuple(_rect(g[0] - low, g[2] - low, w, h) for g in mine)
    return PanelTruth(kind, _rect(box[0] - low, box[2] - low, *size.tolist()), hinge, rects)


def _on(boxes: Sequence[Array], photo: Photo, quad: Array) -> list[Array]:
    """Boxes whose middle lies on a front, in small pixels."""
    front = quad.astype(np.float32)
    small = [box * np.array(photo.size) for box in boxes]
    return [
        b for b in small
        if cv2.pointPolygonTest(front, tuple(map(float, b.mean(axis=0))), False) >= 0
    ]  # fmt: skip


def _rect(low: Array, high: Array, w: float, h: float) -> Rect:
    """A rectangle in front coordinates, to four digits."""
    low, high = np.clip([low / (w, h), high / (w, h)], 0.0, 1.0).round(4).tolist()
    return low[0], low[1], high[0], high[1]


def marks(
    answer: PhotoReading, path: Path, boxes: Boxes, by: str, why: Counter[str]
) -> Iterator[MarkedPhoto]:
    """What is known of the fronts in a photo; why something is not is counted in `why`."""
    photo, digest, seen = read_photo(path), file_digest(path), None
    if answer.in_scope:
        seen = front_of(answer, photo)
        panels: tuple[PanelTruth, ...] | None = None
        try:
            panels = panels_of(answer, photo, boxes)
        except InputError as error:
            why[str(error)] += 1
        front = tuple((round(x / 1000, 4), round(y / 1000, 4)) for x, y in answer.front)
        yield MarkedPhoto(path.stem, digest, by, front, panels)
    for rect, found in fronts_of(boxes, photo.size):
        corners = corners_of(rect)
        if seen is not None and cv2.pointPolygonTest(
            seen.astype(np.float32), tuple(map(float, corners.mean(axis=0))), False
        ) >= 0:  # fmt: skip
            continue
        front = tuple((round(x, 4), round(y, 4)) for x, y in (corners / photo.size).tolist())
        yield MarkedPhoto(path.stem, digest, BY_BOXES, front, tuple(found), whole=False)


def main(
    photos: Positional[Path],
    out: Positional[Path],
    answers: Positional[tuple[Path, ...]],
    /,
    by: str,
    opened: Path = Path("labels/photos_opened.csv"),
) -> None:
    """Write the marks of all photos that were answered, in the order of their names.

    Args:
        photos: folder with ID.jpg and boxes.csv. out: file to write. answers: folders of them.
        by: who or what answered.
        opened: what somebody else says stands open is left out, too.
    """
    lines, why = list[str](), Counter[str]()
    with opened.open(encoding="utf-8") as stream:
        open_ones = {row["id"] for row in csv.DictReader(stream) if row["opened"] != "no"}
    boxes = boxes_of(photos / "boxes.csv")
    folders = {p.name: p for at in answers for p in sorted(at.iterdir()) if p.is_dir()}
    for name, folder in sorted(folders.items()):
        text = (folder / "photo" / "answer.json").read_text(encoding="utf-8")
        answer = PhotoReading.model_validate_json(text)
        if name in open_ones or answer.opened:
            why["stands open"] += 1
            continue
        why["out of scope"] += not answer.in_scope
        found = marks(answer, photos / f"{name}.jpg", boxes.get(name, {}), by, why)
        lines += [json.dumps(asdict(one)) for one in found]
    out.write_text("".join(line + "\n" for line in lines), encoding="utf-8")
    rows = [json.loads(line) for line in lines]
    whole = [row for row in rows if row["whole"]]
    known = sum(row["panels"] is not None for row in whole)
    print(f"{len(whole)} fronts by eye, {known} with panels; {len(rows) - len(whole)} of boxes")
    print(f"left out: {dict(why)}")


if __name__ == "__main__":
    tyro.cli(main)
