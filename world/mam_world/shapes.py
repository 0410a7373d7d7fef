"""Raw triangle shapes of the world kit: vertices, faces and texture coordinates, numpy only."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mam_pipeline.types import FloatArray, IntArray


class Shape(NamedTuple):
    """Triangles with outward normals: vertices (V, 3), faces (F, 3), uv (V, 2) in metres."""

    vertices: FloatArray
    faces: IntArray
    uv: FloatArray


_CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
# six sides as quads, counter-clockwise seen from outside: -x +x -y +y -z +z
_SIDES = np.array(
    [[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]]
)
_BOX_UNIT = _CORNERS[_SIDES.reshape(-1)]
_BOX_FACES = np.concatenate([[[4 * k, 4 * k + 1, 4 * k + 2], [4 * k, 4 * k + 2, 4 * k + 3]]
                             for k in range(6)]).astype(np.int64)  # fmt: skip
_BOX_UV_AXES = np.repeat([[1, 2], [1, 2], [0, 2], [0, 2], [0, 1], [0, 1]], 4, axis=0)


def box(low: ArrayLike, high: ArrayLike) -> Shape:
    """Axis-aligned box with 24 vertices; sides in the order -x +x -y +y -z +z, 2 faces each."""
    low, high = np.minimum(low, high).astype(float), np.maximum(low, high).astype(float)
    vertices = low + _BOX_UNIT * (high - low)
    return Shape(vertices, _BOX_FACES, np.take_along_axis(vertices, _BOX_UV_AXES, axis=1))


@lru_cache(maxsize=64)
def _circle(segments: int, arc: float, phase: float) -> FloatArray:
    closed = arc >= 2 * np.pi - 1e-9
    angle = phase + np.linspace(0, arc, segments + 1)[: segments if closed else None]
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def grid_faces(rows: int, columns: int, wrap_rows: bool, wrap_columns: bool) -> IntArray:
    """Faces of a (rows, columns) vertex grid; wrapping joins the last to the first."""
    i = np.arange(rows if wrap_rows else rows - 1)[:, None]
    j = np.arange(columns if wrap_columns else columns - 1)[None, :]
    a, b = i * columns + j, i * columns + (j + 1) % columns
    c, d = ((i + 1) % rows) * columns + (j + 1) % columns, ((i + 1) % rows) * columns + j
    quads = np.stack([a, b, c, d], axis=-1).reshape(-1, 4)
    return np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]]).astype(np.int64)


def revolve(profile: ArrayLike, segments: int, loop: bool = False, phase: float = 0.0) -> Shape:
    """Turn a profile (n, 2) of (radius, z) about local z; `loop` joins its last point to the first.

    An open profile runs from bottom to top along the outside; points at radius 0 close the ends.
    """
    p = np.asarray(profile, dtype=float)
    circle = _circle(segments, 2 * np.pi, phase)
    n = len(p)
    vertices = np.empty((n, segments, 3))
    vertices[..., :2] = p[:, None, :1] * circle[None]
    vertices[..., 2] = p[:, None, 1]
    faces = grid_faces(n, segments, loop, True)
    arc = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    turn = np.linspace(0, 2 * np.pi * max(p[:, 0].max(), 1e-6), segments, endpoint=False)
    uv = np.stack(np.broadcast_arrays(turn[None, :], arc[:, None]), axis=-1).reshape(-1, 2)
    return _cleaned(vertices.reshape(-1, 3), faces, uv)


def _cleaned(vertices: FloatArray, faces: IntArray, uv: FloatArray) -> Shape:
    """Drop faces without area (poles) and vertices that nothing uses; turn the inside in."""
    t = vertices[faces]
    double_area = np.linalg.norm(np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0]), axis=1)
    faces, t = faces[double_area > 1e-12], t[double_area > 1e-12]
    if np.einsum("ij,ij->", t[:, 0] - t[0, 0], np.cross(t[:, 1] - t[0, 0], t[:, 2] - t[0, 0])) < 0:
        faces = faces[:, ::-1]
    used = np.zeros(len(vertices), dtype=bool)
    used[faces] = True
    index = np.cumsum(used) - 1
    return Shape(vertices[used], index[faces], uv[used])


def oriented(vertices: FloatArray, faces: IntArray) -> Shape:
    """A closed shape turned outside out, with texture coordinates drawn from above."""
    return _cleaned(vertices, faces, vertices[:, :2].copy())


def sweep(path: ArrayLike, section: ArrayLike, loop: bool = False) -> Shape:
    """Carry a closed cross-section (m, 2) along a path (n, 3) with parallel transport.

    Args:
        path: (n, 3) points; `loop` joins the last to the first.
        section: (m, 2) or (n, m, 2) polygon, counter-clockwise, in the plane across the path.
    """
    p = np.asarray(path, dtype=float)
    s = np.asarray(section, dtype=float)
    n = len(p)
    s = np.broadcast_to(s, (n, *s.shape[-2:]))
    m = s.shape[1]
    after = np.roll(p, -1, axis=0) - p
    before = np.roll(after, 1, axis=0)
    if not loop:
        after[-1], before[0] = before[-1], after[0]
    tangent = _unit(_unit(before) + _unit(after))
    side = np.empty_like(p)
    helper = np.eye(3)[np.argmin(np.abs(tangent[0]))]
    normal = _unit(np.cross(tangent[0], helper))
    for k in range(n):
        normal = _unit(normal - tangent[k] * (normal @ tangent[k]))
        side[k] = normal
    other = np.cross(tangent, side)
    # mitre: keep the tube's width at bends
    bend = np.clip(np.einsum("ij,ij->i", tangent, _unit(after)), 0.5, 1.0)
    vertices = p[:, None] + (s[..., :1] * side[:, None] + s[..., 1:] * other[:, None]) / bend[
        :, None, None
    ] ** (0.0 if m > 8 else 1.0)
    faces = grid_faces(n, m, loop, True)
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    round_ = np.linspace(0, np.linalg.norm(s[0], axis=1).max() * 2 * np.pi, m)
    uv = np.stack(np.broadcast_arrays(round_[None, :], along[:, None]), axis=-1).reshape(-1, 2)
    if not loop:
        cap = triangulate(s[0])
        faces = np.concatenate([faces, cap[:, ::-1], cap + (n - 1) * m])
    return _cleaned(vertices.reshape(-1, 3), faces, uv)


def extrude(polygon: ArrayLike, height: float) -> Shape:
    """Prism over a simple polygon (n, 2), from local z = 0 to `height`."""
    p = np.asarray(polygon, dtype=float)
    if signed_area(p) < 0:
        p = p[::-1]
    n = len(p)
    cap = triangulate(p)
    low, high = np.c_[p, np.zeros(n)], np.c_[p, np.full(n, height)]
    i, j = np.arange(n), (np.arange(n) + 1) % n
    # walls have their own vertices, so that a crease stays a crease under smooth shading
    wall = np.concatenate([low, high, low, high])
    faces = np.concatenate([
        cap[:, ::-1], cap + n,
        np.stack([i, j, j + n], 1) + 2 * n, np.stack([i, j + n, i + n], 1) + 2 * n,
    ])  # fmt: skip
    around = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(p, axis=0), axis=1))])
    uv = np.concatenate([p, p, np.c_[around, np.zeros(n)], np.c_[around, np.full(n, height)]])
    return _cleaned(wall, faces, uv)


def circle(radius: float, segments: int, arc: float = 2 * np.pi, phase: float = 0.0) -> FloatArray:
    """(n, 2) points of a circle or arc, counter-clockwise."""
    return radius * _circle(segments, float(arc), float(phase))


def rounded_rectangle(width: float, height: float, radius: float, segments: int = 4) -> FloatArray:
    """(n, 2) outline centred on the origin, counter-clockwise."""
    r = min(radius, width / 2 - 1e-6, height / 2 - 1e-6)
    if r <= 1e-6:
        w, h = width / 2, height / 2
        return np.array([[-w, -h], [w, -h], [w, h], [-w, h]])
    out = []
    for k, (sx, sy) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1))):
        centre = np.array([sx * (width / 2 - r), sy * (height / 2 - r)])
        out.append(centre + circle(r, segments, np.pi / 2, k * np.pi / 2))
    return np.concatenate(out)


def signed_area(polygon: FloatArray) -> float:
    """Area of a polygon (n, 2), positive when counter-clockwise."""
    x, y = polygon.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def is_convex(polygon: FloatArray) -> bool:
    """Whether a counter-clockwise polygon (n, 2) is convex."""
    edge = np.roll(polygon, -1, axis=0) - polygon
    after = np.roll(edge, -1, axis=0)
    turn = edge[:, 0] * after[:, 1] - edge[:, 1] * after[:, 0]
    return bool((turn >= -1e-12).all())


def triangulate(polygon: FloatArray) -> IntArray:
    """(n - 2, 3) triangles of a simple counter-clockwise polygon: a fan, else ear clipping."""
    n = len(polygon)
    if is_convex(polygon):
        k = np.arange(1, n - 1)
        return np.stack([np.zeros_like(k), k, k + 1], axis=1).astype(np.int64)
    left: list[int] = list(range(n))
    out = []
    while len(left) > 3:
        for i in range(len(left)):
            a, b, c = left[i - 1], left[i], left[(i + 1) % len(left)]
            others = polygon[[j for j in left if j not in (a, b, c)]]
            if _is_ear(polygon[a], polygon[b], polygon[c], others):
                out.append((a, b, c))
                left.pop(i)
                break
        else:  # numerically stuck: clip anything, the outline stays right
            out.append((left[-1], left[0], left[1]))
            left.pop(0)
    return np.array([*out, tuple(left)], dtype=np.int64)


def _is_ear(a: FloatArray, b: FloatArray, c: FloatArray, others: FloatArray) -> bool:
    def side(p: FloatArray, q: FloatArray, r: FloatArray) -> NDArray[np.float64]:
        return (q[..., 0] - p[..., 0]) * (r[..., 1] - p[..., 1]) - (q[..., 1] - p[..., 1]) * (
            r[..., 0] - p[..., 0]
        )

    if side(a, b, c) <= 1e-14:
        return False
    inside = (side(a, b, others) >= 0) & (side(b, c, others) >= 0) & (side(c, a, others) >= 0)
    return not bool(inside.any())


def _unit(v: FloatArray) -> FloatArray:
    return v / np.maximum(np.linalg.norm(v, axis=-1, keepdims=True), 1e-12)


def frame(origin: ArrayLike, normal: ArrayLike, along: ArrayLike) -> FloatArray:
    """(4, 4) with local z = normal, local x = along (made perpendicular), y completing them."""
    z = _unit(np.asarray(normal, dtype=float))
    x = np.asarray(along, dtype=float)
    x = x - z * (x @ z)
    if np.linalg.norm(x) < 1e-9:
        x = np.eye(3)[np.argmin(np.abs(z))]
        x = x - z * (x @ z)
    x = _unit(x)
    out = np.eye(4)
    out[:3, 0], out[:3, 1], out[:3, 2], out[:3, 3] = x, np.cross(z, x), z, origin
    return out
