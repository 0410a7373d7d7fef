"""SO-101: five joints, one moving jaw. Its zeros are those of LeRobot's calibration."""

from __future__ import annotations

from mam_envs.robots.base import RobotSpec

SO101 = RobotSpec(
    uid="so101",
    package="example-robot-data",
    urdf="so_arm_description/urdf/so101.urdf",
    arm=("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll"),
    tip="gripper_link",
    tool_position=(-0.003, 0.0, -0.093),
    tool_approach=(0, 0, -1),
    tool_closing=(1, 0, 0),
    gripper=("gripper",),
    opened=0.6,
    closed=-0.17,
    shut=-0.17,
    max_width=0.06,
    tip_ahead=0.01,
    finger_links=("gripper_link", "moving_jaw_so101_v1_link"),
    hand_links=("gripper_link", "moving_jaw_so101_v1_link"),
    rest={
        "shoulder_pan": 0.0,
        "shoulder_lift": -1.5,
        "elbow_flex": 1.5,
        "wrist_flex": 0.66,
        "wrist_roll": 0.0,
    },
    # five joints: the direction about the approach axis and the hand's yaw cannot both be chosen
    rotation_weight=(0.12, 0.12, 0.12),
    rotation_tolerance=0.45,
    reach=0.34,
    shoulder=0.12,
    force=10.0,
    base_radius=0.06,
    step=0.08,
    delta=0.15,
)
