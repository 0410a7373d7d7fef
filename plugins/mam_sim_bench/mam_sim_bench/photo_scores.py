"""Scores of the photo reconstructor against truth: fronts, sizes, panels, handles, kinds."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.errors import InputError, MamSimError
from mam_pipeline.photo.find import Found, find_object
from mam_pipeline.photo.image import Photo, make_photo, read_photo
from mam_pipeline.photo.layout import layout_text
from mam_pipeline.photo.options import PhotoOptions, parse_options
from mam_pipeline.photo.quad import corners_of, upright
from mam_pipeline.photo.score import match, polygon_iou, rect_quad
from mam_pipeline.photo.verdict import judge
from mam_world.photos.truth import PhotoTruth, Rect

Array = NDArray[np.float64]
YOLO_CLASSES = ("door", "handle", "cabinet door", "refrigerator door")  # of DoorDetect
PICTURES = (".jpg", ".jpeg", ".png", ".webp", ".bmp", ".tif", ".tiff")


@dataclass(frozen=True)
class FoundPanel:
    """A predicted panel on the predicted front (0..1 front coordinates of that front)."""

    kind: str
    rect: Rect
    handles: tuple[Rect, ...] = ()


@dataclass(frozen=True)
class PhotoScore:
    """Scores of one photo; sizes are relative errors, None where not measurable."""

    front_iou: float
    aspect_error: float
    depth_error: float | None
    panels: int
    found: int
    matched75: int
    matched50: int
    handles: int
    handles_hit: int
    handles_found: int
    handles_right: int
    kinds_right: int
    confidence: Mapping[str, str] = field(default_factory=dict)
    seconds: float = 0.0
    stopped: str = ""


def predict(
    photo: Photo, options: PhotoOptions | None = None
) -> tuple[Array, tuple[float, float, float], list[FoundPanel], bool, Mapping[str, str]]:
    """Front corners (small pixels), shape, panels, depth observed, confidence words."""
    options = options or PhotoOptions()
    found = find_object(photo, options)
    words = judge(found, options).words
    return found.quad, found.shape, panels_of(found), found.depth_from == "observed", words


def panels_of(found: Found) -> list[FoundPanel]:
    """What was found, in 0..1 front coordinates; virtual grasp lines are no handles."""
    h, w = found.reading.image.shape[:2]

    def norm(b: tuple[float, float, float, float]) -> Rect:
        return b[0] / w, b[1] / h, b[2] / w, b[3] / h

    return [
        FoundPanel(
            p.kind,
            norm(p.box),
            tuple(norm(b.box) for b in p.handles if b.provenance != "assumed"),
        )
        for p in found.reading.movable
    ]


def score_image(
    image: NDArray[np.uint8], truth: PhotoTruth, options: PhotoOptions | None = None
) -> PhotoScore:
    """Score one synthetic photo (H, W, 3)."""
    photo = make_photo(image)
    start = time.process_time()
    quad, shape, panels, observed, words = predict(photo, options)
    seconds = time.process_time() - start
    return score_photo(
        truth, quad / photo.scale, shape, panels, observed and truth.depth_visible, words, seconds
    )


def layout_of(truth: PhotoTruth) -> str | None:
    """The layout text a user would type for a piece, or None if rows cannot say it."""
    return layout_text([(p.kind, p.rect) for p in truth.panels]) or None


def yolo_items(folder: Path) -> Iterator[tuple[Path, list[tuple[str, Array]]]]:
    """Photos of a folder with YOLO boxes: `name.jpg` beside `name.txt`, or images/ and labels/.

    Each line is `class x y w h` (0..1 of the picture); classes are those of `classes.txt`, one name
    a line, or DoorDetect's: door, handle, cabinet door, refrigerator door.

    Raises:
        InputError: no labelled photo, or a line that is not five numbers.
    """
    names: tuple[str, ...] = YOLO_CLASSES
    listing = folder / "classes.txt"
    if listing.is_file():
        names = tuple(listing.read_text(encoding="utf-8").split("\n"))
    photos = sorted(p for p in folder.rglob("*") if p.suffix.lower() in PICTURES)
    some = False
    for path in photos:
        twin = Path(str(path.parent).replace("images", "labels")) / f"{path.stem}.txt"
        label = next((f for f in (path.with_suffix(".txt"), twin) if f.is_file()), None)
        if label is None:
            continue
        some = True
        yield path, _read_yolo(label, names)
    if not some:
        raise InputError(f"{folder} holds no photo with a YOLO label file beside it or in labels/")


def _read_yolo(path: Path, names: tuple[str, ...]) -> list[tuple[str, Array]]:
    out = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        if not line.strip():
            continue
        try:
            k, x, y, w, h = (float(v) for v in line.split()[:5])
            name = names[int(k)].strip()
        except (ValueError, IndexError) as error:
            raise InputError(f"{path.name} line {number}: expected `class x y w h`") from error
        out.append((name, corners_of((x - w / 2, y - h / 2, x + w / 2, y + h / 2))))
    return out


def score_yolo(
    path: Path, boxes: list[tuple[str, Array]], options: Mapping[str, Any]
) -> dict[str, int]:
    """Counts for one photo with YOLO boxes: panels at IoU 0.5 and handle centres inside."""
    photo = read_photo(path)
    return score_boxes(find_object(photo, parse_options(options)), boxes)


def score_boxes(found: Found, boxes: list[tuple[str, Array]]) -> dict[str, int]:
    """The counts of `score_yolo` for what was found.

    Args:
        boxes: class and (4, 2) corners, 0..1 of the picture.
    """
    size, panels, quad = np.array(found.picture, float), panels_of(found), found.quad

    ours = [upright(rect_quad(p.rect, quad)) for p in panels]
    theirs = [b * size for n, b in boxes if n != "handle"]
    iou = np.array([[polygon_iou(t, o) for o in ours] for t in theirs]).reshape(
        len(theirs), len(ours)
    )
    handles = [b * size for n, b in boxes if n == "handle"]
    grips = [upright(rect_quad(k, quad)) for p in panels for k in p.handles]
    hit, right = handle_hits(handles, grips)
    return {
        "panels": len(theirs), "found": len(ours), "matched50": len(match(iou, 0.5)),
        "handles": len(handles), "handles_hit": hit, "handles_found": len(grips),
        "handles_right": right,
    }  # fmt: skip


def score_folder(
    folder: Path, on_photo: Callable[[str], None] = lambda _line: None
) -> dict[str, Any]:
    """Recall and precision of panels and handles over a folder of photos with YOLO boxes.

    Args:
        folder: as in `yolo_items`.
        on_photo: called with a line of words for every photo.

    Returns:
        The summed counts of `score_yolo`, `failed` photos, and shares (None where nothing counts).
    """
    total: dict[str, int] = {}
    failed = 0
    for path, boxes in yolo_items(folder):
        try:
            counts = score_yolo(path, boxes, {})
        except MamSimError as error:
            on_photo(f"{path.name}: {error}")
            failed += 1
            continue
        total = {k: total.get(k, 0) + v for k, v in counts.items()}
        on_photo(f"{path.name}: {counts}")

    def share(a: str, b: str) -> float | None:
        return round(total[a] / total[b], 4) if total.get(b) else None

    return {
        **total,
        "failed": failed,
        "panel_recall_50": share("matched50", "panels"),
        "panel_precision_50": share("matched50", "found"),
        "handle_recall": share("handles_hit", "handles"),
        "handle_precision": share("handles_right", "handles_found"),
    }


def score_photo(
    truth: PhotoTruth,
    front: Array,
    shape: tuple[float, float, float],
    panels: Sequence[FoundPanel],
    depth_observed: bool,
    confidence: Mapping[str, str],
    seconds: float = 0.0,
    stopped: str = "",
) -> PhotoScore:
    """Score one prediction; all comparisons are made in the picture, as a viewer would.

    Args:
        front: (4, 2) predicted front corners, pixels of the picture.
        shape: predicted (width, depth, height), any unit.
    """
    w, d, h = truth.size
    ours = [rect_quad(p.rect, front) for p in panels]
    theirs = [rect_quad(p.rect, truth.front) for p in truth.panels]
    iou = np.array([[polygon_iou(t, o) for o in ours] for t in theirs]).reshape(len(theirs), -1)
    pairs = match(iou, 0.5)
    kinds = sum(truth.panels[t].kind == panels[o].kind for t, o in pairs)
    truth_handles = [rect_quad(k, truth.front) for p in truth.panels for k in p.handles]
    our_handles = [rect_quad(k, front) for p in panels for k in p.handles]
    hit, right = handle_hits(truth_handles, our_handles)
    aspect = (shape[0] / shape[2]) / (w / h)
    deep = (shape[1] / shape[2]) / (d / h)
    return PhotoScore(
        polygon_iou(front, truth.front),
        abs(aspect - 1),
        abs(deep - 1) if depth_observed else None,
        len(theirs), len(ours), len(match(iou, 0.75)), len(pairs),
        len(truth_handles), hit, len(our_handles), right, kinds, dict(confidence), seconds, stopped,
    )  # fmt: skip


def handle_hits(truth: Sequence[Array], ours: Sequence[Array]) -> tuple[int, int]:
    """(truth handles hit, our handles right): our centre lies inside the truth's box, grown by
    3 pixels or a fifth of its size, and the sizes agree within a factor of four."""
    ok = np.zeros((len(truth), len(ours)), bool)
    for i, t in enumerate(truth):
        low, high = t.min(axis=0), t.max(axis=0)
        grow = np.maximum(3.0, 0.2 * (high - low))
        for j, o in enumerate(ours):
            c = o.mean(axis=0)
            big = np.ptp(o, axis=0).max() / max(np.ptp(t, axis=0).max(), 1.0)
            ok[i, j] = bool((c > low - grow).all() and (c < high + grow).all() and 0.25 < big < 4)
    return int(ok.any(axis=1).sum()), int(ok.any(axis=0).sum())


def summary(scores: Sequence[PhotoScore]) -> dict[str, Any]:
    """The table of the benchmark: one number per measure."""

    def total(name: str) -> int:
        return sum(getattr(s, name) for s in scores)

    def share(a: float, b: float) -> float | None:
        return round(a / b, 4) if b else None

    aspect = np.array([s.aspect_error for s in scores if s.front_iou > 0.5])
    depth = np.array([s.depth_error for s in scores if s.depth_error is not None])
    sure = [s for s in scores if s.confidence.get("cuboid") == "high"]
    sure_panels = [s for s in scores if s.confidence.get("panels") == "high"]
    return {
        "photos": len(scores),
        "front_iou_90": share(sum(s.front_iou >= 0.9 for s in scores), len(scores)),
        "front_iou_80": share(sum(s.front_iou >= 0.8 for s in scores), len(scores)),
        "aspect_error_median": _q(aspect, 50),
        "aspect_error_p90": _q(aspect, 90),
        "depth_error_median": _q(depth, 50),
        "panel_recall_75": share(total("matched75"), total("panels")),
        "panel_precision_75": share(total("matched75"), total("found")),
        "panel_recall_50": share(total("matched50"), total("panels")),
        "panel_precision_50": share(total("matched50"), total("found")),
        "handle_recall": share(total("handles_hit"), total("handles")),
        "handle_precision": share(total("handles_right"), total("handles_found")),
        "kind_accuracy": share(total("kinds_right"), total("matched50")),
        "cuboid_high": len(sure),
        "cuboid_right_when_high": share(sum(s.front_iou >= 0.8 for s in sure), len(sure)),
        "panels_high": len(sure_panels),
        "panels_right_when_high": share(
            sum(s.matched50 == s.panels == s.found for s in sure_panels), len(sure_panels)
        ),
        "stopped": sum(bool(s.stopped) for s in scores),
        "seconds_median": _q(np.array([s.seconds for s in scores]), 50),
    }


def _q(values: Array, percentile: float) -> float | None:
    return round(float(np.percentile(values, percentile)), 4) if len(values) else None
