"""How well fronts are read where their true corners are given: panels, kinds, hinges, handles.

Real photos that a person marked, each in six views (as it is, mirrored, bent, cut, toned, partly
hidden), and rendered photos. What is left out is finding the object: `mam-sim bench-photo` has it.

    python benchmarks/front_reading.py ../shared/bench/photos [--seeds 8 28]
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import tyro
from mam_sim_bench.photo_scores import handle_hits
from numpy.typing import NDArray
from tyro.conf import Positional

from mam_pipeline.photo.camera import apply_homography, quad_homography
from mam_pipeline.photo.front import read_front
from mam_pipeline.photo.image import make_photo
from mam_pipeline.photo.measure import rectify
from mam_pipeline.photo.panel import Panel
from mam_pipeline.photo.quad import corners_of, upright
from mam_pipeline.photo.score import match, polygon_iou, rect_quad
from mam_training.photo.marked_photos import views
from mam_world.photos.synthetic_photo import synthesise

Array = NDArray[np.float64]
TRUTH = Path(__file__).parent / "photo_truth.yaml"


@dataclass(frozen=True)
class Arguments:
    """Folder of the marked photos, and which rendered photos."""

    photos: Positional[Path]
    seeds: tuple[int, int] = (8, 28)


class Mark(NamedTuple):
    """A true panel: quads (4, 2) in pixels of the front."""

    kind: str
    hinge: str | None
    quad: Array
    handles: list[Array]


Front = tuple[NDArray[np.uint8], list[Mark]]


def main(arguments: Arguments) -> None:
    """Print a line for real and one for rendered fronts."""
    print(f"{'real':<10}{scored(real_fronts(arguments.photos))}", flush=True)
    print(f"{'rendered':<10}{scored(rendered_fronts(range(*arguments.seeds)))}")


def real_fronts(folder: Path) -> Iterator[Front]:
    """Every view of every marked photo."""
    for seen in views(folder, TRUTH):
        q = seen.front
        wide = np.linalg.norm(q[1] - q[0]) + np.linalg.norm(q[2] - q[3])
        high = np.linalg.norm(q[3] - q[0]) + np.linalg.norm(q[2] - q[1])
        photo = make_photo(seen.image)
        image = rectify(photo, q * photo.scale, float(wide / high))
        to_front = quad_homography(q, image.shape[1], image.shape[0])
        marks = [
            Mark(
                m.kind, m.hinge, upright(apply_homography(to_front, m.quad)),
                [upright(apply_homography(to_front, handle)) for handle in m.handles],
            )
            for m in seen.panels
        ]  # fmt: skip
        yield image, marks


def rendered_fronts(seeds: Iterable[int]) -> Iterator[Front]:
    """Rendered photos of the two harder levels."""
    for seed in seeds:
        for level in ("medium", "clutter"):
            picture, truth = synthesise(seed, level)
            photo = make_photo(picture)
            w, _, h = truth.size
            image = rectify(photo, truth.front * photo.scale, w / h)
            whole = corners_of((0, 0, image.shape[1], image.shape[0]))
            yield image, [
                Mark(p.kind, p.hinge_side, rect_quad(p.rect, whole),
                     [rect_quad(k, whole) for k in p.handles])
                for p in truth.panels
            ]  # fmt: skip


def scored(fronts: Iterable[Front]) -> str:
    """The scores of one set in a line."""
    counts, whole, seconds = np.zeros(8), [], []
    for image, truth in fronts:
        start = time.process_time()
        ours = read_front(image).movable
        seconds.append(time.process_time() - start)
        one, right = _compared(truth, ours)
        counts += one
        whole.append(right)
    true, found, matched, kinds, handles, seen, hit, good = counts
    return (
        f"{len(whole)} fronts  panels {matched / true:.3f} / {matched / max(found, 1):.3f}"
        f"  kinds {kinds / max(matched, 1):.3f}"
        f"  handles {hit / max(handles, 1):.3f} / {good / max(seen, 1):.3f}"
        f"  all panels {np.mean([p for p, _ in whole]):.3f}"
        f"  all right {np.mean([r for _, r in whole]):.3f}  {np.mean(seconds):.2f} CPU s"
    )


def _compared(truth: list[Mark], ours: tuple[Panel, ...]) -> tuple[Array, tuple[bool, bool]]:
    """Counts of one front, and whether all panels and everything on them are right."""
    iou = np.array([[polygon_iou(t.quad, corners_of(p.box)) for p in ours] for t in truth])
    pairs = match(iou.reshape(len(truth), -1), 0.5)
    kinds = sum(
        ours[o].kind == truth[t].kind
        and (truth[t].kind != "door" or ours[o].hinge_side == truth[t].hinge)
        for t, o in pairs
    )
    handles = [quad for t in truth for quad in t.handles]
    seen = [corners_of(b.box) for p in ours for b in p.handles if b.provenance != "assumed"]
    hit, good = handle_hits(handles, seen)
    panels = len(pairs) == len(truth) == len(ours)
    right = panels and kinds == len(pairs) and hit == len(handles) and good == len(seen)
    counts = (len(truth), len(ours), len(pairs), kinds, len(handles), len(seen), hit, good)
    return np.array(counts, float), (panels, right)


if __name__ == "__main__":
    main(tyro.cli(Arguments))
