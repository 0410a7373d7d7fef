"""Parks and halls: carousels, pumps, wells, cannons, pianos, arcade machines, cages, bins."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import ArrayLike

from mam_world.kit import Builder
from mam_world.mech import rod, studs, wheel
from mam_world.solids import TAU, arc, bar, bored, part, pierced, profile, settle, tray


def _turns(b: Builder, n: int, at: ArrayLike = (0, 0, 0), axis: ArrayLike = (0, 0, 1)) -> Iterator:
    for k in range(n):
        with b.moved(at, axis, TAU * k / n):
            yield k


def _big_wheel(b: Builder) -> None:
    r, water = b.uniform(0.3, 2.5), b.chance(0.45)
    w, links = r * b.uniform(0.15, 0.35), not water and b.chance(0.3)
    b.size(2.5 * w, 2 * r, 2.4 * r)
    n = b.integer(8, 14) if water else b.integer(3, 4) if links else b.integer(5, 9)
    c, g, t = min(0.4 * np.sin(np.pi / n), 0.22) * r, max(b.gap, 0.004 * r), 0.02 * r
    z, x, key = 1.12 * r + 2.1 * c, w + g + 0.05 * r, part(b, "rotor", "wheel")
    lean, m, legs = b.uniform(0, 0.5), 0.7 * w, b.choice(((0,), (-0.6, 0.6), (-0.8, 0.5)))
    for s in (-1, 1):
        mid = s * (x + 0.04 * r)
        b.block("base", (mid, 0, z), (0.08 * r, 0.2 * r, 0.2 * r), "trim")
        for q in legs:
            rod(b, "base", (mid, q * r, 0), (mid, 0, z), 0.04 * r, "body")
        for ring in (1.0, 0.6):
            b.torus(key, (s * w, 0, z), (1, 0, 0), ring * r, t, "metal")
        for _ in _turns(b, n, (0, 0, z), (1, 0, 0)):
            rod(b, key, (s * w, 0, 0), (s * w, 0, r), 0.7 * t, "body")
    rod(b, key, (-x - 0.06 * r, 0, z), (x + 0.06 * r, 0, z), 0.05 * r)
    b.box("base", (-x - 0.2 * r, -0.75 * r, 0), (x + 0.2 * r, 0.75 * r, 0.05 * r), "stone")
    for k in range(n):
        if water:
            with b.moved((0, 0, z), (1, 0, 0), TAU * k / n), b.moved((0, 0, r), (1, 0, 0), lean):
                b.box(key, (-w, -0.02 * r, -0.3 * r), (w, 0.02 * r, 0.04 * r), "wood")
            continue
        p = (0, r * np.sin(TAU * k / n), z + r * np.cos(TAU * k / n))
        to = part(b, "cabin") if links else key
        with b.moved(p):
            rod(b, key, (-w, 0, 0), (w, 0, 0), 0.8 * t)
            for q in (-m, m):
                rod(b, to, (q, 0, -1.2 * c), (q, 0, 0.5 * t), 0.6 * t)
            tray(b, to, (-m, -c, -1.7 * c), (m, c, -1.0 * c), 0.06 * c, "z", 1, "accent")
            b.box(to, (-m, -c, -0.5 * c), (m, c, -0.4 * c), "accent")
        if links:
            b.spin(to, key, p, (1, 0, 0))
    b.spin(key, "base", (0, 0, z), (1, 0, 0))
    settle(b)


def merry_go_round(b: Builder) -> None:
    """A rotor on a still stand: carousel, roundabout, Ferris wheel or water wheel."""
    b.theme()
    if b.chance(0.5):
        _big_wheel(b)
        return
    r, play = b.uniform(0.5, 2.5), b.chance(0.5)
    h = r * (b.uniform(0.35, 0.9) if play else b.uniform(0.8, 1.7))
    b.size(2 * r, 2 * r, h if play else 1.4 * h)
    g, foot, n = max(b.gap, 0.003 * r), b.uniform(0.03, 0.15) * h, b.integer(3, 8)
    z, post, still = foot + g + 0.05 * h, b.uniform(0.06, 0.2) * r, b.chance(0.5)
    key, out = part(b, "rotor", "platform"), b.uniform(0.4, 1.15) * r
    rod(b, "base", (0, 0, 0), (0, 0, foot), out, "stone")
    b.tube(key, (0, 0, foot + g), (0, 0, z), r, post + g, b.choice(("body", "wood", "metal")))
    who, low, wide = ("base", foot, post) if still else (key, foot + g, post + 1.2 * g)
    cover = who if b.chance(0.5) else key
    high = h - (0 if who == cover else g)
    rod(b, who, (0, 0, low), (0, 0, high), wide, "trim")
    top, peak = z + b.uniform(0.4, 0.95) * (h - z), h + b.uniform(0.2, 0.6) * r
    if play:
        b.torus(who, (0, 0, high), (0, 0, 1), 2 * post, 0.25 * post, "metal")
        rod(b, who, (0, 0, high - 0.2 * post), (0, 0, high), 2 * post, "accent")
    else:
        roof = [(1.08 * r, h), (1.08 * r, 1.08 * h), (0.5 * r, (h + peak) / 2 + 0.08 * h)]
        b.lathe(cover, [*roof, (0.04 * r, peak + 0.1 * h)], "front")
    for _ in _turns(b, n):
        if play:
            path = [(0.5 * r, 0, z), (0.55 * r, 0, top), (0.9 * r, 0, top), (0.93 * r, 0, z)]
            b.sweep(key, path, 0.018 * r, "metal", "handle")
            b.box(key, (0.6 * r, -0.5 * r / n, z), (0.8 * r, 0.5 * r / n, z + 0.3 * h), "wood")
            continue
        rod(b, key, (0.75 * r, 0, z), (0.75 * r, 0, h - (g if cover == "base" else 0)), 0.01 * r)
        b.block(cover, (1.09 * r, 0, h), (0.02 * r, 2 * r / n, 0.12 * h), "accent", "decor")
        s = min(0.3 * r, 0.3 * h, 1.2 * r / n)
        with b.moved((0.75 * r, 0, z + 0.3 * h)):  # a horse
            for y, x in ((-0.4, 0.1), (0.35, 0.1), (-0.4, -0.1), (0.35, -0.1)):
                rod(b, key, (x * s, y * s, -0.5 * s), (x * s, y * s, 0), 0.05 * s, "light")
            rod(b, key, (0, -0.5 * s, 0), (0, 0.5 * s, 0), 0.17 * s, "light")
            b.sweep(key, np.array([(0, 0.4, 0), (0, 0.6, 0.5), (0, 0.85, 0.35)]) * s, 0.09 * s)
    b.spin(key, "base", (0, 0, foot), (0, 0, 1))


def _signal(b: Builder) -> None:
    h, s, up = b.uniform(0.5, 3.0), b.choice((-1, 1)), b.choice((-1, 1))
    t, long = 0.03 * h, h * b.uniform(0.22, 0.38)
    b.size(0.1 * h, long, h)
    b.block("base", (0, 0, 0.02 * h), (6 * t, 6 * t, 0.04 * h), "stone")
    b.box("base", (-t, -t, 0), (t, t, h), "body")
    for y in (-1.2 * t, 1.2 * t) if b.chance(0.7) else ():  # a ladder
        rod(b, "base", (5 * t, y, 0), (1.1 * t, y, 0.8 * h), 0.25 * t)
        for k in np.linspace(0.1, 0.9, 7):
            b.block("base", ((5 - 3.9 * k) * t, y / 2, 0.8 * h * k), (0.3 * t, 1.4 * t, 0.3 * t))
    x, far = -1.5 * t - max(b.gap, 0.002 * h), b.uniform(0.35, 0.6)
    for z in (0.9 * h, 0.6 * h)[: b.integer(1, 2)]:
        key, rest = part(b, "arm", "signal"), b.choice((0.0, 0.0, far))
        rod(b, key, (0, 0, z), (x - 0.6 * t, 0, z), 0.7 * t)
        b.block(key, (x, s * 0.44 * long, z), (0.8 * t, 1.12 * long, 2 * t), "red")
        b.block(key, (x - 0.1 * t, s * 0.8 * long, z), (0.8 * t, t, 2.1 * t), "light")
        for dz in (-1.3 * t, 1.3 * t):
            at = (x - 0.4 * t, -s * 4 * t, z + dz)
            b.disc(key, at, (1, 0, 0), 1.4 * t, 0.8 * t, "glass")
        b.hinge(key, "base", (x, 0, z), (1, 0, 0), 0, far, opens=(0, 0, up), rest=rest)
    settle(b)


def water_pump(b: Builder) -> None:
    """A long lever or arm that swings on a post: hand pump or semaphore."""
    b.theme()
    if b.chance(0.5):
        _signal(b)
        return
    h, r, drop = b.uniform(0.3, 1.3), b.uniform(0.05, 0.1), b.uniform(0.2, 1.1)
    b.size(0.8 * h, 2 * r * h, 1.2 * h)
    g, r, z, top, bulge = max(b.gap, 0.002 * h), r * h, 0.85 * h, 0.62 * h, b.uniform(1.0, 1.7)
    rod(b, "base", (0, 0, 0), (0, 0, 0.04 * h), 2.2 * r, "trim")
    studs(b, [(x * r, y * r, 0.04 * h) for x in (-1.3, 1.3) for y in (-1, 1)], (0, 0, 1), 0.25 * r)
    b.lathe("base", [(r, 0), (0.9 * r, 0.4 * h), (bulge * r, 0.5 * h), (bulge * r, top)])
    b.lathe("base", [(1.3 * bulge * r, top), (1.2 * bulge * r, top + 0.2 * r), (0.3 * r, top + r)])
    out, low = b.uniform(0.2, 0.4) * h, b.uniform(0.3, 0.48) * h
    b.sweep("base", [(0, 0, 0.6 * h), (-0.7 * out, 0, 0.6 * h), (-out, 0, low)], 0.45 * r, "body")
    px, key, long = bulge * r * b.uniform(1.0, 1.6), part(b, "handle", "lever"), b.uniform(0.4, 0.8)
    for y in (-0.7 * r, 0.7 * r):
        rod(b, "base", (0.5 * px, y, top), (px, y, z), 0.2 * r, "trim")
    end = np.array([px + long * h * np.cos(drop), 0, z - long * h * np.sin(drop)])
    rod(b, key, (px, -0.7 * r, z), (px, 0.7 * r, z), 0.2 * r)
    bar(b, key, (-0.2 * r, 0, z + 0.1 * r), (px, 0, z), r - 2 * min(g, 0.2 * r), 0.35 * r)
    bend = np.array([px + 0.4 * long * h, 0, z - 0.1 * long * h * drop])
    b.sweep(key, np.array([(px, 0, z), bend, end]), 0.2 * r, "body", "handle")
    b.cylinder(key, end - (end - bend) * 0.3, end, 0.32 * r, None, "wood", "handle")
    far = min(b.uniform(0.4, 1.0) + 0.3 * drop, 0.8 * (z - top - r) / (px + 0.2 * r))
    b.hinge(key, "base", (px, 0, z), (0, 1, 0), 0.0, far, opens=(0, 0, 1), tip=end)


def wishing_well(b: Builder) -> None:
    """A drum or a wheel with a crank: a well with roof and bucket, a grindstone."""
    well, h = b.chance(0.6), b.uniform(0.4, 2.2)
    r, low = h * b.uniform(0.2, 0.35), h * b.uniform(0.25, 0.4)
    b.size(2 * r, 2.4 * r, 1.2 * h)
    b.theme(b.choice(("wood", "wood", "paint", "white")))
    g, t, z, a = max(b.gap, 0.003 * h), 0.03 * h, 0.68 * h, 0.02 * h
    w, tall = (0.9 * r, h) if well else (h * b.uniform(0.12, 0.35), z + 3 * t)
    key, side, thick = part(b, "drum", "roller"), b.choice((-1, 1)), b.uniform(0.05, 0.09) * h
    out = w + 2 * t + b.uniform(0.03, 0.1) * h
    rod(b, key, (0, -side * (w + 2.5 * t), z), (0, side * out, z), a)
    p = np.array([0, side * (out - a), z])
    q = p + np.array(b.choice(((0, 0, -1), (0, 0, 1), (-0.8, 0, -0.6)))) * b.uniform(0.1, 0.2) * h
    bar(b, key, p, q, 2.4 * a, 1.4 * a, (0, 1, 0), "metal")
    b.cylinder(key, q, q + np.array([0, side * 0.12, 0]) * h, 1.3 * a, None, "wood", "handle")
    for s in (-1, 1):
        y = sorted((s * w, s * (w + 2 * t)))
        bored(b, "base", (-t, y[0], 0), (t, y[1], tall), "y", (0, z), 1.2 * a)
        if not well:
            b.block("base", (0, s * (w + t), t), (2 * r, 2 * t, 2 * t), "body")
            rod(b, "base", (0.8 * r, s * (w + t), t), (t, s * (w + t), 0.5 * h), 0.7 * t, "body")
    b.spin(key, "base", (0, 0, z), (0, 1, 0))
    if not well:
        big = b.uniform(0.25, 0.5) * h
        b.box("base", (1.1 * big, -w, 0), (1.1 * big + 3 * t, w + 2 * t, 0.8 * z), "trim")
        wheel(b, key, (0, 0, z), (0, 1, 0), big, min(0.3 * big, w - g), b.choice(("cast", "disc")))
        return
    rod(b, key, (0, -0.75 * w, z), (0, 0.75 * w, z), thick, "wood")
    for k in range(b.integer(0, 5)):
        b.torus(key, (0, 1.8 * (k - 2) * a, z), (0, 1, 0), thick, 0.8 * a, "fabric")
    b.tube("base", (0, 0, 0), (0, 0, low), 0.95 * r, 0.82 * r, "stone")
    for _ in _turns(b, b.choice((0, 9, 12))):
        b.block("base", (0.95 * r, 0, low / 2), (0.2 * r, b.uniform(0.2, 0.5) * r, low), "stone")
    b.tube("base", (0, 0, low), (0, 0, low + t), 1.12 * r, 0.78 * r, b.choice(("wood", "stone")))
    b.lathe("base", [(1.5 * r, 0.97 * h), (0.05 * r, 1.35 * h)], "red", sides=b.choice((4, 8, 30)))
    pail, rim, deep = part(b, "bucket") if b.chance(0.6) else "base", 0.22 * r, 0.45 * r
    x = rim + a + g  # the bucket goes down along a pipe
    rod(b, "base", (x, 0, 0), (x, 0, low + 1.5 * t + 0.6 * deep), 0.8 * a)
    with b.moved((0, 0, low + 1.5 * t)):
        b.vessel(pail, [(0.8 * rim, 0), (rim, 0.8 * deep)], 0.1 * rim, "wood")
        bow = arc((0, 0, 0.75 * deep), 0.95 * rim, 0, np.pi, 9, "x")
        b.sweep(pail, bow, 0.05 * rim, "metal", "handle")
        b.rod(pail, (0, 0, deep), (0, 0, z - thick - 0.8 * a - g - low - 1.5 * t), 0.4 * a)
    if pail != "base":
        b.slide(pail, "base", (0, 0, -1), 0.0, b.uniform(0.5, 1.0) * (low - t))


def cannon(b: Builder) -> None:
    """A barrel or a lamp that tilts between cheeks; the carriage may turn."""
    gun, long = b.chance(0.65), b.uniform(0.3, 2.0)
    r = long * (b.uniform(0.05, 0.11) if gun else b.uniform(0.2, 0.4))
    b.size(1.4 * long, 5 * r, long)
    b.theme(b.choice(("wood", "dark", "steel", "paint")))
    g, t, up, back = max(b.gap, 0.002 * long), 0.04 * long, b.uniform(0.2, 0.6), 0.42 * long
    z = back * np.sin(up) + 1.3 * r + 4 * t if gun else 1.5 * r + 3 * t
    half, rolling = 1.1 * r + g, gun and b.chance(0.7)
    body = part(b, "carriage", "yoke") if not rolling and b.chance(0.6) else "base"
    key, big = part(b, "barrel"), b.uniform(2.5, 3.9) * t
    rod(b, key, (0, -half - t, z), (0, half + t, z), 0.4 * min(r, t))
    if not rolling:  # a foot, the carriage turns on it
        rod(b, "base", (0, 0, -b.uniform(1, 8) * t), (0, 0, t - g), 0.3 * long, "stone")
        rod(b, body, (0, 0, t), (0, 0, 2 * t), 0.26 * long + half, "trim")
    tail, low, spins = b.uniform(0.4, 1.1) * long, 2 * t, b.choice((0, 0, 1, 2))
    cheek = [(-0.2 * long, low), (tail, low), (tail, low + 2 * t), (0.5 * tail, 0.7 * z)]
    cheek = cheek if gun else [(-t, low), (t, low), (t, z)]
    for s in (-1, 1):
        y = sorted((s * half, s * (half + t)))
        profile(b, body, [*cheek, (t, z + t), (-t, z + t)], y[0], y[1], "y", "wood")
        for k, x in enumerate((0.0, 0.8 * tail) if rolling else ()):
            to, at = part(b, "wheel") if k < spins else "base", (x, s * (half + 2.6 * t + g), 3 * t)
            wheel(b, to, at, (0, 1, 0), big, 2 * t, "cast" if big > 3.2 * t else "disc")
            if to != "base":
                b.spin(to, "base", at, (0, 1, 0))
    for x in (0.0, 0.8 * tail) if gun else ():
        rod(b, body, (x, -half - 2 * t, 3 * t), (x, half + 2 * t, 3 * t), 0.6 * t)
    far, near, deep, m = up, -0.1, b.uniform(0.3, 0.8) * r, b.uniform(0.6, 0.95) * r
    with b.facing((back if gun else 0, 0, z), (-1, 0, 0)):
        if gun:
            side = [(r, 0), (0.95 * r, 0.5 * long), (m, 0.94 * long), (1.2 * m, long)]
            b.vessel(key, side, 0.35 * r, "metal")
            b.sphere(key, (0, 0, -0.3 * r), 0.4 * r, "metal")
        else:
            near, far = -0.4, b.uniform(0.4, 0.9)
            b.lathe(key, [(0.4 * r, -deep), (0.9 * r, -0.5 * deep), (r, 0), (r, deep)], "body")
            b.torus(key, (0, 0, deep), (0, 0, 1), 0.95 * r, 0.06 * r)
            rod(b, key, (0, 0, deep), (0, 0, 1.02 * deep), 0.85 * r, "glass")
            b.handle(key, (0, 0, -deep), (0, 0, -1), (1, 0, 0), 0.5 * r, "bow")
    b.hinge(key, body, (0, 0, z), (0, 1, 0), near, far, closed=0.0)
    if body != "base":
        b.spin(body, "base", (0, 0, t), (0, 0, 1), *b.choice(((-0.5, 0.5), (-3, 3))), closed=0.0)
    settle(b)


def piano_keys(b: Builder) -> None:
    """An upright or a grand: the fallboard or the lid is hinged, or a few keys tip."""
    w, grand, n = b.uniform(0.4, 1.5), b.chance(0.4), b.integer(10, 30)
    h, d = w * b.uniform(0.45, 0.6), w * b.uniform(0.12, 0.18)
    long, top = w * b.uniform(0.8, 1.6) if grand else w * b.uniform(0.15, 0.3), 1.2 * h
    b.size(d + long, w, 1.5 * h)
    b.theme(b.choice(("dark", "wood", "wood", "white", "plastic")))
    g, t, e, dip = max(b.gap, 0.002 * w), 0.02 * w, 0.45 * w, 0.06
    top, zk, back, pitch = top if grand else h * b.uniform(1.4, 2.2), h + 0.4 * t, d + t, 2 * e / n
    b.box("base", (-t, -w / 2, 0.8 * h), (back, w / 2, h - d * dip), "body")
    for s in (-1, 1):
        ends = sorted((s * e, s * w / 2))
        b.box("base", (-t, ends[0], 0.8 * h), (back, ends[1], zk + 3 * t), "body")
        b.cylinder("base", (0.2 * d, s * 0.46 * w, 0), (0.2 * d, s * 0.46 * w, 0.8 * h), 0.6 * t, t)
    moving, rest = b.choice(("lid", "lid", "keys", "fall", "both")), b.choice((0.0, 1.0))
    picks = b.rng.choice(n, b.integer(1, 6), replace=False) if moving == "keys" else ()
    for k in range(n):
        to, y = part(b, "key") if k in picks else "base", -e + k * pitch
        b.box(to, (0, y + 0.04 * pitch, h), (d, y + 0.96 * pitch, zk), "light")
        if k % 7 in (0, 1, 3, 4, 5) and k < n - 1:
            at, sharp = (0.7 * d, y + pitch, zk + 0.2 * t), (0.6 * d, 0.6 * pitch, 0.4 * t)
            b.block("base", at, sharp, "dark")
        if k in picks:
            b.hinge(to, "base", (d, y, zk), (0, 1, 0), 0.0, dip, opens=(0, 0, -1))
    plan = [(0.0, -0.5), (1.0, -0.5), (1.0, 0.5), (0.0, 0.5)]
    if grand:  # the bent side
        bend = [(0.3 + 0.68 * q, 0.3 * (1 - np.cos(np.pi * q)) - 0.5) for q in np.linspace(0, 1, 9)]
        plan = [(0, -0.5), *bend, (1, 0.3), (0.95, 0.5), (0, 0.5)]
        b.block("base", (back + 0.8 * long, 0.3 * w, 0.4 * h), (t, t, 0.8 * h), "body")
    area = np.array(plan) * (long, w) + (back, 0)
    profile(b, "base", area, 0.8 * h if grand else 0.0, top, "z")
    lid = part(b, "lid") if moving in ("lid", "both") else "base"
    z, far = top + (0 if lid == "base" else g), b.uniform(0.5, 0.9)
    profile(b, lid, area, z, z + t, "z", b.choice(("body", "trim")))
    if lid != "base":
        edge, axis = ((0, w / 2, z), (1, 0, 0)) if grand else ((back + long, 0, z), (0, 1, 0))
        b.hinge(lid, "base", edge, axis, 0, far, opens=(0, 0, 1), rest=rest * far)
    if moving in ("fall", "both"):
        fall, z, x = part(b, "fallboard", "lid"), zk + 0.5 * t + g, back - g
        b.box(fall, (-0.1 * d, -e + g, z), (x, e - g, z + 0.6 * t), "body")
        edge, rest = (x, 0, z + 0.6 * t), 1.45 * rest
        b.hinge(fall, "base", edge, (0, 1, 0), 0, 1.45, opens=(0, 0, 1), rest=rest)
    b.block("base", (back + 2 * t, 0, 0.45 * h), (t, 6 * t, 0.9 * h), "body")
    for y in np.arange(b.integer(1, 3)) * 2.5 * t:
        b.block("base", (back, y, 2 * t), (6 * t, 1.2 * t, 0.4 * t), "gold")
    settle(b)


def pinball(b: Builder) -> None:
    """A pinball or arcade machine: a plunger or a stick, buttons, a coin door."""
    table, w, n = b.chance(0.5), b.uniform(0.3, 0.8), b.integer(1, 3)
    h, d = w * b.uniform(1.6, 2.6), w * b.uniform(0.7, 1.1) * (1.8 if table else 1.0)
    b.size(d, w, h)
    b.theme(b.choice(("paint", "dark", "plastic", "wood")))
    g, t, low, e, deck = max(b.gap, 0.003 * w), 0.03 * w, 0.5 * h, w / 2, 0.5 * h + 0.1 * d
    end, face, lo = (0.82 * d, 0.82 * d, 0.65 * h) if table else (0.4 * d, 0.1 * d, 0.9 * h)
    if table:
        case = [(0, 0.65 * low), (d, 0.65 * low), (d, h), (end, h), (end, deck), (0, low)]
        for x, y in ((0, -e), (0, e), (d, -e), (d, e)):
            b.block("base", (x, y, 0.4 * low), (1.6 * t, 1.6 * t, 0.8 * low), "metal")
    else:
        case = [(0.2 * d, 0), (d, 0), (d, h), (0.1 * d, h), (0.1 * d, 0.88 * h)]
        case += [(0.5 * d, 0.66 * h), (end, deck), (0, low), (0, 0.4 * h), (0.2 * d, 0.35 * h)]
    profile(b, "base", case, -e, e, "y")
    b.box("base", (face - 0.3 * t, -0.42 * w, lo), (face, 0.42 * w, 0.97 * h), "screen", "decor")
    coin = part(b, "coin_door", "door") if b.chance(0.5) else "base"
    x = (0.0 if table else 0.2 * d) - (g if coin != "base" else 0.0)
    a, z = (0.7 * low, 0.95 * low) if table else (0.15 * low, 0.6 * low)
    b.box(coin, (x - t, -0.25 * w, a), (x, 0.1 * w, z), "metal")
    b.block(coin, (x - 1.2 * t, -0.07 * w, a + 0.6 * (z - a)), (t, 0.05 * w, 0.4 * t), "red")
    if coin != "base":
        b.hinge(coin, "base", (x - t, 0.1 * w, z), (0, 0, 1), 0, 1.4, opens=(-1, 0, 0))
    key = part(b, "plunger" if table else "lever")
    with b.moved((0, 0, low), (0, 1, 0), -np.arctan2(deck - low, end)):
        x, loose = (0.06 if table else 0.11) * d, b.chance(0.6)
        for k, y in enumerate(np.linspace(-0.38, 0.38, 2 * n) * w):
            if loose and k < 3:
                b.button("base", (x, y, 0), (0, 0, 1), 0.07 * w, 0.07 * w, 0.015 * w, "red")
            else:
                b.disc("base", (x, y, 0), (0, 0, 1), 0.04 * w, 0.03 * w, "red")
        if not table:
            p, top = (0.28 * d, 0, 0.6 * t), (0.28 * d, 0, 5 * t)
            rod(b, key, p, top, 0.5 * t)
            b.sphere(key, top, 1.3 * t, "red")
            b.hinge(key, "base", p, b.choice(((0, 1, 0), (1, 0, 0))), -0.3, 0.3)
    if table:
        y, z = -0.4 * w, 0.82 * low
        far = b.uniform(2, 4) * t
        b.tube("base", (-far - 0.3 * t, y, z), (0, y, z), 1.5 * t, 0.5 * t + g)
        rod(b, key, (-far - 3 * t, y, z), (-0.1 * t, y, z), 0.5 * t)
        b.sphere(key, (-far - 3 * t, y, z), 1.2 * t, "dark")
        b.slide(key, "base", (-1, 0, 0), 0, far)
    settle(b)


def _grill(b: Builder, to: str, low: ArrayLike, high: ArrayLike, n: int, r: float) -> None:
    (x, y0, z0), (_, y1, z1) = np.asarray(low, float), np.asarray(high, float)
    for z in (z0, z1, b.choice((z0, (z0 + z1) / 2))):
        rod(b, to, (x, y0 - r, z), (x, y1 + r, z), 1.2 * r)
    for y in np.linspace(y0, y1, n):
        rod(b, to, (x, y, z0), (x, y, z1), r)


def pet_crate(b: Builder) -> None:
    """A cage, a crate or a hutch: a barred door, a lid, a tray that slides out."""
    hutch, w = b.chance(0.4), b.uniform(0.2, 1.0)
    h, d, r = w * b.uniform(0.6, 1.3), w * b.uniform(0.5, 0.9), 0.008 * w + 0.001
    b.size(d, w, h)
    tall, lid = b.uniform(0.05, 0.12) * h, part(b, "lid") if b.chance(0.4) else "base"
    b.theme("wood" if hutch else b.choice(("steel", "dark", "paint")))
    g, e, foot, n = max(b.gap, 0.002 * w), w / 2, b.uniform(0.0, 0.5) * h, b.integer(6, 14)
    z0, z1, a, c = tall + 2 * g + 1.5 * r, h, b.uniform(-0.9, -0.1) * e, b.uniform(0.1, 0.9) * e
    e0, e1 = z0 + 0.1 * h, z1 - 0.15 * h
    for x, y in ((0, -e), (0, e), (d, -e), (d, e)):
        b.block("base", (x, y, (h - foot) / 2), (3 * r, 3 * r, h + foot), "body")
    pan = part(b, "tray", "drawer") if b.chance(0.5) else "base"
    tray(b, pan, (0.02 * d, -e + 1.6 * r, g), (d - 2 * r, e - 1.6 * r, tall), 0.006 * w)
    b.handle(pan, (0.02 * d, 0, tall / 2), (-1, 0, 0), (0, 1, 0), 0.2 * w, "bow")
    if pan != "base":
        b.slide(pan, "base", (-1, 0, 0), 0, b.uniform(0.4, 0.9) * d)
    if hutch:
        b.shell("base", (0, -e, z0), (d, e, z1), 0.02 * w, "-x", "body")
    _grill(b, "base", (d, -e, z0), (d, e, z1), n, r)
    for s in (-1, 1):
        b.box("base", (0, s * e - r, 0), (d, s * e + r, tall), "body")
        with b.moved((0, s * e, 0), (0, 0, 1), TAU / 4):
            _grill(b, "base", (0, -d, z0), (0, 0, z1), n, r)
    for y0, y1, low, high in ((-e, a, z0, z1), (c, e, z0, z1), (a, c, e1, z1), (a, c, z0, e0)):
        if hutch and y0 != a:
            b.panel("base", (0, y0, low), (r, y1, high), b.choice(("front", "body")))
        _grill(b, "base", (0, y0, low), (0, y1, high), max(2, int(n * (y1 - y0) / w)), r)
    door, x, far = part(b, "door"), -2.6 * r - g, b.uniform(1.2, 2.0)
    _grill(b, door, (x, a, e0), (x, c, e1), max(3, int(n * (c - a) / w)), r)
    b.block(door, (x - r, 0.9 * a + 0.1 * c, (e0 + e1) / 2), (2 * r, 6 * r, 3 * r), "dark")
    guides = b.chance(0.3)
    if guides:
        for y in (a - 3 * r - g, c + 3 * r + g):
            b.box("base", (x - r, y - r, e0), (0, y + r, z1), "metal")
        b.slide(door, "base", (0, 0, 1), 0, b.uniform(0.5, 0.9) * (e1 - e0))
    else:
        b.hinge(door, "base", (x, c + r, e0), (0, 0, 1), 0, far, opens=(-1, 0, 0))
    z, grip = z1 + 1.5 * r + g * (lid != "base"), b.choice(("bow", "knob", "none"))
    b.box(lid, (-1.2 * r, -1.04 * e, z), (d + 2 * r, 1.04 * e, z + 0.04 * w), "trim")
    b.handle(lid, (0.4 * d, 0, z + 0.04 * w), (0, 0, 1), (0, 1, 0), 0.25 * w, grip)
    if lid != "base":
        b.hinge(lid, "base", (d + 2 * r, 0, z), (0, 1, 0), 0, 1.2, opens=(0, 0, 1))
    settle(b)


def park_bin(b: Builder) -> None:
    """A litter bin, a post box or a recycling station with flaps and doors."""
    n, w = b.integer(1, 4), b.uniform(0.25, 0.7)
    h, d, post = w * b.uniform(1.2, 2.6), w * b.uniform(0.7, 1.1), n == 1 and b.chance(0.5)
    b.size(d, n * w, h)
    b.theme(b.choice(("paint", "steel", "dark", "plastic", "wood")))
    g, t, e, far = max(b.gap, 0.003 * w), 0.03 * w, n * w / 2, b.uniform(0.7, 1.4)
    b.shell("base", (0, -e, 0), (d, e, h), t, "-x")
    z0, z1, slot = h * b.uniform(0.55, 0.7), h - 2 * t, b.uniform(0.3, 0.8)
    if b.chance(0.5):
        roof = [(-2 * t, h), (d + t, h), (0.7 * d, h + 0.2 * w), (0.3 * d, h + 0.2 * w)]
        profile(b, "base", roof, -e - t, e + t, "y", "front")
    if b.chance(0.5):
        b.box("base", (0.1 * d, -0.9 * e, -b.uniform(0.1, 0.6) * w), (0.9 * d, 0.9 * e, 0), "trim")
    for k in range(n):
        y, paint = -e + (k + 0.5) * w, ("accent", "red", "green", "light")[k]
        a, low = 0.38 * w, z1 - (4 * t if post else slot * (z1 - z0))
        pierced(b, "base", (0, y - w / 2, z0), (t, y + w / 2, h), [(y - a, low, y + a, z1)], "x")
        if not post or b.chance(0.5):
            flap, pin = part(b, "flap"), z1 - g - 0.4 * t
            b.box(flap, (0.3 * t, y - a + g, low + g), (0.7 * t, y + a - g, pin), paint)
            rod(b, flap, (0.5 * t, y - a + g, pin), (0.5 * t, y + a - g, pin), 0.3 * t)
            b.hinge(flap, "base", (0.5 * t, y, pin), (0, 1, 0), 0, far, opens=(1, 0, 0))
        door = part(b, "door") if post or (n < 3 and b.chance(0.6)) else "base"
        b.box(door, (0, y - w / 2 + t + g, g), (t, y + w / 2 - t - g, z0 - g), "front")
        b.block(door, (-0.3 * t, y + 0.3 * w, 0.8 * z0), (0.6 * t, 2 * t, 3 * t), "metal")
        if door != "base":
            b.hinge(door, "base", (0, y - w / 2 + t + g, 0), (0, 0, 1), 0, far, opens=(-1, 0, 0))
    settle(b)


CATEGORIES: dict[str, Callable[[Builder], None]] = {
    "merry_go_round": merry_go_round, "water_pump": water_pump, "wishing_well": wishing_well,
    "cannon": cannon, "piano_keys": piano_keys, "pinball": pinball, "pet_crate": pet_crate,
    "park_bin": park_bin,
}  # fmt: skip
