"""UFACTORY xArm 6 with a Robotiq 2F-85 gripper; ManiSkill downloads its files on request."""

from __future__ import annotations

from mam_envs.robots.base import RobotSpec

XARM6 = RobotSpec(
    uid="xarm6_robotiq",
    agent="xarm6_robotiq",
    urdf="xarm6/xarm6_robotiq.urdf",
    arm=tuple(f"joint{i}" for i in range(1, 7)),
    tip="eef",
    tool_position=(0, 0, 0),
    tool_approach=(0, 0, 1),
    tool_closing=(0, 1, 0),
    gripper=("left_outer_knuckle_joint", "right_outer_knuckle_joint"),
    opened=0.0,
    gripper_range=(0.0, 0.81),
    closed=0.81,
    shut=0.81,
    max_width=0.08,
    tip_ahead=0.01,
    finger_links=("left_inner_finger", "right_inner_finger"),
    hand_links=("robotiq_arg2f_base_link",),
    rest={"joint1": 0, "joint2": 0.22, "joint3": -1.23, "joint4": 0, "joint5": 1.01, "joint6": 0},
    reach=0.65,
    shoulder=0.27,
    force=40.0,
)
