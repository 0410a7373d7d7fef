"""Fusing any mesh, however broken, into one watertight outer surface without an interior.

It makes what an image-to-3D generator or a scanner would give of the same object, so that both
kinds of input (design.md section 8) can be trained and measured on one ground truth.
"""

from __future__ import annotations

from typing import Any

import fast_simplification
import numpy as np
import open3d as o3d
from numpy.typing import ArrayLike, NDArray
from scipy import ndimage, sparse
from skimage import measure

from mam_pipeline.errors import InputError
from mam_pipeline.types import FloatArray, IntArray, Material, Mesh

_tensor: Any = o3d.core.Tensor  # its stubs know no NumPy

SHELL = 0.8  # half thickness given to every surface, in cells: sheets need some to be closed
SEAL = 1.6  # gaps up to twice this many cells are closed, so that the interior vanishes


def fuse_mesh(
    mesh: Mesh, resolution: int = 160, noise: float = 0.0, seed: int = 0,
    faces: int | None = None,
) -> Mesh:  # fmt: skip
    """The outer boundary of `mesh` as one closed surface with vertex colours.

    The unsigned distance is sampled around the surface on a regular grid; what cannot be reached
    from outside through openings wider than 2 * SEAL cells counts as solid; marching cubes takes
    the surface SHELL cells away from the input.

    Args:
        mesh: any triangles: double-sided, open, intersecting, without thickness.
        resolution: cells along the longest side of the bounding box.
        noise: standard deviation of a smooth displacement along the normals, as a share of the
            bounding-box diagonal.
        seed: of the noise.
        faces: reduce to about this many faces (quadric edge collapse); None keeps all.

    Raises:
        InputError: the mesh has no extent.
    """
    low, high = mesh.bounds
    pitch = float((high - low).max()) / resolution
    if not np.isfinite(pitch) or pitch <= 0:
        raise InputError("a mesh without extent cannot be fused")
    field, origin = _solid_field(mesh, low, high, pitch)
    vertices, triangles, _, _ = measure.marching_cubes(field.astype(np.float32), 0.0)
    vertices = vertices.astype(np.float64) * pitch + origin
    triangles = triangles[:, ::-1].astype(np.int64)  # outward for a field positive outside
    if enclosed_volume(vertices, triangles) < 0:
        triangles = triangles[:, ::-1]
    if faces is not None and len(triangles) > faces:
        vertices, triangles = _decimated(vertices, triangles, faces)
    if noise > 0:
        vertices = _noisy(vertices, triangles, noise * mesh.diagonal, seed)
    fused = Mesh(vertices, triangles, (Material("fused"),))
    colors = _face_colors(mesh)[nearest_faces(mesh, vertices)]
    return Mesh(vertices, triangles, (Material("fused", (1.0, 1.0, 1.0, 1.0)),), colors=colors,
                group_names=("fused",)) if len(triangles) else fused  # fmt: skip


def nearest_faces(mesh: Mesh, target: Mesh | ArrayLike) -> IntArray:
    """(n,) face of `mesh` nearest to each point (n, 3), or to each face centre of a mesh."""
    if isinstance(target, Mesh):
        points = target.vertices[target.faces].mean(axis=1)
    else:
        points = np.asarray(target, dtype=np.float64)
    answer = _scene(mesh).compute_closest_points(_tensor(points.astype(np.float32)))
    return answer["primitive_ids"].numpy().astype(np.int64)


def _scene(mesh: Mesh) -> o3d.t.geometry.RaycastingScene:
    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(
        _tensor(mesh.vertices.astype(np.float32)),
        _tensor(mesh.faces.astype(np.uint32)),
    )
    return scene


def _solid_field(
    mesh: Mesh, low: FloatArray, high: FloatArray, pitch: float
) -> tuple[FloatArray, FloatArray]:
    """Signed field on a grid (metres, negative inside) and the position of its first point."""
    margin = 5
    origin = low - margin * pitch
    shape = tuple(np.ceil((high - low) / pitch).astype(int) + 2 * margin + 1)
    reach = SEAL + 1.8  # cells around the surface where exact distances are needed
    near = ndimage.distance_transform_edt(~_occupied(mesh, origin, shape, pitch)) <= reach
    distance = np.full(shape, (reach + 1) * pitch)
    index = np.argwhere(near)
    points = (origin + index * pitch).astype(np.float32)
    scene = _scene(mesh)
    chunks = np.array_split(points, max(1, len(points) // 400_000))
    distance[near] = np.concatenate([scene.compute_distance(_tensor(c)).numpy() for c in chunks])
    # reach in from the border through wide openings only, then follow the surface closely
    region, _ = ndimage.label(distance > SEAL * pitch)
    sealed_outside = region == region[0, 0, 0]
    free = distance > SHELL * pitch
    outside = ndimage.binary_dilation(sealed_outside, iterations=3, mask=free)
    field = distance - SHELL * pitch
    field[~outside & (field > 0)] = -SHELL * pitch
    return field, origin


def _occupied(mesh: Mesh, origin: FloatArray, shape: tuple[int, ...], pitch: float) -> IntArray:
    """Boolean grid of the cells next to surface samples no more than half a cell apart."""
    grid = np.zeros(shape, dtype=bool)
    t = mesh.vertices[mesh.faces]
    longest = np.linalg.norm(t - np.roll(t, 1, axis=1), axis=2).max(axis=1)
    steps = np.clip(np.ceil(longest / (0.7 * pitch)), 1, None).astype(int)
    for n in np.unique(steps):
        group = t[steps == n]
        i, j = np.meshgrid(np.arange(n + 1), np.arange(n + 1), indexing="ij")
        u, v = (i[i + j <= n] / n)[:, None], (j[i + j <= n] / n)[:, None]
        for a, b, c in _blocks(group, len(u)):
            points = a[:, None] + u * (b - a)[:, None] + v * (c - a)[:, None]
            cells = np.round((points.reshape(-1, 3) - origin) / pitch).astype(int)
            grid[tuple(cells.T)] = True
    return grid


def _blocks(triangles: FloatArray, samples: int) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """Triangles in blocks of at most about two million samples."""
    size = max(1, 2_000_000 // samples)
    cut = [triangles[k : k + size] for k in range(0, len(triangles), size)]
    return [(t[:, 0], t[:, 1], t[:, 2]) for t in cut]


def enclosed_volume(vertices: FloatArray, faces: IntArray) -> float:
    """What a closed surface encloses; below 0 where it is inside out."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->", a, np.cross(b, c))) / 6


def _decimated(vertices: FloatArray, faces: IntArray, target: int) -> tuple[FloatArray, IntArray]:
    small, triangles = fast_simplification.simplify(
        vertices.astype(np.float32), faces.astype(np.int32), target_count=target
    )
    return np.asarray(small, dtype=np.float64), np.asarray(triangles, dtype=np.int64)


def _noisy(vertices: FloatArray, faces: IntArray, sigma: float, seed: int) -> FloatArray:
    """Vertices displaced along their normals by noise smoothed over two rings."""
    n = len(vertices)
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    link = sparse.coo_matrix(
        (np.ones(len(edges)), (edges[:, 0], edges[:, 1])), shape=(n, n)
    ).tocsr()
    degree = np.maximum(np.asarray(link.sum(axis=1)).reshape(-1), 1)
    height = np.random.default_rng(seed).standard_normal(n)
    for _ in range(2):
        height = 0.5 * height + 0.5 * (link @ height) / degree
    t = vertices[faces]
    face_normal = np.cross(t[:, 1] - t[:, 0], t[:, 2] - t[:, 0])
    normal = np.zeros_like(vertices)
    for k in range(3):
        np.add.at(normal, faces[:, k], face_normal)
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    return vertices + normal * (height / max(float(height.std()), 1e-12) * sigma)[:, None]


def _face_colors(mesh: Mesh) -> NDArray[np.uint8]:
    """(F, 4) uint8 colour of every face: its vertices' colours or its material's mean colour."""
    if mesh.colors is not None:
        return mesh.colors[mesh.faces].mean(axis=1).astype(np.uint8)
    assert mesh.face_material is not None
    table = np.array([_mean_color(m) for m in mesh.materials])
    return table[mesh.face_material]


def _mean_color(material: Material) -> NDArray[np.uint8]:
    color = np.asarray(material.base_color, dtype=float)
    if material.image is not None:
        from io import BytesIO

        from PIL import Image

        with Image.open(BytesIO(material.image)) as picture:
            pixels = np.asarray(picture.convert("RGB").resize((16, 16)), dtype=float)
        color = color * [*(pixels.reshape(-1, 3).mean(axis=0) / 255), 1.0]
    return np.clip(color * 255, 0, 255).astype(np.uint8)
