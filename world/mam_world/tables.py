"""Tables and desks with drawers under the top, in pedestals, or behind small doors."""

from __future__ import annotations

import numpy as np

from mam_world import cabinetry as c
from mam_world.kit import Builder


def _top(b: Builder, width: float, depth: float, z: float, reach: float) -> float:
    """The table top with its underside at z; returns the underside again."""
    thick = b.uniform(0.02, 0.045)
    paint = b.choice(["body", "trim", "wood", "stone", "glass"], [0.4, 0.25, 0.2, 0.1, 0.05])
    b.panel("base", (-reach, -width / 2, z), (depth, width / 2, z + thick), paint)
    return z


def _legs(b: Builder, width: float, depth: float, z: float, low: float) -> None:
    """Four legs of a drawn kind between the floor and z, with stretchers or not."""
    kind, r = b.choice(["square", "round", "tapered", "frame"]), b.uniform(0.015, 0.035)
    ys, xs = (-width / 2 + low + r, width / 2 - low - r), (low + r, depth - low - r)
    for y in ys:
        for x in xs:
            if kind in ("square", "frame"):
                b.block("base", (x, y, z / 2), (2 * r, 2 * r, z), "trim")
            else:
                b.cylinder("base", (x, y, 0), (x, y, z), r * (0.6 if kind == "tapered" else 1), r,
                           "trim")  # fmt: skip
    if kind == "frame" or b.chance(0.2):
        for y in ys:
            b.box("base", (xs[0] + r, y - 0.6 * r, 0.1), (xs[1] - r, y + 0.6 * r, 0.1 + 1.4 * r),
                  "trim")  # fmt: skip


def table_with_drawers(b: Builder) -> None:
    """Legs, an apron with one to three drawers, a top."""
    w, d, h = b.uniform(0.6, 1.6), b.uniform(0.4, 0.8), b.uniform(0.4, 0.95)
    b.size(w, d, h)
    m = c.draw_manner(b)
    apron = b.uniform(0.09, 0.2)
    z0 = h - apron
    cell = c.carcass(b, m, w - 0.08, d - 0.04, z0, h, top=b.chance(0.5))
    _legs(b, w - 0.08, d - 0.04, z0, 0.0)
    _top(b, w, d, h, b.uniform(0.0, 0.04) + m.front)
    count = int(np.clip(round(cell.width / b.uniform(0.35, 0.8)), 1, 3))
    parts = c.cut(b, m, cell, d - 0.04, "y", [1.0] * count)
    blank = count > 1 and b.chance(0.15)
    for k, part in enumerate(parts):
        if blank and k == count // 2:
            c.fill(b, m, part, d - 0.04, "blank")
        else:
            c.drawer(b, m, part, d - 0.04)
    if b.chance(0.25):
        b.panel("base", (0.05, -w / 2 + 0.1, 0.15), (d - 0.09, w / 2 - 0.1, 0.17), "trim")


def _pedestal(b: Builder, m: c.Manner, middle: float, width: float, depth: float, h: float,
              what: str) -> None:  # fmt: skip
    low = b.choice([0.0, 0.04, 0.1])
    if low:
        b.feet("base", (0, middle - width / 2), (depth, middle + width / 2), low, "square",
               inset=0.01)  # fmt: skip
    cell = c.carcass(b, m, width, depth, low, h, middle=middle)
    c.fill(b, m, cell, depth, what)


def desk(b: Builder) -> None:
    """A writing desk: one or two pedestals of drawers or a door, sometimes a flat drawer."""
    w, d, h = b.uniform(1.0, 1.8), b.uniform(0.5, 0.8), b.uniform(0.68, 0.8)
    b.size(w, d, h)
    m = c.draw_manner(b)
    depth, p = d - 0.03, b.uniform(0.32, 0.48)
    _top(b, w, d, h, b.uniform(0.0, 0.04) + m.front)
    left, right = w / 2 - p / 2 - 0.01, -w / 2 + p / 2 + 0.01
    both = b.chance(0.4)
    first = b.choice(["drawers", "drawers", "left", "right"])
    middles = [left, right] if both else [b.choice([left, right])]
    for k, y in enumerate(middles):
        _pedestal(b, m, y, p, depth, h, first if k == 0 or b.chance(0.7) else "open")
    ends = [-w / 2, w / 2]
    if both:
        ends = [right + p / 2, left - p / 2]
    else:
        t, y = m.board, -np.sign(middles[0]) * (w / 2 - 0.01)
        b.panel(
            "base", (0.02, min(y, y - np.sign(y) * t), 0), (depth, max(y, y - np.sign(y) * t), h)
        )
        ends = [y - np.sign(y) * t, middles[0] - np.sign(middles[0]) * p / 2]
    y0, y1 = min(ends), max(ends)
    if b.chance(0.6) and y1 - y0 > 0.35:
        y0, y1 = y0 + m.front, y1 - m.front  # a pedestal's door turns about its edge
        cell = c.Cell(y0, y1, h - b.uniform(0.08, 0.13), h, (0, 0, 0, 0), (False, False))
        b.panel("base", (m.inside + 0.01, y0, cell.z0 - 0.01), (0.7 * depth, y1, cell.z0 - 0.002))
        c.drawer(b, m, cell, 0.7 * depth, handle=b.choice(["none", "bar", "knob"]))
    if b.chance(0.5):
        b.panel("base", (depth - 0.02, y0, 0.35 * h), (depth, y1, 0.95 * h), "body")
    if b.chance(0.25):
        _monitor(b, d, h)


def _monitor(b: Builder, d: float, h: float) -> None:
    """A screen standing on the desk, part of the base."""
    z = h + 0.046
    b.block("base", (0.7 * d, 0, z + 0.006), (0.18, 0.24, 0.012), "dark", "content")
    b.rod("base", (0.72 * d, 0, z), (0.72 * d, 0, z + 0.25), 0.02, None, "dark", "content")
    b.block("base", (0.7 * d, 0, z + 0.3), (0.03, 0.55, 0.33), "screen", "content")


def coffee_table(b: Builder) -> None:
    """Low table with a drawer on one or both long sides, and a shelf."""
    w, d, h = b.uniform(0.7, 1.3), b.uniform(0.45, 0.7), b.uniform(0.32, 0.5)
    b.size(w, d, h)
    m = c.draw_manner(b)
    apron = b.uniform(0.1, 0.16)
    cell = c.carcass(b, m, w, d, h - apron, h)
    _legs(b, w, d, h - apron, 0.0)
    for part in c.cut(b, m, cell, d, "y", [1.0] * b.integer(1, 2)):
        c.drawer(b, m, part, d)
    if b.chance(0.5):
        b.panel("base", (0.06, -w / 2 + 0.06, 0.06), (d - 0.06, w / 2 - 0.06, 0.08), "trim")
    if b.chance(0.5):
        _top(b, w + 0.06, d + 0.03, h, 0.03 + m.front)


def dressing_table(b: Builder) -> None:
    """A table with drawers and a tilting mirror between two posts."""
    w, d, h = b.uniform(0.8, 1.2), b.uniform(0.4, 0.5), b.uniform(0.7, 0.8)
    b.size(w, d, 1.6 * h)
    m = c.draw_manner(b)
    apron = b.uniform(0.12, 0.2)
    cell = c.carcass(b, m, w, d, h - apron, h)
    _legs(b, w, d, h - apron, 0.0)
    for part in c.cut(b, m, cell, d, "y", [1.0] * b.integer(1, 3)):
        c.drawer(b, m, part, d)
    tall, half, x = b.uniform(0.5, 0.75), b.uniform(0.22, 0.32), d - 0.06
    g = max(b.gap, 0.002)
    for s in (-1, 1):
        b.block(
            "base", (x, s * (half + g + 0.015), h + 0.4 * tall), (0.03, 0.03, 0.8 * tall), "trim"
        )
    mirror = b.link("mirror", "panel")
    z = h + 0.5 * tall + 0.02
    # it hangs on a rod between the posts, a little in front of it
    b.rod("base", (x, -half - g, z), (x, half + g, z), 0.005, None, "metal")
    low, high = [x - 0.03, -half, z - 0.45 * tall], [x - 0.006, half, z + 0.45 * tall]
    b.border(mirror, low, high, 0.035, "trim")
    b.panel(mirror, (x - 0.022, -half + 0.035, low[2] + 0.035),
            (x - 0.014, half - 0.035, high[2] - 0.035), "glass")  # fmt: skip
    b.hinge(mirror, "base", (x, 0, z), (0, 1, 0), np.radians(-20), np.radians(20), closed=0.0)


CATEGORIES = {
    "table_with_drawers": table_with_drawers,
    "desk": desk,
    "coffee_table": coffee_table,
    "dressing_table": dressing_table,
}
