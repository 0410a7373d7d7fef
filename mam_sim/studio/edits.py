"""What a person may say of parts and joints, each as a change of the hints.

Every function takes the hints so far and the tree that they make, and returns new hints; what the
person did not speak of stays the engine's.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from mam_pipeline.errors import ConfigError
from mam_pipeline.hints import HintBox, HintJoint, HintPart, Hints
from mam_pipeline.parts.hints import part_primitives
from mam_pipeline.types import FloatArray, Joint, KinematicTree, Mesh, PartNode, Primitives


def link_name(text: str) -> str:
    """A name that every simulator takes for a link.

    Raises:
        ConfigError: nothing is left of it.
    """
    name = re.sub(r"\W+", "_", text.strip(), flags=re.ASCII).strip("_")
    if not name:
        raise ConfigError(f"{text!r} is no name: use letters, digits and _")
    return name if not name[0].isdigit() else f"part_{name}"


def free_name(kind: str, tree: KinematicTree) -> str:
    """The first of kind_0, kind_1 ... that no part has."""
    used = {node.name for node in tree.nodes}
    stem = link_name(kind)
    return next(name for k in range(len(used) + 1) if (name := f"{stem}_{k}") not in used)


def cut_off(
    hints: Hints, primitives: Primitives, faces: Iterable[int]
) -> tuple[Hints, list[int]]:  # fmt: skip
    """Faces become primitives of their own; returns the hints with the cuts, and the numbers.

    A primitive that is chosen whole keeps its number. Who has the new ones is not said yet.

    Args:
        primitives: with the cuts of `hints`.
    """
    chosen = np.unique(np.fromiter(faces, dtype=np.int64))
    cuts, numbers = list(hints.cut), []
    for primitive in np.unique(primitives.labels[chosen]).tolist():
        own = chosen[primitives.labels[chosen] == primitive]
        if len(own) == np.count_nonzero(primitives.labels == primitive):
            numbers.append(primitive)
        else:
            numbers.append(primitives.count + len(cuts) - len(hints.cut))
            cuts.append(tuple(own.tolist()))
    return replace(hints, cut=tuple(cuts)), numbers


def make_part(
    hints: Hints, tree: KinematicTree, primitives: Iterable[int], kind: str, subtype: str
) -> Hints:
    """Primitives become a part of their own that hangs on the base."""
    chosen = _some(primitives)
    part = HintPart(
        free_name(kind, tree), kind, tuple(chosen), parent=tree.nodes[0].name,
        joint=HintJoint(subtype),  # type: ignore[arg-type]
    )  # fmt: skip
    return _with(_without(hints, chosen), part)


def as_proposed(
    hints: Hints, node: PartNode, primitives: Iterable[int], parent: str, joint: Joint
) -> Hints:
    """A part with its primitives, what it hangs on and its joint, all as somebody proposed it."""
    ends = np.isfinite([joint.lower, joint.upper]).all()
    line = HintJoint(
        joint.subtype, axis=_triple(joint.axis), origin=_triple(joint.origin),
        lower=joint.lower if ends else None, upper=joint.upper if ends else None,
    )  # fmt: skip
    chosen = _some(primitives)
    part = HintPart(node.name, node.kind, tuple(chosen), parent=parent, joint=line)
    return _with(_without(hints, chosen), part)


def add_to(hints: Hints, tree: KinematicTree, name: str, primitives: Iterable[int]) -> Hints:
    """Primitives become part of another part; of the base, they do not move."""
    chosen = _some(primitives)
    node = _node(tree, name)
    if node.parent == -1:
        return do_not_move(hints, chosen)
    part = _regrouped(_stated(hints, tree, node), {*node.primitives, *chosen})
    return _with(_without(hints, chosen), part)


def do_not_move(hints: Hints, primitives: Iterable[int]) -> Hints:
    """Primitives go back to the base."""
    chosen = _some(primitives)
    rest = _without(hints, chosen)
    return replace(rest, fixed=tuple(sorted({*rest.fixed, *chosen})))


def merge(hints: Hints, tree: KinematicTree, kept: str, other: str) -> Hints:
    """Two parts become one, which moves as `kept` does."""
    if kept == other:
        raise ConfigError("choose two parts to merge")
    one, two = _node(tree, kept), _node(tree, other)
    if -1 in (one.parent, two.parent):
        return do_not_move(hints, (two if one.parent == -1 else one).primitives)
    part = _stated(hints, tree, one)
    if part.parent == other:  # it cannot hang on itself
        part = replace(part, parent=tree.nodes[max(two.parent, 0)].name)
    part = _regrouped(part, {*one.primitives, *two.primitives})
    return _hung(_with(_without(hints, two.primitives), part), other, kept)


def rename(hints: Hints, tree: KinematicTree, old: str, new: str) -> Hints:
    """Another name for a part."""
    name = link_name(new)
    if name in {node.name for node in tree.nodes}:
        raise ConfigError(f"there is a part named {name!r} already")
    node = _node(tree, old)
    if node.parent == -1:
        raise ConfigError("the base keeps its name")
    part = replace(_stated(hints, tree, node), name=name)
    parts = tuple(p for p in hints.parts if p.name != old)
    return _hung(_with(replace(hints, parts=parts), part), old, name)


def set_kind(hints: Hints, tree: KinematicTree, name: str, kind: str) -> Hints:
    """What sort of part it is; how it moves stays."""
    if not kind.strip():
        raise ConfigError("a kind is a word: door, drawer, lid, knob ...")
    return _with(hints, replace(_stated(hints, tree, _node(tree, name)), kind=kind.strip()))


def set_parent(hints: Hints, tree: KinematicTree, name: str, parent: str) -> Hints:
    """What a part hangs on."""
    above = _node(tree, parent)
    index = tree.nodes.index(above)
    while index != -1:
        if tree.nodes[index].name == name:
            raise ConfigError(f"{parent} hangs on {name} itself")
        index = tree.nodes[index].parent
    return _with(hints, replace(_stated(hints, tree, _node(tree, name)), parent=parent))


def set_subtype(hints: Hints, tree: KinematicTree, name: str, subtype: str) -> Hints:
    """How a part moves; the engine finds its line and its range anew."""
    if subtype == "fixed":
        return do_not_move(hints, _node(tree, name).primitives)
    part = _stated(hints, tree, _node(tree, name))
    return _with(hints, replace(part, joint=HintJoint(subtype)))  # type: ignore[arg-type]


def set_line(
    hints: Hints, tree: KinematicTree, name: str, subtype: str, axis: ArrayLike, origin: ArrayLike
) -> Hints:
    """The axis (unit, positive motion opens) and a point on it, metres, in the engine's frame."""
    part = _stated(hints, tree, _node(tree, name))
    line = {"axis": _triple(axis), "origin": _triple(origin)}
    joint = HintJoint(subtype, **line)  # type: ignore[arg-type]
    return _with(hints, replace(part, joint=joint))


def flip(hints: Hints, tree: KinematicTree, name: str, joint: Joint) -> Hints:
    """Positive motion the other way; a range that was given turns with it."""
    part = _stated(hints, tree, _node(tree, name))
    said = part.joint or HintJoint()
    lower = None if said.upper is None else -said.upper
    upper = None if said.lower is None else -said.lower
    turned = HintJoint(
        joint.subtype, axis=_triple(-joint.axis), origin=_triple(joint.origin),
        lower=lower, upper=upper,
    )  # fmt: skip
    return _with(hints, replace(part, joint=turned))


def set_limits(
    hints: Hints, tree: KinematicTree, name: str, joint: Joint, lower: float, upper: float
) -> Hints:
    """The range, radians or metres from rest; the line becomes the person's too.

    Raises:
        ConfigError: an empty range, or one without the rest pose.
    """
    if not lower <= 0.0 <= upper or upper - lower < 1e-4:
        raise ConfigError("a range runs from at most 0, the pose as read, to at least 0")
    part = _stated(hints, tree, _node(tree, name))
    said = HintJoint(
        joint.subtype, axis=_triple(joint.axis), origin=_triple(joint.origin),
        lower=float(lower), upper=float(upper),
    )  # fmt: skip
    return _with(hints, replace(part, joint=said))


def moved(hints: Hints, change: FloatArray, renumbered: Mapping[int, int]) -> Hints:
    """The same words in another frame and with other numbers of primitives.

    Args:
        change: (4, 4) rotation about axes by right angles, scale and shift.
        renumbered: new number by old.
    """
    size = float(np.cbrt(np.linalg.det(change[:3, :3])))
    turn = change[:3, :3] / size

    def at(point: ArrayLike) -> tuple[float, float, float]:
        return _triple(change[:3, :3] @ np.asarray(point) + change[:3, 3])

    def numbers(own: Iterable[int]) -> tuple[int, ...]:
        return tuple(sorted({renumbered[p] for p in own}))

    def box(old: HintBox | None) -> HintBox | None:
        if old is None:
            return None
        return HintBox(at(old.center), _triple(np.abs(change[:3, :3]) @ np.asarray(old.size)))

    def joint(old: HintJoint | None) -> HintJoint | None:
        if old is None:
            return None
        long = size if old.subtype == "slide" else 1.0
        return replace(
            old,
            axis=None if old.axis is None else _triple(turn @ np.asarray(old.axis)),
            origin=None if old.origin is None else at(old.origin),
            lower=None if old.lower is None else long * old.lower,
            upper=None if old.upper is None else long * old.upper,
        )

    return replace(
        hints,
        merge=tuple(m for group in hints.merge if len(m := numbers(group)) > 1),
        fixed=numbers(hints.fixed),
        parts=tuple(
            replace(p, primitives=numbers(p.primitives), box=box(p.box), handle=box(p.handle),
                    joint=joint(p.joint))
            for p in hints.parts
        ),
    )  # fmt: skip


def wake(hints: Hints, tree: KinematicTree, name: str) -> Hints:
    """A dormant part moves after all, as the engine found it."""
    if not _node(tree, name).dormant:
        raise ConfigError(f"{name} is awake already")
    return replace(hints, accept=(*hints.accept, name))


def as_the_engine_says(hints: Hints, tree: KinematicTree, name: str) -> Hints:
    """All that was said of a part is taken back."""
    members = set(_node(tree, name).primitives)
    parts = tuple(p for p in hints.parts if p.name != name)
    fixed = tuple(p for p in hints.fixed if p not in members)
    accept = tuple(a for a in hints.accept if a.removesuffix("_joint") != name)
    return replace(hints, parts=parts, fixed=fixed, accept=accept)


def with_living_parents(hints: Hints, tree: KinematicTree) -> Hints:
    """Parts that hung on a part that is no more hang on what that hung on.

    Args:
        tree: that of the hints before the change.
    """
    said = {p.name for p in hints.parts}
    taken = {*hints.fixed, *(m for p in hints.parts for m in p.primitives)}

    def alive(node: PartNode) -> bool:
        return node.parent == -1 or node.name in said or not taken.issuperset(node.primitives)

    def parent(part: HintPart) -> HintPart:
        above = next((n for n in tree.nodes if n.name == part.parent), None)
        while above is not None and not alive(above):
            above = tree.nodes[above.parent]
        return part if above is None else replace(part, parent=above.name)

    return replace(hints, parts=tuple(parent(p) for p in hints.parts))


def explicit(hints: Hints, primitives: Primitives, mesh: Mesh) -> Hints:
    """Hints whose parts name primitives alone, so that parts can be cut and joined.

    Where all parts were named by nodes, as a photo's are, nothing else moves, and that is said.

    Raises:
        ConfigError: a part that has no faces.
    """
    if not any(p.nodes or p.box for p in hints.parts):
        return hints
    whole = all(p.nodes for p in hints.parts)
    parts: list[HintPart] = []
    for part in hints.parts:
        members = {int(p) for p in part_primitives(part, primitives, mesh)}
        parts = [replace(p, primitives=tuple(sorted({*p.primitives} - members))) for p in parts]
        parts.append(_regrouped(part, members))
    parts = [p for p in parts if p.primitives]
    rest = set(range(primitives.count)) - {m for p in parts for m in p.primitives}
    fixed = tuple(sorted(rest)) if whole else hints.fixed
    return replace(hints, parts=tuple(parts), fixed=fixed)


def _some(primitives: Iterable[int]) -> list[int]:
    chosen = sorted({int(p) for p in primitives})
    if not chosen:
        raise ConfigError("nothing is selected: click on the object first")
    return chosen


def _node(tree: KinematicTree, name: str) -> PartNode:
    for node in tree.nodes:
        if node.name == name:
            return node
    raise ConfigError(f"there is no part {name!r} any more")


def _stated(hints: Hints, tree: KinematicTree, node: PartNode) -> HintPart:
    """The part as the hints say it, or as the engine found it, from now on the person's."""
    if node.parent == -1:
        raise ConfigError("the base does not move; choose a part")
    for part in hints.parts:
        if part.name == node.name:
            return replace(part, provenance="user", confidence=1.0)
    return HintPart(
        node.name, node.kind, node.primitives, parent=tree.nodes[node.parent].name,
        joint=HintJoint(node.subtype),
    )  # fmt: skip


def _regrouped(part: HintPart, primitives: set[int]) -> HintPart:
    """The part with other primitives; which faces it has is no longer said in another way."""
    return replace(part, primitives=tuple(sorted(primitives)), nodes=(), box=None)


def _with(hints: Hints, part: HintPart) -> Hints:
    """Hints with a part put in, in the place of the one of its name."""
    names = [p.name for p in hints.parts]
    if part.name not in names:
        return replace(hints, parts=(*hints.parts, part))
    return replace(hints, parts=tuple(part if p.name == part.name else p for p in hints.parts))


def _without(hints: Hints, primitives: Iterable[int]) -> Hints:
    """Hints in which nobody claims some primitives; a part that had no others goes."""
    gone = set(primitives)

    def left(own: tuple[int, ...]) -> tuple[int, ...]:
        return tuple(p for p in own if p not in gone)

    parts = [replace(p, primitives=left(p.primitives)) for p in hints.parts]
    kept = tuple(p for p in parts if p.primitives or p.nodes or p.box is not None)
    merges = tuple(m for group in hints.merge if len(m := left(group)) > 1)
    return replace(hints, parts=kept, fixed=left(hints.fixed), merge=merges)


def _hung(hints: Hints, old: str, new: str) -> Hints:
    """What was said to hang on `old` hangs on `new`."""
    return replace(hints, parts=tuple(
        replace(p, parent=new) if p.parent == old and p.name != new else p for p in hints.parts
    ))  # fmt: skip


def _triple(vector: ArrayLike) -> tuple[float, float, float]:
    x, y, z = (float(v) for v in np.asarray(vector, dtype=np.float64).reshape(3))
    return x, y, z
