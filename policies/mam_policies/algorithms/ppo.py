"""Proximal policy optimisation (Schulman 2017) by stable-baselines3."""

from __future__ import annotations

from typing import Any

import torch

from mam_policies.algorithms.sb3 import Sb3Algorithm
from mam_policies.settings import PpoConfig


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
