"""What is known at a moment: all of it for planners, the privileged part for state observations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from mani_skill.utils import common

from mam_envs.config import JointGoal
from mam_envs.object_model import ObjectModel
from mam_envs.robots import RobotSpec
from mam_envs.scene.build import Layout
from mam_pipeline.types import FloatArray

if TYPE_CHECKING:
    from mam_envs.env import OperateJointEnv


@dataclass(frozen=True)
class PlannerState:
    """What a planner may know of one sub-scene at this moment (privileged).

    Attributes:
        layout: asset, task and nominal placement.
        goal: the joint that is to be moved now.
        base: (4, 4) world_T_base. world_asset: (4, 4) world_T_asset.
        q: joint value of the goal's joint. others: values of the object's other joints.
        arm: (n,) arm joint values.
    """

    layout: Layout
    goal: JointGoal
    base: FloatArray
    world_asset: FloatArray
    q: float
    others: Mapping[str, float]
    arm: FloatArray

    @property
    def model(self) -> ObjectModel:
        return self.layout.model

    @property
    def robot(self) -> RobotSpec:
        return self.layout.robot


def situation(env: OperateJointEnv, index: int) -> PlannerState:
    """What a planner may know of sub-scene `index`."""
    item = env.layout(index)
    goal = item.goals[int(env.stage[index])]
    values = common.to_numpy(env.object.get_qpos())[index]
    joints = [j.name for j in env._objects[index].active_joints]
    others = {n: float(values[k]) for k, n in enumerate(joints) if n != goal.joint}
    names = [j.name for j in env.agent.robot.active_joints]
    q = common.to_numpy(env.agent.robot.get_qpos())[index]
    return PlannerState(
        layout=item,
        goal=goal,
        base=item.placement.base,
        world_asset=np.array(env._world_asset[index], dtype=float),
        q=float(values[joints.index(goal.joint)]),
        others=others,
        arm=np.array([q[names.index(n)] for n in env.robot_spec.arm], dtype=float),
    )


def observe(env: OperateJointEnv, info: Mapping[str, Any]) -> dict[str, Any]:
    """Task observations, (b, ...): the tool's pose, and in state modes what only a simulator
    knows, under `privileged`."""
    tool = info["tcp_pose"]
    out: dict[str, Any] = {"tcp_pose": tool}
    if env.obs_mode_struct.state or env.obs_mode in ("state", "state_dict"):
        handle = info["handle_position"]
        out["privileged"] = {
            "handle_position": handle,
            "tcp_to_handle": handle - tool[:, :3],
            "joint_value": env.joint_value(),
            "joint_speed": env.joint_speed(),
            "joint_goal": env.tracker.now("q_goal"),
            "open_fraction": info["open_fraction"],
            "progress": info["progress"],
            "touching": env.tracker.touching.float(),
        }
    return out
