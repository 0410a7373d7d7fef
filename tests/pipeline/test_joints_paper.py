"""The paper's initialisation and optimisation on contacts that are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from mam_sim_paper.initialise import hinge_line, paper_part, ransac_circle, slide_axis, spin_line
from mam_sim_paper.optimise import minimise, pack, residuals, unpack

from mam_pipeline.geometry.boxes import angle_between
from mam_pipeline.types import FloatArray, Mesh


def ring(n: int = 60, arc: float = 2 * np.pi, noise: float = 0.0) -> FloatArray:
    rng = np.random.default_rng(0)
    t = np.linspace(0, arc, n, endpoint=False)
    return np.stack([0.3 * np.cos(t), 0.3 * np.sin(t)], axis=1) + rng.normal(0, noise, (n, 2))


def test_circle_survives_outliers_and_partial_view() -> None:
    rng = np.random.default_rng(1)
    arc = ring(80, 0.6 * np.pi, 0.001) + np.array([1.0, 2.0])
    points = np.concatenate([arc, rng.uniform(0, 3, (40, 2))])
    center, radius, inliers = ransac_circle(points, 0.005)
    assert center == pytest.approx([1.0, 2.0], abs=0.005)
    assert radius == pytest.approx(0.3, abs=0.005)
    assert inliers >= 75


def test_circle_of_too_few_points_is_their_centroid() -> None:
    center, radius, _ = ransac_circle(np.array([[0.0, 0.0], [2.0, 0.0]]), 0.005)
    assert center == pytest.approx([1.0, 0.0]) and radius == 0.0


def test_spin_axis_is_normal_to_its_ring() -> None:
    flat = ring()
    contact = np.column_stack([flat[:, 0] + 0.1, np.full(len(flat), 0.2), flat[:, 1]])
    axis, pivot, _ = spin_line(contact)
    assert angle_between(axis, np.array([0, 1.0, 0])) < 1e-6
    assert pivot == pytest.approx([0.1, 0.2, 0.0], abs=1e-6)


def test_hinge_line_follows_discrete_anchors() -> None:
    rng = np.random.default_rng(0)
    z = np.concatenate([rng.uniform(0, 0.05, 50), rng.uniform(0.9, 0.95, 50)])
    contact = np.column_stack([rng.normal(0, 0.003, 100), rng.normal(0.5, 0.003, 100), z])
    axis, pivot, _ = hinge_line(contact)
    assert angle_between(axis, np.array([0, 0, 1.0])) < 0.02
    assert pivot[:2] == pytest.approx([0, 0.5], abs=0.002)


def test_parameters_round_trip() -> None:
    axis, origin = np.array([0.0, 0.6, 0.8]), np.array([1.0, 2.0, 3.0])
    frame, x = pack("revolute", axis, origin)
    a, o = unpack(frame, origin, x)
    assert a == pytest.approx(axis) and o == pytest.approx(origin)
    assert len(pack("prismatic", axis, origin)[1]) == 2


@pytest.mark.parametrize("method", ["lm", "nelder-mead"])
def test_a_tilted_slide_is_straightened_on_its_plane(method: str) -> None:
    """Contact points gliding on the plane z = 0: equation 9 is least for a level axis."""
    rng = np.random.default_rng(0)
    contact = np.column_stack([rng.uniform(0, 1, (80, 2)), np.zeros(80)])
    tilted = np.array([1.0, 0.0, 0.08])
    states = np.array([0.1, 0.2, 0.4])

    def distance(points: FloatArray) -> FloatArray:
        return np.abs(points[:, 2])

    axis, _, before, after, curve = minimise(
        distance, contact, "prismatic", tilted / np.linalg.norm(tilted), np.zeros(3), states,
        method,  # type: ignore[arg-type]
    )  # fmt: skip
    assert after < 0.05 * before and abs(axis[2]) < 0.02
    assert list(curve) == sorted(curve, reverse=True)
    r = residuals(distance, contact, "prismatic", np.array([1.0, 0, 0]), np.zeros(3), states)
    assert r == pytest.approx(0.0)


def test_slide_verification_prefers_the_rail() -> None:
    """A long bar in a U-shaped channel slides along it: eq. 6 punishes collision sideways."""
    corners = np.array([[i & 1, i >> 1 & 1, i >> 2 & 1] for i in range(8)], dtype=float)
    quads = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2],
                      [1, 3, 7, 5]])  # fmt: skip
    tri = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    bounds = [
        ((0, 0.012, 0.012), (0.6, 0.088, 0.1)),
        ((0, 0, 0), (0.6, 0.1, 0.005)), ((0, 0, 0), (0.6, 0.005, 0.1)),
        ((0, 0.095, 0), (0.6, 0.1, 0.1)),
    ]  # fmt: skip
    vertices = [np.array(a) + corners * (np.array(b) - np.array(a)) for a, b in bounds]
    mesh = Mesh(np.concatenate(vertices), np.concatenate([tri + 8 * i for i in range(4)]))
    part = paper_part(mesh, np.arange(12), np.arange(12, 48))
    axis, terms = slide_axis(part)
    assert angle_between(axis, np.array([1.0, 0, 0])) < 0.05
    assert {"collide", "derail", "cost_0"} <= set(terms)
