"""Kitchen appliances: cooling, washing up, cooking, toast and coffee."""

from __future__ import annotations

import numpy as np

from mam_pipeline.world import cabinetry as c
from mam_pipeline.world.kit import Builder


def _manner(b: Builder, board: float, front: float) -> c.Manner:
    """Appliance fronts: thick slabs, no wood handles."""
    handle = b.choice(["bar", "bow", "strip", "recessed", "none"], [0.45, 0.2, 0.15, 0.1, 0.1])
    return c.Manner(
        board, front, False, handle, handle, b.uniform(0.25, 0.5), "slab", "slab",
        float(np.radians(b.choice([90, 100, 110, 120]))), b.choice(["metal", "dark", "body"]),
    )  # fmt: skip


def _appliance(b: Builder) -> None:
    b.theme(b.choice(["white", "steel", "dark", "paint"], [0.4, 0.35, 0.15, 0.1]))


def flap(b: Builder, m: c.Manner, cell: c.Cell, name: str = "door", glass: bool = True,
         opening: float = np.pi / 2) -> str:  # fmt: skip
    """A door hinged at its lower edge, with a handle along its upper edge."""
    link = b.link(f"{name}_0", "door")
    low, high = c.front_box(b, m, cell)
    # the pin is near the carcass; the front's foot swings down in front of it and needs room
    pin = max(low[0], high[0] - 0.014 * b.diagonal)
    low[2] += pin - low[0]
    high[2] -= (pin - low[0]) ** 2 / (2 * (high[2] - low[2]))
    w, h = high[1] - low[1], high[2] - low[2]
    b.panel(link, low, high, "front")
    if glass:
        b.box(link, (low[0] - 0.003, low[1] + 0.12 * w, low[2] + 0.18 * h),
              (low[0], high[1] - 0.12 * w, high[2] - 0.28 * h), "screen", "decor")  # fmt: skip
    b.handle(link, (low[0], 0.5 * (low[1] + high[1]), high[2] - min(0.12 * h, 0.06)), (-1, 0, 0),
             (0, 1, 0), 0.75 * w, m.handle, m.metal)  # fmt: skip
    b.hinge(link, "base", (pin, 0, low[2]), (0, 1, 0), 0.0, opening, opens=(-1, 0, 0))
    return link


def fridge(b: Builder) -> None:
    """One door, freezer above or below, French doors over drawers, or side by side."""
    _appliance(b)
    kind = b.choice(["one", "top", "bottom", "french", "side"])
    w = b.uniform(0.8, 0.95) if kind in ("french", "side") else b.uniform(0.45, 0.75)
    d, h = b.uniform(0.5, 0.7), b.uniform(0.8, 1.3) if kind == "one" else b.uniform(1.4, 1.9)
    b.size(w, d, h)
    m = _manner(b, b.uniform(0.035, 0.06), b.uniform(0.04, 0.07))
    low = b.choice([0.0, 0.03, 0.05])
    if low:
        b.feet("base", (0.02, -w / 2), (d, w / 2), low, b.choice(["plinth", "round"]), inset=0.02)
    cell = c.carcass(b, m, w, d, low, h)
    side = b.choice(["left", "right"])
    if kind == "side":
        right, left = c.cut(b, m, cell, d, "y", [1.0, b.uniform(0.7, 1.0)])
        c.door(b, m, right, "right")
        c.door(b, m, left, "left")
        parts = [right, left]
        if b.chance(0.4):
            box = c.front_box(b, m, left)
            y, z = 0.5 * (box[0][1] + box[1][1]), 0.6 * h
            b.block("door_0_1", (-m.front - 0.003, y, z), (0.006, 0.18, 0.28), "dark", "decor")
    elif kind == "french":
        lower = [b.uniform(0.35, 0.6), 1.0]
        below, above = c.cut(b, m, cell, d, "z", lower)
        for part in c.cut(b, m, below, d, "z", [1.0] * b.integer(1, 2)):
            c.drawer(b, m, part, d)
        c.pair(b, m, above, high_handle=0.4)
        parts = [above]
    elif kind == "one":
        c.door(b, m, cell, side, high_handle=0.6)
        parts = [cell]
    else:
        share = b.uniform(0.3, 0.6)
        parts = c.cut(b, m, cell, d, "z", [1.0, share] if kind == "top" else [share, 1.0])
        for k, part in enumerate(parts):
            c.door(b, m, part, side, high_handle=0.7 if k == 0 else 0.3)
    for part in parts:
        c.shelves(b, m, part, 0.9 * d, b.integer(1, 4))


def freezer_upright(b: Builder) -> None:
    """One door with drawers behind it, the door standing open, or drawers in front."""
    _appliance(b)
    w, d, h = b.uniform(0.5, 0.7), b.uniform(0.5, 0.65), b.uniform(0.8, 1.8)
    b.size(w, d, h)
    m = _manner(b, b.uniform(0.04, 0.06), b.uniform(0.03, 0.05))
    m.opening = float(np.radians(115))
    cell = c.carcass(b, m, w, d, 0.0, h)
    nested = b.chance(0.6)
    c.door(b, m, cell, b.choice(["left", "right"]), rest=b.uniform(0.9, 1.0) if nested else 0.0,
           high_handle=0.6)  # fmt: skip
    if not nested:
        c.shelves(b, m, cell, d, b.integer(2, 5))
        return
    inset = m.front + 0.02 + b.gap
    inner = c.Cell(cell.y0 + 0.01, cell.y1 - 0.01, cell.z0, cell.z1)
    tray = c.Manner(m.board * 0.2, 0.008, True, "none", "none", 0.15, "slab", "slab", 0.0)
    for y in (cell.y0, cell.y1 - inset):
        b.panel("base", (0.02 + b.gap, y, cell.z0), (0.9 * d, y + inset, cell.z1), "light")
    inner = c.Cell(cell.y0 + inset, cell.y1 - inset, cell.z0, cell.z1)
    with b.moved((0.03 + b.gap, 0, 0)):
        for part in c.cut(b, tray, inner, 0.8 * d, "z", [1.0] * b.integer(2, 5)):
            c.drawer(b, tray, part, 0.8 * d, handle="recessed", front="slab")


def freezer_chest(b: Builder) -> None:
    """A chest with one or two lids hinged at the back, or two sliding glass lids."""
    _appliance(b)
    w, d, h = b.uniform(0.6, 1.6), b.uniform(0.5, 0.75), b.uniform(0.7, 0.95)
    b.size(w, d, h)
    t, g = b.uniform(0.05, 0.08), b.gap
    b.shell("base", (0, -w / 2, 0.03), (d, w / 2, h), t, "+z")
    b.feet("base", (0, -w / 2), (d, w / 2), 0.03, b.choice(["round", "plinth"]))
    if b.chance(0.25):  # two glass lids sliding over each other
        for k in range(2):
            lid = b.link(f"lid_{k}", "lid")
            z, share = h + g + k * (0.012 + max(g, 0.002)), 0.53 * w
            y = -w / 2 if k == 0 else w / 2 - share
            b.panel(lid, (0.02, y, z), (d - 0.02, y + share, z + 0.012), "glass")
            b.block(lid, (0.5 * d, y + (0.06 if k == 0 else share - 0.06), z + 0.012 + 0.004),
                    (0.2, 0.02, 0.008 if k else 0.0015), "metal", "handle")  # fmt: skip
            b.slide(lid, "base", (0, 1 if k == 0 else -1, 0), 0.0, b.uniform(0.7, 0.85) * share)
        return
    count = 2 if w > 1.2 and b.chance(0.5) else 1
    thick = b.uniform(0.04, 0.08)
    for k in range(count):
        lid = b.link(f"lid_{k}", "lid")
        y0, y1 = -w / 2 + k * w / count + g / 2, -w / 2 + (k + 1) * w / count - g / 2
        b.box(lid, (-0.01, y0, h + g), (d, y1, h + g + thick), "front")
        b.handle(lid, (-0.01, (y0 + y1) / 2, h + g + 0.5 * thick), (-1, 0, 0), (0, 1, 0),
                 min(0.4 * (y1 - y0), 0.25), b.choice(["bar", "bow", "none", "strip"]))  # fmt: skip
        b.hinge(
            lid,
            "base",
            (d, 0, h + g + b.choice([0.0, min(thick, 0.014 * b.diagonal)])),
            (0, 1, 0),
            0.0,
            np.radians(b.choice([60, 75, 85])),
            opens=(0, 0, 1),
        )


def dishwasher(b: Builder) -> None:
    """A front hinged at its foot, sometimes open on its pulled racks, or drawers."""
    _appliance(b)
    w, d, h = b.choice([0.45, 0.6, 0.6]), b.uniform(0.55, 0.62), b.uniform(0.8, 0.88)
    b.size(w, d, h)
    m = _manner(b, 0.025, b.uniform(0.03, 0.06))
    toe = b.uniform(0.06, 0.12)
    b.feet("base", (0, -w / 2), (d, w / 2), toe, "plinth", "dark", inset=0.04)
    cell = c.carcass(b, m, w, d, toe, h)
    racks = b.chance(0.35)
    panel = b.chance(0.5)
    if panel:
        cell, strip = c.cut(b, m, cell, d, "z", [1.0, 0.14])
        low, high = c.front_box(b, m, strip)
        b.panel("base", low, high, "dark")
        _buttons(b, low, high, b.integer(0, 5))
    door = flap(b, m, cell, glass=False)
    if not racks:
        return
    spec = next(j for j in b.joints if b.links[j.child][0] == door)
    spec.rest, spec.ajar = spec.upper, False
    for k, z in enumerate((cell.z0 + 0.09, cell.z0 + 0.55 * cell.height)):
        rack = b.link(f"rack_{k}", "drawer")
        y0, y1, x1 = cell.y0 + 0.01 + b.gap, cell.y1 - 0.01 - b.gap, 0.88 * d
        x0 = m.inside + 0.02 + b.gap
        _basket(b, rack, (x0, y0, z), (x1, y1, z + 0.12))
        b.slide(rack, "base", (-1, 0, 0), 0.0, b.uniform(0.6, 0.8) * (x1 - x0))


def _basket(b: Builder, link: str, low: tuple[float, float, float],
            high: tuple[float, float, float]) -> None:  # fmt: skip
    """A wire basket of bars."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    r = 0.003
    for z in (z0, z1):
        for y in (y0, y1):
            b.block(link, ((x0 + x1) / 2, y, z), (x1 - x0, 2 * r, 2 * r), "metal")
        for x in (x0, x1):
            b.block(link, (x, (y0 + y1) / 2, z), (2 * r, y1 - y0, 2 * r), "metal")
    for k in range(6):
        x = x0 + (k + 0.5) * (x1 - x0) / 6
        b.block(link, (x, (y0 + y1) / 2, z0), (2 * r, y1 - y0, 2 * r), "metal")
        for y in (y0, y1):
            b.block(link, (x, y, (z0 + z1) / 2), (2 * r, 2 * r, z1 - z0), "metal")


def _buttons(b: Builder, low: list[float], high: list[float], count: int) -> None:
    """A row of push buttons on a strip that faces -X."""
    z, size = 0.5 * (low[2] + high[2]), 0.35 * (high[2] - low[2])
    for k in range(count):
        y = low[1] + (high[1] - low[1]) * (0.15 + 0.7 * (k + 0.5) / count)
        b.button("base", (low[0], y, z), (-1, 0, 0), min(size, 0.03), min(size, 0.025),
                 shape=b.choice(["round", "square"]))  # fmt: skip


def oven(b: Builder) -> None:
    """A cooker: flap with a window, knobs or buttons above, hob on top, maybe a drawer below."""
    _appliance(b)
    w, d, h = b.uniform(0.5, 0.9), b.uniform(0.5, 0.65), b.uniform(0.55, 0.95)
    b.size(w, d, h)
    m = _manner(b, b.uniform(0.02, 0.035), b.uniform(0.03, 0.05))
    m.handle = b.choice(["bar", "bow", "strip"])
    cell = c.carcass(b, m, w, d, 0.0, h)
    shares = [1.0, b.uniform(0.18, 0.28)]
    lower = h > 0.8 and b.chance(0.6)
    if lower:
        shares = [b.uniform(0.2, 0.3), *shares]
    parts = c.cut(b, m, cell, d, "z", shares)
    if lower:
        c.drawer(b, m, parts[0], d)
    main, strip = parts[-2], parts[-1]
    flap(b, m, main, opening=np.radians(b.choice([80, 90])))
    c.shelves(b, m, main, d, b.integer(0, 2))
    low, high = c.front_box(b, m, strip)
    b.panel("base", low, high, b.choice(["front", "dark", "body"]))
    n = b.integer(2, 6)
    size = min(0.36 * (high[2] - low[2]), 0.3 * (w / n), 0.028)
    turn = b.choice([np.radians(270), np.radians(300), np.inf])
    shift = b.uniform(-0.2, 0.2) * (high[2] - low[2])
    for k in range(n):
        y = low[1] + w * (k + 0.5) / n
        b.rotary(
            "base",
            (low[0], y, 0.5 * (low[2] + high[2]) + 0.3 * shift),
            (-1, 0, 0),
            size,
            b.uniform(0.9, 1.4) * size,
            b.choice(["dark", "metal", "dark"]),
            f"knob_{k}",
            turn,
        )
    if b.chance(0.7):
        hob(b, w, d, h)


def hob(b: Builder, w: float, d: float, h: float) -> None:
    """Rings, or plates, or gas grates on top of a cooker."""
    kind = b.choice(["plate", "coil", "gas"])
    b.panel("base", (0.0, -w / 2, h), (d, w / 2, h + 0.006), "dark")
    for x in (0.28 * d, 0.72 * d):
        for y in (-0.24 * w, 0.24 * w):
            r = 0.11 * w * b.uniform(0.8, 1.2)
            if kind == "plate":
                b.disc("base", (x, y, h + 0.006), (0, 0, 1), r, 0.01, "dark", "decor")
            elif kind == "coil":
                for share in (0.4, 0.7, 1.0):
                    b.torus("base", (x, y, h + 0.012), (0, 0, 1), share * r, 0.006, "dark", "decor")
            else:
                b.disc("base", (x, y, h + 0.006), (0, 0, 1), 0.4 * r, 0.015, "metal", "decor")
                for size in ((2 * r, 0.01, 0.01), (0.01, 2 * r, 0.01)):
                    b.block("base", (x, y, h + 0.03), size, "dark", "decor")


def microwave(b: Builder) -> None:
    """A side-hinged door beside a panel of buttons, or knobs."""
    _appliance(b)
    w, d, h = b.uniform(0.42, 0.6), b.uniform(0.3, 0.42), b.uniform(0.24, 0.36)
    b.size(w, d, h)
    m = _manner(b, 0.015, b.uniform(0.015, 0.03))
    m.length, m.opening = 0.7 * h, float(np.radians(b.choice([90, 100, 110, 120])))
    m.handle = b.choice(["bar", "bow", "strip", "none"])
    cell = c.carcass(b, m, w, d, 0.012, h)
    b.feet("base", (0, -w / 2), (d, w / 2), 0.012, "round", "dark", inset=0.02)
    panel, rest = c.cut(
        b, m, cell, d, "y", [b.uniform(0.22, 0.34), 1.0]
    )  # the panel is on the right
    door = c.door(b, m, rest, "left", front="slab")
    low, high = c.front_box(b, m, rest)
    b.box(door, (low[0] - 0.002, low[1] + 0.16 * w, low[2] + 0.15 * h),
          (low[0], high[1] - 0.08 * w, high[2] - 0.15 * h), "screen", "decor")  # fmt: skip
    b.disc(
        "base",
        (0.5 * d, (rest.y0 + rest.y1) / 2, rest.z0),
        (0, 0, 1),
        0.35 * min(d, rest.width),
        0.008,
        "glass",
        "content",
    )
    low, high = c.front_box(b, m, panel)
    b.panel("base", low, high, b.choice(["front", "dark"]))
    y, pw = 0.5 * (low[1] + high[1]), high[1] - low[1]
    b.block("base", (low[0] - 0.001, y, high[2] - 0.16 * h), (0.002, 0.75 * pw, 0.12 * h), "screen",
            "decor")  # fmt: skip
    if b.chance(0.4):
        for k in range(2):
            b.rotary(
                "base",
                (low[0], y, low[2] + (0.25 + 0.3 * k) * h),
                (-1, 0, 0),
                min(0.11 * h, 0.3 * pw),
                0.02,
                "metal",
                f"knob_{k}",
                np.radians(300),
            )
        return
    columns, lines = b.integer(2, 3), b.integer(2, 5)
    for i in range(lines):
        for j in range(columns):
            at = (low[0], low[1] + pw * (0.12 + 0.76 * (j + 0.5) / columns),
                  low[2] + h * (0.06 + 0.6 * (i + 0.5) / lines))  # fmt: skip
            b.button(
                "base",
                at,
                (-1, 0, 0),
                0.6 * 0.76 * pw / columns,
                0.5 * 0.6 * h / lines,
                0.002,
                b.choice(["light", "light", "accent"]),
                "button",
                bezel=False,
            )


def toaster(b: Builder) -> None:
    """Slots above, a lever at the narrow front, a browning knob, sometimes a crumb tray."""
    b.theme(b.choice(["steel", "plastic", "white", "dark"]))
    d, w, h = b.uniform(0.24, 0.36), b.uniform(0.15, 0.22), b.uniform(0.17, 0.22)
    b.size(d, w, h)
    t, foot = 0.012, 0.012
    slots = b.integer(1, 2)
    b.feet("base", (0, -w / 2), (d, w / 2), foot, "round", "dark", inset=0.01)
    tray_h = 0.02
    b.box("base", (0, -w / 2, foot + tray_h), (t, w / 2, h))
    b.box("base", (d - t, -w / 2, foot), (d, w / 2, h))
    for s in (-1, 1):
        b.box(
            "base",
            (t, min(s * w / 2, s * (w / 2 - t)), foot),
            (d - t, max(s * w / 2, s * (w / 2 - t)), h),
        )
        b.box("base", (0, min(s * w / 2, s * (w / 2 - t)), foot),
              (t, max(s * w / 2, s * (w / 2 - t)), foot + tray_h))  # fmt: skip
    b.box("base", (t, -w / 2 + t, foot + tray_h + 0.002), (d - t, w / 2 - t, foot + tray_h + 0.006),
          "dark")  # fmt: skip
    room = w - 2 * t
    rail = 0.3 * room / (slots + 1)
    width = (room - (slots + 1) * rail) / slots
    for k in range(slots + 1):
        y = -room / 2 + k * (rail + width)
        b.box("base", (t, y, h - 0.02), (d - t, y + rail, h), "trim")
    for x0, x1 in ((t, t + 0.03), (d - t - 0.03, d - t)):
        b.box("base", (x0, -room / 2, h - 0.019), (x1, room / 2, h - 0.001), "trim")
    levers = slots if slots == 2 and b.chance(0.4) else 1
    for k in range(levers):
        y = 0.0 if levers == 1 else (k - 0.5) * 0.5 * w
        b.block("base", (-0.0006, y, 0.55 * h), (0.0012, 0.008, 0.5 * h), "dark", "decor")
        lever = b.link(f"lever_{k}", "lever")
        z = 0.78 * h
        b.block(lever, (-0.014, y, z), (0.022, 0.035, 0.014), "dark")
        b.slide(lever, "base", (0, 0, -1), 0.0, b.uniform(0.3, 0.42) * h)
        b.grasp(lever, "push", (-0.014, y, z + 0.007), (0, 0, -1), (0, 1, 0), 0.0)
    if b.chance(0.7):
        side = b.choice([-1, 1]) * 0.28 * w
        b.rotary(
            "base",
            (0, side if levers == 1 else 0.0, 0.3 * h),
            (-1, 0, 0),
            0.011,
            0.012,
            "dark",
            turn=np.radians(270),
        )
    if b.chance(0.4):
        for k in range(b.integer(1, 3)):
            b.button("base", (0, -0.3 * w, 0.36 * h + 0.025 * k), (-1, 0, 0), 0.014, 0.01, 0.002)
    if b.chance(0.4):
        tray = b.link("crumb_tray", "drawer")
        g = max(b.gap, 0.001)
        b.box(
            tray,
            (-0.004, -w / 2 + t + g, foot + g),
            (0.0, w / 2 - t - g, foot + tray_h - g),
            "trim",
        )
        b.box(
            tray,
            (0.0, -w / 2 + t + g, foot + g),
            (0.9 * d, w / 2 - t - g, foot + g + 0.003),
            "metal",
            "drawer_box",
        )
        b.slide(tray, "base", (-1, 0, 0), 0.0, 0.6 * d)


def coffee_machine(b: Builder) -> None:
    """A column with a head over a drip tray: buttons, a steam knob, a lid, a portafilter or pot."""
    b.theme(b.choice(["steel", "dark", "plastic", "white"]))
    d, w, h = b.uniform(0.25, 0.42), b.uniform(0.14, 0.32), b.uniform(0.28, 0.42)
    b.size(d, w, h)
    column, foot, head = 0.45 * d, b.uniform(0.04, 0.07), b.uniform(0.28, 0.38) * h
    lid_t = 0.02
    b.box("base", (d - column, -w / 2, foot), (d, w / 2, h - lid_t))
    b.box("base", (0.04, -w / 2, h - head), (d - column, w / 2, h - lid_t))
    t = 0.012
    b.shell("base", (0, -w / 2, 0), (d, w / 2, foot), t, "-x,+z", role="solid")
    g = max(b.gap, 0.001)
    tray = b.link("drip_tray", "drawer")
    b.shell(
        tray,
        (0, -w / 2 + t + g, t + g),
        (d - column, w / 2 - t - g, foot - 0.006),
        0.006,
        "+z",
        "dark",
        "solid",
    )
    for k in range(5):
        y = (k - 2) * 0.15 * w
        b.block(
            tray, (0.5 * (d - column), y, foot - 0.004), (d - column, 0.01, 0.004), "metal", "decor"
        )
    b.slide(tray, "base", (-1, 0, 0), 0.0, b.uniform(0.5, 0.8) * (d - column))
    b.rod("base", (0.16 * d + 0.03, 0, h - head - 0.03), (0.16 * d + 0.03, 0, h - head), 0.02, None,
          "metal")  # fmt: skip
    face = (0.04, 0.0, h - 0.5 * head)
    for k in range(b.integer(1, 4)):
        b.button(
            "base",
            (face[0], (k - 1.5) * 0.17 * w, face[2]),
            (-1, 0, 0),
            0.09 * w,
            0.09 * w,
            0.002,
            "light",
            "button",
            b.choice(["round", "square"]),
        )
    if b.chance(0.6):
        s = b.choice([-1, 1])
        b.rotary("base", (d - 0.5 * column, s * w / 2, 0.7 * h), (0, s, 0), 0.022, 0.03, "dark",
                 turn=np.radians(300))  # fmt: skip
    lid = b.link("lid", "lid")
    b.box(lid, (d - column + g, -w / 2 + g, h - lid_t + g), (d - g, w / 2 - g, h), "front")
    b.hinge(
        lid,
        "base",
        (d - g, 0, h - lid_t + g),
        (0, 1, 0),
        0.0,
        np.radians(b.choice([70, 90])),
        opens=(0, 0, 1),
    )
    b.box("base", (0.04, -w / 2, h - lid_t), (d - column, w / 2, h), "trim")


CATEGORIES = {
    "fridge": fridge,
    "freezer_upright": freezer_upright,
    "freezer_chest": freezer_chest,
    "dishwasher": dishwasher,
    "oven": oven,
    "microwave": microwave,
    "toaster": toaster,
    "coffee_machine": coffee_machine,
}
