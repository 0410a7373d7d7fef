"""Joint mapping and camera from pictures of a board in the hand, at a dozen poses of the arm.

Unknown are the sign and zero of every motor, the camera's lens and place, and how the board sits in
the hand. All of them together decide where the board's corners are seen; the squared error of the
corners is made least. The zero of the arm's first joint cannot be told from the camera's place, and
need not: what the camera sees turns with it. That of the last joint is told from the board's seat.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import cv2
import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from mam_envs.kinematics import Chain
from mam_pipeline.errors import MamSimError
from mam_pipeline.types import FloatArray
from mam_sim_arm.camera import CameraModel

FITS, TRIES = 5.0, 12
"""Pixels off, root mean square, within which signs are right; how many of them are tried."""
LEAST = 8
"""Poses with a board in sight that are needed."""
SIGMA_PIXEL, SIGMA_ZERO, SIGMA_SEAT = 0.5, 0.3, (0.02, 0.004)
"""Standard deviations: a corner's error in pixels; how far a zero may be from the given one,
radians; how far the board's seat may be from the meant one, radians and metres."""

SIGMA_LENS = np.array([0.02, 0.02, 20.0, 20.0, 0.05, 0.05])
"""How far the lens may be from what the board alone says: shares, pixels, and k1, k2."""


class CalibrationError(MamSimError):
    """The pictures do not decide what is asked; the message says why."""


@dataclass(frozen=True)
class View:
    """One pose: motor values (n,) of the arm, radians as they count; board corners (K, 3), metres,
    and where they are seen (K, 2), pixels."""

    motors: FloatArray
    corners: FloatArray
    pixels: FloatArray


@dataclass(frozen=True)
class Calibration:
    """The result: sim = sign * motor + offset.

    Attributes:
        sign, offset: (n,) of the arm's joints; offsets in radians. spread: (n,) standard error of
            the offsets, radians.
        camera: with its residual. seat: (4, 4) tool_T_board.
    """

    sign: FloatArray
    offset: FloatArray
    spread: FloatArray
    camera: CameraModel
    seat: FloatArray


def calibrate(
    chain: Chain, views: Sequence[View], guess: CameraModel, seat: FloatArray,
    sign: FloatArray, offset: FloatArray,
) -> Calibration:  # fmt: skip
    """Solve for mapping and camera.

    Args:
        chain: of the arm. guess: the camera's size and a rough lens. seat: (4, 4) tool_T_board as
            it is meant. sign, offset: (n,) of the mapping to begin with.

    Raises:
        CalibrationError: too few views, or no solution fits them.
    """
    if len(views) < LEAST:
        raise CalibrationError(
            f"the board was found at {len(views)} poses; at least {LEAST} are needed: light it "
            "evenly, and let it face the camera"
        )
    matrix, distortion, boards = _lens(views, guess)
    motors = np.stack([v.motors for v in views])
    best: tuple[float, FloatArray, Any, _Problem] | None = None
    for tried in _signs(chain, motors, boards, sign, offset):
        problem = _Problem(chain, views, motors, tried, offset, matrix, distortion, seat)
        # corners that were found badly pull little
        x = least_squares(
            problem.errors, problem.start(boards), loss="soft_l1", x_scale="jac", max_nfev=60
        )
        off = float(np.sqrt((problem.reprojection(x.x) ** 2).sum(axis=1).mean()))
        if best is None or off < best[0]:
            best = off, tried, x, problem
        if off < FITS:
            break
    assert best is not None
    residual, sign, found, problem = best
    n = len(sign)
    if residual > FITS:
        raise CalibrationError(
            f"the arm's model does not explain the pictures ({residual:.1f} pixels off); is the "
            "board's size right, and does it sit firmly in the hand?"
        )
    spread = np.sqrt(np.diag(np.linalg.pinv(found.jac.T @ found.jac)))[:n]
    pose = np.asarray(np.linalg.inv(_matrix(found.x[n : n + 6])), dtype=np.float64)
    matrix, distortion = problem.lens(found.x)
    camera = CameraModel(guess.name, guess.size, matrix, distortion, pose, residual)
    return Calibration(sign, offset + found.x[:n], spread, camera, problem.seat_of(found.x))


def _lens(views: Sequence[View], guess: CameraModel) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Camera matrix, distortion (5,), and camera_T_board (P, 4, 4) of every view."""
    _, matrix, distortion, turns, shifts = cv2.calibrateCamera(
        [v.corners.astype(np.float32) for v in views], [v.pixels.astype(np.float32) for v in views],
        guess.size, guess.matrix.copy(), guess.distortion.copy(),
        flags=cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_K3,
    )  # fmt: skip
    boards = np.tile(np.eye(4), (len(views), 1, 1))
    for k, (turn, shift) in enumerate(zip(turns, shifts)):
        boards[k, :3, :3], boards[k, :3, 3] = cv2.Rodrigues(turn)[0], shift.reshape(3)
    lens = np.asarray(matrix, dtype=np.float64), np.asarray(distortion, dtype=np.float64)
    return lens[0], lens[1].reshape(-1)[:5], boards


def _signs(
    chain: Chain, motors: FloatArray, boards: FloatArray, given: FloatArray, offset: FloatArray
) -> Iterator[FloatArray]:
    """Signs to try: those given, then those with which the hand turns as much as the board does.

    How far a body turns between two poses does not depend on the camera or on the board's seat. It
    does not tell an arm from its mirror image either, so that several must be tried.
    """
    yield given
    seen = _turns(boards[:, :3, :3])
    rows = [np.array(signs) for signs in product((1.0, -1.0), repeat=len(given))]
    rows.sort(key=lambda signs: _mismatch(chain, motors, signs, offset, seen))
    yield from rows[:TRIES]


def _mismatch(
    chain: Chain, motors: FloatArray, sign: FloatArray, offset: FloatArray, seen: FloatArray
) -> float:
    rotation, _, _ = chain.forward(motors * sign + offset)
    return float(np.median(np.abs(_turns(rotation) - seen)))


def _turns(rotation: FloatArray) -> FloatArray:
    """(P * (P - 1) / 2,) angles between rotations (P, 3, 3), radians."""
    a, b = np.triu_indices(len(rotation), 1)
    between = np.einsum("kji,kjl->kil", rotation[a], rotation[b])
    trace = np.trace(between, axis1=1, axis2=2)
    return np.asarray(np.arccos(np.clip(0.5 * (trace - 1), -1, 1)))


class _Problem:
    """Parameters: offsets' changes (n,), camera_T_base (6,), the seat's change (6,), the lens's
    (focal lengths as shares, centre in pixels, k1, k2)."""

    def __init__(
        self, chain: Chain, views: Sequence[View], motors: FloatArray, sign: FloatArray,
        offset: FloatArray, matrix: FloatArray, distortion: FloatArray, seat: FloatArray,
    ) -> None:  # fmt: skip
        self.chain, self.base, self.seat = chain, motors * sign + offset, seat
        self.matrix, self.distortion, self.n = matrix, distortion, len(sign)
        self.which = np.concatenate([np.full(len(v.corners), k) for k, v in enumerate(views)])
        self.corners = np.concatenate([v.corners for v in views])
        self.pixels = np.concatenate([v.pixels for v in views])

    def start(self, boards: FloatArray) -> FloatArray:
        """No change, and the camera where the boards would be as the hand is."""
        inside = boards @ np.linalg.inv(self._hands(np.zeros(self.n)) @ self.seat)
        mean = np.eye(4)
        mean[:3, :3] = Rotation.from_matrix(inside[:, :3, :3]).mean().as_matrix()
        mean[:3, 3] = np.median(inside[:, :3, 3], axis=0)
        turn = Rotation.from_matrix(mean[:3, :3]).as_rotvec()
        return np.concatenate([np.zeros(self.n), turn, mean[:3, 3], np.zeros(12)])

    def seat_of(self, x: FloatArray) -> FloatArray:
        """(4, 4) tool_T_board."""
        return np.asarray(self.seat @ _matrix(x[self.n + 6 : self.n + 12]))

    def lens(self, x: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Camera matrix (3, 3) and distortion (5,)."""
        fx, fy, cx, cy, k1, k2 = x[self.n + 12 :]
        matrix, distortion = self.matrix.copy(), self.distortion.copy()
        matrix[[0, 1], [0, 1]] *= 1.0 + np.array([fx, fy])
        matrix[:2, 2] += [cx, cy]
        distortion[:2] += [k1, k2]
        return matrix, distortion

    def reprojection(self, x: FloatArray) -> FloatArray:
        """(K, 2) pixels between where corners should be seen and where they are."""
        boards = self._hands(x[: self.n]) @ self.seat_of(x)
        poses = boards[self.which]
        at = np.einsum("kij,kj->ki", poses[:, :3, :3], self.corners) + poses[:, :3, 3]
        turn, shift = x[self.n : self.n + 3], x[self.n + 3 : self.n + 6]
        seen, _ = cv2.projectPoints(at, turn, shift, *self.lens(x))
        return np.asarray(seen.reshape(-1, 2) - self.pixels)

    def errors(self, x: FloatArray) -> FloatArray:
        """Everything in standard deviations."""
        seat = x[self.n + 6 : self.n + 12] / np.repeat(SIGMA_SEAT, 3)
        pixels = self.reprojection(x).reshape(-1) / SIGMA_PIXEL
        lens = x[self.n + 12 :] / SIGMA_LENS
        return np.concatenate([pixels, x[: self.n] / SIGMA_ZERO, seat, lens])

    def _hands(self, change: FloatArray) -> FloatArray:
        """(P, 4, 4) base_T_tool."""
        rotation, position, _ = self.chain.forward(self.base + change)
        out = np.tile(np.eye(4), (len(position), 1, 1))
        out[:, :3, :3], out[:, :3, 3] = rotation, position
        return out


def _matrix(six: FloatArray) -> FloatArray:
    """(4, 4) of a rotation vector and a shift."""
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = Rotation.from_rotvec(six[:3]).as_matrix(), six[3:]
    return out
