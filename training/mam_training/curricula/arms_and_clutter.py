"""Abstract objects for training: heads on jointed arms, and movers amid things that stay."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from mam_pipeline.types import FloatArray
from mam_training.curricula.cases import case, console, lidded
from mam_training.curricula.mechanisms import clump, mechanism
from mam_training.curricula.openings import opening
from mam_training.curricula.slides_and_turns import tracks
from mam_world.kit import Builder

WITHIN: tuple[Callable[[Builder], None], ...] = (
    case, case, console, lidded, mechanism, tracks, opening,
)  # fmt: skip


def clutter(b: Builder) -> None:
    """Another abstract object with things that stay on it, beside it, under it and behind it."""
    WITHIN[b.integer(0, len(WITHIN) - 1)](b)
    points = np.concatenate([p.shape.vertices for p in b.pieces])
    low, high = points.min(axis=0), points.max(axis=0)
    size = high - low
    moving = [
        (v.min(axis=0), v.max(axis=0)) for v in (p.shape.vertices for p in b.pieces if p.link)
    ]
    if b.chance(0.3):
        b.box("base", low - (*(b.uniform(0.1, 0.5) * size[:2]), 0.04 * size[2]),
              (*(high[:2] + b.uniform(0.1, 0.5) * size[:2]), low[2]))  # fmt: skip
    if b.chance(0.25):
        back = high[0] + max(b.gap, 5e-4)
        b.box("base", (back, low[1] - b.uniform(0, 0.5) * size[1], low[2]),
              (back + 0.05 * size[0], high[1], high[2] + b.uniform(0, 0.5) * size[2]))  # fmt: skip
    for _ in range(b.integer(1, 8)):
        own = size * b.rng.uniform(0.04, 0.3, 3)
        own[2] = b.uniform(0.5, 1.5) * own[:2].mean() * b.choice((0.3, 1.0, 2.0))
        where = b.choice(("top", "top", "side", "floor"))
        at = low + b.rng.uniform(0, 1, 3) * (size - own)
        if where == "top":
            at[2] = _support(b, at, own, low[2]) + b.choice((0.0, 5e-4))
        else:
            at[1] = high[1] + b.uniform(0.02, 0.4) * size[1]
            at[2] = low[2] if where == "floor" else low[2] + b.uniform(0, 0.8) * size[2]
            if where == "side":  # on a bracket
                b.box("base", (at[0], high[1], at[2] - 0.02 * size[2]),
                      (at[0] + own[0], at[1] + own[1], at[2]))  # fmt: skip
        box = at, at + own
        if any(np.all(box[0] < z) and np.all(a < box[1]) for a, z in moving):
            continue
        _thing(b, *box)


def _support(b: Builder, at: FloatArray, own: FloatArray, floor: float) -> float:
    """How high the fixed pieces are under a footprint."""
    top = floor
    for piece in b.pieces:
        v = piece.shape.vertices
        low, high = v.min(axis=0), v.max(axis=0)
        if piece.link == 0 and np.all(low[:2] < (at + own)[:2]) and np.all(at[:2] < high[:2]):
            top = max(top, float(high[2]))
    return top


def _thing(b: Builder, low: FloatArray, high: FloatArray) -> None:
    """Something that stands about: books, a pot, a block, a bottle, a plant."""
    size, middle = high - low, (low + high) / 2
    r = float(size[:2].min()) / 2
    kind = b.choice(("books", "pot", "clump", "bottle", "plant", "box"))
    if kind == "books":
        n = b.integer(2, 5)
        for k in range(n):
            step = size[1] / n
            y = low[1] + k * step
            b.box("base", (low[0], y, low[2]),
                  (high[0], y + 0.92 * step, low[2] + size[2] * b.uniform(0.7, 1)))  # fmt: skip
    elif kind in ("pot", "bottle", "plant"):
        with b.moved((middle[0], middle[1], low[2])):
            if kind == "pot":
                b.vessel("base", [(0.8 * r, 0), (r, size[2])], 0.12 * r)
            elif kind == "bottle":
                b.lathe("base", [(r, 0), (r, 0.6 * size[2]), (0.3 * r, 0.8 * size[2]),
                                 (0.3 * r, size[2])])  # fmt: skip
            else:
                b.cylinder("base", (0, 0, 0), (0, 0, 0.4 * size[2]), 0.6 * r, 0.8 * r)
                b.sphere("base", (0, 0, 0.7 * size[2]), min(r, 0.4 * size[2]))
    elif kind == "clump":
        clump(b, "base", low, high, 3)
    else:
        b.box("base", low, high)


def arm(b: Builder) -> None:
    """A mount that carries a head on a fixed or jointed arm: lamps, cameras, signs, barriers."""
    s = b.uniform(0.05, 0.3)
    b.size(4 * s, 4 * s, 4 * s)
    b.theme()
    tilt = b.choice((0.0, 0.0, np.pi / 2, -np.pi / 2, np.pi))  # floor, walls, ceiling
    with b.moved((0, 0, 0), (0, 1, 0), tilt):
        tall = _mount(b, s)
        pan = b.link("pan", "part") if b.chance(0.25) else ""
        carrier = pan or "base"
        if pan:
            hub = b.uniform(0.15, 0.4) * s
            top = tall + b.uniform(0.2, 0.8) * s
            b.cylinder(pan, (0, 0, tall + max(b.gap, 5e-4)), (0, 0, top), hub)
            tall = top
        lean, reach = b.uniform(-0.8, 0.8), b.uniform(0.0, 2.0) * s
        with b.moved((0, 0, tall), (0, 1, 0), lean):
            if reach > 0.3 * s:
                b.cylinder(carrier, (0, 0, -0.05 * s), (0, 0, reach), b.uniform(0.05, 0.15) * s)
            end = b.point((0, 0, reach if reach > 0.3 * s else 0))
        if pan:
            b.spin(pan, "base", (0, 0, tall), (0, 0, 1), -np.pi, np.pi)
    turn = b.uniform(-np.pi, np.pi) * b.choice((0.0, 1.0))
    with b.moved(end, (0, 0, 1), turn):
        _head(b, carrier, s)


def _mount(b: Builder, s: float) -> float:
    """Foot, plate, clamp or post around the origin; returns its height."""
    kind = b.choice(("disc", "plate", "post", "box"))
    tall = b.uniform(0.05, 0.3) * s
    if kind == "disc":
        b.disc("base", (0, 0, 0), (0, 0, 1), b.uniform(0.3, 1.2) * s, tall)
    elif kind == "plate":
        b.block("base", (0, 0, tall / 2), (b.uniform(0.5, 2) * s, b.uniform(0.5, 2) * s, tall))
    elif kind == "box":
        tall = b.uniform(0.4, 2) * s
        clump(b, "base", np.array([-0.5 * s, -0.5 * s, 0]), np.array([0.5 * s, 0.5 * s, tall]), 2)
    else:
        b.disc("base", (0, 0, 0), (0, 0, 1), b.uniform(0.4, 1) * s, tall)
        top = tall + b.uniform(1, 5) * s
        b.cylinder("base", (0, 0, tall), (0, 0, top), b.uniform(0.06, 0.25) * s)
        tall = top
        if b.chance(0.4):  # lamps or signs that stay
            for z in np.linspace(0.5, 0.9, b.integer(1, 3)) * tall:
                b.block("base", (0.2 * s, 0, z), (0.3 * s, b.uniform(0.3, 0.9) * s, 0.35 * s))
    return tall


def _head(b: Builder, carrier: str, s: float) -> None:
    """What tips about local y at the origin: in a yoke, on a pin, beside a cheek."""
    link = b.link("head", "part")
    held = b.choice(("yoke", "pin", "cheek", "ball"))
    r = b.uniform(0.06, 0.2) * s
    half = b.uniform(0.15, 0.6) * s
    owner = b.choice((link, carrier))
    if held == "yoke":
        for y in (-half, half):
            b.box(carrier, (-r, y - 0.3 * r, -2 * r), (r, y + 0.3 * r, 1.2 * r))
        b.box(carrier, (-r, -half, -2.4 * r), (r, half, -1.6 * r))
        b.cylinder(owner, (0, -half, 0), (0, half, 0), 0.5 * r)
    elif held == "pin":
        b.cylinder(owner, (0, -1.5 * r, 0), (0, 1.5 * r, 0), r)
    elif held == "cheek":
        b.box(carrier, (-r, half, -2 * r), (r, half + 0.6 * r, r))
        b.cylinder(owner, (0, -0.2 * half, 0), (0, half + r, 0), 0.5 * r)
    else:
        b.sphere(owner, (0, 0, 0), r)
    wide = 0.8 * half if held in ("yoke", "cheek") else half
    with b.moved((0, 0, 0), (0, 1, 0), b.uniform(-1.6, 1.6)):
        kind = b.choice(("tube", "shade", "camera", "boom", "panel", "clump"))
        back, front = -b.uniform(0.0, 1.0) * s, b.uniform(0.6, 2.5) * s
        if kind == "tube":
            b.cylinder(link, (back, 0, 0), (front, 0, 0), wide, wide * b.choice((1.0, 1.0, 0.8)))
            if b.chance(0.5):
                b.cylinder(link, (front, 0, 0), (1.05 * front, 0, 0), 1.05 * wide)
        elif kind == "shade":
            b.cylinder(link, (back * 0.3, 0, 0), (0.5 * front, 0, 0), 0.4 * wide, 1.6 * wide)
            b.sphere(link, (0.5 * front, 0, 0), 0.5 * wide)
        elif kind == "camera":
            b.box(link, (back, -wide, -0.8 * wide), (front, wide, 0.8 * wide))
            b.cylinder(link, (front, 0, 0), (front + 0.4 * wide, 0, 0), 0.6 * wide)
            if b.chance(0.5):
                b.box(link, (back, -1.1 * wide, 0.85 * wide), (1.2 * front, 1.1 * wide, wide))
        elif kind == "boom":
            far = b.uniform(4, 14) * s
            b.box(link, (back, -0.5 * r, -0.5 * r), (far, 0.5 * r, 0.5 * r))
            if b.chance(0.5):
                b.block(link, (back, 0, 0), (0.5 * s, 2 * r, 0.4 * s))
        elif kind == "panel":
            b.box(link, (-0.2 * r, -3 * wide, back), (0.5 * r, 3 * wide, front))
        else:
            clump(b, link, np.array([back, -wide, -wide]), np.array([front, wide, wide]), 3)
    b.hinge(link, carrier, (0, 0, 0), (0, 1, 0), -b.uniform(0.3, 1.5), b.uniform(0.3, 1.5))
