"""The offline sweep: penetration, loss of contact, hinge lines and filled cavities.

The engine filters contacts between a parent and its child, so a drawer inside a solid block moves
without complaint there. Here every part is moved through its range against everything else, on
the surfaces themselves.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.check.model import CheckModel, Hull
from mam_pipeline.geometry.alignment import askew
from mam_pipeline.geometry.boxes import least_rectangle
from mam_pipeline.geometry.hinge_line import HingeBodies
from mam_pipeline.geometry.motion import Motion, motion_points
from mam_pipeline.geometry.paths import PartPaths, Rule, steps_to
from mam_pipeline.geometry.sampling import sample_surface
from mam_pipeline.thresholds import THRESHOLDS, Thresholds
from mam_pipeline.types import FloatArray, IntArray, Joint, Mesh


@dataclass(frozen=True)
class JointSweep:
    """What the sweep of one joint found; lengths as shares of the diagonal.

    Attributes:
        penetration: depth beyond rest reached by more than a few samples; at which joint value.
        blocking: links that it is in, by index.
        area: share of the part's area that is deeper than the sweep's own small tolerance.
        gap: largest distance between part and rest beyond that at rest, or by which the part has
            left the end of its channel (slides); of a part too short to keep contact by itself,
            the travel beyond the length of what it slides in; None where that is not exceeded.
        apart: distance of part and rest at rest.
        line_gap: distance of the hinge line from either body, or twice its stray (hinges), beyond
            the distance of the bodies at rest; or from the middle of a wheel or knob.
        askew: angle from the axis to the direction along which part and body are built, radians.
        filled: share of the part's area inside other links' collision pieces where their mesh is
            not solid.
    """

    penetration: float
    penetration_at: float
    blocking: frozenset[int]
    area: float
    gap: float | None
    apart: float
    line_gap: float | None
    askew: float
    filled: float


def sweep_joint(model: CheckModel, joint: Joint, thresholds: Thresholds = THRESHOLDS) -> JointSweep:
    """Move one part, with all that it carries, through its range; everything else stands still."""
    return _Sweep(model, joint, thresholds).run()


def share_in_guide(
    model: CheckModel, joint: Joint, least: float = 0.1, steps: int = 6,
    limit: Thresholds = THRESHOLDS,
) -> float:  # fmt: skip
    """Largest share of a slide's range within which it keeps touching what guides it, by halving.

    Args:
        model: has the joint by its name. least: share below which nothing is looked for.
    """
    own = next(j for j in model.articulation.joints if j.name == joint.name)
    low, high = least, 1.0
    for _ in range(steps):
        share = (low + high) / 2
        tried = replace(own, lower=share * joint.lower, upper=share * joint.upper)
        gap = sweep_joint(model, tried).gap
        low, high = (low, share) if gap and gap > limit.gap_share else (share, high)
    return low


def exchanged(model: CheckModel, joint: Joint, limit: Thresholds = THRESHOLDS) -> bool:
    """Whether a body hangs on its own part: a cabinet that moves, and its drawer that stands still.

    The part is far larger than what it hangs on, or slides and is larger and around it. A wheel may
    be both, and a door's leaf is larger than the frame that stands within its outline.
    """
    mesh, room = model.articulation.mesh, 0.01 * model.articulation.mesh.diagonal
    faces = [model.articulation.links[i].faces for i in (joint.child, joint.parent)]
    if joint.type == "continuous" or not all(map(len, faces)):
        return False
    part, body = (mesh.vertices[np.unique(mesh.faces[own])] for own in faces)
    size = [float(np.prod(np.maximum(np.ptp(own, axis=0), room))) for own in (part, body)]
    within = (body >= part.min(axis=0) - room) & (body <= part.max(axis=0) + room)
    around = float(within.all(axis=1).mean()) >= limit.exchanged_around
    slides = joint.type == "prismatic"
    return size[0] > (1.0 if slides and around else limit.exchanged_size) * size[1]


class _Sweep:
    """One joint's part, its surroundings, and the measures taken along the way."""

    def __init__(self, model: CheckModel, joint: Joint, thresholds: Thresholds) -> None:
        self.model, self.joint, self.thresholds = model, joint, thresholds
        articulation = model.articulation
        self.mesh: Mesh = articulation.mesh
        self.carried = articulation.carried_links(joint)
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
            return JointSweep(0.0, 0.0, frozenset(), 0.0, None, 0.0, None, 0.0, 0.0)
        paths = PartPaths(self.mesh, self.part, self.static)
        depth, at, blocking, area, gap = self._penetration(paths)
        line_gap = self._line_gap()
        if line_gap is not None:  # a line between bodies that rest apart cannot lie on both
            line_gap = max(line_gap - paths.rest_gap / self.diagonal, 0.0)
            line_gap = max(line_gap, self._off_centre())
        parent = self._faces_of([self.joint.parent])
        turned = askew(self.mesh, [self.part, parent], self.joint.axis)
        filled, apart = self._filled(paths), paths.rest_gap / self.diagonal
        return JointSweep(depth, at, blocking, area, gap, apart, line_gap, turned, filled)

    def _sides(self) -> list[FloatArray]:
        """Joint values to visit on either side of the rest pose, away from it."""
        return [steps_to(end) for end in (self.low, self.high) if abs(end) > 1e-9]

    def _penetration(
        self, paths: PartPaths
    ) -> tuple[float, float, frozenset[int], float, float | None]:
        joint, limit = self.joint, self.thresholds
        owner, blocking = self.model.articulation.face_link, set[int]()
        depth, at, area, gap = 0.0, 0.0, 0.0, 0.0
        slides = self.motion == "prismatic" and self._keeps_contact()
        rule = Rule(limit.penetration_share * self.diagonal, limit.penetration_area)
        round_ = joint.type == "continuous" and paths.turns_in_itself(joint.axis, joint.origin)
        for values in [] if round_ else self._sides():
            found = paths.crossing(self.motion, joint.axis, joint.origin, values, rule)
            area = max(area, found.area)
            hit = paths.obstacles(self.motion, joint.axis, joint.origin, found)
            blocking |= set(owner[hit].tolist())
            if found.value is not None and found.depth / self.diagonal > depth:
                depth, at = found.depth / self.diagonal, found.value
            if slides and np.isfinite(paths.rest_gap):  # else nothing stands near it: `mid_air`
                gaps = paths.gaps(self.motion, joint.axis, joint.origin, values)
                gap = max(gap, float(gaps.max() - paths.rest_gap) / self.diagonal)
        if self.motion == "prismatic" and not slides:
            unguided = self._unguided()
            return depth, at, frozenset(blocking), area, unguided if unguided > 0.0 else None
        gone = max(gap, self._left()) if slides else None
        return depth, at, frozenset(blocking), area, gone

    def _unguided(self) -> float:
        """How much farther a slide goes than anything that stands still reaches along its axis.

        No rail is longer than what it is mounted in, however short the part that rides on it.
        """
        points = self.mesh.vertices[self.mesh.faces[self.static].reshape(-1)]
        travel = max(abs(self.low), abs(self.high))
        return (travel - float(np.ptp(points @ self.joint.axis))) / self.diagonal

    def _keeps_contact(self) -> bool:
        """Whether the part is long enough along its slide to be guided over the whole range.

        A drawer's bare front cannot be, nor can anything tell its loss of contact from its use.
        """
        points = self.mesh.vertices[self.mesh.faces[self.part].reshape(-1)]
        return float(np.ptp(points @ self.joint.axis)) >= 0.5 * (self.high - self.low)

    def _left(self) -> float:
        """How far the part leaves the channel that it slides through.

        The channel is what stands still beside the part, ahead of it and behind it: walls, rails.
        """
        axis, margin = self.joint.axis, self.thresholds.gap_share * self.diagonal
        points = self.mesh.vertices[np.unique(self.mesh.faces[self.part])]
        aside = least_rectangle(points, axis)[:2]
        low, high = (points @ aside.T).min(axis=0) - margin, (points @ aside.T).max(axis=0) + margin
        corners = self.mesh.faces[self.static]
        spots = sample_surface(self.mesh.vertices, corners, 6000, 5).points
        spots = np.concatenate([spots, self.mesh.vertices[np.unique(corners)]])
        beside = ((spots @ aside.T > low) & (spots @ aside.T < high)).all(axis=1)
        if not beside.any():
            return 0.0
        start, end = float((points @ axis).min()), float((points @ axis).max())
        first, last = float((spots[beside] @ axis).min()), float((spots[beside] @ axis).max())
        values = np.array([0.0, self.low, self.high])
        common = np.minimum(end + values, last) - np.maximum(start + values, first)
        # a button before its hole is in no channel at rest
        return max(float(min(common[0], 0.0) - common.min()) / self.diagonal, 0.0)

    @cached_property
    def _bodies(self) -> HingeBodies:
        parent = self._faces_of([self.joint.parent])
        return HingeBodies(self.mesh, self.part, parent if len(parent) else self.static)

    def _off_centre(self) -> float:
        joint = self.joint
        return self._bodies.off_centre(joint.axis, joint.origin, joint.type == "continuous")

    def _line_gap(self) -> float | None:
        """How far the hinge line strays from both bodies; None for slides."""
        joint, bodies = self.joint, self._bodies
        if self.motion == "prismatic":
            return None
        if joint.type == "continuous":
            return bodies.hub_gap(joint.axis, joint.origin)

        def inside(points: FloatArray, part: bool) -> NDArray[np.bool_]:
            pieces = [h for i in (self.carried if part else [joint.parent])
                      for h in self.model.hulls[i]]  # fmt: skip
            solid = bodies.encloses(points, part)
            return np.any([solid, *(h.depth(points) > 0 for h in pieces)], axis=0)

        return bodies.line_gap(joint.axis, joint.origin, inside)

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


def _meet(hull: Hull, low: FloatArray, high: FloatArray) -> bool:
    return bool((hull.points.max(0) >= low).all() and (hull.points.min(0) <= high).all())
