"""Panels: switches, push buttons, knobs, hobs, among parts that only look movable."""

from __future__ import annotations

import numpy as np

from mam_world.kit import Builder
from mam_world.mech import dial, studs
from mam_world.solids import TAU, bored, part, pierced


def _rocker(b: Builder, y: float, z: float, w: float, h: float, t: float) -> None:
    """A rocker in a cut-out that spans x = 0 to t: tilts about a horizontal axis."""
    key = part(b, "switch", "rocker")
    g = 0.0006
    tilt = 0.12
    rise = np.tan(tilt) * (h / 2 - g)
    # the corners swing on a circle: they must pass the edges of the cut-out
    half = float(np.sqrt((h / 2 - g) ** 2 - max(rise + 0.2 * t + 0.001, 0.7 * t) ** 2))
    poly = [
        (0.9 * t, -half),
        (0.9 * t, half),
        (-rise - 0.0006, half),
        (-0.0008, 0),
        (-0.0006, -half),
    ]
    with b.facing((0, y + w / 2 - g, z), (0, -1, 0), (1, 0, 0)):
        b.extrude(key, poly, w - 2 * g, "light", "handle")
    # the back of the cut-out is open by a little more than the rocker's heel needs
    b.hinge(
        key, "base", (0.2 * t, y, z), (0, 1, 0), 0, 2 * tilt, opens=(1, 0, 0), tip=(0, y, z + h / 2)
    )


def switch(b: Builder) -> None:
    """Wall switches: plates with rockers, toggles or sliders, one to four of them, some blind."""
    count = b.integer(1, 4)
    cell, h, t = b.uniform(0.04, 0.055), b.uniform(0.08, 0.12), b.uniform(0.006, 0.012)
    width = count * cell + 0.03
    b.size(t * 3, width, h)
    b.theme(b.choice(("white", "white", "plastic", "steel", "dark")))
    style = b.choice(("rocker", "toggle", "slider"))
    kw, kh = {
        "rocker": (0.6 * cell, 0.5 * h),
        "toggle": (0.012, 0.026),
        "slider": (0.008, 0.55 * h),
    }[style]
    ys = [(k - (count - 1) / 2) * cell for k in range(count)]
    live = [b.chance(0.85) for _ in ys]
    live[0] = True
    zc = h / 2
    holes = [(y - kw / 2, zc - kh / 2, y + kw / 2, zc + kh / 2) for y, k in zip(ys, live) if k]
    pierced(b, "base", (0, -width / 2, 0), (t, width / 2, h), holes, "x", "front")
    deep = t + (0.03 if style == "toggle" else 0.012)
    if b.chance(0.7):
        b.shell("base", (t, -width / 2 + 0.008, 0.01), (deep, width / 2 - 0.008, h - 0.01), 0.002,
                "-x", "dark", "solid")  # fmt: skip
    for y, k in zip(ys, live):
        studs(b, [(0, y, zc + s * 0.42 * h) for s in (-1, 1)], (-1, 0, 0), 0.0025)
        if not k:
            if b.chance(0.7):  # a blind insert that looks like a rocker and does not move
                b.block(
                    "base", (-0.001, y, zc), (0.004, 0.8 * kw, 0.8 * kh), "light", "decor", False
                )
            continue
        if style == "rocker":
            _rocker(b, y, zc, kw, kh, t)
        elif style == "toggle":
            key = part(b, "switch", "toggle")
            b.sphere(key, (0.006, y, zc), 0.0055, "metal")
            tip = (0.006 - 0.022 * np.cos(0.35), y, zc - 0.022 * np.sin(0.35))
            b.cylinder(key, (0.006, y, zc), tip, 0.003, 0.0045,
                       b.choice(("metal", "light", "dark")), "handle")  # fmt: skip
            b.hinge(key, "base", (0.006, y, zc), (0, 1, 0), 0, 0.7, opens=(0, 0, 1), tip=tip)
        else:
            key = part(b, "slider")
            z0 = zc - 0.4 * kh
            b.cylinder(key, (0.6 * t, y, z0), (-0.012, y, z0), 0.0025, None, "metal")
            b.block(key, (-0.008, y, z0), (0.012, 0.014, 0.012),
                    b.choice(("light", "dark", "accent")), "handle")  # fmt: skip
            b.slide(key, "base", (0, 0, 1), 0, 0.8 * kh)


def button_panel(b: Builder) -> None:
    """A button box or a lift panel: push buttons in collars beside fixed lamps and labels."""
    upright = b.chance(0.6)
    rows, columns = b.choice(((1, 1), (1, 1), (2, 1), (3, 1), (2, 2), (3, 2), (1, 3), (4, 2)))
    r = b.uniform(0.01, 0.03)
    pitch = r * b.uniform(3.0, 4.0)
    w, h, t = columns * pitch + r, rows * pitch + r, b.uniform(1.5, 4) * r
    b.size(t, w, h)
    b.theme(b.choice(("paint", "steel", "plastic", "dark")))
    head = r * b.uniform(0.5, 1.0)
    travel = b.uniform(0.35, 0.7) * head
    # drawn lying on the floor with the buttons up; upright boxes are turned to face -x
    turn = np.array([[0, 0, -1, t], [0, -1, 0, 0], [-1, 0, 0, h], [0, 0, 0, 1.0]])
    with b.at(turn if upright else np.eye(4)):
        b.shell("base", (0, -w / 2, 0), (h, w / 2, t - 0.3 * r), 0.25 * r, "+z", "body", "solid")
        for i in range(rows):
            for j in range(columns):
                x, y = (0.5 * r + (i + 0.5) * pitch), -w / 2 + 0.5 * r + (j + 0.5) * pitch
                x0, x1 = (0 if i == 0 else x - pitch / 2), (h if i == rows - 1 else x + pitch / 2)
                y0, y1 = (
                    (-w / 2 if j == 0 else y - pitch / 2),
                    (w / 2 if j == columns - 1 else y + pitch / 2),
                )
                if b.chance(0.2) and i + j > 0:
                    b.box("base", (x0, y0, t - 0.3 * r), (x1, y1, t), "body")
                    if b.chance(0.5):
                        with b.moved((x, y, t)):
                            b.lathe("base", [(0.7 * r, 0), (0.5 * r, 0.4 * r)], "green", "decor")
                    else:
                        b.block("base", (x, y, t), (r, 1.6 * r, 0.1 * r), "light", "decor", False)
                    continue
                bored(b, "base", (x0, y0, t - 0.3 * r), (x1, y1, t), "z", (x, y), 1.12 * r, "body")
                if b.chance(0.6):
                    b.tube("base", (x, y, t), (x, y, t + 0.2 * head), 1.4 * r, 1.12 * r, "metal")
                key = part(b, "button")
                paint = b.choice(("red", "green", "light", "accent", "dark"))
                low = t - 0.3 * r
                with b.moved((x, y, low)):
                    b.lathe(
                        key,
                        [
                            (0.95 * r, 0),
                            (0.95 * r, 0.3 * r + 0.85 * head),
                            (0.8 * r, 0.3 * r + head),
                        ],
                        paint,
                        "handle",
                    )
                b.slide(key, "base", (0, 0, -1), 0, min(travel, t - 0.6 * r))


def knob_panel(b: Builder) -> None:
    """A front panel with knobs, some fixed, beside fixed screens, lamps and trims."""
    n = b.integer(1, 6)
    r = b.uniform(0.012, 0.024)
    pitch = r * b.uniform(2.8, 4.0)
    w, h, d = n * pitch + 2 * r + b.uniform(0, 0.1), b.uniform(4, 8) * r, b.uniform(0.03, 0.2)
    b.size(d, w, h)
    b.theme(b.choice(("dark", "steel", "white", "plastic", "wood")))
    b.box("base", (0, -w / 2, 0), (d, w / 2, h), "body")
    b.box("base", (-0.002, -w / 2 + 0.004, 0.004), (0, w / 2 - 0.004, h - 0.004), "front")
    z = b.choice((0.35, 0.5)) * h
    if z < 0.4 * h:
        b.box("base", (-0.004, -0.2 * w, 0.65 * h), (-0.001, 0.2 * w, 0.9 * h), "screen", "decor",
              False)  # fmt: skip
        studs(
            b, [(-0.002, 0.27 * w + k * 1.2 * r, 0.78 * h) for k in range(2)], (-1, 0, 0), 0.35 * r
        )
    style = b.choice(("plain", "cone", "flute", "pointer", "dome", "bar", "skirt"))
    y0 = -0.5 * (n - 1) * pitch
    endless, paint = b.chance(0.3), b.choice(("dark", "metal", "light", "accent"))
    for k in range(n):
        y = y0 + k * pitch
        b.tube("base", (-0.002, y, z), (-0.0035, y, z), 1.3 * r, 1.2 * r, "trim", "decor", False)
        if k and b.chance(0.12):
            dial(b, "base", (-0.002, y, z), (-1, 0, 0), 0.5 * r, 0.3 * r, "dome")
            continue
        knob = part(b, "knob")
        dial(b, knob, (-0.002 - max(b.gap, 0.0004), y, z), (-1, 0, 0), r, b.uniform(0.9, 1.4) * r,
             style, paint)  # fmt: skip
        limits = {} if endless else {"lower": 0.0, "upper": b.uniform(1.5, 4.7)}
        b.spin(knob, "base", (0, y, z), (1, 0, 0), **limits)


def hob(b: Builder) -> None:
    """A hob: knobs that turn; grids, burners and plates that do not."""
    w, d, t = b.uniform(0.3, 0.75), b.uniform(0.45, 0.55), b.uniform(0.03, 0.09)
    b.size(w, d, t)
    b.theme(b.choice(("steel", "dark", "white")))
    b.box("base", (0, -w / 2, 0), (d, w / 2, t), "body")
    columns = 1 if w < 0.4 else b.choice((2, 2, 3))
    gas = b.chance(0.6)
    front = b.chance(0.5) and t > 0.05
    start = 0.06 if front else 0.14
    cell = (w - 0.04) / columns
    rows = 2
    depth = (d - start - 0.02) / rows
    for i in range(rows):
        for j in range(columns):
            x, y = start + (i + 0.5) * depth, -w / 2 + 0.02 + (j + 0.5) * cell
            r = min(cell, depth) * b.uniform(0.3, 0.42)
            if gas:
                b.cylinder("base", (x, y, t), (x, y, t + 0.01), 0.35 * r, 0.3 * r, "metal")
                b.cylinder("base", (x, y, t + 0.01), (x, y, t + 0.016), 0.25 * r, None, "dark")
                for s in range(4):
                    e = np.array([np.cos(s * TAU / 4), np.sin(s * TAU / 4), 0])
                    b.sweep(
                        "base",
                        [
                            e * r + (x, y, t),
                            e * r + (x, y, t + 0.025),
                            e * 0.35 * r + (x, y, t + 0.025),
                        ],
                        0.005,
                        "dark",
                        "decor",
                        collision=False,
                    )
            else:
                b.cylinder("base", (x, y, t), (x, y, t + b.choice((0.001, 0.008))), r, None, "dark")
    n = rows * columns + int(b.chance(0.2))
    kr = b.uniform(0.016, 0.022)
    g = max(b.gap * 0.3, 0.0005)
    style, paint = (
        b.choice(("skirt", "bar", "pointer", "flute")),
        b.choice(("dark", "metal", "light")),
    )
    for k in range(n):
        y = (k - (n - 1) / 2) * min(2.6 * kr + 0.01, (w - 0.06) / n)
        knob = part(b, "knob")
        if front:
            foot, axis = (-g, y, t / 2), (-1, 0, 0)
        else:
            foot, axis = (0.07, y, t + g), (0, 0, 1)
        dial(b, knob, foot, axis, min(kr, 0.42 * t) if front else kr, 0.025, style, paint)
        b.spin(knob, "base", foot, axis, 0, b.uniform(1.57, 4.7))


CATEGORIES = {"switch": switch, "button_panel": button_panel, "knob_panel": knob_panel, "hob": hob}
