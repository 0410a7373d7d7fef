"""`mam-sim bench-photo`: score the photo reconstructor on synthetic or on labelled photos."""

from __future__ import annotations

import json as json_module
import sys
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from mam_pipeline.errors import MamSimError


def bench_photo(
    folder: Annotated[Path | None, tyro.conf.Positional] = None,
    /,
    count: int = 20,
    level: Literal["clean", "medium", "clutter", "all"] = "all",
    seed: int = 0,
    layout: bool = False,
    out: Path | None = None,
    save_photos: Path | None = None,
    quiet: bool = False,
    json: bool = False,
) -> int:
    """Score the photo reconstructor.

    Without a folder: on procedural furniture with exact truth, rendered at three levels of
    difficulty. With a folder: on your photos with YOLO boxes (classes handle, cabinet door,
    refrigerator door, door; or those of classes.txt).

    Args:
        folder: photos with YOLO label files beside them or in labels/.
        count: synthetic photos per level.
        level: clean, medium, clutter or all.
        seed: number of the first synthetic photo.
        layout: tell the reconstructor the true layout (as with --layout), where rows can say it.
        out: write the scores as JSON.
        save_photos: keep the synthetic photos in this folder.
        quiet: no progress.
        json: print JSON instead of the table.
    """
    if folder is not None:
        result: dict[str, Any] = {"photos": _labelled(folder, quiet)}
    else:
        levels = ["clean", "medium", "clutter"] if level == "all" else [level]
        result = {k: _synthetic(k, count, seed, layout, save_photos, quiet) for k in levels}
    text = json_module.dumps(result, indent=1)
    if out is not None:
        out.write_text(text + "\n", encoding="utf-8")
    print(text if json else _table(result))
    return 0


def _say(text: str, quiet: bool) -> None:
    if not quiet:
        print(text, file=sys.stderr, flush=True)


def _synthetic(
    level: str, count: int, seed: int, layout: bool, keep: Path | None, quiet: bool
) -> dict[str, Any]:
    from mam_pipeline.photo.evaluate import layout_of, score_image
    from mam_pipeline.photo.options import parse_options
    from mam_pipeline.photo.score import summary
    from mam_world.photos.synthetic_photo import synthesise

    scores = []
    for number in range(seed, seed + count):
        image, truth = synthesise(number, level)
        if keep is not None:
            import cv2

            keep.mkdir(parents=True, exist_ok=True)
            cv2.imwrite(str(keep / f"{level}_{number:04d}.jpg"), image[..., ::-1])
        options = None
        if layout:
            text = layout_of(truth)
            if text is None:
                continue
            options = parse_options({"layout": text})
        s = score_image(image, truth, options)
        scores.append(s)
        _say(
            f"{level} {number} {truth.category}: front {s.front_iou:.2f}, "
            f"panels {s.matched50}/{s.panels} (found {s.found}), "
            f"handles {s.handles_hit}/{s.handles}, {s.seconds:.1f} s",
            quiet,
        )
    return summary(scores)


def _labelled(folder: Path, quiet: bool) -> dict[str, Any]:
    from mam_pipeline.photo.evaluate import score_yolo, yolo_items

    total: dict[str, int] = {}
    failed = 0
    for path, boxes in yolo_items(folder):
        try:
            counts = score_yolo(path, boxes, {})
        except MamSimError as error:
            _say(f"{path.name}: {error}", quiet)
            failed += 1
            continue
        total = {k: total.get(k, 0) + v for k, v in counts.items()}
        _say(f"{path.name}: {counts}", quiet)

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


def _table(result: dict[str, Any]) -> str:
    columns = list(result)
    rows = list(dict.fromkeys(k for c in columns for k in result[c]))
    width = max(map(len, rows))
    lines = [f"{'':<{width}}  " + "  ".join(f"{c:>9}" for c in columns)]
    for row in rows:
        values = [result[c].get(row) for c in columns]
        cells = "  ".join(f"{'-' if v is None else v:>9}" for v in values)
        lines.append(f"{row:<{width}}  {cells}")
    return "\n".join(lines)
