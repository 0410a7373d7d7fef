"""Whether a part is likely enough to move: what is not is dormant; and how sure its joint is.

The chance that a part is real is fitted on labels by eye of real objects, of which many have
nothing that moves, and so is the chance that its joint is right in all respects. What is withheld
is dormant (`mam_pipeline.dormant`). How many pieces an object has is no sign: that tells how it was
modelled.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from importlib.resources.abc import Traversable
from typing import Any

import numpy as np
from scipy.special import expit, logit

from mam_pipeline.dormant import put_to_sleep
from mam_pipeline.geometry.sampling import face_geometry
from mam_pipeline.joints.estimate import Estimate, JointEstimator
from mam_pipeline.joints.solver import RIGHT
from mam_pipeline.rules import ALL_RULES, Rules
from mam_pipeline.types import FloatArray, KinematicTree, Mesh, PartNode, Primitives
from mam_pipeline.weights import loaded

WEIGHTS = "parts/abstention"


@dataclass(frozen=True)
class AbstentionThresholds:
    """When a part that the file states is refused all the same.

    Attributes:
        free: share of its usual way that it must go: less is a veto by physics.
    """

    free: float = 0.05


ABSTENTION = AbstentionThresholds()
SIGNS = ("value", "confidence", "sure", "stays", "free", "alike", "best")


@dataclass(frozen=True)
class Bar:
    """The calibrated chance that a part is real, and from where it becomes one.

    Attributes:
        bias, weights: of a logistic function of the signs (`signs_of`).
        least: chance that a part must have.
        line: bias and weight on the log odds of this chance times that of the line: those of the
            chance that part, type and line are right.
    """

    bias: float
    weights: Mapping[str, float]
    least: float
    line: tuple[float, float]

    def keeps(self, chances: Sequence[float], told: int = 0) -> list[bool]:
        """Which parts of one object become parts, by their chances.

        Args:
            told: how many there are, as a person said: so many of the likeliest do, and no other.
        """
        if told:
            likeliest = sorted(range(len(chances)), key=lambda i: -chances[i])[:told]
            return [i in likeliest for i in range(len(chances))]
        return [chance >= self.least for chance in chances]

    def chance(self, signs: Mapping[str, float], more: float = 0.0) -> float:
        """Chance that a part is real; `more` are log odds from beside geometry."""
        total = self.bias + sum(self.weights[name] * signs[name] for name in self.weights)
        return float(expit(total + more))

    def right(self, chance: float, sure: float) -> float:
        """Chance that a joint is right: its part, its type and its line.

        Args:
            chance: that the part is real. sure: that the line is right, if part and type are.
        """
        return float(expit(self.line[0] + self.line[1] * _odds(chance * sure)))


def load_bar() -> Bar:
    """The fitted bar."""
    return loaded(WEIGHTS, _read_bar)


def _read_bar(folder: Traversable) -> Bar:
    said = json.loads((folder / "abstention.json").read_text(encoding="utf-8"))
    return Bar(said["bias"], said["weights"], said["least"], tuple(said["line"]))


def abstained(
    tree: KinematicTree, mesh: Mesh, primitives: Primitives, seed: int = 0,
    rules: Rules = ALL_RULES, told: int = 0,
) -> KinematicTree:  # fmt: skip
    """The tree in which too unlikely parts are dormant, with the signs of all parts noted.

    Args:
        mesh: with one copy of every face. The joints are asked for as the solver will ask.
        told: how many parts there are, as a person said; 0 where nobody did.
    """
    if len(tree.nodes) < 2:
        return tree
    estimator = JointEstimator(mesh, primitives, seed, rules)
    turned = estimator.turned(tree)
    found = {tree.nodes[i].name: estimator.estimate(turned, i) for i in range(1, len(tree.nodes))}
    area: FloatArray = np.bincount(
        primitives.labels, face_geometry(mesh.vertices, mesh.faces)[1], minlength=primitives.count
    ).astype(np.float64)
    signs = signs_of(tree, found, area)
    return withheld(tree, signs, load_bar() if rules.abstain else None, told)


def signs_of(
    tree: KinematicTree, found: Mapping[str, Estimate | None], area: FloatArray
) -> dict[str, dict[str, float]]:
    """What speaks for and against every part, by its name.

    Args:
        found: the estimated joint by the part's name. area: (P,) of the primitives, any unit.

    Returns:
        Numbers by the names in SIGNS, each within about -5 to 5: log odds of the scores, shares,
        and logarithms of counts.
    """
    parts = tree.nodes[1:]
    sizes = [float(area[list(n.primitives)].sum() / max(area.sum(), 1e-12)) for n in parts]
    values = [float(n.evidence.get("expected_overlap", n.confidence)) for n in parts]
    out = {}
    for node, size, value in zip(parts, sizes, values):
        estimate = found.get(node.name)
        alike = sum(np.isclose(size, s, rtol=0.1) for s in sizes) - 1
        out[node.name] = {
            "value": _odds(value),
            "confidence": _odds(node.confidence),
            "sure": 0.0 if estimate is None else estimate.sure,
            "stays": float(node.evidence.get("motion_view", {}).get("fixed", 0.0)),
            "free": 0.0 if estimate is None else float(np.clip(estimate.share, 0.0, 1.0)),
            "alike": float(np.log1p(alike)),
            "best": _odds(max(values)),
        }
    return out


def withheld(
    tree: KinematicTree, signs: Mapping[str, Mapping[str, float]], bar: Bar | None = None,
    told: int = 0,
) -> KinematicTree:  # fmt: skip
    """The tree in which the parts that are too unlikely are dormant.

    Args:
        signs: by name of the part. bar: None only notes the signs. told: see `Bar.keeps`.
    """
    nodes = [tree.nodes[0]]
    for node in tree.nodes[1:]:
        known = signs[node.name]
        said: dict[str, Any] = {"signs": {k: round(v, 4) for k, v in known.items()}}
        if bar is not None:
            alone = stated_chance(node) if known["free"] >= ABSTENTION.free else 0.0
            chance = max(bar.chance(known, said_odds(node)), alone)
            said |= {"chance": round(chance, 3), RIGHT: round(bar.right(chance, known["sure"]), 3)}
            if node.provenance == "inferred":
                node = replace(node, confidence=chance)
        nodes.append(replace(node, evidence={**node.evidence, **said}))
    tree = replace(tree, nodes=tuple(nodes))
    if bar is None:
        return tree
    # what a person or an animation shows moves for certain
    shown = [1.0 if n.provenance != "inferred" else n.evidence["chance"] for n in nodes[1:]]
    kept = bar.keeps(shown, told)
    below = {i: c for i, (c, keep) in enumerate(zip(shown, kept), start=1) if not keep}
    reason = f"{told} were told, and others are likelier" if told else ""
    why = {
        i: reason or f"its chance is {c:.2f}, and {bar.least:.2f} is needed"
        for i, c in below.items()
    }  # fmt: skip
    return put_to_sleep(tree, why, below)


def said_odds(node: PartNode) -> float:
    """Log odds that something beside geometry gives a part, a name or an animation; mostly 0."""
    return float(node.evidence.get("said", {}).get("odds", 0.0))


def stated_chance(node: PartNode) -> float:
    """That the file's structure means a part that moves, by itself; 0 where it says nothing."""
    return float(node.evidence.get("said", {}).get("chance", 0.0))


def _odds(share: float) -> float:
    return float(logit(np.clip(share, 0.01, 0.99)))
