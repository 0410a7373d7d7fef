"""From an asset and a wish to a layout: models, goals, scale, placement; drawing clear starts."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import sapien
import torch
from mani_skill.utils.structs import Articulation, Link

from mam_envs.config import EnvConfig, JointGoal, RandomisationConfig, SuccessConfig, joint_goal
from mam_envs.grasping.candidates import PlacementError
from mam_envs.object_model import ObjectModel
from mam_envs.placement.arm_path import rest_is_clear
from mam_envs.placement.base import Placement, object_pose, place
from mam_envs.robots import RobotSpec
from mam_envs.scene import build as scene
from mam_envs.scene import randomisation
from mam_envs.scene.build import Layout
from mam_pipeline.asset.card import Asset, CardJoint
from mam_pipeline.errors import ConfigError
from mam_pipeline.types import FloatArray

if TYPE_CHECKING:
    from mam_envs.env import OperateJointEnv


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
    joints, tasks = _several(joint), _several(task)
    if len(tasks) not in (1, len(joints)):
        raise ConfigError(f"{len(joints)} joints but {len(tasks)} tasks; give one task or as many")
    if len(tasks) < len(joints):
        tasks = tasks * len(joints)
    if isinstance(scale, str) and scale != "auto":
        raise ConfigError(f"scale is a number or 'auto', not {scale!r}")
    stamp = (found.folder / "asset.json").stat().st_mtime_ns
    key = (str(found.folder), stamp, joints, tasks, scale)
    return _arrange(key, robot, config.success, config.randomisation)


def _several(names: str | Sequence[str] | None) -> tuple[str | None, ...]:
    return (names,) if names is None or isinstance(names, str) else tuple(names)


@lru_cache(maxsize=256)
def _arrange(
    key: tuple[Any, ...], robot: RobotSpec, success: SuccessConfig, chance: RandomisationConfig
) -> Layout:
    folder, _, joints, tasks, scale = key
    asset = Asset.load(folder)
    if joints != (None,):
        return _sized(asset, joints, tasks, robot, scale, success, chance)
    first: PlacementError | None = None
    for name in _likely(asset):
        try:
            return _sized(asset, (name,), tasks, robot, scale, success, chance)
        except PlacementError as error:
            first = first or error
    assert first is not None
    raise first


def _likely(asset: Asset, most: int = 6) -> list[str]:
    """Movable joints in the order in which one would try them: with a handle, sure, and wide."""
    model = ObjectModel.load(asset)
    model.default_joint()  # refuses an asset without movable joints

    def rank(joint: CardJoint) -> tuple[bool, bool, float]:
        kinds = {g.kind for g in asset.card.grasps if g.joint == joint.name}
        easy = bool(kinds & {"handle", "knob"}) and joint.subtype in ("slide", "hinge")
        return bool(kinds), easy, round(joint.confidence, 2)

    movable = [j for j in asset.card.joints if j.type != "fixed"]
    return [j.name for j in sorted(movable, key=rank, reverse=True)][:most]


def _sized(
    asset: Asset,
    joints: tuple[str | None, ...],
    tasks: tuple[str | None, ...],
    robot: RobotSpec,
    scale: float | str,
    success: SuccessConfig,
    chance: RandomisationConfig,
) -> Layout:
    """At the asked scale; "auto" shrinks the object to a small arm's reach where it must."""
    if scale != "auto":
        return _at_scale(asset, joints, tasks, robot, float(scale), success, chance)
    try:
        return _at_scale(asset, joints, tasks, robot, 1.0, success, chance)
    except PlacementError as error:
        low, high = ObjectModel.load(asset).bounds()
        shrunk = 1.1 * robot.reach / float(np.linalg.norm(high - low))
        if shrunk > 0.95 or robot.reach > 0.5:
            raise
        try:
            return _at_scale(asset, joints, tasks, robot, shrunk, success, chance)
        except PlacementError:
            raise error from None


def _at_scale(
    asset: Asset,
    joints: tuple[str | None, ...],
    tasks: tuple[str | None, ...],
    robot: RobotSpec,
    scale: float,
    success: SuccessConfig,
    chance: RandomisationConfig,
) -> Layout:
    if not scale > 0:
        raise ConfigError(f"scale must be positive, not {scale}")
    model = ObjectModel.load(asset, scale)
    goals = tuple(joint_goal(model, j, t, success) for j, t in zip(joints, tasks))
    placement = place(model, goals, robot, chance)
    return Layout(model, goals, placement, robot, _handles(model, goals, placement))


def _handles(
    model: ObjectModel, goals: tuple[JointGoal, ...], placement: Placement
) -> tuple[FloatArray, ...]:
    out = []
    for k, goal in enumerate(goals):
        grasp = placement.path.grasp.card if k == 0 else model.grasps(goal.joint)[0]
        out.append(np.array(grasp.position))
    return tuple(out)


def rest_value(model: ObjectModel, joint: str) -> float:
    """Value at which a joint that is not the task's starts: the source's pose."""
    row = next((j for j in model.kinematics.joints if j.name == joint), None)
    return 0.0 if row is None else float(np.clip(0.0, row.lower, row.upper))


def draw_clear(
    layout: Layout, chance: RandomisationConfig, rng: np.random.RandomState, tries: int = 10
) -> tuple[randomisation.Draw, FloatArray]:
    """Draw an episode in which the arm at rest does not touch the object, and world_T_asset.

    Raises:
        PlacementError: ten draws in a row overlap (the randomisation is too wide).
    """
    goal = layout.goals[0]
    for _ in range(tries):
        drawn = randomisation.draw(chance, rng, len(layout.robot.arm))
        pose = object_pose(
            layout.model, layout.placement.object_height, drawn.shift.tolist(), drawn.yaw
        )
        q = {g.joint: randomisation.start_value(g, drawn) for g in layout.goals}
        if rest_is_clear(layout.model, layout.robot, layout.placement.base, pose, q, drawn.noise):
            return drawn, pose
    raise PlacementError(
        f"{layout.model.asset.card.name}: the arm at rest overlaps the object at {goal.joint!r}; "
        "make randomisation.position or yaw smaller"
    )


def build_objects(
    env: OperateJointEnv,
) -> tuple[list[Articulation], list[list[int]], list[list[Link]]]:
    """Load every sub-scene's asset: the articulations, the indices (b, stages) of the task's
    joints among their joints, and the moving links (stages, b)."""
    sapien.set_log_level("off")  # PhysX calls thin panels oblong
    built = [
        scene.build_object(env.scene, env.layout(i), i, f"object_{i}") for i in range(env.num_envs)
    ]
    sapien.set_log_level("warn")
    dofs: list[list[int]] = []
    targets: list[list[Link]] = [[] for _ in env.layout(0).goals]
    chance = env.config.randomisation
    for i, item in enumerate(built):
        env.remove_from_state_dict_registry(item)
        names = [j.name for j in item.active_joints]
        goals, model = env.layout(i).goals, env.layout(i).model
        dofs.append([names.index(g.joint) for g in goals])
        for k, g in enumerate(goals):
            targets[k].append(item.links_map[model.kinematics.joint(g.joint).child])
        rng = env._batched_episode_rng[i]
        drawn = randomisation.draw(chance, rng, len(env.robot_spec.arm))
        randomisation.set_physics(item, model, [g.joint for g in goals], drawn)
        if chance.colour and env.scene.can_render():
            scene.tint(item, rng.uniform(0, 1, 3), chance.colour * float(rng.uniform()))
    return built, dofs, targets


def draw_starts(env: OperateJointEnv, indices: Sequence[int]) -> tuple[np.ndarray, ...]:
    """Draw where the episodes of some sub-scenes begin.

    Returns:
        float32 arrays of k sub-scenes: the robot's joints (k, n), world_T_base (k, 4, 4),
        world_T_asset (k, 4, 4), the object's joints (k, dof), the task's joints (k, stages).
    """
    spec, count = env.robot_spec, len(indices)
    names = [j.name for j in env.agent.robot.active_joints]
    rest = np.array([spec.rest.get(name, 0.0) for name in names], dtype=np.float32)
    arm = [names.index(name) for name in spec.arm]
    qpos = np.tile(rest, (count, 1))
    base, pose = np.zeros((2, count, 4, 4), dtype=np.float32)
    object_q = np.zeros((count, env.object.max_dof), dtype=np.float32)
    begin = np.zeros((count, len(env.targets)), dtype=np.float32)
    for row, i in enumerate(indices):
        item = env.layout(i)
        drawn, pose[row] = draw_clear(item, env.config.randomisation, env._batched_episode_rng[i])
        low, high = spec.chain.limits[:, 0], spec.chain.limits[:, 1]
        qpos[row, arm] = np.clip(rest[arm] + drawn.noise, low, high)
        base[row] = item.placement.base
        for k, joint in enumerate(env._objects[i].active_joints):
            object_q[row, k] = rest_value(item.model, joint.name)
        for k, goal in enumerate(item.goals):
            begin[row, k] = randomisation.start_value(goal, drawn)
            object_q[row, env._dof_index[i, k]] = begin[row, k]
        if not env.gpu_sim_enabled:
            moved = [g.joint for g in item.goals]
            randomisation.set_physics(env._objects[i], item.model, moved, drawn)
    return qpos, base, pose, object_q, begin


def put_background(env: OperateJointEnv, data: dict[str, Any]) -> None:
    """Replace what is neither robot nor object by the background picture, in place."""
    import cv2

    path = env.config.scene.background
    picture = cv2.imread(str(path))
    if picture is None:
        raise ConfigError(f"background picture {path} cannot be read")
    seen = [*env.agent.robot.links, *(link for o in env._objects for link in o.links)]
    ids = torch.unique(torch.cat([link.per_scene_id for link in seen]))
    for name, sensor in env.scene.sensors.items():
        if "rgb" not in data.get(name, {}):
            continue
        rgb = data[name]["rgb"]
        mask = sensor.get_obs(rgb=False, depth=False, position=False, segmentation=True)
        keep = torch.isin(mask["segmentation"], ids.to(rgb.device))
        size = (rgb.shape[2], rgb.shape[1])
        fitted = cv2.cvtColor(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), 4)
        behind = torch.from_numpy(np.ascontiguousarray(fitted)).to(rgb.device)
        data[name]["rgb"] = torch.where(keep, rgb, behind[None].expand_as(rgb))
