"""From an asset and a request to a layout: joints and goals, object size, place of the robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

from mam_envs.config import EnvConfig, RandomisationConfig, SuccessConfig
from mam_envs.grasping.candidates import Grasp, PlacementError, upright
from mam_envs.object_model import ObjectModel
from mam_envs.placement.base import Placement, object_pose
from mam_envs.placement.drive import carried
from mam_envs.placement.memory import remembered_place
from mam_envs.placement.reach_in import ground_places, hand_places, served
from mam_envs.robots import RobotSpec
from mam_envs.tasks import JointGoal, Task, several, task_class
from mam_pipeline.asset.card import Asset, CardJoint
from mam_pipeline.check.lint import lint
from mam_pipeline.errors import ConfigError, InputError, NotPhysicalError
from mam_pipeline.types import FloatArray


@dataclass(frozen=True)
class Layout:
    """One asset with its task and place, ready to be built.

    Attributes:
        goals: one or, for a sequence, several joints in order.
        handles: (3,) per goal, the point to grasp, asset frame at rest.
        grasps: per goal, how the hand takes hold of it: for the first as the placement plans it.
        places: where in the drawer the goal's loose thing may lie so that this arm gets at it; see
            `Thing`.
        starts: where on the ground (x, y, world) it lies at first; none where it is in the drawer.
        away: metres from the handle, at most, at which a robot that drives begins.
    """

    model: ObjectModel
    goals: tuple[JointGoal, ...]
    placement: Placement
    robot: RobotSpec
    handles: tuple[FloatArray, ...]
    grasps: tuple[Grasp, ...]
    places: tuple[tuple[float, float, float], ...] = ()
    starts: tuple[tuple[float, float], ...] = ()
    away: float = 0.0

    @property
    def world_asset(self) -> FloatArray:
        """(4, 4) nominal world_T_asset."""
        return object_pose(self.model, self.placement.object_height, (0.0, 0.0), 0.0)

    def stand(self, world_asset: FloatArray) -> FloatArray:
        """(4, 4) world_T_base where the robot is to operate an object at (4, 4) `world_asset`: one
        that drives stands to a displaced object as to the nominal one; others stand where they do.
        """
        if self.robot.drive is None:
            return self.placement.base
        return carried(self.placement.base, self.world_asset, world_asset)

    def view(self) -> tuple[FloatArray, float, float]:
        """What a camera should see: middle (3,) and diagonal of the object, its open part, the arm
        and where it begins to drive, and what lies beside it; and the side (+1 or -1 along y) on
        which the arm is not in the way."""
        boxes = [self.model.bounds()]
        for goal in self.goals:
            boxes += [self.model.bounds({goal.joint: v}) for v in (goal.closed, goal.open)]
        pose = self.world_asset
        base = self.placement.base[:3, 3]
        ground = np.array([(x, y, 0.0) for x, y in self.starts]).reshape(-1, 3)
        points = np.concatenate([np.concatenate(boxes) + pose[:3, 3], base[None], ground])
        handle = pose[:3, :3] @ self.handles[0] + pose[:3, 3]
        if self.robot.drive is not None:
            out = (base - handle)[:2]
            begin = handle[:2] + self.away * out / np.linalg.norm(out)
            points = np.concatenate([points, [[*begin, 0.0], [*begin, self.robot.shoulder]]])
        low, high = points.min(axis=0), points.max(axis=0)
        side = -1.0 if base[1] >= handle[1] - 0.02 else 1.0
        return 0.5 * (low + high), float(np.linalg.norm(high - low)), side

    def block(self) -> FloatArray | None:
        """(2, 3) world box of the stand below the object, or None."""
        if self.placement.object_height <= 0:
            return None
        low, high = self.model.bounds()
        pose = self.world_asset
        low, high = low + pose[:3, 3], high + pose[:3, 3]
        return np.array([[low[0], low[1], 0.0], [high[0], high[1], low[2]]])


def arrange(
    asset: str | Path | Asset,
    joint: str | Sequence[str] | None,
    task: str | Sequence[str] | None,
    robot: RobotSpec,
    scale: float | str,
    config: EnvConfig,
) -> Layout:
    """Resolve names, size and place of one asset; remembered for equal questions.

    Raises:
        InputError, ConfigError, PlacementError: see OperateJointEnv.
    """
    found = asset if isinstance(asset, Asset) else Asset.load(asset)
    joints, tasks = several(joint), several(task)
    if len(tasks) not in (1, len(joints)):
        raise ConfigError(f"{len(joints)} joints but {len(tasks)} tasks; give one task or as many")
    if len(tasks) < len(joints):
        tasks = tasks * len(joints)
    if isinstance(scale, str) and scale != "auto":
        raise ConfigError(f"scale is a number or 'auto', not {scale!r}")
    stamp = (found.folder / "asset.json").stat().st_mtime_ns
    request = _Request(
        joints, tasks, task_class(tasks), robot, config.success, config.randomisation
    )
    return _arrange(str(found.folder), stamp, request, scale)


@dataclass(frozen=True)
class _Request:
    """What is wanted of an asset, whatever its size."""

    joints: tuple[str | None, ...]
    names: tuple[str | None, ...]
    task: type[Task]
    robot: RobotSpec
    success: SuccessConfig
    chance: RandomisationConfig


@lru_cache(maxsize=256)
def _arrange(folder: str, stamp: int, request: _Request, scale: float | str) -> Layout:
    """`stamp`: when the card was written; an edited asset is arranged anew."""
    asset = Asset.load(folder)
    for finding in lint(asset.urdf_path, asset.card):  # what `mam-sim check` refuses
        if not finding.warning:
            where = f"{asset.urdf_path}, {finding.where}"
            raise InputError(f"{where}: {finding.message}; see: mam-sim check {folder}")
    if request.joints != (None,):
        return _sized(asset, request, scale)
    first: NotPhysicalError | None = None
    for name in likely(asset):
        try:
            return _sized(asset, replace(request, joints=(name,)), scale)
        except NotPhysicalError as error:  # the arm cannot, or the joint cannot
            first = first or error
    assert first is not None
    raise first


def likely(asset: Asset, most: int = 6) -> list[str]:
    """Movable joints in the order in which one would try them: with a handle, sure, and wide."""
    model = ObjectModel.load(asset)
    model.default_joint()  # refuses an asset without movable joints

    def rank(joint: CardJoint) -> tuple[bool, bool, float]:
        kinds = {g.kind for g in asset.card.grasps if g.joint == joint.name}
        easy = bool(kinds & {"handle", "knob"}) and joint.subtype in ("slide", "hinge")
        return bool(kinds), easy, round(joint.confidence, 2)

    movable = asset.card.movable
    return [j.name for j in sorted(movable, key=rank, reverse=True)][:most]


def _sized(asset: Asset, request: _Request, scale: float | str) -> Layout:
    """At the asked scale; "auto" shrinks the object to a small arm's reach where it must."""
    if scale != "auto":
        return _at_scale(asset, request, float(scale))
    try:
        return _at_scale(asset, request, 1.0)
    except PlacementError as error:
        low, high = ObjectModel.load(asset).bounds()
        shrunk = 1.1 * request.robot.reach / float(np.linalg.norm(high - low))
        if shrunk > 0.95 or request.robot.reach > 0.5:
            raise
        try:
            return _at_scale(asset, request, shrunk)
        except PlacementError:
            raise error from None


def _at_scale(asset: Asset, request: _Request, scale: float) -> Layout:
    if not 0 < scale < np.inf:
        raise ConfigError(f"scale must be a positive number, not {scale}")
    model = ObjectModel.load(asset, scale)
    goals = tuple(
        request.task.goal(name, model, joint, request.success)
        for joint, name in zip(request.joints, request.names)
    )
    robot = request.robot
    if robot.drive is not None and any(g.thing is not None and g.closing for g in goals):
        raise ConfigError(
            f"{asset.card.name}: put_in is not for {robot.uid}, which would drive over the cube on "
            "the ground; take a robot that stands still, such as panda"
        )
    shut = [g if g.thing is None or g.closing else replace(g, q_start=g.closed) for g in goals]
    placement = remembered_place(model, shut, robot, request.chance)
    later = [upright(robot, model.grasps(goal.joint)[0]) for goal in goals[1:]]
    grasps = (placement.path.grasp, *later)
    handles = tuple(np.array(grasp.card.position) for grasp in grasps)
    layout = Layout(model, goals, placement, robot, handles, grasps, away=request.chance.away[1])
    if goals[0].thing is None:
        return layout
    places, poses = hand_places(model, goals[0], robot), []
    for sign in (0, -1, 1):  # wherever the object is put
        shift = [sign * request.chance.position] * 2
        yaw = sign * np.deg2rad(request.chance.yaw)
        pose = object_pose(model, placement.object_height, shift, yaw)
        poses.append(pose)
        free = served(model, goals[0], robot, placement.base[None], pose, places)[0]
        places = [p for p, fine in zip(places, free) if fine]
    if not places:
        raise PlacementError(
            f"{asset.card.name}: a {robot.uid}'s hand that comes from above reaches nothing in "
            f"what {goals[0].joint!r} moves",
            "reach",
        )
    if not goals[0].closing:
        return replace(layout, places=tuple(places))
    starts = ground_places(model, goals[0], robot, placement.base, poses)
    if not starts:
        raise PlacementError(
            f"{asset.card.name}: a {robot.uid} that operates {goals[0].joint!r} reaches no free "
            "ground beside it from which to take a cube",
            "reach",
        )
    return replace(layout, places=tuple(places), starts=tuple(starts))
