"""Abstract doors and windows for training: leaves of many pieces that turn or slide beside panes
that stay.

Real ones are made of rails, panes, bars, mouldings, hinges and fittings, each a piece of its own;
some leaves stand beside panes that look like them, and most levers are modelled with the leaf.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from mam_pipeline.types import FloatArray
from mam_world import solids
from mam_world.kit import Builder

# what the bays hold from side to side: leaf, fixed pane
BAYS = ("L", "L", "L", "LL", "LL", "LL", "FL", "LF", "FLF", "FLLF", "FLLF", "LLL", "LFL", "LLF",
        "FFL", "LFF", "LLLL")  # fmt: skip
HANDLES = ("bar", "bow", "knob", "ring", "strip")


class Looks:
    """What all leaves of one opening share."""

    def __init__(self, b: Builder, door: bool, thick: float, width: float) -> None:
        self.thick = thick
        self.rail = b.uniform(0.03, 0.2) * width
        self.one_piece = b.chance(0.5)
        self.solid = b.uniform(0.15, 0.6) if door and b.chance(0.6) else 0.0
        self.rows = b.choice((0, 0, 0, 1, 2, 3, 4))
        self.columns = b.choice((0, 0, 1, 1, 2))
        self.bars = b.choice(("bars", "bars", "grid"))
        self.by_cell = b.chance(0.3)
        self.slab = door and b.chance(0.4)
        self.moulded = b.chance(0.5)
        self.pane = b.uniform(0.08, 0.5)  # share of the leaf's thickness
        self.sunk = b.choice((0.0, 0.0, 0.01))  # how far panes reach into what holds them
        self.hinges = b.choice((0, 0, 2, 3))
        self.knuckle = b.choice(("leaf", "leaf", "frame", "each"))
        self.fitting = b.choice(("lever", "lever", "knob", "pull", "bolt", "none"))
        self.turns = b.chance(0.25)
        self.both = b.chance(0.5)


def opening(b: Builder) -> None:
    """A door or a window: a frame, one to four bays, now and then a light above or below them."""
    door = b.chance(0.5)
    bays = b.choice(BAYS[:13] if door else BAYS)
    each = b.uniform(0.5, 1.1) if door else b.uniform(0.3, 1.0)
    share = np.array([1.0 if k == "L" else 0.0 for k in bays])
    share[share == 0] = b.choice((1.0, 1.0, b.uniform(0.25, 0.8)))
    if b.chance(0.15):
        share *= b.rng.uniform(0.5, 1.5, len(share))
    w = each * float(share.sum())
    h = b.uniform(1.7, 2.4) if door else b.uniform(0.4, 1.8)
    t = b.uniform(0.015, 0.07)
    b.size(w, t, h)
    b.theme()
    g = max(b.gap, 5e-4)
    looks = Looks(b, door, t, min(each, h))
    depth = t * b.choice((1.0, 1.5, b.uniform(2, 8)))
    rim = b.uniform(0.02, 0.12)
    above = b.uniform(0.12, 0.35) * h if b.chance(0.25) else 0.0
    below = b.uniform(0.15, 0.4) * h if not door and b.chance(0.15) else 0.0
    mullion = b.choice((0.0, 0.0, b.uniform(0.02, 0.08)))
    _surround(b, (w, h, depth), (above, below), rim, door)
    x = b.choice((0.0, 0.0, b.uniform(0, max(depth - t, 0)), depth - t))
    x -= b.choice((0.0, 0.0, 0.3 * t))
    edges = -w / 2 + w * np.r_[0, np.cumsum(share) / share.sum()]
    way = _way(b, bays, door)
    mullion = 0.0 if way == "slide" else mullion
    for k, (y0, y1) in enumerate(pairwise(edges)):
        if k and mullion:
            b.box("base", (0, y0 - mullion / 2, 0), (depth, y0 + mullion / 2, h), "trim")
        half = g + mullion / 2
        low = np.array([x, y0 + (half if k else g), g])
        high = np.array([x + t, y1 - (half if k + 1 < len(bays) else g), h - g])
        if way == "slide":
            track = np.array([(k % 2) * (t + g), 0, 0])  # neighbours pass each other
            low, high = low + track, high + track
        if bays[k] == "F":
            _stays(b, looks, low, high)
        elif way == "slide":
            _run(b, looks, low, high, 1 if k == 0 or (k + 1 < len(bays) and b.chance(0.5)) else -1)
        else:
            _hang(b, looks, low, high, _side(b, bays, k), way)


def _way(b: Builder, bays: str, door: bool) -> str:
    """How the leaves move: on upright hinges, past each other; windows also hang, tip or pivot."""
    if len(bays) > 1 and b.chance(0.3):
        return "slide"
    if door or len(bays) > 2:
        return "upright"
    return str(b.choice(("upright", "top", "bottom", "pivot"), (0.76, 0.09, 0.09, 0.06)))


def _side(b: Builder, bays: str, k: int) -> int:
    """-1: hinged where y is least. Pairs of leaves part in their middle."""
    run = k
    while run and bays[run - 1] == "L":
        run -= 1
    end = k
    while end + 1 < len(bays) and bays[end + 1] == "L":
        end += 1
    if run == end:
        return int(b.choice((-1, 1)))
    return -1 if (k - run) % 2 == 0 else 1


def _surround(
    b: Builder, size: tuple[float, float, float], more: tuple[float, float], rim: float, door: bool
) -> None:
    """The frame around z 0..h and lights above and below; a sill, a strip of wall."""
    w, h, depth = size
    above, below = more
    low = np.array([0.0, -w / 2 - rim, -below - (0 if door else rim)])
    high = np.array([depth, w / 2 + rim, h + above + rim])
    arched = above and b.chance(0.5)
    if arched:
        high[2] = h + 0.02
    kind = b.choice(("ring", "boxes", "boxes"))
    if kind == "ring" and not door:
        solids.frame(b, "base", low, high, rim, "x", "trim")
    else:
        for y in (low[1], w / 2):
            b.box("base", (0, y, low[2]), (depth, y + rim, high[2]), "trim")
        b.box("base", (0, -w / 2, high[2] - rim), (depth, w / 2, high[2]), "trim")
        if not door:
            b.box("base", (0, -w / 2, low[2]), (depth, w / 2, low[2] + rim), "trim")
        elif b.chance(0.3):
            b.box("base", (0, -w / 2, -0.02), (depth, w / 2, 0), "trim")
    bar = 0.4 * rim
    if above and not arched:
        b.box("base", (0, -w / 2, h), (depth, w / 2, h + bar), "trim")
        top = (0.6 * depth, w / 2, h + above)
        b.panel("base", (0.4 * depth, -w / 2, h + bar), top, "glass")
    if arched:
        turn = np.linspace(0, np.pi, 13)
        outer = np.stack([np.cos(turn) * (w / 2 + rim), np.sin(turn) * above], 1) + np.array([0, h])
        inner = np.stack([np.cos(turn) * w / 2, np.sin(turn) * 0.8 * above], 1) + np.array([0, h])
        solids.profile(b, "base", np.concatenate([outer, inner[::-1]]), 0, depth, "x", "trim")
        solids.profile(b, "base", inner, 0.4 * depth, 0.5 * depth, "x", "glass")
    if below:
        b.box("base", (0, -w / 2, -bar), (depth, w / 2, 0), "trim")
        high_below = (0.7 * depth, w / 2, -bar)
        b.panel("base", (0.3 * depth, -w / 2, low[2] + rim), high_below,
                b.choice(("glass", "front")))  # fmt: skip
    if not door and b.chance(0.3):
        b.box("base", (-0.08, low[1] - 0.03, low[2] - 0.02), (depth, high[1] + 0.03, low[2]))
    if b.chance(0.12):
        b.box("base", (0, high[1], low[2]), (depth, high[1] + b.uniform(0.1, 0.6) * w, high[2]))


def _stays(b: Builder, looks: Looks, low: FloatArray, high: FloatArray) -> None:
    """A bay that does not open: like a leaf without fittings, or a pane held by the frame."""
    if b.chance(0.7):
        _pieces(b, looks, "base", low, high)
    else:
        middle = (low[0] + high[0]) / 2
        half = 0.5 * looks.pane * looks.thick
        b.panel("base", (middle - half, low[1], low[2]), (middle + half, high[1], high[2]), "glass")


def _hang(b: Builder, looks: Looks, low: FloatArray, high: FloatArray, side: int, way: str) -> None:
    """One leaf with its hinges, its fitting and its joint."""
    link = b.link("leaf", "door")
    _pieces(b, looks, link, low, high)
    swing, inwards = b.uniform(1.2, 2.4), b.choice((-1, 1))
    face = low[0] if inwards < 0 else high[0]
    z, y = (low[2] + high[2]) / 2, (low[1] + high[1]) / 2
    if way == "upright":
        y = high[1] if side > 0 else low[1]
        axis = np.array([0.0, 0.0, 1.0])
    else:
        z = {"top": high[2], "bottom": low[2], "pivot": z}[way]
        axis = np.array([0.0, 1.0, 0.0])
    hinges = 0 if way == "pivot" else looks.hinges
    for n, s in enumerate(np.linspace(0.12, 0.88, hinges)):
        size = high - low
        at = np.array([face, y, z])
        at += axis * (low + s * size - at)
        reach = axis * b.uniform(0.02, 0.05) * (size @ axis)
        for half in (-1, 1) if looks.knuckle == "each" else (0,):
            owner = {"leaf": link, "frame": "base"}.get(looks.knuckle) or (link, "base")[half > 0]
            start, end = (-1, 1) if half == 0 else (min(half, 0), max(half, 0))
            r = b.uniform(0.15, 0.4) * looks.thick
            b.cylinder(owner, at + start * reach, at + end * reach, r)
        if n == 0 and b.chance(0.2):
            break
    if looks.fitting != "none" and way != "pivot" and b.chance(0.9):
        edge = {
            "upright": (0, -side, 0), "top": (0, 0, -1), "bottom": (0, 0, 1),
        }[way]  # fmt: skip
        _fitting(b, looks, link, low, high, np.array(edge, float))
    opens = (inwards, 0, 0)
    if way == "pivot":
        b.hinge(link, "base", ((low[0] + high[0]) / 2, y, z), axis, -swing / 2, swing / 2)
    else:
        b.hinge(link, "base", (face, y, z), axis, 0, swing, opens=opens)


def _run(b: Builder, looks: Looks, low: FloatArray, high: FloatArray, to: int) -> None:
    """One leaf that slides towards `to` along y; some overlap the neighbour that they pass."""
    link = b.link("leaf", "door")
    width = high[1] - low[1]
    if b.chance(0.6):
        (high if to > 0 else low)[1] += to * b.uniform(0.5, 1.0) * min(looks.rail, 0.2 * width)
    _pieces(b, looks, link, low, high)
    if b.chance(0.7):
        y = (low[1] + high[1]) / 2 - to * b.uniform(0.38, 0.47) * (high[1] - low[1])
        spot = (low[0], y, low[2] + b.uniform(0.35, 0.6) * (high[2] - low[2]))
        length = b.uniform(0.08, 0.3) * (high[2] - low[2])
        b.handle(link, spot, (-1, 0, 0), (0, 0, 1), length, b.choice((*HANDLES, "recessed")))
    b.slide(link, "base", (0, to, 0), 0, 0.9 * width)


def _pieces(b: Builder, looks: Looks, link: str, low: FloatArray, high: FloatArray) -> None:
    """A leaf: a slab, or rails around panes with bars across, some with a panel below."""
    size, t = high - low, looks.thick
    rail = min(looks.rail, 0.3 * size[1], 0.3 * size[2])
    if looks.slab:
        b.front(link, low, high, b.choice(("slab", "moulded", "double")))
        return
    if looks.one_piece:
        solids.frame(b, link, low, high, rail, "x", "front")
    else:
        b.border(link, low, high, rail)
    edge = np.array([0, rail, rail])
    inner_low, inner_high = low + edge, high - edge
    tall = inner_high[2] - inner_low[2]
    if looks.solid:
        z = inner_low[2] + looks.solid * tall
        b.box(link, (low[0], inner_low[1], z), (high[0], inner_high[1], z + 0.6 * rail), "front")
        flat = (low[0] + 0.3 * t, inner_low[1], inner_low[2])
        b.panel(link, flat, (high[0] - 0.3 * t, inner_high[1], z), "front")
        if looks.moulded:
            rest = 0.12 * (inner_high[1] - inner_low[1])
            if z - inner_low[2] > 3 * rest:
                field = (low[0] + 0.1 * t, inner_low[1] + rest, inner_low[2] + rest)
                b.box(link, field, (high[0] - 0.1 * t, inner_high[1] - rest, z - rest))
        inner_low = np.array([low[0], inner_low[1], z + 0.6 * rail])
    _glazing(b, looks, link, inner_low, inner_high)


def _glazing(b: Builder, looks: Looks, link: str, low: FloatArray, high: FloatArray) -> None:
    """Panes and the bars between them."""
    t, s = looks.thick, looks.sunk
    middle, half = (low[0] + high[0]) / 2, 0.5 * looks.pane * t
    ys = np.linspace(low[1], high[1], looks.columns + 2)
    zs = np.linspace(low[2], high[2], looks.rows + 2)
    thin = 0.25 * t + 0.003
    outer = middle + 0.5 * t * np.array([-0.8, 0.8])
    if looks.bars == "grid" and len(ys) > 2 and len(zs) > 2:
        us = [low[1], *(v for y in ys[1:-1] for v in (y - thin, y + thin)), high[1]]
        vs = [low[2], *(v for z in zs[1:-1] for v in (z - thin, z + thin)), high[2]]
        mask = (np.arange(len(us) - 1)[:, None] % 2 == 1) | (np.arange(len(vs) - 1) % 2 == 1)
        solids.plate(b, link, us, vs, mask, outer[0], outer[1], "x", "front")
    else:
        for y in ys[1:-1]:
            b.box(link, (outer[0], y - thin, low[2]), (outer[1], y + thin, high[2]), "front")
        for z in zs[1:-1]:
            b.box(link, (outer[0], low[1], z - thin), (outer[1], high[1], z + thin), "front")
    if not looks.by_cell:
        ys, zs = ys[[0, -1]], zs[[0, -1]]
    for y0, y1 in pairwise(ys):
        for z0, z1 in pairwise(zs):
            near, far = (middle - half, y0 - s, z0 - s), (middle + half, y1 + s, z1 + s)
            b.panel(link, near, far, "glass")


def _fitting(
    b: Builder, looks: Looks, link: str, low: FloatArray, high: FloatArray, edge: FloatArray
) -> None:
    """A lever, knob, pull or bolt near the free edge, on one face or both; some turn."""
    size, middle = high - low, (low + high) / 2
    spot = middle + edge * (size / 2 - b.uniform(0.02, 0.1) * size @ np.abs(edge))
    if edge[1]:
        spot[2] = low[2] + b.uniform(0.35, 0.6) * size[2]
    r = float(np.clip(b.uniform(0.01, 0.03) * max(size), 0.006, 0.03))
    along = (0, 0, 1) if edge[1] else (0, 1, 0)
    turning = looks.turns and looks.fitting in ("lever", "knob")
    owner = b.link("latch", "handle") if turning else link
    plate = b.choice(("rose", "plate", "none"))
    spindle = b.choice((0.0, 1.0))  # goes through the leaf
    for face, normal in ((low[0], -1.0), (high[0], 1.0))[: 1 + looks.both]:
        with b.facing((face, spot[1], spot[2]), (normal, 0, 0), along):
            if looks.fitting == "pull":
                b.handle(link, (0, 0, 0), (0, 0, 1), (1, 0, 0), 10 * r, b.choice(HANDLES))
                continue
            if plate == "rose":
                b.disc(link, (0, 0, 0), (0, 0, 1), 1.8 * r, 0.3 * r, "metal")
            elif plate == "plate":
                b.block(link, (-2 * r, 0, 0.15 * r), (12 * r, 3 * r, 0.3 * r), "metal")
            if looks.fitting == "bolt":
                b.block(link, (0, 0, 0.8 * r), (8 * r, 1.2 * r, r), "metal")
                b.cylinder(link, (r, 0, r), (r, 0, 4 * r), 0.5 * r, None, "metal")
                continue
            foot = -spindle * looks.thick * 0.5 + (0.3 * r if plate != "none" else 0.0)
            b.cylinder(owner, (0, 0, foot), (0, 0, 3 * r), 0.6 * r, None, "metal")
            if looks.fitting == "knob":
                b.sphere(owner, (0, 0, 3.4 * r), 1.5 * r, "metal")
            else:
                inner = b.direction((0, 1, 0)) @ -edge
                reach = b.uniform(4, 8) * r
                arm = [0.0, -reach if inner < 0 else reach, 3 * r]
                if b.chance(0.25):  # upright, as on windows
                    arm = [-reach, 0.0, 3 * r]
                b.cylinder(owner, (0, 0, 3 * r), arm, 0.6 * r, None, "metal")
            if b.chance(0.3):  # a lock of its own
                b.disc(link, (-5 * r, 0, 0), (0, 0, 1), r, 0.5 * r, "metal")
    if turning:
        b.hinge(owner, link, spot, (1, 0, 0), 0, 1.2)
