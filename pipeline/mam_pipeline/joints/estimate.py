"""The joint of one part of a given tree: the best hypothesis by which it can move, and its limits.

Both who decides on parts and who writes joints ask here. Estimates are remembered by what they were
made from, so that the solver finds again what the parts stage has asked.
"""

from __future__ import annotations

import hashlib
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar

import numpy as np

from mam_pipeline.geometry.frames import ObjectFrame
from mam_pipeline.geometry.hinge_line import HingeBodies
from mam_pipeline.geometry.motion import Motion
from mam_pipeline.geometry.sweep import SweepScene
from mam_pipeline.joints.candidates import rank_hypotheses
from mam_pipeline.joints.closing import CLOSING, at_edge, closing_of
from mam_pipeline.joints.limits import Limits, Surroundings, embedded_limits
from mam_pipeline.joints.straight import straightened, turned_tree
from mam_pipeline.rules import ALL_RULES, Rules
from mam_pipeline.thresholds import THRESHOLDS
from mam_pipeline.types import (
    IntArray,
    Joint,
    JointCandidate,
    KinematicTree,
    Mesh,
    PartNode,
    Primitives,
)

T = TypeVar("T")


@dataclass(frozen=True)
class EstimateThresholds:
    """When a line gives way to another, and which mean the same joint.

    Attributes:
        same_way: cosine between axes that mean the same joint.
        lines: hinge lines, best first, that are tried on both bodies.
        nearly_parallel: log odds below the best line at which a parallel one may take its place.
        nearly: log odds below the best line at which one that runs another way may take its place.
        parallel: cosine between lines that run the same way.
        close: diagonals of the object that such lines may lie apart.
        close_own: diagonals of the part that such lines may lie apart.
        on_line: share of the check's tolerance that a line may stray from both bodies.
        remembered: estimates that are kept for who asks again.
        surroundings: of as many parts, for who asks about another line of the same part.
    """

    lines: int = 40
    nearly_parallel: float = 3.0
    nearly: float = 1.6
    parallel: float = 0.99
    same_way: float = 0.995
    close: float = 0.03
    close_own: float = 0.1
    on_line: float = 0.9
    remembered: int = 64
    surroundings: int = 8


ESTIMATE = EstimateThresholds()
# hand rules that an estimate depends on
OF_JOINTS = ("on_both_bodies", "sunken_slide", "siblings", "plain_travel")


@dataclass(frozen=True)
class PartFaces:
    """Faces around one joint: of the link, of all that moves with it, and of what does not.

    Attributes:
        own: of the link. moving: with its descendants. static: everything else.
        parent: of the parent link. fixed: static without the link's movable siblings.
        fused: whether all of them were cut out of one fused surface.
    """

    own: IntArray
    moving: IntArray
    static: IntArray
    parent: IntArray
    fixed: IntArray
    fused: bool = False


@dataclass(frozen=True)
class Estimate:
    """What was found for one part.

    Attributes:
        chosen: the hypothesis, its axis turned so that positive motion opens.
        limits: of the joint. sure: probability that the hypothesis is right, given part and type.
        candidates: the hypotheses of its type, best first.
        contact: where the part touches what stands still, for the report.
    """

    chosen: JointCandidate
    limits: Limits
    sure: float
    candidates: tuple[JointCandidate, ...]
    contact: Mapping[str, Any]

    @property
    def share(self) -> float:
        """Which share of its usual way the part goes by itself; 1 where nobody measured."""
        return self.limits.share * (1.0 if self.limits.sibling_at is None else 0.5)


class JointEstimator:
    """Estimates joints of one object, in the frame of its own walls.

    Attributes:
        mesh: with one copy of every face, straightened. primitives: of its faces.
        frame: of `mesh`. rotation: (3, 3) own_R_asset, or None where the object stands straight.
    """

    def __init__(
        self, mesh: Mesh, primitives: Primitives, seed: int = 0, rules: Rules = ALL_RULES
    ) -> None:
        self.mesh, self.frame, self.rotation = straightened(mesh)
        self.primitives, self.seed, self.rules = primitives, seed, rules
        self._digest = hashlib.sha256(self.mesh.vertices.tobytes() + self.mesh.faces.tobytes())

    def turned(self, tree: KinematicTree) -> KinematicTree:
        """A tree in the asset frame as this estimator needs it."""
        return tree if self.rotation is None else turned_tree(tree, self.rotation)

    def faces(self, tree: KinematicTree, index: int) -> PartFaces:
        """Which faces move with a node, and which stand still."""
        return faces_around(tree, self.primitives, index)

    def estimate(self, tree: KinematicTree, index: int) -> Estimate | None:
        """The joint of a node of a `turned` tree; None where nothing can move."""
        node, faces = tree.nodes[index], self.faces(tree, index)
        if node.subtype == "fixed" or not len(faces.moving) or not len(faces.static):
            return None
        key = self._key(node, faces)
        return _kept(_REMEMBERED, key, ESTIMATE.remembered, lambda: self._estimate(node, faces))

    def staying(self, tree: KinematicTree, index: int) -> list[int]:
        """Which hinge lines of a node of a `turned` tree stay on both bodies; indices."""
        faces = self.faces(tree, index)
        rest_gap = self._around(faces.moving, faces.static).paths.rest_gap
        stays = stays_on_both(self.mesh, faces, rest_gap)
        return [k for k, c in enumerate(tree.nodes[index].candidates) if stays(c)]

    def free(self, faces: PartFaces, joint: Joint, end: float) -> float:
        """How far towards `end` (signed) a joint's part goes before it meets something."""
        motion: Motion = "prismatic" if joint.type == "prismatic" else "revolute"
        line = joint.axis.tobytes() + joint.origin.tobytes()
        key = self._around_key(faces.moving, faces.static) + repr((motion, line, end))

        def found() -> float:
            around = self._around(faces.moving, faces.static)
            return around.free(motion, joint.axis, joint.origin, end)[0]

        return _kept(_FREE, key, ESTIMATE.remembered, found)

    def _around_key(self, moving: IntArray, static: IntArray) -> str:
        digest = self._digest.copy()
        digest.update(moving.tobytes() + b"|" + static.tobytes() + bytes(str(self.seed), "ascii"))
        return digest.hexdigest()

    def _around(self, moving: IntArray, static: IntArray) -> Surroundings:
        """What a part may run into; the same for all lines of it that are asked about."""
        return _kept(
            _AROUND, self._around_key(moving, static), ESTIMATE.surroundings,
            lambda: Surroundings.of(self.mesh, moving, static, self.seed),
        )  # fmt: skip

    def _key(self, node: PartNode, faces: PartFaces) -> str:
        digest = self._digest.copy()
        for own in (faces.own, faces.moving, faces.static, faces.parent, faces.fixed):
            digest.update(b"|" + own.tobytes())
        for c in node.candidates:
            digest.update(c.axis.tobytes() + c.origin.tobytes())
            digest.update(repr((c.subtype, c.score, c.within_kind, c.travel)).encode())
        about = node.subtype, node.limits, node.provenance == "user", faces.fused
        rules = [getattr(self.rules, name) for name in OF_JOINTS]
        digest.update(repr((about, rules, self.seed)).encode())
        return digest.hexdigest()

    def _estimate(self, node: PartNode, faces: PartFaces) -> Estimate:
        mesh, rules = self.mesh, self.rules
        around = self._around(faces.moving, faces.static)
        ranked = candidates = choose_candidates(mesh, self.frame, node, faces, self.seed, rules)
        if rules.on_both_bodies and node.subtype != "slide" and node.provenance != "user":
            candidates = on_both(mesh, faces, candidates, around.paths.rest_gap)
        alone = None
        if rules.siblings and len(faces.fixed) < len(faces.static) and len(faces.fixed):
            alone = cache(lambda: self._around(faces.moving, faces.fixed))

        def limits_of(c: JointCandidate, closing: float = 0.0) -> Limits:
            given = node.limits if c is candidates[0] else None
            return embedded_limits(
                around, c.subtype, c.axis, c.origin, alone=alone, given=given, usual=c.travel,
                plain=rules.plain_travel, closing=closing,
            )  # fmt: skip

        near = min(ESTIMATE.close * mesh.diagonal, ESTIMATE.close_own * _size(mesh, faces.own))
        best = candidates[0]
        limits = limits_of(best)
        if node.subtype == "hinge" and node.limits is None and node.provenance != "user":
            shut = closing_of(mesh, faces.moving, faces.parent, best)
            closing = None if shut is None else limits_of(shut.line, shut.way)
            if shut is not None and closing is not None and closing.lower <= -0.9 * shut.way:
                best, limits = shut.line, closing
            if limits.rule == "collision" and limits.share < CLOSING.jams:
                touching = around.scene.contact().points
                edge = at_edge(mesh, faces.moving, faces.parent, best, touching)
                freed = None if edge is None else limits_of(edge)
                if edge is not None and freed is not None and freed.share >= CLOSING.runs:
                    best, limits = edge, freed
        sure = 1.0 if node.provenance == "user" else agreement(best, ranked, near)
        contact = contact_evidence(around.scene)
        return Estimate(best, limits, sure, tuple(candidates), contact)


_REMEMBERED: OrderedDict[str, Estimate] = OrderedDict()
_AROUND: OrderedDict[str, Surroundings] = OrderedDict()
_FREE: OrderedDict[str, float] = OrderedDict()


def _kept(store: OrderedDict[str, T], key: str, most: int, make: Callable[[], T]) -> T:
    """What is remembered under a key, or made and remembered; what was asked for longest ago goes.

    Args:
        most: values that are kept.
    """
    found = store.pop(key, None)
    store[key] = found = make() if found is None else found
    while len(store) > most:
        store.popitem(last=False)
    return found


def faces_around(tree: KinematicTree, primitives: Primitives, index: int) -> PartFaces:
    """Which faces move with node `index`, and which stand still."""
    owner = np.full(primitives.count, -1, dtype=np.int64)
    for i, node in enumerate(tree.nodes):
        owner[list(node.primitives)] = i
    face_node = owner[primitives.labels]
    moving = {index}
    while True:
        more = {i for i, n in enumerate(tree.nodes) if n.parent in moving} - moving
        if not more:
            break
        moving |= more
    parent = tree.nodes[index].parent
    trunk, above = {0}, parent
    while above > 0:
        trunk.add(above)
        above = tree.nodes[above].parent
    stiff = {i for i, n in enumerate(tree.nodes)
             if n.subtype == "fixed" and n.parent in trunk} - moving  # fmt: skip

    def gather(chosen: set[int]) -> IntArray:
        return np.flatnonzero(np.isin(face_node, sorted(chosen)))

    rest = set(range(len(tree.nodes))) - moving
    return PartFaces(
        gather({index}), gather(moving), gather(rest), gather({parent}), gather(trunk | stiff),
        primitives.is_fused,
    )  # fmt: skip


def topological_order(tree: KinematicTree) -> list[int]:
    """Indices of all nodes but the base, parents first."""
    depth = {0: 0}
    left = list(range(1, len(tree.nodes)))
    while left:
        ready = [i for i in left if tree.nodes[i].parent in depth]
        if not ready:
            raise ValueError(f"parts {[tree.nodes[i].name for i in left]} form a loop")
        for i in ready:
            depth[i] = depth[tree.nodes[i].parent] + 1
        left = [i for i in left if i not in depth]
    return [i for i in depth if i != 0]


def choose_candidates(
    mesh: Mesh, frame: ObjectFrame, node: PartNode, faces: PartFaces, seed: int,
    rules: Rules = ALL_RULES,
) -> list[JointCandidate]:  # fmt: skip
    """Hypotheses of the node's kind of motion, best first.

    A person's axis is obeyed; the reasoner's ranked candidates are reused; else they are made here.
    """
    user = user_candidate(node)
    if user is not None:
        return [user]
    kinds = ("slide",) if node.subtype == "slide" else ("hinge", "spin")
    known = [c for c in node.candidates if c.subtype in kinds]
    if not known:
        parent = faces.parent if len(faces.parent) else faces.static
        known = [
            c for c in rank_hypotheses(
                mesh, faces.moving, faces.static, frame=frame, parent_faces=parent, seed=seed,
                top=1000, fused=faces.fused, rules=rules,
            ) if c.subtype in kinds
        ]  # fmt: skip
    return known


def user_candidate(node: PartNode) -> JointCandidate | None:
    """The joint that a person gave for this part, if any."""
    if node.provenance != "user" or not node.candidates:
        return None
    first = node.candidates[0]
    return first if first.subtype == node.subtype else None


def agreement(best: JointCandidate, ranked: Sequence[JointCandidate], near: float) -> float:
    """Probability of all hypotheses of a kind that mean the same joint as `best`; 1 if none has
    one. Lines mean the same when they run the same way, less than `near` apart."""
    if best.within_kind is None:
        return 1.0
    same = [c for c in ranked if same_joint(c, best, near)]
    return min(sum(c.within_kind or 0.0 for c in same), 1.0)


def same_joint(one: JointCandidate, other: JointCandidate, near: float) -> bool:
    """Whether two hypotheses of a kind run the same way, less than `near` apart."""
    apart = np.linalg.norm(np.cross(one.origin - other.origin, other.axis))
    close = one.subtype == "slide" or apart <= near
    return bool(close and abs(float(one.axis @ other.axis)) > ESTIMATE.same_way)


def on_both(
    mesh: Mesh, faces: PartFaces, candidates: list[JointCandidate], rest_gap: float
) -> list[JointCandidate]:
    """The candidates whose line stays on both bodies, as the check asks, and is nearly as probable
    as the best or parallel to it; all candidates if there is none."""
    best, stays = candidates[0], stays_on_both(mesh, faces, rest_gap)

    def near(c: JointCandidate) -> bool:
        parallel = abs(float(c.axis @ best.axis)) > ESTIMATE.parallel
        return c.score >= best.score - (ESTIMATE.nearly_parallel if parallel else ESTIMATE.nearly)

    lines = [c for c in candidates[: ESTIMATE.lines] if near(c)]
    return [c for c in lines if stays(c)] or candidates


def stays_on_both(
    mesh: Mesh, faces: PartFaces, rest_gap: float
) -> Callable[[JointCandidate], bool]:  # fmt: skip
    """Tells of a hinge line whether it stays on both bodies, as the check asks."""
    bodies = HingeBodies(mesh, faces.moving, faces.parent if len(faces.parent) else faces.static)
    most = ESTIMATE.on_line * THRESHOLDS.gap_share + rest_gap / max(mesh.diagonal, 1e-12)
    return lambda c: bodies.line_gap(c.axis, c.origin, bodies.encloses) <= most


def contact_evidence(scene: SweepScene) -> dict[str, Any]:
    """How a part touches what stands still, for the report."""
    found = scene.contact()
    return {"points": len(found.points), "share": round(found.share, 4),
            "gap": found.gap, "tau": found.tau}  # fmt: skip


def _size(mesh: Mesh, faces: IntArray) -> float:
    return float(np.linalg.norm(np.ptp(mesh.vertices[np.unique(mesh.faces[faces])], axis=0)))
