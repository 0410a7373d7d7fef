"""Boards and leaves of the objects that are made of boxes only: grips, doors, drawers, cells."""

# ruff: noqa: RUF005  (a point plus a tuple is a vector sum here, not a joined list)

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from mam_world.kit import Builder

PAINTS = ("body", "front", "front", "trim", "accent", "light", "dark")


def grip(b: Builder, link: str, at: ArrayLike, along: str, length: float) -> None:
    """A handle of boxes on a surface that faces -X: a block, a bar on posts, a ledge or nothing."""
    kind = b.choice(("block", "bar", "bar", "ledge", "knob", "none"))
    if kind == "none":
        return
    p = np.asarray(at, dtype=float)
    thick, off = length * b.uniform(0.06, 0.14), length * b.uniform(0.12, 0.35)
    deep = thick * b.choice((0.0, 0.0, 0.9))  # posts may stick in the front
    k = 1 if along == "y" else 2
    size = np.array([thick, thick, thick])
    paint = b.choice(("metal", "metal", "dark", "trim"))
    if kind == "knob":
        b.block(link, p - (off / 2 - deep / 2, 0, 0), (off + deep, 2 * thick, 2 * thick), paint,
                "handle")  # fmt: skip
    elif kind == "block":
        size[0], size[k] = off + deep, length
        b.block(link, p - (off / 2 - deep / 2, 0, 0), size, paint, "handle")
    elif kind == "ledge":
        size[0], size[k], size[3 - k] = off, 2 * length, 0.5 * thick
        b.block(link, p - (off / 2, 0, 0), size, paint, "handle")
    else:
        for s in (-1, 1):
            post = p.copy()
            post[k] += s * length * b.choice((0.5, 0.45)) - s * thick / 2
            b.block(link, post - (off / 2 - deep / 2, 0, 0), (off + deep, thick, thick), paint,
                    "handle")  # fmt: skip
        size[k] = length
        b.block(link, p - (off, 0, 0), size, paint, "handle")
    with b.facing(p, (-1, 0, 0), (0, 1, 0) if along == "y" else (0, 0, 1)):
        b.grasp(link, "handle", (0, 0, off), (0, 0, -1), (0, 1, 0), thick)


def leaf(b: Builder, low: ArrayLike, high: ArrayLike, how: str, outer: bool = True,
         name: str = "door", parent: str = "base") -> str:  # fmt: skip
    """A plate facing -X that opens about its left, right, bottom or top edge."""
    lo, hi = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    link = b.link(name, "door")
    b.panel(link, lo, hi, b.choice(PAINTS))
    w, h = hi[1] - lo[1], hi[2] - lo[2]
    if b.chance(0.25):  # a second board or a pane on it, crossing it or not
        cut = 0.15 * min(w, h)
        out = b.choice((0.2, 0.6)) * (hi[0] - lo[0])
        b.panel(link, lo + (-out, cut, cut), (lo[0] + out, hi[1] - cut, hi[2] - cut),
                b.choice(("glass", "trim", "front")))  # fmt: skip
    mid, side = (lo + hi) / 2, 0.12
    at = np.array([lo[0], mid[1], mid[2]])
    k = 2 if how in ("bottom", "top") else 1
    away = 1 if how in ("right", "bottom") else -1  # from the hinge to the free edge
    at[k] = (hi if away > 0 else lo)[k] - away * side * (hi - lo)[k]
    if k == 1 and b.chance(0.3):
        at[2] = lo[2] + b.uniform(0.3, 0.8) * h
    long = min(0.4 * (h if k == 1 else w), 0.25 * b.diagonal)
    long = min(long, 6 * side * (hi - lo)[k])  # so thick it is that it stays on the plate
    grip(b, link, at, "z" if k == 1 else "y", long)
    pin = np.array([lo[0], mid[1], mid[2]])
    pin[k] = (lo if away > 0 else hi)[k]
    if outer and b.chance(0.5):
        pin[0] = b.choice((mid[0], hi[0]))
    upper = b.choice((np.pi / 2, np.pi / 2, b.uniform(1.2, 1.9) if outer else 1.4))
    b.hinge(link, parent, pin, (0, 0, 1) if k == 1 else (0, 1, 0), 0.0, upper, opens=(-1, 0, 0))
    return link


def pulled(b: Builder, low: ArrayLike, high: ArrayLike, deep: float, inner: ArrayLike) -> str:
    """A drawer: its front low..high, and behind it a tray, a block, a bottom or nothing.

    `inner` (2, 2) is the room behind the front: (y0, z0), (y1, z1).
    """
    lo, hi = np.asarray(low, dtype=float), np.asarray(high, dtype=float)
    (y0, z0), (y1, z1) = np.asarray(inner, dtype=float)
    link = b.link("drawer", "drawer")
    b.panel(link, lo, hi, b.choice(PAINTS))
    g = max(b.gap, 0.004 * b.diagonal)
    free = b.choice((1.0, 1.0, b.uniform(1.0, 8.0))) * g  # some float in a wide void
    free = min(free, 0.2 * min(y1 - y0, z1 - z0), 0.016 * b.diagonal)
    long = deep * b.uniform(0.5, 0.92)
    x1 = hi[0] + long
    p, q = np.array([hi[0], y0 + free, z0 + free]), np.array([x1, y1 - free, z1 - free])
    q[2] = p[2] + b.uniform(0.4, 1.0) * (q[2] - p[2])
    kind = b.choice(("tray", "tray", "tray", "block", "bottom", "none"))
    t = b.uniform(0.02, 0.06) * min(y1 - y0, long)
    t = min(t, 0.2 * (q[2] - p[2]))
    if kind == "tray":
        b.drawer_box(link, p, q, t)
    elif kind == "block":
        b.box(link, p, q, "inside", "drawer_box")
    elif kind == "bottom":
        b.box(link, p, (q[0], q[1], p[2] + t), "inside", "drawer_box")
    at = (lo[0], (lo[1] + hi[1]) / 2, (lo[2] + hi[2]) / 2)
    grip(b, link, at, "y", b.uniform(0.2, 0.5) * (hi[1] - lo[1]))
    travel = long * b.uniform(0.5, 0.85)
    if kind == "none":  # a bare front is clearly out, not just off its seat
        travel = max(travel, 2.1 * float(np.ptp(b.bounds_of(link)[:, 0])))
    b.slide(link, "base", (-1, 0, 0), 0.0, travel)
    return link


def carcass(b: Builder, x1: float, y: tuple[float, float], z: tuple[float, float], t: float,
             back: bool = True) -> None:  # fmt: skip
    """Boards around a cell that is open at x = 0; corners may cross."""
    over = t if b.chance(0.5) else 0.0
    b.panel("base", (0, y[0] - t, z[0] - over), (x1, y[0], z[1] + over))
    b.panel("base", (0, y[1], z[0] - over), (x1, y[1] + t, z[1] + over))
    b.panel("base", (0, y[0] - t + over, z[0] - t), (x1, y[1] + t - over, z[0]))
    b.panel("base", (0, y[0] - t + over, z[1]), (x1, y[1] + t - over, z[1] + t))
    if back:
        b.panel("base", (x1 - t, y[0] - t / 2, z[0] - t / 2), (x1, y[1] + t / 2, z[1] + t / 2))


def cell(b: Builder, x1: float, y: tuple[float, float], z: tuple[float, float], t: float,
          what: str, outer: tuple[bool, bool] = (True, True)) -> None:  # fmt: skip
    """Fill one cell of boards: a door of any side, a pair, a drawer, a fixed front, or nothing."""
    inset = b.chance(0.3)
    g = max(b.gap, 0.0015 * b.diagonal)
    front = min(t * b.uniform(0.6, 1.4), 0.014 * b.diagonal)
    x = (0.0, front) if inset else (-front, 0.0)
    lap = -g if inset else 0.5 * t - g
    lo = np.array([x[0], y[0] - lap, z[0] - lap])
    hi = np.array([x[1], y[1] + lap, z[1] + lap])
    room = x1 - t - max(x[1], 0.0)
    if what == "drawer":
        pulled(b, lo, hi, room, [(y[0], z[0]), (y[1], z[1])])
    elif what == "fixed":
        b.panel("base", lo, hi, b.choice(PAINTS))
        if b.chance(0.5):
            grip(b, "base", (lo[0], (lo[1] + hi[1]) / 2, (lo[2] + hi[2]) / 2), "y",
                 0.3 * (hi[1] - lo[1]))  # fmt: skip
    elif what == "pair":
        mid = (lo[1] + hi[1]) / 2
        r2 = front**2 / (hi[1] - lo[1]) + 8e-4 * b.diagonal
        leaf(b, lo, (hi[0], mid - g / 2 - r2, hi[2]), "right", outer[0] and not inset)
        leaf(b, (lo[0], mid + g / 2 + r2, lo[2]), hi, "left", outer[1] and not inset)
    elif what != "open":
        own = outer[1] if what == "left" else outer[0]
        own = own if what in ("left", "right") else False
        k = 1 if what in ("left", "right") else 2
        # a plate that turns about its front edge needs room at the free one
        turn = front**2 / (2 * (hi - lo)[k]) + 4e-4 * b.diagonal
        (lo if what in ("left", "top") else hi)[k] += turn if what in ("left", "top") else -turn
        leaf(b, lo, hi, what, own and not inset)
    if what in ("left", "right", "pair", "open") and b.chance(0.5):
        s = (z[0] + z[1]) / 2
        b.panel("base", (x1 * 0.2 + t, y[0], s - t / 2), (x1 - t, y[1], s + t / 2), "inside")
