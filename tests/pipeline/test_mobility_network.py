"""The network that says which primitives move, as the engine runs it."""

from __future__ import annotations

import numpy as np
import pytest

from mam_pipeline.parts import mobility_network
from mam_pipeline.parts.features import pair_features, primitive_features
from mam_pipeline.parts.graph import Graph, build_graph
from mam_pipeline.parts.mobility_network import (
    MobilityLimits,
    geometry_of,
    load_mobility,
    relative,
)
from mam_pipeline.prior.embedded import prior_of
from mam_pipeline.segment.geometric import GeometricSegmenter
from mam_world.truth import generated_truth


def _graph(kind: str, seed: int) -> tuple[Graph, np.ndarray]:
    """The graph of a generated object and, by primitive, whether it mostly moves."""
    truth = generated_truth(kind, seed)
    primitives = GeometricSegmenter().segment(truth.mesh)
    still = truth.face_link == 0
    share = np.bincount(primitives.labels, ~still) / np.bincount(primitives.labels)
    return build_graph(truth.mesh, primitives, 0), share > 0.5


def test_it_knows_doors_from_their_cabinet() -> None:
    graph, moves = _graph("cabinet_two_door", 8)
    found = load_mobility().moving(graph, None)
    assert found.shape == moves.shape and ((found >= 0) & (found <= 1)).all()
    assert ((found > 0.5) == moves)[graph.area > 0.02].all()


def test_a_sofa_has_hardly_anything_that_moves() -> None:
    graph, _ = _graph("sofa", 8)
    found = load_mobility().moving(graph, prior_of(graph.probe))
    assert np.average(found, weights=graph.area) < 0.05


def test_of_many_primitives_the_largest_are_looked_at(monkeypatch: pytest.MonkeyPatch) -> None:
    graph, _ = _graph("cabinet_two_door", 8)
    monkeypatch.setattr(mobility_network, "MOBILITY", MobilityLimits(most=4))
    found = load_mobility().moving(graph, None)
    largest = np.sort(np.argsort(-graph.area, kind="stable")[:4])
    assert (np.delete(found, largest) == mobility_network.MOBILITY.unknown).all()
    assert (found[largest] != mobility_network.MOBILITY.unknown).all()


def test_the_order_of_the_primitives_does_not_count() -> None:
    graph, _ = _graph("cabinet_two_door", 8)
    network = load_mobility()
    unary = primitive_features(graph, None)
    pairs = pair_features(graph, unary, None)
    nodes = mobility_network.filled(unary, network.primitive_names)
    edges = mobility_network.filled(pairs, network.pair_names)
    nodes, edges = np.nan_to_num(nodes), np.nan_to_num(edges)
    order = np.random.default_rng(0).permutation(graph.count)
    place = np.argsort(order)
    geometry = geometry_of(graph)
    one = network.answer(nodes, edges, graph.pairs, geometry, False)
    other = network.answer(nodes[order], edges, place[graph.pairs], geometry[order], False)
    assert np.allclose(one[order], other, atol=1e-4)


def test_boxes_that_touch_lie_beside_each_other() -> None:
    geometry = np.zeros((2, 21), np.float32)
    geometry[:, 0:3], geometry[:, 3:6] = [[0, 0, 0], [1, 0, 0]], [[1, 1, 1], [3, 1, 1]]
    geometry[:, 6:9] = [[1, 1, 1], [2, 1, 1]]
    found = relative(geometry)
    assert np.allclose(found[0, 1, 0:3], [1.5, 0, 0])
    assert np.allclose(found[1, 0, 0:3], [-1.5, 0, 0])
    assert np.allclose(found[0, 1, 3:6], [0, 1, 1])  # they meet along x, and share y and z
    assert found[0, 1, 6] == pytest.approx(-np.log(2)) and found[0, 1, -1] == 0
