"""A camera that sees what calibration and perception look for, without a renderer.

Tags and board are drawn by projection, with a lens, blur and noise; links of the arm that stand
nearer to the camera hide them. All else is a plain ground.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from mam_sim_arm.camera import CameraModel
from mam_sim_arm.targets import Picture, board_for, load_markers
from mani_skill.utils import common
from scipy.spatial.transform import Rotation

from mam_pipeline.types import FloatArray

GROUND, ARM, NOISE, QUIET = 150, 205, 3.0, 0.25
"""Grey of the ground and of the arm, noise (grey levels), and a target's white rim (share)."""


@dataclass(frozen=True)
class Flat:
    """A picture on a plane: `corners` (4, 3) of it in the frame of a link, from the top left on."""

    picture: Picture
    corners: FloatArray
    link: Any


class SimulatedCamera:
    """What one fixed camera sees of one environment.

    Attributes:
        nominal: as the file says. true: as it is.
    """

    def __init__(
        self, base: Any, file: Path, markers: Path | None, board: bool, error: float, seed: int
    ) -> None:
        """`error`: metres off the file's position; `seed`: of its direction, lens and noise."""
        self.base, self.nominal = base, CameraModel.load(file)
        self.rng = np.random.default_rng([seed, 2])
        self.true = _off(self.nominal, error, np.random.default_rng([seed, 3]))
        self.markers = None if markers is None else load_markers(markers, base.layout(0).model)
        self.seat = None
        if board:
            held = board_for(base.robot_spec.reach)
            wobble = np.eye(4)
            turn = self.rng.normal(0, 0.1 * error, 3)
            wobble[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
            wobble[:3, 3] = self.rng.normal(0, 0.05 * error, 3)
            self.seat = (held, held.mount @ wobble)
        self.maps: Any = cv2.convertMaps(*_lens(self.true), cv2.CV_16SC2)
        height, width = self.true.size[::-1]
        self.grain = self.rng.normal(0, NOISE, (2 * height, 2 * width)).astype(np.int16)

    def shoot(self) -> Picture:
        """(H, W, 3) uint8 picture now."""
        width, height = self.true.size
        grey = np.full((height, width), GROUND, np.uint8)
        inside = np.asarray(np.linalg.inv(self._world() @ self.true.pose), dtype=np.float64)
        things: list[tuple[float, Any]] = []
        for flat in self._flats():
            pose = inside @ _pose_of(flat.link)
            corners = flat.corners @ pose[:3, :3].T + pose[:3, 3]
            normal = np.cross(corners[1] - corners[0], corners[3] - corners[0])
            if corners[:, 2].min() > 0.05 and corners.mean(axis=0) @ normal > 0:
                things.append((float(corners.mean(axis=0)[2]), (flat.picture, corners)))
        if things:
            things += self._arm(inside)
        for _, thing in sorted(things, key=lambda row: -row[0]):
            if isinstance(thing, tuple):
                self._paint(grey, *thing)
            else:
                cv2.fillConvexPoly(grey, thing, ARM)
        x_map, y_map = self.maps
        seen = cv2.remap(grey, x_map, y_map, cv2.INTER_LINEAR, borderValue=GROUND)
        y, x = (int(self.rng.integers(n)) for n in seen.shape)  # another piece of the grain
        grain = self.grain[y : y + height, x : x + width]
        noisy = cv2.add(cv2.GaussianBlur(seen, (0, 0), 0.6), grain, dtype=cv2.CV_8U)
        return np.asarray(cv2.cvtColor(noisy, cv2.COLOR_GRAY2RGB))

    def hide_part(self) -> None:
        """Take the tags off the part that moves."""
        root = self.base.layout(0).model.kinematics.root
        self.markers = [m for m in self.markers or () if m.link == root]

    def _world(self) -> FloatArray:
        return np.asarray(self.base.layout(0).placement.base, dtype=float)

    def _flats(self) -> list[Flat]:
        """Tags on the object, and the board in the hand."""
        out = []
        model, links = self.base.layout(0).model, self.base.objects[0].links_map
        rest = model.kinematics.link_poses({})
        for marker in self.markers or ():
            local = np.linalg.inv(rest[marker.link][0]) @ marker.pose
            rim = marker.corners * (1 + 2 * QUIET)
            picture = np.pad(marker.picture(80), int(80 * QUIET), constant_values=255)
            corners = rim @ local[:3, :3].T + local[:3, 3]
            out.append(Flat(picture, corners, links[marker.link]))
        if self.seat is not None:
            board, seat = self.seat
            w, h = board.columns * board.square, board.rows * board.square
            corners = np.array([[0, 0, 0], [w, 0, 0], [w, h, 0], [0, h, 0]])
            tool = self.base.robot_spec.chain.tool @ seat
            out.append(Flat(board.picture(), corners @ tool[:3, :3].T + tool[:3, 3],
                            self.base.agent.robot.links_map[self.base.robot_spec.tip]))  # fmt: skip
        return out

    def _arm(self, inside: FloatArray) -> list[tuple[float, Any]]:
        """(depth, outline) of the arm's convex shapes."""
        out = []
        for name, hulls in self.base.robot_spec.hulls.items():
            link = self.base.agent.robot.links_map.get(name)
            for hull in hulls if link is not None else ():
                pose = inside @ _pose_of(link)
                points = np.asarray(hull.vertices) @ pose[:3, :3].T + pose[:3, 3]
                if points[:, 2].min() > 0.05:
                    flat = points @ self.true.matrix.T
                    pixel = (flat[:, :2] / flat[:, 2:]).round().astype(np.int32)
                    out.append((float(points[:, 2].mean()), cv2.convexHull(pixel)))
        return out

    def _paint(self, grey: Picture, picture: Picture, corners: FloatArray) -> None:
        """Draw a flat picture at corners (4, 3), camera frame, anti-aliased."""
        flat = corners @ self.true.matrix.T
        pixel = flat[:, :2] / flat[:, 2:]
        low = np.floor(pixel.min(axis=0)).astype(int) - 2
        high = np.ceil(pixel.max(axis=0)).astype(int) + 3
        low, high = np.maximum(low, 0), np.minimum(high, grey.shape[::-1])
        if (high - low < 4).any():
            return
        fine, size = 3, high - low
        h, w = picture.shape
        source = np.array([[0, 0], [w, 0], [w, h], [0, h]], np.float32) - 0.5
        target = ((pixel - low + 0.5) * fine - 0.5).astype(np.float32)
        turn = cv2.getPerspectiveTransform(source, target)
        shape = (int(size[0]) * fine, int(size[1]) * fine)
        drawn = cv2.warpPerspective(picture, turn, shape, flags=cv2.INTER_LINEAR)
        cover = cv2.warpPerspective(np.full_like(picture, 255), turn, shape)
        small = (int(size[0]), int(size[1]))
        drawn = cv2.resize(drawn, small, interpolation=cv2.INTER_AREA)
        share = cv2.resize(cover, small, interpolation=cv2.INTER_AREA) / 255.0
        here = grey[low[1] : high[1], low[0] : high[0]]
        here[:] = np.clip(here * (1 - share) + drawn, 0, 255).astype(np.uint8)


def _pose_of(link: Any) -> FloatArray:
    return np.asarray(common.to_numpy(link.pose.to_transformation_matrix())[0], dtype=float)


def _off(camera: CameraModel, error: float, rng: np.random.Generator) -> CameraModel:
    """A camera that is not where and what its file says."""
    if error <= 0:
        return camera
    away = rng.normal(size=3)
    pose = camera.pose.copy()
    pose[:3, 3] += error * away / np.linalg.norm(away)
    pose[:3, :3] = pose[:3, :3] @ Rotation.from_rotvec(rng.normal(0, 0.5 * error, 3)).as_matrix()
    matrix = camera.matrix.copy()
    matrix[[0, 1], [0, 1]] *= 1 + rng.normal(0, 0.5 * error)
    distortion = np.array([-2.0, 0.5, 0, 0, 0]) * error
    return CameraModel(camera.name, camera.size, matrix, distortion, pose)


def _lens(camera: CameraModel) -> tuple[Any, Any]:
    """Where each pixel of the lens's picture lies in the pinhole's, (H, W) float32 each."""
    width, height = camera.size
    grid = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1)
    flat = cv2.undistortPoints(
        grid.reshape(-1, 1, 2).astype(np.float64), camera.matrix, camera.distortion,
        P=camera.matrix,
    )  # fmt: skip
    where = flat.reshape(height, width, 2).astype(np.float32)
    return where[..., 0], where[..., 1]
