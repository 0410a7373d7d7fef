"""Where points go when a joint moves: circles about a line, or a straight way."""

from __future__ import annotations

from typing import Literal

import numpy as np

from mam_pipeline.types import FloatArray

Motion = Literal["revolute", "prismatic"]


def motion_points(
    motion: Motion, axis: FloatArray, origin: FloatArray, values: FloatArray, points: FloatArray
) -> FloatArray:
    """Positions (n, S, 3) of points (S, 3) at joint values (n,), radians or metres.

    Args:
        axis: (3,) unit vector. origin: (3,) a point on it, which slides do not need.
    """
    if motion == "prismatic":
        return points[None] + values[:, None, None] * axis
    return points_about(axis[None], origin[None], points, values)[:, 0]


def points_about(
    axes: FloatArray, origins: FloatArray, points: FloatArray, angles: FloatArray
) -> FloatArray:
    """Points (S, 3) turned about L lines by angles (n,): (n, L, S, 3)."""
    arm = points - origins[:, None]
    along = np.einsum("lsk,lk->ls", arm, axes)[..., None] * axes[:, None]
    radial = arm - along
    tangent = np.cross(axes[:, None], radial)
    middle = origins[:, None] + along
    cos, sin = np.cos(angles)[:, None, None, None], np.sin(angles)[:, None, None, None]
    out = cos * radial
    out += sin * tangent
    out += middle
    return np.asarray(out)
