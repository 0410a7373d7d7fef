"""The Koch v1.1, an arm with five joints and a hinged jaw."""

from __future__ import annotations

from mam_envs.robots import RobotSpec

KOCH = RobotSpec(
    uid="koch",
    urdf="koch/follower_arm_v1.1.urdf",
    # the arm, from base to hand
    arm=tuple(f"joint_{i}" for i in range(1, 6)),
    tip="link_6",
    # the tool frame in the tip's frame: between the fingertips
    tool_position=(-0.004, 0.0, -0.058),
    tool_approach=(0, 0, -1),
    tool_closing=(1, 0, 0),
    # the jaw: joint values, and what fits into it
    gripper=("joint_6",),
    opened=1.1,
    closed=0.0,
    shut=0.0,
    max_width=0.045,
    tip_ahead=0.008,
    finger_links=("link_6", "gripper"),
    hand_links=("link_6", "gripper"),
    # where an episode begins
    rest={
        "joint_1": 0.0,
        "joint_2": 2.0,
        "joint_3": 2.75,
        "joint_4": -0.25,
        "joint_5": 0.0,
        "joint_6": 0.0,
    },
    # five joints cannot choose all three angles of the hand: position comes first
    rotation_weight=(0.12, 0.12, 0.12),
    rotation_tolerance=0.45,
    # size and strength
    reach=0.30,
    shoulder=0.06,
    force=8.0,
    forward=-1.5708,
    base_radius=0.06,
    step=0.08,
    delta=0.05,
)
