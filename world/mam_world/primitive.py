"""Objects made of boxes only, as written by hand into URDF files: few triangles, crossing pieces.

Cabinets, drawers, doors, appliances, sliding panes, chests and kitchen runs; every one of them
with fixed boxes that have the look of moving ones.
"""

# ruff: noqa: RUF005  (a point plus a tuple is a vector sum here, not a joined list)

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mam_world.boards import PAINTS, carcass, cell, grip
from mam_world.kit import Builder
from mam_world.solids import settle


def box_cabinet(b: Builder) -> None:
    """A cupboard of boards with one to nine cells, most of them shut by fixed fronts or open."""
    columns, rows = b.choice(((1, 1), (1, 1), (1, 1), (2, 1), (1, 2), (1, 3), (2, 2), (3, 1),
                              (3, 3), (4, 1)))  # fmt: skip
    w, h, d = b.uniform(0.25, 0.9), b.uniform(0.2, 0.8), b.uniform(0.25, 0.7)
    t = b.uniform(0.012, 0.04)
    b.size(d, w * columns, h * rows)
    b.theme()
    foot = b.choice((0.0, 0.0, b.uniform(0.03, 0.3)))
    width = columns * (w + t)
    if foot:
        if b.chance(0.5):
            b.box("base", (0.05 * d, -0.45 * width, 0), (0.9 * d, 0.45 * width, foot), "trim")
        else:
            for x in (0.1 * d, 0.9 * d):
                for y in (-0.45 * width, 0.45 * width):
                    b.block("base", (x, y, foot / 2), (2 * t, 2 * t, foot), "trim")
    moving = 0
    hows = ("left", "right", "pair", "drawer", "drawer", "bottom", "top", "fixed", "open")
    for i in range(rows):
        for j in range(columns):
            y0, z0 = -width / 2 + t / 2 + j * (w + t), foot + t + i * (h + t)
            y, z = (y0, y0 + w), (z0, z0 + h)
            carcass(b, d, y, z, t)
            what = b.choice(hows)
            if what in ("fixed", "open") and i == rows - 1 and j == columns - 1 and not moving:
                what = b.choice(("left", "right", "drawer"))
            moving += what not in ("fixed", "open")
            cell(b, d, y, z, t, what, (j == 0, j == columns - 1))
    top = foot + rows * (h + t) + t
    low = min(float(p.shape.vertices[:, 2].min()) for p in b.pieces)
    if b.chance(0.4):
        b.box("base", (-0.03, -width / 2 - 0.03, top), (d, width / 2 + 0.03, top + t), "stone")
    if b.chance(0.25):  # the wall behind it
        b.box("base", (d, -width, low), (d + t, width, top * b.uniform(1.0, 1.8)), "light")


def box_drawer(b: Builder) -> None:
    """One drawer by itself: in a case, between two rails, or under a board on legs."""
    w, h, d, t = b.uniform(0.2, 0.8), b.uniform(0.08, 0.35), b.uniform(0.25, 0.6), 0.0
    t = b.uniform(0.02, 0.06) * w
    b.size(d, w, h)
    b.theme()
    kind = b.choice(("case", "case", "rails", "desk"))
    lift = b.uniform(0.2, 0.8) if kind == "desk" else b.choice((t, t, b.uniform(0.1, 0.5)))
    y, z = (-w / 2, w / 2), (lift, lift + h)
    if kind == "case":
        carcass(b, d, y, z, t, b.chance(0.7))
        if lift > t:
            b.box("base", (0.05 * d, -0.3 * w, 0), (0.95 * d, 0.3 * w, lift), "trim")
    elif kind == "rails":
        for s in (-1, 1):
            b.box("base", (0, s * w / 2 - (t if s < 0 else 0), 0), (d, s * w / 2 +
                  (t if s > 0 else 0), lift + 0.6 * h), "body")  # fmt: skip
        b.box("base", (d - t, -w / 2 - t, 0), (d, w / 2 + t, lift + 0.6 * h), "body")
        if lift <= t:
            b.box("base", (0, -w / 2 - t, 0), (d, w / 2 + t, lift), "body")
    else:
        wide = w * b.uniform(1.0, 2.5)
        b.box("base", (0, -wide / 2 - 2 * t, z[1]), (d, wide / 2 + 2 * t, z[1] + t), "body")
        for s in (-1, 1):  # runners
            p = sorted((s * w / 2, s * (w / 2 + 0.5 * t)))
            b.box("base", (0, p[0], z[0]), (d, p[1], z[1]), "trim")
        for x in (t, d - t):
            for s in (-1, 1):
                b.block("base", (x, s * (wide / 2 + t), z[1] / 2), (2 * t, 2 * t, z[1]), "trim")
        b.box("base", (d - t, -wide / 2, z[0]), (d, wide / 2, z[1]), "body")
    cell(b, d, y, z, t, "drawer")
    low = min(float(p.shape.vertices[:, 2].min()) for p in b.pieces)
    if low > 0:
        b.box("base", (0.3 * d, -0.1 * w, 0), (0.6 * d, 0.1 * w, low + t), "trim")


def box_door(b: Builder) -> None:
    """A door in a frame, in a wall or on two posts; its handle may turn, or be fixed."""
    w, h, t = b.uniform(0.5, 1.1), b.uniform(0.8, 2.1), b.uniform(0.03, 0.07)
    scale = b.choice((1.0, 1.0, b.uniform(0.2, 0.6)))  # models of doors stand on desks
    w, h, t = w * scale, h * scale, t * scale
    b.size(t, w, h)
    b.theme()
    jamb, thick = b.uniform(0.04, 0.15) * w, t * b.uniform(1.0, 2.5)
    g = max(b.gap, 0.003 * b.diagonal) + t**2 / (2 * w)
    sill = b.choice((0.0, b.uniform(0.01, 0.05))) * h
    parts = b.choice(("frame", "posts", "wall", "wall"))
    wide = jamb + (b.uniform(0.3, 1.5) * w if parts == "wall" else 0.0)
    tall = h + sill + 2 * g
    for s in (-1, 1):
        y = sorted((s * w / 2, s * (w / 2 + wide)))
        b.box("base", (0, y[0], 0), (thick, y[1], tall), b.choice(("body", "trim")))
    if parts != "posts":
        up = tall + (b.uniform(0.1, 0.5) * h if parts == "wall" else jamb)
        b.box("base", (0, -w / 2 - wide, tall), (thick, w / 2 + wide, up), "trim")
    if sill or parts == "posts":
        out = b.choice((0.0, 0.0, 0.5 * w))
        b.box("base", (-out, -w / 2 - wide, 0), (thick + out, w / 2 + wide, max(sill, 0.01 * h)))
        sill = max(sill, 0.01 * h)
    side = b.choice(("left", "right"))
    link = b.link("door", "door")
    lo, hi = np.array([0, -w / 2 + g, sill + g]), np.array([t, w / 2 - g, tall - g])
    b.panel(link, lo, hi, "front")
    s = 1 if side == "left" else -1  # the hinge is at s * w / 2
    if b.chance(0.5):
        for z in (0.15, 0.5, 0.85):
            p = (-0.1 * t, s * (w / 2 - g), lo[2] + z * h)
            b.block(link, p, (0.4 * t, 0.3 * t, 0.05 * h), "metal", "decor")
    _door_handle(b, link, np.array([0, -s * (0.5 * w - g - 0.1 * w), 0.48 * h]), s, w, t)
    b.hinge(link, "base", (0, s * (w / 2 - g), h / 2), (0, 0, 1), 0.0, b.uniform(1.2, 1.7),
            opens=(-1, 0, 0))  # fmt: skip


def _door_handle(b: Builder, door: str, at: np.ndarray, s: int, w: float, t: float) -> None:
    """A fixed grip, or a lever on a rose that turns on the door; `s` points to the hinge."""
    if b.chance(0.4):
        grip(b, door, at, "z", 0.2 * w)
        return
    r, out = 0.02 * w + 0.1 * t, t * b.uniform(0.8, 2.0)
    b.block(door, at - (0.1 * t, 0, 0), (0.2 * t, 3 * r, b.choice((3, 9)) * r), "metal", "decor")
    lever = b.link("latch", "handle")
    # the neck reaches into the leaf; whether it is round or square
    if b.chance(0.5):
        b.cylinder(lever, at + (0.3 * t, 0, 0), at - (out, 0, 0), 0.6 * r, None, "metal")
    else:
        b.block(lever, at - (out / 2 - 0.15 * t, 0, 0), (out + 0.3 * t, 0.8 * r, 0.8 * r), "metal")
    long = b.uniform(0.1, 0.16) * w
    y = sorted((at[1] - s * r, at[1] + s * long))
    b.box(lever, (-out - r, y[0], at[2] - 0.6 * r), (-out + r, y[1], at[2] + 0.6 * r), "metal",
          "handle")  # fmt: skip
    b.hinge(lever, door, at, (1, 0, 0), 0.0, b.uniform(0.5, 1.5), opens=(0, 0, -1),
            tip=at + (0, s * long, 0))  # fmt: skip


def box_slider(b: Builder) -> None:
    """Panes that slide in a frame of bars, as a window, a shutter or a cupboard's doors."""
    w, h, t = b.uniform(0.3, 1.6), b.uniform(0.25, 1.4), b.uniform(0.015, 0.04)
    b.size(0.2 * w, w, h)
    b.theme()
    case = b.choice((0.0, 0.0, b.uniform(0.2, 0.5)))  # depth of a cupboard behind it
    g, bar = max(b.gap, 0.0015 * b.diagonal), b.uniform(0.03, 0.08) * min(w, h)
    lift, deep = b.choice((0.0, 0.0, b.uniform(0.05, 0.6))), 2 * t + 3 * g
    for s in (-1, 1):
        y = sorted((s * w / 2, s * (w / 2 + bar)))
        b.box("base", (0, y[0], lift), (deep, y[1], lift + h + 2 * bar), "trim")
    for z in (lift, lift + h + bar):
        b.box("base", (0, -w / 2, z), (deep, w / 2, z + bar), "trim")
    if case:
        b.shell("base", (deep, -w / 2 - bar, lift), (deep + case, w / 2 + bar,
                lift + h + 2 * bar), bar, "-x")  # fmt: skip
    if lift:
        b.box("base", (-0.1 * w, -0.6 * w, 0), (deep + 0.1 * w, 0.6 * w, min(0.03, lift)), "body")
        for share in (-0.4, 0.4):
            b.block("base", (deep / 2, share * w, lift / 2), (deep, bar, lift), "body")
    upright = b.chance(0.25) and not case  # the pane goes up instead of sideways
    long, across = (h, w) if upright else (w, h)
    lap = b.uniform(0.0, 0.06) * long
    glass, both = b.choice(("glass", "front", "accent")), b.chance(0.3)
    for k in range(2):
        moves = k == 0 or both
        link = b.link("pane", "window") if moves else "base"
        x0 = g if k == 0 else t + 2 * g
        a0, a1 = (-long / 2 + g, lap) if k == 0 else (-lap, long / 2 - g)
        lo, hi = np.array([x0, a0, -across / 2 + g]), np.array([x0 + t, a1, across / 2 - g])
        mid = lift + bar + h / 2
        if upright:
            lo, hi = lo[[0, 2, 1]], hi[[0, 2, 1]]
        lo[2], hi[2] = lo[2] + mid, hi[2] + mid
        if b.chance(0.5):
            b.panel(link, lo, hi, glass)
        else:
            b.border(link, lo, hi, 0.6 * bar, "front")
            b.panel(link, lo + (0.3 * t, 0.6 * bar, 0.6 * bar), hi - (0.3 * t, 0.6 * bar,
                    0.6 * bar), glass)  # fmt: skip
        if moves:
            end = lo[1] + 0.1 * w if k == 0 else hi[1] - 0.1 * w
            at = (lo[0], end, mid) if not upright else (lo[0], 0, lo[2] + 0.1 * h)
            if k == 0:
                grip(b, link, at, "y" if upright else "z", 0.25 * across)
            sign = 1 if k == 0 else -1
            axis = (0, 0, sign) if upright else (0, sign, 0)
            b.slide(link, "base", axis, 0.0, long / 2 - lap - g)
    settle(b)


def box_chest(b: Builder) -> None:
    """A chest of boards: a lid hinged at the back or at a side, a sliding lid or a front flap."""
    w, d, h = b.uniform(0.15, 1.0), b.uniform(0.15, 0.6), b.uniform(0.08, 0.6)
    b.size(d, w, h)
    b.theme()
    t, g = b.uniform(0.02, 0.06) * min(w, d), max(0.3 * b.gap, 0.0005 * b.diagonal)
    b.shell("base", (0, -w / 2, 0), (d, w / 2, h), t, "+z")
    link = b.link("lid", "lid")
    over = b.choice((0.0, t, 0.5 * t))
    kind = b.choice(("back", "back", "left", "slide"))
    lo, hi = np.array([-over, -w / 2 - over, h + g]), np.array([d, w / 2 + over, h + g + t])
    if kind == "left":
        lo, hi = np.array([-over, -w / 2 - over, h + g]), np.array([d + over, w / 2, h + g + t])
    if kind == "slide":
        for s in (-1, 1):
            y = sorted((s * (w / 2), s * (w / 2 - t)))
            b.box("base", (0, y[0], h), (d, y[1], h + t), "trim")
        lo, hi = np.array([0, -w / 2 + t + g, h + g]), np.array([d, w / 2 - t - g, h + g + 0.8 * t])
    b.panel(link, lo, hi, b.choice(PAINTS))
    for side in (-0.3 * w, 0.3 * w):  # battens on the lid, fixed straps on the body
        if b.chance(0.4):
            b.box(link, (0.15 * d, side, hi[2]), (0.85 * d, side + t, hi[2] + 0.5 * t), "trim")
        if b.chance(0.3):
            b.block("base", (-0.25 * t, side, 0.5 * h), (0.5 * t, t, 0.9 * h), "metal", "decor")
    if b.chance(0.6):
        size, tall = 0.2 * w, t * b.uniform(0.5, 2)
        spot = {"slide": (0.8 * d, 0.0), "left": (0.5 * d, -0.4 * w)}.get(kind, (0.1 * d, 0.0))
        thick = 0.3 * t + 0.02 * w
        b.block(link, (*spot, hi[2] + tall / 2), (thick, size, tall), "metal", "handle")
    if kind == "slide":
        b.slide(link, "base", (b.choice((-1, 1)), 0, 0), 0.0, d * b.uniform(0.5, 0.95))
    else:
        pin = (d, 0, h + g) if kind == "back" else (d / 2, w / 2, h + g)
        axis = (0, 1, 0) if kind == "back" else (1, 0, 0)
        b.hinge(link, "base", pin, axis, 0.0, b.uniform(1.3, 1.9), opens=(0, 0, 1))


CATEGORIES: dict[str, Callable[[Builder], None]] = {
    "box_slider": box_slider,
    "box_chest": box_chest,
    "box_cabinet": box_cabinet,
    "box_drawer": box_drawer,
    "box_door": box_door,
}
