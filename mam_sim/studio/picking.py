"""What is under the pointer: rays and boxes on the screen to faces, and lines to snap to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import trimesh

from mam_pipeline.geometry.sampling import face_geometry
from mam_pipeline.render.tracer import Tracer
from mam_pipeline.types import FloatArray, IntArray, Mesh
from mam_sim.studio.lines import mesh_lines


@dataclass(frozen=True)
class PickThresholds:
    """How a box selects, and what an axis snaps to.

    Attributes:
        rays: along each side of a selection box.
        inside: share of a primitive's seen and unseen faces that the box must hold.
        crease: radians between faces at an edge at which a selection of faces ends.
        near: diagonals of the object within which a line snaps.
        turned: radians within which a direction snaps.
        lift: of a number before its piece, diagonals.
    """

    rays: int = 48
    inside: float = 0.75
    crease: float = 0.5
    near: float = 0.04
    turned: float = 0.35
    lift: float = 0.02


PICK = PickThresholds()


@dataclass(frozen=True)
class Camera:
    """A browser's camera: pose (OpenCV: x right, y down, z forward), opening and shape.

    Attributes:
        position: (3,). rotation: (3, 3) world_R_camera. fov: vertical, radians. aspect: width over
            height.
    """

    position: FloatArray
    rotation: FloatArray
    fov: float
    aspect: float

    def screen(self, points: FloatArray) -> FloatArray:
        """(n, 2) places on the screen, 0..1 from the upper left; NaN behind the camera."""
        local = (points - self.position) @ self.rotation
        depth = np.where(local[:, 2] > 1e-6, local[:, 2], np.nan)
        half = np.tan(self.fov / 2)
        x = local[:, 0] / depth / (half * self.aspect)
        y = local[:, 1] / depth / half
        return np.stack([x, y], axis=1) * 0.5 + 0.5

    def rays(self, screen: FloatArray) -> FloatArray:
        """(n, 3) unit rays through places (n, 2) on the screen."""
        half = np.tan(self.fov / 2)
        plane = (screen * 2 - 1) * [half * self.aspect, half]
        local = np.column_stack([plane, np.ones(len(plane))])
        rays = local @ self.rotation.T
        return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))


def face_under(
    tracer: Tracer, origin: FloatArray, ray: FloatArray
) -> tuple[int, FloatArray] | None:
    """The first face that a ray hits, and where; None for the background."""
    seen = tracer.cast(origin, ray[None])
    return (int(seen.face[0]), seen.at[0]) if len(seen.face) else None


def primitives_in_box(
    mesh: Mesh, labels: IntArray, tracer: Tracer, camera: Camera, low: FloatArray, high: FloatArray
) -> list[int]:
    """Primitives that are seen in a box on the screen and lie in it (nearly) whole.

    Args:
        mesh: as posed. labels: (F,) of its faces. low, high: corners of the box, 0..1.
    """
    steps = (np.arange(PICK.rays) + 0.5) / PICK.rays
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    seen = tracer.cast(camera.position, camera.rays(low + grid * (high - low)))
    if not len(seen.face):
        return []
    middles = camera.screen(mesh.vertices[mesh.faces].mean(axis=1))
    inside = np.all((middles >= low) & (middles <= high), axis=1)
    held = np.bincount(labels, inside, minlength=labels.max() + 1) / np.maximum(
        np.bincount(labels), 1
    )
    return [int(p) for p in np.unique(labels[seen.face]) if held[p] >= PICK.inside]


def faces_in_box(
    mesh: Mesh, tracer: Tracer, camera: Camera, low: FloatArray, high: FloatArray
) -> IntArray:
    """Faces whose middle lies in a box on the screen, and is seen there.

    Args:
        mesh: as posed. low, high: corners of the box, 0..1.
    """
    middles = mesh.vertices[mesh.faces].mean(axis=1)
    at = camera.screen(middles)
    inside = np.flatnonzero(np.all((at >= low) & (at <= high), axis=1))
    if not len(inside):
        return inside
    away = middles[inside] - camera.position
    far = np.linalg.norm(away, axis=1)
    eyes = np.broadcast_to(camera.position, away.shape)
    free = tracer.distance(eyes, away)  # 1 at the face itself; a twin turned away lies as near
    return inside[(free - 1) * far > -1e-4 * mesh.diagonal]


def area_around(mesh: Mesh, own: IntArray, face: int) -> IntArray:
    """Faces of a piece that are joined to one of them without a sharp edge between.

    Args:
        mesh: at rest. own: faces of the piece, `face` among them.
    """
    triangles = mesh.vertices[mesh.faces[own]]
    corners = np.unique(
        np.round(triangles.reshape(-1, 3) / (1e-5 * mesh.diagonal)).astype(np.int64),
        axis=0, return_inverse=True,
    )[1].reshape(-1, 3)  # fmt: skip
    sides = np.sort(corners[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    owner = np.repeat(np.arange(len(own)), 3)
    order = np.lexsort(sides.T)
    sides, owner = sides[order], owner[order]
    normal = face_geometry(mesh.vertices, mesh.faces[own])[0]
    links = []
    for step in (1, 2, 3):  # an edge of a double-sided surface has four faces
        both = np.all(sides[step:] == sides[:-step], axis=1)
        a, b = owner[step:][both], owner[:-step][both]
        flat = np.abs(np.einsum("ij,ij->i", normal[a], normal[b])) > np.cos(PICK.crease)
        links.append(np.stack([a[flat], b[flat]], axis=1))
    joined = trimesh.graph.connected_component_labels(
        np.concatenate(links), node_count=len(own)
    )  # fmt: skip
    return own[joined == joined[np.searchsorted(own, face)]]


def faces_near(mesh: Mesh, own: IntArray, face: int, at: FloatArray, radius: float) -> IntArray:
    """Faces of a piece whose middle is within a radius of a point on one of them, and that one.

    Args:
        mesh: at rest. own: faces of the piece. at: (3,), metres.
    """
    middles = mesh.vertices[mesh.faces[own]].mean(axis=1)
    near = np.linalg.norm(middles - at, axis=1) <= radius
    return own[near | (own == face)]


@dataclass(frozen=True)
class Snap:
    """A line that an axis may snap to: unit direction, a point on it, and what it is."""

    axis: FloatArray
    origin: FloatArray
    what: str


def snaps(mesh: Mesh, faces: IntArray) -> list[Snap]:
    """Lines of a part's surface: sharp edges, normals of its large flats, circles of its rims.

    Args:
        mesh: at rest. faces: of the part.
    """
    part = _welded(mesh, faces)
    lines = mesh_lines(mesh, np.where(np.isin(np.arange(len(mesh.faces)), faces), 0, -1))
    out = [
        Snap(axis, origin, "circle" if is_round else "edge")
        for axis, origin, is_round in zip(lines.axis, lines.origin, lines.round)
    ]
    for facet, normal, area in zip(part.facets, part.facets_normal, part.facets_area):
        if area > 0.02 * part.area:
            middle = part.triangles_center[facet].mean(axis=0)
            out.append(Snap(np.asarray(normal), middle, "face"))
    return out


def snapped(axis: FloatArray, origin: FloatArray, choices: list[Snap], size: float) -> Snap | None:
    """The nearest line that runs nearly the same way; its direction keeps the sign of `axis`.

    Args:
        axis, origin: where the person left it. size: diagonal of the object, metres.
    """
    best, least = None, 1.0
    for choice in choices:
        cosine = float(choice.axis @ axis)
        turned = float(np.arccos(np.clip(abs(cosine), 0, 1)))
        apart = float(np.linalg.norm(np.cross(origin - choice.origin, choice.axis)))
        far = max(turned / PICK.turned, apart / (PICK.near * size))
        if far < least:
            best = Snap(choice.axis * np.sign(cosine or 1.0), choice.origin, choice.what)
            least = far
    return best


def _welded(mesh: Mesh, faces: IntArray) -> trimesh.Trimesh:
    """Some faces as a mesh of their own, equal corners as one."""
    part = trimesh.Trimesh(mesh.vertices, mesh.faces[faces], process=False)
    part.merge_vertices(merge_tex=True, merge_norm=True)
    part.remove_unreferenced_vertices()
    return part


def seen_spots(mesh: Mesh, labels: IntArray) -> dict[int, FloatArray]:
    """(3,) a point just before the surface of every label that is seen from somewhere outside.

    Args:
        labels: (F,) of the faces.
    """
    tracer, size = Tracer(mesh.vertices, mesh.faces), mesh.diagonal
    middle = mesh.bounds.mean(axis=0)
    steps = np.linspace(0, 1, PICK.rays)
    grid = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    faces: list[IntArray] = []
    for azimuth in np.radians(np.arange(0, 360, 45)):
        for elevation in np.radians((-35.0, 10.0, 50.0)):
            level = np.cos(elevation) * np.array([np.cos(azimuth), np.sin(azimuth)])
            ahead = np.array([*level, np.sin(elevation)])
            right = np.cross(ahead, (0, 0, 1.0)) / np.cos(elevation)
            turn = np.stack([right, np.cross(ahead, right), ahead], axis=1)
            camera = Camera(middle - 2 * size * ahead, turn, 0.55, 1.0)
            faces.append(tracer.cast(camera.position, camera.rays(grid)).face)
    seen = np.unique(np.concatenate(faces))
    normals = face_geometry(mesh.vertices, mesh.faces[seen])[0]
    middles = mesh.vertices[mesh.faces[seen]].mean(axis=1)
    out: dict[int, FloatArray] = {}
    for label in np.unique(labels[seen]):
        own = np.flatnonzero(labels[seen] == label)
        apart = np.linalg.norm(middles[own] - middles[own].mean(axis=0), axis=1)
        k = own[np.argmin(apart)]
        outwards = np.sign(normals[k] @ (middles[k] - middle)) or 1.0
        out[int(label)] = middles[k] + PICK.lift * size * outwards * normals[k]
    return out
