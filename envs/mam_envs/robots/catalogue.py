"""The robot arms that the environments know: how each reaches, grips and is commanded.

A tool frame is the same for all of them: origin between the fingertips, z the direction in which
the hand approaches, y the direction in which the fingers close.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cache, cached_property
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
import yourdfpy

from mam_envs.robots.kinematics import Chain, KinematicModel
from mam_envs.scene.object_model import Hull
from mam_pipeline.errors import ConfigError, unknown_name
from mam_pipeline.types import FloatArray


@dataclass(frozen=True)
class RobotSpec:
    """What placement, environment and expert need to know of one ManiSkill agent.

    Attributes:
        uid: ManiSkill's name of the agent.
        urdf: path below ManiSkill's robot folder.
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
        gripper_range: command values that ManiSkill's normalised gripper action of -1 and 1 stands
            for; None where the action is the joint value itself.
        step: joint motion per control step that real arms of the kind follow, radians.
        delta: arm joint change that a normalised action of 1 asks for in pd_joint_delta_pos.
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
    gripper_range: tuple[float, float] | None = None
    extra_actions: int = 0
    delta: float = 0.1

    @cached_property
    def path(self) -> Path:
        """The robot's URDF in the installed ManiSkill.

        Raises:
            ConfigError: this ManiSkill does not bundle the robot.
        """
        from mani_skill import ASSET_DIR, PACKAGE_ASSET_DIR

        for root in (PACKAGE_ASSET_DIR, ASSET_DIR):
            file = Path(root) / "robots" / self.urdf
            if file.is_file():
                return file
        raise ConfigError(
            f"robot {self.uid!r} is not installed; run: "
            f"python -m mani_skill.utils.download_asset {self.uid}"
        )

    @cached_property
    def model(self) -> KinematicModel:
        return KinematicModel.load(self.path)

    @cached_property
    def chain(self) -> Chain:
        tool = np.eye(4)
        approach, closing = np.array(self.tool_approach), np.array(self.tool_closing)
        tool[:3, :3] = np.stack([np.cross(closing, approach), closing, approach], axis=1)
        tool[:3, 3] = self.tool_position
        return Chain(self.model.chain(self.tip), self.arm, dict(self.locked), tool)

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

    def action(self, arm: FloatArray, gripper: float) -> FloatArray:
        """Action of control mode pd_joint_pos: arm targets (n,), gripper command, zeros."""
        if self.gripper_range is not None:
            low, high = self.gripper_range
            gripper = 2.0 * (gripper - low) / (high - low) - 1.0
        return np.concatenate([arm, [gripper], np.zeros(self.extra_actions)]).astype(np.float32)

    def link_poses(self, arm: FloatArray, gripper: float) -> dict[str, FloatArray]:
        """root_T_link (N, 4, 4) of all links at arm joints (N, n) and one gripper command."""
        q: dict[str, FloatArray | float] = dict(self.locked)
        q.update({name: arm[:, k] for k, name in enumerate(self.arm)})
        q.update({name: max(gripper, self.model.joint(name).lower) for name in self.gripper})
        return self.model.link_poses(q)

    def hand_surface(self, gripper: float) -> tuple[FloatArray, FloatArray]:
        """Points (P, 3) on the fingers and (Q, 3) on the rest of the hand, tool frame."""
        return self._hand(gripper)[:2]

    def hand_hulls(self, gripper: float) -> list[Hull]:
        """The hand's convex shapes, tool frame."""
        return self._hand(gripper)[2]

    def _hand(self, gripper: float) -> tuple[FloatArray, FloatArray, list[Hull]]:
        """Fingers, palm and convex shapes at one opening, remembered."""
        key = round(gripper, 4)
        if key in self._hands:
            return self._hands[key]
        poses = self.link_poses(self.rest_arm[None], key)
        into = np.linalg.inv(poses[self.tip][0] @ self.chain.tool)
        fingers, palm = [np.zeros((0, 3))], [np.zeros((0, 3))]
        hulls: list[Hull] = []
        for name in dict.fromkeys((*self.finger_links, *self.hand_links)):
            m = into @ poses[name][0]
            if name in self.surface:
                rows = self.surface[name] @ m[:3, :3].T + m[:3, 3]
                (fingers if name in self.finger_links else palm).append(rows)
            for hull in self.hulls.get(name, ()):
                normals = hull.face_normals @ m[:3, :3].T
                on = hull.vertices @ m[:3, :3].T + m[:3, 3]
                rows = np.c_[normals, -(normals * on[hull.faces[:, 0]]).sum(axis=1)]
                box = np.stack([on.min(axis=0), on.max(axis=0)])
                hulls.append((box, np.unique(np.round(rows, 4), axis=0)))
        self._hands[key] = np.concatenate(fingers), np.concatenate(palm), hulls
        return self._hands[key]

    @cached_property
    def _hands(self) -> dict[float, tuple[FloatArray, FloatArray, list[Hull]]]:
        return {}

    @cached_property
    def hulls(self) -> dict[str, list[trimesh.Trimesh]]:
        """Convex collision shapes of each link, link frame; wheels and heads left out."""
        out: dict[str, list[trimesh.Trimesh]] = {}
        for link in self.model.robot.links:
            if any(w in link.name for w in ("wheel", "head", "caster", "bellows")):
                continue
            rows = [_hull(c, self.path.parent) for c in link.collisions]
            out[link.name] = [r for r in rows if r is not None]
        return out

    @cached_property
    def surface(self) -> dict[str, FloatArray]:
        """(P, 3) points on each link's collision shapes, link frame."""
        return {
            name: np.concatenate(
                [_samples(h, 160 if name in self.finger_links else 48) for h in hulls]
            )
            for name, hulls in self.hulls.items()
            if hulls
        }


def _hull(collision: yourdfpy.Collision, folder: Path) -> trimesh.Trimesh | None:
    """Convex hull of one collision shape in its link's frame; None where its file is missing."""
    g = collision.geometry
    if g.mesh is not None:
        name = g.mesh.filename.replace("package://", "")
        file = next((p / name for p in (folder, *folder.parents) if (p / name).is_file()), None)
        if file is None:
            return None
        mesh: Any = trimesh.load(file, force="mesh")
        if g.mesh.scale is not None:
            mesh.apply_scale(g.mesh.scale)
    elif g.box is not None:
        mesh = trimesh.creation.box(g.box.size)
    elif g.cylinder is not None:
        mesh = trimesh.creation.cylinder(g.cylinder.radius, g.cylinder.length, sections=12)
    elif g.sphere is not None:
        mesh = trimesh.creation.icosphere(1, g.sphere.radius)
    else:
        return None
    hull: trimesh.Trimesh = mesh.convex_hull
    if collision.origin is not None:
        hull.apply_transform(np.asarray(collision.origin))
    return hull


def _samples(hull: trimesh.Trimesh, count: int) -> FloatArray:
    """Points on a hull: even samples and corners."""
    samples, _ = trimesh.sample.sample_surface(hull, count, seed=0)
    return np.concatenate([samples, hull.vertices[:: max(1, len(hull.vertices) // count)]])


PANDA = RobotSpec(
    uid="panda",
    urdf="panda/panda_v2.urdf",
    arm=tuple(f"panda_joint{i}" for i in range(1, 8)),
    tip="panda_hand_tcp",
    tool_position=(0, 0, 0),
    tool_approach=(0, 0, 1),
    tool_closing=(0, 1, 0),
    gripper=("panda_finger_joint1", "panda_finger_joint2"),
    opened=0.04,
    gripper_range=(-0.01, 0.04),
    closed=-0.01,
    shut=0.0,
    max_width=0.078,
    tip_ahead=0.010,
    finger_links=("panda_leftfinger", "panda_rightfinger"),
    hand_links=("panda_hand",),
    rest={
        "panda_joint1": 0.0,
        "panda_joint2": -np.pi / 4,
        "panda_joint3": 0.0,
        "panda_joint4": -np.pi * 3 / 4,
        "panda_joint5": 0.0,
        "panda_joint6": np.pi / 2,
        "panda_joint7": np.pi / 4,
        "panda_finger_joint1": 0.04,
        "panda_finger_joint2": 0.04,
    },
)
SO100 = RobotSpec(
    uid="so100",
    urdf="so100/so100.urdf",
    arm=("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll"),
    tip="Fixed_Jaw",
    tool_position=(-0.004, -0.088, 0.0),
    tool_approach=(0, -1, 0),
    tool_closing=(1, 0, 0),
    gripper=("gripper",),
    opened=-0.15,
    closed=-1.1,
    shut=-1.1,
    max_width=0.06,
    tip_ahead=0.009,
    finger_links=("Fixed_Jaw", "Moving_Jaw"),
    hand_links=("Fixed_Jaw", "Moving_Jaw"),
    rest={
        "shoulder_pan": 0.0,
        "shoulder_lift": -1.5708,
        "elbow_flex": 1.5708,
        "wrist_flex": 0.66,
        "wrist_roll": 0.0,
        "gripper": -1.1,
    },
    # five joints: the direction about the approach axis and the hand's yaw cannot both be chosen
    rotation_weight=(0.12, 0.12, 0.12),
    rotation_tolerance=0.45,
    reach=0.34,
    shoulder=0.12,
    force=10.0,
    forward=-np.pi / 2,
    base_radius=0.06,
    step=0.08,
    delta=0.05,
)
FETCH = RobotSpec(
    uid="fetch",
    urdf="fetch/fetch.urdf",
    arm=(
        "shoulder_pan_joint",
        "shoulder_lift_joint",
        "upperarm_roll_joint",
        "elbow_flex_joint",
        "forearm_roll_joint",
        "wrist_flex_joint",
        "wrist_roll_joint",
    ),
    tip="gripper_link",
    tool_position=(0.01, 0, 0),
    tool_approach=(1, 0, 0),
    tool_closing=(0, 1, 0),
    gripper=("l_gripper_finger_joint", "r_gripper_finger_joint"),
    opened=0.05,
    gripper_range=(-0.01, 0.05),
    closed=-0.01,
    shut=0.0,
    max_width=0.098,
    tip_ahead=0.022,
    finger_links=("l_gripper_finger_link", "r_gripper_finger_link"),
    hand_links=("gripper_link",),
    rest={
        "torso_lift_joint": 0.386,
        "shoulder_pan_joint": -0.370,
        "shoulder_lift_joint": 0.562,
        "upperarm_roll_joint": -1.032,
        "elbow_flex_joint": 0.695,
        "forearm_roll_joint": 0.955,
        "wrist_flex_joint": -0.1,
        "wrist_roll_joint": 2.077,
        "l_gripper_finger_joint": 0.05,
        "r_gripper_finger_joint": 0.05,
    },
    locked={"torso_lift_joint": 0.386},
    reach=0.85,
    shoulder=1.1,
    force=50.0,
    base_radius=0.3,
    floor_only=True,
    extra_actions=5,
)
XARM6 = RobotSpec(
    uid="xarm6_robotiq",
    urdf="xarm6/xarm6_robotiq.urdf",
    arm=tuple(f"joint{i}" for i in range(1, 7)),
    tip="eef",
    tool_position=(0, 0, 0),
    tool_approach=(0, 0, 1),
    tool_closing=(0, 1, 0),
    gripper=("left_outer_knuckle_joint", "right_outer_knuckle_joint"),
    opened=0.0,
    gripper_range=(0.0, 0.81),
    closed=0.81,
    shut=0.81,
    max_width=0.08,
    tip_ahead=0.01,
    finger_links=("left_inner_finger", "right_inner_finger"),
    hand_links=("robotiq_arg2f_base_link",),
    rest={"joint1": 0, "joint2": 0.22, "joint3": -1.23, "joint4": 0, "joint5": 1.01, "joint6": 0},
    reach=0.65,
    shoulder=0.27,
    force=40.0,
)
ROBOTS: dict[str, RobotSpec] = {r.uid: r for r in (PANDA, SO100, FETCH, XARM6)}
ALIASES = {"so101": "so100", "xarm6": "xarm6_robotiq", "panda_wristcam": "panda"}


@cache
def robot_spec(uid: str) -> RobotSpec:
    """The robot of a ManiSkill uid (or an alias).

    Raises:
        ConfigError: no such robot, or ManiSkill does not bundle it.
    """
    name = ALIASES.get(uid, uid)
    if name not in ROBOTS:
        raise unknown_name("robot", uid, [*ROBOTS, *ALIASES])
    spec = ROBOTS[name]
    _ = spec.path
    return spec
