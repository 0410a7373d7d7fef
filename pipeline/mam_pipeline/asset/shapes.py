"""The simplest convex shape for a piece: box, cylinder, ball, or a hull of few points."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from mam_pipeline.asset.decompose import Chunk, hull_volume
from mam_pipeline.geometry.boxes import Box, minimal_box
from mam_pipeline.geometry.surface import hull_of
from mam_pipeline.types import CollisionShape, FloatArray

MAX_HULL_POINTS = 60
"""PhysX on a GPU takes hulls of at most 64 vertices and faces."""
MIN_THICKNESS = 0.001


def shape_around(chunk: Chunk, margin: float) -> CollisionShape:
    """The simplest shape that holds a chunk: box (plates too), cylinder, ball, or hull.

    Args:
        margin: by which it is smaller all round, metres.
    """
    points = chunk.points
    hull = hull_of(points)
    box = minimal_box(points, 20)
    if hull is None or box.half.min() < MIN_THICKNESS / 2:
        return _sheet(points, box, margin)
    if chunk.volume > 0.975 * box.volume:
        return box_shape(box, margin)
    cylinder = _cylinder(box, chunk.volume, margin)
    if cylinder is not None:
        return cylinder
    radius = float(box.half.mean())
    ball = 4.0 / 3.0 * np.pi * radius**3
    if np.ptp(box.half) < 0.03 * radius and 0.955 < chunk.volume / ball < 1.01:
        pose = np.eye(4)
        pose[:3, 3] = box.center
        return CollisionShape("sphere", pose=pose, size=np.array([radius - margin, 0.0, 0.0]))
    vertices = few_points(hull[0])
    middle = (vertices.max(axis=0) + vertices.min(axis=0)) / 2
    if len(vertices) < len(hull[0]):
        vertices = middle + (vertices - middle) * _balance(vertices, hull[0], middle)
    least = float(box.half.min())
    if margin > 0.0:
        vertices = middle + (vertices - middle) * (1.0 - min(margin / max(least, 1e-9), 0.1))
    small = hull_of(vertices)
    if small is None:
        return box_shape(box, margin)
    return CollisionShape("convex", vertices=small[0], faces=small[1])


def _sheet(points: FloatArray, box: Box, margin: float) -> CollisionShape:
    """A flat box, or a prism where the outline of flat points (n, 3) is no rectangle."""
    thin = int(box.half.argmin())
    sides = np.delete(box.axes, thin, axis=0)
    outline = (points - box.center) @ sides.T
    try:
        found = ConvexHull(outline)
    except QhullError:  # a line
        return box_shape(box, margin)
    if found.volume > 0.975 * 4.0 * np.prod(np.delete(box.half, thin)):  # its area
        return box_shape(box, margin)
    corners = outline[found.vertices]
    if len(corners) > MAX_HULL_POINTS // 4:
        corners = corners[np.linspace(0, len(corners), MAX_HULL_POINTS // 4, False).astype(int)]
    middle = corners.mean(axis=0)
    narrow = float(np.delete(box.half, thin).min())
    corners = middle + (corners - middle) * (1.0 - min(margin / max(narrow, 1e-9), 0.1))
    flat = box.center + corners @ sides
    away = MIN_THICKNESS / 2 * box.axes[thin]
    prism = hull_of(np.concatenate([flat - away, flat + away]))
    if prism is None:
        return box_shape(box, margin)
    return CollisionShape("convex", vertices=prism[0], faces=prism[1])


def shape_inside(points: FloatArray) -> CollisionShape:
    """A box if the hull of points (n, 3) is one, else a hull that reaches nowhere beyond them."""
    found = hull_of(points)
    box = minimal_box(points, 20)
    if found is None or hull_volume(points) > 0.999 * box.volume:
        return box_shape(box, 0.0)
    few = hull_of(few_points(found[0]))
    if few is None:
        return box_shape(box, 0.0)
    return CollisionShape("convex", vertices=few[0], faces=few[1])


def box_shape(box: Box, margin: float) -> CollisionShape:
    """A box as a shape, its axes named as near to x, y, z as may be; `margin` smaller all round."""
    pose = np.eye(4)
    pose[:3, :3] = box.axes.T
    pose[:3, 3] = box.center
    if np.linalg.det(pose[:3, :3]) < 0:
        pose[:3, 2] *= -1.0
    order = _upright(pose[:3, :3])
    pose[:3, :3] = pose[:3, :3] @ order
    half = np.abs(order.T) @ box.half
    half = np.maximum(half - np.minimum(margin, 0.2 * half), MIN_THICKNESS / 2)
    return CollisionShape("box", pose=pose, size=2 * half)


def _upright(axes: FloatArray) -> FloatArray:
    """(3, 3) signed permutation that turns box axes (columns) as near to the identity as may be."""
    out = np.zeros((3, 3))
    left = [0, 1, 2]
    for row in range(3):
        column = max(left, key=lambda c: abs(axes[row, c]))
        left.remove(column)
        out[column, row] = 1.0 if axes[row, column] >= 0 else -1.0
    if np.linalg.det(axes @ out) < 0:
        out[:, 2] *= -1.0
    return out


def _cylinder(box: Box, volume: float, margin: float) -> CollisionShape | None:
    for axis in range(3):
        a, b = (box.half[k] for k in range(3) if k != axis)
        radius = float(max(a, b))
        if abs(a - b) > 0.03 * radius:
            continue
        ideal = np.pi * radius**2 * 2 * box.half[axis]
        if not 0.955 < volume / ideal < 1.01:
            continue
        pose = np.eye(4)
        z = box.axes[axis]
        x = box.axes[(axis + 1) % 3]
        pose[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
        pose[:3, 3] = box.center
        length = 2 * float(box.half[axis])
        radius, length = radius - min(margin, 0.2 * radius), length - min(2 * margin, 0.4 * length)
        size = np.array([radius, length, 0.0])
        return CollisionShape("cylinder", pose=pose, size=size)
    return None


def few_points(vertices: FloatArray) -> FloatArray:
    """Few of a hull's vertices: the extreme ones in evenly spread directions."""
    if len(vertices) <= MAX_HULL_POINTS // 2:
        return vertices
    # a hull of n vertices has 2 n - 4 triangles, and faces are limited as well
    count = MAX_HULL_POINTS // 2
    k = np.arange(4 * count) + 0.5
    z, turn = 1 - 2 * k / (4 * count), np.pi * (1 + 5**0.5) * k
    ring = np.sqrt(1 - z**2)
    directions = np.stack([ring * np.cos(turn), ring * np.sin(turn), z], axis=1)
    scale = np.maximum(np.ptp(vertices, axis=0), 1e-9)
    winners = np.argmax(directions @ (vertices / scale).T, axis=1)
    chosen, votes = np.unique(winners, return_counts=True)
    return vertices[chosen[np.argsort(-votes, kind="stable")][:count]]


def _balance(few: FloatArray, all_points: FloatArray, middle: FloatArray) -> float:
    """Growth of a hull of few points so that it lies half inside and half outside the full one."""
    found = hull_of(few)
    if found is None:
        return 1.0
    vertices, faces = found
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    reach = np.einsum("ij,ij->i", normals, a - middle)
    missing = ((all_points - middle) @ normals.T).max(axis=0) - reach
    good = reach > 0.2 * np.median(reach)
    return 1.0 + 0.5 * min(float((missing[good] / reach[good]).max(initial=0.0)), 0.06)
