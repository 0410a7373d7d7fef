"""Where a gripper takes hold of each movable part: handles, knobs, edges, rims, push points."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mam_pipeline.asset.handles import Handle, find_handles, handle_faces, opening_direction
from mam_pipeline.geometry.raycast import RayScene
from mam_pipeline.geometry.sampling import sample_surface, unit
from mam_pipeline.types import Articulation, FloatArray, Grasp, Joint

CLEARANCE = 0.004
"""Added to a grip's width so that the fingers pass, metres."""
MAX_GRIP = 0.09
"""Widest thing offered to a two-finger hand, metres."""
PUSH_KINDS = ("button", "key", "pedal", "switch", "trigger")


def find_grasps(articulation: Articulation) -> tuple[Grasp, ...]:
    """Grasps of every movable joint at the rest pose, most confident first within each joint."""
    out: list[Grasp] = []
    for joint in articulation.joints:
        if joint.type == "fixed":
            continue
        found = _Finder(articulation, joint).grasps()
        out += sorted(found, key=lambda g: -g.confidence)
    return tuple(out)


class _Finder:
    """Finds the grasps of one joint."""

    def __init__(self, articulation: Articulation, joint: Joint) -> None:
        self.articulation, self.joint = articulation, joint
        self.link = articulation.links[joint.child]
        mesh = articulation.mesh
        carried = articulation.carried_links(joint)
        mine = np.concatenate([articulation.links[i].faces for i in carried])
        others = np.setdiff1d(np.arange(len(mesh.faces)), mine)
        self.others = RayScene(mesh.vertices, mesh.faces[others]) if len(others) else None
        self.points = sample_surface(mesh.vertices, mesh.faces[self.link.faces], 3000).points
        self.carried = carried
        self.diagonal = mesh.diagonal
        self.opening = opening_direction(articulation, joint)

    def grasps(self) -> list[Grasp]:
        if not len(self.points):
            return []
        out: list[Grasp] = []
        for handle in self._handles():
            out += self._on_handle(handle)
        if self.joint.subtype == "spin" or not self.opening.any():
            out += self._on_spin()
        elif not any(g.confidence > 0.6 for g in out):
            out += self._on_edges()
        out += self._push()
        return out

    def _handles(self) -> list[Handle]:
        """Handles of the child and of parts that it carries (a lever on a door)."""
        found = find_handles(self.articulation, self.joint)
        if found or not self.opening.any():
            return found
        for index in self.carried[1:]:
            inner = self.articulation.joint_of(index)
            mesh = self.articulation.mesh
            faces = self.articulation.links[index].faces
            if inner is None or not len(faces):
                continue
            points = sample_surface(mesh.vertices, mesh.faces[faces], 400).points
            level = float((self.points @ self.opening).max())
            if np.quantile(points @ self.opening, 0.7) > level - 0.25 * self._thickness():
                found.append(Handle(index, faces, self.opening, level, points))
        return found

    def _thickness(self) -> float:
        return float(np.ptp(self.points @ self.opening))

    def _make(
        self,
        kind: str,
        position: FloatArray,
        approach: FloatArray,
        closing: FloatArray,
        width: float,
        depth: float,
        confidence: float,
        link: int | None = None,
    ) -> Grasp:
        name = self.articulation.links[self.joint.child if link is None else link].name
        approach = unit(approach)
        closing = unit(closing - (closing @ approach) * approach)
        provenance = "inferred"
        return Grasp(
            self.joint.name, name, kind, position, approach, closing,  # type: ignore[arg-type]
            float(max(width, 0.002)), float(max(depth, 0.0)), float(confidence), provenance,  # type: ignore[arg-type]
        )  # fmt: skip

    def _on_handle(self, handle: Handle) -> list[Grasp]:
        """Fingers across the bar's short side, coming from outside."""
        out = handle.outward
        heights = handle.points @ out
        top = float(heights.max())
        standing = top - handle.level
        # the gripped section is the outer part: posts lie below it
        grip = handle.points[heights > top - max(0.6 * standing, 0.004)]
        frame = _flat_axes(grip, out, self.joint)
        spans = np.ptp(grip @ frame.T, axis=0)
        long, short = (0, 1) if spans[0] >= spans[1] else (1, 0)
        centre = _box_centre(grip, np.vstack([frame, out]))
        tip = min(standing, 0.5 * float(np.ptp(grip @ out)) + 0.01)
        position = centre + out * (top - tip - centre @ out)
        depth = float(position @ out) - handle.level - 0.003
        knob = spans[long] < 1.6 * max(spans[short], 1e-6)
        kind = "knob" if knob else "handle"
        index = handle.link
        grasps = []
        width = float(spans[short]) + CLEARANCE
        sure = 0.9 if width < MAX_GRIP else 0.3
        grasps.append(self._make(kind, position, -out, frame[short], width, depth, sure, index))
        if knob and spans[long] + CLEARANCE < MAX_GRIP:
            width = float(spans[long]) + CLEARANCE
            grasps.append(self._make(kind, position, -out, frame[long], width, depth, 0.85, index))
        if not knob:
            for share in (-0.3, 0.3):  # off the middle: another reach for the arm
                spot = position + frame[long] * share * spans[long]
                near = np.abs((handle.points - spot) @ frame[long]) < 0.15 * spans[long]
                if near.any():
                    grasps.append(
                        self._make(kind, spot, -out, frame[short], width, depth, sure - 0.1, index)
                    )
        return grasps

    def _on_spin(self) -> list[Grasp]:
        """A knob from the front, a lever by its end, a wheel by its rim."""
        axis = self.joint.axis
        middle = self.points.mean(axis=0)
        mesh = self.articulation.mesh
        away = (middle - mesh.bounds.mean(axis=0)) @ axis
        out = axis if away >= 0 else -axis
        if self._crowded(middle + out * 0.5 * np.ptp(self.points @ out), out):
            out = -out
        heights = self.points @ out
        top, span = float(heights.max()), float(np.ptp(heights))
        grip = self.points[heights > top - 0.6 * span]
        frame = _flat_axes(grip, out, self.joint)
        spans = np.ptp(grip @ frame.T, axis=0)
        long, short = (0, 1) if spans[0] >= spans[1] else (1, 0)
        tip = min(0.5 * span, 0.015)
        hub = self.joint.origin + ((middle - self.joint.origin) @ axis) * axis
        level = top - tip
        centre = hub + out * (level - hub @ out)
        depth = tip - 0.002
        grasps = []
        for k, sure in ((short, 0.85), (long, 0.75)):
            width = float(spans[k]) + CLEARANCE
            if width < MAX_GRIP:
                grasps.append(self._make("knob", centre, -out, frame[k], width, depth, sure))
        grasps += self._on_rim(out, hub, level, depth)
        return grasps

    def _on_rim(self, out: FloatArray, hub: FloatArray, level: float, depth: float) -> list[Grasp]:
        """The far end of a lever, or four places on a wheel's rim; fingers close along the path."""
        arms = self.points - hub
        flat = arms - np.outer(arms @ out, out)
        radius = np.linalg.norm(flat, axis=1)
        reach = float(radius.max())
        if reach < 0.03:
            return []
        rim = flat[radius > 0.85 * reach]
        towards = unit(rim.mean(axis=0))
        lever = float(np.linalg.norm(rim.mean(axis=0))) > 0.5 * reach
        starts = [towards] if lever else [unit(v) for v in _spread(rim, 4)]
        grasps = []
        for radial in starts:
            tangent = np.asarray(np.cross(self.joint.axis, radial), dtype=np.float64)
            near = flat[(flat @ radial > 0.8 * reach) & (np.abs(flat @ tangent) < 0.25 * reach)]
            if not len(near):
                continue
            closing = tangent if lever else radial
            width = float(np.ptp(near @ closing)) + CLEARANCE
            spot = hub + radial * float(np.median(near @ radial))
            spot = spot + out * (level - spot @ out)
            sure = 0.7 if width < MAX_GRIP else 0.2
            grasps.append(self._make("rim", spot, -out, closing, width, depth, sure))
        return grasps

    def _on_edges(self) -> list[Grasp]:
        """The free edges of a door, lid or drawer front: fingers on both faces of the board."""
        out = self.opening
        heights = self.points @ out
        front = float(heights.max())
        board = self.points[heights > front - max(0.03, 0.02 * self.diagonal)]
        frame = _flat_axes(board, out, self.joint)
        low, high = (board @ frame.T).min(axis=0), (board @ frame.T).max(axis=0)
        centre = (low + high) / 2
        grasps = []
        for k in (0, 1):
            for sign, limit in ((-1.0, low[k]), (1.0, high[k])):
                outward = sign * frame[k]
                lever = self._lever(outward, limit * frame[k] + centre[1 - k] * frame[1 - k], front)
                if lever < 0.35:
                    continue
                edge = board[np.abs(board @ frame[k] - limit) < 0.02 * self.diagonal]
                thick = float(np.ptp(edge @ out)) if len(edge) else 0.0
                width = thick + CLEARANCE
                grip = min(0.012, 0.1 * float(high[k] - low[k]))
                spot = (limit - sign * grip) * frame[k] + centre[1 - k] * frame[1 - k]
                spot = spot + out * (front - thick / 2)
                blocked = self._crowded(spot + outward * (grip + 0.02), outward)
                behind = self._crowded(spot - out * (thick / 2 + 0.008), outward)
                sure = 0.55 * lever if width < MAX_GRIP else 0.15
                sure *= (0.4 if blocked else 1.0) * (0.5 if behind else 1.0)
                kind = "rim" if self.joint.type == "prismatic" else "edge"
                grasps.append(self._make(kind, spot, -outward, out, width, grip, sure))
        return grasps

    def _lever(self, outward: FloatArray, edge: FloatArray, front: float) -> float:
        """How well pulling at this edge opens the part: its lever arm over the longest, 0..1."""
        if self.joint.type == "prismatic":
            return 1.0 if outward[2] > 0.5 else 0.6
        at = edge + self.opening * (front - edge @ self.opening)
        arm = np.cross(self.joint.axis, at - self.joint.origin)
        reach = np.cross(self.joint.axis, self.points - self.joint.origin)
        return float(np.linalg.norm(arm) / max(np.linalg.norm(reach, axis=1).max(), 1e-9))

    def _push(self) -> list[Grasp]:
        """A fingertip against the part, in the direction in which it opens; buttons for certain."""
        if not self.opening.any():
            return []
        along = self.opening
        near = self.points @ along
        back = self.points[near < near.min() + 0.1 * max(np.ptp(near), 1e-6) + 1e-4]
        spot = _box_centre(back, np.eye(3))
        if self.joint.type != "prismatic":
            arms = np.linalg.norm(np.cross(self.joint.axis, back - self.joint.origin), axis=1)
            far = back[arms > 0.8 * arms.max()]
            spot = far[np.argmin(np.linalg.norm(far - far.mean(axis=0), axis=1))]
        if self._crowded(spot - along * 0.03, -along):
            return []
        side = np.cross(along, np.eye(3)[int(np.argmin(np.abs(along)))])
        sure = 0.9 if self.link.kind.lower() in PUSH_KINDS else 0.4
        return [self._make("push", spot, along, side, 0.0, 0.0, sure)]

    def _crowded(self, point: FloatArray, outward: FloatArray) -> bool:
        """Whether something static is in the way of a fingertip coming to `point` from outside."""
        if self.others is None:
            return False
        if float(self.others.distance(point[None])[0]) < 0.006:
            return True
        hits = self.others.first_hits(point[None], (outward * 0.15)[None])
        return bool(hits.t[0] <= 1.0)


def _flat_axes(points: FloatArray, normal: FloatArray, joint: Joint) -> FloatArray:
    """(2, 3) unit directions across `normal`, along the points' least box in that plane."""
    seed = joint.axis if abs(joint.axis @ normal) < 0.7 else np.array([0.0, 0.0, 1.0])
    if abs(seed @ normal) > 0.9:
        seed = np.array([0.0, 1.0, 0.0])
    u = unit(seed - (seed @ normal) * normal)
    v = np.cross(normal, u)
    flat = np.stack([points @ u, points @ v], axis=1)
    angles = np.linspace(0.0, np.pi / 2, 19)[:-1]
    areas = []
    for angle in angles:
        c, s = np.cos(angle), np.sin(angle)
        turned = flat @ np.array([[c, -s], [s, c]])
        areas.append(float(np.prod(np.ptp(turned, axis=0))))
    best = angles[int(np.argmin(np.array(areas) + 1e-3 * max(areas) * (angles > 0)))]
    c, s = np.cos(best), np.sin(best)
    return np.stack([c * u + s * v, -s * u + c * v])


def _box_centre(points: FloatArray, axes: FloatArray) -> FloatArray:
    """(3,) centre of the box of points along orthonormal rows (3, 3)."""
    local = points @ axes.T
    return np.asarray((local.min(axis=0) + local.max(axis=0)) / 2 @ axes)


def _spread(vectors: FloatArray, count: int) -> Sequence[FloatArray]:
    """`count` of the vectors that point as differently as possible."""
    chosen = [vectors[0]]
    for _ in range(count - 1):
        unit_vectors = unit(vectors)
        closeness = np.max([unit_vectors @ unit(c) for c in chosen], axis=0)
        chosen.append(vectors[int(np.argmin(closeness))])
    return chosen


__all__ = ["Grasp", "find_grasps", "handle_faces"]
