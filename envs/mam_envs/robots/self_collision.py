"""Whether an arm runs into itself, as a motion planner must know: the simulator stops it there."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from itertools import combinations
from pathlib import Path

import numpy as np

from mam_envs.convex import ConvexPiece
from mam_envs.robots.base import RobotSpec, samples
from mam_pipeline.formats.xml_file import parse_xml
from mam_pipeline.types import FloatArray

POINTS = 48
"""Of a convex shape whose hull stands for it: some have thousands of faces."""


class SelfCollision:
    """The pairs of links of a robot that could meet, and whether they do.

    A pair counts where at least two joints of the arm lie between its links, where the robot at
    rest keeps them apart, and where its SRDF (beside the URDF, as MoveIt and ManiSkill read it)
    does not take them out.

    Attributes:
        pairs: names of the links. room: metres that they must keep from each other.
    """

    def __init__(self, robot: RobotSpec, room: float) -> None:
        """Find the pairs.

        Args:
            room: metres that links must keep from each other.
        """
        self.room = room
        self._points = robot.surface
        self._pieces = {
            name: [p for h in hulls if (p := ConvexPiece.of(samples(h, POINTS)))]
            for name, hulls in robot.hulls.items()
        }
        self._balls = {name: _ball(points) for name, points in robot.surface.items()}
        between = {
            name: {j.name for j in robot.model.chain(name)} & set(robot.arm)
            for name in robot.surface
        }
        poses = robot.link_poses(robot.rest_arm[None], robot.opened)
        out = _taken_out(robot.path.with_suffix(".srdf"))
        self.pairs = [
            (a, b)
            for a, b in combinations(robot.surface, 2)
            if len(between[a] ^ between[b]) > 1
            and frozenset((a, b)) not in out
            and not self._meet(a, b, poses)
        ]

    def touches(self, poses: Mapping[str, FloatArray]) -> bool:
        """Whether two links are too near.

        Args:
            poses: root_T_link (1, 4, 4) of all links.
        """
        return any(self._meet(a, b, poses) for a, b in self.pairs)

    def _meet(self, a: str, b: str, poses: Mapping[str, FloatArray]) -> bool:
        into = np.linalg.inv(poses[b][0]) @ poses[a][0]
        (center, radius), (other, size) = self._balls[a], self._balls[b]
        apart = into[:3, :3] @ center + into[:3, 3] - other
        if float(np.linalg.norm(apart)) > radius + size + self.room:
            return False
        return self._enters(a, b, into) or self._enters(b, a, np.linalg.inv(into))

    def _enters(self, name: str, other: str, into: FloatArray) -> bool:
        """Whether points on one link, carried into the other's frame, come too near to it."""
        points = self._points[name] @ into[:3, :3].T + into[:3, 3]
        return any(
            bool(((points @ p.planes[:, :3].T + p.planes[:, 3]).max(axis=1) < self.room).any())
            for p in self._pieces[other]
        )


@lru_cache
def self_collision(robot: RobotSpec, room: float) -> SelfCollision:
    """That of a robot, built once."""
    return SelfCollision(robot, room)


def _taken_out(srdf: Path) -> set[frozenset[str]]:
    """Pairs of links that a robot's SRDF says do not collide; none where it has no such file."""
    if not srdf.is_file():
        return set()
    rows = parse_xml(srdf).iter("disable_collisions")
    return {frozenset((row.get("link1", ""), row.get("link2", ""))) for row in rows}


def _ball(points: FloatArray) -> tuple[FloatArray, float]:
    """A ball round points (P, 3): its centre and radius."""
    center = 0.5 * (points.min(axis=0) + points.max(axis=0))
    return center, float(np.linalg.norm(points - center, axis=1).max())
