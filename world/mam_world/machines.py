"""Machines and gates: robot arms, sliding gates, barriers, cranes."""

# ruff: noqa: RUF005  (a point plus a tuple is a vector sum here, not a joined list)

from __future__ import annotations

import numpy as np

from mam_world.kit import Builder
from mam_world.mech import studs, wheel
from mam_world.solids import TAU, bar, frame, part, rounded


def robot_arm(b: Builder) -> None:
    """A chain of three to six links: a turning foot, pitching arms, a rolling wrist, a gripper."""
    k = b.uniform(0.4, 1.2)
    r = k * b.uniform(0.05, 0.075)
    n = b.integer(2, 3)
    lengths = [k * b.uniform(0.22, 0.4) for _ in range(n)]
    b.size(0.6 * k, 0.3 * k, sum(lengths))
    b.theme(b.choice(("paint", "white", "dark", "steel")))
    g = max(0.5 * b.gap, 0.001)
    if b.chance(0.5):
        b.box("base", (-1.8 * r, -1.8 * r, 0), (1.8 * r, 1.8 * r, 0.3 * r), "trim")
        studs(b, [(s * 1.5 * r, t * 1.5 * r, 0.3 * r) for s in (-1, 1) for t in (-1, 1)], (0, 0, 1),
              0.12 * r)  # fmt: skip
    else:
        b.cylinder("base", (0, 0, 0), (0, 0, 0.3 * r), 1.9 * r, None, "trim")
    b.cylinder("base", (0, 0, 0.3 * r), (0, 0, 1.4 * r), 1.2 * r, r, "body")
    z = 1.4 * r
    parent = part(b, "arm", "turret")
    b.cylinder(parent, (0, 0, z + g), (0, 0, z + 1.6 * r), r, None, "body")
    limit = b.uniform(2.0, 3.0)
    b.spin(parent, "base", (0, 0, z), (0, 0, 1), -limit, limit, closed=0.0)
    p = np.array([0, 0, z + 2.2 * r])
    y = 0.5 * r
    angle = b.uniform(-0.5, 0.2)
    b.cylinder(parent, (0, -y, p[2]), (0, y, p[2]), 0.8 * r, None, "body")
    half = 0.5 * r
    offset = 0.0
    bend = (0.0, -b.uniform(0.6, 1.2), -b.uniform(0.3, 0.7))
    for i in range(n):
        angle += bend[i]
        link = part(b, "arm", f"arm_{i}")
        e = np.array([np.sin(angle), 0, np.cos(angle)])
        q = p + lengths[i] * e
        scale = 0.8 - 0.12 * i
        side = 1 if i % 2 == 0 else -1
        mid = offset + side * (2 * half + g)
        a, c = p + (0, mid, 0), q + (0, mid, 0)
        for end in (a, c):
            b.cylinder(link, end - (0, half, 0), end + (0, half, 0), scale * r, None,
                       b.choice(("body", "trim")))  # fmt: skip
        if b.chance(0.5):
            b.cylinder(link, a, c, 0.9 * half, None, "body")
        else:
            bar(b, link, a, c, 1.2 * scale * r, 1.6 * half, (0, 1, 0), "body")
        b.cylinder(link, a - (0, side * (half + g), 0), a - (0, side * 0.5 * half, 0), 0.4 * r,
                   None, "dark")  # fmt: skip
        b.hinge(link, parent, p, (0, 1, 0), *((-0.7, 0.7) if i == 0 else (-0.5, 0.6)), closed=0.0)
        parent, p, offset = link, q, mid
    e = np.array([np.sin(angle), 0, np.cos(angle)])
    tip = p + (0, offset, 0) + 0.9 * r * e
    b.cylinder(parent, p + (0, offset, 0), tip, 0.35 * r, None, "metal")
    hand = part(b, "wrist", "flange")
    b.cylinder(hand, tip + g * e, tip + 0.4 * r * e, 0.5 * r, None, "dark")
    b.spin(hand, parent, tip, e)
    if b.chance(0.6):
        with b.facing(tip + 0.4 * r * e, e, (0, 1, 0)):
            _gripper(b, hand, r, g)


def _gripper(b: Builder, hand: str, r: float, g: float) -> None:
    """Two fingers that close on each other, above local z = 0."""
    b.box(hand, (-0.7 * r, -0.3 * r, 0), (0.7 * r, 0.3 * r, 0.3 * r), "metal")
    for s in (-1, 1):
        jaw = part(b, "finger")
        x = sorted((s * 0.42 * r, s * 0.6 * r))
        b.box(jaw, (x[0], -0.2 * r, 0.3 * r + 0.2 * g), (x[1], 0.2 * r, 1.2 * r), "dark",
              "handle")  # fmt: skip
        b.slide(jaw, hand, (-s, 0, 0), 0, 0.38 * r)


def sliding_gate(b: Builder) -> None:
    """A yard gate that rolls sideways behind a fixed fence."""
    w, h = b.uniform(1.5, 4.0), b.uniform(1.0, 1.9)
    b.size(0.2, 2 * w, h)
    b.theme(b.choice(("steel", "dark", "paint", "wood")))
    g, t = max(b.gap, 0.01), 0.04
    post = b.uniform(0.08, 0.16)
    lift = 0.09
    for y in (-w / 2 - post, w / 2):
        b.box("base", (0, y, 0), (post, y + post, h + 0.1), "stone")
        if b.chance(0.5):
            b.box("base", (-0.02, y - 0.02, h + 0.1), (post + 0.02, y + post + 0.02, h + 0.15),
                  "stone")  # fmt: skip
    x = post + g
    b.box("base", (0, -w / 2, 0), (x + t, w / 2, 0.012), "stone")
    side = b.choice((-1, 1))
    y0, y1 = sorted((side * (w / 2 + post), side * (w / 2 + post + w)))
    fixed = b.chance(0.7)
    if fixed:
        _fence(b, "base", 0.02, y0, y1, 0.0, h, t)
        b.box("base", (0, y0, 0), (x + t, y1, 0.012), "stone")
    leaf = part(b, "gate")
    _fence(b, leaf, x, -w / 2 - 0.6 * post, w / 2 + 0.6 * post, lift, h, t)
    for y in (-0.4 * w, 0.4 * w):
        b.box(leaf, (x, y - 0.06, lift - 0.03), (x + t, y + 0.06, lift + 0.001), "dark")
        roll = part(b, "wheel") if b.chance(0.4) else leaf
        r = (lift - 0.012) / 2
        if roll == leaf:
            b.cylinder(
                leaf, (x + 0.3 * t, y, 0.0125 + r), (x + 0.7 * t, y, 0.0125 + r), r, None, "metal"
            )
        else:
            b.cylinder(
                leaf, (x - 0.004, y, 0.0125 + r), (x + t, y, 0.0125 + r), 0.2 * r, None, "metal"
            )
            b.cylinder(roll, (x + 0.3 * t, y, 0.0125 + r), (x + 0.7 * t, y, 0.0125 + r), 0.95 * r,
                       None, "metal")  # fmt: skip
            b.spin(roll, leaf, (x, y, 0.0125 + r), (1, 0, 0))
    y = -side * (w / 2 - 0.06)
    b.box(leaf, (x, y - 0.05, lift + 0.02), (x + t, y + 0.05, h - 0.02), "body")
    b.handle(leaf, (x, y, 0.55 * h), (-1, 0, 0), (0, 0, 1), 0.2, b.choice(("bar", "bow", "none")))
    # the leaf stops before its handle reaches the post
    b.slide(leaf, "base", (0, side, 0), 0, b.uniform(0.6, 0.85) * w)


def _fence(
    b: Builder, link: str, x: float, y0: float, y1: float, z0: float, z1: float, t: float
) -> None:
    """A frame filled with bars or boards."""
    if z0 == 0.0:
        z0 = 0.05
        for y in (y0 + 0.1, y1 - 0.1):
            b.box(link, (x, y - 0.03, 0), (x + t, y + 0.03, z0 + 0.001), "body")
    frame(b, link, (x, y0, z0), (x + t, y1, z1), 0.05, "x", "body")
    n = int((y1 - y0) / b.uniform(0.11, 0.2))
    round_ = b.chance(0.5)
    for i in range(1, n):
        y = y0 + i * (y1 - y0) / n
        if round_:
            b.cylinder(link, (x + t / 2, y, z0 + 0.04), (x + t / 2, y, z1 - 0.04), 0.01, None,
                       "body", sides=8)  # fmt: skip
        else:
            b.box(link, (x + 0.3 * t, y - 0.025, z0 + 0.04), (x + 0.7 * t, y + 0.025, z1 - 0.04),
                  "front")  # fmt: skip


def barrier(b: Builder) -> None:
    """A road barrier: a boom that swings up on a post, or a turnstile with arms."""
    if b.chance(0.35):
        h = b.uniform(0.85, 1.0)
        b.size(0.5, 1.2, h)
        b.theme("steel")
        b.box("base", (0, -0.15, 0), (0.5, 0.0, h), "body")
        n, r = b.choice((3, 4)), b.uniform(0.35, 0.5)
        x, z, g = 0.25, 0.8 * h, max(b.gap, 0.003)
        tilt = b.choice((0.0, 0.6)) if n == 3 else 0.0
        arms = part(b, "arm", "rotor")
        b.cylinder(arms, (x, g, z), (x, 0.08, z), 0.07, None, "metal")
        for i in range(n):
            t = i * TAU / n + np.pi / 6
            e = np.array([np.cos(t) * np.cos(tilt), np.sin(tilt), np.sin(t) * np.cos(tilt)])
            b.cylinder(arms, np.array([x, 0.05, z]), np.array([x, 0.05, z]) + r * e, 0.018, None,
                       "metal", "handle")  # fmt: skip
        b.spin(arms, "base", (x, 0, z), (0, 1, 0))
        return
    l, h = b.uniform(1.8, 4.0), b.uniform(0.85, 1.1)
    b.size(0.3, l, h)
    b.theme(b.choice(("paint", "steel", "dark")))
    g = max(b.gap, 0.005)
    w = b.uniform(0.25, 0.35)
    rounded(b, "base", (0, -w / 2, 0), (w, w / 2, h), 0.03, "z", "body")
    b.box("base", (0.05, -w / 2 - 0.03, 0.0), (w - 0.05, -w / 2, 0.03), "trim")
    z, r = 0.85 * h, 0.07
    b.cylinder("base", (-0.015, 0, z), (0.0, 0, z), r, None, "metal")
    boom = part(b, "boom")
    x = -0.015 - g
    b.cylinder(boom, (x, 0, z), (x - 0.05, 0, z), r, None, "dark")
    side = b.choice((-1, 1))
    paint = ("light", "red")
    n = b.integer(4, 8)
    start, thick = 0.04, b.uniform(0.03, 0.045)
    round_ = b.chance(0.3)
    for i in range(n):
        y0, y1 = side * (start + i * l / n), side * (start + (i + 1) * l / n)
        if round_:
            b.cylinder(boom, (x - 0.025, y0, z), (x - 0.025, y1, z), thick, None, paint[i % 2])
        else:
            b.box(boom, (x - 0.025 - 0.5 * thick, min(y0, y1), z - thick),
                  (x - 0.025 + 0.5 * thick, max(y0, y1), z + thick), paint[i % 2])  # fmt: skip
    if b.chance(0.6):
        b.box(boom, (x - 0.05, min(-side * 0.05, -side * 0.4), z - 0.06),
              (x, max(-side * 0.05, -side * 0.4), z + 0.06), "dark")  # fmt: skip
    b.hinge(boom, "base", (x, 0, z), (1, 0, 0), 0, b.uniform(1.3, 1.57), opens=(0, 0, 1),
            tip=(x, side * l, z))  # fmt: skip
    if b.chance(0.6):
        y = side * (l - 0.2)
        for s in (-1, 1):
            b.box("base", (x - 0.025 + s * (thick + 0.03) - 0.008, y - 0.04, 0),
                  (x - 0.025 + s * (thick + 0.03) + 0.008, y + 0.04, z), "metal")  # fmt: skip
        b.box("base", (x - 0.025 - thick - 0.03, y - 0.04, z - thick - 0.04),
              (x - 0.025 + thick + 0.03, y + 0.04, z - thick - 0.01), "rubber")  # fmt: skip


def crane(b: Builder) -> None:
    """A toy or workshop crane: a turning mast, a luffing jib, a hook and a winch crank."""
    k = b.uniform(0.25, 1.0)
    b.size(0.8 * k, 0.4 * k, k)
    b.theme(b.choice(("paint", "wood", "steel")))
    g = max(0.5 * b.gap, 0.001)
    b.box("base", (-0.2 * k, -0.2 * k, 0.02 * k), (0.2 * k, 0.2 * k, 0.08 * k), "body")
    wheeled = b.chance(0.5)
    r = 0.06 * k
    for x in (-0.14 * k, 0.14 * k):
        for s in (-1, 1):
            if wheeled:
                y = s * (0.2 * k + 0.02 * k + g)
                b.cylinder("base", (x, s * 0.19 * k, r), (x, y, r), 0.01 * k, None, "metal")
                roll = part(b, "wheel")
                wheel(b, roll, (x, y, r), (0, 1, 0), r, 0.035 * k, b.choice(("disc", "tyre")))
                b.spin(roll, "base", (x, y, r), (0, 1, 0))
            else:
                b.cylinder("base", (x, s * 0.14 * k, 0), (x, s * 0.14 * k, 0.03 * k), 0.03 * k,
                           None, "rubber")  # fmt: skip
    z = 0.08 * k
    mast = part(b, "mast")
    b.cylinder(mast, (0, 0, z + g), (0, 0, z + 0.05 * k), 0.16 * k, None, "trim")
    for s in (-1, 1):
        b.box(mast, (-0.04 * k, s * 0.07 * k - 0.015 * k, z + 0.04 * k),
              (0.04 * k, s * 0.07 * k + 0.015 * k, z + 0.3 * k), "body")  # fmt: skip
    # a post behind the jib's foot
    b.box(mast, (0.035 * k, -0.02 * k, z + 0.05 * k), (0.06 * k, 0.02 * k, z + 0.75 * k), "body")
    b.spin(mast, "base", (0, 0, z), (0, 0, 1))
    p = np.array([0, 0, z + 0.26 * k])
    e = np.array([-np.cos(0.6), 0, np.sin(0.6)])
    l = b.uniform(0.55, 0.8) * k
    jib = part(b, "jib")
    wide = 0.05 * k - g
    b.cylinder(jib, p - (0, wide, 0), p + (0, wide, 0), 0.03 * k, None, "metal")
    for s in (-1, 1):
        b.cylinder(jib, p + (0, s * 0.7 * wide, 0), p + l * e + (0, s * 0.3 * wide, 0), 0.012 * k,
                   None, "accent")  # fmt: skip
    for f in np.linspace(0.2, 0.95, b.integer(3, 7)):
        half = (0.7 - 0.4 * f) * wide
        b.cylinder(jib, p + f * l * e - (0, half, 0), p + f * l * e + (0, half, 0), 0.008 * k, None,
                   "accent")  # fmt: skip
    tip = p + l * e
    b.cylinder(jib, tip - (0, 0.02 * k, 0), tip + (0, 0.02 * k, 0), 0.02 * k, None, "metal")
    b.hinge(jib, mast, p, (0, 1, 0), -0.3, 0.5, closed=0.0)
    crank = part(b, "crank")
    c = np.array([0.0, 0.085 * k + g, z + 0.15 * k])
    b.cylinder(crank, c, c + (0, 0.03 * k, 0), 0.012 * k, None, "metal", "handle")
    b.cylinder(crank, c + (0, 0.025 * k, 0), c + (0.06 * k, 0.025 * k, 0), 0.008 * k, None, "metal",
               "handle")  # fmt: skip
    b.cylinder(crank, c + (0.06 * k, 0.02 * k, 0), c + (0.06 * k, 0.07 * k, 0), 0.01 * k, None,
               "dark", "handle")  # fmt: skip
    b.spin(crank, mast, c, (0, 1, 0))


CATEGORIES = {
    "robot_arm": robot_arm,
    "sliding_gate": sliding_gate,
    "barrier": barrier,
    "crane": crane,
}
