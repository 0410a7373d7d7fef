"""What a camera finds easily: a ChArUco board in the hand, AprilTags on the object."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from mam_envs.convex import ConvexPiece
from mam_envs.object_model import ObjectModel
from mam_pipeline import folders
from mam_pipeline.edited import read_yaml
from mam_pipeline.errors import ConfigError
from mam_pipeline.types import FloatArray

Picture = NDArray[np.uint8]
TAGS = cv2.aruco.DICT_APRILTAG_36h11
MOUNT = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""Board axes in the tool frame: its plate is what the fingers close on, printed side to +y."""


@dataclass(frozen=True)
class Board:
    """A ChArUco board that the hand holds by its edge.

    Attributes:
        columns, rows: squares. square, marker: their sides, metres.
        ahead: metres from the tool's origin to the board's near edge, along the approach.
    """

    columns: int = 5
    rows: int = 4
    square: float = 0.042
    marker: float = 0.033
    ahead: float = 0.02

    @property
    def charuco(self) -> Any:
        """OpenCV's board."""
        words = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
        return cv2.aruco.CharucoBoard((self.columns, self.rows), self.square, self.marker, words)

    @property
    def mount(self) -> FloatArray:
        """(4, 4) tool_T_board as it is meant to be held."""
        out = np.eye(4)
        out[:3, :3] = MOUNT
        out[:3, 3] = [-0.5 * self.columns * self.square, 0.0, self.ahead]
        return out

    def picture(self, pixels: int = 60) -> Picture:
        """(H, W) the board to print; `pixels` a square."""
        size = (self.columns * pixels, self.rows * pixels)
        return np.asarray(self.charuco.generateImage(size), dtype=np.uint8)

    def detect(self, picture: Picture) -> tuple[FloatArray, FloatArray] | None:
        """Corners (K, 3) on the board, metres, and (K, 2) in the picture; None below 6 of them."""
        board = self.charuco
        grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY) if picture.ndim == 3 else picture
        corners, ids, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(grey)
        if ids is None or len(ids) < 6:
            return None
        points = np.asarray(board.getChessboardCorners(), dtype=float)[ids.reshape(-1)]
        return points, np.asarray(corners, dtype=float).reshape(-1, 2)


def board_for(reach: float) -> Board:
    """The board for an arm of a reach (metres): small arms hold a small one."""
    return Board() if reach > 0.5 else Board(square=0.02, marker=0.0155)


@dataclass(frozen=True)
class Marker:
    """An AprilTag (36h11) stuck on a link of the object.

    Attributes:
        id: of the tag. size: side of its black square, metres. link: that it is stuck on.
        pose: (4, 4) asset_T_marker with all joints at rest; x right, y down, z into the surface.
    """

    id: int
    size: float
    link: str
    pose: FloatArray = field(default_factory=lambda: np.eye(4))

    @property
    def corners(self) -> FloatArray:
        """(4, 3) top left, top right, bottom right, bottom left, marker frame."""
        h = 0.5 * self.size
        return np.array([[-h, -h, 0], [h, -h, 0], [h, h, 0], [-h, h, 0]])

    def picture(self, pixels: int = 80) -> Picture:
        """(H, W) the tag's black square to print, a square of `pixels`."""
        words = cv2.aruco.getPredefinedDictionary(TAGS)
        return np.asarray(cv2.aruco.generateImageMarker(words, self.id, pixels), dtype=np.uint8)


def detect_tags(picture: Picture) -> dict[int, FloatArray]:
    """Corners (4, 2) of every AprilTag in a picture, by id; pixels."""
    grey = cv2.cvtColor(picture, cv2.COLOR_RGB2GRAY) if picture.ndim == 3 else picture
    settings = cv2.aruco.DetectorParameters()
    settings.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    words = cv2.aruco.getPredefinedDictionary(TAGS)
    corners, ids, _ = cv2.aruco.ArucoDetector(words, settings).detectMarkers(grey)
    if ids is None:
        return {}
    return {int(i): np.asarray(c, dtype=float).reshape(4, 2) for i, c in zip(ids.ravel(), corners)}


def suggest_markers(model: ObjectModel, joint: str, handle: FloatArray) -> list[Marker]:
    """Where to stick two tags: on the moving part's front beside the handle, and on the body's top.

    Args:
        joint: the one to be operated. handle: (3,) point to grasp, asset frame at rest.
    """
    part, body = model.kinematics.joint(joint).child, model.kinematics.root
    poses = model.kinematics.link_poses({})
    front = max(
        (_box(p, poses[part][0]) for p in model.pieces[part]),
        key=lambda b: (b[1, 1] - b[0, 1]) * (b[1, 2] - b[0, 2]),
    )
    tall, wide = front[1, 2] - front[0, 2], front[1, 1] - front[0, 1]
    size = float(np.clip(0.3 * min(tall, wide), 0.02, 0.08))
    room = 0.7 * size
    corners = [
        (y, z) for y in (front[0, 1] + room, front[1, 1] - room)
        for z in (front[1, 2] - room, front[0, 2] + room)
    ]  # fmt: skip
    # the farthest from the hand, the upper ones first
    y, z = max(corners, key=lambda c: np.hypot(c[0] - handle[1], c[1] - handle[2]) + 0.2 * c[1])
    # seen from the front (-x): right is -y, down is -z, into the surface is +x
    facing = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])
    on_part = _pose(facing, [front[0, 0], y, z])
    low, high = model.footprint
    flat = float(np.clip(0.4 * min(*(high - low)[:2]), 0.03, 0.12))
    down = np.array([[0.0, -1, 0], [-1, 0, 0], [0, 0, -1]])
    middle = 0.5 * (low + high)
    on_top = _pose(down, [middle[0], middle[1], high[2]])
    return [Marker(0, flat, body, on_top), Marker(1, size, part, on_part)]


def save_markers(markers: list[Marker], file: Path) -> None:
    """Write markers as YAML that `load_markers` reads."""
    rows = [
        {"id": m.id, "size": m.size, "link": m.link, "position": m.pose[:3, 3].tolist(),
         "rotation": m.pose[:3, :3].tolist()}
        for m in markers
    ]  # fmt: skip
    head = (
        "# AprilTags (36h11) on the object: asset frame, joints at rest, metres. Columns of the\n"
        "# rotation: the tag's right, its down, into the surface. Measure where you stuck them.\n"
    )
    folders.write_text(file, head + yaml.safe_dump({"markers": rows}, sort_keys=False))


def load_markers(file: Path, model: ObjectModel) -> list[Marker]:
    """Read a marker file.

    Raises:
        ConfigError: it is missing, a value is wrong, or a link is not the object's.
    """
    if not file.is_file():
        raise ConfigError(f"no marker file {file}; mam-sim calibrate --init makes one")
    out = []
    try:
        for row in read_yaml(file).values["markers"]:
            rotation = np.array(row["rotation"], dtype=float).reshape(3, 3)
            pose = _pose(rotation, np.array(row["position"], dtype=float).reshape(3))
            out.append(Marker(int(row["id"]), float(row["size"]), str(row["link"]), pose))
    except (KeyError, TypeError, ValueError) as error:
        raise ConfigError(f"{file} is no marker file: {error}") from None
    for marker in out:
        if marker.link not in model.kinematics.links:
            raise ConfigError(f"{file}: {model.asset.card.name} has no link {marker.link!r}")
    return out


def _pose(rotation: FloatArray, position: Any) -> FloatArray:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation, position
    return out


def _box(piece: ConvexPiece, pose: FloatArray) -> FloatArray:
    points = piece.points @ pose[:3, :3].T + pose[:3, 3]
    return np.stack([points.min(axis=0), points.max(axis=0)])
