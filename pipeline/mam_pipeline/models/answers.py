"""From checked answers to the kinematic tree: parts, parents, motions, and ranked joint lines.

The answer says of each part's axis which way it runs, on which side it lies and which way the part
opens. It is weighed against the measured ranking of joint lines by how sure the answer is.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mam_pipeline.geometry.frames import estimate_frame
from mam_pipeline.joints.candidates import rank_hypotheses
from mam_pipeline.models.questions import Group, Mount, Mounting
from mam_pipeline.types import (
    FloatArray,
    IntArray,
    JointCandidate,
    KinematicTree,
    Mesh,
    PartNode,
    Primitives,
)

ALONG = np.cos(np.radians(25.0))
ASIDE = 0.25  # a line lies on a side when it is this share of the part's extent off its middle


def tree_of(
    groups: Sequence[Group],
    mounting: Mounting,
    stands_for: IntArray,
    mesh: Mesh,
    primitives: Primitives,
    evidence: Mapping[str, Any],
    seed: int = 0,
) -> KinematicTree:
    """The tree that two answers describe; `groups[0]` is the base.

    Args:
        stands_for: (P,) the numbered primitive of each one. evidence: goes to the base.
    """
    index = {g.name: i for i, g in enumerate(groups)}
    mounts = {m.name: m for m in mounting.mounts}
    nodes = []
    for group in groups:
        mount = mounts.get(group.name)
        nodes.append(
            PartNode(
                name=group.name,
                kind=group.kind,
                primitives=tuple(int(p) for p in np.flatnonzero(np.isin(stands_for, group.pieces))),
                parent=-1 if mount is None else index[mount.parent],
                subtype="fixed" if mount is None else mount.motion,
                confidence=group.confidence * (1.0 if mount is None else mount.confidence),
                runner_up="" if mount is None else f"{mount.second_best} instead",
                evidence=dict(evidence) if mount is None else {"answer": mount.model_dump()},
            )
        )
    return _with_lines(KinematicTree(tuple(nodes)), mounts, mesh, primitives, seed)


def _with_lines(
    tree: KinematicTree, mounts: Mapping[str, Mount], mesh: Mesh, primitives: Primitives, seed: int
) -> KinematicTree:
    frame = estimate_frame(mesh)
    owner = np.zeros(primitives.count, dtype=np.int64)
    for i, node in enumerate(tree.nodes):
        owner[list(node.primitives)] = i
    face_node = owner[primitives.labels]
    out = [tree.nodes[0]]
    for i, node in enumerate(tree.nodes[1:], start=1):
        moving = np.isin(face_node, carried(tree, i))
        if node.subtype == "fixed" or not moving.any() or moving.all():
            out.append(node)
            continue
        lines = rank_hypotheses(
            mesh, np.flatnonzero(moving), np.flatnonzero(~moving), frame=frame, seed=seed,
            parent_faces=np.flatnonzero(face_node == node.parent), top=1000,
            fused=primitives.is_fused,
        )  # fmt: skip
        box = mesh.vertices[mesh.faces[face_node == i].reshape(-1)]
        ranked = weigh(lines, mounts[node.name], np.stack([box.min(axis=0), box.max(axis=0)]))
        out.append(replace(node, candidates=tuple(ranked[:12])))
    return KinematicTree(tuple(out))


def weigh(lines: Sequence[JointCandidate], mount: Mount, box: FloatArray) -> list[JointCandidate]:
    """Lines of the answered motion, ranked by measurement and answer together, opening as told.

    Each of the answer's two statements on the line (direction, side) is evidence that is right
    with the probability the answer gives itself, at most 0.95.

    Args:
        lines: with log probabilities as scores. box: (2, 3) of the part alone, asset frame.
    """
    kinds = ("slide",) if mount.motion == "slide" else ("hinge", "spin")
    sure = float(np.clip(mount.confidence, 0.5, 0.95))
    odds = float(np.log(sure / (1.0 - sure)))
    out = []
    for line in lines:
        if line.subtype not in kinds:
            continue
        score = line.score
        if mount.axis != "other":
            along = abs(line.axis["xyz".index(mount.axis)]) > ALONG
            score += odds if along else 0.0
        if mount.motion != "slide":
            score += odds if on_side(line, mount.side, box) else 0.0
        out.append(replace(_opening(line, mount, box), score=score))
    return sorted(out, key=lambda c: -c.score)


def on_side(line: JointCandidate, side: str, box: FloatArray) -> bool:
    """Whether a line passes the part's box on that side of its middle ("middle": through it)."""
    middle, extent = box.mean(axis=0), np.maximum(np.ptp(box, axis=0), 1e-9)
    offset = line.origin - middle
    offset = (offset - (offset @ line.axis) * line.axis) / extent
    if side == "middle":
        return bool(np.abs(offset).max() < ASIDE)
    sign, axis = (1.0 if side[0] == "+" else -1.0), "xyz".index(side[1])
    return bool(sign * offset[axis] > ASIDE)


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
    return replace(line, axis=-line.axis) if against < -0.5 else line
