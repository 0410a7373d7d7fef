"""The object's own axes, found from its surface: they turn with it."""

from __future__ import annotations

import numpy as np

from mam_pipeline.types import FloatArray


def dominant_frame(normals: FloatArray, areas: FloatArray) -> FloatArray:
    """Three orthonormal directions (rows) that most of the surface faces.

    The first carries the largest area within a few degrees, the second the largest among those
    square to it; a round object falls back on the principal axes of its normals.

    Args:
        normals: (F, 3) unit normals; zero for degenerate faces.
        areas: (F,) weights.
    """
    moment = (normals * areas[:, None]).T @ normals
    principal = np.linalg.eigh(moment)[1].T[::-1]
    seeds = _strongest(normals, areas)
    if seeds is None:
        return principal
    first = _refine(seeds, normals, areas, principal[0])
    square = np.abs(normals @ first) < 0.1
    flat = normals[square] - np.outer(normals[square] @ first, first)
    length = np.linalg.norm(flat, axis=1)
    flat = flat / np.where(length > 0, length, 1.0)[:, None]
    weight = areas[square]
    second = _strongest(flat, weight) if len(flat) else None
    if second is None:
        second = principal[1] - (principal[1] @ first) * first
    else:
        second = _refine(second, flat, weight, second)
        second = second - (second @ first) * first
    second = second / np.linalg.norm(second)
    return np.stack([first, second, np.cross(first, second)])


def _strongest(normals: FloatArray, areas: FloatArray) -> FloatArray | None:
    """The direction (up to sign) of the heaviest bin of nearly equal normals."""
    if not len(normals) or areas.sum() <= 0:
        return None
    fold = normals * _sign(normals)[:, None]
    best: tuple[float, FloatArray] | None = None
    heavy = np.argsort(-areas, kind="stable")[:64]
    moments = fold * areas[:, None]
    key = np.round(fold * 16).astype(np.int64) @ np.array([10007, 101, 1])
    _, inverse = np.unique(key, return_inverse=True)
    sums = np.zeros((int(inverse.max()) + 1, 3))
    np.add.at(sums, inverse, moments)
    top = sums[np.argsort(-np.linalg.norm(sums, axis=1), kind="stable")[:16]]
    for seed in np.concatenate([top, fold[heavy]]):
        length = np.linalg.norm(seed)
        if length == 0:
            continue
        seed = seed / length
        weight = float(areas[np.abs(fold @ seed) > 0.996].sum())
        if best is None or weight > best[0] * 1.0001:
            best = (weight, seed)
    return None if best is None else best[1]


def _refine(
    seed: FloatArray, normals: FloatArray, areas: FloatArray, fallback: FloatArray
) -> FloatArray:
    for _ in range(3):
        dot = normals @ seed
        near = np.abs(dot) > 0.996
        mean = (normals[near] * (np.sign(dot[near]) * areas[near])[:, None]).sum(axis=0)
        length = np.linalg.norm(mean)
        if length == 0:
            return fallback
        seed = mean / length
    return seed


def _sign(normals: FloatArray) -> FloatArray:
    x, y, z = normals.T
    lead = np.where(np.abs(x) > 1e-3, x, np.where(np.abs(y) > 1e-3, y, z))
    return np.where(lead < 0, -1.0, 1.0)
