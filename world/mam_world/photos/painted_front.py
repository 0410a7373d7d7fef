"""Painted furniture fronts with exact truth: the flat pictures that the front network learns from.

A front is drawn as a person sees it straight on: boards, gaps, mouldings, planks, glass, handles,
controls, papers and shadows, in materials and light drawn at random far wider than any catalogue.
It takes some 20 ms, against seconds for a rendered photo; the bend of a badly fitted box, blur,
noise and JPEG come last. Nothing is copied from any picture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from mam_pipeline.photo.truth import PanelTruth, Rect
from mam_world.photos.front_layout import Box, FrontCell, random_cells
from mam_world.photos.surface_texture import Texture, random_colour, random_texture

Picture = NDArray[np.float32]
Colour = NDArray[np.float32]
LONG = 520  # pixels of the front's long side while it is painted
MARGIN = 60  # pixels of room around it


@dataclass(frozen=True)
class PaintedFront:
    """A picture (h, w, 3) uint8 of a front and its surroundings, and what is true of it.

    Attributes:
        corners: (4, 2) pixels of the front: top left, top right, bottom right, bottom left.
        panels: in front coordinates 0..1, u to the right, v down.
    """

    picture: NDArray[np.uint8]
    corners: NDArray[np.float64]
    panels: tuple[PanelTruth, ...]


@dataclass(frozen=True)
class _Look:
    """What all panels of one front share."""

    panel: str
    handle: str
    handle_colour: NDArray[np.float32]
    handle_length: float  # of the panel's width or height
    handle_thick: float  # pixels
    inset: float  # of a door's handle from its free edge, pixels
    high: float  # of a door's handle, share of its height from the top
    upright: bool
    gap: float  # pixels
    gap_dark: float  # 0 invisible .. 1 black
    rim: float  # pixels, width of rails
    relief: float  # strength of lit and shaded edges
    pairs: bool  # two handles on wide drawers
    drawer_at: float  # height of a drawer's handle, share of its height


@dataclass
class _Sheet:
    rng: np.random.Generator
    picture: Picture
    look: _Look
    light: tuple[float, float]
    panels: list[PanelTruth] = field(default_factory=list)


def paint_front(rng: np.random.Generator) -> PaintedFront:
    """Paint one front."""
    aspect = float(np.exp(rng.normal(0.0, 0.5)))
    w, h = (LONG, LONG / aspect) if aspect > 1 else (LONG * aspect, LONG)
    w, h = max(int(w), 150), max(int(h), 150)
    room = random_texture(rng).draw(rng, h + 2 * MARGIN, w + 2 * MARGIN)
    if rng.random() < 0.4:
        floor = int(MARGIN + h - rng.uniform(-10, 30))
        room[floor:] = random_texture(rng).draw(rng, h + 2 * MARGIN, w + 2 * MARGIN)[floor:]
    look = _random_look(rng, min(w, h))
    sheet = _Sheet(rng, room, look, (float(rng.uniform(-1, 1)), float(rng.uniform(-0.2, 1))))
    body = random_texture(rng)
    material = body if rng.random() < 0.75 else random_texture(rng)
    box = (MARGIN, MARGIN, MARGIN + w, MARGIN + h)
    _fill(sheet, box, body)
    area = _carcass(sheet, box, body)
    for cell in random_cells(rng, area):
        _cell(sheet, cell, material, body)
    _accidents(sheet, box)
    picture = _lit(sheet)
    corners = np.array([[box[0], box[1]], [box[2], box[1]], [box[2], box[3]], [box[0], box[3]]])
    panels = tuple(_in_front(p, box) for p in sheet.panels)
    return PaintedFront(_taken(rng, picture), corners.astype(np.float64), panels)


def _in_front(panel: PanelTruth, box: Box) -> PanelTruth:
    w, h = box[2] - box[0], box[3] - box[1]

    def scaled(r: Rect) -> Rect:
        return (
            (r[0] - box[0]) / w, (r[1] - box[1]) / h, (r[2] - box[0]) / w, (r[3] - box[1]) / h,
        )  # fmt: skip

    return replace(panel, rect=scaled(panel.rect), handles=tuple(scaled(r) for r in panel.handles))


def _random_look(rng: np.random.Generator, side: int) -> _Look:
    panel = str(
        rng.choice(
            ["slab", "shaker", "raised", "planks", "slats", "glass", "double", "grooves", "woven"],
            p=[0.36, 0.17, 0.1, 0.1, 0.04, 0.07, 0.06, 0.06, 0.04],
        )
    )
    handle = str(
        rng.choice(
            ["knob", "bar", "cup", "ring", "plate", "drop", "slot", "lip", "none"],
            p=[0.27, 0.33, 0.08, 0.06, 0.06, 0.06, 0.05, 0.04, 0.05],
        )
    )
    return _Look(
        panel, handle,
        handle_colour=random_colour(rng) if rng.random() < 0.5
        else np.full(3, rng.choice([0.03, 0.12, 0.35, 0.6, 0.8]), np.float32),
        handle_length=float(rng.uniform(0.12, 0.45) if rng.random() < 0.7
                            else rng.uniform(0.45, 0.95)),
        handle_thick=float(rng.uniform(3, 10)),
        inset=float(rng.uniform(4, 22)),
        high=float(rng.uniform(0.12, 0.88)),
        upright=bool(rng.random() < 0.8),
        gap=float(rng.uniform(0.8, 4.5)),
        gap_dark=float(rng.uniform(0.15, 0.95)),
        rim=float(rng.uniform(0.08, 0.22)) * side * 0.3,
        relief=float(rng.uniform(0.04, 0.5)),
        pairs=bool(rng.random() < 0.6),
        drawer_at=float(rng.choice([0.5, 0.5, rng.uniform(0.12, 0.4)])),
    )  # fmt: skip


def _carcass(
    sheet: _Sheet, box: tuple[int, int, int, int], body: Texture
) -> tuple[float, float, float, float]:
    """Top board, plinth and frame; returns where the cells go."""
    rng, side = sheet.rng, min(box[2] - box[0], box[3] - box[1])
    left = float(rng.choice([0.0, rng.uniform(2, 0.09 * side)]))
    right = left if rng.random() < 0.85 else float(rng.uniform(0, 0.09 * side))
    top = float(rng.choice([0.0, rng.uniform(3, 0.1 * side)]))
    bottom = float(rng.choice([0.0, rng.uniform(3, 0.08 * side), rng.uniform(8, 0.16 * side)]))
    x0, y0, x1, y1 = box
    if top > 4 and rng.random() < 0.6:
        board = (x0, y0, x1, int(y0 + top))
        _fill(sheet, board, random_texture(rng) if rng.random() < 0.4 else body)
        _edge(sheet, board)
        _shadow_below(sheet, board, float(rng.uniform(2, 14)))
    if bottom > 8 and rng.random() < 0.4:
        plinth = (x0, int(y1 - bottom), x1, y1)
        _shade(sheet, plinth, float(rng.uniform(0.2, 1.0)))
    if bottom > 14 and rng.random() < 0.25:  # legs: the room shows between
        leg = float(rng.uniform(6, 18))
        dark = random_texture(rng).draw(rng, int(bottom), x1 - x0)
        low = sheet.picture[int(y1 - bottom) : int(y1 - bottom) + int(bottom), x0:x1]
        middle = slice(int(leg), int(x1 - x0 - leg))
        low[:, middle] = dark[: len(low), middle] * float(rng.uniform(0.2, 0.9))
    return x0 + left, y0 + top, x1 - right, y1 - bottom


def _slices(box: Box) -> tuple[slice, slice]:
    x0, y0, x1, y1 = (round(v) for v in box)
    return slice(max(y0, 0), max(y1, 0)), slice(max(x0, 0), max(x1, 0))


def _fill(sheet: _Sheet, box: Box, texture: Texture) -> None:
    rows, columns = _slices(box)
    part = sheet.picture[rows, columns]
    if part.size:
        part[:] = texture.draw(sheet.rng, part.shape[0], part.shape[1])


def _shade(sheet: _Sheet, box: Box, factor: float) -> None:
    rows, columns = _slices(box)
    sheet.picture[rows, columns] *= factor


def _edge(sheet: _Sheet, box: Box, strength: float | None = None, sunk: bool = False) -> None:
    """Lit and shaded rims of a plate (or of a sunk field)."""
    k = sheet.look.relief if strength is None else strength
    x0, y0, x1, y1 = (round(v) for v in box)
    if x1 - x0 < 6 or y1 - y0 < 6:
        return
    t = int(sheet.rng.integers(1, 4))
    sign = -1.0 if sunk else 1.0
    sx, sy = sheet.light
    for part, amount in (
        ((x0, y0, x1, y0 + t), sy), ((x0, y1 - t, x1, y1), -sy),
        ((x0, y0, x0 + t, y1), -sx), ((x1 - t, y0, x1, y1), sx),
    ):  # fmt: skip
        _shade(sheet, part, float(np.clip(1.0 + sign * k * amount, 0.2, 1.8)))


def _shadow_below(sheet: _Sheet, box: Box, length: float) -> None:
    x0, _, x1, y1 = (round(v) for v in box)
    n = max(1, round(length))
    part = sheet.picture[y1 : y1 + n, x0:x1]
    ramp = np.linspace(float(sheet.rng.uniform(0.35, 0.9)), 1.0, n, dtype=np.float32)
    part *= ramp[: len(part), None, None]


def _gap(sheet: _Sheet, box: Box) -> None:
    """The dark joint around a panel."""
    look = sheet.look
    x0, y0, x1, y1 = box
    g = look.gap
    for part in (
        (x0 - g / 2, y0 - g / 2, x1 + g / 2, y0 + g / 2),
        (x0 - g / 2, y1 - g / 2, x1 + g / 2, y1 + g / 2),
        (x0 - g / 2, y0, x0 + g / 2, y1), (x1 - g / 2, y0, x1 + g / 2, y1),
    ):  # fmt: skip
        a, b, c, d = (round(v) for v in part)
        _shade(sheet, (a, b, max(c, a + 1), max(d, b + 1)), 1.0 - look.gap_dark)


def _cell(sheet: _Sheet, cell: FrontCell, material: Texture, body: Texture) -> None:
    rng, look = sheet.rng, sheet.look
    reveal = float(rng.uniform(0, 5)) if look.inset > 13 else look.gap
    x0, y0, x1, y1 = cell.rect
    box = (x0 + reveal / 2, y0 + reveal / 2, x1 - reveal / 2, y1 - reveal / 2)
    if min(box[2] - box[0], box[3] - box[1]) < 16:
        return
    if cell.kind == "open":
        return _hollow(sheet, box)
    if cell.kind == "control":
        return _controls(sheet, box, material)
    if cell.kind == "fixed":
        return _fill(sheet, box, body)
    if reveal > look.gap + 1 or rng.random() < 0.5:
        _shade(sheet, cell.rect, 1.0 - look.gap_dark * float(rng.uniform(0.3, 1.0)))
    _fill(sheet, box, material)
    _shade(sheet, box, float(rng.normal(1.0, 0.02)))
    _gap(sheet, box)
    _edge(sheet, box)
    _inside_of_panel(sheet, box, cell)
    handles = _handles(sheet, box, cell)
    sheet.panels.append(PanelTruth(cell.kind, tuple(map(float, box)), cell.hinge, handles))  # type: ignore[arg-type]
    if rng.random() < 0.06:
        _distraction(sheet, box)
    return None


def _hollow(sheet: _Sheet, box: Box) -> None:
    rng = sheet.rng
    _shade(sheet, box, float(rng.uniform(0.15, 0.7)))
    rows, columns = _slices(box)
    part = sheet.picture[rows, columns]
    ramp = np.linspace(float(rng.uniform(0.4, 1.0)), 1.0, max(len(part), 1), dtype=np.float32)
    part *= ramp[:, None, None]
    x0, y0, x1, y1 = box
    for _ in range(int(rng.integers(0, 7))):
        w, h = rng.uniform(6, 0.4 * (x1 - x0) + 7), rng.uniform(6, 0.7 * (y1 - y0) + 7)
        x = rng.uniform(x0, max(x1 - w, x0 + 1))
        thing = (x, max(y1 - h, y0), min(x + w, x1), y1)
        _fill(sheet, thing, random_texture(rng))
        _shade(sheet, thing, float(rng.uniform(0.3, 0.9)))


def _controls(sheet: _Sheet, box: Box, material: Texture) -> None:
    rng = sheet.rng
    _fill(sheet, box, material if rng.random() < 0.6 else random_texture(rng))
    x0, y0, x1, y1 = box
    wide = x1 - x0 > y1 - y0
    n = int(rng.integers(1, 8))
    for k in range(n):
        f = (k + 0.5) / n
        x, y = (x0 + f * (x1 - x0), (y0 + y1) / 2) if wide else ((x0 + x1) / 2, y0 + f * (y1 - y0))
        r = float(rng.uniform(0.15, 0.4)) * min(
            min(x1 - x0, y1 - y0), (x1 - x0 + y1 - y0) / (2 * n)
        )
        if rng.random() < 0.6:
            _disc(sheet, (x, y), r, random_colour(rng))
        else:
            _plate(sheet, (x - 1.5 * r, y - r, x + 1.5 * r, y + r), random_colour(rng))
    _edge(sheet, box, 0.1)


def _inside_of_panel(sheet: _Sheet, box: Box, cell: FrontCell) -> None:
    """Rails, fields, planks, slats or glass: lines that part nothing."""
    rng, look = sheet.rng, sheet.look
    x0, y0, x1, y1 = box
    kind = look.panel
    rim = min(look.rim, 0.28 * min(x1 - x0, y1 - y0))
    field_ = (x0 + rim, y0 + rim, x1 - rim, y1 - rim)
    if min(x1 - x0, y1 - y0) < 30 or (cell.kind == "drawer" and rng.random() < 0.2):
        kind = "slab"
    if cell.hinge == "bottom" and rng.random() < 0.6:
        kind = "window"
    if kind == "slab":
        return
    if kind in ("planks", "slats", "grooves"):
        inner = field_ if rng.random() < 0.5 else box
        n = int(rng.integers(2, 12))
        across = kind == "planks" or (kind == "grooves" and rng.random() < 0.4)
        for k in range(1, n):
            f = k / n
            if across:
                x = inner[0] + f * (inner[2] - inner[0])
                line = (x, inner[1], x + rng.uniform(1, 3), inner[3])
            else:
                y = inner[1] + f * (inner[3] - inner[1])
                line = (inner[0], y, inner[2], y + rng.uniform(1, 3))
            _shade(sheet, line, 1.0 - 0.7 * look.relief)
        if inner is field_:
            _edge(sheet, field_, sunk=True)
        return
    fields = [field_]
    if kind == "double" and y1 - y0 > 90:
        m = y0 + float(rng.uniform(0.3, 0.7)) * (y1 - y0)
        fields = [(field_[0], field_[1], field_[2], m - rim / 2),
                  (field_[0], m + rim / 2, field_[2], field_[3])]  # fmt: skip
    for part in fields:
        if kind in ("glass", "window"):
            _glass(sheet, part)
        elif kind == "woven" or (kind == "shaker" and rng.random() < 0.15):
            _fill(sheet, part, random_texture(rng, "weave"))
        else:
            _shade(sheet, part, float(rng.uniform(0.9, 1.05)))
        _edge(sheet, part, sunk=True)
        if kind == "raised":
            m = float(rng.uniform(4, 14))
            _edge(sheet, (part[0] + m, part[1] + m, part[2] - m, part[3] - m))


def _glass(sheet: _Sheet, box: Box) -> None:
    rng = sheet.rng
    _fill(sheet, box, Texture("plain", np.full(3, rng.uniform(0.02, 0.5), np.float32)))
    rows, columns = _slices(box)
    part = sheet.picture[rows, columns]
    if not part.size:
        return
    small = rng.uniform(0, 1, (5, 5, 3)).astype(np.float32)
    mirrored = cv2.resize(small, (part.shape[1], part.shape[0]), interpolation=cv2.INTER_CUBIC)
    part += float(rng.uniform(0, 0.3)) * mirrored
    x0, y0, x1, y1 = box
    for _ in range(int(rng.integers(0, 3))):  # boards behind
        y = rng.uniform(y0, y1)
        _shade(sheet, (x0, y, x1, y + rng.uniform(2, 6)), float(rng.uniform(0.5, 1.6)))
    if rng.random() < 0.3:  # bars
        n = int(rng.integers(2, 4))
        for k in range(1, n):
            x = x0 + k / n * (x1 - x0)
            _shade(sheet, (x - 2, y0, x + 2, y1), float(rng.uniform(1.2, 2.5)))


def _disc(sheet: _Sheet, at: Sequence[float], r: float, colour: Colour) -> None:
    x, y = at
    d = sheet.rng.uniform(0.1, 0.6) * r
    _blend(sheet, (x + d * sheet.light[0], y + abs(d)), (r, r), np.zeros(3, np.float32), 0.45, True)
    _blend(sheet, (x, y), (r, r), np.asarray(colour), 1.0, True)
    _blend(sheet, (x - 0.3 * r * sheet.light[0], y - 0.3 * r), (0.45 * r, 0.45 * r),
           np.clip(np.asarray(colour) * 1.5 + 0.1, 0, 1), 0.6, True)  # fmt: skip


def _plate(sheet: _Sheet, box: Box, colour: Colour, shadow: float = 0.45) -> None:
    x0, y0, x1, y1 = box
    centre, half = ((x0 + x1) / 2, (y0 + y1) / 2), ((x1 - x0) / 2, (y1 - y0) / 2)
    d = float(sheet.rng.uniform(1, 6))
    if shadow:
        _blend(sheet, (centre[0] + d * sheet.light[0], centre[1] + d), half,
               np.zeros(3, np.float32), shadow, False)  # fmt: skip
    _blend(sheet, centre, half, np.asarray(colour), 1.0, False)
    thin = (half[0], max(half[1] * 0.3, 0.5)) if half[0] > half[1] else (
        max(half[0] * 0.3, 0.5), half[1])  # fmt: skip
    bright = np.clip(np.asarray(colour) * 1.4 + 0.08, 0, 1)
    _blend(sheet, centre, thin, bright, float(sheet.rng.uniform(0, 0.8)), False)


def _blend(
    sheet: _Sheet,
    centre: Sequence[float],
    half: Sequence[float],
    colour: Colour,
    alpha: float,
    round_: bool,
) -> None:
    """A soft-edged rectangle or ellipse of one colour over the picture."""
    h, w = sheet.picture.shape[:2]
    x0, x1 = int(max(centre[0] - half[0] - 2, 0)), int(min(centre[0] + half[0] + 3, w))
    y0, y1 = int(max(centre[1] - half[1] - 2, 0)), int(min(centre[1] + half[1] + 3, h))
    if x1 <= x0 or y1 <= y0:
        return
    y, x = np.mgrid[y0:y1, x0:x1].astype(np.float32) + 0.5
    dx, dy = np.abs(x - centre[0]), np.abs(y - centre[1])
    if round_:
        r = np.hypot(dx / max(half[0], 0.5), dy / max(half[1], 0.5))
        cover = np.clip((1.0 - r) * min(half) + 0.5, 0, 1)
    else:
        cover = np.clip(half[0] - dx + 0.5, 0, 1) * np.clip(half[1] - dy + 0.5, 0, 1)
    part = sheet.picture[y0:y1, x0:x1]
    part += (alpha * cover)[..., None] * (colour.astype(np.float32) - part)


def _handles(sheet: _Sheet, box: Box, cell: FrontCell) -> tuple[Rect, ...]:
    rng, look = sheet.rng, sheet.look
    if look.handle == "none" or (rng.random() < 0.02):
        return ()
    x0, y0, x1, y1 = box
    w, h = x1 - x0, y1 - y0
    thick = min(look.handle_thick, 0.3 * min(w, h))
    if cell.kind == "drawer":
        two = look.pairs and w > 2.2 * h and w > 130 and look.handle_length < 0.4
        shares = (0.2, 0.8) if two else (0.5,)
        length = look.handle_length * w * (0.5 if two else 1.0)
        spots = [(x0 + f * w, y0 + look.drawer_at * h) for f in shares]
        upright = False
    elif cell.hinge in ("bottom", "top"):
        far = look.inset + thick
        spots = [((x0 + x1) / 2, y0 + far if cell.hinge == "bottom" else y1 - far)]
        length, upright = max(look.handle_length, 0.3) * w, False
    else:
        far = look.inset + thick
        x = x1 - far if cell.hinge == "left" else x0 + far
        length, upright = look.handle_length * h, look.upright
        if upright:
            y = float(np.clip(y0 + look.high * h, y0 + length / 2 + 3, y1 - length / 2 - 3))
        else:
            y = y0 + look.high * h
            length = min(length, 0.35 * w)
            x += (-1 if cell.hinge == "left" else 1) * max(length / 2 - far / 2, 0)
        spots = [(x, y)]
    return tuple(_handle(sheet, x, y, float(length), thick, upright, box) for x, y in spots)


def _handle(
    sheet: _Sheet, x: float, y: float, length: float, thick: float, upright: bool, box: Box
) -> Rect:
    rng, look = sheet.rng, sheet.look
    colour = look.handle_colour
    if look.handle == "knob":
        r = max(thick * 0.9, 2.5)
        if rng.random() < 0.15:
            _disc(sheet, (x, y), 1.6 * r, np.clip(colour * 0.8, 0, 1))
        _disc(sheet, (x, y), r, colour)
        return _rect(x, y, r, r)
    if look.handle in ("ring", "drop", "plate"):
        r = max(thick, 3.5)
        if look.handle == "plate":
            _plate(sheet, (x - r, y - 1.5 * r, x + r, y + 1.5 * r), colour)
            return _rect(x, y, r, 1.5 * r)
        _disc(sheet, (x, y - r), 0.7 * r, colour)
        if look.handle == "ring":
            centre = (int(x), int(y + 0.5 * r))
            tone = tuple(float(v) for v in colour)
            cv2.circle(sheet.picture, centre, int(1.3 * r), tone, max(1, int(0.35 * r)))
        else:
            _plate(sheet, (x - 0.35 * r, y - r, x + 0.35 * r, y + 2 * r), colour)
        return _rect(x, y + 0.2 * r, 1.4 * r, 1.9 * r)
    half = max(length / 2, 6.0)
    if look.handle == "cup":
        half = min(half, 22.0)
        _blend(sheet, (x, y + 3), (half, 0.55 * half), np.zeros(3, np.float32), 0.5, True)
        _blend(sheet, (x, y), (half, 0.5 * half), colour, 1.0, True)
        return _rect(x, y, half, 0.5 * half)
    a, b = (thick / 2, half) if upright else (half, thick / 2)
    if look.handle == "slot":  # a recess
        _plate(sheet, (x - a, y - b, x + a, y + b), colour * 0.3, shadow=0.0)
        return _rect(x, y, a, b)
    if look.handle == "lip":  # a strip on the panel's own edge
        near = box[1] + b if not upright else y
        _plate(sheet, (x - a, near - b, x + a, near + b), colour, shadow=0.3)
        return _rect(x, near, a, b)
    _plate(sheet, (x - a, y - b, x + a, y + b), colour)
    for sign in (-0.85, 0.85):
        p, q = (x, y + sign * b) if upright else (x + sign * a, y)
        _blend(
            sheet, (p, q), (thick * 0.7, thick * 0.7), colour * 0.8, 0.8, bool(rng.random() < 0.5)
        )
    return _rect(x, y, a + 1, b + 1)


def _rect(x: float, y: float, a: float, b: float) -> Rect:
    return (float(x - a), float(y - b), float(x + a), float(y + b))


def _distraction(sheet: _Sheet, box: Box) -> None:
    """A dispenser, a screen, a paper, a sticker or a lock on a panel."""
    rng = sheet.rng
    x0, y0, x1, y1 = box
    w, h = x1 - x0, y1 - y0
    a, b = rng.uniform(0.05, 0.3) * w, rng.uniform(0.04, 0.25) * h
    x, y = rng.uniform(x0 + a, x1 - a), rng.uniform(y0 + b, y1 - b)
    spot = (x - a, y - b, x + a, y + b)
    _fill(sheet, spot, random_texture(rng))
    _edge(sheet, spot, sunk=bool(rng.random() < 0.5))
    if rng.random() < 0.5:
        low = (x - 0.8 * a, y, x + 0.8 * a, y + 0.8 * b)
        _shade(sheet, low, float(rng.uniform(0.1, 0.6)))


def _accidents(sheet: _Sheet, box: tuple[int, int, int, int]) -> None:
    """Papers, lettering, things in front, things on top."""
    rng = sheet.rng
    x0, y0, x1, y1 = box
    for _ in range(int(rng.poisson(0.5))):
        w, h = rng.uniform(8, 60, 2)
        x, y = rng.uniform(x0, x1 - w), rng.uniform(y0, y1 - h)
        _plate(sheet, (x, y, x + w, y + h), random_colour(rng), 0.2)
    if rng.random() < 0.15:
        at = (int(rng.uniform(x0, x1 - 40)), int(rng.uniform(y0 + 10, y1)))
        letters = "".join(rng.choice(list("ABEHKLMNORSTX"), int(rng.integers(3, 9))))
        tone = tuple(float(v) for v in random_colour(rng))
        cv2.putText(sheet.picture, letters, at, int(rng.integers(0, 5)),
                    float(rng.uniform(0.3, 0.8)), tone, 1, cv2.LINE_AA)  # fmt: skip
    if rng.random() < 0.12:  # a plant, a leg, a ball in front of it
        colour = random_colour(rng)
        n = int(rng.integers(1, 14))
        foot = np.array([rng.uniform(x0, x1), y1 + rng.uniform(-60, 20)])
        for _ in range(n):
            tip = foot + rng.normal(0, 1, 2) * [30, 45] - [0, 40]
            _blend(sheet, (tip + foot) / 2, (rng.uniform(3, 14), rng.uniform(6, 30)), colour, 1.0,
                   bool(rng.random() < 0.7))  # fmt: skip
    if rng.random() < 0.2:
        for _ in range(int(rng.integers(1, 4))):
            x, w, h = rng.uniform(x0, x1), rng.uniform(6, 40), rng.uniform(10, 55)
            _plate(sheet, (x - w, y0 - h, x + w, y0 + rng.uniform(-2, 5)), random_colour(rng), 0.3)


def _lit(sheet: _Sheet) -> Picture:
    """Uneven light, hard shadows, gloss and reflections over the whole."""
    rng, p = sheet.rng, sheet.picture
    h, w = p.shape[:2]

    def soft(n: int, low: float, high: float) -> Picture:
        grid = rng.uniform(low, high, (n, n)).astype(np.float32)
        out = cv2.resize(grid, (w, h), interpolation=cv2.INTER_CUBIC)
        return np.asarray(out, np.float32)[..., None]

    p = p * soft(int(rng.integers(2, 5)), float(rng.uniform(0.4, 0.95)), 1.1)
    if rng.random() < 0.25:  # a shadow's edge
        corner = rng.uniform(0, 1, (4, 2)) * [w, h] * 1.4 - [0.2 * w, 0.2 * h]
        mask = np.zeros((h, w), np.float32)
        cv2.fillPoly(mask, [corner.astype(np.int32)], 1.0)
        soft_mask = np.asarray(
            cv2.GaussianBlur(mask, (0, 0), float(rng.uniform(1, 12))), np.float32
        )
        p = p * (1 - soft_mask[..., None] * float(rng.uniform(0.1, 0.5)))
    if rng.random() < 0.35:  # gloss
        p = p + float(rng.uniform(0.05, 0.35)) * np.clip(soft(4, -1.5, 1.0), 0, 1)
    if rng.random() < 0.15:  # a window mirrored
        x, y = rng.uniform(0, w), rng.uniform(0, h)
        a, b = rng.uniform(10, 0.3 * w), rng.uniform(10, 0.3 * h)
        mask = np.zeros((h, w), np.float32)
        cv2.rectangle(mask, (int(x - a), int(y - b)), (int(x + a), int(y + b)), 1.0, -1)
        soft_mask = np.asarray(cv2.GaussianBlur(mask, (0, 0), float(rng.uniform(1, 8))), np.float32)
        p = p + soft_mask[..., None] * float(rng.uniform(0.05, 0.3))
    return np.asarray(p, np.float32)


def _taken(rng: np.random.Generator, picture: Picture) -> NDArray[np.uint8]:
    """Exposure, white balance, blur, noise and JPEG."""
    p = np.clip(picture, 0, 1.3) * float(rng.uniform(0.6, 1.25))
    p = p * rng.normal(1.0, 0.06, 3).astype(np.float32)
    p = np.clip(p, 0, 1) ** float(np.exp(rng.normal(0, 0.25)))
    if rng.random() < 0.6:
        p = np.asarray(cv2.GaussianBlur(p, (0, 0), float(rng.uniform(0.4, 2.2))), np.float32)
    p = p * 255 + rng.normal(0, rng.uniform(0.3, 6.0), p.shape).astype(np.float32)
    out = np.clip(p, 0, 255).astype(np.uint8)
    if rng.random() < 0.8:
        packed = cv2.imencode(".jpg", out, [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(35, 95))])[1]
        out = np.asarray(cv2.imdecode(packed, 1), np.uint8)
    return out
