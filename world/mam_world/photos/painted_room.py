"""Rooms for painted photos: floor, walls and what lies and hangs on them, by rays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mam_pipeline.photo.camera import Camera
from mam_world.photos.surface_texture import Texture, random_colour, random_texture

Picture = NDArray[np.float32]
Array = NDArray[np.float64]
TILE = 448  # pixels of a texture that repeats


@dataclass(frozen=True)
class Room:
    """Planes of a room in the asset frame.

    Attributes:
        floor: z of it.
        wall: x of the wall behind.
        sides: y of the walls at the left and at the right; infinite where there is none.
        studio: whether floor and wall are one sheet of paper.
    """

    floor: float
    wall: float
    sides: tuple[float, float]
    studio: bool


def random_room(
    rng: np.random.Generator, size: tuple[float, float, float], base: float, eye: Array
) -> Room:
    """A room around a body of (width, depth, height) whose front is at x = 0 and foot at z = 0.

    Args:
        base: z of the floor, 0 or less.
        eye: (3,) camera, which must stand within it.
    """
    w, d, h = size
    reach = max(w, h)
    wall = d + float(rng.choice([0.0, rng.uniform(0, 0.3), rng.uniform(0.3, 4.0)])) * reach
    walls = []
    for sign in (1, -1):
        y = w / 2 + float(rng.choice([rng.uniform(0, 0.2), rng.uniform(0.2, 3.0)])) * reach
        inside = sign * eye[1] < y - 0.05
        walls.append(sign * y if rng.random() < 0.3 and inside else sign * np.inf)
    return Room(base, wall, (float(walls[0]), float(walls[1])), bool(rng.random() < 0.22))


def paint_room(
    rng: np.random.Generator,
    camera: Camera,
    room: Room,
    size: tuple[float, float, float],
    per_unit: float,
) -> Picture:
    """(height, width, 3) of an empty room with the shadow of a body in it.

    Args:
        size: (width, depth, height) of the body.
        per_unit: pixels of a unit of length at the body.
    """
    w, _, h = size
    v, u = np.mgrid[0 : camera.height, 0 : camera.width] + 0.5
    ray = np.stack(
        [(u - camera.center[0]) / camera.focal, (v - camera.center[1]) / camera.focal,
         np.ones_like(u)], axis=-1,
    ) @ camera.rotation  # fmt: skip
    eye = -camera.rotation.T @ camera.translation
    plane = np.full(u.shape, -1)
    near = np.full(u.shape, np.inf)
    with np.errstate(divide="ignore", invalid="ignore"):
        for k, (axis, at) in enumerate(
            ((2, room.floor), (0, room.wall), (1, room.sides[0]), (1, room.sides[1]))
        ):
            if not np.isfinite(at):
                continue
            t = (at - eye[axis]) / ray[..., axis]
            closer = (t > 1e-6) & (t < near)
            near, plane = np.where(closer, t, near), np.where(closer, k, plane)
    point = eye + ray * np.where(np.isfinite(near), near, 0.0)[..., None]
    white = np.full(3, rng.uniform(0.85, 1.0), np.float32)
    tone = white if rng.random() < 0.7 else random_colour(rng)
    out = np.broadcast_to(tone, (*u.shape, 3)).copy()
    for k, axes in enumerate(((0, 1), (1, 2), (0, 2), (0, 2))):
        here = plane == k
        if not here.any():
            continue
        flat = point[here][:, axes]
        if k == 0:
            out[here] = _floor(rng, room, size, flat, per_unit, tone)
        elif not room.studio:
            wall = _wall(rng, room, flat, per_unit, size) if k == 1 else _surface(
                rng, random_texture(rng), flat, per_unit)  # fmt: skip
            out[here] = wall * float(rng.uniform(0.6, 1.1))
    if not room.studio and rng.random() < 0.7:  # the wall darkens behind the body
        spread = float(rng.uniform(0.03, 0.3)) * max(w, h)
        beside = np.clip(np.abs(point[..., 1] + rng.normal(0, 0.1) * w) - w / 2, 0, None)
        above = np.clip(point[..., 2] - h, 0, None)
        shadow = np.exp(-np.hypot(beside, above) / spread) * float(rng.uniform(0.1, 0.6))
        out *= np.where(plane == 1, 1 - shadow, 1.0)[..., None].astype(np.float32)
    return out


def _surface(rng: np.random.Generator, texture: Texture, flat: Array, per_unit: float) -> Picture:
    """(n, 3) of a texture at flat coordinates (n, 2)."""
    tile = texture.draw(rng, TILE, TILE)
    xy = (flat * per_unit * float(rng.uniform(0.6, 1.4)) % (2 * TILE - 2)).astype(np.float32)
    xy = np.where(xy > TILE - 1, 2 * TILE - 2 - xy, xy)  # mirrored, so that no seam shows
    x, y = np.round(xy).astype(int).T
    return np.asarray(tile[y, x], np.float32)


def _floor(
    rng: np.random.Generator,
    room: Room,
    size: tuple[float, float, float],
    flat: Array,
    per_unit: float,
    tone: Picture,
) -> Picture:
    """(n, 3) of the floor at (x, y), with rug and shadow; `tone` (3,) of a studio's paper."""
    w, d, _ = size
    if room.studio:
        out = np.broadcast_to(tone, (len(flat), 3)).copy()
    else:
        kind = str(rng.choice(["wood", "tiles", "plain", "stone", "weave"]))
        out = _surface(rng, random_texture(rng, kind), flat, per_unit)
        if rng.random() < 0.3:
            middle = np.array([rng.normal(-0.4, 0.5) * d, rng.normal(0, 0.4) * w])
            off = (flat - middle) / (rng.uniform(0.4, 1.6, 2) * max(w, d))
            on = (off**2).sum(-1) < 1 if rng.random() < 0.5 else np.abs(off).max(-1) < 1
            if on.any():
                out[on] = _surface(rng, random_texture(rng), flat[on], per_unit)
    beside = np.abs(flat + rng.normal(0, 0.1, 2) * [d, w] - [d / 2, 0]) - [d / 2, w / 2]
    spread = float(rng.uniform(0.02, 0.25)) * max(w, d)
    far = np.linalg.norm(np.clip(beside, 0, None), axis=1)
    shadow = np.exp(-far / spread) * float(rng.uniform(0.1, 0.9))
    return np.asarray(out * (1 - shadow)[:, None], np.float32)


def _wall(
    rng: np.random.Generator,
    room: Room,
    flat: Array,
    per_unit: float,
    size: tuple[float, float, float],
) -> Picture:
    """(n, 3) of the wall behind at (y, z): pictures, windows, boards and a skirting."""
    out = _surface(rng, random_texture(rng), flat, per_unit)
    reach = max(size[0], size[2])
    if rng.random() < 0.5:
        low = flat[:, 1] < room.floor + float(rng.uniform(0.03, 0.15)) * reach
        out[low] = random_colour(rng)
    for _ in range(int(rng.poisson(1.2))):
        middle = np.array([rng.normal(0, 1.0), rng.uniform(0.2, 1.8)]) * reach
        half = rng.uniform(0.05, 0.6, 2) * reach
        off = np.abs(flat - middle) / half
        inside = off.max(axis=1) < 1
        if not inside.any():
            continue
        out[inside] = random_colour(rng)
        core = off.max(axis=1) < float(rng.uniform(0.6, 0.97))
        if core.any():
            out[core] = _surface(rng, random_texture(rng), flat[core], per_unit)
            out[core] *= float(rng.choice([1.0, rng.uniform(1.0, 2.0)]))  # a window is bright
    return out
