"""OperateJointNumpy-v1: one environment as gymnasium itself understands it, without a batch axis.

ManiSkill's environments speak batched tensors, which gymnasium's checker, most of its wrappers and
Stable-Baselines3 do not. This one holds such an environment and gives NumPy observations, a float
reward and plain flags; it is no wrapper, so `unwrapped` stays what the checker should look at.
"""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from mani_skill.utils import common

from mam_envs.env import OperateJointEnv


class SingleEnv(gym.Env[Any, Any]):
    """One OperateJoint environment on the CPU; takes the same arguments (num_envs stays 1).

    Success does not end an episode, unless `end_at_success` is set: every step pays, most of all
    the successful ones, so that an end would be a loss, and the return would fall with success.
    Too much force (`fail`) does end it. `is_success` in info, as Stable-Baselines3 reads it, says
    whether the episode has succeeded up to now.
    """

    metadata: dict[str, Any] = {  # noqa: RUF012 - declared so by gymnasium
        "render_modes": ["rgb_array"], "render_fps": 20,
    }  # fmt: skip

    def __init__(
        self, render_mode: str | None = None, end_at_success: bool = False, **kwargs: Any
    ) -> None:
        self.inner = OperateJointEnv(render_mode=render_mode, num_envs=1, **kwargs)
        self.render_mode, self.end_at_success = render_mode, end_at_success
        self._succeeded = False
        self.observation_space = self.inner.single_observation_space
        self.action_space = self.inner.single_action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """As gymnasium says; the same seed gives the same episode bit for bit."""
        super().reset(seed=seed)
        obs, info = self.inner.reset(seed=seed, options=options)
        self._succeeded = False
        return self._plain(obs), self._plain(info)

    def step(self, action: Any) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """One control step; time limits are gymnasium's."""
        obs, reward, _, _, info = self.inner.step(np.asarray(action))
        now: dict[str, Any] = self._plain(info)
        self._succeeded = self._succeeded or bool(now["success"])
        now["is_success"] = self._succeeded
        done = bool(now.get("fail", False)) or (self.end_at_success and self._succeeded)
        value = float(np.asarray(common.to_numpy(reward)).reshape(-1)[0])
        return self._plain(obs), value, done, False, now

    def render(self) -> Any:
        """The render camera's picture (H, W, 3), uint8."""
        picture = np.asarray(common.to_numpy(self.inner.render()))
        return picture.reshape(picture.shape[-3:])

    def close(self) -> None:
        """Free the simulation; may be called again."""
        self.inner.close()

    @staticmethod
    def _plain(value: Any) -> Any:
        return common.unbatch(common.to_numpy(value))
