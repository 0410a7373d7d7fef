"""Where to stand: a base for the arm from which it reaches the handle along the joint's path."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from mam_envs.config import RandomisationConfig
from mam_envs.grasping.candidates import Grasp, PlacementError, card_grasps, goal_values
from mam_envs.grasping.surface import surface_grasps
from mam_envs.object_model import ObjectModel
from mam_envs.placement.arm_path import ArmPath, Search, search
from mam_envs.placement.reach_in import hand_places, served
from mam_envs.placement.settings import PLACEMENT
from mam_envs.robots import RobotSpec
from mam_envs.tasks.base import JointGoal
from mam_pipeline.types import FloatArray


@dataclass(frozen=True)
class Placement:
    """Where robot and object stand on a common surface (z = 0 of the world).

    Attributes:
        base: (4, 4) world_T_base, upright.
        object_height: height of the stand below the object, metres; the object is at the world's
            origin otherwise.
        path: a reference motion at the object's nominal pose.
        robust: share of displaced object poses (corners of the randomisation) that are reachable.
    """

    base: FloatArray
    object_height: float
    path: ArmPath
    robust: float

    @property
    def base_height(self) -> float:
        """Height of the stand below the robot, metres."""
        return float(self.base[2, 3])


def object_pose(
    model: ObjectModel, height: float, shift: Sequence[float], yaw: float
) -> FloatArray:
    """(4, 4) world_T_asset: on its stand, turned by `yaw` about its vertical middle axis, shifted
    by (x, y)."""
    low, high = model.footprint
    middle = 0.5 * (low + high)
    c, s = np.cos(yaw), np.sin(yaw)
    out = np.eye(4)
    out[:2, :2] = [[c, -s], [s, c]]
    out[:2, 3] = middle[:2] - out[:2, :2] @ middle[:2] + np.asarray(shift)[:2]
    out[2, 3] = height - low[2]
    return out


def place(
    model: ObjectModel,
    goals: Sequence[JointGoal],
    robot: RobotSpec,
    chance: RandomisationConfig,
) -> Placement:
    """Find a base for a task on one joint, or on several in turn.

    Stands of several heights are tried, the lowest difference between robot and object first, and
    base positions round the handle at the arm's favourite distances; the first height at which
    some base serves all displaced poses of the randomisation wins, else the best base found.

    Raises:
        PlacementError: no base can do it, with the reason (too heavy, too high, too wide ...).
    """
    goal, name = goals[0], model.asset.card.name
    refusal: PlacementError | None = None
    best: Placement | None = None
    for candidates in _offers(model, goal, robot):
        if isinstance(candidates, PlacementError):
            # that a card names nothing says less than that nothing can be got at
            named = refusal is not None and model.grasps(goal.joint)
            refusal = refusal if named else candidates
            continue
        try:
            found = _stand(model, goals, robot, candidates, chance)
        except PlacementError as error:
            refusal = refusal if refusal and model.grasps(goal.joint) else error
            continue
        if best is None or found.robust > best.robust:
            best = found
        if best.robust >= PLACEMENT.enough:
            break
    if best is None:
        raise refusal or PlacementError(f"{name}: joint {goal.joint!r} cannot be held or pushed")
    return replace(best, robust=max(0.0, best.robust))


def _offers(
    model: ObjectModel, goal: JointGoal, robot: RobotSpec
) -> Iterator[list[Grasp] | PlacementError]:
    """The card's grasps; then, where they lead nowhere, those on the part's surface, by place."""
    try:
        yield card_grasps(model, goal, robot)
    except PlacementError as error:
        yield error
    left = surface_grasps(model, goal, robot)
    if not left:
        yield PlacementError(
            f"{model.asset.card.name}: nothing of {goal.joint!r} can be held or pushed from outside"
        )
    for _ in range(PLACEMENT.groups):
        if not left:
            return
        lead = left[0]
        near = [
            np.linalg.norm(h.tool[:3, 3] - lead.tool[:3, 3]) < 0.15
            and float(h.tool[:3, 2] @ lead.tool[:3, 2]) > 0.3
            for h in left
        ]
        yield [h for h, close in zip(left, near) if close]
        left = [h for h, close in zip(left, near) if not close]


def all_grasps(model: ObjectModel, goal: JointGoal, robot: RobotSpec) -> list[Grasp]:
    """The card's grasps and those on the surface.

    Raises:
        PlacementError: there are none.
    """
    try:
        out = card_grasps(model, goal, robot)
    except PlacementError as error:
        out = surface_grasps(model, goal, robot)
        if not out:
            raise error
    return out


def _stand(
    model: ObjectModel,
    goals: Sequence[JointGoal],
    robot: RobotSpec,
    candidates: list[Grasp],
    chance: RandomisationConfig,
) -> Placement:
    """The best place from which the first joint is served by one of `candidates`."""
    goal = goals[0]
    what = f"{model.asset.card.name}: joint {goal.joint!r}"
    later = [(g, all_grasps(model, g, robot)) for g in goals[1:]]
    for g, c in ((goal, candidates), *later):
        _strong_enough(model, g, robot, c, f"{model.asset.card.name}: joint {g.joint!r}")
    q = goal_values(goal, 10)
    best: Placement | None = None
    furthest = Search((), 0, 0, 0)
    handle = np.mean([h.tool[:3, 3] for h in candidates], axis=0)
    floor = _floor(model)
    for lift in PLACEMENT.floor_lifts if robot.floor_only else PLACEMENT.table_lifts:
        rise = max(0.0, -lift)
        world_asset = object_pose(model, rise, (0.0, 0.0), 0.0)
        level = max(lift, 0.0 if rise else floor)
        height = float(handle[2] + world_asset[2, 3]) - level
        if not -0.9 * robot.reach < height - robot.shoulder < 0.95 * robot.reach:
            continue
        bases, costs = _bases(model, goal, robot, candidates, world_asset, level, q, chance)
        if goal.thing is not None and len(bases):
            bases, costs = _over(model, goal, robot, bases, costs, world_asset)
        found = search(
            model, goal, robot, candidates, bases, world_asset, q, keep=6, base_costs=costs
        )
        furthest = max(furthest, found, key=lambda f: (f.followed, f.reached, f.tried))
        for path in _one_per_base(found.paths)[:3]:
            if not all(_serves(model, g, robot, c, path.base, world_asset) for g, c in later):
                what = f"{model.asset.card.name}: the other joints of the sequence"
                continue
            share = _robustness(model, goal, robot, candidates, path, rise, q, chance)
            share -= 0.1 * abs(lift)
            if best is None or share > best.robust + 1e-9:
                best = Placement(path.base, rise, path, share)
            if share >= 0.99:
                return best
        if best is not None and best.robust >= 0.7:
            break
    if best is None:
        text = furthest.reason(what) + f" for robot {robot.uid}"
        raise PlacementError(text, furthest.cause)
    return best


def _over(
    model: ObjectModel,
    goal: JointGoal,
    robot: RobotSpec,
    bases: FloatArray,
    costs: FloatArray,
    world_asset: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """The bases from which the arm gets at places of the goal's thing, too, and their costs."""
    some = hand_places(model, goal, robot)
    kept = np.zeros(len(bases), dtype=bool)
    if some:
        some = [some[k] for k in np.unique(np.linspace(0, len(some) - 1, 3).astype(int))]
        kept = served(model, goal, robot, bases, world_asset, some).mean(axis=1) >= 0.6
    return bases[kept], costs[kept]


def _strong_enough(
    model: ObjectModel, goal: JointGoal, robot: RobotSpec, candidates: Sequence[Grasp], what: str
) -> None:
    q = goal_values(goal, 8)
    force = min(
        model.pulling_force(goal.joint, q, np.array(h.card.position), h.card.width)
        for h in candidates
    )
    if force > robot.force:
        raise PlacementError(
            f"{what} is too heavy: it needs {force:.0f} N at the handle; "
            f"{robot.uid} is trusted with {robot.force:.0f} N",
            "force",
        )


def _bases(
    model: ObjectModel,
    goal: JointGoal,
    robot: RobotSpec,
    candidates: Sequence[Grasp],
    world_asset: FloatArray,
    height: float,
    q: FloatArray,
    chance: RandomisationConfig,
) -> tuple[FloatArray, FloatArray]:
    """(B, 4, 4) upright base poses round the handle, clear of the object's footprint, and (B,)
    what they cost: preferred are those in front of the handle, and those from which the displaced
    object's parts keep clear, too."""
    tools = np.stack([h.tool for h in candidates])
    spot = tools[:, :3, 3].mean(axis=0)
    motion = model.motion(goal.joint, q, {})
    way = motion[:, :3, :3] @ spot + motion[:, :3, 3]
    # long ways are served from their middle
    length = float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())
    middle = way.mean(axis=0) if length > 0.5 * robot.reach else way[0]
    handle = world_asset[:3, :3] @ middle + world_asset[:3, 3]
    facing = -(world_asset[:3, :3] @ np.array(candidates[0].card.approach))
    facing[2] = 0.0
    if np.linalg.norm(facing) < 0.5:
        facing = np.array([-1.0, 0.0, 0.0])
    outlines = _outlines(model, goal, q, world_asset, height)
    rows, costs = [], []
    start = np.arctan2(facing[1], facing[0])
    rise = abs(handle[2] - height - robot.shoulder)
    for share in PLACEMENT.shares:
        flat = np.sqrt(max((share * robot.reach) ** 2 - min(rise, 0.6 * robot.reach) ** 2, 0.0))
        flat = max(flat, 0.3 * robot.reach)
        for angle in PLACEMENT.angles:
            a = start + np.deg2rad(angle)
            at = handle[:2] + flat * np.array([np.cos(a), np.sin(a)])
            # a base under the object's moving part is fine only if that part passes overhead
            room = [
                float((lines[:, :2] @ at + lines[:, 2]).max()) - robot.base_radius
                for lines, low in outlines
                if low <= height + robot.shoulder + 0.3
            ]
            if room and min(room) < 0.0:
                continue
            spare = chance.position + np.sin(np.deg2rad(chance.yaw)) * flat
            tight = max(0.0, spare - min(room)) if room else 0.0
            rows.append(base_pose(robot, at, height, handle[:2]))
            costs.append(0.008 * abs(angle) + PLACEMENT.tight * tight)
    return (np.stack(rows) if rows else np.zeros((0, 4, 4))), np.array(costs)


def _floor(model: ObjectModel) -> float:
    """How high above its lowest point one may stand on the object: it may bring a floor along.

    A floor is low and reaches, in plan, well beyond all that stands on it; a bottom board does not.
    """
    base = model.footprint[0][2]
    points = [p.points for pieces in model.pieces.values() for p in pieces]
    flat = [p for p in points if p[:, 2].max() - base < PLACEMENT.floor]
    rest = [p for p in points if p[:, 2].max() - base >= PLACEMENT.floor]
    taken = np.prod(np.ptp(np.concatenate(rest)[:, :2], axis=0)) if rest else np.inf
    wide = [p for p in flat if np.prod(np.ptp(p[:, :2], axis=0)) > 1.5 * taken]
    return max((float(p[:, 2].max() - base) + 0.001 for p in wide), default=0.0)


def _outlines(
    model: ObjectModel, goal: JointGoal, q: FloatArray, pose: FloatArray, height: float
) -> list[tuple[FloatArray, float]]:
    """What no base at `height` may stand in, world: lines (M, 3) of plan outlines (outside where
    any row n . (x, y) + d > 0), and the height of their underside. The whole object at the start,
    and the moving links at some moments of the way."""
    moving = model.moving_links(goal.joint)
    out = []
    for value, names in ((q[0], tuple(model.pieces)), *((v, moving) for v in q[:: len(q) // 4])):
        poses = model.kinematics.link_poses({goal.joint: float(value)})
        rows = [
            piece.points @ poses[name][0][:3, :3].T + poses[name][0][:3, 3]
            for name in names
            for piece in model.pieces.get(name, ())
        ]
        rows = [points @ pose[:3, :3].T + pose[:3, 3] for points in rows]
        rows = [points for points in rows if points[:, 2].max() > height]
        if rows:
            points = np.concatenate(rows)
            try:
                lines = ConvexHull(points[:, :2]).equations
            except QhullError:  # flat: a line is no obstacle
                continue
            out.append((lines, float(points[:, 2].min())))
    return out


def base_pose(robot: RobotSpec, at: FloatArray, height: float, facing: FloatArray) -> FloatArray:
    """(4, 4) upright world_T_base at (x, y), its arm pointing at the point `facing` (x, y)."""
    yaw = np.arctan2(facing[1] - at[1], facing[0] - at[0]) - robot.forward
    out = np.eye(4)
    c, s = np.cos(yaw), np.sin(yaw)
    out[:2, :2] = [[c, -s], [s, c]]
    out[:3, 3] = [at[0], at[1], height]
    return out


def _serves(
    model: ObjectModel,
    goal: JointGoal,
    robot: RobotSpec,
    candidates: Sequence[Grasp],
    base: FloatArray,
    world_asset: FloatArray,
) -> bool:
    """Whether a base can also do another joint."""
    q = goal_values(goal, 10)
    return bool(search(model, goal, robot, candidates, base[None], world_asset, q, keep=1).paths)


def _one_per_base(paths: Sequence[ArmPath]) -> list[ArmPath]:
    out: dict[bytes, ArmPath] = {}
    for path in paths:
        out.setdefault(path.base.tobytes(), path)
    return list(out.values())


def _robustness(
    model: ObjectModel,
    goal: JointGoal,
    robot: RobotSpec,
    candidates: Sequence[Grasp],
    path: ArmPath,
    rise: float,
    q: FloatArray,
    chance: RandomisationConfig,
) -> float:
    """Share of the randomisation's corner poses that this base can serve."""
    if chance.position == 0 and chance.yaw == 0:
        return 1.0
    served = 0
    corners = [(1, 1, 1), (-1, 1, -1), (1, -1, -1), (-1, -1, 1)]
    for sx, sy, turn in corners:
        shift = (sx * chance.position, sy * chance.position)
        pose = object_pose(model, rise, shift, turn * np.deg2rad(chance.yaw))
        base, seeds = path.base[None], path.approach[[-1, 0]]
        found = search(model, goal, robot, [path.grasp], base, pose, q, keep=1, seeds=seeds)
        if not found.paths:
            found = search(model, goal, robot, candidates, base, pose, q, keep=1)
        served += bool(found.paths)
    return served / len(corners)
