"""Boxes with lids: cartons, sliding lids, tool boxes, treasure chests."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from mam_world.kit import Builder
from mam_world.solids import part, profile, tray


def clasp(b: Builder, link: str, y: float, z: float, x: float, size: float) -> None:
    """A fixed clasp plate on the front: it looks like a latch and does not move."""
    b.box(link, (x - 0.2 * size, y - 0.5 * size, z), (x + 0.001, y + 0.5 * size, z + size), "metal",
          "decor")  # fmt: skip


def carton(b: Builder) -> None:
    """A cardboard box with two or four flaps; some may be missing or rest open."""
    d, w, h = b.uniform(0.15, 0.5), b.uniform(0.15, 0.6), b.uniform(0.1, 0.45)
    b.size(d, w, h)
    b.theme("wood")
    t, g = b.uniform(0.002, 0.006), max(b.gap, 0.0015)
    tray(b, "base", (0, -w / 2, 0), (d, w / 2, h), t, "z", 1,
         b.choice(("wood", "wood", "skin", "body")))  # fmt: skip
    paint = b.pieces[-1].material
    if b.chance(0.5):
        b.box("base", (-0.0005, -0.3 * w, 0.3 * h), (0, 0.1 * w, 0.7 * h), "light", "decor", False)
    pairs = b.choice((("x", "y"), ("x", "y"), ("x", "y"), ("y",), ("x",)))
    lap, open_ = b.chance(0.6), len(pairs) == 2 or b.chance(0.4)
    if len(pairs) == 2:  # on a table the flaps would be too thin to be seen crossing each other
        b.style = replace(b.style, setting="none")
    for level, side in enumerate(reversed(pairs)):
        # flaps below others move only while those stand open: the file shows the upper pair open
        top = level == len(pairs) - 1
        stand = open_ and (top or b.chance(0.6))
        # farther apart than what counts as touching, or the lower flaps seem to slide on these
        apart = max(g, 0.003 * float(np.linalg.norm([2 * d, 2 * w, 1.5 * h])))
        z = h + g + level * (t + apart)
        span, across = (d, w) if side == "x" else (w, d)
        depth = min(span / 2 - g, 0.5 * across if lap else span / 2 - g)
        for s in (-1, 1):
            flap = part(b, "lid", "flap")
            if side == "x":
                edge = (d / 2 + s * d / 2, 0.0, z)
                ends = sorted((edge[0], edge[0] - s * depth))
                b.panel(flap, (ends[0], -w / 2 + g, z), (ends[1], w / 2 - g, z + t), paint)
            else:
                edge = (d / 2, s * w / 2, z)
                ends = sorted((edge[1], edge[1] - s * depth))
                b.panel(flap, (g, ends[0], z), (d - g, ends[1], z + t), paint)
            upper = b.uniform(2.3, 3.4)
            rest = b.uniform(1.75, upper) if stand else 0.0
            axis = (0, 1, 0) if side == "x" else (1, 0, 0)
            b.hinge(
                flap, "base", edge, axis, 0, upper, opens=(0, 0, 1), rest=rest, ajar=len(pairs) == 1
            )


def sliding_box(b: Builder) -> None:
    """A box with a lid that slides in grooves, a match box, or a pencil box."""
    d, w, h = b.uniform(0.08, 0.3), b.uniform(0.05, 0.2), b.uniform(0.04, 0.12)
    b.size(d, w, h)
    b.theme(b.choice(("wood", "wood", "paint", "plastic")))
    t, g = b.uniform(0.004, 0.008), max(b.gap, 0.0008)
    if b.chance(0.4):
        b.shell("base", (0, -w / 2, 0), (d, w / 2, h), t * 0.6, "-x,+x", "body")
        inner = part(b, "drawer", "tray")
        e = t * 0.6 + g
        tray(b, inner, (0, -w / 2 + e, e), (d, w / 2 - e, h - e), t * 0.6, "z", 1, "light")
        b.slide(inner, "base", (-1, 0, 0), 0, b.uniform(0.5, 0.85) * d,
                rest=b.choice((0.0, 0.0, 0.3 * d)))  # fmt: skip
        return
    wall = h - 2.2 * t - 2 * g
    tray(b, "base", (0, -w / 2, 0), (d, w / 2, wall), 1.6 * t, "z", 1)
    top = t + 2 * g
    for s in (-1, 1):
        b.box("base", (0, s * (w / 2 - 0.7 * t), wall), (d, s * w / 2, wall + top), "body")
        b.box("base", (0, s * (w / 2 - 1.5 * t), wall + top), (d, s * w / 2, wall + top + 0.8 * t),
              "body")  # fmt: skip
    b.box("base", (d - 0.8 * t, -w / 2 + 1.5 * t, wall), (d, w / 2 - 1.5 * t, wall + top + 0.8 * t),
          "body")  # fmt: skip
    lid = part(b, "lid")
    z = wall + g
    b.box(lid, (0, -w / 2 + 0.7 * t + g, z), (d - 0.8 * t - g, w / 2 - 0.7 * t - g, z + t), "front")
    if b.chance(0.6):
        b.box(lid, (0.05 * d, -0.12 * w, z + t), (0.09 * d, 0.12 * w, z + t + 0.6 * t), "metal",
              "handle")  # fmt: skip
    b.slide(lid, "base", (-1, 0, 0), 0, b.uniform(0.5, 0.9) * d, rest=b.choice((0.0, 0.0, 0.4 * d)))


def toolbox(b: Builder) -> None:
    """A tool box: a lid or two half lids on top, a bail or fixed handle."""
    w, d, h = b.uniform(0.3, 0.55), b.uniform(0.16, 0.26), b.uniform(0.14, 0.26)
    b.size(w, d, h)
    b.theme(b.choice(("paint", "plastic", "steel", "dark")))
    t, g = 0.005, max(b.gap, 0.001)
    k = b.uniform(0.6, 0.8) * h
    tray(b, "base", (0, -w / 2, 0), (d, w / 2, k), t, "z", 1)
    paint = b.choice(("body", "accent", "trim"))
    if b.chance(0.35):
        _half_lids(b, (d, w, k), t, g, paint)
        return
    lid = part(b, "lid")
    sloped = b.chance(0.5)
    if sloped:
        c = 0.25 * d
        profile(b, lid,
                [(0, k + g), (d, k + g), (d, k + g + 0.02), (d - c, h), (c, h), (0, k + g + 0.02)],
                -w / 2, w / 2, "y", paint)  # fmt: skip
    else:
        tray(b, lid, (0, -w / 2, k + g), (d, w / 2, h), t, "z", -1, paint)
    b.cylinder(lid, (d, -0.4 * w, k + g / 2), (d, 0.4 * w, k + g / 2), 0.004, None, "metal")
    for s in (-1, 1):
        clasp(b, lid, s * 0.28 * w, k + g + 0.002, 0, 0.02)
        clasp(b, "base", s * 0.28 * w, k - 0.03, 0, 0.026)
    b.hinge(lid, "base", (d, 0, k + g / 2), (0, 1, 0), 0, b.uniform(1.3, 1.9), opens=(0, 0, 1),
            rest=b.choice((0.0, 0.0, 1.0)))  # fmt: skip
    for s in (-1, 1):
        b.block(lid, (d / 2, s * 0.2 * w, h + 0.006), (0.02, 0.02, 0.014), "metal")
    _carrying_handle(b, lid, (d / 2, 0.2 * w - 0.012, h))


def _carrying_handle(b: Builder, lid: str, at: tuple[float, float, float]) -> None:
    """A bail that folds down, or a fixed bow, between `at` and its mirror image in y."""
    x, y, h = at
    if b.chance(0.5):
        handle = part(b, "handle")
        b.sweep(
            handle,
            [
                (x, -y, h + 0.008),
                (x, -y, h + 0.045),
                (x, -y + 0.012, h + 0.055),
                (x, y - 0.012, h + 0.055),
                (x, y, h + 0.045),
                (x, y, h + 0.008),
            ],
            0.005,
            "dark",
            "handle",
        )
        b.hinge(handle, lid, (x, 0, h + 0.008), (0, 1, 0), -1.3, 1.3, closed=0.0)
    else:
        b.sweep(lid, [(x, -y, h), (x, -y, h + 0.045), (x, y, h + 0.045), (x, y, h)],
                0.007, "dark", "handle")  # fmt: skip


def _half_lids(
    b: Builder, size: tuple[float, float, float], t: float, g: float, paint: str
) -> None:
    """Two half lids that meet below a fixed bar handle; `size` is that of the tray below."""
    d, w, k = size
    for s in (-1, 1):
        b.box("base", (d / 2 - 0.012, s * (w / 2 - t), k), (d / 2 + 0.012, s * w / 2, k + 0.08),
              "metal")  # fmt: skip
    b.cylinder("base", (d / 2, -w / 2, k + 0.07), (d / 2, w / 2, k + 0.07), 0.009, None, "wood",
               "handle")  # fmt: skip
    for s, x in ((-1, 0.0), (1, d)):
        half = part(b, "lid", "half_lid")
        x0, x1 = sorted((x, d / 2 + s * g))
        b.box(half, (x0, -w / 2 + t + g, k + g), (x1, w / 2 - t - g, k + g + 0.012), paint)
        b.hinge(half, "base", (x, 0, k + g), (0, 1, 0), 0, b.uniform(1.5, 2.6), opens=(0, 0, 1),
                rest=b.choice((0.0, 0.0, 1.4)))  # fmt: skip


def chest(b: Builder) -> None:
    """A treasure chest or a trunk: a vaulted or flat hinged lid, bands, fixed or hinged rings."""
    w, d, h = b.uniform(0.3, 1.1), b.uniform(0.2, 0.5), b.uniform(0.2, 0.5)
    b.size(w, d, h)
    b.theme(b.choice(("wood", "wood", "wood", "paint")))
    t, g = 0.012, max(b.gap, 0.0015)
    k = b.uniform(0.55, 0.75) * h
    z0 = b.choice((0.0, 0.03))
    for x in (0, d - 0.05) if z0 else ():
        for y in (-w / 2, w / 2 - 0.05):
            b.box("base", (x, y, 0), (x + 0.05, y + 0.05, z0), "body")
    tray(b, "base", (0, -w / 2, z0), (d, w / 2, k), t, "z", 1)
    lid = part(b, "lid")
    z = k + g
    rise = b.uniform(0.4, 1.0) * d / 2
    vault = b.chance(0.65)
    if vault:
        theta = np.linspace(0, np.pi, 11)
        outer = np.stack([d / 2 + d / 2 * np.cos(theta), z + rise * np.sin(theta)], 1)
        inner = np.stack([d / 2 + (d / 2 - t) * np.cos(theta), z + (rise - t) * np.sin(theta)], 1)
        profile(b, lid, np.concatenate([outer, inner[::-1]]), -w / 2, w / 2, "y", "body")
        for s in (-1, 1):
            y0, y1 = sorted((s * w / 2, s * (w / 2 - t)))
            profile(b, lid, inner, y0, y1, "y", "trim")
    else:
        tray(b, lid, (0, -w / 2, z), (d, w / 2, z + 0.3 * h), t, "z", -1)
    for y in np.linspace(-0.4, 0.4, b.integer(2, 3)) * w:
        b.box("base", (-0.003, y - 0.02, z0), (0, y + 0.02, k), "metal", "decor")
        if vault:
            ring = np.stack(
                [d / 2 + (d / 2 + 0.003) * np.cos(theta), z + (rise + 0.003) * np.sin(theta)], 1
            )
            profile(b, lid, np.concatenate([ring, outer[::-1]]), y - 0.02, y + 0.02, "y", "metal",
                    "decor")  # fmt: skip
    clasp(b, "base", 0, k - 0.06, 0, 0.055)
    b.cylinder(lid, (d, -0.35 * w, k + g / 2), (d, 0.35 * w, k + g / 2), 0.006, None, "metal")
    b.hinge(lid, "base", (d, 0, k + g / 2), (0, 1, 0), 0, b.uniform(1.3, 1.9), opens=(0, 0, 1),
            rest=b.choice((0.0, 0.0, 1.2)))  # fmt: skip
    if b.chance(0.6):
        for s in (-1, 1):
            y, zc, r = s * w / 2, 0.7 * k, min(0.05, 0.2 * d)
            b.block("base", (d / 2, y + s * 0.004, zc), (0.03, 0.01, 0.02), "metal")
            if b.chance(0.5):
                ring_link = part(b, "handle", "ring")
                b.torus(ring_link, (d / 2, y + s * 0.016, zc - r), (0, 1, 0), r, 0.005, "metal",
                        "handle")  # fmt: skip
                b.hinge(ring_link, "base", (d / 2, y + s * 0.016, zc), (1, 0, 0), 0, 1.3,
                        opens=(0, s, 0), tip=(d / 2, y + s * 0.016, zc - 2 * r))  # fmt: skip
            else:
                b.torus(
                    "base", (d / 2, y + s * 0.01, zc - r), (0, 1, 0), r, 0.005, "metal", "handle"
                )


CATEGORIES = {"carton": carton, "sliding_box": sliding_box, "toolbox": toolbox, "chest": chest}
