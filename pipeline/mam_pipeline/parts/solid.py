"""What lies between the primitives of one closed surface: material or air.

On a generated or scanned mesh a ray that leaves a face inwards runs through material until it
comes out at another: the two sides of a door are one body, however far apart on the surface. What
it meets outwards lies across a gap. Authored meshes are soups without an inside, so that none of
this is measured there.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mam_pipeline.parts.graph import Graph
from mam_pipeline.parts.groups import Masks
from mam_pipeline.prior.probe import DIRECTIONS, NEAR, Probe
from mam_pipeline.types import FloatArray, IntArray


@dataclass(frozen=True)
class MediumThresholds:
    """How rays tell what lies between the primitives of a closed surface.

    Attributes:
        thin: diagonals: what is thinner is a sheet.
        steep: cosine between a ray and a normal from which the way along the normal is known.
    """

    thin: float = 0.015
    steep: float = 0.6


MEDIUM = MediumThresholds()
REACHES = (("", np.inf), ("_near", NEAR), ("_thin", MEDIUM.thin))


def primitive_columns(graph: Graph) -> dict[str, np.ndarray]:
    """Columns (P,): shares of a primitive that have itself, or others, behind material or air."""
    out: dict[str, np.ndarray] = {}
    for name, share in _shares(graph):
        own = share.diagonal().copy()
        others = share - np.diag(own)
        out[f"{name}_self"], out[f"{name}_other"] = own, others.sum(axis=1)
        out[f"{name}_most"] = others.max(axis=1)
    return out


def pair_columns(graph: Graph, a: IntArray, b: IntArray) -> dict[str, np.ndarray]:
    """Columns (E,): the share of a that has b behind material or air, and of b that has a."""
    out: dict[str, np.ndarray] = {}
    for name, share in _shares(graph):
        out[f"{name}_ab"], out[f"{name}_ba"] = share[a, b], share[b, a]
    return out


def group_columns(graph: Graph, masks: Masks) -> dict[str, np.ndarray]:
    """Columns (C,): the share of a group (C, P) that has its own, or the rest, behind either."""
    weight = masks * graph.area[None]
    area = np.maximum(weight.sum(axis=1), 1e-9)
    out: dict[str, np.ndarray] = {}
    for name, share in _shares(graph):
        reached = weight @ share
        out[f"{name}_in"] = (reached * masks).sum(axis=1) / area
        out[f"{name}_out"] = (reached * ~masks).sum(axis=1) / area
    return out


def between_columns(graph: Graph, masks: Masks, chosen: np.ndarray) -> dict[str, np.ndarray]:
    """Columns (M,): the share of the parts of a set that has another part behind either.

    Args:
        masks: (K, P) parts. chosen: (M, K) which of them are in every set.
    """
    weight = masks * graph.area[None]
    area = np.maximum(weight.sum(axis=1), 1e-9)
    number = np.maximum(chosen.sum(axis=1), 1.0)
    out: dict[str, np.ndarray] = {}
    for name, share in _shares(graph):
        facing = weight @ share @ masks.T / area[:, None]
        np.fill_diagonal(facing, 0.0)
        facing = np.maximum(facing, facing.T)
        out[f"{name}_between"] = np.einsum("ma,ab,mb->m", chosen, facing, chosen) / number
    return out


def _shares(graph: Graph) -> Iterator[tuple[str, FloatArray]]:
    """(P, P) share of i's area that has j behind material, or behind air, within each reach."""
    if not graph.is_fused:
        return
    probe, count = graph.probe, graph.count
    ray = probe.hit_sample * len(DIRECTIONS) + probe.hit_direction
    order = np.lexsort((probe.hit_distance, ray))
    first = order[np.unique(ray[order], return_index=True)[1]]
    sample, direction = probe.hit_sample[first], probe.hit_direction[first]
    slope = np.einsum("ij,ij->i", probe.normals[sample], DIRECTIONS[direction]) * _winding(probe)
    distance = probe.hit_distance[first] * np.abs(slope)
    pair = probe.owner[sample] * count + probe.hit_owner[first]
    weight = probe.weight[sample] / np.maximum(probe.area, 1e-12)[probe.owner[sample]]
    for medium, there in (("material", slope < -MEDIUM.steep), ("air", slope > MEDIUM.steep)):
        for tag, reach in REACHES:
            keep = there & (distance < reach)
            share = np.bincount(pair[keep], weight[keep], minlength=count * count)
            yield medium + tag, share.reshape(count, count).astype(np.float64)


def _winding(probe: Probe) -> float:
    """1 if the normals point outwards, which is where rays escape; -1 if inwards."""
    slope = probe.normals @ DIRECTIONS.T
    free = probe.escapes()
    outwards = probe.weight @ (free & (slope > MEDIUM.steep)).sum(axis=1)
    inwards = probe.weight @ (free & (slope < -MEDIUM.steep)).sum(axis=1)
    return 1.0 if outwards >= inwards else -1.0
