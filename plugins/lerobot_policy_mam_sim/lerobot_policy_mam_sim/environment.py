"""mam-sim's environment for lerobot-eval: --env.type=mam_sim --env.asset=DIR --env.joint=NAME."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import gymnasium as gym
import numpy as np
from lerobot.configs.types import FeatureType, PolicyFeature
from lerobot.envs.configs import EnvConfig
from lerobot.utils.constants import ACTION, OBS_IMAGES, OBS_STATE
from mani_skill.utils.gym_utils import convert_observation_to_space

from mam_envs.tasks import episode_steps
from mam_policies.lerobot.robot_interface import RobotInterface
from mam_policies.run import EnvChoice, task_settings
from mam_policies.task_words import task_words

GYM_ID = "gym_mam_sim/OperateJoint-v1"


@EnvConfig.register_subclass("mam_sim")
@dataclass
class MamSimEnvConfig(EnvConfig):
    """OperateJoint in motor units, observed as in the datasets of mam-sim.

    Attributes:
        asset: folder; joint, task, robot: as in mam-sim. mapping: joint mapping file.
        pictures: observe the cameras, too (needs a Vulkan driver).
        episode_length: control steps; default: the task's.
        picture: width and height of videos; ray-cast where there is no Vulkan driver.
    """

    task: str | None = None
    fps: int = 20
    asset: str = ""
    joint: str | None = None
    robot: str = "panda"
    mapping: str | None = None
    pictures: bool = False
    episode_length: int | None = None
    picture: tuple[int, int] = (96, 72)
    features: dict[str, PolicyFeature] = field(default_factory=dict)
    features_map: dict[str, str] = field(
        default_factory=lambda: {ACTION: ACTION, "agent_pos": OBS_STATE}
    )

    def __post_init__(self) -> None:
        """The sizes of the vectors follow from the robot."""
        from mam_envs.robots import robot_spec

        spec = robot_spec(self.robot)
        movable, action = (j for j in spec.model.joints if j.type != "fixed"), len(spec.arm) + 1
        self.features = {
            ACTION: PolicyFeature(type=FeatureType.ACTION, shape=(action,)),
            "agent_pos": PolicyFeature(type=FeatureType.STATE, shape=(len(list(movable)),)),
        }
        cameras = task_settings(self.task).scene.cameras if self.pictures else {}
        for name, camera in cameras.items():
            shape = (camera.height, camera.width, 3)
            self.features[f"pixels/{name}"] = PolicyFeature(type=FeatureType.VISUAL, shape=shape)
            self.features_map[f"pixels/{name}"] = f"{OBS_IMAGES}.{name}"

    @property
    def gym_id(self) -> str:
        """The id of MamSimGym."""
        return GYM_ID

    @property
    def gym_kwargs(self) -> dict[str, Any]:
        """Arguments of MamSimGym."""
        return {
            "asset": self.asset,
            "joint": self.joint,
            "task": self.task,
            "robot": self.robot,
            "mapping": self.mapping,
            "pictures": self.pictures,
            "max_steps": self.episode_length,
            "picture": tuple(self.picture),
        }


class MamSimGym(gym.Env):
    """Gymnasium environment: motors, what only the simulator knows, and pictures; motor targets.

    The keys are those that lerobot-eval takes: agent_pos, environment_state, pixels.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": 20}  # noqa: RUF012 - gymnasium's way
    render_mode = "rgb_array"

    def __init__(
        self,
        asset: str,
        joint: str | None = None,
        task: str | None = None,
        robot: str = "panda",
        mapping: str | None = None,
        pictures: bool = False,
        max_steps: int | None = None,
        picture: tuple[int, int] = (96, 72),
    ) -> None:
        settings = task_settings(task)
        steps = max_steps or episode_steps(task, joint)
        choice = EnvChoice((asset,), joint, task, robot, max_steps=steps, config=settings)
        more: dict[str, Any] = {"obs_mode": "rgb+state"} if pictures else {}
        self.interface = RobotInterface(choice, mapping, **more)
        self._max_episode_steps = steps
        self._picture = picture
        self._camera: Any = None
        self.task = task_words(self.interface.env.unwrapped)
        self.task_description = self.task
        self.interface.reset(0)
        seen = self._observe(self.interface.state())
        self.observation_space = convert_observation_to_space(seen)
        actions = len(self.interface.action_names)
        self.action_space = gym.spaces.Box(-np.inf, np.inf, (actions,), np.float32)
        self._seed = 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
        """See gymnasium."""
        super().reset(seed=seed)
        self._seed = self._seed + 1 if seed is None else seed
        return self._observe(self.interface.reset(self._seed)), {"is_success": False}

    def step(self, action: Any) -> Any:
        """See gymnasium; an episode ends at success."""
        state = self.interface.step(action)
        now = self.interface.outcome
        info = {"is_success": now.success, "open_fraction": now.open_fraction}
        late = now.truncated and not now.success
        return self._observe(state), now.reward, now.success, late, info

    def render(self) -> Any:
        """(H, W, 3) uint8, ray-cast."""
        if self._camera is None:
            from mam_envs.scene.video import Camera

            self._camera = Camera(self.interface.env, self._picture)
        return self._camera.shoot()

    def _observe(self, state: Any) -> dict[str, Any]:
        seen = {
            "agent_pos": state[: len(self.interface.joints)],
            "environment_state": self.interface.hidden(),
        }
        pictures = self.interface.pictures()
        return {**seen, "pixels": pictures} if pictures else seen

    def close(self) -> None:
        """Free the simulator."""
        self.interface.close()


if GYM_ID not in gym.registry:
    gym.register(
        GYM_ID,
        entry_point="lerobot_policy_mam_sim.environment:MamSimGym",
        order_enforce=False,
    )
