"""The true object in the asset's place: what an articulation claims is tried on what can happen.

The planner sees the asset, the simulator holds the true object. A sliding door that was made a
hinged one then does not open, though the asset by itself opens without a fault. The true part
begins where the asset's part does, and the planner is told where the true part is, as one is who
looks at it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from mam_envs.config import SuccessConfig
from mam_envs.object_model import ObjectModel
from mam_envs.planner_state import PlannerState
from mam_envs.scene.layout import Layout
from mam_envs.tasks import Task
from mam_envs.tasks.base import JointGoal
from mam_pipeline.asset.card import Asset
from mam_pipeline.check.lint import lint
from mam_pipeline.errors import InputError, NotPhysicalError
from mam_pipeline.types import FloatArray

NEAR = 0.03
"""Metres between a handle and the true object beyond which the two are not one object."""
ARM = 0.05
"""Metres from a handle to the points by which a place of its part is told."""
SAMPLES = 721
"""Joint values among which the one is looked for that puts a part at a place."""


def true_layout(claimed: Layout, truth: Asset, task: type[Task], config: SuccessConfig) -> Layout:
    """The layout with the true object in it, at the same place and before the same robot.

    Args:
        claimed: of the asset. truth: the true object in the asset's frame; its card says by
            `metres_per_unit` how its lengths are scaled.

    Raises:
        InputError: the truth cannot be loaded, or nothing of it is at a handle of the asset.
        NotPhysicalError: what the asset's joint moves is fixed in truth.
    """
    for finding in lint(truth.urdf_path, truth.card):
        if not finding.warning:
            raise InputError(f"{truth.urdf_path}, {finding.where}: {finding.message}")
    model = ObjectModel.load(truth, claimed.model.scale * truth.card.metres_per_unit)
    goals = tuple(
        _from_same_place(
            task.goal(goal.task, model, _joint_at(model, handle, goal.joint), config),
            model, _places(claimed.model, goal.joint, [goal.q_start], handle)[0], handle,
            config.widest,
        )
        for goal, handle in zip(claimed.goals, claimed.handles)
    )  # fmt: skip
    return replace(claimed, model=model, goals=goals)


def _places(model: ObjectModel, joint: str, q: ArrayLike, handle: FloatArray) -> FloatArray:
    """(N, 4, 3) where a handle and three points beside it are at joint values (N,)."""
    motion = model.motion(joint, np.asarray(q, dtype=np.float64), {})
    points = handle + ARM * np.concatenate([np.zeros((1, 3)), np.eye(3)])
    return np.asarray(points @ motion[:, :3, :3].transpose(0, 2, 1) + motion[:, None, :3, 3])


def _nearest(
    model: ObjectModel, joint: str, q: FloatArray, place: FloatArray, handle: FloatArray
) -> float:
    """The value among `q` (N,) that puts a handle nearest to a place (4, 3)."""
    away = ((_places(model, joint, q, handle) - place) ** 2).sum(axis=(1, 2))
    return float(q[int(np.argmin(away))])


def _from_same_place(
    goal: JointGoal, model: ObjectModel, place: FloatArray, handle: FloatArray, widest: float
) -> JointGoal:
    """The goal from where the part has the handle at a place, towards the farther end of its way,
    but of a hinge no more than `widest` radians."""
    ends = [e if np.isfinite(e) else s * np.pi for e, s in ((goal.lower, -1), (goal.upper, 1))]
    values = np.asarray(np.linspace(ends[0], ends[1], SAMPLES), dtype=np.float64)
    start = _nearest(model, goal.joint, values, place, handle)
    if abs(start - goal.q_start) <= 2 * (values[1] - values[0]):
        return goal
    ways = [end - start for end in ends]
    way = max(ways, key=lambda w: (round(abs(w), 3), w * (goal.open - goal.closed)))
    if goal.subtype != "slide":
        way = float(np.clip(way, -widest, widest))
    share = (goal.q_goal - goal.q_start) / (goal.open - goal.closed)
    return replace(goal, q_start=start, q_goal=start + share * way, closed=start, open=start + way)


def _joint_at(model: ObjectModel, point: FloatArray, claimed: str) -> str:
    """The joint that carries what is at a point (3,), asset frame at rest, the farthest."""
    link = _link_at(model, point, claimed)
    movable = {j.name for j in model.asset.card.movable}
    carrying = [n for n in movable if link in model.moving_links(n)]
    if not carrying:
        raise NotPhysicalError(f"what joint {claimed!r} moves is fixed in {model.asset.card.name}")
    return max(sorted(carrying), key=lambda name: _travel(model, name, point))


def _link_at(model: ObjectModel, point: FloatArray, claimed: str) -> str:
    """The link whose collision shapes are nearest to a point."""
    poses = model.kinematics.link_poses({})
    away: dict[str, float] = {}
    for name, pieces in model.pieces.items():
        here = (point - poses[name][0][:3, 3]) @ poses[name][0][:3, :3]
        for piece in pieces:
            distance = float((piece.planes[:, :3] @ here + piece.planes[:, 3]).max())
            away[name] = min(away.get(name, np.inf), distance)
    if not away or min(away.values()) > NEAR:
        raise InputError(
            f"nothing of {model.asset.card.name} is at the handle of joint {claimed!r}; the truth "
            "must stand as the file did that the asset was made from"
        )
    return min(away, key=lambda name: away[name])


def _travel(model: ObjectModel, joint: str, point: FloatArray) -> float:
    """Metres that a point moves when its joint goes from closed to open."""
    closed, open_ = model.span(model.card_joint(joint))
    motion = model.motion(joint, np.asarray(np.linspace(closed, open_, 9), dtype=np.float64), {})
    where = motion[:, :3, :3] @ point + motion[:, :3, 3]
    return float(np.linalg.norm(np.diff(where, axis=0), axis=1).sum())


def as_claimed(now: PlannerState, claimed: Layout, stage: int) -> PlannerState:
    """What a planner is told that knows the asset only: its joint is where the true part is."""
    goal: JointGoal = claimed.goals[stage]
    handle, model, way = claimed.handles[stage], claimed.model, goal.q_goal - goal.q_start
    place = _places(now.layout.model, now.goal.joint, [now.q], handle)[0]
    low, high = goal.q_start - 0.25 * way, goal.q_start + 1.5 * way
    values = np.asarray(np.linspace(low, high, SAMPLES), dtype=np.float64)
    others = [j.name for j in model.asset.card.movable if j.name != goal.joint]
    return replace(
        now,
        layout=claimed,
        goal=goal,
        q=_nearest(model, goal.joint, values, place, handle),
        others={name: model.rest_value(name) for name in others},
    )
