"""The joints of an episode as numbers that a policy over many objects can read."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from mani_skill.utils.geometry.rotation_conversions import quaternion_apply

from mam_envs.object_model import ObjectModel
from mam_envs.tasks.base import JointGoal


class Articulations:
    """Axes, kinds and ways of the joints of b sub-scenes with some stages each."""

    def __init__(
        self,
        rows: Sequence[tuple[ObjectModel, Sequence[JointGoal]]],
        device: torch.device,
    ) -> None:
        """`rows`: per sub-scene, its object and the goals of its stages."""
        joints = [[(m.kinematics.joint(g.joint), g) for g in goals] for m, goals in rows]
        axes = [[j.axis * g.direction for j, g in row] for row in joints]
        kinds = [[float(j.type == "prismatic") for j, _ in row] for row in joints]
        ways = [[abs(g.q_goal - g.q_start) for _, g in row] for row in joints]
        self.axis = torch.tensor(np.array(axes), dtype=torch.float32, device=device)
        self.slides = torch.tensor(kinds, device=device)
        self.way = torch.tensor(ways, dtype=torch.float32, device=device)

    def observe(self, poses: torch.Tensor, handle: torch.Tensor) -> dict[str, torch.Tensor]:
        """What is seen of the joints, (b, stages) or (b, stages, 3) each, in the world's frame.

        Args:
            poses: (b, stages, 7) of the links that the joints move. handle: (b, stages, 3).

        Returns:
            `joint_axis`: unit vector of the motion towards the goal; `joint_lever`: from the axis
            to the handle, metres, 0 for slides; `joint_slides`: 1 or 0; `joint_way`: from start to
            goal, radians or metres.
        """
        axis = quaternion_apply(poses[..., 3:], self.axis)
        reach = handle - poses[..., :3]
        lever = reach - (reach * axis).sum(dim=-1, keepdim=True) * axis
        lever = lever * (1 - self.slides)[..., None]
        return {
            "joint_axis": axis, "joint_lever": lever, "joint_slides": self.slides,
            "joint_way": self.way,
        }  # fmt: skip
