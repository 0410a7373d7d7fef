"""Measures collision pieces on a folder of ground-truth URDFs: seconds, pieces and coverage.

    python benchmarks/collision_pieces.py DATASET [--only ID ...]

Coverage is the share of area-weighted surface points within 1 % of the diagonal of a piece.
"""

from __future__ import annotations

import argparse
import time

import numpy as np
import trimesh

from mam_pipeline.asset.collision import collision_shapes
from mam_pipeline.bench.dataset import list_objects, read_object
from mam_pipeline.geometry.raycast import RayScene
from mam_pipeline.geometry.sampling import sample_surface
from mam_pipeline.types import CollisionShape, FloatArray


def main() -> None:
    """Print a line per object, then medians over links."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("dataset")
    parser.add_argument("--only", nargs="*", default=[])
    args = parser.parse_args()
    seconds, pieces, shares = [], [], []
    for name, category, urdf in list_objects(args.dataset):
        if args.only and name not in args.only:
            continue
        truth = read_object(urdf, name, category).truth_articulation()
        start = time.process_time()
        shapes = collision_shapes(truth)
        spent = (time.process_time() - start) / len(shapes)
        covered = []
        for link in truth.links:
            if len(link.faces):
                faces = truth.mesh.faces[link.faces]
                points = sample_surface(truth.mesh.vertices, faces, 1000).points
                covered.append(_coverage(points, shapes[link.name], 0.01 * truth.mesh.diagonal))
        seconds.append(spent)
        pieces += [len(s) for s in shapes.values()]
        shares += covered
        print(f"{name}: {spent:.2f} s a link, {max(pieces[-len(shapes):])} pieces at most, "
              f"coverage {min(covered):.3f} at least", flush=True)  # fmt: skip
    print(
        f"median {np.median(seconds):.2f} s a link, {np.median(pieces):.0f} pieces (most "
        f"{max(pieces)}), coverage {np.mean(shares):.3f} (least {np.min(shares):.3f})"
    )


def _coverage(points: FloatArray, shapes: list[CollisionShape], reach: float) -> float:
    distance = np.full(len(points), np.inf)
    for shape in shapes:
        if shape.kind == "box":
            body = trimesh.creation.box(shape.size, transform=shape.pose)
        elif shape.kind == "cylinder":
            radius, length = shape.size[:2]
            body = trimesh.creation.cylinder(radius, length, 32, transform=shape.pose)
        else:
            body = trimesh.Trimesh(shape.vertices, shape.faces)
        scene = RayScene(np.asarray(body.vertices), np.asarray(body.faces, dtype=np.int64))
        distance = np.minimum(distance, scene.signed_distance(points))
    return float((distance < reach).mean())


if __name__ == "__main__":
    main()
