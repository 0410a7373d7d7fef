"""From checked answers to the kinematic tree: parts, parents, motions, and joint lines.

The answer says of each part's axis which way it runs, on which side it lies and which way the part
opens. That selects; the measured ranking only orders the lines that agree, and where none does, one
is made from the part's box. A line may also be given by pieces that it runs through or along.
Physics vetoes a line by which the part is blocked from the start, and a hinge line that lies beside
the bodies that it joins. Then ranges are set as answered.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mam_pipeline.evidence.names import part_kind_of
from mam_pipeline.geometry.boxes import minimal_box
from mam_pipeline.geometry.frames import estimate_frame
from mam_pipeline.geometry.sampling import unit
from mam_pipeline.joints.candidates import rank_hypotheses
from mam_pipeline.joints.estimate import ESTIMATE, JointEstimator, topological_order
from mam_pipeline.joints.limits import RANGES
from mam_pipeline.models.questions import (
    Details,
    Group,
    JointCheck,
    MotionCheck,
    Mount,
    Mounting,
)
from mam_pipeline.segment.topology import without_repeats
from mam_pipeline.types import (
    FloatArray,
    IntArray,
    Joint,
    JointCandidate,
    KinematicTree,
    Mesh,
    PartNode,
    Primitives,
)


@dataclass(frozen=True)
class AnswerThresholds:
    """How the words of an answer are read.

    Attributes:
        along: cosine from which a line runs along an answered direction (25 degrees).
        aside: share of the part's extent off its middle from which a line lies on a side.
        against: cosine below which a motion starts against the answered way.
        kept: lines that a part keeps.
        other_lines: lines that are tried where the answered one is blocked from the start.
    """

    along: float = float(np.cos(np.radians(25.0)))
    aside: float = 0.25
    against: float = -0.2
    kept: int = 12
    other_lines: int = 12


ANSWERS = AnswerThresholds()
Lines = Sequence[JointCandidate]
Points = Callable[[int], FloatArray]
"""(n, 3) corners of a numbered piece."""


@dataclass(frozen=True)
class Answered:
    """A tree as it was answered, and what is needed to correct it.

    Attributes:
        mounts: how each part but the base is mounted, by name.
        stands_for: (P,) the numbered primitive of each one.
        lines: all measured lines of a part, of every kind of motion, by name.
        settled_lines: names of the parts whose line was chosen among pictures, or left as it was
            shown where its range was corrected.
    """

    tree: KinematicTree
    mounts: Mapping[str, Mount]
    stands_for: IntArray
    lines: Mapping[str, Lines] = field(default_factory=dict)
    settled_lines: frozenset[str] = frozenset()


def tree_of(
    groups: Sequence[Group],
    mounting: Mounting,
    stands_for: IntArray,
    mesh: Mesh,
    primitives: Primitives,
    evidence: Mapping[str, Any],
    seed: int = 0,
) -> Answered:
    """The tree that the answers describe; `groups[0]` is the base.

    Args:
        stands_for: (P,) the numbered primitive of each one. evidence: goes to the base.
    """
    index = {g.name: i for i, g in enumerate(groups)}
    mounts = {m.name: m for m in mounting.mounts}
    owner = np.zeros(primitives.count, dtype=np.int64)  # the base has what nobody names
    for i, group in enumerate(groups):
        owner[np.isin(stands_for, group.pieces)] = i
    nodes = []
    for i, group in enumerate(groups):
        mount = mounts.get(group.name)
        nodes.append(
            PartNode(
                name=group.name,
                kind=group.kind,
                primitives=_members(owner, i),
                parent=-1 if mount is None else index[mount.parent],
                subtype="fixed" if mount is None else mount.motion,
                confidence=group.confidence * (1.0 if mount is None else mount.confidence),
                runner_up="" if mount is None else f"{mount.second_best} instead",
                evidence=dict(evidence) if mount is None else {"answer": mount.model_dump()},
            )
        )
    everyone = frozenset(mounts)
    return _with_lines(
        Answered(KinematicTree(tuple(nodes)), mounts, stands_for), everyone, mesh, primitives, seed
    )


def corrected(
    answered: Answered,
    check: MotionCheck,
    shown: Mapping[str, Lines],
    joints: Mapping[str, Joint],
    mesh: Mesh,
    primitives: Primitives,
    seed: int = 0,
) -> Answered:
    """The tree after a look at how it moves, checked by physics and with its ranges.

    Args:
        shown: the other lines that were shown for a part, in the order of their numbers.
        joints: as they were shown, by the part's name.
    """
    changes = {joint.name: joint for joint in check.joints if not joint.ok}
    before = {n.name: set(n.primitives) for n in answered.tree.nodes}
    nodes, mounts = _moved_pieces(answered, check, changes, primitives.count)
    mounts = {n: _changed(m, changes.get(n), shown.get(n, ())) for n, m in mounts.items()}
    index = {node.name: i for i, node in enumerate(nodes)}
    nodes = [
        node if i == 0 else replace(
            node, parent=index.get(mounts[node.name].parent, 0), subtype=mounts[node.name].motion,
            evidence={**node.evidence, "answer": mounts[node.name].model_dump()},
        )
        for i, node in enumerate(nodes)
    ]  # fmt: skip
    tree = KinematicTree(tuple(nodes))
    numbers = {name for name, change in changes.items() if change.only_numbers}
    known = (answered.settled_lines - set(changes) | numbers) & set(mounts)
    new = replace(answered, tree=tree, mounts=mounts, settled_lines=known)
    touched = {n.name for n in nodes if set(n.primitives) != before.get(n.name)}
    touched |= set(changes) - numbers
    new = _with_lines(new, frozenset(touched & set(mounts)), mesh, primitives, seed)
    new = _as_chosen(new, changes, shown, mesh, primitives)
    return with_ranges(unblocked(new, mesh, primitives, seed), mesh, primitives, joints)


def _moved_pieces(
    answered: Answered, check: MotionCheck, changes: Mapping[str, JointCheck], count: int,
) -> tuple[list[PartNode], dict[str, Mount]]:  # fmt: skip
    """Nodes and mounts after the transfers; a part without pieces is gone."""
    nodes, mounts = list(answered.tree.nodes), dict(answered.mounts)
    owner = np.zeros(count, dtype=np.int64)
    for i, node in enumerate(nodes):
        owner[list(node.primitives)] = i
    names = [node.name for node in nodes]
    for transfer in check.transfers:
        if transfer.to not in names:
            names.append(transfer.to)
            nodes.append(PartNode(transfer.to, "part", (), 0, "fixed"))
            mounts[transfer.to] = _new_mount(changes[transfer.to], names[0])
        owner[np.isin(answered.stands_for, transfer.pieces)] = names.index(transfer.to)
    heir = {n.name: mounts[n.name].parent for n in nodes[1:]}
    gone = {name for i, name in enumerate(names) if i and not (owner == i).any()}
    kept = [replace(n, primitives=_members(owner, i)) for i, n in enumerate(nodes)
            if n.name not in gone]  # fmt: skip
    for name in set(mounts) - gone:
        parent = mounts[name].parent
        while parent in gone:
            parent = heir[parent]
        mounts[name] = mounts[name].model_copy(update={"parent": parent})
    return kept, {name: m for name, m in mounts.items() if name not in gone}


def _new_mount(joint: JointCheck, base: str) -> Mount:
    return Mount.model_validate({
        "name": joint.name, "parent": joint.parent or base, "motion": joint.motion,
        "confidence": 1.0, "second_best": "fixed", "axis": joint.axis, "side": joint.side,
        "opens": joint.opens, **joint.model_dump(include=set(Details.model_fields)),
    })  # fmt: skip


def _changed(mount: Mount, change: JointCheck | None, shown: Lines) -> Mount:
    if change is None:
        return mount
    words = {k: getattr(change, k) for k in ("motion", "axis", "side", "opens", "parent")}
    if change.line is not None:
        words["motion"] = words["motion"] or shown[change.line - 1].subtype
    gone: dict[str, Any] = {}
    if (words["motion"] or mount.motion) != mount.motion:  # degrees say nothing of a slide
        gone |= dict.fromkeys(("lower", "upper", "of", "endless", "usual"))
    if change.by_pieces or any(words[k] or change.line for k in ("motion", "axis", "side")):
        gone |= dict.fromkeys(("through", "along"))
    if change.lower is not None or change.upper is not None:
        gone |= {"usual": None, "endless": None}
    words |= change.model_dump(include=set(Details.model_fields))
    return mount.model_copy(update={**gone, **{k: v for k, v in words.items() if v is not None}})


def _as_chosen(
    answered: Answered, changes: Mapping[str, JointCheck], shown: Mapping[str, Lines],
    mesh: Mesh, primitives: Primitives,
) -> Answered:  # fmt: skip
    """With the lines that were chosen by number."""
    nodes, chosen = list(answered.tree.nodes), set(answered.settled_lines)
    for i, node in enumerate(nodes):
        change = changes.get(node.name)
        if change is None or change.line is None or node.subtype == "fixed":
            continue
        line = replace(shown[node.name][change.line - 1], subtype=node.subtype)
        box = _box(mesh, np.isin(primitives.labels, node.primitives))
        line = _opening(line, answered.mounts[node.name], box)
        nodes[i] = replace(node, candidates=(line,))
        chosen.add(node.name)
    tree = KinematicTree(tuple(nodes))
    return replace(answered, tree=tree, settled_lines=frozenset(chosen))


def with_ranges(
    answered: Answered, mesh: Mesh, primitives: Primitives,
    joints: Mapping[str, Joint] | None = None,
) -> Answered:  # fmt: skip
    """The tree with the ranges that were answered; what turns without end as usual does so here.

    Args:
        joints: as they were shown, by the part's name: the other end where one is answered.
    """
    nodes = list(answered.tree.nodes)
    for i, node in enumerate(nodes):
        if i == 0 or node.subtype == "fixed" or not node.candidates:
            continue
        mount, axis = answered.mounts[node.name], node.candidates[0].axis
        if mount.endless is False and node.subtype == "spin":  # it turns, and has ends
            node = _hinged(node)
        evidence = {k: v for k, v in node.evidence.items() if k != "range"}
        limits: tuple[float, float] | None = -np.inf, np.inf
        if mount.usual:
            depth = extent(mesh, primitives, nodes[node.parent], axis)
            limits, why = usual_range(node.kind, node.name, node.subtype, depth)
            evidence["range"] = f"{why}, as answered, whatever overlaps on the way"
        elif not _endless(node, mount):
            scale = float(np.pi / 180.0)
            if node.subtype == "slide" and mount.of == "object":
                scale = float(np.ptp(mesh.bounds, axis=0).max()) / 100.0
            elif node.subtype == "slide":
                carrier = nodes[node.parent] if mount.of == "carrier" else node
                scale = extent(mesh, primitives, carrier, axis) / 100.0
            limits = _limits(mount, node, scale, (joints or {}).get(node.name))
        nodes[i] = replace(node, limits=limits, evidence=evidence)
    return replace(answered, tree=KinematicTree(tuple(nodes)))


def _hinged(node: PartNode) -> PartNode:
    """A part that turns, with the ends that physics finds."""
    lines = tuple(
        replace(c, subtype="hinge") if c.subtype == "spin" else c for c in node.candidates
    )
    return replace(node, subtype="hinge", candidates=lines)


def usual_range(
    kind: str, name: str, subtype: str, depth: float
) -> tuple[tuple[float, float], str]:
    """How far a part of some kind usually goes, radians or metres, and that in words.

    Args:
        depth: of what carries it, along the way it slides, metres.
    """
    known = part_kind_of(kind) or part_kind_of(name)
    if known is not None and known.moves == subtype and known.travel is not None:
        middle = sum(known.travel) / 2.0
        far = middle * depth if subtype == "slide" else float(np.radians(middle))
        return (0.0, far), f"as usual for a {known.kind}"
    if subtype == "spin":
        return (-np.inf, np.inf), "without end, as usual"
    return (0.0, RANGES.slide * depth if subtype == "slide" else RANGES.hinge), "as usual"


def extent(mesh: Mesh, primitives: Primitives, node: PartNode, axis: FloatArray) -> float:
    """How long a part is along an axis, metres."""
    return float(np.ptp(_corners(mesh, np.isin(primitives.labels, node.primitives)) @ axis))


def _endless(node: PartNode, mount: Mount) -> bool:
    """Whether a part turns without end: as answered, else as parts of its kind do."""
    if mount.endless is not None:
        return mount.endless and node.subtype != "slide"
    known = part_kind_of(node.kind) or part_kind_of(node.name)
    usual = known is not None and known.moves == "spin" and known.travel is None
    return usual and node.subtype == "spin" and mount.lower is None and mount.upper is None


def _limits(
    mount: Mount, node: PartNode, scale: float, joint: Joint | None
) -> tuple[float, float] | None:
    """The range that was answered in numbers, radians or metres; None where none was.

    Args:
        scale: of the answer's numbers.
    """
    if mount.lower is None and mount.upper is None:
        return None
    same = joint is not None and (joint.type == "prismatic") == (node.subtype == "slide")
    known = (joint.lower, joint.upper) if same and joint is not None else (0.0, 0.0)
    known = known if np.isfinite(known).all() else (0.0, 0.0)
    lower = known[0] if mount.lower is None else mount.lower * scale
    upper = known[1] if mount.upper is None else mount.upper * scale
    lower = min(lower, upper)
    return None if upper - lower < 1e-6 else (lower, upper)


def _members(owner: IntArray, index: int) -> tuple[int, ...]:
    return tuple(int(p) for p in np.flatnonzero(owner == index))


def _corners(mesh: Mesh, faces: Any) -> FloatArray:
    """(n, 3) corners of some faces."""
    return np.asarray(mesh.vertices[mesh.faces[faces].reshape(-1)])


def _box(mesh: Mesh, faces: Any) -> FloatArray:
    """(2, 3) corners of the box around some faces."""
    points = _corners(mesh, faces)
    return np.stack([points.min(axis=0), points.max(axis=0)])


def _with_lines(
    answered: Answered, names: frozenset[str], mesh: Mesh, primitives: Primitives, seed: int
) -> Answered:
    """New lines for the parts of `names`, and for those that carry one of them."""
    tree, lines = answered.tree, dict(answered.lines)
    frame = estimate_frame(mesh)
    owner = np.zeros(primitives.count, dtype=np.int64)
    for i, node in enumerate(tree.nodes):
        owner[list(node.primitives)] = i
    face_node = owner[primitives.labels]
    shown = answered.stands_for[primitives.labels]
    out = list(tree.nodes)
    for i, node in enumerate(tree.nodes[1:], start=1):
        group = carried(tree, i)
        if not any(tree.nodes[k].name in names for k in group):
            continue
        if node.name not in names and node.name in answered.settled_lines:
            continue
        moving = np.isin(face_node, group)
        if node.subtype == "fixed" or not moving.any() or moving.all():
            out[i] = replace(node, candidates=(), limits=None)
            continue
        lines[node.name] = rank_hypotheses(
            mesh, np.flatnonzero(moving), np.flatnonzero(~moving), frame=frame, seed=seed,
            parent_faces=np.flatnonzero(face_node == node.parent), top=1000,
            fused=primitives.is_fused,
        )  # fmt: skip
        meant = meant_lines(
            lines[node.name], answered.mounts[node.name], _box(mesh, face_node == i),
            lambda piece: _corners(mesh, shown == piece),
        )  # fmt: skip
        out[i] = replace(node, candidates=tuple(meant[: ANSWERS.kept]), limits=None)
    return replace(answered, tree=KinematicTree(tuple(out)), lines=lines)


def meant_lines(
    lines: Lines, mount: Mount, box: FloatArray, points: Points | None = None
) -> list[JointCandidate]:
    """The lines that an answer means, the one that was measured best first.

    A line that is given by pieces is taken as it is. Else the answered direction and side select.
    Where no measured line agrees with both, the line is made from the part's box; where the
    direction is "other" and none lies on that side, the measurement decides.

    Args:
        lines: with log probabilities as scores. box: (2, 3) of the part alone, asset frame.
        points: of a piece, for lines that are given by pieces.
    """
    kinds = ("slide",) if mount.motion == "slide" else ("hinge", "spin")
    own = sorted((line for line in lines if line.subtype in kinds), key=lambda c: -c.score)
    if points is not None and mount.by_pieces:
        return [_opening(_line_of_pieces(mount, points, own), mount, box)]
    meant = [line for line in own if _agrees(line, mount, box)]
    if not meant and mount.axis != "other":
        meant = [line_of_box(mount, box)]
    meant = meant or own
    among = float(np.sum([c.within_kind or 0.0 for c in meant]))
    return [
        replace(
            _opening(line, mount, box), subtype=mount.motion,
            within_kind=None if line.within_kind is None else line.within_kind / max(among, 1e-12),
        )
        for line in meant
    ]  # fmt: skip


def _line_of_pieces(mount: Mount, points: Points, measured: Lines) -> JointCandidate:
    """The line through the middle of one piece or of two, or along the longest edge of one.

    Args:
        measured: best first; their direction is taken where no other is given.
    """
    first = points(mount.by_pieces[0])
    origin = (first.min(axis=0) + first.max(axis=0)) / 2
    if mount.along is not None:
        box = minimal_box(first)
        longest = int(np.argmax(box.half))
        axis, origin = box.axes[longest], box.center
        towards = box.axes @ direction(mount.side)
        towards[longest] = 0.0
        if np.abs(towards).max() > ANSWERS.aside:
            k = int(np.argmax(np.abs(towards)))
            origin = origin + np.sign(towards[k]) * box.half[k] * box.axes[k]
    elif len(mount.by_pieces) == 2:
        second = points(mount.by_pieces[1])
        axis = (second.min(axis=0) + second.max(axis=0)) / 2 - origin
    elif mount.axis != "other" or not measured:
        axis = np.eye(3)["xyz".find(mount.axis) if mount.axis != "other" else 2]
    else:
        axis = measured[0].axis
    return JointCandidate(mount.motion, unit(axis), origin, 0.0, {"made_from_the_answer": 1.0})


def line_of_box(mount: Mount, box: FloatArray) -> JointCandidate:
    """The line that an answer describes on the part's box: through the middle of a side."""
    origin = box.mean(axis=0)
    if mount.motion != "slide" and mount.side != "middle":
        way = direction(mount.side)
        origin = origin + way * np.ptp(box, axis=0) / 2
    axis = np.eye(3)["xyz".index(mount.axis)]
    return JointCandidate(mount.motion, axis, origin, 0.0, {"made_from_the_answer": 1.0})


def _agrees(line: JointCandidate, mount: Mount, box: FloatArray) -> bool:
    """Whether a line runs and lies as the answer says."""
    if mount.axis != "other":
        if abs(line.axis["xyz".index(mount.axis)]) < ANSWERS.along:
            return False
    elif mount.motion == "slide" and mount.opens != "either":
        return abs(float(line.axis @ direction(mount.opens))) > -ANSWERS.against
    return mount.motion == "slide" or on_side(line, mount.side, box)


def unblocked(answered: Answered, mesh: Mesh, primitives: Primitives, seed: int = 0) -> Answered:
    """The tree without lines by which a part is blocked from the start in both directions, or that
    lie beside the bodies that they join.

    Of a blocked part the way back is tried first, then the other lines of that kind of motion as
    they were measured; what was done stands in the part's evidence.
    """
    estimator = JointEstimator(*without_repeats(mesh, primitives), seed)
    tree = answered.tree

    def free(index: int, lines: Lines) -> bool:
        node = replace(tree.nodes[index], candidates=tuple(lines))
        nodes = (*tree.nodes[:index], node, *tree.nodes[index + 1 :])
        found = estimator.estimate(estimator.turned(KinematicTree(nodes)), index)
        return found is None or found.limits.rule != "token"

    for i in topological_order(tree):
        node = tree.nodes[i]
        if node.subtype == "fixed" or node.limits is not None or not node.candidates:
            continue
        if node.name in answered.settled_lines:
            continue
        node = _on_bodies(
            answered, tree, i, estimator, _box(mesh, np.isin(primitives.labels, node.primitives))
        )
        tree = KinematicTree((*tree.nodes[:i], node, *tree.nodes[i + 1 :]))
        if free(i, node.candidates):
            continue
        back = [replace(c, axis=-c.axis) for c in node.candidates]
        kinds = ("slide",) if node.subtype == "slide" else ("hinge", "spin")
        known = {(c.axis.tobytes(), c.origin.tobytes()) for c in (*node.candidates, *back)}
        others = [
            c for c in answered.lines.get(node.name, ())
            if c.subtype in kinds and (c.axis.tobytes(), c.origin.tobytes()) not in known
        ][: ANSWERS.other_lines]  # fmt: skip
        said = "the answered line is blocked from the start in both directions"
        lines: Lines = node.candidates
        if free(i, back):
            lines, said = back, "blocked from the start in the answered direction: opens the other"
        elif (other := next((c for c in others if free(i, [c])), None)) is not None:
            lines, said = (other,), f"{said}: the likeliest free one that was measured is taken"
        node = replace(node, candidates=tuple(lines), evidence={**node.evidence, "physics": said})
        tree = KinematicTree((*tree.nodes[:i], node, *tree.nodes[i + 1 :]))
    return replace(answered, tree=tree)


def _on_bodies(
    answered: Answered, tree: KinematicTree, index: int, estimator: JointEstimator, box: FloatArray
) -> PartNode:
    """The node; where all its hinge lines lie beside part or body, with one that stays on both.

    It runs the same way and lies on the answered side of the middle, as far to that side as one
    that stays on both does: a handle's spindle is nearer to its middle than its end is.

    Args:
        estimator: of the same mesh. box: (2, 3) of the part, asset frame.
    """
    node = tree.nodes[index]
    mount, first = answered.mounts[node.name], node.candidates[0]
    if node.subtype == "slide" or mount.side == "middle" or mount.by_pieces:
        return node

    def staying(lines: Lines) -> list[int]:
        new = replace(node, candidates=tuple(lines))
        nodes = (*tree.nodes[:index], new, *tree.nodes[index + 1 :])
        return estimator.staying(estimator.turned(KinematicTree(nodes)), index)

    if staying(node.candidates):
        return node
    way = direction(mount.side)
    measured = sorted(answered.lines.get(node.name, ()), key=lambda c: -c.score)
    others = [
        c for c in measured
        if c.subtype in ("hinge", "spin") and abs(float(c.axis @ first.axis)) > ESTIMATE.parallel
        and float((c.origin - box.mean(axis=0)) @ way) > 0.0
    ][: ANSWERS.other_lines]  # fmt: skip
    on_both = [others[k] for k in staying(others)]
    if not on_both:
        return node
    on_both.sort(key=lambda c: -float(c.origin @ way))
    among = float(np.sum([c.within_kind or 0.0 for c in on_both]))
    lines = tuple(
        replace(
            _opening(c, mount, box), subtype=node.subtype,
            within_kind=None if c.within_kind is None else c.within_kind / max(among, 1e-12),
        )
        for c in on_both
    )  # fmt: skip
    said = "the answered line lies beside what it joins: the nearest to it on both is taken"
    return replace(node, candidates=lines, evidence={**node.evidence, "physics": said})


def on_side(line: JointCandidate, side: str, box: FloatArray) -> bool:
    """Whether a line passes the part's box on that side of its middle ("middle": through it)."""
    middle, extent = box.mean(axis=0), np.maximum(np.ptp(box, axis=0), 1e-9)
    offset = line.origin - middle
    offset = (offset - (offset @ line.axis) * line.axis) / extent
    if side == "middle":
        return bool(np.abs(offset).max() < ANSWERS.aside)
    sign, axis = (1.0 if side[0] == "+" else -1.0), "xyz".index(side[1])
    return bool(sign * offset[axis] > ANSWERS.aside)


def direction(name: str) -> FloatArray:
    """(3,) unit vector of a name like "-y"; zero for "either" and "middle"."""
    out = np.zeros(3)
    if name[0] in "+-":
        out["xyz".index(name[1])] = 1.0 if name[0] == "+" else -1.0
    return out


def carried(tree: KinematicTree, index: int) -> list[int]:
    """The node and all that hangs on it."""
    out = [index]
    for k in out:
        out += [i for i, n in enumerate(tree.nodes) if n.parent == k]
    return out


def _opening(line: JointCandidate, mount: Mount, box: FloatArray) -> JointCandidate:
    """The line with its axis turned so that positive motion opens the way the answer says."""
    goal = direction(mount.opens)
    if line.subtype == "slide":
        start = line.axis
    else:
        arm = box.mean(axis=0) - line.origin
        start = np.cross(line.axis, arm)
        start = start / max(float(np.linalg.norm(start)), 1e-9)
    against = float(start @ goal)
    return replace(line, axis=-line.axis) if against < ANSWERS.against else line
