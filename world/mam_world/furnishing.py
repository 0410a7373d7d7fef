"""Furniture with other motions: flaps, lids, leaves, reclining seats, bed drawers, turntables."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from mam_world import cabinetry as c
from mam_world.kit import Builder
from mam_world.mech import studs
from mam_world.solids import TAU, frame, part, pierced, profile, rounded, tray

UP, DOWN, FRONT, BACK = (0, 0, 1), (0, 0, -1), (-1, 0, 0), (1, 0, 0)


def _begin(b: Builder, *size: float) -> c.Manner:
    b.size(*size)
    b.theme(b.choice(("wood", "wood", "paint", "white", "dark")))
    return c.draw_manner(b)


def _grip(b: Builder, link: str, at: Sequence[float], length: float, kind: str = "") -> None:
    """A handle across a front that faces -x."""
    if kind not in ("none", "bar", "bow", "knob"):
        kind = b.choice(("bar", "bow", "knob"))
    b.handle(link, at, FRONT, (0, 1, 0), length, kind)  # type: ignore[arg-type]


def _turn(b: Builder, key: str, pin: Sequence[float], far: float, way: Sequence[int] = UP) -> None:
    b.hinge(key, "base", pin, (0, 1, 0), 0.0, far, opens=way)


def _both(b: Builder, low: Sequence[float], high: Sequence[float], paint: str = "body",
          key: str = "base") -> None:  # fmt: skip
    """A box of the base or another link, and its mirror image in y."""
    for y0, y1 in ((low[1], high[1]), (-high[1], -low[1])):
        b.box(key, (low[0], y0, low[2]), (high[0], y1, high[2]), paint)


def _still(b: Builder, m: c.Manner, cell: c.Cell) -> None:
    """A false front with its handle: like a drawer's, but part of the base."""
    low, high = c.front_box(b, m, cell)
    b.front("base", low, high, m.drawer_front)
    at = (low[0], (low[1] + high[1]) / 2, (low[2] + high[2]) / 2)
    _grip(b, "base", at, min(m.length, 0.5 * cell.width), m.drawer_handle)


def _drawers(b: Builder, m: c.Manner, cells: Sequence[c.Cell], depth: float, most: int) -> None:
    """Drawers in the cells, of which some, and all beyond `most`, are false fronts."""
    for k, cell in enumerate(b.rng.permutation(len(cells))):
        if k == 0 or (k < most and b.chance(0.7)):
            c.drawer(b, m, cells[cell], depth)
        else:
            _still(b, m, cells[cell])


def _flap(b: Builder, m: c.Manner, cell: c.Cell, edge: int, far: float, parent: str = "base",
          depth: float = 0.0) -> str:  # fmt: skip
    """A front that turns about its lower (-1) or upper (1) edge; with a bin behind it if deep."""
    key, (low, high) = part(b, "flap"), c.front_box(b, m, cell)
    b.front(key, low, high, m.door_front)
    y, inset = (low[1] + high[1]) / 2, min(0.05, 0.25 * (high[2] - low[2]))
    at = (low[0], y, high[2] - inset if edge < 0 else low[2] + inset)
    _grip(b, key, at, min(m.length, 0.5 * cell.width), m.handle)
    if depth:  # all behind the front stays on circles below the cell's top
        slack = max(b.gap, 0.003) + 0.002
        room, y0, y1 = cell.z1 - low[2] - 2 * slack, cell.y0 + slack, cell.y1 - slack
        back = min(0.9 * depth - slack, low[0] + 0.8 * room)
        top = low[2] + np.sqrt(room**2 - (back - low[0]) ** 2) * b.uniform(0.75, 0.97)
        b.drawer_box(key, (high[0], y0, cell.z0 + slack), (back, y1, top), 0.008)
    b.hinge(key, parent, (low[0], y, low[2] if edge < 0 else high[2]), (0, 1, 0), 0.0, far,
            opens=FRONT, tip=at)  # fmt: skip
    return key


def secretary_desk(b: Builder) -> None:
    """A writing desk on drawers whose front drops, or whose sloping top opens or lifts."""
    w, d, h = b.uniform(0.55, 1.4), b.uniform(0.38, 0.7), b.uniform(0.62, 0.82)
    kind, m, legs = b.choice(("drop", "slant", "lift")), _begin(b, d, w, 1.5 * h), b.chance(0.5)
    t, g, y, most = m.board, max(b.gap, 0.002), w / 2, 3 if w > 0.9 else 2
    z, n = (h - b.uniform(0.1, 0.2), 1) if legs else (b.uniform(0.03, 0.1), b.integer(2, 4))
    b.feet("base", (0, -y), (d, y), z, b.choice(("square", "round", "tapered")), inset=0.005)
    rows = c.cut(b, m, c.carcass(b, m, w, d, z, h), d, "z", [1.0] * n)
    cells = [q for r in rows for q in c.cut(b, m, r, d, "y", [1.0] * b.integer(1, most))]
    _drawers(b, m, cells, d, 3)
    if kind == "drop":
        high = h + b.uniform(0.3, 0.7)
        upper = c.carcass(b, m, w, d, h, high)
        c.crown(b, m, w, d, high)
        for q in c.cut(b, m, upper, d, "y", [1.0] * b.integer(1, 4)):
            c.shelves(b, m, q, d, b.integer(0, 2))
        _flap(b, m, upper, -1, np.pi / 2)
        return
    key, lift, inner = part(b, "flap"), kind == "lift", y - t
    rim, rise = (0.1, b.uniform(0, 0.15)) if lift else (0.0, b.uniform(0.25, 0.4))
    back, high = d - 0.08 if lift else b.uniform(0.45, 0.75) * d, h + rim + rise
    lean, long = float(np.arctan2(back, rise)), float(np.hypot(back, rise))
    side = [(0, h), (0, h + rim), (back, high), (d, high), (d, h)][not lift :]
    for end in (-y, inner):
        profile(b, "base", side, end, end + t, "y")
    b.panel("base", (back, -inner, high - t), (d, inner, high))
    b.panel("base", (d - 0.4 * t, -inner, h), (d, inner, high - t), "inside")
    if lift:
        b.box("base", (0, -inner, h), (t, inner, h + rim))
    with b.moved((0, 0, h + rim), (0, 1, 0), lean):
        b.front(key, (-t - g, -y, 0), (-g, y, long), b.choice(("slab", "moulded")))
        _grip(b, key, (-t - g, 0, (0.12 if lift else 0.88) * long), 0.1)
        pin, far = ((-g, 0, long), 1.1) if lift else ((-t - g, 0, 0), np.pi / 2 + lean)
        _turn(b, key, pin, far, FRONT)


def _cushion(b: Builder, link: str, low: Sequence[float], high: Sequence[float], skin: str) -> None:
    """A soft slab, sometimes with rows of buttons."""
    rounded(b, link, low, high, 0.03, "z", skin)
    if b.chance(0.5):
        xs, ys = np.linspace(low[0], high[0], 4)[1:-1], np.linspace(low[1], high[1], 6)[1:-1]
        studs(b, [(x, y, high[2]) for x in xs for y in ys], UP, 0.01, link)


def ottoman_bench(b: Builder) -> None:
    """A seat to store things in: ottoman, hall or piano bench, blanket chest, round pouffe."""
    kind, d = b.choice(("box", "round", "legs", "chest")), b.uniform(0.32, 0.6)
    w, h, t = b.uniform(0.45, 1.5), b.uniform(0.3, 0.55), b.uniform(0.03, 0.12)
    m, chest = _begin(b, d, d if kind == "round" else w, h), kind == "chest"
    g, skin, y = max(b.gap, 0.001), b.choice(("fabric", "fabric", "accent", "body")), w / 2
    low = b.uniform(0.5, 0.75) * h if kind == "legs" else b.uniform(0.02, 0.12)
    if kind == "round":
        r, lid, z = d / 2, part(b, "lid"), h + g
        b.feet("base", (-r, -r), (r, r), low, "tapered", inset=0.3 * r)
        b.vessel("base", [(b.uniform(0.75, 1) * r, low), (r, 0.6 * h), (r, h)], 0.08 * r, skin)
        edge = [(r, z), (1.02 * r, z + 0.3 * t), (r, z + 0.8 * t), (0.85 * r, z + t)]
        b.lathe(lid, edge, b.choice(("fabric", "wood", skin)))
        studs(b, [(0, 0, z + t)], UP, 0.06 * r, lid)
        if b.chance(0.35):
            b.slide(lid, "base", UP, 0.0, b.uniform(0.1, 0.4))
        else:
            for key, z0, z1 in (("base", h - 0.1 * r, h), (lid, z, z + 0.08 * r)):  # hinge plates
                b.box(key, (0.85 * r, -0.26 * r, z0), (1.02 * r, 0.26 * r, z1), "dark")
            _turn(b, lid, (1.02 * r, 0, z), b.uniform(0.9, 1.5))
        return
    b.feet("base", (0, -y), (d, y), low, b.choice(("square", "round", "tapered")), inset=0.005)
    if chest and b.chance(0.5):  # drawers below
        cell, low, h = c.carcass(b, m, w, d, low, low + 0.15), low + 0.15, h + 0.1
        _drawers(b, m, c.cut(b, m, cell, d, "y", [1.0] * b.integer(1, 3)), d, 2)
    tray(b, "base", (0, -y, low), (d, y, h), 0.02, "z", 1, skin if kind == "box" else "body")
    n, style = b.integer(1, 3) if chest else 0, b.choice(("moulded", "slab"))
    for q in (np.arange(n) / max(n, 1) - 0.5) * w:
        b.front("base", (-0.012, q, low), (0, q + w / n, h), style)
    backed, over = kind != "legs" and b.chance(0.35), b.choice((0.0, 0.02))
    pin = d - t - 0.03 - g if backed else d
    if backed:
        b.box("base", (pin + g, -y, h - 0.02), (d, y, h), "trim")
        b.front("base", (d, -y, low), (d + 0.04, y, h + b.uniform(0.3, 0.9)), style)
    two, soft = w > 0.9 and b.chance(0.4), b.chance(0.75)
    spans = ((-y - over, -g / 2), (g / 2, y + over)) if two else ((-y - over, y + over),)
    for k, (y0, y1) in enumerate(spans):
        lid, z = ("base", h) if k and b.chance(0.4) else (part(b, "lid"), h + g)
        b.box(lid, (-over, y0, z), (pin, y1, z + 0.02), skin if soft else "front")
        if soft:
            _cushion(b, lid, (-over, y0, z + 0.02), (pin, y1, z + t), skin)
        if lid != "base":
            _turn(b, lid, (pin, 0, z), b.uniform(0.8, 1.5))


def bed_storage(b: Builder) -> None:
    """A bed with drawers in its side or foot, a trundle bed, a bunk bed, or one that lifts."""
    kind, s = b.choice(("side", "foot", "trundle", "bunk", "lift")), b.choice((-1, 1))
    bunk, lift, ends = kind == "bunk", kind == "lift", kind == "foot"  # the foot faces the viewer
    long, wide = b.uniform(1.3, 2.1), b.uniform(0.75, 1.1 if kind in ("trundle", "bunk") else 1.9)
    deep, w, n = (long, wide, 2) if ends else (wide, long, 4)
    m, g, y = _begin(b, deep, w, 1.7 if bunk else 0.9), max(b.gap, 0.003), w / 2
    low, t, h = b.uniform(0.03, 0.12), b.uniform(0.1, 0.24), b.uniform(0.27, 0.42)
    key, z = (part(b, "lid"), h + g) if lift else ("base", h)
    if kind == "trundle":
        end, top, bed = y - 0.05 - g, h - 0.08 - g, part(b, "drawer")
        b.box("base", (0, -y, h - 0.08), (deep, y, h))
        _both(b, (0, y - 0.05, 0), (deep, y, h - 0.08))
        b.front(bed, (-0.02, -end, 0.03), (0, end, top), m.drawer_front)
        b.drawer_box(bed, (0, -end, 0.05), (0.93 * deep, end, 0.7 * top), 0.015)
        _cushion(b, bed, (0.02, 0.02 - end, 0.065), (0.9 * deep, end - 0.02, 0.8 * top), "light")
        _grip(b, bed, (-0.02, 0, 0.7 * top), m.length, m.drawer_handle)
        b.slide(bed, "base", FRONT, 0.0, b.uniform(0.5, 0.85) * deep)
    else:
        b.feet("base", (0, -y), (deep, y), low, b.choice(("plinth", "square", "tapered")))
    if lift:
        tray(b, "base", (0, -y, low), (deep, y, h), 0.025)
    elif kind != "trundle":
        cell = c.carcass(b, m, w, deep, low, h)
        _drawers(b, m, c.cut(b, m, cell, deep, "y", [1.0] * b.integer(1, n)), min(deep, 0.8), 4)
    at, half, space = (deep, 0, 0) if ends else (deep / 2, s * y, 0), wide / 2, z - h
    with b.moved(at, UP, 0.0 if ends else s * np.pi / 2):  # the head is at x = 0
        b.box(key, (-long, -half, z), (-space, half, z + 0.025), "wood")
        for bed, q in ((key, z + 0.025), ("base", 1.16))[: 1 + bunk]:
            top, edge = q + t, half - 0.02
            _cushion(b, bed, (0.03 - long, 0.01 - edge, q), (-space, edge - 0.01, top), "light")
            if b.chance(0.7):
                _cushion(b, bed, (0.02 - long, -edge, q), (-0.5, edge, top + 0.03), "fabric")
            for p in (0.0,) if wide < 1.2 else (-0.25 * wide, 0.25 * wide):
                rounded(b, bed, (-0.4, p - 0.3, top), (-0.1, p + 0.3, top + 0.1), 0.1, "z", "light")
        head, style = h + b.uniform(0.3, 0.9), b.choice(("framed", "moulded", "slab"))
        b.front("base", (0, -half, 0), (0.06, half, 1.7 if bunk else head), style, "trim")
        if bunk:
            b.box("base", (-long, -half, 1.1), (0, half, 1.16))
            _both(b, (-long - 0.06, half - 0.05, 0), (-long, half, 1.7))
            for rung in (0.3, 0.6, 0.9, 1.3, 1.6):
                b.cylinder("base", (-long - 0.03, -half, rung), (-long - 0.03, half, rung), 0.018)
    if lift:
        _turn(b, key, (deep, 0, z), b.uniform(0.3, 0.6))


def _rest(b: Builder, link: str, w: float, long: float, t: float, slats: bool = False) -> None:
    """A padded or slatted rest from z = 0 up; it faces -x at x = 0 and is `t` thick."""
    n, share, paint = (int(long / 0.08), 0.7, "wood") if slats else (b.integer(1, 3), 1.0, "fabric")
    for y0, y1 in ((-0.45, -0.38), (0.38, 0.45)) if slats else ((-0.5, 0.5),):
        b.box(link, (0.7 * t, y0 * w, 0), (t, y1 * w, long), "wood" if slats else "dark")
    for z in np.arange(n) * long / n:
        rounded(b, link, (0, -w / 2, z), (0.7 * t, w / 2, z + share * long / n), 0.02, "x", paint)


def recliner(b: Builder) -> None:
    """A seat with a back that reclines, a foot rest, lifting arms, a flip seat or a tablet."""
    kind = b.choice(("armchair", "lounger", "dentist", "cinema", "tablet"))
    w, s, tall = b.uniform(0.42, 0.65), b.uniform(0.42, 0.6), b.uniform(0.45, 0.85)
    zs, za, wide = b.uniform(0.36, 0.55), b.uniform(0.18, 0.28), b.uniform(0.04, 0.08)
    _begin(b, 1.5 * s, 1.3 * w, zs + tall)
    g, sofa, dentist = max(b.gap, 0.003), kind == "armchair", kind == "dentist"
    slats = not (sofa or dentist) and b.chance(0.6)
    t = b.uniform(0.05, 0.15) * (0.4 if slats else 1.0)
    y, low, flat = w / 2 + g, zs - t - g, (FRONT, DOWN)  # `low`: the top of the frame
    seat = part(b, "seat") if kind == "cinema" else "base"
    with b.facing((s, 0, zs), *flat):
        _rest(b, seat, w, s, t, slats)
    if kind == "cinema":
        _turn(b, seat, (s, 0, zs), b.uniform(0.7, 1.2))
        _both(b, (s - 0.07, y, zs - 0.03), (s + 0.03, y + wide, zs + 0.02), "dark")
        _both(b, (s - 0.05, w / 2 - 0.03, zs - 0.02), (s, y, zs), "dark", seat)  # its pivots
    leans, lean = kind not in ("cinema", "tablet") or b.chance(0.3), b.uniform(0.08, 0.4)
    back = part(b, "back") if leans else "base"
    with b.moved((s + g, 0, zs), (0, 1, 0), lean):
        _rest(b, back, w, tall, t, slats)
        if b.chance(0.5) or dentist:
            rounded(b, back, (-0.04, -0.3 * w, 0.75 * tall), (0, 0.3 * w, tall), 0.03, "x", "light")
        if leans and seat != "base":
            _both(b, (0, w / 2 - 0.03, 0), (0.03, y, 0.03), "dark", back)
        if leans:
            _turn(b, back, (0, 0, 0), b.uniform(0.3, min(1.2, 1.5 - lean)), BACK)
    foot = part(b, "foot_rest") if sofa or dentist or (kind == "lounger" and b.chance(0.6)) else ""
    if foot and sofa:
        long = b.uniform(0.6, 0.85) * (low - 0.06)
        with b.moved((-g - 0.06, 0, low - long)):
            _rest(b, foot, 0.95 * w, long, 0.06)
        _turn(b, foot, (-g, 0, low), b.uniform(0.9, 1.5), FRONT)
    elif foot:
        with b.facing((-g, 0, zs), *flat):
            _rest(b, foot, w, b.uniform(0.35, 0.6), t, slats)
        _turn(b, foot, (-g, 0, zs - t), b.uniform(0.3, 0.6), DOWN)
    b.box("base", (0, -y, 0.03 if sofa else low - 0.05), (s, y, low), "dark")
    if sofa:
        _both(b, (0.03, y, 0), (s - 0.03, y + 2 * wide, zs + za - 0.05), "fabric")
        _both(b, (0, y - 0.01 + g, zs + za - 0.05), (s, y + 2 * wide + 0.01, zs + za), "fabric")
        side = (s / 2, y + 2 * wide, zs / 2)  # with a knob that stays
        b.cylinder("base", side, np.add(side, (0, 0.03, 0)), 0.025, None, "dark")
        return
    lifts, top = kind != "tablet" and b.chance(0.6), zs + za
    _both(b, (0, y, low - 0.05), (s, y + wide, low), "trim")
    _both(b, (s - 0.11, y, low), (s - 0.06, y + wide, top), "trim")
    for y0, y1 in ((-y - wide, -y), (y, y + wide)):
        arm, z = (part(b, "arm"), top + g) if lifts else ("base", top)
        rounded(b, arm, (0.05, y0, z), (s - 0.06, y1, z + 0.04), 0.015, "z", "wood")
        if lifts:
            _turn(b, arm, (s - 0.06, 0, z), b.uniform(1.0, 1.5))
    if dentist:
        b.cylinder("base", (s / 2, 0, 0.03), (s / 2, 0, low - 0.05), 0.12, 0.09, "metal")
        rounded(b, "base", (-0.1, -0.6 * w, 0), (s, 0.6 * w, 0.03), 0.1)
    for x in () if dentist else (0.02, s - 0.07):
        _both(b, (x, y, 0), (x + 0.05, y + wide, low - 0.05), "trim")
    if kind == "tablet":
        key, post, z = part(b, "flap"), y + wide + 0.02, top + 0.06 + g
        b.cylinder("base", (0.03, post, low - 0.025), (0.03, post, z - g), 0.02, None, "metal")
        rounded(b, key, (-0.25, -0.1, z), (0.06, post, z + 0.02), 0.05, "z", "front")
        axis, way = b.choice(((BACK, UP), (UP, FRONT)))
        b.hinge(key, "base", (0.03, post, z), axis, 0, 1.4, opens=way, tip=(0.03, -0.1, z))


def drop_leaf_table(b: Builder) -> None:
    """A table whose leaves hang on hinges, are drawn out from below, or fold over on the top."""
    kind, d = b.choice(("drop", "drop", "draw", "card")), b.uniform(0.45, 0.9)
    w, h, t = b.uniform(0.3, 1.3), b.uniform(0.4, 0.95), b.uniform(0.016, 0.035)
    _begin(b, d, 1.5 * w, h)
    g, y, post, deep = max(b.gap, 0.001), w / 2, b.uniform(0.03, 0.06), b.uniform(0.08, 0.14)
    ys, draw, paint = y - 0.05 - g, kind == "draw", b.choice(("body", "front", "wood"))
    under = h - t - (t + 2 * g if draw else 0.0)  # top of the frame
    b.panel("base", (0, -y, h - t), (d, y, h), paint)
    _both(b, (0.04, ys - 0.03, under - deep), (d - 0.04, ys - 0.01, under))
    for x in (0.04, d - 0.04 - post):
        _both(b, (x, ys - post, 0), (x + post, ys, under), "trim")
        b.box("base", (x + 0.005, -ys, under - deep), (x + 0.025, ys, under))
    if b.chance(0.6):  # a false drawer
        b.block("base", (0.04, 0, under - deep / 2), (0.02, ys, 0.8 * deep), "front")
        _grip(b, "base", (0.03, 0, under - deep / 2), 0.1)
    if draw:
        b.box("base", (0.1, -0.1 * y, under), (d - 0.1, 0.1 * y, h - t))
    elif kind == "card":
        leaf, x = part(b, "leaf"), b.choice((1.0, 0.6)) * d
        b.panel(leaf, (0, -y, h + g), (x, y, h + t + g), paint)
        _turn(b, leaf, (0, 0, h + g / 2), np.pi)
        return
    for s in (-1, 1)[: b.integer(1, 2)]:
        leaf, up, a = part(b, "leaf"), b.chance(0.5), b.uniform(0.4, 0.95) * min(h, 0.8 * w + 0.1)
        y0, y1 = sorted((0.25 * s * y, s * y) if draw else (s * (y + g), s * (y + g + a)))
        if draw:
            b.panel(leaf, (0.01, y0, under + g), (d - 0.01, y1, under + g + t), paint)
            b.slide(leaf, "base", (0, s, 0), 0.0, b.uniform(0.4, 0.7) * y)
            continue
        rounded(b, leaf, (0, y0, h - t), (d, y1, h), b.choice((0.003, 0.3 * min(a, d))), "z", paint)
        m = (y0 + y1) / 2  # only the free edge has round corners
        b.box(leaf, (0, min(m, s * (y + g)), h - t), (d, max(m, s * (y + g)), h), paint)
        b.hinge(leaf, "base", (0, s * y, h - t), BACK, 0.0, np.pi / 2, opens=DOWN,
                rest=0.0 if up else np.pi / 2, ajar=up)  # fmt: skip
        if b.chance(0.6):  # a leg that swings out below a raised leaf
            gate, q, x0, x1 = part(b, "leg") if up else "base", s * (ys + g + 0.012), 0.1, d - 0.14
            frame(b, gate, (x0, q - 0.012, 0), (x1, q + 0.012, h - t - g), 0.035, "y", "trim")
            if up:
                b.hinge(gate, "base", (x0, q, 0), UP, 0.0, b.uniform(1, 1.5), opens=(0, s, 0))


def medicine_cabinet(b: Builder) -> None:
    """A mirror cabinet with doors, a shelf and lamps, or a washbasin's cabinet with its tap."""
    vanity, w, h = b.chance(0.4), b.uniform(0.35, 1.4), b.uniform(0.45, 0.9)
    d = b.uniform(0.38, 0.6) if vanity else b.uniform(0.1, 0.2)
    m, n, y = _begin(b, w, d, h), int(np.clip(round(w / b.uniform(0.25, 0.5)), 1, 3)), 0.45 * w
    if vanity:
        cell = c.carcass(b, m, w, d, c.under_and_over(b, m, w, d, h), h, top=False)
        lower, upper = c.cut(b, m, cell, d, "z", [1.0, b.uniform(0.25, 0.4)])
        for q in c.cut(b, m, upper, d, "y", [1.0] * n):
            _still(b, m, q)
        for q in c.cut(b, m, lower, d, "y", [b.uniform(0.8, 1.3) for _ in range(n)]):
            c.fill(b, m, q, d, b.choice(("pair", "left", "drawer", "drawers")))
        top, r, x = h + b.uniform(0.02, 0.05), 0.36 * min(w, d), 0.45 * d
        hole, low = (x - r, -1.2 * r, x + r, 1.2 * r), b.choice((h - 0.07, top))
        pierced(b, "base", (-m.front - 0.01, -w / 2, h), (d, w / 2, top), [hole], "z", "stone")
        tray(b, "base", (*hole[:2], low), (*hole[2:], low + 0.13), 0.01, taper=b.uniform(0, 0.03))
        z, x = top + b.uniform(0.2, 0.3), x + r + 0.025
        spout = [(x, 0, top), (x, 0, z - 0.03), (x - 0.03, 0, z), (x - 0.12, 0, z - 0.01)]
        b.sweep("base", spout, 0.012, "metal")
        return
    m.handle, m.board = b.choice(("none", "none", "knob", "bar")), b.uniform(0.01, 0.018)
    m.door_front, cell = b.choice(("slab", "framed", "glass")), c.carcass(b, m, w, d, 0, h)
    if b.chance(0.5):
        shelf, cell = c.cut(b, m, cell, d, "z", [b.uniform(0.2, 0.4), 1.0])
        c.contents(b, shelf, d, m.inside)
    for k, q in enumerate(c.cut(b, m, cell, d, "y", [b.uniform(0.8, 1.5) for _ in range(n)])):
        c.shelves(b, m, q, d, b.integer(1, 3))
        if k == 1 and b.chance(0.35):
            b.front("base", *c.front_box(b, m, q), m.door_front)
        else:
            c.door(b, m, q, "left" if k == n - 1 else "right")
    if b.chance(0.6):  # lamps
        b.box("base", (-0.03, -y, h), (d, y, h + 0.03), "metal")
        for z in np.linspace(-0.8 * y, 0.8 * y, b.integer(2, 4)):
            b.sphere("base", (-0.03, z, h + 0.06), 0.035, "light")


def shoe_cabinet(b: Builder) -> None:
    """A cabinet of fronts that tilt out, laundry bins, a bar's flap, lift-up or folding fronts."""
    kind, w = b.choice(("tilt", "tilt", "bin", "bar", "up", "fold")), b.uniform(0.35, 1.2)
    d = b.uniform(0.15, 0.28) if kind == "tilt" else b.uniform(0.28, 0.45)
    rows = b.integer(1, 4 if kind == "tilt" else 2)
    cols, far = b.integer(1, 2) if w > 0.6 and rows < 3 else 1, b.uniform(0.5, 0.9)
    h = rows * b.uniform(0.28, 0.45) + (0.2 if rows == 1 else 0.0)
    m = _begin(b, w, d, h)
    low = 0.0 if kind in ("up", "fold") else c.under_and_over(b, m, w, d, h)
    stack = c.cut(b, m, c.carcass(b, m, w, d, low, low + h), d, "z", c.rows(b, rows))[::-1]
    c.crown(b, m, w, d, low + h)
    for k, q in enumerate([q for r in stack for q in c.cut(b, m, r, d, "y", [1.0] * cols)]):
        if k and b.chance(0.2):
            _still(b, m, q)
        elif kind in ("tilt", "bin"):
            _flap(b, m, q, -1, far, depth=d - 0.01)
        elif kind == "bar" and k:
            c.fill(b, m, q, d, b.choice(("left", "drawer", "open")))
        elif kind == "fold":
            below, above = c.cut(b, m, q, d, "z", [1.0, 1.0], dividers=False)
            _flap(b, m, below, 1, b.uniform(1, 1.5), _flap(b, m, above, 1, b.uniform(1, 1.5)))
        else:
            c.shelves(b, m, q, d, b.integer(0, 1))
            _flap(b, m, q, -1 if kind == "bar" else 1, np.pi / 2)


def lazy_susan(b: Builder) -> None:
    """A turning tray, bookcase or stool, or a display whose tiers turn, on its foot."""
    kind, r = b.choice(("tray", "shelves", "stool", "display")), b.uniform(0.13, 0.35)
    stool, apart, flat = kind == "stool", kind == "display", kind == "tray"
    h = b.uniform(0.4, 1.2) * r if flat else b.uniform(0.4, 0.8 if stool else 1.4)
    _begin(b, 2 * r, 2 * r, 1.2 * h)
    g, skin, key = max(b.gap, 0.001), b.choice(("body", "front", "wood", "glass")), ""
    post, n, z = b.uniform(0.05, 0.1) * r + 0.006, b.integer(3, 5), np.eye(3)[2]
    low = b.uniform(0.3, 0.6) * h if stool else 0.05 * h + 0.01
    leg = min(0.6 * post, 0.25 * low)
    spokes = [np.array([np.cos(q), np.sin(q), 0.0]) for q in np.arange(n) * TAU / n]
    for e in spokes if b.chance(0.6) else ():
        b.cylinder("base", 1.1 * r * e + leg * z, 0.2 * r * e + 0.7 * low * z, leg)
    b.lathe("base", [(0.7 * r, 0), (0.7 * r, 0.02 * h), (0.35 * r, 0.03 * h), (0.3 * r, low)])
    tiers = 0 if stool else b.integer(1, 3) if flat else b.integer(2, 5)
    pitch, thin, square = (h - low) / max(tiers, 1), max(0.06 * r, 0.008), b.chance(0.6)
    if stool:
        b.cylinder("base", low * z, (h - g) * z, 1.4 * post, 1.2 * post, "metal")
        key, t = part(b, "seat"), b.uniform(0.03, 0.1)
        b.lathe(key, [(0.6 * r, h), (0.95 * r, h + 0.015), (r, h + 0.5 * t), (0.9 * r, h + t)])
        for y in (-0.4 * r, 0.4 * r) if b.chance(0.5) else ():
            b.cylinder(key, (0.85 * r, y, h + 0.02), (r, y, 1.4 * h), 0.01, None, "metal")
            b.block(key, (r, y, 1.4 * h), (0.03, 0.82 * r, 0.12 * h), "fabric")
        b.spin(key, "base", h * z, UP)
    elif apart:
        b.cylinder("base", low * z, h * z, post, None, "metal")
    for k, at in enumerate(low + g + np.arange(tiers) * pitch):
        size, top = r * (1 - 0.15 * k * flat), (at + thin) * z
        key = part(b, "carousel") if apart or k == 0 else key
        if square and not apart:
            b.box(key, (-size, -size, at), (size, size, at + thin), skin)
        else:
            b.tube(key, at * z, top, size, post + g if apart else 0.5 * post, skin)
        if apart:
            b.tube(key, top, (at + 0.4 * pitch) * z, post + g + 0.006, post + g)
        elif k < tiers - 1 or not flat:
            b.cylinder(key, at * z, (at + pitch) * z, post, None, "metal")
        if apart or k == 0:
            b.spin(key, "base", at * z, UP)
        for e in spokes:  # what stands on the tier
            a, foot = b.uniform(0.4, 0.8) * pitch, 0.65 * size * e + top
            b.cylinder(key, foot, foot + a * z, 0.22 * size, sides=4 if kind == "shelves" else None)


CATEGORIES: dict[str, Callable[[Builder], None]] = {
    "secretary_desk": secretary_desk, "ottoman_bench": ottoman_bench, "bed_storage": bed_storage,
    "recliner": recliner, "drop_leaf_table": drop_leaf_table, "lazy_susan": lazy_susan,
    "medicine_cabinet": medicine_cabinet, "shoe_cabinet": shoe_cabinet,
}  # fmt: skip
