"""Time and peak memory of the whole engine, mesh to joints, against the number of faces.

    python benchmarks/engine_scaling.py [--category cabinet_two_door] [--seed 9] [--out FILE]

One procedural object with its triangles cut ever finer (same surface, same parts), from about ten
thousand to a million faces; each size runs in a fresh process, which tells its own peak memory.
Growth is at most linear when seconds per face do not rise.
"""

from __future__ import annotations

import resource
import time
import warnings
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import tyro
from common import save

from mam_pipeline.make_config import EngineConfig
from mam_pipeline.stages import Stages
from mam_pipeline.types import Mesh
from mam_world import make_object
from mam_world.style import Style


def refined(mesh: Mesh, target: int) -> Mesh:
    """The same surface with about `target` faces, edge to edge.

    Edges that are the longest of all their triangles are halved, the longest first, each with all
    its triangles: a vertex in the middle of a neighbour's edge would part the two.
    """
    vertices, index = np.unique(np.round(mesh.vertices, 9), axis=0, return_inverse=True)
    faces = index.reshape(-1)[mesh.faces]
    while len(faces) < target:
        ends = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
        edges, edge = np.unique(ends.reshape(-1, 2), axis=0, return_inverse=True)
        edge = edge.reshape(-1, 3)
        length = np.linalg.norm(vertices[edges[:, 0]] - vertices[edges[:, 1]], axis=1)
        rank = np.argsort(np.argsort(length, kind="stable"))
        side = rank[edge].argmax(axis=1)
        longest = edge[np.arange(len(faces)), side]
        users = np.bincount(edge.reshape(-1), minlength=len(edges))
        final = np.flatnonzero(np.bincount(longest, minlength=len(edges)) == users)
        final = final[np.argsort(-rank[final])]
        final = final[: np.searchsorted(np.cumsum(users[final]), target - len(faces)) + 1]
        middle = np.full(len(edges), -1)
        middle[final] = len(vertices) + np.arange(len(final))
        vertices = np.concatenate([vertices, vertices[edges[final]].mean(axis=1)])
        split = middle[longest] >= 0
        rows = np.flatnonzero(split)
        a, b, c = (faces[rows, (side[rows] + k) % 3] for k in range(3))
        m = middle[longest[rows]]
        halves = [np.stack([a, m, c], axis=1), np.stack([m, b, c], axis=1)]
        faces = np.concatenate([faces[~split], *halves])
    return Mesh(vertices, faces)


def one(category: str, seed: int, target: int) -> dict[str, float]:
    """Run the engine once on the refined object."""
    warnings.filterwarnings("ignore")
    truth = make_object(category, seed, replace(Style(), gap=0.002)).truth()
    mesh = refined(truth.mesh, target)
    engine = Stages(EngineConfig())
    begun = time.perf_counter()
    cpu = time.process_time()
    primitives = engine.segment(mesh)
    tree = engine.reason(mesh, primitives, engine.observe(mesh, primitives))
    joints = engine.solve(mesh, primitives, tree).joints
    return {
        "faces": len(mesh.faces), "seconds": time.perf_counter() - begun,
        "cpu_seconds": time.process_time() - cpu, "joints": len(joints),
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024,
        **{f"s_{k}": v for k, v in engine.seconds.items()},
    }  # fmt: skip


def main(
    category: str = "cabinet_two_door",
    seed: int = 9,
    sizes: tuple[int, ...] = (10_000, 100_000, 1_000_000),
    out: Path | None = None,
) -> None:
    """Run all sizes, each in its own process.

    Args:
        category: of the procedural object. seed: of it. sizes: faces.
        out: JSON file for the figures.
    """
    rows = []
    for size in sizes:
        with ProcessPoolExecutor(1, get_context("spawn")) as pool:
            rows.append(pool.submit(one, category, seed, size).result())
        print({k: round(v, 2) for k, v in rows[-1].items()})
    ratio = (rows[-1]["cpu_seconds"] / rows[0]["cpu_seconds"]) / (
        rows[-1]["faces"] / rows[0]["faces"]
    )
    print(f"growth against linear: {ratio:.2f} (1 is linear, less is better)")
    save(out, rows)


if __name__ == "__main__":
    tyro.cli(main)
