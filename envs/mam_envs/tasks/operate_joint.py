"""Operate a joint: open, close, turn or push one joint of an asset, or several in turn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import torch

from mam_envs.config import EnvConfig, SuccessConfig
from mam_envs.object_model import ObjectModel
from mam_envs.tasks.base import JointGoal, Task, TaskState
from mam_envs.tasks.success import SuccessTracker
from mam_pipeline.errors import InputError, NotPhysicalError, unknown_name

NAMES = ("open", "close", "turn_to", "push")


class OperateJoint(Task):
    """Move a joint of the object to its goal.

    Randomizations: of the environment; `randomisation.start` draws how far open it begins.

    Success: the joint has gone `SuccessConfig.fraction` of its way (or is within `tolerance` of
    the asked value), is slower than `still_speed`, and at least the share `driven` of its motion
    happened while the robot touched the moving part. In a sequence every joint must get there in
    turn. A force above `part_force` or `link_force` ends the episode as failed.
    """

    def __init__(
        self, goals: Sequence[Sequence[JointGoal]], config: EnvConfig, device: torch.device
    ) -> None:
        super().__init__(goals, config, device)
        self.tracker = SuccessTracker(goals, config.success, device)
        self.stage = self.tracker.stage

    @classmethod
    def goal(
        cls, name: str | None, model: ObjectModel, joint: str | None, config: SuccessConfig
    ) -> JointGoal:
        """See `Task.goal`; without names, the most confident joint and what it suggests."""
        return joint_goal(model, joint, name, config)

    def reset(self, env_idx: torch.Tensor, q: torch.Tensor) -> None:
        self.tracker.reset(env_idx, q)

    def teleported(self, q: torch.Tensor) -> None:
        self.tracker.teleported(self.pick(q))

    def update(self, now: TaskState) -> None:
        self.tracker.update(self.pick(now.q), now.force)
        self.tracker.load(now.part_force, now.link_force)

    def finished(self, now: TaskState) -> tuple[torch.Tensor, torch.Tensor]:
        """(b,) success, and whether a joint before the last one of a sequence is done."""
        return self.tracker.evaluate(self.pick(now.q), self.pick(now.speed))

    def evaluate(self, now: TaskState) -> dict[str, torch.Tensor]:
        """See `Task.evaluate`; a sequence goes on to its next joint here."""
        q = self.pick(now.q)
        success, done = self.finished(now)
        by_contact = self.tracker.by_contact
        if self.tracker.stages > 1 and done.any():
            self.tracker.advance(done, now.q)
            self.stage = self.tracker.stage
            q = self.pick(now.q)
        return {
            "success": success,
            "fail": self.tracker.overloaded.clone(),
            "open_fraction": self.tracker.open_fraction(q),
            "progress": self.tracker.progress(q),
            "by_contact": by_contact,
            "contact_force": self.tracker.force,
            "part_force": now.part_force,
            "link_force": now.link_force,
            "stage": self.stage.clone(),
        }

    def observe(self, now: TaskState, info: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
        handle = self.pick(now.handle)
        return {
            "handle_position": handle,
            "tcp_to_handle": handle - now.tool[:, :3],
            "joint_value": self.pick(now.q),
            "joint_speed": self.pick(now.speed),
            "joint_goal": self.tracker.now("q_goal"),
            "open_fraction": info["open_fraction"],
            "progress": info["progress"],
            "touching": self.tracker.touching.float(),
        }

    def reward_terms(
        self, now: TaskState, info: Mapping[str, torch.Tensor]
    ) -> dict[str, torch.Tensor]:
        """See `RewardConfig` for what each term measures."""
        distance = (self.pick(now.handle) - now.tool[:, :3]).norm(dim=-1)
        moved = info["by_contact"] & (info["progress"] > 0.02)
        return {
            "reach": torch.where(moved, torch.ones_like(distance), 1 - torch.tanh(5 * distance)),
            "contact": self.tracker.touching.float(),
            "progress": info["progress"].clamp(-1, 1),
            "success": info["success"].float(),
            "untouched_motion": self.tracker.untouched,
            "action_rate": now.action_rate,
        }


def default_task(model: ObjectModel, joint: str) -> str:
    """The task that a joint suggests: push for buttons, turn_to for spins, else open."""
    card = model.card_joint(joint)
    kinds = {g.kind for g in model.asset.card.grasps if g.joint == joint}
    closed, open_ = model.span(card)
    if card.subtype == "slide" and kinds == {"push"} and abs(open_ - closed) < 0.05:
        return "push"
    return "turn_to" if card.subtype == "spin" else "open"


def joint_goal(
    model: ObjectModel, joint: str | None, task: str | None, config: SuccessConfig
) -> JointGoal:
    """Say in numbers what a task asks of a joint; the joint and the task that suggest themselves
    where None is given.

    Raises:
        ConfigError: unknown joint or task.
        NotPhysicalError: the joint has no range to move through.
    """
    name = joint or model.default_joint()
    card = model.card_joint(name)
    if task is not None and task not in NAMES:
        raise unknown_name("task", task, NAMES)
    kind = task or default_task(model, name)
    closed, open_ = model.span(card)
    lower, upper = model.limits(card)
    slide = card.subtype == "slide" or card.type == "prismatic"
    span = open_ - closed
    if not slide and abs(span) > config.widest:
        span = float(np.sign(span)) * config.widest
    if abs(span) < (2e-4 if slide else 5e-3):
        raise NotPhysicalError(f"joint {name!r} of {model.asset.card.name} has no range to move in")
    tolerance = 0.0
    start, goal = closed, closed + config.fraction * span
    if kind == "close":
        start = closed + config.start * span
        goal = start + max(config.fraction, 0.9) * (closed - start)
    elif kind == "turn_to":
        start = float(np.clip(0.0, min(lower, upper), max(lower, upper)))
        step = np.pi / 4 if card.subtype == "spin" and not slide else 0.5 * span
        goal = start + step if config.value is None else config.value * model.unit(card)
        goal = float(np.clip(goal, lower, upper))
        if abs(goal - start) < 1e-6:
            raise InputError(f"joint {name!r} is already at the asked value {goal:.3g}")
        least = 0.002 if slide else 0.05
        tolerance = config.tolerance or max(least, 0.1 * abs(goal - start))
    return JointGoal(
        joint=name,
        task=kind,
        subtype=card.subtype,
        q_start=float(start),
        q_goal=float(goal),
        tolerance=float(tolerance),
        closed=float(closed),
        open=float(closed + span),
        lower=float(lower),
        upper=float(upper),
        still_speed=config.still_speed[0 if slide else 1],
        closing=kind == "close",
    )
