"""Synthetic photographs of procedural furniture with exact truth, at three levels of difficulty.

Used by `mam-sim bench-photo`, by the tests and for the example pictures.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from mam_pipeline.photo.camera import (
    CORNERS,
    FACES,
    Camera,
    apply_homography,
    quad_homography,
    rotation,
)  # fmt: skip
from mam_world.photos.furniture_scene import Piece, build_piece, point
from mam_world.photos.photo_renderer import Light, Scene, Surface, render
from mam_world.photos.synthetic_furniture import CATEGORIES, METALS, PAINTS, WEIGHTS, WOODS
from mam_world.photos.truth import PanelTruth, PhotoTruth, Rect

LEVELS = ("clean", "medium", "clutter")


def synthesise(
    seed: int, level: str = "clean", width: int = 720
) -> tuple[NDArray[np.uint8], PhotoTruth]:
    """Render one photo (H, W, 3 RGB) with its truth; the same seed gives the same picture."""
    rng = np.random.default_rng([seed, LEVELS.index(level)])
    category = str(rng.choice(CATEGORIES, p=WEIGHTS))
    scene = Scene()
    piece = build_piece(scene, rng, category)
    return photograph(scene, piece, rng, level, width)


def photograph(
    scene: Scene, piece: Piece, rng: np.random.Generator, level: str, width: int
) -> tuple[NDArray[np.uint8], PhotoTruth]:
    """Place a camera, a room and light; render; return picture and truth."""
    aspect = float(rng.choice([1.0, 4 / 3, 3 / 4, 1.0]))
    height = round(width / aspect)
    yaw = float(np.deg2rad(rng.uniform(-42, 42) if rng.random() < 0.75 else rng.uniform(-3, 3)))
    pitch = float(np.deg2rad(rng.uniform(2, 24)))
    roll = float(np.deg2rad(rng.normal(0, 0.8)))
    camera = frame_camera(piece, (width, height), yaw, pitch, roll, float(rng.uniform(26, 85)), rng)
    _room(scene, piece, rng, level)
    light = Light(
        direction=(
            -float(rng.uniform(0.3, 1)),
            float(rng.uniform(-0.9, 0.9)),
            float(rng.uniform(0.5, 1.2)),
        ),
        softness=float(rng.uniform(0.1, 0.5)),
        key=float(rng.uniform(0.45, 0.8)),
        ambient=float(rng.uniform(0.35, 0.6)),
        tint=(float(rng.uniform(0.92, 1.06)), 1.0, float(rng.uniform(0.88, 1.04))),
    )  # fmt: skip
    tone = float(rng.choice([1.0, 0.85, 0.6])) if level == "clean" else 0.4
    image = render(scene, camera, light, (tone, tone, tone), seed=int(rng.integers(1 << 30)))
    grain = rng.normal(0, rng.uniform(0.5, 3.0), image.shape)
    image = np.clip(image + grain, 0, 255).astype(np.uint8)
    quality = int(rng.integers(72, 95))
    packed = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    image = np.asarray(cv2.imdecode(packed, 1), np.uint8)
    corners = box_corners(piece)
    quad = camera.project(corners[list(FACES["front"])])
    return image, PhotoTruth(
        piece.category, piece.size, quad, _apparent(piece, camera, quad), camera.focal, level,
        depth_visible=bool(abs(yaw) > 0.12 or pitch > 0.15),
    )  # fmt: skip


def _apparent(piece: Piece, camera: Camera, quad: NDArray[np.float64]) -> tuple[PanelTruth, ...]:
    """Panels and handles where the camera sees them on the front plane (they stand proud of it)."""
    w, _, h = piece.size
    matrix = quad_homography(quad, 1.0, 1.0)

    def seen(rect: Rect, x: float) -> Rect:
        u, v = (
            np.array([rect[0], rect[2], rect[2], rect[0]]),
            np.array([rect[1], rect[1], rect[3], rect[3]]),
        )
        points = np.stack([np.full(4, x), (0.5 - u) * w, piece.base + (1 - v) * h], axis=1)
        q = apply_homography(matrix, camera.project(points))
        u0, v0, u1, v1 = q[[0, 3], 0].mean(), q[:2, 1].mean(), q[1:3, 0].mean(), q[2:, 1].mean()
        return (float(u0), float(v0), float(u1), float(v1))

    return tuple(
        replace(p, rect=seen(p.rect, face), handles=tuple(seen(k, face - 0.022) for k in p.handles))
        for p, face in zip(piece.panels, piece.proud)
    )


def box_corners(piece: Piece) -> NDArray[np.float64]:
    """(8, 3) corners of the body box."""
    w, d, h = piece.size
    half = np.array([d, w, h]) / 2
    return CORNERS * half + np.array([d / 2, 0, piece.base + h / 2])


def frame_camera(
    piece: Piece,
    size: tuple[int, int],
    yaw: float,
    pitch: float,
    roll: float,
    f35: float,
    rng: np.random.Generator | None = None,
) -> Camera:
    """A camera that frames the piece as people do, with some margin and shift."""
    d, h = piece.size[1:]
    width, height = size
    focal = f35 / 43.27 * float(np.hypot(width, height))
    turn = rotation(yaw, pitch, roll)
    middle = np.array([d / 2, 0.0, (piece.base + h) / 2])
    points = np.concatenate([box_corners(piece), box_corners(piece) * [1, 1, 0]])
    fill = 0.85 if rng is None else float(rng.uniform(0.62, 0.93))
    distance = 1.0
    for _ in range(60):
        camera = Camera(width, height, focal, turn, -turn @ middle + [0, 0, distance])
        uv = camera.project(points)
        depth = (points @ turn.T + camera.translation)[:, 2]
        extent = np.ptp(uv, axis=0) / [width, height]
        if depth.min() > 0.1 and extent.max() < fill:
            break
        distance *= 1.06
    center = (uv.max(axis=0) + uv.min(axis=0)) / 2
    room = (1 - extent) / 2 * (0.5 if rng is not None else 0.0)
    wish = np.array([0.5, 0.5]) * [width, height]
    if rng is not None:
        wish += rng.uniform(-1, 1, 2) * room * [width, height]
    shift = (wish - center) / focal * distance
    return replace(camera, translation=camera.translation + np.append(shift, 0.0))


def _room(scene: Scene, piece: Piece, rng: np.random.Generator, level: str) -> None:
    d = piece.size[1]
    if level == "clean":
        if rng.random() < 0.6:
            tone = 1.3
            floor = scene.material(Surface("plain", (tone, tone, tone), gloss=0.0))
            scene.add(
                np.array([[-9, -9, 0], [9, -9, 0], [9, 9, 0], [-9, 9, 0]]) * 1.0,
                np.array([[0, 1, 2], [0, 2, 3]]),
                floor,
            )
        return
    a, b = WOODS[int(rng.integers(len(WOODS)))]
    kinds = [
        Surface("plain", PAINTS[int(rng.integers(len(PAINTS)))]),
        Surface("wood", a, b, grain=1, scale=0.6),
        Surface("tiles", (0.6, 0.55, 0.5), (0.3, 0.28, 0.25), scale=float(rng.uniform(0.4, 1))),
        Surface("noise", (0.4, 0.42, 0.45), (0.55, 0.55, 0.5)),
    ]
    floor = scene.material(kinds[int(rng.integers(len(kinds)))])
    wall = scene.material(
        Surface(
            "plain" if level == "medium" else "noise",
            tuple(rng.uniform(0.25, 0.8, 3)),
            tuple(rng.uniform(0.3, 0.8, 3)),
        )
    )  # type: ignore[arg-type]
    scene.box(point(-9, -9, -0.05), point(9, 9, 0), floor)
    back = d + float(rng.uniform(0.02, 0.6))
    scene.box(point(back, -9, 0), point(back + 0.1, 9, 6), wall)
    if rng.random() < 0.6:
        scene.box(
            point(back - 0.015, -9, 0),
            point(back, 9, 0.1),
            scene.material(Surface("plain", (0.8, 0.8, 0.78))),
        )
    if level == "medium":
        return
    _clutter(scene, piece, rng, back)


def _clutter(scene: Scene, piece: Piece, rng: np.random.Generator, back: float) -> None:
    w, d, h = piece.size
    top = piece.base + h

    def paint() -> int:
        metal = METALS if rng.random() < 0.2 else PAINTS
        return scene.material(
            Surface(
                str(rng.choice(["plain", "noise", "wood"])),
                metal[int(rng.integers(len(metal)))],
                tuple(rng.uniform(0.1, 0.8, 3)),
            )
        )  # type: ignore[arg-type]

    for _ in range(int(rng.integers(0, 4))):  # things on top
        x, y = rng.uniform(0.06, d - 0.06), rng.uniform(-w / 2 + 0.08, w / 2 - 0.08)
        s = rng.uniform(0.03, 0.09)
        if rng.random() < 0.5:
            scene.tube(point(x, y, top), point(x, y, top + 3 * s), s, 0.6 * s, paint())
        else:
            scene.box(
                point(x - s, y - 1.5 * s, top),
                point(x + s, y + 1.5 * s, top + s),
                paint(),
                rng.uniform(0, 3),
            )
    for _ in range(int(rng.integers(0, 4))):  # pictures on the wall
        y, z, s = rng.uniform(-2, 2), rng.uniform(1.0, 2.2), rng.uniform(0.15, 0.4)
        scene.box(point(back - 0.02, y - s, z - s), point(back, y + s, z + 1.3 * s), paint())
        scene.box(
            point(back - 0.022, y - 0.85 * s, z - 0.85 * s),
            point(back, y + 0.85 * s, z + 1.15 * s),
            paint(),
        )
    for side in (-1, 1):  # neighbours
        if rng.random() < 0.6:
            near = side * (w / 2 + rng.uniform(0.08, 0.6))
            far = near + side * rng.uniform(0.4, 1.2)
            depth = rng.uniform(0.3, 0.8)
            scene.box(
                point(back - depth, near, 0), point(back, far, rng.uniform(0.4, 1.6)), paint()
            )
        if rng.random() < 0.4:
            y = side * (w / 2 + rng.uniform(0.2, 0.8))
            leaf = paint()
            for _ in range(14):
                tip = point(
                    d / 2 + rng.normal(0, 0.2), y + rng.normal(0, 0.2), rng.uniform(0.5, 1.3)
                )
                scene.tube(point(d / 2, y, 0.3), tip, 0.006, 0.02, leaf, 5)
            scene.tube(point(d / 2, y, 0), point(d / 2, y, 0.32), 0.1, 0.14, paint())
    if rng.random() < 0.5:  # rug
        scene.box(point(-1.2, -1.0, 0), point(d / 2, 1.1, 0.008), paint(), rng.uniform(-0.3, 0.3))
