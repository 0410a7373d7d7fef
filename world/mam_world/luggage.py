"""Luggage and drops: suitcases, mailboxes, trash chutes."""

from __future__ import annotations

import numpy as np

from mam_world.boxes import clasp
from mam_world.kit import Builder
from mam_world.mech import studs
from mam_world.solids import part, pierced, profile, settle, tray


def suitcase(b: Builder) -> None:
    """A suitcase or brief case: two shells on a hinge, a carrying handle, perhaps wheels."""
    brief = b.chance(0.45)
    w = b.uniform(0.36, 0.48) if brief else b.uniform(0.4, 0.75)
    d = b.uniform(0.28, 0.36) if brief else b.uniform(0.3, 0.5)
    h = b.uniform(0.07, 0.13) if brief else b.uniform(0.18, 0.3)
    b.size(w, d, h)
    b.theme(b.choice(("dark", "paint", "plastic", "steel")))
    if brief or b.chance(0.5):
        _flat_case(b, w, d, h, brief)
    else:
        _trolley(b, w, d, h)
    settle(b)


def _flat_case(b: Builder, w: float, d: float, h: float, brief: bool) -> None:
    t, g = 0.006, max(b.gap, 0.001)
    k = b.uniform(0.4, 0.65) * h
    tray(b, "base", (0, -w / 2, 0), (d, w / 2, k), t, "z", 1)
    lid = part(b, "lid")
    tray(b, lid, (0, -w / 2, k + g), (d, w / 2, h), t, "z", -1)
    for s in (-1, 1):
        b.cylinder(lid, (d + 0.001, s * 0.3 * w - 0.03, k + g / 2),
                   (d + 0.001, s * 0.3 * w + 0.03, k + g / 2), 0.005, None, "metal")  # fmt: skip
        clasp(b, "base", s * 0.3 * w, k - 0.02, 0, 0.018)
        clasp(b, lid, s * 0.3 * w, k + g + 0.002, 0, 0.014)
        for e in (0.02, d - 0.05):
            if not brief:
                b.box(lid, (e, s * (w / 2) - 0.001, k + 0.2 * (h - k)),
                      (e + 0.03, s * (w / 2) + 0.001, h - 0.01), "trim", "decor",
                      False)  # fmt: skip
    b.hinge(lid, "base", (d + 0.001, 0, k + g / 2), (0, 1, 0), 0, b.uniform(1.5, 2.2),
            opens=(0, 0, 1), rest=b.choice((0.0, 0.0, 1.5)))  # fmt: skip
    z = k - 0.03
    for s in (-1, 1):
        b.block("base", (-0.006, s * 0.065, z), (0.013, 0.014, 0.016), "metal")
    if b.chance(0.7):
        grip = part(b, "handle")
        b.sweep(
            grip,
            [
                (-0.007, -0.055, z),
                (-0.035, -0.055, z),
                (-0.042, -0.045, z),
                (-0.042, 0.045, z),
                (-0.035, 0.055, z),
                (-0.007, 0.055, z),
            ],
            0.005,
            "dark",
            "handle",
        )
        b.hinge(grip, "base", (-0.007, 0, z), (0, 1, 0), 0, 1.2, opens=(0, 0, -1), closed=0.0)
    else:
        b.sweep("base", [(0, -0.06, z), (-0.035, -0.055, z), (-0.035, 0.055, z), (0, 0.06, z)],
                0.006, "dark", "handle")  # fmt: skip


def _trolley(b: Builder, w: float, d: float, h: float) -> None:
    """Upright: height w, width d, depth h; two wheels or four, a pull-out handle, a door half."""
    g, r = max(b.gap, 0.001), 0.025
    z0 = 2 * r + 0.005
    k = 0.5 * h
    tray(b, "base", (k + g, -d / 2, z0), (h, d / 2, z0 + w), 0.005, "x", -1)
    lid = part(b, "lid", "shell")
    tray(b, lid, (0, -d / 2, z0), (k, d / 2, z0 + w), 0.005, "x", 1)
    for i in range(b.integer(2, 5)):
        y = (i - 1.5) * 0.2 * d
        b.box(lid, (-0.003, y - 0.01, z0 + 0.1 * w), (0, y + 0.01, z0 + 0.9 * w), "trim", "decor",
              False)  # fmt: skip
    b.cylinder(
        lid, (k + g / 2, d / 2, z0 + 0.1 * w), (k + g / 2, d / 2, z0 + 0.9 * w), 0.004, None, "dark"
    )
    b.hinge(lid, "base", (k + g / 2, d / 2, 0), (0, 0, 1), 0, b.uniform(1.2, 1.8), opens=(-1, 0, 0))
    for s in (-1, 1):
        y = s * (d / 2 - 0.04)
        x = h - 0.03
        b.box("base", (x - 0.012, y - 0.02, r * 1.1), (x + 0.012, y - 0.014, z0), "dark")
        b.box("base", (x - 0.012, y + 0.014, r * 1.1), (x + 0.012, y + 0.02, z0), "dark")
        b.cylinder("base", (x, y - 0.02, r), (x, y + 0.02, r), 0.005, None, "metal")
        for q in (-0.017, 0.017):
            b.cylinder("base", (x, y + q - 0.003, r), (x, y + q + 0.003, r), 0.011, None, "dark")
        wheel = part(b, "wheel")
        b.tube(wheel, (x, y - 0.011, r), (x, y + 0.011, r), r, 0.006, "rubber")
        b.spin(wheel, "base", (x, y, r), (0, 1, 0))
        b.cylinder("base", (0.75 * h - 0.02, y, 0), (0.75 * h - 0.02, y, z0), 0.012, None, "rubber")
    pull = part(b, "handle", "pull")
    x, top = h + 0.012, z0 + w
    for s in (-1, 1):
        b.tube("base", (x, s * 0.25 * d, z0 + 0.1 * w), (x, s * 0.25 * d, top - 0.01), 0.0115,
               0.0085, "dark")  # fmt: skip
        b.cylinder(pull, (x, s * 0.25 * d, z0 + 0.2 * w), (x, s * 0.25 * d, top + 0.015), 0.007,
                   None, "metal")  # fmt: skip
    b.box(pull, (x - 0.012, -0.28 * d, top + 0.012), (x + 0.012, 0.28 * d, top + 0.032), "dark",
          "handle")  # fmt: skip
    b.slide(pull, "base", (0, 0, 1), 0, b.uniform(0.4, 0.65) * w, rest=b.choice((0.0, 0.2 * w)))


def mailbox(b: Builder) -> None:
    """A letter box: a front door hinged below or at the side, often a flag; or a wall box flap."""
    w, h, d = b.uniform(0.16, 0.26), b.uniform(0.18, 0.3), b.uniform(0.3, 0.5)
    b.theme(b.choice(("steel", "paint", "dark", "white")))
    g, t = max(b.gap, 0.0015), 0.004
    if b.chance(0.45):
        h, d = b.uniform(0.3, 0.45), b.uniform(0.1, 0.18)
        b.size(w, h, d)
        b.shell("base", (0, -w / 2, 0), (d, w / 2, h), t, "-x", "body")
        zs = 0.8 * h
        pierced(b, "base", (-t, -w / 2, zs), (0, w / 2, h),
                [(-0.4 * w, zs + 0.3 * (h - zs), 0.4 * w, h - 0.2 * (h - zs))], "x",
                "front")  # fmt: skip
        slot = part(b, "lid", "slot_flap")
        z1 = h - 0.15 * (h - zs)
        b.box(
            slot, (-t - g - 0.003, -0.42 * w, zs + 0.25 * (h - zs)), (-t - g, 0.42 * w, z1), "trim"
        )
        b.hinge(slot, "base", (-t - g - 0.0015, 0, z1), (0, 1, 0), 0, 1.4, opens=(-1, 0, 0))
        door = part(b, "door")
        b.box(door, (-t, -w / 2, 0), (0, w / 2, zs - g), "front")
        studs(b, [(-t, 0.35 * w, 0.75 * zs)], (-1, 0, 0), 0.008, door)
        s = b.choice((-1, 1))
        b.hinge(
            door, "base", (-t, s * w / 2, 0), (0, 0, 1), 0, b.uniform(1.4, 1.9), opens=(-1, 0, 0)
        )
        return
    b.size(w, h + 0.9, d)
    z = b.choice((0.0, b.uniform(0.7, 1.1)))
    if z:
        b.box("base", (0.4 * d, -0.045, 0), (0.4 * d + 0.09, 0.045, z), "wood")
        b.box("base", (0.05 * d, -0.4 * w, z - 0.02), (0.95 * d, 0.4 * w, z), "wood")
    vault = [(-w / 2, z), (w / 2, z), (w / 2, z + h - w / 2)]
    theta = np.linspace(0, np.pi, 11)[1:]
    vault += [(w / 2 * np.cos(a), z + h - w / 2 + w / 2 * np.sin(a)) for a in theta]
    c = np.array([0, z + (h - w / 2) / 2])
    inner = (np.array(vault) - c) * (1 - 2 * t / w) + c
    loop = np.concatenate([vault, vault[:1], inner[:1], inner[::-1]])
    profile(b, "base", loop, 0, d, "x", "body")
    profile(b, "base", inner, d - t, d, "x", "body")
    door = part(b, "door")
    profile(b, door, vault, -t - g, -g, "x", "front")
    b.box(
        door, (-t - g - 0.02, -0.02, z + 0.85 * h), (-t - g, 0.02, z + 0.89 * h), "metal", "handle"
    )
    b.hinge(door, "base", (-g, 0, z), (0, 1, 0), 0, b.uniform(1.3, 1.6), opens=(-1, 0, 0))
    if b.chance(0.7):
        flag = part(b, "flag")
        y, fz, x = w / 2 + 0.002 + g, z + 0.55 * h, 0.35 * d
        b.cylinder("base", (x, w / 2 - 0.001, fz), (x, w / 2 + 0.002, fz), 0.012, None, "metal")
        b.cylinder(flag, (x, y, fz), (x, y + 0.003, fz), 0.011, None, "red")
        b.box(flag, (x, y, fz - 0.008), (x + 0.13, y + 0.003, fz + 0.008), "red", "handle")
        b.box(flag, (x + 0.09, y, fz - 0.008), (x + 0.14, y + 0.003, fz + 0.035), "red", "handle")
        b.hinge(flag, "base", (x, y, fz), (0, 1, 0), 0, np.pi / 2, opens=(0, 0, 1))


def chute(b: Builder) -> None:
    """A trash chute or drop box: a hopper door that tips out below a fixed hood."""
    w, h, d = b.uniform(0.35, 0.55), b.uniform(0.5, 1.1), b.uniform(0.3, 0.45)
    b.size(w, h, d)
    b.theme(b.choice(("steel", "paint", "dark")))
    t, g = 0.01, max(b.gap, 0.002)
    b.shell("base", (0, -w / 2, 0), (d, w / 2, h), t, "-x", "body", "solid")
    z0, z1 = 0.5 * h, 0.85 * h
    y = w / 2 - b.uniform(0.03, 0.06)
    pierced(b, "base", (-t, -w / 2, 0), (0, w / 2, h), [(-y, z0, y, z1)], "x", "body")
    door = part(b, "door", "hopper")
    b.box(door, (-t, -y + g, z0 + g), (0, y - g, z1 - g), "front")
    depth = 0.5 * (z1 - z0)
    for s in (-1, 1):
        with b.facing((0, s * (y - g - 0.002) + 0.002, 0), (0, -1, 0), (1, 0, 0)):
            b.extrude(door,
                      [(0, z0 + 0.02), (depth, z1 - 0.3 * (z1 - z0)), (0, z1 - 0.3 * (z1 - z0))],
                      0.004, "metal")  # fmt: skip
    b.handle(door, (-t, 0, z1 - 0.05), (-1, 0, 0), (0, 1, 0), b.uniform(0.12, 0.2),
             b.choice(("bar", "bow", "cup")))  # fmt: skip
    b.hinge(door, "base", (-t / 2, 0, z0 + g), (0, 1, 0), 0, b.uniform(0.5, 0.8), opens=(-1, 0, 0))
    if b.chance(0.5):
        b.box("base", (-0.06, -w / 2, z1 + 0.03), (-t, w / 2, z1 + 0.04), "trim")


CATEGORIES = {"suitcase": suitcase, "mailbox": mailbox, "chute": chute}
