"""Controls: faucets, valves, hand wheels, switches, buttons, levers, locks, knob panels, hobs."""

from __future__ import annotations

import numpy as np

from mam_pipeline.world.kit import Builder
from mam_pipeline.world.mech import TAU, arc, bar, bored, dial, part, pierced, rounded, studs


def faucet(b: Builder) -> None:
    """A tap: one lever, or two handles beside it; the spout often turns."""
    h, reach, r = b.uniform(0.12, 0.3), b.uniform(0.12, 0.2), b.uniform(0.012, 0.022)
    b.size(reach, 0.15, h)
    b.theme(b.choice(("steel", "steel", "dark", "white")))
    two, side = b.chance(0.5), b.choice((-1, 1))
    span = b.uniform(0.07, 0.11)
    if two:
        rounded(b, "base", (-0.03, -span - 0.03, 0), (0.03, span + 0.03, 0.012), 0.028, material="metal")
    else:
        b.disc("base", (0, 0, 0), (0, 0, 1), 1.8 * r, 0.012, "metal")
    body = 0.012 + b.uniform(0.25, 0.45) * h
    b.cylinder("base", (0, 0, 0.01), (0, 0, body), 1.2 * r, r * 1.1, "metal")
    g = max(b.gap, 0.0008) if b.chance(0.6) else 0.0
    spout = part(b, "spout") if g else "base"
    rise = h - body - 0.4 * reach
    if b.chance(0.6) and rise > 0:
        path = np.concatenate([[(0, 0, body + g)], arc((-0.4 * reach, 0, body + rise), 0.4 * reach, 0, np.pi, 11, "y"),
                               [(-0.8 * reach, 0, body + 0.7 * rise)]])  # fmt: skip
    else:
        z = max(h, body + 0.04)
        path = np.array([(0, 0, body + g), (0, 0, z - 0.02), (-0.02, 0, z), (-reach, 0, z), (-reach - 0.005, 0, z - 0.03)])
    b.sweep(spout, path, 0.6 * r, "metal")
    if g:
        b.cylinder(spout, (0, 0, body + g), (0, 0, body + g + 0.02), 0.95 * r, None, "metal")
        # away from a single lever the spout swings freely, towards it only where there is none
        near = -b.uniform(0.8, 2.0) if two else 0.0
        b.spin(spout, "base", (0, 0, body), (0, 0, side), near, b.uniform(0.8, 2.0), closed=0.0)
    if two:
        style = b.choice(("cross", "lever", "knob"))
        for s in (-1, 1):
            y = s * span
            b.cylinder("base", (0, y, 0.01), (0, y, 0.045), 0.9 * r, 0.7 * r, "metal")
            handle = part(b, "handle")
            z = 0.045 + max(b.gap, 0.0006)
            if style == "lever":
                b.cylinder(handle, (0, y, z), (0, y, z + 0.025), 0.75 * r, None, "metal", "handle")
                b.cylinder(handle, (0, y, z + 0.017), (0, y + s * 0.07, z + 0.026), 0.006, 0.004, "metal", "handle")
            else:
                dial(b, handle, (0, y, z), (0, 0, 1), 1.6 * r, 0.035, "cross" if style == "cross" else "flute", "metal")
            b.disc(handle, (0, y, z + (0.025 if style == "lever" else 0.031)), (0, 0, 1), 0.25 * r, 0.006, b.choice(("red", "green")), "decor", False)
            b.spin(handle, "base", (0, y, 0), (0, 0, s), 0, b.uniform(1.2, 2.0))
        return
    lever = part(b, "lever")
    z = 0.75 * body
    b.cylinder("base", (0, side * 0.9 * r, z), (0, side * 1.8 * r, z), 0.6 * r, None, "metal")
    y = side * (1.8 * r + max(b.gap, 0.0006))
    b.cylinder(lever, (0, y, z), (0, y + side * 0.014, z), 0.62 * r, None, "metal", "handle")
    b.cylinder(lever, (0, y + side * 0.008, z), (0.0, y + side * 0.012, z + 0.075), 0.005, 0.004, "metal", "handle")
    b.hinge(lever, "base", (0, y, z), (0, 1, 0), 0, b.uniform(0.5, 1.0), opens=(-1, 0, 0), tip=(0, y, z + 0.07))


def valve(b: Builder) -> None:
    """A pipe valve: a gate valve with a hand wheel, a ball valve with a lever, or a knob on a plate."""
    r = b.uniform(0.02, 0.05)
    half = r * b.uniform(2.5, 4)
    b.size(2 * half, 4 * r, 5 * r)
    b.theme(b.choice(("steel", "dark", "paint")))
    style = b.choice(("gate", "ball", "plate"))
    if style == "plate":
        n, d = b.integer(3, 6), 4 * r
        if b.chance(0.5):
            b.box("base", (-d, -d, 0), (d, d, 0.4 * r), "light")
        else:
            b.cylinder("base", (0, 0, 0), (0, 0, 0.4 * r), d, None, "light")
        b.cylinder("base", (0, 0, 0.4 * r), (0, 0, 0.7 * r), 0.8 * r, None, "metal")
        studs(b, [(s * 0.6 * d, t * 0.6 * d, 0.4 * r) for s in (-1, 1) for t in (-1, 1)], (0, 0, 1), 0.12 * r)
        turn = part(b, "knob", "valve")
        z = 0.7 * r + max(b.gap, 0.0005)
        b.cylinder(turn, (0, 0, z), (0, 0, z + 1.2 * r), r, None, "accent", "handle")
        for k in range(n):
            t = k * TAU / n
            p = np.array([np.cos(t), np.sin(t), 0])
            bar(b, turn, (0.6 * r * p) + (0, 0, z + 0.6 * r), 2.3 * r * p + (0, 0, z + 0.6 * r), 0.7 * r, 1.1 * r, material="accent", role="handle")
        b.spin(turn, "base", (0, 0, z), (0, 0, 1))
        return
    zc = 1.5 * r
    b.cylinder("base", (0, -half, zc), (0, half, zc), r, None, "body")
    for s in (-1, 1):
        b.cylinder("base", (0, s * half, zc), (0, s * (half - 0.5 * r), zc), 1.5 * r, None, "body")
        studs(b, [(1.25 * r * np.cos(t), s * half, zc + 1.25 * r * np.sin(t)) for t in np.arange(6) * TAU / 6 + 0.4], (0, s, 0), 0.12 * r)
    b.sphere("base", (0, 0, zc), 1.35 * r, "body")
    if style == "gate":
        top = zc + b.uniform(2.6, 4.0) * r
        b.cylinder("base", (0, 0, zc), (0, 0, top - 0.3 * r), 0.8 * r, 0.5 * r, "body")
        b.cylinder("base", (0, 0, top - 0.7 * r), (0, 0, top), 0.2 * r, None, "metal")
        turn = part(b, "wheel", "hand_wheel")
        _hand_wheel(b, turn, (0, 0, top + max(b.gap, 0.0005)), (0, 0, 1), b.uniform(1.4, 2.2) * r, 0.2 * r)
        b.spin(turn, "base", (0, 0, top), (0, 0, 1))
    else:
        top = zc + 1.9 * r
        b.cylinder("base", (0, 0, zc), (0, 0, top), 0.5 * r, None, "body")
        b.block("base", (0, 0.55 * r, top - 0.1 * r), (0.25 * r, 0.25 * r, 0.2 * r), "metal")
        lever = part(b, "lever")
        z, l = top + max(b.gap, 0.0005), b.uniform(2.5, 4.5) * r
        b.cylinder(lever, (0, 0, z), (0, 0, z + 0.35 * r), 0.5 * r, None, "metal", "handle")
        bar(b, lever, (0, 0, z + 0.2 * r), (0, l, z + 0.2 * r), 0.6 * r, 0.15 * r, material="metal", role="handle")
        bar(b, lever, (0, 0.45 * l, z + 0.2 * r), (0, 1.02 * l, z + 0.2 * r), 0.7 * r, 0.3 * r, material="red", role="handle")
        b.hinge(lever, "base", (0, 0, z), (0, 0, 1), 0, np.pi / 2, rest=b.choice((0.0, 0.0, 1.57)))


def _hand_wheel(b: Builder, link: str, centre: tuple[float, float, float], axis: tuple[float, float, float],
                radius: float, thick: float) -> None:  # fmt: skip
    """A spoked hand wheel; its hub stands on `centre`."""
    spokes = b.integer(3, 6)
    paint = b.choice(("red", "dark", "metal", "accent"))
    with b.facing(centre, axis):
        b.cylinder(link, (0, 0, 0), (0, 0, 2 * thick), 0.22 * radius, None, paint, "handle")
        b.torus(link, (0, 0, thick), (0, 0, 1), radius, 0.6 * thick, paint, "handle")
        for t in np.arange(spokes) * TAU / spokes:
            d = np.array([np.cos(t), np.sin(t), 0.0])
            b.cylinder(link, 0.15 * radius * d + (0, 0, thick), radius * d + (0, 0, thick), 0.4 * thick, None, paint, "handle")


def hand_wheel(b: Builder) -> None:
    """A hand wheel or a plain crank on a stand or on a wall plate."""
    r, t = b.uniform(0.08, 0.2), b.uniform(0.01, 0.02)
    b.size(2 * r, 2 * r, 3 * r)
    b.theme(b.choice(("steel", "paint", "dark")))
    g = max(b.gap, 0.0008)
    z = 1.35 * r
    if b.chance(0.5):
        rounded(b, "base", (-0.5 * r, -0.7 * r, 0), (1.1 * r, 0.7 * r, 0.12 * r), 0.1 * r)
        b.box("base", (0.25 * r, -0.25 * r, 0.12 * r), (0.85 * r, 0.25 * r, z + 0.3 * r), "body")
        x = 0.25 * r - 0.15 * r
    else:
        b.box("base", (0.25 * r, -0.9 * r, 0), (0.4 * r, 0.9 * r, 2.7 * r), "body")
        studs(b, [(0.25 * r, s * 0.75 * r, q) for s in (-1, 1) for q in (0.2 * r, 2.5 * r)], (-1, 0, 0), 0.06 * r)
        x = 0.1 * r
    b.cylinder("base", (0.3 * r, 0, z), (x, 0, z), 0.16 * r, None, "metal")
    turn = part(b, "wheel", "hand_wheel")
    if b.chance(0.75):
        _hand_wheel(b, turn, (x - g, 0, z), (-1, 0, 0), r, t)
        grip = (x - g - t, 0.9 * r, z) if b.chance(0.6) else None
    else:
        b.cylinder(turn, (x - g, 0, z), (x - g - 2 * t, 0, z), 0.2 * r, None, "metal", "handle")
        bar(b, turn, (x - g - t, 0, z), (x - g - t, r, z), 2 * t, t, (1, 0, 0), "metal", "handle")
        grip = (x - g - t, 0.93 * r, z)
    if grip:
        end = (grip[0] - 0.5 * r, grip[1], grip[2])
        if b.chance(0.3):
            b.cylinder(turn, grip, end, 0.3 * t, None, "metal", "handle")
            sleeve = part(b, "handle", "grip")
            b.tube(sleeve, (grip[0] - 0.8 * t, grip[1], z), (end[0] + 0.002, grip[1], z), t, 0.36 * t, "wood", "handle")
            b.spin(turn, "base", (x, 0, z), (1, 0, 0))
            b.spin(sleeve, turn, grip, (1, 0, 0))
            return
        b.cylinder(turn, grip, end, 0.8 * t, 1.1 * t, "wood", "handle")
    b.spin(turn, "base", (x, 0, z), (1, 0, 0))


def _rocker(b: Builder, y: float, z: float, w: float, h: float, t: float) -> None:
    """A rocker in a cut-out that spans x = 0 to t: tilts about a horizontal axis."""
    key = part(b, "switch", "rocker")
    g = 0.0006
    tilt = 0.12
    rise = np.tan(tilt) * (h / 2 - g)
    poly = [(0.9 * t, -h / 2 + g), (0.9 * t, h / 2 - g), (-rise - 0.0006, h / 2 - g), (-0.0008, 0), (-0.0006, -h / 2 + g)]
    with b.facing((0, y + w / 2 - g, z), (0, -1, 0), (1, 0, 0)):
        b.extrude(key, poly, w - 2 * g, "light", "handle")
    # the back of the cut-out is open by a little more than the rocker's heel needs
    b.hinge(key, "base", (0.2 * t, y, z), (0, 1, 0), 0, 2 * tilt, opens=(1, 0, 0), tip=(0, y, z + h / 2))


def switch(b: Builder) -> None:
    """Wall switches: plates with rockers, toggles or sliders, one to four of them, some blind."""
    count = b.integer(1, 4)
    cell, h, t = b.uniform(0.04, 0.055), b.uniform(0.08, 0.12), b.uniform(0.006, 0.012)
    width = count * cell + 0.03
    b.size(t * 3, width, h)
    b.theme(b.choice(("white", "white", "plastic", "steel", "dark")))
    style = b.choice(("rocker", "toggle", "slider"))
    kw, kh = {"rocker": (0.6 * cell, 0.5 * h), "toggle": (0.012, 0.026), "slider": (0.008, 0.55 * h)}[style]
    ys = [(k - (count - 1) / 2) * cell for k in range(count)]
    live = [b.chance(0.85) for _ in ys]
    live[0] = True
    zc = h / 2
    holes = [(y - kw / 2, zc - kh / 2, y + kw / 2, zc + kh / 2) for y, k in zip(ys, live) if k]
    pierced(b, "base", (0, -width / 2, 0), (t, width / 2, h), holes, "x", "front")
    deep = t + (0.03 if style == "toggle" else 0.012)
    if b.chance(0.7):
        b.shell("base", (t, -width / 2 + 0.008, 0.01), (deep, width / 2 - 0.008, h - 0.01), 0.002, "-x", "dark", "solid")
    for y, k in zip(ys, live):
        studs(b, [(0, y, zc + s * 0.42 * h) for s in (-1, 1)], (-1, 0, 0), 0.0025)
        if not k:
            if b.chance(0.7):  # a blind insert that looks like a rocker and does not move
                b.block("base", (-0.001, y, zc), (0.004, 0.8 * kw, 0.8 * kh), "light", "decor", False)
            continue
        if style == "rocker":
            _rocker(b, y, zc, kw, kh, t)
        elif style == "toggle":
            key = part(b, "switch", "toggle")
            b.sphere(key, (0.006, y, zc), 0.0055, "metal")
            tip = (0.006 - 0.022 * np.cos(0.35), y, zc - 0.022 * np.sin(0.35))
            b.cylinder(key, (0.006, y, zc), tip, 0.003, 0.0045, b.choice(("metal", "light", "dark")), "handle")
            b.hinge(key, "base", (0.006, y, zc), (0, 1, 0), 0, 0.7, opens=(0, 0, 1), tip=tip)
        else:
            key = part(b, "slider")
            z0 = zc - 0.4 * kh
            b.cylinder(key, (0.6 * t, y, z0), (-0.012, y, z0), 0.0025, None, "metal")
            b.block(key, (-0.008, y, z0), (0.012, 0.014, 0.012), b.choice(("light", "dark", "accent")), "handle")
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
                y0, y1 = (-w / 2 if j == 0 else y - pitch / 2), (w / 2 if j == columns - 1 else y + pitch / 2)
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
                    b.lathe(key, [(0.95 * r, 0), (0.95 * r, 0.3 * r + 0.85 * head), (0.8 * r, 0.3 * r + head)], paint, "handle")
                b.slide(key, "base", (0, 0, -1), 0, min(travel, t - 0.6 * r))


def lever(b: Builder) -> None:
    """A lever on a base: pivots between two cheeks or out of a slot, with a ball or a grip."""
    l, w = b.uniform(0.12, 0.3), b.uniform(0.05, 0.1)
    b.size(w, w, l)
    b.theme(b.choice(("steel", "paint", "dark", "plastic")))
    base_h = b.uniform(0.02, 0.06)
    rounded(b, "base", (-w, -w, 0), (w, w, base_h), b.choice((0.001, 0.3 * w)))
    studs(b, [(s * 0.8 * w, t * 0.8 * w, base_h) for s in (-1, 1) for t in (-1, 1)], (0, 0, 1), 0.06 * w)
    thick, g = b.uniform(0.12, 0.25) * w, max(b.gap, 0.001)
    r, z = b.uniform(0.25, 0.35) * w, 0.0
    z = base_h + r + 0.004
    cheeks = b.choice(((-1, 1), (-1, 1), (1,)))
    for s in cheeks:
        y0 = s * (thick / 2 + g)
        b.box("base", (-0.9 * r, y0, base_h), (0.9 * r, y0 + s * 0.25 * w, z), "metal")
        b.cylinder("base", (0, y0, z), (0, y0 + s * 0.25 * w, z), 0.9 * r, None, "metal")
    arm = part(b, "lever")
    tilt = b.uniform(-0.7, 0.0)
    tip = np.array([l * np.sin(tilt), 0, z + l * np.cos(tilt)])
    foot = np.array([0, 0, z])
    b.cylinder(arm, (0, -thick / 2, z), (0, thick / 2, z), 0.85 * r, None, "metal")
    if b.chance(0.5):
        bar(b, arm, foot, tip, thick * 0.9, 0.7 * r, (np.cos(tilt), 0, -np.sin(tilt)), "metal", "handle")
    else:
        b.cylinder(arm, foot, tip, 0.45 * thick, None, "metal", "handle")
    if b.chance(0.6):
        b.sphere(arm, tip, b.uniform(0.6, 1.1) * thick + 0.004, b.choice(("red", "dark", "accent")), "handle")
    else:
        b.cylinder(arm, tip + 0.4 * (foot - tip), tip, 0.6 * thick + 0.003, None, "rubber", "handle")
    if b.chance(0.4):
        b.cylinder(arm, (0, -thick / 2 - g - 0.3 * w, z), (0, thick / 2 + g + 0.3 * w, z), 0.3 * r, None, "metal")
    b.hinge(arm, "base", (0, 0, z), (0, 1, 0), 0, b.uniform(0.6, 1.0) - tilt, opens=(1, 0, 0), tip=tip)


def press_handle(b: Builder) -> None:
    """A block with a broad handle that presses down between guides (a plunger or detonator)."""
    w, h = b.uniform(0.08, 0.14), b.uniform(0.06, 0.14)
    b.size(w, w, 2 * h)
    b.theme(b.choice(("paint", "steel", "wood", "plastic")))
    travel, stem = b.uniform(0.4, 0.75) * h, b.uniform(0.08, 0.16) * w
    bored(b, "base", (-w / 2, -w / 2, 0.15 * h), (w / 2, w / 2, h), "z", (0, 0), 1.15 * stem)
    b.box("base", (-w / 2, -w / 2, 0), (w / 2, w / 2, 0.15 * h), "body")
    if b.chance(0.5):
        b.tube("base", (0, 0, h), (0, 0, h + 0.1 * w), 2 * stem, 1.15 * stem, "metal")
    key = part(b, "handle", "press")
    top = h + travel + 0.1 * w + 0.008
    b.cylinder(key, (0, 0, max(h - 0.3 * h, 0.15 * h + travel + 0.001)), (0, 0, top), stem, None, "metal")
    if b.chance(0.6):
        b.block(key, (0, 0, top + 0.01), (0.3 * w, b.uniform(0.7, 1.1) * w, 0.02), b.choice(("red", "dark", "wood")), "handle")
    else:
        b.cylinder(key, (0, -0.5 * w, top + 0.008), (0, 0.5 * w, top + 0.008), 0.012, None, "wood", "handle")
    b.slide(key, "base", (0, 0, -1), 0, travel)


def lock(b: Builder) -> None:
    """A lock on a door leaf: a dial, a turn latch, or a bolt that slides in two keepers."""
    w, h, t = b.uniform(0.08, 0.2), b.uniform(0.12, 0.3), b.uniform(0.02, 0.04)
    b.size(t, w, h)
    b.box("base", (0, -w / 2, 0), (t, w / 2, h), "body")
    style = b.choice(("dial", "latch", "bolt", "padlock"))
    z, g = b.uniform(0.4, 0.6) * h, max(b.gap, 0.0006)
    r = b.uniform(0.18, 0.3) * w
    if style in ("dial", "latch"):
        if b.chance(0.5):
            b.disc("base", (0, 0, z), (-1, 0, 0), 1.25 * r, 0.004, "metal")
        else:
            rounded(b, "base", (-0.004, -1.2 * r, z - 1.8 * r), (0, 1.2 * r, z + 1.8 * r), 0.4 * r, "x", "metal")
            studs(b, [(-0.004, 0, z + s * 1.55 * r) for s in (-1, 1)], (-1, 0, 0), 0.1 * r)
        knob = part(b, "knob", style)
        if style == "dial":
            dial(b, knob, (-0.004 - g, 0, z), (-1, 0, 0), r, 0.6 * r, b.choice(("skirt", "flute", "pointer", "bar")))
            b.spin(knob, "base", (0, 0, z), (1, 0, 0))
        else:
            b.cylinder(knob, (-0.004 - g, 0, z), (-0.014 - g, 0, z), 0.5 * r, None, "metal", "handle")
            b.box(knob, (-0.03 - g, -0.2 * r, z - r), (-0.012 - g, 0.2 * r, z + r), "metal", "handle")
            b.spin(knob, "base", (0, 0, z), (1, 0, 0), 0, np.pi / 2)
    elif style == "bolt":
        rounded(b, "base", (-0.003, -0.4 * w, z - 0.1 * h), (0, 0.4 * w, z + 0.1 * h), 0.01, "x", "metal")
        rod = part(b, "bolt")
        q = 0.03 * w + 0.002
        x = -0.003 - 1.6 * q
        for y in (-0.3 * w, 0.02 * w):
            bored(b, "base", (x - 1.6 * q, y, z - 1.6 * q), (-0.003, y + 0.08 * w, z + 1.6 * q), "y", (x, z), 1.15 * q, "metal")
        b.cylinder(rod, (x, -0.32 * w, z), (x, 0.34 * w, z), q, None, "metal")
        b.cylinder(rod, (x, 0.28 * w, z), (x - 4 * q, 0.28 * w, z), 0.7 * q, None, "metal", "handle")
        b.slide(rod, "base", (0, 1, 0), -0.13 * w, 0.0, closed=0.0, open=-0.13 * w)
    else:
        b.box("base", (-0.006, -0.1 * w, z + 0.08 * h), (0, 0.1 * w, z + 0.13 * h), "metal")
        x = -0.006 - 0.09 * w
        b.box("base", (x - 0.08 * w, -0.3 * w, z - 0.2 * h), (x + 0.08 * w, 0.3 * w, z + 0.03 * h), "gold")
        b.box("base", (x + 0.07 * w, -0.1 * w, z - 0.1 * h), (0, 0.1 * w, z - 0.05 * h), "metal")
        shackle = part(b, "shackle")
        q = 0.045 * w
        top = z + 0.03 * h
        path = np.concatenate([[(x, 0.2 * w, top + 0.001)], arc((x, 0, top + 0.3 * w), 0.2 * w, 0, np.pi, 9, "x"), [(x, -0.2 * w, top + 0.001)]])
        b.sweep(shackle, path, q, "metal", "handle")
        b.hinge(shackle, "base", (x, 0.2 * w, top), (0, 0, 1), 0, 1.6, opens=(-1, 0, 0), tip=(x, -0.2 * w, top))


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
        b.box("base", (-0.004, -0.2 * w, 0.65 * h), (-0.001, 0.2 * w, 0.9 * h), "screen", "decor", False)
        studs(b, [(-0.002, 0.27 * w + k * 1.2 * r, 0.78 * h) for k in range(2)], (-1, 0, 0), 0.35 * r)
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
        dial(b, knob, (-0.002 - max(b.gap, 0.0004), y, z), (-1, 0, 0), r, b.uniform(0.9, 1.4) * r, style, paint)
        limits = {} if endless else {"lower": 0.0, "upper": b.uniform(1.5, 4.7)}
        b.spin(knob, "base", (0, y, z), (1, 0, 0), **limits)


def thermostat(b: Builder) -> None:
    """A wall thermostat: a turning ring round a fixed face, or a wheel at the side of a box."""
    r = b.uniform(0.035, 0.06)
    b.size(0.03, 2 * r, 2 * r)
    b.theme(b.choice(("white", "steel", "dark")))
    g = max(b.gap, 0.0006)
    if b.chance(0.6):
        z = 1.2 * r
        rounded(b, "base", (0.0, -1.2 * r, 0), (0.006, 1.2 * r, 2.4 * r), b.choice((0.002, 0.4 * r, 1.19 * r)), "x", "front")
        b.cylinder("base", (0, 0, z), (-0.022, 0, z), 0.78 * r, None, "screen")
        ring = part(b, "dial", "ring")
        b.tube(ring, (-g, 0, z), (-0.02, 0, z), r, 0.83 * r, b.choice(("metal", "dark", "light")), "handle")
        b.box(ring, (-0.0215, -0.02 * r, z + 0.86 * r), (-0.019, 0.02 * r, z + 0.97 * r), "red", "decor", False)
        b.spin(ring, "base", (0, 0, z), (1, 0, 0), -2.3, 2.3, closed=0.0)
    else:
        b.box("base", (0, -r, 0), (0.025, r, 1.8 * r), "front")
        b.box("base", (-0.001, -0.8 * r, 0.9 * r), (0, 0.8 * r, 1.6 * r), "screen", "decor", False)
        knob = part(b, "dial")
        dial(b, knob, (-g, 0, 0.45 * r), (-1, 0, 0), 0.32 * r, 0.012)
        b.spin(knob, "base", (0, 0, 0.45 * r), (1, 0, 0), 0, b.uniform(2, 4.7))


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
                    b.sweep("base", [e * r + (x, y, t), e * r + (x, y, t + 0.025), e * 0.35 * r + (x, y, t + 0.025)], 0.005, "dark", "decor", collision=False)
            else:
                b.cylinder("base", (x, y, t), (x, y, t + b.choice((0.001, 0.008))), r, None, "dark")
    n = rows * columns + int(b.chance(0.2))
    kr = b.uniform(0.016, 0.022)
    g = max(b.gap * 0.3, 0.0005)
    style, paint = b.choice(("skirt", "bar", "pointer", "flute")), b.choice(("dark", "metal", "light"))
    for k in range(n):
        y = (k - (n - 1) / 2) * min(2.6 * kr + 0.01, (w - 0.06) / n)
        knob = part(b, "knob")
        if front:
            foot, axis = (-g, y, t / 2), (-1, 0, 0)
        else:
            foot, axis = (0.07, y, t + g), (0, 0, 1)
        dial(b, knob, foot, axis, min(kr, 0.42 * t) if front else kr, 0.025, style, paint)
        b.spin(knob, "base", foot, axis, 0, b.uniform(1.57, 4.7))


CATEGORIES = {
    "faucet": faucet, "valve": valve, "hand_wheel": hand_wheel, "switch": switch,
    "button_panel": button_panel, "lever": lever, "press_handle": press_handle, "lock": lock,
    "knob_panel": knob_panel, "thermostat": thermostat, "hob": hob,
}  # fmt: skip
