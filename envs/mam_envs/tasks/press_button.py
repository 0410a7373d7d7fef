"""Press a button that a spring pushes back, until it latches, and take the hand away."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import torch

from mam_envs.config import EnvConfig, RewardConfig, SuccessConfig
from mam_envs.object_model import ObjectModel
from mam_envs.tasks.base import JointGoal, OtherTaskError, TaskState
from mam_envs.tasks.operate_joint import OperateJoint
from mam_pipeline.edited import Finite, Positive, Range


@dataclass(frozen=True)
class PressSuccess(SuccessConfig):
    """What is asked of a button; it latches at `fraction` of its way.

    Attributes:
        spring: newtons with which its spring pushes back where it latches.
        free_steps: control steps (20 a second) for which the hand must have left it.
        deepest: metres; what slides further is no button.
    """

    spring: Positive = 2.0
    free_steps: Annotated[int, Range(1, 1000)] = 5
    deepest: Positive = 0.05


@dataclass(frozen=True)
class PressReward(RewardConfig):
    """Scales of the terms that `push` has, and of two more.

    Attributes:
        latched: 1 once the button has latched.
        let_go: 1 while it is latched and the robot does not touch it.
    """

    latched: Finite = 2.0
    let_go: Finite = 1.0


class PressButton(OperateJoint):
    """Press a sliding button in until it latches, then leave it.

    A spring pushes the button back: one that is let go too early comes out again. At
    `SuccessConfig.fraction` of its way, moved there by the robot's touch, it latches, and its
    spring then holds it there.

    Success: the button has latched, the robot has not touched it for `free_steps`, and it is still
    in. Forces above the limits end the episode as failed.
    """

    def __init__(
        self, goals: Sequence[Sequence[JointGoal]], config: EnvConfig, device: torch.device
    ) -> None:
        super().__init__(goals, config, device)
        assert isinstance(config.success, PressSuccess)
        self.free_steps = config.success.free_steps
        at = [[(g.closed, g.q_goal) for g in row] for row in goals]
        self.out, self.inside = torch.tensor(at, device=device).unbind(dim=-1)
        self.latched = torch.zeros_like(self.out, dtype=torch.bool)
        self.free = torch.zeros(len(goals), device=device)

    @classmethod
    def defaults(cls) -> EnvConfig:
        """With the spring, and with rewards for latching and letting go."""
        return EnvConfig(success=PressSuccess(), reward=PressReward())

    @classmethod
    def goal(
        cls, name: str | None, model: ObjectModel, joint: str | None, config: SuccessConfig
    ) -> JointGoal:
        """See `Task.goal`; refuses what is no button."""
        assert isinstance(config, PressSuccess)
        found = super().goal("push", model, joint, config)
        kinds = {g.kind for g in model.asset.card.grasps if g.joint == found.joint}
        if found.subtype != "slide" or "push" not in kinds or found.range > config.deepest:
            raise OtherTaskError(
                f"joint {found.joint!r} of {model.asset.card.name} is no button, which slides in "
                f"by at most {100 * config.deepest:.0f} cm where one pushes; take another joint, "
                "or the task open, turn_to or push"
            )
        return replace(found, task="press", spring=config.spring, let_go=True)

    def reset(self, env_idx: torch.Tensor, q: torch.Tensor) -> None:
        super().reset(env_idx, q)
        self.latched[env_idx] = False
        self.free[env_idx] = 0.0

    def update(self, now: TaskState) -> None:
        super().update(now)
        tracker = self.tracker
        reached = tracker.progress(self.pick(now.q)) >= 1.0
        here = reached & tracker.by_contact & ~tracker.overloaded
        self.latched.scatter_(1, self.stage[:, None], (self.pick(self.latched) | here)[:, None])
        self.free = torch.where(tracker.touching, torch.zeros_like(self.free), self.free + 1)

    def spring_targets(self) -> torch.Tensor:
        """Out until it has latched."""
        return torch.where(self.latched, self.inside, self.out)

    def finished(self, now: TaskState) -> tuple[torch.Tensor, torch.Tensor]:
        """(b,) success, and whether a button before the last one of a sequence is done."""
        tracker = self.tracker
        still_in = tracker.progress(self.pick(now.q)) > 0.5
        left = self.free >= self.free_steps
        done = self.pick(self.latched) & left & still_in & ~tracker.overloaded
        last = self.stage >= tracker.stages - 1
        return done & last, done & ~last

    def evaluate(self, now: TaskState) -> dict[str, torch.Tensor]:
        """As of `OperateJoint`; `progress` stays 1 once the button has latched."""
        before = self.stage
        info = super().evaluate(now)
        self.free = torch.where(self.stage == before, self.free, torch.zeros_like(self.free))
        latched, progress = self.pick(self.latched), info["progress"]
        progress = torch.where(latched, torch.ones_like(progress), progress)
        return {**info, "progress": progress, "latched": latched}

    def observe(self, now: TaskState, info: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
        return {**super().observe(now, info), "latched": info["latched"].float()}

    def reward_terms(
        self, now: TaskState, info: Mapping[str, torch.Tensor]
    ) -> dict[str, torch.Tensor]:
        """As of `OperateJoint`, but that letting go of a latched button costs no contact."""
        terms, latched = super().reward_terms(now, info), info["latched"].float()
        return {
            **terms,
            "contact": torch.maximum(terms["contact"], latched),
            "latched": latched,
            "let_go": latched * (~self.tracker.touching).float(),
        }
