"""Storage furniture: chests, cabinets, wardrobes, nightstands, corner and sliding cabinets."""

from __future__ import annotations

import numpy as np

from mam_world import cabinetry as c
from mam_world.kit import Builder, HandleKind


def _start(
    b: Builder, width: float, depth: float, high: float, inset: bool | None = None
) -> tuple[c.Manner, c.Cell, float, float]:
    """Feet, carcass and crown of ordinary furniture; returns manner, cell, width, depth."""
    b.size(width, depth, high)
    m = c.draw_manner(b, inset)
    low = c.under_and_over(b, m, width, depth, high)
    cell = c.carcass(b, m, width, depth, low, high, back=b.chance(0.9))
    c.crown(b, m, width, depth, high)
    return m, cell, width, depth


def chest_of_drawers(b: Builder) -> None:
    """Drawers in a stack or a grid."""
    m, cell, _, d = _start(b, b.uniform(0.35, 1.3), b.uniform(0.35, 0.6), b.uniform(0.5, 1.4))
    stack = c.cut(b, m, cell, d, "z", c.rows(b, b.integer(2, 6)), dividers=b.chance(0.5))
    for k, row in enumerate(stack):
        columns = 1
        if cell.width > 0.55:
            columns = b.integer(1, 2 if b.chance(0.7) else 3)
        if k == len(stack) - 1 and cell.width > 0.5 and b.chance(0.3):
            columns = 2
        for part in c.cut(b, m, row, d, "y", [1.0] * columns):
            c.drawer(b, m, part, d)


def cabinet_one_door(b: Builder) -> None:
    """One hinged door over the whole front."""
    m, cell, _, d = _start(b, b.uniform(0.3, 0.7), b.uniform(0.25, 0.6), b.uniform(0.4, 1.9))
    c.fill(b, m, cell, d, b.choice(["left", "right"]))


def cabinet_two_door(b: Builder) -> None:
    """A pair of doors."""
    m, cell, _, d = _start(b, b.uniform(0.5, 1.2), b.uniform(0.25, 0.6), b.uniform(0.5, 2.0))
    c.fill(b, m, cell, d, "pair")


def cabinet_three_door(b: Builder) -> None:
    """Three wings: a pair and a single door, sometimes with a drawer below."""
    m, cell, _, d = _start(b, b.uniform(1.0, 1.9), b.uniform(0.35, 0.6), b.uniform(0.8, 2.1))
    wide = b.choice([[2.0, 1.0], [1.0, 2.0]])
    right, left = c.cut(b, m, cell, d, "y", wide)
    big, small = (right, left) if wide[0] > 1 else (left, right)
    c.fill(b, m, big, d, "pair")
    if b.chance(0.4):
        low, high = c.cut(b, m, small, d, "z", [1.0, b.uniform(1.5, 3.0)])
        c.fill(b, m, low, d, b.choice(["drawer", "drawers"]))
        small = high
    c.fill(b, m, small, d, b.choice(["left", "right", "open"], [0.4, 0.4, 0.2]))


def storage_mixed(b: Builder) -> None:
    """Any mix of drawers, doors and open shelves."""
    m, cell, _, d = _start(b, b.uniform(0.5, 1.8), b.uniform(0.3, 0.6), b.uniform(0.5, 2.0))
    columns = int(np.clip(round(cell.width / b.uniform(0.4, 0.7)), 1, 3))
    moving = 0
    for column in c.cut(b, m, cell, d, "y", [b.uniform(0.7, 1.3) for _ in range(columns)]):
        count = int(np.clip(round(column.height / b.uniform(0.35, 0.8)), 1, 3))
        shares = [b.uniform(0.6, 1.4) for _ in range(count)]
        for part in c.cut(b, m, column, d, "z", shares):
            options = ["left", "right", "open"]
            if part.height < 0.4:
                options += ["drawer", "drawer"]
            else:
                options += ["drawers"]
            if part.width > 0.5:
                options += ["pair", "pair"]
            what = b.choice(options)
            if what == "open" and moving == 0:
                what = "left"
            moving += what != "open"
            c.fill(b, m, part, d, what)


def cabinet_nested_drawers(b: Builder) -> None:
    """Drawers behind doors; the doors stand open in the source, so that the drawers can move."""
    width = b.uniform(0.4, 1.0)
    m, cell, _, d = _start(b, width, b.uniform(0.35, 0.6), b.uniform(0.5, 1.5), inset=False)
    m.opening = float(np.radians(b.choice([100, 110, 115])))
    inner = c.Manner(**{**m.__dict__, "inset": True, "front": 0.8 * m.front,
                        "drawer_handle": b.choice(["none", "recessed", "knob"])})  # fmt: skip
    rest = b.uniform(0.93, 1.0)
    if width > 0.65:
        c.pair(b, m, cell, rest)
    else:
        c.door(b, m, cell, b.choice(["left", "right"]), rest=rest)
    # a lining keeps the drawers clear of the open doors
    lining, count = m.front + 0.004 + b.gap, b.integer(1, 4)
    y0, y1 = cell.y0 + lining, cell.y1 - lining
    for y in (cell.y0, y1):
        b.panel("base", (0.01 + b.gap, y, cell.z0), (0.9 * d, y + lining, cell.z1), "inside")
    low, top = c.Cell(y0, y1, cell.z0, cell.z1), None
    if b.chance(0.6):
        low, top = c.cut(b, inner, low, d, "z", [1.0, b.uniform(0.4, 1.2)])
    # the inner fronts and their knobs stand behind the doors' plane
    matrix, back = np.eye(4), 0.03 if inner.drawer_handle == "none" else 0.05
    matrix[0, 3] = back + b.gap
    with b.at(matrix):
        for part in c.cut(b, inner, low, d, "z", [1.0] * count, dividers=False):
            c.drawer(b, inner, part, 0.9 * d - back, "inner_drawer")
    if top is not None:
        c.shelves(b, m, top, d, 1)


def cabinet_sliding(b: Builder) -> None:
    """Two or three doors that slide past each other on tracks."""
    m, cell, _, d = _start(b, b.uniform(0.8, 2.2), b.uniform(0.35, 0.65), b.uniform(0.5, 2.2), True)
    count = 2 if b.chance(0.75) else 3
    t, g = m.front, max(b.gap, 0.003)
    overlap = b.uniform(0.02, 0.06)
    each = (cell.width - 2 * b.gap + overlap * (count - 1)) / count
    z0, z1 = cell.z0 + b.gap, cell.z1 - b.gap
    kind = b.choice(["slab", "framed", "glass"])
    for k in range(count):
        track = k % 2
        x = 0.004 + track * (t + g)
        y = cell.y0 + b.gap + k * (each - overlap)
        link = b.link(f"sliding_door_{k}", "door")
        b.front(link, (x, y, z0), (x + t, y + each, z1), kind)
        # the handle is flat, and on the side that the neighbour never covers
        free = y + (0.08 if k < count - 1 else 0.92) * each
        if track == 0 and m.handle != "none":
            free = y + 0.12 * each
        pull: HandleKind = "recessed" if track == 0 else "none"
        b.handle(link, (x, free, 0.5 * (z0 + z1)), (-1, 0, 0), (0, 0, 1), 0.12, pull, m.metal)
        way = 1.0 if k < count - 1 else -1.0
        # of three doors the outer two share a track: they stop where they would meet
        room = each - overlap * (1 if count == 2 else 2) - b.gap
        b.slide(link, "base", (0, way, 0), 0.0, room * b.uniform(0.8, 0.98),
                ajar=count == 2)  # fmt: skip
    inner = c.Manner(**{**m.__dict__, "front": 2 * t + 2 * g + 0.01})
    if b.chance(0.6):
        for part in c.cut(b, inner, cell, d, "y", [1.0] * b.integer(1, 3)):
            c.shelves(b, inner, part, d, b.integer(0, 4))


def sideboard(b: Builder) -> None:
    """Low and wide: doors at the sides, drawers or an open bay between them."""
    m, cell, _, d = _start(b, b.uniform(1.2, 2.2), b.uniform(0.35, 0.5), b.uniform(0.45, 0.9))
    outer, middle = b.choice(["pair", "door"]), b.choice(["drawers", "open", "pair"])
    if outer == "pair" and middle == "open" and b.chance(0.5):
        middle = "drawers"
    parts = c.cut(b, m, cell, d, "y", [1.0, b.uniform(0.8, 1.4), 1.0])
    for k, part in enumerate(parts):
        if k == 1:
            c.fill(b, m, part, d, middle)
        elif outer == "pair" and part.width > 0.5:
            c.fill(b, m, part, d, "pair")
        else:
            c.fill(b, m, part, d, "right" if k == 0 else "left")


def tall_cabinet(b: Builder) -> None:
    """A narrow tower: doors above and below, sometimes with a drawer or an open bay between."""
    m, cell, _, d = _start(b, b.uniform(0.35, 0.7), b.uniform(0.35, 0.6), b.uniform(1.6, 2.3))
    side = b.choice(["left", "right"])
    middle = b.choice(["none", "drawer", "open", "drawers"])
    if middle == "none":
        parts = c.cut(b, m, cell, d, "z", [1.0, b.uniform(0.7, 1.6)])
        fills = [side, side]
    else:
        parts = c.cut(b, m, cell, d, "z", [1.0, 0.3 if middle != "drawers" else 0.6, 1.1])
        fills = [side, middle, side]
    if b.chance(0.2):
        fills[-1] = "open"
    for part, what in zip(parts, fills):
        c.fill(b, m, part, d, what)


def bookcase(b: Builder) -> None:
    """Open shelves above, doors or drawers below."""
    m, cell, _, d = _start(b, b.uniform(0.6, 1.2), b.uniform(0.25, 0.4), b.uniform(1.3, 2.2))
    low, high = c.cut(b, m, cell, d, "z", [1.0, b.uniform(1.2, 2.5)])
    c.fill(b, m, low, d, b.choice(["pair", "drawers", "drawer"] if low.height < 0.5 else
                                  ["pair", "drawers"]))  # fmt: skip
    for part in c.cut(b, m, high, d, "z", [1.0] * b.integer(2, 4)):
        if b.chance(0.7):
            c.contents(b, part, d, m.inside)


def wardrobe(b: Builder) -> None:
    """Tall doors, a rail with hangers inside, sometimes drawers below."""
    m, cell, _, d = _start(b, b.uniform(0.8, 1.6), b.uniform(0.5, 0.65), b.uniform(1.8, 2.3))
    if b.chance(0.5):
        low, cell = c.cut(b, m, cell, d, "z", [1.0, b.uniform(3.0, 5.0)])
        for part in c.cut(b, m, low, d, "y", [1.0] * b.integer(1, 2)):
            c.drawer(b, m, part, d)
    z = cell.z1 - 0.12
    b.rod("base", (d / 2, cell.y0, z), (d / 2, cell.y1, z), 0.013, None, "metal", "content")
    b.panel("base", (m.inside + 0.03, cell.y0, z + 0.05), (0.95 * d, cell.y1, z + 0.065), "inside")
    if cell.width > 1.1:
        third = b.chance(0.4)  # the middle one of three doors needs something to hang on
        right, left = c.cut(b, m, cell, d, "y", [1.0, 1.0], dividers=third)
        if third:
            c.door(b, m, right, "right")
            c.pair(b, m, left)
        else:
            c.door(b, m, right, "right")
            c.door(b, m, left, "left")
    else:
        c.pair(b, m, cell)


def nightstand(b: Builder) -> None:
    """Bedside: one to three drawers, or a drawer above a door or an open bay."""
    m, cell, _, d = _start(b, b.uniform(0.3, 0.6), b.uniform(0.3, 0.45), b.uniform(0.4, 0.7))
    below = b.choice(["drawers", "left", "right", "open", "drawer"])
    if below == "drawers":
        c.fill(b, m, cell, d, "drawers")
        return
    low, high = c.cut(b, m, cell, d, "z", [b.uniform(1.0, 2.2), 1.0])
    c.fill(b, m, low, d, below)
    c.fill(b, m, high, d, "drawer")


def corner_cabinet(b: Builder) -> None:
    """A cabinet for a room's corner with its door across the diagonal."""
    side, arm, high = b.uniform(0.6, 1.0), b.uniform(0.25, 0.4), b.uniform(0.6, 1.9)
    b.size(side, side, high)
    m = c.draw_manner(b, inset=False)
    t, low = m.board, b.choice([0.0, 0.05, 0.08])
    # floor plan with the corner at (0, 0) and walls along +u, +v; the front cuts the far corner
    plan = np.array([[0, 0], [side, 0], [side, arm], [arm, side], [0, side]])
    turn = np.eye(4)  # u, v -> asset: the diagonal front looks towards -X
    s = np.sqrt(0.5)
    turn[:3, :3] = [[-s, -s, 0], [s, -s, 0], [0, 0, 1]]
    with b.at(turn):
        for z in (low, high - t):
            with b.moved((0, 0, z)):
                b.extrude("base", plan, t)
        b.panel("base", (0, 0, low + t), (0.5 * t, side, high - t), "inside")
        b.panel("base", (0.5 * t, 0, low + t), (side, 0.5 * t, high - t), "inside")
        b.panel("base", (side - t, 0.5 * t, low + t), (side, arm, high - t))
        b.panel("base", (0.5 * t, side - t, low + t), (arm, side, high - t))
        if low:
            with b.moved((0, 0, 0)):
                b.extrude("base", 0.93 * plan, low, "trim")
        inner = 0.5 * t + 0.9 * (plan * [1, 1])
        for k in range(b.integer(0, 3)):
            with b.moved((0, 0, low + (k + 1) * (high - low) / 4)):
                b.extrude("base", inner * 0.9, 0.6 * t, "inside")
    depth_front = -(side + arm) * s  # x of the diagonal
    half = (side - arm) * s
    matrix = np.eye(4)
    matrix[0, 3] = depth_front
    cell = c.Cell(-half, half, low + t, high - t, (0, 0, t, t))
    with b.at(matrix):
        if half > 0.28 and b.chance(0.5):
            c.pair(b, m, cell)
        else:
            c.door(b, m, cell, b.choice(["left", "right"]))
    if b.chance(0.4):
        with b.at(turn), b.moved((0, 0, high)):
            b.extrude("base", plan, 0.025, "trim")


def filing_cabinet(b: Builder) -> None:
    """Steel drawers with label frames and a lock."""
    b.theme(b.choice(["steel", "dark", "white", "paint"]))
    w, d, n = b.uniform(0.38, 0.5), b.uniform(0.5, 0.7), b.integer(2, 5)
    h = n * b.uniform(0.26, 0.34)
    b.size(w, d, h)
    m = c.draw_manner(b)
    m.drawer_handle, m.drawer_front = b.choice(["bar", "cup", "recessed", "bow"]), "slab"
    cell = c.carcass(b, m, w, d, 0.0, h)
    for part in c.cut(b, m, cell, d, "z", [1.0] * n, dividers=b.chance(0.5)):
        link = c.drawer(b, m, part, d)
        b.block(link, (m.face - 0.001, 0.3 * part.width, part.z0 + 0.75 * part.height),
                (0.002, 0.07, 0.035), "light", "decor")  # fmt: skip


CATEGORIES = {
    "chest_of_drawers": chest_of_drawers,
    "cabinet_one_door": cabinet_one_door,
    "cabinet_two_door": cabinet_two_door,
    "cabinet_three_door": cabinet_three_door,
    "storage_mixed": storage_mixed,
    "cabinet_nested_drawers": cabinet_nested_drawers,
    "cabinet_sliding": cabinet_sliding,
    "sideboard": sideboard,
    "tall_cabinet": tall_cabinet,
    "bookcase": bookcase,
    "wardrobe": wardrobe,
    "nightstand": nightstand,
    "corner_cabinet": corner_cabinet,
    "filing_cabinet": filing_cabinet,
}
