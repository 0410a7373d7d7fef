"""`mam-sim bench-photo`: score the photo reconstructor on synthetic or on labelled photos."""

from __future__ import annotations

import json
import re
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import Positional

from mam_pipeline import folders
from mam_pipeline.claims import PHOTO_SCORES, claim_entries, claim_file
from mam_pipeline.edited import Range, Seed
from mam_sim.options import Verb


@dataclass(frozen=True, kw_only=True)
class BenchPhoto(Verb):
    """Score the photo reconstructor.

    Without a folder: on procedural furniture with exact truth, rendered at three levels of
    difficulty. With a folder: on your photos with YOLO boxes (classes door, handle, cabinet door,
    refrigerator door, as in DoorDetect; or those of classes.txt, one name a line). With a folder
    and --truth: what make-env would make of each photo without help: right, usable, wrong, asked
    (exit status 3) or refused (4).
    """

    folder: Positional[Path | None] = None
    """Photos with YOLO label files beside them or in labels/."""
    truth: Path | None = None
    """YAML file that says what each photo of the folder shows (docs: Results of photos)."""
    count: Annotated[int, Range(1, 100_000)] = 20
    """Synthetic photos per level."""
    level: Literal["clean", "medium", "clutter", "all"] = "all"
    """Difficulty of the synthetic photos."""
    seed: Seed = 0
    """Number of the first synthetic photo."""
    layout: bool = False
    """Tell the reconstructor the true layout (as with --layout), where one can be said."""
    out: Path | None = None
    """Write the scores as JSON."""
    save_photos: Path | None = None
    """Keep the synthetic photos in this folder."""
    json: bool = False
    """Print JSON instead of the table."""

    def run(self) -> int:
        """Score, and print the table."""
        claim_file(self.out, *PHOTO_SCORES)
        if self.save_photos is not None:
            claim_entries(self.save_photos, "photos of bench-photo", _saved, "--save-photos")
        result: dict[str, Any]
        tell = partial(_say, quiet=self.quiet)
        if self.truth is not None:
            result = _outcomes(self.folder, self.truth, tell, self.layout)
        elif self.folder is not None:
            from mam_sim_bench.photo_scores import score_folder

            result = {"photos": score_folder(self.folder, tell)}
        else:
            levels = ["clean", "medium", "clutter"] if self.level == "all" else [self.level]
            result = {
                k: _synthetic(k, self.count, self.seed, self.layout, self.save_photos, self.quiet)
                for k in levels
            }
        text = json.dumps(result, indent=1)
        if self.out is not None:
            folders.write_text(self.out, text + "\n")
        counts = {k: v for k, v in result.items() if isinstance(v, dict)}
        print(text if self.json else _table(counts))
        if "silently_wrong" in result and not self.json:
            print(f"silently wrong: {result['silently_wrong']:.1%}")
        if self.out is not None:
            tell(f"result: {self.out}")
        return 0


def _outcomes(
    folder: Path | None, truth: Path, tell: Callable[[str], None], layout: bool
) -> dict[str, Any]:
    from mam_pipeline.errors import ConfigError
    from mam_sim_bench.photo_outcome import outcomes_of_folder

    if folder is None:
        raise ConfigError("--truth needs the folder of its photos")
    return outcomes_of_folder(folder, truth, tell, layout)


def _saved(name: str) -> bool:
    """Whether a name is that of a synthetic photo."""
    return re.fullmatch(r"(clean|medium|clutter)_\d+\.jpg", name) is not None


def _say(text: str, quiet: bool) -> None:
    if not quiet:
        print(text, file=sys.stderr, flush=True)


def _synthetic(
    level: str, count: int, seed: int, layout: bool, keep: Path | None, quiet: bool
) -> dict[str, Any]:
    from mam_pipeline.photo.options import parse_options
    from mam_sim_bench.photo_scores import layout_of, score_image, summary
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
