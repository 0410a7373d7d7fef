"""Driving a base on wheels to where it is to stand: turn, go straight on, turn."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mam_envs.placement.drive import in_plane, wrapped
from mam_pipeline.types import FloatArray
from mam_policies.expert.config import ExpertConfig


@dataclass
class Driver:
    """Speeds of a base that can go forwards and backwards and turn, from where it is now.

    Attributes:
        stand: (4, 4) world_T_base where it is to stand.
        period: seconds of a control step.
        leg: what it does now: aim, go, face, or stay once it is there.
    """

    stand: FloatArray
    config: ExpertConfig
    period: float
    leg: str = "aim"
    forwards: float = 0.0
    turning: float = 0.0

    def speeds(self, base: FloatArray) -> tuple[float, float] | None:
        """Speeds forwards (m/s) and of turning (rad/s) at (4, 4) world_T_base; None once it is
        there and stands still."""
        config = self.config
        x, y, yaw = in_plane(base)
        to_x, to_y, to_yaw = in_plane(self.stand)
        off = np.array([to_x - x, to_y - y])
        heading = float(np.arctan2(off[1], off[0]))
        ahead = float(off @ [np.cos(yaw), np.sin(yaw)])
        if self.leg == "aim" and np.linalg.norm(off) < config.drive_near:
            self.leg = "face"
        if self.leg == "aim" and abs(wrapped(heading - yaw)) < config.drive_aim:
            self.leg = "go"
        if self.leg == "go" and ahead < config.drive_near:
            self.leg = "face"
        if self.leg == "face" and abs(wrapped(to_yaw - yaw)) < config.drive_aim:
            self.leg = "stay"
        wanted, turn = 0.0, 0.0
        if self.leg == "aim":
            turn = config.drive_gain * wrapped(heading - yaw)
        elif self.leg == "go":
            wanted = config.drive_gain * ahead
            # near the end the direction of what is left says nothing
            turn = wrapped(heading - yaw) if ahead > 10 * config.drive_near else 0.0
        elif self.leg == "face":
            turn = config.drive_gain * wrapped(to_yaw - yaw)
        self.forwards = _eased(
            self.forwards, wanted, config.drive_speed, config.drive_ease * self.period
        )
        self.turning = _eased(self.turning, turn, config.turn_speed, config.turn_ease * self.period)
        if self.leg == "stay" and self.forwards == self.turning == 0.0:
            return None
        return self.forwards, self.turning


def _eased(now: float, wanted: float, most: float, reach: float) -> float:
    """The next speed: towards the wanted one, of which no more than `most`, in one step's reach."""
    return float(np.clip(np.clip(wanted, -most, most), now - reach, now + reach))
