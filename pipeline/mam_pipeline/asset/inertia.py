"""Mass and inertia of links from their geometry and a material prior.

Furniture is made of boards and housings of sheet, not of solids. A face whose other side is near
is one side of a board and carries half of its thickness; a face without one is a sheet or a thick
body's wall, of the usual thickness for the material. Densities are handbook values.
"""

from __future__ import annotations

import numpy as np

from mam_pipeline.asset.matter import Material, material_of, weighted
from mam_pipeline.geometry.raycast import RayScene
from mam_pipeline.geometry.surface import (
    Component,
    concatenate,
    link_components,
    triangle_areas,
)
from mam_pipeline.types import Articulation, FloatArray, Inertial

MIN_MASS = 0.005
TOUCHING = 1e-4
"""Metres: a surface this near behind a face is the same sheet drawn twice, not a board."""


def link_inertials(articulation: Articulation, thing: str = "") -> list[Inertial]:
    """Mass properties of every link; always positive definite and physically possible.

    Args:
        thing: the kind of object, by the table of kinds; "" where nobody says.
    """
    bodies = [_link_inertial(articulation, i, thing) for i in range(len(articulation.links))]
    low, high = articulation.mesh.bounds
    return weighted(bodies, thing, float((high - low).max()))


def _link_inertial(articulation: Articulation, index: int, thing: str) -> Inertial:
    prior = material_of(articulation.links[index].kind, thing)
    mass = 0.0
    first: FloatArray = np.zeros(3)
    second: FloatArray = np.zeros((3, 3))
    parts = link_components(articulation, index)
    scene = None
    if parts:
        scene = RayScene(*concatenate([(c.vertices, c.faces) for c in parts]))
    for component in parts:
        assert scene is not None
        m, s, c = _component_moments(component, prior, scene)
        mass, first, second = mass + m, first + s, second + c
    if mass <= 0.0:
        joint = articulation.joint_of(index)
        at = np.zeros(3) if joint is None else joint.origin
        return _of(prior, MIN_MASS, at, np.eye(3) * MIN_MASS * 1e-4)
    center = first / mass
    covariance = second / mass - np.outer(center, center)
    # no body is thinner than a millimetre: keeps a flat sheet's tensor strictly possible
    covariance = covariance + np.eye(3) * 1e-3**2
    mass = max(mass, MIN_MASS)
    inertia = mass * (np.trace(covariance) * np.eye(3) - covariance)
    return _of(prior, mass, center, (inertia + inertia.T) / 2)


def _of(prior: Material, mass: float, center: FloatArray, inertia: FloatArray) -> Inertial:
    spread = (mass / prior.spread, mass * prior.spread)
    return Inertial(
        mass, center, inertia, prior.words, prior.source, spread, prior.friction, prior.restitution
    )


def _component_moments(
    component: Component, prior: Material, scene: RayScene
) -> tuple[float, FloatArray, FloatArray]:
    """Mass, first moment (3,) and second moment (3, 3) of one piece about the asset origin."""
    triangles = component.triangles
    if component.closed:
        area = float(triangle_areas(triangles).sum())
        volume, first, second = _solid_moments(triangles)
        outward = _signed_volume(triangles) > 0.0
        if outward and 2.0 * volume / max(area, 1e-12) <= prior.solid:
            return prior.density * volume, prior.density * first, prior.density * second
    walls = _walls(component, prior, scene)
    mass, first, second = _shell_moments(triangles, walls)
    return prior.density * mass, prior.density * first, prior.density * second


def _walls(component: Component, prior: Material, scene: RayScene) -> FloatArray:
    """(F,) thickness of the matter that belongs to each face, metres."""
    triangles = component.triangles
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    normals: FloatArray = np.asarray(np.cross(b - a, c - a), dtype=np.float64)
    normals = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    middles: FloatArray = np.asarray(triangles.mean(axis=1), dtype=np.float64)
    through = scene.first_hits(middles - TOUCHING * normals, -normals).t + TOUCHING
    if component.closed and _signed_volume(triangles) < 0.0:
        # the inside of a box, or a board that is inside out: its matter is on either side
        other = scene.first_hits(middles + TOUCHING * normals, normals).t + TOUCHING
        through = np.minimum(through, other)
    # both faces of a board are there, and each has half of it
    board = through <= prior.solid
    return np.where(board, through / 2, np.minimum(prior.wall, through / 2))


def _signed_volume(triangles: FloatArray) -> float:
    p = triangles - triangles.mean(axis=(0, 1))
    return float(np.einsum("ij,ij->i", p[:, 0], np.cross(p[:, 1], p[:, 2])).sum() / 6.0)


def _solid_moments(triangles: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Volume and moments of a closed surface: signed tetrahedra from its middle (exact)."""
    origin = triangles.mean(axis=(0, 1))
    p = triangles - origin
    volumes = np.einsum("ij,ij->i", p[:, 0], np.cross(p[:, 1], p[:, 2])) / 6.0
    volume = float(volumes.sum())
    sign = -1.0 if volume < 0 else 1.0  # inside out
    volumes, volume = volumes * sign, volume * sign
    s = p.sum(axis=1)
    first = (volumes[:, None] * s).sum(axis=0) / 4.0
    outer = np.einsum("fki,fkj->fij", p, p) + np.einsum("fi,fj->fij", s, s)
    second = np.einsum("f,fij->ij", volumes, outer) / 20.0
    return _shift(volume, first, second, origin)


def _shell_moments(
    triangles: FloatArray, walls: FloatArray
) -> tuple[float, FloatArray, FloatArray]:
    """Volume and moments of a surface (exact for flat triangles) of thickness walls (F,)."""
    areas = triangle_areas(triangles) * walls
    s = triangles.sum(axis=1)
    first = (areas[:, None] * s).sum(axis=0) / 3.0
    outer = np.einsum("fki,fkj->fij", triangles, triangles) + np.einsum("fi,fj->fij", s, s)
    return float(areas.sum()), first, np.einsum("f,fij->ij", areas, outer) / 12.0


def _shift(
    amount: float, first: FloatArray, second: FloatArray, origin: FloatArray
) -> tuple[float, FloatArray, FloatArray]:
    """Moments about the frame's origin from moments about `origin`."""
    cross = np.outer(first, origin)
    moved = second + cross + cross.T + amount * np.outer(origin, origin)
    return amount, first + amount * origin, moved
