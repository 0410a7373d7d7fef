"""The kinematic prior: probing on boxes whose freedom is known exactly."""

from __future__ import annotations

import numpy as np
import pytest

from mam_pipeline.prior.embedded import EmbeddedPrior
from mam_pipeline.prior.none import NoPrior
from mam_pipeline.prior.probe import NEAR, object_frame, probe
from mam_pipeline.types import Mesh, Primitives

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]


def boxes(
    *spans: tuple[tuple[float, float, float], tuple[float, float, float]],
) -> tuple[Mesh, Primitives]:
    """Boxes from (low, high) corners, one primitive each."""
    vertices, faces, labels = [], [], []
    for k, (low, high) in enumerate(spans):
        vertices.append(np.asarray(low) + CORNERS * (np.asarray(high) - np.asarray(low)))
        for a, b, c, d in QUADS:
            faces += [[8 * k + a, 8 * k + b, 8 * k + c], [8 * k + a, 8 * k + c, 8 * k + d]]
            labels += [k, k]
    return Mesh(np.concatenate(vertices), np.array(faces)), Primitives(np.array(labels))


def test_clearance_is_the_gap_to_the_next_box() -> None:
    mesh, primitives = boxes(((0, 0, 0), (1, 1, 1)), ((1.5, 0, 0), (2.5, 1, 1)))
    sampled = probe(mesh, primitives)
    first = np.array([True, False])
    clear = sampled.clearance(first)
    nearest = clear.min(axis=0) * mesh.diagonal
    assert nearest[0] == pytest.approx(0.5, abs=1e-4)  # towards +X stands the other box
    assert np.isinf(nearest[[1, 2, 3, 4, 5]]).all()
    assert len(sampled.members(first)) == len(clear)


def test_what_a_part_runs_into_at_rest_does_not_block_it() -> None:
    # a drawer that is modelled into a solid body, and one that only touches it
    body = ((0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    sunk, touching = ((0.2, -0.2, 0.2), (0.8, 0.6, 0.8)), ((0.2, -0.8, 0.2), (0.8, 0.0, 0.8))
    second = np.array([False, True])
    clear = probe(*boxes(body, sunk)).clearance(second)
    assert np.isinf(clear[:, 3]).all()  # pulled out, towards -Y
    assert np.isfinite(clear[:, 2]).any()  # pushed in, what stands out meets the body
    clear = probe(*boxes(body, touching)).clearance(second)
    assert np.isinf(clear[:, 3]).all() and np.isfinite(clear[:, 2]).any()
    caged = probe(*boxes(body, ((0.2, 0.2, 0.2), (0.8, 0.8, 0.8)))).clearance(second)
    assert np.isfinite(caged).all()  # what lies in a shell as a whole does not come out


def test_a_group_does_not_block_itself() -> None:
    mesh, primitives = boxes(((0, 0, 0), (1, 1, 1)), ((1.5, 0, 0), (2.5, 1, 1)))
    assert np.isinf(probe(mesh, primitives).clearance(np.array([True, True]))).all()


def test_outside_is_seen_from_outside() -> None:
    mesh, primitives = boxes(((0, 0, 0), (3, 3, 3)), ((1, 1, 1), (2, 2, 2)))
    sampled = probe(mesh, primitives)
    inner = sampled.owner == 1
    assert not sampled.escapes()[inner].any()
    assert sampled.escapes()[~inner].any()
    assert sampled.cover()[1, 0].min() == pytest.approx(1.0)  # the shell lies ahead everywhere


def test_a_caged_box_moves_with_its_cage() -> None:
    mesh, primitives = boxes(
        ((0, 0, 0), (1, 1, 1)), ((0.01,) * 3, (0.99,) * 3), ((3, 0, 0), (4, 1, 1))
    )
    prior = EmbeddedPrior().observe(mesh, primitives)
    assert prior.affinity[0, 1] > 0.9 > 0.1 > prior.affinity[0, 2]
    assert prior.mobility[1] < prior.mobility[2]
    assert np.allclose(prior.affinity, prior.affinity.T)
    assert prior.probe.cover(NEAR).shape == (3, 3, 6)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 250.0])
def test_the_prior_does_not_know_scale_or_quarter_turns(scale: float) -> None:
    mesh, primitives = boxes(((0, 0, 0), (2, 1, 1)), ((2.05, 0.1, 0.1), (2.2, 0.9, 0.9)))
    turn = np.eye(4)
    turn[:3, :3] = scale * np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    turn[:3, 3] = (5, -3, 2)
    a = EmbeddedPrior().observe(mesh, primitives)
    b = EmbeddedPrior().observe(mesh.transformed(turn), primitives)
    assert np.allclose(a.mobility, b.mobility, atol=0.05)
    assert np.allclose(a.affinity, b.affinity, atol=0.05)


def test_any_yaw_is_undone() -> None:
    mesh, _ = boxes(((0, 0, 0), (2, 1, 1)))
    for yaw in np.radians([7.0, 33.0, -20.0]):
        turn = np.eye(4)
        turn[:2, :2] = [[np.cos(yaw), -np.sin(yaw)], [np.sin(yaw), np.cos(yaw)]]
        moved = mesh.transformed(turn)
        points = moved.transformed(object_frame(moved)).vertices
        assert np.ptp(points, axis=0).prod() == pytest.approx(2 / 6**1.5, rel=1e-3)


def test_no_prior_says_nothing() -> None:
    mesh, primitives = boxes(((0, 0, 0), (1, 1, 1)), ((2, 0, 0), (3, 1, 1)))
    prior = NoPrior().observe(mesh, primitives)
    assert NoPrior.available().ok and EmbeddedPrior.available().ok
    assert (prior.mobility == 0.5).all() and (prior.affinity == 0.5).all()
