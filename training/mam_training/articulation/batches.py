"""Items as batches: normalised, turned and mirrored, with what is known left out at random."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from mam_training.articulation.answers import MOST_COUNTED, normalised
from mam_training.articulation.items import Item


@dataclass(frozen=True)
class Draw:
    """How an item is changed each time it is seen, and how often what is known is told.

    Attributes:
        object_word, part_words, count: chances that these are told. named: share of the parts whose
            words are told. lies: share of the objects whose words go to the wrong parts.
        blind: chance that the columns of the kinematic prior are left out. left_out: of any column.
    """

    object_word: float = 0.4
    part_words: float = 0.25
    count: float = 0.15
    named: float = 0.85
    lies: float = 0.1
    blind: float = 0.1
    left_out: float = 0.12
    noise: float = 0.05
    area: float = 0.5


DRAW = Draw()
NOTHING = Draw(0.0, 0.0, 0.0, blind=0.0, left_out=0.0, noise=0.0)
WORD = Draw(1.0, 0.0, 0.0, blind=0.0, left_out=0.0, noise=0.0)
COUNT = Draw(1.0, 0.0, 1.0, blind=0.0, left_out=0.0, noise=0.0)
NAMED = Draw(0.0, 1.0, 0.0, named=1.0, lies=0.0, blind=0.0, left_out=0.0, noise=0.0)


@dataclass
class Batch:
    """Padded items and their truth."""

    unary: Tensor
    geometry: Tensor
    pair: Tensor
    hidden: Tensor
    object_word: Tensor
    part_word: Tensor
    count: Tensor
    fused: Tensor
    link: Tensor
    moves: Tensor
    weight: Tensor
    subtype: Tensor
    axis: Tensor
    origin: Tensor
    items: tuple[Item, ...]

    @property
    def inputs(self) -> tuple[Tensor, ...]:
        """What the network sees."""
        return (self.unary, self.geometry, self.pair, self.hidden, self.object_word,
                self.part_word, self.count, self.fused)  # fmt: skip


def spread(rows: NDArray) -> NDArray:
    """(2, F) median and scale of columns (n, F)."""
    low, high = np.nanpercentile(rows, 10, axis=0), np.nanpercentile(rows, 90, axis=0)
    wide = high - low
    wide = np.where(wide < 1e-6, 2.5 * np.nanstd(rows, axis=0) + 1e-6, wide)
    return np.stack([np.nanmedian(rows, axis=0), wide / 1.5]).astype(np.float32)


def scaled(item: Item, scales: Sequence[NDArray]) -> Item:
    """The item with normalised features.

    Args:
        scales: of primitives and of pairs.
    """
    return replace(
        item, unary=normalised(item.unary, scales[0]).astype(np.float16),
        pair=normalised(item.pair, scales[1]).astype(np.float16),
    )  # fmt: skip


def symmetry(rng: np.random.Generator) -> NDArray:
    """(3, 3) one of the eight quarter turns and mirrors about the upright."""
    c, s = [(1, 0), (0, 1), (-1, 0), (0, -1)][int(rng.integers(4))]
    m = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]], dtype=np.float32)
    if rng.random() < 0.5:
        m = m @ np.diag([-1.0, 1.0, 1.0]).astype(np.float32)
    return m


def batch_of(
    items: Sequence[Item], rng: np.random.Generator, draw: Draw, prior: Sequence[NDArray],
    turn: bool = True,
) -> Batch:  # fmt: skip
    """One padded batch of items that are `scaled`.

    Args:
        prior: columns of primitives and of pairs that come from the kinematic prior.
    """
    n = max(len(i.area) for i in items)
    b, u, g = len(items), items[0].unary.shape[1], items[0].pair.shape[1]
    unary, geometry = np.zeros((b, n, u), np.float32), np.zeros((b, n, 21), np.float32)
    pair = np.zeros((b, n, n, g + 1), np.float32)
    hidden, moves = np.ones((b, n), bool), np.zeros((b, n), np.float32)
    word, count = np.zeros(b, np.int64), np.zeros(b, np.int64)
    part, link = np.zeros((b, n), np.int64), np.full((b, n), -1)
    weight, subtype = np.zeros((b, n), np.float32), np.full((b, n), -1)
    axis, origin = np.zeros((b, n, 3), np.float32), np.zeros((b, n, 3), np.float32)
    for k, item in enumerate(items):
        p = len(item.area)
        m = symmetry(rng) if turn else np.eye(3, dtype=np.float32)
        middle = (item.low.min(0) + item.high.max(0)) / 2
        middle = np.array([middle[0], middle[1], 0.0], np.float32)
        corners = np.stack([(item.low - middle) @ m.T, (item.high - middle) @ m.T])
        blind = rng.random() < draw.blind
        x, y = item.unary.astype(np.float32), item.pair.astype(np.float32)
        if blind:
            x[:, prior[0]], y[:, prior[1]] = 0.0, 0.0
        if draw.left_out:
            x[:, rng.random(u) < draw.left_out] = 0.0
            y[:, rng.random(g) < draw.left_out] = 0.0
        if draw.noise:
            x += draw.noise * rng.standard_normal(x.shape, dtype=np.float32)
            y += draw.noise * rng.standard_normal(y.shape, dtype=np.float32)
        unary[k, :p] = x
        geometry[k, :p] = np.concatenate([
            corners.min(0), corners.max(0), item.size, item.spin @ m.T,
            (item.axes @ m.T).reshape(p, 9),
        ], 1)  # fmt: skip
        i, j = item.ends[:, 0].astype(int), item.ends[:, 1].astype(int)
        pair[k, i, j, :g], pair[k, j, i, :g] = y, y
        pair[k, i, j, g], pair[k, j, i, g] = 1.0, 1.0
        hidden[k, :p] = False
        owner = item.link.astype(int)
        link[k, :p] = owner
        sort = item.subtype.astype(int)[owner]
        moves[k, :p], subtype[k, :p] = sort >= 0, sort
        share = item.area / max(float(item.area.max()), 1e-9)
        weight[k, :p] = item.purity * (share**draw.area + 0.1)
        weight[k, :p] /= weight[k, :p].mean()
        axis[k, :p] = np.nan_to_num(item.axis[owner] @ m.T)
        origin[k, :p] = np.nan_to_num((item.origin[owner] - middle) @ m.T)
        if rng.random() < draw.object_word:
            word[k] = item.word
        if rng.random() < draw.part_words and item.kind.any():
            told = np.where(rng.random(len(item.kind)) < draw.named, item.kind.astype(int), 0)
            if rng.random() < draw.lies:
                told = rng.permutation(told)
            part[k, :p] = told[owner]
        if rng.random() < draw.count:
            movable = len(np.intersect1d(np.flatnonzero(item.subtype >= 0), owner))
            count[k] = 1 + min(movable, MOST_COUNTED)
    t = torch.from_numpy
    return Batch(
        t(unary), t(geometry), t(pair), t(hidden), t(word), t(part), t(count),
        torch.tensor([int(i.fused) for i in items]), t(link), t(moves), t(weight), t(subtype),
        t(axis), t(origin), tuple(items),
    )  # fmt: skip


def batches(items: Sequence[Item], rng: np.random.Generator, tokens: int) -> Iterator[list[int]]:
    """Indices of items of about equal size, at most `tokens` squared pairs together."""
    order = rng.permutation(len(items))
    sizes = np.array([len(items[k].area) for k in order])
    out: list[list[int]] = []
    for start in range(0, len(order), 2048):
        block = order[start : start + 2048]
        block = block[np.argsort(sizes[start : start + 2048], kind="stable")]
        now: list[int] = []
        for k in block:
            most = len(items[k].area)
            if now and ((len(now) + 1) * most * most > tokens or len(now) >= 48):
                out.append(now)
                now = []
            now.append(int(k))
        if now:
            out.append(now)
    for k in rng.permutation(len(out)):
        yield out[k]
