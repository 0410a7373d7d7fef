"""The object's own frame: up and yaw from its dominant walls, so that features turn with it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mam_pipeline.geometry.sampling import face_geometry, unit
from mam_pipeline.types import FloatArray, Mesh, readonly

TILT = np.deg2rad(12.0)  # largest tilt against Z that is looked for
TREND = 1.2  # ratio of level variances from which one direction stands out


@dataclass(frozen=True)
class ObjectFrame:
    """Dominant directions and extent of a whole object.

    Attributes:
        axes: (3, 3) rows: two horizontal unit directions and up, right-handed, asset frame.
        low, high: (3,) corners of the object's box in that frame (asset points times `axes`.T).
        diagonal: of the asset-frame bounding box, metres: the unit of relative lengths.
        trend: (3,) level direction in which the surface reaches farthest from its middle, such as
            from a kettle's spout to its handle; None where it is as wide as long.
    """

    axes: FloatArray
    low: FloatArray
    high: FloatArray
    diagonal: float
    trend: FloatArray | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "axes", readonly(self.axes, np.float64, (3, 3)))
        object.__setattr__(self, "low", readonly(self.low, np.float64, (3,)))
        object.__setattr__(self, "high", readonly(self.high, np.float64, (3,)))
        if self.trend is not None:
            object.__setattr__(self, "trend", readonly(self.trend, np.float64, (3,)))

    @property
    def up(self) -> FloatArray:
        """(3,) unit vector against gravity."""
        return np.asarray(self.axes[2])


def estimate_frame(mesh: Mesh) -> ObjectFrame:
    """Estimate up (within 12 degrees of Z) and yaw (modulo a quarter turn) from face normals.

    Exact Z and the given X are kept when they explain the walls as well as anything else.
    """
    normals, areas = face_geometry(mesh.vertices, mesh.faces)
    up = _up(normals, areas)
    yaw = _yaw(normals, areas, up)
    x = np.cos(yaw) * _horizontal(up) + np.sin(yaw) * np.cross(up, _horizontal(up))
    axes = np.stack([x, np.cross(up, x), up])
    points = mesh.vertices[np.unique(mesh.faces)] @ axes.T
    low, high = points.min(axis=0), points.max(axis=0)
    return ObjectFrame(axes, low, high, max(mesh.diagonal, 1e-12), _trend(mesh, areas, axes))


def _trend(mesh: Mesh, areas: FloatArray, axes: FloatArray) -> FloatArray | None:
    """The larger level principal direction of the surface, by the exact moments of its faces."""
    corners = mesh.vertices[mesh.faces] @ axes[:2].T  # (F, 3, 2)
    total = float(areas.sum())
    if total <= 0.0:
        return None
    middle = corners.mean(axis=1)
    corners = corners - (areas @ middle) / total
    middle = corners.mean(axis=1)
    moment = np.einsum("f,fki,fkj->ij", areas, corners, corners)
    moment = (moment + 9.0 * np.einsum("f,fi,fj->ij", areas, middle, middle)) / (12.0 * total)
    values, vectors = np.linalg.eigh(moment)
    if values[1] < TREND * values[0]:
        return None
    return np.asarray(unit(vectors[:, 1] @ axes[:2]))


def _horizontal(up: FloatArray) -> FloatArray:
    """World X made perpendicular to `up`."""
    return unit(np.array([1.0, 0.0, 0.0]) - up[0] * up)


def _up(normals: FloatArray, areas: FloatArray) -> FloatArray:
    """Mode of the nearly vertical normals; Z when a fair share of them is exactly vertical."""
    z = np.array([0.0, 0.0, 1.0])
    near = np.abs(normals[:, 2]) > np.cos(TILT)
    if areas[near].sum() <= 0.02 * areas.sum():
        return z
    n = normals[near] * np.sign(normals[near, 2:3])
    w = areas[near]
    exact = w[n[:, 2] > np.cos(np.deg2rad(0.5))].sum()
    if exact > 0.25 * w.sum():
        return z
    cells = np.round(np.degrees(n[:, :2])).astype(int)  # one-degree cells of the tilt vector
    keys, inverse = np.unique(cells, axis=0, return_inverse=True)
    mass = np.bincount(inverse.reshape(-1), w)
    up = unit(np.append(np.radians(keys[np.argmax(mass)]), 1.0))
    for _ in range(3):
        close = n @ up > np.cos(np.deg2rad(2.0))
        if w[close].sum() < 0.3 * w.sum():
            return z  # a dome or a slope, not a tilted floor
        up = unit((n[close] * w[close, None]).sum(axis=0))
    return np.asarray(up)


def _yaw(normals: FloatArray, areas: FloatArray, up: FloatArray) -> float:
    """Angle (radians) from `_horizontal(up)` to the dominant wall normals, modulo 90 degrees."""
    x = _horizontal(up)
    y = np.cross(up, x)
    upright = np.abs(normals @ up) < 0.2
    weight = areas[upright]
    if weight.sum() <= 1e-12:
        return 0.0
    angle = np.mod(np.degrees(np.arctan2(normals[upright] @ y, normals[upright] @ x)), 90.0)
    bins = np.bincount(np.round(angle * 2).astype(int) % 180, weight, minlength=180)
    smooth = np.sum([np.roll(bins, k) for k in range(-4, 5)], axis=0)
    peak = int(np.argmax(smooth))
    if bins[[0, 1, 179]].sum() > 0.5 * smooth[peak]:
        return 0.0
    near = (angle - peak / 2 + 45.0) % 90.0 - 45.0
    close = np.abs(near) < 2.5
    refined = peak / 2 + float(np.average(near[close], weights=weight[close]))
    return float(np.radians((refined + 45.0) % 90.0 - 45.0))
