"""What does not move by itself: small parts, levers, knobs and panes without a clear way.

Whether the lever of a door turns is not in its shape. The world's doors have levers that do; the
fourteen levers and knobs found on eleven doors of `benchmarks/sweet_home_dataset.py` were left
fixed by their authors. A pane between glazing bars looks like a door in a door. So such a part
keeps a joint of its own only when that joint is clear; else the panel carries it. Of any part that
is small beside the object's largest one more is asked than of a large one: real objects have many
a button, lamp and rose that is a piece of its own and does not move.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mam_pipeline.rules import ALL_RULES, Rules
from mam_pipeline.types import NEEDS_REVIEW, JointSubtype, KinematicTree

HOSTS = ("door", "drawer", "panel")  # kinds of parts that carry others


@dataclass(frozen=True)
class FittingThresholds:
    """Which parts move by themselves only if their joint is clear; areas as shares.

    Attributes:
        area: of the panel's area: a fitting has no more; of larger levers on doors some do turn.
        spin_above: confidence from which a knob on a panel turns; of five on generated doors all
            were found right.
        hinge_above: confidence from which a lever on a panel turns; of three on generated doors
            none was found right.
        pane: of the panel's area: what a pane in it has.
        pane_above: confidence from which a pane moves by itself.
        minor: of the largest part's surface: a minor part has less.
        minor_above: confidence from which a minor part of an authored mesh moves by itself; on
            fused ones right ones have less as well.
        repeated: so many parts of one size are no accident, but castors.
    """

    area: float = 0.05
    spin_above: float = NEEDS_REVIEW
    hinge_above: float = 0.9
    pane: tuple[float, float] = (0.25, 1.0)
    pane_above: float = 0.5
    minor: float = 0.3
    minor_above: float = 0.4
    repeated: int = 3


FITTINGS = FittingThresholds()
PANES = ("door", "lid")  # kinds of hinged parts that may be one


def is_minor(area: float, areas: Sequence[float]) -> bool:
    """Whether a part is small beside the largest part, and not one of several of its size.

    Args:
        area: its surface. areas: of all parts, it among them.
    """
    alike = int(np.isclose(areas, area, rtol=0.1).sum())
    return area < FITTINGS.minor * max(areas) and alike < FITTINGS.repeated


def moves_if_above(
    subtype: JointSubtype, kind: str, host: str, share: float, rules: Rules = ALL_RULES
) -> float:
    """The confidence from which a part on a panel moves by itself; 0 where nothing doubts it.

    Args:
        subtype, kind: of the part. host: kind of the part that it hangs on. share: of its area.
    """
    if host not in HOSTS:
        return 0.0
    if share < FITTINGS.area and subtype in ("hinge", "spin"):
        clear = FITTINGS.hinge_above if subtype == "hinge" else FITTINGS.spin_above
        return clear if rules.fittings else 0.0
    pane = subtype == "hinge" and kind in PANES and FITTINGS.pane[0] <= share < FITTINGS.pane[1]
    return FITTINGS.pane_above if pane and rules.panes else 0.0


def carried(
    tree: KinematicTree, confidence: Mapping[int, float], least: Mapping[int, float]
) -> KinematicTree:
    """The tree in which what is unclear belongs to what it hangs on.

    Args:
        confidence: of the joint of every node but the base. least: confidence from which a node
            moves by itself, for those that have to be clear.

    Returns:
        A tree whose bodies have what they carry, and say so in their evidence; the same tree where
        nothing else would move.
    """
    nodes = list(tree.nodes)
    gone = [
        i for i, node in enumerate(nodes)
        if i and node.provenance == "inferred" and all(n.parent != i for n in nodes)
        and nodes[node.parent].provenance != "user" and confidence[i] < least.get(i, 0.0)
    ]  # fmt: skip
    if not gone or len(gone) == len(nodes) - 1:
        return tree
    for i in gone:
        node, host = nodes[i], nodes[nodes[i].parent]
        said = {"name": node.name, "subtype": node.subtype, "primitives": list(node.primitives),
                "confidence": round(confidence[i], 3)}  # fmt: skip
        nodes[node.parent] = replace(
            host, primitives=tuple(sorted((*host.primitives, *node.primitives))),
            evidence={**host.evidence, "carries": [*host.evidence.get("carries", ()), said]},
        )  # fmt: skip
    kept = [i for i in range(len(nodes)) if i not in gone]
    new = {old: k for k, old in enumerate(kept)} | {-1: -1}
    return replace(tree, nodes=tuple(replace(nodes[i], parent=new[nodes[i].parent]) for i in kept))


def carried_notes(tree: KinematicTree) -> list[str]:
    """A sentence for each body that carries what was found as a part."""
    out = []
    for node in tree.nodes:
        names = []
        for said in node.evidence.get("carries", ()):
            pieces = [str(k) for k in said["primitives"] if k in node.primitives]
            if pieces:  # since then a person may have made it a part
                names.append(f"{said['name']} (primitives {', '.join(pieces)})")
        if names:
            out.append(
                f"{node.name}: carries {', '.join(names)}, whose own joint is unclear; if it "
                "moves by itself, say so in a hints file"
            )
    return out
