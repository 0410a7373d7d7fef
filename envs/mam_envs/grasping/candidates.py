"""Grasp candidates: ways to grasp a part or to push it, from the grasps that the card names."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from scipy.spatial.transform import Rotation

from mam_envs.grasping.force_closure import pull_capacity
from mam_envs.grasping.limits import LIMITS
from mam_envs.object_model import ObjectModel
from mam_envs.robots import RobotSpec
from mam_envs.tasks.base import JointGoal
from mam_pipeline.asset.card import CardGrasp
from mam_pipeline.errors import NotPhysicalError
from mam_pipeline.types import FloatArray

Cause = Literal["grasp", "width", "force", "reach", "path", "room"]
"""Why an arm cannot operate a joint: nothing to hold or push that the hand gets at; a handle wider
than the hand opens; more force than the arm is trusted with; out of reach, too high or too low; the
joint's way cannot be followed; no room for the arm."""


class PlacementError(NotPhysicalError):
    """No arm of this kind can do the task, wherever it stands; the message says why.

    Attributes:
        cause: the same in a word.
    """

    def __init__(self, message: str, cause: Cause = "grasp") -> None:
        super().__init__(message)
        self.cause = cause

    def __reduce__(self) -> tuple[Any, ...]:
        return type(self), (str(self), self.cause)


@dataclass(frozen=True)
class Grasp:
    """One way to grasp or push a part.

    Attributes:
        card: the card's grasp it comes from, or one made of the part's surface.
        mode: grip (fingers close on the part) or push (closed fingers press on it).
        tool: (4, 4) asset_T_tool at the rest pose.
        lags: shares of the part's turn that the hand may follow (1 = rigid; less where the
            fingers can pivot round a bar, or on a board's faces); `lag` is the one in use.
        cost: how unnatural it is, for ranking.
        room: how much wider than the thing the fingers open, metres.
    """

    card: CardGrasp
    mode: Literal["grip", "push"]
    tool: FloatArray
    lag: float = 1.0
    cost: float = 0.0
    lags: tuple[float, ...] = (1.0,)
    room: float = 0.04


def turn(axis: FloatArray, angle: float) -> FloatArray:
    """(3, 3) rotation about a unit axis."""
    return np.asarray(Rotation.from_rotvec(angle * np.asarray(axis)).as_matrix())


def card_grasps(
    model: ObjectModel, goal: JointGoal, robot: RobotSpec, tilts: Sequence[float] = (0, 15, 30, 50)
) -> list[Grasp]:
    """All grasps that the card's entries for a joint offer to this hand.

    Raises:
        PlacementError: there is no grasp at all, or none that fits the hand.
    """
    grasps = model.grasps(goal.joint)
    name = model.asset.card.name
    if not grasps:
        raise PlacementError(
            f"{name}: joint {goal.joint!r} offers nothing to grasp or push; name a handle in hints"
        )
    out: list[Grasp] = []
    narrowest, shallow = np.inf, 0
    for g in grasps:
        if g.kind == "push":
            if _pushes(model, goal, g):
                out += _variants(robot, g, "push", tilts)
            continue
        narrowest = min(narrowest, g.width)
        # fingers need something to close on: the deeper, the wider the thing is
        flat = g.kind == "rim" and g.depth < min(LIMITS.shallow, 0.5 * g.width)
        shallow += flat
        if g.width <= robot.max_width - 0.004 and not flat:
            out += _variants(robot, g, "grip", tilts)
        if goal.closing:
            out += _variants(robot, _pushing(model, goal, g), "push", tilts, extra=0.5)
    out = _weighed(model, goal, out)
    fits = [h for h in (_fit(model, goal, robot, grasp) for grasp in out) if h is not None]
    if out and not fits:
        raise PlacementError(
            f"{name}: a {robot.uid}'s hand cannot get at {goal.joint!r} without hitting the "
            "object, or finds nothing of it there"
        )
    if not out and shallow:
        raise PlacementError(
            f"{name}: the pull of {goal.joint!r} is too shallow for a {robot.uid}'s fingers"
        )
    if not out:
        wide = 100 * narrowest
        raise PlacementError(
            f"{name}: the handle of {goal.joint!r} is {wide:.1f} cm wide; "
            f"{robot.uid} opens to {100 * robot.max_width:.1f} cm"
            if np.isfinite(narrowest)
            else f"{name}: joint {goal.joint!r} can only be pushed, and not in that direction",
            "width" if np.isfinite(narrowest) else "grasp",
        )
    return fits


def _fit(model: ObjectModel, goal: JointGoal, robot: RobotSpec, grasp: Grasp) -> Grasp | None:
    """The grasp as it fits the hand; fingers that meet something when they are wide open, open
    less."""
    found = fit_to_hand(model, goal, robot, grasp)
    if found is None and grasp.mode == "grip":
        narrow = replace(grasp, room=LIMITS.narrow, cost=grasp.cost + 0.1)
        found = fit_to_hand(model, goal, robot, narrow)
    return found


def _weighed(model: ObjectModel, goal: JointGoal, rows: list[Grasp]) -> list[Grasp]:
    """Grasps near a hinge cost more: the same door asks for more force there."""
    if goal.subtype == "slide" or not rows:
        return rows
    q = np.array([goal.q_start, goal.q_start + 0.02 * (goal.q_goal - goal.q_start)])
    motion = model.motion(goal.joint, q, {})
    points = np.stack([h.card.position for h in rows])
    where = np.einsum("kij,nj->kni", motion[:, :3, :3], points) + motion[:, None, :3, 3]
    travel = np.linalg.norm(where[1] - where[0], axis=1)
    share = travel / max(float(travel.max()), 1e-12)
    return [replace(h, cost=h.cost + 0.8 * (1 - float(s))) for h, s in zip(rows, share)]


def fit_to_hand(
    model: ObjectModel, goal: JointGoal, robot: RobotSpec, grasp: Grasp
) -> Grasp | None:
    """The grasp with the lags at which the bare hand stays out of the object, or None."""
    pushing = grasp.mode == "push"
    opened = robot.closed if pushing else grasp_opening(robot, grasp)
    fingers, palm = robot.hand_surface(opened)
    q = goal_values(goal, 5)
    lags = [1.0] if goal.subtype == "slide" else list(grasp.lags)
    start = tool_path(model, goal, grasp, q[:1])[0]
    before = {goal.joint: float(q[0])}
    moving = model.moving_links(goal.joint)
    finger_hulls, palm_hulls = robot.hand_hulls(opened)
    hulls = [*finger_hulls, *palm_hulls]
    for distance in (LIMITS.back_off, 0.5 * LIMITS.back_off, 0.0):
        pose = backed(start[None], distance)[0]
        if grasp.card.kind == "push" and distance == 0.0:  # a tilted fingertip's corner goes in
            tips = fingers @ pose[:3, :3].T + pose[:3, 3]
            if (model.depth(tips, before) > LIMITS.dip + robot.tip_ahead).any():
                return None
            if _touches(model, palm, pose, before, LIMITS.dip):
                return None
            continue
        slack = LIMITS.dip if distance == 0.0 else 0.0
        if _touches(model, np.concatenate([fingers, palm]), pose, before, slack):
            return None
        if model.cuts_into(hulls, pose, before, 0.5 * LIMITS.dip):
            return None
    if not pushing and not _grasps_something(model, grasp, start, before, moving, robot):
        return None
    if not pushing and grasp.card.kind in ("rim", "edge"):  # nothing for the fingers to hook on
        width = min(robot.max_width, grasp.card.width + grasp.room)
        pull = _direction(model, goal, np.array(grasp.card.position))
        if pull_capacity(model, robot, start, width, pull, moving, before) < LIMITS.capacity:
            return None
    near = -LIMITS.clearance
    if model.cuts_into(finger_hulls, start, before, near, moving) or (
        model.cuts_into(palm_hulls, start, before, near)
    ):
        grasp = replace(grasp, cost=grasp.cost + LIMITS.tight)
    free, most = [], np.deg2rad(LIMITS.board_tilt)
    for lag in lags:
        poses = tool_path(model, goal, replace(grasp, lag=lag), q)
        if grasp.card.kind in ("rim", "edge") and _tilt(model, goal, grasp, poses[-1], q) > most:
            continue
        now = [{goal.joint: float(v)} for v in q]
        if not any(
            _touches(model, palm, pose, at, LIMITS.dip)
            or _touches(model, fingers, pose, at, LIMITS.dip, moving)
            for pose, at in zip(poses[1:], now[1:])
        ):
            free.append(lag)
    return replace(grasp, lag=free[0], lags=tuple(free)) if free else None


def _tilt(
    model: ObjectModel, goal: JointGoal, grasp: Grasp, last: FloatArray, q: FloatArray
) -> float:
    """Radians by which a hand that lags behind is tilted at the goal, about what it holds."""
    rigid = tool_path(model, goal, replace(grasp, lag=1.0), q[-1:])[0, :3, :3]
    return abs(float(Rotation.from_matrix(rigid.T @ last[:3, :3]).as_rotvec()[0]))


def _grasps_something(
    model: ObjectModel,
    grasp: Grasp,
    pose: FloatArray,
    q: Mapping[str, float],
    moving: tuple[str, ...],
    robot: RobotSpec,
) -> bool:
    """Whether any of the part's collision pieces lies between the open fingers."""
    half = 0.5 * min(grasp.card.width + 0.02, robot.max_width)
    axes = (
        np.linspace(-0.008, 0.008, 3),
        np.linspace(-half, half, 15),
        np.linspace(-0.012, robot.tip_ahead, 5),
    )
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    points = grid @ pose[:3, :3].T + pose[:3, 3]
    fixed = tuple(name for name in model.pieces if name not in moving)
    return bool((model.depth(points, q, fixed) >= 0.0).any())


def _touches(
    model: ObjectModel,
    points: FloatArray,
    pose: FloatArray,
    q: Mapping[str, float],
    slack: float,
    skip: tuple[str, ...] = (),
) -> bool:
    moved = points @ pose[:3, :3].T + pose[:3, 3]
    return model.runs_into(moved, q, slack, skip)


def _direction(model: ObjectModel, goal: JointGoal, point: FloatArray) -> FloatArray:
    """(3,) unit vector in which `point` (rest pose) sets out when the task begins, asset frame."""
    step = 0.02 * (goal.q_goal - goal.q_start)
    motion = model.motion(goal.joint, np.array([goal.q_start, goal.q_start + step]), {})
    where = motion[:, :3, :3] @ point + motion[:, :3, 3]
    move = where[1] - where[0]
    out: FloatArray = move / max(float(np.linalg.norm(move)), 1e-12)
    return out


def _pushes(model: ObjectModel, goal: JointGoal, g: CardGrasp) -> bool:
    start = model.motion(goal.joint, np.array([goal.q_start]), {})[0, :3, :3]
    along = start @ np.array(g.approach) @ _direction(model, goal, np.array(g.position))
    return bool(along > 0.3)


def _pushing(model: ObjectModel, goal: JointGoal, g: CardGrasp) -> CardGrasp:
    """A push at a handle in the direction of the task, at the rest pose."""
    start = model.motion(goal.joint, np.array([goal.q_start]), {})[0, :3, :3]
    approach = start.T @ _direction(model, goal, np.array(g.position))
    closing = np.cross(approach, [0.0, 0.0, 1.0])
    if np.linalg.norm(closing) < 0.3:
        closing = np.cross(approach, [0.0, 1.0, 0.0])
    closing /= np.linalg.norm(closing)
    position = np.array(g.position) - approach * 0.5 * min(g.width, 0.03)
    return CardGrasp(
        g.joint, g.link, "push", position.tolist(), approach.tolist(), closing.tolist(), 0.0
    )


def _variants(
    robot: RobotSpec,
    g: CardGrasp,
    mode: Literal["grip", "push"],
    tilts: Sequence[float],
    extra: float = 0.0,
) -> list[Grasp]:
    """Tilted and rolled versions of a grasp: about the closing axis always, about the bar where
    the fingers close on one."""
    approach = np.array(g.approach, dtype=float)
    closing = np.array(g.closing, dtype=float)
    approach /= np.linalg.norm(approach)
    closing -= approach * (closing @ approach)
    closing /= np.linalg.norm(closing)
    bar = np.cross(closing, approach)
    turns = [(closing, 0.0)]
    signs = [s * t for t in tilts if t for s in (1, -1)]
    turns += [(closing, t) for t in signs]
    if mode == "push" or g.kind in ("handle", "edge", "rim"):
        # a board between the fingers bears little of this; a round bar does
        most = LIMITS.board_tilt if g.kind in ("edge", "rim") else 90
        turns += [(bar, t) for t in signs if abs(t) <= most]
    rolls = (0, 180) if mode == "grip" else (0, 90, 180, 270)
    ahead = robot.tip_ahead if mode == "push" else max(0.0, robot.tip_ahead - g.depth)
    out = []
    for axis, degrees in turns:
        rotation = turn(axis, np.deg2rad(degrees))
        a, c = rotation @ approach, rotation @ closing
        for roll in rolls:
            y = turn(a, np.deg2rad(roll)) @ c
            tool = np.eye(4)
            tool[:3, :3] = np.stack([np.cross(y, a), y, a], axis=1)
            tool[:3, 3] = np.array(g.position) - a * ahead
            cost = 0.6 * np.deg2rad(abs(degrees)) + 0.5 * (1 - g.confidence) + extra
            pivots = mode == "push" or g.kind in ("handle", "rim", "edge")
            out.append(Grasp(g, mode, tool, 1.0, cost, LIMITS.lags if pivots else (1.0,)))
    return out


def push_variants(robot: RobotSpec, g: CardGrasp, extra: float) -> list[Grasp]:
    """Tilted and rolled presses of closed fingers."""
    return _variants(robot, g, "push", (0, 25, 50), extra)


def upright(robot: RobotSpec, g: CardGrasp) -> Grasp:
    """A card's grasp as it stands there, neither tilted nor rolled."""
    return _variants(robot, g, "push" if g.kind == "push" else "grip", ())[0]


def tool_path(model: ObjectModel, goal: JointGoal, grasp: Grasp, q: FloatArray) -> FloatArray:
    """asset_T_tool (K, 4, 4) at joint values q (K,)."""
    out = model.motion(goal.joint, q, {}) @ grasp.tool
    if grasp.lag < 1.0 and goal.subtype != "slide":
        slow = goal.q_start + grasp.lag * (q - goal.q_start)
        turned = model.motion(goal.joint, slow, {})
        out[:, :3, :3] = turned[:, :3, :3] @ grasp.tool[:3, :3]
    return out


def goal_values(
    goal: JointGoal, count: int = LIMITS.waypoints, q_now: float | None = None
) -> FloatArray:
    """(count,) joint values from the start past the goal: a grasp slips a few per cent, so the
    hand aims a tenth of the way further where the range allows."""
    start = goal.q_start if q_now is None else q_now
    end = goal.q_goal
    if goal.tolerance == 0.0:
        end = goal.q_goal + 0.12 * (goal.q_goal - goal.q_start)
    low, high = min(goal.lower, goal.upper), max(goal.lower, goal.upper)
    shares = np.arange(count, dtype=np.float64) / (count - 1)
    return np.asarray(start + shares * (float(np.clip(end, low, high)) - start), dtype=np.float64)


def grasp_opening(robot: RobotSpec, grasp: Grasp) -> float:
    """Gripper command before closing: the handle's width and some room."""
    return robot.opening(min(robot.max_width, grasp.card.width + grasp.room))


def backed(tool: FloatArray, distance: float) -> FloatArray:
    """Tool poses (N, 4, 4) moved back along their approach."""
    out = tool.copy()
    out[:, :3, 3] -= distance * tool[:, :3, 2]
    return out
