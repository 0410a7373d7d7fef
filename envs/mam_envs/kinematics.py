"""Kinematic trees read from URDF files, and batched inverse kinematics with joint limits.

SAPIEN's Pinocchio solver ignores joint limits and solves one pose at a time; finding a place for
a robot means thousands of poses along a joint's path, so the solver here works on batches.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import yourdfpy
from scipy.spatial.transform import Rotation

from mam_pipeline.errors import InputError
from mam_pipeline.formats.urdf.tree import parse_urdf
from mam_pipeline.types import FloatArray

MOVABLE = ("revolute", "continuous", "prismatic")


@dataclass(frozen=True)
class TreeJoint:
    """One URDF joint: `origin` is parent_T_joint at q = 0, `axis` a unit vector in its frame."""

    name: str
    type: str
    parent: str
    child: str
    origin: FloatArray
    axis: FloatArray
    lower: float
    upper: float


@dataclass(frozen=True)
class KinematicModel:
    """Links and joints of one URDF, joints parents first."""

    links: tuple[str, ...]
    joints: tuple[TreeJoint, ...]
    robot: yourdfpy.Robot = field(repr=False)
    scale: float = 1.0

    @staticmethod
    def load(path: str | Path, scale: float = 1.0) -> KinematicModel:
        """Read a URDF without its meshes; lengths are multiplied by `scale`.

        Raises:
            InputError: the file is missing or is no URDF, or its links form no tree.
        """
        robot = parse_urdf(Path(path))
        children = {j.child for j in robot.joints}
        order = [link.name for link in robot.links if link.name not in children]
        if len(order) != 1:
            raise InputError(f"{path} has {len(order)} root links; one is needed")
        joints: list[TreeJoint] = []
        for name in order:  # grows while it is walked: breadth first
            for j in robot.joints:
                if j.parent == name:
                    joints.append(_joint(j, scale))
                    order.append(j.child)
        return KinematicModel(tuple(order), tuple(joints), robot, scale)

    @property
    def root(self) -> str:
        return self.links[0]

    def joint(self, name: str) -> TreeJoint:
        return next(j for j in self.joints if j.name == name)

    def subtree(self, link: str) -> tuple[str, ...]:
        """`link` and every link that hangs on it."""
        out = [link]
        for j in self.joints:
            if j.parent in out:
                out.append(j.child)
        return tuple(out)

    def chain(self, tip: str) -> tuple[TreeJoint, ...]:
        """Joints from the root to `tip`."""
        by_child = {j.child: j for j in self.joints}
        out: list[TreeJoint] = []
        while tip in by_child:
            out.append(by_child[tip])
            tip = by_child[tip].parent
        return tuple(reversed(out))

    def link_poses(self, q: Mapping[str, float | FloatArray]) -> dict[str, FloatArray]:
        """root_T_link of every link as (N, 4, 4); joints that `q` does not name stay at 0.

        Args:
            q: joint name to a value or (N,) values, radians or metres.
        """
        return self._poses(q, self.joints)

    def link_pose(self, link: str, q: Mapping[str, float | FloatArray]) -> FloatArray:
        """(N, 4, 4) root_T_link of one link, as in `link_poses`."""
        if not q and link in self._rest:
            return self._rest[link]
        found = self._poses(q, self.chain(link))[link]
        if not q:
            self._rest[link] = found
        return found

    @cached_property
    def _rest(self) -> dict[str, FloatArray]:
        """Poses of links at q = 0, as they are asked for."""
        return {}

    def _poses(
        self, q: Mapping[str, float | FloatArray], joints: Sequence[TreeJoint]
    ) -> dict[str, FloatArray]:
        n = max((np.size(v) for v in q.values()), default=1)
        out = {self.root: np.tile(np.eye(4), (n, 1, 1))}
        for j in joints:
            value = np.broadcast_to(np.asarray(q.get(j.name, 0.0), dtype=float), (n,))
            rotation, shift = _local(j, value)
            parent = out[j.parent]
            pose = np.tile(np.eye(4), (n, 1, 1))
            pose[:, :3, :3] = parent[:, :3, :3] @ rotation
            pose[:, :3, 3] = np.einsum("nij,nj->ni", parent[:, :3, :3], shift) + parent[:, :3, 3]
            out[j.child] = pose
        return out


@dataclass(frozen=True)
class Solution:
    """Result of a batch of inverse-kinematics problems.

    Attributes:
        q: (N, n) joint values inside the limits.
        position_error: (N,) metres.
        rotation_error: (N,) radians, over the constrained directions only.
    """

    q: FloatArray
    position_error: FloatArray
    rotation_error: FloatArray

    def good(self, position: float, rotation: float) -> np.ndarray:
        """(N,) which problems were solved to these tolerances."""
        return (self.position_error <= position) & (self.rotation_error <= rotation)


@dataclass(frozen=True)
class Chain:
    """A serial arm: the joints from the root to a tip, some of them locked.

    Attributes:
        joints: all joints on the way, fixed ones included.
        active: names of the joints that inverse kinematics may move, in order.
        locked: values of the other movable joints.
        tool: (4, 4) tip_T_tool.
        radian: metres that one radian of error is worth to the solver.
    """

    joints: tuple[TreeJoint, ...]
    active: tuple[str, ...]
    locked: Mapping[str, float]
    tool: FloatArray
    radian: float = 0.3

    @cached_property
    def limits(self) -> FloatArray:
        """(n, 2) joint limits, a hair inside the URDF's so that controllers accept them."""
        by_name = {j.name: j for j in self.joints}
        rows = [(by_name[n].lower, by_name[n].upper) for n in self.active]
        out = np.clip(np.array(rows), -2 * np.pi, 2 * np.pi)
        return out + np.array([0.005, -0.005])

    def forward(self, q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Tool rotation (N, 3, 3) and position (N, 3) in the root frame, Jacobian (N, 6, n)."""
        n = len(q)
        rotation: FloatArray = np.tile(np.eye(3), (n, 1, 1))
        position: FloatArray = np.zeros((n, 3))
        axes, points, sliding = [], [], []
        for j in self.joints:
            if j.name in self.active:
                value = q[:, self.active.index(j.name)]
            else:
                value = np.full(n, float(self.locked.get(j.name, 0.0)))
            local, shift = _local(j, value)
            before = rotation
            position = position + np.einsum("nij,nj->ni", before, shift)
            rotation = before @ local
            if j.name in self.active:
                axes.append(rotation @ j.axis)
                points.append(position)
                sliding.append(j.type == "prismatic")
        position = position + rotation @ self.tool[:3, 3]
        rotation = rotation @ self.tool[:3, :3]
        jacobian = np.zeros((n, 6, len(self.active)))
        for k, (axis, point, slide) in enumerate(zip(axes, points, sliding)):
            if slide:
                jacobian[:, :3, k] = axis
                continue
            (x, y, z), (u, v, w) = axis.T, (position - point).T
            jacobian[:, 0, k] = y * w - z * v  # np.cross takes three times as long
            jacobian[:, 1, k] = z * u - x * w
            jacobian[:, 2, k] = x * v - y * u
            jacobian[:, 3:, k] = axis
        return rotation, position, jacobian

    def solve(
        self,
        targets: FloatArray,
        start: FloatArray,
        rotation_weight: Sequence[float] = (1.0, 1.0, 1.0),
        iterations: int = 40,
        posture: FloatArray | None = None,
        gain: float = 0.05,
    ) -> Solution:
        """Damped least squares with joint limits for a batch of tool poses.

        Args:
            targets: (N, 4, 4) root_T_tool.
            start: (N, n) first guesses; the solution stays on their branch.
            rotation_weight: how much each tool axis' rotation counts (0 = free); a five-joint arm
                needs weights below 1 so that position wins.
            posture: (n,) or (N, n) values that the null space is pulled to.
            gain: strength of that pull per iteration.
        """
        weight = np.asarray(rotation_weight, dtype=float)
        scale = self.radian * weight
        lower, upper = self.limits[:, 0], self.limits[:, 1]
        q: FloatArray = np.clip(np.array(start, dtype=float), lower, upper)
        pull = np.zeros_like(q) if posture is None else np.broadcast_to(posture, q.shape)
        position_error, rotation_error = np.full(len(q), np.inf), np.full(len(q), np.inf)
        live = np.arange(len(q))
        for step in range(iterations + 1):
            rotation, position, jacobian = self.forward(q[live])
            dp = targets[live, :3, 3] - position
            turned = rotation_vector(targets[live, :3, :3], rotation)
            dr = np.einsum("nji,nj->ni", rotation, turned)
            position_error[live] = np.linalg.norm(dp, axis=1)
            rotation_error[live] = np.linalg.norm(dr * (weight > 0), axis=1)
            if step == iterations:
                break
            if step >= 8 and step % 4 == 0:  # leave what has arrived, and what stays far away
                size = position_error[live] + self.radian * (np.abs(dr * weight)).sum(axis=1)
                on = (size > 2e-4) & ((step < 20) | (size < 0.25))
                live, rotation, jacobian = live[on], rotation[on], jacobian[on]
                dp, dr = dp[on], dr[on]
                if not len(live):
                    break
            settle = posture is None or step >= iterations - 10
            towards = np.zeros((len(live), q.shape[1])) if settle else gain * (pull - q)[live]
            delta = _step(q[live], lower, upper, rotation, jacobian, dp, dr, scale, towards)
            q[live] = np.clip(q[live] + delta, lower, upper)
        return Solution(q, position_error, rotation_error)


def _step(
    q: FloatArray,
    lower: FloatArray,
    upper: FloatArray,
    rotation: FloatArray,
    jacobian: FloatArray,
    dp: FloatArray,
    dr: FloatArray,
    scale: FloatArray,
    pull: FloatArray,
) -> FloatArray:
    """One damped least-squares step (N, n), without the joints that press on their limits.

    `scale`: (3,) metres that one radian about each tool axis is worth.
    """
    turning = rotation.transpose(0, 2, 1) @ jacobian[:, 3:]
    j = np.concatenate([jacobian[:, :3], scale[:, None] * turning], axis=1)
    e = np.concatenate([dp, scale * dr], axis=1)
    free = np.ones_like(q, dtype=bool)
    damping = (1e-6 + 1e-3 * (e * e).sum(axis=1))[:, None, None] * np.eye(6)
    delta = pull
    for _ in range(2):
        jf, pf = j * free[:, None, :], pull * free
        rhs = e[..., None] - jf @ pf[..., None]
        back = np.linalg.solve(jf @ jf.transpose(0, 2, 1) + damping, rhs)
        delta = (jf.transpose(0, 2, 1) @ back)[..., 0] + pf
        over = ((q + delta > upper) & (q >= upper - 1e-6)) | (
            (q + delta < lower) & (q <= lower + 1e-6)
        )
        if not (over & free).any():
            break
        free &= ~over
    size = np.abs(delta).max(axis=1, keepdims=True)
    return delta * np.minimum(1.0, 0.35 / np.maximum(size, 1e-9))


def rotation_vector(target: FloatArray, current: FloatArray) -> FloatArray:
    """(N, 3) rotation vector, root frame, that turns `current` (N, 3, 3) into `target`."""
    return np.asarray(Rotation.from_matrix(target @ current.transpose(0, 2, 1)).as_rotvec())


def _local(joint: TreeJoint, value: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Rotation (N, 3, 3) and shift (N, 3) of parent_T_child at joint values (N,)."""
    n = len(value)
    a = joint.origin[:3, :3]
    shift = np.tile(joint.origin[:3, 3], (n, 1))
    if joint.type in ("revolute", "continuous"):
        return a @ Rotation.from_rotvec(value[:, None] * joint.axis).as_matrix(), shift
    if joint.type == "prismatic":
        shift = shift + value[:, None] * (a @ joint.axis)
    return np.broadcast_to(a, (n, 3, 3)), shift


def _joint(j: yourdfpy.Joint, scale: float) -> TreeJoint:
    origin = np.eye(4) if j.origin is None else np.array(j.origin, dtype=float)
    origin[:3, 3] *= scale
    axis = np.array([1.0, 0, 0]) if j.axis is None else np.array(j.axis, dtype=float)
    length = float(np.linalg.norm(axis))
    if j.type in MOVABLE and length < 1e-6:
        raise InputError(f"joint {j.name!r} has a zero axis")
    lower, upper = -np.inf, np.inf
    if j.limit is not None and j.type in ("revolute", "prismatic"):
        unit = scale if j.type == "prismatic" else 1.0
        lower = unit * float(j.limit.lower if j.limit.lower is not None else -np.inf)
        upper = unit * float(j.limit.upper if j.limit.upper is not None else np.inf)
    return TreeJoint(
        j.name, j.type, j.parent, j.child, origin, axis / max(length, 1e-9), lower, upper
    )
