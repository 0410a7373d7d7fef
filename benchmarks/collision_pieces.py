"""Measures collision pieces: seconds, number, coverage, and overlap along the joints.

    python benchmarks/collision_pieces.py DATASET [--only ID ...] [--limit N]

DATASET is a folder of ground-truth URDFs, or generated:train. Coverage is the share of
area-weighted surface points of an object that lie within 1 % of its diagonal of a piece of their
own link. Overlap is the share of a moving part's surface points that are deeper than 1 % of the
diagonal inside other links, the worst of seven joint values and of all joints: inside their pieces,
and inside their mesh.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import trimesh

from mam_pipeline.asset.collision import collision_shapes, outside
from mam_pipeline.asset.dynamics import carried_links
from mam_pipeline.asset.surface import Solid, link_components
from mam_pipeline.bench.runner import find_tasks
from mam_pipeline.geometry.raycast import RayScene
from mam_pipeline.geometry.sampling import sample_surface
from mam_pipeline.types import Articulation, CollisionShape, FloatArray, joint_motion


def main() -> None:
    """Print a line per object, then the totals."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("dataset")
    parser.add_argument("--only", nargs="*", default=[])
    parser.add_argument("--limit", type=int, default=None)
    args = parser.parse_args()
    seconds, pieces, shares, worse = [], [], [], 0
    for task in find_tasks(args.dataset, args.only, args.limit):
        truth = task.load().truth_articulation()
        start = time.process_time()
        shapes = collision_shapes(truth)
        spent = (time.process_time() - start) / len(shapes)
        share = _covered(truth, shapes)
        ours, meshes = _overlap(truth, shapes)
        seconds.append(spent)
        pieces += [len(s) for s in shapes.values()]
        shares.append(share)
        worse += ours > meshes + 0.005
        print(f"{task.id}: {spent:.2f} s a link, {max(pieces[-len(shapes):])} pieces at most, "
              f"coverage {share:.3f}, "
              f"overlap {ours:.3f} (mesh {meshes:.3f})", flush=True)  # fmt: skip
    print(
        f"{len(shares)} objects: median {np.median(seconds):.2f} s a link, "
        f"{np.median(pieces):.0f} pieces (most {max(pieces)}); "
        f"coverage mean {np.mean(shares):.3f}, least {np.min(shares):.3f}, "
        f"{sum(s >= 0.98 for s in shares)} of {len(shares)} reach 0.98; "
        f"{worse} overlap more than their mesh"
    )


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
    truth: Articulation, shapes: dict[str, list[CollisionShape]]
) -> tuple[float, float]:
    """Worst overlap along any joint: of pieces with pieces, and of mesh with mesh."""
    mesh, worst, worst_mesh = truth.mesh, 0.0, 0.0
    deep = 0.01 * mesh.diagonal
    for joint in truth.joints:
        carried = carried_links(truth, joint)
        others = [i for i in range(len(truth.links)) if i not in carried]
        theirs = [_planes(s) for i in others for s in shapes[truth.links[i].name]]
        faces = np.concatenate([truth.links[i].faces for i in carried])
        if joint.type == "fixed" or not theirs or not len(faces):
            continue
        points = sample_surface(mesh.vertices, mesh.faces[faces], 600).points
        solids = [Solid(link_components(truth, i)) for i in others]
        rest = np.concatenate([truth.links[i].faces for i in others])
        scene = RayScene(mesh.vertices, mesh.faces[rest])
        low = joint.lower if np.isfinite(joint.lower) else -np.pi
        high = joint.upper if np.isfinite(joint.upper) else np.pi
        for q in np.linspace(low, high, 7):
            m = joint_motion(joint.type, joint.axis, joint.origin, float(q))
            at = points @ m[:3, :3].T + m[:3, 3]
            depth = np.max([-(at @ n.T + d).max(axis=1) for n, d in theirs], axis=0)
            worst = max(worst, float((depth > deep).mean()))
            inside = np.any([s.contains(at) for s in solids], axis=0)
            worst_mesh = max(worst_mesh, float((inside & (scene.distance(at) > deep)).mean()))
    return worst, worst_mesh


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
    main()
