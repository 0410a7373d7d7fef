"""Dense reward as named terms times configured scales; the terms are logged under their names."""

from __future__ import annotations

from dataclasses import dataclass, fields

import torch

from mam_envs.config import RewardConfig


@dataclass(frozen=True)
class RewardTerms:
    """Unscaled terms, each (b,).

    Attributes:
        reach: 1 at the handle, falling with the tool's distance (1 - tanh(5 d)); 1 once the joint
            has moved by contact, so that letting go costs nothing.
        contact: 1 while the robot touches the moving part.
        progress: share of the way from start to goal, 0..1 (negative when moved away).
        success: 1 at success.
        untouched_motion: share of the range that moved without contact in this step.
        action_rate: mean squared change of the action since the last step.
    """

    reach: torch.Tensor
    contact: torch.Tensor
    progress: torch.Tensor
    success: torch.Tensor
    untouched_motion: torch.Tensor
    action_rate: torch.Tensor

    def scaled(self, scales: RewardConfig) -> dict[str, torch.Tensor]:
        """Terms times scales under their names."""
        return {
            f.name: getattr(self, f.name) * float(getattr(scales, f.name)) for f in fields(self)
        }


def largest(scales: RewardConfig) -> float:
    """What one step can bring at most: the sum of the positive scales (1 if there are none)."""
    best = sum(max(0.0, float(getattr(scales, f.name))) for f in fields(scales))
    return best if best > 0 else 1.0
