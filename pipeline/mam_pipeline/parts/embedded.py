"""The embedded reasoner: primitives and priors to parts, articulation tree and joint subtypes.

The counterpart of the paper's VLM (3.2, 3.3): learned scores on geometric and physical features
say which primitives belong together, which groups are parts, and how each moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from importlib.resources.abc import Traversable

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from mam_pipeline.backends import Availability, KinematicPrior
from mam_pipeline.evidence.spec import NOTHING, KinematicSpec
from mam_pipeline.geometry.sampling import SEED_STEP
from mam_pipeline.joints import ranker
from mam_pipeline.parts import abstain
from mam_pipeline.parts.abstain import abstained
from mam_pipeline.parts.configurations import enumerate_sets, set_features
from mam_pipeline.parts.features import pair_features, primitive_features
from mam_pipeline.parts.graph import Graph, build_graph
from mam_pipeline.parts.group_features import joined, measured, with_rivals
from mam_pipeline.parts.groups import Masks, enumerate_groups, expand_groups
from mam_pipeline.parts.joint_view import with_joints
from mam_pipeline.parts.network import Reading, log_odds
from mam_pipeline.parts.rules.choice import with_twins
from mam_pipeline.parts.rules.extent import completed
from mam_pipeline.parts.said import SAID, Heard, against_physics, with_masks
from mam_pipeline.parts.scores import WEIGHTS, Kind, Scores, load_scores
from mam_pipeline.parts.select import SELECTION
from mam_pipeline.parts.settle import settled
from mam_pipeline.parts.tree import (
    SUBTYPES,
    Choice,
    build_tree,
    clear_from,
    named,
    with_base,
    with_left,
)
from mam_pipeline.prior.embedded import prior_of
from mam_pipeline.prior.probe import Probe
from mam_pipeline.rules import ALL_RULES, Rules
from mam_pipeline.segment.topology import without_repeats
from mam_pipeline.types import FloatArray, KinematicTree, Mesh, Primitives
from mam_pipeline.weights import place_of


@dataclass(frozen=True)
class ReasonerSettings:
    """How the reasoner decides beside its learned scores.

    Attributes:
        rescue: expected overlap that the best candidate must reach; whoever asks for an
            articulation mostly has something that moves, and the confidence of such a part stays
            low.
        samplings: how often an object is sampled; scores are averaged, since between single
            samplings the mIoU of 37 real objects differed by up to 0.05.
    """

    rescue: float = 0.2
    samplings: int = 4


REASONER = ReasonerSettings()


class EmbeddedReasoner:
    """Learned grouping and typing on a CPU; the weights are package data.

    Args:
        scores: for every object; by default the package's, those for fused meshes apart.
        rules: hand rules that are followed.
        spec: what is known of the object beside its geometry.
    """

    def __init__(
        self, scores: Scores | None = None, rules: Rules = ALL_RULES, spec: KinematicSpec = NOTHING
    ) -> None:
        self.scores = scores
        self.rules = rules
        self.spec = spec

    @classmethod
    def available(cls) -> Availability:
        """Always available."""
        return Availability(True, "learned on procedural objects; CPU", version="1")

    @classmethod
    def weights(cls) -> list[Traversable]:
        """Its own scores, and the joint ranker's, whom it asks."""
        return [place_of(room) for room in (*WEIGHTS.values(), abstain.WEIGHTS, ranker.WEIGHTS)]

    def with_rules(self, rules: Rules) -> EmbeddedReasoner:
        """See `rules.Ruled`."""
        return EmbeddedReasoner(self.scores, rules, self.spec)

    def with_spec(self, spec: KinematicSpec) -> EmbeddedReasoner:
        """See `evidence.spec.Informed`."""
        return EmbeddedReasoner(self.scores, self.rules, spec)

    def reason(
        self, mesh: Mesh, primitives: Primitives, prior: KinematicPrior | None, seed: int = 0
    ) -> KinematicTree:
        """Group the primitives into parts; a tree with only the base when nothing may move."""
        mesh, primitives = without_repeats(mesh, primitives)
        views = sampled_views(mesh, primitives, prior, seed, self.rules)
        kind: Kind = "fused" if primitives.is_fused else "authored"
        heard = Heard.of(self.spec, mesh, primitives)
        masks, choice = decide(views, self.scores or load_scores(kind), self.rules, heard)
        return tree_of(views[0], masks, choice, mesh, primitives, seed, self.rules, heard)


def tree_of(
    view: View, masks: Masks, choice: Choice, mesh: Mesh, primitives: Primitives, seed: int,
    rules: Rules, heard: Heard | None = None,
) -> KinematicTree:  # fmt: skip
    """From chosen candidates to final parts, for which the joint estimator is asked.

    Args:
        view: of which the candidates are. mesh: with one copy of every face.
        heard: what is known beside geometry.
    """
    graph = view.graph
    tree = drafted(graph, masks, choice, mesh, primitives, seed, rules, heard)
    tree = against_physics(tree, mesh, primitives, seed)
    tree = settled(tree, mesh, primitives, clear_from(graph, tree, rules), seed, rules)
    if len(tree.nodes) < 2:
        return with_left(graph, tree)
    told = 0 if heard is None else heard.told
    return with_left(graph, abstained(tree, mesh, primitives, seed, rules, told))


def drafted(
    graph: Graph, masks: Masks, choice: Choice, mesh: Mesh, primitives: Primitives, seed: int,
    rules: Rules, heard: Heard | None = None,
) -> KinematicTree:  # fmt: skip
    """The parts as they were chosen, with types, joint hypotheses and names."""
    masks, choice = with_base(graph, masks, choice)
    chosen = list(choice.chosen)
    tree = build_tree(graph, masks, choice)
    tree = with_joints(tree, choice.subtype[chosen], mesh, primitives, seed, rules)
    if heard is not None and choice.said is not None:
        tree = heard.noted(tree, masks[chosen], choice.said[chosen])
    return named(graph, tree)


@dataclass(frozen=True)
class View:
    """One sampling of an object: its graph, and what the prior says of it (None: no prior)."""

    graph: Graph
    prior: KinematicPrior | None


def sampled_views(
    mesh: Mesh, primitives: Primitives, prior: KinematicPrior | None, seed: int,
    rules: Rules = ALL_RULES, samplings: int = REASONER.samplings,
) -> list[View]:  # fmt: skip
    """Several samplings of one object.

    The embedded prior is asked again for each of them. One that came from elsewhere, or was edited,
    holds for all; one that was read from a file without its samples is recognised by its values.
    """
    probed = None if prior is None else prior.probe
    known = probed if isinstance(probed, Probe) else None
    first = build_graph(mesh, primitives, seed, known, rules)
    again = prior is not None and _alike(prior, prior_of(first.probe))
    views = [View(first, prior)]
    for k in range(1, samplings if primitives.count > 1 else 1):
        graph = build_graph(mesh, primitives, seed + k * SEED_STEP, rules=rules)
        views.append(View(graph, prior_of(graph.probe) if again else prior))
    return views


def _alike(a: KinematicPrior, b: KinematicPrior) -> bool:
    return all(
        x.shape == y.shape and np.allclose(x, y, atol=1e-5)
        for x, y in ((a.mobility, b.mobility), (a.affinity, b.affinity))
    )


@dataclass(frozen=True)
class Scored:
    """What the scores say of one object before hand rules choose.

    Attributes:
        graph: of the first view. masks: (C, P) candidates. value: (C,) expected overlap with a true
            part; odds: (C, 3) of hinge, spin, slide; confidence: (C,) calibrated.
        same, move: (E,), (P,) probabilities of the bonds and of moving.
        best: candidates of the set that ranks first, best first; empty where nothing may move.
        least: confidence below which a part stays in the base.
        said: (C,) log odds that what is known beside geometry added; firm: (C,) candidates whose
            faces it delimits. None where nothing is known. told: how many parts a person counted.
    """

    graph: Graph
    masks: Masks
    value: FloatArray
    odds: FloatArray
    confidence: FloatArray
    same: FloatArray
    move: FloatArray
    best: tuple[int, ...]
    least: float
    said: FloatArray | None = None
    firm: NDArray[np.bool_] | None = None
    told: int = 0


def decide(
    views: Sequence[View], scores: Scores, rules: Rules = ALL_RULES, heard: Heard | None = None
) -> tuple[Masks, Choice]:
    """Candidates and what was chosen of them; every score is the mean over the views."""
    return chosen_parts(scored(views, scores, heard), rules)


def scored(views: Sequence[View], scores: Scores, heard: Heard | None = None) -> Scored:
    """Candidates, and the best set of them.

    Args:
        heard: what is known beside geometry; it weighs on the candidates' values.
    """
    graph = views[0].graph
    readings = bonds_of(views, scores)
    same, move = readings[0].same, readings[0].move
    told = 0 if heard is None else heard.told
    masks = enumerate_groups(graph, same, move)
    if heard is not None:
        masks = with_masks(masks, heard.stated)
    if len(masks) == 0 or graph.count < 2:
        none = np.zeros(0)
        empty = np.zeros((0, graph.count), dtype=bool)
        return Scored(
            graph, empty, none, np.zeros((0, 3)), none, same, move, (), scores.least, told=told
        )  # fmt: skip
    seen = list(zip(views, readings))
    tables = [measured(v.graph, masks, r, v.prior) for v, r in seen]
    value = _mean([scores.value(t) for t in tables])
    more = expand_groups(graph, masks, value, same)
    if len(more):
        masks = np.concatenate([masks, more])
        extra = [measured(v.graph, more, r, v.prior) for v, r in seen]
        tables = [joined(t, e, masks) for t, e in zip(tables, extra)]
        value = _mean([scores.value(t) for t in tables])
    value = _mean([scores.revise(with_rivals(t, masks, value)) for t in tables])
    odds = _mean([scores.subtype(t) for t in tables])
    value = np.where(masks @ graph.area > 1.0 - SELECTION.least_base, 0.0, value)  # something stays
    said = firm = None
    stated: FloatArray = np.zeros(len(masks))
    if heard is not None:
        stated = np.where(value > 0.0, heard.proposed(masks), 0.0)
        firm = heard.firm(masks, value) | (stated >= SAID.decides)
        said = heard.odds(masks, value) + heard.by_kind(odds, SUBTYPES)
        value = heard.heard(masks, value, said)
        odds = heard.subtypes(masks, odds, SUBTYPES)
    best: list[int] = []
    if value.max() > REASONER.rescue:
        sets = enumerate_sets(masks, tables[0], value)
        quality = _mean([
            scores.choose(set_features(v.graph, masks, t, value, odds, sets, r.same, r.move))
            for (v, r), t in zip(seen, tables)
        ])  # fmt: skip
        if heard is not None:
            quality = quality + heard.quality([len(row) for row in sets.rows()])
        best = sorted(sets.rows()[int(np.argmax(quality))], key=lambda c: -value[c])
    if heard is not None:
        best = heard.with_stated(masks, stated, best)
    confidence = np.maximum(scores.confidence(value), stated)
    return Scored(
        graph, masks, value, odds, confidence, same, move, tuple(best), scores.least, said, firm,
        told,
    )  # fmt: skip


def chosen_parts(found: Scored, rules: Rules = ALL_RULES) -> tuple[Masks, Choice]:
    """The candidates, those chosen made whole, and what was chosen: the best set and the rules."""
    graph, masks, value, odds = found.graph, found.masks, found.value, found.odds
    best, confidence = list(found.best), found.confidence
    highest = float(value.max(initial=0.0))
    if not best:
        return masks, Choice((), value, odds, confidence, highest, said=found.said)
    unsure = best[max(found.told, 1) :] if rules.unsure_stays else []
    left = [c for c in unsure if confidence[c] < found.least]
    chosen = [c for c in best if c not in left]
    if rules.same_handle:
        chosen = with_twins(graph, masks, value, chosen)
    masks = masks.copy()
    parts = masks[chosen]
    if rules.completed:
        parts = completed(graph, parts, found.same, found.move, masks[left])
    if found.firm is not None:
        parts = np.where(found.firm[chosen][:, None], masks[chosen], parts)
    masks[chosen] = parts
    final, out = tuple(chosen), tuple(left)
    return masks, Choice(final, value, odds, confidence, highest, out, found.said)


def bonds_of(views: Sequence[View], scores: Scores) -> list[Reading]:
    """What bond models and networks say of every view, its bonds averaged over the views.

    Samplings may differ in which primitives are neighbours: a pair's mean is over those that
    have it.
    """
    found = []
    for view in views:
        unary = primitive_features(view.graph, view.prior)
        found.append(scores.read(view.graph, unary, pair_features(view.graph, unary, view.prior)))
    move = expit(_mean([log_odds(r.move) for r in found]))
    count = views[0].graph.count
    total, number = np.zeros((count, count)), np.zeros((count, count))
    for view, reading in zip(views, found):
        i, j = view.graph.pairs[:, 0], view.graph.pairs[:, 1]
        total[i, j] += log_odds(reading.same)
        number[i, j] += 1
    mean = expit(total / np.maximum(number, 1))
    return [
        replace(r, same=mean[v.graph.pairs[:, 0], v.graph.pairs[:, 1]], move=move)
        for v, r in zip(views, found)
    ]


def _mean(answers: Sequence[FloatArray]) -> FloatArray:
    return np.asarray(np.mean(answers, axis=0))
