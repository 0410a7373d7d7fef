"""The arm's postures at the marks of a motion: before the grasp, at it, and on the way to the goal.

They are found on the twin alone, so a real arm has them as well.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mam_envs.grasping.candidates import Grasp, backed, goal_values, tool_path
from mam_envs.grasping.limits import LIMITS
from mam_envs.object_model import ObjectModel
from mam_envs.placement.arm_path import ArmPath
from mam_envs.robots import RobotSpec
from mam_envs.tasks.base import JointGoal
from mam_pipeline.types import FloatArray

MARKS = ("approach", "grasp", "quarter", "half", "three_quarters", "goal")
WAYPOINTS = len(MARKS) - 1
"""Joint values along the way that are solved for, each from the one before."""


def along(path: ArmPath) -> FloatArray:
    """(6, n) arm joints at MARKS of a planned path."""
    way = path.follow[np.linspace(0, len(path.follow) - 1, WAYPOINTS).round().astype(int)]
    return np.concatenate([path.approach[:1], way])


def postures(
    models: Sequence[ObjectModel],
    goals: Sequence[JointGoal],
    grasps: Sequence[Grasp],
    robot: RobotSpec,
    base_asset: FloatArray,
    guess: FloatArray,
) -> FloatArray:
    """(N, 6, n) arm joints at MARKS for N objects, radians (metres of sliding joints).

    Each posture is looked for from the one before, on its branch; what is out of reach gives the
    nearest that was found.

    Args:
        goals, grasps: of each object. base_asset: (N, 4, 4) where it stands before the base.
        guess: (N, n) arm joints near the grasp, which choose the branch.
    """
    tools = np.stack(
        [tool_path(m, j, g, goal_values(j, WAYPOINTS)) for m, j, g in zip(models, goals, grasps)]
    )
    targets = base_asset[:, None] @ tools

    def towards(target: FloatArray, begin: FloatArray, iterations: int) -> FloatArray:
        rest = robot.rest_arm if iterations > 20 else None
        return robot.chain.solve(target, begin, robot.rotation_weight, iterations, rest).q

    grasp = towards(targets[:, 0], guess, 40)
    before = grasp
    for distance in (0.4 * LIMITS.back_off, LIMITS.back_off):
        before = towards(backed(targets[:, 0], distance), before, 12)
    way = [grasp]
    for k in range(1, WAYPOINTS):
        way.append(towards(targets[:, k], way[-1], 12))
    return np.stack([before, *way], axis=1)
