"""What does not move by itself: small parts without a clear way.

Of a part that is small beside the object's largest one more is asked than of a large one: real
objects have many a button, lamp and rose that is a piece of its own and does not move. Such a part
keeps a joint of its own only when that joint is clear; else what it hangs on carries it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mam_pipeline.types import JointSubtype, KinematicTree

HOSTS = ("door", "drawer", "panel")  # kinds of parts that carry others


@dataclass(frozen=True)
class FittingThresholds:
    """Which parts are small, and move by themselves only if their joint is clear; areas as shares.

    Attributes:
        area: of the panel's area: a fitting has no more.
        minor: of the largest part's surface: a minor part has less.
        minor_above: confidence from which a minor part of an authored mesh moves by itself; on
            fused ones right ones have less as well.
        repeated: so many parts of one size are no accident, but castors.
    """

    area: float = 0.05
    minor: float = 0.3
    minor_above: float = 0.4
    repeated: int = 3


FITTINGS = FittingThresholds()


def is_minor(area: float, areas: Sequence[float]) -> bool:
    """Whether a part is small beside the largest part, and not one of several of its size.

    Args:
        area: its surface. areas: of all parts, it among them.
    """
    alike = int(np.isclose(areas, area, rtol=0.1).sum())
    return area < FITTINGS.minor * max(areas) and alike < FITTINGS.repeated


def is_fitting(subtype: JointSubtype, host: str, share: float) -> bool:
    """Whether a part is a lever or a knob on a panel.

    Args:
        subtype: of the part. host: kind of the part that it hangs on. share: of its area.
    """
    return host in HOSTS and share < FITTINGS.area and subtype in ("hinge", "spin")


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
