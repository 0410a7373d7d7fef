"""Abstract cases for training: bodies with openings, filled with doors, drawers, flaps, decoys."""

from __future__ import annotations

import numpy as np

from mam_pipeline.types import FloatArray
from mam_training.curricula.mechanisms import clump, decoys
from mam_world import solids
from mam_world.kit import Builder

FRONTS = ("slab", "slab", "slab", "framed", "glass", "louvre", "moulded", "double")
HANDLES = ("bar", "bow", "knob", "double", "recessed", "cup", "strip", "ring")


def case(b: Builder) -> None:
    """Storage or an appliance: a body, a grid of cells on its front, fixed neighbours."""
    w, d, h = b.uniform(0.3, 1.6), b.uniform(0.25, 0.7), b.uniform(0.25, 2.0)
    b.size(w, d, h)
    b.theme()
    t = b.uniform(0.008, 0.035)
    style = b.choice(("shell", "shell", "boards", "solid", "legs"))
    base = 0.0 if b.chance(0.5) else b.uniform(0.03, 0.15)
    if style == "legs":
        base = b.uniform(0.15, 0.5) * h
    _case_body(b, style, (w, d, h), base, t)
    rows, columns = _grid(b, w, h - base)
    zs = base + t + (h - base - 2 * t) * rows
    ys = -w / 2 + t + (w - 2 * t) * columns
    moved = 0
    for i in range(len(rows) - 1):
        for j in range(len(columns) - 1):
            cell = (np.array([0, ys[j], zs[i]]), np.array([d - t, ys[j + 1], zs[i + 1]]))
            odds = (0.38, 0.34, 0.14, 0.1, 0.04)
            fill = b.choice(("door", "drawer", "fixed", "open", "flap"), odds)
            last = i == len(rows) - 2 and j == len(columns) - 2
            if last and moved == 0:
                fill = b.choice(("door", "drawer", "flap"))
            moved += _fill_cell(b, fill, cell, t)
    _case_extras(b, w, d, h, base, t)


def _case_body(
    b: Builder, style: str, size: tuple[float, float, float], base: float, t: float
) -> None:
    w, d, h = size
    low, high = (0, -w / 2, base), (d, w / 2, h)
    if style == "solid":
        b.box("base", (0.02 * d, -w / 2, base), high)
    elif style == "boards":
        for y in (-w / 2, w / 2 - t):
            b.box("base", (0, y, base), (d, y + t, h))
        b.box("base", (0, -w / 2, h - t), (d, w / 2, h))
        b.box("base", (0, -w / 2, base), (d, w / 2, base + t))
        if b.chance(0.7):
            b.box("base", (d - t, -w / 2, base), (d, w / 2, h))
    elif style == "shell" and b.chance(0.5):
        solids.tray(b, "base", low, high, t, "x", -1)
    else:
        b.shell("base", low, high, t, "-x")
    if base > 0:
        b.feet("base", (0, -w / 2), (d, w / 2), base,
               b.choice(("square", "round", "tapered", "plinth", "sled")))  # fmt: skip


def _grid(b: Builder, w: float, h: float) -> tuple[FloatArray, FloatArray]:
    """Cell borders along z and y, 0..1."""
    most = int(np.clip(h / 0.25, 1, 4))
    rows = b.integer(1, most)
    columns = b.choice((1, 1, 2, 2, 3)) if w > 0.5 else 1
    if b.chance(0.4):
        rows, columns = b.choice(((1, 1), (1, 2), (2, 1)))

    def borders(n: int) -> FloatArray:
        share = np.ones(n) if b.chance(0.6) else b.rng.uniform(0.6, 1.6, n)
        return np.r_[0, np.cumsum(share) / share.sum()]

    return borders(rows), borders(columns)


def _fill_cell(b: Builder, fill: str, cell: tuple[FloatArray, FloatArray], t: float) -> int:
    """One cell's content; returns 1 if something moves."""
    low, high = cell
    inset = b.chance(0.3)
    g = max(b.gap, 4e-4)
    x0 = 0.0 if inset else -t - g
    y0, y1, z0, z1 = low[1] + g, high[1] - g, low[2] + g, high[2] - g
    if min(y1 - y0, z1 - z0) < 0.04:
        return 0
    front = (np.array([x0, y0, z0]), np.array([x0 + t, y1, z1]))
    if b.chance(0.5) and fill in ("open", "door"):
        for z in np.linspace(z0, z1, b.integer(1, 3) + 2)[1:-1]:
            b.box("base", (1.5 * t, low[1], z), (high[0], high[1], z + 0.6 * t))
    if fill == "open":
        if b.chance(0.3):
            clump(b, "base", low + 0.2 * (high - low), high - 0.3 * (high - low), 2)
        return 0
    if fill == "fixed":
        b.front("base", *front, b.choice(FRONTS))
        if b.chance(0.15):
            _pull(b, "base", front, "mid")
        return 0
    if not inset and b.chance(0.4):  # dividers that the fronts close against
        b.box("base", (0, low[1], z1 - 0.5 * t), (high[0], high[1], z1 + 0.5 * t))
    link = b.link(fill, fill)
    b.front(link, *front, b.choice(FRONTS))
    if fill == "drawer":
        _drawer(b, link, front, low, high, t)
        return 1
    side = (
        b.choice(("left", "right", "left", "right", "top"))
        if fill == "door"
        else b.choice(("bottom", "top"))
    )
    if y1 - y0 > 0.6 and z1 - z0 > 0.4 and b.chance(0.25):
        _sliding(b, link, front)
        return 1
    if b.chance(0.88):
        _pull(
            b,
            link,
            front,
            {"left": "right", "right": "left", "top": "bottom", "bottom": "top"}[side],
        )
    if b.chance(0.3):
        _hinges(b, link if b.chance(0.5) else "base", front, side)
    y = {"left": y1, "right": y0}.get(side, (y0 + y1) / 2)
    z = {"top": z1, "bottom": z0}.get(side, (z0 + z1) / 2)
    axis = (0, 0, 1) if side in ("left", "right") else (0, 1, 0)
    b.hinge(
        link,
        "base",
        (x0 + b.choice((0.0, t)), y, z),
        axis,
        0,
        b.uniform(1.2, 2.2),
        opens=(-1, 0, 0),
    )
    if fill == "door" and b.chance(0.12):
        drawer = b.link("inner", "drawer")
        inner = np.array([2.5 * t, y0 + t, z0 + t])
        b.drawer_box(drawer, inner, np.array([0.9 * high[0], y1 - t, z0 + 0.4 * (z1 - z0)]))
        b.slide(drawer, "base", (-1, 0, 0), 0, 0.7 * high[0])
    return 1


def _drawer(
    b: Builder, link: str, front: tuple[FloatArray, FloatArray], low: FloatArray, high: FloatArray,
    t: float,
) -> None:  # fmt: skip
    (x0, y0, z0), (_, y1, z1) = front
    free = b.uniform(0.0, 0.2)
    deep = b.uniform(0.5, 0.97)
    if b.chance(0.8):
        a = np.array([x0 + t, y0 + t + free * (y1 - y0) / 2, z0 + b.uniform(0.02, 0.3) * (z1 - z0)])
        c = np.array(
            [deep * high[0], y1 - t - free * (y1 - y0) / 2, z1 - b.uniform(0.05, 0.4) * (z1 - z0)]
        )
        if b.chance(0.4):
            solids.tray(b, link, a, c, min(0.5 * t, 0.2 * (c - a).min()), "z", 1)
        else:
            b.drawer_box(link, a, c)
    if b.chance(0.85):
        _pull(b, link, front, b.choice(("mid", "mid", "mid", "top")))
    if b.chance(0.2):
        z = (z0 + z1) / 2
        for y in (low[1], high[1] - 0.4 * t):
            b.box("base", (t, y, z), (0.9 * high[0], y + 0.4 * t, z + t))
    b.slide(link, "base", (-1, 0, 0), 0, 0.8 * high[0] * deep)


def _sliding(b: Builder, link: str, front: tuple[FloatArray, FloatArray]) -> None:
    """Two leaves, one behind the other, in rails; one of them may be fixed."""
    low, high = front
    t, middle = high[0] - low[0], (low[1] + high[1]) / 2
    last = b.pieces[-1]
    b.pieces = [p for p in b.pieces if p.link != last.link]
    lap = b.uniform(0.0, 0.1) * (high[1] - low[1])
    b.front(
        link,
        low + np.array([-t, 0, 0]),
        np.array([high[0] - t, middle + lap, high[2]]),
        b.choice(FRONTS),
    )
    other = b.link("leaf", "door") if b.chance(0.6) else "base"
    b.front(other, np.array([low[0] + 2e-3, middle - lap, low[2]]), high, b.choice(FRONTS))
    run = 0.45 * (high[1] - low[1])
    b.slide(link, "base", (0, 1, 0), 0, run)
    if b.chance(0.6):
        _pull(b, link, (low + np.array([-t, 0, 0]), np.array([high[0] - t, middle, high[2]])),
              b.choice(("left", "right")))  # fmt: skip
    if other != "base":
        b.slide(other, "base", (0, -1, 0), 0, run)
    if b.chance(0.6):
        for z in (low[2] - 0.4 * t, high[2]):
            b.box("base", (low[0] - t, low[1], z), (high[0], high[1], z + 0.4 * t))


def _pull(b: Builder, link: str, front: tuple[FloatArray, FloatArray], where: str) -> None:
    """A handle on a front, near the side where a hand would pull."""
    (x0, y0, z0), (_, y1, z1) = front
    w, h = y1 - y0, z1 - z0
    inset = b.uniform(0.05, 0.16)
    y = {"left": y1 - inset * w, "right": y0 + inset * w}.get(where, (y0 + y1) / 2)
    z = {"top": z1 - inset * h, "bottom": z0 + inset * h}.get(where, (z0 + z1) / 2)
    if where in ("left", "right") and b.chance(0.4):
        z = z0 + b.uniform(0.2, 0.8) * h
    upright = where in ("left", "right") and b.chance(0.85)
    room = h if upright else w
    length = float(np.clip(b.uniform(0.15, 0.9) * room, 0.02, 0.6 * room + 0.02))
    b.handle(
        link, (x0, y, z), (-1, 0, 0), (0, 0, 1) if upright else (0, 1, 0), length, b.choice(HANDLES)
    )


def _hinges(b: Builder, link: str, front: tuple[FloatArray, FloatArray], side: str) -> None:
    (x0, y0, z0), (x1, y1, z1) = front
    r = 0.3 * (x1 - x0)
    for share in (0.15, 0.85):
        y = {"left": y1, "right": y0}.get(side, y0 + share * (y1 - y0))
        z = {"top": z1, "bottom": z0}.get(side, z0 + share * (z1 - z0))
        step = np.array([0, 0, 2 * r]) if side in ("left", "right") else np.array([0, 2 * r, 0])
        point = np.array([x0, y, z])
        b.cylinder(link, point - step, point + step, r)


def _case_extras(b: Builder, w: float, d: float, h: float, base: float, t: float) -> None:
    if b.chance(0.4):
        o = b.uniform(0, 0.05)
        b.box("base", (-o, -w / 2 - o, h), (d, w / 2 + o, h + b.uniform(0.5, 2) * t))
    if b.chance(0.25):
        b.box("base", (-b.uniform(0, 0.02), -w / 2, base), (0.0, w / 2, base + t))
    if b.chance(0.2):
        y = b.uniform(-0.4, 0.4) * w
        for k in range(b.integer(1, 5)):
            spot = (d * b.uniform(0.2, 0.8), y, h)
            b.rotary("base", spot, (0, 0, 1), 0.02, 0.02) if b.chance(0.3) and k < 3 else b.disc(
                "base", spot, (0, 0, 1), 0.03, 0.01)  # fmt: skip
    low, high = np.array([0, -w / 2, base]), np.array([d, w / 2, h])
    decoys(b, low, high, b.choice((0, 0, 1, 3)), (-1, 0, 0))


def console(b: Builder) -> None:
    """A body with a door and a strip of controls: ovens, microwaves, washers, panels."""
    w, d, h = b.uniform(0.3, 0.9), b.uniform(0.02, 0.6), b.uniform(0.25, 0.95)
    b.size(w, d, h)
    b.theme()
    t = b.uniform(0.01, 0.04)
    hollow = b.chance(0.7) and d > 0.15
    door = b.chance(0.75) and d > 0.1
    upper = b.chance(0.6)
    z = h * b.uniform(0.7, 0.85)
    y = w * (0.5 - b.uniform(0.18, 0.35))
    if hollow:
        solids.tray(b, "base", (0, -w / 2, 0), (d, w / 2, h), t, "x", -1)
    else:
        clump(b, "base", np.array([0, -w / 2, 0]), np.array([d, w / 2, h]), 1)
    strip = ((-t, -w / 2, z), (0, w / 2, h)) if upper else ((-t, y, 0), (0, w / 2, h))
    b.box("base", *strip)
    if door:
        g = max(b.gap, 4e-4)
        front = (
            np.array([-t - g, -w / 2 + g, g]),
            np.array([-g, (w / 2 if upper else y) - g, (z if upper else h) - g]),
        )
        fixed = b.chance(0.08)
        link = "base" if fixed else b.link("door", "door")
        if b.chance(0.25):
            with b.facing(((front[0] + front[1]) / 2) * [0, 1, 1] + [-g, 0, 0], (-1, 0, 0)):
                r = 0.42 * min((front[1] - front[0])[1:])
                b.disc(link, (0, 0, 0), (0, 0, 1), r, t)
                b.torus(link, (0, 0, t), (0, 0, 1), 0.8 * r, 0.1 * r)
        else:
            b.front(link, *front, b.choice(FRONTS))
        side = b.choice(("left", "right", "bottom"))
        if b.chance(0.8):
            _pull(b, link, front, {"left": "right", "right": "left", "bottom": "top"}[side])
        if not fixed:
            (x0, y0, z0), (_, y1, _) = front
            at = {"left": (y1, z0), "right": (y0, z0), "bottom": (y0, z0)}[side]
            axis = (0, 1, 0) if side == "bottom" else (0, 0, 1)
            b.hinge(link, "base", (x0 + t, *at), axis, 0, 1.7, opens=(-1, 0, 0))
    low, high = np.asarray(strip[0]), np.asarray(strip[1])
    _controls(b, low, high, upper, must=not door)


def _controls(b: Builder, low: FloatArray, high: FloatArray, wide: bool, must: bool) -> None:
    """A row of knobs, buttons or dummies on a strip that faces -X."""
    n = b.integer(1, 6)
    moving = b.chance(0.6) or must
    kind = b.choice(("knob", "button", "mixed"))
    size = high - low
    for k in range(n):
        share = (k + 0.5) / n
        y = low[1] + size[1] * (share if wide else 0.5)
        z = low[2] + size[2] * (0.5 if wide else share)
        r = b.uniform(0.12, 0.3) * min(size[1] / (n if wide else 1), size[2] / (1 if wide else n))
        style = b.choice(("knob", "button")) if kind == "mixed" else kind
        spot = (low[0], y, z)
        if moving and style == "knob":
            b.rotary("base", spot, (-1, 0, 0), r, b.uniform(0.5, 1.5) * r)
        elif moving:
            b.button(
                "base",
                spot,
                (-1, 0, 0),
                2 * r,
                1.5 * r,
                0.3 * r,
                shape=b.choice(("round", "square")),
            )
        else:
            b.disc("base", spot, (-1, 0, 0), r, 0.4 * r)
    if b.chance(0.5):
        b.block("base", (low[0], (low[1] + high[1]) / 2, low[2] + 0.85 * size[2]),
                (0.004, 0.3 * size[1], 0.12 * size[2]))  # fmt: skip


def doorway(b: Builder) -> None:
    """A leaf in its frame, with a latch or a knob that may turn on it."""
    w, h, t = b.uniform(0.3, 1.1), b.uniform(0.4, 2.2), b.uniform(0.02, 0.06)
    b.size(w, t, h)
    b.theme()
    rim = b.uniform(0.02, 0.12)
    kind = b.choice(("frame", "frame", "wall", "posts", "one"))
    g = max(b.gap, 5e-4)
    if kind == "frame":
        b.border(
            "base", (0, -w / 2 - rim, -rim), (t * b.uniform(1, 3), w / 2 + rim, h + rim), rim - g
        )
    elif kind == "wall":
        for y in (-w / 2 - rim * 4, w / 2 + g):
            b.box("base", (0, y, 0), (t, y + rim * 4 - g, h + 4 * rim))
        b.box("base", (0, -w / 2, h + g), (t, w / 2, h + 4 * rim))
    else:
        for y in (-w / 2 - rim, w / 2 + g)[: 2 if kind == "posts" else 1]:
            b.box("base", (0, y, 0), (t, y + rim - g, h))
        if b.chance(0.5):
            b.box("base", (-0.3, -w / 2 - rim, -0.03), (0.3, w / 2 + rim, 0))
    link = b.link("door", "door")
    front = (np.array([b.uniform(-0.5, 0.5) * t, -w / 2, g]), np.array([t, w / 2, h]))
    b.front(link, *front, b.choice(FRONTS))
    latch_y = w / 2 - b.uniform(0.06, 0.2) * w
    spot, r = (front[0][0], latch_y, h * b.uniform(0.35, 0.6)), b.uniform(0.02, 0.05) * w
    grip = b.choice(("lever", "knob", "fixed", "fixed", "none"))
    if grip in ("lever", "knob"):
        turn = b.link("latch", "handle")
        with b.facing(spot, (-1, 0, 0)):
            b.cylinder(turn, (0, 0, -b.choice((0.0, 1.2)) * t), (0, 0, 2 * r), 0.5 * r)
            if grip == "lever":
                b.box(
                    turn, (-0.4 * r, -0.5 * r, 1.5 * r), (0.4 * r, b.choice((-5, 5)) * r, 2.3 * r)
                )
            else:
                b.sphere(turn, (0, 0, 2.4 * r), r)
            if b.chance(0.5):
                b.disc(link, (0, 0, 0), (0, 0, 1), r, 0.2 * r)
        b.hinge(turn, link, spot, (1, 0, 0), 0, 1.2)
    elif grip == "fixed":
        _pull(b, link, front, "left")
    y = -w / 2
    if b.chance(0.5):
        _hinges(b, b.choice((link, "base")), front, "right")
    b.hinge(link, "base", (0, y, 0), (0, 0, 1), 0, b.uniform(1.3, 2.5), opens=(-1, 0, 0))


def lidded(b: Builder) -> None:
    """A vessel, box or slab with a lid that tips up: chests, bins, laptops, scanners, jars."""
    w, d, h = b.uniform(0.15, 0.9), b.uniform(0.12, 0.6), b.uniform(0.015, 0.6)
    b.size(w, d, h)
    b.theme()
    t = min(b.uniform(0.004, 0.03), 0.4 * h)
    g = max(b.gap, 4e-4)
    if h < 0.08 or b.chance(0.2):
        clump(b, "base", np.array([0, -w / 2, 0]), np.array([d, w / 2, h]), 2)
    elif b.chance(0.5):
        solids.tray(b, "base", (0, -w / 2, 0), (d, w / 2, h), t, "z", 1)
    else:
        b.shell("base", (0, -w / 2, 0), (d, w / 2, h), t, "+z")
    link = b.link("lid", "lid")
    over = b.uniform(0, 0.02)
    thick = t * b.uniform(0.7, 3)
    angle = float(b.choice((0.0, 0.0, b.uniform(0.2, 2.0))))
    hinge = np.array([d, 0, h + g])
    with b.moved(hinge, (0, 1, 0), angle):
        if b.chance(0.3):
            solids.tray(
                b, link, (-d - over, -w / 2 - over, 0), (0, w / 2 + over, thick * 3), t / 2, "z", -1
            )
        else:
            b.box(link, (-d - over, -w / 2 - over, 0), (0, w / 2 + over, thick))
        if b.chance(0.4):
            b.box(link, (-0.92 * d, -0.44 * w, -0.1 * t), (-0.08 * d, 0.44 * w, 0.0))
        if b.chance(0.4):
            b.handle(
                link, (-d - over, 0, thick / 2), (-1, 0, 0), (0, 1, 0), 0.3 * w, b.choice(HANDLES)
            )
        elif b.chance(0.3):
            b.handle(link, (-d / 2, 0, thick), (0, 0, 1), (0, 1, 0), 0.3 * w, b.choice(HANDLES))
    if b.chance(0.4):
        for y in (-0.35 * w, 0.35 * w):
            b.cylinder(
                b.choice((link, "base")),
                hinge + np.array([0, y - 0.06 * w, 0]),
                hinge + np.array([0, y + 0.06 * w, 0]),
                0.6 * t,
            )
    if b.chance(0.85):
        b.hinge(link, "base", hinge, (0, 1, 0), -angle, 2.2 - angle)
    else:
        b.slide(link, "base", (0, 0, 1), 0, 0.2)
    if b.chance(0.3):
        b.feet("base", (0, -w / 2), (d, w / 2), 0.0 - 0.03, "round")
    decoys(b, np.array([0, -w / 2, 0]), np.array([d, w / 2, h]), b.choice((0, 0, 1, 3)), (0, 0, 1))
