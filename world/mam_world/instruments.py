"""Turntables, music boxes and telescopes."""

from __future__ import annotations

import numpy as np

from mam_world.kit import Builder
from mam_world.mech import dial
from mam_world.solids import TAU, part


def turntable(b: Builder) -> None:
    """A record player or a lazy Susan: a platter that spins, a tone arm, knobs, sometimes a lid."""
    if b.chance(0.35):
        _lazy_susan(b)
        return
    d, w, h = b.uniform(0.32, 0.38), b.uniform(0.4, 0.46), b.uniform(0.06, 0.12)
    b.size(d, w, h)
    b.box("base", (0, -w / 2, 0.012), (d, w / 2, h), "body")
    for x in (0.04, d - 0.04):
        for y in (-w / 2 + 0.04, w / 2 - 0.04):
            b.cylinder("base", (x, y, 0), (x, y, 0.012), 0.02, None, "rubber")
    r, g = 0.42 * d, max(b.gap * 0.3, 0.0008)
    x, y = d / 2, w / 2 - r - 0.025
    platter = part(b, "platter")
    b.cylinder(platter, (x, y, h + g), (x, y, h + 0.016), r, None, "metal")
    b.cylinder(platter, (x, y, h + 0.016), (x, y, h + 0.019), 0.97 * r, None, "dark")
    b.cylinder(
        platter, (x, y, h + 0.019), (x, y, h + 0.0195), 0.33 * r, None, "accent", "decor", False
    )
    b.cylinder(platter, (x, y, h + 0.019), (x, y, h + 0.028), 0.003, None, "metal")
    b.spin(platter, "base", (x, y, h), (0, 0, 1))
    ax, ay = d - 0.06, -w / 2 + 0.055
    b.cylinder("base", (ax, ay, h), (ax, ay, h + 0.025), 0.022, None, "metal")
    arm = part(b, "arm", "tone_arm")
    z = h + 0.025 + g
    b.cylinder(arm, (ax, ay, z), (ax, ay, z + 0.014), 0.014, None, "dark")
    b.cylinder(
        arm, (ax + 0.035, ay, z + 0.008), (ax - 0.22, ay, z + 0.008), 0.004, None, "metal", "handle"
    )
    b.block(arm, (ax - 0.225, ay, z + 0.006), (0.03, 0.014, 0.01), "dark", "handle")
    b.cylinder(
        arm, (ax + 0.02, ay, z + 0.008), (ax + 0.045, ay, z + 0.008), 0.012, None, "metal", "handle"
    )
    b.hinge(arm, "base", (ax, ay, z), (0, 0, 1), 0, 0.75, opens=(0, 1, 0), tip=(ax - 0.2, ay, z))
    if b.chance(0.7):
        knob = part(b, "knob")
        at = (0.05, -w / 2 + 0.05, h + g)
        dial(b, knob, at, (0, 0, 1), 0.014, 0.014)
        b.spin(knob, "base", at, (0, 0, 1), 0, 4.7)
    if b.chance(0.5):
        lid = part(b, "lid")
        z0 = h + max(b.gap, 0.001)
        z1 = z0 + 0.075
        with_wall = 0.004
        b.box(lid, (0, -w / 2, z1 - with_wall), (d, w / 2, z1), "glass")
        b.box(lid, (0, -w / 2, z0), (with_wall, w / 2, z1 - with_wall), "glass")
        for s in (-1, 1):
            b.box(lid, (with_wall, s * (w / 2 - with_wall), z0), (d, s * w / 2, z1 - with_wall),
                  "glass")  # fmt: skip
            b.cylinder(lid, (d + 0.004, s * 0.3 * w - 0.02, z0),
                       (d + 0.004, s * 0.3 * w + 0.02, z0), 0.005, None, "dark")  # fmt: skip
            b.block("base", (d + 0.004, s * 0.3 * w, h - 0.012), (0.012, 0.05, 0.02), "dark")
            b.block(lid, (d - 0.001, s * 0.3 * w, z0 + 0.008), (0.012, 0.03, 0.016), "glass")
        b.hinge(lid, "base", (d + 0.004, 0, z0), (0, 1, 0), 0, b.uniform(1.0, 1.4), opens=(0, 0, 1))


def _lazy_susan(b: Builder) -> None:
    """A round tray that turns on a foot."""
    r = b.uniform(0.12, 0.25)
    b.size(2 * r, 2 * r, 0.05)
    b.lathe("base", [(0.6 * r, 0), (0.6 * r, 0.008), (0.25 * r, 0.014), (0.25 * r, 0.022)], "body")
    top = part(b, "platter")
    z = 0.022 + max(b.gap, 0.0006)
    if b.chance(0.5):
        with b.moved((0, 0, z)):
            b.vessel(top, [(0.95 * r, 0), (r, 0.03)], 0.008, "wood")
    else:
        b.cylinder(top, (0, 0, z), (0, 0, z + 0.015), r, None, "wood")
    if b.chance(0.4):
        b.box(top, (-0.1 * r, 0.3 * r, z + 0.008), (0.25 * r, 0.6 * r, z + 0.09), "accent",
              "content")  # fmt: skip
    b.spin(top, "base", (0, 0, z), (0, 0, 1))


def music_box(b: Builder) -> None:
    """A music box: a crank at the side, sometimes a hinged lid and a turning figure."""
    d, w, h = b.uniform(0.08, 0.14), b.uniform(0.1, 0.18), b.uniform(0.05, 0.09)
    b.size(d, w, h)
    b.theme(b.choice(("wood", "wood", "paint")))
    g = max(min(b.gap, 0.005 * b.diagonal), 0.0008)
    b.shell("base", (0, -w / 2, 0), (d, w / 2, h), 0.006, "+z", "body", "solid")
    b.box("base", (0.006, -w / 2 + 0.006, 0.45 * h), (d - 0.006, w / 2 - 0.006, 0.5 * h), "fabric")
    lidded = b.chance(0.7)
    if b.chance(0.7) or not lidded:
        z = 0.5 * h + g
        figure = part(b, "figure")
        tall = 0.4 * h if lidded else b.uniform(0.05, 0.09)
        b.cylinder(figure, (0.5 * d, 0, z), (0.5 * d, 0, z + 0.004), 0.25 * d, None, "gold")
        b.cylinder(figure, (0.5 * d, 0, z + 0.003), (0.5 * d, 0, z + 0.7 * tall), 0.14 * d,
                   0.02 * d, "accent")  # fmt: skip
        b.sphere(figure, (0.5 * d, 0, z + 0.8 * tall), min(0.06 * d, 0.15 * tall), "skin")
        b.spin(figure, "base", (0.5 * d, 0, z), (0, 0, 1))
    if lidded:
        lid = part(b, "lid")
        z = h + g
        b.box(lid, (0, -w / 2, z), (d, w / 2, z + 0.008), "body")
        if b.chance(0.5):
            b.box(lid, (0.012, -w / 2 + 0.012, z + 0.008), (d - 0.012, w / 2 - 0.012, z + 0.012),
                  "trim")  # fmt: skip
        b.cylinder(lid, (d + 0.002, -0.35 * w, z), (d + 0.002, 0.35 * w, z), 0.0028, None, "gold")
        b.hinge(lid, "base", (d + 0.002, 0, z), (0, 1, 0), 0, b.uniform(1.4, 1.9), opens=(0, 0, 1))
    crank = part(b, "crank")
    y, zc = -w / 2, b.uniform(0.35, 0.6) * h
    arm = min(zc - 0.006, 0.035)
    b.cylinder("base", (0.5 * d, y, zc), (0.5 * d, y - 0.003, zc), 0.008, None, "gold")
    b.cylinder(crank, (0.5 * d, y - 0.003 - g, zc), (0.5 * d, y - 0.014 - g, zc), 0.003, None,
               "metal", "handle")  # fmt: skip
    b.cylinder(crank, (0.5 * d, y - 0.012 - g, zc), (0.5 * d - arm, y - 0.012 - g, zc), 0.002, None,
               "metal", "handle")  # fmt: skip
    b.cylinder(crank, (0.5 * d - arm, y - 0.011 - g, zc), (0.5 * d - arm, y - 0.03 - g, zc), 0.004,
               None, "wood", "handle")  # fmt: skip
    b.spin(crank, "base", (0.5 * d, y, zc), (0, 1, 0))


def telescope(b: Builder) -> None:
    """A telescope or camera head on a tripod: turns about the upright, tilts, draws out."""
    h, l, r = b.uniform(0.6, 1.2), b.uniform(0.4, 0.8), b.uniform(0.03, 0.06)
    b.size(l, l, h)
    b.theme(b.choice(("white", "dark", "paint")))
    spread = 0.35 * h
    legs = b.choice(("metal", "wood"))
    for k in range(3):
        t = k * TAU / 3 + np.pi / 6
        e = np.array([np.cos(t), np.sin(t), 0])
        b.cylinder("base", spread * e + (0, 0, 0.012), 0.03 * e + (0, 0, h), 0.014, None, legs)
        b.sphere("base", spread * e + (0, 0, 0.015), 0.015, "rubber")
    b.cylinder("base", (0, 0, h - 0.05), (0, 0, h + 0.02), 0.05, None, "metal")
    g = max(b.gap, 0.001)
    yoke = part(b, "mount", "yoke")
    z = h + 0.02 + g
    b.cylinder(yoke, (0, 0, z), (0, 0, z + 0.025), 0.04, None, "dark")
    zc = z + 0.05 + r
    for s in (-1, 1):
        b.box(
            yoke, (-0.015, s * (r + 0.006), z + 0.02), (0.015, s * (r + 0.016), zc + 0.015), "dark"
        )
    b.box(yoke, (-0.015, -r - 0.016, z + 0.015), (0.015, r + 0.016, z + 0.026), "dark")
    b.spin(yoke, "base", (0, 0, z), (0, 0, 1))
    tube = part(b, "tube")
    b.tube(tube, (-0.55 * l, 0, zc), (0.4 * l, 0, zc), r, 0.88 * r, "body")
    b.tube(tube, (-0.6 * l, 0, zc), (-0.5 * l, 0, zc), 1.12 * r, 0.99 * r, "trim")
    b.cylinder(tube, (-0.5 * l, 0, zc), (-0.495 * l, 0, zc), 0.9 * r, None, "glass")
    b.cylinder(tube, (0, -r - 0.006, zc), (0, r + 0.006, zc), 0.012, None, "metal")
    if b.chance(0.5):
        b.cylinder(tube, (0.1 * l, 0.3 * r, zc + 1.35 * r), (0.35 * l, 0.3 * r, zc + 1.35 * r),
                   0.25 * r, None, "dark")  # fmt: skip
        b.box(tube, (0.2 * l, 0.2 * r, zc + 0.9 * r), (0.23 * l, 0.4 * r, zc + 1.2 * r), "dark")
    b.hinge(tube, yoke, (0, 0, zc), (0, 1, 0), -0.25, 0.5, closed=0.0)
    if b.chance(0.7):
        eye = part(b, "tube", "eyepiece")
        b.cylinder(eye, (0.2 * l, 0, zc), (0.5 * l, 0, zc), 0.8 * r, None, "metal")
        b.cylinder(eye, (0.5 * l, 0, zc), (0.56 * l, 0, zc), 0.5 * r, 0.6 * r, "dark", "handle")
        b.slide(eye, tube, (1, 0, 0), 0, b.uniform(0.08, 0.16) * l)
    else:
        b.cylinder(tube, (0.39 * l, 0, zc), (0.5 * l, 0, zc), 0.6 * r, None, "dark")


CATEGORIES = {"turntable": turntable, "music_box": music_box, "telescope": telescope}
