"""Driving a robot of LeRobot slowly through poses, and reading what motors and camera say there."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mam_envs.robots import RobotSpec
from mam_pipeline.errors import ConfigError
from mam_pipeline.types import FloatArray
from mam_policies.lerobot.joint_mapping import UNITS, JointMapping, MotorMap
from mam_sim_arm.calibration import Calibration, View
from mam_sim_arm.targets import Board

Say = Callable[[str], None]
RATE = 20.0
"""Control steps a second."""


class Arm:
    """A connected robot of LeRobot in the simulated robot's joints, by a mapping, maybe a guess."""

    def __init__(
        self, robot: Any, spec: RobotSpec, mapping: JointMapping, speed: float = 0.5,
        real_time: bool = True,
    ) -> None:  # fmt: skip
        """Read the robot once.

        Args:
            speed: share of the robot's usual motion per control step. real_time: keep 20 steps a
                second; a simulated robot need not.
        """
        self.robot, self.spec, self.mapping = robot, spec, mapping
        self.pause = 1.0 / RATE if real_time else 0.0
        self.joints = [*spec.arm, spec.gripper[0]]
        self.names = mapping.names(self.joints)
        self.step = speed * spec.step
        missing = [n for n in self.names if n not in robot.observation_features]
        if missing:
            raise ConfigError(
                f"the robot reports no {', '.join(missing)}; it reports "
                f"{', '.join(robot.observation_features)}. The mapping names its motors"
            )
        self.seen: Mapping[str, Any] = robot.get_observation()
        self.command = self.read(self.names)

    def read(self, names: Sequence[str]) -> FloatArray:
        """(n,) what motors said last, their units."""
        return np.array([float(self.seen[n]) for n in names])

    def send(self, real: FloatArray, read: bool = True) -> None:
        """Send targets (n,) for arm and gripper in motor units, and read again."""
        self.command = np.asarray(real, dtype=float)
        self.robot.send_action({n: float(v) for n, v in zip(self.names, self.command)})
        if read:
            self.seen = self.robot.get_observation()

    def wait(self, since: float) -> bool:
        """Sleep until the control step that began at `since` is over; whether it was late."""
        left = self.pause - (time.perf_counter() - since)
        if self.pause and left > 0:
            time.sleep(left)
        return bool(self.pause) and left < 0

    def begin(self) -> None:
        """Start anew after somebody has put arm and object back. Read twice: to a simulated robot
        that means that the scene was reset."""
        for _ in range(2):
            self.seen = self.robot.get_observation()
        self.command = self.read(self.names)

    def hold(self) -> None:
        """Stay where the arm is."""
        self.send(np.append(self.read(self.names)[:-1], self.command[-1]))

    def move(self, arm: FloatArray, gripper: float, settle: int = 8) -> None:
        """Go straight to arm joints (n,) and a gripper value, slowly, and come to rest there."""
        goal = self.mapping.to_real(self.joints, np.append(arm, gripper))
        scale, _ = self.mapping.arrays(self.joints)
        least = self.step / np.abs(scale)
        least[-1] = np.inf
        steps = max(1, int(np.ceil((np.abs(goal - self.command) / least).max())))
        way = np.linspace(self.command, goal, steps + 1)[1:]
        for row in (*way, *[goal] * settle):
            began = time.perf_counter()
            self.send(row, read=False)
            self.wait(began)


def record_views(
    arm: Arm, poses: FloatArray, camera: str, board: Board, readings: int = 5,
    say: Say = lambda _words: None,
) -> list[View]:  # fmt: skip
    """Go to poses (P, n), by way of the first, and take down motors and board corners at each.

    Args:
        camera: key of the picture in the robot's observation. readings: of the motors, averaged.
    """
    if camera not in arm.robot.observation_features:
        raise ConfigError(f"the robot reports no picture {camera!r}")
    names, spec = arm.mapping.names(arm.spec.arm), arm.spec
    unit = np.abs(arm.mapping.arrays(spec.arm)[0])
    out = []
    arm.move(poses[0], spec.closed)
    for k, pose in enumerate(poses):
        if k:
            arm.move(poses[0], spec.closed, settle=0)
        arm.move(pose, spec.closed)
        rows, found = [], None
        for _ in range(readings):
            arm.send(arm.command)
            rows.append(arm.read(names))
            found = board.detect(arm.seen[camera]) or found
        if found is not None:
            out.append(View(np.mean(rows, axis=0) * unit, *found))
        seen = "no board" if found is None else f"{len(found[0])} corners"
        say(f"pose {k + 1} of {len(poses)}: {seen}")
    arm.move(poses[0], spec.closed)
    return out


def record_gripper(arm: Arm, steps: int = 25) -> dict[str, tuple[float, float]]:
    """Motor values of the gripper's joints with the hand shut and wide open, against its stops.

    Percent are not measured: LeRobot's own calibration has put 0 and 100 at the stops.
    """
    spec, mapping = arm.spec, arm.mapping
    motor = next(m for m in mapping.motors if m.joint == spec.gripper[0])
    listed = [j for j in spec.gripper if j in {m.joint for m in mapping.motors}]
    if motor.unit == "percent":
        return {}
    names, ends = mapping.names(listed), []
    span = (spec.opened - spec.shut) / motor.scale
    shut = (spec.shut - motor.offset) / motor.scale
    for goal in (shut - 2 * span, shut + 3 * span):
        for _ in range(steps):
            began = time.perf_counter()
            arm.send(np.append(arm.command[:-1], goal), read=False)
            arm.wait(began)
        arm.send(arm.command)
        ends.append(arm.read(names))
    arm.send(np.append(arm.command[:-1], shut))
    return {j: (float(a), float(b)) for j, a, b in zip(listed, *ends)}


def solved_mapping(
    spec: RobotSpec, guess: JointMapping, found: Calibration,
    gripper: Mapping[str, tuple[float, float]],
) -> JointMapping:  # fmt: skip
    """The mapping with the arm's signs and offsets, and the gripper's range between its stops."""
    motors = []
    for motor in guess.motors:
        if motor.joint in spec.arm:
            k = spec.arm.index(motor.joint)
            scale = float(found.sign[k]) * UNITS[motor.unit]
            motors.append(replace(motor, scale=scale, offset=float(found.offset[k])))
        else:
            motors.append(_gripper(spec, motor, gripper))
    return JointMapping(guess.robot, tuple(motors))


def _gripper(
    spec: RobotSpec, motor: MotorMap, measured: Mapping[str, tuple[float, float]]
) -> MotorMap:
    """A gripper's motor from its two stops, which the model knows."""
    joint = spec.model.joint(motor.joint)
    stops = sorted((joint.lower, joint.upper), key=lambda v: abs(v - spec.shut))
    if motor.unit == "percent":
        return replace(motor, scale=(stops[1] - stops[0]) / 100.0, offset=stops[0])
    if motor.joint not in measured:
        return motor
    shut, wide = measured[motor.joint]
    turned = (wide - shut) * (stops[1] - stops[0]) < 0
    scale = abs(motor.scale) * (-1.0 if turned else 1.0)
    offset = 0.5 * (stops[0] + stops[1]) - scale * 0.5 * (shut + wide)
    return replace(motor, scale=scale, offset=offset)
