"""A sheet to paint fronts on: fills, shades, lit edges, shadows, discs and plates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mam_world.photos.front_layout import Box
from mam_world.photos.surface_texture import Texture
from mam_world.photos.truth import PanelTruth

Picture = NDArray[np.float32]
Colour = NDArray[np.float32]


@dataclass(frozen=True)
class Look:
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
class Sheet:
    """The picture that is being painted (h, w, 3), what it shares, and the panels drawn so far."""

    rng: np.random.Generator
    picture: Picture
    look: Look
    light: tuple[float, float]
    panels: list[PanelTruth] = field(default_factory=list)


def slices(box: Box) -> tuple[slice, slice]:
    """Rows and columns of a rectangle."""
    x0, y0, x1, y1 = (round(v) for v in box)
    return slice(max(y0, 0), max(y1, 0)), slice(max(x0, 0), max(x1, 0))


def fill(sheet: Sheet, box: Box, texture: Texture) -> None:
    """Cover a rectangle with a surface."""
    rows, columns = slices(box)
    part = sheet.picture[rows, columns]
    if part.size:
        part[:] = texture.draw(sheet.rng, part.shape[0], part.shape[1])


def shade(sheet: Sheet, box: Box, factor: float) -> None:
    """Darken or brighten a rectangle."""
    rows, columns = slices(box)
    sheet.picture[rows, columns] *= factor


def edge(sheet: Sheet, box: Box, strength: float | None = None, sunk: bool = False) -> None:
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
        shade(sheet, part, float(np.clip(1.0 + sign * k * amount, 0.2, 1.8)))


def shadow_below(sheet: Sheet, box: Box, length: float) -> None:
    """The shadow that a board casts, this many pixels long."""
    x0, _, x1, y1 = (round(v) for v in box)
    n = max(1, round(length))
    part = sheet.picture[y1 : y1 + n, x0:x1]
    ramp = np.linspace(float(sheet.rng.uniform(0.35, 0.9)), 1.0, n, dtype=np.float32)
    part *= ramp[: len(part), None, None]


def disc(sheet: Sheet, at: Sequence[float], r: float, colour: Colour) -> None:
    """A round knob with its shadow and gleam."""
    x, y = at
    d = sheet.rng.uniform(0.1, 0.6) * r
    blend(sheet, (x + d * sheet.light[0], y + abs(d)), (r, r), np.zeros(3, np.float32), 0.45, True)
    blend(sheet, (x, y), (r, r), np.asarray(colour), 1.0, True)
    blend(sheet, (x - 0.3 * r * sheet.light[0], y - 0.3 * r), (0.45 * r, 0.45 * r),
           np.clip(np.asarray(colour) * 1.5 + 0.1, 0, 1), 0.6, True)  # fmt: skip


def plate(sheet: Sheet, box: Box, colour: Colour, shadow: float = 0.45) -> None:
    """A rectangular piece with its shadow and a gleam along it."""
    x0, y0, x1, y1 = box
    centre, half = ((x0 + x1) / 2, (y0 + y1) / 2), ((x1 - x0) / 2, (y1 - y0) / 2)
    d = float(sheet.rng.uniform(1, 6))
    if shadow:
        blend(sheet, (centre[0] + d * sheet.light[0], centre[1] + d), half,
               np.zeros(3, np.float32), shadow, False)  # fmt: skip
    blend(sheet, centre, half, np.asarray(colour), 1.0, False)
    thin = (half[0], max(half[1] * 0.3, 0.5)) if half[0] > half[1] else (
        max(half[0] * 0.3, 0.5), half[1])  # fmt: skip
    bright = np.clip(np.asarray(colour) * 1.4 + 0.08, 0, 1)
    blend(sheet, centre, thin, bright, float(sheet.rng.uniform(0, 0.8)), False)


def blend(
    sheet: Sheet,
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
