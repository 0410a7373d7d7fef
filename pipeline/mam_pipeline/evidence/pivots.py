"""What a node's own origin says of its joint.

Who models a door that opens puts the origin of its node on the hinge. An origin in the middle of a
part, or one that all nodes of a file share, says nothing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mam_pipeline.types import FloatArray


@dataclass(frozen=True)
class PivotThresholds:
    """When an origin lies on an edge of a part's box; lengths as shares of its largest side.

    Attributes:
        near: distance from a side of the box at which a point lies on it.
        outside: distance at which a point has nothing to do with the box.
        same: distance between origins that are one, as a share of the object's diagonal.
        corner: how much longer one edge at a corner must be than the others to be the hinge's.
    """

    near: float = 0.1
    outside: float = 0.1
    same: float = 1e-3
    corner: float = 1.15


PIVOTS = PivotThresholds()


def hinge_axis(points: FloatArray, pivot: FloatArray, line: str = "") -> FloatArray | None:
    """Unit vector along the edge of the part's box on which its origin lies.

    Args:
        points: (N, 3) of the part. pivot: (3,) its node's origin, in the same frame, Z up.
        line: "upright" or "level" where such hinges usually lie so; "" where nobody says.

    Returns:
        None where the origin lies on no edge, or on one that contradicts `line`.
    """
    low, high = points.min(axis=0), points.max(axis=0)
    extent = high - low
    size = float(extent.max())
    if size <= 0.0 or ((pivot < low - PIVOTS.outside * size)
                       | (pivot > high + PIVOTS.outside * size)).any():  # fmt: skip
        return None
    reach = PIVOTS.near * size
    at_side = np.minimum(np.abs(pivot - low), np.abs(high - pivot)) <= reach
    thin = extent <= 2.0 * reach  # both sides are near: a sheet's thickness decides nothing
    if (at_side & ~thin).sum() == 0:
        return None
    free = np.flatnonzero(~at_side)
    if len(free) > 1:
        return None
    along = int(free[0]) if len(free) else _corner(extent, line)
    if along < 0 or (line and (along == 2) != (line == "upright")):
        return None
    return np.eye(3)[along]


def _corner(extent: FloatArray, line: str) -> int:
    """The axis of the hinge that runs through a corner; -1 where two are as likely."""
    if line == "upright":
        return 2
    order = [k for k in np.argsort(-extent) if not (line == "level" and k == 2)]
    longer = extent[order[0]] >= PIVOTS.corner * extent[order[1]]
    return int(order[0]) if longer else -1


def own_origin(pivot: FloatArray, others: FloatArray, diagonal: float) -> bool:
    """Whether an origin is a node's own: no other node of the file has the same.

    Args:
        others: (N, 3) origins of the other nodes and of the file. diagonal: of the object.
    """
    apart = np.linalg.norm(others - pivot, axis=1)
    return bool((apart > PIVOTS.same * diagonal).all())
