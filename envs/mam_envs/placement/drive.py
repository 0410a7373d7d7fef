"""Driving to the object: where a mobile robot begins, where it is to stand, and the way between."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from mam_envs.config import RandomisationConfig
from mam_envs.object_model import ObjectModel
from mam_envs.placement.arm_path import rest_is_clear
from mam_envs.placement.base import base_pose
from mam_envs.placement.settings import PLACEMENT
from mam_envs.robots import RobotSpec
from mam_pipeline.types import FloatArray


def carried(base: FloatArray, nominal: FloatArray, world_asset: FloatArray) -> FloatArray:
    """(4, 4) world_T_base that stands to a displaced object as `base` stands to the nominal one.

    Args:
        base: (4, 4) world_T_base. nominal, world_asset: (4, 4) world_T_asset, both upright.
    """
    out: FloatArray = world_asset @ np.linalg.inv(nominal) @ base
    return out


def begin_at(
    robot: RobotSpec,
    stand: FloatArray,
    handle: FloatArray,
    chance: RandomisationConfig,
    shares: FloatArray,
) -> FloatArray:
    """(4, 4) world_T_base of a robot that is still to drive, facing the handle more or less.

    Args:
        stand: (4, 4) world_T_base where it is to stand. handle: (3,) what it grasps, world.
        shares: (3,) in 0..1: of the distance, the direction and the turn.
    """
    low, high = chance.away
    distance = low + shares[0] * (high - low)
    out_of = stand[:2, 3] - handle[:2]
    bearing = np.arctan2(out_of[1], out_of[0])
    bearing += np.deg2rad(chance.away_angle) * (2 * shares[1] - 1)
    at = handle[:2] + distance * np.array([np.cos(bearing), np.sin(bearing)])
    facing = base_pose(robot, at, float(stand[2, 3]), handle[:2])
    return facing @ planar(0.0, 0.0, float(np.deg2rad(chance.away_turn) * (2 * shares[2] - 1)))


def planar(x: float, y: float, yaw: float) -> FloatArray:
    """(4, 4) motion in the plane: metres and radians."""
    c, s = np.cos(yaw), np.sin(yaw)
    return np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, 0], [0, 0, 0, 1.0]])


def in_plane(pose: FloatArray) -> tuple[float, float, float]:
    """Metres x and y, and yaw in radians, of an upright pose (4, 4)."""
    return float(pose[0, 3]), float(pose[1, 3]), float(np.arctan2(pose[1, 0], pose[0, 0]))


def wrapped(angle: float) -> float:
    """The same angle in -pi..pi."""
    return float((angle + np.pi) % (2 * np.pi) - np.pi)


def way_between(start: FloatArray, stand: FloatArray) -> FloatArray:
    """(N, 4, 4) base poses of the drive: turn on the spot, straight on, turn on the spot."""
    x, y, yaw = in_plane(start)
    to_x, to_y, to_yaw = in_plane(stand)
    heading = float(np.arctan2(to_y - y, to_x - x))
    length = float(np.hypot(to_x - x, to_y - y))
    rows = [(x, y, a) for a in _angles(yaw, heading)]
    count = int(np.ceil(length / PLACEMENT.drive_step)) + 1
    rows += [(x + s * (to_x - x), y + s * (to_y - y), heading) for s in np.linspace(0, 1, count)]
    rows += [(to_x, to_y, a) for a in _angles(heading, to_yaw)]
    out = np.stack([planar(*row) for row in rows])
    out[:, 2, 3] = stand[2, 3]
    return out


def _angles(begin: float, end: float) -> FloatArray:
    turn = wrapped(end - begin)
    count = int(np.ceil(abs(turn) / np.deg2rad(PLACEMENT.drive_turn))) + 1
    return np.asarray(np.linspace(begin, begin + turn, count), np.float64)


def drive_is_clear(
    model: ObjectModel,
    robot: RobotSpec,
    start: FloatArray,
    stand: FloatArray,
    world_asset: FloatArray,
    q: Mapping[str, float],
    noise: FloatArray,
) -> bool:
    """Whether a robot with its arm at rest (plus noise (n,)) keeps clear of the object, and of the
    stand below it, on its way."""
    poses = robot.link_poses((robot.rest_arm + noise)[None], robot.rest.get(robot.gripper[0], 0.0))
    pieces = [p.moved(poses[name][0]) for name, found in robot.pieces.items() for p in found]
    into, room = np.linalg.inv(world_asset), PLACEMENT.drive_room
    return all(
        rest_is_clear(model, robot, base, world_asset, q, noise)
        and not model.cuts_into(pieces, into @ base, q, -room)
        for base in way_between(start, stand)[::-1]  # what is too near is found soonest
    )
