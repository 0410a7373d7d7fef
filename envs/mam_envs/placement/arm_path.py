"""Arm motions that carry a grasp along the joint's path, clear of the object and the ground."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mam_envs.grasping.candidates import (
    Cause,
    Grasp,
    backed,
    grasp_opening,
    tool_path,
)
from mam_envs.grasping.limits import LIMITS
from mam_envs.kinematics import Solution
from mam_envs.object_model import ObjectModel
from mam_envs.placement.settings import PLACEMENT
from mam_envs.robots import RobotSpec
from mam_envs.robots.self_collision import self_collision
from mam_envs.tasks.base import JointGoal
from mam_pipeline.types import FloatArray


@dataclass(frozen=True)
class ArmPath:
    """An arm motion that moves the joint.

    Attributes:
        grasp: what the hand grasps or pushes.
        base: (4, 4) world_T_base of the robot.
        approach: (A, n) arm joints from the pre-grasp to the grasp.
        follow: (K, n) arm joints at joint values `q` (K,) of the object.
        cost: lower is better.
    """

    grasp: Grasp
    base: FloatArray
    approach: FloatArray
    follow: FloatArray
    q: FloatArray
    cost: float


@dataclass(frozen=True)
class Search:
    """Outcome of a search: paths (best first) and how far the others came."""

    paths: tuple[ArmPath, ...]
    reached: int
    followed: int
    tried: int

    @property
    def cause(self) -> Cause:
        """Why there is no path, in a word."""
        if not self.tried or not self.reached:
            return "reach"
        return "room" if self.followed else "path"

    def reason(self, what: str) -> str:
        """Why there is no path, in words."""
        if not self.tried:
            return f"{what}: there is nowhere to stand within reach of it, clear of its motion"
        if not self.reached:
            return f"{what} is out of reach from every place that was tried ({self.tried} poses)"
        if not self.followed:
            return f"{what} can be reached but not followed along the joint's whole path"
        return f"{what} can be followed, but the arm would hit the object, the ground or itself"


def search(
    model: ObjectModel,
    goal: JointGoal,
    robot: RobotSpec,
    candidates: Sequence[Grasp],
    bases: FloatArray,
    world_asset: FloatArray,
    q: FloatArray,
    others: Mapping[str, float] | None = None,
    start: FloatArray | None = None,
    keep: int = 4,
    ground: float = 0.0,
    base_costs: FloatArray | None = None,
    seeds: FloatArray | None = None,
) -> Search:
    """Find arm paths for some grasps and base poses.

    Args:
        bases: (B, 4, 4) world_T_base.
        world_asset: (4, 4) world_T_asset of the object.
        q: (K,) joint values to go through.
        others: values of the object's other joints.
        start: (n,) arm joints at the beginning; rest if None.
        keep: how many collision-free paths are enough.
        ground: height of the surface that the arm must stay above, world.
        base_costs: (B,) added to the cost of paths from each base.
        seeds: (S, n) first guesses for the grasp; a fixed family round `start` if None.
    """
    begin = robot.rest_arm if start is None else start
    seeds = seeds_round(robot, begin) if seeds is None else seeds
    b, h, s = len(bases), len(candidates), len(seeds)
    if b * h == 0:
        return Search((), 0, 0, 0)
    tools = np.stack([tool_path(model, goal, grasp, q[:1])[0] for grasp in candidates])
    inverse = np.linalg.inv(bases)
    base_index, grasp_index, seed_index = (
        a.reshape(-1) for a in np.meshgrid(np.arange(b), np.arange(h), np.arange(s), indexing="ij")
    )
    targets = inverse[base_index] @ world_asset @ tools[grasp_index]
    near = np.linalg.norm(targets[:, :3, 3], axis=1) < 1.35 * robot.reach + robot.shoulder
    base_index, grasp_index, seed_index = base_index[near], grasp_index[near], seed_index[near]
    if not len(base_index):
        return Search((), 0, 0, b * h)
    reached = _solve(robot, targets[near], seeds[seed_index], 40, posture=begin)
    ok = reached.good(PLACEMENT.position_tolerance, robot.rotation_tolerance)
    rows = [(int(i), int(j), k) for i, j, k in zip(base_index[ok], grasp_index[ok], reached.q[ok])]
    rows = _distinct(rows)
    if not rows:
        return Search((), 0, 0, b * h)
    extra = np.zeros(b) if base_costs is None else base_costs
    paths = _follow(model, goal, robot, candidates, bases, world_asset, q, rows, begin, extra)
    good: list[ArmPath] = []
    for path in paths[: PLACEMENT.looked_at]:
        if clear(model, goal, robot, path, world_asset, others or {}, ground, begin):
            good.append(path)
            if len(good) >= keep:
                break
    return Search(tuple(good), len(rows), len(paths), b * h)


def seeds_round(robot: RobotSpec, begin: FloatArray) -> FloatArray:
    """Fixed first guesses: the present posture, and two others of the same family."""
    rng = np.random.default_rng(PLACEMENT.seed)
    spread: FloatArray = rng.uniform(-0.7, 0.7, size=(2, len(begin)))
    spread[0, 0] = spread[1, 0] = 0.0
    out: FloatArray = np.concatenate([begin[None], begin + spread])
    return out


def _solve(
    robot: RobotSpec,
    targets: FloatArray,
    start: FloatArray,
    iterations: int,
    posture: FloatArray | None = None,
) -> Solution:
    return robot.chain.solve(targets, start, robot.rotation_weight, iterations, posture)


def _distinct(rows: list[tuple[int, int, FloatArray]]) -> list[tuple[int, int, FloatArray]]:
    """Drop solutions that two seeds found twice."""
    out: dict[tuple[int, int, bytes], tuple[int, int, FloatArray]] = {}
    for i, j, q in rows:
        out.setdefault((i, j, np.round(q, 1).tobytes()), (i, j, q))
    return list(out.values())


def _follow(
    model: ObjectModel,
    goal: JointGoal,
    robot: RobotSpec,
    candidates: Sequence[Grasp],
    bases: FloatArray,
    world_asset: FloatArray,
    q: FloatArray,
    rows: list[tuple[int, int, FloatArray]],
    begin: FloatArray,
    base_costs: FloatArray,
) -> list[ArmPath]:
    """Carry grasp solutions along the joint's path and back to a pre-grasp; best first."""
    lagged: list[tuple[int, Grasp, FloatArray]] = []
    for i, j, arm in rows:
        grasp = candidates[j]
        for lag in grasp.lags:
            extra = grasp.cost + PLACEMENT.pivoting * (1 - lag)
            lagged.append((i, replace(grasp, lag=lag, lags=(lag,), cost=extra), arm))
    if len(lagged) > 900:  # the cheapest are enough
        lagged = sorted(lagged, key=lambda r: r[1].cost)[:900]
    tools = np.stack([tool_path(model, goal, grasp, q) for _, grasp, _ in lagged])
    base = np.stack([bases[i] for i, _, _ in lagged])
    into = (np.linalg.inv(base) @ world_asset)[:, None]
    targets = into @ tools
    back = np.stack(
        [backed(tools[:, 0], d) for d in (0.0, 0.4 * LIMITS.back_off, LIMITS.back_off)], axis=1
    )
    back_targets = into @ back
    arm = np.stack([a for _, _, a in lagged])
    alive = np.ones(len(arm), dtype=bool)
    follow = np.zeros((len(arm), len(q), arm.shape[1]))
    follow[:, 0] = arm
    approach = np.zeros((len(arm), 3, arm.shape[1]))
    approach[:, 0] = arm
    for store, goals in ((follow, targets), (approach, back_targets)):
        for k in range(1, goals.shape[1]):
            live = np.flatnonzero(alive)
            if not len(live):
                return []
            found = _solve(robot, goals[live, k], store[live, k - 1], 12)
            jump = np.abs(found.q - store[live, k - 1]).max(axis=1)
            fine = found.good(1.5 * PLACEMENT.position_tolerance, 1.5 * robot.rotation_tolerance)
            alive[live] = fine & (jump < 0.7)
            store[live, k] = found.q
    limits = robot.chain.limits
    out = []
    for r in np.flatnonzero(alive):
        i, grasp, _ = lagged[r]
        travel = np.abs(np.diff(follow[r], axis=0)).sum(axis=0).max()
        away = np.abs(approach[r, -1] - begin).max()
        margin = np.minimum(follow[r] - limits[:, 0], limits[:, 1] - follow[r]).min()
        cost = (
            grasp.cost + base_costs[i] + 0.3 * travel + 0.3 * away + 2.0 * max(0.0, 0.15 - margin)
        )
        out.append(ArmPath(grasp, bases[i], approach[r, ::-1], follow[r], q, float(cost)))
    return sorted(out, key=lambda p: p.cost)


def clear(
    model: ObjectModel,
    goal: JointGoal,
    robot: RobotSpec,
    path: ArmPath,
    world_asset: FloatArray,
    others: Mapping[str, float],
    ground: float = 0.0,
    begin: FloatArray | None = None,
) -> bool:
    """Whether the arm stays out of the object and itself, and above the ground, on a whole path.

    While the hand holds the part its fingers may touch the part, and the hand may come close.
    """
    moving = model.moving_links(goal.joint)
    pushing = path.grasp.mode == "push"
    opened = robot.closed if pushing else grasp_opening(robot, path.grasp)
    before = {**others, goal.joint: float(path.q[0])}
    start, ground = robot.rest_arm if begin is None else begin, ground + PLACEMENT.above_ground
    swing = np.linspace(start, path.approach[0], 8)[:-1]
    pressing, pressed = (robot.finger_links, moving) if pushing else ((), ())
    for arm in (*swing, *path.approach[:-1]):
        if not free(model, robot, arm, opened, path.base, world_asset, before, (), ground, 0.0):
            return False
    if not free(
        model, robot, path.approach[-1], opened, path.base, world_asset, before, pressing, ground,
        LIMITS.dip, pressed,
    ):  # fmt: skip
        return False
    touching = robot.finger_links
    for k in range(1, len(path.q), 2):
        now = {**others, goal.joint: float(path.q[k])}
        arm = path.follow[k]
        if not free(
            model,
            robot,
            arm,
            opened,
            path.base,
            world_asset,
            now,
            touching,
            ground,
            LIMITS.dip,
            moving,
        ):
            return False
    return _keeps_off(model, goal, robot, path, world_asset, others)


def _keeps_off(
    model: ObjectModel,
    goal: JointGoal,
    robot: RobotSpec,
    path: ArmPath,
    world_asset: FloatArray,
    others: Mapping[str, float],
) -> bool:
    """Whether the arm's foot keeps away from the object while its part moves: a door swings past
    it edge first, and its points lie farther apart than a door is thick, so shapes are compared."""
    into, room = np.linalg.inv(world_asset) @ path.base, PLACEMENT.arm_room * robot.reach
    opened = grasp_opening(robot, path.grasp)
    for arm, value in zip(path.follow, path.q):
        now, poses = {**others, goal.joint: float(value)}, robot.link_poses(arm[None], opened)
        for name in robot.foot:
            if model.cuts_into(robot.pieces[name], into @ poses[name][0], now, -room):
                return False
    return True


def _in_stand(model: ObjectModel, world_asset: FloatArray, points: FloatArray) -> bool:
    """Whether points (N, 3), world, lie in the stand, which stays where the object nominally is."""
    low, high = model.footprint
    inside = ((points[:, :2] > low[:2]) & (points[:, :2] < high[:2])).all(axis=1)
    return bool((inside & (points[:, 2] < world_asset[2, 3] + low[2] - 0.005)).any())


def rest_is_clear(
    model: ObjectModel,
    robot: RobotSpec,
    base: FloatArray,
    world_asset: FloatArray,
    q: Mapping[str, float],
    noise: FloatArray,
) -> bool:
    """Whether the arm at rest (plus noise (n,)) keeps out of the object."""
    gripper = robot.rest.get(robot.gripper[0], 0.0)
    arm = robot.rest_arm + noise
    return free(model, robot, arm, gripper, base, world_asset, q, (), -np.inf, 0.0)


def free(
    model: ObjectModel,
    robot: RobotSpec,
    arm: FloatArray,
    gripper: float,
    base: FloatArray,
    world_asset: FloatArray,
    q: Mapping[str, float],
    touching: tuple[str, ...],
    ground: float,
    slack: float,
    moving: tuple[str, ...] = (),
) -> bool:
    """Whether one arm posture keeps clear of the object, the ground and the arm itself; `touching`
    links may touch `moving` ones."""
    poses = robot.link_poses(arm[None], gripper)
    if self_collision(robot, PLACEMENT.arm_room * robot.reach).touches(poses):
        return False
    into = np.linalg.inv(world_asset) @ base
    held: list[FloatArray] = []
    rest: list[FloatArray] = []
    for name, points in robot.surface.items():
        pose = poses[name][0]
        local = points @ pose[:3, :3].T + pose[:3, 3]
        (held if name in touching else rest).append(local)
        lifted = name in robot.swinging
        if lifted and (local @ base[2, :3] + base[2, 3]).min() < ground - 0.002:
            return False
    points = np.concatenate([*rest, *held]) @ base[:3, :3].T + base[:3, 3]
    if _in_stand(model, world_asset, points):
        return False
    points = np.concatenate(rest) @ into[:3, :3].T + into[:3, 3]
    if model.runs_into(points, q, slack):
        return False
    if held:
        points = np.concatenate(held) @ into[:3, :3].T + into[:3, 3]
        return not model.runs_into(points, q, slack, moving)
    return True
