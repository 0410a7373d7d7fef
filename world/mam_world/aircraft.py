"""Planes, helicopters and drones."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from mam_world.fixtures import PAINTS
from mam_world.kit import Builder
from mam_world.mech import boxes, rods, rolls
from mam_world.solids import TAU, bar, part, profile, rounded, settle, wedge
from mam_world.transport import BOTH, COATS, OUT, X, Y, Z


def _rotor(b: Builder, at: Any, axis: Any, r: float, n: int, wide: float, live: bool = True,
           ) -> None:  # fmt: skip
    """Blades on a hub that stands on `at`; a link that spins, or fixed to the base."""
    link, h, tone = part(b, "rotor") if live else "base", 0.9 * wide, b.choice(PAINTS)
    tip, start, pitch = b.uniform(0.4, 1.0), b.uniform(0, TAU), b.uniform(0.05, 0.5)
    edge = [(0, 0.3), (b.uniform(0.15, 0.6) * r, 0.5), (0.9 * r, 0.5 * tip), (r, 0.3 * tip)]
    blade = np.array([(x, -y) for x, y in edge] + edge[::-1]) * (1, wide)
    with b.facing(at, axis, X if axis[2] else Z):
        b.lathe(link, [(0.6 * h, 0), (0.5 * h, h), (0.05 * h, b.uniform(1.1, 2) * h)], tone)
        for k in range(n):
            turned = b.moved((0, 0, 0.5 * h), Z, start + TAU * k / n)
            with turned, b.moved((0, 0, 0), X, pitch):
                b.extrude(link, blade, 0.1 * wide, tone)
        if live:
            b.spin(link, "base", (0, 0, 0), Z)


def propeller_plane(b: Builder) -> None:
    """An airplane with propellers, flaps and a rudder on wheels or floats."""
    kind, half = b.choice(("low", "high", "bi", "twin")), b.uniform(0.4, 0.75)
    b.size(1, 2 * half, 0.4)
    b.theme(b.choice(COATS))
    rf, rp, g = b.uniform(0.05, 0.085), b.uniform(0.13, 0.2), max(b.gap, 0.002)
    z, n, wide = rp + b.uniform(0.03, 0.08), b.integer(2, 5), b.uniform(0.02, 0.04)
    xw, chord = b.uniform(0.22, 0.3), b.uniform(0.14, 0.24)
    with b.facing((0, 0, z), X):
        shape = [(0.5, 0), (0.85, 0.08), (1, b.uniform(0.2, 0.4)), (0.35, 0.97), (0.15, 1)]
        b.lathe("base", np.array(shape) * (rf, 1))
    wedge(b, "base", (xw, -0.6 * rf, xw + 0.25, 0.6 * rf),
          (xw + 0.05, -0.4 * rf, xw + 0.2, 0.4 * rf), z, z + 1.6 * rf, "glass")  # fmt: skip
    flap, tail, steer = (b.choice(("", "live", "still")) for _ in range(3))
    low, high, up = z - 0.6 * rf, z + 2.2 * rf, z + b.uniform(2, 3) * rf
    wings = [(xw, chord, half, z + 1.5 * rf if kind == "high" else low, flap)]
    wings += [(xw - 0.03, chord, half, high, "")] if kind == "bi" else []
    for x, c, span, zw, kit in (*wings, (0.85, 0.1, 0.3 * half, z + 0.2 * rf, tail)):
        rear, cut, e, y1, y2 = x + c, 0.28 * c, g * (kit == "live"), 0.3 * span, 0.8 * span
        edge = [(x + b.uniform(0, 0.5) * c, span), (rear, span)]
        edge += [(rear, y2), (rear - cut, y2), (rear - cut, y1), (rear, y1)] if kit else []
        plan = [(x, 0.0), *edge, *[(u, -v) for u, v in edge[::-1]]]
        profile(b, "base", plan, zw, zw + 0.1 * c, "z", "front")
        for s in BOTH if kit else ():
            link = part(b, "flap") if kit == "live" else "base"
            v0, v1 = sorted((s * (y1 + e), s * (y2 - e)))
            b.box(link, (rear - cut + e, v0, zw), (rear, v1, zw + 0.09 * c), "trim")
            if kit == "live":
                b.hinge(link, "base", (rear - cut + e, 0, zw + 0.05 * c), Y, -0.4, 0.4, closed=0.0)
    if kind == "bi":
        rods(b, "base", *[((xw + k * chord, y, low), (xw + k * chord, y, high), 0.006, "metal")
              for k in (0.55, 0.7) for y in (0.2 * half, 0.6 * half)])  # fmt: skip
    key, x = part(b, "rudder") if steer == "live" else "base", 0.95 + g * (steer == "live")
    fin = [(0.84, z + 0.3 * rf), (0.9, up), (0.95, up), (0.95, z + 0.3 * rf)]
    profile(b, "base", fin, -0.005, 0.005, "y", "trim")
    b.box(key, (x, -0.005, z + 0.6 * rf), (x + 0.06, 0.005, up), "accent")
    if steer == "live":
        b.hinge(key, "base", (x, 0, z), Z, -0.5, 0.5, closed=0.0)
    spots, y = [(-g, 0.0, z)], b.uniform(0.4, 0.55) * half
    if kind == "twin":
        x, rp = xw - b.uniform(0.06, 0.12), min(rp, 0.8 * (y - rf))
        spots = [(x - g, y, low), (x - g, -y, low)]
        rods(b, "base", ((x, y, low), (xw + 0.1, y, low), 0.03, "trim"))
    for at in spots:
        _rotor(b, at, OUT, rp, n, wide)
    rw, y, x, nose = b.uniform(0.02, 0.035), 0.2 * half, xw + 0.03, b.choice((0.12, 0.9))
    if b.chance(0.7):
        rolls(b, x, y, rw, 0.6 * rw, "tyre", b.chance(0.4))
        rolls(b, nose, 0, 0.6 * rw, 0.4 * rw, "disc", False)
        rods(b, "base", ((x, 0.75 * y, rw), (x, 0.2 * y, z - 0.4 * rf), 0.008, "metal"),
              ((x, 0.7 * y, rw), (x, 1.1 * y, rw), 0.006, "metal"),
              ((nose, 0, 0.6 * rw), (nose, 0, z), 0.006, "metal"))  # fmt: skip
    else:
        boxes(b, "base", (0.35, y, 0.03, 0.7, 0.06, 0.06, "trim"))
        legs = [((u, y, 0.04), (u, 0.3 * rf, z - 0.2 * rf), 0.007, "metal") for u in (0.2, 0.45)]
        rods(b, "base", *legs)
    settle(b)


def helicopter(b: Builder) -> None:
    """A helicopter with main and tail rotors on skids, or a drone with three to six rotors."""
    arms, h, c = b.choice((0, 0, b.integer(3, 6))), b.uniform(0.08, 0.13), b.uniform(0.18, 0.26)
    b.size(1, 1 if arms else 0.5, 0.4)
    b.theme(b.choice(COATS))
    g, z, n, flat = max(b.gap, 0.002), h + b.uniform(0.06, 0.13), b.integer(2, 5), b.chance(0.5)
    if arms:
        hull = b.uniform(0.12, 0.2)
        rounded(b, "base", (-hull, -0.7 * hull, z - 0.03), (hull, 0.7 * hull, z + 0.04), 0.08)
        b.sphere("base", (-hull, 0, z - 0.04), 0.03, "dark")
        r, guard = 0.9 * min(0.5 * np.sin(np.pi / arms), 0.5 - hull), b.chance(0.3)
        for k in range(arms):
            with b.moved((0, 0, z), Z, TAU * (k + 0.5) / arms):
                boxes(b, "base", (0.25, 0, 0, 0.5, 0.05 - 0.03 * flat, 0.03, "trim"))
                rods(b, "base", ((0.5, 0, -z if flat else -0.02), (0.5, 0, 0.04), 0.03, "dark"))
                _rotor(b, (0.5, 0, 0.04 + g), Z, r, min(n, 4), 0.12 * r)
                if guard:
                    b.torus("base", (0.5, 0, 0.02), Z, 1.05 * r, 0.01, "accent")
                    boxes(b, "base", (0.5, 0, 0.02, 0.015, 2.1 * r, 0.015, "trim"))
    else:
        side = [(0, -0.4), (0.1, -0.9), (1.7, -1), (2.2, 0.3), (1.8, 1), (0.9, 1), (0.25, 0.2)]
        if flat:
            profile(b, "base", [(x * c, z + u * h) for x, u in side], -0.75 * h, 0.75 * h, "y")
            bar(b, "base", (0.3 * c, 0, z + 0.27 * h), (0.85 * c, 0, z + 0.95 * h), 1.3 * h,
                0.03 * h, (-0.8 * h, 0, 0.65 * c), "glass")  # fmt: skip
        else:
            with b.facing((0, 0, z), X):
                b.lathe("base", np.array([(0.1, 0), (0.6, 0.15), (1, 0.9), (0.3, 2.2)]) * (h, c))
            b.sphere("base", (0.5 * c, 0, z + 0.1 * h), 0.85 * h, "glass")
        up, x, far, s = z + b.uniform(1.5, 2) * h, 1.15 * c, b.uniform(0.35, 0.5), b.choice(BOTH)
        boxes(b, "base", (x, 0.73 * h, z + 0.1 * h, 0.4 * c, 0.2 * h, 0.9 * h, "front"),
               (1.25 * c, 0, z + h, 0.9 * c, 0.8 * h, 0.5 * h, "trim"),
               (0.8, 0, z + 0.45 * h, 0.06, b.uniform(0.1, 0.25), 0.01, "trim"))  # fmt: skip
        b.cylinder("base", (1.6 * c, 0, z + 0.2 * h), (1, 0, z + 0.5 * h), 0.3 * h, 0.12 * h)
        spots, back = [(x, up)], b.chance(0.3)
        if back:  # a second main rotor in place of the tail rotor
            spots.append((0.85, up + 0.15))
        else:
            fin = [(0.9, z + 0.4 * h), (0.97, up), (1.03, up), (1, z + 0.4 * h)]
            profile(b, "base", fin, -0.05 * h, 0.05 * h, "y", "accent")
            at = (0.98, s * (0.13 * h + g), z + 0.5 * h)
            _rotor(b, at, (0, s, 0), b.uniform(0.05, 0.1), min(n, 4), 0.015, b.chance(0.8))
        for x, top in spots:
            rods(b, "base", ((x, 0, z), (x, 0, top), 0.015, "metal"))
            _rotor(b, (x, 0, top + g), Z, far, n, 0.04)
        for y in (0.8 * h, -0.8 * h):
            b.sweep("base", [(-0.02, y, 0.03), (0.03, y, 0), (2 * c, y, 0)], 0.008, "metal")
        rods(b, "base", *[((k * c, 0.8 * h, 0), (k * c, 0.3 * h, z - 0.5 * h), 0.007, "metal")
              for k in (0.6, 1.5)])  # fmt: skip
    settle(b)


CATEGORIES: dict[str, Callable[[Builder], None]] = {
    "propeller_plane": propeller_plane,
    "helicopter": helicopter,
}
