"""SO-100: five joints, one moving jaw."""

from __future__ import annotations

import numpy as np

from mam_envs.robots.base import RobotSpec

SO100 = RobotSpec(
    uid="so100",
    urdf="so100/so100.urdf",
    arm=("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll"),
    tip="Fixed_Jaw",
    tool_position=(-0.004, -0.088, 0.0),
    tool_approach=(0, -1, 0),
    tool_closing=(1, 0, 0),
    gripper=("gripper",),
    opened=-0.15,
    closed=-1.1,
    shut=-1.1,
    max_width=0.06,
    tip_ahead=0.009,
    finger_links=("Fixed_Jaw", "Moving_Jaw"),
    hand_links=("Fixed_Jaw", "Moving_Jaw"),
    rest={
        "shoulder_pan": 0.0,
        "shoulder_lift": -1.5708,
        "elbow_flex": 1.5708,
        "wrist_flex": 0.66,
        "wrist_roll": 0.0,
        "gripper": -1.1,
    },
    # five joints: the direction about the approach axis and the hand's yaw cannot both be chosen
    rotation_weight=(0.12, 0.12, 0.12),
    rotation_tolerance=0.45,
    reach=0.34,
    shoulder=0.12,
    force=10.0,
    forward=-np.pi / 2,
    base_radius=0.06,
    step=0.08,
    delta=0.15,
)
