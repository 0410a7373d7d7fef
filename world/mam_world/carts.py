"""Things pushed on wheels: carts, wheelbarrows, strollers."""

from __future__ import annotations

import numpy as np

from mam_world.kit import Builder
from mam_world.mech import wheel
from mam_world.solids import bar, part, profile, rounded, tray, wedge


def caster(
    b: Builder, top: tuple[float, float, float], r: float, swivel: bool, parent: str = "base"
) -> None:
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
        b.box(fork, (x - 0.3 * r, box_y[0], z0 - 0.2 * r), (x + 0.3 * r, box_y[1], z0 - 0.15 * r),
              "metal")  # fmt: skip
        bar(b, fork, (x, y0 + s * 0.06 * r, z0 - 0.17 * r), (x + trail, y0 + s * 0.06 * r, zc),
            0.5 * r, 0.12 * r, (0, 1, 0), "metal")  # fmt: skip
    b.box(fork, (x - 0.3 * r, y - w / 2 - 0.22 * r, z0 - 0.22 * r),
          (x + 0.3 * r, y + w / 2 + 0.22 * r, z0 - 0.12 * r), "metal")  # fmt: skip
    b.cylinder(fork, (x + trail, y - w / 2 - 0.24 * r, zc), (x + trail, y + w / 2 + 0.24 * r, zc),
               0.12 * r, None, "metal")  # fmt: skip
    if swivel:
        b.spin(fork, parent, (x, y, z), (0, 0, 1))
    roll = part(b, "wheel")
    with b.facing((x + trail, y, zc), (0, 1, 0)):
        b.cylinder(roll, (0, 0, -w / 2), (0, 0, w / 2), r, None, "rubber")
        b.cylinder(
            roll, (0, 0, -w / 2 - 0.08 * r), (0, 0, w / 2 + 0.08 * r), 0.5 * r, None, "accent"
        )
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
        _trolley(b, l, w)
        return
    r = min(b.uniform(0.08, 0.2), 0.3 * l)  # two axles do not meet
    ww = b.uniform(0.25, 0.5) * r
    if r < 0.12:
        b.box("base", (0, -w / 2, r), (l, w / 2, r + 0.04), "body")
    else:
        tray(b, "base", (0, -w / 2, 0.9 * r), (l, w / 2, r + 0.25), 0.02, "z", 1, "wood")
    style = b.choice(("disc", "tyre", "spoke", "cast"))
    g = 0.006
    for x in (0.18 * l, 0.82 * l) if b.chance(0.75) else (0.5 * l,):
        b.cylinder("base", (x, -w / 2 - g - 0.5 * ww, r), (x, w / 2 + g + 0.5 * ww, r), 0.1 * r,
                   None, "dark")  # fmt: skip
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
            b.box("base", (-0.04, s * 0.04 - 0.008, z - 0.02), (0.001, s * 0.04 + 0.008, z + 0.015),
                  "metal")  # fmt: skip
        b.cylinder(pole, (-0.025, -0.03, z), (-0.025, 0.03, z), 0.012, None, "metal")
        b.cylinder(pole, (-0.025, 0, z), (-0.5, 0, z + 0.15), 0.012, None, "metal")
        b.cylinder(
            pole, (-0.5, -0.08, z + 0.15), (-0.5, 0.08, z + 0.15), 0.014, None, "rubber", "handle"
        )
        b.hinge(pole, "base", (-0.025, 0, z), (0, 1, 0), 0, b.uniform(0.7, 1.1), opens=(0, 0, 1),
                tip=(-0.5, 0, z))  # fmt: skip
    else:
        b.sweep(
            "base",
            [
                (0.02, -0.3 * w, r + 0.03),
                (-0.15, -0.3 * w, 0.8),
                (-0.15, 0.3 * w, 0.8),
                (0.02, 0.3 * w, r + 0.03),
            ],
            0.014,
            "metal",
            "handle",
        )


def _trolley(b: Builder, l: float, w: float) -> None:
    """A platform on four castors with a push bar, with shelves or not."""
    r = b.uniform(0.03, 0.06)
    z = caster_height(b, r, True)
    same = caster_height(b, r, False)
    for x, swivel in ((0.12 * l, True), (0.88 * l, b.chance(0.5))):
        for s in (-1, 1):
            if not swivel:
                b.cylinder("base", (x, s * 0.4 * w, same), (x, s * 0.4 * w, z + 0.001), 0.6 * r,
                           None, "metal")  # fmt: skip
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
                b.cylinder("base", (x, s * (w / 2 - 0.02), z), (x, s * (w / 2 - 0.02), high),
                           0.012, None, "metal")  # fmt: skip
    b.sweep(
        "base",
        [
            (l - 0.03, -0.42 * w, z + 0.02),
            (l + 0.03, -0.42 * w, high),
            (l + 0.03, 0.42 * w, high),
            (l - 0.03, 0.42 * w, z + 0.02),
        ],
        0.013,
        "metal",
        "handle",
    )


def wheelbarrow(b: Builder) -> None:
    """A wheelbarrow: one or two wheels that spin, a fixed tray, legs and handles."""
    r, w = b.uniform(0.15, 0.2), b.uniform(0.5, 0.65)
    b.size(1.4, w, 0.6)
    b.theme(b.choice(("paint", "steel", "dark")))
    l = b.uniform(0.6, 0.8)
    z = 0.3
    wedge(b, "base", (0.24, -0.25 * w, 0.1 + l, 0.25 * w), (0.2, -0.27 * w, 0.13 + l, 0.27 * w), z,
          z + 0.02)  # fmt: skip
    # four sloping walls of the tray
    low, high = (0.22, 0.12 + l, 0.26 * w), (0.0, 0.2 + l, 0.5 * w)
    top = z + b.uniform(0.2, 0.28)
    for s in (-1, 1):
        bar(b, "base", ((low[0] + low[1]) / 2, s * low[2], z + 0.01),
            ((high[0] + high[1]) / 2, s * high[2], top), 0.92 * l, 0.006, (0, -s, 0.8))  # fmt: skip
    bar(b, "base", (low[0], 0, z + 0.01), (high[0], 0, top), 0.8 * w, 0.006, (1, 0, 0.8))
    bar(b, "base", (low[1], 0, z + 0.01), (high[1], 0, top), 0.8 * w, 0.006, (-1, 0, 0.5))
    twin = b.chance(0.2)
    half = 0.05
    for s in (-1, 1):
        y = s * 0.2 * w
        b.sweep(
            "base",
            [
                (-0.08, s * (half + 0.03), r),
                (0.12, y, z - 0.02),
                (l + 0.1, y, z - 0.01),
                (l + 0.55, s * 0.28 * w, z + 0.2),
                (l + 0.7, s * 0.28 * w, z + 0.2),
            ],
            0.016,
            "metal",
        )
        b.cylinder("base", (l + 0.55, s * 0.28 * w, z + 0.2), (l + 0.72, s * 0.28 * w, z + 0.2),
                   0.021, None, "rubber", "handle")  # fmt: skip
        b.sweep(
            "base",
            [
                (l - 0.05, y, z),
                (l + 0.02, s * 0.25 * w, 0.0135),
                (l + 0.12, s * 0.25 * w, 0.0135),
                (l + 0.2, y, z + 0.04),
            ],
            0.012,
            "metal",
        )
    style = b.choice(("disc", "tyre", "spoke"))
    x = -0.08
    for s in (-1, 1) if twin else (0,):
        y = s * (half + 0.13)
        roll = part(b, "wheel")
        wheel(b, roll, (x, y, r), (0, 1, 0), r, 0.07, style)
        b.spin(roll, "base", (x, y, r), (0, 1, 0))
    reach = half + (0.15 if twin else 0.03)
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
        b.cylinder(
            "base", (front + 0.02, y, 2 * rf + 0.07), (0.75 * l, y, 0.78), 0.012, None, "metal"
        )
        b.sweep(
            "base", [(0.75 * l, y, 0.78), (l + 0.08, y, 1.0), (l + 0.16, y, 1.02)], 0.012, "metal"
        )
        roll = part(b, "wheel")
        yy = s * (w / 2 + 0.025)
        b.cylinder("base", (back, s * w / 2, rr), (back, yy, rr), 0.01, None, "metal")
        wheel(b, roll, (back, yy, rr), (0, 1, 0), rr, 0.035, style)
        b.spin(roll, "base", (back, yy, rr), (0, 1, 0))
    b.cylinder("base", (l + 0.16, -w / 2 + 0.04, 1.02), (l + 0.16, w / 2 - 0.04, 1.02), 0.016, None,
               "rubber", "handle")  # fmt: skip
    swivel = b.chance(0.6)
    z = caster_height(b, rf, swivel)
    for s in (-1, 1):
        y = s * (w / 2 - 0.04)
        b.cylinder("base", (front + 0.02, y, z - 0.002), (front + 0.02, y, 2 * rf + 0.09), 0.016,
                   None, "metal")  # fmt: skip
        caster(b, (front + 0.02, y, z), rf, swivel)
    half = w / 2 - 0.065
    b.box("base", (0.15 * l, -half, seat_z), (0.62 * l, half, seat_z + 0.03), "fabric")
    bar(b, "base", (0.62 * l, 0, seat_z + 0.01), (0.85 * l, 0, seat_z + 0.45), 2 * half, 0.03,
        (-1, 0, 0.4), "fabric")  # fmt: skip
    b.cylinder("base", (0.35 * l, -w / 2 + 0.04, seat_z), (0.35 * l, w / 2 - 0.04, seat_z), 0.01,
               None, "metal")  # fmt: skip
    if b.chance(0.75):
        hood = part(b, "canopy")
        c = (0.62 * l, 0, seat_z + 0.36)
        outer_r, y = b.uniform(0.3, 0.36), w / 2 - 0.015
        start, stop = 0.55 * np.pi, 0.95 * np.pi
        theta = np.linspace(start, stop, 8)
        ring = np.stack([c[0] + outer_r * np.cos(theta), c[2] + outer_r * np.sin(theta)], 1)
        ring2 = np.stack(
            [c[0] + (outer_r - 0.012) * np.cos(theta), c[2] + (outer_r - 0.012) * np.sin(theta)], 1
        )
        profile(b, hood, np.concatenate([ring, ring2[::-1]]), -y, y, "y", "accent")
        for s in (-1, 1):
            y0, y1 = sorted((s * y, s * (y - 0.006)))
            profile(b, hood, np.concatenate([[(c[0], c[2])], ring2]), y0, y1, "y", "accent")
            # a stay from the push bar's tube up to the pin
            inner = s * (y - 0.006 - b.gap)
            b.cylinder("base", (0.75 * l, s * (w / 2 - 0.04), 0.78), (c[0], inner, c[2]), 0.008,
                       None, "metal")  # fmt: skip
        b.hinge(hood, "base", c, (0, 1, 0), -0.5, 0.25, closed=0.0)


CATEGORIES = {"cart": cart, "wheelbarrow": wheelbarrow, "stroller": stroller}
