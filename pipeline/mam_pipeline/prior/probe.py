"""Surface samples of every primitive and what lies along six directions from each of them.

One bundle of rays, cast once, answers both questions of shape (from where is a primitive seen,
what encloses it) and of motion (how far may a group of primitives travel before it meets the
rest): a group's free travel is the nearest crossing that belongs to nobody in the group.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import open3d as o3d
from numpy.typing import NDArray

from mam_pipeline.geometry.sampling import face_geometry
from mam_pipeline.geometry.sweep import CAGED
from mam_pipeline.types import FloatArray, IntArray, Mesh, Primitives

DIRECTIONS = np.array(
    [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1], [0, 0, -1]], dtype=np.float64
)
SKIN = 5e-4  # crossings nearer than this (share of the diagonal) are the sample's own surface
NEAR = 0.04  # "right in front of": share of the diagonal


@dataclass(frozen=True)
class Probe:
    """Samples and crossings in the object's own frame: yaw-aligned, diagonal 1, floor z = 0.

    Attributes:
        object_T_asset: (4, 4) similarity from the asset frame to the object's own frame.
        vertices: (V, 3) the mesh's vertices in that frame.
        points, normals: (N, 3) samples and the unit normals of their faces (as wound).
        owner: (N,) primitive of every sample, sorted.
        weight: (N,) share of the object's area that the sample stands for.
        hit_sample, hit_direction, hit_distance, hit_owner: (H,) crossings, at most one (the
            nearest) for each sample, direction and primitive met; own primitive included.
        hit_inside: (H,) whether the sample lies inside the primitive met: the two run into each
            other at rest, as pieces of real files often do.
        count: number of primitives. surface: the object's area over its squared diagonal.
    """

    object_T_asset: FloatArray
    vertices: FloatArray
    points: FloatArray
    normals: FloatArray
    owner: IntArray
    weight: FloatArray
    hit_sample: IntArray
    hit_direction: IntArray
    hit_distance: FloatArray
    hit_owner: IntArray
    hit_inside: NDArray[np.bool_]
    count: int
    surface: float = 1.0

    @property
    def area(self) -> FloatArray:
        """(P,) share of the object's area of every primitive."""
        return np.bincount(self.owner, self.weight, minlength=self.count).astype(np.float64)

    def escapes(self) -> NDArray[np.bool_]:
        """(N, 6) whether a sample sees the outside along a direction."""
        out = np.ones((len(self.points), 6), dtype=bool)
        out[self.hit_sample, self.hit_direction] = False
        return out

    def cover(self, near: float = np.inf) -> NDArray[np.float32]:
        """(P, P, 6) share of i's area that has j ahead within `near`, per direction."""
        p = self.count
        keep = self.hit_distance <= near
        sample, other = self.hit_sample[keep], self.hit_owner[keep]
        flat = (self.owner[sample] * p + other) * 6 + self.hit_direction[keep]
        total = np.bincount(flat, self.weight[sample], minlength=p * p * 6)
        share = total.reshape(p, p, 6) / np.maximum(self.area, 1e-12)[:, None, None]
        return share.astype(np.float32)

    def clearance(self, member: NDArray[np.bool_]) -> FloatArray:
        """(n, 6) free distance of every sample of a group (P,) along the six directions.

        Infinite where nothing outside the group lies ahead. What a sample lies inside of already at
        rest does not block it, as the check counts penetration beyond the rest pose's; a primitive
        that lies inside another as a whole is caged by it.
        """
        members = np.flatnonzero(member)
        sizes = self._starts[members + 1] - self._starts[members]
        out = np.full((int(sizes.sum()), 6), np.inf)
        if len(members) == 0:
            return out
        shift = np.cumsum(sizes) - sizes - self._starts[members]
        first, last = self._hit_starts[members], self._hit_starts[members + 1]
        hits = np.concatenate([np.arange(i, j) for i, j in zip(first, last)])
        row = self.hit_sample[hits] + np.repeat(shift, last - first)
        use = ~member[self.hit_owner[hits]] & ~self._interlocked[hits]
        hits, row = hits[use], row[use]
        cell = row * 6 + self.hit_direction[hits]
        np.minimum.at(out.reshape(-1), cell, self.hit_distance[hits])  # fast for one index alone
        return out

    def members(self, member: NDArray[np.bool_]) -> IntArray:
        """(n,) samples of a group (P,), in the order of `clearance`."""
        spans = [np.arange(self._starts[k], self._starts[k + 1]) for k in np.flatnonzero(member)]
        return np.concatenate(spans) if spans else np.zeros(0, dtype=np.int64)

    @cached_property
    def _interlocked(self) -> NDArray[np.bool_]:
        """(H,) crossings of what a sample's primitive runs into, but does not lie inside of."""
        inside = np.flatnonzero(self.hit_inside)
        pair = self.owner[self.hit_sample[inside]] * self.count + self.hit_owner[inside]
        # a sample that is inside meets the other with every ray
        met = np.bincount(pair, minlength=self.count**2) / len(DIRECTIONS)
        samples = np.bincount(self.owner, minlength=self.count)
        caged = met.reshape(self.count, self.count) > CAGED * samples[:, None]
        out = self.hit_inside.copy()
        out[inside] = ~caged.reshape(-1)[pair]
        return out

    @cached_property
    def _starts(self) -> IntArray:
        return np.searchsorted(self.owner, np.arange(self.count + 1))

    @cached_property
    def _hit_starts(self) -> IntArray:
        return np.searchsorted(self.hit_sample, self._starts)


def probe(mesh: Mesh, primitives: Primitives, seed: int = 0) -> Probe:
    """Sample every primitive and cast the rays (about 0.1 s for 60 primitives).

    Args:
        mesh: asset frame, Z up; any yaw. primitives: P of them. seed: of the sampling.
    """
    transform = object_frame(mesh)
    vertices = mesh.vertices @ transform[:3, :3].T + transform[:3, 3]
    points, normals, owner, weight = _sample(vertices, mesh.faces, primitives, seed)
    hits = _cross(vertices, mesh.faces, primitives.labels, points)
    surface = float(face_geometry(vertices, mesh.faces)[1].sum())
    return Probe(
        transform, vertices, points, normals, owner, weight, *hits, primitives.count, surface
    )


def object_frame(mesh: Mesh) -> FloatArray:
    """(4, 4) object_T_asset: dominant walls along x and y, diagonal 1, floor at z = 0."""
    yaw = _yaw(mesh)
    c, s = np.cos(-yaw), np.sin(-yaw)
    out = np.eye(4)
    out[:3, :3] = [[c, -s, 0], [s, c, 0], [0, 0, 1]]
    points = mesh.vertices[np.unique(mesh.faces)] @ out[:3, :3].T
    low, high = points.min(axis=0), points.max(axis=0)
    scale = 1.0 / max(float(np.linalg.norm(high - low)), 1e-12)
    anchor = np.array([(low[0] + high[0]) / 2, (low[1] + high[1]) / 2, low[2]])
    out[:3, :3] *= scale
    out[:3, 3] = -scale * anchor
    return out


def _yaw(mesh: Mesh) -> float:
    """Angle (radians, within a quarter turn) of the dominant vertical faces about Z."""
    normals, areas = face_geometry(mesh.vertices, mesh.faces)
    upright = np.abs(normals[:, 2]) < 0.2
    angle = np.mod(np.degrees(np.arctan2(normals[upright, 1], normals[upright, 0])), 90.0)
    weight = areas[upright]
    if weight.sum() <= 1e-12:
        return 0.0
    histogram = np.bincount(np.round(angle * 2).astype(int) % 180, weight, minlength=180)
    smooth = sum(np.roll(histogram, k) for k in range(-4, 5))
    assert isinstance(smooth, np.ndarray)
    aligned = smooth[0]
    peak = int(np.argmax(smooth))
    if aligned > 0.7 * smooth[peak]:
        return 0.0  # the axes as given explain the walls as well as any other turn
    near = (angle - peak / 2 + 45.0) % 90.0 - 45.0
    close = np.abs(near) < 2.5
    refined = peak / 2 + float(np.average(near[close], weights=weight[close]))
    return float(np.radians((refined + 45.0) % 90.0 - 45.0))


def _sample(
    vertices: FloatArray, faces: IntArray, primitives: Primitives, seed: int
) -> tuple[FloatArray, FloatArray, IntArray, FloatArray]:
    """Samples stratified over each primitive; small primitives get a minimum number."""
    count = primitives.count
    normals, areas = face_geometry(vertices, faces)
    areas = np.maximum(areas, 1e-14)
    labels = primitives.labels
    area = np.bincount(labels, areas, minlength=count)
    least = int(np.clip(5000 // max(count, 1), 8, 40))
    total = 4000 * np.sqrt(area) / np.sqrt(area).sum()
    wanted = np.where(area > 0, np.maximum(np.round(total), least), 0).astype(np.int64)
    order = np.argsort(labels, kind="stable")
    cumulative = np.cumsum(areas[order])
    start = np.concatenate([[0.0], np.cumsum(area)[:-1]])
    owner = np.repeat(np.arange(count), wanted)
    rank = np.arange(len(owner)) - np.repeat(np.cumsum(wanted) - wanted, wanted)
    rng = np.random.default_rng(seed)
    spot = start[owner] + (rank + rng.random(len(owner))) / wanted[owner] * area[owner]
    index = order[np.minimum(np.searchsorted(cumulative, spot, side="right"), len(order) - 1)]
    u, w = rng.random(len(owner)), rng.random(len(owner))
    flip = u + w > 1
    u[flip], w[flip] = 1 - u[flip], 1 - w[flip]
    a, b, c = (vertices[faces[index, k]] for k in range(3))
    points = a + u[:, None] * (b - a) + w[:, None] * (c - a)
    weight = area[owner] / wanted[owner] / area.sum()
    return points, normals[index], owner, weight


def _cross(
    vertices: FloatArray, faces: IntArray, labels: IntArray, points: FloatArray
) -> tuple[IntArray, IntArray, FloatArray, IntArray, NDArray[np.bool_]]:
    """Nearest crossing of each primitive by each sample's six rays, and whether from inside."""
    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(
        o3d.core.Tensor.from_numpy(vertices.astype(np.float32)),
        o3d.core.Tensor.from_numpy(faces.astype(np.uint32)),
    )
    n = len(points)
    rays = np.empty((n, 6, 6), dtype=np.float32)
    rays[:, :, :3] = points[:, None]
    rays[:, :, 3:] = DIRECTIONS
    found = scene.list_intersections(o3d.core.Tensor.from_numpy(rays.reshape(-1, 6)), nthreads=1)
    ray = found["ray_ids"].numpy().astype(np.int64)
    distance = found["t_hit"].numpy().astype(np.float64)
    other = labels[found["primitive_ids"].numpy().astype(np.int64)]
    keep = distance > SKIN
    ray, distance, other = ray[keep], distance[keep], other[keep]
    order = np.lexsort((distance, other, ray))
    ray, distance, other = ray[order], distance[order], other[order]
    first = np.ones(len(ray), dtype=bool)
    first[1:] = (ray[1:] != ray[:-1]) | (other[1:] != other[:-1])
    crossed = np.diff(np.append(np.flatnonzero(first), len(first)))
    ray, distance, other = ray[first], distance[first], other[first]
    # inside a closed shell every ray crosses it an odd number of times
    count = int(labels.max()) + 1
    _, pair = np.unique(ray // 6 * count + other, return_inverse=True)
    inside = np.bincount(pair, crossed % 2) == len(DIRECTIONS)
    return ray // 6, ray % 6, distance, other, inside[pair]
