"""Whole answers of the reasoner: sets of candidates, and what is seen of them."""

from __future__ import annotations

from copy import copy
from dataclasses import replace
from typing import Any

import numpy as np
import trimesh

from mam_pipeline.dormant import awake
from mam_pipeline.parts.configurations import enumerate_sets, promise, set_features
from mam_pipeline.parts.embedded import View, decide
from mam_pipeline.parts.features import Table, table
from mam_pipeline.parts.graph import Graph, build_graph
from mam_pipeline.parts.group_features import group_features, joined
from mam_pipeline.parts.groups import enumerate_groups, expand_groups
from mam_pipeline.parts.rules.extent import completed
from mam_pipeline.parts.scores import load_scores
from mam_pipeline.parts.select import SELECTION
from mam_pipeline.parts.tree import Choice, build_tree, with_base, with_left
from mam_pipeline.types import Mesh, Primitives
from mam_training.parts.corpus import Example, generated_example

# panel and handle, the panel, the handle, another front
MASKS = np.array([[1, 1, 0, 0], [1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0]], dtype=bool)


def sizes(*longest: float) -> Table:
    """Candidates of these lengths, one wide and one thick."""
    side = np.array(longest)
    return table({"size0": side, "size1": np.ones(len(side)), "size2": np.ones(len(side))})


def _row(count: int) -> list[list[Box]]:
    """So many cubes of half a metre, a metre apart."""
    return [[((float(k), 0.0, 0.0), (0.5, 0.5, 0.5))] for k in range(count)]


def measured() -> tuple[Example, np.ndarray, np.ndarray, np.ndarray]:
    item = generated_example("cabinet_two_door", 2)
    same = (item.link[item.graph.pairs[:, 0]] == item.link[item.graph.pairs[:, 1]]).astype(float)
    move = (item.subtype[item.link] >= 0).astype(float)
    same, move = 0.9 * same + 0.05, 0.9 * move + 0.05
    return item, same, move, enumerate_groups(item.graph, same, move)


def test_sets_are_disjoint_and_hold_both_readings_of_a_handle() -> None:
    sets = enumerate_sets(MASKS, sizes(3, 2, 1, 3), np.array([0.8, 0.9, 0.85, 0.6]))
    rows = {tuple(r) for r in sets.rows()}
    assert (0, 3) in rows and (1, 2, 3) in rows  # one part, or two
    assert (1, 2) in rows and (1,) in rows  # with and without
    for row in sets.rows():
        assert row and (MASKS[row].sum(axis=0) <= 1).all()
    assert enumerate_sets(MASKS[:0], sizes(), np.zeros(0)).rows() == []


def test_what_is_like_a_chosen_part_is_tried_with_it() -> None:
    masks = np.eye(5, dtype=bool)
    sets = enumerate_sets(masks, sizes(2, 2, 2, 2, 0.5), np.array([0.9, 0.14, 0.13, 0.12, 0.11]))
    assert (0, 1, 2, 3) in {tuple(r) for r in sets.rows()}


def test_a_set_shows_what_it_leaves_and_how_its_parts_are_bound() -> None:
    item, same, move, masks = measured()
    groups = group_features(item.graph, masks, same, move, None)
    value = item.part_overlap(masks).max(axis=1)
    odds = np.full((len(masks), 3), 1 / 3)
    sets = enumerate_sets(masks, groups, value)
    features = set_features(item.graph, masks, groups, value, odds, sets, same, move)
    assert features.values.shape == (len(sets.member), len(features.names))
    assert np.isfinite(features.values).all()
    parts = features.column("number")
    assert (parts == sets.member.sum(axis=1)).all()
    full = int(np.argmax(features.column("value_sum")))
    one = int(np.flatnonzero(parts == 1)[0])
    assert features.column("free_high")[full] <= features.column("free_high")[one]
    assert features.column("rest_move")[full] < features.column("rest_move")[one]


def test_new_candidates_lie_beside_the_best_and_are_measured_alike() -> None:
    item, same, move, masks = measured()
    few = masks[:: max(1, len(masks) // 6)]
    worth = np.linspace(1.0, 0.0, len(few)).astype(np.float64)
    more = expand_groups(item.graph, few, worth, same)
    known = {m.tobytes() for m in few}
    assert len(more) and not any(m.tobytes() in known for m in more)
    both = np.concatenate([few, more])
    apart = joined(
        group_features(item.graph, few, same, move, None),
        group_features(item.graph, more, same, move, None),
        both,
    )
    whole = group_features(item.graph, both, same, move, None)
    assert np.allclose(apart.values, whole.values, equal_nan=True, atol=1e-5)


def test_a_box_swings_about_the_edge_that_touches() -> None:
    item, same, move, _ = measured()
    prior = item.prior()
    parts = np.array([item.link == k for k in np.flatnonzero(item.subtype == 0)])
    assert len(parts)
    seen = group_features(item.graph, parts, same, move, prior)
    assert seen.column("swing_free").min() > 0.5
    blind = group_features(item.graph, parts, same, move, None)
    assert np.isnan(blind.column("swing_free")).all()


def test_four_like_parts_promise_more_than_the_best_of_them() -> None:
    sure, faint = np.array([0.7, 0.6, 0.6, 0.55]), np.array([0.7, 0.05, 0.05, 0.05])
    for value, best in ((sure, 4), (faint, 1)):
        numbers = np.arange(1, 5)
        sets = table({"number": numbers, "value_sum": np.cumsum(value)})
        assert numbers[int(np.argmax(promise(sets)))] == best


def test_an_example_knows_how_well_its_primitives_hold_the_parts() -> None:
    item, *_ = measured()
    assert 0.9 < item.bound <= 1.0
    mixed = replace(item, overlap=np.ones_like(item.overlap) * item.graph.area[:, None])
    assert mixed.bound < 0.6
    still = replace(item, subtype=np.full_like(item.subtype, -1))
    assert still.bound == 1.0


def test_what_was_left_of_a_part_joins_it_and_what_the_base_holds_more_does_not() -> None:
    item, *_ = measured()
    pairs = np.array([[0, 1], [0, 2], [2, 3], [1, 4]])
    count = item.graph.count
    graph = replace(item.graph, pairs=pairs, gap=np.zeros(4), area=np.full(count, 1 / count))
    move = np.full(graph.count, 0.1)
    move[[0, 1, 2]] = 0.9
    part = np.arange(graph.count)[None] == 0
    found = completed(graph, part, np.array([0.8, 0.6, 0.7, 0.9]), move)
    assert np.flatnonzero(found[0]).tolist() == [0]  # 4 and 3 are still and hold 1 and 2 more
    found = completed(graph, part, np.array([0.8, 0.6, 0.7, 0.2]), move)
    assert np.flatnonzero(found[0]).tolist() == [0, 1]
    found = completed(graph, part, np.array([0.4, 0.6, 0.5, 0.1]), move)
    assert np.flatnonzero(found[0]).tolist() == [0, 1, 2]
    found = completed(graph, part, np.array([0.2, 0.6, 0.5, 0.1]), move)
    assert np.flatnonzero(found[0]).tolist() == [0, 2]  # 1 is bound too weakly
    for times, taken in ((0.3, [0, 1]), (0.1, [0, 1, 2])):  # what was nearly a part, and a trifle
        left = np.arange(count)[None] == 2
        area = np.where(left[0], times * graph.area[0], graph.area)
        weights = np.array([0.4, 0.6, 0.5, 0.1])
        found = completed(replace(graph, area=area), part, weights, move, left)
        assert np.flatnonzero(found[0]).tolist() == taken
    share = np.where(np.arange(count) == 0, 0.9, 0.01 / (count - 2))
    share[2] = 0.09  # 0.01 would be left of the base without it
    found = completed(replace(graph, area=share), part, np.array([0.4, 0.6, 0.5, 0.1]), move)
    assert np.flatnonzero(found[0]).tolist() == [0, 1]


def test_what_stands_apart_and_is_no_trifle_does_not_join() -> None:
    """The racks behind an oven's door, and its knob."""
    front: Box = ((0, 0, 0), (1, 0.05, 1))
    knob, rack = ((0, -0.12, 0.3), (0.05, 0.05, 0.05)), ((0, 0.4, 0), (0.9, 0.6, 0.02))
    graph = graph_of([front], [knob], [rack], [((0, 1.2, 0), (1.2, 0.5, 1.2))])
    same, move = np.full(len(graph.pairs), 0.6), np.array([0.9, 0.9, 0.9, 0.0])
    same[(graph.pairs == 3).any(axis=1)] = 0.1
    assert completed(graph, np.eye(4, dtype=bool)[:1], same, move)[0].tolist() == [1, 1, 0, 0]


def test_parts_that_leave_nothing_give_the_largest_to_the_base() -> None:
    graph = measured()[0].graph
    every = np.arange(graph.count)  # the largest first
    parts = np.array([every > 1, every == 0, every == 1])
    choice = Choice((0, 1, 2), np.full(3, 0.5), np.full((3, 3), 1 / 3), np.full(3, 0.5), 0.5)
    rest = tuple(every[2:].tolist())
    tree = build_tree(graph, *with_base(graph, parts, choice))
    assert [n.primitives for n in tree.nodes] == [(0,), rest, (1,)]
    some = build_tree(graph, *with_base(graph, parts, replace(choice, chosen=(0, 2))))
    assert [n.primitives for n in some.nodes] == [(0,), rest, (1,)]
    last = int(every[-1])
    assert graph.area[last] < SELECTION.least_base  # a knob alone is no base
    parts[0, last] = False
    knob = build_tree(graph, *with_base(graph, parts, choice))
    assert [n.primitives for n in knob.nodes] == [(0, last), rest[:-1], (1,)]


def test_equal_parts_that_leave_nothing_each_leave_their_largest_piece() -> None:
    graph = measured()[0].graph
    half = graph.count // 2
    area = np.ones(graph.count)
    area[[0, half]] = 3.0
    left = np.arange(graph.count) < half
    choice = Choice((0, 1), np.full(2, 0.5), np.full((2, 3), 1 / 3), np.full(2, 0.5), 0.5)
    own = replace(graph, area=area)
    tree = build_tree(own, *with_base(own, np.array([left, ~left]), choice))
    assert len(tree.nodes) == 3 and tree.nodes[0].primitives == (0, half)


def test_what_is_too_unsure_is_dormant() -> None:
    example = generated_example("chest_of_drawers", 9)
    view = View(example.graph, example.prior())
    scores = copy(load_scores())
    masks, usual = decide([view], scores)
    assert len(usual.chosen) > 1 and 0 < scores.least < 1
    assert all(usual.confidence[c] >= scores.least for c in usual.chosen[1:])
    scores.least = 1.0
    masks, choice = decide([view], scores)
    assert choice.chosen == usual.chosen[:1]
    assert set(choice.left) >= set(usual.chosen[1:])
    tree = build_tree(view.graph, masks, choice)
    found = with_left(view.graph, tree)
    more = found.nodes[len(tree.nodes) :]
    assert more and all(node.dormant and node.subtype == "slide" for node in more)
    assert [n.primitives for n in awake(found).nodes] == [n.primitives for n in tree.nodes]
    owned = sorted(p for node in found.nodes for p in node.primitives)
    assert owned == list(range(view.graph.count))


Box = tuple[tuple[float, ...], tuple[float, ...]]  # middle, size


def graph_of(*pieces: list[Box]) -> Graph:
    """The graph of primitives that are boxes, one or several each."""
    made, labels = [], []
    for k, boxes in enumerate(pieces):
        for middle, size in boxes:
            box = trimesh.creation.box(size)
            box.apply_translation(middle)
            made.append(box)
            labels += [k] * len(box.faces)
    whole: Any = trimesh.util.concatenate(made)
    mesh = Mesh(np.asarray(whole.vertices, dtype=float), np.asarray(whole.faces))
    return build_graph(mesh, Primitives(np.array(labels)))


def test_a_door_does_not_hang_on_the_door_beside_it() -> None:
    """Two doors that meet each other and stand a little before their cupboard; a flap on one."""
    body: list[Box] = [((0, 0.25, 0), (0.8, 0.4, 0.6))]
    doors: list[Box] = [
        ((-0.2, 0.025, 0), (0.4, 0.02, 0.6)),
        ((0.201, 0.025, 0), (0.402, 0.02, 0.6)),
    ]
    flap: Box = ((0.2, 0.01, 0), (0.2, 0.01, 0.1))

    def parents(*pieces: list[Box]) -> list[int]:
        graph = graph_of(*pieces)
        masks = np.eye(len(pieces), dtype=bool)[1:]
        sure = np.full(len(masks), 0.9)
        odds = np.tile([0.8, 0.1, 0.1], (len(masks), 1))
        choice = Choice(tuple(range(len(masks))), sure, odds, sure, 0.9)
        return [node.parent for node in build_tree(graph, masks, choice).nodes]

    assert parents(body, *([d] for d in doors), [flap]) == [-1, 0, 0, 2]
    far: list[Box] = [((0, 0.4, 0), (0.8, 0.4, 0.6))]
    smaller: Box = ((0.15, 0.025, 0), (0.3, 0.02, 0.6))
    assert parents(body, [doors[0]], [smaller]) == [-1, 0, 1]
    assert parents(far, [doors[0]], [doors[1]]).count(0) == 1  # a screen that folds
