"""Painting what the cameras saw: pieces in distinct colours, tags that cover nothing, sheets.

A tag never hides what it names: on a piece too small for it, it stands beside, on background where
there is any, tied to the piece by a line that ends in a dot.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from mam_pipeline.render.orbit_views import View
from mam_pipeline.types import FloatArray, IntArray, Mesh

Picture = NDArray[np.uint8]
Box = tuple[float, float, float, float]
SPECKLE = 0.4  # share of outline pixels around one above which they are no outline
SMALLEST = 12  # pixels below which a piece gets no tag in a view
AXES = (("x", (200, 30, 30)), ("y", (20, 140, 40)), ("z", (30, 60, 220)))


def paint(
    view: View,
    labels: IntArray,
    colors: Picture,
    tags: Sequence[int] = (),
    ghost: NDArray[np.bool_] | None = None,
) -> Picture:
    """Shaded picture with one colour per label and a numbered tag on each label of `tags`.

    Args:
        labels: (F,) of the mesh's faces. colors: (labels, 3).
        ghost: (H, W) outlines of what is left out, drawn in grey.
    """
    ids = view.ids(labels)
    flat = colors[np.maximum(ids, 0)].astype(np.float64)
    flat *= 0.55 + 0.45 * view.shade[..., None]
    flat[_outline(ids) | view.edges] *= 0.35
    out = np.where(ids[..., None] >= 0, flat, 255.0)
    if ghost is not None:
        out[ghost & (ids < 0)] = 200.0
    image = Image.fromarray(out.astype(np.uint8))
    draw = ImageDraw.Draw(image)
    draw_axes(draw, view, len(ids))
    font = ImageFont.load_default(size=max(11, len(ids) // 32))
    side = 0.16 * len(ids)
    taken: list[Box] = [(0.0, len(ids) - side, side, float(len(ids)))]  # the axes stay free
    size = np.bincount(ids[ids >= 0], minlength=max(tags, default=0) + 1)
    for tag in sorted(tags, key=lambda t: -int(size[t])):
        spot = roomiest(ids == tag) if size[tag] >= SMALLEST else None
        if spot is not None:
            place(draw, font, str(tag), spot, taken, ids)
    return np.asarray(image)


def lit(view: View, face_colors: FloatArray) -> Picture:
    """The object as it is, on white; `face_colors` (F, 3) 0..255."""
    color = face_colors[np.maximum(view.faces, 0)] * (0.5 + 0.5 * view.shade[..., None])
    return np.where(view.faces[..., None] >= 0, color, 255.0).astype(np.uint8)


def plain(view: View, face_colors: FloatArray) -> Picture:
    """Like `lit`, with outlines and the axes."""
    out = lit(view, face_colors)
    out[view.edges] = (out[view.edges] * 0.3).astype(np.uint8)
    image = Image.fromarray(out)
    draw_axes(ImageDraw.Draw(image), view, len(out))
    return np.asarray(image)


def own_colors(mesh: Mesh) -> FloatArray:
    """(F, 3) 0..255: the materials' colours, without their textures."""
    assert mesh.face_material is not None
    table = np.array([m.base_color[:3] for m in mesh.materials])
    return 255.0 * table[mesh.face_material]


def exploded(mesh: Mesh, labels: IntArray, pull: float = 0.9) -> Mesh:
    """The mesh with every label moved away from the middle; faces keep their order."""
    corners = mesh.vertices[mesh.faces]
    middle = mesh.bounds.mean(axis=0)
    shift = np.zeros((int(labels.max()) + 1, 3))
    for label in np.unique(labels):
        own = corners[labels == label].reshape(-1, 3)
        shift[label] = pull * ((own.min(axis=0) + own.max(axis=0)) / 2 - middle)
    moved = corners + shift[labels][:, None, :]
    count = 3 * len(mesh.faces)
    faces = np.arange(count).reshape(-1, 3)
    return replace(mesh, vertices=moved.reshape(-1, 3), faces=faces, uv=None, colors=None)


def caption(draw: ImageDraw.ImageDraw, text: str, size: int) -> None:
    """A few words in the upper left corner of a picture of `size` pixels."""
    font = ImageFont.load_default(size=max(11, size // 26))
    box = draw.textbbox((4, 3), text, font=font)
    draw.rectangle((box[0] - 3, box[1] - 2, box[2] + 3, box[3] + 2), fill=(255, 255, 255))
    draw.text((4, 3), text, fill=(0, 0, 0), font=font)


def named(picture: Picture, text: str) -> Picture:
    """A picture with its name in the upper left corner."""
    image = Image.fromarray(picture)
    caption(ImageDraw.Draw(image), text, len(picture))
    return np.asarray(image)


def draw_axes(draw: ImageDraw.ImageDraw, view: View, size: int) -> None:
    """A small cross of the x, y and z directions in the lower left corner."""
    origin = np.array([0.075 * size, size - 0.075 * size])
    font = ImageFont.load_default(size=max(9, size // 42))
    for column, (name, color) in enumerate(AXES):
        along = view.camera_T_asset[:2, column] * 0.05 * size
        tip = origin + along
        draw.line([tuple(origin), tuple(tip)], fill=color, width=2)
        if np.linalg.norm(along) > 0.012 * size:
            at = origin + along * 1.3
            draw.text((float(at[0]), float(at[1])), name, fill=color, font=font, anchor="mm")


def roomiest(mask: NDArray[np.bool_]) -> tuple[int, int, float] | None:
    """(x, y, room) of the pixel farthest from the mask's border; None for a handful of pixels."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if not len(rows):
        return None
    own = mask[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    if int(own.sum()) < SMALLEST:
        return None
    padded = np.pad(own.astype(np.uint8), 1)
    room = cv2.distanceTransform(padded, cv2.DIST_L2, 3)[1:-1, 1:-1]
    y, x = np.unravel_index(int(room.argmax()), room.shape)
    return int(x + columns[0]), int(y + rows[0]), float(room[y, x])


def place(
    draw: ImageDraw.ImageDraw,
    font: ImageFont.FreeTypeFont | ImageFont.ImageFont,
    text: str,
    spot: tuple[int, int, float],
    taken: list[Box],
    ids: IntArray,
) -> None:
    """Draw one tag and add its box to `taken`; nothing is drawn where all room is taken.

    Args:
        spot: (x, y, room) of the piece. ids: (H, W) labels, -1 background: tags that stand aside
            prefer background.
    """
    left, top, right, bottom = draw.textbbox((0, 0), text, font=font)
    w, h = right - left + 6, bottom - top + 6
    x, y, room = spot
    start = 0 if room > 0.75 * max(w, h) else int(max(w, h) / 2 + room + 6)
    for radius in range(start, start + 240, 12):
        best: tuple[float, Box] | None = None
        for angle in np.linspace(0, 2 * np.pi, 1 if radius == 0 else 16, endpoint=False):
            cx, cy = x + radius * np.cos(angle), y + radius * np.sin(angle)
            box = (cx - w / 2, cy - h / 2, cx + w / 2, cy + h / 2)
            inside = min(box) >= 0 and box[2] < ids.shape[1] and box[3] < ids.shape[0]
            if not inside or any(overlap(box, other) for other in taken):
                continue
            under = ids[int(box[1]) : int(box[3]) + 1, int(box[0]) : int(box[2]) + 1]
            covered = float((under >= 0).mean())
            if best is None or covered < best[0]:
                best = covered, box
        if best is not None:
            _tag(draw, font, text, best[1], (x, y) if radius else None)
            taken.append(best[1])
            return


def overlap(a: Box, b: Box) -> bool:
    """Whether two boxes (left, top, right, bottom) share room."""
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]


def distinct_colors(count: int) -> Picture:
    """(count, 3) RGB colours, each as far as can be from those before it, the same on every run."""
    return np.resize(_palette(), (max(count, 1), 3))


@cache
def _palette(count: int = 128) -> Picture:
    """Farthest-point selection in Lab among saturated colours that are neither dark nor grey."""
    levels = np.arange(15, 256, 20, dtype=np.uint8)
    grid = np.stack(np.meshgrid(levels, levels, levels), axis=-1).reshape(-1, 3)
    lab = cv2.cvtColor(grid[None].astype(np.float32) / 255.0, cv2.COLOR_RGB2LAB)[0]
    keep = (np.ptp(grid.astype(int), axis=1) > 70) & (lab[:, 0] > 46) & (lab[:, 0] < 88)
    grid, lab = grid[keep], lab[keep]
    chosen = [int(np.linalg.norm(grid - np.array([215, 60, 60]), axis=1).argmin())]
    nearest = np.full(len(grid), np.inf)
    while len(chosen) < count:
        nearest = np.minimum(nearest, np.linalg.norm(lab - lab[chosen[-1]], axis=1))
        chosen.append(int(nearest.argmax()))
    return grid[chosen]


def sheet(pictures: Sequence[Picture], columns: int, limit: int = 2048) -> Picture:
    """One picture of many, in rows; scaled down to at most `limit` pixels a side."""
    h = max(p.shape[0] for p in pictures)
    w = max(p.shape[1] for p in pictures)
    rows = -(-len(pictures) // columns)
    out = np.full((rows * h, columns * w, 3), 255, dtype=np.uint8)
    for i, picture in enumerate(pictures):
        r, c = divmod(i, columns)
        out[r * h : r * h + len(picture), c * w : c * w + picture.shape[1]] = picture
    scale = limit / max(out.shape[:2])
    if scale < 1:
        return np.asarray(
            cv2.resize(out, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA), dtype=np.uint8
        )
    return out


def png(picture: Picture) -> bytes:
    """PNG bytes of a picture."""
    buffer = io.BytesIO()
    Image.fromarray(picture).save(buffer, format="PNG")
    return buffer.getvalue()


def _tag(
    draw: ImageDraw.ImageDraw,
    font: ImageFont.FreeTypeFont | ImageFont.ImageFont,
    text: str,
    box: Box,
    tied_to: tuple[int, int] | None,
) -> None:
    if tied_to is not None:
        x, y = tied_to
        draw.line([(x, y), ((box[0] + box[2]) / 2, (box[1] + box[3]) / 2)], fill=(0, 0, 0))
        draw.ellipse((x - 2, y - 2, x + 2, y + 2), fill=(0, 0, 0))
    draw.rectangle(box, fill=(255, 255, 255), outline=(0, 0, 0))
    left, top, _, _ = draw.textbbox((0, 0), text, font=font)
    draw.text((box[0] + 3 - left, box[1] + 3 - top), text, fill=(0, 0, 0), font=font)


def _outline(ids: IntArray) -> NDArray[np.bool_]:
    """Pixels whose right or lower neighbour has another label.

    Where faces of two pieces coincide the visible one changes from pixel to pixel; such speckle is
    no outline.
    """
    out = np.zeros(ids.shape, dtype=bool)
    out[:-1] |= ids[:-1] != ids[1:]
    out[:, :-1] |= ids[:, :-1] != ids[:, 1:]
    crowd = cv2.blur(out.astype(np.float32), (7, 7))
    return out & (ids >= 0) & (crowd < SPECKLE)
