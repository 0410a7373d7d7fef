"""Things to cook with: grills, ranges, stoves, cookers, fryers, mixers, presses, bread boxes."""

# ruff: noqa: RUF005  (a point plus a tuple is a vector sum here, not a joined list)

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np

from mam_pipeline.types import FloatArray
from mam_world import collide, shapes
from mam_world.kit import Builder
from mam_world.mech import dial, wheel
from mam_world.solids import TAU, bar, bored, part, pierced, profile, rounded, settle, tray

Seq = Sequence[float]
FRONT, UP, DOWN, Y, METALS = (-1, 0, 0), (0, 0, 1), (0, 0, -1), (0, 1, 0), ("metal", "body", "trim")


def _start(b: Builder, themes: str, *extents: float) -> float:
    b.size(*extents)
    b.theme(b.choice(themes.split()))
    return max(b.gap, 0.001)


def _oval(a: float, c: float, power: float, start: float = 0.0) -> FloatArray:
    """(n, 2) superellipse from its front, -x, counter-clockwise; `start` leaves |y| < it out."""
    t0 = float(np.arcsin(min(start / c, 1.0) ** (power / 2)))
    t = np.linspace(np.pi + t0, 3 * np.pi - t0, 33)[: None if start else -1]
    u = np.stack([np.cos(t), np.sin(t)], axis=1)
    return np.sign(u) * np.abs(u) ** (2 / power) * (a, c)


def _body(b: Builder, link: str, p: FloatArray, rows: Sequence[Seq], paint: str = "body") -> None:
    """Convex body along z over an outline: `rows` of (z, scale) or (z, x scale, y scale)."""
    piece = collide.rings(np.stack([np.c_[p * (r[1], r[-1]), np.full(len(p), r[0])] for r in rows]))
    b.add(link, shapes.oriented(piece.vertices, piece.faces), [piece], paint)


def _vault(b: Builder, link: str, r: float, z: float, h: float, w: float, t: float) -> None:
    """A hollow lid over (-r, r), round, chamfered or slanted, with its handle and a badge."""
    u, k, steep = np.linspace(np.pi, 0, 13), b.integer(2, 4), b.choice((0.6, 1.0))
    pts = np.c_[np.cos(u), np.sin(u) ** steep]
    if b.chance(0.5):
        (i, j), k = b.choice(((0.06, 0.75), (0.5, 0.35))), b.integer(0, 1)
        pts = np.array([(-1, 0), (i - 1, j), (1.5 * i - 0.9, 1), (0.85, 1), (1, 0.6), (1, 0)])
    pts, inner = pts * (r, h) + (0, z), pts[::-1] * (r - t, h - t) + (0, z)
    profile(b, link, np.r_[pts, inner], -w / 2 + t, w / 2 - t, "y", "front")
    for y in (-w / 2, w / 2 - t):
        profile(b, link, pts, y, y + t, "y", "front")
    mid, d = (pts[k] + pts[k + 1]) / 2, pts[k + 1] - pts[k]
    at, n = np.array([mid[0], 0, mid[1]]), np.array([-d[1], 0, d[0]])
    b.handle(link, at, n, Y, b.uniform(0.25, 0.8) * w, b.choice(("bar", "bar", "bow", "knob")))
    b.disc(link, at - (0, 0.45 * w, 0), n, 0.1 * r, 0.01, "light", "decor")


def _knob(b: Builder, at: Seq, n: Seq, r: float, h: float, turns: bool, to: str = "base") -> None:
    key = part(b, "knob") if turns else to
    dial(b, key, np.array(at) + np.array(n) * max(0.2 * b.gap, 0.0004) * turns, n, r, h)
    if turns:
        b.spin(key, to, at, n, 0.0, b.uniform(1.5, 5.2))


def _controls(b: Builder, x: float, w: float, z0: float, h: float) -> None:
    b.box("base", (x - 0.006, -w / 2, z0), (x + 0.03, w / 2, z0 + h), b.choice(("dark", "trim")))
    b.block("base", (x - 0.006, 0, z0 + 0.72 * h), (0.003, 0.5 * w, 0.35 * h), "screen", "decor")
    for y in np.linspace(-0.36, 0.36, b.integer(2, 5)) * w:
        b.disc("base", (x - 0.006, y, z0 + 0.28 * h), FRONT, 0.06 * w, 0.004, "light", "decor")


def _grate(b: Builder, low: Seq, high: Seq, n: int, r: float = 0.004) -> None:
    (x0, y0, z), (x1, y1) = low, high
    for y in np.linspace(y0 + r, y1 - r, n):
        b.box("base", (x0, y - r, z + r), (x1, y + r, z + 3 * r), "metal")
    for x in (0.8 * x0 + 0.2 * x1, 0.2 * x0 + 0.8 * x1):
        b.box("base", (x - r, y0, z), (x + r, y1, z + 2 * r), "metal")


def _door(b: Builder, low: Seq, high: Seq, s: int, far: float, moves: bool = True) -> str:
    """A front with window and handle before a body, hinged at y of sign `s`, or 0: its bottom."""
    key, kind = part(b, "door") if moves else "base", b.choice(("glass", "window", "slab"))
    (x, y0, z0), (_, y1, z1) = low, high
    b.front(key, low, high, kind if kind == "glass" else "slab")
    w, h, y, z = y1 - y0, z1 - z0, (y0 + y1) / 2, (z0 + z1) / 2
    if kind == "window":
        b.block(key, (x, y, z), (0.004, b.uniform(0.5, 0.8) * w, 0.5 * h), "screen", "decor")
    at, axis = (x, y - s * 0.42 * w, z if s else z1 - 0.1 * h), UP if s else Y
    long = b.uniform(0.2, 0.6) * h if s else b.uniform(0.5, 0.9) * w
    b.handle(key, at, FRONT, axis, long, b.choice(("bar", "bar", "bow", "strip")))
    if moves:
        edge, tip = (x, y + s * w / 2, z0), (x, y - s * w / 2, z1)
        b.hinge(key, "base", edge, axis, 0.0, far, opens=FRONT, tip=tip)
    return key


def _drawer(b: Builder, low: Seq, high: Seq, moves: bool = True, inset: float = 0.004) -> None:
    """A drawer from its front at low[0] back to high[0]; or only its front, on the base."""
    key, x, e = part(b, "drawer") if moves else "base", low[0] + 0.015, np.array((0, inset, inset))
    b.box(key, low, (x, high[1], high[2]), b.choice(("front", "body")))
    at = (low[0], (low[1] + high[1]) / 2, 0.4 * low[2] + 0.6 * high[2])
    kind = b.choice(("bar", "strip", "knob", "bow", "none"))
    b.handle(key, at, FRONT, Y, b.uniform(0.3, 0.8) * (high[1] - low[1]), kind)
    if moves:
        tray(b, key, (x, low[1], low[2]) + e, high - e, 0.004)
        b.slide(key, "base", FRONT, 0.0, b.uniform(0.4, 0.9) * (high[0] - low[0]))


def barbecue(b: Builder) -> None:
    """A kettle, table or cart grill: a hinged lid; shelves, doors and knobs often still."""
    kind, r = b.choice(("kettle", "cart", "cart", "table")), b.uniform(0.18, 0.36)
    z0, w = b.uniform(0.4, 0.75) if kind != "table" else 0.05, b.uniform(0.5, 1.2)
    deep, tall, w = b.uniform(0.5, 1) * r, b.uniform(0.5, 1.1) * r, 2 * r if kind == "kettle" else w
    g, lid, z = _start(b, "dark steel paint", 2 * r, w, z0 + 2 * r), part(b, "lid"), z0 + deep
    k, x, turns = 0.65 if kind == "kettle" else 0.95, -1.1 * r, b.chance(0.3)
    _grate(b, (-k * r, -k * w / 2, z - 0.03), (k * r, k * w / 2), b.integer(7, 16))
    if kind == "kettle":
        t = np.linspace(0.2, np.pi / 2, 9)
        for q, n, link, at in ((deep, UP, "base", z), (tall, DOWN, lid, z + g)):
            with b.facing((0, 0, at), n):
                b.vessel(link, np.c_[r * np.sin(t), -q * np.cos(t)], 0.008)
        b.tube(lid, (0, 0, z + g), (0, 0, z + g + 0.015), r + 0.005, r - 0.004, "metal")
        b.handle(lid, (0, 0, z + g + 0.98 * tall), UP, Y, 0.16, b.choice(("bar", "bow")))
        b.disc(lid, (0.4 * r, 0.3 * r, z + 0.8 * tall), (4, 3, 9), 0.2 * r, 0.08 * tall, "metal")
        for x, y in 1.05 * shapes.circle(r, 3, phase=np.pi):
            b.cylinder("base", (0.7 * x, 0.7 * y, z - 0.6 * deep), (x, y, 0), 0.012, None, "metal")
    else:
        b.shell("base", (-r, -w / 2, z0), (r, w / 2, z), 0.012, "+z")
        b.box("base", (x, -w / 2, z0), (-r, w / 2, z0 + 0.6 * deep), b.choice(METALS))
        for y in np.linspace(-0.4, 0.4, b.integer(2, 5)) * w:
            _knob(b, (x, y, z0 + 0.3 * deep), FRONT, min(0.03, 0.22 * deep), 0.03, turns)
        _vault(b, lid, r, z + g, tall, w, 0.012)
    if kind == "cart" and b.chance(0.5):
        x, moves, y = -0.85 * r, b.chance(0.5), 0.48 * w
        b.shell("base", (x, -y, 0), (-x, y, z0), 0.012, "-x")
        for lo, hi, s in ((-y, -g, -1), (g, y, 1)):
            _door(b, (x - 0.022, lo, 0.05), (x - g, hi, z0 - 0.02), s, b.uniform(1.3, 1.9), moves)
    elif kind == "cart":
        for y in (-0.42 * w, 0.42 * w):
            for q in (-0.7 * r, 0.7 * r):
                b.cylinder("base", (q, y, 0), (q, y, z), 0.016, None, "metal")
            wheel(b, "base", (0.7 * r, y * 1.1, 0.09), Y, 0.09, 0.04)
        b.block("base", (0, 0, 0.25 * z0), (1.5 * r, 0.88 * w, 0.02), "trim")
        _drawer(b, (-r, -0.25 * w, z0 - 0.07), (0.6 * r, 0.25 * w, z0 - g), b.chance(0.6))
    for s in (-1, 1) if kind != "table" else ():
        key, y = part(b, "shelf") if b.chance(0.3) else "base", s * (w / 2 + 0.03)
        y0, y1 = sorted((y, y + s * b.uniform(0.1, 0.4)))
        b.box(key, (-0.6 * r, y0, z - 0.05), (0.6 * r, y1, z - 0.02), b.choice(("wood", "front")))
        root, under = s * (0.4 if kind == "kettle" else 0.48) * w, z - 0.065 - g
        bar(b, "base", (0, root, under), (0, y + s * 0.02, under), r, 0.03, material="metal")
        if key != "base":
            b.hinge(key, "base", (0, y, z - 0.02), (1, 0, 0), 0.0, 1.45, opens=UP)
    b.block("base", (r + 0.006, 0, z - 0.013), (0.024, 0.2 * r, 0.024), "metal")
    b.hinge(lid, "base", (r + 0.008, 0, z + g / 2), Y, 0, b.uniform(1.1, 1.5), opens=UP)
    settle(b)


def rice_cooker(b: Builder) -> None:
    """A rice or pressure cooker or a waffle iron: a lid that tilts or turns; long handles."""
    kind, a = b.choice(("rice", "rice", "pressure", "waffle", "waffle")), b.uniform(0.09, 0.16)
    h, tall = a * b.uniform(0.9, 1.9) * (0.4 if kind == "waffle" else 1), a * b.uniform(0.15, 0.5)
    oval = _oval(a, a * b.uniform(0.8, 1.3), b.choice((2.0, 2.0, 2.6, 4.0, 7.0)))
    g, lid = _start(b, "white steel dark plastic paint", 2 * a, 2 * a, h), part(b, "lid")
    z, long, wide = h + g, b.uniform(0.3, 1.8) * a, b.uniform(0.1, 0.3) * a
    if kind == "pressure":
        b.vessel("base", [(0.92 * a, 0), (a, 0.08 * h), (a, h)], 0.005, b.choice(METALS))
        rings = [(1.03 * a, 0), (1.03 * a, 0.01), (0.85 * a, 0.3 * tall), (0.2 * a, tall)]
        with b.moved((0, 0, z)):
            b.lathe(lid, rings, b.choice(("glass", "metal", "body")))
        b.handle("base", (0.99 * a, 0, 0.8 * h), (1, 0, 0), Y, 0.6 * a, "bow", "dark")
        b.spin(lid, "base", (0, 0, h), b.choice((UP, DOWN)), 0.0, b.uniform(0.4, 0.9))
    else:
        _body(b, "base", oval, ((0, 0.85), (0.2 * h, 1), (0.85 * h, 1), (h, 0.95)))
        rows = ((z, 0.95), (z + 0.4 * tall, 0.93), (z + 0.85 * tall, 0.75), (z + tall, 0.5))
        _body(b, lid, oval, rows, b.choice(METALS))
        b.box("base", (0.8 * a, -0.4 * a, h - 0.025), (0.95 * a + 0.01, 0.4 * a, h), "trim")
        y = 0.77 * oval[:, 1].max()
        b.box(lid, (0.6 * a, -y, z), (0.95 * a, y, z + 0.3 * tall), "trim")
        b.hinge(lid, "base", (0.95 * a, 0, z), Y, 0, b.uniform(1.1, 1.6), opens=UP)
    if b.chance(0.6):
        _knob(b, (0, 0, z + tall), UP, 0.15 * a, 0.1 * a, b.chance(0.35), lid)
    elif kind == "rice":
        b.handle(lid, (0, 0, z + tall), UP, Y, 0.8 * a, b.choice(("bow", "bar")))
    if kind == "rice":
        _controls(b, -a, 0.9 * a, 0.25 * h, 0.5 * h)
        b.block(lid, (-0.9 * a, 0, z + 0.3 * tall), (0.14 * a, 0.35 * a, 0.4 * tall), "trim")
    grips = ((lid, z + 0.1 * tall, z + 0.5 * tall), ("base", z - 0.45 * h, z - 0.05 * h - g))
    for key, z0, z1 in grips[: 0 if kind == "rice" else b.choice((1, 2, 2))]:
        lo, hi = (-0.9 * a - long, -wide, max(z0, z1 - 0.3 * a)), (-0.9 * a, wide, z1)
        rounded(b, key, lo, hi, 0.4 * wide, "z", "dark", "handle")


def air_fryer(b: Builder) -> None:
    """A rounded or square body with one or two drawer baskets; a dial or a panel, often still."""
    a, c, h = b.uniform(0.12, 0.2), b.uniform(0.11, 0.2), b.uniform(0.22, 0.4)
    kind, power = b.choice(("round", "round", "box", "twin")), b.uniform(2.0, 3.2)
    c, power = c * (1.6 if kind == "twin" else 1), power + 4 * (kind != "round")
    g, turns = _start(b, "dark white plastic steel dark", 2 * a, 2 * c, h), b.chance(0.4)
    half, z0, r, oval = (0.55 if power < 4 else 0.8) * c, 0.06 * h, 0.016, _oval(a, c, power)
    z1, back, dome = b.uniform(0.4, 0.65) * h, 0.6 * a, b.uniform(0.4, 0.9)
    _body(b, "base", oval, ((0, 0.88), (z0, 1)))
    profile(b, "base", np.r_[_oval(a, c, power, half), [(back, half), (back, -half)]], z0, z1)
    top = z1 + b.uniform(0.3, 0.6) * (h - z1)
    _body(b, "base", oval, ((z1, 1), (top, 0.98), ((h + top) / 2, 0.5 + dome / 2), (h, dome)))
    long, reach, grip = b.uniform(0.35, 0.6) * (z1 - z0), b.uniform(0.05, 0.1), b.integer(0, 3)
    edges, travel = (-half, 0.0, half)[:: 1 if kind == "twin" else 2], b.uniform(0.5, 0.95)
    for y0, y1 in pairwise(edges):
        key, y = part(b, "drawer"), np.linspace(y0 + g, y1 - g, 13)
        x = -a * (1 - np.abs(y / c) ** power) ** (1 / power)  # its front is cut out of the body
        x0 = float(x.max()) + 0.012
        front = np.r_[np.c_[x, y], [(x0, y[-1]), (x0, y[0])]]
        profile(b, key, front, z0 + g, z1 - g, material="front")
        tray(b, key, (x0, y[0], z0 + 2 * g), (back - g, y[-1], z1 - 0.02), 0.004, material="dark")
        at = np.array([x[6] + 0.002, y[6], z1 - 0.3 * (z1 - z0)])
        if grip < 2:  # a pistol grip
            b.block(key, at - (reach / 2, 0, 0), (reach + 0.02, 2 * r, 2 * r), "trim")
            ends = at - (reach + r, r, long), at + (r - reach, r, r)
            rounded(b, key, *ends, 0.8 * r, b.choice(("y", "z")), "dark", "handle")
        else:
            b.handle(key, at, FRONT, (Y, UP)[grip - 2], long, "bar")
        b.slide(key, "base", FRONT, 0.0, travel * (back + a))
    if b.chance(0.5):
        _controls(b, -a, 0.8 * c, z1 + 0.01, top - z1 - 0.01)
    else:
        _knob(b, (-a, 0, (z1 + top) / 2), FRONT, min(0.4 * (top - z1), 0.04), 0.02, turns)
    if b.chance(0.5):
        _knob(b, (0, 0, h), UP, 0.3 * dome * min(a, c), 0.02, turns and b.chance(0.5))


def stand_mixer(b: Builder) -> None:
    """A mixer on a foot: its head tilts with the whisk, or the bowl goes up and down."""
    k, lift, s, n = b.uniform(0.7, 1.3), b.chance(0.35), b.choice((-1, 1)), b.choice((1, 3))
    rb, hb, long = b.uniform(0.08, 0.12) * k, b.uniform(0.1, 0.16) * k, b.uniform(0.2, 0.27) * k
    rh, t, cd = b.uniform(0.045, 0.07) * k, b.uniform(0.02, 0.04) * k, b.uniform(0.04, 0.06) * k
    travel, wide = b.uniform(0.04, 0.08) * k * lift, b.uniform(0.75, 1) * rb
    top, p = t + travel + 0.001 + hb, _oval(1, 1, b.uniform(2.0, 5.0))
    zt, foot, far = top + 0.035 * k, b.uniform(0, 1) * rb, cd + long + b.uniform(0.4, 0.9) * rb
    g = _start(b, "paint plastic steel dark white", 2 * long, 2 * rb, zt + 2 * rh)
    rounded(b, "base", (-long - foot, -wide, 0), (1.2 * cd, wide, t), b.uniform(0.3, 0.95) * wide)
    b.cylinder("base", (-long, 0, 0), (-long, 0, t), 1.02 * rb)
    _body(b, "base", p, ((t, 1.1 * cd, 0.8 * wide), (zt, cd, 0.8 * rh)))
    head, neck, low = "base" if lift else part(b, "head"), b.uniform(0.6, 1), zt + g * (not lift)
    zc, end = low + rh, zt - 0.015 * k
    with b.facing((cd, 0, zc), FRONT, UP):
        rows = ((0, 0.8, 0.7), (0.5 * cd, 1, 0.95), (far - 0.2 * rh, 0.8, neck), (far, 0.5, 0.5))
        _body(b, head, p * rh, rows)
    b.box(head, (-0.9 * cd, -0.6 * rh, low), (cd, 0.6 * rh, zc), "body")
    b.cylinder(head, (-long, 0, end), (-long, 0, zc), 0.35 * rh, None, "metal")
    dial(b, head, (cd - far, 0, zc), FRONT, 0.4 * rh, 0.02 * k)
    _knob(b, (-0.2 * long, s * 0.9 * rh, zc), (0, s, 0), 0.25 * rh, 0.02, b.chance(0.3), head)
    tool, bowl = part(b, "whisk") if b.chance(0.35) else head, part(b, "bowl") if lift else "base"
    end -= g if tool != head else -0.004
    high = end - top + (0.75 * hb if lift else min(0.75 * hb, 0.4 * rb * long / (zt - t)))
    b.cylinder(tool, (-long, 0, end - 0.4 * high), (-long, 0, end), 0.008, None, "metal")
    u = np.linspace(0, np.pi, 13)
    path = np.c_[0.45 * rb * np.cos(u), 0 * u, 0.008 - 0.65 * high * np.sin(u) ** 0.7]
    for i in range(n):
        with b.moved((-long, 0, end - 0.35 * high), UP, i * TAU / 6):
            b.sweep(tool, path, 0.009 / (n + 0.5), "metal", loop=n == 1)
    if tool != head:
        b.spin(tool, head, (-long, 0, zt), UP)
    with b.moved((-long, 0, top - hb)):
        sides = ((0.5 * rb, 0), (0.88 * rb, 0.3 * hb), (0.98 * rb, 0.75 * hb), (rb, hb))
        b.vessel(bowl, sides, 0.004, b.choice(("metal", "glass", "light")))
    if lift:
        x, z, y = -1.1 * cd - g, top - 0.2 * hb, 1.07 * rb
        b.box(bowl, (x - 0.02 * k, -1.1 * rb, z - 0.015), (x, 1.1 * rb, z + 0.015), "body")
        for q in (-y, y):
            bar(b, bowl, (x, q, z), (-long - 0.2 * rb, q, z), 0.02, 0.03)
        b.slide(bowl, "base", DOWN, 0.0, travel)
    else:
        b.hinge(head, "base", (cd, 0, zt + g / 2), Y, 0.0, b.uniform(0.5, 0.9), opens=UP)


def bread_box(b: Builder) -> None:
    """A bread box with a roll front, a flap in front that drops or lifts, or a lid."""
    kind, r, t = b.choice(("roll", "drop", "hang", "lid")), b.uniform(0.1, 0.18), 0.01
    w, foot, h = r * b.uniform(1.8, 4.0), b.uniform(0.01, 0.1) * r, r * b.uniform(1.1, 1.9)
    g, lid = _start(b, "wood wood steel white paint", 2 * r, w, 2 * r), part(b, "door")
    y, z, top = w / 2 - t, foot + t, b.uniform(-0.6, 0.3) * r
    side, grip = np.array([(-r, foot), (top, h)]), b.choice(("knob", "bar"))
    if kind == "roll":
        u, top, h = np.linspace(np.pi, np.pi / 2, 9), 0.0, z + r
        side = np.c_[r * np.cos(u), z + r * np.sin(u)]
        out, n = r - t - g, np.array((-0.97, 0, 0.25))
        for span in pairwise(np.linspace(1.76, np.pi, b.integer(4, 11))):
            rim = np.c_[np.cos(span), np.sin(span)]
            slat = np.r_[out * rim, (out - t) * rim[::-1]] + (0, z)
            profile(b, lid, slat, -y + g, y - g, "y", "front")
        for s, at in ((-1, g - y), (1, y - g - 0.006)):  # its cheeks turn on pins
            fan = np.r_[[(0, z)], 0.98 * out * np.c_[np.cos(u), np.sin(u)][:7] + (0, z)]
            profile(b, lid, fan, at, at + 0.006, "y", "front")
            pin, tip = (0, s * (y - 0.006 - g), z), (0, s * (y - 2e-4), z)
            b.cylinder(lid, pin, tip, 0.008, None, "metal")
        b.handle(lid, 0.99 * out * n + (0, 0, z), n, Y, 0.25 * w, grip)
        b.hinge(lid, "base", (0, 0, z), Y, 0, b.uniform(0.6, 0.95), opens=UP)
    elif kind == "lid":
        b.shell("base", (-r, -w / 2, 0), (r, w / 2, h), t, "+z")
        _vault(b, lid, r, h + g, b.uniform(0.15, 0.7) * r, w, t)
        b.hinge(lid, "base", (r + 0.003, 0, h + g / 2), Y, 0, b.uniform(1.1, 1.5), opens=UP)
    else:
        v, hang = np.array([top + r, 0, h - foot]) / np.hypot(top + r, h - foot), kind == "hang"
        n = np.array([-v[2], 0, v[0]])
        p, q = np.array((-r, 0, foot)) + g * n, np.array((top, 0, h)) + g * n
        bar(b, lid, p + t / 2 * n, q + t / 2 * n, w, t, n, "front")
        b.handle(lid, p + t * n + (0.2 if hang else 0.8) * (q - p), n, Y, 0.4 * w, grip)
        far, edge = (1.2, q) if hang else (0.95 * np.arctan2(v[2], -v[0]), p + t * n)
        b.hinge(lid, "base", edge, Y, 0, b.uniform(0.7, 1) * far, opens=UP if hang else FRONT)
    if kind != "lid":
        for end in (-w / 2, y):
            profile(b, "base", np.r_[side, [(r, h), (r, 0), (-r, 0)]], end, end + t, "y")
            b.block("base", (0.5 * r, end + t / 2, 0.6 * h), (0.3 * r, t + 0.004, 0.1 * r), "dark")
        for x0, x1, z0, z1 in ((-r, r, 0, foot), (r - t, r, foot, h), (top, r - t, h - t, h)):
            b.box("base", (x0, -y, z0), (x1, y, z1))


def wood_stove(b: Builder) -> None:
    """A stove, fireplace or pizza oven: a door in a thick body, a flue, often an ash drawer."""
    kind, a, c = b.choice(("box", "pizza", "hearth")), b.uniform(0.15, 0.3), b.uniform(0.18, 0.4)
    h, low, t, s = b.uniform(0.4, 0.9), b.uniform(0.06, 0.3), 0.04, b.choice((-1, 1))
    wide, half = b.uniform(0.2, 0.5) * (kind == "hearth"), b.uniform(0.5, 0.8) * c
    g = _start(b, "dark dark steel paint", 2 * a, 2 * (c + wide), h + 0.4)
    z0, z1, top, ash, y = low + 0.25 * h, low + 0.85 * h, low + h, low + 0.03, half + 0.02
    b.shell("base", (t - a, -c, low), (a, c, top), t, "-x")
    lo, hi = (-a, -c - wide, 0 if wide else low), (t - a, c + wide, top + wide)
    pierced(b, "base", lo, hi, [(-half, z0, half, z1), (-half, ash, half, z0 - 0.04)], "x")
    if wide:  # mantel and hearth
        b.box("base", (-a - 0.1, -c - wide, top + wide), (t, c + wide, top + wide + 0.06), "stone")
        b.box("base", (-a - 0.3, -c - wide, 0), (a, c + wide, 0.5 * low), "stone")
    elif kind == "pizza":
        u = np.linspace(0, np.pi, 13)
        profile(b, "base", np.c_[c * np.cos(u), top + 0.5 * c * np.sin(u)], -a, a, "x")
    else:
        b.box("base", (-a - 0.02, -c - 0.02, top), (a + 0.02, c + 0.02, top + 0.02), "metal")
    _drawer(b, (-a - 0.01, g - half, ash + g), (0, half - g, z0 - 0.04 - g), b.chance(0.5))
    b.feet("base", (-a, -c), (a, c), low, b.choice(("square", "round", "plinth")), "metal")
    x, z = -a - g - 0.025, (z0 + z1) / 2
    door = _door(b, (x, -y, z0), (x + 0.025, y, z1 + 0.02), s, b.uniform(1.2, 1.9))
    for q in (z0 + 0.08 * h, z1 - 0.08 * h):
        b.cylinder(door, (x, s * y, q - 0.03), (x, s * y, q + 0.03), 0.009, None, "metal")
    if b.chance(0.5):  # a latch that turns
        grip, knob = part(b, "handle"), np.array((x, -s * 0.93 * y, z))
        b.cylinder(grip, knob - (0.03, 0, 0), knob - (g, 0, 0), 0.006, None, "metal", "handle")
        b.block(grip, knob - (0.03, -0.02 * s, 0.04), (0.012, 0.014, 0.1), "wood", "handle")
        b.spin(grip, door, knob, (s, 0, 0), 0.0, 1.4)
    x, z, p = 0.3 * a, top + b.uniform(0.3, 0.8), b.uniform(0.05, 0.08)
    for r, end in ((p, z), (1.15 * p, top + 0.06 + 0.4 * c * (kind == "pizza"))):
        b.cylinder("base", (x, 0, top), (x, 0, end), r, None, "metal")
    _knob(b, (x - p, 0, z - 0.07), FRONT, 0.03, 0.05, b.chance(0.3))


def juice_press(b: Builder) -> None:
    """A lever press with a plunger or a lever espresso machine with its portafilter."""
    espresso, turns, r, h = b.chance(0.5), b.chance(0.6), b.uniform(0.03, 0.07), b.uniform(0.2, 0.4)
    g, xc, wide = _start(b, "steel dark wood", 4 * r, 3 * r, h), b.uniform(1.4, 2.2) * r, 0.4 * r
    key, x, z = part(b, "plunger") if turns else "base", 0.0 if espresso else xc, 0.62 * h - g
    rounded(b, "base", (-1.4 * r, -1.4 * r, 0), (xc + r, 1.4 * r, 0.06 * h), b.uniform(0, 1.3) * r)
    for y in (-wide - 0.1 * r, wide + 0.1 * r):
        b.block("base", (x, y, 0.85 * h), (0.6 * r, 0.2 * r, 0.3 * h + 0.4 * r), "body")
    b.box("base", (xc - wide, -wide, 0), (xc + wide, wide, h - 0.45 * r), "body")
    if espresso:
        near, tall = max(xc - r, 0.75 * r + g), b.uniform(0.75, 1.1) * h
        b.box("base", (near, -r, 0), (xc + r, r, tall), "body")
        b.box("base", (-0.9 * r, -0.7 * r, 0.62 * h), (xc, 0.7 * r, h - 0.45 * r), b.choice(METALS))
        b.cylinder(key, (0, 0, z - 0.5 * r), (0, 0, z), 0.7 * r, None, "metal")
        p, q = (0, 0, z - 0.3 * r), (-b.uniform(2, 3.5) * r, 0, z - 0.35 * r)
        b.cylinder(key, p, q, 0.2 * r, None, "dark", "handle")
        _knob(b, (xc, r, 0.5 * h), Y, 0.3 * r, 0.3 * r, b.chance(0.3))
    else:
        b.box("base", (0.8 * r, -0.25 * r, 0.68 * h), (xc, 0.25 * r, 0.72 * h), "body")
        lo, hi = (-0.8 * r, -0.8 * r, 0.68 * h), (0.8 * r, 0.8 * r, 0.72 * h)
        bored(b, "base", lo, hi, "z", (0, 0), 0.12 * r + g)
        with b.moved((0, 0, 0.22 * h)):
            b.vessel("base", [(0.3 * r, 0), (1.1 * r, 0.1 * h), (r, 0.16 * h)], 0.004, "metal")
            b.lathe("base", [(0.3 * r, 0.003), (0.5 * r, 0.1 * h), (0.1 * r, 0.2 * h)], "light")
        b.box("base", (r, -0.2 * r, 0.3 * h), (xc, 0.2 * r, 0.34 * h), "body")
        b.cylinder(key, (0, 0, 0.58 * h), (0, 0, h - 0.6 * r), 0.12 * r, None, "metal")
        b.lathe(key, [(0.95 * r, 0.5 * h), (0.8 * r, 0.54 * h), (0.3 * r, 0.6 * h)], "metal")
    if turns and espresso:
        b.spin(key, "base", (0, 0, z), UP, 0, 0.8)
    elif turns:
        b.slide(key, "base", DOWN, 0.0, 0.07 * h)
    arm, up, o = part(b, "lever"), b.uniform(0.3, 1.2), np.array([x, 0, h])
    e = np.array([-np.cos(up), 0, np.sin(up)]) * b.uniform(3, 6) * r
    b.cylinder(arm, o - (0, wide - g, 0), o + (0, wide - g, 0), 0.25 * r, None, "metal")
    bar(b, arm, o, o + e, 0.3 * r, 0.2 * r, Y, "metal")
    b.cylinder(arm, o + 0.7 * e, o + e, 0.25 * r, None, "dark", "handle")
    b.hinge(arm, "base", o, Y, 0.0, up, opens=DOWN, tip=o + e)


def cooktop_oven(b: Builder) -> None:
    """A range: a flap, a storage drawer, knobs, still burners, sometimes a cover of the top."""
    w, d, h = b.uniform(0.45, 1.1), b.uniform(0.5, 0.7), b.uniform(0.8, 0.95)
    g, td, z, t = _start(b, "steel white dark paint", d, w, h), 0.04, b.uniform(0.02, 0.12), 0.02
    back, turns, y, tall = b.chance(0.6), b.chance(0.33), w / 2, b.uniform(0.1, 0.2)
    b.shell("base", (0, -y, z), (d, y, h), t, "-x")
    b.feet("base", (0, -y), (d, y), z, b.choice(("square", "round", "plinth")), "dark")
    if b.chance(0.7):
        top = z + b.uniform(0.12, 0.25)
        _drawer(b, (-td, g - y, z + g), (0.9 * d, y - g, top - g), b.chance(0.8), t + 0.003)
        z = top
    rear = back and b.chance(0.5)  # the knobs are on the back panel
    high = h - (0.02 if rear else b.uniform(0.07, 0.13))
    mid, cut, cells = z + b.uniform(0.4, 0.7) * (high - z), 0.1 * w, [(-y, y, z, high)]
    if w > 0.8 and b.chance(0.6):
        cells = [(-y, cut, z, high), (cut, y, z, high)]
    elif b.chance(0.3):
        cells = [(-y, y, z, mid), (-y, y, mid, high)]
    for y0, y1, lo, hi in cells:
        s, far, e = 1 if y1 - y0 < 0.5 * w else 0, b.uniform(1.3, 1.57), g + 0.005  # e: to swing
        b.box("base", (-td, y0 + g, lo), (t, y1 - g, lo + 0.012), "trim")
        if s:
            b.box("base", (-td, y, lo), (t, y + 0.006, hi), "trim")
        _door(b, (-td, y0 + (e if s else g), lo + 0.012 + g), (-g, y1 - g, hi - e), s, far)
        _grate(b, (t, y0 + t, 0.5 * (lo + hi)), (d - t, y1 - t), 12)
    b.box("base", (-td, -y, high), (0.05, y, h), b.choice(METALS))
    if back:
        b.box("base", (d - 0.06, -y, h), (d, y, h + tall), b.choice(METALS))
        b.block("base", (d - 0.06, 0, h + 0.8 * tall), (0.006, 0.3 * w, 0.2 * tall), "screen")
    x, zk = (d - 0.06, h + 0.35 * tall) if rear else (-td, (h + high) / 2)
    for q in np.linspace(-0.43, 0.43, 2 * b.integer(1, 4)) * w:
        _knob(b, (x, q, zk), FRONT, 0.024, 0.03, turns)
    b.box("base", (-td, -y, h), (d - 0.06 * back, y, h + 0.012), b.choice(("dark", "metal")))
    gas, h, r = b.integer(0, 1), h + 0.012, b.uniform(0.05, 0.08) * min(w / 0.6, 1)
    for q in np.linspace(-0.3, 0.3, 2 if w < 0.75 else 3) * w:
        for x in (0.25 * d, 0.65 * d):
            b.disc("base", (x, q, h), UP, r, 0.004 + 0.01 * gas, "dark", "decor")
            if gas:
                _grate(b, (x - 1.5 * r, q - 1.4 * r, h + 0.014), (x + 1.5 * r, q + 1.4 * r), 3)
    if not back and b.chance(0.5):
        lid = part(b, "lid")
        b.panel(lid, (0.02, 0.01 - y, h + 0.04), (d - 0.02, y - 0.01, h + 0.05), "glass")
        b.block("base", (d - 0.01, 0, h + 0.02), (0.02, 0.7 * w, 0.04 - g), "metal")
        b.hinge(lid, "base", (d - 0.01, 0, h + 0.045), Y, 0.0, b.uniform(1.4, 1.57), opens=UP)


CATEGORIES: dict[str, Callable[[Builder], None]] = {
    "barbecue": barbecue, "rice_cooker": rice_cooker, "air_fryer": air_fryer,
    "stand_mixer": stand_mixer, "bread_box": bread_box, "wood_stove": wood_stove,
    "juice_press": juice_press, "cooktop_oven": cooktop_oven,
}  # fmt: skip
