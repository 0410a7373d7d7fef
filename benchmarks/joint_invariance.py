"""Do joints turn and scale with the object, whatever its triangles? On procedural objects.

    python benchmarks/joint_invariance.py [--objects 24] [--out FILE] [--seed 9]

Each object's true parts and types are given; every joint is solved on the mesh as it is and on
changed copies: turned about the vertical, tilted, scaled and moved, each triangle cut into four,
vertices welded, every face doubled. A joint agrees if its axis, carried along, is within 2 degrees
and its line within 1 % of the diagonal. The objects are of the world's test seeds.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import tyro
from common import save
from scipy.spatial.transform import Rotation

from mam_pipeline.geometry.boxes import angle_between
from mam_pipeline.joints.solver import EmbeddedSolver
from mam_pipeline.types import (
    Articulation,
    FloatArray,
    IntArray,
    Joint,
    KinematicTree,
    Mesh,
    PartNode,
    Primitives,
)
from mam_world import CATEGORIES, make_object
from mam_world.style import Style

Changed = tuple[Mesh, IntArray, FloatArray]


def tree_of(truth: Articulation) -> KinematicTree:
    """The true parts and subtypes as a reasoner would hand them over."""
    by_child = {j.child: j for j in truth.joints}
    nodes = [PartNode("base", "body", (0,), -1, "fixed")]
    for i in range(1, len(truth.links)):
        joint = by_child[i]
        nodes.append(PartNode(truth.links[i].name, "part", (i,), joint.parent, joint.subtype))
    return KinematicTree(tuple(nodes))


def moved(mesh: Mesh, label: IntArray, matrix: FloatArray) -> Changed:
    """The mesh under a similarity transform."""
    return mesh.transformed(matrix), label, matrix


def turn(angles: tuple[float, float, float], scale: float = 1.0) -> FloatArray:
    """(4, 4) rotation by Euler angles xyz in degrees, with scale and a shift."""
    out = np.eye(4)
    out[:3, :3] = scale * Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    out[:3, 3] = (0.3, -1.7, 0.2) if scale != 1.0 else 0.0
    return out


def cut_in_four(mesh: Mesh, label: IntArray) -> Changed:
    """Each triangle cut at the middles of its sides."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    ab, bc, ca = 0.5 * (a + b), 0.5 * (b + c), 0.5 * (c + a)
    corners = np.stack([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]])  # (4, 3, F, 3)
    vertices = corners.transpose(2, 0, 1, 3).reshape(-1, 3)
    faces = np.arange(len(vertices)).reshape(-1, 3)
    return Mesh(vertices, faces), np.repeat(label, 4), np.eye(4)


def welded(mesh: Mesh, label: IntArray) -> Changed:
    """Vertices at the same place become one."""
    key = np.round(mesh.vertices / (1e-6 * mesh.diagonal)).astype(np.int64)
    _, first, inverse = np.unique(key, axis=0, return_index=True, return_inverse=True)
    return Mesh(mesh.vertices[first], inverse.reshape(-1)[mesh.faces]), label, np.eye(4)


def doubled(mesh: Mesh, label: IntArray) -> Changed:
    """Every face a second time, reversed."""
    faces = np.concatenate([mesh.faces, mesh.faces[:, ::-1]])
    return Mesh(mesh.vertices, faces), np.concatenate([label, label]), np.eye(4)


CHANGES: dict[str, Callable[[Mesh, IntArray], Changed]] = {
    "yaw": lambda m, f: moved(m, f, turn((0, 0, 37.0))),
    "tilt": lambda m, f: moved(m, f, turn((4.0, -3.0, 0))),
    "scale": lambda m, f: moved(m, f, turn((0, 0, 0), 13.7)),
    "cut in four": cut_in_four,
    "welded": welded,
    "double-sided": doubled,
}


def agreement(before: Joint, after: Joint, matrix: FloatArray, mesh: Mesh) -> tuple[float, float]:
    """Angle in degrees and distance of lines in diagonals (0 for slides), after the transform."""
    scale = float(np.cbrt(np.linalg.det(matrix[:3, :3])))
    axis = matrix[:3, :3] @ before.axis / scale
    degrees = float(np.degrees(angle_between(axis, after.axis)))
    if before.type == "prismatic":
        return degrees, 0.0
    offset = matrix[:3, :3] @ before.origin + matrix[:3, 3] - after.origin
    offset = offset - (offset @ after.axis) * after.axis
    return degrees, float(np.linalg.norm(offset)) / (scale * mesh.diagonal)


def main(objects: int = 24, seed: int = 9, out: Path | None = None) -> None:
    """Run and print one line per kind of change.

    Args:
        objects: how many. seed: of them; 9, 19, 29 ... are test seeds.
        out: JSON file for the figures.
    """
    warnings.filterwarnings("ignore")
    names = list(CATEGORIES)
    chosen = [names[i] for i in np.linspace(0, len(names) - 1, objects).astype(int)]
    found: dict[str, list[tuple[float, float]]] = {name: [] for name in CHANGES}
    begun = time.perf_counter()
    for name in chosen:
        truth = make_object(name, seed, replace(Style(), gap=0.002)).truth()
        label, tree, solver = truth.face_link, tree_of(truth), EmbeddedSolver()
        first = solver.solve(truth.mesh, Primitives(label), tree).joints
        for change, make in CHANGES.items():
            mesh, changed_label, matrix = make(truth.mesh, label)
            second = solver.solve(mesh, Primitives(changed_label), tree).joints
            found[change] += [
                agreement(a, b, matrix, truth.mesh)
                for a, b in zip(first, second) if a.type != "fixed"
            ]  # fmt: skip
    rows = {}
    for change, pairs in found.items():
        v = np.array(pairs)
        good = (v[:, 0] < 2.0) & (v[:, 1] < 0.01)
        rows[change] = {
            "joints": len(v), "agree": float(good.mean()), "axis": float((v[:, 0] < 2.0).mean()),
            "line": float((v[:, 1] < 0.01).mean()),
            "degrees_p95": float(np.quantile(v[:, 0], 0.95)),
        }  # fmt: skip
        print(change, {k: round(x, 3) for k, x in rows[change].items()})
    print(f"{len(chosen)} objects, {time.perf_counter() - begun:.0f} s")
    save(out, rows)


if __name__ == "__main__":
    tyro.cli(main)
