"""Limits that every target passes before it goes to a motor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from mam_envs.robots import RobotSpec
from mam_envs.scene.layout import Layout
from mam_pipeline.edited import Range
from mam_pipeline.errors import MamSimError
from mam_pipeline.types import FloatArray


class StoppedForSafety(MamSimError):
    """A limit was passed and the arm was stopped; the message says which."""

    exit_code = 1


@dataclass(frozen=True, kw_only=True)
class SafetyConfig:
    """When the arm is slowed down or stopped."""

    margin: Annotated[float, Range(0, 1)] = 0.12
    """Metres round the hand's planned way that the hand may be in; a step out is held back."""
    speed: Annotated[float, Range(0, 10, above=True)] = 1.5
    """Times the robot's usual motion per control step that a joint may move; more is cut."""
    lag: Annotated[float, Range(0, 3, above=True)] = 0.35
    """Radians that a joint may stay behind its target; more means that the arm presses on
    something."""
    patience: Annotated[int, Range(1, 1000)] = 10
    """Control steps in a row outside a limit after which the arm is stopped."""


class Guard:
    """Holds targets of one episode against the limits; frames and units of the simulated robot."""

    def __init__(self, layout: Layout, config: SafetyConfig) -> None:
        """`layout`: of the twin; the hand's way in it is what is expected."""
        self.spec: RobotSpec = layout.robot
        self.config = config
        path = layout.placement.path
        arm = np.concatenate([self.spec.rest_arm[None], path.approach, path.follow])
        _, position, _ = self.spec.chain.forward(arm)
        self.box = np.stack([position.min(axis=0), position.max(axis=0)])
        self.box += np.array([[-1.0], [1.0]]) * config.margin
        self.reset()

    def reset(self) -> None:
        """Forget the episode."""
        self.last: FloatArray | None = None
        self.outside = self.behind = self.cut = 0

    def pass_on(self, target: FloatArray, arm: FloatArray) -> FloatArray:
        """Arm targets (n,) that may be sent, for wanted ones and the joints as they are (n,).

        Raises:
            StoppedForSafety: outside the workspace, or behind the targets, for too long.
        """
        config, before = self.config, arm if self.last is None else self.last
        lagging = self.last is not None and float(np.abs(self.last - arm).max()) > config.lag
        self.behind = self.behind + 1 if lagging else 0
        if self.behind >= config.patience:
            raise StoppedForSafety(
                "the arm does not follow its targets: it presses on something; it was stopped"
            )
        limit = config.speed * self.spec.step
        out = before + np.clip(target - before, -limit, limit)
        self.cut += bool(np.abs(target - before).max() > limit + 1e-9)
        _, position, _ = self.spec.chain.forward(np.stack([before, out]))
        away = np.maximum(self.box[0] - position, position - self.box[1]).max(axis=1)
        leaving = away[1] > 0 and away[1] > away[0] - 1e-9  # coming back is allowed
        self.outside = self.outside + 1 if leaving else 0
        if self.outside >= config.patience:
            raise StoppedForSafety(
                f"the hand would leave its workspace at {np.round(position[1], 2).tolist()} m; it "
                "was stopped"
            )
        self.last = before if leaving else out
        return np.asarray(self.last)
