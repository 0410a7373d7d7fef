"""Pictures of meshes by Open3D's ray casting on the CPU: no display, no driver."""

from __future__ import annotations

from collections.abc import Sequence
from io import BytesIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mam_pipeline.render.tracer import Tracer, camera_rays
from mam_pipeline.types import Articulation, FloatArray, IntArray, Material, Mesh

Image = NDArray[np.uint8]
BACKGROUND = 255


def render_mesh(
    mesh: Mesh, size: tuple[int, int] = (320, 320), azimuth: float = -35.0,
    elevation: float = 25.0, face_colors: ArrayLike | None = None,
    distance: float | None = None, supersample: int = 2,
) -> Image:  # fmt: skip
    """A shaded picture of a mesh (asset frame: Z up, front towards -X).

    Args:
        size: width, height in pixels.
        azimuth: degrees from the front, towards the viewer's right; 0 looks along +X.
        elevation: degrees above the horizon.
        face_colors: (F, 3) uint8 colours instead of the mesh's materials and textures.
        distance: from the middle of the bounding box, metres; default fits the bounding sphere.
        supersample: rays along each side of a pixel.

    Returns:
        (H, W, 3) uint8 RGB, white background.
    """
    width, height = size[0] * supersample, size[1] * supersample
    low, high = mesh.bounds
    fov = np.radians(30.0)
    far = distance or 0.54 * mesh.diagonal / np.sin(fov / 2)
    eye_direction = _eye(azimuth, elevation)
    half = float(np.tan(fov / 2)) / min(width, height)
    rays = camera_rays(-eye_direction, half, width, height)
    seen = Tracer(mesh.vertices, mesh.faces).cast((low + high) / 2 + eye_direction * far, rays)
    color = _surface_color(mesh, seen.face, seen.uv, face_colors)
    picture = np.full((height * width, 3), float(BACKGROUND))
    picture[seen.hit] = color * _light(seen.normal, eye_direction)[:, None]
    blocks = picture.reshape(size[1], supersample, size[0], supersample, 3)
    return np.clip(blocks.mean(axis=(1, 3)), 0, 255).astype(np.uint8)


def posed(articulation: Articulation, q: Sequence[float] | dict[str, float]) -> Mesh:
    """The articulation's mesh at joint values q (counted from the rest pose)."""
    mesh, poses = articulation.mesh, articulation.link_poses(q)
    corners = mesh.vertices[mesh.faces]
    move = poses[articulation.face_link]
    corners = np.einsum("fij,fkj->fki", move[:, :3, :3], corners) + move[:, None, :3, 3]
    from dataclasses import replace

    return replace(
        mesh, vertices=corners.reshape(-1, 3), faces=np.arange(3 * len(mesh.faces)).reshape(-1, 3),
        uv=None if mesh.uv is None else mesh.uv[mesh.faces.reshape(-1)],
        colors=None if mesh.colors is None else mesh.colors[mesh.faces.reshape(-1)],
    )  # fmt: skip


def contact_sheet(images: Sequence[Image], columns: int, pad: int = 4) -> Image:
    """Images of one size, side by side in rows on white."""
    height, width = images[0].shape[:2]
    rows = -(-len(images) // columns)
    sheet = np.full((rows * (height + pad) + pad, columns * (width + pad) + pad, 3), 255, np.uint8)
    for k, image in enumerate(images):
        y = pad + (k // columns) * (height + pad)
        x = pad + (k % columns) * (width + pad)
        sheet[y : y + height, x : x + width] = image
    return sheet


DORMANT = (95, 95, 95)  # colour of what may move and is kept still


def palette(labels: IntArray) -> Image:
    """(F, 3) distinct colours for labels 0, 1, ...; 0 (the base) is grey."""
    hue = (np.arange(labels.max(initial=0) + 1) * 0.618034) % 1.0
    table = 255 * (0.55 + 0.4 * np.cos(2 * np.pi * (hue[:, None] + [0, 1 / 3, 2 / 3])))
    table[0] = 190
    return table.astype(np.uint8)[labels]


def _eye(azimuth: float, elevation: float) -> FloatArray:
    """Unit vector from the object to the camera."""
    a, e = np.radians(azimuth), np.radians(elevation)
    return np.array([-np.cos(a) * np.cos(e), -np.sin(a) * np.cos(e), np.sin(e)])


def _light(normal: FloatArray, eye: FloatArray) -> FloatArray:
    """Lambert with a key light from above and a head light; (n,) factors."""
    key = eye + np.array([0.2, 0.5, 1.1])
    key /= np.linalg.norm(key)
    return 0.35 + 0.45 * np.clip(normal @ key, 0, 1) + 0.25 * np.clip(normal @ eye, 0, 1)


def _surface_color(
    mesh: Mesh, face: IntArray, bary: FloatArray, face_colors: ArrayLike | None
) -> FloatArray:
    """(n, 3) colours 0..255 at hits: given, of vertices, or of materials with textures."""
    if face_colors is not None:
        return np.asarray(face_colors, dtype=float)[face]
    weights = np.stack([1 - bary.sum(axis=1), bary[:, 0], bary[:, 1]], axis=1)
    corners = mesh.faces[face]
    assert mesh.face_material is not None
    material = mesh.face_material[face]
    table = np.array([m.base_color[:3] for m in mesh.materials]) * 255
    color = table[material]
    if mesh.colors is not None:
        color = color / 255 * np.einsum("nk,nkc->nc", weights, mesh.colors[corners][..., :3])
    if mesh.uv is not None:
        uv = np.einsum("nk,nkc->nc", weights, mesh.uv[corners].astype(float))
        for index in np.unique(material):
            pixels = _pixels(mesh.materials[index])
            if pixels is not None:
                mask = material == index
                h, w = pixels.shape[:2]
                column = (np.floor(uv[mask, 0] * w).astype(int)) % w
                row = (np.floor(uv[mask, 1] * h).astype(int)) % h
                color[mask] = color[mask] / 255 * pixels[row, column]
    return color


def _pixels(material: Material) -> FloatArray | None:
    if material.image is None:
        return None
    from PIL import Image as Pillow

    with Pillow.open(BytesIO(material.image)) as picture:
        return np.asarray(picture.convert("RGB"), dtype=float)
