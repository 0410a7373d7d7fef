"""A ManiSkill agent made from a robot's specification alone.

An arm that ManiSkill brings has an agent of its own, with its own control modes. For any other, the
specification says all that is needed: joints, gripper and URDF.
"""

from __future__ import annotations

from copy import deepcopy
from typing import Any

import mani_skill.agents.robots  # noqa: F401  (registers ManiSkill's own)
from mani_skill.agents.base_agent import BaseAgent
from mani_skill.agents.controllers import (
    PDJointPosControllerConfig,
    PDJointPosMimicControllerConfig,
)
from mani_skill.agents.registration import REGISTERED_AGENTS, register_agent

from mam_envs.robots.base import RobotSpec

DRIVE: dict[str, float] = {"stiffness": 1e3, "damping": 1e2, "force_limit": 100.0}
"""As ManiSkill drives its own arms; Nm/rad, Nms/rad and Nm."""
GRIP = 2.0
"""Friction of the fingers, as ManiSkill has it."""


def agent_of(spec: RobotSpec) -> str:
    """Uid of the robot's ManiSkill agent, which is made where the robot names none.

    Its control modes are pd_joint_pos (radians), pd_joint_delta_pos and pd_joint_target_delta_pos
    (-1 to 1 for `spec.delta` radians). The gripper's command comes last: -1 to 1 over
    `spec.grip` in each of them.
    """
    uid = spec.agent or f"mam_{spec.uid}"
    if not spec.agent and uid not in REGISTERED_AGENTS:
        register_agent()(_agent(spec, uid))
    return uid


def _agent(spec: RobotSpec, name: str) -> type[BaseAgent]:
    pad = {"material": "fingers", "patch_radius": 0.1, "min_patch_radius": 0.1}
    pads = {link: pad for link in spec.finger_links}
    friction = {"static_friction": GRIP, "dynamic_friction": GRIP, "restitution": 0.0}

    class Arm(BaseAgent):
        uid = name
        urdf_path = str(spec.path)
        urdf_config = {"_materials": {"fingers": friction}, "link": pads}  # noqa: RUF012

        @property
        def _controller_configs(self) -> dict[str, Any]:
            joints = list(spec.arm)
            position = PDJointPosControllerConfig(joints, None, None, **DRIVE,
                                                  normalize_action=False)  # fmt: skip
            delta = PDJointPosControllerConfig(joints, -spec.delta, spec.delta, **DRIVE,
                                               use_delta=True)  # fmt: skip
            target = deepcopy(delta)
            target.use_target = True
            modes = {"pd_joint_pos": position, "pd_joint_delta_pos": delta,
                     "pd_joint_target_delta_pos": target}  # fmt: skip
            return {name: {"arm": arm, "gripper": _gripper(spec)} for name, arm in modes.items()}

    return Arm


def _gripper(spec: RobotSpec) -> PDJointPosControllerConfig:
    low, high = spec.grip
    first, *others = spec.gripper
    if not others:
        return PDJointPosControllerConfig([first], low, high, **DRIVE)
    follow = {name: {"joint": first} for name in others}
    return PDJointPosMimicControllerConfig(list(spec.gripper), low, high, **DRIVE, mimic=follow)
