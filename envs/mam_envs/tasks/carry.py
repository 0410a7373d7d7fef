"""Take a loose thing out of a drawer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated

import torch

from mam_envs.config import EnvConfig, RewardConfig, SuccessConfig
from mam_envs.object_model import ObjectModel
from mam_envs.tasks.base import JointGoal, OtherTaskError, TaskState
from mam_envs.tasks.operate_joint import OperateJoint
from mam_envs.tasks.thing import free_space
from mam_pipeline.edited import Finite, Positive, Range, Share
from mam_pipeline.errors import ConfigError, NotPhysicalError


@dataclass(frozen=True)
class CarrySuccess(SuccessConfig):
    """What is asked of a drawer and of the cube in it.

    Attributes:
        start: share of the way open at which an episode begins; 0 is a closed drawer.
        size: edge of the cube, metres. mass: kilograms.
        rest_speed: greatest speed of the cube at rest, metres per second.
        rest_steps: control steps (20 a second) for which it must be at rest.
    """

    start: Share = 0.8
    size: Positive = 0.04
    mass: Positive = 0.1
    rest_speed: Positive = 0.05
    rest_steps: Annotated[int, Range(1, 1000)] = 10


@dataclass(frozen=True)
class CarryReward(RewardConfig):
    """Scales of the terms that `open` has, and of one more. `reach` and `contact` are of the handle
    until the drawer is open, then of the cube; `progress` is the cube's.

    Attributes:
        opened: share of the drawer's way to where it counts as open, 0..1.
    """

    opened: Finite = 1.0


class TakeOut(OperateJoint):
    """Take a cube out of a drawer, which is opened first where it is not open.

    Randomizations: of the environment, and where the cube lies and how it is turned.

    Success: the cube's middle has left the box that the drawer encloses, and the cube is at rest,
    in the hand or on whatever it was put, for `rest_steps`; the robot has touched it. Forces on the
    drawer above the limits end the episode as failed.
    """

    def __init__(
        self, goals: Sequence[Sequence[JointGoal]], config: EnvConfig, device: torch.device
    ) -> None:
        super().__init__(goals, config, device)
        if self.tracker.stages > 1:
            raise ConfigError("this task is on one joint; make a sequence of open and close")
        assert isinstance(config.success, CarrySuccess)
        self.asked = config.success
        things = [row[0].thing for row in goals]
        self.low, self.high = (
            torch.tensor([getattr(t, name) for t in things], device=device)
            for name in ("low", "high")
        )
        zero = torch.zeros(len(goals), device=device)
        self.rested, self.thing_force = zero.clone(), zero.clone()
        self.touched = torch.zeros_like(zero, dtype=torch.bool)

    @classmethod
    def defaults(cls) -> EnvConfig:
        """With a cube, and a drawer that begins open."""
        return EnvConfig(success=CarrySuccess(), reward=CarryReward())

    @classmethod
    def goal(
        cls, name: str | None, model: ObjectModel, joint: str | None, config: SuccessConfig
    ) -> JointGoal:
        """See `Task.goal`; refuses what is no drawer, and one in which the cube has no room."""
        assert isinstance(config, CarrySuccess)
        found = super().goal("open", model, joint, config)
        what = f"joint {found.joint!r} of {model.asset.card.name}"
        if found.subtype != "slide":
            raise OtherTaskError(f"{what} is no drawer, which slides; take another joint or task")
        thing = free_space(model, found.joint, found.q_goal, config.size, config.mass)
        if thing is None:
            link = model.card_joint(found.joint).child
            kind = next((p.kind for p in model.asset.card.parts if p.link == link), "")
            refusal = NotPhysicalError if kind == "drawer" else OtherTaskError
            raise refusal(
                f"{what} has no free space inside for a cube of {100 * config.size:.1f} cm that "
                "can be lifted out; make success.size smaller, or take another joint"
            )
        start = found.closed + config.start * (found.open - found.closed)
        return replace(found, task=str(name), q_start=start, thing=thing)

    def reset(self, env_idx: torch.Tensor, q: torch.Tensor) -> None:
        super().reset(env_idx, q)
        self.rested[env_idx] = 0.0
        self.touched[env_idx] = False

    def update(self, now: TaskState) -> None:
        super().update(now)
        assert now.thing_force is not None and now.thing_speed is not None
        self.thing_force = now.thing_force
        self.touched = self.touched | (now.thing_force > self.asked.touch_force)
        still = now.thing_speed <= self.asked.rest_speed
        self.rested = torch.where(still, self.rested + 1, torch.zeros_like(self.rested))

    def opened(self, now: TaskState) -> torch.Tensor:
        """(b,) share of the way to where the drawer counts as open, 0..1."""
        q, closed = self.pick(now.q), self.tracker.now("closed")
        return ((q - closed) / (self.tracker.now("q_goal") - closed)).clamp(0, 1)

    def is_inside(self, now: TaskState) -> torch.Tensor:
        """(b,) whether the cube's middle is in the box that the drawer encloses."""
        assert now.inside is not None
        return ((now.inside >= self.low) & (now.inside <= self.high)).all(dim=-1)

    def lifted(self, now: TaskState) -> torch.Tensor:
        """(b,) share of the way from the drawer's floor to the end of its walls, 0..1."""
        assert now.inside is not None
        floor = self.low[:, 2] + 0.5 * self.asked.size
        share = (now.inside[:, 2] - floor) / (self.high[:, 2] - floor).clamp(min=1e-3)
        return torch.where(self.is_inside(now), share.clamp(0, 1), torch.ones_like(share))

    def evaluate(self, now: TaskState) -> dict[str, torch.Tensor]:
        """See `Task.evaluate`; `progress` is the cube's."""
        q, overloaded = self.pick(now.q), self.tracker.overloaded
        out = ~self.is_inside(now)
        resting = self.rested >= self.asked.rest_steps
        return {
            "success": out & resting & self.touched & ~overloaded,
            "fail": overloaded.clone(),
            "open_fraction": self.tracker.open_fraction(q),
            "progress": self.lifted(now),
            "by_contact": self.touched.clone(),
            "contact_force": self.tracker.force,
            "part_force": now.part_force,
            "link_force": now.link_force,
            "thing_force": self.thing_force,
            "inside": ~out,
            "stage": self.stage.clone(),
        }

    def observe(self, now: TaskState, info: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
        assert now.thing is not None
        return {
            **super().observe(now, info),
            "thing_pose": now.thing,
            "tcp_to_thing": now.thing[:, :3] - now.tool[:, :3],
            "thing_inside": info["inside"].float(),
        }

    def reward_terms(
        self, now: TaskState, info: Mapping[str, torch.Tensor]
    ) -> dict[str, torch.Tensor]:
        """See `RewardConfig` and `CarryReward`."""
        terms, opened = super().reward_terms(now, info), self.opened(now)
        assert now.thing is not None
        ready, out = opened >= 1.0, ~info["inside"]
        distance = (now.thing[:, :3] - now.tool[:, :3]).norm(dim=-1)
        reach = torch.where(
            out & self.touched, torch.ones_like(distance), 1 - torch.tanh(5 * distance)
        )
        held = ((self.thing_force > self.asked.touch_force) | info["success"]).float()
        return {
            **terms,
            "reach": torch.where(ready, reach, terms["reach"]),
            "contact": torch.where(ready, held, terms["contact"]),
            "opened": opened,
        }
