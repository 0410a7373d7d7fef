"""Task success of the truth, of ours, of the initialisation alone and of a naive baseline.

    python benchmarks/rank_baseline.py DATASET --only ID ... --keep FOLDER --out FILE.json
    python benchmarks/rank_baseline.py DATASET --synthesizer ... --keep FOLDER

All but the truth start from the same static mesh: the object's links merged at rest. *naive* makes
every component of the mesh a door, hinged at the left edge of its box; the largest is the base.
With --synthesizer, objects of the package scene-synthesizer are ranked as they come, too. What is
in --keep is not made or measured again. The measure is that of `mam-sim rank`.
"""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import trimesh
import tyro
from common import save
from tyro.conf import Positional

from mam_pipeline.asset.writer import write_asset
from mam_pipeline.errors import MamSimError
from mam_pipeline.formats.mesh_files import load_mesh, save_glb
from mam_pipeline.ground_truth import list_objects, read_object
from mam_pipeline.run import EngineConfig, MakeConfig, make_asset
from mam_pipeline.types import Articulation, Joint, Link, Mesh
from mam_sim.forkserver import Limits
from mam_sim.rank.measure import Measure, total
from mam_sim.rank.run import attempts, examine, measured

SPECK = 0.005
"""A component with less than this share of the surface belongs to the base."""
SYNTHETIC = ("Microwave", "Refrigerator", "Dishwasher", "Range", "HandWheel")


def naive(mesh: Mesh) -> Articulation:
    """Every component a door.

    Args:
        mesh: asset frame.
    """
    plain = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    merged = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    merged.merge_vertices(merge_tex=True, merge_norm=True)
    label = trimesh.graph.connected_component_labels(merged.face_adjacency, len(merged.faces))
    areas = np.bincount(label, plain.area_faces)
    moving = [i for i in np.argsort(-areas)[1:] if areas[i] > SPECK * areas.sum()]
    links = [Link("base", "base", np.flatnonzero(~np.isin(label, moving)))]
    joints = []
    for k, i in enumerate(moving):
        faces = np.flatnonzero(label == i)
        points = mesh.vertices[mesh.faces[faces]].reshape(-1, 3)
        low, high = points.min(axis=0), points.max(axis=0)
        links.append(Link(f"part_{k}", "door", faces))
        origin = np.array([low[0], high[1], 0.5 * (low[2] + high[2])])
        joints.append(Joint(f"part_{k}_joint", "revolute", "hinge", 0, k + 1,
                            np.array([0.0, 0.0, -1.0]), origin, 0.0, np.pi / 2,
                            closed=0.0, open=np.pi / 2))  # fmt: skip
    return Articulation(mesh, tuple(links), tuple(joints))


def made(name: str, mesh: Path, keep: Path) -> dict[str, Path | None]:
    """Assets of one mesh by each way; None where a way refuses it."""
    out: dict[str, Path | None] = {}
    ours = MakeConfig()
    init = replace(ours, engine=EngineConfig(solver="init"))
    for way, config in (("ours", ours), ("initialisation alone", init)):
        folder = keep / way / name
        try:
            if not (folder / "asset.json").is_file():
                make_asset(mesh, folder, config)
            out[way] = folder
        except MamSimError:
            out[way] = None
    folder = keep / "naive" / name
    try:
        if not (folder / "asset.json").is_file():
            write_asset(naive(load_mesh(mesh).mesh), folder, name=name)
        out["naive"] = folder
    except MamSimError:
        out["naive"] = None
    return out


def synthetic(keep: Path) -> list[Path]:
    """URDFs of an independent generator, as it writes them."""
    from scene_synthesizer import procedural_assets

    out = []
    for kind in SYNTHETIC:
        file = keep / "synthesizer" / kind / f"{kind.lower()}.urdf"
        if not file.is_file():
            file.parent.mkdir(parents=True, exist_ok=True)
            scene = getattr(procedural_assets, f"{kind}Asset")().scene(kind.lower())
            scene.export(str(file))
        out.append(file)
    return out


def main(
    dataset: Positional[Path],
    /,
    only: tuple[str, ...] = (),
    keep: Path = Path("rank-baseline"),
    robot: str = "panda",
    episodes: int = 3,
    jobs: int = 1,
    synthesizer: bool = False,
    out: Path | None = None,
) -> None:
    """Make, measure and print a line per way.

    Args:
        dataset: folder of ground-truth URDFs. only: ids of objects.
        keep: folder for assets and rows. robot: name of the arm.
        episodes: of every joint. jobs: processes.
        synthesizer: also objects of scene-synthesizer. out: JSON file for the sums and rows.
    """
    paths: dict[str, list[Path | None]] = {}
    (keep / "meshes").mkdir(parents=True, exist_ok=True)
    for name, category, urdf in list_objects(dataset):
        if only and name not in only:
            continue
        mesh = keep / "meshes" / f"{name}.glb"
        if not mesh.is_file():
            save_glb(read_object(urdf, name, category).mesh, mesh)
        for way, folder in {"truth": urdf, **made(name, mesh, keep)}.items():
            paths.setdefault(way, []).append(folder)
    if synthesizer:
        paths["scene-synthesizer"] = list(synthetic(keep))
    result = {}
    for way, found in paths.items():
        there = [p for p in found if p is not None]
        limits, measure = Limits(), Measure(episodes=episodes)
        verdicts = examine(there, keep / "rank", jobs, limits)
        tasks = attempts(there, verdicts, [robot], measure, "none", keep / "rank", limits)
        rows = measured(tasks, jobs)
        sums = total(verdicts, rows, robot, episodes)
        result[way] = {"refused": len(found) - len(there), "total": asdict(sums),
                       "rows": [asdict(r) for r in rows]}  # fmt: skip
        print(f"{way:<22} {len(found)} objects, {sums.check} pass, {sums.joints} joints, "
              f"{sums.tried} tried, success {sums.success.line()}, on tried "
              f"{sums.on_tried.line()}", flush=True)  # fmt: skip
        save(out, result)


if __name__ == "__main__":
    tyro.cli(main)
