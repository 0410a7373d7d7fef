"""Electronics: laptops, phones, keyboards, remotes, cameras, USB sticks."""

from __future__ import annotations

import numpy as np

from mam_world.kit import Builder
from mam_world.mech import dial, studs
from mam_world.solids import part, pierced, rounded


def _keys(
    b: Builder,
    low: tuple[float, float],
    high: tuple[float, float],
    z: float,
    rise: float,
    rows: int,
    columns: int,
) -> None:
    """Fixed keys on a deck: they look like keys but belong to the body."""
    dx, dy = (high[0] - low[0]) / rows, (high[1] - low[1]) / columns
    for r in range(rows):
        wide = b.integer(3, 6) if r == 0 else 1
        y, k = low[1], 0
        while k < columns:
            n = wide if r == 0 and k == columns // 2 - wide // 2 else 1
            x = low[0] + r * dx
            b.box("base", (x + 0.08 * dx, y + 0.08 * dy, z),
                  (x + 0.92 * dx, y + (n - 0.08) * dy, z + rise), "dark", "decor",
                  False)  # fmt: skip
            y, k = y + n * dy, k + n
            if k > columns:
                break


def laptop(b: Builder) -> None:
    """A laptop: a lid with a screen on a deck with keys and a touch pad."""
    w, d = b.uniform(0.26, 0.4), b.uniform(0.18, 0.27)
    h, t, r = b.uniform(0.008, 0.025), b.uniform(0.004, 0.01), b.choice((0.001, 0.01, 0.02))
    b.size(w, d, d)
    b.theme(b.choice(("steel", "dark", "plastic", "white")))
    gap = max(min(b.gap, 0.004 * b.diagonal), 0.0012)
    # the deck ends before the barrels, which turn in free air
    rad = min(b.uniform(0.3, 0.45) * h, 0.011 * b.diagonal)
    rounded(b, "base", (0, -w / 2, 0), (d - rad - 0.0006, w / 2, h), r)
    _keys(
        b, (0.45 * d, -0.45 * w), (0.9 * d, 0.45 * w), h, 0.0006, b.integer(4, 6), b.integer(10, 14)
    )
    b.box("base", (0.06 * d, -0.16 * w, h), (0.4 * d, 0.16 * w, h + 0.0003), "trim", "decor", False)
    lid = part(b, "lid")
    z = h + gap
    rounded(b, lid, (0, -w / 2, z), (d, w / 2, z + t), r)
    m = b.uniform(0.02, 0.07) * d
    b.box(lid, (m, -w / 2 + m, z - 0.0002), (d - 1.5 * m, w / 2 - m, z + 0.3 * t), "screen",
          "decor", False)  # fmt: skip
    if b.chance(0.5):
        b.disc(lid, (d / 2, 0, z + t), (0, 0, 1), 0.06 * d, 0.0004, "metal", "decor", False)
    spans = b.choice(
        (((-0.35, -0.2), (0.2, 0.35)), ((-0.25, 0.25),), ((-0.42, -0.32), (0.32, 0.42)))
    )
    for y0, y1 in spans:
        b.cylinder(lid, (d, y0 * w, h + gap / 2), (d, y1 * w, h + gap / 2), rad, None, "dark")
    b.hinge(lid, "base", (d, 0, h + gap / 2), (0, 1, 0), 0.0, b.uniform(1.9, 2.6), opens=(0, 0, 1),
            rest=b.choice((0.0, 1.2, 1.57, 1.75, 1.85)))  # fmt: skip


def phone(b: Builder) -> None:
    """A flip phone or a slider phone, lying on its back."""
    w, l, t = b.uniform(0.042, 0.055), b.uniform(0.075, 0.1), b.uniform(0.007, 0.012)
    r = b.choice((0.004, 0.01, 0.015))
    b.size(w, l, 2 * t)
    b.theme(b.choice(("dark", "plastic", "steel", "white")))
    gap = max(b.gap, 0.0008)
    rows, columns = 4, 3
    flip = b.chance(0.55)
    # a flip phone's deck ends before the barrels, which turn in free air between two lugs
    rounded(b, "base", (0, -w / 2, 0), (l - 0.9 * t if flip else l, w / 2, t), r)
    for side in (-1, 1) if flip else ():
        y0, y1 = sorted((side * 0.3 * w, side * (0.5 * w - 0.3 * r)))
        b.box("base", (l - 2.5 * t, y0, 0.2 * t), (l - 0.2 * t, y1, 0.95 * t), "body")
    reach = 0.62 * l if flip else 0.42 * l
    dx, dy = (reach - 0.08 * l) / rows, 0.84 * w / columns
    for i in range(rows):
        for j in range(columns):
            x, y = 0.06 * l + i * dx, -0.42 * w + j * dy
            b.box("base", (x + 0.1 * dx, y + 0.1 * dy, t),
                  (x + 0.85 * dx, y + 0.9 * dy, t + 0.0004), "light", "decor", False)  # fmt: skip
    z = t + gap
    lid = part(b, "lid", "screen")
    if flip:
        rounded(b, lid, (0, -w / 2, z), (l - 0.9 * t, w / 2, z + t), r)
        b.box(lid, (l - 1.2 * t, -0.28 * w, z), (l - 0.3 * t, 0.28 * w, z + 0.7 * t), "body")
        b.box(lid, (0.1 * l, -0.4 * w, z - 0.0003), (0.75 * l, 0.4 * w, z + 0.2 * t), "screen",
              "decor", False)  # fmt: skip
        if b.chance(0.6):
            b.box(lid, (0.3 * l, -0.25 * w, z + t), (0.6 * l, 0.25 * w, z + t + 0.0003), "screen",
                  "decor", False)  # fmt: skip
        b.cylinder(
            lid, (l, -0.28 * w, z - gap / 2), (l, 0.28 * w, z - gap / 2), 0.8 * t, None, "dark"
        )
        for s in (-1, 1):
            b.cylinder("base", (l, s * 0.3 * w, z - gap / 2), (l, s * 0.5 * w, z - gap / 2),
                       0.8 * t, None, "trim")  # fmt: skip
        b.hinge(lid, "base", (l, 0, z - gap / 2), (0, 1, 0), 0, b.uniform(2.4, 2.9),
                opens=(0, 0, 1), rest=b.choice((0.0, 0.0, 2.2)))  # fmt: skip
    else:
        rounded(b, lid, (0, -w / 2, z), (l, w / 2, z + t), r)
        b.box(lid, (0.08 * l, -0.44 * w, z + t), (0.8 * l, 0.44 * w, z + t + 0.0003), "screen",
              "decor", False)  # fmt: skip
        b.disc(lid, (0.04 * l, 0, z + t), (0, 0, 1), 0.02 * l, 0.0006, "trim", "decor", False)
        b.slide(lid, "base", (1, 0, 0), 0, b.uniform(0.4, 0.5) * l, rest=b.choice((0.0, 0.03)))


def keyboard(b: Builder) -> None:
    """A keyboard or key pad: up to twelve of its keys press, the others are fixed."""
    rows, columns = b.choice(((4, 3), (4, 4), (2, 5), (3, 6), (4, 8), (5, 4)))
    pitch = b.uniform(0.016, 0.022)
    depth, width = rows * pitch, columns * pitch
    m, h, rise = b.uniform(0.008, 0.02), b.uniform(0.012, 0.025), b.uniform(0.003, 0.006)
    b.size(depth + 2 * m, width + 2 * m, h)
    b.theme(b.choice(("dark", "plastic", "white")))
    slot, size = 0.96 * pitch, 0.82 * pitch
    centres = [
        (m + (i + 0.5) * pitch, m + (j + 0.5) * pitch) for i in range(rows) for j in range(columns)
    ]
    skip = b.uniform(0, 0.3) if b.chance(0.4) else 0.0
    moving = [b.rng.random() >= skip for _ in centres]
    for k in b.rng.permutation(np.flatnonzero(moving))[12:]:
        moving[k] = False
    holes = [
        (x - slot / 2, y - slot / 2, x + slot / 2, y + slot / 2)
        for (x, y), k in zip(centres, moving)
        if k
    ]
    high = (depth + 2 * m, width + 2 * m, h)
    pierced(b, "base", (0, 0, 0.35 * h), high, holes)
    b.box("base", (0, 0, 0), (high[0], high[1], 0.35 * h), "trim")
    travel = min(0.6 * rise + 0.001, 0.5 * h)
    for (x, y), k in zip(centres, moving):
        link = part(b, "button", "key") if k else "base"
        z = 0.35 * h + travel + 0.001 if k else h - 0.001
        b.box(link, (x - size / 2, y - size / 2, z), (x + size / 2, y + size / 2, h + rise),
              b.choice(("front", "light", "accent"), p=(0.8, 0.15, 0.05)))  # fmt: skip
        if k:
            b.slide(link, "base", (0, 0, -1), 0, travel)


def remote(b: Builder) -> None:
    """A remote control: a long case with a few press buttons and printed or fixed ones."""
    w, l, h = b.uniform(0.035, 0.055), b.uniform(0.11, 0.22), b.uniform(0.012, 0.024)
    b.size(w, l, h)
    b.theme(b.choice(("dark", "plastic", "white", "dark")))
    columns = b.integer(1, 3)
    pitch = 0.86 * w / columns
    rows = min(b.integer(2, 6), int(0.75 * l / pitch))
    rise, travel = b.uniform(0.0015, 0.003), b.uniform(0.001, 0.002)
    size, round_ = b.uniform(0.55, 0.75) * pitch, b.chance(0.5)
    start = b.uniform(0.1, 0.2) * l
    at = [
        (start + (i + 0.5) * pitch, (j + 0.5 - columns / 2) * pitch)
        for i in range(rows)
        for j in range(columns)
    ]
    slot = size + 0.0008
    holes = [(x - slot / 2, y - slot / 2, x + slot / 2, y + slot / 2) for x, y in at]
    pierced(b, "base", (0, -w / 2, 0.5 * h), (l, w / 2, h), holes)
    b.box("base", (0, -w / 2, 0), (l, w / 2, 0.5 * h), "trim")
    b.box("base", (l, -0.3 * w, 0.3 * h), (l + 0.003, 0.3 * w, 0.8 * h), "screen", "decor", False)
    for x, y in at:
        key = part(b, "button")
        bottom = max(0.5 * h + travel + 0.0003, h - 0.006)
        paint = b.choice(("light", "accent", "red", "front"))
        if round_:
            b.cylinder(key, (x, y, bottom), (x, y, h + rise), size / 2, None, paint)
        else:
            b.block(key, (x, y, (bottom + h + rise) / 2), (size, size, h + rise - bottom), paint)
        b.slide(key, "base", (0, 0, -1), 0, travel)
    if b.chance(0.5) and start + rows * pitch + 0.6 * w < l:
        x = start + rows * pitch + 0.35 * w
        b.torus("base", (x, 0, h), (0, 0, 1), 0.25 * w, 0.0015, "metal", "decor")


def camera(b: Builder) -> None:
    """A camera: a lens ring that turns, a shutter button and one or two dials on top."""
    w, h, d = b.uniform(0.1, 0.15), b.uniform(0.06, 0.1), b.uniform(0.03, 0.06)
    b.size(w, h, 2 * d)
    b.theme(b.choice(("dark", "dark", "steel", "plastic")))
    b.box("base", (0, -w / 2, 0), (d, w / 2, h), "body")
    b.box("base", (-0.12 * d, -w / 2, 0.15 * h), (0, -0.44 * w, 0.9 * h), "rubber")
    if b.chance(0.6):
        b.box("base", (-0.1 * d, -0.17 * w, h), (0.8 * d, 0.17 * w, 1.22 * h), "trim")
        b.box("base", (0.8 * d, -0.1 * w, 1.03 * h), (0.95 * d, 0.1 * w, 1.18 * h), "dark")
    b.box(
        "base", (d, -0.28 * w, 0.15 * h), (d + 0.001, 0.25 * w, 0.75 * h), "screen", "decor", False
    )
    y, z, r = b.uniform(0, 0.08) * w, 0.48 * h, b.uniform(0.3, 0.42) * h
    length = b.uniform(0.3, 1.2) * d
    # a fixed mount carries the barrel; the focus ring turns round it
    b.cylinder("base", (0, y, z), (-0.15 * length, y, z), 1.08 * r, None, "metal")
    b.tube("base", (-0.15 * length, y, z), (-length, y, z), 0.82 * r, 0.68 * r, "dark")
    b.disc("base", (-0.15 * length, y, z), (-1, 0, 0), 0.66 * r, 0.6 * length, "glass")
    ring = part(b, "dial", "lens_ring")
    b.tube(ring, (-0.2 * length, y, z), (-0.92 * length, y, z), r, 0.88 * r, "rubber", "handle")
    for t in np.arange(12) * np.pi / 6:
        c, s = y + 1.0 * r * np.cos(t), z + 1.0 * r * np.sin(t)
        b.cylinder(ring, (-0.35 * length, c, s), (-0.75 * length, c, s), 0.06 * r, None, "dark",
                   "handle", False)  # fmt: skip
    b.spin(ring, "base", (0, y, z), (1, 0, 0), 0.0, b.uniform(1.0, 3.0))
    shutter = part(b, "button", "shutter")
    b.cylinder(
        "base", (0.3 * d, -0.38 * w, h), (0.3 * d, -0.38 * w, h + 0.003), 0.16 * d, None, "metal"
    )
    b.cylinder(shutter, (0.3 * d, -0.38 * w, h + 0.0032), (0.3 * d, -0.38 * w, h + 0.0062),
               0.11 * d, None, "metal")  # fmt: skip
    b.slide(shutter, "base", (0, 0, -1), 0, 0.0008)
    for k in range(b.integer(0, 2)):
        knob = part(b, "dial")
        dial(b, knob, (0.5 * d, (0.27 + 0.14 * k) * w, h + b.gap * 0.2), (0, 0, 1),
             min(0.25 * d, 0.06 * w), 0.1 * h, "flute")  # fmt: skip
        b.spin(knob, "base", (0.5 * d, (0.27 + 0.14 * k) * w, h), (0, 0, 1))


def usb_stick(b: Builder) -> None:
    """A USB stick: swivel cover, pull-off cap, or a plug that slides out of its case."""
    w, l, t = b.uniform(0.016, 0.022), b.uniform(0.035, 0.055), b.uniform(0.006, 0.01)
    plug = 0.014
    b.size(w, l + plug, t)
    b.theme("plastic")
    style = b.choice(("swivel", "cap", "slide"))
    with b.moved((0, 0, 0.0012 if style == "swivel" else 0.0)):
        _usb_stick(b, style, w, l, t, plug)


def _usb_stick(b: Builder, style: str, w: float, l: float, t: float, plug: float) -> None:
    pw, pt = 0.6 * w, min(0.0045, 0.55 * t)
    if style == "slide":
        gap = 0.0005
        pierced(b, "base", (0, -w / 2, 0.65 * t), (l, w / 2, t),
                [(0.2 * l, -0.12 * w, 0.2 * l + plug + 0.3 * l, 0.12 * w)])  # fmt: skip
        b.box("base", (0, -w / 2, 0), (l, w / 2, 0.15 * t), "body")
        for s in (-1, 1):
            b.box("base", (0, s * 0.36 * w, 0.15 * t), (l, s * w / 2, 0.65 * t), "body")
        b.box("base", (0, -0.36 * w, 0.15 * t), (0.08 * l, 0.36 * w, 0.65 * t), "body")
        slider = part(b, "slider")
        b.box(slider, (0.12 * l, -0.34 * w, 0.15 * t + gap),
              (l - plug - 0.001, 0.34 * w, 0.65 * t - gap), "trim")  # fmt: skip
        b.box(slider, (l - plug - 0.001, -pw / 2, 0.4 * t - 0.2 * t),
              (l - 0.001, pw / 2, 0.4 * t + 0.18 * t), "metal")  # fmt: skip
        b.box(slider, (0.21 * l, -0.1 * w, 0.65 * t - gap), (0.36 * l, 0.1 * w, 1.2 * t), "accent",
              "handle")  # fmt: skip
        b.slide(slider, "base", (1, 0, 0), 0, min(plug, 0.3 * l), rest=b.choice((0.0, 0.006)))
        return
    rounded(b, "base", (0, -w / 2, 0), (l, w / 2, t), b.choice((0.001, 0.3 * w)))
    b.box("base", (l - 0.001, -pw / 2, (t - pt) / 2), (l + plug, pw / 2, (t + pt) / 2), "metal")
    if style == "cap":
        cap = part(b, "lid", "cap")
        wall = 0.12 * w
        g = 0.0004
        x0, x1 = l + g, l + plug + 0.003
        side = (t - pt) / 2 - g
        b.box(cap, (x1, -w / 2, 0), (x1 + 0.002, w / 2, t), "front")
        for s in (-1, 1):
            b.box(cap, (x0, s * (w / 2 - wall), 0), (x1, s * w / 2, t), "front")
        b.box(cap, (x0, -w / 2 + wall, 0), (x1, w / 2 - wall, side), "front")
        b.box(cap, (x0, -w / 2 + wall, t - side), (x1, w / 2 - wall, t), "front")
        b.slide(cap, "base", (1, 0, 0), 0, plug)
    else:
        cover = part(b, "lid", "cover")
        e, g = 0.0008, 0.0004
        x0 = 0.16 * l
        x1 = x0 + float(np.hypot(l + plug - x0, pw / 2)) + g  # the plug's corners swing past it
        for z in (-g - e, t + g):
            rounded(b, cover, (x0 - w / 2, -w / 2, z), (x1, w / 2, z + e), 0.45 * w,
                    material="metal")  # fmt: skip
        b.box(cover, (x1, -w / 2, -g - e), (x1 + 0.001, w / 2, t + g + e), "metal")
        b.cylinder(cover, (x0, 0, -g - e), (x0, 0, t + g + e), 0.16 * w, None, "metal")
        b.hinge(cover, "base", (x0, 0, 0), (0, 0, 1), 0, np.pi, rest=b.choice((0.0, 0.0, 1.2)))
        studs(b, [(0.95 * l, 0, t)], (0, 0, 1), 0.0002)


CATEGORIES = {
    "laptop": laptop,
    "phone": phone,
    "keyboard": keyboard,
    "remote": remote,
    "camera": camera,
    "usb_stick": usb_stick,
}
