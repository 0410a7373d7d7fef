"""How well an object's front is found in photos that no network was trained on.

The photos are those of README's table; where a vision-language model said the corners of a closed
front (tests/pipeline/answers_photos.zip), a front whose IoU with them is 0.75 or more is right.
With --other, the fronts of other weights of the same network are compared: how far a training on
another machine agrees.

    python benchmarks/box_reading.py ../shared/corpus/photos [--other build/weights/photo/box]
"""

from __future__ import annotations

import json
import zipfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro
from numpy.typing import NDArray
from tyro.conf import Positional

from mam_pipeline.photo.box_network import WEIGHTS, look_at_photo
from mam_pipeline.photo.cuboid import fit_cuboid
from mam_pipeline.photo.find import evidence_of
from mam_pipeline.photo.image import Photo, read_photo
from mam_pipeline.photo.score import polygon_iou

ANSWERS = Path(__file__).parent.parent / "tests" / "pipeline" / "answers_photos.zip"
RIGHT = 0.75


@dataclass(frozen=True)
class Arguments:
    """Folder of the photos, as ID.jpg; folder of other weights."""

    photos: Positional[Path]
    other: Path | None = None


def front(photo: Photo, weights: Path) -> NDArray[np.float64]:
    """(4, 2) corners of the front, small pixels."""
    maps = look_at_photo(photo.small, weights)
    return fit_cuboid(evidence_of(photo, maps, (0, 0, *photo.size))).quad("front")


def main(arguments: Arguments) -> None:
    """Print a line for each network, and one on how far they agree."""
    networks = [WEIGHTS] + ([arguments.other / WEIGHTS.name] if arguments.other else [])
    right, alike = np.zeros(len(networks), int), []
    known = 0
    with zipfile.ZipFile(ANSWERS) as kept:
        for name in sorted(n for n in kept.namelist() if n.endswith("/photo/answer.json")):
            file = arguments.photos / f"{name.split('/')[0]}.jpg"
            if not file.is_file():
                continue
            photo, said = read_photo(file), json.loads(kept.read(name))
            fronts = [front(photo, weights) for weights in networks]
            alike.append(polygon_iou(fronts[0], fronts[-1]))
            if said["in_scope"] and not said.get("opened"):
                true = np.array(said["front"]) / 1000 * photo.size
                known += 1
                right += [polygon_iou(quad, true) >= RIGHT for quad in fronts]
    for weights, count in zip(networks, right):
        print(f"{count} of {known} fronts right: {weights}")
    if arguments.other:
        half, most = np.quantile(alike, [0.5, 0.1])
        print(f"{len(alike)} photos: overlap {half:.2f} in the median, {most:.2f} for nine in ten")


if __name__ == "__main__":
    main(tyro.cli(Arguments))
