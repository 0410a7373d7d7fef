"""Seats that move: office chairs and folding chairs."""

# ruff: noqa: RUF005  (a point plus a tuple is a vector sum here, not a joined list)

from __future__ import annotations

import numpy as np

from mam_world.carts import caster, caster_height
from mam_world.kit import Builder
from mam_world.solids import TAU, bar, part, rounded


def office_chair(b: Builder) -> None:
    """An office chair: a star foot with castors, a seat that turns and lifts, a back that leans."""
    w = b.uniform(0.42, 0.52)
    seat_z, reach = b.uniform(0.42, 0.5), b.uniform(0.26, 0.32)
    b.size(0.6, 0.6, 1.0)
    b.theme("dark")
    g = max(b.gap * 0.4, 0.002)
    r = b.uniform(0.022, 0.03)
    wheels = b.chance(0.8)
    swivel = wheels and b.chance(0.5)
    z = caster_height(b, r, swivel) if wheels else 0.03
    paint = b.choice(("metal", "dark"))
    b.cylinder("base", (0, 0, z), (0, 0, z + 0.09), 0.045, 0.035, paint)
    _star(b, z, reach, r, wheels, swivel, paint)
    lifts = b.chance(0.4)
    z1 = z + 0.09
    b.tube("base", (0, 0, z1), (0, 0, seat_z - 0.14), 0.028, 0.0215, "dark")
    holder = "base"
    if lifts:
        holder = part(b, "column", "gas_lift")
        b.cylinder(holder, (0, 0, z1 + 0.001), (0, 0, seat_z - 0.03), 0.019, None, "metal")
    else:
        b.cylinder("base", (0, 0, z1), (0, 0, seat_z - 0.03), 0.021, None, "metal")
    seat = part(b, "seat")
    zs = seat_z - 0.03 + g
    b.box(seat, (-0.1, -0.1, zs), (0.12, 0.1, zs + 0.025), "dark")
    rounded(b, seat, (-w / 2, -w / 2, zs + 0.025),
            (w / 2, w / 2, zs + 0.025 + b.uniform(0.05, 0.08)), 0.08, "z", "fabric")  # fmt: skip
    b.spin(seat, holder, (0, 0, zs), (0, 0, 1))
    if lifts:
        b.slide(holder, "base", (0, 0, 1), 0, 0.1)
    top = zs + 0.08
    leans = b.chance(0.5)
    back = part(b, "back") if leans else seat
    x = w / 2 + 0.04
    if leans:
        for s in (-1, 1):
            b.box(seat, (0.1, s * 0.045 - 0.008, zs), (x + 0.025, s * 0.045 + 0.008, zs + 0.024),
                  "dark")  # fmt: skip
        b.cylinder(back, (x, -0.034, zs + 0.012), (x, 0.034, zs + 0.012), 0.012, None, "metal")
    else:
        b.box(seat, (0.1, -0.03, zs), (x + 0.02, 0.03, zs + 0.024), "dark")
    tall = b.uniform(0.35, 0.65)
    b.sweep(back, [(x, 0, zs + 0.012), (x + 0.035, 0, zs + 0.06), (x + 0.035, 0, top + 0.5 * tall)],
            0.014, "dark")  # fmt: skip
    rounded(b, back, (x - 0.01, -0.45 * w, top + 0.1), (x + 0.03, 0.45 * w, top + 0.1 + tall), 0.08,
            "x", "fabric")  # fmt: skip
    if leans:
        b.hinge(
            back, seat, (x, 0, zs + 0.012), (0, 1, 0), 0, b.uniform(0.25, 0.45), opens=(1, 0, 0)
        )
    if b.chance(0.5):
        _armrests(b, seat, w, zs, top)


def _star(
    b: Builder, z: float, reach: float, r: float, wheels: bool, swivel: bool, paint: str
) -> None:
    """Five arms below z, each on a castor of radius `r` or a fixed foot."""
    for i in range(5):
        t = i * TAU / 5
        e = np.array([np.cos(t), np.sin(t), 0])
        b.cylinder("base", (0, 0, z + 0.05), reach * e + (0, 0, z + 0.02), 0.022, 0.015, paint)
        b.cylinder("base", reach * e + (0, 0, z + 0.03), reach * e + (0, 0, z), 0.015, None, paint)
        if wheels:
            with b.moved((0, 0, 0), (0, 0, 1), t + np.pi / 2 * (not swivel)):
                at = (reach, 0.0, z) if swivel else (0.0, -reach, z)
                caster(b, at, r, swivel)
        else:
            b.cylinder("base", reach * e, reach * e + (0, 0, z), 0.02, None, "rubber")


def _armrests(b: Builder, seat: str, w: float, zs: float, top: float) -> None:
    """An armrest on either side of a seat `w` wide."""
    for s in (-1, 1):
        y = s * (w / 2 + 0.03)
        b.box(seat, (0.0, min(y, s * 0.4 * w), zs + 0.03),
              (0.04, max(y, s * 0.4 * w), zs + 0.05), "dark")  # fmt: skip
        b.box(seat, (0.0, y - 0.012, zs + 0.03), (0.04, y + 0.012, top + 0.2), "dark")
        b.box(seat, (-0.12, y - 0.03, top + 0.2), (0.14, y + 0.03, top + 0.225), "rubber",
              "handle")  # fmt: skip


def folding_chair(b: Builder) -> None:
    """A folding chair: the rear legs and the seat swing on a frame of front legs and back."""
    w, h = b.uniform(0.4, 0.48), b.uniform(0.76, 0.85)
    b.size(0.5, w, h)
    b.theme(b.choice(("steel", "wood", "dark", "paint")))
    lean = b.uniform(0.25, 0.35)
    r = b.uniform(0.009, 0.013)
    seat_z = 0.44
    foot, top = np.array([-0.2, 0, r]), np.array([-0.2 + (h - r) * np.tan(lean), 0, h])
    y = w / 2
    along = (top - foot) / np.linalg.norm(top - foot)
    for s in (-1, 1):
        b.cylinder("base", foot + (0, s * y, 0), top + (0, s * y, 0), r, None, "metal")
    b.cylinder("base", foot + 0.12 * along + (0, -y, 0), foot + 0.12 * along + (0, y, 0), 0.8 * r,
               None, "metal")  # fmt: skip
    slats = b.integer(1, 3)
    normal = np.array([-along[2], 0, along[0]])
    for i in range(slats):
        c = top - (0.05 + 0.07 * i) * along
        bar(b, "base", c - (0, y, 0), c + (0, y, 0), 0.05, 0.01, normal, "front")
    for s in (-1, 1):
        b.sphere("base", foot + (0, s * y, 0), r, "rubber")
    pivot = foot + (seat_z - 0.03) / along[2] * along
    inner = y - 2.2 * r - 0.004
    rear = part(b, "leg", "rear_legs")
    ground = np.array([pivot[0] + 0.26, 0, r])
    for s in (-1, 1):
        b.cylinder(rear, pivot + (0, s * inner, 0), ground + (0, s * inner, 0), r, None, "metal")
        b.cylinder(
            "base", pivot + (0, s * y, 0), pivot + (0, s * (inner - r), 0), 0.6 * r, None, "metal"
        )
    down = (ground - pivot) / np.linalg.norm(ground - pivot)
    b.cylinder(rear, ground - 0.1 * down + (0, -inner, 0), ground - 0.1 * down + (0, inner, 0),
               0.8 * r, None, "metal")  # fmt: skip
    between = np.arccos(np.clip(down @ -along, -1, 1))
    b.hinge(rear, "base", pivot, (0, 1, 0), 0, between - 0.06, opens=(-1, 0, 0))
    seat = part(b, "seat")
    hinge_at = foot + (seat_z + 0.03) / along[2] * along
    width = inner - 1.6 * r - 0.004
    rounded(b, seat, (hinge_at[0] - b.uniform(0.3, 0.36), -width, hinge_at[2] - 0.008),
            (hinge_at[0] + 0.05, width, hinge_at[2] + 0.01), 0.03, "z",
            b.choice(("front", "fabric", "wood")))  # fmt: skip
    for s in (-1, 1):
        b.cylinder("base", hinge_at + (0, s * y, 0), hinge_at + (0, s * (width - 0.01), 0), 0.5 * r,
                   None, "metal")  # fmt: skip
    b.hinge(seat, "base", hinge_at, (0, 1, 0), 0, b.uniform(0.9, 1.1), opens=(0, 0, 1))


CATEGORIES = {"office_chair": office_chair, "folding_chair": folding_chair}
