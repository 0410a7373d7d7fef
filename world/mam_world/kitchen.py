"""Kitchen appliances: cooling, washing up and cooking."""

from __future__ import annotations

import numpy as np

from mam_world import cabinetry as c
from mam_world.kit import Builder


def appliance_manner(b: Builder, board: float, front: float) -> c.Manner:
    """Appliance fronts: thick slabs, no wood handles."""
    handle = b.choice(["bar", "bow", "strip", "recessed", "none"], [0.45, 0.2, 0.15, 0.1, 0.1])
    return c.Manner(
        board, front, False, handle, handle, b.uniform(0.25, 0.5), "slab", "slab",
        float(np.radians(b.choice([90, 100, 110, 120]))), b.choice(["metal", "dark", "body"]),
    )  # fmt: skip


def paint_appliance(b: Builder) -> None:
    """White, steel, dark or painted enamel."""
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
    paint_appliance(b)
    kind = b.choice(["one", "top", "bottom", "french", "side"])
    w = b.uniform(0.8, 0.95) if kind in ("french", "side") else b.uniform(0.45, 0.75)
    d, h = b.uniform(0.5, 0.7), b.uniform(0.8, 1.3) if kind == "one" else b.uniform(1.4, 1.9)
    b.size(w, d, h)
    m = appliance_manner(b, b.uniform(0.035, 0.06), b.uniform(0.04, 0.07))
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
    paint_appliance(b)
    w, d, h = b.uniform(0.5, 0.7), b.uniform(0.5, 0.65), b.uniform(0.8, 1.8)
    b.size(w, d, h)
    m = appliance_manner(b, b.uniform(0.04, 0.06), b.uniform(0.03, 0.05))
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
    paint_appliance(b)
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
            # the lower lid's grip goes under the upper lid
            tall = 0.008 if k else 0.4 * max(g, 0.002)
            b.block(lid, (0.5 * d, y + (0.06 if k == 0 else share - 0.06), z + 0.012 + tall / 2),
                    (0.2, 0.02, tall), "metal", "handle")  # fmt: skip
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
        b.hinge(lid, "base", (d, 0, h + g + b.choice([0.0, min(thick, 0.014 * b.diagonal)])),
                (0, 1, 0), 0.0, np.radians(b.choice([60, 75, 85])), opens=(0, 0, 1))  # fmt: skip


def dishwasher(b: Builder) -> None:
    """A front hinged at its foot, sometimes open on its pulled racks, or drawers."""
    paint_appliance(b)
    w, d, h = b.choice([0.45, 0.6, 0.6]), b.uniform(0.55, 0.62), b.uniform(0.8, 0.88)
    b.size(w, d, h)
    m = appliance_manner(b, 0.025, b.uniform(0.03, 0.06))
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
    paint_appliance(b)
    w, d, h = b.uniform(0.5, 0.9), b.uniform(0.5, 0.65), b.uniform(0.55, 0.95)
    b.size(w, d, h)
    m = appliance_manner(b, b.uniform(0.02, 0.035), b.uniform(0.03, 0.05))
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
        b.rotary("base", (low[0], y, 0.5 * (low[2] + high[2]) + 0.3 * shift), (-1, 0, 0), size,
                 b.uniform(0.9, 1.4) * size, b.choice(["dark", "metal", "dark"]), f"knob_{k}",
                 turn)  # fmt: skip
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


CATEGORIES = {
    "fridge": fridge,
    "freezer_upright": freezer_upright,
    "freezer_chest": freezer_chest,
    "dishwasher": dishwasher,
    "oven": oven,
}
