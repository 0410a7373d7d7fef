"""Configuration of the robot type `mam_sim`."""

from __future__ import annotations

from dataclasses import dataclass

from lerobot.robots.config import RobotConfig

from mam_pipeline.errors import unknown_name

FAULTS = (
    "dead_motor", "wrong_sign", "slipped_gripper", "moved_object", "hidden_tag", "lost_camera",
    "frozen_camera", "lost_arm",
)  # fmt: skip
"""What can go wrong with the simulated arm, to practise what one does then."""


@RobotConfig.register_subclass("mam_sim")
@dataclass(kw_only=True)
class MamSimRobotConfig(RobotConfig):
    """A simulated arm in front of an asset.

    Attributes:
        asset: folder; joint, robot, max_steps: as in mam-sim.
        seed: of the first episode; the next ones count on.
        mapping: joint mapping file; None: radians and metres.
        max_relative_target: greatest change per step against the present motor value, its unit.
        latency_steps: control steps until a command arrives.
        joint_noise: of read joint values, radians; handle_noise: of the perceived handle, metres;
            calibration_error: of each joint's zero, radians (standard deviations).
        eye_in_hand: whether a camera on the hand perceives the handle (sharing the motors' error).
        perceived: whether handle, joint value and touch stand behind the motors in the state.
        pictures: whether the scene's cameras are reported as well (needs a Vulkan driver).
        camera: file of a camera (mam-sim calibrate --init) whose picture is reported by its name:
            the tags and the board on a plain ground, hidden by the arm where it is in the way.
        markers: file of the tags on the object. board: whether the hand holds the ChArUco board.
        camera_error: metres that the camera stands beside where the file says, in a direction
            drawn by `seed`; its lens and its turn are off then too.
        log: file to which one JSON line per episode is appended (seed, steps, success ...).
        wire: file to which one JSON line is appended for all that goes to the arm: connect,
            configure, action (with its targets), disconnect (with torque on or off).
        fault: what goes wrong, to practise: one of FAULTS, from command `fault_step` on.
        fault_joint: of a dead motor or a wrong sign; None: the arm's second joint.
        disable_torque_on_disconnect: as of a real arm; here it is only put down in `wire`.
    """

    asset: str = ""
    joint: str | None = None
    robot: str = "panda"
    max_steps: int = 200
    seed: int = 0
    mapping: str | None = None
    max_relative_target: float | None = None
    latency_steps: int = 0
    joint_noise: float = 0.0
    handle_noise: float = 0.0
    calibration_error: float = 0.0
    eye_in_hand: bool = False
    perceived: bool = True
    pictures: bool = False
    camera: str | None = None
    markers: str | None = None
    board: bool = False
    camera_error: float = 0.0
    log: str | None = None
    wire: str | None = None
    fault: str = ""
    fault_step: int = 30
    fault_joint: str | None = None
    disable_torque_on_disconnect: bool = True

    def __post_init__(self) -> None:
        """Refuse a fault that is not known."""
        super().__post_init__()
        if self.fault and self.fault not in FAULTS:
            raise unknown_name("fault", self.fault, FAULTS)
