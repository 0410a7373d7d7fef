"""Handles of one skin: what stands on two feet on one flat moves with it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import trimesh

from mam_pipeline.geometry.fuse import fuse_mesh
from mam_pipeline.parts.graph import Graph, build_graph
from mam_pipeline.parts.groups import enumerate_groups, expand_groups, with_rigid
from mam_pipeline.parts.rules import handle_feet as feet
from mam_pipeline.parts.rules.choice import with_twins
from mam_pipeline.parts.rules.extent import completed
from mam_pipeline.segment.geometric import GeometricSegmenter
from mam_pipeline.types import Mesh, Primitives

CUBE = (0, 0, 0), (1, 1, 1)
FRONT = -0.5  # y of the cube's front


Box = tuple[tuple[float, ...], tuple[float, ...]]  # middle, size


def bow(x: float = 0.0, reach: float = 0.2, high: float = 0.7) -> list[Box]:
    """An upright handle on two feet before the front; its bar ends `reach` before it."""
    at = high / 2 - 0.05
    foot = [((x, FRONT - reach / 2, z), (0.1, reach, 0.1)) for z in (-at, at)]
    return [*foot, ((x, FRONT - reach + 0.05, 0.0), (0.1, 0.1, high))]


def mesh_of(*boxes: Box, beside: trimesh.Trimesh | None = None) -> Mesh:
    made = [] if beside is None else [beside]
    for middle, size in boxes:
        box = trimesh.creation.box(size)
        box.apply_translation(middle)
        made.append(box)
    whole: Any = trimesh.util.concatenate(made)
    return Mesh(np.asarray(whole.vertices, dtype=float), np.asarray(whole.faces))


def graph_of(*boxes: Box, skin: bool = True) -> Graph:
    mesh = mesh_of(*boxes)
    if skin:
        mesh = fuse_mesh(mesh, 96)
    return build_graph(mesh, GeometricSegmenter().segment(mesh))


def front(graph: Graph) -> int:
    """The primitive of the cube's front."""
    flat = (graph.high - graph.low)[:, 1] < 0.05
    order = np.argsort(np.where(flat, graph.center[:, 1] - graph.area, np.inf))
    return int(order[0])


def test_a_bow_moves_with_the_front_that_it_stands_on() -> None:
    graph = graph_of(CUBE, *bow())
    assert graph.rigid is not None and len(graph.rigid) == 1
    body = graph.rigid[0]
    handle = graph.low[:, 1] < graph.low[front(graph), 1] - 0.02
    assert body[handle].all()
    assert np.flatnonzero(body & (graph.area > 0.1)).tolist() == [front(graph)]


@pytest.mark.parametrize(
    "others",
    [
        [((0, FRONT - 0.1, 0), (0.1, 0.2, 0.4))],  # one foot: a knob may turn
        [*bow(-0.25), *bow(0.25)],  # perhaps two fronts whose gap has closed
        [((0, FRONT - 0.1, z), (0.9, 0.2, 0.1)) for z in (-0.3, 0.3)]  # broad ones: a hood
        + [((0, FRONT - 0.2, 0), (0.9, 0.1, 0.7))],
    ],
    ids=["post", "two bows", "hood"],
)
def test_what_may_move_otherwise_is_not_tied(
    others: list[Box],
) -> None:
    graph = graph_of(CUBE, *others)
    assert graph.rigid is not None and len(graph.rigid) == 0
    assert len(enumerate_groups(graph, np.ones(len(graph.pairs)), np.ones(graph.count)))


def test_a_bail_is_not_tied_to_its_bucket() -> None:
    bucket = trimesh.creation.cylinder(0.5, 1.0, sections=64)
    bail = [((x, 0, 0.3), (0.2, 0.1, 0.1)) for x in (-0.55, 0.55)]
    bail += [((x, 0, 0.5), (0.1, 0.1, 0.5)) for x in (-0.65, 0.65)]
    bail += [((0, 0, 0.8), (1.4, 0.1, 0.1))]
    skin = fuse_mesh(mesh_of(*bail, beside=bucket), 96)
    middle = skin.vertices[skin.faces].mean(axis=1)
    aside = np.hypot(middle[:, 0], middle[:, 1])
    on_it = (aside > 0.53) | (middle[:, 2] > 0.55)
    label = np.select([on_it, middle[:, 2] < -0.505, middle[:, 2] > 0.505], [1, 2, 3])
    merges = np.array([[0, 1], [2, 4], [3, 5]])

    def bodies() -> int:
        rigid = build_graph(skin, Primitives(label, merges)).rigid
        assert rigid is not None
        return len(rigid)

    assert bodies() == 0  # its feet face away from each other
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(feet, "FEET", replace(feet.FEET, flat=-1.1, across=1.1))
        assert bodies() == 1  # and that is why


def test_an_authored_mesh_says_nothing_of_feet() -> None:
    assert graph_of(CUBE, *bow(), skin=False).rigid is None


def test_no_candidate_parts_a_handle_from_its_front_or_has_two_fronts() -> None:
    back = [((x, -y, z), size) for (x, y, z), size in bow()]
    graph = graph_of(CUBE, *bow(), *back)
    assert graph.rigid is not None and len(graph.rigid) == 2
    rng = np.random.default_rng(0)
    same, move = rng.random(len(graph.pairs)), rng.random(graph.count)
    masks = enumerate_groups(graph, same, move)
    more = expand_groups(graph, masks, rng.random(len(masks)), same)
    assert len(masks) and len(more)
    both = np.concatenate([masks, more]).astype(int) @ graph.rigid.T.astype(int)
    size = graph.rigid.sum(axis=1)
    assert ((both == 0) | (both == size)).all() and ((both > 0).sum(axis=1) < 2).all()
    assert (both > 0).any()
    # nor does a part take one of their primitives from the base
    part = np.asarray(~graph.rigid.any(axis=0))
    filled = completed(graph, part[None], np.full(len(same), 0.9), np.full(graph.count, 0.9))
    assert not np.asarray(filled)[0, ~part].any()


@pytest.mark.parametrize("high", [0.7, 0.5])
def test_a_front_with_the_same_handle_moves_as_well(high: float) -> None:
    back = [((x, -y, z), size) for (x, y, z), size in bow(high=high)]
    graph = graph_of(CUBE, *bow(), *back)
    assert graph.rigid is not None and len(graph.rigid) == 2
    more = graph.rigid | (np.arange(graph.count) == np.argmax(graph.area * ~graph.rigid.any(0)))
    masks = np.concatenate([graph.rigid, more])
    value = np.array([0.5, 0.2, 0.4, 0.3])  # the second body is best together with a side
    found = with_twins(graph, masks, value, [0])
    assert found == ([0, 3] if high == 0.7 else [0])
    assert with_twins(graph, masks, value, [0, 1]) == [0, 1]


def test_the_box_behind_a_front_belongs_to_it() -> None:
    fronts: list[Box] = [((0, 0, z), (1.0, 0.05, 0.48)) for z in (-0.25, 0.25)]
    box, rod = ((0, 0.4, 0.25), (0.8, 0.7, 0.4)), ((0, 0.4, 0.25), (0.05, 0.7, 0.05))
    wide = (0, 0.4, 0.0), (0.9, 0.7, 0.9)  # behind both
    far = (0, 1.4, 0.25), (0.8, 0.7, 0.4)
    mesh = mesh_of(*fronts, box, rod, wide, far)
    graph = build_graph(mesh, Primitives(np.repeat(np.arange(6), 12)))
    graph = replace(graph, rigid=np.eye(6, dtype=bool)[:2], fronts=np.ones(2, dtype=bool))
    row = np.eye(6, dtype=bool)
    got, bodies = with_rigid(graph, row[2])
    assert bodies == 1 and np.flatnonzero(got).tolist() == [1, 2]
    for k in (3, 4, 5):
        got, bodies = with_rigid(graph, row[k])
        assert bodies == 0 and np.flatnonzero(got).tolist() == [k]


def test_a_front_without_a_handle_has_a_twin_all_the_same() -> None:
    leaves: list[Box] = [((x, 0, 0), (0.48, 0.05, 1.0)) for x in (-0.25, 0.25)]
    graph = build_graph(
        mesh_of(*leaves, ((0, 0.5, 0), (1.0, 0.9, 1.0))), Primitives(np.repeat(np.arange(3), 12))
    )
    graph = replace(graph, rigid=np.eye(3, dtype=bool)[:2], fronts=np.ones(2, dtype=bool))
    masks = np.eye(3, dtype=bool)
    assert with_twins(graph, masks, np.array([0.9, 0.4, 0.1]), [0]) == [0, 1]
