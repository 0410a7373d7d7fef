"""What a finished object stands on or before, and fixed things stuck to it where nothing moves."""

from __future__ import annotations

import numpy as np

from mam_pipeline.types import FloatArray, JointType, joint_motion
from mam_world import shapes
from mam_world.core import JointSpec
from mam_world.fixtures import decoy
from mam_world.kit import Builder
from mam_world.solids import settle

STOPS = 13  # joint values at which a moving part is looked at
MANY = 4000  # points of one piece; more are replaced by the corners of their box
SLACK = 0.04  # of a swept box's size: arcs bulge between the stops


def surround(b: Builder, rng: np.random.Generator) -> None:
    """Add the setting and the fixed things that the style asks for, clear of all that moves.

    Settings that would stand in the way of a moving part are left out.
    """
    if b.style.setting == "none" and b.style.decoys == 0:
        return
    b.rng = rng
    swept = swept_boxes(b)
    for _ in range(b.style.decoys):
        _stick(b, swept)
    still = np.concatenate([_box(p.shape.vertices) for p in b.pieces if p.link == 0])
    everything = np.concatenate([still, *swept])
    low, high = everything.min(axis=0), everything.max(axis=0)
    kind = b.style.setting
    if kind in ("board", "table") and low[2] >= -1e-6:
        _below(b, low, high, kind)
    elif kind in ("wall", "corner", "niche") and high[0] - still[:, 0].max() < 0.01 * b.diagonal:
        _behind(b, low, high, kind)


def swept_boxes(b: Builder) -> FloatArray:
    """(n, 2, 3) boxes that hold each moving piece over the ranges of all its joints."""
    above = {j.child: j for j in b.joints}
    out = []
    for piece in b.pieces:
        if piece.link == 0:
            continue
        points, link = _corners(_box(piece.shape.vertices)), piece.link
        while link:
            joint = above[link]
            points = np.concatenate([_moved(points, joint, q) for q in _stops(joint)])
            if len(points) > MANY:
                points = _corners(_box(points))
            link = joint.parent
        box = _box(points)
        slack = SLACK * np.ptp(box, axis=0).max() + 1e-3 * b.diagonal
        # the sides at which a part only rests need no slack: what lies still stays there
        out.append(box + np.array([[-slack], [slack]]) * (np.ptp(box, axis=0) > 0))
    return np.array(out).reshape(-1, 2, 3)


def _stops(joint: JointSpec) -> FloatArray:
    low, high = joint.lower, joint.upper
    if not np.isfinite(high - low):
        low, high = -np.pi, np.pi
    stops: FloatArray = np.linspace(low, high, STOPS, dtype=np.float64)
    return stops


def _moved(points: FloatArray, joint: JointSpec, value: float) -> FloatArray:
    kind: JointType = "prismatic" if joint.subtype == "slide" else "revolute"
    motion = joint_motion(kind, joint.axis, joint.origin, value)
    return points @ motion[:3, :3].T + motion[:3, 3]


def _box(points: FloatArray) -> FloatArray:
    return np.stack([points.min(axis=0), points.max(axis=0)])


def _corners(box: FloatArray) -> FloatArray:
    pick = np.array([(i, j, k) for i in (0, 1) for j in (0, 1) for k in (0, 1)])
    return box[pick, np.arange(3)]


def _stick(b: Builder, swept: FloatArray) -> None:
    """One fixed thing on a flat side of the body, where no moving part ever comes."""
    boxes = [p for p in b.pieces if p.link == 0 and p.is_box]
    if not boxes:
        return
    for _ in range(12):
        low, high = _box(boxes[b.integer(0, len(boxes) - 1)].shape.vertices)
        axis, sign = b.integer(0, 2), b.choice((-1.0, 1.0))
        across = [k for k in range(3) if k != axis]
        edge = float((high - low)[across].min())
        s = min(b.uniform(0.01, 0.06) * b.diagonal, 0.45 * edge)
        if s < 0.004 * b.diagonal:
            continue
        at = b.rng.uniform(low + s, np.maximum(high - s, low + s))
        at[axis] = high[axis] if sign > 0 else low[axis]
        normal = sign * np.eye(3)[axis]
        room = np.stack([at - s, at + s])
        room[:, axis] = np.sort([at[axis], at[axis] + sign * 2.2 * s])
        if room[0, 2] < 0:  # nothing sticks out below the floor
            continue
        meets = (room[0] < swept[:, 1]).all(axis=1) & (room[1] > swept[:, 0]).all(axis=1)
        if meets.any():
            continue
        with b.at(shapes.frame(at, normal, np.eye(3)[across[1]])):
            decoy(b, s)
        return


def _below(b: Builder, low: FloatArray, high: FloatArray, kind: str) -> None:
    """A board or a table under the object."""
    size = high - low
    reach = b.rng.uniform(0.02, 0.5, 4) * max(size[:2].max(), 0.3 * size[2])
    x0, y0 = low[0] - reach[0], low[1] - reach[1]
    x1, y1 = high[0] + reach[2], high[1] + reach[3]
    t = b.uniform(0.01, 0.08) * max(x1 - x0, y1 - y0)
    paint = b.choice(("wood", "stone", "metal", "light", "trim"))
    b.box("base", (x0, y0, -t), (x1, y1, 0), paint)
    if kind == "table":
        tall, leg = b.uniform(0.3, 1.2) * max(x1 - x0, y1 - y0), 0.06 * min(x1 - x0, y1 - y0)
        for x in (x0 + leg, x1 - leg):
            for y in (y0 + leg, y1 - leg):
                b.block("base", (x, y, -t - tall / 2), (2 * leg, 2 * leg, tall), paint)
        if b.chance(0.3):
            b.box("base", (x0 + leg, y0 + leg, -t - 0.8 * tall),
                  (x1 - leg, y1 - leg, -0.8 * tall), paint)  # fmt: skip
    settle(b)


def _behind(b: Builder, low: FloatArray, high: FloatArray, kind: str) -> None:
    """A wall behind the object, a room's corner, or a niche that it is built into."""
    size, gap = high - low, b.uniform(0.0, 0.02) * b.diagonal
    y0, y1 = low[1] - b.uniform(0, 0.6) * size[1], high[1] + b.uniform(0, 0.6) * size[1]
    top, t = high[2] + b.uniform(0.0, 0.8) * size[2], b.uniform(0.02, 0.08) * b.diagonal
    x = high[0] + gap * b.choice((0.0, 1.0))
    deep = b.uniform(0.3, 1.0) * size[0]
    sides = []
    if kind in ("corner", "niche"):
        sides = [-1, 1] if kind == "niche" else [b.choice((-1, 1))]
        if -1 in sides:
            y0 = low[1] - gap - 1e-3 * b.diagonal
        if 1 in sides:
            y1 = high[1] + gap + 1e-3 * b.diagonal
    b.box("base", (x, y0, min(low[2], 0)), (x + t, y1, top), "light")
    for side in sides:
        y = sorted((y0 - t, y0) if side < 0 else (y1, y1 + t))
        b.box("base", (x - deep, y[0], min(low[2], 0)), (x + t, y[1], top), "light")
    if kind == "niche" and b.chance(0.6):
        up = max(top, high[2] + gap + 1e-3 * b.diagonal)
        b.box("base", (x - deep, y0 - t, up), (x + t, y1 + t, up + t), "light")
    if low[2] < 0:
        settle(b)
