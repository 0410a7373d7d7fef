"""make-env on every object of a ground-truth folder: asset valid, environment resets and steps.

Each object's links are merged into one static mesh at rest, written as GLB and given to the command
line, as a user would; then the environment takes 200 random actions. Prints a row per object.

    python benchmarks/make_env_on_bench.py DATASET [--only ID ...] [--fuse] [--keep FOLDER]

With --fuse each mesh is made one fused surface first, as a generator would give it, and written as
PLY. The assets stay in --keep, from where `expert_table.py` can go on.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import trimesh
import tyro
from common import save
from tyro.conf import Positional

from mam_envs.trial import try_environment
from mam_pipeline.asset.card import Asset
from mam_pipeline.formats.mesh_files import save_glb
from mam_pipeline.geometry.fuse import fuse_mesh
from mam_pipeline.types import Mesh
from mam_sim.cli import main as mam_sim
from mam_world.ground_truth import list_objects, read_object


def save_mesh(mesh: Mesh, stem: Path, fuse: bool) -> Path:
    """Write a mesh as GLB, or made one fused surface as PLY; the file."""
    if not fuse:
        save_glb(mesh, stem.with_suffix(".glb"))
        return stem.with_suffix(".glb")
    fused = fuse_mesh(mesh, 192, faces=60_000)
    made = trimesh.Trimesh(fused.vertices, fused.faces, vertex_colors=fused.colors, process=False)
    made.export(stem.with_suffix(".ply"))
    return stem.with_suffix(".ply")


def main(
    dataset: Positional[Path],
    /,
    only: tuple[str, ...] = (),
    steps: int = 200,
    fuse: bool = False,
    keep: Path | None = None,
    out: Path | None = None,
) -> None:
    """Run and print the table.

    Args:
        dataset: folder of ground-truth URDFs. only: these objects. steps: random actions.
        fuse: give each mesh as one fused surface. keep: folder in which the assets stay.
        out: JSON file for the rows.
    """
    done = stepped = passed = 0
    rows = []
    for name, category, urdf in list_objects(dataset):
        if only and name not in only:
            continue
        started = time.perf_counter()
        with tempfile.TemporaryDirectory() as scratch:
            folder = Path(scratch, "asset") if keep is None else keep / name
            mesh = save_mesh(read_object(urdf, name, category).mesh, Path(scratch, name), fuse)
            status = mam_sim(["make-env", str(mesh), "--out", str(folder), "--quiet"])
            note = f"exit {status}"
            if (folder / "asset.json").is_file():
                done += 1
                asset = Asset.load(folder)
                verdict = asset.card.checks["executability"]
                passed += bool(verdict["passed"])
                tried = try_environment(asset, "panda", steps=steps)
                stepped += bool(tried["ok"])
                note = f"{len(asset.card.joints)} joints, check "
                note += "passes" if verdict["passed"] else f"fails {verdict['reasons']}"
                stepping = f"{steps} steps" if tried["ok"] else f"no env: {tried['why']}"
                note += f", {stepping}"
        seconds = time.perf_counter() - started
        rows.append({"id": name, "status": status, "seconds": seconds, "note": note})
        print(f"{name:<36} {seconds:6.1f} s  {note}", flush=True)
    save(out, rows)
    print(
        f"{len(rows)} objects: {done} assets, {passed} pass the check, {stepped} environments step"
    )


if __name__ == "__main__":
    tyro.cli(main)
