"""make-env on every object of a ground-truth folder: asset valid, environment resets and steps.

Each object's links are merged into one static mesh at rest, written as GLB and given to the command
line, as a user would; then the environment takes 200 random actions. Prints a row per object.

    python benchmarks/make_env_on_bench.py DATASET [--only ID ...] [--fuse] [--keep FOLDER]

With --fuse each mesh is made one skin first, as a generator would give it, and written as PLY. The
assets stay in --keep, from where `expert_table.py` can go on.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

import trimesh

from mam_envs.trial import try_environment
from mam_pipeline.asset.card import Asset
from mam_pipeline.formats.mesh_files import save_glb
from mam_pipeline.geometry.fuse import fuse_mesh
from mam_pipeline.ground_truth import list_objects, read_object
from mam_pipeline.types import Mesh
from mam_sim.cli import main as mam_sim


def save_mesh(mesh: Mesh, stem: Path, fuse: bool) -> Path:
    """Write a mesh as GLB, or made one skin as PLY; the file."""
    if not fuse:
        save_glb(mesh, stem.with_suffix(".glb"))
        return stem.with_suffix(".glb")
    skin = fuse_mesh(mesh, 192, faces=60_000)
    made = trimesh.Trimesh(skin.vertices, skin.faces, vertex_colors=skin.colors, process=False)
    made.export(stem.with_suffix(".ply"))
    return stem.with_suffix(".ply")


def main() -> None:
    """Run and print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--fuse", action="store_true")
    parser.add_argument("--keep", type=Path)
    args = parser.parse_args()
    done = stepped = passed = count = 0
    for name, category, urdf in list_objects(args.dataset):
        if args.only and name not in args.only:
            continue
        count += 1
        started = time.perf_counter()
        with tempfile.TemporaryDirectory() as scratch:
            out = Path(scratch, "asset") if args.keep is None else args.keep / name
            mesh = save_mesh(read_object(urdf, name, category).mesh, Path(scratch, name), args.fuse)
            status = mam_sim(["make-env", str(mesh), "--out", str(out), "--quiet"])
            note = f"exit {status}"
            if status == 0:
                done += 1
                asset = Asset.load(out)
                verdict = asset.card.checks["executability"]
                passed += bool(verdict["passed"])
                tried = try_environment(asset, "panda", args.steps)
                stepped += bool(tried["ok"])
                note = f"{len(asset.card.joints)} joints, check "
                note += "passes" if verdict["passed"] else f"fails {verdict['reasons']}"
                stepping = f"{args.steps} steps" if tried["ok"] else f"no env: {tried['why']}"
                note += f", {stepping}"
        print(f"{name:<36} {time.perf_counter() - started:6.1f} s  {note}", flush=True)
    print(f"{count} objects: {done} assets, {passed} pass the check, {stepped} environments step")


if __name__ == "__main__":
    main()
