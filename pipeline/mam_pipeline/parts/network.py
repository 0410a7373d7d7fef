"""A small graph network over primitives: who moves with whom, who moves, which groups are parts.

Nodes are primitives, edges neighbouring pairs; both carry the features that the boosted trees see.
Messages along the edges let every primitive know what its neighbours are (a handle before a front,
one of four like fronts). Trained with torch (`reason.train_network`), run here with NumPy alone.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.resources.abc import Traversable
from io import BytesIO

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf, expit, log_expit

from mam_pipeline.parts.features import Table
from mam_pipeline.parts.graph import Graph
from mam_pipeline.parts.groups import Masks
from mam_pipeline.types import FloatArray

Array = NDArray[np.float32]
CLIP = 5.0  # normalised features are cut here


@dataclass(frozen=True)
class Encoded:
    """What the network made of one object.

    Attributes:
        same: (E,), move: (P,) probabilities. node: (P, D), edge: (E, D), whole: (D,) states.
    """

    same: FloatArray
    move: FloatArray
    node: Array
    edge: Array
    whole: Array


@dataclass(frozen=True)
class Reading:
    """An object's bonds, and how each network sees it.

    Attributes:
        same: (E,), move: (P,) probabilities, of trees and networks together.
        views: the networks with what each of them made of the object; empty without networks.
    """

    same: FloatArray
    move: FloatArray
    views: tuple[tuple[Network, Encoded], ...] = ()

    def group_columns(self, graph: Graph, masks: Masks) -> dict[str, FloatArray]:
        """What the networks say of groups (C, P): expected overlap, odds of the types."""
        if not self.views:
            return {}
        answers = [network.judge(graph, seen, masks) for network, seen in self.views]
        odds = np.mean([a[1] for a in answers], axis=0)
        columns = {"net_value": np.asarray(np.mean([a[0] for a in answers], axis=0))}
        return columns | {f"net_{n}": odds[:, k] for k, n in enumerate(("hinge", "spin", "slide"))}


def read(
    networks: Sequence[Network], graph: Graph, unary: Table, pairs: Table, same: FloatArray,
    move: FloatArray,
) -> Reading:  # fmt: skip
    """Ask the networks and take their bonds together with those of the trees, `same` and `move`."""
    views = tuple((network, network.encode(graph, unary, pairs)) for network in networks)
    if not views:
        return Reading(same, move)
    theirs = [np.mean([getattr(v, name) for _, v in views], axis=0) for name in ("same", "move")]
    return Reading(together(same, theirs[0]), together(move, theirs[1]), views)


def together(a: FloatArray, b: FloatArray) -> FloatArray:
    """Two opinions as one: the mean of their log-odds."""
    out: FloatArray = expit(0.5 * (log_odds(a) + log_odds(b)))
    return out


def log_odds(p: FloatArray) -> FloatArray:
    """Log-odds of probabilities, cut at 1e-4."""
    p = np.clip(p, 1e-4, 1 - 1e-4)
    out: FloatArray = np.log(p / (1 - p))
    return out


class Network:
    """The trained network.

    Args:
        weights: arrays by name, as `reason.train_network` packs them.
    """

    def __init__(self, weights: Mapping[str, NDArray]) -> None:
        self._w = {k: np.asarray(v, np.float32) for k, v in weights.items() if v.dtype.kind == "f"}
        self._names = {k: tuple(map(str, weights[k])) for k in ("primitive_names", "pair_names")}
        self.layers = sum(k.startswith("ln.") for k in weights) // 2

    def encode(self, graph: Graph, unary: Table, pairs: Table) -> Encoded:
        """Run the messages over one object's graph.

        Raises:
            ValueError: the weights were trained on features that are not there.
        """
        nodes = unary.columns(self._names["primitive_names"])
        edges = pairs.columns(self._names["pair_names"])
        h = self._mlp("inu", normalised(nodes, self._w["primitive_scale"]))
        e = self._mlp("inq", normalised(edges, self._w["pair_scale"]))
        i, j = graph.pairs[:, 0], graph.pairs[:, 1]
        ends, starts = np.concatenate([i, j]), np.concatenate([j, i])
        count, width = h.shape
        degree = np.maximum(np.bincount(ends, minlength=count), 1)[:, None].astype(np.float32)
        for k in range(self.layers):
            whole = h.mean(axis=0)
            wide = np.concatenate(
                [e, h[i] + h[j], np.abs(h[i] - h[j]), np.broadcast_to(whole, (len(e), width))], 1
            )
            e = self._norm(f"le.{k}", e + self._mlp(f"edge.{k}", wide))
            both = np.concatenate([e, e])
            total, most = np.zeros_like(h), np.full_like(h, -5.0)
            np.add.at(total, ends, expit(both) * h[starts])
            np.maximum.at(most, ends, both + h[starts])
            wide = np.concatenate([h, total / degree, most, np.broadcast_to(whole, h.shape)], 1)
            h = self._norm(f"ln.{k}", h + self._mlp(f"node.{k}", wide))
        whole = h.mean(axis=0)
        same = self._mlp("same", np.concatenate([e, h[i] + h[j], np.abs(h[i] - h[j])], 1))[:, 0]
        move = self._mlp("move", np.concatenate([h, np.broadcast_to(whole, h.shape)], 1))[:, 0]
        return Encoded(expit(same.astype(float)), expit(move.astype(float)), h, e, whole)

    def judge(self, graph: Graph, seen: Encoded, masks: Masks) -> tuple[FloatArray, FloatArray]:
        """Expected overlap (C,) of groups (C, P) with a true part, and odds (C, 3) of their type.

        The types are hinge, spin and slide.
        """
        h = self._mlp(
            "gp", np.concatenate([seen.node, np.broadcast_to(seen.whole, seen.node.shape)], 1)
        )
        i, j = graph.pairs[:, 0], graph.pairs[:, 1]
        inner, cut = masks[:, i] & masks[:, j], masks[:, i] ^ masks[:, j]
        weight = masks * (np.sqrt(graph.area) + 1e-4).astype(np.float32)
        mean = weight @ h / np.maximum(weight.sum(axis=1), 1e-6)[:, None]
        same = np.clip(seen.same, 1e-7, 1 - 1e-7)
        logit = np.log(same / (1 - same))
        columns = [
            mean, most_of(masks, h), mean_of(inner, seen.edge), mean_of(cut, seen.edge),
            most_of(cut, seen.edge), np.broadcast_to(seen.whole, mean.shape),
            np.log(masks.sum(axis=1))[:, None], np.log1p(cut.sum(axis=1))[:, None],
            mean_of(inner, log_expit(logit)[:, None]), mean_of(cut, log_expit(-logit)[:, None]),
        ]  # fmt: skip
        wide = np.concatenate(columns, axis=1).astype(np.float32)
        out = self._linear("gout", gelu(self._mlp("group", wide))).astype(np.float64)
        odds = np.exp(out[:, 1:] - out[:, 1:].max(axis=1, keepdims=True))
        return expit(out[:, 0]), odds / odds.sum(axis=1, keepdims=True)

    def _linear(self, name: str, x: Array) -> Array:
        return x @ self._w[f"{name}.weight"].T + self._w[f"{name}.bias"]

    def _mlp(self, name: str, x: Array) -> Array:
        return self._linear(f"{name}.2", gelu(self._linear(f"{name}.0", x)))

    def _norm(self, name: str, x: Array) -> Array:
        centred = x - x.mean(axis=1, keepdims=True)
        scale = np.sqrt((centred**2).mean(axis=1, keepdims=True) + 1e-5)
        return centred / scale * self._w[f"{name}.weight"] + self._w[f"{name}.bias"]


def load_network(file: Traversable) -> Network:
    """A network from the arrays that `reason.train_network` wrote."""
    with np.load(BytesIO(file.read_bytes()), allow_pickle=False) as arrays:
        return Network(dict(arrays))


def gelu(x: Array) -> Array:
    """The Gaussian error linear unit."""
    return (0.5 * x * (1 + erf(x / np.sqrt(2.0)))).astype(np.float32)


def normalised(values: NDArray, scale: Array) -> Array:
    """Feature rows (n, F) by median and spread (2, F), cut; what is unknown becomes 0."""
    z = np.clip((values - scale[0]) / scale[1], -CLIP, CLIP)
    return np.nan_to_num(z, nan=0.0).astype(np.float32)


def mean_of(member: Masks, x: NDArray) -> NDArray:
    """(C, D) mean of the rows (n, D) that each group (C, n) holds; 0 for none."""
    share = member / np.maximum(member.sum(axis=1, keepdims=True), 1)
    return np.asarray(share.astype(np.float32) @ x)


def most_of(member: Masks, x: NDArray) -> NDArray:
    """(C, D) largest of the rows (n, D) that each group (C, n) holds; -9 for none."""
    out = np.full((len(member), x.shape[1]), -9.0, dtype=np.float32)
    for k, row in enumerate(member):
        if row.any():
            out[k] = np.maximum(x[row].max(axis=0), -9.0)
    return out
