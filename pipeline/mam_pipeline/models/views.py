"""Pictures of primitives from all sides, cast on the CPU: identity maps, tags, contact sheets."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from mam_pipeline.geometry.raycast import RayScene
from mam_pipeline.types import FloatArray, IntArray, Mesh

Picture = NDArray[np.uint8]
FOV = np.radians(35.0)
AROUND = ((-35, 20), (35, 20), (-90, 8), (90, 8), (0, 8), (145, 25), (-145, 25), (-30, 65))


@dataclass(frozen=True)
class View:
    """One camera and what it sees.

    Attributes:
        azimuth, elevation: degrees; azimuth 0 looks at the object's front (from -X).
        camera_T_asset: (4, 4), OpenCV axes.
        faces: (H, W) index of the visible face, -1 background.
        shade: (H, W) 0..1, cosine to the camera.
    """

    azimuth: float
    elevation: float
    camera_T_asset: FloatArray
    faces: IntArray
    shade: FloatArray

    def ids(self, labels: IntArray) -> IntArray:
        """(H, W) label of the visible face, -1 background."""
        return np.where(self.faces >= 0, labels[np.maximum(self.faces, 0)], -1)


def look(
    mesh: Mesh,
    directions: Sequence[tuple[float, float]] = AROUND,
    size: int = 512,
    distance: float | None = None,
    fov: float = FOV,
) -> list[View]:
    """Cast one view per (azimuth, elevation) in degrees; the whole object is in the picture.

    Args:
        distance: of the camera from the box centre in diagonals; default: as near as fits.
    """
    scene = RayScene(mesh.vertices, mesh.faces)
    centre, diagonal = mesh.bounds.mean(axis=0), mesh.diagonal
    away = diagonal * (0.52 / np.tan(fov / 2) + 0.1 if distance is None else distance)
    half = np.tan(fov / 2)
    grid = (np.arange(size) + 0.5) / size * 2 - 1
    x, y = np.meshgrid(grid * half, grid * half)
    rays = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    out = []
    for azimuth, elevation in directions:
        pose = camera_pose(centre, away, azimuth, elevation)
        directions_world = rays @ pose[:3, :3]
        eye = -pose[:3, :3].T @ pose[:3, 3]
        hits = scene.first_hits(np.broadcast_to(eye, rays.shape), directions_world)
        shade = np.abs(np.einsum("ij,ij->i", hits.normals, directions_world))
        shape = (size, size)
        out.append(View(azimuth, elevation, pose, hits.faces.reshape(shape), shade.reshape(shape)))
    return out


def camera_pose(target: FloatArray, away: float, azimuth: float, elevation: float) -> FloatArray:
    """`camera_T_asset` (4, 4), OpenCV axes, of a camera that looks at `target` from `away` m."""
    a, e = np.radians(azimuth), np.radians(elevation)
    back = np.array([-np.cos(e) * np.cos(a), -np.cos(e) * np.sin(a), np.sin(e)])
    forward = -back
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    out = np.eye(4)
    out[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    out[:3, 3] = -out[:3, :3] @ (target + back * away)
    return out


def paint(view: View, labels: IntArray, colors: Picture, tags: Sequence[int] = ()) -> Picture:
    """Shaded picture with one colour per label and a numbered tag on each label of `tags`.

    Tags sit where a label has most room around it; one that would cover another is moved aside
    and tied to its place with a line.
    """
    ids = view.ids(labels)
    flat = colors[np.maximum(ids, 0)].astype(np.float64)
    lit = flat * (0.45 + 0.55 * view.shade[..., None])
    image = Image.fromarray(np.where(ids[..., None] >= 0, lit, 255).astype(np.uint8))
    draw = ImageDraw.Draw(image)
    font = ImageFont.load_default(size=max(11, len(ids) // 36))
    taken: list[tuple[float, float, float, float]] = []
    for tag in tags:
        spot = roomiest(ids == tag)
        if spot is not None:
            _place(draw, font, str(tag), spot, taken, image.size)
    return np.asarray(image)


def roomiest(mask: NDArray[np.bool_]) -> tuple[int, int] | None:
    """(x, y) of the pixel farthest from the mask's border; None for fewer than 12 pixels."""
    if int(mask.sum()) < 12:
        return None
    padded = np.pad(mask.astype(np.uint8), 1)
    room = cv2.distanceTransform(padded, cv2.DIST_L2, 3)[1:-1, 1:-1]
    y, x = np.unravel_index(int(room.argmax()), room.shape)
    return int(x), int(y)


def _place(
    draw: ImageDraw.ImageDraw,
    font: ImageFont.FreeTypeFont | ImageFont.ImageFont,
    text: str,
    spot: tuple[int, int],
    taken: list[tuple[float, float, float, float]],
    size: tuple[int, int],
) -> None:
    left, top, right, bottom = draw.textbbox((0, 0), text, font=font)
    w, h = right - left + 6, bottom - top + 6
    for radius in range(0, 240, 12):
        for angle in np.linspace(0, 2 * np.pi, 1 if radius == 0 else 12, endpoint=False):
            cx, cy = spot[0] + radius * np.cos(angle), spot[1] + radius * np.sin(angle)
            box = (cx - w / 2, cy - h / 2, cx + w / 2, cy + h / 2)
            inside = box[0] >= 0 and box[1] >= 0 and box[2] < size[0] and box[3] < size[1]
            if not inside or any(_overlap(box, other) for other in taken):
                continue
            taken.append(box)
            if radius:
                draw.line([spot, (cx, cy)], fill=(0, 0, 0), width=1)
            draw.rectangle(box, fill=(255, 255, 255), outline=(0, 0, 0))
            draw.text((box[0] + 3 - left, box[1] + 3 - top), text, fill=(0, 0, 0), font=font)
            return


def _overlap(a: tuple[float, ...], b: tuple[float, ...]) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def distinct_colors(count: int) -> Picture:
    """(count, 3) RGB colours far from each other in hue and lightness, the same on every run."""
    import colorsys

    rows = [
        colorsys.hls_to_rgb((i * 0.61803398875) % 1, (0.45, 0.62, 0.75)[i % 3], 0.85)
        for i in range(max(count, 1))
    ]
    return (np.asarray(rows) * 255).astype(np.uint8)


def sheet(pictures: Sequence[Picture], columns: int, limit: int = 2048) -> Picture:
    """One picture of many, in rows; scaled down to at most `limit` pixels a side."""
    h, w = pictures[0].shape[:2]
    rows = -(-len(pictures) // columns)
    out = np.full((rows * h, columns * w, 3), 255, dtype=np.uint8)
    for i, picture in enumerate(pictures):
        r, c = divmod(i, columns)
        out[r * h : (r + 1) * h, c * w : (c + 1) * w] = picture
    scale = limit / max(out.shape[:2])
    if scale < 1:
        return np.asarray(
            cv2.resize(out, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), dtype=np.uint8
        )
    return out


def png(picture: Picture) -> bytes:
    """PNG bytes of a picture."""
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, format="PNG", optimize=True)
    return buffer.getvalue()
