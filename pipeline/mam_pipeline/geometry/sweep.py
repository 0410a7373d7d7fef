"""A sign-free sweep test: how far can a part move before it runs into static geometry?

Real meshes are soups of sheets, so no inside and outside exists. Instead rays follow the path
of surface samples: a sample is blocked once its path has crossed a static triangle and gone on
behind it; the reverse (static samples against the part) finds thin things that the part's samples
pass by. Everything counts relative to the rest pose: a crossing at the very start is a surface in
contact, and then only motion *into* it counts; what of one body lies inside a closed shell of the
other at rest blocks nothing. Lengths are relative to the object's diagonal.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mam_pipeline.geometry.motion import Motion, motion_points, points_about
from mam_pipeline.geometry.raycast import RayScene, faces_near
from mam_pipeline.geometry.sampling import sample_surface, thin_out, unit
from mam_pipeline.types import FloatArray, IntArray, Mesh

START = 0.0025  # path before which a crossing is a contact at rest, of the diagonal
COINCIDENT = 0.0002  # closer than this, two surfaces are one, of the diagonal
CHORD = np.deg2rad(6.0)  # longest arc replaced by its chord: 0.14 % of the radius off
_BATCH = 24  # lines swept at once
CAGED = 0.95  # share of a body's samples inside another, above which it is caged by it
DEEP = 0.004  # depth behind a crossed surface that counts as blocked, of the diagonal


@dataclass(frozen=True)
class SweepResult:
    """What a sweep found at each of its n values.

    Attributes:
        values: (n,) joint values (rad, or the mesh's unit).
        blocked: (n,) area of the part (and of the static geometry that enters it) that has run
            into something on the way to this value, as a share of the part's area, 0..1.
        depth: (n,) deepest crossing so far, mesh unit, normal to the surface crossed.
        contact: (n,) share of the rest contact that is still in contact; NaN where not asked for.
        gap: (n,) smallest distance between the part and the static geometry, mesh unit; NaN where
            not asked for.
    """

    values: FloatArray
    blocked: FloatArray
    depth: FloatArray
    contact: FloatArray
    gap: FloatArray


@dataclass(frozen=True)
class ContactSet:
    """Samples of the part close to static triangles at rest (paper's S_contact, resampled).

    Attributes:
        points: (n, 3) on the part. on_static: (n, 3) closest static points.
        normals: (n, 3) normals of the static triangles as wound.
        gap: smallest distance anywhere. tau: threshold used. Both in the mesh's unit.
        share: share of the part's samples that are in contact.
    """

    points: FloatArray
    on_static: FloatArray
    normals: FloatArray
    gap: float
    tau: float
    share: float


def _overlap(scene: RayScene, points: FloatArray) -> IntArray:
    """Those of the samples (n, 3) of one body that lie inside the other; none of a body that is
    caged by the other as a whole."""
    inside = np.flatnonzero(scene.encloses(points))
    return inside if len(inside) <= CAGED * len(points) else inside[:0]


def _substeps(motion: Motion, values: FloatArray, chord: float) -> tuple[FloatArray, IntArray]:
    """Joint values from rest, fine enough that chords follow the arcs, and where `values` are.

    Returns:
        (m + 1,) values starting with 0, and the (n,) index of every asked value among steps 1..m.
    """
    start = np.concatenate([[0.0], values])
    pieces = [np.zeros(1)]
    index: list[int] = []
    for a, b in itertools.pairwise(start):
        count = max(1, int(np.ceil(abs(b - a) / chord))) if motion == "revolute" else 1
        pieces.append(a + (b - a) * np.arange(1, count + 1) / count)
        index.append((index[-1] if index else -1) + count)
    return np.concatenate(pieces), np.array(index, dtype=np.int64)


class SweepScene:
    """Prebuilt static scene and samples of one part; answers many motions of that part."""

    def __init__(
        self,
        mesh: Mesh,
        part_faces: IntArray,
        static_faces: IntArray,
        *,
        samples: int = 500,
        static_samples: int = 1000,
        contact_samples: int = 3000,
        chord: float = CHORD,
        reach: float = 1.0,
        seed: int = 0,
    ) -> None:
        """Prepare.

        Args:
            mesh: the whole object.
            part_faces, static_faces: (n,) face indices; static is what must not be run into.
            samples, static_samples: points whose paths are followed.
            contact_samples: points among which contact at rest is looked for.
            chord: longest arc replaced by its chord, radians; coarser is faster.
            reach: static geometry beyond this multiple of the part's size is ignored.
            seed: of all sampling.
        """
        v = mesh.vertices
        self._chord = chord
        self.diagonal = max(mesh.diagonal, 1e-12)
        part, static = mesh.faces[part_faces], mesh.faces[static_faces]
        corners = v[part.reshape(-1)]
        self.low, self.high = corners.min(axis=0), corners.max(axis=0)
        self.center = 0.5 * (self.low + self.high)
        self.size = float(np.linalg.norm(self.high - self.low))
        margin = reach * self.size + 0.02 * self.diagonal
        near = faces_near(v, static, self.low - margin, self.high + margin)
        static = static[near]
        self.part_scene, self.static_scene = RayScene(v, part), RayScene(v, static)
        dense = sample_surface(v, part, contact_samples, seed)
        self.dense = dense
        keep = thin_out(len(dense.points), samples, seed)
        self._keep = keep
        self.points, self.point_normals = dense.points[keep], dense.normals[keep]
        self.area = max(dense.area, 1e-300)
        self._sample_static(v, static, static_samples, margin, seed)
        self._rest_contact()
        # Grazing samples are judged by the direction of their contact; what bodies that run into
        # each other share at rest blocks neither.
        self._silent = np.union1d(self._grazing, _overlap(self.static_scene, self.points))
        self._static_silent = _overlap(self.part_scene, self.static_points)

    def _sample_static(
        self, v: FloatArray, static: IntArray, count: int, margin: float, seed: int
    ) -> None:
        """Choose static samples around the part and weigh them by the area they stand for."""
        found = sample_surface(v, static, 8 * count, seed + 1)
        inside = ((found.points > self.low - margin) & (found.points < self.high + margin)).all(1)
        points = found.points[inside]
        keep = thin_out(len(points), count, seed + 2)
        chosen = points[keep]
        # Points that lie in the part's own surface graze its edges when it slides along them.
        apart = self.part_scene.distance(chosen) > COINCIDENT * self.diagonal
        self.static_points = chosen[apart]
        stands_for = found.area / max(len(found.points), 1) * len(points) / max(len(keep), 1)
        self._static_weight = stands_for / self.area

    def _rest_contact(self) -> None:
        """Find the contact set and, for touching samples, the direction that runs into static."""
        near = self.static_scene.closest(self.dense.points)
        self.rest_gap = float(near.distance.min()) if len(near.distance) else np.inf
        self._rest = near
        keep = self._keep
        distance, found = near.distance[keep], near.points[keep]
        normals = near.normals[keep]
        # Only face-to-face contact has a direction: at an edge the closest triangle is arbitrary.
        facing = np.abs((self.point_normals * normals).sum(axis=1)) > 0.9
        offset = self.points - found
        aside = offset - (offset * normals).sum(axis=1)[:, None] * normals
        square = np.linalg.norm(aside, axis=1) < 0.0005 * self.diagonal
        touch = (distance < START * self.diagonal) & facing & square
        radius = 0.05 * self.diagonal
        self._touch = np.flatnonzero(touch)
        into = np.zeros((len(self._touch), 3))
        for row, k in enumerate(self._touch):
            local = self.points[((self.points - self.points[k]) ** 2).sum(1) < radius**2]
            side = float((local.mean(axis=0) - found[k]) @ normals[k])
            if abs(side) <= 0.001 * self.diagonal:  # the middle of a wide face: ask the whole part
                side = float((self.center - found[k]) @ normals[k])
            if abs(side) > 0.001 * self.diagonal:
                into[row] = -np.sign(side) * normals[k]
        self._into = into
        self._grazing = np.flatnonzero(facing & (distance < COINCIDENT * self.diagonal))

    @property
    def rest_distance(self) -> FloatArray:
        """Distance (n,) of every dense sample to the static geometry at rest, mesh unit."""
        return self._rest.distance

    def contact(self, tau: float | None = None, limit: int = 2000) -> ContactSet:
        """Contact set at rest; `tau` in the mesh's unit (default: gap + 0.003 diagonals)."""
        chosen = self.rest_gap + 0.003 * self.diagonal if tau is None else tau
        mask = self._rest.distance < chosen
        index = np.flatnonzero(mask)[thin_out(int(mask.sum()), limit)]
        return ContactSet(
            self.dense.points[index],
            self._rest.points[index],
            self._rest.normals[index],
            self.rest_gap,
            chosen,
            float(mask.mean()) if len(mask) else 0.0,
        )

    def sweep(
        self,
        motion: Motion,
        axis: ArrayLike,
        origin: ArrayLike,
        values: ArrayLike,
        *,
        contact: bool = False,
    ) -> SweepResult:
        """Move the part from rest through `values` (n,), monotone and of one sign.

        Args:
            motion: revolute or prismatic.
            axis: (3,) direction; origin: (3,) point on it (ignored by slides).
            values: radians or mesh units, without the rest value 0 itself.
            contact: also measure contact share and gap at every value (slower).
        """
        a, o = unit(axis), np.asarray(origin, dtype=np.float64)
        wanted = np.asarray(values, dtype=np.float64)
        q, index = _substeps(motion, wanted, self._chord)
        path = motion_points(motion, a, o, q, self.points)
        back = motion_points(motion, a, o, -q, self.static_points)
        depth = self._crossings(path, self.static_scene, index)
        depth[:, self._silent] = 0.0
        if len(self._touch):
            moved = path[index + 1][:, self._touch] - path[:1, self._touch]
            pushed = np.einsum("nsk,sk->ns", moved, self._into)
            depth[:, self._touch] = np.maximum(depth[:, self._touch], pushed)
        other = self._crossings(back, self.part_scene, index)
        other[:, self._static_silent] = 0.0
        depth, other = (np.maximum.accumulate(d, axis=0) for d in (depth, other))
        deep = DEEP * self.diagonal
        blocked = (depth > deep).sum(axis=1) / max(len(self.points), 1)
        blocked = blocked + (other > deep).sum(axis=1) * self._static_weight
        n = len(wanted)
        share: Any = np.full(n, np.nan)
        gap: Any = np.full(n, np.nan)
        if contact:
            share, gap = self._contact_along(motion, a, o, wanted)
        worst: Any = np.zeros(n)
        for d in (depth, other):
            if d.shape[1]:
                worst = np.maximum(worst, d.max(axis=1))
        return SweepResult(wanted, np.minimum(blocked, 1.0), worst, share, gap)

    def blocked_many(
        self, motion: Motion, axes: FloatArray, origins: FloatArray, values: FloatArray
    ) -> FloatArray:
        """The `blocked` of many sweeps at once: about five times as fast as one after the other.

        Args:
            axes: (L, 3) unit directions; origins: (L, 3) points on them (ignored by slides).
            values: (n,) joint values of revolute lines, the same for all, or (L, n) of slides.

        Returns:
            (L, n) as in `SweepResult.blocked`.
        """
        count = len(axes)
        if count == 0:
            return np.zeros((0, np.shape(values)[-1]))
        if count > _BATCH:  # what fits the processor's cache is twice as fast
            cuts = range(0, count, _BATCH)
            return np.concatenate([
                self.blocked_many(
                    motion, axes[i : i + _BATCH], origins[i : i + _BATCH],
                    values if motion == "revolute" else values[i : i + _BATCH],
                ) for i in cuts
            ])  # fmt: skip
        if motion == "revolute":
            q, index = _substeps(motion, np.asarray(values, dtype=np.float64), self._chord)
            path = points_about(axes, origins, self.points, q)
            back = points_about(axes, origins, self.static_points, -q)
        else:
            each = np.concatenate([np.zeros((count, 1)), values], axis=1).T
            shift = (each[:, :, None] * axes)[:, :, None, :]
            path, back = self.points + shift, self.static_points - shift
            index = np.arange(len(each) - 1, dtype=np.int64)
        steps, mine, theirs = len(path), len(self.points), len(self.static_points)
        flat = path.reshape(steps, count * mine, 3)
        depth = self._crossings(flat, self.static_scene, index).reshape(len(index), count, mine)
        depth[:, :, self._silent] = 0.0
        if len(self._touch):
            moved = path[index + 1][:, :, self._touch] - self.points[self._touch]
            pushed = np.einsum("nlsk,sk->nls", moved, self._into)
            depth[:, :, self._touch] = np.maximum(depth[:, :, self._touch], pushed)
        other = self._crossings(back.reshape(steps, count * theirs, 3), self.part_scene, index)
        deep = DEEP * self.diagonal
        hit = np.logical_or.accumulate(depth > deep, axis=0).sum(axis=2) / max(mine, 1)
        other = other.reshape(len(index), count, theirs)  # there may be none of theirs
        other[:, :, self._static_silent] = 0.0
        other_hit = np.logical_or.accumulate(other > deep, axis=0)
        return np.minimum(hit + other_hit.sum(axis=2) * self._static_weight, 1.0).T

    def _crossings(self, path: FloatArray, scene: RayScene, index: IntArray) -> FloatArray:
        """Deepest crossing so far (m, S) at the asked steps `index` (m,) of paths (n + 1, S, 3)."""
        count = path.shape[1]
        step = path[1:] - path[:-1]
        length = np.sqrt(np.einsum("nsk,nsk->ns", step, step))
        active = self._reachable(path, scene) & (length > 1e-12 * self.diagonal)
        depth = np.zeros((len(index), count))
        when, who = np.nonzero(active)
        if not len(when):
            return depth
        begun = (np.cumsum(length, axis=0) - length)[when, who]
        skip = np.clip((START * self.diagonal - begun) / length[when, who], 0.0, 1.0)[:, None]
        rest = step[when, who]
        origin = path[when, who] + skip * rest
        rest = rest * (1.0 - skip)
        hits = scene.first_hits(origin, rest)
        found = np.flatnonzero((hits.t <= 1.0) & (skip[:, 0] < 1.0))
        if not len(found):
            return depth
        when, who, normal = when[found], who[found], hits.normals[found]
        at = origin[found] + hits.t[found, None] * rest[found]
        offset = np.einsum("hk,hk->h", at, normal)
        for row, last in enumerate(index):
            seen = when <= last
            sample = who[seen]
            behind = np.einsum("hk,hk->h", path[last + 1, sample], normal[seen]) - offset[seen]
            np.maximum.at(depth[row], sample, np.abs(behind))
        return depth

    @staticmethod
    def _reachable(path: FloatArray, scene: RayScene) -> NDArray[np.bool_]:
        """Mask (n, S) of path segments that touch the scene's bounding box."""
        low, high = scene.bounds
        hit = np.ones((path.shape[0] - 1, path.shape[1]), dtype=np.bool_)
        for k in range(3):
            below, above = path[:, :, k] <= high[k], path[:, :, k] >= low[k]
            hit &= (below[:-1] | below[1:]) & (above[:-1] | above[1:])
        return hit

    def _contact_along(
        self, motion: Motion, axis: FloatArray, origin: FloatArray, values: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Share of rest contact points still in contact, and the smallest gap, per value."""
        found = self.contact(limit=200)
        tau = found.tau + 0.002 * self.diagonal
        if not len(found.points):
            return np.zeros(len(values)), np.full(len(values), np.inf)
        moved = motion_points(motion, axis, origin, values, found.points)
        near = self.static_scene.distance(moved.reshape(-1, 3)).reshape(len(values), -1)
        # The same, seen from the static side: a rail's own contact points against the part.
        back = motion_points(motion, axis, origin, -values, found.on_static)
        other = self.part_scene.distance(back.reshape(-1, 3)).reshape(len(values), -1)
        share = np.maximum((near < tau).mean(axis=1), (other < tau).mean(axis=1))
        gap = np.minimum(near.min(axis=1), other.min(axis=1))
        return share, gap

    def line_gap(self, axis: ArrayLike, origin: ArrayLike) -> tuple[float, float]:
        """Distance of an axis line, over the part's extent along it, to the part and to static.

        Returns the mean over 9 points of the distances to (part, static), mesh unit: a real hinge
        lies on both bodies.
        """
        a, o = unit(axis), np.asarray(origin, dtype=np.float64)
        along = (self.points - o) @ a
        spots = np.linspace(float(np.quantile(along, 0.03)), float(np.quantile(along, 0.97)), 9)
        line = o + spots[:, None] * a
        to_static = self.static_scene.distance(line)
        return float(self.part_scene.distance(line).mean()), float(to_static.mean())
