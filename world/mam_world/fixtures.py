"""Small mechanisms that stand on a surface, and things on it that only look as if they moved.

Each function draws on link "base" in the current frame: z points out of the surface, x is up or
away from the viewer, and everything stays within `s` of the origin across the surface.
"""

from __future__ import annotations

import numpy as np

from mam_world.kit import Builder
from mam_world.mech import dial
from mam_world.solids import TAU, bored, part, pierced, rounded

PAINTS = ("dark", "metal", "light", "accent", "red", "wood", "front")


def _slack(b: Builder, s: float) -> float:
    return max(b.gap, 0.015 * s)


def push(b: Builder, s: float) -> None:
    """A push button: a cap in a collar, in a bored block, or a mushroom on its stem."""
    r = s * b.uniform(0.25, 0.6)
    travel, g = r * b.uniform(0.2, 0.7), _slack(b, s)
    kind, paint = b.choice(("collar", "block", "mushroom", "square")), b.choice(PAINTS)
    deep = travel + r * b.uniform(0.1, 0.8)
    head = travel + r * b.uniform(0.05, 0.4)
    wide = min(r + g + r * b.uniform(0.12, 0.5), s)
    low = travel + 0.01 * r
    key = part(b, "button")
    if kind == "square":
        a = r + g
        pierced(b, "base", (-wide, -wide, 0), (wide, wide, deep), [(-a, -a, a, a)], "z", "trim")
        b.box(key, (-r, -r, low), (r, r, deep + head), paint, "handle")
    elif kind == "mushroom":
        stem = 0.4 * r
        b.tube("base", (0, 0, 0), (0, 0, deep), stem + g + 0.25 * r, stem + g, "trim")
        b.cylinder(key, (0, 0, low), (0, 0, deep + travel + 0.1 * r), stem, None, "metal")
        top = deep + 1.1 * travel
        if b.chance(0.5):
            b.lathe(key, [(r, top), (r, top + 0.2 * r), (0.6 * r, top + 0.5 * r)], paint, "handle")
        else:
            b.cylinder(key, (0, 0, top), (0, 0, top + 0.3 * r), r, None, paint, "handle")
    else:
        if kind == "collar":
            b.tube("base", (0, 0, 0), (0, 0, deep), wide, r + g, b.choice(("trim", "metal")))
        else:
            bored(b, "base", (-wide, -wide, 0), (wide, wide, deep), "z", (0, 0), r + g, "trim")
        edge = b.uniform(0.7, 1.0) * r
        b.lathe(key, [(r, low), (r, deep + 0.7 * head), (edge, deep + head)], paint, "handle")
    b.slide(key, "base", (0, 0, -1), 0.0, travel)


def slider(b: Builder, s: float) -> None:
    """A carriage on rails, on a rod between posts, or a knob in a slot."""
    half, w, g = s * b.uniform(0.7, 1.0), s * b.uniform(0.12, 0.3), _slack(b, s)
    kind, paint, key = b.choice(("rails", "rod", "slot")), b.choice(PAINTS), part(b, "slider")
    end = half - (w if kind == "rod" else 0.0)
    reach = 2 * (end - w) - 2 * g
    at = b.choice((-1.0, -1.0, 1.0, b.uniform(-0.8, 0.8))) * reach / 2
    if kind == "rails":
        t, h = 0.25 * w, b.uniform(0.2, 0.8) * w
        for y in (-1, 1):
            b.block("base", (0, y * (w + g + t), h / 2), (2 * half, 2 * t, h), "metal")
        b.box(key, (at - w, -w, g), (at + w, w, h + b.uniform(0.1, 1.5) * w), paint, "handle")
    elif kind == "rod":
        h, r = w * b.uniform(1.2, 2.0), 0.3 * w
        for x in (-1, 1):
            b.block("base", (x * (half - w / 2), 0, 0.7 * h), (w, 1.2 * w, 1.4 * h), "trim")
        b.cylinder("base", (-half + w / 2, 0, h), (half - w / 2, 0, h), r, None, "metal")
        low, high = (at - w, -w, h - w), (at + w, w, h + w)
        bored(b, key, low, high, "x", (0, h), r + 0.5 * g, paint)
        if b.chance(0.6):
            b.cylinder(key, (at, 0, h + w), (at, 0, h + 2.2 * w), 0.4 * w, None, "dark", "handle")
    else:
        t, a = 0.5 * w, 0.4 * w
        hole = [(-end, -a, end, a)]
        pierced(b, "base", (-s, -2 * w, 0), (s, 2 * w, t), hole, "z", b.choice(("metal", "front")))
        b.block(key, (at, 0, t), (1.2 * w, 2 * (a - min(g, 0.4 * a)), 1.8 * t), "metal")
        size = (1.2 * w, b.uniform(1.0, 2.5) * w, b.uniform(0.5, 1.5) * w)
        b.block(key, (at, 0, 1.9 * t + size[2] / 2), size, paint, "handle")
    near, far = -reach / 2 - at, reach / 2 - at
    mid = abs(near) > 1e-6 and abs(far) > 1e-6
    more = {"closed": 0.0, "rest": 0.0} if mid else {}
    b.slide(key, "base", (1, 0, 0), near, far, **more)


def latch(b: Builder, s: float) -> None:
    """A bar that turns about a screw at its end or off its middle, beside a fixed keeper."""
    key, t, g = part(b, "latch"), s * b.uniform(0.05, 0.14), _slack(b, s)
    w, r = s * b.uniform(0.12, 0.25), s * b.uniform(0.1, 0.16)
    tail = b.choice((0.0, 0.0, b.uniform(0.2, 0.6))) * s
    rise = b.uniform(0.02, 0.2) * s
    b.cylinder("base", (0, 0, 0), (0, 0, rise), r, None, "metal")
    z = rise + 0.5 * g
    long = s * b.uniform(0.7, 0.95)
    bar = (-max(tail, w), -w, z), (long, w, z + t)
    if b.chance(0.5):
        b.box(key, *bar, b.choice(PAINTS), "handle")
    else:
        rounded(b, key, *bar, 0.8 * w, "z", b.choice(PAINTS), "handle")
    if b.chance(0.5):
        x = long - 0.6 * w
        b.cylinder(key, (x, 0, z + t), (x, 0, z + t + w), 0.5 * w, None, "dark", "handle")
    screw = key if b.chance(0.5) else "base"
    b.cylinder(screw, (0, 0, z), (0, 0, z + t + 0.4 * r), 0.7 * r, None, "metal", "fastener")
    if b.chance(0.6):  # the keeper stands where the bar does not go
        y = -w - max(g, 0.02 * s)
        b.box("base", (0.5 * long, y - 0.15 * s, 0), (0.8 * long, y, z + t), "metal")
    upper = b.choice((np.pi / 2, np.pi / 2, b.uniform(1.0, 2.6)))
    if tail > 0:
        upper = min(upper, np.pi / 2)
    b.hinge(key, "base", (0, 0, z), (0, 0, 1), 0.0, upper)


def handle_lever(b: Builder, s: float) -> None:
    """A door handle's lever on its rose, turning about its neck."""
    key, g = part(b, "handle", "lever"), _slack(b, s)
    r, t = s * b.uniform(0.12, 0.28), s * b.uniform(0.03, 0.08)
    if b.chance(0.5):
        b.cylinder("base", (0, 0, 0), (0, 0, t), 1.5 * r, None, "metal")
    else:
        b.block("base", (-0.2 * s, 0, t / 2), (1.5 * s, 3 * r, t), "metal")
    neck, z, long = 0.6 * r, t + s * b.uniform(0.15, 0.4), s * b.uniform(0.7, 0.98)
    b.cylinder(key, (0, 0, t + 0.3 * g), (0, 0, z + 0.4 * r), neck, None, "metal", "handle")
    side = b.choice((-1, 1))
    if b.chance(0.5):
        b.cylinder(key, (0, 0, z), (0, side * long, z), 0.45 * r, None, "metal", "handle")
    else:
        y = sorted((-side * 0.5 * r, side * long))
        b.box(key, (-0.5 * r, y[0], z - 0.3 * r), (0.5 * r, y[1], z + 0.3 * r), "metal", "handle")
    b.hinge(key, "base", (0, 0, z), (0, 0, 1), 0.0, b.uniform(0.5, 1.4), opens=(-1, 0, 0),
            tip=(0, side * long, z))  # fmt: skip


def knob(b: Builder, s: float) -> None:
    """A dial on the surface, on a plate or within a printed ring."""
    key, g = part(b, "knob"), max(0.5 * b.gap, 0.005 * s)
    r, t = s * b.uniform(0.25, 0.8), 0.0
    if b.chance(0.4):
        t = 0.04 * s
        b.cylinder("base", (0, 0, 0), (0, 0, t), min(1.3 * r, s), None, b.choice(PAINTS))
    dial(b, key, (0, 0, t + g), (0, 0, 1), r, r * b.uniform(0.4, 1.6))
    limits = {} if b.chance(0.3) else {"lower": 0.0, "upper": b.uniform(1.2, 5.0)}
    b.spin(key, "base", (0, 0, t), (0, 0, 1), **limits)


def valve(b: Builder, s: float) -> None:
    """A hub with one to six arms, with or without a rim, turning on a fixed stem."""
    key, n = part(b, "wheel", "valve"), b.integer(1, 6)
    stem, g, r = s * b.uniform(0.08, 0.25), _slack(b, s), s * b.uniform(0.7, 0.93)
    h = s * b.uniform(0.1, 1.2)
    b.cylinder("base", (0, 0, 0), (0, 0, h), stem, stem * b.uniform(0.6, 1.0), "metal")
    z0, thick = h + 0.4 * g, s * b.uniform(0.04, 0.12)
    z = z0 + 1.5 * thick
    paint = b.choice(PAINTS)
    b.cylinder(key, (0, 0, z0), (0, 0, z0 + 3 * thick), stem * b.uniform(0.8, 1.6), None, paint)
    flat = b.chance(0.4)
    for k in range(n):
        with b.moved((0, 0, 0), (0, 0, 1), TAU * k / n):
            if flat:
                b.box(key, (0, -thick, z - thick), (r, thick, z + thick), paint, "handle")
            else:
                b.cylinder(key, (0, 0, z), (r, 0, z), 0.7 * thick, None, paint, "handle")
            if n > 1 and b.chance(0.3):
                b.sphere(key, (r - 0.05 * s, 0, z), 1.2 * thick, paint, "handle")
    if n > 1 and b.chance(0.5):
        b.torus(key, (0, 0, z), (0, 0, 1), r, 0.8 * thick, paint, "handle")
    limits = {} if b.chance(0.5) else {"lower": 0.0, "upper": b.uniform(1.5, 6.2)}
    b.spin(key, "base", (0, 0, z), (0, 0, 1), **limits)


def flap(b: Builder, s: float) -> None:
    """A lid over a shallow box or a frame, hinged at one of its edges."""
    key, g = part(b, "lid", "flap"), max(0.3 * b.gap, 0.004 * s)
    a, w = s * b.uniform(0.5, 0.9), s * b.uniform(0.4, 0.9)
    h, t = s * b.uniform(0.05, 0.8), s * b.uniform(0.04, 0.12)
    wall = 0.08 * s
    hole = [(-a + wall, -w + wall, a - wall, w - wall)]
    pierced(b, "base", (-a, -w, 0), (a, w, h), hole, "z", b.choice(("trim", "body", "front")))
    over = b.choice((0.0, 0.0, 0.06 * s))
    b.box(key, (-a, -w - over, h + g), (a + over, w + over, h + g + t), b.choice(PAINTS))
    kind = b.choice(("none", "knob", "bar", "lip"))
    top = h + g + t
    if kind == "lip":
        b.box(key, (a, -0.2 * w, h + g), (a + over + 0.1 * s, 0.2 * w, top), "metal", "handle")
    elif kind != "none":
        b.handle(key, (0.7 * a, 0, top), (0, 0, 1), (0, 1, 0), 0.5 * s, kind)
    if b.chance(0.5):  # butt hinges: half of each leaf is only there to be seen
        for y in (-0.6 * w, 0.6 * w):
            p, q = (-a, y - 0.12 * w, h + g), (-a, y + 0.12 * w, h + g)
            b.cylinder(key, p, q, 0.3 * t, None, "metal", "decor")
    b.hinge(key, "base", (-a, 0, h + g), (0, 1, 0), 0.0, b.uniform(1.1, 1.9), opens=(0, 0, 1))


def toggle(b: Builder, s: float) -> None:
    """A stick in a boss: it tips from side to side."""
    key = part(b, "switch", "toggle")
    r, long = s * b.uniform(0.12, 0.3), s * b.uniform(0.5, 1.4)
    z, tilt = r * b.uniform(1.05, 1.6), b.uniform(0.2, 0.55)
    inner = r + max(0.3 * b.gap, 0.02 * r)
    outer = inner + r * b.uniform(0.2, 1.0)
    b.tube("base", (0, 0, 0), (0, 0, z), outer, inner, b.choice(("metal", "trim")))
    b.sphere(key, (0, 0, z), r, "metal")
    tip = np.array([-np.sin(tilt), 0, np.cos(tilt)]) * (long + r) + (0, 0, z)
    thick = r * b.uniform(0.25, 0.6)
    b.cylinder(key, (0, 0, z), tip, thick, thick * b.uniform(0.6, 1.5), "metal", "handle")
    if b.chance(0.5):
        b.sphere(key, tip, thick * b.uniform(1.5, 2.5), b.choice(PAINTS), "handle")
    b.hinge(key, "base", (0, 0, z), (0, 1, 0), 0.0, 2 * tilt, opens=(1, 0, 0), tip=tip)


def crank(b: Builder, s: float) -> None:
    """An arm or a disc with a grip off its middle, going round and round."""
    key, g = part(b, "crank"), _slack(b, s)
    stem, h, t = s * b.uniform(0.1, 0.25), s * b.uniform(0.05, 0.5), s * b.uniform(0.06, 0.14)
    b.cylinder("base", (0, 0, 0), (0, 0, h), 1.4 * stem, None, "trim")
    z, r = h + 0.4 * g, s * b.uniform(0.6, 0.9)
    if b.chance(0.4):
        b.cylinder(key, (0, 0, z), (0, 0, z + t), r, None, b.choice(PAINTS))
        b.cylinder(key, (0, 0, z + t), (0, 0, z + 2 * t), stem, None, "metal")
    else:
        b.box(key, (-stem, -0.8 * stem, z), (r, 0.8 * stem, z + t), "metal", "handle")
        b.cylinder(key, (0, 0, z), (0, 0, z + 1.4 * t), stem, None, "metal")
    x, grip = r - 0.12 * s, s * b.uniform(0.06, 0.1)
    long = s * b.uniform(0.3, 0.9)
    # a nut on the axle, as tall as half the grip: the axis runs through the part
    b.cylinder(key, (0, 0, z + t), (0, 0, z + t + 0.6 * long), 0.6 * stem, None, "metal")
    b.cylinder(key, (x, 0, z + t), (x, 0, z + t + long), grip, grip * b.uniform(0.8, 1.3),
               b.choice(PAINTS), "handle")  # fmt: skip
    b.spin(key, "base", (0, 0, z), (0, 0, 1))


def pull(b: Builder, s: float) -> None:
    """A rod with a knob, a ring or a bar that is drawn out of its bushing."""
    key, g = part(b, "handle", "pull"), _slack(b, s)
    r, h = s * b.uniform(0.08, 0.2), s * b.uniform(0.25, 0.9)
    b.tube("base", (0, 0, 0), (0, 0, h), r + 0.5 * g + 0.6 * r, r + 0.5 * g, "metal")
    travel = h * b.uniform(0.4, 0.85)
    z = h + s * b.uniform(0.05, 0.4)
    b.cylinder(key, (0, 0, 0.02 * s), (0, 0, z + 0.2 * r), r, None, "metal")
    kind, paint = b.choice(("ball", "disc", "bar", "ring")), b.choice(PAINTS)
    if kind == "ball":
        b.sphere(key, (0, 0, z + 2 * r), 2.2 * r, paint, "handle")
    elif kind == "disc":
        b.cylinder(key, (0, 0, z), (0, 0, z + r), 3 * r, None, paint, "handle")
    elif kind == "bar":
        b.block(key, (0, 0, z + r), (1.4 * r, min(8 * r, 1.9 * s), 2 * r), paint, "handle")
    else:
        b.torus(key, (0, 0, z + 3 * r), (1, 0, 0), 2.6 * r, 0.5 * r, paint, "handle")
    b.slide(key, "base", (0, 0, 1), 0.0, travel)


def lever(b: Builder, s: float) -> None:
    """An arm between cheeks or out of a slotted box, leaning at rest, that swings over."""
    key, g = part(b, "lever"), _slack(b, s)
    half, r = s * b.uniform(0.06, 0.2), s * b.uniform(0.12, 0.25)
    z = r + s * b.uniform(0.02, 0.4)
    for y in (-1, 1):
        y0, y1 = half + g, half + g + s * b.uniform(0.06, 0.3)
        b.box("base", (-r, min(y * y0, y * y1), 0), (r, max(y * y0, y * y1), z + 0.9 * r), "trim")
    b.cylinder(key, (0, -half, z), (0, half, z), 0.9 * r, None, "metal")
    if b.chance(0.5):
        b.cylinder("base", (0, -half - g - 0.2 * s, z), (0, half + g + 0.2 * s, z), 0.3 * r, None,
                   "metal", "fastener")  # fmt: skip
    tilt, long = b.uniform(-1.0, 0.1), s * b.uniform(0.7, 2.5)
    tip = np.array([np.sin(tilt), 0, np.cos(tilt)]) * long + (0, 0, z)
    b.cylinder(key, (0, 0, z), tip, 0.7 * half, 0.6 * half, "metal", "handle")
    if b.chance(0.5):
        b.sphere(key, tip, half * b.uniform(0.8, 1.8), b.choice(PAINTS), "handle")
    else:
        b.cylinder(key, tip + 0.4 * ((0, 0, z) - tip), tip, half, None, b.choice(PAINTS), "handle")
    upper = b.uniform(0.5, 1.1 - tilt)
    b.hinge(key, "base", (0, 0, z), (0, 1, 0), 0.0, upper, opens=(1, 0, 0), tip=tip)


def pedal(b: Builder, s: float) -> None:
    """A plate that is held up at a slant and pressed down, hinged at its far end."""
    key, t = part(b, "pedal"), s * b.uniform(0.05, 0.1)
    long, w, up = s * b.uniform(1.2, 1.8), s * b.uniform(0.25, 0.7), b.uniform(0.2, 0.5)
    x0, z = -0.5 * long, t + 0.03 * s
    for y in (-1, 1):
        g = max(b.gap, 0.01 * s)
        y0, y1 = sorted((y * (w + g), y * (w + g + 0.15 * s)))
        b.box("base", (x0 - t, y0, 0), (x0 + 2 * t, y1, z + t), "trim")
    with b.moved((x0, 0, z), (0, 1, 0), -up):
        b.box(key, (0, -w, -t / 2), (long, w, t / 2), b.choice(PAINTS), "handle")
        if b.chance(0.5):
            for x in np.linspace(0.4, 0.95, 5):
                b.block(key, (x * long, 0, t / 2), (0.3 * t, 1.8 * w, 0.3 * t), "rubber", "decor")
    b.cylinder(key, (x0, -w, z), (x0, w, z), 0.8 * t, None, "metal")
    b.hinge(key, "base", (x0, 0, z), (0, 1, 0), 0.0, up, opens=(0, 0, -1),
            tip=(x0 + long, 0, z + 0.1 * s))  # fmt: skip


def seesaw(b: Builder, s: float) -> None:
    """A rocker or a beam on its pivot, tipping either way."""
    key, g = part(b, "rocker"), _slack(b, s)
    half, w, t = s * b.uniform(0.5, 0.95), s * b.uniform(0.1, 0.4), s * b.uniform(0.04, 0.12)
    tilt = b.uniform(0.12, 0.45)
    z = half * np.sin(tilt) + 1.5 * t
    for y in (-1, 1):
        y0, y1 = sorted((y * (w + g), y * (w + g + 0.12 * s)))
        b.box("base", (-0.15 * s, y0, 0), (0.15 * s, y1, z + t), "trim")
    with b.moved((0, 0, z), (0, 1, 0), tilt):
        b.box(key, (-half, -w, -t / 2), (half, w, t / 2), b.choice(PAINTS), "handle")
        b.cylinder(key, (0, -w, 0), (0, w, 0), t, None, "metal")
    b.hinge(key, "base", (0, 0, z), (0, -1, 0), 0.0, 2 * tilt)


def press(b: Builder, s: float) -> None:
    """A housing with a slot in its side, and a lever in the slot that is pressed down."""
    key, g = part(b, "handle", "press"), _slack(b, s)
    h, w, t = s * b.uniform(0.8, 2.0), s * b.uniform(0.4, 0.9), s * b.uniform(0.05, 0.12)
    slot = s * b.uniform(0.06, 0.14)
    low, high = 0.12 * h, 0.88 * h
    x0 = -0.3 * s
    pierced(b, "base", (x0, -w, 0), (x0 + t, w, h), [(-slot, low, slot, high)], "x", "trim")
    b.shell("base", (x0 + t, -w, 0), (0.9 * s, w, h), t, "-x", b.choice(PAINTS), "solid")
    half = slot * b.uniform(0.6, 1.0)
    z = high - g - half
    y = slot - g
    b.box(key, (x0 - 0.1 * s, -y, z - half), (x0 + 2 * t, y, z + half), "metal")
    wide, out = s * b.uniform(0.12, 0.5), s * b.uniform(0.2, 0.5)
    paint = b.choice(PAINTS)
    p, q = (x0 - 0.1 * s - out, -wide, z - half), (x0 - 0.1 * s, wide, z + half)
    if b.chance(0.7):
        b.box(key, p, q, paint, "handle")
    else:
        x = q[0] - half
        b.cylinder(key, (x, -wide, z), (x, wide, z), half, None, paint, "handle")
    b.slide(key, "base", (0, 0, -1), 0.0, (z - half - low - g) * b.uniform(0.5, 1.0))


MECHANISMS = {
    "button": push, "slider": slider, "latch": latch, "handle": handle_lever, "dial": knob,
    "valve": valve, "flap": flap, "toggle": toggle, "crank": crank, "pull": pull, "lever": lever,
    "pedal": pedal, "seesaw": seesaw, "press": press,
}  # fmt: skip


def decoy(b: Builder, s: float) -> None:
    """Something fixed with the look of a part: lamp, socket, plate, stop, pipe, knob or block."""
    kind = b.choice(("bulb", "socket", "plate", "knob", "block", "pipe", "peg", "bracket", "ring"))
    r = s * b.uniform(0.2, 0.6)
    paint = b.choice(PAINTS)
    if kind == "bulb":
        b.cylinder("base", (0, 0, 0), (0, 0, 0.6 * r), 0.6 * r, None, "metal")
        b.sphere("base", (0, 0, 1.4 * r), r, b.choice(("glass", "light", "red", "green")))
    elif kind == "socket":
        b.block("base", (0, 0, 0.1 * r), (2 * r, 2 * r, 0.2 * r), "light")
        for y in (-0.4 * r, 0.4 * r):
            b.cylinder("base", (0, y, 0.2 * r), (0, y, 0.22 * r), 0.15 * r, None, "dark", "decor")
    elif kind == "plate":
        b.block("base", (0, 0, 0.05 * r), (2 * r, b.uniform(1, 3) * r, 0.1 * r), paint, "decor")
    elif kind == "knob":
        dial(b, "base", (0, 0, 0), (0, 0, 1), r, r * b.uniform(0.4, 1.3))
    elif kind == "block":
        size = np.array([b.uniform(0.5, 2), b.uniform(0.5, 2), b.uniform(0.3, 2)]) * r
        b.block("base", (0, 0, size[2] / 2), size, paint)
    elif kind == "pipe":
        t = np.linspace(0, np.pi, 9)
        path = np.stack([0 * t, -r * np.cos(t), 1.2 * r * np.sin(t)], 1)
        b.sweep("base", path, 0.15 * r, "metal")
    elif kind == "peg":
        b.cylinder("base", (0, 0, 0), (0, 0, r * b.uniform(1, 3)), 0.3 * r, None, paint)
    elif kind == "bracket":
        b.block("base", (0, 0, 0.1 * r), (1.6 * r, 2 * r, 0.2 * r), "metal")
        b.block("base", (0.7 * r, 0, 0.8 * r), (0.2 * r, 2 * r, 1.6 * r), "metal")
    else:
        b.torus("base", (0, 0, 0.2 * r), (0, 0, 1), 0.8 * r, 0.2 * r, paint, "decor")
