"""What does not move by itself: small parts, levers, knobs and panes without a clear way.

Whether the lever of a door turns is not in its shape. The world's doors have levers that do; the
fourteen levers and knobs found on eleven doors of `benchmarks/sweet_home_dataset.py` were left
fixed by their authors. A pane between glazing bars looks like a leaf in a leaf. So such a part
keeps a joint of its own only when that joint is clear; else the leaf carries it. Of any part that
is small beside the object's largest one more is asked than of a large one: real objects have many
a button, lamp and rose that is a piece of its own and does not move.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from mam_pipeline.types import NEEDS_REVIEW, Joint, JointSubtype, KinematicTree

LEAVES = ("door", "drawer", "panel")  # kinds of parts that carry others
FITTING = 0.05  # of the leaf's area, at most: of larger levers on doors some do turn
# of three small levers on generated doors none was found right, of five knobs all
MOVES_ABOVE: dict[JointSubtype, float] = {"hinge": 0.9, "spin": NEEDS_REVIEW}
PANES = ("door", "lid")  # kinds of hinged parts that may be one
PANE = (0.25, 1.0)  # of the leaf's area
UNLIKELY = 0.5  # a pane of less confidence does not move by itself
MINOR = 0.3  # of the surface of the object's largest part
# a minor part of less confidence does not move by itself; on skins right ones have less as well
UNCLEAR = 0.4
REPEATED = 3  # so many parts of one size are no accident: castors


def is_minor(area: float, areas: Sequence[float]) -> bool:
    """Whether a part is small beside the largest part, and not one of several of its size.

    Args:
        area: its surface. areas: of all parts, it among them.
    """
    alike = int(np.isclose(areas, area, rtol=0.1).sum())
    return area < MINOR * max(areas) and alike < REPEATED


def moves_if_above(subtype: JointSubtype, kind: str, leaf: str, share: float) -> float:
    """The confidence from which a part on a leaf moves by itself; 0 where nothing doubts it.

    Args:
        subtype, kind: of the part. leaf: kind of the part that it hangs on. share: of the leaf's
            area.
    """
    if leaf not in LEAVES:
        return 0.0
    if share < FITTING and subtype in MOVES_ABOVE:
        return MOVES_ABOVE[subtype]
    pane = subtype == "hinge" and kind in PANES and PANE[0] <= share < PANE[1]
    return UNLIKELY if pane else 0.0


def carried(
    tree: KinematicTree, joints: Mapping[int, Joint]
) -> tuple[KinematicTree, dict[int, Joint]]:
    """The tree and joints in which what is unclear belongs to what it hangs on.

    Args:
        joints: by node, of every node but the base.

    Returns:
        A tree whose bodies have what they carry, and its joints, which say so in their evidence;
        both as they were where nothing else would move.
    """
    nodes = list(tree.nodes)
    gone = [
        i for i, node in enumerate(nodes)
        if i and node.provenance == "inferred" and all(n.parent != i for n in nodes)
        and joints[i].confidence < float(node.evidence.get("moves_if_above", 0.0))
    ]  # fmt: skip
    stay = [i for i in joints if i not in gone]
    if not gone or not stay:
        return tree, dict(joints)
    joints = dict(joints)
    for i in gone:
        node, host = nodes[i], nodes[i].parent
        both = tuple(sorted((*nodes[host].primitives, *node.primitives)))
        nodes[host] = replace(nodes[host], primitives=both)
        said = {"name": node.name, "subtype": node.subtype, "primitives": list(node.primitives),
                "confidence": round(joints[i].confidence, 3), "by": nodes[host].name}  # fmt: skip
        teller = host or stay[0]  # the base has no joint
        told = joints[teller].evidence
        evidence = {**told, "carries": [*told.get("carries", ()), said]}
        joints[teller] = replace(joints[teller], evidence=evidence)
    kept = [i for i in range(len(nodes)) if i not in gone]
    new = {old: k for k, old in enumerate(kept)} | {-1: -1}
    out = tuple(replace(nodes[i], parent=new[nodes[i].parent]) for i in kept)
    moved = {
        new[i]: replace(joints[i], parent=new[joints[i].parent], child=new[i])
        for i in kept if i
    }  # fmt: skip
    return replace(tree, nodes=out), moved


def carried_notes(joints: Iterable[Joint]) -> list[str]:
    """A sentence for each body that carries what was found as a part."""
    names: dict[str, list[str]] = {}
    for joint in joints:
        for said in joint.evidence.get("carries", ()):
            pieces = ", ".join(str(k) for k in said["primitives"])
            name = f"{said['name']} (primitives {pieces})"
            names.setdefault(str(said["by"]), []).append(name)
    return [
        f"{body}: carries {', '.join(parts)}, whose own joint is unclear; if it moves by "
        "itself, say so in a hints file"
        for body, parts in names.items()
    ]
