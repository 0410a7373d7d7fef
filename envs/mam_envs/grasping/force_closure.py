"""Force closure: the pull that two fingers bear, from where and how they meet the part."""

from __future__ import annotations

import numpy as np

from mam_envs.convex import ConvexPiece
from mam_envs.grasping.limits import LIMITS
from mam_envs.object_model import ObjectModel
from mam_envs.robots import RobotSpec
from mam_pipeline.types import FloatArray


def hits(
    piece: ConvexPiece, origins: FloatArray, ways: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Where rays enter a convex piece: distance (N,), inf where they miss, and face normal (N, 3).

    Args:
        origins: (N, 3) outside the piece, its frame. ways: (N, 3) unit vectors.
    """
    slope = ways @ piece.planes[:, :3].T
    height = origins @ piece.planes[:, :3].T + piece.planes[:, 3]
    with np.errstate(divide="ignore", invalid="ignore"):
        at = -height / slope
    enter = np.where(slope < -1e-9, at, -np.inf)
    leave = np.where(slope > 1e-9, at, np.inf)
    beside = (height > 0.0) & (np.abs(slope) <= 1e-9)
    face = enter.argmax(axis=1)
    near = enter[np.arange(len(origins)), face]
    miss = beside.any(axis=1) | (near > leave.min(axis=1)) | (near < 0.0)
    return np.where(miss, np.inf, near), piece.planes[face, :3]


def pull_capacity(
    model: ObjectModel,
    robot: RobotSpec,
    tool: FloatArray,
    width: float,
    pull: FloatArray,
    moving: tuple[str, ...],
    q: dict[str, float],
) -> float:
    """The pull that a grip bears before it slips, over the force that squeezes.

    Coulomb's cone at each finger's first contact: squeeze and pull together must lie within it.

    Args:
        tool: (4, 4) asset_T_tool at the grasp. width: metres between the open fingers.
        pull: (3,) unit vector in which the part sets out, asset frame.
        moving: links of the part. q: joint values of the object.
    """
    across = np.linspace(-LIMITS.pad, LIMITS.pad, 3)
    along = np.linspace(-0.008, robot.tip_ahead - 0.001, 6)
    total = 0.0
    for side in (1.0, -1.0):
        grid = np.array([[x, side * 0.5 * width, z] for x in across for z in along])
        origins = grid @ tool[:3, :3].T + tool[:3, 3]
        inwards = -side * tool[:3, 1]
        ways = np.broadcast_to(inwards, origins.shape)
        far, normal = first_hit(model, origins, ways, moving, q)
        far = np.where(far <= width, far, np.inf)
        if not np.isfinite(far).any():
            return 0.0
        met = normal[far <= far.min() + LIMITS.patch].mean(axis=0)
        size = float(np.linalg.norm(met))
        total += _share(inwards, pull, met / size) if size > 1e-6 else 0.0
    return total


def first_hit(
    model: ObjectModel,
    origins: FloatArray,
    ways: FloatArray,
    moving: tuple[str, ...],
    q: dict[str, float],
) -> tuple[FloatArray, FloatArray]:
    """Distance (N,) to the part and normal (N, 3) there, asset frame, from origins (N, 3) along
    unit vectors (N, 3)."""
    poses = model.kinematics.link_poses(q)
    best: FloatArray = np.full(len(origins), np.inf)
    normal = np.zeros((len(origins), 3))
    for name in moving:
        pose = poses[name][0]
        local, turned = (origins - pose[:3, 3]) @ pose[:3, :3], ways @ pose[:3, :3]
        for piece in model.pieces.get(name, ()):
            far, face = hits(piece, local, turned)
            nearer = far < best
            best = np.where(nearer, far, best)
            normal[nearer] = face[nearer] @ pose[:3, :3].T
    return best, normal


def _share(squeeze: FloatArray, pull: FloatArray, normal: FloatArray) -> float:
    """The most p (0 to 10) for which squeeze + p pull stays within the friction cone."""
    shares = np.linspace(0.0, 10.0, 101)
    force = squeeze + shares[:, None] * pull
    pressed = -(force @ normal)
    along = np.sqrt(np.maximum((force**2).sum(axis=1) - pressed**2, 0.0))
    within = (pressed > 0.0) & (along <= LIMITS.friction * pressed)
    return float(shares[within].max(initial=0.0)) if within[0] else 0.0
