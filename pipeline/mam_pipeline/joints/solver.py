"""The solvers: from parts and their subtypes to joints with axes, origins and limits."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from mam_pipeline.backends import Availability
from mam_pipeline.geometry.frames import ObjectFrame
from mam_pipeline.geometry.hinge_line import HingeBodies
from mam_pipeline.geometry.sampling import unit
from mam_pipeline.geometry.sweep import SweepScene
from mam_pipeline.joints.blockers import STUCK, take_along
from mam_pipeline.joints.candidates import rank_hypotheses
from mam_pipeline.joints.fittings import carried
from mam_pipeline.joints.limits import (
    Limits,
    Surroundings,
    Usual,
    embedded_limits,
    moved_share,
    paper_limits,
)
from mam_pipeline.joints.optimise import Method, refine
from mam_pipeline.joints.paper import initialise, paper_part
from mam_pipeline.joints.straight import straightened, turned_joint, turned_tree
from mam_pipeline.segment.topology import without_repeats
from mam_pipeline.thresholds import THRESHOLDS
from mam_pipeline.types import (
    MOVES,
    Articulation,
    FloatArray,
    IntArray,
    Joint,
    JointCandidate,
    KinematicTree,
    Link,
    Mesh,
    PartNode,
    Primitives,
)

FALLBACKS = 12  # hypotheses, best first, that may be tried when the best one leaves a part stuck
TIED = 0.3  # log odds between two that are as probable
LINES = 40  # hinge lines, best first, that are tried on both bodies
NEARLY = 1.6  # log odds below the best line at which one on both bodies may take its place
NEARLY_PARALLEL = 3.0  # the same for parallel ones
PARALLEL = 0.99  # cosine between lines that run the same way
SAME_WAY = 0.995  # cosine between axes that mean the same joint
CLOSE, CLOSE_OWN = 0.03, 0.1  # how far apart such lines may lie: of the object, of the part
ON_LINE = 0.9  # share of the check's tolerance that a line may stray from them


@dataclass(frozen=True)
class PartFaces:
    """Faces around one joint: of the link, of all that moves with it, and of what does not.

    Attributes:
        own: of the link. moving: with its descendants. static: everything else.
        parent: of the parent link. fixed: static without the link's movable siblings.
        skin: whether all of them were cut out of one skin.
    """

    own: IntArray
    moving: IntArray
    static: IntArray
    parent: IntArray
    fixed: IntArray
    skin: bool = False


class EmbeddedSolver:
    """Ranked hypotheses and limits by our rule: the default, because it measures best."""

    @classmethod
    def available(cls) -> Availability:
        """Always: it needs nothing but the package."""
        return Availability(True, version="1")

    def solve(
        self, mesh: Mesh, primitives: Primitives, tree: KinematicTree, seed: int = 0
    ) -> Articulation:
        """Estimate every joint of the tree.

        Args:
            mesh: asset frame. primitives: its faces' labels. tree: parts, parents and subtypes.
            seed: of all sampling.

        Returns:
            One link per node, one joint per node but the base, parents first.
        """
        whole, of_whole = mesh, primitives
        mesh, primitives = without_repeats(mesh, primitives)
        mesh, frame, rotation = straightened(mesh)
        if rotation is not None:
            tree = turned_tree(tree, rotation)

        def solved(tree: KinematicTree, index: int) -> Joint:
            return self._joint(mesh, frame, tree, primitives, index, seed)

        joints = {i: solved(tree, i) for i in topological_order(tree)}
        for i in list(joints):
            if tree.nodes[i].provenance == "user" or _share(joints[i]) >= STUCK:
                continue
            faces = faces_around(tree, _links(primitives, tree), i)
            around = Surroundings.of(mesh, faces.moving, faces.static, seed)
            for _ in range(3):
                freed = take_along(mesh, primitives.labels, tree, joints[i], around)
                again = None if freed is None else solved(freed, i)
                if freed is None or again is None or _share(again) < 1.2 * _share(joints[i]):
                    break
                tree, joints[i] = freed, again
                faces = faces_around(tree, _links(primitives, tree), i)
                around = Surroundings.of(mesh, faces.moving, faces.static, seed)
        joints = {i: replace(joint, parent=tree.nodes[i].parent) for i, joint in joints.items()}
        tree, joints = carried(tree, joints)
        ordered = tuple(joints[i] for i in topological_order(tree))
        if rotation is not None:
            ordered = tuple(turned_joint(joint, rotation.T) for joint in ordered)
        return Articulation(whole, _links(of_whole, tree), ordered)

    def _joint(
        self, mesh: Mesh, frame: ObjectFrame, tree: KinematicTree, primitives: Primitives,
        index: int, seed: int,
    ) -> Joint:  # fmt: skip
        node = tree.nodes[index]
        faces = faces_around(tree, _links(primitives, tree), index, primitives.one_skin)
        if node.subtype == "fixed" or not len(faces.moving) or not len(faces.static):
            return _fixed_joint(mesh, node, index, faces)
        return self._estimate(mesh, frame, node, index, faces, seed)

    def _estimate(
        self, mesh: Mesh, frame: ObjectFrame, node: PartNode, index: int, faces: PartFaces,
        seed: int,
    ) -> Joint:  # fmt: skip
        """Choose the best hypothesis by which the part can move, and its limits."""
        around = Surroundings.of(mesh, faces.moving, faces.static, seed)
        ranked = candidates = choose_candidates(mesh, frame, node, faces, seed)
        if node.subtype != "slide" and node.provenance != "user":
            candidates = _on_both(mesh, faces, candidates, around.paths.rest_gap)
        alone = None
        if len(faces.fixed) < len(faces.static) and len(faces.fixed):
            alone = cache(lambda: Surroundings.of(mesh, faces.moving, faces.fixed, seed))

        def limits_of(c: JointCandidate) -> Limits:
            given = node.limits if c is candidates[0] else None
            return embedded_limits(around, c.subtype, c.axis, c.origin, alone=alone, given=given,
                                   usual=_usual(c))  # fmt: skip

        near = min(CLOSE * mesh.diagonal, CLOSE_OWN * _size(mesh, faces.own))
        best, chosen = candidates[0], 0
        limits = limits_of(best)
        for k in _instead(candidates, near) if moved_share(limits) < MOVES else ():
            found = limits_of(candidates[k])
            if moved_share(found) < MOVES:
                continue
            if abs(float(candidates[k].axis @ best.axis)) < PARALLEL:
                # sooner the same line the other way round than one that runs another way
                back = replace(best, axis=-best.axis)
                other_way = limits_of(back)
                if moved_share(other_way) >= MOVES:
                    best, limits = back, other_way
                    break
            if same_joint(candidates[k], best, near) or candidates[k].score >= best.score - TIED:
                best, limits, chosen = candidates[k], found, k
                break
        evidence = {
            "solver": "embedded",
            **_contact_evidence(around.scene),
            "candidates": [_plain(c) for c in candidates[:6]],
            "chosen": chosen,
            "limits": {"rule": limits.rule, "by": node.provenance, **limits.evidence},
        }
        sure = 1.0 if node.provenance == "user" else agreement(best, ranked, near)
        confidence = node.confidence * sure
        return _joint(node, index, best.axis, best.origin, limits, confidence, evidence)


class PaperInitSolver(EmbeddedSolver):
    """The paper's initialisation (eq. 2-8) and limits, without its optimisation."""

    method: Method | None = None

    def _estimate(
        self, mesh: Mesh, frame: ObjectFrame, node: PartNode, index: int, faces: PartFaces,
        seed: int,
    ) -> Joint:  # fmt: skip
        user = _user_candidate(node)
        part = paper_part(mesh, faces.moving, faces.parent, seed=seed)
        first = initialise(part, node.subtype, seed)
        axis, origin = (first.axis, first.origin) if user is None else (user.axis, user.origin)
        evidence: dict[str, Any] = {
            "solver": self.method or "init", "initial": dict(first.evidence),
        }  # fmt: skip
        scene = SweepScene(mesh, faces.moving, faces.static, static_samples=1500, seed=seed)
        if user is None:
            axis = opening_sign(scene, node, axis, origin, frame) * axis
        if self.method is not None and user is None:
            contact = part.contact * part.unit + part.center
            motion = "prismatic" if node.subtype == "slide" else "revolute"
            done = refine(scene, motion, axis, origin, self.method, contact)  # type: ignore[arg-type]
            axis, origin = done.axis, done.origin
            evidence["optimisation"] = {
                "method": self.method, "accepted": done.accepted, "why": done.why,
                "loss_before": done.loss_before, "loss_after": done.loss_after,
                "curve": list(done.curve),
            }  # fmt: skip
        if node.limits is None:
            limits = paper_limits(scene, node.subtype, axis, origin)
        else:
            around = Surroundings.of(mesh, faces.moving, faces.static, seed)
            limits = embedded_limits(around, node.subtype, axis, origin, given=node.limits)
        evidence.update(_contact_evidence(scene))
        evidence["limits"] = {"rule": limits.rule, "by": node.provenance, **limits.evidence}
        return _joint(node, index, axis, origin, limits, node.confidence, evidence)


class PaperLevenbergMarquardtSolver(PaperInitSolver):
    """The paper with the optimiser its method section names."""

    method = "lm"


class PaperNelderMeadSolver(PaperInitSolver):
    """The paper with the optimiser its implementation section names."""

    method = "nelder-mead"


def _links(primitives: Primitives, tree: KinematicTree) -> tuple[Link, ...]:
    return tuple(
        Link(n.name, n.kind, np.flatnonzero(np.isin(primitives.labels, n.primitives)), n.primitives)
        for n in tree.nodes
    )


def _share(joint: Joint) -> float:
    """Which share of its usual way a joint has by itself; 1 where nobody measured."""
    found = joint.evidence.get("limits", {})
    return float(found.get("share", 1.0)) * (0.5 if "blocked_by_sibling_at" in found else 1.0)


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


def faces_around(
    tree: KinematicTree, links: Sequence[Link], index: int, skin: bool = False
) -> PartFaces:
    """Which faces move with node `index`, and which stand still."""
    moving = {index}
    while True:
        more = {i for i, n in enumerate(tree.nodes) if n.parent in moving} - moving
        if not more:
            break
        moving |= more
    parent = tree.nodes[index].parent
    trunk, node = {0}, parent
    while node > 0:
        trunk.add(node)
        node = tree.nodes[node].parent
    stiff = {i for i, n in enumerate(tree.nodes)
             if n.subtype == "fixed" and n.parent in trunk} - moving  # fmt: skip

    def gather(chosen: set[int]) -> IntArray:
        parts = [links[i].faces for i in sorted(chosen)]
        return np.sort(np.concatenate(parts)) if parts else np.zeros(0, dtype=np.int64)

    rest = set(range(len(links))) - moving
    return PartFaces(
        links[index].faces, gather(moving), gather(rest), links[parent].faces,
        gather(trunk | stiff), skin,
    )  # fmt: skip


def choose_candidates(
    mesh: Mesh, frame: ObjectFrame, node: PartNode, faces: PartFaces, seed: int
) -> list[JointCandidate]:
    """Hypotheses of the node's kind of motion, best first.

    A person's axis is obeyed; the reasoner's ranked candidates are reused; else they are made here.
    """
    user = _user_candidate(node)
    if user is not None:
        return [user]
    kinds = ("slide",) if node.subtype == "slide" else ("hinge", "spin")
    known = [c for c in node.candidates if c.subtype in kinds]
    if not known:
        parent = faces.parent if len(faces.parent) else faces.static
        known = [
            c for c in rank_hypotheses(
                mesh, faces.moving, faces.static, frame=frame, parent_faces=parent, seed=seed,
                top=1000, skin=faces.skin,
            ) if c.subtype in kinds
        ]  # fmt: skip
    return known


def agreement(best: JointCandidate, ranked: Sequence[JointCandidate], near: float) -> float:
    """Probability of all hypotheses of a kind that mean the same joint as `best`; 1 if none has
    one. Lines mean the same when they run the same way, less than `near` apart."""
    if "within_kind" not in best.evidence:
        return 1.0
    same = [c for c in ranked if same_joint(c, best, near)]
    return min(sum(float(c.evidence.get("within_kind", 0.0)) for c in same), 1.0)


def same_joint(one: JointCandidate, other: JointCandidate, near: float) -> bool:
    """Whether two hypotheses of a kind run the same way, less than `near` apart."""
    apart = np.linalg.norm(np.cross(one.origin - other.origin, other.axis))
    close = one.subtype == "slide" or apart <= near
    return bool(close and abs(float(one.axis @ other.axis)) > SAME_WAY)


def _size(mesh: Mesh, faces: IntArray) -> float:
    return float(np.linalg.norm(np.ptp(mesh.vertices[np.unique(mesh.faces[faces])], axis=0)))


def _instead(candidates: list[JointCandidate], near: float) -> list[int]:
    """Which hypotheses to look at where the best one leaves a part stuck.

    Where a cut is ragged, or a piece of the part was missed, the right one is stuck as well, and
    another is seldom right because it is free. So: lines that mean the same joint first, then what
    is not much less probable, which says that the way back may be free, and is taken in a tie only.
    """
    best = candidates[0]
    least = best.score - (NEARLY if best.subtype == "slide" else NEARLY_PARALLEL)
    ranked = range(1, len(candidates[:FALLBACKS]))
    same = [k for k in ranked if same_joint(candidates[k], best, near)]
    return same + [k for k in ranked if k not in same and candidates[k].score >= least]


def _on_both(
    mesh: Mesh, faces: PartFaces, candidates: list[JointCandidate], rest_gap: float
) -> list[JointCandidate]:
    """The candidates whose line stays on both bodies, as the check asks, and is nearly as probable
    as the best or parallel to it; all candidates if there is none."""
    bodies = HingeBodies(mesh, faces.moving, faces.parent if len(faces.parent) else faces.static)
    most = ON_LINE * THRESHOLDS.gap_share + rest_gap / max(mesh.diagonal, 1e-12)
    best = candidates[0]

    def near(c: JointCandidate) -> bool:
        parallel = abs(float(c.axis @ best.axis)) > PARALLEL
        return c.score >= best.score - (NEARLY_PARALLEL if parallel else NEARLY)

    lines = [c for c in candidates[:LINES] if near(c)]
    fits = [c for c in lines if bodies.line_gap(c.axis, c.origin, bodies.encloses) <= most]
    return fits or candidates


def opening_sign(
    scene: SweepScene, node: PartNode, axis: FloatArray, origin: FloatArray, frame: ObjectFrame
) -> float:
    """+1 or -1: the direction in which the part moves more freely, outwards in case of a tie."""
    slide = node.subtype == "slide"
    reach = 0.6 * float(np.ptp(scene.points @ unit(axis))) if slide else np.pi / 2
    values = reach * np.array([0.25, 0.5, 0.75, 1.0])
    motion = "prismatic" if slide else "revolute"
    plus = scene.sweep(motion, axis, origin, values).blocked.mean()  # type: ignore[arg-type]
    minus = scene.sweep(motion, axis, origin, -values).blocked.mean()  # type: ignore[arg-type]
    middle = 0.5 * (frame.low + frame.high) @ frame.axes
    swing = axis if slide else np.cross(axis, scene.center - origin)
    outward = float(np.sign(swing @ (scene.center - middle)))
    return 1.0 if minus - plus + 0.01 * outward >= 0 else -1.0


def _user_candidate(node: PartNode) -> JointCandidate | None:
    """The joint that a person gave for this part, if any."""
    if node.provenance != "user" or not node.candidates:
        return None
    first = node.candidates[0]
    return first if first.subtype == node.subtype else None


def _joint(
    node: PartNode, index: int, axis: FloatArray, origin: FloatArray, limits: Limits,
    confidence: float, evidence: dict[str, Any],
) -> Joint:  # fmt: skip
    subtype = "slide" if limits.type == "prismatic" else node.subtype
    return Joint(
        f"{node.name}_joint", limits.type, subtype, node.parent, index, unit(axis),
        np.asarray(origin, dtype=np.float64), float(limits.lower), float(limits.upper),
        float(limits.closed), float(limits.open), confidence=float(np.clip(confidence, 0.0, 1.0)),
        evidence=evidence,
    )  # fmt: skip


def _fixed_joint(mesh: Mesh, node: PartNode, index: int, faces: PartFaces) -> Joint:
    used = mesh.vertices[np.unique(mesh.faces[faces.own])] if len(faces.own) else np.zeros((1, 3))
    return Joint(
        f"{node.name}_joint", "fixed", "fixed", node.parent, index, np.array([0.0, 0.0, 1.0]),
        0.5 * (used.min(axis=0) + used.max(axis=0)), 0.0, 0.0, confidence=node.confidence,
    )  # fmt: skip


def _usual(candidate: JointCandidate) -> Usual | None:
    """The usual travel that came with a ranked candidate."""
    found = [candidate.evidence.get(k) for k in ("usual_open", "usual_back", "endless")]
    if any(v is None for v in found):
        return None
    return Usual(*(float(v) for v in found if v is not None))


def _contact_evidence(scene: SweepScene) -> dict[str, Any]:
    found = scene.contact()
    return {"contact": {"points": len(found.points), "share": round(found.share, 4),
                        "gap": found.gap, "tau": found.tau}}  # fmt: skip


def _plain(c: JointCandidate) -> dict[str, Any]:
    return {
        "subtype": c.subtype, "axis": [round(float(v), 5) for v in c.axis],
        "origin": [round(float(v), 5) for v in c.origin], "score": round(float(c.score), 4),
        **{k: round(float(v), 4) for k, v in c.evidence.items()},
    }  # fmt: skip
