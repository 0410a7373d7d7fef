"""Controls: levers, press handles, locks, thermostats."""

from __future__ import annotations

import numpy as np

from mam_world.kit import Builder
from mam_world.mech import dial, studs
from mam_world.solids import TAU, arc, bar, bored, part, rounded


def lever(b: Builder) -> None:
    """A lever on a base: pivots between two cheeks or out of a slot, with a ball or a grip."""
    l, w = b.uniform(0.12, 0.3), b.uniform(0.05, 0.1)
    b.size(w, w, l)
    b.theme(b.choice(("steel", "paint", "dark", "plastic")))
    base_h = b.uniform(0.02, 0.06)
    rounded(b, "base", (-w, -w, 0), (w, w, base_h), b.choice((0.001, 0.3 * w)))
    studs(b, [(s * 0.8 * w, t * 0.8 * w, base_h) for s in (-1, 1) for t in (-1, 1)], (0, 0, 1),
          0.06 * w)  # fmt: skip
    thick, g = b.uniform(0.12, 0.25) * w, max(b.gap, 0.001)
    r, z = b.uniform(0.25, 0.35) * w, 0.0
    z = base_h + r + 0.004
    cheeks = b.choice(((-1, 1), (-1, 1), (1,)))
    for s in cheeks:
        y0 = s * (thick / 2 + g)
        b.box("base", (-0.9 * r, y0, base_h), (0.9 * r, y0 + s * 0.25 * w, z), "metal")
        b.cylinder("base", (0, y0, z), (0, y0 + s * 0.25 * w, z), 0.9 * r, None, "metal")
    arm = part(b, "lever")
    tilt = b.uniform(-0.7, 0.0)
    tip = np.array([l * np.sin(tilt), 0, z + l * np.cos(tilt)])
    foot = np.array([0, 0, z])
    b.cylinder(arm, (0, -thick / 2, z), (0, thick / 2, z), 0.85 * r, None, "metal")
    if b.chance(0.5):
        bar(b, arm, foot, tip, thick * 0.9, 0.7 * r, (np.cos(tilt), 0, -np.sin(tilt)), "metal",
            "handle")  # fmt: skip
    else:
        b.cylinder(arm, foot, tip, 0.45 * thick, None, "metal", "handle")
    if b.chance(0.6):
        b.sphere(arm, tip, b.uniform(0.6, 1.1) * thick + 0.004, b.choice(("red", "dark", "accent")),
                 "handle")  # fmt: skip
    else:
        b.cylinder(
            arm, tip + 0.4 * (foot - tip), tip, 0.6 * thick + 0.003, None, "rubber", "handle"
        )
    if b.chance(0.4):
        b.cylinder(arm, (0, -thick / 2 - g - 0.3 * w, z), (0, thick / 2 + g + 0.3 * w, z), 0.3 * r,
                   None, "metal")  # fmt: skip
    b.hinge(
        arm, "base", (0, 0, z), (0, 1, 0), 0, b.uniform(0.6, 1.0) - tilt, opens=(1, 0, 0), tip=tip
    )


def press_handle(b: Builder) -> None:
    """A block with a broad handle that presses down between guides (a plunger or detonator)."""
    w, h = b.uniform(0.08, 0.14), b.uniform(0.06, 0.14)
    b.size(w, w, 2 * h)
    b.theme(b.choice(("paint", "steel", "wood", "plastic")))
    travel, stem = b.uniform(0.4, 0.75) * h, b.uniform(0.08, 0.16) * w
    bored(b, "base", (-w / 2, -w / 2, 0.15 * h), (w / 2, w / 2, h), "z", (0, 0), 1.15 * stem)
    b.box("base", (-w / 2, -w / 2, 0), (w / 2, w / 2, 0.15 * h), "body")
    if b.chance(0.5):
        b.tube("base", (0, 0, h), (0, 0, h + 0.1 * w), 2 * stem, 1.15 * stem, "metal")
    key = part(b, "handle", "press")
    top = h + travel + 0.1 * w + 0.008
    b.cylinder(
        key, (0, 0, max(h - 0.3 * h, 0.15 * h + travel + 0.001)), (0, 0, top), stem, None, "metal"
    )
    if b.chance(0.6):
        b.block(key, (0, 0, top + 0.01), (0.3 * w, b.uniform(0.7, 1.1) * w, 0.02),
                b.choice(("red", "dark", "wood")), "handle")  # fmt: skip
    else:
        b.cylinder(key, (0, -0.5 * w, top + 0.008), (0, 0.5 * w, top + 0.008), 0.012, None, "wood",
                   "handle")  # fmt: skip
    b.slide(key, "base", (0, 0, -1), 0, travel)


def lock(b: Builder) -> None:
    """A lock on a door leaf: a dial, a turn latch, or a bolt that slides in two keepers."""
    w, h, t = b.uniform(0.08, 0.2), b.uniform(0.12, 0.3), b.uniform(0.02, 0.04)
    b.size(t, w, h)
    b.box("base", (0, -w / 2, 0), (t, w / 2, h), "body")
    style = b.choice(("dial", "latch", "bolt", "padlock"))
    z, g = b.uniform(0.4, 0.6) * h, max(b.gap, 0.0006)
    r = b.uniform(0.18, 0.3) * w
    if style in ("dial", "latch"):
        if b.chance(0.5):
            b.disc("base", (0, 0, z), (-1, 0, 0), 1.25 * r, 0.004, "metal")
        else:
            rounded(b, "base", (-0.004, -1.2 * r, z - 1.8 * r), (0, 1.2 * r, z + 1.8 * r), 0.4 * r,
                    "x", "metal")  # fmt: skip
            studs(b, [(-0.004, 0, z + s * 1.55 * r) for s in (-1, 1)], (-1, 0, 0), 0.1 * r)
        knob = part(b, "knob", style)
        if style == "dial":
            dial(b, knob, (-0.004 - g, 0, z), (-1, 0, 0), r, 0.6 * r,
                 b.choice(("skirt", "flute", "pointer", "bar")))  # fmt: skip
            b.spin(knob, "base", (0, 0, z), (1, 0, 0))
        else:
            b.cylinder(
                knob, (-0.004 - g, 0, z), (-0.014 - g, 0, z), 0.5 * r, None, "metal", "handle"
            )
            b.box(
                knob, (-0.03 - g, -0.2 * r, z - r), (-0.012 - g, 0.2 * r, z + r), "metal", "handle"
            )
            b.spin(knob, "base", (0, 0, z), (1, 0, 0), 0, np.pi / 2)
    elif style == "bolt":
        rounded(b, "base", (-0.003, -0.4 * w, z - 0.1 * h), (0, 0.4 * w, z + 0.1 * h), 0.01, "x",
                "metal")  # fmt: skip
        rod = part(b, "bolt")
        q = 0.03 * w + 0.002
        x = -0.003 - 1.6 * q
        for y in (-0.3 * w, 0.02 * w):
            bored(b, "base", (x - 1.6 * q, y, z - 1.6 * q), (-0.003, y + 0.08 * w, z + 1.6 * q),
                  "y", (x, z), 1.15 * q, "metal")  # fmt: skip
        b.cylinder(rod, (x, -0.32 * w, z), (x, 0.34 * w, z), q, None, "metal")
        b.cylinder(
            rod, (x, 0.28 * w, z), (x - 4 * q, 0.28 * w, z), 0.7 * q, None, "metal", "handle"
        )
        b.slide(rod, "base", (0, 1, 0), -0.13 * w, 0.0, closed=0.0, open=-0.13 * w)
    else:
        _padlock(b, w, h, z)


def _padlock(b: Builder, w: float, h: float, z: float) -> None:
    """A padlock on two staples; its shackle swings out."""
    b.box("base", (-0.006, -0.1 * w, z + 0.08 * h), (0, 0.1 * w, z + 0.13 * h), "metal")
    x = -0.006 - 0.09 * w
    b.box("base", (x - 0.08 * w, -0.3 * w, z - 0.2 * h), (x + 0.08 * w, 0.3 * w, z + 0.03 * h),
          "gold")  # fmt: skip
    b.box("base", (x + 0.07 * w, -0.1 * w, z - 0.1 * h), (0, 0.1 * w, z - 0.05 * h), "metal")
    shackle = part(b, "shackle")
    q = 0.045 * w
    top = z + 0.03 * h
    path = np.concatenate(
        [
            [(x, 0.2 * w, top - 0.15 * h)],  # the leg it turns on stays in the body
            arc((x, 0, top + 0.3 * w), 0.2 * w, 0, np.pi, 9, "x"),
            [(x, -0.2 * w, top + 0.001)],
        ]
    )
    b.sweep(shackle, path, q, "metal", "handle")
    b.hinge(shackle, "base", (x, 0.2 * w, top), (0, 0, 1), 0, 1.6, opens=(-1, 0, 0),
            tip=(x, -0.2 * w, top))  # fmt: skip


def thermostat(b: Builder) -> None:
    """A wall thermostat: a turning ring round a fixed face, or a wheel at the side of a box."""
    r = b.uniform(0.035, 0.06)
    b.size(0.03, 2 * r, 2 * r)
    b.theme(b.choice(("white", "steel", "dark")))
    g = max(b.gap, 0.0006)
    if b.chance(0.6):
        z = 1.2 * r
        rounded(b, "base", (0.0, -1.2 * r, 0), (0.006, 1.2 * r, 2.4 * r),
                b.choice((0.002, 0.4 * r, 1.19 * r)), "x", "front")  # fmt: skip
        b.cylinder("base", (0, 0, z), (-0.022, 0, z), 0.78 * r, None, "screen")
        ring = part(b, "dial", "ring")
        paint = b.choice(("metal", "dark", "light"))
        with b.moved((0, 0, z), (1, 0, 0), TAU / 24):
            b.tube(ring, (-g, 0, 0), (-0.02, 0, 0), r, 0.83 * r, paint, "handle")
        b.box(ring, (-0.0215, -0.02 * r, z + 0.86 * r), (-0.019, 0.02 * r, z + 0.97 * r), "red",
              "decor", False)  # fmt: skip
        b.spin(ring, "base", (0, 0, z), (1, 0, 0), -2.3, 2.3, closed=0.0)
    else:
        b.box("base", (0, -r, 0), (0.025, r, 1.8 * r), "front")
        b.box("base", (-0.001, -0.8 * r, 0.9 * r), (0, 0.8 * r, 1.6 * r), "screen", "decor", False)
        knob = part(b, "dial")
        dial(b, knob, (-g, 0, 0.45 * r), (-1, 0, 0), 0.32 * r, 0.012)
        b.spin(knob, "base", (0, 0, 0.45 * r), (1, 0, 0), 0, b.uniform(2, 4.7))


CATEGORIES = {"lever": lever, "press_handle": press_handle, "lock": lock, "thermostat": thermostat}
