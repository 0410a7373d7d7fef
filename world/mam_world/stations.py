"""Task stations of a laboratory: one or more mechanisms on a board, wall, box, table or post."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mam_pipeline.types import FloatArray
from mam_world import shapes
from mam_world.fixtures import MECHANISMS, PAINTS, decoy
from mam_world.kit import Builder
from mam_world.mech import studs
from mam_world.solids import profile, settle

SUPPORTS = ("board", "wall", "box", "table", "post", "console", "bracket")
Cells = list[tuple[FloatArray, float]]  # (4, 4) frame on a surface, and the room around it


def _grid(b: Builder, s: float, n: int) -> tuple[list[tuple[float, float]], float, float]:
    """Middles of n cells of half size s in rows, and half the extents of the whole field."""
    columns = b.integer(1, n) if n < 4 else b.integer(2, n)
    rows = -(-n // columns)
    pitch = 2 * s * b.uniform(1.05, 1.5)
    spots = [((i - (rows - 1) / 2) * pitch, (j - (columns - 1) / 2) * pitch)
             for i in range(rows) for j in range(columns)]  # fmt: skip
    return spots, rows * pitch / 2, columns * pitch / 2


def support(b: Builder, kind: str, s: float, n: int) -> Cells:
    """Draw what carries n mechanisms of half size s; returns where they go."""
    spots, hu, hv = _grid(b, s, n)
    hu, hv = hu * b.uniform(1.0, 1.6), hv * b.uniform(1.0, 1.6)
    t = s * b.uniform(0.1, 0.6)
    if kind in ("wall", "bracket"):
        return _upright(b, kind, spots, hu, hv, t, s)
    if kind == "console":
        return _console(b, spots, hu, hv, s)
    z = t
    if kind == "table":
        z = s * b.uniform(2, 8)
        b.box("base", (-hu, -hv, z - t), (hu, hv, z), "body")
        leg = min(0.12 * min(hu, hv), t)
        for x in (-hu + leg, hu - leg):
            for y in (-hv + leg, hv - leg):
                b.block("base", (x, y, (z - t) / 2), (2 * leg, 2 * leg, z - t), "trim")
    elif kind == "post":
        z = s * b.uniform(1.5, 10)
        b.box("base", (-1.2 * hu, -1.2 * hv, 0), (1.2 * hu, 1.2 * hv, 0.2 * s), "trim")
        r = min(hu, hv) * b.uniform(0.2, 0.6)
        b.cylinder("base", (0, 0, 0.2 * s), (0, 0, z - t), r, None, "metal", sides=b.choice((4, 0)))
        b.box("base", (-hu, -hv, z - t), (hu, hv, z), "body")
    else:
        z = t if kind == "board" else s * b.uniform(0.8, 3)
        b.box("base", (-hu, -hv, 0), (hu, hv, z), "body")
        if b.chance(0.5):
            corners = [(x * 0.9 * hu, y * 0.9 * hv, z) for x in (-1, 1) for y in (-1, 1)]
            if hu > 1.3 * s and hv > 1.3 * s:
                studs(b, corners, (0, 0, 1), 0.04 * s)
    turn = b.choice(((1, 0, 0), (1, 0, 0), (0, 1, 0), (-1, 0, 0), (0, -1, 0)))
    return [(shapes.frame((u, v, z), (0, 0, 1), turn), s) for u, v in spots]


def _upright(
    b: Builder, kind: str, spots: list, hu: float, hv: float, t: float, s: float
) -> Cells:  # fmt: skip
    """A slab that faces the viewer: bare, on a foot plate, between returns, or on a bracket."""
    lift = s * b.choice((0.0, 0.0, b.uniform(0.5, 4)))
    top = lift + 2 * hu
    b.box("base", (0, -hv, 0 if kind == "wall" else lift), (t, hv, top), "body")
    if kind == "bracket":
        b.box("base", (t, -0.4 * hv, 0), (t + 0.5 * s, 0.4 * hv, top), "trim")
        b.box("base", (-s, -1.1 * hv, 0), (t + 2 * s, 1.1 * hv, 0.15 * s), "trim")
    elif b.chance(0.3):
        b.box("base", (-2 * s, -1.2 * hv, 0), (t, 1.2 * hv, min(0.1 * s, max(lift, 0.02 * s))))
    if b.chance(0.2):
        y = hv * b.uniform(1.0, 1.1) + 1.5 * s
        side = b.choice((-1, 1))
        b.box("base", (0, min(side * hv, side * y), 0), (t, max(side * hv, side * y), top), "body")
        b.block("base", (-1.5 * s, side * (y + t / 2), top / 2), (3 * s + 2 * t, t, top), "body")
    along = b.choice(((0, 0, 1), (0, 0, 1), (0, 1, 0), (0, 0, -1), (0, -1, 0)))
    return [(shapes.frame((0, v, lift + hu + u), (-1, 0, 0), along), s) for u, v in spots]


def _console(b: Builder, spots: list, hu: float, hv: float, s: float) -> Cells:
    """A desk-shaped housing whose field slopes towards the viewer."""
    slope, low = b.uniform(0.2, 1.0), s * b.uniform(0.6, 2)
    dx, dz = 2 * hu * np.cos(slope), 2 * hu * np.sin(slope)
    back = dx * b.uniform(1.0, 1.4)
    side = [(0, 0), (back, 0), (back, low + dz), (dx, low + dz), (0, low)]
    if back - dx < 1e-3:
        side.pop(2)
    profile(b, "base", side, -hv, hv, "y", "body")
    along, normal = np.array([np.cos(slope), 0, np.sin(slope)]), (-np.sin(slope), 0, np.cos(slope))
    first = np.array([0, 0, low])
    return [(shapes.frame(first + along * (hu + u) + (0, v, 0), normal, along), s)
            for u, v in spots]  # fmt: skip


def _station(b: Builder, names: list[str], extra: int, supports: tuple[str, ...]) -> None:
    """Mechanisms of these names and fixed things, shuffled over one support."""
    s = float(np.exp(b.uniform(np.log(0.02), np.log(0.18))))
    kind = b.choice(supports)
    n = len(names) + extra
    b.size(2 * s * n**0.5, 2 * s * n**0.5, 2 * s)
    b.theme()
    cells = support(b, kind, s, n)
    order = b.rng.permutation(len(cells))
    for k, name in zip(order, names, strict=False):
        with b.at(cells[k][0]):
            MECHANISMS[name](b, s)
    for k in order[len(names) : n]:
        with b.at(cells[k][0]):
            decoy(b, s)
    settle(b)


def _single(name: str) -> Callable[[Builder], None]:
    def build(b: Builder) -> None:
        """One mechanism among fixed things."""
        _station(b, [name], b.choice((0, 0, 0, 1, 2, 4)), SUPPORTS)

    return build


def task_board(b: Builder) -> None:
    """Two to five mechanisms of different kinds on one board, wall, box, table or console."""
    names = list(MECHANISMS)
    n = b.choice((2, 2, 3, 3, 4, 5))
    drawn = [names[k] for k in b.rng.choice(len(names), n, replace=b.chance(0.2))]
    _station(b, drawn, b.integer(0, 3), ("board", "wall", "box", "table", "console"))


def play_table(b: Builder) -> None:
    """A work table with a drawer below, a sliding shutter at its back, and mechanisms on top."""
    w, d, h, t = b.uniform(0.5, 1.4), b.uniform(0.35, 0.7), b.uniform(0.3, 0.8), 0.03
    b.size(d, w, 1.4 * h)
    b.theme(b.choice(("wood", "wood", "white", "paint", "steel")))
    box = b.uniform(0.1, 0.35) * h  # height of the frame below the top
    low = h - t - box
    b.box("base", (0, -w / 2, h - t), (d, w / 2, h), "body")
    b.box("base", (d - t, -w / 2, low), (d, w / 2, h - t), "body")
    b.box("base", (0, -w / 2, low), (d - t, -w / 2 + t, h - t), "body")
    b.box("base", (0, w / 2 - t, low), (d - t, w / 2, h - t), "body")
    b.box("base", (0, -w / 2 + t, low - 0.5 * t), (d - t, w / 2 - t, low), "body")
    for x in (t, d - t):
        for y in (-w / 2 + t, w / 2 - t):
            b.block("base", (x, y, (low - 0.5 * t) / 2), (1.5 * t, 1.5 * t, low - 0.5 * t), "trim")
    if b.chance(0.8):
        _table_drawer(b, w - 2 * t, d, low, box)
    free = d - t
    if b.chance(0.75):
        free = _back_shutter(b, w, d, h, t)
    s = min(0.09, 0.22 * free)
    n = int(min(b.integer(1, 4), (w - 0.1) // (2.3 * s)))
    ys = (np.arange(n) - (n - 1) / 2) * (w - 0.1) / max(n, 1)
    names = [m for m in MECHANISMS if m not in ("pull", "pedal")]
    for y in ys:
        with b.at(shapes.frame((0.3 * free, y, h), (0, 0, 1), (1, 0, 0))):
            if b.chance(0.55) or (y == ys[-1] and len(b.links) == 1):  # something must move
                MECHANISMS[b.choice(names)](b, s)
            else:
                decoy(b, s)
    for _ in range(b.integer(0, 3)):
        at = (0.75 * free, b.uniform(-0.4, 0.4) * w, h + 0.2 * s)
        b.block("base", at, (0.4 * s, 0.4 * s, 0.4 * s), b.choice(PAINTS), "content")
    settle(b)


def _table_drawer(b: Builder, w: float, d: float, low: float, box: float) -> None:
    """A drawer that fills the frame below the top, or half of it."""
    half = w / 2 if b.chance(0.6) else w / 4
    g = max(b.gap, 0.002)
    link = b.link("drawer", "drawer")
    mid = 0.0 if half == w / 2 else b.choice((-1, 1)) * w / 4
    y0, y1 = mid - half + g, mid + half - g
    if half < w / 2:  # the other half is closed by a fixed front of the same look
        other = sorted((-np.sign(mid) * g / 2, -np.sign(mid) * w / 2))
        b.box("base", (-0.02, other[0], low), (0, other[1], low + box), "front")
    b.box(link, (-0.02, y0, low + g), (0.0, y1, low + box - g), "front", "panel")
    long = d * b.uniform(0.6, 0.85)
    b.drawer_box(link, (0, y0 + g, low + g), (long, y1 - g, low + box * 0.85))
    kind = b.choice(("bar", "bow", "knob", "none", "strip"))
    at = (-0.02, mid, low + box / 2)
    b.handle(link, at, (-1, 0, 0), (0, 1, 0), min(0.15, 0.4 * half), kind)
    b.slide(link, "base", (-1, 0, 0), 0.0, long * b.uniform(0.5, 0.85))


def _back_shutter(b: Builder, w: float, d: float, h: float, t: float) -> float:
    """An open case along the back edge with a shutter that slides sideways before it."""
    deep, tall = b.uniform(0.12, 0.25) * d, b.uniform(0.15, 0.4)
    x0, g = d - deep, max(b.gap, 0.002)
    b.shell("base", (x0, -w / 2, h), (d, w / 2, h + tall), 0.5 * t, "-x", "body", "panel")
    b.box("base", (x0, -0.25 * t, h + 0.5 * t), (d - 0.5 * t, 0.25 * t, h + tall - 0.5 * t))
    rail = 0.3 * t
    for z in (h, h + tall - rail):
        b.box("base", (x0 - 0.9 * t, -w / 2, z), (x0 - 0.6 * t, w / 2, z + rail), "metal")
    link = b.link("shutter", "door")
    side = b.choice((-1, 1))
    y = side * (0.25 * w - t)
    half = 0.22 * w
    low, high = (x0 - 0.6 * t + g, y - half, h + g), (x0 - g, y + half, h + tall - g)
    if high[0] - low[0] < 0.1 * t:
        low, high = (x0 - 0.45 * t, *low[1:]), (x0 - 0.15 * t, *high[1:])
    b.panel(link, low, high, b.choice(("front", "accent", "glass")))
    at = (low[0], y + side * 0.6 * half, h + tall / 2)
    b.handle(link, at, (-1, 0, 0), (0, 0, 1), 0.4 * tall, b.choice(("bar", "bow", "knob")))
    b.slide(link, "base", (0, -side, 0), 0.0, 2 * abs(y))
    return x0 - 0.1


CATEGORIES: dict[str, Callable[[Builder], None]] = {
    "task_board": task_board,
    "play_table": play_table,
    **{f"station_{name}": _single(name) for name in MECHANISMS},
}
