"""Abstract objects for training with several movers of different kinds on one body.

Desks, walls, consoles and blocks carry drawers, leaves, switches, buttons and dials side by side,
each of its own size, among things that stay; what makes one of them a mover holds for the others.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mam_pipeline.types import FloatArray
from mam_training.curricula.cases import FRONTS, HANDLES
from mam_training.curricula.mechanisms import (
    clump,
    decoys,
    lever_flat,
    lever_up,
    push,
    slider,
    turn,
)
from mam_world import solids
from mam_world.kit import Builder

Mover = Callable[[Builder, str, float], None]
# how many shares of the room of a cell one unit of a mover takes
SMALL: tuple[tuple[Mover, float, float], ...] = (
    (push, 0.1, 0.3), (turn, 0.1, 0.2), (lever_flat, 0.07, 0.14), (lever_up, 0.08, 0.16),
    (slider, 0.06, 0.11),
)  # fmt: skip
FILLS = ("small", "slides", "hinged", "drawer", "still", "nothing")


@dataclass(frozen=True)
class Face:
    """A flat side to mount on: local z is its normal, x points up or back, y across.

    Attributes:
        middle, normal, up: (3,). tall, wide: extents along x and y. deep: room behind it.
        hollow: whether what is let into it has room there.
    """

    middle: FloatArray
    normal: FloatArray
    up: FloatArray
    tall: float
    wide: float
    deep: float
    hollow: bool


def several(b: Builder) -> None:
    """A body with one to three faces, each a grid of movers and of what only looks so."""
    body = b.choice((_block, _desk, _desk, _wall, _wedge))
    faces, low, high = body(b)
    most = b.integer(2, 6)
    alike = b.chance(0.25)
    fill, which = _draw(b, True), b.integer(0, len(SMALL) - 1)
    size = b.uniform(0, 1)
    for face in faces:
        rows = b.integer(1, 2 if face.tall > 0.25 else 1)
        columns = b.integer(1, max(1, min(4, int(3 * face.wide / max(face.tall, 0.1)))))
        for i in range(rows):
            for j in range(columns):
                if not alike:
                    fill, which = _draw(b, False), b.integer(0, len(SMALL) - 1)
                    size = b.uniform(0, 1)
                if len(b.joints) >= most:
                    fill = b.choice(("still", "nothing"))
                _cell(b, face, (i, rows), (j, columns), fill, (which, size))
    if not b.joints:
        _cell(b, faces[0], (0, 1), (0, 1), "small", (which, size))
    decoys(b, low, high, b.choice((0, 0, 1, 3)), (0, 0, 1))


def _draw(b: Builder, moves: bool) -> str:
    share = (0.37, 0.12, 0.1, 0.13, 0.18, 0.1)
    fill = str(b.choice(FILLS, share))
    return "small" if moves and fill in ("still", "nothing") else fill


def _block(b: Builder) -> tuple[list[Face], FloatArray, FloatArray]:
    """A box, solid or a shell open in front, standing or on legs."""
    w, d, h = b.uniform(0.2, 1.2), b.uniform(0.12, 0.6), b.uniform(0.12, 0.9)
    b.size(w, d, h)
    b.theme()
    low, high = np.array([0, -w / 2, 0.0]), np.array([d, w / 2, h])
    hollow = b.chance(0.4)
    if hollow:
        b.shell("base", low, high, b.uniform(0.01, 0.04), "-x")
    else:
        clump(b, "base", low, high, b.integer(1, 3))
    if b.chance(0.3):
        b.feet("base", (0, -w / 2), (d, w / 2), -b.uniform(0.05, 0.5), "square")
    faces = [_front(0.0, w, 0.0, h, d, hollow)]
    if b.chance(0.5):
        faces.append(_top(0.0, d, w, h))
    return faces, low, high


def _desk(b: Builder) -> tuple[list[Face], FloatArray, FloatArray]:
    """A table whose board ends in a wall behind, upright or leaning back; often one solid."""
    w, d, h = b.uniform(0.5, 1.6), b.uniform(0.3, 0.8), b.uniform(0.06, 0.35)
    back, lean = b.uniform(0.12, 0.5), b.uniform(0.0, 0.9)
    b.size(w, d, h + back)
    b.theme()
    x = d * b.uniform(0.5, 0.85)  # where the wall begins
    run = min(back * np.tan(lean), 0.9 * (d - x))
    lean = float(np.arctan2(run, back))
    outline = [(0, 0), (d, 0), (d, h + back), (x + run, h + back), (x, h), (0, h)]
    hollow = b.chance(0.4)
    if hollow:
        outline = [(0, h - 0.02), *outline[1:]]
        outline[1:2] = [(d - 0.02, h - 0.02), (d - 0.02, 0), (d, 0)]
        for y in (-w / 2, w / 2 - 0.02):
            b.box("base", (0, y, 0), (d, y + 0.02, h))
        if b.chance(0.5):
            b.box("base", (0, -w / 2, 0), (d, w / 2, 0.015))
    solids.profile(b, "base", outline, -w / 2, w / 2, "y")
    for y in (-w / 2, w / 2 - 0.02) if b.chance(0.3) else ():
        solids.profile(b, "base", [(0, h), (x, h), (x + run, h + back)], y, y + 0.02, "y")
    if b.chance(0.6):
        b.feet("base", (0, -w / 2), (d, w / 2), -b.uniform(0.1, 0.6), "square")
    normal = np.array([-np.cos(lean), 0, np.sin(lean)])
    up = np.array([np.sin(lean), 0, np.cos(lean)])
    middle = np.array([x + run / 2, 0, h + back / 2])
    wall = Face(middle, normal, up, back / np.cos(lean), 0.94 * w, d - x, False)
    faces = [wall, _top(0.0, x, 0.94 * w, h), _front(0.0, w, 0.0, h, 0.8 * d, hollow)]
    low, high = np.array([0, -w / 2, 0.0]), np.array([d, w / 2, h])
    return faces, low, high


def _wall(b: Builder) -> tuple[list[Face], FloatArray, FloatArray]:
    """A panel that stands, with or without a foot, or a plate that lies."""
    w, h, t = b.uniform(0.15, 1.2), b.uniform(0.15, 1.2), b.uniform(0.01, 0.08)
    b.size(w, t, h)
    b.theme()
    if b.chance(0.3):
        solids.rounded(b, "base", (0, -w / 2, 0), (h, w / 2, t), 0.1 * min(w, h))
        return [_top(0.0, h, w, t)], np.array([0, -w / 2, 0.0]), np.array([h, w / 2, t])
    b.box("base", (0, -w / 2, 0), (t, w / 2, h))
    if b.chance(0.4):
        reach = b.uniform(0.05, 0.4) * h
        b.box("base", (-reach, -w / 2, -0.02), (t + reach, w / 2, 0))
    if b.chance(0.3):
        rim = b.uniform(0.01, 0.05)
        b.border("base", (-rim, -w / 2 - rim, -rim), (t, w / 2 + rim, h + rim), rim)
    return [_front(0.0, w, 0.0, h, t, False)], np.array([0, -w / 2, 0.0]), np.array([t, w / 2, h])


def _wedge(b: Builder) -> tuple[list[Face], FloatArray, FloatArray]:
    """A desk console whose upper side slants towards the front."""
    w, d, h = b.uniform(0.15, 0.9), b.uniform(0.1, 0.5), b.uniform(0.06, 0.4)
    b.size(w, d, h)
    b.theme()
    edge = b.uniform(0.0, 0.6) * h
    solids.profile(b, "base", [(0, 0), (d, 0), (d, h), (0, edge)], -w / 2, w / 2, "y")
    slope = np.array([d, 0, h - edge])
    length = float(np.linalg.norm(slope))
    up = slope / length
    normal = np.array([-up[2], 0, up[0]])
    face = Face(np.array([d / 2, 0, (h + edge) / 2]), normal, up, length, w, 0.4 * h, False)
    return [face], np.array([0, -w / 2, 0.0]), np.array([d, w / 2, edge])


def _front(x: float, w: float, z0: float, z1: float, deep: float, hollow: bool) -> Face:
    middle = np.array([x, 0, (z0 + z1) / 2])
    return Face(middle, np.array([-1.0, 0, 0]), np.array([0, 0, 1.0]), z1 - z0, w, deep, hollow)


def _top(x0: float, x1: float, w: float, z: float) -> Face:
    middle = np.array([(x0 + x1) / 2, 0, z])
    return Face(middle, np.array([0, 0, 1.0]), np.array([1.0, 0, 0]), x1 - x0, w, z, False)


def _cell(
    b: Builder, face: Face, row: tuple[int, int], column: tuple[int, int], fill: str,
    mover: tuple[int, float],
) -> None:  # fmt: skip
    """What one cell of a face holds."""
    tall, wide = face.tall / row[1], face.wide / column[1]
    across = np.cross(face.normal, face.up)
    x, y = (row[0] + 0.5) * tall - face.tall / 2, (column[0] + 0.5) * wide - face.wide / 2
    room = min(tall, wide)
    upright = abs(face.normal[2]) < 0.8
    if fill == "drawer" and not (upright and min(tall, wide) > 0.05):
        fill = "slides"
    with b.facing(face.middle + x * face.up + y * across, face.normal, face.up):
        if fill == "small":
            make, least, most = SMALL[mover[0]]
            with b.moved((0, 0, 0), (0, 0, 1), float(b.choice((0.0, 0.0, np.pi / 2, np.pi)))):
                make(b, b.link("part", "part"), room * (least + mover[1] * (most - least)))
        elif fill == "drawer":
            _drawer(b, face, 0.8 * tall, 0.85 * wide)
        elif fill in ("slides", "hinged"):
            _leaf(b, tall * b.uniform(0.5, 0.9), wide * b.uniform(0.4, 0.8), fill)
        elif fill == "still":
            _still(b, room * b.uniform(0.06, 0.3))


def _leaf(b: Builder, tall: float, wide: float, fill: str) -> None:
    """A leaf on the face that slides across or along it, or is hinged at one edge."""
    link = b.link("leaf", "door")
    g, t = max(b.gap, 5e-4), b.uniform(0.03, 0.15) * min(tall, wide)
    low, high = np.array([-tall / 2, -wide / 2, g]), np.array([tall / 2, wide / 2, g + t])
    b.box(link, low, high) if b.chance(0.7) else solids.rounded(
        b, link, low, high, 0.1 * min(tall, wide)
    )
    side = b.choice((-1, 1))
    inset = b.choice((0.0, b.uniform(0.2, 0.45)))
    if b.chance(0.85):
        b.handle(link, (0, side * inset * wide, g + t), (0, 0, 1), (1, 0, 0),
                 tall * b.uniform(0.15, 0.7), b.choice(HANDLES))  # fmt: skip
    if fill == "hinged":
        b.hinge(link, "base", (0, -side * wide / 2, g), (1, 0, 0), 0, b.uniform(1.2, 2.4),
                opens=(0, 0, 1))  # fmt: skip
        return
    run = b.uniform(0.3, 0.9) * wide
    b.slide(link, "base", (0, -side, 0), 0, run)
    if b.chance(0.5):
        for x in (-tall / 2 - 0.5 * t - g, tall / 2 + 0.5 * t + g):
            b.block("base", (x, -side * run / 2, 0.6 * t), (t, wide + run, 1.2 * t + 2 * g))


def _drawer(b: Builder, face: Face, tall: float, wide: float) -> None:
    """A front on the face, with a box behind it where there is room, now and then where not."""
    link = b.link("drawer", "drawer")
    g, t = max(b.gap, 5e-4), b.uniform(0.03, 0.15) * min(tall, wide)
    low, high = np.array([-tall / 2, -wide / 2, g]), np.array([tall / 2, wide / 2, g + t])
    if b.chance(0.3):
        b.box(link, low, high)
    else:
        with b.facing((0, 0, 0), (1, 0, 0), (0, 0, -1)):
            w, h = wide / 2, tall / 2
            b.front(link, (-g - t, -w, -h), (-g, w, h), b.choice(FRONTS))
    if b.chance(0.9 if face.hollow else 0.3):
        deep = face.deep * b.uniform(0.4, 0.9)
        shrink = b.uniform(0.75, 0.95)
        with b.facing((0, 0, 0), (1, 0, 0), (0, 0, -1)):
            b.drawer_box(link, (0, -shrink * wide / 2, -shrink * tall / 2),
                         (deep, shrink * wide / 2, 0.3 * tall), 0.08 * min(tall, wide))  # fmt: skip
    if b.chance(0.85):
        b.handle(link, (0, 0, g + t), (0, 0, 1), (0, 1, 0), wide * b.uniform(0.15, 0.7),
                 b.choice(HANDLES))  # fmt: skip
    b.slide(link, "base", (0, 0, 1), 0, 0.8 * face.deep)


def _still(b: Builder, s: float) -> None:
    """A thing on the face that stays: lamp, plate, screen, fixed bar."""
    kind = b.choice(("ball", "plate", "bar", "cap", "frame"))
    if kind == "ball":
        b.sphere("base", (0, 0, b.uniform(0.2, 0.9) * s), s)
    elif kind == "plate":
        b.block("base", (0, 0, 0.1 * s), (b.uniform(1, 3) * s, b.uniform(1, 4) * s, 0.25 * s))
    elif kind == "bar":
        b.handle("base", (0, 0, 0), (0, 0, 1), (1, 0, 0), 4 * s)
    elif kind == "cap":
        b.cylinder("base", (0, 0, 0), (0, 0, b.uniform(0.2, 1.5) * s), s, 0.8 * s)
    else:
        with b.facing((0, 0, 0), (1, 0, 0), (0, 0, -1)):
            b.border("base", (-0.3 * s, -1.5 * s, -s), (0, 1.5 * s, s), 0.2 * s)
