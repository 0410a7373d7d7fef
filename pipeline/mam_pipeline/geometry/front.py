"""Where an object's front is, and articulations moved into another frame."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mam_pipeline.types import Articulation, FloatArray, Mesh


def front_yaw(articulation: Articulation) -> FloatArray:
    """(4, 4) rotation about Z that turns the object's front towards -X.

    The front is where parts open to: drawers slide out of it, doors swing out of it, lids have
    their free edge there, knobs point out of it. Votes are weighted by the part's extent; with no
    vote, or a symmetric one, the object stays as it is.
    """
    mesh = articulation.mesh
    vote = np.zeros(2)
    for joint in articulation.joints:
        points = mesh.vertices[mesh.faces[articulation.links[joint.child].faces].reshape(-1)]
        if not len(points):
            continue
        low, high = points.min(axis=0), points.max(axis=0)
        arm = (low + high) / 2 - joint.origin
        sign = 1.0 if joint.open >= joint.closed else -1.0
        if joint.type == "prismatic":
            direction = joint.axis * sign
        elif joint.subtype == "spin" or joint.type == "continuous":
            centre = mesh.bounds.mean(axis=0)
            direction = joint.axis * np.sign((low + high) @ joint.axis / 2 - centre @ joint.axis)
        else:
            direction = np.cross(joint.axis * sign, arm)
            if abs(direction[2]) > np.linalg.norm(direction[:2]):  # a lid: free edge is the front
                direction = arm
        flat = direction[:2] / max(float(np.linalg.norm(direction)), 1e-12)
        vote += flat * float(np.linalg.norm(high - low))
    if np.linalg.norm(vote) < 1e-6:
        return np.eye(4)
    angle = np.pi - np.arctan2(vote[1], vote[0])
    angle = _snap_to_faces(mesh, angle)
    out = np.eye(4)
    out[:2, :2] = [[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]
    return out


def _snap_to_faces(mesh: Mesh, angle: float) -> float:
    """Snap the yaw so that the dominant vertical faces end up parallel to the X and Y planes."""
    corners = mesh.vertices[mesh.faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(normals, axis=1)
    upright = np.abs(normals[:, 2]) < 0.1 * np.maximum(area, 1e-20)
    if not upright.any():
        return angle
    theta = np.arctan2(normals[upright, 1], normals[upright, 0])
    phase = np.angle(np.sum(area[upright] * np.exp(4j * theta))) / 4  # modulo 90 degrees
    turned = (angle + phase) % (np.pi / 2)
    shift = -turned if turned < np.pi / 4 else np.pi / 2 - turned
    return angle + shift if abs(shift) < np.radians(30) else angle


def moved(articulation: Articulation, matrix: FloatArray) -> Articulation:
    """The same articulation in another frame: `matrix` is a (4, 4) rigid or similarity transform.

    Prismatic limits and positions scale with it; angles do not.
    """
    scale = float(np.cbrt(np.linalg.det(matrix[:3, :3])))
    turn = matrix[:3, :3] / scale

    def point(p: FloatArray) -> FloatArray:
        return matrix[:3, :3] @ p + matrix[:3, 3]

    joints = []
    for joint in articulation.joints:
        s = scale if joint.type == "prismatic" else 1.0
        joints.append(
            replace(
                joint,
                axis=turn @ joint.axis,
                origin=point(joint.origin),
                lower=joint.lower * s,
                upper=joint.upper * s,
                closed=joint.closed * s,
                open=joint.open * s,
            )
        )
    grasps = tuple(
        replace(
            g,
            position=point(g.position),
            approach=turn @ g.approach,
            closing=turn @ g.closing,
            width=g.width * scale,
            depth=g.depth * scale,
        )
        for g in articulation.grasps
    )
    return replace(
        articulation,
        mesh=articulation.mesh.transformed(matrix),
        joints=tuple(joints),
        grasps=grasps,
    )
