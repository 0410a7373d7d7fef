"""The batched time limit of an environment, which can be made again from its spec."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import torch


class BatchedTimeLimit(gym.Wrapper[Any, Any, Any, Any], gym.utils.RecordConstructorArgs):
    """ManiSkill's TimeLimitWrapper, except that it records its arguments, as gymnasium asks.

    The time limit that gym.make puts below it, which knows no batch, gives its number and goes.
    """

    def __init__(self, env: gym.Env[Any, Any], max_episode_steps: int) -> None:
        if isinstance(env, gym.wrappers.TimeLimit):  # with the number of gym.make's caller
            max_episode_steps, env = env._max_episode_steps, env.env
        gym.utils.RecordConstructorArgs.__init__(self, max_episode_steps=max_episode_steps)
        super().__init__(env)
        self._max_episode_steps = max_episode_steps

    def step(self, action: Any) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """One step; `truncated` is a tensor with one flag for each sub-environment."""
        obs, reward, terminated, _, info = self.env.step(action)
        passed: torch.Tensor = self.get_wrapper_attr("elapsed_steps")
        return obs, reward, terminated, passed >= self._max_episode_steps, info
