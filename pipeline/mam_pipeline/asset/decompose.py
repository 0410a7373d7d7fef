"""Approximate convex decomposition by plane cuts, made for boards, shells and cavities.

General decomposers (CoACD) took 3 to 16 seconds for an open box of 24 faces and cut its walls
askew. Furniture is bounded by planes, and the planes of inner walls are where it should be cut:
candidates are the levels of the surface's own vertices along its box axes and diagonals. Pieces
are cut while their hulls hold space that the surface neither bounds nor encloses.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull, QhullError

from mam_pipeline.geometry.boxes import minimal_box
from mam_pipeline.geometry.surface import hull_of
from mam_pipeline.types import FloatArray, IntArray

_SAMPLES = 500
_LEVELS = 6
_DIAGONALS = np.array([[1, 1, 0], [1, -1, 0], [1, 0, 1], [1, 0, -1], [0, 1, 1], [0, 1, -1]])
_SLIVER = 0.004
CUTTING = 24_000
"""Triangles that are looked at while one link is cut: some three seconds of a processor."""
_LEAST = 250
"""Triangles that a cut counts at least: trying its planes costs as much."""
_GOOD = 0.03
"""Share of a hull's volume that may be empty space."""

Empty = Callable[[FloatArray], NDArray[np.bool_]]


@dataclass(frozen=True)
class Chunk:
    """Some triangles and their hull.

    Attributes:
        vertices: (V, 3). faces: (F, 3).
        volume: of the hull, m3. waste: of the free space in it, m3.
        samples: (n, 3) points in the hull; free: (n,) whether each lies in free space.
    """

    vertices: FloatArray
    faces: IntArray
    waste: float
    volume: float
    samples: FloatArray = field(default_factory=lambda: np.zeros((0, 3)))
    free: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, dtype=bool))

    @property
    def points(self) -> FloatArray:
        """(n, 3) vertices in use."""
        return self.vertices[np.unique(self.faces)]


@dataclass(order=True)
class _Entry:
    key: float
    index: int
    chunk: Chunk = field(compare=False)


def decompose(
    soups: Sequence[tuple[FloatArray, IntArray]],
    empty: Empty,
    max_pieces: int,
    cutting: int = CUTTING,
    seed: int = 0,
) -> list[Chunk]:
    """Cut triangle soups until their hulls are solid or a budget is spent.

    Args:
        soups: (vertices, faces) of the first pieces; there may be no more than `max_pieces`.
        empty: tells which of (n, 3) points lie in free space: neither near nor inside the
            surface.
        max_pieces: the most pieces to return.
        cutting: triangles that the cuts may look at, so that every machine makes the same pieces.
        seed: of the volume samples.
    """
    rng = np.random.default_rng(seed)
    counter = itertools.count()
    heap: list[_Entry] = []
    done: list[Chunk] = []

    def push(vertices: FloatArray, faces: IntArray) -> None:
        chunk = _chunk(vertices, faces, empty, rng)
        if chunk.waste <= _GOOD * chunk.volume:
            done.append(chunk)
        else:
            heapq.heappush(heap, _Entry(-chunk.waste, next(counter), chunk))

    for vertices, faces in soups:
        push(vertices, faces)
    while heap and len(heap) + len(done) < max_pieces and cutting > 0:
        worst = heapq.heappop(heap).chunk
        cutting -= max(len(worst.faces), _LEAST)
        halves = _best_cut(worst)
        if halves is None:
            done.append(worst)
            continue
        for vertices, faces in halves:
            push(vertices, faces)
    return done + [entry.chunk for entry in heap]


def _chunk(vertices: FloatArray, faces: IntArray, empty: Empty, rng: np.random.Generator) -> Chunk:
    points = vertices[np.unique(faces)]
    hull = hull_of(points)
    if hull is None:
        return Chunk(vertices, faces, 0.0, 0.0)
    samples, volume = _inside(hull, rng)
    free = empty(samples)
    return Chunk(vertices, faces, float(free.mean()) * volume, volume, samples, free)


def _inside(
    hull: tuple[FloatArray, IntArray], rng: np.random.Generator
) -> tuple[FloatArray, float]:
    """Points evenly spread in a hull, and its volume: tetrahedra from its middle."""
    vertices, faces = hull
    middle = vertices.mean(axis=0)
    corners = vertices[faces] - middle
    volumes = np.abs(np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])))
    volume = float(volumes.sum()) / 6.0
    pick = rng.choice(len(faces), size=_SAMPLES, p=volumes / volumes.sum())
    weights = rng.dirichlet(np.ones(4), size=_SAMPLES)
    return middle + np.einsum("nk,nkj->nj", weights[:, :3], corners[pick]), volume


def _best_cut(chunk: Chunk) -> list[tuple[FloatArray, IntArray]] | None:
    """The two halves of the best cut; None if no cut helps.

    A cut helps by hull volume that it saves, and by telling matter from free space as a decision
    tree would (Gini): the first cuts of an open box save nothing, they only set a wall free.
    """
    triangles = chunk.vertices[chunk.faces]
    box = minimal_box(chunk.points, 8)
    best, best_gain = None, 0.004
    directions = np.concatenate([np.eye(3), _DIAGONALS / np.sqrt(2)]) @ box.axes
    for k, direction in enumerate(directions):
        heights = triangles @ direction
        sample_heights = chunk.samples @ direction
        for level in _levels(heights, _LEVELS if k < 3 else 2):
            gain = _purity(sample_heights > level, chunk.free)
            if gain + 1.0 < best_gain:
                continue
            volume = 0.0
            for side in (1.0, -1.0):
                volume += hull_volume(_half_points(triangles, side * (heights - level)))
            gain += 1.0 - volume / chunk.volume
            if gain > best_gain:
                best, best_gain = (direction, level), gain
    if best is None:
        return None
    direction, level = best
    halves = []
    for side in (1.0, -1.0):
        vertices, faces = half(chunk.vertices, chunk.faces, side * direction, side * level)
        if len(faces) and np.ptp(vertices[np.unique(faces)] @ direction) > _SLIVER * box.half.max():
            halves.append((vertices, faces))
    return halves or None


def half(
    vertices: FloatArray, faces: IntArray, direction: FloatArray, level: float
) -> tuple[FloatArray, IntArray]:
    """The part of a surface where direction . x >= level; no vertex leaves its triangle.

    An edge is cut only where its ends lie on either side, at a share between 0 and 1. (trimesh's
    slice takes ends within 1e-8 of the plane for ends on it, and extrapolates edges beside it.)
    """
    signed = vertices @ direction - level
    inside = signed[faces] >= 0.0
    count = inside.sum(axis=1)
    points, out = [vertices], [faces[count == 3]]
    total = len(vertices)
    for kept in (1, 2):
        rows = np.flatnonzero(count == kept)
        # first the corner that is alone on its side, then the others in their order
        lone = np.argmax(inside[rows] == (kept == 1), axis=1)
        a, b, c = (faces[rows, (lone + k) % 3] for k in range(3))
        cut = []
        for other in (b, c):
            share = (signed[a] / (signed[a] - signed[other]))[:, None]
            points.append(vertices[a] * (1.0 - share) + vertices[other] * share)
            cut.append(total + np.arange(len(rows)))
            total += len(rows)
        if kept == 1:
            out.append(np.stack([a, cut[0], cut[1]], axis=1))
        else:
            out += [np.stack([cut[0], b, c], axis=1), np.stack([cut[0], c, cut[1]], axis=1)]
    return np.concatenate(points), np.concatenate(out).astype(np.int64)


def merge(chunks: Sequence[Chunk], tolerance: float) -> list[Chunk]:
    """Join chunks whose common hull is hardly larger than the two, and drop what others cover.

    Args:
        chunks: pieces. tolerance: a piece whose points all lie this near inside another goes.
    """
    left = sorted(chunks, key=lambda c: -c.volume)
    joined = True
    while joined:
        joined = False
        for i, k in itertools.combinations(range(len(left)), 2):
            union = _union(left[i], left[k])
            if union is not None:
                left = [c for n, c in enumerate(left) if n not in (i, k)] + [union]
                joined = True
                break
    out: list[Chunk] = []
    for chunk in sorted(left, key=lambda c: -c.volume):
        if not any(_covers(other, chunk.points, tolerance) for other in out):
            out.append(chunk)
    return out


def _union(a: Chunk, b: Chunk) -> Chunk | None:
    pa, pb = a.points, b.points
    if a.volume <= 0 or b.volume <= 0:
        return None
    gap = np.maximum(pa.min(0) - pb.max(0), pb.min(0) - pa.max(0))
    reach = 0.02 * max(np.ptp(pa, axis=0).max(), np.ptp(pb, axis=0).max())
    if gap.max() > reach:
        return None
    volume = hull_volume(np.concatenate([pa, pb]))
    if volume > 1.02 * (a.volume + b.volume):
        return None
    faces = np.concatenate([a.faces, b.faces + len(a.vertices)])
    return Chunk(np.concatenate([a.vertices, b.vertices]), faces, a.waste + b.waste, volume)


def _covers(big: Chunk, points: FloatArray, tolerance: float) -> bool:
    """Whether all points lie inside a chunk's hull, or nearer to it than the tolerance."""
    if big.volume <= 0:
        return False
    try:
        planes = ConvexHull(big.points).equations
    except (QhullError, ValueError):
        return False
    return bool((points @ planes[:, :3].T + planes[:, 3]).max() < tolerance)


def _purity(side: NDArray[np.bool_], free: NDArray[np.bool_]) -> float:
    """Fall of the Gini impurity of `free` (n,) when the samples are split by `side` (n,)."""
    n = len(free)
    whole = free.mean()
    after = 0.0
    for mask in (side, ~side):
        count = int(mask.sum())
        if count == 0:
            return 0.0
        share = free[mask].mean()
        after += count / n * 2.0 * share * (1.0 - share)
    return float(2.0 * whole * (1.0 - whole) - after)


def _levels(heights: FloatArray, count: int) -> FloatArray:
    """Cutting levels: where many corners lie (planes of walls), then even spacing."""
    flat = np.sort(heights.reshape(-1))
    low, high = flat[0], flat[-1]
    span = high - low
    if span <= 0:
        return np.zeros(0)
    inner = flat[(flat > low + 0.01 * span) & (flat < high - 0.01 * span)]
    levels = [low + span * s for s in (0.5,)]
    if len(inner):
        bins = np.round((inner - low) / (0.01 * span)).astype(int)
        values, counts = np.unique(bins, return_counts=True)
        for value in values[np.argsort(-counts, kind="stable")][: count - 1]:
            levels.append(float(np.median(inner[bins == value])))
    return np.array(levels)


def _half_points(triangles: FloatArray, signed: FloatArray) -> FloatArray:
    """Points that span the part of triangles (n, 3, 3) where `signed` (n, 3) is positive."""
    points = [triangles[signed >= 0]]
    for a, b in ((0, 1), (1, 2), (2, 0)):
        crossing = signed[:, a] * signed[:, b] < 0
        if crossing.any():
            s, t = signed[crossing, a], signed[crossing, b]
            share = (s / (s - t))[:, None]
            points.append(triangles[crossing, a] * (1 - share) + triangles[crossing, b] * share)
    return np.concatenate(points)


def hull_volume(points: FloatArray) -> float:
    """Of the convex hull of points (n, 3), m3; 0 where they are flat."""
    if len(points) < 4:
        return 0.0
    try:
        return float(ConvexHull(points).volume)
    except (QhullError, ValueError):
        return 0.0
