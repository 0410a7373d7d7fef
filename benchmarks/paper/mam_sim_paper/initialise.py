"""The paper's type-aware kinematic initialisation, as written (section 3.3, equations 2 to 8).

Thresholds are the paper's metres on an object scaled to a bounding-box diagonal of one metre: they
mean something only after a scale is settled, and a file's own unit says nothing. Contact sets use
evenly resampled surface points in place of mesh vertices, of which a CAD box has only eight.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from mam_pipeline.geometry.boxes import principal_axes
from mam_pipeline.geometry.raycast import RayScene
from mam_pipeline.geometry.sampling import sample_surface, thin_out, unit
from mam_pipeline.types import FloatArray, IntArray, JointSubtype, Mesh


@dataclass(frozen=True)
class PaperConstants:
    """The paper's constants, lengths in metres.

    Attributes:
        tau: contact threshold, eq. 2.
        delta: RANSAC inlier threshold, eq. 4.
        epsilon: penetration threshold, eq. 7.
        omega: weight of derailment against collision, eq. 6.
        steps: trial slides, half of them forward, half backward.
        reach: largest trial slide; the same steps for every candidate.
    """

    tau: float = 0.01
    delta: float = 0.005
    epsilon: float = 0.005
    omega: float = 20.0
    steps: int = 10
    reach: float = 0.15


PAPER = PaperConstants()


@dataclass(frozen=True)
class PaperPart:
    """A part and its parent in normalised coordinates: (x - center) / unit, diagonal 1.

    Attributes:
        points: (n, 3) samples of the part K_i. contact: (m, 3) S_contact (eq. 2).
        parent: distance queries against K_P(i). part: distance queries against K_i.
        adaptive: tau had to grow to the rest gap + 0.003, because nothing was within the paper's.
    """

    points: FloatArray
    contact: FloatArray
    parent: RayScene
    part: RayScene
    center: FloatArray
    unit: float
    adaptive: bool


@dataclass(frozen=True)
class InitialJoint:
    """Axis (3,) unit, pivot (3,), asset frame, and what the initialisation measured."""

    axis: FloatArray
    origin: FloatArray
    evidence: Mapping[str, float] = field(default_factory=dict)


def paper_part(
    mesh: Mesh, part_faces: IntArray, parent_faces: IntArray, *, samples: int = 3000,
    contact_limit: int = 400, seed: int = 0,
) -> PaperPart:  # fmt: skip
    """Normalise, sample and extract the contact interface (eq. 2)."""
    low, high = mesh.bounds
    center, scale = 0.5 * (low + high), max(mesh.diagonal, 1e-12)
    v = (mesh.vertices - center) / scale
    part, parent = mesh.faces[part_faces], mesh.faces[parent_faces]
    points = sample_surface(v, part, samples, seed).points
    scene = RayScene(v, parent)
    distance = scene.distance(points)
    mask = distance < PAPER.tau
    adaptive = int(mask.sum()) < 8
    if adaptive:
        mask = distance < distance.min() + 0.003
    index = np.flatnonzero(mask)[thin_out(int(mask.sum()), contact_limit, seed)]
    return PaperPart(points, points[index], scene, RayScene(v, part), center, scale, adaptive)


def initialise(part: PaperPart, subtype: JointSubtype, seed: int = 0) -> InitialJoint:
    """Initial joint of the given subtype, asset frame."""
    if subtype == "slide":
        axis, evidence = slide_axis(part)
        pivot = part.contact.mean(axis=0)
    elif subtype == "spin":
        axis, pivot, evidence = spin_line(part.contact, seed)
        # A nearly straight patch throws the circle's centre far away: keep it in the part's box.
        pivot = np.clip(pivot, part.points.min(axis=0), part.points.max(axis=0))
    else:
        axis, pivot, evidence = hinge_line(part.contact)
    evidence = {**evidence, "contact_points": float(len(part.contact)),
                "tau_grown": float(part.adaptive)}  # fmt: skip
    return InitialJoint(axis, pivot * part.unit + part.center, evidence)


def hinge_line(contact: FloatArray) -> tuple[FloatArray, FloatArray, dict[str, float]]:
    """Hinge: first principal direction and centroid of S_contact (3.3, hinge joints)."""
    axes, values = principal_axes(contact)
    return axes[0], contact.mean(axis=0), {"linear": float(values[0] / max(values.sum(), 1e-12))}


def spin_line(
    contact: FloatArray, seed: int = 0
) -> tuple[FloatArray, FloatArray, dict[str, float]]:
    """Spin: least principal direction n, and a RANSAC circle in the plane across it (eq. 3-5)."""
    axes, values = principal_axes(contact)
    n, b1, b2 = axes[2], axes[0], axes[1]
    mean = contact.mean(axis=0)
    p = np.stack([(contact - mean) @ b1, (contact - mean) @ b2], axis=1)  # eq. 3
    center, radius, inliers = ransac_circle(p, PAPER.delta, seed)
    evidence = {"circle_radius": radius, "circle_inliers": inliers / max(len(p), 1),
                "flat": float(values[2] / max(values.sum(), 1e-12))}  # fmt: skip
    return n, mean + center[0] * b1 + center[1] * b2, evidence  # eq. 5


def ransac_circle(
    points: FloatArray, delta: float, seed: int = 0, trials: int = 500
) -> tuple[FloatArray, float, int]:
    """Circle through (n, 2) points with most inliers | |p - c| - r | < delta (eq. 4).

    Returns:
        Centre (2,), radius, number of inliers; the centroid where no circle exists.
    """
    best = (points.mean(axis=0) if len(points) else np.zeros(2), 0.0, 0)
    if len(points) < 3:
        return best
    rng = np.random.default_rng(seed)
    pick = rng.integers(0, len(points), size=(trials, 3))
    centers, radii = _circles(points[pick])
    good = np.isfinite(radii) & (radii < 2.0)
    if not good.any():
        return best
    centers, radii = centers[good], radii[good]
    far = np.linalg.norm(points[None] - centers[:, None], axis=2)
    inside = np.abs(far - radii[:, None]) < delta
    k = int(np.argmax(inside.sum(axis=1)))
    center, radius = _least_squares_circle(points[inside[k]], centers[k], float(radii[k]))
    return center, radius, int(inside[k].sum())


def _circles(triples: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centres (t, 2) and radii (t,) of the circles through three points (t, 3, 2)."""
    a, b, c = triples[:, 0], triples[:, 1], triples[:, 2]
    ab, ac = b - a, c - a
    d = 2.0 * (ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0])
    d = np.where(np.abs(d) < 1e-10, np.nan, d)
    ab2, ac2 = (ab**2).sum(axis=1), (ac**2).sum(axis=1)
    offset = np.stack([ac[:, 1] * ab2 - ab[:, 1] * ac2, ab[:, 0] * ac2 - ac[:, 0] * ab2], axis=1)
    offset = offset / d[:, None]
    return a + offset, np.linalg.norm(offset, axis=1)


def _least_squares_circle(
    points: FloatArray, center: FloatArray, radius: float
) -> tuple[FloatArray, float]:
    """Algebraic circle fit to the inliers (n, 2), or the given circle if they are too few."""
    if len(points) < 4:
        return center, radius
    m = np.column_stack([2.0 * points, np.ones(len(points))])
    solution, _, rank, _ = np.linalg.lstsq(m, (points**2).sum(axis=1), rcond=None)
    if rank < 3:
        return center, radius
    r2 = float(solution[2] + solution[:2] @ solution[:2])
    return solution[:2], float(np.sqrt(max(r2, 0.0)))


def slide_axis(part: PaperPart) -> tuple[FloatArray, dict[str, float]]:
    """Slide: normalised dual-penalty trajectory verification of the part's PCA axes (eq. 6-8)."""
    candidates = principal_axes(part.points)[0]
    points = part.points[thin_out(len(part.points), 600)]
    contact = part.contact[thin_out(len(part.contact), 200)]
    costs, terms = [], []
    for axis in candidates:
        d = PAPER.reach * np.linspace(-1.0, 1.0, PAPER.steps + 1)
        d = d[np.abs(d) > 1e-9]
        moved = points[None] + d[:, None, None] * axis
        near = part.parent.distance(moved.reshape(-1, 3))
        collide = float((near < PAPER.epsilon).mean())  # eq. 7
        back = contact[None] - d[:, None, None] * axis  # |p - (x + d v)| = |(p - d v) - x|
        derail = float(part.part.distance(back.reshape(-1, 3)).mean())  # eq. 8
        costs.append(collide + PAPER.omega * derail)  # eq. 6
        terms.append((collide, derail))
    k = int(np.argmin(costs))
    evidence = {f"cost_{i}": float(c) for i, c in enumerate(costs)}
    evidence.update(collide=terms[k][0], derail=terms[k][1])
    return unit(candidates[k]), evidence
