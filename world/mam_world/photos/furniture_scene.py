"""One piece of procedural furniture as a scene: boards, fronts, mouldings, handles, legs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mam_world.photos.photo_renderer import Scene, Surface
from mam_world.photos.synthetic_furniture import (
    Cell,
    Style,
    new_scene_surfaces,
    panel_truth,
    random_layout,
    random_size,
    random_style,
    random_surfaces,
)  # fmt: skip
from mam_world.photos.truth import PanelTruth, Rect


@dataclass(frozen=True)
class Piece:
    """A built piece of furniture: its size, floor height of the body, and panels."""

    category: str
    size: tuple[float, float, float]
    base: float
    panels: tuple[PanelTruth, ...]
    proud: tuple[float, ...] = ()  # x of each panel's face, metres


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
    box(point(0.0, w / 2, base), point(d, w / 2 - b, z1), ids["body"])
    box(point(0.0, -w / 2, base), point(d, -w / 2 + b, z1), ids["body"])
    box(point(d - 0.008, w / 2, base), point(d, -w / 2, z1), ids["body"])
    box(point(0.0, w / 2, base), point(d, -w / 2, base + b), ids["body"])
    o = style.overhang
    box(point(-o, w / 2 + o, z1 - b), point(d, -w / 2 - o, z1), ids["top"])
    if style.plinth:
        box(point(0.0, w / 2, base), point(0.02, -w / 2, base + style.plinth), ids["body"])
    if style.legs:
        kind = rng.random()
        for y in (-w / 2 + 0.05, w / 2 - 0.05):
            for x in (0.04, d - 0.05):
                if kind < 0.5:
                    box(point(x - 0.02, y - 0.02, 0), point(x + 0.02, y + 0.02, base), ids["body"])
                else:
                    scene.tube(point(x, y, base), point(x, y * 1.04, 0), 0.02, 0.012, ids["top"])
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


def point(x: float, y: float, z: float) -> NDArray[np.float64]:
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
            scene.box(point(0.0, -a, c), point(0.02, -e, g), ids["body"])
    else:  # shelf or divider behind the gap
        scene.box(point(0.02, -s0, t0 - 0.008), point(d, -s1, t0), ids["inside"])
        scene.box(point(0.02, -s1, t0), point(d, -s1 - 0.008, t1), ids["inside"])
    if cell.kind == "open":
        return None
    g = style.gap
    s0, s1, t0, t1 = s0 + g / 2, s1 - g / 2, t0 + g / 2, t1 - g / 2
    face = 0.001 if style.inset or cell.kind == "control" else -0.016
    thick = 0.018
    body = ids["panel"]
    if cell.kind == "control":
        scene.box(point(face, -s0, t0), point(face + thick, -s1, t1), body)
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
            point(face - 0.02, -mid[0], mid[1]),
            point(face, -mid[0], mid[1]),
            r * 0.97,
            r,
            ids["handle"],
            48,
        )
        scene.ellipsoid(
            point(face - 0.02, -mid[0], mid[1]), (0.02, r * 0.75, r * 0.75), ids["dark"]
        )
        rect = front(mid[0] - r, mid[1] - r, mid[0] + r, mid[1] + r)
        return panel_truth(cell, rect, (), round_door=True)
    handles = _handles(scene, cell, (s0, t0, s1, t1), face, style, ids)
    return panel_truth(cell, front(s0, t0, s1, t1), tuple(front(*x) for x in handles))


def _panel(scene, rng, r, face, thick, style, ids, cell) -> None:  # type: ignore[no-untyped-def]
    s0, t0, s1, t1 = r
    rim = min(0.07, 0.22 * min(s1 - s0, t1 - t0))
    back = face + thick
    if cell.kind == "round" or style.panel == "slab" or min(s1 - s0, t1 - t0) < 0.12:
        scene.box(point(face, -s0, t0), point(back, -s1, t1), ids["panel"])
        appliance = style.handle == "bar" and style.board == 0.02 and s1 - s0 < 0.45
        if (cell.hinge_side == "bottom" or appliance) and t1 - t0 < 0.7:  # a window
            m = 0.07
            low, high = point(face - 1e-3, -s0 - m, t0 + m), point(back, -s1 + m, t1 - 1.6 * m)
            scene.box(low, high, ids["dark"])
        return
    for a, c, e, g in (
        (s0, t0, s0 + rim, t1), (s1 - rim, t0, s1, t1),
        (s0 + rim, t0, s1 - rim, t0 + rim), (s0 + rim, t1 - rim, s1 - rim, t1),
    ):  # fmt: skip
        scene.box(point(face, -a, c), point(back, -e, g), ids["panel"])
    sink = 0.006
    scene.box(
        point(face + sink, -s0 - rim, t0 + rim),
        point(back, -s1 + rim, t1 - rim),
        ids["inlay" if style.panel == "ornament" else "panel"],
    )
    if style.panel == "raised":
        m = rim + 0.025
        if min(s1 - s0, t1 - t0) > 2.4 * m:
            scene.box(
                point(face + 0.001, -s0 - m, t0 + m), point(back, -s1 + m, t1 - m), ids["panel"]
            )


def _controls(scene, rng, r, face, ids) -> None:  # type: ignore[no-untyped-def]
    s0, t0, s1, t1 = r
    wide = s1 - s0 > t1 - t0
    n = int(rng.integers(2, 6))
    for k in range(n):
        f = (k + 0.5) / n
        s, t = (s0 + f * (s1 - s0), (t0 + t1) / 2) if wide else ((s0 + s1) / 2, t0 + f * (t1 - t0))
        if k == n // 2 and rng.random() < 0.6:
            hs, ht = 0.25 * min(s1 - s0, 0.2), 0.25 * min(t1 - t0, 0.1)
            scene.box(
                point(face - 1e-3, -(s - hs), t - ht), point(face, -(s + hs), t + ht), ids["dark"]
            )
        else:
            scene.tube(point(face - 0.015, -s, t), point(face, -s, t), 0.012, 0.014, ids["handle"])


def _handles(scene, cell, r, face, style, ids):  # type: ignore[no-untyped-def]
    """Add handles to a panel; returns their (s0, t0, s1, t1) boxes."""
    s0, t0, s1, t1 = r
    w, h = s1 - s0, t1 - t0
    if style.handle == "none":
        return []
    out = []
    size = min(style.handle_size, 0.6 * w if cell.kind == "drawer" else 0.5 * h)
    if style.handle_share:
        size = style.handle_share * (w if cell.kind == "drawer" else min(h, 1.2))
    if cell.kind == "drawer":
        count = 2 if w > 0.75 and w > 2.5 * h and not style.handle_share else 1
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
        if style.handle_high is not None:
            reach = 0.5 * size / h if style.vertical_bars else 0.0
            high = float(np.clip(style.handle_high, reach + 0.03, 0.97 - reach))
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
        scene.tube(point(face - 0.012, -s, t), point(face, -s, t), r * 0.5, r * 0.6, surface)
        scene.ellipsoid(point(face - 0.018, -s, t), (0.5 * r, r, r), surface)
        return (s - r, t - r, s + r, t + r)
    if kind == "cup" and not vertical:
        a, b = min(0.05, size / 2), 0.018
        scene.ellipsoid(point(face, -s, t), (0.022, a, b), surface)
        return (s - a, t - b, s + a, t + b)
    if kind == "ring":
        r = 0.022
        scene.tube(
            point(face - 0.004, -s, t + 0.01), point(face, -s, t + 0.01), 0.014, 0.014, surface
        )
        for k in range(10):
            a0, a1 = 2 * np.pi * k / 10, 2 * np.pi * (k + 1) / 10
            q0 = point(face - 0.01, -(s + r * np.cos(a0)), t - 0.01 + r * np.sin(a0))
            q1 = point(face - 0.01, -(s + r * np.cos(a1)), t - 0.01 + r * np.sin(a1))
            scene.tube(q0, q1, 0.003, 0.003, surface, 6)
        return (s - r - 0.003, t - 0.01 - r - 0.003, s + r + 0.003, t + 0.024)
    if kind == "square":  # a plate or a pyramid with a rim
        r = min(0.02, 0.12 * size + 0.008)
        scene.box(point(face - 0.006, -(s - r), t - r), point(face, -(s + r), t + r), surface)
        k = 0.6 * r
        scene.box(
            point(face - 0.02, -(s - k), t - k), point(face - 0.006, -(s + k), t + k), surface
        )
        return (s - r, t - r, s + r, t + r)
    if kind == "drop":  # a rosette with a hanging drop
        r = 0.012
        scene.tube(point(face - 0.008, -s, t), point(face, -s, t), 0.7 * r, r, surface)
        low = t - min(0.06, 0.4 * size)
        end = point(face - 0.02, -s, low + 0.008)
        scene.tube(point(face - 0.012, -s, t), end, 0.003, 0.008, surface, 8)
        scene.ellipsoid(point(face - 0.02, -s, low + 0.008), (0.008, 0.008, 0.012), surface)
        return (s - r, low - 0.004, s + r, t + r)
    thin = style.handle_thick / 2
    half = size / 2
    ds, dt = (thin, half) if vertical else (half, thin)
    if kind == "arch":  # a bow on two rosettes
        n = 8
        a = np.linspace(-1, 1, n + 1)
        bow = 0.008 + 0.026 * (1 - np.abs(a) ** 2.5)
        for k in range(n):
            ends = [
                point(
                    face - bow[i],
                    -(s if vertical else s + a[i] * half),
                    t + a[i] * half if vertical else t,
                )
                for i in (k, k + 1)
            ]
            scene.tube(ends[0], ends[1], thin * 0.8, thin * 0.8, surface, 8)
        for sign in (-1.0, 1.0):
            c, e = (s, t + sign * half) if vertical else (s + sign * half, t)
            scene.tube(point(face - 0.01, -c, e), point(face, -c, e), thin, 1.5 * thin, surface, 10)
        w, h = (1.5 * thin, half + thin) if vertical else (half + thin, 1.5 * thin)
        return (s - w, t - h, s + w, t + h)
    scene.box(
        point(face - 0.034, -(s - ds), t - dt), point(face - 0.024, -(s + ds), t + dt), surface
    )
    for sign in (-0.85, 0.85):
        a = s if vertical else s + sign * half
        c = t + sign * half if vertical else t
        scene.box(
            point(face - 0.03, -(a - 0.004), c - 0.004),
            point(face, -(a + 0.004), c + 0.004),
            surface,
        )
    return (s - ds, t - dt, s + ds, t + dt)
