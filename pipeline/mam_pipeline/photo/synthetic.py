"""Synthetic photographs of procedural furniture with exact truth, at three levels of difficulty.

Used by `mam-sim bench-photo`, by the tests and for the example pictures.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

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
from mam_pipeline.photo.furniture import (
    CATEGORIES,
    METALS,
    PAINTS,
    WEIGHTS,
    WOODS,
    Cell,
    Style,
    new_scene_surfaces,
    panel_truth,
    random_layout,
    random_size,
    random_style,
    random_surfaces,
)  # fmt: skip
from mam_pipeline.photo.raycast import Light, Scene, Surface, render
from mam_pipeline.photo.truth import PanelTruth, PhotoTruth, Rect

LEVELS = ("clean", "medium", "clutter")
MOVABLE = ("drawer", "door", "round")


@dataclass(frozen=True)
class Piece:
    """A built piece of furniture: its size, floor height of the body, and panels."""

    category: str
    size: tuple[float, float, float]
    base: float
    panels: tuple[PanelTruth, ...]
    proud: tuple[float, ...] = ()  # x of each panel's face, metres


def synthesise(
    seed: int, level: str = "clean", width: int = 720
) -> tuple[NDArray[np.uint8], PhotoTruth]:
    """Render one photo (H, W, 3 RGB) with its truth; the same seed gives the same picture."""
    rng = np.random.default_rng([seed, LEVELS.index(level)])
    category = str(rng.choice(CATEGORIES, p=WEIGHTS))
    scene = Scene()
    piece = build_piece(scene, rng, category)
    return photograph(scene, piece, rng, level, width)


def build_piece(
    scene: Scene,
    rng: np.random.Generator,
    category: str,
    size: tuple[float, float, float] | None = None,
    cells: list[Cell] | None = None,
    style: Style | None = None,
    palette: dict[str, Surface] | None = None,
) -> Piece:
    """Add a piece to the scene: front at x = 0 facing -X, centred on y = 0."""
    style = style or random_style(rng, category)
    size = size or random_size(rng, category)
    cells = cells or random_layout(rng, category, size)
    ids = new_scene_surfaces(scene, palette or random_surfaces(rng, category))
    w, d, h = size
    base = style.legs
    z1 = base + h
    b = style.board
    box = scene.box
    box(_p(0.0, w / 2, base), _p(d, w / 2 - b, z1), ids["body"])
    box(_p(0.0, -w / 2, base), _p(d, -w / 2 + b, z1), ids["body"])
    box(_p(d - 0.008, w / 2, base), _p(d, -w / 2, z1), ids["body"])
    box(_p(0.0, w / 2, base), _p(d, -w / 2, base + b), ids["body"])
    o = style.overhang
    box(_p(-o, w / 2 + o, z1 - b), _p(d, -w / 2 - o, z1), ids["top"])
    if style.plinth:
        box(_p(0.0, w / 2, base), _p(0.02, -w / 2, base + style.plinth), ids["body"])
    if style.legs:
        kind = rng.random()
        for y in (-w / 2 + 0.05, w / 2 - 0.05):
            for x in (0.04, d - 0.05):
                if kind < 0.5:
                    box(_p(x - 0.02, y - 0.02, 0), _p(x + 0.02, y + 0.02, base), ids["body"])
                else:
                    scene.tube(_p(x, y, base), _p(x, y * 1.04, 0), 0.02, 0.012, ids["top"])
    frame = max(style.frame, b)
    low = base + (style.plinth or 0.0) + (0.0 if style.plinth else frame)
    area = (-w / 2 + frame, low, w / 2 - frame, z1 - max(frame, b))  # left, bottom, right, top
    panels = []
    for cell in cells:
        made = _fill(scene, rng, cell, area, style, ids, size, base)
        if made is not None:
            panels.append(made)
    face = 0.0 if style.inset else -0.016
    return Piece(category, size, base, tuple(panels), (face,) * len(panels))


def _p(x: float, y: float, z: float) -> NDArray[np.float64]:
    return np.array([x, y, z], dtype=float)


def _fill(scene, rng, cell, area, style, ids, size, base) -> PanelTruth | None:  # type: ignore[no-untyped-def]
    """Build one cell; `s` runs to the viewer's right (s = -y)."""
    left, bottom, right, top = area
    half = (style.frame if style.frame > 0.0 else style.gap) / 2
    s0 = left + cell.rect[0] * (right - left) + (half if cell.rect[0] > 0 else 0)
    s1 = left + cell.rect[2] * (right - left) - (half if cell.rect[2] < 1 else 0)
    t1 = top - cell.rect[1] * (top - bottom) - (half if cell.rect[1] > 0 else 0)
    t0 = top - cell.rect[3] * (top - bottom) + (half if cell.rect[3] < 1 else 0)
    _, d, _ = size
    if style.frame > 0.0:  # rails and stiles around the cell
        f = style.frame / 2
        for a, c, e, g in (
            (s0 - f, t0 - f, s1 + f, t0), (s0 - f, t1, s1 + f, t1 + f),
            (s0 - f, t0 - f, s0, t1 + f), (s1, t0 - f, s1 + f, t1 + f),
        ):  # fmt: skip
            scene.box(_p(0.0, -a, c), _p(0.02, -e, g), ids["body"])
    else:  # shelf or divider behind the gap
        scene.box(_p(0.02, -s0, t0 - 0.008), _p(d, -s1, t0), ids["inside"])
        scene.box(_p(0.02, -s1, t0), _p(d, -s1 - 0.008, t1), ids["inside"])
    if cell.kind == "open":
        return None
    g = style.gap
    s0, s1, t0, t1 = s0 + g / 2, s1 - g / 2, t0 + g / 2, t1 - g / 2
    face = 0.001 if style.inset or cell.kind == "control" else -0.016
    thick = 0.018
    body = ids["panel"]
    if cell.kind == "control":
        scene.box(_p(face, -s0, t0), _p(face + thick, -s1, t1), body)
        _controls(scene, rng, (s0, t0, s1, t1), face, ids)
        return None
    _panel(scene, rng, (s0, t0, s1, t1), face, thick, style, ids, cell)
    w, _, h = size

    def front(a: float, c: float, e: float, k: float) -> Rect:
        return ((a + w / 2) / w, (base + h - k) / h, (e + w / 2) / w, (base + h - c) / h)

    if cell.kind == "round":
        mid = ((s0 + s1) / 2, (t0 + t1) / 2)
        r = 0.38 * min(s1 - s0, t1 - t0)
        scene.tube(
            _p(face - 0.02, -mid[0], mid[1]),
            _p(face, -mid[0], mid[1]),
            r * 0.97,
            r,
            ids["handle"],
            48,
        )
        scene.ellipsoid(_p(face - 0.02, -mid[0], mid[1]), (0.02, r * 0.75, r * 0.75), ids["dark"])
        rect = front(mid[0] - r, mid[1] - r, mid[0] + r, mid[1] + r)
        return panel_truth(cell, rect, (), round_door=True)
    handles = _handles(scene, cell, (s0, t0, s1, t1), face, style, ids)
    return panel_truth(cell, front(s0, t0, s1, t1), tuple(front(*x) for x in handles))


def _panel(scene, rng, r, face, thick, style, ids, cell) -> None:  # type: ignore[no-untyped-def]
    s0, t0, s1, t1 = r
    rim = min(0.07, 0.22 * min(s1 - s0, t1 - t0))
    back = face + thick
    if cell.kind == "round" or style.panel == "slab" or min(s1 - s0, t1 - t0) < 0.12:
        scene.box(_p(face, -s0, t0), _p(back, -s1, t1), ids["panel"])
        if cell.hinge_side == "bottom" or (
            style.handle == "bar" and style.board == 0.02 and s1 - s0 < 0.45
        ):
            if t1 - t0 < 0.7:
                m = 0.07
                scene.box(
                    _p(face - 1e-3, -s0 - m, t0 + m), _p(back, -s1 + m, t1 - 1.6 * m), ids["dark"]
                )
        return
    for a, c, e, g in (
        (s0, t0, s0 + rim, t1), (s1 - rim, t0, s1, t1),
        (s0 + rim, t0, s1 - rim, t0 + rim), (s0 + rim, t1 - rim, s1 - rim, t1),
    ):  # fmt: skip
        scene.box(_p(face, -a, c), _p(back, -e, g), ids["panel"])
    sink = 0.006
    scene.box(
        _p(face + sink, -s0 - rim, t0 + rim),
        _p(back, -s1 + rim, t1 - rim),
        ids["inlay" if style.panel == "ornament" else "panel"],
    )
    if style.panel == "raised":
        m = rim + 0.025
        if min(s1 - s0, t1 - t0) > 2.4 * m:
            scene.box(_p(face + 0.001, -s0 - m, t0 + m), _p(back, -s1 + m, t1 - m), ids["panel"])


def _controls(scene, rng, r, face, ids) -> None:  # type: ignore[no-untyped-def]
    s0, t0, s1, t1 = r
    wide = s1 - s0 > t1 - t0
    n = int(rng.integers(2, 6))
    for k in range(n):
        f = (k + 0.5) / n
        s, t = (s0 + f * (s1 - s0), (t0 + t1) / 2) if wide else ((s0 + s1) / 2, t0 + f * (t1 - t0))
        if k == n // 2 and rng.random() < 0.6:
            hs, ht = 0.25 * min(s1 - s0, 0.2), 0.25 * min(t1 - t0, 0.1)
            scene.box(_p(face - 1e-3, -(s - hs), t - ht), _p(face, -(s + hs), t + ht), ids["dark"])
        else:
            scene.tube(_p(face - 0.015, -s, t), _p(face, -s, t), 0.012, 0.014, ids["handle"])


def _handles(scene, cell, r, face, style, ids):  # type: ignore[no-untyped-def]
    """Add handles to a panel; returns their (s0, t0, s1, t1) boxes."""
    s0, t0, s1, t1 = r
    w, h = s1 - s0, t1 - t0
    if style.handle == "none":
        return []
    out = []
    size = min(style.handle_size, 0.6 * w if cell.kind == "drawer" else 0.5 * h)
    if cell.kind == "drawer":
        count = 2 if w > 0.75 and w > 2.5 * h else 1
        spots = [
            ((k + 0.5) / count if count == 1 else 0.22 + 0.56 * k, 0.5 if h < 0.3 else 0.62)
            for k in range(count)
        ]
        vertical = False
    elif cell.hinge_side == "bottom":
        spots, vertical = [(0.5, 1 - min(0.06 / h, 0.3))], False
        size = 0.75 * w
    else:
        edge = min(0.045, 0.15 * w)
        u = 1 - edge / w if cell.hinge_side == "left" else edge / w
        high = (0.5 if h < 0.9 else 0.45) if style.handle != "knob" else 0.55
        vertical = style.vertical_bars
        if not vertical and style.handle in ("bar", "cup"):
            size = min(size, 0.4 * w)
            u += (-1 if cell.hinge_side == "left" else 1) * size / 2 / w
        spots = [(u, high)]
    for u, v in spots:
        s, t = s0 + u * w, t0 + v * h
        out.append(_handle(scene, style, s, t, size, vertical, face, ids["handle"]))
    return out


def _handle(scene, style, s, t, size, vertical, face, surface):  # type: ignore[no-untyped-def]
    kind = style.handle
    if kind == "knob":
        r = min(0.016, 0.12 * size + 0.006)
        scene.tube(_p(face - 0.012, -s, t), _p(face, -s, t), r * 0.5, r * 0.6, surface)
        scene.ellipsoid(_p(face - 0.018, -s, t), (0.5 * r, r, r), surface)
        return (s - r, t - r, s + r, t + r)
    if kind == "cup" and not vertical:
        a, b = min(0.05, size / 2), 0.018
        scene.ellipsoid(_p(face, -s, t), (0.022, a, b), surface)
        return (s - a, t - b, s + a, t + b)
    if kind == "ring":
        r = 0.022
        scene.tube(_p(face - 0.004, -s, t + 0.01), _p(face, -s, t + 0.01), 0.014, 0.014, surface)
        for k in range(10):
            a0, a1 = 2 * np.pi * k / 10, 2 * np.pi * (k + 1) / 10
            q0 = _p(face - 0.01, -(s + r * np.cos(a0)), t - 0.01 + r * np.sin(a0))
            q1 = _p(face - 0.01, -(s + r * np.cos(a1)), t - 0.01 + r * np.sin(a1))
            scene.tube(q0, q1, 0.003, 0.003, surface, 6)
        return (s - r - 0.003, t - 0.01 - r - 0.003, s + r + 0.003, t + 0.024)
    thin = 0.006
    half = size / 2
    ds, dt = (thin, half) if vertical else (half, thin)
    scene.box(_p(face - 0.034, -(s - ds), t - dt), _p(face - 0.024, -(s + ds), t + dt), surface)
    for sign in (-0.85, 0.85):
        a = s if vertical else s + sign * half
        c = t + sign * half if vertical else t
        scene.box(
            _p(face - 0.03, -(a - 0.004), c - 0.004), _p(face, -(a + 0.004), c + 0.004), surface
        )
    return (s - ds, t - dt, s + ds, t + dt)


def photograph(
    scene: Scene, piece: Piece, rng: np.random.Generator, level: str, width: int
) -> tuple[NDArray[np.uint8], PhotoTruth]:
    """Place a camera, a room and light; render; return picture and truth."""
    w, d, h = piece.size
    aspect = float(rng.choice([1.0, 4 / 3, 3 / 4, 1.0]))
    height = round(width / aspect)
    yaw = float(np.deg2rad(rng.uniform(-42, 42) if rng.random() < 0.75 else rng.uniform(-3, 3)))
    pitch = float(np.deg2rad(rng.uniform(2, 24)))
    roll = float(np.deg2rad(rng.normal(0, 0.8)))
    camera = frame_camera(piece, (width, height), yaw, pitch, roll, float(rng.uniform(26, 85)), rng)
    _room(scene, piece, rng, level)
    light = Light(
        direction=(-float(rng.uniform(0.3, 1)), float(rng.uniform(-0.9, 0.9)), float(rng.uniform(0.5, 1.2))),
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
    image = cv2.imdecode(cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])[1], 1)
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
    w, d, h = piece.size
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
    return replace(camera, translation=camera.translation + [shift[0], shift[1], 0])


def _room(scene: Scene, piece: Piece, rng: np.random.Generator, level: str) -> None:
    w, d, h = piece.size
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
    scene.box(_p(-9, -9, -0.05), _p(9, 9, 0), floor)
    back = d + float(rng.uniform(0.02, 0.6))
    scene.box(_p(back, -9, 0), _p(back + 0.1, 9, 6), wall)
    if rng.random() < 0.6:
        scene.box(
            _p(back - 0.015, -9, 0),
            _p(back, 9, 0.1),
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
            scene.tube(_p(x, y, top), _p(x, y, top + 3 * s), s, 0.6 * s, paint())
        else:
            scene.box(
                _p(x - s, y - 1.5 * s, top),
                _p(x + s, y + 1.5 * s, top + s),
                paint(),
                rng.uniform(0, 3),
            )
    for _ in range(int(rng.integers(0, 4))):  # pictures on the wall
        y, z, s = rng.uniform(-2, 2), rng.uniform(1.0, 2.2), rng.uniform(0.15, 0.4)
        scene.box(_p(back - 0.02, y - s, z - s), _p(back, y + s, z + 1.3 * s), paint())
        scene.box(
            _p(back - 0.022, y - 0.85 * s, z - 0.85 * s),
            _p(back, y + 0.85 * s, z + 1.15 * s),
            paint(),
        )
    for side in (-1, 1):  # neighbours
        if rng.random() < 0.6:
            near = side * (w / 2 + rng.uniform(0.08, 0.6))
            far = near + side * rng.uniform(0.4, 1.2)
            depth = rng.uniform(0.3, 0.8)
            scene.box(_p(back - depth, near, 0), _p(back, far, rng.uniform(0.4, 1.6)), paint())
        if rng.random() < 0.4:
            y = side * (w / 2 + rng.uniform(0.2, 0.8))
            leaf = paint()
            for _ in range(14):
                tip = _p(d / 2 + rng.normal(0, 0.2), y + rng.normal(0, 0.2), rng.uniform(0.5, 1.3))
                scene.tube(_p(d / 2, y, 0.3), tip, 0.006, 0.02, leaf, 5)
            scene.tube(_p(d / 2, y, 0), _p(d / 2, y, 0.32), 0.1, 0.14, paint())
    if rng.random() < 0.5:  # rug
        scene.box(_p(-1.2, -1.0, 0), _p(d / 2, 1.1, 0.008), paint(), rng.uniform(-0.3, 0.3))
