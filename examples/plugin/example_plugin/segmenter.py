"""A segmenter that takes every connected surface of the mesh for one primitive."""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from mam_pipeline.backends import Availability
from mam_pipeline.types import Mesh, Primitives


class ConnectedSegmenter:
    """Faces that share a corner belong together; right where each part is a body of its own."""

    @classmethod
    def available(cls) -> Availability:
        """It needs nothing; a model would say here what is missing and how to get it."""
        return Availability(True, version="0.1.0", licence="Apache-2.0")

    def segment(self, mesh: Mesh, seed: int = 0) -> Primitives:
        """Label every face; the same mesh always gives the same labels."""
        # corners at the same place are one corner, also where the file repeats them
        places = np.round(mesh.vertices / (1e-6 * mesh.diagonal)).astype(np.int64)
        _, corner = np.unique(places, axis=0, return_inverse=True)
        faces = corner.reshape(-1)[mesh.faces]
        rows, columns = faces[:, [0, 1]].reshape(-1), faces[:, [1, 2]].reshape(-1)
        size = int(faces.max()) + 1
        joined = coo_array((np.ones(len(rows)), (rows, columns)), shape=(size, size))
        _, group = connected_components(joined, directed=False)
        _, labels = np.unique(group[faces[:, 0]], return_inverse=True)
        return Primitives(labels.astype(np.int64), method="connected")
