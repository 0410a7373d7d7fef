"""Handles and knobs on moving parts: small things that stand out on the side that opens."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mam_pipeline.geometry.sampling import face_geometry, sample_surface, unit
from mam_pipeline.geometry.surface import link_components
from mam_pipeline.types import Articulation, FloatArray, IntArray, Joint

_FRONT_SHARE = 0.2
_MAX_SHARE = 0.35
_MIN_PROTRUSION = 0.006


@dataclass(frozen=True)
class Handle:
    """A protruding region of a link.

    Attributes:
        link: index. faces: (n,) indices into the articulation's mesh.
        outward: (3,) unit direction in which it stands out of the part.
        level: height of the part's front along `outward` (dot product), metres.
        points: (m, 3) samples of its surface, asset frame at rest.
    """

    link: int
    faces: IntArray
    outward: FloatArray
    level: float
    points: FloatArray


def opening_direction(articulation: Articulation, joint: Joint) -> FloatArray:
    """(3,) direction in which the part's bulk sets off when its joint opens; zero for pure spins.

    For a hinge this is the mean velocity of the surface, so the outward normal of a door.
    """
    sign = 1.0 if joint.open >= joint.closed else -1.0
    if abs(joint.open - joint.closed) < 1e-9 and np.isfinite([joint.lower, joint.upper]).all():
        sign = 1.0 if joint.upper >= -joint.lower else -1.0
    if joint.type == "prismatic":
        return np.asarray(sign * joint.axis)
    if joint.type not in ("revolute", "continuous"):
        return np.zeros(3)
    mesh = articulation.mesh
    samples = sample_surface(mesh.vertices, mesh.faces[articulation.links[joint.child].faces], 500)
    if not len(samples.points):
        return np.zeros(3)
    arms = samples.points - joint.origin
    mean = np.cross(sign * joint.axis, arms).mean(axis=0)
    reach = float(np.linalg.norm(arms, axis=1).mean())
    return unit(mean) if np.linalg.norm(mean) > 0.2 * reach else np.zeros(3)


def find_handles(articulation: Articulation, joint: Joint) -> list[Handle]:
    """Regions of the joint's child that stand out on its open side, largest first.

    The side that opens is tried first, then the side away from the hinge (lids, flaps).
    """
    opening = opening_direction(articulation, joint)
    if not opening.any():
        return []
    directions = [opening]
    if joint.type == "revolute":
        mesh = articulation.mesh
        faces = mesh.faces[articulation.links[joint.child].faces]
        middle = mesh.vertices[faces.reshape(-1)].mean(axis=0) - joint.origin
        middle = middle - (middle @ joint.axis) * joint.axis
        away = middle - (middle @ opening) * opening
        if np.linalg.norm(away) > 1e-6:
            directions.append(unit(away))
    for direction in directions:
        found = _protruding(articulation, joint.child, direction)
        if found:
            return found
    return []


def handle_faces(articulation: Articulation, link: int) -> IntArray:
    """(n,) faces of a link that belong to its handles; named `handle_*` in the URDF."""
    joint = articulation.joint_of(link)
    found = [] if joint is None else find_handles(articulation, joint)
    if not found:
        return np.zeros(0, dtype=np.int64)
    return np.unique(np.concatenate([h.faces for h in found]))


def _protruding(articulation: Articulation, link: int, outward: FloatArray) -> list[Handle]:
    mesh = articulation.mesh
    faces = articulation.links[link].faces
    if not len(faces):
        return []
    level = _front_level(articulation, link, outward)
    if level is None:
        return []
    diagonal = mesh.diagonal
    least = max(min(_MIN_PROTRUSION, 0.01 * diagonal), 0.002)
    pieces = []
    for component in link_components(articulation, link):
        heights = component.vertices @ outward
        if heights.max() < level + least:
            continue
        own = component.source
        if heights.mean() < level and np.mean(heights > level + 1e-4) < 0.5:
            above = (heights[component.faces] > level + 0.2 * least).all(axis=1)
            own = own[above]
        if len(own):
            pieces.append(own)
    groups = _merge_near(articulation, pieces, 0.01 * diagonal)
    part = mesh.vertices[mesh.faces[faces].reshape(-1)]
    flat = part - np.outer(part @ outward, outward)
    footprint = float(np.linalg.norm(np.ptp(flat, axis=0)))
    out = []
    for group in groups:
        corners = mesh.vertices[mesh.faces[group].reshape(-1)]
        across = corners - np.outer(corners @ outward, outward)
        span = float(np.linalg.norm(np.ptp(across, axis=0)))
        area_share = _box_area(across) / max(_box_area(flat), 1e-12)
        # a bar may be as long as its door, but not as wide
        if (corners @ outward).max() < level + least or area_share > _MAX_SHARE:
            continue
        if span > 1.05 * footprint:
            continue
        samples = sample_surface(mesh.vertices, mesh.faces[group], 400)
        out.append(Handle(link, np.sort(group), outward, level, samples.points))
    return sorted(out, key=lambda h: -float(np.ptp(h.points, axis=0).max()))


def _front_level(articulation: Articulation, link: int, outward: FloatArray) -> float | None:
    """Height along `outward` of the outermost large face of a link, None if it has none."""
    mesh = articulation.mesh
    faces = mesh.faces[articulation.links[link].faces]
    normals, areas = face_geometry(mesh.vertices, faces)
    facing = np.abs(normals @ outward) > 0.9
    if not facing.any():
        return None
    heights = (mesh.vertices[faces] @ outward).mean(axis=1)[facing]
    weights = areas[facing]
    part = mesh.vertices[faces.reshape(-1)]
    flat = part - np.outer(part @ outward, outward)
    order = np.argsort(heights)
    heights, weights = heights[order], weights[order]
    window = max(0.004 * mesh.diagonal, 1e-4)
    total = np.concatenate([[0.0], np.cumsum(weights)])
    below = np.searchsorted(heights, heights - window, side="left")
    in_window = total[np.arange(len(heights)) + 1] - total[below]
    large = np.flatnonzero(in_window > _FRONT_SHARE * _box_area(flat))
    return float(heights[large[-1]]) if len(large) else None


def _box_area(points: FloatArray) -> float:
    """Area of the box around points that lie in a plane: the two largest principal extents."""
    centred = points - points.mean(axis=0)
    _, vectors = np.linalg.eigh(centred.T @ centred)
    extents = np.sort(np.ptp(centred @ vectors, axis=0))
    return float(extents[-1] * extents[-2])


def _merge_near(
    articulation: Articulation, pieces: list[IntArray], distance: float
) -> list[IntArray]:
    """Join face sets whose boxes come within `distance`: a bar and its posts are one handle."""
    mesh = articulation.mesh
    boxes = []
    for piece in pieces:
        corners = mesh.vertices[mesh.faces[piece].reshape(-1)]
        boxes.append((corners.min(axis=0), corners.max(axis=0)))
    owner = list(range(len(pieces)))

    def root(i: int) -> int:
        while owner[i] != i:
            i = owner[i]
        return i

    for i in range(len(pieces)):
        for k in range(i):
            gap = np.maximum(boxes[i][0] - boxes[k][1], boxes[k][0] - boxes[i][1])
            if np.linalg.norm(np.maximum(gap, 0.0)) < distance:
                owner[root(i)] = root(k)
    groups: dict[int, list[IntArray]] = {}
    for i, piece in enumerate(pieces):
        groups.setdefault(root(i), []).append(piece)
    return [np.concatenate(g) for g in groups.values()]
