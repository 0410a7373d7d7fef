"""Run the reconstructor on photos with truth and collect scores: the body of `bench-photo`."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
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
from mam_pipeline.photo.score import (
    FoundPanel,
    PhotoScore,
    handle_hits,
    match,
    polygon_iou,
    rect_quad,
    score_photo,
)  # fmt: skip
from mam_pipeline.photo.truth import PhotoTruth, Rect
from mam_pipeline.photo.verdict import judge

Array = NDArray[np.float64]
YOLO_CLASSES = ("door", "handle", "cabinet door", "refrigerator door")  # of DoorDetect
PICTURES = (".jpg", ".jpeg", ".png", ".webp", ".bmp", ".tif", ".tiff")


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


def score_found(found: Found, photo: Photo, truth: PhotoTruth) -> PhotoScore:
    """Score what was found in a synthetic photo; no confidence words."""
    seen = found.depth_from == "observed" and truth.depth_visible
    return score_photo(truth, found.quad / photo.scale, found.shape, panels_of(found), seen, {})


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
