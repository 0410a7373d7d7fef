"""Success of an episode: how far each joint is, who moved it, and whether that is enough."""

from __future__ import annotations

from collections.abc import Sequence

import torch

from mam_envs.config import SuccessConfig
from mam_envs.tasks.base import JointGoal

_CONSTANTS = ("q_start", "q_goal", "tolerance", "closed", "open", "still_speed")


class SuccessTracker:
    """Goals (b, stages) and memory (b,) of the episodes in b sub-scenes.

    A stage is one joint of a sequence; tasks on a single joint have one. Joint values and speeds
    that the methods take are those of the present stage's joint, (b,), radians or metres.

    Attributes:
        stage: (b,) index of the joint that is to be moved now.
        force: (b,) newtons between robot and moving part, the most of the last control step.
        untouched: (b,) share of the range that moved without contact in the last control step.
        overloaded: (b,) whether a force was ever above its limit in this episode.
    """

    def __init__(
        self, goals: Sequence[Sequence[JointGoal]], config: SuccessConfig, device: torch.device
    ) -> None:
        """`goals`: per sub-scene, one per stage."""
        self._config = config
        self._goal = {
            key: torch.tensor(
                [[float(getattr(g, key)) for g in row] for row in goals], device=device
            )
            for key in _CONSTANTS
        }
        n = len(goals)
        zero = torch.zeros(n, device=device)
        self.stages = len(goals[0])
        self.stage = torch.zeros(n, dtype=torch.long, device=device)
        self._begin = self._goal["q_start"].clone()
        self._last, self._driven, self._moved = zero.clone(), zero.clone(), zero.clone()
        self.untouched, self.force = zero.clone(), zero.clone()
        self._since_touch = torch.full_like(zero, 1e6)
        self.overloaded = torch.zeros(n, dtype=torch.bool, device=device)

    # -- goals -----------------------------------------------------------------------------
    def pick(self, values: torch.Tensor) -> torch.Tensor:
        """(b,) of (b, stages): each sub-scene's present stage."""
        if self.stages == 1:
            return values[:, 0].clone()
        return values.gather(1, self.stage[:, None])[:, 0]

    def now(self, key: str) -> torch.Tensor:
        """(b,) a goal constant of each sub-scene's present stage."""
        return self.pick(self._goal[key])

    def open_fraction(self, q: torch.Tensor) -> torch.Tensor:
        """(b,) 0 closed, 1 open."""
        closed = self.now("closed")
        return (q - closed) / (self.now("open") - closed)

    def progress(self, q: torch.Tensor) -> torch.Tensor:
        """(b,) 0 where the stage began, 1 where success begins."""
        begin = self.pick(self._begin)
        return (q - begin) / (self.now("q_goal") - begin)

    @property
    def touching(self) -> torch.Tensor:
        """(b,) whether the robot touched the moving part in the last control step."""
        return self.force > self._config.touch_force

    @property
    def by_contact(self) -> torch.Tensor:
        """(b,) whether enough of the motion of this stage happened by contact."""
        share = self._driven / self._moved.clamp(min=1e-9)
        return (share >= self._config.driven) & (self._moved > 0)

    # -- memory ----------------------------------------------------------------------------
    def reset(self, env_idx: torch.Tensor, begin: torch.Tensor) -> None:
        """Start some episodes anew; `begin` (k, stages): the joints' values there."""
        self.stage[env_idx] = 0
        for memory in (self._driven, self._moved, self.untouched, self.force):
            memory[env_idx] = 0.0
        self._since_touch[env_idx] = 1e6
        self.overloaded[env_idx] = False
        self._begin[env_idx] = begin
        self._last[env_idx] = begin[:, 0]

    def teleported(self, q: torch.Tensor) -> None:
        """Take note that the joint was put elsewhere, which is no motion."""
        self._last = q.clone()

    def load(self, part: torch.Tensor, link: torch.Tensor) -> None:
        """Hold a control step's forces (b,), newtons, against their limits."""
        for force, limit in ((part, self._config.part_force), (link, self._config.link_force)):
            if limit is not None:
                self.overloaded = self.overloaded | (force > limit)

    def update(self, q: torch.Tensor, force: torch.Tensor) -> None:
        """Credit a control step's motion to the robot if it touches, or has just touched."""
        self.force = force
        self._since_touch = torch.where(
            self.touching, torch.zeros_like(self._since_touch), self._since_touch + 1
        )
        step = (q - self._last).abs()
        recent = self._since_touch <= self._config.grace_steps
        self._driven = self._driven + step * recent
        self._moved = self._moved + step
        width = (self.now("open") - self.now("closed")).abs()
        self.untouched = step * (~recent) / width
        self._last = q

    # -- success ---------------------------------------------------------------------------
    def evaluate(self, q: torch.Tensor, speed: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """(b,) success, and whether a joint before the last one of a sequence is done."""
        tolerance = self.now("tolerance")
        near = (q - self.now("q_goal")).abs() <= tolerance
        reached = torch.where(tolerance > 0, near, self.progress(q) >= 1.0)
        still = speed.abs() <= self.now("still_speed")
        done = reached & still & self.by_contact & ~self.overloaded
        last = self.stage >= self.stages - 1
        return done & last, done & ~last

    def advance(self, move: torch.Tensor, values: torch.Tensor) -> None:
        """Go on to the next joint where `move` (b,); `values` (b, stages): all joints now."""
        self.stage = self.stage + move.long()
        keep = ~move
        self._driven, self._moved = self._driven * keep, self._moved * keep
        self._last = self.pick(values).clone()
        begin = self._begin.clone()
        begin.scatter_(1, self.stage[:, None], self._last[:, None])
        self._begin = torch.where(move[:, None], begin, self._begin)
