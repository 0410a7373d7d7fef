"""The graph segmentation of fused meshes: edges in the order of their angle, once through."""

from __future__ import annotations

import numpy as np

from mam_pipeline.types import FloatArray, IntArray


def superfaces(
    pairs: IntArray, angle: FloatArray, share: FloatArray, scale: float, smallest: float
) -> IntArray:
    """Join neighbouring faces across flat edges (Felzenszwalb and Huttenlocher 2004).

    Args:
        pairs: (E, 2) faces on both sides of each edge, sorted by angle.
        angle: (E,) radians between them. share: (F,) of the total area.
        scale: how willingly small regions grow. smallest: share below which a region joins another.

    Returns:
        (F,) one face of its region for every face.
    """
    parent = list(range(len(share)))
    size: list[float] = share.tolist()
    steepest = [0.0] * len(share)  # edge within each region

    def region(face: int) -> int:
        while (above := parent[face]) != face:
            parent[face] = face = parent[above]
        return face

    edges = list(zip(pairs[:, 0].tolist(), pairs[:, 1].tolist()))
    for (one, other), bend in zip(edges, angle.tolist()):
        a, b = region(one), region(other)
        if a != b and bend <= min(
            steepest[a] + scale / max(size[a], 1e-30), steepest[b] + scale / max(size[b], 1e-30)
        ):
            parent[b] = a
            size[a] += size[b]
            steepest[a] = bend
    for one, other in edges:
        a, b = region(one), region(other)
        if a != b and min(size[a], size[b]) < smallest:
            parent[b] = a
            size[a] += size[b]
    return np.array([region(face) for face in range(len(parent))], dtype=np.int64)
