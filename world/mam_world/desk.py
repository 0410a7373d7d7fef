"""Things that turn on a desk: lamps with arms, fans, globes, clocks."""

# ruff: noqa: RUF005  (a point plus a tuple is a vector sum here, not a joined list)

from __future__ import annotations

import numpy as np

from mam_world.kit import Builder
from mam_world.solids import TAU, arc, bar, part, rounded, settle


def _shade(b: Builder, link: str, at: np.ndarray, down: np.ndarray, r: float) -> None:
    """A bell-shaped lamp shade hanging from `at` along `down`."""
    with b.facing(at, down):
        b.vessel(link, [(0.35 * r, 0), (0.5 * r, 0.5 * r), (r, 1.5 * r)], 0.003, "accent")
        b.cylinder(link, (0, 0, -0.3 * r), (0, 0, 0.01 * r), 0.25 * r, None, "dark")
        b.sphere(link, (0, 0, 0.7 * r), 0.3 * r, "light", collision=False)


def lamp(b: Builder) -> None:
    """A desk lamp: a foot, one to three arm links with joints, a shade that tilts."""
    r = b.uniform(0.07, 0.11)
    l1, l2 = b.uniform(0.18, 0.32), b.uniform(0.16, 0.28)
    b.size(2 * r, l2, l1 + l2)
    b.theme(b.choice(("dark", "steel", "paint", "white")))
    b.lathe("base", [(r, 0), (r, 0.015), (0.3 * r, 0.03)], "body")
    z, g = 0.03, max(b.gap, 0.001)
    foot = "base"
    if b.chance(0.5):
        foot = part(b, "arm", "swivel")
        b.cylinder(foot, (0, 0, z + g), (0, 0, z + 0.025), 0.3 * r, None, "metal")
        b.spin(foot, "base", (0, 0, z), (0, 0, 1), -2.8, 2.8, closed=0.0)
        z += 0.025
    q, t = 0.012, 0.006
    z += q
    for s in (-1, 1):
        b.box(foot, (-q, s * (t + g), z - q - 0.002), (q, s * (t + g + 0.005), z + q), "metal")
    a1, a2 = b.uniform(0.1, 0.45), -b.uniform(0.9, 1.5)
    p0 = np.array([0, 0, z])
    p1 = p0 + l1 * np.array([np.sin(a1), 0, np.cos(a1)])
    p2 = p1 + l2 * np.array([np.sin(a2), 0, np.cos(a2)])
    lower = part(b, "arm", "lower_arm")
    b.cylinder(lower, p0 - (0, t, 0), p0 + (0, t, 0), 0.9 * q, None, "dark")
    pin = t + g + 0.004  # through both cheeks
    b.cylinder(lower, p0 - (0, pin, 0), p0 + (0, pin, 0), 0.3 * q, None, "metal")
    twin = b.chance(0.4)
    for s in (-1, 1) if twin else (0,):
        b.cylinder(lower, p0 + (0, s * 0.6 * t, 0), p1 + (0, s * 0.6 * t, 0),
                   0.004 if not twin else 0.0025, None, "metal")  # fmt: skip
    b.cylinder(lower, p1 - (0, t, 0), p1 + (0, t, 0), 0.9 * q, None, "dark")
    b.hinge(lower, foot, p0, (0, 1, 0), -0.9 - a1, 0.9 - a1, closed=0.0)
    if b.chance(0.85):
        upper = part(b, "arm", "upper_arm")
        side = t + g + 0.004
        b.cylinder(upper, p1 + (0, t + g, 0), p1 + (0, t + g + 0.008, 0), 0.9 * q, None, "dark")
        b.cylinder(upper, p1 + (0, side, 0), p2 + (0, side, 0), 0.004, None, "metal")
        b.cylinder(upper, p1 + (0, t + g + 0.007, 0), p1 + (0, t + g + 0.02, 0), 0.5 * q, None,
                   "metal", "handle")  # fmt: skip
        b.hinge(upper, lower, p1, (0, 1, 0), -0.5, 0.7, closed=0.0)
        p2 = p2 + (0, side, 0)
    else:
        upper, p2 = lower, p1
        side = 0.0
    head = part(b, "shade", "head")
    y = p2[1]
    w = t if upper == lower else 0.004
    b.cylinder(upper, p2 - (0, w, 0), p2 + (0, w, 0), 0.009, None, "dark")
    hr = b.uniform(0.04, 0.07)
    lean = 1.0 if upper == lower else b.choice((0.5, 0.5, np.pi / 2))
    down = np.array([-np.sin(lean), 0, -np.cos(lean)])
    start = p2 + 0.009 * down + (0, w + g + 0.003, 0)
    b.cylinder(
        head, (p2[0], y + w + g, p2[2]), (p2[0], y + w + g + 0.006, p2[2]), 0.009, None, "dark"
    )
    bar(b, head, (p2[0], start[1], p2[2]), start + 0.02 * down, 0.006, 0.012, (0, 1, 0), "dark")
    _shade(b, head, start + (0.009 + 0.3 * hr) * down, down, hr)
    b.hinge(head, upper, p2, (0, 1, 0), -0.05 if upper == lower else -0.5, 0.6, closed=0.0)


def fan(b: Builder) -> None:
    """A fan: blades that spin in a fixed cage, a neck that tilts or turns; or a ceiling fan."""
    r = b.uniform(0.1, 0.22)
    b.theme(b.choice(("white", "dark", "steel", "plastic")))
    n = b.integer(3, 6)
    g = max(b.gap, 0.002)
    if b.chance(0.25):
        _ceiling_fan(b, 2.2 * r, n, g)
        return
    d = b.uniform(0.05, 0.09)
    zc = r + b.uniform(0.06, 0.14) + (b.uniform(0.3, 0.8) if b.chance(0.3) else 0)
    b.size(2 * r, 2 * r, zc + r)
    b.lathe("base", [(0.75 * r, 0), (0.75 * r, 0.015), (0.2 * r, 0.035)], "body")
    x = 0.5 * d
    b.cylinder("base", (x + 0.06, 0, 0.02), (x + 0.06, 0, zc - 0.06), 0.015, None, "metal")
    for s in (-1, 1):
        b.box("base", (x + 0.045, s * (0.042 + g), zc - 0.06),
              (x + 0.075, s * (0.05 + g), zc + 0.015), "metal")  # fmt: skip
    b.box("base", (x + 0.045, -0.05 - g, zc - 0.068), (x + 0.075, 0.05 + g, zc - 0.06), "metal")
    head = part(b, "head")
    motor = d / 2 + 0.02
    b.cylinder(head, (motor, 0, zc), (x + 0.11, 0, zc), 0.04, 0.034, "body")
    b.cylinder(head, (x + 0.06, -0.042, zc), (x + 0.06, 0.042, zc), 0.012, None, "metal")
    pin = 0.048 + g  # through both cheeks
    b.cylinder(head, (x + 0.06, -pin, zc), (x + 0.06, pin, zc), 0.004, None, "metal")
    wires = b.integer(8, 16)
    for k in range(wires):
        t = k * TAU / wires
        e = np.array([0, np.cos(t), np.sin(t)])
        c = np.array([0, 0, zc])
        b.sweep(
            head,
            [
                c + 0.03 * e + (-d / 2, 0, 0),
                c + 0.8 * r * e + (-d / 2, 0, 0),
                c + r * e,
                c + 0.8 * r * e + (d / 2, 0, 0),
                c + 0.03 * e + (d / 2 + 0.004, 0, 0),
            ],
            0.0015,
            "metal",
            "decor",
            collision=False,
        )
    b.torus(head, (0, 0, zc), (1, 0, 0), r, 0.004, "metal")
    b.cylinder(head, (-d / 2 - 0.004, 0, zc), (-d / 2 + 0.002, 0, zc), 0.2 * r, None, "trim")
    b.cylinder(head, (d / 2, 0, zc), (motor + 0.001, 0, zc), 0.2 * r, None, "trim")
    blades = part(b, "blade", "rotor")
    b.cylinder(blades, (-0.3 * d, 0, zc), (0.35 * d, 0, zc), 0.15 * r, None, "accent")
    for k in range(n):
        with (
            b.facing((0, 0, zc), (1, 0, 0)),
            b.moved((0, 0, 0), (0, 0, 1), k * TAU / n),
            b.moved((0, 0, 0), (1, 0, 0), 0.35),
        ):
            wide = min(0.24 * r, 0.3 * d / np.sin(0.35))
            rounded(b, blades, (0.1 * r, -wide, -0.002), (0.78 * r, wide, 0.002), 0.8 * wide, "z",
                    "accent")  # fmt: skip
    b.spin(blades, head, (0, 0, zc), (1, 0, 0))
    b.hinge(head, "base", (x + 0.06, 0, zc), (0, 1, 0), -0.15, 0.35, closed=0.0)


def _ceiling_fan(b: Builder, r: float, n: int, g: float) -> None:
    """A rotor of `n` blades below a rod; it stands on its light."""
    b.size(2 * r, 2 * r, 0.4)
    h = b.uniform(0.3, 0.5)
    b.cylinder("base", (0, 0, h), (0, 0, h - 0.04), 0.07, 0.05, "body")
    b.cylinder("base", (0, 0, h - 0.04), (0, 0, 0.12), 0.012, None, "metal")
    b.cylinder("base", (0, 0, 0.12), (0, 0, 0.06 + g), 0.09, None, "body")
    blades = part(b, "blade", "rotor")
    b.cylinder(blades, (0, 0, 0.06), (0, 0, 0.025), 0.09, None, "trim")
    if b.chance(0.5):
        b.lathe(blades, [(0.02, 0.0), (0.06, 0.012), (0.07, 0.026)], "light")
    else:
        b.cylinder(blades, (0, 0, 0), (0, 0, 0.03), 0.02, None, "metal")
    for k in range(n):
        with b.moved((0, 0, 0.042), (0, 0, 1), k * TAU / n), b.moved((0, 0, 0), (1, 0, 0), 0.2):
            rounded(b, blades, (0.08, -0.07, -0.003), (r, 0.07, 0.003), 0.04, "z", "wood")
    b.spin(blades, "base", (0, 0, 0), (0, 0, 1))


def globe(b: Builder) -> None:
    """A globe that spins on an inclined axis held by a fixed arc."""
    r = b.uniform(0.08, 0.2)
    tilt = b.choice((0.41, 0.41, 0.0, 0.3))
    b.size(2.4 * r, 2.4 * r, 3 * r)
    b.lathe("base", [(0.7 * r, 0), (0.65 * r, 0.1 * r), (0.12 * r, 0.2 * r)],
            b.choice(("wood", "metal", "dark")))  # fmt: skip
    ring = 1.12 * r
    zc = 0.2 * r + b.uniform(0.1, 0.4) * r + ring
    b.cylinder("base", (0, 0, 0.15 * r), (0, 0, zc - ring), 0.06 * r, None, "metal")
    c = np.array([0, 0, zc])
    axis = np.array([0, np.sin(tilt), np.cos(tilt)])
    full = b.chance(0.25)
    if full:
        b.torus("base", c, (1, 0, 0), ring, 0.03 * r, "gold")
    else:
        start = np.pi / 2 - tilt
        b.sweep(
            "base",
            arc(c, ring, start, start - np.pi, 17, "x")
            if b.chance(0.5)
            else arc(c, ring, start, start + np.pi, 17, "x"),
            0.03 * r,
            "gold",
        )
    for s in (-1, 1):
        b.cylinder("base", c + s * axis * ring, c + s * axis * 1.015 * r, 0.03 * r, None, "gold")
    ball = part(b, "globe")
    with b.facing(c, axis):
        b.sphere(ball, (0, 0, 0), r, b.choice(("accent", "glass", "front")))
        b.torus(ball, (0, 0, 0), (0, 0, 1), 0.995 * r, 0.01 * r, "light", "decor", False)
    b.spin(ball, "base", c, axis)


def clock(b: Builder) -> None:
    """A clock: two or three hands before a fixed dial; sometimes a door or a pendulum."""
    r, t = b.uniform(0.06, 0.18), b.uniform(0.02, 0.06)
    b.size(t, 2 * r, 2 * r)
    z = 1.12 * r
    round_ = b.chance(0.65)
    if round_:
        b.cylinder("base", (t, 0, z), (0, 0, z), 1.05 * r, None, "body")
        b.tube("base", (0, 0, z), (-0.012, 0, z), 1.12 * r, 1.0 * r, "trim")
        if b.chance(0.5):
            for s in (-1, 1):
                b.cylinder("base", (t / 2, s * 0.6 * r, 0.01 * r),
                           (t / 2, s * 0.5 * r, z - 0.8 * r), 0.05 * r, None, "trim")  # fmt: skip
                b.sphere("base", (t / 2, s * 0.6 * r, z + 1.05 * r), 0.25 * r, "metal")
        else:
            b.box("base", (0, -0.5 * r, 0), (t, 0.5 * r, 0.3 * r), "body")
    else:
        b.box("base", (0, -1.1 * r, 0), (t, 1.1 * r, z + 1.1 * r), "body")
        b.tube("base", (0.002, 0, z), (-0.004, 0, z), 1.05 * r, 0.99 * r, "gold", "decor", False)
    b.cylinder("base", (0.001, 0, z), (-0.001, 0, z), r, None, "light")
    marks = b.choice((12, 12, 4))
    for k in range(marks):
        a = k * TAU / marks
        with b.facing((-0.001, 0, z), (-1, 0, 0)), b.moved((0, 0, 0), (0, 0, 1), a):
            b.box("base", (0.8 * r, -0.02 * r, 0), (0.93 * r, 0.02 * r, 0.0008), "dark", "decor",
                  False)  # fmt: skip
    b.cylinder("base", (0, 0, z), (-0.0105, 0, z), 0.02 * r, None, "metal")
    names = (("hour_hand", 0.5, 0.035), ("minute_hand", 0.78, 0.025), ("second_hand", 0.85, 0.008))
    for k, (name, length, width) in enumerate(names[: b.integer(2, 3)]):
        x = -0.003 - 0.0025 * k
        hand = part(b, "hand", name)
        a = b.uniform(0, TAU)
        with b.facing((x, 0, z), (-1, 0, 0)), b.moved((0, 0, 0), (0, 0, 1), a):
            b.box(hand, (-0.12 * r, -width * r, 0), (length * r, width * r, 0.0012),
                  "red" if k == 2 else "dark", "handle")  # fmt: skip
            b.cylinder(hand, (0, 0, 0), (0, 0, 0.0015), 0.05 * r, None, "dark", "handle")
        b.spin(hand, "base", (x, 0, z), (-1, 0, 0))
    settle(b)


CATEGORIES = {"lamp": lamp, "fan": fan, "globe": globe, "clock": clock}
