"""Tasks on a loose thing as legs, one motion each: open the drawer, take the thing out."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np

from mam_envs.grasping.candidates import Grasp
from mam_envs.placement.arm_path import ArmPath, clear
from mam_envs.placement.reach_in import REACH_IN, opening, reached, ways_to
from mam_envs.planner_state import PlannerState
from mam_envs.tasks.base import JointGoal
from mam_pipeline.asset.card import CardGrasp
from mam_pipeline.types import FloatArray
from mam_policies.expert.config import ExpertConfig
from mam_policies.expert.plan import Plan, PlanningError, timed

Leg = Literal["joint", "open", "pick"]


def next_leg(now: PlannerState) -> Leg:
    """What is to be done in this state; "joint" for tasks without a thing."""
    goal = now.goal
    if goal.thing is None:
        return "joint"
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
    return Plan(
        path,
        np.concatenate([arm for _, arm, _ in parts]),
        np.concatenate([np.full(len(arm), grip) for _, arm, grip in parts]),
        tuple(name for name, arm, _ in parts for _ in arm),
        np.full(sum(len(arm) for _, arm, _ in parts), now.q),
    )
