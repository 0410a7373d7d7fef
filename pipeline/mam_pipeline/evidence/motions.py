"""Animations of a file as joints: a node that turns about a fixed line, or slides along one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from mam_pipeline.formats.nodes import NodeMotion, Scene
from mam_pipeline.types import FloatArray, JointSubtype


@dataclass(frozen=True)
class MotionThresholds:
    """When an animated motion is that of a joint; lengths as shares of the object's diagonal.

    Attributes:
        turn: radians that count as turning. shift: a shift that counts as sliding.
        stray: how far a motion may leave its line. wobble: radians between the axes of two poses.
        whole: radians from which a turn is endless, with one more step of its keyframes: a loop
            ends one frame before it begins again. scale: change of size that is no rigid motion.
        far: shift beyond which the thing flies away.
    """

    turn: float = float(np.deg2rad(3.0))
    shift: float = 0.005
    stray: float = 0.01
    wobble: float = float(np.deg2rad(3.0))
    whole: float = float(np.deg2rad(350.0))
    scale: float = 0.01
    far: float = 1.5


MOTIONS = MotionThresholds()


@dataclass(frozen=True)
class AnimatedJoint:
    """A node's joint in the mesh's frame; `limits` from rest, rad or m, infinite if endless."""

    node: int
    animation: str
    subtype: JointSubtype
    axis: FloatArray
    origin: FloatArray
    limits: tuple[float, float]


def joint_of(
    scene: Scene, motion: NodeMotion, mesh_T_file: FloatArray, diagonal: float
) -> AnimatedJoint | str:
    """The joint that a node's animation shows, or why it shows none, in words.

    Args:
        mesh_T_file: (4, 4) similarity. diagonal: of the object, metres.
    """
    above = scene.nodes[motion.node].parent
    file_T_parent = np.eye(4) if above < 0 else scene.nodes[above].world
    frame = mesh_T_file @ file_T_parent
    if abs(np.linalg.det(motion.rest[:3, :3])) < 1e-12 or abs(np.linalg.det(frame)) < 1e-18:
        return "its node has no extent"
    back = np.linalg.inv(frame @ motion.rest)
    moves = np.stack([frame @ pose @ back for pose in motion.poses])  # in the mesh's frame
    stretch = np.linalg.svd(moves[:, :3, :3], compute_uv=False)
    if np.abs(stretch - 1.0).max() > MOTIONS.scale:
        return "it changes the size"
    vectors = Rotation.from_matrix(moves[:, :3, :3]).as_rotvec()
    angle = np.linalg.norm(vectors, axis=1)
    if angle.max() < MOTIONS.turn:
        return _slide(motion, moves[:, :3, 3], diagonal, mesh_T_file)
    return _turn(motion, moves, vectors, angle, diagonal)


def _slide(
    motion: NodeMotion, shifts: FloatArray, diagonal: float, mesh_T_file: FloatArray
) -> AnimatedJoint | str:
    far = np.linalg.norm(shifts, axis=1)
    if far.max() < MOTIONS.shift * diagonal:
        return "it does not move"
    if far.max() > MOTIONS.far * diagonal:
        return "it flies away"
    axis = shifts[int(np.argmax(far))] / far.max()
    along = shifts @ axis
    if np.linalg.norm(shifts - along[:, None] * axis, axis=1).max() > MOTIONS.stray * diagonal:
        return "it follows no straight line"
    origin = (mesh_T_file @ np.array([0.0, 0.0, 0.0, 1.0]))[:3]
    limits = (float(min(along.min(), 0.0)), float(max(along.max(), 0.0)))
    return AnimatedJoint(motion.node, motion.animation, "slide", axis, origin, limits)


def _turn(
    motion: NodeMotion, moves: FloatArray, vectors: FloatArray, angle: FloatArray, diagonal: float
) -> AnimatedJoint | str:
    axis = vectors[int(np.argmax(np.minimum(angle, np.pi - 1e-3)))]
    axis = axis / np.linalg.norm(axis)
    clear = angle > MOTIONS.turn
    cosine = np.abs(vectors[clear] @ axis) / angle[clear]
    if np.arccos(np.clip(cosine, -1, 1)).max() > MOTIONS.wobble:
        return "it turns about no fixed axis"
    # the line of points that stay: (1 - R) x = t, in the plane across the axis, over all poses
    rows = (np.eye(3) - moves[clear, :3, :3]).reshape(-1, 3)
    shifts = moves[clear, :3, 3].reshape(-1)
    origin = np.linalg.lstsq(
        np.concatenate([rows, axis[None]]), np.append(shifts, 0.0), rcond=None
    )[0]
    left = (moves[:, :3, :3] @ origin + moves[:, :3, 3]) - origin
    if np.linalg.norm(left, axis=1).max() > MOTIONS.stray * diagonal:
        return "it turns about no fixed line"
    signed = np.unwrap(np.concatenate([[0.0], vectors @ axis]))
    low, high = float(signed.min()), float(signed.max())
    step = float(np.abs(np.diff(signed)).max(initial=0.0))
    if high - low + step >= MOTIONS.whole and high - low > np.pi:
        return AnimatedJoint(
            motion.node, motion.animation, "spin", axis, origin, (-np.inf, np.inf)
        )  # fmt: skip
    if -low > high:  # positive opens: the side that goes farther
        axis, low, high = -axis, -high, -low
    return AnimatedJoint(motion.node, motion.animation, "hinge", axis, origin, (low, high))
