"""Soft actor-critic (Haarnoja 2018) by stable-baselines3."""

from __future__ import annotations

from typing import Any

import torch

from mam_policies.algorithms.sb3 import Sb3Algorithm
from mam_policies.settings import SacConfig


class Sac(Sb3Algorithm):
    """sac: learns from the environment's reward, off policy."""

    name = "sac"
    Config = SacConfig
    squash = "tanh"

    def model(
        self,
        config: SacConfig,
        venv: Any,
        cloned: bool,
        policy: dict[str, Any],
        common: dict[str, Any],
    ) -> Any:
        """See Sb3Algorithm."""
        from stable_baselines3 import SAC

        return SAC(
            "MlpPolicy",
            venv,
            learning_rate=config.learning_rate,
            buffer_size=min(config.steps, config.buffer),
            learning_starts=min(config.learning_starts, config.steps // 4),
            train_freq=config.train_every,
            gradient_steps=config.gradient_steps,
            policy_kwargs=policy,
            **common,
        )

    def layers(self, policy: Any) -> tuple[torch.nn.Module, torch.nn.Module, torch.nn.Module]:
        """See Sb3Algorithm."""
        actor = policy.actor
        return actor.features_extractor, actor.latent_pi, actor.mu
