"""Abstract objects for training whose shapes tell how they move, as things of use do.

The other abstract kinds draw shape and motion apart, so that neither is learned by heart. Here they
go together as makers draw them: a knob stands out as far as it is wide and a button hardly does, a
slider has its track, a lid is gripped where it is not hinged, a beam on a post tips about its pin.
"""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import numpy as np

from mam_pipeline.types import FloatArray
from mam_training.curricula.cases import FRONTS, HANDLES
from mam_training.curricula.mechanisms import Vector, decoys
from mam_world import mech
from mam_world.kit import Builder
from mam_world.solids import profile

GRIPS = tuple(kind for kind in HANDLES if kind != "double")  # those are two, far apart
STILL = 0.06  # of the groups of controls do not move
NAMES = {"knob": "knob", "button": "button", "fader": "slider"}  # of links; the others: switch


def _log(b: Builder, low: float, high: float) -> float:
    """Drawn evenly in ratio."""
    return float(np.exp(b.uniform(np.log(low), np.log(high))))


def _knob(b: Builder, link: str, s: float, foot: float, style: str, tall: float) -> None:
    """A knob of radius `s`, `tall` high, on local z = foot."""
    if style == "dial":
        mech.dial(b, link, (0, 0, foot), (0, 0, 1), s, tall)
    elif style == "bar":
        thick = b.uniform(0.2, 0.4) * s
        if b.chance(0.5):
            b.cylinder(link, (0, 0, foot), (0, 0, foot + 0.3 * tall), b.uniform(0.6, 1.1) * s)
        b.box(link, (-thick, -s, foot), (thick, b.uniform(0.7, 1.2) * s, foot + tall))
    elif style == "ball":
        b.cylinder(link, (0, 0, foot), (0, 0, foot + 0.5 * tall), 0.4 * s)
        b.sphere(link, (0, 0, foot + 0.5 * tall + 0.6 * s), 0.9 * s)
    else:
        b.cylinder(link, (0, 0, foot), (0, 0, foot + tall), s, s * b.choice((1.0, 1.0, 0.85, 0.7)))
        if style == "ring":
            b.cylinder(link, (0, 0, foot), (0, 0, foot + 0.15 * tall), 1.3 * s)
        if b.chance(0.5):
            h = foot + tall
            b.box(link, (-0.1 * s, 0.1 * s, h), (0.1 * s, 0.9 * s, h + b.uniform(0.03, 0.2) * s))


def _button(b: Builder, link: str, s: float, foot: float, style: str, tall: float) -> None:
    """A button of half width `s`, `tall` high, on local z = foot."""
    if style == "round":
        b.cylinder(link, (0, 0, foot), (0, 0, foot + tall), s, s * b.choice((1.0, 1.0, 0.9)))
    elif style == "mushroom":
        b.cylinder(link, (0, 0, foot), (0, 0, foot + 0.5 * s), 0.6 * s)
        b.cylinder(link, (0, 0, foot + 0.5 * s), (0, 0, foot + 0.5 * s + 0.6 * tall), s, 0.7 * s)
    else:
        wide = s if style == "square" else s * b.uniform(1.2, 3.0)
        b.box(link, (-s, -wide, foot), (s, wide, foot + tall))


def _fader(
    b: Builder, link: str, host: str, s: float, tall: float, reach: FloatArray, gap: float
) -> None:
    """A slider of half width `s` in its track, which reaches as far both ways as `reach` (3,)."""
    long = float(np.linalg.norm(reach))
    way = reach / long
    side = np.abs(np.cross((0, 0, 1), way))
    half, grip = reach + 0.12 * s * side, 0.35 * s * way + 0.7 * s * side
    b.box(host, (*-half[:2], 0), (*half[:2], 0.04 * s), "dark", "decor")
    rest = b.uniform(-0.6, 0.6) * long
    low, high = rest * way - grip, rest * way + grip
    b.box(link, (*low[:2], 0.04 * s + gap), (*high[:2], tall))
    if link != host:
        b.slide(link, host, way, -0.8 * long - rest, 0.8 * long - rest)


def _control(
    b: Builder, host: str, link: str, kind: str, s: float, tall: float, foot: float, looks: str
) -> None:
    """One control at the frame's origin, local z outwards; it stays where link is host."""
    moves = link != host
    if kind == "knob":
        with b.moved((0, 0, 0), (0, 0, 1), b.choice((0.0, 0.0, b.uniform(-2.5, 2.5)))):
            _knob(b, link, s, foot, looks, tall)
        if moves:
            b.spin(link, host, (0, 0, 0), (0, 0, 1), 0.0, b.uniform(1.5, 6.0))
    elif kind == "button":
        _button(b, link, s, foot, looks, tall)
        if moves:
            b.slide(link, host, (0, 0, -1), 0.0, min(0.5 * tall, 0.3 * s), ajar=False)
    elif kind == "rocker":
        tip = b.choice((0.15, -0.15, 0.0))
        with b.moved((0, 0, 0), (0, 1, 0), tip):
            b.box(link, (-s, -0.6 * s, foot), (s, 0.6 * s, foot + tall))
        if moves:
            b.hinge(link, host, (0, 0, foot), (0, 1, 0), -0.2 - tip, 0.2 - tip)
    else:
        lean, pivot = b.choice((0.35, -0.35)), 0.2 * s + max(b.gap, 2e-4)
        b.cylinder(host, (0, 0, 0), (0, 0, 0.2 * s), 0.5 * s)
        with b.moved((0, 0, pivot), (0, 1, 0), lean):
            b.cylinder(link, (0, 0, 0), (0, 0, tall), 0.2 * s, 0.28 * s)
        if moves:
            b.hinge(link, host, (0, 0, pivot), (0, 1, 0), -0.35 - lean, 0.35 - lean)


def controls(b: Builder, host: str, low: FloatArray, high: FloatArray) -> None:
    """A group of controls on the local plane z = 0 between two (2,) corners."""
    span = high - low
    long = int(np.argmax(span))
    kind = b.choice(("knob", "knob", "button", "button", "rocker", "toggle", "fader"))
    rows = b.choice((1, 1, 1, 2)) if kind in ("button", "toggle") else 1
    most = int(np.clip(span[long] / max(span[1 - long] / rows, 1e-6), 1, 8))
    columns = b.integer(1, most)
    pitch = min(span[long] / columns, span[1 - long] / rows)
    s = pitch * b.uniform(0.15, 0.4)
    looks = b.choice(("plain", "plain", "dial", "bar", "ring", "ball") if kind == "knob"
                     else ("round", "round", "square", "wide", "wide", "mushroom"))  # fmt: skip
    shares = {"knob": (0.5, 2.4), "button": (0.08, 0.8), "rocker": (0.15, 0.6),
              "toggle": (0.8, 2.0), "fader": (0.6, 1.6)}  # fmt: skip
    tall, gap = s * _log(b, *shares[kind]), max(b.gap, 2e-4)
    sunk, moves, bezel = b.choice((-1.0, -1.0, 0.0, 0.3)), not b.chance(STILL), b.chance(0.3)
    foot = gap if sunk < 0 else -sunk * min(tall, s)
    across = span[1 - long] > 3 * s * rows  # a track across the row, or along it
    reach = np.zeros(3)
    reach[1 - long if across else long] = 0.42 * (span[1 - long] / rows if across else pitch)
    name = NAMES.get(kind, "switch")
    for i in range(columns):
        for j in range(rows):
            at = np.zeros(3)
            at[long] = low[long] + span[long] * (i + 0.5) / columns
            at[1 - long] = low[1 - long] + span[1 - long] * (j + 0.5) / rows
            link = b.link(name, name) if moves else host
            with b.moved(at):
                if kind == "fader":
                    _fader(b, link, host, s, tall, reach, gap)
                else:
                    _control(b, host, link, kind, s, tall, foot, looks)
                if bezel and (kind == "knob" or (kind == "button" and looks == "round")):
                    rim = 0.08 * s if kind == "knob" else 0.6 * tall
                    b.tube(host, (0, 0, 0), (0, 0, rim), 1.5 * s, 1.35 * s, "trim", "decor")


def _closure(b: Builder, low: FloatArray, high: FloatArray, depth: float) -> None:
    """A door or a drawer before the hollow behind a box (3,) corners, or nothing."""
    way = b.choice(("down", "down", "side", "drawer", "none"))
    if way == "none":
        return
    name = "drawer" if way == "drawer" else "door"
    link, middle, size = b.link(name, name), (low + high) / 2, high - low
    b.front(link, low, high, b.choice(FRONTS))
    side = b.choice((-1, 1)) if way == "side" else 0
    at = np.array([low[0], middle[1] - side * 0.42 * size[1], middle[2]])
    if way == "down":
        at[2] = high[2] - 0.1 * size[2]
    length = {"side": 0.5 * size[2], "drawer": 0.4 * size[1], "down": 0.7 * size[1]}[way]
    b.handle(link, at, (-1, 0, 0), (0, 0, 1) if side else (0, 1, 0), length, b.choice(GRIPS))
    if way == "drawer":
        b.slide(link, "base", (-1, 0, 0), 0.0, depth)
    elif side:
        edge = middle[1] + side * size[1] / 2
        b.hinge(link, "base", (high[0], edge, 0), (0, 0, side), 0.0, 1.8)
    else:
        b.hinge(link, "base", (high[0], 0, low[2]), (0, 1, 0), -1.5, 0.0)


def fascia(b: Builder) -> None:
    """A body with one to three groups of controls on its front, its side strip, its top or a slope,
    and often a door or a drawer below or beside them."""
    d, w, h = b.uniform(0.15, 0.7), b.uniform(0.2, 0.8), b.uniform(0.1, 1.0)
    b.size(d, w, h)
    b.theme()
    t, g = 0.02 * min(d, w, h) + 0.004, max(b.gap, 5e-4)
    where = b.choice(("top", "top", "side", "all", "lid", "slope"))
    low, high = np.array([t, -w / 2 + t]), np.array([h - t, w / 2 - t])  # height, then width
    frame: Any = b.facing((0, 0, 0), (-1, 0, 0), (0, 0, 1))
    if where == "slope":
        brow, run = b.uniform(0.3, 0.7) * h, b.uniform(0.3, 1.0) * d
        profile(b, "base", [(0, 0), (d, 0), (d, h), (run, h), (0, brow)], -w / 2, w / 2, "y")
        rise = np.array([run, 0, h - brow])
        frame = b.facing((run / 2, 0, (h + brow) / 2), (-rise[2], 0, run), rise)
        high = np.array([0.4 * np.linalg.norm(rise), 0.45 * w])
        low = -high
    elif where == "lid":
        b.box("base", (0, -w / 2, 0), (d, w / 2, h))
        frame = b.facing((d / 2, 0, h), (0, 0, 1), (1, 0, 0))
        high = 0.42 * np.array([d, w])
        low = -high
    elif where == "all" or b.chance(0.2):
        b.box("base", (0, -w / 2, 0), (d, w / 2, h))
    else:
        y1, z1 = w / 2, h
        if where == "top":
            low[0] = z1 = h * (1 - b.uniform(0.12, 0.35))
            b.box("base", (0, -w / 2, z1), (d, w / 2, h))
        else:
            low[1] = y1 = w * (0.5 - b.uniform(0.12, 0.35))
            b.box("base", (0, y1, 0), (d, w / 2, h))
        b.shell("base", (0, -w / 2, 0), (d, y1, z1), t, "-x")
        _closure(b, np.array([-t - g, -w / 2 + g, g]), np.array([-g, y1 - g, z1 - g]), 0.6 * d)
    with frame:
        turned = np.sort(b.direction((0, 1, 0))[1] * np.array([low[1], high[1]]))
        low, high = np.array([low[0], turned[0]]), np.array([high[0], turned[1]])
        long = int(np.argmax(high - low))
        for start, end in pairwise(np.sort(np.r_[0, b.rng.uniform(0.2, 0.8, b.integer(0, 2)), 1])):
            if end - start < 0.12:
                continue
            lo, hi = low.copy(), high.copy()
            lo[long], hi[long] = low[long] + np.array([start, end]) * (high - low)[long]
            if b.chance(0.2):
                b.box("base", (*(0.8 * lo + 0.2 * hi), 0), (*(0.2 * lo + 0.8 * hi), 0.002),
                      "screen", "decor")  # fmt: skip
            else:
                controls(b, "base", lo, hi)


def _chest(b: Builder, size: Vector, low: float, t: float) -> None:
    """A box without a lid; its front reaches up to `low`, its back to its height."""
    d, w, h = size
    solid = b.chance(0.2)
    if low >= h and solid:
        b.box("base", (0, -w / 2, 0), (d, w / 2, h))
    elif low >= h:
        b.shell("base", (0, -w / 2, 0), (d, w / 2, h), t, "+z")
    else:
        side = [(0, 0), (d, 0), (d, h), (0, low)]
        for y in (-w / 2,) if solid else (-w / 2, w / 2 - t):
            profile(b, "base", side, y, w / 2 if solid else y + t, "y")
        b.box("base", (0, -w / 2, 0), (d, w / 2, t))
        b.box("base", (0, -w / 2, 0), (t, w / 2, low))
        b.box("base", (d - t, -w / 2, 0), (d, w / 2, h))


def _lid(
    b: Builder, low: FloatArray, high: FloatArray, t: float, style: str, cue: str, barrels: bool
) -> str:
    """A lid between two (3,) corners, hinged about y at its high x; returns its link."""
    lid = b.link("lid", "lid")
    run, wide, thick = high - low
    over = high[0]
    if style == "shell":
        b.shell(lid, low, high, t, "-z")
    elif style == "round":
        turn = np.linspace(0, np.pi, 10)
        ring = np.c_[(low[0] + over) / 2 + run / 2 * np.cos(turn), thick * np.sin(turn)]
        profile(b, lid, ring, low[1], high[1], "y")
    else:
        b.box(lid, low, high)
    if barrels:
        r = 0.4 * t
        for y in (-0.35 * wide, 0.3 * wide):
            ends = (over + r, y, 0), (over + r, y + 0.08 * wide, 0)
            b.cylinder(b.choice((lid, "base")), *ends, r)
    b.hinge(lid, "base", (over if barrels else 0, 0, 0), (0, 1, 0), 0.0, b.uniform(1.2, 2.0))
    front, rise = low[0], thick if style == "flat" else 0.3 * thick
    if cue == "handle":
        if b.chance(0.5) and style != "round":
            b.handle(lid, (front + 0.15 * run, 0, thick), (0, 0, 1), (0, 1, 0), 0.3 * wide,
                     b.choice(GRIPS))  # fmt: skip
        elif rise > 0.015:
            b.handle(lid, (front, 0, 0.5 * rise), (-1, 0, 0), (0, 1, 0), 0.3 * wide,
                     b.choice(GRIPS))  # fmt: skip
        else:
            b.box(lid, (front - 2 * t, -0.15 * wide, 0), (front, 0.15 * wide, rise))
    elif cue == "lip":
        reach = b.uniform(0.5, 3) * t
        b.box(lid, (front - reach, -0.4 * wide, 0), (front, 0.4 * wide, 0.5 * rise))
    return lid


def _catches(b: Builder, lid: str, x: float, seam: float, size: Vector, still: bool) -> None:
    """Flaps over the seam of a lid at the front x, on the lid or the body; a lock stays."""
    _, w, h = size
    moves = not still and b.chance(0.8)
    spots = (0.0,) if still or b.chance(0.4) else (-0.3 * w, 0.3 * w)
    wide, tall = b.uniform(0.03, 0.08) * w, b.uniform(0.08, 0.2) * h
    top, plate = seam + b.uniform(0.2, 0.6) * tall, b.uniform(0.05, 0.2) * tall
    hangs = b.chance(0.6)
    host = lid if hangs else "base"
    for y in spots:
        link = b.link("latch", "lever") if moves else host
        b.box(link, (x - plate, y - wide, top - tall), (x, y + wide, top))
        if b.chance(0.5):
            b.box(link, (x - 2 * plate, y - 0.7 * wide, top - 0.9 * tall),
                  (x - plate, y + 0.7 * wide, top - 0.5 * tall))  # fmt: skip
        if moves:
            limits = (0.0, 1.6) if hangs else (-1.6, 0.0)
            b.hinge(link, host, (x, y, top if hangs else top - tall), (0, 1, 0), *limits)


def _bail(b: Builder, lid: str, middle: float, z: float, span: float, tall: float) -> None:
    """A bow over the lid that stands or lies and swings about the line of its feet."""
    bow, lies = b.link("handle", "handle"), b.chance(0.5)
    dx, dz = (tall, 0.0) if lies else (0.0, tall)
    path = [(middle, -span, z), (middle - dx, -span, z + dz), (middle - dx, span, z + dz),
            (middle, span, z)]  # fmt: skip
    b.sweep(bow, path, 0.05 * span)
    b.hinge(bow, lid, (middle, 0, z), (0, 1, 0), 0.0 if lies else -1.4, 1.4)


def lidded(b: Builder) -> None:
    """A box, bin or chest with a lid: its grip, latches, lock or pedal are where it is not hinged,
    and a sloping lid is hinged at its upper edge."""
    d, w, h = size = b.uniform(0.15, 0.6), b.uniform(0.15, 0.9), b.uniform(0.1, 0.8)
    b.size(*size)
    b.theme()
    t, g = b.uniform(0.02, 0.05) * min(size) + 0.003, max(b.gap, 5e-4)
    low = max(h - b.uniform(0.15, 0.7) * d, 0.3 * h) if b.chance(0.3) else h
    slopes = low < h
    _chest(b, size, low, t)
    over = b.choice((0.0, 0.0, 0.3, 1.0)) * t
    thick = t * b.uniform(0.6, 2.0) if slopes else b.choice((t, t, b.uniform(0.1, 0.5) * h))
    style = b.choice(("flat", "shell", "round")) if not slopes and thick > 1.01 * t else "flat"
    cue = b.choice(("handle", "handle", "latches", "lock", "pedal", "lip", "none"))
    near = np.array([-np.hypot(d, h - low) - over, -w / 2 - over, 0])
    far = np.array([over, w / 2 + over, thick])
    with b.moved((d, 0, h + g), (0, 1, 0), -float(np.arctan2(h - low, d))):
        lid = _lid(b, near, far, t, style, cue, b.chance(0.4))
    if cue in ("latches", "lock"):
        _catches(b, lid, -g if slopes else -over - g, low, size, cue == "lock")
    elif cue == "pedal":
        link = b.link("pedal", "lever") if b.chance(0.7) else "base"
        reach, z = b.uniform(0.1, 0.25) * d, b.uniform(0.02, 0.08) * h
        b.box(link, (-reach - g, -0.15 * w, z), (-g, 0.15 * w, z + t))
        if link != "base":
            b.hinge(link, "base", (0, 0, z + t), (0, 1, 0), -0.3, 0.0)
    if b.chance(0.25) and style == "flat" and not slopes:
        span = 0.3 * w
        _bail(b, lid, d * b.uniform(0.4, 0.6), h + 2 * g + thick + 0.05 * span, span,
              b.uniform(0.1, 0.3) * d)  # fmt: skip
    decoys(b, np.array([0, -w / 2, 0]), np.array([d, w / 2, low]), b.integer(0, 2), (-1, 0, 0))


def _stand(b: Builder, kind: str, foot: float, tall: float, thick: float, length: float) -> None:
    """What a beam stands on: a block, a post, two posts or a plate."""
    if kind == "block":
        b.box("base", (-foot / 2, -foot / 2, 0), (foot / 2, foot / 2, tall))
    elif kind == "post":
        b.cylinder("base", (0, 0, 0), (0, 0, tall), b.uniform(0.6, 1.5) * thick)
        b.box("base", (-foot, -foot, 0), (foot, foot, 0.05 * tall))
    elif kind == "posts":
        for x in (-foot - thick, foot + thick):
            b.box("base", (x - 0.5 * thick, -thick, 0), (x + 0.5 * thick, thick, tall))
        wide = foot + 2 * thick
        b.box("base", (-wide, -2 * thick, 0), (wide, 2 * thick, 0.05 * tall))
    else:
        b.box("base", (-foot, -0.6 * length, 0), (foot, 0.6 * length, tall))


def beam(b: Builder) -> None:
    """A bar on a post, a block or between cheeks: it tips about a level pin across it; on a
    turntable it turns."""
    tall, foot = b.uniform(0.15, 1.5), b.uniform(0.05, 0.4)
    length, thick = _log(b, 0.2, 2.5), b.uniform(0.02, 0.1)
    b.size(foot, length, tall)
    b.theme()
    g = max(b.gap, 5e-4)
    stand = b.choice(("block", "post", "posts", "plate"))
    tall = 0.3 * foot if stand == "plate" else tall
    _stand(b, stand, foot, tall, thick, length)
    host, top = "base", tall
    if b.chance(0.2):
        host = b.link("turntable", "part")
        top = tall + g + 0.3 * thick
        b.cylinder(host, (0, 0, tall + g), (0, 0, top), b.uniform(0.3, 0.6) * foot + thick)
        b.spin(host, "base", (0, 0, 0), (0, 0, 1), -3.0, 3.0)
    single = stand != "posts" and host == "base"
    turns = single and b.chance(0.12)
    cheeks = stand != "posts" and not turns and b.chance(0.5)
    beside = single and stand != "plate" and not turns and not cheeks and b.chance(0.3)
    x, z = 0.0, top + (thick if cheeks else g + thick / 2)
    if stand == "posts":
        z = tall - b.uniform(0.5, 1.5) * thick
    elif beside:
        x = (foot / 2 if stand == "block" else 1.5 * thick) + thick / 2 + g
        z = tall - thick
    for s in (-1, 1) if cheeks else ():
        near, far = np.sort(s * (thick / 2 + g + np.array([0, 0.3 * thick])))
        b.box(host, (near, -thick, top), (far, thick, z + 0.7 * thick))
    tilt = 0.0 if turns or b.chance(0.75) else b.uniform(-0.5, 1.0)
    start = -b.choice((b.uniform(0.02, 0.15), b.uniform(0.15, 0.5))) * length
    link = b.link("beam", "lever")
    with b.moved((x, 0, z), (1, 0, 0), tilt):
        wide = thick / 2 if cheeks else thick * b.choice((1.0, 1.0, 3.0)) / 2
        if b.chance(0.6):
            b.box(link, (-wide, start, -thick / 2), (wide, start + length, thick / 2))
        else:
            b.cylinder(link, (0, start, 0), (0, start + length, 0), thick / 2)
        for end in (start, start + length):
            size, weight = b.uniform(0.8, 2.5) * thick, b.choice(("ball", "block", "", "", "", ""))
            if weight == "ball":
                b.sphere(link, (0, end, 0), size)
            elif weight == "block":
                b.box(link, (-size, end - size, -size / 2), (size, end + size, size / 2))
        if not turns and (stand == "posts" or b.chance(0.7)):
            reach = (foot if stand == "posts" else b.uniform(0.6, 1.5) * thick) + 1.2 * thick
            pin = b.choice((link, link, host))
            b.cylinder(pin, (-reach, 0, 0), (reach, 0, 0), b.uniform(0.2, 0.4) * thick)
        if b.chance(0.3):
            _bucket(b, link, (0.0, start + length, 0.0), thick)
    if turns:
        b.cylinder("base", (0, 0, tall), (0, 0, tall + 2 * thick), 0.3 * thick)
        b.spin(link, host, (0, 0, 0), (0, 0, 1), -3.0, 3.0)
    else:
        b.hinge(link, host, (x, 0, z), (1, 0, 0), -0.5 - max(tilt, 0), 1.2 - max(tilt, 0))


def _bucket(b: Builder, arm: str, tip: Vector, thick: float) -> None:
    """What hangs at an arm's tip and swings about a pin across it."""
    bucket, s, far = b.link("bucket", "part"), b.uniform(1.0, 2.5) * thick, tip[1] + thick
    b.box(bucket, (-s, far, -2 * s), (s, far + s, 0.5 * thick))
    b.cylinder(bucket, (-s, tip[1], 0), (s, tip[1], 0), 0.3 * thick)
    b.box(bucket, (0.9 * s, tip[1] - 0.2 * thick, -0.2 * thick), (s, far + s, 0.2 * thick))
    b.hinge(bucket, arm, tip, (1, 0, 0), -0.8, 0.8)
