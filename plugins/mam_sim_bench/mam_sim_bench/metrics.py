"""What the engine is held to: an articulation scored against the truth (paper 4.1, design 6).

Lengths are over the diagonal of the truth's bounding box. Parts are compared as sets of points on
the truth's surface, so the two meshes need not share faces. Links joined by fixed joints are one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import open3d as o3d
from scipy.optimize import linear_sum_assignment

from mam_pipeline.geometry.sampling import face_geometry
from mam_pipeline.types import (
    NEEDS_REVIEW,
    Articulation,
    FloatArray,
    IntArray,
    Joint,
    JointType,
    Mesh,
    joint_motion,
)

if TYPE_CHECKING:
    from mam_world.ground_truth import GroundTruth

SAMPLES = 20_000
SAMPLES_PER_PART = 500
MISSING_AXIS = np.pi / 2
MISSING_SIGNED_AXIS = np.pi
MISSING_PIVOT = 0.5
MOTION_STEPS = 9
AXIS_POINTS = 33
RIGHT_IOU, RIGHT_AXIS, RIGHT_PIVOT = 0.5, 0.1, 0.05  # what a joint that needs no review reaches


@dataclass(frozen=True)
class JointScore:
    """One joint of the truth and what was found for it.

    Attributes:
        truth_link, predicted_link: link indices (after merging fixed links); -1 if unmatched.
        iou: point-mask IoU of the matched parts.
        type_error: 0 or 1; continuous counts as revolute, a missing part as wrong.
        axis: angle folded to [0, pi/2], rad. `axis_signed`: between the directions in which the
            larger side of each range moves, [0, pi].
        pivot: mean distance of the true axis, over the part's extent, to the predicted line;
            None for a slide; the penalty if the predicted joint is a slide and has no line.
        motion: mean displacement error of the part's points over the true range.
        limits: IoU of the two ranges.
        true_type, predicted_type: joint types ("" if unmatched).
    """

    truth_link: int
    predicted_link: int
    iou: float
    type_error: float
    axis: float
    axis_signed: float
    pivot: float | None
    motion: float
    limits: float
    true_type: str
    predicted_type: str


@dataclass(frozen=True)
class FoundJoint:
    """One joint of the answer: how sure it was, and whether it was right.

    Right means a part of at least half the truth's points (IoU), with the true type, the axis
    within 0.1 rad and, of a rotary joint, the line within 0.05 diagonals. `short`: it goes too
    little of its way, for which the report sends a person to it, however sure it is.
    """

    confidence: float
    right: bool
    short: bool = False

    @property
    def flagged(self) -> bool:
        """Whether the report sends a person to look at it."""
        return self.short or self.confidence < NEEDS_REVIEW


@dataclass(frozen=True)
class Scores:
    """The metrics of one object: design 6, numbers 1 to 7, and the joints behind them.

    Means over the joints of the truth, but `miou` over max(predicted, true) parts. `pivot` is
    None for an object without a rotary joint.
    """

    miou: float
    count: float
    type_error: float
    axis: float
    axis_signed: float
    pivot: float | None
    motion: float
    limits: float
    true_parts: int
    predicted_parts: int
    joints: tuple[JointScore, ...] = ()
    found: tuple[FoundJoint, ...] = ()


def score(
    prediction: Articulation | None, truth: GroundTruth, samples: int = SAMPLES, seed: int = 0
) -> Scores:
    """Score an articulation given in the frame of `truth.mesh`; None means nothing was found.

    Args:
        prediction: its mesh may differ from the truth's (cut, fused, decimated).
        samples: points drawn on the truth, area-weighted; every part gets at least
            `SAMPLES_PER_PART` of them, and points weigh what area they stand for.
    """
    answer = truth.truth_articulation()
    true_part, true_joints = rigid_parts(answer)
    points, weight, face = _sample(truth.mesh, true_part[truth.face_link], samples, seed)
    true_label = true_part[truth.face_link][face]
    if prediction is None:
        found_joints: list[Joint] = []
        found_label: IntArray = np.zeros(len(points), dtype=np.int64)
    else:
        found_part, found_joints = rigid_parts(prediction)
        same = prediction.mesh is truth.mesh  # surfaces that coincide are told apart by their faces
        nearest = face if same else nearest_face(prediction.mesh, points)
        found_label = found_part[prediction.face_link[nearest]]
    iou = _iou(true_label, found_label, weight, len(true_joints) + 1, len(found_joints) + 1)
    rows, columns = linear_sum_assignment(-iou)
    match = {int(r): int(c) for r, c in zip(rows, columns) if iou[r, c] > 0}
    diagonal = truth.mesh.diagonal
    joints = []
    for i, joint in enumerate(true_joints):
        mask = true_label == i + 1
        part = points[mask], weight[mask]
        if i in match:
            other = found_joints[match[i]]
            value = float(iou[i, match[i]])
            joints.append(_compare(joint, other, part, diagonal, i + 1, match[i] + 1, value))
        else:
            joints.append(_missing(joint, part, diagonal, i + 1))
    by_link = {j.predicted_link: j for j in joints}
    found = tuple(
        FoundJoint(
            joint.confidence, (k + 1) in by_link and _right(by_link[k + 1]), bool(joint.basis.short)
        )
        for k, joint in enumerate(found_joints)
    )
    return _summary(joints, len(true_joints), found)


def rigid_parts(articulation: Articulation) -> tuple[IntArray, list[Joint]]:
    """Merge links over fixed joints: (L,) part of every link, and the joint of part k + 1.

    Part 0 is the base; joint k moves part k + 1.
    """
    part = np.zeros(len(articulation.links), dtype=np.int64)
    moving: list[Joint] = []
    pending = list(articulation.joints)
    known = {0}
    while pending:
        ready = [j for j in pending if j.parent in known] or pending[:1]
        for joint in ready:
            pending.remove(joint)
            known.add(joint.child)
            if joint.type == "fixed":
                part[joint.child] = part[joint.parent]
            else:
                moving.append(joint)
                part[joint.child] = len(moving)
    return part, moving


def nearest_face(mesh: Mesh, points: FloatArray) -> IntArray:
    """(n,) index of the face of `mesh` nearest to each point."""
    low, high = mesh.bounds
    scale = float(np.linalg.norm(high - low)) or 1.0
    scene = o3d.t.geometry.RaycastingScene()
    scene.add_triangles(
        o3d.core.Tensor.from_numpy(((mesh.vertices - low) / scale).astype(np.float32)),
        o3d.core.Tensor.from_numpy(mesh.faces.astype(np.uint32)),
    )
    query = ((points - low) / scale).astype(np.float32)
    answer = scene.compute_closest_points(o3d.core.Tensor.from_numpy(query))
    return answer["primitive_ids"].numpy().astype(np.int64)


def axis_angle(a: FloatArray, b: FloatArray) -> float:
    """Angle between two lines' directions, folded to [0, pi/2], rad."""
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), abs(float(a @ b))))


def pivot_distance(
    true_axis: FloatArray,
    true_origin: FloatArray,
    axis: FloatArray,
    origin: FloatArray,
    extent: tuple[float, float],
) -> float:
    """Mean distance from the true axis, between two places along it, to the predicted line.

    Unlike the line-to-line distance of several published evaluators it does not vanish for a
    hinge that is shifted sideways, nor for one that crosses the true axis far from the part.

    Args:
        extent: (low, high) positions along `true_axis`, measured from `true_origin`.
    """
    along = np.linspace(extent[0], extent[1], AXIS_POINTS)
    offset = true_origin + along[:, None] * true_axis - origin
    return float(np.linalg.norm(np.cross(offset, axis), axis=1).mean())


def motion_error(true: Joint, found: Joint | None, points: FloatArray, weight: FloatArray) -> float:
    """Mean distance between a part's points moved by the true and by the found joint.

    Over the true range, q = 0 being the rest pose for both; a continuous joint turns once round.
    The sign of the found joint is free. Of unlike types, one radian matches the part's mean
    radius; a missing joint does not move.
    """
    low, high = _range(true)
    values = np.linspace(low, high, MOTION_STEPS)
    signs: tuple[float, ...] = (0.0,)
    if found is not None:
        radius = 1.0
        if (found.type == "prismatic") != (true.type == "prismatic"):
            rotary = found if true.type == "prismatic" else true
            arm = np.cross(points - rotary.origin, rotary.axis)
            radius = max(float(np.average(np.linalg.norm(arm, axis=1), weights=weight)), 1e-9)
            radius = 1.0 / radius if true.type == "prismatic" else radius
        signs = (radius, -radius)
    errors = []
    for sign in signs:
        total = 0.0
        for q in values:
            a = joint_motion(true.type, true.axis, true.origin, q)
            moved = points @ a[:3, :3].T + a[:3, 3]
            if found is not None:
                b = joint_motion(found.type, found.axis, found.origin, sign * q)
                other = points @ b[:3, :3].T + b[:3, 3]
            else:
                other = points
            gap = np.linalg.norm(moved - other, axis=1)
            total += float(np.average(gap, weights=weight))
        errors.append(total / len(values))
    return min(errors)


def reliability(
    chance: FloatArray, real: FloatArray, bins: int = 10
) -> tuple[float, list[list[float]]]:
    """Expected calibration error, and (mean chance, share that is real, parts) of every bin."""
    at = np.minimum((chance * bins).astype(int), bins - 1)
    rows = [
        [float(chance[at == k].mean()), float(real[at == k].mean()), int((at == k).sum())]
        for k in range(bins) if (at == k).any()
    ]  # fmt: skip
    error = sum(n * abs(said - was) for said, was, n in rows) / max(len(chance), 1)
    return float(error), [[round(a, 3), round(b, 3), n] for a, b, n in rows]


def limit_iou(true: Joint, found: Joint) -> float:
    """IoU of the two ranges on the true joint's scale; 0 for unlike types.

    Unbounded rotations count as one turn, [-pi, pi]; the found range is mirrored when its axis
    points the other way.
    """
    if (true.type == "prismatic") != (found.type == "prismatic"):
        return 0.0
    a, b = _range(true), _range(found)
    if float(true.axis @ found.axis) < 0:
        b = (-b[1], -b[0])
    inner = min(a[1], b[1]) - max(a[0], b[0])
    outer = max(a[1], b[1]) - min(a[0], b[0])
    if outer <= 0:
        return 1.0
    return max(inner, 0.0) / outer


def _range(joint: Joint) -> tuple[float, float]:
    if joint.type == "prismatic":
        low, high = (v if np.isfinite(v) else 0.0 for v in (joint.lower, joint.upper))
        return float(low), float(high)
    if joint.type == "continuous" or not np.isfinite(joint.upper - joint.lower):
        return -np.pi, np.pi
    return joint.lower, joint.upper


def _opening(joint: Joint) -> FloatArray:
    low, high = _range(joint)
    return joint.axis * (-1.0 if abs(low) > abs(high) else 1.0)


def _sample(
    mesh: Mesh, label: IntArray, count: int, seed: int
) -> tuple[FloatArray, FloatArray, IntArray]:
    """Points, their weights (area each stands for) and faces; small parts are sampled denser."""
    rng = np.random.default_rng(seed)
    _, areas = face_geometry(mesh.vertices, mesh.faces)
    total = max(float(areas.sum()), 1e-30)
    faces, weights = [], []
    for part in np.unique(label):
        index = np.flatnonzero(label == part)
        size = float(areas[index].sum())
        if size <= 0:
            continue
        n = max(int(np.ceil(count * size / total)), SAMPLES_PER_PART)
        edges = np.cumsum(areas[index])
        draw = (np.arange(n) + rng.random(n)) * (edges[-1] / n)
        faces.append(index[np.minimum(np.searchsorted(edges, draw), len(index) - 1)])
        weights.append(np.full(n, size / n))
    face = np.concatenate(faces)
    u, v = rng.random((2, len(face)))
    flip = u + v > 1
    u[flip], v[flip] = 1 - u[flip], 1 - v[flip]
    a, b, c = (mesh.vertices[mesh.faces[face, k]] for k in range(3))
    points = a + u[:, None] * (b - a) + v[:, None] * (c - a)
    return points, np.concatenate(weights), face


def _iou(a: IntArray, b: IntArray, weight: FloatArray, n: int, m: int) -> FloatArray:
    """(n - 1, m - 1) IoU of the movable parts; the bases (label 0) are left out."""
    both = np.zeros((n, m))
    np.add.at(both, (a, b), weight)
    union = both.sum(axis=1, keepdims=True) + both.sum(axis=0, keepdims=True) - both
    return (both / np.where(union > 0, union, 1.0))[1:, 1:]


def _compare(
    true: Joint,
    found: Joint,
    part: tuple[FloatArray, FloatArray],
    diagonal: float,
    truth_link: int,
    link: int,
    iou: float,
) -> JointScore:
    points, weight = part
    rotary: tuple[JointType, ...] = ("revolute", "continuous")
    pivot = None
    if true.type in rotary:
        pivot = MISSING_PIVOT
        if found.type in rotary:
            along = (points - true.origin) @ true.axis
            extent = (float(along.min()), float(along.max()))
            gap = pivot_distance(true.axis, true.origin, found.axis, found.origin, extent)
            pivot = gap / diagonal
    signed = float(np.arccos(np.clip(_opening(true) @ _opening(found), -1.0, 1.0)))
    return JointScore(
        truth_link=truth_link,
        predicted_link=link,
        iou=iou,
        type_error=float((true.type in rotary) != (found.type in rotary)),
        axis=axis_angle(true.axis, found.axis),
        axis_signed=signed,
        pivot=pivot,
        motion=motion_error(true, found, points, weight) / diagonal,
        limits=limit_iou(true, found),
        true_type=true.type,
        predicted_type=found.type,
    )


def _missing(
    true: Joint, part: tuple[FloatArray, FloatArray], diagonal: float, truth_link: int
) -> JointScore:
    return JointScore(
        truth_link=truth_link,
        predicted_link=-1,
        iou=0.0,
        type_error=1.0,
        axis=MISSING_AXIS,
        axis_signed=MISSING_SIGNED_AXIS,
        pivot=None if true.type == "prismatic" else MISSING_PIVOT,
        motion=motion_error(true, None, *part) / diagonal,
        limits=0.0,
        true_type=true.type,
        predicted_type="",
    )


def _right(joint: JointScore) -> bool:
    placed = joint.pivot is None or joint.pivot <= RIGHT_PIVOT
    return joint.iou >= RIGHT_IOU and not joint.type_error and joint.axis <= RIGHT_AXIS and placed


def _summary(joints: list[JointScore], true_parts: int, found: tuple[FoundJoint, ...]) -> Scores:
    def mean(values: list[float], empty: float) -> float:
        return float(np.mean(values)) if values else empty

    pivots = [j.pivot for j in joints if j.pivot is not None]
    most = max(true_parts, len(found))
    return Scores(
        miou=sum(j.iou for j in joints) / most if most else 1.0,
        count=float(true_parts == len(found)),
        type_error=mean([j.type_error for j in joints], 0.0),
        axis=mean([j.axis for j in joints], 0.0),
        axis_signed=mean([j.axis_signed for j in joints], 0.0),
        pivot=float(np.mean(pivots)) if pivots else None,
        motion=mean([j.motion for j in joints], 0.0),
        limits=mean([j.limits for j in joints], 1.0),
        true_parts=true_parts,
        predicted_parts=len(found),
        joints=tuple(joints),
        found=found,
    )
