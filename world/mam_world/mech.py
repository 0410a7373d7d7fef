"""Fittings of the mechanism families: dials, road wheels, feet, bails, fixed studs, rods."""

# ruff: noqa: RUF005  (a point plus a tuple is a vector sum here, not a joined list)

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mam_world import collide, shapes
from mam_world.kit import Builder
from mam_world.solids import TAU


def dial(
    b: Builder,
    link: str,
    foot: ArrayLike,
    axis: ArrayLike,
    radius: float,
    height: float,
    style: str | None = None,
    material: str | None = None,
) -> None:
    """A knob standing on `foot`: plain, cone, flute, pointer, dome, bar, skirt or cross."""
    kind = style or b.choice(("plain", "cone", "flute", "pointer", "dome", "bar", "skirt", "cross"))
    paint = material or b.choice(("dark", "metal", "light", "accent"))
    r, h = radius, height
    up = (0, 0, 1) if abs(np.asarray(axis, float)[2]) < 0.9 else (1, 0, 0)
    with b.facing(foot, axis, up):
        if kind == "cone":
            b.lathe(link, [(r, 0), (0.75 * r, h)], paint, "handle")
        elif kind == "dome":
            top = [(r * np.cos(t), h * (0.4 + 0.6 * np.sin(t))) for t in (0, 0.5, 1.0, 1.3)]
            b.lathe(link, [(r, 0), *top, (0, h)], paint, "handle")
        elif kind == "skirt":
            b.lathe(
                link, [(r, 0), (r, 0.25 * h), (0.65 * r, 0.3 * h), (0.6 * r, h)], paint, "handle"
            )
        elif kind == "bar":
            b.lathe(link, [(r, 0), (r, 0.35 * h)], paint, "handle")
            b.box(link, (-0.95 * r, -0.2 * r, 0.35 * h), (0.95 * r, 0.2 * r, h), paint, "handle")
        elif kind == "cross":
            b.lathe(link, [(0.35 * r, 0), (0.3 * r, h)], paint, "handle")
            for a, c in ((1, 0.25), (0.25, 1)):
                b.box(link, (-a * r, -c * r * 0.8, 0.5 * h), (a * r, c * r * 0.8, 0.9 * h), paint,
                      "handle")  # fmt: skip
        else:
            b.lathe(link, [(r, 0), (r, 0.85 * h), (0.9 * r, h)], paint, "handle")
            if kind == "flute":
                for t in np.arange(8) * TAU / 8:
                    c, s = 0.93 * r * np.cos(t), 0.93 * r * np.sin(t)
                    b.cylinder(
                        link, (c, s, 0), (c, s, 0.8 * h), 0.16 * r, None, paint, "handle", False
                    )
        if kind in ("pointer", "skirt", "cone"):
            mark = "light" if paint == "dark" else "dark"
            b.box(
                link, (0.15 * r, -0.06 * r, h), (0.55 * r, 0.06 * r, 1.04 * h), mark, "decor", False
            )


def wheel(
    b: Builder,
    link: str,
    centre: ArrayLike,
    axis: ArrayLike,
    radius: float,
    width: float,
    style: str | None = None,
) -> None:
    """A road wheel: disc, tyre on a rim with bolts, wire spokes or cast spokes.

    It collides as one cylinder: nothing reaches between the spokes of a turning wheel.
    """
    kind = style or b.choice(("disc", "tyre", "spoke", "cast"))
    w, r = width / 2, radius
    with b.facing(centre, axis):
        if kind == "spoke":
            b.torus(link, (0, 0, 0), (0, 0, 1), r - w, w, "rubber", "solid", False)
            b.torus(link, (0, 0, 0), (0, 0, 1), r - 2 * w, 0.5 * w, "metal", "solid", False)
        else:
            with b.moved((0, 0, -w)):
                side = [(r * 0.93, 0), (r, 0.5 * w), (r, 1.5 * w), (r * 0.93, 2 * w)]
                b.vessel(link, side, 0.25 * r, "rubber", bottom=False, collision=False)
        hub = [(0, -w), (0.16 * r, -w), (0.16 * r, w), (0, w)]
        b.add(link, shapes.revolve(hub, b.segments(0.16 * r)),
              [collide.cylinder((0, 0, -w), (0, 0, w), r)], "metal")  # fmt: skip
        if kind in ("disc", "tyre"):
            b.cylinder(link, (0, 0, -0.6 * w), (0, 0, 0.6 * w), 0.73 * r, None,
                       "metal" if kind == "tyre" else "accent", "solid", False)  # fmt: skip
            if kind == "tyre":
                for t in np.arange(5) * TAU / 5:
                    c, s = 0.42 * r * np.cos(t), 0.42 * r * np.sin(t)
                    b.cylinder(link, (c, s, -0.7 * w), (c, s, 0.7 * w), 0.08 * r, None, "dark",
                               "decor", False)  # fmt: skip
            return
        count = b.integer(5, 8) if kind == "cast" else b.integer(9, 14)
        thick = min(0.06 * r if kind == "cast" else 0.015 * r, 0.8 * w)
        reach = 0.8 * r if kind == "cast" else r - 1.5 * w
        for t in np.arange(count) * TAU / count:
            d = np.array([np.cos(t), np.sin(t), 0])
            b.cylinder(link, 0.12 * r * d, reach * d, thick, None, "metal", "solid", False, 6)


def feet(
    b: Builder, low: Sequence[float], high: Sequence[float], height: float, link: str = "base"
) -> None:
    """Four short feet below the rectangle low..high (x, y), from z = 0 up to `height`."""
    r = 0.06 * min(high[0] - low[0], high[1] - low[1])
    for x in (low[0] + 2 * r, high[0] - 2 * r):
        for y in (low[1] + 2 * r, high[1] - 2 * r):
            b.cylinder(link, (x, y, 0), (x, y, height), r, None, "rubber")


def bail(
    b: Builder, link: str, centre: ArrayLike, radius: float, height: float, thick: float, grip: bool
) -> None:
    """A half-round wire handle in the y-z plane, its eyes on the y axis through `centre`."""
    t = np.linspace(0, np.pi, 13)
    path = np.asarray(centre, float) + np.stack(
        [0 * t, radius * np.cos(t), height * np.sin(t)], axis=1
    )
    b.sweep(link, path, thick, "metal", "handle")
    if grip:
        c = np.asarray(centre, float) + (0, 0, height)
        b.cylinder(link, c - (0, 0.3 * radius, 0), c + (0, 0.3 * radius, 0), 2.2 * thick, None,
                   "wood", "handle")  # fmt: skip


def studs(
    b: Builder, points: Sequence[ArrayLike], axis: ArrayLike, radius: float, link: str = "base"
) -> None:
    """Fixed round heads that look like small knobs or buttons but belong to the body."""
    for p in points:
        with b.facing(p, axis):
            b.lathe(
                link, [(radius, 0), (0.8 * radius, 0.5 * radius)], "metal", "decor", collision=False
            )


def rod(
    b: Builder, link: str, start: ArrayLike, end: ArrayLike, radius: float, material: str = "metal"
) -> None:
    """A round rod between two points, of metal unless another material is named."""
    b.cylinder(link, start, end, radius, None, material)


def boxes(b: Builder, link: str, *rows: Any) -> None:
    """Blocks (x, y, z, dx, dy, dz, material), mirrored unless y is 0."""
    for x, y, z, dx, dy, dz, material in rows:
        for side in (y, -y) if y else (0,):
            b.block(link, (x, side, z), (dx, dy, dz), material)


def rods(b: Builder, link: str, *rows: Any) -> None:
    """Rods (start, end, radius, material), mirrored unless they lie across the middle."""
    for p, q, r, material in rows:
        for s in (1, -1) if abs(p[1] + q[1]) > 1e-9 else (1,):
            ends = np.array([p, q], float) * (1, s, 1)
            b.cylinder(link, ends[0], ends[1], r, None, material)


def rolls(b: Builder, x: float, y: float, r: float, wide: float, style: str, live: bool,
           parent: str = "base") -> None:  # fmt: skip
    """Wheels on the floor at x and both y, which spin on their parent or are fixed to it."""
    for s in (1, -1) if y else (1,):
        link, at = b.link("wheel", "wheel") if live else parent, (x, s * y, r)
        wheel(b, link, at, (0, 1, 0), r, wide, style)
        if live:
            b.spin(link, parent, at, (0, 1, 0))
