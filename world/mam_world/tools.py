"""Hand tools: scissors, pliers, staplers, pegs in a block."""

from __future__ import annotations

import numpy as np

from mam_world.kit import Builder
from mam_world.solids import TAU, bar, bored, part, profile, rounded, settle, tray


def _finger_loop(
    b: Builder, link: str, centre: tuple[float, float], z: float, t: float, rx: float, ry: float
) -> None:
    """An oval grip ring lying flat between z and z + t."""
    theta = np.linspace(0, TAU, 17)[:-1]
    path = np.stack(
        [centre[0] + rx * np.cos(theta), centre[1] + ry * np.sin(theta), np.full(16, z + t / 2)], 1
    )
    b.sweep(link, path, t / 2, "accent", "handle", loop=True)


def scissors(b: Builder) -> None:
    """Scissors lying flat: one blade swings over the other about a screw."""
    l = b.uniform(0.06, 0.14)
    b.size(2 * l, 0.5 * l, 0.01)
    b.theme("plastic")
    t, w = b.uniform(0.0015, 0.003), b.uniform(0.07, 0.11) * l
    g = max(0.3 * b.gap, 0.0003)
    grip = b.uniform(0.5, 0.9) * l
    ry = b.uniform(0.14, 0.2) * l
    rest = b.choice((0.0, 0.0, 0.4, 0.7))
    thick = max(2 * t, 0.004)
    lift = (thick - t) / 2
    cut = b.uniform(0.0, 0.04)
    # drawn just closed: each blade points along -x, its handle crosses to the other side
    for s, link, z in ((1, "base", lift), (-1, part(b, "blade"), lift + t + g)):
        poly = [
            (-l, 0.0),
            (-0.9 * l, s * 0.35 * w),
            (-0.1 * l, s * w),
            (0.08 * l, s * 0.6 * w),
            (0.1 * l, -s * w),
            (-0.05 * l, -s * 0.5 * w - cut * w),
            (-0.9 * l, -s * 0.1 * w),
        ]
        profile(b, link, poly if s > 0 else poly[::-1], z, z + t, "z", "metal")
        end = (0.1 * l + 0.25 * grip, -s * (ry + 0.004))
        bar(b, link, (0.02 * l, -s * 0.3 * w, z + t / 2),
            (end[0], end[1] + s * 0.3 * ry, z + t / 2), 0.9 * w, t, material="metal")  # fmt: skip
        _finger_loop(b, link, (0.1 * l + 0.55 * grip, -s * (1.05 * ry + thick)),
                     0.0 if s > 0 else t + g, thick, 0.45 * grip, ry)  # fmt: skip
    blade = b.links[-1][0]
    b.cylinder(
        blade, (0, 0, lift - 0.0002), (0, 0, lift + 2 * t + g + 0.001), 0.35 * w, None, "metal"
    )
    b.hinge(blade, "base", (0, 0, 0), (0, 0, 1), 0, b.uniform(0.7, 1.1), opens=(0, -1, 0),
            tip=(-l, 0, 0), rest=rest)  # fmt: skip
    settle(b)


def pliers(b: Builder) -> None:
    """Pliers or tongs: two crossing halves about a rivet, jaws at the front."""
    l = b.uniform(0.03, 0.06)
    h = b.uniform(0.09, 0.14)
    b.size(l + h, 0.05, 0.01)
    b.theme("plastic")
    t, w = b.uniform(0.004, 0.006), b.uniform(0.3, 0.4) * l
    g = max(0.3 * b.gap, 0.0003)
    spread = b.uniform(0.25, 0.45) * l
    half = part(b, "handle", "half")
    for s, link, z in ((1, "base", 0.0), (-1, half, t + g)):
        # the jaw fills both layers in front of the joint, so that the jaws meet face to face
        jaw = [
            (-l - 0.2 * w, s * 0.0004),
            (-0.55 * l, s * 0.0004),
            (-0.55 * l, s * 0.8 * w),
            (-l - 0.2 * w, s * 0.35 * w),
        ]
        profile(b, link, jaw, 0.0, 2 * t + g, "z", "metal")
        profile(
            b,
            link,
            [
                (-0.75 * l, s * 0.3 * w),
                (-0.75 * l, s * 0.75 * w),
                (-0.1 * l, s * 0.8 * w),
                (0.2 * l, 0.0),
                (0.1 * l, -s * 0.6 * w),
                (-0.3 * l, -s * 0.1 * w),
            ],
            z,
            z + t,
            "z",
            "metal",
        )
        b.cylinder(link, (0, 0, z), (0, 0, z + t), 0.6 * w, None, "metal")
        path = np.array(
            [
                (0.02, -s * 0.35 * w, z + t / 2),
                (0.3 * h, -s * spread, z + t / 2),
                (0.7 * h, -s * 1.1 * spread, z + t / 2),
                (h, -s * 0.9 * spread, z + t / 2),
            ]
        )
        b.sweep(link, np.concatenate([[(0, 0, z + t / 2)], path[:2]]), 0.45 * t, "metal")
        b.sweep(link, path[1:], 0.5 * t, "accent", "handle")
    b.cylinder(half, (0, 0, 0.0002), (0, 0, 2 * t + g + 0.001), 0.25 * w, None, "dark")
    b.hinge(half, "base", (0, 0, 0), (0, 0, 1), 0, b.uniform(0.4, 0.7), opens=(0, -1, 0),
            tip=(-l, 0, 0), rest=b.choice((0.0, 0.2)))  # fmt: skip
    settle(b)


def stapler(b: Builder) -> None:
    """A stapler or a hole punch: an arm that presses on a base, with a spring gap between."""
    l, w = b.uniform(0.11, 0.17), b.uniform(0.025, 0.04)
    b.size(l, w, 0.06)
    b.theme(b.choice(("dark", "paint", "steel", "plastic")))
    t, g = 0.008, max(b.gap, 0.0008)
    rounded(b, "base", (0, -w / 2, 0), (l, w / 2, t), 0.3 * w)
    b.box("base", (0.05 * l, -0.2 * w, t), (0.15 * l, 0.2 * w, t + 0.001), "metal")
    z = t + b.uniform(0.016, 0.024)
    x = 0.9 * l
    for s in (-1, 1):
        b.box("base", (x - 0.008, s * 0.4 * w, t), (x + 0.008, s * 0.48 * w, z + 0.006), "metal")
    mag = part(b, "lever", "magazine")
    up = 0.12
    pivot = np.array([x, 0, z])
    b.cylinder(mag, (x, -0.44 * w, z), (x, 0.44 * w, z), 0.005, None, "metal")
    with b.moved(pivot, (0, 1, 0), up):
        b.box(mag, (-0.85 * l, -0.25 * w, -0.006), (0.01, 0.25 * w, 0.004), "metal")
        b.box(mag, (-0.87 * l, -0.2 * w, -0.008), (-0.85 * l, 0.2 * w, 0.004), "dark")
    # pressed until the nose meets the anvil
    drop = (z - 0.008 + 0.86 * l * np.sin(up) - t - 0.002 - g) / (0.87 * l)
    b.hinge(mag, "base", pivot, (0, 1, 0), 0, max(0.08, min(drop, 0.25)), opens=(0, 0, -1))
    cover = part(b, "lid", "cover")
    with b.moved(pivot, (0, 1, 0), up):
        tray(b, cover, (-0.88 * l, -0.36 * w, 0.004 + g), (-0.012, 0.36 * w, 0.022), 0.002, "z", -1,
             "body")  # fmt: skip
    for s in (-1, 1):
        ends = sorted((s * 0.3 * w, s * 0.36 * w))
        b.box(cover, (x - 0.016, ends[0], z - 0.004), (x + 0.006, ends[1], z + 0.012), "body")
    b.hinge(cover, mag, pivot, (0, 1, 0), 0, b.uniform(0.6, 1.4), opens=(0, 0, 1))


def peg_block(b: Builder) -> None:
    """A block with pegs or a nail to hammer in: some slide in holes, some are fixed."""
    l, w, h = b.uniform(0.1, 0.3), b.uniform(0.08, 0.14), b.uniform(0.06, 0.14)
    n = b.choice((1, 1, 2, 3, 4))
    l = max(l, 0.06 * n)
    b.size(l, w, h)
    b.theme(b.choice(("wood", "wood", "plastic")))
    r = b.uniform(0.05, 0.18) * w
    lying = b.chance(0.4)
    turn = np.array([[0, 0, -1, h], [0, -1, 0, 0], [-1, 0, 0, l], [0, 0, 0, 1.0]])
    with b.at(turn if lying else np.eye(4)):
        b.box("base", (0, -w / 2, 0), (l, w / 2, 0.2 * h), "body")
        for k in range(n):
            x0, x1 = k * l / n, (k + 1) * l / n
            c = ((x0 + x1) / 2, 0.0)
            out = b.uniform(0.3, 0.7) * h
            paint = b.choice(("accent", "red", "green", "metal", "front"))
            if k and b.chance(0.25):
                b.box("base", (x0, -w / 2, 0.2 * h), (x1, w / 2, h), "body")
                b.cylinder("base", (*c, h), (*c, h + 0.3 * out), r, None, paint)
                continue
            bored(b, "base", (x0, -w / 2, 0.2 * h), (x1, w / 2, h), "z", c, 1.12 * r)
            peg = part(b, "peg")
            b.cylinder(
                peg, (*c, h - min(0.5 * out, 0.6 * h - out) * 0.4), (*c, h + out), r, None, paint
            )
            if b.chance(0.6):
                b.cylinder(peg, (*c, h + out), (*c, h + out + 0.3 * r),
                           min(b.uniform(1.3, 2.2) * r, 0.46 * l / n), None, paint,
                           "handle")  # fmt: skip
            b.slide(peg, "base", (0, 0, -1), 0, 0.95 * out)


CATEGORIES = {"scissors": scissors, "pliers": pliers, "stapler": stapler, "peg_block": peg_block}
