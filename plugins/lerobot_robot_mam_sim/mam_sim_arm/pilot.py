"""Sessions with a connected arm: calibrating a set-up, and a run on a calibrated one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from mam_pipeline.errors import HintNeeded, NotPhysicalError
from mam_pipeline.types import FloatArray
from mam_policies.lerobot.joint_mapping import JointMapping
from mam_sim_arm.calibration import LEAST, Calibration, calibrate
from mam_sim_arm.camera import CameraModel
from mam_sim_arm.guarded_arm import GuardedArm, connected
from mam_sim_arm.held_key import Key
from mam_sim_arm.perception import Seen
from mam_sim_arm.poses import board_poses
from mam_sim_arm.recording import checked_signs, record_gripper, record_views, solved_mapping
from mam_sim_arm.robot_file import open_robot, robot_type
from mam_sim_arm.rollout import Pilot
from mam_sim_arm.safety import Box, SafetyConfig
from mam_sim_arm.setup import CAMERA, MAPPING, NOMINAL, ROBOT, Twin, guess_mapping
from mam_sim_arm.targets import Board, board_for

Say = Callable[[str], None]
OPEN = 0.1
"""Share of the way to the goal that the part may be open before a policy begins."""
AWAY = 0.5
"""Radians that a joint may be away from rest when a policy begins."""


def calibrate_setup(
    twin: Twin, setup: Path, robot: Any, guess: JointMapping, poses: int = 16, speed: float = 0.5,
    safety: SafetyConfig | None = None, key: Key | None = None,
    ask: Say = lambda _words: None, say: Say = lambda _words: None,
) -> Calibration:  # fmt: skip
    """Move an arm through poses with a board in its hand; write mapping and camera of the set-up.

    Args:
        robot: of LeRobot, not connected. guess: mapping to begin with. speed: share of the usual.
        key: that lets the arm move. ask: called before the arm moves, and before the board is
            wanted in its hand.

    Raises:
        NotPhysicalError: too few poses show the board. CalibrationError: it was not seen well.
        StoppedForSafety: a limit was passed; the arm holds.
    """
    spec, board, obstacle = twin.spec, board_for(twin.spec.reach), twin.obstacle()
    nominal = CameraModel.load(setup / NOMINAL)
    arms = board_poses(spec, nominal, board, obstacle, poses)
    with connected(robot, spec, guess, safety, key, say) as arm:
        ask("The arm is going to move. Is its space free?")
        arm.signs_known = not arm.key.person
        with arm.moving():
            if arm.key.person:
                guess = checked_signs(arm, say)
            arm.allow(arm.now()[None, :-1])
            gripper = record_gripper(arm)
        arms = _clear_ways(arm, arms, board, obstacle)
        ask("Put the board into the hand, by its edge between the fingers.")
        with arm.moving():
            views = record_views(arm, arms, nominal.name, board, speed, say=say)
    scale, offset = guess.arrays(spec.arm)
    found = calibrate(spec.chain, views, nominal, board.mount, np.sign(scale), offset)
    mapping = solved_mapping(spec, guess, found, gripper)
    mapping.save(setup / MAPPING, dict(zip(spec.arm, found.spread.tolist())))
    found.camera.save(setup / CAMERA)
    return found


def _clear_ways(arm: GuardedArm, poses: FloatArray, board: Board, obstacle: Box) -> FloatArray:
    """Poses (P, n) whose straight way from the first is clear, by all shapes; the workspace of
    the arm is round these ways.

    Raises:
        NotPhysicalError: the way to the first is not clear, or too few poses are left.
    """
    start, width, height = arm.now()[:-1], board.columns * board.square, board.rows * board.square
    grid = np.stack(np.meshgrid(np.linspace(0, width, 5), np.linspace(0, height, 5)), axis=-1)
    flat = np.concatenate([grid.reshape(-1, 2), np.zeros((25, 1))], axis=1)
    held = flat @ board.mount[:3, :3].T + board.mount[:3, 3]
    ends = [start, *poses[1:]]
    ways = [np.linspace(poses[0], end, 16) for end in ends]
    space = arm.allow(np.concatenate(ways), start[None], obstacle=obstacle, held=held)
    bad = [float(space.away(way, arm.spec.closed)[0].max()) > 0 for way in ways]
    if bad[0]:
        raise NotPhysicalError(
            "the arm's straight way to its first pose is not clear of the ground and the object; "
            "bring it to rest: mam-sim park"
        )
    if len(poses) - sum(bad) < LEAST:
        raise NotPhysicalError(
            f"only {len(poses) - sum(bad)} poses are clear of the ground and the object; {LEAST} "
            "are needed: move the object away from the arm, or ask for more --poses"
        )
    return np.stack([poses[0], *[p for p, wrong in zip(poses[1:], bad[1:]) if not wrong]])


@contextmanager
def open_pilot(
    run: Path, setup: Path, robot: Path | None = None, safety: SafetyConfig | None = None,
    nominal: bool = False, key: Key | None = None, say: Say = lambda _words: None, **changes: Any,
) -> Iterator[Pilot]:  # fmt: skip
    """Connect the arm of a set-up with the policy of a run, to look; nothing is sent before
    `pilot.arm.engage`.

    Args:
        robot: YAML file; default: the set-up's. nominal: take camera and mapping as meant.
        key: that lets the arm move. changes: fields of the robot that go over the file's.

    Raises:
        InputError, ConfigError: something of run or set-up is missing or wrong.
    """
    twin = Twin.load(run)
    file = robot or setup / ROBOT
    camera = CameraModel.load(setup / (NOMINAL if nominal else CAMERA))
    mapping = guess_mapping(twin.spec, None if nominal else setup / MAPPING, robot_type(file))
    twin = twin.with_mapping(mapping)
    perceiver, converter = twin.perceiver(setup, camera), twin.converter()
    opened = open_robot(file, **changes)
    with connected(opened, twin.spec, mapping, safety, key, say) as arm:
        yield Pilot(arm, converter, perceiver)


def plan_space(pilot: Pilot, twin: Twin, seen: Seen, rehearsed: FloatArray) -> None:
    """The workspace of a run: round the twin's planned way and the rehearsed one (N, n).

    Raises:
        HintNeeded: the part is already open, or the arm is not at rest.
    """
    plan, path = pilot.converter.plan, twin.layout.placement.path
    assert seen.value is not None
    share = (seen.value - plan.closed) / (plan.goal - plan.closed)
    if share > OPEN:
        raise HintNeeded(f"the part stands {100 * share:.0f} % of its way open; put it back first")
    now, spec = pilot.arm.now()[None, :-1], pilot.arm.spec
    off = np.abs(now[0] - spec.rest_arm)
    if off.max() > AWAY:
        raise HintNeeded(
            f"the arm does not stand at rest, where the policy begins: {spec.arm[off.argmax()]} "
            f"is {off.max():.2f} rad off. Bring it there with `mam-sim park`; if it stands there, "
            "a sign or zero in the joint mapping is wrong: run `mam-sim calibrate`"
        )
    way = np.concatenate([now, path.approach, path.follow, rehearsed])
    pilot.arm.allow(way, obstacle=twin.obstacle(seen.object_pose))
