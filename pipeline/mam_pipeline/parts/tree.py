"""From chosen groups to the articulation tree: parents, subtypes, names, evidence."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import count

import numpy as np

from mam_pipeline.dormant import with_dormant
from mam_pipeline.parts.graph import CONTACT, Graph, tight_box
from mam_pipeline.parts.groups import Masks
from mam_pipeline.parts.rules.fittings import FITTINGS, is_fitting, is_minor
from mam_pipeline.parts.select import SELECTION
from mam_pipeline.rules import ALL_RULES, Rules
from mam_pipeline.types import FloatArray, JointSubtype, KinematicTree, PartNode

SUBTYPES: tuple[JointSubtype, ...] = ("hinge", "spin", "slide")


@dataclass(frozen=True)
class TreeThresholds:
    """Parents and kinds of parts.

    Attributes:
        twins: how far the logarithms of the extents of two doors may differ.
        equal_area: share of the largest surface from which parts count as equal.
        bulk: share of a part's area that its largest primitives, its body, have; the others are its
            fittings.
        level: cosine between the upward direction and the thin side of what lies.
        stated: chance from which a part that the file states moves by itself, however small.
    """

    twins: float = 0.2
    equal_area: float = 0.8
    bulk: float = 0.7
    level: float = 0.7
    stated: float = 0.5


TREE = TreeThresholds()


@dataclass(frozen=True)
class Choice:
    """What the scores say of all candidates, and which were chosen.

    Attributes:
        chosen: candidate indices, best first. value: (C,) expected overlap with a true part.
        subtype: (C, 3) probabilities of hinge, spin, slide. confidence: (C,) calibrated.
        best: the highest value of any candidate. said: (C,) log odds that what is known beside
            geometry added; None where nothing is. left: candidates of the best set whose confidence
            is too low: they are dormant (`with_left`).
    """

    chosen: tuple[int, ...]
    value: FloatArray
    subtype: FloatArray
    confidence: FloatArray
    best: float
    left: tuple[int, ...] = ()
    said: FloatArray | None = None


def build_tree(graph: Graph, masks: Masks, choice: Choice) -> KinematicTree:
    """Assemble the tree; with nothing chosen, the base says why in its evidence.

    The parts are `named` when their types are settled; node i is that of the choice's i-th part.
    """
    taken = np.asarray(masks[list(choice.chosen)].any(axis=0))
    evidence: dict[str, object] = {"still": np.flatnonzero(~taken).tolist()}
    if not choice.chosen:
        evidence["nothing_movable"] = (
            "there is only one primitive"
            if graph.count < 2
            else f"the likeliest part reaches {choice.best:.2f}, which is below the threshold"
        )
    evidence |= {"left_out": [_said(masks, choice, c) for c in choice.left]}
    base = PartNode("base", "body", _indices(~taken), -1, "fixed", evidence=evidence)
    nodes = [base]
    parents = _parents(graph, [masks[c] for c in choice.chosen])
    for c, parent in zip(choice.chosen, parents):
        order = np.argsort(-choice.subtype[c], kind="stable")
        first, second = SUBTYPES[order[0]], SUBTYPES[order[1]]
        nodes.append(
            PartNode(
                name=f"part_{len(nodes) - 1}",
                kind="part",
                primitives=_indices(masks[c]),
                parent=parent + 1,
                subtype=first,
                confidence=float(choice.confidence[c] * choice.subtype[c][order[0]]),
                runner_up=_runner_up(masks, choice, c, second, float(choice.subtype[c][order[1]])),
                evidence={
                    "expected_overlap": round(float(choice.value[c]), 3),
                    "subtype": dict(zip(SUBTYPES, np.round(choice.subtype[c], 3).tolist())),
                },
            )
        )
    return KinematicTree(tuple(nodes))


def _said(masks: Masks, choice: Choice, c: int) -> dict[str, object]:
    """A candidate that stays in the base, for the evidence."""
    return {
        "primitives": list(_indices(masks[c])),
        "subtype": SUBTYPES[int(np.argmax(choice.subtype[c]))],
        "confidence": round(float(choice.confidence[c]), 2),
    }


def with_left(graph: Graph, tree: KinematicTree) -> KinematicTree:
    """The tree with what `build_tree` left in the base as dormant parts.

    What has become part of another since then is no longer theirs.
    """
    base = tree.nodes[0]
    taken = {p for node in tree.nodes[1:] for p in node.primitives}
    used = {node.name for node in tree.nodes}
    more: list[PartNode] = []
    for row in base.evidence.get("left_out", ()):
        own = [p for p in row["primitives"] if p not in taken]
        if not own:
            continue
        taken.update(own)
        kind = part_kind(graph, np.isin(np.arange(graph.count), own), row["subtype"])
        name = next(n for k in count() if (n := f"{kind}_{k}") not in used)
        used.add(name)
        more.append(
            PartNode(
                name, kind, tuple(own), 0, row["subtype"], row["confidence"],
                dormant=f"its chance is {row['confidence']:.2f}: too unsure to be a part",
            )
        )  # fmt: skip
    return with_dormant(tree, more)


def with_base(graph: Graph, masks: Masks, choice: Choice) -> tuple[Masks, Choice]:
    """Something must stay: what it is where the parts leave less than SELECTION.least_base.

    Of parts that are alike each leaves its largest primitive, against which the rest of it moves;
    else the part with the most surface stays.
    """
    chosen = list(choice.chosen)
    left = graph.area[~masks[chosen].any(axis=0)].sum()
    if not chosen or left >= SELECTION.least_base:
        return masks, choice
    area = [float(graph.area[masks[c]].sum()) for c in chosen]
    if (
        len(chosen) > 1
        and min(area) > TREE.equal_area * max(area)
        and (masks[chosen].sum(axis=1) > 1).all()
    ):
        masks = masks.copy()
        for c in chosen:
            masks[c, np.argmax(np.where(masks[c], graph.area, 0.0))] = False
    else:
        chosen.pop(int(np.argmax(area)))
    return masks, replace(choice, chosen=tuple(chosen))


def named(graph: Graph, tree: KinematicTree) -> KinematicTree:
    """The tree with every part named after its shape and its type."""
    kinds, share = _shapes(graph, tree)
    nodes = [tree.nodes[0]]
    counts: dict[str, int] = {}
    for i, node in enumerate(tree.nodes[1:], start=1):
        kind = kinds[i]
        named = node.evidence.get("said", {}).get("kind")
        if named:
            kind = named
        elif is_fitting(node.subtype, kinds[node.parent], share[i]):
            kind = "knob" if node.subtype == "spin" else "lever"
        counts[kind] = counts.get(kind, -1) + 1
        nodes.append(replace(node, name=f"{kind}_{counts[kind]}", kind=kind))
    return KinematicTree(tuple(nodes))


def clear_from(graph: Graph, tree: KinematicTree, rules: Rules = ALL_RULES) -> dict[int, float]:
    """The joint's confidence from which a part moves by itself, by node, where it must be clear."""
    if graph.is_fused or not rules.minor:
        return {}
    area = _areas(graph, tree)
    return {
        i: FITTINGS.minor_above
        for i, node in enumerate(tree.nodes[1:], start=1)
        if node.evidence.get("said", {}).get("chance", 0.0) < TREE.stated
        and is_minor(area[i], area[1:])
    }


def _areas(graph: Graph, tree: KinematicTree) -> list[float]:
    """Surface of every node."""
    return [float(graph.area[list(node.primitives)].sum()) for node in tree.nodes]


def _shapes(graph: Graph, tree: KinematicTree) -> tuple[list[str], list[float]]:
    """Kind by shape ("" for the base), and share of the parent's area, of every node."""
    masks = [np.isin(np.arange(graph.count), node.primitives) for node in tree.nodes]
    area = _areas(graph, tree)
    kinds = [part_kind(graph, mask, node.subtype) for mask, node in zip(masks, tree.nodes)]
    share = [area[i] / max(area[n.parent], 1e-12) for i, n in enumerate(tree.nodes)]
    return ["", *kinds[1:]], share


def _indices(mask: np.ndarray) -> tuple[int, ...]:
    return tuple(int(k) for k in np.flatnonzero(mask))


def _parents(graph: Graph, parts: list[np.ndarray]) -> list[int]:
    """Index of every part's parent among the parts, or -1 for the base.

    A part hangs on another only if it touches that one much more than the base, and is smaller; not
    on one of its own size beside the base, for these are two doors.
    """
    i, j = graph.pairs[:, 0], graph.pairs[:, 1]
    area = graph.touch[:, 0] * graph.area[i] + graph.touch[:, 1] * graph.area[j]
    label = np.full(graph.count, -1)
    for k, mask in enumerate(parts):
        label[mask] = k
    extent = [graph.high[m].max(0) - graph.low[m].min(0) for m in parts]
    size = [float(np.prod(e + 1e-3)) for e in extent]
    out = []
    for k in range(len(parts)):
        shared, nearest = np.zeros(len(parts) + 1), np.full(len(parts) + 1, np.inf)
        for a, b in ((i, j), (j, i)):
            cut = (label[a] == k) & (label[b] != k)
            np.add.at(shared, label[b[cut]] + 1, area[cut])
            np.minimum.at(nearest, label[b[cut]] + 1, graph.gap[cut])
        best, score = -1, shared[0]
        for m in range(len(parts)):
            twins = (
                np.abs(np.log((extent[m] + SELECTION.even) / (extent[k] + SELECTION.even))).max()
                < TREE.twins
            )
            if twins and nearest[0] < CONTACT.reach:
                continue
            closer = nearest[m + 1] < 0.5 * nearest[0] if shared[0] == 0 else False
            if size[m] > size[k] and (
                shared[m + 1] > 2 * max(score, 1e-9) or (closer and best < 0)
            ):
                best, score = m, max(shared[m + 1], score)
        out.append(best)
    return out


def part_kind(graph: Graph, mask: np.ndarray, subtype: JointSubtype) -> str:
    """A free word for a part's shape: it names links and helps grasps and reports."""
    extent = graph.high[mask].max(axis=0) - graph.low[mask].min(axis=0)
    top = graph.high[:, 2].max()
    level = int(np.argmin(extent)) == 2
    if subtype == "hinge":  # a handle makes no door less flat, nor does a door that stands ajar
        body = graph.bulk(mask, TREE.bulk)
        axes, extent = tight_box(graph.probe.points[body[graph.probe.owner]])
        level = abs(float(axes[2, 2])) > TREE.level
    low = graph.low[mask].min(axis=0)
    order = np.sort(extent)
    if subtype == "spin":
        wide = order[0] < 0.6 * order[1]
        return "wheel" if wide and low[2] < 0.25 * top and order[1] > 0.1 else "knob"
    if subtype == "slide":
        if order[2] < 0.12:
            return "button"
        return "panel" if order[0] < 0.12 * order[1] else "drawer"
    if order[0] < 0.35 * order[1] or order[0] < 0.1 * order[2]:
        return "lid" if level or low[2] > 0.7 * top else "door"
    return "lever"


def _runner_up(masks: Masks, choice: Choice, c: int, second: JointSubtype, odds: float) -> str:
    """The second-best explanation in words: another type, or another extent."""
    rival = masks[c].astype(np.float32) @ masks.T.astype(np.float32) > 0
    rival[c] = False
    if rival.any():
        other = int(np.argmax(np.where(rival, choice.value, -1.0)))
        if choice.value[other] > odds:
            more = int((masks[other] & ~masks[c]).sum())
            less = int((masks[c] & ~masks[other]).sum())
            return f"with {more} more and {less} fewer primitives ({choice.value[other]:.2f})"
    return f"{second} instead ({odds:.2f})"
