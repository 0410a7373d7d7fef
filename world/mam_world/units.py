"""Kitchen units and appliances of boxes only, alone and in a row under one worktop."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mam_world.boards import carcass, cell
from mam_world.kit import Builder
from mam_world.solids import settle


def box_appliance(b: Builder) -> None:
    """A hollow block with one door of any side: oven, fridge, microwave, locker, dishwasher."""
    w, h, d = b.uniform(0.3, 0.9), b.uniform(0.25, 1.8), b.uniform(0.3, 0.7)
    t = b.uniform(0.05, 0.12) * min(w, h)
    b.size(d, w, h)
    b.theme(b.choice(("white", "steel", "dark", "paint", "plastic")))
    strip = b.choice((0.0, 0.2 * h, 0.12 * h, 0.25 * w))  # a control panel above or beside
    above = strip and (strip != 0.25 * w or h > w)
    y0, z1 = -w / 2 + t + (0.0 if above else strip), h - t - (strip if above else 0.0)
    lift = b.choice((0.0, 0.0, 0.06, 0.3))
    y, z = (y0, w / 2 - t), (lift + t, lift + z1)
    carcass(b, d, y, z, t)
    if lift:
        b.box("base", (0.04, -0.45 * w, 0), (d - 0.04, 0.45 * w, lift), "trim")
    elif b.chance(0.5):
        b.box("base", (0.02, -0.4 * w, -0.03), (d - 0.02, 0.4 * w, 0), "dark")
    if strip:
        lo, hi = (-0.5 * t, -w / 2, lift + z1 + t), (d, w / 2, lift + h)
        if not above:
            lo, hi = (-0.5 * t, -w / 2, lift), (d, y0 - t, lift + h)
        b.box("base", lo, hi, "body")
        _controls(b, np.array(lo), np.array(hi))
    cell(b, d, y, z, t, b.choice(("left", "right", "bottom", "bottom" if w > h else "right",
                                   "top" if b.chance(0.3) else "left")))  # fmt: skip
    settle(b)


def _controls(b: Builder, lo: np.ndarray, hi: np.ndarray) -> None:
    """Knobs and buttons of boxes or cylinders on a strip's front; few of them move."""
    w, h = hi[1] - lo[1], hi[2] - lo[2]
    n = b.integer(1, 5)
    r = min(0.25 * min(w, h), 0.35 * max(w, h) / n)
    live = b.chance(0.35)
    for k in range(n):
        share = (k + 0.5) / n
        at = np.array([lo[0], lo[1] + share * w, (lo[2] + hi[2]) / 2])
        if h > w:
            at = np.array([lo[0], (lo[1] + hi[1]) / 2, lo[2] + share * h])
        link = b.link("knob", "knob") if live else "base"
        out = r * b.uniform(0.4, 1.2)
        p = at - (0.0005 * b.diagonal, 0, 0)
        if live or b.chance(0.6):
            b.cylinder(link, p, p - (out, 0, 0), r * 0.8, None, b.choice(("dark", "metal")))
            b.block(link, p - (out, 0, 0), (0.3 * out, 0.2 * r, 1.4 * r), "light", "handle")
        else:
            b.block(link, p - (0.1 * r, 0, 0), (0.2 * r, 1.6 * r, r), "screen", "decor")
        if live:
            b.spin(link, "base", at, (1, 0, 0), 0.0, b.uniform(1.5, 5.0))


def kitchen_run(b: Builder) -> None:
    """A row of kitchen units under one worktop, before a wall: doors, drawers, fixed fillers."""
    n, w, d, h = b.integer(2, 6), b.uniform(0.35, 0.65), b.uniform(0.5, 0.65), b.uniform(0.55, 0.8)
    t, foot = b.uniform(0.015, 0.03), b.uniform(0.08, 0.16)
    width = n * (w + t)
    b.size(d, width, h + foot)
    b.theme(b.choice(("wood", "white", "white", "paint", "dark")))
    b.box("base", (0.06, -width / 2, 0), (d, width / 2, foot - t), "trim")
    for k in range(n):
        y0 = -width / 2 + t / 2 + k * (w + t)
        y, outer = (y0, y0 + w), (k == 0, k == n - 1)
        what = b.choice(("left", "right", "pair", "drawers", "drawers", "bottom", "fixed", "open",
                         "mixed"))  # fmt: skip
        if k == n - 1 and not b.joints:
            what = "drawers"
        rows = {"drawers": b.integer(2, 4), "mixed": 2}.get(what, 1)
        share = np.array([2.5, 1.0]) if what == "mixed" else np.ones(rows)
        z0 = foot
        for i, part in enumerate(share / share.sum()):
            z1 = z0 + part * h
            one = what if rows == 1 else "drawer" if what == "drawers" or i else "right"
            carcass(b, d, y, (z0 + t / 2, z1 - t / 2), t)
            cell(b, d, y, (z0 + t / 2, z1 - t / 2), t, one, outer)
            z0 = z1
    top = foot + h + t / 2
    b.box("base", (-0.04, -width / 2 - 0.02, top), (d, width / 2 + 0.02, top + 0.04), "stone")
    tall = top * b.uniform(1.1, 2.2)
    if b.chance(0.7):
        b.box("base", (d, -width / 2 - 0.3, 0), (d + 0.1, width / 2 + 0.3, tall), "light")
    _on_top(b, d, width, w, top)


def _on_top(b: Builder, d: float, width: float, w: float, top: float) -> None:
    """A sink with its tap and a hob on the worktop, all fixed."""
    y = b.uniform(-0.3, 0.3) * width
    if b.chance(0.6):
        b.block("base", (0.5 * d, y, top + 0.041), (0.5 * d, 0.8 * w, 0.004), "metal", "decor")
        path = [(0.9 * d, y, top), (0.9 * d, y, top + 0.3), (0.65 * d, y, top + 0.3),
                (0.65 * d, y, top + 0.22)]  # fmt: skip
        b.sweep("base", path, 0.012, "metal")
    if b.chance(0.5):
        for x in (0.3, 0.7):
            for s in (-0.2, 0.2):
                at = (x * d, -y + s, top + 0.04)
                b.disc("base", at, (0, 0, 1), 0.08, 0.008, "dark", "decor")


CATEGORIES: dict[str, Callable[[Builder], None]] = {
    "box_appliance": box_appliance,
    "kitchen_run": kitchen_run,
}
