"""Tasks on a loose thing as legs, one motion each: open the drawer and take the thing out, or put
it in and close the drawer."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from mam_envs.grasping.candidates import Grasp
from mam_envs.placement.arm_path import ArmPath, clear
from mam_envs.placement.reach_in import REACH_IN, in_open, opening, reached, swings, ways_to
from mam_envs.planner_state import PlannerState
from mam_envs.tasks.base import JointGoal
from mam_pipeline.asset.card import CardGrasp
from mam_pipeline.types import FloatArray
from mam_policies.expert.config import ExpertConfig
from mam_policies.expert.plan import Plan, PlanningError, timed

Leg = Literal["joint", "open", "pick", "put"]


@dataclass(frozen=True)
class CarryLimits:
    """How much is looked at for one cube.

    Attributes:
        places: in the drawer.
    """

    places: int = 6


LIMITS = CarryLimits()


def next_leg(now: PlannerState) -> Leg:
    """What is to be done in this state; "joint" for tasks without a thing."""
    goal = now.goal
    if goal.thing is None:
        return "joint"
    if goal.closing:
        return "joint" if _is_inside(now) else "put"
    is_open = (now.q - goal.closed) / (goal.q_goal - goal.closed) >= 1.0
    return "pick" if is_open else "open"


def goal_of(leg: Leg, goal: JointGoal) -> JointGoal:
    """What a leg asks of the joint."""
    return replace(goal, q_start=goal.closed) if leg == "open" else goal


def pick(now: PlannerState, config: ExpertConfig) -> Plan:
    """Take the thing from above, and lift it over the drawer's walls.

    Raises:
        PlanningError: no way of the hand to it is free.
    """
    goal, robot, thing = now.goal, now.robot, now.goal.thing
    assert thing is not None and now.thing is not None
    pose = np.linalg.inv(now.world_asset) @ now.thing
    q = {**now.others, goal.joint: now.q}
    ways = ways_to(now.model, robot, thing, _upright(pose), q)
    for start in (now.arm, robot.rest_arm):  # straight there, or by way of the arm's rest
        found = reached(now.model, robot, thing, now.base[None], now.world_asset, ways, q, start)[0]
        if found is None:
            continue
        path = _path(now, ways[found[0], -1], found[1])
        if clear(now.model, goal, robot, path, now.world_asset, now.others, begin=start):
            return _timed_pick(now, path, np.stack([now.arm, start, path.approach[0]]), config)
    raise PlanningError(
        f"{now.model.asset.card.name}: no free way from above to the cube in {goal.joint!r}"
    )


def put(now: PlannerState, config: ExpertConfig) -> Plan:
    """Take the thing from beside the drawer, and let it go above the drawer's floor.

    Raises:
        PlanningError: no way of the hand to it, or with it into the drawer, is free.
    """
    goal, robot, thing, model = now.goal, now.robot, now.goal.thing, now.model
    assert thing is not None and now.thing is not None
    q = {**now.others, goal.joint: now.q}
    pose = _upright(np.linalg.inv(now.world_asset) @ now.thing)
    ways = ways_to(model, robot, thing, pose, q, REACH_IN.lifted)
    name = f"{model.asset.card.name}: no free way"
    rest, world, base = robot.rest_arm, now.world_asset, now.base[None]
    for start in (now.arm, rest):
        taken = reached(model, robot, thing, base, world, ways, q, start, swing=True)[0]
        if taken is not None and _swings(now, now.arm, start):
            break
    else:
        raise PlanningError(f"{name} from above to the cube beside {goal.joint!r}")
    down = taken[1]
    to_thing = np.stack([now.arm, start, down[0]])
    held = np.linalg.inv(ways[taken[0], -1]) @ pose  # tool_T_thing
    places = now.layout.places
    for k in np.unique(np.linspace(0, len(places) - 1, LIMITS.places).astype(int)):
        at = in_open(model, goal, places[k])
        at[2, 3] += REACH_IN.drop
        into = ways_to(model, robot, thing, at, q)
        found = reached(model, robot, thing, base, world, into, q, rest, swing=True)[0]
        if found is None:
            continue
        for by in (down[0], rest):
            if _swings(now, down[0], by, held) and _swings(now, by, found[1][0], held):
                path = _path(now, into[found[0], -1], found[1])
                return _timed_put(now, path, to_thing, down, np.stack([down[0], by]), config)
    raise PlanningError(f"{name} with the cube into what {goal.joint!r} moves")


def _is_inside(now: PlannerState) -> bool:
    thing, goal = now.goal.thing, now.goal
    assert thing is not None and now.thing is not None
    part = now.world_asset @ now.model.motion(goal.joint, np.array([now.q]), {})[0]
    at = (np.linalg.inv(part) @ now.thing)[:3, 3]
    return bool((at >= thing.low).all() and (at <= thing.high).all())


def _swings(
    now: PlannerState, begin: FloatArray, end: FloatArray, held: FloatArray | None = None
) -> bool:
    """Whether the arm swings freely from one posture to another, and what it holds with it.

    Args:
        held: (4, 4) tool_T_thing of the cube in the hand.
    """
    robot, thing = now.robot, now.goal.thing
    assert thing is not None
    q = {**now.others, now.goal.joint: now.q}
    if not swings(now.model, robot, thing, begin, end, now.base, now.world_asset, q):
        return False
    if held is None:
        return True
    swing: FloatArray = np.asarray(np.linspace(begin, end, REACH_IN.swing), dtype=float)
    side = np.linspace(-0.5, 0.5, 3) * thing.size
    corners = np.stack(np.meshgrid(side, side, side), axis=-1).reshape(-1, 3)
    local = corners @ held[:3, :3].T + held[:3, 3]
    rotation, position, _ = robot.chain.forward(swing)
    into = np.linalg.inv(now.world_asset) @ now.base
    for turn, at in zip(rotation, position):
        points = (local @ turn.T + at) @ into[:3, :3].T + into[:3, 3]
        if now.model.runs_into(points, q):
            return False
    return True


def _timed_put(
    now: PlannerState, path: ArmPath, to_thing: FloatArray, down: FloatArray, by: FloatArray,
    config: ExpertConfig,
) -> Plan:  # fmt: skip
    """Take, carry, let go, and come back to rest, from where the way to the handle is known.

    Args:
        path: down into the drawer. to_thing: (K, n) to above the cube. down: (K, n) down to it.
        by: (K, n) from above the cube on the way to above the drawer.
    """
    robot, thing = now.robot, now.goal.thing
    assert thing is not None
    wide, taken, there = opening(robot, thing), down[-1:], path.approach[-1:]
    move, slow = config.move_speed * robot.step, config.approach_speed * robot.step
    carry = timed(np.concatenate([by, path.approach[:1]]), 0.6 * move)
    parts = [
        ("move", timed(to_thing, move), wide),
        ("approach", timed(down, slow, 10), wide),
        ("approach", np.repeat(taken, config.pause_steps, axis=0), wide),
        ("close", np.repeat(taken, config.close_steps, axis=0), robot.closed),
        ("lift", timed(down[::-1], slow, 10), robot.closed),
        ("carry", carry, robot.closed),
        ("lower", timed(path.approach, slow, 10), robot.closed),
        ("lower", np.repeat(there, config.pause_steps, axis=0), robot.closed),
        ("release", np.repeat(there, config.release_steps, axis=0), wide),
        ("leave", timed(path.follow, slow, 10), wide),
        ("leave", timed(np.stack([path.follow[-1], robot.rest_arm]), move), wide),
    ]
    return _as_plan(path, parts, now.q)


def _upright(pose: FloatArray) -> FloatArray:
    """The pose of a cube (4, 4) with that of its faces' axes first that is most level."""
    flat = int(np.argmin(np.abs(pose[2, :3])))
    out = pose.copy()
    x = pose[:3, flat] * np.array([1.0, 1.0, 0.0])
    out[:3, 0] = x / np.linalg.norm(x)
    return out


def _path(now: PlannerState, tool: FloatArray, arm: FloatArray) -> ArmPath:
    """Down along `arm` (K, n) and up again, as a path on which the joint stays."""
    thing, goal = now.goal.thing, now.goal
    assert thing is not None
    card = CardGrasp(
        goal.joint, "", "knob", tool[:3, 3].tolist(), tool[:3, 2].tolist(), tool[:3, 1].tolist(),
        thing.size,
    )  # fmt: skip
    grasp = Grasp(card, "grip", tool, room=REACH_IN.room)
    return ArmPath(grasp, now.base, arm, arm[::-1], np.full(len(arm), now.q), 0.0)


def _timed_pick(now: PlannerState, path: ArmPath, swing: FloatArray, config: ExpertConfig) -> Plan:
    robot, thing = now.robot, now.goal.thing
    assert thing is not None
    wide, at = opening(robot, thing), path.approach[-1:]
    parts = [
        ("move", timed(swing, config.move_speed * robot.step), wide),
        ("approach", timed(path.approach, config.approach_speed * robot.step, 10), wide),
        ("approach", np.repeat(at, config.pause_steps, axis=0), wide),
        ("close", np.repeat(at, config.close_steps, axis=0), robot.closed),
        ("lift", timed(path.follow, config.approach_speed * robot.step, 10), robot.closed),
        ("hold", np.repeat(path.follow[-1:], config.settle_steps, axis=0), robot.closed),
    ]
    return _as_plan(path, parts, now.q)


def _as_plan(path: ArmPath, parts: list[tuple[str, FloatArray, float]], q: float) -> Plan:
    """Phases (name, (T, n) arm targets, gripper) in turn, while the joint stays at `q`."""
    return Plan(
        path,
        np.concatenate([arm for _, arm, _ in parts]),
        np.concatenate([np.full(len(arm), grip) for _, arm, grip in parts]),
        tuple(name for name, arm, _ in parts for _ in arm),
        np.full(sum(len(arm) for _, arm, _ in parts), q),
    )
