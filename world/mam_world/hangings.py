"""Things that hang, tilt and turn in a stand: mirrors, swings, flaps, monitors, revolving doors."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mam_world.fixtures import PAINTS
from mam_world.kit import Builder
from mam_world.solids import TAU, bored, part, pierced, rounded, settle


def tilt_mirror(b: Builder) -> None:
    """A mirror or a board that tilts between two posts."""
    w, h, t = b.uniform(0.15, 0.9), b.uniform(0.2, 1.4), b.uniform(0.01, 0.03)
    b.size(0.4 * h, w, 1.3 * h)
    b.theme(b.choice(("wood", "wood", "white", "dark", "steel")))
    post, g = 0.03 * w + 0.008, max(b.gap, 0.003)
    z = 0.56 * h + 0.06
    for s in (-1, 1):
        y = s * (w / 2 + g + post)
        b.block("base", (0, y, (z + post) / 2), (2 * post, 2 * post, z + post), "body")
        if b.chance(0.5):
            b.sphere("base", (0, y, z + 1.6 * post), 0.9 * post, "body")
        b.block("base", (0, y, 0.02), (0.5 * h, 2 * post, 0.04), "body")
    b.box("base", (-post / 2, -w / 2 - g, 0.04), (post / 2, w / 2 + g, 0.06), "trim")
    key = part(b, "mirror", "tilt")
    b.border(key, (-t, -w / 2, z - h / 2), (t, w / 2, z + h / 2), 0.06 * w + 0.004, "front")
    rail, pane = 0.05 * w, b.choice(("glass", "light", "screen"))
    b.panel(key, (-0.4 * t, -w / 2 + rail, z - h / 2 + rail),
            (0.7 * t, w / 2 - rail, z + h / 2 - rail), pane)  # fmt: skip
    b.cylinder(key, (0, -w / 2 - g - 0.3 * post, z), (0, w / 2 + g + 0.3 * post, z), 0.3 * post,
               None, "metal")  # fmt: skip
    tilt = b.uniform(0.2, 0.7)
    b.hinge(key, "base", (0, 0, z), (0, 1, 0), -tilt, tilt, closed=0.0)


def swing(b: Builder) -> None:
    """A seat, a bell or a sign that swings below a bar."""
    h, w = b.uniform(0.3, 2.2), b.uniform(0.2, 1.2)
    b.size(h, 1.5 * w, h)
    b.theme()
    r, kind = 0.015 * h + 0.004, b.choice(("frame", "frame", "arm"))
    z = h
    if kind == "frame":
        for s in (-1, 1):
            for x in (-0.35, 0.35):
                b.cylinder("base", (x * h, s * 0.75 * w, 0), (0, s * 0.72 * w, z), r, None, "body")
        b.cylinder("base", (0, -0.75 * w, z), (0, 0.75 * w, z), r, None, "body")
    else:
        b.box("base", (-r, 0.7 * w, 0), (r, 0.7 * w + 2 * r, 1.1 * h), "body")
        b.cylinder("base", (0, -0.5 * w, z), (0, 0.7 * w + r, z), r, None, "body")
        b.block("base", (0, 0.7 * w + r, 0.02 * h), (0.4 * h, 0.3 * w, 0.04 * h), "trim")
    key, drop = part(b, "swing", "pendulum"), b.uniform(0.35, 0.75) * h
    half = b.uniform(0.2, 0.42) * w
    ring = 1.1 * r + min(b.gap, 0.2 * r)
    for y in (-half, half):
        eye = 0.4 * half  # a sleeve on the bar
        b.tube(key, (0, y - eye, z), (0, y + eye, z), ring + 0.3 * r, ring, "metal")
        b.cylinder(key, (0, y, z - ring), (0, y, z - drop), 0.35 * r, None, "metal")
    if b.chance(0.5):
        d = b.uniform(0.1, 0.25) * h
        b.block(key, (0, 0, z - drop), (d, 2 * half + 2 * r, 1.2 * r), b.choice(PAINTS))
    else:
        tall = 0.4 * drop
        b.block(key, (0, 0, z - drop + tall / 2), (r, 2 * half + 2 * r, tall), b.choice(PAINTS))
    far = b.uniform(0.3, 0.7)
    b.hinge(key, "base", (0, 0, z), (0, 1, 0), -far, far, closed=0.0)
    settle(b)


def cat_flap(b: Builder) -> None:
    """A flap that hangs in an opening of a panel, a door or a parcel box."""
    w, h, t = b.uniform(0.12, 0.5), b.uniform(0.12, 0.5), b.uniform(0.01, 0.03)
    b.size(t, 2 * w, 2 * h)
    b.theme()
    rim, low = b.uniform(0.05, 0.8) * w, b.uniform(0.05, 0.8) * h
    top, g = low + h, max(b.gap, 0.002)
    high = top + b.uniform(0.1, 0.9) * h
    hole = [(-w / 2, low, w / 2, top)]
    pierced(b, "base", (0, -w / 2 - rim, 0), (t, w / 2 + rim, high), hole, "x", "body")
    if b.chance(0.6):  # a frame around it
        edge = min(0.1 * w, 0.5 * rim)
        outer = [(-w / 2 - 0.001, low - 0.001, w / 2 + 0.001, top + 0.001)]
        pierced(b, "base", (-0.4 * t, -w / 2 - edge, max(low - edge, 0)),
                (0, w / 2 + edge, min(top + edge, high)), outer, "x", "trim")  # fmt: skip
    if b.chance(0.3):
        b.shell("base", (t, -w / 2 - 0.9 * rim, 0), (t + 1.2 * h, w / 2 + 0.9 * rim, high), 0.006,
                "-x")  # fmt: skip
    key = part(b, "flap", "door")
    y0, y1 = -w / 2 + g, w / 2 - g
    thick = 0.4 * t
    pin = top - g - thick
    b.box(key, (t / 2 - thick / 2, y0, low + g), (t / 2 + thick / 2, y1, pin + 0.4 * thick),
          b.choice(("glass", "front", "accent")))  # fmt: skip
    b.cylinder(key, (t / 2, y0, pin), (t / 2, y1, pin), 0.5 * thick, None, "metal")
    if b.chance(0.4):
        at = (t / 2 - thick / 2, 0, low + 0.2 * h)
        b.block(key, at, (thick, 0.3 * w, 0.06 * h), "dark", "handle")
    far = b.uniform(0.6, 1.4)
    b.hinge(key, "base", (t / 2, 0, pin), (0, 1, 0), 0.0, far, opens=(-1, 0, 0),
            tip=(t / 2, 0, low))  # fmt: skip


def monitor(b: Builder) -> None:
    """A flat screen on a foot, a plate or a column: it tilts, swivels or goes up and down."""
    w, h = b.uniform(0.3, 1.2), b.uniform(0.2, 0.7)
    t, lift = b.uniform(0.015, 0.05), b.uniform(0.05, 0.25)
    b.size(0.25, w, h + lift)
    b.theme(b.choice(("dark", "dark", "steel", "white")))
    z, r = lift + h / 2, 0.02
    plate = b.chance(0.6)
    foot = 0.2 * w if plate else min(0.25 * w, 0.16)
    if plate:
        rounded(b, "base", (-0.1, -foot, 0), (0.12, foot, 0.015), 0.03)
    else:
        b.cylinder("base", (0, 0, 0), (0, 0, 0.015), foot, None, "body")
    kind, g = b.choice(("tilt", "swivel", "height")), max(b.gap, 0.001)
    x = -r - g - t if kind == "tilt" else -1.6 * r - g - t
    key = part(b, "screen", "monitor")
    b.box(key, (x, -w / 2, lift), (x + t, w / 2, lift + h), "body")
    b.box(key, (x - 0.001, -w / 2 + 0.01, lift + 0.02), (x, w / 2 - 0.01, lift + h - 0.01),
          "screen", "decor", False)  # fmt: skip
    if kind == "tilt":
        for s in (-1, 1):
            y = sorted((s * 0.04, s * (0.06 + 0.3 * max(foot - 0.055, 0.0))))
            b.box("base", (-0.7 * r, y[0], 0.015), (r, y[1], z + 0.5 * r), "trim")
        long = max(foot, 0.055)  # as wide as the foot
        b.cylinder(key, (0, -long, z), (0, long, z), 0.6 * r, None, "metal")
        b.box(key, (x + t, -0.03, z - 0.4 * r), (0, 0.03, z + 0.4 * r), "metal")
        b.hinge(key, "base", (0, 0, z), (0, 1, 0), 0.0, b.uniform(0.15, 0.5))
        return
    up = b.uniform(0.3, 0.6) * h if kind == "height" else -2 * r - 0.3 * g
    b.cylinder("base", (0, 0, 0.015), (0, 0, z + r + up), r, None, "metal")
    b.box(key, (x + t, -r, z - r), (-1.6 * r, r, z + r), "trim")
    if kind == "height":
        bored(b, key, (-1.6 * r, -1.6 * r, z - r), (1.6 * r, 1.6 * r, z + r), "z", (0, 0), r + g)
        b.slide(key, "base", (0, 0, 1), 0.0, up)
    else:
        b.cylinder(key, (0, 0, z - r), (0, 0, z + r), 1.6 * r, None, "trim")
        b.cylinder("base", (0, 0, z - r - 0.4 * g), (0, 0, z), 0.5 * r, None, "metal")  # pin
        far = b.uniform(0.3, 0.8)
        b.spin(key, "base", (0, 0, z), (0, 0, 1), -far, far, closed=0.0)


def revolving_door(b: Builder) -> None:
    """Wings about a post that turn between two curved walls."""
    r, h = b.uniform(0.5, 1.2), b.uniform(0.6, 2.4)
    b.size(2 * r, 2 * r, h)
    b.theme(b.choice(("steel", "dark", "white")))
    n, g, t = b.integer(2, 5), max(b.gap, 0.006), 0.02 * r
    cover = 0.05 * h
    b.cylinder("base", (0, 0, 0), (0, 0, 0.02 * h), 1.15 * r, None, "stone")
    b.cylinder("base", (0, 0, h), (0, 0, h + cover), 1.15 * r, None, "body")
    span = b.uniform(0.7, 1.3)
    for s in (-1, 1):
        for k in np.linspace(-span / 2, span / 2, 5):
            with b.moved((0, 0, 0), (0, 0, 1), s * TAU / 4 + k):
                wide = 1.1 * r * np.tan(span / 8) * 1.05
                b.box("base", (1.06 * r, -wide, 0.02 * h), (1.06 * r + t, wide, h), "glass")
    key = part(b, "rotor", "door")
    low, high = 0.02 * h + g, h - g
    b.cylinder(key, (0, 0, low), (0, 0, high), 0.04 * r, None, "metal")
    start = b.uniform(0, TAU / n)
    for k in range(n):
        with b.moved((0, 0, 0), (0, 0, 1), start + TAU * k / n):
            if b.chance(0.6):
                b.panel(key, (0, -t / 2, low), (0.97 * r, t / 2, high), "glass")
                b.box(key, (0.9 * r, -t, low), (0.97 * r, t, high), "metal")
            else:
                b.panel(key, (0, -t / 2, low), (0.97 * r, t / 2, high), "front")
            b.block(key, (0.6 * r, t, h / 2), (0.3 * r, t, 0.02 * h), "metal", "handle")
    b.spin(key, "base", (0, 0, 0), (0, 0, 1))


CATEGORIES: dict[str, Callable[[Builder], None]] = {
    "tilt_mirror": tilt_mirror, "swing": swing, "cat_flap": cat_flap, "monitor": monitor,
    "revolving_door": revolving_door,
}  # fmt: skip
