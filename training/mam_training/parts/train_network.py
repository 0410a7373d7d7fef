"""Trains the graph networks of the reasoner; `reason.train` calls it.

For each fold of the cross-fitting of `reason.train` one on the other folds, which the trees learn
to read, and some on examples of all kinds, which are asked in use. Four losses: pairs in one body,
primitives that move, overlap of sampled groups with a true part, and the type of good groups.
Columns of features are left out at random, the kinematic prior among them, so that none is leant
on alone.
"""

from __future__ import annotations

import sys
import time
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from mam_pipeline.parts.features import pair_features, primitive_features
from mam_pipeline.parts.groups import Masks, enumerate_groups
from mam_pipeline.parts.network import Network, normalised
from mam_training.parts.corpus import load_example
from mam_training.parts.first_guess import may_move, same_part
from mam_training.parts.recipe import fold_of

WIDTH, LAYERS = 64, 3
WITHOUT_PRIOR = 0.2
BATCH, GROUPS, LARGEST = 12, 40, 90  # objects in a step, groups of each, primitives at most
RATE, DECAY = 2e-3, 0.05
TUNING_RATE = 1.2e-3
PRIOR = ("mobility", "affinity")  # columns whose names hold these come from the kinematic prior


@dataclass(frozen=True)
class Lesson:
    """How long a network is trained, and how much is kept from it: states, columns of features."""

    epochs: int
    dropout: float = 0.35
    left_out: float = 0.3


# the first for networks whose views of kinds they never saw the trees learn to read: longer lessons
# make them too sure of such kinds; the second for those that know all kinds and are asked in use
WARY, LONG = Lesson(5), Lesson(12, 0.2, 0.12)
TUNING = Lesson(15, 0.2, 0.12)  # goes on, on fused examples


@dataclass
class Item:
    """One example as arrays: features, graph, truth, groups with their overlap and type.

    Attributes:
        unary: (P, F). pair: (E, G). ends: (E, 2). area: (P,). masks: (C, P). same: (E,), moves:
            (P,) truth with weights `trust` (P,). overlap: (C,), kind: (C,) type or -1.
    """

    unary: NDArray
    pair: NDArray
    ends: NDArray
    area: NDArray
    masks: Masks
    same: NDArray
    moves: NDArray
    trust: NDArray
    overlap: NDArray
    kind: NDArray


def item_of(
    path: Path, guide: Network | None = None
) -> tuple[Item, tuple[str, ...], tuple[str, ...]] | None:
    """An example's arrays and the names of its features; None if it is too large or too small.

    Args:
        guide: a network that never saw the example, after which groups are drawn up; else rules.
    """
    example = load_example(path)
    graph, link = example.graph, example.link
    if not 2 <= graph.count <= LARGEST:
        return None
    prior = example.prior()
    unary = primitive_features(graph, prior)
    pairs = pair_features(graph, unary, prior)
    if guide:
        guess = guide.encode(graph, unary, pairs)
        same, move = guess.same, guess.move
    else:
        same, move = same_part(pairs), may_move(unary)
    masks = enumerate_groups(graph, same, move)
    if len(masks) == 0:
        return None
    table = example.part_overlap(masks)
    overlap = table.max(axis=1, initial=0.0)
    rng = np.random.default_rng(zlib.crc32(path.stem.encode()))
    keep = np.sort(np.concatenate([_some(overlap > 0.3, rng), _some(overlap <= 0.3, rng)]))
    kind = np.where(overlap > 0.6, example.subtype[table.argmax(axis=1)], -1)
    ends = graph.pairs
    item = Item(
        unary.values, pairs.values, ends, graph.area, masks[keep],
        (link[ends[:, 0]] == link[ends[:, 1]]).astype(np.float32),
        (example.subtype[link] >= 0).astype(np.float32), example.purity, overlap[keep], kind[keep],
    )  # fmt: skip
    return item, unary.names, pairs.names


def _some(wanted: NDArray, rng: np.random.Generator) -> NDArray:
    found = np.flatnonzero(wanted)
    return found if len(found) <= GROUPS else rng.choice(found, GROUPS, replace=False)


def spread(rows: NDArray) -> NDArray:
    """(2, F) median and scale of feature columns (n, F), for `network.normalised`."""
    low, high = np.nanpercentile(rows, 10, axis=0), np.nanpercentile(rows, 90, axis=0)
    wide = high - low
    wide = np.where(wide < 1e-6, 2.5 * np.nanstd(rows, axis=0) + 1e-6, wide)
    return np.stack([np.nanmedian(rows, axis=0), wide / 1.5]).astype(np.float32)


def _mlp(inside: int, outside: int, between: int) -> nn.Sequential:
    return nn.Sequential(nn.Linear(inside, between), nn.GELU(), nn.Linear(between, outside))


class Net(nn.Module):
    """The network of `reason.network`, for training; the names of its weights are the same."""

    def __init__(self, unary: int, pair: int, dropout: float = 0.0) -> None:
        super().__init__()
        d = WIDTH
        self.inu, self.inq = _mlp(unary, d, d), _mlp(pair, d, d)
        self.edge = nn.ModuleList([_mlp(4 * d, d, d) for _ in range(LAYERS)])
        self.node = nn.ModuleList([_mlp(4 * d, d, d) for _ in range(LAYERS)])
        self.ln = nn.ModuleList([nn.LayerNorm(d) for _ in range(LAYERS)])
        self.le = nn.ModuleList([nn.LayerNorm(d) for _ in range(LAYERS)])
        self.same, self.move, self.gp = _mlp(3 * d, 1, d), _mlp(2 * d, 1, d), _mlp(2 * d, d, d)
        self.group, self.gout = _mlp(6 * d + 4, 2 * d, 2 * d), nn.Linear(2 * d, 4)
        self.drop = nn.Dropout(dropout)

    def forward(self, b: Batch) -> tuple[Tensor, Tensor, Tensor]:
        """Logits of pairs (E,), of primitives (P,), of groups (C, 4): overlap and three types."""
        h, e = self.inu(b.unary), self.inq(b.pair)
        i, j, d = b.ends[:, 0], b.ends[:, 1], h.shape[1]
        ends, starts = torch.cat([i, j]), torch.cat([j, i])
        for k in range(LAYERS):
            whole = _mean(h, b.owner, b.objects)
            wide = torch.cat([e, h[i] + h[j], (h[i] - h[j]).abs(), whole[b.owner[i]]], 1)
            e = self.le[k](e + self.drop(self.edge[k](wide)))
            both = torch.cat([e, e])
            mean = _mean(torch.sigmoid(both) * h[starts], ends, len(h))
            most = _most(both + h[starts], ends, len(h), -5.0)
            wide = torch.cat([h, mean, most, whole[b.owner]], 1)
            h = self.ln[k](h + self.drop(self.node[k](wide)))
        whole = _mean(h, b.owner, b.objects)
        same = self.same(torch.cat([e, h[i] + h[j], (h[i] - h[j]).abs()], 1))[:, 0]
        near = torch.cat([h, whole[b.owner]], 1)
        move = self.move(near)[:, 0]
        inner, cut, n = b.inner, b.cut, len(b.group_owner)
        g = self.gp(near)
        weight = b.weight[:, None]
        total = h.new_zeros(n, 1).index_add_(0, b.member[:, 1], weight).clamp(min=1e-6)
        mean = h.new_zeros(n, d).index_add_(0, b.member[:, 1], g[b.member[:, 0]] * weight) / total
        wide = torch.cat([
            mean, _most(g[b.member[:, 0]], b.member[:, 1], n, -9.0),
            _mean(e[inner[:, 0]], inner[:, 1], n), _mean(e[cut[:, 0]], cut[:, 1], n),
            _most(e[cut[:, 0]], cut[:, 1], n, -9.0), whole[b.group_owner],
            torch.log(_count(b.member[:, 1], n)), torch.log1p(_count(cut[:, 1], n)),
            _mean(functional.logsigmoid(same[inner[:, 0]])[:, None], inner[:, 1], n),
            _mean(functional.logsigmoid(-same[cut[:, 0]])[:, None], cut[:, 1], n),
        ], 1)  # fmt: skip
        return same, move, self.gout(functional.gelu(self.group(wide)))


def _count(index: Tensor, n: int) -> Tensor:
    ones = torch.ones(len(index), 1, device=index.device)
    return ones.new_zeros(n, 1).index_add_(0, index, ones)


def _mean(x: Tensor, index: Tensor, n: int) -> Tensor:
    total = x.new_zeros(n, x.shape[1]).index_add_(0, index, x)
    return total / _count(index, n).clamp(min=1)


def _most(x: Tensor, index: Tensor, n: int, least: float) -> Tensor:
    start = x.new_full((n, x.shape[1]), least)
    return start.scatter_reduce(0, index[:, None].expand_as(x), x, "amax")


@dataclass
class Batch:
    """Several items as one graph; index tables are (n, 2): what, and in which group."""

    unary: Tensor
    pair: Tensor
    ends: Tensor
    owner: Tensor
    objects: int
    member: Tensor
    weight: Tensor
    inner: Tensor
    cut: Tensor
    group_owner: Tensor
    truth: tuple[Tensor, ...]

    def to(self, device: str) -> Batch:
        """The same on a device."""
        own = {f.name: getattr(self, f.name) for f in fields(self)}
        moved: dict[str, Any] = {k: v.to(device) for k, v in own.items() if isinstance(v, Tensor)}
        return replace(self, **moved, truth=tuple(v.to(device) for v in self.truth))


def batch_of(items: Sequence[Item], rng: np.random.Generator, blind: Sequence[NDArray]) -> Batch:
    """Join items whose features are normalised.

    Args:
        blind: columns of `unary` and of `pair` that are zeroed as if there were no prior.
    """
    lists: dict[str, list[NDArray]] = {}
    at, edge, group = 0, 0, 0

    def add(**values: NDArray) -> None:
        for name, value in values.items():
            lists.setdefault(name, []).append(value)

    for k, item in enumerate(items):
        unary, pair = item.unary, item.pair
        if rng.random() < WITHOUT_PRIOR:
            unary, pair = unary.copy(), pair.copy()
            unary[:, blind[0]], pair[:, blind[1]] = 0.0, 0.0
        pick: NDArray = np.arange(len(item.masks))
        if len(pick) > GROUPS:
            pick = rng.choice(pick, GROUPS, replace=False)
        masks, count, edges = item.masks[pick], len(unary), max(len(item.ends), 1)
        c, p = np.nonzero(masks)
        a, z = masks[:, item.ends[:, 0]], masks[:, item.ends[:, 1]]
        add(
            unary=unary, pair=pair, ends=item.ends + at, owner=np.full(count, k),
            member=np.stack([p + at, c + group], 1), weight=np.sqrt(item.area[p]) + 1e-4,
            group_owner=np.full(len(pick), k), overlap=item.overlap[pick], kind=item.kind[pick],
            same=item.same, moves=item.moves, pure=item.trust * np.sqrt(20 / count),
            trust=item.trust[item.ends].min(axis=1) * np.sqrt(60 / edges),
        )  # fmt: skip
        for name, chosen in (("inner", a & z), ("cut", a ^ z)):
            c, q = np.nonzero(chosen)
            add(**{name: np.stack([q + edge, c + group], 1)})
        at, edge, group = at + count, edge + len(item.ends), group + len(pick)
    whole = {"ends", "owner", "member", "inner", "cut", "group_owner", "kind"}
    t = {
        n: torch.as_tensor(np.concatenate(v), dtype=torch.long if n in whole else torch.float32)
        for n, v in lists.items()
    }
    truth = tuple(t[n] for n in ("overlap", "kind", "same", "trust", "moves", "pure"))
    return Batch(
        t["unary"], t["pair"], t["ends"], t["owner"], len(items), t["member"], t["weight"],
        t["inner"], t["cut"], t["group_owner"], truth,
    )  # fmt: skip


def loss_of(answer: tuple[Tensor, Tensor, Tensor], truth: tuple[Tensor, ...]) -> Tensor:
    """The sum of the four losses."""
    same, move, groups = answer
    overlap, kind, pair_truth, trust, moves, pure = truth
    logistic = functional.binary_cross_entropy_with_logits
    out = (logistic(same, pair_truth, reduction="none") * trust).sum() / trust.sum().clamp(min=1e-6)
    out = out + (logistic(move, moves, reduction="none") * pure).sum() / pure.sum()
    out = out + 2 * logistic(groups[:, 0], overlap)
    known = kind >= 0
    if known.any():
        out = out + 0.5 * functional.cross_entropy(groups[known, 1:], kind[known])
    return out


def fit(
    items: list[Item], names: Sequence[Sequence[str]], lesson: Lesson, seed: int = 0,
    start: Mapping[str, NDArray] | None = None, device: str = "cpu",
) -> Net:  # fmt: skip
    """Train one network on normalised items, from the weights `start` on if there are any."""
    rng = np.random.default_rng(seed)
    torch.manual_seed(seed)
    net = Net(items[0].unary.shape[1], items[0].pair.shape[1], lesson.dropout)
    if start is not None:
        known = {k: torch.as_tensor(start[k].astype(np.float32)) for k in net.state_dict()}
        net.load_state_dict(known)
    net.to(device)
    fastest = RATE if start is None else TUNING_RATE
    blind = [np.flatnonzero([any(p in n for p in PRIOR) for n in columns]) for columns in names]
    optimiser = torch.optim.AdamW(net.parameters(), lr=RATE, weight_decay=DECAY)
    steps, done, started = lesson.epochs * (len(items) // BATCH), 0, time.time()
    for epoch in range(lesson.epochs):
        total = 0.0
        for rows in _batches(len(items), rng):
            warm = min(1.0, done / max(1, min(300, steps // 10)))
            rate = fastest * warm * (0.5 * (1 + np.cos(np.pi * done / steps)) + 0.01)
            for group in optimiser.param_groups:
                group["lr"] = rate
            batch = batch_of([items[k] for k in rows], rng, blind)
            for values in (batch.unary, batch.pair):
                values[:, torch.rand(values.shape[1]) < lesson.left_out] = 0.0
            batch = batch.to(device)
            loss = loss_of(net(batch), batch.truth)
            optimiser.zero_grad()
            loss.backward()
            nn.utils.clip_grad_norm_(net.parameters(), 1.0)
            optimiser.step()
            total, done = total + float(loss), done + 1
        print(f"epoch {epoch}: loss {total / max(len(items) // BATCH, 1):.3f}, "
              f"{time.time() - started:.0f} s", file=sys.stderr, flush=True)  # fmt: skip
    return net.cpu().eval()


def _batches(count: int, rng: np.random.Generator) -> Iterator[NDArray]:
    order = rng.permutation(count)
    for k in range(0, count - BATCH + 1, BATCH):
        yield order[k : k + BATCH]


def weights_of(
    net: Net, scales: Sequence[NDArray], names: Sequence[Sequence[str]]
) -> dict[str, NDArray]:
    """What `network.Network` reads, in half precision."""
    out = {k: v.detach().numpy().astype(np.float16) for k, v in net.state_dict().items()}
    for word, scale, columns in zip(("primitive", "pair"), scales, names):
        out[f"{word}_scale"], out[f"{word}_names"] = scale, np.array(columns)
    return out


def grown(
    start: Mapping[str, NDArray], names: Sequence[Sequence[str]], scales: Sequence[NDArray]
) -> dict[str, NDArray]:
    """Weights that also read columns which they were not trained on, so far without effect.

    Args:
        names, scales: the columns of primitives and of pairs, and their `spread`.
    """
    out = dict(start)
    for word, layer, columns, scale in zip(("primitive", "pair"), ("inu", "inq"), names, scales):
        old = [list(columns).index(n) for n in start[f"{word}_names"]]
        wide, weight = scale.copy(), start[f"{layer}.0.weight"]
        wide[:, old] = start[f"{word}_scale"]
        matrix = np.zeros((len(weight), len(columns)), weight.dtype)
        matrix[:, old] = weight
        out[f"{word}_scale"], out[f"{layer}.0.weight"] = wide, matrix
    return out


def train(
    paths: list[Path], lesson: Lesson, fold: int | None = None, seed: int = 0,
    start: Mapping[str, NDArray] | None = None, guides: Sequence[Mapping[str, NDArray]] = (),
    device: str = "cpu",
) -> dict[str, NDArray]:  # fmt: skip
    """The weights of a network.

    Args:
        fold: examples that it never sees; None: it sees all.
        start: weights to go on from, with other examples.
        guides: the networks of all folds, after which groups are drawn up; by default rules.
        device: where torch trains; on a GPU the small steps of one network are 1.4 to 1.8 times as
            fast as on a few cores.
    """
    chosen = [p for p in paths if fold_of(p.stem) != fold]
    read = [Network(weights) for weights in guides]
    found = [item_of(p, read[fold_of(p.stem)] if read else None) for p in chosen]
    kept = [f for f in found if f is not None]
    items, names = [f[0] for f in kept], kept[0][1:]
    scales = [
        spread(np.concatenate([i.unary for i in items])),
        spread(np.concatenate([i.pair for i in items if len(i.pair)])),
    ]
    if start is not None:
        start = grown(start, names, scales)
        scales = [start["primitive_scale"], start["pair_scale"]]
    for item in items:
        item.unary = normalised(item.unary, scales[0])
        item.pair = normalised(item.pair.reshape(-1, len(names[1])), scales[1])
    return weights_of(fit(items, names, lesson, seed, start, device), scales, names)
