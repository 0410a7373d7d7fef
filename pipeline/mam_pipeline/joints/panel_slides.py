"""What lies in the plane of a panel of a fused mesh, where a slide along that plane would take it.

The pieces of a fused surface are open sheets: a pane and the pane beside it lie in one plane, and
sliding the one over the other crosses no face. But between the two faces of a panel there is
material, and where its middle would come to lie in the material of something else, it cannot go.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.geometry.boxes import minimal_box
from mam_pipeline.geometry.raycast import RayScene
from mam_pipeline.geometry.sampling import sample_surface
from mam_pipeline.types import FloatArray, IntArray, Mesh


@dataclass(frozen=True)
class PanelThresholds:
    """When a part is a panel whose slide would take it into material beside it.

    Attributes:
        samples: points on the panel.
        flat: share of a panel's width that it is thick, at most.
        facing: cosine between a face of the panel and its thin direction.
        two_faces: share of a panel's surface that has its other face behind it.
        along: cosine between a slide and the length or the width of the panel.
        blocked: share of the panel that meets something else on its way.
    """

    samples: int = 800
    flat: float = 0.3
    facing: float = 0.9
    two_faces: float = 0.75
    along: float = 0.9
    blocked: float = 0.3


PANEL = PanelThresholds()
WAY = np.linspace(0.08, 0.5, 6)  # of the panel's extent along the slide


def slides_into_material(
    mesh: Mesh, part: IntArray, axes: FloatArray, seed: int = 0
) -> NDArray[np.bool_]:
    """(D,) which slides along unit directions (D, 3) are blocked both ways in the panel's plane.

    None is, where the part is no panel.

    Args:
        mesh: one closed surface. part: (n,) its faces that move.
    """
    out = np.zeros(len(axes), dtype=bool)
    sample = sample_surface(mesh.vertices, mesh.faces[part], PANEL.samples, seed)
    if not len(sample.points):  # a part without surface
        return out
    box = minimal_box(sample.points)
    order = np.argsort(-box.half)
    if box.half[order[2]] > PANEL.flat * box.half[order[1]]:
        return out
    scene = RayScene(mesh.vertices, mesh.faces)
    facing = np.abs(sample.normals @ box.axes[order[2]]) > PANEL.facing
    points, inward = sample.points[facing], -sample.normals[facing]
    depth = scene.first_hits(points + 1e-4 * mesh.diagonal * inward, inward).t
    both = depth < 2.0 * PANEL.flat * box.half[order[1]]
    if both.sum() < PANEL.two_faces * len(sample.points):
        return out
    middle = points[both] + 0.5 * depth[both, None] * inward[both]
    middle = middle[scene.encloses(middle)]
    if not len(middle):
        return out
    for k in order[:2]:
        met = [
            _met(scene, part, middle, sign * 2.0 * box.half[k] * box.axes[k]) for sign in (1, -1)
        ]
        out |= (np.abs(axes @ box.axes[k]) > PANEL.along) & (min(met) > PANEL.blocked)
    return out


def _met(scene: RayScene, part: IntArray, middle: FloatArray, way: FloatArray) -> float:
    """Share of the points that lie in the material of something else somewhere on the way."""
    there = (middle[None] + WAY[:, None, None] * way).reshape(-1, 3)
    other = scene.encloses(there) & ~np.isin(scene.closest(there).faces, part)
    return float(other.reshape(len(WAY), -1).any(axis=0).mean())
