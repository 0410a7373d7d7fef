"""Where an object's front is, and articulations moved into another frame."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from mam_pipeline.geometry.motion import motion_points
from mam_pipeline.geometry.sampling import face_geometry, unit
from mam_pipeline.types import Articulation, FloatArray, IntArray, Joint, Mesh


@dataclass(frozen=True)
class FrontThresholds:
    """How a front is decided.

    Attributes:
        clear: share of the parts' votes that must agree for them to decide alone.
        stated: weight of the file's convention beside votes that do not agree.
        wheels: wheels with one axis from which the object is a vehicle; it faces along its track.
        low: share of the height below which the middle of a wheel lies.
        floor: share of the height within which a wheel reaches the floor that the object stands on.
        least: diagonals: less weight of all parts together is too little to decide alone.
        bar: weight of a hinged part that is no panel at all.
    """

    clear: float = 0.4
    stated: float = 0.4
    wheels: int = 2
    low: float = 0.4
    floor: float = 0.05
    least: float = 0.2
    bar: float = 0.1


FRONT = FrontThresholds()


@dataclass(frozen=True)
class Front:
    """Where an object's front is.

    Attributes:
        yaw: (4, 4) rotation about Z that turns it towards -X. why: who says so.
        runner_up: the other side it may be, in words. confidence: 0..1.
    """

    yaw: FloatArray
    why: str
    runner_up: str = ""
    confidence: float = 1.0


def front_of(
    articulation: Articulation, stated: ArrayLike | None = None, given: ArrayLike | None = None
) -> Front:
    """Decide where the front is: as given, where parts open to, else as the file's format has it.

    Drawers slide out of the front, doors swing out of it, closed lids have their free edge there,
    knobs point out of it; votes are weighted by the part's extent and its joint's confidence. Where
    they do not agree (a car's wheels, a lamp), the format's convention decides; with neither, the
    object stays as it is. What rolls across the format's front faces +X, as robots and vehicles do
    (REP 103).

    Args:
        stated: (3,) front by the file's convention, frame of the articulation. given: by the user.
    """
    if given is not None:
        return Front(_towards(articulation.mesh, np.asarray(given, float), False), "said by you")
    vote, weight = _votes(articulation)
    track = _track(articulation)
    weight = max(weight, FRONT.least * articulation.mesh.diagonal)
    share = float(np.linalg.norm(vote) / max(weight, 1e-12))
    direction = None if stated is None else np.asarray(stated, float)[:2]
    if track is not None:
        vote, share = track * 1e-9, 0.0  # a vehicle faces along its track, whatever opens
        if direction is not None:
            side = float(direction @ track)
            if abs(side) <= 0.3:
                yaw = _towards(articulation.mesh, track * np.sign(track[0] or 1.0), True)
                return Front(yaw, "assumed: as vehicles usually have it", "the opposite side", 0.6)
            direction = track * np.sign(side)
    if share >= FRONT.clear or (direction is None and np.linalg.norm(vote) >= 1e-6):
        yaw = _towards(articulation.mesh, vote, True)
        other = "" if share > 0.7 else "another side"
        return Front(yaw, "inferred from where its parts open", other, 0.5 + 0.5 * share)
    if direction is None:
        return Front(np.eye(4), "assumed: as in the file", "any side; --facing settles it", 0.3)
    total = vote / max(weight, 1e-12) + FRONT.stated * direction
    nearest = max((direction, unit(vote)), key=lambda way: float(way @ total))
    yaw = _towards(articulation.mesh, nearest, True)
    return Front(yaw, "assumed: as files of this format usually have it", "the opposite side", 0.6)


def _votes(articulation: Articulation) -> tuple[FloatArray, float]:
    """(2,) sum of the directions in which closed parts open, and the sum of their weights."""
    mesh = articulation.mesh
    vote, weight = np.zeros(2), 0.0
    for joint in articulation.joints:
        points = mesh.vertices[mesh.faces[articulation.links[joint.child].faces].reshape(-1)]
        if not len(points):
            continue
        low, high = points.min(axis=0), points.max(axis=0)
        weighs = _size(mesh, articulation.links[joint.child].faces) * joint.confidence
        arm: FloatArray = (low + high) / 2 - joint.origin
        sign = 1.0 if joint.open >= joint.closed else -1.0
        if joint.type == "prismatic":
            direction = joint.axis * sign
        elif joint.subtype == "spin" or joint.type == "continuous":
            centre = mesh.bounds.mean(axis=0)
            direction = joint.axis * np.sign((low + high) @ joint.axis / 2 - centre @ joint.axis)
        else:
            closed = np.array([joint.closed])
            shut = motion_points("revolute", joint.axis, np.zeros(3), closed, arm[None])[0, 0]
            direction = np.cross(joint.axis * sign, shut)
            body = _middle(mesh, articulation.links[joint.parent].faces) - joint.origin
            if abs(direction[2]) > np.linalg.norm(direction[:2]):  # a lid: free edge is the front
                direction = shut
            elif abs(joint.axis[2]) < 0.3 and shut[2] > 0.0 > body[2]:  # one that still stands up
                direction = body - (body @ joint.axis) * joint.axis
                direction[2] = 0.0
            else:
                weighs *= _flat(points, joint.axis, arm)
        flat = direction[:2] / max(float(np.linalg.norm(direction)), 1e-12)
        vote += flat * weighs
        weight += weighs
    return vote, weight


def _size(mesh: Mesh, faces: IntArray) -> float:
    """Side of a square of half a part's surface, mesh unit: a bar is less than its box."""
    return float(np.sqrt(0.5 * face_geometry(mesh.vertices, mesh.faces[faces])[1].sum()))


def _middle(mesh: Mesh, faces: IntArray) -> FloatArray:
    """(3,) middle of a link's box; of the object's where the link has no faces."""
    points = mesh.vertices[mesh.faces[faces].reshape(-1)] if len(faces) else mesh.bounds
    return np.asarray(0.5 * (points.min(axis=0) + points.max(axis=0)))


def _flat(points: FloatArray, axis: FloatArray, arm: FloatArray) -> float:
    """How far a hinged part is a panel that its line lies in, and no bar or body: 0..1."""
    out = unit(np.cross(axis, arm))
    thick, *sides = (float(np.ptp(points @ d)) for d in (out, axis, np.cross(out, axis)))
    return float(np.clip(1.0 - thick / max(min(sides), 1e-12), FRONT.bar, 1.0))


def _track(articulation: Articulation) -> FloatArray | None:
    """(2,) unit direction along which an object on wheels rolls; None where it has none."""
    mesh = articulation.mesh
    low, high = mesh.bounds
    axes = []
    for joint in articulation.joints:
        points = mesh.vertices[mesh.faces[articulation.links[joint.child].faces].reshape(-1)]
        if joint.type == "prismatic" or joint.subtype != "spin" or not len(points):
            continue
        middle = 0.5 * (points[:, 2].min() + points[:, 2].max())
        on_floor = points[:, 2].min() <= low[2] + FRONT.floor * (high[2] - low[2])
        low_down = middle < low[2] + FRONT.low * (high[2] - low[2])
        if abs(joint.axis[2]) < 0.3 and on_floor and low_down:
            axes.append(joint.axis[:2] / np.linalg.norm(joint.axis[:2]))
    if len(axes) < FRONT.wheels or abs(np.asarray(axes) @ axes[0]).min() < 0.95:
        return None
    return np.array([-axes[0][1], axes[0][0]])


def _towards(mesh: Mesh, direction: FloatArray, snap: bool) -> FloatArray:
    """(4, 4) rotation about Z that turns a level direction towards -X."""
    angle = float(np.pi - np.arctan2(direction[1], direction[0]))
    if snap:
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

    def carried(joint: Joint) -> Joint:
        s = scale if joint.type == "prismatic" else 1.0
        return replace(
            joint,
            axis=turn @ joint.axis,
            origin=point(joint.origin),
            lower=joint.lower * s,
            upper=joint.upper * s,
            closed=joint.closed * s,
            open=joint.open * s,
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
        joints=tuple(carried(joint) for joint in articulation.joints),
        grasps=grasps,
        dormant=tuple(replace(d, joint=carried(d.joint)) for d in articulation.dormant),
    )
