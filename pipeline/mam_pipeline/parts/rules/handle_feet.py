"""What stands on two feet: a handle moves with the flat that it stands on, not by itself.

Parts that can only move together are one part. On a fused mesh a bow handle and its front are
pieces of one surface, and the handle alone seems to be something that could be turned or pulled;
but what stands on two feet on one flat can do neither. Where a flat carries several of them it may
be several fronts whose gaps have closed, so that nothing is said.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from mam_pipeline.types import FloatArray, IntArray


@dataclass(frozen=True)
class FeetThresholds:
    """When something stands on a flat on two feet.

    Attributes:
        share: share of the flat's area that what stands on it has; less, and the flat may be a wall
            in which the gaps around the fronts have closed.
        narrow: both feet's outlines together, in square roots of the area of what stands on them,
            at most.
        foot: share of both outlines that makes a foot.
        flat: cosine between the mean normals around both feet, each as long as they are alike, at
            least.
        across: most cosine between a foot's normal and the way from foot to foot.
    """

    share: tuple[float, float] = (0.12, 0.6)
    narrow: float = 2.0
    foot: float = 0.08
    flat: float = 0.8
    across: float = 0.3


FEET = FeetThresholds()


@dataclass(frozen=True)
class Seams:
    """Mesh edges between two primitives.

    Attributes:
        points: (V, 3). ends: (S, 2) vertices of each edge. faces: (S, 2) on its two sides;
            labels: (S, 2) their primitives. length: (S,).
    """

    points: FloatArray
    ends: IntArray
    faces: IntArray
    labels: IntArray
    length: FloatArray

    def neighbours(self, count: int) -> NDArray[np.bool_]:
        """(P, P) which of `count` primitives share an edge."""
        out = np.zeros((count, count), dtype=bool)
        out[self.labels[:, 0], self.labels[:, 1]] = True
        return out | out.T


@dataclass(frozen=True)
class Surface:
    """The faces that primitives are made of.

    Attributes:
        labels: (F,) primitive. middle: (F, 3). normal: (F, 3). area: (F,).
    """

    labels: IntArray
    middle: FloatArray
    normal: FloatArray
    area: FloatArray


def standing(seams: Seams, surface: Surface, count: int) -> NDArray[np.bool_]:
    """(T, P) what moves as one: a flat and the primitives of what stands on it on two feet.

    No primitive is in two rows.

    Args:
        count: of primitives.
    """
    area = np.bincount(surface.labels, surface.area, minlength=count)
    touch = seams.neighbours(count)
    found = []
    for flat in np.flatnonzero(touch.any(axis=1)):
        others = np.arange(count) != flat
        _, island = connected_components(touch & others & others[:, None], directed=False)
        on_it = [
            mask for k in np.unique(island[touch[flat]])
            if area[mask := (island == k) & others].sum() < FEET.share[1] * area[flat]
            and _on_two_feet(seams, surface, mask, int(flat), float(area[mask].sum()))
        ]  # fmt: skip
        if len(on_it) == 1 and area[on_it[0]].sum() > FEET.share[0] * area[flat]:
            found.append(on_it[0] | ~others)
    return disjoint(np.array(found, dtype=bool).reshape(-1, count))


def disjoint(bodies: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """(T', P) the bodies (T, P) with those that share a primitive made one."""
    number, body = connected_components(bodies.astype(int) @ bodies.T.astype(int), directed=False)
    merged = [bodies[body == k].any(axis=0) for k in range(number)]
    return np.array(merged, dtype=bool).reshape(-1, bodies.shape[1])


def _on_two_feet(
    seams: Seams, surface: Surface, mask: NDArray[np.bool_], flat: int, area: float
) -> bool:
    """Whether the primitives of `mask` meet `flat` along two narrow outlines, side by side."""
    rows = np.flatnonzero((seams.labels == flat).any(axis=1) & mask[seams.labels].any(axis=1))
    ends, length = seams.ends[rows], seams.length[rows]
    used, local = np.unique(ends, return_inverse=True)
    local = local.reshape(-1, 2)
    links = coo_matrix((np.ones(len(rows)), (local[:, 0], local[:, 1])), shape=(len(used),) * 2)
    outline = connected_components(links, directed=False)[1][local[:, 0]]
    size = np.bincount(outline, length)
    feet = np.flatnonzero(size > FEET.foot * size.sum())
    if len(feet) != 2 or size.sum() > FEET.narrow * np.sqrt(area):
        return False
    ground = np.flatnonzero(surface.labels == flat)
    up, at = [], []
    for foot in feet:
        on = outline == foot
        middle = np.average(seams.points[ends[on]].mean(axis=1), axis=0, weights=length[on])
        near = ground[np.linalg.norm(surface.middle[ground] - middle, axis=1) < size[foot]]
        weight = surface.area[near]
        up.append(weight @ surface.normal[near] / max(float(weight.sum()), 1e-12))
        at.append(middle)
    way = (at[1] - at[0]) / max(float(np.linalg.norm(at[1] - at[0])), 1e-12)
    return float(up[0] @ up[1]) > FEET.flat and abs(float(way @ up[0])) < FEET.across
