"""Abstract mechanisms for training: random bodies with random movers, wider than any category.

The world's categories look like known things; what the reasoner meets looks like anything. These
objects draw base, mover, fixing and decoys on their own, with honest decoys and overlaps. They
train the reasoner only: they are no assets, and nothing promises that they can be driven.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from mam_pipeline.types import FloatArray
from mam_world import mech, solids
from mam_world.kit import Builder

Vector = tuple[float, float, float]


def clump(b: Builder, link: str, low: FloatArray, high: FloatArray, rich: int = 3) -> None:
    """One to `rich` shapes that together fill a box."""
    low, high = np.asarray(low, float), np.asarray(high, float)
    size, middle = high - low, (low + high) / 2
    kind = b.choice(("box", "box", "box", "cylinder", "steps", "pair", "rounded"))
    if rich < 2 and kind in ("steps", "pair"):
        kind = "box"
    if kind == "cylinder":
        axis = int(np.argmin(np.abs(np.sort(size)[[0, 0, 1]] - np.sort(size)[[1, 2, 2]])))
        axis = b.choice((int(np.argmax(size)), 2, axis))
        a, z = middle.copy(), middle.copy()
        a[axis], z[axis] = low[axis], high[axis]
        r = np.delete(size, axis).min() / 2
        b.cylinder(link, a, z, r, r * b.choice((1.0, 1.0, 0.8)))
    elif kind == "steps":
        cuts = np.sort(np.r_[0, b.rng.uniform(0.15, 0.85, b.integer(1, max(rich - 1, 1))), 1])
        axis = b.integer(0, 2)
        for k, (s, e) in enumerate(pairwise(cuts)):
            lo, hi = low.copy(), high.copy()
            lo[axis], hi[axis] = low[axis] + s * size[axis], low[axis] + e * size[axis]
            shrink = b.uniform(0, 0.25) * (k % 2)
            for other in {0, 1, 2} - {axis}:
                lo[other] += shrink * size[other] / 2
                hi[other] -= shrink * size[other] / 2
            b.box(link, lo, hi)
    elif kind == "pair":
        axis = b.integer(0, 2)
        at = low[axis] + b.uniform(0.3, 0.7) * size[axis]
        first, second = high.copy(), low.copy()
        first[axis], second[axis] = at + b.choice((0.0, 0.05)) * size[axis], at
        b.box(link, low, first)
        inner = 0.1 * size * (np.arange(3) != axis)
        b.box(link, second + inner, high - inner)
    elif kind == "rounded":
        solids.rounded(b, link, low, high, b.uniform(0.1, 0.4) * size[:2].min())
    else:
        b.box(link, low, high)


def base_body(b: Builder) -> tuple[FloatArray, FloatArray]:
    """A random base; returns the box (low, high) whose top and front are free to mount on."""
    kind = b.choice(("slab", "block", "wall", "post", "pedestal", "frame"))
    w, d, h = b.uniform(0.1, 0.5), b.uniform(0.1, 0.5), b.uniform(0.05, 0.5)
    if kind == "slab":
        h = b.uniform(0.01, 0.06)
    if kind == "wall":
        d, w, h = b.uniform(0.01, 0.06), b.uniform(0.15, 0.6), b.uniform(0.15, 0.6)
    if kind == "post":
        w, d, h = b.uniform(0.04, 0.12), b.uniform(0.04, 0.12), b.uniform(0.2, 0.6)
    b.size(w, d, h)
    b.theme()
    low, high = np.array([0.0, -w / 2, 0.0]), np.array([d, w / 2, h])
    if kind == "frame":
        t = 0.12 * min(w, d)
        for y in (low[1], high[1] - t):
            b.box("base", (0, y, 0), (d, y + t, 0.8 * h))
        b.box("base", (0, low[1], 0.8 * h), high)
    elif kind in ("post", "pedestal"):
        foot = 0.12 * h
        grow = b.uniform(0.5, 1.5) * np.array([d, w, 0]) / 2
        if b.chance(0.5):
            b.box("base", low - grow, (high[0] + grow[0], high[1] + grow[1], foot))
        else:
            b.disc("base", (d / 2, 0, 0), (0, 0, 1), max(w, d) * 0.8, foot)
        clump(b, "base", low + np.array([0, 0, foot]), high, 2)
    else:
        clump(b, "base", low, high, b.integer(1, 4))
        b.box("base", low + 0.02 * (high - low), high) if b.chance(0.5) else None
    return low, high


def decoys(b: Builder, low: FloatArray, high: FloatArray, number: int, skip: Vector) -> None:
    """Fixed things that look as if they moved: knobs, bars, bosses, plates, studs, feet."""
    size = high - low
    for _ in range(number):
        axis, side = b.integer(0, 2), b.choice((-1, 1))
        normal = np.zeros(3)
        normal[axis] = side
        if (np.dot(normal, skip) > 0.5 and b.chance(0.7)) or normal[2] < 0:
            continue
        spot = low + size * b.rng.uniform(0.1, 0.9, 3)
        spot[axis] = high[axis] if side > 0 else low[axis]
        s = b.uniform(0.04, 0.2) * float(np.delete(size, axis).min())
        along = (0, 0, 1) if axis != 2 else (1, 0, 0)
        kind = b.choice(("boss", "plate", "stud", "bar", "dial", "box"))
        with b.facing(spot, normal, along):
            if kind == "boss":
                b.disc("base", (0, 0, -0.2 * s), (0, 0, 1), s, b.uniform(0.3, 2) * s)
            elif kind == "plate":
                b.block("base", (0, 0, 0), (b.uniform(1, 6) * s, b.uniform(1, 4) * s, 0.3 * s))
            elif kind == "stud":
                for x in (-1.5 * s, 1.5 * s):
                    b.disc("base", (x, 0, -0.1 * s), (0, 0, 1), 0.35 * s, 0.4 * s)
            elif kind == "bar":
                b.handle("base", (0, 0, 0), (0, 0, 1), (1, 0, 0), 4 * s)
            elif kind == "dial":
                mech.dial(b, "base", (0, 0, 0), (0, 0, 1), s, s)
            else:
                b.block("base", (0, 0, 0.4 * s), (2 * s, b.uniform(0.5, 3) * s, s))


def _mount(
    b: Builder, low: FloatArray, high: FloatArray
) -> tuple[FloatArray, Vector, Vector, float]:
    """A spot on the top, front or side: point, normal, in-plane direction, room around it."""
    face = b.choice(("top", "front", "side"), (0.45, 0.4, 0.15))
    middle, size = (low + high) / 2, high - low
    spread = b.rng.uniform(-0.25, 0.25, 3) * size * b.choice((0, 1))
    spot = middle + spread
    if face == "top":
        spot[2] = high[2]
        return spot, (0, 0, 1), b.choice(((1, 0, 0), (0, 1, 0))), float(min(size[:2]))
    if face == "front":
        spot[0] = low[0]
        return spot, (-1, 0, 0), b.choice(((0, 0, 1), (0, 1, 0))), float(min(size[1:]))
    spot[1] = high[1]
    return spot, (0, 1, 0), b.choice(((0, 0, 1), (1, 0, 0))), float(min(size[0], size[2]))


def _sink(b: Builder, s: float) -> float:
    """How deep a mover's foot starts in the base: a gap, touching, or well inside."""
    return float(b.choice((-max(b.gap, 5e-4), 0.0, b.uniform(0.05, 0.8) * s)))


def push(b: Builder, link: str, s: float) -> None:
    """A thing that is pressed along local z: cap, stem and cap, plunger."""
    foot, tall = -_sink(b, s), b.uniform(0.3, 2.5) * s
    if b.chance(0.5):
        b.cylinder(link, (0, 0, foot), (0, 0, tall), s, s * b.choice((1.0, 0.9, 0.6)))
    else:
        b.box(link, (-s, -b.uniform(0.5, 1.5) * s, foot), (s, b.uniform(0.5, 1.5) * s, tall))
    if b.chance(0.4):
        b.disc(link, (0, 0, tall), (0, 0, 1), b.uniform(0.6, 2.0) * s, 0.5 * s)
    if b.chance(0.4):
        b.tube("base", (0, 0, -0.1 * s), (0, 0, b.uniform(0.1, 0.5) * tall), 1.9 * s, 1.6 * s)
    b.slide(link, "base", (0, 0, -1), 0.0, 0.4 * tall, ajar=False)


def turn(b: Builder, link: str, s: float) -> None:
    """A thing that turns about local z: dial, spoked valve, hand wheel, disc with a crank."""
    foot, tall = -_sink(b, s), b.uniform(0.5, 2.0) * s
    kind = b.choice(("dial", "spokes", "spokes", "wheel", "crank", "plain"))
    if kind == "dial":
        mech.dial(b, link, (0, 0, foot), (0, 0, 1), s, tall)
    elif kind == "wheel":
        b.cylinder(link, (0, 0, foot), (0, 0, tall), 0.25 * s)
        b.torus(link, (0, 0, tall), (0, 0, 1), 1.5 * s, 0.15 * s)
        for k in range(b.integer(2, 5)):
            with b.moved((0, 0, tall), (0, 0, 1), k * 2.1):
                b.box(link, (0, -0.1 * s, -0.1 * s), (1.5 * s, 0.1 * s, 0.1 * s))
    elif kind == "spokes":
        n = b.integer(2, 6)
        b.cylinder(link, (0, 0, foot), (0, 0, tall), b.uniform(0.3, 0.8) * s)
        reach, width = b.uniform(1.3, 2.5) * s, b.uniform(0.15, 0.5) * s
        low = b.uniform(0.1, 0.6) * tall
        for k in range(n):
            with b.moved((0, 0, low), (0, 0, 1), k * 2 * np.pi / n):
                b.box(link, (0, -width / 2, 0), (reach, width / 2, 0.6 * (tall - low)))
                if n == 2 and b.chance(0.3):
                    break
    else:
        b.cylinder(link, (0, 0, foot), (0, 0, tall), s, s * b.uniform(0.7, 1.0))
        if kind == "crank":
            b.cylinder(link, (0.7 * s, 0, tall), (0.7 * s, 0, 2 * tall), 0.2 * s)
    b.spin(link, "base", (0, 0, 0), (0, 0, 1))


def lever_flat(b: Builder, link: str, s: float) -> None:
    """An arm that swings in the plane of the face about local z: tap lever, latch, handle."""
    foot, tall = -_sink(b, s), b.uniform(0.4, 2.0) * s
    length, width = b.uniform(2, 6) * s, b.uniform(0.3, 1.2) * s
    b.cylinder(link, (0, 0, foot), (0, 0, tall), b.uniform(0.4, 0.9) * s)
    z = b.uniform(0.3, 0.8) * tall
    b.box(link, (0, -width / 2, z), (length, width / 2, z + b.uniform(0.15, 0.6) * s))
    if b.chance(0.4):
        b.sphere(link, (length, 0, z), 0.6 * width) if b.chance(0.5) else b.cylinder(
            link, (length, 0, z), (length, 0, z + s), 0.4 * width)  # fmt: skip
    b.hinge(link, "base", (0, 0, 0), (0, 0, 1), -0.2, b.uniform(0.8, 1.8))


def lever_up(b: Builder, link: str, s: float) -> None:
    """An arm that stands out and tips about local y: switch, joystick, press handle, pedal."""
    length, thick = b.uniform(1.5, 6) * s, b.uniform(0.15, 0.45) * s
    lean = b.uniform(-1.4, 1.4)
    yoke = b.uniform(0.5, 1.0) * s
    axle = b.uniform(0, 1.2) * s
    if b.chance(0.6):
        for y in (-yoke, yoke):
            b.box(
                "base", (-0.5 * s, y - 0.15 * s, -0.1 * s), (0.5 * s, y + 0.15 * s, axle + 0.4 * s)
            )
    holder = link if b.chance(0.5) else "base"
    b.cylinder(holder, (0, -yoke, axle), (0, yoke, axle), b.uniform(0.2, 0.5) * s)
    with b.moved((0, 0, axle), (0, 1, 0), lean):
        if b.chance(0.5):
            b.cylinder(link, (0, 0, 0), (0, 0, length), thick)
        else:
            b.box(
                link,
                (-thick, -b.uniform(0.5, 2) * thick, 0),
                (thick, b.uniform(0.5, 2) * thick, length),
            )
        if b.chance(0.5):
            b.cylinder(link, (0, -yoke, length), (0, yoke, length), 1.2 * thick)
        elif b.chance(0.5):
            b.sphere(link, (0, 0, length), 1.8 * thick)
    b.hinge(link, "base", (0, 0, axle), (0, 1, 0), -0.6, 0.6)


def slider(b: Builder, link: str, s: float) -> None:
    """A carriage that slides along local x, on rails or in a groove."""
    length, wide = b.uniform(4, 9) * s, b.uniform(0.6, 1.6) * s
    rails = b.choice(("two", "rod", "none"))
    if rails == "two":
        for y in (-wide, wide):
            b.box(
                "base", (-length / 2, y - 0.15 * s, -0.05 * s), (length / 2, y + 0.15 * s, 0.5 * s)
            )
    elif rails == "rod":
        b.cylinder("base", (-length / 2, 0, 0.5 * s), (length / 2, 0, 0.5 * s), 0.2 * s)
        for x in (-length / 2, length / 2):
            b.block("base", (x, 0, 0.4 * s), (0.3 * s, s, 0.9 * s))
    at = b.uniform(-0.3, 0.3) * length
    wide -= 0.15 * s + b.gap
    b.box(link, (at - s, -wide, max(b.gap, 0)), (at + s, wide, b.uniform(0.4, 1.2) * s))
    if b.chance(0.5):
        b.cylinder(link, (at, 0, 0.3 * s), (at, 0, 2 * s), 0.3 * s)
    b.slide(link, "base", (1, 0, 0), -0.3 * length - at, 0.3 * length - at)


MOVERS: tuple[Callable[[Builder, str, float], None], ...] = (
    push, turn, lever_flat, lever_up, slider,
)  # fmt: skip


def mechanism(b: Builder) -> None:
    """One base, one mover (now and then two or three), decoys."""
    low, high = base_body(b)
    count = b.choice((1, 2, 3), (0.8, 0.13, 0.07))
    size = high - low
    spot, normal, along, room = _mount(b, low, high)
    if count > 1:
        kind = MOVERS[b.integer(0, len(MOVERS) - 1)]
        side = np.cross(normal, along)
        extent = float(np.abs(size @ np.abs(side)))
        s = extent / count / b.uniform(2.5, 6)
        for k in range(count):
            shift = side * extent * ((k + 0.5) / count - 0.5)
            centre = (low + high) / 2
            centre[int(np.argmax(np.abs(normal)))] = spot[int(np.argmax(np.abs(normal)))]
            with b.facing(centre + shift, normal, along):
                kind(b, b.link("part", "part"), s)
    else:
        s = room * float(np.exp(b.uniform(np.log(0.07), np.log(0.45))))
        with b.facing(spot, normal, along):
            MOVERS[b.integer(0, len(MOVERS) - 1)](b, b.link("part", "part"), s)
    decoys(b, low, high, b.choice((0, 1, 2, 4, 6)), normal)


def vehicle(b: Builder) -> None:
    """A body on two to six wheels, some with an axle of their own."""
    d, w, h = b.uniform(0.3, 1.2), b.uniform(0.2, 0.7), b.uniform(0.05, 0.5)
    r = b.uniform(0.15, 0.5) * min(d, w)
    b.size(d, w, h + r)
    low, high = np.array([0, -w / 2, r * b.uniform(0.6, 1.2)]), np.array([d, w / 2, h + r])
    high[2] = max(high[2], low[2] + 0.05)
    clump(b, "base", low, high, 4)
    width = b.uniform(0.2, 0.8) * r
    for x in np.linspace(r, d - r, b.integer(1, 3)):
        axle = b.chance(0.3)
        if axle:
            b.cylinder("base", (x, -w / 2, r), (x, w / 2, r), 0.15 * r)
        for side in (-1, 1):
            link = b.link("wheel", "wheel")
            y = side * (w / 2 + width / 2 + max(b.gap, 1e-3))
            if b.chance(0.6):
                mech.wheel(b, link, (x, y, r), (0, 1, 0), r, width)
            else:
                b.cylinder(link, (x, y - width / 2, r), (x, y + width / 2, r), r)
            b.spin(link, "base", (x, y, r), (0, 1, 0))
    if b.chance(0.4):
        low_y, rise = w / 3, h + 3 * r
        path = [(d, -low_y, h + r), (1.3 * d, -low_y, rise), (1.3 * d, low_y, rise)]
        b.sweep("base", [*path, (d, low_y, h + r)], 0.05 * r)
    decoys(b, low, high, b.integer(0, 3), (0, 0, -1))
