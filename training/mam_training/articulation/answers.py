"""What the network of parts says of an object, and the groups of primitives that follow from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, softmax

from mam_pipeline.parts.features import Table
from mam_pipeline.parts.groups import Masks
from mam_pipeline.types import FloatArray

Array = NDArray[np.float32]
CLIP = 5.0
"""Normalised features are cut here."""
MOST_COUNTED = 12
"""Larger numbers of parts are told as this one."""


@dataclass(frozen=True)
class Grouping:
    """How the network's answers become groups.

    Attributes:
        least: chance of moving from which a primitive may be of a part.
        apart: mean log odds of being one body below which groups are not joined.
    """

    least: float = 0.05
    apart: float = -6.0


GROUPING = Grouping()


@dataclass(frozen=True)
class Answers:
    """What the network says of one object's primitives.

    Attributes:
        move: (P,) log odds that a primitive moves. same: (P, P) that two are one body.
        motion: (P, 12) logits of hinge, spin and slide; an axis (not of unit length), a point of
            the line relative to the primitive's centre, three numbers that are not used; object's
            frame. area: (P,) shares of the object's area.
    """

    move: FloatArray
    same: FloatArray
    motion: FloatArray
    area: FloatArray

    def groups(self) -> Masks:
        """(C, P) all groups of an average-linkage agglomeration of what may move."""
        alive = np.flatnonzero(expit(self.move) > GROUPING.least)
        nodes = merge_tree(self.same[np.ix_(alive, alive)], np.sqrt(self.area[alive]) + 0.02)
        masks = np.zeros((len(nodes), len(self.area)), dtype=bool)
        for row, node in zip(masks, nodes):
            row[alive[node]] = True
        return masks[~masks.all(axis=1)]

    def value(self, masks: Masks) -> FloatArray:
        """(C,) expected IoU of groups with the true part of a primitive drawn from each."""
        one = expit(self.same)
        np.fill_diagonal(one, 1.0)
        inside = (masks * self.area) @ one.T
        outside = np.maximum((self.area @ one.T)[None] - inside, 0.0)
        each = inside / ((masks @ self.area)[:, None] + outside + 1e-12)
        weight = masks * (np.sqrt(self.area) + 1e-4)
        weight = weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-12)
        return np.asarray((weight * expit(self.move) * each).sum(axis=1))

    def odds(self, masks: Masks) -> FloatArray:
        """(C, 3) chances of hinge, spin and slide."""
        weight = masks * self.area
        weight = weight / np.maximum(weight.sum(axis=1, keepdims=True), 1e-12)
        return np.asarray(softmax(weight @ self.motion[:, :3], axis=1))

    def axis(self, mask: NDArray[np.bool_]) -> FloatArray:
        """(3,) unit direction of a group's motion, of either sign, object's frame."""
        own = np.flatnonzero(mask)
        vectors = self.motion[own, 3:6]
        vectors = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9)
        scatter = (vectors * self.area[own, None]).T @ vectors
        return np.asarray(np.linalg.eigh(scatter)[1][:, -1])


def merge_tree(same: FloatArray, weight: FloatArray) -> list[list[int]]:
    """Members of every node of an average-linkage agglomeration, single ones first.

    Args:
        same: (P, P) log odds of being one body. weight: (P,).
    """
    nodes = [[k] for k in range(len(weight))]
    at = list(range(len(weight)))
    link, size = np.clip(same, -8.0, 8.0).copy(), np.asarray(weight, dtype=float).copy()
    while len(at) > 1:
        np.fill_diagonal(link, -np.inf)
        row, column = np.unravel_index(int(np.argmax(link)), link.shape)
        a, b = sorted((int(row), int(column)))
        if link[a, b] < GROUPING.apart:
            break
        merged = (size[a] * link[a] + size[b] * link[b]) / (size[a] + size[b])
        link[a], link[:, a] = merged, merged
        size[a] += size[b]
        nodes.append(nodes[at[a]] + nodes[at[b]])
        at[a] = len(nodes) - 1
        at.pop(b)
        link, size = np.delete(np.delete(link, b, 0), b, 1), np.delete(size, b)
    return nodes


def filled(found: Table, names: tuple[str, ...]) -> Array:
    """(n, len(names)) columns of a table, NaN where it lacks one."""
    out = np.full((len(found.values), len(names)), np.nan, np.float32)
    for k, name in enumerate(names):
        if name in found.names:
            out[:, k] = found.column(name)
    return out


def normalised(values: NDArray, scale: Array) -> Array:
    """Feature rows (n, F) by median and spread (2, F), cut; what is unknown becomes 0."""
    z = np.clip((values.astype(np.float32) - scale[0]) / scale[1], -CLIP, CLIP)
    return np.nan_to_num(z, nan=0.0)
