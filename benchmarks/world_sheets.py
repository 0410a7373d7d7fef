"""Contact sheets of the procedural world, one PNG per category: closed above, opened below.

    python benchmarks/world_sheets.py OUT [--only safe oven] [--seeds 40 41 42 43] [--fused]

The pictures show the meshes as a user gets them, in the styles that belong to the seeds, posed by
their exact joints: a part that is not cut where it should be, or that opens the wrong way, is seen.
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mam_pipeline.render.mesh_pictures import contact_sheet, posed, render_mesh
from mam_pipeline.types import Articulation
from mam_world import CATEGORIES, draw_style, make_object
from mam_world.object import generator

TURN = np.pi / 3
"""How far endless joints are turned in the opened picture, radians."""


def main() -> None:
    """Draw the sheets."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("out", type=Path)
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--seeds", type=int, nargs="*", default=[40, 41, 42, 43])
    parser.add_argument("--fused", action="store_true", help="one watertight surface each")
    parser.add_argument("--size", type=int, default=240, help="of one picture, pixels")
    args = parser.parse_args()
    args.out.mkdir(parents=True, exist_ok=True)
    for name in args.only or list(CATEGORIES):
        Image.fromarray(sheet(name, args.seeds, args.fused, args.size)).save(
            args.out / f"{name}.png"
        )


def sheet(name: str, seeds: list[int], fused: bool, size: int) -> NDArray[np.uint8]:
    """One column for every seed: the object closed, and opened below."""
    rows: tuple[list[NDArray[np.uint8]], list[NDArray[np.uint8]]] = ([], [])
    for seed in seeds:
        style = draw_style(generator(name, seed, stream=1))
        object_ = make_object(name, seed, replace(style, fused=style.fused or fused)).truth()
        for row, opened in zip(rows, (False, True)):
            row.append(render_mesh(posed(object_, pose(object_, opened)), (size, size)))
    return contact_sheet(rows[0] + rows[1], len(seeds))


def pose(articulation: Articulation, opened: bool) -> dict[str, float]:
    """Joint values, counted from the file's pose, at which everything is closed or open."""
    if not opened:
        return {j.name: j.closed for j in articulation.joints}
    return {
        j.name: j.closed + TURN if j.type == "continuous" else j.open for j in articulation.joints
    }


if __name__ == "__main__":
    main()
