"""Fit a box to a photo: the network's corners and outline, and the lines that the picture shows.

A box pose is a row of nine numbers: yaw, pitch, roll (radians), log of focal length over the
picture's diagonal, the projected centre x, y (pixels over the diagonal, from the picture's
centre), and logs of width, height and depth. Lengths are in units in which the centre lies at
distance focal / diagonal, so that a length is about its picture size over the diagonal.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from mam_pipeline.photo.camera import CORNERS, EDGE_FACES, EDGES, FACES, NORMALS, rotation
from mam_pipeline.photo.lines import EdgeMaps, Segments

Array = NDArray[np.float64]
ROWS = 60
SAMPLES = np.linspace(0.02, 0.98, 17)
SIGMA = np.deg2rad(2.2)
FACE_NAMES = ("front", "right", "left", "top", "bottom")
SPREAD = np.array([0.05, 0.05, 0.012, 0.12, 0.012, 0.012, 0.05, 0.05, 0.12])  # of a search
SEARCHED, GENERATIONS = 80, 60
CORNER, OUTLINE, EDGE, ALIGN = 0.125, 0.8, 0.8, 0.7  # weights of the cost's terms
CORNER_SHARES = np.repeat([0.2, 0.05], 4)  # those at the back are seen aslant, or not at all
FARTHEST = 6.0  # spreads from which a corner counts as lost
SURE_CORNER = 0.004  # of the diagonal: no corner is surer
FIRST_YAWS = (-0.6, -0.25, 0.0, 0.25, 0.6)


@dataclass(frozen=True)
class Evidence:
    """What a box is fitted to.

    Attributes:
        outline: (h, w) 0 or 1, where the object without legs is.
        corners, spread: (8, 2) and (8,) pixels (`box_network.BoxMaps`).
        segments: of the picture, and their maps.
        focal: pixels, from EXIF.
    """

    outline: Array
    corners: Array
    spread: Array
    segments: Segments
    edges: EdgeMaps
    focal: float | None = None

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) pixels."""
        return self.outline.shape[1], self.outline.shape[0]

    @property
    def diagonal(self) -> float:
        """Picture diagonal, pixels."""
        return float(np.hypot(*self.size))

    @property
    def doubt(self) -> Array:
        """(8,) spread of the corners that is reckoned with, pixels."""
        return np.maximum(self.spread, SURE_CORNER * self.diagonal)


@dataclass(frozen=True)
class Cuboid:
    """A fitted box: parameters, cost, and (width, height) of the picture it was fitted to."""

    params: Array
    cost: float
    size: tuple[int, int]

    @property
    def corners(self) -> Array:
        """(8, 2) projected corners, pixels."""
        return project(self.params[None], self.size)[0][0]

    @property
    def visible(self) -> tuple[str, ...]:
        """Names of the faces that the camera sees."""
        seen = visibility(self.params[None])[0]
        return tuple(n for n, v in zip(FACE_NAMES, seen) if v)

    def quad(self, face: str) -> Array:
        """(4, 2) corners TL, TR, BR, BL of a face as seen from outside, pixels."""
        return self.corners[list(FACES[face])]

    @property
    def extents(self) -> tuple[float, float, float]:
        """(width, depth, height) in fit units."""
        w, h, d = np.exp(self.params[6:9])
        return float(w), float(d), float(h)

    @property
    def focal(self) -> float:
        """Focal length, pixels."""
        return float(np.exp(self.params[3]) * np.hypot(*self.size))


def _frames(p: Array) -> tuple[Array, Array, Array]:
    turn = rotation(p[:, 0], p[:, 1], p[:, 2])
    f = np.exp(p[:, 3])
    middle = np.stack([p[:, 4] / f, p[:, 5] / f, np.ones_like(f)], axis=1) * f[:, None]
    half = np.exp(p[:, [8, 6, 7]]) / 2
    return turn, middle, half


def project(
    p: Array, size: tuple[int, int], frames: tuple[Array, Array, Array] | None = None
) -> tuple[Array, Array]:
    """(n, 9) parameters to (n, 8, 2) pixels of the corners and (n, 8) depths."""
    turn, middle, half = frames or _frames(p)
    points = (CORNERS * half[:, None]) @ turn.transpose(0, 2, 1) + middle[:, None]
    z = np.maximum(points[..., 2], 0.05)
    f = np.exp(p[:, 3])[:, None, None]
    diagonal = float(np.hypot(*size))
    uv = points[..., :2] / z[..., None] * f * diagonal + np.array(size) / 2
    return uv, points[..., 2]


_OUTWARD = np.array([NORMALS[n] for n in FACE_NAMES])


def visibility(p: Array, frames: tuple[Array, Array, Array] | None = None) -> NDArray[np.bool_]:
    """(n, 5) which of FACE_NAMES face the camera."""
    turn, middle, half = frames or _frames(p)
    normal = _OUTWARD @ turn.transpose(0, 2, 1)  # (n, 5, 3) in the camera frame
    reach = half @ np.abs(_OUTWARD).T
    return (normal * middle[:, None]).sum(axis=2) + reach < 0


_EDGE_PAIR = np.array(
    [[FACE_NAMES.index(f) if f in FACE_NAMES else -1 for f in pair] for pair in EDGE_FACES]
)


class Objective:
    """Vectorised cost of boxes against the evidence of one photo."""

    def __init__(self, evidence: Evidence) -> None:
        self.e = evidence
        h = evidence.size[1]
        self.rows = (np.arange(ROWS) + 0.5) / ROWS * h
        line = evidence.outline[np.clip(self.rows.astype(int), 0, h - 1)]
        self.cumulative = np.concatenate([np.zeros((ROWS, 1)), np.cumsum(line, axis=1)], axis=1)
        self.total = float(self.cumulative[:, -1].sum())
        s = evidence.segments
        self.weight = s.length / max(s.length.sum(), 1e-9)
        self.m = (s.middle - np.array(evidence.size) / 2) / evidence.diagonal
        self.m2 = (self.m**2).sum(axis=1)
        d = s.direction
        twist = self.m[:, 0] * d[:, 1] - self.m[:, 1] * d[:, 0]
        self.cross_terms = np.stack([d[:, 1], -d[:, 0], twist])
        self.log_focal = (
            None if evidence.focal is None else float(np.log(evidence.focal / evidence.diagonal))
        )

    def overlap(self, uv: Array) -> Array:
        """(n,) IoU of the projected hulls with the outline."""
        a, b = uv[:, EDGES[:, 0]], uv[:, EDGES[:, 1]]
        dy = b[..., 1] - a[..., 1]
        t = (self.rows[:, None] - a[:, None, :, 1]) / np.where(np.abs(dy) < 1e-9, 1e-9, dy)[:, None]
        x = a[:, None, :, 0] + t * (b[..., 0] - a[..., 0])[:, None]
        hit = (t >= 0) & (t <= 1)
        left = np.where(hit, x, np.inf).min(axis=2)
        right = np.where(hit, x, -np.inf).max(axis=2)
        w = self.e.size[0]
        none = ~hit.any(axis=2)
        i0 = np.clip(np.where(none, 0, np.round(np.clip(left, -1, w + 1))), 0, w).astype(int)
        i1 = np.clip(np.where(none, 0, np.round(np.clip(right, -1, w + 1))), 0, w).astype(int)
        row = np.arange(ROWS)
        common = (self.cumulative[row, i1] - self.cumulative[row, i0]).sum(axis=1)
        area = (i1 - i0).sum(axis=1)
        return np.asarray(common / np.maximum(area + self.total - common, 1.0))

    def corner_cost(self, uv: Array) -> Array:
        """(n,) weighted distance of the corners from the network's, in its spreads, bounded."""
        off = np.linalg.norm(uv - self.e.corners, axis=2) / self.e.doubt
        return np.asarray(np.minimum(off, FARTHEST) @ CORNER_SHARES)

    def edge_cost(self, seen: NDArray[np.bool_], uv: Array) -> Array:
        """(n,) mean clipped distance 0..1 of visible box edges to like-oriented segments."""
        pair = np.where(_EDGE_PAIR >= 0, _EDGE_PAIR, 0)
        shown = (seen[:, pair] & (_EDGE_PAIR >= 0)).any(axis=2)
        a, b = uv[:, EDGES[:, 0]], uv[:, EDGES[:, 1]]
        delta = b - a
        angle = np.arctan2(delta[..., 1], delta[..., 0]) % np.pi
        points = a[:, :, None] + SAMPLES[:, None] * delta[:, :, None]
        value, inside = self.e.edges.look_up(points, np.repeat(angle[..., None], len(SAMPLES), 2))
        value = np.where(inside, value, 0.55)
        length = np.hypot(delta[..., 0], delta[..., 1]) * shown
        length = np.minimum(length, 0.5 * self.e.diagonal)
        return (value.mean(axis=2) * length).sum(1) / np.maximum(length.sum(1), 1e-9)

    def aligned(self, p: Array, turn: Array) -> Array:
        """(n, segments) 0..1 how well each segment points at the nearest box direction.

        For a direction v the vanishing point seen from the segment's middle m is f v_xy - v_z m;
        its angle to the segment's direction d follows from products that are linear in v.
        """
        f = np.exp(p[:, 3])[:, None, None]
        v = turn.transpose(0, 2, 1) * np.array([1.0, 1.0, -1.0])  # (n, axis, xyz)
        v = v * np.concatenate([f, f, np.ones_like(f)], axis=2)  # f vx, f vy, -vz
        n = len(p)
        flat = v.reshape(-1, 3)
        cross = flat @ self.cross_terms
        square = (flat**2)[:, :2].sum(axis=1)[:, None] + 2 * (flat[:, 2:] * flat[:, :2]) @ self.m.T
        square = square + (flat[:, 2] ** 2)[:, None] * self.m2
        ratio = (cross * cross / np.maximum(square, 1e-12)).reshape(n, 3, -1).min(axis=1)
        return np.exp(-ratio / SIGMA**2)

    def priors(self, p: Array, uv: Array, depth: Array) -> Array:
        """(n,) penalties: unusual lens, tilt or proportions; a box behind or beyond the view."""
        w, h, d = p[:, 6], p[:, 7], p[:, 8]
        if self.log_focal is None:
            out = 0.02 * ((p[:, 3] - np.log(1.0)) / 0.6) ** 2
        else:
            out = 0.5 * ((p[:, 3] - self.log_focal) / 0.05) ** 2
        out += 0.03 * (p[:, 2] / np.deg2rad(2.5)) ** 2
        tilt = np.deg2rad(np.array([-4.0, 30.0]))
        out += 0.05 * (np.clip(tilt[0] - p[:, 1], 0, None) / 0.1) ** 2
        out += 0.05 * (np.clip(p[:, 1] - tilt[1], 0, None) / 0.15) ** 2
        out += 0.1 * (np.clip(np.abs(p[:, 0]) - np.deg2rad(46), 0, None) / 0.1) ** 2
        usual = d - 0.5 * np.log(np.exp(w) * np.exp(h)) - np.log(0.6)
        out += 0.015 * (usual / 0.5) ** 2
        out += 0.2 * np.clip(np.abs(usual) - 1.2, 0, None) ** 2
        out += 0.1 * np.clip(np.abs(w - h) - np.log(4.0), 0, None) ** 2
        size = np.array(self.e.size)
        spill = np.clip(-uv / size, 0, None) + np.clip(uv / size - 1, 0, None)
        out += 0.25 * np.clip(spill - 0.06, 0, 2).mean(axis=(1, 2))
        return out + np.where(depth.min(axis=1) < 0.1, 5.0, 0.0)

    def __call__(self, p: Array) -> Array:
        """(n,) cost of (n, 9) parameters."""
        frames = _frames(p)
        uv, depth = project(p, self.e.size, frames)
        return np.asarray(
            CORNER * self.corner_cost(uv)
            + OUTLINE * (1 - self.overlap(uv))
            + EDGE * self.edge_cost(visibility(p, frames), uv)
            + ALIGN * (1 - self.aligned(p, frames[0]) @ self.weight)
            + self.priors(p, uv, depth)
        )


def evolve(
    cost: Callable[[Array], Array], start: Array, generations: int, rng: np.random.Generator
) -> tuple[Array, Array]:
    """Differential evolution (best/1 with dither) on a start population; returns sorted rows."""
    population = start.copy()
    value = cost(population)
    n, k = population.shape
    for _ in range(generations):
        best = population[value.argmin()]
        i, j = rng.integers(0, n, (2, n))
        step = rng.uniform(0.4, 0.9, (n, 1))
        trial = population + step * (best - population) * (rng.random((n, 1)) < 0.7)
        trial = trial + step * (population[i] - population[j])
        cross = rng.random((n, k)) < 0.85
        trial = np.where(cross, trial, population)
        new = cost(trial)
        better = new < value
        population[better], value[better] = trial[better], new[better]
    order = np.argsort(value, kind="stable")
    return population[order], value[order]


def fit_cuboid(evidence: Evidence, seed: int = 0) -> Cuboid:
    """The best box (deterministic for a seed): first to the corners alone, then to everything."""
    objective = Objective(evidence)
    rng = np.random.default_rng(seed)
    first = _fit_corners(objective)
    start = first + rng.normal(0, 0.6, (SEARCHED, len(first))) * SPREAD
    start[0] = first
    rows, _ = evolve(objective, start, GENERATIONS, rng)
    best, cost = _polish(lambda x: float(objective(x[None])[0]), rows[0], SPREAD * 0.15, 500)
    return Cuboid(best, cost, evidence.size)


def _fit_corners(objective: Objective) -> Array:
    """(9,) of the box whose corners are nearest to the network's, robustly."""
    e = objective.e
    middle = (e.corners.min(axis=0) + e.corners.max(axis=0)) / 2 - np.array(e.size) / 2
    middle = middle / e.diagonal
    span = np.maximum(np.ptp(e.corners, axis=0) / e.diagonal, 1e-3)
    focal, hold = (0.0, 0.5) if objective.log_focal is None else (objective.log_focal, 0.05)

    def residuals(p: Array) -> Array:
        off = (project(p[None], e.size)[0][0] - e.corners) / e.doubt[:, None]
        usual = p[8] - 0.5 * (p[6] + p[7]) - np.log(0.6)
        held = [p[2] / np.deg2rad(3), (p[3] - focal) / hold, usual / 0.6]
        return np.concatenate([off.ravel(), held])

    fits = []
    for yaw in FIRST_YAWS:
        lengths = np.log([0.8 * span[0], 0.8 * span[1], 0.5 * np.sqrt(span.prod())])
        start = np.array([yaw, 0.15, 0.0, focal, *middle, *lengths])
        fits.append(optimize.least_squares(residuals, start, loss="soft_l1", max_nfev=60))
    return np.asarray(min(fits, key=lambda fit: fit.cost).x)


def _polish(
    cost: Callable[[Array], float], start: Array, step: Array, most: int
) -> tuple[Array, float]:
    simplex = start + np.vstack([np.zeros(len(start)), np.diag(step)])
    options = {"maxfev": most, "initial_simplex": simplex}
    found = optimize.minimize(cost, start, method="Nelder-Mead", options=options)
    return found.x, float(found.fun)


def hold_of_length(evidence: Evidence, cuboid: Cuboid, length: int, change: float = 0.15) -> float:
    """How firmly the picture holds one length of the box: the profile of the cost.

    Args:
        length: 0 width, 1 height, 2 depth.
        change: of the length's logarithm, both ways.

    Returns:
        The least rise of the cost when the length is forced shorter or longer and all the rest
        is fitted again; about 0 where the picture does not tell the length.
    """
    objective = Objective(evidence)
    index = 6 + length
    rest = np.delete(np.arange(9), index)

    def forced(x: Array, value: float) -> float:
        return float(objective(np.insert(x, index, value)[None])[0])

    rises = []
    for value in (cuboid.params[index] - change, cuboid.params[index] + change):
        cost = partial(forced, value=value)
        rises.append(_polish(cost, cuboid.params[rest], SPREAD[rest] * 0.3, 300)[1])
    return min(rises) - cuboid.cost
