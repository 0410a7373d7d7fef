"""A data set of procedural objects on disk: asset folders with exact truth, and a manifest."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from hashlib import sha256
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from mam_pipeline import folders
from mam_pipeline.asset.writer import write_asset
from mam_pipeline.errors import ConfigError
from mam_pipeline.evidence.read import named_size
from mam_pipeline.formats.mesh_files import save_glb
from mam_world import CATEGORIES, Style, WorldObject, draw_style, make_object, split_of
from mam_world.object import generator
from mam_world.registry import category as find

COLUMNS = (
    "name", "category", "seed", "split", "links", "joints", "faces", "fused", "unit", "y_up",
    "sha256_static",
)  # fmt: skip


def write_dataset(
    category: str,
    count: int,
    seed: int,
    out: Path,
    textures: bool = True,
    plain: bool = False,
    jobs: int = 1,
    on_object: Callable[[list[object]], None] = lambda _row: None,
) -> list[list[object]]:
    """Write objects as asset folders with static.glb in them, and a MANIFEST.csv.

    Args:
        category: one category, or "all": then `count` objects of each.
        count: how many objects of each category.
        seed: of the first object; the others follow. The same seed gives the same bytes.
        out: the folder to write.
        textures: draw procedural pictures on the materials.
        plain: no styles: the static file is the exact object. All are written as glTF has it:
            metres, +Y up, and with +Z in front where the object is not turned.
        jobs: processes; the files do not depend on how many.
        on_object: called with every row of the manifest when its object is written.

    Returns:
        The rows of the manifest, in the order of `COLUMNS`.

    Raises:
        ConfigError: no such category, or a number out of its range.
    """
    if jobs < 1:
        raise ConfigError(f"--jobs must be at least 1, got {jobs}")
    if count < 1 or seed < 0:
        raise ConfigError(f"count must be at least 1 and seed at least 0, not {count} and {seed}")
    names = list(CATEGORIES) if category == "all" else [find(category).name]
    rows = []
    plan = [(n, k) for n in names for k in range(seed, seed + count)]
    with folders.used_folder(out):
        fresh = not (out / "MANIFEST.csv").exists()
        if fresh:
            _write_manifest(out, [])  # whose folder it is, should this be killed
        try:
            for row in _rows(plan, out, textures, plain, jobs):
                rows.append(row)
                on_object(row)
        except BaseException:
            if fresh and not rows:
                (out / "MANIFEST.csv").unlink(missing_ok=True)
            raise
        _write_manifest(out, rows)
    return rows


def _write_manifest(out: Path, rows: list[list[object]]) -> None:
    """Write the table of all objects, all or nothing."""
    with (
        folders.new_file(out / "MANIFEST.csv") as part,
        part.open("w", newline="", encoding="utf-8") as file,
    ):
        table = csv.writer(file, lineterminator="\n")
        table.writerow(COLUMNS)
        table.writerows(rows)


def _rows(
    plan: list[tuple[str, int]], out: Path, textures: bool, plain: bool, jobs: int
) -> Iterator[list[object]]:
    """Write the planned objects, in this process or in several; rows come in the plan's order."""
    if jobs == 1:
        yield from (_write(name, seed, out, textures, plain) for name, seed in plan)
        return
    # fresh processes: forked ones inherit locks of the ray caster's threads
    with ProcessPoolExecutor(min(jobs, len(plan)), get_context("spawn")) as pool:
        tasks = [pool.submit(_write, name, seed, out, textures, plain) for name, seed in plan]
        for task in tasks:
            yield task.result()


def _write(name: str, seed: int, out: Path, textures: bool, plain: bool) -> list[object]:
    """Make one object and write its folder; returns its row of the manifest."""
    style = Style() if plain else draw_style(generator(name, seed, stream=1))
    # glTF fixes both: +Y is up and the unit is the metre
    style = replace(style, textures=textures, y_up=True, unit="m")
    return write_object(make_object(name, seed, style), out)


def write_object(made: WorldObject, out: Path) -> list[object]:
    """One asset folder in `out` with static.glb in it; returns its row of the manifest."""
    folder = out / made.name
    to_asset = np.linalg.inv(made.static_T_asset)
    with folders.work_folder(folder) as work:
        loose = work / "static.glb"
        # the mesh is in the file's own axes already: nothing is turned on the way
        save_glb(made.static, loose, up="z")
        digest = sha256(loose.read_bytes()).hexdigest()
        asset = write_asset(
            made.articulation, work / made.name, name=made.name,
            source={"path": "static.glb", "sha256": digest, "kind": "generated"},
            source_to_asset=to_asset,
            metres_per_unit=float(np.cbrt(np.linalg.det(to_asset[:3, :3]))),
            metres_per_unit_source="generated", collision=made.collision,
            thing=named_size(made.category.replace("_", " "))[0],
        )  # fmt: skip
        # no seconds in the card: the same seed gives the same bytes
        replace(asset.card, seconds={}).save(asset.folder)
        loose.rename(asset.folder / "static.glb")
        folders.put_in_place(asset.folder, folder)
    return [
        made.name, made.category, made.seed, split_of(made.category, made.seed),
        len(made.articulation.links), len(made.articulation.joints), len(made.static.faces),
        int(made.style.fused), made.style.unit, int(made.style.y_up), digest,
    ]  # fmt: skip
