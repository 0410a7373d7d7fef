"""Contact sheets of the procedural world, one PNG per category: closed above, opened below.

    python scripts/world_sheets.py OUT [--only safe oven] [--seeds 40 41 42 43] [--fused]

The pictures show the meshes as a user gets them, in the styles that belong to the seeds, posed by
their exact joints: a part that is not cut where it should be, or that opens the wrong way, is seen.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import tyro
from numpy.typing import NDArray
from PIL import Image
from tyro.conf import Positional

from mam_pipeline.render.mesh_pictures import contact_sheet, posed, render_mesh
from mam_pipeline.types import Articulation
from mam_world import CATEGORIES, draw_style, make_object
from mam_world.object import generator

TURN = np.pi / 3
"""How far endless joints are turned in the opened picture, radians."""


def main(
    out: Positional[Path],
    /,
    only: tuple[str, ...] = (),
    seeds: tuple[int, ...] = (40, 41, 42, 43),
    fused: bool = False,
    size: int = 240,
) -> None:
    """Draw the sheets.

    Args:
        out: folder for them. only: these categories. seeds: one column each.
        fused: one watertight surface each. size: of one picture, pixels.
    """
    out.mkdir(parents=True, exist_ok=True)
    for name in only or CATEGORIES:
        Image.fromarray(sheet(name, seeds, fused, size)).save(out / f"{name}.png")


def sheet(name: str, seeds: tuple[int, ...], fused: bool, size: int) -> NDArray[np.uint8]:
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
    tyro.cli(main)
