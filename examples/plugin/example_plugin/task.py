"""Open a joint, then keep it open and still: one second counts, a moment does not."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import torch

from mam_envs.config import EnvConfig, RewardConfig, SuccessConfig
from mam_envs.object_model import ObjectModel
from mam_envs.tasks import JointGoal, TaskState
from mam_envs.tasks.operate_joint import OperateJoint


@dataclass(frozen=True)
class KeepSuccess(SuccessConfig):
    """What `open` asks for, and for how long.

    Attributes:
        keep_steps: control steps in a row (20 a second) that the joint must stay open and still.
    """

    keep_steps: int = 20


@dataclass(frozen=True)
class KeepReward(RewardConfig):
    """Scales of the terms that `open` has, and of one more.

    Attributes:
        keep: share of the asked time for which the joint has been open and still, 0..1.
    """

    keep: float = 2.0


class OpenAndKeep(OperateJoint):
    """Open a joint and keep it open and still.

    Success: what `open` calls success holds for `keep_steps` control steps in a row.
    """

    def __init__(
        self, goals: Sequence[Sequence[JointGoal]], config: EnvConfig, device: torch.device
    ) -> None:
        super().__init__(goals, config, device)
        assert isinstance(config.success, KeepSuccess)
        self.asked = config.success.keep_steps
        self.kept = torch.zeros(len(goals), device=device)

    @classmethod
    def defaults(cls) -> EnvConfig:
        """`success.keep_steps` and `reward.keep` can be set like all other settings."""
        return EnvConfig(success=KeepSuccess(), reward=KeepReward())

    @classmethod
    def goal(
        cls, name: str | None, model: ObjectModel, joint: str | None, config: SuccessConfig
    ) -> JointGoal:
        """The goal of `open`, under this task's name."""
        return replace(super().goal("open", model, joint, config), task="open_and_keep")

    def reset(self, env_idx: torch.Tensor, q: torch.Tensor) -> None:
        super().reset(env_idx, q)
        self.kept[env_idx] = 0.0

    def update(self, now: TaskState) -> None:
        super().update(now)
        is_open, _ = self.tracker.evaluate(self.pick(now.q), self.pick(now.speed))
        self.kept = torch.where(is_open, self.kept + 1, torch.zeros_like(self.kept))

    def evaluate(self, now: TaskState) -> dict[str, torch.Tensor]:
        info = super().evaluate(now)
        return {**info, "success": self.kept >= self.asked, "kept_steps": self.kept.clone()}

    def observe(self, now: TaskState, info: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
        return {**super().observe(now, info), "kept": self.kept / self.asked}

    def reward_terms(
        self, now: TaskState, info: Mapping[str, torch.Tensor]
    ) -> dict[str, torch.Tensor]:
        terms = super().reward_terms(now, info)
        return {**terms, "keep": (self.kept / self.asked).clamp(max=1.0)}
