"""Whether an arm runs into itself, as a motion planner must know: the simulator stops it there."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import lru_cache
from itertools import combinations
from pathlib import Path

import numpy as np

from mam_envs.convex import ConvexPiece
from mam_envs.robots.base import RobotSpec, samples
from mam_pipeline.formats.xml_file import parse_xml
from mam_pipeline.types import FloatArray


class SelfCollision:
    """The pairs of links of a robot that could meet, and whether they do.

    A pair counts where at least two joints of the arm lie between its links, where the robot at
    rest keeps them apart, and where its SRDF (beside the URDF, as MoveIt and ManiSkill read it)
    does not take them out.

    Attributes:
        pairs: names of the links. room: metres that they must keep from each other.
    """

    def __init__(self, robot: RobotSpec, room: float, points: int = 48) -> None:
        """Find the pairs.

        Args:
            room: metres that links must keep from each other.
            points: of a convex shape whose hull stands for it: some have thousands of faces.
        """
        self.room = room
        self._points = robot.surface
        self._pieces = {
            name: [p for h in hulls if (p := ConvexPiece.of(samples(h, points)))]
            for name, hulls in robot.hulls.items()
        }
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
        balls = [_ball(points) for points in robot.surface.values()]
        order = {name: k for k, name in enumerate(robot.surface)}
        self._centers = np.array([center for center, _ in balls])
        self._index = np.array([[order[a], order[b]] for a, b in self.pairs], int).reshape(-1, 2).T
        self._reach = np.array([size for _, size in balls])[self._index].sum(axis=0) + room

    def touches(self, poses: Mapping[str, FloatArray]) -> bool:
        """Whether two links are too near.

        Args:
            poses: root_T_link (1, 4, 4) of all links.
        """
        return any(self._meet(a, b, poses) for a, b in self._near(poses))

    def _near(self, poses: Mapping[str, FloatArray]) -> Iterator[tuple[str, str]]:
        """Pairs whose balls are too near to each other."""
        frames = np.stack([poses[name][0] for name in self._points])
        centers = np.einsum("nij,nj->ni", frames[:, :3, :3], self._centers) + frames[:, :3, 3]
        first, second = self._index
        apart = centers[first] - centers[second]
        for k in np.flatnonzero(np.einsum("ij,ij->i", apart, apart) < self._reach**2):
            yield self.pairs[k]

    def _meet(self, a: str, b: str, poses: Mapping[str, FloatArray]) -> bool:
        """Whether points on one link come too near to the other."""
        one, other = poses[a][0], poses[b][0]
        return self._enters(a, b, one, other) or self._enters(b, a, other, one)

    def _enters(self, name: str, other: str, pose: FloatArray, into: FloatArray) -> bool:
        turn = into[:3, :3].T @ pose[:3, :3]
        points = self._points[name] @ turn.T + (pose[:3, 3] - into[:3, 3]) @ into[:3, :3]
        for piece in self._pieces[other]:
            low, high = piece.box
            inside = (points > low - self.room).all(axis=1) & (points < high + self.room).all(
                axis=1
            )
            near = points[inside]
            if len(near) and bool((_height(near, piece) < self.room).any()):
                return True
        return False


def _height(points: FloatArray, piece: ConvexPiece) -> FloatArray:
    """(P,) distance of points (P, 3) from the farthest of a shape's planes; negative inside."""
    out: FloatArray = (points @ piece.planes[:, :3].T + piece.planes[:, 3]).max(axis=1)
    return out


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
