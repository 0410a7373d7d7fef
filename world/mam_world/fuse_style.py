"""The fused style: one watertight outer surface whose faces keep their true links."""

from __future__ import annotations

import numpy as np

from mam_pipeline.geometry.fuse import fuse_mesh, nearest_faces
from mam_pipeline.types import IntArray, Mesh
from mam_world.style import Style

FEWEST, MOST = 20_000, 200_000  # faces, as scans and image-to-3D generators have them
PROBE = 40  # cells of a first, cheap try that tells about how many faces there will be
AIMS = (26_000, 150_000)  # where a count outside the bounds is sent


def fused_static(mesh: Mesh, labels: IntArray, style: Style, seed: int) -> tuple[Mesh, IntArray]:
    """Fuse a mesh (asset frame) as the style says; labels (F,) come from the nearest true face.

    The style's resolution gives way where it would leave the bounds of the face count, which
    grows with its square.
    """
    size = style.fuse_resolution
    expected = len(fuse_mesh(mesh, PROBE).faces) * (size / PROBE) ** 2
    # fine grids find openings that the probe has sealed: only a clear excess counts
    size = _resized(size, int(expected), MOST * 1.5)
    fused = fuse_mesh(mesh, size, style.fuse_noise, seed)
    for _ in range(3):
        better = _resized(size, len(fused.faces), MOST)
        if better == size:
            break
        size = better
        fused = fuse_mesh(mesh, size, style.fuse_noise, seed)
    return fused, np.asarray(labels)[nearest_faces(mesh, fused)]


def _resized(size: int, faces: int, most: float) -> int:
    """The resolution that brings a face count back between the bounds."""
    if faces < FEWEST:
        return int(np.ceil(size * (AIMS[0] / max(faces, 1)) ** 0.5))
    if faces > most:
        return int(size * (AIMS[1] / faces) ** 0.5)
    return size
