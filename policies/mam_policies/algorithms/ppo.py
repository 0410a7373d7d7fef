"""Proximal policy optimisation (Schulman 2017) by stable-baselines3."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch

from mam_policies.algorithms import check_least
from mam_policies.algorithms.sb3 import Sb3Algorithm, Sb3Config


@dataclass(frozen=True, kw_only=True)
class PpoConfig(Sb3Config):
    """Settings of ppo."""

    rollout: int = 2048
    """Environment steps between two updates, of all processes together."""
    update_epochs: int = 6
    """Passes over a rollout."""
    learning_rate: float = 3e-4
    """Of Adam, from scratch."""
    cloned_learning_rate: float = 1e-4
    """Of Adam, after a clone."""
    log_std: float = -0.7
    """Logarithm of the exploration noise (normalised actions) at the start, from scratch."""
    cloned_log_std: float = -2.0
    """The same, after a clone."""
    clip_range: float = 0.15
    """By how much an update may change an action's probability, as a share."""
    target_kl: float = 0.03
    """Divergence from the old policy at which an update ends."""
    entropy: float = 0.0
    """Weight of the entropy bonus."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_least(self, rollout=8, update_epochs=1)


class Ppo(Sb3Algorithm):
    """ppo: learns from the environment's reward, on policy."""

    name = "ppo"
    Config = PpoConfig
    squash = "clip"

    def claimed(self, config: PpoConfig) -> str:
        """Settings that a run which goes on cannot change."""
        return f"{super().claimed(config)} rollout {config.rollout}"

    def model(
        self,
        config: PpoConfig,
        venv: Any,
        cloned: bool,
        policy: dict[str, Any],
        common: dict[str, Any],
    ) -> Any:
        """See Sb3Algorithm."""
        from stable_baselines3 import PPO

        noise = config.cloned_log_std if cloned else config.log_std
        return PPO(
            "MlpPolicy",
            venv,
            n_steps=max(config.rollout // config.processes, 8),
            n_epochs=config.update_epochs,
            learning_rate=config.cloned_learning_rate if cloned else config.learning_rate,
            ent_coef=config.entropy,
            clip_range=config.clip_range,
            target_kl=config.target_kl,
            policy_kwargs={**policy, "log_std_init": noise},
            **common,
        )

    def layers(self, policy: Any) -> tuple[torch.nn.Module, torch.nn.Module, torch.nn.Module]:
        """See Sb3Algorithm."""
        hidden = policy.mlp_extractor.policy_net
        return policy.pi_features_extractor, hidden, policy.action_net
