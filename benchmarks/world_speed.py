"""Measures how fast the procedural world makes objects, per category and in total.

    OMP_NUM_THREADS=1 python benchmarks/world_speed.py [--seeds 4] [--only safe oven] [--write]

Times are processor seconds of one core (a busy machine does not change them), without textures
and without fused meshes, which cost about a second each. `made` is the exact object with its
static mesh, as training draws it; with --write, `written` adds what `mam-sim generate
--no-textures` puts on the disk: the static GLB, the URDF with its meshes, and the card.
"""

from __future__ import annotations

import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import tyro
from common import save

from mam_world import CATEGORIES, draw_style, make_object
from mam_world.dataset import write_object
from mam_world.object import generator


def main(
    seeds: int = 4,
    start: int = 0,
    only: tuple[str, ...] = (),
    write: bool = False,
    out: Path | None = None,
) -> None:
    """Print one line per category, then the totals.

    Args:
        seeds: objects of each category. start: the first seed. only: these categories.
        write: also write each object to the disk.
        out: JSON file for the seconds by category.
    """
    made, written = [], []
    rows = {}
    make_object("safe", 0)  # imports are not counted
    for name in only or CATEGORIES:
        times = np.array([one(name, seed, write) for seed in range(start, start + seeds)])
        rows[name] = {"made_s": times[:, 0].mean(), "written_s": times[:, 1].mean()}
        made.append(times[:, 0])
        written.append(times[:, 1])
        line = f"{name:<24} {1 / times[:, 0].mean():7.1f} made/s"
        line += f" {1 / times[:, 1].mean():7.1f} written/s" if write else ""
        print(line, flush=True)
    text = f"{len(made)} categories, {np.size(made)} objects: {rate(made)}"
    print(text + (f"; written: {rate(written)}" if write else ""))
    save(out, rows)


def one(name: str, seed: int, write: bool) -> tuple[float, float]:
    """Seconds to make one object with its static mesh, and to write it as well."""
    style = replace(draw_style(generator(name, seed, stream=1)), fused=False, textures=False)
    began = time.process_time()
    object_ = make_object(name, seed, style)
    faces = len(object_.static.faces)
    made = time.process_time() - began
    assert faces > 0
    if not write:
        return made, made
    with tempfile.TemporaryDirectory() as folder:
        began = time.process_time()
        write_object(object_, Path(folder))
        return made, made + time.process_time() - began


def rate(times: list[np.ndarray]) -> str:
    """Objects a second on one core and, at twice that, on two; the slowest and fastest kinds."""
    every = np.concatenate(times)
    per_kind = 1 / np.array([t.mean() for t in times])
    one_core = 1 / every.mean()
    return (f"{one_core:.1f} objects/s on one core, {2 * one_core:.1f} on two "
            f"(categories from {per_kind.min():.1f} to {per_kind.max():.1f} on one)")  # fmt: skip


if __name__ == "__main__":
    tyro.cli(main)
