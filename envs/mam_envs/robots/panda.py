"""Franka Emika Panda: seven joints, a parallel gripper that opens to 8 cm."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mam_envs.robots.base import RobotSpec

PANDA = RobotSpec(
    uid="panda",
    agent="panda",
    urdf="panda/panda_v2.urdf",
    arm=tuple(f"panda_joint{i}" for i in range(1, 8)),
    tip="panda_hand_tcp",
    tool_position=(0, 0, 0),
    tool_approach=(0, 0, 1),
    tool_closing=(0, 1, 0),
    gripper=("panda_finger_joint1", "panda_finger_joint2"),
    opened=0.04,
    gripper_range=(-0.01, 0.04),
    closed=-0.01,
    shut=0.0,
    max_width=0.078,
    tip_ahead=0.010,
    finger_links=("panda_leftfinger", "panda_rightfinger"),
    hand_links=("panda_hand",),
    rest={
        "panda_joint1": 0.0,
        "panda_joint2": -np.pi / 4,
        "panda_joint3": 0.0,
        "panda_joint4": -np.pi * 3 / 4,
        "panda_joint5": 0.0,
        "panda_joint6": np.pi / 2,
        "panda_joint7": np.pi / 4,
        "panda_finger_joint1": 0.04,
        "panda_finger_joint2": 0.04,
    },
)

WRISTCAM = replace(PANDA, uid="panda_wristcam", agent="panda_wristcam")
"""ManiSkill's Panda that carries a camera at its hand."""
