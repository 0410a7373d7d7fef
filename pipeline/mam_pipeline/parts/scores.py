"""The scores the reasoner goes by: boosted trees and graph networks.

Weights are LightGBM's text format and NumPy arrays, packed; `mam_training.parts.train` makes them
from procedural objects.
"""

from __future__ import annotations

import gzip
import json
from collections.abc import Mapping, Sequence
from importlib.resources.abc import Traversable
from typing import Any, Literal

import numpy as np

from mam_pipeline.parts.configurations import promise
from mam_pipeline.parts.features import Table
from mam_pipeline.parts.graph import Graph
from mam_pipeline.parts.network import Network, Reading, load_network, read
from mam_pipeline.types import FloatArray
from mam_pipeline.weights import loaded

Kind = Literal["authored", "fused"]
WEIGHTS: dict[Kind, str] = {"authored": "parts/authored", "fused": "parts/fused"}
MODELS = ("same", "move", "value", "revise", "subtype", "choose")


class Scores:
    """Boosted trees: the mean of several members that were trained on corpora of their own.

    Args:
        members: boosters by name (MODELS); a member may leave whole sets to the others.
        settings: the calibration curve, (value, odds) pairs; weight of `promise` (default 0);
            `least` (default 0).
        networks: the graph networks whose views the members were trained on.

    Attributes:
        least: confidence below which a candidate of the best set stays in the base all the same,
            unless it is the set's best.
    """

    def __init__(
        self, members: Sequence[Mapping[str, Any]], settings: Mapping[str, Any],
        networks: Sequence[Network] = (),
    ) -> None:  # fmt: skip
        self.members = tuple(members)
        self.networks = tuple(networks)
        self.least = float(settings.get("least", 0.0))
        self._names: dict[int, tuple[str, ...]] = {}  # by booster
        self._promise = float(settings.get("promise", 0.0))
        self._curve = np.asarray(settings["calibration"], dtype=np.float64)  # (k, 2) value, odds

    def _predict(self, name: str, features: Table) -> FloatArray:
        boosters = [m[name] for m in self.members if name != "choose" or name in m]
        answers = []
        for booster in boosters:
            if id(booster) not in self._names:
                self._names[id(booster)] = tuple(booster.feature_name())
            rows = features.columns(self._names[id(booster)])
            if len(rows) == 0:
                return np.zeros(0)
            answers.append(booster.predict(rows, num_threads=1))
        out: FloatArray = np.mean(answers, axis=0)
        return out

    def read(self, graph: Graph, unary: Table, pairs: Table) -> Reading:
        """How likely each pair is one rigid body and each primitive moves; views of networks."""
        same, move = self._predict("same", pairs), self._predict("move", unary)
        return read(self.networks, graph, unary, pairs, same, move)

    def value(self, groups: Table) -> FloatArray:
        """(C,) expected overlap of a candidate with a true part, each looked at alone."""
        return self._predict("value", groups)

    def revise(self, groups: Table) -> FloatArray:
        """(C,) the same, knowing the value of its rivals and twins (`with_rivals`)."""
        return self._predict("revise", groups)

    def subtype(self, groups: Table) -> FloatArray:
        """(C, 3) probabilities of hinge, spin, slide."""
        return self._predict("subtype", groups).reshape(-1, 3)

    def choose(self, sets: Table) -> FloatArray:
        """(M,) how good whole sets of candidates are beside each other (mIoU and count)."""
        return self._predict("choose", sets) + self._promise * promise(sets)

    def confidence(self, value: FloatArray) -> FloatArray:
        """(C,) how often such a candidate was a true part, calibrated on validation objects."""
        out: FloatArray = np.interp(value, self._curve[:, 0], self._curve[:, 1])
        return out


def load_scores(kind: Kind = "authored") -> Scores:
    """The trained scores.

    Args:
        kind: "authored" for meshes of separate pieces, "fused" for one surface (`Graph.is_fused`).
    """
    return loaded(WEIGHTS[kind], _read_scores)


def _read_scores(folder: Traversable) -> Scores:
    import lightgbm

    settings = json.loads((folder / "settings.json").read_text(encoding="utf-8"))
    members = []
    for member in settings["members"]:
        boosters = {}
        for name in MODELS:
            packed = folder / f"{member}_{name}.txt.gz"
            if packed.is_file():
                text = gzip.decompress(packed.read_bytes()).decode("utf-8")
                boosters[name] = lightgbm.Booster(model_str=text)
        members.append(boosters)
    networks = [load_network(folder / f"{n}.npz") for n in settings.get("networks", ())]
    return Scores(members, settings, networks)
