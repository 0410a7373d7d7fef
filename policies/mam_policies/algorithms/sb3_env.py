"""The environment as ppo and sac train in it: plain arrays, an end at success, a helping expert."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import torch

from mam_policies.expert import Expert, PlanningError
from mam_policies.run import EnvChoice, flat


class Prefix(gym.Wrapper):
    """With probability `share`, the expert acts for a random part of its plan after a reset."""

    def __init__(self, env: gym.Env, share: float, seed: int) -> None:
        super().__init__(env)
        self.share = share
        self._rng = np.random.default_rng(seed)

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """Reset, and sometimes go ahead; `helped` says whether."""
        if seed is not None:
            self._rng = np.random.default_rng(seed)
        obs, info = self.env.reset(seed=seed, options=options)
        self.helped = self._rng.random() < self.share
        if self.helped:
            expert = Expert(self.env)
            try:
                expert.reset()
            except PlanningError:
                self.helped = False
                return obs, info
            for _ in range(int(self._rng.uniform(0.1, 0.95) * len(expert.plan))):
                obs, _, _, truncated, after = self.env.step(expert.act())
                if bool(np.asarray(after["success"]).reshape(-1)[0]) or bool(truncated):
                    return self.reset(seed=None, options=options)
        return obs, info

    def set_share(self, share: float) -> None:
        """Change the probability (called from the training process)."""
        self.share = share


class Plain(gym.Wrapper):
    """Batched tensors of ManiSkill as plain NumPy for one environment; success in info.

    An episode ends at success, which then counts as if it lasted for ever: with a dense reward,
    an end without that would cost more than it brings, and waiting just short of it would pay.
    """

    def __init__(self, env: gym.Env, gamma: float) -> None:
        super().__init__(env)
        size = int(np.prod(env.observation_space.shape or (0,)))
        self.observation_space = gym.spaces.Box(-np.inf, np.inf, (size,), np.float32)
        self.gamma = gamma

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """See gymnasium."""
        obs, _ = self.env.reset(seed=seed, options=options or {})
        return flat(obs), {}

    def step(self, action: Any) -> Any:
        """See gymnasium."""
        obs, reward, terminated, truncated, info = self.env.step(action)
        success = bool(np.asarray(info["success"]).reshape(-1)[0])
        helped = bool(getattr(self.env, "helped", False))
        out = {"success": success, "is_success": success, "helped": helped}
        ended = success or bool(np.asarray(terminated).reshape(-1)[0])
        late = bool(np.asarray(truncated).reshape(-1)[0]) and not ended
        value = float(np.asarray(reward).reshape(-1)[0])
        return flat(obs), value / ((1 - self.gamma) if success else 1.0), ended, late, out


def make_training_env(choice: EnvChoice, share: float, seed: int, gamma: float) -> gym.Env:
    """One plain gymnasium environment, as a user's own SB3 code would take it."""
    torch.set_num_threads(1)
    env = Plain(Prefix(choice.make(), share, seed), gamma)
    env.reset(seed=seed)
    return env
