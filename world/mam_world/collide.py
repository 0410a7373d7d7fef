"""Exact convex collision pieces for the shapes of the kit."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from mam_pipeline.types import CollisionShape, FloatArray, IntArray
from mam_world import shapes

SIDES = ((0.03, 16), (0.015, 12), (0.0, 8))  # of prisms that stand for cones, by radius
SLIVER = 3e-4  # columns narrower than this are left out, metres
WAFER = 0.003  # slanting slabs thinner than this count as steps, metres
WEDGES = 10  # around a hollow vessel


def box(low: ArrayLike, high: ArrayLike) -> CollisionShape:
    """Axis-aligned box."""
    corners: FloatArray = np.array([low, high], dtype=np.float64)
    pose = np.eye(4)
    pose[:3, 3] = corners.mean(axis=0)
    return CollisionShape("box", pose, np.ptp(corners, axis=0))


def sphere(center: ArrayLike, radius: float) -> CollisionShape:
    """Sphere."""
    pose = np.eye(4)
    pose[:3, 3] = center
    return CollisionShape("sphere", pose, np.array([radius, 0, 0]))


def cylinder(start: ArrayLike, end: ArrayLike, radius: float) -> CollisionShape:
    """Cylinder between two points."""
    start, end = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    pose = shapes.frame((start + end) / 2, end - start, (1, 0, 0))
    return CollisionShape("cylinder", pose, np.array([radius, np.linalg.norm(end - start), 0]))


def rings(stack: FloatArray) -> CollisionShape:
    """Convex piece from (m, n, 3) rings: m outlines of n points joined side by side."""
    m, n = stack.shape[:2]
    k = np.arange(1, n - 1)
    fan = np.stack([np.zeros_like(k), k, k + 1], axis=1)
    sides = shapes.grid_faces(m, n, False, True)
    faces: IntArray = np.concatenate([sides, fan[:, ::-1], fan + (m - 1) * n])
    return CollisionShape("convex", vertices=stack.reshape(-1, 3), faces=faces)


def solid(profile: ArrayLike) -> list[CollisionShape]:
    """Pieces of a solid of revolution about local z; profile (n, 2) of (radius, z).

    One piece for every convex stretch, without detail below a millimetre: PhysX drops corners that
    stand out by less than 0.2 mm, one here and one there, and what is left may explode on contact.
    """
    out = []
    for run in _convex_runs(_stepped(_fewer(np.asarray(profile, dtype=float), 8))):
        if np.ptp(run[:, 0]) < 1e-9:
            out.append(cylinder([0, 0, run[0, 1]], [0, 0, run[-1, 1]], float(run[0, 0])))
            continue
        sides = next(n for radius, n in SIDES if run[:, 0].max() >= radius)
        ring = shapes.circle(1.0, sides)
        layers = [np.c_[ring * max(r, 1e-5), np.full(sides, z)] for r, z in run]
        out.append(rings(np.stack(layers)))
    return out


def _stepped(profile: FloatArray) -> FloatArray:
    """The profile (n, 2) with its wafer-thin slanting slabs made steps, on their inner side."""
    p = profile.copy()
    for k in range(len(p) - 1):
        (r0, z0), (r1, z1) = p[k], p[k + 1]
        slab = 1e-9 < z1 - z0 < WAFER and z1 - z0 < 0.3 * abs(r1 - r0)
        if slab and r1 < r0 and k + 2 < len(p) and p[k + 2, 1] > z1:
            p[k + 1, 1] = z0
        elif slab and r1 > r0 and k > 0 and p[k - 1, 1] < z0:
            p[k, 1] = z1
    return p


def _convex_runs(profile: FloatArray) -> list[FloatArray]:
    """A profile (n, 2) cut into stretches (k, 2) that a convex body can follow, steps left out."""
    runs: list[list[FloatArray]] = []
    slope = np.inf
    for start, end in pairwise(profile):
        (r0, z0), (r1, z1) = start, end
        if abs(z1 - z0) < 1e-9:
            slope = -np.inf  # a step ends the stretch
            continue
        rise = (r1 - r0) / (z1 - z0) if z1 > z0 else np.inf
        if runs and rise <= slope + 1e-9:
            runs[-1].append(end)
        else:
            runs.append([start, end])
        slope = rise if z1 > z0 else -np.inf
    return [np.array(run) for run in runs]


def shell(profile: ArrayLike, wall: float, bottom: bool) -> list[CollisionShape]:
    """Wedges of a hollow solid of revolution about local z (see Builder.vessel)."""
    p = _fewer(np.asarray(profile, dtype=float), 4)
    edge = shapes.circle(1.0, WEDGES)
    # the polygon's edges lie inside the circle: its corners go out half-way, its insides in
    reach = 1.0 / np.cos(np.pi / WEDGES)
    out = []
    for (r0, z0), (r1, z1) in pairwise(p):
        if abs(z1 - z0) < 1e-9:
            continue
        for k in range(WEDGES):
            a, b = edge[k], edge[(k + 1) % WEDGES]
            layers = []
            for r, z in ((r0, z0), (r1, z1)):
                inner, outer = max(r - wall, 1e-5) * reach, r * 0.5 * (1 + reach)
                xy = np.stack([a * inner, a * outer, b * outer, b * inner])
                layers.append(np.c_[xy, np.full(4, z)])
            out.append(rings(np.stack(layers)))
    if bottom:
        out.append(cylinder([0, 0, p[0, 1]], [0, 0, p[0, 1] + wall], p[0, 0]))
    return out


def path(points: ArrayLike, radius: float, loop: bool = False) -> list[CollisionShape]:
    """Cylinders along a bent rod."""
    p = np.asarray(points, dtype=float)
    if len(p) > 13:
        p = p[np.linspace(0, len(p) - 1, 12 if not loop else 13).round().astype(int)]
    ends = np.roll(p, -1, axis=0)
    pairs = list(zip(p, ends))[: None if loop else -1]
    return [cylinder(a, b, radius) for a, b in pairs if np.linalg.norm(b - a) > 1e-6]


def prism(polygon: ArrayLike, height: float) -> list[CollisionShape]:
    """Prisms over a simple polygon: one if it is convex, else one for each of its columns."""
    p = np.asarray(polygon, dtype=float)
    if shapes.signed_area(p) < 0:
        p = p[::-1]
    outlines = [p] if shapes.is_convex(p) else _columns(p)
    return [
        rings(np.stack([np.c_[o, np.zeros(len(o))], np.c_[o, np.full(len(o), height)]]))
        for o in outlines
    ]


def _columns(polygon: FloatArray) -> list[FloatArray]:
    """A simple polygon (n, 2) cut at its corners into trapezoids with two sides along y.

    Triangles would be pointed slivers, of which a simulator finds contacts that are none.
    """
    ends = np.roll(polygon, -1, axis=0)
    cuts = [polygon[:, 0].min()]
    for x in np.unique(polygon[:, 0]):
        if x - cuts[-1] > SLIVER:
            cuts.append(x)
    out = []
    for x0, x1 in pairwise(cuts):
        middle = 0.5 * (x0 + x1)
        over = np.flatnonzero((polygon[:, 0] > middle) != (ends[:, 0] > middle))
        a, b = polygon[over], ends[over]
        slope = (b[:, 1] - a[:, 1]) / (b[:, 0] - a[:, 0])
        at = np.stack([a[:, 1] + (x - a[:, 0]) * slope for x in (x0, middle, x1)], axis=1)
        edge = np.sort(np.stack([a[:, 1], b[:, 1]], axis=1), axis=1)
        at = np.clip(at, edge[:, :1], edge[:, 1:])
        at = at[at[:, 1].argsort()]
        for low, high in zip(at[::2], at[1::2]):
            if high[1] - low[1] > SLIVER:
                outline = [(x0, low[0]), (x1, low[2])]
                outline += [(x1, high[2])] if high[2] > low[2] + SLIVER else []
                outline += [(x0, high[0])] if high[0] > low[0] + SLIVER else []
                out.append(np.array(outline))
    return out


def moved(shape: CollisionShape, matrix: FloatArray) -> CollisionShape:
    """The piece moved by a rigid transform (4, 4)."""
    if shape.kind == "convex":
        vertices = shape.vertices @ matrix[:3, :3].T + matrix[:3, 3]
        return CollisionShape("convex", vertices=vertices, faces=shape.faces)
    return CollisionShape(shape.kind, matrix @ shape.pose, shape.size)


def all_moved(pieces: Sequence[CollisionShape], matrix: FloatArray) -> tuple[CollisionShape, ...]:
    """`moved` for several pieces."""
    return tuple(moved(p, matrix) for p in pieces)


def _fewer(profile: FloatArray, segments: int) -> FloatArray:
    """A profile with at most so many segments: points at equal steps, both ends kept."""
    if len(profile) <= segments + 1:
        return profile
    return profile[np.linspace(0, len(profile) - 1, segments + 1).round().astype(int)]
