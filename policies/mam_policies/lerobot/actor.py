"""A LeRobot policy folder acting in our environment, through LeRobot's own pipelines.

LeRobot sees a folder only after `mam_pipeline.folder_data` has: it would import what it names.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from mam_pipeline.errors import InputError, MamSimError
from mam_pipeline.folder_data import PolicyFolder, policy_folder
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
            InputError: no such policy there, or one that wishes what no folder may.
        """
        found = policy_folder(folder)
        require("a LeRobot policy", "lerobot")
        with _readable(folder):
            config, self.policy, self.before, self.after = _loaded(found)
        self.device, self.found = torch.device(str(config.device)), found
        self.inputs = dict(config.input_features)
        self.spec, self.mapping = base.robot_spec, mapping
        self.joints = [j.name for j in base.agent.robot.active_joints]
        self.moved = [*self.spec.arm, self.spec.gripper[0]]
        self.hidden = sum(b - a for _, a, b, secret in base.observation_layout() if secret)
        self.task = task_words(base)
        self._fit(config.output_features, {"action": (len(self.moved),)})

    def _fit(self, features: dict[str, Any], here: dict[str, Any]) -> None:
        """Refuse a policy of other sizes, as of another robot; pictures may be of any."""
        for name, feature in features.items():
            size, wanted = here.get(name), tuple(feature.shape)
            if size != wanted and not (size and name.startswith(IMAGES)):
                raise InputError(
                    f"{self.found.folder} was trained with {name} of {wanted}, which is "
                    f"{size or 'missing'} here; name the robot, task and cameras of its training"
                )

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
        if self.found.kind != "mam_sim":  # which makes its own inputs of what is here
            self._fit(self.inputs, {k: v.shape for k, v in seen.items()})
        with _readable(self.found.folder):
            target = predict_action(
                seen, self.policy, self.device, self.before, self.after, False, self.task
            )
        sim = self.mapping.to_sim(self.moved, target.reshape(-1).cpu().numpy().astype(float))
        return np.asarray(self.spec.action(sim[:-1], float(sim[-1])), dtype=np.float32)


@contextmanager
def _readable(folder: Path) -> Iterator[None]:
    """Each type of policy fails in its own way at wrong numbers: all are InputError."""
    try:
        yield
    except (MamSimError, MemoryError):
        raise
    except Exception as error:
        why = f"{type(error).__name__}: {' '.join(str(error).split())[:300]}"
        raise InputError(f"{folder} is no policy that LeRobot can read: {why}") from error


def _loaded(found: PolicyFolder) -> tuple[Any, Any, Any, Any]:
    """Configuration, policy, and the pipelines before and after it, of a folder that was checked.

    Nothing is fetched or compiled: the weights are those in the folder.
    """
    from lerobot.configs.policies import PreTrainedConfig
    from lerobot.policies.factory import get_policy_class, make_pre_post_processors

    folder = found.folder
    if found.kind == "mam_sim":
        require("a policy of mam-sim", "lerobot_policy_mam_sim")
    config = PreTrainedConfig.from_pretrained(folder)
    still = {"pretrained_backbone_weights": None, "load_vlm_weights": False, "compile_model": False}
    for name, value in still.items():
        if hasattr(config, name):
            setattr(config, name, value)
    if not torch.cuda.is_available():
        config.device = "cpu"
    kind = get_policy_class(config.type)
    _check_size(kind, config, folder / "model.safetensors")
    policy = kind.from_pretrained(folder, config=config)
    given = {} if torch.cuda.is_available() else {"device_processor": {"device": "cpu"}}
    before, after = make_pre_post_processors(config, str(folder), preprocessor_overrides=given)
    return config, policy, before, after


def _check_size(kind: Any, config: Any, weights: Path) -> None:
    """Compare what config.json describes with the numbers in the file, before memory is taken."""
    from safetensors import safe_open

    if config.type == "smolvla":  # its model of language asks for files as it is described
        return
    with safe_open(weights, "pt") as opened:
        there = sum(int(np.prod(opened.get_slice(k).get_shape())) for k in opened.keys())  # noqa: SIM118
    with torch.device("meta"):
        wanted = sum(p.numel() for p in kind(config).parameters())
    if wanted > there:
        raise InputError(
            f"{weights} holds {there} numbers, and config.json describes a network of {wanted}"
        )
