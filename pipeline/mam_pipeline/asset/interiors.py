"""What a fused surface cannot show: the insides behind parts that were cut out of it.

A generated or scanned mesh is one closed skin. Cutting a drawer front or a door out of it leaves
two open holes. Here the part gets a back, a drawer a box of its own, and the body a compartment
behind the opening. All of it is assumed, is made only where the source was cut, and is recorded.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import trimesh
from numpy.typing import NDArray
from shapely import contains_xy
from shapely.geometry import MultiPolygon, Polygon

from mam_pipeline.asset.handles import opening_direction
from mam_pipeline.asset.rims import cut_rims, length
from mam_pipeline.geometry.boxes import principal_axes
from mam_pipeline.geometry.raycast import RayScene
from mam_pipeline.geometry.sampling import face_geometry, sample_surface
from mam_pipeline.geometry.surface import Triangles, concatenate
from mam_pipeline.types import Articulation, FloatArray, IntArray, Joint, Material, Mesh

PANEL = 0.018
"""Thickness of fronts and doors that are not thicker already, metres."""
WALL = 0.010
"""Thickness of a drawer box's boards, metres."""
PLAY = 0.004
"""Room between a drawer box and its compartment, metres."""
_LEAST_AREA = 0.004
_SHALLOW = 0.3
"""A drawer needs a body deeper than this share of the square root of its front's area."""
_DEEP = 2.0
"""No drawer is deeper, in the same unit."""
_OWN_INSIDE = 0.5
"""A part that reaches farther behind its rim, in the same unit, brings its inside along."""
_SHEET = 0.12
"""A body thinner than this behind the opening, in the same unit, holds no compartment."""
_WHOLE = 0.5
"""A rim whose inset loses more of its area than this is too torn for an inside."""
_HIGH = 0.85
"""A drawer's boards are this share of its front's height."""
_WAY = 0.75
"""A drawer comes out by this share of its box."""
_NEARLY = 0.8
"""Cosine between a part's mean motion and the normal of its rim's plane, taken for one."""


@dataclass(frozen=True)
class _Added:
    """New faces of one link: (V, 3) vertices and (F, 3) faces."""

    link: int
    vertices: FloatArray
    faces: IntArray


def add_interiors(articulation: Articulation) -> tuple[Articulation, list[str]]:
    """Close the holes of parts cut from one skin; drawers get boxes, the body compartments.

    A drawer whose front alone would lose touch runs on as far as its box guides it.

    Returns:
        The articulation with more faces at the end of its mesh, and notes for the card. Both are
        as they were where nothing was cut.
    """
    rims = cut_rims(articulation)
    added: list[_Added] = []
    notes: list[str] = []
    joints = []
    for joint in articulation.joints:
        mine = [rim for child, rim in rims if child == joint.child]
        if mine and joint.type != "fixed":
            more, joint, said = _inside_of(articulation, joint, max(mine, key=length))
            added += more
            notes += [said] if said else []
        joints.append(joint)
    if not added:
        return articulation, []
    return replace(_extended(articulation, added), joints=tuple(joints)), notes


def _inside_of(
    articulation: Articulation, joint: Joint, rim: FloatArray
) -> tuple[list[_Added], Joint, str]:
    """The back of one part and the compartment behind it; `rim` (n, 3) is where it was cut."""
    name = articulation.links[joint.child].name
    flat = _Flat(rim, _outward(articulation, joint, rim))
    polygon = flat.polygon
    if polygon is None:
        return [], joint, ""
    diagonal = articulation.mesh.diagonal
    thick, behind = _thickness(articulation, joint, flat)
    small = polygon.area < _LEAST_AREA * diagonal**2 or joint.subtype == "spin"
    if not small and behind > _OWN_INSIDE * polygon.area**0.5:
        return [], joint, ""
    room = _room(articulation, joint, flat)
    play = min(PLAY, 0.004 * diagonal)
    panel = max(min(PANEL, 0.02 * diagonal, 0.3 * room) - thick, play)
    # walls in the very outline would lie in the skin of a body as wide as its front
    aside = _beside(articulation, joint, flat, 0.5 * room)
    board = max(min(WALL, 0.01 * diagonal) - aside, 0.5 * play)
    inner, seat, walls, inside = (
        _largest(polygon.buffer(-by, join_style="mitre"))
        for by in (play, 0.4 * play, board, board + play)
    )
    sheet = not small and room < _SHEET * polygon.area**0.5
    if small or sheet or inside.area < _WHOLE * polygon.area:
        closed = (joint.child,) if sheet else (joint.child, joint.parent)
        out = [_Added(link, *flat.cap(polygon, 0.0)) for link in closed]
        return out, joint, f"{name}: the cut was closed flat (assumed)"
    depth = 0.85 * room
    out = [_Added(joint.child, *flat.skirt(polygon, inner, panel))]
    along, level = abs(joint.axis @ flat.outward) > 0.9, abs(flat.outward[2]) < 0.5
    drawn = joint.type == "prismatic" and along and level
    if drawn and room > _SHALLOW * polygon.area**0.5:
        depth = min(0.9 * room, _DEEP * polygon.area**0.5)
        box = flat.drawer(inside, panel, depth - 2 * play, min(WALL, 0.2 * panel + 0.004))
        out.append(_Added(joint.child, *box))
        joint = _drawn_out(articulation, joint, flat, depth)
        said = f"{name}: a drawer box of {depth:.2f} m and a compartment for it (assumed)"
    else:
        said = f"{name}: a back, and a compartment of {depth:.2f} m behind it (assumed)"
    steps = [(seat, min(panel + play, 0.5 * depth)), (walls, depth)]
    out.append(_Added(joint.parent, *flat.compartment(polygon, steps)))
    return out, joint, said


def _largest(shape: Polygon | MultiPolygon) -> Polygon:
    """The largest piece of what may have come apart."""
    return max(getattr(shape, "geoms", [shape]), key=lambda p: p.area, default=Polygon())


def _outward(articulation: Articulation, joint: Joint, rim: FloatArray) -> FloatArray:
    """(3,) unit direction in which the part leaves its rim: along a slide, else off its plane."""
    outward = opening_direction(articulation, joint)
    if not outward.any():
        middle = articulation.mesh.bounds.mean(axis=0)
        outward = np.asarray(joint.axis) * np.sign((rim.mean(axis=0) - middle) @ joint.axis or 1.0)
    if joint.type != "prismatic":
        normal = principal_axes(rim)[0][2]
        normal = normal * (np.sign(normal @ outward) or 1.0)
        if normal @ outward > _NEARLY:  # a handle or the hinge's side tilts the mean motion
            return np.asarray(normal)
    return outward


def _thickness(articulation: Articulation, joint: Joint, flat: _Flat) -> tuple[float, float]:
    """How far the part's broad front lies before the rim, and how far it reaches in behind, m."""
    mesh = articulation.mesh
    faces = mesh.faces[articulation.links[joint.child].faces]
    normals, areas = face_geometry(mesh.vertices, faces)
    centres = mesh.vertices[faces].mean(axis=1)
    height = (centres - flat.origin) @ flat.outward
    facing = np.flatnonzero(normals @ flat.outward > 0.7)
    behind = float(-height[_within(flat, centres)].min(initial=0.0))
    if not len(facing):
        return 0.0, behind
    order = facing[np.argsort(height[facing])]
    weight = np.cumsum(areas[order])
    return max(float(height[order[np.searchsorted(weight, 0.5 * weight[-1])]]), 0.0), behind


def _within(flat: _Flat, points: FloatArray) -> NDArray[np.bool_]:
    """(n,) which points lie before or behind the opening."""
    plane = (points - flat.origin) @ np.stack([flat.u, flat.v], axis=1)
    return np.asarray(contains_xy(flat.polygon, plane[:, 0], plane[:, 1]))


def _drawn_out(articulation: Articulation, joint: Joint, flat: _Flat, depth: float) -> Joint:
    """The joint with the way of a drawer `depth` metres deep, if nothing measured had ended it."""
    if joint.basis.rule not in ("contact_loss", "depth"):
        return joint
    mesh = articulation.mesh
    own = [articulation.links[i].faces for i in articulation.carried_links(joint)]
    others = np.setdiff1d(np.arange(len(mesh.faces)), np.concatenate(own))
    faces = mesh.faces[articulation.links[joint.child].faces]
    points = sample_surface(mesh.vertices, faces, 400).points
    start = points + 1e-3 * mesh.diagonal * flat.outward
    start = start[(start - flat.origin) @ flat.outward > 0.0]
    ahead = RayScene(mesh.vertices, mesh.faces[others]).first_hits(
        start, np.tile(flat.outward, (len(start), 1))
    )
    way = min(_WAY * depth, 0.9 * float(ahead.t.min(initial=np.inf)))
    sign = 1.0 if joint.axis @ flat.outward > 0 else -1.0
    if way <= sign * joint.open and joint.basis.rule == "contact_loss":
        return joint
    lower, upper = (joint.lower, way) if sign > 0 else (-way, joint.upper)
    basis = replace(joint.basis, rule="drawer_box")
    return replace(joint, lower=lower, upper=upper, open=sign * way, basis=basis)


class _Flat:
    """A rim seen along the opening direction: 2-D polygon, and solids raised behind it.

    Depth counts inwards, against `outward`; the rim's mean plane is depth 0.
    """

    def __init__(self, rim: FloatArray, outward: FloatArray) -> None:
        up = np.array([0.0, 0.0, 1.0]) if abs(outward[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
        v = up - (up @ outward) * outward
        self.v = v / np.linalg.norm(v)
        self.u = np.cross(self.v, outward)
        self.outward = outward
        self.origin = rim.mean(axis=0)
        plane = np.stack([(rim - self.origin) @ self.u, (rim - self.origin) @ self.v], axis=1)
        polygon = Polygon(plane)
        if not polygon.is_valid:
            polygon = polygon.buffer(0)
        polygon = _largest(polygon)
        good = polygon.area > 1e-8
        self.polygon = Polygon(polygon.exterior).simplify(1e-4) if good else None

    def lift(self, plane: FloatArray, depth: FloatArray | float) -> FloatArray:
        """(n, 3) points of the asset frame from (n, 2) plane coordinates at a depth."""
        inwards = np.broadcast_to(np.asarray(depth, dtype=float), len(plane))
        flat = plane[:, :1] * self.u + plane[:, 1:2] * self.v
        return np.asarray(self.origin + flat - inwards[:, None] * self.outward)

    def cap(self, polygon: Polygon, depth: float) -> Triangles:
        """The polygon as triangles at a depth."""
        plane, faces = trimesh.creation.triangulate_polygon(polygon, engine="earcut")
        return self.lift(np.asarray(plane), depth), np.asarray(faces, dtype=np.int64)

    def skirt(self, outer: Polygon, inner: Polygon, depth: float) -> Triangles:
        """From the rim inwards a little smaller, closed at the back."""
        rim, wall = self._ledge(outer, inner, 0.0), self._wall(inner, 0.0, depth)
        return concatenate([rim, wall, self.cap(inner, depth)])

    def compartment(self, polygon: Polygon, steps: Sequence[tuple[Polygon, float]]) -> Triangles:
        """A pocket behind the outline, open in front: each step narrows it, down to a depth."""
        out, outer, near = [], polygon, 0.0
        for inner, far in steps:
            out += [self._ledge(outer, inner, near), self._wall(inner, near, far)]
            outer, near = inner, far
        return concatenate([*out, self.cap(outer, near)])

    def _ledge(self, outer: Polygon, inner: Polygon, depth: float) -> Triangles:
        """The flat ring between two outlines at a depth."""
        ring = trimesh.creation.triangulate_polygon(
            Polygon(outer.exterior, [inner.exterior.coords]), engine="earcut"
        )
        return self.lift(np.asarray(ring[0]), depth), np.asarray(ring[1], dtype=np.int64)

    def drawer(self, polygon: Polygon, front: float, back: float, wall: float) -> Triangles:
        """Bottom, sides and back boards within the polygon's box; open at the top."""
        low_u, low_v, high_u, high_v = polygon.bounds
        high_v = low_v + _HIGH * (high_v - low_v)
        boards = [
            (low_u, high_u, low_v, low_v + wall, front, back),
            (low_u, low_u + wall, low_v + wall, high_v, front, back),
            (high_u - wall, high_u, low_v + wall, high_v, front, back),
            (low_u + wall, high_u - wall, low_v + wall, high_v, back - wall, back),
        ]
        made = []
        for a, b, c, d, near, far in boards:
            box = trimesh.creation.box(bounds=[[a, c, near], [b, d, far]])
            points = np.asarray(box.vertices)
            made.append((self.lift(points[:, :2], points[:, 2]), np.asarray(box.faces, np.int64)))
        return concatenate(made)

    def _wall(self, polygon: Polygon, near: float, far: float) -> Triangles:
        ring = np.asarray(polygon.exterior.coords)[:-1]
        n = len(ring)
        vertices = np.concatenate([self.lift(ring, near), self.lift(ring, far)])
        a, b = np.arange(n), (np.arange(n) + 1) % n
        faces = np.concatenate([np.stack([a, b, b + n], 1), np.stack([a, b + n, a + n], 1)])
        return vertices, faces.astype(np.int64)


def _room(articulation: Articulation, joint: Joint, flat: _Flat) -> float:
    """Distance from the rim to the body's far side, inwards, metres."""
    mesh = articulation.mesh
    faces = articulation.links[joint.parent].faces
    polygon = flat.polygon
    if not len(faces) or polygon is None:
        return PANEL
    scene = RayScene(mesh.vertices, mesh.faces[faces])
    low_u, low_v, high_u, high_v = polygon.bounds
    grid = np.stack(np.meshgrid(np.linspace(0.2, 0.8, 4), np.linspace(0.2, 0.8, 4)), -1)
    plane = grid.reshape(-1, 2) * [high_u - low_u, high_v - low_v] + [low_u, low_v]
    start = flat.lift(plane, 0.002 * mesh.diagonal)
    hits = scene.first_hits(start, np.tile(-flat.outward, (len(start), 1)))
    reached = hits.t[np.isfinite(hits.t)]
    return float(np.quantile(reached, 0.2)) if len(reached) else PANEL


def _beside(articulation: Articulation, joint: Joint, flat: _Flat, depth: float) -> float:
    """How thick the body is beside the opening, at a depth behind it, metres."""
    mesh = articulation.mesh
    faces = articulation.links[joint.parent].faces
    if not len(faces) or flat.polygon is None:
        return 0.0
    spots = flat.polygon.exterior.segmentize(0.1 * flat.polygon.area**0.5)
    points = flat.lift(np.asarray(spots.coords)[:-1], depth)
    return float(np.quantile(RayScene(mesh.vertices, mesh.faces[faces]).distance(points), 0.1))


def _extended(articulation: Articulation, added: list[_Added]) -> Articulation:
    """The articulation with new faces at the end of its mesh, in a plain material of their own."""
    mesh = articulation.mesh
    assert mesh.face_material is not None and mesh.face_group is not None
    vertices, faces = [mesh.vertices], [mesh.faces]
    count, links = len(mesh.vertices), list(articulation.links)
    next_face = len(mesh.faces)
    for piece in added:
        vertices.append(piece.vertices)
        faces.append(piece.faces + count)
        count += len(piece.vertices)
        new = np.arange(next_face, next_face + len(piece.faces))
        next_face += len(piece.faces)
        link = links[piece.link]
        links[piece.link] = replace(link, faces=np.concatenate([link.faces, new]))
    extra_faces, extra_points = next_face - len(mesh.faces), count - len(mesh.vertices)
    material = Material("interior", (0.72, 0.66, 0.58, 1.0))
    colors = uv = None
    if mesh.colors is not None:
        plain = np.array([184, 168, 148, 255], np.uint8)
        colors = np.concatenate([mesh.colors, np.tile(plain, (extra_points, 1))])
    if mesh.uv is not None:
        uv = np.concatenate([mesh.uv, np.zeros((extra_points, 2), np.float32)])
    group = np.full(extra_faces, len(mesh.group_names))
    extended = Mesh(
        vertices=np.concatenate(vertices),
        faces=np.concatenate(faces),
        materials=(*mesh.materials, material),
        face_material=np.concatenate(
            [mesh.face_material, np.full(extra_faces, len(mesh.materials))]
        ),
        uv=uv,
        colors=colors,
        face_group=np.concatenate([mesh.face_group, group]),
        group_names=(*mesh.group_names, "interior"),
    )
    return replace(articulation, mesh=extended, links=tuple(links))
