"""What a task is: goals for the joints of an asset, and success, reward and observations of them.

The environment (mam_envs.env) loads assets, places the robot and steps the simulator; the task
says what is asked. It sees the simulator through `TaskState` only, so it can be tested without.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import torch

from mam_envs.config import EnvConfig, SuccessConfig
from mam_envs.object_model import ObjectModel
from mam_envs.tasks.thing import Thing
from mam_pipeline.errors import NotPhysicalError


class OtherTaskError(NotPhysicalError):
    """The task is not for this kind of joint."""


@dataclass(frozen=True)
class JointGoal:
    """One joint to be moved, in the model's units (radians or metres, after scaling).

    Attributes:
        joint: its name in the URDF. task: the task's name. subtype: hinge | spin | slide.
        q_start: where the episode starts (before randomisation); q_goal: where success begins.
        tolerance: 0 for "at least this far", else how near to q_goal is near enough.
        closed, open: the joint's range in the sense of the task (a wide hinge is cut).
        lower, upper: the joint's limits, infinite for continuous joints.
        still_speed: greatest speed at success, metres or radians per second.
        closing: whether pushing the part back into the object is a way to do it.
        spring: newtons (newton metres) with which a spring pushes the joint from q_goal back to
            `closed`; 0 is none. See `Task.spring_targets`.
        let_go: whether success asks that the hand leaves the part in the end.
        thing: what is taken out of the part, or put in; None for tasks on the joint alone.
    """

    joint: str
    task: str
    subtype: str
    q_start: float
    q_goal: float
    tolerance: float
    closed: float
    open: float
    lower: float
    upper: float
    still_speed: float
    closing: bool = False
    spring: float = 0.0
    let_go: bool = False
    thing: Thing | None = None

    @property
    def range(self) -> float:
        """Size of the task's range, radians or metres."""
        return abs(self.open - self.closed)

    @property
    def reached_into(self) -> float:
        """The joint's value at which the hand goes into the part: it is open then."""
        return self.q_start if self.closing else self.q_goal

    @property
    def direction(self) -> float:
        """1 or -1: the sign of the joint's motion towards the goal."""
        return float(np.sign(self.q_goal - self.q_start))


@dataclass(frozen=True)
class TaskState:
    """What a task sees of b sub-scenes at a moment.

    Attributes:
        q, speed: (b, stages) value and velocity of every joint of the sequence, radians or metres
            (per second); a task on one joint has one stage.
        force: (b,) newtons between the robot and the part of the present stage, the most of the
            last control step.
        part_force: (b,) newtons of the robot on that part, friction included, as one vector (what
            fingers squeeze between them cancels out), mean over the last control step.
        link_force: (b,) newtons of contact, without friction, on the robot's link that presses
            hardest on anything, mean over the last control step.
        handle: (b, stages, 3) point to grasp, world.
        tool: (b, 7) tool frame in the world: position, quaternion (w, x, y, z).
        action_rate: (b,) mean squared change of the action since the last control step.
        thing: (b, 7) pose of the loose thing in the world, where the task has one; inside: (b, 3)
            its middle in the asset's frame, as the part carries it with its joint at 0.
        thing_speed: (b,) metres per second. thing_force: (b,) newtons of the robot on it, squeeze
            included, the most of the last control step.
    """

    q: torch.Tensor
    speed: torch.Tensor
    force: torch.Tensor
    part_force: torch.Tensor
    link_force: torch.Tensor
    handle: torch.Tensor
    tool: torch.Tensor
    action_rate: torch.Tensor
    thing: torch.Tensor | None = None
    inside: torch.Tensor | None = None
    thing_speed: torch.Tensor | None = None
    thing_force: torch.Tensor | None = None


class Task(ABC):
    """What is asked of the robot in b sub-scenes; one instance lives as long as the built scene.

    The environment calls, in this order: `defaults` and `goal` before anything is built, the
    constructor with the scene, `reset` when episodes begin, `update` after every control step,
    `evaluate`, and `observe` and `reward_terms` with what `evaluate` returned.

    Attributes:
        steps: control steps in which an episode is to end, for each joint of a sequence.
        goals: per sub-scene, one `JointGoal` per stage.
        config: the environment's settings, of the types that `defaults` returns.
        stage: (b,) index of the joint that is to be moved now; 0 for tasks on one joint.
    """

    steps: ClassVar[int] = 200

    def __init__(
        self, goals: Sequence[Sequence[JointGoal]], config: EnvConfig, device: torch.device
    ) -> None:
        self.goals, self.config, self.device = goals, config, device
        self.stage = torch.zeros(len(goals), dtype=torch.long, device=device)

    @classmethod
    def defaults(cls) -> EnvConfig:
        """The settings of an environment with this task; a task may extend success and reward."""
        return EnvConfig()

    @classmethod
    @abstractmethod
    def goal(
        cls, name: str | None, model: ObjectModel, joint: str | None, config: SuccessConfig
    ) -> JointGoal:
        """Say in numbers what is asked of one joint of an asset.

        Args:
            name: under which the task was asked for; None leaves the choice to the task.
            joint: its name; None leaves the choice to the task.

        Raises:
            ConfigError: unknown joint.
            NotPhysicalError: the joint cannot do it; OtherTaskError where the task is not for its
                kind.
        """

    @classmethod
    def start(cls, goal: JointGoal, share: float | None) -> float:
        """The joint value at which an episode begins.

        Args:
            share: drawn share of the way open (randomisation.start), or None for the goal's own.
        """
        return goal.q_start if share is None else goal.closed + share * (goal.open - goal.closed)

    @abstractmethod
    def reset(self, env_idx: torch.Tensor, q: torch.Tensor) -> None:
        """Begin the episodes of sub-scenes `env_idx` (k,) at joint values `q` (k, stages)."""

    def teleported(self, q: torch.Tensor) -> None:
        """Take note that joints were put to `q` (b, stages) from outside: that is no motion."""
        return None

    @abstractmethod
    def update(self, now: TaskState) -> None:
        """Remember what a control step did."""

    def spring_targets(self) -> torch.Tensor | None:
        """(b, stages) joint values to which the springs of `JointGoal.spring` push, after
        `reset` and after every `update`; None where there are none."""
        return None

    @abstractmethod
    def evaluate(self, now: TaskState) -> dict[str, torch.Tensor]:
        """Success and what it depends on, (b,) each.

        `success` (bool), `progress` (0 at the start, 1 at success), `open_fraction` and
        `by_contact` (bool: it was the robot that moved the joint) are expected by the expert and
        the trainers; `fail` (bool) ends an episode; more is logged under its name.
        """

    def observe(self, now: TaskState, info: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
        """Privileged observations, (b,) or (b, n) each: what only a simulator knows."""
        return {}

    @abstractmethod
    def reward_terms(
        self, now: TaskState, info: Mapping[str, torch.Tensor]
    ) -> dict[str, torch.Tensor]:
        """Unscaled terms of the dense reward, (b,) each, named as their scales in config.reward."""

    def pick(self, values: torch.Tensor) -> torch.Tensor:
        """(b,) or (b, n) of (b, stages) or (b, stages, n): each sub-scene's present stage."""
        if values.shape[1] == 1:
            return values[:, 0].clone()  # a task's memory changes in place
        if values.ndim == 2:
            return values.gather(1, self.stage[:, None])[:, 0]
        index = self.stage[:, None, None].expand(-1, 1, values.shape[2])
        return values.gather(1, index)[:, 0]
