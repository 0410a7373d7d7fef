"""Mass and inertia of links from their geometry and a material prior.

A closed piece is solid where it is thin (boards, bars) and a shell where it is thick (housings);
an open piece is a shell. Densities are handbook values for the usual material of each kind.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mam_pipeline.geometry.boxes import minimal_box
from mam_pipeline.geometry.surface import Component, link_components, triangle_areas
from mam_pipeline.types import Articulation, FloatArray, Inertial


@dataclass(frozen=True)
class MaterialPrior:
    """What a part is made of when nobody says: `density` kg/m3, wall of a shell in metres."""

    name: str
    density: float
    wall: float
    source: str


_WOOD = MaterialPrior("MDF board", 720.0, 0.016, "MDF, 680 to 760 kg/m3 (EN 622-5 datasheets)")
_STEEL = MaterialPrior("steel sheet", 7850.0, 0.0008, "mild steel (EN 1993-1-1: 7850 kg/m3)")
_PLASTIC = MaterialPrior("ABS", 1050.0, 0.0025, "ABS, 1040 to 1070 kg/m3 (datasheets)")
_METAL = MaterialPrior("zinc casting", 6600.0, 0.002, "zinc alloy ZA-3 (ASTM B86: 6600 kg/m3)")

KIND_MATERIALS: dict[str, MaterialPrior] = {
    **dict.fromkeys(("handle", "knob", "faucet", "tap", "valve", "latch"), _METAL),
    **dict.fromkeys(("wheel", "button", "key", "switch", "lever", "dial", "cap"), _PLASTIC),
    **dict.fromkeys(("screen", "blade", "pedal", "trigger", "hatch", "flap"), _PLASTIC),
    **dict.fromkeys(("oven_door", "fridge_door", "drum", "pot"), _STEEL),
}
MIN_MASS = 0.005
SOLID_UP_TO = 0.045
"""Closed pieces whose mean thickness (2 V / A) is at most this many metres are solid."""


def link_inertials(articulation: Articulation) -> list[Inertial]:
    """Mass properties of every link; always positive definite and physically possible."""
    return [_link_inertial(articulation, i) for i in range(len(articulation.links))]


def _link_inertial(articulation: Articulation, index: int) -> Inertial:
    link = articulation.links[index]
    prior = KIND_MATERIALS.get(link.kind.lower(), _WOOD)
    mass = 0.0
    first: FloatArray = np.zeros(3)
    second: FloatArray = np.zeros((3, 3))
    for component in link_components(articulation, index):
        m, s, c = _component_moments(component, prior)
        mass, first, second = mass + m, first + s, second + c
    if mass <= 0.0:
        joint = articulation.joint_of(index)
        at = np.zeros(3) if joint is None else joint.origin
        return Inertial(MIN_MASS, at, np.eye(3) * MIN_MASS * 1e-4, prior.name, prior.source)
    center = first / mass
    covariance = second / mass - np.outer(center, center)
    # no body is thinner than a millimetre: keeps a flat sheet's tensor strictly possible
    covariance = covariance + np.eye(3) * 1e-3**2
    mass = max(mass, MIN_MASS)
    inertia = mass * (np.trace(covariance) * np.eye(3) - covariance)
    return Inertial(mass, center, (inertia + inertia.T) / 2, prior.name, prior.source)


def _component_moments(
    component: Component, prior: MaterialPrior
) -> tuple[float, FloatArray, FloatArray]:
    """Mass, first moment (3,) and second moment (3, 3) of one piece about the asset origin."""
    triangles = component.triangles
    area = float(triangle_areas(triangles).sum())
    if component.closed:
        volume, first, second = _solid_moments(triangles)
        thickness = 2.0 * volume / max(area, 1e-12)
        if volume > 0.0 and thickness <= SOLID_UP_TO:
            return prior.density * volume, prior.density * first, prior.density * second
    area, first, second = _shell_moments(triangles)
    wall = prior.wall
    if len(component.faces) > 2:
        # both faces of a board that was cut open are there: its wall is half its thickness
        thin = 2.0 * float(minimal_box(component.vertices, 12).half.min())
        if thin > 1e-4:
            wall = min(wall, max(thin / 2.0, 1e-4))
    scale = prior.density * wall
    return scale * area, scale * first, scale * second


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


def _shell_moments(triangles: FloatArray) -> tuple[float, FloatArray, FloatArray]:
    """Area and moments of a surface (exact for flat triangles)."""
    areas = triangle_areas(triangles)
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
