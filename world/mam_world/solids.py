"""Solids of the mechanism families: pierced plates, trays, prisms, bars, and setting down.

Functions take the builder first and draw in its current frame. Plates and profiles are drawn in
two coordinates across a named axis: (y, z) across x, (x, z) across y, (x, y) across z.
"""

# ruff: noqa: RUF005  (a point plus a tuple is a vector sum here, not a joined list)

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from mam_pipeline.types import FloatArray, IntArray
from mam_world import collide, shapes
from mam_world.kit import Builder
from mam_world.shapes import Shape

Axis = Literal["x", "y", "z"]
_ORDER: dict[str, tuple[int, int, int]] = {"x": (1, 2, 0), "y": (0, 2, 1), "z": (0, 1, 2)}
_NORMAL: dict[str, FloatArray] = {a: np.eye(3)[_ORDER[a][2]] for a in "xyz"}
TAU = 2 * np.pi


def _lift(uv: FloatArray, height: float, axis: str) -> FloatArray:
    out = np.empty((len(uv), 3))
    i, j, k = _ORDER[axis]
    out[:, i], out[:, j], out[:, k] = uv[:, 0], uv[:, 1], height
    return out


def _shape(vertices: FloatArray, faces: IntArray) -> Shape:
    """Outward shape with texture coordinates drawn from above and from the side."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    if np.einsum("ij,ij->", np.cross(a, b), c) < 0:
        faces = faces[:, ::-1]
    uv = np.c_[vertices[:, 0] + vertices[:, 1], vertices[:, 1] + vertices[:, 2]]
    return Shape(vertices, np.ascontiguousarray(faces), uv)


def part(b: Builder, kind: str, name: str | None = None) -> str:
    """A new moving link named after its kind."""
    return b.link(name or kind, kind)


def profile(
    b: Builder,
    link: str,
    polygon: ArrayLike,
    low: float,
    high: float,
    axis: Axis = "z",
    material: str = "body",
    role: str = "solid",
) -> None:
    """Prism over a polygon drawn across `axis`, from `low` to `high` along it."""
    if axis == "z":
        with b.moved((0, 0, low)):
            b.extrude(link, polygon, high - low, material, role)
    elif axis == "x":
        with b.facing((low, 0, 0), (1, 0, 0), (0, 1, 0)):
            b.extrude(link, polygon, high - low, material, role)
    else:
        with b.facing((0, high, 0), (0, -1, 0), (1, 0, 0)):
            b.extrude(link, polygon, high - low, material, role)


def outline(low: ArrayLike, high: ArrayLike, radius: float, n: int = 4) -> FloatArray:
    """(m, 2) rectangle with rounded corners between two (2,) corners."""
    lo, hi = np.asarray(low, float), np.asarray(high, float)
    width, height = float(hi[0] - lo[0]), float(hi[1] - lo[1])
    return shapes.rounded_rectangle(width, height, radius, n) + (lo + hi) / 2


def rounded(
    b: Builder,
    link: str,
    low: ArrayLike,
    high: ArrayLike,
    radius: float,
    axis: Axis = "z",
    material: str = "body",
    role: str = "solid",
) -> None:
    """Box whose four edges along `axis` are rounded."""
    lo, hi = np.asarray(low, float), np.asarray(high, float)
    i, j, k = _ORDER[axis]
    profile(b, link, outline(lo[[i, j]], hi[[i, j]], radius), lo[k], hi[k], axis, material, role)


def plate(
    b: Builder,
    link: str,
    us: Sequence[float],
    vs: Sequence[float],
    solid: ArrayLike,
    low: float,
    high: float,
    axis: Axis = "z",
    material: str = "body",
    role: str = "solid",
) -> None:
    """One closed plate of rectangular cells, `solid` (len(us)-1, len(vs)-1) saying which exist."""
    mask = np.asarray(solid, bool)
    nv = mask.shape[1]
    grid = np.array([(u, v) for u in us for v in vs], float)
    total = len(grid)
    i, j = np.nonzero(mask)
    p00, p10 = i * (nv + 1) + j, (i + 1) * (nv + 1) + j
    p01, p11 = p00 + 1, p10 + 1
    quads = [np.stack([p00, p01, p11, p10], 1), np.stack([p00, p10, p11, p01], 1) + total]
    pad = np.pad(mask, 1)
    for near, far, di, dj in (
        (p00, p10, 1, 0),
        (p10, p11, 2, 1),
        (p11, p01, 1, 2),
        (p01, p00, 0, 1),
    ):
        wall = ~pad[i + di, j + dj]
        near, far = near[wall], far[wall]
        quads.append(np.stack([near, far, far + total, near + total], 1))
    q = np.concatenate(quads)
    faces = np.concatenate([q[:, [0, 1, 2]], q[:, [0, 2, 3]]])
    used, inverse = np.unique(faces.reshape(-1), return_inverse=True)
    v = np.concatenate([_lift(grid, low, axis), _lift(grid, high, axis)])[used]
    boxes = []
    for k in range(mask.shape[0]):
        runs = np.flatnonzero(np.diff(np.r_[0, mask[k].astype(int), 0]))
        for s, e in runs.reshape(-1, 2):
            ends = _lift(np.array([(us[k], vs[s]), (us[k + 1], vs[e])]), low, axis)
            ends[1, _ORDER[axis][2]] = high
            boxes.append(collide.box(ends[0], ends[1]))
    b.add(link, _shape(v, inverse.reshape(-1, 3)), boxes, material, role)


def frame(
    b: Builder,
    link: str,
    low: ArrayLike,
    high: ArrayLike,
    border: float,
    axis: Axis,
    material: str = "body",
) -> None:
    """Rectangular frame of bars `border` wide; `axis` is its thickness direction."""
    lo, hi = np.asarray(low, float), np.asarray(high, float)
    i, j, k = _ORDER[axis]
    us = [lo[i], lo[i] + border, hi[i] - border, hi[i]]
    vs = [lo[j], lo[j] + border, hi[j] - border, hi[j]]
    plate(b, link, us, vs, [[1, 1, 1], [1, 0, 1], [1, 1, 1]], lo[k], hi[k], axis, material)


def pierced(
    b: Builder,
    link: str,
    low: ArrayLike,
    high: ArrayLike,
    holes: Sequence[Sequence[float]],
    axis: Axis = "z",
    material: str = "body",
) -> None:
    """Plate with rectangular holes (u0, v0, u1, v1), one closed shape."""
    lo, hi = np.asarray(low, float), np.asarray(high, float)
    i, j, k = _ORDER[axis]
    h = np.asarray(holes, float).reshape(-1, 4)
    us = np.unique(np.round([lo[i], hi[i], *h[:, 0], *h[:, 2]], 7))
    vs = np.unique(np.round([lo[j], hi[j], *h[:, 1], *h[:, 3]], 7))
    cu, cv = (us[1:] + us[:-1]) / 2, (vs[1:] + vs[:-1]) / 2
    solid = np.ones((len(cu), len(cv)), bool)
    for u0, v0, u1, v1 in h:
        solid &= ~(((cu > u0) & (cu < u1))[:, None] & ((cv > v0) & (cv < v1))[None, :])
    plate(b, link, us.tolist(), vs.tolist(), solid, lo[k], hi[k], axis, material)


def bored(
    b: Builder,
    link: str,
    low: ArrayLike,
    high: ArrayLike,
    axis: Axis,
    centre: ArrayLike,
    radius: float,
    material: str = "body",
) -> None:
    """Box with one round hole right through along `axis`; `centre` (2,) in drawing coordinates."""
    lo, hi, c = (np.asarray(a, float) for a in (low, high, centre))
    i, j, k = _ORDER[axis]
    near, far = lo[[i, j]] - c, hi[[i, j]] - c
    corner = np.arctan2([near[1], near[1], far[1], far[1]], [near[0], far[0], near[0], far[0]])
    t = np.arange(b.segments(radius, low=12)) * (TAU / b.segments(radius, low=12))
    t = np.unique(np.round(np.concatenate([t, corner % TAU]), 9))
    d = np.stack([np.cos(t), np.sin(t)], axis=1)
    with np.errstate(divide="ignore"):
        reach = np.where(d > 1e-9, far / d, np.where(d < -1e-9, near / d, np.inf)).min(axis=1)
    outer, inner = c + d * reach[:, None], c + d * radius
    v = np.concatenate(
        [
            _lift(outer, lo[k], axis),
            _lift(outer, hi[k], axis),
            _lift(inner, hi[k], axis),
            _lift(inner, lo[k], axis),
        ]
    )
    walls = []
    for u0, u1, v0, v1 in (
        (lo[i], c[0] - radius, lo[j], hi[j]),
        (c[0] + radius, hi[i], lo[j], hi[j]),
        (c[0] - radius, c[0] + radius, lo[j], c[1] - radius),
        (c[0] - radius, c[0] + radius, c[1] + radius, hi[j]),
    ):
        ends = _lift(np.array([(u0, v0), (u1, v1)]), lo[k], axis)
        ends[1, k] = hi[k]
        walls.append(collide.box(ends[0], ends[1]))
    b.add(link, _shape(v, shapes.grid_faces(4, len(t), True, True)), walls, material)


def tray(
    b: Builder,
    link: str,
    low: ArrayLike,
    high: ArrayLike,
    wall: float,
    axis: Axis = "z",
    opens: int = 1,
    material: str = "body",
    floor: float | None = None,
    taper: float = 0.0,
) -> None:
    """Box open on one side (`axis` with sign `opens`), one closed shape of outer and inner skin.

    `taper` draws the closed side in by that much, metres.
    """
    lo, hi = np.asarray(low, float), np.asarray(high, float)
    i, j, k = _ORDER[axis]
    start, mouth = (lo[k], hi[k]) if opens > 0 else (hi[k], lo[k])
    inner_floor = start + (wall if floor is None else floor) * np.sign(mouth - start)
    outer = np.array([(lo[i], lo[j]), (hi[i], lo[j]), (hi[i], hi[j]), (lo[i], hi[j])])
    inward = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)], float)
    inner = outer + wall * inward
    loops = [
        (outer + taper * inward, start),
        (outer, mouth),
        (inner, mouth),
        (inner + taper * inward, inner_floor),
    ]
    v = np.concatenate([_lift(loop, h, axis) for loop, h in loops])
    faces = [[0, 2, 1], [0, 3, 2], [12, 13, 14], [12, 14, 15]]
    for ring in range(0, 12, 4):
        for a in range(4):
            c = (a + 1) % 4
            faces += [[ring + a, ring + c, ring + 4 + c], [ring + a, ring + 4 + c, ring + 4 + a]]
    solids = [collide.rings(np.stack([v[[0, 1, 2, 3]], np.r_[v[12:16]]]))]
    for a in range(4):
        c = (a + 1) % 4
        solids.append(
            collide.rings(np.stack([v[[a, c, 12 + c, 12 + a]], v[[4 + a, 4 + c, 8 + c, 8 + a]]]))
        )
    b.add(link, _shape(v, np.array(faces)), solids, material)


def wedge(
    b: Builder,
    link: str,
    bottom: ArrayLike,
    top: ArrayLike,
    z0: float,
    z1: float,
    material: str = "body",
    role: str = "solid",
) -> None:
    """Solid between two rectangles (x0, y0, x1, y1) at two heights: hoppers, keys, car bodies."""
    rows = []
    for (x0, y0, x1, y1), z in ((np.asarray(bottom, float), z0), (np.asarray(top, float), z1)):
        rows.append([(x0, y0, z), (x1, y0, z), (x1, y1, z), (x0, y1, z)])
    piece = collide.rings(np.array(rows))
    b.add(link, _shape(piece.vertices, piece.faces), [piece], material, role)


def bar(
    b: Builder,
    link: str,
    start: ArrayLike,
    end: ArrayLike,
    width: float,
    thick: float,
    normal: ArrayLike = (0, 0, 1),
    material: str = "body",
    role: str = "solid",
) -> None:
    """Straight bar of rectangular section between two points, `thick` along `normal`."""
    p, q = np.asarray(start, float), np.asarray(end, float)
    length = float(np.linalg.norm(q - p))
    with b.facing(p, normal, q - p):
        b.box(link, (0, -width / 2, -thick / 2), (length, width / 2, thick / 2), material, role)


def arc(
    centre: ArrayLike, radius: float, start: float, stop: float, n: int = 9, axis: Axis = "y"
) -> FloatArray:
    """(n, 3) points of an arc drawn across `axis`."""
    t = np.linspace(start, stop, n)
    uv = radius * np.stack([np.cos(t), np.sin(t)], axis=1)
    return _lift(uv, 0.0, axis) + np.asarray(centre, float)


def settle(b: Builder) -> None:
    """Set the finished object down: its lowest point comes to the floor, z = 0."""
    drop = -min(float(p.shape.vertices[:, 2].min()) for p in b.pieces)
    if drop == 0.0:
        return
    shift = np.eye(4)
    shift[2, 3] = drop
    for piece in b.pieces:
        piece.shape = piece.shape._replace(vertices=piece.shape.vertices + (0, 0, drop))
        piece.collision = collide.all_moved(piece.collision, shift)
    for joint in b.joints:
        joint.origin = joint.origin + (0, 0, drop)
    b.grasps = [(i, replace(g, position=g.position + (0, 0, drop))) for i, g in b.grasps]
