"""Safes, boxes and chests with lids, toilets, printers."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from mam_world import cabinetry as c
from mam_world import shapes
from mam_world.kit import Builder


def safe(b: Builder) -> None:
    """A thick door with a combination dial, a lever, a wheel or a key pad."""
    b.theme(b.choice(["dark", "steel", "paint"]))
    w, d, h = b.uniform(0.28, 0.6), b.uniform(0.25, 0.55), b.uniform(0.25, 0.9)
    b.size(w, d, h)
    front = b.uniform(0.03, 0.05)
    m = c.Manner(b.uniform(0.025, 0.045), front, b.chance(0.6), "none", "none", 0.12, "slab",
                 "slab", float(np.radians(b.choice([90, 110]))))  # fmt: skip
    low = b.choice([0.0, 0.02])
    if low:
        b.feet("base", (0, -w / 2), (d, w / 2), low, "round", "dark")
    cell = c.carcass(b, m, w, d, low, h)
    side = b.choice(["left", "right"])
    door = c.door(b, m, cell, side, handle="none")
    s = 1.0 if side == "left" else -1.0  # towards the hinge
    x, z = m.face, 0.5 * (low + h)
    unit = 0.5 * min(w, h)
    kinds = b.choice(
        [
            ("dial", "lever"),
            ("wheel", "dial"),
            ("pad", "lever"),
            ("dial", "handle"),
            ("pad", "knob"),
        ]
    )
    for kind, (y, dz) in zip(
        kinds, ((-0.1 * s, 0.12 if h > w else 0.0), (0.35 * s, -0.25 if h > w else 0))
    ):
        if kind == "dial":  # it must not meet the carcass when the door stands open
            y = s * min(s * y, 0.24)
        at = (x, y * w * 0.8, z + dz * h)
        if kind == "dial":
            b.rotary(door, at, (-1, 0, 0), 0.17 * unit, 0.03, "metal", "dial", np.inf)
        elif kind == "knob":
            b.rotary(door, at, (-1, 0, 0), 0.12 * unit, 0.03, "dark", "knob", np.pi / 2)
        elif kind == "wheel":
            _spokes(b, door, at, 0.3 * unit)
        elif kind == "lever":
            _lever(b, door, at, -s, 0.35 * unit)
        elif kind == "handle":
            b.handle(door, at, (-1, 0, 0), (0, 0, 1), 0.5 * unit, "bar", "metal")
        else:
            _pad(b, door, at, 0.3 * unit)
    if b.chance(0.5):
        c.shelves(b, m, cell, d, 1)


def _spokes(b: Builder, door: str, at: tuple[float, float, float], radius: float) -> None:
    """A hub with three to five spokes that turns about the door's normal."""
    wheel, g = b.link("wheel", "wheel"), max(0.2 * b.gap, 0.0005)
    n = b.integer(3, 5)
    with b.facing(at, (-1, 0, 0)):
        b.cylinder(wheel, (0, 0, g), (0, 0, 0.05), 0.2 * radius, None, "metal")
        for k in range(n):
            u = np.array([np.cos(2 * np.pi * k / n), np.sin(2 * np.pi * k / n), 0])
            b.rod(wheel, 0.1 * radius * u + [0, 0, 0.04], radius * u + [0, 0, 0.04], 0.08 * radius,
                  None, "metal", "handle")  # fmt: skip
            b.sphere(wheel, radius * u + [0, 0, 0.04], 0.13 * radius, "dark", "handle")
        if b.chance(0.4):
            b.torus(wheel, (0, 0, 0.04), (0, 0, 1), 0.85 * radius, 0.07 * radius, "metal", "handle")
        b.spin(wheel, door, (0, 0, 0), (0, 0, 1))
        b.grasp(wheel, "rim", (0.85 * radius, 0, 0.04), (0, 0, -1), (1, 0, 0), 0.16 * radius)


def _lever(
    b: Builder, door: str, at: tuple[float, float, float], way: float, length: float
) -> None:
    """A lever pointing sideways that turns down."""
    lever, g = b.link("lever", "handle"), max(0.2 * b.gap, 0.0005)
    x, y, z = at
    r = max(0.06 * length, 0.005)
    b.rod(lever, (x - g, y, z), (x - 0.04, y, z), 1.6 * r, None, "metal", "handle")
    b.rod(lever, (x - 0.035, y, z), (x - 0.035, y + way * length, z), r, None, "metal", "handle")
    b.grasp(lever, "handle", (x - 0.035, y + 0.7 * way * length, z), (1, 0, 0), (0, 0, 1), 2 * r)
    b.hinge(
        lever, door, (x, y, z), (1, 0, 0), 0.0, np.radians(b.choice([45, 90])), opens=(0, 0, -1)
    )


def _pad(b: Builder, door: str, at: tuple[float, float, float], size: float) -> None:
    """A key pad of nine or twelve buttons on a plate."""
    x, y, z = at
    rows = b.integer(3, 4)
    b.block(door, (x - 0.003, y, z), (0.006, size, 1.25 * size), "dark", "decor")
    for i in range(rows):
        for j in range(3):
            b.button(door,
                     (x - 0.006, y + (j - 1) * 0.28 * size, z + (i - (rows - 1) / 2) * 0.28 * size),
                     (-1, 0, 0), 0.2 * size, 0.18 * size, 0.0015, "light", "key",
                     bezel=False)  # fmt: skip


def box_with_lid(b: Builder) -> None:
    """A box or chest: its lid is flat, framed or arched and hinged at the rear edge."""
    w, d, h = b.uniform(0.15, 0.9), b.uniform(0.1, 0.55), b.uniform(0.08, 0.5)
    b.size(w, d, h)
    t, g = min(b.uniform(0.008, 0.02), 0.08 * min(w, d, h)), b.gap
    b.shell("base", (0, -w / 2, 0), (d, w / 2, h), t, "+z")
    if b.chance(0.3):
        for z in (0.15 * h, 0.85 * h):
            b.box("base", (-0.004, -w / 2 + t, z - 0.02 * h), (0, w / 2 - t, z + 0.02 * h), "metal",
                  "decor")  # fmt: skip
    lid = b.link("lid", "lid")
    kind = b.choice(["flat", "deep", "arched", "overhang"])
    z = h + g
    if kind == "arched":
        n = 9 if b.style.tessellation != "dense" else 17
        a = np.linspace(0, np.pi, n)
        rise = b.uniform(0.25, 0.5) * d
        outer = np.stack([d / 2 - d / 2 * np.cos(a), rise * np.sin(a)], axis=1)
        inner = np.stack([d / 2 - (d / 2 - t) * np.cos(a), (rise - t) * np.sin(a)], axis=1)
        with b.facing((0, w / 2, z), (0, -1, 0), (1, 0, 0)):
            b.extrude(lid, np.concatenate([outer, inner[::-1]]), w, "front")
            for at in (0.0, w - t):
                with b.moved((0, 0, at)):
                    b.extrude(lid, outer, t, "front")
        top = z + 0.1 * rise
    elif kind == "deep":
        tall = b.uniform(0.15, 0.45) * h
        b.shell(lid, (0, -w / 2, z), (d, w / 2, z + tall), t, "-z", "front")
        top = z + 0.5 * tall
    else:
        reach = b.uniform(0.0, 0.02) if kind == "overhang" else 0.0
        b.panel(lid, (-reach, -w / 2 - reach, z), (d, w / 2 + reach, z + t), "front")
        top = z + 0.5 * t
    front, _, under = b.bounds_of(lid)[0]
    if b.chance(0.6):
        b.handle(lid, (front, 0, top), (-1, 0, 0), (0, 1, 0), min(0.3 * w, 0.12),
                 b.choice(["knob", "bar", "bow", "strip", "ring"]))  # fmt: skip
    pin = z if b.chance(0.7) else under
    b.hinge(lid, "base", (d, 0, pin), (0, 1, 0), 0.0, np.radians(b.choice([75, 90, 100, 110])),
            opens=(0, 0, 1))  # fmt: skip
    if b.chance(0.35):
        for s in (-1, 1):
            b.handle("base", (d / 2, s * w / 2, 0.6 * h), (0, s, 0), (1, 0, 0), min(0.4 * d, 0.15),
                     b.choice(["bow", "bar"]))  # fmt: skip


def toilet(b: Builder) -> None:
    """A bowl with seat and cover hinged behind, a tank with a button or a lever, maybe a lid."""
    b.theme("white")
    w, d, h = b.uniform(0.34, 0.42), b.uniform(0.6, 0.75), b.uniform(0.38, 0.44)
    b.size(w, d, 2 * h)
    tank_d, tank_w, tank_h = b.uniform(0.14, 0.2), b.uniform(0.34, 0.48), b.uniform(0.3, 0.42)
    front = d - tank_d - 0.03  # length of the bowl
    n = max(b.segments(0.3 * b.diagonal), 20)
    a = np.linspace(0, 2 * np.pi, n, endpoint=False)
    length, middle = 0.92 * front, 0.48 * front
    outline = np.stack([middle + 0.5 * length * np.cos(a), 0.5 * w * np.sin(a)], axis=1)
    hole = np.stack([middle - 0.03 + 0.33 * length * np.cos(a), 0.3 * w * np.sin(a)], axis=1)
    tall = h - 0.04
    levels = [(0.45, 0.0), (0.42, 0.3), (0.6, 0.55), (0.95, 0.85), (1.0, 1.0)]
    for (s0, z0), (s1, z1) in pairwise(levels):
        _loft(b, "base", outline, s0, s1, z0 * tall, z1 * tall, (middle + 0.06, 0.0))
    b.box("base", (middle, -0.3 * w, 0), (d - 0.03, 0.3 * w, 0.85 * tall))
    b.box("base", (front - 0.05, -0.45 * w, 0.85 * tall), (d, 0.45 * w, h))
    _ring(b, "base", outline, hole, tall, h)
    g, t = max(b.gap * 0.3, 0.0005), b.uniform(0.014, 0.02)
    back = middle + 0.5 * length - 0.02
    pin = (front - 0.055, 0.0)
    seat = b.link("seat", "lid")
    keep = outline[:, 0] < pin[0]
    rim = np.where(keep[:, None], outline, np.stack([np.full(n, pin[0]), outline[:, 1]], axis=1))
    _ring(b, seat, np.minimum(rim, [back, w]), hole, h + g, h + g + t, "light")
    b.hinge(
        seat,
        "base",
        (pin[0], 0, h + g + t),  # above, or its back would run into the raised cover
        (0, 1, 0),
        0.0,
        np.radians(b.choice([70, 75, 80])),
        opens=(0, 0, 1),
        ajar=False,
    )
    if b.chance(0.8):
        cover = b.link("cover", "lid")
        z = h + 2 * g + t
        with b.moved((0, 0, z)):
            b.extrude(
                cover, np.unique(np.round(rim, 6), axis=0)[_hull_order(rim)], 0.8 * t, "light"
            )
        # on the seat when closed: it must be up wherever the seat is to move
        b.hinge(cover, "base", (pin[0], 0, z), (0, 1, 0), 0.0, np.radians(97), opens=(0, 0, 1),
                rest=np.radians(97), ajar=False)  # fmt: skip
    _tank(b, d - tank_d, d, tank_w, h, tank_h)


def _hull_order(rim: np.ndarray) -> np.ndarray:
    from scipy.spatial import ConvexHull

    return ConvexHull(np.unique(np.round(rim, 6), axis=0)).vertices


def _loft(b: Builder, link: str, outline: np.ndarray, s0: float, s1: float, z0: float, z1: float,
          centre: tuple[float, float]) -> None:  # fmt: skip
    """A convex band between two scaled copies of an outline."""
    from mam_world import collide

    mid = np.asarray(centre)
    low, high = mid + s0 * (outline - mid), mid + s1 * (outline - mid)
    n = len(outline)
    stack = np.stack([np.c_[low, np.full(n, z0)], np.c_[high, np.full(n, z1)]])
    piece = collide.rings(stack)
    vertices = stack.reshape(-1, 3)
    b.add(link, shapes.Shape(vertices, np.asarray(piece.faces), vertices[:, :2].copy()), [piece])


def _ring(b: Builder, link: str, outer: np.ndarray, inner: np.ndarray, z0: float, z1: float,
          material: str = "body") -> None:  # fmt: skip
    """A flat ring between two outlines of as many points."""
    from mam_world import collide

    n = len(outer)
    loops = [
        np.c_[p, np.full(n, z)] for p, z in ((outer, z0), (outer, z1), (inner, z1), (inner, z0))
    ]
    vertices = np.concatenate(loops)
    faces = shapes.grid_faces(4, n, True, True)
    step = max(1, n // 12)
    cuts = list(range(0, n, step))
    pieces = []
    for k, i in enumerate(cuts):
        j = cuts[(k + 1) % len(cuts)]
        quad = np.array([outer[i], outer[j], inner[j], inner[i]])
        pieces.append(collide.rings(np.stack([np.c_[quad, np.full(4, z)] for z in (z0, z1)])))
    b.add(link, shapes.oriented(vertices, faces), pieces, material)


def _tank(b: Builder, x0: float, x1: float, width: float, z: float, tall: float) -> None:
    """The cistern with its lid and what one flushes with."""
    b.box("base", (x0, -width / 2, z), (x1, width / 2, z + tall - 0.02))
    top = z + tall
    b.box("base", (x0 - 0.01, -width / 2 - 0.01, top - 0.02), (x1, width / 2 + 0.01, top))
    middle = 0.5 * (x0 + x1)
    kind = b.choice(["button", "two", "lever"])
    if kind == "lever":
        y, at = 0.35 * width, z + 0.8 * tall
        lever = b.link("lever", "lever")
        g = max(b.gap * 0.2, 0.0005)
        b.rod(lever, (x0 - g, y, at), (x0 - 0.02, y, at), 0.012, None, "metal")
        b.box(lever, (x0 - 0.026, y - 0.08, at - 0.007), (x0 - 0.016, y, at + 0.007), "metal",
              "handle")  # fmt: skip
        b.hinge(lever, "base", (x0, y, at), (1, 0, 0), 0.0, np.radians(30), opens=(0, 0, -1))
        b.grasp(lever, "push", (x0 - 0.02, y - 0.07, at + 0.007), (0, 0, -1), (1, 0, 0), 0.0)
        return
    count = 1 if kind == "button" else 2
    for k in range(count):
        y = 0.0 if count == 1 else (k - 0.5) * 0.035
        b.button("base", (middle, y, top), (0, 0, 1), 0.05 if count == 1 else 0.03,
                 0.05 if count == 1 else 0.03, 0.004, "metal", "flush",
                 "round" if count == 1 else "square")  # fmt: skip


def printer(b: Builder) -> None:
    """A body with a scanner lid, paper drawer, output tray flap and buttons."""
    b.theme(b.choice(["white", "dark", "plastic"], [0.5, 0.4, 0.1]))
    w, d, h = b.uniform(0.36, 0.5), b.uniform(0.3, 0.42), b.uniform(0.16, 0.32)
    b.size(w, d, h)
    t, g = 0.012, b.gap
    drawer_h, slot_h = 0.28 * h, 0.22 * h
    z1 = 0.004 + drawer_h
    b.shell("base", (0, -w / 2, 0), (d, w / 2, z1), t, "-x", role="solid")
    b.box("base", (0.45 * d, -w / 2, z1), (d, w / 2, z1 + slot_h))
    for s in (-1, 1):
        b.box("base", (0, min(s * w / 2, s * 0.42 * w), z1),
              (0.45 * d, max(s * w / 2, s * 0.42 * w), z1 + slot_h))  # fmt: skip
    scan = 0.09 * h if b.chance(0.8) else 0.0
    top = h - scan - g
    b.box("base", (0, -w / 2, z1 + slot_h), (d, w / 2, top))
    tray = b.link("paper_tray", "drawer")
    y1 = w / 2 - t - max(g, 0.001)
    b.panel(tray, (-0.01, -y1, t + max(g, 0.001)), (0.006, y1, z1 - t - max(g, 0.001)), "front")
    b.drawer_box(
        tray, (0.006, -y1 + 0.003, t + max(g, 0.001)), (0.88 * d, y1 - 0.003, z1 - t - 0.01), 0.004
    )
    b.handle(tray, (-0.01, 0, 0.5 * z1), (-1, 0, 0), (0, 1, 0), 0.12,
             b.choice(["recessed", "cup", "none"]))  # fmt: skip
    b.slide(tray, "base", (-1, 0, 0), 0.0, b.uniform(0.5, 0.75) * d)
    b.box("base", (0.02, -0.4 * w, z1), (0.44 * d, 0.4 * w, z1 + 0.004), "light", "content")
    if scan:
        lid = b.link("lid", "lid")
        b.box(lid, (0.01, -w / 2 + 0.004, h - scan), (d - 0.01, w / 2 - 0.004, h), "front")
        b.hinge(lid, "base", (d - 0.01, 0, h - scan), (0, 1, 0), 0.0,
                np.radians(b.choice([60, 75, 90])), opens=(0, 0, 1))  # fmt: skip
    z = z1 + slot_h + 0.5 * (top - z1 - slot_h)
    size = min(0.35 * (top - z1 - slot_h), 0.016)
    b.block("base", (-0.001, 0, z), (0.002, 0.12, 1.6 * size), "screen", "decor")
    for k in range(b.integer(1, 6)):
        b.button("base", (0, -0.1 - 0.026 * k if k < 3 else 0.1 + 0.026 * (k - 3), z), (-1, 0, 0),
                 size, size, 0.002, b.choice(["light", "accent", "green"]),
                 shape=b.choice(["round", "square"]))  # fmt: skip


CATEGORIES = {"safe": safe, "box_with_lid": box_with_lid, "toilet": toilet, "printer": printer}
