"""The articulated object as planning sees it: kinematics, convex pieces, grasps, joint ranges."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from mam_envs.convex import THIN_SHARE, ConvexPiece
from mam_envs.kinematics import KinematicModel
from mam_pipeline.asset.card import Asset, CardGrasp, CardJoint
from mam_pipeline.asset.dynamics import catch_pull, rubbing
from mam_pipeline.errors import NotPhysicalError, unknown_name
from mam_pipeline.formats.urdf.geometry import existing, origin_of, shape_triangles
from mam_pipeline.types import Coupling, FloatArray, IntArray

GRAVITY = 9.81  # m/s^2


@dataclass(frozen=True)
class ObjectModel:
    """An asset at one scale; lengths are in metres after scaling, frames as in the asset."""

    asset: Asset
    kinematics: KinematicModel
    scale: float

    @staticmethod
    def load(asset: Asset, scale: float = 1.0) -> ObjectModel:
        """Read the asset's URDF.

        Raises:
            InputError: the URDF is missing or broken.
        """
        return ObjectModel(asset, KinematicModel.load(asset.urdf_path, scale), scale)

    def card_joint(self, name: str) -> CardJoint:
        """The card's entry of a joint, or an error that names the others."""
        movable = self.asset.card.movable
        for joint in movable:
            if joint.name == name:
                return joint
        raise unknown_name("joint", name, [j.name for j in movable])

    def default_joint(self) -> str:
        """The most confident joint that has a grasp (then the first movable one)."""
        movable = self.asset.card.movable
        if not movable:
            asleep = [j.child for j in self.asset.card.likeliest]
            way = f"; dormant: {', '.join(asleep)} (articulate --accept NAME)" if asleep else ""
            raise NotPhysicalError(f"{self.asset.card.name} has no movable joint{way}")
        grasped = {g.joint for g in self.asset.card.grasps}
        best = max(movable, key=lambda j: (j.name in grasped, j.confidence))
        return best.name

    def unit(self, joint: CardJoint) -> float:
        """Factor from the card's joint values to this model's (scale for slides)."""
        return self.scale if joint.type == "prismatic" else 1.0

    def span(self, joint: CardJoint) -> tuple[float, float]:
        """(closed, open) joint values; where the card does not say, closed is the limit next to
        the rest pose. A continuous joint counts one turn."""
        unit = self.unit(joint)
        closed, open_ = joint.closed, joint.open
        if abs(open_ - closed) < 1e-9:
            if joint.lower is None or joint.upper is None:
                closed, open_ = 0.0, 2 * np.pi
            elif abs(joint.upper) >= abs(joint.lower):
                closed, open_ = joint.lower, joint.upper
            else:
                closed, open_ = joint.upper, joint.lower
        return closed * unit, open_ * unit

    @cached_property
    def couplings(self) -> dict[str, Coupling]:
        """What joints follow, by name of the one that follows, at this scale."""
        cards = {j.name: j for j in self.asset.card.joints}
        out = {}
        for name, joint in cards.items():
            if joint.coupling is not None:
                own, leader = self.unit(joint), self.unit(cards[joint.coupling.joint])
                multiplier = joint.coupling.multiplier * own / leader
                offset = joint.coupling.offset * own
                out[name] = Coupling(joint.coupling.joint, multiplier, offset)
        return out

    def catch_joint(self, name: str, place: float | None = None) -> CardJoint | None:
        """The card's joint with closed and open values and the catch at this scale; None where
        nothing but friction keeps it closed.

        Args:
            place: of the catch's force in its range, 0 to 1; None for the usual force.
        """
        joint = next((j for j in self.asset.card.joints if j.name == name), None)
        if joint is None or joint.catch is None or joint.catch.force == 0.0:
            return None
        catch, unit, closed_open = joint.catch, self.unit(joint), self.span(joint)
        force = catch.force if place is None else between(catch.force_range, place, catch.force)
        force *= self.scale ** (3 if joint.type == "prismatic" else 4)
        caught = replace(catch, force=force, width=catch.width * unit)
        return replace(joint, closed=closed_open[0], open=closed_open[1], catch=caught)

    def limits(self, joint: CardJoint) -> tuple[float, float]:
        """(lower, upper), infinite for continuous joints."""
        unit = self.unit(joint)
        lower = -np.inf if joint.lower is None else joint.lower * unit
        upper = np.inf if joint.upper is None else joint.upper * unit
        return lower, upper

    def grasps(self, joint: str) -> list[CardGrasp]:
        """The joint's grasps, most confident first, scaled, and after them those of the joints
        that it carries (a door is opened by the knob on it)."""
        found = [g for g in self.asset.card.grasps if g.joint == joint]
        carried = set(self.moving_links(joint))
        found += [
            replace(g, joint=joint, confidence=0.7 * g.confidence)
            for g in self.asset.card.grasps
            if g.joint != joint and g.link in carried and g.kind in ("handle", "knob", "edge")
        ]
        s = self.scale
        rows = [
            replace(g, position=[s * v for v in g.position], width=g.width * s, depth=g.depth * s)
            for g in found
        ]
        return sorted(rows, key=lambda g: -g.confidence)

    def rest_value(self, joint: str) -> float:
        """Value of a joint in the source's pose: 0, or the limit next to it."""
        row = next((j for j in self.kinematics.joints if j.name == joint), None)
        return 0.0 if row is None else float(np.clip(0.0, row.lower, row.upper))

    def moving_links(self, joint: str) -> tuple[str, ...]:
        """Links that the joint carries."""
        return self.kinematics.subtree(self.kinematics.joint(joint).child)

    def mass(self, joint: str) -> float:
        """Kilograms carried by the joint, from the URDF."""
        moving = self.moving_links(joint)
        total = 0.0
        for link in self.kinematics.robot.links:
            if link.name in moving and link.inertial is not None:
                total += float(link.inertial.mass or 0.0)
        return total * self.scale**3

    def motion(self, joint: str, q: FloatArray, others: Mapping[str, float]) -> FloatArray:
        """asset_T_moved (N, 4, 4): what carries points of the moving link from the rest pose
        (q = 0 of every joint) to joint values `q` (N,), the other joints at `others`."""
        child = self.kinematics.joint(joint).child
        rest = self.kinematics.link_pose(child, {})[0]
        poses = self.kinematics.link_pose(child, {**others, joint: q})
        return poses @ np.linalg.inv(rest)

    def pulling_force(
        self, joint: str, q: FloatArray, point: FloatArray, width: float = 0.0
    ) -> float:
        """Largest force (N) at `point` (3,) (asset frame, rest) that gravity, where nothing carries
        the part, friction and a catch ask for along the path `q` (N,): virtual work over the
        point's travel, or over that of the fingers round a knob `width` metres across."""
        card = self.card_joint(joint)
        moving = self.moving_links(joint) if card.balance is None else ()
        poses = self.kinematics.link_poses({joint: q})
        energy = np.zeros(len(q))
        for link in self.kinematics.robot.links:
            if link.name not in moving or link.inertial is None or not link.inertial.mass:
                continue
            centre = np.zeros(3) if link.inertial.origin is None else link.inertial.origin[:3, 3]
            height = poses[link.name][:, 2, :3] @ (centre * self.scale) + poses[link.name][:, 2, 3]
            energy += float(link.inertial.mass) * self.scale**3 * GRAVITY * height
        motion = self.motion(joint, q, {})
        where = motion[:, :3, :3] @ point + motion[:, :3, 3]
        travel = np.linalg.norm(np.diff(where, axis=0), axis=1)
        if self.kinematics.joint(joint).type != "prismatic":
            travel = np.maximum(travel, np.abs(np.diff(q)) * max(0.5 * width, 0.005))
        travel = np.maximum(travel, 1e-6)
        way = np.abs(np.diff(q))
        against = rubbing(card)[0] * way
        caught = self.catch_joint(joint)
        if caught is not None:  # as hard as where a step begins: that is where it must start
            pulls = np.array([catch_pull(caught, float(v)) for v in q[:-1]])
            against = against + np.maximum(-pulls * np.sign(np.diff(q)), 0.0) * way
        return float(np.max((np.maximum(np.diff(energy), 0.0) + against) / travel, initial=0.0))

    @cached_property
    def pieces(self) -> dict[str, tuple[ConvexPiece, ...]]:
        """Convex collision pieces of every link."""
        return {
            link.name: tuple(
                p for c in link.collisions for p in _pieces(c, self.asset.urdf_path, self.scale)
            )
            for link in self.kinematics.robot.links
        }

    def bounds(self, q: Mapping[str, float] | None = None) -> FloatArray:
        """(2, 3) box of the collision pieces at joint values `q`, asset frame."""
        poses = self.kinematics.link_poses(q or {})
        rows = [
            piece.points @ poses[name][0][:3, :3].T + poses[name][0][:3, 3]
            for name, pieces in self.pieces.items()
            for piece in pieces
        ]
        if not rows:
            raise NotPhysicalError(f"{self.asset.card.name} has no collision shapes")
        points = np.concatenate(rows)
        return np.stack([points.min(axis=0), points.max(axis=0)])

    @cached_property
    def footprint(self) -> FloatArray:
        """(2, 3) box at the rest pose (of `bounds()`), remembered."""
        return self.bounds()

    @cached_property
    def boxes(self) -> dict[str, FloatArray]:
        """(P, 2, 3) box of every link's pieces, link frame."""
        return {
            name: np.array([p.box for p in pieces])
            for name, pieces in self.pieces.items()
            if pieces
        }

    def depth(
        self, points: FloatArray, q: Mapping[str, float], skip: tuple[str, ...] = ()
    ) -> FloatArray:
        """(N,) how deep points (N, 3), asset frame, lie inside the object; -inf outside."""
        out = np.full(len(points), -np.inf)
        for rows, depth, _ in self._dips(points, q, skip):
            out[rows] = np.maximum(out[rows], depth)
        return out

    def runs_into(
        self,
        points: FloatArray,
        q: Mapping[str, float],
        slack: float = 0.0,
        skip: tuple[str, ...] = (),
    ) -> bool:
        """Whether any of the points (N, 3), asset frame, is deeper inside the object than `slack`
        (m), or than a share of a thin piece's thickness."""
        return any(
            bool((depth > min(slack, THIN_SHARE * piece.thickness)).any())
            for _, depth, piece in self._dips(points, q, skip)
        )

    def cuts_into(
        self,
        hulls: Sequence[ConvexPiece],
        pose: FloatArray,
        q: Mapping[str, float],
        slack: float,
        skip: tuple[str, ...] = (),
    ) -> bool:
        """Whether a piece goes more than `slack` (m) into convex shapes that stand in the frame
        `pose` (4, 4), asset frame; a negative slack is a distance that they must keep."""
        if not hulls:
            return False
        poses = self.kinematics.link_poses(q)
        corners = np.concatenate([hull.points for hull in hulls]) @ pose[:3, :3].T + pose[:3, 3]
        room = max(0.0, -slack)
        for name, boxes in self.boxes.items():
            if name in skip:
                continue
            link = poses[name][0]
            local = (corners - link[:3, 3]) @ link[:3, :3]
            low, high = local.min(axis=0) - room, local.max(axis=0) + room
            apart = (boxes[:, 0] > high) | (boxes[:, 1] < low)
            into = np.linalg.inv(link) @ pose
            for k in np.flatnonzero(~apart.any(axis=1)):
                if any(self.pieces[name][k].cuts(hull, into, slack) for hull in hulls):
                    return True
        return False

    def _dips(
        self, points: FloatArray, q: Mapping[str, float], skip: tuple[str, ...]
    ) -> Iterator[tuple[IntArray, FloatArray, ConvexPiece]]:
        """For each piece that points lie in: their indices and depths (>= 0).

        Boxes come first: of thousands of point-piece pairs a handful is left to be looked at.
        """
        poses = self.kinematics.link_poses(q)
        for name, boxes in self.boxes.items():
            if name in skip:
                continue
            pose = poses[name][0]
            local = (points - pose[:3, 3]) @ pose[:3, :3]
            low, high = boxes[:, 0].min(axis=0), boxes[:, 1].max(axis=0)
            near = np.flatnonzero(((local >= low) & (local <= high)).all(axis=1))
            if not len(near):
                continue
            here = local[near]
            inside = ((here[:, None] >= boxes[:, 0]) & (here[:, None] <= boxes[:, 1])).all(axis=2)
            for k in np.flatnonzero(inside.any(axis=0)):
                rows, piece = inside[:, k], self.pieces[name][k]
                distance = (here[rows] @ piece.planes[:, :3].T + piece.planes[:, 3]).max(axis=1)
                within = distance <= 0.0
                if within.any():
                    yield near[rows][within], -distance[within], piece


def between(pair: tuple[float, float], place: float, usual: float) -> float:
    """A value at a place, 0 to 1, of a range, evenly in its logarithm; `usual` where it is none."""
    low, high = pair
    return low * (high / low) ** place if 0.0 < low <= high else usual


def _pieces(collision: Any, urdf: Path, scale: float) -> list[ConvexPiece]:
    """The convex pieces of one URDF collision element, scaled."""
    geometry = collision.geometry
    if geometry.mesh is not None:
        existing(geometry.mesh.filename, urdf)
    surface = shape_triangles(geometry, urdf.parent, sections=16, subdivisions=1)
    if surface is None:
        return []
    origin = origin_of(collision)
    points = (surface[0] @ origin[:3, :3].T + origin[:3, 3]) * scale
    piece = ConvexPiece.of(points)
    return [] if piece is None else [piece]  # flat: no volume to run into
