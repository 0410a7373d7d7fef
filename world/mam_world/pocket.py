"""Pocket things: pens, lighters, eyeglasses, folding knives."""

from __future__ import annotations

import numpy as np

from mam_world import collide
from mam_world.kit import Builder
from mam_world.mech import studs
from mam_world.solids import TAU, part, profile, rounded, settle, tray


def pen(b: Builder) -> None:
    """A pen lying down: a cap that pulls off, a push button, or a twist barrel; a fixed clip."""
    l, r = b.uniform(0.12, 0.15), b.uniform(0.004, 0.007)
    b.size(l, 2 * r, 2 * r)
    b.theme("plastic")
    z = 1.5 * r
    style = b.choice(("cap", "push", "twist"))
    g = max(0.2 * b.gap, 0.0002)
    lo = 0.36 * l
    with b.facing((0, 0, z), (1, 0, 0), (0, 1, 0)):
        b.lathe(
            "base",
            [
                (0.1 * r, 0),
                (0.25 * r, 0.03 * l),
                (0.6 * r, 0.1 * l),
                (0.75 * r if style == "cap" else r, 0.18 * l),
            ],
            "metal",
        )
        if style == "cap":
            b.cylinder("base", (0, 0, 0.18 * l), (0, 0, lo), 0.75 * r, None, "dark")
            b.cylinder("base", (0, 0, lo + g), (0, 0, l), r, None, "body")
            cap = part(b, "lid", "cap")
            b.tube(cap, (0, 0, -0.01 * l), (0, 0, lo), r, 0.84 * r, "accent", "handle")
            b.cylinder(cap, (0, 0, -0.03 * l), (0, 0, -0.01 * l), r, None, "accent", "handle")
            b.box(cap, (-0.2 * r, -1.5 * r, -0.02 * l), (0.2 * r, -0.9 * r, 0.02 * l), "metal",
                  "handle")  # fmt: skip
            b.box(cap, (-0.25 * r, -1.5 * r, -0.02 * l), (0.25 * r, -1.3 * r, 0.28 * l), "metal",
                  "handle")  # fmt: skip
            b.slide(cap, "base", (0, 0, -1), 0, b.uniform(0.26, 0.31) * l,
                    rest=b.choice((0.0, 0.0, 0.1 * l)))  # fmt: skip
            settle(b)
            return
        if style == "push":
            b.cylinder("base", (0, 0, 0.18 * l), (0, 0, 0.8 * l), r, None, "body")
            b.tube("base", (0, 0, 0.8 * l), (0, 0, 0.97 * l), r, 0.66 * r, "body")
            key = part(b, "button")
            b.cylinder(key, (0, 0, 0.88 * l), (0, 0, 1.03 * l), 0.55 * r, None, "metal", "handle")
            b.slide(key, "base", (0, 0, -1), 0, b.uniform(0.03, 0.05) * l)
            clip, at = "base", 0.95 * l
        else:
            b.cylinder("base", (0, 0, 0.18 * l), (0, 0, 0.55 * l), r, None, "body")
            clip, at = part(b, "barrel"), 0.95 * l
            b.cylinder(clip, (0, 0, 0.55 * l + g), (0, 0, l), r, 0.8 * r, "accent", "handle")
            b.spin(clip, "base", (0, 0, 0.55 * l), (0, 0, 1),
                   *b.choice(((-np.inf, np.inf), (0.0, 3.1))))  # fmt: skip
        b.box(clip, (-0.2 * r, 0.7 * r, at - 0.02 * l), (0.2 * r, 1.5 * r, at), "metal", "handle")
        b.box(clip, (-0.25 * r, 1.3 * r, at - 0.25 * l), (0.25 * r, 1.5 * r, at), "metal", "handle")
    settle(b)


def lighter(b: Builder) -> None:
    """A lighter: a flip lid with a wheel, or a plain one with a wheel and a press tab."""
    w, d, h = b.uniform(0.022, 0.038), b.uniform(0.012, 0.015), b.uniform(0.05, 0.075)
    b.size(d, w, h)
    b.theme(b.choice(("steel", "plastic", "paint", "dark")))
    g = max(0.5 * b.gap, 0.0004)
    wheel_r = 0.0042
    if b.chance(0.5):
        k = 0.62 * h
        rounded(b, "base", (-d / 2, -w / 2, 0), (d / 2, w / 2, k), 0.002)
        lid = part(b, "lid")
        tray(b, lid, (-d / 2, -w / 2, k + g), (d / 2, w / 2, h), 0.001, "z", -1)
        # PhysX makes up contacts between millimetre-thin walls and the wheel that stands in them
        roof = collide.box((-d / 2, -w / 2, 0.75 * h + 0.25 * k), (d / 2, w / 2, h))
        b.pieces[-1].collision = (roof,)
        r = 0.0007  # the barrel lies outside both
        p, q = (-0.3 * d, w / 2 + r, k + g / 2), (0.3 * d, w / 2 + r, k + g / 2)
        b.cylinder(lid, p, q, r, None, "metal")
        b.hinge(lid, "base", (0, w / 2 + r, k + g / 2), (1, 0, 0), 0, b.uniform(1.6, 2.3),
                opens=(0, 0, 1), rest=b.choice((0.0, 0.0, 1.55)))  # fmt: skip
        # inside the circle that the lid's far wall describes
        y, z = 0.5 * w + 0.005 - float(np.sqrt((w - 0.002) ** 2 - 0.01**2)), k + 0.0052
        b.box("base", (-0.35 * d, y + 0.0052, k), (0.35 * d, 0.3 * w, k + 0.2 * h), "metal")
        b.box("base", (-0.35 * d, y - 0.002, k), (-0.22 * d, y + 0.002, z + 0.003), "metal")
        b.box("base", (0.22 * d, y - 0.002, k), (0.35 * d, y + 0.002, z + 0.003), "metal")
    else:
        k = 0.78 * h
        rounded(b, "base", (-d / 2, -w / 2, 0), (d / 2, w / 2, k), 0.45 * d,
                material=b.choice(("body", "glass")))  # fmt: skip
        b.box("base", (-0.42 * d, 0.005 - 0.12 * w, k), (0.42 * d, 0.42 * w, k + 0.16 * h), "metal")
        y, z = -0.12 * w, k + wheel_r + 0.0015
        for s in (-1, 1):
            ends = sorted((s * 0.26 * d, s * 0.38 * d))
            b.box("base", (ends[0], y - 0.003, k), (ends[1], 0.01 * w, z + 0.003), "metal")
        tab = part(b, "button", "tab")
        b.box(tab, (-0.2 * d, -0.48 * w, k + 0.002), (0.2 * d, y - wheel_r - 0.0006, k + 0.005),
              "red", "handle")  # fmt: skip
        b.box(
            tab, (-0.2 * d, -0.48 * w, k + 0.0025), (0.2 * d, -0.4 * w, k + 0.006), "red", "handle"
        )
        b.slide(tab, "base", (0, 0, -1), 0, 0.0016)
    flint = part(b, "wheel", "flint_wheel")
    b.cylinder(flint, (-0.2 * d, y, z), (0.2 * d, y, z),
               wheel_r if z - wheel_r > k else 0.9 * (z - k), None, "dark", "handle")  # fmt: skip
    b.cylinder(flint, (-0.3 * d, y, z), (0.3 * d, y, z), 0.0008, None, "metal")
    b.spin(flint, "base", (0, y, z), (1, 0, 0))


def eyeglasses(b: Builder) -> None:
    """Eyeglasses: a front with two lenses and two temples that fold in."""
    w, h, reach = b.uniform(0.045, 0.055), b.uniform(0.03, 0.05), b.uniform(0.12, 0.14)
    b.size(2.6 * w, h, reach)
    b.theme(b.choice(("dark", "plastic", "steel")))
    r, bridge = b.uniform(0.0012, 0.0028), b.uniform(0.014, 0.02)
    power = b.choice((2.0, 3.0, 5.0))
    theta = np.linspace(0, TAU, 25)[:-1]
    c, s_ = np.cos(theta), np.sin(theta)
    squash = (np.abs(c) ** power + np.abs(s_) ** power) ** (-1 / power)
    zc = h / 2 + r
    paint = b.choice(("body", "accent", "metal", "dark"))
    for s in (-1, 1):
        yc = s * (bridge + w) / 2
        loop = np.stack([0 * c, yc + w / 2 * squash * c, zc + h / 2 * squash * s_], 1)
        b.sweep("base", loop, r, paint, loop=True)
        profile(b, "base", loop[:, 1:], -0.0004, 0.0004, "x", "glass")
        edge = yc + s * w / 2
        top = zc + 0.25 * h + (0.006 if s > 0 else 0.0)  # so that the folded temples pass
        hinge_y = edge + s * 0.007
        b.cylinder(
            "base", (0, edge - s * 0.1 * w, top), (0.001, hinge_y, top), 1.2 * r, None, paint
        )
        b.cylinder("base", (0.001, hinge_y, top - 0.003), (0.001, hinge_y, top + 0.003), 1.2 * r,
                   None, "metal")  # fmt: skip
        temple = part(b, "temple")
        px = 0.001 + 2.45 * r
        pivot = (px, hinge_y - s * 0.4 * r, top)
        path = [
            pivot,
            (0.75 * reach, pivot[1], top),
            (0.88 * reach, pivot[1], top - 0.006),
            (reach, pivot[1], top - 0.028),
        ]
        b.sweep(temple, path, b.uniform(0.9, 1.2) * r, paint, "handle")
        b.hinge(
            temple, "base", pivot, (0, 0, 1), 0, 1.45, opens=(0, -s, 0), tip=(reach, pivot[1], top)
        )
    gap = 0.5 * bridge + 0.4 * r
    b.sweep(
        "base",
        [
            (0, -gap, zc + 0.15 * h),
            (0, -0.3 * bridge, zc + 0.25 * h),
            (0, 0.3 * bridge, zc + 0.25 * h),
            (0, gap, zc + 0.15 * h),
        ],
        r,
        paint,
    )
    settle(b)


def folding_knife(b: Builder) -> None:
    """A folding knife: one to three blades that swing out of a slotted handle."""
    l, w = b.uniform(0.08, 0.12), b.uniform(0.018, 0.028)
    b.size(l, w, 0.015)
    b.theme(b.choice(("wood", "plastic", "steel", "dark")))
    t, side = b.uniform(0.0018, 0.003), 0.003
    g = max(0.2 * b.gap, 0.0004)
    n = b.integer(1, 3)
    z = 0.0
    for k in range(n + 1):
        if k in (0, n):
            rounded(b, "base", (0, -w / 2, z), (l, w / 2, z + side), 0.45 * w, "z", "body")
            z += side
        else:
            rounded(b, "base", (0, -w / 2, z), (l, w / 2, z + 0.001), 0.45 * w, "z", "metal")
            z += 0.001
        if k == n:
            break
        b.box("base", (0.2 * l, -0.48 * w, z), (0.8 * l, -0.36 * w, z + t + 2 * g), "metal")
        blade = part(b, "blade")
        far = k % 2 == 1
        px = 0.92 * l if far else 0.08 * l
        sgn = -1 if far else 1
        length = b.uniform(0.7, 0.78) * l
        poly = [
            (px - sgn * 0.05 * l, -0.2 * w),
            (px + sgn * 0.05 * l, -0.25 * w),
            (px + sgn * length, -0.05 * w),
            (px + sgn * 0.8 * length, 0.42 * w),
            (px + sgn * 0.06 * l, 0.42 * w),
            (px - sgn * 0.05 * l, 0.15 * w),
        ]
        profile(b, blade, poly, z + g, z + g + t, "z", "metal")
        b.cylinder("base", (px, 0, z), (px, 0, z + t + 2 * g), 0.1 * w, None, "metal")
        b.hinge(blade, "base", (px, 0, z), (0, 0, 1), 0, b.uniform(2.6, 3.0), opens=(0, 1, 0),
                tip=(px + sgn * length, 0, z), rest=b.choice((0.0, 0.0, 1.5, 2.6)))  # fmt: skip
        z += t + 2 * g
    studs(b, [(0.08 * l, 0, z), (0.92 * l, 0, z)], (0, 0, 1), 0.1 * w)


CATEGORIES = {
    "pen": pen,
    "lighter": lighter,
    "eyeglasses": eyeglasses,
    "folding_knife": folding_knife,
}
