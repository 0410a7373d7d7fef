"""Configuration of the policy type `mam_sim`: network sizes, units, geometry; plain numbers."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from lerobot.configs.policies import PreTrainedConfig
from lerobot.configs.types import NormalizationMode
from lerobot.optim.optimizers import AdamConfig

from mam_policies.lerobot.policy import Deployment


@PreTrainedConfig.register_subclass("mam_sim")
@dataclass
class MamSimConfig(PreTrainedConfig):
    """A trained policy of mam-sim.

    Attributes:
        sizes: of the network. plan: from motor values to its inputs and back.
        state_names, action_names: entries of observation.state and action, in order.
        fixed: values for perceived entries (handle_x.pos ...) where the robot reports motors only.
    """

    sizes: dict[str, Any] = field(default_factory=dict)
    plan: Deployment = field(default_factory=Deployment)
    state_names: list[str] = field(default_factory=list)
    action_names: list[str] = field(default_factory=list)
    fixed: dict[str, float] = field(default_factory=dict)
    normalization_mapping: dict[str, NormalizationMode] = field(
        default_factory=lambda: {
            "STATE": NormalizationMode.IDENTITY,
            "ACTION": NormalizationMode.IDENTITY,
        }
    )

    def get_optimizer_preset(self) -> AdamConfig:
        """Adam; used by nothing here, but LeRobot asks."""
        return AdamConfig(lr=1e-3)

    def get_scheduler_preset(self) -> None:
        """None: no schedule."""

    def validate_features(self) -> None:
        """Raises ValueError if there is no observation.state."""
        if self.robot_state_feature is None:
            raise ValueError("a mam_sim policy needs observation.state")

    @property
    def observation_delta_indices(self) -> None:
        """The present observation only."""

    @property
    def action_delta_indices(self) -> list[int]:
        """One chunk."""
        return list(range(int(self.sizes.get("chunk", 1))))

    @property
    def reward_delta_indices(self) -> None:
        """No rewards."""
