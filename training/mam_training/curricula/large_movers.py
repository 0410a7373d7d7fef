"""Abstract objects for training in which size misleads: the mover is the largest piece, stands
open at rest, or shares its base with movers of other kinds.
"""

from __future__ import annotations

import numpy as np

from mam_pipeline.types import FloatArray
from mam_training.curricula.cases import FRONTS, HANDLES
from mam_training.curricula.mechanisms import MOVERS, base_body, clump, decoys
from mam_world import mech, solids
from mam_world.kit import Builder


def leaf(b: Builder) -> None:
    """A door or gate that outweighs what holds it: posts, one post, a strip of wall, a slim frame.

    Some have a latch that turns on them; some turn about their middle.
    """
    w, h, t = b.uniform(0.25, 1.2), b.uniform(0.2, 2.0), b.uniform(0.01, 0.12)
    b.size(t, w, h)
    b.theme()
    g = max(b.gap, 5e-4) * b.choice((1.0, 3.0))
    _holder(b, w, h, t, g)
    link = b.link("leaf", "door")
    x = b.uniform(-0.3, 0.3) * t
    low, high = np.array([x, -w / 2 + g, g]), np.array([x + t, w / 2 - g, h - g])
    kind = b.choice(("plain", "front", "rounded", "bars", "pieces"))
    if kind == "plain":
        b.box(link, low, high)
    elif kind == "front":
        b.front(link, low, high, b.choice(FRONTS))
    elif kind == "rounded":
        solids.rounded(b, link, low, high, 0.45 * t)
    elif kind == "bars":
        b.border(link, low, high, 0.08 * min(w, h))
        for y in np.linspace(low[1], high[1], b.integer(3, 8) + 2)[1:-1]:
            b.cylinder(link, (x + t / 2, y, low[2]), (x + t / 2, y, high[2]), 0.3 * t)
    else:
        clump(b, link, low, high, 3)
        for s in b.rng.uniform(0.1, 0.9, b.integer(1, 3)):
            z = low[2] + s * (high[2] - low[2])
            b.box(link, (x - 0.3 * t, low[1], z), (x, high[1], z + 0.06 * h))
    side = b.choice((-1, 1))
    middle = b.chance(0.12)
    y = 0.0 if middle else side * (w / 2 - b.choice((0.0, 0.5 * t, 0.06 * w)))
    if middle or b.chance(0.1):
        b.spin(link, "base", (x + t / 2, y, 0), (0, 0, 1))
    else:
        swing = b.uniform(1.2, 2.6)  # between posts, nothing says which way
        b.hinge(link, "base", (x + t / 2, y, 0), (0, 0, 1), -swing, swing)
    if not middle and b.chance(0.4):
        r = b.uniform(0.2, 0.5) * t
        for share in (0.15, 0.85)[: b.integer(1, 2)]:
            z = share * h
            edge = (x, side * w / 2, z)
            b.cylinder(b.choice((link, "base")), (edge[0], edge[1], z - 0.03 * h),
                       (edge[0], edge[1], z + 0.03 * h), r)  # fmt: skip
    _latch(b, link, (x, -side * (w / 2 - b.uniform(0.06, 0.25) * w), b.uniform(0.3, 0.6) * h), t, w)


def _holder(b: Builder, w: float, h: float, t: float, g: float) -> None:
    """What a leaf hangs in: round or square posts, a frame, a strip of wall; some have a foot."""
    kind = b.choice(("posts", "posts", "rods", "rods", "one", "frame", "strip"))
    r = b.uniform(0.5, 1.6) * t
    top, foot = h * b.uniform(0.95, 1.15), -b.uniform(0.0, 0.1) * h
    sides = (-1, 1) if kind in ("posts", "rods", "frame") else (b.choice((-1, 1)),)
    for s in sides:
        inner, outer = s * (w / 2 + g), s * (w / 2 + g + 2 * r * (4 if kind == "strip" else 1))
        y = sorted((inner, outer))
        if kind == "rods":
            b.cylinder(
                "base", (t / 2, (inner + outer) / 2, foot), (t / 2, (inner + outer) / 2, top), r
            )
        else:
            b.box("base", (t / 2 - r, y[0], foot), (t / 2 + r, y[1], top))
    if kind == "frame":
        b.box(
            "base",
            (t / 2 - r, -w / 2 - g - 2 * r, h + g),
            (t / 2 + r, w / 2 + g + 2 * r, h + g + r),
        )
        if b.chance(0.5):
            b.box(
                "base", (t / 2 - r, -w / 2 - g - 2 * r, -r - g), (t / 2 + r, w / 2 + g + 2 * r, -g)
            )
    elif b.chance(0.3):
        reach = b.uniform(0.2, 0.6) * w
        b.box("base", (-reach, -w / 2 - 2 * r, foot - 0.03 * h), (reach, w / 2 + 2 * r, foot))


def _latch(b: Builder, door: str, spot: tuple[float, float, float], t: float, w: float) -> None:
    """A grip on a leaf: a lever or knob that turns on it, a fixed handle, or nothing."""
    kind = b.choice(("lever", "lever", "knob", "fixed", "fixed", "none"))
    r = float(np.clip(b.uniform(0.02, 0.08) * w, 0.008, 0.08))
    if kind == "fixed":
        b.handle(door, spot, (-1, 0, 0), (0, 0, 1), 8 * r, b.choice(HANDLES))
    if kind not in ("lever", "knob"):
        return
    turn = b.link("latch", "handle")
    both = b.chance(0.4)
    with b.facing(spot, (-1, 0, 0)):
        b.cylinder(
            turn, (0, 0, -(t + 2 * r if both else b.choice((0.0, t)))), (0, 0, 2 * r), 0.6 * r
        )
        if kind == "knob":
            b.sphere(turn, (0, 0, 2.4 * r), 1.3 * r)
        else:
            reach = b.choice((-1, 1)) * b.uniform(3, 7) * r
            for z in (2 * r, -t - 2 * r)[: 1 + both]:
                if b.chance(0.5):
                    y = sorted((-0.4 * r, reach))
                    b.box(turn, (-0.5 * r, y[0], z - 0.4 * r), (0.5 * r, y[1], z + 0.4 * r))
                else:
                    b.cylinder(turn, (0, 0, z), (0, reach, z), 0.6 * r)
        if b.chance(0.4):
            b.disc(door, (0, 0, 0), (0, 0, 1), 1.6 * r, 0.3 * r)
    b.hinge(turn, door, spot, (1, 0, 0), 0, 1.2)


def opened(b: Builder) -> None:
    """A box whose lid, flap or door stands open at rest; the opening looks up, ahead or aside."""
    w, d, h = b.uniform(0.15, 0.8), b.uniform(0.12, 0.6), b.uniform(0.03, 0.4)
    b.size(w, d, h)
    b.theme()
    t = min(b.uniform(0.005, 0.03), 0.3 * h)
    g = max(b.gap, 4e-4)
    angle = b.uniform(0.6, 3.1)
    turn = float(b.choice((0.0, 0.0, -np.pi / 2, np.pi / 2)))
    with b.moved((0, 0, 0), (0, 1, 0), turn):
        if b.chance(0.5):
            solids.tray(b, "base", (0, -w / 2, 0), (d, w / 2, h), t, "z", 1)
        else:
            b.shell("base", (0, -w / 2, 0), (d, w / 2, h), t, "+z")
        if b.chance(0.3):
            clump(
                b, "base", np.array([0.2 * d, -0.3 * w, t]), np.array([0.8 * d, 0.3 * w, 0.7 * h])
            )
        link = b.link("lid", "lid")
        hinge = np.array([d, 0, h + g])
        thick = t * b.uniform(0.7, 2.0)
        with b.moved(hinge, (0, 1, 0), angle):
            if b.chance(0.35):
                solids.tray(
                    b, link, (-d, -w / 2, 0), (0, w / 2, b.uniform(2, 6) * t), t / 2, "z", -1
                )
            else:
                b.box(link, (-d, -w / 2, 0), (0, w / 2, thick))
            if b.chance(0.3):
                b.handle(
                    link, (-d, 0, thick / 2), (-1, 0, 0), (0, 1, 0), 0.3 * w, b.choice(HANDLES)
                )
        if b.chance(0.7):
            n = b.integer(1, 3)
            for y in np.linspace(-0.35 * w, 0.35 * w, n) if n > 1 else (0.0,):
                b.cylinder(b.choice((link, "base")), (d, y - 0.06 * w, h + g),
                           (d, y + 0.06 * w, h + g), b.uniform(0.4, 1.0) * t)  # fmt: skip
        b.hinge(link, "base", hinge, (0, 1, 0), -angle, max(3.1 - angle, 0.0))
        if b.chance(0.3):
            for y in (-0.3 * w, 0.3 * w):
                b.block("base", (-0.3 * t, y, 0.7 * h), (0.8 * t, 0.05 * w, 0.2 * h))


def tap(b: Builder) -> None:
    """A post on a foot with a hub on it that carries an arm: taps, cranks, signs, masts."""
    h, r = b.uniform(0.05, 0.5), b.uniform(0.008, 0.06)
    reach = b.uniform(2.5, 10) * r
    b.size(2 * reach, 2 * reach, h)
    b.theme()
    foot = b.choice(("disc", "block", "none", "steps"))
    if foot == "disc":
        b.disc("base", (0, 0, 0), (0, 0, 1), b.uniform(1.5, 4) * r, 0.1 * h)
    elif foot == "block":
        clump(b, "base", np.array([-2 * r, -3 * r, 0]), np.array([2 * r, 3 * r, 0.3 * h]), 2)
    elif foot == "steps":
        b.disc("base", (0, 0, 0), (0, 0, 1), 3 * r, 0.08 * h)
        b.disc("base", (0, 0, 0.08 * h), (0, 0, 1), 2 * r, 0.08 * h)
    b.cylinder("base", (0, 0, 0), (0, 0, h), r, b.choice((r, 0.8 * r)))
    if b.chance(0.5):  # a spout that stays
        z = b.uniform(0.5, 0.85) * h
        path = [(0, 0, z), (0.6 * reach, 0, z + 0.1 * h), (reach, 0, z), (reach, 0, z - 2 * r)]
        b.sweep("base", path, 0.5 * r)
    upright = b.chance(0.7)
    link = b.link("arm", "handle")
    spot = (0, 0, h + b.choice((0.0, max(b.gap, 5e-4)))) if upright else (0, -r, 0.8 * h)
    with b.facing(spot, (0, 0, 1) if upright else (0, -1, 0), b.choice(((1, 0, 0), (-1, 0, 0)))):
        hub, tall = b.uniform(0.8, 2.2) * r, b.uniform(0.8, 3.0) * r
        b.cylinder(link, (0, 0, 0), (0, 0, tall), hub)
        z = b.uniform(0.3, 1.0) * tall
        thick = b.uniform(0.2, 0.7) * r
        rise = b.uniform(-0.2, 0.6) if upright else 0.0
        with b.moved((0, 0, z), (0, 1, 0), -rise):
            if b.chance(0.5):
                b.box(link, (0, -thick, -0.5 * thick), (reach, thick, 0.5 * thick))
            else:
                b.cylinder(link, (0.5 * hub, 0, 0), (hub, 0, 0), 0.5 * thick)
                b.cylinder(link, (hub, 0, 0), (reach, 0, 0), thick)
                if b.chance(0.5):
                    b.sphere(link, (reach, 0, 0), thick)
    full = b.chance(0.3)
    axis = (0, 0, 1) if upright else (0, 1, 0)
    if full:
        b.spin(link, "base", spot, axis)
    else:
        b.hinge(link, "base", spot, axis, -b.uniform(0.3, 1.6), b.uniform(0.3, 1.6))


def board(b: Builder) -> None:
    """One base with two to four movers of different kinds, each a piece or two, among decoys."""
    if b.chance(0.5):
        low, high = base_body(b)
        size = high - low
        faces = [("top", (0, 0, 1), (1, 0, 0))]
        if size[2] > 0.1:
            faces.append(("front", (-1, 0, 0), (0, 0, 1)))
    else:
        w, d, h = b.uniform(0.4, 1.4), b.uniform(0.3, 0.7), b.uniform(0.1, 0.6)
        b.size(w, d, h)
        b.theme()
        low, high = np.array([0, -w / 2, 0.0]), np.array([d, w / 2, h])
        b.box("base", low, high)
        if b.chance(0.5):
            b.feet("base", (0, -w / 2), (d, w / 2), -b.uniform(0.2, 0.6), "square")
        back = b.uniform(0.2, 0.6)
        lean = b.uniform(0.0, 0.5)
        with b.moved((d, 0, h), (0, 1, 0), lean):
            b.box("base", (-0.04, -w / 2, 0), (0, w / 2, back))
            if b.chance(0.5):
                _hatch(b, w, back)
        faces = [("top", (0, 0, 1), (1, 0, 0)), ("front", (-1, 0, 0), (0, 0, 1))]
        if b.chance(0.5):
            _drawer(b, low, high)
            faces = faces[:1]
    size = high - low
    count = b.integer(1, 3)
    for face, normal, along in faces:
        width = size[1] / count
        for k in range(count):
            if b.chance(0.35):
                continue
            y = low[1] + (k + 0.5) * width
            spot = (low[0] + 0.3 * size[0], y, high[2]) if face == "top" else (
                low[0], y, low[2] + 0.5 * size[2])  # fmt: skip
            room = min(width, size[0] if face == "top" else size[2])
            with b.facing(spot, normal, along):
                MOVERS[b.integer(0, len(MOVERS) - 1)](
                    b, b.link("part", "part"), room * b.uniform(0.09, 0.24)
                )
    if not b.joints:
        with b.facing((low[0] + 0.5 * size[0], 0, high[2]), (0, 0, 1), (1, 0, 0)):
            mech.dial(b, b.link("part", "part"), (0, 0, 0), (0, 0, 1), 0.05, 0.05)
        b.spin("part", "base", (low[0] + 0.5 * size[0], 0, high[2]), (0, 0, 1))
    decoys(b, low, high, b.choice((0, 1, 2, 4)), (0, 0, 1))


def _hatch(b: Builder, w: float, back: float) -> None:
    """A leaf that slides along a wall which faces -X and ends at x = -0.04."""
    link = b.link("hatch", "door")
    y0 = b.uniform(-0.45, 0.1) * w
    y1 = y0 + b.uniform(0.2, 0.35) * w
    g = max(b.gap, 5e-4)
    low = np.array([-0.06 - g, y0, b.uniform(0.05, 0.2) * back])
    b.box(link, low, (-0.04 - g, y1, 0.95 * back))
    if b.chance(0.8):
        b.handle(link, (low[0], (y0 + y1) / 2, 0.5 * back), (-1, 0, 0), (0, 0, 1), 0.3 * back,
                 b.choice(HANDLES))  # fmt: skip
    b.slide(link, "base", (0, 1, 0), -0.1 * w, 0.3 * w)


def _drawer(b: Builder, low: FloatArray, high: FloatArray) -> None:
    """A drawer's front, with a box behind it or without, on the face towards -X."""
    size = high - low
    width, tall = b.uniform(0.25, 0.6) * size[1], b.uniform(0.4, 0.8) * size[2]
    y, z = b.uniform(-0.15, 0.15) * size[1], low[2] + 0.1 * size[2]
    link = b.link("drawer", "drawer")
    g = max(b.gap, 5e-4)
    b.box(link, (low[0] - 0.02 - g, y - width / 2, z), (low[0] - g, y + width / 2, z + tall))
    if b.chance(0.9):
        b.handle(link, (low[0] - 0.02 - g, y, z + tall / 2), (-1, 0, 0), (0, 1, 0), 0.5 * width,
                 b.choice(HANDLES))  # fmt: skip
    b.slide(link, "base", (-1, 0, 0), 0, 0.6 * size[0])
