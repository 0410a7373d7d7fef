"""Painted photos of furniture in a room, with the exact box: what the box network learns from.

A body with a painted front (`painted_front`) stands in a room of flat textures, before, beside,
under and behind other boxes; everything is seen by one pinhole camera. It takes some 60 ms.
Nothing is copied from any picture.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from mam_pipeline.photo.box_network import SEEN
from mam_pipeline.photo.camera import FACES, Camera, rotation
from mam_world.photos.painted_box import PaintedBox, paint_box
from mam_world.photos.painted_front import draw_front, hollow, lit, taken
from mam_world.photos.painted_room import Room, paint_room, random_room
from mam_world.photos.painted_sheet import Sheet, blend
from mam_world.photos.surface_texture import Picture, Texture, random_colour, random_texture

Array = NDArray[np.float64]
LONG = 448  # pixels of the picture's long side
FRONT_LONG = 520  # pixels of the front's long side while it is painted
MOST_HIDDEN = 0.35  # of the body, by things before it


@dataclass(frozen=True)
class PaintedPhoto:
    """A picture (h, w, 3) uint8 and the body in it.

    Attributes:
        corners: (8, 2) pixels of the body's box without legs, in the order of camera.CORNERS.
        seen: (h, w) index of SEEN; what hides the body is looked through.
    """

    picture: NDArray[np.uint8]
    corners: Array
    seen: NDArray[np.uint8]


def paint_photo(rng: np.random.Generator) -> PaintedPhoto:
    """Paint one photo."""
    aspect = float(np.exp(rng.normal(0.0, 0.5)))
    w, h = (1.0, 1.0 / aspect) if aspect > 1 else (aspect, 1.0)
    w, h = max(w, 0.28), max(h, 0.28)
    d = float(np.clip(np.sqrt(w * h) * np.exp(rng.normal(np.log(0.6), 0.4)), 0.12, 2.0))
    size = (w, d, h)
    camera = _random_camera(rng, size)
    eye = -camera.rotation.T @ camera.translation
    base = -float(rng.choice([0.0, rng.uniform(0.02, 0.12), rng.uniform(0.1, 0.7)])) * h
    if eye[2] < base + 0.05:  # a floor is seen from above
        base = float(eye[2] - 0.05 - rng.uniform(0, 1))
    room = random_room(rng, size, base, eye)
    middle = np.array([d / 2, 0, h / 2])
    per_unit = camera.focal / float((camera.rotation @ middle + camera.translation)[2])
    picture = paint_room(rng, camera, room, size, per_unit)
    body, opened = _body(rng, size)
    behind, before = _things(rng, size, room, eye)
    for box in (*_legs(rng, size, base), *behind):
        paint_box(picture, camera, box, rng)
    corners = camera.project(body.corners)
    seen = _faces(body, camera, corners)
    paint_box(picture, camera, body, rng)
    for box in opened:
        covered = paint_box(picture, camera, box, rng)
        if covered is not None:
            seen[covered] = SEEN.index("opened")
    for box in _on_top(rng, size):
        paint_box(picture, camera, box, rng)
    for box in before:
        under = picture.copy()
        covered = paint_box(picture, camera, box, rng)
        if covered is not None and (seen[covered] > 0).sum() > MOST_HIDDEN * (seen > 0).sum():
            picture = under
    _leaves(rng, picture, corners)
    if rng.random() < 0.8:  # exposed for what is bright
        bright = max(float(np.percentile(picture, 97)), 0.05)
        picture = picture * float(rng.uniform(0.6, 1.05) / bright)
    picture = lit(rng, picture)
    return _framed(rng, PaintedPhoto(taken(rng, picture), corners, seen))


def _random_camera(rng: np.random.Generator, size: tuple[float, float, float]) -> Camera:
    """A camera before the body, which fills a third to all of the picture."""
    w, d, h = size
    ratio = float(rng.choice([4 / 3, 3 / 4, 1.0, 3 / 2, 2 / 3, 16 / 9, 9 / 16],
                             p=[0.22, 0.22, 0.22, 0.1, 0.1, 0.07, 0.07]))  # fmt: skip
    width = LONG if ratio >= 1 else round(LONG * ratio)
    height = round(LONG / ratio) if ratio >= 1 else LONG
    yaw = rng.normal(0, 3) if rng.random() < 0.35 else rng.uniform(-52, 52)
    pitch = float(np.clip(rng.normal(9, 9), -10, 42))
    turn = rotation(*np.deg2rad([yaw, pitch, rng.normal(0, 1.5)]))
    focal = float(np.hypot(width, height) * np.exp(rng.normal(np.log(1.05), 0.35)))
    middle = np.array([d / 2, 0, h / 2])
    box = PaintedBox(
        np.array([0, -w / 2, 0]), np.array([d, w / 2, h]), Texture("plain", np.ones(3, np.float32))
    )
    share = float(rng.uniform(0.35, 1.0) if rng.random() < 0.85 else rng.uniform(1.0, 1.12))
    far = focal / max(width, height)
    for _ in range(4):  # as far as makes it that large
        far = max(far, float(np.linalg.norm([w, d, h])) / 2 + 0.2)
        camera = Camera(width, height, focal, turn, np.array([0, 0, far]) - turn @ middle)
        span = np.ptp(camera.project(box.corners), axis=0) / [width, height]
        far *= float(span.max()) / share
    free = np.clip(1 - np.ptp(camera.project(box.corners), axis=0) / [width, height], 0, 1)
    off = rng.uniform(-0.45, 0.45, 2) * free + rng.normal(0, 0.015, 2)
    moved = camera.translation + np.array([*(off * [width, height] / focal * far), 0.0])
    return replace(camera, translation=moved)


def _body(
    rng: np.random.Generator, size: tuple[float, float, float]
) -> tuple[PaintedBox, list[PaintedBox]]:
    """The body with its painted front, and what stands out of it where it is open."""
    w, d, h = size
    k = FRONT_LONG / max(w, h)
    across, high = max(int(w * k), 120), max(int(h * k), 120)
    sheet, material = draw_front(
        rng, np.zeros((high, across, 3), np.float32), (0, 0, across, high), legs=0.0
    )
    opened = _opened(rng, sheet, size) if rng.random() < 0.15 else []
    front = np.clip(sheet.picture, 0, 1.2)
    dark, bright = float(rng.uniform(0.35, 0.85)), float(rng.uniform(0.8, 1.25))
    light = {"front": 1.0, "left": dark, "right": bright, "top": float(rng.uniform(0.9, 1.4))}
    if rng.random() < 0.5:
        light["left"], light["right"] = light["right"], light["left"]
    pictures = {"front": front}
    if rng.random() < 0.35:
        pictures["top"] = random_texture(rng).draw(rng, 300, 300)
    if rng.random() < 0.25:
        side = _panelled(rng, material)
        pictures |= {"left": side, "right": side}
    low, top = np.array([0.0, -w / 2, 0.0]), np.array([d, w / 2, h])
    return PaintedBox(low, top, material, pictures, light), opened


def _panelled(rng: np.random.Generator, material: Texture) -> Picture:
    """A side with a frame around a field."""
    side = material.draw(rng, 300, 300)
    m, t = int(rng.integers(10, 70)), int(rng.integers(1, 5))
    for a, b in ((slice(m, m + t), slice(m, -m)), (slice(-m - t, -m), slice(m, -m))):
        side[a, b] *= float(rng.uniform(0.4, 1.3))
        side[b, a] *= float(rng.uniform(0.4, 1.3))
    return side


def _opened(
    rng: np.random.Generator, sheet: Sheet, size: tuple[float, float, float]
) -> list[PaintedBox]:
    """A pulled drawer or an open door, taken out of the front's picture."""
    if not sheet.panels:
        return []
    w, d, h = size
    rows, columns = sheet.picture.shape[:2]
    panel = sheet.panels[int(rng.integers(len(sheet.panels)))]
    x0, y0, x1, y1 = panel.rect
    flat = sheet.picture[int(y0) : int(y1), int(x0) : int(x1)].copy()
    if min(flat.shape[:2]) < 8:
        return []
    left, right = w / 2 - x0 / columns * w, w / 2 - x1 / columns * w  # y grows to the left
    low, high = h - y1 / rows * h, h - y0 / rows * h
    inside = random_texture(rng)
    shades = {f: float(rng.uniform(0.4, 1.1)) for f in FACES} | {"front": 1.0}
    if panel.kind == "drawer":
        out = float(rng.uniform(0.15, 0.8)) * d
        hole = inside.draw(rng, 120, 160) * float(rng.uniform(0.15, 0.6))
        corner = np.array([-out, right, low])
        return [PaintedBox(corner, np.array([0, left, high]), inside, {"front": flat, "top": hole},
                           shades)]  # fmt: skip
    hollow(sheet, panel.rect)
    angle = float(np.deg2rad(rng.uniform(25, 130)))
    at = left if panel.hinge_side != "right" else right
    sign = 1 if panel.hinge_side != "right" else -1
    c, s = np.cos(sign * angle), np.sin(sign * angle)
    turn = np.eye(4)
    turn[:2, :2] = [[c, -s], [s, c]]
    turn[1, 3] = at
    turn[:3, 3] += [-0.001, 0, 0]
    ends = sorted((left - at, right - at))
    corner = np.array([-0.025, ends[0], low])
    return [PaintedBox(corner, np.array([0.0, ends[1], high]), inside, {"front": flat}, shades,
                       turn)]  # fmt: skip


def _legs(
    rng: np.random.Generator, size: tuple[float, float, float], base: float
) -> list[PaintedBox]:
    w, d, _ = size
    if base > -0.01 or rng.random() < 0.15:  # on the floor, or hung
        return []
    texture = random_texture(rng)
    if rng.random() < 0.2:  # a plinth set back
        m = float(rng.uniform(0, 0.06))
        low, high = np.array([m, -w / 2 + m, base]), np.array([d - m, w / 2 - m, 0])
        return [PaintedBox(low, high, texture, shades={"front": float(rng.uniform(0.2, 0.9))})]
    t = float(rng.uniform(0.015, 0.08))
    m = float(rng.uniform(0, 0.08))
    out = []
    for x in (d - m - t, m):
        for y in (-w / 2 + m, w / 2 - m - t):
            low, high = np.array([x, y, base]), np.array([x + t, y + t, 0.0])
            out.append(PaintedBox(low, high, texture, shades={"left": 0.7, "right": 0.8}))
    return out


def _on_top(rng: np.random.Generator, size: tuple[float, float, float]) -> list[PaintedBox]:
    """A board that stands over, and things on it."""
    w, d, h = size
    out, top = [], h
    if rng.random() < 0.4:
        o, t = float(rng.uniform(0, 0.05)), float(rng.uniform(0.01, 0.06))
        low, high = np.array([-o, -w / 2 - o, h]), np.array([d + o, w / 2 + o, h + t])
        shades = {"front": float(rng.uniform(0.7, 1.2)), "left": 0.8, "top": 1.1}
        out.append(PaintedBox(low, high, random_texture(rng), shades=shades))
        top = h + t
    things = []
    for _ in range(int(rng.poisson(1.0))):
        s = rng.uniform(0.04, 0.3, 3) * np.array([d, w, 1.0])
        at = np.array([rng.uniform(0, d - s[0]), rng.uniform(-w / 2, w / 2 - s[1]), top])
        things.append(PaintedBox(at, at + s, random_texture(rng), shades=_any_light(rng)))
    return out + sorted(things, key=lambda b: -float(b.low[0]))


def _any_light(rng: np.random.Generator) -> dict[str, float]:
    return {face: float(rng.uniform(0.5, 1.2)) for face in FACES}


def _things(
    rng: np.random.Generator, size: tuple[float, float, float], room: Room, eye: Array
) -> tuple[list[PaintedBox], list[PaintedBox]]:
    """Other furniture: what the body hides, and what hides the body, each farthest first."""
    w, d, h = size
    reach = max(w, h)
    boxes = []
    for side in (1, -1):
        y = w / 2
        for _ in range(int(rng.choice([0, 1, 2], p=[0.55, 0.3, 0.15]))):
            y += float(rng.choice([0.0, rng.uniform(0, 0.2), rng.uniform(0.1, 1.0)])) * reach
            wide, high = rng.uniform(0.2, 1.2, 2) * reach
            high = h if rng.random() < 0.25 else high
            deep = d if rng.random() < 0.4 else float(rng.uniform(0.2, 1.2)) * reach
            x = float(rng.choice([0.0, rng.uniform(-0.3, 0.5)]))
            ends = sorted((side * y, side * (y + wide)))
            low = np.array([x, ends[0], room.floor])
            boxes.append(_neighbour(rng, low, np.array([x + deep, ends[1], room.floor + high])))
            y += wide
    if rng.random() < 0.12:  # a cupboard above
        z = h + float(rng.uniform(0.2, 0.8)) * reach
        x, wide = float(rng.uniform(0, 0.5)) * d, float(rng.uniform(0.5, 2.0)) * w
        far = np.array([d, wide / 2, z + rng.uniform(0.3, 1) * reach])
        boxes.append(_neighbour(rng, np.array([x, -wide / 2, z]), far))
    for _ in range(int(rng.choice([0, 1, 2], p=[0.75, 0.17, 0.08]))):  # things before it
        s = rng.uniform(0.02, 0.35, 3) * reach * np.array([1, 1, 1.3])
        at = np.array(
            [-rng.uniform(0.1, 1.0) * reach - s[0], rng.uniform(-0.7, 0.7) * w, room.floor]
        )
        boxes.append(PaintedBox(at, at + s, random_texture(rng), shades=_any_light(rng)))
    boxes.sort(key=lambda b: -float(np.linalg.norm((b.low + b.high) / 2 - eye)))
    low, high = np.array([0, -w / 2, 0]), np.array([d, w / 2, h])
    behind = [b for b in boxes if not _hides(b, low, high, eye)]
    return behind, [b for b in boxes if _hides(b, low, high, eye)]


def _hides(box: PaintedBox, low: Array, high: Array, eye: Array) -> bool:
    """Whether a plane between a box and the body (low, high) has the box at the camera's side."""
    for k in range(3):
        if box.high[k] <= low[k] + 1e-9 and eye[k] < low[k]:
            return True
        if box.low[k] >= high[k] - 1e-9 and eye[k] > high[k]:
            return True
    return False


def _neighbour(rng: np.random.Generator, low: Array, high: Array) -> PaintedBox:
    """A box with a front of its own now and then."""
    shades = _any_light(rng)
    if rng.random() < 0.5:
        return PaintedBox(low, high, random_texture(rng), shades=shades)
    k = 360 / float(max(high[1] - low[1], high[2] - low[2]))
    across, up = (max(int(k * (high[i] - low[i])), 90) for i in (1, 2))
    empty = np.zeros((up, across, 3), np.float32)
    sheet, material = draw_front(rng, empty, (0, 0, across, up), legs=0.0)
    return PaintedBox(low, high, material, {"front": np.clip(sheet.picture, 0, 1.2)}, shades)


def _faces(body: PaintedBox, camera: Camera, corners: Array) -> NDArray[np.uint8]:
    seen = np.zeros((camera.height, camera.width), np.uint8)
    for face in body.seen(camera):
        if face in SEEN:
            quad = np.round(corners[list(FACES[face])]).astype(np.int32)
            cv2.fillConvexPoly(seen, quad, SEEN.index(face))
    return seen


def _leaves(rng: np.random.Generator, picture: Picture, corners: Array) -> None:
    """A plant, a lamp or a chair's leg before or beside the body."""
    if rng.random() > 0.25:
        return
    sheet = Sheet(rng, picture, None, (0.0, 0.0))  # type: ignore[arg-type]
    low, high = corners.min(axis=0), corners.max(axis=0)
    foot = np.array([rng.uniform(low[0] - 40, high[0] + 40), high[1] + rng.uniform(-50, 30)])
    colour = random_colour(rng)
    for _ in range(int(rng.integers(2, 16))):
        tip = foot + rng.normal(0, 1, 2) * [35, 50] - [0, 45]
        blend(sheet, (tip + foot) / 2, (rng.uniform(3, 16), rng.uniform(6, 36)), colour, 1.0,
              bool(rng.random() < 0.7))  # fmt: skip


def _framed(rng: np.random.Generator, photo: PaintedPhoto) -> PaintedPhoto:
    """Bars at the edges now and then, as of a screen shot."""
    if rng.random() > 0.06:
        return photo
    h, w = photo.picture.shape[:2]
    x, y = (int(rng.uniform(0, 0.15) * n) for n in (w, h))
    tone = 255 if rng.random() < 0.6 else int(rng.integers(0, 255))
    picture = cv2.copyMakeBorder(photo.picture, y, y, x, x, cv2.BORDER_CONSTANT,
                                 value=(tone, tone, tone))  # fmt: skip
    seen = cv2.copyMakeBorder(photo.seen, y, y, x, x, cv2.BORDER_CONSTANT, value=0)
    return PaintedPhoto(np.asarray(picture, np.uint8), photo.corners + np.array([x, y]),
                        np.asarray(seen, np.uint8))  # fmt: skip
