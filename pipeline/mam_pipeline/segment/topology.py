"""Faces of a soup made comparable: welded by position, duplicates found, edges counted."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from mam_pipeline.types import FloatArray, IntArray, Mesh, Primitives


@dataclass(frozen=True)
class TopologyThresholds:
    """When vertices are one, and what a closed shell is.

    Attributes:
        least_faces: faces of a closed shell, at least.
        weld: diagonals between vertices that are one: twice what single precision loses on a turned
            mesh.
    """

    least_faces: int = 4
    weld: float = 1e-5


TOPOLOGY = TopologyThresholds()


@dataclass(frozen=True)
class Topology:
    """What the segmenter knows of each face; the mesh itself is never changed.

    Attributes:
        points: (W, 3) welded vertices, in units of the bounding-box diagonal.
        faces: (F, 3) indices into `points`.
        normals, areas: (F, 3) unit (zero for degenerate faces) and (F,) diagonal squared.
        kept: (F,) True for the faces that take part: neither degenerate nor a repeated copy.
        twin: (F,) the kept face that each face repeats, itself if kept, -1 if degenerate.
        solid: (F,) the closed shell of the file's own vertices that a face belongs to, -1 if none.
        manifold: (E, 2) pairs of kept faces on edges with exactly two kept faces; an edge where
            solids meet counts as one of each.
        manifold_edge: (E, 2) the welded vertices of those edges.
        rim_face, rim_edge: (H,) faces and edge numbers of edges with three or more kept faces.
        open_face: (B,) kept faces, one entry per edge that has no other face.
    """

    points: FloatArray
    faces: IntArray
    normals: FloatArray
    areas: FloatArray
    kept: NDArray[np.bool_]
    twin: IntArray
    solid: IntArray
    manifold: IntArray
    manifold_edge: IntArray
    rim_face: IntArray
    rim_edge: IntArray
    open_face: IntArray


def topology(mesh: Mesh) -> Topology:
    """Weld, drop repeated faces and count edges; linear in the number of faces up to sorting."""
    scaled, welded = _welded(mesh)
    first = np.full(int(welded.max()) + 1, -1, dtype=np.int64)
    first[welded[::-1]] = np.arange(len(welded))[::-1]
    points, faces = scaled[first], welded[mesh.faces]
    a, b, c = (points[faces[:, i]] for i in range(3))
    cross = np.cross(b - a, c - a)
    double = np.linalg.norm(cross, axis=1)
    thin = double < 1e-14
    normals = cross / np.where(thin, 1.0, double)[:, None]
    normals[thin] = 0.0
    solid = solids(mesh.faces)
    twin = repeated_faces(faces, solid)
    broken = (np.diff(np.sort(faces, axis=1), axis=1) == 0).any(axis=1)
    twin[broken] = -1
    kept = twin == np.arange(len(faces))
    pairs, pair_edges, rim_face, rim_edge, open_face = _edges(faces, np.flatnonzero(kept), solid)
    return Topology(
        points,
        faces,
        normals,
        0.5 * double,
        kept,
        twin,
        solid,
        pairs,
        pair_edges,
        rim_face,
        rim_edge,
        open_face,
    )


def without_repeats(mesh: Mesh, primitives: Primitives) -> tuple[Mesh, Primitives]:
    """The mesh with one copy of every face, and its primitives.

    What samples a surface counts a doubled face twice, and sees its normal both ways. Copies in
    another primitive stay: parts may lie face to face.
    """
    label = primitives.labels
    twin = repeated_faces(_welded(mesh)[1][mesh.faces])
    kept = (twin == np.arange(len(twin))) | (label[twin] != label)
    if kept.all():
        return mesh, primitives
    return mesh.submesh(kept), replace(primitives, labels=label[kept])


def _welded(mesh: Mesh) -> tuple[FloatArray, IntArray]:
    """(V, 3) vertices in units of the diagonal, and (V,) which of them are one."""
    scaled = (mesh.vertices - mesh.bounds[0]) / (mesh.diagonal or 1.0)
    return scaled, weld(scaled, TOPOLOGY.weld)


def weld(points: FloatArray, tolerance: float) -> IntArray:
    """(V,) group of each point; points nearer than about `tolerance` share one.

    Two grids, the second shifted by half a cell, so that rounding splits no pair that is much
    closer than the tolerance.
    """
    keys = []
    for shift in (0.0, 0.5):
        cells = np.floor(points / tolerance + shift).astype(np.int64)
        cells -= cells.min(axis=0)
        span = cells.max(axis=0) + 1
        key = (cells[:, 0] * span[1] + cells[:, 1]) * span[2] + cells[:, 2]
        keys.append(np.unique(key, return_inverse=True)[1])
    a, b = keys
    n, m = int(a.max()) + 1, int(b.max()) + 1
    graph = coo_matrix((np.ones(len(a), dtype=np.int8), (a, b + n)), shape=(n + m, n + m))
    return connected_components(graph, directed=False)[1][a].astype(np.int64)


def solids(faces: IntArray) -> IntArray:
    """(F,) number of the closed shell that each face belongs to, -1 where there is none.

    Shells hang together by the file's own vertices, not by position: two boxes that touch corner to
    corner are two. Closed is what has two faces on every edge, doubled ones counted once.
    """
    kept = np.flatnonzero(repeated_faces(faces) == np.arange(len(faces)))
    corner = faces[kept]
    ends = np.stack([corner, np.roll(corner, -1, axis=1)], axis=2).reshape(-1, 2)
    count = int(faces.max()) + 1
    shell = groups(ends, count)
    key = ends.min(axis=1) * np.int64(count) + ends.max(axis=1)
    _, edge, uses = np.unique(key, return_inverse=True, return_counts=True)
    closed = np.bincount(shell[corner[:, 0]], minlength=count) >= TOPOLOGY.least_faces
    closed[shell[ends[uses[edge] != 2, 0]]] = False
    own = shell[faces[:, 0]]
    return np.where(closed[own], own, -1)


def repeated_faces(faces: IntArray, solid: IntArray | None = None) -> IntArray:
    """(F,) the lowest-numbered face on the same three vertices, whatever its orientation.

    Args:
        solid: (F,) faces of different ones do not repeat each other.
    """
    rows = np.sort(faces, axis=1).astype(np.uint64)
    odd = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9], dtype=np.uint64)
    mixed = rows * odd
    key = mixed[:, 0] + (mixed[:, 1] >> np.uint64(5)) + mixed[:, 1] + (mixed[:, 2] >> np.uint64(9))
    if solid is not None:
        key += (solid + 1).astype(np.uint64) * np.uint64(0xD6E8FEB86659FD93)
    order = np.argsort(key, kind="stable")
    new = np.ones(len(faces), dtype=bool)
    new[1:] = (rows[order[1:]] != rows[order[:-1]]).any(axis=1)
    if solid is not None:
        new[1:] |= solid[order[1:]] != solid[order[:-1]]
    group = np.cumsum(new) - 1
    twin = np.empty(len(faces), dtype=np.int64)
    twin[order] = order[new][group]
    return twin


def groups(pairs: IntArray, count: int) -> IntArray:
    """(count,) connected component of each item under the (E, 2) links."""
    ones = np.ones(len(pairs), dtype=np.int8)
    graph = coo_matrix((ones, (pairs[:, 0], pairs[:, 1])), shape=(count, count))
    return connected_components(graph, directed=False)[1].astype(np.int64)


def _edges(faces: IntArray, kept: IntArray, solid: IntArray) -> tuple[IntArray, ...]:
    corner = faces[kept]
    ends = np.stack([corner, np.roll(corner, -1, axis=1)], axis=2).reshape(-1, 2)
    owner = np.repeat(kept, 3)
    low, high = ends.min(axis=1), ends.max(axis=1)
    key = low * (int(faces.max()) + 1) + high
    order = np.lexsort((solid[owner], key))
    key, owner, low, high = key[order], owner[order], low[order], high[order]
    start, size = _runs(key[1:] != key[:-1])
    within, uses = _runs((key[1:] != key[:-1]) | (solid[owner[1:]] != solid[owner[:-1]]))
    clean = np.isin(within, start[size == 2]) | (solid[owner[within]] >= 0)
    two = within[clean & (uses == 2)]
    pairs = np.stack([owner[two], owner[two + 1]], axis=1)
    pair_edges = np.stack([low[two], high[two]], axis=1)
    many = np.repeat(size, size) > 2
    number = np.repeat(np.arange(len(size)), size)
    return pairs, pair_edges, owner[many], number[many], owner[start[size == 1]]


def _runs(new: NDArray[np.bool_]) -> tuple[IntArray, IntArray]:
    """Starts and lengths of the runs of a list, given where (n - 1,) the next one begins."""
    if not len(new):
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    start = np.flatnonzero(np.concatenate([[True], new]))
    return start, np.diff(np.concatenate([start, [len(new) + 1]]))
