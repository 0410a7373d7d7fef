"""Objects in which nothing moves: furniture of one piece, vessels, tools, figures, stones.

They teach and test when to say that nothing moves. Many look as if something might: a sofa has
cushions, a shelf has boards, a hydrant has caps, a figure has limbs. They are no part of
`CATEGORIES`, whose objects all have joints.
"""

# ruff: noqa: RUF005  (a point plus a tuple is a vector sum here, not a joined list)

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from mam_pipeline.types import FloatArray
from mam_world import shapes
from mam_world.kit import Builder
from mam_world.solids import TAU, rounded, tray

B = "base"


def _ellipsoid(
    b: Builder, center: ArrayLike, radii: ArrayLike, material: str = "body", rough: float = 0.0
) -> None:
    """An ellipsoid; `rough` is the relative height of smooth bumps on it."""
    n = max(b.segments(float(np.max(radii))), 10)
    angle = np.linspace(-np.pi / 2, np.pi / 2, n // 2 + 1)
    profile = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    profile[[0, -1], 0] = 0
    ball = shapes.revolve(profile, n)
    points = ball.vertices * (1.0 + _bumps(b, ball.vertices, rough)[:, None])
    placed = points * np.asarray(radii, float) + np.asarray(center, float)
    b.add(B, shapes.Shape(placed, ball.faces, ball.uv), (), material)


def _bumps(b: Builder, points: FloatArray, height: float) -> FloatArray:
    """(n,) a sum of a few random waves over unit vectors, about -height to height."""
    out = np.zeros(len(points))
    for k in range(6 if height else 0):
        wave = b.rng.normal(size=3) * (1.5 + k)
        out += np.sin(points @ wave + b.uniform(0, TAU)) / (1.5 + k)
    return 0.6 * height * out


def rock(b: Builder) -> None:
    """A stone, or a few that lie together."""
    size = b.uniform(0.1, 1.2)
    b.size(size, size, 0.6 * size)
    b.theme("any")
    for k in range(b.choice((1, 1, 1, 2, 4))):
        s = size * (0.5 if k == 0 else b.uniform(0.1, 0.3))
        at = np.array([b.uniform(-1, 1), b.uniform(-1, 1), 0.0]) * size * (0.7 if k else 0.0)
        radii = s * np.array([b.uniform(0.7, 1.0), b.uniform(0.6, 1.0), b.uniform(0.4, 0.8)])
        _ellipsoid(b, at + (0, 0, 0.8 * radii[2]), radii, "body", b.uniform(0.1, 0.3))


def sofa(b: Builder) -> None:
    """A sofa or an armchair with loose cushions."""
    seats = b.integer(1, 3)
    w, d = 0.3 + seats * b.uniform(0.5, 0.7), b.uniform(0.75, 0.95)
    h, seat, arm = b.uniform(0.75, 0.95), b.uniform(0.36, 0.44), b.uniform(0.1, 0.22)
    b.size(d, w, h)
    b.theme("any")
    leg = b.uniform(0.03, 0.14)
    soft = b.uniform(0.1, 0.16)
    b.feet(B, (-d / 2, -w / 2), (d / 2, w / 2), leg, b.choice(("square", "round", "tapered")))
    b.box(B, (-d / 2, -w / 2, leg), (d / 2, w / 2, seat - soft), "fabric")
    for s in (-1, 1):
        low, high = sorted((s * w / 2, s * (w / 2 - arm)))
        rounded(b, B, (-d / 2, low, seat - soft), (d / 2, high, seat + b.uniform(0.15, 0.25)),
                0.04, "x", "fabric")  # fmt: skip
    back = b.uniform(0.12, 0.22)
    rounded(b, B, (d / 2 - back, -w / 2 + arm, seat - soft), (d / 2, w / 2 - arm, h), 0.05, "y",
            "fabric")  # fmt: skip
    inner = w - 2 * arm
    cushions = b.choice((1, seats))
    for k in range(cushions):
        y0 = -inner / 2 + k * inner / cushions
        y1 = y0 + inner / cushions
        rounded(b, B, (-d / 2, y0 + 0.003, seat - soft), (d / 2 - back, y1 - 0.003, seat + 0.02),
                0.03, "z", "fabric")  # fmt: skip
        if b.chance(0.7):
            x = d / 2 - back
            rounded(b, B, (x - 0.14, y0 + 0.01, seat + 0.02), (x, y1 - 0.01, h - 0.03), 0.04, "y",
                    "fabric")  # fmt: skip
    if b.chance(0.4):
        with b.moved((0, b.uniform(-0.3, 0.3) * inner, seat + 0.16), (0, 1, 0), 0.3):
            _ellipsoid(b, (0, 0, 0), (0.07, 0.17, 0.16), "light")


def chair(b: Builder) -> None:
    """A chair with four legs, and a back of slats, of one board or upholstered."""
    w, d, seat = b.uniform(0.38, 0.52), b.uniform(0.38, 0.5), b.uniform(0.42, 0.48)
    h = b.uniform(0.78, 1.05)
    b.size(d, w, h)
    b.theme("any")
    t, turned = b.uniform(0.022, 0.045), b.chance(0.5)
    for sx in (-1, 1):
        for sy in (-1, 1):
            x, y = sx * (d / 2 - t / 2), sy * (w / 2 - t / 2)
            top = h if sx > 0 else seat - 0.02
            if turned:
                b.cylinder(B, (x, y, 0), (x, y, top), t / 2, None, "wood")
            else:
                b.box(B, (x - t / 2, y - t / 2, 0), (x + t / 2, y + t / 2, top), "wood")
    rounded(b, B, (-d / 2, -w / 2, seat - 0.02), (d / 2 - t, w / 2, seat + b.uniform(0.0, 0.05)),
            0.03, "z", b.choice(("wood", "fabric")))  # fmt: skip
    x = d / 2 - t / 2
    if b.chance(0.5):
        count = b.integer(2, 4)
        for z in np.linspace(seat + 0.12, h - 0.04, count):
            b.box(B, (x - 0.01, -w / 2 + t, z - 0.03), (x + 0.01, w / 2 - t, z + 0.03), "wood")
    elif b.chance(0.5):
        b.box(B, (x - 0.01, -w / 2 + t, h - 0.07), (x + 0.01, w / 2 - t, h), "wood")
        for y in np.linspace(-w / 2 + 2 * t, w / 2 - 2 * t, b.integer(3, 6)):
            b.cylinder(B, (x, y, seat), (x, y, h - 0.06), 0.008, None, "wood")
    else:
        rounded(b, B, (x - 0.02, -w / 2 + t, seat + 0.1), (x + 0.015, w / 2 - t, h), 0.04, "x",
                "fabric")  # fmt: skip
    if b.chance(0.4):
        for sy in (-1, 1):
            y = sy * (w / 2 - t / 2)
            b.box(B, (-d / 2, y - t / 2, 0.64), (d / 2, y + t / 2, 0.665), "wood")
            b.box(B, (-d / 2, y - t / 2, seat), (-d / 2 + t, y + t / 2, 0.64), "wood")


def stool(b: Builder) -> None:
    """A stool: a round or square seat on three or four legs with rungs."""
    h, r = b.uniform(0.35, 0.8), b.uniform(0.14, 0.2)
    b.size(2 * r, 2 * r, h)
    b.theme("any")
    legs = b.integer(3, 4)
    if b.chance(0.6):
        b.disc(B, (0, 0, h - 0.035), (0, 0, 1), r, 0.035, "wood")
    else:
        rounded(b, B, (-r, -r, h - 0.04), (r, r, h), 0.02, "z", "wood")
    feet = [
        np.array([np.cos(a), np.sin(a), 0]) for a in TAU * (np.arange(legs) / legs + 1 / 8)
    ]  # fmt: skip
    for e in feet:
        b.cylinder(B, r * 1.0 * e, 0.7 * r * e + (0, 0, h - 0.03), 0.014, 0.018, "wood")
    if b.chance(0.7):
        z = b.uniform(0.25, 0.5) * h
        at = [(1 - 0.3 * z / h) * r * e + (0, 0, z) for e in feet]
        for k in range(legs):
            b.cylinder(B, at[k], at[(k + 1) % legs], 0.009, None, "wood")


def table(b: Builder) -> None:
    """A table without drawers: legs or a column, with or without an apron and a shelf."""
    w, d, h = b.uniform(0.5, 1.8), b.uniform(0.4, 0.9), b.uniform(0.38, 0.78)
    b.size(d, w, h)
    b.theme("any")
    t = b.uniform(0.018, 0.05)
    if b.chance(0.25):
        r = d / 2
        b.disc(B, (0, 0, h - t), (0, 0, 1), r, t, "wood")
        b.lathe(B, [(0.6 * r, 0), (0.6 * r, 0.02), (0.06, 0.06), (0.045, h - t)], "wood")
        return
    b.box(B, (-d / 2, -w / 2, h - t), (d / 2, w / 2, h), b.choice(("wood", "glass", "front")))
    inset, leg = b.uniform(0.0, 0.06), b.uniform(0.03, 0.08)
    kind = b.choice(("square", "round", "tapered", "sled"))
    b.feet(B, (-d / 2, -w / 2), (d / 2, w / 2), h - t, kind, "wood", inset)
    if b.chance(0.5):
        drop = b.uniform(0.06, 0.12)
        for s in (-1, 1):
            y, x = s * (w / 2 - inset - leg / 2), s * (d / 2 - inset - leg / 2)
            b.box(B, (-d / 2 + inset + leg, y - 0.01, h - t - drop),
                  (d / 2 - inset - leg, y + 0.01, h - t), "wood")  # fmt: skip
            b.box(B, (x - 0.01, -w / 2 + inset + leg, h - t - drop),
                  (x + 0.01, w / 2 - inset - leg, h - t), "wood")  # fmt: skip
    if b.chance(0.3):
        z = b.uniform(0.15, 0.5) * h
        b.box(B, (-d / 2 + 0.05, -w / 2 + 0.05, z), (d / 2 - 0.05, w / 2 - 0.05, z + 0.018), "wood")


def shelf(b: Builder) -> None:
    """Open shelves, with or without a back, with books and boxes on them."""
    w, d, h = b.uniform(0.4, 1.4), b.uniform(0.2, 0.45), b.uniform(0.5, 2.1)
    b.size(d, w, h)
    b.theme("any")
    t = b.uniform(0.012, 0.03)
    sides = "-x" if b.chance(0.6) else "-x,+x"
    b.shell(B, (-d / 2, -w / 2, 0), (d / 2, w / 2, h), t, sides, "wood")
    levels = b.integer(1, 6)
    columns = b.choice((1, 1, 2, 3))
    for y in np.linspace(-w / 2, w / 2, columns + 1)[1:-1]:
        b.panel(B, (-d / 2, y - t / 2, t), (d / 2, y + t / 2, h - t), "wood")
    zs = np.linspace(t, h, levels + 2)
    for z in zs[1:-1]:
        b.panel(B, (-d / 2, -w / 2 + t, z - t / 2), (d / 2 - t, w / 2 - t, z + t / 2), "wood")
    if b.chance(0.5):
        room = zs[1] - zs[0]
        for z in zs[:-1]:
            y = -w / 2 + t + 0.02
            while y < w / 2 - 0.12 and b.chance(0.8):
                thick, tall = b.uniform(0.015, 0.09), b.uniform(0.4, 0.8) * room
                b.box(B, (-d / 2 + 0.02, y, z + t / 2), (d / 2 - 0.05, y + thick, z + tall),
                      b.choice(("front", "dark", "light", "body")))  # fmt: skip
                y += thick + b.choice((0.001, 0.001, 0.15))


def bed(b: Builder) -> None:
    """A bed: a frame, a headboard, a mattress, pillows and a blanket."""
    w, d, h = b.choice((0.9, 1.4, 1.8)), b.uniform(1.9, 2.1), b.uniform(0.7, 1.2)
    b.size(d, w, h)
    b.theme("any")
    z = b.uniform(0.2, 0.35)
    b.feet(B, (-d / 2, -w / 2), (d / 2, w / 2), z - 0.1, "square", "wood", 0.02)
    b.box(B, (-d / 2, -w / 2, z - 0.1), (d / 2, w / 2, z), "wood")
    rounded(b, B, (-d / 2 + 0.03, -w / 2 + 0.03, z), (d / 2 - 0.03, w / 2 - 0.03, z + 0.2), 0.06,
            "z", "light")  # fmt: skip
    b.box(B, (d / 2, -w / 2, 0), (d / 2 + 0.05, w / 2, h), b.choice(("wood", "fabric")))
    if b.chance(0.4):
        b.box(B, (-d / 2 - 0.04, -w / 2, 0), (-d / 2, w / 2, z + 0.3), "wood")
    for y in (0.0,) if w < 1.2 else (-w / 4, w / 4):
        _ellipsoid(b, (d / 2 - 0.3, y, z + 0.25), (0.2, 0.3, 0.08), "fabric")
    if b.chance(0.5):
        rounded(b, B, (-d / 2 + 0.02, -w / 2 - 0.01, z + 0.17), (0.1, w / 2 + 0.01, z + 0.22), 0.02,
                "z", "fabric")  # fmt: skip


def mug(b: Builder) -> None:
    """A mug or a cup with a handle, sometimes on a saucer."""
    r, h = b.uniform(0.032, 0.05), b.uniform(0.07, 0.13)
    b.size(3 * r, 2 * r, h)
    b.theme("any")
    foot = b.uniform(0.6, 1.0)
    base = 0.0
    if b.chance(0.3):
        base = 0.008
        b.lathe(B, [(0.9 * r, 0), (2 * r, 0.014), (2 * r, 0.017), (0.9 * r, 0.006)], "light")
    with b.moved((0, 0, base)):
        b.vessel(B, [(foot * r, 0), (r, 0.3 * h), (r * b.uniform(0.95, 1.15), h)], 0.004, "light")
        t = np.linspace(-1.3, 1.3, 13)
        path = np.stack([0 * t, -(0.8 * r + 0.75 * r * np.cos(t)), h / 2 + 0.3 * h * np.sin(t)], 1)
        b.sweep(B, path, 0.005, "light", "handle")


def bowl(b: Builder) -> None:
    """A bowl, or plates and bowls that stand in each other."""
    r, h = b.uniform(0.06, 0.2), b.uniform(0.03, 0.12)
    b.size(2 * r, 2 * r, h)
    b.theme("any")
    step = b.uniform(0.006, 0.02)
    for k in range(b.choice((1, 1, 2, 5))):
        with b.moved((0, 0, k * step)):
            b.vessel(B, [(0.4 * r, 0), (0.75 * r, 0.35 * h), (r, h)], 0.003, "light")


def vase(b: Builder) -> None:
    """A vase or a flower pot, empty or with stems in it."""
    h = b.uniform(0.12, 0.6)
    r = h * b.uniform(0.15, 0.4)
    b.size(2 * r, 2 * r, h)
    b.theme("any")
    z = np.linspace(0, h, 9)
    wave = r * (0.75 + 0.25 * np.sin(b.uniform(0, TAU) + z / h * b.uniform(1, 6)))
    b.vessel(B, np.c_[wave, z], max(0.03 * r, 0.002), "body")
    if b.chance(0.5):
        b.disc(B, (0, 0, 0.6 * h), (0, 0, 1), 0.45 * r, 0.05 * h, "dark")
        for _ in range(b.integer(2, 8)):
            a, lean = b.uniform(0, TAU), b.uniform(0.1, 0.8) * r
            tip = (lean * np.cos(a), lean * np.sin(a), h * b.uniform(1.2, 2.0))
            b.cylinder(B, (0, 0, 0.6 * h), tip, 0.01 * h, 0.006 * h, "body")
            _ellipsoid(b, tip, np.array([0.5, 0.5, 0.8]) * 0.12 * h, "light", 0.1)


def hammer(b: Builder) -> None:
    """A hammer, an axe or a mallet, lying down."""
    length, r = b.uniform(0.22, 0.7), b.uniform(0.011, 0.018)
    b.size(length, 0.15, 0.04)
    b.theme("any")
    b.cylinder(B, (0, 0, 0.02), (length, 0, 0.02), r, 0.8 * r, "wood")
    if b.chance(0.4):
        b.cylinder(B, (0, 0, 0.02), (0.3 * length, 0, 0.02), 1.25 * r, None, "rubber")
    x = length - 0.02
    kind = b.choice(("hammer", "axe", "mallet"))
    if kind == "mallet":
        b.cylinder(B, (x, -0.06, 0.02), (x, 0.06, 0.02), 0.03, None, "rubber")
    elif kind == "axe":
        b.extrude(B, [(x - 0.02, -0.03), (x + 0.02, -0.03), (x + 0.05, 0.1), (x - 0.05, 0.1)],
                  0.03, "metal")  # fmt: skip
    else:
        b.cylinder(B, (x, -0.05, 0.02), (x, 0.02, 0.02), 0.014, None, "metal", sides=8)
        b.extrude(B, [(x - 0.012, 0.02), (x + 0.012, 0.02), (x + 0.002, 0.09), (x - 0.002, 0.09)],
                  0.03, "metal")  # fmt: skip


def screwdriver(b: Builder) -> None:
    """A screwdriver, a chisel or a file: a grip and a shaft."""
    length, r = b.uniform(0.12, 0.35), b.uniform(0.008, 0.018)
    b.size(length, 2 * r, 2 * r)
    b.theme("any")
    grip = b.uniform(0.3, 0.5) * length
    with b.facing((0, 0, r), (1, 0, 0)):
        b.lathe(B, [(0.6 * r, 0), (r, 0.1 * grip), (0.8 * r, 0.5 * grip), (r, 0.85 * grip),
                    (0.5 * r, grip)], "rubber", sides=b.choice((6, 8, 16)))  # fmt: skip
        b.cylinder(B, (0, 0, grip), (0, 0, length), 0.25 * r, None, "metal")
        b.block(B, (0, 0, length), (0.5 * r, 0.1 * r, 0.03 * length), "metal")


def spanner(b: Builder) -> None:
    """A spanner with an open and a ring end."""
    length, w = b.uniform(0.12, 0.3), b.uniform(0.01, 0.02)
    b.size(length, 2 * w, 0.008)
    b.theme("steel")
    t = b.uniform(0.004, 0.008)
    b.box(B, (0, -w / 2, 0), (length, w / 2, t), "metal")
    b.tube(B, (length + 0.8 * w, 0, 0), (length + 0.8 * w, 0, t), 1.1 * w, 0.7 * w, "metal")
    jaw = [(0, -w), (-1.8 * w, -w), (-1.8 * w, -0.5 * w), (-0.6 * w, -0.5 * w),
           (-0.6 * w, 0.5 * w), (-1.8 * w, 0.5 * w), (-1.8 * w, w), (0, w)]  # fmt: skip
    b.extrude(B, np.array(jaw), t, "metal")


def figure(b: Builder) -> None:
    """A standing figure: a toy, a statue or a robot of round or square limbs, of one piece."""
    h = b.uniform(0.08, 1.8)
    b.size(0.3 * h, 0.5 * h, h)
    b.theme("any")
    round_ = b.chance(0.6)

    def limb(a: ArrayLike, z: ArrayLike, r: float, material: str = "body") -> None:
        if round_:
            b.cylinder(B, a, z, r, 0.85 * r, material)
            b.sphere(B, z, 0.9 * r, material)
        else:
            low, high = np.minimum(a, z) - r, np.maximum(a, z) + r
            b.box(B, low, high, material)

    hip, chest, w = 0.48 * h, 0.78 * h, 0.09 * h
    low = 0.0
    if b.chance(0.5):
        low = 0.06 * h
        b.box(B, (-0.15 * h, -0.2 * h, 0), (0.15 * h, 0.2 * h, low), "dark")
    for s in (-1, 1):
        stride = s * b.uniform(0.0, 0.08) * h
        limb((stride, s * 0.07 * h, low + 0.05 * h), (0, s * 0.06 * h, hip), 0.05 * h, "dark")
        hand = (b.uniform(-0.25, 0.05) * h, s * b.uniform(0.16, 0.3) * h, b.uniform(0.4, 0.9) * h)
        limb(hand, (0, s * (w + 0.04 * h), chest - 0.02 * h), 0.035 * h)
    if round_:
        _ellipsoid(b, (0, 0, (hip + chest) / 2), (0.08 * h, 0.11 * h, 0.2 * h))
    else:
        b.box(B, (-0.06 * h, -w, hip), (0.06 * h, w, chest))
    b.cylinder(B, (0, 0, chest - 0.02 * h), (0, 0, chest + 0.05 * h), 0.03 * h, None, "light")
    _ellipsoid(b, (0, 0, 0.9 * h), (0.075 * h, 0.065 * h, 0.085 * h), "light", 0.02)


def animal(b: Builder) -> None:
    """A four-legged animal of ellipsoids and cylinders."""
    n = b.uniform(0.1, 1.2)
    b.size(n, 0.4 * n, 0.7 * n)
    b.theme("any")
    z, rough = 0.42 * n, b.uniform(0.0, 0.06)
    _ellipsoid(b, (0, 0, z), (0.4 * n, 0.15 * n, 0.17 * n), "body", rough)
    _ellipsoid(b, (-0.48 * n, 0, z + 0.22 * n), (0.13 * n, 0.09 * n, 0.1 * n), "body", rough)
    b.cylinder(B, (-0.3 * n, 0, z + 0.05 * n), (-0.45 * n, 0, z + 0.2 * n), 0.08 * n, None, "body")
    for sx in (-1, 1):
        for sy in (-1, 1):
            b.cylinder(B, (sx * 0.27 * n, sy * 0.09 * n, 0),
                       (sx * 0.25 * n, sy * 0.08 * n, z), 0.035 * n, 0.06 * n)  # fmt: skip
    for sy in (-1, 1):
        _ellipsoid(b, (-0.44 * n, sy * 0.06 * n, z + 0.34 * n), (0.02 * n, 0.03 * n, 0.08 * n))
    b.sweep(B, [(0.38 * n, 0, z), (0.5 * n, 0, z + 0.05 * n), (0.55 * n, 0, z - 0.1 * n)],
            0.02 * n)  # fmt: skip


def open_bin(b: Builder) -> None:
    """A bin, a bucket, a basket or a crate without a lid."""
    w, d, h = b.uniform(0.15, 0.5), b.uniform(0.15, 0.4), b.uniform(0.12, 0.7)
    b.size(d, w, h)
    b.theme("any")
    if b.chance(0.5):
        r = w / 2
        b.vessel(B, [(b.uniform(0.7, 1.0) * r, 0), (r, h)], 0.004, "body")
        if b.chance(0.6):
            b.torus(B, (0, 0, h), (0, 0, 1), r, 0.006, "trim")
        return
    tray(b, B, (-d / 2, -w / 2, 0), (d / 2, w / 2, h), b.uniform(0.004, 0.015), "z", 1)
    if b.chance(0.5):
        e = 0.012
        for s in (-1, 1):
            b.box(B, (-d / 2 - e, s * (w / 2 + e / 2) - e / 2, h - 0.03),
                  (d / 2 + e, s * (w / 2 + e / 2) + e / 2, h + 0.004), "trim")  # fmt: skip
            b.box(B, (s * (d / 2 + e / 2) - e / 2, -w / 2, h - 0.03),
                  (s * (d / 2 + e / 2) + e / 2, w / 2, h + 0.004), "trim")  # fmt: skip


def ladder(b: Builder) -> None:
    """A ladder or a ladder-like rack that leans on nothing."""
    h, w, t = b.uniform(1.0, 2.6), b.uniform(0.32, 0.5), b.uniform(0.02, 0.05)
    b.size(0.1, w, h)
    b.theme("any")
    for s in (-1, 1):
        b.box(B, (-t / 2, s * w / 2 - t / 2, 0), (t / 2, s * w / 2 + t / 2, h), "wood")
    for z in np.arange(0.2, h - 0.1, b.uniform(0.22, 0.32)).tolist():
        b.cylinder(B, (0, -w / 2, z), (0, w / 2, z), 0.35 * t, None, "metal")


def picture_frame(b: Builder) -> None:
    """A picture, a mirror or a sign in its frame."""
    w, h, border = b.uniform(0.15, 1.2), b.uniform(0.15, 1.2), b.uniform(0.015, 0.08)
    b.size(0.03, w, h)
    b.theme("any")
    b.border(B, (-0.015, -w / 2, 0), (0.01, w / 2, h), border, "wood")
    b.box(B, (-0.004, -w / 2 + border, border), (0.006, w / 2 - border, h - border),
          b.choice(("glass", "light", "front")))  # fmt: skip


def lamp(b: Builder) -> None:
    """A lamp with a foot, a pole and a shade, all fixed."""
    h, r = b.uniform(0.25, 1.7), b.uniform(0.08, 0.22)
    b.size(2 * r, 2 * r, h)
    b.theme("any")
    b.lathe(B, [(0.8 * r, 0), (0.8 * r, 0.012), (0.02, 0.04)], "metal")
    b.cylinder(B, (0, 0, 0.03), (0, 0, h - 0.6 * r), 0.009, None, "metal")
    z = h - 1.3 * r
    for a in TAU * np.arange(3) / 3:
        b.cylinder(B, (0, 0, z + 0.02), (0.95 * r * np.cos(a), 0.95 * r * np.sin(a), z + 0.02),
                   0.003, None, "metal")  # fmt: skip
    with b.moved((0, 0, z)):
        b.vessel(B, [(r, 0), (b.uniform(0.5, 1.0) * r, 1.3 * r)], 0.003, "fabric", bottom=False)
    b.sphere(B, (0, 0, h - 0.5 * r), 0.03, "light")


def hydrant(b: Builder) -> None:
    """A hydrant, a bollard or a post with caps, rings and bolts that nobody turns."""
    h, r = b.uniform(0.5, 1.1), b.uniform(0.07, 0.14)
    b.size(3 * r, 3 * r, h)
    b.theme("paint")
    b.disc(B, (0, 0, 0), (0, 0, 1), 1.6 * r, 0.03, "body")
    b.cylinder(B, (0, 0, 0.03), (0, 0, 0.8 * h), r, 0.95 * r, "body")
    b.disc(B, (0, 0, 0.8 * h), (0, 0, 1), 1.25 * r, 0.03, "body")
    b.lathe(B, [(1.1 * r, 0.8 * h + 0.03), (0.9 * r, 0.9 * h), (0.3 * r, h - 0.03), (0.2 * r, h)],
            "body")  # fmt: skip
    for a in TAU * np.arange(b.choice((0, 1, 2, 3))) / 3:
        e = np.array([np.cos(a), np.sin(a), 0.0])
        at = np.array([0, 0, 0.62 * h])
        b.cylinder(B, at + 0.8 * r * e, at + 1.4 * r * e, 0.45 * r, None, "body")
        b.cylinder(B, at + 1.4 * r * e, at + 1.6 * r * e, 0.55 * r, None, "light", sides=6)
    for a in TAU * np.arange(6) / 6:
        b.cylinder(B, (1.4 * r * np.cos(a), 1.4 * r * np.sin(a), 0.03),
                   (1.4 * r * np.cos(a), 1.4 * r * np.sin(a), 0.045), 0.012, None, "metal",
                   sides=6)  # fmt: skip


def bench(b: Builder) -> None:
    """A garden bench of slats on two cheeks."""
    w, d = b.uniform(0.9, 1.9), b.uniform(0.4, 0.6)
    b.size(d, w, 0.85)
    b.theme("any")
    for s in (-1, 1):
        y = s * (w / 2 - 0.08)
        for x in (-d / 2 + 0.03, d / 2 - 0.03):
            b.box(B, (x - 0.03, y - 0.02, 0), (x + 0.03, y + 0.02, 0.42 if x < 0 else 0.85), "dark")
        b.box(B, (-d / 2, y - 0.02, 0.38), (d / 2, y + 0.02, 0.42), "dark")
    for x in np.linspace(-d / 2 + 0.04, d / 2 - 0.1, b.integer(3, 6)):
        b.box(B, (x - 0.03, -w / 2, 0.42), (x + 0.03, w / 2, 0.445), "wood")
    for z in np.linspace(0.55, 0.8, b.integer(1, 3)):
        b.box(B, (d / 2 - 0.08, -w / 2, z - 0.035), (d / 2 - 0.06, w / 2, z + 0.035), "wood")


def blocks(b: Builder) -> None:
    """Bricks, parcels or books piled on each other."""
    n = b.uniform(0.1, 0.6)
    b.size(n, n, n)
    b.theme("any")
    z = 0.0
    for _ in range(b.integer(2, 6)):
        size = n * np.array([b.uniform(0.4, 1), b.uniform(0.4, 1), b.uniform(0.08, 0.4)])
        with b.moved((b.uniform(-0.1, 0.1) * n, 0, z), (0, 0, 1), b.uniform(-0.4, 0.4)):
            b.block(B, (0, 0, size[2] / 2), size, b.choice(("body", "front", "dark", "light")))
        z += size[2]


def statue(b: Builder) -> None:
    """A bust, an urn or an obelisk on a plinth."""
    h, r = b.uniform(0.3, 2.0), b.uniform(0.12, 0.25)
    b.size(2 * r * h, 2 * r * h, h)
    b.theme("any")
    w = r * h
    b.box(B, (-w, -w, 0), (w, w, 0.06 * h), "body")
    b.box(B, (-0.8 * w, -0.8 * w, 0.06 * h), (0.8 * w, 0.8 * w, 0.4 * h), "body")
    b.box(B, (-w, -w, 0.4 * h), (w, w, 0.45 * h), "body")
    kind = b.choice(("bust", "urn", "obelisk"))
    if kind == "bust":
        _ellipsoid(b, (0, 0, 0.56 * h), (0.6 * w, 0.95 * w, 0.13 * h), "light", 0.08)
        b.cylinder(B, (0, 0, 0.6 * h), (0, 0, 0.78 * h), 0.3 * w, None, "light")
        _ellipsoid(b, (0, 0, 0.86 * h), (0.45 * w, 0.4 * w, 0.14 * h), "light", 0.08)
    elif kind == "urn":
        b.lathe(B, [(0.5 * w, 0.45 * h), (0.3 * w, 0.55 * h), (0.9 * w, 0.8 * h), (0.7 * w, h)],
                "light")  # fmt: skip
    else:
        b.cylinder(B, (0, 0, 0.45 * h), (0, 0, h), 0.7 * w, 0.2 * w, "light", sides=4)


CATEGORIES = {
    "rock": rock, "sofa": sofa, "chair": chair, "stool": stool, "table": table, "shelf": shelf,
    "bed": bed, "mug": mug, "bowl": bowl, "vase": vase, "hammer": hammer,
    "screwdriver": screwdriver, "spanner": spanner, "figure": figure, "animal": animal,
    "open_bin": open_bin, "ladder": ladder, "picture_frame": picture_frame, "fixed_lamp": lamp,
    "hydrant": hydrant, "bench": bench, "blocks": blocks, "statue": statue,
}  # fmt: skip
