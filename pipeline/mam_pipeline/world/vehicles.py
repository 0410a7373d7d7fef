"""Things on wheels: carts, strollers, wheelbarrows, cars, bicycles, office chairs, folding chairs."""

from __future__ import annotations

import numpy as np

from mam_pipeline.world.kit import Builder
from mam_pipeline.world.mech import TAU, arc, bar, frame, part, profile, rounded, tray, wedge, wheel


def caster(b: Builder, top: tuple[float, float, float], r: float, swivel: bool, parent: str = "base") -> None:
    """A castor below `top`: a fork (that swivels, or is fixed) and its wheel."""
    x, y, z = top
    g, w = max(0.3 * b.gap, 0.0006 * (r / 0.03)), 0.7 * r
    trail = 0.5 * r if swivel else 0.0
    fork = parent
    b.cylinder(parent, (x, y, z), (x, y, z - 0.15 * r), 0.5 * r, None, "metal")
    z0 = z - 0.15 * r - (g if swivel else 0)
    if swivel:
        fork = part(b, "caster", "fork")
    b.cylinder(fork, (x, y, z0), (x, y, z0 - 0.2 * r), 0.6 * r, None, "metal")
    zc = z0 - 0.35 * r - r
    for s in (-1, 1):
        y0 = y + s * (w / 2 + 0.1 * r)
        box_y = sorted((y0, y0 + s * 0.12 * r))
        b.box(fork, (x - 0.3 * r, box_y[0], z0 - 0.2 * r), (x + 0.3 * r, box_y[1], z0 - 0.15 * r), "metal")
        bar(b, fork, (x, y0 + s * 0.06 * r, z0 - 0.17 * r), (x + trail, y0 + s * 0.06 * r, zc), 0.5 * r, 0.12 * r, (0, 1, 0), "metal")
    b.box(fork, (x - 0.3 * r, y - w / 2 - 0.22 * r, z0 - 0.22 * r), (x + 0.3 * r, y + w / 2 + 0.22 * r, z0 - 0.12 * r), "metal")
    b.cylinder(fork, (x + trail, y - w / 2 - 0.24 * r, zc), (x + trail, y + w / 2 + 0.24 * r, zc), 0.12 * r, None, "metal")
    if swivel:
        b.spin(fork, parent, (x, y, z), (0, 0, 1))
    roll = part(b, "wheel")
    with b.facing((x + trail, y, zc), (0, 1, 0)):
        b.cylinder(roll, (0, 0, -w / 2), (0, 0, w / 2), r, None, "rubber")
        b.cylinder(roll, (0, 0, -w / 2 - 0.08 * r), (0, 0, w / 2 + 0.08 * r), 0.5 * r, None, "accent")
    b.spin(roll, fork, (x + trail, y, zc), (0, 1, 0))


def caster_height(b: Builder, r: float, swivel: bool) -> float:
    """Height of a castor's top above the floor."""
    return 0.5 * r + 2 * r + (max(0.3 * b.gap, 0.0006 * (r / 0.03)) if swivel else 0.0)


def cart(b: Builder) -> None:
    """A platform trolley, a shelf trolley or a hand cart on an axle chassis."""
    l, w = b.uniform(0.5, 1.1), b.uniform(0.35, 0.65)
    b.size(l, w, 0.9)
    b.theme(b.choice(("steel", "paint", "dark", "plastic")))
    if b.chance(0.5):
        r = b.uniform(0.03, 0.06)
        z = caster_height(b, r, True)
        same = caster_height(b, r, False)
        for x, swivel in ((0.12 * l, True), (0.88 * l, b.chance(0.5))):
            for s in (-1, 1):
                if not swivel:
                    b.cylinder("base", (x, s * 0.4 * w, same), (x, s * 0.4 * w, z + 0.001), 0.6 * r, None, "metal")
                caster(b, (x, s * 0.4 * w, z if swivel else same), r, swivel)
        rounded(b, "base", (0, -w / 2, z), (l, w / 2, z + 0.03), 0.03)
        high = b.uniform(0.6, 0.95)
        shelves = b.integer(0, 2)
        if shelves:
            for k in range(shelves):
                zz = z + (k + 1) * (high - z) / (shelves + 0.3)
                tray(b, "base", (0, -w / 2, zz), (l, w / 2, zz + 0.05), 0.006, "z", 1)
            for x in (0.02, l - 0.02):
                for s in (-1, 1):
                    b.cylinder("base", (x, s * (w / 2 - 0.02), z), (x, s * (w / 2 - 0.02), high), 0.012, None, "metal")
        b.sweep("base", [(l - 0.03, -0.42 * w, z + 0.02), (l + 0.03, -0.42 * w, high), (l + 0.03, 0.42 * w, high), (l - 0.03, 0.42 * w, z + 0.02)],
                0.013, "metal", "handle")  # fmt: skip
        return
    r = b.uniform(0.08, 0.2)
    ww = b.uniform(0.25, 0.5) * r
    if r < 0.12:
        b.box("base", (0, -w / 2, r), (l, w / 2, r + 0.04), "body")
    else:
        tray(b, "base", (0, -w / 2, 0.9 * r), (l, w / 2, r + 0.25), 0.02, "z", 1, "wood")
    style = b.choice(("disc", "tyre", "spoke", "cast"))
    g = 0.006
    for x in (0.18 * l, 0.82 * l) if b.chance(0.75) else (0.5 * l,):
        b.cylinder("base", (x, -w / 2 - g - 0.5 * ww, r), (x, w / 2 + g + 0.5 * ww, r), 0.1 * r, None, "dark")
        b.box("base", (x - 0.3 * r, -w / 2, 0.8 * r), (x + 0.3 * r, w / 2, r + 0.03), "trim")
        for s in (-1, 1):
            roll = part(b, "wheel")
            y = s * (w / 2 + g + ww / 2)
            wheel(b, roll, (x, y, r), (0, 1, 0), r, ww, style)
            b.spin(roll, "base", (x, y, r), (0, 1, 0))
    if b.chance(0.6):
        pole = part(b, "handle", "drawbar")
        z = r + 0.02
        for s in (-1, 1):
            b.box("base", (-0.04, s * 0.04 - 0.008, z - 0.02), (0.001, s * 0.04 + 0.008, z + 0.015), "metal")
        b.cylinder(pole, (-0.025, -0.03, z), (-0.025, 0.03, z), 0.012, None, "metal")
        b.cylinder(pole, (-0.025, 0, z), (-0.5, 0, z + 0.15), 0.012, None, "metal")
        b.cylinder(pole, (-0.5, -0.08, z + 0.15), (-0.5, 0.08, z + 0.15), 0.014, None, "rubber", "handle")
        b.hinge(pole, "base", (-0.025, 0, z), (0, 1, 0), 0, b.uniform(0.7, 1.1), opens=(0, 0, 1), tip=(-0.5, 0, z))
    else:
        b.sweep("base", [(0.02, -0.3 * w, r + 0.03), (-0.15, -0.3 * w, 0.8), (-0.15, 0.3 * w, 0.8), (0.02, 0.3 * w, r + 0.03)], 0.014, "metal", "handle")


def wheelbarrow(b: Builder) -> None:
    """A wheelbarrow: one or two wheels that spin, a fixed tray, legs and handles."""
    r, w = b.uniform(0.15, 0.2), b.uniform(0.5, 0.65)
    b.size(1.4, w, 0.6)
    b.theme(b.choice(("paint", "steel", "dark")))
    l = b.uniform(0.6, 0.8)
    z = 0.3
    wedge(b, "base", (0.24, -0.25 * w, 0.1 + l, 0.25 * w), (0.2, -0.27 * w, 0.13 + l, 0.27 * w), z, z + 0.02)
    # four sloping walls of the tray
    low, high = (0.22, 0.12 + l, 0.26 * w), (0.0, 0.2 + l, 0.5 * w)
    top = z + b.uniform(0.2, 0.28)
    for s in (-1, 1):
        bar(b, "base", ((low[0] + low[1]) / 2, s * low[2], z + 0.01), ((high[0] + high[1]) / 2, s * high[2], top),
            0.92 * l, 0.006, (0, -s, 0.8))  # fmt: skip
    bar(b, "base", (low[0], 0, z + 0.01), (high[0], 0, top), 0.8 * w, 0.006, (1, 0, 0.8))
    bar(b, "base", (low[1], 0, z + 0.01), (high[1], 0, top), 0.8 * w, 0.006, (-1, 0, 0.5))
    twin = b.chance(0.2)
    half = 0.05
    for s in (-1, 1):
        y = s * 0.2 * w
        b.sweep("base", [(-0.08 if not twin else 0.1, s * (half + 0.03), r), (0.12, y, z - 0.02), (l + 0.1, y, z - 0.01), (l + 0.55, s * 0.28 * w, z + 0.2), (l + 0.7, s * 0.28 * w, z + 0.2)],
                0.016, "metal")  # fmt: skip
        b.cylinder("base", (l + 0.55, s * 0.28 * w, z + 0.2), (l + 0.72, s * 0.28 * w, z + 0.2), 0.021, None, "rubber", "handle")
        b.sweep("base", [(l - 0.05, y, z), (l + 0.02, s * 0.25 * w, 0.0135), (l + 0.12, s * 0.25 * w, 0.0135), (l + 0.2, y, z + 0.04)], 0.012, "metal")
    style = b.choice(("disc", "tyre", "spoke"))
    x = -0.08 if not twin else 0.1
    for s in (-1, 1) if twin else (0,):
        y = s * (half + 0.08)
        roll = part(b, "wheel")
        wheel(b, roll, (x, y, r), (0, 1, 0), r, 0.07, style)
        b.spin(roll, "base", (x, y, r), (0, 1, 0))
    reach = half + (0.1 if twin else 0.03)
    b.cylinder("base", (x, -reach, r), (x, reach, r), 0.012, None, "metal")


def stroller(b: Builder) -> None:
    """A stroller: spinning wheels (front ones may swivel), a canopy that folds, a push bar."""
    w, l = b.uniform(0.42, 0.52), b.uniform(0.55, 0.7)
    rr, rf = b.uniform(0.1, 0.16), b.uniform(0.07, 0.1)
    b.size(l, w, 1.05)
    b.theme(b.choice(("dark", "steel", "paint")))
    back, front = l, 0.0
    seat_z = b.uniform(0.42, 0.5)
    b.cylinder("base", (back, -w / 2, rr), (back, w / 2, rr), 0.012, None, "metal")
    style = b.choice(("disc", "tyre", "cast"))
    for s in (-1, 1):
        y = s * (w / 2 - 0.04)
        b.cylinder("base", (back, y, rr), (0.3 * l, y, 0.75), 0.012, None, "metal")
        b.cylinder("base", (front + 0.02, y, 2 * rf + 0.07), (0.75 * l, y, 0.78), 0.012, None, "metal")
        b.sweep("base", [(0.75 * l, y, 0.78), (l + 0.08, y, 1.0), (l + 0.16, y, 1.02)], 0.012, "metal")
        roll = part(b, "wheel")
        yy = s * (w / 2 + 0.025)
        b.cylinder("base", (back, s * w / 2, rr), (back, yy, rr), 0.01, None, "metal")
        wheel(b, roll, (back, yy, rr), (0, 1, 0), rr, 0.035, style)
        b.spin(roll, "base", (back, yy, rr), (0, 1, 0))
    b.cylinder("base", (l + 0.16, -w / 2 + 0.04, 1.02), (l + 0.16, w / 2 - 0.04, 1.02), 0.016, None, "rubber", "handle")
    swivel = b.chance(0.6)
    z = caster_height(b, rf, swivel)
    for s in (-1, 1):
        y = s * (w / 2 - 0.04)
        b.cylinder("base", (front + 0.02, y, z - 0.002), (front + 0.02, y, 2 * rf + 0.09), 0.016, None, "metal")
        caster(b, (front + 0.02, y, z), rf, swivel)
    half = w / 2 - 0.065
    b.box("base", (0.15 * l, -half, seat_z), (0.62 * l, half, seat_z + 0.03), "fabric")
    bar(b, "base", (0.62 * l, 0, seat_z + 0.01), (0.85 * l, 0, seat_z + 0.45), 2 * half, 0.03, (-1, 0, 0.4), "fabric")
    b.cylinder("base", (0.35 * l, -w / 2 + 0.04, seat_z), (0.35 * l, w / 2 - 0.04, seat_z), 0.01, None, "metal")
    if b.chance(0.75):
        hood = part(b, "canopy")
        c = (0.62 * l, 0, seat_z + 0.36)
        outer_r, y = b.uniform(0.3, 0.36), w / 2 - 0.015
        start, stop = 0.55 * np.pi, 0.95 * np.pi
        theta = np.linspace(start, stop, 8)
        ring = np.stack([c[0] + outer_r * np.cos(theta), c[2] + outer_r * np.sin(theta)], 1)
        ring2 = np.stack([c[0] + (outer_r - 0.012) * np.cos(theta), c[2] + (outer_r - 0.012) * np.sin(theta)], 1)
        profile(b, hood, np.concatenate([ring, ring2[::-1]]), -y, y, "y", "accent")
        for s in (-1, 1):
            y0, y1 = sorted((s * y, s * (y - 0.006)))
            profile(b, hood, np.concatenate([[(c[0], c[2])], ring2]), y0, y1, "y", "accent")
        b.hinge(hood, "base", c, (0, 1, 0), -0.5, 0.25, closed=0.0)


def car(b: Builder) -> None:
    """A car or a toy car: wheels, doors, bonnet, boot, steering wheel; some parts may be fixed."""
    k = 1.0 if b.chance(0.4) else b.uniform(0.05, 0.12)
    length, w = k * b.uniform(3.4, 4.7), k * b.uniform(1.6, 1.85)
    r = k * b.uniform(0.28, 0.36)
    b.size(length, w, 1.5 * k)
    b.theme(b.choice(("paint", "paint", "dark", "white", "steel")))
    t, g = 0.06 * k, max(b.gap * 0.5, 0.006 * k)
    zf, zb, zr = 0.26 * k, b.uniform(0.82, 0.95) * k, b.uniform(1.35, 1.6) * k
    a, c = 0.28 * length, b.uniform(0.72, 0.8) * length
    x1, x2 = 0.16 * length, 0.8 * length
    four = b.chance(0.4)
    d0, d1 = a + 0.08 * k, c - 0.2 * k if four else a + b.uniform(1.0, 1.15) * k
    mid = [(d0, (d0 + d1) / 2 - 0.04 * k), ((d0 + d1) / 2 + 0.04 * k, d1)] if four else [(d0, d1)]
    live_doors = b.chance(0.8)
    zs = zf + 0.1 * k
    outline: list[tuple[float, float]] = [(0, zf)]
    for xc in (x1, x2):
        rise = np.arcsin((zf - r) / (1.2 * r)) if abs(zf - r) < 1.2 * r else 0.0
        outline += [(float(p[0]), float(p[2])) for p in arc((xc, 0, r), 1.2 * r, np.pi - rise, rise, 9)]
    outline += [(length, zf), (length, zb)]
    for near, far in reversed(mid if live_doors else []):
        outline += [(far, zb), (far, zs), (near, zs), (near, zb)]
    outline += [(0, zb)]
    for s in (-1, 1):
        y0, y1 = sorted((s * w / 2, s * (w / 2 - t)))
        profile(b, "base", outline, y0, y1, "y")
    inner = w / 2 - 0.32 * k
    b.box("base", (0, -inner, zf), (length, inner, zf + 0.06 * k), "dark")
    b.box("base", (x1 + 1.25 * r, -w / 2 + t, zf), (x2 - 1.25 * r, w / 2 - t, zf + 0.06 * k), "dark")
    b.box("base", (0, -w / 2 + t, zf), (t, w / 2 - t, zb), "body")
    b.box("base", (length - t, -w / 2 + t, zf), (length, w / 2 - t, zb), "body")
    b.box("base", (-0.08 * k, -w / 2, zf), (0, w / 2, zf + 0.2 * k), "trim")
    b.box("base", (length, -w / 2, zf), (length + 0.08 * k, w / 2, zf + 0.2 * k), "trim")
    b.box("base", (-0.02 * k, -0.3 * w, zf + 0.25 * k), (0, 0.3 * w, zb - 0.12 * k), "dark", "decor")
    for s in (-1, 1):
        b.disc("base", (0, s * 0.4 * w, zb - 0.18 * k), (-1, 0, 0), 0.09 * k, 0.03 * k, "light", "decor")
        b.block("base", (length, s * 0.4 * w, zb - 0.16 * k), (0.04 * k, 0.2 * k, 0.12 * k), "red", "decor")
    b.box("base", (a - 0.02 * k, -w / 2 + t, zf + 0.06 * k), (a + 0.04 * k, w / 2 - t, zb + 0.02 * k), "dark")
    b.box("base", (0.35 * a, -0.5 * inner, zf + 0.06 * k), (0.8 * a, 0.5 * inner, zb - 0.2 * k), "metal", "content")
    _cabin(b, k, a, c, w, zf, zb, zr, (mid[0][1] if four else d1))
    if live_doors:
        for near, far in mid:
            for s in (-1, 1):
                door = part(b, "door")
                y0, y1 = sorted((s * w / 2, s * (w / 2 - 0.8 * t)))
                b.box(door, (near + g, y0, zs + g), (far - g, y1, zb), "body")
                hx = far - 0.2 * k
                yh = s * (w / 2 + 0.015 * k)
                b.block(door, (hx, yh, zb - 0.15 * k), (0.14 * k, 0.03 * k, 0.03 * k), "metal", "handle")
                if b.chance(0.5) and near == d0:
                    b.block(door, (near + 0.15 * k, s * (w / 2 + 0.06 * k), zb + 0.02 * k), (0.08 * k, 0.14 * k, 0.1 * k), "dark", "decor")
                b.hinge(door, "base", (near + g / 2, s * w / 2, zs), (0, 0, 1), 0, b.uniform(0.9, 1.2), opens=(0, s, 0))
    for name, x0, x1_, pivot in (("bonnet", 0.01 * k, a - g, a - g), ("boot", c + 0.06 * k, length - 0.01 * k, c + 0.06 * k)):
        moving = b.chance(0.75)
        lid = part(b, "lid", name) if moving else "base"
        z = zb + (g if moving else 0)
        rounded(b, lid, (x0, -w / 2 + 0.02 * k, z), (x1_, w / 2 - 0.02 * k, z + 0.03 * k), 0.05 * k)
        if moving:
            b.hinge(lid, "base", (pivot, 0, z), (0, 1, 0), 0, b.uniform(0.8, 1.1), opens=(0, 0, 1))
    style, steer = b.choice(("disc", "tyre", "cast")), b.chance(0.4)
    ww = 0.2 * k
    for x in (x1, x2):
        b.cylinder("base", (x, -inner, r), (x, inner, r), 0.06 * k, None, "dark")
        for s in (-1, 1):
            y = s * (w / 2 - 0.13 * k)
            parent = "base"
            if steer and x == x1:
                parent = part(b, "knuckle")
                b.cylinder(parent, (x, s * (inner + 0.005 * k), r - 0.06 * k), (x, s * (inner + 0.005 * k), r + 0.06 * k), 0.05 * k, None, "metal")
                b.cylinder(parent, (x, s * inner, r), (x, y, r), 0.04 * k, None, "metal")
                b.hinge(parent, "base", (x, s * (inner + 0.005 * k), r), (0, 0, 1), -0.12, 0.12, closed=0.0)
            else:
                b.cylinder("base", (x, s * inner, r), (x, y, r), 0.04 * k, None, "metal")
            roll = part(b, "wheel")
            wheel(b, roll, (x, y, r), (0, 1, 0), r, ww, style)
            b.spin(roll, parent, (x, y, r), (0, 1, 0))


def _cabin(b: Builder, k: float, a: float, c: float, w: float, zf: float, zb: float, zr: float, post: float) -> None:
    """Roof, pillars, wind screens, seats and a steering wheel that turns."""
    f0, f1 = a + b.uniform(0.3, 0.6) * k, c - b.uniform(-0.05, 0.3) * k
    y = w / 2 - 0.06 * k
    if b.chance(0.85):
        rounded(b, "base", (f0, -y + 0.06 * k, zr - 0.05 * k), (f1, y - 0.06 * k, zr), 0.08 * k, "z", b.choice(("body", "dark")))
        for s in (-1, 1):
            b.cylinder("base", (f1, s * (y - 0.08 * k), zr - 0.03 * k), (c + 0.02 * k, s * y, zb - 0.02 * k), 0.03 * k, None, "body")
            b.cylinder("base", (post + 0.05 * k, s * (y - 0.07 * k), zr - 0.03 * k), (post + 0.05 * k, s * (y - 0.03 * k), zf + 0.05 * k), 0.025 * k, None, "dark")
    else:
        f0, zr = a + 0.35 * k, zb + 0.4 * k
    for s in (-1, 1):
        b.cylinder("base", (a + 0.06 * k, s * y, zb - 0.02 * k), (f0, s * (y - 0.08 * k), zr - 0.03 * k), 0.03 * k, None, "body")
    bar(b, "base", (a + 0.06 * k, 0, zb), (f0, 0, zr - 0.03 * k), 2 * y - 0.16 * k, 0.01 * k, (-1, 0, 0.6), "glass")
    for x in (a + 0.75 * k, c - 0.55 * k):
        for s in (-1, 1):
            yy = s * 0.22 * w
            b.block("base", (x + 0.1 * k, yy, zf + 0.2 * k), (0.42 * k, 0.36 * k, 0.28 * k), "fabric", "content")
            b.block("base", (x + 0.32 * k, yy, zf + 0.5 * k), (0.1 * k, 0.36 * k, 0.6 * k), "fabric", "content")
    at = np.array([a + 0.3 * k, -0.22 * w, zb - 0.05 * k])
    axis = np.array([0.9, 0, 0.45])
    b.cylinder("base", (a, -0.22 * w, zb - 0.2 * k), at - 0.012 * k * axis, 0.025 * k, None, "dark")
    helm = part(b, "wheel", "steering_wheel")
    with b.facing(at, axis):
        b.torus(helm, (0, 0, 0.02 * k), (0, 0, 1), 0.17 * k, 0.015 * k, "dark", "handle")
        b.cylinder(helm, (0, 0, 0), (0, 0, 0.04 * k), 0.04 * k, None, "dark")
        for t in np.arange(3) * TAU / 3:
            b.cylinder(helm, (0, 0, 0.02 * k), (0.17 * k * np.cos(t), 0.17 * k * np.sin(t), 0.02 * k), 0.012 * k, None, "dark")
    b.spin(helm, "base", at, axis, *b.choice(((-np.inf, np.inf), (-3.0, 3.0))), closed=0.0)


def bicycle(b: Builder) -> None:
    """A bicycle: two wheels, a fork that steers, a crank with pedals."""
    k = b.choice((1.0, 1.0, 0.7, 0.12))
    r, base_ = 0.33 * k, b.uniform(0.95, 1.08) * k
    b.size(base_ + 2 * r, 0.5 * k, k)
    b.theme(b.choice(("paint", "dark", "steel")))
    axis = np.array([0.3, 0, 0.954])
    front, rear = np.array([-base_ / 2, 0, r]), np.array([base_ / 2, 0, r])
    head = front + 0.44 * k * axis
    top = head + b.uniform(0.1, 0.16) * k * axis
    crank = np.array([0.05 * k, 0, 0.28 * k])
    seat = crank + np.array([0.15, 0, b.uniform(0.42, 0.5)]) * k
    tube = b.uniform(0.014, 0.02) * k
    b.tube("base", head, top, 0.024 * k, 0.017 * k, "body")
    step = b.chance(0.25)
    join = crank + 0.25 * (seat - crank) if step else crank + 0.9 * (seat - crank)
    reach = np.array([0.022 * k, 0, 0])
    b.cylinder("base", (head + top) / 2 + 0.3 * (top - head) + reach, join, 0.85 * tube, None, "body")
    b.cylinder("base", head + 0.2 * (top - head) + reach, crank, tube, None, "body")
    b.cylinder("base", crank, seat + np.array([0.02, 0, 0.08]) * k, 0.9 * tube, None, "body")
    b.cylinder("base", crank - (0, 0.035 * k, 0), crank + (0, 0.035 * k, 0), 0.022 * k, None, "body")
    saddle = seat + np.array([0.025, 0, 0.09]) * k
    profile(b, "base", [(saddle[0] + 0.1 * k, 0.07 * k), (saddle[0] + 0.1 * k, -0.07 * k), (saddle[0] - 0.04 * k, -0.025 * k),
                        (saddle[0] - 0.15 * k, -0.015 * k), (saddle[0] - 0.15 * k, 0.015 * k), (saddle[0] - 0.04 * k, 0.025 * k)],
            saddle[2] - 0.02 * k, saddle[2] + 0.02 * k, "z", "dark")  # fmt: skip
    for s in (-1, 1):
        e = np.array([0, s * 0.05 * k, 0])
        b.sweep("base", [crank + 0.6 * e, crank + 0.35 * (rear - crank) + e, rear + e], 0.009 * k, "body")
        b.cylinder("base", crank + 0.85 * (seat - crank) + 0.6 * e, rear + e, 0.007 * k, None, "body")
    b.cylinder("base", rear - (0, 0.055 * k, 0), rear + (0, 0.055 * k, 0), 0.008 * k, None, "metal")
    ww = b.uniform(0.035, 0.05) * k
    style = b.choice(("spoke", "spoke", "cast"))
    roll = part(b, "wheel", "rear_wheel")
    wheel(b, roll, rear, (0, 1, 0), r, ww, style)
    b.spin(roll, "base", rear, (0, 1, 0))
    fork = part(b, "fork", "fork")
    crown = head - 0.03 * k * axis
    b.cylinder(fork, crown, top + 0.06 * k * axis, 0.013 * k, None, "metal")
    b.cylinder(fork, crown - (0, 0.055 * k, 0), crown + (0, 0.055 * k, 0), 0.016 * k, None, "body")
    for s in (-1, 1):
        b.cylinder(fork, crown + (0, s * 0.05 * k, 0), front + (0, s * 0.05 * k, 0), 0.011 * k, None, "body")
    b.cylinder(fork, front - (0, 0.055 * k, 0), front + (0, 0.055 * k, 0), 0.008 * k, None, "metal")
    z = top + 0.06 * k * axis
    wide, back = b.uniform(0.24, 0.32) * k, b.uniform(0, 0.12) * k
    points = [(back, -wide, 0.02 * k), (-0.04 * k, -0.6 * wide, 0.03 * k), (-0.05 * k, 0, 0), (-0.04 * k, 0.6 * wide, 0.03 * k), (back, wide, 0.02 * k)]
    b.cylinder(fork, z, z + np.array([-0.05 * k, 0, 0]), 0.013 * k, None, "metal")
    b.sweep(fork, z + np.array(points), 0.011 * k, "metal", "handle")
    for s in (0, -1):
        p, q = z + np.array(points[s]), z + np.array(points[1 if s == 0 else -2])
        b.cylinder(fork, p, p + 0.4 * (q - p), 0.016 * k, None, "rubber", "handle")
    b.hinge(fork, "base", head, axis, -0.6, 0.6, closed=0.0)
    turn = part(b, "wheel", "front_wheel")
    wheel(b, turn, front, (0, 1, 0), r, ww, style)
    b.spin(turn, fork, front, (0, 1, 0))
    arms = part(b, "crank")
    b.cylinder(arms, crank - (0, 0.09 * k, 0), crank + (0, 0.09 * k, 0), 0.012 * k, None, "metal")
    b.cylinder(arms, crank + (0, -0.062 * k, 0), crank + (0, -0.068 * k, 0), 0.09 * k, None, "dark")
    tilt = b.uniform(0, TAU)
    for s in (-1, 1):
        e = s * np.array([np.cos(tilt), 0, np.sin(tilt)])
        end = crank + 0.17 * k * e
        y = np.array([0, s * 0.085 * k, 0])
        b.cylinder(arms, crank + y, end + y, 0.01 * k, None, "metal")
        b.cylinder(arms, end + y, end + 2 * y, 0.006 * k, None, "metal")
        pedal = part(b, "pedal")
        c = end + y * 1.75
        frame(b, pedal, c - np.array([0.045, 0.045, 0.012]) * k, c + np.array([0.045, 0.045, 0.012]) * k, 0.02 * k, "z", "rubber")
        b.block(pedal, c, (0.025 * k, 0.06 * k, 0.02 * k), "dark")
        b.spin(pedal, arms, end, (0, 1, 0))
    b.spin(arms, "base", crank, (0, 1, 0))


def office_chair(b: Builder) -> None:
    """An office chair: a star foot with castors, a seat that turns and lifts, a back that leans."""
    w = b.uniform(0.42, 0.52)
    seat_z, reach = b.uniform(0.42, 0.5), b.uniform(0.26, 0.32)
    b.size(0.6, 0.6, 1.0)
    b.theme("dark")
    g = max(b.gap * 0.4, 0.002)
    r = b.uniform(0.022, 0.03)
    wheels = b.chance(0.8)
    swivel = wheels and b.chance(0.5)
    z = caster_height(b, r, swivel) if wheels else 0.03
    paint = b.choice(("metal", "dark"))
    b.cylinder("base", (0, 0, z), (0, 0, z + 0.09), 0.045, 0.035, paint)
    for i in range(5):
        t = i * TAU / 5
        e = np.array([np.cos(t), np.sin(t), 0])
        b.cylinder("base", (0, 0, z + 0.05), reach * e + (0, 0, z + 0.02), 0.022, 0.015, paint)
        b.cylinder("base", reach * e + (0, 0, z + 0.03), reach * e + (0, 0, z), 0.015, None, paint)
        if wheels:
            with b.moved((0, 0, 0), (0, 0, 1), t + np.pi / 2 * (not swivel)):
                at = (reach, 0.0, z) if swivel else (0.0, -reach, z)
                caster(b, at, r, swivel)
        else:
            b.cylinder("base", reach * e, reach * e + (0, 0, z), 0.02, None, "rubber")
    lifts = b.chance(0.4)
    z1 = z + 0.09
    b.tube("base", (0, 0, z1), (0, 0, seat_z - 0.14), 0.028, 0.0215, "dark")
    holder = "base"
    if lifts:
        holder = part(b, "column", "gas_lift")
        b.cylinder(holder, (0, 0, z1 + 0.001), (0, 0, seat_z - 0.03), 0.019, None, "metal")
    else:
        b.cylinder("base", (0, 0, z1), (0, 0, seat_z - 0.03), 0.021, None, "metal")
    seat = part(b, "seat")
    zs = seat_z - 0.03 + g
    b.box(seat, (-0.1, -0.1, zs), (0.12, 0.1, zs + 0.025), "dark")
    rounded(b, seat, (-w / 2, -w / 2, zs + 0.025), (w / 2, w / 2, zs + 0.025 + b.uniform(0.05, 0.08)), 0.08, "z", "fabric")
    b.spin(seat, holder, (0, 0, zs), (0, 0, 1))
    if lifts:
        b.slide(holder, "base", (0, 0, 1), 0, 0.1)
    top = zs + 0.08
    leans = b.chance(0.5)
    back = part(b, "back") if leans else seat
    x = w / 2 + 0.04
    if leans:
        for s in (-1, 1):
            b.box(seat, (0.1, s * 0.045 - 0.008, zs), (x + 0.025, s * 0.045 + 0.008, zs + 0.024), "dark")
        b.cylinder(back, (x, -0.034, zs + 0.012), (x, 0.034, zs + 0.012), 0.012, None, "metal")
    else:
        b.box(seat, (0.1, -0.03, zs), (x + 0.02, 0.03, zs + 0.024), "dark")
    tall = b.uniform(0.35, 0.65)
    b.sweep(back, [(x, 0, zs + 0.012), (x + 0.035, 0, zs + 0.06), (x + 0.035, 0, top + 0.5 * tall)], 0.014, "dark")
    rounded(b, back, (x - 0.01, -0.45 * w, top + 0.1), (x + 0.03, 0.45 * w, top + 0.1 + tall), 0.08, "x", "fabric")
    if leans:
        b.hinge(back, seat, (x, 0, zs + 0.012), (0, 1, 0), 0, b.uniform(0.25, 0.45), opens=(1, 0, 0))
    if b.chance(0.5):
        for s in (-1, 1):
            y = s * (w / 2 + 0.03)
            b.box(seat, (0.0, min(y, s * 0.4 * w), zs + 0.03), (0.04, max(y, s * 0.4 * w), zs + 0.05), "dark")
            b.box(seat, (0.0, y - 0.012, zs + 0.03), (0.04, y + 0.012, top + 0.2), "dark")
            b.box(seat, (-0.12, y - 0.03, top + 0.2), (0.14, y + 0.03, top + 0.225), "rubber", "handle")


def folding_chair(b: Builder) -> None:
    """A folding chair: the rear legs and the seat swing on a frame of front legs and back."""
    w, h = b.uniform(0.4, 0.48), b.uniform(0.76, 0.85)
    b.size(0.5, w, h)
    b.theme(b.choice(("steel", "wood", "dark", "paint")))
    lean = b.uniform(0.25, 0.35)
    r = b.uniform(0.009, 0.013)
    seat_z = 0.44
    foot, top = np.array([-0.2, 0, r]), np.array([-0.2 + (h - r) * np.tan(lean), 0, h])
    y = w / 2
    along = (top - foot) / np.linalg.norm(top - foot)
    for s in (-1, 1):
        b.cylinder("base", foot + (0, s * y, 0), top + (0, s * y, 0), r, None, "metal")
    b.cylinder("base", foot + 0.12 * along + (0, -y, 0), foot + 0.12 * along + (0, y, 0), 0.8 * r, None, "metal")
    slats = b.integer(1, 3)
    normal = np.array([-along[2], 0, along[0]])
    for i in range(slats):
        c = top - (0.05 + 0.07 * i) * along
        bar(b, "base", c - (0, y, 0), c + (0, y, 0), 0.05, 0.01, normal, "front")
    for s in (-1, 1):
        b.sphere("base", foot + (0, s * y, 0), r, "rubber")
    pivot = foot + (seat_z - 0.03) / along[2] * along
    inner = y - 2.2 * r - 0.004
    rear = part(b, "leg", "rear_legs")
    ground = np.array([pivot[0] + 0.26, 0, r])
    for s in (-1, 1):
        b.cylinder(rear, pivot + (0, s * inner, 0), ground + (0, s * inner, 0), r, None, "metal")
        b.cylinder("base", pivot + (0, s * y, 0), pivot + (0, s * (inner - r), 0), 0.6 * r, None, "metal")
    down = (ground - pivot) / np.linalg.norm(ground - pivot)
    b.cylinder(rear, ground - 0.1 * down + (0, -inner, 0), ground - 0.1 * down + (0, inner, 0), 0.8 * r, None, "metal")
    between = np.arccos(np.clip(down @ -along, -1, 1))
    b.hinge(rear, "base", pivot, (0, 1, 0), 0, between - 0.06, opens=(-1, 0, 0))
    seat = part(b, "seat")
    hinge_at = foot + (seat_z + 0.03) / along[2] * along
    width = inner - 1.6 * r - 0.004
    rounded(b, seat, (hinge_at[0] - b.uniform(0.3, 0.36), -width, hinge_at[2] - 0.008), (hinge_at[0] + 0.05, width, hinge_at[2] + 0.01), 0.03, "z", b.choice(("front", "fabric", "wood")))
    for s in (-1, 1):
        b.cylinder("base", hinge_at + (0, s * y, 0), hinge_at + (0, s * (width - 0.01), 0), 0.5 * r, None, "metal")
    b.hinge(seat, "base", hinge_at, (0, 1, 0), 0, b.uniform(0.9, 1.1), opens=(0, 0, 1))


CATEGORIES = {
    "cart": cart, "wheelbarrow": wheelbarrow, "stroller": stroller, "car": car, "bicycle": bicycle,
    "office_chair": office_chair, "folding_chair": folding_chair,
}  # fmt: skip
