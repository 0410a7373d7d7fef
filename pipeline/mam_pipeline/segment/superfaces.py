"""The graph segmentation of fused meshes' faces, compiled: Numba is imported where one is split."""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True)
def _find(parent, i):  # type: ignore[no-untyped-def]
    while parent[i] != i:
        parent[i] = parent[parent[i]]
        i = parent[i]
    return i


@numba.njit(cache=True)
def superfaces(pairs, angle, share, scale, smallest):  # type: ignore[no-untyped-def]
    """Graph segmentation over edges sorted by angle; returns the root face of every face."""
    n = len(share)
    parent = np.arange(n)
    size = share.copy()
    inner = np.zeros(n)
    for e in range(len(pairs)):
        a, b = _find(parent, pairs[e, 0]), _find(parent, pairs[e, 1])
        w = angle[e]
        if a != b and w <= min(inner[a] + scale / max(size[a], 1e-30),
                               inner[b] + scale / max(size[b], 1e-30)):  # fmt: skip
            parent[b] = a
            size[a] += size[b]
            inner[a] = w
    for e in range(len(pairs)):
        a, b = _find(parent, pairs[e, 0]), _find(parent, pairs[e, 1])
        if a != b and min(size[a], size[b]) < smallest:
            parent[b] = a
            size[a] += size[b]
    out = np.empty(n, dtype=np.int64)
    for i in range(n):
        out[i] = _find(parent, i)
    return out
