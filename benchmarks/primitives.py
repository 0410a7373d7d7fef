"""How good primitives are: the score of a perfect grouping of them.

    python benchmarks/primitives.py DATASET [--fuse] [--noise 0.0005] [--every 3] [--out FILE.json]

What they cost is told by `engine_scaling.py`, stage by stage.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from common import save
from mam_sim_bench.metrics import nearest_face
from tyro.conf import Positional

from mam_pipeline.geometry.fuse import fuse_mesh
from mam_pipeline.geometry.sampling import face_geometry
from mam_pipeline.segment.fused import cut, hierarchy
from mam_pipeline.segment.geometric import GeometricSegmenter
from mam_pipeline.segment.topology import topology
from mam_pipeline.types import FloatArray, IntArray, Mesh
from mam_world.ground_truth import GroundTruth, list_objects, read_object

CUTS = (10, 20, 40, 80, 160, 400)
INVISIBLE = 2e-4  # of the area: parts below it are left out of the bound


def bound(labels: IntArray, owner: IntArray, areas: FloatArray, links: int) -> float:
    """Mean IoU of the visible movable parts, each primitive given to its majority link."""
    votes = np.zeros((int(labels.max()) + 1, links))
    np.add.at(votes, (labels, owner), areas)
    given = votes.argmax(axis=1)[labels]
    out = []
    for k in range(1, links):
        if areas[owner == k].sum() > INVISIBLE * areas.sum():
            union = areas[(given == k) | (owner == k)].sum()
            out.append(areas[(given == k) & (owner == k)].sum() / union)
    return float(np.mean(out)) if out else 1.0


def measure_bound(
    dataset: Path, fuse: bool, noise: float, resolution: int, every: int
) -> list[dict[str, Any]]:
    """The bound per object: of the labels as delivered and, if fused, at several cuts."""
    rows, delivered, out = [], [], []
    for name, category, urdf in list_objects(dataset)[::every]:
        truth = read_object(urdf, name, category)
        mesh = fuse_mesh(truth.mesh, resolution, noise) if fuse else truth.mesh
        owner = _owner(truth, mesh, fuse)
        areas = face_geometry(mesh.vertices, mesh.faces)[1]
        began = time.perf_counter()
        got = GeometricSegmenter().segment(mesh)
        seconds = time.perf_counter() - began
        delivered.append(bound(got.labels, owner, areas, len(truth.links)))
        text = f"{name:38s} F={len(mesh.faces):7d} K={got.count:4d} {seconds:6.2f} s "
        text += f"bound {delivered[-1]:.3f}"
        if fuse:
            topo = topology(mesh)
            tree = hierarchy(topo, np.flatnonzero(topo.kept))
            row = []
            for count in CUTS:
                label, _ = cut(tree, count)
                ok = label >= 0
                row.append(bound(label[ok], owner[ok], areas[ok], len(truth.links)))
            rows.append(row)
            text += "  at " + " ".join(f"{c}:{v:.2f}" for c, v in zip(CUTS, row))
        print(text, flush=True)
        out.append({"id": name, "bound": delivered[-1], "seconds": seconds, "count": got.count})
    print(f"mean bound of the delivered labels: {np.mean(delivered):.3f}")
    if rows:
        print("mean at", dict(zip(CUTS, np.mean(rows, axis=0).round(3).tolist())))
    return out


def _owner(truth: GroundTruth, mesh: Mesh, fuse: bool) -> IntArray:
    if not fuse:
        return truth.face_link
    return truth.face_link[nearest_face(truth.mesh, mesh.vertices[mesh.faces].mean(axis=1))]


def main(
    dataset: Positional[Path],
    /,
    fuse: bool = False,
    noise: float = 0.0,
    resolution: int = 112,
    every: int = 1,
    out: Path | None = None,
) -> None:
    """Measure the bound on a dataset.

    Args:
        dataset: folder of ground-truth URDFs. every: take every so many of them.
        fuse: make each mesh one fused surface, of that resolution and noise (metres).
        out: JSON file for the rows.
    """
    save(out, measure_bound(dataset, fuse, noise, resolution, every))


if __name__ == "__main__":
    tyro.cli(main)
