"""The pieces of an authored soup: shells joined over clean edges, doubles united, specks absorbed.

The "hybrid" rule: joining over every shared edge welds moving parts that touch at coincident
vertices; joining only over edges with exactly two faces shatters what was modelled with T-junctions
and inner walls; so shells are joined over clean edges and open fragments re-joined afterwards.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import open3d as o3d
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mam_pipeline.segment.topology import Topology, groups
from mam_pipeline.types import FloatArray, IntArray


@dataclass(frozen=True)
class PieceThresholds:
    """When fragments of an authored mesh are one piece; lengths in bounding-box diagonals.

    Attributes:
        rejoin_share: share of the smaller fragment's faces that lie on edges shared with the
            larger, at least.
        same_box: how far the corners of two shells' boxes may differ.
        speck: box diagonal below which a piece is nobody's part on its own.
    """

    rejoin_share: float = 0.4
    same_box: float = 0.005
    speck: float = 0.025


PIECES = PieceThresholds()


def components(topo: Topology, frame: FloatArray) -> IntArray:
    """(F,) piece of every kept face, -1 for the others (see `spread`).

    Args:
        frame: (3, 3) rows are the object's own axes; boxes are measured along them.
    """
    count = len(topo.faces)
    label = groups(topo.manifold, count)
    label = dense(label, topo.kept)
    label = _rejoin_open(topo, label)
    label = _unite_same_box(topo, label, frame)
    return label


def specks(topo: Topology, label: IntArray, area: float = 0.0) -> NDArray[np.bool_]:
    """(F,) the faces of pieces with too small a box diagonal; none if there is nothing else.

    Args:
        area: pieces with less than this share of all area are specks too.
    """
    low, high = boxes(topo.points, topo, label)
    own = np.bincount(label[label >= 0], weights=topo.areas[label >= 0])
    small = (np.linalg.norm(high - low, axis=1) < PIECES.speck) | (own < area * topo.areas.sum())
    if small.all():
        return np.zeros(len(label), dtype=bool)
    return np.asarray((label >= 0) & small[label])


def absorb_specks(
    topo: Topology, pieces: IntArray, speck: NDArray[np.bool_], label: IntArray
) -> IntArray:
    """Give every speck, whole, to the label that is nearest to its surface.

    Args:
        pieces: (F,) with specks as pieces of their own. label: (F,) -1 on them.
    """
    lost = np.flatnonzero(speck)
    if not len(lost):
        return label
    target = np.flatnonzero(label >= 0)
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor.from_numpy(topo.points.astype(np.float32)),
        o3d.core.Tensor.from_numpy(topo.faces[target].astype(np.uint32)),
    )
    centres = topo.points[topo.faces[lost]].mean(axis=1).astype(np.float32)
    answer = scene.compute_closest_points(o3d.core.Tensor.from_numpy(centres))
    owner = label[target[answer["primitive_ids"].numpy().astype(np.int64)]]
    gap = np.linalg.norm(answer["points"].numpy() - centres, axis=1)
    # the whole speck goes where its nearest face points
    order = np.lexsort((owner, gap, pieces[lost]))
    piece, first = np.unique(pieces[lost][order], return_index=True)
    out = label.copy()
    out[lost] = owner[order][first][np.searchsorted(piece, pieces[lost])]
    return out


def spread(topo: Topology, label: IntArray) -> IntArray:
    """(F,) labels of all faces: repeated copies follow their twin, degenerate ones the nearest."""
    out = label.copy()
    copies = (out < 0) & (topo.twin >= 0)
    out[copies] = label[topo.twin[copies]]
    lost = np.flatnonzero(out < 0)
    if len(lost) and len(lost) < len(out):
        known = np.flatnonzero(out >= 0)
        at_vertex = np.full(len(topo.points), -1, dtype=np.int64)
        at_vertex[topo.faces[known].reshape(-1)] = np.repeat(out[known], 3)
        out[lost] = at_vertex[topo.faces[lost]].max(axis=1)
        lost = np.flatnonzero(out < 0)
        if len(lost):
            centres = topo.points[topo.faces].mean(axis=1)
            out[lost] = out[known[cKDTree(centres[known]).query(centres[lost])[1]]]
    out[out < 0] = 0
    return out


def boxes(points: FloatArray, topo: Topology, label: IntArray) -> tuple[FloatArray, FloatArray]:
    """Lower and upper corners (C, 3) of each piece's box in the axes of `points`."""
    kept = np.flatnonzero(label >= 0)
    count = int(label.max()) + 1
    order = kept[np.argsort(label[kept], kind="stable")]
    start = np.searchsorted(label[order], np.arange(count))
    corner = points[topo.faces[order]]
    low = np.minimum.reduceat(corner.min(axis=1), start, axis=0)
    high = np.maximum.reduceat(corner.max(axis=1), start, axis=0)
    return low, high


def dense(label: IntArray, kept: NDArray[np.bool_]) -> IntArray:
    """Labels of the kept faces as 0, 1, ..., -1 for the others."""
    out = np.full(len(label), -1, dtype=np.int64)
    out[kept] = np.unique(label[kept], return_inverse=True)[1]
    return out


def _rejoin_open(topo: Topology, label: IntArray) -> IntArray:
    """Join fragments that share edges of three or more faces along much of the smaller one."""
    if not len(topo.rim_face):
        return label
    count = int(label.max()) + 1
    size = np.bincount(label[label >= 0], minlength=count)
    piece, edge, face = label[topo.rim_face], topo.rim_edge, topo.rim_face
    order = np.lexsort((piece, edge))
    piece, edge, face = piece[order], edge[order], face[order]
    links: list[IntArray] = []
    closed = np.zeros(count, dtype=bool)
    closed[label[(topo.solid >= 0) & (label >= 0)]] = True
    # a rim edge carries few pieces: compare each half-edge with the next ones of the same edge
    for step in (1, 2, 3):
        same = (edge[step:] == edge[:-step]) & (piece[step:] != piece[:-step])
        same &= ~(closed[piece[step:]] & closed[piece[:-step]])
        a, b = piece[:-step][same], piece[step:][same]
        fa, fb = face[:-step][same], face[step:][same]
        smaller = np.where(size[a] <= size[b], fa, fb)
        links.append(np.stack([a, b, smaller], axis=1))
    rows = np.unique(np.concatenate(links), axis=0)
    if not len(rows):
        return label
    pairs, faces_on_rim = np.unique(rows[:, :2], axis=0, return_counts=True)
    swap = size[pairs[:, 0]] > size[pairs[:, 1]]
    small, large = np.where(swap[:, None], pairs[:, ::-1], pairs).T
    share = faces_on_rim / size[small]
    good = share >= PIECES.rejoin_share
    small, large, share = small[good], large[good], share[good]
    # each goes to its one best partner only: a scrap between two bodies must not weld them
    order = np.lexsort((large, -size[large], -share, small))
    _, best = np.unique(small[order], return_index=True)
    links_kept = np.stack([small[order][best], large[order][best]], axis=1)
    merged = groups(links_kept, count)
    return np.where(label >= 0, merged[label], -1)


def _unite_same_box(topo: Topology, label: IntArray, frame: FloatArray) -> IntArray:
    """Unite shells that fill the same box: inner and outer shells, caps with their tube."""
    low, high = boxes(topo.points @ frame.T, topo, label)
    extent = np.linalg.norm(high - low, axis=1)
    pairs = cKDTree(np.hstack([low, high])).query_pairs(PIECES.same_box, output_type="ndarray")
    if not len(pairs):
        return label
    corners = np.hstack([low, high])
    gap = np.abs(corners[pairs[:, 0]] - corners[pairs[:, 1]]).max(axis=1)
    close = gap < 0.05 * np.minimum(extent[pairs[:, 0]], extent[pairs[:, 1]])
    merged = groups(pairs[close].astype(np.int64), len(low))
    return np.where(label >= 0, merged[label], -1)
