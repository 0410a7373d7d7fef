"""The training loop of the network of parts.

    python -m mam_training.articulation.fit build/network/corpus.safetensors OUT --device cuda

does the part of the recipe that a GPU helps with: it needs torch and the file of the corpus alone.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import torch
from safetensors.torch import save_file
from torch import Tensor

from mam_training.articulation.batches import DRAW, Draw, batch_of, batches
from mam_training.articulation.corpus import Corpus
from mam_training.articulation.losses import loss_of
from mam_training.articulation.model import PartNetwork, Shape


@dataclass(frozen=True)
class Lesson:
    """How a network is trained.

    Attributes:
        epochs: how often every item is seen. rate: highest learning rate. decay: of the weights.
        warm: steps until the rate is highest. pairs: squared primitives of a step. most: objects
            of a step. average: share that the averaged weights keep at each step.
        seconds: the training ends in this time, fewer epochs or not; 0 for no limit.
    """

    epochs: float
    rate: float = 1.5e-3
    decay: float = 0.02
    warm: int = 200
    pairs: int = 16_000
    most: int = 48
    average: float = 0.998
    seconds: float = 0.0


def fit(
    corpus: Corpus, shape: Shape, prior: Sequence[Sequence[int]], lesson: Lesson,
    seed: int = 0, draw: Draw = DRAW,
) -> PartNetwork:  # fmt: skip
    """Train a network; the mean of its weights over the last steps is what is kept.

    Args:
        prior: columns of primitives and of pairs that come from the kinematic prior.
    """
    device = corpus.unary.device
    if device.type == "cpu":
        torch.set_num_threads(1)  # the same sums in the same order on every machine
    torch.manual_seed(seed)
    rng = np.random.default_rng(seed)
    net = PartNetwork(shape).to(device)
    optimiser = torch.optim.AdamW(
        net.parameters(), lr=lesson.rate, weight_decay=lesson.decay, betas=(0.9, 0.98)
    )
    mean = {k: v.clone() for k, v in net.state_dict().items()}
    sizes, times = corpus.sizes, corpus.times.cpu().numpy()
    pool = np.repeat(np.arange(len(corpus)), times)
    number, seen, step, started = int(lesson.epochs * len(pool)), 0, 0, time.time()
    sums: dict[str, Tensor] = {}
    done = 0.0
    net.train()
    while done < 1.0:
        order = rng.permutation(pool)
        for rows in batches(sizes, order, rng, lesson.pairs, lesson.most):
            done = seen / number
            if lesson.seconds:
                done = max(done, (time.time() - started) / lesson.seconds)
            if done >= 1.0:
                break
            wave = 0.5 * (1 + np.cos(np.pi * done)) + 0.005
            for group in optimiser.param_groups:
                group["lr"] = lesson.rate * min(1.0, (step + 1) / lesson.warm) * wave
            batch = batch_of(corpus, rows, rng, draw, prior)
            with torch.autocast(device.type, torch.bfloat16, enabled=device.type == "cuda"):
                answers = net(*batch.inputs)
            loss, each = loss_of(batch, *(x.float() for x in answers))
            optimiser.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(net.parameters(), 1.0)
            optimiser.step()
            _blend(mean, net, min(lesson.average, (step + 1) / (step + 20)))
            step, seen = step + 1, seen + len(rows)
            for name, value in each.items():
                sums[name] = sums[name] + value / 200 if name in sums else value / 200
            if step % 200 == 0:
                told = " ".join(f"{k} {float(v):.3f}" for k, v in sums.items())
                sums = {}
                print(f"{seen / len(pool):.2f} epochs, {time.time() - started:.0f} s: {told}",
                      file=sys.stderr, flush=True)  # fmt: skip
    net.load_state_dict(mean)
    return net.eval()


@torch.no_grad()
def _blend(mean: dict[str, Tensor], net: PartNetwork, keep: float) -> None:
    now = net.state_dict()
    names = list(mean)
    torch._foreach_lerp_([mean[k] for k in names], [now[k] for k in names], 1 - keep)


def main(argv: Sequence[str] | None = None) -> None:
    """Train on the file of a corpus; the weights go to OUT."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("corpus", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--without", nargs="*", default=[], help="sources that are left out")
    parser.add_argument("--epochs", type=float, default=30.0)
    parser.add_argument("--seconds", type=float, default=0.0)
    parser.add_argument("--pairs", type=int, default=16_000)
    parser.add_argument("--most", type=int, default=48)
    parser.add_argument("--rate", type=float, default=1.5e-3)
    parser.add_argument("--average", type=float, default=0.998)
    for name, value in asdict(Shape(0, 0, 0, 0)).items():
        if name in ("width", "edge", "heads", "layers", "dropout"):
            parser.add_argument(f"--{name}", type=type(value), default=value)
    args = parser.parse_args(argv)
    corpus, about = Corpus.load(args.corpus)
    for source in args.without:
        corpus = corpus.without(about["sources"].index(source))
    shape = Shape(
        corpus.unary.shape[1], corpus.pair.shape[1], len(about["object_words"]),
        len(about["part_words"]), args.width, args.edge, args.heads, args.layers,
        dropout=args.dropout,
    )  # fmt: skip
    lesson = Lesson(args.epochs, args.rate, pairs=args.pairs, most=args.most,
                    average=args.average, seconds=args.seconds)  # fmt: skip
    net = fit(corpus.to(args.device), shape, about["prior"], lesson, args.seed)
    args.out.parent.mkdir(parents=True, exist_ok=True)
    weights = {k: v.cpu().half().contiguous() for k, v in net.state_dict().items()}
    save_file(weights, str(args.out), {"shape": str(asdict(shape))})


if __name__ == "__main__":
    main()
