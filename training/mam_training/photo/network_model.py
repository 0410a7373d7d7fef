"""The photo networks in PyTorch: EfficientNet-Lite2 and a small decoder, trained together.

The backbone's maps at strides 2, 4, 8, 16 and 32 meet in the decoder, whose rows and columns are
also averaged and their greatest value taken: a seam goes on over its whole panel. What comes out, a
quarter as large as the picture, are the answers of one network: its `MAPS`.
"""

from __future__ import annotations

import io
import math
import subprocess
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional as f
from torch.utils.data import DataLoader, IterableDataset, get_worker_info

from mam_pipeline.photo import efficientnet
from mam_pipeline.photo.network import CHANNELS, TAPS


class Backbone(nn.Module):
    """Maps of EfficientNet-Lite2 after the blocks of TAPS, which starts as ImageNet trained it."""

    def __init__(self) -> None:
        super().__init__()
        self.strides = efficientnet.block_strides()
        self.layers = nn.ParameterDict()
        for name, (kernel, bias) in efficientnet.layers().items():
            if name != "head":
                self.layers[f"{name}_kernel"] = nn.Parameter(torch.from_numpy(kernel.copy()))
                self.layers[f"{name}_bias"] = nn.Parameter(torch.from_numpy(bias.copy()))

    def forward(self, x: Tensor) -> list[Tensor]:
        """Maps of pictures (n, 3, h, w), which are (RGB - 127) / 128; sides are multiples of 32."""
        x = f.relu6(_same(x, *self._layer("stem"), 2))
        out = []
        for k, stride in enumerate(self.strides):
            y = x
            if f"{k}_expand_kernel" in self.layers:
                y = f.relu6(f.conv2d(y, *self._layer(f"{k}_expand")))
            y = f.relu6(_same(y, *self._layer(f"{k}_depthwise"), stride, groups=y.shape[1]))
            y = f.conv2d(y, *self._layer(f"{k}_project"))
            x = x + y if x.shape == y.shape else y
            if k in TAPS:
                out.append(x)
        return out

    def _layer(self, name: str) -> tuple[Tensor, Tensor]:
        return self.layers[f"{name}_kernel"], self.layers[f"{name}_bias"]


def _same(x: Tensor, kernel: Tensor, bias: Tensor, stride: int, groups: int = 1) -> Tensor:
    """TensorFlow's "same" padding, for sides that are multiples of the stride."""
    total = max(kernel.shape[2] - stride, 0)
    low = total // 2
    x = f.pad(x, (low, total - low, low, total - low))
    return f.conv2d(x, kernel, bias, stride=stride, groups=groups)


class Mixer(nn.Module):
    """A 5 x 5 neighbourhood, the row and the column of each place, mixed into its channels."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.near = nn.Conv2d(channels, channels, 5, padding=2, groups=channels)
        self.mix = nn.Conv2d(6 * channels, 2 * channels, 1)
        self.back = nn.Conv2d(2 * channels, channels, 1)

    def forward(self, x: Tensor) -> Tensor:
        """(n, c, h, w) of the same."""
        lines = [
            k.expand_as(x)
            for k in (
                x.mean(3, keepdim=True), x.amax(3, keepdim=True),
                x.mean(2, keepdim=True), x.amax(2, keepdim=True),
            )
        ]  # fmt: skip
        y = torch.cat([x, self.near(x), *lines], dim=1)
        return x + self.back(f.relu(self.mix(y)))


class Decoder(nn.Module):
    """(n, answers, h / 4, w / 4) from the backbone's maps."""

    def __init__(self, answers: int, channels: int = CHANNELS) -> None:
        super().__init__()
        c = channels
        self.enter = nn.ModuleList([nn.Conv2d(n, c, 1) for n in TAPS.values()])
        self.place = nn.Parameter(torch.zeros(c, 3))  # of x, y and log(w / h)
        self.mixers = nn.ModuleList([Mixer(c) for _ in range(4)])
        self.leave = nn.Conv2d(c, answers, 1)

    def forward(self, maps: list[Tensor]) -> Tensor:
        """Raw values."""
        fine, *rest = [enter(m) for enter, m in zip(self.enter, maps)]
        x = rest[-1] + self._places(rest[-1])
        x = self.mixers[0](x)
        for mixer, m in zip(self.mixers[1:], rest[-2::-1]):
            x = mixer(m + f.interpolate(x, scale_factor=2.0, mode="nearest"))
        x = x + f.avg_pool2d(fine, 2)
        out: Tensor = self.leave(f.relu(x))
        return out

    def _places(self, x: Tensor) -> Tensor:
        h, w = x.shape[2:]
        y0 = torch.linspace(-1, 1, h, device=x.device)[:, None].expand(h, w)
        x0 = torch.linspace(-1, 1, w, device=x.device)[None].expand(h, w)
        aspect = torch.full((h, w), math.log(w / h), device=x.device)
        return torch.einsum("ck,khw->chw", self.place, torch.stack([x0, y0, aspect]))


class Network(nn.Module):
    """Backbone and decoder: (n, answers, h / 4, w / 4) from pictures (n, 3, h, w) of 0..255."""

    def __init__(self, answers: int, channels: int = CHANNELS) -> None:
        super().__init__()
        self.backbone, self.decoder = Backbone(), Decoder(answers, channels)

    def forward(self, pictures: Tensor) -> Tensor:
        """Raw values."""
        out: Tensor = self.decoder(self.backbone((pictures.float() - 127.0) / 128.0))
        return out


@dataclass(frozen=True)
class NetworkTraining:
    """How a network of the photo stage is trained."""

    seed: int = 0
    """Of the painted pictures."""
    count: int = 24_500
    """Pictures that are seen."""
    batch: int = 32
    """Pictures a step."""
    rate: float = 2e-3
    """Greatest step of the optimiser on the decoder."""
    slower: float = 0.15
    """That of the backbone, over it."""
    channels: int = 96
    """Of the decoder."""
    workers: int = 1
    """Processes that paint."""
    device: str = "cpu"
    """That trains: cpu or cuda."""
    start: str = ""
    """Commit whose weights of this network it goes on from; empty: as ImageNet trained them."""
    real: float = 0.0
    """Of the lessons that come from real photos, each of which is seen many times."""
    photos: Path = Path("../shared/corpus/photos")
    """Folder of these, as ID.jpg."""
    labels: Path = Path("labels/photos.jsonl")
    """What was marked on them (`real_photos`)."""


class Lessons(IterableDataset):  # type: ignore[type-arg]
    """Batches of lessons of one shape each; workers share the numbers 0 to count.

    Args:
        lesson: number to a tuple of arrays that begins with a picture (h, w, 3).
    """

    def __init__(
        self, config: NetworkTraining, lesson: Callable[[int], tuple[NDArray[Any], ...]]
    ) -> None:
        self.config, self.lesson = config, lesson

    def __iter__(self) -> Iterator[list[Tensor]]:
        waiting: dict[tuple[int, ...], list[tuple[NDArray[Any], ...]]] = {}
        worker = get_worker_info()
        first, step = (0, 1) if worker is None else (worker.id, worker.num_workers)
        for k in range(first, self.config.count, step):
            lesson = self.lesson(k)
            group = waiting.setdefault(lesson[0].shape, [])
            group.append(lesson)
            if len(group) == self.config.batch:
                yield batch_of(group)
                group.clear()


def batch_of(lessons: Sequence[tuple[NDArray[Any], ...]]) -> list[Tensor]:
    """Stacked tensors: pictures (n, 3, h, w) uint8, and the rest as it is."""
    pictures, *truth = (np.stack(arrays) for arrays in zip(*lessons))
    first = np.ascontiguousarray(pictures.transpose(0, 3, 1, 2))
    return [torch.from_numpy(array) for array in (first, *truth)]


def trained(
    config: NetworkTraining,
    answers: int,
    lesson: Callable[[int], tuple[NDArray[Any], ...]],
    loss_of: Callable[..., dict[str, Tensor]],
    weights: Path,
) -> Network:
    """A network that was trained: the step rises for 5 % of the batches, and falls to 0.

    Args:
        answers: maps that it gives. lesson: see `Lessons`.
        loss_of: raw values and truth to losses by name; their sum is minimised.
        weights: where the package keeps those of this network.
    """
    torch.set_num_threads(1)  # sums have one order
    torch.manual_seed(config.seed)
    network = Network(answers, config.channels)
    if config.start:
        network.load_state_dict(weights_at(config.start, weights))
    network = network.to(config.device)
    batches = DataLoader(
        Lessons(config, lesson), batch_size=None, num_workers=config.workers, prefetch_factor=6
    )
    steps = config.count // config.batch
    groups = [
        {"params": list(network.decoder.parameters()), "peak": config.rate},
        {"params": list(network.backbone.parameters()), "peak": config.slower * config.rate},
    ]
    optimiser = torch.optim.AdamW(groups, lr=config.rate, weight_decay=1e-3)
    for k, batch in enumerate(batches):
        done = k / steps
        share = done / 0.05 if done < 0.05 else 0.5 + 0.5 * math.cos(math.pi * (done - 0.05) / 0.95)
        for group in optimiser.param_groups:
            group["lr"] = group["peak"] * (share + 1e-3)
        pictures, *truth = (b.to(config.device) for b in batch)
        losses = loss_of(network(pictures), *truth)
        optimiser.zero_grad()
        torch.stack(list(losses.values())).sum().backward()
        for group in optimiser.param_groups:
            torch.nn.utils.clip_grad_norm_(group["params"], 2.0)
        optimiser.step()
        if k % 50 == 49:
            said = " ".join(f"{name} {float(v.detach()):.3f}" for name, v in losses.items())
            print(f"{k + 1}/{steps} {said}", flush=True)
    return network


def weights_at(commit: str, path: Path) -> dict[str, Tensor]:
    """What `save` wrote to a file of the repository, as it was at a commit."""
    show = ["git", "show", f"{commit}:./{path.name}"]
    kept = subprocess.run(show, cwd=path.parent, capture_output=True, check=True).stdout
    with np.load(io.BytesIO(kept)) as arrays:
        return {k: torch.from_numpy(arrays[k].astype(np.float32)) for k in arrays.files}


def save(network: Network, path: Path) -> None:
    """Write the weights as `mam_pipeline.photo.network` reads them, in half precision."""
    path.parent.mkdir(parents=True, exist_ok=True)
    kept = {k: v.cpu().numpy().astype(np.float16) for k, v in network.state_dict().items()}
    np.savez_compressed(path, **kept)  # type: ignore[arg-type]
