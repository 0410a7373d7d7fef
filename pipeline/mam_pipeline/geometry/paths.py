"""Following surface samples along a joint's motion: what they cross, and how deep they go.

Real meshes are soups of sheets, so depth is measured without inside and outside: a sample has
penetrated once its path has crossed a triangle, by its distance behind that triangle. Only what
goes beyond the rest pose counts, so samples that begin inside the other body are left out, samples
that touch it at rest may slide, but not be pressed in, and a place that the part has taken up at
rest is no new one: a wheel that turns in its arch, a rod in its bearing and a side board in its
rail only take their own place. The check judges by this, and limits are set by it: a range that is
found in one way and tested in another fails at its ends for nothing.
"""

from __future__ import annotations

import copy
import itertools
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.geometry.motion import Motion, motion_points
from mam_pipeline.geometry.raycast import RayScene, faces_near
from mam_pipeline.geometry.sampling import sample_surface
from mam_pipeline.geometry.surface import Solid, components
from mam_pipeline.types import FloatArray, IntArray, Mesh

SAMPLES = 1500
STATIC_SAMPLES = 2500
DENSE = 6
"""So many times more samples are asked where few of the usual ones are deep."""
FEW = 25
"""Up to so many deep samples are few: their number says little about the area."""
TOUCH = 0.0025
"""Nearer than this at rest is contact, as a share of the diagonal."""
SURFACE = 1e-4
"""Nearer than this a point lies in a surface, as a share of the diagonal."""
PLACE = 1e-3
"""What is nearer than this to where the part was at rest is its own place, as a share of the
diagonal."""
STEPS = 10
"""Joint values that are looked at between rest and an end of the range."""
FEWEST = 5
"""Fewer deep samples than this, of the dense ones, are rounding at an edge."""
_CHORD = np.radians(6.0)


@dataclass(frozen=True)
class Rule:
    """What counts as penetration.

    Attributes:
        depth: metres beyond the rest pose's. area: share of the part's area that must be as deep.
    """

    depth: float
    area: float


@dataclass(frozen=True)
class Crossing:
    """What stands in the way towards one end of a range.

    Attributes:
        value: joint value of the first pose that penetrates; None where all are free.
        before: the last value that was looked at and is free (0 if there is none).
        depth: metres. area: largest share of the part's area that is deep anywhere on the way.
        part, static: masks of the part's samples and of the static ones that are deep at `value`.
        judge: whose samples these are.
    """

    value: float | None
    before: float
    depth: float
    area: float
    part: NDArray[np.bool_]
    static: NDArray[np.bool_]
    judge: PartPaths


@dataclass(frozen=True)
class Roundness:
    """When a part counts as a body of revolution.

    Attributes:
        angles: radians by which it is turned; no regular polygon of few sides has all of them.
        most: share of its surface that must lie on itself then.
        away: sizes of the part by which that may lie off it: a wheel of eight sides is round.
    """

    angles: tuple[float, ...] = (0.41, 0.97, 1.73, 2.63)
    most: float = 0.95
    away: float = 0.03


ROUND = Roundness()


class PartPaths:
    """A part, its surroundings, and samples of both that follow the part's motion."""

    def __init__(
        self, mesh: Mesh, part: IntArray, static: IntArray, seed: int = 0, density: int = 1
    ) -> None:
        """Prepare from face indices of the moving part and of everything else.

        `close` holds those of everything else that the part can reach; `seed` is of the samples,
        of which there are `density` times the usual number.
        """
        v = mesh.vertices
        self.vertices, self.part_faces = v, mesh.faces[part]
        self.diagonal = max(mesh.diagonal, 1e-12)
        corners = v[self.part_faces.reshape(-1)]
        self.low, self.high = corners.min(axis=0), corners.max(axis=0)
        self.margin = float(np.linalg.norm(self.high - self.low)) + 0.02 * self.diagonal
        near = faces_near(v, mesh.faces[static], self.low - self.margin, self.high + self.margin)
        self.close = static[near]
        self.close_faces = mesh.faces[self.close]
        self.part_scene = RayScene(v, self.part_faces)
        self.static_scene = RayScene(v, self.close_faces)
        self.solid, self.part_solid = _solid(mesh, static), _solid(mesh, part)
        self._sample(seed, density)

    def _sample(self, seed: int, density: int) -> None:
        """Draw the samples of both bodies and look at them at rest."""
        self.seed, self.density = seed, density
        found = sample_surface(self.vertices, self.part_faces, density * SAMPLES, seed)
        inside = self._within(self.solid, self.static_scene, found.points)
        self.points, self.normals = found.points[~inside], found.normals[~inside]
        self.area = max(found.area, 1e-12)
        most = density * STATIC_SAMPLES
        around = sample_surface(self.vertices, self.close_faces, 4 * most, seed + 1)
        low, high = self.low - self.margin, self.high + self.margin
        spots = around.points[((around.points > low) & (around.points < high)).all(axis=1)]
        keep = np.linspace(0, max(len(spots) - 1, 0), min(len(spots), most)).astype(int)
        share = around.area * len(spots) / max(len(around.points), 1) / max(len(keep), 1)
        spots = spots[keep]
        self.static_points = spots[~self._within(self.part_solid, self.part_scene, spots)]
        self.static_weight = share / self.area
        self._rest()

    @cached_property
    def dense(self) -> PartPaths:
        """The same with more samples."""
        more = copy.copy(self)
        more._sample(self.seed, DENSE)
        return more

    def turns_in_itself(self, axis: FloatArray, origin: FloatArray) -> bool:
        """Whether the part is a body of revolution about a line: turned, it fills the same room.

        What it meets as it turns, a wheel the body that it is sunk in, then stops nothing.
        """
        spots = sample_surface(self.vertices, self.part_faces, SAMPLES, self.seed).points
        angles = np.array(ROUND.angles)
        moved = motion_points("revolute", axis, origin, angles, spots).reshape(-1, 3)
        away = np.quantile(self.part_scene.distance(moved), ROUND.most)
        return bool(away <= ROUND.away * np.linalg.norm(self.high - self.low))

    def _only(self, part: NDArray[np.bool_], static: NDArray[np.bool_]) -> PartPaths:
        """With these samples alone: what is not deep on the whole way is not on a shorter one."""
        few = copy.copy(self)
        few.points = np.asarray(self.points[part])
        few.normals = np.asarray(self.normals[part])
        few.touching = self.touching[part]
        few.static_points = np.asarray(self.static_points[static])
        few.static_touching = self.static_touching[static]
        kept = part[self.pressed]
        few.pressed = np.asarray((np.cumsum(part) - 1)[self.pressed[kept]])
        few.into = np.asarray(self.into[kept])
        return few

    def _within(self, solid: Solid, scene: RayScene, points: FloatArray) -> NDArray[np.bool_]:
        """Mask (n,) of points inside a solid; those on its very surface are a matter of rounding
        and count as touching it instead."""
        inside = solid.contains(points)
        where = np.flatnonzero(inside)
        inside[where] = scene.distance(points[where]) > SURFACE * self.diagonal
        return inside

    def _rest(self) -> None:
        """Which samples touch at rest, and the direction that would press them in."""
        reach = TOUCH * self.diagonal
        closest = self.static_scene.closest(self.points)
        self.rest_gap = float(closest.distance.min()) if len(self.points) else np.inf
        self.touching = closest.distance < reach
        self.static_touching = self.part_scene.distance(self.static_points) < reach
        facing = np.abs(np.einsum("ij,ij->i", self.normals, closest.normals)) > 0.9
        offset = self.points - closest.points
        aside = offset - np.einsum("ij,ij->i", offset, closest.normals)[:, None] * closest.normals
        square = np.linalg.norm(aside, axis=1) < 0.0005 * self.diagonal
        pressed = np.flatnonzero(self.touching & facing & square)
        into = np.zeros((len(pressed), 3))
        radius = (0.05 * self.diagonal) ** 2
        x, y, z = np.ascontiguousarray(self.points.T)  # by column: a sum over rows of 3 is slow
        for row, k in enumerate(pressed):
            apart = (x - x[k]) ** 2 + (y - y[k]) ** 2 + (z - z[k]) ** 2
            local = self.points[apart < radius]
            sides = (local - closest.points[k]) @ closest.normals[k]
            clear = sides[np.abs(sides) > 0.001 * self.diagonal]
            share = float((clear > 0).mean()) if len(clear) else 0.5
            if abs(share - 0.5) > 0.35:  # the part lies on one side of the contact
                into[row] = -np.sign(share - 0.5) * closest.normals[k]
        self.pressed: IntArray = pressed
        self.into: FloatArray = into

    def depths(
        self, motion: Motion, axis: FloatArray, origin: FloatArray, values: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Depth beyond rest of the part's samples (n, S) and of static samples (n, T), metres.

        Args:
            motion, axis, origin: the joint. values: (n,) monotone, of one sign, without 0.
        """
        steps, index = _substeps(motion, values)
        path = motion_points(motion, axis, origin, steps, self.points)
        depth = self._crossed(path, self.static_scene, self.touching)
        if len(self.pressed):
            pushed = np.einsum(
                "nsk,sk->ns", path[1:, self.pressed] - path[:1, self.pressed], self.into
            )
            depth[:, self.pressed] = np.maximum(depth[:, self.pressed], pushed)
        # seen from the part, the surroundings move the other way
        back = motion_points(motion, axis, origin, -steps, self.static_points)
        other = self._crossed(back, self.part_scene, self.static_touching)
        depth = self._confirmed(depth, path, self.static_scene, self.part_scene)[index]
        return depth, self._confirmed(other, back, self.part_scene)[index]

    def _confirmed(self, depth: FloatArray, path: FloatArray, *scenes: RayScene) -> FloatArray:
        """Depth (n, S) cut down to the distance from any surface of some bodies.

        A sample in a plane that both bodies share may cross an edge there and is still at the
        surface: what has truly gone in gets away from the surface, at one value at least. So it
        does from the surface that the part itself had at rest.
        """
        far = np.flatnonzero((depth > PLACE * self.diagonal).any(axis=0))
        for scene in scenes if len(far) else ():
            distance = scene.distance(path[1:, far].reshape(-1, 3)).reshape(len(depth), -1)
            depth[:, far] = np.minimum(depth[:, far], distance)
        return np.asarray(np.maximum.accumulate(depth, axis=0))

    def _crossed(
        self, path: FloatArray, scene: RayScene, touching: NDArray[np.bool_]
    ) -> FloatArray:
        """Depth (n, S) behind the triangles crossed so far, along paths (n + 1, S, 3)."""
        n, count = path.shape[0] - 1, path.shape[1]
        step = np.diff(path, axis=0)
        length = np.linalg.norm(step, axis=2)
        low, high = scene.bounds
        meets = (np.minimum(path[:-1], path[1:]) <= high) & (np.maximum(path[:-1], path[1:]) >= low)
        active = (length > 1e-12 * self.diagonal) & meets.all(axis=2) & ~touching
        depth = np.zeros((n, count))
        hits = scene.first_hits(path[:-1][active], step[active])
        t, normal = np.full((n, count), np.inf), np.zeros((n, count, 3))
        t[active], normal[active] = hits.t, hits.normals
        for k in range(n):
            who = np.flatnonzero(t[k] <= 1.0)
            if len(who):
                at = path[k, who] + t[k, who, None] * step[k, who]
                behind = np.abs(np.einsum("jsk,sk->js", path[k + 1 :, who] - at, normal[k, who]))
                depth[k:, who] = np.maximum(depth[k:, who], behind)
        return depth

    def crossing(
        self, motion: Motion, axis: FloatArray, origin: FloatArray, values: FloatArray, rule: Rule
    ) -> Crossing:
        """The first of `values` (n,), monotone and of one sign, at which the part penetrates.

        Where only a few samples are deep, the dense ones decide.
        """
        part, static = self.depths(motion, axis, origin, values)
        many = (part > rule.depth).sum(axis=1), (static > rule.depth).sum(axis=1)
        if self.density == 1 and 0 < np.add(*many).max() < FEW:
            return self.dense.crossing(motion, axis, origin, values, rule)
        blocked = many[0] / (self.density * SAMPLES) + many[1] * self.static_weight
        area = float(blocked.max())
        seen = np.maximum(*many) >= FEWEST
        for k in np.flatnonzero((blocked > rule.area) & seen):
            who = (part[k] > rule.depth, static[k] > rule.depth)
            if self.escapes(motion, axis, origin, values[: k + 1], who, rule.depth):
                continue
            deep = max(float(d[k].max(initial=0.0)) for d in (part, static))
            before = float(values[k - 1]) if k else 0.0
            return Crossing(float(values[k]), before, deep, area, *who, self)
        none = np.zeros(len(self.points), bool), np.zeros(len(self.static_points), bool)
        return Crossing(None, float(values[-1]), 0.0, area, *none, self)

    def free_range(
        self, motion: Motion, axis: FloatArray, origin: FloatArray, end: float, rule: Rule
    ) -> tuple[float, Crossing]:
        """How far towards `end` (signed) the part goes, and what stops it on the whole way."""
        first = found = self.crossing(motion, axis, origin, steps_to(end), rule)
        judge = self
        for _ in range(6):  # other values are looked at on a shorter way: look again
            if found.value is None:
                return end, first
            if found.judge.density > 1:
                judge = found.judge._only(found.part, found.static)
            inner = np.linspace(found.before, found.value, 5)[1:-1]
            way = steps_to(found.before) if found.before else np.zeros(0)
            finer = judge.crossing(motion, axis, origin, np.concatenate([way, inner]), rule)
            end = finer.before
            if end == 0.0:
                return 0.0, first
            found = judge.crossing(motion, axis, origin, steps_to(end), rule)
        return 0.0 if found.value is not None else end, first

    def obstacles(
        self, motion: Motion, axis: FloatArray, origin: FloatArray, found: Crossing
    ) -> IntArray:
        """Indices of the static faces that are in the way of a crossing, each once."""
        if found.value is None:
            return np.zeros(0, dtype=np.int64)
        steps, _ = _substeps(motion, steps_to(found.value))
        path = motion_points(motion, axis, origin, steps, found.judge.points[found.part])
        hits = [self.static_scene.first_hits(a, b - a) for a, b in itertools.pairwise(path)]
        faces = [h.faces[h.t <= 1.0] for h in hits]
        faces.append(self.static_scene.closest(found.judge.static_points[found.static]).faces)
        return np.asarray(self.close[np.unique(np.concatenate(faces))], dtype=np.int64)

    def escapes(
        self,
        motion: Motion,
        axis: FloatArray,
        origin: FloatArray,
        values: FloatArray,
        who: tuple[NDArray[np.bool_], NDArray[np.bool_]],
        reach: float,
    ) -> bool:
        """Whether shifting the part by `reach` in some direction frees the samples `who`.

        Penetration depth is the shortest shift that separates two bodies: a door whose corner
        catches the edge of a trim for two millimetres is two millimetres deep, however far it
        swings on behind the trim.

        Args:
            values: up to the one that is looked at. who: masks of the part's samples and of the
            static samples that have penetrated. reach: metres.
        """
        steps, _ = _substeps(motion, values)
        points, spots = self.points[who[0]], self.static_points[who[1]]
        none = np.zeros(len(points), dtype=bool), np.zeros(len(spots), dtype=bool)
        for shift in reach * np.concatenate([np.eye(3), -np.eye(3), [axis, -axis]]):
            path = motion_points(motion, axis, origin, steps, points + shift)
            part = self._confirmed(
                self._crossed(path, self.static_scene, none[0]), path, self.static_scene
            )
            back = motion_points(motion, axis, origin, -steps, spots - shift)
            static = self._confirmed(
                self._crossed(back, self.part_scene, none[1]), back, self.part_scene
            )
            left = int((part[-1] > reach).sum()) + int((static[-1] > reach).sum())
            if left <= 0.1 * (len(points) + len(spots)):
                return True
        return False

    def gaps(
        self, motion: Motion, axis: FloatArray, origin: FloatArray, values: FloatArray
    ) -> FloatArray:
        """(n,) smallest distance between the part and its surroundings at each value, metres."""
        points, spots = self.points[::2], self.static_points[::2]
        there = motion_points(motion, axis, origin, values, points)
        back = motion_points(motion, axis, origin, -values, spots)
        out = np.full(len(values), np.inf)
        for scene, moved in ((self.static_scene, there), (self.part_scene, back)):
            if moved.shape[1]:
                distance = scene.distance(moved.reshape(-1, 3)).reshape(len(values), -1)
                out = np.minimum(out, distance.min(axis=1))
        return out


def steps_to(end: float) -> FloatArray:
    """(STEPS,) joint values from rest to an end of the range, without rest itself."""
    return np.asarray(end * np.arange(1, STEPS + 1) / STEPS, dtype=np.float64)


def _substeps(motion: Motion, values: FloatArray) -> tuple[FloatArray, IntArray]:
    """Joint values from rest, fine enough that chords follow arcs, and where `values` are."""
    pieces: list[FloatArray] = [np.zeros(1)]
    index: list[int] = []
    before = 0.0
    for value in values:
        count = 1
        if motion == "revolute":
            count = max(1, int(np.ceil(abs(value - before) / _CHORD)))
        pieces.append(before + (value - before) * np.arange(1, count + 1) / count)
        index.append((index[-1] if index else -1) + count)
        before = float(value)
    return np.concatenate(pieces), np.array(index, dtype=np.int64)


def _solid(mesh: Mesh, faces: IntArray) -> Solid:
    corners = mesh.faces[faces]
    return Solid(components(mesh.vertices[corners], faces, 1e-5 * mesh.diagonal, corners))
