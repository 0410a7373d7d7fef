"""The fused style: one watertight outer surface whose faces keep their true links."""

from __future__ import annotations

import numpy as np

from mam_pipeline.geometry.fuse import fuse_mesh, nearest_faces
from mam_pipeline.types import IntArray, Mesh
from mam_pipeline.world.style import Style


def fused_static(mesh: Mesh, labels: IntArray, style: Style, seed: int) -> tuple[Mesh, IntArray]:
    """Fuse a mesh (asset frame) as the style says; labels (F,) come from the nearest true face."""
    fused = fuse_mesh(mesh, style.fuse_resolution, style.fuse_noise, seed)
    return fused, np.asarray(labels)[nearest_faces(mesh, fused)]
