"""Devices and cabinets: microscopes, scanners, vending machines, tills, fuse boxes, racks."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mam_world.kit import Builder
from mam_world.mech import dial, feet, studs
from mam_world.solids import TAU, part, pierced, profile, rounded, settle, tray

Vec = Sequence[float]
PAINTS, UP, FRONT = ("dark", "metal", "light", "accent"), (0, 0, 1), (-1, 0, 0)


def _start(b: Builder, d: float, w: float, h: float, *themes: str) -> tuple[float, int]:
    b.size(d, w, h)
    b.theme(b.choice(themes or ("any",)))
    return max(b.gap, 0.001), b.choice((-1, 1))


def _keys(b: Builder, to: str, wide: float, tall: float, n: int, m: int, rise: float) -> None:
    dx, dy, paint = tall / n, wide / m, b.choice(("light", "dark", "trim"))
    for k in range(n * m):
        at = (k // m + 0.5) * dx - tall / 2, (k % m + 0.5) * dy - wide / 2, rise / 2
        hue = b.choice((paint, "accent", "red"), p=(0.9, 0.06, 0.04))
        b.block(to, at, (0.76 * dx, 0.8 * dy, rise), hue, "decor")


def _still(b: Builder, to: str, at: Vec, wide: float, tall: float, kinds: str,
           normal: Vec = FRONT) -> None:  # fmt: skip
    kind, s, a, c, n = b.choice(kinds.split()), min(wide, tall), tall / 2, wide / 2, b.integer(1, 4)
    rows, columns = (max(1, min(7, round(n * v / s))) for v in (tall, wide))
    with b.facing(at, normal):
        if kind == "keys":
            _keys(b, to, wide, tall, rows, columns, 0.12 * s / n)
        elif kind == "grille":
            for x in np.linspace(-0.9 * a, 0.9 * a, n + 4):
                b.block(to, (x, 0, 0.02 * s), (a / (n + 4), 1.9 * c, 0.04 * s), "dark", "decor")
        elif kind == "knob":
            dial(b, to, (0, 0, 0), UP, 0.4 * s, 0.3 * s)
        else:
            b.box(to, (-a, -c, 0), (a, c, 0.04 * s), b.choice((*PAINTS, "front")))
            x, y = {"screen": (0.85 * a, 0.9 * c), "slot": (0.15 * a, 0.7 * c)}.get(kind, (a, c))
            b.box(to, (-x, -y, 0.04 * s), (x, y, 0.06 * s), "screen", "decor")


def _door(b: Builder, low: Vec, high: Vec, kind: str, far: float, rest: float = 0.0) -> None:
    door, (x0, y0, z0), (x1, y1, z1), side = part(b, "door"), low, high, b.choice((-1, 1))
    w, h, y, z = y1 - y0, z1 - z0, y1 if side > 0 else y0, (z0 + z1) / 2
    if kind == "mesh":
        us, vs = (np.linspace(0.05, 0.95, b.integer(5, 12)) for _ in range(2))
        p, q, cells = 0.7 * w * (us[1] - us[0]), 0.7 * h * (vs[1] - vs[0]), (us[:-1], vs[:-1])
        spots = [(y0 + u * w, z0 + v * h) for u in cells[0] for v in cells[1]]
        holes = [(u, v, u + p, v + q) for u, v in spots]
        pierced(b, door, low, high, holes, "x", "front")
    else:
        b.front(door, low, high, kind)
    holder, r = b.choice((door, "base")), 0.4 * (x1 - x0)
    for v in (z0 + 0.12 * h, z1 - 0.2 * h)[: b.choice((0, 2))]:
        b.cylinder(holder, (x1, y, v), (x1, y, v + 0.08 * h), r, None, "metal")
    at, grip = (x0, y - side * 0.9 * w, z), b.choice(("bar", "bow", "knob", "recessed", "none"))
    b.handle(door, at, FRONT, UP, 0.25 * h, grip)
    if kind == "slab":
        _still(b, door, (x0, (y0 + y1) / 2, z0 + 0.8 * h), 0.4 * w, 0.12 * h, "plate grille knob")
    b.hinge(door, "base", (x1, y, z), UP, 0.0, far, opens=FRONT, rest=rest)


def _flap(b: Builder, low: Vec, high: Vec, out: int) -> None:
    flap, t, (x0, y0, _), (x1, y1, z1) = part(b, "flap", "door"), high[0] - low[0], low, high
    x, z = (x0 + x1) / 2, z1 - t / 2
    b.box(flap, low, (x1, y1, z), b.choice(("glass", "front", "metal", "dark")))
    b.cylinder(flap, (x, y0, z), (x, y1, z), t / 2, None, "metal")
    b.hinge(flap, "base", (x, y0, z), (0, out, 0), 0.0, b.uniform(0.7, 1.4))


def _dials(b: Builder, to: str, spots: Sequence[Vec], normal: Vec, r: float, moves: bool,
           *kinds: str) -> None:  # fmt: skip
    kind = b.choice(kinds or ("flute", "plain", "skirt", "bar", "pointer", "cone", "dome"))
    paint, h, lift = b.choice(PAINTS), r * b.uniform(0.5, 1.3), max(0.5 * b.gap, 0.0004)
    limits = {} if b.chance(0.3) else {"lower": 0.0, "upper": b.uniform(2.0, 5.2)}
    for spot in spots:
        foot = (np.asarray(spot, float) + (lift * moves) * np.asarray(normal, float)).tolist()
        link = part(b, "knob") if moves else to
        dial(b, link, foot, normal, r, h, kind, paint)
        if moves:
            b.spin(link, to, foot, normal, **limits)


def microscope(b: Builder) -> None:
    """A stand with eyepieces: focus knobs turn, the stage slides, objectives turn."""
    h = b.uniform(0.2, 0.5)
    d, w, t = h * b.uniform(0.5, 0.8), h * b.uniform(0.3, 0.6), h * b.uniform(0.04, 0.1)
    g, _ = _start(b, d, w, h, "white", "dark", "steel", "paint")
    moves, q, xo = b.choice(("f", "s", "n", "fn", "fs", "fsn")), b.uniform(0.1, 0.18) * w, -0.1 * d
    x0, a, half, top = 0.22 * d, 0.18 * d, b.uniform(0.3, 0.55) * w, 0.46 * h
    x, z, r, hole = x0 + a / 2, t + 0.14 * h, b.uniform(0.06, 0.09) * h, 0.05 * d
    rounded(b, "base", (-0.5 * d, -w / 2, 0), (0.5 * d, w / 2, t), b.uniform(0.02, 0.48) * w)
    stage, back = (part(b, "stage", "slider"), x0 - g) if "s" in moves else ("base", x0)
    pierced(b, stage, (-0.42 * d, -half, top - 0.03 * h), (back, half, top),
            [(xo - hole, -hole, xo + hole, hole)], "z", "dark")  # fmt: skip
    b.box(stage, (back - 0.1 * d, -0.8 * q, top - 0.08 * h), (back, 0.8 * q, top - 0.03 * h))
    for y in (-0.5 * half, 0.5 * half):
        b.block(stage, (xo + 0.05 * d, y, top), (0.2 * d, 0.1 * half, 0.02 * h), "metal")
    if stage != "base":
        b.slide(stage, "base", UP, -0.04 * h, 0.035 * h, closed=0.0)
    tall = b.choice((0.78, 0.3)) * h  # an arm, or a block that carries a pillar
    b.box("base", (x0, -q, t), (x0 + a, q, tall), "trim")
    b.cylinder("base", (x, 0, tall), (x, 0, 0.88 * h), 0.4 * a, None, "metal")
    b.cylinder("base", (xo, 0, 0), (xo, 0, t + 0.05 * h), 0.1 * d, 0.08 * d, "metal")
    for s in (-1, 1):
        _dials(b, "base", [(x, s * q, z)], (0, s, 0), r, "f" in moves, "flute", "plain", "skirt")
    b.box("base", (-0.25 * d, -1.4 * q, 0.78 * h), (x0 + a, 1.4 * q, 0.88 * h))
    rn, tilt, head = b.uniform(0.11, 0.15) * d, b.choice((0.0, 0.25)), "base"
    with b.moved((xo - 0.5 * rn, 0, 0.78 * h), (0, 1, 0), tilt):
        b.cylinder("base", (0, 0, -0.03 * h), (0, 0, 0.03 * h), 0.6 * rn, None, "metal")
        nose, z = (part(b, "turret", "dial"), -0.5 * g) if "n" in moves else ("base", 0.0)
        z, n = z - 0.03 * h, b.integer(3, 5)
        b.lathe(nose, [(0.75 * rn, z - 0.04 * h), (rn, z - 0.02 * h), (rn, z)], "dark")
        for k in range(n):
            turned, long = b.moved((0, 0, 0), UP, TAU * k / n), b.uniform(0.06, 0.12) * h
            with turned, b.moved((0.58 * rn, 0, z - 0.03 * h), (0, 1, 0), -tilt):
                b.cylinder(nose, (0, 0, -long), (0, 0, 0), 0.14 * rn, 0.26 * rn, "metal")
        if nose != "base":
            b.spin(nose, "base", (0, 0, 0), UP)
    with b.moved((xo, 0, 0.88 * h), (0, 1, 0), -b.uniform(0.2, 1.0)):
        r, n = b.uniform(0.025, 0.045) * h, b.choice((1, 2, 2))
        b.block(head, (0, 0, 0), (3.6 * r, (4 * n - 1) * r, 0.1 * h), "trim")
        for y in (0.0,) if n == 1 else (-2 * r, 2 * r):
            b.cylinder(head, (0, y, 0), (0, y, 0.16 * h), r, None, "metal")
            b.cylinder(head, (0, y, 0.14 * h), (0, y, 0.2 * h), 1.3 * r, 1.1 * r, "rubber")


def flatbed_scanner(b: Builder) -> None:
    """A lid hinged at the back over glass, ribs or a body with a paper tray; the panel is still."""
    kind, w, t, e = b.choice(("scanner", "copier", "press")), b.uniform(0.25, 0.6), 0.02, 0.012
    h = b.uniform(0.3, 0.9) if kind == "copier" else b.uniform(0.04, 0.11)
    d, lid, low = w * b.uniform(0.6, 1.5), part(b, "lid"), 0.0
    g, s = _start(b, d, w, h + t, "white", "dark", "steel", "plastic")
    z, t, p = h + g, t * b.uniform(0.6, 2.0), b.uniform(0.04, 0.12)
    if kind == "press":
        t = b.uniform(0.5, 1.0) * h
        tray(b, "base", (0, -w / 2, 0.2 * h), (d, w / 2, h), e, "z", 1, "body", 0.4 * h)
        tray(b, lid, (0, -w / 2, z), (d, w / 2, z + t), e, "z", -1, "front", 0.6 * t)
        feet(b, (0, -w / 2), (d, w / 2), 0.2 * h)
        for y in np.linspace(-0.42, 0.38, b.integer(5, 10)) * w:
            for to, v in (("base", 0.6 * h), (lid, z + 0.2 * t)):
                b.box(to, (e, y, v), (d - e, y + 0.04 * w, v + 0.2 * t), "dark")
        b.handle(lid, (0, 0, z + t / 2), FRONT, (0, 1, 0), 0.7 * w, b.choice(("bar", "bow")))
    else:
        rounded(b, lid, (0, -w / 2, z), (d, w / 2, z + t), 0.04 * w, "z", "front")
        if b.chance(0.5):  # a sheet feeder with its tray
            tall, (y0, y1) = b.uniform(1.2, 2.5) * t, sorted((-s * 0.47 * w, s * 0.1 * w))
            rounded(b, lid, (0.4 * d, y0, z + t), (d, y1, z + t + tall), 0.4 * tall, "y", "trim")
        if kind == "copier":  # a paper tray, and above it the bay where the sheets come out
            to, low, y, z1 = part(b, "drawer"), 0.8 * h, w / 2 - e - g, b.uniform(0.2, 0.5) * h
            b.shell("base", (0, -w / 2, 0), (d, w / 2, z1), e, "-x")
            b.shell("base", (0, -w / 2, z1), (d, w / 2, low), e, b.choice(("-x", "-x,-y", "-x,+y")))
            b.box(to, (0, -y, e + g), (e, y, z1 - e - g), "front")
            b.handle(to, (0, 0, 0.6 * z1), FRONT, (0, 1, 0), 0.3 * w, b.choice(("recessed", "bar")))
            b.drawer_box(to, (e, -y, e + g), (0.9 * d, y, 0.7 * z1))
            b.slide(to, "base", FRONT, 0.0, b.uniform(0.4, 0.75) * d)
        rounded(b, "base", (0, -w / 2, low), (d, w / 2, h), 0.02 * w)
        b.box("base", (0.1 * d, -0.4 * w, h), (0.9 * d, 0.4 * w, h + 0.3 * g), "glass", "decor")
        y0, y1 = sorted((s * 0.5 * w, s * b.choice((0.5, 0.0, -0.5)) * w - s * p))
        b.box("base", (-p, y0, low + 0.3 * (h - low)), (0, y1, h), "trim")
        for k in np.arange(0.25, 1, 0.5):
            at = (-p / 2, y0 + k * (y1 - y0), h)
            _still(b, "base", at, 0.4 * (y1 - y0), 0.6 * p, "keys keys screen plate", UP)
    b.hinge(lid, "base", (d, 0, z), (0, 1, 0), 0.0, 1.4, opens=UP, rest=b.choice((0, 0, 0, 0.6)))


def vending_machine(b: Builder) -> None:
    """A cabinet for goods or tickets, or gumball machines: flap, door and knob move."""
    kind, r = b.choice(("goods", "goods", "ticket", "gum", "gum")), b.uniform(0.08, 0.2)
    if kind in ("goods", "ticket"):
        return _cabinet(b, kind == "goods")
    post, n, h = b.uniform(0.0, 0.9), b.integer(1, 3), r * b.uniform(1.6, 3)
    g, _ = _start(b, 2 * r, 2.3 * n * r, post + h + 2 * r, "paint", "plastic", "steel", "dark")
    x, z = -0.8 * r, post + 0.66 * h
    b.box("base", (-0.9 * r, -1.15 * n * r, post - 0.03), (0.9 * r, 1.15 * n * r, post), "trim")
    if post > 0.2:
        b.lathe("base", [(r, 0), (0.9 * r, 0.02), (0.25 * r, 0.05), (0.2 * r, post)], "metal")
    for y in (np.arange(n) - (n - 1) / 2) * 2.3 * r:
        b.box("base", (x, y - 0.8 * r, post), (-x, y + 0.8 * r, post + h))
        with b.moved((0, y, post + h)):
            b.sphere("base", (0, 0, 0.85 * r), r * b.uniform(0.9, 1.0), "glass")
            b.lathe("base", [(0.5 * r, 1.7 * r), (0.6 * r, 1.8 * r), (0.1 * r, 2 * r)], "trim")
        b.block("base", (x, y, z), (0.1 * r, 0.9 * r, 0.9 * r), "metal")
        _dials(b, "base", [(x - 0.05 * r, y, z)], FRONT, 0.35 * r, b.chance(0.6), "bar", "cross")
        _still(b, "base", (x, y, post + 0.92 * h), 0.6 * r, 0.1 * h, "slot plate")
        low = (x - 0.12 * r - g, y - 0.4 * r, post + 0.06 * h)
        _flap(b, low, (x - g, y + 0.4 * r, post + 0.3 * h), 1)
    settle(b)


def _cabinet(b: Builder, goods: bool) -> None:
    w, h, d, t = b.uniform(0.4, 1.1), b.uniform(0.9, 2.0), b.uniform(0.3, 0.8), 0.02
    g, s = _start(b, d, w, h)
    col, z0, n, m = 0.3 * w, b.uniform(0.07, 0.2) * h, b.integer(3, 6), b.integer(3, 6)
    (y0, y1), z1 = sorted((-s * (w / 2 - 2 * t), s * (w / 2 - col))), z0 + 0.14 * h
    mid, wide, what = (y0 + y1) / 2, y1 - y0, b.choice(("flap", "door", "both"))
    holes = [(y0, z0, y1, z1), (y0, 0.4 * h, y1, 0.95 * h)][: 1 + goods]
    pierced(b, "base", (0, -w / 2, 0), (t, w / 2, h), holes, "x", b.choice(("body", "front")))
    b.shell("base", (t, -w / 2, 0), (d, w / 2, h), t, "-x")
    if what != "door":
        _flap(b, (0.2 * t, y0 + g, z0 + g), (0.8 * t, y1 - g, z1 - g), b.choice((-1, -1, 1)))
    for k in range(n * m * goods):
        z, y, p = (0.4 + 0.55 * (k // m) / n) * h, y0 + (k % m + 0.5) * wide / m, wide / m
        b.box("base", (2 * t, y - p / 2, z), (0.7 * d, y + p / 2, z + t / 2), "metal")
        b.cylinder("base", (0.3 * d, y, z), (0.3 * d, y, z + 0.35 * h / n), 0.3 * p)
    if goods and what == "flap":
        b.box("base", (0.2 * t, y0, 0.4 * h), (0.8 * t, y1, 0.95 * h), "glass")
    elif not goods:
        _still(b, "base", (0, mid, 0.65 * h), wide, 0.25 * h, "screen")
    if what != "flap":
        low, high, style = (0.38 * h, 0.97 * h, "glass") if goods else (z1 + g, 0.44 * h, "slab")
        _door(b, (-g - t, y0 - t, low), (-g, y1 + t, high), style, b.uniform(1.1, 1.5))
    for k in b.rng.permutation(5)[: b.integer(1, 5)]:
        at = (0, s * (w - col) / 2, (0.42 + 0.1 * k) * h)
        _still(b, "base", at, 0.6 * col, 0.07 * h, "keys screen grille plate knob slot")


def cash_register(b: Builder) -> None:
    """A drawer slides below a body of still keys; the display tilts or stands fixed."""
    w, d, hd = b.uniform(0.28, 0.55), b.uniform(0.28, 0.5), b.uniform(0.07, 0.14)
    kind, tall = b.choice(("sloped", "sloped", "flat")), b.uniform(0.15, 0.4)
    g, s = _start(b, d, w, hd + tall, "dark", "plastic", "white", "wood", "steel")
    t, box, x, cut = 0.012, part(b, "drawer"), 0.7 * d, b.uniform(0.55, 0.8)
    face, e = b.choice(((-g - t, g), (0.0, t + g)))
    b.shell("base", (0, -w / 2, 0), (d, w / 2, hd), t, "-x")
    b.box(box, (face, -w / 2 + e, e), (face + t, w / 2 - e, hd - e), "front")
    b.drawer_box(box, (face + t, t + g - w / 2, t + g), (0.9 * d, w / 2 - t - g, 0.8 * hd), 0.006)
    for y in np.linspace(-0.4, 0.4, b.integer(3, 7))[1:-1] * w:
        b.box(box, (face + t, y, t + g + 0.006), (0.8 * d, y + 0.004, 0.6 * hd), "dark")
    b.handle(box, (face, 0, hd / 2), FRONT, (0, 1, 0), 0.3 * w, b.choice(("none", "cup", "bar")))
    _still(b, box, (face, s * 0.35 * w, 0.6 * hd), 0.03, 0.03, "knob slot")
    b.slide(box, "base", FRONT, 0.0, b.uniform(0.4, 0.85) * d, rest=b.choice((0.0, 0.0, 0.05)))
    z, top = hd + b.uniform(0.1, 0.5) * tall, hd + 0.75 * tall
    if kind == "flat":
        b.cylinder("base", (x, 0, hd), (x, 0, top), 0.02, None, "metal")
        b.box("base", (0.4 * d, s * 0.36 * w - 0.1 * w, hd), (d, s * 0.36 * w + 0.1 * w, z))
        _still(b, "base", (x, s * 0.36 * w, z), 0.18 * w, 0.3 * d, "keys screen grille", UP)
    else:
        bow = [(0.03 * d, hd), (d, hd), (d, top), (0.6 * d, top), (0.03 * d, z)]
        profile(b, "base", bow, -0.48 * w, 0.48 * w, "y", b.choice(("body", "trim")))
        long, lean = float(np.hypot(0.57 * d, top - z)), -float(np.arctan2(top - z, 0.57 * d))
        for y, share in ((-s * (1 - cut), cut), (s * cut, 1 - cut)):
            n, rise = b.integer(4, 7), b.choice((0.008, 0.03))
            with b.moved((0.315 * d, 0.46 * w * y, (z + top) / 2), (0, 1, 0), lean):
                _keys(b, "base", 0.85 * w * share, 0.8 * long, n, round(10 * share), rise)
    high, wide, v = b.uniform(0.1, 0.25), b.uniform(0.3, 0.9) * w, top + 0.04
    to = part(b, "screen", "tilt") if b.chance(0.6) else "base"
    foot = (0.024, max(0.06, 0.27 * wide), 2 * (0.028 - 0.4 * min(g, 0.03)))
    b.block("base", (x, 0, top), foot, "trim")
    b.cylinder(to, (x, -0.06, v), (x, 0.06, v), 0.012, None, "dark")
    b.box(to, (x - 0.03, -wide / 2, v), (x - 0.005, wide / 2, v + high))
    _still(b, to, (x - 0.03, 0, v + high / 2), 0.9 * wide, 0.85 * high, "screen")
    if to != "base":
        b.hinge(to, "base", (x, 0, v), (0, 1, 0), -0.2, b.uniform(0.2, 0.5), closed=0.0)


def fuse_box(b: Builder) -> None:
    """A cabinet with a door over rows of breakers of which a few toggle, or an isolator or stop."""
    small, rows, n = b.choice(("", "", "", "isolator", "stop")), b.integer(1, 3), b.integer(4, 10)
    w = b.uniform(0.07, 0.2) if small else b.uniform(0.2, 0.7)
    h, d, t = w * b.uniform(0.8, 2.0), w * b.uniform(0.25, 0.6), 0.03 * w
    g, _ = _start(b, d, w, h, "white", "steel", "dark", "paint")
    for y in np.linspace(-0.3, 0.3, b.integer(0, 4)) * w:  # conduits
        b.cylinder("base", (0.6 * d, y, h - t), (0.6 * d, y, 1.12 * h), 0.05 * w, None, "metal")
    if small:
        rounded(b, "base", (0.3 * d, -w / 2, 0), (d, w / 2, h), 0.06 * w, "x")
        rounded(b, "base", (0, -0.47 * w, 0.02 * h), (0.3 * d, 0.47 * w, 0.98 * h), t, "x", "gold")
        studs(b, [(0, y * w, z * h) for y in (-0.4, 0.4) for z in (0.08, 0.92)], FRONT, 0.04 * w)
        r, low, key = b.uniform(0.2, 0.33) * w, 0.1 * w + g, part(b, "knob", "switch")
        with b.facing((0, 0, h / 2), FRONT):
            b.cylinder("base", (0, 0, 0), (0, 0, 0.1 * w), 1.25 * r, None, "dark")
            if small == "isolator":
                dial(b, key, (0, 0, low), UP, r, 0.9 * r, b.choice(("bar", "cross")), "red")
                return b.spin(key, "base", (0, 0, 0), UP, 0.0, np.pi / 2)
            b.lathe(key, [(r, low + 0.2 * r), (r, low + 0.4 * r), (0.6 * r, low + 0.7 * r)], "red")
            return b.slide(key, "base", (0, 0, -1), 0.0, 0.2 * r)
    pitch, high, x, left = 0.8 * w / n, min(0.4 * h / rows, 0.15 * w), 0.5 * d, b.integer(0, 3)
    b.shell("base", (0, -w / 2, 0), (d, w / 2, h), t, "-x")
    b.box("base", (x, -w / 2 + t, t), (x + t, w / 2 - t, h - t), "light")
    door, deep, r = not left or b.chance(0.6), 0.12 * d, min(0.2 * pitch, 0.04 * d)
    for k in range(rows * n):
        z, y, to = (k // n + 0.5) * h / rows, (k % n + 0.5 - n / 2) * pitch, "base"
        b.block("base", (x - deep / 2, y, z), (deep, 0.94 * pitch, high), "dark")
        if left and (b.chance(0.3) or k == rows * n - 1):
            to, left = part(b, "switch"), max(left - 1, 0)
        at, q = (x - deep - r - (0 if to == "base" else g), y, z), b.uniform(0.3, 0.5)
        b.cylinder(to, (at[0], y - 0.3 * pitch, z), (at[0], y + 0.3 * pitch, z), r, None, "light")
        with b.moved(at, (0, 1, 0), q):
            b.box(to, (-3 * r, -0.25 * pitch, -0.6 * r), (0, 0.25 * pitch, 0.6 * r), "light")
        if to != "base":
            b.hinge(to, "base", at, (0, 1, 0), -2 * q, 0.0)
    if door:
        style, ajar = b.choice(("slab", "slab", "glass", "framed")), b.choice((0.0, 0.0, 1.8))
        _door(b, (-g - t, -w / 2, 0), (-g, w / 2, h), style, 2.1, ajar)


def _panel(b: Builder, wide: float, tall: float, rows: int, most: int) -> None:
    pitch, first = tall / rows, b.integer(0, rows - 1)
    for i in range(rows):
        x, moves = ((i + 0.5) / rows - 0.5) * tall, most > 0 and (i == first or b.chance(0.3))
        n = int(np.clip(wide / pitch * b.uniform(0.7, 1.6), 1, most if moves else 9))
        most, size, long = most - n * moves, min(pitch, wide / n), 0.42 * pitch
        ys, a = ((np.arange(n) + 0.5) / n - 0.5) * wide, 0.05 * size
        if not moves and b.chance(0.4):
            _still(b, "base", (x, 0, 0), 0.9 * wide, 0.6 * pitch, "keys grille", UP)
        elif b.chance(0.7):
            _dials(b, "base", [(x, y, 0) for y in ys], UP, b.uniform(0.25, 0.4) * size, moves)
        else:
            for y in ys:
                at, to = b.uniform(-0.7, 0.7) * long, part(b, "fader") if moves else "base"
                b.block("base", (x, y, 0), (2 * long, 2 * a, a), "dark", "decor")
                z = 2 * a + (0.3 * b.gap if moves else -1.5 * a)
                b.block(to, (x + at, y, z), (4 * a, 8 * a, 3 * a), b.choice(PAINTS))
                if moves:
                    b.slide(to, "base", (1, 0, 0), 2 * a - long - at, long - 2 * a - at, closed=0.0)


def radio_set(b: Builder) -> None:
    """A radio, amplifier, oscilloscope or mixer: knobs and faders, an antenna or a handle."""
    kind = b.choice(("grille", "screen", "grille keys plate", "mixer", "mixer"))
    w, cut, run = b.uniform(0.2, 0.6), b.uniform(0.3, 0.6), b.choice((0.7, 1.0))
    h = w * (b.uniform(0.08, 0.2) if kind == "mixer" else b.uniform(0.2, 0.8))
    d, f, low = w * b.uniform(0.25, 0.9), b.choice((0.01, 0.05)) * w, b.uniform(0.3, 0.9) * h
    g, s = _start(b, d, w, h)
    feet(b, (0, -w / 2), (d, w / 2), f + 0.02 * w)
    if kind == "mixer":
        shape = [(0, f), (d, f), (d, f + h), (run * d, f + h), (0, f + low)]
        profile(b, "base", shape, -w / 2, w / 2, "y")
        long, n = float(np.hypot(run * d, h - low)), b.integer(12, 24)
        with b.moved((0, 0, f + low), (0, 1, 0), -float(np.arctan2(h - low, run * d))):
            with b.moved((0.15 * long, 0, 0)):
                _keys(b, "base", 0.92 * w, 0.24 * long, 1, n, 0.01 * w)
            with b.moved((0.65 * long, 0, 0)):
                return _panel(b, 0.9 * w, 0.6 * long, b.integer(2, 4), b.integer(2, 6))
    rounded(b, "base", (0, -w / 2, f), (d, w / 2, f + h), b.choice((0.004, 0.04)) * w, "x")
    with b.facing((0, s * 0.47 * w * (1 - cut), f + h / 2), FRONT):
        _panel(b, 0.9 * cut * w, 0.85 * h, b.integer(1, 3), b.integer(1, 5))
    _still(b, "base", (0, -s * 0.47 * w * cut, f + h / 2), 0.85 * (1 - cut) * w, 0.75 * h, kind)
    extra, z, r, x = b.choice(("handle", "antenna", "none")), f + 0.8 * h, 0.012 * w + 0.002, d / 2
    if extra == "handle":  # between two ears on the top
        key, y, z, top = part(b, "handle"), 0.46 * w, f + h + 3 * r, f + h + 0.3 * w + 7 * r
        for q in (-y, y):
            ear = q + np.sign(q) * 2 * r
            b.block("base", (x, ear, z - 3 * r), (4 * r, 2 * r, 10 * r), "dark")
            b.cylinder(key, (x, q - r, z), (x, q + r, z), 1.5 * r, None, "metal")
            b.cylinder(key, (x, q, z), (x, q, top), r, None, "metal", "handle")
        b.cylinder(key, (x, -y, top), (x, y, top), 1.3 * r, None, "dark", "handle")
        b.hinge(key, "base", (x, 0, z), (0, 1, 0), 0.0, b.uniform(0.8, 1.4))
    elif extra == "antenna":  # a telescope behind the back, lying or upright
        key, y, lie, x = part(b, "antenna", "arm"), s * 0.45 * w, b.chance(0.5), d + 3 * r + g
        b.cylinder(key, (d + g, y, z), (x + r, y, z), 2 * r, None, "metal")
        with b.facing((x, y, z), (0, -s, 0) if lie else UP):
            b.cylinder(key, (0, 0, 0), (0, 0, 0.9 * w), r, 0.4 * r, "metal")
        b.hinge(key, "base", (x, y, z), (1, 0, 0), 0.0, 1.4, opens=UP if lie else (0, -s, 0))


def sewing_machine(b: Builder) -> None:
    """A sewing machine with its hand wheel, and perhaps dials and the presser's lever."""
    w = b.uniform(0.25, 0.5)
    d, h = w * b.uniform(0.35, 0.6), w * b.uniform(0.55, 0.9)
    g, s = _start(b, d, w, h, "dark", "white", "plastic", "wood", "steel")
    x, t, r = d / 2, b.uniform(0.08, 0.18) * h, b.uniform(0.03, 0.06) * w
    a, e, c = b.uniform(0.18, 0.3) * h, b.uniform(0.2, 0.4) * d, -s * 0.36 * w
    rounded(b, "base", (0, -w / 2, 0), (d, w / 2, t), 0.1 * d, "z", b.choice(("body", "wood")))
    for y, q, z in ((s * 0.4, 0.1, t), (s * 0.04, 0.45, h - a), (-s * 0.36, 0.1, 0.45 * h)):
        rounded(b, "base", (x - e, (y - q) * w, z), (x + e, (y + q) * w, h), 0.6 * r, "x")
    b.cylinder("base", (x, c, 0.2 * h + t), (x, c, 0.46 * h), 0.02 * h, None, "metal")
    b.block("base", (x, c, t), (0.5 * d, 0.2 * w, 0.02 * h), "metal")
    for y in (0.1 * s * w, 0.25 * s * w)[: b.integer(0, 2)]:  # spool pins
        b.cylinder("base", (x, y, h), (x, y, 1.15 * h), 0.015 * w, None, "metal")
    wheel, q = part(b, "wheel"), b.uniform(0.3, 0.48) * a + 0.1 * h
    with b.facing((x, s * (0.5 * w + g), h - a / 2), (0, s, 0)):
        b.lathe(wheel, [(0.9 * q, 0), (q, r), (q, 1.5 * r), (0.4 * q, 2 * r)], "metal")
        b.spin(wheel, "base", (0, 0, 0), UP)
    spots = [(x - e, s * 0.4 * w, z) for z in (h - 0.6 * a, 0.5 * h)]
    _dials(b, "base", spots[: b.integer(0, 2)], FRONT, 0.05 * w, b.chance(0.5))
    _still(b, "base", (x - e, s * 0.05 * w, h - a / 2), 0.3 * w, 0.5 * a, "plate screen keys knob")
    if b.chance(0.5):  # the presser's lever behind the head
        key, x, z = part(b, "lever"), x + e + g, 0.6 * h
        b.cylinder(key, (x, c, z), (x + 0.03 * w, c, z), 0.03 * w, None, "metal")
        b.block(key, (x + 0.02 * w, c, 0.54 * h), (0.02 * w, 0.03 * w, 0.12 * h), "metal")
        b.hinge(key, "base", (x, c, z), (1, 0, 0), 0.0, 1.2, opens=(0, -s, 0))


def server_rack(b: Builder) -> None:
    """A rack, a card catalogue or a museum cabinet: a few units or drawers slide, the rest stay."""
    kind, rows = b.choice(("rack", "rack", "cards", "plans")), b.integer(4, 12)
    w, h, d = b.uniform(0.5, 0.9), b.uniform(0.4, 2.0), b.uniform(0.4, 0.9)
    g, _ = _start(b, d, w, h, *(("dark", "steel", "white") if kind == "rack" else ("any",)))
    rack, columns = kind == "rack", b.integer(2, 5) if kind == "cards" else 1
    t, f, x = b.uniform(0.015, 0.04), b.uniform(0.02, 0.1), 0.08 * rack
    feet(b, (0, -w / 2), (d, w / 2), f + t)
    b.shell("base", (0, -w / 2, f), (d, w / 2, h + t), t, b.choice(("-x", "-x,+x")))
    wide, cuts = (w - 2 * t) / columns, np.cumsum([0, *b.rng.integers(1, 5 if rack else 2, rows)])
    zs, door, ajar = f + t + (h - f - t) * cuts / cuts[-1], rack and b.chance(0.6), b.chance(0.5)
    slots = b.rng.permutation(rows * columns)[: 0 if door and not ajar else b.integer(1, 4)]
    paint, grip = b.choice(("front", *PAINTS)), b.choice(("bar", "bow", "knob", "cup", "recessed"))
    for k in range(rows * columns):
        z0, z1 = zs[k // columns] + g, zs[k // columns + 1] - g
        mid = (k % columns + 0.5 - columns / 2) * wide
        tall, v, to = z1 - z0, (z0 + z1) / 2, part(b, "drawer") if k in slots else "base"
        y0, y1 = mid - wide / 2 + g, mid + wide / 2 - g
        b.box(to, (x, y0, z0), (x + 0.012, y1, z1), paint)
        if rack:
            for y in (mid - 0.44 * wide, mid + 0.44 * wide):
                b.handle(to, (x, y, v), FRONT, UP, 0.7 * tall, "bow")
            _still(b, to, (x, mid, v), 0.6 * wide, 0.5 * tall, "keys grille plate")
        else:
            b.handle(to, (x, mid, v), FRONT, (0, 1, 0), min(0.3 * wide, 0.6 * tall), grip)
            b.block(to, (x, mid, z1 - 0.2 * tall), (0.006, 0.4 * wide, 0.2 * tall), "metal")
        if k in slots and not rack:
            b.drawer_box(to, (x + 0.012, y0, z0), (0.9 * d, y1, z1 - 0.2 * tall), 0.006)
        else:
            b.box(to, (x + 0.012, y0 + 0.01, z0), (0.9 * d, y1 - 0.01, z1), "metal")
        if k in slots:
            b.slide(to, "base", FRONT, 0.0, b.uniform(0.4, 0.8) * d)
    if door:
        style, far = b.choice(("mesh", "mesh", "glass", "slab")), b.uniform(1.7, 2.2)
        _door(b, (-g - t, -w / 2, f), (-g, w / 2, h + t), style, far, far * ajar)


CATEGORIES: dict[str, Callable[[Builder], None]] = {
    "microscope": microscope, "flatbed_scanner": flatbed_scanner, "cash_register": cash_register,
    "vending_machine": vending_machine, "fuse_box": fuse_box, "radio_set": radio_set,
    "sewing_machine": sewing_machine, "server_rack": server_rack,
}  # fmt: skip
