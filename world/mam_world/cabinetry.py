"""Joinery shared by furniture families: carcasses cut into cells, and what fills the cells.

A carcass stands with its open side at x = 0 and its back at x = depth; fronts are overlay (in
front of the carcass, x < 0) or inset (between its panels, x > 0).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from mam_world.kit import Builder, HandleKind

Side = Literal["left", "right"]  # of a viewer who looks at the front: left is +y


@dataclass
class Manner:
    """How one piece of furniture is made: drawn once, so that its parts match."""

    board: float
    front: float
    inset: bool
    handle: HandleKind
    drawer_handle: HandleKind
    length: float
    door_front: str
    drawer_front: str
    opening: float
    metal: str = "metal"

    @property
    def face(self) -> float:
        """x of the fronts' outer surface."""
        return 0.0 if self.inset else -self.front

    @property
    def inside(self) -> float:
        """x behind the fronts, where drawers and shelves begin."""
        return self.front if self.inset else 0.0


@dataclass(frozen=True)
class Cell:
    """An opening between panels (metres) and the half panels around it that an overlay covers.

    `margin` is how far an overlay front reaches over the panels: low y, high y, low z, high z.
    `outer` tells which of low y, high y is the carcass's own side.
    """

    y0: float
    y1: float
    z0: float
    z1: float
    margin: tuple[float, float, float, float] = (0, 0, 0, 0)
    outer: tuple[bool, bool] = (True, True)

    @property
    def width(self) -> float:
        return self.y1 - self.y0

    @property
    def height(self) -> float:
        return self.z1 - self.z0


def draw_manner(b: Builder, inset: bool | None = None) -> Manner:
    """Draw boards, fronts, handles and opening angle for one piece of furniture."""
    board = b.uniform(0.014, 0.026)
    kinds: list[HandleKind] = ["none", "bar", "bow", "knob", "double", "recessed", "cup", "strip",
                               "ring"]  # fmt: skip
    handle = b.choice(kinds, [0.08, 0.26, 0.16, 0.2, 0.02, 0.08, 0.02, 0.1, 0.08])
    same = b.chance(0.7) and handle not in ("ring", "strip")
    drawer = (
        handle if same else b.choice(kinds, [0.08, 0.22, 0.15, 0.2, 0.1, 0.08, 0.1, 0.04, 0.03])
    )
    door_front = b.choice(["slab", "framed", "moulded", "double", "glass", "louvre"],
                          [0.42, 0.2, 0.14, 0.08, 0.1, 0.06])  # fmt: skip
    return Manner(
        board=board,
        front=b.uniform(0.8, 1.15) * board,
        inset=b.chance(0.3) if inset is None else inset,
        handle=handle,
        drawer_handle=drawer,
        length=b.uniform(0.08, 0.22),
        door_front=door_front,
        drawer_front="moulded" if door_front in ("moulded", "double") else
        b.choice(["slab", "slab", "framed"]),
        opening=np.radians(b.choice([90, 95, 100, 110, 115])),
        metal=b.choice(["metal", "metal", "metal", "dark", "gold", "trim"]),
    )  # fmt: skip


def carcass(
    b: Builder, m: Manner, width: float, depth: float, low: float, high: float,
    back: bool = True, top: bool = True, middle: float = 0.0,
) -> Cell:  # fmt: skip
    """Panels of a cabinet from z = low to high, open in front; returns its one cell."""
    y0, y1, t = middle - width / 2, middle + width / 2, m.board
    b.panel("base", (0, y0, low), (depth, y0 + t, high))
    b.panel("base", (0, y1 - t, low), (depth, y1, high))
    b.panel("base", (0, y0 + t, low), (depth, y1 - t, low + t))
    if top:
        b.panel("base", (0, y0 + t, high - t), (depth, y1 - t, high))
    if back:
        thin = 0.4 * t
        b.panel("base", (depth - thin, y0 + t, low + t), (depth, y1 - t, high - t), "inside")
    return Cell(y0 + t, y1 - t, low + t, high - t, (t, t, t, t if top else 0.0))


def cut(b: Builder, m: Manner, cell: Cell, depth: float, axis: Literal["y", "z"],
        shares: list[float], dividers: bool = True) -> list[Cell]:  # fmt: skip
    """Cut a cell across `axis` into parts with the given shares; panels stand between them."""
    t = m.board if dividers else 0.0
    low, high = (cell.y0, cell.y1) if axis == "y" else (cell.z0, cell.z1)
    room = (high - low) - t * (len(shares) - 1)
    parts, at = [], low
    for k, share in enumerate(np.asarray(shares) / np.sum(shares)):
        end = at + share * room
        first, last = k == 0, k == len(shares) - 1
        ym0, ym1, zm0, zm1 = cell.margin
        if axis == "y":
            margin = (ym0 if first else t / 2, ym1 if last else t / 2, zm0, zm1)
            outer = (cell.outer[0] and first, cell.outer[1] and last)
            parts.append(Cell(at, end, cell.z0, cell.z1, margin, outer))
            if t and not last:
                b.panel("base", (m.inside, end, cell.z0), (depth - 0.4 * t, end + t, cell.z1))
        else:
            margin = (ym0, ym1, zm0 if first else t / 2, zm1 if last else t / 2)
            parts.append(Cell(cell.y0, cell.y1, at, end, margin, cell.outer))
            if t and not last:
                b.panel("base", (m.inside, cell.y0, end), (depth - 0.4 * t, cell.y1, end + t))
        at = end + t
    return parts


def front_box(b: Builder, m: Manner, c: Cell) -> tuple[list[float], list[float]]:
    """Corners of the front that closes a cell, clearances included."""
    g = b.gap / 2
    if m.inset:
        g = max(b.gap, 0.0)
        return ([0.0, c.y0 + g, c.z0 + g], [m.front, c.y1 - g, c.z1 - g])
    # next to the carcass's outside the front is flush; elsewhere neighbours share the panel
    a, d, e, f = c.margin
    return ([-m.front, c.y0 - a + g, c.z0 - e + g], [-0.0, c.y1 + d - g, c.z1 + f - g])


def drawer(b: Builder, m: Manner, c: Cell, depth: float, name: str = "drawer",
           front: str | None = None, handle: HandleKind | None = None) -> str:  # fmt: skip
    """A drawer with its box, filling a cell; returns its link."""
    link = b.link(f"{name}_0", "drawer")
    low, high = front_box(b, m, c)
    b.front(link, low, high, front or m.drawer_front)
    slack = max(b.gap, 0.002) + 0.002
    long = depth * b.uniform(0.75, 0.92)
    tall = c.height * b.uniform(0.55, 0.85)
    bottom = c.z0 + slack + b.uniform(0.0, 0.1) * c.height
    top = min(bottom + tall, c.z1 - slack)
    b.drawer_box(link, (high[0], c.y0 + slack, bottom), (long, c.y1 - slack, top),
                 min(0.012, 0.1 * c.height))  # fmt: skip
    if b.chance(0.12):
        size = 0.3 * min(c.width, long)
        b.block(link, (0.45 * long, (c.y0 + c.y1) / 2, bottom + 0.012 + 0.2 * c.height),
                (size, size, 0.4 * c.height), "accent", "content")  # fmt: skip
    kind = m.drawer_handle if handle is None else handle
    middle = [low[0], (low[1] + high[1]) / 2, (low[2] + high[2]) / 2]
    if c.height > 0.22 or b.chance(0.1):
        middle[2] += 0.25 * c.height
    length = min(m.length, 0.55 * c.width)
    if kind == "double":
        length = min(length, 0.3 * c.width)
    # how far a handle reaches above and below its middle: it must not lie over a neighbour
    tall = {"ring": 0.35 * length, "recessed": max(0.15 * length, 0.01) + 0.012,
            "cup": 0.2 * length}.get(kind, 0.02)  # fmt: skip
    if tall != 0.02 and (c.height < 0.07 or high[2] - low[2] < 2 * tall):
        kind, tall = "knob", 0.02
    middle[2] = min(middle[2], max(high[2] - tall, 0.5 * (low[2] + high[2])))
    b.handle(link, middle, (-1, 0, 0), (0, 1, 0), length, kind, m.metal)
    b.slide(link, "base", (-1, 0, 0), 0.0, (long - m.inside) * b.uniform(0.6, 0.9))
    return link


def door(b: Builder, m: Manner, c: Cell, side: Side, name: str = "door", rest: float = 0.0,
         handle: HandleKind | None = None, parent: str = "base", high_handle: float = 0.5,
         front: str | None = None) -> str:  # fmt: skip
    """A hinged door over a cell; `side` carries the hinge; returns its link."""
    link = b.link(f"{name}_0", "door")
    low, high = front_box(b, m, c)
    own_side = c.outer[1] if side == "left" else c.outer[0]
    # the pin sits at the front edge; at the carcass's own side it may sit behind the front,
    # and that of a thick front is near the carcass
    x = low[0]
    if own_side and not m.inset:
        x = high[0] if b.chance(0.3) else max(x, high[0] - 0.014 * b.diagonal)
    # the corner farther from the pin's plane runs on the larger circle: it needs room
    room = max(x - low[0], high[0] - x) ** 2 / (2 * (high[1] - low[1]))
    # two that meet need a little more than a hair, or one catches the other when it comes back
    room += max(0.0, 8e-4 * b.diagonal - b.gap / 2)
    if side == "left":
        low[1] += room
    else:
        high[1] -= room
    b.front(link, low, high, front or m.door_front)
    hinge_y = high[1] if side == "left" else low[1]
    free_y = low[1] if side == "left" else high[1]
    inward = 1.0 if side == "left" else -1.0  # from the free edge towards the hinge
    width = high[1] - low[1]
    kind = m.handle if handle is None else handle
    z = low[2] + high_handle * (high[2] - low[2])
    inset_y = min(0.05, 0.2 * width)
    length = min(m.length, 0.4 * (high[2] - low[2]))
    if kind == "recessed":  # a wide field: it must not reach over the edge to its neighbour
        inset_y = min(0.5 * width, max(inset_y, 0.15 * length + 0.012))
    where = (low[0], free_y + inward * inset_y, z)
    if kind == "double":
        kind = "bar"
    if kind == "cup":
        kind = "knob"
    b.handle(link, where, (-1, 0, 0), (0, 0, 1), length, kind, m.metal)
    upper = m.opening if own_side else min(m.opening, np.pi / 2)  # else it leans over its neighbour
    if own_side and not m.inset and x == low[0] and b.chance(0.15):
        upper = np.radians(b.choice([135, 160]))
    if b.chance(0.15):
        # within the door's own width, clear of a neighbour
        knuckles(b, link, (low[0], hinge_y - 0.004 * inward, low[2], high[2]))
    b.hinge(link, parent, (x, hinge_y, (low[2] + high[2]) / 2), (0, 0, 1), 0.0, upper,
            opens=(-1, 0, 0), rest=rest * upper, ajar=rest == 0.0)  # fmt: skip
    return link


def knuckles(b: Builder, link: str, line: tuple[float, float, float, float]) -> None:
    """Visible hinge barrels on a door's front edge: x, y and the z range of the door."""
    x, y, z0, z1 = line
    for share in (0.15, 0.85):
        z, r = z0 + share * (z1 - z0), 0.004
        b.cylinder(link, (x - r, y, z - 0.02), (x - r, y, z + 0.02), r, None, "metal", "decor")


def pair(b: Builder, m: Manner, c: Cell, rest: float = 0.0, name: str = "door",
         high_handle: float = 0.5) -> None:  # fmt: skip
    """Two doors that meet in the middle of a cell."""
    share = 0.5 if b.chance(0.8) else b.uniform(0.35, 0.65)
    right, left = cut(b, m, c, 0.0, "y", [share, 1 - share], dividers=False)
    door(b, m, right, "right", name, rest, high_handle=high_handle)
    door(b, m, left, "left", name, rest, high_handle=high_handle)


def shelves(b: Builder, m: Manner, c: Cell, depth: float, count: int) -> None:
    """Boards inside a cell, a little behind the fronts."""
    for k in range(count):
        z = c.z0 + (k + 1) * c.height / (count + 1)
        b.panel("base", (m.inside + 0.01 + b.gap, c.y0, z - m.board / 2),
                (depth - 0.4 * m.board, c.y1, z + m.board / 2), "inside")  # fmt: skip


def contents(b: Builder, c: Cell, depth: float, inside: float) -> None:
    """A few books or boxes standing on the bottom of a cell."""
    y = c.y0 + 0.02
    while y < c.y1 - 0.08 and b.chance(0.85):
        w = b.uniform(0.015, 0.07)
        tall = min(b.uniform(0.12, 0.3), 0.8 * c.height)
        x0 = inside + 0.03 + b.uniform(0, 0.15) * depth
        b.box("base", (x0, y, c.z0), (min(x0 + 0.5 * depth, 0.92 * depth), y + w, c.z0 + tall),
              b.choice(["accent", "light", "dark", "red", "green"]), "content")  # fmt: skip
        y += w + b.uniform(0.0, 0.03)


def fill(b: Builder, m: Manner, c: Cell, depth: float, what: str, rest: float = 0.0) -> None:
    """Fill a cell: drawer, drawers, left, right, pair, open or blank."""
    if what == "drawer":
        drawer(b, m, c, depth)
    elif what == "drawers":
        n = int(np.clip(round(c.height / b.uniform(0.14, 0.26)), 2, 5))
        stack = cut(b, m, c, depth, "z", rows(b, n), dividers=b.chance(0.4))
        for part in stack:
            drawer(b, m, part, depth)
    elif what in ("left", "right"):
        shelves(b, m, c, depth, b.integer(0, 2))
        height = b.choice([0.5, 0.5, 0.35, 0.65])
        door(b, m, c, "left" if what == "left" else "right", rest=rest, high_handle=height)
    elif what == "pair":
        shelves(b, m, c, depth, b.integer(0, 2))
        pair(b, m, c, rest, high_handle=b.choice([0.5, 0.5, 0.35, 0.65]))
    elif what == "open":
        shelves(b, m, c, depth, b.integer(0, 2))
        if b.chance(0.4):
            contents(b, c, depth, m.inside)
    elif what == "blank":
        low, high = front_box(b, m, c)
        b.panel("base", low, high, "front")


def rows(b: Builder, count: int) -> list[float]:
    """Shares of a stack: equal, or growing downwards (the first is the lowest)."""
    if b.chance(0.55):
        return [1.0] * count
    grow = b.uniform(1.05, 1.35)
    return [grow ** (count - k) for k in range(count)]


def under_and_over(b: Builder, m: Manner, width: float, depth: float, high: float) -> float:
    """Draw feet, build them, and return where the carcass starts; call `crown` afterwards."""
    kind = b.choice(["none", "plinth", "square", "round", "tapered", "sled"],
                    [0.25, 0.25, 0.15, 0.12, 0.15, 0.08])  # fmt: skip
    if kind == "none":
        return 0.0
    tall = b.uniform(0.03, 0.1) if kind in ("plinth", "sled") else b.uniform(0.05, 0.2)
    tall = min(tall, 0.2 * high)
    b.feet("base", (0, -width / 2), (depth, width / 2), tall, kind, inset=0.02)
    return tall


def crown(b: Builder, m: Manner, width: float, depth: float, z: float) -> None:
    """A top board or a cornice over the carcass, or nothing."""
    over = m.front if not m.inset else 0.0
    kind = b.choice(["none", "board", "cornice", "stone"], [0.4, 0.35, 0.15, 0.1])
    if kind in ("board", "stone"):
        reach = b.uniform(0.0, 0.025) + over
        b.box("base", (-reach, -width / 2 - reach + over, z),
              (depth, width / 2 + reach - over, z + b.uniform(0.012, 0.035)),
              "trim" if kind == "board" else "stone")  # fmt: skip
    elif kind == "cornice":
        b.cornice("base", (-over, -width / 2, z), (depth, width / 2, z), b.uniform(0.01, 0.04),
                  b.uniform(0.03, 0.08))  # fmt: skip
