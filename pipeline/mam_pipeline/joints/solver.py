"""The solvers: from parts and their subtypes to joints with axes, origins and limits.

A solver estimates the joints of the tree that it is given; the tree it never changes.
"""

from __future__ import annotations

from dataclasses import asdict, replace
from importlib.resources.abc import Traversable
from typing import Any, Self

import numpy as np

from mam_pipeline.backends import Availability
from mam_pipeline.dormant import awake, hosts
from mam_pipeline.geometry.sampling import unit
from mam_pipeline.joints.estimate import (
    JointEstimator,
    PartFaces,
    topological_order,
)
from mam_pipeline.joints.limits import Limits
from mam_pipeline.joints.ranker import WEIGHTS
from mam_pipeline.joints.straight import turned_joint
from mam_pipeline.joints.twins import with_alike_ranges
from mam_pipeline.rules import ALL_RULES, Rules
from mam_pipeline.segment.topology import without_repeats
from mam_pipeline.types import (
    Articulation,
    DormantPart,
    FloatArray,
    Joint,
    JointCandidate,
    KinematicTree,
    Link,
    Mesh,
    PartNode,
    Primitives,
    RangeBasis,
    RangeRule,
)
from mam_pipeline.weights import place_of

RIGHT = "right"  # chance that the joint is right, in the evidence of a part
SHOWN = 6  # hypotheses that the report shows


class EmbeddedSolver:
    """Ranked hypotheses and limits by our rule: the default, because it measures best.

    Args:
        rules: hand rules that are followed.
    """

    def __init__(self, rules: Rules = ALL_RULES) -> None:
        self.rules = rules

    @classmethod
    def available(cls) -> Availability:
        """Always: it needs nothing but the package."""
        return Availability(True, version="1")

    @classmethod
    def weights(cls) -> list[Traversable]:
        """Those of the joint ranker."""
        return [place_of(WEIGHTS)]

    def with_rules(self, rules: Rules) -> Self:
        """See `rules.Ruled`."""
        return type(self)(rules)

    def solve(
        self, mesh: Mesh, primitives: Primitives, tree: KinematicTree, seed: int = 0
    ) -> Articulation:
        """Estimate every joint of the tree.

        Args:
            mesh: asset frame. primitives: its faces' labels. tree: parts, parents and subtypes.
            seed: of all sampling.

        Returns:
            One link per node that is awake, one joint per such node but the base, parents first.
            Dormant parts that could move are beside them, each as if all parts were awake.
        """
        estimator = JointEstimator(*without_repeats(mesh, primitives), seed, self.rules)
        moving = awake(tree)
        turned, whole = estimator.turned(moving), estimator.turned(tree)
        joints = [self._joint(estimator, turned, i) for i in topological_order(moving)]
        joints = self._alike(estimator, turned, joints)
        asleep = [i for i, node in enumerate(tree.nodes) if node.dormant]
        sleeping = [self._joint(estimator, whole, i) for i in asleep]
        if estimator.rotation is not None:
            joints = [turned_joint(joint, estimator.rotation.T) for joint in joints]
            sleeping = [turned_joint(joint, estimator.rotation.T) for joint in sleeping]
        index = {node.name: k for k, node in enumerate(moving.nodes)}
        host = hosts(tree)
        dormant = tuple(
            DormantPart(
                _link(tree.nodes[i], primitives),
                replace(joint, parent=index[tree.nodes[host[i]].name], child=-1,
                        dormant=tree.nodes[i].dormant),
            )
            for i, joint in zip(asleep, sleeping) if joint.type != "fixed"
        )  # fmt: skip
        links = tuple(_link(node, primitives) for node in moving.nodes)
        return Articulation(mesh, links, tuple(joints), dormant=dormant)

    def _alike(
        self, estimator: JointEstimator, tree: KinematicTree, joints: list[Joint]
    ) -> list[Joint]:
        """The joints of the tree after a look at each other."""
        return with_alike_ranges(estimator, tree, joints)

    def _joint(self, estimator: JointEstimator, tree: KinematicTree, index: int) -> Joint:
        node = tree.nodes[index]
        found = estimator.estimate(tree, index)
        if found is None:
            return fixed_joint(estimator.mesh, node, index, estimator.faces(tree, index))
        evidence = {
            "solver": "embedded",
            "contact": dict(found.contact),
            "candidates": [_plain(c) for c in found.candidates[:SHOWN]],
            "limits": limits_evidence(found.limits, node),
        }
        confidence = confidence_of(node, found.sure)
        chosen = found.chosen
        return joint_of(node, index, chosen.axis, chosen.origin, found.limits, confidence, evidence)


def confidence_of(node: PartNode, sure: float) -> float:
    """Chance that the joint of a node is right.

    Args:
        sure: that its line is, if part and type are. Where nobody but the engine speaks for a part
            that moves, the chance of all three was calibrated with it (`mam_pipeline.parts`).
    """
    judged = node.provenance == "inferred" and not (node.dormant or "accepted" in node.evidence)
    if judged and RIGHT in node.evidence:
        return float(node.evidence[RIGHT])
    return node.confidence * sure


def joint_of(
    node: PartNode, index: int, axis: FloatArray, origin: FloatArray, limits: Limits,
    confidence: float, evidence: dict[str, Any],
) -> Joint:  # fmt: skip
    """The joint of a node with a line and a range that were found."""
    subtype = "slide" if limits.type == "prismatic" else node.subtype
    return Joint(
        f"{node.name}_joint", limits.type, subtype, node.parent, index, unit(axis),
        np.asarray(origin, dtype=np.float64), float(limits.lower), float(limits.upper),
        float(limits.closed), float(limits.open), confidence=float(np.clip(confidence, 0.0, 1.0)),
        evidence=evidence, provenance=node.provenance,
        basis=RangeBasis(
            range_rule(limits, node), limits.share, limits.sibling_at is not None, limits.of_part
        ),
    )  # fmt: skip


def _link(node: PartNode, primitives: Primitives) -> Link:
    faces = np.flatnonzero(np.isin(primitives.labels, node.primitives))
    return Link(node.name, node.kind, faces, node.primitives)


def fixed_joint(mesh: Mesh, node: PartNode, index: int, faces: PartFaces) -> Joint:
    """The joint of a node that does not move, at the middle of its box."""
    used = mesh.vertices[np.unique(mesh.faces[faces.own])] if len(faces.own) else np.zeros((1, 3))
    return Joint(
        f"{node.name}_joint", "fixed", "fixed", node.parent, index, np.array([0.0, 0.0, 1.0]),
        0.5 * (used.min(axis=0) + used.max(axis=0)), 0.0, 0.0, confidence=node.confidence,
        provenance=node.provenance,
    )  # fmt: skip


def _plain(c: JointCandidate) -> dict[str, Any]:
    return {
        "subtype": c.subtype, "axis": [round(float(v), 5) for v in c.axis],
        "origin": [round(float(v), 5) for v in c.origin], "score": round(float(c.score), 4),
        **{k: round(float(v), 4) for k, v in c.evidence.items()}, **_ranking(c),
    }  # fmt: skip


def _ranking(c: JointCandidate) -> dict[str, float]:
    """What the ranking said of a hypothesis, for the report."""
    said = {"kind_probability": c.kind_probability, "within_kind": c.within_kind}
    if c.travel is not None:
        said |= {f"usual_{k}": v for k, v in asdict(c.travel).items()}
    return {k: round(float(v), 4) for k, v in said.items() if v is not None}


def range_rule(limits: Limits, node: PartNode) -> RangeRule:
    """Why a range is what it is; limits that a photo's hints hold are as usual for such parts."""
    return node.evidence.get("travel", limits.rule) if limits.rule == "given" else limits.rule


def limits_evidence(limits: Limits, node: PartNode) -> dict[str, Any]:
    """How the range came about, for the report."""
    said = {
        "rule": range_rule(limits, node),
        "by": node.provenance,
        **limits.evidence,
        "share": limits.share,
    }
    if "range" in node.evidence:
        said["why"] = node.evidence["range"]
    if limits.sibling_at is not None:
        said["blocked_by_sibling_at"] = limits.sibling_at
    return said
