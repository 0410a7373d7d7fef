"""What is observed in an environment: state vectors with named slices, and spoilt pictures."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import torch
from mani_skill.envs.sapien_env import BaseEnv
from mani_skill.utils.structs import Articulation, Link, Pose

from mam_envs.articulations import Articulations
from mam_envs.config import EnvConfig
from mam_envs.scene.background import put_background, read_background
from mam_envs.scene.looks import Looks
from mam_envs.scene.loose import Loose
from mam_envs.tasks import Task, TaskState


class Observing(BaseEnv):
    """The observations of an environment; what they are made of is its own.

    Attributes:
        loose: the cube of a task that has one.
    """

    agent: Any
    config: EnvConfig
    objects: list[Articulation]
    task: Task
    targets: list[Link]
    loose: Loose | None
    _now: TaskState
    _articulation: Articulations
    _arm_index: list[int]
    _looks: Looks | None

    def base_pose(self) -> Pose:
        """Pose (b,) of the robot's base frame."""
        raise NotImplementedError

    def _get_obs_extra(self, info: dict) -> dict[str, Any]:
        """The tool's pose, and in state modes what only a simulator knows, under `privileged`."""
        out: dict[str, Any] = {"tcp_pose": info["tcp_pose"]}
        if self.obs_mode_struct.state or self.obs_mode in ("state", "state_dict"):
            out["privileged"] = dict(self.task.observe(self._now, info))
            if self.config.observation.articulation:
                poses = torch.stack([target.pose.raw_pose for target in self.targets], dim=1)
                base = self.base_pose().raw_pose
                qpos = self.agent.robot.get_qpos()[:, self._arm_index]
                tokens = self._articulation.observe(base, poses, self._now.tool, qpos)
                out["privileged"] |= {key: self.task.pick(v) for key, v in tokens.items()}
        return out

    def get_obs(self, info: dict | None = None, unflattened: bool = False) -> Any:
        """ManiSkill's, without the empty sensor_data that it leaves beside a point cloud."""
        obs = super().get_obs(info, unflattened)
        if isinstance(obs, dict) and not obs.get("sensor_data", True):
            del obs["sensor_data"]  # gymnasium takes no empty space
        return obs

    def observation_layout(self) -> list[tuple[str, int, int, bool]]:
        """(name, start, stop, privileged) of every entry of the flat state vector."""
        info = self.get_info()
        found = self._get_obs_state_dict(info)
        out: list[tuple[str, int, int, bool]] = []
        at = 0
        for name, value in _entries(found, ""):
            width = int(np.prod(value.shape[1:])) if value.ndim > 1 else 1
            out.append((name, at, at + width, "privileged" in name))
            at += width
        return out

    def foreground(self) -> torch.Tensor:
        """(n,) ids, in segmentations, of the links of robot and objects."""
        kept = [*self.agent.robot.links, *(link for o in self.objects for link in o.links)]
        kept += [] if self.loose is None else [self.loose.actor]
        return torch.unique(torch.cat([link.per_scene_id for link in kept]))

    def _get_obs_sensor_data(self, apply_texture_transforms: bool = True) -> dict:
        out = super()._get_obs_sensor_data(apply_texture_transforms)
        file, picture = self.config.scene.background, None
        if self._looks is not None:
            picture = self._looks.background
        if file:
            picture = read_background(file)
        if picture is not None and apply_texture_transforms:
            put_background(picture, out, self.scene.sensors, self.foreground())
        if self._looks is not None and apply_texture_transforms:
            self._looks.spoil(out)
        return out


def _entries(value: Any, prefix: str) -> list[tuple[str, torch.Tensor]]:
    if isinstance(value, Mapping):
        return [row for k, v in value.items() for row in _entries(v, f"{prefix}/{k}".strip("/"))]
    return [(prefix, value)]
