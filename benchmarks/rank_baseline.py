"""The public table: does a robot succeed on the truth, on ours, and on what is simpler than ours.

    python benchmarks/rank_baseline.py DEV generated:test SYNTHESIZER --keep FOLDER --out \
        docs/results/task_success.json

DEV is a folder of ground-truth URDFs, SYNTHESIZER what `scene_synthesizer_dataset.py` makes. Of
every object the surface at rest is written as one static mesh, without names and materials; its
size and up axis are told. Ways to an asset:

*the file itself* as its author wrote it; *true joints* written by our writer; *ours*; *the paper's
initialisation alone* (the same parts, `--engine.solver init`); *naive*: every component of the mesh
is a door, hinged at the left edge of its box, and the largest is the base.

The measure is that of `mam-sim rank`, twice: on the asset by itself, and with the true object in
its place (`--truth`). What is in --keep is not made or measured again.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import tyro
from common import commit
from mam_sim_bench.runner import GENERATED, Task, find_tasks
from tyro.conf import Positional

from mam_pipeline.asset.writer import write_asset
from mam_pipeline.errors import MamSimError
from mam_pipeline.formats.mesh_files import LoadedMesh, load_mesh, save_obj
from mam_pipeline.geometry.front import front_of, moved
from mam_pipeline.guarded import Limits
from mam_pipeline.make_config import EngineConfig, MakeConfig
from mam_pipeline.run import make_asset
from mam_pipeline.types import Articulation, Joint, Link, Mesh
from mam_sim.rank.measure import Measure, Share, Total, total
from mam_sim.rank.run import attempts, examine, joints_of_truth, measured
from mam_world.ground_truth import GroundTruth

SPECK = 0.05
"""A component with less than this share of the surface belongs to the base."""
TOLD = MakeConfig(up="z", scale=1.0, names=False)
"""What is told of every mesh."""
COLUMNS = {
    "objects": "d", "assets": "d", "pass the check": "d", "joints": "d", "tried": "d",
    "by itself": "s", "on the true object": "s", "of true joints": "s",
}  # fmt: skip


def naive(mesh: Mesh) -> Articulation:
    """Every component a door.

    Args:
        mesh: Z up.
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


@dataclass(frozen=True)
class Object:
    """One true object: its mesh file, and its URDF in the same frame, as our writer has it."""

    task: Task
    truth: GroundTruth
    mesh: Path
    urdf: Path

    @staticmethod
    def of(task: Task, keep: Path) -> Object:
        """Read or generate it, and write what is not there."""
        truth = task.load()
        mesh = keep / "meshes" / f"{task.id}.obj"
        folder = keep / "source" / task.id
        if not mesh.is_file():
            mesh.parent.mkdir(parents=True, exist_ok=True)
            save_obj(truth.mesh, mesh)
        if not (folder / "asset.json").is_file():
            write_asset(truth.truth_articulation(), folder, name=task.id)
        return Object(task, truth, mesh, folder / "object.urdf")


def _placed(made: Callable[[LoadedMesh], Articulation], of: Object, out: Path) -> None:
    """Write an articulation of the mesh file, placed and turned to the front as ours are."""
    got = load_mesh(of.mesh, up="z", scale=1.0)
    articulation = made(got)
    yaw = front_of(articulation, (0.0, -1.0, 0.0)).yaw
    place = yaw @ got.source_to_asset
    write_asset(moved(articulation, yaw), out, name=out.name, source_to_asset=place)


def _true(of: Object, out: Path) -> None:
    _placed(lambda got: moved(of.truth.truth_articulation(), got.source_to_asset), of, out)


def _naive(of: Object, out: Path) -> None:
    _placed(lambda got: naive(got.mesh), of, out)


def _ours(of: Object, out: Path) -> None:
    make_asset(of.mesh, out, TOLD)


def _initialised(of: Object, out: Path) -> None:
    make_asset(of.mesh, out, replace(TOLD, engine=EngineConfig(solver="init")))


WAYS: Mapping[str, Callable[[Object, Path], None]] = {
    "true joints": _true,
    "ours": _ours,
    "the paper's initialisation alone": _initialised,
    "naive": _naive,
}
ITSELF = "the file itself"
ORDER = (ITSELF, *WAYS)


def made(way: str, objects: Sequence[Object], keep: Path) -> list[tuple[Object, Path]]:
    """Assets of all objects by one way, without those that it refuses."""
    out = []
    for of in objects:
        folder = keep / way.replace(" ", "_").replace("'", "") / of.task.id
        refused = folder.with_suffix(".refused")
        if not (folder / "asset.json").is_file() and not refused.is_file():
            try:
                folder.parent.mkdir(parents=True, exist_ok=True)
                WAYS[way](of, folder)
            except MamSimError as error:
                refused.write_text(str(error))
        if not refused.is_file():
            out.append((of, folder))
    return out


@dataclass(frozen=True)
class Ranking:
    """How assets are measured."""

    keep: Path
    robot: str
    measure: Measure
    jobs: int

    def of(self, assets: Sequence[Path], truths: Sequence[Path]) -> Total:
        """The sums over assets, by themselves or (with truths) as the true objects."""
        limits = Limits(seconds=600.0)
        verdicts = examine(assets, self.keep, self.jobs, limits)
        tasks = attempts(assets, verdicts, [self.robot], self.measure, "none", self.keep, limits,
                         truths=truths)  # fmt: skip
        rows = measured(tasks, self.jobs)
        true = {v.name: joints_of_truth(t) for v, t in zip(verdicts, truths)} if truths else None
        return total(verdicts, rows, self.robot, self.measure.episodes, true)


def values(count: int, alone: Total, true: Total | None, all_true: int) -> dict[str, Any]:
    """A row of the table; `all_true`: episodes on all joints of all true objects."""
    said = {
        "objects": count, "assets": alone.assets, "pass the check": alone.check,
        "joints": alone.joints, "tried": alone.tried, "by itself": alone.success.line(),
    }  # fmt: skip
    if true is not None and true.of_true is not None:
        said["on the true object"] = true.success.line()
        said["of true joints"] = Share.of(true.of_true.successes, all_true).line()
    return said


def rows_of(
    dataset: str,
    tasks: Sequence[Task],
    ways: Sequence[str],
    ranking: Ranking,
    tell: Callable[[dict[str, Any]], None],
) -> None:
    """Make and measure some ways for one dataset; every row is told when it is known."""
    keep = ranking.keep
    objects = [Object.of(task, keep) for task in tasks]
    episodes = ranking.measure.episodes
    every = episodes * sum(len(joints_of_truth(o.urdf)) for o in objects)
    if ITSELF in ways and not dataset.startswith(GENERATED):
        files = [Path(task.source) for task in tasks]
        tell({"way": ITSELF, **values(len(files), ranking.of(files, ()), None, every)})
    for way in [way for way in WAYS if way in ways]:
        there = made(way, objects, keep)
        folders, truths = [f for _, f in there], [o.urdf for o, _ in there]
        alone = ranking.of(folders, ())
        if way == "true joints":
            said = values(len(objects), alone, None, every)
            said["of true joints"] = Share.of(alone.success.successes, every).line()
        else:
            said = values(len(objects), alone, ranking.of(folders, truths), every)
        tell({"way": way, **said})


def main(
    datasets: Positional[tuple[str, ...]],
    /,
    names: tuple[str, ...] = (),
    limit: tuple[int, ...] = (),
    keep: Path = Path("rank-baseline"),
    robot: str = "panda",
    episodes: int = 3,
    jobs: int = 2,
    out: Path | None = None,
) -> None:
    """Make, measure and print a line per dataset and way.

    Args:
        datasets: folders of ground-truth URDFs, or generated:test.
        names: of the datasets in the table, in their order; default: the words themselves.
        limit: objects of each dataset, in their order, evenly over its objects; 0: all.
        keep: folder for assets and rows. robot: name of the arm.
        episodes: of every joint. jobs: processes.
        out: JSON file in the form of docs/results/.
    """
    rows: dict[tuple[int, int], dict[str, Any]] = {}
    words = [f"{a} {' '.join(map(str, v))}" for a, v in (("--limit", limit),) if v]
    command = " ".join(["python benchmarks/rank_baseline.py", *shown(datasets), *words,
                        f"--episodes {episodes}"])  # fmt: skip
    shared = {"command": command, "commit": commit(), "machine": f"{os.cpu_count()} cores, no GPU"}
    parts = list(enumerate(datasets))
    # the many joints of the naive way come last
    for ways, (k, dataset) in [(ORDER[:-1], p) for p in parts] + [(ORDER[-1:], p) for p in parts]:
        name = names[k] if k < len(names) else dataset
        tasks = chosen(dataset, limit[k] if k < len(limit) else 0)
        ranking = Ranking(keep / f"{k}", robot, Measure(episodes=episodes), jobs)

        def tell(row: dict[str, Any], name: str = name, key: int = k) -> None:
            way = row.pop("way")
            print(f"{name}, {way}: {row}", flush=True)
            rows[key, ORDER.index(way)] = {
                "id": f"{key}-{way.replace(' ', '-')}", "name": f"{name}: {way}", "values": row,
                **shared,
            }  # fmt: skip
            if out is not None:
                table = {"title": "Task success", "columns": COLUMNS,
                         "rows": [rows[at] for at in sorted(rows)]}  # fmt: skip
                text = json.dumps(table, indent=1, ensure_ascii=False) + "\n"
                out.write_text(text, encoding="utf-8")

        rows_of(dataset, tasks, ways, ranking, tell)


def chosen(dataset: str, most: int) -> list[Task]:
    """Some objects of a dataset, evenly over all; a generated one has no end."""
    if dataset.startswith(GENERATED):
        return find_tasks(dataset, limit=most or 50)
    tasks = find_tasks(dataset)
    if not most or most >= len(tasks):
        return tasks
    return [tasks[i * len(tasks) // most] for i in range(most)]


def shown(datasets: Sequence[str]) -> list[str]:
    """Names of the datasets for a page: a folder's own name, in capitals."""
    return [d if d.startswith(GENERATED) else Path(d).name.upper() for d in datasets]


if __name__ == "__main__":
    tyro.cli(main)
