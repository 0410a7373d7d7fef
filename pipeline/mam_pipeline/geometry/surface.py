"""Surfaces of single links: welded components, closedness, hulls; shared by collision and mass."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import open3d as o3d
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, QhullError

from mam_pipeline.geometry.rows import row_keys
from mam_pipeline.types import Articulation, FloatArray, IntArray

Triangles = tuple[FloatArray, IntArray]
"""(V, 3) vertices in metres and (F, 3) faces."""


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
    corners = articulation.mesh.faces[faces]
    return components(link_triangles(articulation, link), faces, tolerance, corners)


def components(
    triangles: FloatArray, source: IntArray, tolerance: float, corners: IntArray | None = None
) -> list[Component]:
    """Split triangles (F, 3, 3) into connected pieces.

    Corners nearer than about `tolerance` are one vertex; degenerate faces go; of faces with the
    same corners (double-sided soups) one stays. Faces are joined over shared edges, not over
    single vertices; where more than two faces meet in an edge (boards that touch), those go
    together that share the source's vertices.

    Args:
        triangles: corner positions. source: (F,) index of each face for `Component.source`.
        tolerance: metres. corners: (F, 3) vertex indices of the source, if known.
    """
    vertices, faces, index = weld(triangles, tolerance)
    kept = np.asarray(source)[index]
    if not len(faces):
        return []
    labels = edge_labels(faces, None if corners is None else corners[index])
    out = []
    for label in range(labels.max() + 1):
        mine = faces[labels == label]
        used, local = np.unique(mine, return_inverse=True)
        local = local.reshape(-1, 3)
        out.append(Component(vertices[used], local, kept[labels == label], _closed(local)))
    areas = [float(triangle_areas(c.triangles).sum()) for c in out]
    return [out[i] for i in np.argsort(areas, kind="stable")[::-1]]


def concatenate(parts: Sequence[Triangles]) -> Triangles:
    """Join surfaces; no vertex is shared between them."""
    offsets = np.cumsum([0] + [len(v) for v, _ in parts[:-1]])
    faces = np.concatenate([f + o for (_, f), o in zip(parts, offsets)])
    return np.concatenate([v for v, _ in parts]), faces


def weld(triangles: FloatArray, tolerance: float) -> tuple[FloatArray, IntArray, IntArray]:
    """Indexed surface of triangles (n, 3, 3): corners nearer than about `tolerance` are one vertex.

    Returns:
        (V, 3) vertices, (F, 3) faces without degenerate and repeated ones (of a double-sided
        soup's two faces one stays), and the (F,) index of each among the triangles.
    """
    if not len(triangles):
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64), np.zeros(0, np.int64)
    keys = np.round(triangles.reshape(-1, 3) / max(tolerance, 1e-12)).astype(np.int64)
    _, first, inverse = np.unique(row_keys(keys), return_index=True, return_inverse=True)
    vertices = triangles.reshape(-1, 3)[first]
    faces = inverse.reshape(-1, 3)
    proper = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2])
    index = np.flatnonzero(proper & (faces[:, 2] != faces[:, 0]))
    _, once = np.unique(row_keys(np.sort(faces[index], axis=1)), return_index=True)
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


def edge_labels(faces: IntArray, corners: IntArray | None) -> IntArray:
    """(F,) component of every face; see `components` for the rule.

    Args:
        faces: (F, 3) of a welded surface. corners: (F, 3) vertex indices of the source, if known.
    """
    edges = np.sort(_edges(faces), axis=1)
    owner = np.repeat(np.arange(len(faces)), 3)
    _, edge, count = np.unique(row_keys(edges), return_inverse=True, return_counts=True)
    edge = edge.reshape(-1)
    key: IntArray = np.asarray(edge, dtype=np.int64)
    if corners is not None:
        own = np.sort(_edges(corners), axis=1)
        _, twin, twins = np.unique(row_keys(own), return_inverse=True, return_counts=True)
        twin = twin.reshape(-1)
        # crowded edges whose faces have partners by index are joined by index
        partnered = np.zeros(len(count), dtype=bool)
        crowded = count[edge] > 2
        partnered[edge[crowded & (twins[twin] == 2)]] = True
        key = np.asarray(np.where(partnered[edge], len(count) + twin, edge), dtype=np.int64)
    order = np.argsort(key, kind="stable")
    owner = owner[order]
    same = np.diff(key[order]) == 0
    n = len(faces)
    pairs = coo_matrix((np.ones(same.sum()), (owner[:-1][same], owner[1:][same])), shape=(n, n))
    return np.asarray(connected_components(pairs, directed=False)[1], dtype=np.int64)


def _closed(faces: IntArray) -> bool:
    edges = _edges(faces)
    key = edges[:, 0] * (edges.max() + 1) + edges[:, 1]
    reverse = edges[:, 1] * (edges.max() + 1) + edges[:, 0]
    key = np.sort(key)
    return bool((key[1:] != key[:-1]).all()) and np.array_equal(key, np.sort(reverse))


def _tensor(array: NDArray[Any]) -> Any:
    return o3d.core.Tensor(array)  # type: ignore[call-overload]


class Solid:
    """Tells points inside matter: inside any closed component, however components overlap."""

    _RAYS = np.array([[1.0, 0.013, 0.007], [0.011, 1.0, 0.017], [0.005, 0.019, 1.0]])

    def __init__(self, parts: Sequence[Component]) -> None:
        """Build from components; open ones are taken together, as boards may close a box."""
        self.empty = not parts
        if self.empty:
            return
        points = np.concatenate([p.vertices for p in parts])
        offsets = np.cumsum([0] + [len(p.vertices) for p in parts[:-1]])
        faces = np.concatenate([p.faces + o for p, o in zip(parts, offsets)])
        ids = [i + 1 if p.closed else 0 for i, p in enumerate(parts)]
        self._group = np.repeat(ids, [len(p.faces) for p in parts])
        self._count = len(parts) + 1
        self._middle = points.mean(axis=0)
        self._unit = max(float(np.ptp(points, axis=0).max()), 1e-12)
        self._scene = o3d.t.geometry.RaycastingScene(nthreads=1)
        scaled = ((points - self._middle) / self._unit).astype(np.float32)
        self._scene.add_triangles(_tensor(scaled), _tensor(faces.astype(np.uint32)))

    def contains(self, points: FloatArray) -> NDArray[np.bool_]:
        """(n,) whether points (n, 3) lie inside: two of three rays leave it an odd time."""
        n = len(points)
        votes = np.zeros(n, dtype=int)
        if self.empty or n == 0:
            return votes > 0
        scaled = (points - self._middle) / self._unit
        for ray in self._RAYS:
            rays = np.concatenate([scaled, np.broadcast_to(ray, (n, 3))], axis=1)
            hits = self._scene.list_intersections(_tensor(rays.astype(np.float32)))
            which = hits["ray_ids"].numpy().astype(np.int64)
            group = self._group[hits["primitive_ids"].numpy().astype(np.int64)]
            key, crossings = np.unique(which * self._count + group, return_counts=True)
            odd = np.unique(key[crossings % 2 == 1] // self._count)
            votes[odd] += 1
        return votes >= 2
