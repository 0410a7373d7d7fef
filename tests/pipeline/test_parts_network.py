"""The graph network: what runs here with NumPy is what was trained with torch."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from mam_pipeline.parts.features import Table, pair_features, primitive_features
from mam_pipeline.parts.group_features import measured
from mam_pipeline.parts.groups import enumerate_groups
from mam_pipeline.parts.network import Network, Reading, normalised, read, together
from mam_pipeline.parts.scores import load_scores
from mam_training.parts.corpus import (
    Example,
    generated_example,
    load_example,
    object_name,
    save_example,
)
from mam_training.parts.recipe import FOLDS, fold_of, jobs
from mam_training.parts.train import apart
from mam_training.parts.train_network import (
    GROUPS,
    Lesson,
    Net,
    batch_of,
    fit,
    grown,
    item_of,
    spread,
    train,
    weights_of,
)


@lru_cache(maxsize=2)
def seen(kind: str = "abstract_board", seed: int = 4) -> tuple[Example, Table, Table]:
    example = generated_example(kind, seed)
    unary = primitive_features(example.graph, example.prior())
    return example, unary, pair_features(example.graph, unary, example.prior())


def untrained() -> tuple[Net, dict[str, np.ndarray]]:
    _, unary, pairs = seen()
    torch.manual_seed(1)
    net = Net(len(unary.names), len(pairs.names)).eval()
    scales = [spread(unary.values), spread(pairs.values)]
    return net, weights_of(net, scales, (unary.names, pairs.names))


def test_numpy_gives_what_torch_gives(tmp_path: Path) -> None:
    net, weights = untrained()
    path = tmp_path / "abstract_board_000004.ex"
    save_example(seen()[0], path)
    example = load_example(path)
    unary = primitive_features(example.graph, example.prior())
    pairs = pair_features(example.graph, unary, example.prior())
    found = item_of(path)
    assert found is not None
    item = found[0]
    item.masks, item.overlap, item.kind = (
        a[:GROUPS] for a in (item.masks, item.overlap, item.kind)
    )
    item.unary = normalised(item.unary, weights["primitive_scale"])
    item.pair = normalised(item.pair, weights["pair_scale"])

    class Never(np.random.Generator):
        """Leaves no column out."""

        def random(self, *_: object, **__: object) -> float:  # type: ignore[override]
            return 1.0

    batch = batch_of([item], Never(np.random.PCG64(0)), [np.zeros(0, int)] * 2)
    state = net.state_dict()
    net.load_state_dict({k: v.half().float() for k, v in state.items()})  # as they are kept
    with torch.no_grad():
        same, move, groups = net(batch)
    network = Network(weights)
    encoded = network.encode(example.graph, unary, pairs)
    assert encoded.same == pytest.approx(torch.sigmoid(same).numpy(), abs=2e-4)
    assert encoded.move == pytest.approx(torch.sigmoid(move).numpy(), abs=2e-4)
    value, odds = network.judge(example.graph, encoded, item.masks)
    assert value == pytest.approx(torch.sigmoid(groups[:, 0]).numpy(), abs=5e-4)
    assert odds == pytest.approx(torch.softmax(groups[:, 1:], dim=1).numpy(), abs=5e-4)


def test_training_learns_what_moves(tmp_path: Path) -> None:
    items: list[Any] = []
    names: tuple[tuple[str, ...], tuple[str, ...]] = ((), ())
    for seed in range(14):
        example = generated_example("abstract_leaf", seed)
        if example.graph.is_fused:  # the other weights' business
            continue
        path = tmp_path / f"abstract_leaf_{seed:06d}.ex"
        save_example(example, path)
        found = item_of(path)
        if found is not None:
            items.append(found[0])
            names = found[1:]
    scales = [spread(np.concatenate([getattr(i, n) for i in items])) for n in ("unary", "pair")]
    for item in items:
        item.unary = normalised(item.unary, scales[0])
        item.pair = normalised(item.pair, scales[1])
    network = Network(weights_of(fit(items, names, Lesson(100, 0.2, 0.12)), scales, names))
    right = []
    for seed in range(14):
        example = generated_example("abstract_leaf", seed)
        unary = primitive_features(example.graph, example.prior())
        pairs = pair_features(example.graph, unary, example.prior())
        move = network.encode(example.graph, unary, pairs).move
        right += list((move > 0.5) == (example.subtype[example.link] >= 0))
    assert np.mean(right) > 0.8


def test_other_features_are_refused_and_views_join_the_groups() -> None:
    example, unary, pairs = seen()
    network = Network(untrained()[1])
    other = Table((*unary.names[:-1], "something"), unary.values)
    with pytest.raises(ValueError, match="train again"):
        network.encode(example.graph, other, pairs)
    half = np.full(len(example.graph.pairs), 0.5), np.full(example.graph.count, 0.5)
    reading = read([network], example.graph, unary, pairs, *half)
    masks = enumerate_groups(example.graph, reading.same, reading.move)
    groups = measured(example.graph, masks, reading, example.prior())
    assert {"net_value", "net_slide"} <= set(groups.names)
    bare = measured(example.graph, masks, Reading(*half), example.prior())
    assert "net_value" not in bare.names


def test_two_opinions_meet_in_the_middle() -> None:
    a = together(np.array([0.9, 0.5, 0.2]), np.array([0.1, 0.9, 0.2]))
    assert a == pytest.approx([0.5, 0.75, 0.2])
    assert together(np.zeros(1), np.ones(1)) == pytest.approx([0.5])


def test_the_shipped_scores_read_with_networks() -> None:
    example, unary, pairs = seen()
    reading = load_scores().read(example.graph, unary, pairs)
    assert len(reading.views) == 3
    assert reading.same.shape == (len(example.graph.pairs),)
    assert ((reading.move > 0) & (reading.move < 1)).all()


def test_all_of_a_kind_is_in_one_fold_but_for_fused_ones() -> None:
    folds: dict[tuple[str, bool], set[int]] = {}
    for kind, seed, fused in jobs("train", 300, 300, 1200):
        fold = fold_of(object_name(kind, seed, fused))
        folds.setdefault((kind, fused), set()).add(fold)
    assert all(len(found) == 1 for (_, fused), found in folds.items() if not fused)
    assert set.union(*folds.values()) == set(range(FOLDS))
    assert folds["abstract_case", True] == set(range(FOLDS))
    loose = object_name("abstract_case", 7, False, loose=True)
    assert {fold_of(loose)} == folds["abstract_case", False]


def test_tuning_goes_on_from_given_weights(tmp_path: Path) -> None:
    paths = []
    for seed in range(28):
        example = generated_example("abstract_leaf", seed)
        if not example.graph.is_fused:
            paths.append(tmp_path / f"abstract_leaf_{seed:06d}.ex")
            save_example(example, paths[-1])
    start = untrained()[1]
    tuned = train(paths, Lesson(2), start=start, guides=[start] * FOLDS)
    assert set(tuned) == set(start)
    for name in ("primitive_scale", "pair_scale", "primitive_names"):
        assert np.array_equal(tuned[name], start[name])
    moved = np.abs(tuned["move.0.weight"].astype(float) - start["move.0.weight"]).max()
    assert 0 < moved < 0.1  # two short epochs move it a little: it did not begin anew


def test_columns_that_are_new_to_given_weights_have_no_effect_at_first() -> None:
    example, unary, pairs = seen()
    start = untrained()[1]
    wider = [
        Table(("new", *t.names), np.concatenate([np.full((len(t.values), 1), 3), t.values], axis=1))
        for t in (unary, pairs)
    ]
    names = [t.names for t in wider]
    weights = {
        **grown(start, names, [spread(t.values) for t in wider]),
        "primitive_names": np.array(names[0]), "pair_names": np.array(names[1]),
    }  # fmt: skip
    before = Network(start).encode(example.graph, unary, pairs)
    after = Network(weights).encode(example.graph, *wider)
    assert after.move == pytest.approx(before.move, abs=1e-5)
    assert after.same == pytest.approx(before.same, abs=1e-5)
    fewer = Network(start).encode(example.graph, *wider)  # it takes its own columns by name
    assert fewer.move == pytest.approx(before.move, abs=1e-5)


def test_examples_that_meet_the_other_weights_are_left_out(tmp_path: Path) -> None:
    example = seen()[0]
    count = example.graph.count
    one = replace(example, graph=replace(example.graph, merges=np.zeros((count, 2), np.int64)))
    made = {"a_000001": example, "b_000001": one, "c_200001_f": example, "d_200001_f": one}
    for name, each in made.items():
        save_example(each, tmp_path / f"{name}.ex")
    plain, fused = apart(sorted(tmp_path.glob("*.ex")))
    assert [p.stem for p in plain] == ["a_000001"] and [p.stem for p in fused] == ["d_200001_f"]
