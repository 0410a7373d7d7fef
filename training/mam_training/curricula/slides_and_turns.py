"""Abstract pairs for training: what slides and what turns, in looks easily taken for one another.

A leaf beside a free run slides, the same leaf held in by its neighbour hinges; a long rod with a
head is pushed, a short one turned; a slanting key tips, a level one is pressed. Both of each are
drawn, so that the difference is learned.
"""

from __future__ import annotations

import numpy as np

from mam_pipeline.types import FloatArray
from mam_training.curricula.cases import FRONTS, HANDLES
from mam_training.curricula.mechanisms import base_body, clump, decoys
from mam_world import solids
from mam_world.kit import Builder

Box = tuple[FloatArray, FloatArray]


def tracks(b: Builder) -> None:
    """A body whose front is half covered by a leaf that slides along it, or is hinged beside it."""
    w, d, h = b.uniform(0.4, 1.6), b.uniform(0.08, 0.6), b.uniform(0.25, 1.4)
    b.size(w, d, h)
    b.theme()
    t = b.uniform(0.01, 0.04)
    tilt = float(b.choice((0.0, 0.0, 0.0, b.uniform(0.15, 0.9), np.pi / 2)))
    low, high = np.array([0.0, -w / 2, 0.0]), np.array([d, w / 2, h])
    with b.moved((0, 0, 0), (0, 1, 0), tilt):
        rim = b.uniform(0.0, 0.08) * min(w, h)
        _carcass(b, low, high, t, rim)
        share = b.uniform(0.35, 0.62)
        side = b.choice((-1, 1))
        inner = w - 2 * rim
        y0, y1 = sorted((side * inner / 2, side * (inner / 2 - share * inner)))
        if b.chance(0.6):
            _run(b, b.link("leaf", "door"), (y0, y1), (rim, h - rim), t, side, (w, d, rim))
        else:
            _beside(b, b.link("leaf", "door"), (y0, y1), (rim, h - rim), t, side, (w, d, rim))
    decoys(b, low, high, b.choice((0, 0, 1, 3)), (-1, 0, 0)) if tilt == 0.0 else None
    if tilt == 0.0 and b.chance(0.25):
        legs = b.uniform(0.05, 0.5)
        b.feet("base", (0, -w / 2), (d, w / 2), -legs, b.choice(("square", "round")))


def _carcass(b: Builder, low: FloatArray, high: FloatArray, t: float, rim: float) -> None:
    """What the leaf covers: an open shell, a solid, a wall with a hole, or a bare frame."""
    style = b.choice(("shell", "shell", "solid", "frame", "boards"))
    if style == "solid":
        clump(b, "base", low, high, 1)
    elif style == "frame" and rim > 0.01:
        b.border("base", (0, low[1], low[2]), (high[0], high[1], high[2]), rim)
        b.box(
            "base", (high[0] - 0.3 * t, low[1] + rim, low[2] + rim), high - np.array([0, rim, rim])
        )
    elif style == "boards":
        for y in (low[1], 0.0, high[1] - t):
            b.box("base", (0, y, 0), (high[0], y + t, high[2]))
        for z in (0.0, high[2] - t):
            b.box("base", (0, low[1], z), (high[0], high[1], z + t))
    else:
        b.shell("base", low, high, t, "-x")
        if b.chance(0.4):
            z = b.uniform(0.3, 0.7) * high[2]
            b.box("base", (1.2 * t, low[1] + t, z), (high[0] - t, high[1] - t, z + 0.7 * t))


def _run(
    b: Builder, link: str, across: tuple[float, float], rise: tuple[float, float], t: float,
    side: int, body: tuple[float, float, float],
) -> None:  # fmt: skip
    """A leaf before the front with room to slide: bare, on rails, or past a fixed second leaf."""
    w, d, rim = body
    (y0, y1), (z0, z1) = across, rise
    off = max(b.gap, 5e-4) * b.choice((1.0, 4.0))
    other = b.choice(("none", "pane", "solid", "leaf"))
    x1 = -off
    rest = sorted((side * (w / 2 - rim), -side * (w / 2 - rim)))
    free = (rest[0], y0 + 0.03) if side > 0 else (y1 - 0.03, rest[1])
    if other in ("pane", "leaf"):
        holder = "base" if other == "pane" else b.link("second", "door")
        b.front(holder, (x1 - t, free[0], z0), (x1, free[1], z1), b.choice(FRONTS))
        if holder != "base":
            b.slide(holder, "base", (0, side, 0), 0, 0.8 * (y1 - y0))
        x1 -= t + off
    elif other == "solid":
        b.box("base", (0, free[0], z0), (0.5 * d, free[1], z1))
    grow = float(b.choice((0.0, 0.0, b.uniform(0, 0.06)))) * (z1 - z0)
    low, high = np.array([x1 - t, y0, z0 - grow]), np.array([x1, y1, z1 + grow])
    b.front(link, low, high, b.choice(FRONTS))
    b.slide(link, "base", (0, -side, 0), 0, 0.9 * (free[1] - free[0]))
    _rails(b, (x1 - t, x1), (rest[0], rest[1]), (low[2], high[2]), t)
    if b.chance(0.85):
        _grip(b, link, low, high, side if b.chance(0.6) else b.choice((-side, 0)))


def _rails(
    b: Builder, x: tuple[float, float], y: tuple[float, float], z: tuple[float, float], t: float
) -> None:
    """Above and below, above alone, or none."""
    kind = b.choice(("both", "top", "none", "none"))
    g, tall = max(b.gap, 5e-4), b.uniform(0.3, 1.2) * t
    if kind != "none":
        b.box("base", (x[0], y[0], z[1] + g), (max(x[1], 0.0), y[1], z[1] + g + tall))
    if kind == "both":
        b.box("base", (x[0], y[0], z[0] - g - tall), (max(x[1], 0.0), y[1], z[0] - g))


def _beside(
    b: Builder, link: str, across: tuple[float, float], rise: tuple[float, float], t: float,
    side: int, body: tuple[float, float, float],
) -> None:  # fmt: skip
    """A hinged leaf: in one plane with a fixed neighbour, let into the front, or alone on it."""
    w, d, rim = body
    (y0, y1), (z0, z1) = across, rise
    g = max(b.gap, 5e-4)
    kind = b.choice(("level", "level", "inset", "alone"))
    x1 = t if kind == "inset" else -g
    rest = (-w / 2 + rim, w / 2 - rim)
    free = (rest[0], y0 - g) if side > 0 else (y1 + g, rest[1])
    if kind != "alone":
        deep = x1 if b.chance(0.6) else max(0.4 * d, x1)
        b.box("base", (x1 - t, free[0], z0), (deep, free[1], z1))
    low, high = np.array([x1 - t, y0 + g, z0 + g]), np.array([x1, y1 - g, z1 - g])
    b.front(link, low, high, b.choice(FRONTS))
    hinge = side if b.chance(0.7) else -side
    y = high[1] if hinge > 0 else low[1]
    point = (low[0] if b.chance(0.5) else high[0], y, 0.0)
    b.hinge(link, "base", point, (0, 0, 1), 0, b.uniform(1.2, 2.4), opens=(-1, 0, 0))
    if b.chance(0.9):
        _grip(b, link, low, high, -hinge)
    if b.chance(0.4):
        r = 0.3 * t
        for share in (0.15, 0.85):
            z = z0 + share * (z1 - z0)
            b.cylinder(b.choice((link, "base")), (low[0], y, z - 2 * t), (low[0], y, z + 2 * t), r)


def _grip(b: Builder, link: str, low: FloatArray, high: FloatArray, side: int) -> None:
    """A handle near one edge of a leaf (side of y), or in its middle (0)."""
    w, h = high[1] - low[1], high[2] - low[2]
    inset = b.uniform(0.05, 0.2) * w
    y = (low[1] + high[1]) / 2 if side == 0 else (high[1] - inset if side > 0 else low[1] + inset)
    z = low[2] + b.choice((0.5, b.uniform(0.25, 0.75))) * h
    upright = b.chance(0.8)
    length = float(np.clip(b.uniform(0.15, 0.9) * (h if upright else 0.5 * w), 0.02, 0.8 * h))
    b.handle(link, (low[0], y, z), (-1, 0, 0), (0, 0, 1) if upright else (0, 1, 0), length,
             b.choice(HANDLES))  # fmt: skip


def sash(b: Builder) -> None:
    """A frame with panes: one slides up, down or aside past the other, or one is hinged."""
    w, h, d = b.uniform(0.3, 1.2), b.uniform(0.3, 1.6), b.uniform(0.05, 0.2)
    b.size(w, d, h)
    b.theme()
    rim = b.uniform(0.03, 0.12) * min(w, h) + 0.01
    b.border("base", (0, -w / 2, 0), (d, w / 2, h), rim)
    if b.chance(0.5):
        out = b.uniform(0.02, 0.15)
        b.box("base", (-out, -w / 2 - 0.5 * rim, -rim), (d + b.choice((0.0, out)), w / 2, 0))
    upright = b.chance(0.55)
    t = b.uniform(0.15, 0.4) * d
    g = max(b.gap, 5e-4)
    a0, a1 = (rim, h - rim) if upright else (-w / 2 + rim, w / 2 - rim)
    c0, c1 = (-w / 2 + rim + g, w / 2 - rim - g) if upright else (rim + g, h - rim - g)
    cut = a0 + b.uniform(0.4, 0.6) * (a1 - a0)
    lap = b.uniform(0.0, 0.06) * (a1 - a0)
    first_moves = b.chance(0.5)
    slides = b.chance(0.75)
    spans = ((a0 + g, cut + lap), (cut - lap, a1 - g))
    if not slides:
        spans = ((a0 + g, cut - g), (cut + g, a1 - g))
    near = b.choice((0, 1))
    for k, (s0, s1) in enumerate(spans):
        moves = first_moves == (k == 0)
        link = b.link("sash", "door") if moves else "base"
        x0 = 0.15 * d + (t + 2 * g) * (k != near if slides else 0)
        low = np.array([x0, c0, s0] if upright else [x0, s0, c0])
        high = np.array([x0 + t, c1, s1] if upright else [x0 + t, s1, c1])
        _pane(b, link, low, high, rim)
        if not moves:
            continue
        sense = 1 if k == 0 else -1
        run = 0.85 * (a1 - a0 - (s1 - s0))
        if slides:
            b.slide(link, "base", (0, 0, sense) if upright else (0, sense, 0), 0, run)
        elif upright:
            z = high[2] if k == 0 else low[2]
            b.hinge(link, "base", (x0, 0, z), (0, 1, 0), 0, 1.2, opens=(-1, 0, 0))
        else:
            y = low[1] if k == 0 else high[1]
            b.hinge(link, "base", (x0, y, 0), (0, 0, 1), 0, 1.6, opens=(-1, 0, 0))
        if b.chance(0.8):
            away = np.array([x0, (low[1] + high[1]) / 2, (low[2] + high[2]) / 2])
            edge = b.uniform(0.02, 0.15)
            axis = 2 if upright else 1
            at = edge if (k == 0) == slides else 1 - edge
            away[axis] = low[axis] + at * (high[axis] - low[axis])
            along = (0, 1, 0) if upright else (0, 0, 1)
            b.handle(link, away, (-1, 0, 0), along, 0.3 * (c1 - c0), b.choice(HANDLES))


def _pane(b: Builder, link: str, low: FloatArray, high: FloatArray, rim: float) -> None:
    """A framed pane, with glazing bars or without, or a plain one."""
    rail = min(0.6 * rim, 0.3 * float((high - low)[1:].min()))
    if b.chance(0.2):
        b.box(link, low, high)
        return
    b.border(link, low, high, rail)
    if b.chance(0.8):
        edge = np.array([0.4 * (high[0] - low[0]), rail, rail])
        b.box(link, low + edge, high - edge, "glass")
    for axis in (1, 2):
        if b.chance(0.3):
            edge = np.array([0, rail, rail])
            p, q = low + edge, high - edge
            middle = (low[axis] + high[axis]) / 2
            p[axis], q[axis] = middle - 0.3 * rail, middle + 0.3 * rail
            b.box(link, p, q)


def slot(b: Builder) -> None:
    """A body with a slot and a lever in it: pressed straight down the slot, or tipped about it."""
    w, d, h = b.uniform(0.08, 0.4), b.uniform(0.08, 0.4), b.uniform(0.1, 0.4)
    b.size(w, d, h)
    b.theme()
    gap = b.uniform(0.06, 0.3) * w
    z0, z1 = b.uniform(0.05, 0.3) * h, b.uniform(0.65, 1.0) * h
    deep = b.uniform(0.3, 0.9) * d
    for s in (-1, 1):
        y = sorted((s * gap / 2, s * w / 2))
        if b.chance(0.35):
            solids.rounded(b, "base", (0, y[0], 0), (deep, y[1], h), 0.2 * min(deep, y[1] - y[0]))
        else:
            b.box("base", (0, y[0], 0), (deep, y[1], h))
    b.box("base", (deep, -w / 2, 0), (d, w / 2, h))
    b.box("base", (0, -gap / 2, 0), (deep, gap / 2, z0))
    if z1 < 0.9 * h and b.chance(0.5):
        b.box("base", (0, -gap / 2, z1), (deep, gap / 2, h))
    link = b.link("lever", "handle")
    reach, thick = b.uniform(0.1, 1.0) * d, b.uniform(0.25, 0.8) * gap
    slides = b.chance(0.6)
    z = z0 + b.uniform(0.5, 0.9) * (z1 - z0)
    inner = b.uniform(0.2, 0.9) * deep
    lean = 0.0 if slides and b.chance(0.7) else b.uniform(-0.6, 0.6)
    with b.moved((inner, 0, z), (0, 1, 0), lean):
        tall = thick * b.uniform(0.4, 1.5)
        b.box(link, (-inner - reach, -thick / 2, -tall / 2), (0, thick / 2, tall / 2))
        end = b.choice(("bar", "bar", "ball", "plate", "none"))
        if end == "bar":
            r = b.uniform(0.5, 1.0) * thick
            grip = b.uniform(0.3, 1.2) * w
            b.cylinder(link, (-inner - reach, -grip / 2, 0), (-inner - reach, grip / 2, 0), r)
        elif end == "ball":
            b.sphere(link, (-inner - reach, 0, 0), thick)
        elif end == "plate":
            b.block(link, (-inner - reach, 0, 0), (0.6 * thick, 2.5 * thick, 2 * tall + thick))
        if not slides and b.chance(0.5):
            b.cylinder(link, (0, -0.5 * gap, 0), (0, 0.5 * gap, 0), 0.8 * tall)
    if slides:
        b.slide(link, "base", (0, 0, -1), 0, 0.8 * (z - z0))
    else:
        b.hinge(link, "base", (inner, 0, z), (0, 1, 0), -0.7, 0.7)
    decoys(b, np.array([0, -w / 2, 0]), np.array([d, w / 2, h]), b.choice((0, 0, 1, 3)), (-1, 0, 0))


def plunger(b: Builder) -> None:
    """Rods with heads in a body: long ones are pushed or pulled, short thick ones turned."""
    low, high = base_body(b)
    size = high - low
    faces = [float(np.delete(size, k).min()) for k in range(3)]
    axis = b.choice([int(k) for k in np.argsort(faces)[1:]])  # not a slab's edge
    normal = np.zeros(3)
    normal[axis] = 1.0 if axis == 2 else b.choice((-1, 1))
    spot = (low + high) / 2 + b.rng.uniform(-0.25, 0.25, 3) * size * b.choice((0, 1))
    spot[axis] = high[axis] if normal[axis] > 0 else low[axis]
    room = faces[axis]
    head = room * b.uniform(0.05, 0.3)
    pushed = b.chance(0.75)
    ratio = b.uniform(2.0, 6.0) if pushed else b.uniform(0.4, 1.8)
    stem = head * (b.uniform(0.15, 0.6) if pushed else b.uniform(0.4, 0.9))
    link = b.link("rod", "part")
    with b.facing(spot, normal, (0, 0, 1) if axis != 2 else (1, 0, 0)):
        tall, foot = ratio * head, float(b.choice((0.0, -b.uniform(0.1, 1.5) * head)))
        b.cylinder(link, (0, 0, foot), (0, 0, tall), stem)
        end = b.choice(("disc", "disc", "ball", "block"))
        if end == "ball":
            b.sphere(link, (0, 0, tall), head)
        elif end == "block":
            b.block(link, (0, 0, tall), (2 * head, b.uniform(0.6, 2) * head, 0.8 * head))
        else:
            b.disc(link, (0, 0, tall), (0, 0, 1), head, b.uniform(0.2, 1.0) * head)
        if b.chance(0.3):
            b.tube("base", (0, 0, 0), (0, 0, 0.3 * tall), 1.6 * stem, 1.1 * stem)
        if pushed:
            b.slide(link, "base", (0, 0, -1), 0.0, 0.7 * tall, ajar=False)
        else:
            b.spin(link, "base", (0, 0, 0), (0, 0, 1))
    decoys(b, low, high, b.choice((0, 1, 2, 4)), (normal[0], normal[1], normal[2]))


def keys(b: Builder) -> None:
    """A plate or box with one to four keys: rockers, toggles, push keys, small sliders."""
    count = b.integer(1, 4)
    cell, h = b.uniform(0.03, 0.08), b.uniform(0.06, 0.16)
    width, t = count * cell * b.uniform(1.05, 1.4), float(b.choice((0.01, 0.03, 0.12)))
    b.size(t, width, h)
    b.theme()
    low, high = np.array([0, -width / 2, 0]), np.array([t, width / 2, h])
    if b.chance(0.3):
        solids.rounded(b, "base", low, high, 0.1 * min(h, width))
    else:
        b.box("base", low, high)
    raised = b.chance(0.4)
    if raised:
        edge = 0.08 * h
        b.box("base", (-0.004, -width / 2 + edge, edge), (0, width / 2 - edge, h - edge))
    face = -0.004 if raised else 0.0
    style = b.choice(("rocker", "rocker", "toggle", "push", "slider"))
    normal = (0, 0, 1) if b.chance(0.15) and t > 0.05 else (-1, 0, 0)
    for k in range(count):
        y = ((k + 0.5) / count - 0.5) * width * 0.9
        spot = (face, y, h / 2) if normal[0] else (t / 2, y, h)
        along = (0, 0, 1) if normal[0] else (1, 0, 0)
        with b.facing(spot, normal, along):
            _key(b, style, 0.35 * cell, 0.3 * (h if normal[0] else t))


def _key(b: Builder, style: str, half: float, tall: float) -> None:
    """One key in a frame whose z points out and x along it."""
    link = b.link(style, "key")
    w, long = half * b.uniform(0.5, 1.0), tall * b.uniform(0.6, 1.2)
    out = b.uniform(0.1, 0.5) * w
    sink = float(b.choice((0.0, -b.uniform(0.5, 2.0) * out)))
    if style == "push":
        if b.chance(0.4):
            b.cylinder(link, (0, 0, sink), (0, 0, 2 * out), min(w, long))
        else:
            b.box(link, (-long, -w, sink), (long, w, 2 * out))
        b.slide(link, "base", (0, 0, -1), 0.0, out, ajar=False)
    elif style == "rocker":
        lean = b.choice((-1, 1)) * b.uniform(0.08, 0.3)
        with b.moved((0, 0, 0), (0, 1, 0), lean):
            if b.chance(0.4):  # bent in the middle, as rockers are
                for s in (-1, 1):
                    with b.moved((0, 0, out), (0, 1, 0), s * b.uniform(0.05, 0.2)):
                        b.box(link, (min(s * long, 0), -w, sink), (max(s * long, 0), w, out))
            else:
                b.box(link, (-long, -w, sink), (long, w, 2 * out))
        b.hinge(link, "base", (0, 0, b.choice((0.0, sink))), (0, 1, 0), -0.2, 0.2)
    elif style == "toggle":
        r = 0.3 * w
        if b.chance(0.6):
            b.disc("base", (0, 0, 0), (0, 0, 1), 1.5 * r, 0.6 * r)
        with b.moved((0, 0, 0), (0, 1, 0), b.uniform(-0.6, 0.6)):
            b.cylinder(link, (0, 0, 0), (0, 0, b.uniform(4, 9) * r), r, b.choice((r, 1.4 * r)))
        b.hinge(link, "base", (0, 0, 0), (0, 1, 0), -0.5, 0.5)
    else:
        for s in (-1, 1):
            b.block("base", (0, s * 0.5 * w, 0.1 * w), (2 * long, 0.15 * w, 0.25 * w))
        at = b.uniform(-0.6, 0.6) * long
        b.block(link, (at, 0, 0.5 * w), (0.5 * w, 0.8 * w, w))
        b.slide(link, "base", (1, 0, 0), -0.7 * long - at, 0.7 * long - at)
