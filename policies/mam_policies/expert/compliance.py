"""The hand gives way to force across the joint's motion, as an arm under admittance control does.

A joint moves its part on one curve. A hand that leaves it, because of the arm's error, of a grip
that has shifted, or of an axis that is a little wrong, pulls against the hinge instead.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from mam_envs.grasping.candidates import tool_path
from mam_envs.placement.arm_path import ArmPath
from mam_envs.planner_state import PlannerState
from mam_pipeline.types import FloatArray
from mam_policies.expert.config import ExpertConfig


@dataclass
class Compliance:
    """How far the hand stands off its planned way.

    Attributes:
        offset: (3,) metres, robot base frame.
        across: newtons that the hand last felt across the joint's motion.
    """

    config: ExpertConfig
    offset: FloatArray = field(default_factory=lambda: np.zeros(3))
    across: float = 0.0

    def target(self, now: PlannerState, path: ArmPath, arm: FloatArray, q: float) -> FloatArray:
        """Take note of this step's force, and shift the planned arm joints.

        Args:
            arm: (n,) planned joints. q: value of the object's joint that goes with them.

        Returns:
            (n,) joints that carry the hand beside its planned place; `arm` itself where the arm
            cannot get there.
        """
        into = np.linalg.inv(now.base)[:3, :3]
        force = into @ now.force
        way = into @ now.world_asset[:3, :3] @ _way(now, path, q)
        across = force - way * float(force @ way)
        self.across = float(np.linalg.norm(across))
        free = max(self.across - self.config.bearable, 0.0) / max(self.across, 1e-9)
        self.offset = self.offset + self.config.compliance * free * across
        length = float(np.linalg.norm(self.offset))
        self.offset *= min(1.0, self.config.most_offset / max(length, 1e-9))
        if length < 1e-6:
            return arm
        chain = now.robot.chain
        rotation, position, _ = chain.forward(arm[None])
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation[0], position[0] + self.offset
        found = chain.solve(pose[None], arm[None], now.robot.rotation_weight, 6)
        near = np.abs(found.q[0] - arm).max() < self.config.most_turn
        return found.q[0] if near and found.position_error[0] < 0.005 else arm


def _way(now: PlannerState, path: ArmPath, q: float) -> FloatArray:
    """(3,) unit vector in which the hand moves at joint value q, asset frame."""
    step = 0.01 * (now.goal.q_goal - now.goal.q_start)
    places = tool_path(now.model, now.goal, path.grasp, np.array([q - step, q + step]))[:, :3, 3]
    move = places[1] - places[0]
    return np.asarray(move / max(float(np.linalg.norm(move)), 1e-12))
