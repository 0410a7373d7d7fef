"""The embedded reasoner: primitives and priors to parts, articulation tree and joint subtypes.

The counterpart of the paper's VLM (3.2, 3.3): learned scores on geometric and physical features
say which primitives belong together, which groups are parts, and how each moves.
"""

from __future__ import annotations

import numpy as np

from mam_pipeline.backends import Availability, KinematicPrior
from mam_pipeline.prior.probe import Probe
from mam_pipeline.reason.configurations import enumerate_sets, set_features
from mam_pipeline.reason.features import pair_features, primitive_features
from mam_pipeline.reason.graph import Graph, build_graph
from mam_pipeline.reason.group_features import joined, measured, with_rivals
from mam_pipeline.reason.groups import Masks, enumerate_groups, expand_groups
from mam_pipeline.reason.joint_view import with_joints
from mam_pipeline.reason.scores import Scores, load_scores
from mam_pipeline.reason.tree import Choice, build_tree
from mam_pipeline.types import KinematicTree, Mesh, Primitives

# the best candidate must reach this: whoever asks for an articulation mostly has something that
# moves; the confidence of such a part stays low
RESCUE = 0.2


class EmbeddedReasoner:
    """Learned grouping and typing on a CPU; the weights are package data."""

    def __init__(self, scores: Scores | None = None) -> None:
        self.scores = scores if scores is not None else load_scores()

    @classmethod
    def available(cls) -> Availability:
        """Always available."""
        return Availability(True, "learned on procedural objects; CPU", version="1")

    def reason(
        self, mesh: Mesh, primitives: Primitives, prior: KinematicPrior | None, seed: int = 0
    ) -> KinematicTree:
        """Group the primitives into parts; a tree with only the base when nothing may move."""
        probed = None if prior is None else prior.evidence.get("probe")
        probed = probed if isinstance(probed, Probe) else None
        graph = build_graph(mesh, primitives, seed, probed)
        masks, choice = decide(graph, prior, self.scores)
        return with_joints(build_tree(graph, masks, choice), mesh, primitives, seed)


def decide(graph: Graph, prior: KinematicPrior | None, scores: Scores) -> tuple[Masks, Choice]:
    """Candidates and what was chosen of them."""
    unary = primitive_features(graph, prior)
    pairs = pair_features(graph, unary, prior)
    reading = scores.read(graph, unary, pairs)
    same, move = reading.same, reading.move
    masks = enumerate_groups(graph, same, move)
    if len(masks) == 0 or graph.count < 2:
        empty = np.zeros((0, graph.count), dtype=bool)
        return empty, Choice((), np.zeros(0), np.zeros((0, 3)), np.zeros(0), 0.0)
    groups = measured(graph, masks, reading, prior)
    value = scores.value(groups)
    more = expand_groups(graph, masks, value, same)
    if len(more):
        masks = np.concatenate([masks, more])
        groups = joined(groups, measured(graph, more, reading, prior), masks)
        value = scores.value(groups)
    value = scores.revise(with_rivals(groups, masks, value))
    odds = scores.subtype(groups)
    chosen: list[int] = []
    if value.max() > RESCUE:
        sets = enumerate_sets(masks, groups, value)
        quality = scores.choose(set_features(graph, masks, groups, value, odds, sets, same, move))
        chosen = sets.rows()[int(np.argmax(quality))]
        chosen.sort(key=lambda c: -value[c])
    return masks, Choice(tuple(chosen), value, odds, scores.confidence(value), float(value.max()))
