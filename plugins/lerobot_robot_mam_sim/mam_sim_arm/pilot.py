"""Sessions with a connected arm: calibrating a set-up, and a run on a calibrated one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from mam_policies.lerobot.joint_mapping import JointMapping
from mam_sim_arm.calibration import Calibration, calibrate
from mam_sim_arm.camera import CameraModel
from mam_sim_arm.poses import board_poses
from mam_sim_arm.recording import Arm, record_gripper, record_views, solved_mapping
from mam_sim_arm.robot_file import open_robot, robot_type
from mam_sim_arm.rollout import Pilot
from mam_sim_arm.safety import Guard, SafetyConfig
from mam_sim_arm.setup import CAMERA, MAPPING, NOMINAL, ROBOT, Twin, guess_mapping
from mam_sim_arm.targets import board_for


def calibrate_setup(
    twin: Twin, setup: Path, robot: Any, guess: JointMapping, poses: int = 16, speed: float = 0.5,
    real_time: bool = True, ask: Callable[[str], None] = lambda _words: None,
    say: Callable[[str], None] = lambda _words: None,
) -> Calibration:  # fmt: skip
    """Move an arm through poses with a board in its hand; write mapping and camera of the set-up.

    Args:
        robot: of LeRobot, not connected. guess: mapping to begin with.
        ask: called before the arm moves, and before the board is wanted in its hand.

    Raises:
        NotPhysicalError: too few poses show the board. CalibrationError: it was not seen well.
    """
    spec, board = twin.spec, board_for(twin.spec.reach)
    nominal = CameraModel.load(setup / NOMINAL)
    arms = board_poses(spec, nominal, board, twin.obstacle(), poses)
    ask("The arm is going to move. Is its space free?")
    robot.connect()
    try:
        arm = Arm(robot, spec, guess, speed, real_time)
        gripper = record_gripper(arm)
        ask("Put the board into the hand, by its edge between the fingers.")
        views = record_views(arm, arms, nominal.name, board, say=say)
        arm.hold()
    finally:
        robot.disconnect()
    scale, offset = guess.arrays(spec.arm)
    found = calibrate(spec.chain, views, nominal, board.mount, np.sign(scale), offset)
    mapping = solved_mapping(spec, guess, found, gripper)
    mapping.save(setup / MAPPING, dict(zip(spec.arm, found.spread.tolist())))
    found.camera.save(setup / CAMERA)
    return found


@contextmanager
def open_pilot(
    run: Path, setup: Path, robot: Path | None = None, safety: SafetyConfig | None = None,
    nominal: bool = False, **changes: Any,
) -> Iterator[Pilot]:  # fmt: skip
    """Connect the arm of a set-up with the policy of a run; the arm holds still at the end.

    Args:
        robot: YAML file; default: the set-up's. nominal: take camera and mapping as meant.
        changes: fields of the robot that go over the file's.

    Raises:
        InputError, ConfigError: something of run or set-up is missing or wrong.
    """
    twin = Twin.load(run)
    file = robot or setup / ROBOT
    kind = robot_type(file)
    camera = CameraModel.load(setup / (NOMINAL if nominal else CAMERA))
    mapping = guess_mapping(twin.spec, None if nominal else setup / MAPPING, kind)
    twin = twin.with_mapping(mapping)
    perceiver, converter = twin.perceiver(setup, camera), twin.converter()
    connected = open_robot(file, **changes)
    connected.connect()
    try:
        # simulated time does not wait
        arm = Arm(connected, twin.spec, mapping, real_time=kind != "mam_sim")
        guard = Guard(twin.layout, safety or SafetyConfig())
        pilot = Pilot(arm, converter, perceiver, guard)
        try:
            yield pilot
        finally:
            arm.hold()
    finally:
        connected.disconnect()
