"""Normals for shading: smooth across gentle edges, sharp at creases."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.types import FloatArray, Mesh

CREASE = np.radians(40.0)
"""Faces that meet at a larger angle keep an edge between them."""
_MANY = 64
"""Faces at one point beyond which no more are looked at."""


def corner_normals(mesh: Mesh) -> FloatArray:
    """(F, 3, 3) unit normal of every corner: the mean of the faces at its point, weighted by area,
    that are turned less than `CREASE` from its own; zero for faces without area."""
    corners = mesh.vertices[mesh.faces]
    weighted = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    length = np.linalg.norm(weighted, axis=1, keepdims=True)
    unit = np.divide(weighted, length, out=np.zeros_like(weighted), where=length > 0)
    point = np.unique(mesh.vertices, axis=0, return_inverse=True)[1].reshape(-1)[mesh.faces]
    order = np.argsort(point.reshape(-1), kind="stable")  # corners of one point side by side
    face = order // 3
    sorted_point = point.reshape(-1)[order]
    first = np.searchsorted(sorted_point, sorted_point, side="left")
    count = np.searchsorted(sorted_point, sorted_point, side="right") - first
    place = np.arange(len(order)) - first
    total = weighted[face].copy()
    for step in range(1, min(int(count.max(initial=1)), _MANY)):
        who: NDArray[np.int64] = np.flatnonzero(count > step)
        other = face[first[who] + (place[who] + step) % count[who]]
        near = np.einsum("ij,ij->i", unit[face[who]], unit[other]) > np.cos(CREASE)
        total[who[near]] += weighted[other[near]]
    out = np.empty_like(total)
    out[order] = total
    size = np.linalg.norm(out, axis=1, keepdims=True)
    return np.divide(out, size, out=np.zeros_like(out), where=size > 0).reshape(-1, 3, 3)
