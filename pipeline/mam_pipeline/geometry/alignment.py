"""Whether a joint's axis runs along what is straight or flat in the bodies that it joins.

Whoever builds a door, a drawer or a knob gives it edges along its axis, or faces across it. An axis
that lies a few degrees beside such edges and faces, and along none, is askew.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mam_pipeline.geometry.surface import triangle_areas, weld
from mam_pipeline.types import FloatArray, IntArray, Mesh


@dataclass(frozen=True)
class AlignmentSettings:
    """When directions count as one, and as evidence.

    Attributes:
        along: radians: within this an axis runs along an edge or a normal.
        beside: radians: within this, edges and normals tell where the axis should be.
        same: radians: edges and normals closer than this are parallel by intention.
        crease: radians: faces that meet at less than this are one surface.
        share: of all edge length or area that must be parallel to be evidence.
        part: of the strongest evidence beside the axis that clears an axis along which it runs.
        members: edges or faces that must be parallel; one stray face of a scan says nothing.
    """

    along: float = float(np.radians(1.0))
    beside: float = float(np.radians(8.0))
    same: float = float(np.radians(0.25))
    crease: float = float(np.radians(2.0))
    share: float = 0.02
    part: float = 1 / 3
    members: int = 4


ALIGNMENT = AlignmentSettings()


def askew(mesh: Mesh, bodies: list[IntArray], axis: FloatArray) -> float:
    """Angle from an axis to the direction along which the bodies are built.

    Args:
        mesh: the object. bodies: face indices of the part and of what it hangs on.
        axis: (3,) unit vector.

    Returns:
        Radians; 0 where the axis runs along edges or normals of either body, and where none of
        them has any near it: a ball tells nothing.
    """
    angles = []
    for faces in bodies:
        for directions, weights in _evidence(mesh, faces):
            found = _angle(directions, weights, axis)
            if found == 0.0:
                return 0.0
            if found is not None:
                angles.append(found)
    return min(angles, default=0.0)


def _angle(directions: FloatArray, weights: FloatArray, axis: FloatArray) -> float | None:
    """Radians to the strongest parallel set beside an axis, 0 if the axis is along one."""
    total, settings = float(weights.sum()), ALIGNMENT
    cosine = directions @ axis
    near = np.abs(cosine) > np.cos(settings.beside)
    if total <= 0.0 or not near.any():
        return None
    along = float(weights[np.abs(cosine) > np.cos(settings.along)].sum()) / total
    own = directions[near] * np.sign(cosine[near])[:, None]
    mass = weights[near]
    seeds = np.argsort(-mass)[:400]
    same = own[seeds] @ own.T > np.cos(settings.same)
    best = int((same @ mass).argmax())
    strength = float(mass[same[best]].sum()) / total
    if along >= settings.share and along >= settings.part * strength:
        return 0.0
    if strength < settings.share or same[best].sum() < settings.members:
        return None
    middle = mass[same[best]] @ own[same[best]]
    return float(np.arccos(np.clip(middle @ axis / np.linalg.norm(middle), -1.0, 1.0)))


def _evidence(mesh: Mesh, faces: IntArray) -> list[tuple[FloatArray, FloatArray]]:
    """Unit vectors (n, 3) and weights (n,): creases by length, then normals by area."""
    vertices, faces, _ = weld(mesh.vertices[mesh.faces[faces]], 1e-5 * mesh.diagonal)
    if not len(faces):  # a link without a shape, or of specks alone
        return []
    corners = vertices[faces]
    area = triangle_areas(corners)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.maximum(2.0 * area, 1e-300)[:, None]
    edges = np.sort(faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(faces)), 3)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    edges, owner = edges[order], owner[order]
    first = np.flatnonzero(np.r_[True, (np.diff(edges, axis=0) != 0).any(axis=1)])
    count = np.diff(np.r_[first, len(edges)])
    crease = np.ones(len(first), dtype=bool)  # a border is one, and where three boards meet
    two = first[count == 2]
    cosine = np.abs(np.einsum("ij,ij->i", normals[owner[two]], normals[owner[two + 1]]))
    crease[count == 2] = cosine < np.cos(ALIGNMENT.crease)
    edges = edges[first[crease]]
    way = vertices[edges[:, 1]] - vertices[edges[:, 0]]
    length = np.linalg.norm(way, axis=1)
    return [(way / np.maximum(length, 1e-300)[:, None], length), (normals, area)]
