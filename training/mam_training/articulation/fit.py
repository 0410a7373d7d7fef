"""The training loop of the network of parts."""

from __future__ import annotations

import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from mam_training.articulation.batches import Draw, batch_of, batches, scaled, spread
from mam_training.articulation.evaluate import evaluate
from mam_training.articulation.items import Item, columns, object_words, part_words
from mam_training.articulation.losses import loss_of
from mam_training.articulation.model import PartNetwork, Shape

PRIOR = ("mobility", "affinity")  # columns whose names hold these come from the kinematic prior


@dataclass(frozen=True)
class Lesson:
    """How a network is trained.

    Attributes:
        epochs: how often every item is seen. rate: highest learning rate. decay: of the weights.
        warm: steps until the rate is highest. pairs: squared primitives of a step.
        average: share that the averaged weights keep at each step.
    """

    epochs: float
    rate: float = 1.5e-3
    decay: float = 0.02
    warm: int = 200
    pairs: int = 16_000
    average: float = 0.998


@dataclass
class Trained:
    """A network with what its inputs are normalised by: (2, F) scales of primitives and pairs."""

    net: PartNetwork
    scales: Sequence[NDArray]


def prior_columns() -> list[NDArray]:
    """Indices of the columns of primitives and of pairs that come from the kinematic prior."""
    return [
        np.flatnonzero([any(p in name for p in PRIOR) for name in names]) for names in columns()
    ]


def fit(
    items: Sequence[Item], lesson: Lesson, draw: Draw, seed: int = 0, start: Trained | None = None
) -> Trained:
    """Train a network on items, from `start` on if it is given; the mean of its weights over the
    last steps is what is kept."""
    torch.set_num_threads(1)  # the same sums in the same order on every machine
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    scales = start.scales if start else _scales(items, rng)
    ready, prior = [scaled(item, scales) for item in items], prior_columns()
    primitive, pair = map(len, columns())
    net = PartNetwork(Shape(primitive, pair, len(object_words()), len(part_words())))
    if start is not None:
        net.load_state_dict(start.net.state_dict())
    optimiser = torch.optim.AdamW(
        net.parameters(), lr=lesson.rate, weight_decay=lesson.decay, betas=(0.9, 0.98)
    )
    mean = {k: v.clone() for k, v in net.state_dict().items()}
    number, seen, step, started = int(lesson.epochs * len(ready)), 0, 0, time.time()
    sums: dict[str, float] = {}
    net.train()
    while seen < number:
        for rows in batches(ready, rng, lesson.pairs):
            wave = 0.5 * (1 + np.cos(np.pi * min(seen / number, 1.0))) + 0.005
            for group in optimiser.param_groups:
                group["lr"] = lesson.rate * min(1.0, (step + 1) / lesson.warm) * wave
            batch = batch_of([ready[k] for k in rows], rng, draw, prior)
            loss, each = loss_of(batch, *net(*batch.inputs))
            optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(net.parameters(), 1.0)
            optimiser.step()
            _blend(mean, net, min(lesson.average, (step + 1) / (step + 20)))
            step, seen = step + 1, seen + len(rows)
            for name, value in each.items():
                sums[name] = sums.get(name, 0.0) + value / 200
            if step % 200 == 0:
                told = " ".join(f"{k} {v:.3f}" for k, v in sums.items())
                sums = {}
                print(f"{seen / len(ready):.2f} epochs, {time.time() - started:.0f} s: {told}",
                      file=sys.stderr, flush=True)  # fmt: skip
            if seen >= number:
                break
    net.load_state_dict(mean)
    return Trained(net.eval(), scales)


def report(
    trained: Trained, tests: Mapping[str, Sequence[Item]], draws: Mapping[str, Draw]
) -> dict[str, dict[str, float]]:
    """Scores of sets of items under what is told, by "set, told"."""
    out = {}
    for name, some in tests.items():
        ready = [scaled(item, trained.scales) for item in some]
        for told, draw in draws.items():
            out[f"{name}, {told}"] = evaluate(trained.net, ready, prior_columns(), draw)
    return out


def _scales(items: Sequence[Item], rng: np.random.Generator) -> list[NDArray]:
    some = [items[k] for k in rng.permutation(len(items))[:3000]]
    return [
        spread(np.concatenate([i.unary for i in some])),
        spread(np.concatenate([i.pair for i in some]).astype(np.float32)),
    ]


@torch.no_grad()
def _blend(mean: dict[str, torch.Tensor], net: PartNetwork, keep: float) -> None:
    for name, value in net.state_dict().items():
        mean[name].lerp_(value, 1 - keep)
