"""Measures collision pieces: seconds, number, coverage, and overlap along the joints.

    python benchmarks/collision_pieces.py DATASET [--only ID ...] [--limit N]

DATASET is a folder of ground-truth URDFs, or generated:train. Coverage is the share of
area-weighted surface points of an object that lie within 1 % of its diagonal of a piece of their
own link. Overlap is the share of a moving part's surface points that are deeper than 1 % of the
diagonal inside other links, the worst of seven joint values and of all joints: inside their pieces,
and inside their mesh; first between links that a simulator lets collide, then with the link that
the part hangs on as well, whose contacts simulators leave out.
"""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import trimesh
import tyro
from common import save
from mam_sim_bench.runner import find_tasks
from tyro.conf import Positional

from mam_pipeline.asset.collision import collision_shapes, outside
from mam_pipeline.geometry.raycast import RayScene
from mam_pipeline.geometry.sampling import sample_surface
from mam_pipeline.geometry.surface import Solid, link_components
from mam_pipeline.types import Articulation, CollisionShape, FloatArray, Joint, joint_motion


def main(
    dataset: Positional[str],
    /,
    only: tuple[str, ...] = (),
    limit: int | None = None,
    out: Path | None = None,
) -> None:
    """Print a line per object, then the totals.

    Args:
        dataset: folder of ground-truth URDFs, or generated:train.
        only: these objects. limit: so many objects at most.
        out: JSON file for the figures.
    """
    seconds, pieces, shares, worse, rows = [], [], [], [0, 0], []
    for task in find_tasks(dataset, only, limit):
        truth = task.load().truth_articulation()
        start = time.process_time()
        shapes = collision_shapes(truth)
        spent = (time.process_time() - start) / len(shapes)
        share = _covered(truth, shapes)
        both = [_overlap(truth, shapes, joined) for joined in (False, True)]
        seconds.append(spent)
        pieces += [len(s) for s in shapes.values()]
        shares.append(share)
        worse = [n + (a > b + 0.005) for n, (a, b) in zip(worse, both)]
        rows.append({"id": task.id, "seconds": spent, "coverage": share, "overlap": both})
        overlaps = ", ".join(f"{a:.3f} (mesh {b:.3f})" for a, b in both)
        print(f"{task.id}: {spent:.2f} s a link, {max(pieces[-len(shapes):])} pieces at most, "
              f"coverage {share:.3f}, overlap {overlaps}", flush=True)  # fmt: skip
    print(
        f"{len(shares)} objects: median {np.median(seconds):.2f} s a link, "
        f"{np.median(pieces):.0f} pieces (most {max(pieces)}); "
        f"coverage mean {np.mean(shares):.3f}, least {np.min(shares):.3f}, "
        f"{sum(s >= 0.98 for s in shares)} of {len(shares)} reach 0.98; "
        f"{worse[0]} overlap more than their mesh where links collide, {worse[1]} with the link "
        "that a part hangs on"
    )
    save(out, rows)


def _covered(truth: Articulation, shapes: dict[str, list[CollisionShape]]) -> float:
    """Share of the whole surface within 1 % of the diagonal of its own link's pieces."""
    covered, area = 0.0, 0.0
    for link in truth.links:
        if len(link.faces):
            found = sample_surface(truth.mesh.vertices, truth.mesh.faces[link.faces], 1000)
            own = _coverage(found.points, shapes[link.name], 0.01 * truth.mesh.diagonal)
            covered, area = covered + own * found.area, area + found.area
    return covered / max(area, 1e-12)


def _overlap(
    truth: Articulation, shapes: dict[str, list[CollisionShape]], joined: bool
) -> tuple[float, float]:
    """Worst overlap along any joint: of pieces with pieces, and of mesh with mesh.

    Args:
        joined: also with the link that a part hangs on, whose contacts simulators leave out.
    """
    worst, worst_mesh = 0.0, 0.0
    tied = {frozenset((j.parent, j.child)) for j in truth.joints}
    for joint in truth.joints:
        carried = truth.carried_links(joint)
        others = [i for i in range(len(truth.links)) if i not in carried]
        if joint.type == "fixed":
            continue
        low = joint.lower if np.isfinite(joint.lower) else -np.pi
        high = joint.upper if np.isfinite(joint.upper) else np.pi
        values = np.linspace(low, high, 7)
        found = [
            _deep(truth, shapes, joint, link, against, values)
            for link in carried
            if (against := [k for k in others if joined or frozenset((link, k)) not in tied])
        ]
        if found:
            size = sum(n for n, _, _ in found)
            worst = max(worst, float(np.max(sum(a for _, a, _ in found))) / max(size, 1))
            worst_mesh = max(worst_mesh, float(np.max(sum(b for _, _, b in found))) / max(size, 1))
    return worst, worst_mesh


def _deep(
    truth: Articulation, shapes: dict[str, list[CollisionShape]], joint: Joint, link: int,
    others: list[int], values: FloatArray,
) -> tuple[int, FloatArray, FloatArray]:  # fmt: skip
    """Surface points of a link, and at each joint value how many of them are deep in other links:
    in their pieces, and in their mesh."""
    mesh, deep = truth.mesh, 0.01 * truth.mesh.diagonal
    theirs = [_planes(s) for i in others for s in shapes[truth.links[i].name]]
    faces = truth.links[link].faces
    rest = np.concatenate([truth.links[i].faces for i in others])
    if not len(faces) or not len(rest) or not theirs:
        return 0, np.zeros(len(values)), np.zeros(len(values))
    points = sample_surface(mesh.vertices, mesh.faces[faces], 600).points
    solids = [Solid(link_components(truth, i)) for i in others if len(truth.links[i].faces)]
    scene = RayScene(mesh.vertices, mesh.faces[rest])
    counts = []
    for q in values:
        m = joint_motion(joint.type, joint.axis, joint.origin, float(q))
        at = points @ m[:3, :3].T + m[:3, 3]
        depth = np.max([-(at @ n.T + d).max(axis=1) for n, d in theirs], axis=0)
        inside = np.any([s.contains(at) for s in solids], axis=0)
        counts.append(((depth > deep).sum(), (inside & (scene.distance(at) > deep)).sum()))
    table = np.asarray(counts, dtype=np.float64)
    return len(points), table[:, 0], table[:, 1]


def _body(shape: CollisionShape) -> trimesh.Trimesh:
    if shape.kind == "box":
        return trimesh.creation.box(shape.size, transform=shape.pose)
    if shape.kind == "cylinder":
        radius, length = (float(v) for v in shape.size[:2])
        return trimesh.creation.cylinder(radius, length, 32, transform=shape.pose)
    if shape.kind == "sphere":
        ball = trimesh.creation.icosphere(2, float(shape.size[0]))
        return ball.apply_transform(shape.pose)
    return trimesh.Trimesh(shape.vertices, shape.faces)


def _planes(shape: CollisionShape) -> tuple[FloatArray, FloatArray]:
    """(m, 3) normals and (m,) offsets of a piece, n . x + d <= 0 inside."""
    body = _body(shape)
    normals = np.asarray(body.face_normals)
    return normals, -np.einsum("ij,ij->i", normals, np.asarray(body.triangles[:, 0]))


def _coverage(points: FloatArray, shapes: list[CollisionShape], reach: float) -> float:
    distance = np.full(len(points), np.inf)
    for shape in shapes:
        distance = np.minimum(distance, outside(shape, points))
    return float((distance < reach).mean())


if __name__ == "__main__":
    tyro.cli(main)
