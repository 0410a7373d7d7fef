"""Cars and bicycles, real or toys."""

# ruff: noqa: RUF005  (a point plus a tuple is a vector sum here, not a joined list)

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mam_pipeline.types import FloatArray
from mam_world.kit import Builder
from mam_world.mech import wheel
from mam_world.solids import TAU, arc, bar, frame, part, profile, rounded


@dataclass(frozen=True)
class _Car:
    """Sizes of a car, metres: x grows from the front to the rear.

    Attributes:
        k: scale; 1 is a real car. length, w, r: body length, width, wheel radius.
        t, g: sheet thickness, clearance. zf, zb: bottom and waist line. inner: half the floor.
        a, c: where the cabin begins and ends. axles: of the wheels.
        doors: (front edge, rear edge) of the doors of one side. sill: their lower edge.
    """

    k: float
    length: float
    w: float
    r: float
    t: float
    g: float
    zf: float
    zb: float
    inner: float
    a: float
    c: float
    axles: tuple[float, float]
    doors: tuple[tuple[float, float], ...]
    sill: float


def car(b: Builder) -> None:
    """A car or a toy car: wheels, doors, bonnet, boot, steering wheel; some parts may be fixed."""
    k = 1.0 if b.chance(0.4) else b.uniform(0.05, 0.12)
    length, w = k * b.uniform(3.4, 4.7), k * b.uniform(1.6, 1.85)
    r = k * b.uniform(0.28, 0.36)
    b.size(length, w, 1.5 * k)
    b.theme(b.choice(("paint", "paint", "dark", "white", "steel")))
    t, g = 0.06 * k, max(b.gap * 0.5, 0.006 * k)
    zf, zb, zr = 0.26 * k, b.uniform(0.82, 0.95) * k, b.uniform(1.35, 1.6) * k
    a, c = 0.28 * length, b.uniform(0.72, 0.8) * length
    x1, x2 = 0.16 * length, 0.8 * length
    four = b.chance(0.4)
    d0, d1 = a + 0.08 * k, c - 0.2 * k if four else a + b.uniform(1.0, 1.15) * k
    d1 = min(d1, x2 - 1.3 * r)  # clear of the rear wheel
    mid = [(d0, (d0 + d1) / 2 - 0.04 * k), ((d0 + d1) / 2 + 0.04 * k, d1)] if four else [(d0, d1)]
    live_doors = b.chance(0.8)
    m = _Car(k, length, w, r, t, g, zf, zb, w / 2 - 0.32 * k, a, c, (x1, x2), tuple(mid),
             zf + 0.1 * k)  # fmt: skip
    _car_body(b, m, live_doors)
    _cabin(b, k, a, c, w, zf, zb, zr, (mid[0][1] if four else d1))
    if live_doors:
        _car_doors(b, m)
    for name, x0, x1_, pivot in (
        ("bonnet", 0.01 * k, a - g, a - g),
        ("boot", c + 0.06 * k, length - 0.01 * k, c + 0.06 * k),
    ):
        moving = b.chance(0.75)
        lid = part(b, "lid", name) if moving else "base"
        z = zb + (g if moving else 0)
        rounded(b, lid, (x0, -w / 2 + 0.02 * k, z), (x1_, w / 2 - 0.02 * k, z + 0.03 * k), 0.05 * k)
        if moving:
            b.hinge(lid, "base", (pivot, 0, z), (0, 1, 0), 0, b.uniform(0.8, 1.1), opens=(0, 0, 1))
            if name == "boot":  # the shelf that it hangs on
                b.box("base", (pivot - 0.08 * k, -w / 2 + t, zb - 0.03 * k),
                      (pivot, w / 2 - t, zb), "dark")  # fmt: skip
    _car_wheels(b, m)


def _car_body(b: Builder, m: _Car, live_doors: bool) -> None:
    """Sides with wheel arches and door openings, floor, bumpers, lamps, dashboard."""
    k, length, w, t, zf, zb = m.k, m.length, m.w, m.t, m.zf, m.zb
    a, r, inner, (x1, x2) = m.a, m.r, m.inner, m.axles
    outline: list[tuple[float, float]] = [(0, zf)]
    for xc in (x1, x2):
        rise = np.arcsin((zf - r) / (1.2 * r)) if abs(zf - r) < 1.2 * r else 0.0
        outline += [
            (float(p[0]), float(p[2])) for p in arc((xc, 0, r), 1.2 * r, np.pi - rise, rise, 9)
        ]
    outline += [(length, zf), (length, zb)]
    for near, far in reversed(m.doors if live_doors else ()):
        outline += [(far, zb), (far, m.sill), (near, m.sill), (near, zb)]
    outline += [(0, zb)]
    for s in (-1, 1):
        y0, y1 = sorted((s * w / 2, s * (w / 2 - t)))
        profile(b, "base", outline, y0, y1, "y")
    b.box("base", (0, -inner, zf), (length, inner, zf + 0.06 * k), "dark")
    b.box(
        "base", (x1 + 1.25 * r, -w / 2 + t, zf), (x2 - 1.25 * r, w / 2 - t, zf + 0.06 * k), "dark"
    )
    b.box("base", (0, -w / 2 + t, zf), (t, w / 2 - t, zb), "body")
    b.box("base", (length - t, -w / 2 + t, zf), (length, w / 2 - t, zb), "body")
    b.box("base", (-0.08 * k, -w / 2, zf), (0, w / 2, zf + 0.2 * k), "trim")
    b.box("base", (length, -w / 2, zf), (length + 0.08 * k, w / 2, zf + 0.2 * k), "trim")
    b.box(
        "base", (-0.02 * k, -0.3 * w, zf + 0.25 * k), (0, 0.3 * w, zb - 0.12 * k), "dark", "decor"
    )
    for s in (-1, 1):
        b.disc("base", (0, s * 0.4 * w, zb - 0.18 * k), (-1, 0, 0), 0.09 * k, 0.03 * k, "light",
               "decor")  # fmt: skip
        b.block("base", (length, s * 0.4 * w, zb - 0.16 * k), (0.04 * k, 0.2 * k, 0.12 * k), "red",
                "decor")  # fmt: skip
    b.box("base", (a - 0.02 * k, -w / 2 + t, zf + 0.06 * k),
          (a + 0.04 * k, w / 2 - t, zb + 0.02 * k), "dark")  # fmt: skip
    b.box("base", (0.35 * a, -0.5 * inner, zf + 0.06 * k), (0.8 * a, 0.5 * inner, zb - 0.2 * k),
          "metal", "content")  # fmt: skip


def _car_doors(b: Builder, m: _Car) -> None:
    """Doors on both sides, hinged in front; the front ones may carry mirrors."""
    k, w, t, g, zb, zs = m.k, m.w, m.t, m.g, m.zb, m.sill
    for near, far in m.doors:
        for s in (-1, 1):
            door = part(b, "door")
            y0, y1 = sorted((s * w / 2, s * (w / 2 - 0.8 * t)))
            b.box(door, (near + g, y0, zs + g), (far - g, y1, zb), "body")
            hx = far - 0.2 * k
            yh = s * (w / 2 + 0.015 * k)
            b.block(
                door, (hx, yh, zb - 0.15 * k), (0.14 * k, 0.03 * k, 0.03 * k), "metal", "handle"
            )
            if b.chance(0.5) and near == m.doors[0][0]:
                b.block(door, (near + 0.15 * k, s * (w / 2 + 0.06 * k), zb + 0.02 * k),
                        (0.08 * k, 0.14 * k, 0.1 * k), "dark", "decor")  # fmt: skip
            b.hinge(door, "base", (near + g / 2, s * w / 2, zs), (0, 0, 1), 0,
                    b.uniform(0.9, 1.2), opens=(0, s, 0))  # fmt: skip


def _car_wheels(b: Builder, m: _Car) -> None:
    """Four wheels; the front ones steer or not."""
    k, w, r, inner, (x1, x2) = m.k, m.w, m.r, m.inner, m.axles
    style, steer = b.choice(("disc", "tyre", "cast")), b.chance(0.4)
    ww = 0.2 * k
    for x in (x1, x2):
        b.cylinder("base", (x, -inner, r), (x, inner, r), 0.06 * k, None, "dark")
        for s in (-1, 1):
            y = s * (w / 2 - 0.13 * k)
            parent = "base"
            if steer and x == x1:
                parent = part(b, "knuckle")
                b.cylinder(parent, (x, s * (inner + 0.005 * k), r - 0.06 * k),
                           (x, s * (inner + 0.005 * k), r + 0.06 * k), 0.05 * k, None,
                           "metal")  # fmt: skip
                b.cylinder(parent, (x, s * inner, r), (x, y, r), 0.04 * k, None, "metal")
                b.hinge(parent, "base", (x, s * (inner + 0.005 * k), r), (0, 0, 1), -0.05, 0.05,
                        closed=0.0)  # fmt: skip
            else:
                b.cylinder("base", (x, s * inner, r), (x, y, r), 0.04 * k, None, "metal")
            roll = part(b, "wheel")
            wheel(b, roll, (x, y, r), (0, 1, 0), r, ww, style)
            b.spin(roll, parent, (x, y, r), (0, 1, 0))


def _cabin(
    b: Builder, k: float, a: float, c: float, w: float, zf: float, zb: float, zr: float, post: float
) -> None:
    """Roof, pillars, wind screens, seats and a steering wheel that turns."""
    f0, f1 = a + b.uniform(0.3, 0.6) * k, c - b.uniform(-0.05, 0.3) * k
    y = w / 2 - 0.06 * k
    if b.chance(0.85):
        rounded(b, "base", (f0, -y + 0.06 * k, zr - 0.05 * k), (f1, y - 0.06 * k, zr), 0.08 * k,
                "z", b.choice(("body", "dark")))  # fmt: skip
        for s in (-1, 1):
            b.cylinder("base", (f1, s * (y - 0.08 * k), zr - 0.03 * k),
                       (c + 0.02 * k, s * y, zb - 0.02 * k), 0.03 * k, None, "body")  # fmt: skip
            b.cylinder("base", (post + 0.05 * k, s * (y - 0.07 * k), zr - 0.03 * k),
                       (post + 0.05 * k, s * (y - 0.03 * k), zf + 0.05 * k), 0.025 * k, None,
                       "dark")  # fmt: skip
    else:
        f0, zr = a + 0.35 * k, zb + 0.4 * k
    for s in (-1, 1):
        b.cylinder("base", (a + 0.06 * k, s * y, zb - 0.02 * k),
                   (f0, s * (y - 0.08 * k), zr - 0.03 * k), 0.03 * k, None, "body")  # fmt: skip
    bar(b, "base", (a + 0.06 * k, 0, zb), (f0, 0, zr - 0.03 * k), 2 * y - 0.16 * k, 0.01 * k,
        (-1, 0, 0.6), "glass")  # fmt: skip
    for x in (a + 0.75 * k, c - 0.55 * k):
        for s in (-1, 1):
            yy = s * 0.22 * w
            b.block("base", (x + 0.1 * k, yy, zf + 0.2 * k), (0.42 * k, 0.36 * k, 0.28 * k),
                    "fabric", "content")  # fmt: skip
            b.block("base", (x + 0.32 * k, yy, zf + 0.5 * k), (0.1 * k, 0.36 * k, 0.6 * k),
                    "fabric", "content")  # fmt: skip
    at = np.array([a + 0.3 * k, -0.22 * w, zb - 0.05 * k])
    axis = np.array([0.9, 0, 0.45])
    b.cylinder("base", (a, -0.22 * w, zb - 0.2 * k), at - 0.012 * k * axis, 0.025 * k, None, "dark")
    helm = part(b, "wheel", "steering_wheel")
    with b.facing(at, axis):
        b.torus(helm, (0, 0, 0.02 * k), (0, 0, 1), 0.17 * k, 0.015 * k, "dark", "handle")
        b.cylinder(helm, (0, 0, 0), (0, 0, 0.04 * k), 0.04 * k, None, "dark")
        for t in np.arange(3) * TAU / 3:
            b.cylinder(helm, (0, 0, 0.02 * k),
                       (0.17 * k * np.cos(t), 0.17 * k * np.sin(t), 0.02 * k), 0.012 * k, None,
                       "dark")  # fmt: skip
    b.spin(helm, "base", at, axis, *b.choice(((-np.inf, np.inf), (-3.0, 3.0))), closed=0.0)


def bicycle(b: Builder) -> None:
    """A bicycle: two wheels, a fork that steers, a crank with pedals."""
    k = b.choice((1.0, 1.0, 0.7, 0.12))
    r, base_ = 0.33 * k, b.uniform(0.95, 1.08) * k
    b.size(base_ + 2 * r, 0.5 * k, k)
    b.theme(b.choice(("paint", "dark", "steel")))
    axis = np.array([0.3, 0, 0.954])
    front, rear = np.array([-base_ / 2, 0, r]), np.array([base_ / 2, 0, r])
    head = front + 0.44 * k * axis
    top = head + b.uniform(0.1, 0.16) * k * axis
    crank = np.array([0.05 * k, 0, 0.28 * k])
    seat = crank + np.array([0.15, 0, b.uniform(0.42, 0.5)]) * k
    tube = b.uniform(0.014, 0.02) * k
    b.tube("base", head, top, 0.024 * k, 0.017 * k, "body")
    step = b.chance(0.25)
    join = crank + 0.25 * (seat - crank) if step else crank + 0.9 * (seat - crank)
    reach = np.array([0.022 * k, 0, 0])
    b.cylinder(
        "base", (head + top) / 2 + 0.3 * (top - head) + reach, join, 0.85 * tube, None, "body"
    )
    b.cylinder("base", head + 0.2 * (top - head) + reach, crank, tube, None, "body")
    b.cylinder("base", crank, seat + np.array([0.02, 0, 0.08]) * k, 0.9 * tube, None, "body")
    b.cylinder(
        "base", crank - (0, 0.035 * k, 0), crank + (0, 0.035 * k, 0), 0.022 * k, None, "body"
    )
    _saddle(b, seat, k)
    for s in (-1, 1):
        e = np.array([0, s * 0.05 * k, 0])
        b.sweep("base", [crank + 0.6 * e, crank + 0.35 * (rear - crank) + e, rear + e], 0.009 * k,
                "body")  # fmt: skip
        b.cylinder(
            "base", crank + 0.85 * (seat - crank) + 0.6 * e, rear + e, 0.007 * k, None, "body"
        )
    b.cylinder("base", rear - (0, 0.055 * k, 0), rear + (0, 0.055 * k, 0), 0.008 * k, None, "metal")
    ww = b.uniform(0.035, 0.05) * k
    style = b.choice(("spoke", "spoke", "cast"))
    roll = part(b, "wheel", "rear_wheel")
    wheel(b, roll, rear, (0, 1, 0), r, ww, style)
    b.spin(roll, "base", rear, (0, 1, 0))
    fork = part(b, "fork", "fork")
    crown = head - 0.03 * k * axis
    b.cylinder(fork, crown, top + 0.06 * k * axis, 0.013 * k, None, "metal")
    b.cylinder(fork, crown - (0, 0.055 * k, 0), crown + (0, 0.055 * k, 0), 0.016 * k, None, "body")
    for s in (-1, 1):
        b.cylinder(fork, crown + (0, s * 0.05 * k, 0), front + (0, s * 0.05 * k, 0), 0.011 * k,
                   None, "body")  # fmt: skip
    b.cylinder(fork, front - (0, 0.055 * k, 0), front + (0, 0.055 * k, 0), 0.008 * k, None, "metal")
    _handlebar(b, fork, top + 0.06 * k * axis, k)
    b.hinge(fork, "base", head, axis, -0.6, 0.6, closed=0.0)
    turn = part(b, "wheel", "front_wheel")
    wheel(b, turn, front, (0, 1, 0), r, ww, style)
    b.spin(turn, fork, front, (0, 1, 0))
    _crank(b, crank, k)


def _saddle(b: Builder, seat: FloatArray, k: float) -> None:
    """A saddle above the end of the seat tube; `k` is the bicycle's scale."""
    saddle = seat + np.array([0.025, 0, 0.09]) * k
    profile(
        b,
        "base",
        [
            (saddle[0] + 0.1 * k, 0.07 * k),
            (saddle[0] + 0.1 * k, -0.07 * k),
            (saddle[0] - 0.04 * k, -0.025 * k),
            (saddle[0] - 0.15 * k, -0.015 * k),
            (saddle[0] - 0.15 * k, 0.015 * k),
            (saddle[0] - 0.04 * k, 0.025 * k),
        ],
        saddle[2] - 0.02 * k,
        saddle[2] + 0.02 * k,
        "z",
        "dark",
    )


def _handlebar(b: Builder, fork: str, z: FloatArray, k: float) -> None:
    """A bent bar with grips on a stem whose top is at `z`."""
    wide, back = b.uniform(0.24, 0.32) * k, b.uniform(0, 0.12) * k
    points = [
        (back, -wide, 0.02 * k),
        (-0.04 * k, -0.6 * wide, 0.03 * k),
        (-0.05 * k, 0, 0),
        (-0.04 * k, 0.6 * wide, 0.03 * k),
        (back, wide, 0.02 * k),
    ]
    b.cylinder(fork, z, z + np.array([-0.05 * k, 0, 0]), 0.013 * k, None, "metal")
    b.sweep(fork, z + np.array(points), 0.011 * k, "metal", "handle")
    for s in (0, -1):
        p, q = z + np.array(points[s]), z + np.array(points[1 if s == 0 else -2])
        b.cylinder(fork, p, p + 0.4 * (q - p), 0.016 * k, None, "rubber", "handle")


def _crank(b: Builder, crank: FloatArray, k: float) -> None:
    """Chain ring and two arms about `crank`, with turning pedals."""
    arms = part(b, "crank")
    b.cylinder(arms, crank - (0, 0.09 * k, 0), crank + (0, 0.09 * k, 0), 0.012 * k, None, "metal")
    b.cylinder(arms, crank + (0, -0.062 * k, 0), crank + (0, -0.068 * k, 0), 0.09 * k, None, "dark")
    tilt = b.uniform(0, TAU)
    for s in (-1, 1):
        e = s * np.array([np.cos(tilt), 0, np.sin(tilt)])
        end = crank + 0.17 * k * e
        y = np.array([0, s * 0.085 * k, 0])
        b.cylinder(arms, crank + y, end + y, 0.01 * k, None, "metal")
        b.cylinder(arms, end + y, end + 2 * y, 0.006 * k, None, "metal")
        pedal = part(b, "pedal")
        c = end + y * 1.75
        frame(b, pedal, c - np.array([0.045, 0.045, 0.012]) * k,
              c + np.array([0.045, 0.045, 0.012]) * k, 0.02 * k, "z", "rubber")  # fmt: skip
        b.block(pedal, c, (0.025 * k, 0.06 * k, 0.02 * k), "dark")
        b.spin(pedal, arms, end, (0, 1, 0))
    b.spin(arms, "base", crank, (0, 1, 0))


CATEGORIES = {"car": car, "bicycle": bicycle}
