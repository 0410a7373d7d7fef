"""Lids: how far one that stands open closes, and where the line lies about which it does not jam.

The pose in which a plate lies on the body is known from both shapes; one turn leads there from
where it stands. A line that is off by half the plate's thickness would press it into the body. So
would a line behind the edge at which a closed lid lies on its body: its rim would turn into that.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from mam_pipeline.geometry.boxes import least_rectangle
from mam_pipeline.geometry.sampling import unit
from mam_pipeline.types import FloatArray, IntArray, JointCandidate, Mesh


@dataclass(frozen=True)
class ClosingThresholds:
    """Which parts are open lids.

    Attributes:
        level: largest upright share of the line. thin: thickness over length of a plate.
        end: cosine between the plate and the way from the line to its middle.
        least: radians that an open lid closes at least.
        alike: share by which plate and body may differ in length to lie flush.
        moved: diagonals by which the line may be moved. to_edge: the same, to the edge at which
            a closed lid lies on its body.
        corner: diagonals between the outermost contact and the corner of a body that is the edge.
        jams: share of its usual way below which a lid that meets something has a line to be moved.
        runs: share that it must go about the line at the edge.
    """

    level: float = 0.1
    thin: float = 0.35
    end: float = 0.9
    least: float = float(np.deg2rad(30.0))
    alike: float = 0.05
    moved: float = 0.05
    to_edge: float = 0.025
    corner: float = 0.01
    jams: float = 0.8
    runs: float = 0.9


CLOSING = ClosingThresholds()


@dataclass(frozen=True)
class Closing:
    """An open lid's line, its axis turned so that positive motion opens, and the way to closed.

    Attributes:
        way: radians from where it stands until it lies on the body.
    """

    line: JointCandidate
    way: float


def closing_of(mesh: Mesh, part: IntArray, body: IntArray, line: JointCandidate) -> Closing | None:
    """The line near a hinge's about which an open lid closes; None where the part is none.

    Args:
        mesh: upright, Z up. part, body: face indices.
    """
    axis = unit(line.axis)
    if abs(axis[2]) > CLOSING.level:
        return None
    points, rest = (mesh.vertices[mesh.faces[f].reshape(-1)] for f in (part, body))
    plane = _plane_of(axis, rest, line)
    inward, up = plane
    flat, base, at = points @ plane.T, rest @ plane.T, line.origin @ plane.T
    top = float(base[:, 1].max())
    arm = 0.5 * (flat.min(axis=0) + flat.max(axis=0)) - at
    if arm[1] + at[1] <= top:
        return None  # it does not stand above the body
    sides = least_rectangle(points, axis)[:2]
    long = np.array([np.ptp(points @ side) for side in sides])
    along = sides[int(np.argmax(long))] @ plane.T
    along = along * np.sign(along @ arm)
    if long.min() > CLOSING.thin * long.max() or along @ unit(arm) < CLOSING.end:
        return None
    way = float(np.arctan2(along[1], along[0]))  # above the level way towards the body
    if way < CLOSING.least:
        return None
    cos, sin = np.cos(way), np.sin(way)
    turn = np.array([[cos, sin], [-sin, cos]])
    shut = (flat - at) @ turn.T + at
    shift = np.array([0.0, top - float(shut[:, 1].min())])
    length, depth = float(np.ptp(shut[:, 0])), float(np.ptp(base[:, 0]))
    if abs(length - depth) <= CLOSING.alike * depth:
        shift[0] = 0.5 * (base[:, 0].min() + base[:, 0].max() - shut[:, 0].min() - shut[:, 0].max())
    moved = np.linalg.solve(np.eye(2) - turn, shift)
    if np.linalg.norm(moved) > CLOSING.moved * mesh.diagonal:
        return None
    opens = np.cross(inward, up)
    return Closing(replace(line, axis=opens, origin=line.origin + moved @ plane), way)


def at_edge(
    mesh: Mesh, part: IntArray, body: IntArray, line: JointCandidate, contact: FloatArray
) -> JointCandidate | None:
    """A hinge's line at the outer edge at which a closed lid lies on its body.

    None where there is no such edge near the line.

    Args:
        mesh: upright, Z up. part, body: face indices.
        contact: (n, 3) points at which the part touches what stands still.
    """
    axis = unit(line.axis)
    if abs(axis[2]) > CLOSING.level or not len(contact):
        return None
    points, rest = (mesh.vertices[mesh.faces[f].reshape(-1)] for f in (part, body))
    plane = _plane_of(axis, rest, line)
    both = np.concatenate([points, rest])
    touching, corners = ((p - line.origin) @ plane.T for p in (contact, both))
    outer = touching[int(np.argmin(touching[:, 0]))]
    away = np.linalg.norm(corners - outer, axis=1)
    if away.min() > CLOSING.corner * mesh.diagonal:
        return None
    moved = corners[int(np.argmin(away))]
    if np.linalg.norm(moved) > CLOSING.to_edge * mesh.diagonal:
        return None
    return replace(line, origin=line.origin + moved @ plane)


def _plane_of(axis: FloatArray, body: FloatArray, line: JointCandidate) -> FloatArray:
    """(2, 3) unit vectors square to a level line: towards the body's middle, and up.

    Args:
        body: (n, 3) its points.
    """
    up = unit(np.array([0.0, 0.0, 1.0]) - axis[2] * axis)
    inward = np.cross(axis, up)
    middle = 0.5 * (body.min(axis=0) + body.max(axis=0)) - line.origin
    return np.stack([inward if middle @ inward >= 0.0 else -inward, up])
