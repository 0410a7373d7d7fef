"""Convex collision pieces of links: boxes where a piece is one, hulls where it is nearly convex."""

from __future__ import annotations

import numpy as np

from mam_pipeline.asset.surface import Component, hull_of, link_components
from mam_pipeline.geometry.boxes import aligned_box, minimal_box
from mam_pipeline.types import Articulation, CollisionShape, FloatArray

MAX_PIECES = 32
MIN_THICKNESS = 0.001


def collision_shapes(
    articulation: Articulation,
    max_pieces: int = MAX_PIECES,
    skip: frozenset[str] = frozenset(),
) -> dict[str, list[CollisionShape]]:
    """Collision pieces of every link, by link name, asset frame at rest."""
    out = {}
    for i, link in enumerate(articulation.links):
        if link.name in skip:
            continue
        parts = link_components(articulation, i)
        out[link.name] = [convex_shape(p) for p in parts[:max_pieces]]
    return out


def convex_shape(component: Component) -> CollisionShape:
    """One convex piece around a component; sheets get a millimetre of thickness."""
    hull = hull_of(component.vertices)
    thin = component.extent.min() < MIN_THICKNESS or hull is None
    if thin:
        box = aligned_box(component.vertices, np.eye(3))
        if hull is None:
            box = minimal_box(component.vertices)
        pose = np.eye(4)
        pose[:3, :3] = box.axes.T
        pose[:3, 3] = box.center
        return box_shape(pose, 2 * np.maximum(box.half, MIN_THICKNESS / 2))
    assert hull is not None
    return CollisionShape("convex", vertices=hull[0], faces=hull[1])


def box_shape(pose: FloatArray, size: FloatArray) -> CollisionShape:
    """A box piece; `pose` (4, 4) asset_T_shape, right-handed; `size` (3,) full extents."""
    if np.linalg.det(pose[:3, :3]) < 0:
        pose = pose.copy()
        pose[:3, 2] *= -1.0
    return CollisionShape("box", pose=pose, size=size)
