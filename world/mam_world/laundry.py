"""Washing machines and dryers, loaded from the front or from the top."""

from __future__ import annotations

import numpy as np

from mam_world import shapes
from mam_world.kit import Builder


def _controls(b: Builder, x: float, width: float, low: float, high: float, left: float) -> None:
    """A strip of controls facing -X up to y = `left`: a programme knob, buttons, a display."""
    z, tall = 0.5 * (low + high), high - low
    if b.chance(0.85):
        # between the buttons and the end, with room for its skirt
        right = -0.16 * width
        radius = min(0.3 * tall, 0.36 * (left - right))
        y = float(np.clip(b.uniform(-0.1, 0.1) * width, right + 1.3 * radius, left - 1.3 * radius))
        b.rotary("base", (x, y, z), (-1, 0, 0), radius, 0.025,
                 b.choice(["metal", "dark", "light"]),
                 turn=b.choice([np.inf, np.radians(330)]))  # fmt: skip
    for k in range(b.integer(0, 5)):
        y = -0.18 * width - k * 0.055 * width
        b.button("base", (x, y, z), (-1, 0, 0), 0.03 * width, 0.25 * tall, 0.003,
                 shape=b.choice(["round", "square"]))  # fmt: skip
    if b.chance(0.5):
        b.block("base", (x - 0.001, -0.28 * width, z + 0.32 * tall),
                (0.002, 0.2 * width, 0.2 * tall), "screen", "decor")  # fmt: skip


def _plate_with_hole(b: Builder, x: float, t: float, width: float, low: float, high: float,
                     z: float, radius: float) -> None:  # fmt: skip
    """A front plate facing -X with a round hole: wedges between the circle and the outline."""
    n = 24
    angle = 2 * np.pi * np.arange(n) / n
    ring = np.stack([radius * np.cos(angle), z + radius * np.sin(angle)], axis=1)
    out = []
    for a in angle:
        d = np.array([np.cos(a), np.sin(a)])
        reach = [(0.5 * width) / abs(d[0]) if abs(d[0]) > 1e-9 else np.inf,
                 (high - z) / d[1] if d[1] > 1e-9 else np.inf,
                 (z - low) / -d[1] if d[1] < -1e-9 else np.inf]  # fmt: skip
        out.append([0, z] + d * min(reach))
    corners = [np.array([sy * width / 2, zz]) for sy in (1, -1) for zz in (low, high)]
    turn = [np.arctan2(c[1] - z, c[0]) % (2 * np.pi) for c in corners]
    with b.facing((x, 0, 0), (1, 0, 0), (0, 1, 0)):
        for k in range(n):
            j = (k + 1) % n
            edge = [out[k]]
            a0, a1 = angle[k], angle[k] + 2 * np.pi / n
            edge += [c for c, a in zip(corners, turn) if a0 + 1e-6 < a < a1 - 1e-6]
            edge.append(out[j])
            b.extrude("base", np.array([ring[k], *edge, ring[j]]), t, "front")


def washer_front(b: Builder) -> None:
    """A round glass door in front, a programme knob, buttons and a detergent drawer."""
    b.theme(b.choice(["white", "steel", "dark"], [0.6, 0.25, 0.15]))
    w, d, h = b.uniform(0.5, 0.65), b.uniform(0.4, 0.62), b.uniform(0.75, 0.95)
    b.size(w, d, h)
    t, strip = 0.02, b.uniform(0.12, 0.17)
    foot = b.choice([0.0, 0.015])
    if foot:
        b.feet("base", (0, -w / 2), (d, w / 2), foot, "round", "dark")
    b.shell("base", (0, -w / 2, foot), (d, w / 2, h), t, "-x", role="solid")
    radius = b.uniform(0.27, 0.34) * min(w, 0.6)
    zc = foot + 0.5 * (h - strip)
    _plate_with_hole(b, 0.0, t, w, foot, h - strip, zc, radius)
    # the drum behind the hole
    with b.facing((t, 0, zc), (1, 0, 0), (0, 0, 1)):
        length = 0.7 * d
        b.vessel(
            "base", [[radius + 0.02, 0], [radius + 0.02, length]], 0.006, "metal", bottom=False
        )
        b.disc("base", (0, 0, length), (0, 0, 1), radius + 0.02, 0.006, "metal")
    _front_strip(b, w, h, strip, t, d)
    _porthole(b, zc, radius)


def _front_strip(b: Builder, w: float, h: float, strip: float, t: float, d: float) -> None:
    """The strip above the door, with a detergent drawer on its left or not."""
    low, high = h - strip, h - t
    dark, left = b.choice(["front", "dark", "light"]), w / 2
    if b.chance(0.7):
        dw, g = b.uniform(0.24, 0.34) * w, max(b.gap, 0.001)
        y1 = w / 2 - t
        left = y1 - dw
        b.box("base", (0, -w / 2, low), (t, y1 - dw, h - t), dark)
        b.box("base", (0, y1 - dw, low), (0.6 * d, y1, low + 0.004), "inside")
        drawer = b.link("detergent_drawer", "drawer")
        z0, z1 = low + 0.004 + g, high - g
        b.panel(drawer, (-0.008, y1 - dw + g, z0), (t, y1 - g, z1), "front")
        b.drawer_box(drawer, (t, y1 - dw + 2 * g + 0.004, z0 + 0.004), (0.5 * d, y1 - g - 0.004,
                     z0 + 0.6 * (z1 - z0)), 0.004)  # fmt: skip
        b.handle(drawer, (-0.008, y1 - dw / 2, 0.5 * (z0 + z1)), (-1, 0, 0), (0, 1, 0), 0.6 * dw,
                 b.choice(["none", "recessed", "strip", "cup"]), "trim")  # fmt: skip
        b.slide(drawer, "base", (-1, 0, 0), 0.0, 0.35 * d)
    else:
        b.box("base", (0, -w / 2, low), (t, w / 2, h - t), dark)
    _controls(b, 0.0, w, low, h - t, left)


def _porthole(b: Builder, z: float, radius: float) -> None:
    """The round door: a ring around a glass bowl, hinged at one side."""
    door = b.link("door_0", "door")
    g, thick = max(b.gap, 0.0005), b.uniform(0.03, 0.05)
    rim = b.uniform(0.04, 0.06)
    outer = radius + 0.6 * rim
    with b.facing((-g, 0, z), (-1, 0, 0), (0, 0, 1)):
        inner = radius - 0.5 * rim
        b.tube(door, (0, 0, 0), (0, 0, thick), outer, inner, b.choice(["metal", "front", "dark"]))
        b.lathe(
            door, [[inner, 0.2 * thick], [inner, 0.5 * thick], [0.6 * inner, 0.75 * thick]], "glass"
        )
    side = b.choice([1, -1])
    hinge_y = side * (outer + 0.004)
    if b.chance(0.8):
        b.block(door, (-g - 0.5 * thick, side * (outer - 0.005), z), (thick, 0.022, 0.5 * radius),
                "metal")  # fmt: skip
    at = (-g - thick, -side * (outer - 0.25 * rim), z)
    b.handle(door, at, (-1, 0, 0), (0, 0, 1), 0.5 * radius,
             b.choice(["none", "recessed", "bow", "bar"]), "dark")  # fmt: skip
    b.hinge(door, "base", (-g - 0.3 * thick, hinge_y, z), (0, 0, 1), 0.0,
            np.radians(b.choice([90, 110, 120])), opens=(-1, 0, 0))  # fmt: skip


def washer_top(b: Builder) -> None:
    """A lid over the drum, and a raised panel of controls behind it."""
    b.theme(b.choice(["white", "steel", "dark"], [0.7, 0.2, 0.1]))
    w, d, h = b.uniform(0.42, 0.7), b.uniform(0.5, 0.68), b.uniform(0.8, 0.95)
    b.size(w, d, h)
    t, back = 0.02, b.uniform(0.1, 0.16)
    b.shell("base", (0, -w / 2, 0), (d, w / 2, h), t, "+z", role="solid")
    hole = 0.5 * min(w - 0.1, d - back - 0.08)
    xc = 0.5 * (d - back)
    low, high = np.array([xc - hole, -hole]), np.array([xc + hole, hole])
    deck = 0.02
    b.box("base", (t, -w / 2 + t, h - deck), (low[0], w / 2 - t, h))
    b.box("base", (high[0], -w / 2 + t, h - deck), (d - t, w / 2 - t, h))
    b.box("base", (low[0], -w / 2 + t, h - deck), (high[0], low[1], h))
    b.box("base", (low[0], high[1], h - deck), (high[0], w / 2 - t, h))
    with b.moved((xc, 0, 0.25 * h)):
        r = min(hole, w / 2 - t - 0.01, xc - t)
        b.vessel("base", [[r, 0], [r, 0.75 * h - deck]], 0.006, "metal")
    g = b.gap
    lid = b.link("lid", "lid")
    x1 = d - back
    thick = b.uniform(0.015, 0.03)
    b.box(lid, (0.02, -w / 2 + 0.03, h + g), (x1, w / 2 - 0.03, h + g + thick),
          b.choice(["front", "glass"]))  # fmt: skip
    if b.chance(0.5):
        b.handle(lid, (0.02, 0, h + g + 0.5 * thick), (-1, 0, 0), (0, 1, 0), 0.15,
                 b.choice(["strip", "bar", "bow"]), "trim")  # fmt: skip
    b.hinge(lid, "base", (x1, 0, h + g), (0, 1, 0), 0.0, np.radians(b.choice([65, 70, 75])),
            opens=(0, 0, 1))  # fmt: skip
    tall = b.uniform(0.1, 0.18)
    x = x1 + 0.02 + thick
    profile = np.array([[x, h], [d, h], [d, h + tall], [x + 0.3 * (d - x), h + tall]])
    with b.facing((0, w / 2, 0), (0, -1, 0), (1, 0, 0)):
        b.extrude("base", profile, w, "body")
    slope = profile[3] - profile[0]
    normal = np.array([-slope[1], 0, slope[0]])
    middle = profile[0] + 0.5 * slope
    count = b.integer(1, 3)
    for k in range(count):
        y = w * (-0.3 + 0.6 * (k + 0.5) / count)
        radius = min(0.3 * tall, 0.22 * w / count)
        b.rotary("base", (middle[0], y, middle[1]), normal, radius, 0.022, "dark", f"knob_{k}",
                 b.choice([np.inf, np.radians(320)]))  # fmt: skip
    for k in range(b.integer(0, 3)):
        b.button(
            "base", (middle[0], 0.34 * w + 0.04 * w * k, middle[1]), normal, 0.016, 0.012, 0.002
        )


def dryer_drum(b: Builder) -> None:
    """A dryer: a square door in front, knobs above, and a drum that turns behind the open door."""
    b.theme(b.choice(["white", "steel", "dark"], [0.6, 0.25, 0.15]))
    w, d, h = b.uniform(0.55, 0.7), b.uniform(0.55, 0.7), b.uniform(0.8, 1.0)
    b.size(w, d, h)
    t, strip, g = 0.02, 0.14, b.gap
    b.shell("base", (0, -w / 2, 0), (d, w / 2, h), t, "-x", role="solid")
    radius, zc = 0.3 * w, 0.5 * (h - strip)
    _plate_with_hole(b, 0.0, t, w, 0.0, h - strip, zc, radius)
    b.box("base", (0, -w / 2, h - strip), (t, w / 2, h - t), "front")
    _controls(b, 0.0, w, h - strip, h - t, w / 2)
    drum = b.link("drum", "drum")
    with b.facing((t + 0.004 + g, 0, zc), (1, 0, 0), (0, 0, 1)):
        length = d - 2 * t - 0.012 - 2 * g
        r = 1.1 * radius
        b.vessel(drum, [[r, 0], [r, length]], 0.004, "metal", bottom=False)
        b.disc(drum, (0, 0, length - 0.004), (0, 0, 1), r, 0.004, "metal")
        for k in range(3):
            with b.moved((0, 0, 0), (0, 0, 1), 2 * np.pi * k / 3):
                outline = shapes.rounded_rectangle(0.04, 0.02, 0.004) + np.array([r - 0.026, 0])
                b.extrude(drum, outline, 0.9 * length, "light")
        b.spin(drum, "base", (0, 0, 0), (0, 0, 1))
    door = b.link("door_0", "door")
    half, thick = 1.25 * radius, 0.035
    b.box(door, (-g - thick, -half, zc - half), (-g, half, zc + half), "front")
    side = b.choice([1, -1])
    b.handle(door, (-g - thick, -side * 0.85 * half, zc), (-1, 0, 0), (0, 0, 1), 0.14,
             b.choice(["recessed", "bar", "bow", "none"]), "trim")  # fmt: skip
    b.hinge(door, "base", (-g - 0.4 * thick, side * half, zc), (0, 0, 1), 0.0, np.radians(110),
            opens=(-1, 0, 0), rest=np.radians(b.uniform(70, 110)), ajar=False)  # fmt: skip


CATEGORIES = {"washer_front": washer_front, "washer_top": washer_top, "dryer": dryer_drum}
