"""What the joint hypotheses say of the chosen parts: their types are settled with both views.

The reasoner judges a part's type by its shape and place, the joint ranker by how it could move;
each knows what the other cannot see. The ranked hypotheses stay with the part, so the solver
need not make them again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from mam_pipeline.joints.candidates import kind_probabilities, rank_hypotheses
from mam_pipeline.joints.straight import straightened, turned_tree
from mam_pipeline.parts.tree import SUBTYPES
from mam_pipeline.rules import ALL_RULES, Rules
from mam_pipeline.types import (
    FloatArray,
    JointCandidate,
    JointSubtype,
    KinematicTree,
    Mesh,
    PartNode,
    Primitives,
)


@dataclass(frozen=True)
class MotionWeights:
    """Exponents of the joint ranker's odds beside the reasoner's when a part's type is decided.

    Attributes:
        authored: on authored meshes: 0.75 to 1 is best on 505 validation parts.
        fused: on fused meshes: best on 217 validation parts.
    """

    authored: float = 1.0
    fused: float = 0.5


MOTION = MotionWeights()


def with_joints(
    tree: KinematicTree, odds: FloatArray, mesh: Mesh, primitives: Primitives, seed: int = 0,
    rules: Rules = ALL_RULES,
) -> KinematicTree:  # fmt: skip
    """Return the tree with joint candidates on every part, and types that both views support.

    Args:
        odds: (N - 1, 3) what the reasoner says of every part: hinge, spin, slide (SUBTYPES).
    """
    if len(tree.nodes) < 2:
        return tree
    mesh, frame, rotation = straightened(mesh)
    owner = np.zeros(primitives.count, dtype=np.int64)
    for index, node in enumerate(tree.nodes):
        owner[list(node.primitives)] = index
    face_node = owner[primitives.labels]
    faces = [np.flatnonzero(face_node == k) for k in range(len(tree.nodes))]
    nodes = [tree.nodes[0]]
    for index, node in enumerate(tree.nodes[1:], start=1):
        moving = np.isin(face_node, _carried(tree, index))
        candidates = rank_hypotheses(
            mesh,
            np.flatnonzero(moving),
            np.flatnonzero(~moving),
            frame=frame,
            parent_faces=np.flatnonzero(face_node == node.parent),
            others=[f for k, f in enumerate(faces) if k > 0 and not moving[f].any()],
            seed=seed,
            fused=primitives.is_fused,
            rules=rules,
        )
        motion = kind_probabilities(candidates)
        own: dict[str, float] = dict(zip(SUBTYPES, map(float, odds[index - 1])))
        weight = MOTION.fused if primitives.is_fused else MOTION.authored
        nodes.append(_typed(node, own, motion, tuple(candidates), weight))
    found = KinematicTree(tuple(nodes))
    return found if rotation is None else turned_tree(found, rotation.T)


def _carried(tree: KinematicTree, index: int) -> list[int]:
    """The node and all that hangs on it."""
    out = [index]
    for k in out:
        out += [i for i, n in enumerate(tree.nodes) if n.parent == k]
    return out


def _typed(
    node: PartNode, own: Mapping[str, float], odds: Mapping[str, float],
    candidates: tuple[JointCandidate, ...], weight: float,
) -> PartNode:  # fmt: skip
    """The node with its type decided by both views, and with its candidates.

    Args:
        own: of the subtypes, by the reasoner. odds: of the kinds of motion, by the joint ranker.
        weight: exponent of the latter.
    """
    slide = own["slide"] * max(odds.get("slide", 0.0), 0.02) ** weight
    turn_odds = odds.get("revolute", odds.get("hinge", 0.0) + odds.get("spin", 0.0))
    turn = (own["hinge"] + own["spin"]) * max(turn_odds, 0.02) ** weight
    share = slide / max(slide + turn, 1e-9)
    rotary: JointSubtype = "spin" if own["spin"] > own["hinge"] else "hinge"
    subtype: JointSubtype = "slide" if share > 0.5 else rotary
    sure = max(share, 1 - share)
    before = max(own.values())
    runner = node.runner_up
    if " instead (" in runner:
        other = rotary if subtype == "slide" else "slide"
        runner = f"{other} instead ({1 - sure:.2f})"
    evidence = dict(node.evidence) | {"motion_view": {k: round(v, 3) for k, v in odds.items()}}
    return replace(
        node,
        subtype=subtype,
        confidence=float(np.clip(node.confidence / max(before, 1e-6) * sure, 0.0, 1.0)),
        runner_up=runner,
        candidates=candidates,
        evidence=evidence,
    )
