"""Abstract machines for training: bodies with rows of controls, chambers with what slides inside
them, things on wheels, booms on posts.

What a row looks like does not say whether it moves: now and then a whole row stays. Parts stand
before their body, touch it or lie partly inside.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from mam_pipeline.types import FloatArray
from mam_training.curricula.cases import FRONTS, HANDLES
from mam_training.curricula.mechanisms import clump, decoys
from mam_world import mech
from mam_world.kit import Builder

STILL = 0.15  # of the rows do not move
DEPTHS = (-1.0, 0.0, 0.3, 0.7)  # how far a control is sunk, in its own height; -1: it hovers


def _control(b: Builder, kind: str, host: str, s: float, wide: float, tall: float) -> None:
    """One control at the frame's origin, local z outwards."""
    deep = b.choice(DEPTHS)
    foot = max(b.gap, 2e-4) if deep < 0 else -deep * tall
    moves = not kind.startswith("still")
    kind = kind.removeprefix("still_")
    name = "slider" if kind == "fader" else kind
    link = b.link(name, name) if moves else host
    if kind == "knob":
        if b.chance(0.4):
            mech.dial(b, link, (0, 0, foot), (0, 0, 1), s, tall)
        else:
            b.cylinder(link, (0, 0, foot), (0, 0, tall), s, s * b.choice((1.0, 1.0, 0.8)))
            mark = b.integer(0, 3)
            if mark == 0:
                b.box(link, (-0.12 * s, 0, tall), (0.12 * s, s, 1.15 * tall))
            elif mark == 1:
                b.box(link, (-0.2 * s, -0.95 * s, tall), (0.2 * s, 0.95 * s, 1.6 * tall))
        if moves:
            b.spin(link, host, (0, 0, 0), (0, 0, 1), 0.0, b.uniform(1.5, 6.0))
    elif kind == "button":
        if wide < 0:
            b.cylinder(link, (0, 0, foot), (0, 0, tall), s)
        else:
            b.box(link, (-s, -wide * s, foot), (s, wide * s, tall))
        if moves:
            b.slide(link, host, (0, 0, -1), 0.0, 0.4 * tall, ajar=False)
    elif kind == "switch":
        angle = b.choice((0.0, 0.3, -0.3))
        with b.moved((0, 0, 0), (0, 1, 0), angle):
            b.box(link, (-s, -0.5 * abs(wide) * s, foot), (s, 0.5 * abs(wide) * s, tall))
        if moves:
            b.hinge(link, host, (0, 0, 0), (0, 1, 0), -0.3 - angle, 0.3 - angle)
    else:
        b.box(link, (-0.4 * s, -0.6 * s, foot), (0.4 * s, 0.6 * s, 1.5 * tall))
        if moves:
            b.slide(link, host, (1, 0, 0), -s, s)


def _row(b: Builder, host: str, low: FloatArray, high: FloatArray) -> None:
    """Controls in a grid on the plane of a panel: (2,) corners in the frame's x and y."""
    span = high - low
    long = int(np.argmax(span))
    rows = b.choice((1, 1, 1, 2, 3))
    most = max(1, int(span[long] / (span[1 - long] / rows)))
    columns = b.integer(1, int(np.clip(most, 1, 8 if rows == 1 else 4)))
    pitch = min(span[long] / columns, span[1 - long] / rows)
    s = pitch * b.uniform(0.15, 0.45)
    tall = s * float(np.exp(b.uniform(np.log(0.15), np.log(2.0))))
    kind = b.choice(("button", "button", "knob", "knob", "switch", "fader"))
    wide = b.choice((-1.0, 1.0, 1.0, 0.5, b.uniform(0.3, 1.0)))
    if b.chance(STILL):
        kind = "still_" + kind
    for i in range(columns):
        for j in range(rows):
            at = np.zeros(3)
            at[long] = low[long] + span[long] * (i + 0.5) / columns
            at[1 - long] = low[1 - long] + span[1 - long] * (j + 0.5) / rows
            with b.moved(at):
                _control(b, kind, host, s, wide, tall)


def _chamber(b: Builder, d: float, low: FloatArray, high: FloatArray, t: float) -> None:
    """A hollow in the body behind x = 0 with a door or a drawer before it and racks in it.

    Args:
        low, high: (2,) corners in y and z of the opening.
    """
    (y0, z0), (y1, z1) = low, high
    g = max(b.gap, 5e-4)
    front = t * b.uniform(0.5, 1.5)
    x0 = b.choice((-front - g, -front - g, 0.0))
    kind = b.choice(("side", "side", "down", "down", "up", "drawer", "open"))
    if kind != "open":
        lap = b.choice((0.0, 0.0, 0.5 * t)) if x0 < 0 else -g
        lo, hi = np.array([x0, y0 - lap, z0 - lap]), np.array([x0 + front, y1 + lap, z1 + lap])
        name = "drawer" if kind == "drawer" else "door"
        link = b.link(name, name)
        b.front(link, lo, hi, b.choice(FRONTS))
        middle, side = (lo + hi) / 2, b.choice((-1, 1))
        if kind == "side":
            at = (x0, middle[1] - side * 0.42 * (hi - lo)[1], middle[2])
            b.handle(link, at, (-1, 0, 0), (0, 0, 1), 0.5 * (z1 - z0), b.choice(HANDLES))
            edge = middle[1] + side * (hi - lo)[1] / 2
            b.hinge(link, "base", (x0 + front, edge, 0), (0, 0, side), 0.0, b.uniform(1.4, 2.4))
        elif kind == "drawer":
            b.handle(link, (x0, middle[1], middle[2]), (-1, 0, 0), (0, 1, 0), 0.4 * (y1 - y0),
                     b.choice(HANDLES))  # fmt: skip
            if b.chance(0.7):
                corner = (x0 + front, y0 + g, z0 + g)
                b.shell(link, corner, (0.9 * d, y1 - g, z1 - g), 0.3 * t, "+z")
            b.slide(link, "base", (-1, 0, 0), 0.0, 0.7 * d)
            return
        else:
            up = kind == "up"
            at = (x0, middle[1], (lo if up else hi)[2] - (-1 if up else 1) * 0.1 * (z1 - z0))
            b.handle(link, at, (-1, 0, 0), (0, 1, 0), 0.7 * (y1 - y0), b.choice(HANDLES))
            b.hinge(link, "base", (x0 + front, 0, (hi if up else lo)[2]), (0, -1 if up else 1, 0),
                    -1.5, 0.0)  # fmt: skip
    count = b.choice((0, 1, 2, 3), (0.2, 0.3, 0.3, 0.2))
    start = max(x0 + front, 0.0) + 0.02 * d
    what, still = b.choice(("plate", "grid", "tray", "basket")), b.chance(STILL)
    thick = b.uniform(0.02, 0.12) * (z1 - z0)
    for k in range(count):
        z = z0 + (k + 0.5) / count * (z1 - z0)
        link = "base" if still else b.link("rack", "drawer")
        slack = b.choice((g, 0.02 * (y1 - y0)))
        lo, hi = np.array([start, y0 + slack, z]), np.array([0.92 * d, y1 - slack, z + thick])
        if what == "plate":
            b.box(link, lo, hi)
        elif what == "tray":
            b.shell(link, lo, hi, 0.2 * thick, "+z")
        else:
            n, r = b.integer(3, 7), 0.25 * thick
            for y in (lo[1] + r, hi[1] - r):
                b.cylinder(link, (lo[0], y, z + r), (hi[0], y, z + r), r)
            for x in np.linspace(lo[0] + r, hi[0] - r, n):
                b.cylinder(link, (x, lo[1] + r, z + r), (x, hi[1] - r, z + r), r)
            if what == "basket":
                tall = min(0.6 * (z1 - z0) / count, 6 * thick)
                for x in (lo[0] + r, hi[0] - r):
                    b.cylinder(link, (x, lo[1] + r, z + tall), (x, hi[1] - r, z + tall), r)
                for y in (lo[1] + r, hi[1] - r):
                    b.cylinder(link, (lo[0], y, z + tall), (hi[0], y, z + tall), r)
                    for x in (lo[0] + r, hi[0] - r):
                        b.cylinder(link, (x, y, z + r), (x, y, z + tall), r)
        if not still:
            b.slide(link, "base", (-1, 0, 0), 0.0, 0.6 * d)


def machine(b: Builder) -> None:
    """A body of boards or one block with chambers, rows of controls and a lid."""
    d, w, h = b.uniform(0.2, 0.8), b.uniform(0.25, 1.0), b.uniform(0.2, 1.4)
    b.size(d, w, h)
    b.theme()
    t = b.uniform(0.01, 0.05) * min(w, h, 2 * d)
    strip = b.choice(("top", "top", "side", "none"))
    share = b.uniform(0.1, 0.3)
    y1, z1 = w / 2, h
    panel: tuple[FloatArray, FloatArray] | None = None
    if strip == "top":
        z1 = h * (1 - share)
        panel = np.array([-w / 2 + t, z1 + t / 2]), np.array([w / 2 - t, h - t / 2])
    elif strip == "side":
        y1 = w * (0.5 - share)
        panel = np.array([y1 + t / 2, t]), np.array([w / 2 - t / 2, h - t])
    face = 0.0
    if panel is not None:
        low, high = panel
        face = b.choice((0.0, 0.0, -0.5 * t))
        b.box("base", (face, low[0] - t, low[1] - t / 2), (d, high[0] + t, high[1] + t / 2))
    cells = b.integer(1, 3)
    across = b.chance(0.35)
    cuts = np.sort(np.r_[0, b.rng.uniform(0.25, 0.75, cells - 1), 1])
    solid = b.chance(0.15)
    for k in range(cells):
        low, high = np.array([-w / 2, 0.0]), np.array([y1, z1])
        axis = 0 if across else 1
        span = high[axis] - low[axis]
        low[axis], high[axis] = low[axis] + cuts[k] * span, low[axis] + cuts[k + 1] * span
        if (high - low).min() < 6 * t:
            b.box("base", (0, low[0], low[1]), (d, high[0], high[1]))
            continue
        if solid:
            b.box("base", (0, low[0], low[1]), (d, high[0], high[1]))
        else:
            b.shell("base", (0, low[0], low[1]), (d, high[0], high[1]), t, "-x")
        _chamber(b, d, low + t, high - t, t)
    if panel is not None:
        low, high = panel
        with b.facing((face, 0, 0), (-1, 0, 0), (0, 1, 0)):
            # local x is +y; local y completes the frame
            up = b.direction((0, 1, 0))[2]
            rise = np.sort([up * low[1], up * high[1]])
            stops = np.linspace(low[0], high[0], b.integer(1, 2) + 1)
            for start, end in pairwise(stops):
                _row(b, "base", np.array([start, rise[0]]), np.array([end, rise[1]]))
    if b.chance(0.2):
        link, g = b.link("lid", "lid"), max(b.gap, 5e-4)
        b.box(link, (0, -w / 2, h + g), (d, w / 2, h + g + t))
        b.hinge(link, "base", (d, 0, h + g), (0, 1, 0), 0.0, 1.5)
    elif b.chance(0.3):
        with b.moved((d / 2, 0, h)):
            reach = 0.35 * np.array([d, w])
            _row(b, "base", -reach, reach)
    if b.chance(0.3):
        r = b.uniform(0.3, 2.0) * t
        spots = ((0.5, 0.5),) if b.chance(0.5) else [(x, y) for x in (0.1, 0.9) for y in (0.1, 0.9)]
        reach = np.array([0.45 * d, 0.45 * w]) if len(spots) == 1 else np.array([t, t])
        for x, y in spots:
            at = np.array([x * d, (y - 0.5) * w])
            b.box("base", (*(at - reach), -2 * r), (*(at + reach), 0))
    decoys(b, np.array([0, -w / 2, 0]), np.array([d, w / 2, h]), b.integer(0, 2), (-1, 0, 0))


def rolling(b: Builder) -> None:
    """A body of blocks and tubes on two to six wheels that stand beside it, under or in it.

    Wheels are discs, tyres or balls; some of the front ones steer. It may have a loading bed that
    tips, doors, a steering wheel or a bow to push it by.
    """
    d, w, h = b.uniform(0.4, 1.4), b.uniform(0.2, 0.8), b.uniform(0.05, 0.5)
    r = b.uniform(0.1, 0.45) * min(d / 2, w)
    b.size(d, w, h + r)
    b.theme()
    bottom = r * b.uniform(0.5, 1.8)
    low, high = np.array([0, -w / 2, bottom]), np.array([d, w / 2, bottom + max(h, 0.05)])
    body = b.choice(("clump", "clump", "blocks", "tubes"))
    if body == "clump":
        clump(b, "base", low, high, 4)
    elif body == "blocks":
        b.box("base", low, (d, w / 2, bottom + 0.3 * h))
        for _ in range(b.integer(1, 4)):
            size = b.rng.uniform(0.15, 0.6, 3) * (high - low)
            at = low + b.rng.uniform(0, 1, 3) * (high - low - size)
            at[2] = bottom + 0.3 * h
            b.box("base", at, at + size)
    else:
        k = 0.06 * w
        corner = [(x, y) for x in (0, d) for y in (-w / 2, w / 2)]
        for z in (bottom, bottom + h):
            for (x, y), (u, v) in ((corner[0], corner[1]), (corner[1], corner[3]),
                                   (corner[3], corner[2]), (corner[2], corner[0])):  # fmt: skip
                b.cylinder("base", (x, y, z), (u, v, z), k)
        for x, y in corner:
            b.cylinder("base", (x, y, bottom), (x, y, bottom + h), k)
        b.box("base", low, (d, w / 2, bottom + k))
    width = b.uniform(0.15, 0.9) * r
    shape = b.choice(("disc", "disc", "wheel", "ball", "torus"))
    axles = b.integer(1, 3)
    inset = b.choice((-1.0, -1.0, 0.0, 0.5, 1.0))  # beside the body .. inside its outline
    y = w / 2 - inset * width / 2 + (max(b.gap, 1e-3) if inset < 0 else 0)
    single = b.chance(0.2)
    steers = b.chance(0.25)
    for k, x in enumerate(np.linspace(r, d - r, axles) if axles > 1 else [b.uniform(0.2, 0.8) * d]):
        if b.chance(0.4):
            b.cylinder("base", (x, -w / 2, r), (x, w / 2, r), 0.15 * r)
        for side in (0,) if single and k == 0 else (-1, 1):
            host = "base"
            if steers and k == 0 and axles > 1:
                host = b.link("fork", "lever")
                b.cylinder(host, (x, side * y, 0.9 * r), (x, side * y, bottom + h), 0.12 * r)
                if b.chance(0.5):
                    wide = 0.35 * w if side == 0 else 0.1 * w
                    b.cylinder(host, (x, side * y - wide, bottom + 1.3 * h),
                               (x, side * y + wide, bottom + 1.3 * h), 0.1 * r)  # fmt: skip
                    b.cylinder(host, (x, side * y, bottom + h), (x, side * y, bottom + 1.3 * h),
                               0.12 * r)  # fmt: skip
                b.hinge(host, "base", (x, side * y, 0), (0, 0, 1), -0.6, 0.6)
            link = b.link("wheel", "wheel")
            at = (x, side * y, r)
            if shape == "ball":
                b.sphere(link, at, r)
            elif shape == "wheel":
                mech.wheel(b, link, at, (0, 1, 0), r, width)
            elif shape == "torus":
                b.torus(link, at, (0, 1, 0), r - 0.25 * width, 0.25 * width)
                near, far = side * y - width / 3, side * y + width / 3
                b.cylinder(link, (x, near, r), (x, far, r), 0.8 * r)
            else:
                b.cylinder(link, (x, side * y - width / 2, r), (x, side * y + width / 2, r), r)
            b.spin(link, host, at, (0, 1, 0))
    top = bottom + max(h, 0.05)
    extra = b.choice(("none", "none", "bed", "door", "steer", "mast"))
    if extra == "bed":
        link, g = b.link("bed", "lid"), max(b.gap, 1e-3)
        x0 = b.uniform(0.3, 0.6) * d
        rim = top + g + b.uniform(0.1, 0.3) * w
        b.shell(link, (x0, -w / 2, top + g), (d, w / 2, rim), 0.02 * w, "+z")
        b.hinge(link, "base", (d, 0, top + g), (0, 1, 0), 0.0, 1.0)
    elif extra == "door":
        g, thick = max(b.gap, 1e-3), 0.03 * w
        for side in (-1, 1)[: b.integer(1, 2)]:
            link, at = b.link("door", "door"), side * (w / 2 + g)
            low_y, high_y = sorted((at, at + side * thick))
            b.box(link, (0.3 * d, low_y, bottom + 0.1 * h), (0.6 * d, high_y, top))
            b.hinge(link, "base", (0.3 * d, at, 0), (0, 0, side), 0.0, 1.2)
    elif extra == "steer":
        link = b.link("steering", "wheel")
        s = 0.15 * w
        with b.moved((0.3 * d, 0, top + s), (0, 1, 0), b.uniform(-0.9, -0.2)):
            b.torus(link, (0, 0, 0), (0, 0, 1), s, 0.12 * s)
            b.cylinder(link, (0, 0, -1.5 * s), (0, 0, 0), 0.15 * s)
            for k in range(b.integer(2, 4)):
                with b.moved((0, 0, 0), (0, 0, 1), 2.1 * k):
                    b.box(link, (0, -0.08 * s, -0.08 * s), (s, 0.08 * s, 0.08 * s))
            b.spin(link, "base", (0, 0, 0), (0, 0, 1), -2.0, 2.0)
    elif extra == "mast":
        b.sweep("base", [(d, -w / 3, top), (1.2 * d, -w / 3, top + 3 * r),
                         (1.2 * d, w / 3, top + 3 * r), (d, w / 3, top)], 0.1 * r)  # fmt: skip
    decoys(b, low, high, b.integer(0, 3), (0, 0, -1))


def boom(b: Builder) -> None:
    """A long arm on a post or stand that turns, tips or both: barrier, crane, seesaw, sign, fan."""
    tall, foot = b.uniform(0.2, 1.5), b.uniform(0.05, 0.4)
    length, thick = b.uniform(0.4, 2.5), b.uniform(0.02, 0.12)
    b.size(foot, length, tall)
    b.theme()
    stand = b.choice(("block", "block", "post", "tripod"))
    if stand == "block":
        b.box("base", (-foot / 2, -foot / 2, 0), (foot / 2, foot / 2, tall))
    else:
        b.cylinder("base", (0, 0, 0), (0, 0, tall), b.uniform(0.6, 1.5) * thick)
        if stand == "post":
            b.box("base", (-foot, -foot, 0), (foot, foot, 0.05 * tall))
        else:
            for k in range(3):
                with b.moved((0, 0, 0), (0, 0, 1), 2.1 * k):
                    b.cylinder("base", (foot, 0, 0), (0, 0, 0.4 * tall), 0.5 * thick)
    g = max(b.gap, 5e-4)
    host, z = "base", tall + g
    how = b.choice(("tip", "tip", "turn", "both"))
    if how == "both":
        host = b.link("head", "part")
        s = b.uniform(0.8, 1.6) * thick
        b.cylinder(host, (0, 0, tall + g), (0, 0, tall + g + s), s)
        b.spin(host, "base", (0, 0, 0), (0, 0, 1), -3.0, 3.0)
        z = tall + 2 * g + s
    beside = how != "turn" and b.chance(0.5)
    start = -b.uniform(0.05, 0.5) * length
    x = b.choice((-1, 1)) * (foot / 2 + thick / 2 + g) if beside and stand == "block" else 0.0
    z += -0.15 * tall if x else thick / 2
    link = b.link("boom", "lever")
    if b.chance(0.6):
        b.box(link, (x - thick / 2, start, z - thick / 2), (x + thick / 2, start + length,
              z + thick / 2))  # fmt: skip
    else:
        b.cylinder(link, (x, start, z), (x, start + length, z), thick / 2)
    if b.chance(0.4):
        s = b.uniform(1.0, 3.0) * thick
        b.box(link, (x - s / 2, start, z - s), (x + s / 2, start + 2 * s, z + 0.5 * s))
    if b.chance(0.3):
        s = b.uniform(1.0, 4.0) * thick
        b.box(link, (x - s, start + length - s, z - s / 2), (x + s, start + length + s, z + s / 2))
    if how == "turn":
        b.spin(link, host, (0, 0, 0), (0, 0, 1), -3.0, 3.0)
    else:
        if b.chance(0.6):
            r, reach = b.uniform(0.2, 0.45) * thick, foot / 2 + thick
            b.cylinder(b.choice((host, link)), (-reach, 0, z), (reach, 0, z), r)
        b.hinge(link, host, (x, 0, z), (1, 0, 0), -0.4, 1.4)
    if b.chance(0.3):
        hook, s = b.link("trolley", "part"), 1.5 * thick
        y = start + b.uniform(0.5, 0.9) * length
        b.box(hook, (x - s / 2, y - s / 2, z - thick / 2 - g - s), (x + s / 2, y + s / 2,
              z - thick / 2 - g))  # fmt: skip
        b.slide(hook, link, (0, 1, 0), -0.2 * length, 0.05 * length)
    low, high = np.array([-foot / 2, -foot / 2, 0]), np.array([foot / 2, foot / 2, tall])
    decoys(b, low, high, b.integer(0, 2), (0, 0, 1))
