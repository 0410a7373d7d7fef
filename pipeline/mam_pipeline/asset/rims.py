"""Rims: the closed lines along which parts were cut out of one skin."""

from __future__ import annotations

import numpy as np

from mam_pipeline.geometry.surface import weld
from mam_pipeline.types import Articulation, FloatArray, IntArray

_GAP = 0.1  # of a line's length: ends closer than this are taken for joined


def cut_rims(articulation: Articulation) -> list[tuple[int, FloatArray]]:
    """(child link, (n, 3) closed rim) of every cut between a link and what it does not carry."""
    mesh = articulation.mesh
    vertices, faces, index = weld(mesh.vertices[mesh.faces], 1e-6 * mesh.diagonal)
    owner = np.repeat(articulation.face_link[index], 3)
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges, key = np.unique(edges, axis=0, return_inverse=True)
    touches = np.zeros((len(edges), len(articulation.links)), dtype=bool)
    touches[key.reshape(-1), owner] = True
    out: list[tuple[int, FloatArray]] = []
    for joint in articulation.joints:
        # beside its neighbour a door's rim is the neighbour's too
        rest = np.setdiff1d(np.arange(len(articulation.links)), articulation.carried_links(joint))
        shared = touches[:, joint.child] & touches[:, rest].any(axis=1)
        out += [(joint.child, vertices[r]) for r in _rings(edges[shared], vertices)]
    return out


def length(rim: FloatArray) -> float:
    """Length of a closed line (n, 3)."""
    return float(np.linalg.norm(np.roll(rim, -1, axis=0) - rim, axis=1).sum())


def _rings(edges: IntArray, vertices: FloatArray) -> list[IntArray]:
    """Closed lines made of undirected edges (n, 2).

    A single bad face of a generated mesh leaves a gap in the line; one that is short against the
    line is closed.
    """
    beside: dict[int, set[int]] = {}
    for a, b in edges.tolist():
        beside.setdefault(a, set()).add(b)
        beside.setdefault(b, set()).add(a)
    rings = []
    while beside:
        # from a loose end if there is one
        at = min(beside, key=lambda v: (len(beside[v]) != 1, v))
        line = [at]
        while at in beside:
            step = min(beside[at])
            for a, b in ((at, step), (step, at)):
                beside[a].discard(b)
                if not beside[a]:
                    del beside[a]
            line.append(at := step)
        if line[0] == line[-1]:
            line.pop()
        ring = np.array(line, dtype=np.int64)
        gap = float(np.linalg.norm(vertices[ring[-1]] - vertices[ring[0]]))
        if len(ring) >= 3 and gap < _GAP * length(vertices[ring]):
            rings.append(ring)
    return rings
