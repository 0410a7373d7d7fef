"""Plumbing: faucets, pipe valves, hand wheels."""

from __future__ import annotations

import numpy as np

from mam_world.kit import Builder
from mam_world.mech import dial, studs
from mam_world.solids import TAU, arc, bar, part, rounded


def faucet(b: Builder) -> None:
    """A tap: one lever, or two handles beside it; the spout often turns."""
    h, reach, r = b.uniform(0.12, 0.3), b.uniform(0.12, 0.2), b.uniform(0.012, 0.022)
    b.size(reach, 0.15, h)
    b.theme(b.choice(("steel", "steel", "dark", "white")))
    two, side = b.chance(0.5), b.choice((-1, 1))
    span = b.uniform(0.07, 0.11)
    if two:
        rounded(
            b, "base", (-0.03, -span - 0.03, 0), (0.03, span + 0.03, 0.012), 0.028, material="metal"
        )
    else:
        b.disc("base", (0, 0, 0), (0, 0, 1), 1.8 * r, 0.012, "metal")
    body = 0.012 + b.uniform(0.25, 0.45) * h
    b.cylinder("base", (0, 0, 0.01), (0, 0, body), 1.2 * r, r * 1.1, "metal")
    g = max(b.gap, 0.0008) if b.chance(0.6) else 0.0
    spout = part(b, "spout") if g else "base"
    rise = h - body - 0.4 * reach
    if b.chance(0.6) and rise > 0:
        path = np.concatenate(
            [
                [(0, 0, body + g)],
                arc((-0.4 * reach, 0, body + rise), 0.4 * reach, 0, np.pi, 11, "y"),
                [(-0.8 * reach, 0, body + 0.7 * rise)],
            ]
        )
    else:
        z = max(h, body + 0.04)
        path = np.array(
            [
                (0, 0, body + g),
                (0, 0, z - 0.02),
                (-0.02, 0, z),
                (-reach, 0, z),
                (-reach - 0.005, 0, z - 0.03),
            ]
        )
    b.sweep(spout, path, 0.6 * r, "metal")
    if g:
        b.cylinder(spout, (0, 0, body + g), (0, 0, body + g + 0.02), 0.95 * r, None, "metal")
        b.cylinder("base", (0, 0, body), (0, 0, body + g + 0.018), 0.4 * r, None, "metal")  # pin
        # away from a single lever the spout swings freely, towards it only where there is none
        near = -b.uniform(0.8, 2.0) if two else 0.0
        b.spin(spout, "base", (0, 0, body), (0, 0, side), near, b.uniform(0.8, 2.0), closed=0.0)
    if two:
        _two_handles(b, r, span)
        return
    lever = part(b, "lever")
    z = 0.75 * body
    b.cylinder("base", (0, side * 0.9 * r, z), (0, side * 1.8 * r, z), 0.6 * r, None, "metal")
    y = side * (1.8 * r + max(b.gap, 0.0006))
    b.cylinder(lever, (0, y, z), (0, y + side * 0.014, z), 0.62 * r, None, "metal", "handle")
    b.cylinder(lever, (0, y + side * 0.008, z), (0.0, y + side * 0.012, z + 0.075), 0.005, 0.004,
               "metal", "handle")  # fmt: skip
    b.hinge(lever, "base", (0, y, z), (0, 1, 0), 0, b.uniform(0.5, 1.0), opens=(-1, 0, 0),
            tip=(0, y, z + 0.07))  # fmt: skip


def _two_handles(b: Builder, r: float, span: float) -> None:
    """A handle on either side of the spout, `span` away, on its spindle."""
    style = b.choice(("cross", "lever", "knob"))
    for s in (-1, 1):
        y = s * span
        b.cylinder("base", (0, y, 0.01), (0, y, 0.045), 0.9 * r, 0.7 * r, "metal")
        handle = part(b, "handle")
        z = 0.045 + max(b.gap, 0.0006)
        if style == "lever":
            b.cylinder(handle, (0, y, z), (0, y, z + 0.025), 0.75 * r, None, "metal", "handle")
            b.cylinder(handle, (0, y, z + 0.017), (0, y + s * 0.07, z + 0.026), 0.006, 0.004,
                       "metal", "handle")  # fmt: skip
        else:
            dial(b, handle, (0, y, z), (0, 0, 1), 1.6 * r, 0.035,
                 "cross" if style == "cross" else "flute", "metal")  # fmt: skip
        b.cylinder("base", (0, y, 0.045), (0, y, z + 0.015), 0.3 * r, None, "metal")  # spindle
        b.disc(handle, (0, y, z + (0.025 if style == "lever" else 0.031)), (0, 0, 1), 0.25 * r,
               0.006, b.choice(("red", "green")), "decor", False)  # fmt: skip
        b.spin(handle, "base", (0, y, 0), (0, 0, s), 0, b.uniform(1.2, 2.0))


def valve(b: Builder) -> None:
    """A pipe valve: a hand wheel, a lever on a ball valve, or a knob on a plate."""
    r = b.uniform(0.02, 0.05)
    half = r * b.uniform(2.5, 4)
    b.size(2 * half, 4 * r, 5 * r)
    b.theme(b.choice(("steel", "dark", "paint")))
    style = b.choice(("gate", "ball", "plate"))
    if style == "plate":
        _plate_valve(b, r)
        return
    zc = 1.5 * r
    b.cylinder("base", (0, -half, zc), (0, half, zc), r, None, "body")
    for s in (-1, 1):
        b.cylinder("base", (0, s * half, zc), (0, s * (half - 0.5 * r), zc), 1.5 * r, None, "body")
        studs(
            b,
            [
                (1.25 * r * np.cos(t), s * half, zc + 1.25 * r * np.sin(t))
                for t in np.arange(6) * TAU / 6 + 0.4
            ],
            (0, s, 0),
            0.12 * r,
        )
    b.sphere("base", (0, 0, zc), 1.35 * r, "body")
    if style == "gate":
        top = zc + b.uniform(2.6, 4.0) * r
        b.cylinder("base", (0, 0, zc), (0, 0, top - 0.3 * r), 0.8 * r, 0.5 * r, "body")
        b.cylinder("base", (0, 0, top - 0.7 * r), (0, 0, top), 0.2 * r, None, "metal")
        turn = part(b, "wheel", "hand_wheel")
        _hand_wheel(
            b, turn, (0, 0, top + max(b.gap, 0.0005)), (0, 0, 1), b.uniform(1.4, 2.2) * r, 0.2 * r
        )
        b.spin(turn, "base", (0, 0, top), (0, 0, 1))
    else:
        top = zc + 1.9 * r
        b.cylinder("base", (0, 0, zc), (0, 0, top), 0.5 * r, None, "body")
        b.block("base", (0, 0.55 * r, top - 0.1 * r), (0.25 * r, 0.25 * r, 0.2 * r), "metal")
        lever = part(b, "lever")
        z, l = top + max(b.gap, 0.0005), b.uniform(2.5, 4.5) * r
        b.cylinder(lever, (0, 0, z), (0, 0, z + 0.35 * r), 0.5 * r, None, "metal", "handle")
        bar(b, lever, (0, 0, z + 0.2 * r), (0, l, z + 0.2 * r), 0.6 * r, 0.15 * r, material="metal",
            role="handle")  # fmt: skip
        bar(b, lever, (0, 0.45 * l, z + 0.2 * r), (0, 1.02 * l, z + 0.2 * r), 0.7 * r, 0.3 * r,
            material="red", role="handle")  # fmt: skip
        b.hinge(lever, "base", (0, 0, z), (0, 0, 1), 0, np.pi / 2, rest=b.choice((0.0, 0.0, 1.57)))


def _plate_valve(b: Builder, r: float) -> None:
    """A star-shaped knob on a plate."""
    n, d = b.integer(3, 6), 4 * r
    if b.chance(0.5):
        b.box("base", (-d, -d, 0), (d, d, 0.4 * r), "light")
    else:
        b.cylinder("base", (0, 0, 0), (0, 0, 0.4 * r), d, None, "light")
    b.cylinder("base", (0, 0, 0.4 * r), (0, 0, 0.7 * r), 0.8 * r, None, "metal")
    studs(b, [(s * 0.6 * d, t * 0.6 * d, 0.4 * r) for s in (-1, 1) for t in (-1, 1)], (0, 0, 1),
          0.12 * r)  # fmt: skip
    turn = part(b, "knob", "valve")
    z = 0.7 * r + max(b.gap, 0.0005)
    b.cylinder(turn, (0, 0, z), (0, 0, z + 1.2 * r), r, None, "accent", "handle")
    for k in range(n):
        t = k * TAU / n
        p = np.array([np.cos(t), np.sin(t), 0])
        bar(b, turn, (0.6 * r * p) + (0, 0, z + 0.6 * r), 2.3 * r * p + (0, 0, z + 0.6 * r),
            0.7 * r, 1.1 * r, material="accent", role="handle")  # fmt: skip
    b.spin(turn, "base", (0, 0, z), (0, 0, 1))


def _hand_wheel(
    b: Builder,
    link: str,
    centre: tuple[float, float, float],
    axis: tuple[float, float, float],
    radius: float,
    thick: float,
) -> None:
    """A spoked hand wheel; its hub stands on `centre`."""
    spokes = b.integer(3, 6)
    paint = b.choice(("red", "dark", "metal", "accent"))
    with b.facing(centre, axis):
        b.cylinder(link, (0, 0, 0), (0, 0, 2 * thick), 0.22 * radius, None, paint, "handle")
        b.torus(link, (0, 0, thick), (0, 0, 1), radius, 0.6 * thick, paint, "handle")
        for t in np.arange(spokes) * TAU / spokes:
            d = np.array([np.cos(t), np.sin(t), 0.0])
            b.cylinder(link, 0.15 * radius * d + (0, 0, thick), radius * d + (0, 0, thick),
                       0.4 * thick, None, paint, "handle")  # fmt: skip


def hand_wheel(b: Builder) -> None:
    """A hand wheel or a plain crank on a stand or on a wall plate."""
    r, t = b.uniform(0.08, 0.2), b.uniform(0.01, 0.02)
    b.size(2 * r, 2 * r, 3 * r)
    b.theme(b.choice(("steel", "paint", "dark")))
    g = max(b.gap, 0.0008)
    z = 1.35 * r
    if b.chance(0.5):
        rounded(b, "base", (-0.5 * r, -0.7 * r, 0), (1.1 * r, 0.7 * r, 0.12 * r), 0.1 * r)
        b.box("base", (0.25 * r, -0.25 * r, 0.12 * r), (0.85 * r, 0.25 * r, z + 0.3 * r), "body")
        x = 0.25 * r - 0.15 * r
    else:
        b.box("base", (0.25 * r, -0.9 * r, 0), (0.4 * r, 0.9 * r, 2.7 * r), "body")
        studs(b, [(0.25 * r, s * 0.75 * r, q) for s in (-1, 1) for q in (0.2 * r, 2.5 * r)],
              (-1, 0, 0), 0.06 * r)  # fmt: skip
        x = 0.1 * r
    b.cylinder("base", (0.3 * r, 0, z), (x, 0, z), 0.16 * r, None, "metal")
    turn = part(b, "wheel", "hand_wheel")
    if b.chance(0.75):
        _hand_wheel(b, turn, (x - g, 0, z), (-1, 0, 0), r, t)
        grip = (x - g - t, 0.9 * r, z) if b.chance(0.6) else None
    else:
        b.cylinder(turn, (x - g, 0, z), (x - g - 2 * t, 0, z), 0.2 * r, None, "metal", "handle")
        bar(b, turn, (x - g - t, 0, z), (x - g - t, r, z), 2 * t, t, (1, 0, 0), "metal", "handle")
        grip = (x - g - t, 0.93 * r, z)
    if grip:
        end = (grip[0] - 0.5 * r, grip[1], grip[2])
        if b.chance(0.3):
            b.cylinder(turn, grip, end, 0.3 * t, None, "metal", "handle")
            sleeve = part(b, "handle", "grip")
            b.tube(sleeve, (grip[0] - 0.8 * t, grip[1], z), (end[0] + 0.002, grip[1], z), t,
                   0.36 * t, "wood", "handle")  # fmt: skip
            b.spin(turn, "base", (x, 0, z), (1, 0, 0))
            b.spin(sleeve, turn, grip, (1, 0, 0))
            return
        b.cylinder(turn, grip, end, 0.8 * t, 1.1 * t, "wood", "handle")
    b.spin(turn, "base", (x, 0, z), (1, 0, 0))


CATEGORIES = {"faucet": faucet, "valve": valve, "hand_wheel": hand_wheel}
