"""Items as flat tensors of small numbers, from which batches are cut on the CPU or on a GPU.

This module and those that train on it need torch and nothing else of the project, so that the file
of a corpus can be trained on where only torch is installed.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray
from safetensors import safe_open
from safetensors.torch import save_file
from torch import Tensor

if TYPE_CHECKING:
    from mam_training.articulation.items import Item

CLIP = 5.0
"""Normalised features are cut here."""
MOST_COUNTED = 12
"""Larger numbers of parts are told as this one."""
STEP = CLIP / 127


@dataclass
class Corpus:
    """Objects, one after another.

    Attributes:
        unary: (P, U) and pair: (E, G) int8, normalised features in units of `STEP`. ends: (E, 2).
        geometry: (P, 21) low, high, size, spin axis, axes; the middle of the object is the origin
            of x and y. weight: (P,) purity; area: (P,). link: (P,) owner of each primitive within
            its object; kind: (P,) its word. subtype: (P,), -1 still. axis, origin: (P, 3), 0 for
            what is still.
        first: (N + 1,) rows of the objects' primitives; edge: (N + 1,) of their pairs.
        word, fused, movable: (N,) the object's word, whether it is fused, number of parts.
        links: (N,) number of links. times: (N,) how often the object is seen in a pass.
        source: (N,) which of the sources it is from.
    """

    unary: Tensor
    pair: Tensor
    ends: Tensor
    geometry: Tensor
    weight: Tensor
    area: Tensor
    link: Tensor
    kind: Tensor
    subtype: Tensor
    axis: Tensor
    origin: Tensor
    first: Tensor
    edge: Tensor
    word: Tensor
    fused: Tensor
    movable: Tensor
    links: Tensor
    times: Tensor
    source: Tensor

    def __len__(self) -> int:
        return len(self.word)

    @property
    def sizes(self) -> NDArray:
        """(N,) number of primitives."""
        return np.diff(self.first.cpu().numpy())

    def to(self, device: str) -> Corpus:
        """The corpus on a device."""
        return Corpus(**{k: v.to(device) for k, v in vars(self).items()})

    def without(self, source: int) -> Corpus:
        """The corpus in which a source's objects are never seen."""
        return replace(self, times=torch.where(self.source == source, 0, self.times))

    def save(self, path: Path, about: dict[str, object]) -> None:
        """Write the tensors, and `about` as their description."""
        path.parent.mkdir(parents=True, exist_ok=True)
        save_file(
            {k: v.contiguous() for k, v in vars(self).items()}, str(path),
            {"about": json.dumps(about)},
        )  # fmt: skip

    @classmethod
    def load(cls, path: Path) -> tuple[Corpus, dict]:
        """What `save` wrote."""
        with safe_open(str(path), "pt") as file:
            tensors = {k: file.get_tensor(k) for k in file.keys()}  # noqa: SIM118
            return cls(**tensors), json.loads(file.metadata()["about"])


def corpus_of(
    items: Sequence[Item], scales: Sequence[NDArray], times: Sequence[int], sources: Sequence[int]
) -> Corpus:
    """Items as a corpus.

    Args:
        scales: (2, F) middle and spread of the columns of primitives and of pairs.
        times: how often each item is seen in a pass. sources: of each item.
    """
    rows: dict[str, list[NDArray]] = {}
    for item in items:
        middle = (item.low.min(0) + item.high.max(0)) / 2
        middle = np.array([middle[0], middle[1], 0.0])
        owner = item.link.astype(int)
        p = len(owner)
        moving = np.intersect1d(np.flatnonzero(item.subtype >= 0), owner)
        one = {
            "unary": small(item.unary, scales[0]), "pair": small(item.pair, scales[1]),
            "ends": item.ends.astype(np.int16),
            "geometry": np.concatenate([
                item.low - middle, item.high - middle, item.size, item.spin,
                item.axes.reshape(p, 9),
            ], 1).astype(np.float16),
            "weight": item.purity.astype(np.float16), "area": item.area.astype(np.float32),
            "link": owner.astype(np.int16), "kind": item.kind.astype(np.int16)[owner],
            "subtype": item.subtype.astype(np.int8)[owner],
            "axis": np.nan_to_num(item.axis[owner]).astype(np.float16),
            "origin": np.nan_to_num(item.origin[owner] - middle).astype(np.float16),
            "first": np.array([p]), "edge": np.array([len(item.ends)]),
            "word": np.array([item.word]), "fused": np.array([int(item.fused)]),
            "movable": np.array([len(moving)]), "links": np.array([len(item.kind)]),
        }  # fmt: skip
        for name, value in one.items():
            rows.setdefault(name, []).append(value)
    flat = {k: np.concatenate(v) for k, v in rows.items()}
    for name in ("first", "edge"):
        flat[name] = np.concatenate([[0], np.cumsum(flat[name])])
    flat["times"], flat["source"] = np.asarray(times, np.int64), np.asarray(sources, np.int64)
    return Corpus(**{k: torch.from_numpy(v) for k, v in flat.items()})


def small(values: NDArray, scale: NDArray) -> NDArray:
    """Features (n, F), normalised, as int8."""
    from mam_pipeline.parts.network import normalised

    return np.round(normalised(values.astype(np.float32), scale) / STEP).astype(np.int8)


def spread(rows: NDArray) -> NDArray:
    """(2, F) median and scale of columns (n, F)."""
    low, high = np.nanpercentile(rows, 10, axis=0), np.nanpercentile(rows, 90, axis=0)
    wide = high - low
    wide = np.where(wide < 1e-6, 2.5 * np.nanstd(rows, axis=0) + 1e-6, wide)
    return np.stack([np.nanmedian(rows, axis=0), wide / 1.5]).astype(np.float32)
