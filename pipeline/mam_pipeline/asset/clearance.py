"""Collision pieces of links that no joint connects are kept apart along the joints' ranges.

Simulators ignore contact between a link and its parent, but not between a knob on a door and the
carcass, or between two drawers. A piece is a little larger than its surface, so such neighbours may
jam or be thrown apart although their surfaces are clear. The moving piece is then planed off.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mam_pipeline.asset.shapes import shape_inside
from mam_pipeline.geometry.surface import hull_of
from mam_pipeline.types import Articulation, CollisionShape, FloatArray, IntArray, Joint

GAP = 0.0005
"""Room left between such pieces, as a share of the diagonal."""
STEP, LEAST_POSES, MOST_POSES = 0.005, 7, 60
"""A part moves by this share of the diagonal between two poses that are looked at: a drawer's back
wall passes the front below it within millimetres."""
_CORNERS = np.array([[x, y, z] for x in (-1.0, 1.0) for y in (-1.0, 1.0) for z in (-1.0, 1.0)])
_LEAST, THINNEST = 0.3, 0.002
"""A piece of which less than this share, or less than these metres, would be left is dropped, if
its link has others."""


@dataclass
class _Piece:
    """A convex piece at rest: (n, 3) corners and (m, 4) planes, n . x + d <= 0 inside."""

    corners: FloatArray
    planes: FloatArray
    shape: CollisionShape
    planed: bool = False


def keep_apart(
    articulation: Articulation, shapes: Mapping[str, Sequence[CollisionShape]]
) -> dict[str, list[CollisionShape]]:
    """The same pieces by link name, planed off where unconnected links would meet.

    Args:
        articulation: asset frame. shapes: pieces by link name, asset frame at rest.
    """
    links = articulation.links
    pieces = [_Pieces([_piece(s) for s in shapes.get(link.name, ())]) for link in links]
    joined = {frozenset((j.parent, j.child)) for j in articulation.joints}
    room = GAP * articulation.mesh.diagonal
    for joint in articulation.joints:
        if joint.type == "fixed":
            continue
        carried = articulation.carried_links(joint)
        others = [i for i in range(len(links)) if i not in carried]
        pairs = [(i, k) for i in carried for k in others if frozenset((i, k)) not in joined]
        if not pairs:
            continue
        reach = _reach(joint, [pieces[i] for i in carried]) / articulation.mesh.diagonal
        count = int(np.clip(np.ceil(reach / STEP) + 1, LEAST_POSES, MOST_POSES))
        for values in _poses(articulation, joint, count):
            frames = articulation.link_poses(values)
            for i, k in pairs:
                if pieces[i].items and pieces[k].items:
                    motion = np.linalg.inv(frames[k]) @ frames[i]
                    pieces[i] = _planed(pieces[i], pieces[k], motion, room)
    return {
        link.name: [shape_inside(p.corners) if p.planed else p.shape for p in own.items]
        for link, own in zip(links, pieces)
    }


class _Pieces:
    """The pieces of one link, with all their corners in one array."""

    def __init__(self, items: list[_Piece]) -> None:
        self.items = items
        self.corners = np.concatenate([p.corners for p in items]) if items else np.zeros((0, 3))
        self.starts = np.cumsum([0] + [len(p.corners) for p in items])[:-1]
        if items:
            self.low, self.high = self.bounds(np.eye(4))

    def bounds(self, motion: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(n, 3) low and high corners of the pieces, moved by `motion` (4, 4)."""
        moved = self.corners @ motion[:3, :3].T + motion[:3, 3]
        return np.minimum.reduceat(moved, self.starts), np.maximum.reduceat(moved, self.starts)


def _reach(joint: Joint, moving: Sequence[_Pieces]) -> float:
    """How far a joint carries a part, metres."""
    low = joint.lower if np.isfinite(joint.lower) else -np.pi
    high = joint.upper if np.isfinite(joint.upper) else np.pi
    if joint.type == "prismatic":
        return high - low
    arm = np.concatenate([p.corners for p in moving]) - joint.origin
    arm = arm - np.outer(arm @ joint.axis, joint.axis)
    return (high - low) * float(np.linalg.norm(arm, axis=1).max(initial=0.0))


def _poses(articulation: Articulation, joint: Joint, count: int) -> list[dict[str, float]]:
    """Joint values along the joint's range; the others are at rest, then closed."""
    closed = {j.name: j.closed for j in articulation.joints if np.isfinite(j.closed)}
    low = joint.lower if np.isfinite(joint.lower) else -np.pi
    high = joint.upper if np.isfinite(joint.upper) else np.pi
    bases = [dict.fromkeys(closed, 0.0)]
    if any(abs(v) > 1e-9 for name, v in closed.items() if name != joint.name):
        bases.append(closed)
    along = [0.0, *np.linspace(low, high, count)]
    return [{**base, joint.name: float(q)} for base in bases for q in along]


def _planed(mine: _Pieces, theirs: _Pieces, motion: FloatArray, room: float) -> _Pieces:
    """Pieces of one link, moved by `motion` (4, 4) in the other's frame, cut back from its own."""
    low, high = mine.bounds(motion)
    below, above = low[:, None] <= theirs.high, high[:, None] >= theirs.low
    near = np.asarray((below & above).all(axis=2))
    if not near.any():
        return mine
    turn, shift = motion[:3, :3], motion[:3, 3]
    out = []
    for piece, row in zip(mine.items, near):
        current: _Piece | None = piece
        for k in np.flatnonzero(row):
            if current is None:
                break
            moved = current.corners @ turn.T + shift
            plane = _separating(moved, current.planes, theirs.items[k], turn, shift)
            if plane is None:
                continue
            normal, level = plane  # the moving piece must stay where normal . x <= level - room
            current = _cut(current, turn.T @ normal, level - room - float(normal @ shift))
        if current is not None or len(mine.items) == 1:
            out.append(current or piece)
    changed = len(out) < len(mine.items) or any(a is not b for a, b in zip(out, mine.items))
    return _Pieces(out or mine.items[:1]) if changed else mine


def _separating(
    moved: FloatArray, planes: FloatArray, other: _Piece, turn: FloatArray, shift: FloatArray
) -> tuple[FloatArray, float] | None:
    """The plane (normal away from the moving piece, level) of least overlap; None if apart."""
    own = planes[:, :3] @ turn.T
    offset = planes[:, 3] - own @ shift
    gap_own = (other.corners @ own.T).min(axis=0) + offset
    gap_other = (moved @ other.planes[:, :3].T).min(axis=0) + other.planes[:, 3]
    if max(gap_own.max(), gap_other.max()) >= 0.0:
        return None
    if gap_own.max() >= gap_other.max():
        k = int(gap_own.argmax())
        return own[k], float((other.corners @ own[k]).min())
    k = int(gap_other.argmax())
    return -other.planes[k, :3], float(other.planes[k, 3])


def _cut(piece: _Piece, normal: FloatArray, level: float) -> _Piece | None:
    """A piece without what lies beyond normal . x = level; None if too little is left."""
    height = piece.corners @ normal - level
    span = float(np.ptp(height))
    if height.max() <= 0.0:
        return piece
    if -height.min() < max(_LEAST * span, THINNEST):
        return None
    inside, outside = piece.corners[height <= 0], piece.corners[height > 0]
    a, b = height[height <= 0], height[height > 0]
    share = (a[:, None] / (a[:, None] - b[None, :]))[..., None]
    crossings = inside[:, None] * (1.0 - share) + outside[None] * share
    found = hull_of(np.concatenate([inside, crossings.reshape(-1, 3)]))
    if found is None:
        return None
    return _Piece(found[0], _planes(*found), piece.shape, planed=True)


def _piece(shape: CollisionShape) -> _Piece:
    points = shape.vertices
    if shape.kind != "convex":
        half = shape.size / 2
        if shape.kind == "cylinder":
            turn = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
            ring = shape.size[0] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
            ends = (np.full((24, 1), z) for z in (-half[1], half[1]))
            local = np.concatenate([np.hstack([ring, end]) for end in ends])
        else:
            half = half if shape.kind == "box" else np.repeat(shape.size[0], 3)
            local = _CORNERS * half
        points = local @ shape.pose[:3, :3].T + shape.pose[:3, 3]
    found = hull_of(np.asarray(points))
    if found is None:
        return _Piece(np.asarray(points), np.zeros((0, 4)), shape)
    return _Piece(found[0], _planes(*found), shape)


def _planes(corners: FloatArray, faces: IntArray) -> FloatArray:
    a, b, c = (corners[faces[:, k]] for k in range(3))
    normals = np.cross(b - a, c - a)
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    good = length[:, 0] > 1e-15
    normals = normals[good] / length[good]
    offsets = -np.einsum("ij,ij->i", normals, a[good])
    return np.unique(np.round(np.column_stack([normals, offsets]), 9), axis=0)
