"""Things of the workshop, the desk drawer and the changing room: presses, saws, chests, lockers."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from mam_world.fixtures import PAINTS
from mam_world.kit import Builder
from mam_world.mech import studs, wheel
from mam_world.solids import TAU, bar, bored, part, pierced, profile, rounded, settle, tray


def _rod(b: Builder, on: str, at: ArrayLike, by: ArrayLike, r: float, paint: str = "metal") -> None:
    """A round rod that starts at `at` and goes on by `by`."""
    b.cylinder(on, at, np.add(at, by), r, None, paint)


def _crank(b: Builder, link: str, at: ArrayLike, axis: ArrayLike, arm: float, r: float) -> None:
    """A crank whose shaft of radius `r` starts at `at`: arm, pin and grip."""
    wide, long, paint = b.uniform(1.4, 2.6) * r, b.uniform(2, 5), b.choice(PAINTS)
    low, z = b.choice((-arm, -1.7 * r, -1.7 * r)), b.uniform(1.5, 3) * r + b.gap
    with b.facing(at, axis, np.roll(axis, 1)), b.moved((0, 0, 0), (0, 0, 1), b.uniform(0, TAU)):
        _rod(b, link, (0, 0, 0), (0, 0, z + 1.4 * r), r)
        rounded(b, link, (low, -1.4 * r, z), (arm + r, 1.4 * r, z + r), 1.3 * r, "z", "metal")
        _rod(b, link, (arm, 0, z), (0, 0, 3 * r), 0.6 * r)
        with b.moved((arm, 0, z + 2 * r)):
            ball = [(0.5, 0), (0.95, 0.5), (1, 1.0), (0.7, 1.7), (0.3, 2)]
            grip = [(0.8, 0), (b.choice((0.65, 1.0)), 0.3 * long), (1, 0.8 * long), (0.6, long)]
            b.lathe(link, np.array(b.choice((ball, grip))) * wide, paint, "handle")
            b.grasp(link, "handle", (0, 0, wide), (0, 0, -1), (0, 1, 0), 2 * wide)


def _turner(b: Builder, link: str, at: ArrayLike, axis: ArrayLike, reach: float, n: int) -> None:
    """What a hand turns about `axis`: a star of `n` rods, or (n = 0) a rim on spokes."""
    tip, count, r = b.choice((0.65, 0.9, 0.0)), n or b.integer(3, 5), b.uniform(0.05, 0.09) * reach
    end = np.array([reach, 0, b.uniform(0, 0.3) * reach if n else 0])
    with b.facing(at, axis, np.roll(axis, 1)), b.moved((0, 0, 0), (0, 0, 1), b.uniform(0, TAU)):
        _rod(b, link, (0, 0, 0), (0, 0, 3 * r), b.uniform(1.5, 2.4) * r)
        for k in range(count):
            with b.moved((0, 0, 1.6 * r), (0, 0, 1), k * TAU / count):
                _rod(b, link, (0, 0, 0), end, 0.6 * r)
                _rod(b, link, tip * end, (1 - tip) * end, r, "dark")
        if not n:
            b.torus(link, (0, 0, 1.6 * r), (0, 0, 1), reach, r, b.choice(PAINTS), "handle")


def drill_press(b: Builder) -> None:
    """A column with a table and a head: the spoked feed turns; quill, table or head may slide."""
    h = b.uniform(0.4, 1.7)
    w = 0.2 * h**0.5 * b.uniform(0.75, 1.25)
    b.size(3 * w, 1.6 * w, h)
    b.theme(b.choice(("paint", "paint", "steel", "dark", "plastic")))
    g, r, t = max(b.gap, 0.001), b.uniform(0.14, 0.24) * w, b.uniform(0.08, 0.16) * w
    travel = b.uniform(0.3, 0.8) * w if b.chance(0.3) else 0.0  # the head slides on the column
    tall, wide, long, q = b.uniform(0.9, 1.4) * w, b.uniform(0.5, 0.8) * w, 0.7 * w, 0.17 * w
    x, z, y, s = -r - b.uniform(0.8, 1.3) * w, h - tall - travel, 0.4 * w, b.choice((-1, 1))
    head, back = part(b, "head", "carriage") if travel else "base", -r - g if travel else 1.7 * r
    room, space, curve = z - long - t, z - long - 2.5 * t - 0.6 * w, b.uniform(0.02, 0.2) * w
    rounded(b, "base", (x - 0.6 * w, -wide, 0), (2.5 * r, wide, t), 0.1 * w)
    if travel:
        b.box("base", (-r, -1.3 * r, t), (r, 1.3 * r, h), "metal")
        _rod(b, head, (x, 0, z + 0.7 * tall), (0, 0, 0.4 * tall), 0.4 * w, "dark")
    else:
        _rod(b, "base", (0, 0, t), (0, 0, h - 0.5 * tall - t), r)
        _rod(b, "base", (back + 0.3 * w, 0, z + 0.1 * tall), (0, 0, 0.62 * tall), 0.4 * w, "dark")
        low, top = (x - 0.45 * w, -y, z + 0.75 * tall), (back + 0.8 * w, y, z + 0.95 * tall)
        rounded(b, "base", low, top, 0.3 * w, "z", "front")
    if space > 0 and not travel:
        on, a = part(b, "table", "slider") if b.chance(0.35) else "base", min(0.9 * wide, -0.7 * x)
        tz, ring = 2.5 * t + 0.5 * w + b.uniform(0.2, 0.9) * space, 1.1 * r + g
        low, top, turn = (x - a, -a, tz - 0.1 * w), (x + a, a, tz), b.choice((0.1, 0.99)) * a
        rounded(b, on, low, top, turn, "z", "metal")
        b.box(on, (x, -0.15 * w, tz - 0.25 * w), (-ring, 0.15 * w, tz - 0.09 * w), "trim")
        b.tube(on, (0, 0, tz - 0.45 * w), (0, 0, tz), ring + 0.5 * r, ring, "trim")
        _rod(b, on, (0, ring, tz - 0.3 * w), (0, 0.4 * w, -0.05 * w), 0.04 * w, "dark")
        room, down = z - long - tz, 0.45 * w + 2.5 * t - tz
        if on != "base":
            b.slide(on, "base", (0, 0, 1), 0.9 * down, 0.7 * room, closed=0.0)
    rounded(b, head, (x - 0.35 * w, -0.5 * w, z), (back, 0.5 * w, z + 0.75 * tall), curve, "y")
    b.box(head, (x - 0.37 * w, -0.3 * w, z + 0.1 * tall), (x, 0.3 * w, z + 0.5 * tall), "trim")
    if travel:
        b.slide(head, "base", (0, 0, 1), -0.5 * room, 0.9 * travel, closed=0.0)
    quill = part(b, "quill", "slider") if b.chance(0.55) else head
    _rod(b, quill, (x, 0, z + 0.3 * tall), (0, 0, -0.3 * tall - 0.4 * long), q)
    with b.moved((x, 0, z - long)):
        b.lathe(quill, np.array([(0.15, 0), (0.15, 0.2), (0.9, 0.35), (0.9, 0.6)]) * (q, long))
    if quill != head:
        b.slide(quill, head, (0, 0, -1), 0.0, min(b.uniform(0.5, 0.9) * room, 0.25 * tall))
    feed, hub = part(b, "feed", "lever"), np.array([x + 0.15 * w, s * 0.45 * w, z + 0.35 * tall])
    reach, out = min(b.uniform(0.6, 1.4) * w, 0.7 * (hub[2] - t)), np.array([0, s, 0])
    _rod(b, head, hub, out * 0.1 * w, 0.2 * w, "trim")
    _rod(b, feed, hub, out * (0.13 * w + g), 0.06 * w)
    _turner(b, feed, hub + out * (0.1 * w + g), out, reach, b.choice((0, 1, 2, 3, 3, 4)))
    b.spin(feed, head, hub, (0, s, 0), 0.0, b.uniform(1.5, 5.0))


def miter_saw(b: Builder) -> None:
    """A saw head on a hinged arm above a table with a fence; table and blade may move."""
    r = b.uniform(0.08, 0.2)
    disc, turns, up = b.uniform(0.9, 1.2) * r, b.chance(0.5), b.uniform(0.4, 0.8)
    w, s = disc * b.uniform(2.7, 4.5), b.choice((-1, 1))
    b.size(4 * r, w, 3 * r)
    b.theme(b.choice(("plastic", "paint", "dark", "steel")))
    g, z1 = max(b.gap, 0.001), b.uniform(0.15, 0.35) * r
    top, tall = z1 + b.uniform(0.15, 0.3) * r, b.uniform(0.3, 0.5) * r
    table, low = part(b, "table", "turntable") if turns else "base", z1 + (g if turns else 0)
    xp, zp = 1.3 * disc + b.uniform(0.0, 0.4) * r, top + b.uniform(0.75, 1.1) * r
    if turns:
        b.spin(table, "base", (0, 0, top), (0, 0, 1), -0.78, 0.78, closed=0.0)
        _rod(b, "base", (0, 0, z1), (0, 0, g), 0.2 * disc)
    b.box("base", (-0.75 * disc, -w / 2, 0), (0.75 * disc, w / 2, z1), "body")
    _rod(b, table, (0, 0, low), (0, 0, top - low), disc)
    rounded(b, table, (-1.5 * disc, -0.2 * r, low), (-0.8 * disc, 0.2 * r, top), 0.1 * r)
    _rod(b, table, (-1.4 * disc, 0, (low + top) / 2), (-0.5 * disc, 0, 0), 0.1 * r, "dark")
    b.box(table, (0.8 * disc, -0.3 * r, low), (xp + 0.25 * r, 0.3 * r, top), "body")
    for k in (-1.0, 1.0):
        y, deep = k * (disc + g + w / 2) / 2, w / 2 - disc - g
        b.block("base", (0, y, (z1 + top) / 2), (disc, deep, top - z1))
        b.block("base", (0.17 * disc, y, top), (0.25 * disc, deep, 0.25 * r))
        at = (0.08 * disc, k * (0.12 * r + 0.24 * w), top + g + tall / 2)
        b.block("base", at, (0.08 * disc, 0.48 * w - 0.25 * r, tall), "metal")
    xc, zc = -0.2 * r, top + 1.02 * r + g
    for y in (-0.3 * r, 0.18 * r):
        b.box(table, (xp - 0.17 * r, y, top), (xp + 0.2 * r, y + 0.12 * r, zp + 0.17 * r), "body")
    arm, neck = part(b, "arm", "head"), (xc + 0.5 * r, s * 0.15 * r, zc + 0.75 * r)
    _rod(b, arm, (xp, -0.26 * r, zp), (0, 0.52 * r, 0), 0.12 * r)
    bar(b, arm, (xp, s * 0.1 * r, zp), neck, 0.24 * r, 0.1 * r, (0, 1, 0), "trim")
    t, paint = np.linspace(-0.15, b.uniform(3.1, 3.7), 15), b.choice(("body", "dark", "front"))
    ring, mid = np.c_[np.cos(t), np.sin(t)] * r, np.array([xc, zc])
    for r0, r1, k in ((1.05, 1.15, -0.1), (0.2, 1.05, 0.06)):
        y0, y1 = sorted((s * k * r, s * 0.1 * r))
        profile(b, arm, np.r_[r1 * ring, r0 * ring[::-1]] + mid, y0, y1, "y", paint)
    x, end, wide = xc + 0.1 * r, s * b.uniform(0.5, 0.9) * r, b.uniform(0.26, 0.36) * r
    _rod(b, arm, (x, s * 0.09 * r, zc + 0.15 * r), (0, end, 0), wide, b.choice(PAINTS))
    x, z = xc - b.uniform(1.25, 1.4) * r, zc + 0.7 * r
    _rod(b, arm, (xc - 0.7 * r, 0, zc + 0.83 * r), (x - xc + 0.7 * r, 0, -0.13 * r), 0.08 * r)
    _rod(b, arm, (x, -0.3 * r, z), (0, 0.6 * r, 0), b.uniform(0.08, 0.22) * r, "dark")
    b.grasp(arm, "handle", (x, 0, z), (0, 0, -1), (1, 0, 0), 0.16 * r)
    blade, rest = part(b, "blade", "rotor") if b.chance(0.5) else arm, b.choice((1.0, 0.6, 0)) * up
    b.cylinder(blade, (xc, -0.012 * r, zc), (xc, 0.012 * r, zc), r, None, "metal", sides=32)
    _rod(b, blade, (xc, -0.06 * r, zc), (0, 0.11 * r, 0), 0.13 * r, "dark")
    b.hinge(arm, table, (xp, 0, zp), (0, 1, 0), 0.0, up, opens=(0, 0, 1), rest=rest)
    if blade != arm:
        b.spin(blade, arm, (xc, 0, zc), (0, 1, 0))


def screw_press(b: Builder) -> None:
    """A book press or an arbor press: wheel or lever, and platen or ram move."""
    h = b.uniform(0.18, 0.6)
    b.size(0.6 * h, 0.7 * h, 1.2 * h)
    b.theme(b.choice(("paint", "dark", "steel", "wood")))
    g, t, s = max(b.gap, 0.001), b.uniform(0.05, 0.1) * h, b.choice((-1, 1))
    if b.chance(0.5):
        _arbor_press(b, h, t, g, s)
        return
    w, d, r = b.uniform(0.2, 0.4) * h, b.uniform(0.15, 0.3) * h, b.uniform(0.025, 0.04) * h
    post, thick, curve = b.uniform(0.03, 0.05) * h, b.uniform(0.03, 0.06) * h, b.choice((0.1, 0.9))
    wide, high, deep = w + 2 * post, h - b.uniform(0.07, 0.14) * h, max(1.3 * post, 3 * r)
    rounded(b, "base", (-d, -wide, 0), (d, wide, t), 0.1 * d)
    for y in (-wide, w):
        rounded(b, "base", (-post, y, t), (post, y + 2 * post, 1.03 * h), curve * post)
    bored(b, "base", (-deep, -wide, high), (deep, wide, h), "z", (0, 0), r + g)
    studs(b, [(-deep, k * 0.6 * w, (high + h) / 2) for k in (-1, 1)], (-1, 0, 0), 0.02 * h)
    low = min(t + b.uniform(0.3, 0.8) * (high - t), high - 2 * thick - 2 * g)
    platen = part(b, "platen", "slider") if b.chance(0.65) else "base"
    b.box(platen, (-0.95 * d, -w + g, low), (0.95 * d, w - g, low + thick), b.choice(PAINTS))
    screw, up, foot = part(b, "screw", "wheel"), b.uniform(0.07, 0.4) * h, low + thick
    _rod(b, screw, (0, 0, foot), (0, 0, h + up + 0.02 * h - foot), r)
    reach, far = b.uniform(0.15, 0.4) * h, min(up - 0.03 * h - g, low - t - g)
    _turner(b, screw, (0, 0, h + up), (0, 0, 1), reach, b.choice((0, 0, 2, 2, 4)))
    if platen != "base":
        b.slide(platen, "base", (0, 0, -1), foot + g - high, far, closed=0.0)
    b.spin(screw, platen, (0, 0, h), (0, 0, 1))


def _arbor_press(b: Builder, h: float, t: float, g: float, s: int) -> None:
    w, q, d = b.uniform(0.07, 0.14) * h, b.uniform(0.03, 0.05) * h, b.uniform(0.2, 0.35) * h
    far, wide, high = q + g + 0.08 * h, q + g + 0.4 * w, b.uniform(0.6, 0.75) * h
    reach, end = b.uniform(0.25, 0.6) * h, b.uniform(0.5, 0.9) * high
    rounded(b, "base", (-0.8 * d, -1.4 * w, 0), (d + w, 1.4 * w, t), 0.3 * w)
    b.box("base", (d - 0.5 * w, -0.7 * w, t), (d + w, 0.7 * w, h), "body")
    pierced(b, "base", (-far, -wide, high), (d, wide, h), [(-q - g, -q - g, q + g, q + g)])
    profile(b, "base", [(d, high), (0.4 * d, high), (d, high - 0.5 * d)], -0.4 * w, 0.4 * w, "y")
    _rod(b, "base", (0, 0, t), (0, 0, 0.06 * h), 0.6 * d)
    ram, lever = part(b, "ram", "slider") if b.chance(0.75) else "base", part(b, "lever")
    b.box(ram, (-q, -q, end), (q, q, 1.25 * h), "metal")
    _rod(b, ram, (0, 0, end), (0, 0, -0.03 * h), 1.2 * q)
    if ram != "base":
        b.slide(ram, "base", (0, 0, -1), 0.0, min(end - t - 0.1 * h, 0.24 * h))
    hub, out = np.array([far, s * wide, (high + h) / 2]), np.array([0, s, 0])
    _rod(b, "base", hub, out * 0.02 * h, 0.08 * h, "trim")
    _rod(b, lever, hub + out * 0.01 * h, out * (0.03 * h + g), 0.03 * h)
    _turner(b, lever, hub + out * (0.02 * h + g), out, reach, b.choice((1, 1, 2, 3, 0)))
    b.spin(lever, "base", hub, (0, 1, 0), 0.0, b.uniform(0.8, 4.0))


def tool_cabinet(b: Builder) -> None:
    """A tool chest on casters or feet: thin drawers with strip handles, a lid, a cupboard door."""
    d, w, h = b.uniform(0.3, 0.6), b.uniform(0.35, 1.5), b.uniform(0.25, 1.0)
    b.size(d, w, h + 0.15)
    b.theme(b.choice(("paint", "paint", "dark", "steel", "plastic")))
    t, g, r, s = b.uniform(0.012, 0.025), max(b.gap, 0.0015), 0.1 * d, b.choice((-1, 1))
    casters, inset, cols = b.chance(0.6), b.chance(0.4), 2 if w > 0.75 and b.chance(0.7) else 1
    z0 = 2.3 * r if casters else b.uniform(0.02, 0.08)
    for x, y in ((u * d, v * w) for u in (0.13, 0.87) for v in (-0.4, 0.4)):
        if casters:
            wheel(b, "base", (x, y, r), (0, 1, 0), r, 0.6 * r, "disc")
        b.box("base", (x - 0.6 * r, y - 0.6 * r, 1.1 * r * casters), (x + 0.6 * r, y + 0.6 * r, z0))
    z1, mid = z0 + h, b.uniform(-0.2, 0.2) * w
    cuts = np.array([t / 2 - w / 2, mid, w / 2 - t / 2])[:: 3 - cols]
    b.shell("base", (0, -w / 2, z0), (d, w / 2, z1), t, "-x")
    if cols == 2:
        b.box("base", (0, cuts[1] - t / 2, z0 + t), (d - t, cuts[1] + t / 2, z1 - t))
    x0, x1 = (0.0, 0.02) if inset else (-0.02 - 0.3 * g, -0.3 * g)
    edge, grip = g if inset else g / 2 - 0.4 * t, b.choice(("strip", "strip", "bar", "bow"))
    v = g if inset else g / 2  # between fronts one above the other, where no wall is
    door, reach = b.choice((0.0, 0.0, b.uniform(0.35, 0.6))) * (h - 2 * t), b.uniform(0.6, 0.9) * d
    for k in range(cols):
        y0, y1, low = cuts[k] + t / 2 + edge, cuts[k + 1] - t / 2 - edge, z0 + t
        n, q = b.integer(2, 8 if cols == 1 else 4), t / 2 + g + 0.005
        if door and k == cols - 1:
            low, n, link, (pin, free) = low + door, n // 2, part(b, "door"), (y0, y1)[::s]
            at = (x0, 0.9 * free + 0.1 * pin, low - 0.4 * door)
            b.front(link, (x0, y0, z0 + t + edge), (x1, y1, low - v), "moulded")
            b.handle(link, at, (-1, 0, 0), (0, 0, 1), 0.12, b.choice(("bar", "bow", "knob")))
            b.hinge(link, "base", (x0, pin, low), (0, 0, 1), 0.0, 1.7, opens=(-1, 0, 0))
        sizes = np.sort(b.rng.choice([1.0, 1.0, 1.5, 2.0, 3.0], n))[:: b.choice((-1, -1, 1))]
        rows = low + np.r_[0, np.cumsum(sizes)] / sizes.sum() * (z1 - t - low)
        for a, c in zip(rows[:-1] + v, rows[1:] - v, strict=True):
            link, at = part(b, "drawer"), (x0, (y0 + y1) / 2, c - 0.3 * min(c - a, 0.06))
            b.panel(link, (x0, y0, a), (x1, y1, c), "front")
            rear = (d - t - g, cuts[k + 1] - q, 0.3 * a + 0.7 * c)
            b.drawer_box(link, (x1, cuts[k] + q, a - v + g + 0.004), rear, 0.005)
            long = 0.95 * (y1 - y0) if grip == "strip" else min(0.6 * (y1 - y0), 0.3)
            b.handle(link, at, (-1, 0, 0), (0, 1, 0), long, grip)
            b.slide(link, "base", (-1, 0, 0), 0.0, reach)
    if b.chance(0.5):
        b.handle("base", (d / 2, s * w / 2, z1 - 0.15 * h), (0, s, 0), (1, 0, 0), 0.6 * d, "bar")
    studs(b, [(0, s * (w / 2 - t / 2), z1 - t / 2)], (-1, 0, 0), 0.4 * t)
    if b.chance(0.4):
        lid, z, up = part(b, "lid"), z1 + b.uniform(0.03, 0.12) + g, b.uniform(0.02, 0.06)
        tray(b, "base", (0, -w / 2, z1), (d, w / 2, z - g), t)
        tray(b, lid, (0, -w / 2, z), (d, w / 2, z + up), 0.8 * t, "z", -1)
        b.block(lid, (-0.005, 0, z + up / 2), (0.01, 0.2 * w, 0.5 * up), "metal")
        b.hinge(lid, "base", (d, 0, z), (0, 1, 0), 0.0, b.uniform(1.1, 1.7), opens=(0, 0, 1))


def pencil_sharpener(b: Builder) -> None:
    """A desk sharpener, a coffee mill or a meat grinder, turned by a crank."""
    h, kind = b.uniform(0.08, 0.3), b.choice(("desk", "desk", "mill", "grinder"))
    d, w, r = b.uniform(0.5, 1.1) * h, b.uniform(0.4, 0.8) * h, b.uniform(0.025, 0.045) * h
    b.size(d, w, 1.2 * h)
    b.theme()
    g, e, arm = max(b.gap, 0.0008), 0.05 * w, b.uniform(0.3, 0.6) * h
    axis, at, crank = np.array([1.0, 0, 0]), np.array([d, 0, 0.65 * h]), part(b, "crank")
    cut, y = b.uniform(0.35, 0.5) * h, w / 2 - e - g
    if kind in ("desk", "mill"):
        b.box("base", (-2 * e, -w / 2 - e, -0.06 * h), (d + e, w / 2 + e, 0), "trim")
        if b.chance(0.65):
            hole, key = (-w / 2 + e, e, w / 2 - e, cut - e), part(b, "drawer")
            pierced(b, "base", (0, -w / 2, 0), (d, w / 2, cut), [hole], "x")
            tray(b, key, (0, -y, e + g), (0.9 * d, y, cut - e - g), 0.4 * e)
            b.handle(key, (0, 0, cut / 2), (-1, 0, 0), (0, 1, 0), 0.3 * w, "knob")
            b.slide(key, "base", (-1, 0, 0), 0.0, 0.75 * d)
        else:
            rounded(b, "base", (0, -w / 2, 0), (d, w / 2, cut), 0.06 * w, b.choice(("x", "z")))
    if kind == "desk":
        rounded(b, "base", (0, -w / 2, cut), (d, w / 2, h), b.uniform(0.05, 0.45) * w / 2, "x")
        b.tube("base", (-0.06 * h, 0, 0.7 * h), (0, 0, 0.7 * h), 0.14 * w, 0.08 * w, "metal")
    elif kind == "mill":
        axis, at = np.array([0, 0, 1.0]), np.array([d / 2, 0, h])
        with b.moved((d / 2, 0, cut)):
            b.lathe("base", np.array([(0.4, 0), (0.4, 0.4), (0.3, 0.8), (0.1, 1)]) * (w, h - cut))
    else:
        at[0] = 0.3 * h
        _rod(b, "base", (-d, 0, at[2]), (d + 0.3 * h, 0, 0), 0.17 * h, "body")
        _rod(b, "base", (-d - 0.02 * h, 0, at[2]), (0.12 * h, 0, 0), 0.22 * h)
        with b.moved((-0.4 * d, 0, at[2] + 0.1 * h)):
            b.vessel("base", np.array([(0.08, 0), (0.09, 0.15), (0.24, 0.3)]) * h, 0.02 * h)
        for x0, x1, z0, z1 in ((-0.4, 0.1, 0, 0.05), (0, 0.1, -0.45, 0.6), (-0.3, 0, -0.45, -0.35)):
            b.box("base", (x0 * h, -0.08 * h, z0 * h), (x1 * h, 0.08 * h, z1 * h), "body")
        _rod(b, "base", (-0.2 * h, 0, -0.6 * h), (0, 0, 0.5 * h), 0.04 * h)
        _rod(b, "base", (-0.2 * h, -0.15 * h, -0.6 * h), (0, 0.3 * h, 0), 0.025 * h)
    _rod(b, "base", at, 0.04 * h * axis, 0.1 * h, "trim")
    _crank(b, crank, at + 0.03 * h * axis, axis, arm, r)
    b.spin(crank, "base", at, axis)
    settle(b)


def hole_punch(b: Builder) -> None:
    """A desk punch or an embosser with a lever, or a tape dispenser whose roll spins."""
    d, kind = b.uniform(0.08, 0.25), b.choice(("punch", "punch", "tape", "emboss"))
    w, t = d * (b.uniform(0.4, 1.2) if kind == "punch" else b.uniform(0.25, 0.5)), 0.08 * d
    b.size(d, w, 0.6 * d)
    b.theme(b.choice(("plastic", "dark", "paint", "steel")))
    g, th, r = max(b.gap, 0.0006), b.uniform(0.06, 0.12) * d, b.uniform(0.2, 0.33) * d
    half, z = 0.35 * w, t + (r + 2 * g if kind == "tape" else b.uniform(0.25, 0.4) * d)
    rounded(b, "base", (0, -w / 2, 0), (d, w / 2, t), 0.1 * w)
    if kind == "tape":
        key, tall, x = part(b, "roll", "rotor"), b.uniform(1.05, 1.4) * z, 0.55 * d
        b.box("base", (0, -half, t), (0.08 * d, half, z), "body")
        side = [(0, t), (d, t), (0.9 * d, 0.9 * tall), (0.5 * d, tall), (0, z)]
        for y in (-w / 2, half):
            profile(b, "base", side, y, y + 0.15 * w, "y", "body")
        b.box("base", (-0.05 * d, -half, z), (0.06 * d, half, z + 0.03 * d), "metal")
        b.tube(key, (x, -0.8 * half, z), (x, 0.8 * half, z), r, 0.45 * r, b.choice(PAINTS))
        _rod(b, key, (x, g - half, z), (0, 2 * half - 2 * g, 0), 0.46 * r, b.choice(PAINTS))
        b.spin(key, "base", (x, 0, z), (0, 1, 0))
        return
    lever, front, far = part(b, "lever"), b.uniform(-0.5, 0.1) * d, b.uniform(0.2, 0.5)
    for k in (-1, 1):
        y0, y1 = sorted((k * (half + g), k * w / 2))
        b.box("base", (0.75 * d, y0, t), (0.95 * d, y1, z + th), "trim")
        if kind == "punch":
            b.block("base", (0.5 * d, k * 0.25 * w, t + 0.1 * d), (0.2 * d, 0.15 * w, 0.2 * d))
            _rod(b, "base", (0.5 * d, k * 0.25 * w, t), (0, 0, z - t - 0.02 * d - g), 0.03 * d)
    if kind == "emboss":
        die, end = part(b, "die", "slider") if b.chance(0.6) else "base", b.uniform(0.07, 0.1) * d
        b.box("base", (0.55 * d, -0.3 * w, t), (0.8 * d, 0.3 * w, z - 0.06 * d))
        top = (0.55 * d, 0.3 * w, z - 0.06 * d)
        bored(b, "base", (0.05 * d, -0.3 * w, z - 0.16 * d), top, "z", (0.25 * d, 0), 0.2 * w + g)
        _rod(b, die, (0.25 * d, 0, t + end), (0, 0, z - t - end - 0.03 * d - g), 0.2 * w)
        if die != "base":
            b.slide(die, "base", (0, 0, -1), 0.0, 0.6 * end)
    low, peak = z - b.uniform(0, 0.02) * d, z + th * b.uniform(1.0, 2.0)
    tail = [(0.92 * d, z), (0.92 * d, z + th), (0.5 * d, peak), (front, low + 0.5 * th)]
    profile(b, lever, [(front, low), *tail], -half, half, "y", b.choice(PAINTS))
    if front < 0 and b.chance(0.6):
        grip = (front + 0.2 * d, 1.1 * half, low + th)
        rounded(b, lever, (front - 0.1 * d, -1.1 * half, low), grip, 0.4 * th, "y", "rubber")
    _rod(b, lever, (0.85 * d, -0.45 * w, z + th / 2), (0, 0.9 * w, 0), 0.35 * th)
    pin, tip, rest = (0.85 * d, 0, z + th / 2), (front, 0, z), b.choice((1.0, 1.0, 0.5, 0.0)) * far
    b.hinge(lever, "base", pin, (0, 1, 0), 0.0, far, opens=(0, 0, 1), tip=tip, rest=rest)


def nutcracker(b: Builder) -> None:
    """Two arms about a pin: nutcrackers, garlic presses, tongs, pincers, can openers."""
    l, kind = b.uniform(0.1, 0.32), b.choice(("nut", "garlic", "tongs", "cross", "cross", "can"))
    b.size(1.3 * l, 0.3 * l, 0.06 * l)
    b.theme(b.choice(("steel", "steel", "plastic", "dark", "wood")))
    w, t, u = b.uniform(0.04, 0.07) * l, b.uniform(0.04, 0.09) * l, np.linspace(0, 1, 13)
    g, jaw, key = min(max(0.3 * b.gap, 0.0003), 0.15 * t), b.uniform(0.1, 0.35) * l, part(b, "arm")
    slim, grips, beak = 0.6 * w if kind == "tongs" else w, b.chance(0.5), b.uniform(0, 0.12) * l
    arch, paint = b.uniform(0, 0.1) * l * np.sin(np.pi * u ** b.uniform(0.5, 2.0)), b.choice(PAINTS)
    start, far = 0.3 * l if kind == "garlic" else 1.5 * w, b.uniform(0.4, 0.9)
    up, yaw = b.choice((0.0, 0.0, TAU / 4)), b.choice((0.0, 0.0, TAU / 4, b.uniform(0, TAU)))

    def limb(link: str, x: ArrayLike, mid: ArrayLike, half: ArrayLike, m: str, grow: float) -> None:
        low, high = np.c_[x, np.subtract(mid, half)], np.c_[x, np.add(mid, half)]
        profile(b, link, np.r_[low, high[::-1]], -grow, t + grow, "z", m)

    with b.moved((0, 0, 0), (0, 0, 1), yaw), b.moved((0, 0, 0), (1, 0, 0), up):
        for s, link, z in ((-1, "base", 0.0), (1, key, (t + g) / 2)):
            _rod(b, link, (0, 0, z), (0, 0, (t - g) / 2), w)
            x, mid = start + (l - start) * u, s * (g + 0.65 * slim + arch)
            a = 0.14 * l if kind == "garlic" and s < 0 else 1.05 * start
            lug = np.array([(0, 0), (a, s * g), (a, s * (g + slim)), (0, s * w)])
            profile(b, link, lug, z, z + (t - g) / 2, "z", "metal")
            limb(link, x, mid, slim * (0.6 - 0.15 * u), paint, 0.0)
            if grips:
                limb(link, x[6:], mid[6:] * 1.1, 0.7 * slim + 0 * u[6:], "rubber", 0.1 * t)
            if kind in ("cross", "can"):
                half = w * (0.5 - 0.3 * u)
                profile(b, link, lug * -1.0, z, z + (t - g) / 2, "z", "metal")
                shape = -s * (g + half + beak * np.sin(np.pi * u))
                limb(link, -1.5 * w - jaw * u, shape, half, "metal", 0.0)
            elif kind == "tongs":
                with b.facing((1.05 * l, s * (g + 0.06 * l), t / 2), (0, -s, 0), (1, 0, 0)):
                    b.lathe(link, np.array([(0.03, 0), (0.1, 0.04), (0.1, 0.05), (0, 0.02)]) * l)
        _rod(b, key, (0, 0, -0.2 * t), (0, 0, 1.4 * t), 0.4 * w, "dark")
        tip, rest = (l, 0, 0), b.choice((0.0, 0.3, 0.7)) * far
        b.hinge(key, "base", (0, 0, 0), (0, 0, 1), 0.0, far, opens=(0, 1, 0), tip=tip, rest=rest)
        if kind == "garlic":
            c, r = 0.22 * l, 0.09 * l
            with b.facing((c, -0.1 * l, t / 2), (0, 1, 0), (1, 0, 0)):
                b.vessel("base", [(r, 0), (r, 0.1 * l - g)], 0.15 * r)
            _rod(b, key, (c, 0.5 * w, t / 2), (0, -0.5 * w - 0.05 * l, 0), 0.6 * r)
        elif kind == "can":
            turn, y = part(b, "key", "crank"), g + 0.6 * w
            _rod(b, turn, (w, y, t), (0, 0, g + 1.5 * t), 0.3 * w)
            bar(b, turn, (w - 0.1 * l, y, 3 * t), (w + 0.1 * l, y, 3 * t), 0.3 * t, 2 * t)
            b.spin(turn, key, (w, y, t), (0, 0, 1))
    settle(b)


def wall_locker(b: Builder) -> None:
    """Steel lockers side by side or stacked: louvred doors with plates and latches that stay."""
    cols, rows, c = b.integer(1, 3), b.choice((1, 1, 2, 3)), b.uniform(0.22, 0.5)
    h, d, w = b.uniform(0.6, 2.0), b.uniform(0.2, 0.55), c * cols
    b.size(d, w, h)
    b.theme(b.choice(("steel", "paint", "paint", "dark", "wood", "white")))
    t, g, s = b.uniform(0.008, 0.02), max(b.gap, 0.0015), b.choice((-1, 1))
    z0, inset, far = b.choice((0.03, 0.08, 0.15)), b.chance(0.5), b.uniform(1.3, 1.8)
    b.feet("base", (0, -w / 2), (d, w / 2), z0, b.choice(("square", "plinth", "sled")))
    b.shell("base", (0, -w / 2, z0), (d, w / 2, h), t, "-x")
    if b.chance(0.3):
        profile(b, "base", [(0, h), (d, h), (d, h + 0.5 * d)], -w / 2, w / 2, "y")
    ys, zs = np.linspace(-w / 2, w / 2, cols + 1), np.linspace(z0, h, rows + 1)
    for y in ys[1:-1]:
        b.box("base", (0, y - t / 2, z0 + t), (d - t, y + t / 2, h - t))
    for z in zs[1:-1]:
        b.box("base", (0, t - w / 2, z - t / 2), (d - t, w / 2 - t, z + t / 2), "inside")
    style, lock = b.choice(("louvre", "slots", "slots", "")), b.chance(0.3)
    x0, x1, edge = (0.0, 0.018, t + g) if inset else (-0.018 - 0.3 * g, -0.3 * g, g / 2 + 0.1 * t)
    for k in range(cols * rows):
        link, y0, y1 = part(b, "door"), ys[k % cols] + edge, ys[k % cols + 1] - edge
        a, e, m = zs[k // cols] + edge, zs[k // cols + 1] - edge, (y0 + y1) / 2
        tall, wide, (pin, free), z = e - a, y1 - y0, (y0, y1)[::s], (a + e) / 2
        b.front(link, (x0, y0, a), (x1, y1, e), "louvre" if style == "louvre" else "slab")
        for v in (0.08, 0.11, 0.14, 0.86, 0.89, 0.92) if style == "slots" else ():
            b.block(link, (x0 - 0.002, m, a + v * tall), (0.006, 0.5 * wide, 0.012 * tall), "trim")
        y = 0.86 * free + 0.14 * pin
        b.block(link, (x0, m, a + 0.75 * tall), (0.006, 0.3 * wide, 0.03), "light")
        b.block(link, (x0, y, z), (0.008, 0.12 * wide, min(0.15, 0.4 * tall)), "metal")
        b.hinge(link, "base", (x0, pin, z), (0, 0, 1), 0.0, far, opens=(-1, 0, 0))
        if lock:
            latch = part(b, "latch", "lever")
            _rod(b, latch, (x0, y, z), (-0.02, 0, 0), 0.01)
            b.block(latch, (x0 - 0.02, y, z), (0.01, 0.01, min(0.1, 0.25 * tall)), "dark")
            b.spin(latch, link, (x0, y, z), (1, 0, 0), 0.0, 1.57)
        else:
            b.block(link, (x0 - 0.01, y, z), (0.015, 0.03, 0.05), "dark", "handle")


CATEGORIES: dict[str, Callable[[Builder], None]] = {
    "drill_press": drill_press, "miter_saw": miter_saw, "screw_press": screw_press,
    "tool_cabinet": tool_cabinet, "pencil_sharpener": pencil_sharpener, "hole_punch": hole_punch,
    "nutcracker": nutcracker, "wall_locker": wall_locker,
}  # fmt: skip
