"""Driving an arm slowly through poses, and reading what motors and camera say there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from mam_envs.robots import RobotSpec
from mam_pipeline.errors import ConfigError
from mam_pipeline.types import FloatArray
from mam_policies.lerobot.joint_mapping import UNITS, JointMapping, MotorMap
from mam_sim_arm.calibration import LEAST, Calibration, View
from mam_sim_arm.guarded_arm import GuardedArm
from mam_sim_arm.safety import StoppedForSafety
from mam_sim_arm.targets import Board, detect_tags

Say = Callable[[str], None]
WIGGLE = 0.12
"""Radians that a joint turns for somebody to see which way."""


def record_views(
    arm: GuardedArm, poses: FloatArray, camera: str, board: Board, share: float = 0.5,
    readings: int = 5, say: Say = lambda _words: None,
) -> list[View]:  # fmt: skip
    """Go to poses (P, n), by way of the first, and take down motors and board corners at each.

    Args:
        camera: key of the picture in the robot's observation. share: of the usual speed.
        readings: of the motors, averaged.

    Raises:
        StoppedForSafety: the board has left the hand, or object or camera were moved.
    """
    if camera not in arm.seen:
        raise ConfigError(f"the robot reports no picture {camera!r}")
    arm.watched = camera
    names, spec = arm.mapping.names(arm.spec.arm), arm.spec
    unit = np.abs(arm.mapping.arrays(spec.arm)[0])
    out: list[View] = []
    arm.move(poses[0], spec.closed, share)
    before = detect_tags(arm.seen[camera])
    for k, pose in enumerate(poses):
        if k:
            arm.move(poses[0], spec.closed, share, settle=0)
        arm.move(pose, spec.closed, share)
        rows, found = [], None
        for _ in range(readings):
            arm.go(np.append(pose, spec.closed))
            rows.append(arm.read(names))
            found = board.detect(arm.seen[camera]) or found
        if found is not None:
            out.append(View(np.mean(rows, axis=0) * unit, *found))
        seen = "no board" if found is None else f"{len(found[0])} corners"
        say(f"pose {k + 1} of {len(poses)}: {seen}")
        before = _unmoved(before, detect_tags(arm.seen[camera]), arm.config.shifted)
        left = len(poses) - k - 1
        if found is None and len(out) + left < LEAST:
            raise StoppedForSafety(
                f"the board was found at {len(out)} of {k + 1} poses, and {LEAST} are needed: see "
                "whether it still sits in the hand, light it evenly, and let it face the camera"
            )
    arm.move(poses[0], spec.closed, share)
    return out


def _unmoved(
    before: Mapping[int, FloatArray], now: Mapping[int, FloatArray], most: float
) -> dict[int, FloatArray]:
    """The first corners (4, 2) in the picture of every tag on the object, by id.

    Raises:
        StoppedForSafety: a tag is more than `most` pixels from there.
    """
    for tag in set(before) & set(now):
        off = float(np.linalg.norm(now[tag] - before[tag], axis=1).mean())
        if off > most:
            raise StoppedForSafety(
                f"tag {tag} is seen {off:.0f} pixels from where it was: object or camera was "
                "moved. Fix both, and calibrate again"
            )
    return {**now, **before}


def record_gripper(arm: GuardedArm, steps: int = 100) -> dict[str, tuple[float, float]]:
    """Motor values of the gripper's joints with the hand shut and wide open, against its stops.

    Its target is never more than a fifth of its range ahead, so that it does not press hard.
    Percent are not measured: LeRobot's own calibration has put 0 and 100 at the stops.
    """
    spec, mapping = arm.spec, arm.mapping
    motor = next(m for m in mapping.motors if m.joint == spec.gripper[0])
    listed = [j for j in spec.gripper if j in {m.joint for m in mapping.motors}]
    if motor.unit == "percent":
        return {}
    names, ends, rest = mapping.names(listed), [], arm.now()[:-1]
    ahead = 0.2 * (spec.opened - spec.shut)
    for way in (-ahead, ahead):
        still = 0
        for k in range(steps):
            before = arm.now()[-1]
            arm.go(np.append(rest, before + way))
            still = still + 1 if abs(arm.now()[-1] - before) < 0.25 * abs(ahead) else 0
            if k > 15 and still > 8:
                break
        ends.append(arm.read(names))
    for _ in range(15):  # shut again, for the board
        arm.go(np.append(rest, arm.now()[-1] - ahead))
    return {j: (float(a), float(b)) for j, a, b in zip(listed, *ends)}


def checked_signs(arm: GuardedArm, say: Say) -> JointMapping:
    """Turn one joint after the other a little; the person at the key says which way it went.

    Signs that were wrong are turned in the mapping of the arm, which is returned.

    Raises:
        StoppedForSafety: a joint does not turn; or, with right signs, it is read out of its range.
    """
    spec = arm.spec
    for k, name in enumerate(spec.arm):
        arm.allow_turn(1.5 * WIGGLE)
        now = arm.now()
        goal = now.copy()
        goal[k] += WIGGLE if now[k] + WIGGLE < spec.chain.limits[k, 1] else -WIGGLE
        arm.move(goal[:-1], now[-1])
        turned = abs(float(arm.now()[k] - now[k]))
        arm.move(now[:-1], now[-1])
        if turned < 0.5 * WIGGLE:  # asked about it, one would say that it went the wrong way
            raise StoppedForSafety(
                f"{name} was to turn by {np.degrees(WIGGLE):.0f} degrees and is read to have "
                f"turned by {np.degrees(turned):.0f}: its motor is dead, or something holds it. "
                "Free the arm, and check the motor's cable"
            )
        say(f"{name}: did {_motion(spec, now[:-1], goal[:-1])} first? y or n")
        while (pressed := arm.key.wait()) not in ("y", "n"):
            pass
        if pressed == "n":
            motors = [
                replace(m, scale=-m.scale) if m.joint == name else m for m in arm.mapping.motors
            ]
            arm.remap(JointMapping(arm.mapping.robot, tuple(motors)))
            say(f"{name} counts the other way; its sign is turned")
        say("Hold the space bar down again.")
        arm.key.wait()
    arm.check_ranges("run lerobot-calibrate again, from the middle of all ranges")
    arm.signs_known = True
    return arm.mapping


def _motion(spec: RobotSpec, before: FloatArray, after: FloatArray) -> str:
    """Which way the hand goes, in words, from arm joints (n,) to others."""
    rotation, position, _ = spec.chain.forward(np.stack([before, after]))
    turned, gone = np.array([np.cos(spec.forward), np.sin(spec.forward)]), position[1] - position[0]
    ahead, left = gone[:2] @ turned, gone[1] * turned[0] - gone[0] * turned[1]
    ways = {"up": gone[2], "down": -gone[2], "ahead": ahead, "back": -ahead, "left": left,
            "right": -left}  # fmt: skip
    word = max(ways, key=lambda name: float(ways[name]))
    if ways[word] > 0.005:
        return f"the hand go {word} (as seen from behind the arm)"
    turn = Rotation.from_matrix(rotation[0].T @ rotation[1]).as_rotvec()[2]
    return f"the hand turn {'' if turn > 0 else 'counter-'}clockwise (as seen from behind it)"


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
