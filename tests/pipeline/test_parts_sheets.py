"""Thin sheets of one skin: their two faces, and what stands on both, are one body."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import trimesh

from mam_pipeline.geometry.fuse import fuse_mesh
from mam_pipeline.parts.graph import Graph, build_graph
from mam_pipeline.parts.groups import enumerate_groups
from mam_pipeline.parts.rules.extent import completed
from mam_pipeline.segment.geometric import GeometricSegmenter
from mam_pipeline.types import Mesh

Box = tuple[tuple[float, ...], tuple[float, ...]]  # middle, size
FRAME: list[Box] = [((x, 0, 0), (0.1, 0.2, 1.2)) for x in (-0.55, 0.55)]
FRAME += [((0, 0, z), (1.2, 0.2, 0.1)) for z in (-0.55, 0.55)]


def graph_of(*items: Box) -> Graph:
    made = []
    for middle, size in items:
        box = trimesh.creation.box(size)
        box.apply_translation(middle)
        made.append(box)
    whole: Any = trimesh.util.concatenate(made)
    skin = fuse_mesh(Mesh(np.asarray(whole.vertices, dtype=float), np.asarray(whole.faces)), 128)
    return build_graph(skin, GeometricSegmenter().segment(skin))


def leaf(thick: float = 0.06) -> Box:
    return (0, 0, 0), (1.02, thick, 1.02)


def faces_of_leaf(graph: Graph) -> list[int]:
    flat = (graph.high - graph.low)[:, 1] < 0.02
    return [int(k) for k in np.argsort(-graph.area * flat)[:2]]


def test_the_two_faces_of_a_leaf_are_one_body() -> None:
    graph = graph_of(*FRAME, leaf())
    assert graph.rigid is not None and graph.fronts is not None
    one, other = faces_of_leaf(graph)
    (body,) = [row for row in graph.rigid if row[one]]
    assert np.flatnonzero(body).tolist() == sorted((one, other)) and not graph.fronts.any()
    rng = np.random.default_rng(0)
    masks = enumerate_groups(graph, rng.random(len(graph.pairs)), rng.random(graph.count))
    assert masks[:, one].any() and (masks[:, one] == masks[:, other]).all()
    # they join a part together, or not at all
    rest = np.ones(graph.count, dtype=bool)
    rest[[one, other, int(np.argmax(np.where(body, 0, graph.area)))]] = False
    same, move = np.full(len(graph.pairs), 0.9), np.full(graph.count, 0.9)
    assert completed(graph, rest[None], same, move)[0, [one, other]].all()
    move[one] = move[other] = 0.1
    assert not completed(graph, rest[None], same, move)[0, [one, other]].any()


@pytest.mark.parametrize("items", [[((0, 0, 0), (1.0, 0.5, 1.0))], [*FRAME, leaf(0.19)]])
def test_the_front_and_back_of_a_block_are_not(items: list[Box]) -> None:
    graph = graph_of(*items)
    assert graph.rigid is not None and not len(graph.rigid)


@pytest.mark.parametrize(("x", "tied"), [(0.35, True), (-0.35, False)])
def test_knobs_at_one_place_of_both_faces_are_one(x: float, tied: bool) -> None:
    knobs: list[Box] = [((0.35, -0.1, 0), (0.1, 0.2, 0.1)), ((x, 0.1, 0), (0.1, 0.2, 0.1))]
    graph = graph_of(*FRAME, leaf(), *knobs)
    assert graph.rigid is not None and graph.fronts is not None
    front, back = graph.low[:, 1] < -0.1, graph.high[:, 1] > 0.1
    both = [bool((row & front).any() and (row & back).any()) for row in graph.rigid]
    assert any(both) == tied
