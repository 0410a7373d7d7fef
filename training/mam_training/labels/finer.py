"""Pieces that are too coarse to answer about, cut along their creases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mam_pipeline.errors import InputError
from mam_pipeline.segment.fused import cut, hierarchy
from mam_pipeline.segment.topology import topology
from mam_pipeline.types import IntArray, Mesh


@dataclass(frozen=True)
class Finer:
    """How finely a piece is cut.

    Attributes:
        pieces: that one becomes; surfaces that do not touch are apart in any case.
    """

    pieces: int = 10


FINER = Finer()


def split_pieces(mesh: Mesh, labels: IntArray, pieces: Sequence[int]) -> IntArray:
    """Labels in which some pieces are cut, one after the other.

    The largest part of a piece keeps its number, the others get new ones at the end.

    Args:
        labels: (F,) piece of every face. pieces: their numbers; new ones may be cut again.

    Raises:
        InputError: no such piece, or one that has no crease to be cut along.
    """
    topo, out = topology(mesh), labels.copy()
    for piece in pieces:
        own = out == piece
        if not own.any():
            raise InputError(f"there is no piece {piece} to split; there are 0 to {out.max()}")
        chosen = np.flatnonzero(own & topo.kept)
        node: IntArray = np.full(len(mesh.faces), -1, dtype=np.int64)
        if len(chosen) > 1:
            node, _ = cut(hierarchy(topo, chosen), FINER.pieces)
        if node.max() < 1:
            raise InputError(
                f"piece {piece} cannot be cut, it is one flat surface; take it out of split in "
                "notes.json"
            )
        node = np.where(node < 0, node[np.maximum(topo.twin, 0)], node)  # repeated faces
        area = np.bincount(node[chosen], topo.areas[chosen])
        rank = np.argsort(np.argsort(-area, kind="stable"))
        new = np.where(node >= 0, rank[np.maximum(node, 0)], 0)
        out = np.where(own & (new > 0), out.max() + new, out)
    return out
