"""Applies a hints file to a tree: a person's word, or a photo's, outranks the reasoner's."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mam_pipeline.errors import ConfigError, unknown_name
from mam_pipeline.geometry.sampling import face_geometry, unit
from mam_pipeline.hints import HintBox, HintJoint, HintPart, Hints
from mam_pipeline.types import (
    FloatArray,
    IntArray,
    JointCandidate,
    JointSubtype,
    KinematicTree,
    Mesh,
    PartNode,
    Primitives,
)


@dataclass(frozen=True)
class HintThresholds:
    """How a hint's box finds primitives.

    Attributes:
        inside: share of a primitive's area that must lie in the box.
    """

    inside: float = 0.6


HINTS = HintThresholds()


def apply_hints(
    tree: KinematicTree, primitives: Primitives, mesh: Mesh, hints: Hints
) -> KinematicTree:
    """Return the tree with merges, fixed primitives and named parts put in force.

    Order: `merge` (a group joins the part that owns most of it), then `fixed` (back to the base),
    then `parts` (take their primitives from whoever has them; one that says a name alone means the
    part that was found under it, which then moves). Parts that lose all they had
    disappear, and what hung on them hangs on who took most of it; a tree without any hint is
    returned as it is.

    Raises:
        ConfigError: a primitive, node or parent that does not exist, or a part without faces.
    """
    if hints.empty:
        return tree
    owner = _owners(tree, primitives.count)
    area = np.bincount(
        primitives.labels, face_geometry(mesh.vertices, mesh.faces)[1], minlength=primitives.count
    )
    for group in hints.merge:
        members = _checked(group, primitives.count, f"{_file(hints)}: merge")
        weight = np.bincount(owner[members], area[members] + 1e-12, minlength=len(tree.nodes))
        owner[members] = int(np.argmax(weight))
    owner[_checked(hints.fixed, primitives.count, f"{_file(hints)}: fixed")] = 0
    nodes = list(tree.nodes)
    for part in hints.parts:
        index = next((i for i, n in enumerate(tree.nodes) if i and n.name == part.name), 0)
        if index and not (part.primitives or part.nodes or part.box):
            known = tree.nodes[index]
            if part.joint is None:
                nodes[index] = replace(known, dormant="", confidence=1.0)
                continue
            kind = known.kind if part.kind == "part" else part.kind
            part = replace(part, primitives=known.primitives, kind=kind)
        members = part_primitives(part, primitives, mesh, _file(hints))
        if part.joint is not None and part.joint.subtype == "fixed":
            owner[members] = 0
            continue
        owner[members] = len(nodes)
        nodes.append(_hinted(part, mesh, primitives, members))
    return _rebuild(nodes, owner, hints.parts, _file(hints))


def _file(hints: Hints) -> str:
    """Where the hints come from, in an error."""
    return hints.source or "hints"


def along_nodes(
    primitives: Primitives, mesh: Mesh, hints: Hints | None, more: Collection[str] = ()
) -> Primitives:
    """Divide primitives that reach over the border of a node named in the hints, or in `more`.

    A panel cut out of one flat face is no primitive of its own: its border is in the nodes alone.
    Unchanged, merges included, where no primitive straddles a named node.
    """
    named = {n for p in (hints.parts if hints else ()) for n in p.nodes} | set(more)
    which = [k for k, name in enumerate(mesh.group_names) if name in named]
    if not which:
        return primitives
    assert mesh.face_group is not None
    side = np.where(np.isin(mesh.face_group, which), mesh.face_group, -1)
    pairs, labels = np.unique(
        np.stack([primitives.labels, side], axis=1), axis=0, return_inverse=True
    )
    if len(pairs) == primitives.count:
        return primitives
    return Primitives(labels.reshape(-1), method=primitives.method)


def part_primitives(
    part: HintPart, primitives: Primitives, mesh: Mesh, file: str = "hints"
) -> IntArray:
    """Sorted primitives that a hint names by index, by source node or by box.

    Args:
        file: where the hint comes from, for errors.
    """
    chosen = [_checked(part.primitives, primitives.count, f"{file}: part {part.name!r}")]
    assert mesh.face_group is not None
    for name in part.nodes:
        if name not in mesh.group_names:
            raise unknown_name(f"node for part {part.name!r} of {file}", name, mesh.group_names)
        inside = mesh.face_group == mesh.group_names.index(name)
        chosen.append(_mostly(inside, primitives, mesh))
    if part.box is not None:
        low, high = _corners(part.box)
        middle = mesh.vertices[mesh.faces].mean(axis=1)
        margin = 1e-6 * mesh.diagonal
        inside = np.all((middle >= low - margin) & (middle <= high + margin), axis=1)
        chosen.append(_mostly(inside, primitives, mesh))
    out = np.unique(np.concatenate(chosen)).astype(np.int64)
    if len(out) == 0:
        raise ConfigError(
            f"{file}: part {part.name!r} has no primitive: name primitives or nodes, "
            "or widen its box"
        )
    return out


def _mostly(inside: np.ndarray, primitives: Primitives, mesh: Mesh) -> IntArray:
    """Primitives of whose area at least HINTS.inside is marked."""
    areas = face_geometry(mesh.vertices, mesh.faces)[1] + 1e-15
    total = np.bincount(primitives.labels, areas, minlength=primitives.count)
    part = np.bincount(primitives.labels, areas * inside, minlength=primitives.count)
    return np.flatnonzero((part >= HINTS.inside * total) & (total > 0)).astype(np.int64)


def _corners(box: HintBox) -> tuple[FloatArray, FloatArray]:
    center, half = np.asarray(box.center), np.asarray(box.size) / 2
    return center - half, center + half


def _checked(indices: tuple[int, ...], count: int, where: str) -> IntArray:
    out = np.asarray(indices, dtype=np.int64).reshape(-1)
    if len(out) and (out.min() < 0 or out.max() >= count):
        bad = int(out[(out < 0) | (out >= count)][0])
        raise ConfigError(f"{where}: no primitive {bad}; there are {count}, from 0")
    return out


def _owners(tree: KinematicTree, count: int) -> IntArray:
    owner = np.zeros(count, dtype=np.int64)
    for index, node in enumerate(tree.nodes):
        owner[list(node.primitives)] = index
    return owner


def _hinted(part: HintPart, mesh: Mesh, primitives: Primitives, members: IntArray) -> PartNode:
    """The node of one hinted part; its parent is settled in `_rebuild`."""
    joint = part.joint or HintJoint()
    subtype: JointSubtype = joint.subtype or _usual(part.kind)  # type: ignore[assignment]
    faces = mesh.faces[np.isin(primitives.labels, members)]
    points = mesh.vertices[faces.reshape(-1)]
    low, high = points.min(axis=0), points.max(axis=0)
    candidate = _candidate(joint, subtype, low, high)
    limits = None
    if joint.lower is not None and joint.upper is not None:
        limits = (joint.lower, joint.upper)
    evidence: dict[str, Any] = {"hint": True}
    if joint.hinge_side is not None:
        evidence = {"hinge_side": joint.hinge_side}
    if joint.travel != "given":
        evidence["travel"] = joint.travel
    return PartNode(
        name=part.name,
        kind=part.kind,
        primitives=(),
        parent=0,
        subtype=subtype,
        confidence=part.confidence,
        provenance=part.provenance,  # type: ignore[arg-type]
        candidates=() if candidate is None else (candidate,),
        limits=limits,
        evidence=evidence,
    )


def _usual(kind: str) -> JointSubtype:
    table: dict[str, JointSubtype] = {
        "drawer": "slide", "button": "slide", "slider": "slide", "knob": "spin", "wheel": "spin",
        "handle": "hinge", "door": "hinge", "lid": "hinge", "lever": "hinge",
    }  # fmt: skip
    return table.get(kind, "hinge")


def _candidate(
    joint: HintJoint, subtype: JointSubtype, low: FloatArray, high: FloatArray
) -> JointCandidate | None:
    """The joint a hint spells out: by axis and origin, or by the hinge side of a front.

    Sides are those of a person before the object, whose front faces -X: left is +Y.
    """
    middle = (low + high) / 2
    if joint.axis is not None:
        origin = middle if joint.origin is None else np.asarray(joint.origin)
        if joint.origin is None and joint.hinge_side is not None:
            origin = _side_line(joint.hinge_side, low, high)[1]
        return JointCandidate(subtype, unit(joint.axis), origin, 1.0, {"hint": 1.0})
    if joint.hinge_side is not None and subtype == "hinge":
        axis, origin = _side_line(joint.hinge_side, low, high)
        return JointCandidate(subtype, axis, origin, 1.0, {"hint": 1.0})
    return None


def _side_line(side: str, low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Axis (positive opens towards -X) and a point of the hinge at one side of a front panel."""
    middle = (low + high) / 2
    axis, y, z = {
        "left": ([0.0, 0.0, -1.0], high[1], middle[2]),
        "right": ([0.0, 0.0, 1.0], low[1], middle[2]),
        "bottom": ([0.0, -1.0, 0.0], middle[1], low[2]),
        "top": ([0.0, 1.0, 0.0], middle[1], high[2]),
    }[side]
    return np.asarray(axis), np.array([middle[0], y, z])


def _rebuild(
    nodes: list[PartNode], owner: IntArray, parts: tuple[HintPart, ...], file: str
) -> KinematicTree:
    """Drop what is empty, renumber, settle parents and make names unique."""
    members = [tuple(int(p) for p in np.flatnonzero(owner == k)) for k in range(len(nodes))]
    alive = [k for k in range(len(nodes)) if k == 0 or members[k]]
    new = {old: i for i, old in enumerate(alive)}
    heirs = {k: _heir(nodes[k], owner) for k in range(1, len(nodes)) if k not in new}
    hinted = {part.name: part for part in parts}
    names = {nodes[k].name: k for k in alive}  # later ones, the hinted, win
    names.update(dict.fromkeys(("base", "body", nodes[0].name), 0))
    out: list[PartNode] = []
    used: set[str] = set()
    for k in alive:
        node = nodes[k]
        parent = node.parent
        hint = hinted.get(node.name) if node.provenance != "inferred" or k else None
        if k and hint is not None and hint.parent is not None:
            if hint.parent not in names:
                raise unknown_name(f"parent for part {node.name!r} of {file}", hint.parent, names)
            parent = names[hint.parent]
        while parent > 0 and parent not in new:
            parent = heirs[parent]
        name, n = node.name, 1
        while name in used:
            n += 1
            name = f"{node.name}_{n}"
        used.add(name)
        index = -1 if k == 0 else new[max(parent, 0)]
        if index == new[k]:
            index = 0
        out.append(replace(node, name=name, primitives=members[k], parent=index))
    return KinematicTree(tuple(out))


def _heir(node: PartNode, owner: IntArray) -> int:
    """Who took most primitives of a part that has lost all of them; the base where it had none."""
    return int(np.bincount(owner[list(node.primitives)]).argmax()) if node.primitives else 0
