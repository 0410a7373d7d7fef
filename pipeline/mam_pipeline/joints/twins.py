"""Parts of one shape that move alike get ranges that are alike.

Of three equal drawers the middle one may find no wall beside it, and of two doors one may be given
another usual way: the farthest of them is taken for all whose way is free.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from mam_pipeline.joints.estimate import JointEstimator
from mam_pipeline.types import FloatArray, Joint, KinematicTree


@dataclass(frozen=True)
class TwinThresholds:
    """Which parts are twins, and what alike means.

    Attributes:
        size: how far the logarithms of their extents, longest first, may differ.
        parallel: cosine between their axes.
        alike: share of the farthest range from which a range counts as alike.
    """

    size: float = 0.06
    parallel: float = 0.98
    alike: float = 0.95


TWINS = TwinThresholds()


def with_alike_ranges(
    estimator: JointEstimator, tree: KinematicTree, joints: list[Joint]
) -> list[Joint]:
    """The joints, with the range of the farthest twin where it is free.

    Args:
        tree: as the estimator needs it (`turned`). joints: of its nodes, closed at rest or not.
    """
    sizes = {j.child: _extents(estimator, tree, j.child) for j in joints}
    return [_as_its_twins(estimator, tree, joint, joints, sizes) for joint in joints]


def _extents(estimator: JointEstimator, tree: KinematicTree, index: int) -> FloatArray:
    """(3,) extents of a part along the object's axes, longest first."""
    mesh, faces = estimator.mesh, estimator.faces(tree, index).own
    return np.sort(np.ptp(mesh.vertices[mesh.faces[faces].reshape(-1)], axis=0))[::-1]


def _as_its_twins(
    estimator: JointEstimator, tree: KinematicTree, joint: Joint, joints: list[Joint],
    sizes: Mapping[int, FloatArray],
) -> Joint:  # fmt: skip
    if not _has_way(joint):
        return joint
    twins = [
        other for other in joints
        if other is not joint and _has_way(other) and other.subtype == joint.subtype
        and abs(float(other.axis @ joint.axis)) > TWINS.parallel
        and np.abs(np.log((sizes[other.child] + 1e-9) / (sizes[joint.child] + 1e-9))).max()
        < TWINS.size
    ]  # fmt: skip
    far = max(twins, key=lambda other: other.upper, default=joint)
    if joint.upper >= TWINS.alike * far.upper:
        return joint
    free = estimator.free(estimator.faces(tree, joint.child), joint, far.upper)
    if free < TWINS.alike * far.upper:
        return joint
    basis = replace(joint.basis, rule="twin", share=far.basis.share, of_part=far.basis.of_part)
    return replace(
        joint, upper=float(free), open=float(free), basis=basis,
        evidence={**joint.evidence, "limits": {**joint.evidence.get("limits", {}), "rule": "twin",
                                               "assumed": f"assumed: as {far.name}"}},
    )  # fmt: skip


def _has_way(joint: Joint) -> bool:
    """Whether the joint opens from a closed rest pose by a way that nobody gave."""
    limited = joint.type in ("revolute", "prismatic") and joint.basis.rule != "given"
    return limited and joint.lower == 0.0 < joint.upper == joint.open
