"""Where grasp points and the tool are now, in few tensor operations: each step reads them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from mani_skill.utils.structs import Link
from scipy.spatial.transform import Rotation

from mam_pipeline.types import FloatArray


class Frames:
    """The points to grasp on the moving links, and the tool frame on the robot's last link."""

    def __init__(
        self, targets: Sequence[Link], points: torch.Tensor, tip: Link, tool: FloatArray
    ) -> None:
        """Bind to a built scene.

        Args:
            targets: per stage the joint's moving link, merged over sub-scenes.
            points: (b, stages, 3) points to grasp, link frames, metres.
            tip: the robot's link that carries the tool. tool: (4, 4) tip_T_tool.
        """
        self._links = [*targets, tip]
        offset = points.new_tensor(tool[:3, 3]).expand(len(points), 1, 3)
        self._points = torch.cat([points, offset], dim=1)
        x, y, z, w = Rotation.from_matrix(tool[:3, :3]).as_quat()
        times = [[w, x, y, z], [-x, w, -z, y], [-y, z, w, -x], [-z, -y, x, w]]
        turned = not np.allclose(tool[:3, :3], np.eye(3))
        self._times = points.new_tensor(times) if turned else None  # row q @ times = q * tool

    def read(self) -> tuple[torch.Tensor, torch.Tensor]:
        """(b, stages, 3) points to grasp and (b, 7) the tool's pose, world."""
        poses = raw_poses(self._links)
        places = poses[..., :3] + rotate(poses[..., 3:], self._points)
        turn = poses[:, -1, 3:]
        if self._times is not None:
            turn = turn @ self._times
            turn = torch.where(turn[:, :1] < 0, -turn, turn)
        return places[:, :-1], torch.cat([places[:, -1], turn], dim=-1)


def raw_poses(links: Sequence[Link]) -> torch.Tensor:
    """(b, k, 7) world poses of links: place, and unit quaternion with w first."""
    scene = links[0].scene
    if scene.gpu_sim_enabled:
        return torch.stack([link.pose.raw_pose for link in links], dim=1)
    poses = (link._objs[0].entity_pose for link in links)  # the CPU has one sub-scene
    return torch.from_numpy(np.array([[*pose.p, *pose.q] for pose in poses])[None])


def rotate(turn: torch.Tensor, vector: torch.Tensor) -> torch.Tensor:
    """(..., 3) vectors turned by unit quaternions (..., 4) with w first."""
    axis = turn[..., 1:]
    twice = 2.0 * torch.linalg.cross(axis, vector)
    return vector + turn[..., :1] * twice + torch.linalg.cross(axis, twice)
