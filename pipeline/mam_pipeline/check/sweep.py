"""The offline sweep: penetration, loss of contact, hinge lines and filled cavities.

The engine filters contacts between a parent and its child, so a drawer inside a solid block moves
without complaint there. Here every part is moved through its range against everything else, on
the surfaces themselves.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mam_pipeline.asset.dynamics import carried_links
from mam_pipeline.asset.surface import hull_of
from mam_pipeline.check.model import CheckModel, Hull
from mam_pipeline.check.thresholds import THRESHOLDS, Thresholds
from mam_pipeline.geometry.paths import Motion, PartPaths, Rule, motion_points, steps_to
from mam_pipeline.geometry.raycast import RayScene
from mam_pipeline.geometry.sampling import sample_surface, unit
from mam_pipeline.types import FloatArray, IntArray, Joint, Mesh

PINNED = 0.001
"""Nearer than this to one point of the hinge line, two bodies meet there; share of the diagonal."""
SECTORS, ROUND = 12, 1.3
"""A part is round about a line if its reach in all sectors differs by less than this factor."""
STEEPEST = 0.3
"""A part that leaves the hinge line faster is shaped so; slower, the line runs askew."""


@dataclass(frozen=True)
class JointSweep:
    """What the sweep of one joint found; lengths as shares of the diagonal.

    Attributes:
        penetration: depth beyond rest reached by more than a few samples; at which joint value.
        area: share of the part's area that is deeper than the sweep's own small tolerance.
        gap: largest distance between part and rest beyond that at rest (slides); None where a
            part is too short to keep contact by itself.
        line_gap: distance of the hinge line from either body, or twice its stray (hinges), beyond
            the distance of the bodies at rest.
        filled: share of the part's area inside other links' collision pieces where their mesh is
            not solid.
    """

    penetration: float
    penetration_at: float
    area: float
    gap: float | None
    line_gap: float | None
    filled: float


def sweep_joint(model: CheckModel, joint: Joint, thresholds: Thresholds = THRESHOLDS) -> JointSweep:
    """Move one part, with all that it carries, through its range; everything else stands still."""
    return _Sweep(model, joint, thresholds).run()


class _Sweep:
    """One joint's part, its surroundings, and the measures taken along the way."""

    def __init__(self, model: CheckModel, joint: Joint, thresholds: Thresholds) -> None:
        self.model, self.joint, self.thresholds = model, joint, thresholds
        articulation = model.articulation
        self.mesh: Mesh = articulation.mesh
        self.carried = carried_links(articulation, joint)
        part = [articulation.links[i].faces for i in self.carried]
        self.part: IntArray = np.concatenate(part)
        self.static: IntArray = np.setdiff1d(np.arange(len(self.mesh.faces)), self.part)
        self.diagonal = self.mesh.diagonal
        self.motion: Motion = "prismatic" if joint.type == "prismatic" else "revolute"
        low, high = joint.lower, joint.upper
        if not np.isfinite(high - low):
            low, high = -np.pi, np.pi
        self.low, self.high = low, high

    def run(self) -> JointSweep:
        if not len(self.part) or not len(self.static):
            return JointSweep(0.0, 0.0, 0.0, None, None, 0.0)
        paths = PartPaths(self.mesh, self.part, self.static)
        depth, at, area, gap = self._penetration(paths)
        line_gap = self._line_gap()
        if line_gap is not None:  # a line between bodies that rest apart cannot lie on both
            line_gap = max(line_gap - paths.rest_gap / self.diagonal, 0.0)
        return JointSweep(depth, at, area, gap, line_gap, self._filled(paths))

    def _sides(self) -> list[FloatArray]:
        """Joint values to visit on either side of the rest pose, away from it."""
        return [steps_to(end) for end in (self.low, self.high) if abs(end) > 1e-9]

    def _penetration(self, paths: PartPaths) -> tuple[float, float, float, float | None]:
        joint, limit = self.joint, self.thresholds
        depth, at, area, gap = 0.0, 0.0, 0.0, 0.0
        slides = self.motion == "prismatic" and self._keeps_contact()
        rule = Rule(limit.penetration_share * self.diagonal, limit.penetration_area)
        for values in self._sides():
            found = paths.crossing(self.motion, joint.axis, joint.origin, values, rule)
            area = max(area, found.area)
            if found.value is not None and found.depth / self.diagonal > depth:
                depth, at = found.depth / self.diagonal, found.value
            if slides:
                gaps = paths.gaps(self.motion, joint.axis, joint.origin, values)
                gap = max(gap, float(gaps.max() - paths.rest_gap) / self.diagonal)
        return depth, at, area, gap if slides else None

    def _keeps_contact(self) -> bool:
        """Whether the part is long enough along its slide to be guided over the whole range.

        A drawer's bare front cannot be, nor can anything tell its loss of contact from its use.
        """
        points = self.mesh.vertices[self.mesh.faces[self.part].reshape(-1)]
        return float(np.ptp(points @ self.joint.axis)) >= 0.5 * (self.high - self.low)

    def _line_gap(self) -> float | None:
        """How far the hinge line strays from both bodies over their common extent."""
        joint = self.joint
        if self.motion == "prismatic":
            return None
        if self.joint.type == "continuous":
            return self._hub_gap()
        parent = self._faces_of([joint.parent])
        if not len(parent):
            parent = self.static
        spans = []
        for faces in (self.part, parent):
            along = (
                self.mesh.vertices[self.mesh.faces[faces].reshape(-1)] - joint.origin
            ) @ joint.axis
            spans.append((float(along.min()), float(along.max())))
        low, high = max(s[0] for s in spans), min(s[1] for s in spans)
        if high - low < 0.02 * self.diagonal:  # a knob on a plate: the line crosses the plate
            middle = 0.5 * (low + high)
            low, high = middle, middle
        if self._round_about_line():
            return 0.0
        count = 9
        stops = np.linspace(low, high, 4 * (count - 1) + 1).astype(np.float64)
        line = joint.origin + stops[:, None] * joint.axis
        fine = np.stack(
            [
                self._distance(line, self.carried, self.part),
                self._distance(line, [joint.parent], parent),
            ]
        )
        if (fine.max(axis=0) < PINNED * self.diagonal).any():
            near = 0.0  # a pin or a knuckle: both bodies meet on the line
        elif self._in_bearing(parent, low, high):
            near = float(np.quantile(fine[0, ::4], 0.2))
        else:
            # mounts may sit at the ends alone: a fifth of the line must lie on each body
            near = float(np.quantile(fine[:, ::4], 0.2, axis=1).max())
        return max(near, _askew(fine[0, ::4], stops[::4])) / self.diagonal

    def _distance(self, line: FloatArray, links: list[int], faces: IntArray) -> FloatArray:
        """Distance (n,) of points from faces, 0 inside the collision pieces of `links`."""
        distance = RayScene(self.mesh.vertices, self.mesh.faces[faces]).distance(line)
        for index in links:
            for hull in self.model.hulls[index]:
                distance[hull.depth(line) > 0] = 0.0
        return distance

    def _round_about_line(self) -> bool:
        """Whether the part is a ring, cap or knob about the line: the line need not touch it."""
        _, sector, radius = self._about_line(self.part)
        reach = np.zeros(SECTORS)
        np.maximum.at(reach, sector, radius)
        return bool(reach.min() > 0 and reach.max() < ROUND * reach.min())

    def _in_bearing(self, parent: IntArray, low: float, high: float) -> bool:
        """Whether the parent is a round hole about the line, where the part's shaft runs in it."""
        along, sector, radius = self._about_line(parent)
        margin = 0.02 * self.diagonal
        there = (along > low - margin) & (along < high + margin)
        reach = np.full(SECTORS, np.inf)
        np.minimum.at(reach, sector[there], radius[there])
        return bool(np.isfinite(reach).all() and reach.max() < ROUND * reach.min())

    def _about_line(self, faces: IntArray) -> tuple[FloatArray, IntArray, FloatArray]:
        """Along the line, sector about it and distance from it, of samples and vertices."""
        spots = np.concatenate([
            self.mesh.vertices[np.unique(self.mesh.faces[faces])],
            sample_surface(self.mesh.vertices, self.mesh.faces[faces], 2000, 5).points,
        ])  # fmt: skip
        arm = spots - self.joint.origin
        guess = np.eye(3)[int(np.abs(self.joint.axis).argmin())]
        side: FloatArray = np.asarray(unit(np.cross(self.joint.axis, guess)), dtype=np.float64)
        x, y = arm @ side, arm @ np.cross(self.joint.axis, side)
        sector = ((np.arctan2(y, x) / (2 * np.pi) + 1.0) * SECTORS).astype(int) % SECTORS
        return arm @ self.joint.axis, sector, np.hypot(x, y)

    def _hub_gap(self) -> float:
        """How far the axis of a part that turns round and round misses the part's own hull.

        A drum or a wheel is hollow where its axis runs, so its surface says nothing.
        """
        corners = self.mesh.vertices[np.unique(self.mesh.faces[self.part])]
        spots = self.joint.origin + (
            (corners.mean(axis=0) - self.joint.origin) @ self.joint.axis
        ) * (self.joint.axis)
        hull = hull_of(corners)
        if hull is None:
            return 0.0
        vertices, faces = hull
        a, b, c = (vertices[faces[:, k]] for k in range(3))
        normals = unit(np.cross(b - a, c - a))
        outside = float((np.einsum("ij,ij->i", normals, spots - a)).max())
        return max(outside, 0.0) / self.diagonal

    def _faces_of(self, links: list[int]) -> IntArray:
        return np.concatenate([self.model.articulation.links[i].faces for i in links])

    def _filled(self, scene: PartPaths) -> float:
        """Largest share of the part inside foreign collision pieces that its mesh does not meet."""
        joint = self.joint
        others = [i for i in range(len(self.model.hulls)) if i not in self.carried]
        low = scene.low - 0.02 * self.diagonal
        high = scene.high + 0.02 * self.diagonal
        samples = sample_surface(self.mesh.vertices, self.mesh.faces[self.part], 600, 5).points
        values = np.concatenate([[0.0], *self._sides()])
        values = values[np.linspace(0, len(values) - 1, min(len(values), 7)).astype(int)]
        moved = motion_points(self.motion, joint.axis, joint.origin, values, samples)
        low, high = np.minimum(low, moved.min((0, 1))), np.maximum(high, moved.max((0, 1)))
        hulls = [h for i in others for h in self.model.hulls[i] if _meet(h, low, high)]
        if not hulls:
            return 0.0
        deep = self.thresholds.filled_share * self.diagonal
        points = moved.reshape(-1, 3)
        depth = np.max([h.depth(points) for h in hulls], axis=0)
        suspect = np.flatnonzero(depth > deep)
        bad = np.zeros(len(points), dtype=bool)
        if len(suspect):
            where = points[suspect]
            far = scene.static_scene.distance(where) > deep
            bad[suspect[far]] = ~scene.solid.contains(where[far])
        return float(bad.reshape(len(values), -1).mean(axis=1).max())


def _askew(distance: FloatArray, along: FloatArray) -> float:
    """How far a line leaves its part towards the ends, metres; only half the length is seen."""
    rise = np.diff(distance)
    nearest = int(distance.argmin())
    noise = 0.02 * distance.max()
    if (rise[:nearest] > noise).any() or (rise[nearest:] < -noise).any():
        return 0.0  # a tilted line only gets farther on either side
    rise = np.abs(rise)
    rise = rise[rise > noise]
    if not len(rise) or np.median(rise) > STEEPEST * (along[1] - along[0]):
        return 0.0
    near, far = np.quantile(distance, [0.2, 0.8])
    return 2.0 * float(far - near)


def _meet(hull: Hull, low: FloatArray, high: FloatArray) -> bool:
    return bool((hull.points.max(0) >= low).all() and (hull.points.min(0) <= high).all())
