"""The last word on parts: the joint estimator is asked, and the parts are final.

The reasoner says what the parts are and how they move. A part whose own joint is unclear, and that
has to be clear to move by itself, goes with what it hangs on (`rules.minor`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from mam_pipeline.dormant import put_to_sleep
from mam_pipeline.joints.estimate import JointEstimator, topological_order
from mam_pipeline.parts.rules.fittings import carried
from mam_pipeline.rules import ALL_RULES, Rules
from mam_pipeline.types import KinematicTree, Mesh, Primitives


@dataclass(frozen=True)
class SettleLimits:
    """Which parts are stuck.

    Attributes:
        stuck: share of its way below which a part is stuck.
        doubtful: confidence of a joint below which such a part is dormant; what is surer stays,
            for its mesh may be cut badly.
    """

    stuck: float = 0.05
    doubtful: float = 0.5


SETTLE = SettleLimits()


def settled(
    tree: KinematicTree, mesh: Mesh, primitives: Primitives, least: Mapping[int, float],
    seed: int = 0, rules: Rules = ALL_RULES,
) -> KinematicTree:  # fmt: skip
    """The tree with final parts; what has provenance "user" is never altered.

    Args:
        mesh: with one copy of every face. least: by node, the confidence from which it moves by
            itself (`parts.tree.clear_from`).
    """
    estimator = JointEstimator(mesh, primitives, seed, rules)
    own = estimator.turned(tree)
    found = {i: estimator.estimate(own, i) for i in topological_order(own)}
    confidence = {
        i: own.nodes[i].confidence * (1.0 if e is None else e.sure) for i, e in found.items()
    }
    tree = carried(tree, confidence, least)
    if not rules.abstain or primitives.is_fused:
        return tree
    shares = {own.nodes[i].name: e.share for i, e in found.items()
              if e is not None and confidence[i] < SETTLE.doubtful}  # fmt: skip
    return put_to_sleep(tree, {
        i: f"it is stuck: {100 * shares[node.name]:.0f} % of its usual way is free"
        for i, node in enumerate(tree.nodes)
        if node.provenance == "inferred" and shares.get(node.name, 1.0) < SETTLE.stuck
    })  # fmt: skip
