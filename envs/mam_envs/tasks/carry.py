"""Take a loose thing out of a drawer, or put it in and close the drawer."""

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


@dataclass(frozen=True)
class PutReward(RewardConfig):
    """Scales of the terms that `close` has, and of one more. `reach` and `contact` are of the cube
    until it is in the drawer, then of the handle; `progress` is half the cube's, half the drawer's.

    Attributes:
        carried: 1 - tanh(5 d), d metres from the cube to the middle of the drawer's inside; or 1.
    """

    carried: Finite = 1.0


class Carry(OperateJoint):
    """What tasks on a drawer and a cube have in common; `named` says which of the joint's tasks
    the drawer has.

    Randomizations: of the environment, and where the cube lies and how it is turned.
    """

    named = "open"

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
    def goal(
        cls, name: str | None, model: ObjectModel, joint: str | None, config: SuccessConfig
    ) -> JointGoal:
        """See `Task.goal`; refuses what is no drawer, and one in which the cube has no room."""
        assert isinstance(config, CarrySuccess)
        found = super().goal(cls.named, model, joint, config)
        what = f"joint {found.joint!r} of {model.asset.card.name}"
        if found.subtype != "slide":
            raise OtherTaskError(f"{what} is no drawer, which slides; take another joint or task")
        start = found.closed + config.start * (found.open - found.closed)
        wide = start if found.closing else found.q_goal
        least = found.q_goal
        if not found.closing:
            least = min(start, wide, key=lambda q: abs(q - found.closed))
        thing = free_space(model, found.joint, wide, config.size, config.mass, least)
        if thing is None:
            link = model.card_joint(found.joint).child
            kind = next((p.kind for p in model.asset.card.parts if p.link == link), "")
            refusal = NotPhysicalError if kind == "drawer" else OtherTaskError
            raise refusal(
                f"{what} has no free space inside for a cube of {100 * config.size:.1f} cm that "
                "can be lifted out; make success.size smaller, or take another joint"
            )
        return replace(found, task=str(name), q_start=start, thing=thing, let_go=found.closing)

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

    def is_inside(self, now: TaskState) -> torch.Tensor:
        """(b,) whether the cube's middle is in the box that the drawer encloses."""
        assert now.inside is not None
        return ((now.inside >= self.low) & (now.inside <= self.high)).all(dim=-1)

    def laid(self) -> torch.Tensor:
        """(b,) whether the cube, which the robot has touched, is at rest."""
        return (self.rested >= self.asked.rest_steps) & self.touched

    def facts(
        self, now: TaskState, success: torch.Tensor, progress: torch.Tensor
    ) -> dict[str, torch.Tensor]:
        """What `evaluate` says, (b,) each."""
        return {
            "success": success & ~self.tracker.overloaded,
            "fail": self.tracker.overloaded.clone(),
            "open_fraction": self.tracker.open_fraction(self.pick(now.q)),
            "progress": progress,
            "by_contact": self.touched.clone(),
            "contact_force": self.tracker.force,
            "part_force": now.part_force,
            "link_force": now.link_force,
            "thing_force": self.thing_force,
            "inside": self.is_inside(now),
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

    def nearness(self, now: TaskState) -> torch.Tensor:
        """(b,) 1 - tanh(5 d) of the tool's distance d from the cube, metres."""
        assert now.thing is not None
        return 1 - torch.tanh(5 * (now.thing[:, :3] - now.tool[:, :3]).norm(dim=-1))

    def held(self, info: Mapping[str, torch.Tensor]) -> torch.Tensor:
        """(b,) 1 where the robot touches the cube, or is done."""
        return ((self.thing_force > self.asked.touch_force) | info["success"]).float()


class TakeOut(Carry):
    """Take a cube out of a drawer, which is opened first where it is not open.

    Success: the cube's middle has left the box that the drawer encloses, and the cube is at rest,
    in the hand or on whatever it was put, for `rest_steps`; the robot has touched it. Forces on the
    drawer above the limits end the episode as failed.
    """

    @classmethod
    def defaults(cls) -> EnvConfig:
        """With a cube, and a drawer that begins open."""
        return EnvConfig(success=CarrySuccess(), reward=CarryReward())

    def opened(self, now: TaskState) -> torch.Tensor:
        """(b,) share of the way to where the drawer counts as open, 0..1."""
        q, closed = self.pick(now.q), self.tracker.now("closed")
        return ((q - closed) / (self.tracker.now("q_goal") - closed)).clamp(0, 1)

    def lifted(self, now: TaskState) -> torch.Tensor:
        """(b,) share of the way from the drawer's floor to the end of its walls, 0..1."""
        assert now.inside is not None
        floor = self.low[:, 2] + 0.5 * self.asked.size
        share = (now.inside[:, 2] - floor) / (self.high[:, 2] - floor).clamp(min=1e-3)
        return torch.where(self.is_inside(now), share.clamp(0, 1), torch.ones_like(share))

    def evaluate(self, now: TaskState) -> dict[str, torch.Tensor]:
        """See `Task.evaluate`; `progress` is the cube's."""
        return self.facts(now, ~self.is_inside(now) & self.laid(), self.lifted(now))

    def reward_terms(
        self, now: TaskState, info: Mapping[str, torch.Tensor]
    ) -> dict[str, torch.Tensor]:
        """See `RewardConfig` and `CarryReward`."""
        terms, opened = super().reward_terms(now, info), self.opened(now)
        ready, reach = opened >= 1.0, self.nearness(now)
        reach = torch.where(~info["inside"] & self.touched, torch.ones_like(reach), reach)
        return {
            **terms,
            "reach": torch.where(ready, reach, terms["reach"]),
            "contact": torch.where(ready, self.held(info), terms["contact"]),
            "opened": opened,
        }


class PutIn(Carry):
    """Take a cube from the ground beside the robot, put it into an open drawer, and close that.

    Success: the drawer is closed as the task `close` asks for it, and the cube, which the robot has
    touched, is at rest in it for `rest_steps`. Forces on the drawer above the limits end the
    episode as failed.
    """

    named = "close"
    steps = 400

    @classmethod
    def defaults(cls) -> EnvConfig:
        """With a cube, a drawer that begins open."""
        return EnvConfig(success=CarrySuccess(), reward=PutReward())

    def carried(self, now: TaskState) -> torch.Tensor:
        """(b,) how near the cube is to the middle of the drawer's inside; 1 in it."""
        assert now.inside is not None
        away = (now.inside - 0.5 * (self.low + self.high)).norm(dim=-1)
        near = 1 - torch.tanh(5 * away)
        return torch.where(self.is_inside(now), torch.ones_like(near), near)

    def evaluate(self, now: TaskState) -> dict[str, torch.Tensor]:
        """See `Task.evaluate`; `progress` is half the cube's, half the drawer's that has it."""
        closed, _ = self.finished(now)
        inside = self.is_inside(now)
        closing = torch.where(inside, self.tracker.progress(self.pick(now.q)), 0.0)
        progress = 0.5 * self.carried(now) * self.touched + 0.5 * closing
        return self.facts(now, closed & inside & self.laid(), progress)

    def reward_terms(
        self, now: TaskState, info: Mapping[str, torch.Tensor]
    ) -> dict[str, torch.Tensor]:
        """See `RewardConfig` and `PutReward`."""
        terms, inside = super().reward_terms(now, info), info["inside"]
        return {
            **terms,
            "reach": torch.where(inside, terms["reach"], self.nearness(now)),
            "contact": torch.where(inside, terms["contact"], self.held(info)),
            "carried": self.carried(now),
        }
