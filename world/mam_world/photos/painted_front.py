"""Painted furniture fronts with exact truth: the flat pictures that the front network learns from.

A front is drawn as a person sees it straight on: boards, gaps, mouldings, planks, glass, handles,
controls, papers and shadows, in materials and light drawn at random far wider than any catalogue.
It takes some 20 ms, against seconds for a rendered photo; the bend of a badly fitted box, blur,
noise and JPEG come last. Nothing is copied from any picture.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from mam_world.photos.front_layout import Box, FrontCell, random_cells
from mam_world.photos.painted_handles import handles
from mam_world.photos.painted_sheet import (
    Look,
    Picture,
    Sheet,
    blend,
    disc,
    edge,
    fill,
    plate,
    shade,
    shadow_below,
    slices,
)
from mam_world.photos.surface_texture import Texture, random_colour, random_texture
from mam_world.photos.truth import PanelTruth, Rect

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


def paint_front(rng: np.random.Generator) -> PaintedFront:
    """Paint one front."""
    aspect = float(np.exp(rng.normal(0.0, 0.5)))
    w, h = (LONG, LONG / aspect) if aspect > 1 else (LONG * aspect, LONG)
    w, h = max(int(w), 150), max(int(h), 150)
    room = random_texture(rng).draw(rng, h + 2 * MARGIN, w + 2 * MARGIN)
    if rng.random() < 0.4:
        floor = int(MARGIN + h - rng.uniform(-10, 30))
        room[floor:] = random_texture(rng).draw(rng, h + 2 * MARGIN, w + 2 * MARGIN)[floor:]
    box = (MARGIN, MARGIN, MARGIN + w, MARGIN + h)
    sheet, _ = draw_front(rng, room, box)
    _accidents(sheet, box)
    picture = lit(rng, sheet.picture)
    corners = np.array([[box[0], box[1]], [box[2], box[1]], [box[2], box[3]], [box[0], box[3]]])
    panels = tuple(_in_front(p, box) for p in sheet.panels)
    return PaintedFront(taken(rng, picture), corners.astype(np.float64), panels)


def draw_front(
    rng: np.random.Generator, room: Picture, box: tuple[int, int, int, int], legs: float = 0.25
) -> tuple[Sheet, Texture]:
    """Draw a front into a rectangle of a picture, by even light; also what its body is made of.

    Args:
        room: (h, w, 3) what is around it; drawn over.
        legs: share of fronts with a high plinth that stand on legs instead.
    """
    look = _random_look(rng, min(box[2] - box[0], box[3] - box[1]))
    sheet = Sheet(rng, room, look, (float(rng.uniform(-1, 1)), float(rng.uniform(-0.2, 1))))
    body = random_texture(rng)
    material = body if rng.random() < 0.75 else random_texture(rng)
    fill(sheet, box, body)
    area = _carcass(sheet, box, body, legs)
    for cell in random_cells(rng, area):
        _cell(sheet, cell, material, body)
    return sheet, body


def _in_front(panel: PanelTruth, box: Box) -> PanelTruth:
    w, h = box[2] - box[0], box[3] - box[1]

    def scaled(r: Rect) -> Rect:
        return (
            (r[0] - box[0]) / w, (r[1] - box[1]) / h, (r[2] - box[0]) / w, (r[3] - box[1]) / h,
        )  # fmt: skip

    return replace(panel, rect=scaled(panel.rect), handles=tuple(scaled(r) for r in panel.handles))


def _random_look(rng: np.random.Generator, side: int) -> Look:
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
    return Look(
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
    sheet: Sheet, box: tuple[int, int, int, int], body: Texture, legs: float
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
        fill(sheet, board, random_texture(rng) if rng.random() < 0.4 else body)
        edge(sheet, board)
        shadow_below(sheet, board, float(rng.uniform(2, 14)))
    if bottom > 8 and rng.random() < 0.4:
        plinth = (x0, int(y1 - bottom), x1, y1)
        shade(sheet, plinth, float(rng.uniform(0.2, 1.0)))
    if bottom > 14 and rng.random() < legs:  # legs: the room shows between
        leg = float(rng.uniform(6, 18))
        dark = random_texture(rng).draw(rng, int(bottom), x1 - x0)
        low = sheet.picture[int(y1 - bottom) : int(y1 - bottom) + int(bottom), x0:x1]
        middle = slice(int(leg), int(x1 - x0 - leg))
        low[:, middle] = dark[: len(low), middle] * float(rng.uniform(0.2, 0.9))
    return x0 + left, y0 + top, x1 - right, y1 - bottom


def _gap(sheet: Sheet, box: Box) -> None:
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
        shade(sheet, (a, b, max(c, a + 1), max(d, b + 1)), 1.0 - look.gap_dark)


def _cell(sheet: Sheet, cell: FrontCell, material: Texture, body: Texture) -> None:
    rng, look = sheet.rng, sheet.look
    reveal = float(rng.uniform(0, 5)) if look.inset > 13 else look.gap
    x0, y0, x1, y1 = cell.rect
    box = (x0 + reveal / 2, y0 + reveal / 2, x1 - reveal / 2, y1 - reveal / 2)
    if min(box[2] - box[0], box[3] - box[1]) < 16:
        return
    if cell.kind == "open":
        return hollow(sheet, box)
    if cell.kind == "control":
        return _controls(sheet, box, material)
    if cell.kind == "fixed":
        return fill(sheet, box, body)
    if reveal > look.gap + 1 or rng.random() < 0.5:
        shade(sheet, cell.rect, 1.0 - look.gap_dark * float(rng.uniform(0.3, 1.0)))
    fill(sheet, box, material)
    shade(sheet, box, float(rng.normal(1.0, 0.02)))
    _gap(sheet, box)
    edge(sheet, box)
    _inside_of_panel(sheet, box, cell)
    drawn = handles(sheet, box, cell)
    sheet.panels.append(PanelTruth(cell.kind, tuple(map(float, box)), cell.hinge, drawn))  # type: ignore[arg-type]
    if rng.random() < 0.06:
        _distraction(sheet, box)
    return None


def hollow(sheet: Sheet, box: Box) -> None:
    rng = sheet.rng
    shade(sheet, box, float(rng.uniform(0.15, 0.7)))
    rows, columns = slices(box)
    part = sheet.picture[rows, columns]
    ramp = np.linspace(float(rng.uniform(0.4, 1.0)), 1.0, max(len(part), 1), dtype=np.float32)
    part *= ramp[:, None, None]
    x0, y0, x1, y1 = box
    for _ in range(int(rng.integers(0, 7))):
        w, h = rng.uniform(6, 0.4 * (x1 - x0) + 7), rng.uniform(6, 0.7 * (y1 - y0) + 7)
        x = rng.uniform(x0, max(x1 - w, x0 + 1))
        thing = (x, max(y1 - h, y0), min(x + w, x1), y1)
        fill(sheet, thing, random_texture(rng))
        shade(sheet, thing, float(rng.uniform(0.3, 0.9)))


def _controls(sheet: Sheet, box: Box, material: Texture) -> None:
    rng = sheet.rng
    fill(sheet, box, material if rng.random() < 0.6 else random_texture(rng))
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
            disc(sheet, (x, y), r, random_colour(rng))
        else:
            plate(sheet, (x - 1.5 * r, y - r, x + 1.5 * r, y + r), random_colour(rng))
    edge(sheet, box, 0.1)


def _inside_of_panel(sheet: Sheet, box: Box, cell: FrontCell) -> None:
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
            shade(sheet, line, 1.0 - 0.7 * look.relief)
        if inner is field_:
            edge(sheet, field_, sunk=True)
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
            fill(sheet, part, random_texture(rng, "weave"))
        else:
            shade(sheet, part, float(rng.uniform(0.9, 1.05)))
        edge(sheet, part, sunk=True)
        if kind == "raised":
            m = float(rng.uniform(4, 14))
            edge(sheet, (part[0] + m, part[1] + m, part[2] - m, part[3] - m))


def _glass(sheet: Sheet, box: Box) -> None:
    rng = sheet.rng
    fill(sheet, box, Texture("plain", np.full(3, rng.uniform(0.02, 0.5), np.float32)))
    rows, columns = slices(box)
    part = sheet.picture[rows, columns]
    if not part.size:
        return
    small = rng.uniform(0, 1, (5, 5, 3)).astype(np.float32)
    mirrored = cv2.resize(small, (part.shape[1], part.shape[0]), interpolation=cv2.INTER_CUBIC)
    part += float(rng.uniform(0, 0.3)) * mirrored
    x0, y0, x1, y1 = box
    for _ in range(int(rng.integers(0, 3))):  # boards behind
        y = rng.uniform(y0, y1)
        shade(sheet, (x0, y, x1, y + rng.uniform(2, 6)), float(rng.uniform(0.5, 1.6)))
    if rng.random() < 0.3:  # bars
        n = int(rng.integers(2, 4))
        for k in range(1, n):
            x = x0 + k / n * (x1 - x0)
            shade(sheet, (x - 2, y0, x + 2, y1), float(rng.uniform(1.2, 2.5)))


def _distraction(sheet: Sheet, box: Box) -> None:
    """A dispenser, a screen, a paper, a sticker or a lock on a panel."""
    rng = sheet.rng
    x0, y0, x1, y1 = box
    w, h = x1 - x0, y1 - y0
    a, b = rng.uniform(0.05, 0.3) * w, rng.uniform(0.04, 0.25) * h
    x, y = rng.uniform(x0 + a, x1 - a), rng.uniform(y0 + b, y1 - b)
    spot = (x - a, y - b, x + a, y + b)
    fill(sheet, spot, random_texture(rng))
    edge(sheet, spot, sunk=bool(rng.random() < 0.5))
    if rng.random() < 0.5:
        low = (x - 0.8 * a, y, x + 0.8 * a, y + 0.8 * b)
        shade(sheet, low, float(rng.uniform(0.1, 0.6)))


def _accidents(sheet: Sheet, box: tuple[int, int, int, int]) -> None:
    """Papers, lettering, things in front, things on top."""
    rng = sheet.rng
    x0, y0, x1, y1 = box
    for _ in range(int(rng.poisson(0.5))):
        w, h = rng.uniform(8, 60, 2)
        x, y = rng.uniform(x0, x1 - w), rng.uniform(y0, y1 - h)
        plate(sheet, (x, y, x + w, y + h), random_colour(rng), 0.2)
    if rng.random() < 0.15:
        at = (int(rng.uniform(x0, x1 - 40)), int(rng.uniform(y0 + 10, y1)))
        letters = "".join(rng.choice(list("ABEHKLMNORSTX"), int(rng.integers(3, 9))))
        tone, drawn = random_colour(rng), np.zeros(sheet.picture.shape[:2], np.uint8)
        cv2.putText(drawn, letters, at, int(rng.integers(0, 5)), float(rng.uniform(0.3, 0.8)), 255,
                    1, cv2.LINE_AA)  # fmt: skip
        cover = (drawn / np.float32(255))[..., None]
        sheet.picture += cover * (tone - sheet.picture)
    if rng.random() < 0.12:  # a plant, a leg, a ball in front of it
        colour = random_colour(rng)
        n = int(rng.integers(1, 14))
        foot = np.array([rng.uniform(x0, x1), y1 + rng.uniform(-60, 20)])
        for _ in range(n):
            tip = foot + rng.normal(0, 1, 2) * [30, 45] - [0, 40]
            blend(sheet, (tip + foot) / 2, (rng.uniform(3, 14), rng.uniform(6, 30)), colour, 1.0,
                   bool(rng.random() < 0.7))  # fmt: skip
    if rng.random() < 0.2:
        for _ in range(int(rng.integers(1, 4))):
            x, w, h = rng.uniform(x0, x1), rng.uniform(6, 40), rng.uniform(10, 55)
            plate(sheet, (x - w, y0 - h, x + w, y0 + rng.uniform(-2, 5)), random_colour(rng), 0.3)


def lit(rng: np.random.Generator, p: Picture) -> Picture:
    """A picture (h, w, 3) by uneven light, with hard shadows, gloss and reflections."""
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


def taken(rng: np.random.Generator, picture: Picture) -> NDArray[np.uint8]:
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
