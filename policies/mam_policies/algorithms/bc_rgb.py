"""Behaviour cloning that sees one camera: a clone of the expert acts on what a network makes out.

The clone sees positions only. Its handle and joint value come from the picture: a network tells
where the object stands and how far it is open, the twin says where the handle then is. The object's
place is averaged over the episode, because it does not change.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from mam_envs.scene.layout import Layout
from mam_pipeline.errors import ConfigError
from mam_pipeline.types import FloatArray
from mam_policies.algorithms import Algorithm, OnProgress
from mam_policies.algorithms.bc import BehaviourCloning
from mam_policies.lerobot.export import deployment
from mam_policies.lerobot.policy import Converter
from mam_policies.lerobot.robot_interface import mapping_of
from mam_policies.mlp import MlpActor, MlpPolicy
from mam_policies.run import EnvChoice, RunInfo, few_objects, flat
from mam_policies.settings import BcRgbConfig
from mam_policies.sight.network import SightNetwork, fit
from mam_policies.sight.pictures import OUTPUTS, picture_of, pictures, pose_at


class CameraCloning(Algorithm[BcRgbConfig]):
    """bc_rgb: clones the expert for one camera's pictures; within an hour on two cores."""

    name = "bc_rgb"
    Config = BcRgbConfig

    def train(
        self,
        choice: EnvChoice,
        config: BcRgbConfig,
        out: Path,
        update: OnProgress = lambda *_: None,
    ) -> RunInfo:
        """Clone the expert, then learn to see, into the run folder `out`.

        Raises:
            ConfigError: several assets. BackendError: no Vulkan driver for the camera.
            TrainingError: the expert succeeds too seldom to learn from.
        """
        if len(choice.assets) != 1:
            raise ConfigError("bc_rgb is trained on one asset at a time")
        env = choice.make(obs_mode="rgb+state")  # refused before anything is written
        try:
            info = BehaviourCloning().train(choice, replace(config, deployable=True), out, update)
            with few_objects():
                shown = pictures(
                    env, config.pictures, config.every, 4 * config.noise, config.seed,
                    out / "pictures", lambda share, words: update("pictures", share, words),
                )  # fmt: skip
        finally:
            env.close()
        _, height, width, _ = shown.rgb.shape
        network = SightNetwork((height, width), shown.arm.shape[1], OUTPUTS)
        loss = fit(
            network, shown.rgb, shown.arm, shown.target, config.sight_epochs, config.seed,
            lambda share, words: update("sight", share, words), kept=shown.kept,
        )  # fmt: skip
        network.save(out)
        results = {**info.results, "pictures": len(shown.rgb), "sight_loss": loss}
        info = replace(info, algo=self.name, results=results)
        info.save(out)
        return info

    def env_arguments(self, info: RunInfo) -> dict[str, Any]:
        """Pictures beside the state, of which the arm's joints are used."""
        return {"obs_mode": "rgb+state"}

    def actor(self, run: Path, env: Any) -> CameraActor:
        """Both networks of a run folder."""
        return CameraActor(run, env.unwrapped)


class CameraActor:
    """Acts on the arm's joints and the picture alone; see mam_policies.algorithms.Actor."""

    def __init__(self, run: Path, base: Any) -> None:
        info = RunInfo.load(run)
        self.network = SightNetwork.load(run)
        self.clone = MlpActor(MlpPolicy.load(run))
        self.layout: Layout = base.layout(0)
        model = self.layout.model
        self.limits = model.limits(model.card_joint(self.layout.goals[0].joint))
        self.joints = len(base.agent.robot.active_joints)
        self.arm = list(base._arm_index)
        plan = deployment(base, info, mapping_of(base, None))
        self.converter = Converter(plan, self.clone.policy)
        self.reset()

    def reset(self) -> None:
        """Start an episode."""
        self.clone.reset()
        self.converter.reset()
        self.seen: list[FloatArray] = []

    def act(self, obs: Any) -> NDArray[np.float32]:
        """The environment's action for its observation with pictures and state."""
        qpos = flat(obs["state"])[: self.joints]
        rgb = torch.from_numpy(picture_of(obs["sensor_data"])[None])
        with torch.no_grad():
            told = self.network.tell(rgb, torch.from_numpy(qpos[self.arm][None]))[0]
        self.seen.append(told.numpy().astype(float))
        place = np.median([row[:3] for row in self.seen], axis=0)
        value = float(np.clip(np.mean([row[3] for row in self.seen[-3:]]), *self.limits))
        state = np.concatenate([qpos, self._handle(place, value), [value, 0.0]])
        return self.clone.act(self.converter.observe(state[None])[1])

    def _handle(self, place: FloatArray, value: float) -> FloatArray:
        """(3,) the handle in the base's frame, from the twin."""
        layout, joint = self.layout, self.layout.goals[0].joint
        motion = layout.model.motion(joint, np.array([value]), {})[0]
        pose = np.linalg.inv(layout.placement.base) @ pose_at(layout, place) @ motion
        out: FloatArray = pose[:3, :3] @ layout.handles[0] + pose[:3, 3]
        return out
