"""Split the triangles of a mesh along planes without cracks, keeping materials, colours and UVs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.types import FloatArray, IntArray, Mesh

_CLOSE = 1e-6  # of the mesh's extent: a vertex this near to a plane lies on it


def split_mesh(mesh: Mesh, axis: int, at: float, chosen: NDArray[np.bool_]) -> Mesh:
    """Split along the plane where coordinate `axis` equals `at`.

    An edge is split where it crosses the plane and belongs to a chosen face; its other faces are
    split with it, so that no crack opens. Faces keep their order; pieces follow their source.

    Args:
        chosen: (F,) faces to be split where they cross the plane.
    """
    d = mesh.vertices[:, axis] - at
    d = np.where(np.abs(d) < _CLOSE * float(np.ptp(mesh.vertices, axis=0).max()), 0.0, d)
    # corners at one place are one, whatever their texture: edges must agree across seams
    _, same = np.unique(np.round(mesh.vertices, 9), axis=0, return_inverse=True)
    same = same.reshape(-1)
    a, b = mesh.faces, np.roll(mesh.faces, -1, axis=1)
    crosses = d[a] * d[b] < 0
    key = np.sort(np.stack([same[a], same[b]], axis=-1), axis=-1) @ [len(mesh.vertices), 1]
    wanted = np.unique(key[crosses & chosen[:, None]])
    cut = crosses & np.isin(key, wanted)
    if not cut.any():
        return mesh
    points, ends, share = _cut_points(mesh, d, cut)
    number = np.full(mesh.faces.shape, -1)
    number[cut] = len(mesh.vertices) + np.arange(len(points))
    faces, source = _pieces(mesh.faces, number)
    return replace(
        mesh,
        vertices=np.concatenate([mesh.vertices, points]),
        faces=faces,
        face_material=None if mesh.face_material is None else mesh.face_material[source],
        face_group=None if mesh.face_group is None else mesh.face_group[source],
        uv=None if mesh.uv is None else _grown(mesh.uv, ends, share).astype(np.float32),
        colors=None
        if mesh.colors is None
        else np.round(_grown(mesh.colors, ends, share)).astype(np.uint8),
    )


def _cut_points(
    mesh: Mesh, d: FloatArray, cut: NDArray[np.bool_]
) -> tuple[FloatArray, IntArray, FloatArray]:
    """(n, 3) points on cut edges, (n, 2) vertices of the edges and (n,) share towards the second.

    Computed from the lesser end in space, so that both faces of an edge get the same numbers.
    """
    face, corner = np.nonzero(cut)
    ends = np.stack([mesh.faces[face, corner], mesh.faces[face, (corner + 1) % 3]], axis=1)
    below = d[ends[:, 0]] < 0
    ends = np.where(below[:, None], ends, ends[:, ::-1])
    low, high = d[ends[:, 0]], d[ends[:, 1]]
    share = low / (low - high)
    p, q = mesh.vertices[ends[:, 0]], mesh.vertices[ends[:, 1]]
    return p + share[:, None] * (q - p), ends, share


def _grown(values: NDArray[np.generic], ends: IntArray, share: FloatArray) -> FloatArray:
    old = np.asarray(values, dtype=np.float64)
    new = old[ends[:, 0]] + share[:, None] * (old[ends[:, 1]] - old[ends[:, 0]])
    return np.concatenate([old, new])


def _pieces(faces: IntArray, number: IntArray) -> tuple[IntArray, IntArray]:
    """New faces and the source of each, from the vertex `number` on every cut edge (-1: none)."""
    out: list[IntArray] = []
    source: list[IntArray] = []
    count = (number >= 0).sum(axis=1)
    index = np.arange(len(faces))

    def add(which: IntArray, *corners: IntArray) -> None:
        out.append(np.stack(corners, axis=1))
        source.append(which)

    whole = index[count == 0]
    add(whole, *faces[whole].T)
    for k in range(3):  # one cut edge: from corner k to k + 1
        one = index[(count == 1) & (number[:, k] >= 0)]
        a, b, c = faces[one, k], faces[one, (k + 1) % 3], faces[one, (k + 2) % 3]
        m = number[one, k]
        add(one, a, m, c)
        add(one, m, b, c)
        # two cut edges that meet at corner k + 1: a tip and a quadrilateral
        two = index[(count == 2) & (number[:, (k + 2) % 3] < 0)]
        a, b, c = faces[two, k], faces[two, (k + 1) % 3], faces[two, (k + 2) % 3]
        m, n = number[two, k], number[two, (k + 1) % 3]
        add(two, m, b, n)
        add(two, a, m, n)
        add(two, a, n, c)
    order = np.argsort(np.concatenate(source), kind="stable")
    return np.concatenate(out)[order], np.concatenate(source)[order]
