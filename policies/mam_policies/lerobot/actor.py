"""A LeRobot policy folder acting in our environment, through LeRobot's own pipelines."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from mam_pipeline.errors import InputError
from mam_pipeline.optional import require
from mam_policies.lerobot.dataset import IMAGES
from mam_policies.lerobot.joint_mapping import JointMapping
from mam_policies.run import flat
from mam_policies.task_words import task_words


class LeRobotActor:
    """One policy in one environment; see mam_policies.algorithms.Actor."""

    def __init__(self, folder: Path, base: Any, mapping: JointMapping) -> None:
        """Load the policy; `base` is the unwrapped environment.

        Raises:
            InputError: no such policy there, or one that needs inputs which nobody gives.
        """
        require("a LeRobot policy", "lerobot")
        from lerobot.configs.policies import PreTrainedConfig
        from lerobot.policies.factory import get_policy_class, make_pre_post_processors

        if not (folder / "model.safetensors").is_file():
            raise InputError(f"{folder} holds no policy of LeRobot (no model.safetensors)")
        config = PreTrainedConfig.from_pretrained(folder)
        if not torch.cuda.is_available():
            config.device = "cpu"
        self.policy = get_policy_class(config.type).from_pretrained(folder, config=config)
        self.before, self.after = make_pre_post_processors(config, str(folder))
        self.device = torch.device(str(config.device))
        self.inputs = set(config.input_features)
        self.spec, self.mapping = base.robot_spec, mapping
        self.joints = [j.name for j in base.agent.robot.active_joints]
        self.moved = [*self.spec.arm, self.spec.gripper[0]]
        self.hidden = sum(b - a for _, a, b, secret in base.observation_layout() if secret)
        self.task = task_words(base)

    def reset(self) -> None:
        """Start an episode."""
        self.policy.reset()

    def observe(self, obs: Any) -> dict[str, NDArray[Any]]:
        """Our batched observation under LeRobot's names, in motor units."""
        state = flat(obs["state"] if isinstance(obs, dict) else obs)
        motors = self.mapping.to_real(self.joints, state[: len(self.joints)].astype(float))
        out: dict[str, NDArray[Any]] = {
            "observation.state": motors.astype(np.float32),
            "observation.environment_state": state[len(state) - self.hidden :],
        }
        for name, data in (obs["sensor_data"] if isinstance(obs, dict) else {}).items():
            if "rgb" in data:
                out[IMAGES + name] = np.asarray(data["rgb"].cpu())[0].astype(np.uint8)
        return out

    def act(self, obs: Any) -> NDArray[np.float32]:
        """The environment's action for its observation."""
        try:
            from lerobot.common.control_utils import predict_action
        except ImportError:  # LeRobot 0.4
            from lerobot.utils.control_utils import predict_action

        seen = {k: v for k, v in self.observe(obs).items() if k in self.inputs}
        target = predict_action(
            seen, self.policy, self.device, self.before, self.after, False, self.task
        )
        sim = self.mapping.to_sim(self.moved, target.reshape(-1).cpu().numpy().astype(float))
        return np.asarray(self.spec.action(sim[:-1], float(sim[-1])), dtype=np.float32)
