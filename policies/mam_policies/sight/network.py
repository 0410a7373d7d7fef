"""EfficientNet-Lite2 from a package's weights, tuned to give a pose from a picture, and its file.

The first blocks, down to an eighth of the picture's size, stay as ImageNet made them; those down to
a sixteenth are trained on. What follows keeps the places of what is seen, for a pose needs them.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import SafetensorError, safe_open
from safetensors.torch import load_file, save_file
from torch import Tensor, nn
from torch.nn import functional as f

from mam_envs.scene.background import random_pattern
from mam_pipeline import folders
from mam_pipeline.edited import STRICT, Range, parse_json, validated
from mam_pipeline.errors import InputError
from mam_pipeline.folder_data import weights
from mam_pipeline.photo import efficientnet

STRIDE = 16
"""Of the last maps; pictures are cut to multiples of it."""
FROZEN = 7
"""Blocks that are not trained."""
AS_THEY_ARE = 3
"""Epochs for which pictures stay as they are."""
SHARE = 0.85
"""Of the pictures that get a pattern."""
FILE = "sight.safetensors"


Side = Annotated[int, Range(STRIDE, 8192)]
Count = Annotated[int, Range(1, 1000)]


@dataclass(frozen=True)
class _Sizes:
    """The header of the file of weights; see `SightNetwork`."""

    __pydantic_config__ = STRICT
    size: tuple[Side, Side]
    arm: Count
    outputs: Count
    width: Count = 32


class SightNetwork(nn.Module):
    """A picture and the arm's joints to a few numbers, in the units that they were learned in."""

    mean: Tensor
    std: Tensor

    def __init__(self, size: tuple[int, int], arm: int, outputs: int, width: int = 32) -> None:
        """`size`: height and width of the pictures. `arm`: joints that are given along."""
        super().__init__()
        self.sizes = {"size": list(size), "arm": arm, "outputs": outputs, "width": width}
        self.size = (STRIDE * (size[0] // STRIDE), STRIDE * (size[1] // STRIDE))
        strides = efficientnet.block_strides()
        ends = [k for k in range(len(strides)) if 2 * np.prod(strides[: k + 1]) > STRIDE]
        self.strides = strides[: ends[0]]
        self.kernels = nn.ParameterDict()
        for name, kernel in _kernels(len(self.strides)).items():
            frozen = name.startswith("stem") or int(name.split("_")[1]) < FROZEN
            self.kernels[name] = nn.Parameter(kernel, requires_grad=not frozen)
        last = self.kernels[_name(len(self.strides) - 1, "project_conv")]
        self.squeeze = nn.Conv2d(len(last), width, 1)
        places = self.size[0] * self.size[1] // STRIDE**2
        widths = [width * places + arm, 256, 128, outputs]
        rows: list[nn.Module] = []
        for a, b in pairwise(widths):
            rows += [nn.Linear(a, b), nn.ReLU()]
        self.head = nn.Sequential(nn.Dropout(0.1), *rows[:-1])
        self.register_buffer("mean", torch.zeros(outputs))
        self.register_buffer("std", torch.ones(outputs))

    @torch.no_grad()
    def early(self, pictures: Tensor) -> Tensor:
        """Maps (b, channels, h / 8, w / 8) of (b, h, w, 3) uint8 RGB."""
        h, w = self.size
        x = (pictures[:, :h, :w].permute(0, 3, 1, 2).float() - 127.0) / 128.0
        x = f.relu6(self._convolve(x.contiguous(memory_format=torch.channels_last), "stem", 2))
        return self._blocks(x, range(FROZEN))

    def forward(self, maps: Tensor, arm: Tensor) -> Tensor:
        """Maps of `early` and (b, arm) to normalised outputs (b, outputs)."""
        x = self._blocks(maps, range(FROZEN, len(self.strides)))
        seen = f.relu(self.squeeze(x)).flatten(1)
        out: Tensor = self.head(torch.cat([seen, arm.float()], dim=1))
        return out

    def tell(self, pictures: Tensor, arm: Tensor) -> Tensor:
        """(b, outputs) of (b, h, w, 3) uint8 RGB, in the units of what was learned."""
        return self(self.early(pictures), arm) * self.std + self.mean

    def _blocks(self, x: Tensor, numbers: range) -> Tensor:
        for k in numbers:
            stride, y = self.strides[k], x
            if _name(k, "expand_conv") in self.kernels:
                y = f.relu6(self._convolve(y, _name(k, "expand_conv"), 1))
            y = f.relu6(self._convolve(y, _name(k, "depthwise_conv"), stride, y.shape[1]))
            y = self._convolve(y, _name(k, "project_conv"), 1)
            x = x + y if x.shape == y.shape else y
        return x

    def _convolve(self, x: Tensor, name: str, stride: int, groups: int = 1) -> Tensor:
        """With TensorFlow's "same" padding."""
        kernel = self.kernels[name]
        total = max(kernel.shape[2] - stride, 0)
        low = total // 2
        if total:
            x = f.pad(x, (low, total - low, low, total - low))
        return f.conv2d(x, kernel, self.kernels[f"{name}_bias"], stride=stride, groups=groups)

    def save(self, folder: Path) -> None:
        """Write sight.safetensors with the sizes in its header."""
        state = {k: v.contiguous() for k, v in self.state_dict().items()}
        with folders.new_file(folder / FILE) as part:
            save_file(state, part, {"sizes": json.dumps(self.sizes)})

    @staticmethod
    def load(folder: Path) -> SightNetwork:
        """Read what `save` wrote.

        Raises:
            InputError: missing, or not such a file.
        """
        file = weights(folder, FILE, f"{folder} holds no {FILE}; has its training ended?")
        try:
            with safe_open(file, "pt") as opened:
                said = (opened.metadata() or {})["sizes"]
            sizes = validated(_Sizes, parse_json(said, f"{file}: sizes"))
            with torch.device("meta"):  # the weights take the memory, not what they are told to be
                network = SightNetwork(**vars(sizes))
            network.load_state_dict(load_file(file), assign=True)
        except (SafetensorError, KeyError, TypeError, ValueError, RuntimeError, OSError) as error:
            why = " ".join(str(error).split())[:300]
            raise InputError(f"{file} is no network of mam-sim: {why}") from error
        return network.eval()


def fit(
    network: SightNetwork,
    pictures: NDArray[np.uint8],
    arm: NDArray[np.float32],
    target: NDArray[np.float32],
    epochs: int,
    seed: int,
    told: Callable[[float, str], None] = lambda *_: None,
    batch: int = 32,
    rate: float = 1e-3,
    kept: NDArray[np.bool_] | None = None,
) -> float:
    """Adam on the smooth L1 error; ImageNet's kernels move at a fifth of the rate.

    Args:
        pictures: (N, h, w, 3). arm: (N, n). target: (N, outputs).
        told: share of the training that is done, and words.
        kept: (N, h, w) what stays when the rest of a picture gets a random pattern, another one
            in every few epochs.

    Returns:
        The last epoch's mean loss.
    """
    torch.manual_seed(seed)
    wanted = torch.from_numpy(target)
    network.mean.copy_(wanted.mean(0))
    network.std.copy_(wanted.std(0).clamp(min=1e-4))
    wanted = (wanted - network.mean) / network.std
    rng, maps = np.random.default_rng(seed), torch.zeros(0)
    old = [p for p in network.kernels.parameters() if p.requires_grad]
    new = [*network.squeeze.parameters(), *network.head.parameters()]
    groups: list[dict[str, Any]] = [{"params": old}, {"params": new}]
    optimiser = torch.optim.AdamW(groups, lr=rate, weight_decay=1e-4)
    steps = epochs * -(-len(pictures) // batch)
    schedule = torch.optim.lr_scheduler.OneCycleLR(
        optimiser, [0.2 * rate, rate], total_steps=steps + 1, pct_start=0.1
    )
    loss = float("nan")
    network.train()
    for epoch in range(epochs):
        if epoch == 0 or (kept is not None and epoch % AS_THEY_ARE == 0):
            told(epoch / epochs, "looking")
            shown = pictures if kept is None else elsewhere(pictures, kept, rng)
            parts = torch.from_numpy(shown).split(batch)
            maps = torch.cat([network.early(part).half() for part in parts])
        total = 0.0
        for rows in torch.randperm(len(pictures)).split(batch):
            told_now = network(maps[rows].float(), torch.from_numpy(arm[rows]))
            error = f.smooth_l1_loss(told_now, wanted[rows], beta=0.2)
            optimiser.zero_grad()
            error.backward()
            optimiser.step()
            schedule.step()
            total += float(error.detach()) * len(rows)
        loss = total / len(pictures)
        told((epoch + 1) / epochs, f"loss {loss:.4f}")
    network.eval()
    return loss


def elsewhere(
    pictures: NDArray[np.uint8], kept: NDArray[np.bool_], rng: np.random.Generator
) -> NDArray[np.uint8]:
    """The pictures, most of them with a random, slightly noisy pattern where they are not kept."""
    import cv2

    out, size = pictures.copy(), (pictures.shape[2], pictures.shape[1])
    for picture, keep in zip(out, kept):
        if rng.uniform() < SHARE:
            pattern = cv2.resize(random_pattern(rng), size, interpolation=cv2.INTER_AREA)
            noise = rng.normal(0, rng.uniform(0, 8), pattern.shape)
            picture[~keep] = np.clip(pattern + noise, 0, 255).astype(np.uint8)[~keep]
    return out


def _name(block: int, part: str) -> str:
    return f"block_{block}_{part}"


def _kernels(blocks: int) -> dict[str, Tensor]:
    """Kernels and biases, the batch normalisation folded in."""
    w = {k: torch.from_numpy(v.copy()) for k, v in efficientnet.weights().items()}
    out: dict[str, Tensor] = {}

    def put(name: str, conv: str, norm: str) -> None:
        scale = w[f"{norm}.weight"] / torch.sqrt(w[f"{norm}.running_var"] + efficientnet.EPSILON)
        out[name] = w[f"{conv}.weight"] * scale[:, None, None, None]
        out[f"{name}_bias"] = w[f"{norm}.bias"] - scale * w[f"{norm}.running_mean"]

    put("stem", "_conv_stem", "_bn0")
    for k in range(blocks):
        at = f"_blocks.{k}._"
        for number, part in enumerate(("expand_conv", "depthwise_conv", "project_conv")):
            if f"{at}{part}.weight" in w:
                put(_name(k, part), f"{at}{part}", f"{at}bn{number}")
    return out
