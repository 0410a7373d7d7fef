"""The paper's solvers: type-aware initialisation, its optimisation, and its limits."""

from __future__ import annotations

from importlib.resources.abc import Traversable
from typing import Any

import numpy as np

from mam_pipeline.geometry.frames import ObjectFrame
from mam_pipeline.geometry.sampling import unit
from mam_pipeline.geometry.sweep import SweepScene
from mam_pipeline.joints.estimate import JointEstimator, contact_evidence, user_candidate
from mam_pipeline.joints.limits import (
    Limits,
    Surroundings,
    embedded_limits,
    range_evidence,
    travel,
)
from mam_pipeline.joints.solver import EmbeddedSolver, fixed_joint, joint_of, limits_evidence
from mam_pipeline.types import FloatArray, Joint, JointSubtype, KinematicTree, PartNode
from mam_sim_paper.initialise import initialise, paper_part
from mam_sim_paper.optimise import Method, refine


class PaperInitSolver(EmbeddedSolver):
    """The paper's initialisation (eq. 2-8) and limits, without its optimisation."""

    method: Method | None = None

    def _alike(
        self, estimator: JointEstimator, tree: KinematicTree, joints: list[Joint]
    ) -> list[Joint]:
        return joints

    @classmethod
    def weights(cls) -> list[Traversable]:
        """None: the paper's formulas have learned nothing."""
        return []

    def _joint(self, estimator: JointEstimator, tree: KinematicTree, index: int) -> Joint:
        mesh, node, seed = estimator.mesh, tree.nodes[index], estimator.seed
        faces = estimator.faces(tree, index)
        if node.subtype == "fixed" or not len(faces.moving) or not len(faces.static):
            return fixed_joint(mesh, node, index, faces)
        user = user_candidate(node)
        part = paper_part(mesh, faces.moving, faces.parent, seed=seed)
        first = initialise(part, node.subtype, seed)
        axis, origin = (first.axis, first.origin) if user is None else (user.axis, user.origin)
        evidence: dict[str, Any] = {
            "solver": self.method or "init", "initial": dict(first.evidence),
        }  # fmt: skip
        scene = SweepScene(mesh, faces.moving, faces.static, static_samples=1500, seed=seed)
        if user is None:
            axis = opening_sign(scene, node, axis, origin, estimator.frame) * axis
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
        evidence["contact"] = contact_evidence(scene)
        evidence["limits"] = limits_evidence(limits, node)
        return joint_of(node, index, axis, origin, limits, node.confidence, evidence)


class PaperLevenbergMarquardtSolver(PaperInitSolver):
    """The paper with the optimiser its method section names."""

    method = "lm"


class PaperNelderMeadSolver(PaperInitSolver):
    """The paper with the optimiser its implementation section names."""

    method = "nelder-mead"


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


def paper_limits(
    scene: SweepScene, subtype: JointSubtype, axis: FloatArray, origin: FloatArray
) -> Limits:
    """The paper's rule: first collision both ways; slides end outwards at contact loss."""
    if subtype == "slide":
        extent = float(np.ptp(scene.points @ unit(axis)))
        out = travel(scene, "prismatic", axis, origin, 1.2 * extent)
        back = travel(scene, "prismatic", axis, origin, -1.2 * extent)
        upper = min(out.strict, out.contact)
        lower = -min(back.strict, back.contact)
        return Limits("prismatic", lower, upper, 0.0, upper, "paper", range_evidence(out, back))
    out = travel(scene, "revolute", axis, origin, np.pi)
    back = travel(scene, "revolute", axis, origin, -np.pi)
    if out.strict >= np.pi and back.strict >= np.pi:
        return Limits(
            "continuous", -np.inf, np.inf, 0.0, 0.0, "endless",
            range_evidence(out, back),
        )  # fmt: skip
    return Limits(
        "revolute", -back.strict, out.strict, 0.0, out.strict, "paper", range_evidence(out, back)
    )
