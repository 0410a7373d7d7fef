"""The embedded segmenter: a mesh's faces cut into primitives by geometry alone (paper 3.2)."""

from __future__ import annotations

import numpy as np

from mam_pipeline.backends import Availability
from mam_pipeline.errors import InputError
from mam_pipeline.segment.components import absorb_specks, components, spread
from mam_pipeline.segment.frame import dominant_frame
from mam_pipeline.segment.topology import topology
from mam_pipeline.types import FloatArray, IntArray, Mesh, Primitives


class GeometricSegmenter:
    """Primitives from connectivity (authored meshes) and from creases (fused ones).

    Deterministic; the partition does not depend on scale, rotation or the order of faces.
    """

    @classmethod
    def available(cls) -> Availability:
        """It needs nothing, so it can always run."""
        return Availability(True, "embedded", version="1", licence="Apache-2.0")

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
        label = absorb_specks(topo, components(topo, frame))
        return Primitives(by_area(spread(topo, label), topo.areas), method="geometric")


def by_area(label: IntArray, areas: FloatArray) -> IntArray:
    """Number the labels 0, 1, ... from the largest surface to the smallest."""
    dense = np.unique(label, return_inverse=True)[1]
    rank = np.argsort(np.argsort(-np.bincount(dense, weights=areas), kind="stable"))
    return rank[dense].astype(np.int64)
