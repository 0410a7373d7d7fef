"""Surfaces of single links: welded components, closedness, hulls; shared by collision and mass."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError

from mam_pipeline.types import Articulation, FloatArray, IntArray


@dataclass(frozen=True)
class Component:
    """One connected piece of surface, welded by position, without repeated faces.

    Attributes:
        vertices: (V, 3) metres. faces: (F, 3).
        source: (F,) indices of the faces in the articulation's mesh.
        closed: every edge belongs to exactly two faces that are wound alike.
    """

    vertices: FloatArray
    faces: IntArray
    source: IntArray
    closed: bool

    @property
    def triangles(self) -> FloatArray:
        """(F, 3, 3) corner positions."""
        return self.vertices[self.faces]

    @property
    def extent(self) -> FloatArray:
        """(3,) size of the axis-aligned box, metres."""
        return np.asarray(np.ptp(self.vertices, axis=0))


def link_triangles(articulation: Articulation, link: int) -> FloatArray:
    """(F, 3, 3) corners of a link's faces, asset frame at rest."""
    mesh = articulation.mesh
    return mesh.vertices[mesh.faces[articulation.links[link].faces]]


def link_components(articulation: Articulation, link: int) -> list[Component]:
    """The connected pieces of a link, largest area first."""
    faces = articulation.links[link].faces
    tolerance = 1e-5 * articulation.mesh.diagonal
    return components(link_triangles(articulation, link), faces, tolerance)


def components(triangles: FloatArray, source: IntArray, tolerance: float) -> list[Component]:
    """Split triangles (F, 3, 3) into connected pieces.

    Corners nearer than about `tolerance` are one vertex; degenerate faces go; of faces with the
    same corners (double-sided soups) one stays. Faces are joined over shared edges, not over
    single vertices, so boxes that touch at a corner stay apart.
    """
    vertices, faces, index = weld(triangles, tolerance)
    kept = np.asarray(source)[index]
    if not len(faces):
        return []
    labels = _edge_labels(faces)
    out = []
    for label in range(labels.max() + 1):
        mine = faces[labels == label]
        used, local = np.unique(mine, return_inverse=True)
        local = local.reshape(-1, 3)
        out.append(Component(vertices[used], local, kept[labels == label], _closed(local)))
    areas = [float(triangle_areas(c.triangles).sum()) for c in out]
    return [out[i] for i in np.argsort(areas, kind="stable")[::-1]]


def weld(triangles: FloatArray, tolerance: float) -> tuple[FloatArray, IntArray, IntArray]:
    """Indexed surface of triangles (n, 3, 3): corners nearer than about `tolerance` are one vertex.

    Returns:
        (V, 3) vertices, (F, 3) faces without degenerate and repeated ones (of a double-sided
        soup's two faces one stays), and the (F,) index of each among the triangles.
    """
    if not len(triangles):
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64), np.zeros(0, np.int64)
    keys = np.round(triangles.reshape(-1, 3) / max(tolerance, 1e-12)).astype(np.int64)
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    vertices = triangles.reshape(-1, 3)[first]
    faces = inverse.reshape(-1, 3)
    proper = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2])
    index = np.flatnonzero(proper & (faces[:, 2] != faces[:, 0]))
    _, once = np.unique(np.sort(faces[index], axis=1), axis=0, return_index=True)
    index = index[np.sort(once)]
    return vertices, faces[index], index


def triangle_areas(triangles: FloatArray) -> FloatArray:
    """(F,) areas of triangles (F, 3, 3)."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))


def hull_of(points: FloatArray) -> tuple[FloatArray, IntArray] | None:
    """Convex hull as (n, 3) vertices and (m, 3) outward faces; None where it has no volume."""
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):
        return None
    if hull.volume <= 0.0:
        return None
    used = hull.vertices
    back = np.full(len(points), -1)
    back[used] = np.arange(len(used))
    corners = points[hull.simplices]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inward = np.einsum("ij,ij->i", normals, hull.equations[:, :3]) < 0
    faces = back[hull.simplices]
    faces[inward] = faces[inward][:, ::-1]
    return points[used], faces.astype(np.int64)


def _edges(faces: IntArray) -> IntArray:
    return faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)


def _edge_labels(faces: IntArray) -> IntArray:
    """(F,) component of every face, faces being joined over shared edges."""
    edges = np.sort(_edges(faces), axis=1)
    owner = np.repeat(np.arange(len(faces)), 3)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    edges, owner = edges[order], owner[order]
    same = (edges[1:] == edges[:-1]).all(axis=1)
    n = len(faces)
    pairs = coo_matrix((np.ones(same.sum()), (owner[:-1][same], owner[1:][same])), shape=(n, n))
    return np.asarray(connected_components(pairs, directed=False)[1], dtype=np.int64)


def _closed(faces: IntArray) -> bool:
    edges = _edges(faces)
    key = edges[:, 0] * (edges.max() + 1) + edges[:, 1]
    reverse = edges[:, 1] * (edges.max() + 1) + edges[:, 0]
    key = np.sort(key)
    return bool((key[1:] != key[:-1]).all()) and np.array_equal(key, np.sort(reverse))
