"""mam-sim's environment for lerobot-eval: --env.type=mam_sim --env.asset=DIR --env.joint=NAME."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import gymnasium as gym
import numpy as np
from lerobot.configs.types import FeatureType, PolicyFeature
from lerobot.envs.configs import EnvConfig
from lerobot.utils.constants import ACTION, OBS_STATE

from mam_policies.lerobot.policy import PERCEIVED
from mam_policies.lerobot.robot_interface import RobotInterface
from mam_policies.run import EnvChoice
from mam_policies.task_words import task_words


@EnvConfig.register_subclass("mam_sim")
@dataclass
class MamSimEnvConfig(EnvConfig):
    """OperateJoint in motor units.

    Attributes:
        asset: folder; joint, robot: as in mam-sim. mapping: joint mapping file.
        picture: width and height of videos; ray-cast where there is no Vulkan driver.
    """

    task: str | None = "OperateJoint-v1"
    fps: int = 20
    asset: str = ""
    joint: str | None = None
    robot: str = "panda"
    mapping: str | None = None
    episode_length: int = 200
    picture: tuple[int, int] = (96, 72)
    features: dict[str, PolicyFeature] = field(default_factory=dict)
    features_map: dict[str, str] = field(
        default_factory=lambda: {ACTION: ACTION, "agent_pos": OBS_STATE}
    )

    def __post_init__(self) -> None:
        """The sizes of the vectors follow from the robot."""
        from mam_envs.robots import robot_spec

        spec = robot_spec(self.robot)
        movable = [j for j in spec.model.joints if j.type != "fixed"]
        state, action = len(movable) + len(PERCEIVED), len(spec.arm) + 1
        self.features = {
            ACTION: PolicyFeature(type=FeatureType.ACTION, shape=(action,)),
            "agent_pos": PolicyFeature(type=FeatureType.STATE, shape=(state,)),
        }

    @property
    def gym_kwargs(self) -> dict[str, Any]:
        """Arguments of MamSimGym."""
        return {
            "asset": self.asset,
            "joint": self.joint,
            "robot": self.robot,
            "mapping": self.mapping,
            "max_steps": self.episode_length,
            "picture": tuple(self.picture),
        }


class MamSimGym(gym.Env):
    """Gymnasium environment: observation {"agent_pos": state}, action motor targets."""

    metadata = {"render_modes": ["rgb_array"], "render_fps": 20}  # noqa: RUF012 - gymnasium's way
    render_mode = "rgb_array"

    def __init__(
        self,
        asset: str,
        joint: str | None = None,
        robot: str = "panda",
        mapping: str | None = None,
        max_steps: int = 200,
        picture: tuple[int, int] = (96, 72),
    ) -> None:
        choice = EnvChoice((asset,), joint, robot=robot, max_steps=max_steps)
        self.interface = RobotInterface(choice, mapping)
        self._max_episode_steps = max_steps
        self._picture = picture
        self._camera: Any = None
        self.task = task_words(self.interface.env.unwrapped)
        self.task_description = self.task
        size, actions = len(self.interface.state_names), len(self.interface.action_names)
        box = gym.spaces.Box(-np.inf, np.inf, (size,), np.float32)
        self.observation_space = gym.spaces.Dict({"agent_pos": box})
        self.action_space = gym.spaces.Box(-np.inf, np.inf, (actions,), np.float32)
        self._seed = 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """See gymnasium."""
        super().reset(seed=seed)
        self._seed = self._seed + 1 if seed is None else seed
        return {"agent_pos": self.interface.reset(self._seed)}, {"is_success": False}

    def step(self, action: Any) -> Any:
        """See gymnasium; an episode ends at success."""
        state = self.interface.step(action)
        now = self.interface.outcome
        info = {"is_success": now.success, "open_fraction": now.open_fraction}
        late = now.truncated and not now.success
        return {"agent_pos": state}, now.reward, now.success, late, info

    def render(self) -> Any:
        """(H, W, 3) uint8, ray-cast."""
        if self._camera is None:
            from mam_envs.scene.video import Camera

            self._camera = Camera(self.interface.env, self._picture)
        return self._camera.shoot()

    def close(self) -> None:
        """Free the simulator."""
        self.interface.close()


if "gym_mam_sim/OperateJoint-v1" not in gym.registry:
    gym.register(
        "gym_mam_sim/OperateJoint-v1",
        entry_point="lerobot_policy_mam_sim.environment:MamSimGym",
        order_enforce=False,
    )
