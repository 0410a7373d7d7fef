"""Parts of buildings: garage doors, shutters, turnstiles, lifts, skylights, vaults, louvres."""

# ruff: noqa: RUF005  (a point plus a tuple is a vector sum here, not a joined list)

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mam_pipeline.types import joint_motion
from mam_world.kit import Builder
from mam_world.mech import dial, studs
from mam_world.solids import (
    TAU,
    bar,
    bored,
    frame,
    part,
    pierced,
    plate,
    profile,
    rounded,  # fmt: skip
    settle,
)

SKINS = ("boards", "boards", "fields", "ribs", "panes", "slab", "framed", "louvre", "double")
ACROSS, UP, FRONT = (0, 1, 0), (0, 0, 1), (-1, 0, 0)
Point = Sequence[float]


def _leaf(b: Builder, link: str, low: Point, high: Point, kind: str) -> None:
    """A leaf that fills a box and faces -x: boards on ledges, fields, ribs, panes or a front."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    w, h, x, m = y1 - y0, z1 - z0, x0 + 0.35 * (x1 - x0), (x0 + x1) / 2
    if kind in ("slab", "framed", "louvre", "double"):
        b.front(link, low, high, kind)
    elif kind == "boards":
        n, brace = b.integer(3, 8), b.choice((-0.33, 0, 0.33)) * h
        for k in range(n):
            a, c = y0 + (k + 0.06 * (k > 0)) * w / n, y0 + (k + 1) * w / n
            b.box(link, (x, a, z0), (x1, c, z1), "front")
        for z in z0 + np.array(b.choice(((0.12, 0.88), (0.1, 0.5, 0.9)))) * h:
            e = 0.05 * min(h, 2 * w)
            b.box(link, (x0, y0 + 0.03 * w, z - e), (x, y1 - 0.03 * w, z + e), "trim")
        if brace:
            at, d = np.array(((x0 + x) / 2, y0 + w / 2, z0 + h / 2)), (0, 0.38 * w, brace)
            bar(b, link, at - d, at + d, 0.08 * min(w, h), 0.9 * (x - x0), (1, 0, 0), "trim")
    elif kind in ("panes", "window"):
        ny, nz, e = b.integer(1, 3), b.integer(1, 4), b.uniform(0.05, 0.1) * min(w, h)
        ys, zs = y0 + np.arange(ny + 1) * (w - e) / ny, z0 + np.arange(nz + 1) * (h - e) / nz
        holes = [(ys[i] + e, zs[k] + e, ys[i + 1], zs[k + 1]) for i, k in np.ndindex(ny, nz)]
        if kind == "window":
            holes = [(y0 + 2 * e, z0 + b.choice((0.1, 0.5)) * h, y1 - 2 * e, z1 - 2 * e)]
        pierced(b, link, low, high, holes, "x", "front")
        lo, hi = (m - (x - x0) / 2, *holes[0][:2]), (m + (x - x0) / 2, *holes[-1][2:])
        b.panel(link, lo, hi, "glass")
    else:
        ny, nz = (b.integer(1, 3), b.integer(1, 4)) if kind == "fields" else (1, b.integer(4, 14))
        lit, dy, dz = b.choice((nz - 1, -1)), w / ny, h / nz
        b.panel(link, (x, y0, z0), (x1, y1, z1), "front")
        for i, k in np.ndindex(ny, nz):
            at, e = np.array((x0, y0 + i * dy, z0 + k * dz)), 0.12 * min(dy, dz)
            b.box(link, at + (0, e, e), at + (x - x0, dy - e, dz - e), ("trim", "glass")[k == lit])


def _portal(b: Builder, w: float, h: float, sides: Point, head: float, deep: float) -> None:
    """Two jambs and a head around an opening, x from 0 to `deep`, with a coping."""
    ys, out = [-w / 2 - sides[0], -w / 2, w / 2, w / 2 + sides[1]], b.choice((0.0, 0.01))
    plate(b, "base", ys, [0, h, h + head], [[1, 1], [0, 1], [1, 1]], 0, deep, "x")
    b.box("base", (-out, ys[0], h + head), (deep, ys[3], h + head + 0.03 + out), "trim")


def _lever(b: Builder, link: str, x: float, y: float, z: float, way: float, s: float = 1.0) -> None:
    """A lever or a knob with its plate that belongs to the leaf it sits on."""
    tall, at = b.choice((0.03, 0.11)) * s, np.array((x - 0.05 * s, y + way * 0.055 * s, z))
    b.block(link, (x - 0.003, y, z - tall / 2), (0.006, 0.05 * s, tall + 0.04 * s), "metal")
    if b.chance(0.3):
        return dial(b, link, (x, y, z), FRONT, 0.026 * s, 0.06 * s, "dome", "metal")
    b.cylinder(link, (x, y, z), (x - 0.05 * s, y, z), 0.009 * s, None, "metal", "handle")
    b.block(link, at, (0.016 * s, 0.13 * s, 0.02 * s), "metal", "handle")


def garage_door(b: Builder) -> None:
    """A door that tilts out, goes up in sections or slats, or leaves with rollers on a rail."""
    w, h, t = b.uniform(1.0, 4.5), b.uniform(1.2, 2.8), b.uniform(0.03, 0.08)
    b.size(0.5, 1.2 * w, 1.2 * h)
    b.theme()
    post, head, deep = b.uniform(0.1, 0.6), b.uniform(0.25, 0.7), b.uniform(0.1, 0.3)
    g, skin, s = max(b.gap, 0.004) + t * t / w, b.choice(SKINS), b.choice((-1, 1))
    kind = b.choice(("tilt", "tilt", "sections", "sections", "slats", "rail"))
    wall = 1.05 * w if kind == "rail" and b.chance(0.6) else post
    _portal(b, w, h, (post, wall)[::s], head, deep)
    if kind == "rail":
        x, z, r, door = -0.02 - g - t, h + 0.1, b.uniform(0.03, 0.07), part(b, "door", "leaf")
        b.block("base", (x + 0.016, s * w / 2, z + 0.02), (0.012, 2 * w, 0.04), "metal")
        for y in np.linspace(-0.5, 0.5, 4) * w:
            b.cylinder("base", (x + 0.01, y, z + 0.02), (0, y, z + 0.02), 0.012, None, "dark")
        _leaf(b, door, (x, -w / 2, 0.01), (x + t, w / 2, h + 0.05), skin)
        for y in np.array((-0.32, 0.32)) * w:
            at = np.array((x, y, z + 0.042 + r))
            b.box(door, (x - 0.008, y - 0.025, 0.8 * h), at + (0, 0.025, 0), "dark")
            b.cylinder(door, at - (0.012, 0, 0), at + (0.024, 0, 0), r, None, "metal")
        b.handle(door, (x, -s * 0.4 * w, 0.45 * h), FRONT, UP, 0.3)
        b.slide(door, "base", (0, s, 0), 0.0, b.uniform(0.8, 0.97) * w)
        return
    tilts, door, y1 = kind == "tilt", part(b, "door", "panel"), w / 2 + 0.4 * post
    x, z = (b.uniform(0, 1) * (deep - t), 0.35 * h) if tilts else (deep + g, 0.07 * h)
    b.handle(door, (x, 0, z), FRONT, ACROSS, 0.2, b.choice(("bar", "recessed")))
    if tilts:
        _leaf(b, door, (x, -w / 2 + g, 0.005), (x + t, w / 2 - g, h - g), skin)
        pin = b.choice(((x, 0, h - g), (x + t / 2, 0, b.uniform(0.6, 0.8) * h)))
        for y in (-w / 2, w / 2):  # its pivots
            at = np.array((pin[0], y, pin[2]))
            b.cylinder(door, at - (0, 0.02, 0), at + (0, 0.02, 0), 0.2 * t, None, "metal")
        b.hinge(door, "base", pin, ACROSS, 0.0, b.uniform(1.1, 1.5), opens=FRONT)
        return
    n, ny = (b.integer(3, 6), b.integer(1, 6)) if kind == "sections" else (b.integer(9, 20), 1)
    lit, dy, dz = b.integer(-3, min(n - 1, 3)), w / ny, h / n
    for k, i in np.ndindex(n, ny):
        z, lo = 0.01 + k * dz, (x, -w / 2 + (i + 0.08) * dy, 0.01 + (k + 0.2) * dz)
        b.box(door, lo, lo + np.array((0.4 * t, 0.84 * dy, 0.6 * dz)), ("trim", "glass")[k == lit])
        if i == 0:
            b.box(door, (x + 0.4 * t, -y1, z), (x + t, y1, z + 0.97 * dz), "front")
    for y in (-y1 - g - 0.3 * post, y1 + g):  # tracks
        b.box("base", (deep, y, 0), (x + t, y + 0.3 * post, h + 0.9 * head), "metal")
    if kind == "slats":
        b.box("base", (-0.2, -w / 2 - post, h), (0, w / 2 + post, h + head), "trim")
    b.slide(door, "base", UP, 0.0, b.uniform(0.6, 0.86) * h)


def window_shutters(b: Builder) -> None:
    """A window between shutters, closed or folded back: they turn, or only the window opens."""
    w, h, t = b.uniform(0.4, 1.6), b.uniform(0.6, 1.8), b.uniform(0.02, 0.04)
    b.size(0.2, 2.2 * w, 1.2 * h)
    b.theme()
    g, deep, z0 = max(b.gap, 0.002), b.uniform(0.06, 0.2), b.uniform(0.06, 0.4)
    z1, sill, rail, wide = z0 + h, b.uniform(0.05, 0.15), 0.05 * w + 0.01, b.uniform(0.55, 1.15) * w
    high = (deep, wide, z1 + b.uniform(0.05, 0.4))
    pierced(b, "base", (0, -wide, 0), high, [(-w / 2, z0, w / 2, z1)], "x")
    b.box("base", (-sill, -w / 2 - 0.03, z0 - 0.045), (0, w / 2 + 0.03, z0 - 0.005), "stone")
    xw, opened, n = 0.25 * deep, b.chance(0.25), b.choice((1, 2, 2))
    frame(b, "base", (xw, -w / 2, z0), (0.9 * deep, w / 2, z1), rail, "x", "trim")
    for k, y0 in enumerate((rail - w / 2, 0.0)[:n]):
        y1 = w / 2 - rail if k == n - 1 else 0.0
        key, e = (part(b, "window", "casement"), 2 * g) if opened else ("base", 0.0)
        lo, hi = (xw, y0 + e, z0 + rail + e), (xw + 0.5 * deep, y1 - e, z1 - rail - e)
        _leaf(b, key, lo, hi, "panes")
        y, free = (hi[1], lo[1] + 0.02) if k else (lo[1], hi[1] - 0.02)
        b.handle(key, (xw, free, z0 + h / 2), FRONT, UP, 0.1, "knob")
        if opened:
            b.hinge(key, "base", (xw, y, z0), UP, 0, b.uniform(1.0, 1.5), opens=FRONT)
    leaves, share = b.choice(((-1, 1), (-1, 1), (-1, 1), (1,), (-1,))), b.choice((0, 1, 1, None))
    skin = b.choice(("louvre", "louvre", "louvre", "boards", "fields", "framed", "ribs"))
    far, long = b.uniform(2.6, 3.1), w / len(leaves) - g
    for s in leaves:
        pose = 3.1 if opened else far * (b.uniform(0, 1) if share is None else share)
        to, pin = "base" if opened else part(b, "shutter", "leaf"), (-g - t / 2, s * w / 2, z0)
        with b.at(joint_motion("revolute", UP, np.array(pin), -s * pose)):
            with b.moved((pin[0], s * (w - long) / 2, 0), UP, np.pi * (pose > 1.7)):
                _leaf(b, to, (-t / 2, -long / 2, z0 + g), (t / 2, long / 2, z1 - g), skin)
            for z in (z0 + 0.15 * h, z0 + 0.85 * h):
                b.cylinder(to, (*pin[:2], z - 0.03), (*pin[:2], z + 0.03), 0.45 * t, None, "metal")
        if not opened:
            b.hinge(to, "base", pin, (0, 0, -s), -pose, far - pose, closed=-pose)


def _console(b: Builder, d: float, y0: float, y1: float, h: float) -> None:
    """The cabinet of a gate: plinth, body, lid, reader and lamp that all stay."""
    w, y = y1 - y0, (y0 + y1) / 2
    b.box("base", (-d / 2 - 0.02, y0 - 0.005, 0), (d / 2 + 0.02, y1 + 0.005, 0.05), "dark")
    rounded(b, "base", (-d / 2, y0, 0.05), (d / 2, y1, h - 0.04), 0.3 * w * b.choice((0, 1)))
    rounded(b, "base", (-d / 2 - 0.01, y0, h - 0.04), (d / 2 + 0.01, y1, h), 0.3 * w, "z", "trim")
    b.block("base", (-0.25 * d, y, h + 0.01), (0.2 * d, 0.6 * w, 0.02), "screen")
    studs(b, [(-d / 2, y, 0.75 * h)] * b.integer(0, 1), FRONT, 0.03)


def turnstile(b: Builder) -> None:
    """A gate for people: a tripod on its cabinet, or wings and hoops that slide or turn."""
    d, w, h = b.uniform(0.25, 1.6), b.uniform(0.15, 0.38), b.uniform(0.75, 1.3)
    lane, lanes, t = b.uniform(0.45, 0.95), b.choice((1, 1, 1, 2)), b.uniform(0.01, 0.03)
    b.size(d, lane + w, h)
    b.theme(b.choice(("steel", "steel", "dark", "white", "paint")))
    g, kind = max(b.gap, 0.002), b.choice(("tripod", "tripod", "slide", "turn", "turn"))
    if kind == "tripod":
        s, r, long = b.choice((-1, 1)), b.uniform(0.05, 0.09), min(0.75 * lane - 2 * g, 0.65 * h)
        a, e, f = np.array((0, s, -1)), np.array((0, s, 1)), np.array((2**0.5, 0, 0))
        for y in s * (lane + w) * np.arange(lanes):
            _console(b, d, min(y, y - s * w), max(y, y - s * w), h)
            c = np.array((0, y + s * (0.75 * r + 2 * g + 0.01), 0.82 * h))
            b.cylinder("base", c - 0.9 * r * a, c - 0.7 * g * a, 0.7 * r, None, "metal")
            key, turn = part(b, "rotor", "arms"), b.choice((np.inf, np.pi / 3, TAU / 3))
            b.cylinder(key, c, c + 0.04 * a, r, 0.8 * r, "metal")
            for q in TAU * np.arange(3) / 3:
                end = c + 0.02 * a + long / 2 * (a + np.cos(q) * e + np.sin(q) * f)
                b.cylinder(key, c + 0.02 * a, end, 0.018, None, "metal")
            b.spin(key, "base", c, a, -turn if np.isinf(turn) else 0.0, turn)
        return
    cut, z0, z1, r = b.uniform(0.0, 0.4), b.uniform(0.15, 0.4) * h, 0.9 * h, t + 0.01
    far, hoop, both = b.uniform(1.2, 1.55), b.chance(0.4), b.integer(0, 1)
    for k in range(lanes + 1):
        y = k * (lane + w)
        if kind == "turn":
            _console(b, d, y, y + w, h)
        else:  # two halves with a slot between them
            for x in (-d / 2, t / 2 + g):
                b.box("base", (x, y, 0.05), (x + d / 2 - t / 2 - g, y + w, z1 + 0.02), "body")
            for za, zb in ((0, 0.05), (z1 + 0.02, h)):
                b.box("base", (-d / 2 - 0.01, y, za), (d / 2 + 0.01, y + w, zb), "trim")
        for s in [q for q in (-1, 1) if 0 <= k + (q - 1) // 2 < lanes]:
            edge, key = y + (w if s > 0 else 0), part(b, "wing", "flap")
            end, tall = edge + s * (lane / 2 - g - 0.01 - 0.7 * t), cut * (z1 - z0)
            near = edge + s * (r + g if kind == "turn" else -0.15 * w)
            path = [(near, z0), (end, z0 + tall / 2), (end, z1 - tall), (near, z1)]
            if hoop and kind == "turn":
                b.sweep(key, [(0, *p) for p in path], 0.7 * t, "metal")
            else:
                profile(b, key, path[::s], -t / 2, t / 2, "x", "glass")
            if kind == "slide":
                room = (0.8 if k in (0, lanes) else 0.34) * w  # two share a post in the middle
                b.slide(key, "base", (0, -s, 0), 0.0, min(abs(end - edge) - 0.02, room))
                continue
            b.cylinder(key, (0, near, z0 - 0.05), (0, near, h - 0.05), r, None, "metal")
            for z in (z0 - 0.065 - g, h - 0.035 + g):
                b.block("base", (0, edge + s * (r + g) / 2, z), (1.5 * r, 2 * r + g, 0.03), "dark")
            b.hinge(key, "base", (0, near, h / 2), UP, -far * both, far, closed=0.0)


def lift_doors(b: Builder) -> None:
    """Doors of a lift, a train or a bus that slide sideways, among still buttons and panes."""
    w, h, t = b.uniform(0.7, 2.0), b.uniform(1.3, 2.4), b.uniform(0.02, 0.05)
    b.size(0.4, 2.2 * w, 1.1 * h)
    b.theme(b.choice(("steel", "steel", "dark", "white", "paint")))
    g, deep, car = max(b.gap, 0.003), b.uniform(0.05, 0.2), b.chance(0.4)
    n, s, skin = b.choice((1, 2, 2, 3)), b.choice((-1, 1)), b.choice(("window", *SKINS[2:6]))
    side, head, foot = w * b.uniform(0.2, 1.5), b.uniform(0.15, 0.5), b.uniform(0.05, 0.4)
    x, end, holes = deep + g, w / 2 + side, [(-w / 2, 0.0, w / 2, h)]
    if car:
        x = b.choice((-g - t, x))
        for y in np.arange(w / 2 + 0.1, end - 0.3, b.uniform(0.5, 1.0)).tolist():
            for a in (y, -y - 0.35):
                holes.append((a, 0.45 * h, a + 0.35, 0.85 * h))
                b.box("base", (0.4 * deep, a, 0.45 * h), (0.5 * deep, a + 0.35, 0.85 * h), "glass")
    else:
        y, z, p = s * (w / 2 + 0.4 * min(side, 0.4)), 0.48 * h, b.uniform(0.02, 0.06)
        b.block("base", (-0.005, y, z), (0.01, 0.08, 0.24), "metal")
        studs(b, [(-0.01, y, z - 0.05), (-0.01, y, z + 0.05)], FRONT, 0.018)
        b.block("base", (-0.01, 0, h + 0.6 * head), (0.02, b.uniform(0.1, 0.5), 0.1), "screen")
        pierced(b, "base", (-0.02, -w / 2 - p, 0), (0, w / 2 + p, h + p), holes, "x", "metal")
    pierced(b, "base", (0, -end, -foot * car), (deep, end, h + head), holes, "x", "body")
    b.box("base", (min(x, 0), -end, -foot), (max(deep, x + 2 * t + g), end, -0.01), "metal")
    y, back = w / 2 + 0.02, t + g if x > 0 else -t - g
    leaves = [(s * y, -s * y, s, 0.95 * w, 0.0)]
    if n == 2:
        leaves = [(q * g / 2, q * y, q, 0.47 * w, 0.0) for q in (-1, 1)]
    elif n == 3:  # two leaves, one behind the other, go the same way
        leaves = [(s * y, -s * 0.02, s, 0.46 * w, 0.0), (s * 0.02, -s * y, s, 0.93 * w, back)]
    for a, c, way, room, back in leaves:
        door, (y0, y1) = part(b, "door", "leaf"), sorted((a, c))
        _leaf(b, door, (x + back, y0, 0.005), (x + back + t, y1, h + 0.01), skin)
        b.slide(door, "base", (0, way, 0), 0.0, b.uniform(0.85, 1.0) * room)
    settle(b)


def skylight(b: Builder) -> None:
    """Windows in a sloping roof, hung at the top, at the side or in the middle, or still."""
    long, w, n = b.uniform(0.5, 1.6), b.uniform(0.4, 1.3), b.choice((1, 1, 2))
    thick, t, e = b.uniform(0.04, 0.14), b.uniform(0.03, 0.06), b.uniform(0.03, 0.07)
    b.size(1.5 * long, n * 1.5 * w, long)
    b.theme()
    g, top, rim = max(b.gap, 0.002), thick + b.uniform(0.02, 0.1), b.uniform(0.15, 0.6)
    kind, pitch = b.choice(("top", "middle", "middle", "side")), w + b.uniform(0.1, 0.4)
    cells = [(-long / 2, k * pitch, long / 2, k * pitch + w) for k in range(n)]
    with b.moved((0, 0, 0), ACROSS, -b.choice((0.0, b.uniform(0.2, 1.0), b.uniform(0.2, 1.0)))):
        low, high = (-long / 2 - rim, -rim, 0), (long / 2 + rim, cells[-1][3] + rim, thick)
        pierced(b, "base", low, high, cells, "z", "body")
        step, cover = b.uniform(0.08, 0.25), b.choice(("stone", "red", "dark", "trim"))
        for x in np.arange(low[0], high[0] - step, step).tolist():  # tiles around the holes
            free = x + step < -long / 2 or x > long / 2
            for c, d in [(-rim, high[1])] if free else [(-rim, 0.0), (cells[-1][3], high[1])]:
                b.box("base", (x, c, thick), (x + 0.9 * step, d, thick + 0.015), cover)
        for i, (x0, y0, x1, y1) in enumerate(cells):
            frame(b, "base", (x0, y0, 0.5 * thick), (x1, y1, top), e, "z", "trim")
            key = "base" if i and b.chance(0.5) else part(b, "window", "sash")
            m, z = (e + g, top - 0.8 * t) if kind == "middle" else (0.0, top + g)
            lo, hi, rail = (x0 + m, y0 + m, z), (x1 - m, y1 - m, z + t), e - m + 0.06
            frame(b, key, lo, hi, rail, "z", "front")
            m += rail
            b.box(key, (x0 + m, y0 + m, z + 0.4 * t), (x1 - m, y1 - m, z + 0.6 * t), "glass")
            b.box("base", (x1 + 0.01, y0, thick), (x1 + rim / 3, y1, top), "metal")  # a hood
            if key != "base":
                pin = (x1 if kind == "top" else 0, y0, z + t / 2 * (kind == "middle"))
                axis, tip = ((1, 0, 0), (0, y1, z)) if kind == "side" else (ACROSS, (x0, y0, z))
                b.hinge(key, "base", pin, axis, 0.0, b.uniform(0.4, 1.3), opens=UP, tip=tip)
                for y in (y0 + e, y1 - e - g) if kind == "middle" else ():  # pivots
                    at = (0, y, pin[2])
                    b.cylinder("base", at, np.add(at, (0, g, 0)), t / 4, None, "metal")
    settle(b)


def vault_door(b: Builder) -> None:
    """A thick round or square door with bolts and a wheel that spins or stays; a hatch; a safe."""
    kind, r = b.choice(("round", "round", "safe", "safe", "lid")), b.uniform(0.15, 1.1)
    circle, tall = kind != "safe", r * (b.uniform(0.8, 2.0) if kind == "safe" else 1.0)
    b.size(2 * r, 3 * r, 2.4 * tall)
    b.theme(b.choice(("steel", "steel", "dark", "paint")))
    g, ft, deep = max(b.gap, 0.002), b.uniform(0.08, 0.22) * r, b.uniform(0.3, 0.8) * r
    plug, over, s = b.choice((0.06, 0.14, 0.22)) * r, b.uniform(1.06, 1.2) * r, b.choice((-1, 1))
    inner, xp, yp = r - (plug + ft) ** 2 / 4 / r - g, -g - 0.6 * ft, s * (over + 0.8 * ft + g)
    edge, door, front = abs(yp) + 0.6 * ft, part(b, "door"), -g - ft
    wide, lids, n = edge * b.uniform(1.0, 1.4), b.choice((0.4, 0.5, 0.62)) * tall, b.integer(3, 6)
    pin, pose, far = np.array((xp, yp, 0)), max(0.0, b.uniform(-1.2, 1.4)), b.uniform(1.7, 2.2)
    with b.moved((0, 0, 0), ACROSS, TAU / 4 if kind == "lid" else 0.0):
        if circle:
            b.tube("base", (0, 0, 0), (deep, 0, 0), edge, r, "body")
            lo, hi = (deep * (0.8 if kind == "lid" else 0.02), -wide, -wide), (deep, wide, wide)
            bored(b, "base", lo, hi, "x", (0, 0), 0.95 * edge, "trim")
        else:
            lo, hi = (0, -edge, r - tall - edge), (2 * deep + r / 2, edge, tall + edge - r)
            b.shell("base", lo, hi, edge - r, "-x")
        for z in (-lids - 0.26 * r, 0.26 * r - lids, lids - 0.26 * r, lids + 0.26 * r):
            b.block("base", (xp / 2, yp, z), (-xp, 0.7 * ft, 0.12 * r), "metal")
            b.cylinder("base", (xp, yp, z - r / 10), (xp, yp, z + r / 10), 0.4 * ft, None, "metal")
        with b.at(joint_motion("revolute", UP, pin, -s * pose)):
            if circle:
                with b.facing((-g, 0, 0), FRONT):
                    b.lathe(door, [(over, 0), (over, 0.8 * ft), (0.95 * over, ft)], "front")
                a = 0.84 * over * np.exp(1j * np.arange(12) * TAU / 12)
                studs(b, [(front, c.real, c.imag) for c in a], FRONT, 0.05 * r, door)
                b.cylinder(door, (plug, 0, 0), (-g, 0, 0), inner, None, "metal")
            else:
                lo, hi = (front, -over, r - tall - over), (-g, over, tall + over - r)
                rounded(b, door, lo, hi, b.choice((0.0, 0.15, 0.4)) * r, "x", "front")
                _lever(b, door, front, s * 0.6 * r, 0.3 * tall, -s, 2.0 * r)
                c = tall + inner - r
                b.box(door, (-g, -inner, -c), (plug, inner, c), "metal")
            for z in (-lids, lids):
                long, y = abs(yp) - 0.45 * r, yp / 2 + s * 0.225 * r
                b.block(door, (xp - 0.17 * ft, y, z), (0.55 * ft, long, 0.24 * r), "metal")
                b.cylinder(door, (xp, yp, z - r / 7), (xp, yp, z + r / 7), 0.42 * ft, None, "metal")
            for z in np.linspace(-0.6, 0.6, b.integer(2, 5)) * tall:  # bolts
                c = -s * (np.sqrt(inner**2 - (abs(z) + 0.2 * plug) ** 2) if circle else inner)
                b.cylinder(door, (plug, c, z), (plug, c + 0.3 * s * r, z), 0.2 * plug, None, "gold")
            b.hinge(door, "base", pin, (0, 0, -s), -pose, far - pose, closed=-pose)
            wr, z, spins = b.uniform(0.28, 0.5) * r, b.choice((0.0, -0.2 * tall)), b.chance(0.65)
            key, rod, rim = part(b, "wheel") if spins else door, 0.07 * wr + 0.002, b.chance(0.6)
            foot, hub = np.array((front - g * spins, 0, z)), np.array((-0.2 * r, 0, 0))
            b.cylinder(key, foot, foot + 1.1 * hub, 0.18 * wr, None, "metal", "handle")
            for a in 0.3 + np.arange(n) * TAU / n:
                tip = foot + hub + wr * np.array((0, np.cos(a), np.sin(a)))
                b.cylinder(key, foot + hub, tip, rod, (0.8 if rim else 2) * rod, "metal", "handle")
            if rim:
                b.torus(key, foot + hub, FRONT, wr, 1.3 * rod, "metal", "handle")
            if spins:
                b.spin(key, door, foot, FRONT, *b.choice(((-np.inf, np.inf), (-np.pi, np.pi))))
    settle(b)


def stable_door(b: Builder) -> None:
    """A door in halves, one leaf or two wide, of which both or one open; or saloon doors."""
    w, h, t = b.uniform(0.6, 1.5), b.uniform(1.2, 2.5), b.uniform(0.03, 0.06)
    b.size(0.2, 1.3 * w, 1.1 * h)
    b.theme(b.choice(("wood", "wood", "paint", "white", "any")))
    g, post, deep = max(b.gap, 0.003) + t * t / w, b.uniform(0.06, 0.4), b.uniform(0.08, 0.2)
    _portal(b, w, h, (post, post), b.uniform(0.06, 0.4), deep)
    skins, s = (b.choice(SKINS), b.choice(SKINS)), b.choice((-1, 1))
    cut, free, wings = b.uniform(0.4, 0.6) * h, b.choice((0, 1, 2, 2)), 1 + (w > b.uniform(1, 2))
    if b.chance(0.3):  # saloon doors swing both ways
        z0, z1, x = b.uniform(0.1, 0.3) * h, b.uniform(0.5, 0.8) * h, deep / 2
        for s in (-1, 1):
            door, y, far = part(b, "door", "leaf"), s * (w / 2 - t / 2 - g - 0.01), 1.4
            lo, hi = sorted((s * (g + 0.004), y))
            _leaf(b, door, (x - t / 2, lo, z0), (x + t / 2, hi, z1), skins[0])
            b.cylinder(door, (x, y, z0 - 0.03), (x, y, z1 + 0.03), 0.4 * t, None, "metal")
            for z in (z0 - 0.05 - g, z1 + 0.05 + g):
                b.block("base", (x, s * w / 2, z), (t, t + 2 * g + 0.04, 0.04), "metal")
            b.hinge(door, "base", (x, y, (z0 + z1) / 2), UP, -far, far, closed=0.0)
        return
    for q in (s, -s)[:wings]:
        y, near = q * (w / 2 - g), q * g / 2 if wings == 2 else -q * (w / 2 - g)
        a, c = sorted((y, near))
        for k, (z0, z1) in enumerate(((0.01, cut), (cut + g + 0.03, h - g))):
            to = part(b, "door", "leaf") if free in (k, 2) else "base"
            _leaf(b, to, (0, a, z0), (t, c, z1), skins[k])
            pins, m = b.choice((to, "base")), b.choice((0.03, 0.2, 0.35)) * (near - y)
            for z in (0.85 * z0 + 0.15 * z1, 0.15 * z0 + 0.85 * z1):  # bands and barrels
                b.block(to, (-0.003, y + 1.1 * m, z), (0.006, 2 * abs(m), 0.04), "metal")
                b.cylinder(pins, (0, y, z - 0.04), (0, y, z + 0.04), 0.011, None, "metal")
            if k == 0 and m > 0:  # a shelf
                b.block(to, (-0.02, (a + c) / 2, z1 + 0.012), (0.12, 0.8 * (c - a), 0.024), "trim")
            _lever(b, to, 0, near + q * 0.06, z0 + b.uniform(0.4, 0.8) * (z1 - z0), q)
            if to != "base":
                b.hinge(to, "base", (0, y, z0), UP, 0.0, b.uniform(1.2, 1.9), opens=FRONT)


def venetian_window(b: Builder) -> None:
    """A window with slats that turn, or panes that tilt among fixed ones or above a door."""
    kind = b.choice(("slat", "slat", "slat", "awning", "hopper", "middle", "upright"))
    w, h, deep = b.uniform(0.3, 1.2), b.uniform(0.3, 1.2), b.uniform(0.06, 0.14)
    n, columns, rows = b.integer(3, 9), b.choice((1, 1, 2, 3)), b.choice((1, 1, 2, 3))
    rail, t, door = b.uniform(0.03, 0.08), b.uniform(0.03, 0.045), kind != "slat" and b.chance(0.3)
    b.size(deep, columns * w, rows * h)
    b.theme()
    heights = [b.uniform(1.7, 2.1), h] if door else [h] * rows
    live, every = 1 if door else b.integer(0, rows - 1), kind != "slat" and b.chance(0.4)
    g, x, cells, z = max(b.gap, 0.002) + t * t / h / 2, 0.3 * deep, [], 0.0 if door else rail
    only, grip, pitch = b.integer(0, columns - 1), b.choice(("bar", "bow", "knob", "none")), h / n
    for k, tall in enumerate(heights):
        ys = [(rail + i * (w + rail), k == live and (every or i == only)) for i in range(columns)]
        cells += [(y, z, y + w, z + tall, moving) for y, moving in ys]
        z += tall + rail
    high = (deep, columns * (w + rail) + rail, z)
    pierced(b, "base", (0, 0, 0), high, [c[:4] for c in cells], "x", "body")
    bent, q, paint = b.choice((0.0, 0.12)), b.choice((0.0, 0.8)), b.choice(("front", "glass"))
    for y0, z0, y1, z1, moving in cells:
        m, c, u = (y0 + y1) / 2, (z0 + z1) / 2, np.linspace(-1, 1, 5)
        if kind == "slat" and moving:
            side, e = np.c_[bent * pitch * (1 - u * u), (0.42 * pitch - 0.3 * g) * u], 0.03 * pitch
            line = np.r_[side + [e, 0], side[::-1] - [e, 0]]
            for at in z0 + (np.arange(n) + 0.5) * pitch:
                key = part(b, "slat")
                with b.moved((deep / 2, 0, at), ACROSS, q):
                    profile(b, key, line, y0 + g, y1 - g, "y", paint)
                    b.cylinder(key, (0, y0 - 0.01, 0), (0, y1 + 0.01, 0), 1.3 * e, None, "metal")
                b.spin(key, "base", (deep / 2, m, at), ACROSS, -q, 1.5 - q, closed=-q)
            _lever(b, "base", 0, y1 + rail / 2, c, 1, 0.5)  # a crank that stays
            continue
        key, e = (part(b, "window", "pane"), g) if moving else ("base", 0.0)
        lo, hi = (x, y0 + e, z0 + e), (x + t, y1 - e, z1 - e)
        _leaf(b, key, lo, hi, b.choice(SKINS) if z0 == 0.0 else "panes")
        way, axis = 1 if kind == "hopper" else -1, UP if kind == "upright" else ACROSS
        tip = (x, y0, hi[2] if way > 0 else lo[2])
        if z0 == 0.0:
            _lever(b, key, x, y0 + 0.07, 1.0, 1)
        else:  # grips on fixed panes too
            b.handle(key, (x, m, tip[2] - way * 0.02), FRONT, ACROSS, 0.1, grip)
        if moving:
            pins = {"awning": (x, m, hi[2]), "hopper": (x + t, m, lo[2])}
            pin, far = pins.get(kind, (x + t / 2, m, c)), b.uniform(0.35, 1.3)
            b.hinge(key, "base", pin, axis, 0.0, far, opens=(way, 0, 0), tip=tip)
            ends = ((pin[0], y, c) for y in (y0, y1 - e)), ((pin[0], m, z) for z in (z0, z1 - e))
            for at in ends[axis == UP] if kind in ("middle", "upright") else ():  # pivots
                b.cylinder("base", at, np.add(at, np.multiply(axis, e)), t / 4, None, "metal")


CATEGORIES: dict[str, Callable[[Builder], None]] = {
    "garage_door": garage_door, "window_shutters": window_shutters, "turnstile": turnstile,
    "lift_doors": lift_doors, "skylight": skylight, "vault_door": vault_door,
    "stable_door": stable_door, "venetian_window": venetian_window,
}  # fmt: skip
