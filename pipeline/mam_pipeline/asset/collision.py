"""Convex collision pieces of links: boxes, cylinders and plates where a piece is one, else hulls.

No piece may fill space in which another part moves: pieces are cut where the link's own surface
leaves them empty, and what still holds a moving part's path is taken away. Surface that is left
bare gets plates, and pieces of unconnected links are kept apart.
"""

from __future__ import annotations

import numpy as np
import open3d as o3d
from numpy.typing import NDArray
from scipy.cluster.hierarchy import fcluster, linkage

from mam_pipeline.asset.clearance import keep_apart
from mam_pipeline.asset.decompose import decompose, merge
from mam_pipeline.asset.patches import plates
from mam_pipeline.asset.shapes import box_shape, shape_around
from mam_pipeline.geometry.boxes import Box, minimal_box
from mam_pipeline.geometry.raycast import RayScene
from mam_pipeline.geometry.sampling import sample_surface
from mam_pipeline.geometry.surface import Component, Solid, link_components, weld
from mam_pipeline.types import Articulation, CollisionShape, FloatArray, IntArray, joint_motion

MAX_PIECES = 32
TOLERANCE = 0.006
"""How far a piece may reach beyond its surface, as a share of the diagonal."""
MARGIN = 0.001
"""Pieces of moving links are this much smaller, as a share of the diagonal: parts that touch at
rest must not jam."""
_MAX_FACES = 4000
_BARE = 0.008
"""Surface farther than this from every piece gets a plate, as a share of the diagonal."""
_SAMPLES = 2000


def collision_shapes(
    articulation: Articulation,
    max_pieces: int = MAX_PIECES,
    skip: frozenset[str] = frozenset(),
) -> dict[str, list[CollisionShape]]:
    """Collision pieces of every link, by link name, asset frame at rest.

    Args:
        articulation: in the asset frame.
        max_pieces: the most pieces for one link.
        skip: names of links to leave out.
    """
    paths = _moving_paths(articulation)
    out = {}
    for i, link in enumerate(articulation.links):
        if link.name in skip:
            continue
        moving = articulation.joint_of(i) is not None
        out[link.name] = _link_shapes(articulation, i, paths[i], moving, max_pieces)
    return {**out, **keep_apart(articulation, out)} if out else out


def _link_shapes(
    articulation: Articulation,
    index: int,
    path: FloatArray,
    moving: bool,
    max_pieces: int,
) -> list[CollisionShape]:
    parts = link_components(articulation, index)
    if not parts:
        return []
    diagonal = articulation.mesh.diagonal
    space = _Space(parts, TOLERANCE * diagonal, diagonal, path)
    soups = _first_soups(parts, max(max_pieces // 2, 1), diagonal)
    chunks = decompose(soups, space.empty, max_pieces)
    margin = MARGIN * diagonal if moving else 0.0
    shapes = []
    for chunk in merge(chunks, space.tolerance):
        shape = shape_around(chunk, margin)
        if not _holds(shape, path, space):
            shapes.append(shape)
    shapes = _with_plates(parts, shapes, path, space, margin, max_pieces)
    # a link without any piece would fall through the world: better a bold hull than none
    return shapes or [shape_around(max(chunks, key=lambda c: c.volume), margin)]


def _with_plates(
    parts: list[Component],
    shapes: list[CollisionShape],
    path: FloatArray,
    space: _Space,
    margin: float,
    most: int,
) -> list[CollisionShape]:
    """Pieces, and plates over the surface that they leave bare; those `most` that cover most."""
    sizes = np.cumsum([0] + [len(p.vertices) for p in parts[:-1]])
    faces = np.concatenate([p.faces + o for p, o in zip(parts, sizes)])
    vertices = np.concatenate([p.vertices for p in parts])
    found = sample_surface(vertices, faces, _SAMPLES, 7)
    near = [outside(s, found.points) < _BARE * space.diagonal for s in shapes]
    bare = ~np.any(near, axis=0) if near else np.ones(len(found.points), dtype=bool)
    if bare.mean() < 0.01:
        return shapes

    low, high = vertices.min(axis=0) - space.tolerance, vertices.max(axis=0) + space.tolerance

    def good(box: Box) -> bool:
        reach = np.abs(box.axes * box.half[:, None]).sum(axis=0)
        within = (box.center - reach >= low).all() and (box.center + reach <= high).all()
        return bool(within) and not _holds(box_shape(box, margin), path, space)

    boxes = plates(found.points[bare], found.normals[bare], good, space.empty, most)
    shapes = shapes + [box_shape(b, margin) for b in boxes]
    near += [outside(s, found.points) < _BARE * space.diagonal for s in shapes[len(near) :]]
    left, chosen = list(range(len(shapes))), list[int]()
    bare = np.ones(len(found.points), dtype=bool)
    while left and len(chosen) < most:
        chosen.append(left.pop(int(np.argmax([int((near[i] & bare).sum()) for i in left]))))
        bare &= ~near[chosen[-1]]
    return [shapes[i] for i in sorted(chosen)]


def outside(shape: CollisionShape, points: FloatArray) -> FloatArray:
    """(n,) distance of points (n, 3) from a piece; negative inside (not less than the truth)."""
    if shape.kind == "convex":
        scene = RayScene(shape.vertices, shape.faces)
        return scene.signed_distance(points)
    local = (points - shape.pose[:3, 3]) @ shape.pose[:3, :3]
    if shape.kind == "sphere":
        return np.asarray(np.linalg.norm(local, axis=1) - shape.size[0])
    if shape.kind == "cylinder":
        radial = np.linalg.norm(local[:, :2], axis=1) - shape.size[0]
        over = np.stack([radial, np.abs(local[:, 2]) - shape.size[1] / 2], axis=1)
    else:
        over = np.abs(local) - shape.size / 2
    far = np.linalg.norm(np.maximum(over, 0.0), axis=1)
    return np.asarray(np.where(far > 0, far, over.max(axis=1)))


class _Space:
    """Free space around one link: away from its surface and outside its closed pieces."""

    def __init__(
        self, parts: list[Component], tolerance: float, diagonal: float, path: FloatArray
    ) -> None:
        self.tolerance, self.diagonal = tolerance, diagonal
        triangles = np.concatenate([p.triangles for p in parts])
        vertices, faces, _ = weld(triangles, 1e-5 * diagonal)
        self.scene = RayScene(vertices, faces)
        self.solid = Solid(parts)
        if (
            len(path)
            and int(self.solid.contains(path[self.scene.distance(path) > tolerance]).sum()) > 8
        ):
            # something moves in there, so the open pieces are a skin and no solid
            self.solid = Solid([p for p in parts if p.closed])

    def empty(self, points: FloatArray) -> NDArray[np.bool_]:
        far = self.scene.distance(points) > self.tolerance
        where = np.flatnonzero(far)
        far[where[self.solid.contains(points[where])]] = False
        return np.asarray(far)


def _first_soups(
    parts: list[Component], most: int, diagonal: float
) -> list[tuple[FloatArray, IntArray]]:
    """Components as first pieces; when there are many, the small ones in groups of neighbours."""
    reduced = [_reduced(p) for p in parts]
    if len(parts) <= most:
        return reduced
    sizes = np.array([np.linalg.norm(p.extent) for p in parts])
    order = np.argsort(-sizes, kind="stable")
    keep = max(2 * most // 3, 1)
    out = [reduced[i] for i in order[:keep]]
    small = order[keep:]
    groups = most - keep
    if groups < 1 or len(small) <= groups:
        return out + [reduced[i] for i in small[: max(groups, 0)]]
    centres = np.array([parts[i].vertices.mean(axis=0) for i in small])
    if len(small) > 3000:
        small, centres = small[:3000], centres[:3000]
    labels = fcluster(linkage(centres, "complete"), groups, "maxclust")
    for label in np.unique(labels):
        out.append(_joined([reduced[i] for i in small[labels == label]]))
    return out


def _joined(soups: list[tuple[FloatArray, IntArray]]) -> tuple[FloatArray, IntArray]:
    offsets = np.cumsum([0] + [len(v) for v, _ in soups[:-1]])
    faces = np.concatenate([f + o for (_, f), o in zip(soups, offsets)])
    return np.concatenate([v for v, _ in soups]), faces


def _reduced(part: Component) -> tuple[FloatArray, IntArray]:
    """A component's surface with at most some thousand faces (quadric decimation)."""
    if len(part.faces) <= _MAX_FACES:
        return part.vertices, part.faces
    mesh = o3d.geometry.TriangleMesh(
        o3d.utility.Vector3dVector(part.vertices), o3d.utility.Vector3iVector(part.faces)
    )
    small = mesh.simplify_quadric_decimation(_MAX_FACES)
    return np.asarray(small.vertices), np.asarray(small.triangles, dtype=np.int64)


def _moving_paths(articulation: Articulation) -> list[FloatArray]:
    """Per link, (n, 3) points that parts moving against it pass, in that link's rest frame."""
    mesh = articulation.mesh
    paths: list[list[FloatArray]] = [[] for _ in articulation.links]
    for joint in articulation.joints:
        carried = articulation.carried_links(joint)
        faces = np.concatenate([articulation.links[i].faces for i in carried])
        if joint.type == "fixed" or not len(faces):
            continue
        points = sample_surface(mesh.vertices, mesh.faces[faces], 400).points
        low, high = joint.lower, joint.upper
        if not np.isfinite(high - low):
            low, high = -np.pi, np.pi
        for q in np.linspace(low, high, 6):
            m = joint_motion(joint.type, joint.axis, joint.origin, float(q))
            moved = points @ m[:3, :3].T + m[:3, 3]
            for i in range(len(paths)):
                if i not in carried:
                    paths[i].append(moved)
    return [np.concatenate(p) if p else np.zeros((0, 3)) for p in paths]


def _holds(shape: CollisionShape, path: FloatArray, space: _Space) -> bool:
    """Whether a piece holds a moving part's path where its link has no matter.

    Of a sheet, in which no point is deep, what passes it counts that lies as near to its middle: a
    frame's hull is thin and closes the opening.
    """
    if not len(path):
        return False
    half, deep = _half_thickness(shape), space.tolerance
    if half < space.tolerance:
        deep = half - space.tolerance
    local = (path - shape.pose[:3, 3]) @ shape.pose[:3, :3]
    if shape.kind == "box":
        inside = (np.abs(local) < shape.size / 2 - deep).all(axis=1)
    elif shape.kind == "cylinder":
        radial = np.linalg.norm(local[:, :2], axis=1) < shape.size[0] - deep
        inside = radial & (np.abs(local[:, 2]) < shape.size[1] / 2 - deep)
    elif shape.kind == "sphere":
        inside = np.linalg.norm(local, axis=1) < shape.size[0] - deep
    else:
        a, b, c = (shape.vertices[shape.faces[:, k]] for k in range(3))
        normals = np.cross(b - a, c - a)
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
        offsets = np.einsum("ij,ij->i", normals, a)
        inside = (path @ normals.T - offsets < -deep).all(axis=1)
    found = path[inside]
    return bool(len(found)) and int(space.empty(found).sum()) > 8


def _half_thickness(shape: CollisionShape) -> float:
    """Half of a piece's least extent, metres."""
    if shape.kind == "box":
        return float(np.min(shape.size)) / 2
    if shape.kind == "sphere":
        return float(shape.size[0])
    if shape.kind == "cylinder":
        return float(min(shape.size[0], shape.size[1] / 2))
    return float(minimal_box(shape.vertices, 8).half.min())
