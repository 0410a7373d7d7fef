"""Trucks, diggers, trailers, boards and chairs on wheels, and stands to steer from."""

# ruff: noqa: RUF005  (a point plus a tuple is a vector sum here, not a joined list)

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from mam_world.fixtures import PAINTS
from mam_world.kit import Builder
from mam_world.mech import boxes, dial, rods, rolls
from mam_world.solids import TAU, arc, bar, bored, part, profile, rounded, settle, wedge

BOTH, X, Y, Z, OUT = (-1, 1), (1, 0, 0), (0, 1, 0), (0, 0, 1), (-1, 0, 0)
TYRES, COATS = ("disc", "tyre", "cast"), ("paint", "paint", "plastic", "dark", "white", "steel")


def _axle(b: Builder, x: float, r: float, half: float, wide: float, style: str, live: str,
          top: float) -> None:  # fmt: skip
    """An axle in two bored blocks; its wheels stay, turn each, or turn together ("pair")."""
    link, t = part(b, "wheel", "axle") if live == "pair" else "base", 0.15 * r
    rods(b, link, ((x, -half, r), (x, half, r), 0.1 * r, "dark"))
    for y in (0.6 * (half - wide), -0.6 * (half - wide)):
        bored(b, "base", (x - 2 * t, y - t, 0.7 * r), (x + 2 * t, y + t, top), "y", (x, r), t)
    rolls(b, x, half - wide / 2, r, wide, style, live == "each", link)
    if live == "pair":
        b.spin(link, "base", (x, 0, r), Y)


def _casters(b: Builder, x: float, y: float, r: float, swivel: bool, live: bool) -> float:
    """Two castors whose forks swivel or stay; returns the height of their tops."""
    g, w, lag = max(0.3 * b.gap, 0.01 * r), 0.3 * r, x + 0.45 * r
    for side in (y, -y):
        fork = part(b, "caster", "fork") if swivel else "base"
        with b.moved((0, side, 0)):
            rods(b, "base", ((x, 0, 2.5 * r + g), (x, 0, 2.29 * r + g), 0.6 * r, "metal"))
            boxes(b, fork, (x + 0.2 * r, 0, 2.2 * r + g / 2, r, 4 * w, 0.2 * r, "metal"),
                   (lag, 1.7 * w, 1.5 * r, 0.5 * r, 0.15 * r, 1.4 * r, "metal"))  # fmt: skip
            rods(b, fork, ((lag, -1.9 * w, r), (lag, 1.9 * w, r), 0.12 * r, "metal"))
            if swivel:
                b.spin(fork, "base", (x, 0, r), Z)
            rolls(b, lag, 0, r, 2 * w, "disc", live, fork)
    return 2.5 * r + g


def _cab(b: Builder, x1: float, w: float, z: float, h: float) -> None:
    """A driver's cab from x = 0 to x1 with windows, still doors, lamps, grille and bumper."""
    x0, lean, pane, y = 0.0, b.uniform(0.02, 0.35) * x1, b.choice(("glass", "dark")), 0.45 * w
    if b.chance(0.4):
        x0, lean = 0.42 * x1, 0.1 * x1
        wedge(b, "base", (0, -y, x0, y), (0.04, -0.9 * y, x0, 0.9 * y), z, z + 0.5 * h)
    side = [(x0, z), (x1, z), (x1, z + h), (x0 + lean, z + h), (x0, z + 0.5 * h)]
    profile(b, "base", side, -w / 2, w / 2, "y")
    bar(b, "base", (x0, 0, z + 0.54 * h), (x0 + 0.9 * lean, 0, z + 0.95 * h), 0.85 * w, 0.03 * w,
        (-0.5 * h, 0, lean), pane)  # fmt: skip
    x, d, y = (x0 + lean + x1) / 2, x1 - x0 - lean, w / 2
    rows = [(x, y, z + 0.3 * h, 0.8 * d, 0.03 * w, 0.45 * h, "front"),
            (x + 0.25 * d, y, z + 0.4 * h, 0.15 * d, 0.06 * w, 0.04 * h, "metal")]  # fmt: skip
    boxes(b, "base", (x, y, z + 0.73 * h, 0.7 * d, 0.03 * w, 0.36 * h, pane),
           (0, 0.34 * w, z + 0.25 * h, 0.04 * w, 0.12 * w, 0.1 * h, "light"),
           (-0.02 * w, 0, z, 0.1 * w, w, 0.16 * h, "trim"), *rows[: b.choice((0, 2))])  # fmt: skip


def tipper_truck(b: Builder) -> None:
    """A truck or trailer whose bed tips to the rear or the side; a tailgate may swing on it."""
    w, r, end, cab = b.uniform(0.28, 0.45), b.uniform(0.05, 0.085), b.uniform(0.9, 1), 0.05
    b.size(1, w, 0.4)
    b.theme(b.choice(COATS))
    g, truck, roof, top = max(b.gap, 0.002), b.chance(0.7), b.uniform(0.18, 0.3), 2.1 * r
    boxes(b, "base", (end / 2, 0.14 * w, 1.75 * r, end, 0.08 * w, 0.7 * r, "dark"),
          (end - 0.02, 0, 2 * r, 0.04, 0.6 * w, 0.2 * r, "dark"))  # fmt: skip
    live, style, wide = b.choice(("", "", "each", "pair")), b.choice(TYRES), b.uniform(0.1, 0.18)
    axles = [end - (1.2 + 2.15 * i) * r for i in range(b.integer(1, 2 if live else 3))]
    if truck:
        cab = b.uniform(0.2, 0.34)
        axles.append(0.5 * cab)
        _cab(b, cab, w, top, roof)
    else:
        axles = [x - 0.3 * end for x in axles]
        rods(b, "base", ((0.02, 0.14 * w, 1.7 * r), (-0.25, 0, 1.5 * r), 0.2 * r, "body"),
              ((-0.2, 0, 0.1), (-0.2, 0, 2.6 * r), 0.13 * r, "metal"))  # fmt: skip
    for x in axles:
        _axle(b, x, r, w / 2, wide * w, style, live, 1.5 * r)
    bed, z0, x0, h = part(b, "bed"), top + g, cab + 0.04 + g, b.uniform(0.08, 0.24)
    aside, gate = b.choice((0, 0, 0, 0, -1, 1)), b.choice(("", "", "top", "low"))
    x1 = end + (0 if aside else b.uniform(0, 0.06))
    b.shell(bed, (x0, -w / 2, z0), (x1, w / 2, z0 + h), 0.015, "+x,+z" if gate else "+z")
    for x in np.linspace(x0 + 0.03, x1 - 0.03, b.integer(2, 8)) if b.chance(0.7) else ():
        boxes(b, bed, (x, w / 2, z0 + 0.6 * h, 0.02, 0.03 * w, 0.7 * h, "trim"))
    if truck and b.chance(0.4):  # a shield over the cab
        high = max(z0 + h, top + roof + 1.5 * g)
        b.box(bed, (x0, -w / 2, z0 + 0.8 * h), (x0 + 0.015, w / 2, high + 0.015))
        b.box(bed, (b.uniform(0.2, 0.6) * cab, -w / 2, high), (x0 + 0.015, w / 2, high + 0.015))
    elif b.chance(0.5):  # a ram or an exhaust that stays
        rods(b, "base", ((cab + 0.02, 0, top), (cab + 0.02, 0, top + h), 0.008, "metal"))
    at, axis, tip = (end, 0, z0), Y, (x0, 0, z0)
    if aside:
        at, axis, tip = (x0, aside * w / 2, z0), X, (x0, -aside * w / 2, z0)
        beams = [(x, 0, 2.06 * r, 0.03, w, 0.08 * r, "dark") for x in (x0 + 0.1, x1 - 0.1)]
        sill = ((x0 + x1) / 2, w / 2 - 0.01, 2.06 * r, x1 - x0, 0.02, 0.08 * r, "dark")
        boxes(b, "base", *beams, sill)  # above the wheels
    b.hinge(bed, "base", at, axis, 0, b.uniform(0.5, 0.9), opens=Z, tip=tip)
    if gate:
        flap, x, z = part(b, "flap", "tailgate"), x1 + g, z0 + (h if gate == "top" else 0)
        edge = z0 + (h if gate == "top" else 0.97 * h)
        b.panel(flap, (x, -w / 2, z0), (x + 0.015, w / 2, edge), "front")
        boxes(b, bed, (x, w / 2 + 0.005, z, 0.04, 0.01, 0.02, "metal"))  # it hangs between straps
        boxes(b, flap, *[(x + 0.015, y * w, z0 + 0.48 * h, 0.015, 0.03 * w, 0.8 * h, "trim")
               for y in (0.45, b.uniform(0.1, 0.3))])  # fmt: skip
        b.hinge(flap, bed, (x + 0.007, 0, z), Y, 0, b.uniform(0.8, 1.4), opens=X)
    settle(b)


def excavator(b: Builder) -> None:
    """A digger on tracks, wheels or a post; turntable, boom, stick and tool move up to a link."""
    b.size(5, 2, 3)
    b.theme(b.choice(COATS))
    c, high, kind = b.uniform(0.55, 0.8), b.uniform(0.35, 0.6), b.choice(("track", "wheel", "post"))
    g, live, style = float(np.clip(0.4 * b.gap, 0.005, 0.03)), b.chance(0.3), b.choice(TYRES)
    if kind == "post":
        high += b.uniform(0, 0.6)
        rods(b, "base", ((0, 0, 0), (0, 0, 0.08), b.uniform(0.5, 0.8), "trim"))
    elif b.chance(0.5):  # a blade that stays
        boxes(b, "base", (1.1, 0, 0.25 * high, 0.06, 1.2 * c, 0.45 * high, "metal"),
               (0.8, 0, 0.6 * high, 0.6, 0.2 * c, 0.15 * high, "metal"))  # fmt: skip
    for x in (-0.6, 0.6) if kind == "wheel" else ():
        _axle(b, x, 0.45 * high, c, 0.3 * c, style, "each" if live else "", 0.7 * high)
    for s in BOTH if kind == "track" else ():
        y0, y1 = sorted((s * 0.6 * c, s * c))
        rounded(b, "base", (-1, y0, 0), (1, y1, 0.9 * high), 0.44 * high, "y", "rubber")
    for x in np.linspace(-0.75, 0.75, b.integer(2, 6)) if kind == "track" else ():
        p: Any = (x, 0.55 * c, 0.45 * high)
        rods(b, "base", (p, (x, c + 0.03, 0.45 * high), 0.25 * high, "metal"))
    if kind != "post":
        boxes(b, "base", (0, 0, 0.75 * high, 1.2, c, 0.4 * high, "dark"))
    rods(b, "base", ((0, 0, 0.04), (0, 0, high + 0.08), 0.35, "dark"))
    first, links, hw = b.choice((0, 0, 1)), ["base"], b.uniform(0.1, 0.15)
    last, t, up = b.integer(first, 3), b.uniform(0.75, 1.1), b.uniform(0.3, 0.55)
    for i, name in enumerate(("house", "boom", "stick", "tool")):
        links.append(part(b, "arm", name) if first <= i <= last else links[-1])
    house, boom, stick, tool = links[1:]
    z = high + 0.08 + (g if first == 0 else 0)
    rounded(b, house, (-0.8, -0.7, z), (0.8, 0.75, z + 0.12), 0.1)
    rounded(b, house, (0.2, -0.7, z), (0.95, 0.75, z + up), 0.2)
    with b.moved((-0.3, 0.51, z)):
        boxes(b, house, (0, 0, 0.2 * t, 0.8, 0.48, 0.4 * t, "body"),
               (0, 0, t, 0.84, 0.52, 0.05, "trim"), (0, 0, 0.7 * t, 0.7, 0.4, 0.6 * t, "glass"),
               *[(0.36 * x, 0.2, 0.7 * t, 0.06, 0.06, 0.6 * t, "body") for x in BOTH])  # fmt: skip
    boxes(b, house, (-0.55, hw + g + 0.03, z + 0.25, 0.3, 0.06, 0.5, "trim"))
    p, lift, lb = np.array([-0.55, 0, z + 0.36]), b.uniform(0.4, 0.75), b.uniform(2.2, 3)
    e, n = np.array([-np.cos(lift), 0, np.sin(lift)]), np.array([np.sin(lift), 0, np.cos(lift)])
    q, m = p + lb * e, p + 0.5 * lb * e + b.choice((0.0, b.uniform(0.06, 0.14))) * lb * n
    tip, turn = (q - m) / np.linalg.norm(q - m), b.uniform(0.25, 0.7)
    e, side, half = np.array([-np.sin(turn), 0, -np.cos(turn)]), (0, hw + g + 0.07, 0), hw - g
    end = q + min(b.uniform(0.4, 0.6) * lb, (q[2] - 0.95) / np.cos(turn)) * e
    bar(b, boom, p, m, 0.22, 2 * hw, Y)
    bar(b, boom, m, q - 0.22 * tip, 0.18, 2 * hw, Y)
    bar(b, stick, q, end - 0.2 * e, b.uniform(0.14, 0.2), 2 * half, Y)
    rods(b, boom, (p - side, p + side, 0.07, "metal"))
    for link, child, at, d, h in ((boom, stick, q, tip, hw), (stick, tool, end, e, half)):
        for y in (h + 0.02, -h - 0.02):  # cheeks about an eye
            bar(b, link, at - 0.4 * d + (0, y, 0), at + 0.06 * d + (0, y, 0), 0.16, 0.04, Y, "trim")
        rods(b, child, (at - (0, h - g, 0), at + (0, h - g, 0), 0.11, "metal"),
              (at - (0, h + 0.06, 0), at + (0, h + 0.06, 0), 0.05, "metal"))  # fmt: skip
    with b.moved(end, Y, turn + b.uniform(-0.3, 0.3)):
        rb, w = b.uniform(0.24, 0.34), b.uniform(0.2, 0.42)
        boxes(b, tool, (0, 0, -0.1, 0.16, 2 * (half - g), 0.2, "dark"))
        cup = [arc((0, 0, -0.16 - rb), k * rb, 0.9, 5.2, 11)[:, [0, 2]] for k in (1, 0.85)]
        profile(b, tool, np.concatenate([cup[0], cup[1][::-1]]), -w, w, "y", "dark")
        for y in (w, -w - 0.03):
            profile(b, tool, cup[0], y, y + 0.03, "y", "dark")
        x, h = cup[0][-1] + (0.03, 0.02)
        boxes(b, tool, *[(x, k * w, h, 0.12, 0.05, 0.03, "metal") for k in (0, 0.4, 0.85)])
    if first == 0:
        far = b.choice((np.inf, b.uniform(1, 3)))
        b.spin(house, "base", (0, 0, z), Z, -far, far, closed=0.0)
    for i, (at, lower, upper) in enumerate(((p, -0.2, 0.4), (q, -0.2, 0.6), (end, -0.6, 0.6)), 1):
        if first <= i <= last:
            b.hinge(links[i + 1], links[i], at, Y, lower, upper, closed=0.0)
    settle(b)


def skateboard(b: Builder) -> None:
    """A skateboard, a kick scooter, a dolly or a platform truck: wheels spin, a column steers."""
    kind, long = b.choice(("board", "board", "scooter", "dolly")), b.uniform(0.5, 1)
    w, r, style = b.uniform(0.2, 0.3) * long, b.uniform(0.03, 0.05) * long, b.choice(TYRES)
    b.size(long, w, long if kind == "scooter" else 0.2 * long)
    b.theme(b.choice((*COATS, "wood")))
    g, tone, turn = max(0.4 * b.gap, 0.002), b.choice(("wood", "front", "accent")), b.integer(0, 2)
    if kind == "dolly":
        w *= b.uniform(2, 3.5)
        for x, swivel in ((-0.4, turn > 0), (0.4, turn > 1)):
            z = _casters(b, x * long, 0.4 * w, r, swivel, turn == 0 or b.chance(0.6))
        for x in np.linspace(-0.45, 0.45, b.integer(2, 8)) * long:
            boxes(b, "base", (x, 0, z + 0.01, 0.1 * long, w, 0.02, tone))
        boxes(b, "base", (0, 0.4 * w, z + 0.03, long, 0.15 * w, 0.03, tone))
        if b.chance(0.5):  # a push bar
            x, y, u = 0.45 * long, 0.4 * w, z + long
            b.sweep("base", [(x, -y, z), (x, -y, u), (x, y, u), (x, y, z)], 0.014, "metal")
    elif kind == "board":
        z, kick, t = 2.9 * r, b.choice((0.0, b.uniform(0.2, 0.5))), 0.012 * long
        rounded(b, "base", (-0.35 * long, -w / 2, z), (0.35 * long, w / 2, z + t), 0.02, "z", tone)
        for s in BOTH:
            with b.moved((s * 0.34 * long, 0, z), Y, -s * kick):
                lo, hi = sorted((-s * 0.04 * long, s * 0.16 * long))
                rounded(b, "base", (lo, -w / 2, 0), (hi, w / 2, t), 0.35 * w, "z", tone)
            x = s * b.uniform(0.24, 0.28) * long
            axle = "pair" if turn == 0 else "each"
            half = b.uniform(0.42, 0.52) * w
            _axle(b, x, r, half, 0.16 * w, style, axle, z - 0.3 * r)
            boxes(b, "base", (x, 0, z - 0.2 * r, 0.1 * long, 0.3 * w, 0.4 * r, "metal"),
                   (x, 0, 1.6 * r, 0.5 * r, 1.7 * half - 0.28 * w, 0.5 * r, "metal"),
                   (x, 0.1 * w, z + t, 0.01, 0.01, 0.004, "metal"))  # fmt: skip
            rods(b, "base", ((x, 0, 1.4 * r), (x, 0, z), 0.3 * r, "metal"))
    else:
        r, e, spins, w = 2 * r, np.array([b.uniform(0.1, 0.3), 0, 1]), b.chance(0.6), 0.5 * w
        z, rear, bow = 1.1 * r, 0.42 * long + 1.2 * r, np.array([0, b.uniform(0.12, 0.25), 0])
        rounded(b, "base", (-0.3 * long, -w, z), (0.4 * long, w, z + 0.03), 0.6 * w, "z", tone)
        boxes(b, "base", (0.05 * long, 0, z + 0.03, 0.5 * long, 1.5 * w, 0.004, "dark"),
               (rear - 0.6 * r, 0.45 * r, r + 0.02, 2 * r, 0.012, 0.025, "metal"))  # fmt: skip
        rods(b, "base", ((rear, -0.5 * r, r), (rear, 0.5 * r, r), 0.15 * r, "metal"))
        rolls(b, rear, 0, r, 0.5 * r, style, spins)
        ring = [arc((rear, 0, r), k * r, 0.4, 2.6)[:, [0, 2]] for k in (1.3, 1.2)]
        profile(b, "base", np.concatenate([ring[0], ring[1][::-1]]), -0.4 * r, 0.4 * r, "y", "trim")
        at, fork = np.array([-0.42 * long, 0, 2.6 * r]), part(b, "handle", "column")
        top, front, neck = at + b.uniform(0.6, 0.9) * long * e, at - 1.6 * r * e, at + 0.05 * e
        b.tube("base", at + 0.02 * e, at + 0.12 * e, 0.03, 0.02 + g, "body")
        b.sweep("base", np.array([neck, (-0.25 * long, 0, z)]) + (0.045, 0, 0.01), 0.018, "body")
        hub = np.array([0, 0.6 * r, 0])
        rods(b, fork, (at, top, 0.015, "metal"), (top - bow, top + bow, 0.012, "metal"),
              (top + 0.6 * bow, top + bow, 0.018, "rubber"),
              (front - hub, front + hub, 0.15 * r, "metal"))  # fmt: skip
        boxes(b, fork, (at[0], 0, at[2] - 0.01, 0.05, 1.3 * r, 0.02, "metal"))
        for q in (hub, -hub):
            bar(b, fork, at + 0.9 * q, front + 0.9 * q, 0.3 * r, 0.15 * r, Y, "metal")
        b.hinge(fork, "base", at, e, -0.5, 0.5, closed=0.0)
        rolls(b, front[0], 0, r, 0.6 * r, style, spins, fork)
    settle(b)


def wheelchair(b: Builder) -> None:
    """A wheelchair with big wheels and castors, or a bed or lounger whose back rest rises."""
    big, w, seat, x = b.uniform(0.18, 0.34), b.uniform(0.19, 0.28), b.uniform(0.42, 0.55), 0.05
    b.size(1, 2 * w + 0.2, 1)
    b.theme(b.choice(("dark", "steel", "paint", "white")))
    swivel, live, r, g = b.chance(0.5), b.chance(0.5), b.uniform(0.05, 0.08), max(b.gap, 0.003)
    if b.chance(0.4):
        w, half, n, top = 1.6 * w, b.uniform(0.8, 1.1), b.choice((1, b.integer(3, 7))), 0.0
        pad, y = 0.03 if n > 1 else b.uniform(0.05, 0.15), w + 0.015
        low, rail = seat + 0.03 + g, seat + 0.3
        ends, boards = (-0.8 * half, 0.8 * half), (-half - 0.05, half + 0.05)
        if b.chance(0.5):
            top = max(_casters(b, u, 0.8 * w, r, swivel, live) for u in ends)
            boxes(b, "base", *[(u, 0, seat + 0.2, 0.03, 2 * w, 0.5, "front") for u in boards],
                   *[(u, 0, top + 0.03, 0.08, 1.8 * w, 0.06, "metal") for u in ends])  # fmt: skip
        mid = (top + seat) / 2
        boxes(b, "base", *[(u, 0.8 * w, mid, 0.06, 0.06, seat - top, "trim") for u in ends],
               *[(u * half, 0, seat, 0.04, 2 * w, 0.05, "body") for u in (-0.97, 0, 0.97)],
               (0, w - 0.02, seat, 2 * half, 0.04, 0.06, "body"))  # fmt: skip
        knee, cut = -b.uniform(0.1, 0.4) * half, b.uniform(0.1, 0.4) * half
        for x0, x1, at in ((-half, knee, knee), (knee, cut, 0.0), (cut, half, cut)):
            link = part(b, "back") if x0 == cut or (x0 == -half and b.chance(0.35)) else "base"
            x0, d = x0 + g, (x1 - x0 - 2 * g) / n
            boxes(b, link, (x0 + n * d / 2, 0.8 * w, low, n * d, 0.05, 0.02, "body"),
                   *[(x0 + (k + 0.5) * d, 0, low + pad / 2, d * (0.75 if n > 1 else 1), 2 * w - 0.1,
                      pad, "fabric") for k in range(n)])  # fmt: skip
            if link != "base":
                b.hinge(link, "base", (at, 0, low + pad), Y, 0, b.uniform(0.3, 1.1), opens=Z)
        if b.chance(0.5):  # rails that stay
            rods(b, "base", ((-0.2, y, rail), (0.4, y, rail), 0.012, "metal"),
                  *[((u, y, seat), (u, y, rail), 0.01, "metal") for u in (-0.2, 0.4)])  # fmt: skip
        settle(b)
        return
    back, y, arm = seat + b.uniform(0.3, 0.6), w + 0.02, seat + 0.2
    front = min(-b.uniform(0.32, 0.45), x - big - 1.6 * r - g)
    rolls(b, x, y + 0.045, big, 0.035, b.choice(("spoke", "spoke", "cast", "disc")), True)
    for link, s in ((b.links[-2][0], 1), (b.links[-1][0], -1)) if b.chance(0.7) else ():
        b.torus(link, (x, s * (y + 0.068), big), Y, 0.9 * big, 0.01, "metal", collision=False)
    top = _casters(b, front, y - 0.02, r, swivel, live)
    tubes = [((x, y, big), (x, y, back)), ((x, y, seat), (front, y, seat)),
             ((x, y, big), (x, y + 0.045, big)), ((front, y - 0.02, top), (front, y, seat)),
             ((x, y, top), (front, y, top)), ((x, y, top), (x, y, seat)),
             ((x, y, back), (0.16, y, back)), ((x, -y, big), (x, y, big)),
             ((front, y - 0.03, seat), (front - 0.1 - 1.2 * r, y - 0.04, 0.1))]  # fmt: skip
    rods(b, "base", *[(p, q, 0.012, "metal") for p, q in tubes])
    rows = [(front / 2, y, arm, -0.9 * front, 0.04, 0.03, "dark"),
            (0.7 * front, y, seat + 0.1, 0.02, 0.02, 0.2, "metal"),
            (0, 0, top + 0.1, 0.3, 1.5 * w, 0.18, "dark")][: b.choice((0, 2, 3))]  # fmt: skip
    rest, high = part(b, "back") if b.chance(0.3) else "base", back - seat - 0.05
    boxes(b, "base", (front / 2 + 0.02, 0, seat, -front, 2 * w, 0.03, "fabric"), *rows,
           (front - 0.14 - 1.2 * r, w / 2, 0.095, 0.14, 0.8 * w, 0.01, "dark"))  # fmt: skip
    boxes(b, rest, (0.02, 0, seat + 0.04 + high / 2, 0.02, 2 * w - 0.02, high, "fabric"))
    if rest != "base":
        b.hinge(rest, "base", (0.02, 0, seat + 0.04), Y, 0, 1.3, opens=OUT)
    settle(b)


def trailer_ramp(b: Builder) -> None:
    """A trailer, van or container with a ramp, doors, a hatch or a shutter at its end."""
    h, long, r, t = b.uniform(0.7, 1.4), b.uniform(1, 2.8), b.uniform(0.12, 0.2), 0.03
    b.size(long, 1, 1.3 * h)
    b.theme(b.choice(COATS))
    kind, g, live, y = b.choice((0, 1, 2)), max(b.gap, 0.003), b.chance(0.25), 0.52 + 0.25 * r
    z0, x, end = (1.1 * r, 2.2 * r, 0.04)[kind], 0.55 * long, long + b.uniform(0.45, 0.8)
    roof, ribs = z0 + h, b.integer(3, 12) if kind == 2 or b.chance(0.3) else 0
    b.shell("base", (0, -0.5, z0), (long, 0.5, roof), t, b.choice(("-x", "-x", "-x", "-x,+z")))
    if kind == 0:
        rods(b, "base", ((x, -y, r), (x, y, r), 0.1 * r, "dark"),
              ((long - 0.1, 0.3, z0), (end, 0, z0), 0.03, "metal"))  # fmt: skip
        boxes(b, "base", (x, y, 2.25 * r, 2.4 * r, 0.6 * r, 0.1 * r, "dark"))
        rolls(b, x, y, r, 0.4 * r, b.choice(TYRES), live)
    elif kind == 1:
        with b.moved((end, 0, 0), Z, np.pi):
            _cab(b, end - long - 0.03, 0.96, z0, b.uniform(0.6, 1.0) * h)
        for x in (0.2 * long, 0.5 * (end + long)):
            _axle(b, x, r, 0.48, 0.12, "tyre", "each" if live else "", z0 + 0.01)
        boxes(b, "base", (end / 2, 0.2, z0 - 0.04, 0.9 * end, 0.08, 0.08, "dark"))
    boxes(b, "base", (0.03, 0.47, roof - 0.06, 0.03, 0.08, 0.04, "red"),
           *[(x, 0.5, z0 + h / 2, 0.05, 0.04, h - 0.2, "trim")
             for x in np.linspace(0.1, long - 0.1, ribs)])  # fmt: skip
    mode, x = b.choice(("ramp", "ramp", "pair", "pair", "roll", "hatch")), -g - t
    fixed = b.integer(0, 5)
    for s in BOTH if mode == "pair" else ():
        link = "base" if fixed == 1 + s else part(b, "door")
        lo, hi = sorted((s * (g + 0.002), s * 0.49))
        b.panel(link, (x, lo, z0 + g), (-g, hi, roof - g), "front")
        with b.moved((x - 0.01, s * 0.25, z0)):  # a lock rod with its lever, hinge barrels
            b.cylinder(link, (0, 0, g), (0, 0, h - g), 0.012, None, "metal")
            b.block(link, (-0.015, 0.04, 0.4 * h), (0.02, 0.14, 0.025), "metal", "handle")
            for k in (0.15, 0.8):
                b.cylinder(link, (0.01, s * 0.235, k * h), (0.01, s * 0.235, k * h + 0.07), 0.015)
        if link != "base":
            b.hinge(link, "base", (x, s * 0.485, z0), Z, 0, b.uniform(1.3, 1.9), opens=OUT)
    if mode != "pair":
        key, n, share = part(b, "door"), b.integer(4, 12), b.choice((1.0, b.uniform(0.6, 1.0)))
        if mode == "hatch":  # below a beam
            share = 1.0
            boxes(b, "base", (x / 2, 0, roof + 0.02, -x, 1.0, 0.04, "trim"))
        high, d = z0 + (h if mode == "roll" else share * h) - g, h * share / n
        b.panel(key, (x, -0.49, z0 + g), (-g, 0.49, high), "front")
        boxes(b, key, *[(x, 0, z0 + (k + 0.5) * d, 0.02, 0.8, 0.3 * d, "trim") for k in range(n)])
        b.handle(key, (x, 0.43, z0 + 0.3 * h), OUT, Z, 0.15, b.choice(("bar", "bow", "none")))
        if mode == "roll":  # a shutter between rails
            boxes(b, "base", (x / 2, 0.53 + g, z0 + h / 2, -x, 0.06 + g, h, "trim"))
            b.slide(key, "base", Z, 0, b.uniform(0.5, 0.9) * h)
        else:
            at = (x, 0, z0 + g if mode == "ramp" else high)
            b.hinge(key, "base", at, Y, 0, b.uniform(1.0, 1.6), opens=OUT)
    settle(b)


def steering_stand(b: Builder) -> None:
    """A ship's wheel, steering wheel, joystick, gear shift or pedals among still controls."""
    kind = b.choice(("ship", "wheel", "lever", "lever", "pedal"))
    h, r = b.uniform(0.5, 1.1), b.uniform(0.12, 0.35)
    b.size(0.4, 2 * r, h + r if kind in ("ship", "wheel") else 0.4)
    b.theme(b.choice((*COATS, "wood")))
    g, n, w, ship = max(b.gap, 0.002), b.integer(1, 4), b.uniform(0.08, 0.14), kind == "ship"
    if kind in ("ship", "wheel"):
        far, n = b.choice((np.inf, b.uniform(1, 6))), 2 * n + 2 if ship else n + 1
        lean, wide = 0.0 if ship else b.uniform(0.2, 1.2), b.uniform(0.8, 1.6) * r
        at = np.array([-0.12, 0, h])
        e, key = np.array([-np.cos(lean), 0, np.sin(lean)]), part(b, "wheel", "helm")
        p = at - 0.08 * e
        if b.chance(0.5):
            wedge(b, "base", (-0.06, -0.15, 0.2, 0.15), (0, -0.08, 0.14, 0.08), 0, h + 0.06)
        else:
            rods(b, "base", ((0.07, 0, 0), (0.07, 0, 0.03), 0.2, "trim"),
                  ((0.07, 0, 0), (0.07, 0, h + 0.08), 0.07, "body"))  # fmt: skip
        if b.chance(0.6):  # a dashboard with gauges and keys that stay
            boxes(b, "base", (0.1, 0, h + 0.02, 0.14, 2 * wide, b.uniform(0.1, 0.2), "dark"))
            for y in np.linspace(-0.75, 0.75, b.integer(2, 5)) * wide:
                dial(b, "base", (0.03, y, h + 0.02), OUT, 0.03, 0.012)
        rods(b, "base", (at - g * e, at - 0.25 * e, 0.03, "metal"),
              (p, p + (0, b.uniform(0.02, 0.14), 0.02), 0.008, "dark"))  # fmt: skip
        with b.facing(at, e):
            b.cylinder(key, (0, 0, 0), (0, 0, 0.05), b.uniform(0.15, 0.3) * r, None, "dark")
            for k in (0.8, 0.6) if ship else (0.8,):
                b.torus(key, (0, 0, 0.025), Z, k * r, b.uniform(0.01, 0.018), "wood", "handle")
            for c in TAU * np.arange(n) / n:
                d, hub = r * np.array([np.cos(c), np.sin(c), 0]), np.array([0, 0, 0.025])
                b.cylinder(key, hub, 0.8 * d + hub, 0.01, None, "metal")
                if ship:
                    b.cylinder(key, 0.8 * d + hub, 1.2 * d + hub, 0.014, None, "wood")
            b.spin(key, "base", (0, 0, 0), Z, -far, far, closed=0.0)
    elif kind == "pedal":
        n, wide = n + 1, 1.4 * (n + 1) * w
        boxes(b, "base", (0, 0, 0.01, 0.4, wide, 0.02, "dark"),
               (0.18, 0, 0.12, 0.03, wide, 0.24, "body"))  # fmt: skip
        rods(b, "base", ((0.1, -0.48 * wide, 0.2), (0.1, 0.48 * wide, 0.2), 0.012, "metal"))
        for k in range(n):
            y = 1.3 * w * (k - (n - 1) / 2)
            link = part(b, "pedal") if k == 0 or b.chance(0.6) else "base"
            b.tube(link, (0.1, y - 0.3 * w, 0.2), (0.1, y + 0.3 * w, 0.2), 0.025, 0.0145, "metal")
            bar(b, link, (0.09, y, 0.19), (-0.06, y, 0.1), 0.02, 0.015, Y, "metal")
            size = b.uniform(0.4, 0.9) * w
            bar(b, link, (-0.09, y, 0.13), (-0.04, y, 0.06), size, 0.015, (1, 0, 0.7), "rubber")
            if link != "base":
                b.hinge(link, "base", (0.1, y, 0.2), Y, 0, b.uniform(0.1, 0.2), opens=(0, 0, -1))
    else:
        deep, long, axis = b.uniform(0.04, 0.12), b.uniform(0.1, 0.3), b.choice((X, Y, Y))
        w, axis, ball = 1.6 * w, axis if n == 1 else Y, b.uniform(0.022, 0.03)
        wide = max(w, 0.09 * n)
        rounded(b, "base", (-0.7 * w, -wide, 0), (0.7 * w, wide, deep), 0.2 * w)
        for x in (-0.45, 0, 0.45)[: b.integer(0, 3)]:
            for s in BOTH:
                dial(b, "base", (x * w, s * (wide - 0.03), deep), Z, 0.016, 0.012)
        for k in range(n):
            y = 0.09 * (k - (n - 1) / 2)
            link = part(b, "lever") if k == 0 or b.chance(0.6) else "base"
            b.sphere("base", (0, y, deep), ball, "rubber")
            with b.moved((0, y, deep), Y, b.choice((0.0, b.uniform(-0.3, 0.3)))):
                b.cylinder(link, (0, 0, 0.3 * ball), (0, 0, long), 0.009, None, "metal")
                if n == 1 or b.chance(0.3):
                    b.cylinder(link, (0, 0, long / 2), (0, 0, long), 0.02, 0.024, "dark", "handle")
                    boxes(b, link, (-0.022, 0, 0.85 * long, 0.02, 0.015, 0.04, "red"))
                else:
                    b.sphere(link, (0, 0, long), ball, b.choice(PAINTS), "handle")
            if link != "base":
                b.hinge(link, "base", (0, y, deep), axis, -0.35, 0.35, closed=0.0)
    settle(b)


CATEGORIES: dict[str, Callable[[Builder], None]] = {
    "tipper_truck": tipper_truck,
    "excavator": excavator,
    "skateboard": skateboard,
    "wheelchair": wheelchair,
    "trailer_ramp": trailer_ramp,
    "steering_stand": steering_stand,
}
