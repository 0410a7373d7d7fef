"""Time of one training step of the reasoner's network on the CPU and on a GPU, in one run.

    python benchmarks/network_step_speed.py [--objects 200] [--batches 12 48 192] [--threads 4]

Examples are generated; the first losses of both devices stand beside each other.
"""

from __future__ import annotations

import argparse
import time
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch

from mam_training.parts import train_network as lessons
from mam_training.parts.recipe import gather, jobs
from mam_training.parts.train import apart

WARM = 3  # first steps that are not counted


def step_times(items: list[lessons.Item], size: int, device: str) -> tuple[float, float]:
    """Median seconds of a step, and the first loss."""
    torch.manual_seed(0)
    rng = np.random.default_rng(0)
    net = lessons.Net(items[0].unary.shape[1], items[0].pair.shape[1], 0.0).to(device)
    optimiser = torch.optim.AdamW(net.parameters(), lr=1e-3)
    nothing = [np.zeros(0, int)] * 2
    order = np.resize(np.arange(len(items)), (size * (WARM + 12),)).reshape(-1, size)
    seconds, losses = [], []
    for rows in islice(order, WARM + 12):
        started = time.perf_counter()
        batch = lessons.batch_of([items[k] for k in rows], rng, nothing).to(device)
        loss = lessons.loss_of(net(batch), batch.truth)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        losses.append(loss.item())  # waits for the device
        seconds.append(time.perf_counter() - started)
    return float(np.median(seconds[WARM:])), losses[0]


def main() -> None:
    """Command line; see the module's text."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--objects", type=int, default=200)
    parser.add_argument("--batches", type=int, nargs="+", default=[12, 48, 192])
    parser.add_argument("--threads", type=int, default=torch.get_num_threads())
    args = parser.parse_args()
    torch.set_num_threads(args.threads)
    with TemporaryDirectory() as folder:
        paths, _ = apart(gather(jobs("train", args.objects, 0, 0), Path(folder)))
        items = [found[0] for p in paths if (found := lessons.item_of(p, None)) is not None]
    scales = [lessons.spread(np.concatenate([getattr(i, n) for i in items if len(getattr(i, n))]))
              for n in ("unary", "pair")]  # fmt: skip
    for item in items:
        item.unary = lessons.normalised(item.unary, scales[0])
        item.pair = lessons.normalised(item.pair.reshape(-1, scales[1].shape[1]), scales[1])
    devices = ["cpu", *(["cuda"] if torch.cuda.is_available() else [])]
    print(f"{len(items)} objects, {args.threads} threads, {', '.join(devices)}")
    for size in args.batches:
        found = [step_times(items, size, device) for device in devices]
        words = ", ".join(f"{d} {1e3 * s:.1f} ms (first loss {loss:.4f})"
                          for d, (s, loss) in zip(devices, found))  # fmt: skip
        ratio = f"; cpu / gpu {found[0][0] / found[1][0]:.2f}" if len(found) > 1 else ""
        print(f"batch {size}: {words}{ratio}", flush=True)


if __name__ == "__main__":
    main()
