"""What a planner may know of the simulation at a moment."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mam_envs.object_model import ObjectModel
from mam_envs.robots import RobotSpec
from mam_envs.scene.layout import Layout
from mam_envs.tasks.base import JointGoal
from mam_pipeline.types import FloatArray


@dataclass(frozen=True)
class PlannerState:
    """What a planner may know of one sub-scene at this moment (privileged).

    Attributes:
        layout: asset, task and nominal placement.
        goal: the joint that is to be moved now.
        base: (4, 4) world_T_base. world_asset: (4, 4) world_T_asset.
        q: joint value of the goal's joint. others: values of the object's other joints.
        arm: (n,) arm joint values.
        force: (3,) newtons of the part on the robot, world, mean of the last control step.
        held: (h,) what the joints that a robot's `Drive` holds are short of their rest values.
        thing: (4, 4) world_T_thing of the loose thing; None for tasks without one.
    """

    layout: Layout
    goal: JointGoal
    base: FloatArray
    world_asset: FloatArray
    q: float
    others: Mapping[str, float]
    arm: FloatArray
    force: FloatArray
    held: FloatArray
    thing: FloatArray | None = None

    @staticmethod
    def at_rest(layout: Layout, base: FloatArray, world_asset: FloatArray) -> PlannerState:
        """Before the first joint of a task is moved, with the arm at rest."""
        goal, robot = layout.goals[0], layout.robot
        nothing = np.zeros(0)
        return PlannerState(
            layout, goal, base, world_asset, goal.q_start, {}, robot.rest_arm, np.zeros(3), nothing
        )

    @property
    def model(self) -> ObjectModel:
        return self.layout.model

    @property
    def robot(self) -> RobotSpec:
        return self.layout.robot
