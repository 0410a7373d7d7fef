"""Soft actor-critic (Haarnoja 2018) by stable-baselines3."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch

from mam_policies.algorithms import check_least
from mam_policies.algorithms.sb3 import Sb3Algorithm, Sb3Config


@dataclass(frozen=True, kw_only=True)
class SacConfig(Sb3Config):
    """Settings of sac."""

    learning_rate: float = 3e-4
    """Of Adam."""
    buffer: int = 200_000
    """Environment steps that are remembered at most."""
    learning_starts: int = 2000
    """Environment steps before the first update, at most a quarter of all."""
    train_every: int = 4
    """Environment steps between two updates."""
    gradient_steps: int = 2
    """Gradient steps of one update."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_least(self, buffer=1, train_every=1, gradient_steps=1)


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
