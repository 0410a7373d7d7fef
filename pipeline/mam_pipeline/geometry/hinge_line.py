"""How far the line of a hinge strays from the two bodies that turn about it.

The check judges by this, and the solver asks it before it settles on a line.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.geometry.motion import points_about
from mam_pipeline.geometry.raycast import RayScene
from mam_pipeline.geometry.sampling import sample_surface, unit
from mam_pipeline.geometry.surface import hull_of
from mam_pipeline.types import FloatArray, IntArray, Mesh

Inside = Callable[[FloatArray, bool], NDArray[np.bool_]]
"""Which points (n, 3) are inside the part (True) or the body that it hangs on (False)."""

PINNED = 0.001
"""Nearer than this to one point of the hinge line, two bodies meet there; share of the diagonal."""
SECTORS, ROUND = 12, 1.3
"""A part is round about a line if its reach in all sectors differs by less than this factor."""
STEEPEST = 0.3
"""A part that leaves the hinge line faster is shaped so; slower, the line runs askew."""
FOLDS, ALIKE = (3, 4, 5, 6), 0.05
"""A part is alike from several sides if a turn by one of these shares of a circle moves its surface
by less than this share of its radius; two sides are alike of any board."""
FAR = 3.0
"""Farther from a part than this many of its radii, a hinge line swings the part as a whole."""


class HingeBodies:
    """A part and the body that it hangs on, for any number of lines."""

    def __init__(self, mesh: Mesh, part: IntArray, parent: IntArray) -> None:
        """Prepare from face indices of the part, with all that it carries, and of its parent."""
        self.diagonal = mesh.diagonal
        faces = mesh.faces[part], mesh.faces[parent]
        self.corners = [mesh.vertices[np.unique(f)] for f in faces]
        self.scenes = [RayScene(mesh.vertices, f) for f in faces]
        self.spots = [
            np.concatenate([c, sample_surface(mesh.vertices, f, 2000, 5).points])
            for c, f in zip(self.corners, faces)
        ]

    def encloses(self, points: FloatArray, part: bool) -> NDArray[np.bool_]:
        """(n,) which points are inside closed shells of the part, or of the body it hangs on."""
        return self.scenes[0 if part else 1].encloses(points)

    def line_gap(self, axis: FloatArray, origin: FloatArray, inside: Inside | None = None) -> float:
        """How far a line strays from both bodies over their common extent.

        Args:
            axis, origin: the line. inside: points in a body are on it; without it, surfaces alone.

        Returns:
            Distance as a share of the diagonal.
        """
        spans = []
        for corners in self.corners:
            along = (corners - origin) @ axis
            spans.append((float(along.min()), float(along.max())))
        low, high = max(s[0] for s in spans), min(s[1] for s in spans)
        if high - low < 0.02 * self.diagonal:  # a knob on a plate: the line crosses the plate
            middle = 0.5 * (low + high)
            low, high = middle, middle
        if self._round_about(axis, origin):
            return 0.0
        count = 9
        stops = np.linspace(low, high, 4 * (count - 1) + 1).astype(np.float64)
        line = origin + stops[:, None] * axis
        fine = np.stack([scene.distance(line) for scene in self.scenes])
        if inside is not None:
            for row, part in zip(fine, (True, False)):
                row[inside(line, part)] = 0.0
        if (fine.max(axis=0) < PINNED * self.diagonal).any():
            near = 0.0  # a pin or a knuckle: both bodies meet on the line
        elif self._in_bearing(axis, origin, low, high):
            near = float(np.quantile(fine[0, ::4], 0.2))
        elif (fine[1] == 0.0).mean() > 0.8 and (post := self._post(axis, origin, low, high)) > 0.0:
            near = max(float(np.quantile(fine[0, ::4], 0.2)) - post, 0.0)
        else:
            # mounts may sit at the ends alone: a fifth of the line must lie on each body
            near = float(np.quantile(fine[:, ::4], 0.2, axis=1).max())
        return max(near, _askew(fine[0, ::4], stops[::4])) / self.diagonal

    def hub_gap(self, axis: FloatArray, origin: FloatArray) -> float:
        """How far the axis of a part that turns round and round misses the part's own hull.

        A drum or a wheel is hollow where its axis runs, so its surface says nothing.
        """
        corners = self.corners[0]
        spots = origin + ((corners.mean(axis=0) - origin) @ axis) * axis
        hull = hull_of(corners)
        if hull is None:
            return 0.0
        vertices, faces = hull
        a, b, c = (vertices[faces[:, k]] for k in range(3))
        normals = unit(np.cross(b - a, c - a))
        outside = float((np.einsum("ij,ij->i", normals, spots - a)).max())
        return max(outside, 0.0) / self.diagonal

    def off_centre(self, axis: FloatArray, origin: FloatArray, endless: bool) -> float:
        """How far a line misses the middle of a part that looks alike from several sides about it.

        Wheels, knobs and handles with three spokes or more turn about their middle. A limited
        joint may still swing such a part as a whole, about a line that is far from it.

        Args:
            axis, origin: the line. endless: the part turns round and round.

        Returns:
            Distance as a share of the diagonal; 0 of a part that does not look so.
        """
        points = self.spots[0][len(self.corners[0]) :]
        middle = points.mean(axis=0)
        radius = float(np.linalg.norm(np.cross(points - middle, axis), axis=1).max())
        off = float(np.linalg.norm(np.cross(middle - origin, axis)))
        if off < 0.1 * radius or (not endless and off > FAR * radius):
            return 0.0
        for fold in FOLDS:
            turned = points_about(axis[None], middle[None], points, np.array([2 * np.pi / fold]))
            stray = np.quantile(self.scenes[0].distance(turned[0, 0]), 0.9)
            if stray < ALIKE * radius:
                return off / self.diagonal
        return 0.0

    def _round_about(self, axis: FloatArray, origin: FloatArray) -> bool:
        """Whether the part is a ring, cap or knob about the line: the line need not touch it."""
        _, sector, radius = _about(self.spots[0], axis, origin)
        reach = np.zeros(SECTORS)
        np.maximum.at(reach, sector, radius)
        return bool(reach.min() > 0 and reach.max() < ROUND * reach.min())

    def _post(self, axis: FloatArray, origin: FloatArray, low: float, high: float) -> float:
        """Radius of the round post of the parent that a part swings about, metres; 0 if none."""
        along, sector, radius = _about(self.spots[1], axis, origin)
        ends = 0.1 * (high - low)  # its caps reach to the line
        between = (along > low + ends) & (along < high - ends)
        reach = np.full(SECTORS, np.inf)
        np.minimum.at(reach, sector[between], radius[between])
        found = np.isfinite(reach).all() and reach.max() < ROUND * reach.min()
        return float(reach.max()) if found else 0.0

    def _in_bearing(self, axis: FloatArray, origin: FloatArray, low: float, high: float) -> bool:
        """Whether the parent is a round hole about the line, where the part's shaft runs in it."""
        along, sector, radius = _about(self.spots[1], axis, origin)
        margin = 0.02 * self.diagonal
        there = (along > low - margin) & (along < high + margin)
        reach = np.full(SECTORS, np.inf)
        np.minimum.at(reach, sector[there], radius[there])
        return bool(np.isfinite(reach).all() and reach.max() < ROUND * reach.min())


def _about(
    spots: FloatArray, axis: FloatArray, origin: FloatArray
) -> tuple[FloatArray, IntArray, FloatArray]:
    """Along a line, sector about it and distance from it, of points (n, 3)."""
    arm = spots - origin
    guess = np.eye(3)[int(np.abs(axis).argmin())]
    side: FloatArray = np.asarray(unit(np.cross(axis, guess)), dtype=np.float64)
    x, y = arm @ side, arm @ np.cross(axis, side)
    sector = ((np.arctan2(y, x) / (2 * np.pi) + 1.0) * SECTORS).astype(int) % SECTORS
    return arm @ axis, sector, np.hypot(x, y)


def _askew(distance: FloatArray, along: FloatArray) -> float:
    """How far a line leaves its part towards the ends, metres; only half the length is seen."""
    rise = np.diff(distance)
    nearest = int(distance.argmin())
    noise = 0.02 * distance.max()
    if (rise[:nearest] > noise).any() or (rise[nearest:] < -noise).any():
        return 0.0  # a tilted line only gets farther on either side
    rise = np.abs(rise)
    rise = rise[rise > noise]
    if len(rise) < 3 or np.median(rise) > STEEPEST * (along[1] - along[0]):
        return 0.0
    near, far = np.quantile(distance, [0.2, 0.8])
    return 2.0 * float(far - near)
