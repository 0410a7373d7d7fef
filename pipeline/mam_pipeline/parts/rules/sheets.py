"""The two faces of a thin sheet are one body, and so is what stands on both of them at one place.

A door of a fused mesh has a face on either side, cut apart along its edges; seen one by one, one
of them could stay while the other opens. A lever or a knob that stands on both faces where the
other does is one: its spindle goes through the door.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from mam_pipeline.parts.rules.handle_feet import Seams
from mam_pipeline.prior.probe import DIRECTIONS, Probe
from mam_pipeline.types import FloatArray, IntArray


@dataclass(frozen=True)
class SheetThresholds:
    """When two primitives are the faces of one thin sheet, and what goes through it.

    Attributes:
        along: cosine between a sheet's normal and one of the object's directions, at least.
        cover: share of either face that has the other right behind it, at least.
        thin: a sheet's thickness over its narrower side, at most.
        standing: share of a sheet's face that what stands on it has, at most.
        sunk: share of the sheet's thickness that it may reach into it.
        same_place: diagonals between the feet on both faces, at most.
    """

    along: float = 0.9
    cover: float = 0.8
    thin: float = 0.1
    standing: float = 0.25
    sunk: float = 0.25
    same_place: float = 0.03


SHEET = SheetThresholds()


def sheets(probe: Probe, low: FloatArray, high: FloatArray) -> IntArray:
    """(S, 2) primitives that are the two faces of one thin sheet.

    Args:
        low, high: (P, 3) boxes of the primitives, object frame.
    """
    count = probe.count
    inward = -probe.normals @ DIRECTIONS.T
    way = np.where(inward.max(axis=1) > SHEET.along, np.argmax(inward, axis=1), -1)
    ahead = probe.hit_direction == way[probe.hit_sample]
    sample, depth = probe.hit_sample[ahead], probe.hit_distance[ahead]
    order = np.lexsort((depth, sample))
    sample, depth, other = sample[order], depth[order], probe.hit_owner[ahead][order]
    first = np.append(True, sample[1:] != sample[:-1])[: len(sample)]
    sample, depth, other = sample[first], depth[first], other[first]
    at, weight = (probe.owner[sample], other), probe.weight[sample]
    cover, thick = np.zeros((count, count)), np.zeros((count, count))
    np.add.at(cover, at, weight)
    np.add.at(thick, at, weight * depth)
    thick = (thick + thick.T) / np.maximum(cover + cover.T, 1e-12)
    cover /= np.maximum(probe.area, 1e-12)[:, None]
    side = np.sort(high - low, axis=1)[:, 1]
    pairs = np.minimum(cover, cover.T) > SHEET.cover
    pairs &= thick < SHEET.thin * np.minimum(side[:, None], side[None])
    return np.argwhere(np.triu(pairs, 1))


def through(
    seams: Seams, faces: IntArray, area: FloatArray, low: FloatArray, high: FloatArray
) -> NDArray[np.bool_]:
    """(T, P) what stands on both faces of a sheet at one place.

    Args:
        faces: (S, 2) the sheets. area: (P,); low, high: (P, 3) boxes of the primitives.
    """
    count = len(area)
    touch = seams.neighbours(count)
    found = []
    for sheet in faces:
        start, end = low[sheet].min(axis=0), high[sheet].max(axis=0)
        thin = int(np.argmin(end - start))
        deep = SHEET.sunk * (end[thin] - start[thin])
        sides = low[:, thin] > end[thin] - deep, high[:, thin] < start[thin] + deep
        (here, feet), (there, others) = (_standing(seams, touch, s, sheet, area) for s in sides)
        for mask, foot in zip(here, feet):
            apart = [float(np.linalg.norm(np.delete(foot - other, thin))) for other in others]
            if apart and min(apart) < SHEET.same_place:
                found.append(mask | there[int(np.argmin(apart))])
    return np.array(found, dtype=bool).reshape(-1, count)


def _standing(
    seams: Seams, touch: NDArray[np.bool_], side: NDArray[np.bool_], sheet: IntArray,
    area: FloatArray,
) -> tuple[list[NDArray[np.bool_]], list[FloatArray]]:  # fmt: skip
    """What stands on one side of a sheet, (P,) each, and where."""
    masks, feet = [], []
    side = side & ~np.isin(np.arange(len(area)), sheet)
    _, island = connected_components(touch & side & side[:, None], directed=False)
    for k in np.unique(island[touch[sheet].any(axis=0) & side]):
        mask = (island == k) & side
        elsewhere = np.setdiff1d(np.flatnonzero(touch[mask].any(axis=0) & ~mask), sheet)
        if not len(elsewhere) and area[mask].sum() < SHEET.standing * area[sheet].min():
            masks.append(mask)
            feet.append(_foot(seams, mask, sheet))
    return masks, feet


def _foot(seams: Seams, mask: NDArray[np.bool_], sheet: IntArray) -> FloatArray:
    """(3,) middle of the outline along which the primitives of `mask` meet a sheet."""
    rows = np.isin(seams.labels, sheet).any(axis=1) & mask[seams.labels].any(axis=1)
    points = seams.points[seams.ends[rows]].mean(axis=1)
    return np.asarray(np.average(points, axis=0, weights=seams.length[rows] + 1e-12))
