"""From a planner state to a timed arm motion: approach, grip or press, follow the joint, stay."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mam_envs.grasping.candidates import Grasp, grasp_opening, tool_path
from mam_envs.placement.arm_path import ArmPath
from mam_envs.planner_state import PlannerState
from mam_envs.replanning import arm_path
from mam_envs.robots import RobotSpec
from mam_pipeline.errors import NotPhysicalError
from mam_pipeline.types import FloatArray
from mam_policies.expert.config import ExpertConfig


class PlanningError(NotPhysicalError):
    """The expert finds no motion from this state; the message says why."""


@dataclass(frozen=True)
class Plan:
    """A timed motion, one row per control step (20 Hz).

    Attributes:
        path: the arm path it times.
        arm: (T, n) joint targets, radians.
        gripper: (T,) gripper commands.
        phase: (T,) names: move, approach, close, follow, settle, release; for things also lift,
            hold, carry, lower, leave.
        expected: (T,) joint value of the object that should be reached by then.
    """

    path: ArmPath
    arm: FloatArray
    gripper: FloatArray
    phase: tuple[str, ...]
    expected: FloatArray

    def __len__(self) -> int:
        return len(self.arm)


def plan(
    now: PlannerState,
    skip: Sequence[Grasp] = (),
    config: ExpertConfig = ExpertConfig(),  # noqa: B008
) -> Plan:
    """Plan from the present state of arm and object.

    Args:
        skip: grasps that were tried in vain.

    Raises:
        PlanningError: with the reason.
    """
    try:
        path = arm_path(now, skip, config.tilts, surface_first=len(skip) >= config.card_tries)
    except NotPhysicalError as error:
        raise PlanningError(str(error)) from error
    return time_path(now.robot, now, path, config)


def time_path(robot: RobotSpec, now: PlannerState, path: ArmPath, config: ExpertConfig) -> Plan:
    """Put an arm path on the clock: joint speeds below the robot's, the hand slow at the part."""
    opened = grasp_opening(robot, path.grasp)
    closed = robot.closed
    pushing = path.grasp.mode == "push"
    ready = closed if pushing else opened
    rows: list[FloatArray] = []
    grip: list[float] = []
    names: list[str] = []
    expected: list[float] = []
    start = float(path.q[0])

    def add(arm: FloatArray, gripper: float, name: str, values: FloatArray | float) -> None:
        rows.append(arm)
        grip.extend([gripper] * len(arm))
        names.extend([name] * len(arm))
        expected.extend(np.broadcast_to(values, (len(arm),)).tolist())

    add(
        timed(np.stack([now.arm, path.approach[0]]), config.move_speed * robot.step),
        ready,
        "move",
        start,
    )
    add(timed(path.approach, config.approach_speed * robot.step, 10), ready, "approach", start)
    add(np.repeat(path.approach[-1:], config.pause_steps, axis=0), ready, "approach", start)
    if not pushing:
        hold_still = np.repeat(path.approach[-1:], config.close_steps, axis=0)
        add(hold_still, closed, "close", start)
    hand = tool_path(now.model, now.goal, path.grasp, path.q)[:, :3, 3]
    length = float(np.linalg.norm(np.diff(hand, axis=0), axis=1).sum())
    slow = int(np.ceil(length / (config.push_speed if pushing else config.hand_speed)))
    least = max(12, min(slow, config.longest))
    gentle = 1.0 if pushing else 0.25
    arm, values = _timed_with(path.follow, path.q, config.follow_speed * robot.step, least, gentle)
    add(arm, closed, "follow", values)
    settle = config.settle_steps if now.goal.tolerance == 0.0 else config.settle_steps // 3
    add(np.repeat(path.follow[-1:], settle, axis=0), closed, "settle", float(path.q[-1]))
    return Plan(path, np.concatenate(rows), np.array(grip), tuple(names), np.array(expected))


def hand_travel(now: PlannerState, path: ArmPath) -> float:
    """Metres that the hand travels per unit of joint motion."""
    ends = tool_path(now.model, now.goal, path.grasp, path.q[[0, len(path.q) // 2]])[:, :3, 3]
    moved = abs(float(path.q[len(path.q) // 2] - path.q[0]))
    return float(np.linalg.norm(ends[1] - ends[0])) / max(moved, 1e-9)


def correction(now: PlannerState, done: Plan, config: ExpertConfig) -> Plan | None:
    """The motion that carries the hand on by what the joint still lacks, or None.

    A grasp slips and an arm gives: at the end of its way the joint may have stopped short (or, for
    turn_to, beside its goal) while the hand still holds it.
    """
    goal, robot, path = now.goal, now.robot, done.path
    way = goal.q_goal - goal.q_start
    lacks = goal.q_goal - now.q
    near = abs(lacks) <= 0.7 * goal.tolerance if goal.tolerance else lacks * way <= 0.0
    lever = hand_travel(now, path)
    short = abs(way) * lever < config.short  # the arm's own give may be as long
    if near:
        return (
            _release(robot, done, config)
            if done.gripper[-1] != grasp_opening(robot, path.grasp)
            else None
        )
    if not short and (now.q - goal.q_start) * way < 0.1 * way * way:
        return None
    give = (
        0.0 if goal.tolerance else max(config.give_share * abs(way), config.give / max(lever, 1e-6))
    )
    extra = lacks + np.sign(way) * give
    begin = float(done.expected[-1])
    values = begin + np.linspace(0.0, 1.0, 7)[1:] * extra
    into = np.linalg.inv(now.base) @ now.world_asset
    arm = done.arm[-1]
    rows = []
    for tool in into @ tool_path(now.model, goal, path.grasp, values):
        found = robot.chain.solve(tool[None], arm[None], robot.rotation_weight, 15)
        fine = found.good(0.01, 2 * robot.rotation_tolerance)[0]
        if not fine or np.abs(found.q[0] - arm).max() > 0.5:
            break
        arm = found.q[0]
        rows.append(arm)
    if not rows:
        return None
    follow = np.stack([done.arm[-1], *rows])
    steps, expected = _timed_with(
        follow, np.concatenate([[begin], values[: len(rows)]]), config.follow_speed * robot.step, 10
    )
    still = np.repeat(steps[-1:], config.settle_steps // 2, axis=0)
    count = len(steps) + len(still)
    return Plan(
        path,
        np.concatenate([steps, still]),
        np.full(count, done.gripper[-1]),
        (("follow",) * len(steps)) + (("settle",) * len(still)),
        np.concatenate([expected, np.full(len(still), expected[-1])]),
    )


def _release(robot: RobotSpec, done: Plan, config: ExpertConfig) -> Plan | None:
    """Open the hand where it is: a squeezed knob trembles, and is still once it is let go."""
    if done.path.grasp.mode == "push":
        return None
    return Plan(
        done.path,
        np.repeat(done.arm[-1:], config.release_steps, axis=0),
        np.full(config.release_steps, grasp_opening(robot, done.path.grasp)),
        ("release",) * config.release_steps,
        np.repeat(done.expected[-1:], config.release_steps),
    )


def timed(points: FloatArray, step: float, least: int = 8) -> FloatArray:
    """Joint waypoints (K, n) as targets (T, n), no joint faster than `step` per row on average,
    starting and ending gently."""
    return _timed_with(points, np.zeros(len(points)), step, least)[0]


def _timed_with(
    points: FloatArray, values: FloatArray, step: float, least: int, gentle: float = 0.25
) -> tuple[FloatArray, FloatArray]:
    lengths = np.abs(np.diff(points, axis=0)).max(axis=1)
    along = np.concatenate([[0.0], np.cumsum(np.maximum(lengths, 1e-6))])
    count = max(least, int(np.ceil(along[-1] / step)))
    s = np.linspace(0.0, 1.0, count + 1)[1:]
    eased = (1 - gentle) * s + gentle * (3 * s**2 - 2 * s**3)
    at = eased * along[-1]
    arm = np.stack([np.interp(at, along, column) for column in points.T], axis=1)
    return arm, np.interp(at, along, values)
