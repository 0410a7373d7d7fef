"""Buckets and bins: bail handles, pedal bins, swing-lid bins."""

# ruff: noqa: RUF005  (a point plus a tuple is a vector sum here, not a joined list)

from __future__ import annotations

import numpy as np

from mam_world.kit import Builder
from mam_world.mech import bail
from mam_world.solids import bar, part, tray
from mam_world.vessels import cover


def bucket(b: Builder) -> None:
    """A bucket with a bail handle, standing up or hanging at the side."""
    r = b.uniform(0.1, 0.16)
    h = r * b.uniform(1.4, 2.2)
    low = r * b.uniform(0.68, 0.9)
    b.size(2 * r, 2 * r, 2 * h)
    b.theme(b.choice(("steel", "plastic", "paint")))
    b.vessel("base", [(low, 0), (r, h)], b.uniform(0.0015, 0.004), "body")
    b.torus("base", (0, 0, h), (0, 0, 1), r, 0.004, "trim")
    if b.chance(0.5):
        k = 0.65
        b.torus("base", (0, 0, k * h), (0, 0, 1), low + k * (r - low) + 0.001, 0.0025, "body",
                "decor", False)  # fmt: skip
    thick = b.uniform(0.002, 0.004)
    z, out = 0.93 * h, r + 0.014
    for s in (-1, 1):
        b.block("base", (0, s * (r - 0.001), z), (0.03, 0.014, 0.03), "trim")
    handle = part(b, "handle", "bail")
    bail(b, handle, (0, 0, z), out, b.uniform(0.95, 1.1) * out, thick, b.chance(0.6))
    for s in (-1, 1):
        b.cylinder(handle, (0, s * (r - 0.004), z), (0, s * (out + thick), z), 1.6 * thick, None,
                   "metal", "handle")  # fmt: skip
    b.hinge(handle, "base", (0, 0, z), (0, 1, 0), -1.4, 1.4, rest=b.choice((0.0, 0.0, 1.3, -1.0)),
            closed=0.0)  # fmt: skip


def pedal_bin(b: Builder) -> None:
    """A bin whose lid opens by a pedal: a hinged lid and a hinged pedal."""
    r, h = b.uniform(0.09, 0.16), b.uniform(0.24, 0.6)
    b.size(2.2 * r, 2 * r, h)
    b.theme(b.choice(("steel", "white", "plastic", "dark")))
    foot = 0.03
    b.cylinder("base", (0, 0, 0), (0, 0, foot * 0.3), 0.98 * r, None, "dark")
    square = b.chance(0.4)
    g = max(b.gap, 0.001)
    z = h + g
    lid = part(b, "lid")
    if square:
        b.box("base", (-0.8 * r, -0.8 * r, foot * 0.3), (0.95 * r, 0.8 * r, foot), "dark")
        tray(b, "base", (-r, -r, foot), (r, r, h), 0.004, "z", 1)
        tray(b, lid, (-r, -r, z), (r, r, z + 0.03), 0.004, "z", -1, "trim")
    else:
        b.cylinder("base", (0.03, 0, foot * 0.3), (0.03, 0, foot), 0.8 * r, None, "dark")
        with b.moved((0, 0, foot)):
            b.vessel("base", [(r, 0), (r, h - foot)], 0.004, "body")
        cover(b, lid, r, z, 0.01, b.uniform(0.0, 0.35) * r)
    x = r + 0.004
    # the hinge's lug reaches up to its barrel, however wide the gap
    b.box("base", (r - 0.005, -0.25 * r, h - 0.025), (r + 0.009, 0.25 * r, z - 0.004), "dark")
    b.cylinder(lid, (x, -0.6 * r, z), (x, 0.6 * r, z), 0.0035, None, "dark")
    b.block(lid, (r - 0.001, 0, z + 0.006), (0.022, 0.4 * r, 0.006), "trim")
    b.hinge(lid, "base", (x, 0, z), (0, 1, 0), 0, b.uniform(1.1, 1.5), opens=(0, 0, 1))
    pedal = part(b, "pedal")
    px, pw = -0.7 * r if square else -0.6 * r, b.uniform(0.3, 0.5) * r
    zp = foot * 0.68
    if not square:
        b.block("base", (px + 0.008, 0, zp), (0.016, pw + 0.012, foot * 0.62), "dark")
    b.cylinder(pedal, (-0.78 * r, -pw / 2, zp), (-0.78 * r, pw / 2, zp), 0.003, None, "metal")
    b.box(
        pedal, (-1.28 * r, -pw / 2, zp - 0.002), (-0.79 * r, pw / 2, zp + 0.002), "metal", "handle"
    )
    b.box(pedal, (-1.3 * r, -0.6 * pw, zp - 0.003), (-1.08 * r, 0.6 * pw, zp + 0.005), "rubber",
          "handle")  # fmt: skip
    b.hinge(pedal, "base", (-0.78 * r, 0, zp), (0, 1, 0), 0, min(0.2, 0.015 / (0.55 * r)),
            opens=(0, 0, -1))  # fmt: skip


def swing_bin(b: Builder) -> None:
    """A bin with a flap that swings about its middle, in a hood or in a flat top."""
    w, d, h = b.uniform(0.2, 0.34), b.uniform(0.18, 0.3), b.uniform(0.4, 0.7)
    b.size(w, d, h)
    b.theme(b.choice(("plastic", "white", "steel", "dark")))
    k = 0.72 * h
    tray(b, "base", (-d / 2, -w / 2, 0), (d / 2, w / 2, k), 0.005, "z", 1, taper=b.uniform(0, 0.03))
    g, t = max(b.gap, 0.0015), 0.006
    if b.chance(0.5):
        # a gabled hood: two fixed end walls carry the axle of a flap that closes the front slope
        for s in (-1, 1):
            y = s * (w / 2 - 0.004)
            with b.facing((0, y + 0.004, k), (0, -1, 0), (1, 0, 0)):
                b.extrude(
                    "base",
                    [(-d / 2, 0), (d / 2, 0), (d / 2, 0.1 * h), (0.0, h - k), (-d / 2, 0.1 * h)],
                    0.008,
                    "trim",
                )
        b.box(
            "base", (d / 2 - 0.006, -w / 2 + 0.009, k), (d / 2, w / 2 - 0.009, k + 0.1 * h), "trim"
        )
        b.box("base", (-d / 2, -w / 2 + 0.009, k), (-d / 2 + 0.006, w / 2 - 0.009, k + 0.1 * h),
              "trim")  # fmt: skip
        bar(b, "base", (d / 2, 0, k + 0.1 * h), (0.003, 0, h - 0.002), w - 0.018, t,
            (h - k - 0.1 * h, 0, d / 2), "trim")  # fmt: skip
        low, high = np.array([-d / 2, 0, k + 0.1 * h]), np.array([-0.003, 0, h - 0.002])
        mid = 0.5 * (low + high)
        along = (high - low) / np.linalg.norm(high - low)
        half = 0.5 * float(np.linalg.norm(high - low)) - g - 0.006
        normal = np.array([-along[2], 0, along[0]])
    else:
        rim = b.uniform(0.02, 0.05)
        for s in (-1, 1):
            b.box("base", (-d / 2, s * (w / 2 - rim), k), (d / 2, s * w / 2, k + 0.02), "trim")
            b.box("base", (s * (d / 2 - rim), -w / 2 + rim, k), (s * d / 2, w / 2 - rim, k + 0.02),
                  "trim")  # fmt: skip
        mid, along, normal = (
            np.array([0, 0, k + 0.01]),
            np.array([1.0, 0, 0]),
            np.array([0, 0, 1.0]),
        )
        half, w = d / 2 - rim - g - 0.002, w - 2 * rim + 0.018
    flap = part(b, "lid", "flap")
    bar(b, flap, mid - along * half, mid + along * half, w - 0.02 - 2 * g, t, normal, "accent")
    b.cylinder(
        flap, mid - (0, w / 2 - 0.006, 0), mid + (0, w / 2 - 0.006, 0), 0.006, None, "accent"
    )
    limit = b.uniform(0.7, 1.2) if abs(normal[2]) > 0.99 else b.uniform(0.5, 0.8)
    b.hinge(flap, "base", mid, (0, 1, 0), -limit, limit, closed=0.0)


CATEGORIES = {"bucket": bucket, "pedal_bin": pedal_bin, "swing_bin": swing_bin}
