"""Fit a box to a photo by analysis by synthesis: mask overlap, oriented edges, alignment.

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
WEAK_MASK = 0.4  # weight of a mask that is not trusted, against 1
COVER = 0.5  # weight of the aligned segments that a box leaves outside, with such a mask
GRID_FOCAL = (0.6, 0.8, 1.1, 1.6, 3.0)
SPREAD = np.array([0.05, 0.05, 0.012, 0.12, 0.012, 0.012, 0.05, 0.05, 0.12])  # of a search


@dataclass(frozen=True)
class Evidence:
    """What a box is fitted to: mask (h, w) 0..1 with its weight, lines, focal."""

    mask: Array
    mask_weight: float
    segments: Segments  # of the whole picture
    on_object: Array  # (n,) 1 for segments on the mask, else 0
    edges: EdgeMaps  # of the segments on the mask
    focal: float | None = None  # pixels, from EXIF

    @property
    def size(self) -> tuple[int, int]:
        """(width, height) pixels."""
        return self.mask.shape[1], self.mask.shape[0]

    @property
    def diagonal(self) -> float:
        """Picture diagonal, pixels."""
        return float(np.hypot(*self.size))


@dataclass(frozen=True)
class Cuboid:
    """A fitted box: parameters, cost with its terms, and the picture it was fitted to.

    `cost` uses the weights of an untrusted mask, so that boxes fitted to different masks of one
    photo compare; `own` is what was minimised.
    """

    params: Array
    cost: float
    iou: float
    edge: float
    align: float
    cover: float
    own: float
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
        line = evidence.mask[np.clip(self.rows.astype(int), 0, h - 1)]
        self.cumulative = np.concatenate([np.zeros((ROWS, 1)), np.cumsum(line, axis=1)], axis=1)
        self.total = float(self.cumulative[:, -1].sum())
        self.cover_weight = 0.0 if evidence.mask_weight > 0.9 else COVER
        s = evidence.segments
        weight = s.length * evidence.on_object
        self.weight = weight / max(weight.sum(), 1e-9)
        self.x_of = s.middle[:, 0]
        self.row_of = np.clip(s.middle[:, 1] / h * ROWS, 0, ROWS - 1).astype(int)
        self.m = (s.middle - np.array(evidence.size) / 2) / evidence.diagonal
        self.m2 = (self.m**2).sum(axis=1)
        d = s.direction
        twist = self.m[:, 0] * d[:, 1] - self.m[:, 1] * d[:, 0]
        self.cross_terms = np.stack([d[:, 1], -d[:, 0], twist])
        self.log_focal = (
            None if evidence.focal is None else float(np.log(evidence.focal / evidence.diagonal))
        )

    def overlap(self, uv: Array) -> tuple[Array, Array, Array]:
        """(n,) IoU of the projected hulls with the mask, and (n, ROWS) hull ends left, right."""
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
        return common / np.maximum(area + self.total - common, 1.0), i0, i1

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

    def alignment(self, p: Array) -> Array:
        """(n,) length-weighted share of segments that point at one of the box's directions."""
        return self.aligned(p, rotation(p[:, 0], p[:, 1], p[:, 2])) @ self.weight

    def coverage(self, aligned: Array, left: Array, right: Array) -> Array:
        """(n,) share of the picture's aligned segment length that lies inside the hull."""
        if not len(self.e.segments.length):
            return np.ones(len(aligned))
        value = aligned * self.e.segments.length
        slack = 0.01 * self.e.size[0]
        low, high = left[:, self.row_of] - slack, right[:, self.row_of] + slack
        inside = (low <= self.x_of) & (high >= self.x_of)
        return (value * inside).sum(axis=1) / np.maximum(value.sum(axis=1), 1e-9)

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

    def terms(self, p: Array) -> tuple[Array, Array, Array, Array, Array]:
        """(n,) each: mask IoU, edge cost, alignment, coverage, priors."""
        frames = _frames(p)
        uv, depth = project(p, self.e.size, frames)
        iou, left, right = self.overlap(uv)
        aligned = self.aligned(p, frames[0])
        return (
            iou,
            self.edge_cost(visibility(p, frames), uv),
            aligned @ self.weight,
            self.coverage(aligned, left, right),
            self.priors(p, uv, depth),
        )

    def __call__(self, p: Array) -> Array:
        """(n,) cost of (n, 9) parameters."""
        return _total(self.terms(p), self.e.mask_weight, self.cover_weight)

    def report(self, params: Array) -> Cuboid:
        """The box at `params` with the cost's terms; `cost` compares across masks."""
        terms = self.terms(params[None])
        iou, edge, align, cover, _ = (float(t[0]) for t in terms)
        cost = float(_total(terms, WEAK_MASK, COVER)[0])
        own = float(_total(terms, self.e.mask_weight, self.cover_weight)[0])
        return Cuboid(params, cost, iou, edge, align, cover, own, self.e.size)


def _total(terms: tuple[Array, ...], mask_weight: float, cover_weight: float) -> Array:
    iou, edge, align, cover, prior = terms
    out = 1.6 * mask_weight * (1 - iou) + cover_weight * (1 - cover)
    return out + 0.8 * edge + 0.7 * (1 - align) + prior


def pose_hypotheses(objective: Objective, keep: int = 5) -> Array:
    """(k, 4) distinct yaw, pitch, roll, log f from a grid, best Manhattan alignment first."""
    fixed = objective.log_focal
    focals = np.log(GRID_FOCAL) if fixed is None else np.array([fixed])
    yaw = np.deg2rad(np.arange(-45, 46, 3.0))
    pitch = np.deg2rad(np.arange(-9, 43, 3.0))
    roll = np.deg2rad([-2.5, 0.0, 2.5])
    grid = np.stack(np.meshgrid(yaw, pitch, roll, focals, indexing="ij"), -1).reshape(-1, 4)
    p = np.zeros((len(grid), 9))
    p[:, :4] = grid
    score = np.concatenate([objective.alignment(c) for c in np.array_split(p, 12)])
    score -= 0.02 * np.abs(np.rad2deg(grid[:, 2])) / 2.5
    score -= 0.03 * np.clip(np.abs(np.rad2deg(grid[:, 1]) - 12) - 15, 0, None) / 10
    chosen: list[Array] = []
    for i in np.argsort(-score, kind="stable"):
        near = [
            np.abs(grid[i, 0] - c[0]) < np.deg2rad(7) and np.abs(grid[i, 1] - c[1]) < np.deg2rad(7)
            for c in chosen
        ]
        if not any(near):
            chosen.append(grid[i])
        if len(chosen) == keep:
            break
    return np.stack(chosen)


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


def fit_cuboids(evidence: Evidence, seed: int = 0, keep: int = 3) -> list[Cuboid]:
    """The best distinct boxes, best first (deterministic for a seed)."""
    objective = Objective(evidence)
    rng = np.random.default_rng(seed)
    ys, xs = np.nonzero(evidence.mask > 0.5)
    if len(xs) == 0:
        ys, xs = np.nonzero(np.ones_like(evidence.mask))
    low, high = np.percentile(np.stack([xs, ys], 1), [1, 99], axis=0)
    diagonal = evidence.diagonal
    center = ((low + high) / 2 - np.array(evidence.size) / 2) / diagonal
    span = (high - low) / diagonal
    found: list[tuple[float, Array]] = []
    for pose in pose_hypotheses(objective):
        shape = np.empty((40, 5))
        shape[:, :2] = center + rng.normal(0, 0.12, (40, 2)) * span
        shape[:, 2] = np.log(span[0] * rng.uniform(0.5, 1.1, 40))
        shape[:, 3] = np.log(span[1] * rng.uniform(0.5, 1.1, 40))
        shape[:, 4] = np.log(np.sqrt(span.prod()) * rng.uniform(0.25, 0.9, 40))

        def posed(s: Array, pose: Array = pose) -> Array:
            return objective(np.hstack([np.tile(pose, (len(s), 1)), s]))

        rows, values = evolve(posed, shape, 28, rng)
        found += [(v, np.hstack([pose, r])) for v, r in zip(values[:2], rows[:2])]
    found.sort(key=lambda x: x[0])
    out: list[Cuboid] = []
    seeds: list[Array] = []
    for _, p in found:
        if len(seeds) < keep and not any(
            np.abs(p[0] - q[0]) + np.abs(p[1] - q[1]) < 0.12 for q in seeds
        ):
            seeds.append(p)
    for p in seeds:
        start = p + rng.normal(0, 1, (48, 9)) * SPREAD
        start[0] = p
        rows, _ = evolve(objective, start, 50, rng)
        best, _ = _polish(lambda x: float(objective(x[None])[0]), rows[0], SPREAD * 0.15, 400)
        out.append(objective.report(best))
    return sorted(out, key=lambda c: c.own)


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
    return min(rises) - cuboid.own
