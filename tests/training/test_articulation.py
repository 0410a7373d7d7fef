"""The network of mobility: items, batches, a short training, and the form the engine reads."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from mam_pipeline.parts.mobility_network import read_mobility
from mam_training.articulation.batches import DRAW, NAMED, NOTHING, Draw, batch_of, batches
from mam_training.articulation.corpus import Corpus, corpus_of, spread
from mam_training.articulation.fit import Lesson, fit
from mam_training.articulation.items import (
    Item,
    columns,
    generated_item,
    object_words,
    pack,
    part_words,
    unpack,
    with_word,
)
from mam_training.articulation.model import Shape
from mam_training.articulation.publish import publish
from mam_training.articulation.train import right, said_of

PRIOR = ([0], [0])


@pytest.fixture(scope="module")
def items() -> list[Item]:
    some = [generated_item("cabinet_two_door", seed, False, False, False) for seed in range(6)]
    return [with_word(item) for item in some]


@pytest.fixture(scope="module")
def scales(items: list[Item]) -> list[np.ndarray]:
    return [
        spread(np.concatenate([i.unary for i in items])),
        spread(np.concatenate([i.pair for i in items]).astype(np.float32)),
    ]


@pytest.fixture(scope="module")
def corpus(items: list[Item], scales: list[np.ndarray]) -> Corpus:
    return corpus_of(items, scales, [8, 8, 8, 8, 8, 0], [0] * 6)


def test_an_item_holds_the_truth_of_its_object(items: list[Item], tmp_path: Path) -> None:
    item = items[4]
    assert item.word > 0 and part_words()[item.kind[item.subtype >= 0][0]] == "door"
    hinges = item.axis[item.subtype == 0]
    assert len(hinges) and np.abs(hinges[:, 2]) == pytest.approx(1.0, abs=1e-6)
    pack(items, tmp_path / "items.pack")
    again = unpack(tmp_path / "items.pack")[4]
    assert again.name == item.name and np.allclose(again.overlap, item.overlap, atol=1e-6)


def test_a_corpus_is_the_same_after_it_was_written(corpus: Corpus, tmp_path: Path) -> None:
    corpus.save(tmp_path / "c.safetensors", {"sources": ["world"]})
    again, about = Corpus.load(tmp_path / "c.safetensors")
    assert about == {"sources": ["world"]}
    assert all(torch.equal(getattr(again, k), v) for k, v in vars(corpus).items())
    assert corpus.without(0).times.sum() == 0


def test_a_batch_holds_each_object_and_its_truth(corpus: Corpus, items: list[Item]) -> None:
    rows = [2, 4]
    batch = batch_of(corpus, rows, np.random.default_rng(0), NOTHING, PRIOR, turn=False)
    assert (~batch.hidden).sum(1).tolist() == [len(items[k].area) for k in rows]
    for place, k in enumerate(rows):
        item, count = items[k], len(items[k].area)
        assert batch.moves[place, :count].bool().tolist() == (
            (item.subtype[item.link] >= 0).tolist()
        )
        i, j = item.ends[0]
        assert torch.equal(batch.pair[place, i, j], batch.pair[place, j, i])
        assert batch.pair[place, i, j, -1] == 1
        assert batch.pair[place, :, count:].abs().sum() == 0
        size = batch.geometry[place, :count, 3:6] - batch.geometry[place, :count, 0:3]
        assert np.allclose(size, item.high - item.low, atol=2e-3)
    assert batch.object_word.tolist() == [0, 0] and batch.part_word.sum() == 0


def test_what_is_told_is_the_truth_unless_it_lies(corpus: Corpus, items: list[Item]) -> None:
    batch = batch_of(corpus, [4], np.random.default_rng(0), NAMED, PRIOR, turn=False)
    assert batch.part_word[0].tolist() == items[4].kind[items[4].link].tolist()
    lying = Draw(0.0, 1.0, 0.0, 1.0, lies=1.0, missing=0.0)
    seen = set()
    for seed in range(8):
        batch = batch_of(corpus, [4], np.random.default_rng(seed), lying, PRIOR, turn=False)
        seen.add(tuple(batch.part_word[0].tolist()))
    assert len(seen) > 1


def test_turning_keeps_what_does_not_depend_on_the_yaw(corpus: Corpus) -> None:
    for seed in range(4):
        same = batch_of(corpus, [4], np.random.default_rng(0), NOTHING, PRIOR, turn=False)
        other = batch_of(corpus, [4], np.random.default_rng(seed), NOTHING, PRIOR)
        for batch in (same, other):
            assert (batch.geometry[..., 0:3] <= batch.geometry[..., 3:6] + 1e-6).all()
        heights = same.geometry[..., [2, 5]], other.geometry[..., [2, 5]]
        assert torch.allclose(*heights) and torch.equal(same.unary, other.unary)


def test_batches_hold_every_object_once() -> None:
    sizes = np.array([3, 50, 4, 60, 5, 200])
    rows = list(batches(sizes, np.arange(6), np.random.default_rng(0), pairs=8000, most=3))
    assert sorted(np.concatenate(rows).tolist()) == list(range(6))
    assert all(len(r) == 1 or len(r) * max(sizes[r]) ** 2 <= 8000 for r in rows)


@pytest.mark.slow
def test_a_short_training_learns_and_the_engine_reads_the_same_answers(
    corpus: Corpus, scales: list[np.ndarray], tmp_path: Path
) -> None:
    primitive, pair = columns()
    shape = Shape(len(primitive), len(pair), len(object_words()), len(part_words()))
    nets = [fit(corpus, shape, PRIOR, lesson, 0, DRAW)
            for lesson in (Lesson(0.1), Lesson(60.0, warm=10))]  # fmt: skip
    batch = batch_of(corpus, range(6), np.random.default_rng(0), NOTHING, PRIOR, turn=False)
    there = ~batch.hidden
    loss = torch.nn.functional.binary_cross_entropy_with_logits
    with torch.no_grad():
        old, new = (float(loss(n(*batch.inputs)[0][there], batch.moves[there])) for n in nets)
    assert new < 0.7 * old
    about = {"columns": [primitive, pair], "scales": scales}
    publish(nets[1].state_dict(), about, tmp_path / "network.npz")
    again = read_mobility(tmp_path / "network.npz")
    for k in range(6):
        found = said_of(again, corpus, k)
        with torch.no_grad():
            one = batch_of(corpus, [k], np.random.default_rng(0), NOTHING, PRIOR, turn=False)
            said = torch.sigmoid(nets[1](*one.inputs)[0])[0].numpy()
        assert np.allclose(found, said, atol=0.03)  # weights are kept in half precision
    assert right(again, corpus, range(6)) > 0.7
