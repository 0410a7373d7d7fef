"""Fetch: a mobile robot that stands on the floor; its base and torso stay where they are."""

from __future__ import annotations

from mam_envs.robots.base import RobotSpec

FETCH = RobotSpec(
    uid="fetch",
    agent="fetch",
    urdf="fetch/fetch.urdf",
    arm=(
        "shoulder_pan_joint",
        "shoulder_lift_joint",
        "upperarm_roll_joint",
        "elbow_flex_joint",
        "forearm_roll_joint",
        "wrist_flex_joint",
        "wrist_roll_joint",
    ),
    tip="gripper_link",
    tool_position=(0.01, 0, 0),
    tool_approach=(1, 0, 0),
    tool_closing=(0, 1, 0),
    gripper=("l_gripper_finger_joint", "r_gripper_finger_joint"),
    opened=0.05,
    gripper_range=(-0.01, 0.05),
    closed=-0.01,
    shut=0.0,
    max_width=0.098,
    tip_ahead=0.022,
    finger_links=("l_gripper_finger_link", "r_gripper_finger_link"),
    hand_links=("gripper_link",),
    rest={
        "torso_lift_joint": 0.386,
        "shoulder_pan_joint": -0.370,
        "shoulder_lift_joint": 0.562,
        "upperarm_roll_joint": -1.032,
        "elbow_flex_joint": 0.695,
        "forearm_roll_joint": 0.955,
        "wrist_flex_joint": -0.1,
        "wrist_roll_joint": 2.077,
        "l_gripper_finger_joint": 0.05,
        "r_gripper_finger_joint": 0.05,
    },
    locked={"torso_lift_joint": 0.386},
    reach=0.85,
    shoulder=1.1,
    force=50.0,
    base_radius=0.3,
    floor_only=True,
    extra_actions=5,
)
