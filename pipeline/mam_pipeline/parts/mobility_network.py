"""A network with attention over primitives: which of them move by themselves or with a part.

Every primitive is a token; what is known of a pair of primitives biases the attention between them.
It is trained with torch (`mam_training.articulation`), together with what moves as one body and
how, and run here with NumPy alone. On objects of sources that it was not trained on it tells better
than the scores of the parts whether anything moves at all, and the bar of abstention asks it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources.abc import Traversable
from io import BytesIO

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, softmax

from mam_pipeline.backends import KinematicPrior
from mam_pipeline.parts.features import Table, pair_features, primitive_features
from mam_pipeline.parts.graph import Graph
from mam_pipeline.parts.network import gelu, normalised
from mam_pipeline.types import FloatArray
from mam_pipeline.weights import loaded

Array = NDArray[np.float32]
WEIGHTS = "parts/mobility"


@dataclass(frozen=True)
class MobilityLimits:
    """What of an object is looked at.

    Attributes:
        most: primitives, the largest: pairs grow with the square. unknown: chance of the others.
    """

    most: int = 300
    unknown: float = 0.5


MOBILITY = MobilityLimits()


class MobilityNetwork:
    """The trained network.

    Args:
        weights: arrays by name, as `mam_training.articulation.publish` writes them.
    """

    def __init__(self, weights: Mapping[str, NDArray]) -> None:
        self._w = {k: np.asarray(v, np.float32) for k, v in weights.items() if v.dtype.kind == "f"}
        self.primitive_names = tuple(map(str, weights["primitive_names"]))
        self.pair_names = tuple(map(str, weights["pair_names"]))
        self.heads = len(self._w["blocks.0.bias.bias"])
        self.layers = 1 + max(int(k.split(".")[1]) for k in self._w if k.startswith("blocks."))

    def moving(self, graph: Graph, prior: KinematicPrior | None) -> FloatArray:
        """(P,) chance of every primitive that it moves."""
        unary = primitive_features(graph, prior)
        pairs = pair_features(graph, unary, prior)
        nodes = normalised(filled(unary, self.primitive_names), self._w["primitive_scale"])
        edges = normalised(filled(pairs, self.pair_names), self._w["pair_scale"])
        geometry, ends = geometry_of(graph), graph.pairs
        seen = np.sort(np.argsort(-graph.area, kind="stable")[: MOBILITY.most])
        place = np.full(graph.count, -1)
        place[seen] = np.arange(len(seen))
        inside = (place[ends] >= 0).all(axis=1)
        out = np.full(graph.count, MOBILITY.unknown)
        out[seen] = self.answer(
            nodes[seen], edges[inside], place[ends[inside]], geometry[seen], graph.is_fused
        )
        return out

    def answer(
        self, nodes: NDArray[np.floating], edges: NDArray[np.floating], ends: NDArray[np.integer],
        geometry: Array, fused: bool,
    ) -> FloatArray:  # fmt: skip
        """(P,) chance of every primitive that it moves.

        Args:
            nodes: (P, U), edges: (E, G) normalised features; ends: (E, 2) primitives of the pairs.
            geometry: (P, 21), see `geometry_of`.
        """
        count = len(nodes)
        pair = np.zeros((count, count, edges.shape[1] + 1), np.float32)
        i, j = ends[:, 0], ends[:, 1]
        pair[i, j, :-1], pair[j, i, :-1] = edges, edges
        pair[i, j, -1], pair[j, i, -1] = 1.0, 1.0
        w = self._w
        h = self._mlp("enter", np.concatenate([nodes, geometry], 1).astype(np.float32))
        h = h + w["object.weight"][0] + w["count.weight"][0] + w["part.weight"][0]
        h = h + w["fused.weight"][int(fused)]
        z = self._mlp("link", np.concatenate([pair, relative(geometry)], -1))
        for k in range(self.layers):
            h, z = self._block(f"blocks.{k}", h, z)
        h = self._norm("last", h)
        wide = np.concatenate([h, np.broadcast_to(h.mean(axis=0), h.shape)], 1)
        out: FloatArray = expit(self._mlp("move", wide)[:, 0].astype(np.float64))
        return out

    def _block(self, at: str, h: Array, z: Array) -> tuple[Array, Array]:
        count, width = h.shape
        x, y = self._norm(f"{at}.n1", h), self._norm(f"{at}.ne", z)
        q, k, v = (
            self._linear(f"{at}.qkv", x).reshape(count, 3, self.heads, -1).transpose(1, 2, 0, 3)
        )
        bias = self._linear(f"{at}.bias", y).transpose(2, 0, 1)
        mixed = softmax(q @ k.transpose(0, 2, 1) / np.sqrt(q.shape[-1]) + bias, axis=-1) @ v
        mixed = mixed.transpose(1, 0, 2).reshape(count, width)
        around = np.concatenate([y.mean(axis=1), np.maximum(y.max(axis=1), -20.0)], -1)
        h = h + self._linear(f"{at}.out", mixed) + self._linear(f"{at}.gather", around)
        x = self._norm(f"{at}.n1", h)
        left, right = self._linear(f"{at}.left", x), self._linear(f"{at}.right", x)
        both = left[:, None] * right[None]
        wide = np.concatenate([y, both + both.transpose(1, 0, 2)], -1)
        z = z + self._mlp(f"{at}.pair", wide)
        return h + self._mlp(f"{at}.feed", self._norm(f"{at}.n2", h)), z

    def _linear(self, name: str, x: Array) -> Array:
        return x @ self._w[f"{name}.weight"].T + self._w[f"{name}.bias"]

    def _mlp(self, name: str, x: Array) -> Array:
        return self._linear(f"{name}.2", gelu(self._linear(f"{name}.0", x)))

    def _norm(self, name: str, x: Array) -> Array:
        centred = x - x.mean(axis=-1, keepdims=True)
        scale = np.sqrt((centred**2).mean(axis=-1, keepdims=True) + 1e-5)
        return centred / scale * self._w[f"{name}.weight"] + self._w[f"{name}.bias"]


def geometry_of(graph: Graph) -> Array:
    """(P, 21) low and high corners, size, spin axis and axes of every primitive's box.

    Object's frame, its middle as the origin of x and y; lengths in shares of its diagonal.
    """
    middle = (graph.low.min(axis=0) + graph.high.max(axis=0)) / 2
    middle[2] = 0.0
    axes = graph.axes.reshape(-1, 9)
    rows = [graph.low - middle, graph.high - middle, graph.size, graph.spin_axis, axes]
    return np.concatenate(rows, axis=1).astype(np.float32)


def relative(g: Array) -> Array:
    """(P, P, 16) how every two boxes lie to each other.

    Args:
        g: see `geometry_of`.
    """
    low, high, size, spin = g[:, 0:3], g[:, 3:6], g[:, 6:9], g[:, 9:12]
    middle, extent = (low + high) / 2, np.maximum(high - low, 1e-3)
    offset = middle[None] - middle[:, None]
    overlap = np.minimum(high[:, None], high[None]) - np.maximum(low[:, None], low[None])
    share = np.clip(overlap / np.minimum(extent[:, None], extent[None]), -1, 1)
    length = np.maximum(size, 5e-3)
    ratio = np.log(length[:, None] / length[None])
    coaxial = np.abs((spin[:, None] * spin[None]).sum(axis=-1, keepdims=True))
    along = (offset * spin[:, None]).sum(axis=-1, keepdims=True)
    lateral = np.linalg.norm(offset - along * spin[:, None], axis=-1, keepdims=True)
    flush = np.minimum(np.abs(low[:, None] - low[None]), np.abs(high[:, None] - high[None]))
    alike = np.abs(ratio).max(axis=-1, keepdims=True)
    distance = np.linalg.norm(np.maximum(-overlap, 0), axis=-1, keepdims=True)
    return np.concatenate([offset, share, ratio, coaxial, lateral, flush, alike, distance], axis=-1)


def filled(found: Table, names: tuple[str, ...]) -> Array:
    """(n, len(names)) columns of a table, NaN where it lacks one."""
    out = np.full((len(found.values), len(names)), np.nan, np.float32)
    for k, name in enumerate(names):
        if name in found.names:
            out[:, k] = found.column(name)
    return out


def load_mobility() -> MobilityNetwork:
    """The trained network."""
    return loaded(WEIGHTS, _read_network)


def _read_network(folder: Traversable) -> MobilityNetwork:
    return read_mobility(folder / "network.npz")


def read_mobility(file: Traversable) -> MobilityNetwork:
    """A network from the file that the trainer wrote."""
    with np.load(BytesIO(file.read_bytes()), allow_pickle=False) as arrays:
        return MobilityNetwork(dict(arrays))
