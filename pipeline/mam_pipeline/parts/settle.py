"""The last word on parts: the joint estimator is asked, and the parts are final.

The reasoner says what the parts are and how they move. Where a part is stuck as it is, small pieces
that stop it go along with it (`rules.blockers`); a part whose own joint is unclear, and that has to
be clear to move by itself, goes with what it hangs on (`rules.fittings`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

from mam_pipeline.dormant import put_to_sleep
from mam_pipeline.joints.estimate import Estimate, JointEstimator, topological_order
from mam_pipeline.joints.limits import Surroundings
from mam_pipeline.parts.rules.blockers import BLOCKER, take_along
from mam_pipeline.parts.rules.fittings import carried
from mam_pipeline.rules import ALL_RULES, Rules
from mam_pipeline.types import KinematicTree, Mesh, Primitives


@dataclass(frozen=True)
class SettleLimits:
    """How the parts that are stuck are freed.

    Attributes:
        tries: rounds: pieces in a part's way may hide others.
        freer: times the share of its way that a part must go with what goes along.
        stuck: share of its way below which a part is stuck for good.
        doubtful: confidence of a joint below which such a part is dormant; what is surer stays,
            for its mesh may be cut badly.
    """

    tries: int = 3
    freer: float = 1.2
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
    if rules.blockers:
        for i in found:
            if own.nodes[i].provenance != "user":
                own, found[i] = _freed(estimator, own, i, found[i])
    confidence = {
        i: own.nodes[i].confidence * (1.0 if e is None else e.sure) for i, e in found.items()
    }
    nodes = (
        replace(node, primitives=changed.primitives, parent=changed.parent)
        for node, changed in zip(tree.nodes, own.nodes)
    )
    tree = carried(replace(tree, nodes=tuple(nodes)), confidence, least)
    if not rules.abstain or primitives.is_fused:
        return tree
    shares = {own.nodes[i].name: e.share for i, e in found.items()
              if e is not None and confidence[i] < SETTLE.doubtful}  # fmt: skip
    return put_to_sleep(tree, {
        i: f"it is stuck: {100 * shares[node.name]:.0f} % of its usual way is free"
        for i, node in enumerate(tree.nodes)
        if node.provenance == "inferred" and shares.get(node.name, 1.0) < SETTLE.stuck
    })  # fmt: skip


def _freed(
    estimator: JointEstimator, tree: KinematicTree, index: int, found: Estimate | None
) -> tuple[KinematicTree, Estimate | None]:
    """The tree in which what stops a part goes along with it, as long as that frees it."""
    for _ in range(SETTLE.tries):
        if found is None or found.share >= BLOCKER.stuck:
            break
        faces = estimator.faces(tree, index)
        around = Surroundings.of(estimator.mesh, faces.moving, faces.static, estimator.seed)
        labels = estimator.primitives.labels
        freed = take_along(estimator.mesh, labels, tree, index, found, around)
        again = None if freed is None else estimator.estimate(freed, index)
        if freed is None or again is None or again.share < SETTLE.freer * found.share:
            break
        tree, found = freed, again
    return tree, found
