"""The embedded segmenter: a mesh's faces cut into primitives by geometry alone (paper 3.2)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.backends import Availability
from mam_pipeline.errors import InputError
from mam_pipeline.rules import ALL_RULES, Rules
from mam_pipeline.segment.components import (
    absorb_specks,
    components,
    dense,
    specks,
    spread,
)
from mam_pipeline.segment.frame import dominant_frame
from mam_pipeline.segment.fronts import divide, fronts, joined
from mam_pipeline.segment.fused import cut, hierarchy
from mam_pipeline.segment.topology import Topology, groups, topology
from mam_pipeline.types import FloatArray, IntArray, Mesh, Primitives


@dataclass(frozen=True)
class SplitThresholds:
    """Which pieces hold several parts in one surface, and into how many primitives they are cut.

    Attributes:
        dominant: share of all area: a piece beyond it must hold more than the base.
        nearly: share of all area of what is split; beside a fused mesh handles may float.
        dense_faces: faces of a piece that was meshed anew, at least.
        even: area of a typical face over its piece's, at most; authored panels have far larger
            faces.
        clear: cost above which a merge is left to the reasoner.
        shred: share of all area: less than this on a surface of its own is no primitive.
        flat: diagonals that a vertex may lie beyond a face of a convex body.
        fewest: least number of primitives from splitting.
        most: largest number of primitives from splitting.
    """

    dominant: float = 0.98
    nearly: float = 0.9
    dense_faces: int = 1000
    even: float = 0.004
    clear: float = 0.02
    shred: float = 1e-4
    flat: float = 1e-4
    fewest: int = 16
    most: int = 60


SPLIT = SplitThresholds()


class GeometricSegmenter:
    """Primitives from connectivity (authored meshes) and from creases (fused ones).

    Deterministic; the partition does not depend on scale, turning about the vertical or the order
    of faces. Only where handles tell fronts of one fused surface apart is it asked which way is up.

    Args:
        clear: cost above which pieces of one surface stay apart (`segment.fused`).
        rules: hand rules that are followed.
    """

    def __init__(self, clear: float = SPLIT.clear, rules: Rules = ALL_RULES) -> None:
        self.clear = clear
        self.rules = rules

    @classmethod
    def available(cls) -> Availability:
        """It needs nothing, so it can always run."""
        return Availability(True, "embedded", version="1", licence="Apache-2.0")

    def with_rules(self, rules: Rules) -> GeometricSegmenter:
        """See `rules.Ruled`."""
        return GeometricSegmenter(self.clear, rules)

    def segment(self, mesh: Mesh, seed: int = 0) -> Primitives:
        """Cut `mesh` into primitives, largest first; every face gets a label.

        Raises:
            InputError: the mesh has no face with an area.
        """
        if not len(mesh.faces):
            raise InputError("the mesh has no faces")
        topo = topology(mesh)
        if not topo.kept.any() or topo.areas.sum() <= 0:
            raise InputError("the mesh has no face with an area")
        frame = dominant_frame(topo.normals, topo.areas)
        pieces = components(topo, frame)
        speck = specks(topo, pieces)
        whole = absorb_specks(topo, pieces, speck, dense(pieces, (pieces >= 0) & ~speck))
        inside = _to_split(topo, whole)
        if not inside.any():
            return Primitives(by_area(spread(topo, whole), topo.areas), method="geometric")
        # loose triangles along bad edges would each cost a primitive
        shreds = dense(groups(topo.manifold, len(topo.faces)), inside)
        loose = specks(topo, shreds, SPLIT.shred)
        tree = hierarchy(topo, np.flatnonzero(inside & ~loose))
        # every surface of its own keeps at least one node, so disjoint ones are never joined
        alone = topo.areas[inside].sum() >= SPLIT.nearly * topo.areas[topo.kept].sum()
        fewest = (
            SPLIT.fewest if alone else 1
        )  # a finely cut panel beside other pieces may stay whole
        count = int(np.clip(1 + (tree.costs > self.clear).sum(), fewest, SPLIT.most))
        split, merges = cut(tree, count)
        others = np.unique(np.where(inside, -1, whole), return_inverse=True)[1] - 1
        label = np.where(inside, split, np.where(whole >= 0, others + 1 + split.max(), -1))
        label = absorb_specks(topo, shreds, loose, label)
        leaves = int(split.max()) + 1
        body: IntArray = np.full(len(label), -1, dtype=np.int64)
        if alone and self.rules.closed_fronts:
            label, origin, body = divide(topo, label, leaves)
            merges = joined(merges, leaves, origin)
            leaves += len(origin)
        label, merges = _numbered(topo, label, merges, leaves)
        told = fronts(topo, label, body)
        return Primitives(label, merges, "geometric, split along creases", told)


def _to_split(topo: Topology, label: IntArray) -> NDArray[np.bool_]:
    """(F,) the kept faces of pieces that hold several parts in one surface.

    Those are pieces that make up nearly everything, and large pieces of many small triangles of
    like size, as generators and scanners write them. A convex body of few faces holds none: a door
    may be nearly all there is.
    """
    kept = label >= 0
    piece, areas = label[kept], topo.areas[kept]
    area = np.bincount(piece, weights=areas)
    square = np.bincount(piece, weights=areas**2)
    faces = np.bincount(piece)
    share = area / area.sum()
    typical = square / np.maximum(area, 1e-30) ** 2  # typical face over the piece's area
    remeshed = (faces >= SPLIT.dense_faces) & (typical < SPLIT.even) & (share >= 0.1)
    most = (share >= SPLIT.dominant) & (faces >= SPLIT.dense_faces)
    for k in np.flatnonzero((share >= SPLIT.dominant) & ~most):
        most[k] = not _convex(topo, np.flatnonzero(label == k))
    out = np.zeros(len(label), dtype=bool)
    out[kept] = (most | remeshed)[piece]
    return out


def _convex(topo: Topology, faces: IntArray) -> bool:
    """Whether every vertex of these faces lies on one side of each of them."""
    points = topo.points[np.unique(topo.faces[faces])]
    origin = topo.points[topo.faces[faces, 0]]
    height = topo.normals[faces] @ points.T - (topo.normals[faces] * origin).sum(axis=1)[:, None]
    return bool((np.minimum(height.max(axis=1), -height.min(axis=1)) < SPLIT.flat).all())


def _numbered(
    topo: Topology, label: IntArray, merges: IntArray, leaves: int
) -> tuple[IntArray, IntArray]:
    """Fill all faces and number by area; the merge tree over the first `leaves` labels follows."""
    full = spread(topo, label)
    ranked = by_area(full, topo.areas)
    total = int(ranked.max()) + 1
    move = np.zeros(int(label.max()) + 1, dtype=np.int64)
    move[full] = ranked
    node = np.concatenate([move[:leaves], total + np.arange(len(merges))])
    return ranked, node[merges] if len(merges) else merges


def by_area(label: IntArray, areas: FloatArray) -> IntArray:
    """Number the labels 0, 1, ... from the largest surface to the smallest."""
    dense = np.unique(label, return_inverse=True)[1]
    rank = np.argsort(np.argsort(-np.bincount(dense, weights=areas), kind="stable"))
    return rank[dense].astype(np.int64)
