"""Things held in the hand: sprays, beaters, corkscrews, clamps, locks, cases, clips, torches."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import wraps

import numpy as np

from mam_world.fixtures import PAINTS
from mam_world.kit import Builder
from mam_world.mech import dial, rod
from mam_world.solids import (
    TAU,
    bar,
    bored,
    part,
    pierced,
    profile,
    rounded,
    settle,
    tray,
    wedge,
)  # fmt: skip

Draw = Callable[[Builder], None]
Pair = Sequence[float]
X, Y, Z = (1, 0, 0), (0, 1, 0), (0, 0, 1)


def _held(draw: Draw) -> Draw:
    """Draws upright and turned a little, or laid down along x; sets it down."""

    @wraps(draw)
    def made(b: Builder) -> None:
        flat = b.chance(0.25)
        with b.moved((0, 0, 0), Y if flat else Z, -TAU / 4 if flat else b.uniform(-0.7, 0.7)):
            draw(b)
        settle(b)

    return made


def _box(b: Builder, link: str, x: Pair, y: Pair, z: Pair, paint: str = "body") -> None:
    lo, hi = np.sort([x, y, z], axis=1).T
    b.box(link, lo, hi, paint)


def _crank(b: Builder, link: str, arm: float, r: float) -> None:
    """A hub at the local origin, an arm or two along x, knobs that grow along z."""
    h, knob, paint = r * b.uniform(2, 4), b.uniform(3, 7) * r, b.choice(("wood", "dark", "red"))
    rod(b, link, (0, 0, 0), (0, 0, h), 1.5 * r)
    bent, shape = b.choice((0.0, 0.7)) * h, b.choice(((1, 1.4, 1), (0.8, 1.7, 1.3), (1.2, 1.2, 1)))
    for s in (1, -1) if b.chance(0.2) else (1,):
        path = [(0, 0, 0.7 * h), (0.5 * s * arm, 0, 0.7 * h), (s * arm, 0, 0.7 * h + bent)]
        b.sweep(link, path, 0.7 * r, "metal", "handle")
        with b.moved((s * arm, 0, 0.6 * h + bent)):
            b.lathe(link, [(r * p, knob * k / 2) for k, p in enumerate(shape)], paint, "handle")


def _trigger(b: Builder, h: float, neck: float, g: float) -> None:
    """The head of a trigger sprayer on a neck at height h; its nozzle may turn."""
    hn, hh, w, sides = b.uniform(0.035, 0.055), b.uniform(0.018, 0.03), 0.01, b.choice((4, 6, 20))
    z, long, t, rp = h + hn, hn * b.uniform(0.75, 0.95), 0.1 * hh, 0.2 * hh
    rod(b, "base", (0, 0, h), (0, 0, h + 0.5 * hn), 1.25 * neck, "accent")
    rod(b, "base", (0, 0, h + 0.5 * hn), (0, 0, z), 0.8 * neck, "trim")
    xf, xb = -1.3 * neck - b.uniform(0.5, 0.9) * long, b.uniform(0.015, 0.045)
    head = [(xf, z), (0.7 * xb, z), (xb, z + 0.5 * hh), (0.6 * xb, z + hh), (xf, z + 0.9 * hh)]
    profile(b, "base", head, -w, w, "y", "accent")
    key, xp, zp = part(b, "trigger", "lever"), 0.85 * xf, z - rp - g
    for s in (-1, 1):
        ear = (s * (0.6 * w + g), s * (w + g))
        _box(b, "base", (xp - rp, xp + rp), ear, (zp - rp, z + rp), "accent")
    rod(b, key, (xp, -0.9 * w, zp), (xp, 0.9 * w, zp), 0.6 * rp)
    u, lean, bow = np.linspace(0, 1, 6), b.uniform(0.0, 0.25), b.uniform(-0.05, 0.2) * long
    x = xp - lean * long * u + bow * np.sin(TAU / 2 * u)
    line = np.r_[np.c_[x - t, zp - long * u], np.c_[x + 1.5 * t, zp - long * u][::-1]]
    profile(b, key, line, -0.55 * w, 0.55 * w, "y", b.choice(PAINTS), "handle")
    far = float(np.clip((-xp - 1.3 * neck - 3 * t - g) / long, 0.15, 0.5))
    b.hinge(key, "base", (xp, 0, zp), Y, 0.0, far, opens=X)
    nozzle = part(b, "nozzle", "knob") if b.chance(0.5) else "base"
    with b.facing((xf - (0 if nozzle == "base" else 0.2 * g), 0, z + 0.5 * hh), (-1, 0, 0)):
        b.cylinder(nozzle, (0, 0, 0), (0, 0, 0.5 * hh), 0.42 * hh, 0.38 * hh, "trim", sides=sides)
        rod(b, nozzle, (0, 0, 0), (0, 0, 0.9 * hh), 0.25 * hh, "dark")
        if nozzle != "base":
            b.spin(nozzle, "base", (0, 0, 0), Z)


def _pump(b: Builder, h: float, neck: float, g: float) -> None:
    """A lotion pump or an atomiser that is pressed; the spout may turn on its stem."""
    rs, d, down, low = b.uniform(0.3, 0.45) * neck, 0.6 * neck, b.uniform(0.5, 1.2) * neck, h + 0.01
    key, z, out = part(b, "pump", "button"), low + 2.45 * down + 0.005, b.uniform(2, 4) * neck
    rod(b, "base", (0, 0, h), (0, 0, low), 1.2 * neck, "accent")
    b.tube("base", (0, 0, low), (0, 0, z - 1.15 * down), 0.8 * neck + g, rs + g, "trim")
    rod(b, key, (0, 0, low + 1.1 * down), (0, 0, z), rs, "light")
    head = part(b, "spout") if b.chance(0.35) else key
    z += 0.0 if head == key else 0.3 * g
    b.lathe(head, [(1.5 * rs, z), (2 * rs, z + d), (b.uniform(1, 2) * rs, z + 1.5 * d)], "accent")
    if b.chance(0.7):
        path = [(0, 0, z + 0.8 * d), (-0.8 * out, 0, z + d), (-out, 0, z + 0.5 * d)]
        b.sweep(head, path, 0.4 * d, "accent", "handle")
    else:
        rod(b, head, (0, 0, z + 0.6 * d), (-2.6 * rs, 0, z + 0.6 * d), 0.3 * d, "dark")
    b.slide(key, "base", (0, 0, -1), 0.0, down)
    if head != key:
        b.spin(head, key, (0, 0, z), Z)


@_held
def spray_bottle(b: Builder) -> None:
    """A bottle or can with a trigger sprayer or a pump."""
    r, h, neck = b.uniform(0.022, 0.05), b.uniform(0.07, 0.22), b.uniform(0.009, 0.015)
    b.size(2 * r, 2 * r, h + 0.06)
    b.theme(b.choice(("plastic", "white", "paint", "steel", "dark")))
    mid, top = b.choice(((1, 1), (0.78, 0.95), (0.8, 0.6), (0, 0), (0, 0)))
    high, paint = h * b.uniform(0.7, 0.92), b.choice(("body", "body", "glass", "light"))
    if mid == 0:
        d = max(r * b.uniform(0.45, 1.0), 1.4 * neck)
        rounded(b, "base", (-d, -r, 0), (d, r, high), b.uniform(0.1, 0.6) * d, "z", paint)
        slope = (-0.75 * d, -0.75 * r, 0.75 * d, 0.75 * r)
        wedge(b, "base", slope, (-neck, -neck, neck, neck), high, h, paint)
        b.block("base", (-d, 0, 0.5 * high), (0.02 * d, r, 0.6 * high), "light", "decor")
    else:
        line = [(0.9 * r, 0), (r, 0.03 * h), (mid * r, 0.5 * h), (top * r, high), (neck, h)]
        b.lathe("base", line, paint)
    b.choice((_trigger, _pump))(b, h, neck, max(0.4 * b.gap, 0.0005))


@_held
def egg_beater(b: Builder) -> None:
    """A rotary egg beater or a hand drill: a big wheel with a crank drives what turns below."""
    r, h, t = b.uniform(0.03, 0.06), b.uniform(0.2, 0.35), b.uniform(0.003, 0.006)
    b.size(3 * r, 4 * r, h)
    b.theme(b.choice(("steel", "steel", "wood", "paint", "dark")))
    g, z, s, wheel = max(b.gap, 0.001), 0.62 * h, b.choice((-1, 1)), part(b, "wheel", "crank")
    d, foot = b.choice((0.0, b.uniform(0.4, 0.7))) * r, z - 1.25 * r  # a drill, or two beaters
    top = max(0.85 * h, z + 1.15 * r + 2 * t)  # the wheel and its crank pass below the grip
    _box(b, "base", (-1.5 * t, 1.5 * t), (-t, t), (foot, top), "metal")
    _box(b, "base", (-d - 3 * t, d + 3 * t), (-t, t), (foot - 2 * t, foot), "metal")
    grip = [(2 * t, 0), (3 * t, 0.07 * h), (2.5 * t, 0.23 * h), (1.5 * t, 0.25 * h)]
    grip = [(p, top + q) for p, q in grip]
    b.lathe("base", grip, b.choice(("wood", "dark", "red")), "handle")
    with b.facing((0, s * (t + g), z), (0, s, 0), X):
        b.vessel(wheel, [(r, 0), (r, 1.2 * t)], 0.15 * r, "metal", bottom=False)
        for a in np.arange(b.integer(3, 6)) * 2.4:
            tip = (0.9 * r * np.cos(a), 0.9 * r * np.sin(a), 0.6 * t)
            bar(b, wheel, (0, 0, 0.6 * t), tip, 0.2 * r, 0.8 * t)
        _crank(b, wheel, b.uniform(0.6, 1.1) * r, 0.8 * t)
        b.spin(wheel, "base", (0, 0, 0), Z)
    if not d or b.chance(0.3):  # a still handle on the other side
        b.cylinder("base", (0, -s * t, z), (0, -s * 1.3 * r, z), 1.5 * t, 2.5 * t, "wood", "handle")
    u, half, n = np.linspace(0, TAU, 15)[:-1], 0.5 * (foot - 3 * t - 0.1 * h - g), b.integer(1, 2)
    for x in (-d, d) if d else (0.0,):
        key = part(b, "beater" if d else "chuck")
        with b.moved((x, 0, 0)):
            rod(b, key, (0, 0, foot - 2.2 * t), (0, 0, 0.1 * h), 0.8 * t)
            for k in range(n if d else 0):
                wide, rise = 0.85 * d * np.cos(u), 0.1 * h + half * (1 + np.sin(u))
                wire = np.c_[wide * (k == 0), wide * k, rise]
                b.sweep(key, wire, 0.4 * t, "metal", loop=True, collision=False)
            if not d:
                c = foot - 2 * t - 0.3 * g
                b.lathe(key, [(0.8 * t, c - 0.8 * r), (2.5 * t, c - 0.5 * r), (2.5 * t, c)], "dark")
            b.spin(key, "base", (0, 0, 0), Z)


@_held
def corkscrew(b: Builder) -> None:
    """A cup over the bottle, a screw that rises or turns, often two wings beside it."""
    h, ro, wings = b.uniform(0.1, 0.18), b.uniform(0.007, 0.012), b.chance(0.65)
    b.size(4 * ro, 0.5 * h, 1.4 * h)
    b.theme(b.choice(("steel", "steel", "dark", "paint")))
    g, rs, rg = max(0.5 * b.gap, 0.0006), 0.5 * ro, b.uniform(0.8, 1.3) * ro
    half, t, mid, top = 0.4 * rg, 0.25 * rg, b.uniform(0.3, 0.5) * h, 0.75 * h
    yp, zp = ro + rg + g + 0.002, top - 1.1 * rg
    cup = max(b.uniform(0.75, 1.0) * (yp - 1.6 * half), 1.05 * ro)
    b.vessel("base", [(cup, 0), (cup, 0.6 * mid), (ro, mid)], 0.15 * cup, bottom=False)
    b.tube("base", (0, 0, mid), (0, 0, top), ro, rs + g)
    lean, long = b.uniform(0.02, 0.3), b.uniform(0.7, 0.95) * zp
    for s in (-1, 1) if wings else ():
        for x in (-1, 1):
            ends = (s * 0.7 * ro, s * (yp + half))
            _box(b, "base", (x * (t + g), x * (2 * t + g)), ends, (zp - half, zp + half))
        arm, p = part(b, "arm", "lever"), np.array([0, s * yp, zp])
        end = p + long * np.array([0, s * np.sin(lean), -np.cos(lean)])
        for q, wide, rad in ((p, t, rg), (p, 1.9 * t, 0.3 * rg), (end, t, b.uniform(1, 2) * half)):
            rod(b, arm, q - np.array((wide, 0, 0)), q + np.array((wide, 0, 0)), rad)
        bar(b, arm, p, end, 2 * half, 1.6 * t, X, "metal", "handle")
        b.hinge(arm, "base", p, X, 0.0, b.uniform(1.5, 2.0) - lean, opens=(0, s, 0))
    kind, rack = b.choice(("rise", "turn", "both")), part(b, "rack", "slider")
    screw, z = part(b, "screw", "handle") if kind == "both" else rack, top + 0.5 * g
    rod(b, rack, (0, 0, (0.7 if kind == "both" else 0.58) * mid), (0, 0, z + rs), rs)
    rod(b, rack, (0, 0, z), (0, 0, z + rs), 0.9 * ro)
    u = np.linspace(0, 1, 8 * b.integer(3, 5) + 1)
    a = TAU * (len(u) // 8) * u
    worm = np.c_[0.6 * rs * np.cos(a), 0.6 * rs * np.sin(a), 0.1 * mid + 0.5 * mid * u]
    b.sweep(screw, worm, 0.35 * rs, "metal", collision=False)
    z += rs + (0.4 * g if kind == "both" else 0)
    wide, up = b.uniform(0.7, 1.0) * (yp + 0.1 * h), z + 0.12 * h
    rod(b, screw, (0, 0, z), (0, 0, up), 0.8 * rs)
    rod(b, screw, (0, -wide, up), (0, wide, up), b.uniform(1.0, 2.4) * rs, "wood")
    if kind != "turn":
        b.slide(rack, "base", Z, 0.0, b.uniform(0.2, 0.4) * h)
    if kind != "rise":
        b.spin(screw, rack if kind == "both" else "base", (0, 0, z), Z)


@_held
def c_clamp(b: Builder) -> None:
    """A C-clamp or a bar clamp: a jaw slides on a bar, a screw turns or slides."""
    s, kind, w = b.uniform(0.04, 0.15), b.choice(("c", "bar")), b.uniform(0.05, 0.12)
    b.size(1.5 * s, 0.2 * s, 2 * s)
    b.theme(b.choice(("paint", "steel", "dark", "plastic")))
    g, th, w, d = max(0.4 * b.gap, 5e-4), b.uniform(0.12, 0.25) * s, w * s, b.uniform(0.4, 1) * s
    rs, jaw, screw = b.uniform(0.5, 0.8) * w, "base", part(b, "screw")
    bs, low, high = 1.8 * rs + g, b.uniform(0.5, 0.7) * s, s + 1.4 * th + b.uniform(0.5, 0.9) * s
    line = [(-d - bs, -th), (0.4 * th, -th), (th, 0.3 * th), (th, s - 0.3 * th), (0.4 * th, s + th),
            (bs - d, s + th), (bs - d, s), (-0.3 * th, s), (0, s - 0.3 * th), (0, 0.3 * th),
            (-0.3 * th, 0), (-d - bs, 0)]  # fmt: skip
    if kind == "bar":
        jaw, tall = part(b, "jaw"), b.uniform(1.4, 2.6) * s
        _box(b, "base", (0, 0.8 * th), (-0.5 * w, 0.5 * w), (-th, tall), "metal")
        line = [(-d - bs, -th), (th, -th), (th, 0.2 * th), (-d - bs, 0)]
        hole = [(-g, -0.5 * w - g, 0.8 * th + g, 0.5 * w + g)]
        pierced(b, jaw, (-0.5 * th, -1.5 * w, s), (1.3 * th, 1.5 * w, s + th), hole)
        _box(b, jaw, (bs - d, -0.5 * th), (-w, w), (s, s + th))
        b.slide(jaw, "base", Z, -b.uniform(0.1, 0.4) * s, tall - s - 1.2 * th)
    profile(b, "base", line, -w, w, "y")
    bored(b, jaw, (-d - bs, -bs, s - 0.2 * th), (bs - d, bs, s + 1.3 * th), "z", (-d, 0), rs + g)
    rod(b, "base", (-d, 0, -0.5 * th), (-d, 0, 0.08 * s), 1.5 * rs)
    with b.moved((-d, 0, 0)):
        rod(b, screw, (0, 0, low), (0, 0, high), 0.85 * rs)
        for z in np.linspace(low + 2 * rs, high - 2 * rs, b.integer(0, 16)):  # the thread
            b.cylinder(screw, (0, 0, z), (0, 0, z + 0.4 * rs), rs, None, "metal", collision=False)
        b.lathe(screw, [(2 * rs, low - rs), (2 * rs, low), (1.2 * rs, low + rs)], "metal")
        rad, *end = b.choice(((0.5 * rs, 0, min(5 * rs, 0.7 * d), 0), (2.2 * rs, 0, 0, 0.2 * s)))
        rod(b, screw, np.subtract((0, 0, high), end), np.add((0, 0, high), end), rad, "wood")
        if kind == "bar" or b.chance(0.6):
            b.spin(screw, jaw, (0, 0, 0), Z)
        else:
            b.slide(screw, jaw, Z, -0.25 * s, s - 0.2 * th - low - 1.2 * rs)


@_held
def padlock(b: Builder) -> None:
    """A padlock: its shackle rises or swings, with a key, a dial or a still plate."""
    w, t = b.uniform(0.03, 0.08), b.uniform(0.12, 0.25)
    h, t, r, a = b.uniform(0.7, 1.5) * w, t * w, b.uniform(0.06, 0.1) * w, b.uniform(0.27, 0.35) * w
    tall, deep, swings = b.uniform(0.6, 1.8) * w, 0.3 * h, b.chance(0.35)
    b.size(2 * t, w, h + tall)
    b.theme(b.choice(("steel", "paint", "dark", "plastic")))
    g, top = max(0.5 * b.gap, 0.0005), h * b.choice((0.5, 0.35))
    z, u, edge = b.uniform(0.35, 0.5) * h, np.linspace(0, TAU / 2, 9), b.uniform(0.05, 0.23) * w
    side = np.linspace(-TAU / 4, 0, 5)  # round below, flat where the holes begin
    foot = np.c_[w / 2 + edge * (np.cos(side) - 1), edge * (1 + np.sin(side))]
    line = [*foot, (w / 2, top), (-w / 2, top), *(foot[::-1] * (-1, 1))]
    profile(b, "base", line, -t, t, "x")
    for y0, y1, c in ((-w / 2, 0, -a), (0, w / 2, a)):
        bored(b, "base", (-t, y0, top), (t, y1, h), "z", (0, c), r + g)
    key, up = part(b, "shackle"), h + (deep + g if swings else b.choice((0.0, 0.5 * deep)))
    bow = np.c_[0 * u, a * np.cos(u), up + tall - a + b.uniform(0.9, 1.3) * a * np.sin(u)]
    b.sweep(key, np.r_[[(0, a, h - deep)], bow, [(0, -a, up - deep)]], r, "metal", "handle")
    if swings:
        b.hinge(key, "base", (0, a, h), Z, 0, b.uniform(1.5, 3.1), opens=(b.choice((-1, 1)), 0, 0))
    else:
        b.slide(key, "base", Z, h - up, b.uniform(0.4, 0.9) * deep)
    extra = b.choice(("key", "key", "dial", "plate"))
    if extra == "plate":
        b.disc("base", (-t, 0, z), (-1, 0, 0), 0.15 * w, 0.03 * w, "gold")
        return
    turn = part(b, extra, "dial")
    with b.facing((-t - 0.3 * g, 0, z), (-1, 0, 0), Z):
        if extra == "dial":
            dial(b, turn, (0, 0, 0), Z, b.uniform(0.2, 0.36) * w, b.uniform(0.1, 0.3) * w)
        else:
            long, eye = b.uniform(0.15, 0.4) * w, b.uniform(0.15, 0.25) * w
            rod(b, turn, (0, 0, -0.01 * w), (0, 0, 0.02 * w), 0.11 * w, "gold")
            b.block(turn, (0, 0, 0.6 * long), (0.1 * w, 0.04 * w, 1.2 * long), "metal")
            b.torus(turn, (0, 0, long + eye), Y, 0.8 * eye, 0.25 * eye, "metal", "handle")
        b.spin(turn, "base", (0, 0, 0), Z)


@_held
def hinged_case(b: Builder) -> None:
    """A case, a compact or a pill box: hinged lids, still clasps, sometimes a tray."""
    d, lids = b.uniform(0.02, 0.12), b.choice((1, 1, 1, b.integer(2, 6)))
    kind, share = b.choice((("box", 0.3), ("box", 0.8), ("round", 0.2))[: 3 if lids == 1 else 2])
    w = d if kind == "round" else d * b.uniform(0.7, 2.5) * (0.5 + 0.5 * lids)
    h, roof, t, far = d * b.uniform(0.3, 1.2), d * b.uniform(0.15, 0.7), 0.06 * d, b.uniform(1.6, 2)
    b.size(2 * d, 2 * w, 2 * h)
    b.theme()
    g, pitch = max(0.4 * b.gap, 4e-4), 2 * w / lids
    rest, x, z = b.choice((0.0, far, far, b.uniform(0.2, 1) * far)), d + 0.5 * t, h + g / 2

    def half(link: str, tall: float) -> None:
        if kind == "round":
            b.vessel(link, [(0.9 * d, 0), (d, 0.3 * tall), (d, tall)], t)
        else:
            tray(b, link, (-d, -w, 0), (d, w, tall), t)

    half("base", h)
    for k in range(lids):
        lid, y, n = part(b, "lid"), (k + 0.5) * pitch - w, pitch * share
        if lids > 1:
            rim = pitch / 2 - g
            _box(b, lid, (-d, d), (y - rim, y + rim), (h + g, h + g + 0.1 * d), "front")
            b.block(lid, (-1.05 * d, y, h + g + 0.05 * d), (0.1 * d, rim, 0.05 * d), "front")
            _box(b, "base", (t - d, d - t), (y - rim - t, y - rim), (0.5 * t, h))
        else:
            with b.facing((0, 0, h + g + roof), (0, 0, -1), X):
                half(lid, roof)
                if b.chance(0.5):
                    rod(b, lid, (0, 0, t), (0, 0, 1.3 * t), 0.6 * min(d, w), "glass")
            lip = -d - 0.5 * t - 0.3 * g
            _box(b, lid, (lip - t, lip), (-0.12 * w, 0.12 * w), (0.75 * h, h + 0.5 * roof), "gold")
            rod(b, lid, (lip, 0, h + 0.4 * roof), (0.5 * t - d, 0, h + 0.4 * roof), 0.8 * t)
        for link, y0, y1 in ((lid, -0.5, 0.5), ("base", -0.6, -0.52), ("base", 0.52, 0.6)):
            rod(b, link, (x, y + y0 * n, z), (x, y + y1 * n, z), 0.9 * t)
        pose = rest if lids == 1 else b.choice((0.0, 0.0, rest))
        b.hinge(lid, "base", (x, y, z), Y, 0.0, far, opens=Z, rest=pose)
    if kind == "box" and lids == 1 and rest == far:
        key, e, c = part(b, "tray", "drawer"), t + g, b.uniform(0.2, 0.4) * h
        tray(b, key, (e - d, e - w, c), (d - e, w - e, h), 0.6 * t, material="inside")
        b.handle(key, (0, 0, c + t / 2), Z, Y, 0.4 * w, b.choice(("bow", "knob")), standoff=0.5 * h)
        b.slide(key, "base", Z, 0.0, b.uniform(0.6, 0.95) * (h - c))
    elif lids == 1:
        b.block("base", (0, 0, 0.5 * h), (1.2 * d, 1.2 * w, 0.6 * h), "fabric", "content")


@_held
def clipboard(b: Builder) -> None:
    """A clipboard, a book or ring binder, or a binder clip."""
    kind, d = b.choice(("clip", "book", "fold")), b.uniform(0.03, 0.15)
    w, t = d * b.uniform(0.4, 1.2), d * b.uniform(0.03, 0.08)
    b.size(2 * d, 2 * w, 0.2 * d)
    b.theme()
    g, r, key, n = max(0.4 * b.gap, 4e-4), 0.4 * t, part(b, kind, "lever"), b.uniform(0.3, 0.8) * w
    if kind == "clip":
        _box(b, "base", (-d, d), (-w, w), (0, t))
        x, c, rise = 0.75 * d, 0.2 * d, b.uniform(0.08, 0.16) * d
        _box(b, "base", (-0.9 * d, 0.5 * d), (-0.9 * w, 0.9 * w), (t, 1.1 * t), "light")
        z, lip = t + rise, 1.1 * t + g
        line = [(x - c, lip), (x - c + 2 * r, lip), (x, z), (x + c, z + 0.6 * rise),
                (x + c, z + 0.6 * rise + r), (x - 0.2 * c, z + 2 * r)]  # fmt: skip
        profile(b, key, line, -n, n, "y", "metal", "handle")
        for s in (-1, 1):
            _box(b, "base", (x - 2 * r, x + 2 * r), (s * (n + g), s * (n + g + r)), (t, z + r))
        rod(b, key, (x, -n - g, z), (x, n + g, z), r)
        b.hinge(key, "base", (x, 0, z), Y, 0.0, 0.8 * rise / c, opens=Z, tip=(x - c, 0, t))
    elif kind == "book":
        e, far = d * b.uniform(0.1, 0.6), b.uniform(1.6, 3.1)
        rest, z = b.choice((0.0, far, b.uniform(0.4, 1.0) * far)), t + e + g
        _box(b, "base", (-d, d), (-w, w), (0, t), "accent")
        _box(b, "base", (-d, d), (w, w + t), (0, z), "accent")
        if b.chance(0.5):
            for x in np.linspace(-0.6, 0.6, b.integer(2, 5)) * d:
                b.torus("base", (x, 0.6 * w, t + 0.45 * e), X, 0.4 * e, 0.08 * e, "metal")
        else:
            _box(b, "base", (-0.95 * d, 0.95 * d), (-0.95 * w, w), (t, t + e), "light")
        _box(b, key, (-d, d), (-w, w + t), (z, z + t), "accent")
        b.hinge(key, "base", (0, w + t, z), X, 0.0, far, opens=Z, rest=rest)
    else:
        h, q, up = d * b.uniform(0.6, 1.0), d * b.uniform(0.25, 0.5), b.choice((0, 1))
        line = [(-q, 0), (q, 0), (r, h), (r - t / 4, h), (q - t, t / 4), (t - q, t / 4),
                (t / 4 - r, h), (-r, h)]  # fmt: skip
        profile(b, "base", line, -w, w, "y", "dark")
        for s, link in ((-1, key), (1, part(b, kind, "lever"))):
            x, far = s * (2 * r + g), TAU / 2 - np.arctan(q / h) - 0.4
            rod(b, link, (x, -n, h), (x, n, h), r)
            path = [(x, -n, h), (x, -0.4 * n, h + d), (x, 0.4 * n, h + d), (x, n, h)]
            b.sweep(link, path, 0.6 * r, "metal", "handle")
            b.hinge(link, "base", (x, 0, h), Y, 0, far, opens=(s, 0, 0), rest=far * up)


@_held
def torch(b: Builder) -> None:
    """A flashlight whose switch slides or whose head or tail turns, or a power drill."""
    long, r = b.uniform(0.1, 0.28), b.uniform(0.012, 0.024)
    b.size(2 * r, 2 * r, long)
    b.theme(b.choice(("dark", "steel", "plastic", "paint", "white")))
    if b.chance(0.5):
        return _drill(b, long, 1.6 * r)
    g, kind = max(0.4 * b.gap, 5e-4), b.choice(("switch", "switch", "head", "tail"))
    b.lathe("base", [(r, 0), (r, 0.97 * long), (0.9 * r, long)])
    top = part(b, "head", "knob") if kind == "head" else "base"
    end = part(b, "cap", "knob") if kind == "tail" else "base"
    z, hl, low = long + (g if kind == "head" else 0), 0.25 * long, -g if kind == "tail" else 0
    q = b.uniform(1.15, 2.0) * r
    line = [(1.05 * r, z), (1.05 * r, z + 0.3 * hl), (q, z + 0.6 * hl), (q, z + hl)]
    b.lathe(top, line, "trim", sides=b.choice((8, None, None)))
    rod(b, top, (0, 0, z + hl), (0, 0, z + 1.02 * hl), 0.85 * q, "glass")
    rod(b, end, (0, 0, -0.15 * long), (0, 0, low), 1.05 * r, "trim")
    x, z0, z1, tab = -r - g, 0.5 * long, 0.8 * long, b.uniform(0.04, 0.08) * long
    _box(b, "base", (x + 0.3 * g, -0.8 * r), (-0.4 * r, 0.4 * r), (z0, z1), "dark")
    link = part(b, "switch", "slider") if kind == "switch" else "base"  # or a still switch
    b.block(link, (x - 0.15 * r, 0, z0 + tab), (0.3 * r, 0.5 * r, 2 * tab), "red", "handle")
    if kind == "switch":
        b.slide(link, "base", Z, 0.0, z1 - z0 - 2 * tab)
        return
    b.spin(end if kind == "tail" else top, "base", (0, 0, 0), Z)


def _drill(b: Builder, long: float, r: float) -> None:
    """A power drill: the chuck turns, the trigger slides; still vents and battery."""
    hr, lean, g = b.uniform(0.4, 0.6) * r, b.uniform(0.0, 0.3) * long, max(0.4 * b.gap, 5e-4)
    xh, low, nose = b.uniform(0.5, 0.8) * long, -b.uniform(0.6, 0.9) * long, b.uniform(0.6, 0.9) * r
    with b.facing((0, 0, 0), X):
        b.lathe("base", [(nose, 0), (r, 0.3 * long), (r, 0.85 * long), (0.6 * r, long)])
    xt, xe = xh - 1.2 * hr, xh + 1.2 * hr
    profile(b, "base", [(xe, 0), (xt, 0), (xt + lean, low), (xe + lean, low)], -hr, hr, "y")
    pack = ((xt + lean - 2 * hr, -1.3 * hr, low - 1.2 * hr), (xe + lean + hr, 1.3 * hr, low))
    rounded(b, "base", *pack, hr)
    for x in np.linspace(0.6, 0.8, b.integer(3, 6)) * long:  # still vents
        b.block("base", (x, 0, 0.3 * r), (0.02 * long, 2.02 * r, 0.5 * r), "dark", "decor")
    tip, key = part(b, "chuck", "knob"), part(b, "trigger", "button")
    with b.facing((-0.5 * g, 0, 0), (-1, 0, 0)):
        b.lathe(tip, [(0.8 * nose, 0), (0.8 * nose, 0.5 * r), (0.3 * nose, 1.3 * r)], "dark")
        rod(b, tip, (0, 0, 0), (0, 0, 1.5 * r + b.uniform(0, 0.6) * long), 0.1 * r)
        b.spin(tip, "base", (0, 0, 0), Z)
    z, move = -1.2 * r - 0.1 * long, 0.35 * hr
    x = xt + lean * (z + 0.07 * long) / low - move - g
    b.block(key, (x - 0.4 * hr, 0, z), (0.8 * hr, 1.2 * hr, 0.14 * long), "dark", "handle")
    b.slide(key, "base", X, 0.0, move)


CATEGORIES: dict[str, Callable[[Builder], None]] = {
    "spray_bottle": spray_bottle, "egg_beater": egg_beater, "corkscrew": corkscrew,
    "c_clamp": c_clamp, "padlock": padlock, "hinged_case": hinged_case, "clipboard": clipboard,
    "torch": torch,
}  # fmt: skip
