"""Arm poses at which a board in the hand faces the camera, clear of object and ground."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from scipy.spatial.transform import Rotation

from mam_envs.robots import RobotSpec
from mam_pipeline.errors import NotPhysicalError
from mam_pipeline.types import FloatArray
from mam_sim_arm.camera import CameraModel
from mam_sim_arm.safety import Box
from mam_sim_arm.targets import Board

SLANT = 0.55
"""Least cosine between the board's normal and the view."""
ROOM = 0.08
"""Distance to the object as a share of the arm's reach; half of it to the ground."""


def board_poses(
    robot: RobotSpec, camera: CameraModel, board: Board, obstacle: Box, count: int = 16,
    spread: float = 0.7, seed: int = 0,
) -> FloatArray:  # fmt: skip
    """(count, n) arm joints, as different as can be; the straight way between the first and each
    other is clear too.

    Args:
        camera: a guess will do. obstacle: the object.
        spread: standard deviation of the joints round the arm's rest, radians.

    Raises:
        NotPhysicalError: too few poses are in sight of the camera.
    """
    rng = np.random.default_rng(seed)
    limits = robot.chain.limits
    wide = np.clip(
        robot.rest_arm + rng.normal(0, spread, (30_000, len(robot.arm))), limits[:, 0], limits[:, 1]
    )
    seen = wide[_in_sight(robot, camera, board, wide)]
    seen = seen[_clear(robot, seen, obstacle, board)]
    if len(seen) < count:
        raise NotPhysicalError(
            f"only {len(seen)} poses of the arm show the board to the camera; {count} are needed: "
            "let it look at the hand from the side or from above"
        )
    rotation, position, _ = robot.chain.forward(seen)
    turn = Rotation.from_matrix(rotation).as_rotvec()
    # what tells joints and camera apart are turns of the board; places matter less
    features = np.concatenate([seen, turn, 2 * position], axis=1)
    chosen = [int(np.linalg.norm(seen - robot.rest_arm, axis=1).argmin())]
    away = np.linalg.norm(features - features[chosen[0]], axis=1)
    while len(chosen) < count and away.max() > 0:
        k = int(away.argmax())
        home = seen[chosen[0]]
        straight = np.linspace(0, 1, 12)[:, None] * (seen[k] - home) + home
        if _clear(robot, straight, obstacle, board).all():
            chosen.append(k)
            away = np.minimum(away, np.linalg.norm(features - features[k], axis=1))
        away[k] = 0.0
    if len(chosen) < count:
        raise NotPhysicalError("the ways to poses in sight of the camera lead through the object")
    return np.asarray(seen[chosen])


def _in_sight(robot: RobotSpec, camera: CameraModel, board: Board, arm: FloatArray) -> np.ndarray:
    """(N,) whether all of the board is in the picture and faces the camera."""
    rotation, position, _ = robot.chain.forward(arm)
    seat = board.mount
    turn = rotation @ seat[:3, :3]
    origin = np.einsum("nij,j->ni", rotation, seat[:3, 3]) + position
    width, height = board.columns * board.square, board.rows * board.square
    corners = np.array([[0, 0, 0], [width, 0, 0], [width, height, 0], [0, height, 0]])
    world = np.einsum("nij,kj->nki", turn, corners) + origin[:, None]
    inside = np.linalg.inv(camera.pose)
    local = world @ inside[:3, :3].T + inside[:3, 3]
    ok = (local[..., 2] > 0.2).all(axis=1)
    flat = local[..., :2] / np.maximum(local[..., 2:], 1e-6)
    pixel = flat * camera.matrix[[0, 1], [0, 1]] + camera.matrix[:2, 2]
    margin = 0.05 * np.array(camera.size)
    ok &= ((pixel > margin) & (pixel < np.array(camera.size) - margin)).all(axis=(1, 2))
    view = world.mean(axis=1) - camera.pose[:3, 3]
    view /= np.linalg.norm(view, axis=1, keepdims=True)
    return np.asarray(ok & (np.einsum("ni,ni->n", view, turn[:, :, 2]) > SLANT))


def _clear(robot: RobotSpec, arm: FloatArray, obstacle: Box, board: Board) -> np.ndarray:
    """(N,) whether links, hand and board stay off the ground and the object."""
    if not len(arm):
        return np.zeros(0, dtype=bool)
    rotation, position, _ = robot.chain.forward(arm)
    reach = board.ahead + board.rows * board.square
    tips = [position + a * reach * rotation[:, :, 2] for a in (0.0, 0.5, 1.0)]
    half = 0.5 * board.columns * board.square
    tips += [tips[2] + s * half * rotation[:, :, 0] for s in (-1, 1)]
    tips += [position - 0.1 * rotation[:, :, 2]]
    poses = robot.link_poses(arm, robot.closed)
    links = [poses[name][:, :3, 3] for name in robot.swinging if name in poses]
    room = ROOM * robot.reach
    chain = [poses[j.child][:, :3, 3] for j in robot.chain.joints if j.child in poses]
    links += [0.5 * (a + b) for a, b in pairwise(chain)]
    early = chain[: len(chain) // 3]  # base and shoulder
    ok = np.ones(len(arm), dtype=bool)
    for points in (*tips, *links):
        ok &= obstacle.depth(points) < -room
    for points in tips:
        ok &= points[:, 2] > 0.5 * room
        for link in early:  # the arm's own body
            ok &= np.linalg.norm(points - link, axis=1) > 0.25 * robot.reach
    return ok
