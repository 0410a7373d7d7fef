"""The front network in PyTorch: EfficientNet-Lite2 as it is, and a small decoder that is trained.

The backbone keeps the weights of ImageNet (they come with a package and are not stored again).
Its maps at strides 2, 4, 8, 16 and 32 meet in the decoder, whose rows and columns are also averaged
and their greatest value taken: a seam goes on over its whole panel. What comes out, a quarter as
large as the picture: `mam_pipeline.photo.front_network.MAPS`.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor, nn
from torch.nn import functional as f

from mam_pipeline.photo import efficientnet
from mam_pipeline.photo.front_network import CHANNELS, MAPS, TAPS

EPSILON = efficientnet.EPSILON


class Backbone(nn.Module):
    """Maps of EfficientNet-Lite2 after the blocks of TAPS; frozen."""

    def __init__(self) -> None:
        super().__init__()
        w = {k: torch.from_numpy(v.copy()) for k, v in efficientnet.weights().items()}
        self.layers: list[dict[str, tuple[Tensor, Tensor]]] = []
        self.stem = _folded(w, "_conv_stem", "_bn0")
        self.strides = efficientnet.block_strides()
        for k in range(len(self.strides)):
            at = f"_blocks.{k}."
            layer = {
                "depthwise": _folded(w, f"{at}_depthwise_conv", f"{at}_bn1"),
                "project": _folded(w, f"{at}_project_conv", f"{at}_bn2"),
            }
            if f"{at}_expand_conv.weight" in w:
                layer["expand"] = _folded(w, f"{at}_expand_conv", f"{at}_bn0")
            self.layers.append(layer)

    @torch.no_grad()
    def forward(self, x: Tensor) -> list[Tensor]:
        """Maps of pictures (n, 3, h, w), which are (RGB - 127) / 128; sides are multiples of 32."""
        x = f.relu6(_same(x, *self.stem, 2))
        out = []
        for k, layer in enumerate(self.layers):
            y = x
            if "expand" in layer:
                y = f.relu6(f.conv2d(y, *layer["expand"]))
            y = f.relu6(_same(y, *layer["depthwise"], self.strides[k], groups=y.shape[1]))
            y = f.conv2d(y, *layer["project"])
            x = x + y if x.shape == y.shape else y
            if k in TAPS:
                out.append(x)
        return out


def _folded(w: dict[str, Tensor], conv: str, norm: str) -> tuple[Tensor, Tensor]:
    """Kernel and bias of a convolution with its batch normalisation."""
    scale = w[f"{norm}.weight"] / torch.sqrt(w[f"{norm}.running_var"] + EPSILON)
    kernel = w[f"{conv}.weight"] * scale[:, None, None, None]
    return kernel, w[f"{norm}.bias"] - scale * w[f"{norm}.running_mean"]


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


class FrontDecoder(nn.Module):
    """What is trained: (n, sum of MAPS, h / 4, w / 4) from the backbone's maps."""

    def __init__(self) -> None:
        super().__init__()
        c = CHANNELS
        self.enter = nn.ModuleList([nn.Conv2d(n, c, 1) for n in TAPS.values()])
        self.place = nn.Parameter(torch.zeros(c, 3))  # of x, y and log(w / h)
        self.mixers = nn.ModuleList([Mixer(c) for _ in range(4)])
        self.leave = nn.Conv2d(c, sum(MAPS.values()), 1)

    def forward(self, maps: list[Tensor]) -> Tensor:
        """Raw values; see MAPS."""
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
        y0 = torch.linspace(-1, 1, h)[:, None].expand(h, w)
        x0 = torch.linspace(-1, 1, w)[None].expand(h, w)
        aspect = torch.full((h, w), math.log(w / h))
        return torch.einsum("ck,khw->chw", self.place, torch.stack([x0, y0, aspect]))
