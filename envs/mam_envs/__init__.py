"""ManiSkill environments on any asset: gym.make("mam_envs:OperateJoint-v1", asset=DIR, ...).

Importing this package registers the environment; the simulator is loaded by gym.make.
"""

from __future__ import annotations

from typing import Any as _Any

from mam_pipeline.optional import require as _require

_require("a robot environment", "sapien", "mani_skill", "torch", "gymnasium")

import gymnasium as _gym  # noqa: E402

from mam_envs import ids as _ids  # noqa: E402
from mam_envs.ids import MAX_EPISODE_STEPS, register  # noqa: E402

__all__ = ["ENV_ID", "MAX_EPISODE_STEPS", "NUMPY_ID", "VECTOR_ID", "make", "register"]

ENV_ID = "mam_envs:OperateJoint-v1"

VECTOR_ID = "mam_envs:OperateJointVec-v1"
"""For gym.make_vec, which refuses ids with extra wrappers (ManiSkill's batched time limit)."""

NUMPY_ID = "mam_envs:OperateJointNumpy-v1"
"""One environment with NumPy observations and no batch axis, for gymnasium's and SB3's tools."""

if "OperateJoint-v1" not in _gym.registry:
    _ids.bind("OperateJoint-v1", {})
    _gym.register(
        "OperateJointVec-v1",
        vector_entry_point="mam_envs.env:make_vector",
        max_episode_steps=MAX_EPISODE_STEPS,
    )
    _ids.bind_remembered()


def make(asset: _Any, env_id: str = "OperateJoint-v1", **kwargs: _Any) -> _Any:
    """gym.make of one of our environments whose errors say only what the user must know.

    Args:
        asset: asset folder or folders; kwargs as in mam_envs.env.OperateJointEnv, and
            max_episode_steps, which is the task's if it is not given.
    """
    from mam_envs.tasks import episode_steps
    from mam_pipeline.errors import MamSimError

    if env_id == "OperateJoint-v1" and kwargs.get("max_episode_steps") is None:
        kwargs["max_episode_steps"] = episode_steps(
            kwargs.get("task"), kwargs.get("joint"), kwargs.get("robot_uids", "panda")
        )
    try:
        return _gym.make(env_id, asset=asset, **kwargs)
    except MamSimError as error:  # gymnasium appends all arguments to the message
        cause = error.__cause__
        raise (cause if isinstance(cause, MamSimError) else error) from None
