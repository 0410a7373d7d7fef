"""The reasoner: graph, candidates, selection and the tree, on objects whose parts are known."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
import trimesh

from mam_pipeline.backends import KinematicPrior
from mam_pipeline.parts import joint_view
from mam_pipeline.parts.embedded import (
    REASONER,
    EmbeddedReasoner,
    View,
    bonds_of,
    decide,
    sampled_views,
)
from mam_pipeline.parts.features import Table, pair_features, primitive_features
from mam_pipeline.parts.graph import Graph, build_graph, roundness, tight_box
from mam_pipeline.parts.group_features import group_features, with_rivals
from mam_pipeline.parts.groups import components, enumerate_groups, merge_tree
from mam_pipeline.parts.network import Reading
from mam_pipeline.parts.rules.fittings import FITTINGS
from mam_pipeline.parts.scores import Scores, load_scores
from mam_pipeline.parts.select import select_groups
from mam_pipeline.parts.tree import clear_from, named, part_kind
from mam_pipeline.prior.embedded import EmbeddedPrior
from mam_pipeline.rules import ALL_RULES
from mam_pipeline.types import JointSubtype, KinematicTree, Mesh, PartNode, Primitives
from mam_training.parts.corpus import Example, abstract_kinds, generated, generated_example, united
from mam_world import Style, make_object

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
QUADS = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
Corner = tuple[float, float, float]


def boxes(*spans: tuple[Corner, Corner]) -> tuple[Mesh, Primitives]:
    """Boxes from (low, high) corners, one primitive each."""
    vertices, faces, labels = [], [], []
    for k, (low, high) in enumerate(spans):
        vertices.append(np.asarray(low) + CORNERS * (np.asarray(high) - np.asarray(low)))
        for a, b, c, d in QUADS:
            faces += [[8 * k + a, 8 * k + b, 8 * k + c], [8 * k + a, 8 * k + c, 8 * k + d]]
            labels += [k, k]
    return Mesh(np.concatenate(vertices), np.array(faces)), Primitives(np.array(labels))


def cupboard() -> tuple[Mesh, Primitives]:
    """A case of five boards, a door before it and a handle on the door."""
    return boxes(
        ((0.0, 0, 0), (0.5, 0.02, 1)), ((0.0, 0.58, 0), (0.5, 0.6, 1)),
        ((0.0, 0, 0.98), (0.5, 0.6, 1)), ((0.0, 0, 0), (0.5, 0.6, 0.02)),
        ((0.48, 0, 0), (0.5, 0.6, 1)), ((-0.022, 0.001, 0.001), (-0.002, 0.599, 0.999)),
        ((-0.06, 0.52, 0.4), (-0.02, 0.55, 0.6)),
    )  # fmt: skip


@lru_cache(maxsize=4)
def example(kind: str = "abstract_case", seed: int = 3) -> Example:
    return generated_example(kind, seed)


def test_graph_measures_gap_contact_and_boxes() -> None:
    mesh, primitives = boxes(
        ((0, 0, 0), (3, 2, 1)), ((3.0, 0, 0), (4, 2, 1)), ((4.1, 0, 0), (5, 2, 1))
    )
    graph = build_graph(mesh, primitives)
    gap = {(int(i), int(j)): g * mesh.diagonal for (i, j), g in zip(graph.pairs, graph.gap)}
    assert gap[0, 1] == pytest.approx(0.0, abs=1e-3)
    assert gap[1, 2] == pytest.approx(0.1, rel=0.05)
    assert graph.size[0] * mesh.diagonal == pytest.approx([3, 2, 1], rel=1e-3)
    assert graph.area.sum() == pytest.approx(1.0)


def test_a_leaning_plate_gets_a_tight_box() -> None:
    angle = np.radians(30)
    turn = np.array(
        [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    )
    points = (CORNERS * [1.0, 0.6, 0.02]) @ turn.T
    axes, size = tight_box(points)
    assert size == pytest.approx([1.0, 0.6, 0.02], abs=1e-4)
    assert abs(axes[2] @ turn[:, 2]) == pytest.approx(1.0, abs=1e-4)


def test_round_is_round_and_square_is_not() -> None:
    rng = np.random.default_rng(0)
    t = rng.uniform(0, 2 * np.pi, 600)
    disc = np.stack([np.cos(t), np.sin(t), rng.uniform(0, 0.4, 600)], axis=1)
    plate = rng.uniform(-1, 1, (900, 3)) * [1, 1, 0.2]
    score, axis = roundness(disc, np.eye(3), np.array([2.0, 2.0, 0.4]))
    assert score > 0.9 and abs(axis[2]) == 1
    assert roundness(plate, np.eye(3), np.array([2.0, 2.0, 0.4]))[0] < 0.85


def test_candidates_hold_the_true_parts() -> None:
    item = example()
    same = (item.link[item.graph.pairs[:, 0]] == item.link[item.graph.pairs[:, 1]]).astype(float)
    move = (item.subtype[item.link] >= 0).astype(float)
    masks = enumerate_groups(item.graph, 0.9 * same + 0.05, 0.9 * move + 0.05)
    best = item.part_overlap(masks).max(axis=0)[item.subtype >= 0]
    assert best.min() > 0.9


def test_components_and_merge_tree_follow_the_bonds() -> None:
    mesh, primitives = boxes(*(((k, 0, 0), (k + 1, 1, 1)) for k in range(4)))
    graph = build_graph(mesh, primitives)
    strong = np.array([set(p) in ({0, 1}, {2, 3}) for p in graph.pairs.tolist()])
    groups = components(graph, strong, np.ones(4, bool))
    assert sorted(np.flatnonzero(g).tolist() for g in groups) == [[0, 1], [2, 3]]
    tree = merge_tree(graph, np.where(strong, 0.9, 0.2))
    assert [0, 1] in [np.flatnonzero(g).tolist() for g in tree]


def test_selection_is_disjoint_and_takes_the_larger_total() -> None:
    masks = np.array([[1, 1, 1, 1], [1, 1, 0, 0], [0, 0, 1, 1], [0, 1, 0, 0]], dtype=bool)
    assert select_groups(masks, np.array([0.9, 0.8, 0.85, 0.1]), 0.5) == [2, 1]
    assert select_groups(masks, np.array([0.95, 0.6, 0.6, 0.1]), 0.5) == [0]
    assert select_groups(masks, np.array([0.1, 0.2, 0.1, 0.1]), 0.5) == []
    assert select_groups(masks, np.array([0.1, 0.6, 0.1, 0.1]), 0.5) == [1]
    assert select_groups(masks[:0], np.zeros(0), 0.5) == []


def test_features_do_not_know_scale_turns_or_face_order() -> None:
    mesh, primitives = cupboard()
    order = np.random.default_rng(1).permutation(len(mesh.faces))
    turn = np.eye(4)
    turn[:3, :3] = 40.0 * np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1]])
    other = Mesh(mesh.vertices, mesh.faces[order]).transformed(turn)
    tables = []
    for m, p in ((mesh, primitives), (other, Primitives(primitives.labels[order]))):
        graph = build_graph(m, p)
        unary = primitive_features(graph, None)
        pairs = pair_features(graph, unary, None)
        assert np.isnan(unary.column("mobility")).all()
        tables.append((unary, pairs))
    for name in ("size0", "thin", "low", "upright_long", "span_z", "degree"):
        assert np.allclose(tables[0][0].column(name), tables[1][0].column(name), atol=0.01), name
    assert np.allclose(tables[0][1].column("inside"), tables[1][1].column("inside"), atol=0.01)


def test_group_features_see_the_handle_and_the_freedom() -> None:
    mesh, primitives = cupboard()
    prior = EmbeddedPrior().observe(mesh, primitives)
    graph = build_graph(mesh, primitives, probed=prior.probe)
    masks = np.array([[0, 0, 0, 0, 0, 1, 1], [0, 0, 0, 0, 1, 0, 0]], dtype=bool)
    half = np.full(len(graph.pairs), 0.5)
    groups = group_features(graph, masks, half, np.full(graph.count, 0.5), prior)
    assert groups.column("proud")[0] > 0.005
    assert groups.column("proud_off_a")[0] > 0.5  # far from the middle: a door, not a drawer
    assert groups.column("free_best")[0] > 0.95
    blind = group_features(graph, masks, half, np.full(graph.count, 0.5), None)
    assert np.isnan(blind.column("free_best")).all()
    wide = with_rivals(groups, masks, np.array([0.8, 0.2]))
    assert wide.column("best_apart").tolist() == pytest.approx([0.2, 0.8])


def test_every_primitive_is_in_one_part() -> None:
    mesh, primitives = cupboard()
    prior = EmbeddedPrior().observe(mesh, primitives)
    tree = EmbeddedReasoner().reason(mesh, primitives, prior)
    assert sorted(p for n in tree.nodes for p in n.primitives) == list(range(primitives.count))
    assert len({n.name for n in tree.nodes}) == len(tree.nodes)
    assert all(0 <= n.confidence <= 1 for n in tree.nodes)


def test_the_door_of_a_cupboard_is_found() -> None:
    mesh, primitives = cupboard()
    for prior in (EmbeddedPrior().observe(mesh, primitives), None):
        tree = EmbeddedReasoner().reason(mesh, primitives, prior)
        parts = {n.primitives: n for n in tree.nodes[1:]}
        assert (5, 6) in parts
        assert parts[5, 6].candidates and parts[5, 6].runner_up


def test_samplings_are_averaged() -> None:
    mesh, primitives = cupboard()
    prior = EmbeddedPrior().observe(mesh, primitives)
    views = sampled_views(mesh, primitives, prior, 0)
    assert len(views) == REASONER.samplings and views[0].prior is prior
    assert not np.array_equal(views[0].graph.probe.points, views[1].graph.probe.points)
    moves = [bonds_of([v], load_scores())[0].move for v in views]
    together = bonds_of(views, load_scores())
    assert (together[0].move <= np.max(moves, axis=0)).all()
    assert (together[0].move >= np.min(moves, axis=0)).all()
    assert all(np.array_equal(together[0].move, r.move) for r in together)
    once, thrice = decide(views[:1], load_scores()), decide(views[:1] * 3, load_scores())
    assert np.array_equal(once[0], thrice[0]) and once[1].chosen == thrice[1].chosen
    assert once[1].value == pytest.approx(thrice[1].value)
    assert all(v.prior is None for v in sampled_views(mesh, primitives, None, 0))


def test_a_prior_from_a_file_gives_what_a_fresh_one_gives_and_an_edit_holds() -> None:
    mesh, primitives = cupboard()
    prior = EmbeddedPrior().observe(mesh, primitives)
    stored = KinematicPrior(prior.mobility, prior.affinity)  # as read back: without its samples
    fresh, read = (sampled_views(mesh, primitives, p, 0) for p in (prior, stored))
    for a, b in zip(fresh, read):
        assert np.array_equal(a.prior.mobility, b.prior.mobility)  # type: ignore[union-attr]
    assert not np.array_equal(fresh[1].prior.mobility, prior.mobility)  # type: ignore[union-attr]
    edited = KinematicPrior(np.zeros(primitives.count), prior.affinity)
    assert all(v.prior is edited for v in sampled_views(mesh, primitives, edited, 0))


class PairsAlone(Scores):
    """What the boosters say of each pair by itself: no network sees the others."""

    def read(self, graph: Graph, unary: Table, pairs: Table) -> Reading:
        return Reading(self._predict("same", pairs), self._predict("move", unary))


def test_a_pair_that_one_sampling_misses_is_judged_by_the_others() -> None:
    mesh, primitives = cupboard()
    graph = build_graph(mesh, primitives)
    scores = PairsAlone(load_scores().members, {"calibration": [(0.0, 0.0), (1.0, 1.0)]})
    edges = ("pairs", "gap", "touch", "patch", "border", "concave", "convex")
    fewer = replace(graph, **{name: getattr(graph, name)[1:] for name in edges})
    alone = [bonds_of([View(g, None)], scores)[0].same for g in (graph, fewer)]
    first, second = bonds_of([View(graph, None), View(fewer, None)], scores)
    assert first.same[0] == pytest.approx(alone[0][0], abs=1e-4)
    assert len(second.same) == len(graph.pairs) - 1
    assert np.array_equal(first.same[1:], second.same)


def test_a_mesh_is_fused_when_nearly_all_cuts_are_of_one_surface() -> None:
    graph = build_graph(*cupboard())
    order = [(k, k + 1) for k in range(graph.count - 1)]
    assert not graph.is_fused
    assert not replace(graph, merges=np.array(order[:1])).is_fused
    assert replace(graph, merges=np.array(order)).is_fused
    labels = np.arange(graph.count)
    assert Primitives(labels, np.array(order)).is_fused and not Primitives(labels).is_fused
    kinds = load_scores("authored"), load_scores("fused")
    assert kinds[0] is not kinds[1]


def test_one_lump_has_nothing_that_moves_and_says_so() -> None:
    mesh, primitives = boxes(((0, 0, 0), (1, 1, 1)))
    tree = EmbeddedReasoner().reason(mesh, primitives, None)
    assert len(tree.nodes) == 1
    assert "only one primitive" in tree.nodes[0].evidence["nothing_movable"]


def test_reasoning_is_deterministic() -> None:
    mesh, primitives = cupboard()
    first, second = (EmbeddedReasoner().reason(mesh, primitives, None) for _ in range(2))
    assert [n.primitives for n in first.nodes] == [n.primitives for n in second.nodes]
    assert [n.confidence for n in first.nodes] == [n.confidence for n in second.nodes]


def test_a_part_is_named_after_its_last_type() -> None:
    graph = example("abstract_case", 3).graph
    base = PartNode("base", "body", (0,), -1, "fixed")
    words: dict[JointSubtype, set[str]] = {
        "slide": {"drawer", "panel", "button"}, "hinge": {"door", "lid", "lever"},
        "spin": {"knob", "wheel"},
    }  # fmt: skip
    for subtype, known in words.items():
        parts = [PartNode(f"part_{k}", "part", (k + 1,), 0, subtype) for k in range(2)]
        nodes = named(graph, KinematicTree((base, *parts))).nodes
        assert nodes[0] == base
        assert {n.kind for n in nodes[1:]} <= known
        assert len({n.name for n in nodes}) == 3


def test_a_thick_handle_makes_no_lever_of_a_door() -> None:
    mesh, primitives = boxes(
        ((0.0, 0, 0), (0.5, 0.4, 0.5)), ((-0.02, 0, 0), (-0.002, 0.4, 0.5)),
        ((-0.2, 0.3, 0.1), (-0.02, 0.38, 0.4)),
    )  # fmt: skip
    graph = build_graph(mesh, primitives)
    assert part_kind(graph, np.array([False, True, True]), "hinge") == "door"
    assert part_kind(graph, np.array([False, False, True]), "hinge") == "lever"


def test_a_door_that_stands_ajar_is_a_door() -> None:
    mesh, primitives = boxes(((0.0, 0, 0), (2.0, 0.5, 2.0)), ((0.0, 0.6, 0), (0.9, 0.65, 2.0)))
    leaf = np.unique(mesh.faces[primitives.labels == 1])
    turn, vertices = np.radians(40), mesh.vertices.copy()
    vertices[leaf, :2] = vertices[leaf, :2] @ np.array(
        [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
    )
    graph = build_graph(replace(mesh, vertices=vertices), primitives)
    assert part_kind(graph, np.array([False, True]), "hinge") == "door"


def test_small_parts_have_to_be_clear_and_levers_on_a_panel_are_named() -> None:
    mesh, primitives = boxes(
        ((0.0, 0, 0), (0.5, 0.9, 2.0)), ((-0.04, 0, 0), (-0.002, 0.9, 2.0)),
        ((-0.06, 0.75, 1.0), (-0.04, 0.85, 1.02)),
    )  # fmt: skip
    graph = build_graph(mesh, primitives)
    base = PartNode("base", "body", (0,), -1, "fixed")
    door = PartNode("a", "part", (1,), 0, "hinge")
    on_door, on_body = (PartNode("b", "part", (2,), parent, "hinge") for parent in (1, 0))
    on_panel, on_base = KinematicTree((base, door, on_door)), KinematicTree((base, door, on_body))
    assert [n.name for n in named(graph, on_panel).nodes] == ["base", "door_0", "lever_0"]
    assert clear_from(graph, on_panel) == {2: FITTINGS.minor_above}
    assert not graph.is_fused and clear_from(graph, on_base) == {2: FITTINGS.minor_above}
    assert clear_from(graph, on_base, ALL_RULES.without("minor")) == {}
    fused = replace(graph, merges=np.array([[0, 1], [2, 3]]))  # there right ones are as unclear
    assert fused.is_fused and clear_from(fused, on_base) == {}
    assert clear_from(graph, KinematicTree((base, on_body))) == {}  # the largest there is


@pytest.mark.parametrize(
    ("weight", "subtype"),
    [(joint_view.MOTION.authored, "slide"), (joint_view.MOTION.fused, "hinge")],
)
def test_the_ranker_counts_less_on_a_fused_mesh(weight: float, subtype: JointSubtype) -> None:
    own = {"hinge": 0.88, "spin": 0.01, "slide": 0.11}
    node = PartNode("a", "part", (1,), 0, "hinge", confidence=0.8)
    odds = {"slide": 0.93, "revolute": 0.07}
    found = joint_view._typed(node, own, odds, (), weight)
    assert found.subtype == subtype and 0.4 < found.confidence < 0.8


def test_the_pieces_of_a_link_become_one_solid() -> None:
    made = make_object("cabinet_two_door", 3, Style())
    before, after = made.truth(), united(made, (0,)).truth()
    assert [j.child for j in after.joints] == [j.child for j in before.joints]
    shells = [
        len(trimesh.Trimesh(t.mesh.vertices, t.mesh.faces[t.face_link == 0]).split())
        for t in (before, after)
    ]
    assert shells[1] < shells[0]
    low, high = (np.sort(t.mesh.vertices, axis=0)[[0, -1]] for t in (before, after))
    np.testing.assert_allclose(low, high, atol=1e-6)
    doors = [t.mesh.vertices[t.mesh.faces[t.face_link > 0]] for t in (before, after)]
    assert len(doors[0]) == len(doors[1])


@pytest.mark.parametrize("kind", abstract_kinds())
def test_abstract_objects_have_truth(kind: str) -> None:
    item = example(kind, 3)
    assert item.overlap.shape == (item.graph.count, len(item.subtype))
    assert item.purity.mean() > 0.9


def test_clutter_adds_nothing_that_moves() -> None:
    for seed in range(12):
        made = generated("abstract_clutter", seed, solids=False)
        moving = {j.child for j in made.articulation.joints}
        assert moving == set(range(1, len(made.articulation.links)))
