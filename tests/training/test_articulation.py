"""The network of parts: its groups and values in closed form, its items, and a short training."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from mam_training.articulation.answers import Answers, merge_tree
from mam_training.articulation.batches import DRAW, NAMED, NOTHING, batch_of
from mam_training.articulation.evaluate import best_groups, score
from mam_training.articulation.fit import Lesson, fit, prior_columns
from mam_training.articulation.items import (
    Item,
    generated_item,
    pack,
    part_words,
    unpack,
    with_word,
)
from mam_training.articulation.publish import publish, published

SURE = 12.0


def _answers() -> Answers:
    """Four primitives: 0 stands still, 1 and 2 move as one body, 3 moves by itself."""
    link = np.array([0, 1, 1, 2])
    same = np.where(link[:, None] == link[None], SURE, -SURE)
    motion = np.zeros((4, 12))
    motion[1:3, 2] = SURE  # slides along x
    motion[1:3, 3:6] = [[2.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]
    motion[3, 0] = SURE  # turns about z, at (0.5, 0, 0) from its centre
    motion[3, 3:9] = [0.0, 0.0, 1.0, 0.5, 0.0, 0.0]
    return Answers(np.where(link > 0, SURE, -SURE), same, motion, np.array([0.4, 0.3, 0.1, 0.2]))


def test_groups_are_what_moves_together_and_all_on_the_way_there() -> None:
    groups = {tuple(np.flatnonzero(m)) for m in _answers().groups()}
    assert groups == {(1,), (2,), (3,), (1, 2)}


def test_agglomeration_joins_the_strongest_first_by_weighted_means() -> None:
    same = np.array([[0.0, 3.0, 1.0], [3.0, 0.0, -2.0], [1.0, -2.0, 0.0]])
    assert merge_tree(same, np.ones(3))[3:] == [[0, 1], [0, 1, 2]]  # mean of 1 and -2 is above -6
    assert merge_tree(np.full((2, 2), -7.0), np.ones(2)) == [[0], [1]]


def test_the_value_of_a_group_is_its_expected_overlap() -> None:
    masks = np.array([[0, 1, 1, 0], [0, 1, 0, 0], [0, 0, 0, 1], [1, 0, 0, 0], [0, 1, 1, 1]], bool)
    value = _answers().value(masks)
    assert value[0] == pytest.approx(1.0, abs=1e-3)
    assert value[1] == pytest.approx(0.3 / 0.4, abs=1e-3)  # the smaller piece is left out
    assert value[2] == pytest.approx(1.0, abs=1e-3)
    assert value[3] == pytest.approx(0.0, abs=1e-3)  # what stands still is no part
    assert 0.3 < value[4] < 0.7  # two bodies as one


def test_the_best_groups_are_the_true_parts() -> None:
    found = {tuple(np.flatnonzero(m)) for m in best_groups(_answers(), bar=0.4)}
    assert found == {(1, 2), (3,)}


def test_axes_of_a_group_do_not_depend_on_their_signs() -> None:
    found, mask = _answers(), np.array([False, True, True, False])
    assert np.abs(found.axis(mask)) == pytest.approx([1.0, 0.0, 0.0])
    assert found.odds(mask[None])[0].argmax() == 2


@pytest.fixture(scope="module")
def items() -> list[Item]:
    some = [generated_item("cabinet_two_door", seed, False, False, False) for seed in range(6)]
    return [with_word(item) for item in some]


def test_an_item_holds_the_truth_of_its_object(items: list[Item], tmp_path: Path) -> None:
    item = items[4]
    assert item.word > 0 and part_words()[item.kind[item.subtype >= 0][0]] == "door"
    hinges = item.axis[item.subtype == 0]
    assert len(hinges) and np.abs(hinges[:, 2]) == pytest.approx(1.0, abs=1e-6)
    pack(items, tmp_path / "items.pack")
    again = unpack(tmp_path / "items.pack")[4]
    assert again.name == item.name and np.allclose(again.overlap, item.overlap, atol=1e-6)


def test_the_true_parts_score_one(items: list[Item]) -> None:
    item = items[4]
    movable = np.flatnonzero(item.subtype >= 0)
    masks = [item.link == k for k in movable]
    motion = np.zeros((len(item.area), 12))
    for k, mask in zip(movable, masks):
        motion[mask, item.subtype[k]], motion[mask, 3:6] = SURE, item.axis[k]
    count = len(item.area)
    answers = Answers(np.zeros(count), np.zeros((count, count)), motion, item.area)
    found = score(item, masks, answers)
    assert found["miou"] == pytest.approx(item_bound(item)) and found["count"] == 1.0
    assert found["type"] == 0.0 and found["axis"] == pytest.approx(0.0, abs=1e-5)


def item_bound(item: Item) -> float:
    """Mean IoU of the movable links when each has the primitives that are mostly its own."""
    out = []
    for k in np.flatnonzero(item.subtype >= 0):
        inside = item.overlap[item.link == k].sum(axis=0)
        union = item.overlap[item.link == k].sum() + item.overlap[:, k].sum() - inside[k]
        out.append(inside[k] / union)
    return float(np.mean(out))


@pytest.mark.slow
def test_a_short_training_learns_and_its_files_give_the_same_answers(
    items: list[Item], tmp_path: Path
) -> None:
    before = fit(items, Lesson(0.1), DRAW)
    after = fit(items * 8, Lesson(60.0, warm=10), DRAW)
    batch = batch_of(
        [_ready(i, after.scales) for i in items], np.random.default_rng(0), NOTHING,
        prior_columns(), turn=False,
    )  # fmt: skip
    there = ~batch.hidden
    loss = torch.nn.functional.binary_cross_entropy_with_logits
    with torch.no_grad():
        old = float(loss(before.net(*batch.inputs)[0][there], batch.moves[there]))
        new = float(loss(after.net(*batch.inputs)[0][there], batch.moves[there]))
    assert new < 0.7 * old
    publish(after, tmp_path)
    again = published(tmp_path)
    named = batch_of(
        [_ready(i, after.scales) for i in items], np.random.default_rng(0), NAMED,
        prior_columns(), turn=False,
    )  # fmt: skip
    with torch.no_grad():
        for x, y in zip(after.net(*named.inputs), again(*named.inputs)):
            assert torch.allclose(x, y, atol=0.05)  # weights are kept in half precision


def _ready(item: Item, scales: object) -> Item:
    from mam_training.articulation.batches import scaled

    return scaled(item, scales)  # type: ignore[arg-type]
