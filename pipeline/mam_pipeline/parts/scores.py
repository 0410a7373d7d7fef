"""The scores the reasoner goes by: boosted trees and graph networks, or hand-set rules.

Weights are LightGBM's text format and NumPy arrays, packed; `reason.train` writes them from
procedural objects.
"""

from __future__ import annotations

import gzip
import json
from collections.abc import Mapping, Sequence
from functools import lru_cache
from importlib import resources
from importlib.resources.abc import Traversable
from typing import Any, Literal, Protocol

import numpy as np

from mam_pipeline.parts import hand_scores
from mam_pipeline.parts.configurations import promise
from mam_pipeline.parts.features import Table
from mam_pipeline.parts.graph import Graph
from mam_pipeline.parts.network import Network, Reading, load_network, read
from mam_pipeline.types import FloatArray

Kind = Literal["authored", "fused"]
MODELS = ("same", "move", "value", "revise", "subtype", "choose")


class Scores(Protocol):
    """Everything that may be learned.

    Attributes:
        least: confidence below which a candidate of the best set stays in the base all the same,
            unless it is the set's best.
    """

    least: float

    def read(self, graph: Graph, unary: Table, pairs: Table) -> Reading:
        """How likely each pair is one rigid body and each primitive moves; views of networks."""

    def value(self, groups: Table) -> FloatArray:
        """(C,) expected overlap of a candidate with a true part, each looked at alone."""

    def revise(self, groups: Table) -> FloatArray:
        """(C,) the same, knowing the value of its rivals and twins (`with_rivals`)."""

    def subtype(self, groups: Table) -> FloatArray:
        """(C, 3) probabilities of hinge, spin, slide."""

    def choose(self, sets: Table) -> FloatArray:
        """(M,) how good whole sets of candidates are beside each other (mIoU and count)."""

    def confidence(self, value: FloatArray) -> FloatArray:
        """(C,) calibrated probability that a chosen candidate is a true part."""


class HandScores:
    """The hand-set rules as scores."""

    threshold = 0.55
    least = 0.0

    def read(self, graph: Graph, unary: Table, pairs: Table) -> Reading:
        """See `hand_scores.same_part` and `hand_scores.may_move`."""
        return Reading(hand_scores.same_part(pairs), hand_scores.may_move(unary))

    def value(self, groups: Table) -> FloatArray:
        """See `hand_scores.part_value`."""
        return hand_scores.part_value(groups)

    def revise(self, groups: Table) -> FloatArray:
        """Rules know no rivals."""
        return groups.column("value").astype(np.float64)

    def subtype(self, groups: Table) -> FloatArray:
        """See `hand_scores.subtype_odds`."""
        return hand_scores.subtype_odds(groups)

    def choose(self, sets: Table) -> FloatArray:
        """What the set gains over the threshold."""
        out: FloatArray = sets.column("value_sum") - self.threshold * sets.column("number")
        return out

    def confidence(self, value: FloatArray) -> FloatArray:
        """Rules know no calibration: never above one half."""
        out: FloatArray = 0.5 * value
        return out


class LearnedScores:
    """Boosted trees: the mean of several members that were trained on corpora of their own.

    Args:
        members: boosters by name (MODELS); a member may leave whole sets to the others.
        settings: the calibration curve, (value, odds) pairs; weight of `promise` (default 0);
            `least` (default 0).
        networks: the graph networks whose views the members were trained on.
    """

    def __init__(
        self, members: Sequence[Mapping[str, Any]], settings: Mapping[str, Any],
        networks: Sequence[Network] = (),
    ) -> None:  # fmt: skip
        self.members = tuple(members)
        self.networks = tuple(networks)
        self.least = float(settings.get("least", 0.0))
        self._promise = float(settings.get("promise", 0.0))
        self._curve = np.asarray(settings["calibration"], dtype=np.float64)  # (k, 2) value, odds

    def _predict(self, name: str, features: Table) -> FloatArray:
        boosters = [m[name] for m in self.members if name != "choose" or name in m]
        answers = []
        for booster in boosters:
            rows = features.columns(tuple(booster.feature_name()))
            if len(rows) == 0:
                return np.zeros(0)
            answers.append(booster.predict(rows, num_threads=1))
        out: FloatArray = np.mean(answers, axis=0)
        return out

    def read(self, graph: Graph, unary: Table, pairs: Table) -> Reading:
        """Pair and primitive models, with the networks."""
        same, move = self._predict("same", pairs), self._predict("move", unary)
        return read(self.networks, graph, unary, pairs, same, move)

    def value(self, groups: Table) -> FloatArray:
        """Group model."""
        return self._predict("value", groups)

    def revise(self, groups: Table) -> FloatArray:
        """Group model that sees the rivals."""
        return self._predict("revise", groups)

    def subtype(self, groups: Table) -> FloatArray:
        """Type model."""
        return self._predict("subtype", groups).reshape(-1, 3)

    def choose(self, sets: Table) -> FloatArray:
        """Rank by the set model, and what the candidates promise by themselves."""
        return self._predict("choose", sets) + self._promise * promise(sets)

    def confidence(self, value: FloatArray) -> FloatArray:
        """Calibrated on validation objects: how often such a candidate was a true part."""
        out: FloatArray = np.interp(value, self._curve[:, 0], self._curve[:, 1])
        return out


@lru_cache(maxsize=2)
def load_scores(kind: Kind = "authored") -> Scores:
    """The learned scores of this package, or the rules when it was built without weights.

    Args:
        kind: "authored" for meshes of separate pieces, "fused" for one surface (`Graph.is_fused`).
    """
    folder = _folder(kind)
    file = folder / "settings.json"
    if not file.is_file():
        return HandScores()
    import lightgbm

    settings = json.loads(file.read_text(encoding="utf-8"))
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
    return LearnedScores(members, settings, networks)


def _folder(kind: Kind) -> Traversable:
    return resources.files("mam_pipeline.parts") / "weights" / kind
