"""DAgger (Ross 2011): the learner acts, and the expert says what it should do where it now is."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mam_envs.planner_state import PlannerState
from mam_pipeline.types import FloatArray
from mam_policies.expert import Expert
from mam_policies.expert.plan import correction
from mam_policies.run import flat


@dataclass(frozen=True, kw_only=True)
class PaceConfig:
    """When a learner counts as being at a row of the expert's plan."""

    lead: int = 3
    """Rows by which the plan is ahead of the arm at most, on the way to the part: as many as when
    the expert acts."""
    ready: float = 0.03
    """Radians that a joint may be off where the hand is to close next."""


class Teacher(Expert):
    """The expert's plan, row by row, at the pace of the learner.

    The plan waits for an arm that comes late, and for a hand that is to hold before it pulls.
    Where a grasp has slipped there is nothing more to say: a learner without memory cannot tell
    the way back from the way to the handle, and would stop between them.
    """

    def __init__(self, env: Any, pace: PaceConfig = PaceConfig()) -> None:
        super().__init__(env, attempts=1)
        self.pace = pace

    def label(self) -> FloatArray:
        """(n + 1,) targets of the arm's joints and of the gripper."""
        return np.append(self.plan.arm[self.at], self.plan.gripper[self.at])

    def follow(self, gripper: float, lost: float) -> bool:
        """Note where the learner has come to; False: there is nothing more to say.

        Args:
            gripper: the command that it gave. lost: radians off the row at which it is given up.
        """
        now = self.env.planner_state()
        off = float(np.abs(now.arm - self.plan.arm[self.at]).max())
        moves = self.plan.phase[self.at] in ("follow", "settle")
        if off > lost or (moves and self._slipped(now)):
            return False
        if self._waits(now, off) or not self._holds(now, gripper):
            return True
        self.at += 1
        return self.at < len(self.plan) or self._go_on(now)

    def _waits(self, now: PlannerState, off: float) -> bool:
        """Whether the arm has still to come after: the label stays."""
        phases = self.plan.phase[self.at : self.at + 2]
        if phases[0] not in ("move", "approach"):
            return False
        far = np.abs(self.plan.arm[: self.at + 1] - now.arm).max(axis=1)
        nearest = self.at - int(np.argmin(far[::-1]))
        late = off > self.pace.ready and phases == ("approach", "close")
        return late or self.at - nearest > self.pace.lead

    def _holds(self, now: PlannerState, gripper: float) -> bool:
        """Whether the learner closes the hand where the plan does."""
        if self.plan.phase[self.at] != "close":
            return True
        robot = now.robot
        return abs(gripper - robot.closed) < abs(gripper - robot.opened)

    def _go_on(self, now: PlannerState) -> bool:
        """At the end of the plan: by what the joint still lacks."""
        if self.corrections >= self.config.corrections:
            return False
        self.corrections += 1
        further = correction(now, self.plan, self.config)
        if further is None:
            return False
        self.plan, self.at = further, 0
        return True


def dagger_steps(
    env: Any, actor: Any, seed: int, lost: float, observe: Callable[[Any], Any] = flat
) -> Iterator[tuple[Any, NDArray[np.float64], bool]]:
    """An episode in which the policy acts and the expert labels.

    The episode ends at success, out of time, `lost` radians off the plan, or where the expert
    would need another plan.

    Yields:
        (what `observe` makes of the observation, (n + 1,) targets of the arm's joints and of the
        gripper, whether the step that the policy then took succeeded).

    Raises:
        PlanningError: the expert finds no plan from this start.
    """
    obs, _ = env.reset(seed=seed)
    teacher = Teacher(env)
    teacher.reset()
    actor.reset()
    while True:
        seen, action = observe(obs), actor.act(obs)
        obs, _, _, truncated, info = env.step(action)
        success = bool(np.asarray(info["success"]).reshape(-1)[0])
        yield seen, teacher.label(), success
        if success or bool(np.asarray(truncated).reshape(-1)[0]):
            return
        gripper = float(np.asarray(action).reshape(-1)[-1])
        if not teacher.follow(gripper, lost):
            return
