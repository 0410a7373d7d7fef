"""Countertop appliances: microwaves, toasters, coffee machines, coffee grinders."""

from __future__ import annotations

import numpy as np

from mam_world import cabinetry as c
from mam_world.kit import Builder
from mam_world.kitchen import appliance_manner, paint_appliance
from mam_world.mech import dial
from mam_world.solids import part, tray


def microwave(b: Builder) -> None:
    """A side-hinged door beside a panel of buttons, or knobs."""
    paint_appliance(b)
    w, d, h = b.uniform(0.42, 0.6), b.uniform(0.3, 0.42), b.uniform(0.24, 0.36)
    b.size(w, d, h)
    m = appliance_manner(b, 0.015, b.uniform(0.015, 0.03))
    m.length, m.opening = 0.7 * h, float(np.radians(b.choice([90, 100, 110, 120])))
    m.handle = b.choice(["bar", "bow", "strip", "none"])
    cell = c.carcass(b, m, w, d, 0.012, h)
    b.feet("base", (0, -w / 2), (d, w / 2), 0.012, "round", "dark", inset=0.02)
    panel, rest = c.cut(
        b, m, cell, d, "y", [b.uniform(0.22, 0.34), 1.0]
    )  # the panel is on the right
    door = c.door(b, m, rest, "left", front="slab")
    low, high = c.front_box(b, m, rest)
    b.box(door, (low[0] - 0.002, low[1] + 0.16 * w, low[2] + 0.15 * h),
          (low[0], high[1] - 0.08 * w, high[2] - 0.15 * h), "screen", "decor")  # fmt: skip
    b.disc("base", (0.5 * d, (rest.y0 + rest.y1) / 2, rest.z0), (0, 0, 1),
           0.35 * min(d, rest.width), 0.008, "glass", "content")  # fmt: skip
    low, high = c.front_box(b, m, panel)
    b.panel("base", low, high, b.choice(["front", "dark"]))
    y, pw = 0.5 * (low[1] + high[1]), high[1] - low[1]
    b.block("base", (low[0] - 0.001, y, high[2] - 0.16 * h), (0.002, 0.75 * pw, 0.12 * h), "screen",
            "decor")  # fmt: skip
    if b.chance(0.4):
        for k in range(2):
            b.rotary("base", (low[0], y, low[2] + (0.25 + 0.3 * k) * h), (-1, 0, 0),
                     min(0.11 * h, 0.3 * pw), 0.02, "metal", f"knob_{k}",
                     np.radians(300))  # fmt: skip
        return
    columns, lines = b.integer(2, 3), b.integer(2, 5)
    for i in range(lines):
        for j in range(columns):
            at = (low[0], low[1] + pw * (0.12 + 0.76 * (j + 0.5) / columns),
                  low[2] + h * (0.06 + 0.6 * (i + 0.5) / lines))  # fmt: skip
            b.button("base", at, (-1, 0, 0), 0.6 * 0.76 * pw / columns, 0.5 * 0.6 * h / lines,
                     0.002, b.choice(["light", "light", "accent"]), "button",
                     bezel=False)  # fmt: skip


def toaster(b: Builder) -> None:
    """Slots above, a lever at the narrow front, a browning knob, sometimes a crumb tray."""
    b.theme(b.choice(["steel", "plastic", "white", "dark"]))
    d, w, h = b.uniform(0.24, 0.36), b.uniform(0.15, 0.22), b.uniform(0.17, 0.22)
    b.size(d, w, h)
    t, foot = 0.012, 0.012
    slots = b.integer(1, 2)
    b.feet("base", (0, -w / 2), (d, w / 2), foot, "round", "dark", inset=0.01)
    tray_h = 0.02
    b.box("base", (0, -w / 2, foot + tray_h), (t, w / 2, h))
    b.box("base", (d - t, -w / 2, foot), (d, w / 2, h))
    for s in (-1, 1):
        b.box("base", (t, min(s * w / 2, s * (w / 2 - t)), foot),
              (d - t, max(s * w / 2, s * (w / 2 - t)), h))  # fmt: skip
        b.box("base", (0, min(s * w / 2, s * (w / 2 - t)), foot),
              (t, max(s * w / 2, s * (w / 2 - t)), foot + tray_h))  # fmt: skip
    b.box("base", (t, -w / 2 + t, foot + tray_h + 0.002), (d - t, w / 2 - t, foot + tray_h + 0.006),
          "dark")  # fmt: skip
    room = w - 2 * t
    rail = 0.3 * room / (slots + 1)
    width = (room - (slots + 1) * rail) / slots
    for k in range(slots + 1):
        y = -room / 2 + k * (rail + width)
        b.box("base", (t, y, h - 0.02), (d - t, y + rail, h), "trim")
    for x0, x1 in ((t, t + 0.03), (d - t - 0.03, d - t)):
        b.box("base", (x0, -room / 2, h - 0.019), (x1, room / 2, h - 0.001), "trim")
    levers = slots if slots == 2 and b.chance(0.4) else 1
    for k in range(levers):
        y = 0.0 if levers == 1 else (k - 0.5) * 0.5 * w
        b.block("base", (-0.0006, y, 0.55 * h), (0.0012, 0.008, 0.5 * h), "dark", "decor")
        lever = b.link(f"lever_{k}", "lever")
        z = 0.78 * h
        b.block(lever, (-0.014, y, z), (0.022, 0.035, 0.014), "dark")
        b.slide(lever, "base", (0, 0, -1), 0.0, b.uniform(0.3, 0.42) * h)
        b.grasp(lever, "push", (-0.014, y, z + 0.007), (0, 0, -1), (0, 1, 0), 0.0)
    y = -0.3 * w
    if b.chance(0.7):
        side = b.choice([-1, 1]) * 0.28 * w
        y = y if side > 0 else -y  # the buttons stand on the other side
        b.rotary("base", (0, side if levers == 1 else 0.0, 0.3 * h), (-1, 0, 0), 0.011, 0.012,
                 "dark", turn=np.radians(270))  # fmt: skip
    if b.chance(0.4) and levers == 1:
        for k in range(b.integer(1, 3)):
            b.button("base", (0, y, 0.36 * h + 0.025 * k), (-1, 0, 0), 0.014, 0.01, 0.002)
    if b.chance(0.4):
        tray = b.link("crumb_tray", "drawer")
        g = max(b.gap, 0.001)
        b.box(tray, (-0.004, -w / 2 + t + g, foot + g), (0.0, w / 2 - t - g, foot + tray_h - g),
              "trim")  # fmt: skip
        b.box(tray, (0.0, -w / 2 + t + g, foot + g), (0.9 * d, w / 2 - t - g, foot + g + 0.003),
              "metal", "drawer_box")  # fmt: skip
        b.slide(tray, "base", (-1, 0, 0), 0.0, 0.6 * d)


def coffee_machine(b: Builder) -> None:
    """A column with a head over a drip tray: buttons, a steam knob, a lid, a portafilter or pot."""
    b.theme(b.choice(["steel", "dark", "plastic", "white"]))
    d, w, h = b.uniform(0.25, 0.42), b.uniform(0.14, 0.32), b.uniform(0.28, 0.42)
    b.size(d, w, h)
    column, foot, head = 0.45 * d, b.uniform(0.04, 0.07), b.uniform(0.28, 0.38) * h
    lid_t = 0.02
    b.box("base", (d - column, -w / 2, foot), (d, w / 2, h - lid_t))
    b.box("base", (0.04, -w / 2, h - head), (d - column, w / 2, h - lid_t))
    t = 0.012
    b.shell("base", (0, -w / 2, 0), (d, w / 2, foot), t, "-x,+z", role="solid")
    g = max(b.gap, 0.001)
    tray = b.link("drip_tray", "drawer")
    b.shell(tray, (0, -w / 2 + t + g, t + g), (d - column, w / 2 - t - g, foot - 0.006), 0.006,
            "+z", "dark", "solid")  # fmt: skip
    for k in range(5):
        y = (k - 2) * 0.15 * w
        b.block(
            tray, (0.5 * (d - column), y, foot - 0.004), (d - column, 0.01, 0.004), "metal", "decor"
        )
    b.slide(tray, "base", (-1, 0, 0), 0.0, b.uniform(0.5, 0.8) * (d - column))
    b.rod("base", (0.16 * d + 0.03, 0, h - head - 0.03), (0.16 * d + 0.03, 0, h - head), 0.02, None,
          "metal")  # fmt: skip
    face = (0.04, 0.0, h - 0.5 * head)
    for k in range(b.integer(1, 4)):
        b.button("base", (face[0], (k - 1.5) * 0.17 * w, face[2]), (-1, 0, 0), 0.09 * w, 0.09 * w,
                 0.002, "light", "button", b.choice(["round", "square"]))  # fmt: skip
    if b.chance(0.6):
        s = b.choice([-1, 1])
        b.rotary("base", (d - 0.5 * column, s * w / 2, 0.7 * h), (0, s, 0), 0.022, 0.03, "dark",
                 turn=np.radians(300))  # fmt: skip
    lid = b.link("lid", "lid")
    b.box(lid, (d - column + g, -w / 2 + g, h - lid_t + g), (d - g, w / 2 - g, h), "front")
    b.hinge(lid, "base", (d - g, 0, h - lid_t + g), (0, 1, 0), 0.0, np.radians(b.choice([70, 90])),
            opens=(0, 0, 1))  # fmt: skip
    b.box("base", (0.04, -w / 2, h - lid_t), (d - column, w / 2, h), "trim")


def coffee_grinder(b: Builder) -> None:
    """A hand coffee grinder: a crank on top; often a drawer in the wooden box."""
    w, h = b.uniform(0.09, 0.14), b.uniform(0.09, 0.15)
    b.size(w, w, 2 * h)
    b.theme(b.choice(("wood", "wood", "steel", "paint")))
    top = h
    if b.chance(0.7):
        g, t = max(b.gap, 0.0008), 0.008
        y, z0, z1 = 0.32 * w, 0.2 * h, 0.62 * h
        b.shell("base", (-w / 2, -w / 2, 0), (w / 2, w / 2, h), t, "-x", "body", "solid")
        b.box("base", (-w / 2, -w / 2 + t, t), (-w / 2 + t, w / 2 - t, z0), "body")
        b.box("base", (-w / 2, -w / 2 + t, z1), (-w / 2 + t, w / 2 - t, h - t), "body")
        for s in (-1, 1):
            b.box("base", (-w / 2, s * y, z0), (-w / 2 + t, s * (w / 2 - t), z1), "body")
        drawer = part(b, "drawer")
        tray(b, drawer, (-w / 2 + 0.001, -y + g, z0 + g), (0.3 * w, y - g, z1 - g), 0.003, "z", 1,
             "inside")  # fmt: skip
        b.box(drawer, (-w / 2 - 0.002, -y + g, z0 + g), (-w / 2 + 0.001, y - g, z1 - g), "trim")
        dial(
            b, drawer, (-w / 2 - 0.002, 0, (z0 + z1) / 2), (-1, 0, 0), 0.007, 0.015, "dome", "metal"
        )
        b.slide(drawer, "base", (-1, 0, 0), 0, b.uniform(0.4, 0.7) * w)
    else:
        with b.moved((0, 0, 0)):
            b.lathe("base",
                    [(0.45 * w, 0), (0.45 * w, 0.3 * h), (0.36 * w, 0.5 * h), (0.36 * w, h)],
                    "body")  # fmt: skip
    bowl = b.uniform(0.3, 0.6) * h
    with b.moved((0, 0, top)):
        b.lathe(
            "base",
            [
                (0.2 * w, 0),
                (0.4 * w, 0.5 * bowl),
                (0.42 * w, 0.7 * bowl),
                (0.3 * w, bowl),
                (0.08 * w, 1.1 * bowl),
            ],
            "metal",
        )
    z = top + 1.1 * bowl
    crank = part(b, "crank")
    reach = b.uniform(0.6, 1.1) * w
    b.cylinder(crank, (0, 0, z + 0.0005), (0, 0, z + 0.02), 0.06 * w, None, "metal")
    b.cylinder(crank, (0, 0, z + 0.02), (0, 0, z + 0.05), 0.03 * w, None, "metal")
    b.sweep(crank, [(0, 0, z + 0.014), (-0.5 * reach, 0, z + 0.022), (-reach, 0, z + 0.014)], 0.003,
            "metal", "handle")  # fmt: skip
    b.cylinder(crank, (-reach, 0, z + 0.012), (-reach, 0, z + 0.04), 0.004, None, "metal", "handle")
    b.sphere(crank, (-reach, 0, z + 0.045), 0.012, "wood", "handle")
    b.spin(crank, "base", (0, 0, z), (0, 0, 1))


CATEGORIES = {
    "microwave": microwave,
    "toaster": toaster,
    "coffee_machine": coffee_machine,
    "coffee_grinder": coffee_grinder,
}
