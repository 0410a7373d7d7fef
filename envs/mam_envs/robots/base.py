"""What the environments need to know of a robot arm: how it reaches, grips and is commanded.

A tool frame is the same for all of them: origin between the fingertips, z the direction in which
the hand approaches, y the direction in which the fingers close.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np
import trimesh
import yourdfpy

from mam_envs.convex import ConvexPiece
from mam_envs.kinematics import Chain, KinematicModel
from mam_envs.robots.packaged import packaged
from mam_pipeline.errors import ConfigError, unknown_name
from mam_pipeline.formats.door import outside_allowed
from mam_pipeline.formats.urdf.geometry import shape_triangles
from mam_pipeline.types import FloatArray

Hand = tuple[FloatArray, FloatArray, list[ConvexPiece], list[ConvexPiece]]


@dataclass(frozen=True)
class Drive:
    """A base on wheels. Its part of an action comes last: what changes the held joints, then the
    speeds forwards and of turning to the left.

    Attributes:
        joints: of the base in the plane: along x, along y, and turning.
        link: what these joints carry; its frame is the robot's base frame.
        on_ground: links that stand on the ground and do not collide with it.
        speed, turning: what an action of 1 asks for, m/s and rad/s.
        held: joints that keep their values of `rest`, such as a torso, in the action's order.
        held_delta: change that an action of 1 asks of them in one step, metres or radians.
        steps: control steps that an episode has for the way to the object.
    """

    joints: tuple[str, str, str]
    link: str
    on_ground: tuple[str, ...]
    speed: float
    turning: float
    held: tuple[str, ...] = ()
    held_delta: float = 0.1
    steps: int = 100


@dataclass(frozen=True, eq=False)
class RobotSpec:
    """What placement, environment and expert need to know of an arm.

    Attributes:
        uid: the arm's name.
        agent: uid of a ManiSkill agent to use; "" makes one from this specification.
        urdf: path below ManiSkill's robot folder, or an absolute one.
        package: where the URDF comes from otherwise: a package of the index that keeps robots as
            example-robot-data does (below cmeel.prefix/share), and `urdf` is below its robots/.
        arm: joints that inverse kinematics moves.
        locked: values of other joints on the way to the hand.
        tip: link that carries the tool.
        tool_position, tool_approach, tool_closing: tool frame in the tip link.
        gripper: gripper joints; `opened` and `closed` are commands (closed squeezes), at `shut`
            the fingers just touch.
        max_width: widest object between the fingers, metres.
        tip_ahead: how far the fingertips reach past the tool's origin, metres.
        finger_links: links whose contact with a handle is wanted.
        hand_links: links that may come close to it.
        rest: joint values at the start of an episode (others 0).
        rotation_weight: of inverse kinematics, tool frame; below 1 where the arm has < 6 joints.
        rotation_tolerance: radians.
        reach: metres from base to tool, for picking base positions.
        shoulder: height of the shoulder above the base, metres.
        force: what the hand can pull, newtons (assumed, below the data sheet's payload limits).
        forward: yaw of the base frame in which the arm points, radians.
        base_radius: clearance around the base, metres.
        gripper_range: command values that the gripper's action of -1 and 1 stands for; () is the
            range from `opened` to `closed`.
        step: joint motion per control step that real arms of the kind follow, radians.
        floor_only: the robot drives on the floor and cannot be put on a stand.
        extra_actions: entries of the action behind arm and gripper (body, base); 0 without `drive`.
        drive: the base on wheels of a robot that drives to the object; None stands still.
        delta: arm joint change that a normalised action of 1 asks for in pd_joint_delta_pos.
        passive_links: words in the names of links that never come near the object.
    """

    uid: str
    urdf: str
    arm: tuple[str, ...]
    tip: str
    tool_position: tuple[float, float, float]
    tool_approach: tuple[float, float, float]
    tool_closing: tuple[float, float, float]
    gripper: tuple[str, ...]
    opened: float
    closed: float
    shut: float
    max_width: float
    tip_ahead: float
    finger_links: tuple[str, ...]
    hand_links: tuple[str, ...]
    rest: Mapping[str, float]
    locked: Mapping[str, float] = field(default_factory=dict)
    rotation_weight: tuple[float, float, float] = (1.0, 1.0, 1.0)
    rotation_tolerance: float = 0.03
    reach: float = 0.8
    shoulder: float = 0.33
    force: float = 60.0
    forward: float = 0.0
    base_radius: float = 0.12
    step: float = 0.1
    floor_only: bool = False
    gripper_range: tuple[float, float] | tuple[()] = ()
    extra_actions: int = 0
    delta: float = 0.1
    passive_links: tuple[str, ...] = ("wheel", "head", "caster", "bellows")
    package: str = ""
    agent: str = ""
    drive: Drive | None = None

    def check(self) -> None:
        """Compare this specification with the robot's URDF.

        Raises:
            ConfigError: the URDF is not installed, or something named here is not in it.
        """
        joints = {j.name: j for j in self.model.joints}
        for field_, names in (
            ("arm", self.arm), ("gripper", self.gripper),
            ("locked", tuple(self.locked)), ("rest", tuple(self.rest)),
            ("drive", (*self.drive.joints, *self.drive.held) if self.drive else ()),
        ):  # fmt: skip
            for name in names:
                if name not in joints:
                    raise self._wrong(field_, unknown_name("joint", name, joints))
        for field_, names in (
            ("tip", (self.tip,)), ("finger_links", self.finger_links),
            ("hand_links", self.hand_links),
            ("drive", (self.drive.link, *self.drive.on_ground) if self.drive else ()),
        ):  # fmt: skip
            for name in names:
                if name not in self.model.links:
                    raise self._wrong(field_, unknown_name("link", name, self.model.links))
        on_the_way = {j.name for j in self.model.chain(self.tip)}
        for name in self.arm:
            if name not in on_the_way:
                raise self._wrong("arm", f"joint {name!r} does not move the tip {self.tip!r}")
            low, high = joints[name].lower, joints[name].upper
            if name not in self.rest or not low <= self.rest[name] <= high:
                raise self._wrong("rest", f"joint {name!r} needs a value in {low:.3f}..{high:.3f}")
        axes = np.array([self.tool_approach, self.tool_closing], dtype=float)
        if not np.allclose(axes @ axes.T, np.eye(2), atol=1e-6):
            raise self._wrong(
                "tool_approach and tool_closing", "they must be unit vectors at a right angle"
            )

    def _wrong(self, field_: str, why: object) -> ConfigError:
        return ConfigError(f"robot {self.uid!r}, {field_}: {why}")

    @cached_property
    def path(self) -> Path:
        """The robot's URDF in the installed ManiSkill or in its package.

        Raises:
            ConfigError: its file or its package is not there.
        """
        if self.package:
            return packaged(self.package, self.urdf)
        from mani_skill import ASSET_DIR, PACKAGE_ASSET_DIR

        tried = [Path(root) / "robots" / self.urdf for root in (PACKAGE_ASSET_DIR, ASSET_DIR)]
        for file in tried:
            if file.is_file():
                return file
        from mani_skill.utils.assets import data

        if self.uid in data.DATA_SOURCES or self.uid in data.DATA_GROUPS:
            way = f"run: python -m mani_skill.utils.download_asset {self.uid}"
        else:
            way = f"its URDF is not at {' or '.join(map(str, dict.fromkeys(tried)))}"
        raise ConfigError(f"robot {self.uid!r} is not installed; {way}")

    @cached_property
    def model(self) -> KinematicModel:
        with outside_allowed():  # installed with the robot's code
            return KinematicModel.load(self.path)

    @cached_property
    def chain(self) -> Chain:
        tool = np.eye(4)
        approach, closing = np.array(self.tool_approach), np.array(self.tool_closing)
        tool[:3, :3] = np.stack([np.cross(closing, approach), closing, approach], axis=1)
        tool[:3, 3] = self.tool_position
        return Chain(self.model.chain(self.tip), self.arm, dict(self.locked), tool)

    @cached_property
    def fingers(self) -> dict[str, tuple[str, ...]]:
        """Fingers that no other finger carries, and the links that move with each, itself first."""
        below = {name: self.model.subtree(name) for name in self.finger_links}
        return {
            name: links
            for name, links in below.items()
            if not any(name in others for other, others in below.items() if other != name)
        }

    @cached_property
    def swinging(self) -> frozenset[str]:
        """Links that can hit the ground: those beyond the arm's first joint."""
        return frozenset(self.model.subtree(self.model.joint(self.arm[1]).child))

    @cached_property
    def rest_arm(self) -> FloatArray:
        """(n,) arm joints at rest."""
        return np.array([self.rest[name] for name in self.arm])

    def opening(self, width: float) -> float:
        """Gripper command that leaves `width` metres between the fingers."""
        share = float(np.clip(width / self.max_width, 0.0, 1.0))
        return self.shut + share * (self.opened - self.shut)

    @property
    def grip(self) -> tuple[float, float]:
        """Gripper commands that actions of -1 and 1 stand for."""
        low, high = self.gripper_range or sorted((self.opened, self.closed))
        return low, high

    def action(
        self, arm: FloatArray, gripper: float, extra: FloatArray | None = None
    ) -> FloatArray:
        """Action of control mode pd_joint_pos: arm targets (n,), gripper command, and what comes
        behind them (extra_actions,); zeros if None."""
        low, high = self.grip
        gripper = 2.0 * (gripper - low) / (high - low) - 1.0
        extra = np.zeros(self.extra_actions) if extra is None else extra
        return np.concatenate([arm, [gripper], extra]).astype(np.float32)

    def base_action(self, held: FloatArray, forwards: float, turning: float) -> FloatArray:
        """The (extra_actions,) entries of a robot that drives, cut to -1..1.

        Args:
            held: (h,) changes that bring the held joints back, metres or radians.
            forwards, turning: speeds, m/s and rad/s.
        """
        if self.drive is None:
            return np.zeros(self.extra_actions)
        speeds = [forwards / self.drive.speed, turning / self.drive.turning]
        out: FloatArray = np.concatenate([held / self.drive.held_delta, speeds])
        return np.clip(out, -1.0, 1.0)

    def link_poses(self, arm: FloatArray, gripper: float) -> dict[str, FloatArray]:
        """root_T_link (N, 4, 4) of all links at arm joints (N, n) and one gripper command."""
        q: dict[str, FloatArray | float] = dict(self.locked)
        q.update({name: arm[:, k] for k, name in enumerate(self.arm)})
        q.update({name: max(gripper, self.model.joint(name).lower) for name in self.gripper})
        return self.model.link_poses(q)

    def hand_surface(self, gripper: float) -> tuple[FloatArray, FloatArray]:
        """Points (P, 3) on the fingers and (Q, 3) on the rest of the hand, tool frame."""
        return self._hand(gripper)[:2]

    def hand_hulls(self, gripper: float) -> tuple[list[ConvexPiece], list[ConvexPiece]]:
        """Convex shapes of the fingers and of the rest of the hand, tool frame."""
        return self._hand(gripper)[2:]

    def _hand(self, gripper: float) -> Hand:
        """Points and convex shapes of fingers and palm at one opening, remembered."""
        key = round(gripper, 4)
        if key in self._hands:
            return self._hands[key]
        poses = self.link_poses(self.rest_arm[None], key)
        into = np.linalg.inv(poses[self.tip][0] @ self.chain.tool)
        fingers, palm = [np.zeros((0, 3))], [np.zeros((0, 3))]
        hulls: tuple[list[ConvexPiece], list[ConvexPiece]] = [], []
        for name in dict.fromkeys((*self.finger_links, *self.hand_links)):
            m = into @ poses[name][0]
            if name in self.surface:
                rows = self.surface[name] @ m[:3, :3].T + m[:3, 3]
                (fingers if name in self.finger_links else palm).append(rows)
            moved = [piece.moved(m) for piece in self.pieces.get(name, ())]
            hulls[name not in self.finger_links].extend(moved)
        self._hands[key] = np.concatenate(fingers), np.concatenate(palm), *hulls
        return self._hands[key]

    @cached_property
    def _hands(self) -> dict[float, Hand]:
        return {}

    @cached_property
    def hulls(self) -> dict[str, list[trimesh.Trimesh]]:
        """Convex collision shapes of each link, link frame; wheels and heads left out."""
        out: dict[str, list[trimesh.Trimesh]] = {}
        for link in self.model.robot.links:
            if any(word in link.name for word in self.passive_links):
                continue
            with outside_allowed():  # installed with the robot's code
                rows = [_hull(c, self.path.parent) for c in link.collisions]
            out[link.name] = [r for r in rows if r is not None]
        return out

    @cached_property
    def pieces(self) -> dict[str, list[ConvexPiece]]:
        """The same shapes by their planes, link frame; flat ones have none."""
        return {
            name: [p for h in hulls if (p := ConvexPiece.of(np.asarray(h.vertices))) is not None]
            for name, hulls in self.hulls.items()
        }

    @cached_property
    def foot(self) -> tuple[str, ...]:
        """Links that at most one of the arm's joints moves."""
        arm = set(self.arm)
        return tuple(n for n in self.pieces if len(arm & {j.name for j in self.model.chain(n)}) < 2)

    @cached_property
    def surface(self) -> dict[str, FloatArray]:
        """(P, 3) points on each link's collision shapes, link frame."""
        return {
            name: np.concatenate(
                [samples(h, 160 if name in self.finger_links else 48) for h in hulls]
            )
            for name, hulls in self.hulls.items()
            if hulls
        }


def _hull(collision: yourdfpy.Collision, folder: Path) -> trimesh.Trimesh | None:
    """Convex hull of one collision shape in its link's frame; None where its file is missing."""
    surface = shape_triangles(collision.geometry, folder, sections=12, subdivisions=1)
    if surface is None:
        return None
    hull: trimesh.Trimesh = trimesh.Trimesh(*surface).convex_hull
    if collision.origin is not None:
        hull.apply_transform(np.asarray(collision.origin))
    return hull


def samples(hull: trimesh.Trimesh, count: int) -> FloatArray:
    """Points on a hull: even samples and corners."""
    samples, _ = trimesh.sample.sample_surface(hull, count, seed=0)
    return np.concatenate([samples, hull.vertices[:: max(1, len(hull.vertices) // count)]])
