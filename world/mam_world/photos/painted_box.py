"""Boxes painted into a picture in perspective: each face a flat texture before a pinhole camera."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from mam_pipeline.photo.camera import CORNERS, FACES, NORMALS, Camera
from mam_world.photos.surface_texture import Texture

Picture = NDArray[np.float32]
Array = NDArray[np.float64]
NEAREST = 0.12  # of the focal length: nothing nearer to the camera is painted
BITS = 4  # of a pixel, in OpenCV's polygons
TEXTURE = (12, 560)  # least and most pixels of a texture's side


@dataclass(frozen=True)
class PaintedBox:
    """A box in the asset frame and what its faces look like.

    Attributes:
        low, high: (3,) corners before it is turned.
        texture: of every face that `pictures` does not name.
        pictures: face to its picture, its sides as seen from outside.
        shades: face to the light that falls on it.
        turn: (4, 4) that moves it from where it stands.
    """

    low: Array
    high: Array
    texture: Texture
    pictures: Mapping[str, Picture] = field(default_factory=dict)
    shades: Mapping[str, float] = field(default_factory=dict)
    turn: Array | None = None

    @property
    def corners(self) -> Array:
        """(8, 3) in the order of camera.CORNERS."""
        middle, half = (self.low + self.high) / 2, (self.high - self.low) / 2
        points = CORNERS * half + middle
        if self.turn is None:
            return points
        return np.asarray(points @ self.turn[:3, :3].T + self.turn[:3, 3])

    def seen(self, camera: Camera) -> list[str]:
        """Faces that look at the camera."""
        eye = -camera.rotation.T @ camera.translation
        corners = self.corners
        out = []
        for name, normal in NORMALS.items():
            n = np.array(normal) if self.turn is None else self.turn[:3, :3] @ np.array(normal)
            if n @ (eye - corners[FACES[name][0]]) > 0:
                out.append(name)
        return out


def paint_box(
    picture: Picture, camera: Camera, box: PaintedBox, rng: np.random.Generator
) -> NDArray[np.bool_] | None:
    """Paint a box over a picture (h, w, 3); where it covers it, None where it is not in view."""
    corners = box.corners
    depth = corners @ camera.rotation[2] + camera.translation[2]
    if depth.min() < NEAREST:
        return None
    pixels = camera.project(corners)
    covered = np.zeros(picture.shape[:2], np.bool_)
    for face in box.seen(camera):
        quad = pixels[list(FACES[face])]
        sides = np.linalg.norm(np.roll(quad, -1, axis=0) - quad, axis=1)
        w, h = (int(np.clip(max(sides[i], sides[i + 2]), *TEXTURE)) for i in (0, 1))
        drawn = box.pictures.get(face)
        flat = box.texture.draw(rng, h, w) if drawn is None else _sized(drawn, w, h)
        covered |= paint_quad(picture, quad, flat * box.shades.get(face, 1.0))
    return covered


def _sized(picture: Picture, w: int, h: int) -> Picture:
    return np.asarray(cv2.resize(picture, (w, h), interpolation=cv2.INTER_AREA), np.float32)


def paint_quad(picture: Picture, quad: Array, flat: Picture) -> NDArray[np.bool_]:
    """Lay a flat picture on a quad (4, 2) TL, TR, BR, BL of another; where it lies."""
    h, w = picture.shape[:2]
    low = np.maximum(np.floor(quad.min(axis=0)).astype(int) - 1, 0)
    high = np.minimum(np.ceil(quad.max(axis=0)).astype(int) + 2, [w, h])
    out = np.zeros((h, w), np.bool_)
    if (high - low < 2).any():
        return out
    local = (quad - low).astype(np.float32)
    source = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32) * [flat.shape[1], flat.shape[0]]
    matrix = cv2.getPerspectiveTransform(source.astype(np.float32), local)
    size = (int(high[0] - low[0]), int(high[1] - low[1]))
    laid = cv2.warpPerspective(flat, matrix, size, flags=cv2.INTER_LINEAR,
                               borderMode=cv2.BORDER_REPLICATE)  # fmt: skip
    cover = np.zeros(size[::-1], np.uint8)
    points = np.clip(local * 2**BITS, -(2**28), 2**28).astype(np.int32)
    cv2.fillConvexPoly(cover, points, 255, cv2.LINE_AA, BITS)
    share = (cover / np.float32(255.0))[..., None]
    part = picture[low[1] : high[1], low[0] : high[0]]
    part += share * (laid.reshape(*size[::-1], 3) - part)
    out[low[1] : high[1], low[0] : high[0]] = cover > 127
    return out
