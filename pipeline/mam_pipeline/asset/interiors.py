"""What a fused surface cannot show: the holes left where its parts were cut apart."""

from __future__ import annotations

import numpy as np

from mam_pipeline.types import Articulation, IntArray


def cut_edges(articulation: Articulation) -> IntArray:
    """(n, 2) vertex pairs of edges shared by faces of different links: where a mesh was cut."""
    mesh = articulation.mesh
    labels = articulation.face_link
    edges = np.sort(mesh.faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    owner = np.repeat(labels, 3)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    edges, owner = edges[order], owner[order]
    same = (edges[1:] == edges[:-1]).all(axis=1) & (owner[1:] != owner[:-1])
    return edges[1:][same]


def add_interiors(articulation: Articulation) -> tuple[Articulation, list[str]]:
    """Return the articulation and notes on what was added; nothing where nothing was cut."""
    cut = cut_edges(articulation)
    if not len(cut):
        return articulation, []
    return articulation, [f"parts were cut from one surface along {len(cut)} edges; holes are open"]
