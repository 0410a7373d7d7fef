"""Doors in frames with lever handles or knobs, and windows: sash, casement and sliding."""

from __future__ import annotations

import numpy as np

from mam_world.kit import Builder

THICKEST = 0.05  # door leaf, metres


def _frame(b: Builder, width: float, high: float, depth: float, rail: float,
           sill: bool) -> None:  # fmt: skip
    """A frame of two jambs and a head around y = +-width / 2, up to z = high; a sill below."""
    b.box("base", (0, -width / 2 - rail, 0), (depth, -width / 2, high + rail), "trim")
    b.box("base", (0, width / 2, 0), (depth, width / 2 + rail, high + rail), "trim")
    b.box("base", (0, -width / 2, high), (depth, width / 2, high + rail), "trim")
    if sill:
        b.box("base", (0, -width / 2, 0), (depth, width / 2, rail), "trim")


def _swing(b: Builder, thick: float, width: float) -> float:
    """Clearance at the free edge of a leaf whose pin is in its front face: its back corner runs on
    a larger circle than its front one, and needs a little more or it catches on its way back."""
    return float(np.hypot(thick, width)) - width + 1.6e-3 * b.diagonal


def lever(b: Builder, door: str, y: float, z: float, x0: float, x1: float, inward: float) -> None:
    """A lever handle with its rose on both faces of a door (x0 front, x1 back), one spindle."""
    link = b.link("lever", "handle")
    length, r = b.uniform(0.09, 0.14), b.uniform(0.007, 0.011)
    square = b.chance(0.4)
    rose = b.choice(["disc", "plate"])
    sides = [(x0, -1.0)] + ([(x1, 1.0)] if b.chance(0.7) else [])
    for x, s in sides:
        if rose == "disc":
            b.disc(door, (x, y, z), (s, 0, 0), 0.025, 0.006, "metal", "decor")
        else:
            b.block(door, (x + 0.003 * s, y, z - 0.05), (0.006, 0.04, 0.2), "metal", "decor")
        g = max(0.2 * b.gap, 0.0005)
        out = x + s * b.uniform(0.045, 0.06)
        b.rod(link, (x + s * (0.006 + g), y, z), (out, y, z), r, None, "metal", "handle")
        tip = y + inward * length
        if square:
            b.box(link, (out - r, y - inward * r, z - r), (out + r, tip, z + r), "metal", "handle")
        else:
            b.rod(link, (out, y - inward * r, z), (out, tip, z), r, None, "metal", "handle")
        if s < 0:
            b.grasp(
                link, "handle", (out, y + 0.6 * inward * length, z), (1, 0, 0), (0, 0, 1), 2 * r
            )
    b.hinge(link, door, (x0, y, z), (1, 0, 0), 0.0, np.radians(b.choice([40, 45, 60])),
            opens=(0, 0, -1))  # fmt: skip


def _round_knob(b: Builder, door: str, y: float, z: float, x0: float) -> None:
    """A door knob on a rose, turning about the door's normal."""
    b.disc(door, (x0, y, z), (-1, 0, 0), 0.028, 0.005, "metal", "decor")
    link = b.link("knob", "knob")
    with b.facing((x0 - 0.005 - max(0.2 * b.gap, 0.0005), y, z), (-1, 0, 0)):
        s = b.uniform(0.85, 1.15)
        profile = [
            [0.012, 0],
            [0.01, 0.02],
            [0.024, 0.032],
            [0.028, 0.045],
            [0.022, 0.058],
            [0.008, 0.062],
        ]
        b.lathe(link, s * np.array(profile), "metal", "handle")
        b.spin(link, door, (0, 0, 0), (0, 0, 1), np.radians(-90), np.radians(90))
        b.grasp(link, "knob", (0, 0, 0.045 * s), (0, 0, -1), (0, 1, 0), 0.056 * s)


def _leaf(b: Builder, y0: float, y1: float, z0: float, z1: float, x: float, side: int,
          fitting: str, parent: str = "base") -> None:  # fmt: skip
    """A door leaf with its front face at x, hinged at y1 (side 1, viewer's left) or y0 (-1)."""
    door, thick = b.link("door_0", "door"), b.uniform(0.03, THICKEST)
    low, high = [x, y0, z0], [x + thick, y1, z1]
    b.front(door, low, high, b.choice(["slab", "moulded", "double", "framed", "glass"],
                                      [0.35, 0.2, 0.2, 0.15, 0.1]))  # fmt: skip
    hinge_y, free_y = (y1, y0) if side > 0 else (y0, y1)
    y, z = free_y + side * b.uniform(0.05, 0.08), b.uniform(0.42, 0.52) * z1
    if fitting == "lever":
        lever(b, door, y, z, x, x + thick, float(side))
    elif fitting == "knob":
        _round_knob(b, door, y, z, x)
    elif fitting != "none":
        b.handle(door, (x, y, z), (-1, 0, 0), (0, 0, 1), b.uniform(0.2, 0.5), fitting, "metal")  # type: ignore[arg-type]
    b.hinge(door, parent, (x, hinge_y, 0.5 * (z0 + z1)), (0, 0, 1), 0.0,
            np.radians(b.choice([90, 90, 100, 110])), opens=(-1, 0, 0))  # fmt: skip


def door_lever(b: Builder) -> None:
    """A room door in its frame with a lever handle."""
    _room_door(b, "lever")


def door_knob(b: Builder) -> None:
    """A room door in its frame with a turning knob."""
    _room_door(b, "knob")


def _room_door(b: Builder, fitting: str) -> None:
    w, h, depth = b.uniform(0.65, 1.0), b.uniform(1.9, 2.15), b.uniform(0.06, 0.12)
    b.size(w, h, depth)
    rail, g = b.uniform(0.04, 0.09), max(min(b.gap, 0.012), _swing(b, THICKEST, w))
    _frame(b, w, h, depth, rail, False)
    if b.chance(0.25):
        b.box("base", (0.3 * depth, -w / 2, 0), (depth, w / 2, 0.004), "trim")
        base = 0.004 + g
    else:
        base = 0.005
    if b.chance(0.3):
        b.box(
            "base", (0.06, -w / 2 - rail, h + rail), (depth, w / 2 + rail, h + rail + 0.25), "light"
        )
    side = b.choice([1, -1])
    _leaf(b, -w / 2 + g, w / 2 - g, base, h - g, 0.0, side, fitting)


def door_double(b: Builder) -> None:
    """Two leaves in one frame, with pulls, knobs or a lever on one of them."""
    w, h, depth = b.uniform(1.1, 1.7), b.uniform(1.9, 2.2), b.uniform(0.06, 0.12)
    b.size(w, h, depth)
    g = max(min(b.gap, 0.012), _swing(b, THICKEST, 0.48 * w))
    _frame(b, w, h, depth, b.uniform(0.04, 0.08), False)
    fitting = b.choice(["bar", "bow", "knob", "lever"])
    second = fitting if fitting != "lever" else b.choice(["none", "lever"])
    _leaf(b, -w / 2 + g, -g / 2, 0.005, h - g, 0.0, -1, fitting)
    _leaf(b, g / 2, w / 2 - g, 0.005, h - g, 0.0, 1, second)


def door_sliding(b: Builder) -> None:
    """A barn door that hangs from a rail in front of a wall with an opening."""
    w, h, t = b.uniform(0.8, 1.1), b.uniform(1.9, 2.1), 0.1
    b.size(2 * w, h)
    g = max(b.gap, 0.003)
    side = b.choice([1, -1])
    b.box("base", (0, -w / 2 - 0.12, 0), (t, -w / 2, h + 0.3), "light")
    b.box("base", (0, w / 2, 0), (t, w / 2 + 0.12, h + 0.3), "light")
    far = sorted([side * (w / 2 + 0.12), side * (1.5 * w + 0.1)])
    b.box("base", (0, far[0], 0), (t, far[1], h + 0.3), "light")
    b.box("base", (0, -w / 2, h), (t, w / 2, h + 0.3), "light")
    ends = sorted([-side * (w / 2 + 0.05), side * (1.5 * w + 0.08)])
    z, thick = h + 0.14, b.uniform(0.03, 0.045)
    x1 = -g
    b.box("base", (-0.02 - 0.008, ends[0], z), (-0.02, ends[1], z + 0.035), "metal")
    for y in np.linspace(ends[0] + 0.05, ends[1] - 0.05, 4):
        b.rod("base", (-0.02, y, z + 0.018), (0, y, z + 0.018), 0.008, None, "metal")
    door = b.link("door_0", "door")
    low, high = [x1 - 0.03 - thick, -w / 2 - 0.04, 0.01], [x1 - 0.03, w / 2 + 0.04, h + 0.05]
    b.front(door, low, high, b.choice(["slab", "framed", "double", "moulded"]))
    xr = low[0] - 0.004
    for y in (-0.3 * w, 0.3 * w):
        b.box(door, (xr - 0.004, y - 0.02, h - 0.2), (low[0], y + 0.02, z + 0.05), "metal")
        b.cylinder(door, (xr, y, z + 0.065), (-0.02, y, z + 0.065), 0.028, None, "dark")
    b.handle(door, (low[0], -side * 0.38 * w, 0.5 * h), (-1, 0, 0), (0, 0, 1), 0.3,
             b.choice(["bar", "bow"]), "metal")  # fmt: skip
    b.slide(door, "base", (0, side, 0), 0.0, 0.92 * w)


def _sash(b: Builder, link: str, low: list[float], high: list[float], rail: float) -> None:
    """A glazed frame facing -X, with glazing bars or not."""
    b.border(link, low, high, rail, "front")
    x = 0.5 * (low[0] + high[0])
    b.panel(link, (x - 0.004, low[1] + rail, low[2] + rail),
            (x + 0.004, high[1] - rail, high[2] - rail), "glass")  # fmt: skip
    if b.style.tessellation != "coarse" and high[2] - low[2] > 0.5:
        y = 0.5 * (low[1] + high[1])
        b.box(link, (low[0] + 0.002, y - 0.01, low[2] + rail),
              (x - 0.004, y + 0.01, high[2] - rail), "front")  # fmt: skip


def window_sash(b: Builder) -> None:
    """Two sashes, one above the other, sliding up and down past each other."""
    w, h = b.uniform(0.5, 1.1), b.uniform(0.8, 1.5)
    b.size(w, h)
    rail, t, g = b.uniform(0.03, 0.05), b.uniform(0.025, 0.04), max(min(b.gap, 0.008), 0.0)
    depth = 2 * t + 3 * g + 0.03
    _frame(b, w, h, depth, b.uniform(0.04, 0.07), True)
    base = b.pieces[-1].shape.vertices[:, 2].max()
    half = 0.5 * (h - base) + 0.6 * rail
    lower = b.link("sash_0", "window")
    _sash(b, lower, [0.015, -w / 2 + g, base + g], [0.015 + t, w / 2 - g, base + half], rail)
    b.handle(lower, (0.015, 0, base + g + rail / 2), (-1, 0, 0), (0, 1, 0), 0.1,
             b.choice(["none", "strip", "bow", "bar"]))  # fmt: skip
    travel = h - base - half - g
    b.slide(lower, "base", (0, 0, 1), 0.0, b.uniform(0.85, 0.99) * travel)
    x = 0.015 + t + max(g, 0.001)
    if b.chance(0.6):
        upper = b.link("sash_1", "window")
        _sash(b, upper, [x, -w / 2 + g, h - half], [x + t, w / 2 - g, h - g], rail)
        b.slide(upper, "base", (0, 0, -1), 0.0, b.uniform(0.85, 0.99) * travel)
    else:
        _sash(b, "base", [x, -w / 2, h - half], [x + t, w / 2, h], rail)


def window_casement(b: Builder) -> None:
    """One or two wings hinged at the sides, or an awning hinged above, with turning handles."""
    h = b.uniform(0.6, 1.4)
    wings = b.integer(1, 2)
    w = wings * b.uniform(0.4, 0.7)
    b.size(w, h)
    rail, t, g = b.uniform(0.035, 0.06), b.uniform(0.035, 0.05), min(b.gap, 0.008)
    _frame(b, w, h, b.uniform(0.06, 0.1), b.uniform(0.04, 0.07), True)
    g = max(g, _swing(b, t, 0.48 * w) if wings == 2 else 0.0)
    base = b.pieces[-1].shape.vertices[:, 2].max()
    awning = wings == 1 and b.chance(0.25)
    for k in range(wings):
        y0 = -w / 2 + k * w / wings + (g if k == 0 else g / 2)
        y1 = -w / 2 + (k + 1) * w / wings - (g if k == wings - 1 else g / 2)
        wing = b.link(f"wing_{k}", "window")
        low, high = [0.0, y0, base + g], [t, y1, h - g]
        _sash(b, wing, low, high, rail)
        side = b.choice([1, -1]) if wings == 1 else (-1 if k == 0 else 1)
        middle = 0.5 * (low[2] + high[2])
        if awning:
            b.handle(wing, (0, 0.5 * (y0 + y1), low[2] + rail / 2), (-1, 0, 0), (0, 1, 0), 0.12,
                     b.choice(["bar", "bow", "none"]))  # fmt: skip
            b.hinge(wing, "base", (0, 0, high[2]), (0, 1, 0), 0.0,
                    np.radians(b.choice([30, 45, 60])), opens=(-1, 0, 0))  # fmt: skip
            continue
        y = (y0 if side > 0 else y1) + side * rail / 2
        if b.chance(0.6):
            _espagnolette(b, wing, y, middle, side)
        b.hinge(wing, "base", (0, y1 if side > 0 else y0, middle), (0, 0, 1), 0.0,
                np.radians(b.choice([80, 90, 100])), opens=(-1, 0, 0))  # fmt: skip


def _espagnolette(b: Builder, wing: str, y: float, z: float, side: int) -> None:
    """A window handle that hangs down when closed and turns by a quarter towards `side`."""
    b.block(wing, (-0.004, y, z), (0.008, 0.028, 0.06), "metal", "decor")
    handle = b.link("handle", "handle")
    g = max(0.2 * b.gap, 0.0005)
    b.rod(handle, (-0.008 - g, y, z), (-0.04, y, z), 0.009, None, "metal", "handle")
    b.block(handle, (-0.047, y, z - 0.05), (0.014, 0.018, 0.13), "metal", "handle")
    b.grasp(handle, "handle", (-0.047, y, z - 0.08), (1, 0, 0), (0, 1, 0), 0.018)
    b.hinge(handle, wing, (0, y, z), (1, 0, 0), 0.0, np.pi / 2, opens=(0, side, 0),
            tip=(0, y, z - 0.1))  # fmt: skip


def window_sliding(b: Builder) -> None:
    """Two or three panes on two tracks, sliding sideways."""
    count = b.integer(2, 3)
    w, h = b.uniform(0.9, 2.0), b.uniform(0.6, 1.4)
    b.size(w, h)
    rail, t, g = b.uniform(0.03, 0.05), b.uniform(0.02, 0.035), min(b.gap, 0.008)
    _frame(b, w, h, 2 * t + 3 * g + 0.03, b.uniform(0.04, 0.07), True)
    base = b.pieces[-1].shape.vertices[:, 2].max()
    each = (w - 2 * g + (count - 1) * rail) / count
    fixed = b.chance(0.3)
    for k in range(count):
        track = k % 2
        x = 0.012 + track * (t + max(g, 0.001))
        y = -w / 2 + g + k * (each - rail)
        link = "base" if fixed and track == 1 else b.link(f"pane_{k}", "window")
        low, high = [x, y, base + g], [x + t, y + each, h - g]
        _sash(b, link, low, high, rail)
        if link == "base":
            continue
        way = 1 if k < count - 1 else -1
        if track == 0:
            b.handle(link,
                     (x, y + (rail / 2 if way > 0 else each - rail / 2), base + 0.5 * (h - base)),
                     (-1, 0, 0), (0, 0, 1), 0.12, b.choice(["none", "strip", "bar"]))  # fmt: skip
        # of three panes the outer two share a track: they stop where they would meet
        room = each - rail * (1 if count == 2 else 2) - g
        b.slide(link, "base", (0, way, 0), 0.0, b.uniform(0.8, 0.98) * room,
                ajar=count == 2)  # fmt: skip


CATEGORIES = {
    "door_lever": door_lever,
    "door_knob": door_knob,
    "door_double": door_double,
    "door_sliding": door_sliding,
    "window_sash": window_sash,
    "window_casement": window_casement,
    "window_sliding": window_sliding,
}
