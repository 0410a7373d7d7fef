"""The joints of an episode, and the grasp on them, as numbers that a policy over many objects can
read: all in the robot's base frame, so that it does not matter where object and robot stand."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from mani_skill.utils.geometry.rotation_conversions import quaternion_apply
from mani_skill.utils.structs import Pose

from mam_envs.grasping.candidates import Grasp
from mam_envs.planner_state import PlannerState
from mam_envs.postures import MARKS, along, postures
from mam_envs.replanning import arm_path
from mam_envs.scene.layout import Layout
from mam_pipeline.errors import NotPhysicalError
from mam_pipeline.types import FloatArray


class Articulations:
    """Axes, kinds, ways and planned grasps of the joints of b sub-scenes with some stages each, and
    the arm's postures on the way."""

    def __init__(
        self, layouts: Sequence[Layout], claimed: Sequence[Layout], device: torch.device
    ) -> None:
        """`layouts`: per sub-scene; its goals are the stages. `claimed`: what planners know."""

        def tensor(rows: list[list[object]]) -> torch.Tensor:
            return torch.tensor(np.array(rows), dtype=torch.float32, device=device)

        joints = [[item.model.kinematics.joint(g.joint) for g in item.goals] for item in layouts]
        self._axis = tensor(
            [
                [j.axis * g.direction for j, g in zip(row, item.goals)]
                for row, item in zip(joints, layouts)
            ]
        )
        self._slides = tensor([[float(j.type == "prismatic") for j in row] for row in joints])
        self._way = tensor([[abs(g.q_goal - g.q_start) for g in item.goals] for item in layouts])
        shape = (len(layouts), len(joints[0]))
        arm = len(layouts[0].robot.arm)
        self._pushes, self._width, self._lag, self._place, self._approach, self._closing = (
            torch.zeros(shape + more, device=device) for more in ((), (), (), (3,), (3,), (3,))
        )
        self._postures = torch.zeros((*shape, len(MARKS), arm), device=device)
        self._layouts, self._claimed = layouts, claimed
        for i, item in enumerate(layouts):
            for k, grasp in enumerate(item.grasps):
                self._take(i, k, grasp)

    def _take(self, index: int, stage: int, grasp: Grasp) -> None:
        """Note how the hand takes hold of a joint's part."""
        item = self._layouts[index]
        kinematics = item.model.kinematics
        child = kinematics.joint(item.goals[stage].joint).child
        link_tool = np.linalg.inv(kinematics.link_poses({})[child][0]) @ grasp.tool
        columns = ((self._place, 3), (self._approach, 2), (self._closing, 1))
        for directions, column in columns:
            directions[index, stage] = torch.as_tensor(link_tool[:3, column]).to(directions)
        self._pushes[index, stage] = float(grasp.mode == "push")
        self._width[index, stage] = grasp.card.width
        self._lag[index, stage] = grasp.lag

    def placed(self, index: Sequence[int], world_asset: FloatArray) -> None:
        """Find the postures for sub-scenes whose objects now stand at (k, 4, 4) world_T_asset.

        The first joint of a sequence is taken hold of as the expert would do it from there; the
        others are begun from where the arm ends at the one before.
        """
        items = [self._claimed[i] for i in index]
        models, robot = [item.model for item in items], items[0].robot
        base = np.stack([item.stand(pose) for item, pose in zip(items, world_asset)])
        guess = np.stack([item.placement.path.approach[-1] for item in items])
        for k in range(self._postures.shape[1]):
            goals, grasps = [item.goals[k] for item in items], [item.grasps[k] for item in items]
            found = postures(models, goals, grasps, robot, np.linalg.inv(base) @ world_asset, guess)
            for i, number in enumerate(index if k == 0 else ()):
                now = PlannerState.at_rest(items[i], base[i], world_asset[i])
                try:
                    path = arm_path(now)
                except NotPhysicalError:
                    self._take(number, 0, grasps[i])
                    continue
                self._take(number, 0, path.grasp)
                found[i] = along(path)
            self._postures[index, k] = torch.as_tensor(found).to(self._postures)
            guess = found[:, -1]

    def observe(
        self, base: torch.Tensor, poses: torch.Tensor, tool: torch.Tensor, arm: torch.Tensor
    ) -> dict[str, torch.Tensor]:
        """What is seen of joints and grasps, (b, stages) or (b, stages, n) each.

        Args:
            base, tool: (b, 7) of the robot's base and of its tool frame, world.
            poses: (b, stages, 7) of the links that the joints move, world.
            arm: (b, n) arm joints.

        Returns:
            In the base frame: `joint_axis`, unit vector of the motion towards the goal;
            `joint_lever`, from the axis to the grasp, metres, 0 for slides; `grasp_position`,
            where the tool is to be (metres, moving with the part), `grasp_approach` and
            `grasp_closing`, how it is to be turned. `grasp_offset`: from the tool to there, and
            `grasp_turn` (6): those two directions, all in the tool frame. `joint_slides`: 1 or 0;
            `joint_way`: from start to goal, radians or metres; `grasp_pushes`: 1 where closed
            fingers press; `grasp_width`: of what is held, metres; `grasp_lag`: share of a hinge's
            turn that the hand follows. `posture_<mark>` (n), for the MARKS of
            mam_envs.postures: how far the arm's joints are from where they are to be there.
        """
        turn, middle = poses[..., 3:], poses[..., :3]
        axis = quaternion_apply(turn, self._axis)
        place = quaternion_apply(turn, self._place) + middle
        approach = quaternion_apply(turn, self._approach)
        closing = quaternion_apply(turn, self._closing)
        reach = place - middle
        lever = reach - (reach * axis).sum(dim=-1, keepdim=True) * axis
        lever = lever * (1 - self._slides)[..., None]
        home, hand = _back(base), _back(tool)
        left = self._postures - arm[:, None, None]
        return {
            **{f"posture_{name}": left[:, :, m] for m, name in enumerate(MARKS)},
            "joint_axis": quaternion_apply(home, axis),
            "joint_lever": quaternion_apply(home, lever),
            "joint_slides": self._slides,
            "joint_way": self._way,
            "grasp_position": quaternion_apply(home, place - base[:, None, :3]),
            "grasp_approach": quaternion_apply(home, approach),
            "grasp_closing": quaternion_apply(home, closing),
            "grasp_offset": quaternion_apply(hand, place - tool[:, None, :3]),
            "grasp_turn": torch.cat(
                [quaternion_apply(hand, approach), quaternion_apply(hand, closing)], dim=-1
            ),
            "grasp_pushes": self._pushes,
            "grasp_width": self._width,
            "grasp_lag": self._lag,
        }


def _back(pose: torch.Tensor) -> torch.Tensor:
    """(b, 1, 4) quaternions that undo the turn of poses (b, 7)."""
    return Pose.create(pose).inv().q[:, None]
