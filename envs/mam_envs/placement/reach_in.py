"""Reaching into a drawer from above: where a hand fits round a thing, and which arms get there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mam_envs.grasping.candidates import turn
from mam_envs.object_model import ObjectModel
from mam_envs.placement.arm_path import free, seeds_round
from mam_envs.placement.settings import PLACEMENT
from mam_envs.robots import RobotSpec
from mam_envs.tasks.base import JointGoal
from mam_envs.tasks.thing import Thing
from mam_pipeline.types import FloatArray


@dataclass(frozen=True)
class ReachIn:
    """How a hand takes hold of a thing.

    Attributes:
        room: how much wider than the thing the fingers open, metres.
        over: metres between the end of the drawer's walls and what is carried above them.
        tilts: angles of the hand from straight down that are tried, degrees.
        turn: degrees, at most, by which a thing is turned from the drawer's walls, or on the ground
            from the world's axes.
        drop: metres above the drawer's floor at which a thing is let go.
        shares: of the arm's reach, distances from its base at which a thing may lie on the ground;
        angles: degrees from the side on which the object is. lifted: metres that it is lifted.
        starts: places on the ground that are enough.
        swing: postures between two that are compared with the object.
    """

    room: float = 0.03
    over: float = 0.05
    tilts: tuple[float, ...] = (0.0, 20.0, -20.0)
    turn: float = 10.0
    drop: float = 0.006
    shares: tuple[float, ...] = (0.6, 0.5, 0.7, 0.4)
    angles: tuple[float, ...] = (75, -75, 60, -60, 90, -90, 45, -45, 110, -110)
    lifted: float = 0.12
    starts: int = 8
    swing: int = 12


REACH_IN = ReachIn()


def holds(robot: RobotSpec, thing: Thing, pose: FloatArray) -> list[FloatArray]:
    """(4, 4) tool poses that take hold of the thing at `pose` (4, 4), z upwards, the straightest
    first; frames as of `pose`."""
    ahead = max(0.0, robot.tip_ahead + 0.004 - 0.5 * thing.size)
    out = []
    for degrees in REACH_IN.tilts:
        for quarter in range(4):
            closing = turn(np.array([0.0, 0.0, 1.0]), quarter * np.pi / 2) @ pose[:3, 0]
            approach = turn(closing, np.deg2rad(degrees)) @ np.array([0.0, 0.0, -1.0])
            tool = np.eye(4)
            tool[:3, :3] = np.stack([np.cross(closing, approach), closing, approach], axis=1)
            tool[:3, 3] = pose[:3, 3] - ahead * approach
            out.append(tool)
    return out


def opening(robot: RobotSpec, thing: Thing) -> float:
    """Gripper command before closing on the thing."""
    return robot.opening(min(robot.max_width, thing.size + REACH_IN.room))


def way_up(tool: FloatArray, rise: float, count: int = 5) -> FloatArray:
    """(count, 4, 4) tool poses from `tool` (4, 4) straight up by `rise` metres."""
    out = np.tile(tool, (count, 1, 1))
    out[:, 2, 3] += np.linspace(0.0, rise, count)
    return out


def rise(thing: Thing, height: float) -> float:
    """Metres from a height, drawer's frame, to where the thing is carried over the walls."""
    return max(0.0, thing.high[2] - height) + 0.5 * thing.size + REACH_IN.over


def hand_fits(
    model: ObjectModel, robot: RobotSpec, thing: Thing, way: FloatArray, q: Mapping[str, float]
) -> bool:
    """Whether the bare open hand keeps out of the object on a way (K, 4, 4), asset frame."""
    points = np.concatenate(robot.hand_surface(opening(robot, thing)))
    return not any(model.runs_into(points @ t[:3, :3].T + t[:3, 3], q) for t in way)


def served(
    model: ObjectModel,
    goal: JointGoal,
    robot: RobotSpec,
    bases: FloatArray,
    pose: FloatArray,
    places: Sequence[Sequence[float]],
) -> FloatArray:
    """(B, P) bool: which places (P, 3) of a thing an arm at bases (B, 4, 4) can take it from or put
    it to, with the drawer open (`JointGoal.reached_into`).

    Args:
        pose: (4, 4) world_T_asset.
    """
    thing, q = goal.thing, {goal.joint: goal.reached_into}
    assert thing is not None
    out = np.zeros((len(bases), len(places)), dtype=bool)
    for k, place in enumerate(places):
        ways = ways_to(model, robot, thing, in_open(model, goal, place), q)
        found = reached(model, robot, thing, bases, pose, ways, q)
        out[:, k] = [arm is not None for arm in found]
    return out


def hand_places(
    model: ObjectModel, goal: JointGoal, robot: RobotSpec
) -> list[tuple[float, float, float]]:
    """The places of the goal's thing at which the bare hand fits round it, turned as it may be."""
    thing, q = goal.thing, {goal.joint: goal.reached_into}
    assert thing is not None
    return [
        p for p in thing.places
        if all(
            len(ways_to(model, robot, thing, in_open(model, goal, p, yaw), q))
            for yaw in (-REACH_IN.turn, 0.0, REACH_IN.turn)
        )
    ]  # fmt: skip


def ground_places(
    model: ObjectModel,
    goal: JointGoal,
    robot: RobotSpec,
    base: FloatArray,
    poses: Sequence[FloatArray],
) -> list[tuple[float, float]]:
    """Where on the ground (x, y, world) the goal's thing can lie so that the arm at `base` (4, 4)
    takes it from above, wherever of `poses` (each (4, 4) world_T_asset) the object stands; the
    first of these is asked of the whole arm, the others of the hand."""
    thing, q = goal.thing, {goal.joint: goal.reached_into}
    assert thing is not None
    ahead = poses[0][:2, 3] + model.bounds(q).mean(axis=0)[:2] - base[:2, 3]
    side = float(np.arctan2(ahead[1], ahead[0]))
    out: list[tuple[float, float]] = []
    for share in REACH_IN.shares:
        for angle in REACH_IN.angles:
            a = side + np.deg2rad(angle)
            at = np.eye(4)
            at[:2, 3] = base[:2, 3] + share * robot.reach * np.array([np.cos(a), np.sin(a)])
            at[2, 3] = 0.5 * thing.size
            rows = [ways_to(model, robot, thing, np.linalg.inv(p) @ at, q, REACH_IN.lifted)
                    for p in poses]  # fmt: skip
            if not all(map(len, rows)):
                continue
            way = reached(model, robot, thing, base[None], poses[0], rows[0], q, swing=True)[0]
            if way is not None:
                out.append((float(at[0, 3]), float(at[1, 3])))
            if len(out) >= REACH_IN.starts:
                return out
    return out


def in_open(
    model: ObjectModel, goal: JointGoal, place: Sequence[float], yaw: float = 0.0
) -> FloatArray:
    """(4, 4) asset_T_thing at a place, turned by `yaw` degrees, in the open drawer."""
    motion = model.motion(goal.joint, np.array([goal.reached_into]), {})[0]
    at = np.eye(4)
    at[:3, :3] = turn(np.array([0.0, 0.0, 1.0]), np.deg2rad(yaw))
    at[:3, 3] = motion[:3, :3] @ np.array(place) + motion[:3, 3]
    return at


def ways_to(
    model: ObjectModel,
    robot: RobotSpec,
    thing: Thing,
    at: FloatArray,
    q: Mapping[str, float],
    up: float | None = None,
) -> FloatArray:
    """(W, K, 4, 4) straight ways down to the thing at `at` (4, 4) that are free for the bare hand,
    asset frame, the straightest first.

    Args:
        up: metres from which it comes down; from above the drawer's walls if None.
    """
    up = rise(thing, float(at[2, 3])) if up is None else up
    rows = [way_up(tool, up)[::-1] for tool in holds(robot, thing, at)]
    return np.array([row for row in rows if hand_fits(model, robot, thing, row, q)])


def swings(
    model: ObjectModel,
    robot: RobotSpec,
    thing: Thing,
    begin: FloatArray,
    end: FloatArray,
    base: FloatArray,
    pose: FloatArray,
    q: Mapping[str, float],
) -> bool:
    """Whether the arm at `base` (4, 4), its hand open for the thing, swings freely from one
    posture (n,) to another."""
    wide = opening(robot, thing)
    return all(
        free(model, robot, arm, wide, base, pose, q, (), 0.0, 0.0)
        for arm in np.linspace(begin, end, REACH_IN.swing)
    )


def reached(
    model: ObjectModel,
    robot: RobotSpec,
    thing: Thing,
    bases: FloatArray,
    pose: FloatArray,
    ways: FloatArray,
    q: Mapping[str, float],
    begin: FloatArray | None = None,
    swing: bool = False,
) -> list[tuple[int, FloatArray] | None]:
    """For each base, which of the ways the arm leads the open hand along, and its joints (K, n),
    clear of object and ground; None where there is none.

    Args:
        bases: (B, 4, 4) world_T_base. pose: (4, 4) world_T_asset. ways: (W, K, 4, 4), asset frame.
        q: the object's joints. begin: (n,) arm joints from which the arm comes; rest if None.
        swing: also its swing from there to where the way begins is clear.
    """
    out: list[tuple[int, FloatArray] | None] = [None] * len(bases)
    if not len(ways):
        return out
    start = robot.rest_arm if begin is None else begin
    seeds = seeds_round(robot, start)
    shape = (len(bases), len(ways), len(seeds))
    base, way, seed = (a.reshape(-1) for a in np.indices(shape))
    targets = (np.linalg.inv(bases) @ pose)[base, None] @ ways[way]
    arm, rows = seeds[seed], []
    alive = np.ones(len(arm), dtype=bool)
    for k in range(ways.shape[1]):
        found = robot.chain.solve(
            targets[alive, k], arm[alive], robot.rotation_weight, 15 if k else 40, start
        )
        fine = found.good(1.5 * PLACEMENT.position_tolerance, 1.5 * robot.rotation_tolerance)
        fine &= (np.abs(found.q - arm[alive]).max(axis=1) < 0.7) | (k == 0)
        arm = arm.copy()
        arm[alive] = found.q
        alive[alive] = fine
        rows.append(arm)
        if not alive.any():
            return out
    wide, found_arms = opening(robot, thing), np.stack(rows, axis=1)
    for r in np.flatnonzero(alive):
        b = int(base[r])
        if out[b] is None and all(
            free(model, robot, a, wide, bases[b], pose, q, (), 0.0, 0.0)
            for a in found_arms[r, ::-2]
        ):
            first = found_arms[r, 0]
            if swing and not swings(model, robot, thing, start, first, bases[b], pose, q):
                continue
            out[b] = int(way[r]), found_arms[r]
    return out
