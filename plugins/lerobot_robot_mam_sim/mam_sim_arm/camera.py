"""A fixed camera as OpenCV describes it, and where it stands in the robot's base frame."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from mam_pipeline import folders
from mam_pipeline.edited import read_yaml
from mam_pipeline.errors import ConfigError
from mam_pipeline.types import FloatArray


@dataclass(frozen=True)
class CameraModel:
    """A pinhole camera with lens distortion; frame: x right, y down, z forward.

    Attributes:
        name: key of its picture in the robot's observation.
        size: width and height, pixels. matrix: (3, 3). distortion: (5,) k1 k2 p1 p2 k3.
        pose: (4, 4) base_T_camera, metres.
        residual: root mean square error of the calibration, pixels; None: a guess.
    """

    name: str
    size: tuple[int, int]
    matrix: FloatArray
    distortion: FloatArray
    pose: FloatArray
    residual: float | None = None

    def project(self, points: FloatArray) -> FloatArray:
        """(N, 2) pixels of points (N, 3) in the base frame."""
        inside = np.linalg.inv(self.pose)
        out, _ = cv2.projectPoints(
            np.asarray(points, dtype=float), cv2.Rodrigues(inside[:3, :3])[0], inside[:3, 3],
            self.matrix, self.distortion,
        )  # fmt: skip
        return np.asarray(out.reshape(-1, 2), dtype=float)

    def save(self, file: Path) -> None:
        """Write the camera as YAML that `load` reads."""
        m = self.matrix
        data: dict[str, Any] = {
            "camera": self.name,
            "size": list(self.size),
            "focal": [float(m[0, 0]), float(m[1, 1])],
            "centre": [float(m[0, 2]), float(m[1, 2])],
            "distortion": [float(v) for v in self.distortion],
            "position": [float(v) for v in self.pose[:3, 3]],
            "rotation": self.pose[:3, :3].tolist(),
            "residual_px": self.residual,
        }
        head = "# Camera in the robot's base frame (x right, y down, z forward); metres, pixels.\n"
        folders.write_text(file, head + yaml.safe_dump(data, sort_keys=False))

    @staticmethod
    def load(file: Path) -> CameraModel:
        """Read a camera file.

        Raises:
            ConfigError: it is missing, or a value is missing or of the wrong shape.
        """
        if not file.is_file():
            raise ConfigError(f"no camera file {file}; mam-sim calibrate makes one")
        data = read_yaml(file).values
        try:
            (fx, fy), (cx, cy) = data["focal"], data["centre"]
            pose = np.eye(4)
            pose[:3, :3] = np.array(data["rotation"], dtype=float).reshape(3, 3)
            pose[:3, 3] = np.array(data["position"], dtype=float).reshape(3)
            width, height = (int(v) for v in data["size"])
            residual = data.get("residual_px")
            return CameraModel(
                str(data["camera"]), (width, height),
                np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]], dtype=float),
                np.array(data["distortion"], dtype=float).reshape(5), pose,
                None if residual is None else float(residual),
            )  # fmt: skip
        except (KeyError, TypeError, ValueError) as error:
            raise ConfigError(f"{file} is no camera file: {error}") from None


def look_at(eye: FloatArray, target: FloatArray) -> FloatArray:
    """(4, 4) pose of a camera at `eye` (3,) that looks at `target` (3,), upright (z is up)."""
    forward = (target - eye) / np.linalg.norm(target - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    pose[:3, 3] = eye
    return pose


def pinhole(name: str, size: tuple[int, int], fov: float, pose: FloatArray) -> CameraModel:
    """A camera without distortion; `fov`: vertical, degrees."""
    focal = 0.5 * size[1] / np.tan(0.5 * np.deg2rad(fov))
    matrix = np.array([[focal, 0, 0.5 * size[0]], [0, focal, 0.5 * size[1]], [0, 0, 1.0]])
    return CameraModel(name, size, matrix, np.zeros(5), pose)
