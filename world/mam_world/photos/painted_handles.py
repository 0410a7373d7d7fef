"""Handles on painted fronts: knobs, bars, cups, rings, drops, plates, slots and lips."""

from __future__ import annotations

import cv2
import numpy as np

from mam_world.photos.front_layout import Box, FrontCell
from mam_world.photos.painted_sheet import Sheet, blend, disc, plate
from mam_world.photos.truth import Rect


def handles(sheet: Sheet, box: Box, cell: FrontCell) -> tuple[Rect, ...]:
    """Draw the handles of a panel; their boxes in pixels."""
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
    sheet: Sheet, x: float, y: float, length: float, thick: float, upright: bool, box: Box
) -> Rect:
    rng, look = sheet.rng, sheet.look
    colour = look.handle_colour
    if look.handle == "knob":
        r = max(thick * 0.9, 2.5)
        if rng.random() < 0.15:
            disc(sheet, (x, y), 1.6 * r, np.clip(colour * 0.8, 0, 1))
        disc(sheet, (x, y), r, colour)
        return _rect(x, y, r, r)
    if look.handle in ("ring", "drop", "plate"):
        r = max(thick, 3.5)
        if look.handle == "plate":
            plate(sheet, (x - r, y - 1.5 * r, x + r, y + 1.5 * r), colour)
            return _rect(x, y, r, 1.5 * r)
        disc(sheet, (x, y - r), 0.7 * r, colour)
        if look.handle == "ring":
            centre = (int(x), int(y + 0.5 * r))
            tone = tuple(float(v) for v in colour)
            cv2.circle(sheet.picture, centre, int(1.3 * r), tone, max(1, int(0.35 * r)))
        else:
            plate(sheet, (x - 0.35 * r, y - r, x + 0.35 * r, y + 2 * r), colour)
        return _rect(x, y + 0.2 * r, 1.4 * r, 1.9 * r)
    half = max(length / 2, 6.0)
    if look.handle == "cup":
        half = min(half, 22.0)
        blend(sheet, (x, y + 3), (half, 0.55 * half), np.zeros(3, np.float32), 0.5, True)
        blend(sheet, (x, y), (half, 0.5 * half), colour, 1.0, True)
        return _rect(x, y, half, 0.5 * half)
    a, b = (thick / 2, half) if upright else (half, thick / 2)
    if look.handle == "slot":  # a recess
        plate(sheet, (x - a, y - b, x + a, y + b), colour * 0.3, shadow=0.0)
        return _rect(x, y, a, b)
    if look.handle == "lip":  # a strip on the panel's own edge
        near = box[1] + b if not upright else y
        plate(sheet, (x - a, near - b, x + a, near + b), colour, shadow=0.3)
        return _rect(x, near, a, b)
    plate(sheet, (x - a, y - b, x + a, y + b), colour)
    for sign in (-0.85, 0.85):
        p, q = (x, y + sign * b) if upright else (x + sign * a, y)
        blend(
            sheet, (p, q), (thick * 0.7, thick * 0.7), colour * 0.8, 0.8, bool(rng.random() < 0.5)
        )
    return _rect(x, y, a + 1, b + 1)


def _rect(x: float, y: float, a: float, b: float) -> Rect:
    return (float(x - a), float(y - b), float(x + a), float(y + b))
