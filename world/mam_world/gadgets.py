"""Workshop and garden devices with one moving part: vices, winches, hatches, gates, swings."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mam_world.fixtures import PAINTS
from mam_world.kit import Builder
from mam_world.mech import studs
from mam_world.solids import TAU, bored, frame, part, pierced, profile, settle


def bench_vice(b: Builder) -> None:
    """Two jaws, one of which slides on a bar and carries the screw with its tommy bar."""
    w, h = b.uniform(0.06, 0.16), b.uniform(0.05, 0.12)
    t, travel = b.uniform(0.02, 0.04), b.uniform(0.04, 0.12)
    b.size(0.3, w, h)
    b.theme(b.choice(("paint", "steel", "dark")))
    foot, g = b.uniform(0.012, 0.03), max(b.gap, 0.0006)
    long, r = travel + 3 * t, 0.012
    b.box("base", (-t, -w / 2, 0), (long, w / 2, foot), "body")
    spots = [(x, s * 0.4 * w, foot) for x in (2 * t, long - 0.5 * t) for s in (-1, 1)]
    studs(b, spots, (0, 0, 1), 0.006)
    z = foot + 0.4 * h
    bored(b, "base", (0, -w / 2, foot), (t, w / 2, foot + h), "x", (0, z), r + g)
    b.box("base", (t, -0.5 * w, foot + 0.8 * h), (t + 0.004, 0.5 * w, foot + h), "metal")
    jaw, rest = part(b, "jaw"), b.choice((0.0, 0.0, 0.5)) * travel
    x = -t - g - rest
    b.box(jaw, (x, -w / 2, foot + g), (x + t, w / 2, foot + h), b.choice(("body", "trim")))
    end = min(t + travel, long - 0.005)
    b.cylinder(jaw, (x - 0.03, 0, z), (end - rest, 0, z), r * 0.95, None, "metal")
    b.cylinder(jaw, (x - 0.022, -0.35 * w, z), (x - 0.022, 0.35 * w, z), 0.005, None, "metal",
               "handle")  # fmt: skip
    b.slide(jaw, "base", (-1, 0, 0), -rest, travel - rest, closed=-rest, open=travel - rest)


def caliper(b: Builder) -> None:
    """A slide gauge: a beam with a fixed jaw, and a jaw that runs on it."""
    long, h, t = b.uniform(0.15, 0.4), b.uniform(0.012, 0.025), b.uniform(0.003, 0.006)
    b.size(t, long, 4 * h)
    b.theme("steel")
    g, jaw = max(b.gap, 0.0004), b.uniform(2.0, 4.0) * h
    z = jaw
    b.box("base", (0, -long / 2, z), (t, long / 2, z + h), "metal")
    b.box("base", (0, -long / 2, 0), (t, -long / 2 + h, z), "metal")
    for k in range(12):
        y = -long / 2 + 1.5 * h + k * (long - 2.5 * h) / 12
        b.block("base", (0, y, z + 0.3 * h), (0.0004, 0.0006, 0.4 * h), "dark", "decor", False)
    key, wide = part(b, "slider", "jaw"), h * b.uniform(1.5, 3)
    at = -long / 2 + h + g + b.choice((0.0, 0.2)) * long
    for x in (-0.6 * t - g, t + g):
        b.box(key, (x, at, z - 0.2 * h), (x + 0.6 * t, at + wide, z + 1.2 * h), "metal")
    b.box(key, (-0.6 * t - g, at, z + h + g), (1.6 * t + g, at + wide, z + 1.35 * h), "metal")
    b.box(key, (-0.6 * t - g, at, 0), (1.6 * t + g, at + h, z - g), "metal")
    if b.chance(0.6):
        b.cylinder(key, (t / 2, at + wide / 2, z + 1.35 * h), (t / 2, at + wide / 2, z + 1.8 * h),
                   0.35 * h, None, "dark", "handle")  # fmt: skip
    first = at + long / 2 - h - g
    b.slide(key, "base", (0, 1, 0), -first, long / 2 - wide - at, closed=-first)


def syringe(b: Builder) -> None:
    """A barrel with flanges and a nozzle, and the plunger that is drawn out or pushed in."""
    r, long = b.uniform(0.006, 0.04), b.uniform(0.08, 0.3)
    b.size(2 * r, 2 * r, 2 * long)
    b.theme(b.choice(("plastic", "white", "steel")))
    wall, g = 0.12 * r, float(np.clip(0.4 * b.gap, 0.03 * r, 0.08 * r))
    b.vessel("base", [(r, 0), (r, long)], wall, b.choice(("glass", "body")))
    b.cylinder("base", (0, 0, 0), (0, 0, -0.1 * long), 0.25 * r, 0.12 * r, "light")
    pierced(b, "base", (-r, -1.9 * r, long), (r, 1.9 * r, long + 0.15 * r),
            [(-0.9 * r, -0.9 * r, 0.9 * r, 0.9 * r)], "z")  # fmt: skip
    key = part(b, "plunger")
    out, low = b.uniform(0.1, 0.7) * long, wall + g
    inner = r - wall - g
    b.cylinder(key, (0, 0, low + out), (0, 0, low + out + 0.5 * r), inner, None, "rubber")
    top = long + 0.4 * r + out
    for size in ((1.2 * inner, 0.2 * r), (0.2 * r, 1.2 * inner)):
        b.box(key, (-size[0] / 2, -size[1] / 2, low + out + 0.5 * r),
              (size[0] / 2, size[1] / 2, top), "light")  # fmt: skip
    b.cylinder(key, (0, 0, top), (0, 0, top + 0.15 * r), 1.1 * r, None, "light", "handle")
    b.slide(key, "base", (0, 0, -1), 0.0, out)
    settle(b)


def hatch(b: Builder) -> None:
    """A trapdoor in a floor or a roof: a frame with one leaf or two, grips, bands and bolts."""
    d, w, t = b.uniform(0.4, 1.2), b.uniform(0.4, 1.4), b.uniform(0.02, 0.06)
    b.size(d, w, 0.1)
    b.theme(b.choice(("wood", "steel", "paint")))
    tall, rim, g = b.uniform(0.03, 0.3), b.uniform(0.05, 0.4), max(b.gap, 0.002)
    hole = [(-d / 2, -w / 2, d / 2, w / 2)]
    pierced(b, "base", (-d / 2 - rim, -w / 2 - rim, 0), (d / 2 + rim, w / 2 + rim, tall), hole)
    ledge = 0.04
    if tall > 2 * t:
        frame(b, "base", (-d / 2, -w / 2, 0), (d / 2, w / 2, tall - t - g), ledge, "z", "trim")
    double = b.chance(0.35)
    room = t**2 / w + g
    for s in (-1, 1) if double else (b.choice((-1, 1)),):
        link = part(b, "door", "leaf")
        y = sorted((s * (w / 2 - g), s * room if double else -s * (w / 2 - g - t**2 / w)))
        lo, hi = (-d / 2 + g, y[0], tall - t), (d / 2 - g, y[1], tall)
        b.panel(link, lo, hi, "front")
        for share in (0.2, 0.8):
            x = -d / 2 + share * d
            if b.chance(0.6):
                b.box(link, (x - 0.02, y[0], tall), (x + 0.02, y[1], tall + 0.006), "metal")
        kind = b.choice(("ring", "bar", "recessed", "bow"))
        b.handle(link, (0, s * (0.1 * w if double else -0.35 * w), tall), (0, 0, 1), (1, 0, 0),
                 0.15, kind)  # fmt: skip
        b.hinge(link, "base", (0, s * (w / 2 - g), tall), (1, 0, 0), 0.0, b.uniform(1.2, 1.6),
                opens=(0, 0, 1))  # fmt: skip


def fence_gate(b: Builder) -> None:
    """A gate of bars or boards between posts, with a piece of fence on either side."""
    w, h = b.uniform(0.6, 1.4), b.uniform(0.6, 1.4)
    b.size(0.1, 2 * w, h)
    b.theme(b.choice(("wood", "steel", "dark", "white")))
    post, g = b.uniform(0.03, 0.06), max(b.gap, 0.008)
    n, boards = b.integer(4, 9), b.chance(0.5)
    fields = [("leaf", -w / 2 + post + g, w / 2 - post - g)]
    for s in (-1, 1):
        b.block("base", (0, s * w / 2, 0.55 * h), (2 * post, 2 * post, 1.1 * h), "body")
        if b.chance(0.7):
            y = sorted((s * (w / 2 + post), s * b.uniform(1.0, 1.5) * w))
            fields.append(("base", y[0], y[1]))
    link, t = part(b, "door", "gate"), b.uniform(0.3, 0.7) * post
    for name, y0, y1 in fields:
        to = link if name == "leaf" else "base"
        for z in (0.25, 0.85):
            b.box(to, (-t / 2, y0, z * h - t), (t / 2, y1, z * h + t), "body")
        for y in np.linspace(y0 + t, y1 - t, n):
            if boards:
                half = 0.35 * (y1 - y0) / n
                lo, hi = max(y - half, y0), min(y + half, y1)
                b.box(to, (-t, lo, 0.08 * h), (-t / 2, hi, h), "front")
            else:
                b.cylinder(to, (0, y, 0.08 * h), (0, y, h), 0.35 * t, None, "body")
    s = b.choice((-1, 1))
    if b.chance(0.6):
        y = -s * (w / 2 - post - g)
        b.block(link, (-t - 0.01, y + s * 0.06, 0.6 * h), (0.02, 0.1, 0.03), "metal", "handle")
    for z in (0.25, 0.85):
        y = s * (w / 2 - post - g / 2)
        b.cylinder(link, (-t, y, z * h - t), (-t, y, z * h + t), 0.4 * t, None, "metal", "decor")
    b.hinge(link, "base", (-t, s * (w / 2 - post - g), h / 2), (0, 0, 1), 0.0, b.uniform(1.2, 1.57),
            opens=(-1, 0, 0))  # fmt: skip
    settle(b)


def winch(b: Builder) -> None:
    """A drum between two cheeks, turned by a crank."""
    r, w = b.uniform(0.03, 0.12), b.uniform(0.06, 0.3)
    b.size(3 * r, w, 3 * r)
    b.theme(b.choice(("paint", "steel", "wood", "dark")))
    t, g, z = 0.15 * r + 0.004, max(b.gap, 0.001), 1.7 * r
    b.box("base", (-1.5 * r, -w / 2 - t, 0), (1.5 * r, w / 2 + t, 0.2 * r), "body")
    axle = 0.2 * r
    for s in (-1, 1):
        y = sorted((s * w / 2, s * (w / 2 + t)))
        bored(b, "base", (-0.7 * r, y[0], 0.2 * r), (0.7 * r, y[1], 2.3 * r), "y", (0, z),
              1.1 * axle)  # fmt: skip
    drum, end = part(b, "drum"), w / 2 - g
    b.cylinder(drum, (0, -end, z), (0, end, z), 0.6 * r, None, b.choice(PAINTS))
    for s in (-1, 1):
        b.cylinder(drum, (0, s * end, z), (0, s * 0.9 * end, z), 1.2 * r, None, "metal")
    out = w / 2 + t + b.uniform(0.5, 1.0) * r
    side = b.choice((-1, 1))
    b.cylinder(drum, (0, -side * (w / 2 + 1.5 * t), z), (0, side * out, z), axle, None, "metal")
    arm = r * b.uniform(0.9, 1.6)
    b.cylinder(drum, (0, side * out, z), (0, side * out, z - arm), axle, None, "metal", "handle")
    b.cylinder(drum, (0, side * out, z - arm), (0, side * (out + 0.8 * r), z - arm), 1.2 * axle,
               None, "dark", "handle")  # fmt: skip
    b.spin(drum, "base", (0, 0, z), (0, 1, 0))
    settle(b)


def paper_cutter(b: Builder) -> None:
    """A board with a ruler, and a long arm with a blade that comes down along its edge."""
    d, w, t = b.uniform(0.2, 0.5), b.uniform(0.2, 0.4), b.uniform(0.01, 0.03)
    b.size(d, w, 0.1)
    b.theme(b.choice(("wood", "steel", "paint", "plastic")))
    b.box("base", (0, -w / 2, 0), (d, w / 2, t), "body")
    b.box("base", (0.9 * d, -w / 2, t), (0.94 * d, w / 2, t + 0.006), "metal")
    for k in range(6):
        y = -w / 2 + (k + 0.5) * w / 6
        b.box("base", (0.1 * d, y, t), (0.85 * d, y + 0.001, t + 0.0005), "dark", "decor", False)
    s, g, thick = b.choice((-1, 1)), max(b.gap, 0.0008), b.uniform(0.006, 0.015)
    y0, y1 = sorted((s * (w / 2 + g), s * (w / 2 + g + thick)))
    arm, rest, z = part(b, "arm", "blade"), b.uniform(0.2, 0.8), 0.7 * t
    with b.moved((0.95 * d, 0, z), (0, 1, 0), rest):
        b.box(arm, (-0.95 * d, y0, -0.25 * t), (0.02, y1, 0.6 * t + 0.01), "metal")
        b.box(arm, (-1.3 * d, y0, 0), (-0.95 * d, y1, 0.6 * t + 0.01), "dark", "handle")
    b.cylinder(arm, (0.95 * d, y0, z), (0.95 * d, y1, z), 0.3 * t, None, "metal")
    b.hinge(arm, "base", (0.95 * d, s * w / 2, z), (0, 1, 0), 0.0, rest, opens=(0, 0, -1),
            tip=(0, s * w / 2, z + 0.1))  # fmt: skip
    settle(b)


def linear_stage(b: Builder) -> None:
    """A carriage on two rods or rails between end plates, with a fixed screw and motor."""
    long, w, h = b.uniform(0.15, 0.8), b.uniform(0.05, 0.2), b.uniform(0.03, 0.08)
    b.size(long, w, h)
    b.theme(b.choice(("steel", "dark", "paint", "wood")))
    t, r, g = b.uniform(0.008, 0.02), 0.12 * h, max(b.gap, 0.0006)
    z, upright = 0.6 * h, b.chance(0.3)
    turn = np.eye(4)
    if upright:  # the axis stands
        turn[:3, :3] = [[0, 0, -1], [0, 1, 0], [1, 0, 0]]
    elif b.chance(0.5):  # the axis runs across
        turn[:3, :3] = [[0, -1, 0], [1, 0, 0], [0, 0, 1]]
    with b.at(turn):
        b.box("base", (0, -w / 2, 0), (long, w / 2, 0.2 * h), "body")
        for x in (0.0, long - t):
            b.box("base", (x, -w / 2, 0.2 * h), (x + t, w / 2, h), "body")
        for s in (-0.35, 0.35):
            b.cylinder("base", (t / 2, s * w, z), (long - t / 2, s * w, z), r, None, "metal")
        if b.chance(0.6):
            b.cylinder("base", (t, 0, z), (long - t, 0, z), 0.7 * r, None, "dark")
            b.block("base", (long + 0.2 * w, 0, z), (0.4 * w, 0.4 * w, 0.4 * w), "dark")
        key, size = part(b, "carriage", "slider"), b.uniform(0.12, 0.3) * long
        room = long - 2 * t - size - 2 * g
        at = t + g + b.choice((0.0, 0.0, 0.5, b.uniform(0, 1))) * room
        for s in (-1, 1):
            y = sorted((s * 0.1 * w, s * 0.5 * w))
            bored(b, key, (at, y[0], 0.2 * h + g), (at + size, y[1], h - g), "x",
                  (s * 0.35 * w, z), r + g)  # fmt: skip
        b.box(key, (at, -0.5 * w, h - g), (at + size, 0.5 * w, h + 0.1 * h), b.choice(PAINTS))
        low = t + g - at
        b.slide(key, "base", (1, 0, 0), low, low + room, closed=0.0)
    settle(b)


def balance(b: Builder) -> None:
    """A beam balance: a column, and a beam with two pans that tips about its knife edge."""
    h, half = b.uniform(0.15, 0.4), b.uniform(0.1, 0.3)
    b.size(0.1, 2 * half, h)
    b.theme(b.choice(("wood", "steel", "dark")))
    r = max(b.uniform(0.006, 0.015), 0.05 * half)
    b.cylinder("base", (0, 0, 0), (0, 0, 0.06 * h), 0.4 * half, None, "body")
    b.cylinder("base", (0, 0, 0.06 * h), (0, 0, h - 0.8 * r), r, 0.7 * r, "metal")
    for s in (-1, 1):
        y = sorted((s * 1.3 * r, s * 2.0 * r))
        b.box("base", (y[0], -r, h - 2.5 * r), (y[1], r, h + r), "metal")
    b.box("base", (-2 * r, -r, h - 3.2 * r), (2 * r, r, h - 2.2 * r), "metal")
    beam, drop = part(b, "beam", "rocker"), b.uniform(0.2, 0.5) * h
    b.cylinder(beam, (-1.25 * r, 0, h), (1.25 * r, 0, h), 0.7 * r, None, "metal")
    b.cylinder(beam, (-1.9 * r, 0, h), (1.9 * r, 0, h), 0.2 * r, None, "metal")  # in the cheeks
    profile(b, beam, [(-half, h + 0.3 * r), (0, h - 0.8 * r), (half, h + 0.3 * r),
                      (0, h + 2 * r)], -0.5 * r, 0.5 * r, "x", "gold")  # fmt: skip
    pan = b.uniform(0.25, 0.4) * half
    for s in (-1, 1):
        at = s * 0.97 * half
        b.cylinder(beam, (0, at, h - drop), (0, at, h + 0.3 * r), 0.2 * r, None, "metal")
        with b.moved((0, at, h - drop)):
            b.lathe(beam, [(0.5 * pan, 0), (pan, 0.15 * pan), (0.95 * pan, 0.17 * pan)], "gold")
    tilt = b.uniform(0.1, 0.25)
    b.hinge(beam, "base", (0, 0, h), (1, 0, 0), -tilt, tilt, closed=0.0)


def windmill(b: Builder) -> None:
    """A tower with a rotor of blades before its head."""
    h, r, n = b.uniform(0.3, 3.0), b.uniform(0.3, 0.9), b.integer(2, 8)
    b.size(0.3 * h, h, 1.5 * h)
    b.theme()
    r = r * 0.85 * h
    z = h
    if b.chance(0.5):
        b.cylinder("base", (0, 0, 0), (0, 0, z), 0.08 * h, 0.04 * h, "body")
    else:
        for s in (-1, 1):
            for q in (-1, 1):
                b.cylinder("base", (s * 0.12 * h, q * 0.12 * h, 0), (0, 0, z), 0.012 * h)
    b.box("base", (-0.07 * h, -0.04 * h, z - 0.03 * h), (0.16 * h, 0.04 * h, z + 0.05 * h), "trim")
    x = -0.07 * h - max(b.gap, 0.002 * h) - 0.12 * h
    rotor = part(b, "rotor", "fan")
    b.cylinder(rotor, (x, 0, z), (x + 0.12 * h, 0, z), 0.025 * h, None, "metal")
    wide, pitch = min(0.12 * r + 0.01, 1.5 * r / n), b.uniform(0.1, 0.7)
    for k in range(n):
        turned = b.moved((x, 0, z), (1, 0, 0), TAU * k / n)
        with turned, b.moved((0, 0, 0), (0, 0, 1), pitch):
            lo, hi = (-0.004 * h, -wide / 2, 0), (0.004 * h, wide / 2, r)
            b.box(rotor, lo, hi, b.choice(("front", "accent")))
    b.spin(rotor, "base", (x, 0, z), (1, 0, 0))
    settle(b)


CATEGORIES: dict[str, Callable[[Builder], None]] = {
    "bench_vice": bench_vice, "caliper": caliper, "syringe": syringe, "hatch": hatch,
    "fence_gate": fence_gate, "winch": winch, "paper_cutter": paper_cutter,
    "linear_stage": linear_stage, "balance": balance, "windmill": windmill,
}  # fmt: skip
