"""Vessels: kettles, pots, bottles, soap dispensers, jars, coffee grinders."""

from __future__ import annotations

import numpy as np

from mam_world.kit import Builder
from mam_world.mech import dial
from mam_world.solids import TAU, arc, bar, part


def _loop_handle(
    b: Builder, link: str, x: float, z0: float, z1: float, out: float, r: float
) -> None:
    """A D-shaped handle on the +x side between two heights."""
    path = [
        (x, 0, z1),
        (x + 0.8 * out, 0, z1),
        (x + out, 0, z1 - 0.2 * (z1 - z0)),
        (x + out, 0, z0 + 0.3 * (z1 - z0)),
        (x + 0.7 * out, 0, z0),
        (x, 0, z0),
    ]
    b.sweep(link, path, r, "dark", "handle")


def cover(b: Builder, link: str, radius: float, z: float, thick: float, dome: float) -> None:
    """A round lid standing on height z."""
    with b.moved((0, 0, z)):
        b.lathe(
            link,
            [
                (radius, 0),
                (radius, thick),
                (0.75 * radius, thick + 0.6 * dome),
                (0.35 * radius, thick + 0.95 * dome),
                (0, thick + dome),
            ],
            "trim",
        )


def _lifts(b: Builder, lid: str) -> None:
    """A lid that is lifted off: clear of its vessel by its own height, and a little more."""
    tall = float(np.ptp(b.bounds_of(lid)[:, 2]))
    b.slide(lid, "base", (0, 0, 1), 0.0, b.uniform(2.05, 2.4) * tall)


def kettle(b: Builder) -> None:
    """A kettle: a hinged or lifting lid, a rocker switch at the handle, often a base plate."""
    r, h = b.uniform(0.065, 0.09), b.uniform(0.14, 0.22)
    top = r * b.uniform(0.65, 0.95)
    b.size(2.6 * r, 2 * r, h)
    b.theme(b.choice(("steel", "plastic", "white", "dark")))
    z0 = 0.0
    if b.chance(0.6):
        z0 = 0.02
        b.cylinder("base", (0, 0, 0), (0, 0, z0), 1.08 * r, r, "dark")
    with b.moved((0, 0, z0)):
        b.vessel("base", [(r, 0), (r * b.uniform(1.0, 1.08), 0.35 * h), (top, h)], 0.004, "body")
    _loop_handle(b, "base", top - 0.004, z0 + 0.2 * h, z0 + 0.85 * h, 0.05, 0.008)
    spout = [
        (-0.93 * r, 0, z0 + 0.55 * h),
        (-1.25 * r, 0, z0 + 0.75 * h),
        (-1.5 * r, 0, z0 + 0.92 * h),
    ]
    b.sweep("base", spout, 0.014, "body")
    z = z0 + h + max(b.gap, 0.0008)
    lid = part(b, "lid")
    cover(b, lid, top, z, 0.006, b.uniform(0.004, 0.02))
    hinged = b.chance(0.6)
    dial(b, lid, (0, 0, z + 0.004), (0, 0, 1), 0.012, 0.03, b.choice(("plain", "dome", "cone")),
         "dark")  # fmt: skip
    if hinged:
        b.cylinder(lid, (top, -0.015, z), (top, 0.015, z), 0.004, None, "metal")
        b.hinge(lid, "base", (top, 0, z), (0, 1, 0), 0, b.uniform(1.2, 1.65), opens=(0, 0, 1))
    else:
        _lifts(b, lid)
    if z0 and b.chance(0.8):
        switch = part(b, "switch")
        x = 1.05 * r + 0.012
        b.box("base", (0.7 * r, -0.012, z0), (x + 0.012, 0.012, z0 + 0.012), "dark")
        b.cylinder(switch, (x, -0.006, z0 + 0.014), (x, 0.006, z0 + 0.014), 0.003, None, "accent")
        bar(b, switch, (x, 0, z0 + 0.014), (x + 0.022, 0, z0 + 0.024), 0.012, 0.003, (-0.4, 0, 1),
            "accent", "handle")  # fmt: skip
        b.hinge(switch, "base", (x, 0, z0 + 0.014), (0, 1, 0), 0, 0.3, opens=(0, 0, -1),
                tip=(x + 0.02, 0, z0 + 0.024))  # fmt: skip


def pot(b: Builder) -> None:
    """A pot or pan with a lid that lifts off or swings up at the rim."""
    r = b.uniform(0.08, 0.16)
    h = r * b.uniform(0.45, 1.3)
    b.size(2.4 * r, 2 * r, h)
    b.theme(b.choice(("steel", "dark", "paint")))
    b.vessel("base", [(0.92 * r, 0), (r, 0.08 * h), (r, h)], b.uniform(0.002, 0.005), "body")
    z = h + max(b.gap, 0.0008)
    style = b.choice(("two", "two", "long"))
    if style == "long":
        bar(b, "base", (-0.97 * r, 0, 0.85 * h), (-2.2 * r, 0, 0.85 * h + 0.02), 0.022, 0.012,
            material="dark", role="handle")  # fmt: skip
    else:
        for s in (-1, 1):
            if b.chance(0.5):
                b.sweep(
                    "base",
                    arc(
                        (0, s * 0.97 * r, 0.8 * h),
                        0.25 * r,
                        0 if s > 0 else np.pi,
                        np.pi if s > 0 else TAU,
                        9,
                        "z",
                    ),
                    0.006,
                    "metal",
                    "handle",
                )
            else:
                b.block(
                    "base", (0, s * (r + 0.015), 0.8 * h), (0.5 * r, 0.04, 0.012), "dark", "handle"
                )
    lid = part(b, "lid")
    cover(b, lid, 1.02 * r, z, 0.004, b.uniform(0.05, 0.3) * r)
    dome = max(float(p.shape.vertices[:, 2].max()) for p in b.pieces if p.link == b.index(lid))
    if b.chance(0.7):
        dial(b, lid, (0, 0, dome - 0.003), (0, 0, 1), 0.018, 0.035,
             b.choice(("plain", "dome", "cone")))  # fmt: skip
    else:
        b.sweep(lid, arc((0, 0, dome - 0.006), 0.035, 0, np.pi, 9, "x"), 0.005, "dark", "handle")
    if b.chance(0.35):
        half = 0.27 * r  # of the barrel: shorter, it would hardly touch its line
        b.block("base", (1.05 * r + 0.006, 0, z - 0.0105), (0.02, 2 * half, 0.02), "metal")
        b.cylinder(lid, (1.05 * r + 0.006, -half, z + 0.002), (1.05 * r + 0.006, half, z + 0.002),
                   0.004, None, "metal")  # fmt: skip
        b.hinge(lid, "base", (1.05 * r + 0.006, 0, z + 0.002), (0, 1, 0), 0, b.uniform(1.2, 1.7),
                opens=(0, 0, 1))  # fmt: skip
    else:
        _lifts(b, lid)


def bottle(b: Builder) -> None:
    """A bottle with a screw cap, a stopper or a pump head."""
    r, h = b.uniform(0.025, 0.05), b.uniform(0.12, 0.3)
    neck, tall = r * b.uniform(0.3, 0.5), b.uniform(0.08, 0.3) * h
    b.size(2 * r, 2 * r, h)
    b.theme(b.choice(("plastic", "paint", "dark")))
    shoulder = h - tall - r * b.uniform(0.4, 1.0)
    body = "glass" if b.chance(0.4) else "body"
    b.vessel(
        "base",
        [
            (r, 0),
            (r, shoulder),
            (0.85 * r, shoulder + 0.3 * (h - tall - shoulder)),
            (neck, h - tall),
            (neck, h),
        ],
        0.0018,
        body,
    )
    if b.chance(0.6):
        b.tube("base", (0, 0, 0.25 * shoulder), (0, 0, 0.8 * shoulder), 1.012 * r, 0.99 * r,
               "light", "decor", False)  # fmt: skip
    b.torus("base", (0, 0, h - 0.95 * tall), (0, 0, 1), neck, 0.0015, body, "decor", False)
    z, style = h + max(b.gap, 0.0005), b.choice(("cap", "cap", "sport", "stopper"))
    if style == "stopper":
        cork = part(b, "lid", "stopper")
        b.cylinder(cork, (0, 0, h - min(0.5 * tall, 0.02)), (0, 0, h + 0.002),
                   0.9 * (neck - 0.0018), None, "wood")  # fmt: skip
        b.cylinder(cork, (0, 0, h + 0.001), (0, 0, h + 0.014), 1.1 * neck, None, "wood", "handle")
        b.slide(cork, "base", (0, 0, 1), 0, min(0.5 * tall, 0.02))
        return
    cap = part(b, "lid", "cap")
    ch = min(0.6 * tall, 0.025)
    b.tube(cap, (0, 0, h - 0.7 * ch), (0, 0, z), neck + 0.0045, (neck + 0.0006) * 1.05, "accent",
           "handle")  # fmt: skip
    b.cylinder(cap, (0, 0, z), (0, 0, z + 0.3 * ch), neck + 0.0045, None, "accent", "handle")
    for t in np.arange(b.choice((0, 10, 14))) * TAU / 14:
        c, s = (neck + 0.0045) * np.cos(t), (neck + 0.0045) * np.sin(t)
        b.cylinder(cap, (c, s, h - 0.7 * ch), (c, s, z), 0.0008, None, "accent", "handle", False)
    if style == "sport":
        b.cylinder(cap, (0, 0, z), (0, 0, z + 0.9 * ch), 0.5 * neck, 0.4 * neck, "light", "handle")
    if b.chance(0.75):
        b.spin(cap, "base", (0, 0, h), (0, 0, 1))
    else:
        b.slide(cap, "base", (0, 0, 1), 0, 0.7 * ch)


def dispenser(b: Builder) -> None:
    """A soap dispenser: a pump head that presses down, often turning as well."""
    r, h = b.uniform(0.028, 0.045), b.uniform(0.1, 0.18)
    b.size(2.4 * r, 2 * r, 1.4 * h)
    b.theme(b.choice(("plastic", "steel", "white", "paint")))
    neck = 0.35 * r
    if b.chance(0.5):
        b.lathe("base", [(r, 0), (r, 0.85 * h), (neck, h)], b.choice(("body", "glass", "stone")))
    else:
        b.box("base", (-r, -r * 0.9, 0), (r, r * 0.9, 0.92 * h), b.choice(("body", "glass")))
        b.cylinder("base", (0, 0, 0.92 * h), (0, 0, h), neck, None)
    b.cylinder("base", (0, 0, 0.99 * h), (0, 0, h + 0.008), neck * 1.2, None, "trim")
    stem, travel = 0.4 * neck, b.uniform(0.008, 0.018)
    z0 = h + 0.008
    b.tube("base", (0, 0, z0), (0, 0, z0 + travel + 0.004), neck, stem * 1.25, "trim")
    head = part(b, "pump")
    top = z0 + 2 * travel + 0.006
    # the stem hangs inside a tube: it ends above the solid body by its travel
    b.cylinder(head, (0, 0, z0 + travel + 0.0005), (0, 0, top), stem, None, "metal")
    b.cylinder(head, (0, 0, top), (0, 0, top + 0.012), neck * 1.1, neck, "metal", "handle")
    out = r * b.uniform(0.9, 1.6)
    b.sweep(
        head,
        [
            (0, 0, top + 0.006),
            (-0.8 * out, 0, top + 0.008),
            (-out, 0, top + 0.004),
            (-out - 0.002, 0, top - 0.004),
        ],
        0.3 * neck,
        "metal",
        "handle",
    )
    b.slide(head, "base", (0, 0, -1), 0, travel)


def jar(b: Builder) -> None:
    """A jar: a screw lid, a lift-off lid with a knob, or a clip-top lid on a wire hinge."""
    r = b.uniform(0.035, 0.07)
    h = r * b.uniform(1.2, 3.2)
    b.size(2 * r, 2 * r, h)
    b.vessel("base",
             [(0.95 * r, 0), (r, 0.06 * h), (r, 0.85 * h), (0.85 * r, 0.93 * h), (0.85 * r, h)],
             0.003, b.choice(("glass", "glass", "body", "stone")))  # fmt: skip
    style, g = b.choice(("screw", "lift", "clip")), max(b.gap, 0.0006)
    lid, z = part(b, "lid"), h + max(b.gap, 0.0006)
    if style == "screw":
        b.tube(lid, (0, 0, h - min(0.01, 0.055 * h)), (0, 0, z), 0.96 * r, 0.9 * r + g * 0.5,
               "metal", "handle")  # fmt: skip
        b.cylinder(lid, (0, 0, z), (0, 0, z + 0.003), 0.92 * r, None, b.choice(("metal", "accent")),
                   "handle")  # fmt: skip
        b.spin(lid, "base", (0, 0, h), (0, 0, 1))
    elif style == "lift":
        cover(b, lid, 0.95 * r, z, 0.005, b.uniform(0.0, 0.2) * r)
        b.cylinder(lid, (0, 0, h - 0.008), (0, 0, z), 0.72 * r, None, "trim")
        b.sphere(lid, (0, 0, z + 0.22 * r + 0.01), 0.16 * r, b.choice(("trim", "wood", "metal")),
                 "handle")  # fmt: skip
        b.cylinder(lid, (0, 0, z), (0, 0, z + 0.22 * r + 0.004), 0.08 * r, None, "metal")
        _lifts(b, lid)
    else:
        with b.moved((0, 0, z)):
            b.lathe(lid, [(0.9 * r, 0), (0.9 * r, 0.006), (0.7 * r, 0.012), (0, 0.014)], "glass")
        x = 0.92 * r
        b.box("base", (0.8 * r, -0.3 * r, h - 0.004), (x + 0.002, 0.3 * r, z - 0.0014), "metal")
        b.cylinder(lid, (x, -0.3 * r, z + 0.001), (x, 0.3 * r, z + 0.001), 0.0022, None, "metal")
        b.block(lid, (0.88 * r, 0, z + 0.0035), (0.1 * r, 0.3 * r, 0.003), "metal")
        b.torus("base", (0, 0, 0.93 * h - 0.004), (0, 0, 1), 0.87 * r, 0.0015, "metal", "decor")
        b.hinge(lid, "base", (x, 0, z + 0.001), (0, 1, 0), 0, b.uniform(1.5, 2.0), opens=(0, 0, 1))


CATEGORIES = {
    "kettle": kettle,
    "pot": pot,
    "bottle": bottle,
    "dispenser": dispenser,
    "jar": jar,
}
