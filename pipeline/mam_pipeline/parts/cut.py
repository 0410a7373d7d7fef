"""Cuts that a person made: faces of a primitive that become a primitive of their own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mam_pipeline.errors import ConfigError
from mam_pipeline.hints import Hints
from mam_pipeline.types import IntArray, KinematicTree, Primitives


def with_cuts(primitives: Primitives, hints: Hints | None) -> Primitives:
    """Primitives after the cuts of the hints; cut k becomes number count + k, the others stay.

    Raises:
        ConfigError: a face that does not exist, faces of several primitives, or a cut that takes
            the whole of one.
    """
    for k, faces in enumerate(hints.cut if hints else ()):
        where = f"{(hints.source if hints else '') or 'hints'}: cut {k + 1}"
        primitives = _cut(primitives, np.unique(np.asarray(faces, dtype=np.int64)), where)
    return primitives


def with_cuts_in_tree(
    tree: KinematicTree, before: Primitives, after: Primitives
) -> KinematicTree:  # fmt: skip
    """The tree in which what was cut off stays with the part of the primitive it comes from."""
    if after.count == before.count:
        return tree
    first = np.unique(after.labels, return_index=True)[1]
    origin = before.labels[first]  # of every primitive
    return KinematicTree(tuple(
        replace(n, primitives=tuple(np.flatnonzero(np.isin(origin, n.primitives)).tolist()))
        for n in tree.nodes
    ))  # fmt: skip


def _cut(primitives: Primitives, faces: IntArray, where: str) -> Primitives:
    labels, count = primitives.labels, primitives.count
    if not len(faces):
        raise ConfigError(f"{where} names no face")
    if faces[-1] >= len(labels):
        raise ConfigError(f"{where}: no face {faces[-1]}; there are {len(labels)}, from 0")
    (from_here, *more) = np.unique(labels[faces]).tolist()
    if more:
        raise ConfigError(f"{where} has faces of primitives {from_here} and {more[0]}: make two")
    if len(faces) == np.count_nonzero(labels == from_here):
        raise ConfigError(f"{where} takes the whole of primitive {from_here}: name the primitive")
    labels = labels.copy()
    labels[faces] = count
    merges = primitives.merges
    if len(merges):  # the cut is undone first; the nodes of a linkage are numbered after the rows
        moved = np.where(merges >= count, merges + 2, merges)
        moved[merges == from_here] = count + 1
        merges = np.concatenate([[[from_here, count]], moved])
    fronts = primitives.fronts
    return replace(
        primitives, labels=labels, merges=merges,
        fronts=np.column_stack([fronts, fronts[:, from_here]]) if len(fronts) else fronts,
    )  # fmt: skip
